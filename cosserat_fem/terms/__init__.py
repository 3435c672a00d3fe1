"""What is a term? The protocol every physics term follows, and the list of public terms.

Rule: a scene is a sum of virtual-work terms. A term adds its force to the residual g(q, t) = 0 and its derivative to
the tangent, as blocks on sets of nodes; an object that is absent from the scene has no term and costs nothing. Terms
are frozen, hold no state and inherit nothing.
"""

from __future__ import annotations

from typing import Protocol

from ..space import Blocks, Space, State
from .external import Gravity, LineLoad, PointLoad

__all__ = ["Gravity", "LineLoad", "PointLoad", "Term"]


class Term(Protocol):
    """Anything that adds to the residual.

    `symmetric` says whether its tangent is the Hessian of a potential for every state; only then does the solver count
    negative eigenvalues, that is, judge stability.
    """

    @property
    def name(self) -> str: ...

    @property
    def symmetric(self) -> bool: ...

    def __call__(self, state: State, space: Space, *, tangent: bool = True) -> Blocks: ...
