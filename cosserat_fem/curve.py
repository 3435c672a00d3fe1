"""What shape is this curve? Smooth curves through points; T, N, B, curvature, torsion; section axes against them.

Rule: geometry only, no mechanics. A drawn curve is a C2 cubic spline measured by its own arc length. Where a curve is
straight the Frenet normal does not exist: it is replaced by the section axis d1 (or, without sections, by any normal),
the torsion is 0, and nothing is NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from .errors import check_shape
from .kernels.rotation import kardan_from_matrix, transport_normals

STRAIGHT = 1e-9  # curvature times length below which a curve counts as straight
FARTHEST = 1e100  # m: squares of what is further away are no numbers
_X, _W = np.polynomial.legendre.leggauss(8)


class SmoothCurve:
    """A C2 curve through points, by arc length.

    Parameters
    ----------
    points : (P, 3) [m]
        At least two, no two neighbours at the same place. Two points without tangents draw a straight line.
    start_tangent, end_tangent : (3,), optional
        Directions at the ends (any length); without both, not-a-knot; without one, no curvature there.

    Raises
    ------
    ValueError
        Wrong shape, neighbours that coincide, a tangent of zero length.
    """

    def __init__(
        self,
        points: np.ndarray,
        start_tangent: np.ndarray | None = None,
        end_tangent: np.ndarray | None = None,
        *,
        name: str = "curve",
    ) -> None:
        points = check_shape(f"{name}: points", points, (-1, 3))
        if len(points) < 2:
            raise ValueError(f"{name}: points: must be at least two (got {len(points)}).")
        far = np.abs(points).max(axis=1)
        if far.max() > FARTHEST:
            where = ", ".join(f"{x:g}" for x in points[np.argmax(far)])
            raise ValueError(f"{name}: points: ({where}) is further away than {FARTHEST:g} m. Is the unit right?")
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        size = np.ptp(points, axis=0).max()
        same = np.flatnonzero(chords <= 1e-12 * max(size, 1e-300))
        if len(same):
            where = ", ".join(f"{x:g}" for x in points[same[0]])
            raise ValueError(f"{name}: points: {same[0]} and {same[0] + 1} coincide at ({where}).")
        self.points = points
        ends = [
            None if v is None else unit(f"{name}: {which}_tangent", v)
            for which, v in (("start", start_tangent), ("end", end_tangent))
        ]
        self.straight = len(points) == 2 and ends[0] is None and ends[1] is None
        if self.straight:
            self.length = float(chords[0])
            return
        u = np.concatenate([[0.0], np.cumsum(chords)])
        if ends[0] is None and ends[1] is None:
            bc: Any = "not-a-knot"
        else:
            bc = tuple((1, e) if e is not None else (2, np.zeros(3)) for e in ends)
        spline = CubicSpline(u, points, bc_type=bc)
        self._velocity = spline.derivative()
        self._spline = spline
        # arc length at a fine grid of the parameter, eight Gauss points in each of 16 parts of every span
        self._u = np.unique(np.concatenate([np.linspace(a, b, 17) for a, b in pairwise(u)]))
        parts = self._arc(self._u[:-1], self._u[1:])
        self._s = np.concatenate([[0.0], np.cumsum(parts)])
        self.length = float(self._s[-1])

    def _arc(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        half, mid = 0.5 * (b - a), 0.5 * (a + b)
        speed = np.linalg.norm(self._velocity(mid[:, None] + half[:, None] * _X), axis=-1)
        return half * (speed @ _W)

    def _parameter(self, s: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(self._s, s, side="right") - 1, 0, len(self._s) - 2)
        low, high = self._u[k], self._u[k + 1]
        u = low + (high - low) * (s - self._s[k]) / (self._s[k + 1] - self._s[k])
        for _ in range(4):  # Newton on a nearly linear function; the last steps only confirm
            speed = np.linalg.norm(self._velocity(u), axis=-1)
            u = np.clip(u - (self._s[k] + self._arc(low, u) - s) / np.maximum(speed, 1e-300), low, high)
        return u

    def position(self, s: np.ndarray) -> np.ndarray:
        """Points (n, 3) [m] at arc lengths s (n,) from 0 to `length`."""
        s = np.asarray(s, dtype=float)
        if self.straight:
            a, b = self.points
            return a + (b - a) * (s / self.length)[:, None]
        return self._spline(self._parameter(s))

    def tangent(self, s: np.ndarray) -> np.ndarray:
        """Unit tangents (n, 3) at arc lengths s (n,)."""
        s = np.asarray(s, dtype=float)
        if self.straight:
            return np.tile((self.points[1] - self.points[0]) / self.length, (len(s), 1))
        v = self._velocity(self._parameter(s))
        return v / np.linalg.norm(v, axis=-1, keepdims=True)

    def frames(self, s: np.ndarray, normal: np.ndarray | None = None, end_normal: np.ndarray | None = None):
        """Frames [d1 d2 d3] (n, 3, 3) with d3 along the curve, at increasing arc lengths s.

        d1 starts at `normal` (made perpendicular to the tangent; without it any normal) and is carried along without
        twist. `end_normal` asks for a direction of d1 at the end: the missing angle is spread evenly over the length.
        """
        s = np.asarray(s, dtype=float)
        if self.straight and end_normal is None:
            t = self.tangent(s[:1])[0]
            d1 = perpendicular(t, normal)
            return np.tile(np.column_stack([d1, np.cross(t, d1), t]), (len(s), 1, 1))
        grid = np.array([0.0, self.length]) if self.straight else self._s
        every, where = np.unique(np.concatenate([grid, s]), return_inverse=True)
        points, tangents = self.position(every), self.tangent(every)
        normals = np.empty_like(points)
        normals[0] = perpendicular(tangents[0], normal)
        transport_normals(points, tangents, normals)
        if end_normal is not None:
            wanted = perpendicular(tangents[-1], end_normal)
            d1, d2 = normals[-1], np.cross(tangents[-1], normals[-1])
            angle = np.arctan2(wanted @ d2, wanted @ d1) * every / self.length
            d2 = np.cross(tangents, normals)
            normals = np.cos(angle)[:, None] * normals + np.sin(angle)[:, None] * d2
        pick = where[len(grid) :]
        d1, d3 = normals[pick], tangents[pick]
        return np.stack([d1, np.cross(d3, d1), d3], axis=-1)


def unit(name: str, vector: np.ndarray) -> np.ndarray:
    """Return vector (3,) scaled to length 1, or say that it has none."""
    v = check_shape(name, vector, (3,))
    length = np.linalg.norm(v)
    if length == 0.0:
        raise ValueError(f"{name}: has zero length; give a direction.")
    return v / length


def perpendicular(tangent: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
    """Unit vector perpendicular to a unit tangent, as close to `normal` as it gets (without it: to the least axis)."""
    if normal is None:
        normal = np.eye(3)[np.argmin(np.abs(tangent))]
    v = unit("normal", normal)
    n = v - (v @ tangent) * tangent
    if np.linalg.norm(n) < 1e-6:
        raise ValueError("normal: is parallel to the tangent there; give a direction across the rod.")
    return n / np.linalg.norm(n)


@dataclass(frozen=True, eq=False)
class CurveGeometry:
    """Geometry of a curve at P stations; all vectors in space.

    tangent, normal, binormal (P, 3): Frenet frame; curvature, torsion (P,) [1/m].
    directors (P, 3, 3): section principal axes [d1 d2 d3]; section_angle (P,) [rad]: angle from the Frenet normal to
    d1 about the tangent; bending_twist (P, 3) [1/m]: the vector omega with R' = R [omega]x in section axes, for a rod
    without shear (curvature cos, sin of the angle; torsion + d angle/ds); kardan (P, 3) [rad]: (psi, theta, phi).
    The section fields are None for a curve without sections.
    """

    s: np.ndarray
    position: np.ndarray
    tangent: np.ndarray
    normal: np.ndarray
    binormal: np.ndarray
    curvature: np.ndarray
    torsion: np.ndarray
    directors: np.ndarray | None = None
    section_angle: np.ndarray | None = None
    bending_twist: np.ndarray | None = None
    kardan: np.ndarray | None = None


def curve_geometry(
    s: np.ndarray,
    position: np.ndarray,
    d1: np.ndarray,
    d2: np.ndarray,
    d3: np.ndarray,
    *,
    directors: np.ndarray | None = None,
    bending_twist: np.ndarray | None = None,
) -> CurveGeometry:
    """Frenet frame, curvature and torsion from the first three derivatives of r with respect to any parameter.

    kappa = |r' x r''| / |r'|^3,  tau = (r' x r'') . r''' / |r' x r''|^2.

    Parameters
    ----------
    s : (P,) [m], position : (P, 3) [m]
    d1, d2, d3 : (P, 3)
        r', r'', r'''.
    directors, bending_twist : (P, 3, 3), (P, 3), optional
        Section axes and omega of a rod; they also give the normal where the curve is straight.
    """
    speed = np.linalg.norm(d1, axis=-1)
    T = d1 / speed[:, None]
    across = np.cross(d1, d2)
    size = np.linalg.norm(across, axis=-1)
    curvature = size / speed**3
    straight = curvature * max(np.ptp(s), 1e-300) < STRAIGHT
    safe = np.where(straight, 1.0, size)
    torsion = np.where(straight, 0.0, (across * d3).sum(-1) / safe**2)
    B = across / safe[:, None]
    for k in np.flatnonzero(straight):
        B[k] = np.cross(T[k], perpendicular(T[k], None if directors is None else directors[k, :, 0]))
    N = np.cross(B, T)
    angle = kardan = None
    if directors is not None:
        first = directors[..., 0]
        angle = np.unwrap(np.arctan2((first * B).sum(-1), (first * N).sum(-1)))
        kardan = kardan_from_matrix(directors)
    return CurveGeometry(
        s, position, T, N, B, np.where(straight, 0.0, curvature), torsion, directors, angle, bending_twist, kardan
    )


def rebuild_curve(
    s: np.ndarray,
    curvature: Callable[[float], float],
    torsion: Callable[[float], float],
    *,
    start: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    frame: np.ndarray | None = None,
) -> np.ndarray:
    """Points (n, 3) of the curve with given curvature and torsion, by integrating the Frenet equations.

    Parameters
    ----------
    s : (n,) [m]
        Increasing arc lengths; the first is where `start` and `frame` hold.
    curvature, torsion : functions of s [1/m]
    frame : (3, 3)
        Columns T, N, B at the first s; default the axes x, y, z.
    """
    from scipy.integrate import solve_ivp

    s = check_shape("rebuild_curve: s", s, (-1,))
    frame = np.eye(3) if frame is None else check_shape("rebuild_curve: frame", frame, (3, 3))

    def rate(at: float, y: np.ndarray) -> np.ndarray:
        T, N, B = y[3:6], y[6:9], y[9:12]
        k, t = curvature(at), torsion(at)
        return np.concatenate([T, k * N, -k * T + t * B, -t * N])

    y0 = np.concatenate([np.asarray(start, dtype=float), frame.T.ravel()])
    solution = solve_ivp(rate, (s[0], s[-1]), y0, method="DOP853", t_eval=s, rtol=1e-12, atol=1e-14)
    return solution.y[:3].T
