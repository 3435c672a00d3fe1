"""Which elements and steps does the accuracy of a motion need? Found by runs that differ in one of them.

Rule: judged are the places of nodes: root mean square over the kept times, the worst node, in parts of the rod's length.
Reactions are not: waves with fronts give them no limit to converge to; what is estimated of them stands beside each peak.

Elements are found with long steps, since their error depends little on the step: a run against one on elements of one
degree more. Waves pass everywhere, so elements stay spread as the rod asks for, and their number grows. Then steps are
halved. Of the last runs A, B, C with steps h, h / 2, h / 4, R = (4 C - B) / 3 has no error of second order; it is off by
less than its distance from (4 B - A) / 3: a fifteenth of it if the motion is smooth; a quarter is reckoned with, or less if
such distances were seen to fall faster. Last, elements are judged again with shorter steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..accuracy.estimate import raised
from ..accuracy.refine import PILOT_ORDER, pilot_elements
from ..accuracy.transfer import Transfer
from ..errors import ConvergenceError
from ..history import History
from ..model import Model
from ..record import Chosen
from ..rod import Elements

SHARE = 0.4  # of the accuracy for the elements, and for the steps
ALMOST, AIM = 3.0, 0.95  # error, in parts of the wanted one, from which no whole halving is needed; step then aimed at
USED = 0.85  # of it in all, before elements are judged again
FIRST_STEPS, FIRST_ACCURACY, SHORTER = (
    100,
    1e-3,
    0.3,
)  # steps of the first run, more for more: waves must not be lost in them
HALVINGS, ROUNDS, REPAIRS = 12, 8, 3
FEWEST = {3: 5, 4: 8}  # elements to begin with, by order
MORE_DEGREES = 1e-4  # accuracy from which on the order is one higher
RATE, GROWTH = 4.0, (1.25, 3.0)  # the error of elements falls with this power of their number; least and most growth
SMOOTH = 0.25  # error of an extrapolated motion in parts of its distance from the one before
Run = Callable[[Model, float], History]
Extrapolate = Callable[[History, History], History]


class _Stopped(Exception):
    """The caller wants no more; with the history that was being made."""

    def __init__(self, history: History) -> None:
        self.history = history


class Search:
    """Runs on the way to an accuracy, and what they cost."""

    def __init__(self, model: Model, accuracy: float, duration: float, run: Run, extrapolate: Extrapolate) -> None:
        self.model, self.accuracy, self.duration, self._run, self._extrapolate = (
            model,
            accuracy,
            duration,
            run,
            extrapolate,
        )
        self.order = PILOT_ORDER + (accuracy <= MORE_DEGREES)
        self.counts = {rod: pilot_elements(rod, FEWEST[self.order]) for rod in model.rods}
        self.runs = self.iterations = 0

    def mesh(self) -> Model:
        """The model on as many elements as are thought to be needed now."""
        return self.model.with_elements(
            {
                rod: Elements(self.order, rod.element_ends(marks, self.counts[rod]))
                for rod, marks in zip(self.model.rods, self.model.marks, strict=True)
            }
        )

    def refine(self, error: float) -> None:
        """More elements for an error that is too large."""
        factor = float(np.clip((error / (SHARE * self.accuracy)) ** (1 / RATE), *GROWTH))
        self.counts = {rod: int(np.ceil(factor * n)) for rod, n in self.counts.items()}

    def run(self, model: Model, dt: float) -> History:
        history = self._run(model, dt)
        self.runs, self.iterations = self.runs + 1, self.iterations + history.counters.iterations
        if history.status == "stopped":
            raise _Stopped(history)
        return history

    def of_elements(self, history: History, dt: float) -> float:
        """Estimated error of the elements of a run with steps dt."""
        return apart(history, self.run(raised(history.model), dt))

    def elements(self) -> tuple[History, float, float]:
        """A run with long steps on elements that hold, the error of these, and the step."""
        dt = self.duration / (FIRST_STEPS * (FIRST_ACCURACY / self.accuracy) ** SHORTER)
        for _ in range(ROUNDS):
            try:
                history = self.run(self.mesh(), dt)
                error = self.of_elements(history, dt)
            except ConvergenceError:
                dt *= 0.5
                continue
            if error <= SHARE * self.accuracy:
                break
            self.refine(error)
        return history, error, dt

    def halve(self, runs: list[History], dt: float, wanted: float) -> tuple[History, float, float]:
        """Halve the steps dt of the first run until their error is as wanted: history, error, last step. Runs are added."""
        before: History | None = None
        change = np.inf
        while True:
            dt *= 0.5
            runs.append(self.run(runs[0].model, dt))
            history, error = runs[-1], apart(runs[-2], runs[-1]) / 3
            if error > wanted:
                joined = self._extrapolate(_copy(runs[-2]), _copy(runs[-1]))
                if before is not None:
                    last, change = change, apart(before, joined)
                    seen = last / max(change, 1e-300) if last < np.inf else 0.0
                    fall = float(np.clip(seen, 1 + 1 / SMOOTH, 16.0))
                    if change / (fall - 1) < error:
                        history, error = joined, change / (fall - 1)
                before = joined
            if error <= wanted or len(runs) > HALVINGS:
                return history, error, dt
            if error < ALMOST * wanted and history is runs[-1]:  # a little shorter will do
                nearly = AIM * dt * np.sqrt(wanted / error)
                last_one = self.run(runs[0].model, nearly)
                error *= squared_steps(last_one) / squared_steps(history)
                if error <= wanted:
                    return last_one, error, nearly


def motion_to_accuracy(model: Model, accuracy: float, duration: float, run: Run, extrapolate: Extrapolate) -> History:
    """History of a run in time in which the estimated error of every node's place is at most `accuracy`.

    run(model, dt) makes a run with steps of one length and keeps the same times in each; extrapolate(coarse, fine) joins
    two. `history.model` has the elements found; `history.chosen` says which they are, and the step. Warns if the accuracy
    was not reached.
    """
    search = Search(model, accuracy, duration, run, extrapolate)
    try:
        first, of_elements, dt = search.elements()
        for k in range(REPAIRS):
            runs = [first]
            history, of_steps, last = search.halve(runs, dt, max(SHARE, USED - of_elements / accuracy) * accuracy)
            back = min(4, len(runs))
            if back < len(runs) or k > 0:
                of_elements = search.of_elements(runs[-back], last * 2 ** (back - 1))
            if of_elements + of_steps <= accuracy or k == REPAIRS - 1:
                break
            search.refine(of_elements)
            dt = min(dt, 4 * last)
            first = search.run(search.mesh(), dt)
    except _Stopped as stopped:
        return stopped.history
    meshes = {rod.name: (len(v.mesh.ends) - 1, v.mesh.order) for rod, v in history.model.space.views.items()}
    history.chosen = Chosen(accuracy, of_elements + of_steps, meshes, search.runs, search.iterations, last)
    history.message = f"{history.message}; {history.chosen}"
    if history.chosen.estimate > accuracy:
        model.warn(f"accuracy {accuracy:g} was not reached: the estimated error is {history.chosen.estimate:.2g}.")
    return history


def squared_steps(history: History) -> float:
    """Mean of h^2 [s^2] over a run."""
    h = np.array([h for _, h, _, accepted in history.steps if accepted])
    return float((h**3).sum() / h.sum())


def _copy(history: History) -> History:
    """A history whose records and counters can be changed."""
    return replace(history, records=list(history.records), counters=replace(history.counters))


def apart(one: History, other: History) -> float:
    """Root mean square over the kept times of the distance of a node in two runs, the worst node, in rod lengths."""
    moved = Transfer(other.model, one.model)
    total = np.zeros(one.model.space.n_nodes)
    for a, b in zip(one.records, other.records, strict=True):
        r = b.state.r if one.model is other.model else moved.nodal(b.state.r)
        total += ((a.state.r - r) ** 2).sum(axis=1)
    rms = np.sqrt(total / max(len(one), 1))
    return max(float(rms[view.nodes].max()) / rod.length for rod, view in one.model.space.views.items())
