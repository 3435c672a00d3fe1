"""What does this TOML file mean? From a file to tables, with every fault at its line.

Rule: all faults of one kind are reported at once: first what TOML itself cannot read, then shapes and units (pydantic),
then names and values (`build.py`). One formatter prints ``scene.toml:14: rod "loom": what is wrong (got ...)``.
"""

from __future__ import annotations

import pathlib
import re
import sys
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from ..errors import SceneError, nearest
from .lines import Lines, Path
from .tables import SceneTables

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")

TYPES = {
    "int_type": "must be an integer",
    "float_type": "must be a number",
    "string_type": "must be a string",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "dict_type": "must be a table",
    "string_too_short": "must not be empty",
}


@dataclass(frozen=True, eq=False)
class Source:
    """A scene file as read: where it is, its data, its lines and its text."""

    path: pathlib.Path
    data: dict[str, Any]
    lines: Lines
    text: str = ""

    @property
    def folder(self) -> pathlib.Path:
        """Paths in the file are relative to this."""
        return self.path.parent

    def fault(self, path: Path, message: str) -> str:
        """One line for a fault: file, line, table and what is wrong."""
        return f"{self.path}:{self.lines.line_of(path)}: {self.label(path)}{message}"

    def label(self, path: Path) -> str:
        """The table a path lies in, as the user knows it: ``rod "loom": `` or ``support 2: ``."""
        if not path:
            return ""
        table = str(path[0])
        if len(path) == 1 or not isinstance(path[1], int):
            return f"{table}: " if isinstance(self.data.get(table), dict) else ""
        entries = self.data.get(table)
        entry = entries[path[1]] if isinstance(entries, list) and path[1] < len(entries) else None
        name = entry.get("name") if isinstance(entry, dict) else None
        return f'{table} "{printable(name)}": ' if isinstance(name, str) and name else f"{table} {path[1] + 1}: "

    def value(self, path: Path) -> Any:
        """What stands at a path, or None."""
        value: Any = self.data
        for key in path:
            try:
                value = value[key]
            except (KeyError, IndexError, TypeError):
                return None
        return value


def read(path: pathlib.Path) -> Source:
    """Read a TOML file. SceneError if there is none or it is not TOML."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise SceneError(f"{path}: there is no such scene file.") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}.") from None
    try:
        return parse(path, raw.decode("utf-8"))
    except UnicodeDecodeError:
        raise SceneError(f"{path}: is not a text file in UTF-8.") from None


def parse(path: pathlib.Path, text: str) -> Source:
    """The text of a scene file that stands at a path. SceneError if it is not TOML."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        where = f"{path}:{place.group(1)}" if place else f"{path}:{text.count(chr(10)) + 1}"
        reason = re.sub(r"\s*\(at .*\)$", "", str(error))
        raise SceneError(f"{where}: is not TOML: {reason[:1].lower()}{reason[1:]}.") from None
    except RecursionError:
        raise SceneError(f"{path}: is nested too deeply.") from None
    return Source(path, data, Lines(text), text)


def validate(source: Source) -> SceneTables:
    """Check characters, shapes and units. SceneError with all faults."""
    faults = _control_characters(source, source.data, ())
    if faults:
        raise SceneError(sorted_faults(faults))
    try:
        return SceneTables.model_validate(source.data)
    except ValidationError as error:
        raise SceneError(sorted_faults([_fault(source, dict(e)) for e in error.errors()])) from None


def _control_characters(source: Source, value: Any, path: Path) -> list[str]:
    """Faults for strings that a terminal would obey and no file name or title can hold."""
    if isinstance(value, str):
        name = f"{_keys(path)} " if _keys(path) else ""
        return (
            [source.fault(path, f"{name}holds a control character (got {short(value)}).")]
            if CONTROL.search(value)
            else []
        )
    faults: list[str] = []
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        if isinstance(key, str) and CONTROL.search(key):
            faults.append(source.fault((*path, key), f"the key {key!r} holds a control character."))
        else:
            faults += _control_characters(source, inner, (*path, key))
    return faults


def sorted_faults(faults: list[str]) -> list[str]:
    """In order of lines, without repetition."""

    def line(fault: str) -> int:
        match = re.search(r":(\d+): ", fault)
        return int(match.group(1)) if match else 0

    return sorted(dict.fromkeys(faults), key=line)


def _fault(source: Source, error: dict[str, Any]) -> str:
    """One pydantic error as one sentence."""
    path = _real_path(source, error["loc"])
    kind, given = error["type"], error.get("input")
    if kind == "extra_forbidden":
        known = known_keys(source, path[:-1])
        if len(path) == 1:
            where = f"{source.path}:{source.lines.line_of(path)}"
            return f"{where}: unknown table or key {str(path[0])!r}. {nearest(str(path[0]), known)}"
        return source.fault(path, f"unknown key {str(path[-1])!r}. {nearest(str(path[-1]), known)}")
    if kind == "missing":
        inside = f"{_keys(path[:-1])} " if _keys(path[:-1]) else ""
        if isinstance(path[-1], int):
            return source.fault(path[:-1], f"{inside}has too few values (got {short(source.value(path[:-1]))}).")
        return source.fault(path[:-1], f"{inside}needs the key {str(path[-1])!r}.")
    if kind == "union_tag_not_found":
        return source.fault(path, f"needs the key 'kind', one of {_tags(error)}.")
    name = f"{_keys(path)} " if _keys(path) else ""
    if kind == "union_tag_invalid":
        tag = error["ctx"]["tag"]
        known = [t.strip(" '") for t in error["ctx"]["expected_tags"].split(",")]
        return source.fault((*path, "kind"), f"kind {tag!r} is unknown. {nearest(tag, known)}")
    if kind == "literal_error":
        return source.fault(path, f"{name}must be one of {error['ctx']['expected']} (got {short(given)}).")
    if kind in ("too_long", "too_short"):
        context = error["ctx"]
        n = context.get("max_length") if kind == "too_long" else context.get("min_length")
        least = "at least " if kind == "too_short" else ""
        return source.fault(
            path, f"{name}must have {least}{n} entr{'y' if n == 1 else 'ies'} (got {context['actual_length']})."
        )
    message = str(error["ctx"]["error"]) if kind == "value_error" else TYPES.get(kind, error["msg"])
    return source.fault(path, f"{name}{message} (got {short(given)}).")


def _real_path(source: Source, location: tuple[str | int, ...]) -> Path:
    """Drop what pydantic adds to a path (the tags of unions): keep what exists in the file, and the last key."""
    path: Path = ()
    tagged: set[Path] = set()
    for k, key in enumerate(location):
        table = source.value(path)
        if path and not isinstance(table, dict | list):  # what may be written shorter
            break
        if k < len(location) - 1 and isinstance(table, dict) and table.get("kind") == key and path not in tagged:
            tagged.add(path)  # a tag may also be the name of a key
            continue
        if k == len(location) - 1 or source.value((*path, key)) is not None:
            path += (key,)
    return path


def _keys(path: Path) -> str:
    """The key within its table: ``points[1][2]``, ``motion.angle``."""
    inner = path[1:] if path and not (len(path) > 1 and isinstance(path[1], int)) else path[2:]
    if not inner and len(path) == 1:
        return str(path[0])
    text = ""
    for key in inner:
        text += f"[{key}]" if isinstance(key, int) else (f".{key}" if text else str(key))
    return text


def _tags(error: dict[str, Any]) -> str:
    where = error["loc"]
    tags = {
        "section": "'round', 'rectangle', 'general', 'built'",
        "layers": "'strands', 'cables', 'tube', 'braid', 'tape'",
        "support": "'clamp', 'pin', 'weld'",
        "load": "'point', 'line'",
        "contact": "'part', 'rods'",
        "shape": "'plane', 'sphere', 'cylinder', 'capsule', 'box', 'torus'",
    }
    inner = next((key for key in ("shape", "layers") if key in where), where[0])
    return tags.get(str(inner), "'hinge', 'slider', 'path'")


def known_keys(source: Source, path: Path) -> list[str]:
    """Keys that the table at a path may have."""
    model: Any = SceneTables
    for k, key in enumerate(path):
        if isinstance(key, int):
            continue
        field = model.model_fields.get(key) if isinstance(model, type) and issubclass(model, BaseModel) else None
        if field is None:
            return []
        value = source.value(path[: k + 2] if k + 1 < len(path) and isinstance(path[k + 1], int) else path[: k + 1])
        kind = value.get("kind") if isinstance(value, dict) else None
        models = _models(field.annotation)
        model = next((m for m in models if len(models) == 1 or kind in (None, _kind(m))), None)
        if model is None:
            return []
    return list(model.model_fields)


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Table classes inside an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for part in getattr(annotation, "__args__", ()) for m in _models(part)]


def _kind(model: type[BaseModel]) -> str | None:
    field = model.model_fields.get("kind")
    return getattr(field.annotation, "__args__", (None,))[0] if field is not None else None


def short(value: Any) -> str:
    """A value as the user wrote it, not too long."""
    text = f'"{printable(value)}"' if isinstance(value, str) else " ".join(repr(value).split())
    return text if len(text) <= 50 else text[:47] + "..."


def printable(text: str) -> str:
    """Text with its control characters written out."""
    return CONTROL.sub(lambda match: match.group().encode("unicode_escape").decode(), text)
