"""Time stepping: kernels against NumPy, the compiled step against the general one, start, kinks, control, ledger, resume."""

from dataclasses import replace

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.iteration import newton
from cosserat_fem.kernels.inertia import inverse_tangent
from cosserat_fem.kernels.rotation import matrix_from_vector, relative_rotation
from cosserat_fem.motion.integrator import Run
from cosserat_fem.terms.inertial import Driven, InertiaStep, Rates

SOFT = cf.Section(
    force_stiffness=(400, 500, 1000), moment_stiffness=(0.1, 0.2, 0.08), mass_per_length=0.05,
    rotary_inertia=(2e-4, 1e-4, 3e-4),
)  # fmt: skip
NOBODY = Driven(np.empty(0, dtype=np.int64), np.empty((0, 2, 3)), np.empty((0, 2, 3)))


def smooth_turn(t):
    x = min(max(t, 0.0), 1.0)
    return x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)


def arm_model(terms=(), n_elements=4):
    """A rod on a turning arm."""
    rod = cf.Rod("rod", SOFT, [(0.1, 0, 0), (0.6, 0, 0)], n_elements=n_elements)
    arm = cf.Part("arm", motion=cf.Hinge((0, 0, 0), (0, 0, 1), smooth_turn))
    return cf.Model([rod], [cf.Clamp(rod, "start", to=arm)], [make(rod) for make in terms])


def free_model(n_elements=3, order=2, section=SOFT):
    rod = cf.Rod("rod", section, [(-0.3, 0, 0), (0.3, 0, 0)], n_elements=n_elements, order=order)
    return cf.Model([rod])


def tumbling(model):
    """A velocity of every node: rigid motion and bending."""
    state = model.initial_state()
    v = cf.RigidVelocity(v=(1, 2, 0.5), omega=(0.3, 0.5, 1.0)).at(state)
    s = model.space.node_s / model.space.lengths[0]
    v[:, 1] += 0.1 * np.sin(np.pi * s)
    v[:, 2] += 0.05 * np.cos(2 * np.pi * s)
    return v


# kernels


def random_step(model, seed=0):
    rng = np.random.default_rng(seed)
    n = model.space.n_nodes
    state = model.space.update(model.initial_state(), 0.1 * rng.normal(size=(n, 6)))
    rates = Rates(*(rng.normal(size=(3, n, 6))))
    step = InertiaStep(model.space, state, rates, np.array([0.05, 1 / 3, 4 / 9, 0.31, 0.61]), NOBODY, wanted=False)
    return step, model.space.update(state, 0.05 * rng.normal(size=(n, 6)))


def test_rates_and_force_against_numpy():
    model = free_model()
    step, state = random_step(model)
    h, am, af, beta, gamma = step.coefficients
    step.with_velocity(state)
    g = np.zeros((model.space.n_nodes, 6))
    largest = step.add(state, g, np.empty((0, 6, 6)))
    D = np.concatenate([state.r - step.start.r, relative_rotation(step.start.q, state.q)], axis=1)
    v0, a0, b0 = step.rates.v, step.rates.a, step.rates.b
    b = (D - h * v0 - h**2 * (0.5 - beta) * b0) / (beta * h**2)
    v = v0 + h * ((1 - gamma) * b0 + gamma * b)
    a = ((1 - am) * b + am * b0 - af * a0) / (1 - af)
    for found, wanted in ((step.D, D), (step.b, b), (step.v, v), (step.a, a)):
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-12)
    J = model.space.node_inertia
    force = model.space.node_mass[:, None] * a[:, :3]
    moment = J * a[:, 3:] + np.cross(v[:, 3:], J * v[:, 3:])
    np.testing.assert_allclose(g, np.concatenate([force, moment], axis=1), rtol=1e-12, atol=1e-12)
    assert largest == pytest.approx((np.abs(force).max(), np.abs(moment).max()))


def test_inertia_tangent_against_differences():
    """The tangent is the derivative plus half the cross product with the moment, as `terms.external` has it."""
    model = free_model()
    step, state = random_step(model, 1)
    n = model.space.n_nodes

    def force(at):
        g = np.zeros((n, 6))
        step.with_velocity(at)
        step.add(at, g, np.empty((0, 6, 6)))
        return g

    nodal, g = np.zeros((n, 6, 6)), np.zeros((n, 6))
    step.with_velocity(state)
    step.add(state, g, nodal)
    for j in range(6):
        du = np.zeros((n, 6))
        du[:, j] = 1e-6
        column = (force(model.space.update(state, du)) - force(model.space.update(state, -du))) / 2e-6
        if j >= 3:
            column[:, 3:] += 0.5 * np.cross(np.eye(3)[j - 3], g[:, 3:])
        np.testing.assert_allclose(nodal[:, :, j], column, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("size", [1e-8, 1e-3, 0.5, 3.0])
def test_inverse_tangent(size):
    """The increment of a rotation vector for a small further turn."""
    D = size * np.array([2, -1, 2]) / 3
    T = np.empty((3, 3))
    inverse_tangent.py_func(*D, T)
    e = 1e-6
    for j in range(3):
        turned = [matrix_from_vector(D) @ matrix_from_vector(s * e * np.eye(3)[j]) for s in (1, -1)]
        from cosserat_fem.kernels.rotation import quaternion_from_matrix

        one = quaternion_from_matrix(np.eye(3))[None]
        a, b = (relative_rotation(one, quaternion_from_matrix(R)[None])[0] for R in turned)
        np.testing.assert_allclose(T[:, j], (a - b) / (2 * e), atol=1e-8 + 1e-9 / size)


LOADS = [
    lambda rod: cf.Gravity((0, -9.81, 1)),
    lambda rod: cf.PointLoad(rod, "end", force=(0.1, 0, 0.2), moment=(0, 0.01, 0.02)),
    lambda rod: cf.LineLoad(rod, force=(0, 0.3, 0), follower=True),
    lambda rod: cf.LineLoad(rod, force=(0.2, 0.3, 0), components="normal"),
    lambda rod: cf.Damping(time=1e-3),
]


@pytest.mark.parametrize("terms", [LOADS[:0], LOADS[:1], LOADS[1:2], LOADS], ids=["none", "gravity", "point", "all"])
def test_compiled_step_is_the_general_one(terms, monkeypatch):
    model = arm_model(terms)
    assert newton.takes(model)

    def run():
        return cf.solve_dynamic(model, 0.2, step=cf.FixedStep(0.02))

    fast = run()
    monkeypatch.setattr(newton, "takes", lambda model: False)
    slow = run()
    assert abs(fast.counters.iterations - slow.counters.iterations) <= 2
    np.testing.assert_allclose(fast.positions("rod"), slow.positions("rod"), atol=1e-11)
    np.testing.assert_allclose(fast.velocities("rod"), slow.velocities("rod"), atol=1e-8)
    np.testing.assert_allclose(fast.reaction("rod.start@arm"), slow.reaction("rod.start@arm"), rtol=1e-6, atol=1e-7)
    for name, work in slow.ledger.items():
        np.testing.assert_allclose(fast.ledger[name], work, atol=1e-9)


# free flight


def test_free_flight_keeps_momentum(say):
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(500,) * 3, mass_per_length=1.0, rotary_inertia=(10, 10, 10)
    )
    rod = cf.Rod("rod", section, [(-5, 0, 0), (5, 0, 0)], n_elements=4, order=2)
    model = cf.Model([rod])
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        history = cf.solve_dynamic(
            model, 1.0, start="drawn", velocity=tumbling(model), rho_inf=1.0, step=cf.FixedStep(dt), times=[0, 0.5, 1]
        )
        linear, angular = history.momentum
        assert np.abs(linear - linear[0]).max() < 1e-12 * np.linalg.norm(linear[0])
        errors.append(np.abs(angular - angular[0]).max() / np.linalg.norm(angular[0]))
    say(f"angular momentum: {', '.join(f'{e:.1e}' for e in errors)}")
    assert errors[-1] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_error_estimate_leaves_the_step_alone():
    """Adaptive steps keep momentum as fixed ones do: the estimate is made beside the step."""
    model = free_model()
    history = cf.solve_dynamic(
        model, 0.2, start="drawn", velocity=tumbling(model), step=cf.AdaptiveStep(1e-2), times=[0, 0.2]
    )
    linear, _ = history.momentum
    assert np.abs(linear[1] - linear[0]).max() < 1e-13 * np.linalg.norm(linear[0])


def test_free_flight_energy():
    """Bounded without damping; with damping it never rises and its mean over windows falls."""
    model = free_model()
    for rho in (1.0, 0.8, 0.0):
        history = cf.solve_dynamic(
            model, 10.0, start="drawn", velocity=tumbling(model), rho_inf=rho, step=cf.FixedStep(2e-3),
            times=np.linspace(0, 10, 501),
        )  # fmt: skip
        energy = history.kinetic_energy + history.energy
        change = energy / energy[0] - 1
        if rho == 1.0:
            assert np.abs(change).max() < 1e-4
        else:
            assert change.max() < 1e-5
            assert (np.diff(change[1:].reshape(5, 100).mean(axis=1)) < 0).all()


@pytest.mark.slow
def test_energy_over_a_hundred_thousand_steps():
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(500,) * 3, mass_per_length=1.0, rotary_inertia=(10, 10, 10)
    )
    rod = cf.Rod("rod", section, [(-5, 0, 0), (5, 0, 0)], n_elements=4, order=2)
    model = cf.Model([rod])
    velocity = tumbling(model)
    for rho in (1.0, 0.8):
        history = cf.solve_dynamic(
            model, 1000.0, start="drawn", velocity=velocity, rho_inf=rho, step=cf.FixedStep(0.01),
            times=np.linspace(0, 1000, 5001),
        )  # fmt: skip
        change = (history.kinetic_energy + history.energy) / history.kinetic_energy[0] - 1
        if rho == 1.0:
            assert np.abs(change).max() < 1e-4
        else:
            assert change.max() < 1e-5
            assert (np.diff(change[1:].reshape(10, 500).mean(axis=1)) < 0).all()


def dzhanibekov(rate=20.0, flips=6):
    """Times of the flips of a stiff flat rod spun about its middle axis, and their period by the elliptic integral."""
    from scipy.special import ellipk

    section = cf.Section.rectangle(0.05, 0.005, youngs_modulus=2e11, density=7800, poisson_ratio=0.3)
    rod = cf.Rod("flat", section, [(-0.1, 0, 0), (0.1, 0, 0)], n_elements=2, normal=(0, 1, 0))
    model = cf.Model([rod])
    m, J, r = model.space.node_mass, model.space.node_inertia, model.initial_state().r
    # section axes: d1 = y, d2 = z, d3 = x
    I = np.array([J[:, 2].sum(), J[:, 0].sum() + m @ r[:, 0] ** 2, J[:, 1].sum() + m @ r[:, 0] ** 2])
    A, B, C = np.sort(I)
    axes = np.argsort(I)
    omega = np.zeros(3)
    omega[axes[1]], omega[axes[0]] = rate, 1e-2 * rate
    T2, L2 = I @ omega**2, (I * omega) @ (I * omega)  # twice the energy, square of the momentum
    if L2 > B * T2:
        modulus = (B - A) * (C * T2 - L2) / ((C - B) * (L2 - A * T2))
        period = 4 * np.sqrt(A * B * C / ((C - B) * (L2 - A * T2))) * ellipk(min(modulus, 1 / modulus))
    else:
        modulus = (C - B) * (L2 - A * T2) / ((B - A) * (C * T2 - L2))
        period = 4 * np.sqrt(A * B * C / ((B - A) * (C * T2 - L2))) * ellipk(modulus)
    velocity = cf.RigidVelocity(omega=omega)
    duration = flips * period / 2
    n = int(np.ceil(duration / 1e-3))
    history = cf.solve_dynamic(
        model, duration, start="drawn", velocity=velocity, rho_inf=0.9, step=cf.FixedStep(duration / n),
        times=np.linspace(0, duration, n + 1),
    )  # fmt: skip
    # the spin about the middle axis, seen in the body, changes its sign at each flip
    middle = history.velocities("flat")[:, 3, 3:] @ np.eye(3)[[2, 0, 1][axes[1]]]
    k = np.flatnonzero(middle[1:] * middle[:-1] < 0)
    t = history.t
    return t[k] - middle[k] * (t[k + 1] - t[k]) / (middle[k + 1] - middle[k]), period


def test_dzhanibekov(say):
    """A flat rod tumbling about its middle axis keeps the period of Euler's rigid body to 0.1 %."""
    times, period = dzhanibekov()
    found = 2 * np.diff(times).mean()
    say(f"period {found:.5f} s, elliptic integral {period:.5f} s")
    assert len(times) >= 5
    assert found == pytest.approx(period, rel=1e-3)


@pytest.mark.slow
def test_a_hundred_dzhanibekov_flips():
    times, period = dzhanibekov(flips=101)
    assert len(times) >= 100
    assert (times[-1] - times[0]) / (len(times) - 1) * 2 == pytest.approx(period, rel=1e-3)


# stiffness


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_stiff_pendulum(rho, dt):
    """EA L^2 / EI = 1e7, steps up to thousands of times the fastest vibration's time: no failure, energy bounded."""
    section = cf.Section(
        force_stiffness=(4e4, 4e4, 1e5), moment_stiffness=(1e-2, 1e-2, 8e-3), mass_per_length=0.1,
        rotary_inertia=(1e-8, 1e-8, 2e-8),
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=6)
    model = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, 0, -9.81))])
    history = cf.solve_dynamic(model, 20 * dt, start="drawn", rho_inf=rho, step=cf.FixedStep(dt))
    energy = history.kinetic_energy + history.energy - history.ledger["gravity"]
    assert np.abs(history.positions("rod")).max() < 1.01
    assert np.abs(energy).max() < 0.1 * 9.81


def test_step_far_too_large_is_rejected_and_recovered():
    model = arm_model(LOADS[:1])
    history = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.AdaptiveStep(1e-2, first=1.0))
    assert history.steps[0][3] is False
    assert history.t[-1] == pytest.approx(1.0)
    fine = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.FixedStep(1e-3), times=[1.0])
    np.testing.assert_allclose(history.positions("rod")[-1], fine.positions("rod")[-1], atol=5e-3)


# control


def test_adaptive_error_goes_with_rtol(say):
    """A driven clamp: the error stays below rtol, and each halving of rtol halves it within a factor of 2 on average."""
    model = arm_model()
    best = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.FixedStep(2.5e-4, richardson=True), times=[1.0])
    errors = []
    for rtol in (1e-2, 5e-3, 2.5e-3, 1.25e-3, 6.25e-4):
        history = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.AdaptiveStep(rtol), times=[1.0])
        errors.append(np.abs(history.positions("rod") - best.positions("rod")).max() / 0.5)
        assert errors[-1] < rtol
    say(f"rtol 1e-2 .. 6e-4: errors {', '.join(f'{e:.1e}' for e in errors)}")
    assert 1.0 < (errors[0] / errors[-1]) ** 0.25 < 4.0


def test_steps_end_at_kinks_and_output_times():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
    load = cf.PointLoad(rod, "end", force=([0, 0.137, 0.2511, 2], [(0, 0, 0), (0, 0.1, 0), (0, 0, 0), (0, 0, 0)]))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [load])
    history = cf.solve_dynamic(model, 0.4, step=cf.AdaptiveStep(1e-2), times=[0, 0.1, 0.33, 0.4])
    assert history.t.tolist() == [0, 0.1, 0.33, 0.4]
    ends = np.array([t for t, _, _, accepted in history.steps if accepted])
    for stop in (0.1, 0.137, 0.2511, 0.33, 0.4):
        assert np.abs(ends - stop).min() < 1e-12


def test_jump_of_a_load():
    """A force that jumps: the acceleration answers at once, the impulse is exact."""
    section = replace(SOFT, mass_per_length=2.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    values = [(0, 0, 0), (0, 0, 0), (3, 0, 0), (3, 0, 0), (0, 0, 0), (0, 0, 0)]
    load = cf.LineLoad(rod, force=([0, 0.1, 0.1, 0.3, 0.3, 1], values))
    history = cf.solve_dynamic(cf.Model([rod], [], [load]), 0.5, start="drawn", step=cf.FixedStep(0.01))
    speed = history.velocities("rod")[:, 0, 0]
    exact = 1.5 * np.clip(history.t - 0.1, 0, 0.2)
    np.testing.assert_allclose(speed, exact, atol=1e-9)


# start and driven ends


def test_driven_end_has_the_velocity_of_its_part():
    history = cf.solve_dynamic(arm_model(), 0.8, start="drawn", step=cf.FixedStep(0.02))
    angle = np.array([smooth_turn(t) for t in history.t])
    place = 0.1 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(history.positions("rod")[:, 0], place, atol=1e-12)
    rate = np.array([(smooth_turn(t + 1e-5) - smooth_turn(t - 1e-5)) / 2e-5 for t in history.t])
    np.testing.assert_allclose(np.linalg.norm(history.velocities("rod")[:, 0, :3], axis=1), 0.1 * rate, atol=1e-6)
    assert history.model.warnings == []
    assert history.ledger_gap < 0.01


def test_jump_in_velocity_is_told_and_accepted():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
    stage = cf.Part("stage", motion=cf.Slider((0, 1, 0), ([0, 0.2, 1], [0, 0, 0.4])))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=stage)])
    history = cf.solve_dynamic(model, 0.4, step=cf.FixedStep(0.005))
    told = model.warnings[0]
    assert "part 'stage': its velocity jumps by 0.5 m/s at t = 0.2 s" in told
    assert history.velocities("rod")[-1, 0, 1] == pytest.approx(0.5)


def test_jump_in_position_is_refused():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
    stage = cf.Part("stage", motion=cf.Slider((0, 1, 0), lambda t: 0.1 + t))
    with pytest.raises(cf.SceneError, match="0.1 m and 0 deg away from the rod at the start.*a jump in position"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "start", to=stage)]), 1.0, start="drawn")


def test_start_from_equilibrium_stays_there():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=4)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.Gravity((0, 0, -1.0))])
    history = cf.solve_dynamic(model, 1.0, step=cf.FixedStep(0.05))
    moved = np.abs(history.positions("rod") - history.positions("rod")[0]).max()
    assert np.abs(history.positions("rod")[0, -1, 2]) > 0.003
    assert moved < 1e-9


def test_first_acceleration_balances_at_joints_and_pins():
    """A welded frame released from rest: the residual with inertia vanishes wherever nothing is held."""
    a = cf.Rod("a", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    b = cf.Rod("b", SOFT, [(0.5, 0, 0), (0.5, 0.3, 0.2)], n_elements=2)
    model = cf.Model([a, b], [cf.Pin(a, "start"), cf.Weld(a, "end", b, "start")], [cf.Gravity((0, 0, -9.81))])
    run = Run(model, 0.0, 1.0, 0.8, cf.FixedStep(0.01), None, None)
    v = np.zeros((model.space.n_nodes, 6))
    run.begin(model.initial_state(), v, told=False)
    c = model.constraints
    rest = c.in_unknowns(run.state, run.g, c.evaluate(run.state, c.targets(0.0)))
    free = np.ones((model.space.n_nodes, 6), dtype=bool)
    free[c.support_node] = ~c.held[: c.n_supports]
    assert np.abs(rest[free]).max() < 1e-12
    assert run.reactions_now()[0, 2] != 0


# dampers


def axial_vibration(dt, damping):
    """First axial mode of a clamped rod: end displacement and its closed form."""
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(1,) * 3, mass_per_length=1.0, rotary_inertia=(1e-3, 1e-3, 2e-3)
    )
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [damping])
    state = model.initial_state()
    r = state.r.copy()
    r[:, 0] += 1e-3 * np.sin(np.pi / 2 * model.space.node_s)
    history = cf.solve_dynamic(
        model, 0.2, start=replace(state, r=r), rho_inf=1.0, step=cf.FixedStep(dt), times=np.linspace(0, 0.2, 21)
    )
    k = (np.pi / 2) ** 2
    strain = damping.strains[2] if damping.strains.any() else damping.time * 1e4
    zeta, omega = 0.5 * (strain * k + damping.mass), np.pi / 2 * 100
    damped = np.sqrt(omega**2 - zeta**2)
    t = history.t
    exact = np.exp(-zeta * t) * (np.cos(damped * t) + zeta / damped * np.sin(damped * t))
    return np.abs((history.positions("rod")[:, -1, 0] - 1) / 1e-3 - exact).max(), history


@pytest.mark.parametrize(
    ("damping", "name"),
    [
        (cf.Damping(strains=(0, 0, 5, 0, 0, 0)), "internal damping"),
        (cf.Damping(time=5e-4), "internal damping"),
        (cf.Damping(mass=10), "damping"),
    ],
)
def test_damped_vibration(damping, name):
    """Order 2 towards the closed form; what the damper takes closes the ledger."""
    errors = [axial_vibration(dt, damping)[0] for dt in (1e-3, 5e-4)]
    error, history = axial_vibration(2.5e-4, damping)
    assert error < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert history.ledger[name][-1] < -0.5 * history.ledger["strain"][0]
    assert history.ledger_gap < 1e-3


def test_internal_damping_of_a_coupled_section():
    """A full 6x6 with damping takes the path through the solved rest strain: same as the diagonal one if not coupled."""
    C = np.diag([400, 500, 1000, 0.1, 0.2, 0.08])
    C[2, 3] = C[3, 2] = 1e-9
    ends = []
    for section in (SOFT, cf.Section(coupled=C, mass_per_length=0.05, rotary_inertia=SOFT.rotary_inertia)):
        rod = cf.Rod("rod", section, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
        model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.Gravity((0, -9.81, 2)), cf.Damping(time=0.01)])
        history = cf.solve_dynamic(model, 0.3, start="drawn", step=cf.FixedStep(0.01), times=[0.3])
        ends.append(history.positions("rod")[-1, -1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


@pytest.mark.parametrize("quadratic", [False, True])
def test_falling_rod_reaches_its_closed_form_speed(quadratic):
    """A rod falling across itself in a medium at rest."""
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    m, g = 0.05, 9.81
    drag = cf.Drag(rod, **({"normal_quadratic": 0.2} if quadratic else {"normal": 0.1}))
    model = cf.Model([rod], [], [cf.Gravity((0, 0, -g)), drag])
    history = cf.solve_dynamic(model, 1.0, start="drawn", step=cf.FixedStep(0.005))
    t, speed = history.t, -history.velocities("rod")[:, 1, 2]
    if quadratic:
        limit = np.sqrt(m * g / 0.2)
        exact = limit * np.tanh(g * t / limit)
    else:
        exact = m * g / 0.1 * (1 - np.exp(-0.1 * t / m))
    np.testing.assert_allclose(speed, exact, atol=2e-4)
    assert history.ledger["drag"][-1] < 0
    assert history.ledger_gap < 1e-4


def test_medium_carries_a_rod_along():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.3, 0.4, 0)], n_elements=2)
    wind = (0.5, -0.2, 1.0)
    model = cf.Model([rod], [], [cf.Drag(rod, normal=1.0, tangential=0.5, medium=wind)])
    history = cf.solve_dynamic(model, 3.0, start="drawn", step=cf.FixedStep(0.02), times=[3.0])
    np.testing.assert_allclose(history.velocities("rod")[-1, :, :3] - wind, 0, atol=1e-6)


def test_drag_of_spin():
    """A straight rod spinning about itself slows down exponentially."""
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    model = cf.Model([rod], [], [cf.Drag(rod, spin_tangential=1e-3)])
    history = cf.solve_dynamic(
        model, 0.5, start="drawn", velocity=cf.RigidVelocity(omega=(4, 0, 0)), step=cf.FixedStep(0.005)
    )
    exact = 4 * np.exp(-1e-3 / 3e-4 * history.t)
    np.testing.assert_allclose(history.velocities("rod")[:, 2, 5], exact, atol=1e-3)


def test_drag_tangent_against_differences():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.3, 0.4, 0.1)], n_elements=2)
    drag = cf.Drag(rod, 0.3, 0.2, 0.7, 0.4, 0.1, 0.2, medium=(0.1, 0.2, -0.3))
    model = cf.Model([rod], [], [drag])
    n, slope, e = model.space.n_nodes, 37.0, 1e-6
    velocity = np.random.default_rng(0).normal(size=(n, 6))
    state = replace(model.initial_state(), velocity=velocity, slope=slope)
    K = drag(state, model.space).stiffness
    for j in range(6):
        du = np.zeros((n, 6))
        du[:, j] = e
        forces = []
        for sign in (1, -1):
            moved = model.space.update(state, sign * du)
            moved = replace(moved, velocity=velocity + sign * slope * du)
            forces.append(drag(moved, model.space, tangent=False).force[:, 0])
        np.testing.assert_allclose(K[:, :, j], (forces[0] - forces[1]) / (2 * e), rtol=1e-6, atol=1e-8)


def test_drag_of_a_fluid():
    rod = arm_model().rods[0]
    drag = cf.Drag.fluid(rod, density=1000.0, diameter=0.01)
    assert drag.normal_quadratic == pytest.approx(0.5 * 1000 * 0.01 * 1.2)


def test_dampers_are_nothing_in_statics():
    plain = cf.solve_static(arm_model(LOADS[:1]))
    damped = cf.solve_static(
        arm_model([LOADS[0], lambda rod: cf.Drag(rod, normal=5.0), lambda rod: cf.Damping(mass=3.0, time=1.0)])
    )
    np.testing.assert_array_equal(plain.positions("rod"), damped.positions("rod"))


def charged(distance, points=6, length=4.0, charge=1e-6):
    rods = [cf.Rod(name, SOFT, [(0, y, 0), (length, y, 0)], n_elements=40) for name, y in (("a", 0), ("b", distance))]
    force = cf.Electrostatic(*rods, charge, -charge, points=points)
    return cf.Model(rods, [cf.Clamp(r, s) for r in rods for s in ("start", "end")], [force]), force


def test_charged_rods():
    """Force per metre in the middle of two long parallel rods: lambda^2 / (2 pi eps0 d), opposite signs attract."""
    model, force = charged(0.1)
    g = model.external(model.initial_state(), tangent=False).g
    middle = model.space[model.rods[0]].nodes
    s = model.space[model.rods[0]].s
    pick = (s > 1.5) & (s < 2.5)
    weights = model.space.share(model.rods[0])[pick]
    exact = 1e-12 / (2 * np.pi * 8.8541878188e-12 * 0.1)
    # rods of finite length L: less by the ends, 1 - (d / L)^2 / ... near the middle
    assert (-g[middle[pick], 1] / weights).mean() == pytest.approx(exact, rel=2e-3)
    np.testing.assert_allclose(g.sum(axis=0), 0, atol=1e-15)
    finer, _ = charged(0.1, points=12)
    again = finer.external(finer.initial_state(), tangent=False).g
    np.testing.assert_allclose(g[middle, 1], again[middle, 1], rtol=1e-4, atol=1e-9)


def test_charged_rods_move_together():
    model, _ = charged(0.1, length=0.5)
    history = cf.solve_dynamic(model, 0.5, start="drawn", step=cf.FixedStep(0.01))
    gap = history.positions("b")[:, :, 1] - history.positions("a")[:, :, 1]
    assert gap[-1].min() < 0.09995
    linear, _ = history.momentum
    np.testing.assert_allclose(linear[:, 1], 0, atol=1e-9)  # clamped alike: equal and opposite


# extrapolation, ledger, resume


def test_richardson_is_of_higher_order():
    model = arm_model()
    best = cf.solve_dynamic(model, 0.5, start="drawn", step=cf.FixedStep(1e-3, richardson=True), times=[0.5])
    errors = {}
    for dt in (0.02, 0.01):
        for richardson in (False, True):
            history = cf.solve_dynamic(model, 0.5, start="drawn", step=cf.FixedStep(dt, richardson), times=[0.5])
            errors[dt, richardson] = np.abs(history.positions("rod") - best.positions("rod")).max()
    assert errors[0.02, True] < errors[0.02, False] / 5
    assert errors[0.02, True] / errors[0.01, True] > 5
    # positions of the finer run are off by a quarter of those of 0.01; rotations, in rad, by more
    assert errors[0.01, False] / 4 < history.extrapolated < errors[0.01, False]


def test_ledger_that_does_not_close_is_told():
    model = free_model()
    v = tumbling(model)
    v[:, 1] += 5 * np.cos(np.pi * model.space.node_s / 0.6 * 3)
    cf.solve_dynamic(model, 1.0, start="drawn", velocity=v, rho_inf=0.0, step=cf.FixedStep(0.05))
    assert "energy ledger: the integrator added or took" in model.warnings[0]


@pytest.mark.parametrize("step", [cf.FixedStep(0.01), cf.AdaptiveStep(1e-2)])
def test_resume_is_bit_for_bit(step):
    model = arm_model([*LOADS[:2], lambda rod: cf.Damping(time=1e-3, mass=0.1)])
    times = np.linspace(0, 0.4, 9)
    saved = []

    def callback(run):
        if len(run.history.records) == 5 and not saved:
            saved.append(run.checkpoint())

    whole = cf.solve_dynamic(model, 0.4, step=step, times=times, callback=callback)
    rest = cf.solve_dynamic(model, 0.4, step=step, times=times, resume=saved[0])
    assert rest.t.tolist() == whole.t[5:].tolist()
    np.testing.assert_array_equal(rest.positions("rod"), whole.positions("rod")[5:])
    np.testing.assert_array_equal(rest.velocities("rod"), whole.velocities("rod")[5:])
    np.testing.assert_array_equal(rest.reaction("rod.start@arm"), whole.reaction("rod.start@arm")[5:])
    assert rest.records[-1].work == whole.records[-1].work
    assert rest.steps == whole.steps


# bad input


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: cf.solve_dynamic(m, 0.0), "duration"),
        (lambda m: cf.solve_dynamic(m, 1.0, rho_inf=1.1), "from 0 to 1"),
        (lambda m: cf.solve_dynamic(m, 1.0, start="rest"), "'equilibrium', 'drawn' or a State"),
        (lambda m: cf.solve_dynamic(m, 1.0, velocity=np.zeros((2, 6))), "velocity"),
        (lambda m: cf.solve_dynamic(m, 1.0, times=[0.5, 0.2]), "times must increase"),
        (lambda m: cf.solve_dynamic(m, 1.0, times=[0.5, 2.0]), "within the run"),
        (lambda m: cf.AdaptiveStep(0.0), "rtol"),
        (lambda m: cf.FixedStep(-1.0), "dt"),
        (lambda m: cf.Damping(strains=(-1, 0, 0, 0, 0, 0)), "strains must be at least 0"),
        (lambda m: cf.Damping(mass=-1), "mass"),
        (lambda m: cf.Damping(strains=(1,) * 6, time=1), "not both"),
        (lambda m: cf.Drag(m.rods[0], normal=-1), "normal"),
        (lambda m: cf.Electrostatic(m.rods[0], m.rods[0], 1, 1), "two rods"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call(arm_model())


def test_no_mass_and_short_tables_are_refused():
    section = cf.Section.round(0.01, youngs_modulus=1e6)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(cf.SceneError, match="rod 'rod': has no mass"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "start")]), 1.0)
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (1, 0, 0)])
    stage = cf.Part("stage", motion=cf.Slider((0, 1, 0), ([0, 0.5], [0, 0.1])))
    with pytest.raises(cf.SceneError, match="the table runs from 0 s to 0.5 s, but the run asks for 1 s"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "start", to=stage)]), 1.0)


def test_kardan_angles_are_refused():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0, 1, 0)], normal=(1, 0, 0))
    with pytest.raises(cf.SceneError, match="needs rotation = 'quaternion'"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "start")], rotation="kardan"), 1.0)


def test_static_history_has_no_velocities():
    history = cf.solve_static(arm_model())
    with pytest.raises(ValueError, match="not a run in time"):
        _ = history.kinetic_energy


# what is easily lost in combinations


def moving_bar(dt):
    """A clamped, damped bar that starts with the velocity of its first axial mode; its end and the closed form."""
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(1,) * 3, mass_per_length=1.0, rotary_inertia=(1e-3, 1e-3, 2e-3)
    )
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.Damping(time=5e-4)])
    velocity = np.zeros((model.space.n_nodes, 6))
    velocity[:, 0] = 0.1 * np.sin(np.pi / 2 * model.space.node_s)
    history = cf.solve_dynamic(
        model,
        0.05,
        start="drawn",
        velocity=velocity,
        rho_inf=1.0,
        step=cf.FixedStep(dt),
        times=np.linspace(0, 0.05, 11),
    )
    omega = np.pi / 2 * 100
    zeta = 0.5 * 5e-4 * omega**2
    damped = np.sqrt(omega**2 - zeta**2)
    exact = 0.1 / damped * np.exp(-zeta * history.t) * np.sin(damped * history.t)
    return np.abs(history.positions("rod")[:, -1, 0] - 1 - exact).max(), history


def test_damping_acts_from_the_first_instant():
    """Order 2 and the reaction at t = 0 with a strain rate at the start: EA time dv/ds."""
    errors = [moving_bar(dt)[0] for dt in (5e-4, 2.5e-4)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    _, history = moving_bar(1e-4)
    assert history.reaction("rod.start@ground")[0, 0] == pytest.approx(-1e4 * 5e-4 * 0.1 * np.pi / 2, rel=1e-3)


def test_damping_in_proportion_to_a_coupled_stiffness():
    C = np.diag([400, 500, 1000, 0.1, 0.2, 0.08])
    C[2, 5] = C[5, 2] = 5.0
    rod = cf.Rod("rod", cf.Section(coupled=C, mass_per_length=0.05), [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.Damping(time=1e-3)])
    np.testing.assert_allclose(model.terms[0].coefficients(model.space, 0)[0, 0], 1e-3 * C)


@pytest.mark.parametrize("free", [("x",), ("rx",), ("x", "rz")])
def test_partly_held_end_has_the_velocity_of_its_part(free):
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
    stage = cf.Part("stage", motion=cf.Slider((0, 1, 0), 0.5))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=stage, free=free)])
    history = cf.solve_dynamic(model, 0.1, start="drawn", step=cf.FixedStep(0.005))
    np.testing.assert_allclose(history.velocities("rod")[:, 0, 1], 0.5, atol=1e-9)
    assert "velocity jumps by 0.5" in model.warnings[0]


@pytest.mark.parametrize(
    ("table", "options", "speed"),
    [
        (([0, 0.33, 0.33, 2], [0, 0, 1, 1]), {"duration": 0.99, "times": 0.03 * np.arange(34)}, 0.66),
        (([0, 1, 1, 2], [1, 1, 0, 0]), {"duration": 1.0}, 1.0),
        (([0, 1e4 + 0.3, 1e4 + 0.3, 2e4], [0, 0, 1, 1]), {"duration": 1.0, "start_time": 1e4}, 0.7),
    ],
    ids=["beside an output time", "at the end", "late"],
)
def test_jump_acts_from_its_time_on(table, options, speed):
    rod = cf.Rod("rod", replace(SOFT, mass_per_length=2.0), [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    load = cf.LineLoad(rod, force=(table[0], [(2 * f, 0, 0) for f in table[1]]))
    step = cf.FixedStep(0.03 if "times" in options else 0.1)
    history = cf.solve_dynamic(cf.Model([rod], [], [load]), start="drawn", step=step, **options)
    assert history.velocities("rod")[-1, 0, 0] == pytest.approx(speed, abs=1e-8)


def test_fast_turns_are_cut_into_steps():
    """A free rod spinning about itself at 50 rad/s with steps of 0.1 s: no step turns by more than 2 rad."""
    model = free_model()
    history = cf.solve_dynamic(
        model, 1.0, start="drawn", velocity=cf.RigidVelocity(omega=(50, 0, 0)), step=cf.FixedStep(0.1), times=[1.0]
    )
    assert all(accepted for *_, accepted in history.steps)
    np.testing.assert_allclose(history.velocities("rod")[-1, :, 5], 50, rtol=1e-9)


def test_largest_step_holds_from_the_start():
    history = cf.solve_dynamic(arm_model(), 0.05, start="drawn", step=cf.AdaptiveStep(1e-1, first=0.01, largest=1e-3))
    assert max(h for _, h, *_ in history.steps) <= 1e-3 * (1 + 1e-9)


def test_massless_end_is_refused():
    section = [(0, replace(SOFT, mass_per_length=0.0)), (0.5, SOFT)]
    rod = cf.Rod("rod", section, [(0, 0, 0), (0.5, 0, 0)], n_elements=3)
    with pytest.raises(cf.SceneError, match="has no mass at s = 0 m"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "end")]), 1.0)


def test_short_table_of_a_medium_is_told_before_the_run():
    rod = cf.Rod("rod", SOFT, [(0, 0, 0), (0.5, 0, 0)], n_elements=2)
    drag = cf.Drag(rod, normal=1.0, medium=([0, 0.1], [(0, 0, 0), (1, 0, 0)]))
    with pytest.raises(cf.SceneError, match="drag: medium: the table runs from 0 s to 0.1 s"):
        cf.solve_dynamic(cf.Model([rod], [cf.Clamp(rod, "start")], [drag]), 1.0)


def test_function_without_a_value_ends_the_run_with_its_history():
    def fading(t):
        return (0, 0.01, 0) if t < 0.2 or t == 1.0 else (0, np.nan, 0)

    model = arm_model([lambda rod: cf.PointLoad(rod, "end", force=fading)])
    with pytest.raises(cf.ConvergenceError, match="must be finite") as caught:
        cf.solve_dynamic(model, 1.0, start="drawn", step=cf.FixedStep(0.05))
    assert len(caught.value.history) >= 3


def test_extrapolated_run_cannot_be_resumed_and_states_are_checked():
    model = arm_model()
    saved = []
    cf.solve_dynamic(
        model, 0.1, start="drawn", step=cf.FixedStep(0.02), callback=lambda run: saved.append(run.checkpoint())
    )
    with pytest.raises(ValueError, match="cannot be resumed"):
        cf.solve_dynamic(model, 0.1, step=cf.FixedStep(0.02, richardson=True), resume=saved[0])
    with pytest.raises(ValueError, match="must be a State of this model"):
        cf.solve_dynamic(model, 0.1, start=free_model().initial_state())
