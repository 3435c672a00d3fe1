"""Contact of a rod with a rigid part.

Rule: the rod never enters the part; a barrier with a range far below the rod's radius holds it off, friction acts at its
surface and so turns it, and the part gets the opposite of both (`kernels.contact`). What is near is found for cells of
the rod, with a margin, and found again only when a cell has used up its margin. Results do not depend on that.

A part may be several shapes and a mesh. Each shape, and each patch of the mesh that bends towards the rod, touches by
itself: a rod in a groove leans on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..kernels import clearance
from ..kernels import contact as kernels
from ..kernels.rotation import quaternion_from_matrix
from ..kernels.shapes import MESH
from ..mechanism import Part
from ..rod import Rod
from ..space import Blocks, Contact, Space, State, Touch
from .external import check_rod
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

MARGIN, FURTHEST = 2.0, 10.0  # radii: how far a cell may move before what is near is found again; at most in one go
THICKER, SLIGHTEST = 1.1, 0.02  # radii: of a rod that is pushed out of a part; nearest to it that can be
LEFT = 0.02  # part of a gap, or of the range, that a step must leave
CLOSING, SPARE = 0.9, 0.3  # part of a gap that one step may close, or all of it but this part of the barrier's range
STRETCHED = 1.9  # radii: a longer piece of rod between two looked at places could pass an obstacle
# times the largest component of a node's way: more than the ball about a cell moves and grows, on nodes to order 6
FARTHER = 13.0
NOBODY = np.empty((0, 3, 3))
# no friction: no places, slips, forces, ways, turns
SMOOTH = np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0), *2 * (np.empty((0, 3)),), *2 * (NOBODY,)


@dataclass(frozen=True, eq=False)
class PartContact:
    """A rod that touches a part.

    Parameters
    ----------
    rod : Rod
    part : Part
        With shapes, a mesh or both. The rod must start outside.
    friction : [-]
        Coulomb coefficient.
    radius : [m], optional
        Of the rod; default that of its section.
    stand_off : [m], optional
        Largest distance by which a touching surface may be off, at any pressure; default 1e-3 radii.
    elastic_slip : [m], optional
        Slip at which friction is full; below it the surfaces stick. Default 5e-3 radii.
    pressure : [N/m], optional
        Line force expected, a scale only: one between 0.01 and 100 times the real one costs least.
    layer : (stiffness [N/m^2], depth [m]), optional
        Compliant insulation: line force per indentation, down to a hard core.
    """

    rod: Rod
    part: Part
    friction: float = 0.0
    radius: Any = None
    stand_off: float | None = None
    elastic_slip: float | None = None
    pressure: float | None = None
    layer: tuple[float, float] | None = None
    name: str = ""

    contact = True

    def __post_init__(self) -> None:
        check_rod("part contact", self.rod)
        where = f"contact of rod {self.rod.name!r}"
        if not isinstance(self.part, Part):
            raise ValueError(f"{where}: part must be a Part (got {type(self.part).__name__}).")
        where += f" with part {self.part.name!r}"
        object.__setattr__(self, "name", self.name or f"{self.rod.name}-{self.part.name}")
        check_law(where, self)
        object.__setattr__(self, "radius", contact_radius(where, self.rod, self.radius))
        if not self.part.shapes and self.part.mesh is None:
            raise ValueError(f"{where}: the part has neither a shape nor a mesh. Give it one to touch.")
        if self.layer is not None and self.layer[1] >= self.radius:
            raise ValueError(
                f"{where}: the layer must be thinner than the radius, {self.radius:g} m (got {self.layer[1]:g} m)."
            )

    @property
    def symmetric(self) -> bool:
        return self.friction == 0.0

    @property
    def acts_on_strings(self) -> bool:
        return self.friction == 0.0

    @property
    def rods(self) -> tuple[Rod, ...]:
        return (self.rod,)

    @property
    def between(self) -> str:
        return f"rod {self.rod.name!r} and part {self.part.name!r}"

    @property
    def range(self) -> float:
        """Range of the barrier [m]."""
        return 2.0 * self.stand_off if self.stand_off is not None else RANGE * self.radius

    @property
    def core(self) -> float:
        """Distance of the centreline [m] that is never reached."""
        depth = 0.5 * self.range if self.layer is None else self.layer[1] + self.range
        return self.radius - depth

    @property
    def level(self) -> float:
        """Distance of the centreline [m] below which there is pressure."""
        return self.core + self.range + (0.0 if self.layer is None else self.layer[1])

    @property
    def shortest(self) -> float:
        """Stretch [m] on which a rod may hit something."""
        return 0.02 * self.radius

    @property
    def slip(self) -> float:
        return self.elastic_slip or ELASTIC * self.radius

    def start(self, space: Space) -> Touch:
        """Memory at the start of a run."""
        patch = 2.0 * np.sqrt(2.0 * self.range * self.radius)
        return Touch.of_nothing(self.pressure or starting_scale([self.rod], patch))

    def _near(self, space: Space) -> Near:
        return space.remember((self, "near"), lambda: Near(self, Cells.of([self.rod], [self.radius], space)))

    def __call__(self, state: State, space: Space, *, tangent: bool = True, exact: bool = True) -> Blocks:
        near = self._near(space)
        found = near.find(state)
        if not len(found.rows):
            return NOTHING
        touched, force, stiffness, _, stiffest = self._press(state, space, found, tangent, exact, told=False)
        cells = near.cells
        return Blocks(
            cells.nodes[touched], force, stiffness if tangent else None, (cells.group, cells.numbers[touched]), stiffest
        )

    def _press(
        self, state: State, space: Space, found: Found, tangent: bool, exact: bool, *, told: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        """Touched elements, residual force, stiffness, what each point does if it is to be told, largest stiffness."""
        cells = self._near(space).cells
        runs = found.runs
        touched = found.element[runs[:-1]]
        nodes = cells.nodes[touched]
        S, A = nodes.shape
        force = np.zeros((S, A, 6))
        stiffness = np.empty((S, 6 * A, 6 * A)) if tangent else NOBODY
        values = np.zeros((len(found.rows) if told else 0, 9))
        contact = state.contact or fresh(state, self, space)
        depth = (0.0, 0.0) if self.layer is None else self.layer
        law = np.array([self.core, self.range, contact.touch[self].scale, *depth])
        rubbing = SMOOTH if self.friction == 0.0 else self._slips(state, space, contact, found)
        stiffest = kernels.press(
            found.rows, runs, nodes, cells.coefficients, law, np.array([self.friction, self.slip, self.radius]), rubbing,
            exact, force, stiffness, values,
        )  # fmt: skip
        return touched, force, stiffness, values, stiffest

    def _slips(self, state: State, space: Space, contact: Contact, found: Found) -> tuple[np.ndarray, ...]:
        """What `press` takes of friction: all relative to the part, since the last accepted state."""
        near = self._near(space)
        (R, c), (R0, c0) = self.part.pose(contact.time), self.part.pose(contact.base_time)
        step = R @ R0.T
        places = near.keys(found)
        slips, before = kept_at(contact.touch[self], places)
        kept = slips @ R.T
        (away, theta), (T, R) = np.empty((2, *state.r.shape)), np.empty((2, len(state.r), 3, 3))
        turn = quaternion_from_matrix(step)
        kernels.moved_past(
            state.r, state.q, contact.base_r, contact.base_q, turn, step, c - step @ c0, away, theta, T, R
        )
        return places, kept, before, away, theta, T, R

    def gap(self, state: State, space: Space) -> float:
        """Smallest distance [m] that was looked at, minus the one that is never reached."""
        return self._near(space).find(state).gap

    def touched(self, state: State, space: Space) -> float:
        """Length [m] of rod that is pressed."""
        return float(self._near(space).find(state).rows[:, 1].sum())

    def stays(self, state: State, trial: State, space: Space) -> float:
        """Length [m] of what is pressed that would be so at a trial state if surfaces were flat."""
        near = self._near(space)
        found, cells = near.find(state), near.cells
        (R, c), (R1, c1) = self.part.pose(near.time(state)), self.part.pose(near.time(trial))
        xi, turn = found.rows[:, 0], R1 @ R.T
        with_part = (cells.places(found.element, xi, state.r) - c) @ turn.T + c1
        way = cells.places(found.element, xi, trial.r) - with_part
        closer = found.rows[:, 2] + np.einsum("ki,ki->k", found.rows[:, 3:6] @ turn.T, way) < self.level
        return float(found.rows[closer, 1].sum())

    def lift(self, state: State, space: Space, times: float) -> np.ndarray:
        """How nodes are to move (N, 3) [m] so that what is pressed stays so with so many times the pressure scale."""
        near = self._near(space)
        found = near.find(state)
        x = (found.rows[:, 2] - self.core) / self.range
        patch = found.element * near.n_obstacles + found.obstacle
        return near.cells.lifted(found, self.range * raised(x, found.rows[:, 1], patch, times), len(state.r))

    def overlaps(self, state: State, space: Space) -> list[str]:
        """What is wrong with a state at the start: the rod inside the part."""
        near = self._near(space)
        depth, s = near.deepest(state)
        if depth <= 0.0:
            return []
        where = f"rod {self.rod.name!r}: at s = {s:.4g} m it is {depth:.3g} m inside part {self.part.name!r}"
        if depth < self.radius + self.range:
            return [f"{where} (its surface; the centreline is outside)."]
        return [
            f"{where}, centreline and all, at t = {state.t:g} s. Draw it outside: contact cannot tell which way is out."
        ]

    def softened(self, state: State, space: Space, stiffness: float) -> PartContact | None:
        """A soft rod, a little thicker, that this state does not overlap; None if the centreline itself is inside.

        stiffness: of the soft layer, in parts of the pressure scale over the radius.
        """
        distance = self._near(space).find(state).gap + self.core
        if distance < SLIGHTEST * self.radius or self._near(space).deepest(state)[0] > self.radius:
            return None
        thick = THICKER * self.radius
        layer = (stiffness * self.start(space).scale / self.radius, thick - 0.9 * min(distance, self.radius))
        return replace(self, radius=thick, friction=0.0, layer=layer, stand_off=0.05 * (thick - layer[1]))

    def widened(self, part: float) -> PartContact:
        """The same with a barrier that begins where it does and is at least so many radii deep."""
        room = self.radius if self.layer is None else 0.5 * (self.core + self.range)
        deep = max(self.range, min(part * self.radius, room))
        radius = self.radius if self.layer is not None else self.radius + 0.5 * (self.range - deep)
        return replace(self, radius=radius, stand_off=0.5 * deep)

    def potential(self, state: State, space: Space) -> float:
        """Energy [J] stored in the barrier and the layer."""
        found = self._near(space).find(state)
        if not len(found.rows):
            return 0.0
        values = self._press(state, space, found, False, False)[3]
        return float(found.rows[:, 1] @ values[:, 7])

    def accept(self, state: State, space: Space) -> tuple[Touch, Pressed]:
        """Memory after a state is accepted, and what it says of the contact."""
        near = self._near(space)
        found = near.find(state)
        contact = state.contact or fresh(state, self, space)
        touch = contact.touch[self]
        R, _ = self.part.pose(contact.time)
        names = (self.name, self.rod.name, self.part.name)
        gap, s_gap = found.gap + self.core - self.radius, near.place(found)
        if not len(found.rows):
            return Touch.of_nothing(touch.scale, touch.lost), Pressed.none(*names, gap, s_gap, touch.lost)
        touched, force, _, values, _ = self._press(state, space, found, False, False)
        w, p, m, u = found.rows[:, 1], values[:, 0], values[:, 1:4], values[:, 4:7]
        size = np.linalg.norm(u, axis=1)
        held = u * np.minimum(1.0, self.slip / np.maximum(size, 1e-300))[:, None]
        lost = touch.lost + float(np.einsum("k,k,ki,ki->", w, p, m, u - held))
        places, part = near.keys(found), values[:, 8]
        memory = renewed(touch, places, held @ R, part, w * p, self.slip)
        kept = part[:, None] * kept_at(touch, places)[0] @ R.T
        rubbed = -float(np.einsum("k,k,ki,ki->", w, p, m, u - kept))
        n = found.rows[:, 3:6]
        load = (w * p)[:, None] * (n - m)  # on the rod
        at = near.cells.places(found.element, found.rows[:, 0], state.r) - self.radius * n  # where the surfaces meet
        s = near.cells.s_of(found.cell, found.rows[:, 0])
        top = int(np.argmax(p))
        told = Pressed(
            *names, -np.concatenate([load.sum(0), np.cross(at, load).sum(0)]), gap, s_gap, spans_of(s, w),
            float(p[top]), float(s[top]), lost, near.cells.nodes[touched].ravel(), -force.reshape(-1, 6), rubbed,
        )  # fmt: skip
        return Touch(*memory, touch.scale, lost), told

    def largest_step(self, state: State, trial: State, space: Space) -> float:
        """Part of the way to a trial state that no gap forbids."""
        return self._near(space).largest_step(state, trial)

    def clear(self, state: State, trial: State, space: Space) -> bool:
        """True if a trial state is outside the part and the rod not stretched too far to be seen."""
        near = self._near(space)
        if not near.find(trial).gap > LEFT * min(near.find(state).gap, self.range):
            return False
        return near.cells.chord(trial.r) <= max(STRETCHED, 1.05 * near.cells.chord(state.r))


NOTHING = Blocks(np.empty((0, 1), dtype=np.int64), np.empty((0, 1, 6)))


def fresh(state: State, term: Any, space: Space) -> Contact:
    """Contact of a state without memory: everything as it lies."""
    return Contact(state.t, state.t, state.r, state.q, {term: term.start(space)})


@dataclass(eq=False)
class Near:
    """Which cells of a rod are near which obstacles of a part; a cache, what it returns depends on states alone."""

    term: PartContact
    cells: Cells
    margin: np.ndarray = field(init=False)
    entries: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        part = self.term.part
        shapes = part.shapes
        self.surface = part.surface() if part.mesh is not None else None
        patches = 0 if self.surface is None else int(self.surface.patch.max()) + 1
        self.n_shapes, self.n_obstacles = len(shapes), len(shapes) + patches
        self.frames = np.array([s.frame for s in shapes] + [np.eye(3)] * patches)
        self.origins = np.array([s.origin for s in shapes] + [np.zeros(3)] * patches)
        self.obstacles = Obstacles(
            np.array([s.kind for s in shapes] + [MESH] * patches, dtype=np.int64),
            np.array([s.size for s in shapes] + [(0.0, 0.0, 0.0)] * patches),
            np.full(self.n_obstacles, self.term.level),
            np.full(self.n_obstacles, self.term.core),
        )
        self.middle: np.ndarray | None = None
        self._found: list[tuple[np.ndarray, float, Found]] = []
        self._posed: tuple[float, tuple[np.ndarray, np.ndarray]] | None = None
        self._seen: tuple[np.ndarray, float]  # where the nodes were when the rod looked around, and when
        self._least: float  # of what cells were allowed then

    def poses(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Frames (O, 3, 3) and origins (O, 3) of all obstacles in space."""
        if self._posed is None or (time != self._posed[0] and self.term.part.motion is not None):
            R, c = self.term.part.pose(time)
            self._posed = time, (R @ self.frames, self.origins @ R.T + c)
        return self._posed[1]

    @staticmethod
    def time(state: State) -> float:
        return state.t if state.contact is None else state.contact.time

    def _balls(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        return self.cells.balls(state.r, *self.term.part.pose(self.time(state)))

    def _moved(self, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """How far each cell has moved (n,) since what is near it was found."""
        way = np.sqrt(((middle - self.middle) ** 2).sum(axis=1))
        return way + np.maximum(radius - self.radius, 0.0)

    def look_around(self, state: State, middle: np.ndarray, radius: np.ndarray, margin: np.ndarray) -> None:
        """Find what is within reach of each cell at a state, and a margin (n,)."""
        reach = radius + self.term.level
        free = np.full(len(middle), np.inf)
        rows = []
        for k, shape in enumerate(self.term.part.shapes):
            distance = np.empty(len(middle))
            clearance.far_from(shape.kind, shape.size, (middle - shape.origin) @ shape.frame, distance)
            free = np.minimum(free, distance - reach)
            near = np.flatnonzero(distance <= reach + margin)
            rows.append(np.stack([near, np.full_like(near, k), 0 * near, 0 * near], axis=1))
        mesh = None
        if self.surface is not None:
            distance = self.surface.nearest(middle)
            free = np.minimum(free, distance - reach)
            near = np.flatnonzero(distance <= reach + margin)
            start, index = self.surface.candidates(middle[near], (reach + margin)[near])
            rows.append(self._runs(near, start, self.surface.patch[index]))
            facets, balls = self.surface.facets
            mesh = (facets, index, balls)
        entries = np.concatenate(rows)
        # one after the other along each element: what is known at the end of a cell is that at the beginning of the next
        order = np.lexsort((entries[:, 0], entries[:, 1], self.cells.cells[entries[:, 0], 0]))
        self.entries = np.ascontiguousarray(entries[order])
        self.obstacles = replace(self.obstacles, mesh=mesh)
        self.middle, self.radius, self.margin = middle, radius, margin
        self.allowed = np.maximum(margin, free)
        self._seen, self._least = (state.r, self.time(state)), float(self.allowed.min())

    def _runs(self, near: np.ndarray, start: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """Entries (cell, obstacle, first, last) of the candidates of some cells, sorted by patch in each cell."""
        cell = np.repeat(near, np.diff(start))
        new = np.ones(len(cell), dtype=bool)
        new[1:] = (cell[1:] != cell[:-1]) | (patch[1:] != patch[:-1])
        first = np.flatnonzero(new)
        last = np.append(first[1:], len(cell))[: len(first)]
        return np.stack([cell[first], self.n_shapes + patch[first], first, last], axis=1)

    def find(self, state: State) -> Found:
        """Points that press at a state."""
        time = self.time(state)
        for r, t, found in self._found:
            if r is state.r and t == time:
                return found
        if self.middle is None or not self._still(state.r, time):
            pose = self.term.part.pose(time)
            if self.middle is None or self.cells.strayed(state.r, *pose, self.middle, self.radius, self.allowed):
                middle, radius = self.cells.balls(state.r, *pose)
                self.look_around(state, middle, radius, np.full(len(middle), MARGIN * self.term.radius))
        found = search(self.cells, self.entries, state.r, self.obstacles, *self.poses(time))
        self._found = [(state.r, time, found), *self._found[:2]]
        return found

    def _still(self, r: np.ndarray, time: float) -> bool:
        """True if nodes have hardly moved past the part since it looked around; no cell has strayed then."""
        seen, then = self._seen
        return (self.term.part.motion is None or time == then) and FARTHER * np.abs(r - seen).max() < self._least

    def keys(self, found: Found) -> np.ndarray:
        """Keys (K,) under which slips are remembered."""
        return found.cell * self.n_obstacles + found.obstacle

    def deepest(self, state: State) -> tuple[float, float]:
        """Depth [m] of the rod in the part beyond what contact allows, and s [m] where; negative if it is clear."""
        found = self.find(state)
        depth, s = -found.gap, self.place(found)
        part, time = self.term.part, self.time(state)
        R, c = part.pose(time)
        middle, _ = self.cells.balls(state.r, R, c)
        if self.surface is not None and self.surface.closed:
            near = np.flatnonzero(self.surface.inside(middle))
            if len(near):
                inside = self.surface.distance(middle[near])
                k = int(np.argmin(inside))
                depth, s = self.term.radius - inside[k], self.cells.s_of(near[k : k + 1], np.array([0.5]))[0]
        return float(depth), float(s)

    def place(self, found: Found) -> float:
        """Arc length [m] of the smallest distance."""
        cell, _, xi = found.lowest
        return float(self.cells.s_of(np.array([cell]), np.array([xi]))[0])

    def largest_step(self, state: State, trial: State) -> float:
        """Part of the way to a trial state on which no cell leaves what was found near it, nor closes a gap."""
        here, there = self._balls(state), self._balls(trial)
        way = np.sqrt(((there[0] - here[0]) ** 2).sum(axis=1)) + np.maximum(there[1] - here[1], 0.0)
        moved = self._moved(*here) if self.middle is not None else np.full_like(way, np.inf)
        if self.middle is None or (moved + way > self.allowed).any():
            a = self.term.radius
            self.look_around(state, *here, np.clip(1.1 * way, MARGIN * a, FURTHEST * a))
            moved = np.zeros_like(way)
        alpha = float(np.min((self.allowed - moved) / np.maximum(way, 1e-300), initial=1.0))
        cells = self.cells
        return min(
            alpha,
            clearance.largest_step(
                self.entries, cells.line, state.r, trial.r, self.obstacles.at(*self.poses(self.time(state))),
                *self.poses(self.time(trial)), self.obstacles.mesh, CLOSING, SPARE * self.term.range,
            ),
        )  # fmt: skip
