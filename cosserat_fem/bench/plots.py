"""How do error and cost look? Work-precision diagrams, one panel a problem, and cost against size.

Rule: draws rows that were measured, ours or another tool's, and measures nothing.
"""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ..export import replace_file
from .measure import TOOL, Row, front
from .problems import PROBLEMS

OURS = {1: "#9ecae1", 2: "#6baed6", 3: "#2171b5", 4: "#08306b"}
THEIRS = ("#d1495b", "#edae49", "#66a182", "#7a5195", "#8d6a4f", "#555555")


def plot_work_precision(rows: Sequence[Row], stem: pathlib.Path) -> list[pathlib.Path]:
    """Error against CPU time, log-log: a line for each of our orders, and the front of each other tool."""
    names = [name for name in PROBLEMS if any(row.problem == name for row in rows)]
    columns = min(3, len(names))
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.6 * lines + 0.6), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    tools = [tool for tool in dict.fromkeys(row.tool for row in rows) if tool != TOOL]
    for ax, name in zip(axes, names, strict=False):
        _panel(ax, [row for row in rows if row.problem == name and row.error], tools)
        ax.set_title(f"{name}: {PROBLEMS[name].title}", fontsize=10, loc="left")
    for ax in axes[len(names) :]:
        ax.remove()
    handles = {
        label: line for ax in axes[: len(names)] for line, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(5, len(handles)), fontsize=8)
    return _save(figure, stem)


def _panel(ax: Any, rows: Sequence[Row], tools: Sequence[str]) -> None:
    ours: dict[tuple[bool, int], list[Row]] = {}
    for row in rows:
        if row.tool == TOOL:
            ours.setdefault(("planar" in row.method, int(row.method.split()[1])), []).append(row)
    for (planar, order), line in sorted(ours.items()):
        style: dict[str, Any] = {"ls": "-" if planar else "--", "marker": "o" if planar else "s", "ms": 4, "lw": 1.3}
        label = f"{TOOL}, order {order}" + (", planar" if planar else "")
        shown = [(1e3 * row.cpu, row.error) for row in line]
        ax.loglog(*zip(*shown, strict=True), color=OURS.get(order, "black"), label=label, **style)
    for tool, colour in zip(tools, THEIRS * len(tools), strict=False):
        line = front(row for row in rows if row.tool == tool)
        if line:
            shown = [(1e3 * row.cpu, row.error) for row in line]
            ax.loglog(*zip(*shown, strict=True), color=colour, marker="^", ms=5, lw=1.3, label=tool)
    low, high = ax.get_xlim()
    ax.set_xlim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high)))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("CPU time of the solve [ms]")
    ax.set_ylabel("error")
    ax.grid(alpha=0.3, which="both")


def plot_scaling(scaling: dict[str, Any], stem: pathlib.Path) -> list[pathlib.Path]:
    """CPU time of an iteration and memory against unknowns, with the fitted exponents."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    time_axis, memory_axis = figure.subplots(1, 2)
    for (name, study), colour in zip(scaling.items(), THEIRS, strict=False):
        size = [row["elements"] for row in study["rows"]]
        label = f"{name}: "
        time_axis.loglog(
            size, [row["cpu"] / row["iterations"] for row in study["rows"]], color=colour, marker="o", ms=4,
            label=f"{label}exponent {study['time_exponent']:.2f}",
        )  # fmt: skip
        memory_axis.loglog(
            size, [row["memory"] for row in study["rows"]], color=colour, marker="o", ms=4,
            label=f"{label}exponent {study['memory_exponent']:.2f}",
        )  # fmt: skip
    for ax, what in ((time_axis, "CPU time of an iteration [s]"), (memory_axis, "memory of model and solve [MB]")):
        ax.set_xlabel("elements of order 3")
        ax.set_ylabel(what)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    return _save(figure, stem)


def _save(figure: Figure, stem: pathlib.Path) -> list[pathlib.Path]:
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    for path in paths:
        replace_file(path, lambda temporary: figure.savefig(temporary, dpi=110))
    return paths
