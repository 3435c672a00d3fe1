"""What happens when a scene is run? Folder, solution, results, summary; pictures last.

Rule: the folder is touched only after the scene was found valid; `summary.json` is there from the first moment and says
how far the run came; every result is written whole or not at all; pictures are made by another process when everything
else is safe.
"""

from __future__ import annotations

import json
import os
import pathlib
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib import metadata
from typing import Any

import numpy as np

from .checks import bend_radius, distance_from_drawing, worst
from .errors import ConvergenceError, SceneError
from .export import hinged_parts, replace_file, write_hinge_torque, write_history, write_parts, write_reactions
from .history import History
from .kernels import CompileClock
from .mechanism import Hinge
from .scene import Scene
from .space import State
from .statics import solve_quasistatic, solve_static

PROGRAM = "cosserat_fem"
PACKAGES = ("numpy", "scipy", "scikit-fem", "numba", "meshio", "pyvista", "vtk", "h5py", "pyamg")
FILES = (
    "scene.toml",
    "history.vtkhdf",
    "parts.vtkhdf",
    "reactions.csv",
    "hinge_torque.csv",
    "history.pvd",
    "summary.json",
)
FOLDERS = ("pictures", "pvd")


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
    """What a run left: its folder, history (None if nothing was found) and the reason if it stopped early."""

    folder: pathlib.Path
    history: History | None
    reason: str = ""


def run_scene(
    scene: Scene,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    progress: Callable[[int, int], bool | None] | None = None,
    announce: Callable[[str], None] | None = None,
    phases: Phases | None = None,
) -> Outcome:
    """Run a scene and write its results, without pictures (see `draw`).

    Parameters
    ----------
    out : folder, default `scene.folder`
    force : bool
        Write into a folder that holds other files too; they are left alone.
    progress : function (stations done, stations in all) -> bool
        Called after each station; return True to stop there.
    announce : function (text)
        Told when kernels are compiled for the first time on this machine.

    Raises
    ------
    SceneError
        The folder cannot be used, or the model cannot be solved as it is meant.
    """
    folder = pathlib.Path(out) if out is not None else scene.folder
    prepare_folder(folder, force=force)
    phases = phases or Phases()
    writer = _Writer(scene, folder, phases)
    try:
        writer.summary("running", "started")
        writer.text("scene.toml", scene.resolved())
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r}: cannot be written: {error.strerror}.") from None

    def first() -> None:
        if announce is not None:
            announce("Compiling the kernels, once for this machine and version: about 20 seconds.")

    clock = CompileClock(first)
    reason, history = "", None
    try:
        with clock, phases.measure("solve"):
            history = _solve(scene, progress)
        reason = history.message if history.status == "stopped" else ""
    except ConvergenceError as error:
        reason, history = str(error), error.history
    except KeyboardInterrupt:
        reason = "interrupted"
    except SceneError as error:
        writer.summary("refused", str(error))
        raise
    phases.wall["compile"] = round(clock.seconds, 4)
    if history is not None and len(history):
        with phases.measure("write"):
            try:
                writer.results(history)
            except OSError as error:
                reason = f"results could not be written: {error.strerror or error}"
    message = history.message if history is not None else ""
    writer.summary("stopped" if reason else "converged", reason or message, history)
    return Outcome(folder, history if history is not None and len(history) else None, reason)


def _solve(scene: Scene, progress: Callable[[int, int], bool | None] | None) -> History:
    if scene.tables.solve.kind == "static":
        history = solve_static(scene.model, t=float(scene.times[0]), steps=scene.tables.solve.steps)
        if progress is not None:
            progress(1, 1)
        return history

    def callback(k: int, state: State) -> bool | None:
        return progress(k + 1, len(scene.times)) if progress is not None else None

    return solve_quasistatic(scene.model, scene.times, callback=callback)


def prepare_folder(folder: pathlib.Path, *, force: bool = False) -> None:
    """Make the folder, or clear an earlier run of ours out of it. SceneError if it holds anything else."""
    where = f"output folder {str(folder)!r}"
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"{where}: is a file. Choose another with -o.")
    try:
        present = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
    except OSError as error:
        raise SceneError(f"{where}: cannot be read: {error.strerror}.") from None
    ours = _is_ours(folder)
    strangers = [name for name in present if not (ours and _is_known(name))]
    if strangers and not force:
        beside = "beside an earlier run" if ours else "and is not an earlier run of this program"
        raise SceneError(
            f"{where}: holds {strangers[0]!r} {beside}. Choose another with -o, or use --force to write into it; its "
            "other files stay."
        )
    try:
        for name in present:
            if _is_known(name) and (folder / name).is_dir():
                shutil.rmtree(folder / name)
            elif _is_known(name):
                (folder / name).unlink()
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"{where}: cannot be written: {error.strerror}. Choose another with -o.") from None


def _is_known(name: str) -> bool:
    """A file or folder that a run makes, or the temporary form of one (see `replace_file`)."""
    return name in FILES + FOLDERS or any(name.startswith(f".{file.rsplit('.', 1)[0]}-") for file in FILES)


def _is_ours(folder: pathlib.Path) -> bool:
    try:
        return json.loads((folder / "summary.json").read_text(encoding="utf-8")).get("program") == PROGRAM
    except (OSError, ValueError, AttributeError):
        return False


class _Writer:
    """Results of one run into its folder."""

    def __init__(self, scene: Scene, folder: pathlib.Path, phases: Phases) -> None:
        self.scene, self.folder, self.phases = scene, folder, phases

    def text(self, name: str, text: str) -> None:
        replace_file(self.folder / name, lambda path: path.write_text(text, encoding="utf-8"))

    def results(self, history: History) -> None:
        write_reactions(history, self.folder / "reactions.csv")
        write_hinge_torque(history, self.folder / "hinge_torque.csv")
        write_history(history, self.folder / "history.vtkhdf")
        write_parts(history, self.folder / "parts.vtkhdf")

    def summary(self, status: str, reason: str, history: History | None = None) -> None:
        data: dict[str, Any] = {
            "program": PROGRAM,
            "version": metadata.version(PROGRAM),
            "title": self.scene.title,
            "status": status,
            "reason": reason,
        }
        if history is not None and len(history):
            data |= describe(history)
        data |= {
            "warnings": self.scene.model.warnings,
            "seconds": {"wall": self.phases.wall, "cpu": self.phases.cpu},
            "versions": {"python": platform.python_version(), **{p: metadata.version(p) for p in PACKAGES}},
            "platform": platform.platform(),
        }
        self.text("summary.json", json.dumps(data, indent=2) + "\n")


def describe(history: History) -> dict[str, Any]:
    """What a summary says of a history: counters, residual, strains, bend radius, distances, peaks, active physics."""
    model = history.model
    terms = [model.internal.name, *(term.name for term in model.terms)]
    return {
        "stations": {"kept": len(history), "first": float(history.t[0]), "last": float(history.t[-1])},
        "counters": asdict(history.counters) | {"most_iterations": max(r.iterations for r in history.records)},
        "worst_residual": max(r.residual for r in history.records),
        "stable": _stability(history),
        "physics": {
            "terms": terms,
            "rotation": model.rotation,
            "supports": [str(h.name) for h in model.supports],
            "welds": len(model.welds),
            "unknowns": 6 * model.space.n_nodes,
        },
        "rods": {rod.name: _describe_rod(history, rod) for rod in model.rods},
        "reactions": {str(h.name): _describe_reaction(history, h) for h in model.supports},
        "hinges": {part.name: _describe_hinge(history, part) for part in hinged_parts(history)},
    }


def _stability(history: History) -> str:
    known = [s for s in history.stable if s is not None]
    if not known:
        return "not judged: a load has no potential"
    unstable = [f"{t:g}" for t, s in zip(history.t, history.stable, strict=True) if s is False]
    return f"unstable at t = {', '.join(unstable[:10])} s" if unstable else "stable at every station"


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
        "order": rod.order,
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


def draw(folder: pathlib.Path, *arguments: str) -> str:
    """Make plots and pictures of a run folder in another process; return what went wrong, or nothing.

    Rendering without a usable OpenGL library ends the process it happens in, so it must not be this one.
    """
    environment = dict(os.environ)
    if sys.platform.startswith("linux") and not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    command = [sys.executable, "-m", "cosserat_fem.view", str(folder), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return (
            "pictures need a software OpenGL library, which this machine lacks (on Debian and Ubuntu: "
            "apt-get install libegl1 libgl1-mesa-dri). All results are complete; `cosserat-fem render` draws them later."
        )
    lines = (done.stderr or done.stdout).strip().splitlines()
    return f"pictures could not be made: {lines[-1] if lines else f'exit code {done.returncode}'}"
