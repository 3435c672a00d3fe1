"""Paths past limit points, critical loads, branches; what a quasi-static run says where rods snap."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

import cosserat_fem as cf
from cosserat_fem.equilibrium import continuation
from cosserat_fem.iteration.arclength import LoadFactor, Path, Time
from cosserat_fem.iteration.newton import Newton
from cosserat_fem.record import Record


def column(*, stiffness=1e7, n_elements=6, second=1.3, load=None, **options):
    """A cantilever of EI = 1 and length 1 under an axial load at its end."""
    section = cf.Section(force_stiffness=(stiffness,) * 3, moment_stiffness=(1.0, second, 1.0), mass_per_length=1.0)
    rod = cf.Rod("column", section, [(0, 0, 0), (1, 0, 0)], n_elements=n_elements, normal=(0, 0, 1))
    load = cf.PointLoad(rod, "end", **(load or {"force": (-1, 0, 0)}))
    return cf.Model([rod], [cf.Clamp(rod, "start")], [load], **options)


def frame(force=(0, -1, 0)):
    """Lee's frame, stiff out of its plane."""
    E, A, I, L = 720.0, 6.0, 2.0, 120.0
    section = cf.Section(force_stiffness=(E * A / 3,) * 2 + (E * A,), moment_stiffness=(E * I, 1e5, 1e5))
    a = cf.Rod("column", section, [(0, 0, 0), (0, L, 0)], n_elements=6, normal=(0, 0, 1))
    b = cf.Rod("beam", section, [(0, L, 0), (L, L, 0)], n_elements=10, normal=(0, 0, 1))
    supports = [cf.Clamp(a, "start", free=("rz",)), cf.Clamp(b, "end", free=("rz",)), cf.Weld(a, "end", b, "start")]
    return cf.Model([a, b], supports, [cf.PointLoad(b, 0.2 * L, force=force)])


def test_states_of_a_path_are_equilibria():
    """Every state of a path, stable or not, is one of the plain solver's under the same loads."""
    model = frame()
    history = cf.trace_path(model, until=2.5)
    assert history.status == "converged"
    assert history.factors[-1] == 2.5
    assert max(record.residual for record in history.records) < 1e-9
    assert min(history.factors) < -0.9
    for k in range(2, len(history), 5):
        record = history.records[k]
        again = Newton(model.with_factor(record.factor)).plain(record.state)
        assert again.converged
        assert again.iterations <= 2
        assert again.negative == record.negative
        np.testing.assert_allclose(again.state.r, record.state.r, atol=1e-7)


def test_limit_point_does_not_depend_on_the_steps():
    """Found to 1e-6 from long steps and from short ones."""
    found = [[e.value for e in cf.trace_path(frame(), until=3.0, longest=h).critical] for h in (0.25, 0.07)]
    assert len(found[0]) == len(found[1]) == 2
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_limit_is_where_load_control_ends():
    """Just below the limit load there is a stable state near by, just above there is none."""
    model = frame()
    limit = cf.critical_load(model)
    assert limit.kind == "limit"
    assert (limit.before, limit.after) == (0, 1)
    below, above = (
        Newton(model.with_factor((1 + k * 1e-3) * limit.value)).guarded(limit.state, iterations=400) for k in (-1, 1)
    )
    assert below.converged
    assert below.negative == 0
    assert np.abs(below.state.r - limit.state.r).max() < 10.0
    assert np.abs(above.state.r - limit.state.r).max() > 50.0


def test_bifurcations_are_found_and_passed():
    """A straight column: both planes buckle, each at its load; the path goes on straight."""
    history = cf.trace_path(column(), until=5.0)
    values = np.array([1.0, 1.3]) * np.pi**2 / 4
    assert [e.kind for e in history.critical] == ["bifurcation"] * 2
    np.testing.assert_allclose([e.value for e in history.critical], values, rtol=1e-6)
    assert [(e.before, e.after) for e in history.critical] == [(0, 1), (1, 2)]
    assert history.stable[0]
    assert not history.stable[-1]
    assert np.abs(history.positions("column")[-1, :, 1:]).max() < 1e-9
    shape = history.critical[0].shape[:, 1]  # buckles along y
    assert np.abs(shape).max() > 0.1
    assert np.abs(history.critical[0].shape[:, 2]).max() < 1e-6


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_branch(seed):
    """On request the path leaves the straight column: the elastica's deflection at 1.5 times Euler's load."""
    factor = 1.5 * np.pi**2 / 4
    history = cf.trace_path(column(), until=factor, branch=seed)
    k = brentq(lambda k: ellipk(k * k) - np.sqrt(factor), 0.01, 0.99)  # L sqrt(P) = K(k), k = sin(angle / 2)
    deflection = 2 * k / np.sqrt(factor)
    end = history.positions("column")[-1, -1]
    assert abs(end[1]) == pytest.approx(deflection, rel=1e-4)
    assert abs(end[2]) < 1e-9
    assert history.stable[-1]


def test_branch_goes_either_way():
    ends = [cf.trace_path(column(), until=3.0, branch=k).positions("column")[-1, -1, 1] for k in range(4)]
    assert min(ends) < 0 < max(ends)


def test_constant_loads_stay():
    """Only the chosen loads are multiplied: a pull of 1 raises the critical push by 1."""
    model = column()
    rod = model.rods[0]
    pull = cf.PointLoad(rod, "end", force=(1.0, 0, 0))
    both = cf.Model(model.rods, model.supports, [*model.terms, pull])
    assert cf.critical_load(both, [model.terms[0]]).value == pytest.approx(np.pi**2 / 4 + 1, rel=1e-6)
    with pytest.raises(ValueError, match="not in the model"):
        cf.critical_load(model, [pull])


def test_factor_on_loads():
    """Twice a load is a load of twice the force: at rest, in time with compiled steps, and for its tangent."""
    model = column(load={"force": (-0.3, 0.2, 0.0), "follower": True}, stiffness=1e4)
    twice = column(load={"force": (-0.6, 0.4, 0.0), "follower": True}, stiffness=1e4)
    doubled = model.with_factor(2.0)
    state = cf.solve_static(twice).final
    np.testing.assert_allclose(cf.solve_static(doubled).final.r, state.r, atol=1e-12)
    np.testing.assert_allclose(doubled.matrix(state).toarray(), twice.matrix(state).toarray(), atol=1e-9)
    ends = [cf.solve_dynamic(m, 0.02, start="drawn", step=cf.FixedStep(1e-3)).final.r for m in (doubled, twice)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-14)
    assert model.with_factor(0.5, []).terms == model.terms


@pytest.mark.parametrize("kind", ["load", "motion"])
def test_rates_are_differences(kind):
    """What changes along a path: derivative of residual and gaps with factor and time."""
    if kind == "load":
        model = column(load={"force": (-1, 0.2, 0.1), "follower": True})
        parameter, value = LoadFactor(model, model.loads()), 0.7
    else:
        model = column(load={"force": ([0, 3], [(0, 0, 0), (0, 1, 2)])})
        arm = cf.Part("arm", motion=cf.Hinge((0.3, 0, 0), (0, 1, 0), lambda t: 0.3 * t**2))
        rod = model.rods[0]
        model = cf.Model([rod], [cf.Clamp(rod, "start", to=arm)], model.terms)
        parameter, value = Time(model, 0.0, 3.0), 1.1
    rng = np.random.default_rng(1)
    state = model.initial_state()
    state = model.space.update(state, 0.1 * rng.normal(size=(model.space.n_nodes, 6)))
    h, c = 1e-4, model.constraints
    states = [parameter.placed(state, value + k * h) for k in (-1, 1)]
    g = [parameter.model(value + k * h).external(s, tangent=False).g for k, s in zip((-1, 1), states, strict=True)]
    gap = [c.evaluate(s, c.targets(s.t)).gap for s in states]
    rate = parameter.residual_rate(parameter.placed(state, value), value)
    held = c.evaluate(state, c.targets(value))
    np.testing.assert_allclose(rate, (g[1] - g[0]) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(parameter.gap_rate(state, value, held), (gap[1] - gap[0]) / (2 * h), atol=1e-5)


def test_first_direction_is_the_linear_response():
    """A path begins as the linear theory says: tip load over 3 EI / L^3, with shear."""
    model = column(load={"force": (0, 1, 0)}, stiffness=100.0)
    path = Path(Newton(model), LoadFactor(model, model.loads()))
    point = path.begin(model.initial_state(), 0.0, 1.0)
    tip = model.space.node(model.rods[0], 1.0)
    assert point.du[tip, 1] / point.rate == pytest.approx(1 / 3 + 1 / 100, rel=1e-9)


def shaken():
    """The frame under a load that starts upward and turns down: t = 0 to 15 s, limit points at 10.18 s and 0.867 s."""
    return frame(force=([0, 15], [(0, 1.2, 0), (0, -3.3, 0)]))


def test_snap_is_told():
    """A quasi-static run that passes a limit point says when, and goes on from the state that it finds."""
    model = shaken()
    history = cf.solve_quasistatic(model, np.linspace(0, 15, 16))
    assert len(history) == 16
    limits = [event for event in history.critical if event.kind == "limit"]
    assert [round(event.t, 1) for event in limits] == [10.2]
    assert any("t = 10.1" in text and "snap" in text for text in model.warnings)


def test_quasistatic_past_limits():
    """Allowed to, it follows the path back to 0.867 s and forth again; nothing jumps and nothing is warned of."""
    model = shaken()
    times = np.linspace(0, 15, 16)
    history = cf.solve_quasistatic(model, times, past_limits=True)
    np.testing.assert_array_equal(history.t, times)
    assert [round(event.t, 2) for event in history.critical] == [10.18, 0.87]
    assert model.warnings == []
    path = cf.trace_path(model, along="time", until=15.0)
    assert path.path
    assert path.t.min() < 0.95
    np.testing.assert_allclose(path.final.r, history.final.r, atol=1e-7)
    np.testing.assert_allclose([e.t for e in path.critical], [e.t for e in history.critical], rtol=1e-6)


def test_smooth_runs_are_not_watched():
    """A run without limit points costs the same iterations and says nothing."""
    model = frame(force=([0, 15], [(0, 0, 0), (0, -1, 0)]))
    history = cf.solve_quasistatic(model, np.linspace(0, 15, 16))
    assert history.critical == []
    assert model.warnings == []


def test_following_load_is_judged_by_vibrations():
    """Beck's column has no static critical load; its critical load is that of flutter."""
    model = column(stiffness=1e6, second=1.0, load={"force": (0, 0, -1), "follower": True})
    found = cf.critical_load(model)
    assert found.kind == "flutter"
    assert found.value == pytest.approx(20.051, rel=1e-3)
    history = cf.trace_path(model, until=30.0)
    assert history.critical == []
    assert history.stable == [None] * len(history)


def test_faults():
    model = column()
    rod = model.rods[0]
    with pytest.raises(ValueError, match="until"):
        cf.trace_path(model, until="criticall")
    with pytest.raises(ValueError, match="along must be"):
        cf.trace_path(model, along="load")
    with pytest.raises(ValueError, match="later than t"):
        cf.trace_path(model, along="time", until=0.0)
    with pytest.raises(cf.SceneError, match="no load to multiply"):
        cf.trace_path(cf.Model([rod], model.supports))
    floor = cf.Part("floor", shape=cf.Plane((0, 0, -1), (0, 0, 1)))
    section = cf.Section.round(0.01, youngs_modulus=1e6)
    thick = cf.Rod("thick", section, [(0, 0, 0), (1, 0, 0)])
    touching = cf.Model([thick], [cf.Clamp(thick, "start")], [cf.PartContact(thick, floor)])
    with pytest.raises(cf.SceneError, match="touch"):
        cf.trace_path(touching)
    with pytest.raises(cf.ConvergenceError, match="none up to"):
        cf.critical_load(cf.Model([rod], model.supports, [cf.PointLoad(rod, "end", force=(1, 0, 0))]), steps=5)
    stopped = cf.trace_path(model, until=100.0, callback=lambda k, history: k == 1)
    assert stopped.status == "stopped"
    assert len(stopped) == 2


def test_unstable_start_is_refused(monkeypatch):
    """A critical load is asked of rods that stand stable without it."""

    def standing(model, **options):
        history = cf.History(model)
        solved = Newton(model).plain(model.initial_state())
        history.records.append(Record(solved.state, solved.reactions, 1, 0.0, solved.negative))
        return history

    rod = column().rods[0]
    heavy, load = cf.LineLoad(rod, (-20.0, 0, 0)), cf.PointLoad(rod, "end", force=(-1, 0, 0))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [heavy, load])
    monkeypatch.setattr(continuation, "solve_static", standing)
    with pytest.raises(cf.SceneError, match="unstable without these loads"):
        cf.critical_load(model, [load])
