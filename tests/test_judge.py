"""The judge finds every known pass-through, slow and fast, and takes no near miss for one."""

import itertools
import time

import judge
import numpy as np
import pytest

WIRE = np.array([[0.0, -0.3, 0.0], [0.0, 0.3, 0.0]])
SHEET = np.array([[-0.2, -0.3, 0.0], [0.3, -0.2, 0.0], [0.0, 0.4, 0.0]])


def straight(samples=401, direction=(1, 0, 0)):
    return np.linspace(-0.5, 0.5, samples)[:, None] * np.asarray(direction, dtype=float)


def moved(curve, path):
    """Frames of a curve that is carried along a path (T, 3)."""
    return np.asarray(curve)[None] + np.asarray(path, dtype=float)[:, None]


def falling(steps, top=0.105, bottom=-0.1):
    return np.linspace([0, 0, top], [0, 0, bottom], steps + 1)


def circle(n=200, center=(0, 0, 0), axes=((1, 0, 0), (0, 1, 0))):
    phi = 2 * np.pi * np.arange(n)[:, None] / n
    return np.asarray(center) + np.cos(phi) * np.asarray(axes[0]) + np.sin(phi) * np.asarray(axes[1])


def rotation(rng):
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


@pytest.mark.parametrize("steps", [1, 2, 41, 500])
def test_wire_is_crossed_once_at_any_speed(steps):
    """Also when a sample, a frame or both meet the wire exactly, and when the rod returns."""
    for samples, top in ((400, 0.105), (401, 0.105), (401, 0.1)):
        frames = moved(straight(samples), falling(steps, top))
        assert judge.crossings_segment(frames, *WIRE) == 1
        assert judge.crossings_segment(frames, *WIRE, signed=True) == -judge.crossings_segment(
            frames[::-1], *WIRE, signed=True
        )
        back = np.concatenate([frames, frames[::-1]])
        assert judge.crossings_segment(back, *WIRE) == 2
        assert judge.crossings_segment(back, *WIRE, signed=True) == 0


def test_wire_along_the_rod_is_crossed_at_least_once():
    """Rod and wire exactly parallel, and only half of the length in common."""
    for shift in (0, 0.55):
        frames = moved(straight(direction=(0, 1, 0)), falling(10) + [0, shift, 0])
        assert judge.crossings_segment(frames, *WIRE) >= 1
        assert judge.crossings_rods(frames, np.repeat(WIRE[None], 11, 0)) >= 1


def test_near_misses_of_the_wire_do_not_count():
    rod = straight()
    for path in (
        falling(7, bottom=1e-6),  # stops above
        falling(7) + [0, 0.3 + 1e-6, 0],  # passes beside the end of the wire
        falling(7) + [0.5 + 1e-6, 0, 0],  # the rod's end passes beside
        np.zeros((5, 3)) + [0, 0, 1e-6],
        np.linspace([-2, 0, 1e-6], [2, 0, 1e-6], 9),  # slides along itself above the wire
    ):
        assert judge.crossings_segment(moved(rod, path), *WIRE) == 0
        assert judge.crossings_rods(moved(rod, path), np.repeat(WIRE[None], len(path), 0)) == 0


def test_wire_and_moving_curves_agree_on_random_motion(rng):
    """Two methods, triangles of the sweep and cubic in time, give the same signed and plain counts."""
    total = 0
    s = np.linspace(0, 1, 300)[:, None]
    for _ in range(15):
        modes, phase = rng.normal(size=(4, 3)), rng.uniform(0, 6, size=(30, 4)).cumsum(0) * 0.1
        frames = np.array([sum(np.sin((k + 1) * s + p[k]) * modes[k] / (k + 1) for k in range(4)) for p in phase])
        wire = 2 * rng.normal(size=(2, 3))
        fixed = np.repeat(wire[None], len(frames), 0)
        plain = judge.crossings_segment(frames, *wire)
        assert plain == judge.crossings_rods(frames, fixed) == judge.crossings_rods(fixed, frames)
        net = judge.crossings_segment(frames, *wire, signed=True)
        assert abs(net) == abs(judge.crossings_rods(frames, fixed, signed=True))
        total += plain
    assert total > 5


@pytest.mark.parametrize("steps", [1, 30])
def test_sheet(steps):
    """Broadside, over an edge and end on; a miss on each side."""
    rod = straight()
    assert judge.crossings_triangle(moved(rod, falling(steps)), SHEET) > 0
    sideways = np.linspace([0, -1, 0], [0, 0.0, 0], steps + 1)
    leaning = straight(direction=(0.3, 0, 0.9))
    assert judge.crossings_triangle(moved(leaning, sideways), SHEET) == 1  # over one edge: now pierced
    upright = straight(direction=(0, 0, 1))
    assert judge.crossings_triangle(moved(upright, np.linspace([0, 0, 1], [0, 0, 0], steps + 1)), SHEET) >= 1
    assert judge.crossings_triangle(moved(rod, falling(steps) + [0, 0.41, 0]), SHEET) == 0
    assert judge.crossings_triangle(moved(rod, falling(steps, bottom=1e-6)), SHEET) == 0
    assert judge.crossings_triangle(moved(leaning, np.zeros((3, 3))), SHEET) == 0


def test_piercings():
    """A leaning rod goes through the sheet in the frames in which its middle is over it."""
    frames = moved(straight(direction=(0.3, 0, 0.9)), [[0, -1, 0], [0, 0, 0], [0, 0.5, 0]])
    assert judge.piercings(frames, SHEET).tolist() == [0, 1, 0]


def test_count_for_a_sheet_closes(rng):
    """What pierces at the end less what pierced at the start has the parity of all crossings."""
    s = np.linspace(0, 1, 200)[:, None]
    seen = 0
    for _ in range(40):
        modes, phase = rng.normal(size=(3, 3)), rng.uniform(0, 6, size=(20, 3)).cumsum(0) * 0.05
        frames = np.array([sum(np.sin((k + 1) * 3 * s + p[k]) * modes[k] for k in range(3)) for p in phase])
        triangle = rng.normal(size=(3, 3))
        # A sample that passes the face moves a piercing to the next piece; only the two ends add or take one.
        ends = sum(judge._through(judge._generic(frames, 1)[:, [i]], triangle, axis=0).sum() for i in (0, -1))
        edges = sum(judge.crossings_segment(frames, triangle[i], triangle[i - 1]) for i in range(3))
        pierced = judge.piercings(frames, triangle)
        assert (pierced[-1] - pierced[0] - ends - edges) % 2 == 0
        seen += edges + ends
    assert seen > 20


@pytest.mark.parametrize("steps", [1, 3, 200])
def test_box(steps):
    """Through the box, past it, along its face, and an edge that only cuts between two samples."""
    center, half = np.array([0.1, 0.0, 0.0]), np.array([0.01, 0.02, 0.03])
    rod = straight(2001)
    assert judge.inside_box(moved(rod, falling(steps)), center, half) == pytest.approx(0.01, abs=2e-4)
    assert judge.inside_box(moved(rod, falling(steps, bottom=0.03)), center, half) < 1e-15
    assert judge.inside_box(moved(rod, falling(steps, bottom=0.029)), center, half) == pytest.approx(0.001)
    assert judge.inside_box(moved(rod, falling(steps) + [0, 0.0201, 0]), center, half) == 0
    corner = moved(straight(12, direction=(1, 1, 0)), [[0.1 + 0.01 - 0.021, 0, 0]])  # x - y = 0.089 < 0.11 - ...
    assert judge.inside_box(corner, center, half) > 0
    assert judge.inside_box(corner + [0.041 + 1e-9, 0, 0], center, half) == pytest.approx(0, abs=1e-15)


def test_convex_depth_equals_a_search(rng):
    """The deepest place on the pieces of a polyline, against ten thousand places on each."""
    normals = rng.normal(size=(9, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    offsets = rng.uniform(0.3, 0.5, 9)
    curve = rng.normal(size=(12, 3))
    fine = np.linspace(curve[:-1], curve[1:], 10001)
    expected = (offsets - fine @ normals.T).min(-1).max()
    assert judge.inside_convex(curve[None], normals, offsets) == pytest.approx(max(expected, 0), abs=1e-3)


def test_inside_a_ball():
    def ball(x):
        return np.linalg.norm(x, axis=-1) - 0.05

    assert judge.inside(moved(straight(), falling(3)), ball) == pytest.approx(0.05, abs=0.01)
    assert judge.inside(moved(straight(), falling(3) + [0, 0.0501, 0]), ball) == 0


def test_linking_numbers(rng):
    """Hopf links of both signs, twice linked, unlinked; the same in any pose and for any samples."""
    ring = circle()
    hopf = circle(150, (1, 0, 0), ((1, 0, 0), (0, 0, 1)))
    sign = judge.linking_number(ring, hopf)
    assert abs(sign) == 1
    assert judge.linking_number(ring, hopf[::-1]) == -sign
    assert judge.linking_number(hopf, ring) == sign
    assert judge.linking_number(ring * [1, 1, -1], hopf * [1, 1, -1]) == -sign
    assert judge.linking_number(ring, hopf + [2.5, 0, 0]) == 0
    phi = 2 * np.pi * np.arange(300) / 300
    twice = np.stack([(1 + 0.3 * np.cos(2 * phi)) * np.cos(phi), (1 + 0.3 * np.cos(2 * phi)) * np.sin(phi)], 1)
    twice = np.column_stack([twice, 0.3 * np.sin(2 * phi)])
    assert abs(judge.linking_number(ring, twice)) == 2
    for _ in range(5):
        Q, c = rotation(rng), rng.normal(size=3)
        assert judge.linking_number(ring @ Q.T + c, hopf @ Q.T + c) == sign
    assert judge.linking_number(circle(3), circle(4, (1, 0, 0), ((1, 0, 0), (0, 0, 1)))) == sign


def test_gauss_integral_equals_quadrature(rng):
    """Open polylines: the double integral of (x - y) . (dx x dy) / (4 pi |x - y|^3) with Gauss points."""
    x, y = rng.normal(size=(5, 3)), rng.normal(size=(4, 3)) + [1, 2, 4]
    g, w = np.polynomial.legendre.leggauss(30)
    total = 0.0
    for x0, x1 in itertools.pairwise(x):
        for y0, y1 in itertools.pairwise(y):
            p = (x0 + x1) / 2 + g[:, None, None] * (x1 - x0) / 2
            q = (y0 + y1) / 2 + g[None, :, None] * (y1 - y0) / 2
            d = p - q
            value = d @ np.cross((x1 - x0) / 2, (y1 - y0) / 2) / np.linalg.norm(d, axis=-1) ** 3
            total += w @ value @ w / (4 * np.pi)
    assert judge.gauss_integral(x, y) == pytest.approx(total, rel=1e-9)


def test_linking_changes_by_the_signed_passes(rng):
    """Closed rings in random motion: the change of the linking number is the signed count of passes."""
    passes = 0
    for _ in range(15):
        path = np.cumsum(rng.normal(size=(12, 3)) * 0.4, 0)
        ring = np.array([circle(90) @ rotation(np.random.default_rng(k // 4)).T for k in range(12)])
        other = circle(77, (0, 0, 0), ((0.8, 0, 0.3), (0, 0.2, 1.1)))
        first, second = ring, other[None] + path[:, None]
        close = [np.concatenate([f, f[:, :1]], 1) for f in (first, second)]
        net = judge.crossings_rods(*close, signed=True)
        change = judge.linking_number(first[-1], second[-1]) - judge.linking_number(first[0], second[0])
        assert net == change
        passes += judge.crossings_rods(*close)
    assert passes > 10


@pytest.mark.parametrize("steps", [1, 2, 100])
def test_rods_pass_through_each_other(steps):
    """Both move; the linking number with fixed ends agrees; a sample may meet a sample, parallel rods count too."""
    for samples in (200, 201):
        fall = moved(straight(samples), falling(steps, 0.1))
        rise = moved(straight(samples, (0, 1, 0)), -falling(steps, 0.1))
        assert judge.crossings_rods(fall, rise) == 1
        assert judge.crossings_rods(fall, rise + [0, 0, -0.3]) == 0
        assert judge.crossings_rods(fall, rise + [0, 0.5001, 0]) == 0
        assert judge.crossings_rods(fall, moved(straight(samples), -falling(steps, 0.1) + [0.7, 0, 0])) >= 1


@pytest.mark.parametrize("through", [True, False])
def test_closed_open_rods(through):
    """The middle of one rod dips through the other, ends fixed: one pass and a changed linking number, or neither."""
    still = np.repeat(straight(direction=(0, 1, 0))[None], 21, 0)
    bump = np.exp(-100 * straight()[:, :1] ** 2) * np.array([0, 0, -1.0])
    depth = np.linspace(0, 0.2 if through else 0.0999, 21)
    moving = straight() + [0, 0, 0.1] + depth[:, None, None] * bump
    links = judge.linking_with_closure(moving, still)
    assert judge.crossings_rods(moving, still) == abs(links[-1] - links[0]) == int(through)


@pytest.mark.parametrize("steps", [1, 40])
def test_self_passage(steps):
    """One leg of a loop is pulled through the other, or comes back before it reaches it."""
    s = np.linspace(-1, 1, 301)
    loop = np.column_stack([s**3 - 0.4 * s, 0.6 * s**2, 0 * s])  # crosses itself in the plane
    lift = np.column_stack([0 * s, 0 * s, 0.1 * s])
    down = np.linspace(1, -1, steps + 1)[:, None, None]
    assert judge.crossings_self(loop + down * lift) == 1
    assert abs(judge.crossings_self(loop + down * lift, signed=True)) == 1
    assert judge.crossings_self(loop + (abs(down) + 1e-6) * lift) == 0


def test_fast_enough():
    """2000 samples against 2000 over 50 steps stay within seconds."""
    start = time.perf_counter()
    fall, rise = moved(straight(2000), falling(50)), moved(straight(2000, (0.3, 1, 0)), -falling(50))
    assert judge.crossings_rods(fall, rise) == 1
    assert judge.crossings_segment(fall, *WIRE) == 1
    assert time.perf_counter() - start < 20
