"""Scenes and meshes with random faults, and a judge of what the program makes of them.

`mutate` changes the text of a scene in one to three places, `mutate_stl` the bytes of a mesh; both are seeded. `judge` runs
the file through the command line in this process and returns complaints: a traceback, more than ten seconds, an exit code
or a message that a user could not use, or a run that ends well and is silently wrong:
a changed value changed neither the resolved scene nor the objects built from it; the residual, the energy ledger or the
balance of forces (worked out here from the resolved scene) fails; a number in the results is not finite.
"""

import contextlib
import csv
import io
import json
import re
import shutil
import signal
import struct
import time
from dataclasses import dataclass, fields, is_dataclass

import numpy as np

from cosserat_fem import cli
from cosserat_fem.errors import CosseratError
from cosserat_fem.scene import load_scene

try:
    import tomllib
except ModuleNotFoundError:
    import tomli as tomllib

LIMIT = 10.0  # s of CPU time: a busy machine is no hang
STOP = 4.0  # s after which a run is stopped as Ctrl-C does: a mutation may ask for a long one
RESIDUAL, LEDGER, BALANCE = 1e-5, 0.01, 1e-5
DIRECTIONS = ("axis", "normal", "end_normal", "start_tangent", "end_tangent")  # their length says nothing

SECTION = """
[[section]]
kind = "round"
name = "cable"
diameter = "6 mm"
youngs_modulus = "5 MPa"
poisson_ratio = 0.3
density = "1200 kg/m^3"
"""
SCENES = {
    "static": """
title = "Cantilever under all loads"
[[section]]
kind = "general"
name = "strip"
force_stiffness = ["2 kN", "2 kN", 5000]
moment_stiffness = [0.4, 0.6, 0.3]
mass_per_length = "30 g/m"
[[rod]]
name = "a"
section = "strip"
points = [[0, 0, 0], [500, 0, 0]]
unit = "mm"
n_elements = 3
order = 2
rest = [0.1, 0.2, -0.1]
normal = [0, 0, 1]
[[support]]
kind = "clamp"
rod = "a"
at = "start"
[gravity]
acceleration = [0, 0, -9.81]
[[load]]
kind = "point"
rod = "a"
at = "end"
force = [0.1, 0.2, "-0.3 N"]
moment = [0, 0.02, 0]
[[load]]
kind = "line"
rod = "a"
force = [0, 0.4, 0]
profile = [["start", "200 mm", "end"], [0, 1, 0.5]]
[solve]
kind = "static"
""",
    "hinge": SECTION
    + """
[[rod]]
name = "a"
section = "cable"
points = [[0, 0, 0], [100, 0, 30], [200, 0, 0]]
unit = "mm"
length = "230 mm"
n_elements = 4
order = 1
[[rod]]
name = "b"
section = "cable"
points = [[0.2, 0, 0], [0.3, 0.05, 0]]
n_elements = 2
order = 2
[[part]]
name = "door"
motion = { kind = "hinge", point = [0.1, 0, 0], axis = [0, 0, 1], angle = "10 deg/s" }
[[part]]
name = "wall"
motion = { kind = "slider", axis = [1, 0, 0], travel = [["0 s", "2 s"], ["0 mm", "2 mm"]] }
[[support]]
kind = "clamp"
name = "fixed"
rod = "a"
at = "start"
[[support]]
kind = "clamp"
rod = "a"
at = "end"
to = "door"
free = ["ry", "rz"]
[[support]]
kind = "weld"
rod = "a"
at = "end"
other = "b"
other_at = "start"
[[support]]
kind = "pin"
rod = "b"
at = "end"
to = "wall"
[gravity]
acceleration = [0, 0, -9.81]
[solve]
kind = "quasistatic"
duration = "2 s"
[output]
every = "1 s"
""",
    "swing": SECTION
    + """
[[rod]]
name = "a"
section = "cable"
points = [[0, 0, 0], [0.3, 0, 0]]
n_elements = 2
order = 1
[[rod]]
name = "b"
section = "cable"
points = [[0, 0.2, 0], [0.3, 0.2, 0]]
n_elements = 2
order = 1
[[support]]
kind = "pin"
rod = "a"
at = "start"
[[support]]
kind = "pin"
rod = "b"
at = "start"
[gravity]
acceleration = [0, 0, -9.81]
[[damping]]
time = "2 ms"
mass = 0.3
[[drag]]
rod = "a"
normal = 0.02
normal_quadratic = 0.1
medium = [0, "1 m/s", 0]
[[electrostatic]]
rod = "a"
other = "b"
charge = 1e-7
other_charge = -2e-7
[solve]
kind = "dynamic"
start = "drawn"
duration = "20 ms"
dt = "5 ms"
rho_inf = 0.7
velocity = { v = [0, 0, 0], omega = [0, -0.5, 0] }
[output]
every = "10 ms"
""",
    "contact": SECTION
    + """
[[rod]]
name = "a"
section = "cable"
points = [[0, 0, 5], [120, 0, 5], [240, 0, 5]]
unit = "mm"
n_elements = 4
order = 2
[[part]]
name = "table"
shape = { kind = "box", center = [0.2, 0, -0.02], edges = [0.2, 0.2, 0.04] }
[[part]]
name = "wall"
motion = { kind = "slider", axis = [0, 0, -1], travel = "2 mm/s" }
[[support]]
kind = "clamp"
rod = "a"
at = "start"
to = "wall"
[gravity]
acceleration = [0, 0, -9.81]
[[contact]]
kind = "part"
rod = "a"
part = "table"
friction = 0.2
[solve]
kind = "quasistatic"
duration = "1 s"
[output]
every = "1 s"
""",
    "kardan": SECTION
    + """
[[rod]]
name = "a"
section = [["0 mm", "cable"], ["200 mm", "cable"]]
points = [[0, 0, 0], [0, 0, 0.2]]
n_elements = 2
[[support]]
kind = "clamp"
rod = "a"
at = "start"
[[load]]
kind = "point"
rod = "a"
at = "end"
force = [[0, 1, 2], [[0, 0, 0], [0.02, 0, 0], [0.04, 0, 0]]]
[solve]
kind = "quasistatic"
times = [0, "1 s", "2 s"]
rotation = "kardan"
""",
}
MESH_SCENE = SCENES["contact"].replace(
    'shape = { kind = "box", center = [0.2, 0, -0.02], edges = [0.2, 0.2, 0.04] }',
    'mesh = "table.stl"\nmesh_unit = "mm"',
)

# scenes

NUMBER = re.compile(r"(?<![\w.#\"])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.\"])")
QUANTITY = re.compile(r'"(-?[\d.]+(?:[eE][-+]?\d+)?) ([^"]+)"')
STRING = re.compile(r'"[^"\n]*"')
KEY = re.compile(r"\b[a-z_]+(?= = )")
HEADER = re.compile(r"^\[+[a-z]+\]+$", re.M)
COUNT = re.compile(r"^(n_elements|order|steps) = ")  # a large one is not wrong, it takes long
HOSTILE = [
    "0",
    "-1",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "1e-308",
    "true",
    '"x"',
    "[]",
    "{}",
    "1e400",
    "0x10",
    "1_0",
    "+2.5",
    "[[1]]",
]
UNITS = ["mm", "m", "km", "deg", "s", "N", "MPa", "furlong", "", "mm mm", "kg/m^3", "°"]


def _replace(text, match, new):
    return text[: match.start()] + new + text[match.end() :]


def _pick(rng, pattern, text):
    found = list(pattern.finditer(text))
    return found[rng.integers(len(found))] if found else None


def _number(text, rng):
    found = _pick(rng, NUMBER, text)
    if found is None:
        return text
    line = text[text.rfind("\n", 0, found.start()) + 1 : found.end()]
    if COUNT.match(line):
        return _replace(text, found, str(rng.choice(["0", "-2", "1", "2", "5", "7", "2.5", "true", '"3"'])))
    if rng.random() < 0.6:
        return _replace(text, found, repr(float(found.group()) * float(rng.choice([1.1, 0.5, -1, 10, 1e-3, 1e3, 1e9]))))
    return _replace(text, found, str(rng.choice(HOSTILE)))


def _quantity(text, rng):
    found = _pick(rng, QUANTITY, text)
    if found is None:
        return text
    value, unit = found.groups()
    if rng.random() < 0.5:
        value = repr(float(value) * float(rng.choice([0.5, 1.2, -1, 0, 100])))
    else:
        unit = str(rng.choice(UNITS))
    return _replace(text, found, f'"{value} {unit}"')


def _string(text, rng):
    found = _pick(rng, STRING, text)
    other = _pick(rng, STRING, text)
    choices = [
        '""', other.group(), found.group()[:-2] + '"', '"a' + found.group()[1:], '"\\u0007"', '"' + "x" * 3000 + '"',
        '"né ☃"', '"../../etc"', '"nul\\u0000"', "3", "['a']",
    ]  # fmt: skip
    return _replace(text, found, str(rng.choice(np.array(choices, dtype=object))))


def _key(text, rng):
    found = _pick(rng, KEY, text)
    word = found.group()
    k = int(rng.integers(len(word)))
    new = str(rng.choice([word[:k] + word[k + 1 :] or "x", word + "s", word.upper(), _pick(rng, KEY, text).group()]))
    return _replace(text, found, new)


def _line(text, rng):
    lines = text.split("\n")
    k, other = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    action = rng.integers(4)
    if action == 0:
        del lines[k]
    elif action == 1:
        lines.insert(other, lines[k])
    elif action == 2:
        lines[k], lines[other] = lines[other], lines[k]
    else:
        lines[k] = lines[k][: int(rng.integers(len(lines[k]) + 1))]
    return "\n".join(lines)


def _table(text, rng):
    marks = [match.start() for match in HEADER.finditer(text)] + [len(text)]
    k = int(rng.integers(len(marks) - 1))
    block = text[marks[k] : marks[k + 1]]
    action = rng.integers(4)
    if action == 0:
        return text[: marks[k]] + text[marks[k + 1] :]
    if action == 1:
        return text + block
    header, rest = block.split("\n", 1)
    new = header.strip("[]") if action == 2 else header.strip("[]")[:-1]
    brackets = header.count("[") if action == 3 else 3 - header.count("[")
    return text[: marks[k]] + "[" * brackets + new + "]" * brackets + "\n" + rest + text[marks[k + 1] :]


def _entry(text, rng):
    """One entry of a list taken out or said twice."""
    found = _pick(rng, re.compile(r"(?<=[\[ ])[^\[\]{},\n]+, "), text)
    if found is None:
        return text
    return _replace(text, found, "" if rng.random() < 0.5 else 2 * found.group())


def _bytes(data, rng):
    k = int(rng.integers(len(data)))
    action = rng.integers(5)
    if action == 0:
        return data[:k]
    if action == 1:
        return data[:k] + bytes([rng.integers(256)]) + data[k + 1 :]
    if action == 2:
        return data[:k] + bytes([rng.integers(256)]) + data[k:]
    if action == 3:
        return b"\xef\xbb\xbf" + data
    return data.replace(b"\n", b"\r\n")


def mutate(text, rng):
    """Bytes of a scene with one to three random changes."""
    for _ in range(int(rng.choice([1, 1, 1, 1, 2, 3]))):
        action = rng.choice(np.array([_number, _number, _quantity, _string, _key, _line, _table, _entry], dtype=object))
        text = action(text, rng)
    data = text.encode()
    return _bytes(data, rng) if rng.random() < 0.08 else data


# meshes


def box_stl(center, edges):
    """Facets (12, 3, 3) of a box, outward."""
    facets = []
    for axis in range(3):
        for side in (-1, 1):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, axis] = side
            corners[:, u], corners[:, v] = [-1, 1, 1, -1], [-1, -1, 1, 1]
            if side < 0:
                corners = corners[::-1]
            facets += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(facets) * np.array(edges) / 2 + center


TABLE = box_stl((200, 0, -20), (200, 200, 40))  # mm


def stl_bytes(facets, *, text=False):
    """An STL file of facets (F, 3, 3)."""
    facets = np.asarray(facets, dtype="<f4")
    if text:
        lines = ["solid table"]
        for facet in facets:
            lines += [
                "facet normal 0 0 0",
                "outer loop",
                *(f"vertex {x} {y} {z}" for x, y, z in facet),
                "endloop",
                "endfacet",
            ]
        return ("\n".join([*lines, "endsolid table"]) + "\n").encode()
    rows = [struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in facets]
    return b"box".ljust(80) + struct.pack("<I", len(facets)) + b"".join(rows)


def mutate_stl(rng):
    """Bytes of the table's mesh with a fault, in its facets or in its file."""
    facets, text = TABLE.copy(), bool(rng.random() < 0.3)
    k, action = int(rng.integers(len(facets))), int(rng.integers(13))
    if action == 0:
        facets = np.delete(facets, k, axis=0)
    elif action == 1:
        facets[k] = facets[k, ::-1]
    elif action == 2:
        facets = facets[:, ::-1]
    elif action == 3:
        facets[k, rng.integers(3), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 3e38, 0.0, 1e-38])
    elif action == 4:
        facets *= float(rng.choice([1e-6, 1e-3, 1e3, 1e6, -1]))
    elif action == 5:
        facets[k, rng.integers(3)] += rng.normal(size=3) * float(rng.choice([1e-7, 1e-2, 1, 30]))
    elif action == 6:
        facets = np.concatenate([facets, facets[[k]]])
    elif action == 7:
        facets[k, 1] = facets[k, 0]
    elif action == 8:
        facets = facets[: int(rng.integers(3))]
    elif action == 9:
        facets[..., 2] *= float(rng.choice([0.0, 0.5, 1.1, 3.0]))
    data = stl_bytes(facets, text=text)
    if action == 10:
        return data[: int(rng.integers(len(data)))]
    if action == 11:
        for _ in range(int(rng.integers(1, 6))):
            data = _bytes(data, rng)
        return data
    if action == 12 and not text:
        return data[:80] + struct.pack("<I", int(rng.choice([0, 1, 11, 13, 2**31, 2**32 - 1]))) + data[84:]
    return data


def triangles(data):
    """The set of triangles of an STL file with a size, as corners in order; None if the file is not sound."""
    try:
        if data[:5] == b"solid" and b"vertex" in data:
            corners = [line.split()[1:] for line in data.decode().splitlines() if line.split()[:1] == ["vertex"]]
            facets = np.array(corners, dtype="<f4").reshape(-1, 3, 3)
        else:
            (count,) = struct.unpack("<I", data[80:84])
            facets = np.array(list(struct.iter_unpack("<12fH", data[84 : 84 + 50 * count])))[:, 3:12].reshape(-1, 3, 3)
    except (struct.error, ValueError, IndexError, UnicodeDecodeError):
        return None
    areas = np.linalg.norm(np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0]), axis=1)
    return {frozenset(map(tuple, facet.round(4).tolist())) for facet in facets[areas > 1e-6]}


# the judge


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
    told, said = cli._Progress.__call__, io.StringIO()
    cli._Progress.__call__ = lambda self, done, total: time.process_time() - begin > stop
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
        cli._Progress.__call__ = told
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
    if found.code not in (0, 1, 2):
        complaints.append(f"exit code {found.code}")
    if found.code == 2 and not re.search(rf"^{re.escape(str(scene))}(:\d+)?: .{{10,}}", found.said, re.M):
        complaints.append(f"a refusal without file and reason: {found.said[:200]!r}")
    if found.code == 1 and len(found.said) < 20:
        complaints.append(f"stopped without a reason: {found.said!r}")
    if found.code == 0:
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
    """Data with every number a float, so that 2 and 2.0 are one, and directions of length 1."""
    if isinstance(value, dict):
        return {k: _unit(_plain(v)) if k in DIRECTIONS else _plain(v) for k, v in sorted(value.items())}
    if isinstance(value, list):
        return [_plain(v) for v in value]
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
    return walk([model.rods, model.supports, model.welds, model.terms, scene.parts, surfaces, scene.times, solve])


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
