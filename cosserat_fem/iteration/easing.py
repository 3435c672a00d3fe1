"""Where do rods touch, if the Newton method finds no way to it? A soft barrier first, then one as hard as it is meant.

Rule: the barrier of a contact term is a few thousandths of a radius deep, so that surfaces are where they should be. Far
from equilibrium that is too little room: an increment that lays a rod down, or peels it off, is cut where the first gap
closes, the next one at its neighbour, and no way is left. So the barrier is made deep, half a radius towards the
centreline, with the same place at which it begins; equilibrium with it is found in one go. Then its range is made as small
as the rod lies deep in it, with a pressure FIRMNESS times the largest, by which the rod comes to lie higher in it, and so
on: each range is a fraction of the one before, and each equilibrium is the start of the next. The last one is that of the
terms themselves. That is the path that interior-point methods follow (Nocedal and Wright 2006, Numerical Optimization,
ch. 19), with the range in the place of their parameter.

Friction is there all along, since the last accepted state: what holds by friction alone would fly away without. What it
remembers of earlier states counts in the last equilibrium only; it belongs to places, and soft rods have others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..space import Contact, State
from .newton import Newton, Solved

DEEP = 0.5  # radii: range of the barrier to begin with
# pressure scale in parts of the largest pressure: to begin with, in what follows, of the terms themselves
FIRST, FIRMNESS, LAST = 0.3, 15.0, 3.0
ROOM = 0.7  # part of a new range that the rod may lie deep in it
STEEP = 0.1  # least part of a range that the next one is
SINKS = 0.9  # a rod that a stiffer barrier does not lift by so much is held down by something rigid
MOST = 30  # equilibria
# the first one, if none is found, with a pressure scale so many times as large: the load may be far from what was thought
FIRMER, TRIES = 30.0, 3


def eased(newton: Newton, state: State) -> Solved:
    """Equilibrium at the time of a state without overlap, by way of soft contact; newton: of a model with contact."""
    model, approach, contact = newton.model, newton.approach, state.contact
    if approach is None or contact is None:
        raise ValueError("easing: the model has no contact.")
    terms = model.contacts
    pressed = approach.accept(state)[1]
    scales = {
        term: FIRST * told.peak or contact.touch[term].scale / FIRMNESS
        for term, told in zip(terms, pressed, strict=True)
    }
    part, depth, stuck, iterations = DEEP, 1.0, 0, 0
    softened: list[Any] = []
    tries: list[Solved] = []
    now = replace(state.at_time(contact.time), contact=None)
    try:
        for _ in range(MOST):
            soft = {term: replace(term.widened(part), pressure=scales[term]) for term in terms}
            softened += soft.values()
            other = newton.on(model.with_terms([soft.get(term, term) for term in model.terms]))
            other.model.spent = model.spent
            solved = other.settled(_begun(other, now, state, contact))
            iterations += solved.iterations
            if not solved.converged and part == DEEP and len(tries) < TRIES:
                tries.append(solved)
                scales = {term: FIRMER * scale for term, scale in scales.items()}
                continue
            if not solved.converged:
                failed = tries[0] if part == DEEP and tries else solved
                return replace(failed, state=state, iterations=iterations)
            now = replace(solved.state, contact=None)
            pressed = other.approach.accept(solved.state)[1]  # type: ignore[union-attr]
            scales = {term: max(FIRMNESS * told.peak, scales[term]) for term, told in zip(terms, pressed, strict=True)}
            deepest = max(part * _depth(solved.state, other, term) for term in soft.values())
            stuck = stuck + 1 if deepest > SINKS * depth else 0
            if stuck == 2:
                return replace(solved, state=state, iterations=iterations, reason=approach.blocked(state))
            depth = min(depth, deepest)
            if deepest > ROOM * part:
                continue
            part = max(deepest / ROOM, STEEP * part)
            if all(term.widened(part).range == term.range for term in terms):
                break
        else:
            return replace(solved, state=state, iterations=iterations, reason=approach.blocked(state))
        touch = {
            term: replace(contact.touch[term], scale=max(contact.touch[term].scale, scales[term] * LAST / FIRMNESS))
            for term in terms
        }
        solved = newton.plain(replace(now, contact=replace(contact, time=state.t, touch=touch)))
        return replace(solved, iterations=iterations + solved.iterations)
    finally:
        for term in softened:
            model.space.forget(term)


def _begun(newton: Newton, now: State, state: State, contact: Contact) -> State:
    """A state with soft contact, on its way to the time of `state`, with slips since the last accepted state."""
    begun = newton.approach.begin(now)  # type: ignore[union-attr]
    memory: Contact = begun.contact  # type: ignore[assignment]
    memory = replace(memory, base_time=contact.base_time, base_r=contact.base_r, base_q=contact.base_q)
    return replace(begun.at_time(state.t), contact=memory)


def _depth(state: State, newton: Newton, term: Any) -> float:
    """How deep rods lie in the barrier of a term, in parts of its range."""
    return float(max(0.0, 1.0 - term.gap(state, newton.model.space) / term.range))
