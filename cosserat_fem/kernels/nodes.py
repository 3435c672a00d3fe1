"""Loops over nodes: the largest residual, the largest increment.

Rule: one pass, nothing allocated; a number that is not finite comes back as infinity, so that a comparison catches it.
"""

from __future__ import annotations

import numpy as np

from . import kernel


@kernel
def largest_residual(g, nodes, held, force_limit, moment_limit):
    """Largest |force| / force_limit or |moment| / moment_limit over free unknowns, and its node.

    g (N, 6); nodes (M,), held (M, 6): entries that do not count. Returns (value, node), infinity if g is not finite.
    """
    inverse_force, inverse_moment = 1.0 / force_limit, 1.0 / moment_limit
    largest, where = 0.0, 0
    for k in range(g.shape[0]):
        value = 0.0
        for i in range(3):
            value = max(value, abs(g[k, i]) * inverse_force, abs(g[k, 3 + i]) * inverse_moment)
            if not (np.isfinite(g[k, i]) and np.isfinite(g[k, 3 + i])):
                return np.inf, k
        if value > largest:
            counts = True
            for m in range(nodes.shape[0]):
                if nodes[m] == k:
                    counts = False
            if not counts:
                value = 0.0
                for m in range(nodes.shape[0]):
                    if nodes[m] == k:
                        for i in range(6):
                            if not held[m, i]:
                                value = max(value, abs(g[k, i]) * (inverse_force if i < 3 else inverse_moment))
            if value > largest:
                largest, where = value, k
    return largest, where


@kernel
def largest_increment(du):
    """Largest displacement and rotation component of du (N, 6), or (infinity, node) where it is not finite."""
    shift = turn = 0.0
    for k in range(du.shape[0]):
        for i in range(3):
            if not (np.isfinite(du[k, i]) and np.isfinite(du[k, 3 + i])):
                return np.inf, np.inf, k
            shift = max(shift, abs(du[k, i]))
            turn = max(turn, abs(du[k, 3 + i]))
    return shift, turn, -1
