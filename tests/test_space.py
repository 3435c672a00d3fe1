"""Where unknowns live: elements on scikit-fem, numbering, packs."""

import numpy as np
import pytest
from skfem import Basis, MeshLine

import cosserat_fem as cf
from cosserat_fem.space import ElementLineGLL, Space, from_lanes, gauss_lobatto, lanes

SECTION = cf.Section.round(0.01, youngs_modulus=1e9, density=1200)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6])
def test_element_is_nodal(order):
    """Each shape function is 1 at its node, 0 at the others, and they sum to 1; slopes sum to 0."""
    element = ElementLineGLL(order)
    basis = Basis(MeshLine(np.linspace(0, 2, 4)), element)
    x = basis.doflocs[0]
    np.testing.assert_allclose(basis.probes(x[None]).toarray(), np.eye(len(x)), atol=1e-13)
    points = np.linspace(0, 1, 7)[None]
    values = np.array([element.lbasis(points, i) for i in range(order + 1)], dtype=object)
    np.testing.assert_allclose(sum(v[0] for v in values), 1.0, atol=1e-13)
    np.testing.assert_allclose(sum(v[1][0] for v in values), 0.0, atol=1e-12)


def test_gauss_lobatto_points():
    np.testing.assert_allclose(gauss_lobatto(2), [0, 0.5, 1])
    np.testing.assert_allclose(2 * gauss_lobatto(3) - 1, [-1, -np.sqrt(0.2), np.sqrt(0.2), 1], atol=1e-15)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6])
def test_one_gauss_point_between_neighbouring_nodes(order):
    """The files rely on it: a line cell between two nodes holds the values of one Gauss point."""
    nodes, points = gauss_lobatto(order), 0.5 * (1 + np.polynomial.legendre.leggauss(order)[0])
    assert ((nodes[:-1] < points) & (points < nodes[1:])).all()


def test_packs_round_trip(rng):
    for n in (1, 15, 16, 17, 40):
        array = rng.normal(size=(n, 3, 2))
        packed = lanes(array)
        assert packed.shape[1:] == (3, 2, 16)
        np.testing.assert_array_equal(from_lanes(packed, n), array)


def test_several_rods_of_several_orders():
    """Numbers are unique, nodes run along s, vertices are consecutive, and shares sum to the length."""
    rods = [
        cf.Rod("a", SECTION, [(0, 0, 0), (1, 0, 0)], order=3, n_elements=4),
        cf.Rod("b", SECTION, [(0, 1, 0), (2, 1, 0)], order=1, n_elements=7),
        cf.Rod("c", SECTION, [(0, 2, 0), (1, 2, 1)], order=3, n_elements=2),
    ]
    space = Space(rods, [[], [0.3], []])
    every = np.concatenate([space[rod].nodes for rod in rods])
    np.testing.assert_array_equal(np.sort(every), np.arange(space.n_nodes))
    for rod in rods:
        view = space[rod]
        assert (np.diff(view.s) > 0).all()
        assert (np.diff(view.vertices) == 1).all()
        np.testing.assert_allclose(space.drawn_state().r[view.nodes], rod.drawn(view.s))
        assert space.share(rod).sum() == pytest.approx(rod.length)
        np.testing.assert_allclose(space.node_s[view.nodes], view.s)
    assert space.node_s[space.node(rods[1], 0.3)] == pytest.approx(0.3)
    assert space.node_mass.sum() == pytest.approx(SECTION.mass_per_length * sum(r.length for r in rods))


def test_share_of_a_profile():
    """Integral of a profile times shape functions: exact for polynomials the Gauss points integrate."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (2, 0, 0)], order=3, n_elements=3)
    space = Space([rod], [[]])
    assert space.share(rod, lambda s: s**2).sum() == pytest.approx(8 / 3)


@pytest.mark.parametrize("rotation", ["quaternion", "kardan"])
def test_update_is_a_value(rotation, rng):
    """An update makes a new state and leaves the old one alone."""
    rod = cf.Rod("a", SECTION, [(0, 0, 0), (0, 0, 1)], order=2, n_elements=3)
    space = Space([rod], [[]], rotation)
    state = space.drawn_state()
    before = state.r.copy(), state.q.copy()
    du = rng.normal(size=(space.n_nodes, 6)) * 0.1
    new = space.update(state, du)
    np.testing.assert_array_equal(state.r, before[0])
    np.testing.assert_array_equal(state.q, before[1])
    np.testing.assert_allclose(new.r, state.r + du[:, :3])
    np.testing.assert_allclose(np.linalg.norm(new.q, axis=1), 1, atol=1e-15)
    # spin axes: the change of attitude along each unknown
    H = space.spin_axes(new)
    for j in range(3):
        h = 1e-6
        e = np.zeros_like(du)
        e[:, 3 + j] = h
        plus, minus = (space.update(new, s * e) for s in (1, -1))
        from cosserat_fem.kernels.rotation import matrix_from_quaternion

        spin = (
            (matrix_from_quaternion(plus.q) - matrix_from_quaternion(minus.q))
            / (2 * h)
            @ np.swapaxes(matrix_from_quaternion(new.q), 1, 2)
        )
        found = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(found, H[:, :, j], atol=1e-8)


def test_kardan_singularity_is_named():
    """A rod along x cannot be described: the place is named and quaternions advised."""
    rod = cf.Rod("cable", SECTION, [(0, -1, 0), (0.3, -0.6, 0), (1, 0, 0)], end_tangent=(1, 0, 0))
    with pytest.raises(cf.KardanError, match=r"rod 'cable' at its end: theta = 90.00 deg.*rotation = \"quaternion\""):
        cf.Model([rod], [cf.Clamp(rod, "start")], rotation="kardan").initial_state()
