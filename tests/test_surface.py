"""Triangle meshes for contact: repair, patches, the triangles near a point, reading files."""

import pathlib
import struct

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.kernels.triangles import lower_to_triangles, triangle_distance
from cosserat_fem.meshfile import LIMIT, read_surface

BOX = cf.Box((0.5, 0.5, 0.5), (1, 1, 1)).surface()
FACES = BOX[1]


def volume(surface):
    a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
    return (a * np.cross(b, c)).sum() / 6


def extruded(outline, height=1.0):
    """Closed prism over a simple polygon (K, 2), counter-clockwise; its ends are triangulated by cutting ears."""
    outline = np.asarray(outline, dtype=float)
    n = len(outline)
    left, ears = list(range(n)), []

    def cross(u, v):
        return u[0] * v[1] - u[1] * v[0]

    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = (outline[left[(k + j) % len(left)]] for j in (-1, 0, 1))
            others = [outline[i] for i in left if i not in (left[k - 1], left[k], left[(k + 1) % len(left)])]
            free = all(min(cross(b - a, p - a), cross(c - b, p - b), cross(a - c, p - c)) < 0 for p in others)
            if cross(b - a, c - b) > 0 and free:
                ears.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
                del left[k]
                break
    ears = np.array([*ears, left])
    points = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (0.0, height)])
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    walls = np.concatenate([np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)])
    return points, np.concatenate([walls, ears[:, ::-1], ears + n])


def of_face(surface, axis, value):
    """Patches of the triangles in one plane."""
    flat = (np.abs(surface.points[surface.triangles][:, :, axis] - value) < 1e-12).all(axis=1)
    assert flat.any()
    return set(surface.patch[flat].tolist())


def test_clean_mesh_stays():
    surface = cf.Surface(*BOX)
    assert surface.closed and surface.report == ()
    np.testing.assert_array_equal(surface.triangles, FACES)
    np.testing.assert_array_equal(surface.patch, 0)  # all edges are convex
    np.testing.assert_array_equal(surface.bounds, [(0, 0, 0), (1, 1, 1)])


@pytest.mark.parametrize("turned", [[3], [0, 5, 7], list(range(12)), list(range(1, 12))])
def test_flipped_facets_are_turned(turned):
    faces = FACES.copy()
    faces[turned] = faces[turned][:, ::-1]
    surface = cf.Surface(BOX[0], faces)
    assert surface.closed and volume(surface) == pytest.approx(1.0)
    assert surface.report == (f"{len(turned)} flipped triangle{'s' if len(turned) > 1 else ''} turned",)


def test_doubled_and_degenerate_triangles():
    """Corners that are one point, triangles that stand twice or on a line: left out, and the box is still closed."""
    soup = BOX[0][FACES].reshape(-1, 3)
    surface = cf.Surface(soup, np.arange(36).reshape(-1, 3))
    assert surface.closed and len(surface.points) == 8 and surface.report == ()
    surface = cf.Surface(BOX[0], np.vstack([FACES, FACES[:2], FACES[3, ::-1], (0, 0, 1)]))
    assert surface.closed and len(surface.triangles) == 12
    assert surface.report == ("1 triangle with two equal corners left out", "3 triangles that stood twice left out")
    # an edge of one side has a point in its middle that the other side lacks: a triangle without area closes the gap
    k = int(np.flatnonzero([{0, 1} <= set(f) for f in FACES])[0])
    a, b = (0, 1) if any(tuple(np.roll(FACES[k], j)[:2]) == (0, 1) for j in range(3)) else (1, 0)
    c = int((set(FACES[k].tolist()) - {0, 1}).pop())
    faces = np.vstack([np.delete(FACES, k, axis=0), [(a, 8, c), (8, b, c), (a, b, 8)]])
    surface = cf.Surface(np.vstack([BOX[0], (BOX[0][0] + BOX[0][1]) / 2]), faces)
    assert surface.closed and len(surface.triangles) == 13 and surface.patch.max() == 0
    assert surface.report == ("1 triangle without area left out",)


def test_gaps_of_round_off_are_sewn():
    points = np.vstack([BOX[0], BOX[0] + 1e-8])
    faces = FACES.copy()
    faces[:4] += 8
    surface = cf.Surface(points, faces)
    assert surface.closed and len(surface.points) == 8
    assert any("closer than 1e-06 m merged" in note for note in surface.report)


def test_open_sheet():
    """Touched from both sides: a bend splits it whichever way it goes; distances have no sign."""
    surface = cf.Surface(BOX[0], np.delete(FACES, [5, 11], axis=0), where="tray")
    assert not surface.closed
    assert surface.report == ("not watertight (4 open edges of 10 triangles): a sheet that is touched from both sides",)
    assert surface.patch.max() == 4
    assert surface.distance([(0.5, 0.5, 0.4), (0.5, 0.5, -0.1)]) == pytest.approx([0.4, 0.1])
    x = np.linspace(0, 1, 9)
    grid = np.array([(a, b, 0.02 * np.sin(3 * a)) for a in x for b in x])
    k = np.array([i * 9 + j for i in range(8) for j in range(8)])
    faces = np.vstack([np.stack([k, k + 9, k + 10], 1), np.stack([k, k + 10, k + 1], 1)])
    wavy = cf.Surface(grid, faces)
    assert not wavy.closed and wavy.patch.max() == 0
    faces[5] = faces[5][::-1]
    turned = cf.Surface(grid, faces)
    assert turned.report[0] == "1 flipped triangle turned"
    np.testing.assert_array_equal(np.sort(turned.triangles), np.sort(wavy.triangles))


def test_edges_of_three_sheets():
    """A T is three sheets; a box with a fin is open; two boxes on one edge are closed."""
    points = [(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0)]
    tee = cf.Surface(points, [(0, 1, 2), (0, 1, 3), (0, 1, 4)])
    assert not tee.closed and len(set(tee.patch)) == 3
    assert "1 edge shared by more than two triangles" in tee.report
    fin = cf.Surface(np.vstack([BOX[0], (-1, -1, 0.5)]), np.vstack([FACES, (0, 4, 8)]))
    assert not fin.closed
    pair = cf.Surface(np.vstack([BOX[0], BOX[0] + (1, 1, 0)]), np.vstack([FACES, FACES + 8]))
    assert pair.closed and volume(pair) == pytest.approx(2.0)
    assert pair.report == ("1 edge shared by more than two triangles",)
    assert pair.distance([(0.5, 0.5, 0.5), (1.5, 1.4, 0.5), (0.5, 1.5, 0.5)]) == pytest.approx([-0.5, -0.4, 0.5])


def test_moebius_band_is_a_sheet():
    n = 12
    u = np.pi * np.arange(n) / n
    arm = np.stack([np.cos(u) * np.cos(2 * u), np.cos(u) * np.sin(2 * u), np.sin(u)], axis=1)
    middle = np.stack([np.cos(2 * u), np.sin(2 * u), 0 * u], axis=1)
    points = np.concatenate([middle - 0.2 * arm, middle + 0.2 * arm])
    a, b = np.arange(n), np.arange(n) + n
    c, d = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    band = cf.Surface(points, np.vstack([np.stack([a, c, d], 1), np.stack([a, d, b], 1)]))
    assert not band.closed and any("only one side" in note for note in band.report)


def test_hollow_body():
    """The wall of a cavity points into it, whichever way the file has it all; a ball beside it is turned by itself."""
    inner = np.concatenate([FACES, FACES[:, ::-1] + 8])
    points = np.vstack([BOX[0], 0.25 + 0.5 * BOX[0]])
    for faces in (inner, inner[:, ::-1]):
        hollow = cf.Surface(points, faces)
        assert hollow.closed and volume(hollow) == pytest.approx(1 - 0.125)
        np.testing.assert_allclose(hollow.distance([(0.5, 0.5, 0.5), (0.1, 0.5, 0.5)]), (0.25, -0.1))
    beside = cf.Surface(np.vstack([BOX[0], BOX[0] + 2]), inner)
    assert volume(beside) == pytest.approx(2.0) and beside.report == ("12 flipped triangles turned",)


@pytest.mark.parametrize(
    ("points", "triangles", "message"),
    [
        (
            [(0, 0, 0), (1, 0, 0), (0, np.nan, 0)],
            [(0, 1, 2)],
            "lid: holds coordinates that are not finite .1 point, first",
        ),
        ([(0, 0, 0), (1, 0, 0), (0, np.inf, 0)], [(0, 1, 2)], "not finite"),
        (BOX[0], [(0, 1, 8)], "triangle 0 has the corners .0, 1, 8.; points are numbered 0 to 7"),
        (BOX[0], [(0, 1, -1)], "points are numbered 0 to 7"),
        (BOX[0], np.empty((0, 3), dtype=int), "lid: holds no surface .0 triangles"),
        (BOX[0], [(0, 0, 1)], "holds no surface .no triangle of 1 has an area"),
        ([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [(0, 1, 2)], "no triangle of 1 has an area"),
        (BOX[0], [(0.0, 1.0, 2.0)], "triangles must be integers of shape"),
        ([(0, 0)], [(0, 0, 0)], "points must have shape .any, 3."),
        (BOX[0], np.tile((0, 1, 2), (LIMIT + 1, 1)), "lid: has 2000001 triangles; at most 2000000"),
    ],
)
def test_unusable(points, triangles, message):
    with pytest.raises(cf.MeshError, match=message):
        cf.Surface(points, triangles, where="lid")


def test_patches_at_concave_edges():
    """What a rod may touch at once is in two patches; the shoulders it slides over are in one."""
    bracket = cf.Surface(*extruded([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]))
    assert bracket.closed and bracket.patch.max() == 1
    assert of_face(bracket, 0, 1).isdisjoint(of_face(bracket, 1, 1))
    groove = cf.Surface(*extruded([(0, 0), (4, 0), (4, 2), (3, 2), (2, 1), (1, 2), (0, 2)]))
    assert groove.patch.max() == 1
    middle = groove.points[groove.triangles].mean(axis=1)
    left, right = (
        set(groove.patch[(np.abs(middle[:, 0] - x) < 0.49) & (middle[:, 1] > 1.01) & (middle[:, 1] < 1.99) & wall])
        for x, wall in ((1.5, middle[:, 2] % 1 != 0), (2.5, middle[:, 2] % 1 != 0))
    )
    assert len(left) == len(right) == 1 and left != right
    top = groove.points[groove.triangles][:, :, 1].min(axis=1) == 2  # both shoulders, either side of the groove
    shoulder = {x: set(groove.patch[top & (np.sign(middle[:, 0] - 2) == x)]) for x in (-1, 1)}
    assert shoulder == {-1: left, 1: right}
    channel = cf.Surface(*extruded([(0, 0), (4, 0), (4, 2), (3, 2), (3, 1), (1, 1), (1, 2), (0, 2)]))
    sides = of_face(channel, 0, 1), of_face(channel, 0, 3), of_face(channel, 1, 1)
    assert all(len(s) == 1 for s in sides) and len(set.union(*sides)) == 3


def test_smooth_hollows_stay_one_patch():
    angle = 2 * np.pi * np.arange(64) / 64
    x, y = np.cos(angle), np.sin(angle)
    rings = [np.column_stack([r * x, r * y, np.full(64, z)]) for r, z in ((1, 0), (1, 1), (2, 1), (2, 0))]
    a = np.arange(64)
    b = np.roll(a, -1)
    faces = []
    for k in range(4):
        i, j = 64 * k, 64 * ((k + 1) % 4)
        faces += [np.stack([i + a, j + a, j + b], 1), np.stack([i + a, j + b, i + b], 1)]
    ring = cf.Surface(np.concatenate(rings), np.concatenate(faces))
    assert ring.closed and volume(ring) == pytest.approx(3 * np.pi, rel=2e-3)
    assert ring.patch.max() == 0
    assert cf.Surface(*cf.Torus((0, 0, 0), (0, 0, 1), 1.0, 0.4).surface()).patch.max() == 0


def test_distance_to_a_triangle():
    """Against the least over a dense sampling of the triangle."""
    rng = np.random.default_rng(3)
    u = np.linspace(0, 1, 201)
    a, b = (x.ravel() for x in np.meshgrid(u, u))
    weights = np.stack([a, b, 1 - a - b], axis=1)[a + b <= 1 + 1e-12]
    for _ in range(30):
        corners, p = rng.normal(size=(3, 3)), 2 * rng.normal(size=3)
        sampled = np.linalg.norm(weights @ corners - p, axis=1).min()
        exact = triangle_distance(p[None], corners[None])[0]
        assert exact <= sampled + 1e-12 and exact == pytest.approx(sampled, abs=2e-3)


@pytest.mark.parametrize("name", ["ball", "slab"])
def test_candidates_hold_all_that_is_near(name):
    """None is missed, they are in order, and those that are too many are so by less than a triangle."""
    if name == "ball":
        shape = cf.Sphere((0, 0, 0), 0.1)
    else:  # two triangles a side, far larger than the search
        shape = cf.Box((0, 0, 0), (0.4, 0.3, 0.002))
    surface = cf.Surface(*shape.surface())
    corners = surface.points[surface.triangles]
    centers = np.random.default_rng(4).uniform(-0.15, 0.15, size=(60, 3))
    centers[0] = (9, 9, 9)
    for radius in (0.003, np.linspace(0.0, 0.04, 60)):
        start, index = surface.candidates(centers, radius)
        assert start.shape == (61,) and start[0] == 0 and start[-1] == len(index)
        for i, r in enumerate(np.broadcast_to(radius, 60)):
            found = index[start[i] : start[i + 1]]
            assert len(set(found.tolist())) == len(found)
            order = np.lexsort((found, surface.patch[found]))
            np.testing.assert_array_equal(order, np.arange(len(found)))
            d = triangle_distance(np.tile(centers[i], (len(corners), 1)), corners)
            assert set(np.flatnonzero(d <= r)) <= set(found.tolist())
            assert (d[found] <= r + 2 * surface._samples.reach).all()
    lower, exact = surface.nearest(centers), np.abs(surface.distance(centers))
    assert (lower <= exact + 1e-15).all() and (lower >= exact - 2 * surface._samples.reach).all()
    start, index = surface.candidates(np.empty((0, 3)), 0.1)
    assert start.tolist() == [0] and len(index) == 0
    assert surface.distance(np.empty((0, 3))).shape == (0,)


def test_signed_distance():
    """Of points in any order, also across the wall between neighbours."""
    surface, shape = cf.Surface(*BOX), cf.Box((0.5, 0.5, 0.5), (1, 1, 1))
    line = np.linspace((-0.5, 0.3, 0.4), (1.5, 0.6, 0.7), 101)
    scattered = np.random.default_rng(5).uniform(-0.5, 1.5, size=(200, 3))
    for points in (line, line[::-1], scattered):
        np.testing.assert_allclose(surface.distance(points), shape.distance(points), atol=1e-14)
        np.testing.assert_array_equal(surface.inside(points), shape.distance(points) < 0)
    assert not cf.Surface(BOX[0], FACES[1:]).inside(line).any()


def binary(faces, count=None, header=b"made for a test"):
    corners = BOX[0][faces].astype("<f4")
    body = b"".join(struct.pack("<3f", 0, 0, 0) + c.tobytes() + b"\0\0" for c in corners)
    return header.ljust(80, b"\0") + struct.pack("<I", len(faces) if count is None else count) + body


def text(faces):
    lines = ["solid box"]
    for c in BOX[0][faces]:
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *("vertex {} {} {:e}".format(*v) for v in c),
            "endloop",
            "endfacet",
        ]
    return "\n".join([*lines, "endsolid box", ""])


@pytest.mark.parametrize("data", [binary(FACES), binary(FACES, header=b"solid box"), text(FACES).encode()])
def test_stl(tmp_path, data):
    """Binary, binary that calls itself solid, and text."""
    file = tmp_path / "box.STL"
    file.write_bytes(data)
    surface = cf.Surface(*read_surface(file, "part 'p'"))
    assert surface.closed and surface.report == () and volume(surface) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (binary(FACES, 13), "part 'p': mesh file '.*x.stl' holds 12 triangles where its header counts 13"),
        (binary(FACES, 4), "holds 12 triangles where its header counts 4"),
        (binary(FACES, 0), "holds 12 triangles where its header counts 0"),
        (binary(FACES)[:-70], "holds 10 triangles where its header counts 12"),
        (text(FACES)[:-30].encode(), "holds 36 corners of 12 facets and no line endsolid"),
        (text(FACES)[:500].encode(), "and no line endsolid: it is cut short"),
        (text(FACES).replace("vertex", "vortex", 1).encode(), "holds 35 corners of 12 facets"),
        (text(FACES).replace("vertex 0", "vertex zero", 1).encode(), "cannot be read as a surface"),
        (text(FACES).replace("vertex 0.0", "vertex nan", 1).encode(), "coordinates that are not finite"),
        (binary(FACES[:0]), "holds no surface .0 triangles"),
        (b"solid nothing\nendsolid nothing\n", "holds no surface"),
        (b"this is not a mesh\n", "holds no surface"),
        (b"", "holds no surface"),
        (b"x" * 60 + b"\0" * 40, "holds 0 triangles|holds no surface"),
    ],
)
def test_bad_stl(tmp_path, capfd, data, message):
    """A file that holds less or more than it says is refused in one sentence, and nothing else is printed."""
    file = tmp_path / "x.stl"
    file.write_bytes(data)
    with pytest.raises(cf.MeshError, match=message):
        read_surface(file, "part 'p'")
    assert capfd.readouterr() == ("", "")


def test_bracket():
    """The shipped bracket: closed, a nose that a rod meets as one patch, and a foot."""
    bracket = cf.Part("bracket", pathlib.Path(__file__).parents[1] / "meshes" / "bracket.stl", 1e-3).surface()
    assert bracket.closed and bracket.report == ()
    center, nose = np.array([5.5e-3, -46e-3, 0.0]), np.linspace(-1.5, 1.5, 50)
    around = center + 8e-3 * np.stack([np.cos(nose), np.sin(nose), 0 * nose], axis=1)
    np.testing.assert_allclose(bracket.distance(around), 1e-3, atol=6e-6)  # sagitta of 80 facets to a turn
    start, index = bracket.candidates(around, 2e-3)
    assert (np.diff(start) > 0).all() and len(set(bracket.patch[index])) == 1


def test_kernel_of_pairs_equals_the_readable_form(rng):
    """Points on all sides of triangles, in their planes and on their corners too."""
    corners, p = rng.normal(size=(40, 3, 3)), rng.normal(size=(60, 3))
    p[:10] = corners[:10, 0]
    p[10:20] = corners[10:20].mean(axis=1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(60), np.arange(40)))
    best = np.full(60, np.inf)
    lower_to_triangles(p, i, corners, j, best)
    every = triangle_distance(p[i], corners[j]).reshape(40, 60)
    np.testing.assert_allclose(best, every.min(axis=0), atol=1e-14)
