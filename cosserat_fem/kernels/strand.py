"""Rods as curves: the polynomial of an element, and the nearest place on a strand of another rod.

Rule: a strand is a run of cells of one rod. The nearest place on it is where the way to it is normal to the curve, or an
end of the rod; where a strand was cut off and goes on, nothing is found, because what is nearer lies beyond.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from . import kernel, lean

NEARER = 1.0 - 3e-4  # of a distance


@lean
def element_polynomial(nodes, coefficients, r, Q, c, C):
    """C (A, 3): the element's centreline in a frame, sum of C_k (xi - 1/2)^k."""
    A = nodes.shape[0]
    for k in range(A):
        for i in range(3):
            C[k, i] = 0.0
    for a in range(A):
        d0, d1, d2 = r[nodes[a], 0] - c[0], r[nodes[a], 1] - c[1], r[nodes[a], 2] - c[2]
        for i in range(3):
            y = Q[0, i] * d0 + Q[1, i] * d1 + Q[2, i] * d2
            for k in range(A):
                C[k, i] += coefficients[k, a] * y


@lean
def place_at(C, xi, y, slope):
    """Position y and derivative slope (3,) at xi."""
    t = xi - 0.5
    for i in range(3):
        value, d = C[C.shape[0] - 1, i], 0.0
        for k in range(C.shape[0] - 2, -1, -1):
            d = d * t + value
            value = value * t + C[k, i]
        y[i], slope[i] = value, d


@lean
def strand_at(nodes, coefficients, r, xi, out):
    """out[8:11] position, out[19:22] slope, out[22:25] second derivative of an element at xi."""
    A, t = nodes.shape[0], xi - 0.5
    for i in range(8, 11):
        out[i] = 0.0
    for i in range(19, 25):
        out[i] = 0.0
    for a in range(A):
        value, d, dd = coefficients[A - 1, a], 0.0, 0.0
        for k in range(A - 2, -1, -1):
            dd = dd * t + 2.0 * d
            d = d * t + value
            value = value * t + coefficients[k, a]
        for i in range(3):
            x = r[nodes[a], i]
            out[8 + i] += value * x
            out[19 + i] += d * x
            out[22 + i] += dd * x


@lean
def along(x, out):
    """(x - x2) . x2' and (x - x2) . x2'' - x2' . x2' at the place in out."""
    d0, d1, d2 = x[0] - out[8], x[1] - out[9], x[2] - out[10]
    f = d0 * out[19] + d1 * out[20] + d2 * out[21]
    g = d0 * out[22] + d1 * out[23] + d2 * out[24]
    return f, g - (out[19] * out[19] + out[20] * out[20] + out[21] * out[21])


@lean
def foot_in_cell(x, nodes, coefficients, r, a, b, out):
    """Place xi between a and b of an element at which the way to x is normal to it; `out` as `strand_at` makes it there."""
    xi = 0.5 * (a + b)
    for _ in range(60):
        strand_at(nodes, coefficients, r, xi, out)
        f, g = along(x, out)
        if f > 0.0:
            a = xi
        else:
            b = xi
        new = xi - f / g if g < 0.0 else 0.5 * (a + b)
        if not a < new < b:
            new = 0.5 * (a + b)
        if abs(new - xi) < 1e-15:
            break
        xi = new
    return xi


@lean
def distance_to(x, out):
    """Distance of x from the place in `out`."""
    d0, d1, d2 = x[0] - out[8], x[1] - out[9], x[2] - out[10]
    return sqrt(d0 * d0 + d1 * d1 + d2 * d2)


@lean
def nearest_on_strand(x, rods, first, last, out):
    """Distance and direction out[:4] from the nearest place of the cells first .. last to x.

    rods: ends of cells (n + rods, 3), cells (n, 2), counts (E,), nodes (E, A), coefficients, r, rod of each cell (n,), first
    and last cell of each rod (rods, 2). Also out[17] the cell, out[18] xi, out[19:22] slope, out[22:25] second derivative,
    out[25] 1 if the place is free to slide along the rod. Distance infinite if the strand goes on towards what is nearer.
    On the inner side of a kink between elements there may be one on either side: that ahead counts unless the other one is
    nearer by more than a hair, so that rods at rest across a kink do not turn from one to the other.
    """
    ends, cells, counts, nodes, coefficients, r, rod_of, bounds = rods
    o = rod_of[first]
    best, k = np.inf, first
    for j in range(first, last + 2):
        d0, d1, d2 = x[0] - ends[j + o, 0], x[1] - ends[j + o, 1], x[2] - ends[j + o, 2]
        square = d0 * d0 + d1 * d1 + d2 * d2
        if square < best:
            best, k = square, j
    ahead = behind = False
    if k > first:
        e = cells[k - 1, 0]
        strand_at(nodes[e], coefficients, r, (cells[k - 1, 1] + 1) / counts[e], out)
        behind = along(x, out)[0] < 0.0
    if k <= last:
        e = cells[k, 0]
        strand_at(nodes[e], coefficients, r, cells[k, 1] / counts[e], out)
        ahead = along(x, out)[0] > 0.0
    cell = k if k <= last and (ahead or not behind) else k - 1
    e = cells[cell, 0]
    if ahead or behind:
        xi = foot_in_cell(
            x, nodes[e], coefficients, r, cells[cell, 1] / counts[e], (cells[cell, 1] + 1) / counts[e], out
        )
        if ahead and behind:
            before, e0 = distance_to(x, out), cells[k - 1, 0]
            a, b = cells[k - 1, 1] / counts[e0], (cells[k - 1, 1] + 1) / counts[e0]
            other = foot_in_cell(x, nodes[e0], coefficients, r, a, b, out)
            if distance_to(x, out) < NEARER * before:
                cell, xi = k - 1, other
            else:
                strand_at(nodes[e], coefficients, r, xi, out)
        out[25] = 1.0
    elif (k == first and first > bounds[o, 0]) or (k == last + 1 and last < bounds[o, 1]):
        out[0], out[1], out[2], out[3], out[25] = np.inf, 0.0, 0.0, 1.0, 0.0
        return
    else:
        xi = (cells[cell, 1] + k - cell) / counts[e]
        out[25] = 0.0
    d = distance_to(x, out)
    i = 1.0 / max(d, 1e-300)
    out[0], out[1], out[2], out[3] = d, (x[0] - out[8]) * i, (x[1] - out[9]) * i, (x[2] - out[10]) * i
    out[17], out[18] = cell, xi


@kernel
def cell_ends(cells, counts, nodes, coefficients, r, rod_of, ends):
    """Ends (n + rods, 3) of all cells: those of cell j of rod o are the rows j + o and j + o + 1."""
    A = nodes.shape[1]
    C, slope, unturned, origin = np.empty((A, 3)), np.empty(3), np.eye(3), np.zeros(3)
    before = -1
    for m in range(cells.shape[0]):
        e = cells[m, 0]
        if e != before:
            element_polynomial(nodes[e], coefficients, r, unturned, origin, C)
            before = e
        place_at(C, cells[m, 1] / counts[e], ends[m + rod_of[m]], slope)
        if m + 1 == cells.shape[0] or rod_of[m + 1] != rod_of[m]:
            place_at(C, (cells[m, 1] + 1) / counts[e], ends[m + rod_of[m] + 1], slope)


@lean
def segments(p0, p1, q0, q1, n):
    """Distance of two segments, and the direction n (3,) from the second to the first."""
    u0, u1, u2 = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
    v0, v1, v2 = q1[0] - q0[0], q1[1] - q0[1], q1[2] - q0[2]
    w0, w1, w2 = p0[0] - q0[0], p0[1] - q0[1], p0[2] - q0[2]
    a, b, c = u0 * u0 + u1 * u1 + u2 * u2, u0 * v0 + u1 * v1 + u2 * v2, v0 * v0 + v1 * v1 + v2 * v2
    d, e = u0 * w0 + u1 * w1 + u2 * w2, v0 * w0 + v1 * w1 + v2 * w2
    det = a * c - b * b
    s = min(max((b * e - c * d) / det, 0.0), 1.0) if det > 1e-14 * a * c else 0.0
    t = (b * s + e) / c
    if t < 0.0:
        t, s = 0.0, min(max(-d / a, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((b - d) / a, 0.0), 1.0)
    n[0], n[1], n[2] = w0 + s * u0 - t * v0, w1 + s * u1 - t * v1, w2 + s * u2 - t * v2
    size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    i = 1.0 / max(size, 1e-300)
    n[0], n[1], n[2] = n[0] * i, n[1] * i, n[2] * i
    return size


@kernel
def largest_step_between(pairs, ends, moved, rod_of, core, sag, least, part, spare):
    """Part of the way from ends to moved (n + rods, 3) on which no two chords of cells come together.

    pairs (P, 2): cells; core (rods, rods): distances never reached; sag (n,): how far each cell bends away from its chord;
    least: smallest gap between the curves. A slab between two chords stays between them while their ends move by less than
    its width towards each other.
    """
    alpha, n = 1.0, np.empty(3)
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0] + rod_of[pairs[m, 0]], pairs[m, 1] + rod_of[pairs[m, 1]]
        gap = segments(ends[i], ends[i + 1], ends[j], ends[j + 1], n) - core[rod_of[pairs[m, 0]], rod_of[pairs[m, 1]]]
        gap = max(gap - sag[pairs[m, 0]] - sag[pairs[m, 1]], least)
        first = second = -np.inf
        for k in range(2):
            a = b = 0.0
            for l in range(3):
                a -= n[l] * (moved[i + k, l] - ends[i + k, l])
                b += n[l] * (moved[j + k, l] - ends[j + k, l])
            first, second = max(first, a), max(second, b)
        closing = first + second
        free = max(part * gap, gap - spare)
        if closing > 0.0 and free < closing:
            alpha = min(alpha, max(free, 0.0) / closing)
    return alpha
