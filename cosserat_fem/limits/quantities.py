"""What do rules speak of? Quantities along rods, from a history.

Rule: a measure is a function of a history and returns numbers; it never changes a model. At the nodes a quantity that
jumps from element to element (a force beside a load) has the value of its worse side, not the mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..history import History
from ..kernels.nodes import distance_to_polyline
from ..rod import Rod


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
    return _radius(strain)


def distance_from_drawing(history: History, rod: Rod | str) -> np.ndarray:
    """Distance (T, N) [m] of each node from the drawn route (the nearest point of the drawn curve)."""
    positions = history.positions(rod)
    rod = history.rod(rod)
    curve = rod.drawn(np.linspace(0.0, rod.length, 1001))
    distance = np.empty(positions.shape[:2])
    distance_to_polyline(positions.reshape(-1, 3), curve, distance.reshape(-1))
    return distance


class Along:
    """Strains and section forces of a rod at the nodes of each element, found once for all that is measured on it.

    strain : (T, E, A, 6) minus the stress-free shape's; total : with it; force : section forces in directors [N, N m];
    s : (E, A) [m] arc lengths
    """

    def __init__(self, history: History, rod: Rod | str) -> None:
        self.rod = history.rod(rod)
        view = history.model.space[self.rod]
        group = history.model.space.groups[view.group]
        strain = history.strains(self.rod)
        total = strain + group.reference[view.elements].reshape(-1, 6)
        force = np.einsum("qij,tqj->tqi", group.stiffness[view.elements].reshape(-1, 6, 6), strain)
        self.strain, self.total, self.force = (history.in_elements(self.rod, x) for x in (strain, total, force))
        E, A = self.strain.shape[1:3]
        self.s = view.s[(A - 1) * np.arange(E)[:, None] + np.arange(A)]

    @property
    def axial(self) -> np.ndarray:
        """Normal force (T, E, A) [N], positive for tension."""
        return self.force[..., 2]

    @property
    def radius(self) -> np.ndarray:
        """Bend radius (T, E, A) [m] of the centreline, as `bend_radius`."""
        return _radius(self.total)

    @property
    def reach(self) -> np.ndarray:
        """Distance (T, E, A) [m] from the centreline to the outermost fibre of a bend."""
        return _reach(self.rod, self.s, self.total[..., 3:5])

    @property
    def fibre_strain(self) -> np.ndarray:
        """Largest longitudinal strain (T, E, A) [-] of any fibre of the section: |stretch| + curvature times `reach`.

        Both minus those of the stress-free shape: it is the strain of the material.
        """
        bend = self.strain[..., 3:5]
        return np.abs(self.strain[..., 2]) + np.hypot(bend[..., 0], bend[..., 1]) * _reach(self.rod, self.s, bend)

    @property
    def twist(self) -> np.ndarray:
        """Twist (T, E, A) [rad/m] away from the stress-free shape, without sign."""
        return np.abs(self.strain[..., 5])


def at_nodes(values: np.ndarray, *, largest: bool) -> np.ndarray:
    """Values (T, E, A) at the nodes of elements to those of the rod (T, N): where two meet, the larger or smaller one."""
    T, E, A = values.shape
    out = np.empty((T, E * (A - 1) + 1))
    out[:, :-1] = values[:, :, :-1].reshape(T, -1)
    out[:, -1] = values[:, -1, -1]
    worse = np.maximum if largest else np.minimum
    out[:, A - 1 : -1 : A - 1] = worse(out[:, A - 1 : -1 : A - 1], values[:, :-1, -1])
    return out


def _radius(total: np.ndarray) -> np.ndarray:
    """Stretch over bending of total strains (..., 6)."""
    stretch = np.linalg.norm(total[..., :3], axis=-1)
    bending = np.hypot(total[..., 3], total[..., 4])
    return np.divide(
        stretch, bending, out=np.full_like(stretch, np.inf), where=bending > 1e-12 * bending.max(initial=1e-300)
    )


def _reach(rod: Rod, s: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Half the extent (T, E, A) [m] of the section in the plane of bending (T, E, A, 2): a radius, or a rectangle's."""
    reach = np.broadcast_to(rod.radius_at(s.ravel()).reshape(s.shape), bend.shape[:-1])
    outline = rod.sections[0][1].outline
    if outline is None:
        return reach
    width, height = outline
    size = np.hypot(bend[..., 0], bend[..., 1])
    part = np.abs(bend[..., 0]) * height + np.abs(bend[..., 1]) * width  # bending about d1 is along d2
    return np.divide(0.5 * part, size, out=np.array(reach), where=size > 0)


def worst(values: np.ndarray, t: np.ndarray, s: np.ndarray, *, largest: bool = True) -> dict[str, Any]:
    """Largest (or smallest) of values (T, S) and where and when it is: {"value", "s", "t"}."""
    flat = int(np.argmax(values) if largest else np.argmin(values))
    row, column = np.unravel_index(flat, values.shape)
    return {"value": float(values[row, column]), "s": float(s[column]), "t": float(t[row])}
