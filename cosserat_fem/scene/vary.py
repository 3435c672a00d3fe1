"""Which cases does a sweep have? From `[sweep]` to changed values by dotted path.

Rule: the same table gives the same cases on every machine. A grid takes all combinations, the last value fastest; a list
takes values side by side; a Latin hypercube draws them with a seed, and drawn numbers are rounded to 12 digits, so that the
last bit of a library is no new case. Shapes and units of all values are checked before anything is run.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ..errors import SceneError
from .edit import changed, find
from .lines import Path
from .load import Source, validate
from .tables import SweepTable, VaryTable
from .units import measured

MOST = 100_000  # cases
DIGITS = 12
FIXED = ("sweep", "design", "output", "title")  # say nothing of what is solved
GIVEN = ("values", "range", "normal")


def cases(sweep: SweepTable) -> list[dict[str, Any]]:
    """Changed values of each case, by dotted path, in a fixed order."""
    paths = [entry.path for entry in sweep.vary]
    if sweep.kind == "latin_hypercube":
        rows: Any = _drawn(sweep)
    else:
        axes = [_axis(entry) for entry in sweep.vary]
        rows = itertools.product(*axes) if sweep.kind == "grid" else zip(*axes, strict=True)
    return [dict(zip(paths, row, strict=True)) for row in rows]


def _axis(entry: VaryTable) -> list[Any]:
    """Values of one entry of a grid or list."""
    if entry.values is not None:
        return entry.values
    low, high = _numbers(entry.range)
    return [_rounded(x) for x in np.linspace(low, high, entry.points or 2)]


def _drawn(sweep: SweepTable) -> list[list[Any]]:
    """Cases of a Latin hypercube: each value's range is cut into as many equal parts as there are cases, one in each."""
    from scipy.stats import norm, qmc

    n = sweep.cases or 0
    shares = qmc.LatinHypercube(len(sweep.vary), rng=np.random.default_rng(sweep.seed or 0)).random(n)
    columns: list[list[Any]] = []
    for share, entry in zip(shares.T, sweep.vary, strict=True):
        if entry.values is not None:
            columns.append([entry.values[int(u * len(entry.values))] for u in share])
        elif entry.range is not None:
            low, high = _numbers(entry.range)
            columns.append([_rounded(low + u * (high - low)) for u in share])
        else:
            mean, deviation = _numbers(entry.normal)
            columns.append([_rounded(mean + deviation * z) for z in norm.ppf(share)])
    return [list(row) for row in zip(*columns, strict=True)]


def _numbers(ends: Any) -> tuple[float, float]:
    return measured(ends[0])[0], measured(ends[1])[0]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS - 1}e}")


def sweep_faults(source: Source, sweep: SweepTable) -> list[str]:
    """Faults of `[sweep]`, each at its line; values of the right shape may still be refused by the case that has them."""
    faults = []

    def fault(message: str, *keys: str | int) -> None:
        faults.append(source.fault(("sweep", *keys), message))

    drawn = sweep.kind == "latin_hypercube"
    for key in ("cases", "seed"):
        value, least = getattr(sweep, key), 1 if key == "cases" else 0
        if value is not None and not drawn:
            fault(f'{key} is for kind = "latin_hypercube"; a {sweep.kind} has as many cases as its values.', key)
        elif value is not None and value < least:
            fault(f"{key} must be at least {least} (got {value}).", key)
    if drawn and sweep.cases is None:
        fault("needs the key 'cases': how many to draw.")
    seen: dict[Path, int] = {}
    for k, entry in enumerate(sweep.vary):
        here: Path = ("sweep", "vary", k)
        faults += [source.fault((*here, *keys), f"vary[{k}]{text}") for keys, text in _entry_faults(entry, sweep.kind)]
        try:
            path = find(source, entry.path)
        except ValueError as error:
            fault(f"vary[{k}].path {error}", "vary", k, "path")
            continue
        if path[0] in FIXED:
            fault(f"vary[{k}].path: {path[0]} cannot be varied.", "vary", k, "path")
        elif seen.setdefault(path, k) != k:
            fault(f"vary[{k}].path: {entry.path} is varied by vary[{seen[path]}] already.", "vary", k, "path")
        else:
            faults += _value_faults(source, here, k, entry)
    return faults or _count_faults(source, sweep)


def _entry_faults(entry: VaryTable, kind: str) -> list[tuple[Path, str]]:
    """Faults of one entry of `vary` by itself: keys inside it, message."""
    given = [key for key in GIVEN if getattr(entry, key) is not None]
    if len(given) != 1:
        wanted = "'values', 'range' or 'normal'" if kind == "latin_hypercube" else "'values' or 'range'"
        return [((), f" needs {'either ' if not given else 'only one of '}{wanted}.")]
    found: list[tuple[Path, str]] = []
    if entry.normal is not None and kind != "latin_hypercube":
        found.append((("normal",), '.normal is for kind = "latin_hypercube".'))
    if entry.range is not None and kind != "latin_hypercube" and (entry.points is None or entry.points < 2):
        got = "" if entry.points is None else f" (got {entry.points})"
        found.append((("points",), f".range needs 'points', how many values it gives, at least 2{got}."))
    if entry.points is not None and (kind == "latin_hypercube" or entry.range is None):
        found.append((("points",), ".points goes with 'range' in a grid or list."))
    ends = entry.range or entry.normal
    if ends is None:
        return found
    (low, unit), (high, other) = measured(ends[0]), measured(ends[1])
    if None not in (unit, other) and unit != other:
        found.append(
            ((given[0],), f".{given[0]}: both must have the same kind of unit (got {ends[0]!r}, {ends[1]!r}).")
        )
    elif entry.range is not None and not high > low:
        found.append((("range",), f".range must go up (got {ends[0]!r} to {ends[1]!r})."))
    elif entry.normal is not None and not high > 0:
        found.append((("normal",), f".normal: the standard deviation must be greater than 0 (got {ends[1]!r})."))
    return found


def _value_faults(source: Source, here: Path, k: int, entry: VaryTable) -> list[str]:
    """Values that the tables of the scene refuse, at their lines."""
    faults = []
    tried: list[tuple[Path, Any]] = [(("values", j), value) for j, value in enumerate(entry.values or ())]
    if entry.range is not None:
        tried += [(("range", j), value) for j, value in enumerate(entry.range)]
        tried.append((("range", 0), sum(_numbers(entry.range)) / 2))  # drawn values are no integers
    if entry.normal is not None:
        tried.append((("normal", 0), entry.normal[0]))
    for keys, value in tried:
        try:
            validate(changed(source, {entry.path: value}))
        except SceneError as error:
            reason = error.faults[0].split(": ", 1)[1]
            faults.append(source.fault((*here, *keys), f"vary[{k}].{keys[0]}[{keys[1]}]: {reason}"))
    return list(dict.fromkeys(faults))


def _count_faults(source: Source, sweep: SweepTable) -> list[str]:
    """Too many cases, or lists that do not go side by side."""
    if sweep.kind == "latin_hypercube":
        count, key = sweep.cases or 0, "cases"
    else:
        lengths = [len(_axis(entry)) for entry in sweep.vary]
        count, key = int(np.prod([float(n) for n in lengths])) if sweep.kind == "grid" else lengths[0], "vary"
        if sweep.kind == "list" and len(set(lengths)) > 1:
            said = ", ".join(f"{entry.path}: {n}" for entry, n in zip(sweep.vary, lengths, strict=True))
            return [source.fault(("sweep", "vary"), f"a list needs as many values of each path (got {said}).")]
    if count > MOST:
        return [source.fault(("sweep", key), f"gives {count:.3g} cases; choose at most {MOST}.")]
    return []
