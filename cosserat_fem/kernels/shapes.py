"""Distance from a point to a rigid shape, with unit gradient and Hessian.

Rule: shapes are given in their own frame (`cosserat_fem.shapes`); a distance is signed, negative inside a solid, and has
no sign for triangles. The Hessian of a distance has the principal curvatures of the offset surface through the point as
eigenvalues: 1/d about a point, 1/d across a line, none over a face.

Out (18,): distance, gradient (3), Hessian (9, by rows), one place for the caller, and four for the search among triangles.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from . import inner

PLANE, SPHERE, CYLINDER, CAPSULE, BOX, TORUS, MESH, STRAND = range(8)
FLAT = 1e-12  # in parts of an edge squared: a point beside a triangle by less than this is over it


@inner
def set_gradient(d, n0, n1, n2, out):
    out[0], out[1], out[2], out[3] = d, n0, n1, n2


@inner
def set_hessian(f, out):
    """f (I - n n)."""
    for i in range(3):
        for j in range(3):
            out[4 + 3 * i + j] = -f * out[1 + i] * out[1 + j]
        out[4 + 4 * i] += f


@inner
def clear_hessian(out):
    for i in range(4, 13):
        out[i] = 0.0


@inner
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


@inner
def from_point(v0, v1, v2, radius, out):
    """Ball of a radius about the foot of v."""
    d = sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    i = 1.0 / max(d, 1e-300)
    set_gradient(d - radius, v0 * i, v1 * i, v2 * i, out)
    set_hessian(i, out)


@inner
def round_about_axis(y0, y1, rho, radial, axial, distance, turn, out):
    """Shape of revolution about z: gradient (radial, axial) in the half plane of the point, curvature `turn` in it."""
    i = 1.0 / max(rho, 1e-300)
    c, s = y0 * i, y1 * i
    set_gradient(distance, radial * c, radial * s, axial, out)
    clear_hessian(out)
    subtract_axis(-turn, -axial * c, -axial * s, radial, out)
    subtract_axis(-radial * i, -s, c, 0.0, out)


@inner
def cylinder(y0, y1, y2, radius, half, out):
    rho = hypot(y0, y1)
    side, top = rho - radius, abs(y2) - half
    sign = 1.0 if y2 > 0.0 else -1.0
    if side > 0.0 and top > 0.0:
        d = hypot(side, top)
        round_about_axis(y0, y1, rho, side / d, sign * top / d, d, 1.0 / d, out)
    elif side > top:
        round_about_axis(y0, y1, rho, 1.0, 0.0, side, 0.0, out)
    else:
        set_gradient(top, 0.0, 0.0, sign, out)
        clear_hessian(out)


@inner
def torus(y0, y1, y2, radius, tube, out):
    rho = hypot(y0, y1)
    across = rho - radius
    d = max(hypot(across, y2), 1e-300)
    round_about_axis(y0, y1, rho, across / d, y2 / d, d - tube, 1.0 / d, out)


@inner
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


@inner
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


@inner
def to_triangle(y, A, B, C, v):
    """Vector v (3,) from the nearest point of a triangle to y; returns (distance squared, feature).

    Feature: 0 face, 1 to 3 the edges AB, BC, CA, 4 to 6 the corners A, B, C.
    """
    ab0, ab1, ab2 = B[0] - A[0], B[1] - A[1], B[2] - A[2]
    ac0, ac1, ac2 = C[0] - A[0], C[1] - A[1], C[2] - A[2]
    p0, p1, p2 = y[0] - A[0], y[1] - A[1], y[2] - A[2]
    bb = ab0 * ab0 + ab1 * ab1 + ab2 * ab2
    cc = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    bc = ab0 * ac0 + ab1 * ac1 + ab2 * ac2
    pb = p0 * ab0 + p1 * ab1 + p2 * ab2
    pc = p0 * ac0 + p1 * ac1 + p2 * ac2
    det = bb * cc - bc * bc
    s, t = cc * pb - bc * pc, bb * pc - bc * pb  # barycentric coordinates times det
    slack = FLAT * det
    if s >= -slack and t >= -slack and s + t <= det + slack:
        s, t, feature = s / det, t / det, 0
    else:
        best, s_best, t_best, feature = np.inf, 0.0, 0.0, 0
        pp = p0 * p0 + p1 * p1 + p2 * p2
        for edge in range(3):
            if edge == 0:
                u = min(max(pb / bb, 0.0), 1.0)
                a, b = u, 0.0
            elif edge == 1:
                u = min(max((pc - pb + bb - bc) / (bb + cc - 2.0 * bc), 0.0), 1.0)
                a, b = 1.0 - u, u
            else:
                u = min(max(1.0 - pc / cc, 0.0), 1.0)
                a, b = 0.0, 1.0 - u
            square = pp - 2.0 * (a * pb + b * pc) + a * a * bb + 2.0 * a * b * bc + b * b * cc
            if square < best:
                best, s_best, t_best = square, a, b
                feature = edge + 1 if 0.0 < u < 1.0 else 4 + (edge if u == 0.0 else (edge + 1) % 3)
        s, t = s_best, t_best
    v[0] = p0 - s * ab0 - t * ac0
    v[1] = p1 - s * ab1 - t * ac1
    v[2] = p2 - s * ab2 - t * ac2
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2], feature


@inner
def beyond(mesh, k, y, distance):
    """True if the ball about the triangle index[k] is farther from y than a distance."""
    m = mesh[2][k]
    c, reach = mesh[3][m], distance + mesh[4][m]
    d0, d1, d2 = y[0] - c[0], y[1] - c[1], y[2] - c[2]
    return d0 * d0 + d1 * d1 + d2 * d2 > reach * reach


@inner
def triangles(mesh, first, last, y, out):
    """Distance to the nearest of the triangles index[first:last].

    mesh: points (P, 3), corners (F, 3), index, middles (F, 3) and radii (F,) of balls about triangles, and widths
    (F,) of triangles. out[17]: place in
    index of the one that was nearest to the last point, to begin with, or negative; renewed.
    """
    points, corners, index = mesh[0], mesh[1], mesh[2]
    v = out[14:17]
    best, d, b0, b1, b2, feature, which = np.inf, np.inf, 0.0, 0.0, 0.0, 0, -1
    guess = int(out[17])
    for j in range(first - 1, last):
        k = guess if j < first else j
        if k < first or (j >= first and (k == guess or beyond(mesh, k, y, d))):
            continue
        m = index[k]
        square, f = to_triangle(y, points[corners[m, 0]], points[corners[m, 1]], points[corners[m, 2]], v)
        # of equally near ones a face counts first: a point over the common edge of two flat facets is over a face
        if square < best * (1.0 - 1e-14) or (square <= best and f < feature):
            best, d, b0, b1, b2, feature, which = square, sqrt(square) * (1.0 + 1e-12), v[0], v[1], v[2], f, k
    if which < 0:
        set_gradient(np.inf, 0.0, 0.0, 1.0, out)
        clear_hessian(out)
        return
    out[17] = which
    from_point(b0, b1, b2, 0.0, out)
    if feature == 0:
        clear_hessian(out)
    elif feature <= 3:
        m = index[which]
        a, b = points[corners[m, feature - 1]], points[corners[m, feature % 3]]
        e0, e1, e2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        i = 1.0 / sqrt(e0 * e0 + e1 * e1 + e2 * e2)
        subtract_axis(1.0 / max(out[0], 1e-300), e0 * i, e1 * i, e2 * i, out)
