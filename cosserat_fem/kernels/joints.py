"""Where elements of a rod meet: the curve that another rod touches there goes round instead of on with a kink.

Rule: elements meet in a small kink, the jump k of dx/ds. A rod that comes to rest in it has no equilibrium: the direction in
which it is pressed jumps there. So the centreline is taken as x(s) + f(s) k up to W before and behind the joint, at s = 0,
with f = W P(s / W) - |s| / 2 and P(x) = (3 + 6 x^2 - x^4) / 16. P and its first two derivatives are those of |x| / 2 at 1:
the rounded curve and its slope are continuous, it ends where the kink is no longer felt, and stays within 3/16 W |k| of the
rod. It is linear in the places of the nodes of both elements, so forces on it go to these, and balance.

A kink that is not slight is a coarse mesh. Of that only as much is rounded as a slight one has: the curve leaves the rod by
a small part of the range of the barrier at most, and by no more than half of what is left of a gap. Rods that lie along each
other touch at many places, few of them near a joint: there nothing is rounded.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from . import kernel, lean
from .pairs import dot, shape

WIDE, OF_ELEMENT = 0.1, 0.25  # W in radii of the rod, and at most in lengths of an element
LEAVES = 0.2  # slight kink in ranges of the barrier per W
FARTHEST, OF_GAP = 3 / 16, 0.5  # how far the curve leaves the rod in W |k|, and at most in gaps
STEPS, CLOSE = 30, 1e-12
ALONG, ACROSS = 0.01, 0.04  # square of the sine of the angle between rods: none is rounded below, all above


@lean
def bump(s, W):
    """f and its first two derivatives."""
    x = s / W
    if abs(x) >= 1.0:
        return 0.0, 0.0, 0.0
    side = 0.5 if s >= 0.0 else -0.5
    square = x * x
    value = W * ((3.0 + 6.0 * square - square * square) / 16.0) - side * s
    return value, x * (3.0 - square) / 4.0 - side, 0.75 * (1.0 - square) / W


@lean
def on_element(nodes, coefficients, r, xi, h, out):
    """out[0], out[1], out[2]: position and its first two derivatives by arc length at xi of an element."""
    A, t = nodes.shape[0], xi - 0.5
    for k in range(3):
        for i in range(3):
            out[k, i] = 0.0
    for a in range(A):
        value, d, dd = coefficients[A - 1, a], 0.0, 0.0
        for k in range(A - 2, -1, -1):
            dd = dd * t + 2.0 * d
            d = d * t + value
            value = value * t + coefficients[k, a]
        for i in range(3):
            x = r[nodes[a], i]
            out[0, i] += value * x
            out[1, i] += d / h * x
            out[2, i] += dd / (h * h) * x


@lean
def across(row, first, coefficients, r, y):
    """How much is rounded at the angle between the rods, 0 to 1; y: room."""
    on_element(first, coefficients, r, row[0], 1.0, y)
    t0, t1, t2 = row[8], row[9], row[10]
    along = y[1, 0] * t0 + y[1, 1] * t1 + y[1, 2] * t2
    square = 1.0 - along * along / (dot(y[1], y[1]) * (t0 * t0 + t1 * t1 + t2 * t2))
    x = min(max((square - ALONG) / (ACROSS - ALONG), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@kernel
def round_joints(rows, first, elements, ahead, widths, slight, gaps, conn, coefficients, h, r, nodes, second):
    """Nearest places on rounded curves, for points of `reach.find` on an element `elements` (K,) near its joint with the
    next one if `ahead` (K,) is 1, with the one before if it is -1.

    first (K,): element of the first place; widths (K,) [m]: W; slight (K,): see above; gaps (K,) [m]: distances less core.
    Writes rows: distance, its direction, xi, slope, second derivative and that it is free; elements: where the place is now;
    nodes (K, 2 A) of that element and of the other one, and second (2, K, 2 A): their shape functions and the derivatives of
    these by xi. Returns which points (K,) it did; others stay as they are.
    """
    K, A = rows.shape[0], coefficients.shape[0]
    done = np.zeros(K, dtype=np.bool_)
    y, x1, kink, N, D, N0, D0 = (
        np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(A), np.empty(A), np.empty(A), np.empty(A),
    )  # fmt: skip
    way = np.empty(3)
    for k in range(K):
        row, W = rows[k], widths[k]
        part = across(row, conn[first[k]], coefficients, r, y)
        if part == 0.0:
            continue
        e = elements[k]
        b, a = (e, e + 1) if ahead[k] > 0 else (e - 1, e)
        on_element(conn[e], coefficients, r, row[7], h[e], y)
        for i in range(3):
            x1[i] = y[0, i] + row[2] * row[3 + i]
        on_element(conn[a], coefficients, r, 0.0, h[a], y)
        for i in range(3):
            kink[i] = y[1, i]
        on_element(conn[b], coefficients, r, 1.0, h[b], y)
        for i in range(3):
            kink[i] -= y[1, i]
        size = sqrt(dot(kink, kink))
        part *= slight[k] / max(slight[k], size)
        part = min(part, OF_GAP * gaps[k] / max(FARTHEST * W * size, 1e-300))
        s = (row[7] - 1.0) * h[b] if e == b else row[7] * h[a]
        found = False
        for _ in range(STEPS):
            e = a if s >= 0.0 else b
            xi = s / h[a] if e == a else 1.0 + s / h[b]
            on_element(conn[e], coefficients, r, xi, h[e], y)
            f, df, ddf = bump(s, W)
            for i in range(3):
                y[0, i] += part * f * kink[i]
                y[1, i] += part * df * kink[i]
                y[2, i] += part * ddf * kink[i]
                way[i] = x1[i] - y[0, i]
            if found:
                break
            slope = dot(way, y[2]) - dot(y[1], y[1])
            if slope >= 0.0:
                break
            step = -dot(way, y[1]) / slope
            s += step
            if abs(s) > W:
                break
            found = abs(step) < CLOSE * h[e]
        d = sqrt(dot(way, way))
        if not found or d == 0.0:
            continue
        done[k], elements[k] = True, e
        row[2], row[7], row[14] = d, xi, 1.0
        shape(coefficients, xi, N, D)
        for i in range(3):
            row[3 + i], row[8 + i], row[11 + i] = way[i] / d, y[1, i] * h[e], y[2, i] * h[e] * h[e]
        for j in range(2):
            of = e if j == 0 else a + b - e
            shape(coefficients, 0.0 if of == a else 1.0, N0, D0)
            sign = part / h[of] if of == a else -part / h[of]
            for c in range(A):
                nodes[k, j * A + c] = conn[of, c]
                second[0, k, j * A + c] = sign * f * D0[c] + (N[c] if j == 0 else 0.0)
                second[1, k, j * A + c] = sign * df * h[e] * D0[c] + (D[c] if j == 0 else 0.0)
    return done
