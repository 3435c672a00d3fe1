"""Rods that lie, are lifted, stand in a ruck and are bent over a drum: against boundary value problems."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from verification import contact_references as cr

import cosserat_fem as cf

THICK = 0.002


FLOOR = cf.Plane((0, 0, 0), (0, 0, 1))
WEIGHT, EI = 1.0, 1e-3  # N/m, N m^2; in the unit (EI / WEIGHT)^(1/3) = 0.1 m nothing else counts


def lifted(height, n_elements):
    """A heavy rod on a plane that is lifted at its start, s = 0."""
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(EI,) * 3, mass_per_length=WEIGHT / 9.81, radius=THICK
    )
    rod = cf.Rod("rod", section, [(0, 0, THICK * 1.002), (1, 0, THICK * 1.002)], n_elements=n_elements, order=3)
    hand = cf.Part("hand", motion=cf.Slider((0, 0, 1), ([0, 1], [0.0, height])))
    supports = [cf.Pin(rod, "start", to=hand, free=("x",)), cf.Clamp(rod, "end")]
    terms = [cf.PartContact(rod, cf.Part("floor", shape=FLOOR)), cf.Gravity((0, 0, -9.81))]
    return cf.solve_quasistatic(cf.Model([rod], supports, terms), np.linspace(0, 1, 4))


def in_elements(nodal):
    """Sums over the elements of values at the nodes (order 3); neighbours share a node evenly."""
    return 0.5 * (nodal[:-1:3] + nodal[3::3]) + nodal[1::3] + nodal[2::3]


def touch_down(s, force, first, last):
    """Place [m] where a rod leaves the plane and point force [N] there, from elements first to last - 1, which lie beyond.

    Contact of these is a point force R at l and the rod's weight from there to their end e; two sums give both:
    sum of f = R + w (e - l),  sum of f s = R l + w (e^2 - l^2) / 2.
    """
    total, first_moment = (in_elements(f)[first:last].sum() for f in (force, force * s))
    e = s[3 * last]
    excess = WEIGHT * e - total  # = w l - R
    place = (excess + np.sqrt(excess**2 + WEIGHT * (2 * first_moment - WEIGHT * e**2))) / WEIGHT
    return place, WEIGHT * place - excess


@pytest.mark.parametrize("height", [0.02, 0.1])
def test_lifted_rod(validation, height):
    """A heavy rod on a plane, lifted at one end: the force at the end, and where it leaves the plane."""
    history = lifted(height, 24)
    wanted = cr.lifted_rod(height, WEIGHT, EI)
    found = history.reaction("rod.start@hand")[-1, 2]
    source, variant = "boundary value problem by collocation", f"lifted by {height:g} m"
    validation.row("heavy rod lifted off a plane", source, wanted.force, found, 2e-3, variant=variant)
    place = history.positions("rod")[-1]
    at = np.interp(0.5 * height, place[::-1, 2] - THICK, history.nodes("rod")[::-1])
    there = wanted.length - np.interp(0.5 * height, wanted.z, wanted.s)
    validation.row("heavy rod lifted off a plane", source, there, at, 5e-3, variant=f"place at half height, {variant}")


@pytest.mark.parametrize("height", [0.02, 0.1])
def test_touch_down(validation, height):
    """Where a lifted rod touches down there is a point force and no moment, which grows evenly from there."""
    n = 48
    history = lifted(height, n)
    wanted = cr.lifted_rod(height, WEIGHT, EI)
    case, source = "heavy rod at touch-down", "boundary value problem by collocation"
    length, reaction = touch_down(history.nodes("rod"), history.contact_force("rod")[-1, :, 2], 0, round(0.7 * n))
    validation.row(case, source, wanted.length, length, 5e-3, variant=f"length off the plane, lifted by {height:g} m")
    validation.row(case, source, wanted.reaction, reaction, 5e-3, variant=f"point force, lifted by {height:g} m")
    s, moment = history.stations("rod"), abs(history.section_forces("rod")[-1, :, 3])
    off = wanted.length - s
    largest = EI * abs(wanted.curvature).max()
    # the barrier, of stiffness k, spreads the point force over some (EI / k)^(1/4), here a hundredth of a metre
    near = (off > 0.2 * wanted.length) & (off < 0.5 * wanted.length)
    free = EI * np.interp(off[near], wanted.s, abs(wanted.curvature))
    variant = f"moment off the plane, lifted by {height:g} m"
    validation.row(case, source, free, moment[near], 2e-3, scale=largest, variant=variant)
    there = np.interp(wanted.length, s, moment)
    validation.row(case, source, 0.0, there, 0.05, scale=largest, variant=f"moment there, lifted by {height:g} m")
    lies = (off < -0.05) & (s < 0.7)
    validation.row(
        case, source, 0.0, moment[lies], 2e-3, scale=largest, variant=f"moment beyond, lifted by {height:g} m"
    )


# rucks

LONG = 1.0  # of the strip


def rucked(shortening, n_elements, *, friction=0.0, hold=True, loads=lambda rod: ()):
    """A strip on a plane, drawn with a bump that makes its ends `shortening` [m] nearer, which are held if wanted.

    It is stiff sideways: a round rod on a smooth floor would lie down and bow aside instead. The middle may only rise.
    """
    section = cf.Section(
        force_stiffness=(1e5,) * 3,
        moment_stiffness=(EI, 1e4 * EI, 1e4 * EI),
        mass_per_length=WEIGHT / 9.81,
        radius=THICK,
    )
    x = 0.5 * (LONG - shortening) * np.linspace(-1, 1, 401)
    bump = np.cos(0.5 * np.pi * np.clip(x / 0.25, -1, 1)) ** 4
    height = brentq(lambda h: np.hypot(np.diff(x), h * np.diff(bump)).sum() - LONG, 0.01, 0.5)
    drawn = np.column_stack([x, 0 * x, height * bump + THICK * 1.001])
    rod = cf.Rod("rod", section, drawn, n_elements=n_elements, order=3, length=LONG)
    supports = [cf.Clamp(rod, 0.5 * LONG, free=("z",))]
    supports += [cf.Clamp(rod, end, free=("z", "ry")) for end in ("start", "end") if hold]
    terms = [cf.PartContact(rod, cf.Part("floor", shape=FLOOR), friction=friction), cf.Gravity((0, 0, -9.81))]
    return cf.Model([rod], supports, [*terms, *loads(rod)])


@pytest.mark.parametrize("shortening", [0.02, 0.1])
def test_ruck(validation, shortening):
    """A ruck in a strip whose ends are held: how high it stands, how hard it pushes, how much of the strip is up."""
    n = 48
    history = cf.solve_static(rucked(shortening, n))
    wanted = cr.ruck(shortening, WEIGHT, EI)
    case, source, variant = "ruck in a heavy strip", "boundary value problem by collocation", f"{shortening:g} m"
    assert history.stable == [True]
    height = history.positions("rod")[0, :, 2].max() - THICK
    validation.row(case, source, wanted.height, height, 5e-3, variant=f"height, {variant}")
    push = [history.reaction("rod.start@ground")[0, 0], -history.reaction("rod.end@ground")[0, 0]]
    validation.row(case, source, wanted.compression, push, 5e-3, variant=f"compression, {variant}")
    s, force = history.nodes("rod"), history.contact_force("rod")[0, :, 2]
    place, reaction = touch_down(s, force, n // 2, round(0.9 * n))
    off = 2 * (place - 0.5 * LONG)
    validation.row(case, source, wanted.length, off, 5e-3, variant=f"length off the plane, {variant}")
    validation.row(case, source, wanted.reaction, reaction, 5e-3, variant=f"point force at lift-off, {variant}")


@pytest.mark.parametrize("part", [1.01, 0.99])
def test_ruck_held_by_friction(validation, part):
    """The ends of a strip with a ruck are let go little by little: friction holds it, or it spreads until all is flat.

    All the weight of a half rests on the floor beside the ruck, that of the ruck at lift-off. So it holds if mu times
    half the weight is more than N; what it loses in length makes N grow, and nothing stops it once it moves.
    """
    shortening, n = 0.05, 48
    wanted = cr.ruck(shortening, WEIGHT, EI)
    held = cf.solve_static(rucked(shortening, n)).final
    N = wanted.compression

    def loads(rod):
        ends = [("start", (N, 0, 0)), ("end", (-N, 0, 0))]
        return [cf.PointLoad(rod, end, ([0, 1], [force, (0, 0, 0)])) for end, force in ends]

    model = rucked(shortening, n, friction=part * N / (0.5 * LONG * WEIGHT), hold=False, loads=loads)
    history = cf.solve_quasistatic(model, np.linspace(0, 1, 6), start=replace(held, contact=None))
    height = history.positions("rod")[:, :, 2].max(axis=1) - THICK
    rub = history.contact_force("rod")[:, : 3 * n // 2, 0].sum(axis=1)
    case, source = "ruck held by friction", "boundary value problem by collocation"
    standing = history.t < (1.1 if part > 1 else 0.9)
    variant = f"friction {part:g} of what it takes"
    pushed = N * history.t[standing]
    validation.row(case, source, pushed, rub[standing], 5e-3, variant=f"force of friction, {variant}")
    validation.row(case, source, wanted.height, height[standing], 5e-3, variant=f"height, {variant}")
    if part < 1:
        assert height[-1] < 1e-3 * wanted.height
        ends = history.positions("rod")[-1, [0, -1], 0]
        validation.row(case, "flat", LONG, np.ptp(ends), 1e-3, variant=f"how long it lies, {variant}")


# over a drum


@pytest.mark.parametrize("force", [8.0, 20.0])
def test_bent_over_a_drum(validation, force):
    """A rod laid over a drum and pulled down at both ends, without friction: its ends, and how it presses.

    A point force where it leaves the drum, and between both an even line force, which goes with the pull along the rod;
    elements are a seventh to a tenth of the touching half long, and their sums count.
    """
    EI, R, half = 0.01, 0.05, 0.15
    section = cf.Section(force_stiffness=(1e5,) * 3, moment_stiffness=(EI,) * 3, radius=THICK)
    top = (R + THICK) * 1.0001
    rod = cf.Rod("rod", section, [(-half, 0, top), (half, 0, top)], n_elements=48, order=3)
    drum = cf.Part("drum", shape=cf.Cylinder((0, -0.05, 0), (0, 0.05, 0), R))
    loads = [cf.PointLoad(rod, end, (0, 0, -force)) for end in ("start", "end")]
    middle = cf.Clamp(rod, half, free=("z", "ry"))
    history = cf.solve_static(cf.Model([rod], [middle], [cf.PartContact(rod, drum), *loads]))
    wanted = cr.mandrel(force, half, R + THICK, EI)
    place = history.positions("rod")[0][:, [0, 2]]
    source, case = "elastica with point forces at lift-off, quadrature", "rod bent over a drum"
    validation.row(case, source, wanted.tip, place[-1], 2e-3, scale=half, variant=f"{force:g} N")
    away = place / np.linalg.norm(place, axis=1)[:, None]
    pressed = np.einsum("ni,ni->n", history.contact_force(rod)[0][:, [0, 2]], away)
    h = 2 * half / 48
    elements = in_elements(pressed)
    edge = wanted.lift_off_angle * (R + THICK)
    inner = elements[24 : 24 + int(0.5 * edge / h)] / h
    validation.row(case, source, wanted.line_pressure, inner, 2e-3, variant=f"line force between, {force:g} N")
    point = elements[24:].sum() - wanted.line_pressure * edge
    validation.row(case, source, wanted.point_force, point, 2e-3, variant=f"point force at lift-off, {force:g} N")
