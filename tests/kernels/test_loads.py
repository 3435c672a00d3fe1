"""Loads at nodes: kernels against NumPy."""

import numpy as np

from cosserat_fem.kernels.loads import loads_in_space
from cosserat_fem.kernels.rotation import matrix_from_quaternion


def test_loads_in_space():
    """Forces stay, moments about the section's axes are turned."""
    rng = np.random.default_rng(4)
    q = rng.normal(size=(9, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    g, nodes = rng.normal(size=(9, 6)), np.array([7, 0, 3])
    out = np.empty((3, 6))
    loads_in_space(nodes, q, g, out)
    moment = np.einsum("nij,nj->ni", matrix_from_quaternion(q[nodes]), g[nodes, 3:])
    np.testing.assert_allclose(out, np.hstack([g[nodes, :3], moment]), rtol=1e-14, atol=1e-14)
