"""What does a run say in short? Peaks, where and when they are, how the solution went: the content of `summary.json`.

Rule: every number here can be read from the history; nothing is solved but what a planar run cannot see.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from .drive import as_peaks, describe_torque
from .equilibrium.stability import leaves_plane
from .equilibrium.vibration import Modes
from .export import hinged_parts
from .history import History
from .limits.allowed import beside_supports
from .limits.gaps import clearance
from .limits.quantities import bend_radius, distance_from_drawing, worst
from .mechanism import Hinge, Part
from .rod import Rod
from .section import Section


def describe(history: History, parts: Sequence[Part] = (), known: Collection[tuple[str, str]] = ()) -> dict[str, Any]:
    """What a summary says of a history: counters, residual, strains, bend radius, distances, peaks, active physics.

    parts: those that rods should stay clear of, besides those that they may touch. known: names of rods and parts whose
    clearance is told otherwise.
    """
    model = history.model
    contacts = {term.name: _describe_contact(history, term.name) for term in model.contacts}
    clear = _clearances(history, parts, known)
    terms = [model.internal.name, *(term.name for term in model.terms)]
    return {
        "stations": {"kept": len(history), "first": float(history.t[0]), "last": float(history.t[-1])},
        **({"path": _describe_path(history)} if history.path or history.critical else {}),
        "counters": asdict(history.counters) | {"most_iterations": max(r.iterations for r in history.records)},
        "worst_residual": max(r.residual for r in history.records),
        **({"in_time": _describe_motion(history)} if history.dynamic else {"stable": _stability(history)}),
        "physics": {
            "terms": terms,
            "cpu_seconds": {name: round(spent, 6) for name, spent in model.spent.items()},
            "rotation": model.rotation,
            "theory": model.theory,
            "plane": model.plane.name if model.plane is not None else None,
            "plane_choice": model.plane_choice,
            "supports": [str(h.name) for h in model.supports],
            "welds": len(model.welds),
            "unknowns": (6 if model.plane is None else 3) * model.space.n_nodes,
            **({"chosen": asdict(history.chosen)} if history.chosen is not None else {}),
        },
        "rods": {rod.name: _describe_rod(history, rod) for rod in model.rods},
        "reactions": {str(h.name): _describe_reaction(history, h) for h in model.supports},
        "hinges": {part.name: _describe_hinge(history, part) for part in hinged_parts(history)},
        **({"contacts": contacts} if contacts else {}),
        **({"clearances": clear} if clear else {}),
    }


def flat(data: Any, path: str = "") -> dict[str, Any]:
    """Values of a summary by dotted path, the names of results; entries of lists by number, what is None not at all."""
    if isinstance(data, dict | list):
        entries = data.items() if isinstance(data, dict) else enumerate(data)
        found: dict[str, Any] = {}
        for key, inner in entries:
            found |= flat(inner, f"{path}.{key}" if path else str(key))
        return found
    return {} if data is None else {path: data}


def size(path: str, value: float) -> float:
    """A result as limits and correlations see it: what is called largest counts by its size, whatever its direction."""
    return abs(float(value)) if ".largest_" in path else float(value)


def describe_peaks(
    history: History, parts: Sequence[Part] = (), known: Collection[tuple[str, str]] = ()
) -> dict[str, Any]:
    """As `describe`, of one state that takes the place of every peak in turn: to be compared with the peak."""
    said = describe(history, parts, known)
    for part in hinged_parts(history):
        said["hinges"][part.name] |= as_peaks(history, part)
    return said


def _describe_path(history: History) -> dict[str, Any]:
    """Extent of a path and its critical points; `after_station` counts from 0."""
    return {
        "factor": {"first": float(history.factors[0]), "last": float(history.factors[-1])},
        "critical": [
            {
                "kind": event.kind,
                "value": float(event.value),
                "t": float(event.t),
                "negative_eigenvalues": [event.before, event.after],
                "after_station": event.station,
            }
            for event in history.critical
        ],
    }


def describe_modes(found: Modes) -> dict[str, Any]:
    """Vibrations about the last state."""
    return {
        "stable": found.stable,
        "frequency_Hz": found.frequency.tolist(),
        "growth_per_s": found.growth.tolist(),
    }


def _describe_motion(history: History) -> dict[str, Any]:
    """Steps, energies and works at the end, momentum, and how far the ledger is open."""
    accepted = [h for _, h, _, taken in history.steps if taken]
    linear, angular = history.momentum
    return {
        "steps": {
            "accepted": len(accepted),
            "rejected": len(history.steps) - len(accepted),
            "shortest": min(accepted, default=0.0),
            "longest": max(accepted, default=0.0),
        },
        "ledger": {name: float(values[-1]) for name, values in history.ledger.items()},
        "ledger_gap": history.ledger_gap,
        "linear_momentum": linear[-1].tolist(),
        "angular_momentum": angular[-1].tolist(),
        **({"extrapolated_from": history.extrapolated} if history.extrapolated is not None else {}),
    }


def _stability(history: History) -> str:
    known = [s for s in history.stable if s is not None]
    if not known:
        return "not judged: a load has no potential"
    unstable = [f"{x:g}" for x, s in zip(history.order, history.stable, strict=True) if s is False]
    if not unstable:
        return "stable at every station"
    more = f" and {len(unstable) - 10} more" if len(unstable) > 10 else ""
    stations = ", ".join(unstable[:10]) + more
    return f"unstable at stations {stations}" if history.path else f"unstable at t = {stations} s"


def out_of_plane(history: History) -> list[int | None]:
    """In how many ways each state would leave the plane of its model; a warning if any would."""
    ways = leaves_plane(history)
    leaving = [f"{t:g}" for t, n in zip(history.t, ways, strict=True) if n]
    if leaving:
        history.model.warn(
            f"at t = {', '.join(leaving[:5])}{' and more' if len(leaving) > 5 else ''} s a real rod would leave the plane "
            f'"{history.model.plane.name}" of this run. Leave `plane` out to see where it goes.'  # type: ignore[union-attr]
        )
    return ways


def _describe_rod(history: History, rod: Any) -> dict[str, Any]:
    t, stations, nodes = history.t, history.stations(rod), history.nodes(rod)
    strain = history.strains(rod)
    names = ("shear 1", "shear 2", "stretch", "bend 1 [1/m]", "bend 2 [1/m]", "twist [1/m]")
    radius = worst(bend_radius(history, rod, at="nodes"), t, nodes, largest=False)
    distance = distance_from_drawing(history, rod)
    stretch = np.linalg.norm(history.total_strains(rod)[..., :3], axis=-1)
    group = history.model.space.groups[history.model.space[rod].group]
    dx = group.dx[history.model.space[rod].elements].ravel()
    lengths = stretch @ dx
    return {
        "elements": len(history.model.space[rod].vertices) - 1,
        "order": history.model.space[rod].mesh.order,
        "section": [_describe_section(place, section) for place, section in rod.sections],
        "length": {"free": float(rod.length), "drawn": float(rod.drawn_length), "longest": float(lengths.max())},
        "largest_strain": {name: worst(np.abs(strain[..., k]), t, stations) for k, name in enumerate(names)},
        "smallest_bend_radius": radius if np.isfinite(radius["value"]) else None,
        "from_drawn_route": {
            "first station": worst(distance[:1], t[:1], nodes),
            "whole run": worst(distance, t, nodes),
        },
    }


def _describe_section(s: float, section: Section) -> dict[str, Any]:
    """Stiffness, mass and size of a section at s [m]; of a coupled one its diagonal."""
    GA1, GA2, EA, EI1, EI2, GJ = (float(x) for x in np.diag(section.matrix))
    return {
        "s": float(s),
        "GA": [GA1, GA2],
        "EA": EA,
        "EI": [EI1, EI2],
        "GJ": GJ,
        "mass_per_length": section.mass_per_length,
        "diameter": None if section.radius is None else 2 * section.radius,
        **({"width_and_height": list(section.outline)} if section.outline else {}),
    }


def _describe_reaction(history: History, support: Any) -> dict[str, Any]:
    loads = history.reaction(support)
    out = {}
    for name, part in (("force", loads[:, :3]), ("moment", loads[:, 3:])):
        size = np.linalg.norm(part, axis=1)
        k = int(np.argmax(size))
        out[f"largest_{name}"] = {"value": float(size[k]), "t": float(history.t[k])}
    return out


def _describe_hinge(history: History, part: Any) -> dict[str, Any]:
    torque, angle = history.hinge_torque(part), np.degrees(history.hinge_angle(part))
    k = int(np.argmax(np.abs(torque)))
    hinge: Hinge = part.motion
    return {
        "axis": hinge.axis.tolist(),
        "largest_torque": {"value": float(torque[k]), "angle_deg": float(angle[k]), "t": float(history.t[k])},
        "last_torque": float(torque[-1]),
        **describe_torque(history, part),
    }


def _describe_contact(history: History, name: str) -> dict[str, Any]:
    """When a contact touches, its largest line force and load, the work that friction took, the smallest gap."""
    told, t = history.pressed(name), history.t
    events = [event for event in history.contacts() if event.name == name]
    peak = max(range(len(told)), key=lambda k: told[k].peak)
    force = np.linalg.norm([p.load[:3] for p in told], axis=1)
    gap = min(range(len(told)), key=lambda k: told[k].gap)
    near = np.isfinite(told[gap].gap)
    return {
        "between": [told[0].rod, told[0].other],
        "touches": [[event.begin, event.end] for event in events],
        "largest_line_force": {"value": told[peak].peak, "s": told[peak].peak_s, "t": float(t[peak])},
        "largest_force": {"value": float(force.max()), "t": float(t[np.argmax(force)])},
        "friction_work": told[-1].lost,
        "smallest_gap": {"value": told[gap].gap, "s": told[gap].gap_s, "t": float(t[gap])} if near else None,
    }


def _clearances(history: History, parts: Sequence[Part], known: Collection[tuple[str, str]]) -> dict[str, Any]:
    """Smallest distance of each rod from each part with a surface that it may not touch.

    Within a few radii of a support on the part it is not looked at: there it is meant to be close.
    """
    touched = {(rod, term.part) for term in history.model.contacts if hasattr(term, "part") for rod in term.rods}
    out: dict[str, Any] = {}
    for rod in history.model.rods:
        for part in parts:
            if (rod, part) in touched or (rod.name, part.name) in known or not (part.shapes or part.mesh is not None):
                continue
            spans = beside_supports(history.model, rod, part)
            values = clearance(history, rod, part, leave_out=spans)
            k = int(np.argmin(values))
            if np.isfinite(values[k]):
                out.setdefault(rod.name, {})[part.name] = told_clearance(rod, values[k], history.t[k], spans)
    return out


def told_clearance(rod: Rod, value: float, t: float, spans: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """A smallest distance [m] of a rod from a part, when it was, and stretches of the rod that were not looked at."""
    left_out = [[max(a, 0.0), min(b, float(rod.length))] for a, b in spans]
    return {"value": float(value), "t": float(t), **({"left_out": left_out} if left_out else {})}
