"""Random faults in scenes and meshes, seeded: `mutate` changes the text of a scene in one to three places, `mutate_stl` the
bytes of a mesh or its facets. The scenes are as small as they can be and together use every table.
"""

import re
import struct

import numpy as np

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
[[drive]]
part = "door"
torque = [["0 deg", "30 deg"], ["2 N m", "1 N m"]]
uncertainty = 2
lines = [{ name = "a", uncertainty = 1.5 }, { name = "bearings", torque = "10 mN m" }]
[solve]
kind = "quasistatic"
duration = "2 s"
travel = "both"
resolution = "5 deg"
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
UNITS = ["mm", "m", "km", "deg", "s", "N", "MPa", "furlong", "mm mm", "kg/m^3", "°"]


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
        '"né ☃"', '"/nowhere/at all"', '"nul\\u0000"', "3", "['a']",
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
            facets = np.array(corners, dtype="<f4").reshape(-1, 3, 3).astype(float)  # squares of large ones fit
        else:
            (count,) = struct.unpack("<I", data[80:84])
            facets = np.array(list(struct.iter_unpack("<12fH", data[84 : 84 + 50 * count])))[:, 3:12].reshape(-1, 3, 3)
    except (struct.error, ValueError, IndexError, UnicodeDecodeError):
        return None
    areas = np.linalg.norm(np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0]), axis=1)
    return {frozenset(map(tuple, facet.round(4).tolist())) for facet in facets[areas > 1e-6]}
