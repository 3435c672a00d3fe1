"""How does ParaView read it? VTKHDF histories, VTU + PVD, CSV.

Rule: an exporter reads a `History` (or a history file) and writes one file under a temporary name, put in place by
`os.replace`: a full disk or a killed process never leaves a file that looks complete and is not. HDF5 files are made in
memory and written by Python, because the HDF5 library does not survive a full disk.

One transient VTKHDF file of type PolyData holds all rods: two-node line cells between neighbouring nodes. An element of
order p has p of them and p Gauss points, which lie one in each (zeros of P_p separate the Gauss-Lobatto nodes), so cell
fields are Gauss-point values as they are. Connectivity is stored once. Layout: VTKHDF 2.0 as read by vtkHDFReader (VTK 9.3
and later). Names of fields hold no '.' or '/'; units stand in the attributes of each dataset.
"""

from __future__ import annotations

import csv
import json
import os
import pathlib
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from .equilibrium.vibration import Modes
from .errors import CosseratError
from .history import History
from .mechanism import Hinge, Part
from .rod import Rod

if TYPE_CHECKING:
    import h5py
    import meshio
    import pyvista

UNITS = {
    "displacement": "m",
    "mode": "m",
    "velocity": "m/s",
    "d1": "-",
    "d2": "-",
    "d3": "-",
    "force": "N",
    "moment": "N m",
    "force_material": "N",
    "moment_material": "N m",
    "gamma": "-",
    "kappa": "1/m",
    "curvature": "1/m",
    "contact_force": "N/m",
    "margin": "-",
    "margin_of": "index",
    "radius": "m",
    "s": "m",
    "rod": "index",
}


@dataclass(frozen=True, eq=False)
class Fields:
    """Rods as line cells: points (T, N, 3), lines (M, 2), fields over nodes (T, N, ...) and over cells (T, M, ...)."""

    points: np.ndarray
    lines: np.ndarray
    point_data: dict[str, np.ndarray]
    cell_data: dict[str, np.ndarray]


def fields(history: History) -> Fields:
    """All rods of all states as line cells with their fields."""
    parts = [_rod_fields(history, rod, k) for k, rod in enumerate(history.model.rods)]
    first = np.cumsum([0, *(part.points.shape[1] for part in parts)])
    return Fields(
        np.concatenate([p.points for p in parts], axis=1),
        np.concatenate([p.lines + n for p, n in zip(parts, first[:-1], strict=True)]),
        {k: np.concatenate([p.point_data[k] for p in parts], axis=1) for k in parts[0].point_data},
        {k: np.concatenate([p.cell_data[k] for p in parts], axis=1) for k in parts[0].cell_data},
    )


def _rod_fields(history: History, rod: Rod, index: int) -> Fields:
    points, directors = history.positions(rod), history.directors(rod)
    T, N = points.shape[:2]
    s = history.nodes(rod)
    total = history.total_strains(rod)
    material, spatial = history.section_forces(rod), history.section_forces(rod, "spatial")
    strain = history.strains(rod)
    nodal = history.at_nodes(rod, spatial)
    cells = {
        "force": spatial[..., :3],
        "moment": spatial[..., 3:],
        "force_material": material[..., :3],
        "moment_material": material[..., 3:],
        "gamma": strain[..., :3],
        "kappa": strain[..., 3:],
        "curvature": np.hypot(total[..., 3], total[..., 4]),
        "rod": np.full((T, N - 1), index, dtype=np.int32),
    }
    nodes = {
        "displacement": points - rod.drawn(s),
        "d1": directors[..., 0],
        "d2": directors[..., 1],
        "d3": directors[..., 2],
        "force": nodal[..., :3],
        "moment": nodal[..., 3:],
        "curvature": np.linalg.norm(history.at_nodes(rod, total[..., 3:5]), axis=-1),
        "radius": np.tile(rod.radius_at(s), (T, 1)),
        "s": np.tile(s, (T, 1)),
        "rod": np.full((T, N), index, dtype=np.int32),
    }
    if history.dynamic:
        nodes["velocity"] = history.velocities(rod)[..., :3]
    if history.model.contacts:
        nodes["contact_force"] = history.line_force(rod)
    lines = np.stack([np.arange(N - 1), np.arange(1, N)], axis=1)
    return Fields(points, lines, nodes, cells)


def replace_file(path: pathlib.Path, write: Callable[[pathlib.Path], object]) -> None:
    """Let `write` make a file under a temporary name in the same folder, then put it in place; remove it if it fails."""
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    try:
        write(pathlib.Path(name))
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        pathlib.Path(name).unlink(missing_ok=True)
        raise


def write_history(
    history: History,
    path: str | os.PathLike[str],
    more: dict[str, np.ndarray] | None = None,
    about: dict[str, Any] | None = None,
) -> None:
    """Write all states as one transient VTKHDF file, with more point fields (T, N) over all rods and notes about them."""
    data = fields(history)
    rods = [
        {"name": rod.name, "outline": rod.sections[0][1].outline, "n_nodes": len(history.nodes(rod))}
        for rod in history.model.rods
    ]
    connectivity = {"Lines": (data.lines.ravel(), 2 * np.arange(len(data.lines) + 1))}
    points, notes = data.point_data | (more or {}), {"rods": rods} | (about or {})
    _write_vtkhdf(path, history.order, data.points, connectivity, points, data.cell_data, notes)


def write_parts(history: History, path: str | os.PathLike[str], parts: Sequence[Part] | None = None) -> None:
    """Write meshes and shapes of parts, moving with them, as one transient VTKHDF file; nothing if no part has one.

    parts: default those that hold a rod. A plane is drawn as wide as the longest rod is long.
    """
    extent = max(rod.length for rod in history.model.rods) / 2
    points: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    index: list[np.ndarray] = []
    names: list[str] = []
    n = 0
    for part in history.model.parts if parts is None else parts:
        X, faces = part.drawn_surface(extent)
        if not len(faces):
            continue
        poses = [part.pose(float(t)) for t in history.stroke_t]
        points.append(np.array([X @ R.T + c for R, c in poses]))
        triangles.append(faces + n)
        index.append(np.full(len(faces), len(names), dtype=np.int32))
        names.append(part.name)
        n += len(X)
    if not names:
        return
    faces = np.concatenate(triangles)
    connectivity = {"Polygons": (faces.ravel(), 3 * np.arange(len(faces) + 1))}
    cells = {"part": np.tile(np.concatenate(index), (len(history), 1))}
    _write_vtkhdf(path, history.order, np.concatenate(points, axis=1), connectivity, {}, cells, {"parts": names})


def _write_vtkhdf(
    path: str | os.PathLike[str],
    t: np.ndarray,
    points: np.ndarray,
    connectivity: dict[str, tuple[np.ndarray, np.ndarray]],
    point_data: dict[str, np.ndarray],
    cell_data: dict[str, np.ndarray],
    about: dict[str, Any],
) -> None:
    import h5py

    T, N = points.shape[:2]
    with h5py.File("memory", "w", libver=("earliest", "v110"), driver="core", backing_store=False) as file:
        file.attrs["cosserat_fem"] = json.dumps(about)
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        root.attrs.create("Type", np.bytes_("PolyData"))
        root["NumberOfPoints"] = np.array([N], dtype=np.int64)
        _put(root, "Points", points.astype(np.float64), "m")
        for kind in ("Vertices", "Lines", "Polygons", "Strips"):
            ids, offsets = connectivity.get(kind, (np.empty(0), np.zeros(1)))
            group = root.create_group(kind)
            group["NumberOfConnectivityIds"] = np.array([len(ids)], dtype=np.int64)
            group["NumberOfCells"] = np.array([len(offsets) - 1], dtype=np.int64)
            group["Offsets"] = offsets.astype(np.int64)
            group["Connectivity"] = ids.astype(np.int64)
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(T)
        steps["Values"] = np.asarray(t, dtype=float)
        steps["PartOffsets"] = np.zeros(T, dtype=np.int64)
        steps["NumberOfParts"] = np.ones(T, dtype=np.int64)
        steps["PointOffsets"] = N * np.arange(T, dtype=np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros((T, 4), dtype=np.int64)
        for kind, values in (("PointData", point_data), ("CellData", cell_data)):
            group, offsets = root.create_group(kind), steps.create_group(f"{kind}Offsets")
            for name, array in values.items():
                dtype = np.float32 if array.dtype.kind == "f" else array.dtype
                _put(group, name, array.astype(dtype), UNITS.get(name, "index"))
                offsets[name] = array.shape[1] * np.arange(T, dtype=np.int64)
        file.flush()
        image = file.id.get_file_image()
    replace_file(pathlib.Path(path), lambda temporary: temporary.write_bytes(image))


def _put(group: h5py.Group, name: str, array: np.ndarray, unit: str) -> None:
    """Store (T, N, ...) as (T * N, ...), compressed if it is worth it."""
    flat = array.reshape(-1, *array.shape[2:])
    options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if flat.size > 10_000 else {}
    group.create_dataset(name, data=flat, **options).attrs["unit"] = unit


@dataclass(frozen=True, eq=False)
class Stored:
    """A history file read back: times (T,), fields, and what the writer noted about it."""

    t: np.ndarray
    fields: Fields
    about: dict[str, Any]


def read_history(path: str | os.PathLike[str]) -> Stored:
    """Read a history or parts file. CosseratError if it is not one."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            root = file["VTKHDF"]
            T, N = int(root["Steps"].attrs["NSteps"]), int(root["NumberOfPoints"][0])
            kind, size = ("Lines", 2) if int(root["Lines/NumberOfCells"][0]) else ("Polygons", 3)
            cells = np.asarray(root[kind]["Connectivity"]).reshape(-1, size)

            def data(group: str, n: int) -> dict[str, np.ndarray]:
                values = root.get(group, {})
                return {k: np.asarray(v).reshape(T, n, *v.shape[1:]) for k, v in values.items()}

            stored = Fields(
                np.asarray(root["Points"]).reshape(T, N, 3), cells, data("PointData", N), data("CellData", len(cells))
            )
            about = json.loads(file.attrs["cosserat_fem"])
            return Stored(np.asarray(root["Steps/Values"]), stored, about)
    except FileNotFoundError:
        raise CosseratError(f"{os.fspath(path)}: there is no such file.") from None
    except (OSError, KeyError, ValueError, TypeError, IndexError):  # h5py's own words help nobody
        raise CosseratError(f"{os.fspath(path)}: is not a history file of this program, or is damaged.") from None


def to_pyvista(history: History, step: int = -1) -> pyvista.PolyData:
    """One state as pyvista PolyData with the fields of the history file."""
    import pyvista

    data = fields(history)
    step = range(len(history))[step]
    lines = np.column_stack([np.full(len(data.lines), 2), data.lines]).ravel()
    mesh = pyvista.PolyData(data.points[step], lines=lines)
    for name, values in data.point_data.items():
        mesh.point_data[name] = values[step]
    for name, values in data.cell_data.items():
        mesh.cell_data[name] = values[step]
    return mesh


def to_meshio(history: History, step: int = -1) -> meshio.Mesh:
    """One state as a meshio mesh with the fields of the history file."""
    return _meshio(fields(history), range(len(history))[step])


def _meshio(data: Fields, step: int) -> meshio.Mesh:
    import meshio

    cell = "line" if data.lines.shape[1] == 2 else "triangle"
    return meshio.Mesh(
        data.points[step],
        [(cell, data.lines)],
        point_data={k: v[step] for k, v in data.point_data.items()},
        cell_data={k: [v[step]] for k, v in data.cell_data.items()},
    )


def export_pvd(run: str | os.PathLike[str]) -> pathlib.Path:
    """Write a run folder's history as VTU files and a PVD for older ParaViews; return the PVD's path.

    Parts, if any, go into the same collection. Reads the files of the run folder only.
    """
    run = pathlib.Path(run)
    folder = run / "pvd"
    sources = [("rods", run / "history.vtkhdf")]
    if (run / "parts.vtkhdf").is_file():
        sources.append(("parts", run / "parts.vtkhdf"))
    stored = [(name, read_history(path)) for name, path in sources]
    folder.mkdir(exist_ok=True)
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    for part, (name, data) in enumerate(stored):
        for step, t in enumerate(data.t):
            file = folder / f"{name}_{step:05d}.vtu"
            mesh = _meshio(data.fields, step)
            replace_file(file, partial(mesh.write, file_format="vtu"))
            attributes = {"timestep": repr(float(t)), "group": "", "part": str(part), "file": f"pvd/{file.name}"}
            ET.SubElement(collection, "DataSet", attributes)
    ET.indent(root)
    path = run / "history.pvd"
    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    replace_file(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return path


def write_csv(path: str | os.PathLike[str], header: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Write a table with all digits."""

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(
                [[repr(float(x)) if isinstance(x, float | np.floating) else x for x in row] for row in rows]
            )

    replace_file(pathlib.Path(path), write)


def write_reactions(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of force [N] and moment [N m] of every support on its rod, in space, about the supported point."""
    loads = [(str(h.name), history.reaction(h)) for h in history.model.supports]
    rows = [[t, name, *load[k]] for k, t in enumerate(history.order) for name, load in loads]
    write_csv(path, [_first_column(history), "support", "Fx", "Fy", "Fz", "Mx", "My", "Mz"], rows)


def write_json(data: Any, path: str | os.PathLike[str]) -> None:
    """Write a JSON file."""
    text = json.dumps(data, indent=2) + "\n"
    replace_file(pathlib.Path(path), lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_hinge_torque(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of the torque [N m] that each hinge's drive must supply, against time [s] and angle [deg], and the sense in which
    it turned to come there (1, -1; 0 if it never turns)."""
    rows = []
    for part in hinged_parts(history):
        angles, torque = np.degrees(history.hinge_angle(part)), history.hinge_torque(part)
        sense = history.hinge_sense(part).tolist()
        rows += [[t, part.name, a, m, d] for t, a, m, d in zip(history.order, angles, torque, sense, strict=True)]
    write_csv(path, [_first_column(history), "part", "angle_deg", "torque", "sense"], rows)


def _first_column(history: History) -> str:
    """What increases from row to row."""
    return "station" if history.path else "time"


def write_path(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of a path: factor of its loads, time [s], negative eigenvalues of the tangent (-1: not known), strain energy [J],
    and for each rod the largest displacement [m] since the first station."""
    moved = {}
    for rod in history.model.rods:
        r = history.positions(rod)
        moved[rod.name] = np.linalg.norm(r - r[0], axis=2).max(axis=1)
    columns = zip(history.factors, history.t, history.energy, *moved.values(), strict=True)
    rows = [[k, f, t, history.records[k].negative, e, *m] for k, (f, t, e, *m) in enumerate(columns)]
    names = ["station", "factor", "time", "negative", "energy", *(f"displacement of {name}" for name in moved)]
    write_csv(path, names, rows)


def write_modes(found: Modes, path: str | os.PathLike[str]) -> None:
    """CSV of vibrations: frequency [Hz], omega [rad/s], rate of growth [1/s]."""
    rows = [[k + 1, *row] for k, row in enumerate(zip(found.frequency, found.omega, found.growth, strict=True))]
    write_csv(path, ["mode", "frequency", "omega", "growth"], rows)


def write_shapes(found: Modes, path: str | os.PathLike[str]) -> None:
    """Write the shapes of vibrations as one VTKHDF file, a step for each: `mode` moves the nodes (Warp By Vector)."""
    state, space = found.state, found.model.space
    nodes = np.concatenate([space[rod].nodes for rod in found.model.rods])
    first = np.cumsum([0, *(len(space[rod].nodes) for rod in found.model.rods)])
    lines = np.concatenate(
        [np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1) for a, b in pairwise(first.tolist())]
    )
    n = len(found.squared)
    points = np.tile(state.r[nodes], (n, 1, 1))
    connectivity = {"Lines": (lines.ravel(), 2 * np.arange(len(lines) + 1))}
    about = {"modes": [{"frequency": f, "growth": g} for f, g in zip(found.frequency, found.growth, strict=True)]}
    moved = {"mode": found.shapes[:, nodes, :3]}
    _write_vtkhdf(path, np.arange(1.0, n + 1), points, connectivity, moved, {}, about)


def write_contacts(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of when and where each contact touches: times [s] of the first and last station, peak line force [N/m], when and
    where [m], stretch of the rod [m], smallest gap [m], work lost by friction [J]."""
    rows = [
        [e.begin, e.end, e.name, e.rod, e.other, e.peak, e.peak_t, e.peak_s, e.s0, e.s1, e.gap, e.lost]
        for e in history.contacts()
    ]
    names = ["peak_force", "peak_time", "peak_s", "s0", "s1", "gap", "friction_work"]
    write_csv(path, ["time_in", "time_out", "contact", "rod", "other", *names], rows)


def write_contact_loads(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of each contact over time: force [N] and moment [N m] on its part, about the part's origin, in space; torque
    [N m] that the drive of the part's hinge must supply for it; smallest gap [m], empty if nothing is near; work lost by
    friction since the start [J]. Rods that touch each other have no part: their load is a zero sum."""
    columns = []
    for term in history.model.contacts:
        part: Part | None = getattr(term, "part", None)
        load: Any = [[""] * 6] * len(history)
        torque: Any = [""] * len(history)
        if part is not None:
            load = history.contact_load(part, term.name)
            torque = history.contact_torque(part, term.name) if isinstance(part.motion, Hinge) else torque
        columns.append((term.name, "" if part is None else part.name, load, torque, history.pressed(term.name)))
    rows = [
        [t, name, part, *load[k], torque[k], told[k].gap if np.isfinite(told[k].gap) else "", told[k].lost]
        for k, t in enumerate(history.t)
        for name, part, load, torque, told in columns
    ]
    names = ["Fx", "Fy", "Fz", "Mx", "My", "Mz", "hinge_torque", "gap", "friction_work"]
    write_csv(path, ["time", "contact", "part", *names], rows)


def write_ledger(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of energies, works and momenta of a run in time: time [s], [J], [kg m/s], [kg m^2/s] about the origin."""
    ledger = history.ledger
    linear, angular = history.momentum
    names = [*ledger, *(f"p{c}" for c in "xyz"), *(f"L{c}" for c in "xyz")]
    rows = np.column_stack([history.t, *ledger.values(), linear, angular])
    write_csv(path, ["time", *names], rows.tolist())


def write_steps(history: History, path: str | os.PathLike[str]) -> None:
    """CSV of every step of a run in time: its end and length [s], its error in parts of the allowed one, 1 if accepted."""
    write_csv(path, ["time", "length", "error", "accepted"], [(t, h, e, int(a)) for t, h, e, a in history.steps])


def hinged_parts(history: History) -> list:
    """Parts of the model that turn on a hinge."""
    return [part for part in history.model.parts if isinstance(part.motion, Hinge)]
