"""Element, nodes and border of a model that stays in a plane: three unknowns (r1, r2, theta) a node.

The interpolation is the one that quaternion nodes have there. A node that turns by theta about the normal of the plane has
the unit complex number p_a = exp(i theta_a / 2), the part of its quaternion that is not constant; with P = sum N_a p_a,
D = sum N'_a p_a and x = sum N'_a r_a,

    Gamma = (x1 + i x2) exp(-i arg P^2) (stretch, shear),  sigma + i K = 2 D / P,  stress (n1, n2, m) = C (strain - rest).

Variations, with u_a = p_a / P = c0 + i c1 and the increments phi_a of the angles:

    eta = rho + i omega = sum i N_a u_a phi_a,    zeta = zeta0 + i Y = sum i N'_a u_a phi_a,    xi = R^T dx
    dGamma = xi + omega (Gamma2, -Gamma1),        dK = Y - (sigma omega + K rho) / 2

    second variation at fixed (n, m):
    2 omega (n1 xi2 - n2 xi1) - omega^2 n.Gamma - a rho omega
    + m [sigma rho omega + K (rho^2 - omega^2) / 2 - zeta0 omega - Y rho]
    - 1/2 sum phi_a^2 [N_a (c0 F_rho + c1 F_omega) + N'_a c1 m],      a = n1 Gamma2 - n2 Gamma1,

F_rho = -m K / 2 and F_omega = a - m sigma / 2 being the gradient. It is `kernels.beam` with everything out of the plane
left out, and a test holds them equal; layout in lanes, condensation and offsets are those of `kernels.beam` and
`kernels.condense` with blocks of three instead of six.
"""

from __future__ import annotations

from math import atan2

import numpy as np

from . import inner, kernel, merged
from .beam import LANES, U1, U2, U3, U6, at
from .condense import clear, copy_lanes

KINEMATIC_ROWS, COLUMN_ROWS = 9, 6
U4, U5, U7, U8 = (np.uint64(k * LANES) for k in (4, 5, 7, 8))


@inner
def gather(conn, r, q, node):
    """Copy the nodes of a pack: rows 4a, 4a + 1 position, 4a + 2, 4a + 3 complex number.  conn (A, LANES)."""
    for a in range(conn.shape[0]):
        for lane in range(LANES):
            k = conn[a, lane]
            node[(4 * a + 0) * LANES + lane] = r[k, 0]
            node[(4 * a + 1) * LANES + lane] = r[k, 1]
            node[(4 * a + 2) * LANES + lane] = q[k, 0]
            node[(4 * a + 3) * LANES + lane] = q[k, 1]


@merged
def interpolate(N, N_s, node, S):
    """x, P, D at one Gauss point of a pack.  N (A,), N_s flat (A), node flat (4A), S flat (6)."""
    for l in range(6 * LANES):
        S[l] = 0.0
    for a in range(N.shape[0]):
        n, oa, on = N[a], at(a), at(4 * a)
        for l in range(LANES):
            u = np.uint64(l)
            b = N_s[oa + u]
            c, s = node[on + u + U2], node[on + u + U2 + U1]
            S[0 * LANES + l] += b * node[on + u]
            S[1 * LANES + l] += b * node[on + u + U1]
            S[2 * LANES + l] += n * c
            S[3 * LANES + l] += n * s
            S[4 * LANES + l] += b * c
            S[5 * LANES + l] += b * s


@merged
def kinematics(S, M):
    """Rows 0, 1 cosine and sine of the angle, 2, 3 Gamma, 4 K, 5 sigma, 6 1/|P|^2, 7, 8 P."""
    for l in range(LANES):
        x0, x1 = S[0 * LANES + l], S[1 * LANES + l]
        p0, p1, d0, d1 = S[2 * LANES + l], S[3 * LANES + l], S[4 * LANES + l], S[5 * LANES + l]
        i2 = 1.0 / (p0 * p0 + p1 * p1)
        c, s = i2 * (p0 * p0 - p1 * p1), 2.0 * i2 * p0 * p1
        M[0 * LANES + l], M[1 * LANES + l] = c, s
        M[2 * LANES + l], M[3 * LANES + l] = c * x0 + s * x1, c * x1 - s * x0
        M[4 * LANES + l] = 2.0 * i2 * (p0 * d1 - p1 * d0)
        M[5 * LANES + l] = 2.0 * i2 * (p0 * d0 + p1 * d1)
        M[6 * LANES + l], M[7 * LANES + l], M[8 * LANES + l] = i2, p0, p1


@merged
def stress_of(M, C, reference, T):
    """T = C (strain - reference); C six rows, the upper triangle for stretch, shear, bend."""
    for l in range(LANES):
        e0 = M[2 * LANES + l] - reference[0 * LANES + l]
        e1 = M[3 * LANES + l] - reference[1 * LANES + l]
        e2 = M[4 * LANES + l] - reference[2 * LANES + l]
        c01, c02, c12 = C[1 * LANES + l], C[2 * LANES + l], C[4 * LANES + l]
        T[0 * LANES + l] = C[0 * LANES + l] * e0 + c01 * e1 + c02 * e2
        T[1 * LANES + l] = c01 * e0 + C[3 * LANES + l] * e1 + c12 * e2
        T[2 * LANES + l] = c02 * e0 + c12 * e1 + C[5 * LANES + l] * e2


@inner
def raise_to(largest, T):
    """Keep the largest squared force and moment seen: largest two rows, T three rows."""
    for l in range(LANES):
        n2 = T[l] * T[l] + T[LANES + l] * T[LANES + l]
        largest[l] = max(largest[l], n2)
        largest[LANES + l] = max(largest[LANES + l], T[2 * LANES + l] * T[2 * LANES + l])


@inner
def largest_of(largest):
    n2 = m2 = 0.0
    for l in range(LANES):
        n2, m2 = max(n2, largest[l]), max(m2, largest[LANES + l])
    return np.sqrt(n2), np.sqrt(m2)


@merged
def generalized_force(M, T, dx, F):
    """Gradient of n.Gamma + m K times dx: rows 0, 1 for x, 2 rho, 3 omega, 4 Y."""
    for l in range(LANES):
        w = dx[l]
        n0, n1, m = w * T[0 * LANES + l], w * T[1 * LANES + l], w * T[2 * LANES + l]
        c, s = M[0 * LANES + l], M[1 * LANES + l]
        F[0 * LANES + l], F[1 * LANES + l] = c * n0 - s * n1, s * n0 + c * n1
        F[2 * LANES + l] = -0.5 * m * M[4 * LANES + l]
        F[3 * LANES + l] = n0 * M[3 * LANES + l] - n1 * M[2 * LANES + l] - 0.5 * m * M[5 * LANES + l]
        F[4 * LANES + l] = m


@merged
def relative_number(M, node, on, c, oc):
    """c = p_a / P, two rows of c from offset oc; node from offset on."""
    for l in range(LANES):
        u = np.uint64(l)
        i2, p0, p1 = M[6 * LANES + l], M[7 * LANES + l], M[8 * LANES + l]
        a0, a1 = node[on + u + U2], node[on + u + U2 + U1]
        c[oc + u] = i2 * (p0 * a0 + p1 * a1)
        c[oc + u + U1] = i2 * (p0 * a1 - p1 * a0)


@merged
def add_node_force(N, N_s, oa, c, oc, F, G, og):
    """Add one Gauss point's force and moment at one node: G three rows from offset og."""
    for l in range(LANES):
        u = np.uint64(l)
        b, c0, c1 = N_s[oa + u], c[oc + u], c[oc + u + U1]
        G[og + u] += b * F[0 * LANES + l]
        G[og + u + U1] += b * F[1 * LANES + l]
        h = c0 * (N * F[3 * LANES + l] + b * F[4 * LANES + l]) - c1 * N * F[2 * LANES + l]
        G[og + u + U2] += h


@merged
def x_stiffness(M, C, dx, D):
    """R C_n R^T dx, three rows (upper triangle)."""
    for l in range(LANES):
        c, s, w = M[0 * LANES + l], M[1 * LANES + l], dx[l]
        c0, c1, c3 = C[0 * LANES + l], C[1 * LANES + l], C[3 * LANES + l]
        a0, a1 = c * c0 - s * c1, c * c1 - s * c3
        b0, b1 = s * c0 + c * c1, s * c1 + c * c3
        D[0 * LANES + l] = w * (c * a0 - s * a1)
        D[1 * LANES + l] = w * (s * a0 + c * a1)
        D[2 * LANES + l] = w * (s * b0 + c * b1)


@merged
def tangent_column(N, N_s, oa, c, oc, M, sigma, C, dx, V):
    """What one node's rotation does at a Gauss point: the change of the gradient for x (rows 0, 1, in space), rho, omega,
    zeta0, Y (rows 2 to 5), material (C) and geometric (stress memory sigma)."""
    for l in range(LANES):
        u = np.uint64(l)
        w, b, c0, c1 = dx[l], N_s[oa + u], c[oc + u], c[oc + u + U1]
        rho, omega, zeta, Y = -N * c1, N * c0, -b * c1, b * c0
        G0, G1, K, s = M[2 * LANES + l], M[3 * LANES + l], M[4 * LANES + l], M[5 * LANES + l]
        n0, n1, m = w * sigma[0 * LANES + l], w * sigma[1 * LANES + l], w * sigma[2 * LANES + l]
        e0, e1, e2 = w * G1 * omega, -w * G0 * omega, w * (Y - 0.5 * (s * omega + K * rho))
        c01, c02, c12 = C[1 * LANES + l], C[2 * LANES + l], C[4 * LANES + l]
        t0 = C[0 * LANES + l] * e0 + c01 * e1 + c02 * e2
        t1 = c01 * e0 + C[3 * LANES + l] * e1 + c12 * e2
        t2 = c02 * e0 + c12 * e1 + C[5 * LANES + l] * e2
        x0, x1 = t0 - n1 * omega, t1 + n0 * omega
        cosine, sine = M[0 * LANES + l], M[1 * LANES + l]
        a = n0 * G1 - n1 * G0
        V[0 * LANES + l], V[1 * LANES + l] = cosine * x0 - sine * x1, sine * x0 + cosine * x1
        V[2 * LANES + l] = 0.5 * (m * (s * omega + K * rho - Y) - a * omega - K * t2)
        V[3 * LANES + l] = (
            G1 * t0
            - G0 * t1
            - (n0 * G0 + n1 * G1) * omega
            + 0.5 * (m * (s * rho - K * omega - zeta) - a * rho - s * t2)
        )
        V[4 * LANES + l] = -0.5 * m * omega
        V[5 * LANES + l] = t2 - 0.5 * m * rho


@merged
def add_upper(N, N_s, oa, oe, c, oc, V, D, X, x):
    """Add one block on or above the diagonal, but for its row of the moment under displacements.

    N, oa, oc: node of the rows; oe: of the columns; x: offset of the block.
    """
    for l in range(LANES):
        u = np.uint64(l)
        b, c0, c1 = N_s[oa + u], c[oc + u], c[oc + u + U1]
        w = b * N_s[oe + u]
        d1 = w * D[1 * LANES + l]
        X[x + u] += w * D[0 * LANES + l]
        X[x + u + U1] += d1
        X[x + u + U2] += b * V[0 * LANES + l]
        X[x + u + U3] += d1
        X[x + u + U4] += w * D[2 * LANES + l]
        X[x + u + U5] += b * V[1 * LANES + l]
        turned = N * (c0 * V[3 * LANES + l] - c1 * V[2 * LANES + l])
        X[x + u + U8] += turned + b * (c0 * V[5 * LANES + l] - c1 * V[4 * LANES + l])


@merged
def add_turned(N_s, oa, V, X, x):
    """Add the moment of a node under the displacement of another one, the last row of the block at x: what symmetry gives
    of the force under the turn."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        X[x + u + U6] += b * V[0 * LANES + l]
        X[x + u + U7] += b * V[1 * LANES + l]


@merged
def add_update_curvature(N, N_s, oa, c, oc, M, sigma, dx, X, x):
    """Subtract the second order of p exp(i phi / 2) under the gradient of the stress memory, in the block at x."""
    for l in range(LANES):
        u = np.uint64(l)
        w, b, c0, c1 = dx[l], N_s[oa + u], c[oc + u], c[oc + u + U1]
        n0, n1, m = w * sigma[0 * LANES + l], w * sigma[1 * LANES + l], w * sigma[2 * LANES + l]
        rho = -0.5 * m * M[4 * LANES + l]
        omega = n0 * M[3 * LANES + l] - n1 * M[2 * LANES + l] - 0.5 * m * M[5 * LANES + l]
        X[x + u + U8] -= 0.5 * (N * (c0 * rho + c1 * omega) + b * c1 * m)


@inner
def place_of(a, A):
    """Row of a node among the blocks of a pack's matrix: interior nodes first, then the two vertices."""
    return a - 2 if a >= 2 else a + A - 2


@inner
def entry(i, j, A):
    """Where entry (i, j) of a pack's matrix stands: 3 x 3 blocks, row by row, the nine entries of each together."""
    return 9 * ((i // 3) * A + j // 3) + 3 * (i % 3) + j % 3


@inner
def mirror(A, X):
    """Fill what stands below the diagonal."""
    for i in range(3 * A):
        for j in range(i):
            copy_lanes(X, at(entry(j, i, A)), X, at(entry(i, j, A)))


@inner
def add_nodal(conn, first, count, owner, nodal, shift, mu, X):
    """Add nodal matrices (N, 3, 3), or none, and mu * shift (N, 3) on the diagonal, each node once."""
    A = conn.shape[0]
    for a in range(A):
        x = 9 * place_of(a, A) * (A + 1)
        for lane in range(count):
            k = conn[a, lane]
            if owner[k] != first + lane:
                continue
            if nodal.shape[0] > 0:
                for i in range(3):
                    for j in range(3):
                        X[(x + 3 * i + j) * LANES + lane] += nodal[k, i, j]
            if mu > 0.0:
                for i in range(3):
                    X[(x + 4 * i) * LANES + lane] += mu * shift[k, i]


@inner
def fill_rhs(conn, g, b):
    """Right-hand side -g at the interior nodes; the vertices' share is summed over elements elsewhere."""
    A = conn.shape[0]
    for a in range(A):
        row = 3 * place_of(a, A)
        for lane in range(LANES):
            k = conn[a, lane]
            for i in range(3):
                b[(row + i) * LANES + lane] = -g[k, i] if a >= 2 else 0.0


@merged
def subtract_three(f, source, so, target, to):
    """target -= f source for three columns, one factor per lane."""
    for l in range(U1):
        g = f[l]
        target[to + l] -= g * source[so + l]
        target[to + l + U1] -= g * source[so + l + U1]
        target[to + l + U2] -= g * source[so + l + U2]


@merged
def subtract_block(f, source, so, target, to):
    """target -= f source for 3 x 3 blocks; f nine rows."""
    for l in range(U1):
        s0, s1, s2 = source[so + l], source[so + l + U1], source[so + l + U2]
        s3, s4, s5 = source[so + l + U3], source[so + l + U4], source[so + l + U5]
        s6, s7, s8 = source[so + l + U6], source[so + l + U7], source[so + l + U8]
        f0, f1, f2 = f[l], f[l + U1], f[l + U2]
        target[to + l] -= f0 * s0 + f1 * s3 + f2 * s6
        target[to + l + U1] -= f0 * s1 + f1 * s4 + f2 * s7
        target[to + l + U2] -= f0 * s2 + f1 * s5 + f2 * s8
        f0, f1, f2 = f[l + U3], f[l + U4], f[l + U5]
        target[to + l + U3] -= f0 * s0 + f1 * s3 + f2 * s6
        target[to + l + U4] -= f0 * s1 + f1 * s4 + f2 * s7
        target[to + l + U5] -= f0 * s2 + f1 * s5 + f2 * s8
        f0, f1, f2 = f[l + U6], f[l + U7], f[l + U8]
        target[to + l + U6] -= f0 * s0 + f1 * s3 + f2 * s6
        target[to + l + U7] -= f0 * s1 + f1 * s4 + f2 * s7
        target[to + l + U8] -= f0 * s2 + f1 * s5 + f2 * s8


@merged
def subtract_columns(f, source, so, target, to):
    """target -= f source for a column of three; f nine rows."""
    for l in range(U1):
        s0, s1, s2 = source[so + l], source[so + l + U1], source[so + l + U2]
        target[to + l] -= f[l] * s0 + f[l + U1] * s1 + f[l + U2] * s2
        target[to + l + U1] -= f[l + U3] * s0 + f[l + U4] * s1 + f[l + U5] * s2
        target[to + l + U2] -= f[l + U6] * s0 + f[l + U7] * s1 + f[l + U8] * s2


@merged
def factors(X, x, inverse, f):
    """f = a block of pivot rows, transposed, times the inverse pivots: what a symmetric matrix has below the diagonal."""
    for l in range(U1):
        i0, i1, i2 = inverse[l], inverse[l + U1], inverse[l + U2]
        f[l], f[l + U1], f[l + U2] = i0 * X[x + l], i1 * X[x + l + U3], i2 * X[x + l + U6]
        f[l + U3], f[l + U4], f[l + U5] = i0 * X[x + l + U1], i1 * X[x + l + U4], i2 * X[x + l + U7]
        f[l + U6], f[l + U7], f[l + U8] = i0 * X[x + l + U2], i1 * X[x + l + U5], i2 * X[x + l + U8]


@inner
def lower_factors(X, x, pivots, d, inverse, f):
    """As `factors`, of the block at x of a matrix that is not symmetric; the eliminated diagonal block stands at d."""
    for i in range(3):
        o, t = x + at(3 * i), at(3 * i)
        for l in range(U1):
            f0 = inverse[l] * X[o + l]
            f1 = inverse[l + U1] * (X[o + l + U1] - f0 * pivots[d + l + U1])
            f[t + l], f[t + l + U1] = f0, f1
            f[t + l + U2] = inverse[l + U2] * (X[o + l + U2] - f0 * pivots[d + l + U2] - f1 * pivots[d + l + U5])


@inner
def condense_pack(count, n_interior, X, b, f, factor, symmetric):
    """As `condense.condense_pack`, three unknowns at a time. f: scratch (9). The eliminated rows of X, then those of b, go
    to `factor`, from where later rows are reduced. Returns the number of negative pivots."""
    A = n_interior // 3 + 2
    inverse, last = np.empty(3 * LANES), 3 * n_interior * A
    negative = 0
    for k in range(A - 2):
        d = at(9 * k * (A + 1))
        for m in range(3):
            pivot, io, bm = d + at(4 * m), at(m), at(3 * k + m)
            for lane in range(count):
                if X[pivot + np.uint64(lane)] < 0.0:
                    negative += 1
            for l in range(U1):
                inverse[io + l] = 1.0 / X[pivot + l]
            for i in range(m + 1, 3):
                source, bi = d + at(3 * m + i if symmetric else 3 * i + m), at(3 * k + i)
                for l in range(U1):
                    f[l] = inverse[io + l] * X[source + l]
                for c in range(k, A):
                    x = 9 * (k * A + c)
                    subtract_three(f, X, at(x + 3 * m), X, at(x + 3 * i))
                for l in range(U1):
                    b[bi + l] -= f[l] * b[bm + l]
        for o in range(9 * k * (A + 1) * LANES, 9 * (k + 1) * A * LANES):
            factor[o] = X[o]
        for o in range(3 * LANES):
            factor[last * LANES + 3 * k * LANES + o] = b[3 * k * LANES + o]
        for i in range(k + 1, A):
            if symmetric:
                factors(factor, at(9 * (k * A + i)), inverse, f)
            else:
                lower_factors(X, at(9 * (i * A + k)), factor, d, inverse, f)
            for c in range(i if symmetric else k + 1, A):
                subtract_block(f, factor, at(9 * (k * A + c)), X, at(9 * (i * A + c)))
            subtract_columns(f, factor, at(last + 3 * k), b, at(3 * i))
    return negative


@inner
def export_pack(count, first, n_interior, X, b, S, rhs, symmetric):
    """Copy the condensed matrices and right-hand sides of a pack to S (E, 6, 6) and rhs (E, 6)."""
    A = n_interior // 3 + 2
    for i in range(6):
        for j in range(i if symmetric else 0, 6):
            row = X[entry(n_interior + i, n_interior + j, A) * LANES :]
            for lane in range(count):
                S[first + lane, i, j] = row[lane]
                if symmetric:
                    S[first + lane, j, i] = row[lane]
        row = b[(n_interior + i) * LANES :]
        for lane in range(count):
            rhs[first + lane, i] = row[lane]


@inner
def scatter_nodes(conn, count, G, g):
    """Add a pack's nodal rows G (3A) to g (N, 3); lanes from `count` on are padding."""
    for lane in range(count):
        for a in range(conn.shape[0]):
            k = conn[a, lane]
            for i in range(3):
                g[k, i] += G[(3 * a + i) * LANES + lane]


@kernel
def residual(conn, n_elements, N, N_s, dx, C, reference, r, q, g):
    """Add the internal force of all elements to g (N, 3).

    conn (P, A, LANES), N (Q, A), N_s (P, Q, A * LANES), dx (P, Q, LANES), C (P, Q, 6 * LANES), reference
    (P, Q, 3 * LANES), r and q (N, 2).  Returns the largest section force [N] and moment [N m].
    """
    A, Q = conn.shape[1], N.shape[0]
    node, S = np.empty(4 * A * LANES), np.empty(6 * LANES)
    M, F, T = np.empty(KINEMATIC_ROWS * LANES), np.empty(5 * LANES), np.empty(3 * LANES)
    c, G, largest = np.empty(2 * LANES), np.empty(3 * A * LANES), np.zeros(2 * LANES)
    for k in range(conn.shape[0]):
        gather(conn[k], r, q, node)
        clear(G)
        for i in range(Q):
            slope = N_s[k, i]
            interpolate(N[i], slope, node, S)
            kinematics(S, M)
            stress_of(M, C[k, i], reference[k, i], T)
            raise_to(largest, T)
            generalized_force(M, T, dx[k, i], F)
            for a in range(A):
                relative_number(M, node, at(4 * a), c, at(0))
                add_node_force(N[i, a], slope, at(a), c, at(0), F, G, at(3 * a))
        scatter_nodes(conn[k], min(LANES, n_elements - k * LANES), G, g)
    return largest_of(largest)


@kernel
def assemble(
    conn,
    n_elements,
    N,
    N_s,
    dx,
    C,
    reference,
    sigma,
    r,
    q,
    g,
    owner,
    nodal,
    shift,
    mu,
    symmetric,
    S,
    rhs,
    factor,
    matrices,
):
    """As `condense.assemble`, in a plane: g (N, 3), nodal (N, 3, 3) or empty, sigma (P, Q, 3 * LANES).

    S (E, 6, 6), rhs (E, 6), factor (P, n_interior * (n + 1) * LANES): written; or, if matrices (E, 3A, 3A) is not empty,
    only the element matrices, interior nodes first.  Returns (largest force, largest moment, negative pivots).
    """
    A, Q = conn.shape[1], N.shape[0]
    n, n_interior = 3 * A, 3 * A - 6
    node, S_, M = np.empty(4 * A * LANES), np.empty(6 * LANES), np.empty(KINEMATIC_ROWS * LANES)
    T, F, D, V = np.empty(3 * LANES), np.empty(5 * LANES), np.empty(3 * LANES), np.empty(COLUMN_ROWS * LANES)
    c, G, X = np.empty(2 * A * LANES), np.empty(3 * A * LANES), np.empty(n * n * LANES)
    b, f, largest = np.empty(n * LANES), np.empty(9 * LANES), np.zeros(2 * LANES)
    negative = 0
    for k in range(conn.shape[0]):
        first = k * LANES
        count = min(LANES, n_elements - first)
        gather(conn[k], r, q, node)
        clear(X)
        clear(G)
        for i in range(Q):
            slope, weight, stiffness, memory = N_s[k, i], dx[k, i], C[k, i], sigma[k, i]
            interpolate(N[i], slope, node, S_)
            kinematics(S_, M)
            stress_of(M, stiffness, reference[k, i], T)
            raise_to(largest, T)
            generalized_force(M, T, weight, F)
            x_stiffness(M, stiffness, weight, D)
            for a in range(A):
                relative_number(M, node, at(4 * a), c, at(2 * a))
                add_node_force(N[i, a], slope, at(a), c, at(2 * a), F, G, at(3 * a))
            for e in range(A):
                column, oe = place_of(e, A), at(e)
                tangent_column(N[i, e], slope, oe, c, at(2 * e), M, memory, stiffness, weight, V)
                for a in range(A):
                    row = place_of(a, A)
                    if row <= column:
                        x = at(9 * (row * A + column))
                        add_upper(N[i, a], slope, at(a), oe, c, at(2 * a), V, D, X, x)
                    if row >= column:  # also in a block on the diagonal
                        add_turned(slope, at(a), V, X, at(9 * (column * A + row)))
                x = at(9 * column * (A + 1))
                add_update_curvature(N[i, e], slope, oe, c, at(2 * e), M, memory, weight, X, x)
        if matrices.shape[0] > 0 or not symmetric:
            mirror(A, X)
        scatter_nodes(conn[k], count, G, g)
        if matrices.shape[0] > 0:
            for i in range(n):
                for j in range(n):
                    for lane in range(count):
                        matrices[first + lane, i, j] = X[entry(i, j, A) * LANES + lane]
            continue
        if nodal.shape[0] > 0 or mu > 0.0:
            add_nodal(conn[k], first, count, owner, nodal, shift, mu, X)
        fill_rhs(conn[k], g, b)
        negative += condense_pack(count, n_interior, X, b, f, factor[k], symmetric)
        export_pack(count, first, n_interior, X, b, S, rhs, symmetric)
    force, moment = largest_of(largest)
    return force, moment, negative


@inner
def subtract_columns_of(F, x, u, uo, to):
    """u[to] -= F u[uo] for a 3 x 3 block at x and columns of three."""
    for l in range(U1):
        u0, u1, u2 = u[uo + l], u[uo + l + U1], u[uo + l + U2]
        u[to + l] -= F[x + l] * u0 + F[x + l + U1] * u1 + F[x + l + U2] * u2
        u[to + l + U1] -= F[x + l + U3] * u0 + F[x + l + U4] * u1 + F[x + l + U5] * u2
        u[to + l + U2] -= F[x + l + U6] * u0 + F[x + l + U7] * u1 + F[x + l + U8] * u2


@inner
def solve_upper(F, x, u, to):
    """u[to] = the upper triangle of the 3 x 3 block at x, solved for u[to]."""
    for l in range(U1):
        u2 = u[to + l + U2] / F[x + l + U8]
        u1 = (u[to + l + U1] - F[x + l + U5] * u2) / F[x + l + U4]
        u[to + l + U2], u[to + l + U1] = u2, u1
        u[to + l] = (u[to + l] - F[x + l + U1] * u1 - F[x + l + U2] * u2) / F[x + l]


@kernel
def back_substitute(conn, n_elements, factor, du):
    """Fill the interior rows of du (N, 3) from its vertex rows, with the rows kept by `assemble`."""
    A = conn.shape[1]
    n_interior = 3 * A - 6
    last = 3 * n_interior * A
    u = np.empty(3 * A * LANES)
    for k in range(conn.shape[0]):
        F = factor[k]
        for a in range(2):
            for lane in range(LANES):
                for i in range(3):
                    u[(n_interior + 3 * a + i) * LANES + lane] = du[conn[k, a, lane], i]
        for m in range(A - 3, -1, -1):
            for o in range(3 * LANES):
                u[3 * m * LANES + o] = F[(last + 3 * m) * LANES + o]
            for c in range(m + 1, A):
                subtract_columns_of(F, at(9 * (m * A + c)), u, at(3 * c), at(3 * m))
            solve_upper(F, at(9 * m * (A + 1)), u, at(3 * m))
        for lane in range(min(LANES, n_elements - k * LANES)):
            for a in range(2, A):
                for i in range(3):
                    du[conn[k, a, lane], i] = u[(3 * (a - 2) + i) * LANES + lane]


@inner
def add_strain_increment(M, dS, moved):
    """Strains after an increment, in the rows of M that hold them: moved = M + B du; dS: x, P, D of the increment."""
    for l in range(LANES):
        c, s = M[0 * LANES + l], M[1 * LANES + l]
        G0, G1, K, sigma = M[2 * LANES + l], M[3 * LANES + l], M[4 * LANES + l], M[5 * LANES + l]
        f, p0, p1 = 2.0 * M[6 * LANES + l], M[7 * LANES + l], M[8 * LANES + l]
        x0, x1 = dS[0 * LANES + l], dS[1 * LANES + l]
        a0, a1, d0, d1 = dS[2 * LANES + l], dS[3 * LANES + l], dS[4 * LANES + l], dS[5 * LANES + l]
        rho, omega = f * (p0 * a0 + p1 * a1), f * (p0 * a1 - p1 * a0)
        Y = f * (p0 * d1 - p1 * d0)
        moved[2 * LANES + l] = G0 + c * x0 + s * x1 + G1 * omega
        moved[3 * LANES + l] = G1 + c * x1 - s * x0 - G0 * omega
        moved[4 * LANES + l] = K + Y - 0.5 * (sigma * omega + K * rho)


@kernel
def extrapolate_stress(conn, N, N_s, C, reference, r, q, du, sigma):
    """Stress memory sigma = C (strain + B du) for an increment du (N, 3), before the update."""
    A = conn.shape[1]
    node, dnode = np.empty(4 * A * LANES), np.empty(4 * A * LANES)
    S, dS = np.empty(6 * LANES), np.empty(6 * LANES)
    M, moved = np.empty(KINEMATIC_ROWS * LANES), np.empty(5 * LANES)
    for k in range(conn.shape[0]):
        gather(conn[k], r, q, node)
        for a in range(A):
            for lane in range(LANES):
                j = conn[k, a, lane]
                half = 0.5 * du[j, 2]
                dnode[(4 * a + 0) * LANES + lane] = du[j, 0]
                dnode[(4 * a + 1) * LANES + lane] = du[j, 1]
                dnode[(4 * a + 2) * LANES + lane] = -half * node[(4 * a + 3) * LANES + lane]
                dnode[(4 * a + 3) * LANES + lane] = half * node[(4 * a + 2) * LANES + lane]
        for i in range(N.shape[0]):
            interpolate(N[i], N_s[k, i], node, S)
            interpolate(N[i], N_s[k, i], dnode, dS)
            kinematics(S, M)
            add_strain_increment(M, dS, moved)
            stress_of(moved, C[k, i], reference[k, i], sigma[k, i])


# nodes


@inner
def turn(q, du):
    """q (N, 2) <- q exp(i du / 2) with the angles in the last column of du (N, 3); unit again."""
    for k in range(q.shape[0]):
        half = 0.5 * du[k, 2]
        c, s = np.cos(half), np.sin(half)
        a, b = q[k, 0] * c - q[k, 1] * s, q[k, 0] * s + q[k, 1] * c
        f = 1.0 / np.sqrt(a * a + b * b)
        q[k, 0], q[k, 1] = f * a, f * b


@inner
def angle_between(q0, q):
    """Angle in (-pi, pi] from one complex number (2,) to another."""
    c, s = q0[0] * q[0] + q0[1] * q[1], q0[0] * q[1] - q0[1] * q[0]
    return 2.0 * atan2(-s, -c) if c < 0.0 else 2.0 * atan2(s, c)


@inner
def fill_gap(nodes, place, attitude, r, q, gap):
    """What is missing (M, 3) at supported nodes to their place and attitude (n, 2)."""
    for m in range(place.shape[0]):
        k = nodes[m]
        gap[m, 0], gap[m, 1] = place[m, 0] - r[k, 0], place[m, 1] - r[k, 1]
        gap[m, 2] = angle_between(q[k], attitude[m])


@inner
def add_loads(nodes, q, force, moment, kinds, each, g, nodal):
    """As `loads.add_loads`: force (L, 2), moment (L, 1) at nodes (L,); following forces have components along the section's
    tangent and normal. each (L, 3): written."""
    for m in range(nodes.shape[0]):
        k = nodes[m]
        F0, F1 = force[m, 0], force[m, 1]
        if kinds[m, 0] or kinds[m, 2]:
            c, s = q[k, 0] * q[k, 0] - q[k, 1] * q[k, 1], 2.0 * q[k, 0] * q[k, 1]
            if kinds[m, 0]:
                F0, F1 = c * F0 - s * F1, s * F0 + c * F1
                d0, d1 = -F1, F0
            else:
                along, change = F0 * c + F1 * s, F1 * c - F0 * s
                F0, F1 = F0 - along * c, F1 - along * s
                d0, d1 = along * s - change * c, -along * c - change * s
            if nodal.shape[0] > 0:
                nodal[k, 0, 2] -= d0
                nodal[k, 1, 2] -= d1
        each[m, 0], each[m, 1], each[m, 2] = -F0, -F1, -moment[m, 0]
        for i in range(3):
            g[k, i] += each[m, i]


@inner
def step_rates(moved, q0, q, v0, a0, b0, coefficients, driven, v_driven, a_driven, D, v, a, b):
    """As `inertia.step_rates`, (N, 3); driven rates (M, 3), not a number where they are not given."""
    h, am, af, beta, gamma = coefficients
    per_square, old, part = 1.0 / (beta * h * h), h * h * (0.5 - beta), 1.0 / (1.0 - af)
    for k in range(q.shape[0]):
        D[k, 0], D[k, 1], D[k, 2] = moved[k, 0], moved[k, 1], angle_between(q0[k], q[k])
        for i in range(3):
            b[k, i] = per_square * (D[k, i] - h * v0[k, i] - old * b0[k, i])
            v[k, i] = v0[k, i] + h * ((1.0 - gamma) * b0[k, i] + gamma * b[k, i])
            a[k, i] = part * ((1.0 - am) * b[k, i] + am * b0[k, i] - af * a0[k, i])
    for m in range(driven.shape[0]):
        k = driven[m]
        for i in range(3):
            if not np.isnan(v_driven[m, i]):
                v[k, i] = v_driven[m, i]
                a[k, i] = b[k, i] = a_driven[m, i]


@inner
def step_inertia(mass, J, a, coefficients, g, nodal):
    """Add the inertia force for accelerations a (N, 3) to g and its tangent to nodal, if that is not empty; J (N, 1).

    Returns the largest inertia force and moment at a node.
    """
    h, am, af, beta, _ = coefficients
    grows = (1.0 - am) / ((1.0 - af) * beta * h * h)
    force = moment = 0.0
    for k in range(mass.shape[0]):
        m = mass[k]
        g[k, 0] += m * a[k, 0]
        g[k, 1] += m * a[k, 1]
        g[k, 2] += J[k, 0] * a[k, 2]
        force = max(force, abs(m * a[k, 0]), abs(m * a[k, 1]))
        moment = max(moment, abs(J[k, 0] * a[k, 2]))
        if nodal.shape[0] > 0:
            nodal[k, 0, 0] += grows * m
            nodal[k, 1, 1] += grows * m
            nodal[k, 2, 2] += grows * J[k, 0]
    return force, moment


# border


@kernel
def enter(axes, base, node, across, normal, r, q, stress, flat, p, sigma):
    """Write place (N, 2), complex number (N, 2) and stress memory (P, Q, 3 * LANES) of a state in space.

    axes: numbers of the two axes of the plane and of its normal; base (N, 4): constant part of the quaternions; node
    (P, LANES): a node of each element; across, normal (N, 3): directions in its section's axes.
    """
    i, j, k = axes
    for m in range(q.shape[0]):
        flat[m, 0], flat[m, 1] = r[m, i], r[m, j]
        a, b = q[m], base[m]
        c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        s = a[1 + k] * b[0] - a[0] * b[1 + k] - a[1 + i] * b[1 + j] + a[1 + j] * b[1 + i]
        f = 1.0 / np.sqrt(c * c + s * s)
        p[m, 0], p[m, 1] = f * c, f * s
    for m in range(sigma.shape[0]):
        for o in range(sigma.shape[1]):
            T, out = stress[m, o], sigma[m, o]
            for l in range(LANES):
                a, n = across[node[m, l]], normal[node[m, l]]
                out[l] = T[2 * LANES + l]
                out[LANES + l] = T[l] * a[0] + T[LANES + l] * a[1]
                out[2 * LANES + l] = T[3 * LANES + l] * n[0] + T[4 * LANES + l] * n[1]


@inner
def leave(axes, base, node, across, normal, flat, p, sigma, r, q, stress):
    """The inverse of `enter`; the component of r along the normal stands already."""
    i, j, k = axes
    for m in range(q.shape[0]):
        r[m, i], r[m, j] = flat[m, 0], flat[m, 1]
        c, s, b = p[m, 0], p[m, 1], base[m]
        q[m, 0] = c * b[0] - s * b[1 + k]
        q[m, 1 + k] = c * b[1 + k] + s * b[0]
        q[m, 1 + i] = c * b[1 + i] - s * b[1 + j]
        q[m, 1 + j] = c * b[1 + j] + s * b[1 + i]
    for m in range(sigma.shape[0]):
        for o in range(sigma.shape[1]):
            T, out = sigma[m, o], stress[m, o]
            for l in range(LANES):
                a, n = across[node[m, l]], normal[node[m, l]]
                out[l], out[LANES + l], out[2 * LANES + l] = T[LANES + l] * a[0], T[LANES + l] * a[1], T[l]
                bend = T[2 * LANES + l]
                out[3 * LANES + l], out[4 * LANES + l], out[5 * LANES + l] = bend * n[0], bend * n[1], 0.0


@kernel
def leave_all(axes, base, node, across, normal, flat, p, sigma, r, q, stress):
    """As `leave`, of several states: a leading axis."""
    for t in range(q.shape[0]):
        leave(axes, base, node, across, normal, flat[t], p[t], sigma[t], r[t], q[t], stress[t])
