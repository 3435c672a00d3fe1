"""How near do surfaces come? Distance of rods from parts and from each other, and where it is smallest.

Rule: distance is measured between surfaces and needs no contact term: the polynomial of each element is searched for its
nearest place. Nothing is sampled, so a thin body between two nodes is found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..history import History
from ..kernels.nodes import distance_to_polyline
from ..kernels.triangles import lower_to_triangles, winding_number
from ..mechanism import Part
from ..rod import Rod
from ..surface import Surface


def clearance(
    history: History, rod: Rod | str, other: Part | Rod | str, *, leave_out: Sequence[tuple[float, float]] = ()
) -> np.ndarray:
    """Smallest distance of a rod's surface from a part, or from another rod's surface.

    Of all shapes of the part and its mesh, whether they touch by a contact term or not. Negative where they overlap; a
    mesh that is not closed has no inside and is overlapped by no more than the rod's radius.

    Parameters
    ----------
    other : Part or Rod
        By itself or, if it is in the model, by its name; a part need not be in the model.
    leave_out : list of (s0, s1) [m]
        Stretches of the rod that are not looked at, as where it is clamped to the part.

    Returns
    -------
    (T,) [m], infinite if there is nothing to look at
    """
    return closest(history, rod, other, leave_out=leave_out)[0]


def closest(
    history: History, rod: Rod | str, other: Part | Rod | str, *, leave_out: Sequence[tuple[float, float]] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """As `clearance`, and where on the rod it is: distance (T,) [m] and arc length (T,) [m], NaN if there is none."""
    rod = history.rod(rod)
    other = _other(history, rod, other)
    distance, place = np.full(len(history), np.inf), np.full(len(history), np.nan)
    for steps in _blocks(len(history)):
        if isinstance(other, Rod):
            found = [_between(_Curve(history, rod, steps), _Curve(history, other, steps), leave_out)]
        else:
            curve = _Curve(history, rod, steps, other)
            found = [_nearest(curve, body, leave_out) for body in _bodies(other)]
        for least in found:
            nearer = least.d < distance[steps.start : steps.stop]
            distance[steps.start : steps.stop][nearer] = least.d[nearer]
            place[steps.start : steps.stop][nearer] = least.s[nearer]
    return distance, place


def clearance_along(history: History, rod: Rod | str, other: Part | Rod | str) -> np.ndarray:
    """Distance (T, N) [m] of a rod's surface at its nodes from a part, or from another rod's surface.

    The other rod is looked at as straight pieces, `PIECES` to an element: that is meant for maps, `closest` for judging.
    """
    rod = history.rod(rod)
    other = _other(history, rod, other)
    positions = history.positions(rod)
    radius = rod.radius_at(history.nodes(rod))
    if isinstance(other, Part):  # all states in one call
        poses = [other.pose(record.state.t) for record in history.records]
        x = np.array([(r - c) @ R for r, (R, c) in zip(positions, poses, strict=True)])
        return _off(_bodies(other), x.reshape(-1, 3)).reshape(positions.shape[:2]) - radius
    return np.array([_measure(history, k, other)(r) for k, r in enumerate(positions)]) - radius


def roughly(
    history: History, rod: Rod | str, other: Part | Rod | str, *, leave_out: Sequence[tuple[float, float]] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """As `closest`, but only about the node that is nearest: for states that are looked at one by one, and often.

    A body that is thinner than nodes are apart may be missed.
    """
    rod = history.rod(rod)
    other = _other(history, rod, other)
    nodes, positions = history.nodes(rod), history.positions(rod)
    left = np.array([any(a < s < b for a, b in leave_out) for s in nodes])
    near, place = np.full(len(history), np.inf), np.full(len(history), np.nan)
    for k in range(0 if left.all() else len(history)):
        measure, curve = _measure(history, k, other), _Curve(history, rod, [k])
        d = np.where(left, np.inf, measure(positions[k]) - rod.radius_at(nodes))
        j = int(np.argmin(d))
        low, high = nodes[max(j - 1, 0)], nodes[min(j + 1, len(nodes) - 1)]
        for _ in range(ROUGHLY):
            s = np.linspace(low, high, 9)
            e = np.clip(np.searchsorted(curve.s, s, side="right") - 1, 0, len(curve.s) - 1)
            x = curve.place(np.zeros(len(s), dtype=int), e, (s - curve.s[e]) / curve.h[e])
            d = measure(x) - rod.radius_at(s)
            d[[any(a < x < b for a, b in leave_out) for x in s]] = np.inf
            j = int(np.argmin(d))
            low, high = s[max(j - 1, 0)], s[min(j + 1, len(s) - 1)]
        near[k], place[k] = d[j], s[j]
    return near, place


def _measure(history: History, k: int, other: Part | Rod) -> Callable[[np.ndarray], np.ndarray]:
    """Distance (n,) of places (n, 3) from a part or a rod, at state k."""
    if isinstance(other, Part):
        R, c = other.pose(history.records[k].state.t)
        bodies = _bodies(other)
        return lambda x: _off(bodies, (x - c) @ R)
    curve = _Curve(history, other, [k])
    e, xi = np.divmod(np.arange(len(curve.h) * PIECES + 1), PIECES)
    e, xi = np.append(e[:-1], e[-2]), np.append(xi[:-1] / PIECES, 1.0)
    polyline = curve.place(np.zeros(len(e), dtype=int), e, xi)

    def distance(x: np.ndarray) -> np.ndarray:
        out = np.empty(len(x))
        distance_to_polyline(x, polyline, out)
        return out - curve.widest

    return distance


def _off(bodies: Iterable[_Body], x: np.ndarray) -> np.ndarray:
    """Distance (n,) of places (n, 3) in the frame of a part from the nearest of its bodies."""
    return np.min([body.distance(x) for body in bodies], axis=0)


def _other(history: History, rod: Rod, other: Part | Rod | str) -> Part | Rod:
    """What a rod's clearance is measured from, by itself or by name. ValueError if there is none."""
    if isinstance(other, str):
        other = history.rod(other) if other in [r.name for r in history.model.rods] else history.part(other)
    if isinstance(other, Rod):
        other = history.rod(other)
        if other is rod:
            raise ValueError(f"clearance: of rod {rod.name!r} with itself there is none; name two rods or a part.")
    elif not other.shapes and other.mesh is None:
        raise ValueError(f"clearance: part {other.name!r} has neither a shape nor a mesh.")
    return other


def _bodies(part: Part) -> list[_Body]:
    bodies = [_Body(shape.distance) for shape in part.shapes]
    return bodies + ([_Body(part.surface().distance, part.surface())] if part.mesh is not None else [])


def _blocks(n: int) -> list[range]:
    return [range(begin, min(begin + BLOCK, n)) for begin in range(0, n, BLOCK)]


ROUGHLY = 2  # times that a window about the nearest node is narrowed to a quarter
PIECES = 8  # straight pieces of an element, for maps
BLOCK = 256  # states looked at together
FINE = 0.25  # radii: pieces of a rod this long are searched for the smallest distance by sections
SECTIONS, WINDOWS = 32, 60  # golden sections; moves or halvings of a window
SHARP = 1e-8  # of the longest piece of a window: as narrow as windows become
LEVEL = 1e-7  # radii: distances that differ by less are the same
SHORT = 1e-9  # of an element: round-off of a stretch
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class _Curve:
    """The centreline of a rod at some states, in space or in the frame of a part: a polynomial for each element."""

    def __init__(self, history: History, rod: Rod, steps: Iterable[int], part: Part | None = None) -> None:
        view = history.model.space[rod]
        group = history.model.space.groups[view.group]
        states = [history.records[k].state for k in steps]
        xi = group.basis.elem.doflocs[:, 0] - 0.5
        r = np.array([state.r[group.conn[view.elements]] for state in states])  # (T, E, A, 3)
        if part is not None:
            poses = [part.pose(state.t) for state in states]
            R, c = np.array([R for R, _ in poses]), np.array([c for _, c in poses])
            r = np.einsum("teai,tij->teaj", r - c[:, None, None], R)
        self.C = np.einsum("ja,teai->teji", np.linalg.inv(xi[:, None] ** np.arange(len(xi))), r)
        powers = np.arange(len(xi))[1:]
        self.speed = np.einsum("tej,j->te", np.linalg.norm(self.C[:, :, 1:], axis=-1), powers * 0.5 ** (powers - 1))
        self.h = group.dx[view.elements].sum(axis=1)
        self.s = np.cumsum(self.h) - self.h
        self.knots = np.array([s for s, _ in rod.sections])
        self.radii = rod.radius_at(self.knots)  # linear between
        self.widest = float(self.radii.max())

    def place(self, t: np.ndarray, e: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """Places (K, 3) [m] at xi in elements e of states t, each (K,)."""
        return _polynomial(self.rows(t, e), xi)

    def rows(self, t: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Coefficients (K, powers, 3) of elements e of states t."""
        return self.C.reshape(-1, *self.C.shape[2:]).take(t * self.C.shape[1] + e, axis=0)

    def radius(self, e: np.ndarray, xi: np.ndarray) -> np.ndarray:
        if len(self.radii) == 1:
            return np.full(len(e), self.radii[0])
        return np.interp(self.s[e] + xi * self.h[e], self.knots, self.radii)

    def pieces(self, leave_out: Sequence[tuple[float, float]] = ()) -> _Pieces:
        """Elements of all states, without some stretches."""
        kept: list[tuple[int, float, float]] = []
        for e, (s, h) in enumerate(zip(self.s, self.h, strict=True)):
            spans = [(0.0, 1.0)]
            for a, b in leave_out:
                low, high = (a - s) / h, (b - s) / h
                spans = [
                    piece for x, y in spans for piece in ((x, min(y, low)), (max(x, high), y)) if piece[0] < piece[1]
                ]
            kept += [(e, x, y) for x, y in spans if y - x > SHORT]
        T, n = len(self.C), len(kept)
        table = np.tile(np.array(kept).reshape(-1, 3), (T, 1))
        begin, end = table[:, 1], table[:, 2]
        t, element = np.repeat(np.arange(T), n), table[:, 0].astype(np.int64)
        return _Pieces(t, element, 0.5 * (begin + end), 0.5 * (end - begin), begin, end)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of a curve: state, element, middle and half length in xi, and how far in xi the stretch goes they are of."""

    t: np.ndarray
    e: np.ndarray
    mid: np.ndarray
    half: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def __getitem__(self, pick: Any) -> _Pieces:
        return _Pieces(*(array[pick] for array in vars(self).values()))

    def halves(self) -> _Pieces:
        """Both halves of each, one after the other."""
        both = self[np.repeat(np.arange(len(self.t)), 2)]
        sign = np.tile([-0.5, 0.5], len(self.t))
        return replace(both, mid=both.mid + sign * both.half, half=0.5 * both.half)


@dataclass(frozen=True, eq=False)
class _Body:
    """Signed distance (n,) [m] of points (n, 3), and the mesh if it is one: it has a cheap lower bound."""

    distance: Callable[[np.ndarray], np.ndarray]
    surface: Surface | None = None

    def lower(self, x: np.ndarray) -> np.ndarray:
        """Lower bound (n,) [m] of the signed distance."""
        if self.surface is None:
            return self.distance(x)
        low = self.surface.nearest(x)
        if self.surface.closed:
            within = ((x >= self.surface.bounds[0]) & (x <= self.surface.bounds[1])).all(axis=1)
            low[within] = self.distance(x[within])
        return low

    def about(self, x: np.ndarray, d: np.ndarray, reach: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Distance of points that stay within `reach` (n,) [m] of x (n, 3), whose own distance is d (n,)."""
        surface = self.surface
        if surface is None or not len(x):
            return self.distance
        start, index = surface.candidates(x, np.abs(d) + 2.0 * reach)
        every = surface.points[surface.triangles]
        row = np.repeat(np.arange(len(x)), np.diff(start))
        either = np.flatnonzero(np.abs(d) <= reach) if surface.closed else np.empty(0, dtype=int)  # inside or outside

        def signed(y: np.ndarray) -> np.ndarray:
            inside = d < 0.0
            inside[either] = winding_number(y[either], every) > 0.5
            least = np.full(len(y), np.inf)
            lower_to_triangles(y, row, every, index, least)
            return np.where(inside, -least, least)

        return signed


class _Least:
    """Smallest distance d (T,) [m] so far at each state, and the arc length s (T,) [m] where it is."""

    def __init__(self, curve: _Curve) -> None:
        self.curve, self.d, self.s = curve, np.full(len(curve.C), np.inf), np.full(len(curve.C), np.nan)

    def take(self, pieces: _Pieces, xi: np.ndarray, values: np.ndarray) -> None:
        """Values (K,) at xi (K,) of pieces."""
        t, e = pieces.t, pieces.e
        np.minimum.at(self.d, t, values)
        here = values == self.d[t]
        self.s[t[here]] = self.curve.s[e[here]] + xi[here] * self.curve.h[e[here]]


def _nearest(curve: _Curve, body: _Body, leave_out: Sequence[tuple[float, float]]) -> _Least:
    """Smallest distance of a rod's surface from a body: pieces that are too far away are put aside, the others halved until
    they are short; then sections about each smallest one."""
    best, new = _Least(curve), curve.pieces(leave_out)
    short, values = new[:0], np.empty(0)
    while len(new.t):
        x, ball = curve.place(new.t, new.e, new.mid), curve.speed[new.t, new.e] * new.half
        radius, d = curve.radius(new.e, new.mid), body.lower(x)
        if body.surface is not None:
            order = np.lexsort((d - ball, new.t))
            first = order[np.unique(new.t[order], return_index=True)[1]]
            best.take(new[first], new.mid[first], body.distance(x[first]) - radius[first])
            near = np.flatnonzero(d - ball - curve.widest <= best.d[new.t])
            new, x, ball, radius = new[near], x[near], ball[near], radius[near]
            d = body.distance(x)
        best.take(new, new.mid, d - radius)
        near = d - ball - curve.widest <= best.d[new.t]
        long = near & (2.0 * ball > FINE * curve.widest)
        done = near & ~long
        short, values = _joined(short, new[done]), np.concatenate([values, (d - radius)[done]])
        new = new[long].halves()
    pick = _lowest(short, values, LEVEL * curve.widest)
    short = short[pick]
    reach = 2.0 * curve.speed[short.t, short.e] * short.half
    x = curve.place(short.t, short.e, short.mid)
    measure = body.about(x, values[pick] + curve.radius(short.e, short.mid), reach)

    def f(xi: np.ndarray) -> np.ndarray:
        return measure(curve.place(short.t, short.e, xi)) - curve.radius(short.e, xi)

    a = np.maximum(short.mid - 2.0 * short.half, short.low)
    b = np.minimum(short.mid + 2.0 * short.half, short.high)
    for end in (a, b):
        best.take(short, end, f(end))
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    fc, fd = f(c), f(d)
    for _ in range(SECTIONS if len(short.t) else 0):
        left = fc < fd
        best.take(short, np.where(left, c, d), np.minimum(fc, fd))
        a, b = np.where(left, a, c), np.where(left, d, b)
        kept, f_kept = np.where(left, c, d), np.where(left, fc, fd)
        inner = np.where(left, b - GOLDEN * (b - a), a + GOLDEN * (b - a))
        f_inner = f(inner)
        c, fc = np.where(left, inner, kept), np.where(left, f_inner, f_kept)
        d, fd = np.where(left, kept, inner), np.where(left, f_kept, f_inner)
    return best


def _joined(a: _Pieces, b: _Pieces) -> _Pieces:
    return _Pieces(*(np.concatenate([x, y]) for x, y in zip(vars(a).values(), vars(b).values(), strict=True)))


def _lowest(pieces: _Pieces, values: np.ndarray, level: float) -> np.ndarray:
    """Numbers of the pieces that are no higher than the ones before and after them; of a row of pieces that differ by less
    than `level` [m], as along a plane, the first and the last."""
    order = np.lexsort((pieces.mid, pieces.e, pieces.t))
    t, v = pieces.t[order], values[order]
    begin, end = (pieces.e + pieces.mid - pieces.half)[order], (pieces.e + pieces.mid + pieces.half)[order]
    meets = (t[1:] == t[:-1]) & (np.abs(begin[1:] - end[:-1]) < 1e-9)
    equal = meets & (np.abs(v[1:] - v[:-1]) <= level)
    rises = ~meets | equal | (v[1:] >= v[:-1])
    falls = ~meets | equal | (v[1:] <= v[:-1])
    inner = np.append(equal, False) & np.append(False, equal)
    return order[np.append(rises, True) & np.append(True, falls) & ~inner] if len(order) else order


def _between(one: _Curve, two: _Curve, leave_out: Sequence[tuple[float, float]]) -> _Least:
    """Smallest distance between the surfaces of two rods, and where on the first."""
    best = _Least(one)
    a, b = one.pieces(leave_out), two.pieces()
    if not len(a.t):
        return best
    i, j = _pairs(one, two, a, b)
    a, b = a[i], b[j]
    thick, fine = one.widest + two.widest, FINE * max(one.widest, two.widest)
    while True:
        ball = one.speed[a.t, a.e] * a.half, two.speed[b.t, b.e] * b.half
        d = np.linalg.norm(one.place(a.t, a.e, a.mid) - two.place(b.t, b.e, b.mid), axis=1)
        f = d - one.radius(a.e, a.mid) - two.radius(b.e, b.mid)
        best.take(a, a.mid, f)
        near = d - ball[0] - ball[1] - thick <= best.d[a.t]
        a, b, f, ball = a[near], b[near], f[near], (ball[0][near], ball[1][near])
        if 2.0 * max(ball[0].max(), ball[1].max()) <= fine:
            break
        n = np.arange(len(a.t))
        a, b = a.halves()[np.stack([2 * n, 2 * n, 2 * n + 1, 2 * n + 1]).T.ravel()], b.halves()
        b = b[np.stack([2 * n, 2 * n + 1, 2 * n, 2 * n + 1]).T.ravel()]
    order = np.lexsort((f, a.mid, a.e, a.t))  # the nearest partner of each piece of the first rod
    same = (a.t[order][1:] == a.t[order][:-1]) & (a.e[order][1:] == a.e[order][:-1])
    same &= a.mid[order][1:] == a.mid[order][:-1]
    first = order[np.append(True, ~same)]
    pick = first[_lowest(a[first], f[first], LEVEL * one.widest)]
    a, b = a[pick], b[pick]
    u, v = a.mid, b.mid
    du, dv = (fine / np.maximum(curve.speed[x.t, x.e], 1e-300) for curve, x in ((one, a), (two, b)))
    k, many = np.arange(len(u)), np.tile(np.arange(len(u)), len(GRID))
    i, j = np.repeat(0.5 * (GRID - 2), len(u), axis=0).T
    a_many, b_many = a[many], b[many]
    rows = one.rows(a_many.t, a_many.e), two.rows(b_many.t, b_many.e)
    for _ in range(WINDOWS):  # a window follows the smallest place in it, and shrinks about it
        us = np.clip(u[many] + i * du[many], a_many.low, a_many.high)
        vs = np.clip(v[many] + j * dv[many], b_many.low, b_many.high)
        values = np.linalg.norm(_polynomial(rows[0], us) - _polynomial(rows[1], vs), axis=1)
        values = (values - one.radius(a_many.e, us) - two.radius(b_many.e, vs)).reshape(len(GRID), -1)
        least = np.argmin(values, axis=0)
        u, v = us.reshape(values.shape)[least, k], vs.reshape(values.shape)[least, k]
        best.take(a, u, values[least, k])
        inside = (np.abs(GRID[least] - 2) < 2).all(axis=1)
        du, dv = np.where(inside, 0.5 * du, du), np.where(inside, 0.5 * dv, dv)
        if (du * one.speed[a.t, a.e] < SHARP * fine).all() and (dv * two.speed[b.t, b.e] < SHARP * fine).all():
            break
    return best


GRID = np.array([(i, j) for i in (2, 1, 3, 0, 4) for j in (2, 1, 3, 0, 4)])  # places in a window, its middle first


def _polynomial(rows: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Places (K, 3) of polynomials (K, powers, 3) at xi (K,)."""
    x = (xi - 0.5)[:, None]
    out = rows[:, -1].copy()
    for j in range(rows.shape[1] - 2, -1, -1):
        out *= x
        out += rows[:, j]
    return out


def _pairs(one: _Curve, two: _Curve, a: _Pieces, b: _Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of pairs of pieces that may hold the smallest distance of a state."""
    x, y = one.place(a.t, a.e, a.mid), two.place(b.t, b.e, b.mid)
    p, q = one.speed[a.t, a.e] * a.half, two.speed[b.t, b.e] * b.half
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for t in range(len(one.C)):
        i, j = np.flatnonzero(a.t == t), np.flatnonzero(b.t == t)
        tree = cKDTree(y[j])
        least = float(np.min(tree.query(x[i])[0]))  # the pair with the smallest distance has one of at most this
        spare = 2.0 * (one.widest + two.widest)  # radii may differ along the rods
        near = tree.query_ball_point(x[i], (least + spare + p[i] + q[j].max()) * (1 + 1e-12))
        length = np.fromiter(map(len, near), dtype=np.int64, count=len(near))
        found.append((np.repeat(i, length), j[np.concatenate([np.asarray(n, dtype=np.int64) for n in near])]))
    return np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])
