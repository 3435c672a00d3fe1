"""How do we say no? Exception types, and the few checks every room shares.

Rule: a message says **where: what is wrong (got ...); what is right. What to do.** It names the object the user
wrote, never a line of ours. `ValueError` is for wrong arguments in Python; the types here are for what only shows
when things are put together.
"""

from __future__ import annotations

import difflib
import io
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .history import History
    from .space import State


class CosseratError(Exception):
    """Any fault this package reports on purpose."""


class SceneError(CosseratError):
    """A scene that cannot be meant: a file, a name, a support or a value that does not fit the rest.

    `faults` holds one sentence per fault, so that a file with three mistakes is reported once.
    """

    def __init__(self, faults: str | Iterable[str]) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))


class MeshError(SceneError):
    """A mesh or curve file that cannot be read, or is not what it is used for."""


class KardanError(CosseratError):
    """The Kardan angles are singular here (theta = 90 deg): the interpolation cannot go on."""


class ConvergenceError(CosseratError):
    """No equilibrium was found. `history` holds every state accepted before, `state` the last iterate."""

    def __init__(self, message: str, history: History | None = None, state: State | None = None) -> None:
        super().__init__(message)
        self.history = history
        self.state = state


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ``Did you mean 'x'?`` when a known name is close, else the list of known names."""
    known = list(known)
    close = difflib.get_close_matches(str(name), known, n=1, cutoff=0.6)
    if close:
        return f"Did you mean {close[0]!r}?"
    return f"Known: {', '.join(repr(k) for k in known)}." if known else "There is none in this scene."


def check_shape(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return `value` as a finite float array of `shape` (-1 = any length), or say what it is instead."""
    wanted = "(" + ", ".join("any" if n < 0 else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: must be numbers of shape {wanted} (got {_short(value)}).") from None
    if array.ndim != len(shape) or any(n >= 0 and n != m for n, m in zip(shape, array.shape, strict=False)):
        raise ValueError(f"{name}: must have shape {wanted} (got shape {array.shape}).")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: must be finite (got {_short(value)}).")
    return array


def check_positive(name: str, value: Any, *, zero: bool = False) -> float:
    """Return `value` as a float greater than 0 (or at least 0), or say what it is instead."""
    number = check_number(name, value)
    if number < 0.0 or (number == 0.0 and not zero):
        raise ValueError(f"{name}: must be {'at least' if zero else 'greater than'} 0 (got {_short(value)}).")
    return number


def check_number(name: str, value: Any) -> float:
    """Return `value` as a finite float, or say what it is instead."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: must be a number (got {_short(value)}).") from None
    if isinstance(value, str | bool) or not np.isfinite(number):
        raise ValueError(f"{name}: must be a finite number (got {_short(value)}).")
    return number


def check_integer(name: str, value: Any, low: int, high: int | None = None) -> int:
    """Return `value` as an integer of at least `low` (and at most `high`), or say what it is instead."""
    span = f"of at least {low}" if high is None else f"from {low} to {high}"
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < low or (high and value > high):
        raise ValueError(f"{name}: must be an integer {span} (got {_short(value)}).")
    return int(value)


def check_name(kind: str, value: Any) -> str:
    """Return `value` if it can name an object: a non-empty string on one line without '/'."""
    if not isinstance(value, str) or not value.strip() or any(c in value for c in "/\n\r\t"):
        raise ValueError(f"{kind}: name must be a non-empty string on one line without '/' (got {_short(value)}).")
    return value


def one_line(error: BaseException, length: int = 160) -> str:
    """A library's message on one line, without its last full stop."""
    text = " ".join(str(error).split()).rstrip(".")
    return text if len(text) <= length else text[: length - 3] + "..."


def out_of_memory(error: MemoryError) -> str:
    """A MemoryError in one line."""
    said = f" ({one_line(error)})" if str(error) else ""
    return f"out of memory{said}. Use fewer elements or stations."


def cause(error: BaseException) -> str:
    """What the machine said, in one line."""
    if isinstance(error, MemoryError):
        return out_of_memory(error)
    return getattr(error, "strerror", None) or one_line(error)


@contextmanager
def silenced() -> Iterator[None]:
    """Keep the readers of files quiet (VTK's lines, meshio's prints, warnings): the caller says the fault, once."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    shown, logged = vtkObject.GetGlobalWarningDisplay(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkObject.SetGlobalWarningDisplay(0)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
        vtkLogger.SetStderrVerbosity(logged)


def _short(value: Any) -> str:
    value = value.item() if isinstance(value, np.generic) else value
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
