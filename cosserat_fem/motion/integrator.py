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

How contact enters a step is `impact`'s. With contact every step is held against its ledger: one in which contact adds
energy, or takes more than a little, because the barrier is not resolved, is made again shorter. `AdaptiveStep` besides
follows every wave that an impact sends along a rod; where these do not matter, or there is
nothing to damp them, `FixedStep` is the choice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import ConvergenceError, SceneError
from ..history import History
from ..iteration.compiled import Moving
from ..iteration.newton import Newton, Solved
from ..kernels.inertia import largest_change
from ..model import Model
from ..record import Record
from ..space import State
from ..terms.dissipative import damped_tables, tables_at_rate
from ..terms.inertial import InertiaStep, Rates, constants
from ..terms.touch import Pressed
from .impact import Impact
from .ledger import Ledger
from .rates import NOBODY, Balance
from .steps import AdaptiveStep, FixedStep
from .stops import Stops, steps_to

TOLERANCE = 1e-9  # relative residual of a time step
GROWTH = 4.0  # a step longer than this many of the last one starts with b = a
PLAIN_ESTIMATE = 0.3  # in parts of the allowed error: below it the estimate is good enough as it is
# rad in a step; the rotation vector of a step is unique below pi, and near that another state solves the step as well
LARGEST_TURN, FLIPPED = 2.0, 2.5
LONGER, SAFETY = 1.5, 0.8  # growth of a step; aim at this part of the step that would just be allowed
TOGETHER = 20_000  # steps times nodes in one compiled call: a run can be interrupted between calls
SHORT = 1e-3  # part of a step over which a strain rate is measured
BEFORE = 1e-13  # of the duration: how long before a jump of a load the step that ends there is evaluated


@dataclass(frozen=True, eq=False)
class Made:
    """A converged step that may be taken: outcome with contact renewed, rates, works [J] in it, forces of terms, strains of
    damped rods, energies in contact terms, energy that contact added."""

    solved: Solved
    rates: Rates
    work: dict[str, float]
    forces: list[np.ndarray]
    strain: tuple[np.ndarray, ...]
    stored: list[float]
    added: float


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
    added: float = 0.0
    lasts: np.ndarray | None = None
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
        self._method = am, af, beta, _ = constants(rho)
        self._constant = abs(beta + 0.5 * (am - af) - 1 / 6)
        self.history = History(model, rho_inf=rho)
        self.newton = Newton(model)
        self.history.counters = self.newton.counters
        self.steps = self.history.steps
        self.kept = 0
        self.strain: tuple[np.ndarray, ...] = ()
        self.strain_before: tuple[np.ndarray, ...] = ()
        self.strain_step = 0.0
        self.balance, approach = Balance(model), self.newton.approach
        self.impact = Impact(model, self.balance) if model.contacts else None
        self.ledger = None if approach is None or self.impact is None else Ledger(model, approach, self.impact)
        self._others = [term for term in model.terms if term not in model.contacts]
        names = dict(zip(model.terms, _names(model.terms), strict=True))
        self._names = [names[term] for term in self._others]
        self._contact_names = [names[term] for term in model.contacts]
        self._velocity_terms = any(getattr(term, "needs_velocity", False) for term in model.terms)
        self._compiled = self.newton.compiled
        self._dampers = [term for term in model.terms if getattr(term, "internal", False)]
        self._damping = [
            np.sum([d.coefficients(model.space, k) for d in self._dampers], axis=0)  # type: ignore[attr-defined]
            for k in range(len(model.space.groups))
        ]
        self._stops = Stops(model, t, end, times)

    @property
    def t(self) -> float:
        return self.state.t

    @property
    def pressed(self) -> tuple[Pressed, ...]:
        """What contact does at the present state."""
        return () if self.ledger is None else self.ledger.pressed

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
        if self.ledger is not None:
            self.ledger.open(self.state, velocity)
        self.h = self.wanted_h = self._first_step()
        self.work = dict.fromkeys((*self._names, *self._contact_names, "driven ends"), 0.0)
        if self._dampers:
            self.work["internal damping"] = 0.0
        self._settle(told=told)
        if self.times is None or abs(self.times[0] - self.begin_time) <= self._stops.near:
            self._keep(0, 0.0)

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
        model = self.model
        v, a = self.rates.v.copy(), np.zeros_like(self.rates.v)
        jumps = self.balance.match(self.state, v, a, self.end - self.begin_time)
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
        self.balance.accelerate(state, g, v, a)
        self.g = g + self.balance.inertia(v, a)
        self.rates = Rates(v, a, a.copy())
        if self.impact is not None:
            everywhere = np.ones(a.shape, dtype=bool)  # these accelerations have contact at every node
            self.rates, self.grip = self.impact.feel(self.state, self.rates, everywhere)
        self.forces = self._tabulate_forces()

    # steps

    def go(self) -> History:
        """Step to the end."""
        slack = 1e-12 * (self.end - self.begin_time)
        try:
            while self.state.t < self.end - slack:
                if not self._advance_together():
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

    def _advance_together(self) -> bool:
        """Steps of fixed length in one compiled call, as far as nothing else happens; False if none was made.

        With a callback up to the next state that is kept.
        """
        if self._compiled is None or not self._compiled.runs or isinstance(self.step, AdaptiveStep) or self._dampers:
            return False
        plan = self._plan()
        if len(plan) < 2:
            return False
        loads = np.concatenate(self.forces) if self.forces else np.empty((0, 6))
        c, nodes = self.model.constraints, self.balance.nodes
        try:
            made, counts, found = self._compiled.run(
                Moving(self.state, self.rates, self.g, loads, self.h), plan, self._method, TOLERANCE,
                lambda t: self.balance.driven(*c.driven(t, before=True)) if len(nodes) else NOBODY,
            )  # fmt: skip
        except ValueError:  # something has no value at a later step: go there one by one
            return False
        self.newton.count(*counts)
        self.steps += [(t, h, 0.0, True) for t, h, _ in plan[:made]]
        before = dict(self.work)
        for now in found:
            self.state, self.rates, self.g, self.h = now.state, now.rates, now.g, now.h
            begin = 0
            for name, end in zip(self._names, [*self._cuts, len(now.work) - 1], strict=False):
                self.work[name] = before[name] + float(now.work[begin:end].sum())
                begin = end
            self.work["driven ends"] = before["driven ends"] + float(now.work[-1])
            if now.keeps:
                self._keep(now.iterations, now.residual)
        if found:
            self.forces = self._forces(self.state, found[-1].loads)
        return made > 0

    def _plan(self) -> list[tuple[float, float, bool]]:
        """Steps of the wanted length up to the next kink or jump: time at the end, length, whether the state is kept."""
        plan: list[tuple[float, float, bool]] = []
        t, most = self.state.t, max(1, TOGETHER // self.model.space.n_nodes)
        for stop in self._stops.after(t):
            n = 2
            while n > 1 and len(plan) < most:
                left = stop.t - t
                n = steps_to(left, self.wanted_h)
                if n == 1 and (stop.jumps or stop.settles):
                    return plan
                t = stop.t if n == 1 else t + left / n
                kept = stop.keeps if n == 1 else self._stops.every
                plan.append((t, left / n, kept))
                if kept and self.callback is not None:
                    return plan
            if len(plan) >= most:
                break
        return plan

    def _advance(self) -> None:
        """One accepted step."""
        fastest = float(np.abs(self.rates.v[:, 3:]).max())
        wanted = min(self.wanted_h, LARGEST_TURN / max(fastest, 1e-300))
        approach, ledger = self.newton.approach, self.ledger
        if approach is not None and ledger is not None and not any(ledger.stored):
            self.state = approach.harden(self.state, ledger.striking(self.state, self.rates.v))
        late = 0.0
        while True:
            stop = next(self._stops.after(self.state.t))
            left = stop.t - self.state.t
            n = steps_to(left, wanted)
            h = left / n
            t1, jumps, settles, keeps = stop if n == 1 else (self.state.t + h, False, False, self._stops.every)
            at = min(t1 - BEFORE * (self.end - self.begin_time), np.nextafter(t1, -np.inf)) if jumps else t1
            solved, inertia = self._try(
                h, at, late or (1.0 if self.impact is None else self.impact.late(self.grip, self.rates.v, h))
            )
            error = 0.0
            if solved.converged and isinstance(self.step, AdaptiveStep):
                error = self._error(solved, inertia, h)
            accepted = solved.converged and error <= 1.0
            if accepted:
                made = self._make(solved, inertia, h, t1)
                accepted = ledger is None or not ledger.refuses(made.solved, made.rates, made.stored, made.added)
            self.steps.append((t1, h, error, accepted))
            if accepted:
                break
            if solved.converged and error <= 1.0 and made.added > 0.0 and inertia.late < 1.0:
                late = 1.0  # adds nothing, whatever the step
                continue
            shortest = (
                self.step.dt / (64 if not self.model.contacts else 1e7) if isinstance(self.step, FixedStep) else 0.0
            )
            if not solved.converged and h < shortest:
                raise self._failure(solved, h)
            if approach is not None and ledger is not None and (not solved.converged or error <= 1.0):
                if solved.converged or approach.overrun(solved.state):  # something else hits
                    self.state = ledger.brace(self.state, self.rates.v)
                elif self.grip.steady:
                    # the force goes on from what it was: at the end of the step the rod lies a little deeper
                    self.state = approach.relax(self.state, ledger.pressed)
                    ledger.stored = ledger.stored_at(self.state)
            wanted = h * (0.25 if not solved.converged or error <= 1.0 else max(0.2, SAFETY * error**-0.5))
            if wanted < self._stops.near:
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
        error = scale * largest_change(inertia.rates.b, inertia.b, self.balance.nodes, length)
        if error < PLAIN_ESTIMATE:
            return error
        mass = np.concatenate([np.repeat(model.space.node_mass[:, None], 3, 1), model.space.node_inertia], axis=1)
        # what the step's own matrix makes of the change, as of a load
        load = inertia.grows * mass * (inertia.b - inertia.rates.b)
        change = self.newton.response(solved.state, load, step=inertia.again())
        return min(error, scale * largest_change(np.zeros_like(change), change, self.balance.nodes, length))

    def _try(self, h: float, t1: float, late: float) -> tuple[Solved, InertiaStep]:
        model = self.model
        rates = self.rates
        if h != self.h:  # b belongs to a time that lies am - af steps beyond the state
            grown = h / self.h if h <= GROWTH * self.h else 0.0
            rates = Rates(rates.v, rates.a, rates.a + grown * (rates.b - rates.a))
        driven = self.balance.driven(*model.constraints.driven(t1, before=True)) if len(self.balance.nodes) else NOBODY
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
        offset = None if self.impact is None else self.impact.enter(inertia, self.grip, late)
        for acceleration in (0.5, 0.0):  # unresolved vibrations make b a bad guess
            guess = h * rates.v + acceleration * h * h * rates.b
            if acceleration > 0.0 and np.abs(guess[:, 3:]).max() > LARGEST_TURN:
                continue
            solved = self._solve(guess, t1, inertia, offset)
            if solved.converged and np.abs(inertia.D[:, 3:]).max() > FLIPPED:
                solved = replace(solved, reason=f"a section turns by more than {FLIPPED:g} rad in a step")
            if solved.converged:
                break
        if solved.converged and self.impact is not None:
            solved = self.impact.leave(inertia, self.grip, solved)
        return solved, inertia

    def _solve(self, D: np.ndarray, t1: float, inertia: InertiaStep, offset: np.ndarray | None) -> Solved:
        """The step from the prediction D (N, 6)."""
        model = self.model
        stress = model.internal.extrapolate(self.state, model.space, D, 1.0, inertia.tables)
        if self.newton.approach is not None:
            start = self.state.at_time(t1)
            guess, part = self.newton.approach.move(start, D, 1.0, stiffen=False)
            memory = tuple(a + part * (b - a) for a, b in zip(start.stress, stress, strict=True))
            return self.newton.in_time(replace(guess, stress=memory), inertia, TOLERANCE, part * D[:, :3], offset)
        guess = model.space.update(self.state, D, 1.0, stress).at_time(t1)
        return self.newton.in_time(guess, inertia, TOLERANCE, D[:, :3])

    def _make(self, solved: Solved, inertia: InertiaStep, h: float, t1: float) -> Made:
        """What a converged step does, before it is taken: works, forces and memories."""
        loads = None if self._compiled is None else self._compiled.loads
        solved = self.newton.accepted(solved, in_time=True)
        work = dict.fromkeys(self.work, 0.0)
        stored: list[float] = []
        added = 0.0
        if self.ledger is not None:
            done, stored, added = self.ledger.step(self.state, solved, inertia, self.grip, t1)
            work.update(zip(self._contact_names, done, strict=True))
        state = replace(solved.state, velocity=inertia.v) if inertia.wanted else solved.state
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
        return Made(solved, Rates(inertia.v, inertia.a, inertia.b), work, forces, strain, stored, added)

    def _accept(self, made: Made, h: float) -> None:
        """Take the step."""
        for name, done in made.work.items():
            self.work[name] += done
        if self._dampers:
            self.strain_before, self.strain, self.strain_step = self.strain, made.strain, h
        self.state, self.g, self.forces = made.solved.state, made.solved.total.g, made.forces
        self.rates, self.h = made.rates, h
        if self.ledger is not None:
            self.ledger.take(made.solved, made.stored, made.added)
        if self.impact is not None:
            self.rates, self.grip = self.impact.feel(self.state, self.rates, self.grip.lasts)

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
            self.forces, self.g,
            self.strain, self.strain_before, self.strain_step, self.kept,
            *((0.0, 0.0) if self.ledger is None else (self.ledger.largest, self.ledger.added)),
            None if self.impact is None else self.grip.lasts, list(self.steps),
        )  # fmt: skip

    def restore(self, saved: Checkpoint) -> None:
        """Go back to a checkpoint of the same model."""
        self.state, self.rates, self.h, self.wanted_h = saved.state, saved.rates, saved.h, saved.wanted_h
        self.work, self.forces = dict(saved.work), saved.forces
        self.g, self.kept = saved.residual, saved.kept
        self.strain, self.strain_before, self.strain_step = saved.strain, saved.strain_before, saved.strain_step
        self._tabulate_forces()
        if self.ledger is not None:
            self.ledger.open(self.state, self.rates.v)
            self.ledger.largest, self.ledger.added = saved.largest_energy, saved.added
        if self.impact is not None and saved.lasts is not None:
            _, self.grip = self.impact.feel(self.state, self.rates, saved.lasts)
            self.grip = replace(self.grip, lasts=saved.lasts)
        self.steps[:] = saved.log


def _names(terms: Sequence[Any]) -> list[str]:
    """Names of terms, told apart."""
    names = [term.name for term in terms]
    return [n if names.count(n) == 1 else f"{n} {names[: k + 1].count(n)}" for k, n in enumerate(names)]
