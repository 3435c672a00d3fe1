"""The Kardan element: kernel = form, tangent = complex-step derivative of the form."""

import numpy as np
import pytest
from skfem import DiscreteField

from cosserat_fem import forms
from cosserat_fem.terms.internal import KardanBeam
from helpers import curved_space

BEAM = KardanBeam()


def form_force(model, state, r, angles, stress=None):
    """Generalized nodal forces (N, 6) of the form; stress fixed, or from the strains of (r, angles)."""
    group = model.space.groups[0]
    basis = forms.fields(group, 3)
    dofs = forms.field_dofs(basis, group, 3)
    E, Q, A = group.N_s.shape

    def at_points(table, values):
        return np.moveaxis(np.einsum(table, group.N if table[1] == "a" else group.N_s, values[group.conn]), -1, 0)

    r_s, a, a_s = at_points("eqa,eai->eqi", r), at_points("qa,eai->eqi", angles), at_points("eqa,eai->eqi", angles)
    if stress is None:
        strain = forms.kardan_strain(r_s, a, a_s)
        stress = np.einsum("eqij,jeq->ieq", group.stiffness, strain - np.moveaxis(group.reference, -1, 0))
    kind = np.result_type(r, angles, stress)
    form = forms.kardan_virtual_work(kind.type)
    values = {"r_s": r_s, "a": a, "a_s": a_s, "stress": stress}
    return form.assemble(basis, **{k: DiscreteField(v) for k, v in values.items()})[dofs]


@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.parametrize("coupled", [False, True])
def test_internal_force_equals_weak_form(order, coupled):
    """The compiled element and the paper's weak form agree on a random state, up to round-off."""
    model, state = curved_space(order, coupled=coupled, rotation="kardan")
    expected = form_force(model, state, state.r, state.angles)
    g = np.zeros_like(expected)
    BEAM.residual(state, model.space, g)
    np.testing.assert_allclose(g, expected, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize("coupled", [False, True])
def test_tangent_is_complex_step_derivative(coupled, rng):
    """Unknowns add up, so the matrix is the plain derivative of the force, to round-off."""
    model, state = curved_space(2, coupled=coupled, rotation="kardan")
    state = type(state)(0.0, state.r, state.q, BEAM.with_stress(state, model.space), state.angles)
    v = rng.normal(size=(model.space.n_nodes, 6))
    step = 1e-30j * v
    expected = form_force(model, state, state.r + step[:, :3], state.angles + step[:, 3:]).imag / 1e-30
    found = (model.matrix(state) @ v.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(found, expected, atol=1e-13 * abs(expected).max())


def test_geometric_part_uses_the_memory(rng):
    """With a memory of its own, the geometric part is the derivative of the force at that fixed stress."""
    model, state = curved_space(2, rotation="kardan")
    v = rng.normal(size=(model.space.n_nodes, 6))
    step = 1e-30j * v
    memory = np.moveaxis(state.stress[0], -1, 0)
    expected = form_force(model, state, state.r + step[:, :3], state.angles + step[:, 3:], memory).imag / 1e-30
    none = type(state)(0.0, state.r, state.q, (np.zeros_like(state.stress[0]),), state.angles)
    found = ((model.matrix(state) - model.matrix(none)) @ v.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(found, expected, atol=1e-12 * abs(expected).max())


def test_extrapolated_stress_is_linearised_stress(rng):
    model, state = curved_space(3, coupled=True, rotation="kardan")
    du = rng.normal(size=(model.space.n_nodes, 6))
    h = 1e-5
    plus, minus = (BEAM.with_stress(model.space.update(state, du, s * h), model.space)[0] for s in (1, -1))
    base = BEAM.with_stress(state, model.space)[0]
    found = BEAM.extrapolate(state, model.space, du, 1.0)[0]
    np.testing.assert_allclose(found - base, (plus - minus) / (2 * h), atol=2e-8 * abs(found).max())


def test_not_objective():
    """Interpolated angles do not turn with the rod: a turned bent rod is strained differently (quaternions are not)."""
    from cosserat_fem.kernels.rotation import (
        kardan_from_matrix,
        matrix_from_quaternion,
        matrix_from_vector,
        multiply,
        quaternion_from_vector,
    )

    turn = np.array([0.3, -0.4, 0.2])
    R = matrix_from_vector(turn)
    defects = []
    for rotation in ("kardan", "quaternion"):
        model, state = curved_space(2, rotation=rotation, n_elements=3)
        q = multiply(quaternion_from_vector(turn), state.q)
        angles = None
        if rotation == "kardan":
            angles = np.unwrap(kardan_from_matrix(matrix_from_quaternion(q)), axis=0)
        moved = type(state)(0.0, state.r @ R.T, q, state.stress, angles)
        before, after = (model.space.strain_and_frame(s, 0)[0] for s in (state, moved))
        defects.append(abs(after - before).max() / abs(before).max())
    assert defects[0] > 1e-4
    assert defects[1] < 1e-13
