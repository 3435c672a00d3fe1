"""Does everything stay in one plane? Then a node has three unknowns instead of six.

Rule: a scene lies in a plane if what is drawn lies in planes parallel to it, sections have an axis of stiffness and one of
inertia along its normal, and loads, supports and motions neither push nor turn anything out of it. Each of these is checked
and each fault is said by name. What depends on a function of time is not known beforehand: a plane that was asked for is
then checked at every call, one that the package should choose ("auto") is not taken.

Every node keeps its distance from the plane and turns about the normal only: its quaternion is P o base with a constant
`base` and P = (cos theta/2, sin theta/2 normal). Positions, quaternions and forces of a state are always those in space;
this room translates. Whether a planar equilibrium would leave its plane cannot be seen in it: see `stability.out_of_plane`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .constraint import Constraints
from .errors import SceneError
from .kernels.rotation import conjugate, matrix_from_quaternion, multiply
from .mechanism import Hinge, Part, Path, Slider
from .schedule import Schedule
from .space import Space, State
from .terms.external import NodalLoads

AXES = {"xy": (0, 1, 2), "yz": (1, 2, 0), "xz": (2, 0, 1)}  # two axes of the plane and its normal, right-handed
FLAT = 1e-9  # relative: what is less out of the plane lies in it


@dataclass(frozen=True, eq=False)
class ScenePlane:
    """A plane and the constants that translate between it and space.

    name: "xy", "yz" or "xz"; axes: numbers of its two axes and its normal. height (N,) [m]: of nodes along the normal; base
    (N, 4): constant part of the quaternions; across, normal (N, 3): in the section's axes, the direction in the plane that
    is the section's tangent turned by 90 deg, and the plane's normal. watched: a load or motion is a function of time, to be
    checked at every call.
    """

    name: str
    axes: tuple[int, int, int]
    height: np.ndarray
    base: np.ndarray
    across: np.ndarray
    normal: np.ndarray
    watched: bool

    @property
    def out_of_plane(self) -> list[int]:
        """Numbers of the rigid motions (x, y, z, turns about x, y, z) out of the plane."""
        i, j, k = self.axes
        return [k, 3 + i, 3 + j]

    def numbers(self, q: np.ndarray, nodes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """exp(i theta / 2) (n, 2) of quaternions (n, 4) at nodes."""
        P = multiply(q, conjugate(self.base[nodes]))
        return np.ascontiguousarray(P[:, [0, 1 + self.axes[2]]])

    def flat(self, vectors: np.ndarray) -> np.ndarray:
        """Components (..., 2) in the plane of vectors in space (..., 3)."""
        return np.ascontiguousarray(vectors[..., self.axes[:2]])

    def rates(self, values: np.ndarray, nodes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Velocities or forces (..., n, 3) of nodes from (..., n, 6): translation in space, rotation in section axes."""
        out = np.empty((*values.shape[:-1], 3))
        out[..., 0], out[..., 1] = values[..., self.axes[0]], values[..., self.axes[1]]
        out[..., 2] = (values[..., 3:] * self.normal[nodes]).sum(-1)
        return out

    def in_space(self, values: np.ndarray, nodes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """The inverse of `rates`: (..., n, 6) from (..., n, 3), at nodes."""
        out = np.zeros((*values.shape[:-1], 6))
        out[..., self.axes[0]], out[..., self.axes[1]] = values[..., 0], values[..., 1]
        out[..., 3:] = values[..., 2:] * self.normal[nodes]
        return out

    def loads(self, table: NodalLoads) -> tuple[np.ndarray, np.ndarray]:
        """Force (L, 2) and moment (L, 1) in the plane; those that follow have components along tangent and `across`.

        SceneError if a load that could not be checked before acts out of the plane.
        """
        if not table.kinds.any():
            force, moment = table.force[:, self.axes[:2]], table.moment[:, self.axes[2]]
        else:
            across, normal = self.across[table.nodes], self.normal[table.nodes]
            along = np.stack([table.force[:, 2], (table.force * across).sum(-1)], axis=1)
            force = np.where(table.kinds[:, :1], along, table.force[:, self.axes[:2]])
            moment = np.where(table.kinds[:, 1], (table.moment * normal).sum(-1), table.moment[:, self.axes[2]])
        if self.watched:
            for given, kept in ((table.force, np.linalg.norm(force, axis=1)), (table.moment, np.abs(moment))):
                size = np.linalg.norm(given, axis=1)
                if (size - kept > FLAT * size.max(initial=0.0)).any():
                    raise SceneError(
                        f'model: plane = "{self.name}": a load that is a function of time leaves the plane. '
                        "Leave `plane` out."
                    )
        return np.ascontiguousarray(force), np.ascontiguousarray(moment[:, None])

    def check_pose(self, part: Part, t: float) -> None:
        """SceneError if a motion that could not be checked before leaves the plane."""
        if not _stays(part, t, self.axes[2]):
            raise SceneError(
                f'part {part.name!r}: leaves the plane "{self.name}" at t = {t:g} s. Leave `plane` out of the model.'
            )

    def check_state(self, state: State) -> None:
        """ValueError if a state does not lie in the plane."""
        P = multiply(state.q, conjugate(self.base))
        if np.abs(P[:, [1 + self.axes[0], 1 + self.axes[1]]]).max() > 1e-6:
            raise ValueError(f'start: this state does not lie in the plane "{self.name}" of the model.')


def choose_plane(
    wanted: str | None, space: Space, constraints: Constraints, terms: Sequence[Any]
) -> tuple[ScenePlane | None, str]:
    """The plane of a model, if it has or should have one, and why.

    Raises
    ------
    SceneError
        A plane was asked for and something leaves it; all faults are said.
    """
    if wanted is None:
        return None, "not asked for"
    if wanted != "auto":
        plane, faults = _find(wanted, space, constraints, terms)
        if plane is None:
            raise SceneError([f'model: plane = "{wanted}": {fault}' for fault in faults])
        return plane, f'plane = "{wanted}" was asked for'
    reasons = []
    for name in AXES:
        plane, faults = _find(name, space, constraints, terms)
        if plane is not None and plane.watched:
            faults = ["a load or motion is a function of time that cannot be checked beforehand."]
        elif plane is not None:
            return plane, f'everything lies and acts in the plane "{name}"'
        reasons.append((name, faults))
    flat = [(name, faults) for name, faults in reasons if not any("is not drawn in" in fault for fault in faults)]
    if not flat:
        return None, f"no plane: {_sentence(reasons[0][1][0])} Nor are the rods drawn in another plane of two axes."
    return None, "no plane: " + " ".join(f'"{name}": {_sentence(faults[0])}' for name, faults in flat)


def _sentence(fault: str) -> str:
    """The first sentence of a fault: what is wrong, not what to do."""
    return fault.split(". ")[0].rstrip(".") + "."


def _find(
    name: str, space: Space, constraints: Constraints, terms: Sequence[Any]
) -> tuple[ScenePlane | None, list[str]]:
    """The plane of this name, or what leaves it."""
    axes = AXES[name]
    faults = list(_unknown(space, terms))
    base, across, normal, undrawn = _sections(space, axes, name)
    if undrawn:
        return None, undrawn + faults
    faults += _stiffness(space, across, normal, terms)
    faults += _supports(constraints, axes, name)
    acting, watched = _loads(space, terms, axes, name, across, normal)
    faults += acting
    watched |= any(_is_function(part.motion) for part in constraints.moving_parts)
    if faults:
        return None, faults
    return ScenePlane(name, axes, space.drawn_state().r[:, axes[2]].copy(), base, across, normal, watched), []


def _unknown(space: Space, terms: Sequence[Any]) -> Iterator[str]:
    """What the planar element does not know."""
    if space.rotation != "quaternion":
        yield 'needs rotation = "quaternion".'
    if len(space.groups) > 1:
        orders = sorted({rod.order for rod in space.rods})
        yield f"rods have elements of different order ({', '.join(map(str, orders))}). Give all of them one order."
    for term in terms:
        if not getattr(term, "tabulated", False):
            yield f"{term.name!r} has no planar form. Leave `plane` out to run the scene in space."


def _sections(
    space: Space, axes: tuple[int, int, int], name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Constant part of the quaternions (N, 4), directions `across` and normal in section axes (N, 3), and faults."""
    drawn, k = space.drawn_state(), axes[2]
    base, across, normal = np.empty_like(drawn.q), np.empty((space.n_nodes, 3)), np.empty((space.n_nodes, 3))
    faults = []
    for rod in space.rods:
        nodes = space[rod].nodes
        q, height = drawn.q[nodes], drawn.r[nodes, k]
        R = matrix_from_quaternion(q[0])
        half = 0.5 * np.arctan2(R[axes[1], 2], R[axes[0], 2])
        start = np.zeros(4)
        start[0], start[1 + k] = np.cos(half), -np.sin(half)
        base[nodes] = multiply(start, q[0])
        P = multiply(q, conjugate(base[nodes]))
        spread = float(np.ptp(height))
        tilt = float(np.abs(P[:, [1 + axes[0], 1 + axes[1]]]).max())
        if spread > FLAT * rod.length or abs(R[k, 2]) > FLAT:
            faults.append(
                f"rod {rod.name!r} is not drawn in it: it covers {max(spread, abs(R[k, 2]) * rod.length):.3g} m "
                f"along {'xyz'[k]}. Draw it in the plane, or leave `plane` out."
            )
        elif tilt > FLAT:
            faults.append(f"the sections of rod {rod.name!r} turn about its axis. Leave `normal` and `end_normal` out.")
        normal[nodes] = R[k]
        across[nodes] = np.array([R[k, 1], -R[k, 0], 0.0])  # normal x d3 in section axes
    return base, across, normal, faults


def _basis(across: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Strains (6, 6): rows stretch, shear, bend in the plane, then shear, bend, twist out of it, for one section."""
    B = np.zeros((6, 6))
    B[0, 2] = B[5, 5] = 1.0
    B[1, :3], B[2, 3:], B[3, :3], B[4, 3:] = across, normal, normal, across
    return B


def _stiffness(space: Space, across: np.ndarray, normal: np.ndarray, terms: Sequence[Any]) -> Iterator[str]:
    """Sections whose stiffness, damping, inertia or rest shape couples the plane with what is out of it."""
    for k, group in enumerate(space.groups):
        matrices = [("stiffness", group.stiffness)]
        matrices += [("damping", term.coefficients(space, k)) for term in terms if getattr(term, "internal", False)]
        for rod, view in space.views.items():
            if view.group != k:
                continue
            B = _basis(across[view.nodes[0]], normal[view.nodes[0]])
            for what, C in matrices:
                C = B @ C[view.elements] @ B.T
                size = np.sqrt(np.abs(np.diagonal(C, axis1=-2, axis2=-1)))
                if (np.abs(C[..., :3, 3:]) > FLAT * size[..., :3, None] * size[..., None, 3:]).any():
                    yield (
                        f"the {what} of rod {rod.name!r} couples the plane with what is out of it: no principal axis of its "
                        "section is normal to the plane. Give the rod another `normal`."
                    )
            rest = group.reference[view.elements] @ B.T
            if (np.abs(rest[..., 3]) > FLAT).any() or (np.abs(rest[..., 4:]) * rod.length > FLAT).any():
                yield f"the stress-free shape of rod {rod.name!r} is bent or twisted out of it."
            J = space.node_inertia[view.nodes]
            if (np.abs((J[:, 0] - J[:, 1]) * B[2, 3] * B[2, 4]) > FLAT * J.max(axis=1)).any():
                yield f"no principal axis of inertia of rod {rod.name!r} is normal to it."


def _supports(constraints: Constraints, axes: tuple[int, int, int], name: str) -> Iterator[str]:
    """Supports that free or move something out of the plane."""
    k = axes[2]
    for row in constraints.tilted:
        support = constraints.supports[row]
        frame = np.eye(3) if support.frame is None else support.frame
        if np.abs(np.abs(frame[k]) - 1.0).min() > FLAT:
            yield f"support {support.name!r}: no axis of its frame is normal to it."
    for part in constraints.moving_parts:
        motion = part.motion
        if isinstance(motion, Hinge):
            stays = abs(abs(motion.axis[k]) - 1.0) <= FLAT
        elif isinstance(motion, Slider):
            stays = abs(motion.axis[k]) <= FLAT
        elif _is_function(motion):
            continue  # known only when it is asked
        else:
            stays = all(_stays(part, float(t), k) for t in motion.motion[0])  # type: ignore[union-attr]
        if not stays:
            yield f"part {part.name!r} moves out of it."


def _is_function(motion: Any) -> bool:
    """True for a motion whose axis may change in ways that only its function knows."""
    return not isinstance(motion, Hinge | Slider) and not (isinstance(motion, Path) and not callable(motion.motion))


def _stays(part: Part, t: float, k: int) -> bool:
    R, c = part.pose(t)
    drawn = part.pose(part.drawn_at)[1][k]
    return bool(abs(R[k, k] - 1.0) <= FLAT and abs(c[k] - drawn) <= FLAT * max(1.0, np.abs(c).max()))


def _loads(
    space: Space, terms: Sequence[Any], axes: tuple[int, int, int], name: str, across: np.ndarray, normal: np.ndarray
) -> tuple[list[str], bool]:
    """Loads that act out of the plane; whether one is a function of time and cannot be told beforehand."""
    k, faults, watched = axes[2], [], False
    for term in terms:
        if hasattr(term, "acceleration"):
            values, moments = term.acceleration[None], np.zeros((1, 3))
            axis = np.eye(3)[k]
        elif hasattr(term, "schedules"):
            follower = term.follower
            node = space[term.rod].nodes[0]
            axis = normal[node] if follower else np.eye(3)[k]
            watched |= any(schedule.is_function for schedule in term.schedules)
            values, moments = (_values(schedule) for schedule in term.schedules)
        else:
            continue
        size, most = np.abs(values).max(initial=0.0), np.abs(moments).max(initial=0.0)
        if (np.abs(values @ axis) > FLAT * size).any():
            faults.append(f"{term.name!r} pulls out of it.")
        if (np.abs(moments - (moments @ axis)[:, None] * axis) > FLAT * most).any():
            faults.append(f"{term.name!r} has a moment that turns out of it.")
    return faults, watched


def _values(schedule: Schedule) -> np.ndarray:
    """All values (K, 3) that a schedule takes or lies between; none of a function."""
    if schedule.is_function:
        return np.empty((0, 3))
    return schedule.at(0.0)[None] if schedule.times is None else schedule.values
