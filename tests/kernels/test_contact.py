"""Contact kernels: distances against brute force, laws and tangents against differences, stretches against dense sums."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import scipy.spatial
from numba import njit
from scipy.spatial.transform import Rotation

import cosserat_fem as cf
from cosserat_fem.kernels import contact as kernels
from cosserat_fem.kernels.clearance import far_from
from cosserat_fem.kernels.reach import OUT
from cosserat_fem.kernels.rotation import matrix_from_quaternion
from cosserat_fem.kernels.shapes import closed_form, facets, triangles
from cosserat_fem.kernels.triangles import triangle_distance
from cosserat_fem.space import Contact, Touch
from cosserat_fem.terms.touch import renewed
from helpers import drum_mesh, write_obj

SHAPES = {
    "plane": cf.Plane((0.1, 0.2, -0.3), (1, 2, -0.5)),
    "sphere": cf.Sphere((0.3, -0.2, 0.1), 0.7),
    "cylinder": cf.Cylinder((0.1, 0.2, 0.3), (0.5, -0.4, 0.9), 0.4),
    "capsule": cf.Capsule((0.1, 0.2, 0.3), (0.5, -0.4, 0.9), 0.4),
    "box": cf.Box((0.2, 0.1, -0.1), (0.6, 0.9, 1.4)),
    "torus": cf.Torus((0.2, 0.1, -0.1), (1, 1, 3), 0.8, 0.3),
}
LAW = cf.Section.round(0.02, youngs_modulus=1e7, poisson_ratio=0.3, density=1000)


@njit
def shape_rows(kind, size, points, out):
    for k in range(len(points)):
        closed_form(kind, size, points[k], out[k])


@njit
def mesh_rows(mesh, first, last, guesses, places, out):
    for k in range(len(places)):
        out[k, 17] = guesses[k]
        triangles(mesh[0], mesh[1], first, last, places[k], out[k])


@njit
def laws(gaps, G, P, soft, start, out):
    for k in range(len(gaps)):
        out[k, :3] = kernels.barrier(gaps[k], G, P)
        out[k, 3:] = kernels.layer(gaps[k], soft, start)


@njit
def friction(slips, mu, elastic, m, M):
    for k in range(len(slips)):
        u = slips[k]
        f, g = kernels.slide(u[0], u[1], u[2], mu, elastic)
        for i in range(3):
            m[k, i] = f * u[i]
            for j in range(3):
                M[k, i, j] = (f if i == j else 0.0) - g * u[i] * u[j]


def rows_of(evaluate, places):
    """Distance (n,), gradient (n, 3), Hessian (n, 3, 3)."""
    out = np.zeros((len(places), OUT))
    evaluate(np.ascontiguousarray(places), out)
    return out[:, 0], out[:, 1:4], out[:, 4:13].reshape(-1, 3, 3)


def mesh_of(corners):
    """Triangles (F, 3, 3) as the kernel takes them: facets, and which of them."""
    numbers = np.arange(3 * len(corners)).reshape(-1, 3)
    return facets(corners.reshape(-1, 3), numbers)[0], np.arange(len(corners))


def check_derivatives(evaluate, places, step, tolerance):
    """Gradient and Hessian are central differences of distance and gradient."""
    _, n, H = rows_of(evaluate, places)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1, rtol=1e-13)
    for i, e in enumerate(np.eye(3)):
        plus, minus = rows_of(evaluate, places + step * e), rows_of(evaluate, places - step * e)
        np.testing.assert_allclose((plus[0] - minus[0]) / (2 * step), n[:, i], atol=tolerance)
        np.testing.assert_allclose((plus[1] - minus[1]) / (2 * step), H[:, :, i], atol=10 * tolerance)


@pytest.mark.parametrize("name", SHAPES)
def test_closed_form(name, rng):
    """Distance of `shapes`, unit gradient and Hessian, outside and inside."""
    shape = SHAPES[name]
    places = rng.uniform(-2, 2, (400, 3))
    out = np.zeros((400, OUT))
    distance = np.empty(400)
    shape_rows(shape.kind, shape.size, places, out)
    far_from(shape.kind, shape.size, places, distance)
    expected = shape.distance(places @ shape.frame.T + shape.origin)
    np.testing.assert_allclose(out[:, 0], expected, atol=1e-14)
    np.testing.assert_allclose(distance, expected, atol=1e-14)
    away = places[np.abs(expected) > 0.05]
    assert len(away) > 300
    check_derivatives(lambda y, out: shape_rows(shape.kind, shape.size, y, out), away, 1e-6, 1e-9)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_triangles(count, rng):
    """Nearest of several triangles: distance by brute force; faces, edges and corners have their curvature."""
    corners = rng.uniform(-1, 1, (count, 3, 3))
    mesh, places, guesses = mesh_of(corners), rng.uniform(-2, 2, (500, 3)), rng.integers(-1, count, 500).astype(float)

    def evaluate(y, out):  # whatever is guessed
        mesh_rows(mesh, 0, count, guesses[: len(y)], y, out)

    found, n, H = rows_of(evaluate, places)
    every = np.stack([triangle_distance(places, np.broadcast_to(c, (500, 3, 3))) for c in corners])
    np.testing.assert_allclose(found, every.min(axis=0), rtol=1e-12)
    foot = places - found[:, None] * n  # lies on the nearest one
    nearest = corners[every.argmin(axis=0)]
    np.testing.assert_allclose(triangle_distance(foot, nearest), 0, atol=1e-12)
    others = np.sort(every, axis=0)[1] if count > 1 else np.full(500, np.inf)
    clear = (others - found > 1e-4) & (found > 0.05)
    bend = np.linalg.matrix_rank(H[clear], tol=1e-6)
    assert set(bend) == {0, 1, 2}
    check_derivatives(evaluate, places[clear], 1e-6, 2e-9)


def test_no_triangle_is_far():
    out = np.zeros((1, OUT))
    mesh_rows(mesh_of(np.eye(3)[None]), 0, 0, np.full(1, -1.0), np.zeros((1, 3)), out)
    assert out[0, 0] == np.inf


def test_laws(rng):
    """p = -d psi / dg and k = -dp / dg; nothing beyond the range, twice smooth there, infinite at nothing."""
    G, P, soft, start = 0.02, 300.0, 4e4, 0.004
    g = np.concatenate([G * np.logspace(-4, 0, 50)[:-1], rng.uniform(0, 0.01, 50)])
    h = 1e-4 * g
    out, plus, minus = np.empty((3, len(g), 6))
    laws(g, G, P, soft, start, out)
    laws(g + h, G, P, soft, start, plus)
    laws(g - h, G, P, soft, start, minus)
    change = (plus - minus) / (2 * h[:, None])
    inside = g + h < G
    np.testing.assert_allclose(-change[inside, 2], out[inside, 0], rtol=1e-6, atol=1e-6 * P)
    np.testing.assert_allclose(-change[inside, 0], out[inside, 1], rtol=1e-6, atol=1e-6 * P / G)
    smooth = np.abs(g - start) > h
    np.testing.assert_allclose(change[smooth, 5], out[smooth, 3], rtol=1e-6)
    np.testing.assert_allclose(change[smooth, 3], out[smooth, 4], rtol=1e-6)
    x = np.array([1 - 1e-5, 1.0, 1.5, 1e-12])
    ends = np.empty((4, 6))
    laws(G * x, G, P, soft, start, ends)
    assert ends[0, 0] < 4e-10 * P
    assert ends[0, 1] < 1e-4 * P / G
    assert not ends[1:3, :3].any()
    assert ends[3, 0] > 1e11 * P
    laws(start * np.array([1 - 1e-9, 1 + 1e-9, 0, -1]), G, P, soft, start, ends)
    np.testing.assert_allclose(ends[0, 3:], ends[1, 3:], rtol=1e-8)
    assert not ends[2:, 3:].any()


def test_friction_law(rng):
    """mu at full slip and beyond, in proportion below; its change is a difference; it always takes energy."""
    mu, elastic = 0.4, 2e-3
    u = rng.normal(size=(200, 3)) * rng.uniform(0, 3 * elastic, (200, 1))
    size = np.linalg.norm(u, axis=1)
    u, size = u[np.abs(size - elastic) > 0.01 * elastic], size[np.abs(size - elastic) > 0.01 * elastic]
    m, M = np.empty_like(u), np.empty((len(u), 3, 3))
    friction(u, mu, elastic, m, M)
    np.testing.assert_allclose(np.linalg.norm(m, axis=1), mu * np.minimum(1, size / elastic), rtol=1e-13)
    assert (np.einsum("ki,ki->k", u, m) >= 0).all()
    h = 1e-8
    for i, e in enumerate(np.eye(3)):
        plus, minus = np.empty((2, *u.shape))
        friction(u + h * e, mu, elastic, plus, np.empty_like(M))
        friction(u - h * e, mu, elastic, minus, np.empty_like(M))
        np.testing.assert_allclose((plus - minus) / (2 * h), M[:, :, i], atol=1e-6 * mu / elastic)


def test_moved_past(rng):
    """Places and attitudes less those that would have gone with the part; `turned` says the same of one that stands."""
    part = Rotation.from_rotvec([0.4, -0.8, 0.3])
    then, spin = Rotation.random(20, rng), Rotation.from_rotvec(0.5 * rng.normal(size=(20, 3)))
    now = spin * part * then
    q, q0, turn = (x.as_quat(scalar_first=True) for x in (now, then, part))
    r, r0, shift = rng.normal(size=(20, 3)), rng.normal(size=(20, 3)), rng.normal(size=3)
    (away, theta), (T, R) = np.empty((2, 20, 3)), np.empty((2, 20, 3, 3))
    kernels.moved_past(r, q, r0, q0, turn, part.as_matrix(), shift, away, theta, T, R)
    np.testing.assert_allclose(away, r - part.apply(r0) - shift, atol=1e-14)
    np.testing.assert_allclose(theta, spin.as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(R, now.as_matrix(), atol=1e-14)
    for i, e in enumerate(1e-6 * np.eye(3)):
        plus, minus = (now * Rotation.from_rotvec(sign * e) * (part * then).inv() for sign in (1, -1))
        np.testing.assert_allclose((plus.as_rotvec() - minus.as_rotvec()) / 2e-6, T[:, :, i], atol=1e-9)
    stood, (T0, R0) = np.empty((20, 3)), np.empty((2, 20, 3, 3))
    kernels.turned(q, (part * then).as_quat(scalar_first=True), stood, T0, R0)
    for found, wanted in ((stood, theta), (T0, T), (R0, R)):
        np.testing.assert_allclose(found, wanted, atol=1e-13)


# a rod and what it touches

ON_EDGE = np.array([(1, 0, 1), (0, np.sqrt(2), 0), (-1, 0, 1)]).T / np.sqrt(2)
TOUCHED = {  # its surface half of a range under a straight rod along x, at x = 0.5
    "plane": cf.Plane((0, 0, -0.01), (0, 0, 1)),
    "sphere": cf.Sphere((0.5, 0.02, -0.21 + 1e-3), 0.2),
    "cylinder": cf.Cylinder((0.5, -0.3, -0.21), (0.5, 0.3, -0.21), 0.2),
    "capsule": cf.Capsule((0.52, -0.3, -0.21), (0.48, 0.3, -0.21), 0.2),
    "box": cf.Box((0.5, 0.0, -0.11), (0.2, 0.4, 0.2)),
    "edge": cf.Box((0.5, 0.0, -0.01 - 0.1 * np.sqrt(2)), (0.2, 0.4, 0.2), ON_EDGE),
    "torus": cf.Torus((0.5, 0, 0.02), (1, 0.1, 0.05), 0.1, 0.07),
    "mesh": None,
}  # fmt: skip


def smooth(model, rng, size):
    """Random values (N, 6) that are smooth along each rod."""
    s = model.space.node_s[:, None, None] * np.arange(1, 5)
    waves = rng.normal(size=(4, 6)) * np.sin(3 * s.transpose(0, 2, 1) + rng.uniform(0, 6, (4, 6)))
    return size * waves.sum(axis=1)


def touching(name, friction, tmp_path, *, noise=3e-5, seed=0):
    """A term, its model, and a state that presses and slips, beside a part that turns."""
    rng = np.random.default_rng(seed)
    rod = cf.Rod("r", LAW, [(0, 0, 0), (1, 0, 0)], n_elements=10, order=3)
    motion = cf.Hinge(point=(0.2, 0.1, 0), axis=(0, 0.2, 1), angle=1e-3)
    if name == "mesh":  # a ridge: two faces that meet in an edge
        points = [
            (0.3, -0.3, -0.1),
            (0.5, -0.3, -0.01),
            (0.7, -0.3, -0.1),
            (0.3, 0.3, -0.1),
            (0.5, 0.3, -0.01),
            (0.7, 0.3, -0.1),
        ]
        write_obj(tmp_path / "ridge.obj", points, [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)])
        part = cf.Part("p", mesh=tmp_path / "ridge.obj", motion=motion)
    else:
        part = cf.Part("p", shape=TOUCHED[name], motion=motion)
    term = cf.PartContact(rod, part, friction=friction, stand_off=5e-4, elastic_slip=1e-4)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [term])
    base = model.initial_state()
    du = noise * rng.normal(size=(model.space.n_nodes, 6))
    du[:, 3:] *= 20
    state = model.space.update(base, du)
    contact = Contact(0.02, 0.0, base.r, base.q, {term: term.start(model.space)})
    return term, model, replace(state, contact=contact)


def crossing(angle, friction, *, slip=1e-5, seed=1, beside=0.0):
    """A term, its model, and a state of two rods of different radius that press, after a slip of this size [m]; they cross
    where two elements of either meet, or so far beside it [m]."""
    rng = np.random.default_rng(seed)
    thin = cf.Section.round(0.01, youngs_modulus=1e7, poisson_ratio=0.3, density=1000)
    a = cf.Rod("a", LAW, [(0, 0, 0), (1, 0, 0)], n_elements=10, order=3)
    half, middle = 0.5 * np.array([np.cos(angle), np.sin(angle), 0]), np.array([0.5 + beside, 0, 0.015 - 1e-4])
    ends = middle + (2 * beside + np.array([[-1], [1]])) * half
    b = cf.Rod("b", thin, ends, n_elements=10, order=3)
    term = cf.RodContact([a, b], friction=friction, stand_off=5e-4, elastic_slip=1e-4)
    model = cf.Model([a, b], [cf.Clamp(a, "start")], [term])
    base = model.space.update(model.initial_state(), smooth(model, rng, 3e-5))
    state = model.space.update(base, smooth(model, rng, slip) * [1, 1, 1, 100, 100, 100])
    near = term._near(model.space)
    keys = np.unique(near.keys(near.find(state)))
    slips = 0.3 * slip * rng.normal(size=(len(keys), 3))
    touch = replace(term.start(model.space), keys=keys, slips=slips, forces=np.full(len(keys), np.inf))
    return term, model, replace(state, contact=Contact(0.0, 0.0, base.r, base.q, {term: touch}))


def remembering(term, model, state, harder, *, kept=0.3, seed=2):
    """The state with slips kept from when each place was pressed with so many times less force."""
    near, contact = term._near(model.space), state.contact
    found = near.find(state)
    pressure = term._press(state, model.space, found, False, False)[3][:, 0]
    keys, which = np.unique(near.keys(found), return_inverse=True)
    slips = kept * term.slip * np.random.default_rng(seed).normal(size=(len(keys), 3))
    forces = np.bincount(which, found.rows[:, 1] * pressure) / harder
    touch = replace(contact.touch[term], keys=keys, slips=slips, forces=forces)
    return replace(state, contact=replace(contact, touch={term: touch}))


def residual(term, model, state):
    blocks = term(state, model.space, tangent=False)
    g = np.zeros((model.space.n_nodes, 6))
    np.add.at(g, blocks.nodes, blocks.force)
    return g


def tangent_error(term, model, state, seed=1):
    """Largest error of the tangent along random directions, in parts of the largest entry: forces, moments."""
    rng = np.random.default_rng(seed)
    blocks, n = term(state, model.space), model.space.n_nodes
    K = np.zeros((6 * n, 6 * n))
    for nodes, stiffness in zip(blocks.nodes, blocks.stiffness, strict=True):
        rows = (6 * nodes[:, None] + np.arange(6)).ravel()
        np.add.at(K, np.ix_(rows, rows), stiffness)
    g, errors, h = residual(term, model, state), np.zeros(2), 1e-9
    for _ in range(4):
        v = rng.normal(size=(n, 6))
        plus, minus = (residual(term, model, model.space.update(state, v, s * h)) for s in (1, -1))
        expected = (plus - minus) / (2 * h)
        found = (K @ v.ravel()).reshape(-1, 6)
        found[:, 3:] += 0.5 * np.cross(g[:, 3:], v[:, 3:])  # as for every moment in the axes of its section
        for k, part in enumerate((slice(0, 3), slice(3, 6))):
            scale = np.abs(expected[:, part]).max()
            errors[k] = max(errors[k], np.abs(found - expected)[:, part].max() / scale if scale > 0 else 0.0)
    return errors.max(), K


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("name", TOUCHED)
def test_tangent_with_a_part(name, friction, tmp_path):
    """The derivative, but for points that move along with an isolated stretch; symmetric without friction."""
    term, model, state = touching(name, friction, tmp_path)
    error, K = tangent_error(term, model, state)
    assert len(term._near(model.space).find(state).rows) > 4
    assert error < (1e-7 if name == "plane" else 3e-4)
    assert friction > 0 or abs(K - K.T).max() <= 1e-15 * abs(K).max()


def test_tangent_of_a_lying_rod(tmp_path):
    """Whole cells on a plane: nothing moves along, and the tangent is the derivative."""
    for friction in (0.0, 0.3):
        term, model, state = touching("plane", friction, tmp_path, noise=3e-6)
        assert tangent_error(term, model, state)[0] < 1e-7


@pytest.mark.parametrize(("friction", "slip"), [(0.0, 1e-5), (0.3, 3e-6), (0.3, 5e-5)], ids=["smooth", "stick", "slip"])
@pytest.mark.parametrize("angle", [0.02, 0.3, 1.57])
def test_tangent_between_rods(angle, friction, slip):
    """The derivative, but for points that move along with a crossing."""
    term, model, state = crossing(angle, friction, slip=slip)
    error, K = tangent_error(term, model, state)
    if friction:
        found = term._near(model.space).find(state)
        slips = np.linalg.norm(term._press(state, model.space, found, False, False)[3][:, 4:7], axis=1)
        assert (slips.max() > term.slip) == (slip > 1e-5)
    assert error < 1e-3
    assert friction > 0 or abs(K - K.T).max() <= 1e-15 * abs(K).max()


@pytest.mark.parametrize("kept", [0.3, 30.0], ids=["stick", "slip"])
@pytest.mark.parametrize("harder", [0.5, 3.0])
def test_tangent_pressed_harder(harder, kept, tmp_path):
    """The derivative where the slip kept from before counts in part: on a plane, and between rods but for moving points."""
    term, model, state = touching("plane", 0.3, tmp_path, noise=3e-6)
    state = remembering(term, model, state, harder, kept=kept)
    assert tangent_error(term, model, state)[0] < 1e-7
    values = term._press(state, model.space, term._near(model.space).find(state), False, False)[3]
    np.testing.assert_allclose(values[:, 8], min(1.0, 1.0 / harder), rtol=1e-12)
    for angle, beside, allowed in ((0.02, 0.0, 1e-6), (1.57, 0.03, 1e-2)):
        term, model, state = crossing(angle, 0.3, slip=3e-6, beside=beside)
        assert tangent_error(term, model, remembering(term, model, state, harder, kept=kept))[0] < allowed


def test_pressed_harder_holds_no_more(tmp_path):
    """A place that has not moved pulls with the force that it had, however much harder it is pressed; less when less."""
    pulls = {}
    for sink in (0.0, 2e-4):
        term, model, state = touching("plane", 0.3, tmp_path, noise=0.0)
        near, contact = term._near(model.space), replace(state.contact, time=0.0)
        state = replace(state, contact=contact)
        found = near.find(state)
        keys, which = np.unique(near.keys(found), return_inverse=True)
        pressure = term._press(state, model.space, found, False, False)[3][:, 0]
        forces = np.bincount(which, found.rows[:, 1] * pressure)
        slips = np.tile([0.3 * term.slip, 0.0, 0.0], (len(keys), 1))
        down = np.zeros((model.space.n_nodes, 6))
        down[:, 2] = -sink
        pressed = model.space.update(state, down)
        touch = replace(contact.touch[term], keys=keys, slips=slips, forces=forces)
        pressed = replace(pressed, contact=replace(contact, base_r=pressed.r, base_q=pressed.q, touch={term: touch}))
        pulls[sink] = residual(term, model, pressed).sum(axis=0)
    assert pulls[2e-4][2] < 2 * pulls[0.0][2] < 0
    assert pulls[2e-4][0] == pytest.approx(pulls[0.0][0], rel=1e-9)
    assert pulls[0.0][0] == pytest.approx(-0.3 * 0.3 * pulls[0.0][2], rel=1e-9)


def test_memory_of_friction(rng):
    """What is remembered pulls as it does now, at this normal force; a load that comes and goes leaves it as it was."""
    elastic, force, slip = 1e-4, 2.0, np.array([[6e-5, 0.0, 0.0]])
    place, one = np.array([3]), np.array([force])
    first = Touch(*renewed(Touch.of_nothing(1.0), place, slip, np.ones(1), one, elastic), 1.0)
    for harder in (5.0, 1.7):  # nothing moves: the slip counts in part
        part = np.ones(1) / harder
        again = Touch(*renewed(first, place, slip * part[:, None], part, harder * one, elastic), 1.0)
        np.testing.assert_allclose(again.slips, first.slips, rtol=1e-14)
        np.testing.assert_allclose(again.forces, first.forces, rtol=1e-14)
    for _ in range(200):
        harder, moved = 10 ** rng.uniform(-1, 1), elastic * rng.normal(size=3)
        part = min(1.0, first.forces[0] / (harder * force))
        held = part * first.slips + moved
        held *= np.minimum(1.0, elastic / np.linalg.norm(held))
        again = Touch(*renewed(first, place, held, np.array([part]), harder * one, elastic), 1.0)
        assert np.linalg.norm(again.slips) <= elastic * (1 + 1e-12)
        assert again.forces[0] <= harder * force * (1 + 1e-12)
        np.testing.assert_allclose(again.forces[0] * again.slips[0], harder * force * held[0], rtol=1e-12, atol=1e-18)
        first = again


@pytest.mark.parametrize("kink", [1e-4, -1e-4])
def test_no_jump_where_elements_meet(kink):
    """A rod that slides over another one where two elements of it meet in a kink [rad], of either sense: the push along that
    one changes evenly, forces balance and the tangent is the derivative."""
    term, model, state = crossing(1.57, 0.0, slip=1e-8)
    a, b = (model.space[rod].nodes for rod in model.rods)
    state.r[b, 2] += 0.5 * kink * np.abs(state.r[b, 1])
    pushes = []
    for y in np.linspace(-2e-5, 2e-5, 41):
        r = state.r.copy()
        r[a, 1] += y
        moved = replace(state, r=r)
        g = residual(term, model, moved)
        pushes.append(g[a, 1].sum() / g[a, 2].sum())
    assert np.abs(np.diff(pushes, 2)).max() < 1e-2 * abs(kink)
    assert tangent_error(term, model, state)[0] < 1e-3
    assert np.abs(total_load(model, moved, g)).max() < 1e-12 * np.abs(g).max()


def total_load(model, state, g):
    """Force and moment about the origin (6,) of a residual (N, 6)."""
    R = matrix_from_quaternion(state.q)
    moment = np.cross(state.r, g[:, :3]).sum(0) + np.einsum("nij,nj->i", R, g[:, 3:])
    return np.concatenate([g[:, :3].sum(0), moment])


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("name", TOUCHED)
def test_rod_and_part_balance(name, friction, tmp_path):
    """What acts on the nodes is the opposite of the load of the part, force and moment."""
    term, model, state = touching(name, friction, tmp_path)
    _, told = term.accept(state, model.space)
    g = residual(term, model, state)
    np.testing.assert_allclose(total_load(model, state, g), told.load, atol=1e-12 * np.abs(told.load).max())
    nodes = np.zeros_like(g)
    np.add.at(nodes, told.nodes, told.force)
    np.testing.assert_allclose(nodes, -g, atol=1e-13 * np.abs(g).max())


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("angle", [0.02, 0.3, 1.57])
def test_rods_balance(angle, friction):
    """Force and moment of one rod on the other and back vanish together."""
    term, model, state = crossing(angle, friction)
    g = residual(term, model, state)
    assert np.abs(total_load(model, state, g)).max() < 1e-12 * np.abs(g).max()


def test_cells_that_stray(rng):
    """True as soon as one ball about a cell has left its old place, or outgrown it, by more than it may."""
    term, model = bent(cf.Plane((0, 0, -0.5), (0, 0, 1)))
    state, cells, pose = model.initial_state(), term._near(model.space).cells, (np.eye(3), np.zeros(3))
    middle, radius = cells.balls(state.r, *pose)
    for size in (1e-6, 1e-3):
        r = state.r + size * rng.normal(size=state.r.shape)
        there, larger = cells.balls(r, *pose)
        way = np.linalg.norm(there - middle, axis=1) + np.maximum(larger - radius, 0.0)
        assert not cells.strayed(r, *pose, middle, radius, way * (1 + 1e-9))
        k = int(rng.integers(len(way)))
        assert cells.strayed(r, *pose, middle, radius, np.where(np.arange(len(way)) == k, way * (1 - 1e-9), way * 2))


# stretches


def bent(shape, *, amplitude=0.004, order=3, range_=1e-3):
    """A wavy rod over a shape, with its contact term."""
    x = np.linspace(0, 1, 41)
    rod = cf.Rod("r", LAW, np.c_[x, 0.01 * np.sin(3 * x), amplitude * np.cos(9 * x) ** 2], n_elements=12, order=order)
    term = cf.PartContact(rod, cf.Part("p", shape=shape), stand_off=0.5 * range_)
    return term, cf.Model([rod], [cf.Clamp(rod, "start")], [term])


EDGE = np.array([(1, 0, 0), (0, 1, 1), (0, -1, 1)]).T / [
    1,
    np.sqrt(2),
    np.sqrt(2),
]  # axes of a box with an edge upwards


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize(
    "shape",
    [
        cf.Plane((0, 0, 0), (0, 0, 1)),
        cf.Box((0, 0, -0.05 * np.sqrt(2)), (0.3, 0.1, 0.1), EDGE),
        cf.Capsule((-0.1, 0, 0), (0.1, 0, 0), 5e-4),
    ],
    ids=["plane", "edge", "wire"],
)
def test_no_dip_is_overlooked(shape, order):
    """Elements bent to waves, as an impact makes them: what dips into the barrier is found, wherever in its cell."""
    rng, length = np.random.default_rng(7), 5e-3
    rod = cf.Rod("r", LAW, [(-length, 0, 1), (length, 0, 1)], n_elements=2, order=order)
    term = cf.PartContact(rod, cf.Part("p", shape=shape), radius=1e-3)
    model = cf.Model([rod], [], [term])
    state, near = model.initial_state(), term._near(model.space)
    xi, up = np.linspace(0, 1, 401), np.array([0.0, 0.0, 1.0])
    for _ in range(250):
        angle, wanted = rng.uniform(0.0, np.pi), rng.uniform(0.05, 1.2) * term.range
        r = state.r[:, :1] * [np.cos(angle), np.sin(angle), 0.0] + rng.normal(scale=6e-4, size=(len(state.r), 3))
        places = np.concatenate([near.cells.places(np.full(len(xi), e), xi, r) for e in range(2)])

        def above(height, places=places, wanted=wanted):
            return shape.distance(places + height * up).min() - term.core - wanted

        heights = np.linspace(6e-3, -6e-3, 49)  # lowered until it dips as deep as wanted
        first = next(k for k, height in enumerate(heights) if above(height) < 0.0)
        height = scipy.optimize.brentq(above, heights[first], heights[first - 1], xtol=1e-12)
        found = near.find(replace(state, r=r + height * up))
        assert found.gap <= wanted + 0.06 * term.range
        assert len(found.rows) > 0 or wanted > 0.9 * term.range


@pytest.mark.parametrize("tube", [1.0, 3.0, 10.0])
def test_no_dip_in_a_narrow_hole_is_overlooked(tube):
    """A rod in a ring whose hole is 1 % wider: tilted, it leans on both rims, in one cell, where distance is not convex."""
    rng, radius, length = np.random.default_rng(11), 1e-3, 20e-3
    ring = cf.Torus((0, 0, 0), (1, 0, 0), (1.01 + tube) * radius, tube * radius)
    rod = cf.Rod("r", LAW, [(-length, 0, 0), (length, 0, 0)], n_elements=15, order=3)
    term = cf.PartContact(rod, cf.Part("p", shape=ring), radius=radius)
    model = cf.Model([rod], [], [term])
    state, near = model.initial_state(), term._near(model.space)
    xi, up, tried = np.linspace(0, 1, 401), np.array([0.0, 0.0, 1.0]), 0
    while tried < 100:
        tilt, wanted = rng.uniform(-0.15, 0.15), rng.uniform(0.05, 1.2) * term.range
        r = state.r @ [[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]]
        r = r + [rng.uniform(-1e-3, 1e-3), *rng.normal(scale=3e-6, size=2)] + rng.normal(scale=1e-6, size=r.shape)
        places = np.concatenate([near.cells.places(np.full(len(xi), e), xi, r) for e in range(15)])
        places = places[np.abs(places[:, 0]) < 6e-3]

        def above(height, places=places, wanted=wanted):
            return ring.distance(places + height * up).min() - term.core - wanted

        if above(0.0) < 0.0:
            continue
        tried += 1
        height = scipy.optimize.brentq(above, 0.0, 1e-4, xtol=1e-12)
        found = near.find(replace(state, r=r + height * up))
        assert found.gap <= wanted + 0.06 * term.range


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_no_dip_between_rods_is_overlooked(order):
    """The same of two rods, whose elements also meet in kinks: one of them feels it."""
    rng, length, up = np.random.default_rng(3), 5e-3, np.array([0.0, 0.0, 1.0])
    rods = [
        cf.Rod(name, LAW, [(-length, 0, z), (length, 0, z)], n_elements=2, order=order)
        for name, z in (("a", 0), ("b", 1))
    ]
    term = cf.RodContact(rods, radius=1e-3)
    model = cf.Model(rods, [], [term])
    state, near = model.initial_state(), term._near(model.space)
    upper = model.space.node_rod == 1
    xi = np.linspace(0, 1, 401)
    for _ in range(120):
        turn, wanted = rng.uniform(0.3, np.pi - 0.3), rng.uniform(0.05, 0.9) * term.range
        r = state.r * [1, 1, 0] + rng.normal(scale=2e-4, size=state.r.shape)
        r[upper, :2] = r[upper, :2] @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        places = np.concatenate([near.cells.places(np.full(len(xi), e), xi, r) for e in range(4)])
        low, high = np.split(places, 2)
        tree = scipy.spatial.cKDTree(low)

        def above(height, high=high, tree=tree, wanted=wanted):
            return tree.query(high + height * up)[0].min() - 2e-3 + 0.5 * term.range - wanted

        heights = np.linspace(6e-3, 0.0, 25)
        first = next(k for k, height in enumerate(heights) if above(height) < 0.0)
        height = scipy.optimize.brentq(above, heights[first], heights[first - 1], xtol=1e-12)
        moved = np.where(upper[:, None], r + height * up, r)
        found = near.find(replace(state, r=moved))
        assert found.gap <= wanted + 0.4 * term.range


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize(
    "shape",
    [
        cf.Plane((0, 0, -0.0100), (0.0, 0.001, 1)),
        cf.Cylinder((0.49, -0.5, -0.21), (0.55, 0.5, -0.21), 0.2),
        cf.Sphere((0.5, 0.01, -0.06), 0.05),
        cf.Box((0.5, 0.0, -0.11), (0.43, 0.4, 0.2)),
    ],
    ids=["plane", "cylinder", "sphere", "box"],
)
def test_stretches(shape, order):
    """Lengths of all pressed stretches, work of the barrier and smallest gap, against a dense sum along the rod."""
    term, model = bent(shape, order=order)
    state, near = model.initial_state(), term._near(model.space)
    found, cells = near.find(state), near.cells
    xi, element = (np.arange(20_000) + 0.5) / 20_000, np.arange(len(cells.h))
    gaps, inside, energy = [], 0.0, 0.0
    for e in element:
        gap = shape.distance(cells.places(np.full(len(xi), e), xi, state.r)) - term.core
        values = np.zeros((len(xi), 6))
        laws(gap, term.range, term.start(model.space).scale, 0.0, 1.0, values)
        inside += cells.h[e] * (gap < term.range).mean()
        energy += cells.h[e] * values[:, 2].mean()
        gaps.append(gap.min())
    assert 0 < inside < 0.9
    # ends of rods and, of straight elements, kinks count by themselves
    tips = np.isin(found.rows[:, 0], [0.0, 1.0]) & np.isclose(found.rows[:, 1], cells.tips.max(), rtol=1e-9)
    assert order == 1 or not tips.any()
    assert found.rows[~tips, 1].sum() == pytest.approx(inside, abs=2e-5)
    assert found.gap == pytest.approx(min(gaps), abs=1e-7)
    assert min(gaps) > 0
    values = np.zeros((int(tips.sum()), 6))
    laws(found.rows[tips, 2] - term.core, term.range, term.start(model.space).scale, 0.0, 1.0, values)
    energy += found.rows[tips, 1] @ values[:, 2]
    assert term.potential(state, model.space) == pytest.approx(energy, rel=2e-4)
    assert found.rows[:, 2] == pytest.approx(
        shape.distance(cells.places(found.element, found.rows[:, 0], state.r)), abs=1e-14
    )


def gaps_over_facets(places, facets, edges):
    """Distance (n,) from places (n, 3) to the sides of a prism about y with as many facets, its edges so far from y."""
    pitch = 2 * np.pi / facets
    place = np.hypot(places[:, 0], places[:, 2])
    off = (np.arctan2(places[:, 2], places[:, 0]) - 0.5 * pitch) % pitch  # from the edge before it
    distance = np.full(len(places), np.inf)
    for k in (-1, 0, 1):
        begin = edges * np.array([np.cos(k * pitch), np.sin(k * pitch)])
        way = edges * np.array([np.cos((k + 1) * pitch), np.sin((k + 1) * pitch)]) - begin
        away = np.stack([place * np.cos(off), place * np.sin(off)], axis=1) - begin
        part = np.clip(away @ way / (way @ way), 0, 1)
        distance = np.minimum(distance, np.linalg.norm(away - part[:, None] * way, axis=1))
    return distance


@pytest.mark.parametrize(
    ("radius", "facets", "allowed"),
    [(0.1, 128, 0.01), (0.1, 256, 0.01), (0.1, 512, 0.01), (0.1, 1024, 0.01), (0.004, 64, 0.04)],
)
def test_stretches_over_facets(radius, facets, allowed, tmp_path):
    """Pressure on each cell of a rod that lies on a drum of flat facets and lifts off it, wherever the edges are, against a
    dense sum. Pressure falls to a tenth within half a facet; an edge is nearest for some hundredths of one, or for half."""
    drum = drum_mesh(tmp_path / "drum.obj", radius, facets)
    edges = radius * np.sqrt(2 * np.pi / facets / np.sin(2 * np.pi / facets))
    half = 0.16 if radius > 0.01 else 1.0
    flatter, angle = 1.05 * edges + 0.002, np.linspace(-half, half, 200)
    points = np.c_[flatter * np.sin(angle), 0 * angle, edges + 0.002 - 0.7e-6 - flatter * (1 - np.cos(angle))]
    section = cf.Section.round(0.004, youngs_modulus=1e7, poisson_ratio=0.3, density=1000)
    rod = cf.Rod("r", section, points, n_elements=3, order=3)
    term = cf.PartContact(rod, drum)
    model = cf.Model([rod], [], [term])
    start, cells, n = model.initial_state(), term._near(model.space).cells, 5000

    def pressures(gaps):
        values = np.zeros((len(gaps), 6))
        laws(gaps - term.core, term.range, 1.0, 0.0, 1.0, values)
        return values[:, 0]

    found, dense = [], []
    for turn in 2 * np.pi / facets * np.linspace(0, 1, 20, endpoint=False):
        state = replace(start, r=start.r @ Rotation.from_rotvec([0, turn, 0]).as_matrix().T)
        near = term._near(model.space).find(state)
        found.append(np.bincount(near.cell, near.rows[:, 1] * pressures(near.rows[:, 2]), len(cells.cells)))
        dense.append([])
        for element, number in cells.cells:
            xi = (number + (np.arange(n) + 0.5) / n) / cells.counts[element]
            gaps = gaps_over_facets(cells.places(np.full(n, element), xi, state.r), facets, edges)
            dense[-1].append(cells.h[element] / cells.counts[element] * pressures(gaps).mean())
    dense = np.array(dense)
    assert (np.array(found) > 0).sum() >= 20
    assert abs(np.array(found) - dense).max() < allowed * dense.max()


def test_no_jump_as_a_patch_moves():
    """A small ball that slides along the rod, over cells and elements, presses as hard everywhere."""
    rod = cf.Rod("r", LAW, [(0, 0, 0), (1, 0, 0)], n_elements=7, order=3)
    forces = []
    for x in np.linspace(0.3, 0.7, 101):
        term = cf.PartContact(rod, cf.Part("p", shape=cf.Sphere((x, 0, -0.0125), 0.0025)))
        model = cf.Model([rod], [cf.Clamp(rod, "start")], [term])
        forces.append(residual(term, model, model.initial_state())[:, 2].sum())
    assert np.ptp(forces) < 2e-4 * abs(np.mean(forces))


@pytest.mark.parametrize(("angle", "allowed"), [(0.1, 1e-9), (0.3, 1e-6)])
def test_no_jump_as_the_smallest_gap_goes_on(angle, allowed):
    """Straight rods that cross, one of them sliding: their energy stays, wherever in a cell they are nearest."""
    a = cf.Rod("a", LAW, [(0, 0, 0), (1, 0, 0)], n_elements=7, order=3)
    half = 0.5 * np.array([np.cos(angle), np.sin(angle), 0])
    middle = np.array([0.5, 0, 0.0202])
    b = cf.Rod("b", LAW, [middle - half, middle + half], n_elements=7, order=3)
    term = cf.RodContact([a, b], stand_off=5e-4)
    model = cf.Model([a, b], [], [term])
    state, slides = model.initial_state(), np.zeros((model.space.n_nodes, 3))
    slides[model.space[a].nodes] = 1.0, 0.0, 0.0
    ways = np.linspace(0, 2 * 1.5 * 0.01, 201)
    energy = np.array([term.potential(replace(state, r=state.r + way * slides), model.space) for way in ways])
    assert energy.min() > 0
    assert np.abs(np.diff(energy)).max() < allowed * energy.mean()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_kink_is_felt(order):
    """Elements that meet in a kink over a wire: however little of the rod is near, the nearest place of it presses."""
    rod = cf.Rod("r", LAW, [(-0.05, 0, 0), (0.05, 0, 0)], n_elements=2, order=order)
    term = cf.PartContact(rod, cf.Part("p", shape=cf.Capsule((0, -1, 0), (0, 1, 0), 0.005)))
    model = cf.Model([rod], [], [term])
    state = model.initial_state()
    for slope in (0.3, 1.0, 3.0):
        for gap in (0.5, 1e-3, 1e-6):
            r = state.r + np.outer(slope * np.abs(state.r[:, 0]) + term.core + 0.005 + gap * term.range, [0, 0, 1])
            found = term._near(model.space).find(replace(state, r=r))
            assert found.gap == pytest.approx(gap * term.range, rel=1e-6)
            assert found.rows[:, 2].min() - term.core == pytest.approx(found.gap, rel=1e-6)
