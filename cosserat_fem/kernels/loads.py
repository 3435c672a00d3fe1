"""One force and moment at nodes, dead or following, and its tangent.

A force F adds -F and a moment M adds -h_j . M, with h_j the spatial axis about which unknown j turns the section
(columns of H: directors for quaternions, axes of the three turns for Kardan angles). Derivatives along j: of a following
vector v it is h_j x v; of h_i it is h_j x h_i / 2 for body rotation vectors (symmetric second order of the exponential)
and h_j x h_i for j < i, else 0, for Kardan angles.
"""

from __future__ import annotations

import numpy as np

from . import inner, kernel


@inner
def cross_column(a, i, v, out):
    """out = (column i of a) x v."""
    out[0] = a[1, i] * v[2] - a[2, i] * v[1]
    out[1] = a[2, i] * v[0] - a[0, i] * v[2]
    out[2] = a[0, i] * v[1] - a[1, i] * v[0]


@inner
def turned_vector(R, v, follows, out):
    """out = R v if it follows the section, else v."""
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2] if follows else v[i]


@inner
def one_load(R, H, force, moment, force_follows, moment_follows, drop_tangential, in_angles, tangent, work, f, K):
    """Write the residual f (6,) and, if tangent, its derivative K (6, 6) of one load. work (3, 3): scratch."""
    F, M, d = work[0], work[1], work[2]
    turned_vector(R, force, force_follows, F)
    turned_vector(R, moment, moment_follows, M)
    along = 0.0
    if drop_tangential:
        along = F[0] * R[0, 2] + F[1] * R[1, 2] + F[2] * R[2, 2]
    for i in range(3):
        f[i] = along * R[i, 2] - F[i]
        f[3 + i] = -(H[0, i] * M[0] + H[1, i] * M[1] + H[2, i] * M[2])
    if not tangent:
        return
    for i in range(6):
        for j in range(6):
            K[i, j] = 0.0
    for j in range(3):
        if force_follows:
            cross_column(H, j, F, d)
            for i in range(3):
                K[i, 3 + j] = -d[i]
        elif drop_tangential:
            cross_column(H, j, R[:, 2], d)
            change = F[0] * d[0] + F[1] * d[1] + F[2] * d[2]
            for i in range(3):
                K[i, 3 + j] = change * R[i, 2] + along * d[i]
        cross_column(H, j, M, d)
        for i in range(3):
            turned = H[0, i] * d[0] + H[1, i] * d[1] + H[2, i] * d[2]  # h_i . (h_j x M)
            part = 0.5
            if in_angles:
                part = 1.0 if j < i else 0.0
            K[3 + i, 3 + j] = (part - (1.0 if moment_follows else 0.0)) * turned


@kernel
def each_load(R, H, force, moment, kinds, in_angles, g, K):
    """Write the residual g (L, 6) and, if K (L, 6, 6) is not empty, its derivative, of loads at nodes with R, H (L, 3, 3).

    force, moment (L, 3); kinds (L, 3): force follows, moment follows, tangential part of the force dropped.
    """
    work, none = np.empty((3, 3)), np.empty((6, 6))
    tangent = K.shape[0] > 0
    for m in range(force.shape[0]):
        block = K[m] if tangent else none
        one_load(
            R[m],
            H[m],
            force[m],
            moment[m],
            kinds[m, 0],
            kinds[m, 1],
            kinds[m, 2],
            in_angles,
            tangent,
            work,
            g[m],
            block,
        )


@kernel
def add_loads(nodes, R, force, moment, kinds, each, g, nodal):
    """Add loads at nodes (L,), force and moment (L, 3), to g (N, 6) and, if it is not empty, nodal (N, 6, 6).

    As `each_load`, for body rotation vectors. R (N, 3, 3); each (L, 6): written, what each load adds to g.
    """
    work, K = np.empty((3, 3)), np.empty((6, 6))
    tangent = nodal.shape[0] > 0
    for m in range(nodes.shape[0]):
        k = nodes[m]
        one_load(
            R[k], R[k], force[m], moment[m], kinds[m, 0], kinds[m, 1], kinds[m, 2], False, tangent, work, each[m], K
        )
        for i in range(6):
            g[k, i] += each[m, i]
            if tangent:
                for j in range(6):
                    nodal[k, i, j] += K[i, j]


@kernel
def loads_in_space(nodes, q, g, out):
    """Force and moment out (n, 6) in space of a residual g (N, 6), moments about the section's axes, at nodes (n,)."""
    for m in range(nodes.shape[0]):
        k = nodes[m]
        w, x, y, z = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
        a, b, c = g[k, 3], g[k, 4], g[k, 5]
        d0, d1, d2 = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)  # v + w d + u x d
        for i in range(3):
            out[m, i] = g[k, i]
        out[m, 3] = a + w * d0 + y * d2 - z * d1
        out[m, 4] = b + w * d1 + z * d0 - x * d2
        out[m, 5] = c + w * d2 + x * d1 - y * d0
