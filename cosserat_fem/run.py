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
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np

from .accuracy import add_errors
from .checks import bend_radius, clearance, distance_from_drawing, worst
from .continuation import STEPS, trace_path
from .dynamics import RigidVelocity, solve_dynamic
from .errors import ConvergenceError, CosseratError, SceneError, one_line, out_of_memory
from .export import (
    hinged_parts,
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
from .folder import PROGRAM, RESULTS, TOUCHING, RunFolder
from .frames import CHECKPOINT, FRAMES, FrameFile, read_checkpoint, read_frames, with_terms, write_checkpoint
from .history import History, Record
from .integrator import AdaptiveStep, Checkpoint, FixedStep, Run
from .kernels import CompileClock
from .mechanism import Hinge, Part
from .model import Model
from .scene import Scene, load_scene
from .space import State
from .stability import leaves_plane
from .statics import solve_quasistatic, solve_static
from .theories import Comparison, compare_theories
from .vibration import Modes, modes

PACKAGES = ("numpy", "scipy", "scikit-fem", "numba", "meshio", "pyvista", "vtk", "h5py", "pyamg")
COUNTED = ("iterations", "residuals")  # counters that go on in a resumed run
NEARBY = 3.0  # radii on both sides of a support on a part: clearance from the part is not looked at there
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


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a run left: its folder, history (None if nothing was found), the reason if it stopped early, files written."""

    folder: pathlib.Path
    history: History | None
    reason: str = ""
    written: tuple[str, ...] = ()
    complete: bool = False  # every result of the history is on the disk


def run_scene(
    scene: Scene,
    out: str | os.PathLike[str] | RunFolder | None = None,
    *,
    force: bool = False,
    progress: Callable[[int, int], bool | None] | None = None,
    announce: Callable[[str], None] | None = None,
    phases: Phases | None = None,
    resume: bool = False,
) -> Outcome:
    """Run a scene and write its results, without pictures (see `draw`). Ctrl-C stops it; what was found is written.

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

    Raises
    ------
    SceneError
        The folder cannot be used, or the model cannot be solved as it is meant.
    """
    if not isinstance(out, RunFolder):
        with RunFolder(scene.folder if out is None else out, scene.inputs, force=force, resume=resume) as held:
            return run_scene(scene, held, progress=progress, announce=announce, phases=phases, resume=resume)
    phases = phases or Phases()
    writer = _Writer(scene, out.path, phases)
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
    reason, history = "", None
    try:
        with clock, phases.measure("solve"):
            history = _solve(scene, progress, out.path, resume)
        reason = history.message if history.status == "stopped" else ""
    except ConvergenceError as error:
        reason, history = str(error), error.history
    except KeyboardInterrupt:
        reason = "interrupted"
    except MemoryError as error:
        reason = out_of_memory(error)
    except _FramesError as error:
        reason, history = str(error), error.history
    except OSError as error:  # the only other files of a solution are those of the compiler
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
            reason = _both(reason, writer.results(history))
    message = history.message if history is not None else ""
    try:
        writer.summary("stopped" if reason else "converged", reason or message, history)
    except (OSError, MemoryError) as error:
        reason = _both(reason, f"summary.json could not be written: {_why(error)}")
    if writer.complete and not reason:
        for name in (FRAMES, CHECKPOINT):
            (out.path / name).unlink(missing_ok=True)
    return Outcome(out.path, history, reason, tuple(writer.written), writer.complete)


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
    if not (folder / "scene.toml").is_file():
        raise SceneError(f"{folder}: is not the folder of a run (no scene.toml).")
    read_checkpoint(folder / CHECKPOINT)
    scene = load_scene(folder / "scene.toml")
    return run_scene(scene, folder, progress=progress, announce=announce, phases=phases, resume=True)


def _both(reason: str, more: str) -> str:
    return f"{reason.rstrip('.')}; {more}" if reason and more else reason or more


def _why(error: BaseException) -> str:
    """What the machine said, in one line."""
    if isinstance(error, MemoryError):
        return out_of_memory(error)
    return getattr(error, "strerror", None) or one_line(error)


def _solve(
    scene: Scene, progress: Callable[[int, int], bool | None] | None, folder: pathlib.Path, resume: bool
) -> History:
    if scene.tables.solve.kind == "dynamic":
        return _solve_in_time(scene, progress, folder, resume)
    if scene.tables.solve.kind == "static":
        table = scene.tables.solve
        history = solve_static(scene.model, t=float(scene.times[0]), steps=table.steps, accuracy=table.accuracy)
        if progress is not None:
            progress(1, 1)
        return history

    if scene.tables.solve.kind == "path":
        return _solve_path(scene, progress)
    asked = False

    def callback(k: int, state: State) -> bool | None:
        nonlocal asked
        asked = progress is not None and bool(progress(k + 1, len(scene.times)))
        return asked

    table = scene.tables.solve
    history = solve_quasistatic(
        scene.model, scene.times, past_limits=table.past_limits, callback=callback, accuracy=table.accuracy
    )
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

    def __init__(self, scene: Scene, folder: pathlib.Path, phases: Phases) -> None:
        self.scene, self.folder, self.phases = scene, folder, phases
        self.written: list[str] = []
        self.complete = False
        self.modes: Modes | None = None

    def text(self, name: str, text: str) -> None:
        replace_file(self.folder / name, lambda path: path.write_text(text, encoding="utf-8"))

    def results(self, history: History) -> str:
        """Write all results, or say why not."""
        writers: tuple[Callable[..., None], ...] = (
            write_reactions,
            write_hinge_torque,
            write_history,
            partial(write_parts, parts=self.scene.parts),
        )
        named = dict(zip(RESULTS, writers, strict=True))
        if history.model.contacts:
            named |= dict(zip(TOUCHING, (write_contacts, write_contact_loads), strict=True))
        if history.dynamic:
            named |= {"ledger.csv": write_ledger, "steps.csv": write_steps}
        if history.path:
            named["path.csv"] = write_path
        for name, write in named.items():
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
            data |= describe(history, self.scene.parts)
            with self.phases.measure("estimate"):
                try:
                    data["discretisation"] = add_errors(data, history, describe, self.scene.parts)
                except MemoryError as error:
                    data["discretisation"] = {"not_found": out_of_memory(error)}
            if self.modes is not None:
                data["vibrations"] = _describe_modes(self.modes)
            if self.scene.tables.solve.out_of_plane and self.scene.model.plane is not None:
                data["out_of_plane"] = _out_of_plane(history)
        data |= {
            "warnings": self.scene.model.warnings,
            "seconds": {"wall": self.phases.wall, "cpu": self.phases.cpu},
            "versions": {"python": platform.python_version(), **{p: metadata.version(p) for p in PACKAGES}},
            "platform": platform.platform(),
        }
        self.text("summary.json", json.dumps(data, indent=2) + "\n")


def describe(history: History, parts: Sequence[Part] = ()) -> dict[str, Any]:
    """What a summary says of a history: counters, residual, strains, bend radius, distances, peaks, active physics.

    parts: those that rods should stay clear of, besides those that they may touch.
    """
    model = history.model
    contacts = {term.name: _describe_contact(history, term.name) for term in model.contacts}
    clear = _clearances(history, parts)
    terms = [model.internal.name, *(term.name for term in model.terms)]
    return {
        "stations": {"kept": len(history), "first": float(history.t[0]), "last": float(history.t[-1])},
        **({"path": _describe_path(history)} if history.path or history.critical else {}),
        "counters": asdict(history.counters) | {"most_iterations": max(r.iterations for r in history.records)},
        "worst_residual": max(r.residual for r in history.records),
        **({"in_time": _describe_motion(history)} if history.dynamic else {"stable": _stability(history)}),
        "physics": {
            "terms": terms,
            "cpu_seconds": {name: round(spent, 6) for name, spent in model.spent.items()},
            "rotation": model.rotation,
            "theory": model.theory,
            "plane": model.plane.name if model.plane is not None else None,
            "plane_choice": model.plane_choice,
            "supports": [str(h.name) for h in model.supports],
            "welds": len(model.welds),
            "unknowns": (6 if model.plane is None else 3) * model.space.n_nodes,
            **({"chosen": asdict(history.chosen)} if history.chosen is not None else {}),
        },
        "rods": {rod.name: _describe_rod(history, rod) for rod in model.rods},
        "reactions": {str(h.name): _describe_reaction(history, h) for h in model.supports},
        "hinges": {part.name: _describe_hinge(history, part) for part in hinged_parts(history)},
        **({"contacts": contacts} if contacts else {}),
        **({"clearances": clear} if clear else {}),
    }


def _describe_path(history: History) -> dict[str, Any]:
    """Extent of a path and its critical points; `after_station` counts from 0."""
    return {
        "factor": {"first": float(history.factors[0]), "last": float(history.factors[-1])},
        "critical": [
            {
                "kind": event.kind,
                "value": float(event.value),
                "t": float(event.t),
                "negative_eigenvalues": [event.before, event.after],
                "after_station": event.station,
            }
            for event in history.critical
        ],
    }


def _describe_modes(found: Modes) -> dict[str, Any]:
    """Vibrations about the last state."""
    return {
        "stable": found.stable,
        "frequency_Hz": found.frequency.tolist(),
        "growth_per_s": found.growth.tolist(),
    }


def _describe_motion(history: History) -> dict[str, Any]:
    """Steps, energies and works at the end, momentum, and how far the ledger is open."""
    accepted = [h for _, h, _, taken in history.steps if taken]
    linear, angular = history.momentum
    return {
        "steps": {
            "accepted": len(accepted),
            "rejected": len(history.steps) - len(accepted),
            "shortest": min(accepted, default=0.0),
            "longest": max(accepted, default=0.0),
        },
        "ledger": {name: float(values[-1]) for name, values in history.ledger.items()},
        "ledger_gap": history.ledger_gap,
        "linear_momentum": linear[-1].tolist(),
        "angular_momentum": angular[-1].tolist(),
        **({"extrapolated_from": history.extrapolated} if history.extrapolated is not None else {}),
    }


def _stability(history: History) -> str:
    known = [s for s in history.stable if s is not None]
    if not known:
        return "not judged: a load has no potential"
    unstable = [f"{x:g}" for x, s in zip(history.order, history.stable, strict=True) if s is False]
    if not unstable:
        return "stable at every station"
    more = f" and {len(unstable) - 10} more" if len(unstable) > 10 else ""
    stations = ", ".join(unstable[:10]) + more
    return f"unstable at stations {stations}" if history.path else f"unstable at t = {stations} s"


def _out_of_plane(history: History) -> list[int | None]:
    """In how many ways each state would leave the plane of its model; a warning if any would."""
    ways = leaves_plane(history)
    leaving = [f"{t:g}" for t, n in zip(history.t, ways, strict=True) if n]
    if leaving:
        history.model.warn(
            f"at t = {', '.join(leaving[:5])}{' and more' if len(leaving) > 5 else ''} s a real rod would leave the plane "
            f'"{history.model.plane.name}" of this run. Leave `plane` out to see where it goes.'  # type: ignore[union-attr]
        )
    return ways


def _describe_rod(history: History, rod: Any) -> dict[str, Any]:
    t, stations, nodes = history.t, history.stations(rod), history.nodes(rod)
    strain = history.strains(rod)
    names = ("shear 1", "shear 2", "stretch", "bend 1 [1/m]", "bend 2 [1/m]", "twist [1/m]")
    radius = worst(bend_radius(history, rod, at="nodes"), t, nodes, largest=False)
    distance = distance_from_drawing(history, rod)
    stretch = np.linalg.norm(history.total_strains(rod)[..., :3], axis=-1)
    group = history.model.space.groups[history.model.space[rod].group]
    dx = group.dx[history.model.space[rod].elements].ravel()
    lengths = stretch @ dx
    return {
        "elements": len(history.model.space[rod].vertices) - 1,
        "order": history.model.space[rod].mesh.order,
        "length": {"free": float(rod.length), "drawn": float(rod.drawn_length), "longest": float(lengths.max())},
        "largest_strain": {name: worst(np.abs(strain[..., k]), t, stations) for k, name in enumerate(names)},
        "smallest_bend_radius": radius if np.isfinite(radius["value"]) else None,
        "from_drawn_route": {
            "first station": worst(distance[:1], t[:1], nodes),
            "whole run": worst(distance, t, nodes),
        },
    }


def _describe_reaction(history: History, support: Any) -> dict[str, Any]:
    loads = history.reaction(support)
    out = {}
    for name, part in (("force", loads[:, :3]), ("moment", loads[:, 3:])):
        size = np.linalg.norm(part, axis=1)
        k = int(np.argmax(size))
        out[f"largest_{name}"] = {"value": float(size[k]), "t": float(history.t[k])}
    return out


def _describe_hinge(history: History, part: Any) -> dict[str, Any]:
    torque, angle = history.hinge_torque(part), np.degrees(history.hinge_angle(part))
    k = int(np.argmax(np.abs(torque)))
    hinge: Hinge = part.motion
    return {
        "axis": hinge.axis.tolist(),
        "largest_torque": {"value": float(torque[k]), "angle_deg": float(angle[k]), "t": float(history.t[k])},
        "last_torque": float(torque[-1]),
    }


def _describe_contact(history: History, name: str) -> dict[str, Any]:
    """When a contact touches, its largest line force and load, the work that friction took, the smallest gap."""
    told, t = history.pressed(name), history.t
    events = [event for event in history.contacts() if event.name == name]
    peak = max(range(len(told)), key=lambda k: told[k].peak)
    force = np.linalg.norm([p.load[:3] for p in told], axis=1)
    gap = min(range(len(told)), key=lambda k: told[k].gap)
    near = np.isfinite(told[gap].gap)
    return {
        "between": [told[0].rod, told[0].other],
        "touches": [[event.begin, event.end] for event in events],
        "largest_line_force": {"value": told[peak].peak, "s": told[peak].peak_s, "t": float(t[peak])},
        "largest_force": {"value": float(force.max()), "t": float(t[np.argmax(force)])},
        "friction_work": told[-1].lost,
        "smallest_gap": {"value": told[gap].gap, "s": told[gap].gap_s, "t": float(t[gap])} if near else None,
    }


def _clearances(history: History, parts: Sequence[Part]) -> dict[str, Any]:
    """Smallest distance of each rod from each part with a surface that it may not touch.

    Within a few radii of a support on the part it is not looked at: there it is meant to be close.
    """
    touched = {(rod, term.part) for term in history.model.contacts if hasattr(term, "part") for rod in term.rods}
    out: dict[str, Any] = {}
    for rod in history.model.rods:
        for part in parts:
            if (rod, part) in touched or not (part.shapes or part.mesh is not None):
                continue
            held = [h.rod.place(h.at, "support") for h in history.model.supports if h.rod is rod and h.to is part]
            beside = [NEARBY * float(rod.radius_at(np.array([s]))[0]) for s in held]
            spans = [(s - a, s + a) for s, a in zip(held, beside, strict=True)]
            values = clearance(history, rod, part, leave_out=spans)
            k = int(np.argmin(values))
            if np.isfinite(values[k]):
                said: dict[str, Any] = {"value": float(values[k]), "t": float(history.t[k])}
                if spans:
                    said["left_out"] = [[max(a, 0.0), min(b, float(rod.length))] for a, b in spans]
                out.setdefault(rod.name, {})[part.name] = said
    return out


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
