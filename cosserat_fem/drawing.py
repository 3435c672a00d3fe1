"""How are pictures made without endangering a run?

Rule: never in the process that solves, because rendering without a usable OpenGL library ends the process it happens in.
"""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
from dataclasses import dataclass


@dataclass(frozen=True)
class Drawing:
    """What the drawing process made, or why it did not; `wrong` if an argument was."""

    paths: tuple[pathlib.Path, ...] = ()
    problem: str = ""
    wrong: bool = False


def draw(folder: pathlib.Path, *arguments: str) -> Drawing:
    """Make plots and pictures of a run folder in another process."""
    environment = dict(os.environ)
    if sys.platform.startswith("linux") and not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    command = [sys.executable, "-m", "cosserat_fem.view", str(folder), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode == 0:
        return Drawing(tuple(pathlib.Path(line) for line in done.stdout.splitlines()))
    lines = (done.stderr or done.stdout).strip().splitlines()
    said = lines[-1] if lines else f"exit code {done.returncode}"
    if done.returncode in (-signal.SIGINT, -signal.SIGTERM, -9):
        how = {-signal.SIGINT: "interrupted", -9: "killed, perhaps for lack of memory"}.get(done.returncode, "ended")
        return Drawing(problem=f"the drawing process was {how}. `cosserat-fem render {folder}` starts it again.")
    if done.returncode < 0:
        return Drawing(
            problem="pictures need a software OpenGL library, which this machine lacks (on Debian and Ubuntu: "
            "apt-get install libegl1 libgl1-mesa-dri). All results are complete; `cosserat-fem render` draws them later."
        )
    if done.returncode == 2:
        return Drawing(problem=said, wrong=True)
    return Drawing(problem=f"pictures could not be made: {said}")
