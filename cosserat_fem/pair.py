"""What does gravity do? One scene run twice, with weight and without, and both side by side.

Rule: two whole runs, each in a folder of its own beneath one, as `run` makes them; the comparison is made from the folders.
"""

from __future__ import annotations

import copy
import os
import pathlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from .errors import SceneError
from .overlay import Apart, run_curves, write_overlay
from .run import Outcome, run_scene
from .scene import Scene, build_scene

WITH, WITHOUT, BESIDE = "with_gravity", "without_gravity", "overlay"


@dataclass(frozen=True, eq=False)
class Pair:
    """Outcomes of both runs, and how far they are apart; nothing if one of them left no results."""

    outcomes: dict[str, Outcome]
    apart: list[Apart]


def with_and_without(scene: Scene, gravity: Sequence[float] | None = None) -> dict[str, Scene]:
    """The scene with its own gravity, or the one given (3,) [m/s^2], and without. SceneError if there is none."""
    data = scene.source.data
    if gravity is None and "gravity" not in data:
        raise SceneError(f"{scene.source.path}: has no [gravity]; give one: --gravity 0 0 -9.81.")
    heavy, light = copy.deepcopy(data), copy.deepcopy(data)
    if gravity is not None:
        heavy["gravity"] = {"acceleration": [float(g) for g in gravity]}
    light.pop("gravity", None)
    return {name: build_scene(replace(scene.source, data=d)) for name, d in ((WITH, heavy), (WITHOUT, light))}


def run_pair(
    scene: Scene,
    out: str | os.PathLike[str] | None = None,
    *,
    gravity: Sequence[float] | None = None,
    force: bool = False,
    progress: Callable[[int, int], bool | None] | None = None,
) -> Pair:
    """Run a scene with gravity and without, into two folders beneath `out`, and compare them in a third.

    Raises
    ------
    SceneError
        There is no gravity, or a folder cannot be used.
    """
    out = pathlib.Path(out if out is not None else pathlib.Path("out") / f"{scene.source.path.stem}_pair")
    scenes = with_and_without(scene, gravity)
    outcomes = {name: run_scene(one, out / name, force=force, progress=progress) for name, one in scenes.items()}
    if not all("reactions.csv" in outcome.written for outcome in outcomes.values()):
        return Pair(outcomes, [])
    return Pair(outcomes, write_overlay(run_curves(out / WITH), run_curves(out / WITHOUT), out / BESIDE))
