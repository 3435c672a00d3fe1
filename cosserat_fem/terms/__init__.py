"""What is a term? The protocol every physics term follows, and the list of public terms.

Rule: a scene is a sum of virtual-work terms. A term adds its force to the residual g(q, t) = 0 and its derivative to
the tangent, as blocks on sets of nodes; an object that is absent from the scene has no term and costs nothing. Terms
are frozen, hold no state and inherit nothing.
"""

from __future__ import annotations

from typing import Protocol

from ..space import Blocks, Space, State
from .dissipative import Damping, Drag
from .electric import Electrostatic
from .external import Gravity, LineLoad, PointLoad
from .part_contact import PartContact
from .rod_contact import RodContact

__all__ = ["Damping", "Drag", "Electrostatic", "Gravity", "LineLoad", "PartContact", "PointLoad", "RodContact", "Term"]


class Term(Protocol):
    """Anything that adds to the residual.

    `symmetric` says whether its tangent is the Hessian of a potential for every state; only then does the solver count
    negative eigenvalues, that is, judge stability. Optional attributes: `marks` (places that need a node), `kinks` and
    `jumps` (times that steps must not cross), `contact` (it has gaps that no iterate may close, see `barrier`, and takes
    `exact`), `needs_velocity`, `needs_mass`, `internal` (damping of strains), and `tabulated` with `table(t, space)`
    (nothing but loads at nodes: the compiled time step takes them as a table).
    """

    @property
    def name(self) -> str: ...

    @property
    def symmetric(self) -> bool: ...

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks: ...
