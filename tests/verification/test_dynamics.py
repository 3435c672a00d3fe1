"""C01, C03, C04, C05, D1, D2: motions in time against spectral elements with an eighth-order integrator, and closed forms.

C01 flying spaghetti (Simo and Vu-Quoc 1988), C03 spin-up (1986), C05 right-angle cantilever (1988); D1 the same as C01 with
the couple mirrored; D2 a rubber pendulum.
"""

from itertools import pairwise

import numpy as np
import pytest

import cosserat_fem as cf

SPECTRAL = "spectral elements, integrator of order 8"


def times_of(values, last=np.inf):
    t = np.array(sorted(float(key[2:]) for key in values))
    return t[t <= last]


def spaghetti(stiffness, force, moment, n_elements, order):
    """Free rod from (6, 0, 0), loaded there, to (0, 8, 0)."""
    section = cf.Section(
        force_stiffness=stiffness[:3], moment_stiffness=stiffness[3:], mass_per_length=1.0, rotary_inertia=(10, 10, 10)
    )
    rod = cf.Rod("rod", section, [(6, 0, 0), (0, 8, 0)], n_elements=n_elements, order=order, normal=(0, 0, 1))
    return cf.Model([rod], [], [cf.PointLoad(rod, "start", force=force, moment=moment)])


def triangle(direction):
    """200 times a direction, rising to 2.5 s and falling to 5 s."""
    d = 200 * np.array(direction, dtype=float)
    return [0, 2.5, 5, 11], [0 * d, d, 0 * d, 0 * d]


STIFF_3D = (1e4, 1e4, 1e4, 500, 500, 500)


def ends_error(history, values):
    """Largest distance (T,) of both ends from the reference."""
    r = history.positions("rod")[:, [0, -1]]
    ref = np.array([[values[f"t={t:g}"][k] for k in ("loaded_end", "other_end")] for t in history.t])
    return np.linalg.norm(r - ref, axis=2).max(axis=1)


def test_flying_spaghetti_3d(references, validation):
    """To 1e-5 of the length over 10 s, with momenta and energy as they must be."""
    values = references["C01_spaghetti_3d"]["values"]
    model = spaghetti(STIFF_3D, triangle((0.1, 0, 0)), triangle((0, 0.5, -1)), 12, 3)
    step = cf.FixedStep(0.0125, richardson=True)
    history = cf.solve_dynamic(model, 10.0, start="drawn", step=step, times=times_of(values))
    error = ends_error(history, values).max() / 10
    validation.error(
        "flying spaghetti in space", SPECTRAL, error, 1e-5, unit="L", variant="12 x p3, 12.5 ms extrapolated"
    )
    end = values["t=10"]
    linear, angular = history.momentum
    np.testing.assert_allclose(linear[-1], end["linear_momentum"], atol=1e-3)
    np.testing.assert_allclose(angular[-1], end["angular_momentum_origin"], atol=0.02)
    assert history.kinetic_energy[-1] + history.energy[-1] == pytest.approx(end["total"], rel=1e-4)


def test_mirrored_spaghetti(references, validation):
    """D1: root mean square of both ends over 10 s below 1e-5 of the length."""
    ref = np.array(references["D1_ends"])
    model = spaghetti(STIFF_3D, triangle((0.1, 0, 0)), triangle((0, -0.5, -1)), 12, 3)
    step = cf.FixedStep(0.0125, richardson=True)
    history = cf.solve_dynamic(model, 10.0, start="drawn", step=step, times=np.arange(11.0))
    apart = history.positions("rod")[:, [0, -1]] - ref
    error = np.sqrt((apart**2).sum(-1).mean()) / 10
    validation.error("flying spaghetti in space", SPECTRAL, error, 1e-5, unit="L", variant="mirrored couple, rms")


def test_order_of_spaghetti(references, say, order_of):
    """Order 2 in positions and velocities (root mean square) for several spectral radii, before the load's kink."""
    model = spaghetti(STIFF_3D, triangle((0.1, 0, 0)), triangle((0, -0.5, -1)), 4, 3)

    def run(step, rho):
        history = cf.solve_dynamic(model, 2.0, start="drawn", rho_inf=rho, step=step, times=[2.0])
        return history.positions("rod")[-1], history.velocities("rod")[-1]

    best = run(cf.FixedStep(0.0005, richardson=True), 0.8)
    for rho in (0.0, 0.5, 0.8, 1.0):
        steps = (0.01, 0.005, 0.0025)
        errors = [
            [np.sqrt(((a - b) ** 2).mean()) for a, b in zip(run(cf.FixedStep(dt), rho), best, strict=True)]
            for dt in steps
        ]
        orders = [-order_of(steps, e) for e in np.array(errors).T]
        say(f"rho {rho}: position {errors[-1][0]:.1e}, order {orders[0]:.2f}; velocity order {orders[1]:.2f}")
        assert orders[0] > 1.8
        assert orders[1] > 1.6  # the load starts with a kink, and waves with fronts


def smooth_turn(t):
    """From 0 to 1 rad in 1 s, five times differentiable at the ends."""
    x = min(max(t, 0.0), 1.0)
    return x**6 * (462 - 1980 * x + 3465 * x**2 - 3080 * x**3 + 1386 * x**4 - 252 * x**5)


def test_order_with_a_driven_clamp(say, order_of):
    """A clamp that turns smoothly: order 2 in positions, velocities, reaction force, moment and hinge torque."""
    section = cf.Section(
        force_stiffness=(400, 400, 1000), moment_stiffness=(0.1, 0.1, 0.08), mass_per_length=0.05,
        rotary_inertia=(1e-6, 1e-6, 2e-6),
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0.1, 0, 0), (0.6, 0, 0)], n_elements=6, order=3)
    arm = cf.Part("arm", motion=cf.Hinge((0, 0, 0), (0, 0, 1), smooth_turn))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=arm)])

    def run(step):
        history = cf.solve_dynamic(model, 0.8, start="drawn", step=step, times=[0.8])
        load = history.reaction("rod.start@arm")[-1]
        return (
            history.positions("rod")[-1], history.velocities("rod")[-1], load[:3], load[3:], history.hinge_torque("arm")
        )  # fmt: skip

    best = run(cf.FixedStep(0.0005, richardson=True))
    steps = (0.008, 0.004, 0.002)
    errors = np.array(
        [
            [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(run(cf.FixedStep(dt)), best, strict=True)]
            for dt in steps
        ]
    )
    orders = [-order_of(steps, e) for e in errors.T]
    names = ("position", "velocity", "force", "moment", "torque")
    say(", ".join(f"{n} {e:.1e} order {o:.2f}" for n, e, o in zip(names, errors[-1], orders, strict=True)))
    assert min(orders) > 1.8
    assert errors[-1].max() < 1e-2


def test_flying_spaghetti_2d(references, validation):
    """A suddenly applied and removed load: waves with fronts; within 1e-3 of the length on 16 elements."""
    values = references["C01_spaghetti_2d_M-1"]["values"]
    load = [0, 2.5, 2.5, 11]
    model = spaghetti(
        (1e4, 1e4, 1e4, 100, 100, 500),
        (load, [(8, 0, 0), (8, 0, 0), (0, 0, 0), (0, 0, 0)]),
        (load, [(0, 0, -80), (0, 0, -80), (0, 0, 0), (0, 0, 0)]), 16, 3,
    )  # fmt: skip
    history = cf.solve_dynamic(
        model, 10.0, start="drawn", step=cf.FixedStep(0.005, richardson=True), times=times_of(values)
    )
    error = ends_error(history, values).max() / 10
    validation.error("flying spaghetti in a plane", SPECTRAL, error, 5e-4, unit="L", variant="16 x p3, sudden load")
    linear, _ = history.momentum
    np.testing.assert_allclose(linear[-1], (20, 0, 0), atol=1e-4)


@pytest.mark.slow
def test_flying_spaghetti_2d_fine(references, validation):
    """The same within the reference's own error."""
    case = references["C01_spaghetti_2d_M-1"]
    load = [0, 2.5, 2.5, 11]
    model = spaghetti(
        (1e4, 1e4, 1e4, 100, 100, 500),
        (load, [(8, 0, 0), (8, 0, 0), (0, 0, 0), (0, 0, 0)]),
        (load, [(0, 0, -80), (0, 0, -80), (0, 0, 0), (0, 0, 0)]), 32, 6,
    )  # fmt: skip
    history = cf.solve_dynamic(
        model, 10.0, start="drawn", step=cf.FixedStep(0.000625, richardson=True), times=times_of(case["values"])
    )
    error = ends_error(history, case["values"]).max()
    validation.error("flying spaghetti in a plane", SPECTRAL, error, case["err"], unit="m", variant="32 x p6, fine")


def spin_up_angle(t):
    w = 2 * np.pi / 15
    return 6 / 15 * (t * t / 2 + (np.cos(w * t) - 1) / w**2) if t < 15 else 6 * t - 45


def spin_up_error(case, n_elements, dt):
    """Largest distance of the tip from the reference in the turning frame, with extrapolated steps; and the history."""
    section = cf.Section(
        force_stiffness=(1e7, 1e7, 2.8e7), moment_stiffness=(1.4e4,) * 3, mass_per_length=1.2,
        rotary_inertia=(6e-4, 6e-4, 1.2e-3),
    )  # fmt: skip
    rod = cf.Rod("arm", section, [(0, 0, 0), (10, 0, 0)], n_elements=n_elements, order=3)
    hub = cf.Part("hub", motion=cf.Hinge((0, 0, 0), (0, 0, 1), spin_up_angle))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=hub)])
    step = cf.FixedStep(dt, richardson=True)
    history = cf.solve_dynamic(model, 20.0, start="drawn", step=step, times=times_of(case["values"]))
    tip, error = history.positions("arm")[:, -1], 0.0
    for k, t in enumerate(history.t):
        a, ref = spin_up_angle(t), case["values"][f"t={t:g}"]
        c, s = np.cos(a), np.sin(a)
        error = max(error, abs(c * tip[k, 0] + s * tip[k, 1] - 10 - ref["u1_axial"]))
        error = max(error, abs(-s * tip[k, 0] + c * tip[k, 1] - ref["u2_transverse"]))
    return error, history


def test_spin_up(references, validation):
    """C03: an arm turned up to 6 rad/s by its root; tip in the turning frame."""
    error, history = spin_up_error(references["C03_spin_up"], 6, 0.0125)
    validation.error(
        "spin-up of an arm", SPECTRAL, error, 2e-5, unit="m of 0.57 m", variant="6 x p3, 12.5 ms extrapolated"
    )
    assert history.positions("arm")[-1, :, 2] == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
def test_spin_up_fine(references, validation):
    """The same within the reference's own error."""
    case = references["C03_spin_up"]
    error, _ = spin_up_error(case, 12, 0.004)
    validation.error("spin-up of an arm", SPECTRAL, error, case["err"], unit="m", variant="12 x p3, as the reference")


def test_elbow(references, validation):
    """C05: two rods welded at a right angle, loaded out of their plane; within the reference's error."""
    case = references["C05_elbow"]
    section = cf.Section(
        force_stiffness=(1e6,) * 3, moment_stiffness=(1e3,) * 3, mass_per_length=1.0, rotary_inertia=(10, 10, 20)
    )
    a = cf.Rod("a", section, [(0, 0, 0), (10, 0, 0)], n_elements=4)
    b = cf.Rod("b", section, [(10, 0, 0), (10, 10, 0)], n_elements=4)
    force = cf.PointLoad(a, "end", force=([0, 1, 2, 9], [(0, 0, 0), (0, 0, 50), (0, 0, 0), (0, 0, 0)]))
    model = cf.Model([a, b], [cf.Clamp(a, "start"), cf.Weld(a, "end", b, "start")], [force])
    times = times_of(case["values"], 5)
    history = cf.solve_dynamic(model, 5.0, start="drawn", step=cf.FixedStep(0.02, richardson=True), times=times)
    error = 0.0
    for k, t in enumerate(history.t):
        ref = case["values"][f"t={t:g}"]
        error = max(error, np.linalg.norm(history.positions("a")[k, -1] - (10, 0, 0) - ref["elbow_u"]))
        error = max(error, np.linalg.norm(history.positions("b")[k, -1] - (10, 10, 0) - ref["tip_u"]))
    validation.error("right-angle cantilever in motion", SPECTRAL, error, case["err"], unit="m", variant="4 + 4 x p3")


FREQUENCIES = ["slender r/L=0.01, clamped-free", "slender r/L=0.01, clamped-clamped", "stocky r/L=0.05, clamped-free"]


@pytest.mark.parametrize("name", FREQUENCIES)
def test_natural_frequencies(references, validation, name):
    """C04: of the linearised model with the lumped mass, and the first one from a free vibration's zero crossings."""
    data = references["C04_linear_frequencies"]["values"][name]
    stiffness = ((data["GA"], data["GA"], data["EA"]), (data["EI"],) * 3)
    section = cf.Section(
        force_stiffness=stiffness[0], moment_stiffness=stiffness[1], mass_per_length=data["rhoA"],
        rotary_inertia=(data["rhoI"], data["rhoI"], 2 * data["rhoI"]),
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=12, order=4)
    supports = [cf.Clamp(rod, "start")] + ([cf.Clamp(rod, "end")] if name.endswith("clamped") else [])
    model = cf.Model([rod], supports)
    space = model.space
    K = model.matrix(model.initial_state()).toarray()
    mass = np.concatenate([np.repeat(space.node_mass[:, None], 3, axis=1), space.node_inertia], axis=1).ravel()
    free = np.ones((space.n_nodes, 6), dtype=bool)
    free[model.constraints.support_node] = False
    free[:, :] &= np.array([0, 1, 0, 1, 0, 0], dtype=bool) | np.array([0, 1, 0, 0, 1, 0], dtype=bool)
    keep = np.flatnonzero(free.ravel())
    M = mass[keep]
    values, modes = np.linalg.eigh(K[np.ix_(keep, keep)] / np.sqrt(np.outer(M, M)))
    found = np.sqrt(np.abs(values[:3]))
    wanted = np.array(data["omega_1..6"][:3])
    assert np.abs(found / wanted - 1).max() < 1e-4
    # the same from a motion: start in the first mode, small
    shape = np.zeros(space.n_nodes * 6)
    shape[keep] = modes[:, 0] / np.sqrt(M)
    velocity = 1e-4 * wanted[0] * (shape / np.abs(shape).max()).reshape(-1, 6)
    period = 2 * np.pi / wanted[0]
    t = np.linspace(0, 8 * period, 1601)
    history = cf.solve_dynamic(model, t[-1], velocity=velocity, start="drawn", step=cf.FixedStep(t[1], True), times=t)
    u = history.positions("rod")[:, int(np.argmax(np.abs(velocity[space[rod].nodes, 1]))), 1]
    spectrum = np.abs(np.fft.rfft(u * np.hanning(len(u)), 16 * len(u)))
    k = int(np.argmax(spectrum))
    a, b, c = np.log(spectrum[k - 1 : k + 2])  # parabola through the logarithms of the three largest
    peak = (k + 0.5 * (a - c) / (a - 2 * b + c)) * 2 * np.pi / (t[1] * 16 * len(u))
    source = "Timoshenko, characteristic equation"
    validation.row("free vibration in time, frequency", source, wanted[0], peak, 2e-4, variant=name)


def rubber_pendulum(n_elements):
    d, E, density = 0.01, 5e6, 1100.0
    A, I = np.pi * d**2 / 4, np.pi * d**4 / 64
    section = cf.Section(
        force_stiffness=(E / 3 * A, E / 3 * A, E * A), moment_stiffness=(E * I, E * I, E / 3 * 2 * I),
        mass_per_length=density * A, rotary_inertia=(density * I, density * I, 2 * density * I),
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=n_elements, order=3)
    return cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, -9.81, 0))])


def test_rubber_pendulum(references, validation):
    """D2: a soft rod falls from the horizontal; tip over 1 s to 1e-5 of its length."""
    model = rubber_pendulum(20)
    ref = np.array(references["D2_tip"])
    step = cf.FixedStep(0.001, richardson=True)
    history = cf.solve_dynamic(model, 1.0, start="drawn", step=step, times=np.linspace(0, 1, 21))
    error = np.sqrt(((history.positions("rod")[:, -1, :2] - ref) ** 2).sum(-1).mean())
    validation.error("rubber pendulum", SPECTRAL, error, 1e-5, unit="L", variant="20 x p3, 1 ms extrapolated")
    assert history.positions("rod")[..., 2] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("problem", ["D1", "D2"])
def test_adaptive_error_goes_with_rtol(references, validation, problem):
    """Each halving of rtol halves the error within a factor of 2, and the error stays below rtol."""
    errors = []
    for rtol in (8e-2, 4e-2, 2e-2):
        if problem == "D1":
            model = spaghetti(STIFF_3D, triangle((0.1, 0, 0)), triangle((0, -0.5, -1)), 6, 3)
            ref, length = np.array(references["D1_ends"]), 10.0
            options = {"duration": 10.0, "times": np.arange(11.0)}
        else:
            model = rubber_pendulum(12)
            ref, length = np.array(references["D2_tip"]), 1.0
            options = {"duration": 1.0, "times": np.linspace(0, 1, 21)}
        history = cf.solve_dynamic(model, start="drawn", step=cf.AdaptiveStep(rtol), **options)
        r = history.positions("rod")
        apart = r[:, [0, -1]] - ref if problem == "D1" else r[:, -1, :2] - ref
        errors.append(np.sqrt((apart**2).sum(-1).mean()) / length)
    for rtol, error in zip((8e-2, 4e-2, 2e-2), errors, strict=True):
        validation.error(
            "step control: error below rtol", SPECTRAL, error, rtol, unit="L", variant=f"{problem}, {rtol:g}"
        )
    for a, b in pairwise(errors):
        assert 1.0 < a / b < 4.0


def test_slow_motion_is_quasi_static(say):
    """The hinge scene at 1 deg/s in time: forces, moments and torque of the equilibria to 1e-3 from 5 deg on."""
    scene = cf.load_scene(None)
    model = scene.model
    still = cf.solve_quasistatic(model, scene.times)
    moving = cf.solve_dynamic(model, 90.0, step=cf.AdaptiveStep(1e-3), times=scene.times)
    assert any("velocity jumps" in w and "t = 0 s" in w for w in model.warnings)
    worst = 0.0
    for support in ("fixed end", "moving end"):
        for part in (slice(0, 3), slice(3, 6)):
            a, b = still.reaction(support)[:, part], moving.reaction(support)[:, part]
            worst = max(worst, np.abs(a - b)[5:].max() / np.abs(a).max())
    torque = still.hinge_torque("panel")
    worst = max(worst, np.abs(moving.hinge_torque("panel") - torque)[5:].max() / np.abs(torque).max())
    say(f"largest difference {worst:.1e} of the peak; {moving.message}")
    assert worst < 1e-3
