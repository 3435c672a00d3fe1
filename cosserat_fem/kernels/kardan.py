"""Strains, force and tangent of the element whose unknowns are Kardan angles and displacements (the paper's choice).

Interpolation: w = r - r_drawn in the fixed frame and the angles (psi, theta, phi), all with the same Lagrange basis.
With R = Rx(psi) Ry(theta) Rz(phi) and the body axes of its three turns

    b1 = (cos theta cos phi, -cos theta sin phi, sin theta),   b2 = (sin phi, cos phi, 0),   b3 = (0, 0, 1)

the strains are Gamma = R^T r',  K = sum_i b_i angle_i'. Every derivative follows from two rules,
d(R^T x)/d angle_j = (R^T x) x b_j  and  d b_i/d angle_j = b_i x b_j for j > i, else 0.

Unknowns add up, so the matrix is the plain Hessian of the energy. The moments conjugate to the angles are h_i . M with
the spatial axes h_i = R b_i; they become dependent at theta = +-90 deg. Angles interpolated between two nodes do not
turn with a turned rod: the element is not objective. It is here to be compared with.

One element at a time, a full 6x6 stiffness: clarity before speed.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from . import inner, kernel


@inner
def cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def frame(angle, R, b, db):
    """Rotation R (3, 3), body axes b (3, 3) and their derivatives db[i, j] = d b_i / d angle_j (3, 3, 3)."""
    c0, s0, c1, s1 = cos(angle[0]), sin(angle[0]), cos(angle[1]), sin(angle[1])
    c2, s2 = cos(angle[2]), sin(angle[2])
    R[0, 0], R[0, 1], R[0, 2] = c1 * c2, -c1 * s2, s1
    R[1, 0], R[1, 1], R[1, 2] = c0 * s2 + s0 * s1 * c2, c0 * c2 - s0 * s1 * s2, -s0 * c1
    R[2, 0], R[2, 1], R[2, 2] = s0 * s2 - c0 * s1 * c2, s0 * c2 + c0 * s1 * s2, c0 * c1
    b[0, 0], b[0, 1], b[0, 2] = c1 * c2, -c1 * s2, s1
    b[1, 0], b[1, 1], b[1, 2] = s2, c2, 0.0
    b[2, 0], b[2, 1], b[2, 2] = 0.0, 0.0, 1.0
    for i in range(3):
        for j in range(3):
            if j > i:
                cross(b[i], b[j], db[i, j])
            else:
                db[i, j] = 0.0


@inner
def interpolate(nodes, N, N_s, r, angles, x, angle, rate):
    for i in range(3):
        x[i] = angle[i] = rate[i] = 0.0
        for a in range(nodes.shape[0]):
            x[i] += N_s[a] * r[nodes[a], i]
            angle[i] += N[a] * angles[nodes[a], i]
            rate[i] += N_s[a] * angles[nodes[a], i]


@inner
def strain_at(x, rate, R, b, strain):
    for i in range(3):
        strain[i] = R[0, i] * x[0] + R[1, i] * x[1] + R[2, i] * x[2]
        strain[3 + i] = rate[0] * b[0, i] + rate[1] * b[1, i] + rate[2] * b[2, i]


@kernel
def strain_and_frame(conn, N, N_s, r, angles, strain, frames):
    """Total strain (Gamma, K) (E, Q, 6) and rotation matrix (E, Q, 3, 3) at every Gauss point."""
    x, angle, rate = np.empty(3), np.empty(3), np.empty(3)
    b, db = np.empty((3, 3)), np.empty((3, 3, 3))
    for e in range(conn.shape[0]):
        for q in range(N.shape[0]):
            interpolate(conn[e], N[q], N_s[e, q], r, angles, x, angle, rate)
            frame(angle, frames[e, q], b, db)
            strain_at(x, rate, frames[e, q], b, strain[e, q])


@inner
def gradient_rows(strain, rate, N, N_s, R, b, db, B):
    """B (6, 6 A): derivative of the strain with respect to (w, angles) of every node."""
    G, turned = strain[:3], np.empty(3)
    for j in range(3):
        cross(G, b[j], turned)
        for a in range(N.shape[0]):
            for i in range(3):
                B[i, 6 * a + j] = N_s[a] * R[j, i]
                B[3 + i, 6 * a + j] = 0.0
                B[i, 6 * a + 3 + j] = N[a] * turned[i]
                change = rate[0] * db[0, j, i] + rate[1] * db[1, j, i] + rate[2] * db[2, j, i]
                B[3 + i, 6 * a + 3 + j] = N[a] * change + N_s[a] * b[j, i]


@inner
def second_variation(strain, rate, n, m, R, b, db, xa, aa, ra):
    """Second derivatives of n.Gamma + m.K: xa (space x, angle), aa (angle, angle), ra (rate, angle), each (3, 3)."""
    u, v, w = np.empty(3), np.empty(3), np.empty(3)
    G = strain[:3]
    for j in range(3):
        cross(b[j], n, u)
        for i in range(3):
            xa[i, j] = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
            ra[i, j] = dot3(m, db[i, j])
    for j in range(3):
        for k in range(3):
            cross(G, b[k], u)
            cross(u, b[j], v)
            cross(G, db[j, k], w)
            aa[j, k] = dot3(n, v) + dot3(n, w)
            for i in range(j):  # db[i, j] is not zero for j > i only
                cross(db[i, k], b[j], v)
                cross(b[i], db[j, k], w)
                aa[j, k] += rate[i] * (dot3(m, v) + dot3(m, w))


@kernel
def assemble(conn, N, N_s, dx, C, reference, sigma, r, angles, tangent, g, out):
    """Add the generalized forces to g (N, 6) and, with `tangent`, write the element matrices out (E, 6A, 6A).

    conn (E, A), N (Q, A), N_s (E, Q, A), dx (E, Q), C (E, Q, 6, 6), reference and sigma (E, Q, 6).
    Returns the largest section force [N] and moment [N m].
    """
    A = conn.shape[1]
    x, angle, rate, strain, stress = np.empty(3), np.empty(3), np.empty(3), np.empty(6), np.empty(6)
    R, b, db = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3))
    xa, aa, ra = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    B, CB = np.empty((6, 6 * A)), np.empty((6, 6 * A))
    force = moment = 0.0
    for e in range(conn.shape[0]):
        if tangent:
            out[e] = 0.0
        for q in range(N.shape[0]):
            interpolate(conn[e], N[q], N_s[e, q], r, angles, x, angle, rate)
            frame(angle, R, b, db)
            strain_at(x, rate, R, b, strain)
            gradient_rows(strain, rate, N[q], N_s[e, q], R, b, db, B)
            for i in range(6):
                stress[i] = 0.0
                for j in range(6):
                    stress[i] += C[e, q, i, j] * (strain[j] - reference[e, q, j])
            force = max(force, np.sqrt(dot3(stress[:3], stress[:3])))
            moment = max(moment, np.sqrt(dot3(stress[3:], stress[3:])))
            w = dx[e, q]
            for a in range(A):
                for j in range(6):
                    for i in range(6):
                        g[conn[e, a], j] += w * B[i, 6 * a + j] * stress[i]
            if not tangent:
                continue
            for i in range(6):
                for j in range(6 * A):
                    CB[i, j] = 0.0
                    for k in range(6):
                        CB[i, j] += w * C[e, q, i, k] * B[k, j]
            for k in range(6):
                for i in range(6 * A):
                    for j in range(6 * A):
                        out[e, i, j] += B[k, i] * CB[k, j]
            second_variation(strain, rate, sigma[e, q, :3], sigma[e, q, 3:], R, b, db, xa, aa, ra)
            for a in range(A):
                for c in range(A):
                    nn, ns = w * N[q, a] * N[q, c], w * N_s[e, q, a] * N[q, c]
                    sn = w * N[q, a] * N_s[e, q, c]
                    for i in range(3):
                        for j in range(3):
                            out[e, 6 * a + i, 6 * c + 3 + j] += ns * xa[i, j]
                            out[e, 6 * a + 3 + i, 6 * c + j] += sn * xa[j, i]
                            out[e, 6 * a + 3 + i, 6 * c + 3 + j] += nn * aa[i, j] + ns * ra[i, j] + sn * ra[j, i]
    return force, moment


@kernel
def extrapolate_stress(conn, N, N_s, C, reference, r, angles, du, scale, sigma):
    """Stress memory of the mixed-integration-point Newton method: sigma = C (strain + scale B du), before the update."""
    A = conn.shape[1]
    x, angle, rate, strain = np.empty(3), np.empty(3), np.empty(3), np.empty(6)
    R, b, db, B = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3)), np.empty((6, 6 * A))
    for e in range(conn.shape[0]):
        for q in range(N.shape[0]):
            interpolate(conn[e], N[q], N_s[e, q], r, angles, x, angle, rate)
            frame(angle, R, b, db)
            strain_at(x, rate, R, b, strain)
            gradient_rows(strain, rate, N[q], N_s[e, q], R, b, db, B)
            for i in range(6):
                strain[i] -= reference[e, q, i]
                for a in range(A):
                    for j in range(6):
                        strain[i] += scale * B[i, 6 * a + j] * du[conn[e, a], j]
            for i in range(6):
                sigma[e, q, i] = 0.0
                for j in range(6):
                    sigma[e, q, i] += C[e, q, i, j] * strain[j]
