"""How is one nonlinear system solved? The mixed-integration-point Newton method, plain and guarded.

Rule: an iteration is: sum of terms, linear system, new stress memory, new state. Convergence is judged on the true
residual (with the stresses of the current strains, never the memory) on the free unknowns, relative to the section
forces and moments in the rods, and on the gaps of the supports. The floors are the round-off of the strains, so the
same digits come out in mm and in m. A residual a little above its floor counts when another step did not lower it, or
when the last increment was so small that another could not: at rest the square of TINY is round-off.

`plain` takes full steps. `guarded` adds mu * shift to the matrix until it has no negative eigenvalue, and shortens a
step in which a node would turn by more than 0.8 rad: it goes downhill in energy and ends in a stable state, so it must
not be used where the wanted state is unstable. The residual is untouched by mu, and so is the solution. Far away it leaves
out what contact takes from the stiffness by its curvature; close by it does not, or the last digits would creep.

With contact, of an increment only what gaps allow is taken, and far from equilibrium the residual of the mixed method rises
meanwhile: it has strains that the memory has not. What falls is the increment, by the part that was taken, as along the
curve dx/ds = -K^-1 g that a Newton method follows (Deuflhard 2011, Newton Methods for Nonlinear Problems, 3.1). So either
is progress, a residual of half or a smaller increment; without any for long a plain solve is given up, and soon if
increments grow instead.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from time import thread_time

import numpy as np

from ..constraint import Held, Targets
from ..errors import KardanError
from ..kernels.nodes import largest_increment, largest_residual
from ..model import Model, Step, Sum
from ..record import Counters
from ..space import State
from ..terms.touch import Pressed
from .barrier import Approach
from .compiled import Answer, Compiled, takes
from .linear import LinearSolver

RESIDUAL = 1e-11  # relative
ROUND_OFF = 2 * np.finfo(float).eps
STAGNANT = 32.0  # residual in units of the tolerance, accepted when a small step no longer halves it
# an increment [rad, rod lengths] after which only round-off is left, if the residual fell by so much
TINY, FELL = 1e-8, 1e-3
LINEAR = "linear systems"  # where CPU time is booked besides terms
NO_REACTIONS = np.empty((0, 6))
LARGEST_TURN = 0.8  # rad in one guarded step
FARTHEST = 0.2  # rod lengths in one step with contact
SHORT = 0.05  # part of a guarded step; one cut to less was a bad one, and the shift grows
PATIENCE, SHORTER = 4, (1.0, 0.5, 0.25, 0.1, 0.03)  # iterations without progress; parts of a step then tried
# of a plain solve, without contact, with it at rest and in time, where a shorter step costs less; and of a guarded one
ITERATIONS, TOUCHING, HITTING, GUARDED = 20, 60, 20, 150
HOPELESS = 20, 10  # iterations of a plain solve with contact, at rest and in time, that do not halve the residual
SMALLEST_SHIFT = 1e-6
# of the part of an increment that was taken, by which the next one must be smaller to be progress, at least as of a part of
# 0.02; times the smallest increment of a solve with contact: more is no way back
SHRINKS, LITTLE, GROWN = 0.5, 0.02, 10.0


@dataclass(frozen=True, eq=False)
class Solved:
    """Outcome of one Newton solve.

    state: last iterate; total: its residual; reactions (supports, 6); residual: relative; where: node of the largest
    residual; negative: negative eigenvalues of the last tangent, -1 if not known; reason: empty if converged; pressed:
    what contact does, once accepted; guarded: whether the guarded method found it.
    """

    state: State
    total: Sum
    reactions: np.ndarray
    residual: float
    where: int
    negative: int
    iterations: int
    reason: str = ""
    pressed: tuple[Pressed, ...] = ()
    guarded: bool = False

    @property
    def converged(self) -> bool:
        return not self.reason


class Newton:
    """Newton solver of one model, with its linear solver and counters."""

    def __init__(self, model: Model, *, compiled: bool = True) -> None:
        """compiled: False takes the loop over terms also for a model that has a compiled form."""
        self.model = model
        self.counters = Counters()
        self.approach = Approach(model) if model.contacts else None
        self.compiled = Compiled(model) if compiled and takes(model) else None

    @cached_property
    def linear(self) -> LinearSolver:
        """Linear solver of the loop over terms."""
        return LinearSolver(self.model.space, self.model.constraints)

    def on(self, model: Model) -> Newton:
        """The same solver, with its scratch and counters, on the same rods and supports under other loads."""
        other = copy(self)
        other.model = model
        other.approach = Approach(model) if model.contacts else None
        other.compiled = Compiled(model) if self.compiled is not None and takes(model) else None
        return other

    def plain(
        self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None, iterations: int = 0
    ) -> Solved:
        """Full steps. targets: of the supports, default those of the state's time; offset (N, 6): added to the residual."""
        if self.compiled is not None:
            most = iterations or ITERATIONS
            return self._told(self.compiled.solve(state, targets, offset, RESIDUAL, plain=most, guarded=0), RESIDUAL)
        return self._solve(state, targets, offset, iterations, guarded=False)

    def guarded(
        self,
        state: State,
        *,
        targets: Targets | None = None,
        offset: np.ndarray | None = None,
        iterations: int = GUARDED,
    ) -> Solved:
        """Shifted, rotation-limited steps towards a stable state."""
        if self.compiled is not None:
            return self._told(
                self.compiled.solve(state, targets, offset, RESIDUAL, plain=0, guarded=iterations), RESIDUAL
            )
        self.counters.guarded += 1
        return replace(self._solve(state, targets, offset, iterations, guarded=True), guarded=True)

    def settled(self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None) -> Solved:
        """`plain`; where that fails `guarded` from the same state."""
        if self.compiled is not None:
            answer = self.compiled.solve(state, targets, offset, RESIDUAL, plain=ITERATIONS, guarded=GUARDED)
            return self._told(answer, RESIDUAL)
        solved = self.plain(state, targets=targets, offset=offset)
        return solved if solved.converged else self.guarded(state, targets=targets, offset=offset)

    def accepted(self, solved: Solved, *, in_time: bool = False) -> Solved:
        """The same with the memory of contact renewed, as the start of what follows."""
        if self.approach is None:
            return solved
        state, pressed = self.approach.accept(solved.state, soften=not in_time)
        return replace(solved, state=state, pressed=pressed)

    def in_time(
        self, state: State, step: Step, tolerance: float, moved: np.ndarray, offset: np.ndarray | None = None
    ) -> Solved:
        """End of a time step, from a predicted state that has moved by `moved` (N, 3).

        tolerance: relative residual; offset (N, 6): added to the residual.
        """
        if self.compiled is not None:
            answer = self.compiled.step(state, moved, step, tolerance)  # type: ignore[arg-type]
            return self._told(answer, tolerance, in_time=True)
        return self._solve(state, None, offset, 0, guarded=False, step=step, tolerance=tolerance)

    def count(self, solves: int, checks: int) -> None:
        """Count what was done in compiled calls: linear systems, residual evaluations besides."""
        self.counters.iterations += solves
        self.counters.residuals += checks
        self.counters.linear["chain"] = self.counters.linear.get("chain", 0) + solves

    def _told(self, answer: Answer, tolerance: float, *, in_time: bool = False) -> Solved:
        """Count what a compiled solve did, and say it as the loop does."""
        self.count(answer.solves, answer.checks)
        self.counters.guarded += answer.guarded
        reactions = NO_REACTIONS if in_time else self.model.constraints.reactions(answer.state, answer.g)
        return Solved(
            answer.state, Sum(answer.g, 0.0, 0.0), reactions, tolerance * answer.residual, answer.where, answer.negative,
            answer.iterations, answer.reason, (), answer.guarded,
        )  # fmt: skip

    def _solve(
        self,
        state: State,
        targets: Targets | None,
        offset: np.ndarray | None,
        iterations: int,
        *,
        guarded: bool,
        step: Step | None = None,
        tolerance: float = RESIDUAL,
    ) -> Solved:
        model, constraints, approach = self.model, self.model.constraints, self.approach
        if not iterations:
            iterations = ITERATIONS if approach is None else TOUCHING if step is None else HITTING
        hopeless = HOPELESS[0] if step is None else HOPELESS[1]
        targets = targets or constraints.targets(state.t)
        mu = SMALLEST_SHIFT if guarded else 0.0
        moments = np.zeros((constraints.n_supports, 3)) if constraints.tilted else None
        negative, residual, before, where, k, cheap = -1, np.inf, np.inf, 0, 0, False
        symmetric = model.symmetric  # of the last tangent
        best, least, taken, stalled = np.inf, np.inf, 1.0, 0
        small = tiny = near = False  # the last increment; the one before the last factorisation
        total = Sum(np.zeros((model.space.n_nodes, 6)), 0.0, 0.0)

        def stop(reason: str = "") -> Solved:
            reactions = constraints.reactions(state, total.g)
            if not reason and not np.isfinite([total.force, total.moment]).all():
                reason = "the section forces are not finite numbers"
            if not reason and symmetric and step is None and (not near or negative > 0):
                return Solved(*self._count_again(state, targets, total, reactions, RESIDUAL * residual, where, k))
            return Solved(state, total, reactions, tolerance * residual, where, negative, k, reason)

        while True:
            if cheap:
                self.counters.residuals += 1
                total = model.residual(state, step=step)
                if offset is not None:
                    total.g[...] += offset
            else:
                extra = offset
                if approach is not None and not approach.arrived(state):
                    change = approach.change(state)
                    if step is not None and change is not None:
                        change *= step.push
                    extra = offset if change is None else change if offset is None else offset + change
                total = model.condensed(
                    state, self.linear.scratch, mu, extra, step=step, exact=not guarded or (small and mu <= SMALLEST_SHIFT),
                )  # fmt: skip
            if constraints.tilted:
                moments = constraints.reactions(state, total.g)[:, 3:]
            held = constraints.evaluate(state, targets, moments)
            residual, where = self.measure(state, total, held, step, tolerance)
            if not residual < np.inf:
                return stop("the residual is not a finite number")
            stays = (small and residual > 0.5 * before) or (tiny and residual < FELL * before)
            met = residual <= 1.0 or (stays and residual <= STAGNANT)
            reached = k > 0 and met and self.closed(held) and (approach is None or approach.arrived(state))
            if reached:
                return stop()
            if cheap:
                cheap = False
                continue
            if k == iterations:
                return stop(f"no convergence within {iterations} iterations")
            near = small and mu <= SMALLEST_SHIFT  # stability counts only without the shift
            symmetric = total.symmetric
            since = thread_time()
            solution = self.linear.solve(state, total.g, held, total.negative, symmetric, total.whole)
            model.spend(LINEAR, since)
            self.counters.iterations += 1
            self.counters.linear[solution.method] = self.counters.linear.get(solution.method, 0) + 1
            bad = solution.singular >= 0
            if guarded and (bad or solution.negative > 0):
                if mu > 1e12:
                    return stop("the tangent stays indefinite")
                mu = max(1.0, 4.0 * mu)
                continue
            if bad:
                return stop("the tangent is singular")
            negative, du = solution.negative, solution.du
            shift, turn, _ = largest_increment(du)
            limited = guarded or approach is not None
            scale = min(1.0, LARGEST_TURN / turn) if limited and turn > 0 else 1.0
            if not limited and turn > (np.inf, 2.0, 2.0, 1.0)[min(k, 3)]:  # no solve that converged turned more
                return stop("the iteration diverges")
            since = thread_time()
            stress = model.internal.extrapolate(state, model.space, du, 1.0, step.tables if step else None)
            model.spend(model.internal.name, since)
            try:
                if approach is None:
                    moved = model.space.update(state, du, scale)
                else:
                    scale = min(scale, FARTHEST * model.scales["length"] / max(shift, 1e-300))
                    size = max(turn, shift / model.scales["length"])
                    smaller = step is None and size <= (1.0 - SHRINKS * max(taken, LITTLE)) * least
                    gained = smaller or residual <= 0.5 * best
                    stalled = 0 if gained else stalled + 1
                    best = min(best, residual) if approach.arrived(state) else np.inf
                    least = min(least, size) if approach.arrived(state) else np.inf
                    if stalled > PATIENCE and size > GROWN * least and not guarded and step is None:
                        return stop("the increments grow")
                    if stalled > hopeless and not guarded:
                        return stop(f"no progress in {hopeless} iterations")
                    if stalled > PATIENCE:  # friction that sticks and slips in turn
                        scale *= self._downhill(state, du, scale, targets, offset, step, tolerance, residual)
                    rests = step is None
                    moved, scale = approach.move(state, du, scale, stiffen=rests, keep=rests and not guarded)
                    if scale == 0.0:
                        return stop(approach.blocked(state))
                    if guarded and scale < SHORT:
                        mu = max(1.0, 4.0 * mu)
                        if mu > 1e12:
                            return stop(approach.blocked(state))
            except KardanError as error:
                return stop(str(error))
            if scale < 1.0:  # the memory is an unknown of the mixed method: it takes the same part of its step
                stress = tuple((1 - scale) * a + scale * b for a, b in zip(state.stress, stress, strict=True))
            state = replace(moved, stress=stress)
            k, before, taken = k + 1, residual, scale
            small = turn < 1e-3 and shift < 1e-3 * model.scales["length"]
            tiny = step is None and approach is None and turn < TINY and shift < TINY * model.scales["length"]
            cheap = scale == 1.0 and small and mu <= SMALLEST_SHIFT
            if guarded and scale == 1.0:
                mu = mu / 4.0 if mu >= 4e-3 else SMALLEST_SHIFT

    def _downhill(
        self, state: State, du: np.ndarray, scale: float, targets: Targets, offset: np.ndarray | None,
        step: Step | None, tolerance: float, residual: float,
    ) -> float:  # fmt: skip
        """Part of an increment after which the residual is smaller; of SHORTER the last one if it never is."""
        part = 1.0
        for part in SHORTER:
            trial, taken = self.approach.move(state, du, part * scale, stiffen=False)  # type: ignore[union-attr]
            if taken == 0.0:
                break
            total = self.model.residual(trial, step=step)
            if offset is not None:
                total.g[...] += offset
            held = self.model.constraints.evaluate(trial, targets)
            if self.measure(trial, total, held, step, tolerance)[0] < residual * (1.0 - 0.1 * part):
                break
        return part

    def response(self, state: State, load: np.ndarray, *, step: Step | None = None) -> np.ndarray:
        """Increment du (N, 6) of the linearised model under a load (N, 6), supports standing still."""
        model = self.model
        held = model.constraints.evaluate(state, model.constraints.targets(state.t))
        held = replace(held, gap=np.zeros_like(held.gap))
        mu = 0.0 if step is not None else SMALLEST_SHIFT
        residual = model.residual(state, step=step).g
        total = model.condensed(state, self.linear.scratch, mu, -residual - load, step=step)
        return self.linear.solve(state, total.g, held, total.negative, total.symmetric, total.whole).du.copy()

    def _count_again(
        self, state: State, targets: Targets, total: Sum, reactions: np.ndarray, residual: float, where: int, k: int
    ) -> tuple:
        """Fields of a converged Solved with the negative eigenvalues of the tangent at the state itself.

        Needed when few iterations were made: the last factorisation then had stresses of a state further away. The least
        shift keeps a neutral motion (a loop that turns freely about its ends) from counting by its round-off.
        """
        state = replace(state, stress=self.model.internal.with_stress(state, self.model.space))
        again = self.model.condensed(state, self.linear.scratch, SMALLEST_SHIFT, None)
        held = self.model.constraints.evaluate(state, targets, reactions[:, 3:])
        solution = self.linear.solve(state, again.g, held, again.negative, again.symmetric, again.whole)
        return state, total, reactions, residual, where, solution.negative if solution.singular < 0 else -1, k

    def measure(self, state: State, total: Sum, held: Held, step: Step | None, tolerance: float) -> tuple[float, int]:
        """Residual on the free unknowns in units of the tolerance (1 = converged), and the node of the largest."""
        s = self.model.scales
        force = max(total.force, total.moment / s["length"])
        moment = max(total.moment, total.force * s["element"])
        noise = ROUND_OFF * s["axial"] * s["size"] / s["smallest"]
        noise += 4.0 * ROUND_OFF * total.stiffest * s["size"]  # a gap is a difference of places
        force_limit = tolerance * force + noise
        moment_limit = tolerance * moment + noise * s["element"] + ROUND_OFF * s["bending"] / s["smallest"]
        if step is not None:  # round-off of the increment, as an inertia force
            force_limit += ROUND_OFF * step.heaviest[0] * s["size"]
            moment_limit += ROUND_OFF * step.heaviest[1]
        c = self.model.constraints
        n = c.n_supports
        g = c.in_unknowns(state, total.g, held)
        return largest_residual(g, c.support_node, c.held[:n], force_limit, moment_limit)

    def closed(self, held: Held) -> bool:
        """True if the supports are met."""
        s = self.model.scales
        shift, turn, _ = largest_increment(held.gap)
        return shift <= 1e-12 * s["size"] and turn <= 1e-11
