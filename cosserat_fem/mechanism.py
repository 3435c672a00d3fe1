"""What is rigid and how does it move? Parts, their motion, their shapes.

Rule: a part is drawn in its reference place; its motion gives at each time the rigid displacement from there,
x(t) = R(t) X + c(t). At a hinge angle of 0, a travel of 0 or the first pose of a path every part stands as drawn.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import ceil, pi
from typing import Any, Protocol, get_args

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from .curve import unit
from .errors import MeshError, check_name, check_positive, check_shape
from .kernels.rotation import (
    conjugate,
    matrix_from_quaternion,
    matrix_from_vector,
    multiply,
    quaternion_from_vector,
    relative_rotation,
)
from .meshfile import read_surface
from .schedule import DIFFERENCE, Schedule
from .shapes import Shape
from .surface import Surface
from .table import read_table


@dataclass(frozen=True, eq=False)
class RigidRates:
    """Velocity and acceleration of a rigid body, in space: of the point X (drawn place), x = R X + c,

    x' = omega x R X + c_rate and x'' = alpha x R X + omega x (omega x R X) + c_acceleration.  [rad/s, rad/s^2, m/s, m/s^2]
    """

    omega: np.ndarray
    alpha: np.ndarray
    c_rate: np.ndarray
    c_acceleration: np.ndarray


def _about(point: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates of c that keep the turned point R X in place: minus the velocity and acceleration of R X."""
    swept = np.cross(omega, point)
    return -swept, -np.cross(alpha, point) - np.cross(omega, swept)


SAMPLES = 65  # places at which a motion given as a function is looked at between two stations


class Motion(Protocol):
    """What a part needs to know of its motion."""

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotation matrix R (3, 3) and translation c (3,) [m] at time t [s]."""
        ...

    def stages(self, t0: float, t1: float) -> int:
        """Into how many steps t0..t1 must be cut so that no step turns by more than a quarter turn."""
        ...

    def rates(self, t: float, *, before: bool = False) -> RigidRates:
        """Velocity and acceleration at time t; at a kink those that follow it, or come before it."""
        ...

    @property
    def kinks(self) -> np.ndarray:
        """Times (K,) [s] at which the velocity may jump."""
        ...

    @property
    def drawn_at(self) -> float:
        """Time [s] at which the part stands as drawn."""
        ...


@dataclass(frozen=True, eq=False)
class Hinge:
    """Turning about a fixed axis.

    Parameters
    ----------
    point : (3,) [m]
        A point of the axis.
    axis : (3,)
        Direction, any length; the angle is right-handed about it.
    angle : rate [rad/s], (times, angles [rad]) or function of t
    smooth : bool
        A table is a smooth curve that starts and ends at rest, instead of linear (which jumps in velocity).
    """

    point: Any
    axis: Any
    angle: Any
    smooth: bool = False
    schedule: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", check_shape("hinge: point", self.point, (3,)))
        object.__setattr__(self, "axis", unit("hinge: axis", self.axis))
        object.__setattr__(self, "schedule", Schedule("hinge: angle", self.angle, rate=True, smooth=self.smooth))

    def angle_at(self, t: float) -> float:
        """Angle [rad] at time t."""
        return self.schedule.at(t)

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        R = matrix_from_vector(self.angle_at(t) * self.axis)
        return R, self.point - R @ self.point

    def stages(self, t0: float, t1: float) -> int:
        return max(1, ceil(abs(self.angle_at(t1) - self.angle_at(t0)) / (pi / 2) - 1e-9))

    def rates(self, t: float, *, before: bool = False) -> RigidRates:
        first, second = self.schedule.rates(t, before=before)
        omega, alpha = first * self.axis, second * self.axis
        R = matrix_from_vector(self.angle_at(t) * self.axis)
        return RigidRates(omega, alpha, *_about(R @ self.point, omega, alpha))

    @property
    def drawn_at(self) -> float:
        return self.schedule.begin

    @property
    def kinks(self) -> np.ndarray:
        return self.schedule.kinks


@dataclass(frozen=True, eq=False)
class Slider:
    """Sliding along a fixed direction.

    Parameters
    ----------
    axis : (3,)
        Direction, any length.
    travel : rate [m/s], (times, distances [m]) or function of t
    smooth : bool
        A table is a smooth curve that starts and ends at rest, instead of linear (which jumps in velocity).
    """

    axis: Any
    travel: Any
    smooth: bool = False
    schedule: Schedule = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", unit("slider: axis", self.axis))
        object.__setattr__(self, "schedule", Schedule("slider: travel", self.travel, rate=True, smooth=self.smooth))

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.eye(3), self.schedule.at(t) * self.axis

    def stages(self, t0: float, t1: float) -> int:
        return 1

    def rates(self, t: float, *, before: bool = False) -> RigidRates:
        first, second = self.schedule.rates(t, before=before)
        return RigidRates(np.zeros(3), np.zeros(3), first * self.axis, second * self.axis)

    @property
    def drawn_at(self) -> float:
        return self.schedule.begin

    @property
    def kinks(self) -> np.ndarray:
        return self.schedule.kinks


@dataclass(frozen=True, eq=False)
class Path:
    """A general rigid motion.

    Parameters
    ----------
    pose : (times (T,) [s], positions (T, 3) [m], quaternions (T, 4)) or function t -> (position, quaternion)
        Place and attitude (w, x, y, z) of any frame fixed to the part. Only its change from the first row (from t = 0
        for a function) counts, because that is where the part is drawn. Between rows the position is linear and the
        rotation turns at a constant rate the shorter way round. `Path.read` takes a CSV file.
    smooth : bool
        Smooth curves through the table: the place starts and ends at rest, the rotation is a spline that need not.
    """

    motion: Any
    smooth: bool = False
    _times: Any = field(init=False, repr=False, default=None)
    _positions: Any = field(init=False, repr=False, default=None)
    _quaternions: Any = field(init=False, repr=False, default=None)
    _turns: RotationSpline | None = field(init=False, repr=False, default=None)
    _start: Any = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if callable(self.motion):
            object.__setattr__(self, "_start", self._frame(0.0))
            return
        if not isinstance(self.motion, tuple | list) or len(self.motion) != 3:
            raise ValueError("path: give (times, positions, quaternions) or a function of t.")
        times = check_shape("path: times", self.motion[0], (-1,))
        positions = Schedule("path: position", (times, self.motion[1]), (3,), smooth=self.smooth)
        q = check_shape("path: quaternions", self.motion[2], (len(times), 4))
        size = np.linalg.norm(q, axis=1)
        off = np.flatnonzero(np.abs(size - 1.0) > 1e-3)
        if len(off):
            raise ValueError(f"path: quaternion {off[0]} has length {size[off[0]]:.4g}; it must be 1.")
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_positions", positions)
        object.__setattr__(self, "_quaternions", q / size[:, None])
        if self.smooth:
            object.__setattr__(self, "_turns", RotationSpline(times, Rotation.from_quat(q[:, [1, 2, 3, 0]])))
        object.__setattr__(self, "_start", self._frame(times[0]))

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, smooth: bool = False) -> Path:
        """Read a CSV file with the columns time, x, y, z, qw, qx, qy, qz in SI units; a header may name and order them.

        Raises
        ------
        MeshError
            The file cannot be read or is not such a table; the message names the row and the cell.
        """
        where = f"path: motion file {os.fspath(path)!r}"
        table = read_table(path, ("time", "x", "y", "z", "qw", "qx", "qy", "qz"), where)
        try:
            return cls((table[:, 0], table[:, 1:4], table[:, 4:]), smooth)
        except ValueError as error:
            raise MeshError(f"{where}: {str(error).removeprefix('path: ')}") from None

    def _frame(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Place (3,) and unit quaternion (4,) of the given frame."""
        if self._times is None:
            place, q = self.motion(t)
            q = check_shape(f"path: quaternion at t = {t:g} s", q, (4,))
            if abs(np.linalg.norm(q) - 1.0) > 1e-3:
                raise ValueError(f"path: quaternion at t = {t:g} s has length {np.linalg.norm(q):.4g}; it must be 1.")
            return check_shape(f"path: position at t = {t:g} s", place, (3,)), q / np.linalg.norm(q)
        place = self._positions.at(t)
        if self._turns is not None:
            return place, self._turns(t).as_quat()[[3, 0, 1, 2]]
        k, turn = self._piece(t)
        part = (t - self._times[k]) / (self._times[k + 1] - self._times[k])
        return place, multiply(self._quaternions[k], quaternion_from_vector(np.clip(part, 0.0, 1.0) * turn))

    def _piece(self, t: float, *, before: bool = False) -> tuple[int, np.ndarray]:
        """Row that begins the piece of t, and its rotation vector in the frame."""
        slack = 1e-9 * (self._times[-1] - self._times[0])
        t += -slack if before else slack
        k = int(np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self._times) - 2))
        return k, relative_rotation(self._quaternions[k][None], self._quaternions[k + 1][None])[0]

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        (place0, q0), (place, q) = self._start, self._frame(t)
        R = matrix_from_quaternion(multiply(q, conjugate(q0)))
        return R, place - R @ place0

    def stages(self, t0: float, t1: float) -> int:
        if self._times is None:  # a function may turn any number of times between two stations
            inside = np.linspace(t0, t1, SAMPLES)[1:-1]
        else:
            inside = self._times[(self._times > t0) & (self._times < t1)]
        stops = [t0, *inside, t1]
        turns = sum(
            float(np.linalg.norm(relative_rotation(self._frame(a)[1][None], self._frame(b)[1][None])))
            for a, b in pairwise(stops)
        )
        return max(1, ceil(turns / (pi / 2) - 1e-9))

    def rates(self, t: float, *, before: bool = False) -> RigidRates:
        (place0, q0), (_, q) = self._start, self._frame(t)
        attitude = matrix_from_quaternion(q)
        if self._times is None:
            first, second, spin, change = self._differences(t)
        else:
            first, second = self._positions.rates(t, before=before)
            if self._turns is not None:
                spin, change = self._turns(t, 1), self._turns(t, 2)
            else:
                k, turn = self._piece(t, before=before)
                spin, change = turn / (self._times[k + 1] - self._times[k]), np.zeros(3)
        omega, alpha = attitude @ spin, attitude @ change  # the frame's spin times itself is zero
        still = _about(attitude @ matrix_from_quaternion(conjugate(q0)) @ place0, omega, alpha)
        return RigidRates(omega, alpha, first + still[0], second + still[1])

    def _differences(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Rates of a function of time: of its place, and of its rotation seen in the frame."""
        h = DIFFERENCE
        frames = [self._frame(t + k * h) for k in (-2, -1, 0, 1, 2)]
        here = frames[2][1][None]
        out = []
        for f in ([p for p, _ in frames], [relative_rotation(here, q[None])[0] for _, q in frames]):
            out.append((f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h))
            out.append((-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h * h))
        return out[0], out[1], out[2], out[3]

    @property
    def drawn_at(self) -> float:
        return 0.0 if self._times is None else float(self._times[0])

    @property
    def kinks(self) -> np.ndarray:
        return np.empty(0) if self._times is None or self.smooth else self._times


STILL = RigidRates(*np.zeros((4, 3)))


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid body that rods are attached to, or touch.

    Parameters
    ----------
    name : str
    mesh : path of an STL, OBJ, PLY or VTK surface, optional
        Triangles for contact and pictures. Flipped facets are repaired; an open surface is touched from both sides.
    mesh_unit : [m]
        Length of one unit of the file; STL files do not say (1e-3 for millimetres).
    motion : Hinge, Slider or Path, optional
        Without it the part never moves.
    shape : Plane, Sphere, Cylinder, Capsule, Box or Torus, or several, optional
        Closed forms for contact and pictures, where the part is drawn [m]; with a mesh the part is both.
    """

    name: str
    mesh: str | os.PathLike[str] | None = None
    mesh_unit: float = 1.0
    motion: Motion | None = None
    shape: Shape | Sequence[Shape] | None = None
    shapes: tuple[Shape, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_name("part", self.name)
        shapes = () if self.shape is None else (self.shape,) if isinstance(self.shape, get_args(Shape)) else self.shape
        if not isinstance(shapes, tuple | list) or not all(isinstance(s, get_args(Shape)) for s in shapes):
            names = ", ".join(kind.__name__ for kind in get_args(Shape))
            raise ValueError(f"part {self.name!r}: shape must be one or several of {names} (got {self.shape!r}).")
        object.__setattr__(self, "shapes", tuple(shapes))
        if self.motion is not None and not hasattr(self.motion, "pose"):
            raise ValueError(f"part {self.name!r}: motion must be a Hinge, Slider or Path (got {self.motion!r}).")
        check_positive(f"part {self.name!r}: mesh_unit", self.mesh_unit)

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) [m] from the drawn place at time t."""
        if self.motion is None:
            return np.eye(3), np.zeros(3)
        try:
            return self.motion.pose(t)
        except ValueError as error:
            raise ValueError(f"part {self.name!r}: {error}") from None

    def stages(self, t0: float, t1: float) -> int:
        """Into how many steps t0..t1 must be cut so that no step turns by more than a quarter turn."""
        try:
            return 1 if self.motion is None else self.motion.stages(t0, t1)
        except ValueError as error:
            raise ValueError(f"part {self.name!r}: {error}") from None

    @property
    def drawn_at(self) -> float:
        """Time [s] at which the part stands as drawn, or nearest to it."""
        return 0.0 if self.motion is None else self.motion.drawn_at

    def rates(self, t: float, *, before: bool = False) -> RigidRates:
        """Velocity and acceleration at (or just before) time t."""
        try:
            return STILL if self.motion is None else self.motion.rates(t, before=before)
        except ValueError as error:
            raise ValueError(f"part {self.name!r}: {error}") from None

    @cached_property
    def _surface(self) -> Surface:
        if self.mesh is None:
            raise MeshError(f"part {self.name!r}: has no mesh.")
        where = f"part {self.name!r}: mesh file {os.fspath(self.mesh)!r}"
        points, triangles = read_surface(self.mesh, f"part {self.name!r}")
        return Surface(points * self.mesh_unit, triangles, where=where)

    def surface(self) -> Surface:
        """The mesh [m], repaired, as the part is drawn; read once. MeshError if there is none or it cannot be used."""
        return self._surface

    def drawn_surface(self, extent: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Points (P, 3) [m] and triangles (F, 3) of mesh and shapes, for pictures; none if the part has neither.

        extent [m]: half width of the square that stands for a plane.
        """
        pieces = [shape.surface(extent) for shape in self.shapes]
        if self.mesh is not None:
            pieces.insert(0, (self.surface().points, self.surface().triangles))
        if not pieces:
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        first = np.cumsum([0, *(len(points) for points, _ in pieces[:-1])])
        return (
            np.concatenate([points for points, _ in pieces]),
            np.concatenate([triangles + n for (_, triangles), n in zip(pieces, first, strict=True)]),
        )


GROUND = Part("ground")
