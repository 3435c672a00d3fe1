"""Which stations does a travel need? Those that were asked for, and what lies between them.

Rule: never step over a peak unseen. Between asked stations states are looked at, so close together that no part turns by
more than `Resolution.turn` (or moves its rods by as much in rod lengths). Numbers are watched on the way: where the curve of
one bends too much for a straight line between two states the step is halved, and where one has its largest or smallest
value so far on this way the march goes back and finds the place with Brent's method. Friction depends on the path, so from
an inserted station the march goes on anew; without friction what was found beyond it is kept. In the end those states stay
that were asked for, that are peaks, or that a straight line between their neighbours would miss.

Time goes on here also where parts and loads go back: `Clock` says for which time of the way out they stand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import ceil
from typing import Any, Literal

import numpy as np
from scipy.optimize import brent

from ..errors import ConvergenceError, check_positive
from ..history import History
from ..mechanism import Hinge, Part
from ..model import Model
from ..record import CriticalPoint, Record
from ..rod import Rod

HALVINGS = 3  # of a step where a curve bends
DROP = 1e-3  # of the largest value: a peak is one when a curve has come down so far from it
NOISE = 1e-5  # the same at the end of a way, where no more comes, and on the side where it came from
ROWS = 8  # of a table, for each look: if there are more, looks are enough
TRIES = 20  # states looked at for a peak
UNSEEN, NONE = np.empty(0), np.empty(0, dtype=int)
SMALL = 0.1  # of bending stiffness over length (squared): forces and moments of interest are not all smaller


@dataclass(frozen=True, eq=False)
class Watch:
    """A number to resolve between stations.

    Parameters
    ----------
    name : str
    value : function History -> (T,)
        What it is at each state, such as ``lambda history: bend_radius(history, "cable").min(axis=1)``. It is asked of
        histories of one state; values that are not finite are passed over.
    peaks : "largest", "smallest", "both" or "none"
        Which of its extremes are located.
    least : float
        Changes are judged in parts of the largest absolute value so far, but of no less than this.
    like : str
        Numbers that have this in common, such as components of a vector, are judged by the largest of them all.
    """

    name: str
    value: Callable[[History], np.ndarray]
    peaks: Literal["largest", "smallest", "both", "none"] = "both"
    least: float = 0.0
    like: str = ""

    def __post_init__(self) -> None:
        if self.peaks not in ("largest", "smallest", "both", "none"):
            raise ValueError(
                f"watch {self.name!r}: peaks must be 'largest', 'smallest', 'both' or 'none' (got {self.peaks!r})."
            )


@dataclass(frozen=True)
class Resolution:
    """How finely a travel looks between asked stations.

    Parameters
    ----------
    turn : float [rad]
        Largest turn of a part between states that are looked at; default half a degree.
    bend : float
        How far a straight line between two states may be off, in parts of the largest value so far.
    peak : float
        How exactly peaks are located, in parts of the distance of the states on both sides.
    watch : sequence of Watch
        Numbers to resolve besides hinge torques, reactions, contact forces and curvatures (see `watched`).
    parts : sequence of Part
        Whose motions count besides those of the model, as what is watched may depend on them.
    """

    turn: float = np.pi / 360.0
    bend: float = 2e-3
    peak: float = 2e-3
    watch: Sequence[Watch] = ()
    parts: Sequence[Part] = ()

    def __post_init__(self) -> None:
        for name in ("turn", "bend", "peak"):
            check_positive(f"resolution: {name}", getattr(self, name))
        if self.peak >= 1.0:
            raise ValueError(f"resolution: peak must be below 1 (got {self.peak:g}).")
        if not all(isinstance(entry, Watch) for entry in self.watch):
            raise ValueError("resolution: watch must be a list of Watch.")


def watched(model: Model) -> list[Watch]:
    """What is watched in any model: torque of each hinge, force and moment of each support, force of each contact with a
    part, curvature of each rod."""
    force = SMALL * model.scales["bending"] / model.scales["length"] ** 2
    moment = force * model.scales["length"]
    found = [
        Watch(f"torque of {part.name}", partial(History.hinge_torque, part=part), least=moment)
        for part in model.parts
        if isinstance(part.motion, Hinge)
    ]
    for support in model.supports:
        for k, (what, least) in enumerate((("force", force), ("moment", moment))):
            value = partial(_size, support=support, which=slice(3 * k, 3 * k + 3))
            found.append(Watch(f"{what} of {support.name}", value, "largest", least))
    for k, term in enumerate(model.contacts):
        if hasattr(term, "part"):
            name = f"force of {term.name}"
            found.append(Watch(name, partial(_pressing, k=k), "largest", force, name))
            for i in range(3):  # friction turns over while the size of the force hardly changes
                found.append(Watch(name, partial(_pressing, k=k, component=i), "none", force, name))
    for rod in model.rods:
        found.append(Watch(f"curvature of {rod.name}", partial(_curvature, rod=rod), "largest", SMALL / rod.length))
    return found


def _size(history: History, support: Any, which: slice) -> np.ndarray:
    """Force [N] or moment [N m] (T,) of a support."""
    return np.linalg.norm(history.reaction(support)[:, which], axis=1)


def _pressing(history: History, k: int, component: int | None = None) -> np.ndarray:
    """Force (T,) [N] of rods on the part that one contact term speaks of, or one component of it."""
    load = np.array([record.contact[k].load[:3] for record in history.records])
    return np.linalg.norm(load, axis=1) if component is None else load[:, component]


def _curvature(history: History, rod: Rod) -> np.ndarray:
    """Largest curvature (T,) [1/m] of a centreline: one over its smallest bend radius."""
    strain = history.at_nodes(rod, history.total_strains(rod))
    return (np.hypot(strain[..., 3], strain[..., 4]) / np.linalg.norm(strain[..., :3], axis=-1)).max(axis=1)


@dataclass(frozen=True)
class Clock:
    """For which time parts and loads stand: the time itself, and after `turn` [s] as much before it."""

    turn: float = np.inf

    def at(self, t: float) -> float:
        """Time [s] of the way out."""
        return t if t <= self.turn else 2.0 * self.turn - t

    def back(self, t: float) -> bool:
        """True on the way back."""
        return t > self.turn


@dataclass(eq=False)
class Look:
    """A state of the march: values (K,) of what is watched, and for each the numbers of the states where it was highest and
    lowest since it turned, with what is sought next: 1 a highest, -1 a lowest, 0 either."""

    t: float
    values: np.ndarray
    high: np.ndarray
    low: np.ndarray
    seek: np.ndarray


Step = Callable[[History, float, bool], Record]


class March:
    """Stations of one travel, in order of time.

    Parameters
    ----------
    history : History
        Holds the first state; gets the others.
    times : (T,) [s]
        Asked stations, going on where the travel goes back.
    clock : Clock
    step : function (history, t, tried) -> Record
        The state at time t, from the last one of a history; limit points on the way go into that history. tried: it is for
        a look only, and nobody asks for limit points.
    resolution : Resolution, optional
        Without it only asked stations are found.
    """

    def __init__(
        self, history: History, times: np.ndarray, clock: Clock, step: Step, resolution: Resolution | None
    ) -> None:
        self.history, self.times, self.clock, self.step, self.resolution = history, times, clock, step, resolution
        self.watch: list[Watch] = []
        if resolution is not None:
            self.watch = [*watched(history.model), *resolution.watch]
        self.depends = any(getattr(term, "friction", 0.0) > 0.0 for term in history.model.contacts)  # on the path
        self.chain: list[Look] = []  # of the history's records, one each
        self.first = 0  # number of the state where this way began
        self.largest = np.array([watch.least for watch in self.watch])
        likes = [watch.like for watch in self.watch]
        self.alike = [[k for k, other in enumerate(likes) if other == like] for like in sorted({*likes} - {""})]
        self.peaks: set[float] = set()
        self.mirrored: set[float] = set()  # stations of the way back that those of the way out ask for
        self.resolved: list[tuple[int, float, float]] = []  # what, from, to: a peak was located there
        self.known: dict[float, tuple[int, Record]] = {}  # states found ahead, each from the first so many of the march
        self.tried: dict[float, Record] = {}  # states found for a look
        self.parts = [*history.model.parts, *(resolution.parts if resolution is not None else ())]
        self.rows = self._rows()
        self.middle = history.model.initial_state().r.mean(axis=0)
        self._told: tuple[Record | None, np.ndarray] = (None, np.empty(0))

    def run(self, callback: Callable[[int, Record], bool | None]) -> bool:
        """Go through all asked stations; True if the callback (number, record) stopped it at one."""
        try:
            self._append(self.history.records[0])
            if callback(0, self.history.records[0]):
                return True
            told = 1
            while told < len(self.times):
                goal = float(self.times[told])
                if self.times[told - 1] == self.clock.turn:
                    self._turn_back()
                self._go(goal)
                told += 1
                if callback(told - 1, self.history.records[-1]):
                    return True
        except ConvergenceError as error:
            if error.history is not None:
                self.history.status, self.history.message = error.history.status, error.history.message
            error.history = self.history
            raise
        finally:
            self._thin()
        return False

    def _rows(self) -> np.ndarray:
        """Times of the rows of tables of motions and loads: a pulse that is shorter than a step shows there."""
        motions = [part.motion for part in self.parts if part.motion is not None]
        schedules = [getattr(motion, "schedule", None) for motion in motions]
        tables = [m.kinks if s is None or s.times is None else s.times for m, s in zip(motions, schedules, strict=True)]
        tables += [term.kinks for term in self.history.model.terms if hasattr(term, "kinks")]
        rows = np.unique(np.concatenate([np.empty(0), *tables]))
        if not np.isfinite(self.clock.turn):
            return rows
        rows = rows[rows <= self.clock.turn]
        return np.unique(np.concatenate([rows, 2.0 * self.clock.turn - rows]))

    def _turn_back(self) -> None:
        """Extremes of the way back are its own; it goes through the stations that the way out needed."""
        self.mirrored = {2.0 * self.clock.turn - self.chain[k].t for k in self._needed()} - set(self.times.tolist())
        self.first, k = len(self.chain) - 1, len(self.watch)
        self.chain[-1] = replace(
            self.chain[-1], high=np.full(k, self.first), low=np.full(k, self.first), seek=np.zeros(k, dtype=int)
        )

    def _go(self, goal: float) -> None:
        """March to a station, with a look at what lies between."""
        begin = self.history.records[-1].t
        if self.resolution is None:
            self._append(*self._reach(goal))
            return
        n = max(1, ceil(self._moved(begin, goal) / self.resolution.turn * (1.0 - 1e-9)))
        shortest = (goal - begin) / n * 0.5**HALVINGS
        rows = self.rows[(self.rows > begin) & (self.rows < goal)].tolist()
        rows = rows if len(rows) <= ROWS * n else []  # a finely sampled motion has no pulse between two looks
        passed = {t for t in (*self.mirrored, *rows) if begin < t < goal}
        between = np.linspace(begin, goal, n + 1)[1:-1].tolist()
        targets = sorted({t for t in between if all(abs(t - s) > shortest for s in passed)} | passed) + [goal]
        while targets:
            record, events = self._reach(targets[0])
            length = record.t - self.history.records[-1].t
            if length > 1.5 * shortest and not events and self._bends(record):
                self.known[record.t] = len(self.chain), record
                targets.insert(0, record.t - 0.5 * length)
                continue
            self._append(record, events)
            targets.pop(0)
            ends = not targets and goal in (self.clock.turn, self.times[-1])
            for what, k in self._turned(NOISE if ends else DROP):
                found = self._locate(what, k)
                if found is not None:
                    later = [look.t for look in self.chain if look.t > found]
                    self._back_to(found)
                    targets = [found, *later, *targets]
                    break

    def _reach(self, t: float) -> tuple[Record, list[CriticalPoint]]:
        """The state at time t, from the last one of the march, and limit points on the way."""
        if t in self.known:
            n, record = self.known.pop(t)
            if not self.depends or n == len(self.chain):
                return record, []
        return self._from(self.history.records, t)

    def _from(self, records: list[Record], t: float, tried: bool = False) -> tuple[Record, list[CriticalPoint]]:
        """The state at time t, from the last of some records."""
        history = History(self.history.model, list(records))
        record = self.step(history, t, tried)
        return record, history.critical

    def _moved(self, a: float, b: float) -> float:
        """Largest turn of a part [rad] from one time to another, or displacement of rods with it in rod lengths."""
        model, most = self.history.model, 0.0
        for part in self.parts:
            if part.motion is None:
                continue
            begin, end = self.clock.at(a), self.clock.at(b)
            stops = np.linspace(begin, end, 2 + 4 * part.stages(begin, end))
            poses, turn, shift = [part.pose(t) for t in stops.tolist()], 0.0, 0.0
            for (R, c), (S, d) in pairwise(poses):
                turn += float(np.arcsin(min(1.0, np.linalg.norm(S - R) / np.sqrt(8.0)))) * 2.0
                shift += float(np.linalg.norm((S - R) @ self.middle + d - c))
            most = max(most, turn, shift / model.scales["length"])
        return most

    def _values(self, record: Record) -> np.ndarray:
        """What is watched (K,), at one state."""
        if self._told[0] is not record:
            one = History(self.history.model, [record])
            values = np.array([float(np.asarray(watch.value(one))[0]) for watch in self.watch])
            self._told = record, np.where(np.isfinite(values), values, np.nan)
        return self._told[1]

    def _bends(self, record: Record) -> bool:
        """True if the line from the last state to this one is too far from the curve through the last three."""
        if len(self.chain) - self.first < 2:
            return False
        (a, b), values = self.chain[-2:], self._values(record)
        h, step = b.t - a.t, record.t - b.t
        second = 2.0 * ((values - b.values) / step - (b.values - a.values) / h) / (h + step)
        off = np.abs(second) * step * step / 8.0
        return bool((off > self.resolution.bend * np.fmax(self.largest, np.abs(values))).any())  # type: ignore[union-attr]

    def _append(self, record: Record, events: Sequence[CriticalPoint] = ()) -> None:
        """Take a state into the march; the first one is in the history already."""
        if self.resolution is None:
            if self.chain:
                self.history.critical += [replace(event, station=len(self.chain) - 1) for event in events]
                self.history.records.append(record)
            self.chain.append(Look(record.t, UNSEEN, NONE, NONE, NONE))
            return
        if not self.chain:
            zero = np.zeros(len(self.watch), dtype=int)
            self.chain.append(Look(record.t, self._values(record), zero, zero, zero))
        else:
            last, n, values = self.chain[-1], len(self.chain), self._values(record)
            high = np.where(values <= self._at(last.high), last.high, n)
            low = np.where(values >= self._at(last.low), last.low, n)
            self.history.critical += [replace(event, station=n - 1) for event in events]
            self.history.records.append(record)
            self.chain.append(Look(record.t, values, high, low, last.seek))
        self.largest = np.fmax(self.largest, np.abs(self.chain[-1].values))
        for alike in self.alike:
            self.largest[alike] = self.largest[alike].max()

    def _at(self, numbers: np.ndarray) -> np.ndarray:
        """Value of each thing watched at a state of its own."""
        return np.array([self.chain[k].values[i] for i, k in enumerate(numbers)])

    def _turned(self, part: float) -> list[tuple[int, int]]:
        """Extremes that the last state makes certain, by being off by `part` of the largest value: (what, number of the
        state); they are the most extreme on this way."""
        look, n = self.chain[-1], len(self.chain) - 1
        if not self.watch:
            return []
        drop = part * self.largest
        top = (look.seek >= 0) & (look.values < self._at(look.high) - drop)
        bottom = (look.seek <= 0) & (look.values > self._at(look.low) + drop) & ~top
        found = []
        for which, sign, where in ((top, 1.0, look.high), (bottom, -1.0, look.low)):
            wanted = "largest" if sign > 0 else "smallest"
            for i in np.flatnonzero(which):
                k = int(where[i])
                so_far = sign * np.array([entry.values[i] for entry in self.chain[self.first :]])
                value = sign * self.chain[k].values[i]
                if self.watch[i].peaks not in (wanted, "both") or not self.first < k < n or value < np.nanmax(so_far):
                    continue
                if value > np.nanmin(so_far[: k - self.first]) + NOISE * self.largest[i]:
                    t = self.chain[k - 1].t, self.chain[k + 1].t
                    if not any(w == i and a < t[1] and t[0] < b for w, a, b in self.resolved):
                        found.append((int(i), k))
        look.seek = np.where(top, -1, np.where(bottom, 1, look.seek))
        look.low = np.where(top, n, look.low)
        look.high = np.where(bottom, n, look.high)
        return sorted(found, key=lambda pair: pair[1])

    def _locate(self, what: int, k: int) -> float | None:
        """Time of an extreme near state k, if it is not that state itself. Beside a snap there is none to be found."""
        (a, b, c), records = (self.chain[j] for j in (k - 1, k, k + 1)), self.history.records
        within = self.resolution.peak * (c.t - a.t)  # type: ignore[union-attr]
        sign = np.sign(b.values[what] - np.array([a.values[what], c.values[what]])).max()
        seen = {look.t: look.values[what] for look in (a, b, c)}
        self.resolved.append((what, a.t, c.t))
        if self.depends:
            self.known.clear()
            self.tried.clear()
        if any(event.station in (k - 1, k) for event in self.history.critical):
            self.peaks.add(b.t)
            return None

        def value(u: float) -> float:
            t = a.t + (u - 1.0) * (c.t - a.t)
            near = min(seen, key=lambda s: abs(s - t))
            if abs(near - t) < 0.1 * within:
                return -sign * seen[near]
            if t not in self.tried:
                n = k if t < b.t else k + 1
                self.tried[t] = self._from(records[:n], t, True)[0]
                if self.history.model.contacts:  # where nobody looks for limit points
                    self.known[t] = n, self.tried[t]
            seen[t] = self._values(self.tried[t])[what]
            return -sign * seen[t]

        middle = 1.0 + (b.t - a.t) / (c.t - a.t)
        if not value(middle) < min(value(1.0), value(2.0)):
            return None
        try:
            with self.history.model.hushed():
                brent(value, brack=(1.0, middle, 2.0), tol=self.resolution.peak, maxiter=TRIES)  # type: ignore[union-attr]
        except ConvergenceError:
            return None
        best = max(seen, key=lambda t: sign * seen[t])
        self.peaks.add(best)
        return None if best == b.t else best

    def _back_to(self, t: float) -> None:
        """Forget the states after time t, or keep them in mind where they do not depend on the path."""
        n = sum(look.t < t for look in self.chain)
        passed = {event.station for event in self.history.critical}  # limit points come right after these
        if not self.depends:
            for k, record in enumerate(self.history.records[n:], n):
                if k - 1 not in passed:
                    self.known[record.t] = k, record
        del self.chain[n:], self.history.records[n:]
        self.history.critical = [event for event in self.history.critical if event.station < n - 1]

    def _needed(self) -> list[int]:
        """Numbers of states that were asked for, peaks, and those that a straight line between others would miss."""
        if self.resolution is None or len(self.chain) < 3:
            return list(range(len(self.chain)))
        t = np.array([look.t for look in self.chain])
        with np.errstate(invalid="ignore"):
            values = np.array([look.values for look in self.chain]) / self.largest
        asked = {*self.times.tolist(), *self.peaks, *self.mirrored, t[0], t[-1]}
        keep = [k for k in range(len(t)) if t[k] in asked]
        stack, kept = list(pairwise(keep)), set(keep)
        while stack:
            a, b = stack.pop()
            if b - a < 2:
                continue
            part = ((t[a + 1 : b] - t[a]) / (t[b] - t[a]))[:, None]
            off = np.abs(values[a + 1 : b] - (1.0 - part) * values[a] - part * values[b])
            off = np.where(np.isfinite(off), off, 0.0).max(axis=1, initial=0.0)
            if off.max() > self.resolution.bend:
                k = a + 1 + int(np.argmax(off))
                kept.add(k)
                stack += [(a, k), (k, b)]
        return sorted(kept)

    def _thin(self) -> None:
        """Leave only the states that are needed."""
        numbers = self._needed()
        self.history.critical = [
            replace(event, station=int(np.searchsorted(numbers, event.station, side="right")) - 1)
            for event in self.history.critical
        ]
        self.history.records[:] = [self.history.records[k] for k in numbers]
