"""From tables to objects: names looked up, values checked by the classes they go to.

Rule: every object is built, so that every fault is found; what cannot be built because of another fault is passed over. A
ValueError of a class is brought to the line of its key, with the value as the user wrote it.
"""

from __future__ import annotations

import pathlib
import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..errors import KardanError, MeshError, SceneError, nearest
from ..mechanism import GROUND, Hinge, Part, Path, Slider, read_surface
from ..model import Model
from ..rod import Rod, read_curve
from ..section import Section
from ..support import Clamp, Pin, Support, Weld
from ..terms import Gravity, LineLoad, PointLoad, Term
from . import lines
from .load import Source, short, sorted_faults
from .tables import (
    GeneralSection,
    HingeTable,
    LineLoadTable,
    PathTable,
    PinTable,
    RodTable,
    RoundSection,
    SceneTables,
    SliderTable,
    WeldTable,
)


class Builder:
    """Objects of one scene, and the faults met on the way."""

    def __init__(self, source: Source, tables: SceneTables) -> None:
        self.source, self.tables = source, tables
        self.faults: list[str] = []
        self.sections: dict[str, Section] = {}
        self.rods: dict[str, Rod] = {}
        self.parts: dict[str, Part] = {}
        self._unique()
        self._each("section", tables.section, self._section, self.sections)
        self._each("part", tables.part, self._part, self.parts)
        self._each("rod", tables.rod, self._rod, self.rods)
        supports: dict[int, Support | Weld] = {}
        self._each("support", tables.support, self._support, supports)
        self.supports = list(supports.values())
        terms: dict[int, Term] = {}
        if tables.gravity is not None:
            terms[-1] = Gravity(tables.gravity.acceleration)
        self._each("load", tables.load, self._load, terms)
        self.terms = list(terms.values())

    def model(self) -> Model:
        """The model. SceneError with all faults if there are any."""
        if self.faults:
            raise SceneError(sorted_faults(self.faults))
        try:
            return Model(list(self.rods.values()), self.supports, self.terms, rotation=self.tables.solve.rotation)
        except KardanError as error:
            raise SceneError(self.source.fault(("solve", "rotation"), str(error))) from None
        except SceneError as error:
            raise SceneError([self.source.place(fault) for fault in error.faults]) from None

    def _each(self, table: str, entries: Iterable[Any], make: Callable[[Any, lines.Path], Any], into: dict) -> None:
        for k, entry in enumerate(entries):
            path: lines.Path = (table, k)
            try:
                made = make(entry, path)
            except MeshError as error:
                self.faults += [self._bare(path, fault, ("mesh", "file")) for fault in error.faults]
            except ValueError as error:
                self.faults.append(self._bare(path, str(error)))
            else:
                if made is not None:
                    into[getattr(entry, "name", None) if table in ("section", "rod", "part") else k] = made

    def _bare(self, path: lines.Path, message: str, keys: tuple[str, ...] = ()) -> str:
        """A fault said by a class, at the line of the key it names and with the value as it was written."""
        entry = self.source.value(path)
        # "rod 'a': length: must be greater than 0 (got -1)." -> key "length", the rest
        text = re.sub(
            r"^(section|rod|part|clamp|pin|weld|support|point load|line load)( on rod)?( '[^']*')?: ", "", message
        )
        text = re.sub(r"^(hinge|slider|path): ", "motion.", text)
        match = re.match(r"(motion\.)?(\w+)\b", text)
        key = match.group(2) if match else ""
        if isinstance(entry, dict):
            inner: lines.Path = (*path, "motion", key) if match and match.group(1) else (*path, key)
            if self.source.value(inner) is not None:
                written = self.source.value(inner)
                if isinstance(written, str):
                    text = re.sub(r"\(got [^()]*\)", f"(got {short(written)})", text)
                return self.source.fault(inner, text)
            for name in keys:
                if name in entry:
                    return self.source.fault((*path, name), text)
                if isinstance(entry.get("motion"), dict) and name in entry["motion"]:
                    return self.source.fault((*path, "motion", name), text)
        return self.source.fault(path, text)

    def _unique(self) -> None:
        for table in ("section", "rod", "part"):
            seen: dict[str, int] = {}
            for k, entry in enumerate(getattr(self.tables, table)):
                if entry.name in seen:
                    first = self.source.lines.line_of((table, seen[entry.name]))
                    self.faults.append(
                        self.source.fault((table, k, "name"), f"the name is used twice, first in line {first}.")
                    )
                seen.setdefault(entry.name, k)

    def _find(self, known: dict[str, Any], declared: Iterable[Any], name: str, kind: str, path: lines.Path) -> Any:
        """An object by name; a fault if the scene does not declare it, nothing if it is declared but faulty."""
        if name in known:
            return known[name]
        names = [entry.name for entry in declared] + (["ground"] if kind == "part" else [])
        if name not in names:
            self.faults.append(self.source.fault(path, f'{kind} "{name}" does not exist. {nearest(name, names)}'))
        return None

    def _section(self, table: Any, path: lines.Path) -> Section:
        given = table.model_dump(exclude={"kind", "name"})
        if isinstance(table, GeneralSection):
            if table.coupled is not None:
                given["coupled"] = np.array(table.coupled)
            return Section(**given)
        make = Section.round if isinstance(table, RoundSection) else Section.rectangle
        size = ("diameter",) if isinstance(table, RoundSection) else ("width", "height")
        return make(*[given.pop(key) for key in size], **given)

    def _rod(self, table: RodTable, path: lines.Path) -> Rod | None:
        section: Any
        if isinstance(table.section, str):
            section = self._find(self.sections, self.tables.section, table.section, "section", (*path, "section"))
        else:
            section = [
                (s, self._find(self.sections, self.tables.section, name, "section", (*path, "section", k)))
                for k, (s, name) in enumerate(table.section)
            ]
        if (table.points is None) == (table.file is None):
            raise ValueError("needs either 'points' or 'file'.")
        if table.file is not None:
            points = read_curve(self.source.folder / table.file, f"rod {table.name!r}")
        else:
            points = np.array(table.points, dtype=float)
        if section is None or (isinstance(section, list) and any(made is None for _, made in section)):
            return None
        options = table.model_dump(exclude={"name", "section", "points", "file", "unit"}, exclude_unset=True)
        return Rod(table.name, section, points * table.unit, **options)

    def _part(self, table: Any, path: lines.Path) -> Part:
        if table.name == "ground":
            raise ValueError("the name 'ground' is taken by what never moves; choose another.")
        mesh: pathlib.Path | None = None
        if table.mesh is not None:
            mesh = (self.source.folder / table.mesh).resolve()
            try:
                read_surface(mesh, f"part {table.name!r}")
            except MeshError as error:  # the motion may be faulty too
                self.faults += [self._bare(path, fault, ("mesh",)) for fault in error.faults]
        motion: Any = None
        if isinstance(table.motion, HingeTable):
            motion = Hinge(table.motion.point, table.motion.axis, table.motion.angle)
        elif isinstance(table.motion, SliderTable):
            motion = Slider(table.motion.axis, table.motion.travel)
        elif isinstance(table.motion, PathTable):
            motion = Path.read(self.source.folder / table.motion.file)
        return Part(table.name, mesh, table.mesh_unit, motion)

    def _support(self, table: Any, path: lines.Path) -> Support | Weld | None:
        rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
        if isinstance(table, WeldTable):
            other = self._find(self.rods, self.tables.rod, table.other, "rod", (*path, "other"))
            return Weld(rod, table.at, other, table.other_at) if rod is not None and other is not None else None
        part = GROUND
        if table.to != "ground":
            part = self._find(self.parts, self.tables.part, table.to, "part", (*path, "to"))
        if rod is None or part is None:
            return None
        make = Pin if isinstance(table, PinTable) else Clamp
        frame = None if table.frame is None else np.array(table.frame).T
        return make(rod, table.at, part, tuple(table.free), frame, table.name)

    def _load(self, table: Any, path: lines.Path) -> Term | None:
        rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
        if rod is None:
            return None
        given = table.model_dump(exclude={"kind", "rod"}, exclude_unset=True)
        if isinstance(table, LineLoadTable):
            return LineLoad(rod, **given)
        return PointLoad(rod, given.pop("at"), **given)
