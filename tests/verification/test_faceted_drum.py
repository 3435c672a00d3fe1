"""A rope that slips over a drum given as a mesh: how much its facets show in the force that pulls.

Ripple is largest less least over mean, while the rope slips. The rope bends within sqrt(EI / T1), here a tenth of the drum's
radius, so 32 facets to a turn are twice as long as that. On facets much longer it turns at each edge by itself, where the
couple of friction lowers T2; a rope that bends more sharply needs more facets for the same ripple.
"""

import numpy as np
import pytest
from verification import contact_references as cr

import cosserat_fem as cf
from helpers import drum_mesh, round_a_drum

RADIUS, THICK, TENSION, MU, FREE = 0.1, 0.002, 10.0, 0.3, 0.15
EI = TENSION * (0.1 * RADIUS) ** 2
STATIONS = 8  # to a facet


def ripple(path, facets, per_half_turn, *, turns):
    """Ripple of T2/T1, and its mean, of a rope pulled over a drum by three facets, or held while the drum turns by them."""
    section = cf.Section(force_stiffness=(1e5,) * 3, moment_stiffness=(EI,) * 3, mass_per_length=0.01, radius=THICK)
    edges = RADIUS * np.sqrt(2 * np.pi / facets / np.sin(2 * np.pi / facets))
    r = edges + 1.01 * THICK
    h = np.pi * r / per_half_turn
    points, out = round_a_drum(r, np.pi, h, FREE)
    out = out[[0, 2, 1]]
    n_elements = round((np.pi * r + 2 * FREE) / h)
    rope = cf.Rod("rope", section, points[:, [0, 2, 1]], n_elements=n_elements, order=3)
    drum = drum_mesh(path, RADIUS, facets, motion=cf.Hinge((0, 0, 0), (0, -1, 0), 1.0) if turns else None)
    hand = cf.GROUND if turns else cf.Part("hand", motion=cf.Slider(tuple(out), RADIUS))
    term = cf.PartContact(rope, drum, friction=MU, pressure=TENSION / RADIUS)
    load = cf.PointLoad(rope, "start", (0, 0, -TENSION))
    model = cf.Model([rope], [cf.Pin(rope, "end", to=hand)], [term, load])
    history = cf.solve_quasistatic(model, 2 * np.pi / facets / STATIONS * np.arange(3 * STATIONS + 1))
    assert (np.diff(history.friction_work(term.name)) > 0).all()
    force = history.reaction(f"rope.end@{hand.name}")[STATIONS + 1 :, :3] @ out / TENSION  # it slips all along by then
    return np.ptp(force) / force.mean(), force.mean()


@pytest.mark.parametrize("elements", [48, pytest.param(24, marks=pytest.mark.slow)])
@pytest.mark.parametrize("turns", [False, True], ids=["pulled", "turning"])
def test_ripple(tmp_path, validation, turns, elements):
    """Below a hundredth from 32 facets on, of all frequencies together; the mean goes to that of a smooth drum.

    A drum at rest under a uniform rope is the same at all times, so elements that pass the edges are all that can show. A
    drum that turns also lifts the rope by R (1 - cos(pi/n)) at each facet, which tilts the span that is held. Elements
    show as much as that, so no rate at which ripple falls is asserted.
    """
    case = "rope over a faceted drum, " + ("which turns under it" if turns else "pulled")
    for facets in (32, 64, 128):
        size, mean = ripple(tmp_path / f"{facets}.obj", facets, elements, turns=turns)
        variant = f"{facets} facets, {elements} elements to half a turn"
        validation.error(case, "no ripple", size, 1e-2, variant=f"ripple, {variant}")
    smooth = cr.stiff_capstan(MU, np.pi, THICK, RADIUS, EI, TENSION).ratio
    source = "stiff rope on a smooth drum, closed form"
    validation.row(case, source, smooth, mean, 3e-3, variant=f"mean T2/T1, {variant}")


@pytest.mark.parametrize("facets", [512, pytest.param(1024, marks=pytest.mark.slow)])
def test_facets_far_finer_than_elements(tmp_path, validation, facets):
    """An equilibrium is found at each station, though the rope lifts off in the middle of facets as often as at edges."""
    size, mean = ripple(tmp_path / "drum.obj", facets, 24, turns=False)
    smooth = cr.stiff_capstan(MU, np.pi, THICK, RADIUS, EI, TENSION).ratio
    variant = f"{facets} facets, 24 elements to half a turn"
    case = "rope over a finely faceted drum, pulled"
    validation.error(case, "no ripple", size, 5e-4, variant=f"ripple, {variant}")
    validation.row(
        case, "stiff rope on a smooth drum, closed form", smooth, mean, 1e-3, variant=f"mean T2/T1, {variant}"
    )
