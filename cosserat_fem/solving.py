"""Which solver does a scene ask for, and with what?

Rule: nothing is written but frames and checkpoints of runs in time.
"""

from __future__ import annotations

import pathlib
import time
from collections.abc import Callable
from dataclasses import asdict

from .equilibrium.continuation import STEPS, trace_path
from .equilibrium.statics import solve_quasistatic, solve_static
from .errors import ConvergenceError, SceneError, cause
from .frames import CHECKPOINT, FRAMES, FrameFile, read_checkpoint, read_frames, with_terms, write_checkpoint
from .history import History
from .limits.verdicts import watches
from .model import Model
from .motion.dynamics import RigidVelocity, solve_dynamic
from .motion.integrator import Checkpoint, Run
from .motion.steps import AdaptiveStep, FixedStep
from .record import Record
from .scene import Scene
from .scene.tables import SolveTable
from .space import State
from .theories import Comparison, compare_theories

COUNTED = ("iterations", "residuals")  # counters that go on in a resumed run
SAVE_EVERY = 3.0  # s of wall time between checkpoints of a run in time


def solve_scene(
    scene: Scene,
    start: State | None = None,
    *,
    progress: Callable[[int, int], bool | None] | None = None,
    folder: pathlib.Path | None = None,
    resume: bool = False,
) -> History:
    """Solve a scene as its [solve] table says.

    Parameters
    ----------
    start : state of the model to begin at, static and quasi-static
    progress : function (stations done, stations in all) -> bool
        Called after each station; return True to stop there.
    folder : folder for frames and checkpoints of a run in time; none are kept without one
    resume : bool
        Go on with the run in time whose checkpoint is in `folder`.

    Raises
    ------
    SceneError
        The model cannot be solved as it is meant.
    ConvergenceError
        No equilibrium was found; what was found before comes with it.
    FramesError
        Frames could not be written; what was found before comes with it.
    """
    table = scene.tables.solve
    if table.kind == "dynamic":
        return _solve_in_time(scene, progress, folder, resume)
    if table.kind == "path":
        return _solve_path(scene, progress)
    if table.kind == "static":
        steps = table.steps if start is None else None
        history = solve_static(
            scene.model, t=float(scene.times[0]), start=start, steps=steps, accuracy=table.accuracy
        )  # fmt: skip
        if progress is not None:
            progress(1, 1)
        return history
    asked = False

    def callback(k: int, state: State) -> bool | None:
        nonlocal asked
        asked = progress is not None and bool(progress(k + 1, scene.stations))
        return asked

    history = solve_quasistatic(
        scene.model, scene.times, start=start, past_limits=table.past_limits, callback=callback, accuracy=table.accuracy,
        travel=table.travel, resolution=scene.resolution(watches(scene.checks), wanted=bool(scene.checks)),
    )  # fmt: skip
    if asked:
        history.status, history.message = "stopped", f"asked to stop at t = {history.t[-1]:g} s"
    return history


def compare_scene(scene: Scene, tolerance: float) -> Comparison:
    """A scene in all theories; nothing is written."""
    table = scene.tables.solve
    model = scene.model
    if table.accuracy is not None and table.kind != "dynamic":  # elements for all of them
        model = solve_scene(scene).model

    def solve(variant: Model) -> History:
        if table.kind == "static":
            return solve_static(variant, t=float(scene.times[0]), steps=table.steps)
        if table.kind == "quasistatic":
            return solve_quasistatic(variant, scene.times)
        return solve_dynamic(
            variant, float(scene.times[-1]), start=table.start, velocity=_velocity(table), rho_inf=table.rho_inf,
            step=_step(table), times=scene.times,
        )  # fmt: skip

    return compare_theories(model, solve, tolerance=tolerance)


def _solve_path(scene: Scene, progress: Callable[[int, int], bool | None] | None) -> History:
    table = scene.tables.solve
    given = {key: value for key in ("steps", "longest") if (value := getattr(table, key)) is not None}
    most, asked = given.get("steps", STEPS), False

    def callback(k: int, history: History) -> bool | None:
        nonlocal asked
        asked = progress is not None and bool(progress(k, most))
        return asked

    history = trace_path(
        scene.model, scene.loads if table.along == "loads" else None, until=table.until, along=table.along, t=table.t,
        branch=table.branch, callback=callback, **given,
    )  # fmt: skip
    if asked:
        history.message = f"asked to stop; {history.message}"
    return history


def _solve_in_time(
    scene: Scene, progress: Callable[[int, int], bool | None] | None, folder: pathlib.Path | None, resume: bool
) -> History:
    table = scene.tables.solve
    several = table.richardson or table.accuracy is not None  # runs; there is no one to go on with
    keeper = None if folder is None or several else _Keeper(scene, folder, resume)
    before = keeper.before if keeper is not None else []
    asked = False

    def callback(run: Run) -> bool | None:
        nonlocal asked
        asked = progress is not None and bool(progress(len(before) + len(run.history.records), len(scene.times)))
        if keeper is not None:
            keeper.look_at(run, now=asked)
        return asked

    step = None if table.accuracy is not None and table.dt is None else _step(table)
    saved = None if keeper is None else keeper.saved
    try:
        history = solve_dynamic(
            scene.model, float(scene.times[-1]), start=table.start, velocity=_velocity(table), rho_inf=table.rho_inf,
            step=step, times=scene.times, callback=callback, resume=saved, accuracy=table.accuracy,
        )  # fmt: skip
    except (FramesError, ConvergenceError) as error:
        if error.history is not None:
            error.history.records[:0] = before
        raise
    finally:
        if keeper is not None:
            keeper.frames.close()
    history.records[:0] = before
    if keeper is not None:
        for name in COUNTED:
            setattr(history.counters, name, getattr(history.counters, name) + keeper.counted.get(name, 0))
    if asked:
        resumable = "" if keeper is None else f"; `cosserat-fem resume {folder}` goes on"
        history.message = f"asked to stop at t = {history.t[-1] if len(history) else 0:g} s{resumable}"
    return history


def _step(table: SolveTable) -> FixedStep | AdaptiveStep:
    return FixedStep(table.dt, table.richardson) if table.dt is not None else AdaptiveStep(table.rtol or 1e-4)


def _velocity(table: SolveTable) -> RigidVelocity | None:
    return None if table.velocity is None else RigidVelocity(**table.velocity.model_dump())


class FramesError(Exception):
    """Frames or a checkpoint could not be written; what was found goes with it."""

    def __init__(self, message: str, history: History) -> None:
        super().__init__(message)
        self.history = history


class _Keeper:
    """Keeps a run in time: states go to frames and, every few seconds, all that the rest depends on to a checkpoint.

    before, saved, counted: what an earlier run had kept, where it goes on, its counters.
    """

    def __init__(self, scene: Scene, folder: pathlib.Path, resume: bool) -> None:
        self.folder, self.identity = folder, scene.identity
        self.before: list[Record] = []
        self.saved: Checkpoint | None = None
        self.counted: dict[str, int] = {}
        if resume:
            identity, saved, self.counted = read_checkpoint(folder / CHECKPOINT)
            if identity != self.identity:
                raise SceneError(
                    f"{folder}: its scene or a file it reads was changed since the run began; start again with "
                    "`cosserat-fem run`."
                )
            self.saved = with_terms(saved, scene.model)
            _, self.before = read_frames(folder / FRAMES, saved.kept)
        self.frames = FrameFile(folder / FRAMES, self.identity, self.saved.kept if self.saved else None)
        self._written, self._last = 0, time.monotonic()

    def look_at(self, run: Run, now: bool) -> None:
        """Save a run that goes on if that is due, or `now`."""
        if not now and time.monotonic() - self._last <= SAVE_EVERY:
            return
        try:
            for record in run.history.records[self._written :]:
                self.frames.append(record)
                self._written += 1
            self.frames.sync()
            counters = asdict(run.history.counters)
            counters |= {name: counters[name] + self.counted.get(name, 0) for name in COUNTED}
            write_checkpoint(self.folder / CHECKPOINT, self.identity, run.checkpoint(), counters)
        except OSError as error:
            run.history.status = "stopped"
            run.history.message = f"t = {run.t:g} s: the run could not be saved: {cause(error)}"
            raise FramesError(run.history.message, run.history) from None
        self._last = time.monotonic()
