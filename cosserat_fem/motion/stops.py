"""When does something happen in a run? Times that are kept, kinks of motions and loads, jumps of loads: steps end there.

Rule: of times closer together than `near` only one counts. A load that jumps, or a motion that has a kink, gives rates
that are found anew.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..model import Model

SMALLEST = 1e-10  # of the duration: times nearer than this are one; a step shorter than this ends the run
ALIKE = 1e-6  # part of a step: by so much steps may be longer than asked, where times lost digits on a long way


class Stop(NamedTuple):
    """t [s]; whether a load jumps there, rates are found anew, the state is kept."""

    t: float
    jumps: bool
    settles: bool
    keeps: bool


class Stops:
    """Stops of one run from `begin` to `end` [s], of which `times` are kept, or all steps (None)."""

    def __init__(self, model: Model, begin: float, end: float, times: np.ndarray | None) -> None:
        self.near, self.every = SMALLEST * (end - begin), times is None
        motions = _inside([part.motion.kinks for part in model.parts if part.motion is not None], begin, end)
        kinks = _inside([term.kinks for term in model.terms if hasattr(term, "kinks")], begin, end)
        jumps = _inside([term.jumps for term in model.terms if hasattr(term, "jumps")], begin, end)
        kept = [] if times is None else [times[times > begin]]
        self._times = _merged([jumps, motions, kinks, np.array([end]), *kept], self.near)
        jumping = self._at(jumps)
        settling = jumping | self._at(motions)
        keeping = np.ones(len(self._times), dtype=bool) if times is None else self._at(times)
        self._stops = [
            Stop(*stop)
            for stop in zip(
                self._times.tolist(), jumping.tolist(), settling.tolist(), keeping.tolist(), strict=True
            )
        ]  # fmt: skip

    def after(self, t: float) -> Iterator[Stop]:
        """Stops that lie ahead of a time, one after the other."""
        for k in range(int(np.searchsorted(self._times, t + self.near)), len(self._stops)):
            yield self._stops[k]

    def _at(self, times: np.ndarray) -> np.ndarray:
        """Which stops are one of these times."""
        return (np.abs(self._times[:, None] - times[None]) <= self.near).any(axis=1)


def steps_to(left: float, wanted: float) -> int:
    """Number of equal steps, no longer than wanted, on a way that is left [s]."""
    return max(1, int(np.ceil(left / wanted - ALIKE)))


def _merged(lists: Sequence[np.ndarray], slack: float) -> np.ndarray:
    """Times of all lists in order; of those closer than `slack` only the one of the earliest list."""
    kept: list[float] = []
    for t in np.concatenate(lists).tolist():
        k = bisect_left(kept, t - slack)
        if k == len(kept) or kept[k] > t + slack:
            insort(kept, t)
    return np.array(kept)


def _inside(lists: Sequence[np.ndarray], start: float, end: float) -> np.ndarray:
    every = np.unique(np.concatenate([*lists, np.empty(0)]))
    return every[(every > start) & (every <= end)]
