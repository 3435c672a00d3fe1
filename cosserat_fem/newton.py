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

from dataclasses import dataclass, field, replace

import numpy as np

from .constraint import Held, Targets
from .errors import KardanError
from .kernels.nodes import largest_increment, largest_residual
from .linear import LinearSolver
from .model import Model, Sum
from .space import State

RESIDUAL = 1e-11  # relative
ROUND_OFF = 2 * np.finfo(float).eps
STAGNANT = 32.0  # residual in units of the tolerance, accepted when a small step no longer halves it
LARGEST_TURN = 0.8  # rad in one guarded step
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
    residual; negative: negative eigenvalues of the last tangent, -1 if not known; reason: empty if converged.
    """

    state: State
    total: Sum
    reactions: np.ndarray
    residual: float
    where: int
    negative: int
    iterations: int
    reason: str = ""

    @property
    def converged(self) -> bool:
        return not self.reason


class Newton:
    """Newton solver of one model, with its linear solver and counters."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.linear = LinearSolver(model.space, model.constraints)
        self.counters = Counters()

    def plain(
        self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None, iterations: int = 20
    ) -> Solved:
        """Full steps. targets: of the supports, default those of the state's time; offset (N, 6): added to the residual."""
        return self._solve(state, targets, offset, iterations, guarded=False)

    def guarded(
        self, state: State, *, targets: Targets | None = None, offset: np.ndarray | None = None, iterations: int = 150
    ) -> Solved:
        """Shifted, rotation-limited steps towards a stable state."""
        self.counters.guarded += 1
        return self._solve(state, targets, offset, iterations, guarded=True)

    def _solve(
        self, state: State, targets: Targets | None, offset: np.ndarray | None, iterations: int, *, guarded: bool
    ) -> Solved:
        model, constraints = self.model, self.model.constraints
        targets = targets or constraints.targets(state.t)
        mu = SMALLEST_SHIFT if guarded else 0.0
        moments = np.zeros((constraints.n_supports, 3)) if constraints.tilted else None
        negative, residual, before, where, k, cheap = -1, np.inf, np.inf, 0, 0, False
        small = near = False  # the last increment; the one before the last factorisation
        total = Sum(np.zeros((model.space.n_nodes, 6)), 0.0, 0.0)

        def stop(reason: str = "") -> Solved:
            reactions = constraints.reactions(state, total.g)
            if not reason and not near and model.symmetric:
                return Solved(*self._count_again(state, targets, total, reactions, RESIDUAL * residual, where, k))
            return Solved(state, total, reactions, RESIDUAL * residual, where, negative, k, reason)

        while True:
            if cheap:
                self.counters.residuals += 1
                total = model.residual(state)
                if offset is not None:
                    total.g[...] += offset
            else:
                total = model.condensed(state, self.linear.scratch, mu, offset)
            if constraints.tilted:
                moments = constraints.reactions(state, total.g)[:, 3:]
            held = constraints.evaluate(state, targets, moments)
            residual, where = self._measure(state, total, held)
            if not residual < np.inf:
                return stop("the residual is not finite")
            met = residual <= 1.0 or (small and 0.5 * before < residual <= STAGNANT)
            reached = k > 0 and met and self._gap_closed(held)
            if reached:
                return stop()
            if cheap:
                cheap = False
                continue
            if k == iterations:
                return stop(f"no convergence within {iterations} iterations")
            near = small and mu <= SMALLEST_SHIFT  # stability counts only without the shift
            solution = self.linear.solve(state, total.g, held, total.negative, model.symmetric)
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
            scale = min(1.0, LARGEST_TURN / turn) if guarded and turn > 0 else 1.0
            if not guarded and turn > (np.inf, 2.0, 2.0, 1.0)[min(k, 3)]:  # no solve that converged turned more
                return stop("the iteration diverges")
            stress = model.internal.extrapolate(state, model.space, du, 1.0)
            if scale < 1.0:  # the memory is an unknown of the mixed method: it takes the same part of its step
                stress = tuple((1 - scale) * a + scale * b for a, b in zip(state.stress, stress, strict=True))
            try:
                state = model.space.update(state, du, scale, stress)
            except KardanError as error:
                return stop(str(error))
            k, before = k + 1, residual
            small = turn < 1e-3 and shift < 1e-3 * model.scales["length"]
            cheap = scale == 1.0 and small and mu <= SMALLEST_SHIFT
            if guarded and scale == 1.0:
                mu = mu / 4.0 if mu >= 4e-3 else SMALLEST_SHIFT

    def _count_again(
        self, state: State, targets: Targets, total: Sum, reactions: np.ndarray, residual: float, where: int, k: int
    ) -> tuple:
        """Fields of a converged Solved with the negative eigenvalues of the tangent at the state itself.

        Needed when few iterations were made: the last factorisation then had stresses of a state further away.
        """
        state = replace(state, stress=self.model.internal.with_stress(state, self.model.space))
        again = self.model.condensed(state, self.linear.scratch, 0.0, None)
        held = self.model.constraints.evaluate(state, targets, reactions[:, 3:])
        solution = self.linear.solve(state, again.g, held, again.negative, True)
        return state, total, reactions, residual, where, solution.negative if solution.singular < 0 else -1, k

    def _measure(self, state: State, total: Sum, held: Held) -> tuple[float, int]:
        """Residual on the free unknowns in units of the tolerance (1 = converged), and the node of the largest."""
        s = self.model.scales
        force = max(total.force, total.moment / s["length"])
        moment = max(total.moment, total.force * s["element"])
        noise = ROUND_OFF * s["axial"] * s["size"] / s["smallest"]
        force_limit = RESIDUAL * force + noise
        moment_limit = RESIDUAL * moment + noise * s["element"] + ROUND_OFF * s["bending"] / s["smallest"]
        c = self.model.constraints
        n = c.n_supports
        g = c.in_unknowns(state, total.g, held)
        return largest_residual(g, c.support_node, c.held[:n], force_limit, moment_limit)

    def _gap_closed(self, held: Held) -> bool:
        s = self.model.scales
        shift, turn, _ = largest_increment(held.gap)
        return shift <= 1e-12 * s["size"] and turn <= 1e-11
