"""What does a triangle mesh offer to contact? Smooth patches, the triangles near a point, distances.

Rule: a mesh is taken as it is given. What can be put right without guessing (triangles that stand twice or have no area,
flipped facets) is put right and said in `report`; an open mesh is a sheet that is touched from both sides. A patch is
what a rod touches at one place: where two sides of a sharp concave edge meet, it touches both.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from .errors import MeshError
from .kernels.shapes import facets
from .kernels.triangles import dot, lower_to_triangles, winding_number
from .meshfile import LIMIT, too_large
from .repair import Edges, count, flat_triangles, merged, oriented, patches, renumbered, sewn

PAIRS = 2_000_000  # pairs of point and triangle that are kept at a time
FEW = 30_000  # pairs of points and triangles that are all looked at, without a search


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh prepared for contact, in the frame its points are given in.

    Parameters
    ----------
    points : (P, 3) [m]
    triangles : (F, 3)
        Indices of the corners, counter-clockwise seen from outside; facets that are not are turned.
    where : str
        What messages call it.

    After construction `points` and `triangles` (int64) are the repaired mesh, and
    closed : watertight; every edge is run as often one way as the other, so that there is an inside.
    patch : (F,) smooth patch of each triangle, 0, 1, ... : joined across edges, except where the two sides of a sharp
        concave edge (of any sharp edge, if the surface is open: a bend is concave from one of its sides) must stay two.
    report : what was repaired, and what stands out, one sentence each.

    Raises
    ------
    MeshError
        Coordinates that are not finite, indices out of range, no triangle with an area, too many triangles.
    """

    points: Any
    triangles: Any
    _: KW_ONLY
    where: str = "surface"
    closed: bool = field(init=False)
    patch: np.ndarray = field(init=False, repr=False)
    report: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        report: list[str] = []
        points, triangles = self._checked()
        points, triangles = merged(points, triangles, report)
        edges = Edges(triangles, len(points))
        if edges.open.any():
            points, triangles, changed = sewn(points, triangles, edges, report)
            edges = Edges(triangles, len(points)) if changed else edges
        triangles, edges, closed = oriented(points, triangles, edges, report)
        flat = flat_triangles(points, triangles)
        if flat.all():
            raise MeshError(f"{self.where}: holds no surface (no triangle of {len(flat)} has an area).")
        patch = patches(points, triangles, edges, flat, closed)[~flat]
        if flat.any():
            report.append(f"{count(int(flat.sum()), 'triangle')} without area left out")
        if edges.crowded:
            report.append(f"{count(edges.crowded, 'edge')} shared by more than two triangles")
        if not closed:
            report.append(
                f"not watertight ({count(int(edges.open.sum()), 'open edge')} of {count(len(triangles), 'triangle')}): "
                "a sheet that is touched from both sides"
            )
        used, triangles = np.unique(triangles[~flat], return_inverse=True)
        object.__setattr__(self, "points", np.ascontiguousarray(points[used]))
        object.__setattr__(self, "triangles", np.ascontiguousarray(triangles.reshape(-1, 3), dtype=np.int64))
        object.__setattr__(self, "patch", renumbered(patch))
        object.__setattr__(self, "closed", closed)
        object.__setattr__(self, "report", tuple(report))

    def _checked(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and triangles as arrays, or what is wrong with them."""
        try:
            points, triangles = np.array(self.points, dtype=float), np.array(self.triangles)
        except (TypeError, ValueError):
            raise MeshError(f"{self.where}: points and triangles must be arrays of shape (any, 3).") from None
        if points.ndim != 2 or points.shape[1] != 3:
            raise MeshError(f"{self.where}: points must have shape (any, 3) (got {points.shape}).")
        if triangles.size == 0 or points.size == 0:
            raise MeshError(
                f"{self.where}: holds no surface (0 triangles). Export the part as a triangle mesh (STL, OBJ, PLY)."
            )
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise MeshError(
                f"{self.where}: triangles must be integers of shape (any, 3) "
                f"(got {triangles.dtype} of shape {triangles.shape})."
            )
        if len(triangles) > LIMIT:
            raise MeshError(too_large(self.where, len(triangles)))
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise MeshError(
                f"{self.where}: holds coordinates that are not finite ({count(len(bad), 'point')}, "
                f"first point {bad[0]}). Export it again."
            )
        out = (triangles < 0) | (triangles >= len(points))
        if out.any():
            k = int(np.flatnonzero(out.any(axis=1))[0])
            raise MeshError(
                f"{self.where}: triangle {k} has the corners {triangles[k].tolist()}; "
                f"points are numbered 0 to {len(points) - 1}."
            )
        return points, triangles.astype(np.int64)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Least and largest coordinates (2, 3) [m]."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @cached_property
    def _samples(self) -> _Samples:
        return _Samples(self.points[self.triangles])

    @cached_property
    def _rank(self) -> tuple[np.ndarray, np.ndarray]:
        """Triangles in order of patch, then number; and the place of each in it."""
        order = np.argsort(self.patch, kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        return order, rank

    @cached_property
    def facets(self) -> tuple[np.ndarray, np.ndarray]:
        """What distances to triangles are found from, see `kernels.shapes.facets`."""
        return facets(self.points, self.triangles)

    def candidates(self, centers: np.ndarray, radius: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangles that come within `radius` [m], one or (n,), of centers (n, 3) [m].

        Returns start (n + 1,) and index (m,): those of centre i are index[start[i]:start[i + 1]], by patch, then by
        number. All that come so near are there, and some more: those whose bounding circles do.
        """
        centers = np.asarray(centers, dtype=float).reshape(-1, 3)
        radii = np.broadcast_to(np.asarray(radius, dtype=float), len(centers))
        order, rank = self._rank
        n = len(order)
        found = [np.empty(0, dtype=np.int64)]
        for i, j in self._samples.near(centers, radii):
            found.append(i * n + rank[self._samples.triangle[j]])
        key = np.concatenate(found)
        key.sort()
        if len(self._samples.triangle) > n and len(key):
            key = key[np.concatenate([[True], key[1:] != key[:-1]])]
        center, place = np.divmod(key, n)
        return np.searchsorted(center, np.arange(len(centers) + 1)), order[place]

    def nearest(self, centers: np.ndarray) -> np.ndarray:
        """Lower bound (n,) [m] on the distance of centers (n, 3) [m] to the surface."""
        centers = np.asarray(centers, dtype=float).reshape(-1, 3)
        return np.maximum(self._samples.tree.query(centers)[0] - self._samples.reach, 0.0)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distance (n,) [m] of points (n, 3) [m] to the surface; negative inside a closed one.

        Exact, and meant for checks: a point as near to all triangles, or on the other side than its neighbours in the
        list, costs a look at all of them.
        """
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if not len(points):
            return np.empty(0)
        corners = self.points[self.triangles]
        if len(points) * len(corners) <= FEW:
            best = np.full(len(points), np.inf)
            i, j = np.divmod(np.arange(len(points) * len(corners)), len(corners))
            lower_to_triangles(points, i, corners, j, best)
        else:
            best = np.array(self._samples.tree.query(points)[0])  # samples lie on the surface
            lot = max(1, PAIRS // len(self._samples.triangle))
            for i, j in self._samples.near(points, best * (1 + 1e-12), lot):
                lower_to_triangles(points, i, corners, self._samples.triangle[j], best)
        if not self.closed:
            return best
        # neighbours closer than the surface is lie on the same side: the side of the first of each run is enough
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        new = np.concatenate([[True], step >= np.maximum(best[1:], best[:-1]) * (1 - 1e-9)])
        inside = winding_number(points[new], corners) > 0.5
        return np.where(inside[np.cumsum(new) - 1], -best, best)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Whether points (n, 3) [m] lie inside; an open surface has none."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        within = ((points >= self.bounds[0]) & (points <= self.bounds[1])).all(axis=1) & self.closed
        within[within] = self.distance(points[within]) < 0.0
        return within


class _Samples:
    """Points of triangles, each with the radius of the ball that covers its piece; balls cover the surface.

    Pieces larger than a regular triangle of the median area are halved across their longest edge, as far as four points
    a triangle and 20 000 more go.
    """

    def __init__(self, corners: np.ndarray) -> None:
        n = len(corners)
        limit = 4 * n + 20_000
        pieces, triangle = corners, np.arange(n)
        radius = _radius(pieces)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        aim = float(np.median(np.sqrt(np.sqrt(dot(normal, normal)))))  # about 1.6 radii of regular triangles
        level = float(radius.max())
        while level > aim and len(pieces) < limit:
            level = max(aim, 0.7 * level)
            while len(pieces) < limit:
                large = np.flatnonzero(radius > level)[: limit - len(pieces)]
                if not len(large):
                    break
                halves = _halves(pieces[large])
                rest = np.ones(len(pieces), dtype=bool)
                rest[large] = False
                pieces = np.concatenate([pieces[rest], halves])
                triangle = np.concatenate([triangle[rest], np.tile(triangle[large], 2)])
                radius = np.concatenate([radius[rest], _radius(halves)])
        self.points, self.triangle, self.radius = pieces.mean(axis=1), triangle, radius
        self.reach = float(radius.max())

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)

    def near(self, centers: np.ndarray, radii: np.ndarray, lot: int = 4096) -> Any:
        """Yield pairs (i, j) of centre and sample whose ball comes within radii[i]; all of them, `lot` centres at a time."""
        for begin in range(0, len(centers), lot):
            part = slice(begin, begin + lot)
            found = self.tree.query_ball_point(centers[part], radii[part] + self.reach, return_sorted=False)
            length = np.fromiter(map(len, found), dtype=np.int64, count=len(found))
            i = np.repeat(np.arange(begin, begin + len(found)), length)
            j = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=len(i))
            d = centers.take(i, axis=0)
            d -= self.points.take(j, axis=0)
            close = np.flatnonzero(dot(d, d) <= (radii.take(i) + self.radius.take(j)) ** 2)
            yield i[close], j[close]


def _radius(pieces: np.ndarray) -> np.ndarray:
    """Radius of the ball about the middle of each triangle that holds it."""
    d = pieces - pieces.mean(axis=1, keepdims=True)
    return np.sqrt(dot(d, d).max(axis=1))


def _halves(pieces: np.ndarray) -> np.ndarray:
    """Each triangle halved across its longest edge: first halves, then second ones."""
    edge = np.roll(pieces, -1, axis=1) - pieces
    k = dot(edge, edge).argmax(axis=1)
    row = np.arange(len(pieces))
    a, b, c = pieces[row, k], pieces[row, (k + 1) % 3], pieces[row, (k + 2) % 3]
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
