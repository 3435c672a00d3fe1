"""How is a triangle mesh put right? Equal points, doubled and flat triangles, direction of facets, smooth patches.

Rule: functions on arrays; each adds what it changed to `report`, one sentence each. Nothing is guessed: no hole is filled
and no point moved farther than round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from .kernels.triangles import dot, winding_number

SHARP = np.radians(25.0)  # bend of an edge beyond which its two sides are two faces
FLAT = 1e-6  # height of a triangle in parts of its longest edge, below which it has no area
SINGLE = 1e-7  # round-off of coordinates in single precision, in parts of the largest
GAP = 1e-6  # width of a gap that is closed, in parts of the size of the surface
SMOOTH, CONVEX, CONCAVE = 0, 1, 2


class Edges:
    """Edges of triangles: which triangles share one, and which way they run it."""

    def __init__(self, triangles: np.ndarray, n_points: int) -> None:
        a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
        self.ahead = a < b  # (3 F,) half edge k of triangle f is 3 f + k
        key = np.where(self.ahead, a * n_points + b, b * n_points + a)
        self.order = np.argsort(key, kind="stable")
        key = key[self.order]
        self.first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
        count = np.diff(np.append(self.first, len(key)))
        self.group = np.repeat(np.arange(len(count)), count)  # edge of each half edge in `order`
        self.count = count
        self.open = np.zeros(len(a), dtype=bool)
        self.open[self.order[self.first[count == 1]]] = True
        self.crowded = int((count > 2).sum())
        shared = self.first[count == 2]
        self.left, self.right = self.order[shared], self.order[shared + 1]  # half edges of edges of two triangles


def _turned(triangles: np.ndarray, flip: np.ndarray) -> np.ndarray:
    """Triangles with those of `flip` (F,) run the other way."""
    out = triangles.copy()
    out[flip] = triangles[flip][:, [1, 0, 2]]
    return out


def merged(points: np.ndarray, triangles: np.ndarray, report: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Merge equal points; leave out triangles with two equal corners and those that stand twice."""
    used, corners = np.unique(triangles, return_inverse=True)
    points, triangles = points[used] + 0.0, corners.reshape(-1, 3)  # -0 becomes 0
    order = np.lexsort(points.T)
    new = np.concatenate([[True], (np.diff(points[order], axis=0) != 0.0).any(axis=1)])
    if not new.all():
        label = np.empty(len(points), dtype=np.int64)
        label[order] = np.cumsum(new) - 1
        points, triangles = points[order[new]], label[triangles]
    return points, _distinct(triangles, report)


def _distinct(triangles: np.ndarray, report: list[str]) -> np.ndarray:
    """Leave out triangles with two equal corners and those that stand twice, in either direction."""
    a, b, c = triangles.T
    line = (a == b) | (b == c) | (c == a)
    if line.any() and not line.all():
        report.append(f"{count(int(line.sum()), 'triangle')} with two equal corners left out")
        triangles = triangles[~line]
    corners = np.sort(triangles, axis=1)
    order = np.lexsort(corners.T)
    same = (np.diff(corners[order], axis=0) == 0).all(axis=1)
    if same.any():
        report.append(f"{count(int(same.sum()), 'triangle')} that stood twice left out")
        keep = np.ones(len(triangles), dtype=bool)
        keep[order[1:][same]] = False
        triangles = triangles[keep]
    return triangles


def sewn(
    points: np.ndarray, triangles: np.ndarray, edges: Edges, report: list[str]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Merge corners of open edges that lie closer together than the gap; whether there were any."""
    rim = np.unique(triangles.ravel()[edges.open])
    rim = np.union1d(rim, np.roll(triangles, -1, axis=1).ravel()[edges.open])
    gap = GAP * float(np.ptp(points, axis=0).max())
    pairs = cKDTree(points[rim]).query_pairs(gap, output_type="ndarray")
    if not len(pairs):
        return points, triangles, False
    label = np.arange(len(points))
    _, joined = connected_components(_graph(pairs[:, 0], pairs[:, 1], len(rim)), directed=False)
    label[rim] = rim[np.unique(joined, return_index=True)[1][joined]]
    report.append(f"{count(int((label != np.arange(len(points))).sum()), 'point')} closer than {gap:.1g} m merged")
    return points, _distinct(label[triangles], report), True


def oriented(
    points: np.ndarray, triangles: np.ndarray, edges: Edges, report: list[str]
) -> tuple[np.ndarray, Edges, bool]:
    """Turn facets like their neighbours, and closed shells outwards (walls of cavities into them)."""
    n = len(triangles)
    a, b = edges.left // 3, edges.right // 3
    _, shell = connected_components(_graph(a, b, n), directed=False)
    flip = np.zeros(n, dtype=bool)
    one_sided = False
    against = edges.ahead[edges.left] == edges.ahead[edges.right]
    if against.any():
        # two copies of each triangle, as given and turned; neighbours that agree are joined: each half is one choice
        twice = _graph(np.concatenate([a, a + n]), np.concatenate([b + n * against, b + n * ~against]), 2 * n)
        _, side = connected_components(twice, directed=False)
        root = np.unique(shell, return_index=True)[1]
        flip = side[:n] != side[root][shell]
        one_sided = bool((side[:n] == side[n:]).any())
        most = np.bincount(shell, flip) > 0.5 * np.bincount(shell)  # rather turn the fewer
        flip ^= most[shell]
    triangles = _turned(triangles, flip)
    edges = Edges(triangles, len(points))
    whole = _whole(edges, shell)
    if one_sided:
        whole[:] = False
    volume = np.bincount(shell, _volumes(points, triangles, shell))
    inward = _inward(points, triangles, shell, whole, volume)
    out = inward[shell]
    triangles = _turned(triangles, out)
    turned = int((flip ^ out).sum())
    if turned:
        report.append(f"{count(turned, 'flipped triangle')} turned")
    if one_sided:
        report.append("a part of it has only one side (a Moebius band)")
    if out.any():
        edges = Edges(triangles, len(points))
    return triangles, edges, bool(whole.all())


def _whole(edges: Edges, shell: np.ndarray) -> np.ndarray:
    """Whether each shell runs each of its edges as often one way as the other."""
    whole = np.ones(int(shell.max()) + 1, dtype=bool)
    odd = edges.count[edges.group] != 2
    half = edges.order[odd]
    if not len(half):
        return whole
    key = edges.group[odd] * len(whole) + shell[half // 3]
    value, place = np.unique(key, return_inverse=True)
    net = np.bincount(place, np.where(edges.ahead[half], 1, -1))
    whole[value[net != 0] % len(whole)] = False
    return whole


def _volumes(points: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Signed volume (F,) [m^3] between each triangle and a point of its shell."""
    root = points[triangles[np.unique(shell, return_index=True)[1], 0]][shell]
    a, b, c = (points[triangles[:, k]] - root for k in range(3))
    return dot(a, np.cross(b, c)) / 6


def _inward(
    points: np.ndarray, triangles: np.ndarray, shell: np.ndarray, whole: np.ndarray, volume: np.ndarray
) -> np.ndarray:
    """Closed shells that must be turned: all, if together they point inwards, then those that bound no cavity."""
    turn = whole & (volume[whole].sum() < 0.0)
    negative = whole & ((volume < 0.0) != turn)
    solid = whole & ~negative
    if not negative.any() or not solid.any():
        return turn ^ negative
    order = np.argsort(shell, kind="stable")
    begin = np.searchsorted(shell[order], np.arange(len(whole) + 1))
    corners = points[triangles[order]]
    low = np.minimum.reduceat(corners.min(axis=1), begin[:-1])
    high = np.maximum.reduceat(corners.max(axis=1), begin[:-1])
    for k in np.flatnonzero(negative):
        around = np.flatnonzero(solid & (low <= low[k]).all(axis=1) & (high >= high[k]).all(axis=1))
        place = corners[begin[k]].mean(axis=0)[None]
        cavity = any(round(abs(winding_number(place, corners[begin[s] : begin[s + 1]])[0])) for s in around)
        turn[k] ^= not cavity
    return turn


def flat_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (F,) without area, as exactly as their coordinates are known."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    longest = np.sqrt(np.maximum(np.maximum(dot(b - a, b - a), dot(c - b, c - b)), dot(a - c, a - c)))
    height = np.sqrt(dot(normal, normal)) / longest
    return (height <= FLAT * longest) | ((height <= SINGLE * np.abs(points).max()) & (height <= 1e-3 * longest))


def patches(points: np.ndarray, triangles: np.ndarray, edges: Edges, flat: np.ndarray, closed: bool) -> np.ndarray:
    """Patch (F,) of each triangle."""
    n = len(triangles)
    a, b = edges.left // 3, edges.right // 3
    corners = points[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = cross / np.maximum(np.sqrt(dot(cross, cross)), 1e-300)[:, None]
    if flat.any():  # they go with the neighbour across their longest edge
        normal[flat] = 0.0
        mate = np.full(3 * n, -1)
        mate[edges.left], mate[edges.right] = b, a
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)[flat]
        across = mate.reshape(n, 3)[np.flatnonzero(flat), length.argmax(axis=1)]
        for _ in range(8):
            normal[flat] = np.where((across >= 0)[:, None], normal[across], 0.0)
    left = edges.left
    edge = points[np.roll(triangles, -1, axis=1).ravel()[left]] - points[triangles.ravel()[left]]
    agree = np.where(edges.ahead[left] == edges.ahead[edges.right], -1.0, 1.0)
    other = normal[b] * agree[:, None]
    turn = np.cross(normal[a], other)
    bend = np.arctan2(np.sqrt(dot(turn, turn)), dot(normal[a], other))
    kind = np.where(bend <= SHARP, SMOOTH, np.where((dot(turn, edge) < 0.0) | (not closed), CONCAVE, CONVEX))
    smooth = kind == SMOOTH
    _, face = connected_components(_graph(a[smooth], b[smooth], n), directed=False)
    sharp = ~smooth & (face[a] != face[b])
    if not (sharp & (kind == CONVEX)).any():
        return face
    f, g, length = face[a[sharp]], face[b[sharp]], np.sqrt(dot(edge, edge))[sharp]
    concave = kind[sharp] == CONCAVE
    foes = np.unique(np.sort(np.stack([f, g], axis=1)[concave], axis=1), axis=0)
    foes = np.concatenate([foes, _facing(foes, face, corners.mean(axis=1), cross)])
    friends, weight = _joined(np.sort(np.stack([f, g], axis=1)[~concave], axis=1), length[~concave])
    return _grouped(int(face.max()) + 1, friends, weight, foes)[face]


def _joined(pairs: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each pair once, with the sum of its weights."""
    unique, place = np.unique(pairs, axis=0, return_inverse=True)
    return unique, np.bincount(place.ravel(), weight, len(unique))


def _facing(foes: np.ndarray, face: np.ndarray, center: np.ndarray, cross: np.ndarray) -> np.ndarray:
    """Pairs of faces that look at each other across a common concave neighbour: the two walls of a channel."""
    ends = np.concatenate([foes, foes[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    begin = np.searchsorted(ends[:, 0], np.unique(ends[:, 0]))
    size = np.diff(np.append(begin, len(ends)))
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for k in np.unique(size[(size > 1) & (size <= 32)]):
        walls = ends[begin[size == k][:, None] + np.arange(k), 1]
        i, j = np.triu_indices(k, 1)
        pairs.append(np.sort(np.stack([walls[:, i].ravel(), walls[:, j].ravel()], axis=1), axis=1))
    found = np.unique(np.concatenate(pairs), axis=0)
    if not len(found):
        return found
    area = np.sqrt(dot(cross, cross))
    n = int(face.max()) + 1
    normal = np.stack([np.bincount(face, cross[:, k], n) for k in range(3)], axis=1)
    size = np.maximum(np.bincount(face, area, n), 1e-300)
    middle = np.stack([np.bincount(face, center[:, k] * area, n) / size for k in range(3)], axis=1)
    i, j = found.T
    apart = middle[j] - middle[i]
    return found[(dot(apart, normal[i]) > 0) & (dot(apart, normal[j]) < 0) & (dot(normal[i], normal[j]) < 0)]


def _grouped(n: int, friends: np.ndarray, weight: np.ndarray, foes: np.ndarray) -> np.ndarray:
    """Group (n,) of each face: friends are joined unless a group would hold foes.

    Friends next to foes are joined first, the longest edges first: where two groups meet at a convex edge after all, it is
    away from where they must differ.
    """
    _, group = connected_components(_graph(friends[:, 0], friends[:, 1], n), directed=False)
    foes = foes[group[foes[:, 0]] == group[foes[:, 1]]]
    if not len(foes):
        return group
    sources = np.unique(foes)
    ones = np.ones(len(friends))
    graph = coo_matrix((ones, (friends[:, 0], friends[:, 1])), shape=(n, n)).tocsr()
    hops = dijkstra(graph, directed=False, unweighted=True, indices=sources, min_only=True)
    mixed = np.isfinite(hops[friends[:, 0]])
    whole, friends, weight = friends[~mixed], friends[mixed], weight[mixed]
    order = np.lexsort((-weight, hops[friends].sum(axis=1)))
    parent = list(range(n))
    hostile: dict[int, set[int]] = {int(f): set() for f in sources}
    for f, g in foes.tolist():
        hostile[f].add(g)
        hostile[g].add(f)

    def root(f: int) -> int:
        while parent[f] != f:
            parent[f] = parent[parent[f]]
            f = parent[f]
        return f

    for f, g in friends[order].tolist():
        f, g = root(f), root(g)
        if f == g or g in hostile.get(f, ()):
            continue
        if len(hostile.get(f, ())) < len(hostile.get(g, ())):
            f, g = g, f
        parent[g] = f
        for foe in hostile.pop(g, ()):
            hostile[foe].discard(g)
            hostile[foe].add(f)
            hostile[f].add(foe)
    roots = np.array([root(f) for f in range(n)])
    _, group = connected_components(
        _graph(
            np.concatenate([whole[:, 0], np.arange(n)]),
            np.concatenate([whole[:, 1], roots]),
            n,
        ),
        directed=False,
    )
    return group


def renumbered(label: np.ndarray) -> np.ndarray:
    """Labels as 0, 1, ... in order of first appearance."""
    _, first, place = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[place]


def _graph(a: np.ndarray, b: np.ndarray, n: int) -> Any:
    return coo_matrix((np.ones(len(a), dtype=bool), (a, b)), shape=(n, n)).tocsr()


def count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
