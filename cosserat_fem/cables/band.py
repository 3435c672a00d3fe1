"""What does it matter whether strands slip or stick? The peaks of both runs, side by side.

Rule: reads two summaries of one scene; a peak is what has a `value`. A name of a peak in a summary is its name in the
band: `reactions.fixed end.largest_force.value` becomes `band.reactions.fixed end.largest_force.slip` and `.stick`.
"""

from __future__ import annotations

from typing import Any

from .buildup import ENDS

FOLDER = "stick"  # of the second run, in the folder of the first
LEFT_OUT = ("discretisation", "physics", "versions", "seconds", "counters", "band")


def compare_ends(slip: dict[str, Any], stick: dict[str, Any]) -> dict[str, Any]:
    """Peaks of two summaries: nested like they are, with {"slip": value, "stick": value} for each peak that both have."""
    out: dict[str, Any] = {}
    for key, first in slip.items():
        second = stick.get(key)
        if key in LEFT_OUT or not isinstance(first, dict) or not isinstance(second, dict):
            continue
        if _is_number(first.get("value")) and _is_number(second.get("value")):
            out[key] = dict(zip(ENDS, (first["value"], second["value"]), strict=True))
        elif inner := compare_ends(first, second):
            out[key] = inner
    return out


def verdicts(summary: dict[str, Any]) -> dict[str, str]:
    """Status of each check and each drive of a summary."""
    found = {name: check["status"] for name, check in summary.get("checks", {}).items()}
    hinges = summary.get("hinges", {}).items()
    return found | {f"drive of {name}": hinge["drive"]["verdict"] for name, hinge in hinges if "drive" in hinge}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
