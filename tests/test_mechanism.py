"""Parts and their motion; reading surfaces."""

import numpy as np
import pytest

import cosserat_fem as cf


def rotate(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_hinge_turns_about_its_axis():
    """Points of the axis stay; the turn is right-handed; at angle 0 a part stands as drawn."""
    part = cf.Part("door", motion=cf.Hinge((1, 2, 0), (0, 0, 3), np.radians(10)))
    R, c = part.pose(9.0)
    np.testing.assert_allclose(R, rotate(np.pi / 2), atol=1e-15)
    np.testing.assert_allclose(R @ (1, 2, 5) + c, (1, 2, 5), atol=1e-15)
    np.testing.assert_allclose(R @ (2, 2, 0) + c, (1, 3, 0), atol=1e-15)
    R, c = part.pose(0.0)
    np.testing.assert_allclose(R, np.eye(3))
    np.testing.assert_allclose(c, 0)


def test_hinge_keeps_whole_turns():
    """An angle is a number, not a rotation: 20 pi is ten turns, taken in quarter turns."""
    part = cf.Part("p", motion=cf.Hinge((0, 0, 0), (1, 0, 0), ([0, 1], [0, 20 * np.pi])))
    assert part.stages(0, 1) == 40
    assert part.motion.angle_at(0.5) == pytest.approx(10 * np.pi)


def test_slider():
    R, c = cf.Part("p", motion=cf.Slider((0, 3, 4), 0.1)).pose(2.0)
    np.testing.assert_allclose(c, 0.2 * np.array([0, 0.6, 0.8]))
    np.testing.assert_allclose(R, np.eye(3))


def test_path_counts_from_its_first_row():
    """Only the change of the given frame matters: a frame that is anywhere and turned anyhow moves the part alike."""
    angle = np.radians(60)
    q = [(np.cos(a / 2), 0, 0, np.sin(a / 2)) for a in (0.4, 0.4 + angle)]
    places = [(3, 1, 0), (3 + 1, 1, 0)]
    part = cf.Part("p", motion=cf.Path(([0, 2], places, q)))
    R, c = part.pose(0.0)
    np.testing.assert_allclose(np.column_stack([R, c]), np.column_stack([np.eye(3), np.zeros(3)]), atol=1e-15)
    R, c = part.pose(1.0)
    np.testing.assert_allclose(R, rotate(angle / 2), atol=1e-14)
    np.testing.assert_allclose(R @ places[0] + c, (3.5, 1, 0), atol=1e-14)
    same = cf.Part(
        "q",
        motion=cf.Path(
            lambda t: (np.array([3 + t / 2, 1, 0]), (np.cos(0.2 + angle * t / 4), 0, 0, np.sin(0.2 + angle * t / 4)))
        ),
    )
    np.testing.assert_allclose(same.pose(1.0)[0], R, atol=1e-14)
    np.testing.assert_allclose(same.pose(1.0)[1], c, atol=1e-14)


def test_path_sign_of_quaternions_does_not_matter():
    q = np.array([(1, 0, 0, 0), (np.cos(0.3), 0, 0, np.sin(0.3)), (np.cos(0.6), 0, 0, np.sin(0.6))])
    plain = cf.Path((np.arange(3), np.zeros((3, 3)), q))
    flipped = cf.Path((np.arange(3), np.zeros((3, 3)), q * np.array([[1], [-1], [1]])))
    for t in (0.5, 1.0, 1.7):
        np.testing.assert_allclose(plain.pose(t)[0], flipped.pose(t)[0], atol=1e-14)
        np.testing.assert_allclose(plain.pose(t)[0], rotate(0.6 * t), atol=1e-14)


def test_path_from_csv(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0.5,0,0,1,0,0,0\n")
    np.testing.assert_allclose(cf.Path.read(file).pose(0.5)[1], (0.25, 0, 0))
    file.write_text("qx,qy,qz,qw,time,z,y,x\n0,0,0,1,0,0,0,0\n0,0,0,1,1,0,0,0.5\n")
    np.testing.assert_allclose(cf.Path.read(file).pose(0.5)[1], (0.25, 0, 0))
    for text, message in (
        ("0,0,0\n1,0.5,0\n", "row 1: has 3 cells, not the 8 columns time, x, y, z, qw, qx, qy, qz"),
        ("time,x\n0,abc\n", "row 1: has 2 cells"),
        ("", "holds no row of numbers"),
        ("0,0,0,0,1,0,0,0\n1,0,0,0,2,0,0,0\n", "quaternion 1 has length 2"),
        ("0,0,0,0,1,0,0,0\n0,0,0,0,1,0,0,0\n", "times must increase"),
    ):
        file.write_text(text)
        with pytest.raises(cf.MeshError, match=f"path: motion file '.*motion.csv'.*{message}"):
            cf.Path.read(file)
    with pytest.raises(cf.MeshError, match="motion file '.*none.csv' does not exist"):
        cf.Path.read(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cf.Hinge((0, 0, 0), (0, 0, 0), 1.0), "hinge: axis: has zero length"),
        (lambda: cf.Hinge((0, 0), (0, 0, 1), 1.0), "hinge: point: must have shape"),
        (lambda: cf.Slider((0, 0, 0), 1.0), "slider: axis: has zero length"),
        (lambda: cf.Path(([0, 1], np.zeros((2, 3)), [(1, 0, 0, 0), (2, 0, 0, 0)])), "quaternion 1 has length 2"),
        (lambda: cf.Path(3), "give .times, positions, quaternions. or a function"),
        (lambda: cf.Part(""), "name must be a non-empty string"),
        (lambda: cf.Part("a/b"), "without '/'"),
        (lambda: cf.Part("a", mesh_unit=0), "mesh_unit: must be greater than 0"),
    ],
)
def test_bad_motion(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_table_too_short_names_the_part():
    part = cf.Part("door", motion=cf.Hinge((0, 0, 0), (0, 0, 1), ([0, 1], [0, 1])))
    with pytest.raises(ValueError, match="part 'door': hinge: angle: the table runs from 0 s to 1 s"):
        part.pose(1.5)


def save(path, points, faces):
    import pyvista as pv

    mesh = pv.PolyData(np.asarray(points, dtype=float), np.column_stack([np.full(len(faces), 3), faces]).ravel())
    mesh.save(path, recompute_normals=False)  # facets as they are


TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def volume(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return (a * np.cross(b, c)).sum() / 6


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "vtp"])
def test_surface_is_read_and_flipped_facets_repaired(tmp_path, suffix):
    file = tmp_path / f"t.{suffix}"
    faces = FACES.copy()
    faces[1] = faces[1][::-1]
    save(file, TETRAHEDRON, faces)
    part = cf.Part("p", file, 1e-3)
    surface = part.surface()
    assert surface is part.surface()  # read once
    assert surface.closed and len(surface.points) == 4
    assert surface.report == ("1 flipped triangle turned",)
    assert volume(*part.drawn_surface()) == pytest.approx(1e-9 / 6)  # outwards, and in millimetres


def test_open_surfaces_are_taken_as_they_are(tmp_path):
    """Holes and fins are no fault: the surface says so, and is drawn."""
    cases = {
        "open.stl": (TETRAHEDRON, FACES[:3], "not watertight (3 open edges of 3 triangles)"),
        "fin.stl": ([*TETRAHEDRON, (0.5, -1, 0.2)], np.vstack([FACES, [(0, 1, 4)]]), "1 edge shared by more than two"),
    }
    for name, (points, faces, message) in cases.items():
        save(tmp_path / name, points, faces)
        part = cf.Part("p", tmp_path / name)
        assert not part.surface().closed
        assert any(message in note for note in part.surface().report)
        assert len(part.drawn_surface()[1]) == len(faces)


def test_mesh_and_shapes_are_drawn_together(tmp_path):
    save(tmp_path / "t.stl", TETRAHEDRON, FACES)
    part = cf.Part("p", tmp_path / "t.stl", shape=cf.Box((5, 0, 0), (1, 1, 1)))
    assert volume(*part.drawn_surface()) == pytest.approx(1 / 6 + 1)
    assert len(part.surface().triangles) == 4


def test_bad_surfaces(tmp_path, capfd):
    """Each: one clear sentence; nothing silently accepted."""
    save(tmp_path / "whole.stl", TETRAHEDRON, FACES)
    (tmp_path / "text.stl").write_text("this is not a mesh\n")
    (tmp_path / "empty.stl").write_text("")
    (tmp_path / "empty.ply").write_text("")
    (tmp_path / "cut.stl").write_bytes((tmp_path / "whole.stl").read_bytes()[:140])
    capfd.readouterr()
    for name, message in (
        ("text.stl", "holds no surface"),
        ("empty.stl", "holds no surface"),
        ("empty.ply", "holds no surface|cannot be read"),
        ("cut.stl", "holds 1 triangles where its header counts 4"),
    ):
        with pytest.raises(cf.MeshError, match=f"part 'p': mesh file '.*{name}'.*{message}"):
            cf.Part("p", tmp_path / name).surface()
    assert capfd.readouterr() == ("", "")  # the fault is said once, by us
    (tmp_path / "some.xyz").write_text("1 2 3\n")
    with pytest.raises(cf.MeshError, match="cannot be read as a surface"):
        cf.Part("p", tmp_path / "some.xyz").surface()
    with pytest.raises(cf.MeshError, match="does not exist"):
        cf.Part("p", tmp_path / "none.stl").drawn_surface()
    with pytest.raises(cf.MeshError, match="has no mesh"):
        cf.Part("p").surface()
