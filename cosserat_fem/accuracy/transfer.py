"""How does a state get to other elements? Fields of one model at the places of another, of the same rods, or of rods of the
same names and other lengths: those are stretched evenly.

Rule: the polynomials of the old elements are taken at the new nodes and Gauss points; nothing is solved or smoothed. Of a
quaternion the interpolated one is made unit again. The stress memory is the polynomial through the stresses at the Gauss
points: the Newton method of the new model is then a step from the old solution of the mixed problem, not from its
strains, which between the old Gauss points are far from those of an equilibrium where a rod is stiff.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from ..model import Model
from ..rod import Rod
from ..space import RodNodes, Space, State, gauss_lobatto
from ..terms.inertial import Rates


def lagrange(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Values (n, m) at x (n,) of the Lagrange polynomials through points (m,), by the barycentric formula."""
    apart = points[:, None] - points
    np.fill_diagonal(apart, 1.0)
    weights = 1.0 / apart.prod(axis=1)
    away = x[:, None] - points
    hit = away == 0.0
    on = hit.any(axis=1)
    terms = np.where(on[:, None], hit, weights / np.where(hit, 1.0, away))
    return terms / terms.sum(axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Transfer:
    """From the elements of one model to those of another."""

    old: Model
    new: Model

    def _before(self, rod: Rod) -> tuple[RodNodes, float]:
        """The old rod to a new one, and its length in parts of the new one's."""
        views = self.old.space.views
        if rod in views:
            return views[rod], 1.0
        old = next(other for other in views if other.name == rod.name)
        return views[old], float(old.length / rod.length)

    @cached_property
    def _nodes(self) -> csr_matrix:
        """Matrix (N new, N old) of nodal values."""
        new = self.new.space
        rows: list[np.ndarray] = []
        columns: list[np.ndarray] = []
        values: list[np.ndarray] = []
        for rod, view in new.views.items():
            before, stretch = self._before(rod)
            order = before.mesh.order
            element, xi = locate(before.mesh.ends, view.s * stretch)
            columns.append(before.nodes[element[:, None] * order + np.arange(order + 1)].ravel())
            rows.append(np.repeat(view.nodes, order + 1))
            values.append(lagrange(gauss_lobatto(order), xi).ravel())
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return csr_matrix(entries, shape=(new.n_nodes, self.old.space.n_nodes))

    @cached_property
    def _points(self) -> list[list[tuple[int, np.ndarray, np.ndarray, slice]]]:
        """For each new group the rods in it: old group, old elements (n,), weights (n, Q old) and where they go."""
        parts: list[list[tuple[int, np.ndarray, np.ndarray, slice]]] = [[] for _ in self.new.space.groups]
        for rod, view in self.new.space.views.items():
            before, stretch = self._before(rod)
            element, xi = locate(before.mesh.ends, view.s_gauss * stretch)
            weights = lagrange(self.old.space.groups[before.group].basis.X[0], xi)
            parts[view.group].append((before.group, before.elements.start + element, weights, view.elements))
        return parts

    def nodal(self, values: np.ndarray) -> np.ndarray:
        """Values (N, k) at nodes of the old model at those of the new one."""
        return self._nodes @ values

    def state(self, state: State) -> State:
        """The state on the new elements, without contact or velocity."""
        q = self.nodal(state.q)
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        angles = None if state.angles is None else self.nodal(state.angles)
        moved = State(state.t, self.nodal(state.r), q, (), angles)
        return replace(moved, stress=self._stress(state))

    def with_contact(self, state: State) -> State:
        """As `state`, with what contact remembers; elements must be the same but for their order."""
        moved = self.state(state)
        contact = state.contact
        if contact is None:
            return moved
        base_q = self.nodal(contact.base_q)
        base_q /= np.linalg.norm(base_q, axis=1, keepdims=True)
        return replace(moved, contact=replace(contact, base_r=self.nodal(contact.base_r), base_q=base_q))

    def rates(self, rates: Rates) -> Rates:
        """Velocity and accelerations on the new elements."""
        return Rates(self.nodal(rates.v), self.nodal(rates.a), self.nodal(rates.b))

    def _stress(self, state: State) -> tuple[np.ndarray, ...]:
        """Stress memory from the strains of a state."""
        old, new = self.old.space, self.new.space
        stresses = []
        for k, group in enumerate(old.groups):
            strain = old.strain_and_frame(state, k)[0] - group.reference
            stresses.append(np.einsum("eqij,eqj->eqi", group.stiffness, strain))
        found = [np.empty_like(group.reference) for group in new.groups]
        for out, parts in zip(found, self._points, strict=True):
            for number, element, weights, where in parts:
                moved = np.einsum("nq,nqi->ni", weights, stresses[number][element])
                out[where] = moved.reshape(-1, *out.shape[1:])
        return self.new.internal.memory(found)


def locate(ends: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Element (n,) in which each place s (n,) lies, and where in it, from 0 to 1."""
    element = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
    return element, (s - ends[element]) / (ends[element + 1] - ends[element])


def at_places(values: np.ndarray, space: Space, rod: object, s: np.ndarray) -> np.ndarray:
    """Values (n, ...) at places s (n,) of a rod, from those at the nodes of the space (N, ...)."""
    view = space.views[rod]  # type: ignore[index]
    order = view.mesh.order
    element, xi = locate(view.mesh.ends, s)
    nodes = view.nodes[element[:, None] * order + np.arange(order + 1)]
    return np.einsum("na,na...->n...", lagrange(gauss_lobatto(order), xi), values[nodes])
