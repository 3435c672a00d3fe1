"""How is one linear system solved? Chains by block elimination, joints by a sparse factorisation or multigrid.

Rule: rods are chains. Everything between joints is eliminated in compiled code at a constant cost per element; what is
left, six unknowns for each joint, is a sparse symmetric matrix. It is factorised (SuperLU, minimum degree on A + A^T,
pivots on the diagonal, so that their signs still count negative eigenvalues), or, for a large network in space with a
symmetric positive definite matrix, solved by conjugate gradients preconditioned with smoothed aggregation (pyamg) and
the six rigid-body modes; an indefinite matrix is met by CG and handed back to SuperLU.

Measured, cubic lattices of n^3 joints, CPU seconds of SuperLU / pyamg to 1e-10: n = 8 0.15 / 0.23, 12 0.9 / 2.5, 16 5.4 /
6.8, 20 23 / 14, 24 88 / 26. In flat nets SuperLU stays ahead (fill grows slowly there), so a network counts as one in
space when more than SPACE_DEGREE segments meet a joint on average.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from ..constraint import Constraints, Held
from ..kernels import chain, condense
from ..kernels.beam import LANES
from ..kernels.nodes import largest_increment
from ..space import Entries, Space, State
from ..terms.internal import Condensed

AMG_JOINTS = 5000
SPACE_DEGREE = 2.5  # segments for each joint: 3 in a cubic lattice, 2 in a flat net


@dataclass(frozen=True, eq=False)
class Solution:
    """du (N, 6) [m, rad]; negative: number of negative eigenvalues, or -1 if not known; singular: node without
    stiffness, or -1; method: "chain", "splu" or "amg"."""

    du: np.ndarray
    negative: int
    singular: int
    method: str


class LinearSolver:
    """Scratch and topology for the linear systems of one model; reused over iterations, never shared."""

    def __init__(self, space: Space, constraints: Constraints) -> None:
        self.space, self.constraints = space, constraints
        total = sum(g.n_elements for g in space.groups)
        self.S, self.rhs = np.empty((total, 12, 12)), np.empty((total, 12))
        self.scratch, first = [], 0
        for g in space.groups:
            n, inner = 6 * (g.order + 1), 6 * (g.order - 1)
            part = slice(first, first + g.n_elements)
            factor = np.empty((len(g.packed_conn), inner * (n + 1) * LANES))
            self.scratch.append(Condensed(self.S[part], self.rhs[part], factor))
            first += g.n_elements
        self.segments, n_vertices = segments_of(space, constraints)
        with_joints = bool(constraints.joints)
        self.kept = np.empty((n_vertices, 6, 13 if with_joints else 7))
        self.joint_S = np.empty((len(self.segments), 12, 12))
        self.joint_rhs = np.empty((len(self.segments), 12))
        self.du = np.empty((space.n_nodes, 6))
        if with_joints:
            self._joint_pattern()

    def _joint_pattern(self) -> None:
        """Rows and columns of the joint matrix for the entries of joint_S that end at joints on both sides."""
        ends = self.segments[:, 3:5]
        unknown = np.where(ends[:, :, None] >= 0, 6 * ends[:, :, None] + np.arange(6), -1).reshape(len(ends), 12)
        rows = np.broadcast_to(unknown[:, :, None], (len(ends), 12, 12))
        columns = np.broadcast_to(unknown[:, None, :], (len(ends), 12, 12))
        self._entry = (rows >= 0) & (columns >= 0)
        self._rows, self._columns = rows[self._entry], columns[self._entry]
        self._unknown, self._has_joint = unknown, unknown >= 0
        self._joint_nodes = np.concatenate(self.constraints.joints)
        self._joint_index = np.concatenate([np.full(len(n), j) for j, n in enumerate(self.constraints.joints)])

    def solve(
        self, state: State, g: np.ndarray, held: Held, negative: int, symmetric: bool, whole: Entries | None = None
    ) -> Solution:
        """Solve K du = -g with the condensed matrices that stand in `scratch`; `negative`: pivots counted so far.

        The scratch is used up. du of held unknowns is their gap. whole: tangent (6 N, 6 N), if given it is solved instead.
        """
        c = self.constraints
        if whole is not None:
            return self._solve_whole(whole, g, held, symmetric)
        vertex_rhs = -g
        if c.transforms:
            chain.transform_vertices(chain.SPACE, self.S, self.rhs, vertex_rhs, c.nodes, c.left, c.right, held.T)
            if len(held.at):
                at = held.at
                chain.add_to_vertices(chain.SPACE, self.S, c.nodes[at], c.left[at], c.right[at], held.couples)
        if len(c.nodes):
            chain.hold_vertices(
                chain.SPACE, self.S, self.rhs, vertex_rhs, c.nodes, c.left, c.right, c.held, held.gap, c.owner
            )  # fmt: skip
        count = chain.eliminate_segments(
            chain.SPACE, self.S, self.rhs, vertex_rhs, self.segments, symmetric, self.kept, self.joint_S, self.joint_rhs
        )
        if count < 0:
            return Solution(self.du, -1, -1 - count, "chain")
        negative, method = negative + count, "chain"
        y = np.empty((0, 6))
        if c.joints:
            y, count, method = self._solve_joints(state, vertex_rhs, held, symmetric)
            negative = negative + count if count >= 0 else -1
        du = self.du
        chain.back_substitute_segments(chain.SPACE, self.segments, self.kept, y, du)
        if c.transforms:
            chain.untransform_vertices(chain.SPACE, c.nodes, held.T, du)
        for group, scratch in zip(self.space.groups, self.scratch, strict=True):
            if group.order > 1:
                condense.back_substitute(group.packed_conn, group.n_elements, scratch.factor, du)
        return Solution(du, negative if symmetric else -1, largest_increment(du)[2], method)

    def _solve_whole(self, whole: Entries, g: np.ndarray, held: Held, symmetric: bool) -> Solution:
        """Solve with the whole tangent: rods that touch are no chains."""
        c, n, b = self.constraints, 6 * self.space.n_nodes, -g.ravel()
        B: csc_matrix | None = None
        if c.transforms:
            reduced, B, _ = self.reduced(whole.matrix(n), held)
            entries, b = reduced.tocoo(), b if B is None else B.T @ b
            whole = Entries(entries.row, entries.col, entries.data)
        y = np.zeros((self.space.n_nodes, 6))
        y[c.support_node] = held.gap[: c.n_supports]
        flat, (rows, columns, values) = y.ravel(), whole
        if flat.any():
            b = b - np.bincount(rows, values * flat[columns], n)
        number = np.full(n, -1, dtype=np.int32)  # of the free unknowns
        number[self.free] = np.arange(len(self.free))
        row, column = number[rows], number[columns]
        kept = (row >= 0) & (column >= 0)
        K = Entries(row[kept], column[kept], values[kept]).matrix(len(self.free))
        flat[self.free], negative = solve_sparse(K, b[self.free], symmetric)
        self.du[...] = (flat if B is None else B @ flat).reshape(-1, 6)
        return Solution(self.du, negative, largest_increment(self.du)[2], "splu")

    def reduced(self, matrix: csc_matrix, held: Held) -> tuple[csc_matrix, csc_matrix | None, np.ndarray]:
        """The tangent in the unknowns y of supports and leaders, B with du = B y (None: the same), and which y are free."""
        c, K = self.constraints, matrix
        B = self._increments(held) if c.transforms else None
        if B is not None:
            K = (B.T @ K @ B).tocsc()
        for at, couple in zip(held.at, held.couples, strict=True):
            dofs = 6 * c.nodes[at] + np.arange(6)
            K = csc_matrix(K + coo_matrix((couple.ravel(), (np.repeat(dofs, 6), np.tile(dofs, 6))), shape=K.shape))
        return K, B, self.free

    @cached_property
    def free(self) -> np.ndarray:
        """Which unknowns of supports and leaders are free."""
        c, fixed = self.constraints, np.zeros((self.space.n_nodes, 6), dtype=bool)
        fixed[c.nodes[c.n_supports :]] = True  # welded ones follow their leader
        fixed[c.support_node] = c.held[: c.n_supports]
        return np.flatnonzero(~fixed)

    def _increments(self, held: Held) -> csc_matrix:
        """Node increments (6 N) from the unknowns y of special vertices and their leaders."""
        c, N = self.constraints, self.space.n_nodes
        lead = np.arange(N)
        lead[c.nodes[c.n_supports :]] = c.lead
        T = np.tile(np.eye(6), (N, 1, 1))
        T[c.nodes] = held.T
        rows = np.broadcast_to(np.arange(6 * N).reshape(N, 6, 1), T.shape)
        columns = np.broadcast_to(6 * lead[:, None, None] + np.arange(6), T.shape)
        return coo_matrix((T.ravel(), (rows.ravel(), columns.ravel())), shape=(6 * N, 6 * N)).tocsc()

    def _solve_joints(
        self, state: State, vertex_rhs: np.ndarray, held: Held, symmetric: bool
    ) -> tuple[np.ndarray, int, str]:
        """Unknowns of the joints (J, 6), number of negative pivots or -1, and how it was done."""
        n = 6 * len(self.constraints.joints)
        b = np.zeros(n)
        np.add.at(b, self._unknown[self._has_joint], self.joint_rhs[self._has_joint])
        np.add.at(b.reshape(-1, 6), self._joint_index, vertex_rhs[self._joint_nodes])
        K = coo_matrix((self.joint_S[self._entry], (self._rows, self._columns)), shape=(n, n))
        n_joints = len(self.constraints.joints)
        if symmetric and n_joints > AMG_JOINTS and len(self.segments) > SPACE_DEGREE * n_joints:
            y = solve_amg(K.tocsr(), b, self._rigid_modes(state))
            if y is not None:
                return y.reshape(-1, 6), -1, "amg"  # CG met no negative curvature; that is no count
        y, negative = solve_sparse(K.tocsc(), b, symmetric)
        return y.reshape(-1, 6), negative, "splu"

    def _rigid_modes(self, state: State) -> np.ndarray:
        """The six rigid motions in the unknowns of the joints (6 J, 6); zero where a joint is held."""
        nodes = np.array([joint[0] for joint in self.constraints.joints])
        arm = state.r[nodes] - state.r[nodes].mean(0)
        H = self.space.spin_axes(state, nodes)
        modes = np.zeros((len(nodes), 6, 6))
        modes[:, :3, :3] = np.eye(3)
        for k in range(3):
            modes[:, :3, 3 + k] = np.cross(np.eye(3)[k], arm)
            modes[:, 3:, 3 + k] = np.linalg.solve(H, np.tile(np.eye(3)[k][:, None], (len(nodes), 1, 1)))[..., 0]
        for j, node in enumerate(nodes):
            row = self.constraints.row_of.get(int(node))
            if row is not None:
                modes[j][self.constraints.held[row]] = 0.0
        return modes.reshape(-1, 6)


def segments_of(space: Space, constraints: Constraints) -> tuple[np.ndarray, int]:
    """Runs of elements between joints, see `kernels.chain`; and the number of vertices."""
    joint_of = {int(k): j for j, nodes in enumerate(constraints.joints) for k in nodes}
    rows, first_of_group, kept = [], np.cumsum([0, *(g.n_elements for g in space.groups)]), 0
    for rod in space.rods:
        view = space[rod]
        first = first_of_group[view.group] + view.elements.start
        joints = [joint_of.get(int(v), -1) for v in view.vertices]
        last = len(view.vertices) - 1
        cuts = [0, *(k for k in range(1, last) if joints[k] >= 0), last]
        for a, b in pairwise(cuts):
            rows.append((first + a, b - a, view.vertices[a], joints[a], joints[b], kept))
            kept += b - a + 1
    return np.array(rows, dtype=np.int64), kept


def solve_sparse(K: csc_matrix, b: np.ndarray, symmetric: bool) -> tuple[np.ndarray, int]:
    """Solution and, for a symmetric matrix that needed no exchange of rows, its number of negative eigenvalues, else -1.

    Unknowns are scaled by the diagonal first: forces and moments differ by orders of magnitude.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.abs(K.diagonal()), 1e-300))
    values = K.data * scale[K.indices] * np.repeat(scale, np.diff(K.indptr))
    scaled = csc_matrix((values, K.indices, K.indptr), shape=K.shape)
    options = {"SymmetricMode": True} if symmetric else {}
    try:
        lu = splu(
            scaled,
            permc_spec="MMD_AT_PLUS_A" if symmetric else "COLAMD",
            diag_pivot_thresh=0.0 if symmetric else 1.0,
            options=options,
        )
    except RuntimeError:  # exactly singular
        return np.full_like(b, np.nan), -1
    y = scale * lu.solve(scale * b)
    counted = symmetric and np.array_equal(lu.perm_r, lu.perm_c)
    return y, int((lu.U.diagonal() < 0).sum()) if counted else -1


def solve_amg(K: csr_matrix, b: np.ndarray, modes: np.ndarray, tolerance: float = 1e-10) -> np.ndarray | None:
    """Conjugate gradients with smoothed aggregation; None if the matrix turns out indefinite or CG does not converge.

    Unknowns are scaled by the diagonal, as in `solve_sparse`, and the rigid modes with them.
    """
    import pyamg

    diagonal = K.diagonal()
    if (diagonal <= 0).any():
        return None
    scale = 1.0 / np.sqrt(diagonal)
    scaled = K.multiply(scale[:, None]).multiply(scale[None, :]).tobsr(blocksize=(6, 6))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pyamg warns of an indefinite matrix; its return code says so too
        levels = pyamg.smoothed_aggregation_solver(
            scaled, B=modes / scale[:, None], symmetry="symmetric", max_coarse=100, coarse_solver="splu"
        )
        y, info = pyamg.krylov.cg(scaled, scale * b, tol=tolerance, maxiter=500, M=levels.aspreconditioner())
    return scale * y if info == 0 and np.isfinite(y).all() else None
