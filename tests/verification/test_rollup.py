"""A01. Cantilever rolled up by an end moment M = 2 pi n EI / L: n closed circles. Closed form."""

import numpy as np
import pytest

import cosserat_fem as cf

STIFFNESS = (1e4, 1e4, 1e4, 1.0, 1.0, 1.0)


def tip_error(cantilever, turns, n_elements, order, stiffness=STIFFNESS):
    model = cantilever(stiffness, 1.0, n_elements=n_elements, order=order, moment=(0, 0, 2 * np.pi * turns))
    history = cf.solve_static(model)
    assert history.counters.load_steps == 0
    # a moment cannot stretch a rod: the tip comes back to the clamp
    return np.linalg.norm(history.positions("rod")[0, -1]), history


@pytest.mark.parametrize(("turns", "n_elements"), [(1, 8), (2, 16), (3, 24), (5, 40)])
def test_full_turns_in_one_load_step(cantilever, validation, turns, n_elements):
    """One to five turns from the straight rod at once: past 2 pi, 4 pi and on, in a handful of iterations."""
    error, history = tip_error(cantilever, turns, n_elements, 4)
    validation.error(
        "roll-up", "closed form", error, 1e-6, unit="L", variant=f"{turns} turns, {n_elements} x p4, one step"
    )
    assert history.counters.iterations <= 6
    assert history.counters.guarded == 0
    np.testing.assert_allclose(history.reaction("rod.start@ground")[0, 3:], (0, 0, -2 * np.pi * turns), atol=1e-9)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
def test_parts_of_a_turn(cantilever, part):
    """Arc of angle 2 pi n: tip at (sin a, 1 - cos a) / a."""
    model = cantilever(STIFFNESS, 1.0, n_elements=8, order=4, moment=(0, 0, 2 * np.pi * part))
    tip = cf.solve_static(model).positions("rod")[0, -1]
    a = 2 * np.pi * part
    np.testing.assert_allclose(tip, (np.sin(a) / a, (1 - np.cos(a)) / a, 0), atol=1e-9)


@pytest.mark.parametrize(
    ("order", "counts"), [(1, (20, 40, 80)), (2, (10, 20, 40)), (3, (8, 16, 32)), (4, (6, 12, 24))]
)
def test_order(cantilever, validation, order_of, order, counts):
    """Error ~ h^(2p) at the nodes: order p with p Gauss points."""
    errors = [tip_error(cantilever, 1, n, order)[0] for n in counts]
    found = order_of(counts, errors)
    validation.error(
        "roll-up", "closed form", errors[-1], 1e-3, unit="L", variant=f"{counts[-1]} elements",
        order=found, least_order=2 * order - 0.3,
    )  # fmt: skip


@pytest.mark.parametrize("slender", [1e2, 1e4, 1e6, 1e8])
def test_slender_rod_rolls_up_as_well(cantilever, validation, slender):
    """EA L^2 / EI from 1e2 to 1e8: still one step, the same accuracy."""
    error, history = tip_error(cantilever, 1, 8, 4, (slender,) * 3 + (1.0, 1.0, 1.0))
    validation.error("roll-up", "closed form", error, 1e-6, unit="L", variant=f"EA L^2 / EI = {slender:g}")
    assert history.counters.iterations <= 6
