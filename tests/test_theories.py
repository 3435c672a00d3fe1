"""Kirchhoff rods and strings: tangents, closed forms, what they refuse, and which theory suffices."""

import json
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf

REFERENCES = json.loads((pathlib.Path(__file__).parent / "verification" / "references.json").read_text())
CATENARIES = REFERENCES["A05b_extensible_catenary"]["values"]


def cantilever(theory, force, stiffness=(300.0, 300.0, 1e4), order=4):
    section = cf.Section(force_stiffness=stiffness, moment_stiffness=(1, 1, 1))
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=8, order=order)
    return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=force)], theory=theory)


def hanging(theory="string", span=0.9, rise=0.0, EA=100.0, n_elements=12, hold=cf.Pin, EI=1e-6):
    s = np.linspace(0, 1, 31)
    sag = 0.6 * np.sqrt(max(1 - span**2 - rise**2, 0))
    points = np.stack([span * s, 0 * s, rise * s - sag * np.sin(np.pi * s)], axis=-1)
    section = cf.Section(force_stiffness=(EA,) * 3, moment_stiffness=(EI,) * 3, mass_per_length=1.0)
    rod = cf.Rod("c", section, points, n_elements=n_elements, order=3, length=1.0)
    return cf.Model([rod], [hold(rod, "start"), hold(rod, "end")], [cf.Gravity((0, 0, -1))], theory=theory)


def tip(theory, force, **options):
    return cf.solve_static(cantilever(theory, force, **options)).positions("rod")[0, -1]


def test_kirchhoff_has_no_shear():
    """Small load: P L^3 / 3 EI, and with shear P L / GA more."""
    P = 1e-3
    bending, shear = P / 3, P / 300
    assert -tip("cosserat", (0, -P, 0))[1] == pytest.approx(bending + shear, rel=1e-5)
    assert -tip("kirchhoff", (0, -P, 0))[1] == pytest.approx(bending, rel=1e-6)


@pytest.mark.parametrize("P", [1, 5, 10])
def test_kirchhoff_elastica(P):
    """Inextensible, unshearable cantilever (elliptic integrals): a soft shear stiffness plays no part."""
    ref = REFERENCES["A02a_elastica_tip_force"]["values"][str(P)]
    x, y, _ = tip("kirchhoff", (0, P, 0), stiffness=(300.0, 300.0, 1e7))
    assert (1 - x, y) == pytest.approx((ref["u_over_L"], ref["w_over_L"]), abs=2e-6)
    assert abs(tip("cosserat", (0, P, 0), stiffness=(300.0, 300.0, 1e7))[1] - y) > 1e-3


def test_string_tangent_is_central_difference(rng):
    model = hanging()
    space, state = model.space, model.initial_state()
    state = space.update(state, 1e-2 * rng.normal(size=(space.n_nodes, 6)))
    state = cf.State(state.t, state.r, state.q, model.internal.with_stress(state, space))
    K = model.internal.full(state, space, np.zeros((space.n_nodes, 6)))[2][0]
    group = space.groups[0]
    for e in (0, 5):
        nodes = group.conn[e]
        du = np.zeros((space.n_nodes, 6))
        du[nodes, :3] = rng.normal(size=(len(nodes), 3))
        change = np.zeros((space.n_nodes, 6))
        for sign in (1, -1):
            g = np.zeros((space.n_nodes, 6))
            model.internal.residual(space.update(state, sign * 1e-6 * du), space, g)
            change += sign * g / 2e-6
        inside = nodes[2:]  # their force comes from this element alone
        found = (K[e] @ du[nodes].ravel()).reshape(-1, 6)[2:, :3]
        np.testing.assert_allclose(found, change[inside, :3], rtol=1e-6, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("span", [0.6, 0.9, 0.98])
@pytest.mark.parametrize("EA", [1000, 100, 10])
def test_elastic_catenary(span, EA):
    """End forces and the middle of a string against Irvine's closed form."""
    ref = CATENARIES[f"span={span},rise=0,EA/(wL)={EA}"]
    history = cf.solve_static(hanging(span=span, EA=float(EA)))
    end = history.reaction("c.end@ground")[0]
    middle = history.positions("c")[0, len(history.nodes("c")) // 2]
    assert (end[0], end[2]) == pytest.approx((ref["H"], ref["n_z(0)"] + 1), abs=2e-7)
    np.testing.assert_allclose(middle, ref["r(L/2)"], atol=2e-7)
    assert history.stable == [True]
    assert not history.reaction("c.end@ground")[0, 3:].any()


def test_clamped_string_is_pinned():
    """Clamps hold no moment, and a straight start without tension is no obstacle."""
    forces = [cf.solve_static(hanging(hold=hold)).reaction("c.end@ground")[0] for hold in (cf.Pin, cf.Clamp)]
    np.testing.assert_allclose(*forces, atol=1e-9)
    section = cf.Section(force_stiffness=(1e3,) * 3, moment_stiffness=(1e-6,) * 3, mass_per_length=1.0)
    rod = cf.Rod("c", section, [(0, 0, 0), (1, 0, 0)], n_elements=10)
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -1))], theory="string")
    history = cf.solve_static(model)
    # shallow parabola: H^3 = EA w^2 L^2 / 24 to first order
    assert history.reaction("c.end@ground")[0, 0] == pytest.approx((1e3 / 24) ** (1 / 3), rel=0.01)


def test_string_in_time():
    """A heavy string swings in a plane; energy is kept."""
    section = cf.Section(force_stiffness=(1e3,) * 3, moment_stiffness=(1e-6,) * 3, mass_per_length=1.0)
    rod = cf.Rod("c", section, [(0, 0, 0), (0.1, 0, -1)], n_elements=6, order=2)
    model = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, 0, -9.81))], theory="string")
    history = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.FixedStep(0.01), times=np.linspace(0, 1, 11))
    assert history.ledger_gap < 0.02
    assert history.positions("c")[-1, -1, 0] < 0


def test_string_to_an_accuracy():
    ref = CATENARIES["span=0.6,rise=0,EA/(wL)=100"]
    history = cf.solve_static(hanging(span=0.6), accuracy=1e-6)
    assert history.reaction("c.end@ground")[0, 0] == pytest.approx(ref["H"], rel=1e-6)


def test_what_a_string_cannot_carry():
    rod = hanging().rods[0]
    supports = [cf.Pin(rod, "start"), cf.Pin(rod, "end")]
    for term in (
        cf.PointLoad(rod, 0.5, moment=(0, 1, 0)), cf.PointLoad(rod, 0.5, force=(0, 0, 1), follower=True),
        cf.LineLoad(rod, (0, 0, -1), components="normal"), cf.Drag(rod, normal=1.0), cf.Damping(time=0.01),
    ):  # fmt: skip
        with pytest.raises(cf.SceneError, match="cannot act on a string"):
            cf.Model([rod], supports, [term], theory="string")
    with pytest.raises(ValueError, match="theory must be"):
        cf.Model([rod], supports, theory="timoshenko")
    with pytest.raises(cf.SceneError, match="no rotations"):
        cf.Model([rod], supports, theory="string", rotation="kardan")


def test_which_theory_suffices():
    """A soft thin cable is a string; a stiff one is not; a short thick one needs shear."""
    thin = cf.compare_theories(hanging("cosserat", EI=1e-9, n_elements=60), cf.solve_static, tolerance=0.02)
    assert thin.sufficient["force"] == "string"
    assert thin.sufficient["place"] == "string"
    stiff = cf.compare_theories(hanging("cosserat", EI=1e-2, EA=1e5), cf.solve_static)
    assert stiff.sufficient["all"] == "kirchhoff"
    assert "kirchhoff" in str(stiff)
    thick = cf.compare_theories(cantilever("cosserat", (0, -5, 0)), cf.solve_static, tolerance=1e-3)
    assert thick.sufficient["place"] == "cosserat"
    assert any(row.problem for row in thick.rows if row.theory == "string") or thick.rows[2].apart["moment"] == 1.0
    with pytest.raises(ValueError, match="tolerance"):
        cf.compare_theories(hanging("cosserat"), cf.solve_static, tolerance=0.0)
