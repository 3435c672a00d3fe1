"""The static driver: finds equilibria by itself, says clearly when it does not."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration.newton import Newton

SLENDER = cf.Section(force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=(1e-2, 1e-2, 0.8e-2))


def hinge_cable(slack=0.8, *, out_of_plane=False, **options):
    """A weightless cable with slack between ground and an arm that turns about z."""
    s = np.linspace(0, 1, 21)
    sag = 0.3 * np.sin(np.pi * s) ** 2
    points = np.stack([slack * s, 0 * s if out_of_plane else sag, sag if out_of_plane else 0 * s], axis=-1)
    rod = cf.Rod(
        "cable", SLENDER, points, length=1.0, n_elements=10, start_tangent=(1, 0, 0), end_tangent=(1, 0, 0), **options
    )
    arm = cf.Part("arm", motion=cf.Hinge((0.6 * slack, 0, 0), (0, 0, 1), np.radians(1)))
    return cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)])


def test_step_size_does_not_matter():
    """Out of plane the cable jumps in the first degree (neutral equilibrium): 1, 5, 30 and 90 deg at once agree."""
    energies = []
    for step in (5, 30, 90):
        history = cf.solve_quasistatic(hinge_cable(out_of_plane=True), np.arange(0, 91, step))
        energies.append(history.energy[-1])
        assert history.stable[-1]
    np.testing.assert_allclose(energies, energies[0], rtol=1e-8)


def test_travel_there_and_back_returns():
    """A taut cable is elastic: the state at 0 deg is the same after a travel."""
    model = hinge_cable(0.97)
    angle = ([0, 60, 120], np.radians([0, 60, 0]))
    arm = cf.Part("arm", motion=cf.Hinge((0.582, 0, 0), (0, 0, 1), angle))
    rod = model.rods[0]
    history = cf.solve_quasistatic(
        cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)]), np.arange(0, 121, 4)
    )
    first, last = history.records[1].state, history.records[-2].state
    np.testing.assert_allclose(last.r, first.r, atol=1e-9)


def test_large_turn_is_taken_in_quarters():
    """A driven end turned by 20 pi about the rod's axis in one station: twisted by ten turns, not by none."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(50, 50, 1.0))
    rod = cf.Rod("bar", section, [(0, 0, 0), (1, 0, 0)], n_elements=40, order=4)
    chuck = cf.Part("chuck", motion=cf.Hinge((0, 0, 0), (1, 0, 0), ([0, 1], [0, 20 * np.pi])))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=chuck)])
    history = cf.solve_quasistatic(model, [0.0, 1.0])
    assert history.reaction("bar.end@chuck")[-1, 3] == pytest.approx(20 * np.pi, rel=1e-6)
    assert history.hinge_torque("chuck")[-1] == pytest.approx(20 * np.pi, rel=1e-6)


def test_units_do_not_matter():
    """The same scene in metres and in millimetres: same iterations, same digits."""
    results = []
    for scale in (1.0, 1000.0):
        section = cf.Section(
            force_stiffness=tuple(np.array((400.0, 400, 1000)) / scale**0),
            moment_stiffness=tuple(np.array((1, 1.3, 0.8)) * scale**2),
        )
        rod = cf.Rod("r", section, scale * np.array([(0, 0, 0), (0.6, 0.1, 0), (1, 0, 0.2)]), n_elements=6)
        load = cf.PointLoad(rod, "end", force=(1, -2, 3))
        history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))
        results.append((history.positions(rod)[0] / scale, history.counters.iterations))
    np.testing.assert_allclose(results[0][0], results[1][0], atol=1e-12)
    assert results[0][1] == results[1][1]


def test_far_from_the_origin():
    """A scene moved by a kilometre converges to the same shape, as far as its digits reach."""
    shapes = []
    for place in (0.0, 1000.0):
        rod = cf.Rod("r", SLENDER, np.array([(0, 0, 0), (0.3, 0.1, 0), (0.6, 0, 0)]) + place, length=0.62)
        load = cf.LineLoad(rod, (0, 0, -0.5))
        history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [load]))
        shapes.append(history.positions(rod)[0] - place)
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-8)


def test_load_steps_on_request():
    """Equal load steps reach the same state."""
    rod = cf.Rod("r", SLENDER, [(0, 0, 0), (1, 0, 0)], n_elements=8)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, -0.05, 0.02))])
    one = cf.solve_static(model)
    five = cf.solve_static(model, steps=5)
    assert five.counters.load_steps == 5
    np.testing.assert_allclose(one.final.r, five.final.r, atol=1e-9)


def test_continue_from_a_state():
    model = hinge_cable(0.97)
    whole = cf.solve_quasistatic(model, [0, 10, 20, 30])
    half = cf.solve_quasistatic(model, [0, 10, 20])
    rest = cf.solve_quasistatic(model, [25, 30], start=half.final)
    np.testing.assert_allclose(rest.final.r, whole.final.r, atol=1e-9)


def test_callback_stops_and_keeps_the_stations():
    history = cf.solve_quasistatic(hinge_cable(0.97), range(10), callback=lambda k, state: k == 3)
    assert len(history) == 4
    assert history.status == "stopped"
    assert "t = 3 s" in history.message


def test_failure_says_where_and_what_to_try(monkeypatch):
    """No equilibrium: a ConvergenceError with rod, place and advice, and the stations so far."""
    model = hinge_cable(0.97)
    plain, guarded = Newton.plain, Newton.guarded

    def lost(method):
        def solve(self, state, **options):
            solved = method(self, state, **options)
            if state.t > 2:
                from dataclasses import replace

                return replace(solved, reason="no convergence within 20 iterations")
            return solved

        return solve

    monkeypatch.setattr(Newton, "plain", lost(plain))
    monkeypatch.setattr(Newton, "guarded", lost(guarded))
    with pytest.raises(cf.ConvergenceError, match=r"no equilibrium .*largest at rod 'cable', s = .* m\. Try") as caught:
        cf.solve_quasistatic(model, range(6))
    assert len(caught.value.history) == 3
    assert caught.value.history.status == "stopped"
    assert caught.value.state is not None


def test_impossible_load_is_an_error_not_an_answer():
    """A follower force that whips a cantilever has no equilibrium to be found; the error is typed, nothing is returned."""
    soft = cf.Section(force_stiffness=(1e3, 1e3, 1e3), moment_stiffness=(1e-3, 1e-3, 1e-3))
    rod = cf.Rod("whip", soft, [(0, 0, 0), (1, 0, 0)], n_elements=4, order=1)
    load = cf.PointLoad(rod, "end", force=(1e8, 0, 0), follower=True)
    with pytest.raises(cf.ConvergenceError):
        cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))


def column(factor):
    section = cf.Section(force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=(1.0, 1.0, 1.0))
    rod = cf.Rod("column", section, [(0, 0, 0), (0, 0, 1)], n_elements=8, order=3)
    load = cf.PointLoad(rod, "end", force=(0, 0, -factor * np.pi**2 / 4))
    return cf.Model([rod], [cf.Clamp(rod, "start")], [load])


@pytest.mark.parametrize(("factor", "negative"), [(0.95, 0), (0.999, 0), (1.001, 2), (1.05, 2), (8.9, 2), (9.1, 4)])
def test_stability_is_counted(factor, negative):
    """A straight column: two negative eigenvalues (two planes) beyond Euler's load, four beyond nine times that."""
    model = column(factor)
    assert Newton(model).plain(model.initial_state()).negative == negative


def test_unstable_equilibrium_is_told():
    """A perfectly straight column beyond Euler's load: it stays straight or round-off tips it over; either is told."""
    model = column(1.05)
    history = cf.solve_static(model)
    buckled = bool(np.abs(history.positions("column")[0, -1, :2]).max() > 0.1)
    assert history.stable == [buckled]
    assert ("it was left for a stable one" if buckled else "unstable equilibrium at t = 0 s") in model.warnings[0]


def test_unstable_equilibrium_is_left_for_a_stable_one():
    """With the least imperfection the column buckles, and the driver ends in the stable state."""
    straight = column(1.05)
    rod = straight.rods[0]
    model = cf.Model([rod], straight.supports, [*straight.terms, cf.PointLoad(rod, "end", force=(1e-6, 0, 0))])
    history = cf.solve_static(model)
    assert history.stable == [True]
    assert history.positions("column")[0, -1, 0] > 0.1


def test_cable_shorter_than_its_span_warns():
    model = hinge_cable(0.8)
    rod = model.rods[0]
    part = cf.Part("p", motion=cf.Slider((1, 0, 0), 0.1))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=part)])
    cf.solve_quasistatic(model, np.arange(4))
    told = [w for w in model.warnings if "1 m of cable" in w]
    assert len(told) == 1
    assert "1.1 m apart at t = 3 s: it must stretch by at least 10 %" in told[0]


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([], "times is empty"),
        ([0, 0], "times must increase"),
        ([1, 0], "got 1 s followed by 0 s"),
        ([0, np.nan], "must be finite"),
        ("now", "must be numbers"),
    ],
)
def test_bad_times(times, message):
    with pytest.raises(ValueError, match=message):
        cf.solve_quasistatic(hinge_cable(), times)


def test_bad_steps():
    with pytest.raises(ValueError, match="steps: must be an integer of at least 1"):
        cf.solve_static(hinge_cable(), steps=0)


def test_bad_models():
    rod = cf.Rod("a", SLENDER, [(0, 0, 0), (1, 0, 0)])
    other = cf.Rod("b", SLENDER, [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(cf.SceneError, match="has no rod"):
        cf.Model([])
    with pytest.raises(cf.SceneError, match="rod 'a': the name is used twice"):
        cf.Model([rod, cf.Rod("a", SLENDER, [(0, 0, 0), (1, 0, 0)])])
    with pytest.raises(cf.SceneError, match="rod 'b' is not in the model"):
        cf.Model([rod], [cf.Clamp(other, "start")])
    with pytest.raises(cf.SceneError, match="term 'point load': rod 'b' is not in the model"):
        cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(other, "end")])
    with pytest.raises(ValueError, match="rotation must be 'quaternion' or 'kardan'"):
        cf.Model([rod], rotation="euler")
    with pytest.raises(cf.SceneError, match="welds need rotation"):
        cf.Model([rod, other], [cf.Weld(rod, "start", other, "start")], rotation="kardan")


def twisted(motion):
    """Straight rod along x, one end turned about its own axis."""
    section = cf.Section.round(0.01, youngs_modulus=1e8)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=6)
    part = cf.Part("part", motion=motion)
    return cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=part)]), section


@pytest.mark.parametrize("times", [[3.0], [4.0], [0.0, 4.0], [0.0, 3.0, 4.0]])
def test_more_than_half_a_turn_keeps_its_sense(times):
    """90 deg/s about the rod: a torque of GJ angle / L, not that of the shorter way round."""
    model, section = twisted(cf.Hinge((0, 0, 0), (1, 0, 0), np.pi / 2))
    torque = cf.solve_quasistatic(model, times).hinge_torque("part")[-1]
    assert torque == pytest.approx(section.moment_stiffness[2] * np.pi / 2 * times[-1], rel=1e-5)
    assert cf.solve_static(model, t=times[-1]).hinge_torque("part")[0] == pytest.approx(torque, rel=1e-9)


def test_whole_turns_of_a_path_function_are_seen():
    def turn(t):
        return (1, 0, 0), (np.cos(np.pi * t), np.sin(np.pi * t), 0, 0)

    model, section = twisted(cf.Path(turn))
    for times in ([0, 1], [0, 0.75, 1], [1]):
        moment = cf.solve_quasistatic(model, times).reaction("rod.end@part")[-1, 3]
        assert moment == pytest.approx(section.moment_stiffness[2] * 2 * np.pi, rel=1e-5)


@pytest.mark.parametrize("length", [1.2, 2.0])
def test_straight_drawing_of_a_longer_cable_buckles_to_a_stable_state(length):
    section = cf.Section.round(0.01, youngs_modulus=1e8)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], length=length)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")]))
    assert history.stable == [True]
    assert np.linalg.norm(history.reaction("rod.end@ground")[0, :3]) < 10
    assert "left for a stable one" in history.model.warnings[0]


def test_neutral_motion_is_not_unstable():
    """A half loop between coaxial clamps turns freely about their axis."""
    section = cf.Section.round(0.004, youngs_modulus=5e8, poisson_ratio=0.3)
    ends = {"start_tangent": (1, 0, 0), "end_tangent": (1, 0, 0)}
    rod = cf.Rod("cable", section, [(0, 0, 0), (0.1, -0.1, 0), (0.2, 0, 0)], **ends)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")]))
    assert history.stable == [True]
    assert history.model.warnings == []


def test_interrupted_travel_keeps_what_it_found():
    model = hinge_cable(0.8)

    def callback(k, state):
        if k == 3:
            raise KeyboardInterrupt

    history = cf.solve_quasistatic(model, np.arange(10.0), callback=callback)
    assert len(history) == 4
    assert history.status == "stopped"
    assert "interrupted after t = 3 s" in history.message


def test_start_must_be_a_state_of_the_model():
    other = cf.solve_static(twisted(None)[0])
    for start in (other.final, other):
        with pytest.raises(ValueError, match="must be a State of this model"):
            cf.solve_static(column(0.5), start=start)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda rod: cf.Model(rod), "rods must be a list"),
        (lambda rod: cf.Model(["rod"]), "rods holds Rod"),
        (lambda rod: cf.Model([rod], [cf.Clamp]), "supports holds Clamp, Pin or Weld"),
        (lambda rod: cf.Model([rod], [], ["gravity"]), "terms holds loads"),
        (lambda rod: cf.PointLoad("rod", "end"), "rod must be a Rod"),
        (lambda rod: cf.LineLoad("rod"), "rod must be a Rod"),
        (lambda rod: cf.LineLoad(rod, profile=3), "profile must be a function"),
        (lambda rod: cf.LineLoad(rod, profile=([0.2, 0.6], [1, 1])), "must run along the whole rod"),
        (lambda rod: cf.Part("part", motion="hinge"), "motion must be a Hinge"),
        (lambda rod: cf.Rod("r", rod.section, [(0, 0, 0), (1.2, 0, 0), (0.7, 0, 0), (1, 0, 0)]), "folds back"),
    ],
)
def test_wrong_members(make, message):
    rod = twisted(None)[0].rods[0]
    with pytest.raises(ValueError, match=message):
        make(rod)


def test_step_of_a_line_load_gets_a_node():
    rod = twisted(None)[0].rods[0]
    load = cf.LineLoad(rod, force=(0, 1, 0), profile=([0, 0.37, 0.37, 1], [1, 1, 0, 0]))
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))
    assert history.reaction("rod.start@ground")[0, 1] == pytest.approx(-0.37, rel=1e-12)


def test_gravity_on_a_rod_without_mass_warns():
    rod = twisted(None)[0].rods[0]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.Gravity((0, 0, -9.81))])
    assert "has no mass, so gravity does not act on it" in model.warnings[0]


def bent(plane, force):
    """A cantilever that the plain method cannot bend at once, if the force is large."""
    section = cf.Section(force_stiffness=(1e4,) * 3, moment_stiffness=(1.0, 1.0, 0.8))
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, force, 0))], plane=plane)


@pytest.mark.parametrize("plane", [None, "xy"])
def test_guarded_method_takes_over_in_the_same_call(plane):
    """Where the plain method diverges the guarded one starts from the same state, in the loop and in the compiled call."""
    model = bent(plane, 10.0)
    start = model.initial_state()
    fast, slow = (Newton(model, compiled=compiled) for compiled in (True, False))
    assert not fast.plain(start).converged
    alone, found, same = fast.guarded(start), fast.settled(start), slow.settled(start)
    assert found.guarded and same.guarded and (found.iterations, found.negative) == (same.iterations, same.negative)
    np.testing.assert_array_equal(found.state.r, alone.state.r)
    np.testing.assert_allclose(found.state.r, same.state.r, atol=1e-12)
    assert fast.counters.guarded == 2
    small = Newton(bent(plane, 0.1)).settled(start)
    assert small.converged and not small.guarded


@pytest.mark.parametrize("plane", [None, "xy"])
def test_solves_of_one_model_may_alternate_and_run_in_threads(plane):
    """They share scratch: what one has found, another that comes in between must not change."""
    times = np.linspace(0.0, 1.0, 5)
    forces = np.outer(times, [0.0, 4.0, 0.0])
    section = cf.Section(force_stiffness=(1e4,) * 3, moment_stiffness=(1.0, 1.0, 0.8))
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    loads = [cf.PointLoad(rod, "end", force=(times, forces))]
    alone = [cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], loads, plane=plane), t=t) for t in times]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], loads, plane=plane)
    together = [cf.solve_static(model, t=t) for t in times]
    with ThreadPoolExecutor(4) as pool:
        threads = list(pool.map(lambda t: cf.solve_static(model, t=t), [*times] * 8))
    for history, expected in zip([*together, *threads], [*alone] * 9, strict=True):
        for name in ("r", "q"):
            np.testing.assert_array_equal(getattr(history.final, name), getattr(expected.final, name))
        np.testing.assert_array_equal(history.reaction("rod.start@ground"), expected.reaction("rod.start@ground"))
