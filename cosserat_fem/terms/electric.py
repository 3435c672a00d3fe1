"""Attraction and repulsion of charged rods.

Rule: every pair of points on two rods acts on each other along the line between them, so that momentum is kept to
round-off. The points are Gauss points of each element, more than the rod's own if it is asked for: the sum is accurate
when they lie closer together than the rods. Its tangent couples all nodes of both rods and is left out; the force varies
slowly next to what holds the rods, so the Newton method converges without it, in more iterations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import check_integer, check_number, check_positive
from ..rod import Rod
from ..space import Blocks, Space, State
from .external import check_rod

VACUUM = 8.8541878188e-12  # F/m, CODATA 2022


@dataclass(frozen=True, eq=False)
class Electrostatic:
    """Coulomb force between two rods with line charges; equal signs repel.

    Two long parallel rods at distance d: charge * other_charge / (2 pi permittivity d) per metre.

    Parameters
    ----------
    rod, other : Rod
    charge, other_charge : [C/m]
    permittivity : [F/m]
    points : int
        Gauss points in each element.
    """

    rod: Rod
    other: Rod
    charge: float
    other_charge: float
    permittivity: float = VACUUM
    points: int = 6
    name: str = "electrostatic"
    symmetric = False  # its tangent is left out, so stability cannot be judged

    def __post_init__(self) -> None:
        check_rod("electrostatic", self.rod)
        check_rod("electrostatic", self.other)
        if self.rod is self.other:
            raise ValueError(f"electrostatic: rod {self.rod.name!r} and other must be two rods.")
        check_number("electrostatic: charge", self.charge)
        check_number("electrostatic: other_charge", self.other_charge)
        check_positive("electrostatic: permittivity", self.permittivity)
        check_integer("electrostatic: points", self.points, 1, 64)

    def _points(self, rod: Rod, space: Space) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape functions (Q, A), nodes (E, A) and weights (E, Q) [m] of the points of one rod."""
        view = space[rod]
        group = space.groups[view.group]
        x, w = np.polynomial.legendre.leggauss(self.points)
        X = 0.5 * (1 + x)
        N = np.stack([group.basis.elem.lbasis(X[None], i)[0] for i in range(group.order + 1)], axis=1)
        lengths = group.dx[view.elements].sum(axis=1)
        return N, group.conn[view.elements], 0.5 * w * lengths[:, None]

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks:
        sides = space.remember(self, lambda: [self._points(rod, space) for rod in (self.rod, self.other)])
        places = [np.einsum("qa,eai->eqi", N, state.r[conn]).reshape(-1, 3) for N, conn, _ in sides]
        charges = [q * w.ravel() for q, (_, _, w) in zip((self.charge, self.other_charge), sides, strict=True)]
        apart = places[0][:, None] - places[1][None]
        scale = charges[0][:, None] * charges[1][None] / (4 * np.pi * self.permittivity)
        pair = (scale / np.linalg.norm(apart, axis=-1) ** 3)[..., None] * apart
        g = np.zeros((space.n_nodes, 6))
        for force, (N, conn, w) in zip((pair.sum(1), -pair.sum(0)), sides, strict=True):
            np.add.at(g[:, :3], conn, -np.einsum("qa,eqi->eai", N, force.reshape(*w.shape, 3)))
        nodes = np.unique(np.concatenate([sides[0][1].ravel(), sides[1][1].ravel()]))
        return Blocks(nodes[:, None], g[nodes, None])
