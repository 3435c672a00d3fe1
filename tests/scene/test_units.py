"""Unit strings."""

import math

import pytest

from cosserat_fem.scene.units import parse


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("3.94 mm", "length", 3.94e-3),
        ("1 in", "length", 0.0254),
        ("90 deg", "angle", math.pi / 2),
        ("1 deg/s", "angular rate", math.pi / 180),
        ("6 rev/min", "angular rate", 0.2 * math.pi),
        ("9.81 m/s^2", "acceleration", 9.81),
        ("9.81 m/s2", "acceleration", 9.81),
        ("0.02 N*m^2", "bending stiffness", 0.02),
        ("0.02 N m^2", "bending stiffness", 0.02),
        ("0.2 N mm", "moment", 2e-4),
        ("1500 kg/m^3", "density", 1500.0),
        ("1.5 g/cm**3", "density", 1500.0),
        ("70 GPa", "pressure", 70e9),
        ("20 g/m", "mass per length", 0.02),
        ("2 1/m", "curvature", 2.0),
        ("-1.5e-3 m", "length", -1.5e-3),
        ("1 kg m/s^2", "force", 1.0),
        (5, "length", 5.0),
        ("0.5", "number", 0.5),
        (0.5, "number", 0.5),
    ],
)
def test_parse(text, kind, value):
    assert parse(text, kind) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("4 kg", "length", 'is not a length; write for example "4 mm"'),
        ("1 deg", "angular rate", "is not an angular rate"),
        ("4 foo", "length", "unknown unit 'foo'"),
        ("mm", "length", "is not a number with a unit"),
        ("", "length", "is not a number with a unit"),
        ("5", "length", 'has no unit; write for example "4 mm", or a plain number in SI units'),
        ("0 ", "time", "has no unit"),
        ("90", "angle", "has no unit"),
        ("4 m m^", "length", "cannot be read"),
        ("1e999 m", "length", "must be finite"),
        (float("nan"), "length", "must be finite"),
        (True, "length", "must be a number or a string"),
        ([1], "length", "must be a number or a string"),
    ],
)
def test_refused(text, kind, message):
    with pytest.raises(ValueError, match=message):
        parse(text, kind)
