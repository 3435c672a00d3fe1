"""What may a design choose? From `[design]` to values by dotted path, and every fault at its line.

Rule: a design is a point of the box that the ranges span. A value is a number of the scene; with an `axis` it is a
direction, turned about that axis by an angle of the range from what the scene says or draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import SceneError
from ..model import Model
from .edit import changed, find
from .lines import Path
from .load import Source, validate
from .tables import DesignTable, SceneTables, VariableTable
from .units import SYMBOLS, measured
from .vary import FIXED

SOLVED = ("static", "quasistatic")
DIRECTIONS = ("start_tangent", "end_tangent")
ANGLE = SYMBOLS["deg"][1]


def bounds(design: DesignTable) -> np.ndarray:
    """Lowest and highest value of each variable (n, 2), in SI; of angles in rad."""
    return np.array([[measured(end)[0] for end in entry.range] for entry in design.vary])


def values(source: Source, model: Model, design: DesignTable, x: Sequence[float] | np.ndarray) -> dict[str, Any]:
    """Changed values of the scene at a point of the box, by dotted path. model: that of the scene as it is."""
    found: dict[str, Any] = {}
    for entry, number in zip(design.vary, x, strict=True):
        given = found.get(entry.path)
        if entry.axis is None:
            found[entry.path] = float(number)
        else:
            axis = np.array(entry.axis) / np.linalg.norm(entry.axis)
            before = direction(source, model, entry) if given is None else given
            found[entry.path] = Rotation.from_rotvec(number * axis).apply(before).tolist()
    return found


def direction(source: Source, model: Model, entry: VariableTable) -> list[float]:
    """The direction that a variable turns: as the scene says it, else as it is drawn."""
    path = find(source, entry.path)
    written = source.value(path)
    if written is not None:
        return [measured(x)[0] for x in written]
    rod = model.rods[int(path[1])]
    end = 0.0 if path[-1] == "start_tangent" else rod.length
    return rod.frames(np.array([0.0, end]))[-1, :, 2].tolist()


def starting(source: Source, model: Model, design: DesignTable) -> np.ndarray:
    """The scene as it is, as a point (n,) in SI; nan where a value is not written."""
    x = np.zeros(len(design.vary))
    for k, entry in enumerate(design.vary):
        if entry.axis is not None:
            continue
        path = find(source, entry.path)
        written = source.value(path)
        if written is None and path[0] == "rod" and path[-1] == "length":
            written = float(model.rods[int(path[1])].length)
        x[k] = np.nan if written is None else measured(written)[0]
    return x


def design_faults(source: Source, tables: SceneTables) -> list[str]:
    """Faults of `[design]`, each at its line."""
    design = tables.design
    if design is None:
        return []
    faults = []

    def fault(message: str, *keys: str | int) -> None:
        faults.append(source.fault(("design", *keys), message))

    if tables.solve.kind not in SOLVED:
        fault(f'needs solve.kind = "static" or "quasistatic" (got "{tables.solve.kind}").')
    if not 0.0 < design.tolerance < 0.5:
        fault(f"tolerance must be above 0 and below 0.5 (got {design.tolerance:g}).", "tolerance")
    if design.margin < 0.0:
        fault(f"margin must be at least 0 (got {design.margin:g}).", "margin")
    if design.runs < 1:
        fault(f"runs must be at least 1 (got {design.runs}).", "runs")
    seen: dict[tuple[Path, Any], int] = {}
    for k, entry in enumerate(design.vary):
        faults += _variable_faults(source, k, entry)
        try:
            place = find(source, entry.path), entry.axis
        except ValueError:
            continue
        if seen.setdefault(place, k) != k:
            fault(f"vary[{k}].path: {entry.path} is chosen by vary[{seen[place]}] already.", "vary", k, "path")
    for k, limit in enumerate(design.limits):
        if limit.least is None and limit.most is None:
            fault(f"limits[{k}] needs 'least' or 'most'.", "limits", k)
        elif limit.least is not None and limit.most is not None and measured(limit.least)[0] > measured(limit.most)[0]:
            fault(f"limits[{k}]: least {limit.least!r} is above most {limit.most!r}.", "limits", k)
    return faults


def _variable_faults(source: Source, k: int, entry: VariableTable) -> list[str]:
    """Faults of one variable: its path, its range, and values that the tables of the scene refuse."""
    here: Path = ("design", "vary", k)
    try:
        path = find(source, entry.path)
    except ValueError as error:
        return [source.fault((*here, "path"), f"vary[{k}].path {error}")]
    if path[0] in FIXED:
        return [source.fault((*here, "path"), f"vary[{k}].path: {path[0]} cannot be chosen.")]
    (low, unit), (high, other) = measured(entry.range[0]), measured(entry.range[1])
    if None not in (unit, other) and unit != other:
        return [source.fault((*here, "range"), f"vary[{k}].range: both must have the same kind of unit.")]
    if not high > low:
        return [
            source.fault(
                (*here, "range"), f"vary[{k}].range must go up (got {entry.range[0]!r} to {entry.range[1]!r})."
            )
        ]
    if entry.axis is not None:
        return _axis_faults(source, here, k, entry, path, (unit, other))
    faults = []
    for j, value in enumerate([*entry.range, (low + high) / 2]):
        try:
            validate(changed(source, {entry.path: value}))
        except SceneError as error:
            keys: Path = (*here, "range", j) if j < 2 else (*here, "range")
            faults.append(source.fault(keys, f"vary[{k}].range[{j % 2}]: {error.faults[0].split(': ', 1)[1]}"))
    return list(dict.fromkeys(faults))


def _axis_faults(
    source: Source, here: Path, k: int, entry: VariableTable, path: Path, units: tuple[Any, Any]
) -> list[str]:
    """Faults of a direction that is turned."""
    if not np.linalg.norm(entry.axis or 0.0) > 0:
        return [source.fault((*here, "axis"), f"vary[{k}].axis must not be zero.")]
    if any(unit not in (None, ANGLE) for unit in units):
        return [source.fault((*here, "range"), f'vary[{k}].range must be angles, for example "20 deg".')]
    written = source.value(path)
    if not (path[0] == "rod" and path[-1] in DIRECTIONS) and not (isinstance(written, list) and len(written) == 3):
        names = " or ".join(DIRECTIONS)
        reason = f"vary[{k}].path: what an axis turns is a direction, such as a rod's {names}."
        return [source.fault((*here, "path"), reason)]
    return []
