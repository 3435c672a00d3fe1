"""Internal force of a string: a rod that resists stretching alone.

Rule: energy EA (|r'| - 1)^2 / 2 per metre; places are the only unknowns. Sections do not turn: their rotations stay those of
the drawing, on a stiffness of their own that no force ever loads, so that supports, contact and linear systems are those of
every other rod. As in `internal`, the geometric stiffness n / |r'| (I - t t^T) takes the tension n from the stress memory.
Slack strings have no stiffness across: the solver says that such a state is unstable.
Source: Irvine (1981), Cable Structures, ch. 1; the memory as in `internal`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kernels import condense
from ..space import Blocks, Group, Space, State
from .internal import NO_MATRICES, Additions, Condensed, Tables, blocks_of_groups


@dataclass(frozen=True, eq=False)
class String:
    """The questions of `internal.InternalForce`."""

    name: str = "internal force"

    def _stretch(self, group: Group, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """|r'| (E, Q) and unit tangent (E, Q, 3)."""
        x = np.einsum("eqa,eai->eqi", group.N_s, r[group.conn], optimize=True)
        stretch = np.linalg.norm(x, axis=2)
        return stretch, x / np.maximum(stretch, 1e-300)[..., None]

    def _elements(
        self, state: State, space: Space, g: np.ndarray, tangent: bool
    ) -> tuple[float, float, list[np.ndarray]]:
        largest, matrices = 0.0, []
        for group, memory in zip(space.groups, state.stress, strict=True):
            EA = group.stiffness[..., 2, 2]
            stretch, t = self._stretch(group, state.r)
            n = EA * (stretch - group.reference[..., 2])
            largest = max(largest, float(np.abs(n).max()))
            force = np.einsum("eqa,eq,eqi->eai", group.N_s, group.dx * n, t, optimize=True)
            np.add.at(g[:, :3], group.conn, force)
            if tangent:
                matrices.append(_matrix(group, EA, memory[..., 2] / stretch, t))
        return largest, 0.0, matrices

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> list[Blocks]:
        g = np.zeros((space.n_nodes, 6))
        _, _, matrices = self._elements(state, space, g, tangent)
        return blocks_of_groups(space, g, matrices if tangent else None)

    def residual(self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None) -> tuple[float, float]:
        return self._elements(state, space, g, False)[:2]

    def full(
        self, state: State, space: Space, g: np.ndarray, tables: Tables | None = None
    ) -> tuple[float, float, list[np.ndarray]]:
        return self._elements(state, space, g, True)

    def condensed(
        self, state: State, space: Space, g: np.ndarray, scratch: list[Condensed], additions: Additions
    ) -> tuple[float, float, int]:
        force, moment, matrices = self._elements(state, space, g, True)
        negative = 0
        for k, (group, K, out) in enumerate(zip(space.groups, matrices, scratch, strict=True)):
            touched, blocks = additions.elements.get(k, (None, NO_MATRICES))
            if touched is not None:
                K[touched >= 0] += blocks[touched[touched >= 0]]
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
            stretch, t = self._stretch(group, state.r)
            change = np.einsum("eqa,eai,eqi->eq", group.N_s, du[group.conn, :3], t, optimize=True)
            stress = np.zeros_like(group.reference)
            stress[..., 2] = group.stiffness[..., 2, 2] * (stretch + scale * change - group.reference[..., 2])
            memory.append(stress)
        return tuple(memory)

    def with_stress(self, state: State, space: Space) -> tuple[np.ndarray, ...]:
        return self.extrapolate(state, space, np.zeros((space.n_nodes, 6)), 0.0)

    def memory(self, stresses: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(stresses)


def _matrix(group: Group, EA: np.ndarray, across: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Element matrices (E, 6A, 6A): EA along the tangents t (E, Q, 3), n / |r'| across; sections stand on springs."""
    E, A = group.conn.shape
    D = across[..., None, None] * np.eye(3) + (EA - across)[..., None, None] * t[..., :, None] * t[..., None, :]
    K = np.zeros((E, A, 6, A, 6))
    K[:, :, :3, :, :3] = np.einsum("eqa,eqb,eq,eqij->eaibj", group.N_s, group.N_s, group.dx, D, optimize=True)
    h = group.dx.sum(axis=1)
    for a in range(A):
        for i in range(3, 6):
            K[:, a, i, a, i] = EA.mean(axis=1) * h**2
    return K.reshape(E, 6 * A, 6 * A)
