"""Which problems, and what is right? Published problems as plain data, their references and how an error is measured.

Rule: nothing here knows a solver: ours (`models`) and those of others start from the same numbers, hand in the same
observed quantities and are judged by the same function. References share no code with this package
(`references.json`, made by tests/benchmarks/references.py: shooting and spectral elements; the deployment by collocation;
closed forms). Units are consistent, SI for the deployment and the capstan.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq


@dataclass(frozen=True)
class Beam:
    """A rod of constant, doubly symmetric section: length, stiffness, mass per length, rotary inertia per length.

    inertia : (about the rod, across it)
    """

    length: float
    EA: float
    GA: float
    GJ: float
    EI: float
    mass: float = 0.0
    inertia: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Problem:
    """One problem: what it is, where it is from, what `error` takes and measures.

    observed : what a solver hands in
    error : observed -> float, in the measure that `measured` names
    planar : a planar model can solve it
    times : when it is observed, of a problem over time
    """

    name: str
    title: str
    source: str
    observed: str
    measured: str
    error: Callable[[Any], float]
    beam: Beam | None = None
    planar: bool = False
    times: np.ndarray | None = None


@cache
def references() -> dict[str, Any]:
    """The packaged reference values."""
    text = files("cosserat_fem.bench").joinpath("references.json").read_text(encoding="utf-8")
    return {name: entry["values"] for name, entry in json.loads(text).items()}


# S1: a straight cantilever along x rolled up by an end couple about z; the tip comes back to the clamp.
ROLL_UP = Beam(1.0, 1e4, 1e4, 1.0, 1.0)
ROLL_UP_COUPLE = 2 * np.pi * ROLL_UP.EI / ROLL_UP.length


def _roll_up_error(tip: Any) -> float:
    return float(np.linalg.norm(tip)) / ROLL_UP.length


# S2: an arc of 45 degrees clamped at the origin along x, its centre at (0, R, 0); a dead force along z at the tip.
BEND_RADIUS = 100.0
BEND = Beam(BEND_RADIUS * np.pi / 4, 1e7, 5e6, 5e6 * 0.1406, 1e7 / 12)
BEND_FORCE = (0.0, 0.0, 600.0)


def bend_arc(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) of the unloaded arc and angles (n,) [rad] of its tangent about z at s (n,)."""
    angle = np.asarray(s) / BEND_RADIUS
    return BEND_RADIUS * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=-1), angle


def _bend_error(tip: Any) -> float:
    return float(np.linalg.norm(np.subtract(tip, references()["S2"]["tip"]))) / BEND.length


# S3: a naturally straight heavy cable between two clamps with tangents along x, at the origin and at (span, 0, 0).
SLACK = Beam(1.0, 1e5, 4e4, 0.8e-2, 1e-2, mass=0.2)
SLACK_SPAN = 0.6
SLACK_GRAVITY = 10.0  # towards -y: 2 per length


@cache
def _guess_table() -> tuple[np.ndarray, ...]:
    x = np.linspace(0.0, SLACK_SPAN, 4001)
    wave = 2 * np.pi / SLACK_SPAN

    def along(depth: float) -> np.ndarray:
        y = -0.5 * depth * (1 - np.cos(wave * x))
        return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])

    depth = brentq(lambda depth: along(depth)[-1] - SLACK.length, 0.01, 1.0)
    slope = -0.5 * depth * wave * np.sin(wave * x)
    return along(depth), x, -0.5 * depth * (1 - np.cos(wave * x)), np.arctan(slope)


def slack_guess(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where every solver may start: one wave of a cosine of the cable's length. Places (n, 2), angles (n,) [rad] at s."""
    length, x, y, angle = _guess_table()
    s = np.asarray(s) * length[-1] / SLACK.length
    return np.stack([np.interp(s, length, x), np.interp(s, length, y)], axis=-1), np.interp(s, length, angle)


def _slack_error(observed: Any) -> float:
    s, r = observed
    told = references()["S3"]
    exact = BarycentricInterpolator(told["s"], np.array(told["r"]))(np.asarray(s))
    return float(np.linalg.norm(np.asarray(r)[:, :2] - exact, axis=1).max()) / SLACK.length


# S4: a slender cantilever along x, a dead force across its tip, P L^2 / EI = 10.
ELASTICA = Beam(10.0, 1e8, 1e8, 100.0, 100.0)
ELASTICA_FORCE = (0.0, -10.0, 0.0)


def _elastica_error(tip: Any) -> float:
    return float(np.linalg.norm(np.subtract(tip, references()["S4"]["tip"]))) / ELASTICA.length


# D1: a free rod, force and dead couple at its end (6, 0, 0) that grow and fade.
SPAGHETTI = Beam(10.0, 1e4, 1e4, 500.0, 500.0, mass=1.0, inertia=(10.0, 10.0))
SPAGHETTI_ENDS = np.array([[6.0, 0.0, 0.0], [0.0, 8.0, 0.0]])
SPAGHETTI_KNOTS = ((0.0, 2.5, 5.0, 20.0), (0.0, 200.0, 0.0, 0.0))
SPAGHETTI_FORCE, SPAGHETTI_COUPLE = (0.1, 0.0, 0.0), (0.0, -0.5, -1.0)  # times the value between the knots


def _spaghetti_error(ends: Any) -> float:
    apart = np.asarray(ends) - references()["D1"]["ends"]
    return float(np.sqrt((apart**2).sum(axis=-1).mean())) / SPAGHETTI.length


# D2: a round rubber rod, 10 mm thick, pinned at the origin, falls from rest along x; no shear correction.
_AREA, _SECOND = np.pi * 0.01**2 / 4, np.pi * 0.01**4 / 64
PENDULUM = Beam(
    1.0, 5e6 * _AREA, 5e6 / 3 * _AREA, 5e6 / 3 * 2 * _SECOND, 5e6 * _SECOND,
    mass=1100 * _AREA, inertia=(1100 * 2 * _SECOND, 1100 * _SECOND),
)  # fmt: skip
PENDULUM_GRAVITY = 9.81  # towards -y


def _pendulum_error(tip: Any) -> float:
    apart = np.asarray(tip)[:, :2] - references()["D2"]["tip"]
    return float(np.sqrt((apart**2).sum(axis=-1).mean())) / PENDULUM.length


# D3: a straight cable along x, clamped at the origin and to an arm that turns about the axis z through (pivot, 0, 0).
FOLLOW = Beam(0.5, 1e3, 4e2, 0.8e-3, 1e-3, mass=0.05, inertia=(1e-7, 5e-8))
FOLLOW_PIVOT, FOLLOW_ARM, FOLLOW_RATE = 0.2, 0.3, np.pi / 180


def _follow_error(reaction: Any) -> float:
    exact = np.array(references()["D3"]["reaction"])
    apart = np.asarray(reaction) - exact
    return float((np.sqrt((apart[1:] ** 2).mean(axis=0)) / np.abs(exact).max(axis=0)).max())


# B03: the shipped scene.
def _deployment_error(loads: Any) -> float:
    exact = np.array(references()["B03"]["loads"])
    return float((np.abs(np.asarray(loads) - exact).max(axis=0) / np.abs(exact).max(axis=0)).max())


# C1: a thin rope pulled slipping over half a drum. mu, drum, rope radius [m], free spans [m], tension [N] at the slack end.
DRUM_FRICTION, DRUM_RADIUS, DRUM_ROPE, DRUM_FREE, DRUM_TENSION, DRUM_TURN = 0.3, 0.1, 0.002, 0.05, 10.0, np.pi


def capstan_exponent(friction: float, rope: float, drum: float) -> float:
    """Exponent of T ~ exp(exponent angle) for a rope of finite radius, friction at its surface.

    Positive root of mu e x^2 + x - mu (1 - e) = 0, e = rope / (rope + drum): balance of forces along and across the rope
    and of moments about its centreline, which friction at the surface turns.
    """
    part = rope / (rope + drum)
    return float(2 * friction * (1 - part) / (1 + np.sqrt(1 + 4 * friction**2 * part * (1 - part))))


def _capstan_error(exponent: float) -> float:
    exact = capstan_exponent(DRUM_FRICTION, DRUM_ROPE, DRUM_RADIUS)
    return abs(float(np.expm1((exponent - exact) * DRUM_TURN)))


_SHOOTING = "reference by shooting (DOP853)"
_SPECTRAL = "reference by spectral elements (Gauss-Lobatto, DOP853)"

PROBLEMS = {
    problem.name: problem
    for problem in (
        Problem(
            "S1", "roll-up to a full circle", "Simo and Vu-Quoc 1986, doi 10.1016/0045-7825(86)90079-4; exact",
            "tip (3,)", "distance of the tip / L", _roll_up_error, ROLL_UP, planar=True,
        ),
        Problem(
            "S2", "45 degree bend", f"Bathe and Bolourchi 1979, doi 10.1002/nme.1620140703; {_SHOOTING}",
            "tip (3,)", "distance of the tip / L", _bend_error, BEND,
        ),
        Problem(
            "S3", "slack heavy cable, span 0.6 L", _SHOOTING,
            "s (n,), places (n, 2 or 3)", "largest distance of a node / L", _slack_error, SLACK, planar=True,
        ),
        Problem(
            "S4", "slender cantilever, P L^2 / EI = 10", f"Bisshopp and Drucker 1945; {_SHOOTING}",
            "tip (3,)", "distance of the tip / L", _elastica_error, ELASTICA, planar=True,
        ),
        Problem(
            "D1", "flying spaghetti in space, 10 s", f"after Simo and Vu-Quoc 1988; {_SPECTRAL}",
            "both ends (101, 2, 3)", "root mean square of both ends at 101 times / L", _spaghetti_error, SPAGHETTI,
            times=0.1 * np.arange(101),
        ),
        Problem(
            "D2", "rubber pendulum, 1 s", _SPECTRAL,
            "tip (101, 2 or 3)", "root mean square of the tip at 101 times / L", _pendulum_error, PENDULUM, planar=True,
            times=0.01 * np.arange(101),
        ),
        Problem(
            "D3", "cable follows an arm by 90 deg", _SHOOTING,
            "force x, y and couple z on the cable at the arm (91, 3)",
            "worst component's root mean square at 91 stations / its peak", _follow_error, FOLLOW, planar=True,
            times=np.arange(91.0),
        ),
        Problem(
            "B03", "satellite hinge deployment", "the shipped scene; reference by collocation of order 6",
            "Fx, Fy, |F|, Mz at the fixed end, Mz at the moving end (91, 5)", "worst component at any station / its peak",
            _deployment_error, planar=True, times=np.arange(91.0),
        ),
        Problem(
            "C1", "rope slipping over a drum", "closed form for a rope of finite radius",
            "exponent of the tension along the wrap", "error of T2 / T1", _capstan_error,
        ),
    )
}  # fmt: skip
