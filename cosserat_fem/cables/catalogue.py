"""Which cables are known, and from where? Real wires and cables with their sources.

Rule: every number comes from `cables.toml` with its source and status (measured, data sheet, derived, recalled,
assumed) or is derived there from layers that have them. Stiffness in bending and twist is a band from slipping to sticking
strands; measured ends replace derived ones.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from importlib import resources
from math import radians
from typing import Any

from ..errors import nearest
from ..section import Section
from .buildup import Braid, Cable, Cables, Layer, Material, Strands, Tape, Tube, awg_diameter, build_up

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MM, G_PER_M = 1e-3, 1e-3


@dataclass(frozen=True)
class Entry:
    """A cable of the catalogue: what it is, its stiffness, what its layers alone predict, and where the numbers are from."""

    name: str
    about: str
    cable: Cable
    predicted: Cable
    given: dict[str, str]  # quantity -> status of a value that is not derived
    layers: tuple[dict[str, Any], ...]
    source: str
    layers_source: str


def cable_named(name: str) -> Cable:
    """A cable of the catalogue. ValueError with the nearest name if it is not there."""
    return entry(name).cable


def catalogue_section(name: str, strands: str) -> Section:
    """The section of a cable of the catalogue, its strands "slip" or "stick"."""
    return cable_named(name).section(strands)


def entry(name: str) -> Entry:
    """A cable of the catalogue with all that is known of it."""
    found = entries()
    if name not in found:
        raise ValueError(f"cable {name!r} is not in the catalogue. {nearest(name, found)}")
    return found[name]


def sources(name: str) -> dict[str, str]:
    """What a cable of the catalogue is and where its numbers are from, with their status."""
    found = entry(name)
    return {"about": found.about, "source": found.source, "layers_source": found.layers_source}


@cache
def _data() -> dict[str, Any]:
    return tomllib.loads((resources.files("cosserat_fem.cables") / "cables.toml").read_text(encoding="utf-8"))


@cache
def materials() -> dict[str, Material]:
    """Materials by name."""
    keys = ("youngs_modulus", "shear_modulus", "density")
    return {name: Material(**{k: about[k] for k in keys}, name=name) for name, about in _data()["material"].items()}


def material(name: str) -> Material:
    """A material of the catalogue. ValueError with the nearest name if it is not there."""
    if name not in materials():
        raise ValueError(f"material {name!r} is unknown. {nearest(name, materials())}")
    return materials()[name]


@cache
def entries() -> dict[str, Entry]:
    """All cables of the catalogue, by name."""
    made: dict[str, Entry] = {}
    for family in _data()["family"]:
        for row in family["wires"]:
            table = _wire(family, *row)
            made[table["name"]] = _entry(table, made)
    for table in _data()["cable"]:
        made[table["name"]] = _entry(table, made)
    return made


def _wire(family: dict[str, Any], gauge: int, strand: int, diameter: float, mass: float) -> dict[str, Any]:
    """A hook-up wire as a table like those of other cables."""
    return {
        "name": f"{family['prefix']}{gauge}",
        "about": f"AWG {gauge}, {family['strands']} x AWG {strand} {family['about']}",
        "diameter_mm": diameter,
        "mass_g_per_m": mass,
        "status": family["status"],
        "source": family["source"],
        "layers": [
            {
                "kind": "strands",
                "count": family["strands"],
                "diameter_mm": round(awg_diameter(strand) / MM, 4),
                "material": family["conductor"],
            },
            {"kind": "tube", "diameter_mm": diameter, "material": family["insulation"]},
        ],
        "layers_status": "assumed",
        "layers_source": "strands as in the sheet, diameters by ASTM B258; straight, insulation on the circle around them",
    }


def _entry(table: dict[str, Any], made: dict[str, Entry]) -> Entry:
    layers = [_layer(layer, made, measured=True) for layer in table["layers"]]
    bare = [_layer(layer, made, measured=False) for layer in table["layers"]]
    given: dict[str, str] = {
        key: table["status"] for key in ("diameter_mm", "mass_g_per_m", "bending_stiffness") if key in table
    }
    whole = {
        "diameter": table["diameter_mm"] * MM if "diameter_mm" in table else None,
        "mass_per_length": table["mass_g_per_m"] * G_PER_M if "mass_g_per_m" in table else None,
    }
    bend = tuple(table["bending_stiffness"]) if "bending_stiffness" in table else None
    return Entry(
        table["name"],
        table["about"],
        build_up(layers, bending_stiffness=bend, **whole),
        build_up(bare, **whole),
        given,
        tuple(table["layers"]),
        f"{table['source']} ({table['status']})",
        f"{table['layers_source']} ({table['layers_status']})",
    )


def _layer(table: dict[str, Any], made: dict[str, Entry], *, measured: bool) -> Layer:
    lay = table["lay_mm"] * MM if "lay_mm" in table else None
    kind = table["kind"]
    if kind == "cables":
        inner = made[table["cable"]]
        return Cables(table["count"], inner.cable if measured else inner.predicted, lay)
    of = material(table["material"])
    if kind == "strands":
        return Strands(table["count"], table["diameter_mm"] * MM, of, lay)
    if kind == "tube":
        return Tube(of, diameter=table["diameter_mm"] * MM)
    if kind == "tape":
        return Tape(table["thickness_mm"] * MM, of, table.get("overlap", 0.0))
    return Braid(table["wires"], table["diameter_mm"] * MM, radians(table["angle_deg"]), of)


def listing(part: str | None = None) -> str:
    """Cables with `part` in their names as a text table; one alone with its layers and sources. Nothing found: empty."""
    found = entries()
    if part in found:
        return _details(found[part])
    chosen = [e for e in found.values() if part is None or part.lower() in e.name.lower()]
    if not chosen:
        return ""
    rows = [("name", "mm", "g/m", "EA kN", "EI N m^2, slip to stick", "GJ N m^2, slip to stick", "EI is")]
    for e in chosen:
        c = e.cable
        rows.append(
            (
                e.name,
                f"{c.diameter / MM:.2f}",
                f"{c.mass_per_length / G_PER_M:.3g}",
                f"{c.stretch_stiffness / 1e3:.3g}",
                _band(c.bending_stiffness),
                _band(c.twist_stiffness),
                e.given.get("bending_stiffness", "derived"),
            )
        )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        lines.append("  ".join([row[0].ljust(widths[0]), *cells[1:-1], row[-1]]))
    return "\n".join(lines)


def _band(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.1e} to {ends[1]:.1e}"


def _details(e: Entry) -> str:
    c = e.cable
    lines = [f"{e.name}: {e.about}"]
    for label, value, key in (
        ("outer diameter", f"{c.diameter / MM:.3g} mm", "diameter_mm"),
        ("mass", f"{c.mass_per_length / G_PER_M:.3g} g/m", "mass_g_per_m"),
        ("EA", f"{c.stretch_stiffness / 1e3:.3g} kN", ""),
        ("EI, slip to stick", f"{_band(c.bending_stiffness)} N m^2", "bending_stiffness"),
        ("GJ, slip to stick", f"{_band(c.twist_stiffness)} N m^2", ""),
    ):
        lines.append(f"  {label:18} {value:28} {e.given.get(key, 'derived')}")
    if "bending_stiffness" in e.given:
        lines.append(f"  {'':18} {_band(e.predicted.bending_stiffness) + ' N m^2':28} derived from the layers")
    lines.append(f"  source: {e.source}")
    lines.append("  layers, from the inside:")
    known = _data()["material"]
    for layer in e.layers:
        about = ", ".join(f"{key} {value}" for key, value in layer.items() if key != "kind")
        lines.append(f"    {layer['kind']}: {about}")
    lines.append(f"  source: {e.layers_source}")
    for name in dict.fromkeys(layer["material"] for layer in e.layers if "material" in layer):
        m = known[name]
        lines.append(
            f"  {name}: E {m['youngs_modulus'] / 1e9:.3g} GPa, G {m['shear_modulus'] / 1e9:.3g} GPa, "
            f"{m['density']:g} kg/m^3; {m['source']} ({m['status']})"
        )
    return "\n".join(lines)
