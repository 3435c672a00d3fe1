"""The validation page: what stands on it, also of cases that fail."""

from types import SimpleNamespace

import numpy as np
import pytest
import validation as v


@pytest.fixture
def rows():
    return []


def test_row_is_recorded_and_judged(rows):
    """A good row passes; a bad one is recorded with its reason before it fails the test."""
    check = v.Validation("test_a", rows, lambda text: None)
    check.row("circle", "closed form", [1.0, 2.0], [1.0, 2.002], 2e-3, order=2.1, least_order=1.9)
    with pytest.raises(AssertionError, match="accepted"):
        check.row("circle", "closed form", 1.0, 1.1, 1e-3, variant="coarse")
    with pytest.raises(AssertionError, match="order 1"):
        check.row("circle", "closed form", 1.0, 1.0, 1e-3, order=1.0, least_order=1.9)
    with pytest.raises(AssertionError):
        check.row("circle", "closed form", 1.0, np.nan, 1e-3)
    check.error("square", "exact", 1e-9, 1e-8, unit="L")
    assert [bool(row.reason) for row in rows] == [False, True, True, True, False]
    assert rows[0].reference == "2"
    assert rows[0].error == pytest.approx(1e-3)


def test_page_counts_cases_and_lists_failures(rows):
    """Variants of a case count once; the worst one is shown; what fails says so."""
    check = v.Validation("test_a", rows, lambda text: None)
    check.row("circle", "closed form", 1.0, 1.001, 2e-3, variant="fine", order=2.0)
    check.row("circle", "closed form", 1.0, 1.0001, 2e-3, variant="finer")
    rows.append(v.Row("test_b", "knot", "", "", "", np.nan, np.nan, reason="does not | converge"))
    text = v.page(rows, "validation")
    assert "2 cases in 3 variants, 1 with an observed order; 1 fail." in text
    assert "| circle: fine | closed form | 1 | 1.001 | 1.0e-03 | 2.0e-03 | 2.00 | 2 |" in text
    assert "**fails** knot: does not / converge" in text
    assert "A part of the cases only" not in text
    assert "not slow" in v.page(rows, "validation and not slow")


def test_rows_come_with_the_last_report_of_a_test(rows):
    """Whole, numbers of NumPy and what is no number too, and once."""
    check = v.Validation("test_a", rows, lambda text: None)
    check.row("circle", "closed form", 1.0, 1.001, np.float64(2e-3), variant="a | b", order=np.float64(2.0))
    rows.append(v.Row("test_b", "knot", "", "", "", np.nan, np.inf, reason="lost"))
    gathered = v.Page()
    for when in ("setup", "call", "teardown"):
        gathered.pytest_runtest_logreport(
            SimpleNamespace(when=when, user_properties=[*map(v.packed, rows), ("x", "y")])
        )
    assert v.page(gathered.rows, "validation") == v.page(rows, "validation")
    assert len(gathered.rows) == 2
    assert np.isnan(gathered.rows[1].error)
