"""Which theory suffices? The same scene as Cosserat rods, as Kirchhoff rods and as strings.

Rule: every theory runs on the same elements, supports and loads, and is held against the Cosserat rods: forces and moments
of supports and hinge torques at every station in parts of the largest of their kind, places of nodes in parts of the rod's
length. The cheapest that stays within a tolerance is named for each kind and for all; a theory that finds no state, or
cannot carry a load, does not suffice and says why.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .errors import ConvergenceError, SceneError, check_positive
from .history import History
from .mechanism import Hinge
from .model import THEORIES, Model

KINDS = ("force", "moment", "torque", "place")
ROUND_OFF = 1e-6  # of forces times the longest rod: moments below are none
CHEAPEST_FIRST = tuple(reversed(THEORIES))


@dataclass(frozen=True)
class Row:
    """One theory: its peaks (force [N] and moment [N m] of supports, hinge torque [N m]), its largest differences from the
    Cosserat rods for each of KINDS, the CPU time [s] of its run, and why it found nothing, if it did not."""

    theory: str
    peaks: dict[str, float] = field(default_factory=dict)
    apart: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    problem: str = ""


@dataclass(frozen=True)
class Comparison:
    """Rows of all theories; sufficient: for each kind, and "all", the cheapest theory within the tolerance."""

    rows: tuple[Row, ...]
    tolerance: float
    sufficient: dict[str, str]
    histories: dict[str, History]

    def __str__(self) -> str:
        lines = [
            f"{'theory':10s} {'force [N]':>12s} {'moment [N m]':>13s} {'torque [N m]':>13s} {'apart':>9s} {'CPU [s]':>9s}"
        ]
        for row in self.rows:
            if row.problem:
                lines.append(f"{row.theory:10s} {row.problem}")
                continue
            peaks = " ".join(
                f"{row.peaks[k]:{w}.6g}" if k in row.peaks else f"{'-':>{w}s}"
                for k, w in zip(KINDS, (12, 13, 13), strict=False)
            )
            lines.append(f"{row.theory:10s} {peaks} {max(row.apart.values(), default=0.0):9.1e} {row.seconds:9.3f}")
        told = ", ".join(f"{kind}: {theory}" for kind, theory in self.sufficient.items())
        return "\n".join([*lines, f"Cheapest within {self.tolerance:g} of the Cosserat rods: {told}."])


def compare_theories(model: Model, solve: Callable[[Model], History], *, tolerance: float = 0.01) -> Comparison:
    """Run a model in all three theories and say which one suffices.

    Parameters
    ----------
    solve : function (Model) -> History
        Runs a model, e.g. ``lambda m: solve_quasistatic(m, times)``.
    tolerance : [-]
        Largest difference from the Cosserat rods, relative.

    Raises
    ------
    ConvergenceError, SceneError
        The Cosserat rods themselves find no state.
    """
    check_positive("compare_theories: tolerance", tolerance)
    rows: dict[str, Row] = {}
    histories: dict[str, History] = {}
    for theory in THEORIES:
        since = time.process_time()
        try:
            history = solve(model.with_theory(theory))  # type: ignore[arg-type]
        except (SceneError, ConvergenceError) as error:
            if theory == THEORIES[0]:
                raise
            rows[theory] = Row(theory, problem=str(error))
            continue
        seconds = time.process_time() - since
        histories[theory] = history
        exact = histories[THEORIES[0]]
        slack = any(record.negative > 0 for record in history.records)
        problem = "its equilibrium is unstable: it is slack somewhere" if theory == "string" and slack else ""
        rows[theory] = Row(theory, _peaks(history), _apart(history, exact), seconds, problem)
    kinds = [kind for kind in KINDS if kind in rows[THEORIES[0]].apart]
    sufficient = {kind: _cheapest(rows, [kind], tolerance) for kind in kinds}
    sufficient["all"] = _cheapest(rows, kinds, tolerance)
    return Comparison(tuple(rows[theory] for theory in THEORIES), tolerance, sufficient, histories)


def _cheapest(rows: dict[str, Row], kinds: list[str], tolerance: float) -> str:
    for theory in CHEAPEST_FIRST:
        row = rows[theory]
        if not row.problem and all(row.apart[kind] <= tolerance for kind in kinds):
            return theory
    return THEORIES[0]


def _loads(history: History) -> dict[str, Any]:
    """Forces and moments of supports (T, n, 3), hinge torques (T, n): those that there are."""
    loads = np.array([record.reactions for record in history.records])
    found: dict[str, Any] = {"force": loads[..., :3], "moment": loads[..., 3:]} if loads.size else {}
    hinged = [part for part in history.model.parts if isinstance(part.motion, Hinge)]
    if hinged:
        found["torque"] = np.array([history.hinge_torque(part) for part in hinged]).T[..., None]
    return found


def _peaks(history: History) -> dict[str, float]:
    return {kind: float(np.linalg.norm(loads, axis=2).max()) for kind, loads in _loads(history).items()}


def _apart(history: History, exact: History) -> dict[str, float]:
    """Largest relative differences, by kind."""
    out, wanted = {}, _loads(exact)
    length = history.model.scales["length"]
    for kind, loads in _loads(history).items():
        size = float(np.linalg.norm(wanted[kind], axis=2).max())
        if kind != "force":  # moments of pins are round-off
            size = max(size, ROUND_OFF * float(np.linalg.norm(wanted["force"], axis=2).max()) * length)
        n = min(len(loads), len(wanted[kind]))
        difference = float(np.linalg.norm(loads[:n] - wanted[kind][:n], axis=2).max())
        out[kind] = difference / size if size > 0.0 else 0.0
    places = [
        np.linalg.norm(history.positions(rod)[: len(exact)] - exact.positions(rod)[: len(history)], axis=2).max()
        / rod.length
        for rod in history.model.rods
    ]
    return out | {"place": float(max(places))}
