"""Triangles and points: distance, winding number. For checks, not for the loop: NumPy, and one kernel for many pairs."""

from __future__ import annotations

import numpy as np

from . import kernel


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot product over the last axis."""
    return np.einsum("...i,...i->...", a, b)


def total(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot product over the first axis, of length 3."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def triangle_distance(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance (n,) of points (n, 3) to triangles (n, 3 corners, 3), one to one."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.ones(len(p), dtype=bool)
    best = np.full(len(p), np.inf)
    for k in range(3):
        edge, w = corners[:, (k + 1) % 3] - corners[:, k], p - corners[:, k]
        along = np.clip(dot(w, edge) / dot(edge, edge), 0.0, 1.0)
        off = w - along[:, None] * edge
        best = np.minimum(best, dot(off, off))
        above &= dot(np.cross(edge, w), normal) >= 0.0
    height = np.abs(dot(p - corners[:, 0], normal)) / np.sqrt(dot(normal, normal))
    return np.where(above, height, np.sqrt(best))


@kernel
def lower_to_triangles(p, i, corners, j, best):
    """Lower best (n,) [m] to the distances of points p (n, 3) from triangles (F, 3 corners, 3), for pairs i, j (m,) of them.

    As `triangle_distance`: the height above a triangle where its foot is inside, else the distance from the nearest edge.
    """
    e, w = np.empty((3, 3)), np.empty((3, 3))
    for k in range(i.shape[0]):
        a, c = i[k], j[k]
        for m in range(3):
            for x in range(3):
                e[m, x] = corners[c, (m + 1) % 3, x] - corners[c, m, x]
                w[m, x] = p[a, x] - corners[c, m, x]
        # normal: first edge times the one to the third corner, which is minus the last edge
        n0 = e[0, 2] * e[2, 1] - e[0, 1] * e[2, 2]
        n1 = e[0, 0] * e[2, 2] - e[0, 2] * e[2, 0]
        n2 = e[0, 1] * e[2, 0] - e[0, 0] * e[2, 1]
        above, least = True, np.inf
        for m in range(3):
            along = e[m, 0] * w[m, 0] + e[m, 1] * w[m, 1] + e[m, 2] * w[m, 2]
            size = e[m, 0] * e[m, 0] + e[m, 1] * e[m, 1] + e[m, 2] * e[m, 2]
            part = min(max(along / size, 0.0), 1.0)
            x, y, z = w[m, 0] - part * e[m, 0], w[m, 1] - part * e[m, 1], w[m, 2] - part * e[m, 2]
            least = min(least, x * x + y * y + z * z)
            side = (
                (e[m, 1] * w[m, 2] - e[m, 2] * w[m, 1]) * n0
                + (e[m, 2] * w[m, 0] - e[m, 0] * w[m, 2]) * n1
                + (e[m, 0] * w[m, 1] - e[m, 1] * w[m, 0]) * n2
            )
            above = above and side >= 0.0
        if above:
            height = abs(w[0, 0] * n0 + w[0, 1] * n1 + w[0, 2] * n2) / np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            best[a] = min(best[a], height)
        else:
            best[a] = min(best[a], np.sqrt(least))


def winding_number(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How often triangles (F, 3 corners, 3) enclose each of points (n, 3): 0 outside, 1 inside a closed surface.

    Source: Van Oosterom & Strackee (1983), doi 10.1109/TBME.1983.325207, solid angle of a triangle.
    """
    out = np.zeros(len(points))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    todo = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    size = max(1, 100_000 // len(corners))
    along = np.ascontiguousarray(corners.transpose(1, 2, 0))  # corner, axis, triangle
    for chunk in (todo[k : k + size] for k in range(0, len(todo), size)):
        a, b, c = (np.moveaxis(v - points[chunk, :, None], 1, 0) for v in along)
        (la, lb, lc), ab, bc, ca = (np.sqrt(total(v, v)) for v in (a, b, c)), total(a, b), total(b, c), total(c, a)
        volume = sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
        out[chunk] = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2 * np.pi)
    return out
