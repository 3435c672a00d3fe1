"""Internal force of the rods, in two interpolations: quaternions (the default) and Kardan angles.

Rule: both say the same weak form (`forms.py`) and answer the same five questions. `condensed` is the fast path: it adds
the internal force to a residual that holds everything else and returns 12x12 matrices between element ends.

The stress memory is the one trick of the Newton method (mixed integration points): the geometric stiffness uses stresses
extrapolated with the last increment, C (strain + B du), instead of those of the current strains. The residual never
does. That is the condensed Hellinger-Reissner element, and it is why a roll-up takes one load step.
Source: Magisano, Leonetti, Garcea (2017), doi 10.1002/nme.5319.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..kernels import condense, kardan
from ..space import Blocks, Space, State, from_lanes, lanes

Tables = list[tuple[Any, ...]]  # for each group what `Group.tables` gives

NO_MATRICES, NO_ROWS, UNTOUCHED = np.empty((0, 0, 0)), np.empty((0, 0)), np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Condensed:
    """Scratch of one group: matrices (E, 12, 12) and right-hand sides (E, 12) between element ends, and factors."""

    S: np.ndarray
    rhs: np.ndarray
    factor: np.ndarray


@dataclass(frozen=True, eq=False)
class Additions:
    """What others add to the tangent: nodal (N, 6, 6) or empty, blocks of elements for each group (which block (E,) or -1,
    blocks (S, 6A, 6A)) or nothing, mu * shift (N, 6) on the diagonal, tables of damped rods."""

    nodal: np.ndarray
    elements: dict[int, tuple[np.ndarray, np.ndarray]]
    shift: np.ndarray
    mu: float
    symmetric: bool
    tables: Tables | None = None


class InternalForce(Protocol):
    """The five questions; see QuaternionBeam."""

    @property
    def name(self) -> str: ...

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> list[Blocks]: ...

    def residual(
        self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None
    ) -> tuple[float, float]: ...

    def condensed(
        self, state: State, space: Space, g: np.ndarray, scratch: list[Condensed], additions: Additions
    ) -> tuple[float, float, int]: ...

    def extrapolate(
        self, state: State, space: Space, du: np.ndarray, scale: float, tables: Tables | None = None
    ) -> tuple[np.ndarray, ...]: ...

    def with_stress(self, state: State, space: Space) -> tuple[np.ndarray, ...]: ...

    def memory(self, stresses: list[np.ndarray]) -> tuple[np.ndarray, ...]: ...


def blocks_of_groups(space: Space, g: np.ndarray, matrices: list[np.ndarray] | None) -> list[Blocks]:
    """Element forces and matrices, one Blocks for each group, of a residual g (N, 6) that is summed over elements already:
    each node's sum is given to one of its elements."""
    blocks = []
    for k, group in enumerate(space.groups):
        force = np.zeros((group.n_elements, group.order + 1, 6))
        mine = space.owner[group.conn] == np.arange(group.n_elements)[:, None]
        force[mine] = g[group.conn[mine]]
        blocks.append(Blocks(group.conn, force, None if matrices is None else matrices[k]))
    return blocks


@dataclass(frozen=True, eq=False)
class QuaternionBeam:
    """Internal force with interpolated quaternions; kernels `beam` and `condense`."""

    name: str = "internal force"

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> list[Blocks]:
        """Element matrices and forces, one Blocks for each group; the general path and the tests."""
        g = np.zeros((space.n_nodes, 6))
        matrices = self.full(state, space, g)[2]
        return blocks_of_groups(space, g, matrices if tangent else None)

    def residual(self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None) -> tuple[float, float]:
        """Add the internal force to g (N, 6); return the largest section force [N] and moment [N m]."""
        force = moment = 0.0
        for k, group in enumerate(space.groups):
            N_s, dx, C, C_full, reference = group.tables if tables is None else tables[k]
            f, m = condense.residual(
                group.packed_conn, group.n_elements, group.N, N_s, dx, C, C_full, reference, state.r, state.q, g
            )
            force, moment = max(force, f), max(moment, m)
        return force, moment

    def condensed(
        self, state: State, space: Space, g: np.ndarray, scratch: list[Condensed], additions: Additions
    ) -> tuple[float, float, int]:
        """Add the internal force to g and write the condensed tangent; also return the number of negative pivots."""
        force, moment, negative = 0.0, 0.0, 0
        for k, (group, stress, out) in enumerate(zip(space.groups, state.stress, scratch, strict=True)):
            N_s, dx, C, C_full, reference = group.tables if additions.tables is None else additions.tables[k]
            touched, blocks = additions.elements.get(k, (UNTOUCHED, NO_MATRICES))
            f, m, n = condense.assemble(
                group.packed_conn, group.n_elements, group.N, N_s, dx, C, C_full, reference, stress, state.r, state.q,
                g, space.owner, additions.nodal, touched, blocks, additions.shift, additions.mu, additions.symmetric,
                out.S, out.rhs, out.factor, NO_MATRICES,
            )  # fmt: skip
            force, moment, negative = max(force, f), max(moment, m), negative + n
        return force, moment, negative

    def full(
        self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None
    ) -> tuple[float, float, list[np.ndarray]]:
        """As `condensed`, but return the matrices (E, 6A, 6A) of all elements, for each group."""
        force, moment, matrices = 0.0, 0.0, []
        for k, (group, stress) in enumerate(zip(space.groups, state.stress, strict=True)):
            N_s, dx, C, C_full, reference = group.tables if tables is None else tables[k]
            n = 6 * (group.order + 1)
            K = np.empty((group.n_elements, n, n))
            f, m, _ = condense.assemble(
                group.packed_conn, group.n_elements, group.N, N_s, dx, C, C_full, reference, stress, state.r, state.q,
                g, space.owner, NO_MATRICES, UNTOUCHED, NO_MATRICES, NO_ROWS, 0.0, True, NO_MATRICES, NO_ROWS, NO_ROWS, K,
            )  # fmt: skip
            force, moment = max(force, f), max(moment, m)
            matrices.append(K)
        return force, moment, matrices

    def extrapolate(
        self, state: State, space: Space, du: np.ndarray, scale: float, tables: Tables | None = None
    ) -> tuple[np.ndarray, ...]:
        """Stress memory C (strain + scale B du), one array for each group."""
        memory = []
        for k, group in enumerate(space.groups):
            N_s, _, C, C_full, reference = group.tables if tables is None else tables[k]
            sigma = np.empty_like(C)
            condense.extrapolate_stress(
                group.packed_conn, group.N, N_s, C, C_full, reference, state.r, state.q, du, scale, sigma
            )
            memory.append(sigma)
        return tuple(memory)

    def with_stress(self, state: State, space: Space) -> tuple[np.ndarray, ...]:
        """Stress memory equal to the stress of the state itself (plain displacement Newton)."""
        return self.extrapolate(state, space, np.zeros((space.n_nodes, 6)), 0.0)

    def stress_array(self, space: Space, memory: tuple[np.ndarray, ...], group: int) -> np.ndarray:
        """Stress memory of a group as (E, Q, 6)."""
        E, Q = space.groups[group].dx.shape
        packed = memory[group].reshape(-1, Q, 6, memory[group].shape[-1] // 6)
        return from_lanes(packed, E)

    def packed_stress(self, stress: np.ndarray) -> np.ndarray:
        """Undo `stress_array`."""
        packed = lanes(stress)
        return packed.reshape(*packed.shape[:2], -1)

    def memory(self, stresses: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        """Stress memory from stresses (E, Q, 6), one array for each group."""
        return tuple(self.packed_stress(stress) for stress in stresses)


@dataclass(frozen=True, eq=False)
class KardanBeam:
    """Internal force with interpolated Kardan angles; kernel `kardan`, condensation shared. Not objective."""

    name: str = "internal force"

    def _elements(self, state: State, space: Space, g: np.ndarray, tangent: bool):
        force = moment = 0.0
        matrices = []
        for group, stress in zip(space.groups, state.stress, strict=True):
            n = 6 * (group.order + 1)
            K = np.empty((group.n_elements, n, n)) if tangent else NO_MATRICES
            f, m = kardan.assemble(
                group.conn, group.N, group.N_s, group.dx, group.stiffness, group.reference, stress,
                state.r, state.angles, tangent, g, K,
            )  # fmt: skip
            force, moment = max(force, f), max(moment, m)
            matrices.append(K)
        return force, moment, matrices

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> list[Blocks]:
        g = np.zeros((space.n_nodes, 6))
        _, _, matrices = self._elements(state, space, g, tangent)
        return blocks_of_groups(space, g, matrices if tangent else None)

    def residual(self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None) -> tuple[float, float]:
        force, moment, _ = self._elements(state, space, g, False)
        return force, moment

    def condensed(
        self, state: State, space: Space, g: np.ndarray, scratch: list[Condensed], additions: Additions
    ) -> tuple[float, float, int]:
        force, moment, matrices = self._elements(state, space, g, True)
        negative = 0
        for group, K, out in zip(space.groups, matrices, scratch, strict=True):
            negative += condense.condense_elements(
                group.packed_conn, group.n_elements, K, g, space.owner, additions.nodal, additions.shift,
                additions.mu, additions.symmetric, out.S, out.rhs, out.factor,
            )  # fmt: skip
        return force, moment, negative

    def extrapolate(
        self, state: State, space: Space, du: np.ndarray, scale: float, tables: Tables | None = None
    ) -> tuple[np.ndarray, ...]:
        memory = []
        for group in space.groups:
            sigma = np.empty_like(group.reference)
            kardan.extrapolate_stress(
                group.conn,
                group.N,
                group.N_s,
                group.stiffness,
                group.reference,
                state.r,
                state.angles,
                du,
                scale,
                sigma,
            )
            memory.append(sigma)
        return tuple(memory)

    def with_stress(self, state: State, space: Space) -> tuple[np.ndarray, ...]:
        return self.extrapolate(state, space, np.zeros((space.n_nodes, 6)), 0.0)

    def memory(self, stresses: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(stresses)
