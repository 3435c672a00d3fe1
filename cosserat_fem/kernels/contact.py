"""Contact of a rod with a rigid part: the law between them, residual and tangent.

Rule: `reach` says at which points a rod is pressed; forces and stiffness are sums over these.

Law, per unit length of the unstressed rod, gap g, range G, scale P [N/m], x = g / G:
    barrier   p = P (2 (x - 1) ln x + (x - 1)^2 / x)  for x < 1: minus the derivative of -P G (x - 1)^2 ln x, twice smooth at
              x = 1 and infinite at 0 (Li and others 2020, Incremental Potential Contact, doi 10.1145/3386569.3392425, as a
              line density);
    friction  the slip of the surface since it was last at rest, at most `elastic` long, turned into a force of mu p at
              that length: true stick below, Coulomb slip above, and no scale of its own. Slip kept from before counts
              min(1, F0 / F) times, with the normal force F of its place, F0 then: pressed harder, it holds no more than
              before, or letting go would give back more work than was done (so Mindlin and Deresiewicz 1953, doi
              10.1115/1.4010702, of spheres). A place is a cell over an obstacle: the points in it have one memory, which
              `terms.touch.renewed` makes anew, so that a load that comes and goes lets nothing creep.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from . import fused, kernel, lean
from .rotation import log_quaternion

ABOUT_TO_SLIP = 0.999


@lean
def barrier(g, G, P):
    """Pressure p [N/m], -dp/dg [N/m^2] and potential [N] of the barrier at a gap g > 0."""
    if g >= G:
        return 0.0, 0.0, 0.0
    x = g / G
    l, m = log(x), x - 1.0
    over = m / x
    p = P * m * (2.0 * l + over)
    k = -P / G * (2.0 * l + over * (4.0 - over))
    return p, k, -P * G * m * m * l


@lean
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


@lean
def slide(u0, u1, u2, mu, elastic):
    """Friction per pressure, f u, of an elastic slip u, opposed by it; it changes by f du - g u (u . du).

    What is about to slip counts as slipping in g: a step begins where the last one left it, at its limit. Returns f, g.
    """
    square = u0 * u0 + u1 * u1 + u2 * u2
    size = sqrt(square)
    f = mu / max(size, elastic)
    return f, f / square if size > ABOUT_TO_SLIP * elastic else 0.0


@lean
def pressing(distance, law):
    """Pressure, -dp/dg and potential at a distance: barrier and layer."""
    core, G, P, soft, depth = law
    p, stiff, psi = barrier(distance - core, G, P)
    if soft > 0.0:
        p1, k1, psi1 = layer(core + G + depth - distance, soft, G)
        p, stiff, psi = p + p1, stiff + k1, psi + psi1
    return p, stiff, psi


@lean
def part_kept(rows, k, end, places, before, law):
    """Part of the slip kept at the place of which k is the first point, and its change with the place's normal force."""
    if before == 0.0:
        return 1.0, 0.0
    total = 0.0
    for j in range(k, end):
        if places[j] != places[k]:
            break
        total += rows[j, 1] * pressing(rows[j, 2], law)[0]
    if total <= before:
        return 1.0, 0.0
    return before / total, -before / (total * total)


@kernel
def press(rows, runs, nodes, coefficients, law, friction, rubbing, exact, force, stiffness, found):
    """Residual force (S, A, 6) and, if not empty, stiffness (S, 6 A, 6 A) of contact at points, for touched elements.

    rows: of `reach.find`; runs (S + 1,): where the points of each touched element begin; nodes (S, A); law (5,): core
    radius (distance at which the barrier is infinite), range, scale, stiffness and depth of a compliant layer; friction
    (3,): mu, elastic slip, lever (radius of the rod). rubbing: places (K,), numbers of which equal ones follow each other;
    kept (K, 3), their slip kept from before, and before (K,) [N], their normal force then; away, theta, T, R: of
    `moved_past`, since then. Empty without friction. exact: keep the part of the stiffness that pressure has by the
    curvature of the obstacle. found (K, 9): pressure, friction per pressure (3), slip (3), potential, part of the slip kept
    that counts; or empty. The stiffness is written whatever it was, the others must be zero.
    Returns the largest weight times stiffness [N/m].

    The stiffness at a point is the same for all pairs of nodes a, b but for a factor N_a N_b: it is summed over the points
    of an element in space, for a >= b, and put into the axes of the nodes once.
    """
    A = nodes.shape[1]
    sums = (
        np.zeros((A, 6)),
        np.zeros((A * (A + 1) // 2, 36)),
        np.zeros((A, 6, A, 3)),
        np.zeros((A, 6)),
        np.zeros((A, 3)),
    )
    return add_points(
        rows, runs, nodes, coefficients, law, friction, rubbing, exact, force, stiffness, found, sums, np.empty((2, 36))
    )


@lean
def add_points(rows, runs, nodes, coefficients, law, friction, rubbing, exact, force, stiffness, found, sums, room):
    """What `press` does, with room for sums over the points of an element, for shape functions and a point."""
    A = nodes.shape[1]
    of_nodes, of_pairs, by_force, pull, closing = sums
    N, point = room[0, :A], room[1]
    mu, elastic, lever = friction
    places, kept, before, away, theta, T, R = rubbing
    rubs, tangent, told, stiffest = mu > 0.0, stiffness.shape[0] > 0, found.shape[0] > 0, 0.0
    part, change = 1.0, 0.0
    for s in range(nodes.shape[0]):
        pressed_harder = False
        for k in range(runs[s], runs[s + 1]):
            w, n0, n1, n2 = rows[k, 1], rows[k, 3], rows[k, 4], rows[k, 5]
            p, stiff, psi = pressing(rows[k, 2], law)
            stiffest = max(stiffest, w * stiff)
            if told:
                found[k, 0], found[k, 7] = p, psi
            t = rows[k, 0] - 0.5
            for a in range(A):
                value = 0.0
                for j in range(A - 1, -1, -1):
                    value = value * t + coefficients[j, a]
                N[a] = value
            bend = p if exact else 0.0
            if not rubs:
                for a in range(A):
                    f = -w * p * N[a]
                    of_nodes[a, 0] += f * n0
                    of_nodes[a, 1] += f * n1
                    of_nodes[a, 2] += f * n2
                if tangent:
                    add_pressed(rows, k, w, stiff, bend, N, of_pairs)
                continue
            if k == runs[s] or places[k] != places[k - 1]:
                part, change = part_kept(rows, k, runs[s + 1], places, before[k], law)
            z0, z1, z2, t0, t1, t2 = part * kept[k, 0], part * kept[k, 1], part * kept[k, 2], 0.0, 0.0, 0.0
            for a in range(A):
                node, f = nodes[s, a], N[a]
                z0, z1, z2 = z0 + f * away[node, 0], z1 + f * away[node, 1], z2 + f * away[node, 2]
                t0, t1, t2 = t0 + f * theta[node, 0], t1 + f * theta[node, 1], t2 + f * theta[node, 2]
            nz = n0 * z0 + n1 * z1 + n2 * z2
            u0 = z0 - n0 * nz - lever * (t1 * n2 - t2 * n1)
            u1 = z1 - n1 * nz - lever * (t2 * n0 - t0 * n2)
            u2 = z2 - n2 * nz - lever * (t0 * n1 - t1 * n0)
            f, g = slide(u0, u1, u2, mu, elastic)
            m0, m1, m2 = f * u0, f * u1, f * u2
            if told:
                found[k, 1], found[k, 2], found[k, 3] = m0, m1, m2
                found[k, 4], found[k, 5], found[k, 6], found[k, 8] = u0, u1, u2, part
            c0, c1, c2 = n1 * m2 - n2 * m1, n2 * m0 - n0 * m2, n0 * m1 - n1 * m0
            for a in range(A):
                load = w * p * N[a]
                turning = -lever * load
                of_nodes[a, 0] += load * (m0 - n0)
                of_nodes[a, 1] += load * (m1 - n1)
                of_nodes[a, 2] += load * (m2 - n2)
                of_nodes[a, 3] += turning * c0
                of_nodes[a, 4] += turning * c1
                of_nodes[a, 5] += turning * c2
            if not tangent:
                continue
            rubbed_point(rows, k, p, stiff, bend, lever, (u0, u1, u2), f, g, (z0, z1, z2), (t0, t1, t2), point)
            pair = 0
            for a in range(A):
                for b in range(a + 1):
                    both = w * N[a] * N[b]
                    for j in range(36):
                        of_pairs[pair, j] += both * point[j]
                    pair += 1
            if change != 0.0:
                pressed_harder = True
                last = k + 1 == runs[s + 1] or places[k + 1] != places[k]
                add_kept(
                    rows, k, w, p, stiff, lever, (u0, u1, u2), f, g, kept[k], change, last, N, pull, closing, by_force
                )
        if rubs:
            settle_rubbed(s, nodes, T, R, of_nodes, of_pairs, tangent, force, stiffness)
            if pressed_harder:
                settle_kept(s, nodes, R, by_force, stiffness)
        else:
            settle(s, of_nodes, of_pairs, tangent, force, stiffness)
    return stiffest


@fused
def add_pressed(rows, k, w, stiff, bend, N, of_pairs):
    """Stiffness of a point without friction, k n n - p H, for all pairs of nodes."""
    n0, n1, n2 = rows[k, 3], rows[k, 4], rows[k, 5]
    along, across = w * stiff, w * bend
    k00, k01 = along * n0 * n0 - across * rows[k, 6], along * n0 * n1 - across * rows[k, 7]
    k02, k11 = along * n0 * n2 - across * rows[k, 8], along * n1 * n1 - across * rows[k, 9]
    k12, k22 = along * n1 * n2 - across * rows[k, 10], along * n2 * n2 - across * rows[k, 11]
    pair = 0
    for a in range(N.shape[0]):
        for b in range(a + 1):
            f = N[a] * N[b]
            of_pairs[pair, 0] += f * k00
            of_pairs[pair, 1] += f * k01
            of_pairs[pair, 2] += f * k02
            of_pairs[pair, 3] += f * k11
            of_pairs[pair, 4] += f * k12
            of_pairs[pair, 5] += f * k22
            pair += 1


@fused
def rubbed_point(rows, k, p, stiff, bend, lever, u, f, g, z, turn, point):
    """Change of force and moment on the rod at a point, seen in space (6, 6), with its place and rotation vector.

    Friction f u changes by f du - g u (u . du); u is normal to n. The slip changes by X dx + lever n x dtheta.
    """
    n0, n1, n2 = rows[k, 3], rows[k, 4], rows[k, 5]
    u0, u1, u2 = u
    z0, z1, z2 = z
    t0, t1, t2 = turn
    nz = n0 * z0 + n1 * z1 + n2 * z2
    c0, c1, c2 = u1 * n2 - u2 * n1, u2 * n0 - u0 * n2, u0 * n1 - u1 * n0
    fp, gp, sf = f * p, g * p, stiff * f
    lf, lg, arm = lever * fp, lever * gp, lever * lever
    for j in range(3):
        nj = n0 if j == 0 else n1 if j == 1 else n2
        H0, H1 = rows[k, 6 + j], rows[k, 7] if j == 0 else rows[k, 8 + j]
        H2 = rows[k, 8] if j == 0 else rows[k, 9 + j]
        Hz = nj + H0 * z0 + H1 * z1 + H2 * z2
        x0 = (1.0 if j == 0 else 0.0) - nz * H0 - n0 * Hz - lever * (t1 * H2 - t2 * H1)
        x1 = (1.0 if j == 1 else 0.0) - nz * H1 - n1 * Hz - lever * (t2 * H0 - t0 * H2)
        x2 = (1.0 if j == 2 else 0.0) - nz * H2 - n2 * Hz - lever * (t0 * H1 - t1 * H0)
        along = gp * (u0 * x0 + u1 * x1 + u2 * x2) + sf * nj
        v0, v1, v2 = fp * x0 - u0 * along, fp * x1 - u1 * along, fp * x2 - u2 * along
        normal = stiff * nj
        point[j] = v0 + n0 * normal - bend * H0
        point[6 + j] = v1 + n1 * normal - bend * H1
        point[12 + j] = v2 + n2 * normal - bend * H2
        # moment -lever n x (p f u)
        point[18 + j] = -lever * (n1 * v2 - n2 * v1) - lf * (H1 * u2 - H2 * u1)
        point[24 + j] = -lever * (n2 * v0 - n0 * v2) - lf * (H2 * u0 - H0 * u2)
        point[30 + j] = -lever * (n0 * v1 - n1 * v0) - lf * (H0 * u1 - H1 * u0)
    # lever p (f n x - g u (u x n)), and lever^2 p (f (I - n n) - g (u x n) (u x n)) of the moment
    point[3], point[4], point[5] = -lg * u0 * c0, -lf * n2 - lg * u0 * c1, lf * n1 - lg * u0 * c2
    point[9], point[10], point[11] = lf * n2 - lg * u1 * c0, -lg * u1 * c1, -lf * n0 - lg * u1 * c2
    point[15], point[16], point[17] = -lf * n1 - lg * u2 * c0, lf * n0 - lg * u2 * c1, -lg * u2 * c2
    fa, ga = arm * fp, arm * gp
    w01, w02, w12 = -fa * n0 * n1 - ga * c0 * c1, -fa * n0 * n2 - ga * c0 * c2, -fa * n1 * n2 - ga * c1 * c2
    point[21], point[22], point[23] = fa * (1.0 - n0 * n0) - ga * c0 * c0, w01, w02
    point[27], point[28], point[29] = w01, fa * (1.0 - n1 * n1) - ga * c1 * c1, w12
    point[33], point[34], point[35] = w02, w12, fa * (1.0 - n2 * n2) - ga * c2 * c2


@lean
def add_kept(rows, k, w, p, stiff, lever, u, f, g, kept, change, last, N, pull, closing, by_force):
    """What friction loses as the kept slip counts less with the normal force F of its place: pull (A, 6) of all its points,
    for a slip that counts one more, times `change` of that with F, times closing (A, 3), that of F with places of nodes.

    After the last point of the place they are multiplied into by_force (A, 6, A, 3).
    """
    n0, n1, n2 = rows[k, 3], rows[k, 4], rows[k, 5]
    u0, u1, u2 = u
    along = n0 * kept[0] + n1 * kept[1] + n2 * kept[2]
    d0, d1, d2 = kept[0] - n0 * along, kept[1] - n1 * along, kept[2] - n2 * along
    less = g * (u0 * d0 + u1 * d1 + u2 * d2)
    d0, d1, d2 = f * d0 - less * u0, f * d1 - less * u1, f * d2 - less * u2
    A = N.shape[0]
    for a in range(A):
        load, near = w * p * N[a], -w * stiff * N[a]
        pull[a, 0] += load * d0
        pull[a, 1] += load * d1
        pull[a, 2] += load * d2
        pull[a, 3] -= lever * load * (n1 * d2 - n2 * d1)
        pull[a, 4] -= lever * load * (n2 * d0 - n0 * d2)
        pull[a, 5] -= lever * load * (n0 * d1 - n1 * d0)
        closing[a, 0] += near * n0
        closing[a, 1] += near * n1
        closing[a, 2] += near * n2
    if last:
        for a in range(A):
            for i in range(6):
                for b in range(A):
                    for j in range(3):
                        by_force[a, i, b, j] += pull[a, i] * change * closing[b, j]
        for a in range(A):
            for i in range(6):
                pull[a, i] = 0.0
            for j in range(3):
                closing[a, j] = 0.0


@lean
def settle_kept(s, nodes, R, by_force, stiffness):
    """Add by_force (A, 6, A, 3), with moments put into the axes of the nodes, to the stiffness of an element; clear it."""
    A = nodes.shape[1]
    for a in range(A):
        node = nodes[s, a]
        for b in range(A):
            for j in range(3):
                m0, m1, m2 = by_force[a, 3, b, j], by_force[a, 4, b, j], by_force[a, 5, b, j]
                for i in range(3):
                    stiffness[s, 6 * a + i, 6 * b + j] += by_force[a, i, b, j]
                    turned = R[node, 0, i] * m0 + R[node, 1, i] * m1 + R[node, 2, i] * m2
                    stiffness[s, 6 * a + 3 + i, 6 * b + j] += turned
                for i in range(6):
                    by_force[a, i, b, j] = 0.0


@lean
def settle(s, of_nodes, of_pairs, tangent, force, stiffness):
    """Write the sums over the points of an element without friction, and clear them."""
    A, pair = of_nodes.shape[0], 0
    if tangent:
        block = stiffness[s]
        for i in range(6 * A):
            for j in range(6 * A):
                block[i, j] = 0.0
    for a in range(A):
        for i in range(3):
            force[s, a, i] = of_nodes[a, i]
            of_nodes[a, i] = 0.0
        if not tangent:
            continue
        for b in range(a + 1):
            k00, k01, k02 = of_pairs[pair, 0], of_pairs[pair, 1], of_pairs[pair, 2]
            k11, k12, k22 = of_pairs[pair, 3], of_pairs[pair, 4], of_pairs[pair, 5]
            for turn in range(2):
                i, j = (6 * a, 6 * b) if turn == 0 else (6 * b, 6 * a)
                block[i, j], block[i, j + 1], block[i, j + 2] = k00, k01, k02
                block[i + 1, j], block[i + 1, j + 1], block[i + 1, j + 2] = k01, k11, k12
                block[i + 2, j], block[i + 2, j + 1], block[i + 2, j + 2] = k02, k12, k22
            for i in range(6):
                of_pairs[pair, i] = 0.0
            pair += 1


@lean
def settle_rubbed(s, nodes, T, R, of_nodes, of_pairs, tangent, force, stiffness):
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
            other = nodes[s, b]
            turned_block(of_pairs[pair], T[other], R[node], stiffness[s, 6 * a : 6 * a + 6, 6 * b : 6 * b + 6])
            if a != b:
                turned_block(of_pairs[pair], T[node], R[other], stiffness[s, 6 * b : 6 * b + 6, 6 * a : 6 * a + 6])
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


@fused
def turned_block(B, T, R, K):
    """Block K (6, 6) of two nodes from sums B (36,): rotations come in by T of one, moments go out by R^T of the other."""
    t00, t01, t02 = T[0, 0], T[0, 1], T[0, 2]
    t10, t11, t12 = T[1, 0], T[1, 1], T[1, 2]
    t20, t21, t22 = T[2, 0], T[2, 1], T[2, 2]
    for i in range(3):
        l0, l1, l2 = B[6 * i + 3], B[6 * i + 4], B[6 * i + 5]
        K[i, 0], K[i, 1], K[i, 2] = B[6 * i], B[6 * i + 1], B[6 * i + 2]
        K[i, 3] = l0 * t00 + l1 * t10 + l2 * t20
        K[i, 4] = l0 * t01 + l1 * t11 + l2 * t21
        K[i, 5] = l0 * t02 + l1 * t12 + l2 * t22
    for i in range(3):
        r0, r1, r2 = R[0, i], R[1, i], R[2, i]
        for j in range(3):
            K[3 + i, j] = r0 * B[18 + j] + r1 * B[24 + j] + r2 * B[30 + j]
        w0 = r0 * B[21] + r1 * B[27] + r2 * B[33]
        w1 = r0 * B[22] + r1 * B[28] + r2 * B[34]
        w2 = r0 * B[23] + r1 * B[29] + r2 * B[35]
        K[3 + i, 3] = w0 * t00 + w1 * t10 + w2 * t20
        K[3 + i, 4] = w0 * t01 + w1 * t11 + w2 * t21
        K[3 + i, 5] = w0 * t02 + w1 * t12 + w2 * t22


@kernel
def moved_past(r, q, r0, q0, turn, S, shift, away, theta, T, R):
    """How nodes have moved past a part that went from y to S y + shift meanwhile, S of the quaternion turn (4,).

    r, q and r0, q0: places (N, 3) and attitudes (N, 4) now and then; away (N, 3): r less where r0 would be if it had gone
    with the part; theta, T, R: as of `turned`, with q0 turned by S.
    """
    s0, s1, s2, s3 = turn[0], turn[1], turn[2], turn[3]
    gone, before = np.empty(4), np.empty(4)
    for k in range(r.shape[0]):
        for i in range(3):
            with_part = S[i, 0] * r0[k, 0] + S[i, 1] * r0[k, 1] + S[i, 2] * r0[k, 2] + shift[i]
            away[k, i] = r[k, i] - with_part
            before[i] = q0[k, i]
        before[3] = q0[k, 3]
        gone[0] = s0 * before[0] - s1 * before[1] - s2 * before[2] - s3 * before[3]
        gone[1] = s0 * before[1] + s1 * before[0] + s2 * before[3] - s3 * before[2]
        gone[2] = s0 * before[2] - s1 * before[3] + s2 * before[0] + s3 * before[1]
        gone[3] = s0 * before[3] + s1 * before[2] - s2 * before[1] + s3 * before[0]
        turn_of_node(q[k], gone, theta[k], T[k], R[k])


@kernel
def turned(q, q0, theta, T, R):
    """Rotation vectors theta (N, 3), in space, from attitudes q0 to q (N, 4), and T (N, 3, 3), their change with a spin.

    T phi is the change of theta under the body rotation vector phi: inverse left tangent map times R (N, 3, 3), of q.
    """
    for k in range(q.shape[0]):
        turn_of_node(q[k], q0[k], theta[k], T[k], R[k])


@lean
def turn_of_node(q, q0, theta, T, R):
    """As `turned`, of one node."""
    a0, a1, a2, a3 = q[0], q[1], q[2], q[3]
    b0, b1, b2, b3 = q0[0], -q0[1], -q0[2], -q0[3]
    t0, t1, t2 = log_quaternion(
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )
    theta[0], theta[1], theta[2] = t0, t1, t2
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
        T[0, j] = v0 - 0.5 * c0 + f * e0
        T[1, j] = v1 - 0.5 * c1 + f * e1
        T[2, j] = v2 - 0.5 * c2 + f * e2


@lean
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
