"""Which rates balance a state? Velocities that held places have, accelerations that balance forces and inertia.

Rule: the mass is lumped, so a node answers a force by itself; only what is one joint, or held in part, is solved together.
Needed where a run starts, at kinks of motions and loads, and for the share of contact in a step.
"""

from __future__ import annotations

import numpy as np

from ..model import Model
from ..space import State
from ..terms.inertial import Driven

JUMP = 1e-5  # in rod lengths, or rad, over the duration: velocities that differ by more jump
NOBODY = Driven(np.empty(0, dtype=np.int64), np.empty((0, 2, 3)), np.empty((0, 2, 3)))


class Balance:
    """Rates of the nodes of one model.

    Attributes
    ----------
    nodes (M,) : nodes whose rates a support gives
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        c, space = model.constraints, model.space
        self._followers = [k for k, row in enumerate(c.lead_row) if row >= 0]
        self.nodes = np.concatenate([c.support_node, c.nodes[c.n_supports :][self._followers]]).astype(np.int64)
        self._rows = np.concatenate([np.arange(c.n_supports), c.lead_row[self._followers]]).astype(np.int64)
        self._given = c.held[: c.n_supports][self._rows].reshape(-1, 2, 3).all(axis=2)
        special = np.unique(np.concatenate([c.nodes, *c.joints]).astype(np.int64))
        self._ordinary = np.setdiff1d(np.arange(space.n_nodes), special)
        self._diagonal = np.concatenate([np.repeat(space.node_mass[:, None], 3, axis=1), space.node_inertia], axis=1)

    def driven(self, held: np.ndarray, pushed: np.ndarray) -> Driven:
        """Rates of held places from those of the supports (supports, 6), for the kernel."""
        v = held[self._rows].reshape(-1, 2, 3)
        a = pushed[self._rows].reshape(-1, 2, 3)
        c = self.model.constraints
        for m, follower in enumerate(self._followers, start=c.n_supports):  # the same rotation in other axes
            v[m, 1], a[m, 1] = c.seen[follower] @ v[m, 1], c.seen[follower] @ a[m, 1]
        v[~self._given] = np.nan
        return Driven(self.nodes, v, a)

    def match(self, state: State, v: np.ndarray, a: np.ndarray, duration: float) -> list[tuple[str, float, str]]:
        """Give held places their part's rates, in v and a (N, 6): names of parts whose velocity jumps, by how much, unit."""
        model, c = self.model, self.model.constraints
        held, pushed = c.driven(state.t)
        driven = self.driven(held, pushed)
        jumps = []
        for m, node in enumerate(driven.nodes):
            for k in range(2):
                part = slice(3 * k, 3 * k + 3)
                if not np.isnan(driven.v[m, k, 0]):
                    jump = np.abs(driven.v[m, k] - v[node, part]).max()
                    scale = (model.scales["length"], 1.0)[k] / duration
                    if jump > JUMP * scale and m < c.n_supports:
                        jumps.append((model.supports[m].to.name, jump, ("m/s", "rad/s")[k]))
                    v[node, part], a[node, part] = driven.v[m, k], driven.a[m, k]
        for row, jump in self._match_partly_held(state, held, pushed, v, a, duration):
            jumps.append((model.supports[row].to.name, jump, "m/s or rad/s"))
        return jumps

    def _match_partly_held(
        self, state: State, held: np.ndarray, pushed: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float
    ) -> list[tuple[int, float]]:
        """Give the held components of supports that free others their part's rates; rows whose velocity jumped."""
        c, model = self.model.constraints, self.model
        jumped = []
        now = c.evaluate(state, c.targets(state.t)) if c.tilted else None
        for row in c.tilted:
            node, T = c.support_node[row], now.T[row]  # type: ignore[union-attr]
            fixed = c.held[row]
            wanted, y = np.linalg.solve(T, held[row]), np.linalg.solve(T, v[node])
            scale = np.array([*3 * [model.scales["length"]], *3 * [1.0]]) / duration
            jump = np.abs(wanted - y) * fixed
            if (jump > JUMP * scale).any():
                jumped.append((row, float(jump.max())))
            y[fixed] = wanted[fixed]
            v[node], a[node] = T @ y, pushed[row]
            for k in np.flatnonzero(c.lead == node):
                follower = c.nodes[c.n_supports + k]
                v[follower] = np.concatenate([v[node, :3], c.seen[k] @ v[node, 3:]])
        return jumped

    def inertia(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Inertia force (N, 6): (m a, J w' + w x J w)."""
        force = self._diagonal * a
        force[:, 3:] += np.cross(v[:, 3:], self._diagonal[:, 3:] * v[:, 3:])
        return force

    def accelerate(self, state: State, g: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
        """Fill a (N, 6) so that inertia balances the residual g; entries of driven nodes stand already.

        A released component of a support on a turning part neglects the Coriolis acceleration in this first instant.
        """
        c = self.model.constraints
        rest = -(g + self.inertia(v, np.zeros_like(a)))
        a[self._ordinary] = rest[self._ordinary] / self._diagonal[self._ordinary]
        groups = [(row, int(node)) for row, node in enumerate(c.support_node)]
        groups += [(-1, int(joint[0])) for joint in c.joints if int(joint[0]) not in c.row_of]
        if not groups:
            return
        held = c.evaluate(state, c.targets(state.t))
        for row, lead in groups:
            fixed = np.zeros(6, dtype=bool) if row < 0 else c.held[row]
            members = [(lead, np.eye(6))]
            for k in np.flatnonzero(c.lead == lead):
                seen = np.eye(6)
                seen[3:, 3:] = c.seen[k]
                members.append((int(c.nodes[c.n_supports + k]), seen))
            T = np.eye(6) if row < 0 or not c.transforms else held.T[row]
            mass = sum(T.T @ P.T @ (self._diagonal[node][:, None] * P) @ T for node, P in members)
            force = sum(T.T @ P.T @ rest[node] for node, P in members)
            y = np.linalg.solve(T, a[lead])
            y[~fixed] = 0.0
            if (~fixed).any():
                y[~fixed] = np.linalg.solve(mass[np.ix_(~fixed, ~fixed)], (force - mass @ y)[~fixed])
            for node, P in members:
                a[node] = P @ T @ y

    def share(self, state: State, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration (N, 6) that a force (N, 6) gives to the nodes, and what of it is left for supports."""
        rest = np.zeros_like(force)
        a = np.zeros_like(force)
        self.accelerate(state, -force, rest, a)
        return a, force - self._diagonal * a
