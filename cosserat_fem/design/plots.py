"""How does a design look? Result and margins over each variable, and what is traded for what.

Rule: reads `design.json` and the CSV files of a design's folder only, so that every plot can be made again later.
"""

from __future__ import annotations

import csv
import json
import pathlib

import numpy as np
from matplotlib.figure import Figure

from ..plots import COLOURS, save

LOWEST, HIGHEST = -1.0, 1.5  # margins that are drawn


def plot_design(folder: pathlib.Path) -> list[pathlib.Path]:
    """Write the plots of a design as svg and png into its folder pictures; return their paths."""
    out = folder / "pictures"
    out.mkdir(exist_ok=True)
    about = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    made: list[pathlib.Path] = []
    names, rows = _table(folder / "trials.csv")
    rows = [row for row in rows if not row["reason"]]
    if rows and "best" in about:
        made += save(_trials(names, rows, about), out / "trials")
    if (folder / "tradeoff.csv").is_file():
        names, rows = _table(folder / "tradeoff.csv")
        if rows:
            made += save(_front(rows, about["tradeoff"]), out / "tradeoff")
    return made


def _table(path: pathlib.Path) -> tuple[list[str], list[dict[str, str]]]:
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        return list(reader.fieldnames or ()), list(reader)


def _trials(names: list[str], rows: list[dict[str, str]], about: dict) -> Figure:
    """One column for each variable: the objective above, the margins below."""
    variables = about["variables"]
    margins = [name for name in names if name.startswith("margin of ")]
    lines = 2 if margins else 1
    figure = Figure(figsize=(1.4 + 4.6 * len(variables), 1.0 + 2.6 * lines), layout="constrained")
    axes = figure.subplots(lines, len(variables), squeeze=False, sharex="col")
    best = next(row for row in rows if int(row["design"]) == about["best"]["number"])
    for column, name in zip(axes.T, variables, strict=True):
        rows = sorted(rows, key=lambda row: float(row[name]))
        x = np.array([float(row[name]) for row in rows])
        style = "o-" if len(variables) == 1 else "o"
        y = np.array([float(row[about["minimise"]]) for row in rows])
        column[0].plot(x, y, style, color=COLOURS[0], ms=3, lw=1)
        column[0].plot(float(best[name]), float(best[about["minimise"]]), "*", color=COLOURS[1], ms=12, label="best")
        column[0].set_ylabel(about["minimise"], fontsize=8)
        column[0].legend(fontsize=8)
        for margin, colour in zip(margins, COLOURS * len(margins), strict=False):
            y = np.clip([float(row[margin]) for row in rows], LOWEST, HIGHEST)
            column[-1].plot(x, y, style, color=colour, ms=3, lw=1, label=margin.removeprefix("margin of "))
        if margins:
            column[-1].axhline(0, color="black", lw=0.8)
            column[-1].axvline(float(best[name]), color=COLOURS[1], lw=0.8, ls="--")
            column[-1].set_ylim(LOWEST - 0.05, HIGHEST + 0.05)
            column[-1].set_ylabel("margin in parts of the limit", fontsize=8)
            column[-1].legend(fontsize=7)
        column[-1].set_xlabel(name, fontsize=8)
        for ax in column:
            ax.grid(alpha=0.3)
            ax.tick_params(labelsize=8)
    return figure


def _front(rows: list[dict[str, str]], names: list[str]) -> Figure:
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.subplots()
    x, y = np.array([[float(row[name]) for name in names] for row in rows]).T
    keeps = np.array([row["keeps"] == "true" for row in rows])
    ax.plot(x, y, "-", color=COLOURS[0], lw=1)
    ax.plot(x[keeps], y[keeps], "o", color=COLOURS[0], label="keeps all limits")
    ax.plot(x[~keeps], y[~keeps], "o", color=COLOURS[0], mfc="none", label="breaks a limit")
    ax.set_xlabel(names[0])
    ax.set_ylabel(names[1])
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure
