"""Linear systems of networks: SuperLU and multigrid give one answer, and each is chosen where it belongs."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

import cosserat_fem as cf
from cosserat_fem.iteration.linear import AMG_JOINTS, LinearSolver, solve_amg, solve_sparse

SECTION = cf.Section.round(0.004, youngs_modulus=2e9)


def lattice(n, *, step=0.1, order=1):
    """Cubic lattice of n^3 joints: 3 n^2 rods, clamped at the bottom, loaded at a corner."""
    rods = {}
    for d in range(3):
        i_axis, j_axis = (k for k in range(3) if k != d)
        for i in range(n):
            for j in range(n):
                start = np.zeros(3)
                start[i_axis], start[j_axis] = i * step, j * step
                end = start.copy()
                end[d] = (n - 1) * step
                rods[d, i, j] = cf.Rod(f"{'xyz'[d]} {i} {j}", SECTION, [start, end], n_elements=n - 1, order=order)
    supports = []
    for i in range(n):
        for j in range(n):
            supports.append(cf.Clamp(rods[2, i, j], "start"))
            for k in range(n):
                x, y, z = rods[0, j, k], rods[1, i, k], rods[2, i, j]
                supports += [cf.Weld(x, i * step, y, j * step), cf.Weld(x, i * step, z, k * step)]
    corner = cf.PointLoad(rods[2, n - 1, n - 1], "end", force=(1.0, 0.5, -1.0))
    return cf.Model(list(rods.values()), supports, [corner])


def test_multigrid_equals_factorisation():
    """The joint matrix of a small lattice, solved both ways; rigid modes are in the null space of a free one."""
    model = lattice(5, order=2)
    solver = LinearSolver(model.space, model.constraints)
    state = model.initial_state()
    total = model.condensed(state, solver.scratch, 0.0, None)
    held = model.constraints.evaluate(state, model.constraints.targets(0.0))
    kept = {}
    inner = solver._solve_joints

    def spy(state, vertex_rhs, held, symmetric):
        from scipy.sparse import coo_matrix

        n = 6 * len(model.constraints.joints)
        kept["K"] = coo_matrix((solver.joint_S[solver._entry], (solver._rows, solver._columns)), shape=(n, n)).tocsr()
        return inner(state, vertex_rhs, held, symmetric)

    solver._solve_joints = spy
    solution = solver.solve(state, total.g, held, total.negative, True)
    assert solution.method == "splu"
    K, b = kept["K"], np.random.default_rng(0).normal(size=kept["K"].shape[0])
    direct, negative = solve_sparse(K.tocsc(), b, True)
    assert negative == 0
    found = solve_amg(K, b, solver._rigid_modes(state))
    np.testing.assert_allclose(found, direct, atol=1e-7 * abs(direct).max())


def test_multigrid_refuses_an_indefinite_matrix():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(60, 60))
    K = csr_matrix(A + A.T + np.diag(np.where(np.arange(60) == 3, -40.0, 40.0)))
    assert solve_amg(K, np.ones(60), np.tile(np.eye(6), (10, 1))) is None
    y, negative = solve_sparse(K.tocsc(), np.ones(60), True)
    np.testing.assert_allclose(K @ y, 1, atol=1e-9)
    assert negative in (int((np.linalg.eigvalsh(K.toarray()) < 0).sum()), -1)


def test_lattice_statics():
    """A network as a whole: reactions balance the load, SuperLU is chosen, the state is stable."""
    model = lattice(4, order=2)
    history = cf.solve_static(model)
    total = sum(history.reaction(h)[0, :3] for h in model.supports)
    np.testing.assert_allclose(total, (-1.0, -0.5, 1.0), atol=1e-8)
    assert set(history.counters.linear) == {"splu"}
    assert history.stable == [True]


@pytest.mark.slow
def test_multigrid_is_chosen_for_a_large_network():
    """A lattice of 5832 joints, 35 000 unknowns: solved by multigrid, balanced to 1e-8."""
    model = lattice(18)
    assert len(model.constraints.joints) > AMG_JOINTS
    history = cf.solve_static(model)
    assert set(history.counters.linear) == {"amg"}
    total = sum(history.reaction(h)[0, :3] for h in model.supports)
    np.testing.assert_allclose(total, (-1.0, -0.5, 1.0), atol=1e-8)


def test_singular_matrix_is_reported():
    K = csr_matrix(np.diag([1.0, 0.0, 2.0]))
    y, negative = solve_sparse(K.tocsc(), np.ones(3), True)
    assert not np.isfinite(y).all()
    assert negative == -1
