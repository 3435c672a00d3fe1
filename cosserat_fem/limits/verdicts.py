"""Is it acceptable? What a history says held against limits: a margin everywhere, its worst place and time, a verdict.

Rule: a margin is what is left of what is allowed, as a part of it: 1 - value / limit where a quantity must stay below its
limit. Where it must stay above, value / limit - 1 below the limit and 1 - limit / value above, both counted from the
centreline (a bend's inner radius plus half the cable, a gap plus the cable's radius), so that it is at most 1 as well. Zero
is the limit; what is negative is not allowed.

SAFE is said only of what is known. A check is UNKNOWN, which counts as unsafe, if the run stopped early, the quantity has no
value, an equilibrium is unstable, the estimated discretisation error is larger than the margin, or the stations are so far
apart that the margin may have been used up between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from ..accuracy.estimate import add_errors
from ..equilibrium.march import Watch
from ..history import History
from ..mechanism import Hinge, Part
from .allowed import Check, Limit, checks_of
from .gaps import clearance_along, closest, roughly
from .quantities import Along, at_nodes
from .rules import bend_rule

Status = Literal["SAFE", "UNSAFE", "UNKNOWN"]
PLENTY = 0.5  # margin beyond which nothing is looked at more closely between stations
TOUCH = 0.01  # radii: surfaces that are nearer than this touch
BENT = ("bend_radius", "strain", "twist", "reaction_moment")  # what a string does not have


@dataclass(frozen=True, eq=False)
class Course:
    """A checked quantity over a run.

    value, margin : (T,) worst of each state, NaN where it has none; s : (T,) [m] where on the rod, or None
    nodes : (N,) [m] and along : (T, N) margins at the nodes of the rod, or None if it is no quantity along a rod
    angle : (T,) [deg] of the hinge it is of, or of the one that turns; None if there is not just one
    """

    value: np.ndarray
    margin: np.ndarray
    s: np.ndarray | None = None
    nodes: np.ndarray | None = None
    along: np.ndarray | None = None
    angle: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one check.

    status : "SAFE", "UNSAFE" or "UNKNOWN"; reason : why, if it is not SAFE
    value, limit, unit : worst value and its limit; margin : signed, as a part of what is allowed (see the room)
    s [m], t [s], station, angle [deg], factor of loads : where and when it is; None if there is no such thing
    error : estimated discretisation error of the margin, None if it is not known
    course : the quantity and its margin over the run
    """

    check: Check
    status: Status
    reason: str
    value: float
    limit: float
    margin: float
    station: int
    t: float
    s: float | None
    angle: float | None
    factor: float | None
    error: float | None
    course: Course = field(repr=False)

    @property
    def name(self) -> str:
        return self.check.name

    @property
    def unit(self) -> str:
        return self.check.quantity.unit

    def told(self) -> dict[str, Any]:
        """For a summary: "worst" value and "margin" with their place and time, the limit and the verdict."""
        at: dict[str, Any] = {} if self.s is None else {"s": self.s}
        at |= {"t": self.t, "station": self.station}
        at |= {} if self.angle is None else {"angle_deg": self.angle}
        at |= {} if self.factor is None else {"factor": self.factor}
        limit, known = self.check.limit, np.isfinite(self.margin)
        rule = None if limit.rule is None else bend_rule(limit.rule)
        return {
            "status": self.status,
            "reason": self.reason,
            "quantity": limit.quantity,
            **self.check.on,
            **({"measured": limit.measured} if limit.quantity == "bend_radius" else {}),
            **({"rule": rule.name, "clause": rule.clause, "rule_status": rule.status} if rule is not None else {}),
            "sense": "at least" if self.check.quantity.least else "at most",
            "limit": self.limit,
            "unit": self.unit,
            "worst": {"value": self.value if np.isfinite(self.value) else None, **at},
            "margin": {"value": self.margin if known else None, **at},
        }


def check(
    history: History, limits: Iterable[Limit], parts: Sequence[Part] = (), *, estimate: bool = True
) -> list[Verdict]:
    """Judge a history by limits.

    Parameters
    ----------
    parts : list of Part
        To keep clear of, besides those of the model.
    estimate : bool
        Estimate the discretisation error of each margin; without it a verdict is given as if there were none.

    Raises
    ------
    ValueError
        A name is not known, there is nothing that a limit speaks of, or two checks have one name.
    """
    checks = checks_of(limits, history.model, parts)
    verdicts = assess(history, checks, parts)
    if not estimate:
        return verdicts
    said = {"rods": {rod.name: {} for rod in history.model.rods}, "checks": {v.name: v.told() for v in verdicts}}
    add_errors(said, history, lambda found, near: found_at(verdicts, history, found, parts))
    return judged(verdicts, history, said)


def tell(verdicts: Iterable[Verdict]) -> dict[str, Any]:
    """The part of a summary that checks fill."""
    return {"checks": {verdict.name: verdict.told() for verdict in verdicts}}


def overall(statuses: Iterable[str]) -> Status:
    """UNSAFE if any is, else UNKNOWN if any is."""
    found = set(statuses)
    return "UNSAFE" if "UNSAFE" in found else "UNKNOWN" if "UNKNOWN" in found else "SAFE"


def assess(history: History, checks: Sequence[Check], parts: Sequence[Part] = ()) -> list[Verdict]:
    """Verdicts as if there were no discretisation error; see `judged`."""
    measured = dict.fromkeys(check.rod.name for check in checks if check.quantity.on == "rod" and check.rod is not None)
    rods = {name: Along(history, name) for name in measured}
    turning = _turning(history, parts)
    out = []
    for check in checks:
        course, limit = _course(history, check, rods)
        part = check.part if check.part is not None else turning
        if part is not None:
            angle = np.degrees([part.motion.angle_at(record.state.t) for record in history.records])  # type: ignore[union-attr]
            course = replace(course, angle=angle)
        k = int(np.nanargmin(course.margin)) if np.isfinite(course.margin).any() else 0
        s = None if course.s is None or not np.isfinite(course.s[k]) else float(course.s[k])
        verdict = Verdict(
            check, "SAFE", "", float(course.value[k]), limit, float(course.margin[k]), k, float(history.t[k]), s,
            None if course.angle is None else float(course.angle[k]), history.records[k].factor, None, course,
        )  # fmt: skip
        out.append(_judged(verdict, history, None))
    return out


def found_at(verdicts: Sequence[Verdict], history: History, one: History, parts: Sequence[Part] = ()) -> dict[str, Any]:
    """What a summary would say of the checks that are worst at the state of `history` which `one` is a better one of."""
    t = one.records[0].state.t
    here = [verdict.check for verdict in verdicts if history.records[verdict.station].state.t == t]
    return tell(assess(one, here, parts))


def judged(verdicts: Sequence[Verdict], history: History, said: dict[str, Any]) -> list[Verdict]:
    """Verdicts with the estimated errors that `add_errors` wrote into `said`, which gets them too."""
    out = []
    for verdict in verdicts:
        told = said["checks"][verdict.name]
        error = told["margin"].get("error")
        new = _judged(replace(verdict, error=error), history, np.inf if error is None else error)
        told |= {"status": new.status, "reason": new.reason}
        out.append(new)
    return out


def watches(checks: Sequence[Check]) -> list[Watch]:
    """The margins of checks as numbers that a quasi-static travel resolves between its stations, up to `PLENTY`: what has
    more left needs no better answer."""
    looked = _Looked()
    return [Watch(f"margin: {check.name}", partial(looked, check=check), "smallest", least=1.0) for check in checks]


class _Looked:
    """Smallest margins of states that are looked at one by one; what several checks need of a rod is found once."""

    def __init__(self) -> None:
        self.history: History | None = None
        self.rods: dict[str, Along] = {}

    def __call__(self, history: History, check: Check) -> np.ndarray:
        if history is not self.history:
            self.history, self.rods = history, {}
        if check.quantity.on == "rod" and check.rod is not None and check.rod.name not in self.rods:
            self.rods[check.rod.name] = Along(history, check.rod.name)
        course, _ = _course(history, check, self.rods, whole=False)
        return np.fmin(course.margin, PLENTY)


def _turning(history: History, parts: Sequence[Part]) -> Part | None:
    """The one part that turns on a hinge during the run, if there is just one."""
    every = [*history.model.parts, *(part for part in parts if part not in history.model.parts)]
    hinged = [part for part in every if isinstance(part.motion, Hinge)]
    times = {history.records[k].state.t for k in np.linspace(0, len(history) - 1, 21).astype(int)}
    moving = [part for part in hinged if len({part.motion.angle_at(t) for t in times}) > 1]  # type: ignore[union-attr]
    found = moving or hinged
    return found[0] if len(found) == 1 else None


def _course(history: History, check: Check, rods: dict[str, Along], *, whole: bool = True) -> tuple[Course, float]:
    """A checked quantity over a run, and its limit; not whole: without maps, and clearances roughly."""
    kind, limit = check.limit.quantity, float(check.limit.value or 0.0)
    if history.model.theory == "string" and kind in BENT:
        nothing = np.full(len(history), np.nan)
        return Course(nothing, nothing), limit
    if kind == "clearance":
        return _clearance(history, check, limit, whole), limit
    if check.rod is not None:
        return _along(rods[check.rod.name], check)
    if kind == "hinge_torque":
        value = np.abs(history.hinge_torque(str(check.part and check.part.name)))
    else:
        load = history.reaction(str(check.support))
        value = np.linalg.norm(load[:, :3] if kind == "reaction_force" else load[:, 3:], axis=1)
    return Course(value, 1.0 - value / limit), limit


def _along(rod: Along, check: Check) -> tuple[Course, float]:
    """A quantity of each section of a rod."""
    kind, limit = check.limit.quantity, check.limit.of(rod.rod)
    least = check.quantity.least
    if kind == "bend_radius":
        reach = rod.reach if check.limit.measured == "inside" else np.zeros_like(rod.radius)
        value, margin = rod.radius - reach, least_margin(rod.radius, limit + reach)
    else:
        value = {
            "tension": lambda: np.maximum(rod.axial, 0.0),
            "compression": lambda: np.maximum(-rod.axial, 0.0),
            "strain": lambda: rod.fibre_strain,
            "twist": lambda: rod.twist,
        }[kind]()
        margin = 1.0 - value / limit
    value, margin = at_nodes(value, largest=not least), at_nodes(margin, largest=False)
    nodes = np.concatenate([rod.s[:, :-1].ravel(), rod.s[-1:, -1]])
    k, t = np.argmin(margin, axis=1), np.arange(len(margin))
    return Course(value[t, k], margin[t, k], nodes[k], nodes, margin), limit


def _clearance(history: History, check: Check, limit: float, whole: bool) -> Course:
    """Of a rod from a part or another rod: exact for each state, at the nodes for the map; or roughly, without a map."""
    rod, other = check.rod, check.other
    find = closest if whole else roughly
    d, s = find(history, rod, other, leave_out=check.left_out)  # type: ignore[arg-type]
    nodes = history.nodes(rod)  # type: ignore[arg-type]
    radius = rod.radius_at(nodes)  # type: ignore[union-attr]
    known = np.isfinite(d)
    value = np.where(known, d, np.nan)
    at = np.interp(np.where(known, s, 0.0), nodes, radius)
    touches = limit == 0.0 and _in_contact(history, check)  # what touches overlaps by what contact does not resolve
    value = np.where((value < 0) & (value > -TOUCH * at), 0.0, value) if touches else value
    margin = least_margin(value + at, limit + at)
    if not whole:
        return Course(value, margin, s)
    along = clearance_along(history, rod, other)  # type: ignore[arg-type]
    for a, b in check.left_out:
        along[:, (nodes > a) & (nodes < b)] = np.nan
    along = np.where((along < 0) & (along > -TOUCH * radius), 0.0, along) if touches else along
    margins = least_margin(along + radius, limit + radius)
    nearest = np.argmin(np.abs(nodes - np.where(known, s, 0.0)[:, None]), axis=1)
    t = np.flatnonzero(known)
    margins[t, nearest[t]] = np.fmin(margins[t, nearest[t]], margin[t])  # what lies between nodes shows at the next one
    return Course(value, margin, s, nodes, margins)


def least_margin(value: np.ndarray, limit: np.ndarray | float) -> np.ndarray:
    """Margin of a quantity that must stay above its limit, both greater than 0 at the limit: from below to above 0, at
    most 1."""
    value, limit = np.broadcast_arrays(np.asarray(value, dtype=float), limit)
    below = value / limit - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(value > limit, 1.0 - limit / value, below)


def _judged(verdict: Verdict, history: History, error: float | None) -> Verdict:
    """A verdict with its status and reason; error of the margin: None if it does not count, infinite if not known."""
    low = verdict.margin
    if not np.isfinite(low):
        return replace(verdict, status="UNKNOWN", reason=_undefined(verdict.check, history))
    if low < 0:
        return replace(verdict, status="UNSAFE", reason=_touches(verdict, history))
    check = verdict.check
    kept_out = check.limit.quantity == "clearance" and verdict.limit == 0.0 and _in_contact(history, check)
    reasons = _doubts(verdict, history, between=not kept_out)
    if kept_out:
        error = None
    if error is not None and not np.isfinite(error):
        reasons.append("its discretisation error could not be estimated")
    elif error is not None and error > low:
        reasons.append(f"its discretisation error, {error:.2g}, is larger than the margin; take more elements")
    return replace(verdict, status="UNKNOWN" if reasons else "SAFE", reason="; ".join(reasons))


def _undefined(check: Check, history: History) -> str:
    if history.model.theory == "string":
        return "a string does not bend"
    return "nothing is left to look at" if check.limit.quantity == "clearance" else "it has no value"


def _in_contact(history: History, check: Check) -> bool:
    """True if a contact keeps a rod out of what its clearance is checked from."""
    for term in history.model.contacts:
        part = getattr(term, "part", None)
        if check.rod in term.rods and (part is check.other or (part is None and check.other in term.rods)):
            return True
    return False


def _touches(verdict: Verdict, history: History) -> str:
    """What is to be said of a rod that touches or overlaps something."""
    check = verdict.check
    if check.limit.quantity != "clearance" or check.rod is None:
        return ""
    name = getattr(check.other, "name", "")
    reach = TOUCH * float(check.rod.radius_at(np.array([verdict.s or 0.0]))[0])
    if _in_contact(history, check):
        near = np.flatnonzero(verdict.course.value < reach)
        return f"it touches {name} at t = {history.t[near[0]]:g} s" if len(near) else ""
    through = np.flatnonzero(verdict.course.value < 0)
    return f"from t = {history.t[through[0]]:g} s on {_through(check.rod.name, name)}" if len(through) else ""


def _through(rod: str, other: str) -> str:
    return (
        f"{rod} runs through {other}, as there is no [[contact]] between them: from there on forces and shapes are not "
        "those of a real cable"
    )


def clearances(verdicts: Sequence[Verdict]) -> dict[tuple[str, str], Verdict]:
    """Checks of clearance from parts that no contact keeps a rod out of, by the names of rod and part."""
    found: dict[tuple[str, str], Verdict] = {}
    for verdict in verdicts:
        rod, part = verdict.check.rod, verdict.check.other
        if rod is not None and isinstance(part, Part) and np.isfinite(verdict.value):
            found.setdefault((rod.name, part.name), verdict)
    return found


def warn_of_parts(verdicts: Sequence[Verdict], history: History, said: dict[str, Any]) -> None:
    """Warn of parts that a rod of a checked scene comes near to, or runs through, and that its run knows nothing of.

    said : a summary, with "clearances" from all parts that rods may not touch
    """
    checked = {(v.check.rod.name, v.check.other.name): v for v in verdicts if v.check.rod and v.check.other}
    for name, parts in said.get("clearances", {}).items():
        rod = history.rod(name)
        for part, near in parts.items():
            verdict = checked.get((name, part))
            value, t, s = near["value"], near["t"], None
            if verdict is not None:  # that one may leave more out
                value, t, s = verdict.value, verdict.t, verdict.s
            radius = float(rod.radius_at(np.array([0.0 if s is None else s]))[0])
            if value < 0:
                history.model.warn(f"t = {t:g} s: {_through(name, part)}.")
            elif value < radius:
                near_by = f"{name} comes within {1000 * value:.3g} mm of {part}"
                history.model.warn(f"t = {t:g} s: {near_by}, and there is no [[contact]] between them.")


def _doubts(verdict: Verdict, history: History, *, between: bool = True) -> list[str]:
    """Why a margin that is not negative may not be trusted."""
    out = []
    if history.status == "stopped":
        out.append(f"the run stopped early, after t = {history.t[-1]:g} s")
    missing = np.flatnonzero(~np.isfinite(verdict.course.margin))
    if len(missing):
        out.append(f"it has no value at t = {history.t[missing[0]]:g} s")
    if not history.path and not history.dynamic:
        unstable = [record.state.t for record in history.records if record.negative > 0]
        if unstable:
            out.append(f"the equilibrium at t = {unstable[0]:g} s is unstable: a real cable is elsewhere")
    k, lowest = _between(history.order, verdict.course.margin)
    if between and lowest < 0:
        out.append(
            f"stations are too far apart: between t = {history.t[k]:g} s and {history.t[k + 1]:g} s it may be used up; "
            "take more of them there"
        )
    return out


def _between(t: np.ndarray, margin: np.ndarray) -> tuple[int, float]:
    """The interval k, k + 1 in which a margin may fall lowest, and how far: to where the straight lines through the two
    stations before it and the two after it meet."""
    if len(t) < 4 or not np.isfinite(margin).all():
        return 0, np.inf
    slope = np.diff(margin) / np.diff(t)
    before, after, h = slope[:-2], slope[2:], np.diff(t)[1:-1]
    left, right = margin[1:-2], margin[2:-1]
    meets = (before < 0) & (after > 0)
    x = np.divide(right - left - after * h, before - after, out=np.zeros_like(h), where=meets)  # from the left station
    low = np.where(meets & (x > 0) & (x < h), left + before * x, np.inf)
    k = int(np.argmin(low))
    return k + 1, float(low[k])
