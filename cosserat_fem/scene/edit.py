"""Which value of a scene does a dotted path name, and what is the scene with other values?

Rule: `rod.cable.length` goes from table to table by keys; an entry of an array of tables is called by its `name` if it has
one, else by its number; entries of lists by their number; numbers count from 0. A changed scene is a `Source` like one that
was read, so it passes the same checks; its faults stand at the line of the value that was replaced.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..errors import nearest
from .lines import Path
from .load import Source, known_keys, short


def find(source: Source, dotted: str) -> Path:
    """Path of a value of a scene, which need not be written there as long as the table it would stand in may have it.

    Raises
    ------
    ValueError
        There is no such value; names the word that is wrong and the nearest that is there.
    """
    words, path = dotted.split("."), Path()
    while words:
        table = source.value(path)
        if isinstance(table, list):
            key, used = _entry(table, words, dotted)
        else:
            key, used = words[0], 1
            known = known_keys(source, path) if table is None or isinstance(table, dict) else []
            if key not in known:
                raise ValueError(_unknown(source, path, key, known, dotted))
        path, words = (*path, key), words[used:]
    return path


def changed(source: Source, values: Mapping[str, Any]) -> Source:
    """A scene with other values at some paths; tables on the way that are not written are made. ValueError as for `find`."""
    data = copy.deepcopy(source.data)
    for path, value in [(find(source, dotted), value) for dotted, value in values.items()]:
        table: Any = data
        for key in path[:-1]:
            table = table.setdefault(key, {}) if isinstance(table, dict) else table[key]
        table[path[-1]] = copy.deepcopy(value)
    return replace(source, data=data)


def said(values: Mapping[str, Any]) -> str:
    """Values by path as one reads them: ``rod.cable.length = "0.2 m", solve.t = 1``."""
    return ", ".join(f"{path} = {short(value)}" for path, value in values.items())


def _entry(entries: list[Any], words: list[str], dotted: str) -> tuple[str | int, int]:
    """Number of the entry that the first words call, and how many words that took: names may have dots."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    for used in range(len(words), 0, -1):
        if (name := ".".join(words[:used])) in names:
            return names.index(name), used
    if words[0].isdecimal() and int(words[0]) < len(entries):
        return int(words[0]), 1
    known = [name if isinstance(name, str) else str(k) for k, name in enumerate(names)]
    raise ValueError(f"{dotted!r}: there is no {words[0]!r}. {nearest(words[0], known)}")


def _unknown(source: Source, path: Path, key: str, known: list[str], dotted: str) -> str:
    """Why a path ends at a key."""
    here = ".".join(str(word) for word in path)
    if source.value(path) is not None and not isinstance(source.value(path), dict):
        return f"{dotted!r}: {here} is one value and has nothing inside."
    if key.isdecimal() and path:
        return f"{dotted!r}: the scene says nothing of {here}; write it there first."
    return f"{dotted!r}: there is no {key!r}{f' in {here}' if here else ''}. {nearest(key, known)}"
