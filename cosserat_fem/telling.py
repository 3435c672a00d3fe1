"""What does a command say? Results in a few lines, faults, and how far it is.

Rule: results and progress go to standard output, faults to standard error. Nothing heavy is imported until it is needed.
"""

from __future__ import annotations

import logging
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any


def say(text: str = "") -> None:
    """To standard output."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def say_wrong(text: str) -> None:
    """To standard error."""
    sys.stderr.write(f"{text}\n")


def report_warnings() -> None:
    """Let the package's log show: warnings on standard error, one line each."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("warning: %(message)s"))
    log = logging.getLogger("cosserat_fem")
    log.handlers[:] = [handler]
    log.setLevel(logging.WARNING)
    log.propagate = False


def tell_faults(faults: list[str]) -> None:
    say_wrong("\n".join(faults))
    if len(faults) > 1:
        say_wrong(f"{len(faults)} faults.")


def tell_results(history: Any, tell: Callable[[str], None]) -> None:
    """A few lines that answer first questions."""
    import numpy as np

    from .drive import describe_torque
    from .export import hinged_parts

    for event in history.critical:
        where = (
            f"factor {event.value:.7g} of the loads"
            if history.records[0].factor is not None
            else f"t = {event.t:.7g} s"
        )
        tell(f"  {event.kind} point at {where}")
    for support in history.model.supports:
        load = history.reaction(support)
        force, moment = np.linalg.norm(load[:, :3], axis=1), np.linalg.norm(load[:, 3:], axis=1)
        i, j = int(np.argmax(force)), int(np.argmax(moment))
        at = partial(_station, history)
        tell(f"  {support.name}: force up to {force[i]:.6g} N{at(i)}, moment up to {moment[j]:.6g} N m{at(j)}")
    for part in hinged_parts(history):
        torque, angle = history.hinge_torque(part), np.degrees(history.hinge_angle(part))
        k = int(np.argmax(np.abs(torque)))
        tell(f"  hinge of {part.name}: torque up to {torque[k]:.6g} N m at {angle[k]:.4g} deg")
        _tell_loop(describe_torque(history, part), tell)
    for term in history.model.contacts:
        told = history.pressed(term.name)
        top = max(range(len(told)), key=lambda k: told[k].peak)
        if told[top].peak > 0:
            s = f"at s = {told[top].peak_s:.4g} m"
            tell(f"  contact {term.name}: line force up to {told[top].peak:.4g} N/m {s}, t = {history.t[top]:g} s")
        else:
            tell(f"  contact {term.name}: does not touch")


def _tell_loop(said: dict[str, Any], tell: Callable[[str], None]) -> None:
    """The torque of a hinge out and back."""
    if "back" not in said.get("peaks", {}):
        return
    for way in ("out", "back"):
        low, high = said["peaks"][way]["smallest"], said["peaks"][way]["largest"]
        tell(
            f"    {way}: {low['value']:.6g} N m at {low['angle_deg']:.4g} deg to {high['value']:.6g} N m at "
            f"{high['angle_deg']:.4g} deg"
        )
    if said["band"]["largest"] is not None:
        band = said["band"]["largest"]
        tell(f"    between out and back: up to {band['value']:.4g} N m at {band['angle_deg']:.4g} deg")
    if "cycle" in said["work"]:
        tell(f"    work of a cycle: {said['work']['cycle']:.4g} J")


def tell_drives(verdicts: dict[str, dict[str, Any]], tell: Callable[[str], None]) -> None:
    """What becomes of each drive."""
    for name, said in verdicts.items():
        if said["verdict"] == "UNKNOWN":
            tell(f"  drive of {name}: UNKNOWN, {said['reason']}")
            continue
        margin = said["margin"]
        value = "nothing resists" if margin["value"] is None else f"margin {margin['value']:.4g}"
        tell(
            f"  drive of {name}: {said['verdict']}, {value} at {margin['angle_deg']:.4g} deg on the way {margin['way']} "
            f"(needs {said['required']:.4g} N m, has {said['available']:.4g} N m)"
        )


def tell_checks(verdicts: Any, overall: str, tell: Callable[[str], None]) -> None:
    """One line for each check and one for all of them, and drives."""
    if not verdicts:
        return
    tell("Checks (margin: the part that is left of what is allowed)")
    for verdict in verdicts:
        least = "at least" if verdict.check.quantity.least else "at most"
        at = [] if verdict.s is None else [f"s = {verdict.s:.4g} m"]
        at += [f"t = {verdict.t:.6g} s"] if verdict.factor is None else [f"factor {verdict.factor:.6g}"]
        at += [] if verdict.angle is None else [f"{verdict.angle:.3f} deg"]
        limit = f"{least} {_with_unit(verdict.limit, verdict.unit)}{_by_rule(verdict)}"
        value = _with_unit(verdict.value, verdict.unit)
        tell(f"  {verdict.status:<8}{verdict.name}: {value}, {limit}; margin {verdict.margin:+.3f} at {', '.join(at)}")
        if verdict.reason:
            tell(f"          {verdict.reason}")
    known = {status: sum(v.status == status for v in verdicts) for status in ("UNSAFE", "UNKNOWN")}
    n = f"{len(verdicts)} check{'s' * (len(verdicts) != 1)}"
    tell(f"Verdict: {overall} ({n}, {known['UNSAFE']} violated, {known['UNKNOWN']} unknown)")


def _by_rule(verdict: Any) -> str:
    """The rule that a limit comes from, and a word of caution if it was not read where it stands."""
    from .limits.rules import bend_rule

    if verdict.check.limit.rule is None:
        return ""
    rule = bend_rule(verdict.check.limit.rule)
    return f" by {rule.name}" + (" (at second hand: look it up in the standard)" if rule.status == "recalled" else "")


def _with_unit(value: float, unit: str) -> str:
    """A number as one reads it: lengths in mm."""
    if unit == "m":
        return f"{1000 * value:.4g} mm"
    return f"{value:.4g}" if unit == "-" else f"{value:.4g} {unit}"


def _station(history: Any, k: int) -> str:
    """Where a value was found: a time, or a factor of loads."""
    if len(history) == 1:
        return ""
    record = history.records[k]
    return f" at t = {history.t[k]:g} s" if record.factor is None else f" at factor {record.factor:g}"


def tell_apart(rows: Any, a: str, b: str, *, tell: Callable[[str], None]) -> None:
    """Peaks of two sets of curves and their differences; components are in the table only."""
    shown = [row for row in rows if row.name[:3] not in ("Fx ", "Fy ", "Fz ", "Mx ", "My ", "Mz ")] or rows
    for row in shown:
        tell(
            f"  {row.name}: {row.peak_a:.6g} {row.unit} in {a}, {row.peak_b:.6g} {row.unit} in {b}; at most "
            f"{abs(row.largest):.4g} {row.unit} apart, at t = {row.t:g} s"
        )


class Progress:
    """A bar on a terminal, a line every few seconds elsewhere; `interrupted` after Ctrl-C.

    The first Ctrl-C asks for a stop after this station (or what else is counted), the second stops at once, as the first
    does if there is only one.
    """

    def __init__(self, total: int, quiet: bool, what: str = "stations") -> None:
        self.total, self.quiet, self.what = total, quiet, what
        self.interrupted, self._last = False, time.monotonic()
        self._bar: Any = None
        self._before: Any = None

    def __enter__(self) -> Progress:
        if not self.quiet and self.total > 1 and sys.stdout.isatty():
            from rich.progress import Progress as Bar

            self._bar = Bar(transient=True)
            self._task = self._bar.add_task("solving", total=self.total)
            self._bar.start()
        try:
            self._before = signal.signal(signal.SIGINT, self._interrupt)
        except ValueError:  # not in the main thread
            self._before = None
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _interrupt(self, *_: object) -> None:
        if self.interrupted or self.total == 1:
            self.interrupted = True
            raise KeyboardInterrupt
        self.interrupted = True

    def __call__(self, done: int, total: int) -> bool:
        if self._bar is not None:
            self._bar.update(self._task, completed=done, total=total)
        elif not self.quiet and time.monotonic() - self._last > 5:
            self._last = time.monotonic()
            say(f"  {done} of {total} {self.what}")
        return self.interrupted
