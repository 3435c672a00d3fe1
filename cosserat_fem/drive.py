"""What does the cable ask of the drive? Torque against angle both ways, the loop between them, and the margin that is left.

Rule: everything is read from a history and from the data of a drive; torque is what the drive must supply about the hinge
axis, positive along it. A stroke is a stretch of states in which the hinge turns one way; "out" is the sense of the first
stroke. The band is the torque out minus the torque back at the same angle, the work of a cycle is the integral of torque
over angle along all strokes: in equilibria of rods that come back to where they were it is what friction took.

Margin: each line of the torque budget counts with its uncertainty factor where it resists the motion and not at all where
it helps; the drive must have `motorisation` times their sum. The form, and the factors that stand unless others are given (2
on the sum, 3 on harness, friction and other resistances that were not measured), are those of ECSS-E-ST-33-01C,
motorisation; they are recalled, not looked up: check them against the issue of the standard that binds you.

The reduced joint model is for simulations of the mechanism that leave the cable out: torque = stiffness * angle + preload +
coulomb * sense of turning + viscous * rate, fitted by least squares over the angle; or, where that is too far off, a table
of the mean of both ways and of half the band.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from .errors import check_name, check_positive, check_shape
from .export import hinged_parts, write_csv, write_json
from .history import History
from .mechanism import Hinge, Part
from .rod import Rod

UNCERTAINTY, MOTORISATION = 3.0, 2.0
STATUS = "ECSS-E-ST-33-01C, motorisation; recalled, check the standard"
CLOSED = 1e-6  # rad: a cycle ends where it began
ROWS = 41  # of the table of a joint model
LINEAR = 0.05  # of the largest torque: a linear model that is further off is not recommended


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a torque budget.

    Parameters
    ----------
    name : str
        Of a rod: then `torque` is what the run says of it, with this uncertainty factor. Else of something that resists.
    torque : float [N m], optional
        What resists in both directions, as bearings do.
    uncertainty : float
        Factor on it.
    """

    name: str
    torque: float | None = None
    uncertainty: float = UNCERTAINTY

    def __post_init__(self) -> None:
        check_name("line", self.name)
        if self.torque is not None:
            check_positive(f"line {self.name!r}: torque", self.torque, zero=True)
        if check_positive(f"line {self.name!r}: uncertainty", self.uncertainty) < 1.0:
            raise ValueError(f"line {self.name!r}: uncertainty must be at least 1 (got {self.uncertainty:g}).")


@dataclass(frozen=True, eq=False)
class Drive:
    """What turns a hinge.

    Parameters
    ----------
    part : Part
        It has a hinge.
    torque : float [N m] or (angles [rad], torques [N m])
        Smallest torque that is available in either direction; a table over the angle is linear between its rows.
    uncertainty : float
        Factor on the torque of rods that have no line of their own.
    motorisation : float
        Factor on the sum.
    lines : sequence of Line
    """

    part: Part
    torque: Any
    uncertainty: float = UNCERTAINTY
    motorisation: float = MOTORISATION
    lines: Sequence[Line] = ()

    def __post_init__(self) -> None:
        where = f"drive of {self.part.name!r}"
        if not isinstance(self.part.motion, Hinge):
            raise ValueError(f"{where}: part {self.part.name!r} has no hinge.")
        if isinstance(self.torque, tuple | list):
            if len(self.torque) != 2:
                raise ValueError(f"{where}: torque must be a number or (angles, torques).")
            angles = check_shape(f"{where}: torque angles", self.torque[0], (-1,))
            values = check_shape(f"{where}: torque values", self.torque[1], (len(angles),))
            if len(angles) < 2 or (np.diff(angles) <= 0).any():
                raise ValueError(f"{where}: torque needs at least two angles that increase.")
            if (values <= 0).any():
                raise ValueError(f"{where}: torque must be greater than 0 (got {values.min():g}).")
            object.__setattr__(self, "torque", (angles, values))
        else:
            check_positive(f"{where}: torque", self.torque)
        for name in ("uncertainty", "motorisation"):
            if check_positive(f"{where}: {name}", getattr(self, name)) < 1.0:
                raise ValueError(f"{where}: {name} must be at least 1 (got {getattr(self, name):g}).")
        names = [line.name for line in self.lines]
        if len(set(names)) < len(names):
            raise ValueError(f"{where}: lines: a name is used twice.")

    def available(self, angle: np.ndarray) -> np.ndarray:
        """Torque (n,) [N m] at some angles [rad]; NaN outside a table."""
        if isinstance(self.torque, tuple):
            angles, torques = self.torque
            return np.interp(angle, angles, torques, left=np.nan, right=np.nan)
        return np.full(len(angle), float(self.torque))


@dataclass(frozen=True, eq=False)
class Stroke:
    """One way of a hinge: numbers of its states (n,), sense 1 or -1, angles (n,) [rad] and torques (n,) [N m]."""

    rows: np.ndarray
    sense: int
    angle: np.ndarray
    torque: np.ndarray

    def curve(self, torque: np.ndarray | None = None) -> PchipInterpolator:
        """Torque over the angle, through all states; where the hinge stood still, through the last one."""
        values = self.torque if torque is None else torque
        keep = np.append(np.abs(np.diff(self.angle)) > 0.0, True)
        order = np.argsort(self.angle[keep])
        return PchipInterpolator(self.angle[keep][order], values[keep][order])

    @property
    def work(self) -> float:
        """Of the drive [J]."""
        return float(self.sense * self.curve().integrate(self.angle.min(), self.angle.max()))


def strokes(history: History, part: Part | str) -> list[Stroke]:
    """Ways of a part's hinge, in order; the state at which it turns belongs to both. None if it never turns, or
    if its torque is not a number somewhere."""
    angle, torque, sense = history.hinge_angle(part), history.hinge_torque(part), history.hinge_sense(part)
    if not sense.any() or not np.isfinite(torque).all():
        return []
    cuts = [0, *np.flatnonzero(np.diff(sense)).tolist(), len(angle) - 1]
    spans = [np.arange(a, b + 1) for a, b in pairwise(cuts) if b > a]
    return [Stroke(rows, int(sense[rows[-1]]), angle[rows], torque[rows]) for rows in spans]


def rod_torque(history: History, part: Part | str, rod: Rod | str) -> np.ndarray:
    """Torque (T,) [N m] that a drive must supply against one rod: what its supports on the part and its contact with it
    add to `History.hinge_torque`."""
    part, rod = history.part(part), history.rod(rod)
    hinge: Hinge = part.motion  # type: ignore[assignment]
    total = np.zeros(len(history))
    for term in history.model.contacts:
        if getattr(term, "part", None) is part and rod in term.rods:
            total += history.contact_torque(part, term.name)
    for support in history.model.supports:
        if support.to is part and support.rod is rod:
            load, arm = history.reaction(support), history.support_place(support) - hinge.point
            total += (np.cross(arm, load[:, :3]) + load[:, 3:]) @ hinge.axis
    return total


def describe_torque(history: History, part: Part | str) -> dict[str, Any]:
    """Peaks of the torque out and back, the band between them, the work; angles in degrees, JSON values."""
    ways = strokes(history, part)
    if not ways:
        return {}
    out = [stroke for stroke in ways if stroke.sense == ways[0].sense]
    back = [stroke for stroke in ways if stroke.sense != ways[0].sense]
    said: dict[str, Any] = {"peaks": {"out": _peaks(history, out)}}
    work = {"out": sum(stroke.work for stroke in out)}
    if back:
        said["peaks"]["back"] = _peaks(history, back)
        said["band"] = _band(out[0], back[0])
        work["back"] = sum(stroke.work for stroke in back)
    if back and abs(ways[-1].angle[-1] - ways[0].angle[0]) < CLOSED:
        work["cycle"] = work["out"] + work["back"]
    if history.model.contacts:
        lost = (history.friction_work(term.name) for term in history.model.contacts)
        work["friction"] = float(sum(told[-1] - told[0] for told in lost))
    return said | {"work": work}


def as_peaks(history: History, part: Part | str) -> dict[str, Any]:
    """What `describe_torque` would say of peaks if the only state of a history were all of them."""
    one = Stroke(np.arange(1), 1, history.hinge_angle(part), history.hinge_torque(part))
    return {"peaks": {way: _peaks(history, [one]) for way in ("out", "back")}}


def _peaks(history: History, ways: list[Stroke]) -> dict[str, Any]:
    """Largest and smallest torque of some strokes."""
    said = {}
    for name, pick in (("largest", np.argmax), ("smallest", np.argmin)):
        torque, angle = (np.concatenate([getattr(way, key) for way in ways]) for key in ("torque", "angle"))
        k = int(pick(torque))
        row = int(np.concatenate([way.rows for way in ways])[k])
        said[name] = {
            "value": float(torque[k]), "angle_deg": float(np.degrees(angle[k])), "t": float(history.t[row])
        }  # fmt: skip
    return said


def _band(out: Stroke, back: Stroke) -> dict[str, Any]:
    """Torque out minus torque back at the same angle, over the angles that both passed."""
    low, high = max(out.angle.min(), back.angle.min()), min(out.angle.max(), back.angle.max())
    angles = np.unique(np.concatenate([out.angle, back.angle, [low, high]]))
    angles = angles[(angles >= low) & (angles <= high)]
    if len(angles) < 2:
        return {"largest": None, "mean": None}
    apart = out.curve()(angles) - back.curve()(angles)
    k = int(np.argmax(np.abs(apart)))
    mean = float(trapezoid(apart, angles) / (high - low))
    return {"largest": {"value": float(apart[k]), "angle_deg": float(np.degrees(angles[k]))}, "mean": mean}


@dataclass(frozen=True, eq=False)
class Margins:
    """What a drive must have and has, at each state of each stroke, one after the other.

    rows (n,), sense (n,), angle (n,) [rad]; required, available (n,) [N m] in the sense of the motion; margin (n,):
    available over required, minus 1; infinite where nothing resists. lines: {name: largest resisting torque [N m], factor}.
    """

    rows: np.ndarray
    sense: np.ndarray
    angle: np.ndarray
    required: np.ndarray
    available: np.ndarray
    margin: np.ndarray
    lines: dict[str, tuple[float, float]]


def margins(history: History, drive: Drive) -> Margins:
    """What a drive must have at each state."""
    part, model = drive.part, history.model
    given = {line.name: line for line in drive.lines}
    ways = strokes(history, part)
    rows = np.concatenate([way.rows for way in ways]) if ways else np.empty(0, dtype=int)
    sense = np.repeat([way.sense for way in ways], [len(way.rows) for way in ways])
    angle = history.hinge_angle(part)[rows]
    summed, lines = np.zeros(len(rows)), {}
    for rod in model.rods:
        held = any(h.to is part and h.rod is rod for h in model.supports)
        touches = any(getattr(term, "part", None) is part and rod in term.rods for term in model.contacts)
        if not (held or touches):
            continue
        factor = given[rod.name].uncertainty if rod.name in given else drive.uncertainty
        resists = np.maximum(sense * rod_torque(history, part, rod)[rows], 0.0)
        summed += factor * resists
        lines[rod.name] = float(resists.max(initial=0.0)), float(factor)
    for line in drive.lines:
        if line.torque is not None:
            summed += line.uncertainty * line.torque
            lines[line.name] = float(line.torque), float(line.uncertainty)
    required, available = drive.motorisation * summed, drive.available(angle)
    margin = np.divide(available, required, out=np.full(len(rows), np.inf), where=required > 0) - 1.0
    return Margins(rows, sense, angle, required, available, margin, lines)


def describe_drive(history: History, drive: Drive) -> dict[str, Any]:
    """Verdict on a drive: its smallest margin, where it is, and the lines of the budget; JSON values."""
    found = margins(history, drive)
    lines = {name: {"largest": value, "uncertainty": factor} for name, (value, factor) in found.lines.items()}
    said: dict[str, Any] = {"motorisation": drive.motorisation, "factors": STATUS, "lines": lines}
    if history.status != "converged" or not len(found.rows) or np.isnan(found.margin).any():
        reason = (
            "the run stopped early"
            if history.status != "converged"
            else "the hinge does not turn, or its torque is no number"
        )
        if len(found.rows) and np.isnan(found.margin).any():
            reason = "the table of the drive does not cover the stroke"
        return said | {"verdict": "UNKNOWN", "reason": reason}
    k = int(np.argmin(found.margin))
    first = found.sense[0]
    where = {
        "angle_deg": float(np.degrees(found.angle[k])),
        "t": float(history.t[found.rows[k]]),
        "way": "out" if found.sense[k] == first else "back",
    }
    least = float(found.margin[k])
    return said | {
        "verdict": "SAFE" if least >= 0.0 else "UNSAFE",
        "margin": {"value": least if np.isfinite(least) else None, **where},
        "required": float(found.required[k]),
        "available": float(found.available[k]),
    }


def joint_model(history: History, part: Part | str) -> dict[str, Any]:
    """Reduced model of the torque of one hinge: linear, and as a table, each with its residual; SI units, JSON values."""
    ways = strokes(history, part)
    if not ways:
        return {}
    angle, torque = (np.concatenate([getattr(way, key) for way in ways]) for key in ("angle", "torque"))
    sense = np.repeat([way.sense for way in ways], [len(way.angle) for way in ways])
    weight = np.sqrt(np.concatenate([_widths(np.abs(way.angle - way.angle[0])) for way in ways]))
    columns = {"stiffness": angle, "preload": np.ones_like(angle)}
    if len(set(sense)) == 2:
        columns["coulomb"] = sense.astype(float)
    if history.dynamic:
        rate = np.array([_hinge_rate(history, part, row) for row in np.concatenate([way.rows for way in ways])])
        known = np.stack([*columns.values()], axis=1)
        left = rate - known @ np.linalg.lstsq(known, rate, rcond=None)[0]
        if np.linalg.norm(left) > 1e-3 * np.linalg.norm(rate):  # else it cannot be told from the others
            columns["viscous"] = rate
    matrix = np.stack([*columns.values()], axis=1)
    scale = np.abs(matrix).max(axis=0)
    found = np.linalg.lstsq(matrix / scale * weight[:, None], torque * weight, rcond=None)[0] / scale
    peak = float(np.abs(torque).max())
    linear = dict(zip(columns, found.tolist(), strict=True))
    linear |= {"residual": _residual(torque - matrix @ found, weight, peak)}
    table, mean, half = _table(ways)
    told = np.interp(angle, table["angle"], mean)
    if half is not None:
        told += np.where(sense == ways[0].sense, 1.0, -1.0) * np.interp(angle, table["angle"], half)
    table |= {"residual": _residual(torque - told, weight, peak)}
    good = linear["residual"]["largest"] <= LINEAR * peak
    return {
        "recommended": "linear" if good else "table",
        "first_sense": ways[0].sense,
        "largest_torque": peak,
        "linear": linear,
        "table": table,
    }


def turns_back(history: History) -> bool:
    """True if a hinge goes out and back."""
    return any({1, -1} <= set(history.hinge_sense(part)) for part in hinged_parts(history))


def write_joint_models(history: History, path: str | os.PathLike[str]) -> None:
    """JSON of the reduced model of each hinge that turns."""
    models = {part.name: joint_model(history, part) for part in hinged_parts(history)}
    about = (
        "torque [N m] that a drive must supply about the hinge axis against the rods, over the angle [rad]. linear: "
        "stiffness * angle + preload + coulomb * sense of turning (1, -1) + viscous * rate [rad/s]. table: mean, plus "
        "half_band in the first sense, minus half_band in the other. residual: from all stations of the run"
    )
    write_json({"about": about, "joints": {name: model for name, model in models.items() if model}}, path)


def write_drives(history: History, path: str | os.PathLike[str], drives: Sequence[Drive]) -> None:
    """CSV of the torque [N m] that each drive must have and has at each state of each stroke, in the sense of the motion,
    empty where its table says nothing, and the margin, also empty where nothing resists."""
    rows: list[list[Any]] = []
    for drive in drives:
        m = margins(history, drive)
        for k, row in enumerate(m.rows):
            known = (float(x[k]) if np.isfinite(x[k]) else "" for x in (m.available, m.margin))
            angle = float(np.degrees(m.angle[k]))
            rows.append([history.order[row], drive.part.name, angle, int(m.sense[k]), m.required[k], *known])
    names = ["part", "angle_deg", "sense", "required", "available", "margin"]
    write_csv(path, ["station" if history.path else "time", *names], rows)


def _table(ways: list[Stroke]) -> tuple[dict[str, Any], np.ndarray, np.ndarray | None]:
    """Mean of both ways and half the band at even angles; outside the way back the way out alone."""
    out = ways[0]
    back = next((way for way in ways if way.sense != out.sense), None)
    angles = np.linspace(out.angle.min(), out.angle.max(), ROWS)
    there = out.curve()(angles)
    if back is None:
        return {"angle": angles.tolist(), "mean": there.tolist()}, there, None
    inside = np.clip(angles, back.angle.min(), back.angle.max())
    half = np.where(inside == angles, 0.5 * (there - back.curve()(inside)), 0.0)
    mean = there - half
    return {"angle": angles.tolist(), "mean": mean.tolist(), "half_band": half.tolist()}, mean, half


def _widths(x: np.ndarray) -> np.ndarray:
    """What each of some increasing numbers stands for: trapezoidal weights."""
    return 0.5 * (np.append(np.diff(x), 0.0) + np.append(0.0, np.diff(x)))


def _residual(left: np.ndarray, weight: np.ndarray, peak: float) -> dict[str, float]:
    mean = float(np.sqrt((left**2 * weight**2).sum() / max((weight**2).sum(), 1e-300)))
    largest = float(np.abs(left).max())
    return {"largest": largest, "rms": mean, "relative": largest / max(peak, 1e-300)}


def _hinge_rate(history: History, part: Part | str, row: int) -> float:
    """Rate of a hinge [rad/s] at one state."""
    hinge: Hinge = history.part(part).motion  # type: ignore[assignment]
    return float(hinge.schedule.rates(float(history.stroke_t[row]), before=row > 0)[0])
