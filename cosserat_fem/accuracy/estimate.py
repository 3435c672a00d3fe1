"""How wrong is it? Error estimates, and the choice of order and elements.

Rule: the error of a reported number is estimated by what becomes of it on richer elements: the same ones, one degree
higher. There a state starts from the one that is judged, stresses included, so that two to four iterations find the
equilibrium; only the stations at which something reported has its peak are solved again. The estimate is the error of what
is reported, not of the richer solution. It sees the elements alone: not the model, and not the stations between which a
path was not followed. Contact and friction start from what was accepted at the station, so what friction forgot on the
way there is not seen either.

Of a run in time the errors of elements and of time steps are told apart; both grow as the motion lets them, see `drift`.
They are carried along the kept states: a motion that is kept too rarely to be recognised has an estimate that is too small.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from ..errors import CosseratError
from ..history import History
from ..iteration.newton import Newton
from ..mechanism import Part
from ..model import Model
from ..record import Record
from ..rod import Elements
from .drift import space_errors, time_errors
from .transfer import Transfer, at_places

log = logging.getLogger(__name__)

RICHER = 1  # degrees
NOISE = 1e-9
CARRIED, SPARE = 120, 25  # kept states along which errors are carried: at least so many, or one for so many iterations
Describe = Callable[[History, Sequence[Part]], dict[str, Any]]


def raised(model: Model, degrees: int = RICHER) -> Model:
    """The same model on the same elements of a higher degree."""
    return model.with_elements(
        {
            rod: Elements(view.mesh.order + degrees, view.mesh.ends) for rod, view in model.space.views.items()
        }
    )  # fmt: skip


class Richer:
    """Stations of a history solved again on elements of one degree more.

    model : the richer one; failed : {station: why it was not found}
    """

    def __init__(self, history: History) -> None:
        self.history, self.model = history, raised(history.model)
        self.newton = Newton(self.model)
        self.transfer = Transfer(history.model, self.model)
        self.failed: dict[int, str] = {}
        self._found: dict[int, Record] = {}

    def station(self, k: int) -> History | None:
        """Station k as a history of one state on the richer elements; None if none was found near it."""
        if k not in self._found and k not in self.failed:
            self._solve(k)
        return History(self.model, [self._found[k]]) if k in self._found else None

    def _solve(self, k: int) -> None:
        record = self.history.records[k]
        newton = self.newton
        if record.factor is not None:
            newton = Newton(self.model.with_factor(record.factor, self.history.loads))
            newton.counters = self.newton.counters
        try:
            solved = newton.plain(self.transfer.with_contact(record.state))
            if solved.converged:
                solved = newton.accepted(solved)
        except CosseratError as error:
            self.failed[k] = str(error)
            return
        if not solved.converged:
            self.failed[k] = solved.reason
            return
        self._found[k] = Record(
            solved.state, solved.reactions, solved.iterations, solved.residual, solved.negative, contact=solved.pressed
        )


class InTime:
    """Kept states of a run in time without the error of the elements, and without that of the time steps."""

    def __init__(self, history: History, wanted: Iterable[int]) -> None:
        self.history, self.model = history, raised(history.model)
        wanted, n = set(wanted), len(history)
        most = max(CARRIED, history.counters.iterations // SPARE)
        spread = np.linspace(0, n - 1, min(n, most)).round().astype(int).tolist()
        self.stations = sorted({0, *spread, *wanted})
        self.spatial = space_errors(history, self.model, self.stations, wanted)
        known = history.rho_inf is not None and history.steps and history.extrapolated is None
        self.temporal = time_errors(history, self.stations, wanted) if known else {}

    def without_elements(self, k: int) -> History | None:
        """Kept state k on the richer elements; None if the error grew without bound on the way."""
        return _finite(self.model, self.spatial.get(k))

    def without_steps(self, k: int) -> History | None:
        """Kept state k without the error of the steps; None if that is not known."""
        return _finite(self.history.model, self.temporal.get(k))


def _finite(model: Model, record: Record | None) -> History | None:
    if record is None or not (np.isfinite(record.state.r).all() and np.isfinite(record.state.q).all()):
        return None
    return History(model, [record])


def add_errors(
    said: dict[str, Any], history: History, describe: Describe, parts: Sequence[Part] = ()
) -> dict[str, Any]:
    """Write an estimated error beside each reported peak: to every {"value", "t", ...} in `said` the key "error".

    said: what `describe(history, parts)` says; it is changed. Returns how it was found.

    The error of a peak is |value at its station on richer elements - value|, in the unit of the value; None where no richer
    state was found. Of a run in time it is the sum of "error_elements" and "error_steps". Along a path, where a time may be
    that of several states, only a peak with a "station" gets one. A value that is nothing but round-off beside its like is
    its own error. Each rod gets "position_error", the largest estimated error of the elements
    in a node's place at these stations.
    """
    at: dict[int, list[tuple[tuple[str, ...], dict[str, Any]]]] = {}
    for path, peak, largest in _peaks(said):
        if history.path and "station" not in peak:  # its time does not say which state it is
            peak["error"] = None
        elif abs(peak["value"]) <= NOISE * largest:
            peak["error"] = abs(peak["value"])
        else:
            station = peak.get("station", int(np.argmin(np.abs(history.t - peak["t"]))))
            at.setdefault(station, []).append((path, peak))
    shifts: dict[str, list[tuple[float, float, float]]] = {}
    moving = InTime(history, at) if history.dynamic else None
    richer = Richer(history) if moving is None else None
    for k, peaks in sorted(at.items()):
        near = parts if any(path[0] == "clearances" for path, _ in peaks) else ()  # the dear part of it
        found = richer.station(k) if richer is not None else moving.without_elements(k)  # type: ignore[union-attr]
        finer = {} if found is None else describe(found, near)
        if found is not None:
            for rod, (distance, s) in moved(history, k, found).items():
                shifts.setdefault(rod.name, []).append((distance, s, float(history.t[k])))
        shorter = None if moving is None else moving.without_steps(k)
        steps = {} if shorter is None else describe(shorter, near)
        for path, peak in peaks:
            if moving is not None and path[0] == "contacts":  # a barrier is far from linear
                peak["error"] = None
                continue
            peak["error"] = _apart(peak["value"], _look_up(finer, path))
            if moving is not None:
                elements, of_steps = peak["error"], _apart(peak["value"], _look_up(steps, path))
                known = [e for e in (elements, of_steps) if e is not None]
                peak |= {"error": sum(known) if known else None, "error_elements": elements, "error_steps": of_steps}
    for name, several in shifts.items():
        said["rods"][name]["position_error"] = dict(zip(("value", "s", "t"), max(several), strict=True))
    if moving is not None:
        return _told_in_time(history, moving)
    return {
        "method": "stations of the peaks solved again on elements of one degree more",
        "stations": [float(history.t[k]) for k in sorted(at)],
        "iterations": richer.newton.counters.iterations,  # type: ignore[union-attr]
        **({"not_found": {f"{history.t[k]:g}": why for k, why in richer.failed.items()}} if richer.failed else {}),  # type: ignore[union-attr]
    }


def _told_in_time(history: History, moving: InTime) -> dict[str, Any]:
    steps = "carried with the motion like that of the elements"
    if not moving.temporal:
        steps = "not known: the log of steps is missing"
    if history.extrapolated is not None:
        steps = (
            f"less than {history.extrapolated:.2g} (in rod lengths and rad), that of the finer run before extrapolation"
        )
    return {
        "method": "what the kept states leave over on elements of one degree more, carried with the linearised motion",
        "steps": steps,
        "carried_along": len(moving.stations),
        **({"contacts": "of contact forces in time no error is estimated"} if history.model.contacts else {}),
    }


def moved(history: History, k: int, found: History) -> dict[Any, tuple[float, float]]:
    """For each rod the largest distance [m] of nodes at station k from the same places of another state of it, and where."""
    out = {}
    for rod, view in history.model.space.views.items():
        finer = at_places(found.final.r, found.model.space, rod, view.s)
        apart = np.linalg.norm(finer - history.records[k].state.r[view.nodes], axis=1)
        j = int(np.argmax(apart))
        out[rod] = (float(apart[j]), float(view.s[j]))
    return out


def _peaks(said: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], dict[str, Any], float]]:
    """Tables with a value and its time, where they stand, and the largest value of those that are measured alike."""
    tables = {key: value for key, value in said.items() if isinstance(value, dict)}
    peaks = {k: v for k, v in tables.items() if "t" in v and isinstance(v.get("value"), float)}
    for key, value in tables.items():
        if key in peaks:
            unit = key.partition("[")[2]
            like = [
                abs(v["value"])
                for k, v in peaks.items()
                if path[-1:] == ("largest_strain",) and k.partition("[")[2] == unit
            ]
            yield (*path, key), value, max(like, default=0.0)
        else:
            yield from _peaks(value, (*path, key))


def _look_up(said: Any, path: Iterable[str]) -> float | None:
    for key in (*path, "value"):
        said = said.get(key) if isinstance(said, dict) else None
    return said if isinstance(said, float) else None


def _apart(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None or not np.isfinite(b - a) else abs(b - a)
