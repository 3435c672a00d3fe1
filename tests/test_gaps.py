"""Clearance, against closed forms and against dense sampling."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import cosserat_fem as cf

SECTION = cf.Section.round(0.02, youngs_modulus=1e9)
A = 0.01  # radius


def straight(points, name="a", section=SECTION, **options):
    return cf.Rod(name, section, points, **{"n_elements": 7, **options})


def standing(rods, times=(0.0,)):
    """A history of rods that stand as drawn."""
    supports = [cf.Clamp(rod, "start") for rod in rods]
    return cf.solve_quasistatic(cf.Model(list(rods), supports), list(times))


@pytest.fixture(scope="module")
def curved():
    """Two bent rods at four times; they do not move, parts may."""
    a = cf.Rod("a", SECTION, [(0, 0, 0), (0.5, 0.2, 0.1), (1, 0, 0)], n_elements=5, rest="as_drawn")
    b = cf.Rod("b", SECTION, [(0, 0.5, 0.1), (0.5, 0.25, 0.3), (1, 0.5, 0)], n_elements=7, order=2, rest="as_drawn")
    return standing([a, b], [0.0, 1.0, 2.0, 3.0])


def dense(history, rod, n):
    """Places on the polynomial of each element, and their arc lengths."""
    view = history.model.space[rod]
    group = history.model.space.groups[view.group]
    xi = np.linspace(0, 1, n)
    N = np.array([shape(xi) for shape in group.basis.elem.shapes])
    r = np.einsum("an,eai->eni", N, history.final.r[group.conn[view.elements]]).reshape(-1, 3)
    h = group.dx[view.elements].sum(axis=1)
    return r, ((np.cumsum(h) - h)[:, None] + xi * h[:, None]).ravel()


@pytest.mark.parametrize(
    ("shape", "distance"),
    [
        (cf.Plane((0, 0, -0.3), (0, 0, 1)), 0.3),
        (cf.Sphere((0.437, 0.1, 0), 0.05), 0.05),
        (cf.Sphere((1.3, 0.4, 0), 0.05), 0.45),  # beside the end
        (cf.Cylinder((0.3, 0.2, -1), (0.3, 0.2, 1), 0.03), 0.17),
        (cf.Capsule((0.1, 0, 0.3), (0.9, 0, 0.3), 0.05), 0.25),
        (cf.Box((0.5, 0.2, 0), (0.1, 0.1, 0.1)), 0.15),
        (cf.Torus((0.5, 0, 0), (1, 0, 0), 0.1, 0.02), 0.08),  # through the hole
        (cf.Sphere((0.437, 0, 0), 0.05), -0.05),  # right through
        (cf.Plane((0, 0, 0.02), (0, 0, 1)), -0.02),  # below the floor
    ],
)
def test_straight_rod(shape, distance):
    """Known distances; the rod's radius is taken off; good to 1e-6 radii."""
    rod = straight([(0, 0, 0), (1, 0, 0)])
    history = standing([rod])
    [found] = cf.clearance(history, rod, cf.Part("p", shape=shape))
    assert found == pytest.approx(distance - A, abs=1e-6 * A)


def test_moving_part_with_several_shapes(curved):
    """The smallest of all shapes, at each state, in the frame of a part that turns."""
    ring = cf.Torus((0.5, 0.5, 0.2), (1, 1, 0), 0.1, 0.02)
    shapes = [cf.Sphere((0.7, 0.2, 0), 0.1), cf.Box((0.2, -0.3, 0), (0.1, 0.2, 0.3)), ring]
    part = cf.Part("arm", motion=cf.Hinge((0.3, 0.1, 0), (0.2, 0.3, 1), np.radians(40)), shape=shapes)
    found = cf.clearance(curved, "a", part)
    x, _ = dense(curved, curved.rod("a"), 20_001)
    for k, t in enumerate(curved.t):
        R, c = part.pose(t)
        expected = min(shape.distance((x - c) @ R).min() for shape in shapes) - A
        assert found[k] == pytest.approx(expected, abs=1e-6 * A)
    assert found.min() < 0 < found.max()


def tetrahedron(tmp_path, scale=0.3):
    import pyvista as pv

    points = scale * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    pv.PolyData(points, np.column_stack([np.full(4, 3), faces]).ravel()).save(tmp_path / "part.stl")
    return tmp_path / "part.stl"


def test_mesh(curved, tmp_path):
    """A closed mesh that slides past, then over a rod: distances of dense places, negative inside."""
    part = cf.Part("t", tetrahedron(tmp_path), motion=cf.Slider((0, 1, 0), ([0, 1, 2, 3], [-0.6, -0.5, 0.3, 0.0])))
    found = cf.clearance(curved, "a", part)
    x, _ = dense(curved, curved.rod("a"), 2001)
    for k, t in enumerate(curved.t):
        expected = part.surface().distance(x - part.pose(t)[1]).min() - A
        assert expected - 1e-3 * A < found[k] < expected + 1e-6 * A  # dense places miss where two faces are as near
    assert found.min() < -2 * A
    assert found.max() > 2 * A


def test_mesh_and_shape_agree(tmp_path):
    """A box of triangles and a box by its formula."""
    import pyvista as pv

    pv.Box((0.4, 0.6, 0.1, 0.3, -0.1, 0.1)).triangulate().save(tmp_path / "box.stl")
    rod = straight([(0, 0, 0.02), (1, 0.03, 0)], n_elements=4)
    history = standing([rod])
    mesh, box = cf.Part("m", tmp_path / "box.stl"), cf.Part("b", shape=cf.Box((0.5, 0.2, 0), (0.2, 0.2, 0.2)))
    assert cf.clearance(history, rod, mesh)[0] == pytest.approx(cf.clearance(history, rod, box)[0], abs=1e-7)
    both = cf.Part("both", tmp_path / "box.stl", shape=cf.Sphere((0.5, -0.1, 0), 0.05))
    assert cf.clearance(history, rod, both)[0] < cf.clearance(history, rod, mesh)[0]


def test_tapered_rod():
    """The radius is that of the place: a cone over a floor is nearest at its thick end."""
    thick, thin = cf.Section.round(0.04, youngs_modulus=1e9), cf.Section.round(0.01, youngs_modulus=1e9)
    rod = cf.Rod("a", [(0.0, thick), (1.0, thin)], [(0, 0, 0), (1, 0, 0)])
    history = standing([rod])
    floor = cf.Part("floor", shape=cf.Plane((0, 0, -0.1), (0, 0, 1)))
    assert cf.clearance(history, rod, floor)[0] == pytest.approx(0.08, abs=1e-9)
    assert cf.clearance(history, rod, floor, leave_out=[(-1, 0.5)])[0] == pytest.approx(0.1 - 0.0125, abs=1e-9)


def test_stretches_left_out():
    rod = straight([(0, 0, 0), (1, 0, 0)])
    history = standing([rod])
    post = cf.Part("post", shape=cf.Cylinder((0.25, 0, -1), (0.25, 0, 1), 0.1))
    assert cf.clearance(history, rod, post)[0] == pytest.approx(-0.1 - A)
    assert cf.clearance(history, rod, post, leave_out=[(0.0, 0.4)])[0] == pytest.approx(0.05 - A)
    assert cf.clearance(history, rod, post, leave_out=[(0.2, 0.3), (0.1, 0.2)])[0] == pytest.approx(-0.05 - A)
    assert cf.clearance(history, rod, post, leave_out=[(0.0, 1.0)])[0] == np.inf


def test_two_rods(curved):
    """Crossing, beside each other, end to end, bent: the smallest distance between centrelines, less both radii."""
    fat = cf.Section.round(0.06, youngs_modulus=1e9)
    a = straight([(0, 0, 0), (1, 0, 0)])
    for points, distance in (
        ([(0.3, -0.7, 0.2), (0.35, 0.5, 0.2)], 0.2),
        ([(0, 0.1, 0), (1, 0.1, 0)], 0.1),
        ([(1.2, 0.3, 0), (2, 0.5, 0)], np.hypot(0.2, 0.3)),
        ([(0.1, -0.2, 0.05), (0.9, 0.25, 0.05)], 0.05),
        ([(0.1, -0.03, 0.05), (0.9, 0.03, 0.0501)], None),
    ):
        b = straight(points, "b", fat, order=2)
        history = standing([a, b])
        if distance is None:
            x, y = dense(history, a, 8001)[0], dense(history, b, 8001)[0]
            distance = cKDTree(x).query(y)[0].min()
        assert cf.clearance(history, a, b)[0] == pytest.approx(distance - 0.04, abs=1e-6 * A)
        assert cf.clearance(history, b, "a")[0] == pytest.approx(distance - 0.04, abs=1e-6 * A)
    x, y = dense(curved, curved.rod("a"), 2001)[0], dense(curved, curved.rod("b"), 2001)[0]
    expected = cKDTree(x).query(y)[0].min() - 2 * A
    np.testing.assert_allclose(cf.clearance(curved, "a", "b"), expected, atol=1e-6 * A)


def test_many_states_are_looked_at_in_blocks(monkeypatch, curved):
    from cosserat_fem.limits import gaps

    part = cf.Part("p", shape=cf.Sphere((0.7, 0.4, 0), 0.1), motion=cf.Slider((0, 0, 1), 0.1))
    whole = cf.clearance(curved, "a", part)
    monkeypatch.setattr(gaps, "BLOCK", 3)
    np.testing.assert_array_equal(cf.clearance(curved, "a", part), whole)


def test_what_has_no_clearance(curved):
    with pytest.raises(ValueError, match="part 'p' has neither a shape nor a mesh"):
        cf.clearance(curved, "a", cf.Part("p"))
    with pytest.raises(ValueError, match="of rod 'a' with itself there is none"):
        cf.clearance(curved, "a", "a")
    with pytest.raises(ValueError, match="no part named 'arn'"):
        cf.clearance(curved, "a", "arn")
