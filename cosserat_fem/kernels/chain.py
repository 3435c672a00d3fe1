"""Vertices: supports, block elimination along each chain, back substitution.

Rule: after condensation a rod is a chain of vertices with d unknowns, 6 in space and 3 in a plane, and 2d x 2d matrices
between neighbours. A segment is a run of elements between two joints (vertices shared with other rods) or free ends; its
inner vertices are eliminated in order, in one pass, with one d x d factorisation each. A segment without joints is solved
outright; one with joints leaves a 2d x 2d matrix between them.

Elimination keeps three couplings of the current vertex: to the next vertex, to the left joint (which fills in), and
its own block. Cost per vertex is constant, memory d (d + 1) numbers, d (2d + 1) with joints.

Every kernel takes `size`, a tuple with d entries: the length of a tuple is known when the kernel is compiled, so that its
loops are unrolled for 6 and for 3. Shapes below are for 6.
"""

from __future__ import annotations

import numpy as np

from . import inner, kernel

SPACE, PLANE = (0,) * 6, (0,) * 3


@kernel
def transform_vertices(size, S, rhs, vertex_rhs, nodes, left, right, T):
    """Express the rows and columns of some vertices in unknowns y, node increment = T y.

    nodes (M,), T (M, 6, 6); left, right (M,): the element that ends or starts at the node, or -1.
    S (E, 12, 12), rhs (E, 12), vertex_rhs (N, 6) are changed in place.
    """
    d = len(size)
    row = np.empty(d)
    for s in range(nodes.shape[0]):
        for side in range(2):
            e, o = (left[s], d) if side == 0 else (right[s], 0)
            if e < 0:
                continue
            for i in range(2 * d):
                for j in range(d):
                    total = 0.0
                    for k in range(d):
                        total += S[e, i, o + k] * T[s, k, j]
                    row[j] = total
                for j in range(d):
                    S[e, i, o + j] = row[j]
            for i in range(2 * d):
                for j in range(d):
                    total = 0.0
                    for k in range(d):
                        total += T[s, k, j] * S[e, o + k, i]
                    row[j] = total
                for j in range(d):
                    S[e, o + j, i] = row[j]
            for j in range(d):
                total = 0.0
                for k in range(d):
                    total += T[s, k, j] * rhs[e, o + k]
                row[j] = total
            for j in range(d):
                rhs[e, o + j] = row[j]
        for j in range(d):
            total = 0.0
            for k in range(d):
                total += T[s, k, j] * vertex_rhs[nodes[s], k]
            row[j] = total
        for j in range(d):
            vertex_rhs[nodes[s], j] = row[j]


@kernel
def add_to_vertices(size, S, nodes, left, right, blocks):
    """Add blocks (M, 6, 6) to the diagonal of some vertices, each once."""
    d = len(size)
    for s in range(nodes.shape[0]):
        e, o = (left[s], d) if left[s] >= 0 else (right[s], 0)
        for i in range(d):
            for j in range(d):
                S[e, o + i, o + j] += blocks[s, i, j]


@kernel
def hold_vertices(size, S, rhs, vertex_rhs, nodes, left, right, held, gap, owner):
    """Prescribe the held unknowns of some vertices: y = gap there.

    held (M, 6) bool, gap (M, 6) [m, rad]: moved to the right-hand side; the row becomes the identity.
    owner (M,) bool: of several rows for one unknown (rods that share a joint), the one that carries the identity.
    """
    d = len(size)
    for s in range(nodes.shape[0]):
        first = owner[s]
        for side in range(2):
            e, o = (left[s], d) if side == 0 else (right[s], 0)
            if e < 0:
                continue
            for j in range(d):
                if held[s, j]:
                    for i in range(2 * d):
                        rhs[e, i] -= S[e, i, o + j] * gap[s, j]
                        S[e, i, o + j] = 0.0
            for j in range(d):
                if held[s, j]:
                    for i in range(2 * d):
                        S[e, o + j, i] = 0.0
                    rhs[e, o + j] = 0.0
                    S[e, o + j, o + j] = 1.0 if first else 0.0
            first = False
        for j in range(d):
            if held[s, j]:
                vertex_rhs[nodes[s], j] = gap[s, j] if owner[s] else 0.0


@inner
def eliminate_block(size, M, n, pivoting):
    """Gauss elimination of the leading 6x6 block of M (6, 6 + n): on return the n columns hold D^-1 times themselves.

    Returns the number of negative pivots (meaningful without pivoting, for a symmetric block), or -1 if singular.
    """
    d = len(size)
    negative = 0
    for k in range(d):
        if pivoting:
            best = k
            for i in range(k + 1, d):
                if abs(M[i, k]) > abs(M[best, k]):
                    best = i
            for j in range(d + n):
                M[k, j], M[best, j] = M[best, j], M[k, j]
        pivot = M[k, k]
        if pivot == 0.0 or not np.isfinite(pivot):
            return -1
        if pivot < 0.0:
            negative += 1
        for j in range(k + 1, d + n):
            M[k, j] /= pivot
        for i in range(k + 1, d):
            for j in range(k + 1, d + n):
                M[i, j] -= M[i, k] * M[k, j]
    for k in range(d - 1, 0, -1):
        for i in range(k):
            for j in range(d, d + n):
                M[i, j] -= M[i, k] * M[k, j]
    return negative


@inner
def subtract_product(size, A, row, X, n, out):
    """out (6, n) -= A[row : row + 6, :6] X, with X the columns 6 .. 6 + n of an eliminated block."""
    d = len(size)
    for i in range(d):
        for c in range(d):
            f = A[row + i, c]
            for j in range(n):
                out[i, j] -= f * X[c, d + j]


@kernel
def eliminate_segments(size, S, rhs, vertex_rhs, segments, symmetric, kept, joint_S, joint_rhs):
    """Eliminate the inner vertices of every segment.

    segments (G, 6): first element, number of elements, first vertex (node number; they follow one another), left
    joint or -1, right joint or -1, first row of kept. kept (vertices, 6, 7 or 13): what back substitution needs of
    each vertex (coupling to the next, right-hand side, coupling to the left joint).
    joint_S (G, 12, 12), joint_rhs (G, 12): matrix and right-hand side between the two joints, written.
    Returns the number of negative pivots, or -1 - (node number) of a singular vertex.
    """
    d = len(size)
    # a row of blocks: first the next vertex (of `carry`: the vertex itself), then right-hand side, then the left joint
    M, carry, joint = np.zeros((d, 3 * d + 1)), np.zeros((d, 2 * d + 1)), np.zeros((d, 2 * d + 1))
    negative = 0
    for g in range(segments.shape[0]):
        first, count, vertex, left, right, row = segments[g]
        n = 2 * d + 1 if left >= 0 else d + 1
        carry[:] = 0.0
        joint[:] = 0.0
        for k in range(count + 1):
            e, last = first + k, k == count
            if last and right >= 0:
                break
            if k == 0 and left >= 0:
                for i in range(d):
                    joint[i, d], carry[i, d] = rhs[e, i], rhs[e, d + i]
                    for j in range(d):
                        joint[i, j], joint[i, d + 1 + j] = S[e, i, d + j], S[e, i, j]
                        carry[i, j], carry[i, d + 1 + j] = S[e, d + i, d + j], S[e, d + i, j]
                continue
            for i in range(d):
                for j in range(d):
                    M[i, j] = carry[i, j] if last else carry[i, j] + S[e, i, j]
                    M[i, d + j] = 0.0 if last else S[e, i, d + j]
                    M[i, 2 * d + 1 + j] = carry[i, d + 1 + j]
                M[i, 2 * d] = carry[i, d] + vertex_rhs[vertex + k, i] + (0.0 if last else rhs[e, i])
            sign = eliminate_block(size, M, n, not symmetric)
            if sign < 0:
                return -1 - (vertex + k)
            negative += sign
            for i in range(d):
                for j in range(n):
                    kept[row + k, i, j] = M[i, d + j]
            if not last:
                for i in range(d):
                    carry[i, d] = rhs[e, d + i]
                    for j in range(d):
                        carry[i, j], carry[i, d + 1 + j] = S[e, d + i, d + j], 0.0
                subtract_product(size, S[e], d, M, n, carry)
            if left >= 0:
                for i in range(d):  # the coupling of the joint moves on to the next vertex
                    for j in range(d):
                        M[i, j], joint[i, j] = joint[i, j], 0.0
                subtract_product(size, M, 0, M, n, joint)
        for i in range(d):
            joint_rhs[g, i], joint_rhs[g, d + i] = joint[i, d], carry[i, d]
            for j in range(d):
                joint_S[g, i, j], joint_S[g, i, d + j] = joint[i, d + 1 + j], joint[i, j]
                joint_S[g, d + i, j], joint_S[g, d + i, d + j] = carry[i, d + 1 + j], carry[i, j]
    return negative


@kernel
def back_substitute_segments(size, segments, kept, joint_solution, du):
    """Solution du (N, 6) at the vertices of every segment, from the last to the first.  joint_solution (J, 6)."""
    d = len(size)
    for g in range(segments.shape[0]):
        _, count, vertex, left, right, row = segments[g]
        for k in range(count, -1, -1):
            node = vertex + k
            joint = left if k == 0 else (right if k == count else -1)
            if joint >= 0:
                for i in range(d):
                    du[node, i] = joint_solution[joint, i]
                continue
            for i in range(d):
                total = kept[row + k, i, d]
                if k < count:
                    for j in range(d):
                        total -= kept[row + k, i, j] * du[node + 1, j]
                if left >= 0:
                    for j in range(d):
                        total -= kept[row + k, i, d + 1 + j] * joint_solution[left, j]
                du[node, i] = total


@kernel
def untransform_vertices(size, nodes, T, du):
    """Turn the unknowns y of some vertices into node increments: du = T y."""
    d = len(size)
    row = np.empty(d)
    for s in range(nodes.shape[0]):
        for i in range(d):
            total = 0.0
            for j in range(d):
                total += T[s, i, j] * du[nodes[s], j]
            row[i] = total
        for i in range(d):
            du[nodes[s], i] = row[i]


@kernel
def solve_joints(size, segments, joint_S, joint_rhs, vertex_rhs, nodes, index, band, y):
    """Unknowns y (J, 6) of all joints, from the matrices between them: Gauss elimination in a band, without pivoting.

    nodes, index (K,): nodes of the joints and the joint that each belongs to; band (6 J, 2 h + 1): scratch, h the half
    width that the numbering of the joints needs. Returns the number of negative pivots, or -1 if singular.
    """
    d, n, half = len(size), band.shape[0], band.shape[1] // 2
    band[:] = 0.0
    y[:] = 0.0
    flat = y.ravel()
    for k in range(nodes.shape[0]):
        for i in range(d):
            y[index[k], i] += vertex_rhs[nodes[k], i]
    for g in range(segments.shape[0]):
        for a in range(2):
            row = segments[g, 3 + a]
            if row < 0:
                continue
            for i in range(d):
                y[row, i] += joint_rhs[g, d * a + i]
            for b in range(2):
                column = segments[g, 3 + b]
                if column < 0:
                    continue
                for i in range(d):
                    for j in range(d):
                        band[d * row + i, d * (column - row) + j - i + half] += joint_S[g, d * a + i, d * b + j]
    negative = 0
    for k in range(n):
        pivot = band[k, half]
        if pivot == 0.0 or not np.isfinite(pivot):
            return -1
        if pivot < 0.0:
            negative += 1
        for i in range(k + 1, min(k + half + 1, n)):
            f = band[i, k - i + half] / pivot
            if f != 0.0:
                for j in range(k + 1, min(k + half + 1, n)):
                    band[i, j - i + half] -= f * band[k, j - k + half]
                flat[i] -= f * flat[k]
    for k in range(n - 1, -1, -1):
        total = flat[k]
        for j in range(k + 1, min(k + half + 1, n)):
            total -= band[k, j - k + half] * flat[j]
        flat[k] = total / band[k, half]
    return negative
