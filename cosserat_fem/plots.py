"""How do the curves look? Forces, moments, hinge torque and margins from the files of a run folder.

Rule: reads the run folder only, so that every plot can be made again later.
"""

from __future__ import annotations

import csv
import pathlib
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .cables.band import FOLDER as STICK
from .export import replace_file

ROUND_OFF = 1e-12  # of a force (at 1 m) beside a moment, and the other way round
Tables = dict[str, dict[str, np.ndarray]]  # by name, then by column
# told apart by the colour-blind too. Source: Okabe and Ito, Color Universal Design (2008)
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


def read_table(path: pathlib.Path, key: str) -> dict[str, dict[str, np.ndarray]]:
    """Columns of a CSV, split by the names in one of its columns; NaN where a cell is empty."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = dict.fromkeys(row[key] for row in rows)
    columns = [c for c in (rows[0] if rows else {}) if c != key]
    return {n: {c: np.array([float(r[c] or "nan") for r in rows if r[key] == n]) for c in columns} for n in names}


def plot_run(folder: pathlib.Path, out: pathlib.Path) -> list[pathlib.Path]:
    """Write reactions and, where there are such, hinge_torque, drive, ledger, path, margins and margin_map as svg and png.

    Returns their paths.
    """
    return [path for name, figure in figures(folder).items() for path in save(figure, out / name)]


def figures(folder: pathlib.Path, *, single: bool = False) -> dict[str, Figure]:
    """Figures of a run by name. single: one for the reactions of each support (reactions_0, ...), not one for all.

    Of a run at both ends of its stiffness torque and size of reactions are drawn for both.
    """
    reactions, torque = _tables(folder)
    stuck = folder / STICK
    other = _tables(stuck) if (stuck / "hinge_torque.csv").is_file() else ({}, {})
    made = {}
    if reactions and not single:
        made["reactions"] = _reactions(reactions, torque, *other)
    if torque:
        made["hinge_torque"] = _torque(torque, other[1])
    if (folder / "drive.csv").is_file():
        made["drive"] = _drive(read_table(folder / "drive.csv", "part"))
    if reactions and single:
        made |= {
            f"reactions_{k}": _reactions({name: table}, torque, *other)
            for k, (name, table) in enumerate(reactions.items())
        }
    if (folder / "ledger.csv").is_file():
        made["ledger"] = _ledger(folder / "ledger.csv")
    if (folder / "path.csv").is_file():
        made["path"] = _path(folder / "path.csv")
    if (folder / "margins.npz").is_file():
        kept = np.load(folder / "margins.npz")
        made["margins"] = _margins(kept)
        if any(f"map_{k}" in kept and len(kept["order"]) > 1 for k in range(len(kept["names"]))):
            made["margin_map"] = _margin_map(kept)
    return made


def _tables(folder: pathlib.Path) -> tuple[Tables, Tables]:
    return read_table(folder / "reactions.csv", "support"), read_table(folder / "hinge_torque.csv", "part")


def save(figure: Figure, stem: pathlib.Path) -> list[pathlib.Path]:
    """Write a figure as svg and png; return their paths."""
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    for path in paths:
        replace_file(path, lambda temporary: figure.savefig(temporary, dpi=150))
    return paths


def _abscissa(reactions: Tables, torque: Tables) -> tuple[np.ndarray, str]:
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


def _reactions(reactions: Tables, torque: Tables, other: Tables, other_torque: Tables) -> Figure:
    x, label = _abscissa(reactions, torque)
    also = other and other.keys() >= reactions.keys()
    x2 = _abscissa(other, other_torque)[0] if also else x
    figure = Figure(figsize=(9.6, 3.1 * len(reactions)), layout="constrained")
    axes = figure.subplots(len(reactions), 2, squeeze=False, sharex=True)
    for row, (name, table) in zip(axes, reactions.items(), strict=True):
        largest = {symbol: max(np.abs(table[f"{symbol}{c}"]).max() for c in "xyz") for symbol in "FM"}
        for ax, symbol, unit in ((row[0], "F", "N"), (row[1], "M", "N m")):
            parts = [table[f"{symbol}{c}"] for c in "xyz"]
            if largest[symbol] < ROUND_OFF * max(largest.values()):
                ax.set(ylim=(-1, 1), yticks=[0])
            for part, c, colour in zip(parts, "xyz", COLOURS, strict=False):
                ax.plot(x, part, color=colour, label=f"{symbol}{c}", **_marker(x))
            ax.plot(x, np.linalg.norm(parts, axis=0), color="black", lw=1, ls="--", label=f"|{symbol}|", **_marker(x))
            if also:
                size = np.linalg.norm([other[name][f"{symbol}{c}"] for c in "xyz"], axis=0)
                ax.plot(x2, size, color="black", lw=1.2, ls=":", label=f"|{symbol}|, sticking", **_marker(x2))
            ax.set_ylabel(f"{'force' if symbol == 'F' else 'moment'} on the rod [{unit}]")
            ax.set_title(name, fontsize=10, loc="left")
            ax.grid(alpha=0.3)
            ax.legend(fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel(label)
    return figure


def _torque(torque: Tables, other: Tables) -> Figure:
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
        if name in other:
            angle, value = other[name]["angle_deg"], other[name]["torque"]
            axes[0].plot(angle, value, ":", color=colour, label=f"{name}, sticking strands", **_marker(angle))
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


def _drive(table: Tables) -> Figure:
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
    figure = Figure(figsize=(8.4, 4.0), layout="constrained")
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
    figure.legend(fontsize=8, loc="outside right upper")
    return figure


def _over(kept: Any, k: int) -> tuple[np.ndarray, str]:
    """What a margin is drawn over: the angle of its hinge if that only grows or only falls, else time or station."""
    angle = kept[f"angle_{k}"] if f"angle_{k}" in kept else np.empty(0)
    if len(angle) > 1 and (np.all(np.diff(angle) > 0) or np.all(np.diff(angle) < 0)):
        return angle, "hinge angle [deg]"
    return (kept["t"], "time [s]") if np.all(np.diff(kept["t"]) > 0) else (kept["order"], "station along the path")


def _margins(kept: Any) -> Figure:
    """Margin of every check over the run; what is below 0 is not allowed."""
    figure = Figure(figsize=(7.6, 4.4), layout="constrained")
    ax = figure.subplots()
    low = 0.0
    for k, name in enumerate(kept["names"]):
        x, label = _over(kept, k)
        ax.plot(x, kept[f"margin_{k}"], color=f"C{k % 10}", ls=("-", "--", ":")[k // 10 % 3], label=name, **_marker(x))
        low = min(low, np.nanmin(kept[f"margin_{k}"], initial=0.0))
        ax.set_xlabel(label)
    bottom = max(low, -1.0) - 0.1
    ax.set_ylim(bottom, 1.05)
    ax.axhspan(bottom, 0.0, color="#d1495b", alpha=0.12, lw=0)
    ax.axhline(0, color="black", lw=0.8)
    ax.set_ylabel("part left of what is allowed" + (", cut at -1" if low < -1 else ""))
    ax.grid(alpha=0.3)
    figure.legend(fontsize=8, loc="outside lower center", ncols=2)
    return figure


def _margin_map(kept: Any) -> Figure:
    """Margin of each check along a rod, over arc length and the run; black line: the limit; cross: the worst place."""
    shown = [k for k in range(len(kept["names"])) if f"map_{k}" in kept]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(5.2 * columns, 2.8 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes[len(shown) :]:
        ax.remove()
    for ax, k in zip(axes, shown, strict=False):
        (x, label), s, field = _over(kept, k), kept[f"s_{k}"], kept[f"map_{k}"]
        mesh = ax.pcolormesh(x, s, field.T, cmap="RdBu", vmin=-1, vmax=1, shading="nearest", rasterized=True)
        if np.nanmin(field) < 0 < np.nanmax(field):
            ax.contour(x, s, np.nan_to_num(field.T, nan=1.0), levels=[0.0], colors="black", linewidths=0.8)
        ax.set_facecolor("0.8")  # where it is not looked at
        i, j = np.unravel_index(np.nanargmin(field), field.shape)
        ax.plot(x[i], s[j], "kx", ms=7)
        ax.set_title(f"{kept['names'][k]}: worst {field[i, j]:+.2f}", fontsize=9, loc="left")
        ax.set_xlabel(label)
        ax.set_ylabel("arc length [m]")
    figure.colorbar(mesh, ax=axes[: len(shown)].tolist(), label="margin (red: not allowed)", extend="min", shrink=0.8)
    return figure


def _marker(x: np.ndarray) -> dict[str, Any]:
    """A single station shows as a dot, not as an invisible line."""
    return {"marker": "o"} if len(x) == 1 else {}
