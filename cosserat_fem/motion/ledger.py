"""What has contact added to the energy of a run, and may a step be taken?

Rule: what contact does to rods is what its potential and friction give, less what moving parts take. What it adds beside
that is an error: a little in all and nearly none in a step is allowed, and as little as it may take by itself; a step with
more did not resolve the barrier and is made again. Friction's work is known to first order only: by a part of it the rest
may be off.
"""

from __future__ import annotations

import numpy as np

from ..iteration.barrier import Approach
from ..iteration.newton import Solved
from ..kernels.rotation import quaternion_from_matrix, relative_rotation
from ..model import Model
from ..space import State
from ..terms.inertial import InertiaStep, Rates
from ..terms.touch import Pressed
from .impact import Grip, Impact

RUBBED = 0.1  # part of the work of friction in a step that may be missing
GAINED, LOST = 1e-6, 2e-3  # parts of the largest energy that contact may add in all, or take in a step, by itself
LITTLE = 1e-3  # of that: added in one step, it is none


class Ledger:
    """Contact's energy in one run.

    Attributes
    ----------
    pressed : what contact does at the present state
    stored : energies [J] in the contact terms there
    largest, added : [J], largest energy of the run so far, and what contact surely added to it
    """

    def __init__(self, model: Model, approach: Approach, impact: Impact) -> None:
        self.model, self.approach, self.impact = model, approach, impact
        self.pressed: tuple[Pressed, ...] = ()
        self.stored: list[float] = []
        self.largest = self.added = 0.0

    def open(self, state: State, v: np.ndarray) -> None:
        """Begin at a state, with the velocity v (N, 6) of its nodes."""
        self.pressed = self.approach.accept(state)[1]
        self.stored = self.stored_at(state)
        self.largest = self._energy(state, v) + sum(self.stored)

    def stored_at(self, state: State) -> list[float]:
        """Energy [J] in each contact term."""
        return [term.potential(state, self.model.space) for term in self.model.contacts]

    def striking(self, state: State, v: np.ndarray) -> float:
        """Energy [J] with which rods might hit something, parts included."""
        speed = np.linalg.norm(v[:, :3], axis=1)
        for part in {
            term.part for term in self.model.contacts if hasattr(term, "part") and term.part.motion is not None
        }:
            rates, (_, c) = part.rates(state.t), part.pose(state.t)
            speed = speed + np.linalg.norm(np.cross(rates.omega, state.r - c) + rates.c_rate, axis=1)
        return 0.5 * float(speed**2 @ self.model.space.node_mass)

    def brace(self, state: State, v: np.ndarray) -> State:
        """The state with contact that can take up what might hit something, while something else touches already."""
        braced = self.approach.brace(state, self.striking(state, v))
        stored = self.stored_at(braced)
        if sum(stored) - sum(self.stored) > LOST * self.largest:
            return state
        self.stored = stored
        return braced

    def step(
        self, state: State, solved: Solved, inertia: InertiaStep, grip: Grip, t1: float
    ) -> tuple[list[float], list[float], float]:
        """A step from a state: work [J] of each term on rods, energies stored at its end, energy that was added."""
        stored, works = self.stored_at(solved.state), []
        late = self.impact.lasting if grip.steady else inertia.late
        added = float(np.vdot(inertia.shared, inertia.D))
        both = zip(self.model.contacts, self.stored, stored, self.pressed, solved.pressed, strict=True)
        for term, was, now, last, told in both:
            done = was - now + told.rubbed
            if hasattr(term, "part") and term.part.motion is not None:
                (R, c), (R1, c1) = term.part.pose(state.t), term.part.pose(t1)
                spin = R @ relative_rotation(quaternion_from_matrix(R)[None], quaternion_from_matrix(R1)[None])[0]
                moved = np.concatenate([c1 - R1 @ R.T @ c, spin])  # of the part's point at the origin of space
                done -= float((late * told.load + (1.0 - late) * last.load) @ moved)
            works.append(done)
            added -= done
        return works, stored, added

    def refuses(self, solved: Solved, rates: Rates, stored: list[float], added: float) -> bool:
        """True if contact adds energy in a step, or takes more than it should: the barrier was not resolved in time."""
        self.largest = max(self.largest, self._energy(solved.state, rates.v) + sum(stored))
        if not (any(self.stored) or any(stored)):
            return False
        least, most = -LOST * self.largest - self._unsure(solved), GAINED * self.largest
        surely = self._surely(solved, added)
        return added < least or (surely > LITTLE * most and self.added + surely > most)

    def take(self, solved: Solved, stored: list[float], added: float) -> None:
        """The step is taken."""
        self.pressed, self.stored = solved.pressed, stored
        self.added += self._surely(solved, added)

    def _unsure(self, solved: Solved) -> float:
        """Energy [J] by which the work of contact in a step may be off."""
        return RUBBED * sum(abs(told.rubbed) for told in solved.pressed)

    def _surely(self, solved: Solved, added: float) -> float:
        """What contact added in a step beyond that; what it took counts against it."""
        return float(np.copysign(max(abs(added) - self._unsure(solved), 0.0), added))

    def _energy(self, state: State, v: np.ndarray) -> float:
        """Kinetic and strain energy [J]."""
        space, total = self.model.space, 0.0
        for k, group in enumerate(space.groups):
            strain = space.strain_and_frame(state, k)[0] - group.reference
            total += 0.5 * float(
                np.einsum("eqi,eqij,eqj,eq->", strain, group.stiffness, strain, group.dx, optimize=True)
            )
        return total + 0.5 * float(
            (v[:, :3] ** 2).sum(1) @ space.node_mass + (v[:, 3:] ** 2 * space.node_inertia).sum()
        )
