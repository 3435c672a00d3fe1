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
    """A rod laid over a drum and pulled down at both ends: where its ends come to, without friction."""
    EI, R, half = 0.01, 0.05, 0.15
    section = cf.Section(force_stiffness=(1e5,) * 3, moment_stiffness=(EI,) * 3, radius=THICK)
    top = (R + THICK) * 1.0001
    rod = cf.Rod("rod", section, [(-half, 0, top), (half, 0, top)], n_elements=48, order=3)
    drum = cf.Part("drum", shape=cf.Cylinder((0, -0.05, 0), (0, 0.05, 0), R))
    loads = [cf.PointLoad(rod, end, (0, 0, -force)) for end in ("start", "end")]
    middle = cf.Clamp(rod, half, free=("z", "ry"))
    history = cf.solve_static(cf.Model([rod], [middle], [cf.PartContact(rod, drum), *loads]))
    wanted = cr.mandrel(force, half, R + THICK, EI).tip
    tip = history.positions("rod")[0, -1, [0, 2]]
    source = "elastica with point forces at lift-off, quadrature"
    validation.row("rod bent over a drum", source, wanted, tip, 2e-3, scale=half, variant=f"{force:g} N")
