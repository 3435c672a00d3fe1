"""What does a sweep write, and what does it tell? The folder of a sweep, filled by whoever runs cases.

Rule: the tables are written from the folders of the cases alone, also when the sweep was stopped; they are the same
whichever process ran a case.
"""

from __future__ import annotations

import json
import pathlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..errors import SceneError
from ..export import replace_file
from ..folder import PROGRAM, check_study, hold
from ..scene import Scene
from ..scene.edit import said
from .case import Job, clear_unfinished, key_of, run_case
from .cluster import run_on_scheduler, run_on_workers
from .rows import ABOUT, DONE, LOST, MISSING, RESULTS, Row, is_done, read_row, reported, write_results
from .statistics import correlations, envelopes, write_correlations, write_envelopes

OURS = ("cases", "pictures", RESULTS, "correlations.csv", "torque_envelope.csv")


@dataclass(frozen=True)
class Sweep:
    """What a sweep left: its folder, a row for each case, how many cases were run now, and what to tell besides.

    same: the folder says what it said before.
    """

    folder: pathlib.Path
    rows: tuple[Row, ...]
    run: int
    same: bool = False
    notes: tuple[str, ...] = ()

    def count(self, status: str) -> int:
        """How many cases ended so."""
        return sum(row.status == status for row in self.rows)


def run_sweep(
    scene: Scene,
    out: pathlib.Path | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], bool | None] | None = None,
) -> Sweep:
    """Run the cases of a scene's `[sweep]` that are not in its folder yet, and write its tables.

    Parameters
    ----------
    out : folder, default `[sweep] folder`, else out/<name of the scene>_sweep
    workers : int
        Run cases on a local Dask cluster of so many processes; default is this process.
    scheduler : str
        Address of a Dask scheduler to run them on instead. Its workers must see the folder under the same path.
    progress : function (cases done, cases to do) -> bool
        Called after each case; return True to stop there.

    Raises
    ------
    SceneError
        The scene has no `[sweep]`, or the folder or the workers cannot be used.
    """
    source, sweep = scene.source, scene.tables.sweep
    if sweep is None:
        raise SceneError(f"{source.path}: has no [sweep] that says what to vary.")
    folder = (out or pathlib.Path(sweep.folder or pathlib.Path("out") / f"{source.path.stem}_sweep")).resolve()
    check_study(folder, ABOUT, OURS)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with hold(folder):
            return _in_folder(scene, folder, workers, scheduler, progress)
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r}: cannot be written: {error.strerror}.") from None


def _in_folder(
    scene: Scene,
    folder: pathlib.Path,
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[int, int], bool | None] | None,
) -> Sweep:
    """The sweep in a folder that is held."""
    clear_unfinished(folder)
    cases = scene.cases
    jobs = _jobs(scene, folder, cases)
    about = folder / ABOUT
    before = about.read_text(encoding="utf-8") if about.is_file() else ""
    if not before:
        _write_about(scene, folder, jobs, [], {})
    missing = list({job.key: job for job in jobs if not is_done(folder, job.key)}.values())
    problems: dict[str, str] = {}
    done = 0
    try:
        for job, problem in _run(missing, workers, scheduler):
            done += 1
            if problem:
                problems[job.key] = problem
            if progress is not None and progress(done, len(missing)):
                break
    finally:
        clear_unfinished(folder)
        rows = [read_row(folder, k, job.key, case) for k, (job, case) in enumerate(zip(jobs, cases, strict=True))]
        rows = [replace(row, status=LOST, reason=problems[row.key]) if row.key in problems else row for row in rows]
        notes = _write_tables(scene, folder, jobs, rows)
    same = not missing and about.read_text(encoding="utf-8") == before
    return Sweep(folder, tuple(rows), done, same, tuple(notes))


def _jobs(scene: Scene, folder: pathlib.Path, cases: Sequence[dict[str, Any]]) -> list[Job]:
    source, sweep = scene.source, scene.tables.sweep
    report = sweep.report if sweep is not None else None
    clear = report is None or any(path.startswith("clearances.") for path in report)
    errors = sweep is not None and sweep.errors
    path = str(source.path.resolve())
    return [Job(path, source.text, key_of(source, case), case, str(folder), errors, clear) for case in cases]


def _run(jobs: Sequence[Job], workers: int | None, scheduler: str | None) -> Iterable[tuple[Job, str]]:
    if not jobs:
        return ()
    if scheduler is not None:
        return run_on_scheduler(jobs, scheduler)
    if workers is not None:
        return run_on_workers(jobs, min(workers, len(jobs)))
    return _here(jobs)


def _here(jobs: Sequence[Job]) -> Iterator[tuple[Job, str]]:
    for job in jobs:
        yield job, run_case(job)


def _write_tables(scene: Scene, folder: pathlib.Path, jobs: Sequence[Job], rows: Sequence[Row]) -> list[str]:
    """All tables of a sweep; what to tell about them."""
    sweep = scene.tables.sweep
    columns, notes = reported(rows, sweep.report if sweep is not None else None)
    write_results(rows, columns, folder / RESULTS)
    write_correlations(correlations(rows, columns), folder / "correlations.csv")
    write_envelopes(envelopes(folder, rows), folder / "torque_envelope.csv")
    counts = {status: sum(row.status == status for row in rows) for status in (*DONE, LOST, MISSING)}
    _write_about(scene, folder, jobs, columns, counts)
    for status in ("stopped", "refused", LOST):
        first = next((row for row in rows if row.status == status), None)
        if first is not None:
            reason = first.reason.splitlines()[0] if first.reason else ""
            notes.append(
                f"{counts[status]} {status}; the first is case {first.number} ({said(first.changes)}): {reason}"
            )
    if counts[MISSING]:
        notes.append(f"{counts[MISSING]} not run yet; the next call runs them")
    return notes


def _write_about(
    scene: Scene, folder: pathlib.Path, jobs: Sequence[Job], columns: Sequence[str], counts: dict[str, int]
) -> None:
    """What the sweep is: scene, what is varied, what is reported, keys of the cases."""
    sweep = scene.tables.sweep
    data = {
        "program": PROGRAM,
        "title": scene.title,
        "scene": str(scene.source.path.resolve()),
        "kind": sweep.kind if sweep is not None else None,
        "varied": [entry.path for entry in sweep.vary] if sweep is not None else [],
        "report": sweep.report if sweep is not None else None,
        "columns": list(columns),
        "counts": counts,
        "cases": [job.key for job in jobs],
    }
    text = json.dumps(data, indent=2) + "\n"
    replace_file(folder / ABOUT, lambda path: path.write_text(text, encoding="utf-8"))
