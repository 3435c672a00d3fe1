"""Where do unknowns live? Meshes, Gauss-Lobatto elements, numbering of all rods; states and blocks.

Rule: scikit-fem owns shape functions, quadrature and numbering; this room turns them once into the arrays the kernels
read. Rods of one order share a mesh of disjoint intervals in arc length and one `Basis` (a group), so that every
kernel is called once per group, not once per rod. scikit-fem numbers vertices first and interior nodes last, element by
element: that is the order in which the kernels eliminate.

Each node carries six unknowns: displacement in space, and either a body rotation vector (quaternions) or three angle
increments (Kardan). A state is a value: an update makes a new one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix
from skfem import Basis, MeshLine
from skfem.element import ElementH1
from skfem.refdom import RefLine

from .errors import KardanError
from .kernels import condense, kardan
from .kernels.beam import LANES
from .kernels.rotation import (
    kardan_from_matrix,
    matrix_from_quaternion,
    quaternion_from_kardan,
    quaternion_from_matrix,
    rotate_bodies,
)
from .rod import Elements, Rod

RIGID = 1e3  # shear stiffness of a Kirchhoff rod in parts of EA
FIRST_TENSION = (
    1e-3  # of EA: of the stress memory of a string at its drawn shape, where a straight one would be a mechanism
)
SINGULAR_COSINE = np.cos(np.radians(89.5))  # Kardan angles are refused nearer to theta = 90 deg than this


@cache
def gauss_lobatto(order: int) -> np.ndarray:
    """Gauss-Lobatto points (order + 1,) on [0, 1]: the ends and the zeros of the derivative of P_order."""
    legendre = np.polynomial.Legendre.basis(order)
    return 0.5 * (1.0 + np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]]))


@cache
def gll_element(order: int) -> ElementLineGLL:
    """The element of an order, made once."""
    return ElementLineGLL(order)


class ElementLineGLL(ElementH1):
    """Lagrange element on Gauss-Lobatto points: nodal, so that every unknown is the value at a point.

    scikit-fem's own ElementLinePp has hierarchical bubbles, which are not rotations.
    """

    nodal_dofs = 1
    refdom = RefLine

    def __init__(self, order: int) -> None:
        self.interior_dofs = order - 1
        self.maxdeg = order
        self.dofnames = ["u"] * order
        points = gauss_lobatto(order)
        points = np.concatenate([points[[0, -1]], points[1:-1]])
        self.doflocs = points[:, None]
        # coefficients of the Lagrange polynomials in the Legendre basis: exact to round-off for any order used here
        polynomials = [np.polynomial.Legendre.basis(k, domain=[0.0, 1.0]) for k in range(order + 1)]
        table = np.linalg.inv(np.array([p(points) for p in polynomials]))
        self.shapes = [sum(c * p for c, p in zip(row, polynomials, strict=True)) for row in table]
        self.slopes = [shape.deriv() for shape in self.shapes]

    def lbasis(self, X: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        return self.shapes[i](X[0]), self.slopes[i](X[0])[None]


def lanes(array: np.ndarray) -> np.ndarray:
    """Arrange (E, ...) in packs: (P, ..., LANES); the last element fills up the last pack."""
    n_packs = -(-len(array) // LANES)
    padded = array[np.minimum(np.arange(n_packs * LANES), len(array) - 1)]
    return np.ascontiguousarray(np.moveaxis(padded.reshape(n_packs, LANES, *array.shape[1:]), 1, -1))


def from_lanes(packed: np.ndarray, n_elements: int) -> np.ndarray:
    """Undo `lanes`: (P, ..., LANES) to (E, ...)."""
    unpacked = np.moveaxis(packed, -1, 1)
    return unpacked.reshape(-1, *unpacked.shape[2:])[:n_elements]


@dataclass(frozen=True, eq=False)
class Group:
    """All elements of one order. Element arrays (E, ...) for people, packed arrays (P, ..., LANES) for kernels."""

    order: int
    basis: Basis
    conn: np.ndarray  # (E, A) node numbers of the whole space: vertices, then interior
    N: np.ndarray  # (Q, A)
    N_s: np.ndarray  # (E, Q, A) [1/m]
    dx: np.ndarray  # (E, Q) [m]
    stiffness: np.ndarray  # (E, Q, 6, 6)
    reference: np.ndarray  # (E, Q, 6) strain of the stress-free shape

    @property
    def n_elements(self) -> int:
        return len(self.conn)

    @cached_property
    def packed_conn(self) -> np.ndarray:
        return lanes(self.conn)

    @cached_property
    def packed_slopes(self) -> np.ndarray:
        return lanes(self.N_s).reshape(len(self.packed_conn), len(self.N), -1)

    @cached_property
    def tables(self) -> tuple[Any, ...]:
        """N_s, dx, C (diagonal), C_full (the rest, or None), reference as the kernels take them."""
        E, Q = self.dx.shape
        n_packs = len(self.packed_conn)
        diagonal = np.ascontiguousarray(np.diagonal(self.stiffness, axis1=-2, axis2=-1))
        rest = self.stiffness.copy()
        rest[..., range(6), range(6)] = 0.0
        full = lanes(rest.reshape(E, Q, 36)).reshape(n_packs, Q, -1) if rest.any() else None
        return (
            self.packed_slopes,
            lanes(self.dx),
            lanes(diagonal).reshape(n_packs, Q, -1),
            full,
            lanes(self.reference).reshape(n_packs, Q, -1),
        )


@dataclass(frozen=True, eq=False)
class RodNodes:
    """Where one rod lives: its group and elements, and its nodes in order of arc length."""

    rod: Rod
    group: int
    elements: slice
    vertices: np.ndarray  # (n_elements + 1,) node numbers, consecutive
    nodes: np.ndarray  # (N,) node numbers by increasing s
    s: np.ndarray  # (N,) [m]
    s_gauss: np.ndarray  # (E * Q,) [m]
    mesh: Elements


@dataclass(frozen=True, eq=False)
class Touch:
    """What one contact term remembers: slips (m, 3) [m] of the places with the keys (m,), increasing, and the normal forces
    (m,) [N] there; its pressure scale [N/m]; work lost by friction so far [J]."""

    keys: np.ndarray
    slips: np.ndarray
    forces: np.ndarray
    scale: float
    lost: float = 0.0

    @classmethod
    def of_nothing(cls, scale: float, lost: float = 0.0) -> Touch:
        """Nothing touches."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0), scale, lost)


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact at a state: the time [s] for which parts stand where no rod is in them, and what was last accepted.

    While a solver brings a state to its time t, `time` lags behind: parts come along as far as rods give way. base_time,
    base_r (N, 3), base_q (N, 4): of the accepted state from which slips are counted; touch: memory of each term.
    """

    time: float
    base_time: float
    base_r: np.ndarray
    base_q: np.ndarray
    touch: dict[Any, Touch]


@dataclass(frozen=True, eq=False)
class State:
    """Configuration of all rods at one time. A value: never changed in place.

    t [s]; r (N, 3) [m] node positions; q (N, 4) unit quaternions; stress: the stress memory of the Newton method, one
    array per group; angles (N, 3) [rad] if the rotations are Kardan angles, else None. In a run in time also velocity
    (N, 6) [m/s, rad/s]: displacement in space, rotation in the section's axes; slope [1/s]: how much an increment of the
    unknowns adds to it (0: nothing depends on it). contact: if the model has any.
    """

    t: float
    r: np.ndarray
    q: np.ndarray
    stress: tuple[np.ndarray, ...]
    angles: np.ndarray | None = None
    velocity: np.ndarray | None = None
    slope: float = 0.0
    contact: Contact | None = None

    def at_time(self, t: float) -> State:
        """The same at another time."""
        if t == self.t:
            return self
        return State(t, self.r, self.q, self.stress, self.angles, self.velocity, self.slope, self.contact)


@dataclass(frozen=True, eq=False)
class Blocks:
    """What a term adds to the residual g(q, t) = 0 and its derivative, on B sets of m nodes each.

    nodes (B, m); force (B, m, 6) [N, N m]: force in space and generalized moment at each node; stiffness
    (B, 6 m, 6 m): dg/dq, None costs nothing. elements: group and numbers (B,) of the elements whose nodes these are, if
    they are; blocks of several nodes that are no element couple rods, and such systems are solved more slowly.
    stiffest [N/m]: largest stiffness at one place, whose round-off limits what can be reached.
    """

    nodes: np.ndarray
    force: np.ndarray
    stiffness: np.ndarray | None = None
    elements: tuple[int, np.ndarray] | None = None
    stiffest: float = 0.0

    def times(self, factor: np.ndarray) -> Blocks:
        """The same, in each component (N, 6) of a node so many times as strong."""
        mine = factor[self.nodes]
        stiffness = None if self.stiffness is None else mine.reshape(len(mine), -1, 1) * self.stiffness
        return replace(self, force=mine * self.force, stiffness=stiffness)


class Entries(NamedTuple):
    """A matrix (6 N, 6 N) as a sum of entries at rows (K,) and columns (K,), of which several may be at one place."""

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @classmethod
    def at(cls, nodes: np.ndarray, blocks: np.ndarray) -> Entries:
        """Entries of blocks (B, 6 m, 6 m) on sets of m nodes, (B, m)."""
        dofs = (6 * nodes[:, :, None] + np.arange(6)).reshape(len(nodes), -1).astype(np.int32)
        rows, columns = np.broadcast_to(dofs[:, :, None], blocks.shape), np.broadcast_to(dofs[:, None, :], blocks.shape)
        return cls(rows.ravel(), columns.ravel(), blocks.ravel())

    @classmethod
    def sum(cls, parts: Sequence[Entries]) -> Entries:
        return cls(*(np.concatenate([part[k] for part in parts]) for k in range(3)))

    def matrix(self, n: int) -> csc_matrix:
        """As a sparse matrix (n, n)."""
        return csc_matrix((self.values, (self.rows, self.columns)), shape=(n, n))


class Space:
    """Meshes, bases and numbering of all rods.

    Parameters
    ----------
    rods : sequence of Rod
    marks : for each rod, the arc lengths where it needs a node
    rotation : "quaternion" or "kardan"
    elements : for rods that do not take the elements they ask for, others
    theory : "cosserat", "kirchhoff" or "string"
    """

    def __init__(
        self,
        rods: Sequence[Rod],
        marks: Sequence[Sequence[float]],
        rotation: str = "quaternion",
        elements: Mapping[Rod, Elements] | None = None,
        theory: str = "cosserat",
    ) -> None:
        self.rods = tuple(rods)
        self.rotation, self.theory = rotation, theory
        given = elements or {}
        meshes = {
            rod: given[rod].check(rod, m) if rod in given else rod.elements(m)
            for rod, m in zip(rods, marks, strict=True)
        }
        ends = {rod: mesh.ends for rod, mesh in meshes.items()}
        groups: list[Group] = []
        views: dict[Rod, RodNodes] = {}
        n_nodes = 0
        for order in sorted({mesh.order for mesh in meshes.values()}):
            members = [rod for rod in rods if meshes[rod].order == order]
            basis, conn, first_vertex, first_element = _mesh(order, [ends[rod] for rod in members], n_nodes)
            locations = basis.doflocs[0]
            stiffness, reference = [], []
            for rod, vertex, element in zip(members, first_vertex, first_element, strict=True):
                n = len(ends[rod]) - 1
                mine = slice(element, element + n)
                s_gauss = np.asarray(basis.global_coordinates())[0][mine].ravel()
                nodes = np.unique(conn[mine])
                s = locations[nodes - n_nodes]
                by_s = np.argsort(s, kind="stable")
                vertices = n_nodes + vertex + np.arange(n + 1)
                views[rod] = RodNodes(rod, len(groups), mine, vertices, nodes[by_s], s[by_s], s_gauss, meshes[rod])
                stiffness.append(_of_theory(rod.section_at(s_gauss)[0], theory).reshape(n, order, 6, 6))
                straight = np.zeros((n * order, 6))
                straight[:, 2] = 1.0
                if theory != "string":
                    straight[:, 3:] = rod.rest_curvature(s_gauss)
                reference.append(straight.reshape(n, order, 6))
            groups.append(
                Group(
                    order,
                    basis,
                    conn,
                    np.array([np.asarray(b[0])[0] for b in basis.basis]).T.copy(),
                    np.stack([b[0].grad[0] for b in basis.basis], axis=-1),
                    basis.dx,
                    np.concatenate(stiffness),
                    np.concatenate(reference),
                )
            )
            n_nodes += len(locations)
        self.groups = tuple(groups)
        self.n_nodes = n_nodes
        self.views = views
        self._memo: dict[Hashable, Any] = {}
        self._drawn = self._draw()

    def __getitem__(self, rod: Rod) -> RodNodes:
        return self.views[rod]

    def node(self, rod: Rod, s: float) -> int:
        """Node number at arc length s of a rod; there must be a vertex."""
        view = self.views[rod]
        s_vertices = view.s[:: view.mesh.order]
        return int(view.vertices[np.argmin(np.abs(s_vertices - s))])

    @cached_property
    def node_rod(self) -> np.ndarray:
        """Index (N,) of the rod that each node belongs to."""
        index = np.empty(self.n_nodes, dtype=np.int64)
        for k, rod in enumerate(self.rods):
            index[self.views[rod].nodes] = k
        return index

    @cached_property
    def node_s(self) -> np.ndarray:
        """Arc length (N,) [m] of each node."""
        s = np.empty(self.n_nodes)
        for view in self.views.values():
            s[view.nodes] = view.s
        return s

    def remember(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return make(), computed once for this space; terms keep their constant tables here, not in themselves."""
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]

    def forget(self, owner: Hashable) -> None:
        """Let go what was remembered under keys that begin with an owner, which is of no more use."""
        self._memo = {key: kept for key, kept in self._memo.items() if not (isinstance(key, tuple) and key[0] is owner)}

    def share(self, rod: Rod, profile: Callable[[np.ndarray], np.ndarray] | None = None) -> np.ndarray:
        """Integral (n,) [m] of profile(s) times each shape function, at the rod's nodes in order of s."""
        view = self.views[rod]
        group = self.groups[view.group]
        dx = group.dx[view.elements]
        if profile is not None:
            dx = dx * np.asarray(profile(view.s_gauss), dtype=float).reshape(dx.shape)
        total = np.zeros(self.n_nodes)
        np.add.at(total, group.conn[view.elements], dx @ group.N)
        return total[view.nodes]

    @cached_property
    def node_mass(self) -> np.ndarray:
        """Mass (N,) [kg] lumped at the nodes."""
        mass = np.zeros(self.n_nodes)
        for rod, view in self.views.items():
            mass[view.nodes] = self.share(rod, rod.mass_at)
        return mass

    @cached_property
    def node_inertia(self) -> np.ndarray:
        """Rotary inertia (N, 3) [kg m^2] about d1, d2, d3, lumped at the nodes."""
        inertia = np.zeros((self.n_nodes, 3))
        for rod, view in self.views.items():
            values = rod.rotary_inertia_at(view.s_gauss)  # share asks at just these places
            for i in range(3):
                inertia[view.nodes, i] = self.share(rod, partial(_given, values[:, i]))
        return inertia

    @cached_property
    def heaviest(self) -> tuple[float, float]:
        """Largest mass [kg] and rotary inertia [kg m^2] of a node."""
        return float(self.node_mass.max()), float(self.node_inertia.max())

    @cached_property
    def owner(self) -> np.ndarray:
        """One element (number in its group) for each node, to add nodal matrices once."""
        owner = np.empty(self.n_nodes, dtype=np.int64)
        for group in self.groups:
            owner[group.conn] = np.arange(group.n_elements)[:, None]
        return owner

    @cached_property
    def lengths(self) -> np.ndarray:
        """Unstressed lengths of the rods [m]."""
        return np.array([rod.length for rod in self.rods])

    def _draw(self) -> State:
        """Drawn shape, stress memory zero; sets the reference strain of rods with rest = "as_drawn"."""
        r, R = np.empty((self.n_nodes, 3)), np.empty((self.n_nodes, 3, 3))
        for rod, view in self.views.items():
            r[view.nodes], R[view.nodes] = rod.drawn(view.s), rod.frames(view.s)
        q = quaternion_from_matrix(R)
        for view in self.views.values():
            along = q[view.nodes]  # neighbours on the same hemisphere, so that the interpolation goes the short way
            flips = np.cumprod(np.concatenate([[1.0], np.sign((along[1:] * along[:-1]).sum(-1))]))
            q[view.nodes] = along * flips[:, None]
        angles = None
        if self.rotation == "kardan":
            angles = kardan_from_matrix(R)
            for view in self.views.values():
                angles[view.nodes] = np.unwrap(angles[view.nodes], axis=0)
        state = State(0.0, r, q, (), angles)
        for rod, view in self.views.items():
            if isinstance(rod.rest, str) and rod.rest == "as_drawn":
                scaled = replace(state, r=r * (rod.length / rod.drawn_length))
                strain, _ = self.strain_and_frame(scaled, view.group)
                self.groups[view.group].reference[view.elements] = strain[view.elements]
        if self.theory == "string":
            tight = [np.zeros_like(g.reference) for g in self.groups]
            for stress, group in zip(tight, self.groups, strict=True):
                stress[..., 2] = FIRST_TENSION * group.stiffness[..., 2, 2]
            return replace(state, stress=tuple(tight))
        zero = [np.zeros_like(g.tables[2]) if angles is None else np.zeros_like(g.reference) for g in self.groups]
        return replace(state, stress=tuple(zero))

    @cached_property
    def places(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows and columns of the matrices of elements, for each group, and of those of nodes, as of `Entries`."""
        places = []
        for conn in [*(group.conn for group in self.groups), np.arange(self.n_nodes)[:, None]]:
            width = 6 * conn.shape[1]
            places.append(Entries.at(conn, np.empty((len(conn), width, width)))[:2])
        return places

    def drawn_state(self, t: float = 0.0) -> State:
        """The drawn shape at time t, without stress memory.

        Raises
        ------
        KardanError
            With Kardan angles, where the drawing is singular.
        """
        state = self._drawn.at_time(t)
        self.check_angles(state)
        return state

    def check_angles(self, state: State) -> None:
        """KardanError if the Kardan angles of a node are singular (theta within half a degree of 90 deg)."""
        if state.angles is None:
            return
        cosine = np.abs(np.cos(state.angles[:, 1]))
        k = int(np.argmin(cosine))
        if cosine[k] < SINGULAR_COSINE:
            rod = self.rods[self.node_rod[k]]
            s = self.node_s[k]
            place = "its start" if s == 0 else "its end" if s >= rod.length * (1 - 1e-12) else f"s = {s:.4g} m"
            d3 = matrix_from_quaternion(state.q[k])[:, 2]
            raise KardanError(
                f"t = {state.t:g} s: Kardan angles are singular on rod {rod.name!r} at {place}: "
                f"theta = {np.degrees(state.angles[k, 1]):.2f} deg, because the rod points along the x axis there "
                f"(tangent {np.array2string(d3, precision=3, suppress_small=True)}). "
                'Use rotation = "quaternion", or turn the scene so that no part of the rod points along x.'
            )

    def update(self, state: State, du: np.ndarray, scale: float = 1.0, stress: tuple[np.ndarray, ...] = ()) -> State:
        """New state after the nodal increments scale * du (N, 6)."""
        step = du if scale == 1.0 else scale * du
        r = state.r + step[:, :3]
        if state.angles is not None:
            angles = state.angles + step[:, 3:]
            new = State(state.t, r, quaternion_from_kardan(angles), stress or state.stress, angles)
            self.check_angles(new)
            return new
        q = np.empty_like(state.q)
        rotate_bodies(state.q, step[:, 3:], q)
        return State(state.t, r, q, stress or state.stress, None, state.velocity, state.slope, state.contact)

    def spin_axes(self, state: State, nodes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Matrices H (n, 3, 3), spatial spin = H times the rotation unknowns: columns h_j.

        Quaternions: the directors. Kardan angles: the axes of the three turns.
        """
        if state.angles is None:
            return matrix_from_quaternion(state.q[nodes])
        psi, theta = state.angles[nodes, 0], state.angles[nodes, 1]
        H = np.zeros((*psi.shape, 3, 3))
        H[..., 0, 0] = 1.0
        H[..., 1, 1], H[..., 2, 1] = np.cos(psi), np.sin(psi)
        H[..., 0, 2] = np.sin(theta)
        H[..., 1, 2], H[..., 2, 2] = -np.sin(psi) * np.cos(theta), np.cos(psi) * np.cos(theta)
        return H

    def strain_and_frame(self, state: State, group: int) -> tuple[np.ndarray, np.ndarray]:
        """Total strain (Gamma, K) (E, Q, 6) and rotation (E, Q, 3, 3) at the Gauss points of a group."""
        strains, frames = self.strains_and_frames([state], group)
        return strains[0], frames[0]

    def strains_and_frames(self, states: Sequence[State], group: int) -> tuple[np.ndarray, np.ndarray]:
        """As `strain_and_frame`, of several states: a leading axis."""
        g, T = self.groups[group], len(states)
        E, Q = g.dx.shape
        strains, frames = np.empty((T, E, Q, 6)), np.empty((T, E, Q, 3, 3))
        if self.theory == "string":
            for k, state in enumerate(states):
                strains[k], frames[k] = self._stretch_and_frame(state, g)
        elif T and states[0].angles is not None:
            for k, state in enumerate(states):
                kardan.strain_and_frame(g.conn, g.N, g.N_s, state.r, state.angles, strains[k], frames[k])
        elif T:
            r, q = np.stack([state.r for state in states]), np.stack([state.q for state in states])
            flat = frames.reshape(T, E, Q, 9)
            condense.strain_and_frame(g.packed_conn, E, g.N, g.packed_slopes, r, q, strains, flat)
        return strains, frames

    def _stretch_and_frame(self, state: State, g: Group) -> tuple[np.ndarray, np.ndarray]:
        """As `strain_and_frame`, of strings: d3 is the tangent, d1 as near as may be to that of the element's first node."""
        x = np.einsum("eqa,eai->eqi", g.N_s, state.r[g.conn], optimize=True)
        strain, length = np.zeros((*g.dx.shape, 6)), np.linalg.norm(x, axis=2)
        strain[..., 2] = length
        d3 = x / np.maximum(length, 1e-300)[..., None]
        near = matrix_from_quaternion(state.q[g.conn[:, 0]])
        d1 = near[:, None, :, 0] - (near[:, None, :, 0] * d3).sum(2, keepdims=True) * d3
        other = near[:, None, :, 1] - (near[:, None, :, 1] * d3).sum(2, keepdims=True) * d3
        size = np.linalg.norm(d1, axis=2, keepdims=True)
        d1 = np.where(size > 1e-3, d1, other)
        d1 /= np.linalg.norm(d1, axis=2, keepdims=True)
        return strain, np.stack([d1, np.cross(d3, d1), d3], axis=-1)


def _of_theory(C: np.ndarray, theory: str) -> np.ndarray:
    """Stiffness (n, 6, 6) of sections as a theory has it."""
    if theory == "string":
        only = np.zeros_like(C)
        only[:, 2, 2] = C[:, 2, 2]
        return only
    if theory == "kirchhoff":
        C = C.copy()
        C[:, :2], C[:, :, :2] = 0.0, 0.0
        C[:, (0, 1), (0, 1)] = RIGID * C[:, 2, 2, None]
    return C


def _given(values: np.ndarray, s: np.ndarray) -> np.ndarray:
    return values


def _mesh(order: int, ends: Sequence[np.ndarray], offset: int) -> tuple[Basis, np.ndarray, np.ndarray, np.ndarray]:
    """Basis of disjoint intervals, connectivity (E, A), first vertex and first element of each rod."""
    counts = np.array([len(e) for e in ends])
    first_vertex = np.concatenate([[0], np.cumsum(counts)[:-1]])
    first_element = first_vertex - np.arange(len(ends))
    t = np.concatenate(
        [v + np.stack([np.arange(n - 1), np.arange(1, n)]) for v, n in zip(first_vertex, counts, strict=True)], axis=1
    )
    mesh = MeshLine(np.concatenate(ends)[None], t)
    X, W = np.polynomial.legendre.leggauss(order)
    basis = Basis(mesh, gll_element(order), quadrature=(0.5 * (1 + X)[None], 0.5 * W))
    conn = np.ascontiguousarray(basis.element_dofs.T.astype(np.int64)) + offset
    return basis, conn, first_vertex, first_element
