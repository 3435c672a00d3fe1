"""Curves: Frenet geometry of a helix, straight pieces, rebuilding, smooth curves through points (SEED demands S1-S3)."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.curve import SmoothCurve

K, TAU = 1.3, 0.7  # curvature and torsion of the helix
W = np.hypot(K, TAU)


def helix(s, derivative=0):
    """Helix of curvature K and torsion TAU, or a derivative with respect to arc length."""
    a, b = K / W**2, TAU / W
    angle = W * s + derivative * np.pi / 2
    f = a * W**derivative
    z = {0: b * s, 1: np.full_like(s, b)}.get(derivative, np.zeros_like(s))
    return np.stack([f * np.cos(angle), f * np.sin(angle), z], axis=-1)


def test_helix_constants():
    """Curvature and torsion of a helix, from derivatives with respect to another parameter, to 1e-10."""
    u = np.linspace(0, 2, 50)  # s = u + u^2 / 2
    s, v, c = u + u**2 / 2, 1 + u, np.ones_like(u)
    d1 = helix(s, 1) * v[:, None]
    d2 = helix(s, 2) * (v**2)[:, None] + helix(s, 1) * c[:, None]
    d3 = helix(s, 3) * (v**3)[:, None] + 3 * helix(s, 2) * (v * c)[:, None]
    g = cf.curve_geometry(s, helix(s), d1, d2, d3)
    np.testing.assert_allclose(g.curvature, K, rtol=1e-10)
    np.testing.assert_allclose(g.torsion, TAU, rtol=1e-10)
    np.testing.assert_allclose(g.tangent, helix(s, 1), atol=1e-12)
    np.testing.assert_allclose(g.normal, helix(s, 2) / K, atol=1e-12)
    np.testing.assert_allclose(g.binormal, np.cross(g.tangent, g.normal), atol=1e-12)


def test_rebuilt_helix_meets_the_curve():
    s = np.linspace(0, 6, 40)
    frame = np.column_stack(
        [helix(s[:1], 1)[0], helix(s[:1], 2)[0] / K, np.cross(helix(s[:1], 1)[0], helix(s[:1], 2)[0] / K)]
    )
    r = cf.rebuild_curve(s, lambda x: K, lambda x: TAU, start=helix(s[:1])[0], frame=frame)
    np.testing.assert_allclose(r, helix(s), atol=1e-10)


def test_rebuilt_clothoid_meets_the_curve():
    """Curvature growing with s: Fresnel integrals."""
    from scipy.special import fresnel

    s = np.linspace(0, 3, 20)
    r = cf.rebuild_curve(s, lambda x: np.pi * x, lambda x: 0.0)
    y, x = fresnel(s)
    np.testing.assert_allclose(r[:, :2], np.stack([x, y], axis=-1), atol=1e-10)


def test_straight_pieces_and_inflections_give_no_nan():
    """Where the curvature vanishes, the normal falls back to a normal, the torsion to 0."""
    u = np.linspace(-1, 1, 21)
    o = np.zeros_like(u)
    for y, dy, ddy in ((u**3, 3 * u**2, 6 * u), (o, o, o)):  # inflection at 0; a straight line
        third = 6.0 + o if y is not o else o
        g = cf.curve_geometry(
            u, *(np.stack(v, axis=-1) for v in ((u, y, o), (1 + o, dy, o), (o, ddy, o), (o, third, o)))
        )
        for values in (g.tangent, g.normal, g.binormal, g.curvature, g.torsion):
            assert np.isfinite(values).all()
        np.testing.assert_allclose((g.tangent * g.normal).sum(-1), 0, atol=1e-12)
    assert (g.curvature == 0).all()


def helical_rod(n_elements, order):
    """A rectangular rod whose stress-free shape is a helix with its section turned against Frenet; held at one end."""
    rate = 0.4  # d(angle)/ds of the section against the Frenet normal
    section = cf.Section.rectangle(0.02, 0.005, youngs_modulus=1e9)

    def rest(s):
        a = 0.3 + rate * s
        return (K * np.sin(a), K * np.cos(a), TAU + rate)

    rod = cf.Rod("r", section, [(0, 0, 0), (0, 0, 2)], n_elements=n_elements, order=order, rest=rest)
    return rod, rate


def test_rod_geometry_on_a_helix():
    """Both frames of a relaxed helical strip: curvature, torsion, section angle, omega = Frenet part + d(angle)/ds."""
    rod, rate = helical_rod(20, 5)
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")]))
    g = history.curve(rod)
    np.testing.assert_allclose(g.curvature, K, rtol=1e-8)
    np.testing.assert_allclose(g.torsion, TAU, rtol=1e-6)
    angle = g.section_angle - g.section_angle[0] + 0.3 + rate * g.s[0]
    np.testing.assert_allclose(abs(angle), 0.3 + rate * g.s, atol=1e-7)
    expected = np.stack([K * np.sin(angle), K * np.cos(angle), TAU + rate + 0 * angle], axis=-1)
    np.testing.assert_allclose(g.bending_twist, expected, atol=1e-6)
    np.testing.assert_allclose(g.bending_twist[:, 2] - g.torsion, np.gradient(angle, g.s), atol=1e-4)


def test_section_angle_and_omega_signs():
    """omega of the principal-axis frame is (k sin a, k cos a, tau + a') with a measured from N to d1 about T."""
    rod, _ = helical_rod(12, 4)
    g = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")])).curve(rod)
    d1 = np.cos(g.section_angle)[:, None] * g.normal + np.sin(g.section_angle)[:, None] * g.binormal
    np.testing.assert_allclose(g.directors[..., 0], d1, atol=1e-8)
    np.testing.assert_allclose(g.bending_twist[:, 0], g.curvature * np.sin(g.section_angle), atol=1e-6)
    np.testing.assert_allclose(g.bending_twist[:, 1], g.curvature * np.cos(g.section_angle), atol=1e-6)


def test_smooth_curve_meets_points_and_measures_itself():
    """Through its points, tangents of length 1, arc length right; a circle to the accuracy of a cubic spline."""
    a = np.linspace(0, np.pi, 41)
    points = 2.0 * np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    curve = SmoothCurve(points, (0, 1, 0), (0, -1, 0))
    assert curve.length == pytest.approx(2 * np.pi, rel=1e-6)
    s = np.linspace(0, curve.length, 500)
    r = curve.position(s)
    np.testing.assert_allclose(np.linalg.norm(r, axis=1), 2.0, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(r, axis=0), axis=1), s[1] - s[0], rtol=1e-5)
    np.testing.assert_allclose(curve.tangent(s)[[0, -1]], [(0, 1, 0), (0, -1, 0)], atol=1e-12)
    np.testing.assert_allclose(curve.position(curve.length * a / np.pi), points, atol=2e-6)


def test_end_normal_twists_evenly():
    """A drawn twist is spread over the length; without one, a planar curve carries its normal unturned."""
    curve = SmoothCurve(np.array([(0, 0, 0), (1, 0, 0), (2, 0.5, 0)]))
    s = np.linspace(0, curve.length, 9)
    plain = curve.frames(s, normal=(0, 0, 1))
    np.testing.assert_allclose(plain[:, :, 0], np.tile((0, 0, 1.0), (9, 1)), atol=1e-12)
    d3 = curve.tangent(s)[-1]
    twisted = curve.frames(s, normal=(0, 0, 1), end_normal=np.cross(d3, (0, 0, 1)))
    angle = np.arccos(np.clip(twisted[:, 2, 0], -1, 1))
    np.testing.assert_allclose(angle, np.pi / 2 * s / s[-1], atol=1e-7)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0, 0)], "points: must be at least two"),
        ([(0, 0, 0), (0, 0, 0), (1, 0, 0)], "points: 0 and 1 coincide"),
        ([(0, 0), (1, 0)], r"must have shape \(any, 3\)"),
        ([(0, 0, 0), (np.nan, 0, 0)], "must be finite"),
        ([], "must have shape"),
        ("abc", "must be numbers"),
    ],
)
def test_bad_points(points, message):
    with pytest.raises(ValueError, match=message):
        SmoothCurve(points)


def test_points_beyond_numbers_are_refused():
    """Squares of their distances are not finite."""
    with pytest.raises(ValueError, match=r"rod: points: \(0, 1e\+308, 0\) is further away than 1e\+100 m"):
        SmoothCurve([(0, 0, 0), (0, 1e308, 0)], name="rod")
