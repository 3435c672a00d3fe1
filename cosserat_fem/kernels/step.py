"""The Newton method of one time step in compiled code, for a single group of rods without joints.

The same iteration as `newton.Newton.in_time`, which takes every model and is its readable form: here loads come as a
table, supports hold translations or rotations as a whole. A step of a few elements costs tens of microseconds, which the
glue between kernels would multiply.
"""

from __future__ import annotations

import numpy as np

from . import inner, kernel
from .chain import back_substitute_segments, eliminate_segments, hold_vertices
from .condense import assemble, back_substitute, extrapolate_stress, residual
from .inertia import step_inertia, step_rates
from .loads import add_loads
from .nodes import largest_increment, largest_residual
from .rotation import fill_matrices, relative_rotation, rotate_bodies

CONVERGED, NOT_FINITE, TOO_MANY, SINGULAR, DIVERGES = 0, 1, 2, 3, 4
STAGNANT = 32.0
NEARLY = 2e-3  # of the diagonal: an asymmetry that slows the iteration down by less than it costs


@inner
def make_symmetric(nodal, stiffness):
    """True, and nodal (N, 6, 6) replaced by its symmetric part, if it is nearly symmetric: elimination then costs half.

    stiffness: of the rods against turning one node, which stands beside nodal on the diagonal.
    """
    for k in range(nodal.shape[0]):
        for i in range(6):
            for j in range(i):
                apart = nodal[k, i, j] - nodal[k, j, i]
                if abs(apart) > NEARLY * (stiffness + np.sqrt(abs(nodal[k, i, i] * nodal[k, j, j]))):
                    return False
    for k in range(nodal.shape[0]):
        for i in range(6):
            for j in range(i):
                nodal[k, i, j] = nodal[k, j, i] = 0.5 * (nodal[k, i, j] + nodal[k, j, i])
    return True


@kernel
def newton_step(beam, linear, held, inertia, loads, limits, iterations, moved, r, q, sigma, scratch):
    """Solve one step in place: displacement moved, place r (N, 3), q (N, 4) and the stress memory, from their prediction.

    The displacement is summed up by itself: as a difference of places it would lose digits, and with it momentum.

    beam: conn, number of elements, N, N_s, dx, C, C_full, reference, owner. linear: scratch of the chain. held: nodes,
    left, right, held, owner, place (M, 3), quaternion (M, 4). inertia: mass, J, r0, q0, v0, a0, b0, coefficients, driven,
    v_driven, a_driven. loads: nodes, force, moment, kinds. limits: tolerance, length, mean element, round-off of forces,
    of moments, gap of places, stiffness against turning a node. scratch: g, nodal, du, D, v, a, b, what each load adds, R.
    Returns (status, iterations, residual evaluations, residual in units of the tolerance, node of the largest).
    """
    conn, n_elements, N, N_s, dx, C, C_full, reference, owner = beam
    S, rhs, factor, segments, kept, joint_S, joint_rhs = linear
    nodes, left, right, is_held, leads, place, attitude = held
    mass, J, r0, q0, v0, a0, b0, coefficients, driven, v_driven, a_driven = inertia
    load_nodes, force, moment, kinds = loads
    tolerance, length, element, force_noise, moment_noise, closed, stiffness = limits
    g, nodal, du, D, v, a, b, each, R = scratch
    none, rows, no_joint = np.empty((0, 0, 0)), np.empty((0, 0)), np.empty((0, 6))
    untouched = np.empty(0, dtype=np.int64)
    no_blocks, turned = np.empty((0, 6, 6)), np.empty_like(q)
    gap = np.zeros((nodes.shape[0], 6))
    done = checks = 0
    before, small, cheap = np.inf, False, False
    value, where = np.inf, 0
    while True:
        step_rates(moved, q0, q, v0, a0, b0, coefficients, driven, v_driven, a_driven, D, v, a, b)
        g[:] = 0.0
        blocks = no_blocks if cheap else nodal
        blocks[:] = 0.0
        if load_nodes.shape[0] > 0:
            fill_matrices(q, R)
            add_loads(load_nodes, R, force, moment, kinds, each, g, blocks)
        inertia_force, inertia_moment = step_inertia(mass, J, D, v, a, coefficients, g, blocks)
        if cheap:
            checks += 1
            section_force, section_moment = residual(conn, n_elements, N, N_s, dx, C, C_full, reference, r, q, g)
        else:
            symmetric = make_symmetric(nodal, stiffness)
            section_force, section_moment, _ = assemble(
                conn, n_elements, N, N_s, dx, C, C_full, reference, sigma, r, q, g, owner, nodal, untouched, none,
                rows, 0.0, symmetric, S, rhs, factor, none,
            )  # fmt: skip
        F, M = max(section_force, inertia_force), max(section_moment, inertia_moment)
        force_limit = tolerance * max(F, M / length) + force_noise
        moment_limit = tolerance * max(M, F * element) + moment_noise
        value, where = largest_residual(g, nodes, is_held, force_limit, moment_limit)
        if not value < np.inf:
            return NOT_FINITE, done, checks, value, where
        turns = relative_rotation(q[nodes], attitude)
        shift_gap = turn_gap = 0.0
        for m in range(nodes.shape[0]):
            for i in range(3):
                gap[m, i] = place[m, i] - r[nodes[m], i] if is_held[m, i] else 0.0
                gap[m, 3 + i] = turns[m, i] if is_held[m, 3 + i] else 0.0
                shift_gap, turn_gap = max(shift_gap, abs(gap[m, i])), max(turn_gap, abs(gap[m, 3 + i]))
        met = value <= 1.0 or (small and 0.5 * before < value <= STAGNANT)
        if done > 0 and met and shift_gap <= closed and turn_gap <= 1e-11:
            return CONVERGED, done, checks, value, where
        if cheap:
            cheap = False
            continue
        if done == iterations:
            return TOO_MANY, done, checks, value, where
        for k in range(g.shape[0]):
            for i in range(6):
                g[k, i] = -g[k, i]
        if nodes.shape[0] > 0:
            hold_vertices(S, rhs, g, nodes, left, right, is_held, gap, leads)
        if eliminate_segments(S, rhs, g, segments, symmetric, kept, joint_S, joint_rhs) < 0:
            return SINGULAR, done, checks, value, where
        back_substitute_segments(segments, kept, no_joint, du)
        if conn.shape[1] > 2:
            back_substitute(conn, n_elements, factor, du)
        shift, turn, bad = largest_increment(du)
        if bad >= 0:
            return SINGULAR, done, checks, value, bad
        if ((done == 1 or done == 2) and turn > 2.0) or (done > 2 and turn > 1.0):
            return DIVERGES, done, checks, value, where
        extrapolate_stress(conn, N, N_s, C, C_full, reference, r, q, du, 1.0, sigma)
        for k in range(r.shape[0]):
            for i in range(3):
                moved[k, i] += du[k, i]
                r[k, i] = r0[k, i] + moved[k, i]
        rotate_bodies(q, du[:, 3:], turned)
        q[:] = turned
        done += 1
        before = value
        small = turn < 1e-3 and shift < 1e-3 * length
        cheap = small
