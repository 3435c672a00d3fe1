"""How is time stepped? Generalized-alpha, step control, kinks and jumps, works: one run between its steps.

Rule: a step is the static Newton method with inertia added; unknowns, supports and linear systems are the same. Held
places follow their parts exactly, with the part's velocity and acceleration. Steps end exactly at output times and
where a load or a motion has a kink.

Equations: Lie-group generalized-alpha on (R^3 x SO(3))^N, Arnold and Bruels (2007), see `kernels.inertia`; with
spectral radius rho at infinity,  am = (2 rho - 1) / (rho + 1), af = rho / (rho + 1), gamma = 1/2 - am + af,
beta = (gamma + 1/2)^2 / 4. The auxiliary acceleration b belongs to the time am - af steps beyond the end of a step: when
the step length changes, b is moved along the line from a to it, which keeps the order.

Error of a step: h^2 |beta + (am - af)/2 - 1/6| |b1 - b0|, displacements in units of the longest rod, rotations in rad.
It is controlled per unit of time, error / h <= rtol / duration, so that the error at the end goes with rtol. Vibrations
that the step does not resolve make b large and move nothing: where the estimate is too large it is passed once through
the matrix of the step, (ca M + K) e = ca M h^2 c (b1 - b0), which leaves slow motions as they are and removes these
(the filter of Shampine and of Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.8).

Contact is collocated at the end of a step. A step across an impact that does not resolve the barrier would add energy, so
with contact every step is held against the ledger: one that adds energy, or takes more than a little, is made again
shorter. `AdaptiveStep` besides follows every wave that an impact sends along a rod; where these do not matter, or there is
nothing to damp them, `FixedStep` is the choice.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .errors import ConvergenceError, SceneError, check_positive
from .history import History, Record
from .kernels.inertia import largest_change
from .kernels.rotation import quaternion_from_matrix, relative_rotation
from .model import Model
from .newton import CompiledStep, Newton, Solved
from .space import State
from .terms.dissipative import damped_tables, tables_at_rate
from .terms.inertial import Driven, InertiaStep, Rates

TOLERANCE = 1e-9  # relative residual of a time step
SMALLEST = 1e-10  # of the duration: a step shorter than this ends the run
JUMP = 1e-5  # in rod lengths, or rad, over the duration: velocities that differ by more jump
GROWTH = 4.0  # a step longer than this many of the last one starts with b = a
PLAIN_ESTIMATE = 0.3  # in parts of the allowed error: below it the estimate is good enough as it is
LARGEST_TURN = 2.0  # rad in a step; the rotation vector of a step is unique below pi
LONGER, SAFETY = 1.5, 0.8  # growth of a step; aim at this part of the step that would just be allowed
RUBBED = 0.1  # part of the work of friction in a step that may be missing
GAINED, LOST = 1e-6, 2e-3  # parts of the largest energy that a step with contact may add or take by itself
SHORT = 1e-3  # part of a step over which a strain rate is measured
BEFORE = 1e-13  # of the duration: how long before a jump of a load the step that ends there is evaluated


@dataclass(frozen=True)
class AdaptiveStep:
    """Step length from an error estimate.

    Parameters
    ----------
    rtol : [-]
        Accuracy asked for: the error added over the whole run, in parts of the longest rod and in rad.
    first, largest : [s], optional
        First and largest step.
    """

    rtol: float = 1e-4
    first: float | None = None
    largest: float | None = None

    def __post_init__(self) -> None:
        check_positive("adaptive step: rtol", self.rtol)
        for name in ("first", "largest"):
            if getattr(self, name) is not None:
                check_positive(f"adaptive step: {name}", getattr(self, name))


@dataclass(frozen=True)
class FixedStep:
    """Steps of one length, shortened so that they end at output times and kinks, and turn no section by more than 2 rad.

    Parameters
    ----------
    dt : [s]
    richardson : bool
        Run a second time with half the step and extrapolate: order 4 of smooth motions at output times, for three times
        the cost. `History.extrapolated` then says how far the two runs were apart.
    """

    dt: float
    richardson: bool = False

    def __post_init__(self) -> None:
        check_positive("fixed step: dt", self.dt)


@dataclass(frozen=True, eq=False)
class Made:
    """A converged step that may be taken: outcome with contact renewed, rates, works [J] in it, forces of terms, strains of
    damped rods, energies in contact terms."""

    solved: Solved
    rates: Rates
    work: dict[str, float]
    forces: list[np.ndarray]
    strain: tuple[np.ndarray, ...]
    stored: list[float]


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """All that a run needs to go on, bit for bit: state and rates, step control, works so far, how many are kept."""

    state: State
    rates: Rates
    h: float
    wanted_h: float
    work: dict[str, float]
    forces: list[np.ndarray]
    residual: np.ndarray
    strain: tuple[np.ndarray, ...]
    strain_before: tuple[np.ndarray, ...]
    strain_step: float
    kept: int
    largest_energy: float = 0.0
    log: list[tuple[float, float, float, bool]] = field(default_factory=list)


class Run:
    """One run in time, between its steps.

    Attributes
    ----------
    history : History so far
    t, end : [s]
    steps : list of (t at the end, h, error / allowed error, accepted)
    """

    def __init__(
        self,
        model: Model,
        t: float,
        end: float,
        rho: float,
        step: AdaptiveStep | FixedStep,
        times: np.ndarray | None,
        callback: Callable[[Run], bool | None] | None,
    ) -> None:
        self.model, self.begin_time, self.end, self.step = model, t, end, step
        self.times, self.callback = times, callback
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 - am + af
        beta = 0.25 * (gamma + 0.5) ** 2
        self._method = (am, af, beta, gamma)
        self._constant = abs(beta + 0.5 * (am - af) - 1 / 6)
        self.history = History(model)
        self.newton = Newton(model)
        self.history.counters = self.newton.counters
        self.steps = self.history.steps
        self.kept = 0
        self.strain: tuple[np.ndarray, ...] = ()
        self.strain_before: tuple[np.ndarray, ...] = ()
        self.strain_step = 0.0
        self._driven_nodes, self._driven_rows, self._given = _driven_nodes(model)
        self._others = [term for term in model.terms if term not in model.contacts]
        names = dict(zip(model.terms, _names(model.terms), strict=True))
        self._names = [names[term] for term in self._others]
        self._contact_names = [names[term] for term in model.contacts]
        self._velocity_terms = any(getattr(term, "needs_velocity", False) for term in model.terms)
        self._compiled = CompiledStep(self.newton, TOLERANCE) if CompiledStep.takes(model) else None
        self._dampers = [term for term in model.terms if getattr(term, "internal", False)]
        self._damping = [
            np.sum([d.coefficients(model.space, k) for d in self._dampers], axis=0)  # type: ignore[attr-defined]
            for k in range(len(model.space.groups))
        ]
        kinks = [part.motion.kinks for part in model.parts if part.motion is not None]
        self._motion_kinks = _inside(kinks, t, end)
        loads = [term.kinks for term in model.terms if hasattr(term, "kinks")]
        jumps = [term.jumps for term in model.terms if hasattr(term, "jumps")]
        self._load_jumps = _inside(jumps, t, end)
        wanted = [self._load_jumps, self._motion_kinks, _inside(loads, t, end), np.array([end])]
        if times is not None:
            wanted.append(times[times > t])
        self._stops = _merged(wanted, SMALLEST * (end - t))
        # what happens at each stop: the load jumps, rates are found anew, the state is kept
        near = SMALLEST * (end - t)
        jumping = _near(self._stops, self._load_jumps, near)
        settling = jumping | _near(self._stops, self._motion_kinks, near)
        keeping = np.ones(len(self._stops), dtype=bool) if times is None else _near(self._stops, times, near)
        self._at_stop = list(zip(jumping.tolist(), settling.tolist(), keeping.tolist(), strict=True))

    @property
    def t(self) -> float:
        return self.state.t

    # start

    def begin(self, state: State, velocity: np.ndarray, *, told: bool) -> None:
        """Start from a state and the velocity (N, 6) of its nodes, with the acceleration that balances it.

        told: a velocity of held places that is not their part's needs no warning.
        """
        self._check_place(state)
        approach = self.newton.approach
        if approach is not None and not approach.knows(state):
            state = approach.begin(state)
        self.state = replace(state, stress=self.model.internal.with_stress(state, self.model.space))
        self.rates = Rates(velocity, np.zeros_like(velocity), np.zeros_like(velocity))
        self._start_contact()
        self.h = self.wanted_h = self._first_step()
        self.work = dict.fromkeys((*self._names, *self._contact_names, "driven ends"), 0.0)
        if self._dampers:
            self.work["internal damping"] = 0.0
        self._settle(told=told)
        if self.times is None or abs(self.times[0] - self.begin_time) <= SMALLEST * (self.end - self.begin_time):
            self._keep(0, 0.0)

    def _start_contact(self) -> None:
        """What contact does at the present state, and the energy that the next step is held against."""
        approach = self.newton.approach
        self.pressed = () if approach is None else approach.accept(self.state)[1]
        self.stored = self._stored(self.state)
        self.energy = self.largest_energy = 0.0 if approach is None else self._energy(self.state, self.rates.v)

    def _first_step(self) -> float:
        if isinstance(self.step, FixedStep):
            return self.step.dt
        first = self.step.first or 1e-3 * (self.end - self.begin_time)
        return min(first, self.step.largest or first)

    def _check_place(self, state: State) -> None:
        """SceneError if held places are not where their supports are."""
        c = self.model.constraints
        held = c.evaluate(state, c.targets(state.t))
        for row, support in enumerate(self.model.supports):
            away = float(np.abs(held.gap[row, :3]).max())
            turned = float(np.abs(held.gap[row, 3:]).max())
            if away > 1e-6 * self.model.scales["length"] or turned > 1e-6:
                raise SceneError(
                    f"support {support.name!r}: part {support.to.name!r} is {away:.3g} m and {np.degrees(turned):.3g} deg "
                    f"away from the rod at the start (t = {state.t:g} s): a jump in position. Start from 'equilibrium', "
                    "or let the motion begin at 0."
                )

    def _settle(self, *, told: bool) -> None:
        """Give held places their part's velocity and find the balancing acceleration; at the start and at kinks."""
        model, c = self.model, self.model.constraints
        held, pushed = c.driven(self.state.t)
        v, a = self.rates.v.copy(), np.zeros_like(self.rates.v)
        driven = self._driven(held, pushed)
        jumps = []
        for m, node in enumerate(driven.nodes):
            for k in range(2):
                part = slice(3 * k, 3 * k + 3)
                if not np.isnan(driven.v[m, k, 0]):
                    jump = np.abs(driven.v[m, k] - v[node, part]).max()
                    scale = (model.scales["length"], 1.0)[k] / (self.end - self.begin_time)
                    if jump > JUMP * scale and m < c.n_supports:
                        jumps.append((model.supports[m].to.name, jump, ("m/s", "rad/s")[k]))
                    v[node, part], a[node, part] = driven.v[m, k], driven.a[m, k]
        for row, jump in self._match_partly_held(held, pushed, v, a):
            jumps.append((model.supports[row].to.name, jump, "m/s or rad/s"))
        if jumps and not told:
            name, jump, unit = max(jumps, key=lambda x: x[1])
            model.warn(
                f"part {name!r}: its velocity jumps by {jump:.3g} {unit} at t = {self.state.t:g} s; the rod answers with a "
                "wave whose force at the first instant depends on the step. A smooth motion avoids it."
            )
        tables = None
        if self._dampers:  # the strain a step ago, as the velocity says
            self.strain, self.strain_step = self._strains(self.state), self.h
            past = model.space.update(self.state, v, -SHORT * self.h)
            self.strain_before = tuple(
                now + (then - now) / SHORT for now, then in zip(self.strain, self._strains(past), strict=True)
            )
            tables = [
                tables_at_rate(group, D, (now - then) / self.h)
                for group, D, now, then in zip(
                    model.space.groups, self._damping, self.strain, self.strain_before, strict=True
                )
            ]
        state = replace(self.state, velocity=v) if self._velocity_terms else self.state
        g = model.external(state, tangent=False).g
        model.internal.residual(state, model.space, g, tables)
        _accelerate(model, state, g, v, a, driven)
        self.rates = Rates(v, a, a.copy())
        self.g = g + _inertia(model, v, a)
        self.forces = self._tabulate_forces()

    def _match_partly_held(
        self, held: np.ndarray, pushed: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> list[tuple[int, float]]:
        """Give the held components of supports that free others their part's rates; rows whose velocity jumped."""
        c, model = self.model.constraints, self.model
        jumped = []
        now = c.evaluate(self.state, c.targets(self.state.t)) if c.tilted else None
        for row in c.tilted:
            node, T = c.support_node[row], now.T[row]  # type: ignore[union-attr]
            fixed = c.held[row]
            wanted, y = np.linalg.solve(T, held[row]), np.linalg.solve(T, v[node])
            scale = np.array([*3 * [model.scales["length"]], *3 * [1.0]]) / (self.end - self.begin_time)
            jump = np.abs(wanted - y) * fixed
            if (jump > JUMP * scale).any():
                jumped.append((row, float(jump.max())))
            y[fixed] = wanted[fixed]
            v[node], a[node] = T @ y, pushed[row]
            for k in np.flatnonzero(c.lead == node):
                follower = c.nodes[c.n_supports + k]
                v[follower] = np.concatenate([v[node, :3], c.seen[k] @ v[node, 3:]])
        return jumped

    def _driven(self, held: np.ndarray, pushed: np.ndarray) -> Driven:
        """Rates of held places from those of the supports (supports, 6), for the kernel."""
        v = held[self._driven_rows].reshape(-1, 2, 3)
        a = pushed[self._driven_rows].reshape(-1, 2, 3)
        c, n = self.model.constraints, self.model.constraints.n_supports
        for m in range(n, len(v)):  # welded to a held rod: the same rotation in other axes
            seen = c.seen[self._followers[m - n]]
            v[m, 1], a[m, 1] = seen @ v[m, 1], seen @ a[m, 1]
        v[~self._given] = np.nan
        return Driven(self._driven_nodes, v, a)

    @property
    def _followers(self) -> list[int]:
        return [k for k, row in enumerate(self.model.constraints.lead_row) if row >= 0]

    # steps

    def go(self) -> History:
        """Step to the end."""
        slack = 1e-12 * (self.end - self.begin_time)
        try:
            while self.state.t < self.end - slack:
                self._advance()
                if self.callback is not None and self.callback(self):
                    self.history.status = "stopped"
                    self.history.message = f"stopped by the caller at t = {self.state.t:g} s"
                    return self.history
        except ValueError as error:  # a table or function that has no value; what was found is not lost
            self.history.status, self.history.message = "stopped", f"t = {self.state.t:g} s: {error}"
            raise ConvergenceError(self.history.message, self.history, self.state) from None
        rejected = sum(not accepted for *_, accepted in self.steps)
        self.history.message = (
            f"{len(self.steps) - rejected} steps, {rejected} rejected, {self.history.counters.iterations} iterations"
        )
        self.history.check_ledger()
        return self.history

    def _advance(self) -> None:
        """One accepted step."""
        fastest = float(np.abs(self.rates.v[:, 3:]).max())
        wanted = min(self.wanted_h, LARGEST_TURN / max(fastest, 1e-300))
        near = SMALLEST * (self.end - self.begin_time)
        if self.newton.approach is not None and not any(self.stored):
            self.state = self.newton.approach.harden(self.state, self._impact())
        while True:
            k = int(np.searchsorted(self._stops, self.state.t + near))
            stop = float(self._stops[k])
            left = stop - self.state.t
            n = max(1, int(np.ceil(left / wanted - 1e-9)))
            h = left / n
            t1 = stop if n == 1 else self.state.t + h
            jumps, settles, keeps = self._at_stop[k] if n == 1 else (False, False, self.times is None)
            at = min(t1 - BEFORE * (self.end - self.begin_time), np.nextafter(t1, -np.inf)) if jumps else t1
            solved, inertia = self._try(h, at)
            error = 0.0
            if solved.converged and isinstance(self.step, AdaptiveStep):
                error = self._error(solved, inertia, h)
            accepted = solved.converged and error <= 1.0
            if accepted:
                made = self._make(solved, inertia, h, t1)
                accepted = not self.model.contacts or not self._bounced(made)
            self.steps.append((t1, h, error, accepted))
            if accepted:
                break
            shortest = (
                self.step.dt / (64 if not self.model.contacts else 1e7) if isinstance(self.step, FixedStep) else 0.0
            )
            if not solved.converged and h < shortest:
                raise self._failure(solved, h)
            wanted = h * (0.25 if not solved.converged or error <= 1.0 else max(0.2, SAFETY * error**-0.5))
            if wanted < SMALLEST * (self.end - self.begin_time):
                raise self._failure(solved, h)
        self._accept(made, h)
        if isinstance(self.step, AdaptiveStep):
            grown = LONGER if error == 0.0 else min(LONGER, SAFETY * error**-0.5)
            # a step cut short by a stop says little against the length that was wanted
            self.wanted_h = max(h * grown, wanted if h < wanted and grown >= 1.0 else 0.0)
            if self.step.largest is not None:
                self.wanted_h = min(self.wanted_h, self.step.largest)
        else:
            self.wanted_h = min(self.step.dt, LONGER * h) if self.model.contacts else self.step.dt
        if settles:
            self.state = self.state.at_time(t1)
            self._settle(told=False)
        if keeps:
            self._keep(solved.iterations, solved.residual)

    def _error(self, solved: Solved, inertia: InertiaStep, h: float) -> float:
        """Error of a step in parts of the allowed one."""
        model, length = self.model, self.model.scales["length"]
        scale = h * self._constant * (self.end - self.begin_time) / self.step.rtol  # type: ignore[union-attr]
        error = scale * largest_change(inertia.rates.b, inertia.b, self._driven_nodes, length)
        if error < PLAIN_ESTIMATE:
            return error
        mass = np.concatenate([np.repeat(model.space.node_mass[:, None], 3, 1), model.space.node_inertia], axis=1)
        # what the step's own matrix makes of the change, as of a load
        load = inertia.grows * mass * (inertia.b - inertia.rates.b)
        change = self.newton.response(solved.state, load, step=inertia.again())
        return min(error, scale * largest_change(np.zeros_like(change), change, self._driven_nodes, length))

    def _try(self, h: float, t1: float) -> tuple[Solved, InertiaStep]:
        model = self.model
        rates = self.rates
        if h != self.h:  # b belongs to a time that lies am - af steps beyond the state
            grown = h / self.h if h <= GROWTH * self.h else 0.0
            rates = Rates(rates.v, rates.a, rates.a + grown * (rates.b - rates.a))
        driven = self._driven(*model.constraints.driven(t1, before=True)) if len(self._driven_nodes) else NOBODY
        tables = None
        if self._dampers:
            tables = [
                damped_tables(group, D, now, past, h, self.strain_step)
                for group, D, now, past in zip(
                    model.space.groups, self._damping, self.strain, self.strain_before, strict=True
                )
            ]
        inertia = InertiaStep(
            model.space, self.state, rates, np.array([h, *self._method]), driven,
            wanted=self._velocity_terms, tables=tables,
        )  # fmt: skip
        for acceleration in (0.5, 0.0):  # unresolved vibrations make b a bad guess
            solved = self._solve(h * rates.v + acceleration * h * h * rates.b, t1, inertia, driven)
            if solved.converged:
                break
        return solved, inertia

    def _solve(self, D: np.ndarray, t1: float, inertia: InertiaStep, driven: Driven) -> Solved:
        """The step from the prediction D (N, 6)."""
        model = self.model
        stress = model.internal.extrapolate(self.state, model.space, D, 1.0, inertia.tables)
        if self.newton.approach is not None:
            start = self.state.at_time(t1)
            guess, part = self.newton.approach.move(start, D, 1.0, stiffen=False)
            memory = tuple(a + part * (b - a) for a, b in zip(start.stress, stress, strict=True))
            return self.newton.in_time(replace(guess, stress=memory), inertia, TOLERANCE)
        guess = model.space.update(self.state, D, 1.0, stress).at_time(t1)
        if self._compiled is not None:
            return self._compiled.solve(guess, D[:, :3].copy(), inertia, driven)
        return self.newton.in_time(guess, inertia, TOLERANCE)

    def _make(self, solved: Solved, inertia: InertiaStep, h: float, t1: float) -> Made:
        """What a converged step does, before it is taken: works, forces and memories."""
        loads = None if self._compiled is None else self._compiled.each
        solved = self.newton.accepted(solved, in_time=True)
        work = dict.fromkeys(self.work, 0.0)
        stored = self._add_contact_work(work, solved, t1)
        state = solved.state if loads is not None else inertia.with_velocity(solved.state)
        forces = self._forces(state, loads)
        for name, nodes, before, after in zip(self._names, self._nodes, self.forces, forces, strict=False):
            work[name] -= 0.5 * float(np.vdot(before + after, inertia.D[nodes]))
        # what is left of the residual acts at supports only; welds do no work
        work["driven ends"] += 0.5 * float(np.vdot(self.g + solved.total.g, inertia.D))
        strain: tuple[np.ndarray, ...] = ()
        if self._dampers:
            strain = self._strains(solved.state)
            for k, group in enumerate(self.model.space.groups):
                change = strain[k] - self.strain[k]
                taken = np.einsum("eq,eqi,eqij,eqj->", group.dx, change, self._damping[k], change)
                work["internal damping"] -= float(taken) / h
        return Made(solved, Rates(inertia.v, inertia.a, inertia.b), work, forces, strain, stored)

    def _accept(self, made: Made, h: float) -> None:
        """Take the step."""
        for name, done in made.work.items():
            self.work[name] += done
        if self._dampers:
            self.strain_before, self.strain, self.strain_step = self.strain, made.strain, h
        self.state, self.g, self.forces = made.solved.state, made.solved.total.g, made.forces
        self.rates, self.stored, self.pressed = made.rates, made.stored, made.solved.pressed
        self.h = h

    def _energy(self, state: State, v: np.ndarray) -> float:
        """Kinetic and strain energy [J]."""
        space, total = self.model.space, 0.0
        for group, strain in zip(space.groups, self._strains(state), strict=True):
            strain = strain - group.reference
            total += 0.5 * float(
                np.einsum("eqi,eqij,eqj,eq->", strain, group.stiffness, strain, group.dx, optimize=True)
            )
        return total + 0.5 * float(
            (v[:, :3] ** 2).sum(1) @ space.node_mass + (v[:, 3:] ** 2 * space.node_inertia).sum()
        )

    def _impact(self) -> float:
        """Energy [J] with which rods might hit something, parts included."""
        speed = np.linalg.norm(self.rates.v[:, :3], axis=1)
        for part in {
            term.part for term in self.model.contacts if hasattr(term, "part") and term.part.motion is not None
        }:
            rates, (_, c) = part.rates(self.state.t), part.pose(self.state.t)
            speed = speed + np.linalg.norm(np.cross(rates.omega, self.state.r - c) + rates.c_rate, axis=1)
        return 0.5 * float(speed**2 @ self.model.space.node_mass)

    def _bounced(self, made: Made) -> bool:
        """True if a step with contact adds energy, or takes more than it should: the barrier was not resolved in time."""
        energy = self._energy(made.solved.state, made.rates.v)
        self.largest_energy = max(self.largest_energy, energy)
        if not (any(self.stored) or any(made.stored)):
            self.energy = energy
            return False
        added = energy - self.energy - sum(made.work.values())
        unsure = RUBBED * sum(
            abs(told.rubbed) for told in made.solved.pressed
        )  # friction's work is known to first order
        if not -LOST * self.largest_energy - unsure <= added <= GAINED * self.largest_energy + unsure:
            return True
        self.energy = energy
        return False

    def _stored(self, state: State) -> list[float]:
        """Energy [J] in each contact term."""
        return [term.potential(state, self.model.space) for term in self.model.contacts]

    def _add_contact_work(self, work: dict[str, float], solved: Solved, t1: float) -> list[float]:
        """Work on the rods by contact: what its potential and friction gave, less what moving parts took."""
        stored = self._stored(solved.state)
        before = zip(self._contact_names, self.model.contacts, self.stored, self.pressed, strict=True)
        for (name, term, was, last), now, told in zip(before, stored, solved.pressed, strict=True):
            work[name] += was - now + told.rubbed
            if hasattr(term, "part") and term.part.motion is not None:
                (R, c), (R1, c1) = term.part.pose(self.state.t), term.part.pose(t1)
                spin = R @ relative_rotation(quaternion_from_matrix(R)[None], quaternion_from_matrix(R1)[None])[0]
                moved = np.concatenate([c1 - R1 @ R.T @ c, spin])  # of the part's point at the origin of space
                work[name] -= 0.5 * float((last.load + told.load) @ moved)
        return stored

    def _forces(self, state: State, loads: np.ndarray | None = None) -> list[np.ndarray]:
        """What each term adds to the residual at its nodes (n, 6); loads (L, 6): the same, known already."""
        if loads is not None:
            return [part.copy() for part in np.split(loads, self._cuts)]
        return [term(state, self.model.space, tangent=False).force[:, 0] for term in self._others]

    def _tabulate_forces(self) -> list[np.ndarray]:
        """Forces of each term at the present state; remembers their nodes."""
        state = replace(self.state, velocity=self.rates.v) if self._velocity_terms else self.state
        blocks = [term(state, self.model.space, tangent=False) for term in self._others]
        self._nodes = [b.nodes[:, 0] for b in blocks]
        self._cuts = np.cumsum([len(nodes) for nodes in self._nodes])[:-1]
        return [b.force[:, 0] for b in blocks]

    def _strains(self, state: State) -> tuple[np.ndarray, ...]:
        space = self.model.space
        return tuple(space.strain_and_frame(state, k)[0] for k in range(len(space.groups)))

    def _keep(self, iterations: int, residual: float) -> None:
        reactions = self.reactions_now()
        self.history.records.append(
            Record(self.state, reactions, iterations, residual, -1, self.rates, dict(self.work), self.pressed)
        )
        self.kept += 1

    def reactions_now(self) -> np.ndarray:
        """Force and moment (supports, 6) of the supports on the rods, in space."""
        return self.model.constraints.reactions(self.state, self.g)

    def _failure(self, solved: Solved, h: float) -> ConvergenceError:
        model = self.model
        rod = model.rods[model.space.node_rod[solved.where]]
        unseen = (
            "an impact stays unresolved" if self.model.contacts else "the error estimate stays above what rtol allows"
        )
        why = solved.reason or unseen
        self.history.status = "stopped"
        self.history.message = (
            f"run in time stopped at t = {self.state.t:g} s: a step of {h:.3g} s was still too long ({why}). Largest "
            f"residual at rod {rod.name!r}, s = {model.space.node_s[solved.where]:.4g} m. Try a smaller step or rtol, a "
            "smoother motion of the parts, or rho_inf nearer to 0."
        )
        return ConvergenceError(self.history.message, self.history, self.state)

    # stop and go on

    def checkpoint(self) -> Checkpoint:
        """Everything that the rest of the run depends on."""
        return Checkpoint(
            self.state, self.rates, self.h, self.wanted_h, dict(self.work),
            [*self.forces, *(told.load for told in self.pressed)], self.g,
            self.strain, self.strain_before, self.strain_step, self.kept, self.largest_energy, list(self.steps),
        )  # fmt: skip

    def restore(self, saved: Checkpoint) -> None:
        """Go back to a checkpoint of the same model."""
        self.state, self.rates, self.h, self.wanted_h = saved.state, saved.rates, saved.h, saved.wanted_h
        self.work, self.forces = dict(saved.work), saved.forces[: len(self._others)]
        self.g, self.kept = saved.residual, saved.kept
        self.strain, self.strain_before, self.strain_step = saved.strain, saved.strain_before, saved.strain_step
        self._tabulate_forces()
        self._start_contact()
        loads = saved.forces[len(saved.forces) - len(self.pressed) :]
        self.pressed = tuple(replace(told, load=load) for told, load in zip(self.pressed, loads, strict=True))
        self.largest_energy = saved.largest_energy
        self.steps[:] = saved.log


NOBODY = Driven(np.empty(0, dtype=np.int64), np.empty((0, 2, 3)), np.empty((0, 2, 3)))


def _merged(lists: Sequence[np.ndarray], slack: float) -> np.ndarray:
    """Times of all lists in order; of those closer than `slack` only the one of the earliest list."""
    kept: list[float] = []
    for t in np.concatenate(lists).tolist():
        k = bisect_left(kept, t - slack)
        if k == len(kept) or kept[k] > t + slack:
            insort(kept, t)
    return np.array(kept)


def _near(stops: np.ndarray, times: np.ndarray, slack: float) -> np.ndarray:
    """Which stops are one of these times."""
    return (np.abs(stops[:, None] - times[None]) <= slack).any(axis=1)


def _names(terms: Sequence[Any]) -> list[str]:
    """Names of terms, told apart."""
    names = [term.name for term in terms]
    return [n if names.count(n) == 1 else f"{n} {names[: k + 1].count(n)}" for k, n in enumerate(names)]


def _inside(lists: Sequence[np.ndarray], start: float, end: float) -> np.ndarray:
    every = np.unique(np.concatenate([*lists, np.empty(0)]))
    return every[(every > start) & (every <= end)]


def _driven_nodes(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (M,) whose rates a support gives, the support's row (M,), and what is given (M, 2): translation, rotation."""
    c = model.constraints
    followers = [k for k, row in enumerate(c.lead_row) if row >= 0]
    nodes = np.concatenate([c.support_node, c.nodes[c.n_supports :][followers]]).astype(np.int64)
    rows = np.concatenate([np.arange(c.n_supports), c.lead_row[followers]]).astype(np.int64)
    held = c.held[: c.n_supports][rows].reshape(-1, 2, 3)
    return nodes, rows, np.asarray(held.all(axis=2))


def _inertia(model: Model, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Inertia force (N, 6): (m a, J w' + w x J w)."""
    J = model.space.node_inertia
    force = np.empty_like(a)
    force[:, :3] = model.space.node_mass[:, None] * a[:, :3]
    force[:, 3:] = J * a[:, 3:] + np.cross(v[:, 3:], J * v[:, 3:])
    return force


def _accelerate(model: Model, state: State, g: np.ndarray, v: np.ndarray, a: np.ndarray, driven: Driven) -> None:
    """Fill a (N, 6) so that inertia balances the residual g; entries of driven nodes stand already.

    Node by node, because the mass is lumped; nodes that are one joint or held in part are solved together. A released
    component of a support on a turning part neglects the Coriolis acceleration in this first instant.
    """
    c, space = model.constraints, model.space
    gyroscopic = _inertia(model, v, np.zeros_like(a))
    rest = -(g + gyroscopic)
    diagonal = np.concatenate([np.repeat(space.node_mass[:, None], 3, axis=1), space.node_inertia], axis=1)
    free = rest / diagonal
    special = set(c.nodes.tolist()) | {int(k) for joint in c.joints for k in joint}
    ordinary = np.array([k for k in range(space.n_nodes) if k not in special], dtype=np.int64)
    a[ordinary] = free[ordinary]
    held = c.evaluate(state, c.targets(state.t))
    groups = [(row, int(node)) for row, node in enumerate(c.support_node)]
    groups += [(-1, int(joint[0])) for joint in c.joints if int(joint[0]) not in c.row_of]
    for row, lead in groups:
        members = [(lead, np.eye(6))]
        for k in np.flatnonzero(c.lead == lead):
            seen = np.eye(6)
            seen[3:, 3:] = c.seen[k]
            members.append((int(c.nodes[c.n_supports + k]), seen))
        T = np.eye(6) if row < 0 or not c.transforms else held.T[row]
        fixed = np.zeros(6, dtype=bool) if row < 0 else c.held[row]
        mass = sum(T.T @ P.T @ (diagonal[node][:, None] * P) @ T for node, P in members)
        force = sum(T.T @ P.T @ rest[node] for node, P in members)
        y = np.linalg.solve(T, a[lead])
        y[~fixed] = 0.0
        if (~fixed).any():
            y[~fixed] = np.linalg.solve(mass[np.ix_(~fixed, ~fixed)], (force - mass @ y)[~fixed])
        for node, P in members:
            a[node] = P @ T @ y
