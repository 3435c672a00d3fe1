"""What shape is a rigid body for contact? Closed forms, in the frame a part is drawn in.

Rule: a shape is a canonical body (`kind`, `size`) in a frame: x = origin + frame @ y. The canonical plane is y_z <= 0;
sphere, cylinder (radius, half length), capsule and box (half edges) stand about the origin, axes along z; the torus
(radius, tube) lies around z. Meshes are `Surface`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .curve import perpendicular, unit
from .errors import check_positive, check_shape
from .surface import Surface as Surface

FACETS = 96  # triangles are drawn that many to a turn


@dataclass(frozen=True, eq=False)
class Plane:
    """A half space: solid below the plane, free where the normal points.

    Parameters
    ----------
    point : (3,) [m]
        A point of the plane.
    normal : (3,)
        Direction, any length.
    """

    point: Any
    normal: Any
    kind: ClassVar[int] = 0
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _place(self, check_shape("plane: point", self.point, (3,)), _frame(unit("plane: normal", self.normal)))

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """A square patch of half width `extent` [m] about the point: points (4, 3) [m] and triangles (2, 3)."""
        corners = np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
        return _drawn(self, extent * corners), np.array([(0, 1, 2), (0, 2, 3)])

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        return _local(self, points)[:, 2]


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball.

    Parameters
    ----------
    center : (3,) [m]
    radius : [m]
    """

    center: Any
    radius: float
    kind: ClassVar[int] = 1
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        center = check_shape("sphere: center", self.center, (3,))
        _place(self, center, np.eye(3), check_positive("sphere: radius", self.radius))

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Closed surface: points (P, 3) [m], triangles (F, 3)."""
        return _revolved(self, _arc(self.size[0], -0.5, 0.5, poles=True))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        return np.linalg.norm(_local(self, points), axis=1) - self.size[0]


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A solid cylinder with flat ends.

    Parameters
    ----------
    start, end : (3,) [m]
        Middles of its ends.
    radius : [m]
    """

    start: Any
    end: Any
    radius: float
    kind: ClassVar[int] = 2
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        middle, frame, half = _between("cylinder", self.start, self.end)
        _place(self, middle, frame, check_positive("cylinder: radius", self.radius), half)

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Closed surface: points (P, 3) [m], triangles (F, 3)."""
        radius, half, _ = self.size
        return _revolved(self, np.array([(0.0, -half), (radius, -half), (radius, half), (0.0, half)]))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        y = _local(self, points)
        return _to_box(np.stack([np.hypot(y[:, 0], y[:, 1]), np.abs(y[:, 2])], axis=1) - self.size[:2])


@dataclass(frozen=True, eq=False)
class Capsule:
    """A solid cylinder with round ends.

    Parameters
    ----------
    start, end : (3,) [m]
        Ends of its axis, middles of the two half balls.
    radius : [m]
    """

    start: Any
    end: Any
    radius: float
    kind: ClassVar[int] = 3
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        middle, frame, half = _between("capsule", self.start, self.end)
        _place(self, middle, frame, check_positive("capsule: radius", self.radius), half)

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Closed surface: points (P, 3) [m], triangles (F, 3)."""
        radius, half, _ = self.size
        low, high = _arc(radius, -0.5, 0.0, poles=True), _arc(radius, 0.0, 0.5, poles=True)
        return _revolved(self, np.concatenate([low - (0.0, half), high + (0.0, half)]))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        y = _local(self, points)
        y[:, 2] -= np.clip(y[:, 2], -self.size[1], self.size[1])
        return np.linalg.norm(y, axis=1) - self.size[0]


@dataclass(frozen=True, eq=False)
class Box:
    """A solid box with sharp edges.

    Parameters
    ----------
    center : (3,) [m]
    edges : (3,) [m]
        Full lengths of its edges.
    axes : (3, 3), optional
        Directions of the edges, columns, right-handed; default x, y, z.
    """

    center: Any
    edges: Any
    axes: Any = None
    kind: ClassVar[int] = 4
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        center, edges = check_shape("box: center", self.center, (3,)), check_shape("box: edges", self.edges, (3,))
        for k, edge in enumerate(edges):
            check_positive(f"box: edge {k}", edge)
        frame = np.eye(3) if self.axes is None else check_shape("box: axes", self.axes, (3, 3))
        if np.abs(frame.T @ frame - np.eye(3)).max() > 1e-6 or np.linalg.det(frame) < 0.0:
            raise ValueError(
                "box: axes: columns must be unit vectors at right angles, right-handed "
                f"(got {np.round(frame, 6).tolist()})."
            )
        _place(self, center, frame, *edges / 2)

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Closed surface: points (8, 3) [m], triangles (12, 3)."""
        corners = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
        quads = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
        return _drawn(self, corners * self.size), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        return _to_box(np.abs(_local(self, points)) - self.size)


@dataclass(frozen=True, eq=False)
class Torus:
    """A ring of round section.

    Parameters
    ----------
    center : (3,) [m]
    axis : (3,)
        Direction the ring lies around, any length.
    radius : [m]
        Of the circle in the middle of its section.
    tube : [m]
        Radius of the section, smaller than `radius`.
    """

    center: Any
    axis: Any
    radius: float
    tube: float
    kind: ClassVar[int] = 5
    origin: np.ndarray = field(init=False, repr=False)
    frame: np.ndarray = field(init=False, repr=False)
    size: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        center, axis = check_shape("torus: center", self.center, (3,)), unit("torus: axis", self.axis)
        radius, tube = check_positive("torus: radius", self.radius), check_positive("torus: tube", self.tube)
        if tube >= radius:
            raise ValueError(f"torus: tube: must be smaller than the radius {radius:g} m (got {tube:g} m).")
        _place(self, center, _frame(axis), radius, tube)

    def surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Closed surface: points (P, 3) [m], triangles (F, 3)."""
        radius, tube, _ = self.size
        return _revolved(self, _arc(tube, -1.0, 1.0) + (radius, 0.0))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) [m] of points (n, 3) [m], negative inside."""
        y = _local(self, points)
        return np.hypot(np.hypot(y[:, 0], y[:, 1]) - self.size[0], y[:, 2]) - self.size[1]


Shape = Plane | Sphere | Cylinder | Capsule | Box | Torus


def _place(shape: Any, origin: np.ndarray, frame: np.ndarray, *size: float) -> None:
    """Set what kernels read: origin (3,), frame (3, 3) and size (3,), unused entries 0."""
    object.__setattr__(shape, "origin", origin)
    object.__setattr__(shape, "frame", frame)
    object.__setattr__(shape, "size", np.array([*size, 0.0, 0.0, 0.0][:3], dtype=float))


def _frame(axis: np.ndarray) -> np.ndarray:
    """Rotation matrix whose third column is a unit vector."""
    first = perpendicular(axis)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _between(name: str, start: Any, end: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Middle, frame and half length of an axis."""
    a, b = check_shape(f"{name}: start", start, (3,)), check_shape(f"{name}: end", end, (3,))
    length = float(np.linalg.norm(b - a))
    if length <= 1e-12 * max(np.abs(a).max(), np.abs(b).max()):
        raise ValueError(f"{name}: start and end are the same point {a.tolist()}; give two ends of its axis.")
    return (a + b) / 2, _frame((b - a) / length), length / 2


def _local(shape: Any, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) [m] in the canonical frame of a shape."""
    return (np.asarray(points, dtype=float).reshape(-1, 3) - shape.origin) @ shape.frame


def _drawn(shape: Any, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) [m] of the canonical frame, where the part is drawn."""
    return points @ shape.frame.T + shape.origin


def _to_box(beyond: np.ndarray) -> np.ndarray:
    """Signed distance (n,) to a box, from how far a point is beyond its faces (n, k)."""
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def _arc(radius: float, begin: float, end: float, *, poles: bool = False) -> np.ndarray:
    """Points (K, 2) of an arc between two angles [pi], as (distance from the axis, height); `poles` lie on the axis."""
    angle = np.pi * np.linspace(begin, end, max(2, round(FACETS * (end - begin) / 2)) + 1)
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if poles:
        points[np.abs(points[:, 0]) < 1e-9 * radius, 0] = 0.0
    return points


def _revolved(shape: Any, profile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Closed surface of revolution about z from a profile (K, 2), upwards with the solid on its left."""
    angle = 2 * np.pi * np.arange(FACETS) / FACETS
    rings = len(profile)
    points = np.stack(
        [
            np.outer(profile[:, 0], np.cos(angle)),
            np.outer(profile[:, 0], np.sin(angle)),
            np.repeat(profile[:, 1:], FACETS, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    index = np.arange(rings * FACETS).reshape(rings, FACETS)
    index[profile[:, 0] == 0.0] = index[profile[:, 0] == 0.0, :1]  # a pole is one point
    if np.allclose(profile[0], profile[-1], rtol=0.0, atol=1e-12 * np.abs(profile).max()):
        index[-1] = index[0]
    a, d = index[:-1], index[1:]
    b, c = np.roll(a, -1, axis=1), np.roll(d, -1, axis=1)
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    return _drawn(shape, points[used]), triangles.reshape(-1, 3)
