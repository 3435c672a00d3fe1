"""What does one design give? A run of the changed scene, from the first state of the nearest design that was run.

Rule: a design is a point of the unit cube, one axis for each variable. The first state of a run is found by going from the
nearest design to this one, in as many parts as it takes, so that all designs lie on the branch of equilibria that begins at
the drawn route. A design that has no equilibrium, or none to the end of the stroke, is a trial too: it keeps no limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..accuracy.transfer import Transfer
from ..drive import describe_drive
from ..equilibrium.statics import solve_static
from ..errors import ConvergenceError, SceneError, nearest
from ..history import History
from ..limits.quantities import bend_radius
from ..limits.verdicts import assess, tell
from ..model import Model
from ..scene import Scene
from ..scene.aim import bounds, starting, values
from ..scene.lines import Path
from ..scene.tables import LimitTable
from ..scene.units import measured
from ..solving import solve_scene
from ..space import State
from ..summary import describe, flat, size

SAME = 1e-12  # of a range: designs this close are one
PARTS = 6  # times that the way from the nearest design is halved
PEAKS = {"largest_force": slice(0, 3), "largest_moment": slice(3, 6)}
STRAIGHT = 1e6  # m: a rod with this bend radius is straight
FAILED = -1.0  # margin of a design without results, in parts of the limit


@dataclass(frozen=True, eq=False)
class Limit:
    """A bound on a result; `margin` is its distance from it in parts of the bound, negative where it is broken."""

    result: str
    bound: float
    most: bool
    check: str = ""  # the name of a check of the scene, which knows its own bound

    def margin(self, value: float) -> float:
        """Signed distance of a value from the bound."""
        away = self.bound - value if self.most else value - self.bound
        return float(np.clip(away / (abs(self.bound) or 1.0), -1e6, 1e6))

    def __str__(self) -> str:
        if self.check:
            return f"check {self.check!r}"
        return f"{self.result} {'<=' if self.most else '>='} {self.bound:g}"


def limits_of(tables: list[LimitTable]) -> list[Limit]:
    """Bounds of a design, one for each `least` and `most`."""
    return [
        Limit(table.result, measured(bound)[0], most)
        for table in tables
        for bound, most in ((table.least, False), (table.most, True))
        if bound is not None
    ]


@dataclass(frozen=True, eq=False)
class Trial:
    """One design that was run: its point of the cube, changed values, results by dotted path and margins of the limits.

    pieces: what the objective is the largest of, such as the torque at each station, each smooth over the designs;
    margin_pieces: what the margins are the least of.
    """

    number: int
    u: np.ndarray
    changes: dict[str, Any]
    reason: str = ""
    results: dict[str, Any] = field(default_factory=dict)
    margins: tuple[float, ...] = ()
    objective: float = np.inf
    warnings: tuple[str, ...] = ()
    pieces: np.ndarray = field(default_factory=lambda: np.full(1, np.inf))
    margin_pieces: np.ndarray = field(default_factory=lambda: np.zeros(0))
    first: tuple[Model, State] | None = None
    reserve: float = 0.0

    @property
    def feasible(self) -> bool:
        """True if it ran to the end and keeps all limits with the margin asked for."""
        return not self.reason and self.margin >= 0.0

    @property
    def margin(self) -> float:
        """The least margin less what is asked for; 0 without limits."""
        return min(self.margins, default=self.reserve) - self.reserve if not self.reason else FAILED


@dataclass(frozen=True, eq=False)
class _End:
    """What a design gives at one end of its stiffness."""

    results: dict[str, float]
    margins: tuple[float, ...]
    objective: float
    pieces: np.ndarray
    held: np.ndarray
    first: tuple[Model, State] | None


class OutOfRuns(Exception):
    """As many designs were run as the scene allows, or the user stopped the search."""


class Trials:
    """All designs that were run, each once."""

    def __init__(self, scene: Scene, progress: Callable[[int, int], bool | None] | None = None) -> None:
        if scene.tables.design is None:
            raise SceneError(f"{scene.source.path}: has no [design] that says what to choose.")
        self.scene, self.design, self.progress = scene, scene.tables.design, progress
        self.limits = limits_of(self.design.limits)
        self._given = len(self.limits)
        self.limits += [Limit(f"checks.{check.name}.worst.value", np.nan, False, check.name) for check in scene.checks]
        self.low, self.high = bounds(self.design).T
        self.done: list[Trial] = []
        self.iterations = 0
        named = [self.design.minimise, *(limit.result for limit in self.design.limits), *(self.design.tradeoff or ())]
        self._parts = scene.parts if any(name.startswith("clearances.") for name in named) else ()

    def start(self) -> np.ndarray:
        """The scene as it is, in the cube; the middle where it says nothing, the nearest end where it lies outside."""
        x = starting(self.scene.source, self.scene.model, self.design)
        return np.clip(np.nan_to_num((x - self.low) / (self.high - self.low), nan=0.5), 0.0, 1.0)

    def x(self, u: np.ndarray) -> np.ndarray:
        """Values in SI of a point of the cube."""
        return self.low + np.asarray(u) * (self.high - self.low)

    def changes(self, u: np.ndarray) -> dict[str, Any]:
        """Changed values of the scene at a point of the cube."""
        return values(self.scene.source, self.scene.model, self.design, self.x(u))

    def __call__(self, u: np.ndarray) -> Trial:
        """The trial at a point of the cube; run if it is a new one. OutOfRuns if there may be no more."""
        u = np.clip(np.asarray(u, dtype=float).ravel(), 0.0, 1.0)
        for trial in self.done:
            if np.abs(trial.u - u).max() <= SAME:
                return trial
        if len(self.done) >= self.design.runs:
            raise OutOfRuns
        trial = self._run(u)
        self.done.append(trial)
        if self.progress is not None and self.progress(len(self.done), self.design.runs):
            raise OutOfRuns
        return trial

    def _run(self, u: np.ndarray) -> Trial:
        number, changes = len(self.done), self.changes(u)
        try:
            scene = self.scene.changed(changes)
            ends = [scene, *([scene.sticking()] if scene.banded else ())]
            start = self._first(scene.model, u, PARTS)
            found = [self._end(end, changes, start, scene.model) for end in ends]
        except NamesError:
            raise
        except (SceneError, ConvergenceError) as error:
            return Trial(number, u, changes, str(error).splitlines()[0], reserve=self.design.margin)
        results = dict(found[0].results)
        worst = [found[int(np.argmin([end.margins[k] for end in found]))] for k in range(len(self.limits))]
        for limit, end in zip(self.limits, worst, strict=True):
            results[limit.result] = end.results.get(limit.result, np.inf)
        highest = max(found, key=lambda end: end.objective)
        results[self.design.minimise] = highest.objective
        return Trial(
            number, u, changes, "", results, tuple(end.margins[k] for k, end in enumerate(worst)), highest.objective,
            tuple(scene.model.warnings), np.concatenate([end.pieces for end in found]),
            np.concatenate([end.held for end in found]), found[0].first, self.design.margin,
        )  # fmt: skip

    def _end(self, scene: Scene, changes: dict[str, Any], start: State | None, of: Model) -> _End:
        """Results, margins and objective of a scene at one end of its stiffness; start: a state of the model `of`."""
        if start is not None and scene.model is not of:
            start = Transfer(of, scene.model).state(start)
        history = solve_scene(scene, start)
        if history.status == "stopped":  # by Ctrl-C
            raise OutOfRuns
        self.iterations += history.counters.iterations
        said = describe(history, self._parts)
        for drive in scene.drives:
            said["hinges"][drive.part.name]["drive"] = describe_drive(history, drive)
        verdicts = assess(history, scene.checks, scene.parts)
        told = flat(said | tell(verdicts)) | changes
        results = {path: size(path, value) for path, value in told.items() if _is_number(value)}
        self._check_names(results, said)
        at = np.linspace(history.order[0], history.order[-1], len(scene.times))
        margins, held = [], []
        for limit in self.limits[: self._given]:
            margins.append(limit.margin(_value(results, limit.result)))
            held += [margins[-1], *(limit.margin(x) for x in series(history, limit.result, at))]
        for verdict in verdicts:
            unknown = verdict.status == "UNKNOWN" or not np.isfinite(verdict.margin)
            margins.append(min(verdict.margin, FAILED) if unknown else verdict.margin)
            course = np.where(np.isfinite(verdict.course.margin), verdict.course.margin, FAILED)
            held += [margins[-1], *np.interp(at, history.order, course)]
        objective = _value(results, self.design.minimise)
        first = None if scene.model.contacts else (history.model, history.records[0].state)
        pieces = np.array([objective, *series(history, self.design.minimise, at)])
        return _End(results, tuple(margins), objective, pieces, np.array(held) - self.design.margin, first)

    def _first(self, model: Model, u: np.ndarray, parts: int) -> State | None:
        """First state of a design, from that of the nearest one; None: from the drawn route."""
        known = [trial for trial in self.done if trial.first is not None]
        if not known or model.contacts:
            return None
        near = min(known, key=lambda trial: float(np.linalg.norm(trial.u - u)))
        old, state = near.first  # type: ignore[misc]
        return self._between(old, state, near.u, model, u, parts)

    def _between(self, old: Model, state: State, at: np.ndarray, model: Model, u: np.ndarray, parts: int) -> State:
        """First state of a design from that of another; half-way designs between them if there is no direct way."""
        try:
            found = solve_static(model, t=float(self.scene.times[0]), start=Transfer(old, model).state(state))
        except ConvergenceError:
            if parts == 0:
                raise
        else:
            self.iterations += found.counters.iterations
            if found.stable[0] is not False or parts == 0:
                return found.final
        middle = 0.5 * (at + u)
        half = self.scene.changed(self.changes(middle)).model
        there = self._between(old, state, at, half, middle, parts - 1)
        return self._between(half, there, middle, model, u, parts - 1)

    def _check_names(self, results: Mapping[str, Any], said: dict[str, Any]) -> None:
        """SceneError if something that the design names is not among the results."""
        faults = []
        named: list[tuple[Path, str]] = [(("design", "minimise"), self.design.minimise)]
        named += [(("design", "limits", k, "result"), limit.result) for k, limit in enumerate(self.design.limits)]
        named += [(("design", "tradeoff", k), name) for k, name in enumerate(self.design.tradeoff or ())]
        for path, name in named:
            if name not in results and not _is_none(said, name):
                faults.append(self.scene.source.fault(path, f"no result is called {name!r}. {nearest(name, results)}"))
        if faults:
            raise NamesError(faults)


class NamesError(SceneError):
    """A design names results that its runs do not have."""


def series(history: History, name: str, at: np.ndarray) -> np.ndarray:
    """Values whose largest (of a bend radius: least) is a result, at places `at` of the course of states; none of a result
    that is no such peak. As many for each design, whichever states its run has."""

    def moved(values: np.ndarray) -> np.ndarray:
        return np.interp(at, history.order, values)

    table, _, rest = name.partition(".")
    owner, _, peak = rest.removesuffix(".value").rpartition(".")
    if table == "hinges" and peak == "largest_torque":
        torque = moved(history.hinge_torque(owner))
        return np.concatenate([torque, -torque])
    if table == "reactions" and peak in PEAKS:
        load = history.reaction(next(h for h in history.model.supports if h.name == owner))
        return moved(np.linalg.norm(load[:, PEAKS[peak]], axis=1))
    if table == "rods" and peak == "smallest_bend_radius":
        return moved(np.minimum(bend_radius(history, owner, at="nodes").min(axis=1), STRAIGHT))
    return np.zeros(0)


def _is_none(said: Any, name: str) -> bool:
    """True if a result is not there because its table says so: a straight rod has no smallest bend radius."""
    for word in name.split("."):
        if not isinstance(said, dict) or word not in said:
            return False
        said = said[word]
        if said is None:
            return True
    return False


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _value(results: Mapping[str, Any], name: str) -> float:
    """A result; infinite where its table says there is none."""
    return float(results.get(name, np.inf))
