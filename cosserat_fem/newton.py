"""How is one nonlinear system solved? The mixed-integration-point Newton method, plain and guarded.

Rule: an iteration is: sum of terms, linear system, new stress memory, new state. Convergence is judged on the true
residual (with the stresses of the current strains, never the memory) on the free unknowns, relative to the section
forces and moments in the rods, and on the gaps of the supports. The floors are the round-off of the strains, so the
same digits come out in mm and in m. A residual a little above its floor counts when another step did not lower it.

`plain` takes full steps. `guarded` adds mu * shift to the matrix until it has no negative eigenvalue, and shortens a
step in which a node would turn by more than 0.8 rad: it goes downhill in energy and ends in a stable state, so it must
not be used where the wanted state is unstable. The residual is untouched by mu, and so is the solution.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from time import thread_time
from typing import Any

import numpy as np

from .barrier import Approach
from .constraint import Held, Targets
from .errors import KardanError
from .kernels.nodes import largest_increment, largest_residual
from .kernels.step import newton_step
from .linear import LinearSolver
from .model import Model, Step, Sum
from .space import State
from .terms.external import NO_LOADS
from .terms.inertial import Driven, InertiaStep
from .terms.internal import QuaternionBeam
from .terms.touch import Pressed

RESIDUAL = 1e-11  # relative
ROUND_OFF = 2 * np.finfo(float).eps
STAGNANT = 32.0  # residual in units of the tolerance, accepted when a small step no longer halves it
LINEAR, COMPILED = "linear systems", "compiled time steps"  # where CPU time is booked besides terms
NO_REACTIONS = np.empty((0, 6))
NO_PLACES = (np.empty((0, 3)), np.empty((0, 4)))
LARGEST_TURN = 0.8  # rad in one guarded step
FARTHEST = 0.2  # rod lengths in one step with contact
SHORT = 0.05  # part of a guarded step; one cut to less was a bad one, and the shift grows
PATIENCE, SHORTER = 4, (1.0, 0.5, 0.25, 0.1, 0.03)  # iterations without progress; parts of a step then tried
ITERATIONS, TOUCHING = 20, 60  # of a plain solve, without and with contact
SMALLEST_SHIFT = 1e-6


@dataclass
class Counters:
    """What the solver did."""

    iterations: int = 0
    residuals: int = 0
    guarded: int = 0
    load_steps: int = 0
    bisections: int = 0
    linear: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Solved:
    """Outcome of one Newton solve.

    state: last iterate; total: its residual; reactions (supports, 6); residual: relative; where: node of the largest
    residual; negative: negative eigenvalues of the last tangent, -1 if not known; reason: empty if converged; pressed:
    what contact does, once accepted.
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

    @property
    def converged(self) -> bool:
        return not self.reason


class Newton:
    """Newton solver of one model, with its linear solver and counters."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.linear = LinearSolver(model.space, model.constraints)
        self.counters = Counters()
        self.approach = Approach(model) if model.contacts else None

    def on(self, model: Model) -> Newton:
        """The same solver, with its scratch and counters, on the same rods and supports under other loads."""
        other = copy(self)
        other.model = model
        return other

    def plain(
        self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None, iterations: int = 0
    ) -> Solved:
        """Full steps. targets: of the supports, default those of the state's time; offset (N, 6): added to the residual."""
        return self._solve(state, targets, offset, iterations, guarded=False)

    def guarded(
        self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None, iterations: int = 150
    ) -> Solved:
        """Shifted, rotation-limited steps towards a stable state."""
        self.counters.guarded += 1
        return self._solve(state, targets, offset, iterations, guarded=True)

    def accepted(self, solved: Solved, *, in_time: bool = False) -> Solved:
        """The same with the memory of contact renewed, as the start of what follows."""
        if self.approach is None:
            return solved
        state, pressed = self.approach.accept(solved.state, soften=not in_time)
        return replace(solved, state=state, pressed=pressed)

    def in_time(self, state: State, step: Step, tolerance: float, offset: np.ndarray | None = None) -> Solved:
        """End of a time step, from a predicted state. tolerance: relative residual; offset (N, 6): added to it."""
        return self._solve(state, None, offset, 0, guarded=False, step=step, tolerance=tolerance)

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
        iterations = iterations or (ITERATIONS if approach is None else TOUCHING)
        targets = targets or constraints.targets(state.t)
        mu = SMALLEST_SHIFT if guarded else 0.0
        moments = np.zeros((constraints.n_supports, 3)) if constraints.tilted else None
        negative, residual, before, where, k, cheap = -1, np.inf, np.inf, 0, 0, False
        symmetric = model.symmetric  # of the last tangent
        best, stalled = np.inf, 0
        small = near = False  # the last increment; the one before the last factorisation
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
                    state, self.linear.scratch, mu, extra, step=step, exact=not guarded
                )  # fmt: skip
            if constraints.tilted:
                moments = constraints.reactions(state, total.g)[:, 3:]
            held = constraints.evaluate(state, targets, moments)
            residual, where = self.measure(state, total, held, step, tolerance)
            if not residual < np.inf:
                return stop("the residual is not a finite number")
            met = residual <= 1.0 or (small and 0.5 * before < residual <= STAGNANT)
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
            solution = self.linear.solve(state, total.g, held, total.negative, symmetric, total.matrix)
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
                    stalled = stalled + 1 if residual > 0.5 * best else 0
                    best = min(best, residual) if approach.arrived(state) else np.inf
                    if stalled > PATIENCE:  # friction that sticks and slips in turn
                        scale *= self._downhill(state, du, scale, targets, offset, step, tolerance, residual)
                    moved, scale = approach.move(state, du, scale, stiffen=step is None)
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
            k, before = k + 1, residual
            small = turn < 1e-3 and shift < 1e-3 * model.scales["length"]
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
        return self.linear.solve(state, total.g, held, total.negative, total.symmetric, total.matrix).du.copy()

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
        solution = self.linear.solve(state, again.g, held, again.negative, again.symmetric, again.matrix)
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


class CompiledStep:
    """`Newton.in_time` as one compiled loop, for models that are simple enough; see `kernels.step`."""

    REASONS = ("", "the residual is not a finite number", "no convergence", "the tangent is singular", "it diverges")

    def __init__(self, newton: Newton, tolerance: float) -> None:
        self.newton, self.model, self.tolerance = newton, newton.model, tolerance
        space, c, linear = self.model.space, self.model.constraints, newton.linear
        (group,) = space.groups
        n = c.n_supports
        self.group = group
        scratch = linear.scratch[0]
        self.linear = (
            scratch.S, scratch.rhs, scratch.factor, linear.segments, linear.kept, linear.joint_S, linear.joint_rhs
        )  # fmt: skip
        self.held = (c.support_node, c.left[:n], c.right[:n], c.held[:n], c.owner[:n])
        self.nodal, self.du = np.empty((space.n_nodes, 6, 6)), np.empty((space.n_nodes, 6))
        self.R, self.each = np.empty((space.n_nodes, 3, 3)), np.empty((0, 6))

    @staticmethod
    def takes(model: Model) -> bool:
        """True if the compiled loop knows everything in a model."""
        c = model.constraints
        simple = not c.transforms and not c.joints and len(model.space.groups) == 1
        return (
            simple
            and isinstance(model.internal, QuaternionBeam)
            and all(getattr(term, "tabulated", False) for term in model.terms)
        )

    def solve(self, guess: State, moved: np.ndarray, step: InertiaStep, driven: Driven) -> Solved:
        """End of a time step, from a predicted state that has moved by `moved` (N, 3); both are changed."""
        model, space = self.model, self.model.space
        places: Any = NO_PLACES
        if model.constraints.n_supports:
            targets = model.constraints.targets(guess.t)
            places = (targets.place, targets.quaternion)
        loads = [term.table(guess.t, space) for term in model.terms]  # type: ignore[attr-defined]
        loads = loads or [NO_LOADS]
        columns = ([getattr(load, name) for load in loads] for name in ("nodes", "force", "moment", "kinds"))
        table = tuple(column[0] if len(column) == 1 else np.concatenate(column) for column in columns)
        if len(self.each) != len(table[0]):
            self.each = np.empty((len(table[0]), 6))
        s = model.scales
        noise = ROUND_OFF * s["axial"] * s["size"] / s["smallest"]
        limits = (
            self.tolerance,
            s["length"],
            s["element"],
            noise + ROUND_OFF * step.heaviest[0] * s["size"],
            noise * s["element"] + ROUND_OFF * s["bending"] / s["smallest"] + ROUND_OFF * step.heaviest[1],
            1e-12 * s["size"],
            s["bending"] / s["element"],
        )
        start, rates = step.start, step.rates
        inertia = (
            space.node_mass, space.node_inertia, start.r, start.q, rates.v, rates.a, rates.b, step.coefficients,
            driven.nodes, driven.v, driven.a,
        )  # fmt: skip
        g = np.empty((space.n_nodes, 6))
        r, q, sigma = guess.r, guess.q, guess.stress[0]  # the guess is ours: it was made for this step
        tables = self.group.tables if step.tables is None else step.tables[0]
        since = thread_time()
        beam = (self.group.packed_conn, self.group.n_elements, self.group.N, *tables, space.owner)
        status, k, checks, residual, where = newton_step(
            beam, self.linear, (*self.held, *places), inertia, table, limits, 20, moved, r,
            q, sigma, (g, self.nodal, self.du, step.D, step.v, step.a, step.b, self.each, self.R),
        )  # fmt: skip
        model.spend(COMPILED, since)
        counters = self.newton.counters
        counters.iterations += k
        counters.residuals += checks
        counters.linear["chain"] = counters.linear.get("chain", 0) + k
        total = Sum(g, 0.0, 0.0)
        return Solved(guess, total, NO_REACTIONS, self.tolerance * residual, where, -1, k, self.REASONS[status])
