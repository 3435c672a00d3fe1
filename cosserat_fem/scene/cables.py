"""From layers to cables: what a scene's own cables are made of, and which section a rod gets.

Rule: a scene's own section comes before a cable of the catalogue of the same name. A rod whose section is a band from
slipping to sticking strands is built at one end of it, the lower one unless it says which.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..cables.buildup import ENDS, Braid, Cable, Cables, Layer, Material, Strands, Tape, Tube, build_up
from ..cables.catalogue import cable_named, entries, material
from ..section import Section
from . import lines
from .load import Source, short
from .tables import BraidTable, BuiltSection, CablesTable, RodTable, StrandsTable, TubeTable

COPPER = 117e9  # Pa
STIFFEST = 2.0  # of solid copper: solid steel is 1.8 times as stiff
SOFTEST = 1e6  # Pa; rubber, and a twentieth of the softest cable in the catalogue


class CableShop:
    """Cables of one scene: its own, and those of the catalogue that it names."""

    def __init__(self, source: Source, declared: Iterable[Any], faults: list[str]) -> None:
        self.source, self.faults = source, faults
        self.declared = [table.name for table in declared]  # sections of the scene
        self.own: dict[str, Cable] = {}
        self.used: list[str] = []  # cables of the catalogue
        self._faulty: set[str] = set()

    def built(self, table: BuiltSection, path: lines.Path) -> Section | None:
        """The section of a [[section]] of kind "built"; None if one of its layers is at fault."""
        self._faulty.add(table.name)
        layers = [self._layer(layer, (*path, "layers", k)) for k, layer in enumerate(table.layers)]
        whole = [layer for layer in layers if layer is not None]
        if len(whole) < len(layers):
            return None
        try:
            cable = build_up(
                whole,
                diameter=table.diameter,
                mass_per_length=table.mass_per_length,
                bending_stiffness=table.bending_stiffness,
            )
        except ValueError as error:
            numbered = re.match(r"layer (\d+): \w+: (.*)", str(error))
            if numbered is None:
                raise
            self._fault((*path, "layers", int(numbered.group(1)) - 1), numbered.group(2))
            return None
        self.own[table.name] = cable
        self._faulty.discard(table.name)
        return cable.section("slip")

    def find(self, name: str, path: lines.Path) -> Cable | None:
        """A cable by name, of the scene or of the catalogue; a fault with the nearest of both if there is none."""
        if name in self.own:
            return self.own[name]
        if name not in self.declared and name in entries():
            self.used += [name] if name not in self.used else []
            return cable_named(name)
        if name not in self.declared:
            self.faults.append(self.source.fault(path, self._unknown(name)))
        return None

    def section(self, table: RodTable, path: lines.Path, made: dict[str, Section]) -> tuple[Any, bool]:
        """Section of a rod as `Rod` takes it (None if one is missing), and whether it is a band to be run at both ends."""
        several = not isinstance(table.section, str)
        named: list[tuple[float, str]] = table.section if several else [(0.0, table.section)]
        end, banded = table.strands if table.strands in ENDS else ENDS[0], False
        found: list[tuple[float, Section | None]] = []
        for k, (s, name) in enumerate(named):
            key: lines.Path = (*path, "section", k) if several else (*path, "section")
            if name in self.declared and name not in self.own:
                found.append((s, made.get(name)))
                continue
            cable = self.find(name, key)
            banded |= cable is not None and cable.banded
            found.append((s, None if cable is None else cable.section(end)))
        if any(section is None for _, section in found):
            return None, False
        if table.strands is not None and not banded:
            reason = 'strands goes with a section that has strands: a cable of the catalogue, or kind = "built".'
            self.faults.append(self.source.fault((*path, "strands"), reason))
        return (found if several else found[0][1]), banded and table.strands in (None, "band")

    def _layer(self, table: Any, path: lines.Path) -> Layer | None:
        if isinstance(table, CablesTable):
            cable = self.find(table.cable, (*path, "cable"))
            mine = self.source.value((*path[:2], "name"))
            if (
                cable is None
                and table.cable in self.declared
                and (table.cable not in self._faulty or table.cable == mine)
            ):
                text = f'cable "{table.cable}" is no section of kind "built" above this one'
                self._fault(path, f"{text}; name one, or a cable of the catalogue.")
            return None if cable is None else Cables(table.count, cable, table.lay)
        try:
            of = self._material(table)
        except ValueError as error:
            self._fault(path, str(error))
            return None
        if isinstance(table, StrandsTable):
            return Strands(table.count, table.diameter, of, table.lay)
        if isinstance(table, TubeTable):
            return Tube(of, table.diameter, table.thickness)
        if isinstance(table, BraidTable):
            return Braid(table.wires, table.diameter, table.angle, of)
        return Tape(table.thickness, of, table.overlap)

    @staticmethod
    def _material(table: Any) -> Material:
        """Of the catalogue, with what the layer says itself instead; or all from the layer."""
        keys = ("youngs_modulus", "shear_modulus", "density")
        given = {key: value for key in keys if (value := getattr(table, key)) is not None}
        if table.material is not None:
            base = material(table.material)
            given = {key: getattr(base, key) for key in keys} | given
        if "youngs_modulus" not in given:
            raise ValueError("needs 'material' or 'youngs_modulus'.")
        given.setdefault("shear_modulus", given["youngs_modulus"] / 2.6)
        return Material(**given)

    def _fault(self, layer: lines.Path, text: str) -> None:
        """A fault of one layer, at the key it begins with if that was given, with the value as it was written."""
        text = text.removeprefix("material: ")
        match = re.match(r"(\w+)", text)
        key: lines.Path = (*layer, match.group(1)) if match else layer
        written = self.source.value(key)
        if written is None:
            key = layer
        elif isinstance(written, str):
            text = re.sub(r"\(got [^()]*\)", f"(got {short(written)})", text)
        self.faults.append(self.source.fault(key, f"layers[{layer[-1]}] {text}"))

    def _unknown(self, name: str) -> str:
        known = [*self.declared, *entries()]
        close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
        if close:
            more = f"Did you mean {close[0]!r}?"
        else:
            here = f"this scene has {', '.join(repr(n) for n in self.declared)}; " if self.declared else ""
            more = f"{here[:1].upper()}{here[1:]}`cosserat-fem cables` lists the catalogue."
            more = more[:1].upper() + more[1:]
        return f'section "{name}" does not exist. {more}'


def implausible(sections: Iterable[tuple[str, Section]]) -> list[str]:
    """What is said of sections whose bending stiffness no cable of their diameter can have."""
    said = []
    for name, section in sections:
        if section.radius is None:
            continue
        second = np.pi / 4 * section.radius**4
        bend = np.diag(section.matrix)[3:5]
        size = f"{2e3 * section.radius:.3g} mm"
        if bend.max() > STIFFEST * COPPER * second:
            said.append(
                f'section "{name}" is {bend.max() / (COPPER * second):.2g} times as stiff in bending as a solid copper rod '
                f"of its diameter, {size}; no cable is (EI = {bend.max():.3g} N m^2). Check its diameter and moduli."
            )
        elif section.outline is None and bend.min() < SOFTEST * second:
            said.append(
                f'section "{name}" is softer in bending than rubber of its diameter, {size}; no cable is '
                f"(EI = {bend.min():.3g} N m^2). Check its diameter and moduli."
            )
    return said
