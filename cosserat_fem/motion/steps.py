"""How long are time steps to be? What a user asks for: an accuracy, or one length.

Rule: these are wishes, checked and nothing else; `integrator` fulfils them.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import check_positive


@dataclass(frozen=True)
class AdaptiveStep:
    """Step length from an error estimate.

    Parameters
    ----------
    rtol : [-]
        Accuracy asked for: the error added over the whole run, in parts of the longest rod and in rad.
    first, largest : [s], optional
        First and largest step.
    """

    rtol: float = 1e-4
    first: float | None = None
    largest: float | None = None

    def __post_init__(self) -> None:
        check_positive("adaptive step: rtol", self.rtol)
        for name in ("first", "largest"):
            if getattr(self, name) is not None:
                check_positive(f"adaptive step: {name}", getattr(self, name))


@dataclass(frozen=True)
class FixedStep:
    """Steps of one length, shortened so that they end at output times and kinks, and turn no section by more than 2 rad.

    Parameters
    ----------
    dt : [s]
    richardson : bool
        Run a second time with half the step and extrapolate: order 4 of smooth motions at output times, for three times
        the cost. `History.extrapolated` then says how far the two runs were apart.
    """

    dt: float
    richardson: bool = False

    def __post_init__(self) -> None:
        check_positive("fixed step: dt", self.dt)
