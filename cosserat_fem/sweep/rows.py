"""What did each case of a sweep give? One row for each, read from its folder.

Rule: the folder is all there is; no number is kept only in memory. A number of a case is called by its dotted path in the
case's `summary.json`. What differs from run to run (times spent, versions) is no result.
"""

from __future__ import annotations

import csv
import json
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import nearest
from ..export import replace_file
from ..summary import flat

CASES, CASE, ABOUT, RESULTS = "cases", "case.json", "sweep.json", "results.csv"
PASSING = ("seconds", "versions", "platform", "program", "version", "title", "status", "reason", "discretisation")
PASSING_INSIDE = ("physics.cpu_seconds", "counters")
DONE, LOST, MISSING = ("converged", "stopped", "refused"), "lost", "missing"


@dataclass(frozen=True)
class Row:
    """One case: its number, key, changed values, how it ended and what it found.

    status: "converged"; "stopped" (no equilibrium from some state on; what was found before is reported); "refused" (the
    scene cannot be meant); "lost" (the machine ended it) and "missing" (not run yet): the next call runs these.
    """

    number: int
    key: str
    changes: dict[str, Any]
    status: str = MISSING
    reason: str = ""
    values: dict[str, Any] = field(default_factory=dict)


def results(summary: dict[str, Any]) -> dict[str, Any]:
    """What a summary says that a repeated run says again, by dotted path."""
    found = flat({key: value for key, value in summary.items() if key not in PASSING})
    return {path: value for path, value in found.items() if not path.startswith(PASSING_INSIDE)}


def is_done(folder: pathlib.Path, key: str) -> bool:
    """True if a case has its folder."""
    return (folder / CASES / key / CASE).is_file()


def read_row(folder: pathlib.Path, number: int, key: str, changes: dict[str, Any]) -> Row:
    """The row of a case from its folder; without one it is missing."""
    place = folder / CASES / key
    try:
        said = json.loads((place / CASE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return Row(number, key, changes)
    values: dict[str, Any] = {}
    if said["status"] != "refused":
        values = results(json.loads((place / "summary.json").read_text(encoding="utf-8")))
    return Row(number, key, changes, said["status"], said["reason"], values)


def reported(rows: Sequence[Row], wanted: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Dotted paths to report (all numbers if none were asked for), and what to say of those that no case has."""
    known = list(dict.fromkeys(path for row in rows for path in row.values))
    if wanted is None:
        return [path for path in known if any(is_number(row.values.get(path)) for row in rows)], []
    missing = [path for path in wanted if path not in known] if known else []
    return list(wanted), [f"no case reports {path!r}. {nearest(path, known[:400])}" for path in missing]


def is_number(value: Any) -> bool:
    """True for numbers, not for flags."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def write_results(rows: Sequence[Row], columns: Sequence[str], path: pathlib.Path) -> None:
    """Write one line for each case: number, key, status, reason, changed values, reported values."""
    changes = list(dict.fromkeys(name for row in rows for name in row.changes))

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["case", "key", "status", "reason", *changes, *columns])
            for row in rows:
                given = [_cell(row.changes.get(name)) for name in changes]
                found = [_cell(row.values.get(name)) for name in columns]
                writer.writerow([row.number, row.key, row.status, row.reason, *given, *found])

    replace_file(path, write)


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return value if isinstance(value, str | int | float) else json.dumps(value)
