"""Rods: drawn curve, sections along s, elements, files."""

import numpy as np
import pytest

import cosserat_fem as cf

SECTION = cf.Section.round(0.01, youngs_modulus=1e9)


def test_places_and_lengths():
    """s is measured on the unstressed rod; the drawing may be longer or shorter."""
    rod = cf.Rod("r", SECTION, [(0, 0, 0), (2, 0, 0)], length=1.0)
    assert rod.drawn_length == 2.0
    assert rod.place("end", "x") == 1.0
    np.testing.assert_allclose(rod.drawn(np.array([0.25])), [(0.5, 0, 0)])
    with pytest.raises(ValueError, match="at = 1.2 m is not on rod 'r', which runs from 0 to 1 m"):
        rod.place(1.2, "clamp")
    with pytest.raises(ValueError, match="at must be 'start', 'end' or an arc length"):
        rod.place("middle", "clamp")


def test_section_table_is_linear_with_steps():
    soft, hard = SECTION, cf.Section.round(0.02, youngs_modulus=1e9, density=100)
    rod = cf.Rod("r", [(0, soft), (0.5, soft), (0.5, hard), (1, soft)], [(0, 0, 0), (1, 0, 0)])
    C, mass, _ = rod.section_at(np.array([0.2, 0.4999, 0.5001, 0.75]))
    EI = C[:, 3, 3]
    a, b = soft.moment_stiffness[0], hard.moment_stiffness[0]
    np.testing.assert_allclose(EI, [a, a, b + (a - b) * 2e-4, (a + b) / 2], rtol=1e-12)
    assert mass[3] == pytest.approx(hard.mass_per_length / 2)
    assert 0.5 in rod.element_ends()


def test_section_as_function():
    rod = cf.Rod("r", lambda s: cf.Section.round(0.01 + 0.01 * s, youngs_modulus=1e9), [(0, 0, 0), (1, 0, 0)])
    C, _, _ = rod.section_at(np.array([0.5]))
    assert C[0, 2, 2] == pytest.approx(1e9 * np.pi * 0.015**2 / 4, rel=1e-4)


def test_element_ends():
    """Uniform by default; marks get a node, moved there if one is near, made if not; layers refine both ends."""
    rod = cf.Rod("r", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=10)
    np.testing.assert_allclose(rod.element_ends(), np.linspace(0, 1, 11))
    ends = rod.element_ends([0.31, 0.55, 0.0, 1.0])
    assert len(ends) == 12
    assert 0.31 in ends
    assert 0.55 in ends
    graded = cf.Rod("r", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=20, layer=0.01).element_ends([0.4])
    h = np.diff(graded)
    assert len(h) in (20, 21)
    assert h[0] < 0.01
    assert h[-1] < 0.01
    assert h.max() > 0.05
    k = int(np.argmin(abs(graded - 0.4)))
    assert h[k - 1] < 0.02
    assert h[k] < 0.02
    assert (h > 0).all()


def test_rest_shapes():
    s = np.array([0.0, 0.25, 1.0])
    straight = [(0, 0, 0), (1, 0, 0)]
    constant = cf.Rod("r", SECTION, straight, rest=(1, 2, 3))
    np.testing.assert_allclose(constant.rest_curvature(s), np.tile((1, 2, 3), (3, 1)))
    array = cf.Rod("r", SECTION, straight, rest=[(0, 0, 0), (2, 4, 6)])
    np.testing.assert_allclose(array.rest_curvature(s), np.outer(s, (2, 4, 6)))
    function = cf.Rod("r", SECTION, straight, rest=lambda x: (x, 0, x**2))
    np.testing.assert_allclose(function.rest_curvature(s), np.stack([s, 0 * s, s**2], axis=-1))


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_unloaded_curved_rod_carries_exactly_zero_force(order):
    """A rod that is stress-free as drawn, in space and twisted, held at both ends: no force, no moment, no strain."""
    points = [(0, 0, 0), (0.3, 0.4, 0), (0.5, 0.1, 0.4), (1, 0, 0.3)]
    rod = cf.Rod("r", SECTION, points, order=order, n_elements=6, rest="as_drawn", end_normal=(0, 1, 1))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")])
    total = model.residual(model.initial_state())
    assert abs(total.g).max() == 0.0
    history = cf.solve_static(model)
    assert abs(history.section_forces(rod)).max() < 1e-9 * SECTION.force_stiffness[2] * 1e-3
    assert history.counters.iterations == 1


def test_as_drawn_is_scaled_to_the_length():
    """Drawn twice as large as the stress-free rod: released, it is a half-size copy of the drawing."""
    a = np.linspace(0, 1.5, 30)
    points = 2.0 * np.stack([np.sin(a), 1 - np.cos(a), 0 * a], axis=-1)
    rod = cf.Rod("r", SECTION, points, length=1.5, rest="as_drawn", order=4)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")]))
    np.testing.assert_allclose(history.positions(rod)[0, -1], points[-1] / 2, atol=1e-6)
    assert abs(history.strains(rod)).max() < 1e-8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length": 0.0}, "rod 'r': length: must be greater than 0"),
        ({"length": np.nan}, "length: must be a finite number"),
        ({"n_elements": 0}, "n_elements: must be an integer from 1 to 2000000"),
        ({"n_elements": 2_000_001}, r"n_elements: must be an integer from 1 to 2000000 \(got 2000001\)"),
        ({"n_elements": 2.5}, "n_elements: must be an integer"),
        ({"order": 7}, "order: must be an integer from 1 to 6"),
        ({"rest": "bent"}, "rest must be 'straight', 'as_drawn', numbers or a function"),
        ({"rest": (1, 2)}, "rest: must have shape"),
        ({"layer": -1.0}, "layer: must be greater than 0"),
        ({"normal": (1, 0, 0)}, "rod 'r': normal: is parallel to the tangent"),
        ({"normal": (0, 0, 0)}, "has zero length"),
        ({"start_tangent": (0, 0, 0)}, "rod 'r': start_tangent: has zero length"),
        ({"section": 3}, "section must be a Section"),
        ({"section": [(0, SECTION), (0.5, SECTION)]}, "must run from s = 0 to s = 1 m"),
        ({"section": [(0.5, SECTION), (0, SECTION)]}, "must not decrease"),
        ({"name": ""}, "name must be a non-empty string"),
    ],
)
def test_bad_rod(change, message):
    given = {"name": "r", "section": SECTION, "points": [(0, 0, 0), (1, 0, 0)]} | change
    with pytest.raises(ValueError, match=message):
        cf.Rod(given.pop("name"), given.pop("section"), given.pop("points"), **given)


def test_read_csv(tmp_path):
    file = tmp_path / "route.csv"
    file.write_text("x,y,z\n0,0,0\n10,0,0\n20,5,0\n")
    rod = cf.Rod.read(file, "r", SECTION, unit=1e-3, n_elements=3)
    np.testing.assert_allclose(rod.points[-1], (0.02, 0.005, 0))
    for text, message in (
        ("x,y\n1,2\n", "row 1: has 2 cells, not the 3 columns x, y, z"),
        ("a\nb\n", "row 1: has 1 cell, not the 3 columns x, y, z"),
        ("", "holds no row of numbers; it needs the columns x, y, z"),
        ("0,0,0\n", "at least two points"),
        ("0,0,0\nnan,0,0\n", "finite"),
    ):
        file.write_text(text)
        with pytest.raises(cf.MeshError, match=message):
            cf.Rod.read(file, "r", SECTION)
    with pytest.raises(cf.MeshError, match="rod 'r': curve file .* does not exist"):
        cf.Rod.read(tmp_path / "none.csv", "r", SECTION)


@pytest.mark.parametrize("kind", ["vtu", "msh", "vtk", "vtp"])
def test_read_line_mesh(tmp_path, kind):
    """Edges in any order and direction come back as one curve from end to end."""
    points = np.array([(0, 0, 0), (3, 1, 0), (1, 0, 0), (2, 0.5, 0)], dtype=float)
    edges = np.array([(3, 2), (0, 2), (1, 3)])
    file = tmp_path / f"route.{kind}"
    if kind in ("vtk", "vtp"):
        import pyvista as pv

        pv.PolyData(points, lines=np.column_stack([np.full(3, 2), edges]).ravel()).save(file)
    else:
        import meshio

        meshio.write(file, meshio.Mesh(points, [("line", edges)]), "gmsh" if kind == "msh" else kind)
    found = cf.Rod.read(file, "r", SECTION).points
    np.testing.assert_allclose(sorted(found[:, 0]), [0, 1, 2, 3])
    np.testing.assert_allclose(np.diff(found[:, 0]) * np.sign(found[-1, 0] - found[0, 0]), 1)


def test_bad_line_meshes(tmp_path, capfd):
    import meshio

    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (5, 5, 5), (6, 5, 5)], dtype=float)
    for edges, message in (
        ([(0, 1), (1, 2), (1, 3)], "branches at point 1"),
        ([(0, 1), (1, 2), (2, 3), (3, 0)], "is closed"),
        ([(0, 1), (4, 5)], "in 2 pieces"),
    ):
        meshio.Mesh(square, [("line", np.array(edges))]).write(tmp_path / "m.vtu")
        with pytest.raises(cf.MeshError, match=message):
            cf.Rod.read(tmp_path / "m.vtu", "r", SECTION)
    meshio.Mesh(square, [("triangle", np.array([(0, 1, 2)]))]).write(tmp_path / "t.vtu")
    with pytest.raises(cf.MeshError, match="holds no line"):
        cf.Rod.read(tmp_path / "t.vtu", "r", SECTION)
    (tmp_path / "junk.vtu").write_text("<not xml")
    (tmp_path / "junk.xyz").write_text("1 2 3")
    (tmp_path / "junk.msh").write_text("$MeshFormat\nnonsense\n")
    (tmp_path / "junk.vtp").write_text("<not xml")
    (tmp_path / "junk.vtk").write_text("# vtk DataFile Version 3.0\nnonsense\n")
    capfd.readouterr()
    for name in ("junk.vtu", "junk.xyz", "junk.msh", "junk.vtp", "junk.vtk"):
        with pytest.raises(cf.MeshError, match="cannot be read|holds no line"):
            cf.Rod.read(tmp_path / name, "r", SECTION)
    assert capfd.readouterr() == ("", "")  # the fault is said once, by us
