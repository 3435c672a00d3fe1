"""What is the cable? Drawn curve, section, rest shape, elements.

Rule: s is the arc length of the unstressed rod, from 0 to `length`. The drawing is a curve that may be longer or
shorter; the place s is drawn at arc length s * drawn_length / length. A rod says where its elements end when it is
told which places need a node; it holds no unknowns.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from .curve import SmoothCurve, unit
from .errors import MeshError, check_integer, check_name, check_positive, check_shape, one_line, silenced
from .section import Section
from .table import read_table

SAME = 1e-9  # places closer than this part of the length are one place
SNAP = 0.3  # an element boundary closer than this part of an element to a wanted place is moved there


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements along a rod: degree of the shape functions, and boundaries ends (n + 1,) [m] from 0 to the rod's length."""

    order: int
    ends: Any

    def __post_init__(self) -> None:
        check_integer("elements: order", self.order, 1, 8)
        ends = check_shape("elements: ends", self.ends, (-1,))
        if len(ends) < 2 or (np.diff(ends) <= 0).any():
            raise ValueError("elements: ends must be at least two increasing places.")
        object.__setattr__(self, "ends", ends)

    def check(self, rod: Rod, marks: Sequence[float]) -> Elements:
        """These elements with ends exactly on the rod's; ValueError if they do not fit it."""
        where, slack = f"elements of rod {rod.name!r}", SAME * rod.length
        if abs(self.ends[0]) > slack or abs(self.ends[-1] - rod.length) > slack:
            raise ValueError(
                f"{where}: must run from 0 to {rod.length:g} m (got {self.ends[0]:g} to {self.ends[-1]:g} m)."
            )
        ends = self.ends.copy()
        ends[[0, -1]] = 0.0, rod.length
        for s in marks:
            k = int(np.argmin(np.abs(ends - s)))
            if abs(ends[k] - s) > slack:
                raise ValueError(f"{where}: none ends at s = {s:.6g} m, where a support or load needs a node.")
        return Elements(self.order, ends)


@dataclass(frozen=True, eq=False)
class Rod:
    """A rod: a curve with a section.

    Parameters
    ----------
    name : str
    section : Section, list of (s [m], Section), or function of s -> Section
        A list is linear between its entries; two entries at the same s make a step.
    points : (P, 3) [m]
        The drawn curve: a smooth curve through them; two points draw a straight rod. `Rod.read` takes a file.
    n_elements : int
        Elements along the rod; one more is made where a support or load stands far from every element boundary.
    order : int from 1 to 6
        Degree of the shape functions on Gauss-Lobatto nodes: error ~ (element length)^(2 order) at the nodes.
    length : [m], optional
        Unstressed length; default the drawn length.
    rest : "straight", "as_drawn", (3,), (K, 3) or function of s -> (3,)
        Stress-free shape: straight and untwisted; the drawn shape (scaled if `length` differs); or curvature and twist
        (bend 1, bend 2, twist) [1/m] about d1, d2, d3, constant, at K evenly spaced places (linear between) or s -> (3,).
        Turns are right-handed: bend 1 > 0 turns d3 towards -d2, bend 2 > 0 turns d3 towards d1.
    start_tangent, end_tangent : (3,), optional
        Directions of the drawn curve at its ends (clamped ends: the direction of the clamp).
    normal, end_normal : (3,), optional
        Direction of d1 at the start, made perpendicular to the rod and carried along without twist; with `end_normal`
        the drawing is twisted evenly so that d1 ends there.
    layer : [m], optional
        Width of bending layers to resolve, about sqrt(EI / T) for a tension T: half of the elements are then graded
        towards both ends and every support within the rod.

    Raises
    ------
    ValueError
        An argument has the wrong shape, sign or type; the message names the rod and the argument.
    """

    name: str
    section: Section | Sequence[tuple[float, Section]] | Callable[[float], Section]
    points: Any
    _: KW_ONLY
    n_elements: int = 20
    order: int = 3
    length: float = None  # type: ignore[assignment]  # a number once constructed
    rest: Any = "straight"
    start_tangent: Any = None
    end_tangent: Any = None
    normal: Any = None
    end_normal: Any = None
    layer: float | None = None
    curve: SmoothCurve = field(init=False, repr=False)
    sections: tuple[tuple[float, Section], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = f"rod {check_name('rod', self.name)!r}"
        check_integer(f"{where}: n_elements", self.n_elements, 1, 2_000_000)
        check_integer(f"{where}: order", self.order, 1, 6)
        set_(self, "curve", SmoothCurve(self.points, self.start_tangent, self.end_tangent, name=where))
        set_(self, "points", self.curve.points)
        length = self.curve.length if self.length is None else check_positive(f"{where}: length", self.length)
        set_(self, "length", length)
        if self.layer is not None:
            check_positive(f"{where}: layer", self.layer)
        if self.end_normal is not None:
            unit(f"{where}: end_normal", self.end_normal)
        set_(self, "sections", _section_table(where, self.section, length))
        if isinstance(self.rest, str):
            if self.rest not in ("straight", "as_drawn"):
                raise ValueError(
                    f"{where}: rest must be 'straight', 'as_drawn', numbers or a function (got {self.rest!r})."
                )
        elif not callable(self.rest):
            rest = np.asarray(self.rest, dtype=float)
            set_(self, "rest", check_shape(f"{where}: rest", rest, (3,) if rest.ndim == 1 else (-1, 3)))
        self.frames(np.array([0.0, length]))  # says what is wrong with the normals
        self._check_drawing(where)

    def _check_drawing(self, where: str) -> None:
        """ValueError if the drawn curve turns back on itself within a point's reach."""
        s = np.linspace(0.0, self.length, 20 * len(self.points) + 1)
        with np.errstate(all="ignore"):
            tangents = self.frames(s)[..., 2]
            turn = (tangents[1:] * tangents[:-1]).sum(-1)
        bad = np.flatnonzero(~(turn > -0.5))
        if len(bad):
            place = self.drawn(s[bad[:1]])[0]
            raise ValueError(
                f"{where}: points draw a curve that folds back on itself near ({place[0]:.4g}, {place[1]:.4g}, "
                f"{place[2]:.4g}) m. Draw the bend with a few more points, or leave out the point that goes back."
            )

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        name: str,
        section: Section | Sequence[tuple[float, Section]] | Callable[[float], Section],
        *,
        unit: float = 1.0,
        **options: Any,
    ) -> Rod:
        """Make a rod along a curve from a file: a line mesh (VTU, VTK, gmsh, ...) or a CSV with the columns x, y, z.

        Parameters
        ----------
        unit : [m]
            Length of one unit of the file.
        options
            As for Rod.

        Raises
        ------
        MeshError
            The file cannot be read, holds no line, or its lines are not one open curve.
        """
        return cls(name, section, read_curve(path, f"rod {name!r}") * unit, **options)

    @property
    def drawn_length(self) -> float:
        """Length of the drawn curve [m]."""
        return self.curve.length

    def place(self, at: Any, where: str) -> float:
        """Arc length [m] of "start", "end" or a number; ValueError if it is not on the rod."""
        if at == "start":
            return 0.0
        if at == "end":
            return float(self.length)
        if isinstance(at, str | bool):
            raise ValueError(f"{where}: at must be 'start', 'end' or an arc length in m (got {at!r}).")
        s = float(check_shape(f"{where}: at", at, ()))
        slack = 1e-9 * self.length
        if not -slack <= s <= self.length + slack:
            raise ValueError(
                f"{where}: at = {s:g} m is not on rod {self.name!r}, which runs from 0 to {self.length:g} m."
            )
        return float(np.clip(s, 0.0, self.length))

    def drawn(self, s: np.ndarray) -> np.ndarray:
        """Drawn places (n, 3) [m] of arc lengths s (n,)."""
        return self.curve.position(np.asarray(s) * (self.drawn_length / self.length))

    def frames(self, s: np.ndarray) -> np.ndarray:
        """Drawn section frames [d1 d2 d3] (n, 3, 3) at increasing s (n,)."""
        try:
            return self.curve.frames(np.asarray(s) * (self.drawn_length / self.length), self.normal, self.end_normal)
        except ValueError as error:
            raise ValueError(f"rod {self.name!r}: {error}") from None

    def section_at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness (n, 6, 6), mass per length (n,) and rotary inertia (n, 3) at s (n,).

        Between two entries of a list the values are linear; at a step the side is taken that s lies on.
        """
        at = np.array([p for p, _ in self.sections])
        values = np.array([_flat(section) for _, section in self.sections])
        if len(at) == 1:
            rows = np.broadcast_to(values, (len(s), values.shape[1]))
        else:
            k = np.clip(np.searchsorted(at, s, side="right") - 1, 0, len(at) - 2)
            width = at[k + 1] - at[k]
            part = np.where(width > 0, (np.asarray(s) - at[k]) / np.where(width > 0, width, 1.0), 0.0)[:, None]
            rows = (1 - part) * values[k] + part * values[k + 1]
        return rows[:, :36].reshape(-1, 6, 6), rows[:, 36], rows[:, 37:]

    def mass_at(self, s: np.ndarray) -> np.ndarray:
        """Mass per length (n,) [kg/m] at s (n,)."""
        return self.section_at(s)[1]

    def rotary_inertia_at(self, s: np.ndarray) -> np.ndarray:
        """Rotary inertia per length (n, 3) [kg m] about d1, d2, d3 at s (n,).

        Where a section gives none, that of a body whose mass is spread as its stiffness is: rho I = m EI / EA, and the
        sum of both about d3.
        """
        C, mass, given = self.section_at(s)
        bending = mass[:, None] * C[:, (3, 4), (3, 4)] / C[:, 2, 2, None]
        spread = np.concatenate([bending, bending.sum(axis=1, keepdims=True)], axis=1)
        return np.where(given > 0, given, spread)

    def radius_at(self, s: np.ndarray) -> np.ndarray:
        """Radius for pictures (n,) [m]; from the stiffness of a solid round section, 2 sqrt(EI / EA), if not given."""
        at = np.array([p for p, _ in self.sections])
        radii = []
        for _, section in self.sections:
            C = section.matrix
            radii.append(section.radius or 2.0 * np.sqrt(min(C[3, 3], C[4, 4]) / C[2, 2]))
        return np.interp(s, at, radii)

    def rest_curvature(self, s: np.ndarray) -> np.ndarray:
        """Stress-free (bend 1, bend 2, twist) (n, 3) [1/m] at s (n,), for every rest shape but "as_drawn"."""
        if isinstance(self.rest, str):
            return np.zeros((len(s), 3))
        if callable(self.rest):
            return np.array([check_shape(f"rod {self.name!r}: rest at s = {x:g} m", self.rest(x), (3,)) for x in s])
        if self.rest.ndim == 1 or len(self.rest) == 1:
            return np.tile(self.rest.reshape(-1, 3)[0], (len(s), 1))
        knots = np.linspace(0.0, self.length, len(self.rest))
        return np.stack([np.interp(s, knots, column) for column in self.rest.T], axis=-1)

    def elements(self, marks: Sequence[float] = ()) -> Elements:
        """The elements that the rod asks for, with a boundary at every mark."""
        return Elements(self.order, self.element_ends(marks))

    def element_ends(self, marks: Sequence[float] = (), n_elements: int | None = None) -> np.ndarray:
        """Element boundaries (n + 1,) [m] from 0 to `length`, with one at every mark and at every step of the section.

        With `layer` the boundaries are spread so that equal parts hold equal shares of
        w(s) = 1 / L + sum over layers of exp(-|s - c| / 3 layer) / 6 layer, about half of it in the layers.
        n_elements: other than the rod's own.
        """
        n = n_elements or self.n_elements
        L = float(self.length)
        wanted = sorted({float(m) for m in marks} | {p for p, _ in self.sections})
        wanted = [m for m in wanted if SAME * L < m < (1 - SAME) * L]
        if self.layer is None:
            ends = np.linspace(0.0, L, n + 1)
        else:
            width = min(3.0 * self.layer, L)
            s = np.unique(np.concatenate([np.linspace(0.0, L, 2001), _fine(L, width, wanted)]))
            share = s / L
            for c in (0.0, L, *(m for m in map(float, marks) if m in wanted)):
                share = share + 0.5 * np.sign(s - c) * (1 - np.exp(-np.abs(s - c) / width))
            share = share - share[0]
            ends = np.interp(np.linspace(0.0, share[-1], n + 1), share, s)
            ends[0], ends[-1] = 0.0, L
        fixed = np.zeros(len(ends), dtype=bool)
        fixed[[0, -1]] = True
        for m in wanted:
            k = int(np.argmin(np.abs(ends - m)))
            left, right = ends[max(k - 1, 0)], ends[min(k + 1, len(ends) - 1)]
            if fixed[k] and abs(ends[k] - m) <= SAME * L:
                continue
            if not fixed[k] and abs(ends[k] - m) < SNAP * min(ends[k] - left, right - ends[k]):
                ends[k], fixed[k] = m, True
            else:
                k = int(np.searchsorted(ends, m))
                ends, fixed = np.insert(ends, k, m), np.insert(fixed, k, True)
        return ends


def _fine(L: float, width: float, marks: list[float]) -> np.ndarray:
    """Extra stations near layers, where the share changes fast."""
    steps = width * np.linspace(0.0, 8.0, 400)
    near = [np.concatenate([c - steps, c + steps]) for c in (0.0, L, *marks)]
    return np.clip(np.concatenate(near), 0.0, L)


def _flat(section: Section) -> np.ndarray:
    return np.concatenate([section.matrix.ravel(), [section.mass_per_length], section.rotary_inertia])


def _section_table(where: str, section: Any, length: float) -> tuple[tuple[float, Section], ...]:
    """Entries (s, Section) from whatever the user gave; a function is taken at 65 places, linear between them."""
    if isinstance(section, Section):
        return ((0.0, section),)
    if callable(section):
        section = [(s, section(s)) for s in np.linspace(0.0, length, 65)]
    if not isinstance(section, Sequence) or isinstance(section, str) or len(section) == 0:
        raise ValueError(f"{where}: section must be a Section, a list of (s, Section) or a function of s.")
    table = []
    for entry in section:
        if not isinstance(entry, tuple | list) or len(entry) != 2 or not isinstance(entry[1], Section):
            raise ValueError(f"{where}: each entry of section must be (s, Section) (got {entry!r}).")
        table.append((float(check_shape(f"{where}: s of a section", entry[0], ())), entry[1]))
    places = [s for s, _ in table]
    if places != sorted(places):
        raise ValueError(f"{where}: the places of its sections must not decrease (got {places}).")
    if abs(places[0]) > 1e-9 * length or (abs(places[-1] - length) > 1e-9 * length and len(places) > 1):
        raise ValueError(
            f"{where}: its sections must run from s = 0 to s = {length:g} m (got {places[0]:g} to {places[-1]:g})."
        )
    return tuple(table)


def read_curve(path: str | os.PathLike[str], where: str) -> np.ndarray:
    """Points (P, 3) in file units along the one open curve that a line mesh or CSV file holds."""
    file = pathlib.Path(path)
    shown = repr(os.fspath(path))
    if not file.is_file():
        raise MeshError(f"{where}: curve file {shown} does not exist.")
    if file.suffix.lower() in (".csv", ".txt"):
        points = read_table(file, ("x", "y", "z"), f"{where}: curve file {shown}")
    else:
        points = _order_lines(*_read_lines(file, where, shown), where, shown)
    if len(points) < 2 or not np.isfinite(points).all():
        raise MeshError(f"{where}: curve file {shown} needs at least two points with finite coordinates.")
    return points


def _read_lines(file: pathlib.Path, where: str, shown: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) and edges (K, 2) of a line mesh; PolyData through pyvista, the rest through meshio."""
    if file.suffix.lower() in (".vtp", ".vtk", ".ply"):
        import pyvista

        try:
            with silenced():
                data = pyvista.read(file).extract_all_edges() if file.suffix.lower() != ".vtp" else pyvista.read(file)
                cells = data.lines
        except Exception as error:  # pyvista and VTK raise many types for files that are not meshes
            raise MeshError(f"{where}: curve file {shown} cannot be read: {one_line(error)}.") from None
        edges: list[tuple[int, int]] = []
        k = 0
        while k < len(cells):
            n = int(cells[k])
            line = cells[k + 1 : k + 1 + n]
            edges.extend(pairwise(line))
            k += n + 1
        return np.asarray(data.points, dtype=float), np.array(edges, dtype=int).reshape(-1, 2)
    import meshio

    pairs: list[tuple[int, int]] = []
    try:
        with silenced():
            mesh = meshio.read(file)
    except SystemExit:  # meshio prints its reason and exits
        raise MeshError(f"{where}: curve file {shown} cannot be read: meshio refuses it.") from None
    except Exception as error:
        raise MeshError(f"{where}: curve file {shown} cannot be read: {one_line(error)}.") from None
    for block in mesh.cells:
        if block.type == "line":
            pairs.extend(block.data)
        elif block.type == "line3":
            pairs.extend(pair for a, b, mid in block.data for pair in ((a, mid), (mid, b)))
    points = np.asarray(mesh.points, dtype=float)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return points, np.array(pairs, dtype=int).reshape(-1, 2)


def _order_lines(points: np.ndarray, edges: np.ndarray, where: str, shown: str) -> np.ndarray:
    """Points in the order of one open curve. The file does not give it: walk from an end to the other."""
    if len(edges) == 0:
        raise MeshError(f"{where}: curve file {shown} holds no line. Export the route as a curve of line elements.")
    neighbours: dict[int, list[int]] = {}
    for a, b in edges:
        neighbours.setdefault(int(a), []).append(int(b))
        neighbours.setdefault(int(b), []).append(int(a))
    branches = [k for k, n in neighbours.items() if len(n) > 2]
    ends = [k for k, n in neighbours.items() if len(n) == 1]
    if branches:
        raise MeshError(
            f"{where}: curve file {shown} branches at point {branches[0]}; a rod is one curve. "
            "Split the file and join rods with a weld."
        )
    if len(ends) != 2:
        what = "closed" if not ends else f"in {len(ends) // 2} pieces"
        raise MeshError(f"{where}: curve file {shown} holds a curve that is {what}; a rod is one open curve.")
    path, last = [min(ends)], -1
    while True:
        onward = [k for k in neighbours[path[-1]] if k != last]
        if not onward:
            return points[path]
        last = path[-1]
        path.append(onward[0])
