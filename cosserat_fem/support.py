"""What holds the rod? Clamps, pins and guides, and welds between rods.

Rule: a support names a place of a rod, a part, and which of the six components it leaves free. It holds the rod where
it is drawn: at the part's reference place the held components have the values of the drawing, and they follow the part.
Supports are not terms: held unknowns are prescribed, and the residual left on them is the reaction.

With two free rotations ("rx", "ry") the joint is a cardan joint: the first named axis is fixed in the part, the second
in the rod's section, and the rotation about the third is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .errors import check_name, check_shape, nearest
from .mechanism import GROUND, Part
from .rod import Rod

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
Place = Literal["start", "end"] | float


@dataclass(frozen=True, eq=False)
class Support:
    """Common part of Clamp and Pin; use those."""

    rod: Rod
    at: Place
    to: Part = GROUND
    free: tuple[str, ...] = ()
    frame: Any = None
    name: str | None = None

    def __post_init__(self) -> None:
        kind = type(self).__name__.lower()
        if not isinstance(self.rod, Rod):
            raise ValueError(f"{kind}: rod must be a Rod (got {type(self.rod).__name__}).")
        if not isinstance(self.to, Part):
            raise ValueError(f"{kind}: to must be a Part (got {type(self.to).__name__}).")
        self.rod.place(self.at, kind)  # says what is wrong with `at`
        name = self.name or f"{self.rod.name}.{self.at if isinstance(self.at, str) else f'{self.at:g}'}@{self.to.name}"
        object.__setattr__(self, "name", check_name(kind, name))
        free = (self.free,) if isinstance(self.free, str) else tuple(self.free)
        for component in free:
            if component not in COMPONENTS:
                raise ValueError(
                    f"{kind} {name!r}: free component {component!r} is unknown. {nearest(component, COMPONENTS)}"
                )
        if len(set(free)) < len(free):
            raise ValueError(f"{kind} {name!r}: a component is named twice in free = {free}.")
        object.__setattr__(self, "free", free)
        if not self.held.any():
            raise ValueError(f"{kind} {name!r}: leaves every component free, so it holds nothing. Remove it.")
        if self.frame is not None:
            frame = check_shape(f"{kind} {name!r}: frame", self.frame, (3, 3))
            if not np.allclose(frame.T @ frame, np.eye(3), atol=1e-6) or np.linalg.det(frame) < 0:
                raise ValueError(f"{kind} {name!r}: frame must be three right-handed unit axes as columns.")
            object.__setattr__(self, "frame", frame)

    @property
    def held(self) -> np.ndarray:
        """Which of x, y, z, rx, ry, rz are held (6,)."""
        return np.array([c not in self.free for c in COMPONENTS])


@dataclass(frozen=True, eq=False)
class Clamp(Support):
    """Hold place and attitude of a section.

    Parameters
    ----------
    rod : Rod
    at : "start", "end" or arc length s [m] of the unstressed rod
    to : Part
        What it is fixed to; the support follows the part's motion.
    free : names out of "x", "y", "z", "rx", "ry", "rz"
        Components left free, along and about the axes of `frame`.
    frame : (3, 3), optional
        Axes as columns, in the drawing, fixed to the part; default x, y, z.
    name : str, optional
        Default ``rod.at@part``.
    """


@dataclass(frozen=True, eq=False)
class Pin(Support):
    """Hold the place of a section and leave its attitude free. Parameters as for Clamp."""

    @property
    def held(self) -> np.ndarray:
        return np.array([c not in self.free and not c.startswith("r") for c in COMPONENTS])


@dataclass(frozen=True, eq=False)
class Weld:
    """Join two rods rigidly, at the angle in which they are drawn.

    Parameters
    ----------
    rod, other : Rod
    at, other_at : "start", "end" or arc length s [m]
        The two places must coincide in the drawing.
    """

    rod: Rod
    at: Place
    other: Rod
    other_at: Place

    def __post_init__(self) -> None:
        for rod in (self.rod, self.other):
            if not isinstance(rod, Rod):
                raise ValueError(f"weld: rod and other must be Rods (got {type(rod).__name__}).")
        s, other_s = self.rod.place(self.at, "weld"), self.other.place(self.other_at, "weld")
        gap = float(np.linalg.norm(self.rod.drawn(np.array([s]))[0] - self.other.drawn(np.array([other_s]))[0]))
        if gap > 1e-6 * max(self.rod.drawn_length, self.other.drawn_length):
            raise ValueError(
                f"weld: rod {self.rod.name!r} at {self.at} and rod {self.other.name!r} at {self.other_at} are drawn "
                f"{gap:.4g} m apart; they must meet in one point."
            )
        if self.rod is self.other and abs(s - other_s) < 1e-12 * self.rod.length:
            raise ValueError(f"weld: joins rod {self.rod.name!r} at {self.at} to itself.")
