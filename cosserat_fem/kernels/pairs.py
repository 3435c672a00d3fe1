"""Contact between rods: residual and tangent at pairs of places.

Rule: every place of one rod meets the nearest one of the other, and the other way round, each with half of the force, so
that neither is preferred. With c the shape functions of the first rod and minus those of the second, d n = x1 - x2, the
distance changes by n . w, w = sum of c dr, and the second place slides by ((t . w) / d + n . dx2') / (t . t / d - n . x2'').
Forces act at one point between the surfaces, so that their sum and their moment vanish. The law is that of
`kernels.contact`, and so is friction: the slip of one surface over the other, seen turning with both.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from . import kernel, lean
from .contact import part_kept, pressing, slide


@lean
def shape(coefficients, xi, N, D):
    """Shape functions N and their derivatives D (A,) at xi."""
    A, t = N.shape[0], xi - 0.5
    for a in range(A):
        value, d = coefficients[A - 1, a], 0.0
        for k in range(A - 2, -1, -1):
            d = d * t + value
            value = value * t + coefficients[k, a]
        N[a], D[a] = value, d


@lean
def cross(a, b, out):
    a0, a1, a2, b0, b1, b2 = a[0], a[1], a[2], b[0], b[1], b[2]
    out[0], out[1], out[2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@lean
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@lean
def turn_by(theta, E, J):
    """Rotation matrix E and left tangent map J (3, 3) of a rotation vector."""
    angle2 = dot(theta, theta)
    if angle2 < 1e-6:
        f, g, h = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = sqrt(angle2)
        f, g, h = sin(angle) / angle, (1.0 - cos(angle)) / angle2, (angle - sin(angle)) / (angle2 * angle)
    for i in range(3):
        for j in range(3):
            E[i, j], J[i, j] = g * theta[i] * theta[j], h * theta[i] * theta[j]
        E[i, i] += 1.0 - g * angle2
        J[i, i] += 1.0 - h * angle2
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        E[k, j] += f * theta[i]
        E[j, k] -= f * theta[i]
        J[k, j] += g * theta[i]
        J[j, k] -= g * theta[i]


@kernel
def shapes_at(coefficients, xi, out):
    """Shape functions out[0] (K, A) and their derivatives out[1] (K, A) at xi (K,)."""
    for k in range(xi.shape[0]):
        shape(coefficients, xi[k], out[0, k], out[1, k])


@kernel
def press_pairs(
    rows, nodes1, nodes2, second, slot, coefficients, laws, friction, rubbing, exact, force, stiffness, found
):  # fmt: skip
    """Residual force (S, A + B, 6) and, if not empty, stiffness (S, 6 (A + B), 6 (A + B)) of contact between rods.

    rows: of `reach.find`; nodes1 (K, A): of the element of the first place; nodes2 (K, B), second (2, K, B): those that move
    the second place, their shape functions there and the derivatives of these by its xi; slot (K,): which block; laws
    (K, 7): core distance, range, scale, stiffness and depth of a layer, radius of both rods; friction (2,): mu, elastic
    slip. rubbing: places (K,), kept (K, 3), before (K,) as for `contact.press`, but before counts all of a point; r0 (N, 3):
    where nodes were then; theta, T, R: of `contact.turned`. exact: with the curvature of the distance. found (K, 9): as of
    `contact.press`. Returns the largest weight times stiffness.

    In the stiffness the normal force of a place that reaches over two blocks counts for each of them alone.
    """
    places, kept, before, r0, theta, T, R = rubbing
    A, B = nodes1.shape[1], nodes2.shape[1]
    N1, D1 = np.empty(A), np.empty(A)
    n, t, x2, m, nm, z, u = (
        np.empty(3), np.empty(3), np.empty(3), np.zeros(3), np.zeros(3), np.empty(3), np.empty(3),
    )  # fmt: skip
    v, spin, turn1, turn2, mean, slide1, fade, Ev, old = (
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3),
        np.empty(3),
    )  # fmt: skip
    E, J = np.empty((3, 3)), np.empty((3, 3))
    df, dm, dn, du, dz, one, two, w = (
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip
    dspin, moment = np.empty(3), np.empty(3)
    mu, elastic = friction
    rubs, tangent, stiffest = mu > 0.0, stiffness.shape[0] > 0, 0.0
    columns, part, change = 6 if rubs else 3, 1.0, 0.0
    pull, near = np.zeros((A + B, 6)), np.zeros((A + B, 3))
    for k in range(rows.shape[0]):
        row, s = rows[k], slot[k]
        core, G, P, soft, depth, a1, a2 = laws[k]
        d, weight = row[2], 0.5 * row[1]
        law = (core, G, P, soft, depth)
        p, stiff, psi = pressing(d, law)
        stiffest = max(stiffest, weight * stiff)
        shape(coefficients, row[0], N1, D1)
        N2, D2 = second[0, k], second[1, k]
        for i in range(3):
            n[i], t[i], x2[i] = row[3 + i], row[8 + i], row[11 + i]
        free = row[14] > 0.0
        bend = dot(t, t) / d - dot(n, x2)
        if bend <= 0.0:
            free = False
        l1, l2 = a1 * d / (a1 + a2), a2 * d / (a1 + a2)
        if rubs:
            if k == 0 or places[k] != places[k - 1]:
                part, change = part_kept(rows, k, rows.shape[0], places, before[k], law)
            for i in range(3):
                turn1[i] = turn2[i] = v[i] = slide1[i] = fade[i] = 0.0
                for a in range(A):
                    node = nodes1[k, a]
                    turn1[i] += N1[a] * theta[node, i]
                    v[i] += N1[a] * r0[node, i]
                for a in range(B):
                    node = nodes2[k, a]
                    turn2[i] += N2[a] * theta[node, i]
                    v[i] -= N2[a] * r0[node, i]
                    slide1[i] += D2[a] * r0[node, i]
                    fade[i] += D2[a] * theta[node, i]
                v[i] -= part * kept[k, i]
                mean[i] = 0.5 * (turn1[i] + turn2[i])
                spin[i] = turn1[i] - turn2[i]
            turn_by(mean, E, J)
            for i in range(3):
                Ev[i] = E[i, 0] * v[0] + E[i, 1] * v[1] + E[i, 2] * v[2]
                old[i] = E[i, 0] * slide1[0] + E[i, 1] * slide1[1] + E[i, 2] * slide1[2]
                z[i] = d * n[i] - Ev[i]
            nz = dot(n, z)
            cross(spin, n, one)
            for i in range(3):
                u[i] = z[i] - n[i] * nz - 0.5 * (l1 - l2) * one[i]
            rub, fall = slide(u[0], u[1], u[2], mu, elastic)
            for i in range(3):
                m[i] = rub * u[i]
            cross(n, m, nm)
            for i in range(3):
                found[k, 4 + i] = u[i]
            found[k, 8] = part
        found[k, 0], found[k, 7] = p, psi
        for i in range(3):
            found[k, 1 + i] = m[i]
        for a in range(A + B):
            b = a - A
            c = N1[a] if a < A else -N2[b]
            for i in range(3):
                force[s, a, i] += weight * c * p * (m[i] - n[i])
            if rubs:
                node, lever = (nodes1[k, a], l1 * c) if a < A else (nodes2[k, b], -l2 * c)
                for i in range(3):
                    total = R[node, 0, i] * nm[0] + R[node, 1, i] * nm[1] + R[node, 2, i] * nm[2]
                    moment[i] = -weight * lever * p * total
                    force[s, a, 3 + i] += moment[i]
                if tangent:  # half of the moment's change with its own section's axes, as for all tangents
                    o = 6 * a + 3
                    stiffness[s, o, o + 1] -= 0.5 * moment[2]
                    stiffness[s, o, o + 2] += 0.5 * moment[1]
                    stiffness[s, o + 1, o] += 0.5 * moment[2]
                    stiffness[s, o + 1, o + 2] -= 0.5 * moment[0]
                    stiffness[s, o + 2, o] -= 0.5 * moment[1]
                    stiffness[s, o + 2, o + 1] += 0.5 * moment[0]
        if not tangent:
            continue
        if change != 0.0:  # as of `contact.add_kept`
            for i in range(3):
                one[i] = E[i, 0] * kept[k, 0] + E[i, 1] * kept[k, 1] + E[i, 2] * kept[k, 2]
            along = dot(n, one)
            for i in range(3):
                du[i] = one[i] - n[i] * along
            along = dot(u, du)
            for i in range(3):
                dm[i] = rub * du[i] - fall * u[i] * along
            cross(n, dm, two)
            for a in range(A + B):
                c = N1[a] if a < A else -N2[a - A]
                node, lever = (nodes1[k, a], l1 * c) if a < A else (nodes2[k, a - A], -l2 * c)
                for i in range(3):
                    pull[a, i] += weight * c * p * dm[i]
                    total = R[node, 0, i] * two[0] + R[node, 1, i] * two[1] + R[node, 2, i] * two[2]
                    pull[a, 3 + i] -= weight * lever * p * total
                    near[a, i] -= row[1] * stiff * c * n[i]
            if k + 1 == rows.shape[0] or places[k + 1] != places[k] or slot[k + 1] != s:
                for a in range(A + B):
                    for i in range(6):
                        for b in range(A + B):
                            for j in range(3):
                                stiffness[s, 6 * a + i, 6 * b + j] += pull[a, i] * change * near[b, j]
                pull[:] = 0.0
                near[:] = 0.0
        for e in range(A + B):
            g = e - A
            ce = N1[e] if e < A else -N2[g]
            for j in range(columns):
                slid = 0.0
                for i in range(3):
                    w[i] = one[i] = two[i] = 0.0
                if j < 3:
                    w[j] = ce
                    if free and exact:
                        slid = (t[j] * ce / d + (n[j] * D2[g] if e >= A else 0.0)) / bend
                else:
                    node = nodes1[k, e] if e < A else nodes2[k, g]
                    for i in range(3):
                        if e < A:
                            one[i] = N1[e] * T[node, i, j - 3]
                        else:
                            two[i] = N2[g] * T[node, i, j - 3]
                closing = dot(n, w)
                dp = -stiff * closing
                for i in range(3):
                    dn[i] = (w[i] - n[i] * closing - t[i] * slid) / d if exact else 0.0
                if not rubs:
                    for i in range(3):
                        df[i] = -dp * n[i] - p * dn[i]
                else:
                    for i in range(3):
                        two[i] += fade[i] * slid
                        dspin[i] = one[i] - two[i]
                        dm[i] = 0.5 * (one[i] + two[i])
                    for i in range(3):
                        dz[i] = J[i, 0] * dm[0] + J[i, 1] * dm[1] + J[i, 2] * dm[2]
                    cross(dz, Ev, one)
                    for i in range(3):
                        dz[i] = w[i] - t[i] * slid - one[i] + old[i] * slid
                    normal = dot(n, dz) + dot(dn, z)
                    cross(dspin, n, one)
                    cross(spin, dn, two)
                    cross(spin, n, du)
                    for i in range(3):
                        apart = 0.5 * (l1 - l2) * (one[i] + two[i]) + 0.5 * (l1 - l2) / d * closing * du[i]
                        du[i] = dz[i] - n[i] * normal - dn[i] * nz - apart
                    along = dot(u, du)
                    for i in range(3):
                        dm[i] = rub * du[i] - fall * u[i] * along
                        df[i] = dp * (m[i] - n[i]) + p * (dm[i] - dn[i])
                    cross(dn, m, one)
                    cross(n, dm, two)
                    for i in range(3):  # of d p n x m
                        one[i] = (closing * p + d * dp) * nm[i] + d * p * (one[i] + two[i])
                at = 6 * e + j
                for a in range(A + B):
                    b = a - A
                    c = N1[a] if a < A else -N2[b]
                    dc = 0.0 if a < A else -D2[b] * slid
                    for i in range(3):
                        stiffness[s, 6 * a + i, at] += weight * (c * df[i] + dc * p * (m[i] - n[i]))
                    if rubs:
                        node = nodes1[k, a] if a < A else nodes2[k, b]
                        lever = (a1 if a < A else -a2) / (a1 + a2)
                        for i in range(3):
                            total = 0.0
                            for q in range(3):
                                total += R[node, q, i] * (c * one[q] + dc * d * p * nm[q])
                            stiffness[s, 6 * a + 3 + i, at] -= weight * lever * total
    return stiffest
