"""Critical loads by closed forms, Galerkin's method and shooting. Numpy and scipy only.

Plane rods are those of Reissner: with theta the angle of the section, forces n along x and y,
    x' = (1 + N/EA) cos(theta) - V/GA sin(theta),  y' = (1 + N/EA) sin(theta) + V/GA cos(theta),
    theta' = kappa_0 + m/EI,  m' = -(x' n_y - y' n_x),   N = n_x cos + n_y sin,  V = -n_x sin + n_y cos.
"""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eig
from scipy.optimize import brentq, minimize_scalar, root
from scipy.special import jv

EULER = {
    "clamped-free": np.pi**2 / 4,
    "pinned-pinned": np.pi**2,
    "clamped-pinned": brentq(lambda x: np.tan(x) - x, 4.4, 4.6) ** 2,
    "clamped-clamped": 4 * np.pi**2,
}  # times EI / L^2


def self_weight():
    """q L^3 / EI of a column that buckles by its own weight (Greenhill 1881): J_{-1/3}(2/3 sqrt(q)) = 0."""
    return (1.5 * brentq(lambda x: jv(-1 / 3, x), 1.5, 2.2)) ** 2


def lateral_tip():
    """P L^2 / sqrt(EI GJ) of a narrow strip under an end load (Michell, Prandtl 1899): J_{-1/4}(P / 2) = 0."""
    return 2 * brentq(lambda x: jv(-0.25, x), 1.5, 2.5)


def beck():
    """P L^2 / EI at which the two lowest frequencies of Beck's column (1952) are one.

    P^2 + 2 w^2 (1 + cosh(a) cos(b)) + P w sinh(a) sin(b) = 0 with a^2, b^2 = -+P/2 + sqrt(P^2/4 + w^2).
    """

    def equation(w, P):
        half = np.sqrt(P * P / 4 + w * w)
        a, b = np.sqrt(half - P / 2), np.sqrt(half + P / 2)
        return P * P + 2 * w * w * (1 + np.cosh(a) * np.cos(b)) + P * w * np.sinh(a) * np.sin(b)

    def depth(P):
        """Extreme of the equation between the two frequencies: zero where they meet."""
        found = minimize_scalar(lambda w: equation(w, P), bounds=(8, 14), method="bounded", options={"xatol": 1e-12})
        return found.fun

    return brentq(depth, 19.0, 21.0, xtol=1e-12)


@cache
def leipholz(n=14):
    """q L^3 / EI of Leipholz's column (1962): w'''' + q (1 - x) w'' = w^2 w, clamped at 0; Galerkin with polynomials."""
    x, weight = np.polynomial.legendre.leggauss(40)
    x, weight = (x + 1) / 2, weight / 2
    basis = [np.polynomial.Polynomial([0, 0, 1]) * np.polynomial.Legendre.basis(k, [0, 1]).convert(
        kind=np.polynomial.Polynomial) for k in range(n)]  # fmt: skip
    w, w2 = (np.array([f.deriv(k)(x) if k else f(x) for f in basis]) for k in (0, 2))
    M, K, G = (w * weight) @ w.T, (w2 * weight) @ w2.T, (w * weight * (1 - x)) @ w2.T

    def apart(q):
        """Squared difference of the two lowest eigenvalues; negative if they are a complex pair."""
        values = eig(K + q * G, M, right=False)
        low = values[np.argsort(np.abs(values))[:2]]
        return float(np.real((low[0] - low[1]) ** 2))

    return brentq(apart, 35, 45, xtol=1e-10)


def von_mises(rise, span):
    """Limit load over EA of one bar of stretch N = EA (l / l0 - 1), its end pushed down from (span, rise) along y."""
    l0 = np.hypot(span, rise)
    y = span * np.sqrt((l0 / span) ** (2 / 3) - 1)  # where y (1 / l0 - 1 / l) is largest
    return y * (1 / np.hypot(span, y) - 1 / l0)


def _march(start, length, force, stiffness, curvature=0.0):
    """State (x, y, theta, m) at the end of a plane rod under a force (2,) on its cuts."""
    GA, EA, EI = stiffness

    def slope(s, u):
        c, d = np.cos(u[2]), np.sin(u[2])
        N, V = force[0] * c + force[1] * d, -force[0] * d + force[1] * c
        stretch, shear = 1 + N / EA, V / GA
        dx, dy = stretch * c - shear * d, stretch * d + shear * c
        return [dx, dy, curvature + u[3] / EI, -(dx * force[1] - dy * force[0])]

    return solve_ivp(slope, (0, length), start, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]


def _limits(miss, start, size, step, count, steps=400):
    """The first `count` extremes of the last unknown along the curve miss(u) = 0 (one equation less than unknowns).

    Unknowns are scaled by `size`; the curve is followed by its tangent (the null space of a difference quotient) and
    solved for in the plane normal to it.
    """
    size = np.asarray(size, dtype=float)

    def f(z):
        return np.asarray(miss(z * size))

    def tangent(z, before):
        h = 1e-6
        J = np.array([(f(z + h * e) - f(z - h * e)) / (2 * h) for e in np.eye(len(z))]).T
        t = np.linalg.svd(J)[2][-1]
        return t * (np.sign(t @ before) or 1.0)

    def ahead(z, t, ds):
        found = root(lambda y: np.append(f(y), (y - z) @ t - ds), z + ds * t, tol=1e-13)
        if not np.abs(found.fun).max() < 1e-9:
            raise ArithmeticError(found.message)
        return found.x

    z = np.asarray(start, dtype=float) / size
    t = tangent(z, np.eye(len(z))[-1])
    extremes = []
    for _ in range(steps):
        new = ahead(z, t, step)
        new_t = tangent(new, t)
        if t[-1] * new_t[-1] < 0:
            ds = brentq(lambda d, z=z, t=t: tangent(ahead(z, t, d), t)[-1], 0, step, xtol=1e-9)
            extremes.append(ahead(z, t, ds)[-1] * size[-1])
            if len(extremes) == count:
                return extremes
        z, t = new, new_t
    raise ArithmeticError("too few extremes")


@cache
def lee_frame(GA, EA, EI, L=120.0, *, follower=False, count=2):
    """Loads at the limit points of Lee's frame (1968): hinged column and beam, a downward load at a fifth of the beam.

    follower: the load stays normal to the beam. Unknowns: angle at the foot, its force, the load.
    """

    def miss(u):
        angle, fx, fy, P = u
        corner = _march([0.0, 0.0, np.pi / 2 + angle, 0.0], L, (fx, fy), (GA, EA, EI))
        at = _march(corner - [0, 0, np.pi / 2, 0], 0.2 * L, (fx, fy), (GA, EA, EI))
        push = P * np.array([np.sin(at[2]), -np.cos(at[2])]) if follower else np.array([0.0, -P])
        end = _march(at, 0.8 * L, (fx - push[0], fy - push[1]), (GA, EA, EI))
        return [end[0] / L - 1, end[1] / L - 1, end[3] * L / EI]

    return _limits(miss, np.zeros(4), [1.0, EI / L**2, EI / L**2, EI / L**2], 0.5, count)


@cache
def deep_arch(GA, EA, EI, R=1.0, angle=215.0):
    """Load at the limit point of a circular arch, clamped at one end and hinged at the other, pushed down at its top."""
    half = np.radians(angle) / 2
    start, length = np.array([-R * np.sin(half), R * np.cos(half)]), R * half
    stiffness = (GA, EA, EI)

    def miss(u):
        m, fx, fy, P = u
        top = _march([*start, half, m], length, (fx, fy), stiffness, -1 / R)
        end = _march(top, length, (fx, fy + P), stiffness, -1 / R)
        return [(end[0] + start[0]) / R, (end[1] - start[1]) / R, end[3] * R / EI]

    return _limits(miss, np.zeros(4), [EI / R, EI / R**2, EI / R**2, EI / R**2], 0.5, 1)[0]
