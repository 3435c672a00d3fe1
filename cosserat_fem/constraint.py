"""Which unknowns are held, and where must they go? Supports and welds as coordinates of vertices.

Rule: held unknowns are prescribed, not multiplied. At a supported vertex the six increments are written as du = T y,
with y along and about the axes in which the support holds and frees; held entries of y get the gap that is still
missing, so a support is met exactly when the Newton method has taken its steps. A welded vertex moves with the first
one of its joint: the same displacement, the rotation seen in its own frame.

One free rotation turns about an axis of the part, R = Rot_i(a) R_target. Two make a cardan joint, R = Rot_i(a) Rot_j(b)
R_target (Tait-Bryan angles of the sequence i, k, j; the middle one, about the third axis k, is held at 0). Its unknowns
are a about f_i and b about Rot_i(a) f_j; because these do not commute, the moment m left on the joint adds
m . (axis_i x axis_j) / 2 to the tangent between a and b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import SceneError
from .kernels.loads import loads_in_space
from .kernels.rotation import (
    kardan_from_matrix,
    matrix_from_quaternion,
    matrix_from_vector,
    multiply,
    quaternion_from_matrix,
    quaternion_from_vector,
    relative_rotation,
)
from .mechanism import Part
from .space import Space, State
from .support import COMPONENTS, Support, Weld

KNOWN = 256  # times whose targets are remembered: they are checked before a travel, then asked for again
NO_BLOCKS, NO_ROWS = np.empty((0, 6, 6)), np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Targets:
    """Where the supports are at one time: place (M, 3), attitude (M, 3, 3) and quaternion (M, 4), axes (M, 3, 3)."""

    place: np.ndarray
    attitude: np.ndarray
    quaternion: np.ndarray
    axes: np.ndarray


@dataclass(frozen=True, eq=False)
class Held:
    """Supports at one state, for the special vertices: T (M, 6, 6), gap (M, 6); couples (C, 6, 6) at `at` (C,)."""

    T: np.ndarray
    gap: np.ndarray
    couples: np.ndarray
    at: np.ndarray


class Constraints:
    """Supports and welds of a model on its space.

    Attributes
    ----------
    nodes (M,) : special vertices: supported ones, then the welded ones that follow a joint's first vertex
    held (M, 6) : which unknowns y are prescribed there
    owner (M,) : False for vertices that follow another one
    left, right (M,) : element (number in the whole model) that ends or starts there, or -1
    joints (list of arrays) : node numbers that are one joint, the first one leading
    """

    def __init__(self, space: Space, supports: Sequence[Support], welds: Sequence[Weld]) -> None:
        self.space = space
        self.supports = tuple(supports)
        drawn = space.drawn_state()
        self.joints = _joints(space, welds)
        leader = {int(k): int(joint[0]) for joint in self.joints for k in joint}
        places = [space.node(h.rod, h.rod.place(h.at, "support")) for h in self.supports]
        self.support_node = np.array([leader.get(k, k) for k in places], dtype=np.int64)
        _check_twice(self.supports, self.support_node)

        follow = np.array([k for joint in self.joints for k in joint[1:]], dtype=np.int64)
        self.lead = lead = np.array([joint[0] for joint in self.joints for _ in joint[1:]], dtype=np.int64)
        self.n_supports = len(self.supports)
        self.nodes = np.concatenate([self.support_node, follow]).astype(np.int64)
        self.row_of = {int(k): row for row, k in enumerate(self.support_node)}
        self.lead_row = np.array([self.row_of.get(int(k), -1) for k in lead], dtype=np.int64)
        # rotation of a follower seen from its leader: phi_follow = Q^T phi_lead with Q = R_lead^T R_follow
        R = matrix_from_quaternion(drawn.q)
        self.seen = np.einsum("nki,nkj->nij", R[follow], R[lead])
        self.held = np.zeros((len(self.nodes), 6), dtype=bool)
        for row, support in enumerate(self.supports):
            self.held[row] = support.held
        for k, row in enumerate(self.lead_row):
            if row >= 0:
                self.held[self.n_supports + k] = self.held[row]
        self.owner = np.arange(len(self.nodes)) < self.n_supports
        self.left, self.right = _neighbours(space, self.nodes)
        self._drawn_r = drawn.r[self.support_node]
        self._drawn_R = R[self.support_node]
        self._frame = np.array([np.eye(3) if h.frame is None else h.frame for h in self.supports]).reshape(-1, 3, 3)
        self._moving = {
            part: np.array([row for row, h in enumerate(self.supports) if h.to is part])
            for part in {h.to for h in self.supports if h.to.motion is not None}
        }
        self._known: dict[float, Targets] = {}
        self.tilted = [row for row, h in enumerate(self.supports) if _is_tilted(h)]
        self.transforms = bool(self.tilted) or len(follow) > 0

    @property
    def moving_parts(self) -> list[Part]:
        """Parts with a motion that hold a rod."""
        return list(self._moving)

    def targets(self, t: float) -> Targets:
        """Places and attitudes of all supports at time t, from the motion of their parts; recent times are known."""
        if t not in self._known:
            if len(self._known) >= KNOWN:
                self._known.clear()
            self._known[t] = self._find_targets(t)
        return self._known[t]

    def _find_targets(self, t: float) -> Targets:
        place, attitude, axes = self._drawn_r.copy(), self._drawn_R.copy(), self._frame.copy()
        for part, rows in self._moving.items():
            R, c = part.pose(t)
            place[rows] = self._drawn_r[rows] @ R.T + c
            attitude[rows] = R @ self._drawn_R[rows]
            axes[rows] = R @ self._frame[rows]
        return Targets(place, attitude, quaternion_from_matrix(attitude), axes)

    def driven(self, t: float, *, before: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration (supports, 6) of the supported places at (or just before) time t.

        Translation in space [m/s, m/s^2], rotation in the axes of the held section [rad/s, rad/s^2].
        """
        velocity, acceleration = np.zeros((self.n_supports, 6)), np.zeros((self.n_supports, 6))
        for part, rows in self._moving.items():
            R, _ = part.pose(t)
            rates = part.rates(t, before=before)
            arm = self._drawn_r[rows] @ R.T
            swept = np.cross(rates.omega, arm)
            velocity[rows, :3] = swept + rates.c_rate
            acceleration[rows, :3] = np.cross(rates.alpha, arm) + np.cross(rates.omega, swept) + rates.c_acceleration
            attitude = R @ self._drawn_R[rows]
            velocity[rows, 3:] = rates.omega @ attitude
            acceleration[rows, 3:] = rates.alpha @ attitude
        return velocity, acceleration

    def part_way(self, state: State, targets: Targets, part: float) -> Targets:
        """Targets between where a state is and where it must go."""
        place = (1 - part) * state.r[self.support_node] + part * targets.place
        q = state.q[self.support_node]
        turned = multiply(q, quaternion_from_vector(part * relative_rotation(q, targets.quaternion)))
        return Targets(place, matrix_from_quaternion(turned), turned, targets.axes)

    def evaluate(self, state: State, targets: Targets, moments: np.ndarray | None = None) -> Held:
        """Coordinates and gaps at a state.  moments (supports, 3) [N m]: what is left on the supports, in space."""
        n, M = self.n_supports, len(self.nodes)
        gap = np.zeros((M, 6))
        gap[:n, :3] = targets.place - state.r[self.support_node]
        if state.angles is None:
            gap[:n, 3:] = relative_rotation(state.q[self.support_node], targets.quaternion)
        else:
            gap[:n, 3:] = _wrapped(kardan_from_matrix(targets.attitude) - state.angles[self.support_node])
        if not self.transforms:
            gap *= self.held
            return Held(NO_BLOCKS, gap, NO_BLOCKS, NO_ROWS)
        couples, at = [], []
        T = np.tile(np.eye(6), (M, 1, 1))
        for row in self.tilted:
            couple = self._tilt(row, state, targets, T[row], gap[row], None if moments is None else moments[row])
            if couple is not None:
                couples.append(couple)
                at.append(row)
        for k, lead_row in enumerate(self.lead_row):
            row = n + k
            T[row, 3:, 3:] = self.seen[k]
            if lead_row >= 0:
                T[row] = T[row] @ T[lead_row]
                gap[row] = gap[lead_row]
        gap *= self.held
        return Held(T, gap, np.array(couples).reshape(-1, 6, 6), np.array(at, dtype=np.int64))

    def _tilt(
        self, row: int, state: State, targets: Targets, T: np.ndarray, gap: np.ndarray, moment: np.ndarray | None
    ) -> np.ndarray | None:
        """Fill T and gap of a support that frees some of the components; return its couple block, if any."""
        node, axes = self.support_node[row], targets.axes[row]
        T[:3, :3] = axes
        gap[:3] = axes.T @ gap[:3]
        free = [c for c in self.supports[row].free if c.startswith("r")]
        if self.held[row, 3:].all() or not self.held[row, 3:].any():
            return None
        R = matrix_from_quaternion(state.q[node])
        relative = axes.T @ R @ targets.attitude[row].T @ axes  # from the target, seen in the joint's axes
        turns = [COMPONENTS.index(c) - 3 for c in free]
        couple = None
        if len(turns) == 1:
            i = turns[0]
            J, missing = axes, _swing(relative, i)
            gap[3:] = missing
        else:
            i, j = turns
            k = 3 - i - j
            a, c = _first_and_middle(relative, i, k, j)
            J = axes @ matrix_from_vector(a * np.eye(3)[i])
            gap[3 + k] = -c
            if moment is not None:
                couple = np.zeros((6, 6))
                couple[3 + i, 3 + j] = couple[3 + j, 3 + i] = 0.5 * moment @ np.cross(J[:, i], J[:, j])
        T[3:, 3:] = np.linalg.solve(self.space.spin_axes(state, np.array([node]))[0], J)
        return couple

    def reactions(self, state: State, g: np.ndarray) -> np.ndarray:
        """Force and moment (supports, 6) on the rods, in space: the residual left at each support's joint."""
        loads = self._spatial(state, g, self.support_node)
        for joint in self.joints:
            row = self.row_of.get(int(joint[0]))
            if row is not None:
                loads[row] = self._spatial(state, g, joint).sum(0)
        return loads

    def _spatial(self, state: State, g: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Force and moment in space (n, 6) of the residual at nodes: the moment M has the components h_i . M."""
        if state.angles is None:
            loads = np.empty((len(nodes), 6))
            loads_in_space(nodes, state.q, g, loads)
            return loads
        loads, H = g[nodes], self.space.spin_axes(state, nodes)
        loads[:, 3:] = np.linalg.solve(np.swapaxes(H, 1, 2), loads[:, 3:, None])[..., 0]
        return loads

    def in_unknowns(self, state: State, g: np.ndarray, held: Held) -> np.ndarray:
        """Residual (N, 6) along the unknowns y of special vertices; followers' shares are moved to their leaders."""
        if not self.transforms:
            return g
        out = g.copy()
        for k, lead in enumerate(self.lead):
            follow = self.nodes[self.n_supports + k]
            out[lead, :3] += g[follow, :3]
            out[lead, 3:] += self.seen[k].T @ g[follow, 3:]
            out[follow] = 0.0
        for row in self.tilted:
            out[self.support_node[row]] = held.T[row].T @ out[self.support_node[row]]
        return out


def _is_tilted(support: Support) -> bool:
    """True if the support's unknowns are not simply those of the node."""
    held = support.held
    translations = held[:3].all() or not held[:3].any()
    rotations = held[3:].all() or not held[3:].any()
    return not (translations and rotations)


def _joints(space: Space, welds: Sequence[Weld]) -> list[np.ndarray]:
    """Sets of nodes joined by welds, each sorted."""
    parent: dict[int, int] = {}

    def root(k: int) -> int:
        parent.setdefault(k, k)
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for weld in welds:
        a = space.node(weld.rod, weld.rod.place(weld.at, "weld"))
        b = space.node(weld.other, weld.other.place(weld.other_at, "weld"))
        low, high = sorted((root(a), root(b)))
        parent[high] = low
    joints: dict[int, list[int]] = {}
    for k in parent:
        joints.setdefault(root(k), []).append(k)
    return [np.array(sorted(nodes)) for _, nodes in sorted(joints.items()) if len(nodes) > 1]


def _neighbours(space: Space, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Element that ends and element that starts at each vertex, numbered through all groups, or -1."""
    left, right = np.full(space.n_nodes, -1, dtype=np.int64), np.full(space.n_nodes, -1, dtype=np.int64)
    first = 0
    for group in space.groups:
        numbers = first + np.arange(group.n_elements)
        right[group.conn[:, 0]] = numbers
        left[group.conn[:, 1]] = numbers
        first += group.n_elements
    return left[nodes], right[nodes]


def _check_twice(supports: Sequence[Support], nodes: np.ndarray) -> None:
    """SceneError if two supports hold the same place of a rod."""
    seen: dict[int, Support] = {}
    for support, node in zip(supports, nodes, strict=True):
        if int(node) in seen:
            other = seen[int(node)]
            same = [c for c, a, b in zip(COMPONENTS, support.held, other.held, strict=True) if a and b]
            what = f"both hold {', '.join(same)}" if same else "act at one section"
            raise SceneError(
                f"support {support.name!r}: {other.name!r} is at the same place of rod {support.rod.name!r}; {what}. "
                "Use one support and free what it should not hold."
            )
        seen[int(node)] = support


def _wrapped(angles: np.ndarray) -> np.ndarray:
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _swing(relative: np.ndarray, i: int) -> np.ndarray:
    """Rotation vector (3,) that takes `relative` to the nearest pure rotation about axis i; its entry i is not used."""
    q = quaternion_from_matrix(relative)
    a = 2.0 * np.arctan2(q[1 + i], q[0])
    wanted = matrix_from_vector(a * np.eye(3)[i])
    start = quaternion_from_matrix(np.eye(3))
    return relative_rotation(start[None], quaternion_from_matrix(wanted @ relative.T)[None])[0]


def _first_and_middle(relative: np.ndarray, i: int, k: int, j: int) -> tuple[float, float]:
    """First and middle Tait-Bryan angle of relative = Rot_i(a) Rot_k(c) Rot_j(b)."""
    sign = 1.0 if (k - i) % 3 == 1 else -1.0
    # Rot_k and Rot_i act on e_j: its component i is +-sin c, the others +-cos c (cos a, sin a)
    v = relative[:, j]
    c = float(np.arcsin(np.clip(sign * v[i], -1.0, 1.0)))
    a = float(np.arctan2(-sign * v[k], v[j]))
    return a, c
