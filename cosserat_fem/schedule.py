"""How does a given number change with time? Constants, tables and functions, one way to ask all three.

Rule: a schedule answers `at(t)`, its rates and its kinks; a table is linear between its rows, or a smooth curve that
starts and ends at rest, and answers only inside its own span, because a value that silently stays at the end of a table
is how a motion stops halfway without anyone noticing. Rates are exact for constants, tables and anything with a
`derivative` method (a scipy spline or polynomial); those of other functions are differences of fourth order,
which ask for values up to 0.2 ms outside the run.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PchipInterpolator

from .errors import check_shape

DIFFERENCE = 1e-4  # s, step of the differences for functions that do not know their rates


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
    smooth : bool
        If true a table is a smooth curve with rate 0 at both ends: velocity and acceleration are continuous, and it
        stays where two rows are equal.
    jumps : bool
        If true two rows may have the same time: the value jumps there, and the second row counts at that time.
    """

    def __init__(
        self,
        name: str,
        value: Any,
        shape: tuple[int, ...] = (),
        *,
        rate: bool = False,
        smooth: bool = False,
        jumps: bool = False,
    ) -> None:
        self.name, self.shape = name, shape
        self.times: np.ndarray | None = None
        self._rows: list[float] = []
        self._function: Callable[[float], Any] | None = None
        self._rate = 0.0
        self._constant = np.zeros(shape)
        self._curve: BPoly | None = None
        self._last: tuple[float, Any] = (np.nan, None)  # every iteration of a step asks for the same time
        if callable(value):
            self._function = value
        elif isinstance(value, tuple | list) and len(value) == 2 and np.ndim(value[0]) == 1 and _is_table(value, shape):
            self.times = check_shape(f"{name}: times", value[0], (-1,))
            self.values = check_shape(f"{name}: values", value[1], (len(self.times), *shape))
            if len(self.times) < 2:
                raise ValueError(f"{name}: a table needs at least two times (got {len(self.times)}).")
            self._rows = self.times.tolist()  # looked up at every step: a list is faster than an array
            steps = np.diff(self.times)
            back = np.flatnonzero(steps < 0 if jumps else steps <= 0)
            if len(back):
                k = int(back[0])
                raise ValueError(
                    f"{name}: times must increase (got {self.times[k]:g} s followed by {self.times[k + 1]:g} s)."
                )
            if jumps and (np.diff(np.flatnonzero(np.append(steps == 0, False))) == 1).any():
                raise ValueError(f"{name}: more than two rows have the same time; two make a jump.")
            if smooth:
                self._curve = _smooth(self.times, self.values)
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

    @property
    def is_function(self) -> bool:
        """True if the value is a function of time that the user gave."""
        return self._function is not None

    def at(self, t: float) -> Any:
        """Value at time t [s]: float or array of `shape`. ValueError outside a table or for a value that is no number."""
        if t != self._last[0]:
            self._last = (t, self._evaluate(t))
        return self._last[1]

    def _evaluate(self, t: float) -> Any:
        if self.times is not None:
            slack = 1e-9 * (self._rows[-1] - self._rows[0])
            if not self._rows[0] - slack <= t <= self._rows[-1] + slack:
                raise ValueError(
                    f"{self.name}: the table runs from {self.times[0]:g} s to {self.times[-1]:g} s, "
                    f"but the run asks for {t:g} s. Extend the table or shorten the run."
                )
            if self._curve is not None:
                return self._curve(t) if self.shape else float(self._curve(t))
            k = min(max(bisect_right(self._rows, t) - 1, 0), len(self._rows) - 2)
            width = self._rows[k + 1] - self._rows[k]  # 0 at a jump that ends the table
            part = min(max((t - self._rows[k]) / width, 0.0), 1.0) if width > 0 else 1.0
            value = (1.0 - part) * self.values[k] + part * self.values[k + 1]
            return value if self.shape else float(value)
        if self._function is not None:
            value = check_shape(f"{self.name} at t = {t:g} s", self._function(t), self.shape)
            return value if self.shape else float(value)
        return (self._rate * t) if self._rate else (self._constant if self.shape else float(self._constant))

    def rates(self, t: float, *, before: bool = False) -> tuple[Any, Any]:
        """First and second derivative at time t; at a kink of a table those of the piece that begins (or ends) there."""
        zero = np.zeros(self.shape)
        if self.times is not None:
            self.at(t)
            if self._curve is not None:
                return self._curve(t, 1), self._curve(t, 2)
            slack = 1e-9 * (self.times[-1] - self.times[0])
            t += -slack if before else slack
            k = int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2))
            return (self.values[k + 1] - self.values[k]) / (self.times[k + 1] - self.times[k]), zero
        if self._function is None:
            return zero + self._rate, zero
        derivative = getattr(self._function, "derivative", None)
        if derivative is not None:
            return np.asarray(derivative(1)(t), dtype=float), np.asarray(derivative(2)(t), dtype=float)
        h = DIFFERENCE
        f = [np.asarray(self.at(t + k * h)) for k in (-2, -1, 0, 1, 2)]
        first = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h)
        return first, (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h * h)

    @property
    def begin(self) -> float:
        """Time [s] of a table's first row, else 0."""
        return self._rows[0] if self._rows else 0.0

    @property
    def jumps(self) -> np.ndarray:
        """Times (K,) [s] at which the value jumps."""
        return np.empty(0) if self.times is None else self.times[1:][np.diff(self.times) == 0]

    @property
    def kinks(self) -> np.ndarray:
        """Times (K,) [s] at which the slope may jump: the rows of a linear table."""
        return np.empty(0) if self.times is None or self._curve is not None else self.times


def _smooth(times: np.ndarray, values: np.ndarray) -> BPoly:
    """Quintic pieces through the rows, with the slopes of a monotone interpolant (PCHIP) and no acceleration at rows."""
    slopes = PchipInterpolator(times, values).derivative()(times) if len(times) > 2 else np.zeros_like(values)
    slopes[[0, -1]] = 0.0
    return BPoly.from_derivatives(times, np.stack([values, slopes, np.zeros_like(values)], axis=1))


def _is_table(value: Any, shape: tuple[int, ...]) -> bool:
    """A pair is a table unless it can only be a constant (no shape used here has two entries)."""
    return len(np.shape(value[1])) == 1 + len(shape) or (not shape and np.ndim(value[1]) == 1)
