"""Loops over nodes: the largest residual, the largest increment, distances to a polyline.

Rule: one pass, nothing allocated; a number that is not finite comes back as infinity, so that a comparison catches it.
Rows of six (in space: three displacements, three turns) or of three (in a plane: two and one).
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
    d = g.shape[1]
    moves = (d + 1) // 2
    largest, where = 0.0, 0
    for k in range(g.shape[0]):
        value = 0.0
        for i in range(d):
            if not np.isfinite(g[k, i]):
                return np.inf, k
            value = max(value, abs(g[k, i]) * (inverse_force if i < moves else inverse_moment))
        if value > largest:
            counts = True
            for m in range(nodes.shape[0]):
                if nodes[m] == k:
                    counts = False
            if not counts:
                value = 0.0
                for m in range(nodes.shape[0]):
                    if nodes[m] == k:
                        for i in range(d):
                            if not held[m, i]:
                                value = max(value, abs(g[k, i]) * (inverse_force if i < moves else inverse_moment))
            if value > largest:
                largest, where = value, k
    return largest, where


@kernel
def largest_increment(du):
    """Largest displacement and rotation component of du (N, 6), or (infinity, node) where it is not finite."""
    shift = turn = 0.0
    moves = (du.shape[1] + 1) // 2
    for k in range(du.shape[0]):
        for i in range(du.shape[1]):
            if not np.isfinite(du[k, i]):
                return np.inf, np.inf, k
            if i < moves:
                shift = max(shift, abs(du[k, i]))
            else:
                turn = max(turn, abs(du[k, i]))
    return shift, turn, -1


@kernel
def distance_to_polyline(points, line, out):
    """Distance out (n,) [m] of points (n, 3) to the polyline through line (m, 3)."""
    for k in range(points.shape[0]):
        best = np.inf
        for j in range(line.shape[0] - 1):
            a0, a1, a2 = points[k, 0] - line[j, 0], points[k, 1] - line[j, 1], points[k, 2] - line[j, 2]
            c0, c1, c2 = line[j + 1, 0] - line[j, 0], line[j + 1, 1] - line[j, 1], line[j + 1, 2] - line[j, 2]
            square = c0 * c0 + c1 * c1 + c2 * c2
            part = min(max((a0 * c0 + a1 * c1 + a2 * c2) / square, 0.0), 1.0) if square > 0.0 else 0.0
            a0, a1, a2 = a0 - part * c0, a1 - part * c1, a2 - part * c2
            best = min(best, a0 * a0 + a1 * a1 + a2 * a2)
        out[k] = np.sqrt(best)
