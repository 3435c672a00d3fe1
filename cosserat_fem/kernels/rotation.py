"""SO(3): exponential, logarithm, quaternion product, Kardan angles.

Rule: quaternions are scalar first (w, x, y, z) and of unit length; rotations act on columns, R = [d1 d2 d3]; angles
in radians. Compiled functions work on one rotation given by its components or on (N, 4) arrays.

Kardan angles (psi, theta, phi): psi about the fixed x axis, theta about the turned y axis, phi about the section
normal d3, that is R = Rx(psi) Ry(theta) Rz(phi). They are singular where theta = +-90 deg, d3 along +-x.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from . import inner, kernel

SMALL = 1e-4  # below this angle the series is exact to round-off


@inner
def exp_half(x, y, z):
    """Quaternion of the rotation vector (x, y, z) [rad]."""
    angle2 = x * x + y * y + z * z
    if angle2 < SMALL * SMALL:
        f = 0.5 - angle2 / 48.0
        return 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0, f * x, f * y, f * z
    angle = sqrt(angle2)
    f = sin(0.5 * angle) / angle
    return cos(0.5 * angle), f * x, f * y, f * z


@inner
def log_quaternion(w, x, y, z):
    """Rotation vector [rad] of a unit quaternion, the shorter way round (angle <= pi)."""
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    s = sqrt(x * x + y * y + z * z)
    f = 2.0 / w if s < 1e-12 else 2.0 * atan2(s, w) / s
    return f * x, f * y, f * z


@inner
def relative_vector(a, b):
    """Body rotation vector that takes the quaternion a (4,) to b (4,): log(a^-1 b)."""
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    return log_quaternion(
        a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3,
        a0 * b1 - a1 * b0 - (a2 * b3 - a3 * b2),
        a0 * b2 - a2 * b0 - (a3 * b1 - a1 * b3),
        a0 * b3 - a3 * b0 - (a1 * b2 - a2 * b1),
    )


@kernel
def relative_rotation(q, target):
    """Body rotation vectors that take q to target, both (N, 4): log(q^-1 target).  Returns (N, 3) [rad]."""
    out = np.empty((q.shape[0], 3))
    for i in range(q.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = relative_vector(q[i], target[i])
    return out


@kernel
def rotate_bodies(q, phi, out):
    """Turn each q (N, 4) by its body rotation vector phi (N, 3):  out = q o exp(phi / 2), renormalised."""
    for i in range(q.shape[0]):
        b0, b1, b2, b3 = exp_half(phi[i, 0], phi[i, 1], phi[i, 2])
        a0, a1, a2, a3 = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        c0 = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
        c1 = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
        c2 = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
        c3 = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0
        f = 1.0 / sqrt(c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = f * c0, f * c1, f * c2, f * c3


@kernel
def fill_products(a, b, out):
    """Quaternion products out = a o b (n, 4)."""
    for k in range(a.shape[0]):
        a0, a1, a2, a3 = a[k, 0], a[k, 1], a[k, 2], a[k, 3]
        b0, b1, b2, b3 = b[k, 0], b[k, 1], b[k, 2], b[k, 3]
        out[k, 0] = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
        out[k, 1] = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
        out[k, 2] = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
        out[k, 3] = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0


@kernel
def fill_turns(v, q):
    """Unit quaternions q (n, 4) of rotation vectors v (n, 3)."""
    for k in range(v.shape[0]):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = exp_half(v[k, 0], v[k, 1], v[k, 2])


@kernel
def fill_matrices(q, R):
    """Rotation matrices R (n, 3, 3) of unit quaternions q (n, 4)."""
    for k in range(q.shape[0]):
        w, x, y, z = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
        R[k, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        R[k, 0, 1] = 2.0 * (x * y - w * z)
        R[k, 0, 2] = 2.0 * (x * z + w * y)
        R[k, 1, 0] = 2.0 * (x * y + w * z)
        R[k, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        R[k, 1, 2] = 2.0 * (y * z - w * x)
        R[k, 2, 0] = 2.0 * (x * z - w * y)
        R[k, 2, 1] = 2.0 * (y * z + w * x)
        R[k, 2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel
def fill_quaternions(R, q):
    """Unit quaternions q (n, 4), w >= 0, of rotation matrices R (n, 3, 3).

    Takes the largest of the four components as pivot, so that no rotation loses digits.
    Source: Shepperd (1978), doi 10.2514/3.55767.
    """
    for n in range(R.shape[0]):
        trace = R[n, 0, 0] + R[n, 1, 1] + R[n, 2, 2]
        i = 0
        if R[n, 1, 1] > R[n, 0, 0]:
            i = 1
        if R[n, 2, 2] > R[n, i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        if trace >= R[n, i, i]:
            q[n, 0] = 1.0 + trace
            q[n, 1] = R[n, 2, 1] - R[n, 1, 2]
            q[n, 2] = R[n, 0, 2] - R[n, 2, 0]
            q[n, 3] = R[n, 1, 0] - R[n, 0, 1]
        else:
            q[n, 0] = R[n, k, j] - R[n, j, k]
            q[n, 1 + i] = 1.0 + 2.0 * R[n, i, i] - trace
            q[n, 1 + j] = R[n, j, i] + R[n, i, j]
            q[n, 1 + k] = R[n, k, i] + R[n, i, k]
        f = 1.0 / sqrt(q[n, 0] ** 2 + q[n, 1] ** 2 + q[n, 2] ** 2 + q[n, 3] ** 2)
        if q[n, 0] < 0.0:
            f = -f
        for m in range(4):
            q[n, m] *= f


def matrix_from_quaternion(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.ascontiguousarray(q, dtype=float)
    R = np.empty((*q.shape[:-1], 3, 3))
    fill_matrices(q.reshape(-1, 4), R.reshape(-1, 3, 3))
    return R


def quaternion_from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3), w >= 0."""
    R = np.ascontiguousarray(R, dtype=float)
    q = np.empty((*R.shape[:-2], 4))
    fill_quaternions(R.reshape(-1, 3, 3), q.reshape(-1, 4))
    return q


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a o b, (..., 4)."""
    a, b = np.ascontiguousarray(a, dtype=float), np.ascontiguousarray(b, dtype=float)
    if a.shape != b.shape:
        a, b = (np.ascontiguousarray(x) for x in np.broadcast_arrays(a, b))
    out = np.empty(a.shape)
    fill_products(a.reshape(-1, 4), b.reshape(-1, 4), out.reshape(-1, 4))
    return out


def conjugate(q: np.ndarray) -> np.ndarray:
    """Inverse of unit quaternions (..., 4)."""
    return np.asarray(q, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def matrix_from_vector(v: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    return matrix_from_quaternion(quaternion_from_vector(v))


def quaternion_from_vector(v: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) [rad]."""
    v = np.ascontiguousarray(v, dtype=float)
    q = np.empty((*v.shape[:-1], 4))
    fill_turns(v.reshape(-1, 3), q.reshape(-1, 4))
    return q


def kardan_from_matrix(R: np.ndarray) -> np.ndarray:
    """Kardan angles (psi, theta, phi) (..., 3) [rad] of rotation matrices; theta in [-pi/2, pi/2].

    At theta = +-90 deg only psi +- phi is defined: phi is set to 0 there.
    """
    R = np.asarray(R, dtype=float)
    theta = np.arctan2(R[..., 0, 2], np.hypot(R[..., 0, 0], R[..., 0, 1]))
    locked = np.hypot(R[..., 0, 0], R[..., 0, 1]) < 1e-12
    psi = np.where(locked, np.arctan2(R[..., 2, 1], R[..., 1, 1]), np.arctan2(-R[..., 1, 2], R[..., 2, 2]))
    phi = np.where(locked, 0.0, np.arctan2(-R[..., 0, 1], R[..., 0, 0]))
    return np.stack([psi, theta, phi], axis=-1)


def matrix_from_kardan(angles: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of Kardan angles (psi, theta, phi) (..., 3) [rad]."""
    return matrix_from_quaternion(quaternion_from_kardan(angles))


def quaternion_from_kardan(angles: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of Kardan angles (psi, theta, phi) (..., 3) [rad]."""
    half = 0.5 * np.asarray(angles, dtype=float)
    c, s = np.cos(half), np.sin(half)
    zero = np.zeros_like(c[..., 0])
    x = np.stack([c[..., 0], s[..., 0], zero, zero], axis=-1)
    y = np.stack([c[..., 1], zero, s[..., 1], zero], axis=-1)
    z = np.stack([c[..., 2], zero, zero, s[..., 2]], axis=-1)
    return multiply(multiply(x, y), z)


@kernel
def transport_normals(points, tangents, normals):
    """Carry normals[0] along a curve without twist, in place: points, unit tangents, normals (P, 3).

    Double reflection, fourth order in the spacing.
    Source: Wang, Juettler, Zheng, Liu (2008), doi 10.1145/1330511.1330513.
    """
    for k in range(points.shape[0] - 1):
        v0, v1 = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        v2 = points[k + 1, 2] - points[k, 2]
        c = v0 * v0 + v1 * v1 + v2 * v2
        n0, n1, n2 = normals[k, 0], normals[k, 1], normals[k, 2]
        t0, t1, t2 = tangents[k, 0], tangents[k, 1], tangents[k, 2]
        if c > 0.0:
            f = 2.0 * (v0 * n0 + v1 * n1 + v2 * n2) / c
            n0, n1, n2 = n0 - f * v0, n1 - f * v1, n2 - f * v2
            f = 2.0 * (v0 * t0 + v1 * t1 + v2 * t2) / c
            t0, t1, t2 = t0 - f * v0, t1 - f * v1, t2 - f * v2
        w0, w1, w2 = tangents[k + 1, 0] - t0, tangents[k + 1, 1] - t1, tangents[k + 1, 2] - t2
        c = w0 * w0 + w1 * w1 + w2 * w2
        if c > 0.0:
            f = 2.0 * (w0 * n0 + w1 * n1 + w2 * n2) / c
            n0, n1, n2 = n0 - f * w0, n1 - f * w1, n2 - f * w2
        t0, t1, t2 = tangents[k + 1, 0], tangents[k + 1, 1], tangents[k + 1, 2]
        f = n0 * t0 + n1 * t1 + n2 * t2
        n0, n1, n2 = n0 - f * t0, n1 - f * t1, n2 - f * t2
        f = 1.0 / sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        normals[k + 1, 0], normals[k + 1, 1], normals[k + 1, 2] = f * n0, f * n1, f * n2
