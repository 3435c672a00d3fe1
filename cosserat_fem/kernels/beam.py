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

from math import sqrt

import numpy as np

from . import kernel

LANES = 16

# Offsets of rows 1 to 3. Where a slice would be taken for each node, arrays are passed whole with an unsigned offset: a
# slice costs about 20 ns, and a signed offset could count from the end, which would keep the loop from being vectorised.
U1, U2, U3 = (np.uint64(k * LANES) for k in range(1, 4))

# Rows of the scratch arrays (see each function): kinematics, forces, tangent coefficients, tangent columns.
KINEMATIC_ROWS, FORCE_ROWS, TANGENT_ROWS, COLUMN_ROWS = 21, 10, 65, 33


@kernel
def at(row):
    """Offset of a row of lanes."""
    return np.uint64(row * LANES)


@kernel
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


@kernel
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


@kernel
def interpolate(N, N_s, node, S):
    """Interpolate x, p, d at one Gauss point of a pack.  N (A,), N_s flat (A), node flat (7A), S flat (11)."""
    for l in range(11 * LANES):
        S[l] = 0.0
    for a in range(N.shape[0]):
        add_node(N[a], N_s[a * LANES :], node[7 * a * LANES :], S)


@kernel
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


@kernel
def strain_minus_reference(M, reference, strain):
    """strain = (Gamma, K) - reference, six rows."""
    for l in range(6 * LANES):
        strain[l] = M[9 * LANES + l] - reference[l]


@kernel
def stress_from_strain(strain, C, C_full, T):
    """T = C strain.  C six rows (the diagonal); C_full 36 rows (the rest, zero diagonal) or empty."""
    for l in range(6 * LANES):
        T[l] = C[l] * strain[l]
    if C_full.shape[0] > 0:
        for i in range(6):
            for j in range(6):
                row, source, target = C_full[(6 * i + j) * LANES :], strain[j * LANES :], T[i * LANES :]
                for l in range(LANES):
                    target[l] += row[l] * source[l]


@kernel
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


@kernel
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


@kernel
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


@kernel
def tangent_coefficients(M, sigma, C, dx, D):
    """Coefficients of the tangent at a Gauss point, material (C) and geometric (stress memory sigma), times dx.

    Rows 0-9 eta-eta (upper triangle of 4x4), 10-21 eta-Y (4x3), 22-24 omega-zeta0, 25-27 Y-Y (diagonal),
    28-36 x-omega (3x3, x in space), 37-42 x-x (upper triangle), 43-49 the gradient for rho, omega, Y under sigma.
    Rows 50-52 Y-Y off the diagonal, 53-55 x-rho, 56-64 x-Y are used by coupled sections only.
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
        D[43 * LANES + l] = -mk
        D[44 * LANES + l], D[45 * LANES + l], D[46 * LANES + l] = a0 + b0, a1 + b1, a2 + b2
        D[47 * LANES + l], D[48 * LANES + l], D[49 * LANES + l] = m0, m1, m2

        # eta-eta: Z^T C_m Z + [Gamma]x^T C_n [Gamma]x + geometric, Z = -[k | h I - [k]x]
        D[0 * LANES + l] = c3 * k0 * k0 + c4 * k1 * k1 + c5 * k2 * k2 + mk
        D[1 * LANES + l] = c3 * k0 * h - c4 * k1 * k2 + c5 * k2 * k1 - 0.5 * a0 - b0
        D[2 * LANES + l] = c3 * k0 * k2 + c4 * k1 * h - c5 * k2 * k0 - 0.5 * a1 - b1
        D[3 * LANES + l] = -c3 * k0 * k1 + c4 * k1 * k0 + c5 * k2 * h - 0.5 * a2 - b2
        D[4 * LANES + l] = c3 * h * h + c4 * k2 * k2 + c5 * k1 * k1 + c1 * G2 * G2 + c2 * G1 * G1 + G0 * n0 - t
        D[5 * LANES + l] = c3 * h * k2 - c4 * k2 * h - c5 * k1 * k0 - c2 * G0 * G1 + 0.5 * (G0 * n1 + G1 * n0)
        D[6 * LANES + l] = -c3 * h * k1 - c4 * k2 * k0 + c5 * k1 * h - c1 * G0 * G2 + 0.5 * (G0 * n2 + G2 * n0)
        D[7 * LANES + l] = c3 * k2 * k2 + c4 * h * h + c5 * k0 * k0 + c0 * G2 * G2 + c2 * G0 * G0 + G1 * n1 - t
        D[8 * LANES + l] = -c3 * k2 * k1 + c4 * h * k0 - c5 * k0 * h - c0 * G1 * G2 + 0.5 * (G1 * n2 + G2 * n1)
        D[9 * LANES + l] = c3 * k1 * k1 + c4 * k0 * k0 + c5 * h * h + c0 * G1 * G1 + c1 * G0 * G0 + G2 * n2 - t

        # eta-Y: Z^T C_m + geometric; omega-zeta0; Y-Y
        g0, g1, g2 = 0.5 * m0, 0.5 * m1, 0.5 * m2
        D[10 * LANES + l], D[11 * LANES + l], D[12 * LANES + l] = -k0 * c3 - g0, -k1 * c4 - g1, -k2 * c5 - g2
        D[13 * LANES + l], D[14 * LANES + l], D[15 * LANES + l] = -h * c3, k2 * c4 - g2, -k1 * c5 + g1
        D[16 * LANES + l], D[17 * LANES + l], D[18 * LANES + l] = -k2 * c3 + g2, -h * c4, k0 * c5 - g0
        D[19 * LANES + l], D[20 * LANES + l], D[21 * LANES + l] = k1 * c3 - g1, -k0 * c4 + g0, -h * c5
        D[22 * LANES + l], D[23 * LANES + l], D[24 * LANES + l] = -g0, -g1, -g2
        D[25 * LANES + l], D[26 * LANES + l], D[27 * LANES + l] = c3, c4, c5

        # x-omega: R (C_n [Gamma]x - [n]x);  x-x: R C_n R^T
        X01, X02 = n2 - c0 * G2, c0 * G1 - n1
        X10, X12 = c1 * G2 - n2, n0 - c1 * G0
        X20, X21 = n1 - c2 * G1, c2 * G0 - n0
        D[28 * LANES + l], D[29 * LANES + l] = R01 * X10 + R02 * X20, R00 * X01 + R02 * X21
        D[30 * LANES + l], D[31 * LANES + l] = R00 * X02 + R01 * X12, R11 * X10 + R12 * X20
        D[32 * LANES + l], D[33 * LANES + l] = R10 * X01 + R12 * X21, R10 * X02 + R11 * X12
        D[34 * LANES + l], D[35 * LANES + l] = R21 * X10 + R22 * X20, R20 * X01 + R22 * X21
        D[36 * LANES + l] = R20 * X02 + R21 * X12
        D[37 * LANES + l] = c0 * R00 * R00 + c1 * R01 * R01 + c2 * R02 * R02
        D[38 * LANES + l] = c0 * R00 * R10 + c1 * R01 * R11 + c2 * R02 * R12
        D[39 * LANES + l] = c0 * R00 * R20 + c1 * R01 * R21 + c2 * R02 * R22
        D[40 * LANES + l] = c0 * R10 * R10 + c1 * R11 * R11 + c2 * R12 * R12
        D[41 * LANES + l] = c0 * R10 * R20 + c1 * R11 * R21 + c2 * R12 * R22
        D[42 * LANES + l] = c0 * R20 * R20 + c1 * R21 * R21 + c2 * R22 * R22


@kernel
def tangent_column(N, N_s, oa, c, oc, D, V):
    """What one node's rotation does at a Gauss point: rows 0-11 on eta (4x3), 12-23 on zeta (4x3), 24-32 on x (3x3)."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        g0, g1, g2 = b * D[22 * LANES + l], b * D[23 * LANES + l], b * D[24 * LANES + l]
        E01, E02, E03 = N * D[1 * LANES + l], N * D[2 * LANES + l], N * D[3 * LANES + l]
        E12, E13, E23 = N * D[5 * LANES + l], N * D[6 * LANES + l], N * D[8 * LANES + l]

        P0 = N * D[0 * LANES + l]
        P1, P2, P3 = E01 + b * D[10 * LANES + l], E02 + b * D[11 * LANES + l], E03 + b * D[12 * LANES + l]
        V[0 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[1 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[2 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0, P1 = E01 + g0, N * D[4 * LANES + l] + b * D[13 * LANES + l]
        P2, P3 = E12 + b * D[14 * LANES + l], E13 + b * D[15 * LANES + l]
        V[3 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[4 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[5 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0, P1 = E02 + g1, E12 + b * D[16 * LANES + l]
        P2, P3 = N * D[7 * LANES + l] + b * D[17 * LANES + l], E23 + b * D[18 * LANES + l]
        V[6 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[7 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[8 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0, P1 = E03 + g2, E13 + b * D[19 * LANES + l]
        P2, P3 = E23 + b * D[20 * LANES + l], N * D[9 * LANES + l] + b * D[21 * LANES + l]
        V[9 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[10 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[11 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3

        n0, n1, n2, n3 = N * c0, N * c1, N * c2, N * c3
        P1, P2, P3 = D[22 * LANES + l], D[23 * LANES + l], D[24 * LANES + l]
        V[12 * LANES + l] = n0 * P1 + n3 * P2 - n2 * P3
        V[13 * LANES + l] = -n3 * P1 + n0 * P2 + n1 * P3
        V[14 * LANES + l] = n2 * P1 - n1 * P2 + n0 * P3
        P0, P1, P2, P3 = N * D[10 * LANES + l], N * D[13 * LANES + l], N * D[16 * LANES + l], N * D[19 * LANES + l]
        P1 += b * D[25 * LANES + l]
        V[15 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[16 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[17 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0, P1, P2, P3 = N * D[11 * LANES + l], N * D[14 * LANES + l], N * D[17 * LANES + l], N * D[20 * LANES + l]
        P2 += b * D[26 * LANES + l]
        V[18 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[19 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[20 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0, P1, P2, P3 = N * D[12 * LANES + l], N * D[15 * LANES + l], N * D[18 * LANES + l], N * D[21 * LANES + l]
        P3 += b * D[27 * LANES + l]
        V[21 * LANES + l] = -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        V[22 * LANES + l] = -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        V[23 * LANES + l] = -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3

        P1, P2, P3 = D[28 * LANES + l], D[29 * LANES + l], D[30 * LANES + l]
        V[24 * LANES + l] = n0 * P1 + n3 * P2 - n2 * P3
        V[25 * LANES + l] = -n3 * P1 + n0 * P2 + n1 * P3
        V[26 * LANES + l] = n2 * P1 - n1 * P2 + n0 * P3
        P1, P2, P3 = D[31 * LANES + l], D[32 * LANES + l], D[33 * LANES + l]
        V[27 * LANES + l] = n0 * P1 + n3 * P2 - n2 * P3
        V[28 * LANES + l] = -n3 * P1 + n0 * P2 + n1 * P3
        V[29 * LANES + l] = n2 * P1 - n1 * P2 + n0 * P3
        P1, P2, P3 = D[34 * LANES + l], D[35 * LANES + l], D[36 * LANES + l]
        V[30 * LANES + l] = n0 * P1 + n3 * P2 - n2 * P3
        V[31 * LANES + l] = -n3 * P1 + n0 * P2 + n1 * P3
        V[32 * LANES + l] = n2 * P1 - n1 * P2 + n0 * P3


@kernel
def add_x_rotation_block(N_s, oa, V, K):
    """Add the force rows of node a under the rotation of node b: entries (i, 3 + j) of the 6x6 block K (36 rows)."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        K[3 * LANES + l] += b * V[24 * LANES + l]
        K[4 * LANES + l] += b * V[25 * LANES + l]
        K[5 * LANES + l] += b * V[26 * LANES + l]
        K[9 * LANES + l] += b * V[27 * LANES + l]
        K[10 * LANES + l] += b * V[28 * LANES + l]
        K[11 * LANES + l] += b * V[29 * LANES + l]
        K[15 * LANES + l] += b * V[30 * LANES + l]
        K[16 * LANES + l] += b * V[31 * LANES + l]
        K[17 * LANES + l] += b * V[32 * LANES + l]


@kernel
def add_symmetric_blocks(N, N_s, oa, ob, c, oc, D, V, K):
    """Add x-x and rotation-rotation of nodes a (N, N_s at oa, c) and b (N_s at ob, V): entries (i, j) and (3 + i, 3 + j)."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        w = b * N_s[ob + u]
        K[0 * LANES + l] += w * D[37 * LANES + l]
        K[1 * LANES + l] += w * D[38 * LANES + l]
        K[2 * LANES + l] += w * D[39 * LANES + l]
        K[6 * LANES + l] += w * D[38 * LANES + l]
        K[7 * LANES + l] += w * D[40 * LANES + l]
        K[8 * LANES + l] += w * D[41 * LANES + l]
        K[12 * LANES + l] += w * D[39 * LANES + l]
        K[13 * LANES + l] += w * D[41 * LANES + l]
        K[14 * LANES + l] += w * D[42 * LANES + l]
        c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        P0 = N * V[0 * LANES + l] + b * V[12 * LANES + l]
        P1 = N * V[3 * LANES + l] + b * V[15 * LANES + l]
        P2 = N * V[6 * LANES + l] + b * V[18 * LANES + l]
        P3 = N * V[9 * LANES + l] + b * V[21 * LANES + l]
        K[21 * LANES + l] += -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        K[27 * LANES + l] += -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        K[33 * LANES + l] += -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0 = N * V[1 * LANES + l] + b * V[13 * LANES + l]
        P1 = N * V[4 * LANES + l] + b * V[16 * LANES + l]
        P2 = N * V[7 * LANES + l] + b * V[19 * LANES + l]
        P3 = N * V[10 * LANES + l] + b * V[22 * LANES + l]
        K[22 * LANES + l] += -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        K[28 * LANES + l] += -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        K[34 * LANES + l] += -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3
        P0 = N * V[2 * LANES + l] + b * V[14 * LANES + l]
        P1 = N * V[5 * LANES + l] + b * V[17 * LANES + l]
        P2 = N * V[8 * LANES + l] + b * V[20 * LANES + l]
        P3 = N * V[11 * LANES + l] + b * V[23 * LANES + l]
        K[23 * LANES + l] += -c1 * P0 + c0 * P1 + c3 * P2 - c2 * P3
        K[29 * LANES + l] += -c2 * P0 - c3 * P1 + c0 * P2 + c1 * P3
        K[35 * LANES + l] += -c3 * P0 + c2 * P1 - c1 * P2 + c0 * P3


@kernel
def add_update_curvature(N, N_s, oa, c, oc, D, K):
    """Subtract 1/4 q_a . dU/dq_a on the diagonal of the rotation block: the second order of q o exp(phi / 2)."""
    for l in range(LANES):
        u = np.uint64(l)
        c1, c2, c3 = c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        rotation = c[oc + u] * D[43 * LANES + l] + c1 * D[44 * LANES + l] + c2 * D[45 * LANES + l]
        rotation += c3 * D[46 * LANES + l]
        rate = c1 * D[47 * LANES + l] + c2 * D[48 * LANES + l] + c3 * D[49 * LANES + l]
        k = 0.5 * (N * rotation + N_s[oa + u] * rate)
        K[21 * LANES + l] -= k
        K[28 * LANES + l] -= k
        K[35 * LANES + l] -= k


@kernel
def couple_tangent(M, C_full, dx, D, B, CB):
    """Add the off-diagonal stiffness C_full (36 rows) to the coefficients.  B, CB: scratch, 24 rows each.

    With dstrain = B eta + (R^T dx, Y) the additions are B^T C B, B^T C and their parts turned into space.
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
    for i in range(6):
        for k in range(4):
            out = CB[(4 * i + k) * LANES :]
            for l in range(LANES):
                out[l] = 0.0
            for j in range(6):
                row, b = C_full[(6 * i + j) * LANES :], B[(4 * j + k) * LANES :]
                for l in range(LANES):
                    out[l] += dx[l] * row[l] * b[l]
    k = 0
    for i in range(4):
        for j in range(i, 4):
            out = D[k * LANES :]
            for s in range(6):
                b, cb = B[(4 * s + i) * LANES :], CB[(4 * s + j) * LANES :]
                for l in range(LANES):
                    out[l] += b[l] * cb[l]
            k += 1
        for j in range(3):
            out, cb = D[(10 + 3 * i + j) * LANES :], CB[(4 * (3 + j) + i) * LANES :]
            for l in range(LANES):
                out[l] += cb[l]
    k = 37
    for i in range(3):
        for l in range(LANES):
            w = dx[l]
            R0, R1, R2 = M[(3 * i) * LANES + l], M[(3 * i + 1) * LANES + l], M[(3 * i + 2) * LANES + l]
            D[(53 + i) * LANES + l] = R0 * CB[l] + R1 * CB[4 * LANES + l] + R2 * CB[8 * LANES + l]
            for j in range(3):
                a0, a1, a2 = CB[(1 + j) * LANES + l], CB[(5 + j) * LANES + l], CB[(9 + j) * LANES + l]
                D[(28 + 3 * i + j) * LANES + l] += R0 * a0 + R1 * a1 + R2 * a2
                c0, c1, c2 = C_full[(3 + j) * LANES + l], C_full[(9 + j) * LANES + l], C_full[(15 + j) * LANES + l]
                D[(56 + 3 * i + j) * LANES + l] = w * (R0 * c0 + R1 * c1 + R2 * c2)
            for j in range(i, 3):
                S0, S1, S2 = M[(3 * j) * LANES + l], M[(3 * j + 1) * LANES + l], M[(3 * j + 2) * LANES + l]
                c01, c02, c12 = w * C_full[1 * LANES + l], w * C_full[2 * LANES + l], w * C_full[8 * LANES + l]
                D[(k + j - i) * LANES + l] += (
                    c01 * (R0 * S1 + R1 * S0) + c02 * (R0 * S2 + R2 * S0) + c12 * (R1 * S2 + R2 * S1)
                )
        k += 3 - i
    for l in range(LANES):
        D[50 * LANES + l] = dx[l] * C_full[22 * LANES + l]
        D[51 * LANES + l] = dx[l] * C_full[23 * LANES + l]
        D[52 * LANES + l] = dx[l] * C_full[29 * LANES + l]


@kernel
def couple_column(N, N_s, oa, c, oc, D, V):
    """Add to a tangent column what only coupled sections have: Y-Y off the diagonal, x-rho and x-Y."""
    for l in range(LANES):
        u = np.uint64(l)
        b = N_s[oa + u]
        c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
        y01, y02, y12 = b * D[50 * LANES + l], b * D[51 * LANES + l], b * D[52 * LANES + l]
        V[15 * LANES + l] += y01 * c3 - y02 * c2
        V[16 * LANES + l] += y01 * c0 + y02 * c1
        V[17 * LANES + l] += -y01 * c1 + y02 * c0
        V[18 * LANES + l] += y01 * c0 - y12 * c2
        V[19 * LANES + l] += -y01 * c3 + y12 * c1
        V[20 * LANES + l] += y01 * c2 + y12 * c0
        V[21 * LANES + l] += y02 * c0 + y12 * c3
        V[22 * LANES + l] += -y02 * c3 + y12 * c0
        V[23 * LANES + l] += y02 * c2 - y12 * c1
    for i in range(3):
        for l in range(LANES):
            u = np.uint64(l)
            c0, c1, c2, c3 = c[oc + u], c[oc + u + U1], c[oc + u + U2], c[oc + u + U3]
            e = N * D[(53 + i) * LANES + l]
            b = N_s[oa + u]
            y0, y1, y2 = D[(56 + 3 * i) * LANES + l], D[(57 + 3 * i) * LANES + l], D[(58 + 3 * i) * LANES + l]
            V[(24 + 3 * i) * LANES + l] += -e * c1 + b * (y0 * c0 + y1 * c3 - y2 * c2)
            V[(25 + 3 * i) * LANES + l] += -e * c2 + b * (-y0 * c3 + y1 * c0 + y2 * c1)
            V[(26 + 3 * i) * LANES + l] += -e * c3 + b * (y0 * c2 - y1 * c1 + y2 * c0)
