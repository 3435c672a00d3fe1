"""What is the system? Rods, supports and terms put together, and their sum.

Rule: the sum is a loop over terms and knows none of them by name. Every model has the internal force of its rods; loads
add nodal blocks. Checks that need the whole (names, places held twice, a cable shorter than its span) are made here,
once; facts worth a warning are kept in `warnings` and logged.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from time import thread_time
from typing import Any, Literal, Protocol

import numpy as np
from scipy.sparse import csc_matrix

from .constraint import Constraints
from .errors import SceneError, nearest
from .mechanism import Part
from .plane import AXES, ScenePlane, choose_plane
from .rod import Elements, Rod
from .space import Blocks, Entries, Space, State
from .support import Clamp, Pin, Support, Weld
from .terms import Term
from .terms.external import Factored
from .terms.internal import Additions, Condensed, InternalForce, KardanBeam, QuaternionBeam
from .terms.string import String

log = logging.getLogger(__name__)

NO_BLOCKS = np.empty((0, 6, 6))
THEORIES = ("cosserat", "kirchhoff", "string")
STRING_SHIFT = 1e-8  # EI / EA L^2 that stands for that of a string in the shift


@dataclass(frozen=True, eq=False)
class Sum:
    """Residual g (N, 6) of all terms, and the largest section force [N] and moment [N m] in the rods.

    negative: pivots of the condensed tangent; symmetric: whether the tangent is; whole: the whole tangent (6 N, 6 N) where
    contact couples rods, else nothing was said of it here; stiffest [N/m]: of contact at one place.
    """

    g: np.ndarray
    force: float
    moment: float
    negative: int = -1
    symmetric: bool = True
    whole: Entries | None = None
    stiffest: float = 0.0


@dataclass(frozen=True, eq=False)
class External:
    """Sum of all terms but the internal force: residual g (N, 6), tangents of nodes (N, 6, 6) or empty, of elements for
    each group as `terms.internal.Additions` takes them, and between rods; whether they are symmetric here."""

    g: np.ndarray
    nodal: np.ndarray
    elements: dict[int, tuple[np.ndarray, np.ndarray]]
    coupled: tuple[Blocks, ...]
    stiffest: float
    symmetric: bool


class Step(Protocol):
    """What a time step adds to a model: inertia, velocity and, with internal damping, other tables of the rods."""

    tables: list[tuple[Any, ...]] | None
    push: np.ndarray  # how many times contact counts in the residual (N, 6)
    heaviest: tuple[float, float]  # largest change of a node's inertia force [N/m] and moment [N m/rad]

    def with_velocity(self, state: State) -> State:
        """The state with its velocity at the end of the step."""
        ...

    def add(self, state: State, g: np.ndarray, nodal: np.ndarray) -> tuple[float, float]:
        """Add the inertia force to g and its tangent to nodal, if that is not empty; return the largest at a node."""
        ...


class Model:
    """Rods, what holds them and what acts on them.

    Parameters
    ----------
    rods : sequence of Rod
    supports : sequence of Clamp, Pin and Weld
    terms : sequence of loads
        A scene without a term pays nothing for it.
    rotation : "quaternion" or "kardan"
        Interpolation of the rotations. "kardan" uses the angles (psi, theta, phi) of the source paper: singular where
        a rod points along x, not objective; for comparison.
    theory : "cosserat", "kirchhoff" or "string"
        What rods resist: all six strains; all but shear, which is left out (its stiffness is a thousand times EA); stretch
        alone, with no rotation, bending or twist, so that clamps act as pins and loads must be dead forces.
    elements : {rod: Elements}, optional
        For rods that do not take the elements they ask for themselves.
    plane : "xy", "yz", "xz" or "auto", optional
        The scene stays in a plane parallel to this one: three unknowns a node instead of six, and the same results. What
        leaves it is an error; with "auto" the model is then one in space. A planar model sees no motion out of its plane,
        nor that an equilibrium would leave it; see `stability.out_of_plane`.

    Attributes
    ----------
    plane : ScenePlane or None
        The plane in which the model is solved.
    plane_choice : str
        Why it is that one, or none.
    warnings : list of str
        What the model's user should know; also logged.
    spent : {name: s}
        CPU time so far of each term and of the internal force.

    Raises
    ------
    SceneError
        Equal names, a support or load on a rod that is not in the model, a place held twice.
    KardanError
        rotation = "kardan" and a rod is drawn along x somewhere.
    """

    def __init__(
        self,
        rods: Sequence[Rod],
        supports: Sequence[Support | Weld] = (),
        terms: Sequence[Term] = (),
        *,
        rotation: Literal["quaternion", "kardan"] = "quaternion",
        theory: Literal["cosserat", "kirchhoff", "string"] = "cosserat",
        elements: Mapping[Rod, Elements] | None = None,
        plane: Literal["xy", "yz", "xz", "auto"] | None = None,
    ) -> None:
        if plane not in (None, "auto", *AXES):
            raise ValueError(f"model: plane must be None, 'auto', 'xy', 'yz' or 'xz' (got {plane!r}).")
        if rotation not in ("quaternion", "kardan"):
            raise ValueError(f"model: rotation must be 'quaternion' or 'kardan' (got {rotation!r}).")
        for name, given, kind in (
            ("rods", rods, Rod),
            ("supports", supports, (Clamp, Pin, Weld)),
            ("terms", terms, Callable),
        ):
            _check_list(name, given, kind)
        self.rods = tuple(rods)
        self.supports = tuple(h for h in supports if not isinstance(h, Weld))
        self.welds = tuple(w for w in supports if isinstance(w, Weld))
        self.terms = tuple(terms)
        self.contacts: tuple[Any, ...] = tuple(term for term in self.terms if getattr(term, "contact", False))
        if self.contacts and rotation == "kardan":
            raise SceneError("model: contact needs rotation = 'quaternion'.")
        if theory not in THEORIES:
            raise ValueError(f"model: theory must be 'cosserat', 'kirchhoff' or 'string' (got {theory!r}).")
        self.rotation, self.theory = rotation, theory
        self._check_members()
        if rotation == "kardan" and self.welds:
            raise SceneError(
                "model: welds need rotation = 'quaternion'; Kardan angles cannot join two rods at an angle."
            )
        self._check_theory()
        self.space = Space(self.rods, self.marks, rotation, elements, theory)
        self.internal: InternalForce = QuaternionBeam() if rotation == "quaternion" else KardanBeam()
        if theory == "string":
            self.internal = String()
        self.constraints = Constraints(self.space, self.supports, self.welds)
        self.symmetric = all(term.symmetric for term in self.terms)
        self._memo: dict[Any, Any] = {}
        self._wanted_plane = plane
        self.plane, self.plane_choice = self._choose_plane()
        self.warnings: list[str] = []
        self.spent: dict[str, float] = {}
        if any(getattr(term, "needs_mass", False) for term in self.terms):
            for rod in self.rods:
                if not self.space.node_mass[self.space[rod].nodes].any():
                    self.warn(
                        f"rod {rod.name!r}: has no mass, so gravity does not act on it. Give its section a density."
                    )

    def remember(self, make: Callable[[Model], Any]) -> Any:
        """Return make(model), made once for this model."""
        if make not in self._memo:
            self._memo[make] = make(self)
        return self._memo[make]

    def with_terms(self, terms: Sequence[Term]) -> Model:
        """The same rods and supports with other terms."""
        other = copy(self)
        other.__dict__.pop("parts", None)
        other.terms = tuple(terms)
        other.contacts = tuple(term for term in terms if getattr(term, "contact", False))
        other.symmetric = all(term.symmetric for term in terms)
        other.plane, other.plane_choice = other._choose_plane()
        other.warnings, other.spent, other._memo = [], {}, {}
        return other

    def with_elements(self, elements: Mapping[Rod, Elements]) -> Model:
        """The same system on other elements; rods, supports and terms are the same objects, and so is `warnings`."""
        other = copy(self)
        for name in ("shift", "scales", "free_motions"):  # those that were asked for already
            other.__dict__.pop(name, None)
        other.space = Space(self.rods, self.marks, self.rotation, elements, self.theory)
        other.constraints = Constraints(other.space, self.supports, self.welds)
        other.plane, other.plane_choice = other._choose_plane()
        other.spent, other._memo = {}, {}
        return other

    def in_space(self) -> Model:
        """The same system without its plane, for what looks out of it; `warnings` is the same object."""
        if self._wanted_plane is None:
            return self
        other = copy(self)
        other.__dict__.pop("free_motions", None)  # those in the plane
        other._wanted_plane, other.plane, other.plane_choice = None, None, "no plane: what leaves it counts here"
        other.spent, other._memo = {}, {}
        return other

    def with_theory(self, theory: Literal["cosserat", "kirchhoff", "string"]) -> Model:
        """The same rods on the same elements, supports and terms in another theory; with warnings of its own."""
        elements = {rod: view.mesh for rod, view in self.space.views.items()}
        supports: list[Support | Weld] = [*self.supports, *self.welds]
        plane = None if theory == "string" else self._wanted_plane
        return Model(
            self.rods, supports, self.terms, rotation=self.rotation, theory=theory, elements=elements, plane=plane
        )

    def _choose_plane(self) -> tuple[ScenePlane | None, str]:
        """The plane in which the model is solved, and why. SceneError if it cannot be the one that was asked for."""
        if self.theory == "string" and self._wanted_plane is not None:
            if self._wanted_plane != "auto":
                raise SceneError(
                    f'model: plane = "{self._wanted_plane}": strings have no planar form. Leave plane out.'
                )
            return None, "no plane: strings have no planar form"
        return choose_plane(self._wanted_plane, self.space, self.constraints, self.terms)

    def _check_theory(self) -> None:
        """SceneError if a string would have to do what it cannot."""
        if self.theory == "cosserat":
            return
        if self.rotation == "kardan" and self.theory == "string":
            raise SceneError("model: a string has no rotations; leave out rotation = 'kardan'.")
        if self.theory == "kirchhoff":
            return
        wrong = [
            f"term {term.name!r}: cannot act on a string, which has no sections that turn; strings take weight, dead forces "
            "and contact without friction."
            for term in self.terms
            if not getattr(term, "acts_on_strings", False)
        ]
        if wrong:
            raise SceneError(wrong)

    def with_factor(self, factor: float, loads: Sequence[Term] | None = None) -> Model:
        """The same model with some of its loads (default all) multiplied by a factor.

        Raises
        ------
        ValueError
            A load is not one of the model's, or no load at all (contact, damping).
        """
        chosen = self.loads(loads)
        return self.with_terms([Factored(term, factor) if term in chosen else term for term in self.terms])

    def loads(self, wanted: Sequence[Term] | None = None) -> tuple[Term, ...]:
        """The wanted loads of the model; default all. ValueError if one is not a load of this model."""
        loads = tuple(term for term in self.terms if not _no_load(term))
        if wanted is None:
            return loads
        for term in wanted:
            if term not in loads:
                what = "is not a load" if term in self.terms else "is not in the model"
                known = [t.name for t in loads]
                raise ValueError(f"loads: {getattr(term, 'name', term)!r} {what}. Loads of the model: {known}.")
        return tuple(wanted)

    def _check_members(self) -> None:
        if not self.rods:
            raise SceneError("model: has no rod.")
        faults = []
        for kind, names in (
            ("rod", [rod.name for rod in self.rods]),
            ("support", [str(h.name) for h in self.supports]),
            ("part", [part.name for part in self.parts]),
        ):
            faults += [
                f"{kind} {n!r}: the name is used twice." for n in sorted({n for n in names if names.count(n) > 1})
            ]
        known = [rod.name for rod in self.rods]
        members = [("support", h.name, h.rod) for h in self.supports]
        members += [("weld", "", rod) for w in self.welds for rod in (w.rod, w.other)]
        for term in self.terms:
            rods = [getattr(term, name, None) for name in ("rod", "other")] + list(getattr(term, "rods", ()))
            members += [("term", term.name, rod) for rod in dict.fromkeys(rods) if rod is not None]
        for kind, name, rod in members:
            if rod not in self.rods:
                hint = (
                    "The model has another rod of this name: use that object."
                    if rod.name in known
                    else nearest(rod.name, known)
                )
                faults.append(f"{kind} {name!r}: rod {rod.name!r} is not in the model. {hint}")
        if faults:
            raise SceneError(faults)

    @cached_property
    def marks(self) -> list[list[float]]:
        """Arc lengths where each rod needs a node: supports, welds and point loads."""
        marks: dict[Rod, list[float]] = {rod: [] for rod in self.rods}
        for h in self.supports:
            marks[h.rod].append(h.rod.place(h.at, "support"))
        for w in self.welds:
            marks[w.rod].append(w.rod.place(w.at, "weld"))
            marks[w.other].append(w.other.place(w.other_at, "weld"))
        for term in self.terms:
            for rod, s in getattr(term, "marks", ()):
                marks[rod].append(s)
        return [marks[rod] for rod in self.rods]

    @cached_property
    def parts(self) -> list[Part]:
        """Parts that hold or touch something, in order of appearance."""
        touched = [term.part for term in self.contacts if hasattr(term, "part")]
        return list(dict.fromkeys([*(h.to for h in self.supports), *touched]))

    def warn(self, message: str) -> None:
        """Keep and log a warning, once."""
        if message not in self.warnings:
            self.warnings.append(message)
            log.warning("%s", message)

    @contextmanager
    def hushed(self) -> Iterator[None]:
        """Warnings of states that are only tried go nowhere."""
        self.warn = lambda message: None  # type: ignore[method-assign]
        try:
            yield
        finally:
            del self.warn

    def initial_state(self, t: float = 0.0) -> State:
        """The drawn shape at time t."""
        return self.space.drawn_state(t)

    def check_state(self, state: State) -> None:
        """ValueError if a state is not one of this model."""
        shapes = [np.shape(a) for a in (state.r, state.q, *state.stress)] if isinstance(state, State) else []
        drawn = self.space.drawn_state()
        if shapes != [np.shape(a) for a in (drawn.r, drawn.q, *drawn.stress)]:
            raise ValueError("start: must be a State of this model: `history.final` of a run with the same elements.")
        if not (np.isfinite(state.r).all() and np.isfinite(state.q).all()):
            raise ValueError("start: holds places or rotations that are not finite.")
        if self.plane is not None:
            self.plane.check_state(state)

    def external(self, state: State, *, tangent: bool, exact: bool = True, push: np.ndarray | None = None) -> External:
        """All terms but the internal force. exact: contact with its full tangent, not only its positive part; push (N, 6):
        how many times contact counts."""
        g, nodal = np.zeros((self.space.n_nodes, 6)), NO_BLOCKS
        elements: dict[int, list[Blocks]] = {}
        coupled: list[Blocks] = []
        stiffest, symmetric = 0.0, True
        since = thread_time()
        for term in self.terms:
            pressing = False
            if term in self.contacts:
                blocks = term(state, self.space, tangent=tangent, exact=exact)  # type: ignore[call-arg]
                pressing = blocks.stiffest > 0.0
                stiffest = max(stiffest, blocks.stiffest)
                if pressing and push is not None:
                    blocks = blocks.times(push)
            else:
                blocks = term(state, self.space, tangent=tangent)
            for a in range(blocks.nodes.shape[1]):
                np.add.at(g, blocks.nodes[:, a], blocks.force[:, a])
            if tangent and blocks.stiffness is not None:
                if blocks.nodes.shape[1] == 1:
                    if not len(nodal):
                        nodal = np.zeros((self.space.n_nodes, 6, 6))
                    np.add.at(nodal, blocks.nodes[:, 0], blocks.stiffness)
                elif blocks.elements is not None:
                    elements.setdefault(blocks.elements[0], []).append(blocks)
                else:
                    coupled.append(blocks)
            symmetric &= term.symmetric or (term in self.contacts and not pressing)
            since = self.spend(term.name, since)
        blocks_of = {k: self._of_elements(k, b) for k, b in elements.items()}
        return External(g, nodal, blocks_of, tuple(coupled), stiffest, symmetric)

    def spend(self, name: str, since: float) -> float:
        """Book the CPU time [s] since `since` on a name; the time now."""
        now = thread_time()
        self.spent[name] = self.spent.get(name, 0.0) + now - since
        return now

    def touching(self, state: State) -> np.ndarray:
        """Residual (N, 6) of the contact terms alone."""
        g = np.zeros((self.space.n_nodes, 6))
        for term in self.contacts:
            blocks = term(state, self.space, tangent=False)
            for a in range(blocks.nodes.shape[1]):
                np.add.at(g, blocks.nodes[:, a], blocks.force[:, a])
        return g

    def _of_elements(self, group: int, found: list[Blocks]) -> tuple[np.ndarray, np.ndarray]:
        """Which block (E,) each element of a group has, or -1, and the blocks, those of one element added up."""
        numbers = np.concatenate([blocks.elements[1] for blocks in found])  # type: ignore[index]
        stiffness = np.concatenate([blocks.stiffness for blocks in found])
        unique, which = np.unique(numbers, return_inverse=True)
        summed = stiffness
        if not np.array_equal(unique, numbers):
            summed = np.zeros((len(unique), *stiffness.shape[1:]))
            np.add.at(summed, which, stiffness)
        touched = np.full(self.space.groups[group].n_elements, -1, dtype=np.int64)
        touched[unique] = np.arange(len(unique))
        return touched, summed

    def residual(self, state: State, *, step: Step | None = None) -> Sum:
        """Residual of all terms at a state; what is left on held unknowns is the reaction. step: inertia of a time step."""
        tables, largest = None, (0.0, 0.0)
        if step is not None:
            state, tables = step.with_velocity(state), step.tables
        outside = self.external(state, tangent=False, push=None if step is None else step.push)
        g = outside.g
        if step is not None:
            largest = step.add(state, g, NO_BLOCKS)
        since = thread_time()
        force, moment = self.internal.residual(state, self.space, g, tables)
        self.spend(self.internal.name, since)
        return Sum(g, max(force, largest[0]), max(moment, largest[1]), stiffest=outside.stiffest)

    def condensed(
        self,
        state: State,
        scratch: list[Condensed],
        mu: float,
        offset: np.ndarray | None,
        *,
        step: Step | None = None,
        exact: bool = True,
    ) -> Sum:
        """Residual and, in `scratch`, the condensed tangent with mu * shift on the diagonal. offset: added to g."""
        tables, largest = None, (0.0, 0.0)
        if step is not None:
            state, tables = step.with_velocity(state), step.tables
        outside = self.external(state, tangent=True, exact=exact, push=None if step is None else step.push)
        g, nodal = outside.g, outside.nodal
        if step is not None:
            if not len(nodal):
                nodal = np.zeros((self.space.n_nodes, 6, 6))
            largest = step.add(state, g, nodal)
        if offset is not None:
            g += offset
        symmetric = outside.symmetric and step is None
        since = thread_time()
        if outside.coupled:
            force, moment, matrices = self.internal.full(state, self.space, g, tables)  # type: ignore[attr-defined]
            self.spend(self.internal.name, since)
            whole = self._summed(matrices, outside, nodal, mu)
            largest = (max(force, largest[0]), max(moment, largest[1]))
            return Sum(g, *largest, 0, symmetric, whole, outside.stiffest)
        additions = Additions(nodal, outside.elements, self.shift, mu, symmetric, tables)
        force, moment, negative = self.internal.condensed(state, self.space, g, scratch, additions)
        self.spend(self.internal.name, since)
        largest = (max(force, largest[0]), max(moment, largest[1]))
        return Sum(g, *largest, negative, symmetric, None, outside.stiffest)

    def _summed(self, matrices: list[np.ndarray], outside: External, nodal: np.ndarray, mu: float) -> Entries:
        """The whole tangent from matrices of elements, of nodes and between rods, with mu * shift on the diagonal."""
        for k, (touched, blocks) in outside.elements.items():
            matrices[k][touched >= 0] += blocks[touched[touched >= 0]]
        if mu > 0.0:
            shifts = mu * self.shift[:, :, None] * np.eye(6)
            nodal = nodal + shifts if len(nodal) else shifts
        places = self.space.places if len(nodal) else self.space.places[:-1]
        values = [*matrices, nodal] if len(nodal) else matrices
        parts = [Entries(*place, K.ravel()) for place, K in zip(places, values, strict=True)]
        parts += [Entries.at(blocks.nodes, blocks.stiffness) for blocks in outside.coupled]  # type: ignore[arg-type]
        return Entries.sum(parts)

    def matrix(self, state: State) -> csc_matrix:
        """Full tangent (6 N, 6 N) before supports: the plain sum of all blocks."""
        blocks: list[Blocks] = list(self.internal(state, self.space))
        blocks += [term(state, self.space) for term in self.terms]
        parts = [Entries.at(block.nodes, block.stiffness) for block in blocks if block.stiffness is not None]
        return Entries.sum(parts).matrix(6 * self.space.n_nodes)

    @cached_property
    def shift(self) -> np.ndarray:
        """Weights (N, 6) of the shift that keeps the guarded method's matrix positive: w EI / L^2 (1 / L^2, 1)."""
        shift = np.empty((self.space.n_nodes, 6))
        for rod in self.rods:
            view = self.space[rod]
            group = self.space.groups[view.group]
            bending = float(group.stiffness[view.elements][..., (3, 4), (3, 4)].mean())
            if self.theory == "string":
                bending = STRING_SHIFT * float(group.stiffness[view.elements][..., 2, 2].mean()) * rod.length**2
            weight = self.space.share(rod) * bending / rod.length**2
            shift[view.nodes, :3] = weight[:, None] / rod.length**2
            shift[view.nodes, 3:] = weight[:, None]
        return shift

    @cached_property
    def scales(self) -> dict[str, float]:
        """Numbers that make residuals comparable: lengths [m], largest stiffnesses [N, N m^2]."""
        groups = self.space.groups
        h = np.concatenate([g.dx.sum(axis=1) for g in groups])
        drawn = self.initial_state().r
        return {
            "length": float(self.space.lengths.max()),
            "element": float(h.mean()),
            "smallest": float(h.min()),
            "size": float(np.abs(drawn).max()),
            "axial": max(float(np.abs(g.stiffness[..., (0, 1, 2), (0, 1, 2)]).max()) for g in groups),
            "bending": max(float(np.abs(g.stiffness[..., (3, 4, 5), (3, 4, 5)]).max()) for g in groups),
        }

    @cached_property
    def free_motions(self) -> list[tuple[str, bool]]:
        """Rigid motions that the supports allow: (description, is a translation), for each set of joined rods."""
        found = []
        for rods, rows in self._components():
            center = np.mean([rod.drawn(np.array([0.0, rod.length])).mean(0) for rod in rods], axis=0)
            size = max(rod.drawn_length for rod in rods)
            conditions = [np.zeros((0, 6)) if self.plane is None else np.eye(6)[self.plane.out_of_plane]]
            targets = self.constraints.targets(max((part.drawn_at for part in self.parts), default=0.0))
            state = self.initial_state()
            for row in rows:
                node = self.constraints.support_node[row]
                arm = (state.r[node] - center) / size
                cross = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
                axes = targets.axes[row]
                spin = np.block([[axes.T, -axes.T @ cross], [np.zeros((3, 3)), axes.T]])
                conditions.append(spin[self.constraints.held[row]])
            A = np.concatenate(conditions)
            held = len(A) > len(conditions[0])
            names = " and ".join(repr(rod.name) for rod in rods[:3]) + (" ..." if len(rods) > 3 else "")
            if not held:
                found.append((f"rod {names} has no support", True))
                continue
            # translations first, so that they are told as such, then what else the conditions leave
            slides = _null_space(A[:, :3])
            found += [(f"rod {names} can still move along {_direction(v)}", True) for v in slides]
            used = np.column_stack([slides, np.zeros((len(slides), 3))])
            turns = _null_space(np.concatenate([A, used]))
            found += [(f"rod {names} can still {_turn(v, center, size)}", False) for v in turns]
        return found

    def _components(self) -> list[tuple[list[Rod], list[int]]]:
        """Sets of rods joined by welds, each with the rows of its supports."""
        label = {rod: k for k, rod in enumerate(self.rods)}
        for w in self.welds:
            a, b = label[w.rod], label[w.other]
            label = {rod: (a if k == b else k) for rod, k in label.items()}
        sets = []
        for k in dict.fromkeys(label.values()):
            rods = [rod for rod in self.rods if label[rod] == k]
            rows = [i for i, h in enumerate(self.supports) if h.rod in rods]
            sets.append((rods, rows))
        return sets

    @cached_property
    def _spans(self) -> list[tuple[Rod, float, int, int]]:
        """Each rod between two supports that hold its place: length [m] in between, their numbers."""
        pairs = []
        for rod in self.rods:
            held = sorted(
                (h.rod.place(h.at, "support"), row)
                for row, h in enumerate(self.supports)
                if h.rod is rod and h.held[:3].all()
            )
            pairs += [(rod, b[0] - a[0], a[1], b[1]) for a, b in pairwise(held)]
        return pairs

    def check_spans(self, times: Sequence[float] | np.ndarray) -> None:
        """Warn where two supports of a rod come further apart than the cable between them is long."""
        pairs = self._spans
        if not pairs:
            return
        places = [self.constraints.targets(float(t)).place for t in times]
        for rod, length, a, b in pairs:
            chords = np.array([np.linalg.norm(place[b] - place[a]) for place in places])
            k = int(np.argmax(chords))
            if chords[k] > length * (1 + 1e-9):
                self.warn(
                    f"rod {rod.name!r}: {length:.4g} m of cable between {self.supports[a].name!r} and "
                    f"{self.supports[b].name!r}, which are {chords[k]:.4g} m apart at t = {times[k]:g} s: it must "
                    f"stretch by at least {100 * (chords[k] / length - 1):.2g} %."
                )


def _no_load(term: Term) -> bool:
    """True for contact and for what resists motion: a factor means nothing there."""
    return any(getattr(term, name, False) for name in ("contact", "needs_velocity", "internal"))


def _check_list(name: str, given: Any, kind: Any) -> None:
    """ValueError if a member of the list `given` is of another kind."""
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise ValueError(f"model: {name} must be a list (got {type(given).__name__}); write [...] around one.")
    for member in given:
        if not isinstance(member, kind) or isinstance(member, type):
            wanted = {"rods": "Rod", "supports": "Clamp, Pin or Weld", "terms": "loads and other terms"}[name]
            raise ValueError(f"model: {name} holds {wanted} (got {type(member).__name__}).")


def _null_space(A: np.ndarray) -> np.ndarray:
    """Orthonormal rows that A maps to zero."""
    _, values, V = np.linalg.svd(A, full_matrices=True)
    return V[int((values > 1e-9).sum()) :]


def _turn(v: np.ndarray, center: np.ndarray, size: float) -> str:
    """A rotation (translation / size, rotation vector) in words."""
    turn = np.linalg.norm(v[3:])
    axis = v[3:] / turn
    # the axis passes through the point where the translation is parallel to the rotation
    point = center + size * np.cross(axis, v[:3]) / turn
    return f"turn about the line through {_point(point)} along {_direction(axis)}"


def _direction(v: np.ndarray) -> str:
    v = v / np.linalg.norm(v)
    k = int(np.argmax(np.abs(v)))
    return "xyz"[k] if abs(v[k]) > 1 - 1e-6 else _point(v * np.sign(v[k]))


def _point(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in np.where(np.abs(v) < 1e-12, 0.0, v)) + ")"
