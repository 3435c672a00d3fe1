"""How far may a rod move beside rigid parts? Balls about its cells, and the part of a step on which no gap closes.

Rule: what is near is looked for with a margin about the cells of a rod, and stands until one of them has used it up. A step
is cut by the tangent plane of each convex piece, which is rigorous: the distance from a convex body is a convex function.

`line` is what a rod is to these kernels (`Cells.line`): cells (n, 2), element and number in it; counts (E,), cells in each
element; conn (E, A); coefficients (A, A) of the shape functions in powers of xi - 1/2.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from . import kernel, lean
from .reach import OUT
from .shapes import MESH, TORUS, beyond, closed_form, triangles
from .strand import element_polynomial, place_at

WIDER = 1.05  # radius of the ball about a cell over half of its chord, as it may be bent


@lean
def ball(C, begin, end, y, slope, middle):
    """Middle (3,) and radius of the ball about a cell."""
    place_at(C, 0.5 * (begin + end), middle, slope)
    largest = 0.0
    for k in range(2):
        place_at(C, begin if k == 0 else end, y, slope)
        square = (y[0] - middle[0]) ** 2 + (y[1] - middle[1]) ** 2 + (y[2] - middle[2]) ** 2
        largest = max(largest, square)
    return WIDER * sqrt(largest)


@kernel
def cell_balls(line, r, Q, c, middle, radius):
    """Middle (n, 3) and radius (n,) of a ball about each cell, in a frame."""
    cells, counts, conn, coefficients = line
    A, before = conn.shape[1], -1
    C, y, z, slope = np.empty((A, 3)), np.empty(3), np.empty(3), np.empty(3)
    for m in range(cells.shape[0]):
        e, number = cells[m, 0], cells[m, 1]
        if e != before:
            element_polynomial(conn[e], coefficients, r, Q, c, C)
            before = e
        radius[m] = ball(C, number / counts[e], (number + 1) / counts[e], y, slope, z)
        middle[m, 0], middle[m, 1], middle[m, 2] = z[0], z[1], z[2]


@kernel
def strayed(line, r, Q, c, middle, radius, allowed):
    """True if a cell has moved farther from where its ball was, in a frame, than it is allowed to (n,)."""
    return any_strayed(line, r, Q, c, middle, radius, allowed, np.empty((line[2].shape[1], 3)), np.empty((3, 3)))


@lean
def any_strayed(line, r, Q, c, middle, radius, allowed, C, places):
    cells, counts, conn, coefficients = line
    y, z, slope = places[0], places[1], places[2]
    before = -1
    for m in range(cells.shape[0]):
        e, number = cells[m, 0], cells[m, 1]
        if e != before:
            element_polynomial(conn[e], coefficients, r, Q, c, C)
            before = e
        wider = max(ball(C, number / counts[e], (number + 1) / counts[e], y, slope, z) - radius[m], 0.0)
        square = (z[0] - middle[m, 0]) ** 2 + (z[1] - middle[m, 1]) ** 2 + (z[2] - middle[m, 2]) ** 2
        if sqrt(square) + wider > allowed[m]:
            return True
    return False


@kernel
def far_from(kind, size, middle, out):
    """Distance out (n,) of points (n, 3) from a closed-form shape, in its frame."""
    row = np.empty(OUT)
    for m in range(middle.shape[0]):
        closed_form(kind, size, middle[m], row)
        out[m] = row[0]


@lean
def free_part(distance, core, n0, n1, n2, d, part, spare):
    """Part of the step d (3,) that closes at most `part` of the gap, or all but `spare`, by the tangent plane.

    Rigorous for convex bodies, whose distance is a convex function.
    """
    closing = -(n0 * d[0] + n1 * d[1] + n2 * d[2])
    gap = distance - core
    free = max(part * gap, gap - spare)
    if closing <= 0.0 or free >= closing:
        return 1.0
    return free / closing


@kernel
def largest_step(entries, line, r, moved, obstacles, Q1, c1, mesh, part, spare):
    """Part of the way from r to moved (N, 3), with obstacles going from Q, c to Q1, c1, on which no gap closes.

    Along each cell, at both ends and two places between, the gap distance - core may close by `part` of itself towards
    each convex piece of the obstacle: a triangle, a solid; a torus is met by short stretches of which each stays away.
    """
    A = line[2].shape[1]
    room = np.empty((A, 3)), np.empty((A, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(OUT)
    return part_of_step(entries, line, r, moved, obstacles, Q1, c1, mesh, part, spare, room)


@lean
def part_of_step(entries, line, r, moved, obstacles, Q1, c1, mesh, part, spare, room):
    cells, counts, conn, coefficients = line
    kinds, sizes, Q, c, _, cores = obstacles
    C, D, y, d, slope, out = room
    alpha = 1.0
    for m in range(entries.shape[0]):
        cell, o, first, last = entries[m, 0], entries[m, 1], entries[m, 2], entries[m, 3]
        core, e, number = cores[o], cells[cell, 0], cells[cell, 1]
        element_polynomial(conn[e], coefficients, r, Q[o], c[o], C)
        element_polynomial(conn[e], coefficients, moved, Q1[o], c1[o], D)
        for k in range(4):
            xi = (number + k / 3.0) / counts[e]
            place_at(C, xi, y, slope)
            place_at(D, xi, d, slope)
            for i in range(3):
                d[i] -= y[i]
            if mesh is not None and kinds[o] == MESH:
                far = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / part + core
                for j in range(first, last):
                    if beyond(mesh[2], mesh[1][j], y, far):
                        continue
                    out[17] = -1.0
                    triangles(mesh[0], mesh[1], j, j + 1, y, out)
                    alpha = min(alpha, free_part(out[0], core, out[1], out[2], out[3], d, part, spare))
            elif kinds[o] == TORUS:
                alpha = min(alpha, stretches(kinds[o], sizes[o], y, d, core, part, out))
            else:
                closed_form(kinds[o], sizes[o], y, out)
                alpha = min(alpha, free_part(out[0], core, out[1], out[2], out[3], d, part, spare))
    return alpha


@lean
def stretches(kind, size, y, d, core, part, out):
    """As `free_part` for a torus: stretches short against its hole, each with a bound of second order on its distance."""
    length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    if length == 0.0:
        return 1.0
    start = y[0], y[1], y[2]
    closed_form(kind, size, y, out)
    keep = (1.0 - part) * (out[0] - core)
    done = 0.0
    for _ in range(100):
        for i in range(3):
            y[i] = start[i] + done * d[i]
        closed_form(kind, size, y, out)
        gap = out[0] - core - keep
        if gap <= 0.0:
            break
        hole = sqrt(y[0] * y[0] + y[1] * y[1])
        short = max(0.5 * hole, 1e-3 * size[0]) / length
        closing = -(out[1] * d[0] + out[2] * d[1] + out[3] * d[2])
        bend = 0.5 * length * length / max(0.5 * hole, 1e-3 * size[0])  # gap(t) >= gap - closing t - bend t^2
        free = 2.0 * gap / (closing + sqrt(closing * closing + 4.0 * bend * gap))
        if hole < size[0] and hole < 2e-3 * size[0]:
            free = gap / length
        done += min(free, short)
        if done >= 1.0:
            done = 1.0
            break
    y[0], y[1], y[2] = start
    return done


@kernel
def longest_chord(line, r, radius):
    """Longest chord of a cell, in parts of its radius (n,)."""
    cells, counts, conn, coefficients = line
    A = conn.shape[1]
    C, y, z, slope = np.empty((A, 3)), np.empty(3), np.empty(3), np.empty(3)
    unturned, origin, longest, before = np.eye(3), np.zeros(3), 0.0, -1
    for m in range(cells.shape[0]):
        e, number = cells[m]
        if e != before:
            element_polynomial(conn[e], coefficients, r, unturned, origin, C)
            before = e
        place_at(C, number / counts[e], y, slope)
        place_at(C, (number + 1) / counts[e], z, slope)
        square = (y[0] - z[0]) ** 2 + (y[1] - z[1]) ** 2 + (y[2] - z[2]) ** 2
        longest = max(longest, square / (radius[m] * radius[m]))
    return sqrt(longest)
