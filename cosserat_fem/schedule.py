"""How does a given number change with time? Constants, tables and functions, one way to ask all three.

Rule: a schedule answers `at(t)`; a table is piecewise linear and answers only inside its own span, because a value
that silently stays at the end of a table is how a motion stops halfway without anyone noticing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import check_shape


class Schedule:
    """A number or vector over time.

    Parameters
    ----------
    name : str
        How to call it in messages.
    value : constant, (times, values) or function of t
        Constant of `shape`; a table of times (T,) [s], strictly increasing, with values (T, *shape); or f(t).
    shape : tuple
        () for a number, (3,) for a vector.
    rate : bool
        If true a constant is a rate [1/s]: the value is rate * t.
    """

    def __init__(self, name: str, value: Any, shape: tuple[int, ...] = (), *, rate: bool = False) -> None:
        self.name, self.shape = name, shape
        self.times: np.ndarray | None = None
        self._function: Callable[[float], Any] | None = None
        self._rate = 0.0
        self._constant = np.zeros(shape)
        if callable(value):
            self._function = value
        elif isinstance(value, tuple | list) and len(value) == 2 and np.ndim(value[0]) == 1 and _is_table(value, shape):
            self.times = check_shape(f"{name}: times", value[0], (-1,))
            self.values = check_shape(f"{name}: values", value[1], (len(self.times), *shape))
            if len(self.times) < 2:
                raise ValueError(f"{name}: a table needs at least two times (got {len(self.times)}).")
            back = np.flatnonzero(np.diff(self.times) <= 0)
            if len(back):
                k = int(back[0])
                raise ValueError(
                    f"{name}: times must increase (got {self.times[k]:g} s followed by {self.times[k + 1]:g} s)."
                )
        else:
            constant = check_shape(name, value, shape)
            if rate:
                self._rate = float(constant)
            else:
                self._constant = constant

    @property
    def constant(self) -> bool:
        """True if the value never changes."""
        return self.times is None and self._function is None and self._rate == 0.0

    def at(self, t: float) -> Any:
        """Value at time t [s]: float or array of `shape`. ValueError outside a table or for a value that is no number."""
        if self.times is not None:
            slack = 1e-9 * (self.times[-1] - self.times[0])
            if not self.times[0] - slack <= t <= self.times[-1] + slack:
                raise ValueError(
                    f"{self.name}: the table runs from {self.times[0]:g} s to {self.times[-1]:g} s, "
                    f"but the run asks for {t:g} s. Extend the table or shorten the run."
                )
            if not self.shape:
                return float(np.interp(t, self.times, self.values))
            return np.array([np.interp(t, self.times, column) for column in self.values.T])
        if self._function is not None:
            value = check_shape(f"{self.name} at t = {t:g} s", self._function(t), self.shape)
            return value if self.shape else float(value)
        return (self._rate * t) if self._rate else (self._constant if self.shape else float(self._constant))


def _is_table(value: Any, shape: tuple[int, ...]) -> bool:
    """A pair is a table unless it can only be a constant (no shape used here has two entries)."""
    return len(np.shape(value[1])) == 1 + len(shape) or (not shape and np.ndim(value[1]) == 1)
