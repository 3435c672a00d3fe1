"""What is allowed, and on what? Limits, and the rods, supports and parts that each of them is on.

Rule: a limit that names nothing is on everything it can be on. Nothing is measured here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ..errors import check_number, check_positive, nearest
from ..mechanism import Hinge, Part
from ..model import Model
from ..rod import Rod
from ..support import Support
from .rules import bend_rule

NEARBY = 3.0  # radii on both sides of a support on a part: clearance from the part is not looked at there


class Quantity(NamedTuple):
    """What a limit can be on: unit, whether the limit is a least one, what it is measured on, how it is called."""

    unit: str
    least: bool
    on: str
    words: str


QUANTITIES = {
    "bend_radius": Quantity("m", True, "rod", "bend radius"),
    "tension": Quantity("N", False, "rod", "tension"),
    "compression": Quantity("N", False, "rod", "compression"),
    "strain": Quantity("-", False, "rod", "strain"),
    "twist": Quantity("rad/m", False, "rod", "twist"),
    "reaction_force": Quantity("N", False, "support", "reaction force"),
    "reaction_moment": Quantity("N m", False, "support", "reaction moment"),
    "hinge_torque": Quantity("N m", False, "part", "hinge torque"),
    "clearance": Quantity("m", True, "pair", "clearance"),
}


@dataclass(frozen=True, eq=False)
class Limit:
    """A limit on one quantity of a run.

    Parameters
    ----------
    quantity : "bend_radius", "tension", "compression", "strain", "twist", "reaction_force", "reaction_moment",
        "hinge_torque" or "clearance"
    value : float
        The limit: least bend radius [m], largest tension or compression [N] along a rod, largest longitudinal strain [-] of
        any fibre, largest twist [rad/m], largest force [N] and moment [N m] of supports, largest torque [N m] of a hinge's
        drive, least clearance [m].
    rod, other, support, part : objects or names
        What it is measured on; default all there is: each rod, each support, each hinge; clearance of each rod from each
        part with a surface and from each other rod.
    diameters, rule : float or str, instead of `value`
        Of a bend radius: in diameters of the cable, or by the name of a rule (`cosserat-fem rules`).
    wire_diameter : float [m]
        Of the largest insulated wire, for a rule that counts in it.
    measured : "inside" or "centreline"
        Where a bend radius is measured. Rules and data sheets speak of the inside, half a diameter less than the centreline.
    leave_out : list of (s0, s1) [m]
        Stretches of the rod at which clearance is not looked at. Beside supports on the part it never is, see `NEARBY`.
    name : str
        How to call it; default from the quantity and what it is measured on.

    Raises
    ------
    ValueError
        A value is wrong or does not go with the quantity, or a rule is unknown.
    """

    quantity: str
    value: float | None = None
    rod: Rod | str | None = None
    other: Rod | str | None = None
    part: Part | str | None = None
    support: Support | str | None = None
    diameters: float | None = None
    rule: str | None = None
    wire_diameter: float | None = None
    measured: Literal["inside", "centreline"] = "inside"
    leave_out: Sequence[tuple[float, float]] = ()
    name: str | None = None

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f"limit: quantity {self.quantity!r} is unknown. {nearest(self.quantity, QUANTITIES)}")
        on = QUANTITIES[self.quantity].on
        fits = {"rod": ("rod", "pair"), "other": ("pair",), "part": ("part", "pair"), "support": ("support",)}
        for key, kinds in fits.items():
            if getattr(self, key) is not None and on not in kinds:
                raise ValueError(f"{key}: does not go with {self.quantity}.")
        if self.other is not None and self.part is not None:
            raise ValueError("other: give a part or another rod, not both.")
        ways = [key for key in ("value", "diameters", "rule") if getattr(self, key) is not None]
        if len(ways) != 1 and self.quantity == "bend_radius":
            raise ValueError("needs one of 'limit', 'diameters' and 'rule'.")
        if ways != ["value"] and self.quantity != "bend_radius":
            raise ValueError("needs the key 'limit'.")
        if self.value is not None:
            check_positive("limit", self.value, zero=self.quantity == "clearance")
        for key in ("diameters", "wire_diameter"):
            if getattr(self, key) is not None:
                check_positive(key, getattr(self, key))
        if self.rule is not None:
            rule = bend_rule(self.rule)
            if self.measured != "inside":
                raise ValueError("measured: a rule speaks of the inside of a bend.")
            if rule.diameter == "wire" and self.wire_diameter is None:
                raise ValueError(f"rule: {rule.name} counts in diameters of an insulated wire; give wire_diameter.")
        elif self.wire_diameter is not None:
            raise ValueError("wire_diameter: goes with a rule that counts in it.")
        for a, b in self.leave_out:
            if not check_number("leave_out", a) < check_number("leave_out", b):
                raise ValueError(f"leave_out: a stretch runs from a smaller to a larger s (got {a:g} m to {b:g} m).")

    def of(self, rod: Rod) -> float:
        """The limit for a rod, in the unit of the quantity."""
        if self.value is not None:
            return float(self.value)
        if self.rule is None:
            return float(self.diameters or 0.0) * diameter(rod)
        rule = bend_rule(self.rule)
        return float(rule.factor or 0.0) * (diameter(rod) if self.wire_diameter is None else self.wire_diameter)


def diameter(rod: Rod) -> float:
    """Outer diameter [m] of a cable, the largest along it; of a rectangle the smaller edge."""
    outlines = [section.outline for _, section in rod.sections]
    return max(
        2.0 * (s.radius or 0.0) if o is None else min(o) for o, (_, s) in zip(outlines, rod.sections, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Check:
    """One limit on one thing: a rod, a support, a hinge, or a rod and what it is to keep clear of."""

    name: str
    limit: Limit
    rod: Rod | None = None
    other: Part | Rod | None = None
    support: str | None = None
    part: Part | None = None
    left_out: tuple[tuple[float, float], ...] = ()

    @property
    def quantity(self) -> Quantity:
        return QUANTITIES[self.limit.quantity]

    @property
    def on(self) -> dict[str, str]:
        """Names of what it is measured on, by kind."""
        kind = "part" if isinstance(self.other, Part) else "other"
        named = {"rod": self.rod, kind: self.other, "support": self.support, "part ": self.part}
        return {k.strip(): v if isinstance(v, str) else v.name for k, v in named.items() if v is not None}


def checks_of(limits: Iterable[Limit], model: Model, parts: Sequence[Part] = ()) -> list[Check]:
    """Every limit on every thing it is on. ValueError if a name is not known, there is nothing, or two have one name."""
    every = [*model.parts, *(part for part in parts if part not in model.parts)]
    out: list[Check] = []
    for limit in limits:
        words = QUANTITIES[limit.quantity].words
        found = list(_things(limit, model, every))
        if not found:
            what = {"part": "no hinge that holds or touches a rod", "pair": "no part with a surface and no other rod"}
            nothing = what.get(QUANTITIES[limit.quantity].on, "no support")
            raise ValueError(f"{limit.quantity}: there is nothing to check: {nothing}.")
        for check, label in found:
            alone = limit.name is not None and len(found) == 1
            name = str(limit.name) if alone else f"{limit.name or words} {label}"
            if any(name == other.name for other in out):
                raise ValueError(f"{limit.quantity}: two checks are called {name!r}; give one of them a name.")
            out.append(replace(check, name=name))
    return out


def _things(limit: Limit, model: Model, parts: Sequence[Part]) -> Iterable[tuple[Check, str]]:
    """What a limit is on, and how to say it."""
    on = QUANTITIES[limit.quantity].on
    rods = {rod.name: rod for rod in model.rods}
    picked = list(rods.values()) if limit.rod is None else [_find("rod", limit.rod, rods)]
    if on == "rod":
        for rod in picked:
            _need_radius(limit, rod)
            yield Check("", limit, rod), f"of {rod.name}"
    elif on == "support":
        known = {str(support.name): support for support in model.supports}
        for name in known if limit.support is None else [str(_find("support", limit.support, known).name)]:
            yield Check("", limit, support=name), f"at {name}"
    elif on == "part":
        hinged = {part.name: part for part in model.parts if isinstance(part.motion, Hinge)}
        for part in hinged.values() if limit.part is None else [_find("hinge", limit.part, hinged)]:
            yield Check("", limit, part=part), f"of {part.name}"
    else:
        yield from _pairs(
            limit, picked, model, {part.name: part for part in parts if part.shapes or part.mesh is not None}
        )


def _pairs(limit: Limit, rods: list[Rod], model: Model, parts: dict[str, Part]) -> Iterable[tuple[Check, str]]:
    """Rods and what each is to keep clear of; rods that are welded together are left out unless they are named."""
    every = {rod.name: rod for rod in model.rods}
    if limit.part is not None:
        others: list[Part | Rod] = [_find("part with a surface", limit.part, parts)]
    elif limit.other is not None:
        others = [_find("rod", limit.other, every)]
    else:
        others = [*parts.values(), *model.rods]
    welded = {frozenset((weld.rod.name, weld.other.name)) for weld in model.welds}
    seen: set[frozenset[str]] = set()
    for rod in rods:
        for other in others:
            pair = frozenset((rod.name, other.name))
            if isinstance(other, Rod) and (other is rod or pair in seen or (limit.other is None and pair in welded)):
                continue
            if isinstance(other, Rod):
                seen.add(pair)
            spans = (*limit.leave_out, *beside_supports(model, rod, other, float(limit.value or 0.0)))
            yield Check("", limit, rod, other, left_out=spans), f"of {rod.name} from {other.name}"


def beside_supports(model: Model, rod: Rod, other: Part | Rod, wanted: float = 0.0) -> list[tuple[float, float]]:
    """Stretches (s0, s1) [m] of a rod beside its supports on a part: there it is meant to be close.

    To both sides `NEARBY` radii, or twice the wanted distance of the centreline if that is more.
    """
    spans = []
    for support in model.supports:
        if support.rod is rod and support.to is other:
            s = rod.place(support.at, "support")
            radius = float(rod.radius_at(np.array([s]))[0])
            reach = max(NEARBY * radius, 2.0 * (wanted + radius) if wanted > 0 else 0.0)
            spans.append((s - reach, s + reach))
    return spans


def _need_radius(limit: Limit, rod: Rod) -> None:
    """ValueError if a limit speaks of the size of a section that has none."""
    sized = limit.quantity == "strain" or (
        limit.quantity == "bend_radius" and (limit.measured == "inside" or limit.diameters)
    )
    if sized and any(section.radius is None and section.outline is None for _, section in rod.sections):
        raise ValueError(
            f"{limit.quantity}: a section of rod {rod.name!r} has no radius, so its outer fibres are not known. Give it one."
        )


def _find(kind: str, wanted: Any, known: dict[str, Any]) -> Any:
    name = wanted if isinstance(wanted, str) else str(wanted.name)
    if name not in known:
        raise ValueError(f"limit: no {kind} named {name!r}. {nearest(name, known)}")
    return known[name]
