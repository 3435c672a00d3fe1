"""Which elements does an accuracy need? Order and graded elements, found by the error of what is reported.

Rule: a coarse travel finds the states; at the stations where something reported has its peak, and at some between, states
are carried from mesh to mesh until the estimated error holds there; then the whole travel is run once on that mesh
and judged again. Reported are the components of reactions, hinge torques and places of nodes, each in parts of its peak
over the run; of a place in parts of the rod's length.

Elements are graded by the highest Legendre modes that the richer solution has in each, of its stresses, weighed with their
compliance, and of its section frames: eta^2 = h (|stress|^2 / 2 C U + |frame|^2 / L). For degree p it goes as h^(2 p + 1),
and the error of reported numbers as the sum of eta^2: it is a product of two errors like eta, its own and that of the load
that would ask for it. Elements with equal eta^2 are the fewest. How fast the modes fall from one degree to the next says
what another degree would need; the cheapest is taken.

With contact, states are not carried (surfaces would overlap on another mesh): every mesh is travelled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import ConvergenceError, check_positive
from ..history import History
from ..iteration.newton import Newton
from ..mechanism import Hinge
from ..model import Model
from ..record import Chosen, Record
from ..rod import Elements, Rod
from ..space import State
from .estimate import Richer, moved
from .transfer import Transfer

PILOT_ORDER, PILOT_ELEMENTS = 3, 6
TURN = np.pi / 4  # rad in a pilot element
PILOT_STATIONS, SPREAD = 13, 5
SAFETY, ACCEPTED = 0.4, 0.8  # parts of the accuracy that are aimed at, and accepted
ROUNDS, TRAVELS = 6, 4
ORDERS = (2, 3, 4, 5)
COST = {2: 3.9, 3: 6.4, 4: 11.0, 5: 17.0}  # us an element and iteration
FIXED_COST = 100.0  # us an iteration
FASTEST, SLOWEST = 8.0, 0.25  # change of the density of elements in one round
SMALL, MINOR = (
    0.1,
    0.01,
)  # components count in parts of at least so much of their vector's peak, vectors of the largest one
MOST = 100_000  # elements
Run = Callable[[Model, np.ndarray, "State | None"], History]


def check_accuracy(where: str, accuracy: Any) -> float:
    """The accuracy asked for; ValueError if it is none."""
    value = check_positive(f"{where}: accuracy", accuracy)
    if not 1e-9 <= value < 1.0:
        raise ValueError(
            f"{where}: accuracy must be from 1e-9 to below 1 (got {value:g}); it is relative to each peak."
        )
    return value


def to_accuracy(model: Model, accuracy: float, times: np.ndarray, run: Run, start: State | None = None) -> History:
    """History of `run` on elements on which the estimated error of everything reported is at most `accuracy`.

    run(model, times, start) travels through equilibria. `history.model` has the elements found, with the same rods,
    supports and terms; `history.chosen` says which they are and how accurate. Warns if the accuracy was not reached.
    """
    few = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), PILOT_STATIONS)).round().astype(int))]
    history = _pilot(model, few, run, start)
    spent, travels, target = history.counters.iterations, 1, SAFETY * accuracy
    whole = len(few) == len(times)
    while True:
        if history.status == "stopped":
            return history
        judged = Judged(history)
        spent += judged.iterations
        if whole and (judged.error <= ACCEPTED * accuracy or travels == TRAVELS):
            break
        if whole and len(times) > 1 and np.isfinite(judged.error):
            target = min(target, 0.7 * accuracy * target / judged.error)
        if judged.error > target:
            judged = _improve(judged, target)
            spent += judged.iterations
        carried = not model.contacts and len(judged.history) > 0
        if len(times) == 1 and carried:
            history = judged.history
            break
        first = judged.history.records[0].state if carried else None
        if first is not None and first.t != times[0]:
            first = None
        history = run(judged.history.model, times, first)
        spent, travels, whole = spent + history.counters.iterations, travels + 1, True
    meshes = {rod.name: (len(v.mesh.ends) - 1, v.mesh.order) for rod, v in history.model.space.views.items()}
    history.chosen = Chosen(accuracy, judged.error, meshes, travels, spent)
    history.message = f"{history.message}; {history.chosen}" if history.message else str(history.chosen)
    if judged.error > accuracy:
        model.warn(f"accuracy {accuracy:g} was not reached: the estimated error is {judged.error:.2g} of a peak.")
    return history


def _pilot(model: Model, times: np.ndarray, run: Run, start: State | None) -> History:
    """A travel on few elements, more if it takes them. With contact on the elements that the rods ask for."""
    if model.contacts:
        return run(model, times, start)
    counts = {rod: pilot_elements(rod) for rod in model.rods}
    more = 1
    while True:
        mesh = {
            rod: Elements(PILOT_ORDER, rod.element_ends(marks, more * counts[rod]))
            for rod, marks in zip(model.rods, model.marks, strict=True)
        }
        coarse = model.with_elements(mesh)
        state = None if start is None else Transfer(model, coarse).state(start)
        try:
            return run(coarse, times, state)
        except ConvergenceError:
            if more == 4:
                raise
            more *= 2


def pilot_elements(rod: Rod, fewest: int = PILOT_ELEMENTS) -> int:
    """Elements that can follow the drawn curve and the rest shape."""
    s = np.linspace(0.0, rod.length, 201)
    tangent = rod.frames(s)[..., 2]
    turn = np.arccos(np.clip((tangent[1:] * tangent[:-1]).sum(-1), -1.0, 1.0)).sum()
    rest = np.linalg.norm(rod.rest_curvature(s), axis=1).mean() * rod.length
    return max(fewest, int(np.ceil(max(turn, rest) / TURN)))


class Judged:
    """A history with its estimated error, and the richer states it comes from.

    error : largest of all that is reported, relative; stations : those that were solved again; finer : {station: state}
    """

    def __init__(self, history: History, scales: Scales | None = None) -> None:
        self.history = history
        self.scales = scales or Scales(history)
        stations = range(len(history)) if scales else self.scales.stations(history)
        self.richer = Richer(history)
        self.error, self.finer, self.errors = 0.0, {}, {}
        for k in stations:
            found = self.richer.station(k)
            if found is None:
                self.error = np.inf
                continue
            self.finer[k], self.errors[k] = found, self.scales.error(history, k, found)
            self.error = max(self.error, self.errors[k])
        self.iterations = self.richer.newton.counters.iterations


class Scales:
    """What the reported numbers of a run are measured by: peaks of reactions (supports, 6), torques, and lengths."""

    def __init__(self, history: History) -> None:
        model = history.model
        self.hinged = [part for part in model.parts if isinstance(part.motion, Hinge)]
        self.loads = np.array([record.reactions for record in history.records]).reshape(len(history), -1, 6)
        self.torques = np.array([history.hinge_torque(part) for part in self.hinged]).reshape(
            len(self.hinged), len(history)
        )
        least = 1e-3 * max(model.scales["bending"] / model.scales["length"] ** 2, 1e-9 * model.scales["axial"])
        self.size = np.empty(self.loads.shape[1:])
        for part, floor in ((slice(0, 3), least), (slice(3, 6), least * model.scales["length"])):
            loads = self.loads[..., part]
            vectors = np.linalg.norm(loads, axis=2).max(axis=0, initial=0.0)
            smallest = np.maximum(SMALL * vectors, max(MINOR * vectors.max(initial=0.0), floor))
            self.size[:, part] = np.maximum(np.abs(loads).max(axis=0, initial=0.0), smallest[:, None])
        self.torque = np.maximum(
            np.abs(self.torques).max(axis=1, initial=0.0), MINOR * self.size[:, 3:].max(initial=0.0)
        )
        self.torque = np.maximum(self.torque, least * model.scales["length"])

    def stations(self, history: History) -> list[int]:
        """Where something reported has its peak, and some between."""
        spread = np.linspace(0, len(history) - 1, min(len(history), SPREAD)).round().astype(int).tolist()
        peaks = np.abs(self.loads).argmax(axis=0)[(np.abs(self.loads).max(axis=0) > SMALL * self.size)]
        return sorted({*spread, *peaks.tolist(), *np.abs(self.torques).argmax(axis=1).tolist()})

    def error(self, history: History, k: int, finer: History) -> float:
        """Largest relative difference of a station from the same one on richer elements."""
        record, other = history.records[k], finer.records[0]
        errors = [float((np.abs(other.reactions - record.reactions) / self.size).max(initial=0.0))]
        one = History(history.model, [record])
        for part, size in zip(self.hinged, self.torque, strict=True):
            errors.append(abs(float(finer.hinge_torque(part)[0] - one.hinge_torque(part)[0])) / size)
        errors += [distance / rod.length for rod, (distance, _) in moved(history, k, finer).items()]
        return max(errors)


def _improve(judged: Judged, target: float) -> Judged:
    """States of the judged stations on elements on which their error is at most the target; with contact one better mesh."""
    model, scales, spent = judged.history.model, judged.scales, 0
    for _ in range(ROUNDS):
        mesh = model.with_elements(_graded(judged, target))
        if model.contacts:
            judged.history = History(mesh, judged.history.records)
            return judged
        transfer, newton, records = Transfer(judged.richer.model, mesh), Newton(mesh), []
        for k in sorted(judged.finer):
            guess = transfer.state(judged.finer[k].final)
            solved = newton.plain(guess)
            if not solved.converged:
                solved = newton.guarded(guess)
            if not solved.converged:
                break
            records.append(Record(solved.state, solved.reactions, solved.iterations, solved.residual, solved.negative))
        spent += newton.counters.iterations
        history = History(mesh, records, counters=newton.counters)
        if not records or len(records) < len(judged.finer):  # states are lost on the way: travel there
            judged.history, judged.iterations = History(mesh), spent
            return judged
        judged = Judged(history, scales)
        spent += judged.iterations
        if judged.error <= target * ACCEPTED / SAFETY:
            break
    judged.iterations = spent
    return judged


@dataclass(frozen=True, eq=False)
class Rest:
    """What degree p leaves over in each element of a rod: eta^2 (E,) of the station that has most, in parts of the error,
    and how much of it another degree takes away, theta^2 (E,)."""

    ends: np.ndarray
    order: int
    eta2: np.ndarray
    theta2: np.ndarray

    def at_order(self, order: int) -> np.ndarray:
        """eta^2 (E,) for another degree on the same elements."""
        return self.eta2 * self.theta2 ** (order - self.order)


def _graded(judged: Judged, target: float) -> dict[Rod, Elements]:
    """Cheapest elements on which the error should be at most the target."""
    rests = _rests(judged)
    best = (np.inf, 0, 0.0)
    for order in ORDERS:
        total = sum(float((rest.at_order(order) ** (1 / (2 * order + 1))).sum()) for rest in rests.values())
        wanted = (total ** (2 * order + 1) / target) ** (1 / (2 * order))
        n = sum(
            float(np.maximum(wanted / total * rest.at_order(order) ** (1 / (2 * order + 1)), SLOWEST).sum())
            for rest in rests.values()
        )
        best = min(best, (FIXED_COST + COST[order] * n, order, wanted / total))
    _, order, each = best
    meshes = {}
    for (rod, rest), marks in zip(rests.items(), judged.history.model.marks, strict=True):
        density = np.clip(each * rest.at_order(order) ** (1 / (2 * order + 1)), SLOWEST, FASTEST) / np.diff(rest.ends)
        meshes[rod] = Elements(order, _spread(rest.ends, density, marks))
    return meshes


def _spread(ends: np.ndarray, density: np.ndarray, marks: list[float]) -> np.ndarray:
    """Boundaries with about `density` (E,) elements per metre, given on the elements between `ends`; one at each mark."""
    middle = 0.5 * (ends[1:] + ends[:-1])
    s = np.unique(np.concatenate([np.linspace(a, b, 17) for a, b in pairwise(ends)]))
    smooth = np.exp(np.interp(s, middle, np.log(density)))
    share = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(s))])
    if share[-1] > MOST:
        share *= MOST / share[-1]
    L = ends[-1]
    cuts = [0.0, *sorted({float(m) for m in marks if 1e-9 * L < m < (1 - 1e-9) * L}), float(L)]
    pieces = []
    for a, b in pairwise(cuts):
        low, high = np.interp([a, b], s, share)
        n = max(1, int(np.ceil(high - low - 0.1)))
        inner = np.interp(np.linspace(low, high, n + 1), share, s)
        inner[[0, -1]] = a, b
        pieces.append(inner[:-1])
    return np.append(np.concatenate(pieces), L)


def _rests(judged: Judged) -> dict[Rod, Rest]:
    """What the elements of the judged history leave over, from the modes of the richer stresses."""
    history = judged.history
    found: dict[Rod, list[tuple[np.ndarray, np.ndarray]]] = {rod: [] for rod in history.model.rods}
    for k, finer in judged.finer.items():
        parts = {rod: _modes(finer, rod) for rod in history.model.rods}
        total = sum(float(eta2.sum()) for eta2, _ in parts.values())
        for rod, (eta2, theta2) in parts.items():
            found[rod].append((judged.errors[k] * eta2 / max(total, 1e-300), theta2))
    rests = {}
    for rod, several in found.items():
        mesh = history.model.space[rod].mesh
        if not several or not np.isfinite(judged.error):  # nothing is known: twice as many elements
            n = len(mesh.ends) - 1
            rests[rod] = Rest(mesh.ends, mesh.order, np.ones(n), np.ones(n))
            continue
        eta2 = np.array([e for e, _ in several])
        worst = eta2.argmax(axis=0)
        theta2 = np.array([t for _, t in several])[worst, np.arange(eta2.shape[1])]
        rests[rod] = Rest(mesh.ends, mesh.order, np.maximum(eta2.max(axis=0), 1e-30), theta2)
    return rests


def _modes(finer: History, rod: Rod) -> tuple[np.ndarray, np.ndarray]:
    """eta^2 (E,) of the highest Legendre mode of a state, and the ratio (E,) of that mode to the one before.

    Modes of symmetric fields vanish in turn: two neighbours count as one.
    """
    space, state = finer.model.space, finer.final
    view = space[rod]
    group = space.groups[view.group]
    strain, frame = (x[view.elements] for x in space.strain_and_frame(state, view.group))
    C = group.stiffness[view.elements]
    stress = np.einsum("eqij,eqj->eqi", C, strain - group.reference[view.elements])
    stiff = np.diagonal(C, axis1=-2, axis2=-1).mean(axis=(0, 1))
    root = np.where(stiff > 0, 1.0 / np.sqrt(np.where(stiff > 0, stiff, 1.0)), 0.0)
    h, x = np.diff(view.mesh.ends), 2.0 * group.basis.X[0] - 1.0
    weighed = stress * root
    size = np.sqrt(np.einsum("eqi,eqi,eq->", weighed, weighed, group.dx[view.elements]))
    fields = np.concatenate(
        [weighed / max(size, 1e-300), frame.reshape(*frame.shape[:2], 9) / np.sqrt(rod.length)], axis=2
    )
    P = len(x)
    V = np.polynomial.legendre.legvander(x, P - 1) * np.sqrt(2.0 * np.arange(P) + 1.0)
    energy = (np.einsum("jq,eqi->eji", np.linalg.inv(V), fields) ** 2).sum(axis=2) * h[:, None]
    top, below = energy[:, -1], energy[:, -2]
    lower = energy[:, -3] if P > 2 else below
    theta2 = np.clip((top + below) / np.maximum(below + lower, 1e-300), 1e-4, 1.0)
    return np.maximum(top, theta2 * below), theta2
