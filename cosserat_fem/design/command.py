"""What does a design write, and what does it tell? Every trial, the best scene as TOML, and a run of that file.

Rule: the answer is proved by the file that is handed over: the best scene is written, read back and run by itself from its
own drawing, and what that run says is compared with the trial.
"""

from __future__ import annotations

import csv
import json
import pathlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import SceneError
from ..export import replace_file
from ..folder import PROGRAM, check_study, hold
from ..limits.verdicts import Verdict
from ..run import Outcome, run_scene
from ..scene import Scene, load_scene
from ..summary import flat
from .search import best, closest, front, search
from .trial import Trial, Trials

ABOUT, TRIALS, FRONT, SCENE, RUN = "design.json", "trials.csv", "tradeoff.csv", "best.toml", "best"
OURS = (TRIALS, FRONT, SCENE, RUN, "pictures")
ACTIVE = 10.0  # tolerances: a limit or end of a range this near is active
AGREES = 1e-5  # part by which the run of the best scene may differ from its trial


@dataclass(frozen=True)
class Design:
    """What a design left: its folder, the best trial or the one that breaks its limits least, and what to tell."""

    folder: pathlib.Path
    trials: tuple[Trial, ...]
    best: Trial | None
    lines: tuple[str, ...]
    complete: bool
    safe: bool = True  # the run of the best scene is, by the checks


def run_design(
    scene: Scene,
    out: pathlib.Path | None = None,
    *,
    progress: Callable[[int, int], bool | None] | None = None,
) -> Design:
    """Find the design that a scene's `[design]` asks for and write it into a folder.

    Parameters
    ----------
    out : folder, default `[design] folder`, else out/<name of the scene>_design
    progress : function (designs run, most designs) -> bool
        Called after each; return True to stop there.

    Raises
    ------
    SceneError
        The scene has no `[design]`, names results that its runs do not have, or the folder cannot be used.
    """
    trials = Trials(scene, progress)
    stem = pathlib.Path("out") / f"{scene.source.path.stem}_design"
    folder = (out or pathlib.Path(trials.design.folder or stem)).resolve()
    check_study(folder, ABOUT, OURS)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with hold(folder):
            return _in_folder(scene, trials, folder)
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r}: cannot be written: {error.strerror}.") from None


def _in_folder(scene: Scene, trials: Trials, folder: pathlib.Path) -> Design:
    """Search, then write all of it; also what was found when it was stopped."""
    begin = time.process_time()
    about: dict[str, Any] = {"program": PROGRAM, "title": scene.title, "scene": str(scene.source.path.resolve())}
    _json(folder / ABOUT, about | {"status": "running"})
    complete = search(trials)
    winner = best(trials)
    shown = winner or closest(trials)
    lines = (
        [] if complete else [f"stopped after {len(trials.done)} designs; [design] runs allows {trials.design.runs}."]
    )
    about |= {
        "status": "found"
        if winner is not None and complete
        else "stopped"
        if not complete
        else "no design keeps the limits",
        "minimise": trials.design.minimise,
        "variables": _variables(trials),
        "tradeoff": trials.design.tradeoff,
        "designs": len(trials.done),
        "iterations": trials.iterations,
        "cpu_seconds": round(time.process_time() - begin, 3),
    }
    if shown is not None:
        about["best"] = describe_trial(trials, shown)
        lines += _told(trials, shown, winner is not None)
        replace_file(folder / SCENE, lambda path: path.write_text(scene.changed(shown.changes).resolved(), "utf-8"))
        about["check"], more = _proved(trials, shown, folder)
        lines += more
    else:
        reason = trials.done[0].reason if trials.done else "none was run"
        lines.append(f"no design has an equilibrium all the way; the first: {reason}")
    _write_trials(trials, trials.done, folder / TRIALS)
    if trials.design.tradeoff is not None:
        _write_trials(trials, front(trials, *trials.design.tradeoff), folder / FRONT)
    _json(folder / ABOUT, about)
    safe = about.get("check", {}).get("verdict", "SAFE") == "SAFE"
    return Design(folder, tuple(trials.done), winner, tuple(lines), complete, safe)


def describe_trial(trials: Trials, trial: Trial) -> dict[str, Any]:
    """A trial in short: values, objective, margins, which limits and ends of ranges are active."""
    return {
        "number": trial.number,
        "values": trial.changes,
        "objective": trial.objective,
        "limits": [
            {"limit": str(limit), "value": trial.results.get(limit.result), "margin": margin}
            for limit, margin in zip(trials.limits, trial.margins, strict=True)
        ],
        "active": active(trials, trial),
        "warnings": list(trial.warnings),
    }


def active(trials: Trials, trial: Trial) -> list[str]:
    """Limits that hold a design where it is, and ends of ranges that do.

    A limit is active if the design would break it within a few tolerances: its margin is less than the change of that
    margin over so much of the range, as told by the trials nearby.
    """
    reach = ACTIVE * trials.design.tolerance
    found = []
    for k, limit in enumerate(trials.limits):
        others = [t for t in trials.done if t is not trial and t.margins]
        slopes = [abs(t.margins[k] - trial.margins[k]) / float(np.linalg.norm(t.u - trial.u)) for t in others]
        near = sorted(zip([float(np.linalg.norm(t.u - trial.u)) for t in others], slopes, strict=True))[:4]
        slope = max((slope for _, slope in near), default=1.0)
        if trial.margins[k] - trial.reserve <= reach * max(slope, 1e-3):
            found.append(str(limit))
    for entry, u in zip(trials.design.vary, trial.u, strict=True):
        for end, name in ((0.0, "lowest"), (1.0, "highest")):
            if abs(u - end) <= reach:
                found.append(f"{entry.path} at the {name} end of its range")
    return found


def _told(trials: Trials, trial: Trial, feasible: bool) -> list[str]:
    """The answer in lines."""
    lines = [] if feasible else ["no design keeps all limits; the one that breaks them least:"]
    for entry, value in zip(trials.design.vary, trials.x(trial.u), strict=True):
        unit = " (turned by, rad)" if entry.axis is not None else ""
        lines.append(f"{entry.path} = {value:.7g}{unit}")
    if trials.design.minimise not in trial.changes:
        lines.append(f"{trials.design.minimise} = {trial.objective:.6g}")
    for limit, margin in zip(trials.limits, trial.margins, strict=True):
        value = trial.results.get(limit.result)
        got = "none" if value is None else f"{value:.6g}"
        lines.append(f"{limit}: {got}, margin {100 * margin:+.3g} %")
    held = active(trials, trial)
    lines.append(f"active: {'; '.join(held) if held else 'nothing, the best lies inside'}")
    return lines


def _proved(trials: Trials, trial: Trial, folder: pathlib.Path) -> tuple[dict[str, Any], list[str]]:
    """Run the best scene from its file; largest difference from the trial in what the design names."""
    outcome = run_scene(load_scene(folder / SCENE), folder / RUN)
    summary = flat(json.loads((folder / RUN / "summary.json").read_text(encoding="utf-8")))
    names = dict.fromkeys([trials.design.minimise, *(limit.result for limit in trials.limits)])
    away = {
        name: abs(abs(float(summary[name])) - abs(trial.results[name])) / (abs(trial.results[name]) or 1.0)
        for name in names
        if name in summary and name in trial.results
    }
    worst = max(away.values(), default=0.0)
    said = {"folder": RUN, "reason": outcome.reason, "largest_difference": worst}
    if trials.scene.checks:
        said["verdict"] = outcome.verdict
    if outcome.reason:
        return said, [f"the run of {SCENE} stopped: {outcome.reason}"]
    doubts = [
        f"the run of {SCENE} says {v.status} of check {v.name!r}: {v.reason}" for v in _checks(outcome) if v.reason
    ]
    if doubts:
        return said, doubts
    if worst > AGREES:
        name = max(away, key=lambda name: away[name])
        return said, [
            f"the run of {SCENE} differs from the trial by {100 * worst:.2g} % in {name}: from its drawing it finds another "
            "state. Draw the route nearer to the cable's shape."
        ]
    return said, [f"the run of {SCENE} says the same to {worst:.1e}"]


def _checks(outcome: Outcome) -> list[Verdict]:
    """Verdicts of a run, at both ends of its stiffness."""
    return [*outcome.checks, *(outcome.sticking.checks if outcome.sticking is not None else ())]


def _write_trials(trials: Trials, rows: Sequence[Trial], path: pathlib.Path) -> None:
    """Write designs as CSV: values, objective, margins, limited and traded results, reason if they failed."""
    limits = trials.limits
    names = dict.fromkeys(
        [trials.design.minimise, *(limit.result for limit in limits), *(trials.design.tradeoff or ())]
    )
    variables = _variables(trials)
    results = [name for name in names if name not in variables]

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(
                ["design", *variables, *results, *(f"margin of {limit}" for limit in limits), "keeps", "reason"]
            )
            for trial in rows:
                found = [trial.results.get(name, "") for name in results]
                margins = trial.margins or [""] * len(limits)
                x = [float(value) for value in trials.x(trial.u)]
                writer.writerow([trial.number, *x, *found, *margins, str(trial.feasible).lower(), trial.reason])

    replace_file(path, write)


def _variables(trials: Trials) -> list[str]:
    """Names of the columns of the variables."""
    return [f"{entry.path} (turn)" if entry.axis is not None else entry.path for entry in trials.design.vary]


def _json(path: pathlib.Path, data: dict[str, Any]) -> None:
    text = json.dumps(data, indent=2) + "\n"
    replace_file(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
