"""Contact as a user sees it: what lies, sticks, slips, bounces, is pressed and is refused."""

from dataclasses import replace

import judge
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from verification import contact_references as cr

import cosserat_fem as cf
from cosserat_fem.iteration.barrier import Approach
from cosserat_fem.rod import Elements
from helpers import centreline, drum_mesh, write_obj

G = 9.81
CABLE = cf.Section.round(0.01, youngs_modulus=1e8, poisson_ratio=0.3, density=1200)
FLOOR = cf.Plane((0, 0, 0), (0, 0, 1))
WEIGHT = G * CABLE.mass_per_length  # per length


def lying(
    *, slope=0.0, height=0.0051, n_elements=10, order=3, supports=(), gravity=(0.0, 0.0, -G), section=CABLE, **contact
):
    """A straight rod above a plane that falls towards +x by `slope` [rad]."""
    turn = Rotation.from_rotvec([0, slope, 0]).as_matrix()
    ends = np.array([(0, 0, height), (0.3, 0, height)]) @ turn.T
    rod = cf.Rod("rod", section, ends, n_elements=n_elements, order=order)
    floor = cf.Part("floor", shape=cf.Plane((0, 0, 0), turn @ [0, 0, 1]))
    term = cf.PartContact(rod, floor, **contact)
    return cf.Model([rod], [s(rod) for s in supports], [term, cf.Gravity(gravity)])


def gaps(model, state, radius, shape):
    (rod,) = model.rods
    return shape.distance(centreline(model, rod, state, 20)) - radius


# resting


@pytest.mark.parametrize("pressure", [None, 0.01 * WEIGHT, WEIGHT, 100 * WEIGHT])
def test_resting_rod(validation, pressure):
    """Line force = weight, stand-off below 1e-3 radii at any pressure scale, sum of contact = weight."""
    model = lying(pressure=pressure)
    history = cf.solve_static(model)
    rod = model.rods[0]
    force, s = history.line_force(rod)[0], history.nodes(rod)
    inside = (s > 0.03) & (s < 0.27)
    np.testing.assert_allclose(force[inside, 2], WEIGHT, rtol=1e-3)
    assert abs(gaps(model, history.final, 0.005, FLOOR)).max() <= 1e-3 * 0.005
    load = history.contact_load("floor")[0]
    variant = "no pressure scale" if pressure is None else f"pressure scale {pressure / WEIGHT:g} weights"
    validation.row("rod at rest on a floor", "its weight", -WEIGHT * 0.3, load[2], 1e-8, variant=variant)
    np.testing.assert_allclose(load[[0, 1]], 0, atol=1e-9 * WEIGHT)
    middle = model.space.node_mass @ history.final.r / model.space.node_mass.sum()  # it may lie anywhere on the plane
    np.testing.assert_allclose(load[3:], np.cross(middle, load[:3]), atol=1e-8 * WEIGHT)
    assert history.records[0].iterations <= 60
    assert history.contacts()[0].peak == pytest.approx(WEIGHT, rel=1e-2)


def test_far_away_changes_nothing():
    """A part out of reach leaves every digit as it was."""
    rod = cf.Rod("rod", CABLE, [(0, 0, 0.2), (0.3, 0, 0.2)], n_elements=6)
    terms = [cf.Gravity((0, 0, -G))]
    floor = cf.Part("floor", shape=FLOOR)
    without = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], terms))
    contact = cf.PartContact(rod, floor, friction=0.3)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [*terms, contact]))
    np.testing.assert_allclose(history.final.r, without.final.r, atol=1e-13)
    assert not history.contact_load("floor").any()
    assert history.contacts() == []


def test_pressed_rod_is_symmetrical():
    """A rod clamped at both ends, pressed by a ball in its middle."""
    rod = cf.Rod("rod", CABLE, [(-0.2, 0, 0), (0.2, 0, 0)], n_elements=8)
    ball = cf.Part("ball", shape=cf.Sphere((0, 0, 0.0301), 0.025), motion=cf.Slider((0, 0, -1), 1.0))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.PartContact(rod, ball, friction=0.2)])
    history = cf.solve_quasistatic(model, [0.0, 0.01, 0.02])
    r = history.positions(rod)[-1]
    np.testing.assert_allclose(r[:, 2], r[::-1, 2], atol=1e-10)
    np.testing.assert_allclose(r[:, 1], 0, atol=1e-12)
    assert r[:, 2].min() == pytest.approx(0.0301 - 0.02 - 0.03, abs=1e-5)
    load = history.contact_load(ball)[-1]
    np.testing.assert_allclose(
        load[:3],
        -sum(history.reaction(f"rod.{e}@ground")[-1, :3] for e in ("start", "end")) * -1,
        atol=1e-8 * abs(load[2]),
    )
    np.testing.assert_allclose(load[[0, 1]], 0, atol=1e-8 * abs(load[2]))


def test_barrier_becomes_softer_for_what_presses():
    """A pressure scale from a hard impact shrinks by tens, while something touches, until it fits the line force."""
    model = lying()
    approach = Approach(model)
    state, pressed = approach.accept(cf.solve_static(model).final)
    (term,) = model.contacts

    def scaled(scale):
        touch = {term: replace(state.contact.touch[term], scale=scale)}
        return replace(state, contact=replace(state.contact, touch=touch))

    peak, scales = pressed[0].peak, [1e6 * pressed[0].peak]
    while (scale := approach.relax(scaled(scales[-1]), pressed).contact.touch[term].scale) != scales[-1]:
        scales.append(scale)
    np.testing.assert_allclose(scales, [1e6 * peak, 1e5 * peak, 1e4 * peak, 1e3 * peak, 1e2 * peak, 15 * peak])
    away = scaled(1e6)
    assert approach.relax(away, (replace(pressed[0], peak=0.0),)) is away


def test_barrier_becomes_harder_beside_what_lies():
    """A rod that lies is braced for an impact: the pressure scale is another one, the force on the floor is not."""
    model = lying()
    approach, (term,) = Approach(model), model.contacts
    state = cf.solve_static(model).final
    energy = 0.1  # J
    braced = approach.brace(state, energy)
    scales = [s.contact.touch[term].scale for s in (state, braced)]
    assert scales[1] > 1e3 * scales[0]
    before, after = (np.abs(model.touching(s)[:, 2]).sum() for s in (state, braced))
    assert after == pytest.approx(before, rel=0.1)
    # the scale alone would throw it up
    touch = {term: replace(state.contact.touch[term], scale=scales[1])}
    alone = replace(state, contact=replace(state.contact, touch=touch))
    assert np.abs(model.touching(alone)[:, 2]).sum() > 1e3 * before
    assert term.potential(braced, model.space) < term.potential(state, model.space)
    assert 0 < np.abs(braced.r - state.r).max() < term.range
    assert approach.brace(braced, energy) is braced


def test_impact_beside_rods_that_cross():
    """As above, of two rods that press on each other: each goes half of the way."""
    a = cf.Rod("a", CABLE, [(-0.1, 0, 0), (0.1, 0, 0)], n_elements=5)
    b = cf.Rod("b", CABLE, [(0, -0.1, 0.0101), (0, 0.1, 0.0101)], n_elements=5)
    term = cf.RodContact([a, b])
    supports = [cf.Clamp(a, end) for end in ("start", "end")]
    down = [cf.PointLoad(b, end, (0, 0, -0.2)) for end in ("start", "end")]
    sides = [cf.Clamp(b, 0.1, free=("z",))]
    model = cf.Model([a, b], [*supports, *sides], [term, *down])
    approach, state = Approach(model), cf.solve_static(model).final
    braced = approach.brace(state, 0.01)
    assert braced.contact.touch[term].scale > 100 * state.contact.touch[term].scale
    before, after = (model.touching(s)[model.space[a].nodes, 2].sum() for s in (state, braced))
    assert before == pytest.approx(0.4, rel=1e-6)
    assert after == pytest.approx(before, rel=0.1)
    lifts = (braced.r - state.r)[:, 2]
    assert lifts[model.space[a].nodes].min() < 0 < lifts[model.space[b].nodes].max() < term.range


def test_tangent_move_is_no_peeling():
    """What an increment along a drum leaves by its curvature is to stay in touch, what it peels off is not."""
    soft = cf.Section.round(0.01, youngs_modulus=1e6, poisson_ratio=0.3, density=1200)
    rod = cf.Rod("rod", soft, [(-0.05, 0, 0.10502), (0.05, 0, 0.10502)], n_elements=5)
    drum = cf.Part("drum", shape=cf.Cylinder((0, -0.1, 0), (0, 0.1, 0), 0.1))
    term = cf.PartContact(rod, drum)
    load = cf.LineLoad(rod, (0, 0, -100.0))
    model = cf.Model([rod], [cf.Clamp(rod, 0.05, free=("z", "ry"))], [term, load])
    state = cf.solve_static(model).final
    length = term.touched(state, model.space)
    assert length > 0.01
    along = replace(state, r=state.r + 0.05 * np.cross((0, 1, 0), state.r))  # about the axis, but straight on
    assert term.touched(along, model.space) < 0.1 * length
    assert term.stays(state, along, model.space) == pytest.approx(length)
    off = replace(state, r=state.r + (0, 0, 2 * term.range))
    assert term.touched(off, model.space) == term.stays(state, off, model.space) == 0.0


@pytest.mark.filterwarnings("ignore:energy ledger")
def test_end_that_falls_while_the_rest_lies():
    """A rope held up at one end is let go: it lays itself down, and no place of it goes below the floor."""
    a, height = 0.002, 0.2
    section = cf.Section(
        force_stiffness=(1e4,) * 3,
        moment_stiffness=(1e-2,) * 3,
        mass_per_length=0.1,
        rotary_inertia=(1e-7, 1e-7, 2e-7),
        radius=a,
    )
    rod = cf.Rod("rod", section, [(0, 0, 1.002 * a), (1, 0, 1.002 * a)], n_elements=8)
    hand = cf.Part("hand", motion=cf.Slider((0, 0, 1), ([0, 1], [0.0, height])))
    terms = [cf.PartContact(rod, cf.Part("floor", shape=FLOOR)), cf.Gravity((0, 0, -G))]
    held = cf.Model([rod], [cf.Pin(rod, "start", to=hand, free=("x",)), cf.Clamp(rod, "end")], terms)
    start = replace(cf.solve_quasistatic(held, [0, 0.5, 1]).final, contact=None, t=0.0)
    assert terms[0].touched(start, held.space) > 0.2
    free, frames = cf.Model([rod], [cf.Clamp(rod, "end")], terms), []

    def look(run):
        frames.append(centreline(free, rod, run.state, 20)[:, 2])

    history = cf.solve_dynamic(free, 0.16, start=start, step=cf.FixedStep(2e-3), rho_inf=0.5, callback=look)
    assert history.status == "converged"
    assert min(frame.min() for frame in frames) > (1 - 1e-3) * a
    assert frames[0][0] > 0.19 > 0.02 > min(frame[0] for frame in frames)


# friction on a slope


def tilted(ratio, friction=0.4, *, damping=None):
    """A rod on a floor, under a weight that turns in time until tan(angle) = friction times ratio(t)."""
    rod = cf.Rod("rod", CABLE, [(0, 0, 0.0051), (0.3, 0, 0.0051)], n_elements=5)
    floor = cf.Part("floor", shape=FLOOR)

    def weight(t):
        angle = np.arctan(friction * ratio(t))
        return WEIGHT * np.array([np.sin(angle), 0, -np.cos(angle)])

    return cf.Model([rod], [], [cf.PartContact(rod, floor, friction=friction), cf.LineLoad(rod, weight)])


@pytest.mark.parametrize("friction", [0.1, 0.4, 1.5])
def test_friction_angle(friction):
    """tan(slope) = mu less 0.1 %: the rod holds, after a slip that is the elastic one.

    In steps its front is pressed harder from one to the next, so that what it slipped before counts less there.
    """
    slips = []
    for times in ([0.0, 0.999], [0.0, 0.5, 0.9, 0.999]):
        history = cf.solve_quasistatic(tilted(lambda t: min(t, 0.999), friction), times)
        slips.append((history.positions("rod")[-1] - history.positions("rod")[0])[:, 0] / (0.999 * 5e-3 * 0.005))
    np.testing.assert_allclose(slips[0], 1.0, rtol=0.01)
    assert (slips[1] > 0.99).all() and (slips[1] < 1.1).all()


@pytest.mark.filterwarnings("ignore:energy ledger")
def test_sliding_down(validation):
    """In time: at 0.1 % below the limit it stays, at 0.1 % above it the speed grows as the difference says."""
    friction = 0.4
    step = cf.FixedStep(5e-3)
    model = tilted(lambda t: 0.999, friction)
    history = cf.solve_dynamic(model, 0.5, step=step, rho_inf=0.5)
    way = history.positions("rod") - history.positions("rod")[0]
    assert abs(way).max() < 1e-3 * 0.005
    model = tilted(lambda t: min(0.99 + 0.1 * t, 1.001), friction)
    history = cf.solve_dynamic(model, 1.0, step=step, rho_inf=0.5, times=[0.5, 1.0])
    speed = history.velocities("rod")[:, :, 0].mean(axis=1)
    a = cr.slope_acceleration(friction, np.arctan(1.001 * friction), G)
    validation.row("rod that slides down a slope", "Coulomb, closed form", 0.5 * a, np.diff(speed)[0], 0.02)


def test_stick_does_not_creep():
    """At 95 % of the limit a rod stays where it is, however many stations pass."""
    history = cf.solve_quasistatic(tilted(lambda t: min(t, 0.95)), np.arange(100.0))
    way = history.positions("rod") - history.positions("rod")[1]
    assert abs(way[1:]).max() < 1e-3 * 0.005
    assert history.friction_work("rod-floor")[-1] == pytest.approx(0, abs=1e-12)


def dragged(*, friction=0.3, there=0.02, n=9):
    """A rod on a floor, pulled out and back by a part at its end: stations of one cycle."""
    path = (np.array([0.0, 1, 3, 4]), np.array([0.0, there, -there, 0]))
    hand = cf.Part("hand", motion=cf.Slider((1, 0, 0), path))
    rod = cf.Rod("rod", CABLE, [(0, 0, 0.005 - 2e-6), (0.3, 0, 0.005 - 2e-6)], n_elements=5)
    floor = cf.Part("floor", shape=FLOOR)
    term = cf.PartContact(rod, floor, friction=friction)
    model = cf.Model([rod], [cf.Pin(rod, "end", to=hand, free=("z",))], [term, cf.Gravity((0, 0, -G))])
    return cf.solve_quasistatic(model, np.linspace(0, 4, 4 * n + 1))


def test_friction_takes_energy(validation):
    """Dragged out and back: force = mu weight both ways, work lost >= 0 at each station and as the loop says."""
    history = dragged()
    lost = history.friction_work("rod-floor")
    assert (np.diff(lost) >= -1e-15).all()
    force = history.reaction("rod.end@hand")[:, 0]
    full = 0.3 * WEIGHT * 0.3
    np.testing.assert_allclose(force[[5, 9]], full, rtol=1e-6)
    np.testing.assert_allclose(force[[15, 27]], -full, rtol=1e-6)
    validation.row("rod dragged out and back", "Coulomb, area of the loop", full * 4 * 0.02, lost[-1], 0.01)


# the same in other words


UNTURNED, STILL = np.eye(3), np.zeros(3)


def scene(turn=UNTURNED, away=STILL, *, reverse=False, tmp_path=None):
    """A cable pulled over a drum and a box, and into a mesh; everything turned and moved."""

    def place(x):
        return np.asarray(x) @ turn.T + away

    x = np.linspace(-0.1, 0.3, 30)
    rod = cf.Rod("rod", CABLE, place(np.c_[x, 0 * x, 0.0055 + 0 * x]), n_elements=12, normal=turn @ [0, 1, 0])
    drum = cf.Part("drum", shape=cf.Cylinder(place((0, -0.1, -0.05)), place((0, 0.1, -0.05)), 0.05))
    box = cf.Part("box", shape=cf.Box(place((0.2, 0, -0.05)), (0.04, 0.2, 0.1), turn))
    corners = place([(0.08, -0.1, 0), (0.12, -0.1, 0), (0.12, 0.1, 0), (0.08, 0.1, 0), (0.1, 0, -0.02)])
    faces = [(0, 1, 2), (0, 2, 3), (1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)]
    order = np.random.default_rng(3).permutation(6) if reverse else np.arange(6)
    write_obj(tmp_path / f"m{reverse}.obj", corners, np.array(faces)[order])
    mesh = cf.Part("mesh", mesh=tmp_path / f"m{reverse}.obj")
    terms = [cf.PartContact(rod, part, friction=0.2) for part in (drum, box, mesh)]
    times = np.linspace(0, 1, 11)
    loads = [
        cf.PointLoad(rod, "end", (times, np.outer(times, turn @ [0.3, 0.05, -0.2]))),
        cf.LineLoad(rod, (times, np.outer(times, turn @ [0, 0, -20.0]))),
    ]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], (terms[::-1] + loads) if reverse else (terms + loads))
    history = cf.solve_quasistatic(model, times)
    return (history.final.r - away) @ turn, {p.name: history.contact_load(p)[-1, :3] @ turn for p in (drum, box, mesh)}


def test_rigid_motion_and_order(tmp_path):
    """A turned and moved scene, or terms and triangles in another order: the same to 1e-9."""
    r, loads = scene(tmp_path=tmp_path)
    assert all(np.linalg.norm(load) > 1e-3 for load in loads.values())
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    for other in (scene(reverse=True, tmp_path=tmp_path), scene(turn, np.array([0.3, -0.2, 0.5]), tmp_path=tmp_path)):
        np.testing.assert_allclose(other[0], r, atol=1e-9 * 0.4)
        for name, load in loads.items():
            np.testing.assert_allclose(other[1][name], load, atol=1e-7 * np.linalg.norm(load))


# starts


def test_start_inside_is_refused():
    with pytest.raises(cf.SceneError, match=r"rod 'rod': at s = .* inside part 'floor', centreline and all"):
        cf.solve_static(lying(height=-0.01))
    a = cf.Rod("a", CABLE, [(0, 0, 0), (0.3, 0, 0)], n_elements=4)
    b = cf.Rod("b", CABLE, [(0.15, -0.1, 0), (0.15, 0.1, 0)], n_elements=4)
    with pytest.raises(cf.SceneError, match=r"rod '[ab]': at s = .* m inside rod '[ab]'"):
        cf.solve_static(cf.Model([a, b], [cf.Clamp(a, "start"), cf.Clamp(b, "start")], [cf.RodContact([a, b])]))


def test_start_on_another_rod_is_refused():
    """Two rods drawn in one place: no way out of it is better than another."""
    section = cf.Section.round(0.01, youngs_modulus=5e6, poisson_ratio=0.4, density=1200)
    rods = [cf.Rod(name, section, [(0, 0, 0), (0.2, 0, 0)], n_elements=4) for name in "ab"]
    supports = [cf.Clamp(rod, "start") for rod in rods]
    with pytest.raises(cf.SceneError, match=r"rod '[ab]': at s = .* m it is 0.01 m inside rod '[ab]'"):
        cf.solve_static(cf.Model(rods, supports, [cf.RodContact(rods)]))


def test_start_wholly_inside_a_mesh_is_refused(tmp_path):
    """A cable in the middle of a closed body, far from its faces: it is inside, centreline and all."""
    import pyvista

    pyvista.Box((-1, 1, -1, 1, -1, 1)).triangulate().save(tmp_path / "box.stl")
    section = cf.Section.round(0.01, youngs_modulus=5e6, poisson_ratio=0.4, density=1200)
    rod = cf.Rod("rod", section, [(-0.1, 0, 0), (0.1, 0, 0)], n_elements=4)
    term = cf.PartContact(rod, cf.Part("block", mesh=tmp_path / "box.stl"))
    with pytest.raises(cf.SceneError, match=r"inside part 'block', centreline and all"):
        cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [term]))


def test_start_half_inside_is_pushed_out():
    """The surface in the floor, the centreline outside: pushed out, with a warning that says how deep it was."""
    model = lying(height=0.003)
    history = cf.solve_static(model)
    assert any("0.00199 m inside part 'floor'" in text for text in model.warnings)
    assert history.contact_load("floor")[0, 2] == pytest.approx(-WEIGHT * 0.3, rel=1e-8)


def test_start_just_touching():
    """Drawn on the surface to the last digit: taken as it is."""
    history = cf.solve_static(lying(height=0.005))
    assert history.contact_load("floor")[0, 2] == pytest.approx(-WEIGHT * 0.3, rel=1e-8)


@pytest.mark.filterwarnings("ignore")
def test_trapped(tmp_path):
    """A cable between a moving jaw and a wall: it stops before it is crushed, says between what, and never passes."""
    rod = cf.Rod("rod", CABLE, [(-0.1, 0, 0.0055), (0.1, 0, 0.0055)], n_elements=4)
    wall = cf.Part("wall", shape=FLOOR)
    jaw = cf.Part("jaw", shape=cf.Box((0, 0, 0.032), (0.05, 0.05, 0.04)), motion=cf.Slider((0, 0, -1), 1.0))
    model = cf.Model(
        [rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.PartContact(rod, wall), cf.PartContact(rod, jaw)]
    )
    with pytest.raises(cf.ConvergenceError, match=r"part '(jaw|wall)'") as caught:
        cf.solve_quasistatic(model, [0.0, 0.0005, 0.001, 0.004, 0.02])
    history = caught.value.history
    assert 2 <= len(history) <= 3
    frames = np.array([centreline(model, rod, r.state, 20) for r in history.records])
    assert frames[:, :, 2].min() > 0.0049
    assert judge.inside(frames[-1:] + [0, 0, history.t[-1]], jaw.shapes[0].distance) == 0


# compliant layer


def test_layer_is_indented_by_pressure_over_stiffness(validation):
    """Insulation of 1 kN/m per mm under its own weight many times over."""
    stiffness, depth, line = 1e6, 1e-3, 300.0
    model = lying(height=0.0051, layer=(stiffness, depth), gravity=(0, 0, -line / CABLE.mass_per_length))
    history = cf.solve_static(model)
    z = history.positions("rod")[0][5:-5, 2]
    validation.row("indented layer", "pressure over stiffness", line / stiffness, 0.005 - z, 0.02)
    assert history.contact_load("floor")[0, 2] == pytest.approx(-line * 0.3, rel=1e-8)


# rods


def crossed(angle, shift, *, n_elements=8, depth=1e-6):
    """Force with which a rod at an angle presses on another, moved along it by a part of an element."""
    h = 0.02
    section = cf.Section.round(0.008, youngs_modulus=1e8, density=1000)
    a = cf.Rod("a", section, [(0, 0, 0), (h * n_elements, 0, 0)], n_elements=n_elements)
    d = np.array([np.cos(angle), np.sin(angle), 0])
    c = np.array([h * (n_elements / 2 + shift), 0, 0.008 - depth])
    b = cf.Rod("b", section, [c - 0.5 * h * n_elements * d, c + 0.5 * h * n_elements * d], n_elements=n_elements)
    term = cf.RodContact([a, b])
    model = cf.Model([a, b], [cf.Clamp(a, "start")], [term])
    blocks = term(model.initial_state(), model.space, tangent=False)
    force = np.zeros((model.space.n_nodes, 6))
    np.add.at(force, blocks.nodes, blocks.force)
    return abs(force[model.space[a].nodes, 2].sum())


@pytest.mark.parametrize("angle", [10, 30, 90])
def test_crossing_has_no_ripple(angle):
    """A rigid rod that slides over one element: the force does not notice nodes."""
    forces = [crossed(np.radians(angle), shift) for shift in np.linspace(0, 1, 41)]
    assert np.ptp(forces) < 0.02 * np.mean(forces)


def test_parallel_rods_have_no_ripple():
    """Side by side over the whole length of one of them, which slides by one element."""
    section = cf.Section.round(0.008, youngs_modulus=1e8, density=1000)
    h, forces, spread = 0.02, [], []
    for shift in np.linspace(0, 1, 21):
        a = cf.Rod("a", section, [(0, 0, 0), (12 * h, 0, 0)], n_elements=12)
        x = np.array([3 + shift, 8 + shift]) * h
        b = cf.Rod("b", section, [(x[0], 0, 0.008 - 1e-6), (x[1], 0, 0.008 - 1e-6)], n_elements=5)
        term = cf.RodContact([a, b])
        model = cf.Model([a, b], [cf.Clamp(a, "start")], [term])
        state = model.initial_state()
        blocks = term(state, model.space, tangent=False)
        force = np.zeros((model.space.n_nodes, 6))
        np.add.at(force, blocks.nodes, blocks.force)
        forces.append(force[model.space[b].nodes, 2].sum())
        line = force[model.space[b].nodes, 2] / model.space.share(b)
        spread.append(np.ptp(line[6:-6]) / abs(line.mean()))
    assert np.ptp(forces) < 0.01 * abs(np.mean(forces))
    assert max(spread) < 0.02


@pytest.mark.parametrize("n_elements", [8, 9])
def test_crossing_ropes(validation, n_elements):
    """Two clamped rods at a right angle, pressed into each other by their clamps: lifts and force of the elastica."""
    EI, EA, radius, distance = 1e-2, 100.0, 0.01, 0.08
    first = {"span": 1.0, "length": 1.0, "EI": EI, "EA": EA}
    second = {"span": 0.8, "length": 0.8, "EI": 3 * EI, "EA": EA}
    h1, h2, force = cr.crossed_pair(distance, first, second)

    def section(EI):
        return cf.Section(force_stiffness=(1e6, 1e6, EA), moment_stiffness=(EI, EI, EI), radius=radius)

    down = cf.Part("down", motion=cf.Slider((0, 0, -1), ([0, 1], [0.0, 0.01 + distance])))
    a = cf.Rod("a", section(EI), [(-0.5, 0, 0), (0.5, 0, 0)], n_elements=n_elements, order=4)
    top = 2 * radius + 0.01
    b = cf.Rod("b", section(3 * EI), [(0, -0.4, top), (0, 0.4, top)], n_elements=n_elements, order=4)
    supports = [cf.Clamp(rod, end, to=to) for rod, to in ((a, cf.GROUND), (b, down)) for end in ("start", "end")]
    history = cf.solve_quasistatic(cf.Model([a, b], supports, [cf.RodContact([a, b])]), np.linspace(0, 1, 6))
    found = -sum(history.reaction(f"b.{end}@down")[-1, 2] for end in ("start", "end"))
    za, zb = (centreline(history.model, rod, history.final, 50)[:, 2] for rod in (a, b))
    source, lifts = "boundary value problem by collocation", (-za.min(), zb.max() - (2 * radius - distance))
    case, many = "two ropes that cross", f"{n_elements} elements"
    validation.row(case, source, force, found, 1e-3, variant=f"force, {many}")
    validation.row(case, source, (h1, h2), lifts, 1e-3, variant=f"lifts, {many}")


def test_rods_touch_on_other_elements():
    """A model that was solved while rods touched, and the same on finer elements: each puts its own tangent together."""
    section = cf.Section.round(0.01, youngs_modulus=5e6, poisson_ratio=0.4, density=1200)
    low = cf.Rod("low", section, [(0, -0.2, 0), (0, 0.2, 0)], n_elements=4)
    high = cf.Rod("high", section, [(-0.2, 0.01, 0.0101), (0.2, 0.01, 0.0101)], n_elements=4)
    supports = [cf.Clamp(low, "start"), cf.Clamp(low, "end"), cf.Clamp(high, "start")]
    model = cf.Model([low, high], supports, [cf.RodContact([low, high]), cf.Gravity((0, 0, -9.81))])
    reactions = [cf.solve_static(model).reaction("high.start@ground")[0]]
    finer = model.with_elements({rod: Elements(3, np.linspace(0, rod.length, 9)) for rod in (low, high)})
    reactions += [cf.solve_static(m).reaction("high.start@ground")[0] for m in (finer, model)]
    np.testing.assert_array_equal(reactions[0], reactions[2])
    assert 0 < np.abs(reactions[1] - reactions[0]).max() < 0.01 * np.abs(reactions[0]).max()


# meshes


def test_groove_is_touched_on_both_sides(tmp_path, validation):
    """A V of 90 degrees: each side carries weight / sqrt(2), and the rod lies a sqrt(2) above its bottom."""
    points = [(-0.05, -0.1, 0.1), (-0.05, 0, 0), (-0.05, 0.1, 0.1), (0.4, -0.1, 0.1), (0.4, 0, 0), (0.4, 0.1, 0.1)]
    write_obj(tmp_path / "v.obj", points, [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)])
    rod = cf.Rod("rod", CABLE, [(0, 0, 0.0075), (0.3, 0, 0.0075)], n_elements=6)
    term = cf.PartContact(rod, cf.Part("v", mesh=tmp_path / "v.obj"))
    model = cf.Model([rod], [], [term, cf.Gravity((0, 0, -G))])
    history = cf.solve_static(model)
    np.testing.assert_allclose(history.positions(rod)[0][:, 2], 0.005 * np.sqrt(2), rtol=1e-3)
    np.testing.assert_allclose(history.positions(rod)[0][:, 1], 0, atol=1e-5 * 0.005)
    state = history.final
    found = term._near(model.space).find(state)
    sides = np.sign(found.rows[:, 4])
    assert (np.bincount((sides > 0).astype(int), found.rows[:, 1]) > 0.99 * 0.3).all()
    peak = history.contacts()[0].peak
    validation.row("rod in a groove of 90 degrees", "closed form", WEIGHT / np.sqrt(2), peak, 2e-2)


def over_drum(drum, *, n_elements=12):
    """Sag of the ends of a rod laid over a drum and pulled down at both ends."""
    rod = cf.Rod("rod", CABLE, [(-0.15, 0, 0.0552), (0.15, 0, 0.0552)], n_elements=n_elements)
    loads = [cf.PointLoad(rod, end, (0, 0, -1.0)) for end in ("start", "end")]
    model = cf.Model([rod], [], [cf.PartContact(rod, drum, friction=0.5), *loads])
    history = cf.solve_static(model)
    return -history.positions(rod)[0][[0, -1], 2].mean()


@pytest.mark.slow
def test_facets_converge_to_the_drum(tmp_path):
    """An STL-like drum of 8 to 512 facets: nearer with each, and once some facets are touched, as their angle squared."""
    smooth = over_drum(cf.Part("drum", shape=cf.Cylinder((0, -0.05, 0), (0, 0.05, 0), 0.05)))
    facets = np.array([8, 16, 32, 64, 128, 256, 512])
    errors = [abs(over_drum(drum_mesh(tmp_path / f"{n}.obj", 0.05, n)) - smooth) for n in facets]
    assert (np.diff(errors) < 0).all()
    assert np.polyfit(np.log(facets[3:]), np.log(errors[3:]), 1)[0] < -1.7
    assert errors[-1] < 1e-5 * 0.05


# input


def test_bad_input(tmp_path):
    rod, part = cf.Rod("rod", CABLE, [(0, 0, 1), (0.3, 0, 1)]), cf.Part("floor", shape=FLOOR)
    other = cf.Rod("other", CABLE, [(0, 0, 2), (0.3, 0, 2)], order=2)
    bare = cf.Rod("bare", cf.Section(force_stiffness=(1, 1, 1), moment_stiffness=(1, 1, 1)), [(0, 0, 2), (0.3, 0, 2)])
    for match, make in {
        "friction must be 0 or greater": lambda: cf.PartContact(rod, part, friction=-0.1),
        "friction: must be a finite number": lambda: cf.PartContact(rod, part, friction=np.nan),
        "radius: must be greater than 0": lambda: cf.PartContact(rod, part, radius=0.0),
        "stand_off: must be greater than 0": lambda: cf.PartContact(rod, part, stand_off=-1e-6),
        "neither a shape nor a mesh": lambda: cf.PartContact(rod, cf.Part("empty")),
        "part must be a Part": lambda: cf.PartContact(rod, FLOOR),
        "give the contact a radius": lambda: cf.PartContact(bare, part),
        "layer must be thinner": lambda: cf.PartContact(rod, part, layer=(1e6, 0.005)),
        "layer must be \\(stiffness": lambda: cf.PartContact(rod, part, layer=1e6),
        "layer stiffness: must be greater than 0": lambda: cf.PartContact(rod, part, layer=(0.0, 0.001)),
        "rods is empty": lambda: cf.RodContact([]),
        "named twice": lambda: cf.RodContact([rod, rod]),
        "all must be of one order": lambda: cf.RodContact([rod, other]),
        "must be a Rod": lambda: cf.RodContact([part]),
        "thinner than both": lambda: cf.RodContact([rod], layer=(1e6, 0.01)),
        "right unit": lambda: cf.solve_static(
            cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PartContact(rod, part, radius=1e-9)])
        ),
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=match):
            make()


def test_bad_mesh(tmp_path):
    """NaN and empty meshes are refused, a flipped one is put right and holds."""
    rod = cf.Rod("rod", CABLE, [(0, 0, 0.0551), (0.1, 0, 0.0551)], n_elements=4)

    def solve(path):
        model = cf.Model(
            [rod], [], [cf.PartContact(rod, cf.Part("p", mesh=path), friction=0.1), cf.Gravity((0, 0, -G))]
        )
        return cf.solve_static(model)

    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    for name in ("nan", "empty", "nowhere"):
        with pytest.raises(cf.MeshError, match="part 'p'"):
            solve(tmp_path / f"{name}.obj")
    points, triangles = cf.Box((0.05, 0, 0), (0.3, 0.3, 0.1)).surface()
    write_obj(tmp_path / "flipped.obj", points, triangles[:, ::-1])
    assert solve(tmp_path / "flipped.obj").contact_load("p")[0, 2] == pytest.approx(-0.1 * WEIGHT, rel=1e-8)
