"""Which nodes move the place on another rod that is touched? Those of its element; near a joint, those of two.

Rule: the place is on the curve that goes round where elements meet (`kernels.joints`).
"""

from __future__ import annotations

import numpy as np

from ..kernels.joints import LEAVES, OF_ELEMENT, WIDE, round_joints
from ..kernels.pairs import shapes_at
from .touch import Cells, Found


def second_places(
    cells: Cells, reach: float, found: Found, gaps: np.ndarray, r: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points found, with their second places on rounded curves; nodes (K, m) that move these, their shape functions and
    derivatives (2, K, m); a number (K,) for each set of elements. reach [m]: range of the barrier; gaps (K,) [m]: distances
    less core.

    m is that of one element, or of two where any point is near a joint: the others then have no part in it.
    """
    rows = found.rows
    A, E = cells.nodes.shape[1], len(cells.h)
    other = cells.cells[rows[:, 6].astype(np.int64), 0]
    which, nodes, second = 3 * (found.element * E + other), cells.nodes[other], np.empty((2, len(rows), A))
    shapes_at(cells.coefficients, rows[:, 7], second)
    at, ahead, width = _near_joints(cells, other, rows[:, 7])
    on, near = other[at], rows[at]
    around, shapes = np.empty((len(at), 2 * A), dtype=np.int64), np.empty((2, len(at), 2 * A))
    done = round_joints(
        near, found.element[at], on, ahead, width, LEAVES * reach / width, gaps[at], cells.nodes, cells.coefficients,
        cells.h, r, around, shapes,
    )  # fmt: skip
    if done.any():
        at = at[done]
        rows, nodes = rows.copy(), np.concatenate([nodes, nodes], axis=1)
        second = np.concatenate([second, np.zeros_like(second)], axis=2)
        rows[at], nodes[at], second[:, at] = near[done], around[done], shapes[:, done]
        which[at] = 3 * (found.element[at] * E + on[done]) + 1 + (nodes[at, 0] < nodes[at, A])
    return rows, nodes, second, which


def _near_joints(cells: Cells, element: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which places xi (K,) of elements (K,) are near a joint; 1 if it is after the element, -1 if before; its width [m]."""
    rod_of = np.empty(len(cells.h), dtype=np.int64)
    rod_of[cells.cells[:, 0]] = cells.rod_of
    after = xi > 0.5
    beside = np.clip(element + np.where(after, 1, -1), 0, len(cells.h) - 1)
    width = np.minimum(WIDE * cells.radii[rod_of[element]], OF_ELEMENT * np.minimum(cells.h[element], cells.h[beside]))
    near = np.where(after, 1.0 - xi, xi) * cells.h[element] < width
    at = np.flatnonzero(near & (beside != element) & (rod_of[beside] == rod_of[element]))
    return at, np.where(after[at], 1, -1), width[at]
