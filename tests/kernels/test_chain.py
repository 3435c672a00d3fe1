"""Condensation, supports and block elimination against a dense solution of the same system."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration.linear import LinearSolver
from cosserat_fem.iteration.newton import Newton
from helpers import curved_space


def dense_solution(model, state, g, held, mu=0.0):
    """Full matrix of all terms, unknowns transformed and held as the constraints say, solved by numpy."""
    c, n = model.constraints, model.space.n_nodes
    K = model.matrix(state).toarray() + np.diag(mu * model.shift.ravel())
    columns, gap = [], []
    follow = set(map(int, c.nodes[c.n_supports :]))
    T = np.zeros((6 * n, 0))
    rows = {int(k): row for row, k in enumerate(c.nodes[: c.n_supports])}
    leaders = dict(zip(map(int, c.nodes[c.n_supports :]), map(int, c.lead), strict=True))
    for node in range(n):
        if node in follow:
            continue
        block = np.zeros((6 * n, 6))
        block[6 * node : 6 * node + 6] = held.T[rows[node]] if node in rows and len(held.T) else np.eye(6)
        for f, lead in leaders.items():
            if lead == node:
                block[6 * f : 6 * f + 6] = held.T[list(c.nodes).index(f)]
        columns.append(block)
        gap.append(
            [
                (held.gap[rows[node], i] if c.held[rows[node], i] else np.nan) if node in rows else np.nan
                for i in range(6)
            ]
        )
    T, gap = np.concatenate(columns, axis=1), np.concatenate(gap)
    A, b = T.T @ K @ T, -T.T @ g.ravel()
    for row, couple in zip(held.at, held.couples, strict=True):
        free = [k for k in range(n) if k not in follow]
        at = 6 * free.index(int(c.nodes[row]))
        A[at : at + 6, at : at + 6] += couple
    fixed = ~np.isnan(gap)
    y = np.where(fixed, gap, 0.0)
    y[~fixed] = np.linalg.solve(A[np.ix_(~fixed, ~fixed)], b[~fixed] - A[np.ix_(~fixed, fixed)] @ y[fixed])
    negative = int((np.linalg.eigvalsh(0.5 * (A + A.T)[np.ix_(~fixed, ~fixed)]) < 0).sum())
    return (T @ y).reshape(n, 6), negative


def frame(orders=(3, 2), *, tilted=True):
    """Three rods: two welded at an angle in the middle of the first, a ring closed on itself; guides and a cardan."""
    section = cf.Section(force_stiffness=(30.0, 40.0, 50.0), moment_stiffness=(0.7, 1.1, 0.9))
    beam = cf.Rod("beam", section, [(0, 0, 0), (0.6, 0.3, 0), (1, 0, 0.2)], n_elements=5, order=orders[0])
    meet = beam.drawn(np.array([0.45]))[0]
    branch = cf.Rod("branch", section, [meet, meet + (0.1, 0.5, 0.4)], n_elements=4, order=orders[1])
    loop = [
        meet + 0.3 * np.array([np.sin(a), 1 - np.cos(a), 0.1 * a * (2 * np.pi - a)])
        for a in np.linspace(0, 2 * np.pi, 9)
    ]
    ring = cf.Rod("ring", section, loop, n_elements=6, order=orders[0])
    free = ("x", "ry") if tilted else ()
    supports = [
        cf.Clamp(beam, "start", free=free, frame=np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])),
        cf.Clamp(beam, "end", free=("rx", "rz") if tilted else ()),
        cf.Pin(branch, "end"),
        cf.Weld(beam, 0.45, branch, "start"),
        cf.Weld(ring, "start", beam, 0.45),
        cf.Weld(ring, "end", branch, "start"),
    ]
    return cf.Model([beam, branch, ring], supports)


def shaken(model, rng, size=0.05):
    """A strained state with a stress memory of its own."""
    state = model.initial_state()
    state = model.space.update(state, size * rng.normal(size=(model.space.n_nodes, 6)))
    return cf.State(0.0, state.r, state.q, tuple(m + rng.normal(size=m.shape) for m in state.stress), state.angles)


@pytest.mark.parametrize("mu", [0.0, 2.0])
@pytest.mark.parametrize("orders", [(1, 1), (3, 2), (4, 6)])
def test_network_equals_dense_solution(orders, mu, rng):
    """Joints, a ring, guides and a cardan joint: the fast path solves the same system as the plain sum of blocks."""
    model = frame(orders)
    state = shaken(model, rng)
    solver = LinearSolver(model.space, model.constraints)
    total = model.condensed(state, solver.scratch, mu, None)
    targets = model.constraints.targets(0.0)
    held = model.constraints.evaluate(state, targets, rng.normal(size=(3, 3)))
    expected, negative = dense_solution(model, state, total.g, held, mu)
    found = solver.solve(state, total.g, held, total.negative, True)
    np.testing.assert_allclose(found.du, expected, atol=1e-9 * abs(expected).max())
    assert found.negative in (negative, -1)


@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.parametrize("coupled", [False, True])
def test_chain_counts_negative_eigenvalues(order, coupled, rng):
    """One rod: solution and inertia count, for an indefinite matrix."""
    model, state = curved_space(order, coupled=coupled)
    state = cf.State(0.0, state.r, state.q, tuple(m - 60.0 for m in state.stress))
    solver = LinearSolver(model.space, model.constraints)
    total = model.condensed(state, solver.scratch, 0.0, None)
    held = model.constraints.evaluate(state, model.constraints.targets(0.0))
    expected, negative = dense_solution(model, state, total.g, held)
    found = solver.solve(state, total.g, held, total.negative, True)
    np.testing.assert_allclose(found.du, expected, atol=1e-8 * abs(expected).max())
    assert found.negative == negative
    assert negative > 0


def test_unsymmetric_tangent(rng):
    """Moments and following forces make the tangent unsymmetric: the pivoting variant solves it."""
    section = cf.Section(force_stiffness=(30.0, 40.0, 50.0), moment_stiffness=(0.7, 1.1, 0.9))
    rod = cf.Rod("r", section, [(0, 0, 0), (0.5, 0.2, 0), (1, 0, 0.3)], n_elements=5, order=3)
    loads = [
        cf.PointLoad(rod, "end", force=(1, 2, 3), moment=(3, 1, -2)),
        cf.PointLoad(rod, 0.4, force=(2, 0, 5), moment=(0, 2, 2), follower=True),
        cf.LineLoad(rod, (3, 2, 1), (1, 0, 1), follower=True),
        cf.LineLoad(rod, (3, 2, 1), components="normal"),
    ]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], loads)
    assert not model.symmetric
    state = shaken(model, rng)
    newton = Newton(model)
    total = model.condensed(state, newton.linear.scratch, 0.0, None)
    held = model.constraints.evaluate(state, model.constraints.targets(0.0))
    expected, _ = dense_solution(model, state, total.g, held)
    found = newton.linear.solve(state, total.g, held, total.negative, model.symmetric)
    np.testing.assert_allclose(found.du, expected, atol=1e-9 * abs(expected).max())
    assert found.negative == -1
