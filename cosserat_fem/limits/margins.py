"""How are margins kept? Files of the checks of a run, and their field for ParaView.

Rule: what stands here is enough to draw every margin again: `margins.npz` has the map of each check over time and arc
length, `checks.csv` its worst value at each state.

`margins.npz` holds `t` (T,) [s], `order` (T,), what increases from state to state, `names` (K,), and for check number k
`margin_k` (T,), `value_k` (T,) and `limit_k`; `angle_k` (T,) [deg] of its hinge, or of the one that turns, if there is one;
if it is a quantity along a rod, `s_k` (N,) [m] and `map_k` (T, N): the margins at its nodes, NaN where it is not looked at.
"""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..export import replace_file, write_csv
from ..history import History
from .verdicts import Verdict


def write_margins(history: History, path: pathlib.Path, verdicts: Sequence[Verdict]) -> None:
    """Write the margins of all checks as arrays of numpy."""
    arrays: dict[str, Any] = {
        "t": history.t,
        "order": history.order,
        "names": np.array([verdict.name for verdict in verdicts]),
    }
    for k, verdict in enumerate(verdicts):
        course = verdict.course
        arrays |= {f"margin_{k}": course.margin, f"value_{k}": course.value, f"limit_{k}": np.float64(verdict.limit)}
        if course.angle is not None:
            arrays[f"angle_{k}"] = course.angle
        if course.along is not None:
            arrays |= {f"s_{k}": course.nodes, f"map_{k}": course.along.astype(np.float32)}
    replace_file(path, lambda temporary: np.savez_compressed(temporary, **arrays))


def write_checks(history: History, path: pathlib.Path, verdicts: Sequence[Verdict]) -> None:
    """CSV of the worst place of each check at each state: value and limit in the unit of the quantity, margin, s [m]."""
    rows = []
    for k, t in enumerate(history.t):
        for verdict in verdicts:
            course = verdict.course
            angle, s = ("" if x is None or np.isnan(x[k]) else x[k] for x in (course.angle, course.s))
            rows.append([k, t, angle, verdict.name, course.value[k], verdict.limit, verdict.unit, course.margin[k], s])
    write_csv(path, ["station", "time", "angle_deg", "check", "value", "limit", "unit", "margin", "s"], rows)


def margin_fields(history: History, verdicts: Sequence[Verdict]) -> dict[str, np.ndarray]:
    """Point fields (T, N): "margin", the smallest of all checks along a rod, NaN on rods that have none, and "margin_of",
    the number of the check that it is of, counted in the order of the summary, or -1."""
    margins, numbers = [], []
    for rod in history.model.rods:
        shape = (len(history), len(history.nodes(rod)))
        low, which = np.full(shape, np.nan), np.full(shape, -1, dtype=np.int32)
        for k, verdict in enumerate(verdicts):
            along = verdict.course.along
            if verdict.check.rod is rod and along is not None:
                lower = np.isfinite(along) & ~(along >= low)
                low[lower], which[lower] = along[lower], k
        margins.append(low)
        numbers.append(which)
    return {"margin": np.concatenate(margins, axis=1), "margin_of": np.concatenate(numbers, axis=1)}
