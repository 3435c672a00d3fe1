"""Would a planar equilibrium leave its plane?

Rule: a planar model has no unknown out of its plane, so it cannot tell. The tangent in space at a planar state splits into a
part in the plane and one out of it, and their negative eigenvalues add up; what the whole has more than the part in the
plane points out of it.
"""

from __future__ import annotations

from dataclasses import replace

from ..history import History
from ..iteration.linear import LinearSolver
from ..iteration.newton import SMALLEST_SHIFT, Newton
from ..model import Model
from ..space import State


def out_of_plane(model: Model, state: State) -> int | None:
    """Number of independent ways in which an equilibrium of a planar model would leave its plane, 0 if it stays.

    A neutral motion (a cable between two pins that spins about its chord) does not count. None where a load has no potential
    in space (forces that follow, moments), which has no such number.

    Raises
    ------
    ValueError
        The model has no plane.
    """
    if model.plane is None:
        raise ValueError('out_of_plane: the model has no plane; make it with plane = "xy", "yz", "xz" or "auto".')
    if not model.symmetric:
        return None
    space = replace(state, stress=model.internal.with_stress(state, model.space))
    inside = Newton(model).plain(state)
    linear, constraints = LinearSolver(model.space, model.constraints), model.constraints
    total = model.condensed(space, linear.scratch, SMALLEST_SHIFT, None)
    targets = constraints.targets(state.t)
    held = constraints.evaluate(space, targets, constraints.reactions(space, total.g)[:, 3:])
    solution = linear.solve(space, total.g, held, total.negative, total.symmetric, total.whole)
    if solution.singular >= 0 or solution.negative < 0 or inside.negative < 0:
        return None
    return solution.negative - inside.negative


def leaves_plane(history: History) -> list[int | None]:
    """`out_of_plane` of every state of a history."""
    return [out_of_plane(history.model, record.state) for record in history.records]
