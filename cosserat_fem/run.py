"""What happens when a scene is run? Folder, solution, results, summary; pictures are made later (`drawing`).

Rule: the folder is touched only after the scene was found valid, and by one run at a time; `summary.json` is there from
the first moment and says how far the run came.
"""

from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from .cables.band import FOLDER, compare_ends, verdicts
from .errors import ConvergenceError, SceneError, cause, out_of_memory
from .export import replace_file
from .folder import RunFolder
from .frames import CHECKPOINT, FRAMES, read_checkpoint, read_frames
from .history import History
from .kernels import CompileClock
from .limits.verdicts import Verdict, overall
from .results import ALL, Keep, Phases, ResultWriter
from .scene import Scene, load_scene
from .solving import FramesError, solve_scene


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
    """Run a scene and write its results, without pictures (see `drawing.draw`). Ctrl-C stops it; what was found is written.

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
    if asked or slip.by_chance:
        return slip
    try:
        folder.path.mkdir(exist_ok=True)
    except OSError as error:
        return replace(slip, reason=_both(slip.reason, f"sticking strands: {cause(error)}"))
    resume &= (folder.path / CHECKPOINT).is_file()
    stick = _run_once(scene.sticking(), folder, part(n), announce, None, resume, keep)
    reason = _both(slip.reason, f"with sticking strands: {stick.reason}") if stick.reason else slip.reason
    try:
        _add_band(out.path, scene.banded, reason)
    except (OSError, ValueError) as error:
        reason = _both(reason, f"band in summary.json could not be written: {cause(error)}")
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
    writer = ResultWriter(scene, out.path, phases, keep)
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
            history = solve_scene(scene, progress=progress, folder=out.path, resume=resume)
        reason = history.message if history.status == "stopped" else ""
        by_chance = reason.startswith("interrupted")
    except ConvergenceError as error:
        reason, history = str(error), error.history
    except KeyboardInterrupt:
        reason, by_chance = "interrupted", True
    except MemoryError as error:
        reason, by_chance = out_of_memory(error), True
    except FramesError as error:
        reason, history, by_chance = str(error), error.history, True
    except OSError as error:  # the only other files of a solution are those of the compiler
        by_chance = True
        reason = f"compiled kernels could not be kept: {cause(error)}. Set NUMBA_CACHE_DIR to a folder with space"
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
        reason, by_chance = _both(reason, f"summary.json could not be written: {cause(error)}"), True
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


def rebuild(folder: pathlib.Path) -> History:
    """History of a run in time that was killed, from its frames. SceneError if there are none."""
    if not (folder / FRAMES).is_file():
        raise SceneError(f"{folder}: has neither history.vtkhdf nor {FRAMES}.")
    scene = load_scene(folder / "scene.toml")
    _, records = read_frames(folder / FRAMES)
    history = History(scene.model, records, "stopped", "rebuilt from frames")
    ResultWriter(scene, folder, Phases()).results(history)
    return history
