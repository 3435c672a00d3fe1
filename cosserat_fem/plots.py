"""How do the curves look? Forces, moments and hinge torque from the CSV files of a run folder.

Rule: reads the run folder only, so that every plot can be made again later.
"""

from __future__ import annotations

import csv
import pathlib
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .export import replace_file

COLOURS = ("#0b6e99", "#d1495b", "#edae49", "#00798c", "#7a5195", "#555555")


def read_table(path: pathlib.Path, key: str) -> dict[str, dict[str, np.ndarray]]:
    """Columns of a CSV, split by the names in one of its columns; NaN where a cell is empty."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = dict.fromkeys(row[key] for row in rows)
    columns = [c for c in (rows[0] if rows else {}) if c != key]
    return {n: {c: np.array([float(r[c] or "nan") for r in rows if r[key] == n]) for c in columns} for n in names}


def plot_run(folder: pathlib.Path, out: pathlib.Path) -> list[pathlib.Path]:
    """Write reactions and, where there are such, hinge_torque, drive, ledger and path as svg and png; return their paths."""
    reactions = read_table(folder / "reactions.csv", "support")
    torque = read_table(folder / "hinge_torque.csv", "part")
    made = []
    if reactions:
        made += save(_reactions(reactions, torque), out / "reactions")
    if torque:
        made += save(_torque(torque), out / "hinge_torque")
    if (folder / "drive.csv").is_file():
        made += save(_drive(read_table(folder / "drive.csv", "part")), out / "drive")
    if (folder / "ledger.csv").is_file():
        made += save(_ledger(folder / "ledger.csv"), out / "ledger")
    if (folder / "path.csv").is_file():
        made += save(_path(folder / "path.csv"), out / "path")
    return made


def save(figure: Figure, stem: pathlib.Path) -> list[pathlib.Path]:
    """Write a figure as svg and png; return their paths."""
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    for path in paths:
        replace_file(path, lambda temporary: figure.savefig(temporary, dpi=150))
    return paths


def _abscissa(
    reactions: dict[str, dict[str, np.ndarray]], torque: dict[str, dict[str, np.ndarray]]
) -> tuple[np.ndarray, str]:
    """The one hinge's angle if there is one hinge that turns, else time."""
    first = next(iter(reactions.values()))
    if "station" in first:
        return first["station"], "station along the path"
    time = first["time"]
    if len(torque) == 1:
        name, table = next(iter(torque.items()))
        if np.ptp(table["angle_deg"]) > 0:
            return table["angle_deg"], f"angle of {name} [deg]"
    return time, "time [s]"


def _reactions(reactions: dict[str, dict[str, np.ndarray]], torque: dict[str, dict[str, np.ndarray]]) -> Figure:
    x, label = _abscissa(reactions, torque)
    figure = Figure(figsize=(9.6, 3.1 * len(reactions)), layout="constrained")
    axes = figure.subplots(len(reactions), 2, squeeze=False, sharex=True)
    for row, (name, table) in zip(axes, reactions.items(), strict=True):
        for ax, symbol, unit in ((row[0], "F", "N"), (row[1], "M", "N m")):
            parts = [table[f"{symbol}{c}"] for c in "xyz"]
            for part, c, colour in zip(parts, "xyz", COLOURS, strict=False):
                ax.plot(x, part, color=colour, label=f"{symbol}{c}", **_marker(x))
            ax.plot(x, np.linalg.norm(parts, axis=0), color="black", lw=1, ls="--", label=f"|{symbol}|", **_marker(x))
            ax.set_ylabel(f"{'force' if symbol == 'F' else 'moment'} on the rod [{unit}]")
            ax.set_title(name, fontsize=10, loc="left")
            ax.grid(alpha=0.3)
            ax.legend(fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel(label)
    return figure


def _torque(torque: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Torque over the angle, out and back, and what lies between the two."""
    bands = {name: band for name, table in torque.items() if (band := _band(table)) is not None}
    figure = Figure(figsize=(6.4, 6.0 if bands else 4.0), layout="constrained")
    heights = [2, 1] if bands else [1]
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for (name, table), colour in zip(torque.items(), COLOURS * len(torque), strict=False):
        for k, (rows, style) in enumerate(_ways(table)):
            label = name if name not in bands else f"{name}, {'out' if style == '-' else 'back'}"
            angle, value = table["angle_deg"][rows], table["torque"][rows]
            axes[0].plot(angle, value, style, color=colour, label=label if k < 2 else None, **_marker(angle))
        if name in bands:
            axes[1].plot(*bands[name], color=colour, label=name)
    for ax in axes:
        ax.axhline(0, color="black", lw=0.6)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("torque the drive must supply [N m]")
    axes[0].legend()
    if bands:
        axes[1].set_ylabel("out minus back [N m]")
    axes[-1].set_xlabel("hinge angle [deg]")
    return figure


def _ways(table: dict[str, np.ndarray]) -> list[tuple[slice, str]]:
    """Rows of each way of a hinge, with the state at which it turned, and how its line is drawn: out solid, back dashed."""
    sense = table["sense"]
    cuts = [0, *np.flatnonzero(np.diff(sense)).tolist(), len(sense) - 1]
    return [(slice(a, b + 1), "-" if sense[b] == sense[0] else "--") for a, b in pairwise(cuts) if b > a or b == 0]


def _band(table: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
    """Angles [deg] and torque out minus back there, of the first two ways of a hinge; None if it goes one way."""
    ways = [table["angle_deg"][rows].argsort() + rows.start for rows, _ in _ways(table)[:2]]
    if len(ways) < 2:
        return None
    angle, torque = table["angle_deg"], table["torque"]
    low, high = max(angle[w[0]] for w in ways), min(angle[w[-1]] for w in ways)
    grid = np.unique(np.concatenate([angle[w] for w in ways]))
    grid = grid[(grid >= low) & (grid <= high)]
    there, back = (np.interp(grid, angle[w], torque[w]) for w in ways)
    return grid, there - back


def _drive(table: dict[str, dict[str, np.ndarray]]) -> Figure:
    """What drives must have and have, over the angle."""
    figure = Figure(figsize=(6.4, 3.4 * len(table)), layout="constrained")
    for ax, (name, drive) in zip(figure.subplots(len(table), 1, squeeze=False)[:, 0], table.items(), strict=True):
        sense = drive["sense"]
        for k, rows in enumerate(np.split(np.arange(len(sense)), np.flatnonzero(np.diff(sense)) + 1)):
            way, style = ("out", "-") if sense[rows[0]] == sense[0] else ("back", "--")
            angle = drive["angle_deg"][rows]
            ax.plot(
                angle, drive["required"][rows], style, color=COLOURS[0], label=f"required, {way}" if k < 2 else None
            )
            if k == 0:
                ax.plot(angle, drive["available"][rows], color=COLOURS[1], label="available")
        ax.set_title(f"drive of {name}", fontsize=10, loc="left")
        ax.set_xlabel("hinge angle [deg]")
        ax.set_ylabel("torque in the sense of motion [N m]")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    return figure


def _path(path: pathlib.Path) -> Figure:
    """Factor (or time) over the largest displacement of each rod; unstable states are drawn hollow."""
    with open(path, newline="", encoding="utf-8") as file:
        names = next(csv.reader(file))
        table = np.array([[float(x) for x in row] for row in csv.reader(file)])
    which = "time" if np.ptp(table[:, names.index("factor")]) == 0 else "factor"
    value, unstable = table[:, names.index(which)], table[:, names.index("negative")] > 0
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    ax = figure.subplots()
    for k, name in enumerate(names[5:]):
        moved, colour = table[:, 5 + k], COLOURS[k % len(COLOURS)]
        ax.plot(moved, value, "-", color=colour, lw=1, label=name)
        ax.plot(moved[~unstable], value[~unstable], "o", color=colour, ms=4)
        ax.plot(moved[unstable], value[unstable], "o", color=colour, ms=4, mfc="none")
    ax.set_xlabel("largest displacement [m]; unstable states hollow")
    ax.set_ylabel("time [s]" if which == "time" else "factor of the loads")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure


def _ledger(path: pathlib.Path) -> Figure:
    """Energies and works over time."""
    with open(path, newline="", encoding="utf-8") as file:
        names = next(csv.reader(file))
        table = np.array([[float(x) for x in row] for row in csv.reader(file)])
    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    ax = figure.subplots()
    last = names.index("px")
    for k, name in enumerate(names[1:last], 1):
        style: dict[str, Any] = {"color": f"C{k - 1}", "ls": "-" if k <= 10 else "--"}
        if name == "integrator":
            style = {"color": "black", "ls": ":"}
        label = name if name in ("kinetic", "strain", "integrator") else f"work of {name}"
        ax.plot(table[:, 0], table[:, k], label=label, **style, **_marker(table[:, 0]))
    ax.set_xlabel("time [s]")
    ax.set_ylabel("energy, work [J]")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure


def _marker(x: np.ndarray) -> dict[str, Any]:
    """A single station shows as a dot, not as an invisible line."""
    return {"marker": "o"} if len(x) == 1 else {}
