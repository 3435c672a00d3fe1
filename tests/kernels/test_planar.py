"""The planar element is the quaternion element of space in a plane, to round-off, and its tangent that of its residual."""

from dataclasses import replace

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration.border import border
from cosserat_fem.kernels import planar


def planar_model(plane="xy", order=3, n_elements=5, normal=None):
    """One bent rod with different bending stiffnesses in a plane, clamped at its start."""
    i, j = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}[plane]
    points = np.zeros((4, 3))
    points[:, i], points[:, j] = [0, 0.4, 0.9, 1.1], [0, 0.3, 0.2, 0.6]
    points[:, 3 - i - j] = 0.7
    section = cf.Section(
        force_stiffness=(3.0, 4.0, 5.0), moment_stiffness=(0.7, 1.1, 0.9), mass_per_length=0.3,
        rotary_inertia=(2e-3, 1e-3, 3e-3),
    )  # fmt: skip
    rod = cf.Rod("r", section, points, n_elements=n_elements, order=order, length=1.5, normal=normal)
    return cf.Model([rod], [cf.Clamp(rod, "start")], plane=plane)


def bent(model, rng, size=0.2):
    """A state in the plane with a stress memory, at random."""
    du = model.plane.in_space(size * rng.normal(size=(model.space.n_nodes, 3)))
    state = model.space.update(model.initial_state(), du)
    made = model.remember(border)
    r, q, sigma = made.take(state)
    return made, made.give(state, r, q, sigma + rng.normal(size=sigma.shape))


def residual_of(made, r, q):
    g = np.zeros((len(r), 3))
    N_s, dx, C, _, reference = made.tables
    planar.residual(*made.beam, N_s, dx, C, reference, r, q, g)
    return g


def matrices_of(made, r, q, sigma):
    """Element matrices (E, 3A, 3A), nodes in connectivity order."""
    N_s, dx, C, _, reference = made.tables
    A, E = made.group.order + 1, made.group.n_elements
    K, none = np.empty((E, 3 * A, 3 * A)), np.empty((0, 0, 0))
    planar.assemble(
        *made.beam, N_s, dx, C, reference, sigma, r, q, np.zeros((len(r), 3)), made.owner, none, made.shift, 0.0, True,
        none, np.empty((0, 0)), np.empty((0, 0)), K,
    )  # fmt: skip
    order = np.concatenate([3 * ((a - 2) if a >= 2 else a + A - 2) + np.arange(3) for a in range(A)])
    return K[:, order][:, :, order]


@pytest.mark.parametrize("plane", ["xy", "yz", "xz"])
@pytest.mark.parametrize("order", [1, 3])
def test_planar_element_is_that_of_space(plane, order, rng):
    model = planar_model(plane, order)
    made, state = bent(model, rng)
    r, q, sigma = made.take(state)
    in_space = np.zeros((model.space.n_nodes, 6))
    _, _, matrices = model.internal.full(state, model.space, in_space)
    g = residual_of(made, r, q)
    np.testing.assert_allclose(model.plane.rates(in_space), g, atol=1e-13 * abs(g).max())
    np.testing.assert_allclose(model.plane.in_space(g), in_space, atol=1e-13 * abs(g).max())
    turn = np.zeros((model.space.n_nodes, 6, 3))  # planar unknowns of a node in space
    for k in range(3):
        turn[:, :, k] = model.plane.in_space(np.tile(np.eye(3)[k], (model.space.n_nodes, 1)))
    conn = made.group.conn
    E, A = conn.shape
    B = np.zeros((E, 6 * A, 3 * A))
    for a in range(A):
        B[:, 6 * a : 6 * a + 6, 3 * a : 3 * a + 3] = turn[conn[:, a]]
    expected = np.swapaxes(B, 1, 2) @ matrices[0] @ B
    K = matrices_of(made, r, q, sigma)
    np.testing.assert_allclose(K, expected, atol=1e-13 * abs(expected).max())
    out = np.abs(matrices[0] @ B - B @ K).max()  # no force out of the plane
    assert out < 1e-13 * abs(expected).max()


def test_tangent_is_that_of_the_residual(rng):
    """With the stresses of the strains as memory the matrices are the Hessian, also of the turning of nodes."""
    model = planar_model()
    made, state = bent(model, rng)
    state = replace(state, stress=model.internal.with_stress(state, model.space))
    r, q, sigma = made.take(state)
    n, h = len(r), 1e-6
    K = np.zeros((3 * n, 3 * n))
    for nodes, block in zip(made.group.conn, matrices_of(made, r, q, sigma), strict=True):
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        K[np.ix_(dofs, dofs)] += block
    for dof in range(3 * n):
        du = np.zeros((n, 3))
        du.ravel()[dof] = h
        sides = []
        for sign in (1, -1):
            turned = q.copy()
            planar.turn.py_func(turned, sign * du)
            sides.append(residual_of(made, r + sign * du[:, :2], turned).ravel())
        difference = (sides[0] - sides[1]) / (2 * h)
        np.testing.assert_allclose(K[:, dof], difference, atol=2e-8 * abs(K).max())


def test_stress_memory_is_extrapolated_along_the_increment(rng):
    model = planar_model()
    made, state = bent(model, rng)
    r, q, sigma = made.take(state)
    du = 1e-2 * rng.normal(size=(len(r), 3))
    N_s, _, C, _, reference = made.tables
    planar.extrapolate_stress(made.beam[0], made.beam[2], N_s, C, reference, r, q, du, sigma)
    expected = model.internal.extrapolate(state, model.space, model.plane.in_space(du), 1.0)[0]
    given = made.give(state, r, q, sigma).stress[0]
    np.testing.assert_allclose(given, expected, atol=1e-13 * abs(expected).max())


def test_a_state_comes_back_from_the_plane(rng):
    model = planar_model("xz")
    made, state = bent(model, rng)
    again = made.give(state, *made.take(state))
    for name in ("r", "q"):
        np.testing.assert_allclose(getattr(again, name), getattr(state, name), atol=1e-15)
    np.testing.assert_allclose(again.stress[0], state.stress[0], atol=1e-14)
