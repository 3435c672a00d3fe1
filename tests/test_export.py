"""Files read back: VTKHDF by VTK's own reader, PVD and VTU, CSV; nothing half-written."""

import csv

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem import export


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two rods of different order on a hinge with a mesh, three states, written as in a run folder."""
    folder = tmp_path_factory.mktemp("run")
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
    import pyvista as pv

    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    pv.PolyData(points, np.column_stack([np.full(4, 3), faces]).ravel()).save(folder / "part.stl")
    section = cf.Section.rectangle(0.02, 0.01, youngs_modulus=1e7)
    a = cf.Rod("a", section, [(0.2, 0, 0), (0.8, 0.2, 0), (1.2, 0, 0.1)], n_elements=30, order=3)
    b = cf.Rod("b", cf.Section.round(0.01, youngs_modulus=1e7), [(0.2, 1, 0), (1.2, 1, 0)], n_elements=7, order=1)
    arm = cf.Part("arm", folder / "part.stl", 0.1, cf.Hinge((0, 0, 0), (0, 0, 1), np.radians(20)))
    supports = [cf.Clamp(a, "start", to=arm), cf.Clamp(b, "start"), cf.Clamp(b, "end", to=arm)]
    model = cf.Model([a, b], supports, [cf.PointLoad(a, "end", force=(0, 0, -0.5))])
    history = cf.solve_quasistatic(model, [0.0, 0.5, 1.0])
    export.write_history(history, folder / "history.vtkhdf")
    export.write_parts(history, folder / "parts.vtkhdf")
    export.write_reactions(history, folder / "reactions.csv")
    export.write_hinge_torque(history, folder / "hinge_torque.csv")
    return folder, history


def vtk_step(path, step):
    """One state of a transient VTKHDF file through VTK's reader."""
    import pyvista as pv
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    return pv.wrap(reader.GetOutput()).copy(), reader.GetNumberOfSteps()


def test_history_reads_back(run):
    """Every state, point and field through VTK's own reader; compressed, because the data is large enough."""
    import h5py

    folder, history = run
    data = export.fields(history)
    for step in range(3):
        mesh, n_steps = vtk_step(folder / "history.vtkhdf", step)
        assert n_steps == 3
        assert mesh.n_lines == len(data.lines)
        np.testing.assert_allclose(mesh.points, data.points[step], rtol=1e-15)
        for name, values in data.point_data.items():
            np.testing.assert_allclose(mesh.point_data[name], values[step].astype(np.float32), err_msg=name)
        for name, values in data.cell_data.items():
            np.testing.assert_allclose(mesh.cell_data[name], values[step].astype(np.float32), err_msg=name)
    with h5py.File(folder / "history.vtkhdf") as file:
        np.testing.assert_allclose(file["VTKHDF/Steps/Values"], history.t)
        assert file["VTKHDF/CellData/force"].attrs["unit"] == "N"


def test_large_history_is_compressed_and_readable(tmp_path):
    section = cf.Section.round(0.01, youngs_modulus=1e7)
    rod = cf.Rod("a", section, [(0, 0, 0), (1, 0, 0)], n_elements=1500, order=3)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, 0, -1e-3))])
    history = cf.solve_static(model)
    export.write_history(history, tmp_path / "h.vtkhdf")
    import h5py

    with h5py.File(tmp_path / "h.vtkhdf") as file:
        assert file["VTKHDF/Points"].compression == "gzip"
    mesh, _ = vtk_step(tmp_path / "h.vtkhdf", 0)
    np.testing.assert_allclose(mesh.points, history.positions(rod)[0])


def test_cells_hold_gauss_points(run):
    """Cell fields are Gauss-point values as they are: forces of the cell between two nodes."""
    _, history = run
    data = export.fields(history)
    n = len(history.stations("a"))
    np.testing.assert_allclose(data.cell_data["force"][:, :n], history.section_forces("a", "spatial")[..., :3])
    ends = data.points[:, data.lines]
    s = data.point_data["s"][0][data.lines]
    stations = np.concatenate([history.stations("a"), history.stations("b")])
    assert ((s[:, 0] < stations) & (stations < s[:, 1])).all()
    assert ends.shape[2] == 2


def test_parts_move(run):
    folder, history = run
    mesh, n_steps = vtk_step(folder / "parts.vtkhdf", 2)
    assert n_steps == 3
    angle = np.radians(20)
    expected = 0.1 * np.array([np.cos(angle), np.sin(angle), 0])
    assert np.linalg.norm(mesh.points - expected, axis=1).min() < 1e-7
    assert mesh.n_cells == 4
    assert (mesh.cell_data["part"] == 0).all()


def test_parts_that_hold_nothing_are_written_if_given(run, tmp_path):
    folder, history = run
    idle = cf.Part("idle", folder / "part.stl")
    export.write_parts(history, tmp_path / "parts.vtkhdf", [*history.model.parts, idle])
    stored = export.read_history(tmp_path / "parts.vtkhdf")
    assert stored.about["parts"] == ["arm", "idle"]
    assert stored.fields.points.shape == (3, 8, 3)
    np.testing.assert_allclose(stored.fields.points[2, 4:].max(axis=0), 1)


def test_shapes_are_drawn(run, tmp_path):
    """A part without a mesh is seen by its shapes; a plane by a square as wide as the longest rod."""
    _, history = run
    plane = cf.Part("floor", shape=cf.Plane((0, 0, -1), (0, 0, 1)))
    export.write_parts(
        history, tmp_path / "parts.vtkhdf", [plane, cf.Part("bare"), cf.Part("b", shape=cf.Sphere((0, 0, 0), 1))]
    )
    stored = export.read_history(tmp_path / "parts.vtkhdf")
    assert stored.about["parts"] == ["floor", "b"]
    width = max(rod.length for rod in history.model.rods)
    np.testing.assert_allclose(np.ptp(stored.fields.points[0, :4], axis=0), (width, width, 0), atol=1e-7)
    assert (stored.fields.cell_data["part"][0] == 0).sum() == 2


def test_stored_history_equals_fields(run):
    folder, history = run
    stored = export.read_history(folder / "history.vtkhdf")
    data = export.fields(history)
    np.testing.assert_allclose(stored.fields.points, data.points)
    np.testing.assert_array_equal(stored.fields.lines, data.lines)
    assert [rod["name"] for rod in stored.about["rods"]] == ["a", "b"]
    assert stored.about["rods"][0]["outline"] == [0.02, 0.01]


def test_not_a_history(tmp_path):
    (tmp_path / "x.vtkhdf").write_text("nothing")
    with pytest.raises(cf.CosseratError, match=r"x.vtkhdf: is not a history file of this program, or is damaged.$"):
        export.read_history(tmp_path / "x.vtkhdf")
    with pytest.raises(cf.CosseratError, match="there is no such file"):
        export.read_history(tmp_path / "none.vtkhdf")


def test_pvd(run):
    """The collection names a file for each state and kind; each reads back with times and fields."""
    import pyvista as pv

    folder, history = run
    path = export.export_pvd(folder)
    reader = pv.get_reader(path)
    np.testing.assert_allclose(reader.time_values, history.t)
    reader.set_active_time_value(1.0)
    rods, parts = reader.read()
    np.testing.assert_allclose(rods.points, export.fields(history).points[2], atol=1e-15)
    np.testing.assert_allclose(
        rods.cell_data["moment"], export.fields(history).cell_data["moment"][2], rtol=1e-6, atol=1e-12
    )
    assert parts.n_cells == 4


def test_csv(run):
    """All digits; columns as documented; the torque is that of the history."""
    folder, history = run
    with open(folder / "reactions.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time", "support", "Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    assert len(rows) == 9
    found = np.array(
        [[float(r[c]) for c in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")] for r in rows if r["support"] == "a.start@arm"]
    )
    np.testing.assert_array_equal(found, history.reaction("a.start@arm"))
    with open(folder / "hinge_torque.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time", "part", "angle_deg", "torque", "sense"]
    np.testing.assert_array_equal([float(r["torque"]) for r in rows], history.hinge_torque("arm"))
    np.testing.assert_allclose([float(r["angle_deg"]) for r in rows], [0, 10, 20])


def test_to_pyvista_and_meshio(run):
    _, history = run
    mesh, other = cf.to_pyvista(history), cf.to_meshio(history, 0)
    assert mesh.n_lines == 97
    np.testing.assert_allclose(other.points, export.fields(history).points[0])
    assert set(other.cell_data) == set(mesh.cell_data.keys())


def test_interrupted_write_leaves_the_old_file(tmp_path):
    """A failed write keeps what was there and leaves nothing else behind."""
    path = tmp_path / "x.txt"
    path.write_text("old")

    def fail(temporary):
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        export.replace_file(path, fail)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["x.txt"]


@pytest.fixture(scope="module")
def touching(tmp_path_factory):
    """A bar that an arm's post is pushed into, two states of three; a second part is never near."""
    section = cf.Section.round(0.004, youngs_modulus=50e6, poisson_ratio=0.4)
    rod = cf.Rod("bar", section, [(0, 0, 0), (0.2, 0, 0)], n_elements=8)
    post = cf.Cylinder((0.1, 0.012, -0.05), (0.1, 0.012, 0.05), 0.008)
    arm = cf.Part("arm", motion=cf.Hinge((0.03, 0.08, 0), (0, 0, 1), ([0, 2], np.radians([0.0, -5.0]))), shape=post)
    wall = cf.Part("wall", shape=cf.Plane((0, -1, 0), (0, 1, 0)))
    contacts = [cf.PartContact(rod, arm, friction=0.3), cf.PartContact(rod, wall)]
    history = cf.solve_quasistatic(
        cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], contacts), [0.0, 1.0, 2.0]
    )
    return tmp_path_factory.mktemp("touching"), history


def test_contact_tables(touching):
    """When and where; what it does to each part, with empty cells for what there is not."""
    folder, history = touching
    export.write_contacts(history, folder / "contacts.csv")
    export.write_contact_loads(history, folder / "contact_loads.csv")
    with open(folder / "contacts.csv", newline="") as file:
        [row] = list(csv.DictReader(file))
    [event] = history.contacts()
    assert list(row) == [
        "time_in", "time_out", "contact", "rod", "other",
        "peak_force", "peak_time", "peak_s", "s0", "s1", "gap", "friction_work",
    ]  # fmt: skip
    assert (row["contact"], row["rod"], row["other"]) == ("bar-arm", "bar", "arm")
    assert float(row["peak_force"]) == event.peak > 0
    assert (float(row["time_in"]), float(row["time_out"])) == (1.0, 2.0)
    with open(folder / "contact_loads.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["time"], row["contact"], row["part"]) for row in rows[:3]] == [
        ("0.0", "bar-arm", "arm"), ("0.0", "bar-wall", "wall"), ("1.0", "bar-arm", "arm"),
    ]  # fmt: skip
    found = np.array([[float(row[c]) for c in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")] for row in rows[::2]])
    np.testing.assert_array_equal(found, history.contact_load("arm"))
    np.testing.assert_array_equal([float(row["hinge_torque"]) for row in rows[::2]], history.contact_torque("arm"))
    assert {row["hinge_torque"] for row in rows[1::2]} == {row["gap"] for row in rows[1::2]} == {""}
    assert float(rows[-2]["friction_work"]) == history.friction_work("bar-arm")[-1] > 0


def test_line_force_is_a_field_of_scenes_with_contact(touching, run):
    folder, history = touching
    export.write_history(history, folder / "history.vtkhdf")
    mesh, _ = vtk_step(folder / "history.vtkhdf", 2)
    np.testing.assert_allclose(mesh.point_data["contact_force"], history.line_force("bar")[2], rtol=1e-6)
    assert np.abs(mesh.point_data["contact_force"]).max() > 1
    assert "contact_force" not in export.fields(run[1]).point_data
    assert "contact_force" in export.UNITS
