"""What does a run leave in its folder, and in which order?

Rule: every file is written whole or not at all; what could not be written is said, and the rest is kept.
"""

from __future__ import annotations

import json
import pathlib
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from typing import Any

from .accuracy.estimate import add_errors
from .cables.catalogue import sources
from .drive import describe_drive, turns_back, write_drives, write_joint_models
from .equilibrium.vibration import Modes, modes
from .errors import CosseratError, cause, out_of_memory
from .export import (
    replace_file,
    write_contact_loads,
    write_contacts,
    write_hinge_torque,
    write_history,
    write_ledger,
    write_modes,
    write_parts,
    write_path,
    write_reactions,
    write_shapes,
    write_steps,
)
from .folder import CHECKED, DRIVEN, PROGRAM, RESULTS, TOUCHING
from .history import History
from .limits.margins import margin_fields, write_checks, write_margins
from .limits.verdicts import Verdict, assess, clearances, found_at, judged, overall, tell, warn_of_parts
from .mechanism import Part
from .scene import Scene
from .summary import describe, describe_modes, describe_peaks, out_of_plane, told_clearance

PACKAGES = ("numpy", "scipy", "scikit-fem", "numba", "meshio", "pyvista", "vtk", "h5py", "pyamg")


@dataclass
class Phases:
    """Wall and CPU seconds by phase."""

    wall: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, name: str):
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.wall[name] = round(time.perf_counter() - wall, 4)
            self.cpu[name] = round(time.process_time() - cpu, 4)


@dataclass(frozen=True)
class Keep:
    """What a run writes besides scene.toml and summary.json; a study of many runs keeps little.

    results: names of the result files, default all. errors: estimate discretisation errors for the summary. clearances:
    measure distances from parts for it.
    """

    results: tuple[str, ...] | None = None
    errors: bool = True
    clearances: bool = True


ALL = Keep()


class ResultWriter:
    """Results of one run into its folder."""

    def __init__(self, scene: Scene, folder: pathlib.Path, phases: Phases, keep: Keep = ALL) -> None:
        self.scene, self.folder, self.phases, self.keep = scene, folder, phases, keep
        self.written: list[str] = []
        self.complete = False
        self.modes: Modes | None = None
        self.verdicts: dict[str, dict[str, Any]] = {}
        self.checks: list[Verdict] = []

    def text(self, name: str, text: str) -> None:
        replace_file(self.folder / name, lambda path: path.write_text(text, encoding="utf-8"))

    def results(self, history: History) -> str:
        """Write all results, or say why not."""
        try:
            with self.phases.measure("checks") if self.scene.checks else nullcontext():
                self.checks = assess(history, self.scene.checks, self.scene.parts)
        except KeyboardInterrupt:
            return "interrupted while limits were checked"
        except (MemoryError, CosseratError) as error:
            return f"limits could not be checked: {cause(error)}"
        writers: tuple[Callable[..., None], ...] = (
            write_reactions,
            write_hinge_torque,
            self._history,
            partial(write_parts, parts=self.scene.parts),
        )
        named = dict(zip(RESULTS, writers, strict=True))
        if history.model.contacts:
            named |= dict(zip(TOUCHING, (write_contacts, write_contact_loads), strict=True))
        if history.dynamic:
            named |= {"ledger.csv": write_ledger, "steps.csv": write_steps}
        if self.scene.drives or turns_back(history):
            driven = write_joint_models, partial(write_drives, drives=self.scene.drives)
            named |= dict(zip(DRIVEN[: 2 if self.scene.drives else 1], driven, strict=False))
        if history.path:
            named["path.csv"] = write_path
        if self.scene.checks:
            kept = (partial(write, verdicts=self.checks) for write in (write_checks, write_margins))
            named |= dict(zip(CHECKED, kept, strict=True))
        for name, write in named.items():
            if self.keep.results is not None and name not in self.keep.results:
                continue
            try:
                write(history, self.folder / name)
            except KeyboardInterrupt:
                return f"interrupted while {name} was written"
            except (OSError, MemoryError, CosseratError) as error:
                return f"{name} could not be written: {cause(error)}"
            self.written.append(name)
        reason = self._vibrations(history)
        self.complete = not reason
        return reason

    def _history(self, history: History, path: pathlib.Path) -> None:
        """The history for ParaView, with the margins of checks."""
        if not self.checks:
            write_history(history, path)
            return
        names = [verdict.name for verdict in self.checks]
        write_history(history, path, margin_fields(history, self.checks), {"checks": names})

    def _vibrations(self, history: History) -> str:
        """Find and write the vibrations about the last state if the scene asks for them, or say why not."""
        if self.scene.tables.solve.modes is None:
            return ""
        record, model = history.records[-1], history.model
        if record.factor is not None:
            model = model.with_factor(record.factor, self.scene.loads)
        try:
            self.modes = modes(model, record.state, self.scene.tables.solve.modes)
            for name, write in (("modes.csv", write_modes), ("modes.vtkhdf", write_shapes)):
                write(self.modes, self.folder / name)
                self.written.append(name)
        except KeyboardInterrupt:
            return "interrupted while vibrations were looked for"
        except (OSError, MemoryError, CosseratError) as error:
            return f"vibrations: {cause(error)}"
        return ""

    def summary(self, status: str, reason: str, history: History | None = None) -> None:
        data: dict[str, Any] = {
            "program": PROGRAM,
            "version": metadata.version(PROGRAM),
            "title": self.scene.title,
            "status": status,
            "reason": reason,
        }
        if history is not None and len(history):
            parts = self.scene.parts if self.keep.clearances else ()
            data |= describe(history, parts, clearances(self.checks))
            data |= tell(self.checks) if self.checks else {}
            if self.keep.errors:
                with self.phases.measure("estimate"):
                    try:
                        told = partial(self._described, history)
                        data["discretisation"] = add_errors(data, history, told, parts)
                    except MemoryError as error:
                        data["discretisation"] = {"not_found": out_of_memory(error)}
            for drive in self.scene.drives:
                self.verdicts[drive.part.name] = describe_drive(history, drive)
                data["hinges"][drive.part.name]["drive"] = self.verdicts[drive.part.name]
            if self.checks:
                self.checks = judged(self.checks, history, data)
                self._clearances(history, data)
                warn_of_parts(self.checks, history, data)
            if self.modes is not None:
                data["vibrations"] = describe_modes(self.modes)
            if self.scene.tables.solve.out_of_plane and self.scene.model.plane is not None:
                data["out_of_plane"] = out_of_plane(history)
        if self.scene.checks and status in ("converged", "stopped"):
            found = [check.status for check in self.checks] or ["UNKNOWN"]
            data["verdict"] = overall([*found, *(said["verdict"] for said in self.verdicts.values())])
        if self.scene.catalogue:
            data["catalogue"] = {name: sources(name) for name in self.scene.catalogue}
        data |= {
            "warnings": self.scene.model.warnings,
            "seconds": {"wall": self.phases.wall, "cpu": self.phases.cpu},
            "versions": {"python": platform.python_version(), **{p: metadata.version(p) for p in PACKAGES}},
            "platform": platform.platform(),
        }
        self.text("summary.json", json.dumps(data, indent=2) + "\n")

    def _described(self, history: History, found: History, parts: Sequence[Part] = ()) -> dict[str, Any]:
        """What is reported of a better state of a history, checks too."""
        more = found_at(self.checks, history, found, self.scene.parts) if self.checks else {}
        return describe_peaks(found, parts, clearances(self.checks)) | more

    def _clearances(self, history: History, data: dict[str, Any]) -> None:
        """Clearances that were checked among those that are reported anyway, unless the rod may touch there."""
        touched = {(rod.name, t.part.name) for t in history.model.contacts if hasattr(t, "part") for rod in t.rods}
        for (rod, part), verdict in clearances(self.checks).items():
            if (rod, part) not in touched:
                said = told_clearance(history.rod(rod), verdict.value, verdict.t, verdict.check.left_out)
                said["error"] = data["checks"][verdict.name]["worst"].get("error")
                data.setdefault("clearances", {}).setdefault(rod, {})[part] = said
