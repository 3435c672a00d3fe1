"""From a state in space to the equilibrium of a model at rest, in one compiled call.

To hand an array over to compiled code costs a third of a microsecond, and a model has about fifty of them: as much as two
iterations of a few elements. Rule: what is the same for every solve of a model, tables and scratch, is handed over as one
object, `Kept`, made once; what changes comes in arrays and goes out in arrays of the caller. The scratch holds nothing
between two calls, and a call is not interrupted by another thread of Python: solves of one model may alternate.
"""

from __future__ import annotations

import numpy as np

from . import Kept, inner, kernel, planar
from .step import CONVERGED, copy_memory, copy_rows, newton


@kernel
def keep(beam, linear, rows, followers, frame, scratch):
    """What a model keeps for its solves at rest.

    beam, linear: as of `step.newton`. rows: nodes, left, right, held, owner of special vertices. followers: leader and its
    support of welded ones. frame: axes, base, node, across, normal as of `planar.enter` and the height of the nodes, or None
    in space. scratch: nodal, du, R, gap; r, q, sigma, g of the iterate; place and attitude of the supports in a plane.
    """
    return Kept(beam, linear, rows, followers, frame, scratch)


@inner
def flatten_places(frame, nodes, place, attitude, flat, p):
    """Places (n, 2) and complex numbers (n, 2) in the plane of places (n, 3) and quaternions (n, 4) in space."""
    (i, j, k), base = frame[0], frame[1]
    for m in range(place.shape[0]):
        flat[m, 0], flat[m, 1] = place[m, i], place[m, j]
        a, b = attitude[m], base[nodes[m]]
        p[m, 0] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        p[m, 1] = a[1 + k] * b[0] - a[0] * b[1 + k] - a[1 + i] * b[1 + j] + a[1 + j] * b[1 + i]


@inner
def into_space(frame, flat, p, sigma, flat_g, r, q, stress, g):
    """State and residual in space of those in the plane."""
    axes, base, node, across, normal, height = frame
    i, j, k = axes
    planar.leave(axes, base, node, across, normal, flat, p, sigma, r, q, stress)
    for m in range(g.shape[0]):
        r[m, k] = height[m]
        g[m, i], g[m, j], g[m, k] = flat_g[m, 0], flat_g[m, 1], 0.0
        for c in range(3):
            g[m, 3 + c] = flat_g[m, 2] * normal[m, c]


@kernel
def settle(size, space, plane, kept, targets, loads, offset, limits, controls, r, q, stress, g):
    """Equilibrium from a state by the plain Newton method, the guarded one, or the guarded one where the plain one fails.

    kept: see `keep`. targets: place (n, 3) and attitude (n, 4) of the supports, T (M, d, d) or empty. loads: nodes, force,
    moment, kinds, whether any depends on the attitude, whether any has a tangent, and what each adds (L, d), written.
    offset (N, d) or empty, limits: as of `step.newton`. controls: iterations of the plain and of the guarded method, 0 to
    leave it out; symmetric. r (N, 3), q (N, 4), stress (P, Q, 6 * LANES): the start, then the last iterate. g (N, 6): its
    residual, written.
    Returns (status, iterations, solves, residual evaluations, residual, its node, negative eigenvalues or -1, whether this
    is of the guarded method); solves and evaluations are those of both.
    """
    nodal, du, R, gap, x, turned, memory, residual, place, attitude = kept.scratch
    nodes, on_left, on_right, is_held, owns = kept.rows
    lead, lead_row = kept.followers
    load_nodes, force, moment, kinds, turning, has_tangent, each = loads
    plain, guarded, symmetric = controls
    if plane is not None:
        flatten_places(kept.frame, nodes, targets[0], targets[1], place, attitude)
    if space is not None:
        place, attitude = targets[0], targets[1]
    held = (nodes, on_left, on_right, is_held, owns, place, attitude, targets[2], lead, lead_row)
    table = (load_nodes, force, moment, kinds, turning)
    nothing, no_nodes, none = np.empty(0), np.empty(0, dtype=np.int64), np.empty((0, 0))
    inertia = (nothing, none, x, turned, du, du, du, nothing, no_nodes, none, none)
    blocks = nodal if has_tangent else nodal[:0]
    scratch = (residual, blocks, du, du, du, du, du, each, R, gap)
    status, iterations, value, where, negative, used = CONVERGED, 0, np.inf, 0, -1, False
    solves = checks = 0
    for attempt in range(2):
        used = attempt == 1
        most = guarded if used else plain
        if most == 0:
            continue
        if plane is not None:
            axes, base, node, across, normal, _ = kept.frame
            planar.enter(axes, base, node, across, normal, r, q, stress, x, turned, memory)
        if space is not None:
            copy_rows(r, x)
            copy_rows(q, turned)
            copy_memory(stress, memory)
        status, iterations, solved, checked, value, where, negative = newton(
            size, space, plane, kept.beam, kept.linear, held, inertia, table, offset, limits,
            (most, used, symmetric, np.int64(1)), none, x, turned, memory, scratch,
        )  # fmt: skip
        solves += solved
        checks += checked
        if status == CONVERGED or guarded == 0:
            break
    if plane is not None:
        into_space(kept.frame, x, turned, memory, residual, r, q, stress, g)
    if space is not None:
        copy_rows(x, r)
        copy_rows(turned, q)
        copy_memory(memory, stress)
        copy_rows(residual, g)
    return status, iterations, solves, checks, value, where, negative, used
