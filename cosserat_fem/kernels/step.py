"""The Newton method, and steps in time, in compiled code: for a single group of rods under loads that a table gives.

The same iteration as `newton.Newton`, which takes every model and is its readable form, in space (d = 6 unknowns a node) and
in a plane (d = 3), at rest and in time. A solve of a few elements costs tens of microseconds, which the glue between kernels
would multiply. What differs between space and plane stands in the small functions at the top: `size` is a tuple with d
entries; of `space` and `plane` one is None, so that its branch is not even compiled.
"""

from __future__ import annotations

import numpy as np

from . import condense, inner, kernel, planar
from .chain import (
    back_substitute_segments,
    eliminate_segments,
    hold_vertices,
    solve_joints,
    transform_vertices,
    untransform_vertices,
)
from .inertia import step_inertia, step_rates
from .loads import add_loads
from .nodes import largest_increment, largest_residual
from .rotation import fill_matrices, relative_vector, rotate_bodies

CONVERGED, NOT_FINITE, TOO_MANY, SINGULAR, DIVERGES, INDEFINITE, FORCES = 0, 1, 2, 3, 4, 5, 6
STAGNANT = 32.0
NEARLY = 2e-3  # of the diagonal: an asymmetry that slows the iteration down by less than it costs
SMALLEST_SHIFT, LARGEST_SHIFT = 1e-6, 1e12
TINY, FELL = 1e-8, 1e-3  # an increment after which only round-off is left, if the residual fell by so much
LARGEST_TURN = 0.8  # rad in one guarded step
FASTEST = 2.0  # rad in one step in time
GROWTH = 4.0  # a step longer than this many of the last one starts with b = a


@inner
def make_symmetric(nodal, stiffness):
    """True, and nodal (N, d, d) replaced by its symmetric part, if it is nearly symmetric: elimination then costs half.

    stiffness: of the rods against turning one node, which stands beside nodal on the diagonal.
    """
    d = nodal.shape[1]
    for k in range(nodal.shape[0]):
        for i in range(d):
            for j in range(i):
                apart = nodal[k, i, j] - nodal[k, j, i]
                if abs(apart) > NEARLY * (stiffness + np.sqrt(abs(nodal[k, i, i] * nodal[k, j, j]))):
                    return False
    for k in range(nodal.shape[0]):
        for i in range(d):
            for j in range(i):
                nodal[k, i, j] = nodal[k, j, i] = 0.5 * (nodal[k, i, j] + nodal[k, j, i])
    return True


@inner
def outside(space, plane, loads, q, each, R, g, nodal):
    """Add the loads to g (N, d) and, if it is not empty, nodal (N, d, d)."""
    nodes, force, moment, kinds, turning = loads
    if plane is not None:
        planar.add_loads(nodes, q, force, moment, kinds, each, g, nodal)
    if space is not None:
        if turning:
            fill_matrices(q, R)
            add_loads(nodes, R, force, moment, kinds, each, g, nodal)
        else:
            for m in range(nodes.shape[0]):
                for i in range(3):
                    each[m, i], each[m, 3 + i] = -force[m, i], 0.0
                    g[nodes[m], i] -= force[m, i]


@inner
def rates(space, plane, inertia, moved, q, D, v, a, b):
    """Increment D and rates (N, d) at the end of a step."""
    _, _, _, q0, v0, a0, b0, coefficients, driven, v_driven, a_driven = inertia
    if plane is not None:
        planar.step_rates(moved, q0, q, v0, a0, b0, coefficients, driven, v_driven, a_driven, D, v, a, b)
    if space is not None:
        step_rates(moved, q0, q, v0, a0, b0, coefficients, driven, v_driven, a_driven, D, v, a, b)


@inner
def add_inertia(space, plane, inertia, D, v, a, g, nodal):
    """Add the inertia force and its tangent; return the largest force and moment at a node."""
    largest = (0.0, 0.0)
    if plane is not None:
        largest = planar.step_inertia(inertia[0], inertia[1], a, inertia[7], g, nodal)
    if space is not None:
        largest = step_inertia(inertia[0], inertia[1], D, v, a, inertia[7], g, nodal)
    return largest


@inner
def add_forces(space, plane, beam, r, q, g):
    """Add the internal force; return the largest section force and moment."""
    conn, n_elements, N, N_s, dx, C, C_full, reference, _, _ = beam
    largest = (0.0, 0.0)
    if plane is not None:
        largest = planar.residual(conn, n_elements, N, N_s, dx, C, reference, r, q, g)
    if space is not None:
        largest = condense.residual(conn, n_elements, N, N_s, dx, C, C_full, reference, r, q, g)
    return largest


@inner
def add_tangent(space, plane, beam, linear, r, q, sigma, g, nodal, mu, symmetric):
    """Add the internal force and condense the tangent; return largest force and moment, and negative pivots."""
    conn, n_elements, N, N_s, dx, C, C_full, reference, owner, shift = beam
    S, rhs, factor = linear[0], linear[1], linear[2]
    none, largest = np.empty((0, 0, 0)), (0.0, 0.0, 0)
    if plane is not None:
        largest = planar.assemble(
            conn, n_elements, N, N_s, dx, C, reference, sigma, r, q, g, owner, nodal, shift, mu, symmetric, S, rhs, factor,
            none,
        )  # fmt: skip
    if space is not None:
        largest = condense.assemble(
            conn, n_elements, N, N_s, dx, C, C_full, reference, sigma, r, q, g, owner, nodal, np.empty(0, dtype=np.int64),
            none, shift, mu, symmetric, S, rhs, factor, none,
        )  # fmt: skip
    return largest


@inner
def extrapolate(space, plane, beam, r, q, du, sigma):
    """New stress memory for an increment, before the update."""
    conn, _, N, N_s, _, C, C_full, reference, _, _ = beam
    if plane is not None:
        planar.extrapolate_stress(conn, N, N_s, C, reference, r, q, du, sigma)
    if space is not None:
        condense.extrapolate_stress(conn, N, N_s, C, C_full, reference, r, q, du, 1.0, sigma)


@inner
def turn_nodes(space, plane, q, du):
    """Turn the nodes by the rotations of du (N, d)."""
    if plane is not None:
        planar.turn(q, du)
    if space is not None:
        rotate_bodies(q, du[:, 3:], q)


@inner
def find_gap(size, space, plane, held, r, q, gap):
    """What is missing (M, d) at special vertices, along the unknowns there; return its largest shift and turn."""
    nodes, is_held, place, attitude, T, lead_row = held[0], held[3], held[5], held[6], held[7], held[9]
    n, d = place.shape[0], len(size)
    moves = (d + 1) // 2
    if plane is not None:
        planar.fill_gap(nodes, place, attitude, r, q, gap)
    if space is not None:
        for m in range(n):
            for i in range(3):
                gap[m, i] = place[m, i] - r[nodes[m], i]
            gap[m, 3], gap[m, 4], gap[m, 5] = relative_vector(q[nodes[m]], attitude[m])
    for m in range(n, nodes.shape[0]):  # welded ones follow
        for i in range(d):
            gap[m, i] = gap[lead_row[m - n], i] if lead_row[m - n] >= 0 else 0.0
    shift = turn = 0.0
    y = np.empty(d)
    for m in range(nodes.shape[0]):
        if T.shape[0] > 0:
            for i in range(d):
                y[i] = 0.0
                for j in range(d):
                    y[i] += T[m, j, i] * gap[m, j]
            for i in range(d):
                gap[m, i] = y[i]
        for i in range(d):
            if not is_held[m, i]:
                gap[m, i] = 0.0
            if i < moves:
                shift = max(shift, abs(gap[m, i]))
            else:
                turn = max(turn, abs(gap[m, i]))
    return shift, turn


@inner
def along_unknowns(size, held, g):
    """Residual (N, d) along the unknowns of special vertices; shares of welded ones are moved to the first of a joint."""
    nodes, place, T, lead = held[0], held[5], held[7], held[8]
    n, d = place.shape[0], len(size)
    if T.shape[0] == 0 and lead.shape[0] == 0:
        return g
    out, y = g.copy(), np.empty(d)
    for k in range(lead.shape[0]):
        for i in range(d):
            out[lead[k], i] += g[nodes[n + k], i]
            out[nodes[n + k], i] = 0.0
    if T.shape[0] > 0:
        for m in range(n):
            for i in range(d):
                y[i] = 0.0
                for j in range(d):
                    y[i] += T[m, j, i] * out[nodes[m], j]
            for i in range(d):
                out[nodes[m], i] = y[i]
    return out


@inner
def solve(size, space, plane, beam, linear, held, gap, g, symmetric, left, du):
    """du (N, d) from the condensed tangent; left (N, d): scratch. Returns (negative pivots, singular node or -1)."""
    S, rhs, factor, segments, kept, joint_S, joint_rhs, joint_nodes, joint_index, band, y = linear
    nodes, on_left, on_right, is_held, owns, _, _, T, _, _ = held
    for k in range(g.shape[0]):
        for i in range(len(size)):
            left[k, i] = -g[k, i]
    if T.shape[0] > 0:
        transform_vertices(size, S, rhs, left, nodes, on_left, on_right, T)
    if nodes.shape[0] > 0:
        hold_vertices(size, S, rhs, left, nodes, on_left, on_right, is_held, gap, owns)
    negative = eliminate_segments(size, S, rhs, left, segments, symmetric, kept, joint_S, joint_rhs)
    if negative < 0:
        return 0, -1 - negative
    if joint_nodes.shape[0] > 0:
        more = solve_joints(size, segments, joint_S, joint_rhs, left, joint_nodes, joint_index, band, y)
        if more < 0:
            return 0, joint_nodes[0]
        negative += more
    back_substitute_segments(size, segments, kept, y, du)
    if T.shape[0] > 0:
        untransform_vertices(size, nodes, T, du)
    if beam[0].shape[1] > 2:
        if plane is not None:
            planar.back_substitute(beam[0], beam[1], factor, du)
        if space is not None:
            condense.back_substitute(beam[0], beam[1], factor, du)
    return negative, largest_increment(du)[2]


@kernel
def newton(
    size, space, plane, beam, linear, held, inertia, loads, offset, limits, controls, moved, r, q, sigma, scratch
):
    """Solve in place: place r, attitude q and the stress memory sigma of all nodes, from their prediction.

    In time the displacement `moved` is summed up by itself: as a difference of places it would lose digits, and with it
    momentum.

    size: see `chain`; space, plane: True and None, or None and True. beam: conn, number of elements, N, N_s, dx, C, C_full
    (None in a plane), reference, owner, shift. linear: scratch of the chain; nodes of joints and which joint each belongs
    to; scratch of the joints. held: nodes, left, right, held, owner (M, ...), place and attitude of the supports (n, ...),
    T (M, d, d) or empty, and for the welded ones
    that follow (M - n,) the node and the support (or -1) of their joint's first. inertia: mass (empty: at rest), J, r0, q0,
    v0, a0, b0, coefficients, driven, v_driven, a_driven. loads: nodes, force, moment, kinds, whether any depends on the
    attitude. offset (N, d) or empty: added to the residual. limits: tolerance, length, mean element, round-off of forces, of
    moments, gap of places, stiffness against turning a node. controls: largest number of iterations, guarded, symmetric,
    and how many iterations it will take at least, so that no residual is computed before without the tangent.
    scratch: g, nodal (empty if no load has a tangent, at rest), du, D, v, a, b, what each load adds, R, gap.
    Returns (status, iterations, solves, residual evaluations, residual in units of the tolerance, node of the largest,
    negative eigenvalues or -1).
    """
    tolerance, length, element, force_noise, moment_noise, closed, stiffness = limits
    iterations, guarded, symmetric, expected = controls
    g, nodal, du, D, v, a, b, each, R, gap = scratch
    nodes, is_held, n = held[0], held[3], held[5].shape[0]
    in_time = inertia[0].shape[0] > 0
    no_nodal, r0, left = nodal[:0], inertia[2], np.empty_like(g)
    done = checks = solves = 0
    before, small, tiny, near, cheap = np.inf, False, False, False, False
    value, where, negative, mu = np.inf, 0, -1, SMALLEST_SHIFT if guarded else 0.0
    while True:
        g[:] = 0.0
        blocks = no_nodal if cheap else nodal
        blocks[:] = 0.0
        F = M = 0.0
        if loads[0].shape[0] > 0:
            outside(space, plane, loads, q, each, R, g, blocks)
        if in_time:
            rates(space, plane, inertia, moved, q, D, v, a, b)
            F, M = add_inertia(space, plane, inertia, D, v, a, g, blocks)
        for k in range(offset.shape[0]):
            for i in range(offset.shape[1]):
                g[k, i] += offset[k, i]
        pivots = 0
        if cheap:
            checks += 1
            force, moment = add_forces(space, plane, beam, r, q, g)
        else:
            if in_time:
                symmetric = make_symmetric(nodal, stiffness)
            force, moment, pivots = add_tangent(space, plane, beam, linear, r, q, sigma, g, nodal, mu, symmetric)
        F, M = max(F, force), max(M, moment)
        force_limit = tolerance * max(F, M / length) + force_noise
        moment_limit = tolerance * max(M, F * element) + moment_noise
        value, where = largest_residual(
            along_unknowns(size, held, g), nodes[:n], is_held[:n], force_limit, moment_limit
        )
        if not value < np.inf:
            return NOT_FINITE, done, solves, checks, value, where, negative
        shift, turn = find_gap(size, space, plane, held, r, q, gap)
        met = value <= 1.0 or (
            value <= STAGNANT and ((small and value > 0.5 * before) or (tiny and value < FELL * before))
        )
        if done > 0 and met and shift <= closed and turn <= 1e-11:
            if not np.isfinite(F + M):
                return FORCES, done, solves, checks, value, where, negative
            if symmetric and not in_time and (not near or negative > 0):
                # few iterations were made: the last factorisation had stresses of a state further away
                du[:] = 0.0
                extrapolate(space, plane, beam, r, q, du, sigma)
                again, mu = np.zeros_like(g), SMALLEST_SHIFT
                nodal[:] = 0.0
                if loads[0].shape[0] > 0:
                    outside(space, plane, loads, q, each, R, again, nodal)
                _, _, pivots = add_tangent(space, plane, beam, linear, r, q, sigma, again, nodal, mu, symmetric)
                negative, bad = solve(size, space, plane, beam, linear, held, gap, again, symmetric, left, du)
                negative = negative + pivots if bad < 0 else -1
            return CONVERGED, done, solves, checks, value, where, negative
        if cheap:
            cheap = False
            continue
        if done == iterations:
            return TOO_MANY, done, solves, checks, value, where, negative
        near = small and mu <= SMALLEST_SHIFT  # stability counts only without the shift
        solves += 1
        count, bad = solve(size, space, plane, beam, linear, held, gap, g, symmetric, left, du)
        if guarded and (bad >= 0 or (symmetric and count + pivots > 0)):
            if mu > LARGEST_SHIFT:
                return INDEFINITE, done, solves, checks, value, where, negative
            mu = max(1.0, 4.0 * mu)
            continue
        if bad >= 0:
            return SINGULAR, done, solves, checks, value, bad, negative
        negative = count + pivots if symmetric else -1
        shift, turn, _ = largest_increment(du)
        scale = 1.0
        if guarded:
            scale = min(1.0, LARGEST_TURN / turn) if turn > 0.0 else 1.0
        elif ((done == 1 or done == 2) and turn > 2.0) or (done > 2 and turn > 1.0):
            return DIVERGES, done, solves, checks, value, where, negative
        old = sigma.copy() if scale < 1.0 else sigma
        extrapolate(space, plane, beam, r, q, du, sigma)
        if scale < 1.0:  # the memory is an unknown of the mixed method: it takes the same part of its step
            for k in range(du.shape[0]):
                for i in range(du.shape[1]):
                    du[k, i] *= scale
            for m in range(sigma.shape[0]):
                for i in range(sigma.shape[1]):
                    for l in range(sigma.shape[2]):
                        sigma[m, i, l] = (1.0 - scale) * old[m, i, l] + scale * sigma[m, i, l]
        for k in range(r.shape[0]):
            for i in range(r.shape[1]):
                if in_time:
                    moved[k, i] += du[k, i]
                    r[k, i] = r0[k, i] + moved[k, i]
                else:
                    r[k, i] += du[k, i]
        turn_nodes(space, plane, q, du)
        done += 1
        before = value
        small = turn < 1e-3 and shift < 1e-3 * length
        tiny = not in_time and turn < TINY and shift < TINY * length
        cheap = scale == 1.0 and small and mu <= SMALLEST_SHIFT and done >= expected
        if guarded and scale == 1.0:
            mu = mu / 4.0 if mu >= 4e-3 else SMALLEST_SHIFT


@inner
def copy_rows(source, target):
    """target = source, (n, m)."""
    for k in range(target.shape[0]):
        for i in range(target.shape[1]):
            target[k, i] = source[k, i]


@inner
def copy_memory(source, target):
    """target = source, (n, m, l)."""
    for k in range(target.shape[0]):
        copy_rows(source[k], target[k])


@inner
def dot_rows(nodes, old, new, D, work):
    """work (L,) -= the mean of the forces old and new (L, d) at nodes times the increments D (N, d)."""
    for m in range(nodes.shape[0]):
        total = 0.0
        for i in range(D.shape[1]):
            total += (old[m, i] + new[m, i]) * D[nodes[m], i]
        work[m] -= 0.5 * total


@inner
def keep_state(state, kept, m, work, iterations, value, step):
    """Copy a state, the work so far and what its step took to place m of what is kept."""
    r, q, sigma, v, a, b, g, _ = state
    kept_r, kept_q, kept_sigma, kept_v, kept_a, kept_b, kept_g, kept_work, told, which = kept
    copy_rows(r, kept_r[m])
    copy_rows(q, kept_q[m])
    copy_memory(sigma, kept_sigma[m])
    copy_rows(v, kept_v[m])
    copy_rows(a, kept_a[m])
    copy_rows(b, kept_b[m])
    copy_rows(g, kept_g[m])
    for k in range(work.shape[0]):
        kept_work[m, k] = work[k]
    told[m, 0], told[m, 1], which[m] = iterations, value, step


@kernel
def run_steps(
    size,
    space,
    plane,
    beam,
    linear,
    rows,
    places,
    inertia,
    loads,
    limits,
    controls,
    method,
    steps,
    state,
    work,
    kept,
    scratch,
):
    """Steps in time, each as `integrator.Run` makes it with a fixed step, until one fails or turns a section too far.

    rows: nodes, left, right, held, owner of supported vertices; T; leader and its support of welded ones. places: for each
    of some times place, attitude (K, n, ...) of the supports, driven rates v, a (K, M, d) and driven nodes (M,). inertia:
    mass, J, round-off of both as a force per acceleration. loads: nodes, force, moment (K, L, ...), kinds, whether any
    depends on the attitude. limits, controls: as of `newton`. method: am, af, beta, gamma. steps: length of the step before,
    lengths (n,), numbers of the load table and of the place (n,), whether to keep the state (n,). state: r, q, sigma, v, a,
    b, g (N, d), what each load adds: changed in place. work (L + 1,): of each load and of the driven ends so far, added to.
    kept: as state but for the loads, with a leading axis, and work, iterations and residual, number of the step; the last
    state is kept in any case. scratch: as of `newton`, with r, q, sigma, moved, b and coefficients.
    Returns (steps made, iterations, residual evaluations, kept states).
    """
    nodes, on_left, on_right, is_held, owns, T, leads, lead_rows = rows
    place, attitude, v_driven, a_driven, driven = places
    mass, J, force_grain, moment_grain = inertia
    load_nodes, force, moment, kinds, turning = loads
    tolerance, length, element, force_noise, moment_noise, closed, stiffness = limits
    am, af, beta, gamma = method
    h_before, h, load_of, place_of, keeps = steps
    r, q, sigma, v, a, b, g, each = state
    g1, nodal, du, D, v1, a1, b1, each1, R, gap, r1, q1, sigma1, moved, b0, coefficients = scratch
    moves, none = r.shape[1], np.empty((0, 0))
    most, guarded, symmetric, expected = controls
    made = iterations = checks = n_kept = done = 0
    value = 0.0
    coefficients[1], coefficients[2], coefficients[3], coefficients[4] = am, af, beta, gamma
    for s in range(h.shape[0]):
        dt, fastest = h[s], 0.0
        for k in range(v.shape[0]):
            for i in range(moves, v.shape[1]):
                fastest = max(fastest, abs(v[k, i]))
        if fastest * dt > FASTEST:
            break
        grown = dt / h_before if dt <= GROWTH * h_before else 0.0
        for k in range(b.shape[0]):
            for i in range(b.shape[1]):
                b0[k, i] = b[k, i] if dt == h_before else a[k, i] + grown * (b[k, i] - a[k, i])
        coefficients[0] = dt
        grows = (1.0 - am) / ((1.0 - af) * beta * dt * dt)
        bounds = (
            tolerance, length, element, force_noise + grows * force_grain,
            moment_noise + grows * moment_grain, closed, stiffness,
        )  # fmt: skip
        w, p = load_of[s], place_of[s]
        held = (nodes, on_left, on_right, is_held, owns, place[p], attitude[p], T, leads, lead_rows)
        rates_before = (mass, J, r, q, v, a, b0, coefficients, driven, v_driven[p], a_driven[p])
        table = (load_nodes, force[w], moment[w], kinds, turning)
        status = TOO_MANY
        for attempt in range(2):  # unresolved vibrations make b a bad guess
            part = 0.5 * dt * dt if attempt == 0 else 0.0
            for k in range(du.shape[0]):
                for i in range(du.shape[1]):
                    du[k, i] = dt * v[k, i] + part * b0[k, i]
            extrapolate(space, plane, beam, r, q, du, sigma1)
            copy_rows(q, q1)
            turn_nodes(space, plane, q1, du)
            for k in range(r.shape[0]):
                for i in range(moves):
                    moved[k, i] = du[k, i]
                    r1[k, i] = r[k, i] + du[k, i]
            status, taken, solved, more, left, _, _ = newton(
                size, space, plane, beam, linear, held, rates_before, table, none, bounds,
                (most, guarded, symmetric, expected), moved, r1, q1, sigma1, (g1, nodal, du, D, v1, a1, b1, each1, R, gap),
            )  # fmt: skip
            iterations += solved
            checks += more
            if status == CONVERGED:
                break
        if status != CONVERGED:
            break
        done, value, expected = taken, left, taken
        dot_rows(load_nodes, each, each1, D, work)
        total = 0.0
        for k in range(D.shape[0]):
            for i in range(D.shape[1]):
                total += (g[k, i] + g1[k, i]) * D[k, i]
        work[load_nodes.shape[0]] += 0.5 * total
        copy_rows(r1, r)
        copy_rows(q1, q)
        copy_rows(v1, v)
        copy_rows(a1, a)
        copy_rows(b1, b)
        copy_rows(g1, g)
        copy_rows(each1, each)
        copy_memory(sigma1, sigma)
        made, h_before = made + 1, dt
        if keeps[s]:
            keep_state(state, kept, n_kept, work, done, tolerance * value, s)
            n_kept += 1
    if made > 0 and not keeps[made - 1]:
        keep_state(state, kept, n_kept, work, done, tolerance * value, made - 1)
        n_kept += 1
    return made, iterations, checks, n_kept
