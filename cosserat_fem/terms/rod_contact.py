"""Contact among rods, and of a rod with itself.

Rule: every place of a rod meets the nearest place of each strand that comes near: along a line where rods lie side by side,
over a short patch where they cross; both are integrated as they are, so nothing jumps while nodes slide past
(`kernels.pairs`). Neighbours on one rod, closer along it than the half circle that it can be bent to, never meet.

Couplings of rods do not fit in the chains that are otherwise solved: while rods touch, the system is a sparse one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..kernels import contact as kernels
from ..kernels.pairs import press_pairs
from ..kernels.shapes import STRAND
from ..kernels.strand import cell_ends, largest_step_between
from ..rod import Rod
from ..space import Blocks, Space, State, Touch
from .external import check_rod
from .joint import second_places
from .part_contact import CLOSING, LEFT, MARGIN, NOBODY, NOTHING, SLIGHTEST, SMOOTH, SPARE, STRETCHED, THICKER, fresh
from .touch import (
    ELASTIC,
    RANGE,
    Cells,
    Found,
    Obstacles,
    Pressed,
    check_law,
    contact_radius,
    kept_at,
    raised,
    renewed,
    search,
    spans_of,
    starting_scale,
)

APART = 1.1 * np.pi  # radii along a rod within which it does not touch itself
MOST_PAIRS = 60  # pairs of cells for each cell, at most, when looking far ahead


@dataclass(frozen=True, eq=False)
class RodContact:
    """Rods that touch each other and themselves.

    Parameters
    ----------
    rods : sequence of Rod
        One or several, of the same order.
    friction, stand_off, elastic_slip, pressure, layer
        As for `PartContact`; the layer is that of both surfaces together.
    radius : [m], optional
        Of all rods, or one for each; default that of each one's section.
    """

    rods: Sequence[Rod]
    friction: float = 0.0
    radius: Any = None
    stand_off: float | None = None
    elastic_slip: float | None = None
    pressure: float | None = None
    layer: tuple[float, float] | None = None
    name: str = ""
    radii: tuple[float, ...] = field(init=False)

    contact = True

    def __post_init__(self) -> None:
        rods = (self.rods,) if isinstance(self.rods, Rod) else tuple(self.rods)
        if not rods:
            raise ValueError("contact of rods: rods is empty. Name the rods that may touch.")
        for rod in rods:
            check_rod("contact of rods", rod)
        names = [rod.name for rod in rods]
        if len(set(rods)) < len(rods):
            twice = next(n for n in names if names.count(n) > 1)
            raise ValueError(f"contact of rods: rod {twice!r} is named twice. A rod touches itself when named once.")
        orders = {rod.order for rod in rods}
        if len(orders) > 1:
            raise ValueError(f"contact of rods: all must be of one order (got {sorted(orders)}). Give them the same.")
        where = f"contact of rods {', '.join(map(repr, names))}"
        object.__setattr__(self, "rods", rods)
        object.__setattr__(self, "name", self.name or "-".join(names if len(names) > 1 else names * 2))
        check_law(where, self)
        given = self.radius if isinstance(self.radius, list | tuple) else [self.radius] * len(rods)
        if len(given) != len(rods):
            raise ValueError(f"{where}: radius must be one number, or one for each rod (got {len(given)}).")
        radii = [contact_radius(where, rod, radius) for rod, radius in zip(rods, given, strict=True)]
        object.__setattr__(self, "radii", tuple(radii))
        if self.layer is not None and self.layer[1] >= 2 * min(self.radii):
            raise ValueError(
                f"{where}: the layer must be thinner than both radii together (got {self.layer[1]:g} m, radius "
                f"{min(self.radii):g} m)."
            )

    @property
    def symmetric(self) -> bool:
        return self.friction == 0.0

    @property
    def acts_on_strings(self) -> bool:
        return self.friction == 0.0

    @property
    def between(self) -> str:
        names = [repr(rod.name) for rod in self.rods]
        return f"rods {', '.join(names)}" if len(names) > 1 else f"rod {names[0]} and itself"

    @property
    def range(self) -> float:
        """Range of the barrier [m]."""
        return 2.0 * self.stand_off if self.stand_off is not None else RANGE * min(self.radii)

    @property
    def depth(self) -> float:
        """How far below the sum of radii the distance may come [m]."""
        return 0.5 * self.range if self.layer is None else self.layer[1] + self.range

    @property
    def shortest(self) -> float:
        """Stretch [m] on which a rod may hit something."""
        return 0.02 * min(self.radii)

    @property
    def slip(self) -> float:
        return self.elastic_slip or ELASTIC * min(self.radii)

    def start(self, space: Space) -> Touch:
        """Memory at the start of a run."""
        patch = 2.0 * np.sqrt(2.0 * self.range * min(self.radii))
        scale = self.pressure or starting_scale(list(self.rods), patch)
        return Touch.of_nothing(scale)

    def _near(self, space: Space) -> Near:
        return space.remember((self, "near"), lambda: Near(self, Cells.of(self.rods, self.radii, space)))

    def __call__(self, state: State, space: Space, *, tangent: bool = True, exact: bool = True) -> Blocks:
        found = self._near(space).find(state)
        if not len(found.rows):
            return NOTHING
        nodes, force, stiffness, _, stiffest = self._press(state, space, found, tangent, exact)
        return Blocks(nodes, force, stiffness if tangent else None, None, stiffest)

    def _press(
        self, state: State, space: Space, found: Found, tangent: bool, exact: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        """Nodes of touching sets of elements (B, m), residual force, stiffness, what each point does, the stiffest."""
        near = self._near(space)
        cells = near.cells
        contact = state.contact or fresh(state, self, space)
        touch = contact.touch[self]
        laws = near.laws(found, touch.scale)
        rows, others, second, which = second_places(cells, self.range, found, found.rows[:, 2] - laws[:, 0], state.r)
        mine = cells.nodes[found.element]
        _, first, slot = np.unique(which, return_index=True, return_inverse=True)
        nodes = np.concatenate([mine[first], others[first]], axis=1)
        n = nodes.shape[1]
        force = np.zeros((len(first), n, 6))
        stiffness = np.zeros((len(first), 6 * n, 6 * n)) if tangent else NOBODY
        values = np.zeros((len(found.rows), 9))
        rubbing = SMOOTH
        if self.friction > 0:
            places = near.keys(found)
            theta, (T, R) = np.empty_like(state.r), np.empty((2, len(state.r), 3, 3))
            kernels.turned(state.q, contact.base_q, theta, T, R)
            rubbing = places, *kept_at(touch, places), contact.base_r, theta, T, R
        stiffest = press_pairs(
            rows, mine, others, second, slot, cells.coefficients, laws, np.array([self.friction, self.slip]), rubbing, exact,
            force, stiffness, values,
        )  # fmt: skip
        return nodes, force, stiffness, values, stiffest

    def gap(self, state: State, space: Space) -> float:
        """Smallest distance [m] that was looked at, minus the one that is never reached."""
        return self._near(space).find(state).gap

    def touched(self, state: State, space: Space) -> float:
        """Length [m] of rod that is pressed."""
        return float(self._near(space).find(state).rows[:, 1].sum())

    def stays(self, state: State, trial: State, space: Space) -> float:
        """Length [m] of what is pressed that would be so at a trial state if rods were straight."""
        near = self._near(space)
        found, cells = near.find(state), near.cells
        rows, step = found.rows, trial.r - state.r
        other = cells.cells[rows[:, 6].astype(np.int64), 0]
        way = cells.places(found.element, rows[:, 0], step) - cells.places(other, rows[:, 7], step)
        closer = rows[:, 2] + np.einsum("ki,ki->k", rows[:, 3:6], way) < near.levels[found.obstacle]
        return float(rows[closer, 1].sum())

    def lift(self, state: State, space: Space, times: float) -> np.ndarray:
        """See `PartContact`; each of two rods goes half of the way."""
        near = self._near(space)
        found = near.find(state)
        x = (found.rows[:, 2] - near.cores.ravel()[found.obstacle]) / self.range
        patch = found.element * len(self.rods) ** 2 + found.obstacle
        way = 0.5 * self.range * raised(x, found.rows[:, 1], patch, times)
        return near.cells.lifted(found, way, len(state.r))

    def overlaps(self, state: State, space: Space) -> list[str]:
        """What is wrong with a state at the start: rods inside each other."""
        near = self._near(space)
        found = near.find(state)
        if found.gap > 0:
            return []
        cell, pair, xi = found.lowest
        first, second = (self.rods[k].name for k in divmod(pair, len(self.rods)))
        s = near.cells.s_of(np.array([cell]), np.array([xi]))[0]
        what = f"rod {second!r}" if first != second else "itself"
        return [f"rod {first!r}: at s = {s:.4g} m it is {-found.gap:.3g} m inside {what}."]

    def softened(self, state: State, space: Space, stiffness: float) -> RodContact | None:
        """Soft rods, a little thicker, that do not overlap in this state; None if centrelines meet. See `PartContact`."""
        both = 2.0 * min(self.radii)
        distance = self._near(space).find(state).gap + both - self.depth
        if distance < SLIGHTEST * both:
            return None
        thick = THICKER * both
        layer = (stiffness * self.start(space).scale / both, thick - 0.9 * min(distance, both))
        radii = [THICKER * a for a in self.radii]
        return replace(self, radius=radii, friction=0.0, layer=layer, stand_off=0.05 * (thick - layer[1]))

    def widened(self, part: float) -> RodContact:
        """See `PartContact`; in parts of the smallest radius."""
        both = 2.0 * min(self.radii)
        room = both if self.layer is None else 0.5 * (both - self.layer[1])
        deep = max(self.range, min(0.5 * part * both, room))
        thinner = 0.0 if self.layer is not None else 0.25 * (self.range - deep)
        return replace(self, radius=[a + thinner for a in self.radii], stand_off=0.5 * deep)

    def potential(self, state: State, space: Space) -> float:
        """Energy [J] stored in the barrier and the layer."""
        found = self._near(space).find(state)
        if not len(found.rows):
            return 0.0
        values = self._press(state, space, found, False, False)[3]
        return 0.5 * float(found.rows[:, 1] @ values[:, 7])

    def accept(self, state: State, space: Space) -> tuple[Touch, Pressed]:
        """Memory after a state is accepted, and what it says of the contact."""
        near = self._near(space)
        found = near.find(state)
        contact = state.contact or fresh(state, self, space)
        touch = contact.touch[self]
        cell, pair, xi = found.lowest
        both = ", ".join(rod.name for rod in self.rods)
        gap = found.gap - self.depth
        s_gap = float(near.cells.s_of(np.array([cell]), np.array([xi]))[0])
        if not len(found.rows):
            return Touch.of_nothing(touch.scale, touch.lost), Pressed.none(
                self.name, both, both, gap, s_gap, touch.lost
            )
        nodes, force, _, values, _ = self._press(state, space, found, False, False)
        w, p, m, u = 0.5 * found.rows[:, 1], values[:, 0], values[:, 1:4], values[:, 4:7]
        size = np.linalg.norm(u, axis=1)
        held = u * np.minimum(1.0, self.slip / np.maximum(size, 1e-300))[:, None]
        lost = touch.lost + float(np.einsum("k,k,ki,ki->", w, p, m, u - held))
        places, part = near.keys(found), values[:, 8]
        memory = renewed(touch, places, held, part, found.rows[:, 1] * p, self.slip)
        kept = part[:, None] * kept_at(touch, places)[0]
        rubbed = -float(np.einsum("k,k,ki,ki->", w, p, m, u - kept))
        s = near.cells.s_of(found.cell, found.rows[:, 0])
        top = int(np.argmax(p))
        told = Pressed(
            self.name, both, both, np.zeros(6), gap, s_gap, spans_of(s, found.rows[:, 1]), float(p[top]),
            float(s[top]), lost, nodes.ravel(), -force.reshape(-1, 6), rubbed,
        )  # fmt: skip
        return Touch(*memory, touch.scale, lost), told

    def largest_step(self, state: State, trial: State, space: Space) -> float:
        """Part of the way to a trial state that no gap forbids."""
        return self._near(space).largest_step(state, trial)

    def clear(self, state: State, trial: State, space: Space) -> bool:
        """True if in a trial state no rods are in each other, nor stretched too far to be seen."""
        near = self._near(space)
        if not near.find(trial).gap > LEFT * min(near.find(state).gap, self.range):
            return False
        return near.cells.chord(trial.r) <= max(STRETCHED, 1.05 * near.cells.chord(state.r))


@dataclass(eq=False)
class Near:
    """Which cells of rods are near each other; a cache, what it returns depends on states alone."""

    term: RodContact
    cells: Cells

    def __post_init__(self) -> None:
        n, cells = len(self.cells.rods), self.cells
        a = cells.radii
        self.cores = a[:, None] + a[None] - self.term.depth
        level = self.cores + self.term.range + (0.0 if self.term.layer is None else self.term.layer[1])
        self.levels = level.ravel()
        self.frames, self.origins = np.tile(np.eye(3), (n * n, 1, 1)), np.zeros((n * n, 3))
        self.kinds, self.sizes = np.full(n * n, STRAND, dtype=np.int64), np.zeros((n * n, 3))
        # arc length between cells of one rod, from middle to middle, less half of each
        self.s = (
            cells.begin[cells.cells[:, 0]]
            + (cells.cells[:, 1] + 0.5) / cells.counts[cells.cells[:, 0]] * (cells.h[cells.cells[:, 0]])
        )
        self.half = 0.5 * cells.h[cells.cells[:, 0]] / cells.counts[cells.cells[:, 0]]
        self.middle: np.ndarray | None = None
        self._found: list[tuple[np.ndarray, Found]] = []

    def ends(self, r: np.ndarray) -> np.ndarray:
        cells = self.cells
        ends = np.empty((len(cells.cells) + len(cells.rods), 3))
        cell_ends(cells.cells, cells.counts, cells.nodes, cells.coefficients, r, cells.rod_of, ends)
        return ends

    def look_around(self, middle: np.ndarray, radius: np.ndarray, margin: float) -> None:
        """Find pairs of cells that come near when each moves by half of a margin [m] past the others."""
        tree = cKDTree(middle)
        largest, level = float(radius.max()), float(self.levels.max())
        while True:
            reach = 2.0 * largest + level + margin
            n = len(middle)
            if margin <= MARGIN * max(self.term.radii) or tree.count_neighbors(tree, reach) < 2 * MOST_PAIRS * n:
                break
            margin *= 0.5
        pairs = tree.query_pairs(reach, output_type="ndarray")
        i, j = pairs[:, 0], pairs[:, 1]
        rod_of = self.cells.rod_of
        o = rod_of[i] * len(self.cells.rods) + rod_of[j]
        way = np.sqrt(((middle[i] - middle[j]) ** 2).sum(axis=1))
        near = way <= radius[i] + radius[j] + self.levels[o] + margin
        along = np.abs(self.s[i] - self.s[j]) - self.half[i] - self.half[j]
        apart = (rod_of[i] != rod_of[j]) | (along >= APART * self.cells.radii[rod_of[i]])
        self.pairs = np.ascontiguousarray(pairs[near & apart].astype(np.int64))
        self.entries = self._strands(np.concatenate([self.pairs, self.pairs[:, ::-1]]))
        self.middle, self.radius, self.margin = middle, radius, margin
        self._found = []  # what was found among fewer pairs says nothing of the others

    def _strands(self, pairs: np.ndarray) -> np.ndarray:
        """Entries (cell, pair of rods, first, last) of directed pairs of cells: neighbours in one strand."""
        if not len(pairs):
            return np.empty((0, 4), dtype=np.int64)
        i, j = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
        rod_of = self.cells.rod_of
        new = np.ones(len(i), dtype=bool)
        new[1:] = (i[1:] != i[:-1]) | (j[1:] != j[:-1] + 1) | (rod_of[j[1:]] != rod_of[j[:-1]])
        first = np.flatnonzero(new)
        last = np.append(first[1:], len(i)) - 1
        pair = rod_of[i[first]] * len(self.cells.rods) + rod_of[j[first]]
        return np.stack([i[first], pair, j[first], j[last]], axis=1)

    def _moved(self, middle: np.ndarray, radius: np.ndarray) -> float:
        """How far cells have moved past each other since pairs were found, at most."""
        way = middle - self.middle
        way -= way.mean(axis=0)
        return float((np.sqrt((way * way).sum(axis=1)) + np.maximum(radius - self.radius, 0.0)).max())

    def find(self, state: State) -> Found:
        """Points that press at a state."""
        for r, found in self._found:
            if r is state.r:
                return found
        middle, radius = self.cells.balls(state.r)
        if self.middle is None or self._moved(middle, radius) > 0.5 * self.margin:
            self.look_around(middle, radius, MARGIN * max(self.term.radii))
        cells = self.cells
        rods = (
            self.ends(state.r), cells.cells, cells.counts, cells.nodes, cells.coefficients, state.r, cells.rod_of,
            cells.bounds,
        )  # fmt: skip
        obstacles = Obstacles(self.kinds, self.sizes, self.levels, self.cores.ravel(), rods=rods)
        found = search(cells, self.entries, state.r, obstacles, self.frames, self.origins)
        self._found = [(state.r, found), *self._found[:2]]
        return found

    def keys(self, found: Found) -> np.ndarray:
        """Keys (K,) under which slips are remembered: cell and other rod."""
        n = len(self.cells.rods)
        return found.cell * n + found.obstacle % n

    def laws(self, found: Found, scale: float) -> np.ndarray:
        """Law (K, 7) of each point, for the kernel."""
        n, term = len(self.cells.rods), self.term
        out = np.empty((len(found.rows), 7))
        out[:, 0] = self.cores.ravel()[found.obstacle]
        out[:, 1:5] = (term.range, scale, *((0.0, 0.0) if term.layer is None else term.layer))
        out[:, 5], out[:, 6] = self.cells.radii[found.obstacle // n], self.cells.radii[found.obstacle % n]
        return out

    def largest_step(self, state: State, trial: State) -> float:
        """Part of the way to a trial state on which no pair is overlooked, nor a gap closed."""
        here, there = self.cells.balls(state.r), self.cells.balls(trial.r)
        step = there[0] - here[0]
        step = step - step.mean(axis=0)
        way = float((np.sqrt((step * step).sum(axis=1)) + np.maximum(there[1] - here[1], 0.0)).max())
        moved = np.inf if self.middle is None else self._moved(*here)
        if moved + way > 0.5 * self.margin if self.middle is not None else True:
            self.look_around(*here, max(MARGIN * max(self.term.radii), 2.2 * way))
            moved = 0.0
        alpha = min(1.0, (0.5 * self.margin - moved) / max(way, 1e-300))
        ends, after, rod_of = self.ends(state.r), self.ends(trial.r), self.cells.rod_of
        left = np.arange(len(rod_of)) + rod_of
        sag = 1.1 * np.linalg.norm(here[0] - 0.5 * (ends[left] + ends[left + 1]), axis=1)
        gap = self.find(state).gap
        least = gap if np.isfinite(gap) else 0.0
        spare = SPARE * self.term.range
        return min(alpha, largest_step_between(self.pairs, ends, after, rod_of, self.cores, sag, least, CLOSING, spare))
