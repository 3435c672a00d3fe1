"""Contact of a rod with a rigid part: the law between them, residual and tangent.

Rule: `reach` says at which points a rod is pressed; forces and stiffness are sums over these.

Law, per unit length of the unstressed rod, gap g, range G, scale P [N/m], x = g / G:
    barrier   p = P (2 (x - 1) ln x + (x - 1)^2 / x)  for x < 1: minus the derivative of -P G (x - 1)^2 ln x, twice smooth at
              x = 1 and infinite at 0 (Li and others 2020, Incremental Potential Contact, doi 10.1145/3386569.3392425, as a
              line density);
    friction  the slip of the surface since it was last at rest, at most `elastic` long, turned into a force of mu p at
              that length: true stick below, Coulomb slip above, and no scale of its own.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from . import inner, kernel
from .rotation import log_quaternion

ABOUT_TO_SLIP = 0.999


@inner
def barrier(g, G, P):
    """Pressure p [N/m], -dp/dg [N/m^2] and potential [N] of the barrier at a gap g > 0."""
    if g >= G:
        return 0.0, 0.0, 0.0
    x = g / G
    l, m = log(x), x - 1.0
    p = P * (2.0 * m * l + m * m / x)
    k = -P / G * (2.0 * l + 4.0 * m / x - m * m / (x * x))
    return p, k, -P * G * m * m * l


@inner
def layer(depth, stiffness, start):
    """Pressure, its slope and potential of a compliant layer indented by depth; quadratic up to `start`, then linear."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    if depth < start:
        return (
            0.5 * stiffness * depth * depth / start,
            stiffness * depth / start,
            stiffness * depth**3 / (6.0 * start),
        )
    over = depth - start
    return (
        stiffness * (depth - 0.5 * start),
        stiffness,
        stiffness * (start * start / 6.0 + 0.5 * start * over + 0.5 * over * over),
    )


@inner
def slide(u, mu, elastic, m, M):
    """Friction per pressure m (3,) of an elastic slip u (3,), opposed by it, and its change M (3, 3) with u.

    What is about to slip counts as slipping in M: a step begins where the last one left it, at its limit.
    """
    size = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    slipping = size > ABOUT_TO_SLIP * elastic
    f = mu / max(size, elastic)
    for i in range(3):
        m[i] = f * u[i]
        for j in range(3):
            M[i, j] = -f * u[i] * u[j] / (size * size) if slipping else 0.0
        M[i, i] += f


@kernel
def press(rows, runs, nodes, coefficients, law, friction, rubbing, exact, force, stiffness, found):
    """Residual force (S, A, 6) and, if not empty, stiffness (S, 6 A, 6 A) of contact at points, for touched elements.

    rows: of `reach.find`; runs (S + 1,): where the points of each touched element begin; nodes (S, A); law (5,): core
    radius (distance at which the barrier is infinite), range, scale, stiffness and depth of a compliant layer; friction
    (3,): mu, elastic slip, lever (radius of the rod). rubbing: kept (K, 3), slip kept from before; away (N, 3), way of each
    node relative to the part since then; theta, T, R: of `turned`, rotation matrices. Empty without friction. exact: keep
    the part of the stiffness that pressure has by the curvature of the obstacle. found (K, 8): written, pressure, friction
    per pressure (3), slip (3), potential.
    Returns the largest weight times stiffness [N/m].

    The stiffness at a point is the same for all pairs of nodes a, b but for a factor N_a N_b: it is summed over the points
    of an element in space, for a >= b, and put into the axes of the nodes once.
    """
    A = nodes.shape[1]
    N, m, n, u, z, turn = np.empty(A), np.zeros(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    M, X, nm = np.zeros((3, 3)), np.empty((3, 3)), np.zeros(3)
    of_pairs, of_nodes, point = np.zeros((A * (A + 1) // 2, 36)), np.zeros((A, 6)), np.zeros(36)
    core, G, P, soft, depth = law
    mu, elastic, lever = friction
    kept, away, theta, T, R = rubbing
    rubs, tangent, stiffest = mu > 0.0, stiffness.shape[0] > 0, 0.0
    for s in range(nodes.shape[0]):
        for k in range(runs[s], runs[s + 1]):
            w = rows[k, 1]
            p, stiff, psi = barrier(rows[k, 2] - core, G, P)
            if soft > 0.0:
                p1, k1, psi1 = layer(core + G + depth - rows[k, 2], soft, G)
                p, stiff, psi = p + p1, stiff + k1, psi + psi1
            stiffest = max(stiffest, w * stiff)
            found[k, 0], found[k, 7] = p, psi
            t = rows[k, 0] - 0.5
            for a in range(A):
                value = 0.0
                for j in range(A - 1, -1, -1):
                    value = value * t + coefficients[j, a]
                N[a] = value
            for i in range(3):
                n[i] = rows[k, 3 + i]
            if rubs:
                for i in range(3):
                    z[i], turn[i] = kept[k, i], 0.0
                for a in range(A):
                    node = nodes[s, a]
                    for i in range(3):
                        z[i] += N[a] * away[node, i]
                        turn[i] += N[a] * theta[node, i]
                nz = n[0] * z[0] + n[1] * z[1] + n[2] * z[2]
                u[0] = z[0] - n[0] * nz - lever * (turn[1] * n[2] - turn[2] * n[1])
                u[1] = z[1] - n[1] * nz - lever * (turn[2] * n[0] - turn[0] * n[2])
                u[2] = z[2] - n[2] * nz - lever * (turn[0] * n[1] - turn[1] * n[0])
                slide(u, mu, elastic, m, M)
                nm[0] = n[1] * m[2] - n[2] * m[1]
                nm[1] = n[2] * m[0] - n[0] * m[2]
                nm[2] = n[0] * m[1] - n[1] * m[0]
                for i in range(3):
                    found[k, 1 + i], found[k, 4 + i] = m[i], u[i]
            for a in range(A):
                f = w * p * N[a]
                for i in range(3):
                    of_nodes[a, i] += f * (m[i] - n[i])
                    of_nodes[a, 3 + i] -= lever * f * nm[i]
            if not tangent:
                continue
            bend, pair = p if exact else 0.0, 0
            if not rubs:
                for i in range(3):
                    for j in range(3):
                        point[3 * i + j] = w * (stiff * n[i] * n[j] - bend * rows[k, 6 + 3 * i + j])
                for a in range(A):
                    for b in range(a + 1):
                        f = N[a] * N[b]
                        for j in range(9):
                            of_pairs[pair, j] += f * point[j]
                        pair += 1
                continue
            rubbed_point(rows, k, p, stiff, bend, lever, n, m, M, z, nz, turn, X, point)
            for a in range(A):
                for b in range(a + 1):
                    f = w * N[a] * N[b]
                    for j in range(36):
                        of_pairs[pair, j] += f * point[j]
                    pair += 1
        if rubs:
            settle_rubbed(s, nodes, T, R, of_nodes, of_pairs, tangent, X, force, stiffness)
        else:
            settle(s, of_nodes, of_pairs, tangent, force, stiffness)
    return stiffest


@inner
def rubbed_point(rows, k, p, stiff, bend, lever, n, m, M, z, nz, turn, X, point):
    """Change of force and moment on the rod at a point, seen in space (6, 6), with its place and rotation vector."""
    # change of the slip: X dx + lever n x dtheta
    for j in range(3):
        H0, H1, H2 = rows[k, 6 + j], rows[k, 9 + j], rows[k, 12 + j]
        Hz = H0 * z[0] + H1 * z[1] + H2 * z[2]
        X[0, j] = -n[0] * n[j] - nz * H0 - n[0] * Hz - lever * (turn[1] * H2 - turn[2] * H1)
        X[1, j] = -n[1] * n[j] - nz * H1 - n[1] * Hz - lever * (turn[2] * H0 - turn[0] * H2)
        X[2, j] = -n[2] * n[j] - nz * H2 - n[2] * Hz - lever * (turn[0] * H1 - turn[1] * H0)
        X[j, j] += 1.0
    for j in range(3):
        H0, H1, H2 = rows[k, 6 + j], rows[k, 9 + j], rows[k, 12 + j]
        along = stiff * n[j]
        v0 = p * (M[0, 0] * X[0, j] + M[0, 1] * X[1, j] + M[0, 2] * X[2, j]) - m[0] * along
        v1 = p * (M[1, 0] * X[0, j] + M[1, 1] * X[1, j] + M[1, 2] * X[2, j]) - m[1] * along
        v2 = p * (M[2, 0] * X[0, j] + M[2, 1] * X[1, j] + M[2, 2] * X[2, j]) - m[2] * along
        point[j] = v0 + n[0] * along - bend * H0
        point[6 + j] = v1 + n[1] * along - bend * H1
        point[12 + j] = v2 + n[2] * along - bend * H2
        # moment -lever n x (p m)
        point[18 + j] = -lever * (n[1] * v2 - n[2] * v1 + p * (H1 * m[2] - H2 * m[1]))
        point[24 + j] = -lever * (n[2] * v0 - n[0] * v2 + p * (H2 * m[0] - H0 * m[2]))
        point[30 + j] = -lever * (n[0] * v1 - n[1] * v0 + p * (H0 * m[1] - H1 * m[0]))
    f = lever * p
    for i in range(3):
        point[6 * i + 3] = f * (M[i, 1] * n[2] - M[i, 2] * n[1])
        point[6 * i + 4] = f * (M[i, 2] * n[0] - M[i, 0] * n[2])
        point[6 * i + 5] = f * (M[i, 0] * n[1] - M[i, 1] * n[0])
    for j in range(3, 6):
        v0, v1, v2 = point[j], point[6 + j], point[12 + j]
        point[18 + j] = -lever * (n[1] * v2 - n[2] * v1)
        point[24 + j] = -lever * (n[2] * v0 - n[0] * v2)
        point[30 + j] = -lever * (n[0] * v1 - n[1] * v0)


@inner
def settle(s, of_nodes, of_pairs, tangent, force, stiffness):
    """Write the sums over the points of an element without friction, and clear them."""
    A, pair = of_nodes.shape[0], 0
    for a in range(A):
        for i in range(3):
            force[s, a, i] = of_nodes[a, i]
            of_nodes[a, i] = 0.0
        if not tangent:
            continue
        for b in range(a + 1):
            for i in range(3):
                for j in range(3):
                    value = of_pairs[pair, 3 * i + j]
                    stiffness[s, 6 * a + i, 6 * b + j] = value
                    stiffness[s, 6 * b + i, 6 * a + j] = value
                    of_pairs[pair, 3 * i + j] = 0.0
            pair += 1


@inner
def settle_rubbed(s, nodes, T, R, of_nodes, of_pairs, tangent, D, force, stiffness):
    """As `settle`, with moments put into the axes of the nodes and rotations taken from there."""
    A, pair = of_nodes.shape[0], 0
    for a in range(A):
        node = nodes[s, a]
        for i in range(3):
            force[s, a, i] = of_nodes[a, i]
            moment = R[node, 0, i] * of_nodes[a, 3] + R[node, 1, i] * of_nodes[a, 4] + R[node, 2, i] * of_nodes[a, 5]
            force[s, a, 3 + i] = moment
        for i in range(6):
            of_nodes[a, i] = 0.0
        if not tangent:
            continue
        for b in range(a + 1):
            turned_block(s, a, b, node, nodes[s, b], of_pairs, pair, T, R, D, stiffness)
            if a != b:
                turned_block(s, b, a, nodes[s, b], node, of_pairs, pair, T, R, D, stiffness)
            for i in range(36):
                of_pairs[pair, i] = 0.0
            pair += 1
        # the moment is seen in the axes of its own section, R^T v: half of its change (R^T v) x phi, as for all tangents
        o = 6 * a + 3
        v0, v1, v2 = 0.5 * force[s, a, 3], 0.5 * force[s, a, 4], 0.5 * force[s, a, 5]
        stiffness[s, o, o + 1] -= v2
        stiffness[s, o, o + 2] += v1
        stiffness[s, o + 1, o] += v2
        stiffness[s, o + 1, o + 2] -= v0
        stiffness[s, o + 2, o] -= v1
        stiffness[s, o + 2, o + 1] += v0


@inner
def turned_block(s, a, b, mine, node, of_pairs, pair, T, R, D, stiffness):
    """Block of the nodes a, b: rotations come in by T of b, moments go out by R^T of a."""
    for j in range(3):
        t0, t1, t2 = T[node, 0, j], T[node, 1, j], T[node, 2, j]
        for i in range(3):
            o = 6 * i
            stiffness[s, 6 * a + i, 6 * b + j] = of_pairs[pair, o + j]
            D[i, j] = (
                of_pairs[pair, 18 + o + 3] * t0 + of_pairs[pair, 18 + o + 4] * t1 + of_pairs[pair, 18 + o + 5] * t2
            )
            stiffness[s, 6 * a + i, 6 * b + 3 + j] = (
                of_pairs[pair, o + 3] * t0 + of_pairs[pair, o + 4] * t1 + of_pairs[pair, o + 5] * t2
            )
    for i in range(3):
        r0, r1, r2 = R[mine, 0, i], R[mine, 1, i], R[mine, 2, i]
        for j in range(3):
            stiffness[s, 6 * a + 3 + i, 6 * b + j] = (
                r0 * of_pairs[pair, 18 + j] + r1 * of_pairs[pair, 24 + j] + r2 * of_pairs[pair, 30 + j]
            )
            stiffness[s, 6 * a + 3 + i, 6 * b + 3 + j] = r0 * D[0, j] + r1 * D[1, j] + r2 * D[2, j]


@kernel
def turned(q, q0, theta, T):
    """Rotation vectors theta (N, 3), in space, from attitudes q0 to q (N, 4), and T (N, 3, 3), their change with a spin.

    T phi is the change of theta under the body rotation vector phi: inverse left tangent map times R.
    """
    R = np.empty((3, 3))
    for k in range(q.shape[0]):
        a0, a1, a2, a3 = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
        b0, b1, b2, b3 = q0[k, 0], -q0[k, 1], -q0[k, 2], -q0[k, 3]
        t0, t1, t2 = log_quaternion(
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        )
        theta[k, 0], theta[k, 1], theta[k, 2] = t0, t1, t2
        rotation_matrix(a0, a1, a2, a3, R)
        angle2 = t0 * t0 + t1 * t1 + t2 * t2
        # 1 - theta/2 x + f theta x theta x
        if angle2 < 1e-4:
            f = 1.0 / 12.0 + angle2 / 720.0
        else:
            half = 0.5 * sqrt(angle2)
            f = (1.0 - half * np.cos(half) / np.sin(half)) / angle2
        for j in range(3):
            v0, v1, v2 = R[0, j], R[1, j], R[2, j]
            c0, c1, c2 = t1 * v2 - t2 * v1, t2 * v0 - t0 * v2, t0 * v1 - t1 * v0
            e0, e1, e2 = t1 * c2 - t2 * c1, t2 * c0 - t0 * c2, t0 * c1 - t1 * c0
            T[k, 0, j] = v0 - 0.5 * c0 + f * e0
            T[k, 1, j] = v1 - 0.5 * c1 + f * e1
            T[k, 2, j] = v2 - 0.5 * c2 + f * e2


@inner
def rotation_matrix(a0, a1, a2, a3, R):
    R[0, 0] = 1.0 - 2.0 * (a2 * a2 + a3 * a3)
    R[0, 1] = 2.0 * (a1 * a2 - a0 * a3)
    R[0, 2] = 2.0 * (a1 * a3 + a0 * a2)
    R[1, 0] = 2.0 * (a1 * a2 + a0 * a3)
    R[1, 1] = 1.0 - 2.0 * (a1 * a1 + a3 * a3)
    R[1, 2] = 2.0 * (a2 * a3 - a0 * a1)
    R[2, 0] = 2.0 * (a1 * a3 - a0 * a2)
    R[2, 1] = 2.0 * (a2 * a3 + a0 * a1)
    R[2, 2] = 1.0 - 2.0 * (a1 * a1 + a2 * a2)
