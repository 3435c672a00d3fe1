"""Loads: weight, line loads, point loads; dead or following the rod, constant or over time.

Rule: every load acts at nodes. A line load is integrated with the shape functions (which for a constant load gives the
Gauss-Lobatto weights); directions that depend on the rod are taken at the nodes, where the rotation is known exactly.
That keeps tangents local to a node and the order of accuracy of the element (2 p at the nodes, p the degree).

With h_j the spatial axis about which unknown j turns the section (directors for quaternions, axes of the three turns
for Kardan angles), a force F adds -F and a moment M adds -h_j . M. Derivatives: d/dj of a following vector v is h_j x v;
of h_i it is h_j x h_i / 2 for body rotation vectors (symmetric second order of the exponential) and h_j x h_i for j < i,
else 0, for Kardan angles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..errors import check_shape
from ..kernels.rotation import matrix_from_quaternion
from ..rod import Rod
from ..schedule import Schedule
from ..space import Blocks, Space, State
from ..support import Place


@dataclass(frozen=True, eq=False)
class Gravity:
    """Weight of every rod in the model; leave it out and no weight is computed.

    Adds ``-mass_per_length * acceleration`` per metre to the residual. Dead load: no tangent.

    Parameters
    ----------
    acceleration : (3,) [m/s^2]
        In space, e.g. ``(0, 0, -9.81)``.
    """

    acceleration: Any
    name: str = "gravity"
    symmetric = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "acceleration", check_shape("gravity: acceleration", self.acceleration, (3,)))

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        return space.remember(self, lambda: self._blocks(space))

    def _blocks(self, space: Space) -> Blocks:
        force = np.zeros((space.n_nodes, 1, 6))
        force[:, 0, :3] = -space.node_mass[:, None] * self.acceleration
        return Blocks(np.arange(space.n_nodes)[:, None], force)


@dataclass(frozen=True, eq=False)
class LineLoad:
    """Force and moment per metre of unstressed length along one rod.

    Parameters
    ----------
    rod : Rod
    force : (3,) [N/m], (times, values) or function of t
    moment : (3,) [N], (times, values) or function of t
    components : "all" or "normal"
        "normal" drops the part of the force along the section normal d3 (the paper's f3).
    follower : bool
        False: dead, components in space. True: components along d1, d2, d3, turning with the sections.
    profile : function of s -> factor, or (places s, factors), optional
        Multiplies force and moment along the rod.
    """

    rod: Rod
    force: Any = (0.0, 0.0, 0.0)
    moment: Any = (0.0, 0.0, 0.0)
    components: Literal["all", "normal"] = "all"
    follower: bool = False
    profile: Callable[[float], float] | tuple[Sequence[float], Sequence[float]] | None = None
    name: str = "line load"
    _force: Schedule = field(init=False, repr=False)
    _moment: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        where = f"line load on rod {self.rod.name!r}"
        if self.components not in ("all", "normal"):
            raise ValueError(f"{where}: components must be 'all' or 'normal' (got {self.components!r}).")
        object.__setattr__(self, "_force", Schedule(f"{where}: force", self.force, (3,)))
        object.__setattr__(self, "_moment", Schedule(f"{where}: moment", self.moment, (3,)))
        if self.profile is not None and not callable(self.profile):
            places, factors = self.profile
            s = check_shape(f"{where}: places of the profile", places, (-1,))
            check_shape(f"{where}: factors of the profile", factors, (len(s),))
            if (np.diff(s) < 0).any():
                raise ValueError(f"{where}: places of the profile must not decrease.")

    @property
    def symmetric(self) -> bool:
        fixed = self.components == "all" and not self.follower
        return fixed and self._moment.constant and not np.any(self._moment.at(0.0))

    def weights(self, space: Space) -> np.ndarray:
        """Integral (n,) [m] of profile times shape function, at the rod's nodes in order of s."""
        if self.profile is None:
            return space.share(self.rod)
        profile = self.profile
        if callable(profile):
            return space.share(self.rod, lambda s: np.array([profile(x) for x in s]))
        places, factors = profile
        return space.share(self.rod, lambda s: np.interp(s, places, factors))

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        force, moment = self._force.at(state.t), self._moment.at(state.t)
        if self.follower and self.components == "normal":
            force = force * np.array([1.0, 1.0, 0.0])
        drop = self.components == "normal" and not self.follower
        nodes = space[self.rod].nodes
        weights = space.remember(self, lambda: self.weights(space))
        return nodal_load(state, space, nodes, weights, force, moment, (self.follower, self.follower), drop, tangent)


@dataclass(frozen=True, eq=False)
class PointLoad:
    """Force and moment at one place of a rod.

    Parameters
    ----------
    rod : Rod
    at : "start", "end" or arc length s [m]
    force : (3,) [N], (times, values) or function of t
    moment : (3,) [N m], (times, values) or function of t
    follower : bool
        False: dead, components in space. True: components along d1, d2, d3, turning with the section.
    """

    rod: Rod
    at: Place
    force: Any = (0.0, 0.0, 0.0)
    moment: Any = (0.0, 0.0, 0.0)
    follower: bool = False
    name: str = "point load"
    _force: Schedule = field(init=False, repr=False)
    _moment: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        where = f"point load on rod {self.rod.name!r}"
        self.rod.place(self.at, where)
        object.__setattr__(self, "_force", Schedule(f"{where}: force", self.force, (3,)))
        object.__setattr__(self, "_moment", Schedule(f"{where}: moment", self.moment, (3,)))

    @property
    def symmetric(self) -> bool:
        return not self.follower and self._moment.constant and not np.any(self._moment.at(0.0))

    @property
    def mark(self) -> tuple[Rod, float]:
        """Where the mesh needs a node."""
        return self.rod, self.rod.place(self.at, "point load")

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        node = np.array([space.node(*self.mark)])
        force, moment = self._force.at(state.t), self._moment.at(state.t)
        return nodal_load(state, space, node, np.ones(1), force, moment, (self.follower, self.follower), False, tangent)


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) that take x to v x x, for v (n, 3)."""
    S = np.zeros((len(v), 3, 3))
    S[:, 2, 1], S[:, 0, 2], S[:, 1, 0] = v[:, 0], v[:, 1], v[:, 2]
    return S - S.transpose(0, 2, 1)


def nodal_load(
    state: State,
    space: Space,
    nodes: np.ndarray,
    weights: np.ndarray,
    force: np.ndarray,
    moment: np.ndarray,
    follows: tuple[bool, bool],
    drop_normal: bool,
    tangent: bool,
) -> Blocks:
    """Blocks of weights (n,) times one force and moment at nodes (n,); `follows` says which turn with the section."""
    any_force, any_moment = bool(force.any()), bool(moment.any())
    n = len(nodes)
    g = np.zeros((n, 1, 6))
    varies = any_moment or (any_force and (follows[0] or drop_normal))
    if not varies:
        g[:, 0, :3] = -weights[:, None] * force
        return Blocks(nodes[:, None], g)
    R = matrix_from_quaternion(state.q[nodes])
    H = space.spin_axes(state, nodes)
    F = R @ force if follows[0] else np.tile(force, (n, 1))
    M = R @ moment if follows[1] else np.tile(moment, (n, 1))
    d3 = R[:, :, 2]
    along = (F * d3).sum(-1, keepdims=True)
    g[:, 0, :3] = -weights[:, None] * (F - along * d3 if drop_normal else F)
    g[:, 0, 3:] = -weights[:, None] * np.einsum("nki,nk->ni", H, M)
    if not tangent:
        return Blocks(nodes[:, None], g)
    K = np.zeros((n, 6, 6))
    if follows[0]:
        K[:, :3, 3:] = -cross_matrix(F) @ H
    elif drop_normal:
        d = -cross_matrix(d3) @ H  # columns h_j x d3
        K[:, :3, 3:] = -d3[:, :, None] * (F[:, None] @ d) - along[:, :, None] * d
    if any_moment:
        part = np.full((3, 3), 0.5) if state.angles is None else np.tri(3, k=-1)
        # M . (h_j x h_i) = [H^T (M x) H]_ij, and h_i . (h_j x M) is its negative
        K[:, 3:, 3:] = (part - float(follows[1])) * (H.transpose(0, 2, 1) @ cross_matrix(M) @ H)
    return Blocks(nodes[:, None], g, -weights[:, None, None] * K)
