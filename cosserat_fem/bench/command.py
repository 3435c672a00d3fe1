"""What does the bench print and write? Tables, bench.json, pictures.

Rule: files are written into the bench's own folder, one that is new, empty or holds an earlier bench; what was measured is
written also when the user stops it.
"""

from __future__ import annotations

import io
import json
import pathlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ..errors import SceneError, nearest
from ..export import replace_file
from .measure import TARGETS, TOOL, Row, as_json, fastest, run_bench
from .problems import PROBLEMS
from .scaling import run_scaling

RESULT = "bench.json"


def bench(
    problems: Sequence[str] | None,
    out: pathlib.Path,
    *,
    plot: bool = False,
    peers: pathlib.Path | None = None,
    scaling: bool = False,
    repeats: int = 30,
    progress: Callable[[int, int], Any] | None = None,
) -> str:
    """Measure, write `bench.json` and, if asked, diagrams; return what is to be said. See `cosserat-fem bench --help`.

    Raises
    ------
    SceneError
        No such problem, a folder or file that cannot be used.
    """
    names = check_names(problems)
    if repeats < 1:
        raise SceneError(f"repeats must be 1 or more (got {repeats}).")
    theirs = [] if peers is None else read_rows(peers)
    check_folder(out)
    told = []
    studies = run_scaling(progress=progress) if scaling else None
    rows = [] if scaling else run_bench(names, progress=progress, repeats=repeats)
    data = as_json(rows) if studies is None else as_json(rows, scaling=studies)
    stem = "scaling" if scaling else "bench"
    replace_file(
        out / f"{stem}.json", lambda file: file.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    )
    if studies is not None:
        told.append(scaling_table(studies))
    else:
        told += [table(rows), summary_table([*rows, *(row for row in theirs if row.problem in names)])]
    told.append(f"Results in {out / f'{stem}.json'}")
    if plot:
        from . import plots

        if studies is not None:
            paths = plots.plot_scaling(studies, out / "scaling")
        else:
            paths = plots.plot_work_precision(
                [*rows, *(row for row in theirs if row.problem in names and row.tool != TOOL)], out / "work_precision"
            )
        told.append(f"Pictures in {', '.join(str(path) for path in paths)}")
    return "\n".join(told)


def check_names(problems: Sequence[str] | None) -> list[str]:
    """The named problems in the order of `PROBLEMS`; SceneError for one that does not exist."""
    faults = [
        f"problem {n!r} does not exist. {nearest(n, list(PROBLEMS))}" for n in problems or () if n not in PROBLEMS
    ]
    if faults:
        raise SceneError(faults)
    return [name for name in PROBLEMS if not problems or name in problems]


def check_folder(out: pathlib.Path) -> None:
    """Make the folder; SceneError if a file of a name of ours in it is not ours."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(
            f"output folder {str(out)!r}: cannot be made: {error.strerror}. Choose another with -o."
        ) from None
    taken = [p for stem in ("bench", "work_precision", "scaling") for p in sorted(out.glob(f"{stem}.*"))]
    if taken and not any(_is_ours(path) for path in taken):
        raise SceneError(
            f"output folder {str(out)!r}: holds {taken[0].name!r} and is not an earlier bench. Choose another with -o."
        )


def _is_ours(path: pathlib.Path) -> bool:
    try:
        return path.suffix == ".json" and json.loads(path.read_text(encoding="utf-8")).get("program") == TOOL
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def read_rows(path: pathlib.Path) -> list[Row]:
    """Rows of a JSON that the bench or its peers wrote; SceneError if it is not one."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return [Row(**row) for row in data["rows"]]
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}.") from None
    except (ValueError, TypeError, KeyError, RecursionError):
        raise SceneError(f"{path}: is not a result of the bench (no rows of measured cases).") from None


def _text(table: Any) -> str:
    from rich.console import Console

    file = io.StringIO()
    Console(file=file, width=150, no_color=True).print(table)
    return file.getvalue().rstrip()


def _table(title: str, columns: Sequence[str]) -> Any:
    from rich import box
    from rich.table import Table

    made = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for k, column in enumerate(columns):
        made.add_column(column, justify="left" if k < 3 else "right")
    return made


def table(rows: Iterable[Row]) -> str:
    """Every row: error, CPU time of the solve, unknowns, iterations, time steps."""
    made = _table("Error and CPU time of the solve call", (
        "problem", "method", "resolution", "error", "CPU ms", "median", "runs", "unknowns", "iterations", "steps",
    ))  # fmt: skip
    before = None
    for row in rows:
        if before not in (None, row.problem):
            made.add_section()
        error = f"{row.error:.1e}" if row.error is not None else "failed"
        costs = (f"{1e3 * row.cpu:.3g}", f"{1e3 * row.median:.3g}", str(row.runs)) if row.runs else ("", "", "")
        method = row.method if row.tool == TOOL else f"{row.tool}: {row.method}"
        made.add_row(
            row.problem if before != row.problem else "", method, row.resolution, error, *costs,
            str(row.dofs), str(row.iterations or ""), str(row.steps or ""),
        )  # fmt: skip
        before = row.problem
    return _text(made)


def summary_table(rows: Sequence[Row]) -> str:
    """For each problem and error the cheapest row of ours at or below it and, if there are others, theirs and the ratio."""
    others = sorted({row.tool for row in rows} - {TOOL})
    made = _table(
        "The fastest at or below an error",
        ("problem", "error", "ours", "CPU ms", *(("other tool", "CPU ms", "ratio") if others else ())),
    )
    for name in dict.fromkeys(row.problem for row in rows):
        for target in TARGETS:
            ours = fastest((row for row in rows if row.tool == TOOL), name, target)
            theirs = fastest((row for row in rows if row.tool != TOOL), name, target)
            cells = [name, f"{target:.0e}", *_told(ours)]
            if others:
                cells += _told(theirs)
                cells.append(f"{theirs.cpu / ours.cpu:.3g}" if ours is not None and theirs is not None else "")
            made.add_row(*cells)
    return _text(made)


def _told(row: Row | None) -> tuple[str, str]:
    """What it is, with its error, and its CPU milliseconds."""
    if row is None:
        return "not reached", ""
    tool = "" if row.tool == TOOL else f"{row.tool} "
    return f"{tool}{row.method}, {row.resolution} ({row.error:.1e})", f"{1e3 * row.cpu:.3g}"


def scaling_table(studies: dict[str, Any]) -> str:
    """Sizes, time and memory by element, and the fitted exponents."""
    made = _table("Time and memory", (
        "study", "size", "unknowns", "build s", "solve CPU s", "iterations", "us an element and iteration", "MB",
        "kB an element",
    ))  # fmt: skip
    for kind, study in studies.items():
        for row in study["rows"]:
            each = 1e6 * row["cpu"] / row["iterations"] / row["elements"]
            made.add_row(
                kind, str(row["size"]), str(row["unknowns"]), f"{row['build']:.3g}", f"{row['cpu']:.3g}",
                str(row["iterations"]), f"{each:.2f}", f"{row['memory']:.1f}",
                f"{1024 * row['memory'] / row['elements']:.1f}",
            )  # fmt: skip
        made.add_section()
    fitted = [
        f"{kind}: time of an iteration ~ elements^{study['time_exponent']:.2f}, memory ~ "
        f"elements^{study['memory_exponent']:.2f}"
        for kind, study in studies.items()
        if study["time_exponent"] is not None
    ]
    return "\n".join([_text(made), *fitted])
