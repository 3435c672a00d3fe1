"""What triangles does this file hold? STL by ourselves, other formats through pyvista.

Rule: triangles as they stand in the file, nothing repaired. A file that holds less or more than it says is refused.
"""

from __future__ import annotations

import os
import pathlib
import re

import numpy as np

from .errors import MeshError, one_line, silenced

LIMIT = 2_000_000  # triangles of one surface


def read_surface(path: str | os.PathLike[str], where: str) -> tuple[np.ndarray, np.ndarray]:
    """Read triangles as they stand in a file (STL, OBJ, PLY, VTK): points (P, 3) in file units, triangles (F, 3).

    MeshError if the file cannot be read, holds no triangle, more than `LIMIT`, or coordinates that are not finite.
    """
    file = pathlib.Path(path)
    where = f"{where}: mesh file {os.fspath(path)!r}"
    if not file.is_file():
        raise MeshError(f"{where} does not exist.")
    try:
        points, triangles = _read_stl(file, where) if file.suffix.lower() == ".stl" else _read_other(file)
    except MeshError:
        raise
    except Exception as error:  # pyvista and VTK raise many types for files that are not meshes
        raise MeshError(f"{where} cannot be read as a surface: {one_line(error)}.") from None
    if len(triangles) == 0:
        raise MeshError(f"{where} holds no surface (0 triangles). Export the part as a triangle mesh (STL, OBJ, PLY).")
    if len(triangles) > LIMIT:
        raise MeshError(too_large(where, len(triangles)))
    if not np.isfinite(points).all():
        raise MeshError(f"{where} holds coordinates that are not finite. Export it again.")
    return points, triangles


def _read_other(file: pathlib.Path) -> tuple[np.ndarray, np.ndarray]:
    """Surface of any file pyvista reads."""
    import pyvista

    with silenced():
        data = pyvista.read(file)
        if isinstance(data, pyvista.MultiBlock):
            data = data.combine()
        surface = data.extract_surface(algorithm="dataset_surface").triangulate()
    triangles = np.array(surface.faces, dtype=np.int64).reshape(-1, 4)[:, 1:]
    return np.array(surface.points, dtype=float).reshape(-1, 3), triangles


def _read_stl(file: pathlib.Path, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Facets of an STL file, binary or text, three points each; a file cut short or with a wrong count is refused."""
    size = file.stat().st_size
    with open(file, "rb") as stream:
        head = stream.read(84)
        promised = int.from_bytes(head[80:84], "little") if len(head) == 84 else 0
        if not _is_text(head, size, promised, stream.read(1000)):
            held = max(size - 84, 0) // 50
            if promised != held:
                raise MeshError(
                    f"{where} holds {held} triangles where its header counts {promised}: it is cut short or no STL file. "
                    "Export it again."
                )
            if held > LIMIT:
                raise MeshError(too_large(where, held))
            stream.seek(84)
            facets = np.frombuffer(stream.read(50 * held), dtype=np.uint8).reshape(held, 50)
            points = facets[:, 12:48].copy().view("<f4").astype(float).reshape(-1, 3)
            return points, np.arange(3 * held).reshape(-1, 3)
        stream.seek(0)
        text = stream.read().lower()
    facets_said, ends = (len(re.findall(word, text)) for word in (rb"\bfacet\s", rb"\bendsolid\b"))
    corners = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    if not facets_said and not corners and ends == 0:
        raise MeshError(f"{where} holds no surface (0 triangles). Export the part as a triangle mesh (STL, OBJ, PLY).")
    if len(corners) != 3 * facets_said or ends == 0:
        raise MeshError(
            f"{where} holds {len(corners)} corners of {facets_said} facets"
            f"{'' if ends else ' and no line endsolid'}: it is cut short or no STL file. Export it again."
        )
    points = np.array(corners, dtype="S").astype(float).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3)


def _is_text(head: bytes, size: int, promised: int, more: bytes) -> bool:
    """Whether an STL file is text: not if it is as long as its binary header says, whatever that begins with."""
    if len(head) == 84 and size - 84 - 50 * promised in range(50) and promised:
        return False
    start = head + more
    return len(head) < 84 or (b"\0" not in start and (b"facet" in start.lower() or b"solid" in start[:80].lower()))


def too_large(where: str, n: int) -> str:
    """The message for a surface with more triangles than allowed."""
    return f"{where}: has {n} triangles; at most {LIMIT} are used. Export it with larger facets."
