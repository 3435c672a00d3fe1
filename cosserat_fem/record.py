"""What is kept of a state, a touch, a critical point, and of what the solver did?

Rule: plain values, written once. `history` puts them together and answers questions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from .space import State
from .terms.inertial import Rates
from .terms.touch import Pressed

Kind = Literal["limit", "bifurcation", "flutter", "divergence"]


@dataclass(frozen=True, eq=False)
class Record:
    """One accepted state: reactions (supports, 6), iterations, relative residual, negative eigenvalues or -1.

    Of a run in time also the rates, and the work [J] done since the start by each term and by driven ends. Of a model with
    contact what each of its terms does; of a path of loads their factor. On the way back of a travel the state stands at a
    time that runs backwards, `state.t`, and `time` is the one that goes on.
    """

    state: State
    reactions: np.ndarray
    iterations: int
    residual: float
    negative: int
    rates: Rates | None = None
    work: dict[str, float] | None = None
    contact: tuple[Pressed, ...] = ()
    factor: float | None = None
    time: float | None = None

    @property
    def t(self) -> float:
        """When [s]: the time of the state, or where that has turned back the time that goes on."""
        return self.state.t if self.time is None else self.time


@dataclass(frozen=True)
class Event:
    """A contact term touches, at stations that follow each other.

    name, rod, other : of the term and of what touches; begin, end [s] : first and last of the stations
    peak [N/m], peak_t [s], peak_s [m] : largest line force, when and where; s0, s1 [m] : stretch of the rod that touched
    gap [m] : smallest between the surfaces; lost [J] : by friction from the station before it to its last one
    """

    name: str
    rod: str
    other: str
    begin: float
    end: float
    peak: float
    peak_t: float
    peak_s: float
    s0: float
    s1: float
    gap: float
    lost: float


@dataclass(frozen=True)
class Chosen:
    """What was chosen for an accuracy that was asked for, in parts of each reported peak.

    estimate : estimated error on the elements chosen; elements : number and order for each rod; travels : whole runs made;
    iterations : of all of them and of the checks; dt [s] : shortest step, of a run in time
    """

    asked: float
    estimate: float
    elements: dict[str, tuple[int, int]]
    travels: int
    iterations: int
    dt: float | None = None

    def __str__(self) -> str:
        counts = ", ".join(f"{n} elements of order {order} on {rod!r}" for rod, (n, order) in self.elements.items())
        steps = "" if self.dt is None else f" and steps of {self.dt:.3g} s"
        return f"accuracy {self.asked:g} asked, {self.estimate:.1e} estimated with {counts}{steps}"


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """Where a path stops being stable, or is stable again.

    kind : "limit" (the load or time turns back), "bifurcation" (another path crosses), "flutter" (two frequencies have
        become one and oscillations grow) or "divergence" (a frequency has become zero)
    value : factor of the loads, or the time, of the path; t [s]; state
    shape (N, 6) : motion in which the tangent is singular: displacements [m], rotations in the section's axes [rad]
    before, after : negative eigenvalues of the tangent on both sides; -1 if not known
    station : number of the last state of the history before it
    """

    kind: Kind
    value: float
    t: float
    state: State
    shape: np.ndarray
    before: int
    after: int
    station: int = 0


@dataclass
class Counters:
    """What the solver did."""

    iterations: int = 0
    residuals: int = 0
    guarded: int = 0
    load_steps: int = 0
    bisections: int = 0
    linear: dict[str, int] = field(default_factory=dict)
