"""Where does a rod touch? Gauss points of the stretches on which the gap is below the range of the law.

Rule: a rod is its centreline x(xi), a polynomial in each element, and a radius. Elements are cut into cells about a radius
long. Along a cell the stretches in which the gap is below the range of the law are found exactly (roots of gap - range), and
each gets a rule of its own: a crossing whose patch is a tenth of a radius is integrated as well as a whole rod on a plane,
and nothing jumps while a patch moves over cells or elements. A stretch that begins or ends goes from its smallest gap
outwards, so that the barrier is felt there.

A rod bent to a wave, or another rod that has a kink, may come near at two places of one cell. A piece is halved until the
distances at its ends and their slopes leave no room for a second smallest one.

Over a mesh a cell is cut into pieces about half as long as a facet is wide. Only the facets that may be the nearest
somewhere on a piece are looked at along it. Along an edge the nearest place stays on it for a while, as the rod is thick,
and the gap is bent there: that stretch and those beside it have rules of their own, so that sums do not jump when a piece
comes into touch. Jumps of a hundredth of what a cell bears, as with rules over the whole piece, are enough that a rope
which slips over five hundred facets with friction finds no equilibrium; now they are 1e-4, and a thousand facets do.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from . import fused, kernel, lean
from .shapes import MESH, TORUS, beyond, closed_form, over_facet, triangles
from .strand import element_polynomial, nearest_on_strand, place_at

# columns of a point: xi, weight, distance, n (3); then of a part H (6, its upper triangle by rows), of another rod cell, xi,
# slope (3), second derivative (3), and 1 if it is free to slide along
COLUMNS, OUT = 15, 26
MOST_PIECES = 32  # of a cell over small facets
# pieces of a cell that may touch another rod or a torus; longest arc of a cell over its chord
ON_STRAND, BENT = 2, 1.1
SHALLOW = 0.05  # part of the range: a second smallest gap in a piece may be so much lower than its ends
FINEST = 1.0 / 32.0  # part of a cell: shorter pieces are not cut for that
FLAT = 1e-10  # of the range of the law: a change of the gap that does not count
SLOW = 2  # steps in turn that do not halve the stretch on which the smallest gap is
# Gauss rules on 0 .. 1: four points of whole pieces; of a stretch that begins or ends four from the smallest gap on, which
# is one of them (Radau): at a kink no other point would see it. Over fine facets three where an edge is nearest and three
# of what is beside it
X_1, W_1 = np.array([0.0]), np.array([1.0])
X_4, W_4 = (
    np.array([0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262]),
    np.array([0.17392742256872679, 0.3260725774312732, 0.3260725774312732, 0.17392742256872679]),
)
X_END, W_END = (
    np.array([0.0, 0.2123405382391529, 0.5905331355592653, 0.9114120404872962]),
    np.array([0.0625, 0.32884431998006, 0.38819346884317135, 0.22046221117676554]),
)
X_3, W_3 = (
    np.array([0.1127016653792583, 0.5, 0.8872983346207417]),
    np.array([0.2777777777777778, 0.4444444444444444, 0.2777777777777778]),
)
X_END_3, W_END_3 = (
    np.array([0.0, 0.3550510257216822, 0.8449489742783178]),
    np.array([0.1111111111111111, 0.5124858261884216, 0.37640306270046725]),
)


@fused
def look(C, xi, on, facets, rods, at):
    """Distance and its derivatives at xi; out[13]: the derivative along the rod."""
    kind, size, index, first, last = on
    y, slope, out = at
    place_at(C, xi, y, slope)
    if rods is not None:
        nearest_on_strand(y, rods, first, last, out)
    elif facets is not None:
        if kind == MESH:
            triangles(facets, index, first, last, y, out)
        else:
            closed_form(kind, size, y, out)
    else:
        closed_form(kind, size, y, out)
    out[13] = out[1] * slope[0] + out[2] * slope[1] + out[3] * slope[2]


@fused
def root(C, inside, outside, level, on, facets, rods, at):
    """Where the distance equals `level`, between a place where it is below and one where it is not."""
    a, b, out = inside, outside, at[2]
    xi = 0.5 * (a + b)
    for _ in range(80):
        look(C, xi, on, facets, rods, at)
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


@fused
def lowest(C, a, b, fa, fb, flat, on, facets, rods, at):
    """Place of the smallest distance, but for `flat`, between a and b, where the derivative fa < 0 < fb.

    Goes where the last two derivatives say, if that is between a and b, or else half way: over an edge it is nearly a step.
    """
    x0, f0, x1, f1, out, slow = a, fa, b, fb, at[2], 0
    for _ in range(60):
        width = b - a
        xi = x1 - f1 * (x1 - x0) / (f1 - f0)
        if not a < xi < b or slow > SLOW:
            xi = 0.5 * (a + b)
        look(C, xi, on, facets, rods, at)
        x0, f0, x1, f1 = x1, f1, xi, out[13]
        if abs(f1) * width < flat:
            break
        if f1 < 0.0:
            a = xi
        else:
            b = xi
        slow = slow + 1 if b - a > 0.5 * width else 0
    return x1


@fused
def edge_in(C, a, b, ga, gb, fa, fb, tilt, flat, on, facets, rods, at):
    """As `lowest`, over facets, of the distance less tilt times xi; ga, gb, fa, fb: distances and derivatives at the ends.

    Where the tangents at the ends meet, or on an edge where its own curvature says.
    """
    slope, out = at[1], at[2]
    ga, gb, fa, fb = ga - tilt * a, gb - tilt * b, fa - tilt, fb - tilt
    xi, f, bent, slow = a, fa, 0.0, 0
    for _ in range(60):
        width = b - a
        xi = xi - f / bent if bent * width > fb - fa else (ga - fa * a - gb + fb * b) / (fb - fa)
        if not a < xi < b or slow > SLOW:
            xi = 0.5 * (a + b)
        look(C, xi, on, facets, rods, at)
        f, bent = out[13] - tilt, 0.0
        for i in range(3):
            bent += slope[i] * (out[4 + 3 * i] * slope[0] + out[5 + 3 * i] * slope[1] + out[6 + 3 * i] * slope[2])
        if abs(f) * width < flat or f * f < flat * bent:
            break
        if f < 0.0:
            a, ga, fa = xi, out[0] - tilt * xi, f
        else:
            b, gb, fb = xi, out[0] - tilt * xi, f
        slow = slow + 1 if b - a > 0.5 * width else 0
    return xi


@fused
def add_stretch(C, a, b, h, X, W, Q, on, facets, rods, at, count, entry, rows, owners):
    """Gauss points of the stretch from a to b as rows, turned by Q; returns the new count, which may exceed the room."""
    if a == b:
        return count
    out = at[2]
    for k in range(X.shape[0]):
        if count < rows.shape[0]:
            xi = a + (b - a) * X[k]
            look(C, xi, on, facets, rods, at)
            row = rows[count]
            row[0], row[1], row[2] = xi, W[k] * abs(b - a) * h, out[0]
            for i in range(3):
                row[3 + i] = Q[i, 0] * out[1] + Q[i, 1] * out[2] + Q[i, 2] * out[3]
            if rods is not None:
                for i in range(9):
                    row[6 + i] = out[17 + i]
            else:
                column = 6
                for i in range(3):
                    h0 = Q[i, 0] * out[4] + Q[i, 1] * out[7] + Q[i, 2] * out[10]
                    h1 = Q[i, 0] * out[5] + Q[i, 1] * out[8] + Q[i, 2] * out[11]
                    h2 = Q[i, 0] * out[6] + Q[i, 1] * out[9] + Q[i, 2] * out[12]
                    for j in range(i, 3):
                        row[column] = h0 * Q[j, 0] + h1 * Q[j, 1] + h2 * Q[j, 2]
                        column += 1
            owners[count] = entry
        count += 1
    return count


@lean
def sag(C, a, b):
    """How far the rod bends off its chord between a and b: its largest second derivative, at three places."""
    most = 0.0
    for k in range(3):
        t = a + 0.5 * k * (b - a) - 0.5
        square = 0.0
        for i in range(3):
            value = 0.0
            for j in range(C.shape[0] - 1, 1, -1):
                value = value * t + j * (j - 1) * C[j, i]
            square += value * value
        most = max(most, square)
    return 0.125 * sqrt(most) * (b - a) * (b - a)


@fused
def way_to(C, a, b, y, slope):
    """Longest way that the rod may make from a to b, as it may be bent; y and slope are then those at b."""
    place_at(C, a, y, slope)
    y0, y1, y2 = y[0], y[1], y[2]
    place_at(C, b, y, slope)
    return BENT * sqrt((y[0] - y0) ** 2 + (y[1] - y1) ** 2 + (y[2] - y2) ** 2)


@lean
def size_of(v):
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@lean
def strand_sag(slope, out):
    """How far the strand at the place in `out` bends off its chord, on a stretch as long as this slope."""
    part = size_of(slope) / max(size_of(out[19:22]), 1e-300)
    return 0.125 * size_of(out[22:25]) * part * part


@lean
def hole_sag(C, a, way, radius, y, slope):
    """As `sag`, how much less convex the distance from a torus is in its hole, along a way from a to y: the nearest place
    turns about the axis, with a curvature of one over the distance from that."""
    b0, b1 = y[0], y[1]
    place_at(C, a, y, slope)
    nearest = 0.5 * (sqrt(b0 * b0 + b1 * b1) + sqrt(y[0] * y[0] + y[1] * y[1]) - way)
    return 0.125 * way * way / max(nearest, 1e-6 * way) if nearest < radius else 0.0


@lean
def may_dip(bend, ga, gb, fa, fb, level, shallow):
    """True if on a piece there may be a smallest distance below `level` that its ends do not tell, by more than `shallow`.

    ga, gb, fa, fb: distances and their derivatives at the ends; bend: how far the piece bends off its chord. The distance
    from a convex body is a convex function of the place: along a curve its second derivative is no less than that of the
    curve, with a minus. So it lies above a parabola from either end; where these two meet they are lowest.
    """
    least, slopes = min(ga, gb), fb - fa + 8.0 * bend
    if not max(ga, gb) < np.inf or (bend <= shallow and fa < 0.0 < fb):
        return False
    t = min(max((ga - gb + fb + 4.0 * bend) / slopes, 0.0), 1.0) if slopes > 0.0 else 0.5
    low = ga + fa * t - 4.0 * bend * t * t
    return low < level and least - low > shallow


@lean
def pieces_over(facets, index, n, length):
    """Into how many pieces a cell is cut so that each lies over one facet: along every one the rod may come near."""
    total = 0.0
    for k in range(n):
        total += facets[index[k], 26]
    width = total / max(n, 1)
    return int(min(max(np.ceil(2.0 * length / max(width, 1e-300)), 1.0), MOST_PIECES))


@lean
def shorten(balls, index, first, last, y, far, short):
    """Write to `short` the triangles index[first:last] whose balls are nearer to y than `far`; how many."""
    n = 0
    for k in range(first, last):
        if not beyond(balls, index[k], y, far):
            short[n] = index[k]
            n += 1
    return n


@lean
def along_piece(facets, index, count, y, far, short):
    """Write to `short` the triangles index[:count] that may be nearer to y than `far`; how many."""
    n = 0
    for k in range(count):
        if over_facet(facets, index[k], y) <= far * far:
            short[n] = index[k]
            n += 1
    return n


@kernel
def find(entries, line, tips, h, r, obstacles, mesh, rods, rows, owners, runs):
    """Gauss points of all stretches on which an obstacle presses.

    entries (M, 4): cell, obstacle, and where its triangles or the cells of its strand begin and end; line: see `clearance`;
    tips (n, 2) [m]: length that counts at the very end of a rod or at a kink, where a cell begins or ends with it, so that
    these are stopped like the rest; h (E,) [m]: lengths of elements. obstacles: kinds (O,), sizes (O, 3), frames Q
    (O, 3, 3), c (O, 3), levels (O,): distances below which they press, cores (O,): distances that are never reached. mesh:
    facets, the triangles that entries name, and balls, as `shapes.facets` makes them; rods: as `strand.nearest_on_strand`
    takes them; None where there is none, which is another compiled version. rows (K, COLUMNS), owners (3, K), element, cell
    and obstacle of each point: written, as far as there is room. runs (M + 1,): where the points of each touched element
    begin, and end.
    Returns (points wanted, touched elements, smallest distance - core, its entry, its xi).
    """
    C = np.empty((line[2].shape[1], 3))
    longest = 0
    for m in range(entries.shape[0]):
        longest = max(longest, entries[m, 3] - entries[m, 2])
    lists = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=np.int64)
    at = np.empty(3), np.empty(3), np.empty(OUT)
    sides = np.empty((2, 3))
    count, nearest, where, place = go_along(
        entries, line, tips, h, r, obstacles, mesh, rods, rows, owners[0], C, lists, at, sides
    )  # fmt: skip
    touched = name_owners(entries, line[0], min(count, rows.shape[0]), owners, runs)
    return count, touched, nearest, where, place


@lean
def name_owners(entries, cells, count, owners, runs):
    """Element, cell and obstacle of each point, whose entry is in owners[0]; number of touched elements, and their runs."""
    touched, before = 0, -1
    for k in range(count):
        m = owners[0, k]
        cell = entries[m, 0]
        e = cells[cell, 0]
        owners[0, k], owners[1, k], owners[2, k] = e, cell, entries[m, 1]
        if e != before:
            runs[touched] = k
            touched += 1
            before = e
    runs[touched] = count
    return touched


@lean
def go_along(entries, line, tips, h, r, obstacles, mesh, rods, rows, owners, C, lists, at, sides):
    """What `find` does, with room for the polynomial of an element, lists of triangles, a place with its distance, and
    normals at both ends of a piece (2, 3)."""
    cells, counts, conn, coefficients = line
    kinds, sizes, Q, c, levels, cores = obstacles
    of_cell, of_piece = lists
    y, slope, out = at
    count, nearest, where, place, n_cell = 0, np.inf, -1, 0.0, 0
    few, facets = of_cell, None
    if mesh is not None:
        facets, index, balls = mesh
    e_before = o_before = cell_before = -1  # whose polynomial is known, and the distance at its end
    gb = fb = g1 = f1 = 0.0
    out[17] = -1.0
    for m in range(entries.shape[0]):
        cell, o, first, last = entries[m, 0], entries[m, 1], entries[m, 2], entries[m, 3]
        e, number = cells[cell, 0], cells[cell, 1]
        kind, size, level = kinds[o], sizes[o], levels[o]
        if e != e_before or o != o_before:
            element_polynomial(conn[e], coefficients, r, Q[o], c[o], C)
        if rods is not None or o != o_before:
            out[17] = -1.0
        goes_on = rods is None and o == o_before and e == e_before and cell == cell_before + 1
        e_before, o_before, cell_before = e, o, -1
        begin, end = number / counts[e], (number + 1) / counts[e]
        faceted = mesh is not None and kind == MESH
        if faceted:
            middle = 0.5 * (begin + end)
            half = way_to(C, begin, middle, y, slope)
            triangles(facets, index, 0, 0, y, out)  # the last nearest one alone, or none
            n_cell = shorten(balls, index, first, last, y, out[0] + 2.0 * half, of_cell)
            look(C, middle, (kind, size, of_cell, 0, n_cell), facets, rods, at)
            if out[0] - half >= level and out[0] - half - cores[o] >= nearest:
                continue
            # its ends are looked at from its pieces, which know fewer triangles
            first, pieces, off, now = 0, pieces_over(facets, of_cell, n_cell, h[e] / counts[e]), 0.0, 0
        else:
            pieces, on = 1, (kind, size, few, first, last)
            if not goes_on:
                look(C, begin, on, facets, rods, at)
                gb, fb = out[0], out[13]
            off, now = (strand_sag(slope, out), int(out[17])) if rods is not None else (0.0, 0)
            look(C, end, on, facets, rods, at)
            g1, f1 = out[0], out[13]
            if (rods is not None or kind == TORUS) and gb + g1 - way_to(C, begin, end, y, slope) < 2.0 * level:
                pieces = ON_STRAND
        cell_before, b, goal, piece, fine = cell, begin, begin, 0, faceted and pieces > 1
        bend, shallow, flat = -1.0, SHALLOW * (level - cores[o]), FLAT * (level - cores[o])
        while b < end:
            a = b
            if a == goal:
                piece += 1
                goal = begin + (end - begin) * piece / pieces if piece < pieces else end
                if faceted:
                    half = way_to(C, a, 0.5 * (a + goal), y, slope)
                    triangles(facets, index, 0, 0, y, out)  # the last nearest one alone: no nearer than the nearest
                    last, few = along_piece(facets, of_cell, n_cell, y, out[0] + 2.0 * half, of_piece), of_piece
                on = (kind, size, few, first, last)
                if faceted and a == begin and not goes_on:
                    look(C, a, on, facets, rods, at)
                    gb, fb = out[0], out[13]
                    sides[1, 0], sides[1, 1], sides[1, 2] = out[1], out[2], out[3]
            b, ga, fa, then, kinked = goal, gb, fb, now, False
            sides[0, 0], sides[0, 1], sides[0, 2] = sides[1, 0], sides[1, 1], sides[1, 2]
            while True:
                w = b - a
                if faceted or rods is not None or b < end:
                    look(C, b, on, facets, rods, at)
                    gb, fb = out[0], out[13]
                    sides[1, 0], sides[1, 1], sides[1, 2] = out[1], out[2], out[3]
                    if rods is not None:
                        off, now = max(off, strand_sag(slope, out)), int(out[17])
                        # elements meet in a kink, and on its inner side there is a smallest distance from either
                        kinked = cells[now, 0] != cells[then, 0] and ga + gb - BENT * w * size_of(slope) < 2.0 * level
                else:
                    gb, fb = g1, f1
                hollow = rods is None and not faceted and kind == TORUS
                if w < FINEST * (end - begin) or (rods is not None and pieces == 1):
                    break
                if hollow:
                    way = way_to(C, a, b, y, slope)
                    if ga + gb - way >= 2.0 * level:
                        break
                    off = hole_sag(C, a, way, size[0], y, slope) / (w * w)
                elif fine and min(ga, gb) < level:
                    if max(ga, gb) < level and fa > 0.0 > fb:  # over the middle of a facet it may be out of reach
                        top = a + w * fa / (fa - fb)
                        look(C, top, on, facets, rods, at)
                        if out[0] >= level:
                            b, gb, fb = top, out[0], out[13]
                            sides[1, 0], sides[1, 1], sides[1, 2] = out[1], out[2], out[3]
                    break
                elif ga < level and gb < level:
                    break
                if bend < 0.0:
                    bend = sag(C, begin, end) / (end - begin) ** 2
                if not (kinked or may_dip((bend + off) * w * w, ga, gb, w * fa, w * fb, level, shallow)):
                    break
                b = a + 0.5 * w
            for k in range(2):  # of no length in itself
                tip = tips[cell, k]
                if tip > 0.0 and (a == begin if k == 0 else b == end) and (ga if k == 0 else gb) < level:
                    xi = a if k == 0 else b
                    count = add_stretch(
                        C, xi, xi + tip / h[e], h[e], X_1, W_1, Q[o], on, facets, rods, at, count, m, rows, owners
                    )  # fmt: skip
            bottom, g = a if ga < gb else b, min(ga, gb)
            edge, dips = bottom, fa < 0.0 < fb
            if fine and (
                dips or (fa < fb and g < level)
            ):  # the rod is bent about an edge, if it comes nearest there or not
                tilt = 0.0 if dips else 0.5 * (fa + fb)
                edge = edge_in(C, a, b, ga, gb, fa, fb, tilt, flat, on, facets, rods, at)
                if dips:
                    bottom = edge
            elif dips:
                bottom = lowest(C, a, b, fa, fb, flat, on, facets, rods, at)
            if dips:
                g = min(g, out[0])
            if g - cores[o] < nearest:
                nearest, where, place = g - cores[o], m, bottom
            if g < level:
                count = add_piece(
                    C, a, b, ga < level, gb < level, bottom, edge, level, h[e], fine, sides, Q[o], on, facets,
                    rods, at, count, m, rows, owners,
                )  # fmt: skip
    return count, nearest, where, place


@fused
def over_edge(middle, begin, end, sides, at):
    """Where the nearest place goes on to the edge that `at` tells of, at `middle`, and off it again, between begin and end.

    sides (2, 3): normals of the faces before and after it. The plane through the edge, normal to a face, parts where that is
    nearest from where the edge is; the rod is taken as straight.
    """
    slope, out = at[1], at[2]
    last, next = middle, middle
    for k in range(2):
        cos = out[1] * sides[k, 0] + out[2] * sides[k, 1] + out[3] * sides[k, 2]
        sin2, run = 0.0, 0.0
        for i in range(3):
            across = out[1 + i] - cos * sides[k, i]
            sin2 += across * across
            run += slope[i] * across
        if k == 0 and run > 0.0:
            last = max(begin, middle - out[0] * sin2 / run)
        if k == 1 and run < 0.0:
            next = min(end, middle - out[0] * sin2 / run)
    return last, next


@fused
def add_piece(
    C, a, b, in_a, in_b, bottom, edge, level, h, fine, sides, Q, on, facets, rods, at, count, m, rows, owners
):
    """Gauss points of a piece with its smallest distance, which is below `level`, at `bottom`; in_a, in_b: so are its ends.

    A whole piece has one rule wherever its smallest distance is: nothing jumps when that goes over into the next one. fine:
    over facets, where the piece is split at `edge`, which is what `at` tells of if the piece is whole; see `over_edge`.
    """
    whole = in_a and in_b
    single = whole and not (fine and a < edge < b)
    begin, end, last, next, middle = a, b, a, b, edge
    for k in range(2):
        if not (in_a if k == 0 else in_b):
            far = root(C, bottom, a if k == 0 else b, level, on, facets, rods, at)
            begin, end = (far, end) if k == 0 else (begin, far)
    if not single:
        if not begin < edge < end:
            middle = bottom
        last, next = middle, middle
        if fine:
            if not whole:
                look(C, middle, on, facets, rods, at)
            last, next = over_edge(middle, begin, end, sides, at)
    for k in range(0 if whole else 1, 1 if single else 3 if whole else 5):
        X, W = (X_END_3, W_END_3) if fine else (X_END, W_END)
        if k == 0:  # all of it, or where an edge is nearest
            near, far = last, next
            X, W = (X_3, W_3) if fine else (X_4, W_4)
        elif k < 3:  # beside that
            near, far = (last, begin) if k == 1 else (next, end)
        else:  # from where it comes nearest, so that the barrier is felt there
            near, far = middle, last if k == 3 else next
        count = add_stretch(C, near, far, h, X, W, Q, on, facets, rods, at, count, m, rows, owners)
    return count
