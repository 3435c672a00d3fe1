"""Where can rods touch? Cells along a rod, and the law that all contact terms share.

Rule: a rod that may touch something is cut into cells about as long as its radius. Cells are what is looked for near
parts and other rods, what must not be overtaken in a step, and what remembers friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import check_number, check_positive
from ..kernels.clearance import cell_balls, longest_chord, strayed
from ..kernels.reach import COLUMNS, find
from ..rod import Rod
from ..space import Space, Touch

CELL = 1.5  # longest cell in radii
TIP = 0.01  # radii: length that counts at the very end of a rod, and at a kink
RANGE = 2e-3  # range of the barrier in radii: stand-off errors are at most half of it
ELASTIC = 5e-3  # elastic slip in radii
BENDING = 10.0  # times EI / L^2: force expected at a place
MOST_CELLS = 2_000_000
UNTURNED, ORIGIN = np.eye(3), np.zeros(3)


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of one or several rods of the same order, one after the other.

    radii (rods,); nodes (E, A): node numbers of elements; coefficients (A, A) of the shape functions in powers of xi - 1/2;
    h (E,) [m] length of each element, begin (E,) [m] where it begins on its rod; counts (E,): cells in it; cells (n, 2):
    element and number in it; rod_of (n,), bounds (rods, 2): rod of each cell, first and last cell of each rod; tips
    (n, 2) [m]: see `kernels.reach.find`, at ends of rods and kinks; group, numbers (E,): where the elements are in the
    space.
    """

    rods: tuple[Rod, ...]
    radii: np.ndarray
    nodes: np.ndarray
    coefficients: np.ndarray
    h: np.ndarray
    begin: np.ndarray
    counts: np.ndarray
    cells: np.ndarray
    rod_of: np.ndarray
    bounds: np.ndarray
    tips: np.ndarray
    group: int
    numbers: np.ndarray

    @classmethod
    def of(cls, rods: Sequence[Rod], radii: Sequence[float], space: Space) -> Cells:
        """Cells of rods about as long as their radius."""
        group = space.groups[space[rods[0]].group]
        xi = group.basis.elem.doflocs[:, 0] - 0.5
        coefficients = np.linalg.inv(xi[:, None] ** np.arange(len(xi)))
        nodes, h, begin, counts, numbers, of = [], [], [], [], [], []
        for k, (rod, radius) in enumerate(zip(rods, radii, strict=True)):
            elements = space[rod].elements
            lengths = group.dx[elements].sum(axis=1)
            nodes.append(group.conn[elements])
            h.append(lengths)
            begin.append(np.cumsum(lengths) - lengths)
            counts.append(np.maximum(1, np.ceil(lengths / (CELL * radius) * (1 - 1e-9))))
            numbers.append(np.arange(elements.start, elements.stop))
            of.append(np.full(len(lengths), k))
            if counts[-1].sum() > MOST_CELLS:
                raise ValueError(
                    f"contact of rod {rod.name!r}: a radius of {radius:.3g} m cuts it into {counts[-1].sum():.3g} cells. "
                    "Is the radius given in the right unit?"
                )
        per_element = np.concatenate(counts).astype(np.int64)
        element = np.repeat(np.arange(len(per_element)), per_element)
        number = np.arange(len(element)) - np.repeat(np.cumsum(per_element) - per_element, per_element)
        rod_of = np.concatenate(of)[element]
        first = np.searchsorted(rod_of, np.arange(len(rods)))
        bounds = np.stack([first, np.append(first[1:], len(rod_of)) - 1], axis=1)
        tips = np.zeros((len(rod_of), 2))
        tips[bounds[:, 0], 0] = tips[bounds[:, 1], 1] = TIP * np.array(radii)
        if len(xi) == 2:  # straight elements meet in kinks
            ends = np.cumsum(per_element) - 1
            tips[ends, 1] = TIP * np.array(radii)[rod_of[ends]]
        return cls(
            tuple(rods), np.array(radii, dtype=float), np.concatenate(nodes), coefficients, np.concatenate(h),
            np.concatenate(begin), per_element, np.stack([element, number], axis=1), rod_of, bounds, tips,
            space[rods[0]].group, np.concatenate(numbers),
        )  # fmt: skip

    @cached_property
    def line(self) -> tuple[np.ndarray, ...]:
        """As `kernels.clearance` takes it."""
        return self.cells, self.counts, self.nodes, self.coefficients

    def balls(self, r: np.ndarray, Q: np.ndarray = UNTURNED, c: np.ndarray = ORIGIN) -> tuple[np.ndarray, np.ndarray]:
        """Middle (n, 3) and radius (n,) [m] of a ball about each cell, in a frame."""
        middle, radius = np.empty((len(self.cells), 3)), np.empty(len(self.cells))
        cell_balls(self.line, r, Q, c, middle, radius)
        return middle, radius

    def strayed(self, r: np.ndarray, Q: np.ndarray, c: np.ndarray, *known: np.ndarray) -> bool:
        """True if a cell is farther from its known ball (middle, radius) than allowed (n,) [m], in a frame."""
        return bool(strayed(self.line, r, Q, c, *known))

    def s_of(self, cell: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """Arc length [m] of places xi in the elements of some cells."""
        element = self.cells[cell, 0]
        return self.begin[element] + xi * self.h[element]

    def places(self, element: np.ndarray, xi: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Centreline (K, 3) [m] at places xi of some elements."""
        powers = (xi[:, None] - 0.5) ** np.arange(len(self.coefficients))
        return np.einsum("kj,ja,kai->ki", powers, self.coefficients, r[self.nodes[element]])

    def lifted(self, found: Found, way: np.ndarray, n_nodes: int) -> np.ndarray:
        """Ways (n_nodes, 3) [m] of nodes, which are means of those of points (K,) [m] along their normals near them."""
        powers = (found.rows[:, 0, None] - 0.5) ** np.arange(len(self.coefficients))
        weight = found.rows[:, 1, None] * (powers @ self.coefficients) ** 2
        nodes, out, sums = self.nodes[found.element], np.zeros((n_nodes, 3)), np.zeros(n_nodes)
        np.add.at(out, nodes, (weight * way[:, None])[..., None] * found.rows[:, None, 3:6])
        np.add.at(sums, nodes, weight)
        return out / np.maximum(sums, 1e-300)[:, None]

    def chord(self, r: np.ndarray) -> float:
        """Longest chord of a cell in radii of its rod."""
        return longest_chord(self.line, r, self.radii[self.rod_of])


@dataclass(frozen=True, eq=False)
class Obstacles:
    """What cells may meet: kinds (O,), sizes (O, 3), distances levels (O,) below which they press and cores (O,) that are
    never reached; mesh and other rods as `kernels.reach.find` takes them."""

    kinds: np.ndarray
    sizes: np.ndarray
    levels: np.ndarray
    cores: np.ndarray
    mesh: tuple[np.ndarray, ...] | None = None
    rods: tuple[np.ndarray, ...] | None = None

    def at(self, Q: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, ...]:
        """As the kernels take them, in frames Q (O, 3, 3), c (O, 3)."""
        return self.kinds, self.sizes, Q, c, self.levels, self.cores


@dataclass(frozen=True, eq=False)
class Found:
    """Points near enough to press: rows of the kernel, element (K,), cell (K,), obstacle (K,) of each; where those of each
    touched element begin and end, runs (S + 1,); the smallest distance minus core [m], and the cell, obstacle and xi where
    it is."""

    rows: np.ndarray
    element: np.ndarray
    cell: np.ndarray
    obstacle: np.ndarray
    runs: np.ndarray
    gap: float
    lowest: tuple[int, int, float]


def search(
    cells: Cells, entries: np.ndarray, r: np.ndarray, obstacles: Obstacles, Q: np.ndarray, c: np.ndarray
) -> Found:
    """All places at which cells are pressed, of entries (M, 4): cell, obstacle, and its first and last piece."""
    room = 64 + (8 if obstacles.mesh is None and obstacles.rods is None else 20) * len(entries)
    runs = np.empty(len(entries) + 1, dtype=np.int64)
    while True:
        rows, owners = np.empty((room, COLUMNS)), np.empty((3, room), dtype=np.int64)
        count, touched, gap, where, place = find(
            entries, cells.line, cells.tips, cells.h, r, obstacles.at(Q, c), obstacles.mesh, obstacles.rods, rows, owners,
            runs,
        )  # fmt: skip
        if count <= room:
            break
        room = count
    element, cell, obstacle = owners[:, :count]
    lowest = (int(entries[where, 0]), int(entries[where, 1]), place) if where >= 0 else (0, 0, 0.0)
    return Found(rows[:count], element, cell, obstacle, runs[: touched + 1], gap, lowest)


def contact_radius(where: str, rod: Rod, given: float | None) -> float:
    """Radius of a rod for contact [m]: what is given, or the section's."""
    if given is not None:
        return check_positive(f"{where}: radius", given)
    radii = {section.radius for _, section in rod.sections}
    if None in radii or len(radii) > 1:
        what = "its sections have different radii" if None not in radii else "its section has no radius"
        raise ValueError(f"{where}: rod {rod.name!r}: {what}; give the contact a radius.")
    return float(radii.pop())  # type: ignore[arg-type]


def check_law(where: str, term: Any) -> None:
    """ValueError for a value of a contact term that makes no sense."""
    if check_number(f"{where}: friction", term.friction) < 0:
        raise ValueError(f"{where}: friction must be 0 or greater (got {term.friction:g}).")
    for name in ("stand_off", "elastic_slip", "pressure"):
        if getattr(term, name) is not None:
            check_positive(f"{where}: {name}", getattr(term, name))
    if term.layer is not None:
        if not isinstance(term.layer, tuple | list) or len(term.layer) != 2:
            raise ValueError(f"{where}: layer must be (stiffness [N/m^2], depth [m]) (got {term.layer!r}).")
        check_positive(f"{where}: layer stiffness", term.layer[0])
        check_positive(f"{where}: layer depth", term.layer[1])


def starting_scale(rods: list[Rod], reach: float) -> float:
    """Pressure scale [N/m] to begin with: what bends a rod, on a patch of length `reach` [m], or its weight."""
    scale = 0.0
    for rod in rods:
        C, mass, _ = rod.section_at(np.array([0.5 * rod.length]))
        scale = max(scale, BENDING * float(C[0, 3, 3]) / rod.length**2 / reach, 9.81 * float(mass[0]))
    return scale


def raised(x: np.ndarray, weight: np.ndarray, group: np.ndarray, times: float) -> np.ndarray:
    """How much gaps x (K,), in parts of the range, must grow for groups (K,) of them to press as before with a larger scale.

    All of a group by the same; times: how many times as large the scale of the barrier is then.
    """

    def force(more: np.ndarray) -> np.ndarray:
        gap = np.minimum(x + more[which], 1.0)
        return np.bincount(which, weight * (gap - 1.0) * (2.0 * np.log(gap) + (gap - 1.0) / gap), len(first))

    _, first, which = np.unique(group, return_index=True, return_inverse=True)
    low, high = np.zeros(len(first)), np.zeros(len(first))
    np.maximum.at(high, which, 1.0 - x)
    wanted = force(low) / times
    for _ in range(50):
        middle = 0.5 * (low + high)
        harder = force(middle) > wanted
        low, high = np.where(harder, middle, low), np.where(harder, high, middle)
    return low[which]


def kept_at(touch: Touch, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remembered slips (n, 3) and normal forces (n,) of places with these keys, zero where nothing touched before."""
    slips, forces = np.zeros((len(keys), 3)), np.zeros(len(keys))
    if len(touch.keys):
        at = np.minimum(np.searchsorted(touch.keys, keys), len(touch.keys) - 1)
        known = touch.keys[at] == keys
        slips[known], forces[known] = touch.slips[at[known]], touch.forces[at[known]]
    return slips, forces


def renewed(
    touch: Touch, keys: np.ndarray, held: np.ndarray, part: np.ndarray, force: np.ndarray, elastic: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Keys of places, slip and normal force [N] that each remembers, of points with slips held (n, 3) [m] and force (n,).

    part (n,): of the slip remembered so far, as it counts now; elastic [m]: the largest slip. The friction of a place is
    kept: its slip is the mean by force, as long as the mean of lengths. A place that is pressed harder than it remembers
    goes on to remember the less force with the longer slip: let go to that force, it pulls as it did.
    """
    unique, first, which = np.unique(keys, return_index=True, return_inverse=True)
    weight = np.maximum(force, 1e-300)
    total = np.maximum(np.bincount(which, weight, len(unique)), 1e-300)
    mean = np.stack([np.bincount(which, weight * held[:, i], len(unique)) for i in range(3)], axis=1)
    size = np.bincount(which, weight * np.linalg.norm(held, axis=1), len(unique)) / total
    along = mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
    uncounted = (1.0 - part[first])[:, None] * kept_at(touch, unique)[0]
    longer = np.clip(size + (uncounted * along).sum(axis=1), size, np.maximum(size, elastic))
    share = np.where(longer > 0.0, size / np.maximum(longer, 1e-300), 1.0)
    return unique, longer[:, None] * along, share * np.bincount(which, force, len(unique))


@dataclass(frozen=True, eq=False)
class Pressed:
    """What one contact term does at an accepted state.

    name : of the term; rod, other : names of what touches
    load (6,) [N, N m] : on the part, or the rod named second, about the origin of space
    gap [m], gap_s [m] : smallest distance between the surfaces that was looked at, and where on the rod
    spans (K, 2) [m] : stretches of the rod that touch
    peak [N/m], peak_s [m] : largest line force
    lost [J] : by friction since the start
    rubbed [J] : work of friction on what rubs, in the step to this state: lost and stored in slip
    nodes (n,), force (n, 6) : what it does to the nodes of rods, as a force
    """

    name: str
    rod: str
    other: str
    load: np.ndarray
    gap: float
    gap_s: float
    spans: np.ndarray
    peak: float
    peak_s: float
    lost: float
    nodes: np.ndarray
    force: np.ndarray
    rubbed: float = 0.0

    @classmethod
    def none(cls, name: str, rod: str, other: str, gap: float, gap_s: float, lost: float) -> Pressed:
        """Nothing touches."""
        nodes = np.empty(0, dtype=np.int64)
        return cls(name, rod, other, np.zeros(6), gap, gap_s, np.empty((0, 2)), 0.0, 0.0, lost, nodes, np.empty((0, 6)))


def spans_of(s: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Stretches (K, 2) [m] that places s with their lengths cover, those closer than they are long joined."""
    if not len(s):
        return np.empty((0, 2))
    order = np.argsort(s)
    s, weight = s[order], weight[order]
    cuts = np.flatnonzero(np.diff(s) > 2.0 * (weight[1:] + weight[:-1]))
    first, last = np.append(0, cuts + 1), np.append(cuts, len(s) - 1)
    return np.stack([s[first] - 0.5 * weight[first], s[last] + 0.5 * weight[last]], axis=1)
