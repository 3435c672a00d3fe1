"""Stations of a travel: there and back, and none stepped over that matters."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.equilibrium.march import Clock, Resolution, Watch

DEGREE = np.radians(1.0)
SLENDER = cf.Section(force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=(1e-2, 1e-2, 0.8e-2))


def whisker(friction=0.2, at=15.3, angle=DEGREE):
    """A stiff rod on an arm passes over a small fixed ball: the overlap of 0.3 mm lasts for about a degree."""
    section = cf.Section.round(0.004, youngs_modulus=1e8, poisson_ratio=0.3)
    rod = cf.Rod("whisker", section, [(0.15, 0, 0), (0.25, 0, 0)], n_elements=4)
    arm = cf.Part("arm", motion=cf.Hinge((0, 0, 0), (0, 0, 1), angle))
    a = np.radians(at)
    ball = cf.Part("ball", shape=cf.Sphere((0.2 * np.cos(a), 0.2 * np.sin(a), -0.0047), 0.003))
    touch = cf.PartContact(rod, ball, friction=friction)
    return cf.Model([rod], [cf.Clamp(rod, "start", to=arm), cf.Clamp(rod, "end", to=arm)], [touch])


def cable(load=(0.0, 0.0, 0.0)):
    """A bowed cable to an arm that turns by a degree a second, with a load in its middle, in a plane."""
    s = np.linspace(0, 1, 21)
    points = np.stack([0.9 * s, 0.25 * np.sin(np.pi * s), 0 * s], axis=-1)
    rod = cf.Rod("cable", SLENDER, points, length=1.0, n_elements=8)
    arm = cf.Part("arm", motion=cf.Hinge((0.6, 0, 0), (0, 0, 1), np.radians(1)))
    terms = [cf.PointLoad(rod, 0.5, force=load)]
    return cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)], terms, plane="xy")


def force(history, support=0):
    return np.linalg.norm(history.reaction(history.model.supports[support])[:, :3], axis=1)


def test_both_ways_are_those_of_a_motion_that_turns_back():
    """Out and back over the ball, with friction: as if the hinge's own table went back; times go on, angles do not."""
    times = [0.0, 14.5, 15.0, 15.5, 16.0]
    there = whisker()
    angle = (np.array([0.0, 16.0, 32.0]), np.radians([0.0, 16.0, 0.0]))
    again = whisker(angle=angle)
    both = cf.solve_quasistatic(there, times, travel="both")
    written = cf.solve_quasistatic(again, [*times, 16.5, 17.0, 17.5, 32.0])
    np.testing.assert_allclose(both.t, written.t)
    np.testing.assert_allclose(both.stroke_t, [*times, 15.5, 15.0, 14.5, 0.0])
    np.testing.assert_allclose(both.hinge_angle("arm"), written.hinge_angle("arm"), atol=1e-15)
    peak = abs(written.hinge_torque("arm")).max()
    np.testing.assert_allclose(both.hinge_torque("arm"), written.hinge_torque("arm"), atol=1e-6 * peak)
    np.testing.assert_allclose(
        both.contact_load("ball"), written.contact_load("ball"), atol=1e-6 * force(written).max()
    )
    torque = both.hinge_torque("arm")
    assert abs(torque[3] - torque[5]) > 0.1 * peak  # friction turned over
    assert not both.path


def test_loads_go_back_too():
    """A load that grows with time shrinks on the way back: without friction each state comes again."""
    history = cf.solve_quasistatic(cable(([0, 40], [[0, 0, 0], [0, -0.1, 0]])), np.arange(0, 41, 10.0), travel="both")
    np.testing.assert_allclose(force(history), force(history)[::-1], rtol=1e-8)
    np.testing.assert_allclose(history.t, np.arange(0, 81, 10.0))
    assert history.final.t == 0.0


@pytest.fixture(scope="module")
def over():
    """Asked at 10 and 20 degrees, and finely about the ball without any choice of stations."""
    model = whisker()
    coarse = cf.solve_quasistatic(model, [10.0, 20.0], travel="both", resolution=Resolution())
    fine = np.concatenate([[10], np.arange(14.6, 16.01, 0.02), [20]])
    return coarse, cf.solve_quasistatic(model, fine, travel="both")


def test_a_peak_a_degree_wide_is_found_between_stations_ten_degrees_apart(over):
    """Contact with friction over one degree: largest force, and torque both ways, as in a fine scan."""
    coarse, fine = over
    asked = coarse.t % 10 == 0
    assert force(coarse)[asked].max() < 1e-6 * force(coarse).max()  # the asked stations see nothing
    for way in (slice(0, int(np.argmax(coarse.t >= 20)) + 1), slice(int(np.argmax(coarse.t >= 20)), None)):
        span = coarse.t[way][[0, -1]]
        scan = (fine.t >= span[0]) & (fine.t <= span[1])
        for found, exact in (
            (force(coarse)[way], force(fine)[scan]),
            (coarse.hinge_torque("arm")[way], fine.hinge_torque("arm")[scan]),
            (-coarse.hinge_torque("arm")[way], -fine.hinge_torque("arm")[scan]),
        ):
            assert found.max() == pytest.approx(exact.max(), abs=2e-3 * abs(exact).max())
            assert coarse.t[way][found.argmax()] == pytest.approx(fine.t[scan][exact.argmax()], abs=0.03)
    assert len(coarse) < 100


def test_friction_goes_through_all_stations(over):
    """The work lost never shrinks, and is that of the fine scan: stations were inserted on the way, not afterwards."""
    coarse, fine = (history.friction_work(history.model.contacts[0].name) for history in over)
    assert (np.diff(coarse) >= 0).all()
    assert coarse[-1] == pytest.approx(fine[-1], rel=0.02)


def test_peak_of_a_load_is_located():
    """A spike of a load one degree wide, asked at every 5 degrees: found, without it missed."""
    spike = ([0, 32.2, 32.7, 33.2, 40], [[0, 0, 0], [0, 0, 0], [0, -0.3, 0], [0, 0, 0], [0, 0, 0]])
    model, times = cable(spike), np.arange(0, 41, 5.0)
    blind = cf.solve_quasistatic(model, times)
    history = cf.solve_quasistatic(model, times, resolution=Resolution())
    k = int(np.argmax(force(history)))
    assert history.t[k] == pytest.approx(32.7, abs=1e-3)
    exact = cf.solve_quasistatic(model, [*times[times < 32], 32.7])
    assert force(history)[k] == pytest.approx(force(exact)[-1], rel=2e-3)
    assert force(blind).max() < 0.7 * force(history)[k]
    assert set(times) <= set(history.t)


def test_curves_are_straight_between_the_stations_kept():
    """Torque and forces between its stations are on the straight lines through them."""
    model = cable()
    history = cf.solve_quasistatic(model, [0.0, 60.0], resolution=Resolution(bend=1e-2))
    fine = cf.solve_quasistatic(model, np.arange(0, 61, 0.5))
    assert 4 < len(history) < 60
    for curve in (force, lambda h: h.hinge_torque("arm"), lambda h: 1 / cf.bend_radius(h, "cable").min(axis=1)):
        line = np.interp(fine.t, history.t, curve(history))
        np.testing.assert_allclose(line, curve(fine), atol=1.5e-2 * abs(curve(fine)).max())


def test_what_is_watched_besides():
    """The smallest value of a number of one's own is a station, though nothing else has a peak there."""
    model = cable()
    dip = Watch("dip", lambda history: np.abs(np.degrees(history.hinge_angle("arm")) - 17.3), "smallest")
    history = cf.solve_quasistatic(model, [0.0, 30.0], resolution=Resolution(watch=[dip]))
    assert abs(history.t - 17.3).min() < 0.04


def test_a_snap_stands_between_the_right_stations():
    """Limit points keep their place among the stations that stay."""
    rod = cf.Rod("strip", SLENDER, [(0, 0, 0), (0.5, 0, 0.03), (1, 0, 0)], rest="as_drawn", n_elements=8)
    load = cf.PointLoad(rod, 0.5 * rod.length, force=([0, 10], [[0, 0, 0], [0, 0, -3.0]]))
    model = cf.Model([rod], [cf.Pin(rod, "start"), cf.Pin(rod, "end")], [load], plane="xz")
    history = cf.solve_quasistatic(model, [0.0, 5.0, 10.0], travel="both", resolution=Resolution())
    limits = [event for event in history.critical if event.kind == "limit"]
    assert len(limits) == 1
    for event in history.critical:
        span = sorted(history.stroke_t[[event.station, event.station + 1]])
        assert span[0] <= event.t <= span[1]


def test_stopped_on_the_way_back():
    """The callback counts asked stations, both ways; what was found stays."""
    asked = []

    def callback(k, state):
        asked.append((k, state.t))
        return k == 5

    history = cf.solve_quasistatic(
        cable(), [0.0, 2.0, 4.0, 6.0], travel="both", resolution=Resolution(), callback=callback
    )
    assert asked == [(0, 0.0), (1, 2.0), (2, 4.0), (3, 6.0), (4, 4.0), (5, 2.0)]
    assert history.status == "stopped"
    assert history.t[-1] == 10.0
    assert "t = 10 s" in history.message


def test_failure_on_the_way_keeps_what_was_found(monkeypatch):
    from dataclasses import replace

    from cosserat_fem.iteration.newton import Newton

    for name in ("plain", "guarded"):
        whole = getattr(Newton, name)

        def lost(self, state, *, whole=whole, **options):
            solved = whole(self, state, **options)
            return replace(solved, reason="lost") if state.t > 3.2 else solved

        monkeypatch.setattr(Newton, name, lost)
    with pytest.raises(cf.ConvergenceError, match="on the way to t = 3.5 s; what was found") as caught:
        cf.solve_quasistatic(cable(), [0.0, 2.0, 6.0], resolution=Resolution())
    history = caught.value.history
    assert history.status == "stopped"
    assert history.message == str(caught.value)
    assert history.t[0] == 0.0 and 2.0 in history.t and history.t[-1] == 3.0


def test_accuracy_asked_of_both_ways():
    """Elements are chosen with few stations; the whole travel has its own, and what lies between."""
    history = cf.solve_quasistatic(
        cable(), np.arange(0, 41, 20.0), travel="both", accuracy=1e-3, resolution=Resolution(turn=np.radians(2))
    )
    assert {0.0, 20.0, 40.0, 60.0, 80.0} <= set(history.t)
    assert history.chosen.estimate < 1e-3
    assert len(history) > 5


def test_clock():
    clock = Clock(10.0)
    assert [clock.at(t) for t in (0.0, 10.0, 12.0, 20.0)] == [0.0, 10.0, 8.0, 0.0]
    assert [clock.back(t) for t in (0.0, 10.0, 12.0)] == [False, False, True]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cf.solve_quasistatic(cable(), [0, 1], travel="back"), "travel must be 'out' or 'both'"),
        (lambda: cf.solve_quasistatic(cable(), [0], travel="both"), "needs at least two times"),
        (lambda: Resolution(turn=0.0), "resolution: turn: must be greater than 0"),
        (lambda: Resolution(peak=2.0), "peak must be below 1"),
        (lambda: Resolution(watch=["torque"]), "watch must be a list of Watch"),
        (lambda: Watch("x", len, "highest"), "peaks must be 'largest', 'smallest', 'both' or 'none'"),
    ],
)
def test_wrong_arguments(make, message):
    with pytest.raises(ValueError, match=message):
        make()
