"""How does one step along a path of equilibria go, past points where the load or the time must turn back?

Rule: the unknowns are the state and one value: a factor on loads, or the time at which parts stand. Each iteration is
that of the mixed Newton method with two right-hand sides, the residual and its derivative with the value; a combination
of the two solutions stays in the plane normal to the last direction of the path. What is solved is never bordered, so the
linear solver and its count of negative eigenvalues are those of every other run.

Lengths along a path: mean square of rotations and of displacements in rod lengths, and the value times a scale such that
at the start of a path both count the same. A step that turns the direction by more than WIDEST_TURN is halved.

Limit points are zeros of the value's rate. Bifurcation points are zeros of the eigenvalue of the tangent nearest to zero,
with the sign that the count of negative eigenvalues gives it. Both are found as roots over the length of the step.

Source: Riks (1979), doi 10.1016/0020-7683(79)90081-7; Keller (1977); with the mixed method Magisano, Leonetti, Garcea
(2017), doi 10.1002/nme.5319.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..constraint import Held
from ..errors import KardanError
from ..kernels.nodes import largest_increment
from ..kernels.rotation import relative_rotation
from ..model import Model, Sum
from ..record import CriticalPoint
from ..space import State
from ..terms import Term
from .newton import RESIDUAL, STAGNANT, Newton

SHIFT = 1e-9  # weight of the diagonal shift that keeps a rod that spins freely from counting by its round-off
ITERATIONS = 14
LARGEST_ITERATE = 1.5  # rad in one iteration
WIDEST_TURN = np.cos(0.6)  # between the directions at the ends of a step
LONGEST, FIRST, SHORTEST = 0.25, 0.05, 1e-7  # lengths of steps
WANTED = 5  # iterations of a step of the right length
INVERSE_ITERATIONS = 8
DIFFERENCE = 1e-6  # of a run's span, for derivatives with time
LOCATED = 1e-5  # part of a step to which a critical point is closed in before it is interpolated
NEAR = 1e-3  # part of a step that may be left where the iteration fails so near to the point
BESIDE = 1e-3  # part of a step beside a critical point where its two sides are looked at


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a path, and the unit direction in which it goes on: increments du (N, 6) and rate of the value."""

    state: State
    value: float
    du: np.ndarray
    rate: float
    negative: int
    reactions: np.ndarray
    iterations: int
    residual: float


class Parameter(Protocol):
    """What changes along a path."""

    first: float  # values outside of which nothing is known
    last: float

    def model(self, value: float) -> Model: ...

    def placed(self, state: State, value: float) -> State: ...

    def residual_rate(self, state: State, value: float) -> np.ndarray: ...

    def gap_rate(self, state: State, value: float, held: Held) -> np.ndarray: ...


class LoadFactor:
    """A factor on loads, at one time."""

    first, last = -np.inf, np.inf

    def __init__(self, model: Model, loads: Sequence[Term]) -> None:
        self.whole, self.loads = model, tuple(loads)
        self.alone = model.with_terms(self.loads)

    def model(self, value: float) -> Model:
        """The model under the loads times the value."""
        return self.whole.with_factor(value, self.loads)

    def placed(self, state: State, value: float) -> State:
        """A state says its time, not its loads."""
        return state

    def residual_rate(self, state: State, value: float) -> np.ndarray:
        """Derivative (N, 6) of the residual with the value."""
        return self.alone.external(state, tangent=False).g

    def gap_rate(self, state: State, value: float, held: Held) -> np.ndarray:
        """Derivative (M, 6) of the gaps of the supports."""
        return np.zeros_like(held.gap)


class Time:
    """The time at which parts stand and loads act, from one time to another."""

    def __init__(self, model: Model, first: float, last: float) -> None:
        self.whole, self.first, self.last = model, first, last
        self.h = DIFFERENCE * (last - first)

    def model(self, value: float) -> Model:
        """Always the same."""
        return self.whole

    def placed(self, state: State, value: float) -> State:
        """The state at that time."""
        return state.at_time(value)

    def _around(self, value: float) -> tuple[float, float]:
        a = min(max(value - self.h, self.first), self.last - self.h)
        return a, a + self.h

    def residual_rate(self, state: State, value: float) -> np.ndarray:
        """Derivative (N, 6) of the residual with the value."""
        a, b = (self.whole.external(state.at_time(t), tangent=False).g for t in self._around(value))
        return (b - a) / self.h

    def gap_rate(self, state: State, value: float, held: Held) -> np.ndarray:
        """Derivative (M, 6) of the gaps of the supports."""
        c = self.whole.constraints
        a, b = (c.evaluate(state, c.targets(t)).gap for t in self._around(value))
        return (b - a) / self.h


class Path:
    """Steps along one path of equilibria of a model.

    Parameters
    ----------
    newton : Newton
        Of the whole model.
    parameter : LoadFactor or Time
    """

    def __init__(self, newton: Newton, parameter: Parameter) -> None:
        self.newton, self.parameter = newton, parameter
        model = newton.model
        share = np.empty(model.space.n_nodes)
        for rod in model.rods:
            share[model.space[rod].nodes] = model.space.share(rod)
        share /= share.sum()
        self.weights = np.repeat(share[:, None], 6, axis=1)
        self.weights[:, :3] /= model.scales["length"] ** 2
        self.scale = 0.0  # length of a unit of the value
        self.shortest = SHORTEST
        bending = np.concatenate([g.stiffness[..., (3, 4, 5), (3, 4, 5)].ravel() for g in model.space.groups])
        self.shift = SHIFT * float(bending.min() / bending.max())
        self.reason = ""  # why the last step failed

    def begin(self, state: State, value: float, towards: float) -> Point:
        """The start of a path, from an equilibrium, in the direction in which the value goes towards another."""
        start = Point(
            state, value, np.zeros((len(state.r), 6)), float(np.sign(towards - value)), -1, np.empty(0), 0, 0.0
        )
        self.scale = 1.0 / abs(towards - value)
        return self._end(start, state, value, 0, 0.0, first=True)

    def length(self, du: np.ndarray, rate: float, other: np.ndarray, other_rate: float) -> float:
        """Inner product of two directions."""
        return float((self.weights * du * other).sum() + self.scale**2 * rate * other_rate)

    def apart(self, a: State, b: State) -> float:
        """Length between two states, without the value."""
        du = np.empty_like(self.weights)
        du[:, :3] = b.r - a.r
        du[:, 3:] = relative_rotation(a.q, b.q)
        du *= du
        return math.sqrt(np.vdot(self.weights, du))

    def predicted(self, point: Point, ds: float) -> tuple[State, float]:
        """State and value a length ds further in the direction of a point."""
        model, value = self.newton.model, point.value + ds * point.rate
        du = ds * point.du
        stress = model.internal.extrapolate(point.state, model.space, du, 1.0)
        return self.parameter.placed(model.space.update(point.state, du, 1.0, stress), value), value

    def step(self, point: Point, ds: float) -> Point | None:
        """The point of the path in the plane a length ds further; None if it was not found, and `reason` says why."""
        newton, parameter, c = self.newton, self.parameter, self.newton.model.constraints
        moments = np.zeros((c.n_supports, 3)) if c.tilted else None
        before, small, self.reason = np.inf, False, ""
        try:
            state, value = self.predicted(point, ds)
            for k in range(ITERATIONS + 1):
                if not parameter.first <= value <= parameter.last:
                    self.reason = "the path leaves the span of time that it was given"
                    return None
                model = parameter.model(value)
                total = model.condensed(state, newton.linear.scratch, self.shift, None)
                if c.tilted:
                    moments = c.reactions(state, total.g)[:, 3:]
                held = c.evaluate(state, c.targets(state.t), moments)
                residual, _ = newton.measure(state, total, held, None, RESIDUAL)
                met = residual <= 1.0 or (small and 0.5 * before < residual <= STAGNANT)
                if k > 0 and met and newton.closed(held):
                    return self._end(point, state, value, k, RESIDUAL * residual)
                du, change = self._increment(point, model, state, value, total, held)
                shift, turn, bad = largest_increment(du)
                if bad >= 0 or not np.isfinite(change) or turn > LARGEST_ITERATE:
                    break
                stress = model.internal.extrapolate(state, model.space, du, 1.0)
                value += change
                state = parameter.placed(model.space.update(state, du, 1.0, stress), value)
                small = turn < 1e-3 and shift < 1e-3 * model.scales["length"]
                before = residual
        except KardanError as error:
            self.reason = str(error)
            return None
        self.reason = "the iteration along the path does not converge"
        return None

    def at(self, point: Point, value: float) -> Point | None:
        """The point of the path at a given value, if it is near; None if it was not found."""
        ds = (value - point.value) / point.rate
        state, _ = self.predicted(point, ds)
        solved = self.newton.on(self.parameter.model(value)).plain(self.parameter.placed(state, value))
        if not solved.converged or self.apart(point.state, solved.state) > 1.5 * abs(ds) + 1e-6:
            self.reason = solved.reason or "the solution found is not near"
            return None
        return self._end(point, solved.state, value, solved.iterations, solved.residual)

    def advance(self, point: Point, ds: float, until: float) -> tuple[Point | None, float]:
        """A step of about the length ds, but not past the value `until`; None if none was found. And the next length."""
        while ds >= self.shortest:
            to_end = (until - point.value) / point.rate if point.rate else -1.0
            landing = 0.0 < to_end <= ds * (1 + 1e-9)
            new = self.at(point, until) if landing else self.step(point, ds)
            if new is not None and self._smooth(point, new):
                passed = (new.value - until) * (point.value - until) < 0.0
                if not passed:
                    self.newton.counters.load_steps += 1
                    change = min(2.0, max(0.5, (WANTED / max(new.iterations, 1)) ** 0.5))
                    return new, min(ds * change, LONGEST)
            self.newton.counters.bisections += 1
            ds *= 0.5
        return None, ds

    def _smooth(self, point: Point, new: Point) -> bool:
        """True if the direction of the path has turned little."""
        return self.length(point.du, point.rate, new.du, new.rate) > WIDEST_TURN

    def _increment(
        self, point: Point, model: Model, state: State, value: float, total: Sum, held: Held
    ) -> tuple[np.ndarray, float]:
        """Increment of state and value that lies in the plane normal to the direction of a point."""
        linear = self.newton.linear
        self.newton.counters.iterations += 1
        g = total.g.copy()
        solution = linear.solve(state, g, held, total.negative, total.symmetric, total.whole)
        counted = self.newton.counters.linear
        counted[solution.method] = counted.get(solution.method, 0) + 1
        a = solution.du.copy()
        b = self._response(model, state, value, held, g)[0]
        along = self.length(point.du, point.rate, b, 1.0)
        change = -self.length(point.du, point.rate, a, 0.0) / along
        return a + change * b, change

    def _response(self, model: Model, state: State, value: float, held: Held, g: np.ndarray) -> tuple[np.ndarray, int]:
        """Derivative (N, 6) of the state with the value, and the number of negative eigenvalues of the tangent."""
        rate = self.parameter.residual_rate(state, value)
        rates = replace(held, gap=self.parameter.gap_rate(state, value, held))
        total = model.condensed(state, self.newton.linear.scratch, self.shift, rate - g)
        solution = self.newton.linear.solve(state, total.g, rates, total.negative, total.symmetric, total.whole)
        negative = solution.negative if solution.singular < 0 else -1
        return solution.du.copy(), negative

    def _end(
        self, point: Point, state: State, value: float, iterations: int, residual: float, *, first: bool = False
    ) -> Point:
        """A point at an equilibrium, with the direction that goes on from the one of the point before it."""
        model = self.parameter.model(value)
        c = model.constraints
        state = replace(state, stress=model.internal.with_stress(state, model.space))
        g = model.residual(state).g
        reactions = c.reactions(state, g)
        held = c.evaluate(state, c.targets(state.t), reactions[:, 3:])
        b, negative = self._response(model, state, value, held, g)
        if first:
            size = np.sqrt((self.weights * b * b).sum())
            self.scale = max(float(size), 1e-6 * self.scale)
        norm = np.sqrt(self.length(b, 1.0, b, 1.0))
        if not np.isfinite(norm):  # at a critical point itself
            return Point(state, value, point.du, point.rate, negative, reactions, iterations, residual)
        norm *= np.sign(self.length(point.du, point.rate, b, 1.0)) or 1.0
        return Point(state, value, b / norm, 1.0 / norm, negative, reactions, iterations, residual)

    def critical(self, point: Point, new: Point) -> list[CriticalPoint]:
        """Critical points between two points of a path, the second found by a step from the first."""
        last = (self.reach(point, new), new)
        cuts: list[tuple[float, Point]] = [(0.0, point)]
        events: list[CriticalPoint] = []
        if point.rate * new.rate < 0.0:
            root = self._root(point, cuts[0], last, lambda p: p.rate / point.rate)
            if root is not None:
                s, p = root
                sides = [(s + k * BESIDE * last[0], self.step(point, s + k * BESIDE * last[0])) for k in (-1, 1)]
                counts = [q.negative if q is not None else -1 for _, q in sides]
                shape = p.du / np.sqrt((self.weights * p.du**2).sum())
                events.append(CriticalPoint("limit", p.value, p.state.t, p.state, shape, *counts))
                cuts += [(s, q) for s, q in sides if q is not None]
        cuts.append(last)
        for low, high in zip(cuts[::2], cuts[1::2], strict=False):
            events += self._bifurcations(point, low, high)
        return events

    def _bifurcations(self, point: Point, low: tuple[float, Point], high: tuple[float, Point]) -> list[CriticalPoint]:
        """Where the count of negative eigenvalues changes between two points, both found by a step from a third."""
        events: list[CriticalPoint] = []
        first = high[0] - low[0]
        while min(low[1].negative, high[1].negative) >= 0 and low[1].negative != high[1].negative and len(events) < 6:
            count = low[1].negative

            def signed(p: Point, count: int = count) -> float:
                return abs(self.softest(p)[0]) * (1.0 if p.negative == count else -1.0)

            root = self._root(point, low, high, signed)
            if root is None:
                break
            s, p = root
            beyond, after = s + BESIDE * first, None
            if beyond < high[0]:
                after = self.step(point, beyond)
            low = high if after is None else (beyond, after)
            shape = self.softest(p)[1]
            events.append(CriticalPoint("bifurcation", p.value, p.state.t, p.state, shape, count, low[1].negative))
        return events

    def _root(
        self, point: Point, low: tuple[float, Point], high: tuple[float, Point], f: Callable[[Point], float]
    ) -> tuple[float, Point] | None:
        """Length and point, between two points found by steps from a third, at which a function of points is zero.

        The root is closed in from both sides: at a bifurcation itself the iteration along the path does not converge.
        """
        (a, p), (b, q) = low, high
        fa, fb = f(p), f(q)
        if not fa * fb < 0.0:
            return None
        width, first = np.inf, b - a
        for _ in range(40):
            if b - a <= LOCATED * first and abs(q.value - p.value) <= LOCATED * abs(q.value):
                break
            c = a - fa * (b - a) / (fb - fa) if b - a < 0.5 * width else 0.5 * (a + b)
            width = b - a
            around = [min(max(c + k * 0.05 * width, a + 0.01 * width), b - 0.01 * width) for k in (-1, 1)]
            tried = [(s, self.step(point, s)) for s in around]
            if any(new is None for _, new in tried):
                break
            for s, new in tried:
                value = f(new)  # type: ignore[arg-type]
                if value * fa > 0.0 and a < s < b:
                    a, fa, p = s, value, new  # type: ignore[assignment]
                elif value * fa <= 0.0 and s < b:
                    b, fb, q = s, value, new  # type: ignore[assignment]
        if b - a > NEAR * first:
            return None
        part = fa / (fa - fb)
        near = p if part < 0.5 else q
        return a + part * (b - a), replace(near, value=p.value + part * (q.value - p.value))

    def reach(self, point: Point, new: Point) -> float:
        """Length of the step from a point whose plane holds another."""
        du = np.concatenate([new.state.r - point.state.r, relative_rotation(point.state.q, new.state.q)], axis=1)
        return self.length(point.du, point.rate, du, new.value - point.value)

    def softest(self, point: Point, seed: int = 0) -> tuple[float, np.ndarray]:
        """Eigenvalue of the tangent nearest to zero, relative to the weights of lengths, and its motion (N, 6).

        Inverse iteration from a seeded start. Of several motions with one eigenvalue the seed chooses.
        """
        model, c = self.parameter.model(point.value), self.newton.model.constraints
        state = point.state
        g = model.residual(state).g
        held = c.evaluate(state, c.targets(state.t), point.reactions[:, 3:])
        held = replace(held, gap=np.zeros_like(held.gap))
        v = np.random.default_rng(seed).normal(size=(len(state.r), 6))
        value = np.inf
        for _ in range(INVERSE_ITERATIONS):
            v /= np.sqrt((self.weights * v * v).sum())
            total = model.condensed(state, self.newton.linear.scratch, self.shift, -self.weights * v - g)
            w = self.newton.linear.solve(state, total.g, held, total.negative, total.symmetric, total.whole).du
            size = (self.weights * w * w).sum()
            if not 0.0 < size < np.inf:
                return 0.0, v
            old, value = value, float((self.weights * v * w).sum() / size)
            v = w.copy()
            if abs(value - old) < 1e-3 * abs(value):
                break
        return value, v / np.sqrt((self.weights * v * v).sum())
