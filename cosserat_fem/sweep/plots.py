"""How does a sweep look? Torque envelopes, which value matters, and results over each changed value.

Rule: reads the CSV files and `sweep.json` of a sweep's folder only, so that every plot can be made again later.
"""

from __future__ import annotations

import csv
import json
import pathlib

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..plots import COLOURS, save
from .rows import ABOUT

MOST = 6  # results that are drawn; all are in the tables
STRIP = 24  # characters of a dotted path beside an axis


def plot_sweep(folder: pathlib.Path) -> list[pathlib.Path]:
    """Write the plots of a sweep as svg and png into its folder pictures; return their paths."""
    out = folder / "pictures"
    out.mkdir(exist_ok=True)
    about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    made = []
    for name, draw in (
        ("torque_envelope", _envelopes),
        ("correlations", _correlations),
        ("results", _results),
    ):
        rows = _table(folder / f"{name}.csv")
        figure = draw(rows, about) if rows else None
        if figure is not None:
            made += save(figure, out / name)
    return made


def _table(path: pathlib.Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _envelopes(rows: list[dict[str, str]], about: dict) -> Figure:
    parts = list(dict.fromkeys(row["part"] for row in rows))
    figure = Figure(figsize=(7.2, 3.6 * len(parts)), layout="constrained")
    for ax, part in zip(figure.subplots(len(parts), 1, squeeze=False)[:, 0], parts, strict=True):
        mine = [row for row in rows if row["part"] == part]
        for way in dict.fromkeys(row["way"] for row in mine):
            colour = COLOURS[int(way) % len(COLOURS)]
            names = ("angle_deg", "least", "percentile_5", "percentile_50", "percentile_95", "largest")
            angle, least, low, middle, high, most = np.array(
                [[float(row[name]) for name in names] for row in mine if row["way"] == way]
            ).T
            ax.fill_between(angle, low, high, color=colour, alpha=0.3, lw=0, label=f"way {int(way) + 1}: 5 to 95 %")
            ax.plot(angle, middle, color=colour, label="median")
            ax.plot(angle, least, color=colour, lw=0.7, ls=":", label="all cases")
            ax.plot(angle, most, color=colour, lw=0.7, ls=":")
        ax.axhline(0, color="black", lw=0.6)
        ax.set_title(f"{part}, {mine[0]['cases']} cases", fontsize=10, loc="left")
        ax.set_xlabel("hinge angle [deg]")
        ax.set_ylabel("torque the drive must supply [N m]")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    return figure


def _correlations(rows: list[dict[str, str]], about: dict) -> Figure:
    results = list(dict.fromkeys(row["result"] for row in rows))
    chosen = ([name for name in about["report"] or [] if name in results] or results)[:MOST]
    figure = Figure(figsize=(7.2, 1.0 + 1.4 * len(chosen)), layout="constrained")
    for ax, name in zip(figure.subplots(len(chosen), 1, squeeze=False, sharex=True)[:, 0], chosen, strict=True):
        mine = [row for row in rows if row["result"] == name][::-1]
        ax.barh([_short(row["varied"]) for row in mine], [float(row["spearman"]) for row in mine], color=COLOURS[0])
        ax.axvline(0, color="black", lw=0.6)
        ax.set_xlim(-1.05, 1.05)
        ax.set_title(name, fontsize=9, loc="left")
        ax.tick_params(labelsize=8)
        ax.grid(alpha=0.3, axis="x")
    ax.set_xlabel("rank correlation (Spearman)")
    return figure


def _results(rows: list[dict[str, str]], about: dict) -> Figure | None:
    """Each result over each changed number, a dot for each converged case."""
    cases = [row for row in rows if row["status"] == "converged"]
    varied = [name for name in about["varied"] if cases and all(_number(case[name]) is not None for case in cases)]
    results = [name for name in about["columns"] if any(_number(case[name]) is not None for case in cases)][:MOST]
    if not varied or not results:
        return None
    figure = Figure(figsize=(1.2 + 2.6 * len(varied), 0.6 + 2.2 * len(results)), layout="constrained")
    axes = figure.subplots(len(results), len(varied), squeeze=False, sharex="col", sharey="row")
    for row, (line, result) in enumerate(zip(axes, results, strict=True)):
        for ax, name in zip(line, varied, strict=True):
            points = [(_number(case[name]), _number(case[result])) for case in cases]
            x, y = np.array([point for point in points if point[1] is not None], dtype=float).T
            ax.plot(x, y, "o", ms=3, color=COLOURS[0], alpha=0.7)
            ax.grid(alpha=0.3)
            ax.tick_params(labelsize=8)
            ax.xaxis.set_major_locator(MaxNLocator(4))
            if row == len(results) - 1:
                ax.set_xlabel(_short(name), fontsize=8)
        line[0].set_ylabel(_short(result), fontsize=8)
    return figure


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _short(name: str) -> str:
    """A dotted path in lines that fit beside an axis."""
    lines, line = [], ""
    for word in name.split("."):
        if line and len(line) + len(word) > STRIP:
            lines.append(line + ".")
            line = word
        else:
            line = f"{line}.{word}" if line else word
    return "\n".join([*lines, line])
