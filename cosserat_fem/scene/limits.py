"""What does `[checks]` of a scene ask for? From its tables to limits, with every fault at its line.

Rule: as in `build.py`: a `ValueError` of a limit is brought to the line of its key, and what names something faulty is
passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ..errors import SceneError, nearest
from ..limits.allowed import Check, Limit, checks_of
from ..mechanism import Hinge
from ..model import Model
from . import lines
from .load import Source, short, sorted_faults
from .tables import ChecksTable, Table

if TYPE_CHECKING:
    from .build import Builder


def build_limits(builder: Builder) -> list[tuple[Limit, lines.Path]]:
    """Limits of a scene and where they stand; faults go to the builder."""
    found = []
    for path, kind, table in _entries(builder.tables.checks, builder.source):
        before = len(builder.faults)
        _check_names(builder, kind, table, path)
        given = table.model_dump(exclude_none=True)
        try:
            limit = Limit(kind, given.pop("limit", None), **given)
        except ValueError as error:
            builder.faults.append(_fault(builder.source, path, str(error)))
        else:
            if len(builder.faults) == before:
                found.append((limit, path))
    return found


def build_checks(builder: Builder, model: Model) -> list[Check]:
    """Every limit on every thing it is on. SceneError with all faults."""
    checks: list[Check] = []
    faults: list[str] = []
    parts = list(builder.parts.values())
    for limit, path in builder.limits:
        try:
            new = checks_of([limit], model, parts)
        except ValueError as error:
            faults.append(_fault(builder.source, path, str(error)))
            continue
        for check in new:
            if any(check.name == other.name for other in checks):
                reason = f"two checks are called {check.name!r}. Give one of them a name."
                faults.append(_fault(builder.source, path, reason))
            checks.append(check)
    if faults:
        raise SceneError(sorted_faults(faults))
    return checks


def _entries(tables: ChecksTable | None, source: Source) -> Iterable[tuple[lines.Path, str, Table]]:
    """Every limit: where it stands, its quantity, its table."""
    for kind in type(tables).model_fields if tables is not None else ():
        for k, table in enumerate(getattr(tables, kind) or ()):
            several = isinstance(source.value(("checks", kind)), list)
            yield ("checks", kind, k) if several else ("checks", kind), kind, table


def _fault(source: Source, path: lines.Path, message: str) -> str:
    """A message at the key it begins with, as the user wrote it: ``bend_radius.rule: ...``."""
    kind = str(path[1])
    match = re.match(r"(\w+): (.*)", message, re.S)
    key, text = (match.group(1), match.group(2)) if match else ("", message)
    written = source.value(path)
    if not isinstance(written, dict):  # a limit and nothing else
        return source.fault(path, f"{kind}: {_as_written(text, written)}")
    if key in written:
        return source.fault((*path, key), f"{kind}.{key}: {_as_written(text, written[key])}")
    number = f"[{path[2]}]" if len(path) > 2 else ""
    return source.fault(path, f"{kind}{number}: {text if key == kind else message}")


def _as_written(text: str, value: Any) -> str:
    return re.sub(r"\(got [^()]*\)", lambda _: f"(got {short(value)})", text)


def _check_names(builder: Builder, kind: str, table: Table, path: lines.Path) -> None:
    """Faults of names of rods, supports and parts that do not exist."""
    tables = builder.tables
    declared = {
        "rod": [rod.name for rod in tables.rod],
        "other": [rod.name for rod in tables.rod],
        "part": [part.name for part in tables.part],
        "support": [str(support.name) for support in builder.supports.values() if hasattr(support, "name")],
    }
    if len(builder.supports) < len(tables.support):  # some are faulty, and names may be theirs
        del declared["support"]
    for key, names in declared.items():
        name = getattr(table, key, None)
        what = "rod" if key == "other" else key
        if name is not None and name not in names:
            reason = f'{kind}.{key}: {what} "{name}" does not exist. {nearest(name, names)}'
            builder.faults.append(builder.source.fault((*path, key), reason))
    part = builder.parts.get(getattr(table, "part", None) or "")
    if part is not None and kind == "hinge_torque" and not isinstance(part.motion, Hinge):
        reason = f'{kind}.part: part "{part.name}" has no hinge.'
        builder.faults.append(builder.source.fault((*path, "part"), reason))
    if part is not None and kind == "clearance" and not (part.shapes or part.mesh is not None):
        reason = f'{kind}.part: part "{part.name}" has neither a shape nor a mesh.'
        builder.faults.append(builder.source.fault((*path, "part"), reason))
