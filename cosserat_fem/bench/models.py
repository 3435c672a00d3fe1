"""How do we solve them? Models of the problems in this package, what is observed, and the resolutions that are measured.

Rule: a solver is a function of a `Case`; building is apart from solving, so that only the solve call is timed. Planar
problems run on the planar element where the model has one (`PLANES`), and once more in space.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..equilibrium.statics import solve_quasistatic, solve_static
from ..history import History
from ..mechanism import Hinge, Part, Slider
from ..model import Model
from ..motion.dynamics import solve_dynamic
from ..motion.steps import FixedStep
from ..rod import Rod
from ..scene import load_scene
from ..section import Section
from ..shapes import Cylinder
from ..support import Clamp, Pin
from ..terms import Gravity, PartContact, PointLoad
from . import problems as p
from .problems import PROBLEMS, Beam

PLANAR = "plane" in inspect.signature(Model).parameters
PLANES: tuple[str | None, ...] = ("xy", None) if PLANAR else (None,)  # of planar problems


@dataclass(frozen=True)
class Case:
    """One resolution: elements, order, step of a run in time, and "xy" for a planar model."""

    n_elements: int
    order: int
    step: FixedStep | None = None
    plane: str | None = None

    @property
    def method(self) -> str:
        """Element and order, in words."""
        kind = "planar" if self.plane else "in space"
        extrapolated = ", extrapolated" if self.step is not None and self.step.richardson else ""
        return f"order {self.order} {kind}{extrapolated}"

    @property
    def resolution(self) -> str:
        """Elements and step, in words."""
        return f"n={self.n_elements}" + (f", dt={self.step.dt:.4g}" if self.step is not None else "")


@dataclass(frozen=True)
class Solver:
    """How a problem is solved here.

    build : Case -> Model;  solve : (Model, Case) -> History;  observe : History -> what `Problem.error` takes
    """

    build: Callable[[Case], Model]
    solve: Callable[[Model, Case], History]
    observe: Callable[[History], Any]
    cases: tuple[Case, ...]


def _model(case: Case, rods: Iterable[Rod], supports: Iterable[Any], terms: Iterable[Any] = ()) -> Model:
    plane: dict[str, Any] = {"plane": case.plane} if case.plane else {}
    return Model(list(rods), list(supports), list(terms), **plane)


def section(beam: Beam) -> Section:
    """The section of a beam."""
    about, across = beam.inertia
    return Section(
        force_stiffness=(beam.GA, beam.GA, beam.EA), moment_stiffness=(beam.EI, beam.EI, beam.GJ),
        mass_per_length=beam.mass, rotary_inertia=(across, across, about),
    )  # fmt: skip


def _rod(beam: Beam, points: Any, case: Case, **options: Any) -> Rod:
    return Rod("rod", section(beam), points, n_elements=case.n_elements, order=case.order, **options)


def _static(model: Model, _: Case) -> History:
    return solve_static(model)


def _tip(history: History) -> np.ndarray:
    return history.positions("rod")[-1, -1]


def roll_up(case: Case) -> Model:
    """S1."""
    rod = _rod(p.ROLL_UP, [(0, 0, 0), (p.ROLL_UP.length, 0, 0)], case)
    return _model(case, [rod], [Clamp(rod, "start")], [PointLoad(rod, "end", moment=(0, 0, p.ROLL_UP_COUPLE))])


def bend(case: Case) -> Model:
    """S2."""
    points, angle = p.bend_arc(np.linspace(0, p.BEND.length, 100))
    end = (np.cos(angle[-1]), np.sin(angle[-1]), 0)
    rod = _rod(
        p.BEND, points, case, rest=(1 / p.BEND_RADIUS, 0, 0), length=p.BEND.length,
        start_tangent=(1, 0, 0), end_tangent=end, normal=(0, 0, 1),
    )  # fmt: skip
    return _model(case, [rod], [Clamp(rod, "start")], [PointLoad(rod, "end", force=p.BEND_FORCE)])


def slack_cable(case: Case) -> Model:
    """S3, from the guess that every solver may start from."""
    guess, _ = p.slack_guess(np.linspace(0, p.SLACK.length, 41))
    points = np.column_stack([guess, 0 * guess[:, 0]])
    rod = _rod(
        p.SLACK, points, case, length=p.SLACK.length, start_tangent=(1, 0, 0), end_tangent=(1, 0, 0)
    )  # fmt: skip
    supports = [Clamp(rod, "start"), Clamp(rod, "end")]
    return _model(case, [rod], supports, [Gravity((0, -p.SLACK_GRAVITY, 0))])


def elastica(case: Case) -> Model:
    """S4."""
    rod = _rod(p.ELASTICA, [(0, 0, 0), (p.ELASTICA.length, 0, 0)], case)
    return _model(case, [rod], [Clamp(rod, "start")], [PointLoad(rod, "end", force=p.ELASTICA_FORCE)])


def spaghetti(case: Case) -> Model:
    """D1."""
    rod = _rod(p.SPAGHETTI, p.SPAGHETTI_ENDS, case, normal=(0, 0, 1))
    times, size = p.SPAGHETTI_KNOTS

    def over_time(direction: Any) -> tuple[Any, np.ndarray]:
        return times, np.outer(size, direction)

    load = PointLoad(rod, "start", force=over_time(p.SPAGHETTI_FORCE), moment=over_time(p.SPAGHETTI_COUPLE))
    return _model(case, [rod], [], [load])


def pendulum(case: Case) -> Model:
    """D2."""
    rod = _rod(p.PENDULUM, [(0, 0, 0), (p.PENDULUM.length, 0, 0)], case)
    return _model(case, [rod], [Pin(rod, "start")], [Gravity((0, -p.PENDULUM_GRAVITY, 0))])


def _in_time(name: str) -> Callable[[Model, Case], History]:
    times = np.asarray(PROBLEMS[name].times)

    def solve(model: Model, case: Case) -> History:
        return solve_dynamic(model, times[-1], start="drawn", step=case.step, times=times)

    return solve


def follow(case: Case) -> Model:
    """D3, without inertia: it follows slowly."""
    rod = _rod(p.FOLLOW, [(0, 0, 0), (p.FOLLOW.length, 0, 0)], case)
    arm = Part("arm", motion=Hinge((p.FOLLOW_PIVOT, 0, 0), (0, 0, 1), p.FOLLOW_RATE))
    return _model(case, [rod], [Clamp(rod, "start"), Clamp(rod, "end", to=arm)])


def deployment(case: Case) -> Model:
    """B03: the shipped scene on other elements."""
    shipped = load_scene(None).model
    (drawn,) = shipped.rods
    rod = Rod(
        "rod", drawn.section, drawn.points, n_elements=case.n_elements, order=case.order, length=drawn.length,
        layer=drawn.layer, start_tangent=drawn.start_tangent, end_tangent=drawn.end_tangent,
    )  # fmt: skip
    return _model(case, [rod], [Clamp(rod, s.at, s.to, name=s.name) for s in shipped.supports])


def _deployment_loads(history: History) -> np.ndarray:
    a, b = history.reaction("fixed end"), history.reaction("moving end")
    return np.stack([a[:, 0], a[:, 1], np.linalg.norm(a[:, :3], axis=1), a[:, 5], b[:, 5]], axis=1)


def capstan(case: Case) -> Model:
    """C1: elements are about as long in the free spans as on the drum."""
    r, turn = p.DRUM_RADIUS + p.DRUM_ROPE + 1e-5 * p.DRUM_ROPE, p.DRUM_TURN
    bending = p.DRUM_TENSION * (0.01 * p.DRUM_RADIUS) ** 2  # so thin that it hugs the drum
    cable = Section(
        force_stiffness=3 * (1e5,), moment_stiffness=3 * (bending,), mass_per_length=0.01, radius=p.DRUM_ROPE
    )
    angle = np.linspace(0, turn, 8 * case.n_elements)
    arc = r * np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    out = np.array([np.sin(turn), np.cos(turn), 0.0])
    span = np.linspace(-p.DRUM_FREE, -0.005, 12)[:, None]
    points = np.concatenate([arc[0] + span * [0, 1, 0], arc, arc[-1] - span[::-1] * out])
    rod = Rod("rod", cable, points, n_elements=case.n_elements, order=case.order)
    drum = Part("drum", shape=Cylinder((0, 0, -0.05), (0, 0, 0.05), p.DRUM_RADIUS))
    puller = Part("puller", motion=Slider(tuple(out), 1.0))
    load = PointLoad(rod, "start", force=(0, -p.DRUM_TENSION, 0))
    contact = PartContact(rod, drum, friction=p.DRUM_FRICTION, pressure=p.DRUM_TENSION / p.DRUM_RADIUS)
    return _model(case, [rod], [Pin(rod, "end", to=puller)], [contact, load])


def _pull(model: Model, _: Case) -> History:
    """Half the rope's radius a station: it slips everywhere after the first ones."""
    return solve_quasistatic(model, 0.5 * p.DRUM_ROPE * np.arange(6.0))


def _tension_exponent(history: History) -> float:
    """Slope of log T over the angle, along the middle four fifths of the wrap."""
    s, (x, y) = history.stations("rod"), history.positions("rod")[-1, :, :2].T
    nodes = history.nodes("rod")
    angle = np.unwrap(np.arctan2(np.interp(s, nodes, y), -np.interp(s, nodes, x)))
    free = (s < p.DRUM_FREE) | (s > nodes[-1] - p.DRUM_FREE)
    inside = (angle > 0.1 * p.DRUM_TURN) & (angle < 0.9 * p.DRUM_TURN) & ~free
    tension = history.section_forces("rod")[-1, inside, 2]
    return float(np.polyfit(angle[inside], np.log(tension), 1)[0])


def _travel(model: Model, _: Case) -> History:
    return solve_quasistatic(model, np.arange(91.0))


def _ladder(planar: bool, meshes: Mapping[int, Iterable[int]]) -> tuple[Case, ...]:
    """Cases of each order: on the planar element if there is one, and in space."""
    planes = PLANES if planar else (None,)
    return tuple(Case(n, order, plane=plane) for plane in planes for order, ns in meshes.items() for n in ns)


def _over_time(planar: bool, runs: Mapping[int, Iterable[tuple[int, float, bool]]]) -> tuple[Case, ...]:
    """As `_ladder`, of (elements, step [s], extrapolated)."""
    planes = PLANES if planar else (None,)
    return tuple(
        Case(n, order, FixedStep(dt, extrapolated), plane)
        for plane in planes
        for order, settings in runs.items()
        for n, dt, extrapolated in settings
    )


STATIC = {1: (8, 16, 32, 64, 128, 256), 2: (4, 8, 16, 32, 64), 3: (2, 4, 6, 8, 12, 16, 24), 4: (2, 3, 4, 6, 8, 12, 16)}

SOLVERS = {
    "S1": Solver(roll_up, _static, _tip, _ladder(True, STATIC)),
    "S2": Solver(bend, _static, _tip, _ladder(False, STATIC)),
    "S3": Solver(
        slack_cable, _static, lambda h: (h.nodes("rod"), h.positions("rod")[-1]), _ladder(True, STATIC)
    ),
    "S4": Solver(elastica, _static, _tip, _ladder(True, STATIC)),
    "D1": Solver(
        spaghetti, _in_time("D1"), lambda h: h.positions("rod")[:, [0, -1]],
        _over_time(False, {
            1: [(8, 0.1, False), (16, 0.05, False), (32, 0.02, False)],
            2: [(4, 0.1, False), (8, 0.05, False), (6, 0.1, True), (8, 0.05, True), (12, 0.02, True)],
            3: [(3, 0.1, False), (3, 0.1, True), (4, 0.1, True), (4, 0.05, True), (6, 0.025, True), (8, 0.02, True)],
            4: [(2, 0.1, True), (3, 0.1, True), (3, 0.05, True), (4, 0.05, True), (6, 0.02, True)],
        }),
    ),
    "D2": Solver(
        pendulum, _in_time("D2"), lambda h: h.positions("rod")[:, -1],
        _over_time(True, {
            1: [(16, 0.005, False), (32, 0.005, False)],
            2: [(6, 0.005, False), (6, 1 / 300, False), (8, 1 / 300, False), (12, 1 / 300, True), (16, 0.0025, True)],
            3: [(4, 0.01, False), (5, 0.005, False), (5, 1 / 300, False), (8, 1 / 300, True), (12, 0.0025, True)],
            4: [(3, 1 / 300, False), (4, 1 / 300, False), (5, 1 / 300, True), (6, 1 / 300, True), (12, 0.00125, True)],
        }),
    ),
    "D3": Solver(
        follow, _travel, lambda h: h.reaction("rod.end@arm")[:, [0, 1, 5]],
        _ladder(True, {1: (8, 16, 32, 64), 2: (4, 8, 16, 32), 3: (2, 3, 4, 6, 8, 12), 4: (2, 3, 4, 6, 8)}),
    ),
    "B03": Solver(
        deployment, _travel, _deployment_loads,
        _ladder(True, {1: (16, 32, 64, 128), 2: (8, 16, 32, 64), 3: (8, 12, 16, 24, 48), 4: (6, 8, 12, 16, 24)}),
    ),
    "C1": Solver(
        capstan, _pull, _tension_exponent,
        _ladder(False, {1: (54, 80), 2: (27, 54), 3: (27, 54), 4: (16, 24, 32)}),
    ),
}  # fmt: skip
