"""Small builders that several tests use."""

import numpy as np

import cosserat_fem as cf


def curved_space(order, *, coupled=False, rotation="quaternion", n_elements=5, shape=None):
    """A space of one bent and twisted rod, and a state that is strained at random but moderately."""
    rng = np.random.default_rng(7)
    if coupled:
        C = rng.normal(size=(6, 6))
        section = cf.Section(coupled=C @ C.T + 6 * np.eye(6))
    else:
        section = cf.Section(force_stiffness=(3.0, 4.0, 5.0), moment_stiffness=(0.7, 1.1, 0.9))
    points = [(0, 0, 0), (0.2, 0.5, 0.1), (0.1, 0.9, 0.6), (0.0, 1.2, 1.0)] if shape is None else shape
    rod = cf.Rod("r", section, points, n_elements=n_elements, order=order, length=1.7, rest=(0.3, -0.2, 0.5))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], rotation=rotation)
    state = model.initial_state()
    du = 0.1 * rng.normal(size=(model.space.n_nodes, 6))
    state = model.space.update(state, du)
    memory = tuple(m + 0.3 * rng.normal(size=m.shape) for m in state.stress)
    return model, cf.State(0.0, state.r, state.q, memory, state.angles)


def write_obj(path, points, triangles):
    """Write a triangle mesh as an OBJ file, all digits kept."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(points, dtype=float).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(triangles) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")


def drum_mesh(path, radius, facets, **options):
    """A drum of as many facets about y, of the same mean radius, as a part."""
    angle = 2 * np.pi * (np.arange(facets) + 0.5) / facets
    r = radius * np.sqrt(2 * np.pi / facets / np.sin(2 * np.pi / facets))
    ring = np.c_[r * np.cos(angle), 0 * angle, r * np.sin(angle)]
    points = np.concatenate([ring - [0, 0.05, 0], ring + [0, 0.05, 0], [(0, -0.05, 0), (0, 0.05, 0)]])
    i, j = np.arange(facets), np.roll(np.arange(facets), -1)
    triangles = np.concatenate(
        [
            np.c_[i, i + facets, j],
            np.c_[j, i + facets, j + facets],
            np.c_[i, j, 0 * i + 2 * facets],
            np.c_[j + facets, i + facets, 0 * i + 2 * facets + 1],
        ]
    )
    write_obj(path, points, triangles)
    return cf.Part("drum", mesh=path, **options)


def centreline(model, rod, state, count):
    """Places (S, 3) [m] of a rod's centreline, `count` to an element and its end: Lagrange polynomials, written out."""
    nodes, order = model.space[rod].nodes, rod.order
    x = np.polynomial.Legendre.basis(order).deriv().roots().real
    x = 0.5 * (1 + np.concatenate([[-1], np.sort(x), [1]]))
    xi = np.arange(count) / count
    N = [np.prod([(xi - x[j]) / (x[i] - x[j]) for j in range(order + 1) if j != i], axis=0) for i in range(order + 1)]
    local = np.arange(0, len(nodes) - 1, order)[:, None] + np.arange(order + 1)
    places = np.einsum("ak,eai->eki", np.broadcast_to(N, (order + 1, count)), state.r[nodes[local]])
    return np.concatenate([places.reshape(-1, 3), state.r[nodes[-1:]]])


def round_a_drum(r, turn, h, free):
    """Drawing (n, 3) of a rope that comes up, goes round a drum at distance r [m] from its axis z by `turn` [rad] and on
    straight by `free` [m], in pieces of a quarter of h [m]; and the direction (3,) in which it leaves."""
    angle = np.linspace(0, turn, int(4 * turn * r / h))
    arc = r * np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    out = np.array([np.sin(turn), np.cos(turn), 0.0])
    span = np.linspace(-free, -h / 4, 12)[:, None]
    return np.concatenate([arc[0] + span * [0, 1, 0], arc, arc[-1] - span[::-1] * out]), out
