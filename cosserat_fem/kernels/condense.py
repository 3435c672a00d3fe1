"""Loops over packs of elements: residual, element matrices, condensed tangent, back substitution, stress memory.

Rule: here elements become vertices. Interior nodes belong to one element, so their unknowns are eliminated element
by element (static condensation) and only 12x12 matrices between the two end vertices leave this room. Elimination is
without pivoting; for a symmetric matrix the number of negative pivots is the number of negative eigenvalues
(Sylvester), which is the stability count.

Order inside an element: interior nodes first, then the two vertices; local node a of the connectivity (vertices 0 and
1, interior from 2) is block `a - 2` or `a + p - 1`. The right-hand side is one more column.
"""

from __future__ import annotations

import numpy as np

from . import inner, kernel
from .beam import (
    COLUMN_ROWS,
    FORCE_ROWS,
    KINEMATIC_ROWS,
    LANES,
    TANGENT_ROWS,
    add_node_force,
    add_rotation_block,
    add_update_curvature,
    add_x_block,
    add_x_rotation_block,
    at,
    couple_stress,
    couple_tangent,
    gather,
    generalized_force,
    interpolate,
    kinematics,
    relative_quaternion,
    strain_minus_reference,
    stress_from_strain,
    tangent_coefficients,
    tangent_column,
)


@inner
def clear(array):
    for i in range(array.shape[0]):
        array[i] = 0.0


@inner
def raise_to(largest, T):
    """Keep the largest squared force and moment seen: largest two rows, T six rows."""
    for l in range(LANES):
        n2 = T[l] * T[l] + T[LANES + l] * T[LANES + l] + T[2 * LANES + l] * T[2 * LANES + l]
        m2 = T[3 * LANES + l] * T[3 * LANES + l] + T[4 * LANES + l] * T[4 * LANES + l]
        m2 += T[5 * LANES + l] * T[5 * LANES + l]
        largest[l] = max(largest[l], n2)
        largest[LANES + l] = max(largest[LANES + l], m2)


@inner
def largest_of(largest):
    n2 = m2 = 0.0
    for l in range(LANES):
        n2, m2 = max(n2, largest[l]), max(m2, largest[LANES + l])
    return np.sqrt(n2), np.sqrt(m2)


@inner
def scatter_nodes(conn, count, G, g):
    """Add a pack's nodal rows G (6A) to g (N, 6); lanes from `count` on are padding."""
    for lane in range(count):
        for a in range(conn.shape[0]):
            k = conn[a, lane]
            for i in range(6):
                g[k, i] += G[(6 * a + i) * LANES + lane]


@kernel
def residual(conn, n_elements, N, N_s, dx, C, C_full, reference, r, q, g):
    """Add the internal force of all elements to g (N, 6): force in space, moment in the body frame.

    conn (P, A, LANES), N (Q, A), N_s (P, Q, A * LANES), dx (P, Q, LANES), C and reference (P, Q, 6 * LANES),
    C_full (P, Q, 36 * LANES) or None.  Returns the largest section force [N] and moment [N m].
    """
    A, Q = conn.shape[1], N.shape[0]
    node, S = np.empty(7 * A * LANES), np.empty(11 * LANES)
    M, F = np.empty(KINEMATIC_ROWS * LANES), np.empty(FORCE_ROWS * LANES)
    strain, T, c = np.empty(6 * LANES), np.empty(6 * LANES), np.empty(4 * LANES)
    G, largest = np.empty(6 * A * LANES), np.zeros(2 * LANES)
    for k in range(conn.shape[0]):
        gather(conn[k], r, q, node)
        clear(G)
        for i in range(Q):
            interpolate(N[i], N_s[k, i], node, S)
            kinematics(S, M)
            strain_minus_reference(M, reference[k, i], strain)
            stress_from_strain(strain, C[k, i], T)
            if C_full is not None:
                couple_stress(strain, C_full[k, i], T)
            raise_to(largest, T)
            generalized_force(M, T, dx[k, i], F)
            slope = N_s[k, i]
            for a in range(A):
                relative_quaternion(M, node[7 * a * LANES :], c, at(0))
                add_node_force(N[i, a], slope, at(a), c, at(0), F, G[6 * a * LANES :])
        scatter_nodes(conn[k], min(LANES, n_elements - k * LANES), G, g)
    return largest_of(largest)


@inner
def block_entry(A, a, i, b, j):
    """Where entry (6a + i, 6b + j) of a pack's matrix stands in its 6x6 blocks.

    Filled are entries (i, 3 + j) of every block (a, b), (i, j) and (3 + i, 3 + j) of blocks with a >= b.
    """
    if i < 3 and j >= 3:
        return 36 * (a * A + b) + 6 * i + j
    if i >= 3 and j < 3:
        return 36 * (b * A + a) + 6 * j + i
    if a >= b:
        return 36 * (a * A + b) + 6 * i + j
    return 36 * (b * A + a) + 6 * j + i


# The innermost loops take whole arrays and unsigned offsets: a slice costs about 20 ns, more than the loop itself, and
# a signed offset could count from the end of the array, which would keep the loop from being vectorised.
U1, U2, U3, U4, U5 = (np.uint64(k * LANES) for k in range(1, 6))


@inner
def export_matrices(A, count, first, K, matrices):
    """Copy the blocks of a pack to matrices (E, 6A, 6A), nodes in connectivity order."""
    for a in range(A):
        for b in range(A):
            for i in range(6):
                for j in range(6):
                    source = K[block_entry(A, a, i, b, j) * LANES :]
                    for lane in range(count):
                        matrices[first + lane, 6 * a + i, 6 * b + j] = source[lane]


@inner
def copy_lanes(source, so, target, to):
    for l in range(U1):
        target[to + l] = source[so + l]


@inner
def scale_six(f, source, so, target, to):
    """target = f source for six columns, one factor per lane."""
    for l in range(U1):
        g = f[l]
        target[to + l] = g * source[so + l]
        target[to + l + U1] = g * source[so + l + U1]
        target[to + l + U2] = g * source[so + l + U2]
        target[to + l + U3] = g * source[so + l + U3]
        target[to + l + U4] = g * source[so + l + U4]
        target[to + l + U5] = g * source[so + l + U5]


@inner
def subtract_six(f, fo, source, so, target, to):
    """target -= f source for six columns, one factor per lane."""
    for l in range(U1):
        g = f[fo + l]
        target[to + l] -= g * source[so + l]
        target[to + l + U1] -= g * source[so + l + U1]
        target[to + l + U2] -= g * source[so + l + U2]
        target[to + l + U3] -= g * source[so + l + U3]
        target[to + l + U4] -= g * source[so + l + U4]
        target[to + l + U5] -= g * source[so + l + U5]


@inner
def subtract_dot_six(row, ro, u, uo, total):
    """total -= sum of row * u over six columns."""
    for l in range(U1):
        t = row[ro + l] * u[uo + l] + row[ro + l + U1] * u[uo + l + U1]
        t += row[ro + l + U2] * u[uo + l + U2] + row[ro + l + U3] * u[uo + l + U3]
        t += row[ro + l + U4] * u[uo + l + U4] + row[ro + l + U5] * u[uo + l + U5]
        total[l] -= t


@inner
def condense_pack(count, n_interior, X, b, f, symmetric):
    """Eliminate the first n_interior unknowns of a pack: matrix X (n rows of n columns), right-hand side b (n), flat.

    Columns are handled in blocks of six; with `symmetric` only blocks on and above the diagonal are used.
    f: scratch (n). Returns the number of negative pivots in the first `count` lanes.
    """
    n = n_interior + 12
    inverse = np.empty(LANES)
    negative = 0
    for k in range(n_interior):
        pivot = X[(k * n + k) * LANES :]
        for lane in range(count):
            if pivot[lane] < 0.0:
                negative += 1
        for l in range(LANES):
            inverse[l] = 1.0 / pivot[l]
        block = k // 6
        if symmetric:
            for c in range(block, n // 6):
                scale_six(inverse, X, at(k * n + 6 * c), f, at(6 * c))
        else:
            for i in range(k + 1, n):
                for l in range(LANES):
                    f[i * LANES + l] = inverse[l] * X[(i * n + k) * LANES + l]
        for i in range(k + 1, n):
            for c in range(i // 6 if symmetric else block, n // 6):
                subtract_six(f, at(i), X, at(k * n + 6 * c), X, at(i * n + 6 * c))
        for i in range(k + 1, 6 * block + 6):
            for l in range(LANES):
                b[i * LANES + l] -= f[i * LANES + l] * b[k * LANES + l]
        for c in range(block + 1, n // 6):
            subtract_six(b, at(k), f, at(6 * c), b, at(6 * c))
    return negative


@inner
def keep_factor(n_interior, X, b, factor):
    """Store what back substitution needs of a pack: the eliminated rows of X, then those of b."""
    n = n_interior + 12
    for k in range(n_interior * n * LANES):
        factor[k] = X[k]
    for k in range(n_interior * LANES):
        factor[n_interior * n * LANES + k] = b[k]


@inner
def export_pack(count, first, n_interior, X, b, S, rhs, symmetric):
    """Copy the condensed 12x12 matrices and right-hand sides of a pack to S (E, 12, 12) and rhs (E, 12)."""
    n = n_interior + 12
    for i in range(12):
        for j in range(i if symmetric else 0, 12):
            row = X[((n_interior + i) * n + n_interior + j) * LANES :]
            for lane in range(count):
                S[first + lane, i, j] = row[lane]
                if symmetric:
                    S[first + lane, j, i] = row[lane]
        row = b[(n_interior + i) * LANES :]
        for lane in range(count):
            rhs[first + lane, i] = row[lane]


@inner
def fill_rhs(conn, g, b):
    """Right-hand side -g at the interior nodes; the vertices' share is summed over elements elsewhere."""
    A = conn.shape[0]
    for a in range(A):
        row = 6 * (a - 2 if a >= 2 else a + A - 2)
        for lane in range(LANES):
            k = conn[a, lane]
            for i in range(6):
                b[(row + i) * LANES + lane] = -g[k, i] if a >= 2 else 0.0


@inner
def add_extra(first, count, extra, A, X):
    """Add element matrices extra (E, 6A, 6A), nodes in connectivity order, to a pack's matrix."""
    n = 6 * A
    for a in range(A):
        row = 6 * (a - 2 if a >= 2 else a + A - 2)
        for b in range(A):
            column = 6 * (b - 2 if b >= 2 else b + A - 2)
            for i in range(6):
                for j in range(6):
                    for lane in range(count):
                        X[((row + i) * n + column + j) * LANES + lane] += extra[first + lane, 6 * a + i, 6 * b + j]


@inner
def add_touched(first, count, touched, blocks, A, X):
    """As `add_extra`, for the few elements that have a block: touched (E,), its number or -1."""
    n = 6 * A
    for lane in range(count):
        s = touched[first + lane]
        if s < 0:
            continue
        for a in range(A):
            row = 6 * (a - 2 if a >= 2 else a + A - 2)
            for b in range(A):
                column = 6 * (b - 2 if b >= 2 else b + A - 2)
                for i in range(6):
                    for j in range(6):
                        X[((row + i) * n + column + j) * LANES + lane] += blocks[s, 6 * a + i, 6 * b + j]


@inner
def add_nodal(conn, first, count, owner, nodal, X):
    """Add nodal matrices nodal (N, 6, 6) to a pack's matrix, each node once: in the element owner[node]."""
    A = conn.shape[0]
    n = 6 * A
    for a in range(A):
        row = 6 * (a - 2 if a >= 2 else a + A - 2)
        for lane in range(count):
            k = conn[a, lane]
            if owner[k] == first + lane:
                for i in range(6):
                    for j in range(6):
                        X[((row + i) * n + row + j) * LANES + lane] += nodal[k, i, j]


@inner
def add_shift(conn, first, count, owner, shift, mu, X):
    """Add mu * shift (N, 6) on the diagonal of a pack's matrix, each node once."""
    A = conn.shape[0]
    n = 6 * A
    for a in range(A):
        row = 6 * (a - 2 if a >= 2 else a + A - 2)
        for lane in range(count):
            k = conn[a, lane]
            if owner[k] == first + lane:
                for i in range(6):
                    X[((row + i) * n + row + i) * LANES + lane] += mu * shift[k, i]


@inner
def fill_matrix(A, K, X):
    """Arrange the blocks of a pack as rows and columns, interior nodes first: X (n rows of n columns)."""
    n = 6 * A
    for a in range(A):
        row = 6 * (a - 2 if a >= 2 else a + A - 2)
        for b in range(A):
            column = 6 * (b - 2 if b >= 2 else b + A - 2)
            for i in range(6):
                for j in range(6):
                    copy_lanes(K, at(block_entry(A, a, i, b, j)), X, at((row + i) * n + column + j))


@kernel
def assemble(
    conn,
    n_elements,
    N,
    N_s,
    dx,
    C,
    C_full,
    reference,
    sigma,
    r,
    q,
    g,
    owner,
    nodal,
    touched,
    blocks,
    shift,
    mu,
    symmetric,
    S,
    rhs,
    factor,
    matrices,
):
    """Internal force added to g (N, 6) and the tangent of all elements of a group, condensed to their ends.

    g must already hold everything else, because the condensed right-hand side is -g at the interior nodes.
    nodal (N, 6, 6): tangents of other terms, or empty; touched (E,), blocks (S, 6A, 6A): those of elements, or empty, see
    `add_touched`. mu * shift (N, 6): added on the diagonal.
    S (E, 12, 12), rhs (E, 12), factor (P, n_interior * (n + 1) * LANES): written; or, if matrices (E, 6A, 6A) is not
    empty, only the full element matrices of the internal force, nodes in connectivity order.
    Returns (largest force, largest moment, negative pivots).
    """
    A, Q = conn.shape[1], N.shape[0]
    n, n_interior = 6 * A, 6 * A - 12
    node, S_, M = np.empty(7 * A * LANES), np.empty(11 * LANES), np.empty(KINEMATIC_ROWS * LANES)
    F, D, V = np.empty(FORCE_ROWS * LANES), np.zeros(TANGENT_ROWS * LANES), np.empty(COLUMN_ROWS * LANES)
    strain, T, c = np.empty(6 * LANES), np.empty(6 * LANES), np.empty(4 * A * LANES)
    B, CB = np.empty(24 * LANES), np.empty(48 * LANES)
    K, G, X = np.empty(36 * A * A * LANES), np.empty(6 * A * LANES), np.empty(n * n * LANES)
    b, f, largest = np.empty(n * LANES), np.empty(n * LANES), np.zeros(2 * LANES)
    negative = 0
    for k in range(conn.shape[0]):
        first = k * LANES
        count = min(LANES, n_elements - first)
        gather(conn[k], r, q, node)
        clear(K)
        clear(G)
        for i in range(Q):
            slope = N_s[k, i]
            interpolate(N[i], slope, node, S_)
            kinematics(S_, M)
            strain_minus_reference(M, reference[k, i], strain)
            stress_from_strain(strain, C[k, i], T)
            if C_full is not None:
                couple_stress(strain, C_full[k, i], T)
            raise_to(largest, T)
            generalized_force(M, T, dx[k, i], F)
            tangent_coefficients(M, sigma[k, i], C[k, i], dx[k, i], D)
            if C_full is not None:
                couple_tangent(M, C_full[k, i], dx[k, i], D, B, CB)
            for a in range(A):
                relative_quaternion(M, node[7 * a * LANES :], c, at(4 * a))
                add_node_force(N[i, a], slope, at(a), c, at(4 * a), F, G[6 * a * LANES :])
            # block (a, e): rows of node a, columns of node e; what symmetry gives is not computed
            for e in range(A):
                tangent_column(N[i, e], slope, at(e), c, at(4 * e), D, V)
                for a in range(A):
                    block = K[36 * (a * A + e) * LANES :]
                    add_x_rotation_block(slope, at(a), V, block)
                    if a >= e:
                        add_x_block(slope, at(a), at(e), D, block)
                        add_rotation_block(N[i, a], slope, at(a), c, at(4 * a), V, block)
                add_update_curvature(N[i, e], slope, at(e), c, at(4 * e), D, K[36 * (e * A + e) * LANES :])
        scatter_nodes(conn[k], count, G, g)
        if matrices.shape[0] > 0:
            export_matrices(A, count, first, K, matrices)
            continue
        fill_matrix(A, K, X)
        if nodal.shape[0] > 0:
            add_nodal(conn[k], first, count, owner, nodal, X)
        if blocks.shape[0] > 0:
            add_touched(first, count, touched, blocks, A, X)
        if mu > 0.0:
            add_shift(conn[k], first, count, owner, shift, mu, X)
        fill_rhs(conn[k], g, b)
        negative += condense_pack(count, n_interior, X, b, f, symmetric)
        keep_factor(n_interior, X, b, factor[k])
        export_pack(count, first, n_interior, X, b, S, rhs, symmetric)
    force, moment = largest_of(largest)
    return force, moment, negative


@kernel
def condense_elements(conn, n_elements, matrices, g, owner, nodal, shift, mu, symmetric, S, rhs, factor):
    """As `assemble`, for element matrices (E, 6A, 6A) that were computed elsewhere; g is complete and not changed."""
    A = conn.shape[1]
    n, n_interior = 6 * A, 6 * A - 12
    X, b, f = np.empty(n * n * LANES), np.empty(n * LANES), np.empty(n * LANES)
    negative = 0
    for k in range(conn.shape[0]):
        first = k * LANES
        count = min(LANES, n_elements - first)
        clear(X)
        for i in range(n):
            for lane in range(count, LANES):
                X[(i * n + i) * LANES + lane] = 1.0
        add_extra(first, count, matrices, A, X)
        if nodal.shape[0] > 0:
            add_nodal(conn[k], first, count, owner, nodal, X)
        if mu > 0.0:
            add_shift(conn[k], first, count, owner, shift, mu, X)
        fill_rhs(conn[k], g, b)
        negative += condense_pack(count, n_interior, X, b, f, symmetric)
        keep_factor(n_interior, X, b, factor[k])
        export_pack(count, first, n_interior, X, b, S, rhs, symmetric)
    return negative


@kernel
def back_substitute(conn, n_elements, factor, du):
    """Fill the interior rows of du (N, 6) from its vertex rows, with the rows kept by `condense_pack`."""
    A = conn.shape[1]
    n, n_interior = 6 * A, 6 * A - 12
    u, total = np.empty(n * LANES), np.empty(LANES)
    for k in range(conn.shape[0]):
        F = factor[k]
        for i in range(n_interior * LANES):
            u[i] = 0.0
        for a in range(2):
            for lane in range(LANES):
                for i in range(6):
                    u[(n_interior + 6 * a + i) * LANES + lane] = du[conn[k, a, lane], i]
        for row in range(n_interior - 1, -1, -1):
            copy_lanes(F, at(n_interior * n + row), total, at(0))
            for c in range(row // 6, A):
                subtract_dot_six(F, at(row * n + 6 * c), u, at(6 * c), total)
            for l in range(LANES):
                u[row * LANES + l] = total[l] / F[(row * n + row) * LANES + l]
        for lane in range(min(LANES, n_elements - k * LANES)):
            for a in range(2, A):
                for i in range(6):
                    du[conn[k, a, lane], i] = u[(6 * (a - 2) + i) * LANES + lane]


@inner
def gather_increment(conn, node, du, scale, dnode):
    """Nodal increments (dr, dq) of a pack: dq_a = 1/2 q_a o (0, phi_a), times `scale`."""
    for a in range(conn.shape[0]):
        for lane in range(LANES):
            k = conn[a, lane]
            a0, a1 = node[(7 * a + 3) * LANES + lane], node[(7 * a + 4) * LANES + lane]
            a2, a3 = node[(7 * a + 5) * LANES + lane], node[(7 * a + 6) * LANES + lane]
            h0, h1, h2 = 0.5 * scale * du[k, 3], 0.5 * scale * du[k, 4], 0.5 * scale * du[k, 5]
            for i in range(3):
                dnode[(7 * a + i) * LANES + lane] = scale * du[k, i]
            dnode[(7 * a + 3) * LANES + lane] = -a1 * h0 - a2 * h1 - a3 * h2
            dnode[(7 * a + 4) * LANES + lane] = a0 * h0 + a2 * h2 - a3 * h1
            dnode[(7 * a + 5) * LANES + lane] = a0 * h1 + a3 * h0 - a1 * h2
            dnode[(7 * a + 6) * LANES + lane] = a0 * h2 + a1 * h1 - a2 * h0


@inner
def add_strain_increment(M, dS, strain):
    """strain += B du at one Gauss point: dGamma = R^T dx + Gamma x omega, dK = Y - (rho K + sigma omega + omega x K)/2."""
    for l in range(LANES):
        i2 = 2.0 * M[16 * LANES + l]
        p0, p1, p2, p3 = M[17 * LANES + l], M[18 * LANES + l], M[19 * LANES + l], M[20 * LANES + l]
        x0, x1, x2 = dS[0 * LANES + l], dS[1 * LANES + l], dS[2 * LANES + l]
        a0, a1, a2, a3 = dS[3 * LANES + l], dS[4 * LANES + l], dS[5 * LANES + l], dS[6 * LANES + l]
        d0, d1, d2, d3 = dS[7 * LANES + l], dS[8 * LANES + l], dS[9 * LANES + l], dS[10 * LANES + l]
        G0, G1, G2 = M[9 * LANES + l], M[10 * LANES + l], M[11 * LANES + l]
        K0, K1, K2 = M[12 * LANES + l], M[13 * LANES + l], M[14 * LANES + l]
        s = M[15 * LANES + l]
        rho = i2 * (p0 * a0 + p1 * a1 + p2 * a2 + p3 * a3)
        w0 = i2 * (p0 * a1 - p1 * a0 - (p2 * a3 - p3 * a2))
        w1 = i2 * (p0 * a2 - p2 * a0 - (p3 * a1 - p1 * a3))
        w2 = i2 * (p0 * a3 - p3 * a0 - (p1 * a2 - p2 * a1))
        Y0 = i2 * (p0 * d1 - p1 * d0 - (p2 * d3 - p3 * d2))
        Y1 = i2 * (p0 * d2 - p2 * d0 - (p3 * d1 - p1 * d3))
        Y2 = i2 * (p0 * d3 - p3 * d0 - (p1 * d2 - p2 * d1))
        strain[0 * LANES + l] += (
            M[0 * LANES + l] * x0 + M[3 * LANES + l] * x1 + M[6 * LANES + l] * x2 + G1 * w2 - G2 * w1
        )
        strain[1 * LANES + l] += (
            M[1 * LANES + l] * x0 + M[4 * LANES + l] * x1 + M[7 * LANES + l] * x2 + G2 * w0 - G0 * w2
        )
        strain[2 * LANES + l] += (
            M[2 * LANES + l] * x0 + M[5 * LANES + l] * x1 + M[8 * LANES + l] * x2 + G0 * w1 - G1 * w0
        )
        strain[3 * LANES + l] += Y0 - 0.5 * (rho * K0 + s * w0 + w1 * K2 - w2 * K1)
        strain[4 * LANES + l] += Y1 - 0.5 * (rho * K1 + s * w1 + w2 * K0 - w0 * K2)
        strain[5 * LANES + l] += Y2 - 0.5 * (rho * K2 + s * w2 + w0 * K1 - w1 * K0)


@kernel
def extrapolate_stress(conn, N, N_s, C, C_full, reference, r, q, du, scale, sigma):
    """Stress memory of the mixed-integration-point Newton method: sigma = C (strain + scale B du), before the update."""
    A = conn.shape[1]
    node, dnode = np.empty(7 * A * LANES), np.empty(7 * A * LANES)
    S, dS, M, strain = np.empty(11 * LANES), np.empty(11 * LANES), np.empty(KINEMATIC_ROWS * LANES), np.empty(6 * LANES)
    for k in range(conn.shape[0]):
        gather(conn[k], r, q, node)
        gather_increment(conn[k], node, du, scale, dnode)
        for i in range(N.shape[0]):
            interpolate(N[i], N_s[k, i], node, S)
            interpolate(N[i], N_s[k, i], dnode, dS)
            kinematics(S, M)
            strain_minus_reference(M, reference[k, i], strain)
            add_strain_increment(M, dS, strain)
            stress_from_strain(strain, C[k, i], sigma[k, i])
            if C_full is not None:
                couple_stress(strain, C_full[k, i], sigma[k, i])


@kernel
def strain_and_frame(conn, n_elements, N, N_s, r, q, strain, frame):
    """Total strain (Gamma, K) (T, E, Q, 6) and rotation matrix (T, E, Q, 9) at the Gauss points of states r (T, N, 3), q."""
    A, Q = conn.shape[1], N.shape[0]
    node, S, M = np.empty(7 * A * LANES), np.empty(11 * LANES), np.empty(KINEMATIC_ROWS * LANES)
    for t in range(r.shape[0]):
        for k in range(conn.shape[0]):
            gather(conn[k], r[t], q[t], node)
            for i in range(Q):
                interpolate(N[i], N_s[k, i], node, S)
                kinematics(S, M)
                for lane in range(min(LANES, n_elements - k * LANES)):
                    for j in range(6):
                        strain[t, k * LANES + lane, i, j] = M[(9 + j) * LANES + lane]
                    for j in range(9):
                        frame[t, k * LANES + lane, i, j] = M[j * LANES + lane]
