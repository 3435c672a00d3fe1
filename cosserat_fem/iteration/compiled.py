"""Which models are solved in one compiled call, and how do their arrays get there?

Rule: where every term of a model has a compiled form, a whole Newton solve is one call of `kernels.step`, in space or in a
plane; the loop over terms in `newton` stays the general path, and a test holds both equal. States, loads and reactions are
always those in space: a border turns them into the arrays of the kernel and back. In space the border hands arrays over as
they are; in a plane it keeps what lies in the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import thread_time
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..constraint import Targets
from ..kernels import chain, planar
from ..kernels.beam import LANES
from ..kernels.rest import keep, settle
from ..kernels.step import newton, run_steps
from ..model import Model
from ..plane import ScenePlane
from ..space import State
from ..terms.external import NO_LOADS, NodalLoads
from ..terms.inertial import Driven, InertiaStep, Rates
from ..terms.internal import QuaternionBeam
from .linear import segments_of

REASONS = (
    "", "the residual is not a finite number", "no convergence within {} iterations", "the tangent is singular",
    "the iteration diverges", "the tangent stays indefinite", "the section forces are not finite numbers",
)  # fmt: skip
NO_FRAMES, NO_OFFSET, NO_MASS, NO_COEFFICIENTS = np.empty((0, 0, 0)), np.empty((0, 0)), np.empty(0), np.zeros(5)
NO_NODES = np.empty(0, dtype=np.int64)
ROUND_OFF = 2 * np.finfo(float).eps
COMPILED = "compiled solves"  # where their CPU time is booked
Tables = tuple[Any, ...]
Nodes = np.ndarray | slice


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


class SpaceBorder:
    """Arrays of a model in space, as the kernel takes them."""

    size: tuple[int, ...] = chain.SPACE
    kind: tuple[Any, Any] = (True, None)  # in space, in a plane

    def __init__(self, model: Model) -> None:
        space, c = model.space, model.constraints
        (group,) = space.groups
        self.model, self.group = model, group
        self.beam = (group.packed_conn, group.n_elements, group.N)
        self.mass, self.J = space.node_mass, space.node_inertia
        self.owner, self.shift = space.owner, model.shift
        self.segments, self.n_vertices = segments_of(space, c)
        self.joint_nodes, self.joint_index, self.half = _number_joints(model, self.segments, len(self.size))
        self.n_joints = len(c.joints)
        self.rows = (c.nodes, c.left, c.right, self.held_rows(), c.owner)
        self.followers = (c.lead, c.lead_row)
        self._still = None if c.moving_parts else self._holds(c.targets(0.0))
        self._stands = None if c.moving_parts else self._places(c.targets(0.0))
        self.tables = self.project(group.tables)

    def held_rows(self) -> np.ndarray:
        return self.model.constraints.held

    def project(self, tables: Tables) -> Tables:
        """Tables of `Group.tables` for the kernel: N_s, dx, C, C_full, reference."""
        return tables

    def take(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places, attitudes and stress memory of a state, to be changed in place."""
        return state.r.copy(), state.q.copy(), state.stress[0].copy()

    def give(self, state: State, r: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> State:
        """The state with these places, attitudes and stress memory."""
        return self.give_all(state, [state.t], r[None], q[None], sigma[None])[0]

    def give_all(
        self, state: State, times: list[float], r: np.ndarray, q: np.ndarray, sigma: np.ndarray
    ) -> list[State]:
        """As `give`, of several states at times (K,): a leading axis."""
        return [State(t, r[k], q[k], (sigma[k],), None, state.velocity, state.slope) for k, t in enumerate(times)]

    def holds(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place and attitude of the supports and frames T (M, d, d), or none, at a time or at given targets."""
        if targets is not None:
            return self._holds(targets)
        return self._still or self._holds(self.model.constraints.targets(t))

    def _holds(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return targets.place, targets.quaternion, self._frames(targets)

    def _frames(self, targets: Targets) -> np.ndarray:
        """Frames T (M, d, d) of the special vertices, or none."""
        return NO_FRAMES

    def places(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `holds`, but place (n, 3) and attitude (n, 4) in space."""
        if targets is not None:
            return self._places(targets)
        return self._stands or self._places(self.model.constraints.targets(t))

    def _places(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return targets.place, targets.quaternion, self._frames(targets)

    @property
    def frame(self) -> tuple[Any, ...] | None:
        """What translates between the plane and space, as `kernels.rest` takes it."""
        return None

    def loads(self, table: NodalLoads) -> tuple[Any, ...]:
        """Nodes, force, moment, kinds, whether any depends on the attitude; and whether any has a tangent."""
        turning = bool(table.moment.any() or (table.kinds.any() and table.force.any()))
        return (table.nodes, table.force, table.moment, table.kinds, turning), turning

    def rates(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        """Rates or forces (n, d) at nodes from those in space (n, 6)."""
        return values

    def in_space(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        """The inverse of `rates`."""
        return values

    def flat(self, values: np.ndarray) -> np.ndarray:
        """Displacements (N, d) of nodes from those in space (N, 3)."""
        return values

    def driven(self, driven: Driven) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration (M, d) of driven nodes."""
        return driven.v.reshape(-1, 6), driven.a.reshape(-1, 6)

    @property
    def symmetric(self) -> bool:
        """True if the loads have a potential."""
        return self.model.symmetric


class PlaneBorder(SpaceBorder):
    """Arrays of a model that stays in a plane."""

    size, kind = chain.PLANE, (None, True)

    def __init__(self, model: Model) -> None:
        plane = cast(ScenePlane, model.plane)
        self.plane = plane
        node = np.ascontiguousarray(model.space.groups[0].packed_conn[:, 0])
        self._place = (plane.axes, plane.base, node, plane.across, plane.normal)
        super().__init__(model)
        n = self.plane.normal
        self.J = (model.space.node_inertia * n * n).sum(axis=1, keepdims=True)
        self.shift = model.shift[:, [0, 1, 3]].copy()

    def held_rows(self) -> np.ndarray:
        """Held unknowns (M, 3): along two axes of a support's frame in the plane, and the angle."""
        c, axes = self.model.constraints, self.plane.axes
        held = c.held[:, [axes[0], axes[1], 3 + axes[2]]].copy()
        self._slides = {}  # supports that hold one direction in the plane: which two of their axes lie in it
        for row in c.tilted:
            frame = c.supports[row].frame
            k = axes[2] if frame is None else int(np.argmax(np.abs(frame[axes[2]])))
            i, j = (k + 1) % 3, (k + 2) % 3
            held[row] = c.held[row, [i, j, 3 + k]]
            if held[row, 0] != held[row, 1]:
                self._slides[row] = [i, j]
        for k, row in enumerate(c.lead_row):
            if row >= 0:
                held[c.n_supports + k] = held[row]
        return held

    def project(self, tables: Tables) -> Tables:
        N_s, dx, C, C_full, reference = tables
        a, n = self._directions
        flat = np.empty((*C.shape[:2], 6, LANES))
        full = None if C_full is None else C_full.reshape(*C.shape[:2], 6, 6, LANES)
        C = C.reshape(*C.shape[:2], 6, LANES)

        def entry(i: int, j: int) -> Any:
            if i == j:
                return C[:, :, i]
            return 0.0 if full is None else full[:, :, i, j]

        flat[:, :, 0] = entry(2, 2)
        flat[:, :, 1] = entry(2, 0) * a[0] + entry(2, 1) * a[1]
        flat[:, :, 2] = entry(2, 3) * n[0] + entry(2, 4) * n[1]
        flat[:, :, 3] = entry(0, 0) * a[0] ** 2 + entry(1, 1) * a[1] ** 2 + 2 * entry(0, 1) * a[0] * a[1]
        flat[:, :, 4] = sum(entry(i, 3 + j) * a[i] * n[j] for i in range(2) for j in range(2))
        flat[:, :, 5] = entry(3, 3) * n[0] ** 2 + entry(4, 4) * n[1] ** 2 + 2 * entry(3, 4) * n[0] * n[1]
        return N_s, dx, flat.reshape(*C.shape[:2], -1), None, self._strains(reference)

    @property
    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions across and normal (2, P, 1, LANES) in the sections of each element."""
        node = self._place[2]
        across, normal = (
            np.moveaxis(d[node][..., :2], -1, 0)[:, :, None] for d in (self.plane.across, self.plane.normal)
        )
        return across, normal

    def _strains(self, values: np.ndarray) -> np.ndarray:
        """Stretch, shear, bend (P, Q, 3 * LANES) of strains (P, Q, 6 * LANES)."""
        a, n = self._directions
        rows = values.reshape(*values.shape[:2], 6, LANES)
        out = np.empty((*values.shape[:2], 3, LANES))
        out[:, :, 0] = rows[:, :, 2]
        out[:, :, 1] = rows[:, :, 0] * a[0] + rows[:, :, 1] * a[1]
        out[:, :, 2] = rows[:, :, 3] * n[0] + rows[:, :, 4] * n[1]
        return out.reshape(*values.shape[:2], -1)

    def take(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n, stress = len(state.r), state.stress[0]
        flat, p, sigma = np.empty((n, 2)), np.empty((n, 2)), np.empty((*stress.shape[:2], 3 * LANES))
        planar.enter(*self._place, state.r, state.q, stress, flat, p, sigma)
        return flat, p, sigma

    def give_all(
        self, state: State, times: list[float], r: np.ndarray, q: np.ndarray, sigma: np.ndarray
    ) -> list[State]:
        place, turned = np.empty((*r.shape[:2], 3)), np.empty((*q.shape[:2], 4))
        stress = np.empty((*sigma.shape[:3], 6 * LANES))
        place[..., self.plane.axes[2]] = self.plane.height
        planar.leave_all(*self._place, r, q, sigma, place, turned, stress)
        return super().give_all(state, times, place, turned, stress)

    def holds(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self._check_poses(t)
        return super().holds(t, targets)

    def places(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self._check_poses(t)
        return super().places(t, targets)

    def _check_poses(self, t: float) -> None:
        """SceneError if a motion that could not be checked before leaves the plane."""
        if self.plane.watched:
            for part in self.model.constraints.moving_parts:
                self.plane.check_pose(part, t)

    def _holds(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        plane, c = self.plane, self.model.constraints
        return plane.flat(targets.place), plane.numbers(targets.quaternion, c.support_node), self._frames(targets)

    def _frames(self, targets: Targets) -> np.ndarray:
        if not self._slides:
            return NO_FRAMES
        c, axes = self.model.constraints, list(self.plane.axes[:2])
        T = np.tile(np.eye(3), (len(c.nodes), 1, 1))
        for row, columns in self._slides.items():
            T[row, :2, :2] = targets.axes[row][axes][:, columns]
        for k, row in enumerate(c.lead_row):
            if row >= 0:
                T[c.n_supports + k] = T[row]
        return T

    @property
    def frame(self) -> tuple[Any, ...] | None:
        return (*self._place, self.plane.height)

    def loads(self, table: NodalLoads) -> tuple[Any, ...]:
        force, moment = self.plane.loads(table)
        turning = bool(table.kinds[:, [0, 2]].any() and force.any())
        return (table.nodes, force, moment, table.kinds, turning), turning

    def rates(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        return self.plane.rates(values, nodes)

    def in_space(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        return self.plane.in_space(values, nodes)

    def flat(self, values: np.ndarray) -> np.ndarray:
        return self.plane.flat(values)

    def driven(self, driven: Driven) -> tuple[np.ndarray, np.ndarray]:
        v, a = super().driven(driven)
        return self.plane.rates(v, driven.nodes), self.plane.rates(a, driven.nodes)

    @property
    def symmetric(self) -> bool:
        """In a plane a moment has a potential: only forces that follow have none."""
        turning = (getattr(t, "follower", False) or getattr(t, "components", "all") != "all" for t in self.model.terms)
        return not any(turning)


def border(model: Model) -> SpaceBorder:
    """The border of a model, made once."""
    return SpaceBorder(model) if model.plane is None else PlaneBorder(model)


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
        answer = self._call(
            guess, at, None, tables, inertia, table, NO_OFFSET, (20, False, False, 1), (tolerance, step.heaviest),
            b.flat(moved).copy(), self._nodal, made,
        )  # fmt: skip
        for name, values in zip("Dvab", made, strict=True):
            setattr(step, name, b.in_space(values))
        return answer

    def _call(
        self, state: State, at: Any, targets: Targets | None, tables: Tables, inertia: Any, table: Any, offset: np.ndarray,
        controls: tuple[int, bool, bool, int], wanted: tuple[float, tuple[float, float]], moved: np.ndarray,
        nodal: np.ndarray, made: Any,
    ) -> Answer:  # fmt: skip
        """One call of the kernel; `at`: place, attitude and stress memory, ours to be changed."""
        b, g, since = self.border, np.empty_like(self._du), thread_time()
        status, k, solves, checks, residual, where, negative = newton(
            b.size, *b.kind, (*b.beam, *tables, b.owner, b.shift), self.linear,
            (*b.rows, *b.holds(state.t, targets), *b.followers), inertia, table, offset, self._limits(*wanted), controls,
            moved, *at, (g, nodal, self._du, *made, self.each, self._R, self._gap),
        )  # fmt: skip
        self.model.spend(COMPILED, since)
        reason = REASONS[status].format(controls[0])
        return Answer(b.give(state, *at), b.in_space(g), k, solves, checks, residual, where, negative, reason)

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
        frames, since = b.holds(times[0], None)[2], thread_time()
        made, iterations, checks, n_kept = run_steps(
            b.size, *b.kind, (*b.beam, *b.tables, b.owner, b.shift), self.linear, (*b.rows, frames, *b.followers), places,
            inertia, loads, self._limits(tolerance, (0.0, 0.0)), (20, False, False, 1), method,
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
        held = [b.holds(t, None) for t in at]
        given = [driven(t) for t in at]
        rates = [b.driven(one) for one in given]
        arrays = [np.array([row[k] for row in rows]) for rows in (held, rates) for k in (0, 1)]
        number = np.arange(len(times)) if moving else np.zeros(len(times), dtype=np.int64)
        return (*arrays, given[0].nodes), number


def _number_joints(model: Model, segments: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Nodes of joints, the joint that each belongs to, half width of the band; joints of `segments` are numbered anew.

    Reverse Cuthill and McKee keeps joints that share a segment near each other.
    """
    joints = model.constraints.joints
    if not joints:
        return NO_NODES, NO_NODES, 0
    ends = segments[:, 3:5]
    between = ends[(ends >= 0).all(axis=1)]
    n = len(joints)
    rows, columns = np.concatenate([between, between[:, ::-1]]).T
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), (n, n))
    number = np.empty(n, dtype=np.int64)
    number[reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True)] = np.arange(n)
    segments[:, 3:5] = np.where(ends >= 0, number[ends], -1)
    apart = int(np.abs(np.diff(segments[(ends >= 0).all(axis=1), 3:5])).max(initial=0))
    index = np.concatenate([np.full(len(nodes), number[j]) for j, nodes in enumerate(joints)])
    return np.concatenate(joints), index, d * apart + d - 1
