"""Judge of pass-throughs: does a moving curve cross wires, sheets, convex bodies or other curves? Numpy only.

A motion is an array of frames (T, S, 3) [m]: S samples of a centreline at T times, taken as straight between
neighbours in the curve and in time. Sample the curve about ten times finer than the points a solver uses, and pass
positions in the frame of the part when the part moves.

Crossings of exactly aligned things (a sample that meets a wire, parallel rods that pass in one plane) are decided by
shifting every sample by a fixed random step of 1e-9 of the size of the motion. Rods or wires that pass while exactly
parallel then count at least once, and may count more than once.
"""

import itertools

import numpy as np

SHIFT = 1e-9  # of the extent of the motion
CHUNK = 500_000  # samples or pairs held at once


def crossings_segment(frames, a, b, *, signed=False):
    """How often the swept centreline passes the wire a-b [m].

    The sweep of one piece of the curve in one step is a quadrilateral, cut in two triangles. In coordinates with the
    wire on the third axis, a triangle meets the line of the wire if its three edge functions u_p v_q - u_q v_p have
    one sign. Neighbours share their edge functions, so the sweep has no gaps and no place counts twice (Woop, Benthin
    & Wald 2013). With ``signed``, passes to one side count +1 and to the other -1.
    """
    return _crossings_segment(_generic(frames, seed=1), np.asarray(a, dtype=float), np.asarray(b, dtype=float), signed)


def crossings_triangle(frames, triangle):
    """How often the centreline passes the sheet, a triangle (3, 3) [m]: by a sample through the face or over an edge.

    A curve can only come to pierce a triangle when one of its samples passes the face or one of its pieces passes an
    edge. Both are counted; a curve that slides through a sheet it has pierced goes on counting.
    """
    triangle = np.asarray(triangle, dtype=float)
    frames = _generic(frames, seed=1)
    face = sum(_through(frames[t : t + 2], triangle, axis=0).sum() for t in range(len(frames) - 1))
    return int(face) + sum(_crossings_segment(frames, triangle[i], triangle[i - 1]) for i in range(3))


def piercings(frames, triangle):
    """How many pieces of the centreline go through the triangle (3, 3) [m] in each frame: (T,) integers."""
    triangle = np.asarray(triangle, dtype=float)
    return np.array([_through(frame[None], triangle, axis=1).sum() for frame in _generic(frames, seed=1)])


def inside_convex(frames, normals, offsets, *, subdivisions=10):
    """Deepest place [m] of the swept centreline in the convex body ``normals @ x <= offsets``; 0 if it stays outside.

    normals : (K, 3), unit outward; offsets : (K,) [m]. The depth is the least distance to a face plane. It is exact on
    the pieces of the curve at ten times in each step and on the whole path of each sample.
    """
    frames = np.asarray(frames, dtype=float)
    normals, offsets = np.asarray(normals, dtype=float), np.asarray(offsets, dtype=float)
    deepest = 0.0
    for t in range(max(1, len(frames) - 1)):
        now, then = frames[t], frames[min(t + 1, len(frames) - 1)]
        heights = [offsets - x @ normals.T for x in (now, then)]
        if (np.maximum(*heights).max(0) <= 0).any():  # all of it beyond one face
            continue
        deepest = max(deepest, _depth(*heights))
        for fraction in np.linspace(0, 1, subdivisions + 1):
            height = (1 - fraction) * heights[0] + fraction * heights[1]
            deepest = max(deepest, _depth(height[:-1], height[1:]))
    return deepest


def inside_box(frames, center, half, *, subdivisions=10):
    """Deepest place [m] of the swept centreline in the box ``|x - center| <= half``; 0 if it stays outside."""
    normals = np.vstack([np.eye(3), -np.eye(3)])
    return inside_convex(frames, normals, normals @ center + np.tile(half, 2), subdivisions=subdivisions)


def inside(frames, distance, *, subdivisions=10):
    """Deepest place [m] of the samples in a body with the signed distance ``distance((N, 3)) -> (N,)``, outside > 0.

    Samples only, at ten times in each step: for curved bodies that are large against the path of one such time.
    """
    frames = np.asarray(frames, dtype=float)
    deepest = max(0.0, -distance(frames[-1]).min())
    for now, then in itertools.pairwise(frames):
        for fraction in np.arange(subdivisions) / subdivisions:
            deepest = max(deepest, -distance((1 - fraction) * now + fraction * then).min())
    return deepest


def gauss_integral(curve1, curve2):
    """Gauss double integral of two open polylines, (N, 3) and (M, 3) [m], exact for straight pieces.

    Two pieces contribute the signed solid angle under which one is seen from the other, over 4 pi: the spherical
    quadrilateral of the four directions between their ends (Klenin & Langowski 2000, method 1a), here as two
    triangles with tan(angle / 2) = det(a, b, c) / (1 + ab + bc + ca) for unit vectors (Van Oosterom & Strackee 1983).
    """
    curve1, curve2 = np.asarray(curve1, dtype=float), np.asarray(curve2, dtype=float)
    total = 0.0
    rows = max(1, CHUNK // len(curve2))
    for start in range(0, len(curve1) - 1, rows):
        d = curve1[start : start + rows + 1, None] - curve2[None]
        d = d / np.linalg.norm(d, axis=-1, keepdims=True)
        a, b, c, e = d[:-1, :-1], d[:-1, 1:], d[1:, 1:], d[1:, :-1]
        total += (_solid_angle(a, b, c) + _solid_angle(a, c, e)).sum()
    return total / (4 * np.pi)


def writhe(curve):
    """Writhe of an open polyline (N, 3) [m]: the Gauss double integral of its pieces, neighbours left out, which are in one
    plane. With the turns of a ribbon about it, it makes the linking number, if both ends go on straight to far away."""
    curve, total = np.asarray(curve, dtype=float), 0.0
    for k in range(len(curve) - 3):
        total += 2.0 * gauss_integral(curve[k : k + 2], curve[k + 2 :])
    return total


def linking_number(curve1, curve2):
    """Linking number of two closed polylines, (N, 3) and (M, 3) [m]; the last point is joined to the first."""
    value = gauss_integral(*(np.vstack([c, np.asarray(c)[:1]]) for c in (curve1, curve2)))
    if not abs(value - round(value)) < 1e-6:
        raise ValueError(f"linking number {value} is no integer")  # round-off: the curves all but touch
    return round(value)


def linking_with_closure(frames1, frames2, *, far1=None, far2=None):
    """Linking number in each frame, (T,), of two open rods, each closed through far points that stay the same.

    far1, far2 : (K, 3) [m], from the end of the rod back to its start. By default two points, beyond the ends of the
    first frame at ten times the extent, the second rod's turned aside. With fixed ends a change shows a pass-through,
    unless a rod crosses the straight closing line of the other: choose far points that keep clear of the motion.
    """
    frames1, frames2 = _generic(frames1, seed=1), _generic(frames2, seed=2)
    points = np.vstack([frames1.reshape(-1, 3), frames2.reshape(-1, 3)])
    center, extent = (points.min(0) + points.max(0)) / 2, np.ptp(points, axis=0).max()

    def beyond(curve, aside):
        ends = curve[[-1, 0]] - center + 1e-3 * extent * np.array([[0.3, 0.5, 0.8], [0.8, -0.3, 0.5]])
        return center + extent * (10 * ends / np.linalg.norm(ends, axis=1, keepdims=True) + aside)

    far1 = beyond(frames1[0], (0.0, 0.0, 0.0)) if far1 is None else far1
    far2 = beyond(frames2[0], (1.7, 2.9, 4.1)) if far2 is None else far2
    pairs = zip(frames1, frames2, strict=True)
    return np.array([linking_number(np.vstack([x, far1]), np.vstack([y, far2])) for x, y in pairs])


def crossings_rods(frames1, frames2, *, signed=False):
    """How often two moving centrelines, (T, S1, 3) and (T, S2, 3) [m], pass through each other.

    Exact for points that move straight in each step: two pieces p, q are in one plane when the cubic
    V(t) = det(p1 - p0, q1 - q0, q0 - p0) changes sign, and cross if the common point is on both. With ``signed``,
    each pass counts as the change it makes to the linking number of closed curves; a pass and its return cancel.
    """
    frames1, frames2 = np.asarray(frames1, dtype=float), np.asarray(frames2, dtype=float)
    size = np.ptp(np.vstack([frames1.reshape(-1, 3), frames2.reshape(-1, 3)]), axis=0).max()
    return _crossings(_generic(frames1, 1, size), _generic(frames2, 2, size), signed, None)


def crossings_self(frames, *, signed=False, skip=1):
    """How often a moving centreline passes through itself; pieces up to ``skip`` apart are left out."""
    frames = _generic(frames, seed=1)
    return _crossings(frames, frames, signed, skip)


def _generic(frames, seed, extent=None):
    """The frames with each sample moved by a step that is the same at all times."""
    frames = np.asarray(frames, dtype=float)
    if frames.ndim != 3 or frames.shape[2] != 3 or not np.isfinite(frames).all():
        raise ValueError(f"frames must be finite and of shape (T, S, 3) (got {frames.shape})")
    extent = np.ptp(frames.reshape(-1, 3), axis=0).max() if extent is None else extent
    return frames + SHIFT * extent * np.random.default_rng(seed).uniform(-1, 1, frames.shape[1:])


def _crossings_segment(frames, a, b, signed=False):
    length = np.linalg.norm(b - a)
    axes = _axes((b - a) / length)
    total = 0
    step = max(1, CHUNK // frames.shape[1])
    for start in range(0, len(frames) - 1, step):
        block = (frames[start : start + step + 1] - a) @ axes.T
        if (block.min((0, 1)) > [0, 0, length]).any() or (block.max((0, 1)) < 0).any():
            continue
        u, v, w = np.moveaxis(block, -1, 0)
        along = _edge(u, v, np.s_[:, :-1], np.s_[:, 1:])
        path = _edge(u, v, np.s_[:-1], np.s_[1:])
        diagonal = _edge(u, v, np.s_[:-1, :-1], np.s_[1:, 1:])
        first = along[:-1], path[:, 1:], -diagonal  # opposite to (1, 1), (0, 0), (0, 1) in (time, sample)
        second = diagonal, -along[1:], -path[:, :-1]  # opposite to (1, 0), (0, 0), (1, 1)
        for edges, corners in ((first, ((1, 1), (0, 0), (0, 1))), (second, ((1, 0), (0, 0), (1, 1)))):
            sign = np.sign(edges[0])
            t, s = np.nonzero((sign != 0) & (sign == np.sign(edges[1])) & (sign == np.sign(edges[2])))
            weights = np.array([e[t, s] for e in edges])
            height = sum(g * w[t + i, s + j] for g, (i, j) in zip(weights, corners, strict=True)) / weights.sum(0)
            found = sign[t, s][(height >= 0) & (height <= length)]
            total += int(found.sum()) if signed else len(found)
    return total


def _axes(direction):
    """Three orthonormal rows, the last one along ``direction``."""
    side = np.cross(direction, np.eye(3)[abs(direction).argmin()])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(direction, side), direction])


def _edge(u, v, p, q):
    return u[p] * v[q] - u[q] * v[p]


def _through(points, triangle, axis):
    """Mask of the straight pieces between neighbours along ``axis`` of (A, B, 3) that go through the triangle."""
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    height = (points - triangle[0]) @ normal
    h0, h1 = (height[:-1], height[1:]) if axis == 0 else (height[:, :-1], height[:, 1:])
    x0, x1 = (points[:-1], points[1:]) if axis == 0 else (points[:, :-1], points[:, 1:])
    hit = (h0 >= 0) != (h1 >= 0)
    x = x0[hit] + (h0[hit] / (h0[hit] - h1[hit]))[:, None] * (x1[hit] - x0[hit])
    keep = np.ones(len(x), dtype=bool)
    for i in range(3):
        keep &= np.cross(triangle[i] - triangle[i - 1], x - triangle[i - 1]) @ normal >= 0
    hit[hit] = keep
    return hit


def _depth(h0, h1):
    """Largest value of the least height on straight pieces: heights (N, K) [m] above K face planes at both ends."""
    near = (np.maximum(h0, h1) > 0).all(1)
    h0, h1 = h0[near], h1[near]
    if not len(h0):
        return 0.0
    slope = h1 - h0
    i, j = np.triu_indices(h0.shape[1], 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        meet = (h0[:, i] - h0[:, j]) / (slope[:, j] - slope[:, i])  # a concave piecewise linear function is largest
    places = np.hstack([np.zeros((len(h0), 1)), np.ones((len(h0), 1)), np.where(np.isfinite(meet), meet, 0)])
    places = np.clip(places, 0, 1)  # at an end or where two of its lines meet
    least = (h0[:, None] + places[..., None] * slope[:, None]).min(2)
    return max(0.0, float(least.max()))


def _solid_angle(a, b, c):
    """Signed solid angle [sr] of the spherical triangle of three arrays of unit vectors."""
    below = 1 + (a * b).sum(-1) + (b * c).sum(-1) + (c * a).sum(-1)
    return 2 * np.arctan2(_det(a, b, c), below)


def _det(a, b, c):
    return (
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    )


def _crossings(frames1, frames2, signed, skip):
    if len(frames1) != len(frames2):
        raise ValueError(f"both rods need the same number of frames (got {len(frames1)} and {len(frames2)})")
    total = 0
    for t in range(len(frames1) - 1):
        x, y = frames1[t : t + 2], frames2[t : t + 2]
        drift = np.array([np.zeros(3), (x[1] - x[0]).mean(0)])[:, None]  # boxes need the relative motion only
        for i, j in _pairs(*_boxes(x - drift), *_boxes(y - drift)):
            if skip is not None:
                keep = j - i > skip
                i, j = i[keep], j[keep]
            found = _passes(x[:, i], x[:, i + 1], y[:, j], y[:, j + 1])
            total += int(found.sum()) if signed else len(found)
    return total


def _boxes(step):
    """Lower and upper corners of the sweep of each piece: step (2, S, 3) -> two of (S - 1, 3)."""
    low, high = step.min(0), step.max(0)
    return np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])


def _pairs(low1, high1, low2, high2, block=32):
    """Index arrays of the pairs of boxes that overlap, in portions: blocks of neighbours first, then their members."""

    def blocks(low, high):
        starts = np.arange(0, len(low), block)
        return starts, np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)

    start1, lo1, hi1 = blocks(low1, high1)
    start2, lo2, hi2 = blocks(low2, high2)
    A, B = np.nonzero(((lo1[:, None] <= hi2) & (lo2 <= hi1[:, None])).all(2))
    member = np.arange(block)
    portion = max(1, CHUNK // block**2)
    for k in range(0, len(A), portion):
        i = (start1[A[k : k + portion], None] + member)[:, :, None] + 0 * member
        j = (start2[B[k : k + portion], None] + member)[:, None, :] + 0 * member[:, None]
        valid = (i < len(low1)) & (j < len(low2))
        i, j = i[valid], j[valid]
        overlap = ((low1[i] <= high2[j]) & (low2[j] <= high1[i])).all(1)
        yield i[overlap], j[overlap]


def _passes(p0, p1, q0, q1):
    """Signs of all passes of pieces p0-p1 and q0-q1, each (2, N, 3): start and end of a step."""

    def volume(time):
        a, b, c = p1 - p0, q1 - q0, q0 - p0
        return _det(*((1 - time)[:, None] * e[0] + time[:, None] * e[1] for e in (a, b, c)))

    a, b, c = p1 - p0, q1 - q0, q0 - p0
    mixed = np.array([[[_det(a[i], b[j], c[k]) for k in (0, 1)] for j in (0, 1)] for i in (0, 1)])
    bezier = np.array(
        [
            mixed[0, 0, 0],
            (mixed[1, 0, 0] + mixed[0, 1, 0] + mixed[0, 0, 1]) / 3,
            (mixed[0, 1, 1] + mixed[1, 0, 1] + mixed[1, 1, 0]) / 3,
            mixed[1, 1, 1],
        ]
    )
    keep = (bezier >= 0).any(0) & (bezier < 0).any(0)  # otherwise the cubic has one sign
    p0, p1, q0, q1, bezier = p0[:, keep], p1[:, keep], q0[:, keep], q1[:, keep], bezier[:, keep]
    # Between the zeros of the derivative (quadratic d0, d1, d2 in Bernstein form) the cubic is monotonous.
    d0, d1, d2 = np.diff(bezier, axis=0)
    A, B = d0 - 2 * d1 + d2, d1 - d0
    root = np.sqrt(np.maximum(B**2 - A * d0, 0))
    q = -(B + np.where(B >= 0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.nan_to_num(np.array([q / A, d0 / q]), nan=0.0, posinf=0.0, neginf=0.0)
    zero, one = np.zeros_like(d0), np.ones_like(d0)
    times = np.array([zero, *np.sort(np.clip(turns, 0, 1), axis=0), one])
    # The values at the two ends come from the frames alone, so a pass at a frame belongs to one step only.
    sides = np.array([bezier[0], volume(times[1]), volume(times[2]), bezier[3]]) >= 0
    signs = []
    for k in range(3):
        low, high = times[k].copy(), times[k + 1].copy()
        change = sides[k] != sides[k + 1]
        for _ in range(60 if change.any() else 0):
            middle = (low + high) / 2
            same = (volume(middle) >= 0) == sides[k]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        x0, x1, y0, y1 = ((1 - high)[:, None] * e[0] + high[:, None] * e[1] for e in (p0, p1, q0, q1))
        u, v, w = x1 - x0, y1 - y0, y0 - x0
        normal = np.cross(u, v)
        square = (normal**2).sum(1)
        on_p = (np.cross(w, v) * normal).sum(1)
        on_q = (np.cross(w, u) * normal).sum(1)
        hit = change & (square > 0) & (on_p >= 0) & (on_p < square) & (on_q >= 0) & (on_q < square)
        signs.append(np.where(sides[k], 1, -1)[hit])
    return np.concatenate(signs)
