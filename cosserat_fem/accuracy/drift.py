"""How do small errors of a motion grow? Two errors, of elements and of time steps, carried from one kept time to the next.

Rule: the error e of a motion obeys the motion's own linearised equation, M e'' + C e' + K e = load, about the states that
were kept. One linear system is solved for each of them and nothing is iterated.

Elements: the load is what the kept motion leaves over on richer elements, inertia included. Stresses are carried over as
they are, as in `accuracy`, so that stiff rods are no obstacle.

Time steps: generalized-alpha makes in a time dt the errors h^2 c a' dt of a place and h^2 c_v a'' dt of a velocity, with
c = beta + (am - af) / 2 - 1/6 and c_v = (am - af)(am - 1/2 + gamma) + gamma / 2 - 1/6: the terms of its modified equation,
by Taylor's expansion of the formulas in `integrator`. A rotation gets - h^2 w x w' dt / 12 more, the Magnus term that one
exponential a step leaves out. Summed over the time between two kept states they need no more than a and b there, since b
belongs to a time (am - af) h after a.

The error of a rotation is a spin vector in space, so that it stays what it is while sections turn: with that, the error of
the angular velocity in the section's axes is R^T e', and of its rate R^T e'' - w x R^T e'. Both errors are carried by
generalized-alpha with spectral radius 0, which removes what the kept times do not resolve. Of drag and damping only the
force at the kept motion counts, not its change with the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..history import History
from ..iteration.linear import LinearSolver
from ..iteration.newton import SMALLEST_SHIFT
from ..kernels.inertia import step_inertia
from ..kernels.rotation import matrix_from_quaternion
from ..model import Model
from ..record import Record
from ..space import Space, State, lanes
from ..terms.dissipative import tables_at_rate
from ..terms.inertial import Rates, constants
from .transfer import Transfer

AM, AF, BETA, GAMMA = constants(0.0)
AT_REST = 1e-6  # of the forces in the rods: inertia below this is none
SHORT = 1e-6  # s: over which a strain rate is measured
NO_TANGENT = np.empty((0, 6, 6))


@dataclass(eq=False)
class Moving:
    """A motion at one time as `Model.residual` takes a time step: its inertia, and the tangent of an error that moves with
    ca e [1/s^2] and turns with cv e [1/s]."""

    space: Space
    rates: Rates
    tables: list[tuple[Any, ...]] | None = None
    ca: float = 0.0
    cv: float = 0.0
    heaviest: tuple[float, float] = (0.0, 0.0)
    push: np.ndarray = field(init=False)  # contact counts once

    def __post_init__(self) -> None:
        self.push = np.ones_like(self.rates.v)

    def with_velocity(self, state: State) -> State:
        return replace(state, velocity=self.rates.v, slope=0.0)

    def add(self, state: State, g: np.ndarray, nodal: np.ndarray) -> tuple[float, float]:
        v, mass, J = self.rates.v, self.space.node_mass, self.space.node_inertia
        if len(nodal):
            nodal[:, range(3), range(3)] += self.ca * mass[:, None]
            nodal[:, 3:, 3:] += self.ca * J[:, :, None] * np.eye(3) + self.cv * gyroscopic(J, v[:, 3:])
        still = np.array([np.inf, AM, AF, BETA, GAMMA])
        return step_inertia(mass, J, np.zeros_like(g), v, self.rates.a, still, g, nodal)


def gyroscopic(J: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) of the moment J (- w x u) + u x J w + w x J u that an error u of the angular velocity w makes."""
    turn, spin = _cross(w), _cross(J * w)
    return turn * J[:, None, :] - J[:, :, None] * turn - spin


def _cross(w: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) of w x."""
    out = np.zeros((len(w), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _turned(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """x (N, 6) with its rotation parts from the axes of sections R (N, 3, 3) to space."""
    return np.concatenate([x[:, :3], np.einsum("nij,nj->ni", R, x[:, 3:])], axis=1)


def _back(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """x (N, 6) with its rotation parts from space to the axes of sections."""
    return _turned(np.swapaxes(R, 1, 2), x)


class Drift:
    """An error e (N, 6) of a motion on the elements of one model, with its velocity v and accelerations a, b, in space."""

    def __init__(self, model: Model) -> None:
        self.model, self.space, self.linear = model, model.space, LinearSolver(model.space, model.constraints)
        self.mass = np.concatenate(
            [np.repeat(self.space.node_mass[:, None], 3, axis=1), self.space.node_inertia], axis=1
        )
        self.e, self.v, self.a, self.b = np.zeros((4, self.space.n_nodes, 6))
        self._dampers: list[Any] = [term for term in model.terms if getattr(term, "internal", False)]

    def begin(self, state: State, rates: Rates) -> None:
        """At the first kept state: the error of an equilibrium if that is one, else none."""
        inertia = np.zeros_like(self.e)
        Moving(self.space, rates).add(state, inertia, NO_TANGENT)
        if np.abs(inertia[:, :3]).max() <= AT_REST * self.model.residual(state).force:
            e = self._solve(state, Moving(self.space, rates), 0.0, SMALLEST_SHIFT)
            self.e = _turned(matrix_from_quaternion(state.q), e)

    def step(self, state: State, rates: Rates, h: float, *, left_over: bool) -> None:
        """Carry the error over a time h [s] to a state of the motion. left_over: drive it by what is left over there."""
        ca, cv = (1 - AM) / ((1 - AF) * BETA * h * h), GAMMA / (BETA * h)
        moving = Moving(self.space, rates, self._tables(state, rates), ca, cv)
        R, w, J = matrix_from_quaternion(state.q), rates.v[:, 3:], self.space.node_inertia
        # what the error would do if it ended at 0: v = cv e + v_0, a = ca e + a_0
        b_0 = -(self.e + h * self.v) / (BETA * h * h) - (0.5 - BETA) / BETA * self.b
        a_0 = ((1 - AM) * b_0 + AM * self.b - AF * self.a) / (1 - AF)
        v_0 = self.v + h * ((1 - GAMMA) * self.b + GAMMA * b_0)
        load = self.mass * _back(R, a_0)
        load[:, 3:] += np.einsum("nij,nj->ni", gyroscopic(J, w), _back(R, v_0)[:, 3:])
        if not left_over:
            load -= self.model.residual(state, step=moving).g
        e = _turned(R, self._solve(state, moving, load, 0.0))
        self.e, self.v, self.a, self.b = e, v_0 + cv * e, a_0 + ca * e, b_0 + e / (BETA * h * h)

    def record(self, record: Record, state: State, rates: Rates) -> Record:
        """A kept state with the error added: places, velocities, and reactions from the stresses of the mixed method."""
        model, space = self.model, self.space
        R = matrix_from_quaternion(state.q)
        e, v, a = _back(R, self.e), _back(R, self.v), _back(R, self.a)
        a[:, 3:] -= np.cross(rates.v[:, 3:], v[:, 3:])
        stress = model.internal.extrapolate(state, space, e, 1.0, self._tables(state, rates))
        moved = space.update(state, e, 1.0, stress)
        rates = Rates(rates.v + v, rates.a + a, rates.b)
        moving = Moving(space, rates, _as_stressed(space, moved, stress))
        g = model.residual(moved, step=moving).g
        return replace(record, state=moved, reactions=model.constraints.reactions(moved, g), rates=rates)

    def _solve(self, state: State, moving: Moving, load: np.ndarray | float, shift: float) -> np.ndarray:
        """Increment of the linearised motion under its own residual and a load on the same side."""
        constraints = self.model.constraints
        held = constraints.evaluate(state, constraints.targets(state.t))
        total = self.model.condensed(state, self.linear.scratch, shift, np.zeros_like(self.e) + load, step=moving)
        solution = self.linear.solve(state, total.g, held, total.negative, total.symmetric, total.whole)
        return solution.du.copy() if solution.singular < 0 else np.full_like(self.e, np.nan)

    def _tables(self, state: State, rates: Rates) -> list[tuple[Any, ...]] | None:
        """Tables of rods with internal damping, at the strain rates of the motion."""
        if not self._dampers:
            return None
        past, tables = self.space.update(state, rates.v, -SHORT), []
        for k, group in enumerate(self.space.groups):
            D = np.sum([damper.coefficients(self.space, k) for damper in self._dampers], axis=0)
            rate = (self.space.strain_and_frame(state, k)[0] - self.space.strain_and_frame(past, k)[0]) / SHORT
            tables.append(tables_at_rate(group, D, rate))
        return tables


def _as_stressed(space: Space, state: State, stress: tuple[np.ndarray, ...]) -> list[tuple[Any, ...]]:
    """Tables of rods whose stresses at a state are given: a stiffness of that size, at a strain of one."""
    tables = []
    for k, (group, sigma) in enumerate(zip(space.groups, stress, strict=True)):
        rest = lanes(space.strain_and_frame(state, k)[0] - 1.0).reshape(sigma.shape)
        tables.append((*group.tables[:2], sigma, None, rest))
    return tables


def space_errors(history: History, model: Model, stations: Sequence[int], wanted: set[int]) -> dict[int, Record]:
    """The wanted ones of the kept states `stations` (increasing, the first one 0), as they would be on the richer elements
    of another model."""
    drift, transfer, found = Drift(model), Transfer(history.model, model), {}
    for n, k in enumerate(stations):
        record = history.records[k]
        state, rates = transfer.with_contact(record.state), transfer.rates(record.rates)  # type: ignore[arg-type]
        if n == 0:
            drift.begin(state, rates)
        else:
            before = history.records[stations[n - 1]].state.t
            drift.step(state, rates, float(state.t - before), left_over=True)
        if k in wanted:
            found[k] = drift.record(record, state, rates)
    return found


def time_errors(history: History, stations: Sequence[int], wanted: set[int]) -> dict[int, Record]:
    """The wanted ones of the kept states `stations` (increasing, the first one 0), as they would be without the errors of
    time steps."""
    am, af, beta, gamma = constants(float(history.rho_inf))  # type: ignore[arg-type]
    c, c_v = beta + 0.5 * (am - af) - 1 / 6, (am - af) * (am - 0.5 + gamma) + 0.5 * gamma - 1 / 6
    drift, found = Drift(history.model), {}
    t = history.t[list(stations)]
    taken = np.array([(end, h) for end, h, _, accepted in history.steps if accepted]).reshape(-1, 2)
    cubes = np.append(0.0, np.cumsum(taken[:, 1] ** 3))
    count = np.searchsorted(taken[:, 0], t + 1e-9 * (t[-1] - t[0]), side="right")  # steps made until then
    records = [history.records[k] for k in stations]
    rates: list[Any] = [record.rates for record in records]
    jerk = _jerk(np.array([x.a for x in rates]), np.array([x.b for x in rates]), t, (am - af) * taken[count - 1, 1])
    a: list[Any] = []  # acceleration and its rate at the station before, in space, and how they turn
    for n, (k, record) in enumerate(zip(stations, records, strict=True)):
        stress = history.model.internal.with_stress(record.state, history.model.space)  # frames keep none
        state = replace(record.state, velocity=None, stress=stress)
        R, w = matrix_from_quaternion(state.q), rates[n].v[:, 3:]
        now = [(_turned(R, x), _spun(R, w, x)) for x in (rates[n].a, jerk[n])]
        if n > 0:
            h = float(t[n] - t[n - 1])
            h2 = (cubes[count[n]] - cubes[count[n - 1]]) / h
            turned = [0.5 * h * (then[1] + it[1]) for then, it in zip(a, now, strict=True)]
            drift.e = drift.e - h2 * (c * (now[0][0] - a[0][0] - turned[0]) - turned[0] / 12)
            drift.v = drift.v - h2 * c_v * (now[1][0] - a[1][0] - turned[1])
            drift.step(state, rates[n], h, left_over=False)
        a = now
        if k in wanted:
            found[k] = drift.record(record, state, rates[n])
    return found


def _spun(R: np.ndarray, w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """w x of the rotation part of x (N, 6), in space; nothing of a displacement."""
    return _turned(R, np.concatenate([np.zeros_like(w), np.cross(w, x[:, 3:])], axis=1))


def _jerk(a: np.ndarray, b: np.ndarray, t: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Rate of the accelerations a (T, N, 6): from b, `ahead` (T,) later, or, where that was set to a, from a around."""
    around = np.gradient(a, t, axis=0) if len(a) > 1 else np.zeros_like(a)
    told = (a != b).any(axis=(1, 2)) & (ahead != 0.0)
    return np.where(told[:, None, None], (b - a) / np.where(told, ahead, 1.0)[:, None, None], around)
