"""Motions with closed forms: pendulum, tumbling body, impact wave, drag, damping, turning rod, free flight."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import cosserat_fem as cf


@pytest.mark.parametrize("amplitude", [10, 90])
def test_pendulum(validation, order_of, amplitude):
    """A stiff rod swings about a pin: its angle by elliptic functions, order 2 in time."""
    section = cf.Section(
        force_stiffness=(1e7,) * 3, moment_stiffness=(1e5,) * 3, mass_per_length=1.0, rotary_inertia=(1e-9,) * 3
    )
    a = np.radians(amplitude)
    w, k = np.sqrt(1.5 * 9.81), np.sin(a / 2)
    sn = ellipj(ellipk(k * k) - w * 1.0, k * k)[0]
    wanted = 2 * np.arcsin(k * sn)
    steps, errors = (0.01, 0.005, 0.0025), []
    for dt in steps:
        rod = cf.Rod("rod", section, [(0, 0, 0), (np.sin(a), 0, -np.cos(a))], n_elements=2, order=2)
        model = cf.Model([rod], [cf.Clamp(rod, "start", free=("ry",))], [cf.Gravity((0, 0, -9.81))])
        history = cf.solve_dynamic(model, 1.0, start="drawn", rho_inf=0.5, step=cf.FixedStep(dt), times=[1.0])
        x, _, z = history.positions("rod")[-1, -1]
        errors.append(abs(np.arctan2(x, -z) - wanted))
    order = -order_of(steps, errors)
    validation.error(
        "swing of a pendulum", "elliptic functions", errors[-1], 1e-3, unit="rad", variant=f"{amplitude} deg",
        order=order, least_order=1.7,
    )  # fmt: skip


def test_tumbling_body(validation):
    """A stiff rod with three different inertias, spun about the middle one, turns over and over (Dzhanibekov)."""
    J = np.array([0.5, 0.7, 0.4])  # of the sections; the length adds 1/12 about d1 and d2
    section = cf.Section(
        force_stiffness=(1e8,) * 3, moment_stiffness=(1e7,) * 3, mass_per_length=1.0, rotary_inertia=tuple(J)
    )
    rod = cf.Rod("body", section, [(-0.5, 0, 0), (0.5, 0, 0)], n_elements=2, order=2, normal=(0, 1, 0))
    model = cf.Model([rod])
    R = rod.frames(np.array([0.0]))[0]
    total = J + [1 / 12, 1 / 12, 0]
    start = np.array([2.0, 0.05, 0.03])  # d1 has the middle inertia
    order = np.argsort(total)
    assert order[1] == 0

    def euler(t, w):
        return np.cross(total * w, w) / total

    times = np.linspace(0, 30, 61)
    wanted = solve_ivp(euler, (0, 30), start, t_eval=times, rtol=1e-11, atol=1e-13, method="DOP853").y.T
    assert (np.diff(np.sign(wanted[:, 0])) != 0).sum() >= 2  # it turns over
    velocity = cf.RigidVelocity(omega=R @ start)
    step = cf.FixedStep(0.01, richardson=True)
    history = cf.solve_dynamic(model, 30.0, start="drawn", velocity=velocity, step=step, times=times)
    found = history.velocities("body")[:, 2, 3:]
    error = np.abs(found - wanted).max() / 2.0
    validation.error("tumbling of a free body", "Euler's equations, order 8", error, 1e-3, unit="of the spin")


def test_impact_wave(validation):
    """A rod that flies along itself and is stopped at one end: the force is v sqrt(EA m) until the wave is back."""
    EA, m, v = 1e4, 1.0, 0.5
    section = cf.Section(force_stiffness=(EA,) * 3, moment_stiffness=(10.0,) * 3, mass_per_length=m)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=60, order=2)
    model = cf.Model([rod], [cf.Clamp(rod, "start")])
    velocity = np.zeros((model.space.n_nodes, 6))
    velocity[:, 0] = v
    velocity[model.constraints.support_node] = 0.0
    back = 2.0 / np.sqrt(EA / m)
    times = np.linspace(0.1, 0.9, 81) * back
    history = cf.solve_dynamic(
        model, times[-1], start="drawn", velocity=velocity, rho_inf=0.2, step=cf.FixedStep(back / 2000), times=times
    )
    found = -history.reaction("rod.start@ground")[:, 0].mean()
    validation.row("force of an impact along a rod", "wave theory, closed form", v * np.sqrt(EA * m), found, 0.02)


def test_falling_with_drag(validation):
    """A rod falls broadside through a medium: v = v_end tanh(g t / v_end)."""
    section = cf.Section(force_stiffness=(1e5,) * 3, moment_stiffness=(1e4,) * 3, mass_per_length=0.2)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=2, order=2)
    model = cf.Model([rod], [], [cf.Gravity((0, 0, -9.81)), cf.Drag(rod, normal_quadratic=0.5)])
    times = [0.2, 0.5, 1.0]
    step = cf.FixedStep(0.005, richardson=True)
    history = cf.solve_dynamic(model, 1.0, start="drawn", step=step, times=times)
    end = np.sqrt(0.2 * 9.81 / 0.5)
    wanted = -end * np.tanh(9.81 * np.array(times) / end)
    found = history.velocities("rod")[-3:, 0, 2]
    validation.row("falling rod with drag", "closed form", wanted, found, 1e-5)


@pytest.mark.parametrize("kind", ["internal", "mass"])
def test_damped_vibration(validation, kind):
    """The first vibration of a cantilever dies as exp(-z w t): z = w tau / 2 (internal), alpha / (2 w) (with the mass)."""
    section = cf.Section(
        force_stiffness=(1e5,) * 3, moment_stiffness=(1.0,) * 3, mass_per_length=1.0, rotary_inertia=(1e-6, 1e-6, 2e-6)
    )
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=4, order=3)
    still = cf.Model([rod], [cf.Clamp(rod, "start")])
    first = cf.modes(still, n=2)
    w = first.omega[0]
    damping = cf.Damping(time=0.02 * 2 / w) if kind == "internal" else cf.Damping(mass=0.02 * 2 * w)
    model = cf.Model([rod], still.supports, [damping])
    period = 2 * np.pi / w
    t = np.linspace(0, 4 * period, 9)
    velocity = 1e-4 * w * first.shapes[0]
    history = cf.solve_dynamic(
        model, t[-1], start="drawn", velocity=velocity, step=cf.FixedStep(period / 200, True), times=t
    )
    energy = history.kinetic_energy + history.energy
    found = -0.5 * np.polyfit(t, np.log(energy), 1)[0] / w  # twice a period
    validation.row("damped vibration", "logarithmic decrement", 0.02, found, 5e-3, variant=kind)


def test_free_flight_keeps_momentum(validation):
    """A bent rod let go while it turns: both momenta stay, and the energy nearly, over a thousand steps."""
    section = cf.Section(
        force_stiffness=(1e3,) * 3, moment_stiffness=(1.0,) * 3, mass_per_length=1.0, rotary_inertia=(1e-3, 1e-3, 2e-3)
    )
    s = np.linspace(0, np.pi, 60)
    points = np.stack([np.sin(s), 1 - np.cos(s), 0.2 * s], axis=-1)
    rod = cf.Rod("rod", section, points, n_elements=6, order=3)  # straight at rest
    velocity = cf.RigidVelocity(v=(1, 0, 0.5), omega=(0.3, 1.0, -0.5))
    history = cf.solve_dynamic(
        cf.Model([rod]),
        1.0,
        start="drawn",
        velocity=velocity,
        rho_inf=1.0,
        step=cf.FixedStep(1e-3),
        times=np.linspace(0, 1, 11),
    )
    linear, angular = history.momentum
    case = "free flight of a bent rod"
    off = np.abs(linear - linear[0]).max() / np.linalg.norm(linear[0])
    validation.error(case, "conservation", off, 1e-11, variant="linear momentum")
    off = np.abs(angular - angular[0]).max() / np.linalg.norm(angular[0])
    validation.error(case, "conservation", off, 1e-5, variant="angular momentum")
    total = history.kinetic_energy + history.energy
    validation.error(case, "conservation", np.abs(total / total[0] - 1).max(), 1e-4, variant="energy")


def test_turning_rod(validation):
    """A rod that turns steadily about its end: the pull at the hub is the whole centrifugal force, and its stretch."""
    EA, m, spin = 100.0, 1.0, 3.0
    section = cf.Section(
        force_stiffness=(EA,) * 3, moment_stiffness=(1.0,) * 3, mass_per_length=m, rotary_inertia=(1e-6, 1e-6, 2e-6)
    )
    rod = cf.Rod("arm", section, [(0, 0, 0), (1, 0, 0)], n_elements=6, order=3)

    def angle(t):  # up to speed within 2 s
        x = min(t / 2.0, 1.0)
        return spin * 2.0 * (x**3 - 0.5 * x**4) + spin * max(t - 2.0, 0.0)

    hub = cf.Part("hub", motion=cf.Hinge((0, 0, 0), (0, 0, 1), angle))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=hub)], [cf.Damping(time=0.2)])
    history = cf.solve_dynamic(
        model, 12.0, start="drawn", rho_inf=0.5, step=cf.FixedStep(0.02, richardson=True), times=[12.0]
    )
    k = spin * np.sqrt(m / EA)
    tip = np.linalg.norm(history.positions("arm")[-1, -1])
    validation.row("steadily turning rod", "closed form", np.tan(k) / k, tip, 1e-5, variant="radius of the tip")
    pull = np.linalg.norm(history.reaction("arm.start@hub")[-1, :2])
    wanted = EA * (1 / np.cos(k) - 1)
    validation.row("steadily turning rod", "closed form", wanted, pull, 1e-4, variant="pull at the hub")
