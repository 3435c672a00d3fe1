"""Inertia at nodes: rates of the generalized-alpha step, inertia force and its tangent.

With the increment D of a step (displacement; rotation vector in the axes of the section before it), node by node,

    b1 = (D - h v0 - h^2 (1/2 - beta) b0) / (beta h^2),  v1 = v0 + h ((1 - gamma) b0 + gamma b1),
    (1 - am) b1 + am b0 = (1 - af) a1 + af a0,

and the inertia force is (m a, J w' + w x J w) with v = (x', w), a = (x'', w'). Its derivative along a body rotation is
(ca J + cv (w x J - (J w) x)) T(D)^-1 - (c x) / 2, ca = (1 - am) / ((1 - af) beta h^2), cv = gamma / (beta h), c the moment
of inertia forces; the last term makes up for the symmetric second-order update (`terms.external` has the same).
Source: Arnold and Bruels (2007), doi 10.1007/s11044-007-9084-0, on (R^3 x SO(3))^N.
"""

from __future__ import annotations

from math import sqrt, tan

import numpy as np

from . import inner, kernel
from .rotation import relative_vector


@inner
def inverse_tangent(x, y, z, T):
    """T(D)^-1 (3, 3): increment of the rotation vector D = (x, y, z) for a further small turn in the turned axes."""
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-6:
        f = 1.0 / 12.0 + angle2 / 720.0
    else:
        half = 0.5 * sqrt(angle2)
        f = (1.0 - half / tan(half)) / angle2
    T[0, 0], T[1, 1], T[2, 2] = 1.0 - f * (y * y + z * z), 1.0 - f * (x * x + z * z), 1.0 - f * (x * x + y * y)
    T[0, 1], T[1, 0] = f * x * y - 0.5 * z, f * x * y + 0.5 * z
    T[0, 2], T[2, 0] = f * x * z + 0.5 * y, f * x * z - 0.5 * y
    T[1, 2], T[2, 1] = f * y * z - 0.5 * x, f * y * z + 0.5 * x


@inner
def increment(moved, q0, q, D):
    """D (N, 6): the displacement moved (N, 3), and the rotation vector from q0 to q in the axes of q0."""
    for k in range(q.shape[0]):
        for i in range(3):
            D[k, i] = moved[k, i]
        D[k, 3], D[k, 4], D[k, 5] = relative_vector(q0[k], q[k])


@kernel
def step_rates(moved, q0, q, v0, a0, b0, coefficients, driven, v_driven, a_driven, D, v, a, b):
    """Increment D and rates v, a, b (N, 6) at the end of a step that moved nodes by moved (N, 3) and turned q0 to q.

    coefficients: h, am, af, beta, gamma. driven (M,): nodes whose rates are given, v_driven, a_driven (M, 6), not a number
    where they are not.
    """
    h, am, af, beta, gamma = coefficients
    increment(moved, q0, q, D)
    for k in range(q.shape[0]):
        for i in range(6):
            b[k, i] = (D[k, i] - h * v0[k, i] - h * h * (0.5 - beta) * b0[k, i]) / (beta * h * h)
            v[k, i] = v0[k, i] + h * ((1.0 - gamma) * b0[k, i] + gamma * b[k, i])
            a[k, i] = ((1.0 - am) * b[k, i] + am * b0[k, i] - af * a0[k, i]) / (1.0 - af)
    for m in range(driven.shape[0]):
        k = driven[m]
        for i in range(6):
            if not np.isnan(v_driven[m, i]):
                v[k, i] = v_driven[m, i]
                a[k, i] = b[k, i] = a_driven[m, i]


@kernel
def step_inertia(mass, J, D, v, a, coefficients, g, nodal):
    """Add the inertia force for rates v, a (N, 6) to g and, if nodal (N, 6, 6) is not empty, its tangent.

    Returns the largest inertia force and moment at a node.
    """
    h, am, af, beta, gamma = coefficients
    T, A = np.empty((3, 3)), np.empty((3, 3))
    ca, cv = (1.0 - am) / ((1.0 - af) * beta * h * h), gamma / (beta * h)
    force = moment = 0.0
    for k in range(mass.shape[0]):
        m = mass[k]
        for i in range(3):
            g[k, i] += m * a[k, i]
            force = max(force, abs(m * a[k, i]))
        w0, w1, w2 = v[k, 3], v[k, 4], v[k, 5]
        J0, J1, J2 = J[k, 0], J[k, 1], J[k, 2]
        c0 = J0 * a[k, 3] + (J2 - J1) * w1 * w2
        c1 = J1 * a[k, 4] + (J0 - J2) * w2 * w0
        c2 = J2 * a[k, 5] + (J1 - J0) * w0 * w1
        g[k, 3] += c0
        g[k, 4] += c1
        g[k, 5] += c2
        moment = max(moment, abs(c0), abs(c1), abs(c2))
        if nodal.shape[0] == 0:
            continue
        for i in range(3):
            nodal[k, i, i] += ca * m
        inverse_tangent(D[k, 3], D[k, 4], D[k, 5], T)
        A[0, 0], A[1, 1], A[2, 2] = ca * J0, ca * J1, ca * J2
        A[0, 1], A[0, 2] = cv * (J2 - J1) * w2, cv * (J2 - J1) * w1
        A[1, 0], A[1, 2] = cv * (J0 - J2) * w2, cv * (J0 - J2) * w0
        A[2, 0], A[2, 1] = cv * (J1 - J0) * w1, cv * (J1 - J0) * w0
        for i in range(3):
            for j in range(3):
                nodal[k, 3 + i, 3 + j] += A[i, 0] * T[0, j] + A[i, 1] * T[1, j] + A[i, 2] * T[2, j]
        nodal[k, 4, 5] += 0.5 * c0
        nodal[k, 5, 4] -= 0.5 * c0
        nodal[k, 5, 3] += 0.5 * c1
        nodal[k, 3, 5] -= 0.5 * c1
        nodal[k, 3, 4] += 0.5 * c2
        nodal[k, 4, 3] -= 0.5 * c2
    return force, moment


@kernel
def largest_change(b0, b1, skip, length):
    """Largest |b1 - b0| (N, 6), displacements in units of `length`, rotations in radians; skip (M,): nodes left out."""
    largest = 0.0
    for k in range(b0.shape[0]):
        value = 0.0
        for i in range(3):
            value = max(value, abs(b1[k, i] - b0[k, i]) / length, abs(b1[k, 3 + i] - b0[k, 3 + i]))
        if value > largest:
            counts = True
            for m in range(skip.shape[0]):
                if skip[m] == k:
                    counts = False
            if counts:
                largest = value
    return largest
