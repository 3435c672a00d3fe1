"""Vertices: supports, block elimination along each chain, back substitution.

Rule: after condensation a rod is a chain of vertices with 6 unknowns and 12x12 matrices between neighbours. A segment
is a run of elements between two joints (vertices shared with other rods) or free ends; its inner vertices are
eliminated in order, in one pass, with one 6x6 factorisation each. A segment without joints is solved outright; one
with joints leaves a 12x12 matrix between them.

Elimination keeps three couplings of the current vertex: to the next vertex, to the left joint (which fills in), and
its own block. Cost per vertex is constant, memory 6x7 numbers (6x13 with joints).
"""

from __future__ import annotations

import numpy as np

from . import inner, kernel


@kernel
def transform_vertices(S, rhs, vertex_rhs, nodes, left, right, T):
    """Express the rows and columns of some vertices in unknowns y, node increment = T y.

    nodes (M,), T (M, 6, 6); left, right (M,): the element that ends or starts at the node, or -1.
    S (E, 12, 12), rhs (E, 12), vertex_rhs (N, 6) are changed in place.
    """
    row = np.empty(6)
    for s in range(nodes.shape[0]):
        for side in range(2):
            e, o = (left[s], 6) if side == 0 else (right[s], 0)
            if e < 0:
                continue
            for i in range(12):
                for j in range(6):
                    total = 0.0
                    for k in range(6):
                        total += S[e, i, o + k] * T[s, k, j]
                    row[j] = total
                for j in range(6):
                    S[e, i, o + j] = row[j]
            for i in range(12):
                for j in range(6):
                    total = 0.0
                    for k in range(6):
                        total += T[s, k, j] * S[e, o + k, i]
                    row[j] = total
                for j in range(6):
                    S[e, o + j, i] = row[j]
            for j in range(6):
                total = 0.0
                for k in range(6):
                    total += T[s, k, j] * rhs[e, o + k]
                row[j] = total
            for j in range(6):
                rhs[e, o + j] = row[j]
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += T[s, k, j] * vertex_rhs[nodes[s], k]
            row[j] = total
        for j in range(6):
            vertex_rhs[nodes[s], j] = row[j]


@kernel
def add_to_vertices(S, nodes, left, right, blocks):
    """Add blocks (M, 6, 6) to the diagonal of some vertices, each once."""
    for s in range(nodes.shape[0]):
        e, o = (left[s], 6) if left[s] >= 0 else (right[s], 0)
        for i in range(6):
            for j in range(6):
                S[e, o + i, o + j] += blocks[s, i, j]


@kernel
def hold_vertices(S, rhs, vertex_rhs, nodes, left, right, held, gap, owner):
    """Prescribe the held unknowns of some vertices: y = gap there.

    held (M, 6) bool, gap (M, 6) [m, rad]: moved to the right-hand side; the row becomes the identity.
    owner (M,) bool: of several rows for one unknown (rods that share a joint), the one that carries the identity.
    """
    for s in range(nodes.shape[0]):
        first = owner[s]
        for side in range(2):
            e, o = (left[s], 6) if side == 0 else (right[s], 0)
            if e < 0:
                continue
            for j in range(6):
                if held[s, j]:
                    for i in range(12):
                        rhs[e, i] -= S[e, i, o + j] * gap[s, j]
                        S[e, i, o + j] = 0.0
            for j in range(6):
                if held[s, j]:
                    for i in range(12):
                        S[e, o + j, i] = 0.0
                    rhs[e, o + j] = 0.0
                    S[e, o + j, o + j] = 1.0 if first else 0.0
            first = False
        for j in range(6):
            if held[s, j]:
                vertex_rhs[nodes[s], j] = gap[s, j] if owner[s] else 0.0


@inner
def eliminate_block(M, n, pivoting):
    """Gauss elimination of the leading 6x6 block of M (6, 6 + n): on return the n columns hold D^-1 times themselves.

    Returns the number of negative pivots (meaningful without pivoting, for a symmetric block), or -1 if singular.
    """
    negative = 0
    for k in range(6):
        if pivoting:
            best = k
            for i in range(k + 1, 6):
                if abs(M[i, k]) > abs(M[best, k]):
                    best = i
            for j in range(6 + n):
                M[k, j], M[best, j] = M[best, j], M[k, j]
        pivot = M[k, k]
        if pivot == 0.0 or not np.isfinite(pivot):
            return -1
        if pivot < 0.0:
            negative += 1
        for j in range(k + 1, 6 + n):
            M[k, j] /= pivot
        for i in range(k + 1, 6):
            for j in range(k + 1, 6 + n):
                M[i, j] -= M[i, k] * M[k, j]
    for k in range(5, 0, -1):
        for i in range(k):
            for j in range(6, 6 + n):
                M[i, j] -= M[i, k] * M[k, j]
    return negative


@inner
def subtract_product(A, row, X, n, out):
    """out (6, n) -= A[row : row + 6, :6] X, with X the columns 6 .. 6 + n of an eliminated block."""
    for i in range(6):
        for c in range(6):
            f = A[row + i, c]
            for j in range(n):
                out[i, j] -= f * X[c, 6 + j]


@kernel
def eliminate_segments(S, rhs, vertex_rhs, segments, symmetric, kept, joint_S, joint_rhs):
    """Eliminate the inner vertices of every segment.

    segments (G, 6): first element, number of elements, first vertex (node number; they follow one another), left
    joint or -1, right joint or -1, first row of kept. kept (vertices, 6, 7 or 13): what back substitution needs of
    each vertex (coupling to the next, right-hand side, coupling to the left joint).
    joint_S (G, 12, 12), joint_rhs (G, 12): matrix and right-hand side between the two joints, written.
    Returns the number of negative pivots, or -1 - (node number) of a singular vertex.
    """
    # a row of blocks: columns 0-5 the next vertex (of `carry`: the vertex itself), 6 right-hand side, 7-12 left joint
    M, carry, joint = np.zeros((6, 19)), np.zeros((6, 13)), np.zeros((6, 13))
    negative = 0
    for g in range(segments.shape[0]):
        first, count, vertex, left, right, row = segments[g]
        n = 13 if left >= 0 else 7
        carry[:] = 0.0
        joint[:] = 0.0
        for k in range(count + 1):
            e, last = first + k, k == count
            if last and right >= 0:
                break
            if k == 0 and left >= 0:
                for i in range(6):
                    joint[i, 6], carry[i, 6] = rhs[e, i], rhs[e, 6 + i]
                    for j in range(6):
                        joint[i, j], joint[i, 7 + j] = S[e, i, 6 + j], S[e, i, j]
                        carry[i, j], carry[i, 7 + j] = S[e, 6 + i, 6 + j], S[e, 6 + i, j]
                continue
            for i in range(6):
                for j in range(6):
                    M[i, j] = carry[i, j] if last else carry[i, j] + S[e, i, j]
                    M[i, 6 + j] = 0.0 if last else S[e, i, 6 + j]
                    M[i, 13 + j] = carry[i, 7 + j]
                M[i, 12] = carry[i, 6] + vertex_rhs[vertex + k, i] + (0.0 if last else rhs[e, i])
            sign = eliminate_block(M, n, not symmetric)
            if sign < 0:
                return -1 - (vertex + k)
            negative += sign
            for i in range(6):
                for j in range(n):
                    kept[row + k, i, j] = M[i, 6 + j]
            if not last:
                for i in range(6):
                    carry[i, 6] = rhs[e, 6 + i]
                    for j in range(6):
                        carry[i, j], carry[i, 7 + j] = S[e, 6 + i, 6 + j], 0.0
                subtract_product(S[e], 6, M, n, carry)
            if left >= 0:
                for i in range(6):  # the coupling of the joint moves on to the next vertex
                    for j in range(6):
                        M[i, j], joint[i, j] = joint[i, j], 0.0
                subtract_product(M, 0, M, n, joint)
        for i in range(6):
            joint_rhs[g, i], joint_rhs[g, 6 + i] = joint[i, 6], carry[i, 6]
            for j in range(6):
                joint_S[g, i, j], joint_S[g, i, 6 + j] = joint[i, 7 + j], joint[i, j]
                joint_S[g, 6 + i, j], joint_S[g, 6 + i, 6 + j] = carry[i, 7 + j], carry[i, j]
    return negative


@kernel
def back_substitute_segments(segments, kept, joint_solution, du):
    """Solution du (N, 6) at the vertices of every segment, from the last to the first.  joint_solution (J, 6)."""
    for g in range(segments.shape[0]):
        _, count, vertex, left, right, row = segments[g]
        for k in range(count, -1, -1):
            node = vertex + k
            joint = left if k == 0 else (right if k == count else -1)
            if joint >= 0:
                for i in range(6):
                    du[node, i] = joint_solution[joint, i]
                continue
            for i in range(6):
                total = kept[row + k, i, 6]
                if k < count:
                    for j in range(6):
                        total -= kept[row + k, i, j] * du[node + 1, j]
                if left >= 0:
                    for j in range(6):
                        total -= kept[row + k, i, 7 + j] * joint_solution[left, j]
                du[node, i] = total


@kernel
def untransform_vertices(nodes, T, du):
    """Turn the unknowns y of some vertices into node increments: du = T y."""
    row = np.empty(6)
    for s in range(nodes.shape[0]):
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += T[s, i, j] * du[nodes[s], j]
            row[i] = total
        for i in range(6):
            du[nodes[s], i] = row[i]
