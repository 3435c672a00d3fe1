"""Contact of a rod with a rigid part: where it touches, the law between them, residual and tangent, how far it may move.

Rule: a rod is its centreline x(xi), a polynomial in each element, and a radius. Elements are cut into cells about a radius
long. Along a cell the stretches in which the gap is below the range of the law are found exactly (roots of gap - range,
split at the smallest gap), and each gets a Gauss rule of its own: a crossing whose patch is a tenth of a radius is
integrated as well as a whole rod on a plane, and nothing jumps while a patch moves over cells or elements.

Law, per unit length of the unstressed rod, gap g, range G, scale P [N/m], x = g / G:
    barrier   p = P (2 (x - 1) ln x + (x - 1)^2 / x)  for x < 1: minus the derivative of -P G (x - 1)^2 ln x, twice smooth at
              x = 1 and infinite at 0 (Li and others 2020, Incremental Potential Contact, doi 10.1145/3386569.3392425, as a
              line density);
    friction  the slip of the surface since it was last at rest, at most `elastic` long, turned into a force of mu p at
              that length: true stick below, Coulomb slip above, and no scale of its own.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from . import inner, kernel, merged
from .rotation import log_quaternion
from .shapes import MESH, TORUS, beyond, closed_form, triangles
from .strand import element_polynomial, nearest_on_strand, place_at

# columns of a point: xi, weight, distance, n (3), H (9); of a point on another rod cell, xi, slope (3), second derivative
# (3), and 1 if it is free to slide along
COLUMNS, OUT = 24, 26
ABOUT_TO_SLIP = 0.999
MOST_PIECES = 32  # of a cell over small facets
# pieces of a cell that may touch, so that each has one smallest gap; longest arc of a cell over its chord
ON_STRAND, ON_SHAPE, BENT = 4, 2, 1.1
FLAT = 1e-10  # of the range of the law: a change of the gap that does not count
# Gauss rules on 0 .. 1: three points where a whole cell touches, two on its pieces, four on a stretch that begins or ends
X_1, W_1 = np.array([0.0]), np.array([1.0])
X_2, W_2 = np.array([0.21132486540518713, 0.7886751345948129]), np.array([0.5, 0.5])
X_3, W_3 = (
    np.array([0.1127016653792583, 0.5, 0.8872983346207417]),
    np.array([0.27777777777777785, 0.4444444444444444, 0.27777777777777785]),
)
X_4, W_4 = (
    np.array([0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262]),
    np.array([0.17392742256872679, 0.3260725774312732, 0.3260725774312732, 0.17392742256872679]),
)


@inner
def barrier(g, G, P):
    """Pressure p [N/m], -dp/dg [N/m^2] and potential [N] of the barrier at a gap g > 0."""
    if g >= G:
        return 0.0, 0.0, 0.0
    x = g / G
    l, m = log(x), x - 1.0
    p = P * (2.0 * m * l + m * m / x)
    k = -P / G * (2.0 * l + 4.0 * m / x - m * m / (x * x))
    return p, k, -P * G * m * m * l


@inner
def layer(depth, stiffness, start):
    """Pressure, its slope and potential of a compliant layer indented by depth; quadratic up to `start`, then linear."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    if depth < start:
        return (
            0.5 * stiffness * depth * depth / start,
            stiffness * depth / start,
            stiffness * depth**3 / (6.0 * start),
        )
    over = depth - start
    return (
        stiffness * (depth - 0.5 * start),
        stiffness,
        stiffness * (start * start / 6.0 + 0.5 * start * over + 0.5 * over * over),
    )


@merged
def look(C, xi, kind, size, mesh, rods, first, last, y, slope, out):
    """Distance and its derivatives at xi; out[13]: the derivative along the rod."""
    place_at(C, xi, y, slope)
    if rods is not None:
        nearest_on_strand(y, rods, first, last, out)
    elif mesh is not None:
        if kind == MESH:
            triangles(mesh, first, last, y, out)
        else:
            closed_form(kind, size, y, out)
    else:
        closed_form(kind, size, y, out)
    out[13] = out[1] * slope[0] + out[2] * slope[1] + out[3] * slope[2]


@merged
def root(C, inside, outside, level, kind, size, mesh, rods, first, last, y, slope, out):
    """Where the distance equals `level`, between a place where it is below and one where it is not."""
    a, b = inside, outside
    xi = 0.5 * (a + b)
    for _ in range(80):
        look(C, xi, kind, size, mesh, rods, first, last, y, slope, out)
        f = out[0] - level
        if f < 0.0:
            a = xi
        else:
            b = xi
        step = f / out[13] if out[13] != 0.0 and f < np.inf else np.inf
        new = xi - step
        if not min(a, b) < new < max(a, b):
            new = 0.5 * (a + b)
        if abs(new - xi) < 1e-15 + 1e-13 * abs(inside - outside):
            return new
        xi = new
    return xi


@merged
def lowest(C, a, b, fa, fb, flat, kind, size, mesh, rods, first, last, y, slope, out):
    """Place of the smallest distance, but for `flat`, between a and b, where the derivative fa < 0 < fb (Illinois rule)."""
    xi = a
    for _ in range(60):
        xi = a - fa * (b - a) / (fb - fa)
        if not a < xi < b:
            xi = 0.5 * (a + b)
        look(C, xi, kind, size, mesh, rods, first, last, y, slope, out)
        f = out[13]
        if abs(f) * (b - a) < flat:
            break
        if f < 0.0:
            a, fa = xi, f
            fb *= 0.5
        else:
            b, fb = xi, f
            fa *= 0.5
    return xi


@merged
def add_stretch(C, a, b, h, X, W, Q, kind, size, mesh, rods, first, last, y, slope, out, count, entry, rows, owners):
    """Gauss points of the stretch a .. b as rows; returns the new count, which may exceed the room."""
    if b - a <= 0.0:
        return count
    for k in range(X.shape[0]):
        if count < rows.shape[0]:
            xi = a + (b - a) * X[k]
            look(C, xi, kind, size, mesh, rods, first, last, y, slope, out)
            row = rows[count]
            row[0], row[1], row[2] = xi, W[k] * (b - a) * h, out[0]
            for i in range(3):
                row[3 + i] = Q[i, 0] * out[1] + Q[i, 1] * out[2] + Q[i, 2] * out[3]
            if rods is not None:
                for i in range(9):
                    row[15 + i] = out[17 + i]
            else:
                for i in range(3):
                    h0 = Q[i, 0] * out[4] + Q[i, 1] * out[7] + Q[i, 2] * out[10]
                    h1 = Q[i, 0] * out[5] + Q[i, 1] * out[8] + Q[i, 2] * out[11]
                    h2 = Q[i, 0] * out[6] + Q[i, 1] * out[9] + Q[i, 2] * out[12]
                    for j in range(3):
                        row[6 + 3 * i + j] = h0 * Q[j, 0] + h1 * Q[j, 1] + h2 * Q[j, 2]
            owners[count] = entry
        count += 1
    return count


@inner
def pieces_over(mesh, first, last, length):
    """Into how many pieces a cell is cut so that each lies over one facet: along every one the rod may come near."""
    total = 0.0
    for k in range(first, last):
        total += mesh[5][mesh[2][k]]
    width = total / max(last - first, 1)
    return int(min(max(np.ceil(2.0 * length / max(width, 1e-300)), 1.0), MOST_PIECES))


@inner
def shorten(mesh, first, last, y, far, short):
    """Write to `short` the triangles index[first:last] that may be nearer to y than `far`; how many."""
    n = 0
    for k in range(first, last):
        if not beyond(mesh, k, y, far):
            short[n] = mesh[2][k]
            n += 1
    return n


@kernel
def find(entries, cells, counts, tips, conn, coefficients, h, r, obstacles, mesh, rods, room, rows, owners):
    """Gauss points of all stretches on which an obstacle presses.

    entries (M, 4): cell, obstacle, and where its triangles or the cells of its strand begin and end; cells (n, 2):
    element, number in it; counts (E,): cells in each element; tips (n, 2) [m]: length that counts at the very end of a
    rod or at a kink, where a cell begins or ends with it, so that these are stopped like the rest. obstacles: kinds (O,),
    sizes (O, 3), frames Q (O, 3, 3), c (O, 3), levels (O,): distances below which they press, cores (O,): distances that
    are never reached. mesh: as `shapes.triangles` takes it; rods: as `strand.nearest_on_strand` takes them; None where there
    is none, which is another compiled version. rows (K, COLUMNS), owners (K,): written, up to `room`.
    Returns (points wanted, smallest distance - core, its entry, its xi).
    """
    A = conn.shape[1]
    kinds, sizes, Q, c, levels, cores = obstacles
    C, y, slope, out = np.empty((A, 3)), np.empty(3), np.empty(3), np.empty(OUT)
    count, nearest, where, place, n_cell = 0, np.inf, -1, 0.0, 0
    longest = 0
    for m in range(entries.shape[0]):
        longest = max(longest, entries[m, 3] - entries[m, 2])
    cell_list, piece_list = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=np.int64)
    for m in range(entries.shape[0]):
        cell, o, first, last = entries[m]
        e, number = cells[cell]
        kind, size, level, few = kinds[o], sizes[o], levels[o], mesh
        element_polynomial(conn[e], coefficients, r, Q[o], c[o], C)
        out[17] = -1.0
        begin, end = number / counts[e], (number + 1) / counts[e]
        if mesh is not None and kind == MESH:
            place_at(C, begin, y, slope)
            y0, y1, y2 = y[0], y[1], y[2]
            look(C, 0.5 * (begin + end), kind, size, mesh, rods, first, last, y, slope, out)
            half = BENT * sqrt((y[0] - y0) ** 2 + (y[1] - y1) ** 2 + (y[2] - y2) ** 2)
            if out[0] - half >= level and out[0] - half - cores[o] >= nearest:
                continue
            last = shorten(mesh, first, last, y, out[0] + 2.0 * half, cell_list)
            first, few = 0, (mesh[0], mesh[1], cell_list, mesh[3], mesh[4], mesh[5])
            out[17] = -1.0
        look(C, end, kind, size, few, rods, first, last, y, slope, out)
        g1, f1, y0, y1, y2 = out[0], out[13], y[0], y[1], y[2]
        b = begin
        look(C, b, kind, size, few, rods, first, last, y, slope, out)
        gb, fb = out[0], out[13]
        if mesh is not None and kind == MESH:
            pieces, n_cell = pieces_over(few, first, last, h[e] / counts[e]), last
        elif rods is None and gb < level and g1 < level:
            pieces = 1
        else:
            chord = sqrt((y[0] - y0) ** 2 + (y[1] - y1) ** 2 + (y[2] - y2) ** 2)
            pieces = (ON_STRAND if rods is not None else ON_SHAPE) if gb + g1 - BENT * chord < 2.0 * level else 1
        for piece in range(pieces):
            a, ga, fa = b, gb, fb
            b = begin + (end - begin) * (piece + 1) / pieces if piece + 1 < pieces else end
            if mesh is not None and kind == MESH:
                place_at(C, a, y, slope)
                y0, y1, y2 = y[0], y[1], y[2]
                out[17] = -1.0
                few = (mesh[0], mesh[1], cell_list, mesh[3], mesh[4], mesh[5])
                look(C, 0.5 * (a + b), kind, size, few, rods, first, n_cell, y, slope, out)
                half = BENT * sqrt((y[0] - y0) ** 2 + (y[1] - y1) ** 2 + (y[2] - y2) ** 2)
                last = shorten(few, first, n_cell, y, out[0] + 2.0 * half, piece_list)
                few = (mesh[0], mesh[1], piece_list, mesh[3], mesh[4], mesh[5])
                out[17] = -1.0
            if piece + 1 < pieces:
                look(C, b, kind, size, few, rods, first, last, y, slope, out)
                gb, fb = out[0], out[13]
            else:
                gb, fb = g1, f1
            for k in range(2):  # of no length in itself
                w = tips[cell, k]
                if w > 0.0 and piece == (0 if k == 0 else pieces - 1) and (ga if k == 0 else gb) < level:
                    xi = a if k == 0 else b
                    count = add_stretch(
                        C, xi, xi + w / h[e], h[e], X_1, W_1, Q[o], kind, size, few, rods, first, last, y, slope, out,
                        count, m, rows, owners,
                    )  # fmt: skip
            bottom, g = a if ga < gb else b, min(ga, gb)
            inner_minimum = fa < 0.0 < fb
            if inner_minimum:
                flat = FLAT * (level - cores[o])
                bottom = lowest(C, a, b, fa, fb, flat, kind, size, few, rods, first, last, y, slope, out)
                g = min(g, out[0])
            if g - cores[o] < nearest:
                nearest, where, place = g - cores[o], m, bottom
            if g >= level or (ga >= level and gb >= level and not inner_minimum):
                continue
            low, high = a, b
            if ga >= level:
                low = root(C, bottom, a, level, kind, size, few, rods, first, last, y, slope, out)
            if gb >= level:
                high = root(C, bottom, b, level, kind, size, few, rods, first, last, y, slope, out)
            whole = ga < level and gb < level and not inner_minimum
            middle = bottom if inner_minimum else low
            X, W = X_4, W_4
            if whole:
                X, W = (X_3, W_3) if rods is None else (X_2, W_2)
            for k in range(2):
                count = add_stretch(
                    C, low if k == 0 else middle, middle if k == 0 else high, h[e], X, W, Q[o], kind, size, few, rods,
                    first, last, y, slope, out, count, m, rows, owners,
                )  # fmt: skip
    return count, nearest, where, place


@kernel
def cell_balls(cells, counts, conn, coefficients, r, Q, c, middle, radius):
    """Middle (n, 3) and radius (n,) of a ball about each cell, in a frame."""
    A = conn.shape[1]
    C, y, slope = np.empty((A, 3)), np.empty(3), np.empty(3)
    for m in range(cells.shape[0]):
        e, number = cells[m]
        element_polynomial(conn[e], coefficients, r, Q, c, C)
        place_at(C, (number + 0.5) / counts[e], middle[m], slope)
        largest = 0.0
        for k in range(2):
            place_at(C, (number + k) / counts[e], y, slope)
            square = (y[0] - middle[m, 0]) ** 2 + (y[1] - middle[m, 1]) ** 2 + (y[2] - middle[m, 2]) ** 2
            largest = max(largest, square)
        radius[m] = 1.05 * sqrt(largest)


@kernel
def far_from(kind, size, middle, out):
    """Distance out (n,) of points (n, 3) from a closed-form shape, in its frame."""
    row = np.empty(OUT)
    for m in range(middle.shape[0]):
        closed_form(kind, size, middle[m], row)
        out[m] = row[0]


@inner
def room(distance, core, n0, n1, n2, d, part, spare):
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
def largest_step(entries, cells, counts, conn, coefficients, r, moved, obstacles, Q1, c1, mesh, part, spare):
    """Part of the way from r to moved (N, 3), with obstacles going from Q, c to Q1, c1, on which no gap closes.

    Along each cell, at both ends and two places between, the gap distance - core may close by `part` of itself towards
    each convex piece of the obstacle: a triangle, a solid; a torus is met by short stretches of which each stays away.
    """
    A = conn.shape[1]
    kinds, sizes, Q, c, _, cores = obstacles
    C, D, y, d, slope, out = np.empty((A, 3)), np.empty((A, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(OUT)
    alpha = 1.0
    for m in range(entries.shape[0]):
        cell, o, first, last = entries[m]
        core = cores[o]
        e, number = cells[cell]
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
                    if beyond(mesh, j, y, far):
                        continue
                    out[17] = -1.0
                    triangles(mesh, j, j + 1, y, out)
                    alpha = min(alpha, room(out[0], core, out[1], out[2], out[3], d, part, spare))
            elif kinds[o] == TORUS:
                alpha = min(alpha, stretches(kinds[o], sizes[o], y, d, core, part, out))
            else:
                closed_form(kinds[o], sizes[o], y, out)
                alpha = min(alpha, room(out[0], core, out[1], out[2], out[3], d, part, spare))
    return alpha


@inner
def stretches(kind, size, y, d, core, part, out):
    """As `room` for a torus: stretches short against its hole, each with a bound of second order on its distance."""
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
def longest_chord(cells, counts, conn, coefficients, r, radius):
    """Longest chord of a cell, in parts of its radius (n,)."""
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


@kernel
def turned(q, q0, theta, T):
    """Rotation vectors theta (N, 3), in space, from attitudes q0 to q (N, 4), and T (N, 3, 3), their change with a spin.

    T phi is the change of theta under the body rotation vector phi: inverse left tangent map times R.
    """
    R = np.empty((3, 3))
    for k in range(q.shape[0]):
        a0, a1, a2, a3 = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
        b0, b1, b2, b3 = q0[k, 0], -q0[k, 1], -q0[k, 2], -q0[k, 3]
        t0, t1, t2 = log_quaternion(
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        )
        theta[k, 0], theta[k, 1], theta[k, 2] = t0, t1, t2
        rotation_matrix(a0, a1, a2, a3, R)
        angle2 = t0 * t0 + t1 * t1 + t2 * t2
        # 1 - theta/2 x + f theta x theta x
        if angle2 < 1e-4:
            f = 1.0 / 12.0 + angle2 / 720.0
        else:
            half = 0.5 * sqrt(angle2)
            f = (1.0 - half * np.cos(half) / np.sin(half)) / angle2
        for j in range(3):
            v0, v1, v2 = R[0, j], R[1, j], R[2, j]
            c0, c1, c2 = t1 * v2 - t2 * v1, t2 * v0 - t0 * v2, t0 * v1 - t1 * v0
            e0, e1, e2 = t1 * c2 - t2 * c1, t2 * c0 - t0 * c2, t0 * c1 - t1 * c0
            T[k, 0, j] = v0 - 0.5 * c0 + f * e0
            T[k, 1, j] = v1 - 0.5 * c1 + f * e1
            T[k, 2, j] = v2 - 0.5 * c2 + f * e2


@inner
def rotation_matrix(a0, a1, a2, a3, R):
    R[0, 0] = 1.0 - 2.0 * (a2 * a2 + a3 * a3)
    R[0, 1] = 2.0 * (a1 * a2 - a0 * a3)
    R[0, 2] = 2.0 * (a1 * a3 + a0 * a2)
    R[1, 0] = 2.0 * (a1 * a2 + a0 * a3)
    R[1, 1] = 1.0 - 2.0 * (a1 * a1 + a3 * a3)
    R[1, 2] = 2.0 * (a2 * a3 - a0 * a1)
    R[2, 0] = 2.0 * (a1 * a3 - a0 * a2)
    R[2, 1] = 2.0 * (a2 * a3 + a0 * a1)
    R[2, 2] = 1.0 - 2.0 * (a1 * a1 + a2 * a2)


@inner
def slide(u, mu, elastic, m, M):
    """Friction per pressure m (3,) of an elastic slip u (3,), opposed by it, and its change M (3, 3) with u.

    What is about to slip counts as slipping in M: a step begins where the last one left it, at its limit.
    """
    size = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    slipping = size > ABOUT_TO_SLIP * elastic
    f = mu / max(size, elastic)
    for i in range(3):
        m[i] = f * u[i]
        for j in range(3):
            M[i, j] = -f * u[i] * u[j] / (size * size) if slipping else 0.0
        M[i, i] += f


@kernel
def press(
    rows, element, slot, conn, coefficients, r, law, friction, kept, away, theta, T, R, exact, force, stiffness, found
):
    """Residual force (S, A, 6) and, if not empty, stiffness (S, 6 A, 6 A) of contact at points, for touched elements.

    rows: of `find`; element, slot (K,): of each point; law (5,): core radius (distance at which the barrier is infinite),
    range, scale, stiffness and depth of a compliant layer; friction (3,): mu, elastic slip, lever (radius of the rod).
    kept (K, 3): slip kept from before; away (N, 3): way of each node relative to the part since then; theta, T, R: of
    `turned`, rotation matrices. Empty without friction. exact: keep the part of the stiffness that pressure has by the
    curvature of the obstacle. found (K, 8): written, pressure, friction per pressure (3), slip (3), potential.
    Returns the largest weight times stiffness [N/m].
    """
    A = conn.shape[1]
    N, m, n, u, z, turn = np.empty(A), np.zeros(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    M, H, X, F = np.zeros((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    XR, nm, U = np.empty((3, 3)), np.zeros(3), np.empty((3, 3))
    core, G, P, soft, depth = law
    mu, elastic, lever = friction
    rubs, tangent, stiffest = mu > 0.0, stiffness.shape[0] > 0, 0.0
    for k in range(rows.shape[0]):
        e, s, w = element[k], slot[k], rows[k, 1]
        p, stiff, psi = barrier(rows[k, 2] - core, G, P)
        if soft > 0.0:
            p1, k1, psi1 = layer(core + G + depth - rows[k, 2], soft, G)
            p, stiff, psi = p + p1, stiff + k1, psi + psi1
        stiffest = max(stiffest, w * stiff)
        t = rows[k, 0] - 0.5
        for a in range(A):
            value = 0.0
            for j in range(A - 1, -1, -1):
                value = value * t + coefficients[j, a]
            N[a] = value
        for i in range(3):
            n[i] = rows[k, 3 + i]
            for j in range(3):
                H[i, j] = rows[k, 6 + 3 * i + j]
        if rubs:
            for i in range(3):
                z[i], turn[i] = kept[k, i], 0.0
                for a in range(A):
                    z[i] += N[a] * away[conn[e, a], i]
                    turn[i] += N[a] * theta[conn[e, a], i]
            nz = n[0] * z[0] + n[1] * z[1] + n[2] * z[2]
            u[0] = z[0] - n[0] * nz - lever * (turn[1] * n[2] - turn[2] * n[1])
            u[1] = z[1] - n[1] * nz - lever * (turn[2] * n[0] - turn[0] * n[2])
            u[2] = z[2] - n[2] * nz - lever * (turn[0] * n[1] - turn[1] * n[0])
            slide(u, mu, elastic, m, M)
            nm[0] = n[1] * m[2] - n[2] * m[1]
            nm[1] = n[2] * m[0] - n[0] * m[2]
            nm[2] = n[0] * m[1] - n[1] * m[0]
            for i in range(3):
                found[k, 4 + i] = u[i]
        found[k, 0], found[k, 7] = p, psi
        for i in range(3):
            found[k, 1 + i] = m[i]
        for a in range(A):
            f = w * N[a] * p
            for i in range(3):
                force[s, a, i] += f * (m[i] - n[i])
            if rubs:
                node = conn[e, a]
                for i in range(3):
                    total = 0.0
                    for j in range(3):
                        total += R[node, j, i] * nm[j]
                    force[s, a, 3 + i] -= lever * f * total
        if not tangent:
            continue
        bend = p if exact else 0.0
        if not rubs:
            for i in range(3):
                for j in range(3):
                    F[i, j] = w * (stiff * n[i] * n[j] - bend * H[i, j])
            add_translations(stiffness[s], N, F)
            continue
        # change of the slip: X dx + lever n x dtheta
        for j in range(3):
            Hz = H[0, j] * z[0] + H[1, j] * z[1] + H[2, j] * z[2]
            for i in range(3):
                X[i, j] = -n[i] * n[j] - nz * H[i, j] - n[i] * Hz
            X[j, j] += 1.0
            X[0, j] -= lever * (turn[1] * H[2, j] - turn[2] * H[1, j])
            X[1, j] -= lever * (turn[2] * H[0, j] - turn[0] * H[2, j])
            X[2, j] -= lever * (turn[0] * H[1, j] - turn[1] * H[0, j])
        for i in range(3):
            for j in range(3):
                XR[i, j] = M[i, 0] * X[0, j] + M[i, 1] * X[1, j] + M[i, 2] * X[2, j]
                F[i, j] = stiff * n[i] * n[j] - bend * H[i, j] - stiff * m[i] * n[j] + p * XR[i, j]
        # moment -lever n x (p m): change with dx
        for j in range(3):
            v0, v1, v2 = (
                p * XR[0, j] - stiff * m[0] * n[j],
                p * XR[1, j] - stiff * m[1] * n[j],
                p * XR[2, j] - stiff * m[2] * n[j],
            )
            U[0, j] = -lever * (n[1] * v2 - n[2] * v1 + p * (H[1, j] * m[2] - H[2, j] * m[1]))
            U[1, j] = -lever * (n[2] * v0 - n[0] * v2 + p * (H[2, j] * m[0] - H[0, j] * m[2]))
            U[2, j] = -lever * (n[0] * v1 - n[1] * v0 + p * (H[0, j] * m[1] - H[1, j] * m[0]))
        add_rubbing(stiffness[s], N, conn[e], w, p, lever, n, M, nm, F, U, T, R)
    return stiffest


@inner
def add_translations(K, N, F):
    for a in range(N.shape[0]):
        for b in range(N.shape[0]):
            f = N[a] * N[b]
            for i in range(3):
                for j in range(3):
                    K[6 * a + i, 6 * b + j] += f * F[i, j]


@inner
def add_rubbing(K, N, nodes, w, p, lever, n, M, nm, F, U, T, R):
    """All four 3x3 blocks of each pair of nodes: force and moment, with displacement and rotation."""
    A = N.shape[0]
    D, V = np.empty((3, 3)), np.empty((3, 3))
    for b in range(A):
        node = nodes[b]
        # slip by the rotation: lever n x T phi; friction p M of it; moment -lever n x of that
        for j in range(3):
            t0, t1, t2 = T[node, 0, j], T[node, 1, j], T[node, 2, j]
            s0, s1, s2 = n[1] * t2 - n[2] * t1, n[2] * t0 - n[0] * t2, n[0] * t1 - n[1] * t0
            for i in range(3):
                D[i, j] = lever * p * (M[i, 0] * s0 + M[i, 1] * s1 + M[i, 2] * s2)
            V[0, j] = -lever * (n[1] * D[2, j] - n[2] * D[1, j])
            V[1, j] = -lever * (n[2] * D[0, j] - n[0] * D[2, j])
            V[2, j] = -lever * (n[0] * D[1, j] - n[1] * D[0, j])
        for a in range(A):
            f, mine = w * N[a] * N[b], nodes[a]
            for j in range(3):
                for i in range(3):
                    K[6 * a + i, 6 * b + j] += f * F[i, j]
                    K[6 * a + i, 6 * b + 3 + j] += f * D[i, j]
                    K[6 * a + 3 + i, 6 * b + j] += f * (
                        R[mine, 0, i] * U[0, j] + R[mine, 1, i] * U[1, j] + R[mine, 2, i] * U[2, j]
                    )
                    K[6 * a + 3 + i, 6 * b + 3 + j] += f * (
                        R[mine, 0, i] * V[0, j] + R[mine, 1, i] * V[1, j] + R[mine, 2, i] * V[2, j]
                    )
        # the moment is seen in the axes of its own section, R^T v: half of its change (R^T v) x phi, as for all tangents
        f = -0.5 * w * N[b] * lever * p
        v0 = f * (R[node, 0, 0] * nm[0] + R[node, 1, 0] * nm[1] + R[node, 2, 0] * nm[2])
        v1 = f * (R[node, 0, 1] * nm[0] + R[node, 1, 1] * nm[1] + R[node, 2, 1] * nm[2])
        v2 = f * (R[node, 0, 2] * nm[0] + R[node, 1, 2] * nm[1] + R[node, 2, 2] * nm[2])
        o = 6 * b + 3
        K[o, o + 1] -= v2
        K[o, o + 2] += v1
        K[o + 1, o] += v2
        K[o + 1, o + 2] -= v0
        K[o + 2, o] -= v1
        K[o + 2, o + 1] += v0
