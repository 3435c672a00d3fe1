"""Planar models: the same results as in space, what "auto" decides and says, errors by name, sideways stability."""

import json

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration import newton
from cosserat_fem.iteration.newton import Newton

SECTION = cf.Section(
    force_stiffness=(400, 500, 1000), moment_stiffness=(0.1, 0.2, 0.08), mass_per_length=0.05,
    rotary_inertia=(2e-4, 1e-4, 3e-4),
)  # fmt: skip
AXES = {"xy": (0, 1, 2), "yz": (1, 2, 0), "xz": (0, 2, 1)}


def vector(plane, a, b):
    """Components a, b along the two axes of a plane."""
    out = np.zeros(3)
    out[AXES[plane][0]], out[AXES[plane][1]] = a, b
    return out


def normal(plane, size=1.0):
    out = np.zeros(3)
    out[AXES[plane][2]] = size
    return out


def rod_in(plane, name="rod", points=((0, 0), (0.3, 0.1), (0.8, 0)), **options):
    options = {"n_elements": 6, "order": 2, "length": 0.95} | options
    return cf.Rod(name, SECTION, [vector(plane, *p) for p in points], **options)


def cantilever(plane, load):
    rod = rod_in(plane)
    return [rod], [cf.Clamp(rod, "start")], [load(rod, plane)]


def cable(plane):
    """A slack cable between a wall and an arm that turns."""
    rod = rod_in(plane)
    arm = cf.Part("arm", motion=cf.Hinge(vector(plane, 0.5, 0), normal(plane), ([0, 1], [0, 1.2])))
    return [rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)], [cf.Gravity(vector(plane, 0, -9.81))]


def frame(plane):
    """Three rods welded at one point and two more at another, one end on a tilted guide."""
    a = rod_in(plane, "a", ((0, 0), (0.5, 0)), length=None)
    b = rod_in(plane, "b", ((0.5, 0), (0.5, -0.4)), length=None)
    c = rod_in(plane, "c", ((0.5, 0), (0.9, 0.3)), length=None)
    d = rod_in(plane, "d", ((0.9, 0.3), (1.2, 0.1)), length=None)
    guide = np.stack([vector(plane, 0.6, 0.8), normal(plane), vector(plane, 0.8, -0.6)], axis=1)
    guide[:, 1] *= np.sign(np.linalg.det(guide))
    supports = [
        cf.Clamp(a, "start"), cf.Pin(b, "end"), cf.Clamp(d, "end", free=("x", "ry"), frame=guide),
        cf.Weld(a, "end", b, "start"), cf.Weld(a, "end", c, "start"), cf.Weld(c, "end", d, "start"),
    ]  # fmt: skip
    loads = [cf.LineLoad(a, force=vector(plane, 0, -3)), cf.PointLoad(c, 0.2, force=vector(plane, 1, 2))]
    return [a, b, c, d], supports, loads


LOADS = {
    "force": lambda rod, plane: cf.PointLoad(rod, "end", force=vector(plane, 0.4, -0.9)),
    "moment": lambda rod, plane: cf.PointLoad(rod, 0.5, moment=normal(plane, 0.2)),
    "line": lambda rod, plane: cf.LineLoad(
        rod, force=vector(plane, 0.3, -1), moment=normal(plane, 0.05), profile=([0, 0.95], [1, 2])
    ),
    "following": lambda rod, plane: cf.LineLoad(rod, force=section_force(rod, plane, 0.6, 0.2), follower=True),
    "normal": lambda rod, plane: cf.LineLoad(rod, force=vector(plane, 0.5, -1), components="normal"),
    "gravity": lambda rod, plane: cf.Gravity(vector(plane, 3, -9.81)),
}  # fmt: skip


def section_force(rod, plane, across, along):
    """A force along d1, d2, d3 that lies in the plane."""
    R = rod.frames(np.array([0.0, rod.length]))[0]
    out = across * R.T @ np.cross(normal(plane), R[:, 2])
    out[2] = along
    return out


def both(parts, plane, **options):
    return cf.Model(*parts, **options), cf.Model(*parts, plane=plane, **options)


def assert_same(a, b, tolerance=1e-10):
    """Histories of one scene in space and in a plane."""
    for rod in a.model.rods:
        np.testing.assert_allclose(b.positions(rod), a.positions(rod), atol=tolerance)
        np.testing.assert_allclose(b.directors(rod), a.directors(rod), atol=tolerance)
        force = a.section_forces(rod)
        np.testing.assert_allclose(b.section_forces(rod), force, atol=tolerance * max(1.0, abs(force).max()))
    for support in a.model.supports:
        np.testing.assert_allclose(b.reaction(support), a.reaction(support), atol=1e-9)


@pytest.mark.parametrize("plane", ["xy", "yz", "xz"])
@pytest.mark.parametrize("load", LOADS)
def test_statics_is_that_of_space(load, plane):
    space, flat = both(cantilever(plane, LOADS[load]), plane)
    assert flat.plane.name == plane and space.plane is None
    a, b = cf.solve_static(space), cf.solve_static(flat)
    assert_same(a, b)
    assert b.counters.iterations <= a.counters.iterations + 1


@pytest.mark.parametrize("plane", ["xy", "xz"])
def test_frame_with_joints_and_a_tilted_guide_is_that_of_space(plane):
    space, flat = both(frame(plane), plane)
    assert_same(cf.solve_static(space), cf.solve_static(flat))


def test_quasistatic_travel_is_that_of_space():
    space, flat = both(cable("xz"), "xz")
    times = np.linspace(0, 1, 5)
    assert_same(cf.solve_quasistatic(space, times), cf.solve_quasistatic(flat, times))


@pytest.mark.parametrize(
    "parts",
    [
        cable("xy"),
        (*cantilever("yz", LOADS["following"])[:2], [LOADS["gravity"](None, "yz"), cf.Damping(time=1e-3)]),
        (*frame("xy")[:2], [cf.Gravity((0, -9.81, 0))]),
    ],
    ids=["arm", "damped", "frame"],
)
@pytest.mark.parametrize("step", [cf.FixedStep(0.02), cf.AdaptiveStep(1e-2)], ids=["fixed", "adaptive"])
def test_run_in_time_is_that_of_space(parts, step):
    space, flat = both(parts, "auto")
    assert flat.plane is not None
    a, b = (cf.solve_dynamic(m, 0.2, step=step, times=np.linspace(0, 0.2, 5)) for m in (space, flat))
    assert len(a.steps) == len(b.steps)
    for rod in space.rods:
        np.testing.assert_allclose(b.positions(rod), a.positions(rod), atol=1e-9)
        np.testing.assert_allclose(b.velocities(rod), a.velocities(rod), atol=1e-6)
    for name, work in a.ledger.items():
        np.testing.assert_allclose(b.ledger[name], work, atol=1e-8)


@pytest.mark.parametrize("plane", [None, "xz"])
def test_steps_in_one_call_are_those_made_one_by_one(plane, monkeypatch):
    """Outputs, kinks of the motion and of a load, and steps that fail do not change what is found."""
    rods, supports, terms = cable("xz")
    load = cf.PointLoad(rods[0], 0.4, force=([0, 0.11, 0.11, 0.4], [vector("xz", 0, f) for f in (0, 1, 0.5, 0)]))
    model = cf.Model(rods, supports, [*terms, load], plane=plane)

    def run():
        return cf.solve_dynamic(model, 0.3, step=cf.FixedStep(0.01), times=[0, 0.05, 0.1, 0.2, 0.3])

    together = run()
    monkeypatch.setattr("cosserat_fem.motion.integrator.Run._advance_together", lambda run: False)
    single = run()
    assert [s[:2] for s in together.steps] == [s[:2] for s in single.steps]
    assert together.counters.iterations == single.counters.iterations
    np.testing.assert_allclose(together.positions("rod"), single.positions("rod"), atol=1e-12)
    np.testing.assert_allclose(together.velocities("rod"), single.velocities("rod"), atol=1e-9)
    np.testing.assert_allclose(together.reaction("rod.end@arm"), single.reaction("rod.end@arm"), atol=1e-8)
    for name, work in single.ledger.items():
        np.testing.assert_allclose(together.ledger[name], work, atol=1e-12)


@pytest.mark.parametrize("load", LOADS)
def test_compiled_solve_is_the_loop_over_terms(load):
    model = cf.Model(*cantilever("xy", LOADS[load]))
    assert newton.takes(model)
    for way in ("plain", "guarded", "settled"):
        fast, slow = (
            getattr(Newton(model, compiled=compiled), way)(model.initial_state()) for compiled in (True, False)
        )
        assert (fast.iterations, fast.negative, fast.reason) == (slow.iterations, slow.negative, slow.reason)
        assert fast.guarded is slow.guarded
        np.testing.assert_allclose(fast.state.r, slow.state.r, atol=1e-13)
        np.testing.assert_allclose(fast.reactions, slow.reactions, atol=1e-10)


def test_neutral_spin_out_of_the_plane_needs_no_support():
    """A pendulum that is free to spin about its own axis is no mechanism in its plane."""
    rod = rod_in("xz", points=((0, 0), (0.8, 0)), length=None)
    flat = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, 0, -9.81))], plane="xz")
    assert [text for text, _ in flat.free_motions] == [
        "rod 'rod' can still turn about the line through (0, 0, 0) along y"
    ]
    history = cf.solve_static(flat)
    np.testing.assert_allclose(history.positions("rod")[0, -1, :2], 0, atol=1e-9)


def test_column_buckles_in_its_plane():
    """Above Euler's load the straight state is left for a stable one; the start beside it does not lead out of the plane."""
    section = cf.Section(force_stiffness=(1e4,) * 3, moment_stiffness=(1.0, 1.0, 0.8))
    rod = cf.Rod("column", section, [(0, 0, 0), (1, 0, 0)], n_elements=6)
    load = cf.PointLoad(rod, "end", force=(-1.2 * np.pi**2 / 4, 0, 0))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [load], plane="xy")
    history = cf.solve_static(model)
    tip = history.positions("column")[0, -1]
    assert history.stable == [True] and abs(tip[1]) > 0.3 and tip[2] == 0.0
    assert any("it was left for a stable one" in warning for warning in model.warnings)


# what "auto" decides


def test_auto_takes_the_plane_in_which_everything_lies():
    model = cf.Model(*cable("yz"), plane="auto")
    assert model.plane.name == "yz"
    assert model.plane_choice == 'everything lies and acts in the plane "yz"'


def out(change):
    """A scene of the plane xy, and what is changed in it."""
    rods, supports, terms = cable("xy")
    return change(rods[0], list(supports), list(terms))


ROUND = cf.Section.round(0.01, youngs_modulus=1e7, poisson_ratio=0.3, density=1000.0)
COUPLED = cf.Section(coupled=np.diag([4.0, 5, 10, 0.1, 0.2, 0.1]) + 0.01 * (np.eye(6, k=3) + np.eye(6, k=-3)))
TILTED = [[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]]
OUT = {
    "rod": (
        lambda rod, supports, terms: ([cf.Rod("rod", ROUND, [(0, 0, 0), (0.5, 0.1, 0.2)])], [], []),
        "rod 'rod' is not drawn in it: it covers 0.2 m along z",
    ),
    "section": (
        lambda rod, supports, terms: ([cf.Rod("rod", COUPLED, [(0, 0, 0), (1, 0, 0)])], [], []),
        "the stiffness of rod 'rod' couples the plane with what is out of it",
    ),
    "weight": (lambda rod, supports, terms: ([rod], supports, [cf.Gravity((0, -1, 1))]), "'gravity' pulls out of it"),
    "moment": (
        lambda rod, supports, terms: ([rod], supports, [cf.PointLoad(rod, "end", moment=(0, 1, 0), name="twist")]),
        "'twist' has a moment that turns out of it",
    ),
    "table": (
        lambda rod, supports, terms: (
            [rod], supports, [cf.PointLoad(rod, "end", force=([0, 1, 2], [(1, 0, 0), (0, 0, 1), (0, 0, 0)]), name="gust")]
        ),
        "'gust' pulls out of it",
    ),
    "hinge": (
        lambda rod, supports, terms: (
            [rod], [supports[0], cf.Clamp(rod, "end", to=cf.Part("lid", motion=cf.Hinge((0, 0, 0), (0, 1, 0), 1.0)))], []
        ),
        "part 'lid' moves out of it",
    ),
    "frame": (
        lambda rod, supports, terms: (
            [rod],
            [cf.Clamp(rod, "start", free=("x",), frame=TILTED, name="guide"), supports[1]],
            [],
        ),
        "support 'guide': no axis of its frame is normal to it",
    ),
    "rest": (
        lambda rod, supports, terms: ([cf.Rod("rod", ROUND, [(0, 0, 0), (1, 0, 0)], rest=(1, 1, 0.1))], [], []),
        "the stress-free shape of rod 'rod' is bent or twisted out of it",
    ),
    "drag": (lambda rod, supports, terms: ([rod], supports, [cf.Drag(rod, normal=1.0)]), "'drag' has no planar form"),
    "orders": (
        lambda rod, supports, terms: ([rod, rod_in("xy", "other", order=3)], [], []),
        "rods have elements of different order (2, 3)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("change", OUT)
def test_what_leaves_the_plane_is_said(change):
    """An error for a plane that was asked for; the reason, and space, for "auto"."""
    make, message = OUT[change]
    parts = out(make)
    with pytest.raises(cf.SceneError) as error:
        cf.Model(*parts, plane="xy")
    assert 'plane = "xy": ' in str(error.value) and message in str(error.value)
    model = cf.Model(*parts, plane="auto")
    assert model.plane is None and model.plane_choice.startswith("no plane: ")
    assert message in model.plane_choice or change == "rod"


def test_a_function_of_time_is_watched():
    """It cannot be checked beforehand: "auto" leaves it in space, a plane that was asked for is checked at every call."""
    rod = rod_in("xy")
    load = cf.PointLoad(rod, "end", force=lambda t: (0, 1, max(0.0, t - 1)))
    parts = [rod], [cf.Clamp(rod, "start")], [load]
    assert "cannot be checked beforehand" in cf.Model(*parts, plane="auto").plane_choice
    model = cf.Model(*parts, plane="xy")
    cf.solve_static(model, t=1.0)
    with pytest.raises(cf.SceneError, match="a load that is a function of time leaves the plane"):
        cf.solve_static(model, t=2.0)


def test_a_start_out_of_the_plane_is_refused():
    parts = cantilever("xy", LOADS["force"])
    side = cf.Model(*parts[:2], [cf.PointLoad(parts[0][0], "end", force=(0, 0, 0.5))])
    with pytest.raises(ValueError, match='does not lie in the plane "xy"'):
        cf.solve_static(cf.Model(*parts, plane="xy"), start=cf.solve_static(side).final)
    with pytest.raises(ValueError, match="plane must be None, 'auto', 'xy', 'yz' or 'xz'"):
        cf.Model(*parts, plane="zx")


# out of the plane


def column(push, plane="xy"):
    """A clamped strip, weak out of the plane xy, under an end load across it: Michell's lateral buckling."""
    section = cf.Section(force_stiffness=(1e6,) * 3, moment_stiffness=(10.0, 0.01, 0.008))
    rod = cf.Rod("strip", section, [(0, 0, 0), (1, 0, 0)], n_elements=8, normal=(0, 0, 1))
    return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, -push, 0))], plane=plane)


def test_lateral_buckling_is_told_out_of_the_plane():
    """P = 4.0126 sqrt(EI GJ) / L^2 (Timoshenko and Gere 1961, section 6.3); EI in the plane is 1000 times that across."""
    critical = 4.0126 * np.sqrt(0.01 * 0.008)
    for factor, ways in ((0.98, 0), (1.02, 1)):
        model = column(factor * critical)
        history = cf.solve_static(model)
        assert history.stable == [True]
        assert cf.out_of_plane(model, history.final) == ways
    with pytest.raises(ValueError, match="the model has no plane"):
        cf.out_of_plane(column(0.1, None), history.final)


SCENE = """
[[section]]
name = "strip"
kind = "general"
force_stiffness = [1e6, 1e6, 1e6]
moment_stiffness = [10.0, 0.01, 0.008]
[[rod]]
name = "strip"
section = "strip"
points = [[0, 0, 0], [1, 0, 0]]
normal = [0, 0, 1]
n_elements = 6
[[support]]
kind = "clamp"
rod = "strip"
at = "start"
[[load]]
kind = "point"
rod = "strip"
at = "end"
force = [0, -0.05, 0.0]
[solve]
kind = "static"
plane = "auto"
out_of_plane = true
[output]
pictures = false
"""


def test_scene_with_a_plane(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    scene = cf.load_scene(file)
    cf.run_scene(scene, tmp_path / "out")
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["physics"]["plane"] == "xy" and told["physics"]["plane_choice"].startswith("everything lies")
    assert told["physics"]["unknowns"] == 3 * scene.model.space.n_nodes
    assert told["out_of_plane"] == [1]
    assert any("a real rod would leave the plane" in warning for warning in told["warnings"])
    file.write_text(SCENE.replace('"auto"', '"xy"').replace("-0.05, 0.0", "-0.05, 0.1"))
    with pytest.raises(cf.SceneError, match=r"scene.toml:24: .*plane = \"xy\": 'point load' pulls out of it"):
        cf.load_scene(file)
    file.write_text(SCENE.replace('plane = "auto"', ""))
    with pytest.raises(cf.SceneError, match="out_of_plane goes with plane"):
        cf.load_scene(file)


def test_a_path_may_leave_the_plane():
    """Paths are followed in space: the branch out of the plane of an arch is the one of the model without a plane."""
    section = cf.Section.round(0.01, youngs_modulus=2e9, poisson_ratio=0.3, density=1000)
    angle = np.linspace(0, np.pi, 31)
    points = 0.5 * np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    rod = cf.Rod("arch", section, points, rest="as_drawn", n_elements=12)
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")]
    ends, criticals = [], []
    for plane in (None, "xy"):
        model = cf.Model([rod], supports, [cf.PointLoad(rod, rod.length / 2, (0, -30.0, 0))], plane=plane)
        history = cf.trace_path(model, until=1.0, branch=1)
        assert history.status == "converged"
        assert history.model.plane is None
        ends.append(history.positions(rod)[-1])
        criticals.append(cf.critical_load(model).value)
    assert np.abs(ends[0][:, 2]).max() > 0.1
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    assert criticals[1] == pytest.approx(criticals[0], rel=1e-6)
