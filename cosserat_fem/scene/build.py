"""From tables to objects: names looked up, values checked by the classes they go to.

Rule: every object is built, so that every fault is found; what cannot be built because of another fault is passed over. A
ValueError of a class is brought to the line of its key, with the value as the user wrote it.
"""

from __future__ import annotations

import pathlib
import re
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from ..drive import Drive, Line
from ..errors import KardanError, MeshError, SceneError, nearest
from ..mechanism import GROUND, Hinge, Part, Path, Slider
from ..model import Model
from ..rod import Rod, read_curve
from ..section import Section
from ..shapes import Box, Capsule, Cylinder, Plane, Shape, Sphere, Torus
from ..support import Clamp, Pin, Support, Weld
from ..terms import Damping, Drag, Electrostatic, Gravity, LineLoad, PartContact, PointLoad, RodContact, Term
from ..terms.touch import MOST_CELLS
from . import lines
from .cables import CableShop, implausible
from .limits import build_limits
from .load import Source, short, sorted_faults
from .tables import (
    BuiltSection,
    GeneralSection,
    HingeTable,
    LineLoadTable,
    PartContactTable,
    PathTable,
    PinTable,
    RodContactTable,
    RodTable,
    RoundSection,
    SceneTables,
    SliderTable,
    WeldTable,
)

TYPED = 1e-6  # part of a length that may be missing in a typed number
SHAPES: dict[str, Callable[..., Shape]] = {
    "plane": Plane,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
    "box": Box,
    "torus": Torus,
}


class Builder:
    """Objects of one scene, and the faults met on the way."""

    def __init__(self, source: Source, tables: SceneTables) -> None:
        self.source, self.tables = source, tables
        self.faults: list[str] = []
        self.notes: list[str] = []  # warnings
        self.sections: dict[str, Section] = {}
        self.cables = CableShop(source, tables.section, self.faults)
        self.banded: list[str] = []  # rods to be run with slipping and with sticking strands
        self.rods: dict[str, Rod] = {}
        self.parts: dict[str, Part] = {}
        self._welded: dict[frozenset[tuple[str, float]], int] = {}
        self._unique()
        self._each("section", tables.section, self._section, self.sections)
        self._each("part", tables.part, self._part, self.parts)
        self._each("rod", tables.rod, self._rod, self.rods)
        supports: dict[int, Support | Weld] = {}
        self._each("support", tables.support, self._support, supports)
        self.supports = supports
        self.loads: dict[int, Term] = {}
        self._each("load", tables.load, self._load, self.loads)
        self.others: dict[tuple[str, int], Term] = {}
        for name, entries, make in (
            ("damping", tables.damping, self._damping),
            ("drag", tables.drag, self._drag),
            ("electrostatic", tables.electrostatic, self._electrostatic),
        ):
            made: dict[int, Term] = {}
            self._each(name, entries, make, made)
            self.others |= {(name, k): term for k, term in made.items()}
        self.contacts: dict[tuple[int, str], Term] = {}  # by table, and by rod if each has a term of its own
        self._touching: dict[tuple[str, str], int] = {}
        self._each("contact", tables.contact, self._contact, {})
        self.drives: dict[int, Drive] = {}
        self._each("drive", tables.drive, self._drive, self.drives)
        self.limits = build_limits(self)
        if tables.solve.rotation == "kardan" and tables.contact:
            reason = 'contact needs rotation = "quaternion".'
            self.faults.append(source.fault(("solve", "rotation"), reason))
        if tables.solve.rotation == "kardan" and any(isinstance(table, WeldTable) for table in tables.support):
            reason = 'welds need rotation = "quaternion"; Kardan angles cannot join two rods at an angle.'
            self.faults.append(source.fault(("solve", "rotation"), reason))

    def model(self) -> Model:
        """The model. SceneError with all faults if there are any."""
        if self.faults:
            raise SceneError(sorted_faults(self.faults))
        terms: list[Term] = [*self.loads.values(), *self.others.values(), *self.contacts.values()]
        if self.tables.gravity is not None:
            terms.insert(0, Gravity(self.tables.gravity.acceleration))
        supports = list(self.supports.values())
        try:
            solve = self.tables.solve
            model = Model(
                list(self.rods.values()),
                supports,
                terms,
                rotation=solve.rotation,
                theory=solve.theory,
                plane=solve.plane,
            )
        except KardanError as error:
            raise SceneError(self.source.fault(("solve", "rotation"), str(error))) from None
        except SceneError as error:
            raise SceneError([self.place(fault) for fault in error.faults]) from None
        for note in self.notes:
            model.warn(note)
        return model

    def place(self, message: str) -> str:
        """A message of the model, ``support 'a.end@door': ...``, at the line of the table it names."""
        match = re.match(r"(\w+) (['\"])(.*?)\2: ", message)
        named: dict[tuple[str, str], lines.Path] = {
            ("rod", rod.name): ("rod", k) for k, rod in enumerate(self.tables.rod)
        }
        named |= {("part", part.name): ("part", k) for k, part in enumerate(self.tables.part)}
        named |= {("support", str(h.name)): ("support", k) for k, h in self.supports.items() if isinstance(h, Support)}
        if message.startswith("model: plane"):
            return self.source.fault(("solve", "plane"), message.removeprefix("model: "))
        path = named.get((match.group(1), match.group(3)), ()) if match else ()
        if "string" in message and self.tables.solve.theory == "string":
            return self.source.fault(("solve", "theory"), message)
        contact = self.contact_of(message)
        if contact:
            return self.source.fault(contact, message)
        return f"{self.source.path}:{self.source.lines.line_of(path)}: {message}"

    def contact_of(self, message: str) -> lines.Path:
        """The contact that a message speaks of: ``contact of rod 'a' with ...`` or ``rod 'a': ... inside part 'b' ...``."""
        if not message.startswith("contact of ") and " inside " not in message:
            return ()
        for (k, _), term in self.contacts.items():
            part = getattr(term, "part", None)
            named = [repr(rod.name) in message for rod in term.rods]  # type: ignore[attr-defined]
            if any(named) and (f"part {part.name!r}" in message if part is not None else " part " not in message):
                return ("contact", k)
        return ()

    def faults_at(self, model: Model, times: Iterable[float]) -> list[str]:
        """Parts and loads that have no value at one of these times."""
        faults = []
        for k, part in enumerate(self.parts.values()):
            faults += self._first_fault(("part", k), part.pose, times)
        for k, load in self.loads.items():
            faults += self._first_fault(("load", k), partial(self._act, load, model), times)
        return faults

    @staticmethod
    def _act(load: Term, model: Model, t: float) -> None:
        load(model.initial_state(t), model.space, tangent=False)

    def _first_fault(self, path: lines.Path, value: Callable[[float], Any], times: Iterable[float]) -> list[str]:
        try:
            for t in times:
                value(t)
        except ValueError as error:
            return [self._bare(path, str(error))]
        return []

    def _each(self, table: str, entries: Iterable[Any], make: Callable[[Any, lines.Path], Any], into: dict) -> None:
        for k, entry in enumerate(entries):
            path: lines.Path = (table, k)
            try:
                made = make(entry, path)
            except MeshError as error:
                self.faults += [self._bare(path, fault, ("file",)) for fault in error.faults]
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
            r"^(section|rod|part|clamp|pin|weld|support|point load|line load|drive)( on rod| of)?( '[^']*')?: ",
            "",
            message,
        )
        text = re.sub(r"^contact of rods?( .+?)?: ", "", text)
        text = re.sub(r"^path: motion file", "motion file", text)
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

    def _section(self, table: Any, path: lines.Path) -> Section | None:
        if isinstance(table, BuiltSection):
            return self.cables.built(table, path)
        given = table.model_dump(exclude={"kind", "name"})
        if isinstance(table, GeneralSection):
            if table.coupled is not None:
                given["coupled"] = np.array(table.coupled)
            return Section(**given)
        make = Section.round if isinstance(table, RoundSection) else Section.rectangle
        size = ("diameter",) if isinstance(table, RoundSection) else ("width", "height")
        return make(*[given.pop(key) for key in size], **given)

    def _rod(self, table: RodTable, path: lines.Path) -> Rod | None:
        section, banded = self.cables.section(table, path, self.sections)
        if (table.points is None) == (table.file is None):
            raise ValueError("needs either 'points' or 'file'.")
        if table.file is not None:
            points = read_curve(self.source.folder / table.file, f"rod {table.name!r}")
        else:
            points = np.array(table.points, dtype=float)
        if section is None:
            return None
        options = table.model_dump(exclude={"name", "section", "strands", "points", "file", "unit"}, exclude_unset=True)
        rod = Rod(table.name, section, points * table.unit, **options)
        if banded:
            self.banded.append(table.name)
        names = [table.section] if isinstance(table.section, str) else [name for _, name in table.section]
        used = zip(names, (made for _, made in rod.sections), strict=True)
        self.notes += [self.source.fault((*path, "section"), text) for text in implausible(used)]
        return rod

    def _part(self, table: Any, path: lines.Path) -> Part:
        if table.name == "ground":
            raise ValueError("the name 'ground' is taken by what never moves; choose another.")
        mesh: pathlib.Path | None = None
        if table.mesh is not None:
            mesh = (self.source.folder / table.mesh).resolve()
        try:
            motion = self._motion(table.motion)
        except (ValueError, SceneError):  # the mesh may be faulty too
            self._check_mesh(Part(table.name, mesh, table.mesh_unit), path)
            self._shapes(table, path)
            raise
        part = Part(table.name, mesh, table.mesh_unit, motion, self._shapes(table, path))
        self._check_mesh(part, path)
        return part

    def _shapes(self, table: Any, path: lines.Path) -> list[Shape] | None:
        """Shapes of a part; faults of each at its key."""
        made = []
        for k, entry in enumerate(table.shape or ()):
            several = isinstance(self.source.value((*path, "shape")), list)
            inner: lines.Path = (*path, "shape", k) if several else (*path, "shape")
            given = entry.model_dump(exclude={"kind"}, exclude_none=True)
            if given.get("axes") is not None:
                given["axes"] = np.array(given["axes"]).T
            try:
                made.append(SHAPES[entry.kind](**given))
            except ValueError as error:
                text = str(error).removeprefix(f"{entry.kind}: ").replace("edge ", "edges ", 1)
                name = f"shape[{k}]" if several else "shape"
                at = re.match(r"(\w+)(?: (\d+))?: ", text)
                if at is None:
                    self.faults.append(self.source.fault(inner, f"{name}: {text}"))
                    continue
                inner += (at.group(1),) if at.group(2) is None else (at.group(1), int(at.group(2)))
                written = self.source.value(inner)
                if isinstance(written, str):
                    text = re.sub(r"\(got [^()]*\)", f"(got {short(written)})", text)
                self.faults.append(self.source.fault(inner, f"{name}.{text}"))
        return made or None

    def _motion(self, table: Any) -> Any:
        if isinstance(table, HingeTable):
            return Hinge(table.point, table.axis, table.angle, table.smooth)
        if isinstance(table, SliderTable):
            return Slider(table.axis, table.travel, table.smooth)
        if isinstance(table, PathTable):
            return Path.read(self.source.folder / table.file, smooth=table.smooth)
        return None

    def _check_mesh(self, part: Part, path: lines.Path) -> None:
        """Read the mesh of a part: a fault if that fails; what was repaired goes to the model's warnings."""
        if part.mesh is None:
            return
        try:
            surface = part.surface()
        except MeshError as error:
            self.faults += [self._bare(path, fault, ("mesh",)) for fault in error.faults]
        else:
            self.notes += [f"{surface.where}: {note}." for note in surface.report]

    def _support(self, table: Any, path: lines.Path) -> Support | Weld | None:
        rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
        if isinstance(table, WeldTable):
            other = self._find(self.rods, self.tables.rod, table.other, "rod", (*path, "other"))
            return self._weld(table, rod, other, path) if rod is not None and other is not None else None
        part = GROUND
        if table.to != "ground":
            part = self._find(self.parts, self.tables.part, table.to, "part", (*path, "to"))
        if rod is None or part is None:
            return None
        make = Pin if isinstance(table, PinTable) else Clamp
        frame = None if table.frame is None else np.array(table.frame).T
        return make(rod, table.at, part, tuple(table.free), frame, table.name)

    def _weld(self, table: WeldTable, rod: Rod, other: Rod, path: lines.Path) -> Weld:
        weld = Weld(rod, table.at, other, table.other_at)
        places = ((rod, rod.place(table.at, "weld")), (other, other.place(table.other_at, "weld")))
        ends = frozenset((rod.name, round(s / rod.length, 9)) for rod, s in places)
        number = int(path[1])
        first = self._welded.setdefault(ends, number)
        if first != number:
            line = self.source.lines.line_of(("support", first))
            raise ValueError(f"welds what support {first + 1} in line {line} welds already. Remove one of them.")
        return weld

    def _damping(self, table: Any, path: lines.Path) -> Term | None:
        rod = None
        if table.rod is not None:
            rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
            if rod is None:
                return None
        strains = (*(table.force_strains or (0.0,) * 3), *(table.moment_strains or (0.0,) * 3))
        return Damping(strains, table.time, table.mass, rod)

    def _drag(self, table: Any, path: lines.Path) -> Term | None:
        rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
        return None if rod is None else Drag(rod, **table.model_dump(exclude={"rod"}))

    def _electrostatic(self, table: Any, path: lines.Path) -> Term | None:
        rods = [
            self._find(self.rods, self.tables.rod, getattr(table, key), "rod", (*path, key)) for key in ("rod", "other")
        ]
        if any(rod is None for rod in rods):
            return None
        return Electrostatic(*rods, **table.model_dump(exclude={"rod", "other"}))

    def _contact(self, table: PartContactTable | RodContactTable, path: lines.Path) -> None:
        """Terms of one contact table: one of each rod with the part, or one of all rods."""
        number = int(path[1])
        names, keys = self._rods_of(table, path)
        rods = [self._find(self.rods, self.tables.rod, name, "rod", key) for name, key in zip(names, keys, strict=True)]
        other = table.part if isinstance(table, PartContactTable) else "rods"
        part = self._part_of(table, path) if isinstance(table, PartContactTable) else None
        law = table.model_dump(exclude={"kind", "rod", "rods", "part"})
        for name, key in zip(names, keys, strict=True):
            first = self._touching.setdefault((name, f"{table.kind} {other}"), number)
            if first != number:
                line = self.source.lines.line_of(("contact", first))
                what = f'part "{other}"' if table.kind == "part" else "other rods"
                hint = "Remove one of them." if table.kind == "part" else "Name all rods in one of them."
                reason = f'rod "{name}" touches {what} in contact {first + 1} in line {line} already. {hint}'
                self.faults.append(self.source.fault(key, reason))
        if any(rod is None for rod in rods) or (isinstance(table, PartContactTable) and part is None):
            return
        try:
            if part is not None:
                for rod in rods:
                    term = PartContact(rod, part, **law)
                    self._check_cells(rod, term.radius)
                    self.contacts[number, rod.name] = term
            else:
                among = RodContact(rods, **law)
                for rod, radius in zip(rods, among.radii, strict=True):
                    self._check_cells(rod, radius)
                self.contacts[number, ""] = among
        except ValueError as error:
            said = str(error)
            about = (*[key for key in ("layer", "radius") if key in said], "rods")
            self.faults.append(self._bare(path, said, about))

    @staticmethod
    def _check_cells(rod: Rod, radius: float) -> None:
        """ValueError if a radius is far too small for a rod."""
        if rod.length > MOST_CELLS * radius:
            raise ValueError(
                f"radius: {radius:.3g} m cuts rod {rod.name!r}, {rod.length:.3g} m long, into more than {MOST_CELLS} "
                "pieces. Is it given in the right unit?"
            )

    def _rods_of(self, table: Any, path: lines.Path) -> tuple[list[str], list[lines.Path]]:
        """Names of the rods of a contact, each once, and where they stand."""
        if isinstance(table, PartContactTable) and (table.rod is None) == (table.rods is None):
            raise ValueError("needs either 'rod' or 'rods'.")
        if isinstance(table, PartContactTable) and table.rod is not None:
            return [table.rod], [(*path, "rod")]
        names: list[str] = table.rods
        for k, name in enumerate(names):
            if name in names[:k]:
                self.faults.append(self.source.fault((*path, "rods", k), f'rods: rod "{name}" stands there twice.'))
        keep = [k for k, name in enumerate(names) if name not in names[:k]]
        return [names[k] for k in keep], [(*path, "rods", k) for k in keep]

    def _part_of(self, table: PartContactTable, path: lines.Path) -> Part | None:
        """The part of a contact, with something to touch."""
        key: lines.Path = (*path, "part")
        if table.part == "ground":
            reason = 'part "ground" has no surface. Declare a [[part]] without motion, give it a shape, and name that.'
            self.faults.append(self.source.fault(key, reason))
            return None
        part = self.parts.get(table.part)
        if part is None:
            names = [entry.name for entry in self.tables.part]
            if table.part not in names:
                reason = f'part "{table.part}" does not exist. {nearest(table.part, names)}'
                self.faults.append(self.source.fault(key, reason))
            return None
        if not part.shapes and part.mesh is None:
            reason = f'part "{table.part}" has neither a shape nor a mesh. Give it one to touch.'
            self.faults.append(self.source.fault(key, reason))
            return None
        return part

    def _load(self, table: Any, path: lines.Path) -> Term | None:
        rod = self._find(self.rods, self.tables.rod, table.rod, "rod", (*path, "rod"))
        if rod is None:
            return None
        given = table.model_dump(exclude={"kind", "rod", "constant"}, exclude_unset=True)
        if isinstance(table, LineLoadTable):
            if table.profile is not None:
                given["profile"] = self._profile(rod, *table.profile)
            return LineLoad(rod, **given)
        return PointLoad(rod, given.pop("at"), **given)

    def _drive(self, table: Any, path: lines.Path) -> Drive | None:
        if self.tables.solve.kind in ("static", "path"):
            raise ValueError('a drive turns its hinge: kind = "quasistatic" or "dynamic".')
        part = self._find(self.parts, self.tables.part, table.part, "part", (*path, "part"))
        if table.part == "ground":
            raise ValueError("part: 'ground' does not turn.")
        if part is None:
            return None
        first = next(k for k, other in enumerate(self.tables.drive) if other.part == table.part)
        if first != path[1]:
            line = self.source.lines.line_of(("drive", first))
            raise ValueError(f'part: "{table.part}" has a drive already, in line {line}.')
        supports = [h.to for h in self.supports.values() if isinstance(h, Support)]
        if part not in [*supports, *(getattr(term, "part", None) for term in self.contacts.values())]:
            raise ValueError(f'part: "{table.part}" holds and touches no rod, so that nothing is asked of its drive.')
        made = [self._line(entry, (*path, "lines", k)) for k, entry in enumerate(table.lines)]
        if None in made:
            return None
        return Drive(part, table.torque, table.uncertainty, table.motorisation, tuple(filter(None, made)))

    def _line(self, table: Any, path: lines.Path) -> Line | None:
        """One line of the budget of a drive."""
        names, where = [rod.name for rod in self.tables.rod], f"lines[{path[-1]}]"
        if table.torque is None and table.name not in names:
            reason = f'rod "{table.name}" does not exist, and no torque is given. {nearest(table.name, names)}'
            self.faults.append(self.source.fault(path, f"{where}: {reason}"))
        elif table.torque is not None and table.name in names:
            reason = f'"{table.name}" is a rod, its torque is what the run finds. Leave torque out.'
            self.faults.append(self.source.fault(path, f"{where}: {reason}"))
        else:
            try:
                return Line(**table.model_dump())
            except ValueError as error:
                text = re.sub(r"^line '[^']*': ", "", str(error))
                self.faults.append(self.source.fault(path, f"{where}.{text}"))
        return None

    @staticmethod
    def _profile(rod: Rod, places: list[Any], factors: list[float]) -> tuple[np.ndarray, list[float]]:
        """Places in metres from the rod's start to its end, as exact as a length can be typed."""
        length = float(rod.length)
        s = np.array([rod.place(place, "profile") if isinstance(place, str) else place for place in places])
        s = np.where(np.abs(s) < TYPED * length, 0.0, np.where(np.abs(s - length) < TYPED * length, length, s))
        low, high = float(s.min()), float(s.max())
        if low < 0.0 or high > length:
            what = low if low < 0.0 else high
            raise ValueError(f"profile: {what:.6g} m is not on rod {rod.name!r}, which runs from 0 to {length:.9g} m.")
        missing = [f"{a:.6g} to {b:.6g} m" for a, b in ((0.0, low), (high, length)) if b > a]
        if missing:
            raise ValueError(
                f"profile: says nothing of rod {rod.name!r} from {' and from '.join(missing)}. Add factors of 0 there if it "
                "carries no load; 'start' and 'end' are places too."
            )
        return s, factors
