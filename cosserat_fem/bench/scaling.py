"""How do time and memory grow? One cable of more and more elements, and more and more cables in one model.

Rule: every size runs in a process of its own, so that its memory is its own. Exponents are slopes of log(cost) over
log(elements) by least squares, over sizes large enough to show: 1000 elements and more.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..equilibrium.statics import solve_static
from ..model import Model
from ..rod import Rod
from ..support import Clamp
from ..terms import Gravity
from . import problems as p
from .measure import quiet, timed
from .models import Case, section, slack_cable

ORDER = 3
PER_ROD = 10
SIZES = {
    "one rod": (10, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000),
    "many rods": (1, 3, 10, 30, 100, 300, 1000),
}
LARGE = 1000  # elements from which exponents are fitted


def build(kind: str, size: int) -> Model:
    """The slack cable (S3) of `size` elements, or `size` such cables of ten elements side by side."""
    if kind == "one rod":
        return slack_cable(Case(size, ORDER))
    guess, _ = p.slack_guess(np.linspace(0, p.SLACK.length, 41))
    cable = section(p.SLACK)
    rods, supports = [], []
    for k in range(size):
        points = np.column_stack([guess, np.full(len(guess), 0.1 * k)])
        rod = Rod(
            f"cable {k}", cable, points, n_elements=PER_ROD, order=ORDER, length=p.SLACK.length,
            start_tangent=(1, 0, 0), end_tangent=(1, 0, 0),
        )  # fmt: skip
        rods.append(rod)
        supports += [Clamp(rod, "start"), Clamp(rod, "end")]
    return Model(rods, supports, [Gravity((0, -p.SLACK_GRAVITY, 0))])


def peak_memory() -> float:
    """Largest memory [MB] that this process has held so far."""
    try:
        with open("/proc/self/status", encoding="ascii") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1024
    except OSError:
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / (1024**2 if sys.platform == "darwin" else 1024)


def one(kind: str, size: int) -> dict[str, Any]:
    """Elements, CPU seconds of building and of the solve call, iterations, memory [MB] of both; in this process."""
    with quiet():
        solve_static(build(kind, 2))  # compiled kernels are loaded
        before, begin = peak_memory(), time.process_time()
        model = build(kind, size)
        building = time.process_time() - begin
        history, spent = timed(lambda: solve_static(model))
    return {
        "size": size,
        "elements": size * (PER_ROD if kind == "many rods" else 1),
        "unknowns": 6 * model.space.n_nodes,
        "build": building,
        "cpu": min(spent),
        "iterations": history.counters.iterations,
        "memory": peak_memory() - before,
    }


def exponent(sizes: Iterable[float], costs: Iterable[float]) -> float:
    """Slope of log(cost) over log(size)."""
    return float(np.polyfit(np.log(list(sizes)), np.log(list(costs)), 1)[0])


def run_scaling(
    sizes: dict[str, tuple[int, ...]] | None = None, *, progress: Callable[[int, int], Any] | None = None
) -> dict[str, Any]:
    """Rows of each study and its exponents of time an iteration and of memory; sizes as `SIZES`."""
    sizes = SIZES if sizes is None else sizes
    studies: dict[str, Any] = {}
    done, total = 0, sum(len(row) for row in sizes.values())
    context = multiprocessing.get_context("spawn")
    for kind, row in sizes.items():
        rows = []
        for size in row:
            with context.Pool(1) as pool:
                rows.append(pool.apply(one, (kind, size)))
            done += 1
            if progress is not None and progress(done, total):
                break
        large = [r for r in rows if r["elements"] >= LARGE and r["memory"] > 0] if len(rows) > 1 else []
        fit = len(large) > 1
        studies[kind] = {
            "rows": rows,
            "time_exponent": exponent([r["elements"] for r in large], [r["cpu"] / r["iterations"] for r in large])
            if fit
            else None,
            "memory_exponent": exponent([r["elements"] for r in large], [r["memory"] for r in large]) if fit else None,
        }
    return studies
