"""What does accuracy cost? Error, CPU time of the solve call, unknowns and iterations of one case, as a row.

Rule: the model is built before and solved once to warm up; then the solve call alone is timed again and again. CPU time of
the process is what counts, and the least of the repeats: a busy machine only adds to it.
"""

from __future__ import annotations

import logging
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

from ..errors import ConvergenceError, SceneError
from . import THREADS
from .models import SOLVERS, Case
from .problems import PROBLEMS

TOOL = "cosserat_fem"
TARGETS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
REPEATS = 30
ENOUGH = 0.5  # s of CPU time after which a case is not repeated any more


@dataclass(frozen=True)
class Row:
    """One measured case of one tool.

    error : as the problem measures it, or None if it failed
    cpu, median : [s] least and median CPU time of the solve call;  runs : how often it was timed
    dofs : unknowns;  iterations, steps : of Newton's method and in time, 0 if not told
    failed : why there is no error
    """

    problem: str
    tool: str
    method: str
    resolution: str
    error: float | None
    cpu: float
    median: float
    runs: int
    dofs: int
    iterations: int = 0
    steps: int = 0
    failed: str = ""


@contextmanager
def quiet() -> Iterator[None]:
    """Warnings of models are not what is measured."""
    log = logging.getLogger("cosserat_fem")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def timed(solve: Callable[[], Any], *, repeats: int = REPEATS, enough: float = ENOUGH) -> tuple[Any, list[float]]:
    """What a first, not timed call returns, and the CPU seconds [s] of those after it."""
    result, spent = solve(), list[float]()
    while not spent or (len(spent) < repeats and sum(spent) < enough):
        begin = time.process_time()
        solve()
        spent.append(time.process_time() - begin)
    return result, spent


def measure(name: str, case: Case, **options: Any) -> Row:
    """Solve one case of one problem. Options as of `timed`."""
    problem, solver = PROBLEMS[name], SOLVERS[name]
    unknowns = 3 if case.plane else 6
    with quiet():
        model = solver.build(case)
        dofs = unknowns * model.space.n_nodes
        try:
            history, spent = timed(lambda: solver.solve(model, case), **options)
            error = problem.error(solver.observe(history))
        except (ConvergenceError, SceneError) as fault:
            return Row(name, TOOL, case.method, case.resolution, None, 0.0, 0.0, 0, dofs, failed=str(fault))
    return Row(
        name, TOOL, case.method, case.resolution, error, min(spent), statistics.median(spent), len(spent), dofs,
        history.counters.iterations, len(history.steps),
    )  # fmt: skip


def run_bench(
    names: Iterable[str] | None = None, *, progress: Callable[[int, int], Any] | None = None, **options: Any
) -> list[Row]:
    """Measure every case of the named problems, all by default; what is done when Ctrl-C comes is returned.

    progress : called with (done, total) after each case.  Options as of `timed`.
    """
    cases = [(name, case) for name in (PROBLEMS if names is None else names) for case in SOLVERS[name].cases]
    rows: list[Row] = []
    for name, case in cases:
        rows.append(measure(name, case, **options))
        if progress is not None and progress(len(rows), len(cases)):
            break
    return rows


def fastest(rows: Iterable[Row], problem: str, target: float) -> Row | None:
    """The cheapest row of a problem at or below an error."""
    good = [row for row in rows if row.problem == problem and row.error is not None and row.error <= target]
    return min(good, key=lambda row: row.cpu, default=None)


def front(rows: Iterable[Row]) -> list[Row]:
    """Rows that no cheaper row is as accurate as, from cheap to dear."""
    kept: list[Row] = []
    for row in sorted((row for row in rows if row.error is not None), key=lambda row: row.cpu):
        if not kept or row.error < kept[-1].error:  # type: ignore[operator]
            kept.append(row)
    return kept


def machine(packages: Iterable[str] = ("numpy", "scipy", "numba", TOOL)) -> dict[str, Any]:
    """Where it was measured: processor, cores, load, threads, versions."""
    processor = platform.processor()  # on Linux often empty; the file is there only
    with suppress(FileNotFoundError), open("/proc/cpuinfo", encoding="utf-8") as file:
        processor = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), processor)
    versions = {"python": platform.python_version()}
    for package in packages:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "from source"
    return {
        "processor": processor,
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "load": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "threads": {name: os.environ.get(name) for name in THREADS},
        "versions": versions,
    }


def as_json(rows: Iterable[Row], **more: Any) -> dict[str, Any]:
    """What bench.json holds."""
    problems = {
        p.name: {"title": p.title, "source": p.source, "measured": p.measured, "planar": p.planar}
        for p in PROBLEMS.values()
    }
    return {
        "program": TOOL, "kind": "bench", "machine": machine(), "problems": problems, "rows": [asdict(r) for r in rows],
        **more,
    }  # fmt: skip
