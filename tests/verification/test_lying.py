"""Rods that lie, are lifted and are bent over a drum: force, length and shape against boundary value problems."""

import numpy as np
import pytest
from verification import contact_references as cr

import cosserat_fem as cf

THICK = 0.002


@pytest.mark.parametrize("height", [0.02, 0.1])
def test_lifted_rod(validation, height):
    """A heavy rod on a plane, lifted at one end: the force at the end, and where it leaves the plane."""
    weight, EI = 1.0, 1e-3
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(EI,) * 3, mass_per_length=weight / 9.81, radius=THICK
    )
    rod = cf.Rod("rod", section, [(0, 0, THICK * 1.002), (1, 0, THICK * 1.002)], n_elements=24, order=3)
    hand = cf.Part("hand", motion=cf.Slider((0, 0, 1), ([0, 1], [0.0, height])))
    floor = cf.Part("floor", shape=cf.Plane((0, 0, 0), (0, 0, 1)))
    supports = [cf.Pin(rod, "start", to=hand, free=("x",)), cf.Clamp(rod, "end")]
    terms = [cf.PartContact(rod, floor), cf.Gravity((0, 0, -9.81))]
    history = cf.solve_quasistatic(cf.Model([rod], supports, terms), np.linspace(0, 1, 4))
    wanted = cr.lifted_rod(height, weight, EI)
    found = history.reaction("rod.start@hand")[-1, 2]
    source, variant = "boundary value problem by collocation", f"lifted by {height:g} m"
    validation.row("heavy rod lifted off a plane", source, wanted.force, found, 2e-3, variant=variant)
    place = history.positions("rod")[-1]
    at = np.interp(0.5 * height, place[::-1, 2] - THICK, history.nodes("rod")[::-1])
    there = wanted.length - np.interp(0.5 * height, wanted.z, wanted.s)
    validation.row("heavy rod lifted off a plane", source, there, at, 5e-3, variant=f"place at half height, {variant}")


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
    elements = 0.5 * (pressed[:-1:3] + pressed[3::3]) + pressed[1::3] + pressed[2::3]  # N on each
    edge = wanted.lift_off_angle * (R + THICK)
    inner = elements[24 : 24 + int(0.5 * edge / h)] / h
    validation.row(case, source, wanted.line_pressure, inner, 2e-3, variant=f"line force between, {force:g} N")
    point = elements[24:].sum() - wanted.line_pressure * edge
    validation.row(case, source, wanted.point_force, point, 2e-3, variant=f"point force at lift-off, {force:g} N")
