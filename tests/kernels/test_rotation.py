"""Rotations: round trips and SciPy's Rotation as reference."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cosserat_fem.kernels import rotation as so3


@pytest.fixture
def rotations():
    some = Rotation.random(300, random_state=5)
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    return Rotation.concatenate([some, half_turns, Rotation.identity(2)])


def test_matrix_and_quaternion_round_trip(rotations):
    """Also at half turns, where the trace alone would lose all digits."""
    R = rotations.as_matrix()
    q = so3.quaternion_from_matrix(R)
    np.testing.assert_allclose(so3.matrix_from_quaternion(q), R, atol=1e-14)
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-5, 1e-3, 1.0, 3.0, np.pi])
def test_exponential_and_logarithm(size, rng):
    """exp against SciPy, log its inverse, for angles from nothing to a half turn."""
    v = rng.normal(size=(50, 3))
    v *= size / np.linalg.norm(v, axis=1)[:, None]
    q = so3.quaternion_from_vector(v)
    np.testing.assert_allclose(so3.matrix_from_quaternion(q), Rotation.from_rotvec(v).as_matrix(), atol=1e-14)
    start = np.tile([1.0, 0, 0, 0], (50, 1))
    np.testing.assert_allclose(abs(so3.relative_rotation(start, q)), abs(v), atol=2e-15 + 1e-14 * size)
    turned = np.empty_like(q)
    so3.rotate_bodies(start, v, turned)
    np.testing.assert_allclose(turned, q, atol=1e-15)


def test_relative_rotation_takes_the_short_way(rotations):
    """log(q^-1 p) turns q into p, with an angle of at most a half turn."""
    q = so3.quaternion_from_matrix(rotations.as_matrix())
    p = np.roll(q, 1, axis=0)
    v = so3.relative_rotation(q, p)
    assert (np.linalg.norm(v, axis=1) <= np.pi + 1e-12).all()
    reached = so3.multiply(q, so3.quaternion_from_vector(v))
    np.testing.assert_allclose(so3.matrix_from_quaternion(reached), so3.matrix_from_quaternion(p), atol=1e-14)


def test_kardan_round_trip(rotations):
    """R -> (psi, theta, phi) -> R; the angles are SciPy's intrinsic X-Y'-Z''."""
    R = rotations.as_matrix()
    angles = so3.kardan_from_matrix(R)
    np.testing.assert_allclose(so3.matrix_from_kardan(angles), R, atol=1e-13)
    regular = abs(abs(angles[:, 1]) - np.pi / 2) > 1e-3
    off = angles[regular] - rotations[regular].as_euler("XYZ")
    np.testing.assert_allclose(np.cos(off), 1.0, atol=1e-15)  # equal but for whole turns


@pytest.mark.parametrize("theta", [90.0, -90.0])
def test_kardan_at_the_singularity(theta):
    """Only psi +- phi is defined at theta = 90 deg: the rotation comes back right, phi is 0."""
    R = so3.matrix_from_kardan(np.radians([20.0, theta, 35.0]))
    angles = so3.kardan_from_matrix(R)
    assert angles[2] == 0.0
    np.testing.assert_allclose(so3.matrix_from_kardan(angles), R, atol=1e-12)


def test_transported_normals_do_not_twist():
    """On a planar curve the carried normal keeps its angle to the plane; on a helix it turns back by the torsion."""
    s = np.linspace(0, 3, 400)
    k, tau = 1.3, 0.7
    w = np.hypot(k, tau)
    a, b = k / w**2, tau / w
    r = np.stack([a * np.cos(w * s), a * np.sin(w * s), b * s], axis=-1)
    T = np.stack([-a * w * np.sin(w * s), a * w * np.cos(w * s), np.full_like(s, b)], axis=-1)
    N = -np.stack([np.cos(w * s), np.sin(w * s), 0 * s], axis=-1)
    B = np.cross(T, N)
    carried = np.empty_like(r)
    carried[0] = N[0]
    so3.transport_normals(r, T, carried)
    angle = np.unwrap(np.arctan2((carried * B).sum(-1), (carried * N).sum(-1)))
    np.testing.assert_allclose(angle, -tau * s, atol=1e-7)
