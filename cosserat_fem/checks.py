"""Is it acceptable? Quantities that rules speak of, from a history.

Rule: a check is a function of a history and returns numbers; it never changes a model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .history import History
from .kernels.nodes import distance_to_polyline
from .rod import Rod


def bend_radius(history: History, rod: Rod | str, *, at: str = "stations") -> np.ndarray:
    """Bend radius of the centreline, infinite where it is straight.

    |Gamma| / sqrt(K1^2 + K2^2): stretch over the bending part of the curvature (per unstressed length).

    Parameters
    ----------
    at : "stations" or "nodes"
        At the Gauss points (T, Q), where it is most accurate, or at the nodes (T, N), ends included.

    Returns
    -------
    (T, Q) or (T, N) [m]
    """
    strain = history.total_strains(rod)
    if at == "nodes":
        strain = history.at_nodes(rod, strain)
    elif at != "stations":
        raise ValueError(f"bend_radius: at must be 'stations' or 'nodes' (got {at!r}).")
    stretch = np.linalg.norm(strain[..., :3], axis=-1)
    bending = np.hypot(strain[..., 3], strain[..., 4])
    return np.divide(
        stretch, bending, out=np.full_like(stretch, np.inf), where=bending > 1e-12 * bending.max(initial=1e-300)
    )


def distance_from_drawing(history: History, rod: Rod | str) -> np.ndarray:
    """Distance (T, N) [m] of each node from the drawn route (the nearest point of the drawn curve)."""
    positions = history.positions(rod)
    rod = history.rod(rod)
    curve = rod.drawn(np.linspace(0.0, rod.length, 1001))
    distance = np.empty(positions.shape[:2])
    distance_to_polyline(positions.reshape(-1, 3), curve, distance.reshape(-1))
    return distance


def worst(values: np.ndarray, t: np.ndarray, s: np.ndarray, *, largest: bool = True) -> dict[str, Any]:
    """Largest (or smallest) of values (T, S) and where and when it is: {"value", "s", "t"}."""
    flat = int(np.argmax(values) if largest else np.argmin(values))
    row, column = np.unravel_index(flat, values.shape)
    return {"value": float(values[row, column]), "s": float(s[column]), "t": float(t[row])}
