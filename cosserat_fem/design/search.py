"""Which design is tried next? One variable: a scan, then brackets; several: samples, COBYQA, SLSQP.

Rule: the search sees the unit cube, a number to make least and margins that must not be negative; the answer is the best of
the designs that were run and keep all limits. Optimisers are published ones of `scipy.optimize`: for one variable
`brentq` between a design that keeps the limits and one that does not, and bounded `minimize_scalar` (both Brent 1973)
around the best of a scan; for several COBYQA (Ragonneau and Zhang 2022, a trust region without derivatives that never
leaves the bounds) from the best of a Latin hypercube, and SLSQP (Kraft 1988) from what it found.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, brentq, minimize, minimize_scalar

from .trial import FAILED, OutOfRuns, Trial, Trials

SCAN = 17  # designs over the range of one variable
EACH = 8  # samples for each of several variables
STARTS = 2  # samples that COBYQA starts from
INSIDE = 1e-6  # margin that COBYQA asks for, so that what it finds keeps the limit itself
SEED = 0
COARSE = 0.02  # of each range: to here COBYQA goes
STEP = 0.1  # of the tolerance: differences for SLSQP


def search(trials: Trials) -> bool:
    """Run designs until the best is known to the tolerance asked for; False if runs ended before."""
    try:
        trials(trials.start())
        if len(trials.low) == 1:
            _one(trials)
        else:
            _several(trials)
    except OutOfRuns:
        return False
    return True


def best(trials: Trials) -> Trial | None:
    """The design that keeps all limits and has the least objective; the first of equals."""
    return min((t for t in trials.done if t.feasible), key=lambda t: t.objective, default=None)


def closest(trials: Trials) -> Trial | None:
    """The design that breaks its limits least."""
    return max((t for t in trials.done if not t.reason), key=lambda t: t.margin, default=None)


def front(trials: Trials, first: str, second: str) -> list[Trial]:
    """Designs of which no other is better in one result and no worse in the other, both least; by the first."""
    rows = [(t.results[first], t.results[second], t) for t in trials.done if {first, second} <= t.results.keys()]
    rows.sort(key=lambda row: row[:2])
    found: list[Trial] = []
    least = np.inf
    for _, value, trial in rows:
        if value < least:
            found.append(trial)
            least = value
    return found


def _one(trials: Trials) -> None:
    """One variable: scan its range, then close in on every place where the best may be."""
    grid = [trials(np.array([u])) for u in _outwards(trials.start()[0])]
    _edges(trials)
    row = sorted(trials.done, key=lambda t: t.u[0])
    winner = best(trials)
    if winner is None:
        _deepest(trials, row)
        return
    k = row.index(winner)
    sides = row[max(k - 1, 0) : k + 2]
    if all(trial.feasible for trial in sides) and len(grid) > 2:

        def objective(u: float) -> float:
            return trials(np.array([u])).objective

        ends = (sides[0].u[0], sides[-1].u[0])
        minimize_scalar(objective, bounds=ends, method="bounded", options={"xatol": trials.design.tolerance})
        _edges(trials)


def _outwards(start: float) -> list[float]:
    """Points of a scan in the order in which each is next to one that was run: from the start to both ends."""
    points = np.linspace(0.0, 1.0, SCAN)
    return [*points[points >= start], *points[points < start][::-1]]


def _edges(trials: Trials) -> None:
    """Close in on each edge of the designs that keep the limits where a better one than the best may be."""
    for _ in range(SCAN):
        winner = best(trials)
        if winner is None:
            return
        row = sorted(trials.done, key=lambda t: t.u[0])
        wide = [
            (inside, outside)
            for pair in pairwise(row)
            for inside, outside in (pair, pair[::-1])
            if inside.feasible and not outside.feasible
            if inside is winner or min(inside.objective, outside.objective) < winner.objective
            if abs(outside.u[0] - inside.u[0]) > trials.design.tolerance
        ]
        if not wide:
            return
        for inside, outside in wide:
            _edge(trials, inside, outside)


def _edge(trials: Trials, inside: Trial, outside: Trial) -> None:
    """The edge between a design that keeps the limits and one that does not, to the tolerance from inside."""
    tolerance = trials.design.tolerance

    def margin(u: float) -> float:
        trial = trials(np.array([u]))
        return trial.margin if trial.margin != 0.0 else 1e-12  # on the edge is inside

    way = np.sign(inside.u[0] - outside.u[0])
    root = brentq(margin, outside.u[0], inside.u[0], xtol=tolerance / 4, rtol=4 * np.finfo(float).eps)
    if not trials(np.array([root])).feasible:
        trials(np.array([root + way * tolerance / 2]))


def _deepest(trials: Trials, row: list[Trial]) -> None:
    """No design keeps the limits: look for one where the least margin is largest."""
    k = int(np.argmax([trial.margin for trial in row]))
    ends = row[max(k - 1, 0)].u[0], row[min(k + 1, len(row) - 1)].u[0]

    def broken(u: float) -> float:
        return -trials(np.array([u])).margin

    minimize_scalar(broken, bounds=ends, method="bounded", options={"xatol": trials.design.tolerance})
    _edges(trials)


def _several(trials: Trials) -> None:
    """Several variables: samples of the cube, COBYQA from the best of them, SLSQP from what it found."""
    from scipy.stats import qmc

    n = len(trials.low)
    samples = qmc.LatinHypercube(n, rng=np.random.default_rng(SEED)).random(EACH * n)
    start = trials.start()
    for u in sorted(samples, key=lambda u: float(np.linalg.norm(u - start))):
        trials(u)
    ranked = sorted(trials.done, key=lambda t: (not t.feasible, t.objective if t.feasible else -t.margin))
    finite = [t.objective for t in trials.done if np.isfinite(t.objective)]
    scale = (float(np.ptp(finite)) if finite else 0.0) or 1.0
    worst = max(finite, default=0.0) + scale

    def objective(u: np.ndarray) -> float:
        value = trials(u).objective
        return (value if np.isfinite(value) else worst) / scale

    def margins(u: np.ndarray) -> np.ndarray:
        trial = trials(u)
        return np.array(trial.margins) - trial.reserve if trial.margins else np.full(len(trials.limits), FAILED)

    held = [NonlinearConstraint(margins, INSIDE, np.inf)] if trials.limits else []
    for trial in ranked[:STARTS]:
        minimize(
            objective, trial.u, method="COBYQA", bounds=Bounds(0.0, 1.0), constraints=held,
            options={"initial_tr_radius": 0.5 / EACH, "final_tr_radius": COARSE},
        )  # fmt: skip
    winner = best(trials)
    if winner is not None:
        _polish(trials, winner, scale)


def _polish(trials: Trials, start: Trial, scale: float) -> None:
    """Find the kink that the least of a largest value lies in: least z with z >= every piece, by SLSQP.

    Peaks over stations have no gradient where two stations are equally high, and there the best design often is; the pieces
    have one. Differences are taken towards the middle of the cube.
    """
    n = len(start.u)
    step = STEP * trials.design.tolerance

    def values(z: np.ndarray) -> np.ndarray:
        trial = trials(z[:n])
        if trial.reason:
            return np.full(len(start.pieces) + len(start.margin_pieces), FAILED)
        return np.concatenate([z[n] - trial.pieces / scale, trial.margin_pieces - INSIDE])

    def slopes(z: np.ndarray) -> np.ndarray:
        here, out = values(z), np.zeros((len(start.pieces) + len(start.margin_pieces), n + 1))
        for k in range(n):
            h = step if z[k] < 0.5 else -step
            moved = np.array(z)
            moved[k] += h
            out[:, k] = (values(moved) - here) / h
        out[: len(start.pieces), n] = 1.0
        return out

    top = np.eye(n + 1)[n]
    minimize(  # type: ignore[call-overload]
        lambda z: z[n], [*start.u, start.objective / scale], jac=lambda z: top, method="SLSQP",
        bounds=[*[(0.0, 1.0)] * n, (None, None)], constraints=[{"type": "ineq", "fun": values, "jac": slopes}],
        options={"ftol": trials.design.tolerance * 1e-2, "maxiter": 40},
    )  # fmt: skip
