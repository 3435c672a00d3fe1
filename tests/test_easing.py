"""Equilibrium by way of soft contact: the same one that the Newton method finds where it finds one."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration.easing import eased
from cosserat_fem.iteration.newton import Newton
from helpers import centreline, round_a_drum

RADIUS = 0.005
CABLE = cf.Section.round(2 * RADIUS, youngs_modulus=1e8, poisson_ratio=0.3, density=1200)


def pressed(**contact):
    """A rod clamped at both ends and a ball that comes down on it."""
    rod = cf.Rod("rod", CABLE, [(-0.2, 0, 0), (0.2, 0, 0)], n_elements=8)
    ball = cf.Part("ball", shape=cf.Sphere((0.01, 0, 0.0301), 0.025), motion=cf.Slider((0, 0, -1), 1.0))
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")]
    return cf.Model([rod], supports, [cf.PartContact(rod, ball, **contact)])


def crossed(**contact):
    """A rod clamped at both ends that comes down with its ends on another one."""
    low = cf.Rod("low", CABLE, [(0, -0.2, 0), (0, 0.2, 0)], n_elements=8)
    high = cf.Rod("high", CABLE, [(-0.2, 0, 0.0101), (0.2, 0, 0.0101)], n_elements=8)
    hand = cf.Part("hand", motion=cf.Slider((0, 0, -1), 1.0))
    supports = [cf.Clamp(low, end) for end in ("start", "end")] + [
        cf.Clamp(high, end, to=hand) for end in ("start", "end")
    ]
    return cf.Model([low, high], supports, [cf.RodContact([low, high], **contact)])


def first(model):
    """A solver, and the accepted state at t = 0."""
    newton = Newton(model)
    solved = newton.accepted(newton.settled(newton.approach.begin(model.initial_state())))
    assert solved.converged
    return newton, solved.state


@pytest.mark.parametrize(
    "contact", [{}, {"friction": 0.3}, {"layer": (1e6, 1e-3)}], ids=["smooth", "friction", "layer"]
)
@pytest.mark.parametrize("make", [pressed, crossed])
def test_same_equilibrium(make, contact):
    """Places within the stand-off that is allowed, supports closed, and the same forces on them."""
    model = make(**contact)
    newton, state = first(model)
    straight, round_about = newton.plain(state.at_time(0.01)), eased(newton, state.at_time(0.01))
    assert straight.converged
    assert round_about.converged
    np.testing.assert_allclose(round_about.state.r, straight.state.r, atol=1e-3 * RADIUS)
    largest = np.abs(straight.reactions[:, :3]).max()
    np.testing.assert_allclose(round_about.reactions[:, :3], straight.reactions[:, :3], atol=1e-3 * largest)
    assert round_about.state.contact.time == round_about.state.t == 0.01


@pytest.mark.parametrize("make", [pressed, crossed])
@pytest.mark.parametrize("layer", [None, (1e6, 1e-3)], ids=["hard", "layer"])
def test_wider_barrier_begins_at_the_same_place(make, layer):
    """Its range grows towards the core, which stays a positive distance; one that is deep enough stays as it is."""
    model = make(layer=layer)
    (term,) = model.contacts
    wide = term.widened(0.5)
    assert wide.range >= 0.39 * RADIUS

    def level(of):
        thick = of.radius if make is pressed else sum(of.radii)
        depth = 0.5 * of.range if layer is None else of.range + layer[1]
        return thick - depth, thick - depth + of.range + (0.0 if layer is None else layer[1])

    assert level(wide)[1] == pytest.approx(level(term)[1], rel=1e-14)
    assert 0.0 < level(wide)[0] < level(term)[0]
    assert term.widened(1e-9).range == term.range


def test_soft_rods_do_not_pass():
    """A thin wire that rises by four radii lifts the rod, also while its barrier is soft; the rod is above it in the end."""
    rod = cf.Rod("rod", CABLE, [(0, -0.2, 0), (0, 0.2, 0)], n_elements=8)
    low = -1.05 * RADIUS
    shape = cf.Capsule((-0.1, 0.01, low), (0.1, 0.01, low), 1e-4)
    wire = cf.Part("wire", shape=shape, motion=cf.Slider((0, 0, 1), 1.0))
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")]
    newton, state = first(cf.Model([rod], supports, [cf.PartContact(rod, wire)]))
    solved = eased(newton, state.at_time(4 * RADIUS))
    assert solved.converged
    x, y, z = centreline(newton.model, rod, solved.state, 50).T
    height = np.interp(0.01, y, z) - 4 * RADIUS - low
    assert height > RADIUS  # above it
    assert shape.distance(np.stack([x, y, z - 4 * RADIUS], axis=1)).min() == pytest.approx(RADIUS, abs=1e-3 * RADIUS)


def test_nothing_is_kept():
    """What soft terms looked up is let go."""
    newton, state = first(pressed())
    space = newton.model.space
    before = set(space._memo)
    eased(newton, state.at_time(0.01))
    assert set(space._memo) == before


def test_trapped_is_said():
    """Nothing gives way: the terms that are in the way are named, and it does not go on for ever."""
    rod = cf.Rod("rod", CABLE, [(-0.2, 0, 0), (0.2, 0, 0)], n_elements=8)
    floor = cf.Part("floor", shape=cf.Plane((0, 0, -1.001 * RADIUS), (0, 0, 1)))
    press = cf.Part("press", shape=cf.Plane((0, 0, 1.01 * RADIUS), (0, 0, -1)), motion=cf.Slider((0, 0, -1), 1.0))
    terms = [cf.PartContact(rod, part) for part in (floor, press)]
    newton, state = first(cf.Model([rod], [], [*terms, cf.Gravity((0, 0, -9.81))]))
    solved = eased(newton, state.at_time(0.2 * RADIUS))
    assert not solved.converged
    assert "no way forward is left between rod 'rod' and part" in solved.reason
    assert solved.iterations < 400


def test_a_load_far_from_what_was_thought():
    """A thin rope round a drum, pulled a hundred times harder than its stiffness would: found with a harder soft barrier."""
    radius, drum_radius, pull, turn = 0.002, 0.1, 10.0, 1.9 * np.pi
    stiffness = pull * (0.01 * drum_radius) ** 2
    section = cf.Section(
        force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=(stiffness,) * 3, mass_per_length=0.01, radius=radius
    )
    r, free = drum_radius + radius + 2e-5, 0.05
    h = np.pi * r / 40
    points, _ = round_a_drum(r, turn, h, free)
    rope = cf.Rod("rope", section, points, n_elements=round((turn * r + 2 * free) / h))
    drum = cf.Part("drum", shape=cf.Cylinder((0, 0, -0.05), (0, 0, 0.05), drum_radius))
    terms = [cf.PartContact(rope, drum, friction=0.3), cf.PointLoad(rope, "start", (0, -pull, 0))]
    history = cf.solve_static(cf.Model([rope], [cf.Pin(rope, "end")], terms))
    told = history.pressed("rope-drum")[0]
    assert told.spans[-1, 1] - told.spans[0, 0] > 0.95 * turn * drum_radius
    assert pull / r < told.peak < 10 * pull / r
    ends = history.reaction("rope.end@ground")[0, :3] + (0, -pull, 0)
    np.testing.assert_allclose(history.contact_load("drum")[0, :3], ends, atol=1e-7 * pull)
