"""The quaternion element: kernel = form = derivative."""

import numpy as np
import pytest
from skfem import DiscreteField

from cosserat_fem import forms
from cosserat_fem.terms.internal import QuaternionBeam
from helpers import curved_space

BEAM = QuaternionBeam()


def nodal_form(form, model, state, **extra):
    """Assemble a form on a state's fields; return it on nodes with 7 components."""
    group = model.space.groups[0]
    basis = forms.fields(group, 4)
    dofs = forms.field_dofs(basis, group, 4)
    x = np.zeros(basis.N)
    x[dofs] = np.concatenate([state.r, state.q], axis=1)
    r, q = basis.interpolate(x)
    return basis, dofs, form.assemble(basis, r=r, q=q, **extra)


def stress_field(model, state):
    group = model.space.groups[0]
    strain, _ = model.space.strain_and_frame(state, 0)
    stress = np.einsum("eqij,eqj->eqi", group.stiffness, strain - group.reference)
    return np.moveaxis(stress, -1, 0)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6])
def test_internal_force_equals_weak_form(order, coupled):
    """The fast path and the paper agree on a random state, up to round-off."""
    model, state = curved_space(order, coupled=coupled)
    stress = DiscreteField(stress_field(model, state))
    _, dofs, form = nodal_form(forms.internal_virtual_work, model, state, stress=stress)
    expected = np.einsum("nij,ni->nj", forms.projection(state, model.space.groups[0]), form[dofs])
    g = np.zeros_like(expected)
    BEAM.residual(state, model.space, g)
    np.testing.assert_allclose(g, expected, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", [1, 2, 3, pytest.param(4, marks=pytest.mark.slow)])
def test_tangent_equals_weak_form(order, coupled):
    """Material and geometric part with a stress memory of their own, and the curvature of the update."""
    model, state = curved_space(order, coupled=coupled)
    group = model.space.groups[0]
    memory = np.moveaxis(BEAM.stress_array(model.space, state.stress, 0), -1, 0)
    C = np.moveaxis(group.stiffness, (0, 1), (-2, -1))
    extra = {"C": DiscreteField(C), "memory": DiscreteField(memory)}
    _, dofs, K = nodal_form(forms.tangent, model, state, **extra)
    _, _, gradient = nodal_form(forms.internal_virtual_work, model, state, stress=DiscreteField(memory))
    n = len(dofs)
    full = K.toarray()[np.ix_(dofs.ravel(), dofs.ravel())].reshape(n, 7, n, 7)
    P = forms.projection(state, group)
    expected = np.einsum("aij,aibk,bkl->ajbl", P, full, P)
    bend = forms.update_curvature(state, group, gradient[dofs][:, 3:])
    expected[np.arange(n)[:, None], [3, 4, 5], np.arange(n)[:, None], [3, 4, 5]] += bend[:, None]
    expected = expected.reshape(6 * n, 6 * n)
    found = model.matrix(state).toarray()
    np.testing.assert_allclose(found, expected, atol=1e-13 * abs(expected).max())
    np.testing.assert_allclose(found, found.T, atol=1e-13 * abs(found).max())


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", [1, 3])
def test_tangent_is_derivative_of_energy(order, coupled, rng):
    """With the stress of the state as memory the tangent is the Hessian along exponential coordinates."""
    model, state = curved_space(order, coupled=coupled)
    space = model.space
    state = type(state)(0.0, state.r, state.q, BEAM.with_stress(state, space))
    group = space.groups[0]

    def energy(s):
        strain, _ = space.strain_and_frame(s, 0)
        e = strain - group.reference
        return 0.5 * np.einsum("eqi,eqij,eqj,eq->", e, group.stiffness, e, group.dx)

    v = rng.normal(size=(space.n_nodes, 6))
    h = 2e-3
    u = np.array([energy(space.update(state, v, k * h)) for k in range(-3, 4)])
    slope = np.array([-1, 9, -45, 0, 45, -9, 1]) @ u / (60 * h)
    bend = np.array([2, -27, 270, -490, 270, -27, 2]) @ u / (180 * h**2)
    g = np.zeros((space.n_nodes, 6))
    BEAM.residual(state, space, g)
    assert slope == pytest.approx((g * v).sum(), rel=1e-8)
    assert bend == pytest.approx(v.ravel() @ model.matrix(state) @ v.ravel(), rel=1e-6)


@pytest.mark.parametrize("coupled", [False, True])
def test_extrapolated_stress_is_linearised_stress(coupled, rng):
    """The memory C (strain + B du) is the derivative of the stress along the update."""
    model, state = curved_space(3, coupled=coupled)
    du = rng.normal(size=(model.space.n_nodes, 6))
    h = 1e-5
    plus, minus = (BEAM.with_stress(model.space.update(state, du, s * h), model.space)[0] for s in (1, -1))
    base = BEAM.with_stress(state, model.space)[0]
    found = BEAM.extrapolate(state, model.space, du, 1.0)[0]
    np.testing.assert_allclose(found - base, (plus - minus) / (2 * h), atol=2e-8 * abs(found).max())


def test_rigid_motion_turns_forces_only(rng):
    """Strains, and so the element, are objective: a rigid motion turns nodal forces and changes nothing else."""
    from scipy.spatial.transform import Rotation

    from cosserat_fem.kernels.rotation import multiply

    model, state = curved_space(3)
    q = Rotation.random(random_state=3).as_quat(scalar_first=True)
    R = Rotation.from_quat(q, scalar_first=True).as_matrix()
    moved = type(state)(0.0, state.r @ R.T + rng.normal(size=3), multiply(q, state.q), state.stress)
    before, after = np.zeros((model.space.n_nodes, 6)), np.zeros((model.space.n_nodes, 6))
    BEAM.residual(state, model.space, before)
    BEAM.residual(moved, model.space, after)
    np.testing.assert_allclose(after[:, :3], before[:, :3] @ R.T, atol=1e-12 * abs(before).max())
    np.testing.assert_allclose(after[:, 3:], before[:, 3:], atol=1e-12 * abs(before).max())
