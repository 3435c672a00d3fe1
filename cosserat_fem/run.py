"""What happens when a scene is run? Folder, solution, results, summary; pictures last.

Rule: the folder is touched only after the scene was found valid, and by one run at a time; `summary.json` is there from
the first moment and says how far the run came; every result is written whole or not at all; pictures are made by another
process when everything else is safe.
"""

from __future__ import annotations

import json
import os
import pathlib
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import metadata
from typing import Any

from .accuracy import add_errors
from .band import FOLDER, compare_ends, verdicts
from .catalogue import sources
from .continuation import STEPS, trace_path
from .drive import describe_drive, turns_back, write_drives, write_joint_models
from .dynamics import RigidVelocity, solve_dynamic
from .errors import ConvergenceError, CosseratError, SceneError, one_line, out_of_memory
from .export import (
    replace_file,
    write_contact_loads,
    write_contacts,
    write_hinge_torque,
    write_history,
    write_ledger,
    write_modes,
    write_parts,
    write_path,
    write_reactions,
    write_shapes,
    write_steps,
)
from .folder import CHECKED, DRIVEN, PROGRAM, RESULTS, TOUCHING, RunFolder
from .frames import CHECKPOINT, FRAMES, FrameFile, read_checkpoint, read_frames, with_terms, write_checkpoint
from .history import History, Record
from .integrator import AdaptiveStep, Checkpoint, FixedStep, Run
from .kernels import CompileClock
from .margins import margin_fields, write_checks, write_margins
from .mechanism import Part
from .model import Model
from .scene import Scene, load_scene
from .space import State
from .statics import solve_quasistatic, solve_static
from .summary import describe, describe_modes, describe_peaks, out_of_plane, told_clearance
from .theories import Comparison, compare_theories
from .verdicts import Verdict, assess, clearances, found_at, judged, overall, tell, warn_of_parts, watches
from .vibration import Modes, modes

PACKAGES = ("numpy", "scipy", "scikit-fem", "numba", "meshio", "pyvista", "vtk", "h5py", "pyamg")
COUNTED = ("iterations", "residuals")  # counters that go on in a resumed run
SAVE_EVERY = 3.0  # s of wall time between checkpoints of a run in time


@dataclass
class Phases:
    """Wall and CPU seconds by phase."""

    wall: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, name: str):
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.wall[name] = round(time.perf_counter() - wall, 4)
            self.cpu[name] = round(time.process_time() - cpu, 4)


@dataclass(frozen=True)
class Keep:
    """What a run writes besides scene.toml and summary.json; a study of many runs keeps little.

    results: names of the result files, default all. errors: estimate discretisation errors for the summary. clearances:
    measure distances from parts for it.
    """

    results: tuple[str, ...] | None = None
    errors: bool = True
    clearances: bool = True


ALL = Keep()


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a run left: its folder, history (None if nothing was found), the reason if it stopped early, files written.

    by_chance: the user or the machine ended it (Ctrl-C, memory, disk), so that the same scene may go further again.
    """

    folder: pathlib.Path
    history: History | None
    reason: str = ""
    written: tuple[str, ...] = ()
    complete: bool = False  # every result of the history is on the disk
    by_chance: bool = False
    verdicts: dict[str, dict[str, Any]] = field(default_factory=dict)  # on drives, by part
    checks: tuple[Verdict, ...] = ()
    before: tuple[str, ...] = ()  # verdicts of a run that was complete when the one with sticking strands was resumed
    sticking: Outcome | None = None  # the run with sticking strands, if the scene asks for both; its reason is in ours

    @property
    def verdict(self) -> str:
        """On all checks and drives together: SAFE, UNSAFE or UNKNOWN."""
        return overall(
            [
                *(said["verdict"] for said in self.verdicts.values()),
                *(check.status for check in self.checks),
                *self.before,
            ]
        )

    @property
    def violated(self) -> bool:
        """True if not everything that was to be judged is safe, at both ends of a band."""
        return self.verdict != "SAFE" or (self.sticking is not None and self.sticking.violated)


def run_scene(
    scene: Scene,
    out: str | os.PathLike[str] | RunFolder | None = None,
    *,
    force: bool = False,
    progress: Callable[[int, int], bool | None] | None = None,
    announce: Callable[[str], None] | None = None,
    phases: Phases | None = None,
    resume: bool = False,
    keep: Keep = ALL,
) -> Outcome:
    """Run a scene and write its results, without pictures (see `draw`). Ctrl-C stops it; what was found is written.

    A scene with rods between slipping and sticking strands is run at both ends: slipping in the folder itself, sticking in
    its folder `stick`; the summary has the peaks of both under "band".

    Parameters
    ----------
    out : folder, default `scene.folder`
        A `RunFolder` that is held already is used as it is and stays held.
    force : bool
        Write into a folder that holds other files too; they are left alone.
    progress : function (stations done, stations in all) -> bool
        Called after each station; return True to stop there.
    announce : function (text)
        Told when kernels are compiled for the first time on this machine.
    resume : bool
        Go on with the run in time whose checkpoint is in the folder; see `resume_scene`.
    keep : what to write; default all

    Raises
    ------
    SceneError
        The folder cannot be used, or the model cannot be solved as it is meant.
    """
    if not isinstance(out, RunFolder):
        with RunFolder(scene.folder if out is None else out, scene.inputs, force=force, resume=resume) as held:
            return run_scene(scene, held, progress=progress, announce=announce, phases=phases, resume=resume, keep=keep)
    if not scene.banded:
        return _run_once(scene, out, progress, announce, phases, resume, keep)
    return _run_both(scene, out, progress, announce, phases, resume, keep)


def _run_both(
    scene: Scene,
    out: RunFolder,
    progress: Callable[[int, int], bool | None] | None,
    announce: Callable[[str], None] | None,
    phases: Phases | None,
    resume: bool,
    keep: Keep,
) -> Outcome:
    """Run with slipping, then with sticking strands; what was done before a `resume` is not done again."""
    asked, n = False, scene.stations

    def part(first: int) -> Callable[[int, int], bool | None]:
        def told(done: int, total: int) -> bool | None:
            nonlocal asked
            asked = progress is not None and bool(progress(first + done, 2 * n))
            return asked

        return told

    folder = RunFolder(out.path / FOLDER, scene.inputs)
    if resume and not (out.path / CHECKPOINT).is_file():
        found = verdicts(json.loads((out.path / "summary.json").read_text(encoding="utf-8")))
        slip = Outcome(out.path, None, complete=True, before=tuple(found.values()))
    else:
        slip = _run_once(scene, out, part(0), announce, phases, resume, keep)
    if asked or slip.reason == "interrupted":
        return slip
    try:
        folder.path.mkdir(exist_ok=True)
    except OSError as error:
        return replace(slip, reason=_both(slip.reason, f"sticking strands: {_why(error)}"))
    resume &= (folder.path / CHECKPOINT).is_file()
    stick = _run_once(scene.sticking(), folder, part(n), announce, None, resume, keep)
    reason = _both(slip.reason, f"with sticking strands: {stick.reason}") if stick.reason else slip.reason
    try:
        _add_band(out.path, scene.banded, reason)
    except (OSError, ValueError) as error:
        reason = _both(reason, f"band in summary.json could not be written: {_why(error)}")
    by_chance = slip.by_chance or stick.by_chance
    complete = slip.complete and stick.complete
    return replace(slip, reason=reason, complete=complete, sticking=stick, by_chance=by_chance)


def _add_band(folder: pathlib.Path, rods: tuple[str, ...], reason: str) -> None:
    """Peaks of both runs, and what stopped either, into the summary of the first."""
    first, second = (json.loads((f / "summary.json").read_text(encoding="utf-8")) for f in (folder, folder / FOLDER))
    first["band"] = {"of": list(rods), "folder_of_stick": FOLDER, **compare_ends(first, second)}
    if found := verdicts(second):
        first["band"]["verdicts"] = {"stick": found}
    if "verdict" in first or "verdict" in second:
        first["verdict"] = overall([x.get("verdict", "SAFE") for x in (first, second)])
    if reason:
        first |= {"status": "stopped", "reason": reason}
    elif first["status"] != "converged":  # of a run that was resumed since
        first |= {"status": "converged", "reason": ""}
    text = json.dumps(first, indent=2) + "\n"
    replace_file(folder / "summary.json", lambda path: path.write_text(text, encoding="utf-8"))


def _run_once(
    scene: Scene,
    out: RunFolder,
    progress: Callable[[int, int], bool | None] | None,
    announce: Callable[[str], None] | None,
    phases: Phases | None,
    resume: bool,
    keep: Keep,
) -> Outcome:
    """Run a scene at one end of its stiffness into a folder that is held."""
    phases = phases or Phases()
    writer = _Writer(scene, out.path, phases, keep)
    try:
        if not resume:
            writer.text("scene.toml", scene.resolved())
        writer.summary("running", "resumed" if resume else "started")
    except OSError as error:
        raise SceneError(f"output folder {str(out.path)!r}: cannot be written: {error.strerror}.") from None

    def first() -> None:
        if announce is not None:
            announce("Compiling the kernels, once for this machine and version: about a minute.")

    clock = CompileClock(first)
    reason, history, by_chance = "", None, False
    try:
        with clock, phases.measure("solve"):
            history = _solve(scene, progress, out.path, resume)
        reason = history.message if history.status == "stopped" else ""
        by_chance = reason.startswith("interrupted")
    except ConvergenceError as error:
        reason, history = str(error), error.history
    except KeyboardInterrupt:
        reason, by_chance = "interrupted", True
    except MemoryError as error:
        reason, by_chance = out_of_memory(error), True
    except _FramesError as error:
        reason, history, by_chance = str(error), error.history, True
    except OSError as error:  # the only other files of a solution are those of the compiler
        by_chance = True
        reason = f"compiled kernels could not be kept: {_why(error)}. Set NUMBA_CACHE_DIR to a folder with space"
    except SceneError as error:
        error = scene.placed(error)
        with suppress(OSError):
            writer.summary("refused", str(error))
        raise error from None
    phases.wall["compile"] = round(clock.seconds, 4)
    if history is not None and not len(history):
        history = None
    if history is not None:
        with phases.measure("write"):
            unwritten = writer.results(history)
        reason, by_chance = _both(reason, unwritten), by_chance or bool(unwritten)
    message = history.message if history is not None else ""
    try:
        writer.summary("stopped" if reason else "converged", reason or message, history)
    except (OSError, MemoryError) as error:
        reason, by_chance = _both(reason, f"summary.json could not be written: {_why(error)}"), True
    if writer.complete and not reason:
        for name in (FRAMES, CHECKPOINT):
            (out.path / name).unlink(missing_ok=True)
    written, checks = tuple(writer.written), tuple(writer.checks)
    return Outcome(out.path, history, reason, written, writer.complete, by_chance, writer.verdicts, checks)


def resume_scene(
    folder: str | os.PathLike[str],
    *,
    progress: Callable[[int, int], bool | None] | None = None,
    announce: Callable[[str], None] | None = None,
    phases: Phases | None = None,
) -> Outcome:
    """Go on with a run in time that was stopped or killed, from its last checkpoint, bit for bit as if it never had been.

    Raises
    ------
    SceneError
        The folder is not one of a run, has no checkpoint, or its scene.toml was changed.
    """
    folder = pathlib.Path(folder)
    if folder.name == FOLDER and (folder.parent / "scene.toml").is_file():
        folder = folder.parent
    if not (folder / "scene.toml").is_file():
        raise SceneError(f"{folder}: is not the folder of a run (no scene.toml).")
    second = folder / FOLDER / CHECKPOINT
    read_checkpoint(second if second.is_file() else folder / CHECKPOINT)
    scene = load_scene(folder / "scene.toml")
    return run_scene(scene, folder, progress=progress, announce=announce, phases=phases, resume=True)


def _both(reason: str, more: str) -> str:
    return f"{reason.rstrip('.')}; {more}" if reason and more else reason or more


def _why(error: BaseException) -> str:
    """What the machine said, in one line."""
    if isinstance(error, MemoryError):
        return out_of_memory(error)
    return getattr(error, "strerror", None) or one_line(error)


def solve_scene(scene: Scene, start: State | None = None) -> History:
    """Solve a static or quasi-static scene from a state of its model; nothing is written."""
    return _solve(scene, None, pathlib.Path(), False, start)


def _solve(
    scene: Scene,
    progress: Callable[[int, int], bool | None] | None,
    folder: pathlib.Path,
    resume: bool,
    start: State | None = None,
) -> History:
    if scene.tables.solve.kind == "dynamic":
        return _solve_in_time(scene, progress, folder, resume)
    if scene.tables.solve.kind == "static":
        table = scene.tables.solve
        steps = table.steps if start is None else None
        history = solve_static(
            scene.model, t=float(scene.times[0]), start=start, steps=steps, accuracy=table.accuracy
        )  # fmt: skip
        if progress is not None:
            progress(1, 1)
        return history

    if scene.tables.solve.kind == "path":
        return _solve_path(scene, progress)
    asked = False

    def callback(k: int, state: State) -> bool | None:
        nonlocal asked
        asked = progress is not None and bool(progress(k + 1, scene.stations))
        return asked

    table = scene.tables.solve
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
        model = _solve(scene, None, pathlib.Path(), False).model

    def solve(variant: Model) -> History:
        if table.kind == "static":
            return solve_static(variant, t=float(scene.times[0]), steps=table.steps)
        if table.kind == "quasistatic":
            return solve_quasistatic(variant, scene.times)
        step = FixedStep(table.dt, table.richardson) if table.dt is not None else AdaptiveStep(table.rtol or 1e-4)
        velocity = None if table.velocity is None else RigidVelocity(**table.velocity.model_dump())
        return solve_dynamic(
            variant, float(scene.times[-1]), start=table.start, velocity=velocity, rho_inf=table.rho_inf, step=step,
            times=scene.times,
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


class _FramesError(Exception):
    """Frames or a checkpoint could not be written; what was found goes with it."""

    def __init__(self, message: str, history: History) -> None:
        super().__init__(message)
        self.history = history


def _solve_in_time(
    scene: Scene, progress: Callable[[int, int], bool | None] | None, folder: pathlib.Path, resume: bool
) -> History:
    """Run in time; kept states go to frames and, every few seconds, all that the rest depends on to a checkpoint."""
    table = scene.tables.solve
    identity = scene.identity
    saved: Checkpoint | None = None
    before: list[Record] = []
    counters: dict[str, int] = {}
    if resume:
        found, saved, counters = read_checkpoint(folder / CHECKPOINT)
        if found != identity:
            raise SceneError(
                f"{folder}: its scene or a file it reads was changed since the run began; start again with "
                "`cosserat-fem run`."
            )
        saved = with_terms(saved, scene.model)
        _, before = read_frames(folder / FRAMES, saved.kept)
    several = table.richardson or table.accuracy is not None  # runs; there is no one to go on with
    frames = None if several else FrameFile(folder / FRAMES, identity, saved.kept if saved else None)
    written, last, asked = 0, time.monotonic(), False

    def save(run: Run, frames: FrameFile) -> None:
        nonlocal written
        try:
            for record in run.history.records[written:]:
                frames.append(record)
                written += 1
            frames.sync()
            so_far = asdict(run.history.counters)
            so_far |= {name: so_far[name] + counters.get(name, 0) for name in COUNTED}
            write_checkpoint(folder / CHECKPOINT, identity, run.checkpoint(), so_far)
        except OSError as error:
            run.history.status = "stopped"
            run.history.message = f"t = {run.t:g} s: the run could not be saved: {_why(error)}"
            raise _FramesError(run.history.message, run.history) from None

    def callback(run: Run) -> bool | None:
        nonlocal asked, last
        asked = progress is not None and bool(progress(len(before) + len(run.history.records), len(scene.times)))
        if frames is not None and (asked or time.monotonic() - last > SAVE_EVERY):
            save(run, frames)
            last = time.monotonic()
        return asked

    step: FixedStep | AdaptiveStep | None = None
    if table.dt is not None:
        step = FixedStep(table.dt, table.richardson)
    elif table.accuracy is None:
        step = AdaptiveStep(table.rtol or 1e-4)
    velocity = None if table.velocity is None else RigidVelocity(**table.velocity.model_dump())
    end = float(scene.times[-1])
    try:
        history = solve_dynamic(
            scene.model, end, start=table.start, velocity=velocity, rho_inf=table.rho_inf, step=step,
            times=scene.times, callback=callback, resume=saved, accuracy=table.accuracy,
        )  # fmt: skip
    except (_FramesError, ConvergenceError) as error:
        if error.history is not None:
            error.history.records[:0] = before
        raise
    finally:
        if frames is not None:
            frames.close()
    history.records[:0] = before
    for name in COUNTED:
        setattr(history.counters, name, getattr(history.counters, name) + counters.get(name, 0))
    if asked:
        resumable = "" if several else f"; `cosserat-fem resume {folder}` goes on"
        history.message = f"asked to stop at t = {history.t[-1] if len(history) else 0:g} s{resumable}"
    return history


def rebuild(folder: pathlib.Path) -> History:
    """History of a run in time that was killed, from its frames. SceneError if there are none."""
    if not (folder / FRAMES).is_file():
        raise SceneError(f"{folder}: has neither history.vtkhdf nor {FRAMES}.")
    scene = load_scene(folder / "scene.toml")
    _, records = read_frames(folder / FRAMES)
    history = History(scene.model, records, "stopped", "rebuilt from frames")
    _Writer(scene, folder, Phases()).results(history)
    return history


class _Writer:
    """Results of one run into its folder."""

    def __init__(self, scene: Scene, folder: pathlib.Path, phases: Phases, keep: Keep = ALL) -> None:
        self.scene, self.folder, self.phases, self.keep = scene, folder, phases, keep
        self.written: list[str] = []
        self.complete = False
        self.modes: Modes | None = None
        self.verdicts: dict[str, dict[str, Any]] = {}
        self.checks: list[Verdict] = []

    def text(self, name: str, text: str) -> None:
        replace_file(self.folder / name, lambda path: path.write_text(text, encoding="utf-8"))

    def results(self, history: History) -> str:
        """Write all results, or say why not."""
        try:
            with self.phases.measure("checks") if self.scene.checks else nullcontext():
                self.checks = assess(history, self.scene.checks, self.scene.parts)
        except KeyboardInterrupt:
            return "interrupted while limits were checked"
        except (MemoryError, CosseratError) as error:
            return f"limits could not be checked: {_why(error)}"
        writers: tuple[Callable[..., None], ...] = (
            write_reactions,
            write_hinge_torque,
            self._history,
            partial(write_parts, parts=self.scene.parts),
        )
        named = dict(zip(RESULTS, writers, strict=True))
        if history.model.contacts:
            named |= dict(zip(TOUCHING, (write_contacts, write_contact_loads), strict=True))
        if history.dynamic:
            named |= {"ledger.csv": write_ledger, "steps.csv": write_steps}
        if self.scene.drives or turns_back(history):
            driven = write_joint_models, partial(write_drives, drives=self.scene.drives)
            named |= dict(zip(DRIVEN[: 2 if self.scene.drives else 1], driven, strict=False))
        if history.path:
            named["path.csv"] = write_path
        if self.scene.checks:
            kept = (partial(write, verdicts=self.checks) for write in (write_checks, write_margins))
            named |= dict(zip(CHECKED, kept, strict=True))
        for name, write in named.items():
            if self.keep.results is not None and name not in self.keep.results:
                continue
            try:
                write(history, self.folder / name)
            except KeyboardInterrupt:
                return f"interrupted while {name} was written"
            except (OSError, MemoryError, CosseratError) as error:
                return f"{name} could not be written: {_why(error)}"
            self.written.append(name)
        reason = self._vibrations(history)
        self.complete = not reason
        return reason

    def _history(self, history: History, path: pathlib.Path) -> None:
        """The history for ParaView, with the margins of checks."""
        if not self.checks:
            write_history(history, path)
            return
        names = [verdict.name for verdict in self.checks]
        write_history(history, path, margin_fields(history, self.checks), {"checks": names})

    def _vibrations(self, history: History) -> str:
        """Find and write the vibrations about the last state if the scene asks for them, or say why not."""
        if self.scene.tables.solve.modes is None:
            return ""
        record, model = history.records[-1], history.model
        if record.factor is not None:
            model = model.with_factor(record.factor, self.scene.loads)
        try:
            self.modes = modes(model, record.state, self.scene.tables.solve.modes)
            for name, write in (("modes.csv", write_modes), ("modes.vtkhdf", write_shapes)):
                write(self.modes, self.folder / name)
                self.written.append(name)
        except KeyboardInterrupt:
            return "interrupted while vibrations were looked for"
        except (OSError, MemoryError, CosseratError) as error:
            return f"vibrations: {_why(error)}"
        return ""

    def summary(self, status: str, reason: str, history: History | None = None) -> None:
        data: dict[str, Any] = {
            "program": PROGRAM,
            "version": metadata.version(PROGRAM),
            "title": self.scene.title,
            "status": status,
            "reason": reason,
        }
        if history is not None and len(history):
            parts = self.scene.parts if self.keep.clearances else ()
            data |= describe(history, parts, clearances(self.checks))
            data |= tell(self.checks) if self.checks else {}
            if self.keep.errors:
                with self.phases.measure("estimate"):
                    try:
                        told = partial(self._described, history)
                        data["discretisation"] = add_errors(data, history, told, parts)
                    except MemoryError as error:
                        data["discretisation"] = {"not_found": out_of_memory(error)}
            for drive in self.scene.drives:
                self.verdicts[drive.part.name] = describe_drive(history, drive)
                data["hinges"][drive.part.name]["drive"] = self.verdicts[drive.part.name]
            if self.checks:
                self.checks = judged(self.checks, history, data)
                self._clearances(history, data)
                warn_of_parts(self.checks, history, data)
            if self.modes is not None:
                data["vibrations"] = describe_modes(self.modes)
            if self.scene.tables.solve.out_of_plane and self.scene.model.plane is not None:
                data["out_of_plane"] = out_of_plane(history)
        if self.scene.checks and status in ("converged", "stopped"):
            found = [check.status for check in self.checks] or ["UNKNOWN"]
            data["verdict"] = overall([*found, *(said["verdict"] for said in self.verdicts.values())])
        if self.scene.catalogue:
            data["catalogue"] = {name: sources(name) for name in self.scene.catalogue}
        data |= {
            "warnings": self.scene.model.warnings,
            "seconds": {"wall": self.phases.wall, "cpu": self.phases.cpu},
            "versions": {"python": platform.python_version(), **{p: metadata.version(p) for p in PACKAGES}},
            "platform": platform.platform(),
        }
        self.text("summary.json", json.dumps(data, indent=2) + "\n")

    def _described(self, history: History, found: History, parts: Sequence[Part] = ()) -> dict[str, Any]:
        """What is reported of a better state of a history, checks too."""
        more = found_at(self.checks, history, found, self.scene.parts) if self.checks else {}
        return describe_peaks(found, parts, clearances(self.checks)) | more

    def _clearances(self, history: History, data: dict[str, Any]) -> None:
        """Clearances that were checked among those that are reported anyway, unless the rod may touch there."""
        touched = {(rod.name, t.part.name) for t in history.model.contacts if hasattr(t, "part") for rod in t.rods}
        for (rod, part), verdict in clearances(self.checks).items():
            if (rod, part) not in touched:
                said = told_clearance(history.rod(rod), verdict.value, verdict.t, verdict.check.left_out)
                said["error"] = data["checks"][verdict.name]["worst"].get("error")
                data.setdefault("clearances", {}).setdefault(rod, {})[part] = said


@dataclass(frozen=True)
class Drawing:
    """What the drawing process made, or why it did not; `wrong` if an argument was."""

    paths: tuple[pathlib.Path, ...] = ()
    problem: str = ""
    wrong: bool = False


def draw(folder: pathlib.Path, *arguments: str) -> Drawing:
    """Make plots and pictures of a run folder in another process.

    Rendering without a usable OpenGL library ends the process it happens in, so it must not be this one.
    """
    environment = dict(os.environ)
    if sys.platform.startswith("linux") and not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    command = [sys.executable, "-m", "cosserat_fem.view", str(folder), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode == 0:
        return Drawing(tuple(pathlib.Path(line) for line in done.stdout.splitlines()))
    lines = (done.stderr or done.stdout).strip().splitlines()
    said = lines[-1] if lines else f"exit code {done.returncode}"
    if done.returncode in (-signal.SIGINT, -signal.SIGTERM, -9):
        how = {-signal.SIGINT: "interrupted", -9: "killed, perhaps for lack of memory"}.get(done.returncode, "ended")
        return Drawing(problem=f"the drawing process was {how}. `cosserat-fem render {folder}` starts it again.")
    if done.returncode < 0:
        return Drawing(
            problem="pictures need a software OpenGL library, which this machine lacks (on Debian and Ubuntu: "
            "apt-get install libegl1 libgl1-mesa-dri). All results are complete; `cosserat-fem render` draws them later."
        )
    if done.returncode == 2:
        return Drawing(problem=said, wrong=True)
    return Drawing(problem=f"pictures could not be made: {said}")
