"""A judge of what the program makes of scenes and meshes with random faults (`mutations`).

`judge` runs a file through the command line in this process and returns complaints: a traceback, more than ten seconds, an
exit code or a message that a user could not use, or a run that ends well and is silently wrong: a changed value changed
neither the resolved scene nor the objects built from it, or a key was ignored; the residual, the energy ledger or the
balance of forces (worked out here from the resolved scene) fails; a number in the results is not finite.
"""

import contextlib
import csv
import io
import json
import re
import shutil
import signal
import time
from dataclasses import dataclass, fields, is_dataclass

import numpy as np

from cosserat_fem import cli, telling
from cosserat_fem.errors import CosseratError
from cosserat_fem.scene import load_scene
from mutations import TABLE, stl_bytes, triangles

try:
    import tomllib
except ModuleNotFoundError:
    import tomli as tomllib

LIMIT = 10.0  # s of CPU time: a busy machine is no hang
STOP = 4.0  # s after which a run is stopped as Ctrl-C does: a mutation may ask for a long one
RESIDUAL, LEDGER, BALANCE = 1e-5, 0.01, 1e-5
DIRECTIONS = ("axis", "normal", "end_normal", "start_tangent", "end_tangent")  # their length says nothing


@dataclass(frozen=True)
class Outcome:
    """What a run left: exit code or None, what it said on standard error, what was raised, CPU seconds."""

    code: int | None
    said: str
    raised: str
    seconds: float


class _Late(BaseException):
    pass


def _alarm(*_):
    raise _Late


def run(scene, out, *, limit=LIMIT, stop=STOP):
    """`cosserat-fem run` in this process, with an alarm, and stopped after `stop` seconds as by Ctrl-C."""
    begin = time.process_time()
    told, said = telling.Progress.__call__, io.StringIO()
    telling.Progress.__call__ = lambda self, done, total: time.process_time() - begin > stop
    before = signal.signal(signal.SIGPROF, _alarm)
    signal.setitimer(signal.ITIMER_PROF, limit)
    code, raised = None, ""
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = cli.main(["run", str(scene), "-o", str(out), "--no-pictures", "-q"])
    except _Late:
        raised = f"still running after {limit:g} s"
    except Exception as error:  # what a user would see as a traceback
        raised = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        telling.Progress.__call__ = told
    return Outcome(code, said.getvalue(), raised, time.process_time() - begin)


def judge(scene, out, base, *, limit=LIMIT, mesh=None):
    """Complaints about what the program makes of a scene file that was made from `base` (a Base), or of another mesh."""
    shutil.rmtree(out, ignore_errors=True)
    found = run(scene, out, limit=limit)
    if found.raised:
        return [found.raised]
    complaints = []
    if "Traceback" in found.said:
        complaints.append("a traceback was printed")
    if found.seconds > limit:
        complaints.append(f"took {found.seconds:.1f} s")
    if found.code not in (0, 1, 2, 3):
        complaints.append(f"exit code {found.code}")
    if found.code == 2 and not re.search(rf"^{re.escape(str(scene))}(:\d+)?: .{{10,}}", found.said, re.M):
        complaints.append(f"a refusal without file and reason: {found.said[:200]!r}")
    if found.code == 1 and len(found.said) < 20:
        complaints.append(f"stopped without a reason: {found.said!r}")
    if found.code in (0, 3):  # 3: a drive or a check is violated, the run is whole
        complaints += base.unchanged(scene) if mesh is None else base.unchanged_by(mesh, scene)
        complaints += wrong_results(out)
    return complaints


class Base:
    """The scene that a mutation started from: its data, its resolved form, the objects built from it."""

    IDLE = ("title", "output")  # no object is built from these

    def __init__(self, path):
        self.data = tomllib.loads(path.read_text())
        loaded = load_scene(path)
        self.resolved, self.built = _without_folder(loaded.resolved(), path.parent), fingerprint(loaded)

    def unchanged(self, path):
        """Complaint if the data differ, but not what is resolved and built from them."""
        data = tomllib.loads(path.read_bytes().decode())
        if repr(data) == repr(self.data):
            return []
        try:
            loaded = load_scene(path)
        except CosseratError as error:
            return [f"runs, but does not load: {error}"]
        ignored = _ignored(data, tomllib.loads(loaded.resolved()))
        if ignored:
            return [f"key {ignored} is taken and ignored"]
        if _without_folder(loaded.resolved(), path.parent) == self.resolved:
            return [] if _plain(data) == _plain(self.data) else ["a changed value did not change the resolved scene"]
        physics = [{k: v for k, v in _plain(d).items() if k not in self.IDLE} for d in (data, self.data)]
        said = repr(physics[0]) != repr(physics[1]) and not _within(*physics)  # a default may be what was taken out
        same = said and fingerprint(loaded) == self.built
        return ["a changed value changed nothing that is built"] if same else []

    def unchanged_by(self, mesh, path):
        """Complaint if another mesh makes the same surface."""
        facets = [triangles(data) for data in (mesh, stl_bytes(TABLE))]
        if facets[0] is None or facets[0] == facets[1]:
            return []
        loaded = load_scene(path)
        repaired = any(part.surface().report for part in loaded.parts if part.mesh is not None)  # and the user is told
        return [] if repaired or fingerprint(loaded) != self.built else ["another mesh makes the same surface"]


def _within(data, other):
    """Whether data say nothing that other does not say too."""
    if isinstance(data, dict) and isinstance(other, dict):
        return all(key in other and _within(value, other[key]) for key, value in data.items())
    if isinstance(data, list) and isinstance(other, list) and len(data) == len(other):
        return all(map(_within, data, other))
    return repr(data) == repr(other)


def _ignored(data, resolved):
    """A key of the data that the resolved scene does not have."""
    if isinstance(data, list) and isinstance(resolved, list) and len(data) == len(resolved):
        return next(filter(None, map(_ignored, data, resolved)), None)
    if isinstance(data, dict) and isinstance(resolved, dict):
        lost = [key for key in data if key not in resolved]
        return lost[0] if lost else next(filter(None, (_ignored(data[key], resolved[key]) for key in data)), None)
    return None


def _without_folder(text, folder):
    return text.replace(str(folder.resolve()), "")


def _plain(value):
    """Data with every number a float, also before a unit, so that 2 and 2.0 are one, and directions of length 1."""
    if isinstance(value, dict):
        return {k: _unit(_plain(v)) if k in DIRECTIONS else _plain(v) for k, v in sorted(value.items())}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    if isinstance(value, str) and (quantity := re.fullmatch(r"(-?\d[\d.]*(?:e[-+]?\d+)?) (.*)", value)):
        return f"{float(quantity.group(1))} {quantity.group(2)}"
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _unit(vector):
    if not isinstance(vector, list) or not all(isinstance(x, float) for x in vector):
        return vector
    size = max(map(abs, vector))
    scaled = np.array(vector) / (size if 0 < size < np.inf else 1.0)
    return (scaled / np.linalg.norm(scaled)).round(12).tolist() if size > 0 else vector


def fingerprint(scene):
    """Everything that is built from a scene and could change its results."""
    seen = {}

    def walk(value):
        if value is None or isinstance(value, bool | int | float | str | bytes | complex | np.generic):
            return repr(value)
        if isinstance(value, np.ndarray):
            return (
                f"{value.dtype}{value.shape}{value.tobytes().hex()}" if value.dtype != object else walk(value.tolist())
            )
        if id(value) in seen:
            return f"#{seen[id(value)][0]}"
        seen[id(value)] = len(seen), value  # held, so that its id stays its own
        if isinstance(value, dict):
            return "{" + ",".join(f"{walk(k)}:{walk(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list | tuple | set | frozenset):
            return "[" + ",".join(walk(v) for v in value) + "]"
        if callable(value) and hasattr(value, "__code__"):
            inside = [cell.cell_contents for cell in value.__closure__ or ()]
            bound = getattr(value, "__self__", None)
            return f"f({value.__code__.co_code.hex()},{walk(inside)},{walk(value.__defaults__)},{walk(bound)})"
        if is_dataclass(value):
            return type(value).__name__ + walk([getattr(value, f.name) for f in fields(value)])
        return type(value).__name__ + walk(getattr(value, "__dict__", {}))

    model = scene.model
    surfaces = [part.surface().points for part in scene.parts if part.mesh is not None]
    solve = scene.tables.solve.model_dump(exclude={"t", "duration", "times"})  # they are in scene.times
    return walk(
        [model.rods, model.supports, model.welds, model.terms, scene.parts, surfaces, scene.times, solve, scene.drives]
    )


def _rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def wrong_results(out):
    """Complaints about the results of a run that ended well."""
    summary = json.loads((out / "summary.json").read_text())
    if summary["status"] != "converged":
        return [f"exit code 0, but status {summary['status']}"]
    complaints = []
    if not summary["worst_residual"] < RESIDUAL:
        complaints.append(f"residual {summary['worst_residual']:.1e}")
    if "in_time" in summary:
        gap = summary["in_time"]["ledger_gap"]
        if not gap < LEDGER and not any("energy ledger" in warning for warning in summary["warnings"]):
            complaints.append(f"the ledger is open by {gap:.1e}, and nothing is said of it")
    for path in out.glob("*.csv"):
        for row in _rows(path):
            for name, value in row.items():
                if re.fullmatch(r"(?i)[-+]?(nan|inf|infinity)", value or ""):
                    return [*complaints, f"{path.name}: {name} is {value}"]
    return complaints + unbalanced(out)


def unbalanced(out):
    """Complaint if supports and parts touched do not carry what acts on the rods, in equilibrium."""
    scene = tomllib.loads((out / "scene.toml").read_text())
    if scene["solve"]["kind"] == "dynamic":
        return []
    acting = _acting(scene)
    if acting is None:
        return []
    carried, size = {}, {}
    for row in _rows(out / "reactions.csv"):
        force = np.array([float(row[c]) for c in ("Fx", "Fy", "Fz")])
        t = float(row["time"])
        carried[t] = carried.get(t, 0.0) + force
        size[t] = size.get(t, 0.0) + np.abs(force).max()
    if (out / "contact_loads.csv").is_file():
        for row in _rows(out / "contact_loads.csv"):
            carried[float(row["time"])] -= np.array([float(row[c]) for c in ("Fx", "Fy", "Fz")])
    for t, force in carried.items():
        load = acting(t)
        left = np.abs(force + load).max()
        if not left <= BALANCE * (size[t] + np.abs(load).max() + 1e-6):
            return [f"t = {t:g} s: supports and contact leave {left:.1e} N of {np.abs(load).max():.1e} N"]
    return []


def _acting(scene):
    """Force (3,) [N] at time t of weight and dead loads, from the resolved scene; None if it takes more to know it."""
    sections = {section["name"]: section for section in scene["section"]}
    lengths, weights = {}, np.zeros(3)
    gravity = np.array(scene.get("gravity", {}).get("acceleration", [0.0, 0.0, 0.0]))
    for rod in scene["rod"]:
        points = np.array(rod["points"]) * rod["unit"]
        if rod.get("length") is None and len(points) > 2:
            straight = np.linalg.norm(points[-1] - points[0])
            if not np.isclose(np.linalg.norm(np.diff(points, axis=0), axis=1).sum(), straight, rtol=1e-12):
                return None
        lengths[rod["name"]] = rod.get("length") or np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        names = [rod["section"]] if isinstance(rod["section"], str) else [name for _, name in rod["section"]]
        if len(set(names)) > 1:
            return None
        weights += lengths[rod["name"]] * _mass(sections[names[0]]) * gravity
    loads = scene.get("load", [])
    if any(load.get("follower") or load.get("components", "all") != "all" or load.get("profile") for load in loads):
        return None  # a profile is integrated with the shape functions, not exactly where it has kinks

    def acting(t):
        total = weights.copy()
        for load in loads:
            force = load["force"]
            if isinstance(force[0], list):
                force = [np.interp(t, force[0], column) for column in np.array(force[1]).T]
            share = lengths[load["rod"]] if load["kind"] == "line" else 1.0
            total = total + share * np.array(force)
        return total

    return acting


def _mass(section):
    if section["kind"] == "general":
        return section["mass_per_length"]
    area = np.pi * section["diameter"] ** 2 / 4 if section["kind"] == "round" else section["width"] * section["height"]
    return area * section["density"]
