"""Strains, force and tangent of the quaternion element, sixteen elements at a time.

Interpolation: positions r_a and unit quaternions q_a with the same Lagrange basis; the interpolated quaternion is not
unit and is divided out where it is used. At a Gauss point, with x = sum N'_a r_a, p = sum N_a q_a, d = sum N'_a q_a:

    Gamma = R(p)^T x,      (sigma, K) = 2 conj(p) o d / |p|^2,      stress (n, m) = C ((Gamma, K) - reference).

Variations are written in the frame of p. With eta = (rho, omega) = 2 conj(p) o dp / |p|^2, zeta = 2 conj(p) o dd / |p|^2
= (zeta0, Y), xi = R^T dx:

    dGamma = xi + Gamma x omega
    dK     = Y - (rho K + sigma omega + omega x K) / 2

    second variation at fixed (n, m):
    1/2 [rho^2 m.K + 2 rho omega.(sigma m - n x Gamma - m x K) + 2 (omega.Gamma)(omega.n) - omega^2 (2 n.Gamma + m.K)]
    - 2 xi.(n x omega) - rho m.Y - zeta0 m.omega + omega.(m x Y)

A node turns by q_a <- q_a o exp(phi_a / 2). With c_a = conj(p) o q_a / |p|^2 this is eta = N_a A_a phi_a, zeta = N'_a A_a
phi_a with the (4, 3) matrix A_a = [-c_v^T ; c_0 I + [c_v]x]; the curvature of the update adds -1/4 (q_a . dU/dq_a) I.
Without it the matrix would not be the Hessian of the energy.

Layout: quantity k of lane l stands at [k * LANES + l] of a flat array, so every loop over lanes has stride one, a
constant length and constant offsets, which is what the compiler needs to use vector instructions (measured: 2.5 to 3
times faster than one element at a time). Slices are taken per pack and per node, never per lane.

Source: quaternion interpolation normalised in the strains: Romero (2004), doi 10.1007/s00466-004-0559-z; the stress
memory `sigma` that enters only the geometric part: Magisano, Leonetti, Garcea (2017), doi 10.1002/nme.5319.
"""

from __future__ import annotations

import numpy as np

from . import inner

LANES = 16

# Offsets of rows. Where a slice would be taken for each node, arrays are passed whole with an unsigned offset: a
# slice costs about 20 ns, and a signed offset could count from the end, which would keep the loop from being vectorised.
U1, U2, U3, U6, U9 = (np.uint64(k * LANES) for k in (1, 2, 3, 6, 9))
U12, U15, U18, U21 = (np.uint64(k * LANES) for k in (12, 15, 18, 21))
U44, U45, U46, U47 = (np.uint64(k * LANES) for k in (44, 45, 46, 47))

# Rows of the scratch arrays (see each function): kinematics, forces, tangent coefficients, tangent columns.
KINEMATIC_ROWS, FORCE_ROWS, TANGENT_ROWS, COLUMN_ROWS = 21, 10, 101, 33


@inner
def at(row):
    """Offset of a row of lanes."""
    return np.uint64(row * LANES)


@inner
def gather(conn, r, q, node):
    """Copy the nodes of a pack: rows 7a..7a+2 position, 7a+3..7a+6 quaternion.  conn (A, LANES), node flat (7A)."""
    for a in range(conn.shape[0]):
        for lane in range(LANES):
            k = conn[a, lane]
            node[(7 * a + 0) * LANES + lane] = r[k, 0]
            node[(7 * a + 1) * LANES + lane] = r[k, 1]
            node[(7 * a + 2) * LANES + lane] = r[k, 2]
            node[(7 * a + 3) * LANES + lane] = q[k, 0]
            node[(7 * a + 4) * LANES + lane] = q[k, 1]
            node[(7 * a + 5) * LANES + lane] = q[k, 2]
            node[(7 * a + 6) * LANES + lane] = q[k, 3]


@inner
def add_node(N, N_s, node, S):
    """Add one node's share to x (rows 0-2), p (3-6), d (7-10).  N number, N_s (LANES), node flat (7)."""
    for l in range(LANES):
        b = N_s[l]
        S[0 * LANES + l] += b * node[0 * LANES + l]
        S[1 * LANES + l] += b * node[1 * LANES + l]
        S[2 * LANES + l] += b * node[2 * LANES + l]
        S[3 * LANES + l] += N * node[3 * LANES + l]
        S[4 * LANES + l] += N * node[4 * LANES + l]
        S[5 * LANES + l] += N * node[5 * LANES + l]
        S[6 * LANES + l] += N * node[6 * LANES + l]
        S[7 * LANES + l] += b * node[3 * LANES + l]
        S[8 * LANES + l] += b * node[4 * LANES + l]
        S[9 * LANES + l] += b * node[5 * LANES + l]
        S[10 * LANES + l] += b * node[6 * LANES + l]


@inner
def interpolate(N, N_s, node, S):
    """Interpolate x, p, d at one Gauss point of a pack.  N (A,), N_s flat (A), node flat (7A), S flat (11)."""
    for l in range(11 * LANES):
        S[l] = 0.0
    for a in range(N.shape[0]):
        add_node(N[a], N_s[a * LANES :], node[7 * a * LANES :], S)


@inner
def kinematics(S, M):
    """Strain measures at a Gauss point: rows 0-8 R (row by row), 9-11 Gamma, 12-14 K, 15 sigma, 16 1/|p|^2, 17-20 p."""
    for l in range(LANES):
        x0, x1, x2 = S[0 * LANES + l], S[1 * LANES + l], S[2 * LANES + l]
        p0, p1, p2, p3 = S[3 * LANES + l], S[4 * LANES + l], S[5 * LANES + l], S[6 * LANES + l]
        d0, d1, d2, d3 = S[7 * LANES + l], S[8 * LANES + l], S[9 * LANES + l], S[10 * LANES + l]
        i2 = 1.0 / (p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
        f = 2.0 * i2
        R00 = 1.0 - f * (p2 * p2 + p3 * p3)
        R01 = f * (p1 * p2 - p0 * p3)
        R02 = f * (p1 * p3 + p0 * p2)
        R10 = f * (p1 * p2 + p0 * p3)
        R11 = 1.0 - f * (p1 * p1 + p3 * p3)
        R12 = f * (p2 * p3 - p0 * p1)
        R20 = f * (p1 * p3 - p0 * p2)
        R21 = f * (p2 * p3 + p0 * p1)
        R22 = 1.0 - f * (p1 * p1 + p2 * p2)
        M[0 * LANES + l], M[1 * LANES + l], M[2 * LANES + l] = R00, R01, R02
        M[3 * LANES + l], M[4 * LANES + l], M[5 * LANES + l] = R10, R11, R12
        M[6 * LANES + l], M[7 * LANES + l], M[8 * LANES + l] = R20, R21, R22
        M[9 * LANES + l] = R00 * x0 + R10 * x1 + R20 * x2
        M[10 * LANES + l] = R01 * x0 + R11 * x1 + R21 * x2
        M[11 * LANES + l] = R02 * x0 + R12 * x1 + R22 * x2
        M[12 * LANES + l] = f * (p0 * d1 - d0 * p1 - (p2 * d3 - p3 * d2))
        M[13 * LANES + l] = f * (p0 * d2 - d0 * p2 - (p3 * d1 - p1 * d3))
        M[14 * LANES + l] = f * (p0 * d3 - d0 * p3 - (p1 * d2 - p2 * d1))
        M[15 * LANES + l] = f * (p0 * d0 + p1 * d1 + p2 * d2 + p3 * d3)
        M[16 * LANES + l] = i2
        M[17 * LANES + l], M[18 * LANES + l], M[19 * LANES + l], M[20 * LANES + l] = p0, p1, p2, p3


@inner
def strain_minus_reference(M, reference, strain):
    """strain = (Gamma, K) - reference, six rows."""
    for l in range(6 * LANES):
        strain[l] = M[9 * LANES + l] - reference[l]


@inner
def stress_from_strain(strain, C, T):
    """T = C strain with the diagonal C, six rows each."""
    for l in range(6 * LANES):
        T[l] = C[l] * strain[l]


@inner
def couple_stress(strain, C_full, T):
    """T += C_full strain, C_full 36 rows with a zero diagonal."""
    for i in range(6):
        for j in range(6):
            row, source, target = C_full[(6 * i + j) * LANES :], strain[j * LANES :], T[i * LANES :]
            for l in range(LANES):
                target[l] += row[l] * source[l]


@inner
def generalized_force(M, T, dx, F):
    """Gradient of n.Gamma + m.K times dx: rows 0-2 for x, 3 for rho, 4-6 for omega, 7-9 for Y.  T (n, m) six rows."""
    for l in range(LANES):
        w = dx[l]
        n0, n1, n2 = w * T[0 * LANES + l], w * T[1 * LANES + l], w * T[2 * LANES + l]
        m0, m1, m2 = w * T[3 * LANES + l], w * T[4 * LANES + l], w * T[5 * LANES + l]
        G0, G1, G2 = M[9 * LANES + l], M[10 * LANES + l], M[11 * LANES + l]
        K0, K1, K2 = M[12 * LANES + l], M[13 * LANES + l], M[14 * LANES + l]
        s = M[15 * LANES + l]
        F[0 * LANES + l] = M[0 * LANES + l] * n0 + M[1 * LANES + l] * n1 + M[2 * LANES + l] * n2
        F[1 * LANES + l] = M[3 * LANES + l] * n0 + M[4 * LANES + l] * n1 + M[5 * LANES + l] * n2
        F[2 * LANES + l] = M[6 * LANES + l] * n0 + M[7 * LANES + l] * n1 + M[8 * LANES + l] * n2
        F[3 * LANES + l] = -0.5 * (m0 * K0 + m1 * K1 + m2 * K2)
        F[4 * LANES + l] = (n1 * G2 - n2 * G1) + 0.5 * (m1 * K2 - m2 * K1 - s * m0)
        F[5 * LANES + l] = (n2 * G0 - n0 * G2) + 0.5 * (m2 * K0 - m0 * K2 - s * m1)
        F[6 * LANES + l] = (n0 * G1 - n1 * G0) + 0.5 * (m0 * K1 - m1 * K0 - s * m2)
        F[7 * LANES + l], F[8 * LANES + l], F[9 * LANES + l] = m0, m1, m2


@inner
def relative_quaternion(M, node, c, oc):
    """c = conj(p) o q_a / |p|^2, four rows of c from offset oc.  node flat (7) of one node."""
    for l in range(LANES):
        u = np.uint64(l)
        i2 = M[16 * LANES + l]
        p0, p1, p2, p3 = M[17 * LANES + l], M[18 * LANES + l], M[19 * LANES + l], M[20 * LANES + l]
        a0, a1, a2, a3 = node[3 * LANES + l], node[4 * LANES + l], node[5 * LANES + l], node[6 * LANES + l]
        c[oc + u] = i2 * (p0 * a0 + p1 * a1 + p2 * a2 + p3 * a3)
        c[oc + u + U1] = i2 * (p0 * a1 - p1 * a0 - (p2 * a3 - p3 * a2))
        c[oc + u + U2] = i2 * (p0 * a2 - p2 * a0 - (p3 * a1 - p1 * a3))
        c[oc + u + U3] = i2 * (p0 * a3 - p3 * a0 - (p1 * a2 - p2 * a1))


@inner
def add_node_force(N, N_s, oa, c, oc, F, G):
    """Add one Gauss point's force and body moment at one node: G six rows."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        h0 = N * F[3 * LANES + l]
        h1 = N * F[4 * LANES + l] + b * F[7 * LANES + l]
        h2 = N * F[5 * LANES + l] + b * F[8 * LANES + l]
        h3 = N * F[6 * LANES + l] + b * F[9 * LANES + l]
        G[0 * LANES + l] += b * F[0 * LANES + l]
        G[1 * LANES + l] += b * F[1 * LANES + l]
        G[2 * LANES + l] += b * F[2 * LANES + l]
        G[3 * LANES + l] += -c1 * h0 + c0 * h1 + c3 * h2 - c2 * h3
        G[4 * LANES + l] += -c2 * h0 - c3 * h1 + c0 * h2 + c1 * h3
        G[5 * LANES + l] += -c3 * h0 + c2 * h1 - c1 * h2 + c0 * h3


@inner
def tangent_coefficients(M, sigma, C, dx, D):
    """Coefficients of the tangent at a Gauss point, material (C) and geometric (stress memory sigma), times dx.

    Written as two (11, 4) matrices: with e = N A_a phi and z = N' A_a phi of one node, the derivative of the gradient
    is  P e + Q z,  rows 0-3 on eta, 4-7 on zeta, 8-10 on x (in space). P stands in rows 0-43, Q in rows 44-87, row by
    row. Rows 88-93: x-x (upper triangle); 94-100: the gradient for rho, omega, Y under sigma. Entries that are zero for
    every uncoupled section are not written.
    """
    for l in range(LANES):
        w = dx[l]
        R00, R01, R02 = M[0 * LANES + l], M[1 * LANES + l], M[2 * LANES + l]
        R10, R11, R12 = M[3 * LANES + l], M[4 * LANES + l], M[5 * LANES + l]
        R20, R21, R22 = M[6 * LANES + l], M[7 * LANES + l], M[8 * LANES + l]
        G0, G1, G2 = M[9 * LANES + l], M[10 * LANES + l], M[11 * LANES + l]
        k0, k1, k2 = 0.5 * M[12 * LANES + l], 0.5 * M[13 * LANES + l], 0.5 * M[14 * LANES + l]
        h = 0.5 * M[15 * LANES + l]
        c0, c1, c2 = w * C[0 * LANES + l], w * C[1 * LANES + l], w * C[2 * LANES + l]
        c3, c4, c5 = w * C[3 * LANES + l], w * C[4 * LANES + l], w * C[5 * LANES + l]
        n0, n1, n2 = w * sigma[0 * LANES + l], w * sigma[1 * LANES + l], w * sigma[2 * LANES + l]
        m0, m1, m2 = w * sigma[3 * LANES + l], w * sigma[4 * LANES + l], w * sigma[5 * LANES + l]

        # gradient under sigma (as in generalized_force) and the two invariants of the second variation
        mk = m0 * k0 + m1 * k1 + m2 * k2
        t = n0 * G0 + n1 * G1 + n2 * G2 + mk
        a0, a1, a2 = n1 * G2 - n2 * G1, n2 * G0 - n0 * G2, n0 * G1 - n1 * G0
        b0, b1, b2 = m1 * k2 - m2 * k1 - h * m0, m2 * k0 - m0 * k2 - h * m1, m0 * k1 - m1 * k0 - h * m2
        D[94 * LANES + l] = -mk
        D[95 * LANES + l], D[96 * LANES + l], D[97 * LANES + l] = a0 + b0, a1 + b1, a2 + b2
        D[98 * LANES + l], D[99 * LANES + l], D[100 * LANES + l] = m0, m1, m2

        # eta-eta: Z^T C_m Z + [Gamma]x^T C_n [Gamma]x + geometric, Z = -[k | h I - [k]x]; symmetric
        ck0, ck1, ck2, ch0, ch1, ch2 = c3 * k0, c4 * k1, c5 * k2, c3 * h, c4 * h, c5 * h
        e01 = ch0 * k0 - ck1 * k2 + ck2 * k1 - 0.5 * a0 - b0
        e02 = ck0 * k2 + ch1 * k1 - ck2 * k0 - 0.5 * a1 - b1
        e03 = -ck0 * k1 + ck1 * k0 + ch2 * k2 - 0.5 * a2 - b2
        e12 = ch0 * k2 - ch1 * k2 - c5 * k1 * k0 - c2 * G0 * G1 + 0.5 * (G0 * n1 + G1 * n0)
        e13 = -ch0 * k1 - c4 * k2 * k0 + ch2 * k1 - c1 * G0 * G2 + 0.5 * (G0 * n2 + G2 * n0)
        e23 = -c3 * k2 * k1 + ch1 * k0 - ch2 * k0 - c0 * G1 * G2 + 0.5 * (G1 * n2 + G2 * n1)
        D[0 * LANES + l] = ck0 * k0 + ck1 * k1 + ck2 * k2 + mk
        D[5 * LANES + l] = ch0 * h + c4 * k2 * k2 + c5 * k1 * k1 + c1 * G2 * G2 + c2 * G1 * G1 + G0 * n0 - t
        D[10 * LANES + l] = c3 * k2 * k2 + ch1 * h + c5 * k0 * k0 + c0 * G2 * G2 + c2 * G0 * G0 + G1 * n1 - t
        D[15 * LANES + l] = c3 * k1 * k1 + c4 * k0 * k0 + ch2 * h + c0 * G1 * G1 + c1 * G0 * G0 + G2 * n2 - t
        D[1 * LANES + l], D[2 * LANES + l], D[3 * LANES + l] = e01, e02, e03
        D[4 * LANES + l], D[6 * LANES + l], D[7 * LANES + l] = e01, e12, e13
        D[8 * LANES + l], D[9 * LANES + l], D[11 * LANES + l] = e02, e12, e23
        D[12 * LANES + l], D[13 * LANES + l], D[14 * LANES + l] = e03, e13, e23

        # eta-zeta: Z^T C_m + geometric, in Q; its transpose is zeta-eta, in P
        g0, g1, g2 = 0.5 * m0, 0.5 * m1, 0.5 * m2
        D[45 * LANES + l] = D[20 * LANES + l] = -ck0 - g0
        D[46 * LANES + l] = D[24 * LANES + l] = -ck1 - g1
        D[47 * LANES + l] = D[28 * LANES + l] = -ck2 - g2
        D[48 * LANES + l] = D[17 * LANES + l] = -g0
        D[49 * LANES + l] = D[21 * LANES + l] = -ch0
        D[50 * LANES + l] = D[25 * LANES + l] = c4 * k2 - g2
        D[51 * LANES + l] = D[29 * LANES + l] = g1 - c5 * k1
        D[52 * LANES + l] = D[18 * LANES + l] = -g1
        D[53 * LANES + l] = D[22 * LANES + l] = g2 - c3 * k2
        D[54 * LANES + l] = D[26 * LANES + l] = -ch1
        D[55 * LANES + l] = D[30 * LANES + l] = c5 * k0 - g0
        D[56 * LANES + l] = D[19 * LANES + l] = -g2
        D[57 * LANES + l] = D[23 * LANES + l] = c3 * k1 - g1
        D[58 * LANES + l] = D[27 * LANES + l] = g0 - c4 * k0
        D[59 * LANES + l] = D[31 * LANES + l] = -ch2

        # zeta-zeta: C_m
        D[65 * LANES + l], D[70 * LANES + l], D[75 * LANES + l] = c3, c4, c5

        # x-omega: R (C_n [Gamma]x - [n]x);  x-x: R C_n R^T
        X01, X02 = n2 - c0 * G2, c0 * G1 - n1
        X10, X12 = c1 * G2 - n2, n0 - c1 * G0
        X20, X21 = n1 - c2 * G1, c2 * G0 - n0
        D[33 * LANES + l], D[34 * LANES + l] = R01 * X10 + R02 * X20, R00 * X01 + R02 * X21
        D[35 * LANES + l], D[37 * LANES + l] = R00 * X02 + R01 * X12, R11 * X10 + R12 * X20
        D[38 * LANES + l], D[39 * LANES + l] = R10 * X01 + R12 * X21, R10 * X02 + R11 * X12
        D[41 * LANES + l], D[42 * LANES + l] = R21 * X10 + R22 * X20, R20 * X01 + R22 * X21
        D[43 * LANES + l] = R20 * X02 + R21 * X12
        d00, d01, d02, d10, d11, d12 = c0 * R00, c1 * R01, c2 * R02, c0 * R10, c1 * R11, c2 * R12
        D[88 * LANES + l] = d00 * R00 + d01 * R01 + d02 * R02
        D[89 * LANES + l] = d00 * R10 + d01 * R11 + d02 * R12
        D[90 * LANES + l] = d00 * R20 + d01 * R21 + d02 * R22
        D[91 * LANES + l] = d10 * R10 + d11 * R11 + d12 * R12
        D[92 * LANES + l] = d10 * R20 + d11 * R21 + d12 * R22
        D[93 * LANES + l] = c0 * R20 * R20 + c1 * R21 * R21 + c2 * R22 * R22


@inner
def tangent_column(N, N_s, oa, c, oc, D, V):
    """What one node's rotation does at a Gauss point: V = (N P + N' Q) A_a, 11 rows of 3."""
    for i in range(11):
        p, v = at(4 * i), at(3 * i)
        for l in range(LANES):
            u = np.uint64(l)
            b = N_s[oa + u]
            c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
            p0 = N * D[p + u] + b * D[p + u + U44]
            p1 = N * D[p + u + U1] + b * D[p + u + U45]
            p2 = N * D[p + u + U2] + b * D[p + u + U46]
            p3 = N * D[p + u + U3] + b * D[p + u + U47]
            V[v + u] = -c1 * p0 + c0 * p1 + c3 * p2 - c2 * p3
            V[v + u + U1] = -c2 * p0 - c3 * p1 + c0 * p2 + c1 * p3
            V[v + u + U2] = -c3 * p0 + c2 * p1 - c1 * p2 + c0 * p3


@inner
def add_x_rotation_block(N_s, oa, V, K):
    """Add the force rows of node a under the rotation of node b: entries (i, 3 + j) of the 6x6 block K (36 rows)."""
    for i in range(3):
        k, v = at(6 * i + 3), at(24 + 3 * i)
        for l in range(LANES):
            u = np.uint64(l)
            b = N_s[oa + u]
            K[k + u] += b * V[v + u]
            K[k + u + U1] += b * V[v + u + U1]
            K[k + u + U2] += b * V[v + u + U2]


@inner
def add_x_block(N_s, oa, ob, D, K):
    """Add the force rows of node a under the displacement of node b: entries (i, j)."""
    for l in range(LANES):
        u = np.uint64(l)
        w = N_s[oa + u] * N_s[ob + u]
        d1, d2, d4 = w * D[89 * LANES + l], w * D[90 * LANES + l], w * D[92 * LANES + l]
        K[0 * LANES + l] += w * D[88 * LANES + l]
        K[1 * LANES + l] += d1
        K[2 * LANES + l] += d2
        K[6 * LANES + l] += d1
        K[7 * LANES + l] += w * D[91 * LANES + l]
        K[8 * LANES + l] += d4
        K[12 * LANES + l] += d2
        K[13 * LANES + l] += d4
        K[14 * LANES + l] += w * D[93 * LANES + l]


@inner
def add_rotation_block(N, N_s, oa, c, oc, V, K):
    """Add the moment rows of node a under the rotation of node b: entries (3 + i, 3 + j)."""
    for j in range(3):
        v, k = at(j), at(21 + j)
        for l in range(LANES):
            u = np.uint64(l)
            b = N_s[oa + u]
            c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
            p0 = N * V[v + u] + b * V[v + u + U12]
            p1 = N * V[v + u + U3] + b * V[v + u + U15]
            p2 = N * V[v + u + U6] + b * V[v + u + U18]
            p3 = N * V[v + u + U9] + b * V[v + u + U21]
            K[k + u] += -c1 * p0 + c0 * p1 + c3 * p2 - c2 * p3
            K[k + u + U6] += -c2 * p0 - c3 * p1 + c0 * p2 + c1 * p3
            K[k + u + U12] += -c3 * p0 + c2 * p1 - c1 * p2 + c0 * p3


@inner
def add_update_curvature(N, N_s, oa, c, oc, D, K):
    """Subtract 1/4 q_a . dU/dq_a on the diagonal of the rotation block: the second order of q o exp(phi / 2)."""
    for l in range(LANES):
        u = np.uint64(l)
        c1, c2, c3 = c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        rotation = c[oc + u] * D[94 * LANES + l] + c1 * D[95 * LANES + l] + c2 * D[96 * LANES + l]
        rotation += c3 * D[97 * LANES + l]
        rate = c1 * D[98 * LANES + l] + c2 * D[99 * LANES + l] + c3 * D[100 * LANES + l]
        k = 0.5 * (N * rotation + N_s[oa + u] * rate)
        K[21 * LANES + l] -= k
        K[28 * LANES + l] -= k
        K[35 * LANES + l] -= k


@inner
def couple_tangent(M, C_full, dx, D, B, CB):
    """Add the off-diagonal stiffness C_full (36 rows) to the coefficients.  B (28 rows), CB (48 rows): scratch.

    With dstrain = B eta + (R^T dx, Y), B (6, 4), the additions are B^T C B, B^T C and C, turned into space where they
    act on x.
    """
    for l in range(LANES):
        G0, G1, G2 = M[9 * LANES + l], M[10 * LANES + l], M[11 * LANES + l]
        k0, k1, k2 = 0.5 * M[12 * LANES + l], 0.5 * M[13 * LANES + l], 0.5 * M[14 * LANES + l]
        h = 0.5 * M[15 * LANES + l]
        B[0 * LANES + l], B[1 * LANES + l], B[2 * LANES + l], B[3 * LANES + l] = 0.0, 0.0, -G2, G1
        B[4 * LANES + l], B[5 * LANES + l], B[6 * LANES + l], B[7 * LANES + l] = 0.0, G2, 0.0, -G0
        B[8 * LANES + l], B[9 * LANES + l], B[10 * LANES + l], B[11 * LANES + l] = 0.0, -G1, G0, 0.0
        B[12 * LANES + l], B[13 * LANES + l], B[14 * LANES + l], B[15 * LANES + l] = -k0, -h, -k2, k1
        B[16 * LANES + l], B[17 * LANES + l], B[18 * LANES + l], B[19 * LANES + l] = -k1, k2, -h, -k0
        B[20 * LANES + l], B[21 * LANES + l], B[22 * LANES + l], B[23 * LANES + l] = -k2, -k1, k0, -h
    # CB[i] = dx C (B | Y): row i of 4 + 4 entries, the first of the Y part (zeta0) stays zero
    for i in range(6):
        for j in range(8):
            out = CB[(8 * i + j) * LANES :]
            for l in range(LANES):
                out[l] = 0.0
            if j < 4:
                for s in range(6):
                    row, b = C_full[(6 * i + s) * LANES :], B[(4 * s + j) * LANES :]
                    for l in range(LANES):
                        out[l] += dx[l] * row[l] * b[l]
            elif j > 4:
                row = C_full[(6 * i + j - 2) * LANES :]
                for l in range(LANES):
                    out[l] = dx[l] * row[l]
    for j in range(8):
        target = 44 if j >= 4 else 0  # Q or P
        for i in range(4):
            out = D[(target + 4 * i + j % 4) * LANES :]
            for s in range(6):
                b, cb = B[(4 * s + i) * LANES :], CB[(8 * s + j) * LANES :]
                for l in range(LANES):
                    out[l] += b[l] * cb[l]
            if i > 0:
                zeta, cb = D[(target + 16 + 4 * i + j % 4) * LANES :], CB[(8 * (2 + i) + j) * LANES :]
                fresh = j >= 4 and j - 4 != i  # entries that tangent_coefficients does not write
                for l in range(LANES):
                    zeta[l] = cb[l] + (0.0 if fresh else zeta[l])
        for i in range(3):
            out = D[(target + 32 + 4 * i + j % 4) * LANES :]
            for s in range(3):
                r, cb = M[(3 * i + s) * LANES :], CB[(8 * s + j) * LANES :]
                if s == 0 and (j == 0 or j >= 4):  # likewise
                    for l in range(LANES):
                        out[l] = 0.0
                for l in range(LANES):
                    out[l] += r[l] * cb[l]
    k = 88
    for i in range(3):
        for j in range(i, 3):
            out = D[k * LANES :]
            for s in range(3):
                for t in range(3):
                    r, c, q = M[(3 * i + s) * LANES :], C_full[(6 * s + t) * LANES :], M[(3 * j + t) * LANES :]
                    for l in range(LANES):
                        out[l] += dx[l] * r[l] * c[l] * q[l]
            k += 1
