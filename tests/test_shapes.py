"""Shapes of rigid bodies: closed forms against their own surfaces, what they refuse, parts that have them."""

import numpy as np
import pytest

import cosserat_fem as cf

AXIS = np.array([0.3, -0.5, 0.81])
START, END = np.array([0.1, 0.2, -0.1]), np.array([0.1, 0.2, -0.1]) + 0.3 * AXIS / np.linalg.norm(AXIS)
TURN = np.linalg.qr(np.array([(1.0, 2, 3), (0, 1, 4), (5, 6, 0)]))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
SHAPES = {
    "plane": cf.Plane((0.1, 0, 0.2), AXIS),
    "sphere": cf.Sphere((0.1, -0.2, 0.3), 0.2),
    "cylinder": cf.Cylinder(START, END, 0.1),
    "capsule": cf.Capsule(START, END, 0.1),
    "box": cf.Box((0.1, 0, 0.2), (0.3, 0.2, 0.4), TURN),
    "torus": cf.Torus((0.1, 0, 0.2), AXIS, 0.2, 0.05),
}
KINDS = {"plane": 0, "sphere": 1, "cylinder": 2, "capsule": 3, "box": 4, "torus": 5}
# volume, and the farthest a chord of 96 facets to a turn stands off the curve
VOLUME = {
    "sphere": 4 / 3 * np.pi * 0.2**3,
    "cylinder": np.pi * 0.1**2 * 0.3,
    "capsule": np.pi * 0.1**2 * 0.3 + 4 / 3 * np.pi * 0.1**3,
    "box": 0.3 * 0.2 * 0.4,
    "torus": 2 * np.pi**2 * 0.2 * 0.05**2,
}
SAGITTA = 0.25 * (1 - np.cos(np.pi / 96)) * 2  # on a doubly curved surface


@pytest.mark.parametrize("name", SHAPES)
def test_canonical_frame(name):
    """The frame is a rotation and the canonical body in it the same body; unused sizes are 0."""
    shape = SHAPES[name]
    assert shape.kind == KINDS[name]
    np.testing.assert_allclose(shape.frame.T @ shape.frame, np.eye(3), atol=1e-14)
    assert np.linalg.det(shape.frame) == pytest.approx(1.0)
    assert shape.size.shape == (3,)
    y = np.random.default_rng(1).normal(size=(200, 3)) * 0.3
    rho, h = np.hypot(y[:, 0], y[:, 1]), np.abs(y[:, 2])
    a, b, _ = shape.size
    inside = {
        "plane": y[:, 2] < 0,
        "sphere": np.linalg.norm(y, axis=1) < a,
        "cylinder": (rho < a) & (h < b),
        "capsule": np.hypot(rho, np.maximum(h - b, 0)) < a,
        "box": (np.abs(y) < shape.size).all(axis=1),
        "torus": np.hypot(rho - a, h) < b,
    }[name]
    assert inside.any() and not inside.all()
    np.testing.assert_array_equal(shape.distance(y @ shape.frame.T + shape.origin) < 0, inside)


@pytest.mark.parametrize("name", [n for n in SHAPES if n != "plane"])
def test_distance_equals_that_of_the_drawn_surface(name):
    """Closed, outwards, of the right volume; its distances are the closed form's, up to the facets' sagitta."""
    shape = SHAPES[name]
    points, triangles = shape.surface()
    surface = cf.Surface(points, triangles)
    assert surface.closed and surface.report == () and surface.patch.max() == 0
    np.testing.assert_array_equal(surface.triangles, triangles)  # nothing had to be turned
    np.testing.assert_allclose(shape.distance(points), 0.0, atol=1e-15)
    a, b, c = (points[triangles[:, k]] - shape.origin for k in range(3))
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(VOLUME[name], rel=3e-3)  # facets lie inside
    probes = np.random.default_rng(2).uniform(-0.4, 0.6, size=(120, 3))
    np.testing.assert_allclose(surface.distance(probes), shape.distance(probes), atol=SAGITTA)


def test_plane_is_drawn_as_a_square():
    plane = SHAPES["plane"]
    points, triangles = plane.surface(0.5)
    np.testing.assert_allclose(plane.distance(points), 0.0, atol=1e-16)
    np.testing.assert_allclose(points.mean(axis=0), (0.1, 0, 0.2))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a) / 2
    np.testing.assert_allclose(area.sum(axis=0), AXIS / np.linalg.norm(AXIS))  # 1 m^2, facing the free side
    assert plane.distance(plane.origin + 0.1 * AXIS / np.linalg.norm(AXIS)) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cf.Plane((0, 0, 0), (0, 0, 0)), "plane: normal: has zero length"),
        (lambda: cf.Sphere((0, 0, 0), 0.0), "sphere: radius: must be greater than 0"),
        (lambda: cf.Sphere((0, np.nan, 0), 1.0), "sphere: center: must be finite"),
        (lambda: cf.Cylinder((1, 2, 3), (1, 2, 3), 0.1), "cylinder: start and end are the same point"),
        (lambda: cf.Capsule((0, 0, 0), (0, 0, 1), -1), "capsule: radius: must be greater than 0"),
        (lambda: cf.Box((0, 0, 0), (1, -1, 1)), "box: edge 1: must be greater than 0"),
        (lambda: cf.Box((0, 0, 0), (1, 1, 1), np.diag([1, 1, -1])), "box: axes: columns must be unit vectors"),
        (lambda: cf.Torus((0, 0, 0), (0, 0, 1), 0.1, 0.1), "torus: tube: must be smaller than the radius 0.1 m"),
        (lambda: cf.Part("p", shape=3), "part 'p': shape must be one or several of Plane, Sphere"),
        (lambda: cf.Part("p", shape=[cf.Sphere((0, 0, 0), 1), "box"]), "shape must be one or several of"),
    ],
)
def test_bad_shapes(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_part_of_several_shapes():
    ball, box = SHAPES["sphere"], SHAPES["box"]
    assert cf.Part("p").shapes == ()
    assert cf.Part("p", shape=ball).shapes == (ball,)
    part = cf.Part("p", shape=[ball, box])
    assert part.shapes == (ball, box)
    points, triangles = part.drawn_surface()
    assert len(points) == len(ball.surface()[0]) + 8 and triangles.max() == len(points) - 1
    assert cf.Surface(points, triangles).closed
    assert [len(x) for x in cf.Part("p").drawn_surface()] == [0, 0]
