"""Velocities and accelerations of parts and driven supports, against differences of their poses."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import cosserat_fem as cf
from cosserat_fem.kernels.rotation import matrix_from_vector, quaternion_from_vector
from cosserat_fem.schedule import Schedule

TIMES = np.array([0.0, 0.4, 1.0, 1.7, 2.5])
ANGLES = np.array([0.0, 0.3, -0.2, 0.9, 1.1])


def quaternions(seed=3):
    turns = np.cumsum(0.3 * np.random.default_rng(seed).normal(size=(5, 3)), axis=0)
    return np.array([quaternion_from_vector(v) for v in turns])


def places(seed=4):
    return np.random.default_rng(seed).normal(size=(5, 3))


def wobble(t):
    return np.array([np.sin(t), t**2, 0.3]), quaternion_from_vector(np.array([0.4 * t, 0.1 * np.sin(2 * t), 0.2]))


MOTIONS = {
    "constant rate": cf.Hinge((0.1, -0.3, 0.2), (1, 2, 2), 0.7),
    "linear table": cf.Hinge((0.1, -0.3, 0.2), (1, 2, 2), (TIMES, ANGLES)),
    "smooth table": cf.Hinge((0.1, -0.3, 0.2), (1, 2, 2), (TIMES, ANGLES), smooth=True),
    "function": cf.Hinge((0.1, -0.3, 0.2), (0, 0, 1), lambda t: np.sin(3 * t)),
    "spline object": cf.Hinge((0.1, -0.3, 0.2), (0, 0, 1), CubicSpline(TIMES, ANGLES)),
    "slider": cf.Slider((1, 1, 0), (TIMES, ANGLES), smooth=True),
    "path": cf.Path((TIMES, places(), quaternions())),
    "smooth path": cf.Path((TIMES, places(), quaternions()), smooth=True),
    "path function": cf.Path(wobble),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_driven_support(name):
    """Place, velocity and acceleration of a support on a moving part; rotation seen in the section."""
    section = cf.Section.round(0.01, youngs_modulus=1e6)
    rod = cf.Rod("rod", section, [(0, 0, 0), (0.3, 0.5, 0.1)])
    part = cf.Part("part", motion=MOTIONS[name])
    constraints = cf.Model([rod], [cf.Clamp(rod, "end", to=part)]).constraints
    t, h = 0.77, 1e-4
    before, here, after = (constraints.targets(t + k * h) for k in (-1, 0, 1))
    velocity, acceleration = constraints.driven(t)
    np.testing.assert_allclose(velocity[0, :3], (after.place - before.place)[0] / (2 * h), atol=1e-6)
    second = (after.place - 2 * here.place + before.place)[0] / h**2
    np.testing.assert_allclose(acceleration[0, :3], second, atol=2e-5)
    spin = here.attitude[0].T @ (after.attitude[0] - before.attitude[0]) / (2 * h)
    np.testing.assert_allclose(velocity[0, 3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-6)
    change = (constraints.driven(t + h)[0] - constraints.driven(t - h)[0])[0, 3:] / (2 * h)
    np.testing.assert_allclose(acceleration[0, 3:], change, atol=1e-5)


def test_kinks_are_where_the_velocity_jumps():
    assert MOTIONS["linear table"].kinks.tolist() == TIMES.tolist()
    assert MOTIONS["path"].kinks.tolist() == TIMES.tolist()
    for name in ("constant rate", "smooth table", "function", "smooth path"):
        assert len(MOTIONS[name].kinks) == 0
    motion = MOTIONS["linear table"]
    jump = motion.rates(0.4).omega - motion.rates(0.4 - 1e-6).omega
    np.testing.assert_allclose(jump, np.array([1, 2, 2]) / 3 * (-0.5 / 0.6 - 0.3 / 0.4))


def test_smooth_table_starts_and_ends_at_rest():
    schedule = Schedule("travel", (TIMES, ANGLES), smooth=True)
    np.testing.assert_allclose([schedule.at(t) for t in TIMES], ANGLES, atol=1e-15)
    assert schedule.rates(0.0)[0] == pytest.approx(0, abs=1e-12)
    assert schedule.rates(2.5)[0] == pytest.approx(0, abs=1e-12)


def test_smooth_path_passes_through_its_table():
    path = MOTIONS["smooth path"]
    for k, t in enumerate(TIMES):
        R, c = path.pose(t)
        q = quaternions()
        start = matrix_from_vector(np.zeros(3)) @ R
        place = places()
        np.testing.assert_allclose(start @ place[0] + c, place[k], atol=1e-12)
        turn = cf.Path((TIMES, place, q)).pose(t)[0]
        np.testing.assert_allclose(R, turn, atol=1e-12)


def test_smooth_table_stays_where_rows_are_equal():
    schedule = Schedule("travel", ([0, 1, 2, 3], [0.0, 1.0, 1.0, 0.5]), smooth=True)
    inside = np.linspace(1, 2, 11)
    np.testing.assert_allclose([schedule.at(t) for t in inside], 1.0, atol=1e-15)
    climb = np.array([schedule.at(t) for t in np.linspace(0, 1, 51)])
    assert (np.diff(climb) >= 0).all()


def test_fast_function_has_its_velocity():
    """400 Hz: the differences are short enough."""
    omega = 2 * np.pi * 400
    slider = cf.Slider((1, 0, 0), lambda t: 1e-3 * (1 - np.cos(omega * t)))
    rates = slider.rates(0.0123)
    assert rates.c_rate[0] == pytest.approx(1e-3 * omega * np.sin(omega * 0.0123), abs=1e-3 * omega * 1e-3)
