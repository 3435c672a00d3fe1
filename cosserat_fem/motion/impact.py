"""How does contact enter a time step? As an impulse where it comes and goes, with all other forces where it lasts.

Rule: what presses a node against the rest that acts on it goes through the method with that rest, so that they stay in
balance. Elsewhere contact is an impulse h w: it adds h w to the velocity and beta / gamma h^2 w to the displacement, and is
left out of the auxiliary accelerations. So nothing rings after an impact, and a contact whose force is that of the end of
the step adds no energy, whatever the step, since its potential is convex: w D <= Psi_0 - Psi_1. Once steps resolve it, half
of the force is that of the beginning, for the order. (The split of smooth motion and impulses is that of nonsmooth
generalized-alpha, Chen, Acary, Virlez and Bruels 2013, doi 10.1002/nme.4563; here with a barrier instead of a
complementarity condition.)

By the rates that an increment has by the method, v is then right, and b is too large by w / gamma, a by `counted` w,
counted = (1 - am) / ((1 - af) gamma): so the residual takes an impulse `counted` times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..iteration.newton import Solved
from ..model import Model
from ..space import State
from ..terms.inertial import InertiaStep, Rates
from .rates import Balance

RESOLVED = 0.5  # of the speed where it acts: what contact may add to it in a step that resolves it
LASTING = 0.3  # of an acceleration: what contact that lasts may leave of it
BLOCKS = (slice(0, 3), slice(3, 6))


@dataclass(frozen=True, eq=False)
class Grip:
    """Contact at an accepted state: its force (N, 6) on the nodes, the acceleration that it gives them, where it lasts."""

    force: np.ndarray
    answer: np.ndarray
    lasts: np.ndarray

    @property
    def steady(self) -> bool:
        """True if something touches, and all of it lasts."""
        return bool(self.force.any() and (self.lasts | (self.force == 0.0)).all())


class Impact:
    """Contact in the time steps of one model."""

    def __init__(self, model: Model, balance: Balance) -> None:
        self.model, self.balance = model, balance
        # part of what lasts that does its work with its force at the end of a step: half of it, as of other forces, to
        # second order; all of it beside friction, whose work is known as that of its end
        self.lasting = 0.5 if all(term.friction == 0.0 for term in model.contacts) else 1.0

    def feel(self, state: State, rates: Rates, lasts: np.ndarray) -> tuple[Rates, Grip]:
        """Contact at an accepted state, and rates that have it where it lasts; given are some that have it at `lasts`."""
        force = -self.model.touching(state)
        answer = self.balance.share(state, force)[0]
        had = np.where(lasts, answer, 0.0)
        now = np.zeros(answer.shape, dtype=bool)
        for k in BLOCKS:
            alone = rates.b[:, k] - had[:, k]
            now[:, k] = (((alone + answer[:, k]) ** 2).sum(1) < LASTING**2 * (alone**2).sum(1))[:, None]
        change = np.where(now, answer, 0.0) - had
        return Rates(rates.v, rates.a + change, rates.b + change), Grip(force, answer, now)

    def late(self, grip: Grip, v: np.ndarray, h: float) -> float:
        """Part of the force of an impulse that is that of the end of a step."""
        speed = np.sqrt((v[(grip.answer != 0.0).any(axis=1), :3] ** 2).sum(axis=1).max(initial=0.0))
        gained = h * np.sqrt((grip.answer[:, :3] ** 2).sum(axis=1).max())
        return 0.5 if gained <= RESOLVED * speed else 1.0

    def enter(self, step: InertiaStep, grip: Grip, late: float) -> np.ndarray:
        """Tell a step how many times contact counts; returns what its beginning adds to the residual (N, 6)."""
        step.late = late
        step.push = np.where(grip.lasts, 1.0, late * step.counted)
        return np.where(grip.lasts, 0.0, -(1.0 - late) * step.counted * grip.force)

    def leave(self, step: InertiaStep, grip: Grip, solved: Solved) -> Solved:
        """Take impulses out of the rates of a converged step; its residual then has contact once, as it is at the end."""
        last = -self.model.touching(solved.state)
        late = np.where(grip.lasts, self.lasting, step.late)
        step.shared = late * last + (1.0 - late) * grip.force
        impulse = np.where(grip.lasts, 0.0, step.shared)
        w, left = self.balance.share(solved.state, impulse)
        step.a -= step.counted * w
        step.b -= w / step.coefficients[4]
        left = step.counted * left - self.balance.share(solved.state, np.where(grip.lasts, 0.0, last))[1]
        return replace(solved, total=replace(solved.total, g=solved.total.g + left))
