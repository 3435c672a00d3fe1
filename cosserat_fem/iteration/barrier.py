"""How far may an iterate go? States that stay out of parts and of each other, on the way to a new time.

Rule: a state whose contact is free of overlap is left only for another one. An increment of the Newton method is cut where
a gap would close; parts move along with it, so that a part pushes a rod in front of it and never steps into it: the time
for which they stand, `State.contact.time`, goes on by the part of the increment that was taken. How the forces change while
parts go the rest of their way is added to the residual of an iteration, which is then a tangent step along the motion.

What contact remembers (slip, pressure scale, work lost) is renewed only when a state is accepted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import SceneError
from ..model import Model
from ..space import Contact, State
from ..terms.touch import Pressed

SMALLEST = 1e-9  # part of an increment: less is no way forward
NEARLY_SHUT, STIFFER = 0.05, 10.0  # part of its range to which a gap may shrink before its pressure scale grows so much
SOFT, FIRM = 1e-5, 0.03  # where the largest pressure is below this part of the scale, the scale shrinks so much
# in time, below this part of the scale it shrinks to so many times that pressure, but not faster than this in a step
MILD, MILDER, SLOWLY = 1 / 60, 15.0, 0.1
CAPACITY = 2.7  # energy of a barrier at a twentieth of its range, in parts of scale times range
# parts of an increment that are tried until so much of what is to stay in touch does
COMING_OFF, KEPT = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02), 0.95
NUDGE = 1e-3  # of the smallest gap or range: how far parts move to see how forces change


class Approach:
    """Feasible iterates of one model with contact."""

    def __init__(self, model: Model) -> None:
        self.model, self.terms = model, model.contacts

    def begin(self, state: State) -> State:
        """The state with an empty memory, everything at rest as it lies. SceneError if something overlaps."""
        touch = {term: term.start(self.model.space) for term in self.terms}
        state = replace(state, contact=Contact(state.t, state.t, state.r, state.q, touch))
        faults = [fault for term in self.terms for fault in term.overlaps(state, self.model.space)]
        if faults:
            raise SceneError(faults)
        return state

    def knows(self, state: State) -> bool:
        """True if a state has a memory of this model's contact."""
        return state.contact is not None and set(state.contact.touch) == set(self.terms)

    def move(
        self, state: State, du: np.ndarray, scale: float, *, stiffen: bool = True, keep: bool = False
    ) -> tuple[State, float]:
        """The state after as much of the increment scale * du (N, 6) as gaps allow, with parts moved along; and how much.

        stiffen: pressure scales may grow; not in time, where that would add energy. keep: what is to stay in touch does.
        Returns 0 and the state itself if there is no way forward.
        """
        space, least = self.model.space, SMALLEST * scale
        trial = self._after(state, du, scale)
        scale *= min(term.largest_step(state, trial, space) for term in self.terms)
        if keep:
            scale = self._kept_on(state, du, scale)
        while scale > least:
            trial = self._after(state, du, scale)
            if all(term.clear(state, trial, space) for term in self.terms):
                return self._stiffened(trial) if stiffen else trial, scale
            scale *= 0.5
        return state, 0.0

    def _kept_on(self, state: State, du: np.ndarray, scale: float) -> float:
        """The part of an increment on which what is to stay in touch does so, if a shorter one is enough.

        An increment along a round part is a tangent of it, and leaves it: nothing then holds the rod, and the next one goes
        astray. What leaves by the increment itself, as if surfaces were flat, may go.
        """
        space = self.model.space
        terms = [term for term in self.terms if term.touched(state, space) > 0.0]
        for part in COMING_OFF if terms else ():
            trial = self._after(state, du, part * scale)
            if all(term.touched(trial, space) >= KEPT * term.stays(state, trial, space) for term in terms):
                return part * scale
        return scale

    def _stiffened(self, state: State) -> State:
        """The state with a larger pressure scale for terms whose gap is a small part of their range.

        There the barrier is nearly singular: the Newton method gains a decade of pressure in an iteration, and the Gauss
        points do not see the peak.
        """
        contact: Contact = state.contact  # type: ignore[assignment]
        touch = {
            term: replace(memory, scale=memory.scale * STIFFER)
            for term, memory in contact.touch.items()
            if term.gap(state, self.model.space) < NEARLY_SHUT * term.range
        }
        return replace(state, contact=replace(contact, touch=contact.touch | touch)) if touch else state

    def _after(self, state: State, du: np.ndarray, scale: float) -> State:
        contact: Contact = state.contact  # type: ignore[assignment]
        time = state.t if scale == 1.0 else contact.time + scale * (state.t - contact.time)
        return replace(self.model.space.update(state, du, scale), contact=replace(contact, time=time))

    def arrived(self, state: State) -> bool:
        """True if parts stand where they are at the state's time."""
        return state.contact is not None and state.contact.time == state.t

    def change(self, state: State) -> np.ndarray | None:
        """Change of the residual (N, 6) while parts go on to the state's time; None if nothing changes."""
        contact: Contact = state.contact  # type: ignore[assignment]
        sweep = self._sweep(state, contact.time)
        if sweep == 0.0:
            return None
        space = self.model.space
        gap = min(min(term.gap(state, space), term.range) for term in self.terms)
        part = min(1.0, NUDGE * gap / sweep)
        moved = replace(state, contact=replace(contact, time=contact.time + part * (state.t - contact.time)))
        return (self.model.touching(moved) - self.model.touching(state)) / part

    def blocked(self, state: State) -> str:
        """Why there is no way forward: which gap is the smallest."""
        term = min(self.terms, key=lambda term: term.gap(state, self.model.space))
        return f"no way forward is left between {term.between}"

    def _sweep(self, state: State, time: float) -> float:
        """How far the parts that may be touched move past the rods from `time` to the state's time [m]."""
        farthest = 0.0
        for part in {term.part for term in self.terms if hasattr(term, "part")}:
            (R, c), (R1, c1) = part.pose(time), part.pose(state.t)
            moved = ((state.r - c) @ R) @ R1.T + c1 - state.r
            farthest = max(farthest, float(np.sqrt((moved * moved).sum(axis=1).max())))
        return farthest

    def harden(self, state: State, energy: float) -> State:
        """The state with pressure scales that can take up an energy [J] on a short stretch of rod; nothing may touch yet."""
        contact: Contact = state.contact  # type: ignore[assignment]
        touch = {
            term: replace(memory, scale=max(memory.scale, energy / (CAPACITY * term.range * term.shortest)))
            for term, memory in contact.touch.items()
        }
        return replace(state, contact=replace(contact, touch=touch))

    def overrun(self, state: State) -> bool:
        """True if a gap is a small part of the range of its barrier."""
        return any(term.gap(state, self.model.space) < NEARLY_SHUT * term.range for term in self.terms)

    def brace(self, state: State, energy: float) -> State:
        """As `harden`, while something touches: that is lifted, by less than the range, so that it is pressed as before."""
        contact: Contact = state.contact  # type: ignore[assignment]
        space, r, touch = self.model.space, state.r.copy(), {}
        for term, memory in contact.touch.items():
            scale = energy / (CAPACITY * term.range * term.shortest)
            if scale > 2.0 * memory.scale:  # less is not worth it
                touch[term] = replace(memory, scale=scale)
                r += term.lift(state, space, scale / memory.scale)
        contact = replace(contact, base_r=r, touch=contact.touch | touch)
        braced = replace(state, r=r, contact=contact)
        if not touch or not all(term.clear(state, braced, space) for term in self.terms):
            return state
        return replace(braced, stress=self.model.internal.with_stress(braced, space))

    def relax(self, state: State, pressed: tuple[Pressed, ...]) -> State:
        """The state with pressure scales that fit what is pressed now, long after an impact: for steps in time that fail.

        A scale for a hard impact leaves what rubs a thousandth of the range of the barrier: of an increment along a curved
        rod then little can be taken. It shrinks while something touches, so energy stored in the barrier is lost. Not
        without need, since the rod sinks a little: what friction just holds may slip.
        """
        contact: Contact = state.contact  # type: ignore[assignment]
        touch = {
            term: replace(memory, scale=max(MILDER * told.peak, SLOWLY * memory.scale))
            for term, told in zip(self.terms, pressed, strict=True)
            if 0.0 < told.peak < MILD * (memory := contact.touch[term]).scale
        }
        return replace(state, contact=replace(contact, touch=contact.touch | touch)) if touch else state

    def accept(self, state: State, *, soften: bool = True) -> tuple[State, tuple[Pressed, ...]]:
        """The state with its memory renewed, and what contact does there. soften: pressure scales may shrink."""
        space = self.model.space
        both = [term.accept(state, space) for term in self.terms]
        touch = {term: memory for term, (memory, _) in zip(self.terms, both, strict=True)}
        for term, (memory, told) in zip(self.terms, both, strict=True):
            if soften and 0.0 < told.peak < SOFT * memory.scale:
                touch[term] = replace(memory, scale=FIRM * memory.scale)
        contact = Contact(state.t, state.t, state.r, state.q, touch)
        return replace(state, contact=contact), tuple(told for _, told in both)
