"""Closed forms and boundary value problems for contact and friction of rods. Numpy and scipy only.

Convention for rods on a drum of radius R [m] under a round rod of radius a [m]: r = R + a is the radius of the
centreline, s its arc length, t its tangent, e the outward normal, k = t x e. The rod turns towards the drum,
dt/ds = -e/r, de/ds = t/r. Internal force T t + Q e and moment M k act on the part before s; bending gives M = EI kappa
with kappa = -1/r on the drum. The drum pushes with p e and rubs with -f t at the place -a e of its surface.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_bvp, solve_ivp
from scipy.optimize import brentq, root
from scipy.special import spherical_jn


def capstan_exponent(mu, a, R):
    """Exponent lambda [-] of a rod that slips on a drum, friction acting at its surface: T ~ exp(lambda * angle).

    Balance of force and moment per length with the convention above:
        along t:  T' + Q/r - f = 0,    along e:  Q' - T/r + p = 0,    about k:  M' + Q - a f = 0.
    (The couple of friction is (-a e) x (-f t) = a f e x t = -a f k.) On the drum kappa is constant, so M' = 0 and
    Q = a f whatever EI and the rest curvature are. With f = mu p and all of T, Q, p, f ~ exp(lambda s / r),
    eps = a/r:  lambda T = r f (1 - eps)  and  f/mu = T/r - eps lambda f, hence
        mu eps lambda^2 + lambda - mu (1 - eps) = 0.
    The positive root is returned. The negative one, near -1/(mu eps), dies out within mu a of arc length after the
    inlet; see `stiff_capstan`.
    """
    return _exponents(mu, a, R)[0]


def capstan_ratio(mu, theta, a, R):
    """Ratio T2/T1 [-] of the tensions at two places of a slipping wrap, ``theta`` [rad] apart.

    Both are read inside the wrap, more than about 3 mu a from the inlet. For a thread (EI -> 0) it is also the ratio
    of the forces in the free spans, theta then being the angle between them, up to order mu^2 eps^2: at the inlet
    Q = 0 and not a f, which costs a factor 1 - mu^2 eps, and at the outlet the force a f makes the thread leave at
    mu eps above the tangent, so that it touches over theta + mu eps.
    """
    return float(np.exp(capstan_exponent(mu, a, R) * theta))


def _exponents(mu, a, R):
    eps = a / (R + a)
    if a == 0 or mu == 0:
        return mu, -np.inf
    root = np.sqrt(1 + 4 * mu**2 * eps * (1 - eps))
    return 2 * mu * (1 - eps) / (1 + root), -(1 + root) / (2 * mu * eps)


class StiffCapstan(NamedTuple):
    """What `stiff_capstan` finds."""

    ratio: float  # [-] T2/T1, forces in the straight spans
    contact_angle: float  # [rad] turned on the drum
    inlet_angle: float  # [rad] turned before it touches
    outlet_angle: float  # [rad] turned after it has left; negative if it bends back
    point_force: float  # [N] concentrated reaction at the outlet
    inlet_pressure: float  # [N/m] line pressure where it first touches
    inlet_tension: float  # [N] T just inside the inlet
    outlet_tension: float  # [N] T just inside the outlet
    torque: float  # [N m] of the friction on the drum, about its axis


def stiff_capstan(mu, theta, a, R, EI, T1):
    """Rod with bending stiffness EI [N m^2] that slips over a drum; ``theta`` [rad] between its straight far spans.

    ``T1`` [N] pulls at the inlet span, the outlet force T2 follows; no weight, no stretch, no shear; a > 0.

    Free spans are elastica that become straight. With the force N along the span and delta the angle from there to
    the tangent, M^2 / (2 EI) = N (1 - cos delta), T = N cos delta, and Q = M sqrt(..) has the sign of -M before and
    of M after the drum.
    Inlet: a concentrated reaction P would add the couple a mu P and so bend the free rod more than the drum, into
    it. There is none: M = -EI/r, 1 - cos delta_1 = EI / (2 r^2 T1), and T, Q are continuous.
    On the drum: Q = a f as in `capstan_exponent`, dT/dphi = r f (1 - eps), and both exponentials take part,
    T = A exp(l1 phi) + B exp(l2 phi), fixed by T and f = Q/a at the inlet.
    Outlet: Q = a f > 0 inside but Q < a f outside, so a reaction P acts, with friction mu P and couple a mu P:
    T_out = T + mu P, Q_out = a f - P, M_out = -EI/r + a mu P, and M_out^2 / (2 EI) = |N_2| - T_out gives P.
    For a -> 0 the fast exponential becomes the point force known for stiff threads. With b = sqrt(EI/T1)/r the ratio
    is below `capstan_ratio` by 0.03 % at b = 0.03 and 0.3 % at b = 0.1 (mu = 0.3, half a turn, a/R = 0.02).
    """
    r = R + a
    eps = a / r
    fast, slow = _exponents(mu, a, R)[::-1]
    inlet = 2 * np.arcsin(np.sqrt(EI / (4 * r**2 * T1)))
    start, shear = T1 * np.cos(inlet), T1 * np.sin(inlet)
    slope = r * (1 - eps) * shear / a
    A = (slope - fast * start) / (slow - fast)
    B = start - A

    def outlet(phi):
        parts = A * np.exp(slow * phi), B * np.exp(fast * phi)
        T, f = sum(parts), (slow * parts[0] + fast * parts[1]) / (r * (1 - eps))

        def miss(P):
            M, t, q = -EI / r + a * mu * P, T + mu * P, a * f - P
            # Two forms of one statement: q and M have one sign, and M^2 / (2 EI) = |N| - t = q^2 / (|N| + t).
            return M - q * np.sqrt(2 * EI / (np.hypot(t, q) + t))

        P = brentq(miss, 0, a * f + 2 * np.sqrt(EI * T) / r, xtol=1e-15 * T)
        return T, P, T + mu * P, a * f - P

    def turned(phi):
        T, P, t, q = outlet(phi)
        return inlet + phi - np.arctan2(q, t)

    phi = brentq(lambda phi: turned(phi) - theta, 1e-9, theta + 1, xtol=1e-14)
    T, P, t, q = outlet(phi)
    return StiffCapstan(
        ratio=float(np.hypot(t, q) / T1),
        contact_angle=phi,
        inlet_angle=float(inlet),
        outlet_angle=float(-np.arctan2(q, t)),
        point_force=P,
        inlet_pressure=float(shear / (a * mu)),
        inlet_tension=float(start),
        outlet_tension=float(T),
        torque=float(drum_torque(start, T, a, R) + mu * P * R),
    )


def drum_torque(T1, T2, a, R, M1=0.0, M2=0.0):
    """Torque [N m] that the contact between two cross-sections exerts on the drum, about the drum's axis.

    T1, T2 : tangential internal forces [N]; M1, M2 : internal moments about k [N m], -EI/r on the drum.
    Moments about the axis on the rod between the cuts, places r e: r e x (T t + Q e) = -r T k, so
        -r T2 + M2 + r T1 - M1 + (moment by the drum) = 0.
    The drum's is (R e) x (-f t) = R f k per length, and the torque on the drum is its opposite, counted in the
    direction in which the rod slips:  R * integral of f ds = (R + a) (T2 - T1) - (M2 - M1).
    The lever is R + a and not R: the couple a f of friction is in it (T' = f R / r inside the wrap). On one drum
    M2 = M1. For forces N in straight spans the lever is the distance of their line from the axis; a stiff rod comes
    in at r + EI / (2 r N1).
    """
    return (R + a) * (T2 - T1) - (M2 - M1)


def band_brake_torques(weight, mu, theta, a, R):
    """Torques [N m] on a drum that slips both ways under a rod with a weight [N] at one end, the other end fixed.

    The fixed end is the tight one if the drum lifts the weight's side, and the slack one if it turns back. One cycle
    of slip angle Theta each way dissipates (sum of both) * Theta.
    """
    ratio = capstan_ratio(mu, theta, a, R)
    return (R + a) * weight * (ratio - 1), (R + a) * weight * (1 - 1 / ratio)


class Lifted(NamedTuple):
    """What `lifted_rod` finds. Shape from touch-down (s = 0) to the lifted end."""

    length: float  # [m] arc length off the plane
    force: float  # [N] upward at the lifted end
    reaction: float  # [N] concentrated reaction of the plane at touch-down
    s: np.ndarray  # [m]
    x: np.ndarray  # [m] from touch-down
    z: np.ndarray  # [m]
    angle: np.ndarray  # [rad]
    curvature: np.ndarray  # [1/m]


def lifted_rod(height, weight, EI, *, pull=0.0, points=201):
    """Long heavy rod on the plane z = 0, one end held at ``height`` [m] without moment; no stretch, no shear.

    weight [N/m], EI [N m^2], pull [N]: horizontal force at the end, away from the rod, borne by the part that lies.
    Off the plane  x' = cos th, z' = sin th, th' = kappa, EI kappa' = H sin th - V cos th,
    V(s) = F - w (l - s) the vertical force on the part before s. Touch-down: z = th = 0, and kappa = 0 because the part
    that lies has no moment and a smooth frictionless plane gives no couple; V jumps there from 0 to F - w l < 0, a
    concentrated reaction w l - F. End: z = h, kappa = 0. Unknown l and F. For small h: l^4 = 24 EI h / w, F = w l / 2.
    Solved in the unit (EI/w)^(1/3).
    """
    unit = (EI / weight) ** (1 / 3)
    h, H = height / unit, pull / (weight * unit)

    def equations(u, y, p):
        length, F = p
        V = F - length * (1 - u)
        th = y[2]
        return length * np.array([np.cos(th), np.sin(th), y[3], H * np.sin(th) - V * np.cos(th)])

    def ends(target):
        return lambda y0, y1, p: np.array([*y0, y1[1] - target, y1[3]])

    u = np.linspace(0, 1, 101)
    target = min(h, 0.1)
    length = (24 * target) ** 0.25
    y = np.array([length * u, u**3 * (2 - u) * target, length**3 * (u**2 / 4 - u**3 / 6), length**2 * (u - u**2) / 2])
    p = [length, length / 2]
    while target < h:
        found = _bvp(equations, ends(target), u, y, p, tol=1e-4)
        y, p = found.sol(u), found.p
        target = min(h, 1.5 * target)
    found = _bvp(equations, ends(h), u, y, p)
    length, F = found.p
    u = np.linspace(0, 1, points)
    x, z, th, kappa = found.sol(u)
    w = weight * unit
    return Lifted(length * unit, F * w, (length - F) * w, u * length * unit, x * unit, z * unit, th, kappa / unit)


class Ruck(NamedTuple):
    """What `ruck` finds. Shape of one half, from lift-off (s = 0) to the middle."""

    length: float  # [m] arc length off the plane, of both halves
    compression: float  # [N] in the parts that lie
    height: float  # [m] of the middle
    reaction: float  # [N] concentrated reaction of the plane at each lift-off
    s: np.ndarray  # [m]
    x: np.ndarray  # [m] from lift-off
    z: np.ndarray  # [m]
    angle: np.ndarray  # [rad]
    curvature: np.ndarray  # [1/m]


def shallow_ruck(shortening, weight, EI):
    """Ruck of small slope: (length [m], compression [N], height [m]). Arguments as for `ruck`.

    EI z'''' + N z'' = -w, and z = z' = z'' = 0 at both ends of the length l (no step, no kink, no moment: see `ruck`). Even
    about the middle x = 0, with k^2 = N / EI:
        z = A cos kx - w x^2 / 2N + C,
        z'' = 0:  -A k^2 cos u = w/N,   z' = 0:  -A k sin u = w l / 2N,   u = k l / 2.
    Their quotient is tan u = u, u = 4.493409: N l^2 / EI = 4 u^2 = 80.76, whatever the weight and the height. With
    sin u = u cos u the shortening, half the integral of z'^2 over the length, is
        (w/N)^2 / 2k^3 * integral of (t - sin t / cos u)^2 dt from -u to u = (w/N)^2 / 2k^3 * 5 u^3 / 3 = 5 w^2 l^3 / 48 N^2,
    which gives l^7 = 768 u^4 EI^2 shortening / 5 w^2; and the height is z(0) - z(l/2) = A (1 - cos u) + w l^2 / 8N.
    """
    u = brentq(lambda u: np.sin(u) - u * np.cos(u), np.pi, 1.5 * np.pi, xtol=1e-15)
    length = (768 * u**4 * EI**2 * shortening / (5 * weight**2)) ** (1 / 7)
    N = 4 * u**2 * EI / length**2
    A = -weight * EI / (N**2 * np.cos(u))
    return length, N, A * (1 - np.cos(u)) + weight * length**2 / (8 * N)


def ruck(shortening, weight, EI, *, points=201):
    """Ruck of a long heavy rod on the plane z = 0 whose ends are ``shortening`` [m] nearer than the rod is long.

    weight [N/m], EI [N m^2]; no stretch, no shear, no self contact. The parts that lie carry the compression N and no
    moment. Off the plane, s from lift-off, th the slope, as in `lifted_rod` with -N in the place of the pull:
        x' = cos th,  z' = sin th,  th' = kappa,  EI kappa' = -N sin th - V cos th,  V = -w (l/2 - s);
    V, the vertical force on the part before s, vanishes in the middle by symmetry. At lift-off z = th = 0 and
    kappa = 0: a smooth plane gives no couple, so the moment is that of the part that lies, none. V jumps there to -w l/2,
    a concentrated reaction of half the weight that is off the plane. In the middle th = 0 and x = l/2 - shortening/2.
    Unknown l and N. A heavy rod that lies straight is stable under any N: a ruck is not its buckling, it is made.
    Solved in the unit (EI/w)^(1/3), from `shallow_ruck` on.
    """
    unit = (EI / weight) ** (1 / 3)

    def equations(u, y, p):
        half, N = p
        V = -half * (1 - u)
        th = y[2]
        return half * np.array([np.cos(th), np.sin(th), y[3], -N * np.sin(th) - V * np.cos(th)])

    def ends(target):
        return lambda y0, y1, p: np.array([*y0, y1[2], p[0] - y1[0] - target / 2])

    u, wanted = np.linspace(0, 1, 101), shortening / unit
    target = min(wanted, 0.01)
    length, N, _ = shallow_ruck(target, 1.0, 1.0)
    k, x = np.sqrt(N), (u - 1) * length / 2
    A = -1 / (N**2 * np.cos(k * length / 2))
    z = A * np.cos(k * x) - x**2 / (2 * N)
    y = np.array([x - x[0], z - z[0], -A * k * np.sin(k * x) - x / N, -A * k**2 * np.cos(k * x) - 1 / N])
    p = [length / 2, N]
    while target < wanted:
        found = _bvp(equations, ends(target), u, y, p, tol=1e-4)
        y, p = found.sol(u), found.p
        target = min(wanted, 2 * target)
    found = _bvp(equations, ends(wanted), u, y, p)
    half, N = found.p
    u = np.linspace(0, 1, points)
    x, z, th, kappa = found.sol(u)
    w = weight * unit
    return Ruck(2 * half * unit, N * w, z[-1] * unit, half * w, u * half * unit, x * unit, z * unit, th, kappa / unit)


class Crossed(NamedTuple):
    """What `crossed_rod` finds. Shape of half the rod, from the clamp (s = 0) to the crossing."""

    force: float  # [N] that lifts the middle
    horizontal: float  # [N] internal force along the span, tension positive
    s: np.ndarray  # [m] arc length of the unstretched rod
    x: np.ndarray  # [m]
    z: np.ndarray  # [m] above the clamps
    angle: np.ndarray  # [rad]
    curvature: np.ndarray  # [1/m] derivative of the angle by s; negative at the crossing


def crossed_rod(height, span, length, EI, *, EA=np.inf, points=201):
    """Rod clamped level at (0, 0) and (span, 0) whose middle is lifted to ``height`` [m] by a point force.

    This is a rope over a thin cylinder at a right angle without friction: by symmetry the middle is level, the contact
    is a point straight above the axis, and the centreline there is a1 + a2 over it. The contact stays a point while
    |curvature| (a1 + a2) < 1. Half the rod, s from 0 to length/2 [m], force P, EI [N m^2], EA [N], no shear:
        x' = (1 + n/EA) cos th,  z' = (1 + n/EA) sin th,  EI th'' = (1 + n/EA) (H sin th - V cos th),
        n = H cos th + V sin th,  V = P/2,
        x = z = th = 0 at s = 0;  x = span/2, z = height, th = 0 at s = length/2;  unknown H and V.
    Small height and EA: P = 192 EI h / span^3. With EA = inf the length must exceed the span, and the height
    that at which the rod stands by itself, where P = 0.
    """
    half, stiff = length / 2, EA * (length / 2) ** 2 / EI

    def equations(u, y, p):
        H, V = p
        c, s = np.cos(y[2]), np.sin(y[2])
        stretch = 1 + (H * c + V * s) / stiff
        return np.array([stretch * c, stretch * s, y[3], stretch * (H * s - V * c)])

    def ends(height, span):
        return lambda y0, y1, p: np.array([*y0[:3], y1[0] - span, y1[1] - height, y1[2]])

    u = np.linspace(0, 1, 101)
    h, b = height / half, span / 2 / half
    y = np.array([b * u, h * u**2 * (3 - 2 * u), 6 * h * (u - u**2), 6 * h * (1 - 2 * u)])
    found = _bvp(equations, ends(h, b), u, y, [0.0, 12 * h])
    if found.p[1] < 0:
        raise ValueError("the rod stands higher by itself")
    u = np.linspace(0, 1, points)
    x, z, th, kappa = found.sol(u)
    unit = EI / half**2
    return Crossed(2 * found.p[1] * unit, found.p[0] * unit, u * half, x * half, z * half, th, kappa / half)


def crossed_pair(distance, first, second):
    """Two clamped rods at a right angle whose middles are kept ``distance`` [m] apart: (lift 1, lift 2, force).

    first, second : arguments of `crossed_rod` without the height, as dicts. The distance is a1 + a2 less the gap
    between the planes of their clamps. One force P bends both: P1(h1) = P2(distance - h1).
    """

    def miss(h):
        return crossed_rod(h, **first).force - crossed_rod(distance - h, **second).force

    h = brentq(miss, 1e-3 * distance, (1 - 1e-3) * distance, xtol=1e-12 * distance)
    return h, distance - h, crossed_rod(h, **first).force


def greenhill(tension):
    """Critical torque M L / EI [-] of a straight isotropic rod, both ends clamped, for T L^2 / EI = ``tension`` [-].

    Lateral displacement y = y1 + i y2 of the twisted rod:  EI y'''' - i M y''' - T y'' = 0,  y = y' = 0 at x = -L/2, L/2
    (one end may move along the axis). Y = y'' is a sum of exp(i alpha x), exp(i beta x) with
    alpha, beta = M/2EI +- sqrt(M^2/4EI^2 - T/EI). The end conditions say that the integrals of Y and x Y vanish;
    with A = alpha L/2, B = beta L/2 and spherical Bessel functions j0 = sin A / A, j1 = sin A / A^2 - cos A / A that is
        j0(A) j1(B) = j0(B) j1(A),  A and B different.
    At T = 0: B = 0 leaves tan A = A, A = M L / 2EI = 4.493409, so M L/EI = 8.986819 = 2.860593 pi.
    For long rods M^2 -> 4 EI T. At M = 0 it is the Euler load -4 pi^2. Tension above -4 pi^2.
    """
    if not tension > -4 * np.pi**2:
        raise ValueError("the rod buckles without torque")

    def determinant(torque):
        root = np.sqrt(torque**2 / 4 - tension)
        A, B = (torque / 2 + root) / 2, (torque / 2 - root) / 2
        value = spherical_jn(0, A) * spherical_jn(1, B) - spherical_jn(0, B) * spherical_jn(1, A)
        return value / root  # it vanishes with A = B, which is no solution

    start = 2 * np.sqrt(max(tension, 0)) + 1e-3
    torques = start + np.linspace(0, 4 * np.pi, 4001)
    values = determinant(torques)
    first = np.nonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0][0]
    return float(brentq(determinant, torques[first], torques[first + 1], xtol=1e-13))


class KnotBraid(NamedTuple):
    """What `knot_braid` finds for one half; lengths along the knot in parts of sqrt(2 a R)."""

    friction: float  # [-] sigma: friction adds sigma mu EI / (a^(1/2) R^(3/2)) to the pull
    line_end: float  # where contact along a line ends
    point: float  # where the strands touch once more
    forces: tuple[float, float, float]  # along the line, at its end, at the point, in parts of their sum
    turn: float  # [rad] by which the strands wind along the line


def knot_braid():
    """Braid of a loose overhand knot, rope of radius a in a loop of radius R: a/R -> 0 (Audoly, Clauvelin & Neukirch 2007).

    Two strands run along x. On the left the first is straight and the second bends with the loop, on the right the other
    way round. With 2 a U the difference of their places and x = X sqrt(2 a R):
        U'''' = p U, p >= 0, nonzero only where |U| = 1;  U''' -> 0 and U'' -> (-1, 0) on the left, (1, 0) on the right.
    Their sum bends evenly and knows no contact. U winds by 3/2 turns; in the middle it is (0, 1), its first component is
    odd and its second even. Contact is a line |X| < X1 with a force at its end, and a point X2 on each side.
    Line: U = (cos q, sin q), so q'''' = 6 q'^2 q'' and p = q'^4 - 4 q' q''' - 3 q''^2; U'' is continuous where it ends.
    Unknown q'(0), q'''(0), X1, X2 and both forces; at X2 |U| = 1, U.U' = 0, U'' = (1, 0) and U''' = 0 beyond.

    The line force between the strands is EI (2 a U)'''' / 2; summed over the braid it is sqrt(2)/4 EI / (a^(1/2) R^(3/2))
    times the sum of p. Each half of the rope passes it once on the way from the pull to the loop, where the tension
    vanishes: friction adds mu times that to the pull of a knot that is tightened, and takes it away when it is loosened.
    """

    def line(slope, third, end):
        def rates(_, y):
            return [y[1], y[2], y[3], 6 * y[1] ** 2 * y[2], y[1] ** 4 - 4 * y[1] * y[3] - 3 * y[2] ** 2]

        return solve_ivp(rates, (0, end), [np.pi / 2, slope, 0, third, 0], rtol=1e-11, atol=1e-12).y[:, -1]

    def miss(v):
        slope, third, end, force, point, last = v
        q, w, bend, rise, _ = line(slope, third, end)
        e, t, d = np.array([np.cos(q), np.sin(q)]), np.array([-np.sin(q), np.cos(q)]), point - end
        first, second = w * t, bend * t - w**2 * e
        jerk = (rise - w**3) * t + (force - 3 * w * bend) * e
        U = e + first * d + second * d**2 / 2 + jerk * d**3 / 6
        first, second = first + second * d + jerk * d**2 / 2, second + jerk * d
        return [U @ U - 1, U @ first, second[0] - 1, second[1], *(jerk + last * U)]

    found = root(miss, [0.8, 0.0, 0.4, 0.2, 2.7, 0.4], tol=1e-12)
    if not found.success:
        raise RuntimeError(found.message)
    slope, third, end, force, point, last = map(float, found.x)
    q, *_, pressed = line(slope, third, end)
    forces = np.array([pressed, force, last])
    half = float(forces.sum())
    return KnotBraid(half / np.sqrt(2), end, point, tuple(map(float, forces / half)), float(q - np.pi / 2))


class Mandrel(NamedTuple):
    """What `mandrel` finds, for one half."""

    lift_off_angle: float  # [rad] from the top of the cylinder
    point_force: float  # [N] normal reaction at lift-off
    line_pressure: float  # [N/m] between the two places
    tip_angle: float  # [rad] slope of the end below the horizontal
    tip: np.ndarray  # (2,) [m] across and up, from the cylinder's axis


def mandrel(force, half_length, radius, EI):
    """Straight rod laid over a cylinder and pulled down by dead forces [N] at both ends; no friction, no stretch.

    ``radius`` = R + a [m], ``half_length`` [m] of the rod, symmetric about the top. On the arc |psi| < phi the
    curvature is 1/r, M is constant, so Q = 0 and T is constant; p = T/r. Beyond lift-off the force F points down:
    T = F sin phi is continuous, Q jumps from 0 to -F cos phi. Hence two point forces F cos phi and between them the
    pressure F sin phi / r, zero only to the extent that F is normal to the rod at lift-off (small phi); their
    vertical sum is 2 F cos^2 phi + 2 F sin^2 phi = 2 F.
    Free part, psi the slope downwards: M^2/2EI + F sin psi is constant and M = 0 at the end, so
    sin psi_end = sin phi + EI / (2 F r^2) and ds = d psi / sqrt(2 F/EI (sin psi_end - sin psi)). Lift-off angle from
    r phi + (free length) = half_length. Shorter or weaker: the rod touches in one point, force 2 F; an error here.
    """
    gain = EI / (2 * force * radius**2)

    def free(phi, what):
        end = np.arcsin(np.sin(phi) + gain)
        width = end - phi

        def integrand(u):  # psi = end - width u^2 takes the square root's zero away
            psi = end - width * u**2
            drop = 2 * np.cos((end + psi) / 2) * np.sin((end - psi) / 2)
            root = np.sqrt(2 * force / EI * drop / u**2) if u > 0 else np.sqrt(2 * force / EI * np.cos(end) * width)
            return 2 * width / root * what(psi)

        return quad(integrand, 0, 1, epsabs=1e-12, epsrel=1e-11)[0]

    def miss(phi):
        return radius * phi + free(phi, lambda psi: 1.0) - half_length

    if gain >= 1 or miss(0.0) > 0:
        raise ValueError("the rod touches the cylinder in one point")
    steepest = np.arcsin(1 - gain)  # lift-off of an infinitely long rod
    bound = next(b for b in steepest * (1 - 0.5 ** np.arange(1, 50)) if miss(b) > 0)
    phi = brentq(miss, 0, bound, xtol=1e-13)
    tip = radius * np.array([np.sin(phi), np.cos(phi)]) + [free(phi, np.cos), -free(phi, np.sin)]
    end = float(np.arcsin(np.sin(phi) + gain))
    return Mandrel(phi, force * np.cos(phi), force * np.sin(phi) / radius, end, tip)


def slope_acceleration(mu, slope, gravity):
    """Acceleration [m/s^2] down a slope [rad] of a body at rest: it stays up to tan(slope) = mu."""
    return max(0.0, gravity * (np.sin(slope) - mu * np.cos(slope)))


def hysteresis_area(limit, stiffness, amplitude):
    """Work [J] lost per cycle when a spring [N/m] drags a block of friction ``limit`` = mu N [N] by +-amplitude [m].

    The driven end goes 2 X between reversals; the spring force first runs from -limit to limit over 2 limit/k, then
    the block slips 2 (X - limit/k) at the limit: both ways together 4 limit (X - limit/k), or 0 if it never slips.
    A contact that sticks elastically with stiffness c acts in series: 1/k + 1/c in the place of 1/k.
    """
    return 4 * limit * max(0.0, amplitude - limit / stiffness)


class StickSlip(NamedTuple):
    """What `stick_slip` finds."""

    stick_time: float  # [s]
    slip_time: float  # [s]
    highest: float  # [m] farthest displacement from the unstretched spring
    lowest: float  # [m]


def stick_slip(mass, stiffness, belt_speed, static, kinetic):
    """Block on a belt, held by a spring [N/m]; friction limits ``static`` > ``kinetic`` [N], speed v [m/s] > 0.

    It sticks and moves with v up to x = static/k. Slip: with y = x - kinetic/k and D = (static - kinetic)/k
    y = D cos wt + (v/w) sin wt until y' = v again, which is at wt = 2 pi - 2 atan(D w / v), y = -D. Then it sticks
    for 2 D / v. Amplitude of the slip sqrt(D^2 + (v/w)^2) about kinetic/k; it never overtakes the belt.
    """
    omega, D = np.sqrt(stiffness / mass), (static - kinetic) / stiffness
    swing = np.hypot(D, belt_speed / omega)
    slip = (2 * np.pi - 2 * np.arctan(D * omega / belt_speed)) / omega
    return StickSlip(2 * D / belt_speed, slip, kinetic / stiffness + swing, kinetic / stiffness - swing)


def _bvp(equations, ends, u, y, p, tol=1e-10):
    found = solve_bvp(equations, ends, u, y, p, tol=tol, max_nodes=20_000)
    if not found.success:
        raise RuntimeError(found.message)
    return found
