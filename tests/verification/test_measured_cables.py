"""Cables whose bending stiffness was measured, and printed tables, against what their layers predict.

The layers of the catalogue and their status are in `cosserat-fem cables NAME`; the table of the documentation is made here:
`python tests/verification/test_measured_cables.py` prints it.
"""

import math
import pathlib
import re

import pytest

import cosserat_fem as cf
from cosserat_fem.cables.catalogue import entries

DOCS = pathlib.Path(__file__).parents[2] / "docs" / "scenes.md"
MEASURED = [name for name, entry in entries().items() if "bending_stiffness" in entry.given]
REASONS = {
    "ACSR Cardinal": "the slope at the end of that table scatters from 23 to 29, and its aluminium may be softer than "
    "69 GPa (with 55 GPa the lower end is 27)",
}
# derived elsewhere from E = 117 GPa, ETFE 0.8 GPa, strands straight: EI slip, EI stick [N m^2], EA [kN], GJ slip [N m^2]
PRINTED = {
    "M22759/16-24": (8.9e-5, 6.6e-4, 29, 6.3e-5),
    "M22759/16-22": (1.8e-4, 1.6e-3, 45, 1.3e-4),
    "M22759/16-20": (3.5e-4, 4.0e-3, 72, 2.5e-4),
    "M22759/16-18": (7.7e-4, 1.0e-2, 114, 5.6e-4),
    "M22759/16-16": (1.2e-3, 1.6e-2, 144, 8.8e-4),
    "M22759/33-26": (2.6e-5, 2.5e-4, 18, None),
    "M22759/33-24": (5.3e-5, 6.3e-4, 29, None),
    "M22759/33-22": (1.1e-4, 1.6e-3, 45, None),
    "M22759/33-20": (2.4e-4, 3.9e-3, 72, None),
    "M22759/32-18": (5.7e-4, 9.8e-3, 114, None),
    "M22759/32-16": (9.2e-4, 1.6e-2, 144, None),
}


def braid_alone():
    """The outer braid of the driveline without what is in it: predicted and measured.

    That it slips to less than filaments of 0.3 mm would (6.8e-5) says that they are finer."""
    nothing = cf.Material(1.0, 1.0)
    braids = [cf.Braid(96, 0.15e-3, math.radians(45), cf.material("polyester"))] * 2
    return cf.build_up([cf.Tube(nothing, diameter=3.6e-3), *braids]).bending_stiffness, (0.5e-4, 1.3e-4)


def cases():
    """Name -> predicted band, measured band [N m^2]."""
    found = {n: (entries()[n].predicted.bending_stiffness, entries()[n].cable.bending_stiffness) for n in MEASURED}
    return found | {"driveline outer braid alone": braid_alone()}


def decades_outside(predicted, measured):
    """How far the measured band sticks out of the predicted one, in powers of ten; 0 inside."""
    return max(0.0, math.log10(predicted[0] / measured[0]), math.log10(measured[1] / predicted[1]))


def table():
    """Markdown: predicted against measured."""
    lines = [
        "| cable | predicted slip to stick [N m^2] | measured slip to stick [N m^2] | inside | measured / predicted slip |",
        "|---|---|---|---|---|",
    ]
    for name, (predicted, measured) in cases().items():
        bands = [f"{low:.2g} to {high:.2g}" for low, high in (predicted, measured)]
        inside = "yes" if decades_outside(predicted, measured) == 0 else f"no: {REASONS[name]}"
        ratio = f"{measured[0] / predicted[0]:.2g}"
        lines.append("| " + " | ".join([name, *bands, inside, ratio]) + " |")
    return "\n".join(lines)


@pytest.mark.parametrize("name", cases())
def test_measured_inside_predicted(validation, name):
    """Measured ends lie inside the band that layers predict; a tenth of a decade where the table says why not."""
    predicted, measured = cases()[name]
    validation.error(
        "bending stiffness of measured cables, outside the predicted band", "three-point tests; see docs/scenes.md",
        decades_outside(predicted, measured), 0.1 if name in REASONS else 1e-12, unit="decades", variant=name,
    )  # fmt: skip


def test_documented_table_is_this_one():
    found = re.search("<!-- measured cables: begin -->\n(.*)\n<!-- measured cables: end -->", DOCS.read_text(), re.S)
    assert found.group(1) == table()


@pytest.mark.parametrize("name", PRINTED)
def test_printed_wires(name):
    """Wires of 19 strands: catalogue, sums written out here, and a printed table with two digits say the same."""
    layers = entries()[name].layers
    d, outer = (layer["diameter_mm"] * 1e-3 for layer in layers)
    E, insulation = 117e9, 0.8e9 * math.pi / 64 * (outer**4 - (5 * d) ** 4)
    one, area = math.pi / 64 * d**4, math.pi / 4 * d**2
    heights = [0, *(k * math.sqrt(3) / 2 for k in (-2, -1, 0, 1, 2) for _ in range(5 - abs(k)))][
        1:
    ]  # rows of 3, 4, 5, 4, 3
    slip = 19 * E * one + insulation
    stick = slip + E * area * sum((h * d) ** 2 for h in heights)
    cable = cf.cable_named(name)
    assert len(heights) == 19
    assert cable.bending_stiffness == pytest.approx((slip, stick), rel=1e-9)
    stiffness = (*cable.bending_stiffness, cable.stretch_stiffness / 1e3, cable.twist_stiffness[0])
    for got, printed in zip(stiffness, PRINTED[name], strict=True):
        assert printed is None or got == pytest.approx(printed, rel=0.045)


def test_derived_mass_is_below_the_largest_allowed():
    """Layers weigh 0 to 15 % less than the data sheets allow at most: the stranding and the moduli's areas are right."""
    for name in (n for n in entries() if n.startswith("M22759")):
        d, outer = (layer["diameter_mm"] * 1e-3 for layer in entries()[name].layers)
        plastic = cf.material(entries()[name].layers[1]["material"]).density
        mass = 8960 * 19 * math.pi / 4 * d**2 + plastic * math.pi / 4 * (outer**2 - (5 * d) ** 2)
        assert 0.85 < mass / cf.cable_named(name).mass_per_length <= 1.0


def test_bundle_of_24_wires():
    """The printed sum of free wires of a bundle of 24 AWG 22."""
    bundle = cf.build_up([cf.Cables(24, cf.cable_named("M22759/33-22"))])
    assert bundle.bending_stiffness[0] == pytest.approx(2.7e-3, rel=0.02)
    assert 0.100 < bundle.mass_per_length < 0.110


if __name__ == "__main__":
    print(table())
