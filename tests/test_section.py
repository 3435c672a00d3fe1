"""Sections: textbook stiffness, torsion, bad numbers."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.section import torsion_constant


def test_round():
    """EA, GA, EI, GJ and inertia of a solid bar: the deployment cable's own numbers."""
    s = cf.Section.round(3.941494168101e-3, youngs_modulus=527171872.713, poisson_ratio=0.3, density=1500)
    np.testing.assert_allclose(s.force_stiffness, (2226.553064004, 2226.553064004, 6432.264407122), rtol=1e-11)
    np.testing.assert_allclose(s.moment_stiffness, (6.245477992432e-3,) * 2 + (4.804213840333e-3,), rtol=1e-11)
    assert s.mass_per_length == pytest.approx(1500 * 1.220145599578e-05, rel=1e-11)
    assert s.rotary_inertia[2] == pytest.approx(2 * s.rotary_inertia[0])
    assert s.radius == pytest.approx(3.941494168101e-3 / 2)


def test_rectangle():
    """Bending about d1 feels the height along d2, bending about d2 the width along d1."""
    s = cf.Section.rectangle(0.02, 0.003, youngs_modulus=70e9, shear_modulus=26e9)
    assert s.moment_stiffness[0] == pytest.approx(70e9 * 0.02 * 0.003**3 / 12)
    assert s.moment_stiffness[1] == pytest.approx(70e9 * 0.003 * 0.02**3 / 12)
    assert s.force_stiffness[0] == pytest.approx(5 / 6 * 26e9 * 6e-5)


@pytest.mark.parametrize(
    ("a", "b", "factor"), [(1.0, 1.0, 0.140577), (2.0, 1.0, 0.228682), (10.0, 1.0, 0.312), (1e4, 1.0, 1 / 3)]
)
def test_torsion_constant(a, b, factor):
    """Saint-Venant's J / (a b^3): Timoshenko and Goodier, table for rectangles."""
    assert torsion_constant(a, b) == pytest.approx(factor * a * b**3, rel=2e-3)  # the table has three digits
    assert torsion_constant(b, a) == torsion_constant(a, b)


def test_princeton_torsion_constant():
    """J of the Princeton beam, from an independent evaluation of the series."""
    assert torsion_constant(0.0123777, 0.0032024) == pytest.approx(1.134071924828e-10, rel=1e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"diameter": -0.004}, "diameter: must be greater than 0"),
        ({"diameter": float("nan")}, "diameter: must be a finite number"),
        ({"youngs_modulus": 0.0}, "youngs_modulus: must be greater than 0"),
        ({"poisson_ratio": 0.6}, "poisson_ratio must be above -1 and at most 0.5"),
        ({"poisson_ratio": -1.0}, "poisson_ratio must be above -1"),
        ({"shear_modulus": 1e9, "poisson_ratio": 0.3}, "not both"),
        ({"density": -1.0}, "density: must be at least 0"),
        ({"shear_factor": 1.5}, "shear_factor must be at most 1"),
        ({"diameter": "4 mm"}, "diameter: must be a"),
    ],
)
def test_bad_round(change, message):
    given = {"diameter": 0.004, "youngs_modulus": 1e9} | change
    with pytest.raises(ValueError, match=message):
        cf.Section.round(given.pop("diameter"), **given)


def test_bad_general():
    with pytest.raises(ValueError, match=r"give force_stiffness .* or one coupled"):
        cf.Section()
    with pytest.raises(ValueError, match=r"EA: must be greater than 0 \(got 0.0\)"):
        cf.Section(force_stiffness=(1, 1, 0), moment_stiffness=(1, 1, 1))
    with pytest.raises(ValueError, match=r"moment_stiffness: must have shape \(3,\)"):
        cf.Section(force_stiffness=(1, 1, 1), moment_stiffness=(1, 1))
    with pytest.raises(ValueError, match="symmetric"):
        cf.Section(coupled=np.arange(36.0).reshape(6, 6))
    with pytest.raises(ValueError, match="positive definite"):
        cf.Section(coupled=np.eye(6) + 2 * (np.eye(6, k=1) + np.eye(6, k=-1)))
