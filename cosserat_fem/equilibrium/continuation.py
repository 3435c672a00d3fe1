"""Which way does the path go past a limit point? Paths of equilibria, critical loads, branches.

Rule: a path starts at an equilibrium and follows `arclength`: nothing here knows how a step is made. A path goes straight
on through bifurcations unless it is asked to take the branch; then it leaves along the motion in which the tangent is
singular, chosen by a seed where there are several. Under following loads, which have no potential, stability is judged by
the vibrations about each state (`vibration`): that is where flutter shows, which no static criterion sees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..errors import ConvergenceError, SceneError, check_integer, check_number, check_positive
from ..history import History
from ..iteration.arclength import FIRST, LONGEST, LoadFactor, Path, Point, Time
from ..iteration.newton import Newton
from ..model import Model
from ..record import CriticalPoint, Kind, Record
from ..space import State
from ..terms import Term
from .statics import solve_static
from .vibration import Modes, modes

STEPS = 400
BRANCH = (0.03, 0.01, 0.1, 0.003)  # lengths of the first step on a branch, tried in this order
CROWDED = (2, 14)  # crossings of other paths in one step; times that it is then shortened
TINIEST = 1e-14  # shortest step towards a critical load: nobody knows how large the load is
FARTHEST_LOAD = 1e12  # factor at which a critical load is given up
WATCHED = 6  # vibrations looked at under following loads
LITTLE = 0.5  # change of a squared frequency in one step, in parts of itself
UNSTABLE = "critical load: the rods are unstable without these loads already."
CLOSE = 1e-7  # part of a load within which flutter is found


@dataclass
class _Trace:
    """A path as it is made: its history, its last point and the length of its next step."""

    history: History
    path: Path
    point: Point
    ds: float
    until: float
    stable: bool  # at the start


def trace_path(
    model: Model,
    loads: Sequence[Term] | None = None,
    *,
    until: float | Literal["critical"] = 1.0,
    along: Literal["loads", "time"] = "loads",
    t: float = 0.0,
    start: State | None = None,
    steps: int = STEPS,
    longest: float = LONGEST,
    branch: int | None = None,
    callback: Callable[[int, History], bool | None] | None = None,
) -> History:
    """Follow equilibria under growing and shrinking loads, or along a motion that may have to turn back.

    Parameters
    ----------
    loads : sequence of loads of the model, optional
        Those that the path multiplies by its factor; default all, weight too. The others act as they are.
    until : float or "critical"
        Where the path ends: a factor, or a time [s]; it begins at factor 0, or at time `t`. "critical": before the first
        point where the equilibrium is no longer stable, for loads only; see `critical_load`.
    along : "loads" or "time"
        What goes on along the path. "time": parts move and loads change as their tables say.
    t : [s]
        Time at which parts stand and loads act; with along = "time" where the path begins.
    start : State, optional
        A state near the first equilibrium; default the drawn shape.
    steps : int
        How many states at most; then the path stops where it is.
    longest : float
        Longest step: mean rotation [rad] or displacement [rod lengths].
    branch : int, optional
        At the first bifurcation leave the path along the motion that becomes possible there; of several, and of its two
        directions, the seed chooses.
    callback : function (station, history) -> bool, optional
        Called after each state; return True to stop there.

    Returns
    -------
    History with the states of the path, their `factors` (or times) and `critical` points, each found to about 1e-6 of
    the value where it lies.

    Raises
    ------
    SceneError
        The model has contact, Kardan angles, too few supports or no load.
    ConvergenceError
        The path was lost; the error carries what was found.
    """
    steps = check_integer("trace_path: steps", steps, 1)
    longest = check_positive("trace_path: longest", longest)
    branch = None if branch is None else check_integer("trace_path: branch", branch, 0)
    critical = isinstance(until, str)
    if critical and (until != "critical" or along != "loads"):
        raise ValueError(f"trace_path: until must be a number, or 'critical' along loads (got {until!r}).")
    end = FARTHEST_LOAD if critical else check_number("trace_path: until", until)
    trace = _begin(model.in_space(), loads, along, t, end, start)
    trace.ds = min(trace.ds, longest)
    if critical:
        trace.path.shortest = TINIEST
        if not trace.stable:
            raise SceneError(UNSTABLE)
    if critical and not model.symmetric:
        return _to_growth(trace, steps, callback)
    for k in range(1, steps + 1):
        new, events = _next(trace, longest)
        if critical and events:
            return _finish(trace, "converged", "")
        crossed = [event for event in events if event.kind == "bifurcation"]
        if branch is not None and crossed:
            new, branch = _on_branch(trace, crossed[0], branch), None
        _keep(trace, new)
        if callback is not None and callback(k, trace.history):
            return _finish(trace, "stopped", "stopped by the caller")
        if new.value == trace.until:
            return _finish(trace, "converged", "")
    return _finish(trace, "stopped", f"{steps} steps ended before {_name(trace)} {trace.until:g}")


def critical_load(
    model: Model,
    loads: Sequence[Term] | None = None,
    *,
    t: float = 0.0,
    start: State | None = None,
    steps: int = STEPS,
) -> CriticalPoint:
    """The smallest factor on loads at which the equilibrium that they lead to is no longer stable.

    Parameters as for `trace_path`: the factor grows from 0 until the load turns back, another path crosses or, under
    following loads, a vibration grows (rods then need their mass).

    Returns
    -------
    CriticalPoint: `value` is the factor, `kind` says what happens there, `shape` in which motion.

    Raises
    ------
    SceneError, ConvergenceError
        As for `trace_path`; ConvergenceError also if no critical load was found within `steps`.
    """
    history = trace_path(model, loads, until="critical", t=t, start=start, steps=steps)
    if not history.critical:
        message = f"critical_load: none up to {history.factors[-1]:g} times the loads, in {len(history)} states."
        raise ConvergenceError(message, history, history.final)
    return history.critical[0]


def _to_growth(trace: _Trace, steps: int, callback: Callable[[int, History], bool | None] | None) -> History:
    """To where following loads first make a vibration grow, or turn back. Steps change frequencies by a little each."""
    path = trace.path
    vibrations = _vibrations(path, trace.point)
    if not vibrations.stable:
        raise SceneError(UNSTABLE)
    for k in range(1, steps + 1):
        new, ds = path.advance(trace.point, trace.ds, trace.until)
        if new is None:
            raise _lost(trace)
        there = _vibrations(path, new)
        size = np.maximum(np.abs(vibrations.squared), 1e-3 * np.abs(vibrations.squared).max())
        change = float((np.abs(there.squared - vibrations.squared) / size).max())
        if change > LITTLE and trace.ds > TINIEST:
            trace.ds = max(TINIEST, trace.ds * max(0.1, 0.5 * LITTLE / change))
            continue
        events = path.critical(trace.point, new) if there.stable else [_vibrates(trace, trace.point, new)]
        if events:
            trace.history.critical.append(replace(events[0], station=len(trace.history) - 1))
            return _finish(trace, "converged", "")
        trace.ds = min(ds, trace.ds * min(2.0, LITTLE / max(change, 1e-9)))
        vibrations = there
        _keep(trace, new)
        if callback is not None and callback(k, trace.history):
            return _finish(trace, "stopped", "stopped by the caller")
    return _finish(trace, "stopped", f"{steps} steps ended before a vibration grew")


def _begin(
    model: Model, loads: Sequence[Term] | None, along: str, t: float, until: float, start: State | None
) -> _Trace:
    """The first point of a path."""
    if along not in ("loads", "time"):
        raise ValueError(f"trace_path: along must be 'loads' or 'time' (got {along!r}).")
    if model.contacts:
        raise SceneError("path: cannot follow rods that touch something. Run the scene in time, or without contact.")
    if model.rotation != "quaternion":
        raise SceneError("path: needs rotation = 'quaternion'.")
    if model.theory == "string":
        raise SceneError("path: needs rods that bend; a string has no stiffness where it is slack.")
    t = check_number("trace_path: t", t)
    chosen = model.loads(loads)
    if along == "loads" and not chosen:
        raise SceneError("path: the model has no load to multiply. Add one, or follow the motion with along = 'time'.")
    if along == "time" and not until > t:
        raise ValueError(f"trace_path: until must be later than t (got {until:g} s and {t:g} s).")
    first = model.with_factor(0.0, chosen) if along == "loads" else model
    found = solve_static(first, t=t, start=start)
    for message in first.warnings if first is not model else ():
        model.warn(message)
    parameter = LoadFactor(model, chosen) if along == "loads" else Time(model, t, until)
    newton = Newton(model)
    path = Path(newton, parameter)
    point = path.begin(found.final, 0.0 if along == "loads" else t, until)
    history = History(model, counters=newton.counters, loads=chosen if along == "loads" else ())
    start_record = found.records[-1]
    trace = _Trace(history, path, point, FIRST, until, start_record.negative <= 0)
    point = replace(point, residual=start_record.residual, iterations=start_record.iterations)
    _keep(trace, point)
    return trace


def _next(trace: _Trace, longest: float) -> tuple[Point, list[CriticalPoint]]:
    """The next point and the critical points before it, which go to the history."""
    new, ds = trace.path.advance(trace.point, trace.ds, trace.until)
    for _ in range(CROWDED[1]):
        if new is None:
            raise _lost(trace)
        if min(new.negative, trace.point.negative) < 0 or abs(new.negative - trace.point.negative) <= CROWDED[0]:
            break
        trace.ds *= 0.25
        new, ds = trace.path.advance(trace.point, trace.ds, trace.until)
    if new is None:
        raise _lost(trace)
    trace.ds = min(ds, longest)
    station = len(trace.history) - 1
    events = [replace(event, station=station) for event in trace.path.critical(trace.point, new)]
    trace.history.critical += events
    return new, events


def _lost(trace: _Trace) -> ConvergenceError:
    """What to raise where the next state was not found."""
    history = trace.history
    history.status = "stopped"
    history.message = (
        f"path at {_name(trace)} {trace.point.value:.6g}: the next state was not found ({trace.path.reason}); "
        f"{len(history)} states are kept. Try more elements or a smaller `longest` step."
    )
    return ConvergenceError(history.message, history, trace.point.state)


def _on_branch(trace: _Trace, event: CriticalPoint, seed: int) -> Point:
    """First point of the path that crosses at a bifurcation."""
    path, before = trace.path, trace.point
    start = replace(before, state=event.state, value=event.value)
    _, shape = path.softest(start, seed)
    along = path.length(shape, 0.0, before.du, before.rate)
    shape = shape - along * before.du  # where the path itself goes on is no news
    size = np.sqrt(path.length(shape, 0.0, shape, 0.0))
    sign = 1.0 if np.random.default_rng(seed).random() < 0.5 else -1.0
    leaving = replace(start, du=sign * shape / size, rate=0.0)
    for length in BRANCH:
        new = path.step(leaving, length)
        if new is not None:
            trace.ds = length
            return new
    raise ConvergenceError(
        f"path: the branch at {_name(trace)} {event.value:.6g} was not found ({path.reason}); another seed, a small load "
        "or a slightly bent drawing may lead onto it.",
        trace.history,
        event.state,
    )


def _keep(trace: _Trace, point: Point) -> None:
    """A point as the next state of the history."""
    factor = point.value if isinstance(trace.path.parameter, LoadFactor) else None
    trace.point = point
    trace.history.records.append(
        Record(point.state, point.reactions, point.iterations, point.residual, point.negative, factor=factor)
    )


def _finish(trace: _Trace, status: Literal["converged", "stopped"], reason: str) -> History:
    """Say how far it went, and what it passed."""
    history = trace.history
    history.status = status
    passed = [f"{event.kind} point at {event.value:.6g}" for event in history.critical]
    told = f"{len(history)} states up to {_name(trace)} {trace.point.value:g}"
    history.message = "; ".join(filter(None, [reason, told, ", ".join(passed)]))
    return history


def _name(trace: _Trace) -> str:
    return "factor" if isinstance(trace.path.parameter, LoadFactor) else "t ="


def _vibrations(path: Path, point: Point) -> Modes:
    """The lowest vibrations about a point."""
    return modes(path.parameter.model(point.value), point.state, WATCHED)


def _vibrates(trace: _Trace, low: Point, high: Point) -> CriticalPoint:
    """Where between two points of a path a vibration begins to grow, by halving."""
    path, start = trace.path, low
    a, b = 0.0, path.reach(low, high)
    while abs(high.value - low.value) > CLOSE * abs(high.value):
        middle = path.step(start, 0.5 * (a + b))
        if middle is None:
            raise _lost(trace)
        if _vibrations(path, middle).stable:
            a, low = 0.5 * (a + b), middle
        else:
            b, high = 0.5 * (a + b), middle
    found = _vibrations(path, high)
    k = int(np.argmax(found.growth))
    kind: Kind = "flutter" if found.omega[k] > 1e-6 * found.omega.max() else "divergence"
    value = 0.5 * (low.value + high.value)
    return CriticalPoint(kind, value, high.state.t, high.state, found.shapes[k], low.negative, high.negative)
