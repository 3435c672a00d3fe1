"""Values over time: constants, rates, tables, functions."""

import numpy as np
import pytest

from cosserat_fem.schedule import Schedule


def test_kinds():
    """A rate grows, a constant stays, a table is linear between its rows, a function is asked."""
    assert Schedule("angle", 0.2, rate=True).at(3.0) == pytest.approx(0.6)
    np.testing.assert_array_equal(Schedule("force", (1, 2, 3), (3,)).at(5.0), [1, 2, 3])
    table = Schedule("angle", ([0, 2, 4], [0, 1, 0]))
    assert [table.at(t) for t in (0, 1, 2, 3, 4)] == [0, 0.5, 1, 0.5, 0]
    vectors = Schedule("force", ([0, 1], [(0, 0, 0), (2, 4, 6)]), (3,))
    np.testing.assert_allclose(vectors.at(0.5), [1, 2, 3])
    assert Schedule("x", lambda t: t**2).at(3.0) == 9.0


def test_constant():
    assert Schedule("x", 1.0).constant
    assert Schedule("x", 0.0, rate=True).constant
    assert not Schedule("x", 1.0, rate=True).constant
    assert not Schedule("x", ([0, 1], [0, 1])).constant


def test_outside_a_table():
    """A value that silently stays at the end of its table is how a motion stops without anyone noticing."""
    with pytest.raises(ValueError, match="the table runs from 0 s to 2 s, but the run asks for 2.5 s"):
        Schedule("angle", ([0, 2], [0, 1])).at(2.5)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (([0, 2, 1], [0, 1, 2]), "times must increase .got 2 s followed by 1 s"),
        (([0, 1, 1], [0, 1, 2]), "times must increase"),
        (([0], [1]), "at least two times"),
        (([0, 1], [0, 1, 2]), "values: must have shape"),
        (([0, np.nan], [0, 1]), "must be finite"),
        (np.inf, "must be finite"),
        ("fast", "must be numbers"),
    ],
)
def test_bad_values(value, message):
    with pytest.raises(ValueError, match=message):
        Schedule("angle", value)


def test_function_that_returns_nonsense():
    with pytest.raises(ValueError, match="force at t = 1 s: must have shape"):
        Schedule("force", lambda t: (1, 2), (3,)).at(1.0)
