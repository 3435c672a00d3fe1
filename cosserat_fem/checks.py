"""Is it acceptable? Quantities that rules speak of, from a history.

Rule: a check is a function of a history and returns numbers; it never changes a model. Clearance is measured between
surfaces and needs no contact term: the polynomial of each element is searched for its nearest place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from .history import History
from .kernels.nodes import distance_to_polyline
from .kernels.triangles import triangle_distance
from .mechanism import Part
from .rod import Rod
from .surface import Surface


def bend_radius(history: History, rod: Rod | str, *, at: str = "stations") -> np.ndarray:
    """Bend radius of the centreline, infinite where it is straight.

    |Gamma| / sqrt(K1^2 + K2^2): stretch over the bending part of the curvature (per unstressed length).

    Parameters
    ----------
    at : "stations" or "nodes"
        At the Gauss points (T, Q), where it is most accurate, or at the nodes (T, N), ends included.

    Returns
    -------
    (T, Q) or (T, N) [m]
    """
    strain = history.total_strains(rod)
    if at == "nodes":
        strain = history.at_nodes(rod, strain)
    elif at != "stations":
        raise ValueError(f"bend_radius: at must be 'stations' or 'nodes' (got {at!r}).")
    stretch = np.linalg.norm(strain[..., :3], axis=-1)
    bending = np.hypot(strain[..., 3], strain[..., 4])
    return np.divide(
        stretch, bending, out=np.full_like(stretch, np.inf), where=bending > 1e-12 * bending.max(initial=1e-300)
    )


def distance_from_drawing(history: History, rod: Rod | str) -> np.ndarray:
    """Distance (T, N) [m] of each node from the drawn route (the nearest point of the drawn curve)."""
    positions = history.positions(rod)
    rod = history.rod(rod)
    curve = rod.drawn(np.linspace(0.0, rod.length, 1001))
    distance = np.empty(positions.shape[:2])
    distance_to_polyline(positions.reshape(-1, 3), curve, distance.reshape(-1))
    return distance


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
    rod = history.rod(rod)
    if isinstance(other, str):
        other = history.rod(other) if other in [r.name for r in history.model.rods] else history.part(other)
    if isinstance(other, Rod):
        other = history.rod(other)
        if other is rod:
            raise ValueError(f"clearance: of rod {rod.name!r} with itself there is none; name two rods or a part.")
    elif not other.shapes and other.mesh is None:
        raise ValueError(f"clearance: part {other.name!r} has neither a shape nor a mesh.")
    out = np.full(len(history), np.inf)
    for begin in range(0, len(out), BLOCK):
        steps = range(begin, min(begin + BLOCK, len(out)))
        if isinstance(other, Rod):
            curves = _Curve(history, rod, steps), _Curve(history, other, steps)
            out[steps.start : steps.stop] = _between(*curves, leave_out)
            continue
        curve = _Curve(history, rod, steps, other)
        bodies = [_Body(shape.distance) for shape in other.shapes]
        bodies += [_Body(other.surface().distance, other.surface())] if other.mesh is not None else []
        for body in bodies:
            least = _nearest(curve, body, leave_out)
            out[steps.start : steps.stop] = np.minimum(out[steps.start : steps.stop], least)
    return out


BLOCK = 256  # states looked at together
FINE = 0.25  # radii: pieces of a rod this long are searched for the smallest distance by sections
SECTIONS, WINDOWS = 32, 60  # golden sections; moves or halvings of a window
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
        self.rod, self.h = rod, group.dx[view.elements].sum(axis=1)
        self.s = np.cumsum(self.h) - self.h
        self.widest = float(rod.radius_at(np.concatenate([self.s, [rod.length], [s for s, _ in rod.sections]])).max())

    def place(self, t: np.ndarray, e: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """Places (K, 3) [m] at xi in elements e of states t, each (K,)."""
        out = np.zeros((len(t), 3))
        for j in range(self.C.shape[2] - 1, -1, -1):
            out = out * (xi - 0.5)[:, None] + self.C[t, e, j]
        return out

    def radius(self, e: np.ndarray, xi: np.ndarray) -> np.ndarray:
        return self.rod.radius_at(self.s[e] + xi * self.h[e])

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
        if self.surface is None or not len(x) or (self.surface.closed and (d <= reach).any()):
            return self.distance
        start, index = self.surface.candidates(x, np.abs(d) + 2.0 * reach)
        corners, row = self.surface.points[self.surface.triangles[index]], np.repeat(np.arange(len(x)), np.diff(start))
        return lambda y: np.minimum.reduceat(triangle_distance(y[row], corners), start[:-1])


def _nearest(curve: _Curve, body: _Body, leave_out: Sequence[tuple[float, float]]) -> np.ndarray:
    """Smallest distance (T,) [m] of a rod's surface from a body: pieces that are too far away are put aside, the others
    halved until they are short; then sections about each smallest one."""
    T = len(curve.C)
    best, new = np.full(T, np.inf), curve.pieces(leave_out)
    short, values = new[:0], np.empty(0)
    while len(new.t):
        x, ball = curve.place(new.t, new.e, new.mid), curve.speed[new.t, new.e] * new.half
        radius, d = curve.radius(new.e, new.mid), body.lower(x)
        if body.surface is not None:
            order = np.lexsort((d - ball, new.t))
            first = order[np.unique(new.t[order], return_index=True)[1]]
            np.minimum.at(best, new.t[first], body.distance(x[first]) - radius[first])
            near = np.flatnonzero(d - ball - curve.widest <= best[new.t])
            new, x, ball, radius = new[near], x[near], ball[near], radius[near]
            d = body.distance(x)
        np.minimum.at(best, new.t, d - radius)
        near = d - ball - curve.widest <= best[new.t]
        long = near & (2.0 * ball > FINE * curve.widest)
        done = near & ~long
        short, values = _joined(short, new[done]), np.concatenate([values, (d - radius)[done]])
        new = new[long].halves()
    pick = _lowest(short, values)
    short = short[pick]
    reach = 2.0 * curve.speed[short.t, short.e] * short.half
    x = curve.place(short.t, short.e, short.mid)
    measure = body.about(x, values[pick] + curve.radius(short.e, short.mid), reach)

    def f(xi: np.ndarray) -> np.ndarray:
        return measure(curve.place(short.t, short.e, xi)) - curve.radius(short.e, xi)

    a = np.maximum(short.mid - 2.0 * short.half, short.low)
    b = np.minimum(short.mid + 2.0 * short.half, short.high)
    for end in (a, b):
        np.minimum.at(best, short.t, f(end))
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    fc, fd = f(c), f(d)
    for _ in range(SECTIONS if len(short.t) else 0):
        np.minimum.at(best, short.t, np.minimum(fc, fd))
        left = fc < fd
        a, b = np.where(left, a, c), np.where(left, d, b)
        kept, f_kept = np.where(left, c, d), np.where(left, fc, fd)
        inner = np.where(left, b - GOLDEN * (b - a), a + GOLDEN * (b - a))
        f_inner = f(inner)
        c, fc = np.where(left, inner, kept), np.where(left, f_inner, f_kept)
        d, fd = np.where(left, kept, inner), np.where(left, f_kept, f_inner)
    return best


def _joined(a: _Pieces, b: _Pieces) -> _Pieces:
    return _Pieces(*(np.concatenate([x, y]) for x, y in zip(vars(a).values(), vars(b).values(), strict=True)))


def _lowest(pieces: _Pieces, values: np.ndarray) -> np.ndarray:
    """Numbers of the pieces that are no higher than the ones before and after them."""
    order = np.lexsort((pieces.mid, pieces.e, pieces.t))
    t, v = pieces.t[order], values[order]
    begin, end = (pieces.e + pieces.mid - pieces.half)[order], (pieces.e + pieces.mid + pieces.half)[order]
    meets = (t[1:] == t[:-1]) & (np.abs(begin[1:] - end[:-1]) < 1e-9)
    rises = ~meets | (v[1:] >= v[:-1])
    falls = ~meets | (v[1:] <= v[:-1])
    return order[np.append(rises, True) & np.append(True, falls)] if len(order) else order


def _between(one: _Curve, two: _Curve, leave_out: Sequence[tuple[float, float]]) -> np.ndarray:
    """Smallest distance (T,) [m] between the surfaces of two rods."""
    best = np.full(len(one.C), np.inf)
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
        np.minimum.at(best, a.t, f)
        near = d - ball[0] - ball[1] - thick <= best[a.t]
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
    pick = first[_lowest(a[first], f[first])]
    a, b = a[pick], b[pick]
    u, v = a.mid, b.mid
    du, dv = (fine / np.maximum(curve.speed[x.t, x.e], 1e-300) for curve, x in ((one, a), (two, b)))
    values = np.empty((len(GRID), len(u)))
    k = np.arange(len(u))
    for _ in range(WINDOWS):  # a window follows the smallest place in it, and shrinks about it
        us = [np.clip(u + x * du, a.low, a.high) for x in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        vs = [np.clip(v + y * dv, b.low, b.high) for y in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        for row, (i, j) in enumerate(GRID):
            values[row] = _apart(one, two, a, b, us[i], vs[j])
        least = np.argmin(values, axis=0)
        inside = (np.abs(GRID[least] - 2) < 2).all(axis=1)
        u, v = np.array(us)[GRID[least, 0], k], np.array(vs)[GRID[least, 1], k]
        du, dv = np.where(inside, 0.5 * du, du), np.where(inside, 0.5 * dv, dv)
        np.minimum.at(best, a.t, values[least, k])
    return best


GRID = np.array([(i, j) for i in (2, 1, 3, 0, 4) for j in (2, 1, 3, 0, 4)])  # places in a window, its middle first


def _apart(one: _Curve, two: _Curve, a: _Pieces, b: _Pieces, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Distance (K,) [m] between the surfaces at xi = u and v of pairs of pieces."""
    d = np.linalg.norm(one.place(a.t, a.e, u) - two.place(b.t, b.e, v), axis=1)
    return d - one.radius(a.e, u) - two.radius(b.e, v)


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


def worst(values: np.ndarray, t: np.ndarray, s: np.ndarray, *, largest: bool = True) -> dict[str, Any]:
    """Largest (or smallest) of values (T, S) and where and when it is: {"value", "s", "t"}."""
    flat = int(np.argmax(values) if largest else np.argmin(values))
    row, column = np.unravel_index(flat, values.shape)
    return {"value": float(values[row, column]), "s": float(s[column]), "t": float(t[row])}
