"""Inertia of the rods in one time step.

Rule: mass and rotary inertia are lumped at the nodes (Gauss-Lobatto quadrature of the shape functions), so the mass
matrix is block-diagonal, gyroscopic moments are local to a node, and so are reactions. The kernel `kernels.inertia` is
the whole of it; this room prepares what it needs once for each step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..kernels.inertia import step_inertia, step_rates
from ..space import Space, State


def constants(rho: float) -> tuple[float, float, float, float]:
    """am, af, beta, gamma of generalized-alpha with spectral radius rho at infinity."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 - am + af
    return am, af, 0.25 * (gamma + 0.5) ** 2, gamma


@dataclass(frozen=True, eq=False)
class Rates:
    """Velocity v, acceleration a and the integrator's auxiliary acceleration b (N, 6): displacement in space, rotation
    in the section's axes [m/s, rad/s, m/s^2, rad/s^2]. Values, never changed in place."""

    v: np.ndarray
    a: np.ndarray
    b: np.ndarray


@dataclass(frozen=True, eq=False)
class Driven:
    """Nodes (M,) whose rates are given, with v, a (M, 2, 3) for translation and rotation, nan where they are not."""

    nodes: np.ndarray
    v: np.ndarray
    a: np.ndarray


NO_FORCE = np.empty((0, 6))


class InertiaStep:
    """Inertia, velocity and acceleration at the end of a step of length h from a state with given rates.

    coefficients : h, alpha_m, alpha_f, beta, gamma of the generalized-alpha method
    wanted : True if a term asks for the velocity
    tables : of rods with internal damping, else None
    shared (N, 6) : force of contact in the step, once it is known
    push, late, counted : how contact enters, see `impact`
    """

    def __init__(
        self,
        space: Space,
        state: State,
        rates: Rates,
        coefficients: np.ndarray,
        driven: Driven,
        *,
        wanted: bool,
        tables: list[tuple[Any, ...]] | None = None,
    ) -> None:
        self.space, self.start, self.rates, self.coefficients = space, state, rates, coefficients
        self.driven, self.wanted, self.tables = driven, wanted, tables
        h, am, af, beta, gamma = coefficients
        self.slope = gamma / (beta * h)
        self.grows = (1 - am) / ((1 - af) * beta * h * h)  # of an acceleration with an increment
        self.heaviest = (self.grows * space.heaviest[0], self.grows * space.heaviest[1])
        self.counted = (1 - am) / ((1 - af) * gamma)
        self.push, self.late = NO_FORCE, 1.0
        self.D, self.v, self.a, self.b = np.empty((4, space.n_nodes, 6))
        self.shared = NO_FORCE

    def again(self) -> InertiaStep:
        """The same step with arrays of its own, to be evaluated without changing what this one found."""
        same = InertiaStep(
            self.space, self.start, self.rates, self.coefficients, self.driven, wanted=self.wanted, tables=self.tables
        )
        same.push, same.late = self.push, self.late
        return same

    def with_velocity(self, state: State) -> State:
        """The state with the velocity that the step gives it."""
        step_rates(
            state.r - self.start.r, self.start.q, state.q, self.rates.v, self.rates.a, self.rates.b, self.coefficients,
            self.driven.nodes, self.driven.v.reshape(-1, 6), self.driven.a.reshape(-1, 6), self.D, self.v, self.a, self.b,
        )  # fmt: skip
        return replace(state, velocity=self.v, slope=self.slope) if self.wanted else state

    def add(self, state: State, g: np.ndarray, nodal: np.ndarray) -> tuple[float, float]:
        """Add the inertia force to g (N, 6) and its tangent to nodal; `with_velocity` was asked at the same state."""
        return step_inertia(
            self.space.node_mass, self.space.node_inertia, self.D, self.v, self.a, self.coefficients, g, nodal
        )
