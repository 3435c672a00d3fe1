"""Cables that follow mechanisms: geometrically exact (Cosserat) rods by finite elements.

Rule: the names below are the package; they load when first used, so that importing it, or asking the command line for
help, costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Section": "section",
    "Material": "cables.buildup",
    "Cable": "cables.buildup",
    "Strands": "cables.buildup",
    "Cables": "cables.buildup",
    "Tube": "cables.buildup",
    "Braid": "cables.buildup",
    "Tape": "cables.buildup",
    "build_up": "cables.buildup",
    "cable_named": "cables.catalogue",
    "catalogue_section": "cables.catalogue",
    "material": "cables.catalogue",
    "Rod": "rod",
    "Part": "mechanism",
    "GROUND": "mechanism",
    "Hinge": "mechanism",
    "Slider": "mechanism",
    "Path": "mechanism",
    "Plane": "shapes",
    "Sphere": "shapes",
    "Cylinder": "shapes",
    "Capsule": "shapes",
    "Box": "shapes",
    "Torus": "shapes",
    "Surface": "surface",
    "Clamp": "support",
    "Pin": "support",
    "Weld": "support",
    "Gravity": "terms",
    "LineLoad": "terms",
    "PointLoad": "terms",
    "Damping": "terms",
    "Drag": "terms",
    "Electrostatic": "terms",
    "PartContact": "terms",
    "RodContact": "terms",
    "Model": "model",
    "Elements": "rod",
    "State": "space",
    "History": "history",
    "solve_static": "equilibrium.statics",
    "solve_quasistatic": "equilibrium.statics",
    "solve_dynamic": "motion.dynamics",
    "Resolution": "equilibrium.march",
    "Watch": "equilibrium.march",
    "trace_path": "equilibrium.continuation",
    "critical_load": "equilibrium.continuation",
    "CriticalPoint": "record",
    "modes": "equilibrium.vibration",
    "Modes": "equilibrium.vibration",
    "AdaptiveStep": "motion.integrator",
    "FixedStep": "motion.integrator",
    "RigidVelocity": "motion.dynamics",
    "bend_radius": "limits.quantities",
    "clearance": "limits.gaps",
    "distance_from_drawing": "limits.quantities",
    "Limit": "limits.allowed",
    "Verdict": "limits.verdicts",
    "check": "limits.verdicts",
    "compare_theories": "theories",
    "to_pyvista": "export",
    "to_meshio": "export",
    "CurveGeometry": "curve",
    "curve_geometry": "curve",
    "rebuild_curve": "curve",
    "out_of_plane": "equilibrium.stability",
    "load_scene": "scene",
    "Scene": "scene",
    "run_scene": "run",
    "CosseratError": "errors",
    "SceneError": "errors",
    "MeshError": "errors",
    "KardanError": "errors",
    "ConvergenceError": "errors",
}

__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from .cables.buildup import Braid, Cable, Cables, Material, Strands, Tape, Tube, build_up
    from .cables.catalogue import cable_named, catalogue_section, material
    from .curve import CurveGeometry, curve_geometry, rebuild_curve
    from .equilibrium.continuation import critical_load, trace_path
    from .equilibrium.march import Resolution, Watch
    from .equilibrium.stability import out_of_plane
    from .equilibrium.statics import solve_quasistatic, solve_static
    from .equilibrium.vibration import Modes, modes
    from .errors import ConvergenceError, CosseratError, KardanError, MeshError, SceneError
    from .export import to_meshio, to_pyvista
    from .history import History
    from .limits.allowed import Limit
    from .limits.gaps import clearance
    from .limits.quantities import bend_radius, distance_from_drawing
    from .limits.verdicts import Verdict, check
    from .mechanism import GROUND, Hinge, Part, Path, Slider
    from .model import Model
    from .motion.dynamics import RigidVelocity, solve_dynamic
    from .motion.steps import AdaptiveStep, FixedStep
    from .record import CriticalPoint
    from .rod import Elements, Rod
    from .run import run_scene
    from .scene import Scene, load_scene
    from .section import Section
    from .shapes import Box, Capsule, Cylinder, Plane, Sphere, Torus
    from .space import State
    from .support import Clamp, Pin, Weld
    from .surface import Surface
    from .terms import Damping, Drag, Electrostatic, Gravity, LineLoad, PartContact, PointLoad, RodContact
    from .theories import compare_theories


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'cosserat_fem' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
