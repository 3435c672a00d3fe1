"""Where is equilibrium? One state, or a travel of states as parts move.

Rule: cheap first. A state is sought with the plain Newton method, and where rods may touch by way of soft contact; if that
fails, or ends in an unstable state, with the guarded method; then in load steps. A load step is a part of everything at
once: the residual of the start state is carried as a dead load that is taken away, and the supports close a part of their
gaps. In a travel each station starts from the one before, extrapolated; where it fails the time step is halved, and a part
never turns by more than a quarter turn at once.

The unstable states that the plain method may end in are equilibria too; a state is left for a stable one if the guarded
method finds one from the same start or, where symmetry holds it on the ridge, from a slightly bent start.

A part that has turned by more than half a turn since it was drawn looks like one that turned the other way: such a start
is travelled to from the time at which the part stood as drawn.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..accuracy.refine import check_accuracy, to_accuracy
from ..errors import ConvergenceError, SceneError, check_integer, check_number, check_shape
from ..history import History
from ..iteration.arclength import FIRST, Path, Time
from ..iteration.easing import eased
from ..iteration.newton import Newton, Solved
from ..kernels.rotation import relative_rotation, rotate_bodies
from ..model import Model
from ..record import Record
from ..space import State
from .march import Clock, March, Resolution

log = logging.getLogger(__name__)

LOAD_STEPS = (4, 16, 64)
HALVINGS = 6
BEND = 0.02  # rad
JUMP = 0.05  # mean rotation or displacement in rod lengths between stations that makes them worth a look
PATH_STEPS = 200  # along a path between two stations
PUSHES = 8  # decades of stiffness with which overlapping rods are pushed apart


def solve_static(
    model: Model,
    *,
    t: float = 0.0,
    start: State | None = None,
    steps: int | None = None,
    accuracy: float | None = None,
) -> History:
    """Find the equilibrium at one time, by itself: from the drawn shape, or from `start`.

    Parameters
    ----------
    t : [s]
        Time at which parts stand and loads act.
    start : State, optional
        A state of this model (`history.final`).
    steps : int, optional
        Go there in this many equal load steps; by default only as many as needed.
    accuracy : optional
        Choose order and elements so that the estimated error of everything reported is at most this part of its peak; see
        `refine`.

    Returns
    -------
    History with one state. With `accuracy`, its model is the one with the elements chosen (`history.model`; rods, supports
    and terms are the same objects), and `history.chosen` says which they are.

    Raises
    ------
    SceneError
        The supports leave a rigid motion that no load can balance.
    ConvergenceError
        No equilibrium was found; the message says where it was lost and what to try.
    """
    if steps is not None:
        check_integer("solve_static: steps", steps, 1)
    t = check_number("solve_static: t", t)
    if accuracy is not None:

        def run(model: Model, times: np.ndarray, start: State | None) -> History:
            return solve_static(model, t=float(times[0]), start=start, steps=steps)

        return to_accuracy(model, check_accuracy("solve_static", accuracy), np.array([t]), run, start)
    _check_supports(model)
    model.check_spans([t])
    history = History(model)
    newton = Newton(model)
    history.counters = newton.counters
    state = _start(newton, history, start, t)
    _append(history, newton.accepted(_equilibrium(newton, state, history, steps=steps)))
    return _finish(history)


def solve_quasistatic(
    model: Model,
    times: Sequence[float] | np.ndarray,
    *,
    start: State | None = None,
    past_limits: bool = False,
    callback: Callable[[int, State], bool | None] | None = None,
    accuracy: float | None = None,
    travel: Literal["out", "both"] = "out",
    resolution: Resolution | None = None,
) -> History:
    """Follow the parts and loads through equilibria at the given times.

    Parameters
    ----------
    times : (T,) [s]
        Increasing.
    start : State, optional
        Where the first station starts from; default the drawn shape.
    past_limits : bool
        Where the equilibrium that is followed ends, because it turns back in time (a limit point), follow it there, back
        and forth, to the station, instead of leaving it for another one as a snapping rod does. Not with contact.
    callback : function (station, state) -> bool, optional
        Called after each station; return True to stop there.
    accuracy : optional
        As for `solve_static`; the callback is then called in whole travels only.
    travel : "out" or "both"
        "both": to the last time and back the same way, through the same stations. Times go on: on the way back parts stand
        and loads act as at 2 * times[-1] - t. What contact remembers of friction goes along.
    resolution : Resolution, optional
        Also find stations between these, so that the curves of torques, reactions and what else is watched are resolved and
        no peak is stepped over; see `march`.

    Returns
    -------
    History with one state for each time, and those that `resolution` asked for; `critical` holds limit points that were met;
    with `accuracy` as for `solve_static`.

    Raises
    ------
    SceneError, ConvergenceError
        As for `solve_static`; the error carries the stations found so far.
    """
    times = check_shape("solve_quasistatic: times", times, (-1,))
    if len(times) == 0:
        raise ValueError("solve_quasistatic: times is empty; give at least one time.")
    if (np.diff(times) <= 0).any():
        k = int(np.flatnonzero(np.diff(times) <= 0)[0])
        raise ValueError(f"solve_quasistatic: times must increase (got {times[k]:g} s followed by {times[k + 1]:g} s).")
    if travel not in ("out", "both"):
        raise ValueError(f"solve_quasistatic: travel must be 'out' or 'both' (got {travel!r}).")
    if travel == "both" and len(times) == 1:
        raise ValueError("solve_quasistatic: travel = 'both' needs at least two times.")
    if accuracy is not None:

        def run(model: Model, some: np.ndarray, start: State | None) -> History:
            told = (callback, resolution) if len(some) == len(times) else (None, None)
            return solve_quasistatic(
                model, some, start=start, past_limits=past_limits, callback=told[0], travel=travel, resolution=told[1]
            )

        return to_accuracy(model, check_accuracy("solve_quasistatic", accuracy), times, run, start)
    _check_supports(model)
    model.check_spans(times)
    history = History(model)
    newton = Newton(model)
    history.counters = newton.counters
    clock = Clock()
    if travel == "both":
        clock = Clock(float(times[-1]))
        times = np.append(times, 2.0 * times[-1] - times[-2::-1])
    try:
        state = _start(newton, history, start, float(times[0]))
        _append(history, newton.accepted(_equilibrium(newton, state, history)))
        march = March(history, times, clock, _Step(newton, clock, times, past_limits), resolution)
        if march.run(lambda k, record: callback is not None and callback(k, record.state)):
            history.status, history.message = "stopped", f"stopped by the caller at t = {history.t[-1]:g} s"
            return history
    except KeyboardInterrupt:  # what was found is not lost
        if not len(history):
            raise
        history.status, history.message = "stopped", f"interrupted after t = {history.t[-1]:g} s"
        return history
    return _finish(history)


class _Step:
    """From the last state of a history to a later time."""

    def __init__(self, newton: Newton, clock: Clock, times: np.ndarray, past_limits: bool) -> None:
        self.newton, self.clock, self.past_limits = newton, clock, past_limits
        self.passed: tuple[State | None, State | None] = (None, None)  # the last one found, and the one before it
        self.path: Path | None = None  # looked at between stations, where that can be done
        model = newton.model
        if len(times) > 1 and not model.contacts and model.rotation == "quaternion" and model.theory != "string":
            self.path = Path(newton, Time(model, float(times[0]), min(float(times[-1]), clock.turn)))

    def __call__(self, history: History, t: float, tried: bool = False) -> Record:
        last = history.final
        before = history.records[-2].state if len(history) > 1 else None
        if self.passed[0] is last:
            before = self.passed[1]
        solved, reached = _travel(self.newton, history, before, self.clock.at(t))
        if self.path is not None and not tried:
            solved = _watched(self.path, history, (before, last), solved, self.past_limits)
        self.passed = solved.state, reached
        return _record(solved, t)


def _start(newton: Newton, history: History, start: State | None, t: float) -> State:
    """State to start from at time t."""
    model = newton.model
    approach = newton.approach
    if start is not None:
        model.check_state(start)
        if approach is not None and not approach.knows(start):
            start = approach.begin(start)
        return start.at_time(t)
    if approach is None and not model.constraints.moving_parts:
        return model.initial_state(t)
    drawn_at = [part.drawn_at for part in model.parts]
    if approach is not None:
        return _untangled(newton, drawn_at[0] if len(set(drawn_at)) == 1 else t).at_time(t)
    if max((part.stages(t0, t) for part, t0 in zip(model.parts, drawn_at, strict=True)), default=1) <= 2:
        return model.initial_state().at_time(t)
    first = min(drawn_at) if t > min(drawn_at) else max(drawn_at)
    on_the_way = History(model)
    _append(on_the_way, newton.accepted(_equilibrium(newton, model.initial_state().at_time(first), on_the_way)))
    return _travel(newton, on_the_way, None, t)[0].state


def _untangled(newton: Newton, t: float) -> State:
    """The drawn shape with parts as at time t; if rods overlap something a little, what soft contact makes of it."""
    model, approach = newton.model, newton.approach
    drawn = model.initial_state(t)
    try:
        return approach.begin(drawn)  # type: ignore[union-attr]
    except SceneError as error:
        fault = error
    for power in range(PUSHES):
        soft = {term: term.softened(drawn, model.space, 10.0**power) for term in model.contacts}
        if None in soft.values():
            raise fault
        pushed = Newton(model.with_terms([soft.get(term, term) for term in model.terms]))
        try:
            state = _equilibrium(pushed, pushed.approach.begin(drawn), History(pushed.model)).state  # type: ignore[union-attr]
            state = approach.begin(replace(state, contact=None))  # type: ignore[union-attr]
        except (SceneError, ConvergenceError):
            continue
        model.warn(f"{fault} It was pushed out before the run; draw it outside if that is not meant.")
        return state
    raise fault


def _travel(newton: Newton, history: History, before: State | None, t: float) -> tuple[Solved, State]:
    """From the last state to time t, in as few parts as it takes; also return the state before the last one reached."""
    model = newton.model
    state = history.final
    unstable = history.records[-1].negative > 0
    stages = max((part.stages(state.t, t) for part in model.parts), default=1)
    wanted = [t] if stages == 1 else list(np.linspace(state.t, t, stages + 1)[1:])
    halvings, shortest = 0, abs(wanted[0] - state.t) * 0.5**HALVINGS
    while True:
        known = before is None or newton.approach is not None  # parts must come along with the rods
        guess = state.at_time(wanted[0]) if known else _extrapolated(before, state, wanted[0])  # type: ignore[arg-type]
        solved = _plain(newton, guess)
        if solved.converged and solved.negative > 0 and not unstable:
            solved = _prefer_stable(newton, state.at_time(wanted[0]), solved)
        if not solved.converged and not known:
            solved = newton.plain(state.at_time(wanted[0]))
        if not solved.converged and halvings == 0:
            solved = newton.guarded(state.at_time(wanted[0]))
        if solved.converged:
            solved = newton.accepted(solved)
            before, state = state, solved.state
            unstable = solved.negative > 0
            wanted.pop(0)
            if not wanted:
                return solved, before
            continue
        halvings += 1
        newton.counters.bisections += 1
        if abs(wanted[0] - state.t) < 1.5 * shortest:
            solved = newton.guarded(state.at_time(wanted[0]))
            if not solved.converged:
                raise _failure(model, history, solved, f"on the way to t = {t:g} s; what was found before is kept")
            continue
        wanted.insert(0, 0.5 * (state.t + wanted[0]))


def _watched(
    path: Path, history: History, way: tuple[State | None, State], solved: Solved, past_limits: bool
) -> Solved:
    """The next station, after a look whether the path from the last one leads there. If it ends on the way: a warning, or
    with past_limits the state where it comes to the time of the station again. way: the two states before the station."""
    model, state = path.newton.model, solved.state
    before, last = way
    jump = path.apart(last, state)
    if jump < JUMP or (before is not None and path.apart(_extrapolated(before, last, state.t), state) < 0.5 * jump):
        return solved
    point = path.begin(last, last.t, state.t)
    if path.apart(path.predicted(point, (state.t - last.t) / point.rate)[0], state) < 0.5 * jump:
        return solved
    ds, limits = FIRST, 0
    for _ in range(PATH_STEPS):
        new, ds = path.advance(point, ds, state.t)
        if new is None:
            break
        found = [event for event in path.critical(point, new) if event.kind == "limit"]
        history.critical += [replace(event, station=len(history) - 1) for event in found]
        limits, point = limits + len(found), new
        if point.value == state.t or (found and not past_limits):
            break
    if limits == 0:
        return solved
    if past_limits and point.value == state.t:
        total = model.residual(point.state)
        return Solved(point.state, total, point.reactions, point.residual, 0, point.negative, point.iterations)
    hint = f"The path was followed no further: {path.reason}." if past_limits else "past_limits follows the path."
    model.warn(
        f"t = {history.critical[-limits].t:.6g} s: a limit point; the equilibrium that was followed ends there, and the "
        f"rods snap to another one before t = {state.t:g} s. A run in time shows how. {hint}"
    )
    return solved


def _extrapolated(before: State, state: State, t: float) -> State:
    """Guess at time t on the straight line through two states; rotations go on at the same rate."""
    part = (t - state.t) / (state.t - before.t)
    stress = tuple(b + part * (b - a) for a, b in zip(before.stress, state.stress, strict=True))
    r = state.r + part * (state.r - before.r)
    if state.angles is not None and before.angles is not None:
        return state.at_time(t)
    q = np.empty_like(state.q)
    rotate_bodies(state.q, part * relative_rotation(before.q, state.q), q)
    return State(t, r, q, stress)


def _equilibrium(newton: Newton, state: State, history: History, *, steps: int | None = None) -> Solved:
    """Equilibrium from a state that may be far from it."""
    if steps is None:
        solved = _settled(newton, state)
        if solved.converged and solved.negative > 0 and not solved.guarded:
            return _prefer_stable(newton, state, solved)
        if solved.converged:
            return solved
    for n in LOAD_STEPS if steps is None else (steps,):
        solved = _in_load_steps(newton, state, n)
        if solved.converged:
            return solved
    raise _failure(newton.model, history, solved, "from the start shape, with plain, guarded and stepped loading")


def _plain(newton: Newton, state: State) -> Solved:
    """Equilibrium by the plain method, or by way of soft contact where rods may touch."""
    solved = newton.plain(state)
    return solved if solved.converged or newton.approach is None else eased(newton, state)


def _settled(newton: Newton, state: State) -> Solved:
    """Equilibrium from a state, cheap first."""
    if newton.approach is None:
        return newton.settled(state)
    solved = _plain(newton, state)
    return solved if solved.converged else newton.guarded(state)


def _prefer_stable(newton: Newton, state: State, solved: Solved) -> Solved:
    """The stable state that the guarded method finds from the same start or beside it, if it does."""
    other = newton.guarded(state)
    if not other.converged or other.negative > 0:
        other = newton.guarded(_bent(newton, solved.state))
    if not other.converged or other.negative > 0:
        return solved
    newton.model.warn(
        f"t = {state.t:g} s: the first equilibrium found is unstable ({solved.negative} negative eigenvalues of the "
        "tangent); it was left for a stable one. A perfectly symmetric scene may go either way."
    )
    return other


def _bent(newton: Newton, state: State) -> State:
    """The state turned at its free nodes by up to BEND along the motion that a small skew load causes."""
    model = newton.model
    phase = np.arange(model.space.n_nodes)[:, None] * np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
    load = model.shift * np.array([*3 * [model.scales["length"]], *3 * [1.0]]) * np.sin(1.0 + 0.1 * phase)
    du = newton.response(state, load)
    largest = np.abs(du[:, 3:]).max()
    if not 0.0 < largest < np.inf:
        return state
    return model.space.update(state, du, BEND / largest, state.stress)


def _in_load_steps(newton: Newton, state: State, n: int) -> Solved:
    """Equilibrium in n steps of everything: residual of the start as a dead load taken away, gaps closed in parts."""
    model = newton.model
    start = model.residual(state).g
    final = model.constraints.targets(state.t)
    for k in range(1, n + 1):
        newton.counters.load_steps += 1
        targets = final if k == n else model.constraints.part_way(state, final, 1.0 / (n - k + 1))
        offset = None if k == n else -(1.0 - k / n) * start
        solved = newton.settled(state, targets=targets, offset=offset)
        if not solved.converged:
            return replace(solved, reason=f"load step {k} of {n}: {solved.reason}")
        state = solved.state
    return solved  # n is at least 1


def _check_supports(model: Model) -> None:
    """SceneError if a rigid motion is free and no load can hold it."""
    free = model.free_motions
    lost = [text for text, translation in free if translation or not model.terms]
    if model.contacts:  # a floor may hold what no support does
        lost = []
    if lost:
        raise SceneError(
            [
                f"model: too few supports for a static run: {text}. "
                "Hold that motion with a Clamp or Pin, or run it as dynamics."
                for text in lost
            ]
        )


def _append(history: History, solved: Solved) -> None:
    history.records.append(_record(solved, solved.state.t))


def _record(solved: Solved, t: float) -> Record:
    """The state that was found, at time t."""
    return Record(
        solved.state, solved.reactions, solved.iterations, solved.residual, solved.negative, contact=solved.pressed,
        time=None if t == solved.state.t else t,
    )  # fmt: skip


def _finish(history: History) -> History:
    """Say how it went."""
    unstable = [f"{r.t:g}" for r in history.records if r.negative > 0]
    if unstable:
        more = f" and {len(unstable) - 5} more" if len(unstable) > 5 else ""
        history.model.warn(
            f"unstable equilibrium at t = {', '.join(unstable[:5])}{more} s: a real rod would snap away from it."
        )
    n = len(history)
    history.message = f"{n} equilibri{'um' if n == 1 else 'a'}, {history.counters.iterations} iterations"
    return history


def _failure(model: Model, history: History, solved: Solved, where: str) -> ConvergenceError:
    """What happened, where along which rod, and what to try."""
    rod = model.rods[model.space.node_rod[solved.where]]
    s = model.space.node_s[solved.where]
    history.status = "stopped"
    history.message = (
        f"static run at t = {solved.state.t:g} s: no equilibrium ({solved.reason}), {where}. "
        f"The residual is {solved.residual:.1e} of the section forces, largest at rod {rod.name!r}, s = {s:.4g} m. "
        "Try a drawn shape closer to the expected one, more elements there, smaller time steps, or, "
        "if the rod may snap through, the dynamic run."
    )
    return ConvergenceError(history.message, history, solved.state)
