"""What does this TOML file mean? Scenes: read, checked, built, written back.

Rule: a table that is absent is physics that is absent. `load_scene` finds all faults or returns a scene that can be run;
nothing is solved here.
"""

from __future__ import annotations

import os
import pathlib
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from ..errors import SceneError
from ..model import Model
from .build import Builder
from .load import Source, read, validate
from .tables import SceneTables

SHIPPED = "satellite_hinge.toml"


@dataclass(frozen=True, eq=False)
class Scene:
    """A checked scene: its tables, its model and the times to solve for.

    times (T,) [s]: stations of a quasi-static run; the one time of a static run.
    """

    source: Source
    tables: SceneTables
    model: Model
    times: np.ndarray

    @property
    def title(self) -> str:
        return self.tables.title or self.source.path.stem

    @property
    def folder(self) -> pathlib.Path:
        """Where results go unless told otherwise: `[output] folder`, else out/<name of the file>."""
        return pathlib.Path(self.tables.output.folder or pathlib.Path("out") / self.source.path.stem)

    def resolved(self) -> str:
        """The scene as TOML in SI units with every default written out and absolute paths."""
        data = self.tables.model_dump(exclude_none=True)
        for part in data.get("part", ()):
            if "mesh" in part:
                part["mesh"] = str((self.source.folder / part["mesh"]).resolve())
            if part.get("motion", {}).get("kind") == "path":
                part["motion"]["file"] = str((self.source.folder / part["motion"]["file"]).resolve())
        for rod in data["rod"]:
            if "file" in rod:
                rod["file"] = str((self.source.folder / rod["file"]).resolve())
        for key in ("duration", "times") if data["solve"]["kind"] == "static" else ("t", "steps"):
            data["solve"].pop(key, None)
        return to_toml(data)


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
    source = read(pathlib.Path(path) if path is not None else shipped_scene())
    tables = validate(source)
    model = Builder(source, tables).model()
    times = _times(source, tables)
    _check_run(source, model, times)
    return Scene(source, tables, model, times)


def _times(source: Source, tables: SceneTables) -> np.ndarray:
    """Stations of the run."""
    solve, every = tables.solve, tables.output.every
    given = source.data["solve"]
    faults = []
    if solve.kind == "static":
        for key in ("duration", "times"):
            if key in given:
                faults.append(source.fault(("solve", key), f'{key} is for kind = "quasistatic"; use t.'))
        if solve.steps is not None and solve.steps < 1:
            faults.append(source.fault(("solve", "steps"), f"steps must be at least 1 (got {solve.steps})."))
        if faults:
            raise SceneError(faults)
        return np.array([solve.t])
    for key in ("t", "steps"):
        if key in given:
            faults.append(source.fault(("solve", key), f'{key} is for kind = "static".'))
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
    if faults:
        raise SceneError(faults)
    if solve.times is not None:
        return np.array(solve.times)
    duration = float(solve.duration or 0.0)
    step = float(every if every is not None else duration / 100)
    n = int(np.floor(duration / step * (1 + 1e-9)))
    if n > 1_000_000:
        raise SceneError(source.fault(("output", "every"), f"gives {n} stations; choose at most a million."))
    times = step * np.arange(n + 1)
    return times if duration - times[-1] <= 1e-9 * duration else np.append(times, duration)


def _check_run(source: Source, model: Model, times: np.ndarray) -> None:
    """Faults that show only when parts and loads are asked for values: short tables, too few supports."""
    faults = []
    try:
        for t in times:
            model.constraints.targets(float(t))
        for t in (times[0], times[-1]):
            model.external(model.initial_state(float(t)), tangent=False)
    except ValueError as error:
        faults.append(source.place(str(error)))
    free = [text for text, translation in model.free_motions if translation or not model.terms]
    faults += [
        source.fault(("support",), f"too few supports: {text}. Hold that motion with a clamp or pin.") for text in free
    ]
    if faults:
        raise SceneError(faults)


def to_toml(data: dict[str, Any]) -> str:
    """TOML of nested tables as a scene has them: plain values first, then tables, then arrays of tables."""
    out: list[str] = []
    for key, value in data.items():
        if not _is_table(value):
            out.append(f"{key} = {_literal(value)}")
    for key, value in data.items():
        if isinstance(value, dict):
            out += ["", f"[{key}]", *(f"{k} = {_literal(v)}" for k, v in value.items())]
        elif _is_table(value):
            for entry in value:
                out += ["", f"[[{key}]]", *(f"{k} = {_literal(v)}" for k, v in entry.items())]
    return "\n".join(out) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        for char, code in (("\n", "\\n"), ("\t", "\\t"), ("\r", "\\r")):
            escaped = escaped.replace(char, code)
        return f'"{escaped}"'
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_literal(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(_literal(v) for v in value) + "]"
    return repr(value if isinstance(value, int) else float(value))
