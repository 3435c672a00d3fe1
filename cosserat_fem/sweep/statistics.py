"""What do all cases say together? Percentile envelopes of hinge torque over angle, and which value matters for which result.

Rule: reads rows and the CSV files in the folders of cases; every number it writes can be found again from them. Only
converged cases count.
"""

from __future__ import annotations

import csv
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..export import replace_file
from ..summary import size
from .rows import CASES, Row, is_number

PERCENTILES = (5, 50, 95)
FEWEST = 4  # cases for a correlation


@dataclass(frozen=True, eq=False)
class Envelope:
    """Torque of one hinge over its angle on one way of its travel: angles (K,) [deg], bands (5, K) [N m], count of cases.

    bands: least, percentiles 5, 50 and 95, largest over the cases.
    """

    part: str
    way: int
    angle: np.ndarray
    bands: np.ndarray
    count: int


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a changed value with a result, and the chance of as much by accident."""

    varied: str
    result: str
    rho: float
    p_value: float
    count: int


def converged(rows: Sequence[Row]) -> list[Row]:
    """Rows that count, each case once."""
    return list({row.key: row for row in rows if row.status == "converged"}.values())


def correlations(rows: Sequence[Row], columns: Sequence[str]) -> list[Correlation]:
    """Of each changed number with the size of each reported number, strongest first within a result; what never changes has
    none.

    Source: Spearman (1904); `scipy.stats.spearmanr`.
    """
    from scipy.stats import spearmanr

    rows = converged(rows)
    found: list[Correlation] = []
    for result in columns:
        of_result = []
        for varied in dict.fromkeys(name for row in rows for name in row.changes):
            pairs = [
                (row.changes[varied], size(result, row.values[result]))
                for row in rows
                if is_number(row.changes.get(varied)) and is_number(row.values.get(result))
            ]
            x, y = np.array(pairs, dtype=float).reshape(-1, 2).T
            if len(pairs) < FEWEST or np.ptp(x) == 0 or np.ptp(y) == 0:
                continue
            said = spearmanr(x, y)
            of_result.append(Correlation(varied, result, float(said.statistic), float(said.pvalue), len(pairs)))
        found += sorted(of_result, key=lambda c: -abs(c.rho))
    return found


def envelopes(folder: pathlib.Path, rows: Sequence[Row]) -> list[Envelope]:
    """Bands of hinge torque over angle, for each hinge and each way of its travel (out, back, ...).

    Between stations torque is linear; the angles are those that all cases pass, as many as the most stations of a case.
    """
    curves: dict[tuple[str, int], list[tuple[np.ndarray, np.ndarray]]] = {}
    for row in converged(rows):
        for part, (angle, torque) in _torques(folder / CASES / row.key / "hinge_torque.csv").items():
            for way, piece in enumerate(_ways(angle)):
                curves.setdefault((part, way), []).append((angle[piece], torque[piece]))
    found = []
    for (part, way), pieces in curves.items():
        low, high = max(a.min() for a, _ in pieces), min(a.max() for a, _ in pieces)
        if not high > low:
            continue
        angle = np.linspace(low, high, max(len(a) for a, _ in pieces))
        up = [(a, m) if a[0] < a[-1] else (a[::-1], m[::-1]) for a, m in pieces]
        torque = np.array([np.interp(angle, a, m) for a, m in up])
        bands = np.vstack([torque.min(axis=0), np.percentile(torque, PERCENTILES, axis=0), torque.max(axis=0)])
        if pieces[0][0][0] > pieces[0][0][-1]:
            angle, bands = angle[::-1], bands[:, ::-1]
        found.append(Envelope(part, way, angle, bands, len(pieces)))
    return found


def _ways(angle: np.ndarray) -> list[slice]:
    """Stretches of stations on which the angle only grows or only falls; each begins where the last one ends."""
    turns = np.sign(np.diff(angle))
    moving = np.flatnonzero(turns)
    ends = [int(b) for a, b in pairwise(moving) if turns[a] != turns[b]]
    starts = [0, *ends]
    return [slice(a, b + 1) for a, b in zip(starts, [*ends, len(angle) - 1], strict=True) if b > a]


def _torques(path: pathlib.Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Angle and torque of each hinge of a run."""
    if not path.is_file():
        return {}
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    out = {}
    for part in dict.fromkeys(row["part"] for row in rows):
        table = np.array([[float(row["angle_deg"]), float(row["torque"])] for row in rows if row["part"] == part])
        out[part] = table[:, 0], table[:, 1]
    return out


def write_correlations(found: Sequence[Correlation], path: pathlib.Path) -> None:
    """Write correlations as CSV."""

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["result", "varied", "spearman", "p_value", "cases"])
            writer.writerows([c.result, c.varied, c.rho, c.p_value, c.count] for c in found)

    replace_file(path, write)


def write_envelopes(found: Sequence[Envelope], path: pathlib.Path) -> None:
    """Write envelopes as CSV; `way` counts the ways of the travel from 0."""

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            names = [f"percentile_{p}" for p in PERCENTILES]
            writer.writerow(["part", "way", "angle_deg", "least", *names, "largest", "cases"])
            for band in found:
                for k, angle in enumerate(band.angle):
                    writer.writerow([band.part, band.way, float(angle), *map(float, band.bands[:, k]), band.count])

    replace_file(path, write)
