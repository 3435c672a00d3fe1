"""Which models are solved in one compiled call, and what goes into it?

Rule: where every term of a model has a compiled form, a whole Newton solve is one call of `kernels.step`, in space or in a
plane; the loop over terms in `newton` stays the general path, and a test holds both equal. States, loads and reactions are
always those in space: `border` turns them into the arrays of the kernel and back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import thread_time
from typing import Any, NamedTuple

import numpy as np

from ..constraint import Targets
from ..kernels.beam import LANES
from ..kernels.rest import keep, settle
from ..kernels.step import newton, run_steps
from ..model import Model
from ..space import State
from ..terms.external import NO_LOADS, NodalLoads
from ..terms.inertial import Driven, InertiaStep, Rates
from ..terms.internal import QuaternionBeam
from .border import NO_NODES, border

REASONS = (
    "", "the residual is not a finite number", "no convergence within {} iterations", "the tangent is singular",
    "the iteration diverges", "the tangent stays indefinite", "the section forces are not finite numbers",
)  # fmt: skip
NO_OFFSET, NO_MASS = np.empty((0, 0)), np.empty(0)
ROUND_OFF = 2 * np.finfo(float).eps
COMPILED = "compiled solves"  # where their CPU time is booked
STEPPING = (20, False, False, 1)  # of a step in time, as `kernels.step.newton` takes it: most iterations, not guarded


class Answer(NamedTuple):
    """What a call found: state, residual g (N, 6), iterations, solves, residual evaluations, residual in units of the
    tolerance and its node, negative eigenvalues or -1, reason (empty if converged), whether the guarded method found it."""

    state: State
    g: np.ndarray
    iterations: int
    solves: int
    checks: int
    residual: float
    where: int
    negative: int
    reason: str
    guarded: bool = False


@dataclass(frozen=True, eq=False)
class Moving:
    """A run in time between two steps: state, rates, residual g (N, 6), what each load adds (L, 6), length of the last step.

    Of one that was found also the work of each load and of the driven ends (L + 1,) since the start of the call, whether it
    is to be kept, and iterations and residual of its step.
    """

    state: State
    rates: Rates
    g: np.ndarray
    loads: np.ndarray
    h: float
    work: np.ndarray = field(default_factory=lambda: NO_MASS)
    keeps: bool = False
    iterations: int = 0
    residual: float = 0.0


def takes(model: Model) -> bool:
    """True if every term and support of a model has a compiled form."""
    c = model.constraints
    if model.plane is not None:
        return True
    simple = not c.transforms and not c.joints and len(model.space.groups) == 1
    simple = simple and isinstance(model.internal, QuaternionBeam)
    return simple and all(getattr(term, "tabulated", False) for term in model.terms)


class Shared:
    """Tables and scratch of a model for all its compiled solves.

    The scratch holds nothing between two calls, and a call is not interrupted by another thread: solves that alternate or
    run in threads may share it. What a caller asks for after a call stands in arrays of its own.
    """

    def __init__(self, model: Model) -> None:
        b = self.border = model.remember(border)
        d, N, E, M = len(b.size), model.space.n_nodes, b.group.n_elements, b.n_joints
        inner = d * (b.group.order - 1)
        n = inner + 2 * d
        self.linear = (
            np.empty((E, 2 * d, 2 * d)), np.empty((E, 2 * d)), np.empty((len(b.beam[0]), inner * (n + 1) * LANES)),
            b.segments, np.empty((b.n_vertices, d, 2 * d + 1 if M > 0 else d + 1)),
            np.empty((len(b.segments), 2 * d, 2 * d)), np.empty((len(b.segments), 2 * d)),
            b.joint_nodes, b.joint_index, np.empty((d * M, 2 * b.half + 1)), np.empty((M, d)),
        )  # fmt: skip
        self.nodal, self.du, self.gap = np.empty((N, d, d)), np.empty((N, d)), np.empty((len(b.rows[0]), d))
        self.R = np.empty((N, 3, 3) if d == 6 else (0, 3, 3))
        self.symmetric = b.symmetric
        s = model.scales
        noise = ROUND_OFF * s["axial"] * s["size"] / s["smallest"]
        self.noise = noise, noise * s["element"] + ROUND_OFF * s["bending"] / s["smallest"]
        self.scales = s["length"], s["element"], s["size"], s["bending"] / s["element"]
        self.limits = s["length"], s["element"], *self.noise, 1e-12 * s["size"], s["bending"] / s["element"]  # at rest
        self.steady = all(getattr(term, "steady", False) for term in model.terms)
        self.table: tuple[Any, np.ndarray] | None = None  # loads that never change, and their nodes
        r, q, sigma = b.take(model.initial_state())
        place, attitude = np.empty((2, len(model.supports), 2))
        self.kept = keep(
            (*b.beam, *b.tables, b.owner, b.shift), self.linear, b.rows, b.followers, b.frame,
            (self.nodal, self.du, self.R, self.gap, r, q, sigma, np.empty((N, d)), place, attitude),
        )  # fmt: skip


class Compiled:
    """Newton solves of one model, each in one compiled call. Of its own it has what the last call added: never shared."""

    def __init__(self, model: Model) -> None:
        self.model, self._shared = model, model.remember(Shared)
        shared = self._shared
        self.border, self.linear = shared.border, shared.linear
        self._nodal, self._du, self._gap, self._R = shared.nodal, shared.du, shared.gap, shared.R
        self._noise, self._scales = shared.noise, shared.scales
        self.each = np.empty((0, len(self.border.size)))
        self._table: tuple[Any, ...] | None = None
        self._nodes = NO_NODES

    def table(self, t: float) -> tuple[tuple[Any, ...], bool]:
        """All loads at a time, see `SpaceBorder.loads`."""
        if self._table is None:
            shared = self._shared
            table, self._nodes = shared.table or self._tabulate(t)
            if len(self.each) != len(self._nodes):
                self.each = np.empty((len(self._nodes), len(self.border.size)))
            if not shared.steady:
                return table
            shared.table = table, self._nodes
            self._table = table
        return self._table

    def _tabulate(self, t: float) -> tuple[tuple[tuple[Any, ...], bool], np.ndarray]:
        """Loads at a time as `SpaceBorder.loads` has them, and their nodes."""
        terms: Sequence[Any] = self.model.terms
        loads = [term.table(t, self.model.space) for term in terms] or [NO_LOADS]
        columns = ([getattr(load, name) for load in loads] for name in ("nodes", "force", "moment", "kinds"))
        whole = NodalLoads(*(column[0] if len(column) == 1 else np.concatenate(column) for column in columns))
        return self.border.loads(whole), whole.nodes

    @property
    def loads(self) -> np.ndarray:
        """What each load added to the residual at its node (L, 6) in the last call."""
        return self.border.in_space(self.each, self._nodes)

    def solve(
        self, state: State, targets: Targets | None, offset: np.ndarray | None, tolerance: float, *, plain: int,
        guarded: int,
    ) -> Answer:  # fmt: skip
        """Equilibrium from a state by the plain method; where that fails, or at once, by the guarded one.

        targets: of the supports, default those of its time; offset (N, 6): added to g; plain, guarded: most iterations of
        each method, 0 to leave it out.
        """
        b, shared = self.border, self._shared
        (table, tangent), places = self.table(state.t), b.places(state.t, targets)
        extra = NO_OFFSET if offset is None else b.rates(offset)
        r, q, stress, g = state.r.copy(), state.q.copy(), state.stress[0].copy(), np.empty((len(state.r), 6))
        since = thread_time()
        status, k, solves, checks, residual, where, negative, used = settle(
            b.size, *b.kind, shared.kept, places, (*table, tangent, self.each), extra,
            (tolerance, *shared.limits), (plain, guarded, shared.symmetric), r, q, stress, g,
        )  # fmt: skip
        self.model.spend(COMPILED, since)
        found = State(state.t, r, q, (stress,), None, state.velocity, state.slope)
        reason = REASONS[status].format(guarded if used else plain) if status else ""
        return Answer(found, g, k, solves, checks, residual, where, negative, reason, used)

    def step(self, guess: State, moved: np.ndarray, step: InertiaStep, tolerance: float) -> Answer:
        """End of a time step, from a predicted state that has moved by `moved` (N, 3); fills the rates of `step`."""
        b, old, driven = self.border, step.rates, step.driven
        at = b.take(guess)
        r0, q0, _ = b.take(step.start)
        inertia = (
            b.mass, b.J, r0, q0, b.rates(old.v), b.rates(old.a), b.rates(old.b), step.coefficients, driven.nodes,
            *b.driven(driven),
        )  # fmt: skip
        tables = b.tables if step.tables is None else b.project(step.tables[0])
        table, _ = self.table(guess.t)
        made = tuple(np.empty_like(inertia[4]) for _ in range(4))
        g, since = np.empty_like(self._du), thread_time()
        status, k, solves, checks, residual, where, negative = newton(
            b.size, *b.kind, (*b.beam, *tables, b.owner, b.shift), self.linear,
            (*b.rows, *b.holds(guess.t), *b.followers), inertia, table, NO_OFFSET,
            self._limits(tolerance, step.heaviest), STEPPING, b.flat(moved).copy(), *at,
            (g, self._nodal, self._du, *made, self.each, self._R, self._gap),
        )  # fmt: skip
        self.model.spend(COMPILED, since)
        for name, values in zip("Dvab", made, strict=True):
            setattr(step, name, b.in_space(values))
        reason = REASONS[status].format(STEPPING[0])
        return Answer(b.give(guess, *at), b.in_space(g), k, solves, checks, residual, where, negative, reason)

    def _limits(self, tolerance: float, heaviest: tuple[float, float]) -> tuple[float, ...]:
        """Limits as the kernel takes them; heaviest: largest change of a node's inertia force and moment."""
        force, moment = self._noise
        length, element, size, stiffness = self._scales
        return (
            tolerance, length, element, force + ROUND_OFF * heaviest[0] * size, moment + ROUND_OFF * heaviest[1],
            1e-12 * size, stiffness,
        )  # fmt: skip

    @property
    def runs(self) -> bool:
        """True if `run` takes the model: fully coupled sections in space are rare, and compiling takes half a minute."""
        return self.border.tables[3] is None

    def run(
        self, start: Moving, plan: list[tuple[float, float, bool]], method: tuple[float, ...], tolerance: float,
        driven: Callable[[float], Driven],
    ) -> tuple[int, tuple[int, int], list[Moving]]:  # fmt: skip
        """Steps in time one after the other in one call, as far as they converge.

        plan: time [s] at the end, length [s], whether to keep the state, of each step; method: am, af, beta, gamma of the
        integrator; driven: rates of held places at a time. Loads and supports are evaluated before the call.
        Returns how many were made, their iterations and residual evaluations, the kept states and the last one.
        """
        b, d = self.border, len(self.border.size)
        times, lengths = [t for t, _, _ in plan], np.array([h for _, h, _ in plan])
        keep = np.array([keeps for _, _, keeps in plan])
        loads, load_of = self._loads_at(times)
        places, place_of = self._places_at(times, driven)
        r, q, sigma = b.take(start.state)
        N, L, K = len(r), len(loads[0]), int(keep.sum()) + 1
        rates = [np.array(b.rates(getattr(start.rates, name))) for name in "vab"]
        forces = np.array(b.rates(start.loads, loads[0]))
        state = (r, q, sigma, *rates, np.array(b.rates(start.g)), forces)
        kept = (
            np.empty((K, *r.shape)), np.empty((K, *q.shape)), np.empty((K, *sigma.shape)), *np.empty((4, K, N, d)),
            np.empty((K, L + 1)), np.empty((K, 2)), np.empty(K, dtype=np.int64),
        )  # fmt: skip
        size = self._scales[2]
        inertia = (b.mass, b.J, ROUND_OFF * float(b.mass.max()) * size, ROUND_OFF * float(b.J.max()))
        scratch = (
            np.empty((N, d)), self._nodal, self._du, *np.empty((4, N, d)), np.empty((L, d)), self._R, self._gap,
            np.empty_like(r), np.empty_like(q), np.empty_like(sigma), np.empty_like(r), np.empty((N, d)), np.empty(5),
        )  # fmt: skip
        frames, since = b.holds(times[0])[2], thread_time()
        made, iterations, checks, n_kept = run_steps(
            b.size, *b.kind, (*b.beam, *b.tables, b.owner, b.shift), self.linear, (*b.rows, frames, *b.followers), places,
            inertia, loads, self._limits(tolerance, (0.0, 0.0)), STEPPING, method,
            (start.h, lengths, load_of, place_of, keep), state, np.zeros(L + 1), kept, scratch,
        )  # fmt: skip
        self.model.spend(COMPILED, since)
        place, turned, memory = kept[:3]
        v, a, aux, g = (b.in_space(array) for array in kept[3:7])
        last = b.in_space(forces, loads[0])
        which, found = kept[9][:n_kept].tolist(), []
        at = [times[k] for k in which]
        states = b.give_all(start.state, at, place[:n_kept], turned[:n_kept], memory[:n_kept])
        for m, (k, state) in enumerate(zip(which, states, strict=True)):
            found.append(
                Moving(
                    state, Rates(v[m], a[m], aux[m]), g[m], last, plan[k][1], kept[7][m], plan[k][2], int(kept[8][m, 0]),
                    float(kept[8][m, 1]),
                )
            )  # fmt: skip
        return made, (iterations, checks), found

    def _loads_at(self, times: list[float]) -> tuple[Any, np.ndarray]:
        """Load tables, with a leading axis if they change, and the number of the table at each time."""
        tables = [self.table(times[0])[0]]
        if self._table is None:
            tables += [self.table(t)[0] for t in times[1:]]
        nodes, _, _, kinds, _ = tables[0]
        force, moment = (np.array([table[k] for table in tables]) for k in (1, 2))
        number = np.arange(len(times)) if len(tables) > 1 else np.zeros(len(times), dtype=np.int64)
        return (nodes, force, moment, kinds, any(table[4] for table in tables)), number

    def _places_at(self, times: list[float], driven: Callable[[float], Driven]) -> tuple[Any, np.ndarray]:
        """Place, attitude and driven rates of supports, with a leading axis if they move, and the number at each time."""
        b, moving = self.border, bool(self.model.constraints.moving_parts)
        at = times if moving else times[:1]
        held = [b.holds(t) for t in at]
        given = [driven(t) for t in at]
        rates = [b.driven(one) for one in given]
        arrays = [np.array([row[k] for row in rows]) for rows in (held, rates) for k in (0, 1)]
        number = np.arange(len(times)) if moving else np.zeros(len(times), dtype=np.int64)
        return (*arrays, given[0].nodes), number
