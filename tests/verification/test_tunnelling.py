"""No tunnelling: thrown rods against a wire, an edge, a sheet and each other; parts that move push. An own judge decides.

The judge sees the centreline at every accepted step, fifty places to an element, and shares no code with contact.
"""

from typing import NamedTuple

import judge
import numpy as np
import pytest

import cosserat_fem as cf
from helpers import centreline, write_obj

RADIUS, ELEMENT = 1e-3, 5e-3
WIRE = np.array([(-0.1, 0.0, 0.0), (0.1, 0.0, 0.0)])
SHEET = np.array([(-0.03, -0.02, 0.0), (0.03, -0.02, 0.0), (0.0, 0.035, 0.0)])
FACES = np.array([(0, 1, 1), (0, -1, 1)]) / np.sqrt(2)  # of the edge: above, its two sides
TARGETS = ("wire", "edge", "sheet", "rod")
BLOCKS, EACH = 10, 25  # 4 targets: 1000 throws


class Thrown(NamedTuple):
    passes: float  # as the judge counts; of the edge the depth [m]
    steps: int
    touched: bool
    message: str  # empty if the run got to its end


def part(target, tmp_path):
    """What is thrown at, about the origin, met from above."""
    if target == "wire":
        return cf.Part("wire", shape=cf.Capsule(*WIRE, RADIUS / 2))
    if target == "edge":
        axes = np.array([(1, 0, 0), (0, 1, 1), (0, -1, 1)]).T / [1, np.sqrt(2), np.sqrt(2)]
        return cf.Part("box", shape=cf.Box((0, 0, -0.05 * np.sqrt(2)), (0.3, 0.1, 0.1), axes))
    write_obj(tmp_path / "sheet.obj", SHEET, [(0, 1, 2)])
    return cf.Part("sheet", mesh=tmp_path / "sheet.obj")


def passes(target, frames):
    """frames: of both rods, (T, S, 3) each."""
    if target == "wire":
        return judge.crossings_segment(frames[0], *WIRE)
    if target == "edge":
        return judge.inside_convex(frames[0], FACES, np.zeros(2))
    if target == "sheet":
        return judge.crossings_triangle(frames[0], SHEET)
    return judge.crossings_rods(*frames)


def section(rng):
    return cf.Section.round(2 * RADIUS, youngs_modulus=10 ** rng.uniform(6, 9), poisson_ratio=0.3, density=1200)


def throw(target, seed, tmp_path, *, contact=True, most=300):
    """Throw a short rod so that its middle would go through the target, spinning, with a step that may be far too long."""
    rng = np.random.default_rng([TARGETS.index(target), seed])
    speed, dt = 10 ** rng.uniform(0, 2), 10 ** rng.uniform(-4, -3)
    n, order = int(rng.integers(4, 8)), int(rng.integers(1, 4))
    length, turn = n * ELEMENT, rng.uniform(0.2, np.pi - 0.2)  # from the wire's direction
    tangent = np.array([np.cos(turn), np.sin(turn), 0.4 * rng.normal()])
    tangent /= np.linalg.norm(tangent)
    center = np.array([*(2e-3 * rng.normal(size=2)), 4 * RADIUS + 0.5 * length * abs(tangent[2])])
    ends = center + 0.5 * length * np.array([[-1.0], [1.0]]) * tangent
    rods = [cf.Rod("thrown", section(rng), ends, n_elements=n, order=order)]
    supports, obstacle = [], None
    if target == "rod":
        rods.append(cf.Rod("held", section(rng), [(-0.02, 3e-4, 0), (0.02, -2e-4, 0)], n_elements=8, order=order))
        supports = [cf.Clamp(rods[1], "start"), cf.Clamp(rods[1], "end")]
    else:
        obstacle = part(target, tmp_path)
    friction = float(rng.choice([0.0, 0.3]))
    if not contact:
        terms = []
    elif obstacle is None:
        terms = [cf.RodContact(rods, friction=friction)]
    else:
        terms = [cf.PartContact(rods[0], obstacle, friction=friction)]
    model = cf.Model(rods, supports, terms)
    velocity = np.zeros((model.space.n_nodes, 6))
    aim = np.array([*(-center[:2]), -center[2]])
    motion = cf.RigidVelocity(
        v=speed * aim / np.linalg.norm(aim), omega=0.3 * rng.normal(size=3) * speed / length, point=center
    )
    nodes = model.space[rods[0]].nodes
    velocity[nodes] = motion.at(model.initial_state())[nodes]
    frames, touched = [[] for _ in rods], []

    def look(run):
        for rod, kept in zip(rods, frames, strict=True):
            kept.append(centreline(model, rod, run.state, 50))
        touched.append(any(told.peak > 0 for told in run.pressed))
        return len(touched) >= most

    for rod, kept in zip(rods, frames, strict=True):
        kept.append(centreline(model, rod, model.initial_state(), 50))
    message = ""
    try:
        duration = 3 * np.linalg.norm(center) / speed
        cf.solve_dynamic(
            model, duration, start="drawn", velocity=velocity, rho_inf=0.9, step=cf.FixedStep(dt), times=[duration],
            callback=look,
        )  # fmt: skip
    except cf.ConvergenceError as error:
        message = str(error)
    return Thrown(passes(target, [np.array(kept) for kept in frames]), len(touched), any(touched), message)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("target", TARGETS)
def test_throws(target, tmp_path, say):
    """Two throws; the rod touches and never passes."""
    thrown = [throw(target, seed, tmp_path, most=80) for seed in range(2)]
    say(
        f"steps {[t.steps for t in thrown]}, touched {sum(t.touched for t in thrown)}, "
        f"stopped {sum(bool(t.message) for t in thrown)}"
    )
    assert not any(t.passes for t in thrown)
    assert all(t.touched for t in thrown)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", [16, 30, 39])
def test_first_step_may_be_long(seed, tmp_path):
    """A rod that would be past the other one, and out of its sight, after its first step."""
    assert throw("rod", seed, tmp_path, most=5).passes == 0


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.slow
def test_throws_end(target, tmp_path):
    """Ten throws come to their end and are not given up."""
    assert [t.message for t in (throw(target, seed, tmp_path) for seed in range(10)) if t.message] == []


@pytest.mark.parametrize("target", TARGETS)
def test_control(target, tmp_path):
    """Without contact the judge catches every throw."""
    for seed in range(10):
        assert throw(target, seed, tmp_path, contact=False).passes > 0, seed


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(BLOCKS))
@pytest.mark.parametrize("target", TARGETS)
def test_thousand_throws(target, block, tmp_path, say):
    """1000 throws up to 100 m/s, a hundred radii in a step; blocks may run side by side."""
    seeds = range(EACH * block, EACH * (block + 1))
    thrown = {seed: throw(target, seed, tmp_path) for seed in seeds}
    stopped = {seed: t.message for seed, t in thrown.items() if t.message}
    say(f"{sum(t.touched for t in thrown.values())} of {EACH} touched, stopped: {sorted(stopped)}")
    assert [seed for seed, t in thrown.items() if t.passes] == []
    assert sum(t.touched for t in thrown.values()) >= 0.9 * EACH


# parts that move


def pushed(target, tmp_path, step, *, friction=0.2, speed=10.0):
    """A free rod, at rest, that a part runs into: frames in the part's place, and how fast the rod flies."""
    moving = part(target, tmp_path)
    moving = cf.Part(moving.name, mesh=moving.mesh, shape=moving.shapes or None, motion=cf.Slider((0, 0, 1), speed))
    rod = cf.Rod(
        "rod", section(np.random.default_rng(5)), [(0.001, -0.015, 0.004), (0.002, 0.015, 0.005)], n_elements=6
    )
    model = cf.Model([rod], [], [cf.PartContact(rod, moving, friction=friction)])
    frames = [centreline(model, rod, model.initial_state(), 50)]

    def look(run):
        frames.append(centreline(model, rod, run.state, 50) - moving.pose(run.state.t)[1])

    history = cf.solve_dynamic(
        model, 1.2e-3, start="drawn", rho_inf=0.9, step=cf.FixedStep(step), times=[1.2e-3], callback=look
    )
    v = (
        model.space.node_mass
        @ history.velocities(rod)[-1][np.argsort(model.space[rod].nodes)][:, 2]
        / model.space.node_mass.sum()
    )
    return passes(target, [np.array(frames)]), v


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "target", [pytest.param("wire", marks=pytest.mark.slow), pytest.param("edge", marks=pytest.mark.slow), "sheet"]
)
def test_part_pushes_in_time(target, tmp_path, say):
    """A part at 10 m/s throws the rod forward, and the rod never passes it; ten radii in a step."""
    passed, v = pushed(target, tmp_path, 1e-3)
    say(f"pushed to {v:.2f} m/s")
    assert passed == 0
    assert v > 2.0


@pytest.mark.filterwarnings("ignore")
def test_part_pushes_in_statics(tmp_path, say):
    """A wire that moves 20 radii in a station lifts a rod clamped at both ends; it is above the wire at each."""
    rod = cf.Rod("rod", section(np.random.default_rng(5)), [(0.0, -0.04, 0.003), (0.001, 0.04, 0.003)], n_elements=9)
    wire = cf.Part("wire", shape=cf.Capsule(*WIRE, RADIUS / 2), motion=cf.Slider((0, 0, 1), 10.0))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.PartContact(rod, wire)])
    history = cf.solve_quasistatic(model, [0.0, 1e-3, 2e-3, 3e-3])
    frames = [centreline(model, rod, r.state, 50) - wire.pose(r.state.t)[1] for r in history.records]
    say(f"iterations {[r.iterations for r in history.records]}")
    assert judge.crossings_segment(np.array(frames), *WIRE) == 0
    heights = np.array(frames)[:, :, 2].max(axis=1)  # above the wire
    assert (heights >= 1.499 * RADIUS).all()
