"""What can a cable of these layers do? Stiffness between slipping and sticking strands, mass, inertia.

Rule: a cable is its layers from the inside out. Where strands slip, each bends about its own axis; where they stick, all
bend as one solid (Steiner's terms). A real cable lies between: it starts near the upper end and softens as its strands
slide, so that bending and twist are two numbers each, never one. Friction, the clamping of layers by each other and
viscous insulation move a cable within its band; they are not computed.

A strand laid at the angle beta to the cable's axis, tan beta = 2 pi r / lay, counts with EA cos^3 beta; in bending with
EI cos beta when it slips and 1/2 EA cos^3 beta r^2 more when it sticks; in twist with GJ cos beta and, sticking, G A r^2
more; with its mass / cos beta. Tubes are the same at both ends. Wraps of tape slide on each other and carry nothing at
the lower end.
Source: Foti and Martinelli (2016), doi 10.1016/j.ijsolstr.2016.04.034 (full stick and full slip of a strand; the sums);
Costello, Theory of Wire Rope, 2nd ed. (1997), chapters 2 and 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import asin, cos, pi, radians, sqrt

import numpy as np

from ..errors import check_integer, check_positive, check_shape
from ..section import Section

ENDS = ("slip", "stick")
SHEAR_FACTOR = 0.9  # of a solid round section


@dataclass(frozen=True)
class Material:
    """What a layer is made of. youngs_modulus, shear_modulus [Pa], density [kg/m^3]."""

    youngs_modulus: float
    shear_modulus: float
    density: float = 0.0
    name: str = "material"

    def __post_init__(self) -> None:
        for key in ("youngs_modulus", "shear_modulus"):
            check_positive(f"{self.name}: {key}", getattr(self, key))
        check_positive(f"{self.name}: density", self.density, zero=True)


@dataclass(frozen=True)
class Cable:
    """Stiffness, mass and size of a cable, from slipping to sticking strands.

    Parameters
    ----------
    diameter : [m]
    stretch_stiffness : EA [N]
    shear_stiffness : sum of G A [N], before the shear factor
    bending_stiffness, twist_stiffness : (slip, stick) [N m^2]
    mass_per_length : [kg/m]
    rotary_inertia : rho I about a diameter [kg m]
    """

    diameter: float
    stretch_stiffness: float
    shear_stiffness: float
    bending_stiffness: tuple[float, float]
    twist_stiffness: tuple[float, float]
    mass_per_length: float = 0.0
    rotary_inertia: float = 0.0

    @property
    def banded(self) -> bool:
        """Whether it matters if strands slip or stick."""
        pairs = (self.bending_stiffness, self.twist_stiffness)
        return any(high > low * (1 + 1e-9) for low, high in pairs)

    def section(self, strands: str) -> Section:
        """The section at one end of the band: `strands` is "slip" or "stick"."""
        if strands not in ENDS:
            raise ValueError(f"strands: must be 'slip' or 'stick' (got {strands!r}).")
        k = ENDS.index(strands)
        shear, bend = SHEAR_FACTOR * self.shear_stiffness, self.bending_stiffness[k]
        return Section(
            force_stiffness=(shear, shear, self.stretch_stiffness),
            moment_stiffness=(bend, bend, self.twist_stiffness[k]),
            mass_per_length=self.mass_per_length,
            rotary_inertia=(self.rotary_inertia, self.rotary_inertia, 2 * self.rotary_inertia),
            radius=self.diameter / 2,
        )


@dataclass(frozen=True)
class Strands:
    """Equal round wires: packed as closely as they go if this is the innermost layer, else one ring around what is inside.

    lay [m]: length of one turn; without it the wires run straight.
    """

    count: int
    diameter: float
    material: Material
    lay: float | None = None

    def added_to(self, core: Cable) -> Cable:
        return _with_helices(core, "strands", _solid(self.diameter, self.material), self.count, self.lay)


@dataclass(frozen=True)
class Cables:
    """Equal cables, laid like `Strands`; they slip and stick in themselves too."""

    count: int
    cable: Cable
    lay: float | None = None

    def added_to(self, core: Cable) -> Cable:
        return _with_helices(core, "cables", self.cable, self.count, self.lay)


@dataclass(frozen=True)
class Tube:
    """Insulation, jacket or filler: a closed tube on what is inside, to an outer `diameter` or of a `thickness` [m]."""

    material: Material
    diameter: float | None = None
    thickness: float | None = None

    def added_to(self, core: Cable) -> Cable:
        if (self.diameter is None) == (self.thickness is None):
            raise ValueError("tube: needs either 'diameter' or 'thickness'.")
        outer = _outer("tube", core.diameter, self.diameter, self.thickness)
        area, second = pi / 4 * (outer**2 - core.diameter**2), pi / 64 * (outer**4 - core.diameter**4)
        return _sum(core, _of(self.material, area, second, outer), slips=False)


@dataclass(frozen=True)
class Braid:
    """A shield or sleeve of `wires` round wires, half of them each way, at `angle` [rad] to the cable's axis."""

    wires: int
    diameter: float
    angle: float
    material: Material

    def added_to(self, core: Cable) -> Cable:
        check_integer("braid: wires", self.wires, 2)
        d = check_positive("braid: diameter", self.diameter)
        if not 0 <= self.angle < radians(89):
            raise ValueError(f"braid: angle must be from 0 to below 89 deg (got {self.angle * 180 / pi:g} deg).")
        wire, r, c = _solid(d, self.material), core.diameter / 2 + d, cos(self.angle)
        return replace(
            _with_rings(core, wire, np.full(self.wires, r), np.full(self.wires, c)), diameter=core.diameter + 4 * d
        )


@dataclass(frozen=True)
class Tape:
    """A wrap of tape of one `thickness` [m], each turn covering a part `overlap` of the last (0 to below 1)."""

    thickness: float
    material: Material
    overlap: float = 0.0

    def added_to(self, core: Cable) -> Cable:
        t = check_positive("tape: thickness", self.thickness)
        if not 0 <= self.overlap < 1:
            raise ValueError(f"tape: overlap must be from 0 to below 1 (got {self.overlap:g}).")
        outer = core.diameter + 2 * t / (1 - self.overlap)
        area, second = pi / 4 * (outer**2 - core.diameter**2), pi / 64 * (outer**4 - core.diameter**4)
        made = _of(self.material, area, second, outer)
        return replace(_sum(core, made, slips=True), stretch_stiffness=core.stretch_stiffness)


Layer = Strands | Cables | Tube | Braid | Tape
NOTHING = Cable(0.0, 0.0, 0.0, (0.0, 0.0), (0.0, 0.0))


def build_up(
    layers: Sequence[Layer],
    *,
    diameter: float | None = None,
    mass_per_length: float | None = None,
    bending_stiffness: tuple[float, float] | None = None,
) -> Cable:
    """Return the cable of these layers, from the inside out.

    Parameters
    ----------
    diameter : [m], mass_per_length : [kg/m], bending_stiffness : (slip, stick) [N m^2], optional
        Measured values to take instead of those derived.

    Raises
    ------
    ValueError
        A layer does not fit; the message begins with its number from 1.
    """
    if not layers:
        raise ValueError("layers: needs at least one.")
    made = NOTHING
    for k, layer in enumerate(layers):
        try:
            made = layer.added_to(made)
        except ValueError as error:
            raise ValueError(f"layer {k + 1}: {error}") from None
    if made.stretch_stiffness == 0:
        raise ValueError("layers: only tape; something must carry the cable.")
    if diameter is not None:
        made = replace(made, diameter=check_positive("diameter", diameter))
    if mass_per_length is not None:
        mass = check_positive("mass_per_length", mass_per_length)
        inertia = made.rotary_inertia * mass / made.mass_per_length if made.mass_per_length else 0.0
        made = replace(made, mass_per_length=mass, rotary_inertia=inertia)
    if bending_stiffness is not None:
        low, high = (
            check_positive("bending_stiffness", b) for b in check_shape("bending_stiffness", bending_stiffness, (2,))
        )
        if low > high:
            raise ValueError(f"bending_stiffness: must be [slip, stick], the smaller first (got {low:g}, {high:g}).")
        made = replace(made, bending_stiffness=(low, high))
    return made


def packed(count: int) -> np.ndarray:
    """Radii (count,) of the centres of equal circles of diameter 1, packed closely: places of a triangular lattice.

    About a place, the middle of two or the middle of three, whichever needs the smallest sum of squares: 1, 2, 3, 7, 12,
    19, 37 ... come out as they are stranded.
    """
    reach = int(sqrt(count)) + 2
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    x, y = (i + j / 2).ravel(), (sqrt(3) / 2 * j).ravel()
    centres = ((0.0, 0.0), (0.5, 0.0), (0.5, sqrt(3) / 6))
    radii = [np.sort(np.hypot(x - a, y - b))[:count] for a, b in centres]
    return min(radii, key=lambda r: round(float((r**2).sum()), 9))


def most_around(inner: float, diameter: float) -> int:
    """How many circles of one diameter fit in a ring around a circle."""
    return int(pi / asin(diameter / (inner + diameter)) * (1 + 1e-9))


def _with_helices(core: Cable, what: str, element: Cable, count: int, lay: float | None) -> Cable:
    """A core with a bundle of elements on it (or without a core, packed)."""
    count, d = check_integer(f"{what}: count", count, 1), element.diameter
    if core.diameter == 0:
        r = d * packed(count)
    else:
        most = most_around(core.diameter, d)
        if count > most:
            raise ValueError(
                f"{what}: count: at most {most} of {1e3 * d:.4g} mm fit around {1e3 * core.diameter:.4g} mm "
                f"(got {count}). Put the rest into another layer."
            )
        r = np.full(count, (core.diameter + d) / 2)
    turn = 2 * pi * r / check_positive(f"{what}: lay", lay) if lay is not None else np.zeros(count)
    return _with_rings(core, element, r, 1 / np.sqrt(1 + turn**2))


def _with_rings(core: Cable, element: Cable, r: np.ndarray, c: np.ndarray) -> Cable:
    """A core and elements with their centres at radii r (n,), at angles to the axis with cosines c (n,)."""
    square = r**2
    bend, twist = np.array(element.bending_stiffness), np.array(element.twist_stiffness)
    together = np.array([0.0, 1.0])  # slip, stick
    bend = bend * c.sum() + together * element.stretch_stiffness * (c**3 * square).sum() / 2
    twist = twist * c.sum() + together * element.shear_stiffness * square.sum()
    return _sum(
        core,
        Cable(
            diameter=float(2 * r.max() + element.diameter),
            stretch_stiffness=float(element.stretch_stiffness * (c**3).sum()),
            shear_stiffness=float(element.shear_stiffness * len(r)),
            bending_stiffness=(float(bend[0]), float(bend[1])),
            twist_stiffness=(float(twist[0]), float(twist[1])),
            mass_per_length=float(element.mass_per_length * (1 / c).sum()),
            rotary_inertia=float(((element.rotary_inertia + element.mass_per_length * square / 2) / c).sum()),
        ),
        slips=False,
    )


def _solid(diameter: float, material: Material) -> Cable:
    """One round wire."""
    d = check_positive("strands: diameter", diameter)
    return _of(material, pi / 4 * d**2, pi / 64 * d**4, d)


def _of(material: Material, area: float, second: float, outer: float) -> Cable:
    E, G, rho = material.youngs_modulus, material.shear_modulus, material.density
    bend, twist = E * second, 2 * G * second
    return Cable(outer, E * area, G * area, (bend, bend), (twist, twist), rho * area, rho * second)


def _sum(core: Cable, layer: Cable, *, slips: bool) -> Cable:
    """Both side by side; a layer that slips in itself carries nothing at the lower end."""
    low = 0.0 if slips else 1.0
    bend, twist = layer.bending_stiffness, layer.twist_stiffness
    return Cable(
        layer.diameter,
        core.stretch_stiffness + layer.stretch_stiffness,
        core.shear_stiffness + low * layer.shear_stiffness,
        (core.bending_stiffness[0] + low * bend[0], core.bending_stiffness[1] + bend[1]),
        (core.twist_stiffness[0] + low * twist[0], core.twist_stiffness[1] + twist[1]),
        core.mass_per_length + layer.mass_per_length,
        core.rotary_inertia + layer.rotary_inertia,
    )


def _outer(what: str, inner: float, diameter: float | None, thickness: float | None) -> float:
    """Outer diameter of a closed layer, larger than what is inside."""
    if thickness is not None:
        return inner + 2 * check_positive(f"{what}: thickness", thickness)
    outer = check_positive(f"{what}: diameter", diameter)
    if outer <= inner:
        raise ValueError(
            f"{what}: diameter must be larger than what is inside, {1e3 * inner:.4g} mm (got {1e3 * outer:.4g} mm)."
        )
    return outer


def awg_diameter(gauge: int) -> float:
    """Diameter [m] of a solid wire of American Wire Gauge: 0.127 mm * 92^((36 - n) / 39). Source: ASTM B258."""
    return 0.127e-3 * 92 ** ((36 - gauge) / 39)
