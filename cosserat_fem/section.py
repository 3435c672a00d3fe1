"""What is a cable made of? Stiffness and inertia of a section.

Rule: a section is six stiffnesses (or a full symmetric 6x6 matrix), a mass and a rotary inertia per length, given in
the section's own axes d1, d2 (in the section) and d3 (normal to it, along the rod). Order everywhere: shear 1,
shear 2, stretch, bend 1 (about d1), bend 2 (about d2), twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, tanh

import numpy as np

from .errors import check_number, check_positive, check_shape


@dataclass(frozen=True, eq=False)
class Section:
    """Stiffness and inertia of a rod's section.

    Parameters
    ----------
    force_stiffness : (GA1, GA2, EA) [N]
        Against shear along d1, shear along d2, stretch along d3.
    moment_stiffness : (EI1, EI2, GJ) [N m^2]
        Against bending about d1, bending about d2, twist about d3.
    mass_per_length : [kg/m]
    rotary_inertia : (rho I1, rho I2, rho J) [kg m]
        About d1, d2, d3. Where it is 0, a run in time takes that of a section whose mass is spread as its stiffness is.
    radius : [m], optional
        Of the circle around the section; for pictures and, later, contact.
    outline : (width, height) [m], optional
        Of a rectangle along d1 and d2, for pictures; without it the section is drawn round.
    coupled : (6, 6) [N, N m, N m^2], optional
        Full symmetric positive definite matrix instead of the six numbers, in the order above (offset centroid, lay
        of a cable, layered section). Give this or the two triples, not both.

    Raises
    ------
    ValueError
        A number is not finite or not positive, or `coupled` is not symmetric positive definite.
    """

    force_stiffness: tuple[float, float, float] | None = None
    moment_stiffness: tuple[float, float, float] | None = None
    mass_per_length: float = 0.0
    rotary_inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float | None = None
    outline: tuple[float, float] | None = None
    coupled: np.ndarray | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        if (self.coupled is None) == (self.force_stiffness is None or self.moment_stiffness is None):
            raise ValueError(
                "section: give force_stiffness (GA1, GA2, EA) and moment_stiffness (EI1, EI2, GJ), "
                "or one coupled 6x6 matrix."
            )
        if self.coupled is None:
            names = ("GA1", "GA2", "EA", "EI1", "EI2", "GJ")
            values = [
                *check_shape("section: force_stiffness", self.force_stiffness, (3,)),
                *check_shape("section: moment_stiffness", self.moment_stiffness, (3,)),
            ]
            values = [check_positive(f"section: {n}", v) for n, v in zip(names, values, strict=True)]
            set_(self, "force_stiffness", tuple(values[:3]))
            set_(self, "moment_stiffness", tuple(values[3:]))
        else:
            set_(self, "coupled", _check_coupled(self.coupled))
        set_(self, "mass_per_length", check_positive("section: mass_per_length", self.mass_per_length, zero=True))
        inertia = check_shape("section: rotary_inertia", self.rotary_inertia, (3,))
        set_(
            self,
            "rotary_inertia",
            tuple(check_positive("section: rotary_inertia", v, zero=True) for v in inertia),
        )
        if self.radius is not None:
            set_(self, "radius", check_positive("section: radius", self.radius))
        if self.outline is not None:
            outline = check_shape("section: outline", self.outline, (2,))
            set_(self, "outline", tuple(check_positive("section: outline", v) for v in outline))

    @classmethod
    def round(
        cls,
        diameter: float,
        *,
        youngs_modulus: float,
        shear_modulus: float | None = None,
        poisson_ratio: float | None = None,
        density: float = 0.0,
        shear_factor: float = 0.9,
    ) -> Section:
        """Return a solid round section of one material.

        EA, GA = k G A with A = pi d^2 / 4; EI = E pi d^4 / 64; GJ = G pi d^4 / 32; G = E / 2 (1 + nu).

        Parameters
        ----------
        diameter : [m]
        youngs_modulus, shear_modulus : [Pa]
            Give the shear modulus or `poisson_ratio` (in (-1, 0.5]); without either, Poisson's ratio is 0.3.
        density : [kg/m^3]
        shear_factor : [-]
            Part of the area that carries shear, in (0, 1].
        """
        d = check_positive("section: diameter", diameter)
        E, G = _moduli(youngs_modulus, shear_modulus, poisson_ratio)
        k = _shear_factor(shear_factor)
        rho = check_positive("section: density", density, zero=True)
        area, second = pi * d**2 / 4, pi * d**4 / 64
        return cls(
            force_stiffness=(k * G * area, k * G * area, E * area),
            moment_stiffness=(E * second, E * second, 2 * G * second),
            mass_per_length=rho * area,
            rotary_inertia=(rho * second, rho * second, 2 * rho * second),
            radius=d / 2,
        )

    @classmethod
    def rectangle(
        cls,
        width: float,
        height: float,
        *,
        youngs_modulus: float,
        shear_modulus: float | None = None,
        poisson_ratio: float | None = None,
        density: float = 0.0,
        shear_factor: float = 5 / 6,
    ) -> Section:
        """Return a solid rectangle, `width` along d1 (the rod's `normal`), `height` along d2.

        EI1 = E width height^3 / 12 (about d1), EI2 = E height width^3 / 12; GJ with Saint-Venant's torsion constant.

        Parameters
        ----------
        width, height : [m]
        youngs_modulus, shear_modulus : [Pa]
            Give the shear modulus or `poisson_ratio`; without either, Poisson's ratio is 0.3.
        density : [kg/m^3]
        shear_factor : [-]
        """
        w, h = check_positive("section: width", width), check_positive("section: height", height)
        E, G = _moduli(youngs_modulus, shear_modulus, poisson_ratio)
        k = _shear_factor(shear_factor)
        rho = check_positive("section: density", density, zero=True)
        area, I1, I2 = w * h, w * h**3 / 12, h * w**3 / 12
        return cls(
            force_stiffness=(k * G * area, k * G * area, E * area),
            moment_stiffness=(E * I1, E * I2, G * torsion_constant(w, h)),
            mass_per_length=rho * area,
            rotary_inertia=(rho * I1, rho * I2, rho * (I1 + I2)),
            radius=float(np.hypot(w, h)) / 2,
            outline=(w, h),
        )

    @property
    def matrix(self) -> np.ndarray:
        """Stiffness matrix (6, 6) in the order shear 1, shear 2, stretch, bend 1, bend 2, twist."""
        if self.coupled is not None:
            return self.coupled
        return np.diag([*(self.force_stiffness or ()), *(self.moment_stiffness or ())])


def torsion_constant(width: float, height: float) -> float:
    """Saint-Venant torsion constant [m^4] of a rectangle.

    J = a b^3 [1/3 - 64 b / (pi^5 a) sum_{n odd} tanh(n pi a / 2b) / n^5] with a >= b the sides.
    Source: Timoshenko and Goodier, Theory of Elasticity, art. 109.
    """
    a, b = max(width, height), min(width, height)
    series = sum(tanh(n * pi * a / (2 * b)) / n**5 for n in range(1, 400, 2))
    return a * b**3 * (1 / 3 - 64 * b / (pi**5 * a) * series)


def _moduli(youngs: float, shear: float | None, poisson: float | None) -> tuple[float, float]:
    E = check_positive("section: youngs_modulus", youngs)
    if shear is not None:
        if poisson is not None:
            raise ValueError("section: give shear_modulus or poisson_ratio, not both.")
        return E, check_positive("section: shear_modulus", shear)
    nu = 0.3 if poisson is None else check_number("section: poisson_ratio", poisson)
    if not -1.0 < nu <= 0.5:
        raise ValueError(f"section: poisson_ratio must be above -1 and at most 0.5 (got {nu:g}).")
    return E, E / (2 * (1 + nu))


def _shear_factor(value: float) -> float:
    k = check_positive("section: shear_factor", value)
    if k > 1.0:
        raise ValueError(f"section: shear_factor must be at most 1 (got {k:g}).")
    return k


def _check_coupled(value: np.ndarray) -> np.ndarray:
    C = check_shape("section: coupled", value, (6, 6))
    if not np.allclose(C, C.T, rtol=1e-9, atol=1e-12 * np.abs(C).max()):
        raise ValueError("section: coupled must be symmetric.")
    scale = np.sqrt(np.abs(np.diag(C)))
    if not (scale > 0).all():
        raise ValueError("section: coupled has a zero on its diagonal; every strain needs a stiffness.")
    # scaled so that the smallest eigenvalue means the same in m and in mm
    smallest = float(np.linalg.eigvalsh(C / np.outer(scale, scale)).min())
    if smallest <= 0:
        raise ValueError(f"section: coupled must be positive definite (smallest scaled eigenvalue {smallest:.3g}).")
    C = 0.5 * (C + C.T)
    C.setflags(write=False)
    return C
