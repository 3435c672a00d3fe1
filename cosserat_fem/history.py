"""What is kept? Accepted states, reactions, how each was found, and what can be asked of them.

Rule: a history answers questions and calls no solver. Rows follow time; arrays along a rod follow its arc length; forces
and moments of supports are those ON the rod, in space, the moment about the supported point. Of contact, forces on rods are
those ON the rod, and loads of parts those ON the part, about the place to which its motion has carried the drawn origin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Literal

import numpy as np

from .curve import CurveGeometry, curve_geometry
from .errors import nearest
from .kernels.rotation import matrix_from_quaternion
from .mechanism import Hinge, Part
from .model import Model
from .record import Chosen, Counters, CriticalPoint, Event, Record
from .rod import Rod
from .space import State
from .support import Support
from .terms.touch import Pressed

LEDGER = 0.01  # part of the largest energy that may be missing without a warning


@dataclass(eq=False)
class History:
    """Accepted states of one run of a model.

    Attributes
    ----------
    t : (T,) [s]
        Times that go on, also where parts and loads go back the way they came: they stand at `stroke_t`.
    status : "converged" or "stopped"
    message : str
        What happened, in words.
    counters : Counters
    steps : list of (t at the end [s], length [s], error in parts of the allowed one, accepted), of a run in time
    extrapolated : float, optional
        Distance between the two runs of a Richardson extrapolation, divided by 3: the error of the finer one.
    rho_inf : float, optional
        Spectral radius of a run in time.
    chosen : Chosen, optional
        What was chosen where an accuracy was asked for; `model` has these elements.
    loads : tuple of terms
        Those that a path multiplies by its factors.
    critical : list of CriticalPoint
        Limit and bifurcation points that a path passed; see `trace_path`.
    """

    model: Model
    records: list[Record] = field(default_factory=list)
    status: Literal["converged", "stopped"] = "converged"
    message: str = ""
    counters: Counters = field(default_factory=Counters)
    steps: list[tuple[float, float, float, bool]] = field(default_factory=list)
    extrapolated: float | None = None
    rho_inf: float | None = None
    chosen: Chosen | None = None
    critical: list[CriticalPoint] = field(default_factory=list)
    loads: tuple[Any, ...] = ()

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} .. {self.t[-1]:g} s, " if self.records else ""
        return f"<History: {len(self.records)} states, {span}{self.status}>"

    def __len__(self) -> int:
        return len(self.records)

    @property
    def t(self) -> np.ndarray:
        return np.array([record.t for record in self.records])

    @property
    def stroke_t(self) -> np.ndarray:
        """Times (T,) [s] at which parts stand and loads act: `t`, but on the way back the times of the way out."""
        return np.array([record.state.t for record in self.records])

    @property
    def factors(self) -> np.ndarray:
        """Factor (T,) of the loads at each state of a path of loads; 1 in other runs."""
        return np.array([1.0 if record.factor is None else record.factor for record in self.records])

    @property
    def path(self) -> bool:
        """True if the states follow a path that may turn back: their order is not that of the time."""
        return bool(self.records) and (self.records[0].factor is not None or bool((np.diff(self.t) < 0).any()))

    @property
    def order(self) -> np.ndarray:
        """What increases from state to state (T,): the time [s], or along a path their number."""
        return np.arange(float(len(self.records))) if self.path else self.t

    @property
    def final(self) -> State:
        """The last accepted state."""
        if not self.records:
            raise ValueError("history: holds no state; the run stopped before the first one.")
        return self.records[-1].state

    def nodes(self, rod: Rod | str) -> np.ndarray:
        """Arc lengths (N,) [m] of a rod's nodes."""
        return self.model.space[self.rod(rod)].s

    def stations(self, rod: Rod | str) -> np.ndarray:
        """Arc lengths (Q,) [m] of a rod's Gauss points, where strains and section forces are most accurate."""
        return self.model.space[self.rod(rod)].s_gauss

    def positions(self, rod: Rod | str) -> np.ndarray:
        """Node positions (T, N, 3) [m]."""
        nodes = self.model.space[self.rod(rod)].nodes
        return np.array([record.state.r[nodes] for record in self.records])

    def directors(self, rod: Rod | str) -> np.ndarray:
        """Section frames [d1 d2 d3] (T, N, 3, 3) at the nodes."""
        nodes = self.model.space[self.rod(rod)].nodes
        return matrix_from_quaternion(np.array([record.state.q[nodes] for record in self.records]))

    def strains(self, rod: Rod | str) -> np.ndarray:
        """(shear 1, shear 2, stretch, bend 1, bend 2, twist) (T, Q, 6) [-, 1/m] minus the stress-free shape's."""
        return self._along(rod)[0]

    def total_strains(self, rod: Rod | str) -> np.ndarray:
        """As `strains`, with the stress-free shape's: (Gamma, K) (T, Q, 6), of a straight rod at rest (0, 0, 1, 0, 0, 0)."""
        view = self.model.space[self.rod(rod)]
        reference = self.model.space.groups[view.group].reference[view.elements].reshape(-1, 6)
        return self._along(rod)[0] + reference

    def at_nodes(self, rod: Rod | str, values: np.ndarray) -> np.ndarray:
        """Values (T, Q, ...) from the Gauss points to the nodes (T, N, ...), ends included.

        The polynomial through the Gauss points of an element, taken at its nodes; where two elements meet, the mean.
        """
        local = self.in_elements(rod, values)
        T, E, A = local.shape[:3]
        order = A - 1
        out = np.zeros((T, E * order + 1, *values.shape[2:]))
        out[:, :-1].reshape(T, E, order, *values.shape[2:])[...] += local[:, :, :-1]
        ends = out[:, order::order]
        ends += local[:, :, -1]
        out[:, order:-1:order] *= 0.5
        return out

    def in_elements(self, rod: Rod | str, values: np.ndarray) -> np.ndarray:
        """Values (T, Q, ...) from the Gauss points to the nodes of each element (T, E, A, ...), by its own polynomial."""
        rod = self.rod(rod)
        view = self.model.space[rod]
        group = self.model.space.groups[view.group]
        order = group.order
        points, nodes = group.basis.X[0], np.sort(group.basis.elem.doflocs[:, 0])
        powers = np.arange(order)
        take = ((nodes[:, None] - 0.5) ** powers) @ np.linalg.inv((points[:, None] - 0.5) ** powers)
        T, E = len(values), len(view.vertices) - 1
        return np.einsum("nq,teq...->ten...", take, values.reshape(T, E, order, *values.shape[2:]))

    def section_forces(self, rod: Rod | str, frame: Literal["material", "spatial"] = "material") -> np.ndarray:
        """Force and moment (T, Q, 6) [N, N m] of the part beyond s on the part before it, in directors or in space.

        The elastic ones, from the strains; what internal damping adds to them is in the reactions only.
        """
        strain, frames = self._along(rod)
        view = self.model.space[self.rod(rod)]
        C = self.model.space.groups[view.group].stiffness[view.elements].reshape(-1, 6, 6)
        forces = np.einsum("qij,tqj->tqi", C, strain)
        if frame == "spatial":
            forces = np.einsum("tqij,tqkj->tqki", frames, forces.reshape(*forces.shape[:2], 2, 3))
            forces = forces.reshape(*forces.shape[:2], 6)
        elif frame != "material":
            raise ValueError(f"section_forces: frame must be 'material' or 'spatial' (got {frame!r}).")
        return forces

    def reaction(self, support: Support | str) -> np.ndarray:
        """Force and moment (T, 6) [N, N m] of a support on the rod, in space, about the supported point."""
        row = self._support(support)
        return np.array([record.reactions[row] for record in self.records]).reshape(-1, 6)

    def support_place(self, support: Support | str) -> np.ndarray:
        """Place (T, 3) [m] of the supported point."""
        node = self.model.constraints.support_node[self._support(support)]
        return np.array([record.state.r[node] for record in self.records])

    def hinge_torque(self, part: Part | str) -> np.ndarray:
        """Torque (T,) [N m] about a part's hinge axis that a drive must supply against the rods, contact included.

        z . (r x F + M) summed over the part's supports, F and M on the rod, r from the axis; plus `contact_torque`.
        """
        part = self.part(part)
        hinge = _hinge("hinge_torque", part)
        touched = any(getattr(term, "part", None) is part for term in self.model.contacts)
        total = self.contact_torque(part) if touched else np.zeros(len(self.records))
        for support in self.model.supports:
            if support.to is part:
                load = self.reaction(support)
                arm = self.support_place(support) - hinge.point
                total += (np.cross(arm, load[:, :3]) + load[:, 3:]) @ hinge.axis
        return total

    def hinge_angle(self, part: Part | str) -> np.ndarray:
        """Angle (T,) [rad] of a part's hinge."""
        hinge = _hinge("hinge_angle", self.part(part))
        return np.array([hinge.angle_at(t) for t in self.stroke_t])

    def hinge_sense(self, part: Part | str) -> np.ndarray:
        """In which sense (T,) a part's hinge turned to come to each state, 1 or -1; while it stands, as before; the first
        state as the second; 0 if it never turns."""
        sense = np.sign(np.diff(self.hinge_angle(part))).astype(int)
        turning = np.flatnonzero(sense)
        if not len(turning):
            return np.zeros(len(self.records), dtype=int)
        last = np.searchsorted(turning, np.arange(len(sense)), side="right") - 1
        sense = sense[turning[np.maximum(last, 0)]]
        return np.append(sense[0], sense)

    def pressed(self, name: str) -> list[Pressed]:
        """What one contact term does at each state, by its name."""
        term = _find("contact", name, {term.name: term for term in self.model.contacts})
        return self._pressed(self.model.contacts.index(term))

    def contact_load(self, part: Part | str, name: str | None = None) -> np.ndarray:
        """Force and moment (T, 6) [N, N m] of the rods that touch a part on it, in space, about the part's origin.

        The origin in which it is drawn, carried along by its motion. name: of one contact term only.
        """
        part = self.part(part)
        load = self._load_about_origin(part, name)
        origin = np.array([part.pose(float(t))[1] for t in self.stroke_t]).reshape(-1, 3)
        load[:, 3:] -= np.cross(origin, load[:, :3])
        return load

    def contact_torque(self, part: Part | str, name: str | None = None) -> np.ndarray:
        """Torque (T,) [N m] about a part's hinge axis that a drive must supply against the rods that touch the part.

        name: of one contact term only.
        """
        part = self.part(part)
        hinge = _hinge("contact_torque", part)
        load = self._load_about_origin(part, name)
        return -(load[:, 3:] - np.cross(hinge.point, load[:, :3])) @ hinge.axis

    def contact_force(self, rod: Rod | str) -> np.ndarray:
        """Force and moment (T, N, 6) [N, N m] of everything that a rod touches on its nodes, in space."""
        rod = self.rod(rod)
        nodes, space = self.model.space[rod].nodes, self.model.space
        total = np.zeros((len(self.records), space.n_nodes, 6))
        for k, term in enumerate(self.model.contacts):
            if rod in term.rods:
                for row, told in zip(total, self._pressed(k), strict=True):
                    np.add.at(row, told.nodes, told.force)
        total = total[:, nodes]
        total[..., 3:] = np.einsum("tnij,tnj->tni", self.directors(rod), total[..., 3:])
        return total

    def line_force(self, rod: Rod | str) -> np.ndarray:
        """Force per length (T, N, 3) [N/m] of everything that a rod touches, in space: of a node over the node's share.

        A place that is pressed shares its force among the nodes of its element; `contacts` knows the pressure itself.
        """
        rod = self.rod(rod)
        return self.contact_force(rod)[..., :3] / self.model.space.share(rod)[:, None]

    def friction_work(self, name: str) -> np.ndarray:
        """Work (T,) [J] lost by friction in one contact term since the start."""
        return np.array([told.lost for told in self.pressed(name)])

    def contacts(self) -> list[Event]:
        """When each contact term touches, in order of time."""
        events = []
        for k in range(len(self.model.contacts)):
            rows = list(enumerate(self._pressed(k)))
            for touches, run in groupby(rows, lambda row: len(row[1].spans) > 0):
                if touches:
                    events.append(self._event(list(run), rows))
        return sorted(events, key=lambda event: event.begin)

    def _event(self, touching: list[tuple[int, Pressed]], rows: list[tuple[int, Pressed]]) -> Event:
        """From the stations at which a term touches, and all stations."""
        (begin, first), (end, last) = touching[0], touching[-1]
        top, strongest = max(touching, key=lambda row: row[1].peak)
        spans = np.concatenate([told.spans for _, told in touching])
        lost = last.lost - (rows[begin - 1][1].lost if begin > 0 else 0.0)
        return Event(
            first.name, first.rod, first.other, float(self.t[begin]), float(self.t[end]),
            strongest.peak, float(self.t[top]), strongest.peak_s,
            float(spans[:, 0].min()), float(spans[:, 1].max()), min(told.gap for _, told in touching), lost,
        )  # fmt: skip

    def _pressed(self, k: int) -> list[Pressed]:
        """What contact term number k does at each state."""
        if any(len(record.contact) != len(self.model.contacts) for record in self.records):
            raise ValueError("history: its states do not say what contact does.")
        return [record.contact[k] for record in self.records]

    def _load_about_origin(self, part: Part, name: str | None) -> np.ndarray:
        """Force and moment (T, 6) of rods on a part that they touch, about the origin of space."""
        total = np.zeros((len(self.records), 6))
        for k, term in enumerate(self.model.contacts):
            if getattr(term, "part", None) is part and name in (None, term.name):
                total += np.array([told.load for told in self._pressed(k)]).reshape(-1, 6)
        return total

    @property
    def energy(self) -> np.ndarray:
        """Strain energy (T,) [J] of all rods."""
        total = np.zeros(len(self.records))
        for rod in self.model.rods:
            view = self.model.space[rod]
            group = self.model.space.groups[view.group]
            C = group.stiffness[view.elements].reshape(-1, 6, 6)
            strain = self.strains(rod)
            stress = np.einsum("tqi,qij->tqj", strain, C, optimize=True)
            total += 0.5 * np.einsum("tqj,tqj,q->t", strain, stress, group.dx[view.elements].ravel(), optimize=True)
        return total

    @property
    def dynamic(self) -> bool:
        """True if this is a run in time, with velocities."""
        return bool(self.records) and self.records[0].rates is not None

    def velocities(self, rod: Rod | str) -> np.ndarray:
        """Node velocities (T, N, 6): of the place in space [m/s], angular in the section's axes [rad/s]."""
        return self._rates(rod, "v")

    def accelerations(self, rod: Rod | str) -> np.ndarray:
        """Node accelerations (T, N, 6): of the place in space [m/s^2], angular in the section's axes [rad/s^2]."""
        return self._rates(rod, "a")

    def _rates(self, rod: Rod | str, name: str) -> np.ndarray:
        self._need_rates()
        nodes = self.model.space[self.rod(rod)].nodes
        return np.array([getattr(record.rates, name)[nodes] for record in self.records])

    def _need_rates(self) -> None:
        if not self.dynamic:
            raise ValueError("history: has no velocities; it is not a run in time.")

    @property
    def kinetic_energy(self) -> np.ndarray:
        """Kinetic energy (T,) [J] of all rods."""
        self._need_rates()
        space = self.model.space
        v = np.array([record.rates.v for record in self.records if record.rates is not None])
        return 0.5 * (
            (v[..., :3] ** 2).sum(-1) @ space.node_mass + (v[..., 3:] ** 2 * space.node_inertia).sum((-2, -1))
        )

    @property
    def momentum(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear [kg m/s] and angular [kg m^2/s] momentum (T, 3) of all rods, the latter about the origin."""
        self._need_rates()
        space = self.model.space
        linear, angular = [], []
        for record in self.records:
            v = record.rates.v  # type: ignore[union-attr]
            p = space.node_mass[:, None] * v[:, :3]
            spin = np.einsum("nij,nj->ni", matrix_from_quaternion(record.state.q), space.node_inertia * v[:, 3:])
            linear.append(p.sum(0))
            angular.append((np.cross(record.state.r, p) + spin).sum(0))
        return np.array(linear), np.array(angular)

    @property
    def ledger(self) -> dict[str, np.ndarray]:
        """Energies and works (T,) [J] since the first kept state, of a run in time.

        "kinetic" and "strain" are energies; then the work done on the rods by each term (weight, loads; negative for
        what dampers and drag take) and by "driven ends"; "integrator" is what the steps added: energy minus works.
        """
        self._need_rates()
        kinetic, strain = self.kinetic_energy, self.energy
        works = {
            name: np.array([record.work[name] - self.records[0].work[name] for record in self.records])  # type: ignore[index]
            for name in self.records[0].work or {}
        }
        total = kinetic + strain
        missing = total - total[0] - sum(works.values())
        return {"kinetic": kinetic, "strain": strain, **works, "integrator": missing}

    @property
    def ledger_gap(self) -> float:
        """Largest energy that the integrator added or took, in parts of the largest energy or work in the run."""
        ledger = self.ledger
        missing = np.abs(ledger.pop("integrator")).max()
        return float(missing / max(max(np.abs(v).max() for v in ledger.values()), 1e-300))

    def check_ledger(self) -> None:
        """Warn if the energy ledger does not close."""
        if len(self.records) > 1 and self.ledger_gap > LEDGER:
            self.model.warn(
                f"energy ledger: the integrator added or took {100 * self.ledger_gap:.2g} % of the largest energy or work. "
                "Smaller steps (rtol or dt) close it; rho_inf below 1 damps motions that the steps cannot resolve."
            )

    @property
    def stable(self) -> list[bool | None]:
        """For each state whether the tangent is positive definite; None where loads have no potential."""
        return [None if record.negative < 0 else record.negative == 0 for record in self.records]

    def curve(self, rod: Rod | str, step: int = -1) -> CurveGeometry:
        """Frenet frame, curvature, torsion, section axes and Kardan angles of a rod at one state, at the Gauss points.

        r' = R Gamma; higher derivatives by r'' = R (Gamma' + K x Gamma) and so on, with Gamma', K' from the polynomial
        through the Gauss points of each element.
        """
        rod = self.rod(rod)
        view = self.model.space[rod]
        group = self.model.space.groups[view.group]
        state = self.records[step].state
        strain, frames = self.model.space.strain_and_frame(state, view.group)
        strain, frames = strain[view.elements], frames[view.elements]
        E, Q = strain.shape[:2]
        s = view.s_gauss.reshape(E, Q)
        slope = _differentiation(group.basis.X[0]) / group.dx[view.elements].sum(axis=1)[:, None, None]
        d_strain = np.einsum("eij,ejk->eik", slope, strain)
        dd_strain = np.einsum("eij,ejk->eik", slope, d_strain)
        gamma, kappa = strain[..., :3], strain[..., 3:]
        a = d_strain[..., :3] + np.cross(kappa, gamma)
        d_a = dd_strain[..., :3] + np.cross(d_strain[..., 3:], gamma) + np.cross(kappa, d_strain[..., :3])
        derivatives = [gamma, a, d_a + np.cross(kappa, a)]
        d1, d2, d3 = (np.einsum("eqij,eqj->eqi", frames, v).reshape(-1, 3) for v in derivatives)
        position = np.einsum("qa,eai->eqi", group.N, state.r[group.conn[view.elements]]).reshape(-1, 3)
        return curve_geometry(
            s.ravel(), position, d1, d2, d3, directors=frames.reshape(-1, 3, 3), bending_twist=kappa.reshape(-1, 3)
        )

    def _along(self, rod: Rod | str) -> tuple[np.ndarray, np.ndarray]:
        """Strains minus reference (T, Q, 6) and frames (T, Q, 3, 3)."""
        rod = self.rod(rod)
        view = self.model.space[rod]
        group = self.model.space.groups[view.group]
        strains, frames = self.model.space.strains_and_frames([record.state for record in self.records], view.group)
        strains = strains[:, view.elements] - group.reference[view.elements]
        n = len(view.s_gauss)
        return strains.reshape(-1, n, 6), frames[:, view.elements].reshape(-1, n, 3, 3)

    def rod(self, rod: Rod | str) -> Rod:
        """A rod of the model, by itself or by name."""
        return _find("rod", rod, {r.name: r for r in self.model.rods})

    def part(self, part: Part | str) -> Part:
        """A part of the model, by itself or by name."""
        return _find("part", part, {p.name: p for p in self.model.parts})

    def _support(self, support: Support | str) -> int:
        found = _find("support", support, {str(h.name): h for h in self.model.supports})
        return self.model.supports.index(found)


def _hinge(where: str, part: Part) -> Hinge:
    """The hinge of a part; ValueError if it has none."""
    if not isinstance(part.motion, Hinge):
        raise ValueError(f"{where}: part {part.name!r} has no hinge.")
    return part.motion


def _find(kind: str, wanted: Any, known: dict[str, Any]) -> Any:
    """The object itself or by its name; ValueError with the nearest name."""
    if isinstance(wanted, str):
        if wanted not in known:
            raise ValueError(f"history: no {kind} named {wanted!r}. {nearest(wanted, known)}")
        return known[wanted]
    if wanted not in known.values():
        raise ValueError(
            f"history: this {kind} is not part of the model. {nearest(getattr(wanted, 'name', ''), known)}"
        )
    return wanted


def _differentiation(points: np.ndarray) -> np.ndarray:
    """Matrix (Q, Q) that takes values at points to slopes of the polynomial through them."""
    n = len(points)
    V = np.vander(points - 0.5, n, increasing=True)
    powers = np.arange(n)
    dV = np.zeros_like(V)
    dV[:, 1:] = powers[1:] * V[:, :-1]
    return dV @ np.linalg.inv(V)
