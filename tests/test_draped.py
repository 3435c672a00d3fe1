"""Heavy rods that come to rest on soft ones, far below where they are drawn: an equilibrium is found, and soon."""

import numpy as np
import pytest

import cosserat_fem as cf

RADIUS, EI, LONG, HALF, LOW = 0.005, 0.01, 0.6, 0.15, 0.4


def draped(load, angle, aside, **contact):
    """A rod of weight load EI / L^2, clamped at one end, over another one that is clamped at both and crosses it at an angle
    [rad], `aside` [m] from its middle, where two elements meet."""
    stiffness = {"force_stiffness": (1e4,) * 3, "moment_stiffness": (EI,) * 3, "radius": RADIUS}
    heavy = cf.Section(**stiffness, mass_per_length=load * EI / LONG**3 / 9.81)
    high = cf.Rod("high", heavy, [(0, 0, 2.04 * RADIUS), (LONG, 0, 2.04 * RADIUS)], n_elements=16)
    way, middle = HALF * np.array([np.cos(angle), np.sin(angle), 0]), np.array([LOW, aside, 0])
    low = cf.Rod("low", cf.Section(**stiffness), [middle - way, middle + way], n_elements=8)
    supports = [cf.Clamp(high, "start"), cf.Clamp(low, "start"), cf.Clamp(low, "end")]
    terms = [cf.RodContact([high, low], **contact), cf.Gravity((0, 0, -9.81))]
    return cf.solve_static(cf.Model([high, low], supports, terms))


def check(history, load):
    """The supports carry the weight, by the lower rod what the upper one leaves."""
    up = {name: history.reaction(name)[0, 2] for name in ("high.start@ground", "low.start@ground", "low.end@ground")}
    assert sum(up.values()) == pytest.approx(load * EI / LONG**2, rel=1e-7)
    assert up["low.start@ground"] + up["low.end@ground"] > 0.2 * load * EI / LONG**2
    assert (history.records[0].state.r[:, 2] > -0.5 * LONG).all()


@pytest.mark.parametrize("load", [2, 6])
def test_at_rest_where_elements_meet(load):
    """In the middle of the lower rod: what presses it there does not jump from one element to the other and back."""
    history = draped(load, 0.5 * np.pi, 0.0)
    assert history.counters.iterations <= 40
    check(history, load)


@pytest.mark.parametrize(("load", "most"), [(6, 60), (12, 60)])
def test_far_from_the_drawn_shape(load, most):
    """Increments of which gaps let little be taken, one after the other, are a way forward though no residual falls."""
    history = draped(load, 0.5 * np.pi, 0.004)
    assert history.counters.iterations <= most
    check(history, load)
