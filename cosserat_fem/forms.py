"""What does the paper say? The weak form as scikit-fem forms, to be read and to hold the kernels against.

Rule: clarity only. Every line is the definition or the product rule; nothing here is used by a solver. Strains are

    Gamma = R^T r',   K = axial(R^T R')          (material frame; ' = d/ds, s the unstressed arc length)

and the internal virtual work is  n . dGamma + m . dK  with (n, m) = C ((Gamma, K) - reference).

Quaternion interpolation: the fields are r (3) and a quaternion q (4) that need not be unit:
Gamma = vec(q* r' q) / |q|^2,  K = 2 vec(q* q') / |q|^2. Forms are tested with (dr, dq); nodal rotation vectors enter by
dq = q o (0, phi) / 2 at each node. Kardan interpolation: the fields are r and (psi, theta, phi).

Source: virtual work of the geometrically exact beam: Simo and Vu-Quoc (1986), doi 10.1016/0045-7825(86)90079-4.
"""

from __future__ import annotations

import numpy as np
from skfem import Basis, BilinearForm, ElementVector, LinearForm
from skfem.helpers import dot

from .kernels.rotation import multiply
from .space import Group, State


def d_s(u):
    """Derivative along the arc length."""
    return u.grad[:, 0]


def product(a, b):
    """Quaternion product, components first; complex numbers pass, for complex-step derivatives."""
    real = a[:1] * b[:1] - (a[1:] * b[1:]).sum(0, keepdims=True)
    return np.concatenate([real, a[:1] * b[1:] + b[:1] * a[1:] + np.cross(a[1:], b[1:], axis=0)])


def conj(a):
    return np.concatenate([a[:1], -a[1:]])


def vec(a):
    return a[1:]


def pure(x):
    return np.concatenate([np.zeros_like(x[:1]), x])


def strain(r_s, q, q_s):
    """Gamma and K (6, ...)."""
    s = (q * q).sum(0)
    return np.concatenate([vec(product(product(conj(q), pure(r_s)), q)), 2 * vec(product(conj(q), q_s))]) / s


def numerator(x, p, d):
    """Gamma and K times |q|^2, as a form that is linear in x and d and quadratic in p: f(x; p, p), g(p, d)."""
    return np.concatenate([vec(product(product(conj(p), pure(x)), p)), 2 * vec(product(conj(p), d))])


def numerator_first(x, p, d, dx, dp, dd):
    """Product rule on `numerator`."""
    force = product(product(conj(dp), pure(x)), p) + product(product(conj(p), pure(x)), dp)
    force = force + product(product(conj(p), pure(dx)), p)
    return np.concatenate([vec(force), 2 * vec(product(conj(dp), d) + product(conj(p), dd))])


def numerator_second(x, p, dx1, dp1, dd1, dx2, dp2, dd2):
    """Product rule, twice."""
    force = product(product(conj(dp1), pure(x)), dp2) + product(product(conj(dp2), pure(x)), dp1)
    force = force + product(product(conj(dp1), pure(dx2)), p) + product(product(conj(p), pure(dx2)), dp1)
    force = force + product(product(conj(dp2), pure(dx1)), p) + product(product(conj(p), pure(dx1)), dp2)
    return np.concatenate([vec(force), 2 * vec(product(conj(dp1), dd2) + product(conj(dp2), dd1))])


def strain_first(r_s, q, q_s, dr_s, dq, dq_s):
    """Variation of the strains: quotient rule on numerator / |q|^2."""
    s, ds = (q * q).sum(0), 2 * (q * dq).sum(0)
    return numerator_first(r_s, q, q_s, dr_s, dq, dq_s) / s - numerator(r_s, q, q_s) * ds / s**2


def strain_second(r_s, q, q_s, one, two):
    """Second variation of the strains: quotient rule, twice.  one, two: (dr_s, dq, dq_s)."""
    s = (q * q).sum(0)
    ds1, ds2, dds = 2 * (q * one[1]).sum(0), 2 * (q * two[1]).sum(0), 2 * (one[1] * two[1]).sum(0)
    f = numerator(r_s, q, q_s)
    f1, f2 = numerator_first(r_s, q, q_s, *one), numerator_first(r_s, q, q_s, *two)
    f12 = numerator_second(r_s, q, *one, *two)
    return f12 / s - (f1 * ds2 + f2 * ds1 + f * dds) / s**2 + 2 * f * ds1 * ds2 / s**3


@LinearForm
def internal_virtual_work(dr, dq, w):
    """n . dGamma + m . dK"""
    return dot(w.stress, strain_first(d_s(w.r), w.q, d_s(w.q), d_s(dr), dq, d_s(dq)))


@BilinearForm
def tangent(dr1, dq1, dr2, dq2, w):
    """dstrain . C dstrain + memory . ddstrain, the second with the stress the Newton method carries along."""
    base = (d_s(w.r), w.q, d_s(w.q))
    one, two = (d_s(dr1), dq1, d_s(dq1)), (d_s(dr2), dq2, d_s(dq2))
    material = dot(strain_first(*base, *two), np.einsum("ij...,j...->i...", w.C, strain_first(*base, *one)))
    return material + dot(w.memory, strain_second(*base, one, two))


def kardan_axes(a):
    """Body axes (3, 3, ...) of the three turns, b[i] the i-th axis."""
    zero = np.zeros_like(a[0])
    return np.stack(
        [
            np.stack([np.cos(a[1]) * np.cos(a[2]), -np.cos(a[1]) * np.sin(a[2]), np.sin(a[1])]),
            np.stack([np.sin(a[2]), np.cos(a[2]), zero]),
            np.stack([zero, zero, zero + 1.0]),
        ]
    )


def kardan_quaternion(a):
    """cos and sin of half the angles, one quaternion for each turn, multiplied."""
    c, s, zero = np.cos(a / 2), np.sin(a / 2), np.zeros_like(a[0])
    turns = [np.stack([c[k], *(s[k] if i == k else zero for i in range(3))]) for k in range(3)]
    return product(product(turns[0], turns[1]), turns[2])


def kardan_strain(r_s, a, a_s):
    """Gamma and K (6, ...) from displacements and Kardan angles."""
    q = kardan_quaternion(a)
    gamma = vec(product(product(conj(q), pure(r_s)), q))
    return np.concatenate([gamma, np.einsum("ij...,i...->j...", kardan_axes(a), a_s)])


def kardan_strain_first(r_s, a, a_s, dr_s, da, da_s):
    """Variation of the strains: dGamma = R^T dr' + Gamma x omega, dK by the product rule."""
    q, b = kardan_quaternion(a), kardan_axes(a)
    zero = np.zeros_like(a[0])
    gamma = vec(product(product(conj(q), pure(r_s)), q))
    omega = np.einsum("ij...,i...->j...", b, da)
    d_gamma = vec(product(product(conj(q), pure(dr_s)), q)) + np.cross(gamma, omega, axis=0)
    by_theta = np.stack([-np.sin(a[1]) * np.cos(a[2]), np.sin(a[1]) * np.sin(a[2]), np.cos(a[1])])
    by_phi = np.stack([-np.cos(a[1]) * np.sin(a[2]), -np.cos(a[1]) * np.cos(a[2]), zero])
    second_by_phi = np.stack([np.cos(a[2]), -np.sin(a[2]), zero])
    d_kappa = np.einsum("ij...,i...->j...", b, da_s) + a_s[0] * (by_theta * da[1] + by_phi * da[2])
    return np.concatenate([d_gamma, d_kappa + a_s[1] * second_by_phi * da[2]])


def kardan_virtual_work(dtype):
    """n . dGamma + m . dK in the generalized coordinates (w, psi, theta, phi); complex for complex-step derivatives."""

    def form(dw, da, w):
        return dot(w.stress, kardan_strain_first(w.r_s, w.a, w.a_s, d_s(dw), da, d_s(da)))

    return LinearForm(form, dtype=dtype)


@LinearForm
def line_load_virtual_work(dr, dq, w):
    """f . dr + m . dtheta with the spatial spin dtheta = R 2 vec(q* dq) / |q|^2 = 2 vec(dq q*) / |q|^2"""
    return dot(w.force, dr) + dot(w.moment, 2 * vec(product(dq, conj(w.q))) / (w.q * w.q).sum(0))


def fields(group: Group, rotation_components: int, quadrature: tuple[np.ndarray, np.ndarray] | None = None) -> Basis:
    """Basis of the vector fields (r, rotation) of a group, with its own quadrature or another."""
    element = ElementVector(group.basis.elem, 3) * ElementVector(group.basis.elem, rotation_components)
    return Basis(group.basis.mesh, element, quadrature=quadrature or (group.basis.X, group.basis.W))


def field_dofs(basis: Basis, group: Group, rotation_components: int) -> np.ndarray:
    """Numbers (nodes of the group, 3 + rotation_components) of the unknowns of each node in a `fields` basis.

    In an element scikit-fem lists all components of vertex 0, of vertex 1, then the interior nodes of the first field
    and the interior nodes of the second.
    """
    m, inner = 3 + rotation_components, group.order - 1
    dofs = np.empty((group.basis.N, m), dtype=int)
    for a, node in enumerate(group.conn.T - group.conn.min()):
        if a < 2:
            rows = m * a + np.arange(m)
        else:
            r = 2 * m + 3 * (a - 2) + np.arange(3)
            rotation = 2 * m + 3 * inner + rotation_components * (a - 2) + np.arange(rotation_components)
            rows = np.concatenate([r, rotation])
        dofs[node] = basis.element_dofs[rows].T
    return dofs


def projection(state: State, group: Group) -> np.ndarray:
    """Matrices (nodes, 7, 6) from (displacement, rotation vector) to (dr, dq) at each node: dq = q o (0, phi) / 2."""
    first = group.conn.min()
    q = state.q[first : first + group.basis.N]
    P = np.zeros((len(q), 7, 6))
    P[:, :3, :3] = np.eye(3)
    for j in range(3):
        P[:, 3:, 3 + j] = 0.5 * multiply(q, np.eye(4)[1 + j])
    return P


def update_curvature(state: State, group: Group, gradient_q: np.ndarray) -> np.ndarray:
    """Diagonal (nodes,) that the second order of q o exp(phi / 2) adds to the rotations: -q . dU/dq / 4."""
    first = group.conn.min()
    return -0.25 * (state.q[first : first + group.basis.N] * gradient_q).sum(-1)
