"""References of the bench, from the differential equations and with numpy and scipy alone: nothing of this package solves.

    python tests/benchmarks/references.py [S2 S3 S4 D1 D2 D3] [--write]

Compares what it finds with cosserat_fem/bench/references.json, and writes it there if told to. Statics take a minute,
motions a quarter of an hour.

Statics: the Cosserat rod as an initial value problem (DOP853, relative tolerance 1e-13), the unknown loads at the clamp by
Newton's method; for S3 and D3 started by collocation. Motions: spectral elements (Gauss-Lobatto nodes are quadrature
points, so mass is diagonal), quaternions at the nodes, DOP853, restarted where loads have a kink; the difference of two
resolutions is printed. B03 is the collocation solution of tests/verification/references.json.
"""

import argparse
import json
import pathlib
import time
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root

from cosserat_fem.bench import problems as p

ROOT = pathlib.Path(__file__).parents[2]
TARGET = ROOT / "cosserat_fem" / "bench" / "references.json"
EXACT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}

# quaternions (w, x, y, z), last axis


def cross(a, b):
    """a x b (..., 3), several times faster than numpy's on small arrays."""
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def rotated(q, v, sense=1.0):
    """R v with the rotation of a quaternion of any length, or R^T v for sense = -1: v + 2 (w u x v + u x (u x v)) / q q."""
    w, u = q[..., :1], q[..., 1:]
    once = cross(u, v)
    return v + 2 * (sense * w * once + cross(u, once)) / (q * q).sum(-1, keepdims=True)


def times_vector(q, v):
    """q (0, v)."""
    w, u = q[..., :1], q[..., 1:]
    return np.concatenate([-(u * v).sum(-1, keepdims=True), w * v + cross(u, v)], axis=-1)


# statics


def arc_tip():
    """S2: force is known everywhere, the couple at the clamp is sought; load grows in six steps."""
    b = p.BEND
    stiff, bent = np.array([b.EA, b.GA, b.GA]), np.array([b.GJ, b.EI, b.EI])
    rest = np.array([0, 0, 1 / p.BEND_RADIUS])

    def end(couple, force):
        def field(_, y):
            q = y[3:7]
            slope = rotated(q, np.array([1.0, 0, 0]) + rotated(q, force, -1) / stiff)
            turn = rest + rotated(q, y[7:], -1) / bent
            return np.concatenate([slope, times_vector(y[3:7], turn) / 2, -np.cross(slope, force)])

        start = np.concatenate([np.zeros(3), [1.0, 0, 0, 0], couple])
        return solve_ivp(field, (0, b.length), start, **EXACT).y[:, -1]

    couple = np.zeros(3)
    for part in np.linspace(0, 1, 7)[1:]:
        force = part * np.array(p.BEND_FORCE)
        size = np.linalg.norm(force) * b.length
        found = root(lambda x, f=force, size=size: end(x * size, f)[7:] / size, couple / size, options={"xtol": 1e-14})
        couple = found.x * size
    return {"tip": end(couple, force)[:3].tolist()}


def planar(b, weight):
    """Field of x, y, angle, couple, force (H, V) on the part beyond s; weight per length acts towards -y."""

    def field(_, y):
        angle, couple, H, V = y[2:]
        c, s = np.cos(angle), np.sin(angle)
        stretch, shear = 1 + (c * H + s * V) / b.EA, (c * V - s * H) / b.GA
        dx, dy = c * stretch - s * shear, s * stretch + c * shear
        return np.array([dx, dy, couple / b.EI, dy * H - dx * V, 0 * H, 0 * H + weight])

    return field


def along(b, weight, loads, s=None):
    """States at s, or at the end, of a rod clamped at the origin along x with couple and force (3,) there."""
    start = np.concatenate([np.zeros(3), loads])
    solved = solve_ivp(planar(b, weight), (0, b.length), start, t_eval=s, **EXACT)
    return solved.y if s is not None else solved.y[:, -1]


def elastica_tip():
    """S4: the couple at the clamp is sought."""
    b, force = p.ELASTICA, np.array(p.ELASTICA_FORCE[:2])
    couple = 0.0
    for part in np.linspace(0, 1, 6)[1:]:
        found = root(
            lambda m, f=part * force: along(b, 0.0, [m[0] * b.EI, *f])[3:4] / b.EI, [couple], options={"xtol": 1e-14}
        )
        couple = found.x[0]
    return {"tip": [*along(b, 0.0, [couple * b.EI, *force])[:2].tolist(), 0.0]}


def clamped(b, weight, end, s, y):
    """Couple and force (3,) at the first clamp for an end (x, y, angle); collocation from (s, y), then Newton's method.

    Returns them, what is left open, and the collocation's mesh and states.
    """

    def open_ends(a, z):
        return np.concatenate([a[:3], z[:3] - end])

    guess = solve_bvp(planar(b, weight), open_ends, s, y, tol=1e-6, max_nodes=20_000)
    if not guess.success:
        raise RuntimeError(guess.message)
    size = b.EI / b.length ** np.array([1, 2, 2])
    found = root(
        lambda x: along(b, weight, x * size)[:3] - end, guess.y[3:, 0] / size, options={"xtol": 1e-14}
    )  # fmt: skip
    return found.x * size, np.abs(found.fun).max(), guess.x, guess.y


def slack():
    """S3: the far clamp moves in from where the cable is nearly straight. Told at 81 Chebyshev places."""
    b, weight = p.SLACK, p.SLACK.mass * p.SLACK_GRAVITY
    s = np.linspace(0, b.length, 81)
    y = np.zeros((6, 81))
    y[0], y[1], y[5] = s, -0.05 * np.sin(np.pi * s) ** 2, weight * (s - 0.5)
    y[2] = np.gradient(y[1], s)
    for span in np.linspace(b.length, p.SLACK_SPAN, 21)[1:]:
        loads, left, s, y = clamped(b, weight, (span, 0, 0), s, y)
    print(f"  couple and force at the clamp {loads}, left open {left:.0e}")
    places = 0.5 - 0.5 * np.cos(np.pi * np.arange(81) / 80)
    return {"s": places.tolist(), "r": along(b, weight, loads, places)[:2].T.tolist()}


def follow():
    """D3: 90 equilibria; force and couple on the cable at the arm."""
    b = p.FOLLOW
    s, out = np.linspace(0, b.length, 41), np.zeros((91, 3))
    y = np.zeros((6, 41))
    y[0] = s
    for k in range(1, 91):
        angle = k * p.FOLLOW_RATE
        end = (p.FOLLOW_PIVOT + p.FOLLOW_ARM * np.cos(angle), p.FOLLOW_ARM * np.sin(angle), angle)
        loads, left, s, y = clamped(b, 0.0, end, s, y)
        if left > 1e-11:
            raise RuntimeError(f"station {k}: {left:.0e} left open")
        out[k] = [*loads[1:], along(b, 0.0, loads)[3]]
    return {"reaction": out.round(13).tolist()}


# motions


def lobatto(degree):
    """Nodes, weights and differentiation matrix on [-1, 1]."""
    legendre = np.polynomial.Legendre.basis(degree)
    x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    value = legendre(x)
    apart = x[:, None] - x + np.eye(degree + 1)
    D = value[:, None] / value / apart
    np.fill_diagonal(D, 0.0)
    D[0, 0], D[-1, -1] = -degree * (degree + 1) / 4, degree * (degree + 1) / 4
    return x, 2 / (degree * (degree + 1) * value**2), D


def motion(b, elements, degree, start, end, times, *, turn, gravity=(0, 0, 0), load=None, pinned=False, kinks=()):
    """Places of both ends (T, 2, 3) at the times, from rest, straight from start to end, frame turned by `turn` about z.

    load(t) : force and dead couple at the start
    """
    x, w, D = lobatto(degree)
    h, n = b.length / elements, elements * degree + 1
    nodes = np.arange(elements)[:, None] * degree + np.arange(degree + 1)
    share = np.bincount(nodes.ravel(), np.tile(w * h / 2, elements))
    slope, weighted = D * 2 / h, (D * 2 / h).T * (w * h / 2)
    stiff, bent = np.array([b.EA, b.GA, b.GA]), np.array([b.GJ, b.EI, b.EI])
    about, across = b.inertia
    inertia, ahead = np.array([about, across, across]), np.array([1.0, 0, 0])
    flat = nodes.ravel()

    def gathered(values):
        return np.stack([np.bincount(flat, column, n) for column in values.reshape(-1, 3).T], axis=1)

    def field(t, y):
        r, q, v, omega = np.split(y.reshape(n, 13), (3, 7, 10), axis=1)
        local_q = q[nodes]
        dr, dq = slope @ r[nodes], slope @ local_q
        conjugate = local_q * np.array([1, -1, -1, -1])
        turned = (
            conjugate[..., :1] * dq[..., 1:] + dq[..., :1] * conjugate[..., 1:]
            + cross(conjugate[..., 1:], dq[..., 1:])
        )  # fmt: skip
        curvature = 2 * turned / (local_q**2).sum(-1, keepdims=True)
        force = rotated(local_q, stiff * (rotated(local_q, dr, -1) - ahead))
        couple = rotated(local_q, bent * curvature)
        on_nodes = gathered(-(weighted @ force))
        turning = gathered(-(weighted @ couple) + cross(dr, force) * (w * h / 2)[:, None])
        if load is not None:
            f, m = load(t)
            on_nodes[0] += f
            turning[0] += m
        acceleration = on_nodes / (b.mass * share)[:, None] + gravity
        if pinned:
            acceleration[0] = 0.0
        torque = rotated(q, turning, -1) / share[:, None]
        spin = (torque - cross(omega, inertia * omega)) / inertia
        return np.concatenate([v, times_vector(q, omega) / 2, acceleration, spin], axis=1).ravel()

    y = np.zeros((n, 13))
    part = np.zeros(n)
    part[nodes] = (np.arange(elements)[:, None] + (x + 1) / 2) / elements
    y[:, :3] = start + part[:, None] * (np.asarray(end) - start)
    y[:, 3], y[:, 6] = np.cos(turn / 2), np.sin(turn / 2)
    y, found = y.ravel(), [y.ravel()]
    marks = [0.0, *kinks, times[-1]]
    for a, z in pairwise(marks):
        told = np.minimum(times[(times > a + 1e-12) & (times <= z + 1e-12)], z)
        solved = solve_ivp(field, (a, z), found[-1], method="DOP853", t_eval=told, rtol=1e-9, atol=1e-11)
        found += list(solved.y.T)
    return np.array(found).reshape(len(times), n, 13)[:, [0, -1], :3]


def finer(name, coarse, fine):
    apart = np.linalg.norm(coarse - fine, axis=-1)
    print(f"  {name}: two resolutions are {np.sqrt((apart**2).mean()):.1e} apart (RMS), {apart.max():.1e} at most")
    return fine


def spaghetti():
    """D1."""
    start, end = p.SPAGHETTI_ENDS
    along = end - start
    knots, values = p.SPAGHETTI_KNOTS

    def load(t):
        size = np.interp(t, knots, values)
        return size * np.array(p.SPAGHETTI_FORCE), size * np.array(p.SPAGHETTI_COUPLE)

    both = [
        motion(
            p.SPAGHETTI, elements, degree, start, end, p.PROBLEMS["D1"].times, turn=np.arctan2(along[1], along[0]),
            load=load, kinks=knots[1:3],
        )
        for elements, degree in ((4, 7), (6, 8))
    ]  # fmt: skip
    return {"ends": finer("D1", *both).round(9).tolist()}


def pendulum():
    """D2."""
    both = [
        motion(
            p.PENDULUM, elements, degree, np.zeros(3), (p.PENDULUM.length, 0, 0), p.PROBLEMS["D2"].times, turn=0.0,
            gravity=(0, -p.PENDULUM_GRAVITY, 0), pinned=True,
        )[:, 1, :2]
        for elements, degree in ((8, 7), (12, 8))
    ]  # fmt: skip
    return {"tip": finer("D2", *both).round(9).tolist()}


def deployment():
    """B03, copied."""
    told = json.loads((ROOT / "tests" / "verification" / "references.json").read_text())["B03_deployment"]
    return {"loads": [row[1:] for row in told["history"]]}


SHOOTING = "shooting, DOP853 at 1e-13"
SPECTRAL = "spectral elements, two resolutions; DOP853"
FOUND = {
    "S2": (arc_tip, SHOOTING),
    "S3": (slack, SHOOTING),
    "S4": (elastica_tip, SHOOTING),
    "D1": (spaghetti, SPECTRAL),
    "D2": (pendulum, SPECTRAL),
    "D3": (follow, SHOOTING),
    "B03": (deployment, "collocation of order 6"),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", nargs="*", default=list(FOUND), metavar="problem", help=", ".join(FOUND))
    parser.add_argument("--write", action="store_true", help="replace the packaged values")
    options = parser.parse_args()
    kept = json.loads(TARGET.read_text())
    for name in options.problems:
        begin = time.perf_counter()
        solve, source = FOUND[name]
        values = solve()
        apart = {k: np.abs(np.subtract(v, kept[name]["values"][k])).max() for k, v in values.items()}
        print(f"{name}: {', '.join(f'{k} {d:.1e}' for k, d in apart.items())} from the packaged values, ", end="")
        print(f"{time.perf_counter() - begin:.0f} s", flush=True)
        kept[name] = {"source": source, "values": values}
    if options.write:
        TARGET.write_text(json.dumps(kept) + "\n")


if __name__ == "__main__":
    main()
