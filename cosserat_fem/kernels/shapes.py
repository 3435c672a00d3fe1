"""Distance from a point to a rigid shape, with unit gradient and Hessian.

Rule: shapes are given in their own frame (`cosserat_fem.shapes`); a distance is signed, negative inside a solid, and has
no sign for triangles. The Hessian of a distance has the principal curvatures of the offset surface through the point as
eigenvalues: 1/d about a point, 1/d across a line, none over a face.

Out (18,): distance, gradient (3), Hessian (9, by rows), one place for the caller, and four for the search among triangles.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from . import fused, lean

PLANE, SPHERE, CYLINDER, CAPSULE, BOX, TORUS, MESH, STRAND = range(8)
FLAT = 1e-12  # in parts of its width: a point beside a triangle by less than this is over it


@lean
def set_gradient(d, n0, n1, n2, out):
    out[0], out[1], out[2], out[3] = d, n0, n1, n2


@lean
def set_hessian(f, out):
    """f (I - n n)."""
    for i in range(3):
        for j in range(3):
            out[4 + 3 * i + j] = -f * out[1 + i] * out[1 + j]
        out[4 + 4 * i] += f


@lean
def clear_hessian(out):
    for i in range(4, 13):
        out[i] = 0.0


@lean
def subtract_axis(f, e0, e1, e2, out):
    """Hessian -= f e e."""
    out[4] -= f * e0 * e0
    out[5] -= f * e0 * e1
    out[6] -= f * e0 * e2
    out[7] -= f * e1 * e0
    out[8] -= f * e1 * e1
    out[9] -= f * e1 * e2
    out[10] -= f * e2 * e0
    out[11] -= f * e2 * e1
    out[12] -= f * e2 * e2


@lean
def from_point(v0, v1, v2, radius, out):
    """Ball of a radius about the foot of v."""
    d = sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    i = 1.0 / max(d, 1e-300)
    set_gradient(d - radius, v0 * i, v1 * i, v2 * i, out)
    set_hessian(i, out)


@lean
def round_about_axis(y0, y1, rho, radial, axial, distance, turn, out):
    """Shape of revolution about z: gradient (radial, axial) in the half plane of the point, curvature `turn` in it."""
    i = 1.0 / max(rho, 1e-300)
    c, s = y0 * i, y1 * i
    set_gradient(distance, radial * c, radial * s, axial, out)
    clear_hessian(out)
    subtract_axis(-turn, -axial * c, -axial * s, radial, out)
    subtract_axis(-radial * i, -s, c, 0.0, out)


@lean
def cylinder(y0, y1, y2, radius, half, out):
    rho = sqrt(y0 * y0 + y1 * y1)
    side, top = rho - radius, abs(y2) - half
    sign = 1.0 if y2 > 0.0 else -1.0
    if side > 0.0 and top > 0.0:
        d = sqrt(side * side + top * top)
        round_about_axis(y0, y1, rho, side / d, sign * top / d, d, 1.0 / d, out)
    elif side > top:
        round_about_axis(y0, y1, rho, 1.0, 0.0, side, 0.0, out)
    else:
        set_gradient(top, 0.0, 0.0, sign, out)
        clear_hessian(out)


@lean
def torus(y0, y1, y2, radius, tube, out):
    rho = sqrt(y0 * y0 + y1 * y1)
    across = rho - radius
    d = max(sqrt(across * across + y2 * y2), 1e-300)
    round_about_axis(y0, y1, rho, across / d, y2 / d, d - tube, 1.0 / d, out)


@lean
def box(y, size, out):
    square, most, axis = 0.0, -np.inf, 0
    for i in range(3):
        v = abs(y[i]) - size[i]
        if v > 0.0:
            square += v * v
        if v > most:
            most, axis = v, i
    if square == 0.0:  # inside, or on a face
        set_gradient(most, 0.0, 0.0, 0.0, out)
        out[1 + axis] = 1.0 if y[axis] > 0.0 else -1.0
        clear_hessian(out)
        return
    d = sqrt(square)
    out[0] = d
    for i in range(3):
        v = abs(y[i]) - size[i]
        out[1 + i] = (v if y[i] > 0.0 else -v) / d if v > 0.0 else 0.0
    for i in range(3):
        for j in range(3):
            out[4 + 3 * i + j] = -out[1 + i] * out[1 + j] / d
        if out[1 + i] != 0.0:
            out[4 + 4 * i] += 1.0 / d


@lean
def closed_form(kind, size, y, out):
    """Distance to a shape given by a formula, in its own frame."""
    y0, y1, y2 = y[0], y[1], y[2]
    if kind == PLANE:
        set_gradient(y2, 0.0, 0.0, 1.0, out)
        clear_hessian(out)
    elif kind == SPHERE:
        from_point(y0, y1, y2, size[0], out)
    elif kind == CYLINDER:
        cylinder(y0, y1, y2, size[0], size[1], out)
    elif kind == CAPSULE:
        along = min(max(y2, -size[1]), size[1])
        from_point(y0, y1, y2 - along, size[0], out)
        if along == y2:
            subtract_axis(1.0 / max(out[0] + size[0], 1e-300), 0.0, 0.0, 1.0, out)
    elif kind == BOX:
        box(y, size, out)
    else:
        torus(y0, y1, y2, size[0], size[1], out)


# of a facet: corner A, normal n, outward normals in its plane of the edges AB, BC, CA, how far the second is from A, the
# edges AB and AC, one over the squares of the lengths of AB, BC, CA, how far beside it a point counts as over it, its width
FACET = 27


def facets(points, triangles):
    """Rows (F, FACET) of triangles (F, 3) with corners in points (P, 3), and balls about them (F, 4): middle and radius."""
    A, B, C = (points[triangles[:, k]] for k in range(3))
    edges = (B - A, C - B, A - C)
    n = np.cross(edges[0], -edges[2])
    area = np.sqrt((n * n).sum(axis=1, keepdims=True))
    n = n / area
    squares = [(e * e).sum(axis=1, keepdims=True) for e in edges]
    out = [np.cross(e, n) / np.sqrt(square) for e, square in zip(edges, squares, strict=True)]
    width = area / np.sqrt(np.maximum(np.maximum(*squares[:2]), squares[2]))
    apart = (out[1] * edges[0]).sum(axis=1, keepdims=True)
    rows = np.concatenate(
        [A, n, *out, apart, edges[0], -edges[2], *(1.0 / square for square in squares), FLAT * width, width], axis=1
    )
    corners = np.stack([A, B, C], axis=1)
    middle = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    radius = np.sqrt(((corners - middle[:, None]) ** 2).sum(axis=2).max(axis=1))
    return rows, np.concatenate([middle, radius[:, None]], axis=1)


@fused
def to_facet(y, rows, m, most, v):
    """Vector v (3,) from the nearest point of a facet to y; returns (distance squared, feature).

    Feature: 0 face, 1 to 3 the edges AB, BC, CA, 4 to 6 the corners A, B, C; -1 if the square is more than `most`, which is
    mostly seen from the planes of the facet and of its edges. The nearest point of a triangle beside which y lies is on an
    edge on whose outer side y is.
    """
    p0, p1, p2 = y[0] - rows[m, 0], y[1] - rows[m, 1], y[2] - rows[m, 2]
    height = p0 * rows[m, 3] + p1 * rows[m, 4] + p2 * rows[m, 5]
    ab = p0 * rows[m, 6] + p1 * rows[m, 7] + p2 * rows[m, 8]
    bc = p0 * rows[m, 9] + p1 * rows[m, 10] + p2 * rows[m, 11] - rows[m, 15]
    ca = p0 * rows[m, 12] + p1 * rows[m, 13] + p2 * rows[m, 14]
    beside = max(ab, bc, ca)
    if beside <= rows[m, 25]:
        v[0], v[1], v[2] = height * rows[m, 3], height * rows[m, 4], height * rows[m, 5]
        return height * height, 0
    if height * height + beside * beside > most:
        return np.inf, -1
    b0, b1, b2 = rows[m, 16], rows[m, 17], rows[m, 18]
    c0, c1, c2 = rows[m, 19], rows[m, 20], rows[m, 21]
    best, feature = np.inf, -1
    if ab > 0.0:
        u = min(max((p0 * b0 + p1 * b1 + p2 * b2) * rows[m, 22], 0.0), 1.0)
        w0, w1, w2 = p0 - u * b0, p1 - u * b1, p2 - u * b2
        best, feature = w0 * w0 + w1 * w1 + w2 * w2, 1 if 0.0 < u < 1.0 else 4 if u == 0.0 else 5
        v[0], v[1], v[2] = w0, w1, w2
    if bc > 0.0:
        e0, e1, e2 = c0 - b0, c1 - b1, c2 - b2
        q0, q1, q2 = p0 - b0, p1 - b1, p2 - b2
        u = min(max((q0 * e0 + q1 * e1 + q2 * e2) * rows[m, 23], 0.0), 1.0)
        w0, w1, w2 = q0 - u * e0, q1 - u * e1, q2 - u * e2
        square = w0 * w0 + w1 * w1 + w2 * w2
        if square < best:
            best, feature = square, 2 if 0.0 < u < 1.0 else 5 if u == 0.0 else 6
            v[0], v[1], v[2] = w0, w1, w2
    if ca > 0.0:
        u = min(max((p0 * c0 + p1 * c1 + p2 * c2) * rows[m, 24], 0.0), 1.0)
        w0, w1, w2 = p0 - u * c0, p1 - u * c1, p2 - u * c2
        square = w0 * w0 + w1 * w1 + w2 * w2
        if square < best:
            best, feature = square, 3 if 0.0 < u < 1.0 else 4 if u == 0.0 else 6
            v[0], v[1], v[2] = w0, w1, w2
    return best, feature


@lean
def over_facet(rows, m, y):
    """Lower bound on the square of the distance of y from a facet: exact over it and beside its edges."""
    p0, p1, p2 = y[0] - rows[m, 0], y[1] - rows[m, 1], y[2] - rows[m, 2]
    height = p0 * rows[m, 3] + p1 * rows[m, 4] + p2 * rows[m, 5]
    ab = p0 * rows[m, 6] + p1 * rows[m, 7] + p2 * rows[m, 8]
    bc = p0 * rows[m, 9] + p1 * rows[m, 10] + p2 * rows[m, 11] - rows[m, 15]
    ca = p0 * rows[m, 12] + p1 * rows[m, 13] + p2 * rows[m, 14]
    beside = max(ab, bc, ca, 0.0)
    return height * height + beside * beside


@lean
def beyond(balls, m, y, distance):
    """True if the ball about a triangle is farther from y than a distance."""
    reach = distance + balls[m, 3]
    d0, d1, d2 = y[0] - balls[m, 0], y[1] - balls[m, 1], y[2] - balls[m, 2]
    return d0 * d0 + d1 * d1 + d2 * d2 > reach * reach


@lean
def triangles(rows, index, first, last, y, out):
    """Distance to the nearest of the triangles index[first:last], of those in `rows` of `facets`.

    out[17]: the triangle that was nearest to the last point, to begin with, or negative; renewed. It need not be one of the
    list if what it belongs to is the same.
    """
    v = out[14:17]
    best, b0, b1, b2, feature, which = np.inf, 0.0, 0.0, 0.0, 0, -1
    guess = int(out[17])
    for j in range(first - 1, last):
        m = guess if j < first else index[j]
        if m < 0 or (j >= first and m == guess):
            continue
        square, f = to_facet(y, rows, m, best * (1.0 + 1e-12), v)
        # of equally near ones a face counts first: a point over the common edge of two flat facets is over a face
        if f >= 0 and (square < best * (1.0 - 1e-14) or (square <= best and f < feature)):
            best, b0, b1, b2, feature, which = square, v[0], v[1], v[2], f, m
    if which < 0:
        set_gradient(np.inf, 0.0, 0.0, 1.0, out)
        clear_hessian(out)
        return
    out[17] = which
    from_point(b0, b1, b2, 0.0, out)
    if feature == 0:
        clear_hessian(out)
    elif feature <= 3:
        i, m = sqrt(rows[which, 21 + feature]), which
        e0, e1, e2 = rows[m, 16], rows[m, 17], rows[m, 18]
        if feature == 3:
            e0, e1, e2 = rows[m, 19], rows[m, 20], rows[m, 21]
        elif feature == 2:
            e0, e1, e2 = rows[m, 19] - e0, rows[m, 20] - e1, rows[m, 21] - e2
        subtract_axis(1.0 / max(out[0], 1e-300), e0 * i, e1 * i, e2 * i, out)
