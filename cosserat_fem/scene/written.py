"""How is a scene written back, and told from others?

Rule: what is written says everything a run depends on, in SI with every default. The identity of a scene is a digest of what
its solution depends on: not of its title, of where files are, or of studies ([sweep], [design]).
"""

from __future__ import annotations

import hashlib
import pathlib
from typing import Any

import numpy as np

from .load import CONTROL, Source
from .tables import SceneTables

ALONG = ("along", "until", "longest", "branch")  # keys of [solve] for kind = "path"
IN_TIME = ("start", "velocity", "rho_inf", "rtol", "dt", "richardson")  # keys of [solve] for kind = "dynamic"
STUDIES = ("sweep", "design")  # tables about many runs


def resolved(source: Source, tables: SceneTables) -> str:
    """A scene as TOML in SI units with every default written out and absolute paths."""
    data = tables.model_dump(exclude_none=True, exclude=set(STUDIES))
    for table, key in files(data):
        table[key] = str(_absolute(source, table[key]))
    return _toml(data)


def _toml(data: dict[str, Any]) -> str:
    """All tables but for keys that say nothing in a run of this kind."""
    kind = data["solve"]["kind"]
    for key in foreign(kind):
        data["solve"].pop(key, None)
    for load in data["load"] if kind != "path" else ():
        load.pop("constant", None)
    return to_toml(data)


def identity(source: Source, tables: SceneTables) -> str:
    """Digest of all that a solution depends on: the resolved scene with the contents of files for their names."""
    data = tables.model_dump(exclude_none=True, exclude={"title", *STUDIES})
    for table, key in files(data):
        table[key] = hashlib.sha256(_absolute(source, table[key]).read_bytes()).hexdigest()
    data["output"] = {key: value for key, value in data["output"].items() if key == "every"}
    return hashlib.sha256(_toml(data).encode()).hexdigest()


def read_files(source: Source, tables: SceneTables) -> list[pathlib.Path]:
    """Meshes, curves and motions that a scene is read from."""
    return [_absolute(source, table[key]) for table, key in files(tables.model_dump(exclude_none=True))]


def _absolute(source: Source, name: str) -> pathlib.Path:
    return (source.folder / name).resolve()


def foreign(kind: str) -> dict[str, str]:
    """Keys of [solve] that say nothing in a run of this kind, and what they are for."""
    one = kind in ("static", "path")
    keys = dict.fromkeys(("duration", "times") if one else ("t", "steps"), "quasistatic" if one else "static")
    if kind != "dynamic":
        keys |= dict.fromkeys(IN_TIME, "dynamic")
    if kind != "path":
        keys |= dict.fromkeys(ALONG, "path")
    if kind != "quasistatic":
        keys |= dict.fromkeys(("past_limits", "travel", "resolution"), "quasistatic")
    if kind == "dynamic":
        keys |= {"modes": "static"}
    return keys


def files(data: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Tables and keys that name a file."""
    found = [(part, "mesh") for part in data["part"]] + [(part.get("motion", {}), "file") for part in data["part"]]
    found += [(rod, "file") for rod in data["rod"]]
    return [(table, key) for table, key in found if key in table]


def to_toml(data: dict[str, Any]) -> str:
    """TOML of nested tables as a scene has them: plain values first, then tables, then arrays of tables."""
    out: list[str] = []
    for key, value in data.items():
        if not _is_table(value):
            out.append(f"{key} = {_literal(value)}")
    for key, value in data.items():
        if isinstance(value, dict):
            out += ["", f"[{key}]", *(f"{k} = {_literal(v)}" for k, v in value.items())]
        elif _is_table(value):
            for entry in value:
                out += ["", f"[[{key}]]", *(f"{k} = {_literal(v)}" for k, v in entry.items())]
    return "\n".join(out) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + CONTROL.sub(lambda char: f"\\u{ord(char.group()):04x}", escaped) + '"'
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_literal(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(_literal(v) for v in value) + "]"
    return repr(value if isinstance(value, int) else float(value))
