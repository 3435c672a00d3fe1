"""What does one hand over? One HTML page of a run: verdict first, then results, charts, data, and how far to trust them.

Rule: reads the folder of the run only, so the page can be made again anywhere, and what the run does not have is not on it.
"""

from __future__ import annotations

import hashlib
import json
import pathlib
import sys
import time
from collections.abc import Iterator
from typing import Any

from ..cables.band import FOLDER as STICK
from ..errors import SceneError
from ..export import replace_file
from ..plots import figures
from .findings import MARKS, band, checks, count, hinges, judgements, results
from .page import Raw, chart, film, number, page, picture, table, text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

NAME = "report.html"
CAPTIONS = {
    "hinge_torque": "Torque that the drive must supply at each hinge to hold the cables, over the hinge's angle.",
    "ledger": "Energies and works over time.",
    "path": "Path of equilibria: factor of the loads over the largest displacement; unstable states are hollow.",
    "drive": "Torque that each drive must have, with all factors, and has, in the sense of the motion.",
    "margins": "Margin of every check over the run: the part that is left of what is allowed. Below 0 is not allowed.",
    "margin_map": "Margins along the rods over the run: 0 is the limit (black line), red is not allowed, a cross marks the "
    "worst place; grey where nothing is checked.",
}
PICTURES = {
    "stages.png": "The run in stages, the last one solid.",
    "moment.png": "The last state, coloured by the bending moment.",
}


def write_report(folder: pathlib.Path, *, with_film: bool = False) -> pathlib.Path:
    """Write `report.html` into the folder of a run and return its path.

    Raises
    ------
    SceneError
        The folder is not one of a run that has ended.
    """
    summary, scene = _read(folder)
    body = [
        *_head(folder, summary),
        *checks(summary),
        *results(summary),
        *band(summary),
        *_charts(folder, summary),
        *_pictures(folder, with_film),
        *hinges(folder, summary),
        *_cables(summary, scene),
        *_surroundings(scene),
        *_trust(summary),
        *_origin(folder, summary),
    ]
    whole = page(summary["title"], body)
    path = folder / NAME
    replace_file(path, lambda temporary: temporary.write_text(whole, encoding="utf-8"))
    return path


def _read(folder: pathlib.Path) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        scene = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
        status, _ = summary["status"], summary["title"]
    except FileNotFoundError as error:
        missing = pathlib.Path(error.filename).name
        what = "there is no such folder" if not folder.exists() else f"is not the folder of a run (no {missing})"
        raise SceneError(f"{folder}: {what}.") from None
    except OSError as error:
        raise SceneError(f"{folder}: cannot be read: {error.strerror}.") from None
    except (ValueError, KeyError, TypeError):
        raise SceneError(f"{folder}: its summary.json or scene.toml is not one of a run.") from None
    if status == "running":
        raise SceneError(f"{folder}: its run has not ended. Wait for it, or run the scene again.")
    return summary, scene


def _head(folder: pathlib.Path, summary: dict[str, Any]) -> Iterator[str]:
    """Title, verdict and the numbers that one asks for first."""
    when = time.strftime("%Y-%m-%d %H:%M", time.localtime((folder / "summary.json").stat().st_mtime))
    yield f"<h1>{text(summary['title'])}</h1>"
    yield f'<p class="soft">Report of a {summary["program"]} {summary["version"]} run that ended on {when}.</p>'
    judged = judgements(summary)
    statuses = {status for status, _ in judged.values()}
    verdict = next((worse for worse in ("UNSAFE", "UNKNOWN", "SAFE") if worse in statuses), None)
    if summary["status"] != "converged":
        kind, head = ("bad", "✗ UNSAFE, and stopped early") if verdict == "UNSAFE" else ("open", "Stopped early")
        said = f"What was found until then is below. Reason: {summary['reason']}"
    elif verdict is not None:
        kind, mark = MARKS[verdict]
        head, said = f"{mark} {verdict}", count(judged)
    else:
        kind, head = "none", "Run complete"
        said = "No limits were given, so nothing is judged. Limits go into the table [checks] of the scene."
    yield f'<div class="verdict {kind}"><strong>{head}</strong><p>{text(said)}</p></div>'
    if summary.get("warnings"):
        items = "".join(f"<li>{text(warning)}</li>" for warning in summary["warnings"])
        yield f"<h3>Warnings</h3><ul>{items}</ul>"


def _charts(folder: pathlib.Path, summary: dict[str, Any]) -> Iterator[str]:
    """Torque and reactions, margins, energies."""
    supports = list(summary.get("reactions", {}))
    made = {}
    try:
        made = figures(folder, single=True)
    except (OSError, ValueError, KeyError) as error:
        yield f'<p class="soft">No charts: {text(error)}</p>'
    if made:
        yield "<h2>Charts</h2>"
    for name, figure in made.items():
        caption = CAPTIONS.get(name, "")
        if name.startswith("reactions_"):
            support = supports[int(name.removeprefix("reactions_"))]
            caption = f"Force and moment of {support} on the rod, in space; dashed: their size."
        yield chart(figure, name, caption)


def _pictures(folder: pathlib.Path, with_film: bool) -> Iterator[str]:
    found = [(folder / "pictures" / name, caption) for name, caption in PICTURES.items()]
    shown = [picture(path, caption) for path, caption in found if path.is_file()]
    if with_film:
        films = [folder / "pictures" / f"film{suffix}" for suffix in (".mp4", ".webp")]
        shown += [film(path, "All states of the run.") for path in films if path.is_file()][:1]
    if shown:
        yield "<h2>Pictures</h2>"
        yield from shown


def _flat(entry: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of a nested entry of the summary."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            yield from _flat(value, f"{name}, {key}".lstrip(", ").replace("_", " "))
    elif isinstance(entry, list) and all(isinstance(x, int | float) for x in entry) and len(entry) <= 6:
        yield name, Raw(", ".join(number(x) for x in entry))
    elif isinstance(entry, bool | str):
        yield name, str(entry)
    elif isinstance(entry, int | float):
        yield name, number(entry)


def _cables(summary: dict[str, Any], scene: dict[str, Any]) -> Iterator[str]:
    """What the cables are."""
    rows: list[tuple[str, ...]] = []
    stiffness: list[tuple[str, ...]] = []
    drawn = {rod["name"]: rod for rod in scene.get("rod", [])}
    for name, rod in summary.get("rods", {}).items():
        named = drawn.get(name, {}).get("section", "")
        named = named if isinstance(named, str) else ", ".join(dict.fromkeys(entry[1] for entry in named))
        length = rod["length"]
        lengths = [number(1e3 * length[key]) for key in ("free", "drawn", "longest")]
        rows.append((name, named, *lengths, f"{rod['elements']} of degree {rod['order']}"))
        entries = rod.get("section", [])
        for entry in entries if len(entries) <= 4 else (entries[0], entries[-1]):
            factors = {"s": 1e3, "diameter": 1e3, "mass_per_length": 1e3, "EA": 1e-3}
            about = [None if entry[key] is None else factor * entry[key] for key, factor in factors.items()]
            bend = ", ".join(number(x) for x in dict.fromkeys(entry["EI"]))
            stiffness.append((name, *map(number, about), Raw(bend), number(entry["GJ"])))
    if not rows:
        return
    yield "<h2>Cables</h2>"
    head = ("cable", "section", "free length [mm]", "drawn [mm]", "longest [mm]", "elements")
    yield table(head, rows, numeric="..nnn.")
    if stiffness:
        columns = ("cable", "s [mm]", "diameter [mm]", "mass [g/m]", "EA [kN]", "EI [N m²]", "GJ [N m²]")
        yield table(columns, stiffness, numeric=".nnnnnn")
    for name, known in summary.get("catalogue", {}).items():
        said = f"{name}, {known['about']}: {known['source']}. Layers: {known['layers_source']}."
        yield f'<p class="soft">{text(said)} Stiffness is derived from the layers unless it was measured.</p>'


def _surroundings(scene: dict[str, Any]) -> Iterator[str]:
    """Supports, parts, loads and the solver's orders, as the scene file says them with all defaults."""
    rows = []
    for table_name in ("support", "part", "load", "damping", "drag", "electrostatic", "contact"):
        for k, entry in enumerate(scene.get(table_name, [])):
            name = entry.get("name") or f"{k + 1}"
            kind = entry.get("kind", "")
            rows.append((table_name, name, kind, _said(entry)))
    for table_name in ("gravity", "solve"):
        if table_name in scene:
            rows.append((table_name, "", scene[table_name].get("kind", ""), _said(scene[table_name])))
    if rows:
        yield "<h2>Scene</h2>"
        yield table(("table", "name", "kind", "says (SI)"), rows, numeric="...w")


def _said(entry: dict[str, Any]) -> str:
    return ", ".join(f"{key} {_plain(value)}" for key, value in entry.items() if key not in ("name", "kind"))


def _plain(value: Any) -> str:
    """A value of a scene in short."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return "(" + ", ".join(f"{key} {_plain(inner)}" for key, inner in value.items()) + ")"
    if isinstance(value, list):
        shown = [_plain(inner) for inner in value[:6]]
        return "[" + ", ".join(shown + (["..."] if len(value) > 6 else [])) + "]"
    if isinstance(value, str) and value.startswith("/"):
        return pathlib.Path(value).name
    return str(value)


def _trust(summary: dict[str, Any]) -> Iterator[str]:
    """How the solution went: iterations, residual, stability, estimated errors, energies."""
    counters, rows = summary.get("counters", {}), []
    if "stations" in summary:
        span = summary["stations"]
        rows.append(("states kept", f"{span['kept']}, from t = {span['first']:.6g} s to {span['last']:.6g} s"))
    if "stable" in summary:
        rows.append(("stability", summary["stable"]))
    if "worst_residual" in summary:
        rows.append(("largest residual of a state, relative", number(summary["worst_residual"], 2)))
    for key, value in counters.items():
        if isinstance(value, dict):
            value = ", ".join(f"{n} by {how}" for how, n in value.items())
        rows.append(({"linear": "linear systems"}.get(key, key.replace("_", " ")), value))
    physics = summary.get("physics", {})
    for key in ("unknowns", "theory", "rotation", "plane"):
        if physics.get(key):
            rows.append((key, physics[key]))
    if "chosen" in physics:
        rows.append(("chosen for the accuracy asked for", ", ".join(f"{n} {v}" for n, v in _flat(physics["chosen"]))))
    discretisation = summary.get("discretisation", {})
    for key, value in discretisation.items():
        rows.append((f"estimate of errors: {key.replace('_', ' ')}", _plain(value)))
    for name, seconds in summary.get("seconds", {}).get("wall", {}).items():
        rows.append((f"time to {name}", f"{seconds:.3g} s"))
    for name, seconds in physics.get("cpu_seconds", {}).items():
        rows.append((f"CPU time of {name}", f"{seconds:.3g} s"))
    yield "<h2>Solution</h2>"
    yield table(("quantity", "value"), rows, numeric=".w")
    yield from _ledger(summary)


def _ledger(summary: dict[str, Any]) -> Iterator[str]:
    """Energies and works at the end: of a run in time all of them, else what friction took."""
    motion = summary.get("in_time")
    if motion is not None:
        rows = [(name.replace("_", " "), number(value)) for name, value in motion["ledger"].items()]
        rows.append(("open, in parts of the largest", number(motion["ledger_gap"], 2)))
        yield table(("energy or work since the start", "J"), rows, caption="Ledger at the end of the run", numeric=".n")
        return
    rows = [
        (f"friction of {name}", number(float(contact["friction_work"])))
        for name, contact in summary.get("contacts", {}).items()
        if contact.get("friction_work") is not None
    ]
    if rows:
        yield table(("work taken", "J"), rows, caption="Work over the run", numeric=".n")


def _origin(folder: pathlib.Path, summary: dict[str, Any]) -> Iterator[str]:
    """Versions, the command, and the scene itself."""
    scene = (folder / "scene.toml").read_text(encoding="utf-8")
    digest = hashlib.sha256(scene.encode()).hexdigest()
    yield "<h2>Repeat this run</h2>"
    yield "<p>In the folder of this report:</p>"
    yield "<pre><code>cosserat-fem run scene.toml -o again\ncosserat-fem report .</code></pre>"
    yield f'<p class="soft">scene.toml has the SHA-256 digest {digest[:16]}…; meshes and curves are read where it says.</p>'
    versions = [f"{summary['program']} {summary['version']}"]
    versions += [f"{name} {version}" for name, version in summary.get("versions", {}).items()]
    yield f"<p>{text(', '.join(versions))}; {text(summary.get('platform', ''))}.</p>"
    yield f"<h3>scene.toml</h3><pre><code>{text(scene)}</code></pre>"
    if (folder / STICK / "summary.json").is_file():
        yield f"<p>The run with sticking strands is in the folder <code>{STICK}</code>; it can have a report of its own.</p>"
