"""Planted violations are found where and when closed forms have them; what is not known is not called safe."""

import numpy as np
import pytest
from scipy.special import ellipk

import cosserat_fem as cf
from cosserat_fem.limits.verdicts import least_margin, overall

D, E = 0.01, 1e9
EA, EI = E * np.pi / 4 * D**2, E * np.pi / 64 * D**4
SECTION = cf.Section.round(D, youngs_modulus=E, poisson_ratio=0.3, density=1000.0)
TIMES = np.linspace(0.0, 6.0, 7)


def judge(history, *limits, **options):
    """The verdicts by name, without an estimate of errors unless asked for."""
    return {v.name: v for v in cf.check(history, limits, **{"estimate": False, **options})}


def cantilever(
    section=SECTION, *, moment=None, force=None, times=TIMES, gravity=None, points=((0, 0, 0), (1, 0, 0)), **options
):
    """A rod held at its start, with a load at its end and weight."""
    rod = cf.Rod("a", section, points, **{"n_elements": 10, **options})
    loads = [cf.PointLoad(rod, "end", force or (0, 0, 0), moment or (0, 0, 0))]
    loads += [cf.Gravity(gravity)] if gravity is not None else []
    return cf.solve_quasistatic(cf.Model([rod], [cf.Clamp(rod, "start")], loads), times)


def pulse(axis, size, peak=4.0, low=0.2):
    """A load that grows to its peak at a time and falls again."""
    unit = np.eye(3)[axis]
    return [0.0, peak, 6.0], [low * size * unit, size * unit, low * size * unit]


@pytest.fixture(scope="module")
def bent():
    """End moment on a rod whose bending stiffness has its minimum at s = 0.62 m: curvature is M / EI everywhere."""

    def sized(d):
        return cf.Section.round(d, youngs_modulus=E * (D / d) ** 2, poisson_ratio=0.3)

    sections = [(0.0, sized(1.4 * D)), (0.62, sized(D)), (1.0, sized(1.3 * D))]
    return cantilever(sections, moment=pulse(2, EI / 0.5), n_elements=16)


def test_too_tight(bent):
    """The tightest bend, 0.5 m at its centreline, where the rod is softest and when the moment is largest."""
    [found] = judge(bent, cf.Limit("bend_radius", 0.6)).values()
    assert found.status == "UNSAFE"
    assert found.s == pytest.approx(0.62, abs=1 / 16)
    assert found.t == 4.0
    assert found.value == pytest.approx(0.5 - D / 2, rel=1e-3)
    assert found.margin == pytest.approx(0.5 / (0.6 + D / 2) - 1, abs=1e-3)
    assert found.course.along.shape == (7, len(bent.nodes("a")))
    assert found.course.along.min() == found.margin


def test_inside_and_centreline_differ_by_half_the_cable(bent):
    """A radius between both passes at the centreline and fails inside; diameters and rules count from the inside."""
    between = 0.5 - D / 4
    found = judge(
        bent, cf.Limit("bend_radius", between), cf.Limit("bend_radius", between, measured="centreline", name="c")
    )
    assert [v.status for v in found.values()] == ["UNSAFE", "SAFE"]


@pytest.mark.parametrize(
    ("options", "limit"),
    [
        ({"diameters": 6}, 6 * D),
        ({"rule": "NASA-STD-8739.4 coax minimum"}, 6 * D),
        ({"rule": "nasa-std-8739.4  kapton long-term"}, 15 * D),
        ({"rule": "AS50881 supported", "wire_diameter": 0.002}, 0.006),
    ],
)
def test_limits_in_diameters(options, limit):
    history = cantilever(moment=(0, 0, EI / 0.2), times=[0.0])
    [found] = judge(history, cf.Limit("bend_radius", **options)).values()
    assert found.limit == pytest.approx(limit)
    assert found.value == pytest.approx(0.2 - D / 2, rel=1e-4)


def test_rectangle_bends_about_its_thin_side():
    """The inside of a ribbon's bend is half its thickness from the centreline, and its diameter is its thickness."""
    ribbon = cf.Section.rectangle(0.05, 0.002, youngs_modulus=E)  # width along d1, the normal
    stiffness = E * 0.05 * 0.002**3 / 12
    history = cantilever(ribbon, moment=(0, stiffness / 0.4, 0), normal=(0, 1, 0), times=[0.0])
    found = judge(history, cf.Limit("bend_radius", diameters=10), cf.Limit("strain", 0.01))
    assert found["bend radius of a"].value == pytest.approx(0.4 - 0.001, rel=1e-6)
    assert found["bend radius of a"].limit == pytest.approx(0.02)
    assert found["strain of a"].value == pytest.approx(0.001 / 0.4, rel=1e-6)


def test_too_taut():
    """A cable that hangs and is pulled: its own weight and the pull at the top, when the pull is largest."""
    history = cantilever(points=((0, 0, 0), (0, 0, -1)), gravity=(0, 0, -9.81), force=pulse(2, -5.0))
    weight = 1000.0 * np.pi / 4 * D**2 * 9.81
    found = judge(history, cf.Limit("tension", 5.5), cf.Limit("compression", 1.0), cf.Limit("reaction_force", 5.5))
    tension = found["tension of a"]
    assert (tension.status, tension.s, tension.t) == ("UNSAFE", 0.0, 4.0)
    assert tension.value == pytest.approx(weight + 5.0, rel=1e-6)
    assert tension.margin == pytest.approx(1 - tension.value / 5.5)
    assert found["compression of a"].status == "SAFE"
    assert found["compression of a"].value == 0.0
    assert found["reaction force at a.start@ground"].value == pytest.approx(weight + 5.0, rel=1e-9)


def test_pushed_strained_and_twisted():
    """F / EA, M d / 2 EI and T / GJ of a short rod that does not buckle."""
    history = cantilever(force=(-8.0, 0, 0), moment=(0.05, 0, 0), points=((0, 0, 0), (0.1, 0, 0)), times=[0.0])
    twist = 0.05 / (E / 2.6 * np.pi / 32 * D**4)
    found = judge(history, cf.Limit("compression", 7.0), cf.Limit("strain", 1e-5), cf.Limit("twist", 0.1))
    assert found["compression of a"].value == pytest.approx(8.0, rel=1e-6)
    assert found["strain of a"].value == pytest.approx(8.0 / EA, rel=1e-3)
    assert found["twist of a"].value == pytest.approx(twist, rel=1e-6)
    assert {v.status for v in found.values()} == {"UNSAFE"}


def test_a_jump_of_force_is_not_averaged():
    """Beside a load in mid-span a section carries all of it or nothing; the check sees the side that carries it."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (0, 0, -1)], n_elements=4)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, 0.5, (0, 0, -3.0))])
    [found] = judge(cf.solve_static(model), cf.Limit("tension", 2.9)).values()
    at_load = np.argmin(np.abs(found.course.nodes - 0.5))
    np.testing.assert_allclose(found.course.along[0, : at_load + 1], 1 - 3.0 / 2.9, atol=1e-9)
    np.testing.assert_allclose(found.course.along[0, at_load + 1 :], 1.0, atol=1e-9)


@pytest.fixture(scope="module")
def arm():
    """A stiff rod on an arm that turns about y through the horizontal, under weight; a ball and a post on the way."""
    stiff = cf.Section.round(D, youngs_modulus=1e14, poisson_ratio=0.3, density=1000.0)
    rod = cf.Rod("a", stiff, [(0.1, 0, 0), (0.6, 0, 0)], n_elements=5)
    turn = cf.Part("arm", motion=cf.Hinge((0, 0, 0), (0, 1, 0), ([0.0, 6.0], np.radians([60.0, -30.0]))))
    rod2 = cf.Rod("b", stiff, [(0.3, -0.2, 0), (0.3, 0.2, 0)], n_elements=6)
    model = cf.Model([rod, rod2], [cf.Clamp(rod, "start", turn), cf.Clamp(rod2, "start")], [cf.Gravity((0, 0, -9.81))])
    return cf.solve_quasistatic(model, np.linspace(0.0, 6.0, 10))  # 10 deg apart


def test_too_much_torque_and_moment(arm):
    """Weight times arm: the hinge's torque and the clamp's moment are largest when the rod is horizontal, at 0 deg."""
    weight = 1000.0 * np.pi / 4 * D**2 * 0.5 * 9.81
    found = judge(arm, cf.Limit("hinge_torque", 0.1), cf.Limit("reaction_moment", 0.9, support="a.start@arm"))
    torque, moment = found["hinge torque of arm"], found["reaction moment at a.start@arm"]
    for verdict, lever in ((torque, 0.35), (moment, 0.25)):
        assert verdict.value == pytest.approx(weight * lever, rel=1e-4)
        assert verdict.angle == pytest.approx(0.0, abs=1e-9)
        assert verdict.t == 4.0
    assert torque.status == "UNSAFE"
    assert moment.status == "SAFE"
    assert moment.margin == pytest.approx(1 - weight * 0.25 / 0.9, abs=1e-4)


def test_touching(arm):
    """The rod passes a ball beside its plane at 10 deg: nearest where and when it points at it; then through a ball."""
    x = 0.45 * np.array([np.cos(np.radians(10)), 0, -np.sin(np.radians(10))])
    beside = cf.Part("ball", shape=cf.Sphere(x + [0, 0.03, 0], 0.02))
    there = cf.Part("there", shape=cf.Sphere(x, 0.01))
    found = judge(arm, cf.Limit("clearance", 0.006, rod="a"), parts=[beside, there])
    near = found["clearance of a from ball"]
    assert near.value == pytest.approx(0.03 - 0.02 - D / 2, abs=1e-6)
    assert near.status == "UNSAFE"
    assert near.angle == pytest.approx(10.0)
    assert near.s == pytest.approx(0.35, abs=1e-4)
    assert near.reason == ""
    assert near.course.along[near.station].min() == pytest.approx(near.margin)
    inside = found["clearance of a from there"]
    assert inside.value == pytest.approx(-0.01 - D / 2, abs=1e-6)
    assert inside.reason.startswith("from t = 3.33333 s on a runs through there, as there is no [[contact]]")


def test_cables_too_near(arm):
    """Two rods that cross at 0 deg: nearest where they do, their centrelines in one another."""
    [found] = judge(arm, cf.Limit("clearance", 0.0, rod="a", other="b")).values()
    assert found.name == "clearance of a from b"
    assert found.value == pytest.approx(-D, abs=1e-4)
    assert found.s == pytest.approx(0.2, abs=1e-3)
    assert found.t == 4.0
    assert found.status == "UNSAFE"
    apart = 0.3 * np.sin(np.radians(10)) - D  # 10 deg before and after
    np.testing.assert_allclose(found.course.value[[5, 7]], apart, atol=1e-4)


def test_touching_by_contact():
    """A rod that a ball presses down: a limit of 0 means that it may touch, any other that it may not."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=12)
    low = cf.Slider((0, 0, 1), ([0.0, 2.0], [0.01, -0.02]))
    ball = cf.Part("ball", shape=cf.Sphere((0.9, 0, 0.1 + D / 2), 0.1), motion=low)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PartContact(rod, ball)])
    history = cf.solve_quasistatic(model, [0.0, 1.0, 2.0])
    found = judge(history, cf.Limit("clearance", 0.0), cf.Limit("clearance", 0.001, name="apart"))
    assert found["clearance of a from ball"].status == "SAFE"
    assert abs(found["clearance of a from ball"].value) < 1e-4
    assert found["apart"].status == "UNSAFE"
    assert found["apart"].reason == "it touches ball at t = 1 s"
    assert found["apart"].s == pytest.approx(0.9, abs=0.02)


def test_in_time():
    """A stiff rod swings down from the horizontal about its pinned end: there 5/2 of its weight pull as it passes below, a
    quarter of its period after the start: K(1/2) sqrt(2 L / 3 g), with the elliptic integral K."""
    stiff = cf.Section.round(D, youngs_modulus=1e9, poisson_ratio=0.3, density=1000.0)
    rod = cf.Rod("a", stiff, [(0, 0, 0), (0.5, 0, 0)], n_elements=4)
    pin = cf.Pin(rod, "start", name="pivot")
    model = cf.Model([rod], [pin], [cf.Gravity((0, 0, -9.81)), cf.Damping((0,) * 6, 1e-4, 0.0, None)])
    history = cf.solve_dynamic(model, 0.5, start="drawn", times=np.linspace(0, 0.5, 126), step=cf.AdaptiveStep(1e-3))
    weight, quarter = 1000.0 * np.pi / 4 * D**2 * 0.5 * 9.81, ellipk(0.5) * np.sqrt(2 * 0.5 / (3 * 9.81))
    limits = cf.Limit("tension", 2.4 * weight), cf.Limit("reaction_force", 3.0 * weight)
    pull, force = judge(history, *limits, estimate=True).values()
    assert pull.status == "UNSAFE"
    assert pull.s == 0.0
    assert pull.t == pytest.approx(quarter, abs=0.01)
    assert pull.value == pytest.approx(2.5 * weight, rel=0.01)
    assert force.status == "SAFE"
    assert force.value == pytest.approx(2.5 * weight, rel=0.01)
    assert 0 < force.error < force.margin


def test_along_a_path_of_loads():
    """A column under its own factor: the errors are those at the factor of each state; Euler's load is not reached."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (0, 0, 1)], n_elements=4)
    loads = [cf.PointLoad(rod, "end", (0.02, 0, -1.0))]
    history = cf.trace_path(
        cf.Model([rod], [cf.Clamp(rod, "start")], loads), until=0.8 * np.pi**2 / 4 * EI, longest=0.1
    )
    [found] = judge(history, cf.Limit("reaction_moment", 1.0), estimate=True).values()
    assert found.status == "SAFE"
    assert found.factor == history.factors[found.station]
    moment = np.linalg.norm(history.reaction("a.start@ground")[found.station, 3:])
    assert found.value == moment
    assert 0 < found.error < 1e-4 * moment


def test_margin_of_least_limits_is_monotone_and_bounded():
    value = np.array([-0.3, 0.0, 0.5, 1.0, 2.0, 1e9, np.inf])
    margin = least_margin(value, 1.0)
    assert (np.diff(margin[:-1]) > 0).all()
    np.testing.assert_allclose(margin[[1, 2, 3, 4, 6]], [-1, -0.5, 0, 0.5, 1])


def test_error_larger_than_the_margin_is_unknown():
    """Two elements of order 1 bend badly: the estimated error of the bend is larger than what is left of the limit."""
    history = cantilever(force=(0, 0.2, 0), n_elements=2, order=1, times=[0.0])
    [rough] = judge(history, cf.Limit("bend_radius", 0.5), estimate=True).values()
    assert rough.error > 0
    limit = rough.value - 0.1 * rough.error * rough.value
    [near] = judge(history, cf.Limit("bend_radius", limit), estimate=True).values()
    assert near.status == "UNKNOWN"
    assert near.margin > 0
    assert "discretisation error" in near.reason
    [far] = judge(history, cf.Limit("bend_radius", 0.1 * rough.value), estimate=True).values()
    assert far.status == "SAFE"
    assert 0 < far.error < far.margin


def test_run_that_stopped_is_unknown_unless_it_is_violated(bent):
    part = cf.History(bent.model, bent.records[:3], "stopped", "out of patience")
    found = judge(part, cf.Limit("bend_radius", 0.2), cf.Limit("bend_radius", 5.0, name="wide"))
    assert [v.status for v in found.values()] == ["UNKNOWN", "UNSAFE"]
    assert found["bend radius of a"].reason == "the run stopped early, after t = 2 s"
    assert overall(v.status for v in found.values()) == "UNSAFE"


def test_stations_that_may_step_over_a_peak_are_unknown():
    """A moment that peaks at 4 s, kept at 3 and 5 s only: what lies between is not called safe; with 4 s it is known."""
    moment = pulse(2, EI / 0.5, low=0.0)
    limit = cf.Limit("reaction_moment", 1.02 * EI / 0.5)
    [found] = judge(cantilever(moment=moment, times=[0.0, 1.0, 2.0, 3.0, 3.9]), limit).values()
    assert found.status == "SAFE"
    [found] = judge(
        cantilever(moment=([0, 4, 8], moment[1]), times=[1.0, 2.0, 3.0, 5.0, 6.0, 7.0]),
        cf.Limit("reaction_moment", 0.98 * EI / 0.5),
    ).values()
    assert found.status == "UNKNOWN"
    assert found.reason.startswith("stations are too far apart: between t = 3 s and 5 s")
    [found] = judge(cantilever(moment=([0, 4, 8], moment[1])), cf.Limit("reaction_moment", 1.02 * EI / 0.5)).values()
    assert found.status == "SAFE"


def test_unstable_equilibrium_is_unknown():
    """A strut that stands straight above its critical load."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (0, 0, 1)], n_elements=6)
    load = 1.5 * np.pi**2 / 4 * EI
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", (0, 0, -load))])
    history = cf.solve_static(model)
    record = history.records[0]
    standing = cf.History(model, [type(record)(record.state, record.reactions, 1, 0.0, 2)])
    [found] = judge(standing, cf.Limit("reaction_force", 2 * load)).values()
    assert found.status == "UNKNOWN"
    assert "unstable" in found.reason


def test_what_has_no_value_is_unknown(arm):
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=4, length=1.2)
    model = cf.Model(
        [rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -9.81))], theory="string"
    )
    found = judge(cf.solve_static(model), cf.Limit("bend_radius", 0.1), cf.Limit("tension", 100.0))
    assert found["bend radius of a"].status == "UNKNOWN"
    assert found["bend radius of a"].reason == "a string does not bend"
    assert found["tension of a"].status == "SAFE"
    ball = cf.Part("ball", shape=cf.Sphere((0, 0, 0), 0.02))
    [found] = judge(arm, cf.Limit("clearance", 0.01, rod="a", part=ball, leave_out=[(0.0, 0.5)]), parts=[ball]).values()
    assert found.status == "UNKNOWN"
    assert found.told()["margin"]["value"] is None


def test_stretches_beside_supports_are_left_out():
    """A rod that leaves the part that holds it along its surface: three radii of it, or twice the wanted distance."""
    held = cf.Part("plate", shape=cf.Plane((0, 0, -0.02), (0, 0, 1)))
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (1, 0, 0.5)], n_elements=5)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start", held)]))
    slope = 0.5 / np.hypot(1, 0.5)
    for limit, length in ((0.0, 3 * D / 2), (0.02, 2 * (0.02 + D / 2))):
        [found] = judge(history, cf.Limit("clearance", limit)).values()
        assert found.value == pytest.approx(0.02 + slope * length - D / 2, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantity": "bend"}, "quantity 'bend' is unknown. Known: 'bend_radius'"),
        ({"quantity": "tension"}, "needs the key 'limit'"),
        ({"quantity": "bend_radius"}, "needs one of 'limit', 'diameters' and 'rule'"),
        ({"quantity": "bend_radius", "value": 0.1, "diameters": 6}, "needs one of"),
        ({"quantity": "tension", "value": -1.0}, "limit: must be greater than 0"),
        ({"quantity": "clearance", "value": -1.0}, "limit: must be at least 0"),
        ({"quantity": "bend_radius", "diameters": 0}, "diameters: must be greater than 0"),
        (
            {"quantity": "bend_radius", "rule": "NASA-STD-8739.4 coax minimun"},
            "Did you mean 'NASA-STD-8739.4 coax minimum'",
        ),
        ({"quantity": "bend_radius", "rule": "ESCC 3901"}, "gives no least bend radius"),
        ({"quantity": "bend_radius", "rule": "AS50881 supported"}, "give wire_diameter"),
        ({"quantity": "bend_radius", "value": 0.1, "wire_diameter": 0.1}, "wire_diameter: goes with a rule"),
        ({"quantity": "bend_radius", "rule": "AS50881 supported", "measured": "centreline"}, "speaks of the inside"),
        ({"quantity": "tension", "value": 1.0, "support": "x"}, "support: does not go with tension"),
        ({"quantity": "reaction_force", "value": 1.0, "rod": "a"}, "rod: does not go with reaction_force"),
        ({"quantity": "clearance", "value": 1.0, "part": "x", "other": "b"}, "not both"),
        ({"quantity": "clearance", "value": 1.0, "leave_out": [(0.3, 0.2)]}, "from a smaller to a larger s"),
    ],
)
def test_wrong_limits(options, message):
    with pytest.raises(ValueError, match=message):
        cf.Limit(**options)


def test_limits_on_what_is_not_there(arm, bent):
    for history, limits, message in (
        (arm, [cf.Limit("tension", 1.0, rod="c")], "no rod named 'c'"),
        (arm, [cf.Limit("reaction_force", 1.0, support="a.start@ground")], "no support named"),
        (arm, [cf.Limit("hinge_torque", 1.0, part="leg")], "no hinge named 'leg'"),
        (arm, [cf.Limit("clearance", 1.0, part="arm")], "no part with a surface named 'arm'"),
        (bent, [cf.Limit("hinge_torque", 1.0)], "hinge_torque: there is nothing to check: no hinge"),
        (bent, [cf.Limit("clearance", 1.0)], "clearance: there is nothing to check: no part with a surface"),
        (arm, [cf.Limit("tension", 1.0), cf.Limit("tension", 2.0, rod="a")], "two checks are called 'tension of a'"),
    ):
        with pytest.raises(ValueError, match=message):
            cf.check(history, limits)
    general = cf.Section(force_stiffness=(1e3, 1e3, 1e3), moment_stiffness=(1.0, 1.0, 1.0))
    history = cantilever(general, times=[0.0])
    with pytest.raises(ValueError, match="bend_radius: a section of rod 'a' has no radius"):
        cf.check(history, [cf.Limit("bend_radius", 0.1)])
    assert judge(history, cf.Limit("bend_radius", 0.1, measured="centreline"))["bend radius of a"].status == "SAFE"
