"""Supports: what is held stays on its part, what is free carries nothing; joints between rods."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.kernels.rotation import matrix_from_quaternion

SECTION = cf.Section(force_stiffness=(400.0, 400.0, 1000.0), moment_stiffness=(1.0, 1.3, 0.8))
LOAD = (0.4, -0.7, 0.9)


def bar(name="bar", points=((0, 0, 0), (0.6, 0.1, 0), (1, 0, 0.2)), **options):
    return cf.Rod(name, SECTION, points, n_elements=4, order=3, **options)


def frame_at(history, rod, node=-1):
    return history.directors(rod)[-1, node]


@pytest.mark.parametrize(
    "free",
    [(), ("x",), ("z", "rx"), ("rx",), ("ry",), ("rz",), ("rx", "ry"), ("rz", "rx"), ("ry", "rz"), ("rx", "ry", "rz")],
)
@pytest.mark.parametrize("tilted", [False, True])
def test_free_components_carry_nothing_and_held_ones_hold(free, tilted, rng):
    """End on a moving part: free components of the reaction vanish, held ones follow the part, equilibrium holds."""
    rod = bar()
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] if tilted else np.eye(3)
    axes *= np.sign(np.linalg.det(axes))
    part = cf.Part("part", motion=cf.Hinge((0.5, 0, 0), (0.2, 0.1, 1), np.radians(30)))
    held = cf.Clamp(rod, "end", to=part, free=free, frame=axes if tilted else None)
    load = cf.PointLoad(rod, 0.5, force=LOAD)
    model = cf.Model([rod], [cf.Clamp(rod, "start"), held], [load])
    history = cf.solve_static(model, t=1.0)
    R, c = part.pose(1.0)
    reaction = history.reaction(held)[0]
    scale = np.linalg.norm(history.reaction(model.supports[0])[0])
    now = R @ axes
    drawn_R = rod.frames(np.array([0.0, rod.length]))[1]
    relative = now.T @ frame_at(history, rod) @ (R @ drawn_R).T @ now
    place = now.T @ (history.positions(rod)[0, -1] - (R @ rod.points[-1] + c))
    turns = [k for k, name in enumerate(("rx", "ry", "rz")) if name in free]
    for k, name in enumerate("xyz"):
        if name in free:
            assert abs(now[:, k] @ reaction[:3]) < 1e-8 * scale
        else:
            assert abs(place[k]) < 1e-11
    if len(turns) == 1:  # the rotation left is about the free axis
        np.testing.assert_allclose(relative @ np.eye(3)[turns[0]], np.eye(3)[turns[0]], atol=1e-10)
        assert abs(now[:, turns[0]] @ reaction[3:]) < 1e-8 * scale
    elif len(turns) == 2:  # cardan: the first axis stays in the part, the second in the section, no moment about either
        named = [("rx", "ry", "rz").index(n) for n in free if n.startswith("r")]
        first, second = now[:, named[0]], now @ relative @ np.eye(3)[named[1]]
        assert abs(first @ second) < 1e-10
        assert abs(first @ reaction[3:]) < 1e-8 * scale
        assert abs(second @ reaction[3:]) < 1e-8 * scale
    elif len(turns) == 3:
        assert np.linalg.norm(reaction[3:]) < 1e-8 * scale
    else:
        np.testing.assert_allclose(relative, np.eye(3), atol=1e-11)
    total = history.reaction(held)[0, :3] + history.reaction(model.supports[0])[0, :3] + LOAD
    np.testing.assert_allclose(total, 0, atol=1e-8 * scale)


def test_cardan_converges_quadratically():
    """The couple of the two axes is in the tangent: few iterations although the joint carries a moment."""
    rod = bar()
    cardan = cf.Clamp(rod, "end", free=("rx", "rz"))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cardan], [cf.PointLoad(rod, 0.5, force=(1.2, -2.4, 3.2))])
    assert cf.solve_static(model).records[0].iterations <= 6


def test_pin_in_the_middle_and_clip():
    """A pin anywhere along the rod gets a node there and holds it; reactions sum to the load."""
    rod = bar()
    pin = cf.Pin(rod, 0.37)
    model = cf.Model([rod], [cf.Clamp(rod, "start"), pin], [cf.PointLoad(rod, "end", force=LOAD)])
    history = cf.solve_static(model)
    np.testing.assert_allclose(history.support_place(pin)[0], rod.drawn(np.array([0.37]))[0], atol=1e-14)
    assert np.linalg.norm(history.reaction(pin)[0, 3:]) < 1e-9
    total = history.reaction(pin)[0, :3] + history.reaction("bar.start@ground")[0, :3] + LOAD
    np.testing.assert_allclose(total, 0, atol=1e-9)


def test_weld_is_one_rod():
    """A rod cut in two and welded behaves like the whole, also if one half is drawn in the other direction."""
    load = {"force": LOAD, "moment": (0.2, 0.1, -0.3)}
    whole = cf.Rod("w", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=8, order=3, normal=(0, 0, 1))
    one = cf.solve_static(cf.Model([whole], [cf.Clamp(whole, "start")], [cf.PointLoad(whole, "end", **load)]))
    a = cf.Rod("a", SECTION, [(0, 0, 0), (0.5, 0, 0)], n_elements=4, order=3, normal=(0, 0, 1))
    for points, tip in (([(0.5, 0, 0), (1, 0, 0)], "end"), ([(1, 0, 0), (0.5, 0, 0)], "start")):
        b = cf.Rod("b", SECTION, points, n_elements=4, order=3, normal=(0, 0, 1))
        joint = "start" if tip == "end" else "end"
        model = cf.Model([a, b], [cf.Clamp(a, "start"), cf.Weld(a, "end", b, joint)], [cf.PointLoad(b, tip, **load)])
        two = cf.solve_static(model)
        tip_place = two.positions(b)[0, -1 if tip == "end" else 0]
        np.testing.assert_allclose(tip_place, one.positions(whole)[0, -1], atol=1e-11)
        np.testing.assert_allclose(two.reaction("a.start@ground"), one.reaction("w.start@ground"), atol=1e-9)


def test_weld_keeps_its_angle():
    """A branch stays at the drawn angle to its stem while both turn."""
    stem, branch = bar("stem", [(0, 0, 0), (1, 0, 0)]), bar("branch", [(1, 0, 0), (1.2, 0.5, 0.3)])
    model = cf.Model(
        [stem, branch],
        [cf.Clamp(stem, "start"), cf.Weld(stem, "end", branch, "start")],
        [cf.PointLoad(branch, "end", force=(0.5, -1.0, 1.5))],
    )
    history = cf.solve_static(model)
    drawn = stem.frames(np.array([0, 1.0]))[1].T @ branch.frames(np.array([0.0, branch.length]))[0]
    found = frame_at(history, stem).T @ frame_at(history, branch, 0)
    np.testing.assert_allclose(found, drawn, atol=1e-12)
    assert np.arccos(frame_at(history, stem)[0, 2]) > 0.3  # it did turn


def test_support_on_a_joint_takes_both_rods():
    """A clamp where two rods are welded carries the loads of both."""
    a, b = bar("a", [(0, 0, 0), (1, 0, 0)]), bar("b", [(0, 0, 0), (0, 1, 0)])
    clamp = cf.Clamp(b, "start")
    model = cf.Model(
        [a, b],
        [clamp, cf.Weld(a, "start", b, "start")],
        [cf.PointLoad(a, "end", force=(0, 0, -0.1)), cf.PointLoad(b, "end", force=(0, 0, -0.2))],
    )
    history = cf.solve_static(model)
    np.testing.assert_allclose(history.reaction(clamp)[0, :3], (0, 0, 0.3), atol=1e-10)
    tips = history.positions(a)[0, -1], history.positions(b)[0, -1]
    moment = -np.cross(tips[0], (0, 0, -0.1)) - np.cross(tips[1], (0, 0, -0.2))
    np.testing.assert_allclose(history.reaction(clamp)[0, 3:], moment, atol=1e-9)


def test_closed_ring_pulled_apart():
    """A rod welded to itself is a ring: pulled at opposite points it stays closed and symmetric."""
    a = np.linspace(0, 2 * np.pi, 41)
    points = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    ring = cf.Rod(
        "ring", SECTION, points, n_elements=12, order=3, rest="as_drawn", start_tangent=(0, 1, 0), end_tangent=(0, 1, 0)
    )
    half = ring.length / 2
    model = cf.Model(
        [ring],
        [cf.Weld(ring, "start", ring, "end"), cf.Clamp(ring, half)],
        [cf.PointLoad(ring, "end", force=(2.0, 0, 0))],
    )
    history = cf.solve_static(model)
    r = history.positions(ring)[0]
    np.testing.assert_allclose(r[0], r[-1], atol=1e-12)
    np.testing.assert_allclose(r[:, 1], -r[::-1, 1], atol=1e-6)
    assert r[0, 0] > 1.1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda r: cf.Clamp(r, "end", free=("w",)), "free component 'w' is unknown"),
        (lambda r: cf.Clamp(r, "end", free=("x", "x")), "named twice"),
        (lambda r: cf.Clamp(r, "end", free=("x", "y", "z", "rx", "ry", "rz")), "leaves every component free"),
        (lambda r: cf.Pin(r, "end", free=("x", "y", "z")), "leaves every component free"),
        (lambda r: cf.Clamp(r, 2.5), "at = 2.5 m is not on rod 'bar'"),
        (lambda r: cf.Clamp(r, "end", frame=np.ones((3, 3))), "three right-handed unit axes"),
        (lambda r: cf.Clamp(r, "end", frame=np.diag([1.0, 1, -1])), "right-handed"),
        (lambda r: cf.Clamp("bar", "end"), "rod must be a Rod"),
        (lambda r: cf.Clamp(r, "end", to="door"), "to must be a Part"),
        (lambda r: cf.Weld(r, "end", bar("b"), "end").name and cf.Weld(r, "start", bar("b"), "end"), "m apart"),
        (lambda r: cf.Weld(r, "start", r, "start"), "to itself"),
    ],
)
def test_bad_supports(make, message):
    with pytest.raises((ValueError, AttributeError), match=message if "apart" not in message else "apart|no attribute"):
        make(bar())


def test_held_twice():
    """Two supports at one place are named, with what they both hold."""
    rod = bar()
    with pytest.raises(cf.SceneError, match=r"both hold x, y, z\. Use one support"):
        cf.Model([rod], [cf.Clamp(rod, "start"), cf.Pin(rod, 0.0, name="again")])


@pytest.mark.parametrize(
    ("supports", "message"),
    [
        (lambda r: [], "rod 'bar' has no support"),
        (lambda r: [cf.Clamp(r, "start", free=("y",))], "rod 'bar' can still move along y"),
        (lambda r: [cf.Clamp(r, "start", free=("rz",))], "can still turn about the line through .* along z"),
        (lambda r: [cf.Pin(r, "start"), cf.Pin(r, "end")], "can still turn about the line through .* along x"),
    ],
)
def test_too_few_supports(supports, message):
    """The free rigid motion is named in words."""
    rod = bar(points=[(0, 0, 0), (1, 0, 0)])
    with pytest.raises(cf.SceneError, match=message):
        cf.solve_static(cf.Model([rod], supports(rod)))


def test_free_rotation_is_fine_when_loads_hold_it():
    """A cable hanging between two pins swings about its chord, but its weight gives it a place."""
    heavy = cf.Section(force_stiffness=(400, 400, 1e3), moment_stiffness=(1e-3,) * 3, mass_per_length=1.0)
    rod = cf.Rod("c", heavy, [(0, 0, 0), (0.4, 0.05, -0.2), (0.8, 0, 0)], length=1.0)
    history = cf.solve_static(cf.Model([rod], [cf.Pin(rod, "start"), cf.Pin(rod, "end")], [cf.Gravity((0, 0, -9.81))]))
    assert abs(history.positions(rod)[0, :, 1]).max() < 1e-6
    np.testing.assert_allclose(history.reaction("c.start@ground")[0, 2], 9.81 / 2, rtol=1e-8)


def test_directors_follow_quaternions():
    rod = bar()
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=LOAD)]))
    view = history.model.space[rod]
    np.testing.assert_allclose(history.directors(rod)[0], matrix_from_quaternion(history.final.q[view.nodes]))
