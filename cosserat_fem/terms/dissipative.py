"""What takes energy out: internal damping of the rods, drag of a medium.

Rule: these terms act on velocities; in a static run they are zero. The velocity of a state is that of its nodes
(displacement in space, rotation in the section's axes), and state.slope says how much of it an increment of the unknowns
adds, which is all a tangent needs.

Internal damping is Kelvin-Voigt, stress C (strain - rest) + D strain rate, with the rate at the end of a step from three
states (BDF2). It is linear in the strain of that state, so a damped rod is an undamped one with stiffness C + D c and
another rest strain for the length of the step: no kernel knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import check_positive, check_shape
from ..kernels.rotation import matrix_from_quaternion
from ..rod import Rod
from ..schedule import Schedule
from ..space import Blocks, Group, Space, State, lanes
from .external import NO_LOADS, NodalLoads, check_rod


@dataclass(frozen=True, eq=False)
class Damping:
    """Damping of all rods, or of one: internal (Kelvin-Voigt) and in proportion to mass.

    Parameters
    ----------
    strains : (6,) [N s, N s, N s, N m^2 s, N m^2 s, N m^2 s]
        Stress per strain rate: shear 1, shear 2, stretch, bend 1, bend 2, twist.
    time : [s], optional
        Instead of `strains`: retardation time, D = time * C of each section.
    mass : [1/s]
        Force per momentum: -mass * m v and -mass * J w.
    rod : Rod, optional
        Only this one.
    """

    strains: Any = (0.0,) * 6
    time: float = 0.0
    mass: float = 0.0
    rod: Rod | None = None
    name: str = "damping"
    symmetric = True
    steady = True

    def __post_init__(self) -> None:
        strains = check_shape("damping: strains", self.strains, (6,))
        if (strains < 0).any():
            raise ValueError(f"damping: strains must be at least 0 (got {strains.min():g}).")
        object.__setattr__(self, "strains", strains)
        object.__setattr__(self, "time", check_positive("damping: time", self.time, zero=True))
        object.__setattr__(self, "mass", check_positive("damping: mass", self.mass, zero=True))
        if strains.any() and self.time:
            raise ValueError("damping: give strains or time, not both.")
        if self.rod is not None:
            check_rod("damping", self.rod)

    @property
    def internal(self) -> bool:
        """True if it damps strains."""
        return bool(self.strains.any()) or self.time > 0

    @property
    def needs_velocity(self) -> bool:
        return self.mass > 0

    @property
    def tabulated(self) -> bool:
        return self.mass == 0

    def table(self, t: float, space: Space) -> NodalLoads:
        """No load at nodes, without the part in proportion to mass."""
        return NO_LOADS

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        """The part in proportion to mass; the rest is in the rods' own stress."""
        nodes = np.arange(space.n_nodes) if self.rod is None else space[self.rod].nodes
        if state.velocity is None or not self.mass:
            return Blocks(nodes[:0, None], np.zeros((0, 1, 6)))
        inertia = np.concatenate([np.repeat(space.node_mass[nodes, None], 3, 1), space.node_inertia[nodes]], axis=1)
        force = self.mass * inertia * state.velocity[nodes]
        K = None
        if tangent:
            K = np.zeros((len(nodes), 6, 6))
            K[:, range(6), range(6)] = self.mass * state.slope * inertia
        return Blocks(nodes[:, None], force[:, None], K)

    def coefficients(self, space: Space, k: int) -> np.ndarray:
        """D (E, Q, 6, 6) at a group's Gauss points: the strains' on the diagonal, or time * C."""
        group = space.groups[k]
        D = np.zeros_like(group.stiffness)
        for rod, view in space.views.items():
            if view.group == k and self.rod in (None, rod):
                D[view.elements] = np.diag(self.strains) + self.time * group.stiffness[view.elements]
        return D


def damped_tables(
    group: Group, D: np.ndarray, now: np.ndarray, before: np.ndarray, h: float, h_before: float
) -> tuple[Any, ...]:
    """Tables of a group with damping D (E, Q, 6, 6) over a step of length h; strains now and h_before ago (E, Q, 6).

    Strain rate at the end = c (strain - past), c = (1 + 2 w) / ((1 + w) h), w = h / h_before.
    """
    w = h / h_before
    c = (1 + 2 * w) / ((1 + w) * h)
    past = ((1 + w) * now - w * w / (1 + w) * before) / (h * c)
    C = group.stiffness + c * D
    stress = _times(group.stiffness, group.reference) + c * _times(D, past)
    return _tables(group, C, np.linalg.solve(C, stress[..., None])[..., 0])


def tables_at_rate(group: Group, D: np.ndarray, rate: np.ndarray) -> tuple[Any, ...]:
    """Tables of a group whose strain rate (E, Q, 6) is known: the damping's stress as a change of the rest strain."""
    stress = _times(D, rate)
    return _tables(
        group, group.stiffness, group.reference - np.linalg.solve(group.stiffness, stress[..., None])[..., 0]
    )


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("eqij,eqj->eqi", matrices, vectors)


def _tables(group: Group, C: np.ndarray, rest: np.ndarray) -> tuple[Any, ...]:
    """`Group.tables` with another stiffness (E, Q, 6, 6) and rest strain (E, Q, 6)."""
    N_s, dx, _, C_full, _ = group.tables
    E, Q = group.dx.shape
    n_packs = len(group.packed_conn)
    diagonal = np.ascontiguousarray(np.diagonal(C, axis1=-2, axis2=-1))
    if C_full is not None:
        others = C.copy()
        others[..., range(6), range(6)] = 0.0
        C_full = lanes(others.reshape(E, Q, 36)).reshape(n_packs, Q, -1)
    return N_s, dx, lanes(diagonal).reshape(n_packs, Q, -1), C_full, lanes(rest).reshape(n_packs, Q, -1)


@dataclass(frozen=True, eq=False)
class Drag:
    """Force and moment of a medium per metre of one rod, linear and quadratic in the relative velocity.

    With v_n, v_t the parts of the velocity relative to the medium normal to and along the section normal d3:
    force = -(normal + normal_quadratic |v_n|) v_n - (tangential + tangential_quadratic |v_t|) v_t,
    moment = -(spin_normal (w1 d1 + w2 d2) + spin_tangential w3 d3), w the angular velocity of the section.

    Parameters
    ----------
    normal, tangential : [N s/m^2]
    normal_quadratic, tangential_quadratic : [N s^2/m^3]
        1/2 * density * drag coefficient * diameter; see `Drag.fluid`.
    spin_normal, spin_tangential : [N s]
    medium : (3,) [m/s], (times, values) or function of t
        Velocity of the medium in space.
    """

    rod: Rod
    normal: float = 0.0
    tangential: float = 0.0
    normal_quadratic: float = 0.0
    tangential_quadratic: float = 0.0
    spin_normal: float = 0.0
    spin_tangential: float = 0.0
    medium: Any = (0.0, 0.0, 0.0)
    name: str = "drag"
    symmetric = True
    needs_velocity = True
    _medium: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_rod("drag", self.rod)
        for name in (
            "normal", "tangential", "normal_quadratic", "tangential_quadratic", "spin_normal", "spin_tangential"
        ):  # fmt: skip
            object.__setattr__(self, name, check_positive(f"drag: {name}", getattr(self, name), zero=True))
        object.__setattr__(self, "_medium", Schedule("drag: medium", self.medium, (3,), jumps=True))

    @classmethod
    def fluid(
        cls,
        rod: Rod,
        *,
        density: float,
        diameter: float,
        normal: float = 1.2,
        tangential: float = 0.01,
        medium: Any = (0.0, 0.0, 0.0),
    ) -> Drag:
        """Quadratic drag of a round cable in a fluid: coefficients on the diameter, density [kg/m^3], diameter [m].

        Force per metre 1/2 density diameter C |v| v; C = 1.2 across a cylinder at Reynolds numbers 1e3 to 2e5
        (Hoerner, Fluid-Dynamic Drag, 1965, chapter 3).
        """
        head = 0.5 * check_positive("drag: density", density) * check_positive("drag: diameter", diameter)
        return cls(rod, normal_quadratic=head * normal, tangential_quadratic=head * tangential, medium=medium)

    @property
    def kinks(self) -> np.ndarray:
        """Times [s] at which the medium's velocity has a kink."""
        return self._medium.kinks

    @property
    def jumps(self) -> np.ndarray:
        """Times [s] at which the medium's velocity jumps."""
        return self._medium.jumps

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        nodes = space[self.rod].nodes
        medium = self._medium.at(state.t)  # a table that is too short is told also at rest
        if state.velocity is None:
            return Blocks(nodes[:0, None], np.zeros((0, 1, 6)))
        weights = space.remember(self, lambda: space.share(self.rod))
        R = matrix_from_quaternion(state.q[nodes])
        t, spin = R[:, :, 2], state.velocity[nodes, 3:]
        v = state.velocity[nodes, :3] - medium
        along = (v * t).sum(-1, keepdims=True)
        across = v - along * t
        speed = np.linalg.norm(across, axis=-1, keepdims=True)
        normal = self.normal + self.normal_quadratic * speed
        tangential = self.tangential + self.tangential_quadratic * np.abs(along)
        turning = np.array([self.spin_normal, self.spin_normal, self.spin_tangential])
        g = np.concatenate([normal * across + tangential * along * t, turning * spin], axis=1)
        if not tangent:
            return Blocks(nodes[:, None], (weights[:, None] * g)[:, None])
        steep = self.tangential + 2 * self.tangential_quadratic * np.abs(along)

        def change(d_along: np.ndarray, d_across: np.ndarray) -> np.ndarray:
            """Change of the force with those of both parts, the direction t standing still."""
            with np.errstate(invalid="ignore", divide="ignore"):
                d_speed = np.where(speed > 0, (across * d_across).sum(-1, keepdims=True) / speed, 0.0)
            return normal * d_across + self.normal_quadratic * d_speed * across + steep * d_along * t

        K = np.zeros((len(nodes), 6, 6))
        for j in range(3):
            e = np.eye(3)[j]
            d_along = t[:, j : j + 1]
            K[:, :3, j] = state.slope * change(d_along, e - d_along * t)
            dt = np.cross(R[:, :, j], t)  # of t, as the section turns about its axis j
            d_along = (v * dt).sum(-1, keepdims=True)
            K[:, :3, 3 + j] = change(d_along, -d_along * t - along * dt) + tangential * along * dt
            K[:, 3 + j, 3 + j] = state.slope * turning[j]
        return Blocks(nodes[:, None], (weights[:, None] * g)[:, None], weights[:, None, None] * K)
