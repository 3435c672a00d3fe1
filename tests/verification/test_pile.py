"""A rope that falls on itself: never through the floor, never through itself, and it comes to rest."""

import judge
import numpy as np
import pytest

import cosserat_fem as cf
from helpers import centreline

RADIUS = 0.004


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:energy ledger")
def test_pile(say):
    """Two loose turns fall on the floor and on each other. Judged after each step, twenty places to an element."""
    angle = np.linspace(0, 3.5 * np.pi, 15)
    turns = angle / (2 * np.pi)
    points = np.stack([0.04 * np.cos(angle) + 0.03 * turns, 0.04 * np.sin(angle), 0.008 + 0.025 * turns], axis=1)
    section = cf.Section.round(2 * RADIUS, youngs_modulus=2e6, poisson_ratio=0.4, density=1200)
    rope = cf.Rod("rope", section, points, n_elements=18, order=2, rest="as_drawn")
    floor = cf.Part("floor", shape=cf.Plane((0, 0, 0), (0, 0, 1)))
    contact = [cf.PartContact(rope, floor, friction=0.4), cf.RodContact([rope], friction=0.4)]
    model = cf.Model([rope], [], [*contact, cf.Gravity((0, 0, -9.81)), cf.Damping(time=0.02)])
    frames = [centreline(model, rope, model.initial_state(), 20)]

    def look(run):
        frames.append(centreline(model, rope, run.state, 20))

    history = cf.solve_dynamic(
        model, 0.8, start="drawn", step=cf.FixedStep(1e-3), rho_inf=0.3, callback=look, times=[0.4, 0.8]
    )
    frames = np.array(frames)
    places = rope.length / (frames.shape[1] - 1)  # from one to the next
    neighbours = int(np.ceil(2 * np.pi * RADIUS / places))
    assert judge.crossings_self(frames, skip=neighbours) == 0
    floor_depth = RADIUS - frames[:, :, 2].min()
    i, j = np.triu_indices(frames.shape[1], neighbours)
    overlap = 2 * RADIUS - min(np.linalg.norm(frame[i] - frame[j], axis=1).min() for frame in frames)
    speed = np.linalg.norm(history.velocities(rope)[-1, :, :3], axis=1).max()
    say(
        f"overlap {overlap / RADIUS:.1e}, in the floor {floor_depth / RADIUS:.1e} radii, at the end {speed:.1e} m/s, "
        f"{history.message}"
    )
    assert floor_depth < 0.02 * RADIUS
    assert overlap < 0.05 * RADIUS
    assert speed < 1e-3 * rope.length
    assert history.pressed("rope-rope")[-1].peak > 0
