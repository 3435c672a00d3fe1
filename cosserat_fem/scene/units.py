"""What does "3.94 mm" mean? Unit strings to SI numbers.

Rule: a plain number is SI; a string is a number and a unit of the right dimension. Units are products and quotients of
the symbols below with integer powers: "mm", "deg/s", "N*m^2", "kg/m^3", "N m". Angles are numbers (rad).
"""

from __future__ import annotations

import math
import re
from typing import Any

# symbol -> (factor, (m, kg, s))
SYMBOLS: dict[str, tuple[float, tuple[int, int, int]]] = {
    "m": (1.0, (1, 0, 0)),
    "km": (1e3, (1, 0, 0)),
    "cm": (1e-2, (1, 0, 0)),
    "mm": (1e-3, (1, 0, 0)),
    "um": (1e-6, (1, 0, 0)),
    "in": (0.0254, (1, 0, 0)),
    "kg": (1.0, (0, 1, 0)),
    "g": (1e-3, (0, 1, 0)),
    "s": (1.0, (0, 0, 1)),
    "ms": (1e-3, (0, 0, 1)),
    "min": (60.0, (0, 0, 1)),
    "h": (3600.0, (0, 0, 1)),
    "rad": (1.0, (0, 0, 0)),
    "deg": (math.pi / 180, (0, 0, 0)),
    "rev": (2 * math.pi, (0, 0, 0)),
    "Hz": (1.0, (0, 0, -1)),
    "N": (1.0, (1, 1, -2)),
    "mN": (1e-3, (1, 1, -2)),
    "kN": (1e3, (1, 1, -2)),
    "Pa": (1.0, (-1, 1, -2)),
    "kPa": (1e3, (-1, 1, -2)),
    "MPa": (1e6, (-1, 1, -2)),
    "GPa": (1e9, (-1, 1, -2)),
}

# what a key asks for -> (dimension, example)
KINDS: dict[str, tuple[tuple[int, int, int], str]] = {
    "number": ((0, 0, 0), "0.3"),
    "length": ((1, 0, 0), "4 mm"),
    "time": ((0, 0, 1), "90 s"),
    "angle": ((0, 0, 0), "90 deg"),
    "angular rate": ((0, 0, -1), "1 deg/s"),
    "speed": ((1, 0, -1), "10 mm/s"),
    "acceleration": ((1, 0, -2), "9.81 m/s^2"),
    "force": ((1, 1, -2), "5 N"),
    "moment": ((2, 1, -2), "0.2 N m"),
    "force per length": ((0, 1, -2), "3 N/m"),
    "pressure": ((-1, 1, -2), "70 GPa"),
    "line stiffness": ((-1, 1, -2), "1e6 N/m^2"),
    "density": ((-3, 1, 0), "1500 kg/m^3"),
    "mass per length": ((-1, 1, 0), "20 g/m"),
    "inertia per length": ((1, 1, 0), "1e-7 kg m"),
    "bending stiffness": ((3, 1, -2), "0.01 N m^2"),
    "curvature": ((-1, 0, 0), "2 1/m"),
    "impulse": ((1, 1, -1), "0.1 N s"),
    "bending viscosity": ((3, 1, -1), "1e-4 N m^2 s"),
    "drag": ((-1, 1, -1), "0.2 N s/m^2"),
    "quadratic drag": ((-2, 1, 0), "6 N s^2/m^3"),
}

_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")
_FACTOR = re.compile(r"\s*([*/]?)\s*(1|[A-Za-z]+)(?:\s*(?:\^|\*\*)?\s*([-+]?\d+))?\s*")


def parse(value: Any, kind: str) -> float:
    """Return a number or unit string in SI; ValueError with an example of the right kind."""
    dimension, example = KINDS[kind]
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f'must be a number or a string with a unit, for example "{example}"')
    if not isinstance(value, str):
        if not math.isfinite(value):
            raise ValueError("must be finite")
        return float(value)
    head = _NUMBER.match(value)
    if head is None:
        raise ValueError(f'is not a number with a unit; write for example "{example}"')
    number, rest = float(head.group(1)), value[head.end() :]
    if not math.isfinite(number):
        raise ValueError("must be finite")
    if not rest.strip():
        if kind == "number":
            return number
        raise ValueError(f'has no unit; write for example "{example}", or a plain number in SI units')
    factor, found = _unit(rest, example)
    if found != dimension:
        article = "an" if kind[0] in "aeiou" else "a"
        raise ValueError(f'is not {article} {kind}; write for example "{example}"')
    return number * factor


def measured(value: Any) -> tuple[float, tuple[int, int, int] | None]:
    """A number or a string with any unit, in SI, and its dimension (None without a unit); ValueError if it is neither."""
    head = _NUMBER.match(value) if isinstance(value, str) else None
    if head is None or not value[head.end() :].strip():
        return parse(value, "number"), None
    factor, dimension = _unit(value[head.end() :], "4 mm")
    return float(head.group(1)) * factor, dimension


def _unit(text: str, example: str) -> tuple[float, tuple[int, int, int]]:
    """Factor and dimension of a product of units."""
    factor, dimension, at = 1.0, [0, 0, 0], 0
    while at < len(text):
        part = _FACTOR.match(text, at)
        if part is None or part.end() == at:
            raise ValueError(f'has a unit that cannot be read; write for example "{example}"')
        sign, symbol, power = part.groups()
        exponent = int(power or 1) * (-1 if sign == "/" else 1)
        if symbol != "1":
            if symbol not in SYMBOLS:
                raise ValueError(f"has the unknown unit {symbol!r}; known: {', '.join(SYMBOLS)}")
            scale, powers = SYMBOLS[symbol]
            factor *= scale**exponent
            dimension = [d + exponent * p for d, p in zip(dimension, powers, strict=True)]
        at = part.end()
    return factor, (dimension[0], dimension[1], dimension[2])
