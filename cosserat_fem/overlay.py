"""How far apart are two curves? Two runs, or a run and a measurement, side by side.

Rule: a run is what its folder says (`reactions.csv`, `hinge_torque.csv`); a measurement is a CSV file whose header names its
columns as a run names its curves: `torque of PART`, `force of SUPPORT`, `Fx of SUPPORT` and so on, over `time` or over
`angle_deg` of the one hinge. Curves are compared over the time, at all times that either has within the span of both. An
angle is a time by the motion of the run: rows up to the farthest angle are the way out, those after it the way back.
"""

from __future__ import annotations

import json
import os
import pathlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import CosseratError, nearest
from .export import replace_file, write_csv, write_json
from .folder import PROGRAM
from .plots import COLOURS, read_table
from .table import read_header
from .table import read_table as read_columns

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
SLACK = 1e-6  # of the span of a motion: an angle may be so far outside
MOST = 12  # curves drawn


@dataclass(frozen=True, eq=False)
class Curve:
    """A number over the time: t (n,) [s], increasing, y (n,) in its unit."""

    t: np.ndarray
    y: np.ndarray
    unit: str

    def at(self, t: np.ndarray) -> np.ndarray:
        """Values at some times, straight between its own."""
        return np.interp(t, self.t, self.y)


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves by name, and the angle [deg] of the one hinge over the time, if there is one."""

    title: str
    curves: dict[str, Curve]
    angle: Curve | None = None


@dataclass(frozen=True)
class Apart:
    """Two curves: peaks (largest absolute values, with their signs), and largest and mean distance between them; t [s]: of
    the largest distance."""

    name: str
    unit: str
    peak_a: float
    peak_b: float
    largest: float
    t: float
    rms: float


def run_curves(folder: str | os.PathLike[str]) -> Curves:
    """Curves of a run folder. CosseratError if it is none, or one of a path."""
    folder = pathlib.Path(folder)
    try:
        reactions = read_table(folder / "reactions.csv", "support")
        torque = read_table(folder / "hinge_torque.csv", "part")
    except (OSError, KeyError, ValueError):
        raise CosseratError(f"{folder}: is not the folder of a finished run (no reactions.csv).") from None
    if any("station" in table for table in reactions.values()):
        raise CosseratError(f"{folder}: is the run of a path, whose states have no times to compare.")
    found: dict[str, Curve] = {}
    for name, table in torque.items():
        found[f"torque of {name}"] = Curve(table["time"], table["torque"], "N m")
    for name, table in reactions.items():
        for what, unit, columns in (("force", "N", COMPONENTS[:3]), ("moment", "N m", COMPONENTS[3:])):
            parts = [table[c] for c in columns]
            found[f"{what} of {name}"] = Curve(table["time"], np.linalg.norm(parts, axis=0), unit)
            for c, values in zip(columns, parts, strict=True):
                found[f"{c} of {name}"] = Curve(table["time"], values, unit)
    turning = [table for table in torque.values() if np.ptp(table["angle_deg"]) > 0]
    angle = Curve(turning[0]["time"], turning[0]["angle_deg"], "deg") if len(turning) == 1 else None
    return Curves(str(folder), found, angle)


@dataclass(frozen=True, eq=False)
class Measured:
    """A measurement as it was read: numbers (n,) by column, the columns in lower case."""

    path: pathlib.Path
    columns: dict[str, np.ndarray]

    @property
    def where(self) -> str:
        return f"measurement {str(self.path)!r}"

    @property
    def values(self) -> list[str]:
        """Columns that are neither time nor angle."""
        return [name for name in self.columns if name not in ("time", "angle_deg")]

    def times(self, angle: Curve | None) -> np.ndarray:
        """Time [s] of each row, by its own column or by its angle. CosseratError if there is neither."""
        if "time" in self.columns:
            return self.columns["time"]
        if "angle_deg" not in self.columns:
            raise CosseratError(f"{self.where}: needs a column 'time' [s] or 'angle_deg'.")
        if angle is None:
            raise CosseratError(f"{self.where}: 'angle_deg' needs a run in which just one hinge turns; give 'time'.")
        return times_of(self.columns["angle_deg"], angle, self.where)

    def matched(self, names: list[str]) -> dict[str, str]:
        """Column -> name of the curve it measures. CosseratError for a column that is none."""
        known = {name.casefold(): name for name in names}
        torques = [name for name in names if name.startswith("torque of ")]
        if len(torques) == 1:
            known["torque"] = torques[0]
        wrong = [name for name in self.values if name not in known]
        if wrong:
            raise CosseratError(f"{self.where}: there is no curve {wrong[0]!r}. {nearest(wrong[0], known)}")
        return {name: known[name] for name in self.values}


def read_measured(path: str | os.PathLike[str]) -> Measured:
    """Read a CSV file with a header. MeshError if that cannot be done; it names the row and the cell."""
    path = pathlib.Path(path)
    where = f"measurement {str(path)!r}"
    names = read_header(path, where)
    table = read_columns(path, names, where)
    return Measured(path, dict(zip(names, table.T, strict=True)))


def times_of(angles: np.ndarray, motion: Curve, where: str) -> np.ndarray:
    """Times [s] at which a hinge that goes out, or out and back, has some angles [deg], in their order."""
    far = int(np.argmax(np.abs(motion.y - motion.y[0])))
    turn = int(np.argmax(np.abs(angles - motion.y[0])))
    slack = SLACK * np.ptp(motion.y)
    out = np.empty(len(angles))
    for way, rows in ((slice(0, far + 1), slice(0, turn + 1)), (slice(far, None), slice(turn + 1, None))):
        if not len(angles[rows]):
            continue
        y, order = motion.y[way], np.argsort(motion.y[way], kind="stable")
        low, high = y.min() - slack, y.max() + slack
        wrong = np.flatnonzero((angles[rows] < low) | (angles[rows] > high))
        if len(wrong):
            value = angles[rows][wrong[0]]
            side = "way out" if way.start == 0 else "way back"
            raise CosseratError(
                f"{where}: the angle {value:g} deg is not on the {side} of the run, {y.min():g} to {y.max():g} deg."
            )
        out[rows] = np.interp(angles[rows], y[order], motion.t[way][order])
    return out


def measured_curves(measured: Measured, run: Curves) -> Curves:
    """A measurement as curves over the time of a run; rows at the same time count as their mean."""
    t = measured.times(run.angle)
    found = {}
    for column, name in measured.matched(list(run.curves)).items():
        times, which = np.unique(t, return_inverse=True)
        mean = np.bincount(which, measured.columns[column]) / np.bincount(which)
        found[name] = Curve(times, mean, run.curves[name].unit)
    return Curves(str(measured.path), found, run.angle)


def compare(a: Curves, b: Curves) -> list[Apart]:
    """Distances b - a of all curves that both have. CosseratError if there is none, or their times do not meet."""
    found = []
    for name in [name for name in a.curves if name in b.curves]:
        one, two = a.curves[name], b.curves[name]
        low, high = max(one.t[0], two.t[0]), min(one.t[-1], two.t[-1])
        times = np.unique(np.concatenate([one.t, two.t]))
        times = times[(times >= low) & (times <= high)]
        if not len(times):
            raise CosseratError(f"{a.title} and {b.title}: {name} has no time in common.")
        off = two.at(times) - one.at(times)
        k = int(np.argmax(np.abs(off)))
        peak_a, peak_b = (float(c.y[np.argmax(np.abs(c.y))]) for c in (one, two))
        rms = float(np.sqrt(np.mean(off**2)))
        found.append(Apart(name, one.unit, peak_a, peak_b, float(off[k]), float(times[k]), rms))
    if not found:
        raise CosseratError(f"{a.title} and {b.title}: have no curve in common (supports and parts of the same names).")
    return found


def write_overlay(a: Curves, b: Curves, folder: str | os.PathLike[str]) -> list[Apart]:
    """Write `overlay.csv`, `overlay.json` and figures of two sets of curves; return the comparison."""
    rows, folder = compare(a, b), pathlib.Path(folder)
    claim(folder, "overlay.json", ("overlay.csv", "overlay.svg", "overlay.png"))
    names = ["quantity", "unit", "peak_a", "peak_b", "largest_difference", "time", "rms_difference"]
    write_csv(folder / "overlay.csv", names, [list(vars(row).values()) for row in rows])
    said: dict[str, Any] = {
        "program": PROGRAM,
        "a": a.title,
        "b": b.title,
        "curves": {row.name: vars(row) for row in rows},
    }
    write_json(said, folder / "overlay.json")
    _draw(a, b, rows, folder)
    return rows


def claim(folder: pathlib.Path, mark: str, others: tuple[str, ...]) -> None:
    """Make a folder, where files of ours may be replaced: those are ours if `mark` is. CosseratError if they are not."""
    folder.mkdir(parents=True, exist_ok=True)
    there = [name for name in (mark, *others) if (folder / name).exists()]
    try:
        ours = json.loads((folder / mark).read_text(encoding="utf-8")).get("program") == PROGRAM
    except (OSError, ValueError, AttributeError):
        ours = False
    if there and not ours:
        raise CosseratError(f"{folder}: holds {there[0]!r}, which this program did not make. Choose another with -o.")


def _draw(a: Curves, b: Curves, rows: list[Apart], folder: pathlib.Path) -> None:
    """Curves of both, over the angle of the one hinge if there is one; components only where nothing else is compared."""
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.name[:3] not in [f"{c} " for c in COMPONENTS]] or rows
    shown = shown[:MOST]
    figure = Figure(figsize=(7.2, 2.8 * len(shown)), layout="constrained")
    for ax, row in zip(figure.subplots(len(shown), 1, squeeze=False)[:, 0], shown, strict=True):
        for curves, colour, style in ((a, COLOURS[0], "-"), (b, COLOURS[1], "--")):
            curve = curves.curves[row.name]
            x = curve.t if a.angle is None else a.angle.at(curve.t)
            ax.plot(x, curve.y, style, color=colour, label=curves.title, marker="." if len(x) < 60 else None, ms=4)
        ax.set_ylabel(f"{row.name} [{row.unit}]")
        ax.grid(alpha=0.3)
    ax.set_xlabel("time [s]" if a.angle is None else "hinge angle [deg]")
    figure.axes[0].legend(fontsize=8)
    for suffix in (".svg", ".png"):
        replace_file(folder / f"overlay{suffix}", lambda temporary: figure.savefig(temporary, dpi=150))
