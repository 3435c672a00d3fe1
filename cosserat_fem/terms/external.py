"""Loads: weight, line loads, point loads; dead or following the rod, constant or over time.

Rule: every load acts at nodes. A line load is integrated with the shape functions (which for a constant load gives the
Gauss-Lobatto weights); directions that depend on the rod are taken at the nodes, where the rotation is known exactly.
That keeps tangents local to a node and the order of accuracy of the element (2 p at the nodes, p the degree).
Derivatives: see `kernels.loads`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ..errors import check_shape
from ..kernels import loads
from ..kernels.rotation import matrix_from_quaternion
from ..rod import Rod
from ..schedule import Schedule
from ..space import Blocks, Space, State
from ..support import Place

NO_BLOCKS = np.empty((0, 6, 6))


@dataclass(frozen=True, eq=False)
class NodalLoads:
    """Loads at one time as a table: nodes (L,), force [N] and moment [N m] (L, 3), kinds (L, 3) of truth values: force
    follows the section, moment follows, only the part of the force normal to d3 counts."""

    nodes: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    kinds: np.ndarray


NO_LOADS = NodalLoads(
    np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), dtype=bool)
)  # fmt: skip


def check_rod(where: str, rod: Any) -> None:
    """ValueError if this is no Rod."""
    if not isinstance(rod, Rod):
        raise ValueError(f"{where}: rod must be a Rod (got {type(rod).__name__}).")


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
    needs_mass = True
    tabulated = True
    acts_on_strings = True
    steady = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "acceleration", check_shape("gravity: acceleration", self.acceleration, (3,)))

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        return space.remember((self, "blocks"), lambda: blocks_of(self._loads(space), state, space, tangent=False))

    def table(self, t: float, space: Space) -> NodalLoads:
        """The weight as loads at nodes."""
        return space.remember((self, "loads"), lambda: self._loads(space))

    def _loads(self, space: Space) -> NodalLoads:
        n = space.n_nodes
        force = space.node_mass[:, None] * self.acceleration
        return NodalLoads(np.arange(n), force, np.zeros((n, 3)), np.zeros((n, 3), dtype=bool))


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
    tabulated = True
    _force: Schedule = field(init=False, repr=False)
    _moment: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_rod("line load", self.rod)
        where = f"line load on rod {self.rod.name!r}"
        if self.components not in ("all", "normal"):
            raise ValueError(f"{where}: components must be 'all' or 'normal' (got {self.components!r}).")
        object.__setattr__(self, "_force", Schedule(f"{where}: force", self.force, (3,), jumps=True))
        object.__setattr__(self, "_moment", Schedule(f"{where}: moment", self.moment, (3,), jumps=True))
        if self.profile is not None and not callable(self.profile):
            if not isinstance(self.profile, tuple | list) or len(self.profile) != 2:
                raise ValueError(f"{where}: profile must be a function of s or (places, factors).")
            places, factors = self.profile
            s = check_shape(f"{where}: profile places", places, (-1,))
            check_shape(f"{where}: profile factors", factors, (len(s),))
            if (np.diff(s) < 0).any():
                raise ValueError(f"{where}: profile places must not decrease.")
            length, slack = self.rod.length, 1e-9 * self.rod.length
            if len(s) == 0 or s[0] > slack or s[-1] < length - slack or s[0] < -slack or s[-1] > length + slack:
                span = f"{s[0]:g} m to {s[-1]:g} m" if len(s) else "nowhere"
                raise ValueError(
                    f"{where}: profile must run along the whole rod, 0 to {length:g} m (got {span}). Give factor 0 where "
                    "there is no load; two entries at one place make a step."
                )

    @property
    def schedules(self) -> tuple[Schedule, Schedule]:
        """Force and moment over time."""
        return self._force, self._moment

    @property
    def steady(self) -> bool:
        """True if `table` is the same at all times."""
        return self._force.constant and self._moment.constant

    @property
    def kinks(self) -> np.ndarray:
        """Times [s] at which the load's slope jumps."""
        return np.union1d(self._force.kinks, self._moment.kinks)

    @property
    def jumps(self) -> np.ndarray:
        """Times [s] at which the load itself jumps."""
        return np.union1d(self._force.jumps, self._moment.jumps)

    @property
    def symmetric(self) -> bool:
        fixed = self.components == "all" and not self.follower
        return fixed and self._moment.constant and not np.any(self._moment.at(0.0))

    @property
    def acts_on_strings(self) -> bool:
        """True for dead forces: strings have no sections that turn."""
        return self.symmetric

    @property
    def marks(self) -> list[tuple[Rod, float]]:
        """Where the mesh needs a node: at steps of the profile."""
        if self.profile is None or callable(self.profile):
            return []
        s = np.asarray(self.profile[0], dtype=float)
        return [(self.rod, float(x)) for x in np.unique(s[1:][np.diff(s) == 0])]

    def weights(self, space: Space) -> np.ndarray:
        """Integral (n,) [m] of profile times shape function, at the rod's nodes in order of s."""
        if self.profile is None:
            return space.share(self.rod)
        profile = self.profile
        if callable(profile):
            return space.share(self.rod, lambda s: np.array([profile(x) for x in s]))
        places, factors = profile
        return space.share(self.rod, lambda s: np.interp(s, places, factors))

    def table(self, t: float, space: Space) -> NodalLoads:
        """The load as loads at nodes, at time t."""
        force, moment = self._force.at(t), self._moment.at(t)
        if self.follower and self.components == "normal":
            force = force * np.array([1.0, 1.0, 0.0])
        weights, kinds = space.remember((self, "loads"), lambda: self._constants(space))
        return NodalLoads(space[self.rod].nodes, weights * force, weights * moment, kinds)

    def _constants(self, space: Space) -> tuple[np.ndarray, np.ndarray]:
        """Weights (n, 1) and kinds (n, 3) of the table."""
        weights = self.weights(space)[:, None]
        drop = self.components == "normal" and not self.follower
        return weights, np.tile([self.follower, self.follower, drop], (len(weights), 1))

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        return blocks_of(self.table(state.t, space), state, space, tangent=tangent)


@dataclass(frozen=True, eq=False)
class PointLoad:
    """Force and moment at one place of a rod.

    Parameters
    ----------
    rod : Rod
    at : "start", "end" or arc length s [m]
    force : (3,) [N], (times, values) or function of t
        Two rows of a table at one time make a jump.
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
    tabulated = True
    _force: Schedule = field(init=False, repr=False)
    _moment: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_rod("point load", self.rod)
        where = f"point load on rod {self.rod.name!r}"
        self.rod.place(self.at, where)
        object.__setattr__(self, "_force", Schedule(f"{where}: force", self.force, (3,), jumps=True))
        object.__setattr__(self, "_moment", Schedule(f"{where}: moment", self.moment, (3,), jumps=True))

    @property
    def schedules(self) -> tuple[Schedule, Schedule]:
        """Force and moment over time."""
        return self._force, self._moment

    @property
    def steady(self) -> bool:
        """True if `table` is the same at all times."""
        return self._force.constant and self._moment.constant

    @property
    def kinks(self) -> np.ndarray:
        """Times [s] at which the load's slope jumps."""
        return np.union1d(self._force.kinks, self._moment.kinks)

    @property
    def jumps(self) -> np.ndarray:
        """Times [s] at which the load itself jumps."""
        return np.union1d(self._force.jumps, self._moment.jumps)

    @property
    def symmetric(self) -> bool:
        return not self.follower and self._moment.constant and not np.any(self._moment.at(0.0))

    @property
    def acts_on_strings(self) -> bool:
        """True for dead forces: strings have no sections that turn."""
        return self.symmetric

    @property
    def marks(self) -> list[tuple[Rod, float]]:
        """Where the mesh needs a node."""
        return [(self.rod, self.rod.place(self.at, "point load"))]

    def table(self, t: float, space: Space) -> NodalLoads:
        """The load as a load at a node, at time t."""
        node, kinds = space.remember(
            (self, "loads"),
            lambda: (np.array([space.node(*self.marks[0])]), np.array([[self.follower, self.follower, False]])),
        )
        return NodalLoads(node, self._force.at(t)[None], self._moment.at(t)[None], kinds)

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        return blocks_of(self.table(state.t, space), state, space, tangent=tangent)


@dataclass(frozen=True, eq=False)
class Factored:
    """A load times a factor; what else is asked of it the load itself answers."""

    load: Any
    factor: float

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.load, name)

    def table(self, t: float, space: Space) -> NodalLoads:
        """The load as loads at nodes, at time t."""
        table = self.load.table(t, space)
        return replace(table, force=self.factor * table.force, moment=self.factor * table.moment)

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        blocks = self.load(state, space, tangent=tangent)
        stiffness = None if blocks.stiffness is None else self.factor * blocks.stiffness
        return replace(blocks, force=self.factor * blocks.force, stiffness=stiffness)


def blocks_of(table: NodalLoads, state: State, space: Space, *, tangent: bool) -> Blocks:
    """Residual and tangent of a table of loads."""
    nodes, n = table.nodes, len(table.nodes)
    g = np.zeros((n, 1, 6))
    if not table.moment.any() and not (table.kinds.any() and table.force.any()):  # dead forces: no tangent
        g[:, 0, :3] = -table.force
        return Blocks(nodes[:, None], g)
    R = matrix_from_quaternion(state.q[nodes])
    H = R if state.angles is None else space.spin_axes(state, nodes)
    K = np.empty((n, 6, 6)) if tangent else NO_BLOCKS
    loads.each_load(R, H, table.force, table.moment, table.kinds, state.angles is not None, g[:, 0], K)
    return Blocks(nodes[:, None], g, K if tangent else None)
