"""Loads: tangent = difference, form = term, dead and follower, absent costs nothing."""

import numpy as np
import pytest
from skfem import DiscreteField

import cosserat_fem as cf
from cosserat_fem import forms
from cosserat_fem.kernels.rotation import matrix_from_quaternion
from cosserat_fem.terms.internal import QuaternionBeam
from helpers import curved_space

F, M = (1.0, -2.0, 0.7), (0.4, 0.3, -0.9)


def loads(rod):
    return {
        "dead point": cf.PointLoad(rod, "end", force=F, moment=M),
        "follower point": cf.PointLoad(rod, 0.6, force=F, moment=M, follower=True),
        "dead line": cf.LineLoad(rod, F, M),
        "follower line": cf.LineLoad(rod, F, M, follower=True),
        "normal line": cf.LineLoad(rod, F, components="normal"),
        "normal follower": cf.LineLoad(rod, F, M, components="normal", follower=True),
        "profile": cf.LineLoad(rod, F, M, profile=([0, 1.7], [0, 2])),
        "gravity": cf.Gravity((0, 0, -9.81)),
    }


@pytest.mark.parametrize("rotation", ["quaternion", "kardan"])
@pytest.mark.parametrize("name", sorted(loads(curved_space(2)[0].rods[0])))
def test_tangent_is_central_difference(name, rotation):
    """Derivative of the load along the update; with quaternions up to the symmetric second order of the exponential.

    The derivative of the body moment along phi is K + [m]x / 2 (m the moment at the node): the part that cancels
    between all terms in equilibrium.
    """
    model, state = curved_space(2, rotation=rotation)
    rod = model.rods[0]
    term = loads(rod)[name]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [term], rotation=rotation)
    space = model.space
    rng = np.random.default_rng(3)
    du = 0.1 * rng.normal(size=(space.n_nodes, 6))
    state = space.update(model.initial_state(), du)
    v = rng.normal(size=(space.n_nodes, 6))
    h = 1e-5
    plus, minus = (model.external(space.update(state, v, s * h), tangent=False).g for s in (1, -1))
    expected = (plus - minus) / (2 * h)
    outside = model.external(state, tangent=True)
    g, nodal = outside.g, outside.nodal
    found = np.einsum("nij,nj->ni", nodal, v) if len(nodal) else np.zeros_like(v)
    if rotation == "quaternion":
        found[:, 3:] += 0.5 * np.cross(g[:, 3:], v[:, 3:])
    np.testing.assert_allclose(found, expected, atol=1e-8 * max(abs(expected).max(), 1))


def test_line_load_equals_form():
    """Nodal load = weak form with Gauss-Lobatto quadrature, where the rotation is that of the nodes."""
    model, state = curved_space(3)
    rod, group = model.rods[0], model.space.groups[0]
    element = group.basis.elem
    points = element.doflocs[:, 0]
    weights = np.array([shape.integ()(1.0) - shape.integ()(0.0) for shape in element.shapes])
    basis = forms.fields(group, 4, (points[None], weights))
    dofs = forms.field_dofs(basis, group, 4)
    x = np.zeros(basis.N)
    x[dofs] = np.concatenate([state.r, state.q], axis=1)
    _, q = basis.interpolate(x)
    shape = (group.n_elements, len(points))
    force, moment = (DiscreteField(np.broadcast_to(np.array(v)[:, None, None], (3, *shape))) for v in (F, M))
    form = forms.line_load_virtual_work.assemble(basis, q=q, force=force, moment=moment)[dofs]
    expected = -np.einsum("nij,ni->nj", forms.projection(state, group), form)
    blocks = cf.LineLoad(rod, F, M)(state, model.space)
    found = np.zeros_like(expected)
    found[blocks.nodes[:, 0]] = blocks.force[:, 0]
    np.testing.assert_allclose(found, expected, atol=1e-13)


@pytest.mark.parametrize("name", sorted(loads(curved_space(2)[0].rods[0])))
def test_power_of_a_load(name):
    """Nodal forces sum to the total; following ones turn with the section; "normal" leaves nothing along d3."""
    model, state = curved_space(3)
    rod, space = model.rods[0], model.space
    blocks = loads(rod)[name](state, space)
    g = np.zeros((space.n_nodes, 6))
    np.add.at(g, blocks.nodes[:, 0], blocks.force[:, 0])
    R = matrix_from_quaternion(state.q)
    expected = {
        "dead point": np.array(F),
        "follower point": R[space.node(rod, 0.6)] @ F,
        "dead line": rod.length * np.array(F),
        "profile": rod.length * np.array(F),
        "gravity": np.zeros(3),
        "follower line": (space.share(rod)[:, None] * (R[space[rod].nodes] @ F)).sum(0),
    }
    if name in expected:
        np.testing.assert_allclose(-g[:, :3].sum(0), expected[name], atol=1e-12)
    else:
        np.testing.assert_allclose((g[:, :3] * R[:, :, 2]).sum(-1), 0, atol=1e-12)
        assert abs(g[:, :3]).max() > 0.01


def test_gravity_is_the_weight():
    """Reaction = weight, to 1e-10, for two materials in one model."""
    heavy = cf.Section.round(0.01, youngs_modulus=1e9, density=7800)
    light = cf.Section.round(0.02, youngs_modulus=1e8, density=900)
    a = cf.Rod("a", heavy, [(0, 0, 0), (1, 0, 0)], order=2)
    b = cf.Rod("b", [(0, heavy), (0.5, light)], [(0, 1, 0), (0.5, 1, 0)], order=1)
    history = cf.solve_static(
        cf.Model([a, b], [cf.Clamp(a, "start"), cf.Clamp(b, "start")], [cf.Gravity((0, 0, -9.81))])
    )
    for rod, mass in ((a, heavy.mass_per_length), (b, 0.25 * (heavy.mass_per_length + light.mass_per_length))):
        np.testing.assert_allclose(
            history.reaction(f"{rod.name}.start@ground")[0, :3], (0, 0, 9.81 * mass), rtol=1e-10, atol=1e-9
        )


@pytest.mark.parametrize("term", ["gravity", "dead line", "dead point", "follower line"])
def test_rigid_motion_of_rod_and_load_turns_the_answer(term):
    """A turned scene gives the turned answer."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_euler("XYZ", (0.7, -0.4, 1.1)).as_matrix()
    section = cf.Section(force_stiffness=(400, 400, 1e3), moment_stiffness=(1, 1.3, 0.8), mass_per_length=0.1)
    points = np.array([(0, 0, 0), (0.5, 0.2, 0.1), (1, 0, 0.4)])
    results = []
    for turn in (np.eye(3), R):
        rod = cf.Rod("r", section, points @ turn.T, normal=turn @ (0, 0, 1), n_elements=5, order=2)
        load = {
            "gravity": cf.Gravity(turn @ (0, 0, -9.81)),
            "dead line": cf.LineLoad(rod, turn @ F, turn @ (0.1, 0, 0.2)),
            "dead point": cf.PointLoad(rod, "end", turn @ F, turn @ M),
            "follower line": cf.LineLoad(rod, F, (0.1, 0, 0.2), follower=True),
        }[term]
        history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))
        results.append((history.positions(rod)[0] @ turn, history.reaction("r.start@ground").reshape(2, 3) @ turn))
    for a, b in zip(*results, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_absent_term_changes_nothing():
    """A load of zero gives bit for bit the model without it, and no tangent is made for a dead force."""
    model, _ = curved_space(3)
    rod = model.rods[0]
    plain = cf.solve_static(model)
    zero = cf.solve_static(cf.Model([rod], model.supports, [cf.PointLoad(rod, "end", force=(0, 0, 0))]))
    np.testing.assert_array_equal(plain.final.r, zero.final.r)
    dead = cf.PointLoad(rod, "end", force=F)
    assert dead(model.initial_state(), model.space).stiffness is None
    assert dead.symmetric
    assert not cf.PointLoad(rod, "end", moment=M).symmetric


def test_tables_and_functions_of_time():
    model, _ = curved_space(1)
    rod = model.rods[0]
    table = cf.PointLoad(rod, "end", force=([0, 2], [(0, 0, 0), (0, 0, 4)]))
    function = cf.PointLoad(rod, "end", force=lambda t: (0, 0, 2 * t))
    for load in (table, function):
        state = model.initial_state(1.5)
        np.testing.assert_allclose(load(state, model.space).force[0, 0, :3], (0, 0, -3))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda r: cf.Gravity((0, 9.81)), "gravity: acceleration: must have shape"),
        (lambda r: cf.Gravity((0, 0, float("nan"))), "must be finite"),
        (lambda r: cf.LineLoad(r, F, components="tangential"), "components must be 'all' or 'normal'"),
        (lambda r: cf.LineLoad(r, (1, 2)), "line load on rod 'r': force: must have shape"),
        (lambda r: cf.LineLoad(r, F, profile=([1, 0], [1, 1])), "profile places must not decrease"),
        (lambda r: cf.PointLoad(r, 9.0), "at = 9 m is not on rod 'r'"),
        (lambda r: cf.PointLoad(r, "end", force=([1, 0], [F, F])), "times must increase"),
    ],
)
def test_bad_loads(make, message):
    with pytest.raises(ValueError, match=message):
        make(curved_space(1)[0].rods[0])


def test_with_stress_is_the_stress_of_the_state():
    model, state = curved_space(3)
    beam = QuaternionBeam()
    stress = beam.stress_array(model.space, beam.with_stress(state, model.space), 0)
    strain, _ = model.space.strain_and_frame(state, 0)
    group = model.space.groups[0]
    np.testing.assert_allclose(
        stress, np.einsum("eqij,eqj->eqi", group.stiffness, strain - group.reference), atol=1e-12
    )
