"""How does a rod vibrate about a state? Natural frequencies and shapes of small motions about a deformed, loaded state.

Rule: (K - omega^2 M) phi = 0 with the whole tangent K of all terms at the state and the lumped mass M of the rods, in the
unknowns that supports and welds leave free. Nothing is damped, and parts stand still.

Where every load has a potential K is symmetric: omega^2 is real, negative for a motion away from an unstable state
(divergence). Following loads make it unsymmetric; then omega^2 may be a complex pair, a vibration that grows (flutter).
Found nearest to zero by shift-invert iteration (ARPACK), or all at once in small models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, SuperLU, eigs, eigsh, splu

from ..errors import CosseratError, SceneError, check_integer, one_line
from ..iteration.newton import STAGNANT, Newton
from ..model import Model
from ..space import State

DENSE, UNSYMMETRIC = 400, 100  # unknowns up to which a dense solution is faster, with a symmetric tangent and without
AT_REST = 1e-6  # relative residual of an equilibrium
SHIFT = 0.01  # times EI / (m L^4), below zero: motions without stiffness make the tangent itself singular
NOISE = 1e-9  # of the largest 1 / omega^2: an imaginary part below it is round-off


@dataclass(frozen=True, eq=False)
class Modes:
    """Small vibrations about one state, in order of frequency, those that grow first.

    Attributes
    ----------
    model, state
    squared (n,) [rad^2/s^2] : omega^2, complex if loads follow the rods
    shapes (n, N, 6) : real motions of the nodes, displacements in space [m] and rotations in the section's axes [rad];
        largest displacement 1 (or rotation, of a motion that only turns); of a complex pair real and imaginary part
    """

    model: Model
    state: State
    squared: np.ndarray
    shapes: np.ndarray

    def __repr__(self) -> str:
        return f"<Modes: {', '.join(f'{f:.6g}' for f in self.frequency)} Hz{'' if self.stable else ', unstable'}>"

    @property
    def _exponents(self) -> np.ndarray:
        """The exponent s (n,) of exp(s t) that grows, or the one that turns forward."""
        s = np.sqrt(-self.squared.astype(complex))
        return np.where(s.real > 1e-6 * np.abs(s), s, 1j * np.abs(s))

    @property
    def omega(self) -> np.ndarray:
        """Angular frequencies (n,) [rad/s]; 0 of a motion that only grows."""
        return np.abs(self._exponents.imag)

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies (n,) [Hz]."""
        return self.omega / (2 * np.pi)

    @property
    def growth(self) -> np.ndarray:
        """Rates of growth (n,) [1/s]; 0 of a vibration that neither grows nor dies."""
        return self._exponents.real

    @property
    def stable(self) -> bool:
        """True if none of these motions grows."""
        return not (self.growth > 0).any()


def modes(model: Model, state: State | None = None, n: int = 10) -> Modes:
    """Vibrations of lowest frequency about an equilibrium.

    Parameters
    ----------
    model : Model
        Of a path of loads the one at the state's factor: `model.with_factor(factor, loads)`.
    state : State, optional
        An equilibrium (`history.final`); default the drawn shape, for a rod that is free of stress there.
    n : int
        How many.

    Raises
    ------
    SceneError
        A rod has no mass; the model has Kardan angles.
    ValueError
        The state is not one of this model, or no equilibrium.
    """
    n = check_integer("modes: n", n, 1)
    state = model.initial_state() if state is None else state
    model.check_state(state)
    space = model.space
    if model.rotation != "quaternion":
        raise SceneError("modes: vibrations need rotation = 'quaternion'.")
    if model.theory == "string":
        raise SceneError("modes: vibrations of strings are not known; use theory = 'kirchhoff'.")
    for rod in model.rods:
        if not space.node_mass[space[rod].nodes].all():
            raise SceneError(f"modes: rod {rod.name!r} has no mass. Give its section a density or mass_per_length.")
    K, M, B, free = _reduced(model, state)
    scales = model.scales
    light = float(space.node_mass.sum() / space.lengths.sum())
    shift = -SHIFT * scales["bending"] / (light * scales["length"] ** 4)
    squared, vectors = _solve(K, M, min(n, len(free)), shift, model.symmetric)
    y = np.zeros((6 * space.n_nodes, len(squared)), dtype=vectors.dtype)
    y[free] = vectors
    shapes = (y if B is None else B @ y).T
    return Modes(model, state, squared, _real(shapes, squared).reshape(len(squared), -1, 6))


def _reduced(model: Model, state: State) -> tuple[csc_matrix, csc_matrix, csc_matrix | None, np.ndarray]:
    """Tangent and mass in the free unknowns, the map of all unknowns to nodes, and which are free."""
    space, c = model.space, model.constraints
    newton = Newton(model)
    state = replace(state, stress=model.internal.with_stress(state, space), velocity=None, slope=0.0)
    total = model.residual(state)
    held = c.evaluate(state, c.targets(state.t), c.reactions(state, total.g)[:, 3:])
    bending, length = model.scales["bending"], model.scales["length"]
    floor = replace(total, force=max(total.force, bending / length**2), moment=max(total.moment, bending / length))
    residual, _ = newton.measure(state, floor, held, None, AT_REST)
    if residual > STAGNANT or not newton.closed(held):
        raise ValueError(
            f"modes: the state is no equilibrium of this model (residual {AT_REST * residual:.1e} of the section forces). "
            "Solve for it first; of a path of loads use model.with_factor(factor, loads)."
        )
    K, B, free = newton.linear.reduced(model.matrix(state), held)
    mass = np.concatenate([np.repeat(space.node_mass[:, None], 3, axis=1), space.node_inertia], axis=1)
    M = diags(mass.ravel()).tocsc()
    if B is not None:
        M = (B.T @ M @ B).tocsc()
    return K.tocsr()[free][:, free].tocsc(), M.tocsr()[free][:, free].tocsc(), B, free


def _solve(K: csc_matrix, M: csc_matrix, n: int, shift: float, symmetric: bool) -> tuple[np.ndarray, np.ndarray]:
    """The n eigenvalues of K x = lambda M x nearest to a shift, in order, and their vectors. M may be singular."""
    if symmetric:
        K = 0.5 * (K + K.T)
    try:
        lu = splu((K - shift * M).tocsc())
        mu, vectors = _inverse(lu, K, M, shift, n, symmetric)
    except (RuntimeError, ArpackError, ArpackNoConvergence) as error:
        raise CosseratError(f"modes: the vibrations were not found ({one_line(error)}).") from None
    return _sorted(mu, vectors, shift, n)


def _inverse(
    lu: SuperLU, K: csc_matrix, M: csc_matrix, shift: float, n: int, symmetric: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Largest eigenvalues mu = 1 / (lambda - shift) of the inverse times M, and their vectors; all if there are few."""
    size = K.shape[0]
    if size > max(DENSE if symmetric else UNSYMMETRIC, 4 * n):
        count, start = min(n + 2, size - 2), np.random.default_rng(0).normal(size=size)
        inverse = LinearOperator(K.shape, lu.solve, dtype=float)
        solve = eigsh if symmetric else eigs
        values, vectors = solve(K, count, M, sigma=shift, which="LM", v0=start, OPinv=inverse)
        return 1.0 / (values - shift), vectors
    if not symmetric:
        mu, vectors = eig(lu.solve(M.toarray()))
        return mu, vectors
    root = _root(M)
    mu, y = eigh(root @ lu.solve(root))
    return mu, lu.solve(root @ y)


def _root(M: csc_matrix) -> np.ndarray:
    """Symmetric square root of the mass matrix, which is diagonal but for joints and tilted supports."""
    dense, diagonal = M.toarray(), M.diagonal()
    if np.count_nonzero(dense) == np.count_nonzero(diagonal):
        return np.diag(np.sqrt(diagonal))
    values, vectors = eigh(dense)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def _sorted(mu: np.ndarray, vectors: np.ndarray, shift: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The n eigenvalues nearest to zero by real part, pairs together; made real where all are but for round-off."""
    largest = np.argsort(-np.abs(mu), kind="stable")[:n]
    mu, vectors = mu[largest], vectors[:, largest]
    mu = np.where(np.abs(np.imag(mu)) <= NOISE * np.abs(mu).max(), np.real(mu), mu)
    with np.errstate(divide="ignore"):
        values = shift + 1.0 / mu
    order = np.lexsort((np.imag(values), np.round(np.real(values) / np.abs(values).min(), 6)))
    values = values[order]
    return (values if np.iscomplex(values).any() else np.real(values)), vectors[:, order]


def _real(shapes: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Real shapes (n, 6 N): the second of a complex pair is the imaginary part; largest displacement 1."""
    out = np.where((np.imag(squared) > 0)[:, None], np.imag(shapes), np.real(shapes)).astype(float)
    nodes = out.reshape(len(out), -1, 6)
    moved, turned = np.abs(nodes[..., :3]).max((1, 2)), np.abs(nodes[..., 3:]).max((1, 2))
    size = np.where(moved > 1e-9 * turned, moved, turned)
    return out / np.maximum(size, 1e-300)[:, None]
