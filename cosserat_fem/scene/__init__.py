"""What does this TOML file mean? Scenes: read, checked, built, written back.

Rule: a table that is absent is physics that is absent. `load_scene` finds all faults or returns a scene that can be run;
nothing is solved here.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np

from ..accuracy.refine import check_accuracy
from ..drive import Drive
from ..equilibrium.continuation import STEPS
from ..equilibrium.march import Resolution, Watch
from ..errors import SceneError
from ..limits.allowed import Check
from ..mechanism import Part
from ..model import Model
from ..motion.dynamics import check_dynamic
from ..terms import Term
from .aim import design_faults
from .build import Builder
from .edit import changed, said
from .limits import build_checks
from .lines import Path
from .load import Source, read, validate
from .tables import SceneTables
from .vary import cases, sweep_faults
from .written import foreign, identity, read_files, resolved

ONE = {"static": "a static scene is one state", "path": "a path chooses its states itself"}
SHIPPED = "satellite_hinge.toml"


@dataclass(frozen=True, eq=False)
class Scene:
    """A checked scene: its tables, its model, its parts and the times to solve for.

    parts: all of them, also those that hold no rod and are not in the model.
    times (T,) [s]: stations of a quasi-static run, kept states of a run in time; the one time of a static run; first and
    last time of a path. loads: those that a path multiplies. drives: what turns hinges. checks: limits on what is found.
    banded: rods whose stiffness is a band; the model is that of slipping strands, and `sticking` the scene at the other end.
    catalogue: cables of the catalogue that the scene names.
    """

    source: Source
    tables: SceneTables
    model: Model
    parts: tuple[Part, ...]
    times: np.ndarray
    contact_of: Callable[[str], Path] = field(repr=False)
    loads: tuple[Term, ...] = ()
    drives: tuple[Drive, ...] = ()
    checks: tuple[Check, ...] = ()
    banded: tuple[str, ...] = ()
    catalogue: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        return self.tables.title or self.source.path.stem

    @property
    def folder(self) -> pathlib.Path:
        """Where results go unless told otherwise: `[output] folder`, else out/<name of the file>."""
        return pathlib.Path(self.tables.output.folder or pathlib.Path("out") / self.source.path.stem)

    @property
    def stations(self) -> int:
        """How many states are asked of the run, at most."""
        if self.tables.solve.kind == "path":
            return self.tables.solve.steps or STEPS
        return 2 * len(self.times) - 1 if self.tables.solve.travel == "both" else len(self.times)

    def resolution(self, watch: Sequence[Watch] = (), *, wanted: bool = False) -> Resolution | None:
        """How finely a quasi-static run looks between its stations: as `[solve] resolution` says, else half a degree for a
        travel both ways, with a drive, or where it is wanted. watch: numbers to resolve besides."""
        given = self.tables.solve.resolution
        if given is False or (given is None and not wanted and not self.drives and self.tables.solve.travel != "both"):
            return None
        idle = [part for part in self.parts if part not in self.model.parts]
        turn = {} if given is None else {"turn": float(given)}
        return Resolution(**turn, watch=watch, parts=idle)

    @property
    def cases(self) -> list[dict[str, Any]]:
        """Changed values of each case of `[sweep]`, by dotted path; none without one."""
        return cases(self.tables.sweep) if self.tables.sweep is not None else []

    @property
    def inputs(self) -> list[pathlib.Path]:
        """Files that the scene is read from: its own, meshes, curves and motions."""
        return [self.source.path, *read_files(self.source, self.tables)]

    @property
    def identity(self) -> str:
        """Digest of the resolved scene and of every other file it reads."""
        return identity(self.source, self.tables)

    def sticking(self) -> Scene:
        """This scene with sticking strands in all rods whose stiffness is a band."""
        rods = [
            rod.model_copy(update={"strands": "stick"}) if rod.name in self.banded else rod for rod in self.tables.rod
        ]
        return _scene(self.source, self.tables.model_copy(update={"rod": rods}))

    def placed(self, error: SceneError) -> SceneError:
        """What a run found wrong with the scene, faults of contact at their lines."""
        paths = [self.contact_of(fault) for fault in error.faults]
        return SceneError(
            [self.source.fault(path, fault) if path else fault for path, fault in zip(paths, error.faults, strict=True)]
        )

    def resolved(self) -> str:
        """The scene as TOML in SI units with every default written out and absolute paths; without studies of it."""
        return resolved(self.source, self.tables)

    def changed(self, values: Mapping[str, Any]) -> Scene:
        """This scene with other values at dotted paths: ``{"rod.cable.length": "0.2 m", "support.far end.at": 0.1}``.

        Raises
        ------
        SceneError
            A path names nothing, or the changed scene has faults; each says what was changed.
        """
        return changed_scene(self.source, values)


def shipped_scene() -> pathlib.Path:
    """Path of the scene that comes with the package."""
    return pathlib.Path(str(resources.files("cosserat_fem") / "scenes" / SHIPPED))


def load_scene(path: str | os.PathLike[str] | None = None) -> Scene:
    """Read and check a scene file; without a path, the one that comes with the package.

    Raises
    ------
    SceneError
        All faults found, each with file and line.
    """
    return build_scene(read(pathlib.Path(path) if path is not None else shipped_scene()))


def build_scene(source: Source) -> Scene:
    """A scene from what was read. SceneError as for `load_scene`."""
    return _scene(source, validate(source))


def _scene(source: Source, tables: SceneTables) -> Scene:
    """The scene of these tables. SceneError with all faults."""
    builder = Builder(source, tables)
    if tables.sweep is not None:
        builder.faults += sweep_faults(source, tables.sweep)
    if tables.design is not None:
        builder.faults += design_faults(source, tables)
    model = builder.model()
    times = _times(source, tables)
    checks = build_checks(builder, model)
    _check_run(builder, model, times)
    loads = tuple(load for k, load in builder.loads.items() if not tables.load[k].constant)
    parts, drives = tuple(builder.parts.values()), tuple(builder.drives.values())
    return Scene(
        source, tables, model, parts, times, builder.contact_of, loads, drives, tuple(checks),
        tuple(builder.banded), tuple(builder.cables.used),
    )  # fmt: skip


def changed_scene(source: Source, values: Mapping[str, Any]) -> Scene:
    """A scene from what was read, with other values at dotted paths; see `Scene.changed`."""
    try:
        return build_scene(changed(source, values))
    except ValueError as error:
        raise SceneError(f"{source.path}: {error}") from None
    except SceneError as error:
        raise SceneError([f"{fault} Changed: {said(values)}." for fault in error.faults]) from None


def _times(source: Source, tables: SceneTables) -> np.ndarray:
    """Stations of the run."""
    solve, every = tables.solve, tables.output.every
    given = source.data["solve"]
    faults = _accuracy(source, tables)
    if solve.out_of_plane and solve.plane is None:
        faults.append(
            source.fault(("solve", "out_of_plane"), 'out_of_plane goes with plane = "xy", "yz", "xz" or "auto".')
        )
    for key, kind in foreign(solve.kind).items():
        if key in given:
            more = "; use t" if solve.kind == "static" and kind == "quasistatic" else ""
            faults.append(source.fault(("solve", key), f'{key} is for kind = "{kind}"{more}.'))
    if solve.resolution is not None and solve.resolution is not False and not solve.resolution > 0:
        got = f"(got {solve.resolution:g} rad)"
        faults.append(source.fault(("solve", "resolution"), f"resolution must be false or greater than 0 {got}."))
    if solve.travel == "both" and solve.times is not None and len(solve.times) == 1:
        faults.append(source.fault(("solve", "travel"), 'travel = "both" needs at least two times.'))
    if solve.modes is not None and solve.modes < 1:
        faults.append(source.fault(("solve", "modes"), f"modes must be at least 1 (got {solve.modes})."))
    if solve.rotation == "kardan" and (solve.kind == "path" or solve.modes is not None):
        what = "a path needs" if solve.kind == "path" else "vibrations need"
        faults.append(source.fault(("solve", "rotation"), f'{what} rotation = "quaternion".'))
    if solve.theory == "string" and (solve.kind == "path" or solve.modes is not None):
        what = "a path needs" if solve.kind == "path" else "vibrations need"
        faults.append(source.fault(("solve", "theory"), f"{what} rods that bend."))
    for k, load in enumerate(tables.load):
        if load.constant and solve.kind != "path":
            faults.append(source.fault(("load", k, "constant"), 'constant is for kind = "path".'))
    if solve.kind in ("static", "path"):
        if every is not None:
            reason = f'every is for kind = "quasistatic"; {ONE[solve.kind]}.'
            faults.append(source.fault(("output", "every"), reason))
        if solve.steps is not None and solve.steps < 1:
            faults.append(source.fault(("solve", "steps"), f"steps must be at least 1 (got {solve.steps})."))
        if solve.kind == "path":
            faults += _path(source, tables)
        if faults:
            raise SceneError(faults)
        return np.array([solve.t, solve.until] if solve.along == "time" else [solve.t])
    if solve.kind == "dynamic":
        faults += _time_step(source, tables)
    if (solve.times is None) == (solve.duration is None):
        faults.append(source.fault(("solve",), "needs either 'duration' (with output.every) or 'times'."))
    elif solve.times is not None:
        back = np.flatnonzero(np.diff(solve.times) <= 0)
        if not solve.times:
            faults.append(source.fault(("solve", "times"), "times is empty; give at least one."))
        elif len(back):
            k = int(back[0])
            faults.append(
                source.fault(
                    ("solve", "times", k + 1),
                    f"times must increase (got {solve.times[k + 1]:g} s after {solve.times[k]:g} s).",
                )
            )
    elif solve.duration is not None and not solve.duration > 0:
        faults.append(
            source.fault(("solve", "duration"), f"duration must be greater than 0 (got {solve.duration:g} s).")
        )
    if every is not None and not every > 0:
        faults.append(source.fault(("output", "every"), f"every must be greater than 0 (got {every:g} s)."))
    elif every is not None and solve.times is not None:
        reason = "every goes with solve.duration; solve.times names each station already. Remove one of them."
        faults.append(source.fault(("output", "every"), reason))
    elif every is not None and solve.duration is not None and every > solve.duration * (1 + 1e-9):
        reason = f"every must be at most solve.duration, {solve.duration:g} s (got {every:g} s)."
        faults.append(source.fault(("output", "every"), reason))
    if faults:
        raise SceneError(faults)
    if solve.times is not None:
        return np.array(solve.times)
    duration = float(solve.duration or 0.0)
    step = float(every if every is not None else duration / 100)
    intervals = duration / step * (1 + 1e-9)
    if intervals > 1_000_000:
        raise SceneError(
            source.fault(("output", "every"), f"every gives {intervals:.3g} stations; choose at most a million.")
        )
    n = int(intervals)
    times = step * np.arange(n + 1)
    return times if duration - times[-1] <= 1e-9 * duration else np.append(times, duration)


def _accuracy(source: Source, tables: SceneTables) -> list[str]:
    """Faults of an accuracy that is asked for."""
    solve, key = tables.solve, ("solve", "accuracy")
    if solve.accuracy is None:
        return []
    faults = []
    try:
        check_accuracy("solve", solve.accuracy)
    except ValueError as error:
        faults.append(source.fault(key, str(error).removeprefix("solve: ")))
    steps = [name for name in ("rtol", "dt") if getattr(solve, name) is not None]
    if steps:
        faults.append(source.fault(("solve", steps[0]), f"accuracy chooses the steps; leave out {steps[0]}."))
    if solve.kind == "dynamic" and tables.contact:
        faults.append(source.fault(key, "cannot be asked of a run in time with contact; give rtol or dt."))
    if solve.kind == "path":
        faults.append(source.fault(key, "cannot be asked of a path; give its rods more elements."))
    return faults


def _path(source: Source, tables: SceneTables) -> list[str]:
    """Faults of the keys that only a path has."""
    solve, faults = tables.solve, []
    if tables.contact:
        faults.append(source.fault(("contact",), 'kind = "path" cannot follow rods that touch something.'))
    if solve.along == "time" and (solve.until == "critical" or not solve.until > solve.t):
        faults.append(source.fault(("solve", "until"), f"until must be a time after t = {solve.t:g} s."))
    if solve.along == "loads":
        if all(load.constant for load in tables.load):
            reason = 'has no [[load]] to multiply (weight and loads with constant = true stay); or use along = "time".'
            faults.append(source.fault(("solve",), f'kind = "path" {reason}'))
        written = source.data["solve"].get("until", 1.0)
        if isinstance(written, str) and written != "critical":
            faults.append(source.fault(("solve", "until"), f'until must be a factor or "critical" (got {written!r}).'))
    if solve.longest is not None and not solve.longest > 0:
        faults.append(source.fault(("solve", "longest"), f"longest must be greater than 0 (got {solve.longest:g})."))
    if solve.branch is not None and solve.branch < 0:
        faults.append(source.fault(("solve", "branch"), f"branch must be a seed of at least 0 (got {solve.branch})."))
    return faults


def _time_step(source: Source, tables: SceneTables) -> list[str]:
    """Faults of the keys that only a run in time has."""
    solve, faults = tables.solve, []
    if solve.rtol is not None and solve.dt is not None:
        faults.append(source.fault(("solve", "dt"), "give rtol (steps of their own length) or dt, not both."))
    for key in ("rtol", "dt"):
        value = getattr(solve, key)
        if value is not None and not value > 0:
            faults.append(source.fault(("solve", key), f"{key} must be greater than 0 (got {value:g})."))
    if solve.richardson and solve.dt is None:
        faults.append(source.fault(("solve", "richardson"), "richardson goes with dt: it runs with dt and dt / 2."))
    if not 0.0 <= solve.rho_inf <= 1.0:
        faults.append(source.fault(("solve", "rho_inf"), f"rho_inf must be from 0 to 1 (got {solve.rho_inf:g})."))
    if solve.rotation == "kardan":
        faults.append(source.fault(("solve", "rotation"), 'a run in time needs rotation = "quaternion".'))
    if solve.out_of_plane:
        faults.append(
            source.fault(("solve", "out_of_plane"), "out_of_plane speaks of equilibria, not of runs in time.")
        )
    if solve.times and (solve.times[0] < 0 or solve.times[-1] <= 0):
        got = f"{solve.times[0]:g} s to {solve.times[-1]:g} s"
        faults.append(source.fault(("solve", "times"), f"a run in time starts at 0 s and must end later (got {got})."))
    return faults


def _check_run(builder: Builder, model: Model, times: np.ndarray) -> None:
    """Faults that show only when parts and loads are asked for values: short tables, too few supports."""
    ends = [float(times[0]), float(times[-1])]  # a table that has both has all between
    if builder.tables.solve.kind == "dynamic":
        ends[0] = 0.0
    faults = builder.faults_at(model, ends)
    if not faults:
        try:
            for t in ends:
                model.constraints.targets(t)
                for term in model.terms:
                    if term not in model.contacts:  # parts may pass through the drawn shape later
                        term(model.initial_state(t), model.space, tangent=False)
            free = [text for text, translation in model.free_motions if translation or not model.terms]
            if builder.tables.solve.kind == "dynamic":
                check_dynamic(model, ends)
                if builder.tables.solve.start == "drawn":
                    free = []
        except ValueError as error:
            raise SceneError(builder.place(str(error))) from None
        except SceneError as error:
            raise SceneError([builder.place(fault) for fault in error.faults]) from None
        faults = [
            builder.source.fault(
                ("support",),
                f"too few supports: {text}. Hold that motion with a clamp or pin"
                + (', or set start = "drawn".' if builder.tables.solve.kind == "dynamic" else "."),
            )
            for text in free
        ]
    if faults:
        raise SceneError(faults)
