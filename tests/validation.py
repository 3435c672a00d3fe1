"""One page that lists every verified case: `python -m pytest -m validation --write-validation`.

A test asks for the fixture `validation` and hands in rows: case, source of the reference, reference, result, acceptance.
A row asserts that its error is accepted; on the page stand all rows of the run, also those that fail, with the reason.
Rows of one case are variants of it: the page shows the one that is nearest to its acceptance, and how many there are.
Rows travel as properties of a test's last report, so those of tests that ran in other processes are on the page too.
"""

import json
import pathlib
import platform
from dataclasses import asdict, dataclass
from importlib import metadata

import numpy as np
import pytest

PAGE = pathlib.Path(__file__).parent / "verification" / "VALIDATION.md"
HEAD = """# Validation

Written by `python -m pytest -m validation --write-validation`; do not edit. References come from outside the
package: closed forms, boundary value problems and other independent solvers, publications. Errors are relative to the
reference unless the unit says otherwise; of several variants the one nearest to its acceptance is shown. Orders are observed
ones, from errors against the reference at several element or step counts. Time: of the test that found the row, compile
apart; it scatters by a factor of two.

"""


@dataclass
class Row:
    """One result against its reference."""

    test: str
    case: str
    source: str
    reference: str
    result: str
    error: float
    acceptance: float
    unit: str = ""
    variant: str = ""
    order: float | None = None
    reason: str = ""
    time: float = np.nan

    @property
    def strain(self):
        """How near the error is to what is accepted; above 1 it fails."""
        return np.inf if self.reason or not np.isfinite(self.error) else self.error / self.acceptance


ROWS = pytest.StashKey[list]()
PROPERTY = "validation row"


@dataclass
class Validation:
    """Rows of one test."""

    test: str
    rows: list
    say: object

    def row(
        self, case, source, reference, result, acceptance, *, scale=None, unit="", variant="", order=None, least_order=None,
        distance=False,
    ):  # fmt: skip
        """Record one result, then assert it.

        reference, result : numbers or arrays; of arrays the entry with the largest error is shown
        acceptance : largest error, in parts of `scale` (default the largest entry of the reference; 1 for absolute errors)
        order, least_order : observed order of convergence, and the smallest that is accepted
        distance : the result is a distance from the reference
        """
        reference, result = np.broadcast_arrays(np.asarray(reference, float), np.asarray(result, float))
        size = float(np.abs(reference).max()) if scale is None else float(scale)
        off = np.atleast_1d(np.abs(result - reference) / size)
        k = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        shown = ["", "distance"] if distance else [f"{np.atleast_1d(a).ravel()[k]:.9g}" for a in (reference, result)]
        error = float(off.ravel()[k])
        row = Row(self.test, case, source, *shown, error, acceptance, unit, variant, order)
        self.rows.append(row)
        name = case + (f" ({variant})" if variant else "")
        values = "" if distance else f"{row.result}, reference {row.reference}, "
        self.say(f"{name}: {values}error {error:.1e}" + (f", order {order:.2f}" if order is not None else ""))
        if not error <= acceptance:
            row.reason = f"error {error:.1e}, accepted {acceptance:.1e}"
        elif least_order is not None and not order > least_order:
            row.reason = f"order {order:.2f}, wanted {least_order:g}"
        assert not row.reason, f"{case}: {row.reason} (reference {row.reference}, result {row.result})"

    def error(self, case, source, error, acceptance, **options):
        """Record an error that was measured as a distance from the reference: reference 0."""
        self.row(case, source, 0.0, error, acceptance, scale=1.0, distance=True, **options)


def pytest_addoption(parser):
    parser.addoption("--write-validation", action="store_true", help="write tests/verification/VALIDATION.md")


def pytest_collection_modifyitems(items):
    for item in items:
        if "validation" in getattr(item, "fixturenames", ()):
            item.add_marker("validation")


@pytest.fixture
def validation(request, say):
    """Rows of the validation page."""
    return Validation(request.node.nodeid, request.node.stash.setdefault(ROWS, []), say)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Give rows their time; a test that fails without a row, or is known to fail, gets one with the reason."""
    report = yield
    if "validation" not in getattr(item, "fixturenames", ()):
        return report
    rows = item.stash.setdefault(ROWS, [])
    if report.when == "call":
        for row in rows:
            row.time = report.duration / len(rows)
    if report.when == "call" or not report.passed:
        add_failure(item, call, report, rows)
    if report.when == "teardown":
        report.user_properties += map(packed, rows)
    return report


def add_failure(item, call, report, rows):
    known = getattr(report, "wasxfail", None)
    if report.passed or (report.skipped and known is None) or any(row.reason for row in rows):
        return
    value = getattr(call.excinfo, "value", report.outcome)
    reason = known or next(iter(str(value).strip().splitlines()), type(value).__name__)
    doc = f"{item.name}: {(item.function.__doc__ or '').strip().splitlines()[0]}".rstrip(".: ")
    rows.append(Row(item.nodeid, doc, "", "", "", np.nan, np.nan, reason=reason, time=report.duration))


def packed(row):
    """A row as a property of a report, which is sent between processes."""
    return PROPERTY, json.dumps(asdict(row))


class Page:
    """Gathers the rows of all reports, in the process that sees them all, and writes the page."""

    def __init__(self):
        self.rows = []

    def pytest_runtest_logreport(self, report):
        if report.when == "teardown":
            self.rows += [Row(**json.loads(text)) for name, text in report.user_properties if name == PROPERTY]

    def pytest_sessionfinish(self, session):
        PAGE.write_text(page(self.rows, session.config.option.markexpr), encoding="utf-8")


def page(rows, chosen):
    """Text of the page; chosen: which tests were, by their markers."""
    cases = {}
    for row in sorted(rows, key=lambda row: (row.test.split("[")[0], row.case)):
        cases.setdefault(row.case, []).append(row)
    failing = [case for case, found in cases.items() if any(row.reason for row in found)]
    ordered = [case for case, found in cases.items() if any(row.order is not None for row in found)]
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "scikit-fem", "numba"))
    part = "" if chosen == "validation" else f'A part of the cases only: `-m "{chosen}"`. '
    lines = [
        HEAD + part,
        f"{len(cases)} cases in {len(rows)} variants, {len(ordered)} with an observed order; {len(failing)} fail. "
        f"Python {platform.python_version()}, {versions}; {platform.machine()}.\n\n",
        "| case | source of the reference | reference | result | error | accepted | order | variants | time [s] |\n",
        "|---|---|---|---|---|---|---|---|---|\n",
    ]
    for case, found in cases.items():
        worst = max(found, key=lambda row: row.strain)
        orders = [row.order for row in found if row.order is not None]
        name = case + (f": {worst.variant}" if worst.variant else "")
        unit = f" {worst.unit}" if worst.unit else ""
        cells = [
            name, next((row.source for row in found if row.source), ""), worst.reference, worst.result,
            f"{worst.error:.1e}{unit}" if np.isfinite(worst.error) else "",
            f"{worst.acceptance:.1e}" if np.isfinite(worst.acceptance) else "",
            f"{min(orders):.2f}" if orders else "", str(len(found)), f"{sum(row.time for row in found):.2g}",
        ]  # fmt: skip
        if worst.reason:
            cells[0] = f"**fails** {name}: {worst.reason}"
        lines.append("| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |\n")
    return "".join(lines)
