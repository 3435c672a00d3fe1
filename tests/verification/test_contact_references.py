"""The references for contact agree with independent evaluations: other equations, other integrators, energy."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import fsolve, minimize
from verification import contact_references as cr


def test_capstan_numbers(say):
    """The exponent solves lambda (1 + mu eps lambda) = mu (1 - eps); thin limit exp(mu theta); one printed value."""
    for mu in (0.1, 0.3, 0.6):
        for a in (1e-3, 0.02, 0.3):
            eps, rate = a / (1 + a), cr.capstan_exponent(mu, a, 1.0)
            assert rate * (1 + mu * eps * rate) == pytest.approx(mu * (1 - eps), rel=1e-13)
    assert cr.capstan_ratio(0.3, np.pi, 0.0, 1.0) == pytest.approx(np.exp(0.3 * np.pi), rel=1e-14)
    assert cr.capstan_ratio(0.3, np.pi, 1e-9, 1.0) == pytest.approx(np.exp(0.3 * np.pi), rel=1e-8)
    ratio = cr.capstan_ratio(0.3, np.pi, 0.02, 1.0)
    say(f"mu 0.3, a/R 0.02, half a turn: {ratio:.6f}, thin {np.exp(0.3 * np.pi):.6f}")
    assert ratio == pytest.approx(2.51533, abs=5e-6)


def test_capstan_in_the_wrap(say):
    """Integrating T' = f (1 - a/r) and a f' = T/r - f/mu from any start at the inlet: the ratio is soon exp(lambda)."""
    mu, a, R = 0.3, 0.05, 1.0
    r = R + a

    def rates(s, y):
        return [y[1] * (1 - a / r), (y[0] / r - y[1] / mu) / a]

    places = r * np.array([0.3, 2.3])
    for f in (0.0, 3.0):
        found = solve_ivp(rates, (0, 3), [1.0, f], method="Radau", rtol=1e-11, atol=1e-13, t_eval=places).y
        error = found[0, 1] / found[0, 0] / cr.capstan_ratio(mu, 2.0, a, R) - 1
        say(f"friction {f} N/m at the inlet: error {error:.1e}")
        assert abs(error) < 1e-8


def stiff_wrap(mu, theta, a, R, EI, k, start=None, free=1.0):
    """Planar rod on a drum with a soft layer of stiffness k [N/m^2]: boundary value problem for the whole rod."""
    r, half, soft = R + a, theta / 2, 0.3 / k
    span = np.array([np.cos(half), np.sin(half)])

    def line_force(x, z):
        rho = np.hypot(x, z)
        gap = rho - r
        return x / rho, z / rho, k * (np.sqrt(gap**2 + soft**2) - gap) / 2

    def rates(s, y):
        x, z, angle, M, Nx, Nz = y
        ex, ez, p = line_force(x, z)
        Q = Nz * np.cos(angle) - Nx * np.sin(angle)
        turn = a * mu * p - Q
        force = -p * ex + mu * p * ez, -p * ez - mu * p * ex
        return np.array([np.cos(angle), np.sin(angle), M / EI, turn, *force])

    def ends(y0, y1):
        away = y0[0] * span[0] + y0[1] * span[1] + free
        return np.array([y0[3], y0[4] - span[0], y0[5] - span[1], away, y1[3], y1[4] * span[1] + y1[5] * span[0]])

    if start is None:
        s = np.linspace(0, 2 * free + r * theta, 400)
        phi = np.clip((s - free) / r, 0, theta)
        angle, lead, T = half - phi, s - free - r * phi, np.exp(mu * phi)
        x, z = lead * np.cos(angle) - r * np.sin(angle), lead * np.sin(angle) + r * np.cos(angle)
        y = np.array([x, z, angle, -EI / r * ((phi > 0) & (phi < theta)), T * np.cos(angle), T * np.sin(angle)])
    else:
        s, y = start.x, start.y
    found = solve_bvp(rates, ends, s, y, tol=1e-5, max_nodes=20_000)
    assert found.success
    s = np.linspace(0, s[-1], 50_001)
    x, z = found.sol(s)[:2]
    return found, np.hypot(*found.y[4:, -1]), np.trapezoid(mu * R * line_force(x, z)[2], s)


@pytest.mark.parametrize(("mu", "a", "EI"), [(0.5, 0.2, 0.01), (0.3, 0.1, 0.0025), (0.4, 0.02, 0.005)])
def test_stiff_capstan(say, mu, a, EI):
    """Ratio and torque against the whole rod on a soft drum; the error falls as the layer gets stiffer."""
    ref = cr.stiff_capstan(mu, 2.0, a, 1 - a, EI, 1.0)
    start, errors = None, []
    for k in 10.0 ** np.arange(1.5, 6.6):
        start, ratio, torque = stiff_wrap(mu, 2.0, a, 1 - a, EI, k, start)
        errors.append([ratio / ref.ratio - 1, torque / ref.torque - 1])
    thin = ref.ratio / np.exp(2 * mu) - 1
    inner = ref.ratio / cr.capstan_ratio(mu, 2.0, a, 1 - a) - 1
    say(f"errors {errors[-1][0]:.1e}, {errors[-1][1]:.1e}; from exp(mu theta) {thin:.1e}, from the wrap {inner:.1e}")
    assert abs(np.array(errors[-1])).max() < 1e-4
    assert abs(np.array(errors[-1])).max() < 0.6 * abs(np.array(errors[-2])).max()


def test_stiff_capstan_balances():
    """Thread limit; and the moment of the straight spans about the axis is the drum's torque."""
    ref = cr.stiff_capstan(0.3, np.pi, 0.02, 1.0, 1e-12, 1.0)
    assert ref.ratio == pytest.approx(cr.capstan_ratio(0.3, np.pi, 0.02, 1.0), rel=3e-5)
    EI, a, R, mu, T1 = 0.03, 0.1, 0.9, 0.4, 2.0
    ref = cr.stiff_capstan(mu, 2.5, a, R, EI, T1)
    assert ref.inlet_angle + ref.contact_angle + ref.outlet_angle == pytest.approx(2.5, rel=1e-12)
    after = ref.outlet_tension + mu * ref.point_force, -EI / (R + a) + a * mu * ref.point_force
    spans = cr.drum_torque(ref.inlet_tension, after[0], a, R, -EI / (R + a), after[1])
    assert ref.torque == pytest.approx(spans, rel=1e-12)
    arm = R + a + EI / (2 * (R + a) * T1)  # of the inlet span
    assert T1 * arm == pytest.approx((R + a) * ref.inlet_tension + EI / (R + a), rel=1e-12)


def test_band_brake():
    """Both torques are differences of the tensions times R + a, with the weight as slack and as tight end."""
    up, down = cr.band_brake_torques(3.0, 0.3, np.pi, 0.02, 1.0)
    ratio = cr.capstan_ratio(0.3, np.pi, 0.02, 1.0)
    assert up == pytest.approx(cr.drum_torque(3.0, 3.0 * ratio, 0.02, 1.0))
    assert down == pytest.approx(cr.drum_torque(3.0 / ratio, 3.0, 0.02, 1.0))


@pytest.mark.parametrize(("height", "pull"), [(1e-3, 0.0), (0.7, 0.0), (3.0, 0.0), (0.7, 2.0)])
def test_lifted_rod(say, height, pull):
    """Against shooting from touch-down; the work of the force is the gain in energy when nothing pulls sideways."""
    w, EI = 2.5, 0.8
    ref = cr.lifted_rod(height, w, EI, pull=pull)

    def rates(s, y, F, length):
        V = F - w * (length - s)
        return [np.cos(y[2]), np.sin(y[2]), y[3], (pull * np.sin(y[2]) - V * np.cos(y[2])) / EI]

    def shoot(p, **more):
        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14} | more
        return solve_ivp(lambda s, y: rates(s, y, *p), (0, p[1]), [0, 0, 0, 0], **tight)

    def misses(p):
        end = shoot(p).y[:, -1]
        return [end[1] / height - 1, end[3]]

    force, length = fsolve(misses, [ref.force * 1.0001, ref.length * 0.9999], xtol=1e-13)
    shape = shoot((force, length), t_eval=np.minimum(ref.s, length)).y
    off = abs(shape - [ref.x, ref.z, ref.angle, ref.curvature]).max(1)
    say(f"length {ref.length:.8f} ({ref.length / length - 1:.0e}), force {ref.force:.8f}, shape {off.max():.0e}")
    assert ref.length == pytest.approx(length, rel=1e-8)
    assert ref.force == pytest.approx(force, rel=1e-8)
    assert off.max() < 1e-7
    assert ref.reaction == pytest.approx(w * length - force, rel=1e-7)
    if height < 0.01:
        assert length == pytest.approx((24 * EI * height / w) ** 0.25, rel=1e-4)
    if pull == 0:

        def energy(h):
            found = cr.lifted_rod(h, w, EI, points=4001)
            density = EI * found.curvature**2 / 2 + w * found.z
            return np.trapezoid(density, found.s)

        step = 1e-2 * height
        assert (energy(height + step) - energy(height - step)) / (2 * step) == pytest.approx(ref.force, rel=1e-3)


@pytest.mark.parametrize("shortening", [1e-6, 0.05, 0.5, 2.0])
def test_ruck(say, shortening):
    """Against shooting from lift-off; compression is the derivative of the energy; the closed form for small slope."""
    w, EI = 2.5, 0.8
    ref = cr.ruck(shortening, w, EI)

    def shoot(length, N, **more):
        def rates(s, y):
            V = w * (s - length / 2)
            return [np.cos(y[2]), np.sin(y[2]), y[3], (-N * np.sin(y[2]) - V * np.cos(y[2])) / EI]

        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14} | more
        return solve_ivp(rates, (0, length / 2), [0, 0, 0, 0], **tight)

    def misses(p):
        x, _, angle, _ = shoot(*p).y[:, -1]
        return [(p[0] - 2 * x) / shortening - 1, angle]

    length, N = fsolve(misses, [ref.length * 1.0001, ref.compression * 0.9999], xtol=1e-13)
    shape = shoot(length, N, t_eval=np.minimum(ref.s, length / 2)).y
    off = abs(shape - [ref.x, ref.z, ref.angle, ref.curvature]).max(1)
    say(f"length {length:.8f} ({ref.length / length - 1:.0e}), N {N:.8f}, height {ref.height:.6f}, {off.max():.0e}")
    assert ref.length == pytest.approx(length, rel=1e-7)
    assert ref.compression == pytest.approx(N, rel=1e-7)
    assert off.max() < 1e-6
    assert ref.height == pytest.approx(shape[1, -1], rel=1e-7)
    assert ref.reaction == pytest.approx(w * length / 2, rel=1e-7)
    if shortening < 1e-5:
        assert cr.shallow_ruck(shortening, w, EI) == pytest.approx((length, N, ref.height), rel=1e-3)
        assert N * length**2 / EI == pytest.approx(80.76, abs=0.01)

    def energy(shortening):
        found = cr.ruck(shortening, w, EI, points=4001)
        return 2 * np.trapezoid(EI * found.curvature**2 / 2 + w * found.z, found.s)

    step = 1e-2 * shortening
    assert (energy(shortening + step) - energy(shortening - step)) / (2 * step) == pytest.approx(N, rel=1e-3)


@pytest.mark.parametrize(
    ("height", "length", "EA"), [(1e-4, 1.0, 1e4), (0.01, 1.0, 1e4), (0.05, 1.0, 1e4), (0.065, 1.01, np.inf)]
)
def test_crossed_rod(say, height, length, EA):
    """Against shooting from the clamp; the force is the derivative of the energy; 192 EI h / L^3 for small lift."""
    EI = 0.7
    ref = cr.crossed_rod(height, 1.0, length, EI, EA=EA * EI)

    def rates(s, y, P, H):
        c, z = np.cos(y[2]), np.sin(y[2])
        stretch = 1 + (H * c + P / 2 * z) / (EA * EI)
        return [stretch * c, stretch * z, y[3], stretch * (H * z - P / 2 * c) / EI]

    def shoot(p, **more):
        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14} | more
        return solve_ivp(lambda s, y: rates(s, y, *p[:2]), (0, length / 2), [0, 0, 0, p[2]], **tight)

    def misses(p):
        x, z, angle, _ = shoot(p).y[:, -1]
        return [x - 0.5, z / height - 1, angle]

    force, pull, bend = fsolve(misses, [ref.force, ref.horizontal, ref.curvature[0]], xtol=1e-13)
    shape = shoot((force, pull, bend), t_eval=ref.s).y
    off = abs(shape - [ref.x, ref.z, ref.angle, ref.curvature]).max(1)
    say(f"force {ref.force:.8f} ({ref.force / force - 1:.0e}), pull {pull:.6f}, shape {off.max():.0e}")
    assert ref.force == pytest.approx(force, rel=1e-6)
    assert ref.horizontal == pytest.approx(pull, rel=1e-6, abs=1e-6)
    assert off.max() < 1e-6
    if height < 1e-3:
        assert ref.force == pytest.approx(192 * EI * height, rel=1e-4)

    def energy(h):
        found = cr.crossed_rod(h, 1.0, length, EI, EA=EA * EI, points=2001)
        n = found.horizontal * np.cos(found.angle) + found.force / 2 * np.sin(found.angle)
        return 2 * np.trapezoid(EI * found.curvature**2 / 2 + n**2 / (2 * EA * EI), found.s)

    step = 1e-3 * height
    assert (energy(height + step) - energy(height - step)) / (2 * step) == pytest.approx(ref.force, rel=1e-3)


def test_crossed_pair():
    """Equal rods share the lift; a stiffer one takes less; a rod that stands higher by itself is refused."""
    rod = {"span": 1.0, "length": 1.0, "EI": 1.0, "EA": 1e4}
    first, second, force = cr.crossed_pair(0.02, rod, rod)
    assert first == pytest.approx(0.01, rel=1e-9)
    assert force == pytest.approx(cr.crossed_rod(0.01, **rod).force, rel=1e-8)
    first, second, force = cr.crossed_pair(0.02, rod, rod | {"EI": 4.0})
    assert second < first
    assert force == pytest.approx(cr.crossed_rod(second, **rod | {"EI": 4.0}).force, rel=1e-6)
    with pytest.raises(ValueError, match="by itself"):
        cr.crossed_rod(0.05, 1.0, 1.01, 1.0)


@pytest.mark.parametrize("tension", [-30.0, 0.0, 10.0, 300.0])
def test_greenhill(say, tension):
    """Integrating the fourth-order equation from a clamp: at the critical torque a clamped end can be met, first."""
    torque = cr.greenhill(tension)

    def worst(m):
        def rates(x, y):
            return [y[1], y[2], y[3], 1j * m * y[3] + tension * y[2]]

        starts = np.eye(4, dtype=complex)[2:]
        ends = [solve_ivp(rates, (0, 1), y0, method="DOP853", rtol=1e-12, atol=1e-14).y[:2, -1] for y0 in starts]
        return np.linalg.svd(np.array(ends), compute_uv=False)[-1]

    below = [worst(m) for m in np.linspace(0.02, 0.98, 13) * torque]
    say(f"T L^2/EI = {tension}: M L/EI = {torque:.6f} = {torque / np.pi:.6f} pi, remainder {worst(torque):.0e}")
    assert worst(torque) < 1e-9
    assert min(below) > 1e3 * worst(torque)


def test_greenhill_numbers():
    """Two printed values, the long rod, and the Euler load without torque."""
    assert cr.greenhill(0.0) / np.pi == pytest.approx(2.8606, abs=5e-5)
    assert cr.greenhill(10.0) / np.pi == pytest.approx(3.3196, abs=5e-5)
    assert cr.greenhill(1e4) == pytest.approx(2 * np.sqrt(1e4), rel=1e-3)
    assert cr.greenhill(-4 * np.pi**2 + 1e-4) < 0.02


@pytest.mark.parametrize("force", [0.7, 1.0, 5.0])
def test_mandrel(say, force):
    """Integrating the elastica from lift-off ends with no moment at the tip; the reactions carry both loads."""
    ref = cr.mandrel(force, 2.0, 1.0, 1.0)
    phi = ref.lift_off_angle

    def rates(s, y):
        return [np.cos(y[2]), -np.sin(y[2]), y[3], -force * np.cos(y[2])]

    start = [np.sin(phi), np.cos(phi), phi, 1.0]
    end = solve_ivp(rates, (0, 2.0 - phi), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    say(f"F = {force}: lift-off {phi:.6f}, point force {ref.point_force:.6f}, pressure {ref.line_pressure:.6f}")
    np.testing.assert_allclose(end, [*ref.tip, ref.tip_angle, 0], atol=1e-9)
    lift = 2 * ref.point_force * np.cos(phi) + 2 * ref.line_pressure * np.sin(phi)
    assert lift == pytest.approx(2 * force, rel=1e-12)
    with pytest.raises(ValueError, match="one point"):
        cr.mandrel(0.4, 2.0, 1.0, 1.0)


def test_hysteresis():
    """A spring and a block moved in small steps lose the closed form's work in the second cycle."""
    limit, k, X = 1.3, 7.0, 0.5
    path = X * np.sin(np.linspace(0, 4 * np.pi, 40_001))
    force, work = 0.0, 0.0
    for step, dx in enumerate(np.diff(path)):
        last, force = force, min(limit, max(-limit, force + k * dx))
        work += (last + force) / 2 * dx * (step >= 20_000)
    assert work == pytest.approx(cr.hysteresis_area(limit, k, X), rel=1e-4)
    assert cr.hysteresis_area(limit, k, 0.1) == 0
    assert cr.slope_acceleration(0.5, np.arctan(0.5) - 1e-9, 9.81) == 0
    assert cr.slope_acceleration(0.5, np.arctan(1.0), 9.81) == pytest.approx(9.81 * 0.25 * np.sqrt(2))


def test_stick_slip():
    """Integrating the slip from its start until the block has the belt's speed again."""
    m, k, v, static, kinetic = 2.0, 50.0, 0.3, 9.0, 6.0
    ref = cr.stick_slip(m, k, v, static, kinetic)

    def caught(t, y):
        return y[1] - v if t > 1e-3 else -1.0

    caught.terminal, caught.direction = True, 1
    found = solve_ivp(
        lambda t, y: [y[1], (kinetic - k * y[0]) / m],
        (0, 10),
        [static / k, v],
        events=caught,
        rtol=1e-11,
        atol=1e-13,
        max_step=1e-2,
        dense_output=True,
    )
    place = found.sol(np.linspace(0, found.t[-1], 20_001))[0]
    assert found.t[-1] == pytest.approx(ref.slip_time, rel=1e-8)
    assert (static / k - place[-1]) / v == pytest.approx(ref.stick_time, rel=1e-8)
    assert [place.max(), place.min()] == pytest.approx([ref.highest, ref.lowest], rel=1e-6)


def test_knot_braid_is_of_least_energy(say):
    """Found anew by making energy least among shapes out of each other's way, from a plain helix.

    Energy E of one half: the integral of U''^2 / 2 less the first component of U' at its far end X = L, plus L / 2. With
    strands of radius rho it is rho^(1/2) E, and it changes with rho by the sum of the contact forces: that sum is E / 2.
    """
    n, L = 70, 4.0
    h = L / n
    D = (
        np.eye(n, n + 2) - 2 * np.eye(n, n + 2, 1) + np.eye(n, n + 2, 2)
    ) / h**2  # of nodes -1 .. n, bent up to L - h / 2
    weight = np.full(n, h)
    weight[0] *= 0.5
    odd = np.eye(n + 2, n + 1, -1)  # nodes -1 .. n from nodes 0 .. n
    even = odd.copy()
    odd[0, 1], even[0, 1] = -1, 1
    K1, K2 = ((D @ m).T @ (weight[:, None] * (D @ m)) for m in (odd, even))
    pull = np.zeros(n + 1)
    pull[-2:] = -1 / h, 1 / h

    def energy(v):
        x, y = v.reshape(2, -1)
        value = 0.5 * x @ K1 @ x + 0.5 * y @ K2 @ y - pull @ x + 0.5 * (L - 0.5 * h)
        return value, np.concatenate([K1 @ x - pull, K2 @ y])

    def room(v):
        return (v.reshape(2, -1) ** 2).sum(0) - 1

    def room_slope(v):
        return np.hstack([np.diag(2 * a) for a in v.reshape(2, -1)])

    X = np.linspace(0, L, n + 1)
    angle = np.pi / 2 + 1.5 * np.pi * X / L
    start = (1.1 + 0.5 * np.maximum(X - 2.5, 0) ** 2) * np.array([np.cos(angle), np.sin(angle)])
    constraints = [
        {"type": "ineq", "fun": room, "jac": room_slope},
        {"type": "eq", "fun": lambda v: v[:1], "jac": lambda v: np.eye(1, len(v))},
    ]
    found = minimize(
        energy,
        start.ravel(),
        jac=True,
        method="SLSQP",
        constraints=constraints,
        options={"maxiter": 400, "ftol": 1e-10},
    )
    assert found.success
    sigma, braid = 0.5 * found.fun / np.sqrt(2), cr.knot_braid()
    say(f"sigma {braid.friction:.5f}, by least energy {sigma:.5f}; {found.nit} iterations")
    assert sigma == pytest.approx(braid.friction, rel=0.01)
    assert braid.friction == pytest.approx(0.492, abs=5e-4)
    assert min(braid.forces) > 0
