"""How is one case run? Its scene is built, solved and written into a folder that gets its name when all is there.

Rule: a case knows the text of the base scene and its own changed values, nothing of other cases, so it may run anywhere. A
scene that cannot be meant or solved is a result, with its reason; what the machine or the user ended is none and leaves no
folder.
"""

from __future__ import annotations

import json
import logging
import os
import pathlib
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ..errors import SceneError, one_line
from ..folder import RunFolder
from ..results import Keep
from ..run import run_scene
from ..scene import changed_scene
from ..scene.edit import changed
from ..scene.load import Source, parse, validate
from ..scene.written import identity
from .rows import CASE, CASES, is_done

log = logging.getLogger(__name__)
DIGITS = 16  # of the digest of a scene: enough to tell 1e5 cases apart with a chance of 1e-9 to be wrong
KEPT = ("hinge_torque.csv", "reactions.csv")  # result files of a case


@dataclass(frozen=True)
class Job:
    """What a process must know to run one case."""

    path: str
    text: str
    key: str
    changes: dict[str, Any]
    folder: str
    errors: bool
    clearances: bool


def key_of(source: Source, changes: dict[str, Any]) -> str:
    """Name of the folder of a case: first digits of the digest of its resolved scene."""
    varied = changed(source, changes)
    return identity(varied, validate(varied))[:DIGITS]


@lru_cache(maxsize=2)
def _source(path: str, text: str) -> Source:
    return parse(pathlib.Path(path), text)


def run_case(job: Job) -> str:
    """Run one case unless its folder is there; return why it has none after that, or nothing.

    Raises
    ------
    KeyboardInterrupt
        The user stopped it.
    """
    folder = pathlib.Path(job.folder)
    if is_done(folder, job.key):
        return ""
    place = folder / CASES / f".{job.key}-{os.getpid()}-{secrets.token_hex(4)}"
    try:
        with _quiet():
            problem = _write_case(job, place)
        if not problem:
            with suppress(OSError):  # another process was given the same case and was first
                os.rename(place, folder / CASES / job.key)
            problem = "" if is_done(folder, job.key) else f"{folder / CASES / job.key} could not be written"
        return problem
    except Exception as error:  # one case must not end the others
        log.debug("case %s", job.key, exc_info=True)
        return f"{type(error).__name__}: {one_line(error)}"
    finally:
        if place.exists():
            shutil.rmtree(place, ignore_errors=True)


def _write_case(job: Job, place: pathlib.Path) -> str:
    """Solve a case and write it into a folder; what the machine ended it with, or nothing."""
    place.parent.mkdir(parents=True, exist_ok=True)
    begin = time.process_time()
    try:
        scene = changed_scene(_source(job.path, job.text), job.changes)
    except SceneError as error:
        status, reason = "refused", str(error)
        place.mkdir()
    else:
        with RunFolder(place) as held:
            try:
                errors = job.errors or bool(scene.checks)  # a verdict needs them
                outcome = run_scene(scene, held, keep=Keep(KEPT, errors, job.clearances))
            except SceneError as error:
                status, reason = "refused", str(error)
            else:
                status, reason = "stopped" if outcome.reason else "converged", outcome.reason
                if outcome.by_chance:
                    if reason.startswith("interrupted"):
                        raise KeyboardInterrupt
                    return reason
    about = {
        "key": job.key,
        "status": status,
        "reason": reason,
        "changes": job.changes,
        "cpu_seconds": round(time.process_time() - begin, 4),
    }
    (place / CASE).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    return ""


@contextmanager
def _quiet() -> Iterator[None]:
    """Warnings of a case are in its summary, not on the terminal two hundred times."""
    package = logging.getLogger("cosserat_fem")
    level = package.level
    package.setLevel(logging.ERROR)
    try:
        yield
    finally:
        package.setLevel(level)


def clear_unfinished(folder: pathlib.Path) -> None:
    """Remove what killed processes left; only while no other sweep holds the folder."""
    for place in (folder / CASES).glob(".*-*-*"):
        shutil.rmtree(place, ignore_errors=True)
