"""What did a run find? Results, checks, both ends of a band and hinges as chapters of a report.

Rule: reads a summary (and the joint models beside it) and writes HTML; a chapter of what the run does not have is empty.
Names of peaks in a summary are explained here, once.
"""

from __future__ import annotations

import json
import pathlib
from collections.abc import Iterator
from typing import Any

from .page import Raw, number, table, text

MARKS = {"SAFE": ("good", "✓"), "UNSAFE": ("bad", "✗"), "UNKNOWN": ("open", "?")}
STRAIGHT = 1e4  # m; a bend radius above is none


def judgements(summary: dict[str, Any]) -> dict[str, tuple[str, float | None]]:
    """Status and margin of all that was judged: checks and drives, at both ends of a band."""
    found = {}
    for name, check in summary.get("checks", {}).items():
        found[name] = check.get("status", "UNKNOWN"), _value(check.get("margin"))
    for name, hinge in summary.get("hinges", {}).items():
        if "drive" in hinge:
            found[f"drive of {name}"] = hinge["drive"]["verdict"], _value(hinge["drive"].get("margin"))
    ends = summary.get("band", {}).get("verdicts", {})
    return found | {
        f"{name}, with {end} strands": (said, None) for end, all_ in ends.items() for name, said in all_.items()
    }


def count(judged: dict[str, tuple[str, float | None]]) -> str:
    """How many are safe, and what has the least margin."""
    n = {status: sum(found == status for found, _ in judged.values()) for status in MARKS}
    many = "checks" if len(judged) > 1 else "check"
    said = f"{len(judged)} {many}: {n['SAFE']} safe, {n['UNSAFE']} violated, {n['UNKNOWN']} unknown."
    margins = {name: margin for name, (_, margin) in judged.items() if margin is not None}
    if margins:
        least = min(margins, key=lambda name: margins[name])
        said += f" Least margin: {least}, {_percent(margins[least])}."
    return said


def _value(entry: Any) -> float | None:
    return entry.get("value") if isinstance(entry, dict) else None


def results(summary: dict[str, Any]) -> Iterator[str]:
    """Largest and smallest values of the run, with place, time and estimated error."""
    peaks = [(name, entry, unit) for name, entry, unit in _peaks(summary) if _value(entry) is not None]
    rows = [_row(*peak) for peak in peaks if not (peak[0].startswith("Twist") and _is_noise(peak[1]))]
    if rows:
        yield "<h2>Results</h2>"
        head = ("quantity", "value", "unit", "estimated error", "where and when")
        yield table(head, rows, numeric="wn.n")
        yield (
            '<p class="soft">Errors are those of the elements and time steps, not of the data. A value that is not larger '
            "than its error is shown as 0.</p>"
        )


def _peaks(summary: dict[str, Any]) -> Iterator[tuple[str, Any, str]]:
    """Name, entry of the summary and unit of each value worth a line; lengths are in m and shown in mm."""
    for name, hinge in summary.get("hinges", {}).items():
        yield f"Torque at hinge {name}, peak", hinge.get("largest_torque"), "N m"
    for name, support in summary.get("reactions", {}).items():
        yield f"Force at {name}, peak", support.get("largest_force"), "N"
        yield f"Moment at {name}, peak", support.get("largest_moment"), "N m"
    for name, rod in summary.get("rods", {}).items():
        yield f"Bend radius of {name} (centreline), smallest", rod.get("smallest_bend_radius"), "mm"
        yield f"Stretch of {name}, largest", rod.get("largest_strain", {}).get("stretch"), "%"
        twist = rod.get("largest_strain", {}).get("twist [1/m]")
        yield f"Twist of {name}, largest", twist, "rad/m"
    for name, contact in summary.get("contacts", {}).items():
        yield f"Contact {name}: force, peak", contact.get("largest_force"), "N"
        yield f"Contact {name}: line force, peak", contact.get("largest_line_force"), "N/m"
        yield f"Contact {name}: gap, smallest", contact.get("smallest_gap"), "mm"
    for rod, parts in summary.get("clearances", {}).items():
        for part, entry in parts.items():
            yield f"Clearance of {rod} from {part}, smallest", entry, "mm"


def _is_noise(entry: Any) -> bool:
    """Whether a value is not larger than its error."""
    value, error = _value(entry), entry.get("error") if isinstance(entry, dict) else None
    return value is not None and error is not None and abs(value) <= error


def _percent(part: float) -> str:
    return f"{100 * part:+.1f} %".replace("-", "−")


def _row(name: str, entry: dict[str, Any], unit: str) -> tuple[Any, ...]:
    factor = {"mm": 1e3, "%": 1e2}.get(unit, 1.0)
    value, error = float(entry["value"]), entry.get("error")
    if unit == "mm" and value > STRAIGHT:
        return name, "straight", "", "", ""
    noise = _is_noise(entry)
    shown = number(0.0 if noise else factor * value)
    return name, shown, unit, number(factor * error, 2) if error is not None else "–", "" if noise else _place(entry)


def _place(entry: dict[str, Any]) -> str:
    said = []
    if entry.get("s") is not None:
        said.append(f"s = {number(1e3 * entry['s'])} mm")
    if entry.get("angle_deg") is not None:
        said.append(f"{number(float(entry['angle_deg']))}°")
    if entry.get("t") is not None:
        said.append(f"t = {number(float(entry['t']))} s")
    return Raw(", ".join(item.replace(" ", "\u00a0") for item in said))


def checks(summary: dict[str, Any]) -> Iterator[str]:
    limits = summary.get("checks", {})
    drives = {name: hinge["drive"] for name, hinge in summary.get("hinges", {}).items() if "drive" in hinge}
    if not limits and not drives:
        return
    rows = []
    for name, check in limits.items():
        unit, factor = ("mm", 1e3) if check.get("unit") == "m" else (check.get("unit", ""), 1.0)
        status = _status(check.get("status", ""))
        worst, margin = _value(check.get("worst")), _value(check.get("margin"))
        rows.append(
            (
                status, name, "–" if worst is None else number(factor * worst),
                f"{'≥' if check.get('sense') == 'at least' else '≤'} {number(factor * check['limit'])}", unit,
                "–" if margin is None else _percent(margin), _place(check.get("worst") or {}),
            )
        )  # fmt: skip
    for name, drive in drives.items():
        least = drive.get("margin") or {}
        left = "–" if _value(least) is None else _percent(least["value"])
        place = Raw(", ".join(filter(None, [f"way {least['way']}" if least else "", _place(least)])))
        needs = (number(drive.get("required")), f"≤ {number(drive.get('available'))}")
        rows.append((_status(drive["verdict"]), f"drive of {name}: torque needed", *needs, "N m", left, place))
    yield "<h2>Checks</h2>"
    head = ("verdict", "check", "worst", "limit", "unit", "margin", "where and when")
    yield table(head, rows, numeric=".wnn.n")
    notes = [f"drive of {name}: {drive['reason']}" for name, drive in drives.items() if drive.get("reason")]
    for name, drive in drives.items():
        lines = (
            f"{line} {number(said['largest'])} N m × {said['uncertainty']:g}" for line, said in drive["lines"].items()
        )
        factors = f"{drive['motorisation']:g} × ({' + '.join(lines) or '0'})"
        notes.append(Raw(f"drive of {text(name)}: needs at most {factors}; factors: {text(drive['factors'])}"))
    for name, check in limits.items():
        if check.get("reason"):
            notes.append(f"{name}: {check['reason']}")
        if check.get("rule"):
            notes.append(f"{name}: rule {check['rule']}, {check.get('clause', '')} ({check.get('rule_status', '')})")
    if notes:
        yield f"<ul>{''.join(f'<li>{text(note)}</li>' for note in notes)}</ul>"
    yield (
        '<p class="soft">A margin is the part that is left of what is allowed, of a drive what it has beyond what it needs; '
        "0 is the limit. What cannot be answered is unknown and counts as unsafe.</p>"
    )


def _status(status: str) -> Raw:
    kind, mark = MARKS.get(status, ("open", "?"))
    return Raw(f'<span class="{kind}">{mark} {text(status)}</span>')


def band(summary: dict[str, Any]) -> Iterator[str]:
    """Results at both ends of the stiffness."""
    both = summary.get("band")
    if not both:
        return
    rows = []
    noise = {name for name, entry, _ in _peaks(summary) if _is_noise(entry)}
    for name, ends, unit in _peaks(both):
        if isinstance(ends, dict) and name not in noise:
            factor = {"mm": 1e3, "%": 1e2}.get(unit, 1.0)
            values = (ends["slip"], ends["stick"])
            shown = ["straight" if unit == "mm" and v > STRAIGHT else number(factor * float(v)) for v in values]
            rows.append((name, *shown, unit))
    for name, check in both.get("checks", {}).items():
        if "margin" in check:
            rows.append((f"Margin of {name}", *(_percent(check["margin"][end]) for end in ("slip", "stick")), ""))
    yield "<h2>Slipping and sticking strands</h2>"
    yield (
        f"<p>The stiffness of {text(', '.join(both['of']))} is a band: its strands slide on each other or stick together. "
        "The run was made at both ends, and a real cable lies between. Values elsewhere on this page are those of slipping "
        "strands unless they say otherwise.</p>"
    )
    yield table(("quantity", "slipping", "sticking", "unit"), rows, numeric="wnn")


def hinges(folder: pathlib.Path, summary: dict[str, Any]) -> Iterator[str]:
    """Torque out and back, what lies between, work, and the reduced model of each hinge."""
    rows: list[tuple[Any, ...]] = []
    for name, hinge in summary.get("hinges", {}).items():
        for way, peaks in hinge.get("peaks", {}).items():
            rows += [_row(f"{name}, {way}: {which} torque", entry, "N m") for which, entry in peaks.items()]
        between = hinge.get("band", {})
        if _value(between.get("largest")) is not None:
            rows.append(_row(f"{name}: torque out minus back, largest", between["largest"], "N m"))
            rows.append((f"{name}: torque out minus back, mean", number(between["mean"]), "N m", "–", ""))
        for way, work in hinge.get("work", {}).items():
            said = {"cycle": "work of a cycle", "friction": "work taken by friction"}.get(way, f"work on the way {way}")
            rows.append((f"{name}: {said}", number(work), "J", "–", ""))
        if "last_torque" in hinge:
            rows.append((f"{name}: torque at the last state", number(hinge["last_torque"]), "N m", "–", ""))
    if rows:
        yield "<h2>Hinges</h2>"
        yield table(("quantity", "value", "unit", "estimated error", "where and when"), rows, numeric="wn.n")
    yield from _joints(folder / "joint_model.json")


def _joints(path: pathlib.Path) -> Iterator[str]:
    """Reduced models for simulations of the mechanism that leave the cable out."""
    if not path.is_file():
        return
    units = {"stiffness": "N m/rad", "preload": "N m", "coulomb": "N m", "viscous": "N m s/rad"}
    rows = []
    for name, model in json.loads(path.read_text(encoding="utf-8"))["joints"].items():
        shown = {key: value for key, value in model["linear"].items() if key in units}
        linear = Raw(", ".join(f"{key} {number(value)} {units[key]}" for key, value in shown.items()))
        for kind, said in (("linear", linear), ("table", f"{len(model['table']['angle'])} rows")):
            worst = model[kind]["residual"]["largest"]
            rows.append((name, kind, said, number(worst, 2), "recommended" if model["recommended"] == kind else ""))
    if rows:
        yield "<h3>Reduced joint model</h3>"
        yield table(("hinge", "kind", "torque", "largest residual [N m]", ""), rows, numeric="..wn")
        yield '<p class="soft">In joint_model.json, against angles in rad.</p>'
