"""How does a model look to compiled code? Its arrays, and the way there and back.

Rule: states, loads and reactions are always those in space. In space the border hands arrays over as they are; in a plane it
keeps what lies in the plane, and puts the rest back.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..constraint import Targets
from ..kernels import chain, planar
from ..kernels.beam import LANES
from ..model import Model
from ..plane import ScenePlane
from ..space import State
from ..terms.external import NodalLoads
from ..terms.inertial import Driven
from .linear import segments_of

NO_FRAMES, NO_NODES = np.empty((0, 0, 0)), np.empty(0, dtype=np.int64)
Tables = tuple[Any, ...]
Nodes = np.ndarray | slice


class SpaceBorder:
    """Arrays of a model in space, as the kernel takes them."""

    size: tuple[int, ...] = chain.SPACE
    kind: tuple[Any, Any] = (True, None)  # in space, in a plane

    def __init__(self, model: Model) -> None:
        space, c = model.space, model.constraints
        (group,) = space.groups
        self.model, self.group = model, group
        self.beam = (group.packed_conn, group.n_elements, group.N)
        self.mass, self.J = space.node_mass, space.node_inertia
        self.owner, self.shift = space.owner, model.shift
        self.segments, self.n_vertices = segments_of(space, c)
        self.joint_nodes, self.joint_index, self.half = _number_joints(model, self.segments, len(self.size))
        self.n_joints = len(c.joints)
        self.rows = (c.nodes, c.left, c.right, self.held_rows(), c.owner)
        self.followers = (c.lead, c.lead_row)
        self._still = None if c.moving_parts else self._holds(c.targets(0.0))
        self._stands = None if c.moving_parts else self._places(c.targets(0.0))
        self.tables = self.project(group.tables)

    def held_rows(self) -> np.ndarray:
        return self.model.constraints.held

    def project(self, tables: Tables) -> Tables:
        """Tables of `Group.tables` for the kernel: N_s, dx, C, C_full, reference."""
        return tables

    def take(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places, attitudes and stress memory of a state, to be changed in place."""
        return state.r.copy(), state.q.copy(), state.stress[0].copy()

    def give(self, state: State, r: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> State:
        """The state with these places, attitudes and stress memory."""
        return self.give_all(state, [state.t], r[None], q[None], sigma[None])[0]

    def give_all(
        self, state: State, times: list[float], r: np.ndarray, q: np.ndarray, sigma: np.ndarray
    ) -> list[State]:
        """As `give`, of several states at times (K,): a leading axis."""
        return [State(t, r[k], q[k], (sigma[k],), None, state.velocity, state.slope) for k, t in enumerate(times)]

    def holds(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place and attitude of the supports and frames T (M, d, d), or none, at a time."""
        return self._still or self._holds(self.model.constraints.targets(t))

    def _holds(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return targets.place, targets.quaternion, self._frames(targets)

    def _frames(self, targets: Targets) -> np.ndarray:
        """Frames T (M, d, d) of the special vertices, or none."""
        return NO_FRAMES

    def places(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `holds`, but place (n, 3) and attitude (n, 4) in space; also at given targets."""
        if targets is not None:
            return self._places(targets)
        return self._stands or self._places(self.model.constraints.targets(t))

    def _places(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return targets.place, targets.quaternion, self._frames(targets)

    @property
    def frame(self) -> tuple[Any, ...] | None:
        """What translates between the plane and space, as `kernels.rest` takes it."""
        return None

    def loads(self, table: NodalLoads) -> tuple[Any, ...]:
        """Nodes, force, moment, kinds, whether any depends on the attitude; and whether any has a tangent."""
        turning = bool(table.moment.any() or (table.kinds.any() and table.force.any()))
        return (table.nodes, table.force, table.moment, table.kinds, turning), turning

    def rates(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        """Rates or forces (n, d) at nodes from those in space (n, 6)."""
        return values

    def in_space(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        """The inverse of `rates`."""
        return values

    def flat(self, values: np.ndarray) -> np.ndarray:
        """Displacements (N, d) of nodes from those in space (N, 3)."""
        return values

    def driven(self, driven: Driven) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration (M, d) of driven nodes."""
        return driven.v.reshape(-1, 6), driven.a.reshape(-1, 6)

    @property
    def symmetric(self) -> bool:
        """True if the loads have a potential."""
        return self.model.symmetric


class PlaneBorder(SpaceBorder):
    """Arrays of a model that stays in a plane."""

    size, kind = chain.PLANE, (None, True)

    def __init__(self, model: Model) -> None:
        plane = cast(ScenePlane, model.plane)
        self.plane = plane
        node = np.ascontiguousarray(model.space.groups[0].packed_conn[:, 0])
        self._place = (plane.axes, plane.base, node, plane.across, plane.normal)
        super().__init__(model)
        n = self.plane.normal
        self.J = (model.space.node_inertia * n * n).sum(axis=1, keepdims=True)
        self.shift = model.shift[:, [0, 1, 3]].copy()

    def held_rows(self) -> np.ndarray:
        """Held unknowns (M, 3): along two axes of a support's frame in the plane, and the angle."""
        c, axes = self.model.constraints, self.plane.axes
        held = c.held[:, [axes[0], axes[1], 3 + axes[2]]].copy()
        self._slides = {}  # supports that hold one direction in the plane: which two of their axes lie in it
        for row in c.tilted:
            frame = c.supports[row].frame
            k = axes[2] if frame is None else int(np.argmax(np.abs(frame[axes[2]])))
            i, j = (k + 1) % 3, (k + 2) % 3
            held[row] = c.held[row, [i, j, 3 + k]]
            if held[row, 0] != held[row, 1]:
                self._slides[row] = [i, j]
        for k, row in enumerate(c.lead_row):
            if row >= 0:
                held[c.n_supports + k] = held[row]
        return held

    def project(self, tables: Tables) -> Tables:
        N_s, dx, C, C_full, reference = tables
        a, n = self._directions
        flat = np.empty((*C.shape[:2], 6, LANES))
        full = None if C_full is None else C_full.reshape(*C.shape[:2], 6, 6, LANES)
        C = C.reshape(*C.shape[:2], 6, LANES)

        def entry(i: int, j: int) -> Any:
            if i == j:
                return C[:, :, i]
            return 0.0 if full is None else full[:, :, i, j]

        flat[:, :, 0] = entry(2, 2)
        flat[:, :, 1] = entry(2, 0) * a[0] + entry(2, 1) * a[1]
        flat[:, :, 2] = entry(2, 3) * n[0] + entry(2, 4) * n[1]
        flat[:, :, 3] = entry(0, 0) * a[0] ** 2 + entry(1, 1) * a[1] ** 2 + 2 * entry(0, 1) * a[0] * a[1]
        flat[:, :, 4] = sum(entry(i, 3 + j) * a[i] * n[j] for i in range(2) for j in range(2))
        flat[:, :, 5] = entry(3, 3) * n[0] ** 2 + entry(4, 4) * n[1] ** 2 + 2 * entry(3, 4) * n[0] * n[1]
        return N_s, dx, flat.reshape(*C.shape[:2], -1), None, self._strains(reference)

    @property
    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions across and normal (2, P, 1, LANES) in the sections of each element."""
        node = self._place[2]
        across, normal = (
            np.moveaxis(d[node][..., :2], -1, 0)[:, :, None] for d in (self.plane.across, self.plane.normal)
        )
        return across, normal

    def _strains(self, values: np.ndarray) -> np.ndarray:
        """Stretch, shear, bend (P, Q, 3 * LANES) of strains (P, Q, 6 * LANES)."""
        a, n = self._directions
        rows = values.reshape(*values.shape[:2], 6, LANES)
        out = np.empty((*values.shape[:2], 3, LANES))
        out[:, :, 0] = rows[:, :, 2]
        out[:, :, 1] = rows[:, :, 0] * a[0] + rows[:, :, 1] * a[1]
        out[:, :, 2] = rows[:, :, 3] * n[0] + rows[:, :, 4] * n[1]
        return out.reshape(*values.shape[:2], -1)

    def take(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n, stress = len(state.r), state.stress[0]
        flat, p, sigma = np.empty((n, 2)), np.empty((n, 2)), np.empty((*stress.shape[:2], 3 * LANES))
        planar.enter(*self._place, state.r, state.q, stress, flat, p, sigma)
        return flat, p, sigma

    def give_all(
        self, state: State, times: list[float], r: np.ndarray, q: np.ndarray, sigma: np.ndarray
    ) -> list[State]:
        place, turned = np.empty((*r.shape[:2], 3)), np.empty((*q.shape[:2], 4))
        stress = np.empty((*sigma.shape[:3], 6 * LANES))
        place[..., self.plane.axes[2]] = self.plane.height
        planar.leave_all(*self._place, r, q, sigma, place, turned, stress)
        return super().give_all(state, times, place, turned, stress)

    def holds(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self._check_poses(t)
        return super().holds(t)

    def places(self, t: float, targets: Targets | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self._check_poses(t)
        return super().places(t, targets)

    def _check_poses(self, t: float) -> None:
        """SceneError if a motion that could not be checked before leaves the plane."""
        if self.plane.watched:
            for part in self.model.constraints.moving_parts:
                self.plane.check_pose(part, t)

    def _holds(self, targets: Targets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        plane, c = self.plane, self.model.constraints
        return plane.flat(targets.place), plane.numbers(targets.quaternion, c.support_node), self._frames(targets)

    def _frames(self, targets: Targets) -> np.ndarray:
        if not self._slides:
            return NO_FRAMES
        c, axes = self.model.constraints, list(self.plane.axes[:2])
        T = np.tile(np.eye(3), (len(c.nodes), 1, 1))
        for row, columns in self._slides.items():
            T[row, :2, :2] = targets.axes[row][axes][:, columns]
        for k, row in enumerate(c.lead_row):
            if row >= 0:
                T[c.n_supports + k] = T[row]
        return T

    @property
    def frame(self) -> tuple[Any, ...] | None:
        return (*self._place, self.plane.height)

    def loads(self, table: NodalLoads) -> tuple[Any, ...]:
        force, moment = self.plane.loads(table)
        turning = bool(table.kinds[:, [0, 2]].any() and force.any())
        return (table.nodes, force, moment, table.kinds, turning), turning

    def rates(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        return self.plane.rates(values, nodes)

    def in_space(self, values: np.ndarray, nodes: Nodes = slice(None)) -> np.ndarray:
        return self.plane.in_space(values, nodes)

    def flat(self, values: np.ndarray) -> np.ndarray:
        return self.plane.flat(values)

    def driven(self, driven: Driven) -> tuple[np.ndarray, np.ndarray]:
        v, a = super().driven(driven)
        return self.plane.rates(v, driven.nodes), self.plane.rates(a, driven.nodes)

    @property
    def symmetric(self) -> bool:
        """In a plane a moment has a potential: only forces that follow have none."""
        turning = (getattr(t, "follower", False) or getattr(t, "components", "all") != "all" for t in self.model.terms)
        return not any(turning)


def border(model: Model) -> SpaceBorder:
    """The border of a model, made once."""
    return SpaceBorder(model) if model.plane is None else PlaneBorder(model)


def _number_joints(model: Model, segments: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Nodes of joints, the joint that each belongs to, half width of the band; joints of `segments` are numbered anew.

    Reverse Cuthill and McKee keeps joints that share a segment near each other.
    """
    joints = model.constraints.joints
    if not joints:
        return NO_NODES, NO_NODES, 0
    ends = segments[:, 3:5]
    between = ends[(ends >= 0).all(axis=1)]
    n = len(joints)
    rows, columns = np.concatenate([between, between[:, ::-1]]).T
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), (n, n))
    number = np.empty(n, dtype=np.int64)
    number[reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True)] = np.arange(n)
    segments[:, 3:5] = np.where(ends >= 0, number[ends], -1)
    apart = int(np.abs(np.diff(segments[(ends >= 0).all(axis=1), 3:5])).max(initial=0))
    index = np.concatenate([np.full(len(nodes), number[j]) for j, nodes in enumerate(joints)])
    return np.concatenate(joints), index, d * apart + d - 1
