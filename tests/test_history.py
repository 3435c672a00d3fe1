"""What can be asked of a history, against closed forms."""

import numpy as np
import pytest

import cosserat_fem as cf


@pytest.fixture(scope="module")
def bent():
    """Cantilever with a tip moment: an arc of radius 2, constant moment, no force."""
    section = cf.Section(force_stiffness=(400.0, 400.0, 1000.0), moment_stiffness=(1.0, 2.0, 0.8))
    rod = cf.Rod("bar", section, [(0, 0, 0), (1, 0, 0)], n_elements=4, order=3, normal=(0, 0, 1))
    model = cf.Model(
        [rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", moment=([0, 1], [(0, 0, 0), (0, 0, 0.5)]))]
    )
    return cf.solve_quasistatic(model, [0.0, 0.5, 1.0])


def test_shapes(bent):
    rod = bent.model.rods[0]
    assert repr(bent) == "<History: 3 states, t = 0 .. 1 s, converged>"
    assert bent.positions("bar").shape == (3, 13, 3)
    assert bent.directors(rod).shape == (3, 13, 3, 3)
    assert bent.strains(rod).shape == (3, 12, 6)
    assert bent.reaction("bar.start@ground").shape == (3, 6)
    np.testing.assert_allclose(bent.t, [0, 0.5, 1])
    assert bent.final.t == 1.0


def test_bending_about_d1(bent):
    """Moment about z = d1: curvature M / EI1 there and nothing else; energy M^2 L / 2 EI; forces in both frames."""
    strain = bent.strains("bar")[-1]
    np.testing.assert_allclose(strain, np.tile((0, 0, 0, 0.5, 0, 0), (12, 1)), atol=1e-6)
    np.testing.assert_allclose(bent.section_forces("bar")[-1], np.tile((0, 0, 0, 0.5, 0, 0), (12, 1)), atol=1e-6)
    spatial = bent.section_forces("bar", "spatial")[-1]
    np.testing.assert_allclose(spatial, np.tile((0, 0, 0, 0, 0, 0.5), (12, 1)), atol=1e-6)
    np.testing.assert_allclose(bent.energy, [0, 0.25**2 / 2, 0.5**2 / 2], atol=1e-9)
    np.testing.assert_allclose(bent.reaction("bar.start@ground")[-1], (0, 0, 0, 0, 0, -0.5), atol=1e-9)


def test_bend_radius(bent):
    """Radius EI / M = 2, infinite before the load; at the stations and at the nodes."""
    for at, n in (("stations", 12), ("nodes", 13)):
        radius = cf.bend_radius(bent, "bar", at=at)
        assert radius.shape == (3, n)
        assert np.isinf(radius[0]).all()
        np.testing.assert_allclose(radius[-1], 2.0, rtol=1e-5)
    with pytest.raises(ValueError, match="at must be 'stations' or 'nodes'"):
        cf.bend_radius(bent, "bar", at="ends")


def test_values_at_nodes_are_the_polynomial(bent):
    """A field that is a polynomial of degree below the order comes to the nodes exactly."""
    s = bent.stations("bar")
    nodes = bent.nodes("bar")
    values = np.stack([1 + s - 3 * s**2, s], axis=-1)[None]
    np.testing.assert_allclose(
        bent.at_nodes("bar", values)[0], np.stack([1 + nodes - 3 * nodes**2, nodes], -1), atol=1e-13
    )


def test_distance_from_drawing(bent):
    """The tip of a quarter-radian arc of radius 2 and length 1 lies 2 (1 - cos 1/2) beside the drawn line."""
    d = cf.distance_from_drawing(bent, "bar")
    np.testing.assert_allclose(d[0], 0, atol=1e-12)
    assert d[-1, -1] == pytest.approx(2 * (1 - np.cos(0.5)), rel=1e-6)


def test_names_and_objects(bent):
    with pytest.raises(ValueError, match="no rod named 'baar'. Did you mean 'bar'"):
        bent.positions("baar")
    with pytest.raises(ValueError, match="no support named 'x'"):
        bent.reaction("x")
    with pytest.raises(ValueError, match="this rod is not part of the model"):
        bent.positions(cf.Rod("other", bent.model.rods[0].section, [(0, 0, 0), (1, 0, 0)]))
    with pytest.raises(ValueError, match="frame must be 'material' or 'spatial'"):
        bent.section_forces("bar", "body")
    with pytest.raises(ValueError, match="part 'ground' has no hinge"):
        bent.hinge_torque("ground")


def test_hinge_torque_is_what_the_drive_supplies():
    """A rigid-like bar on an arm, pulled by a dead force: torque = -z . (r x F), from supports on one part only."""
    section = cf.Section.round(0.02, youngs_modulus=200e9)
    rod = cf.Rod("bar", section, [(0.2, 0, 0), (1.2, 0, 0)], n_elements=2, order=2)
    arm = cf.Part("arm", motion=cf.Hinge((0, 0, 0), (0, 0, 1), np.radians(30)))
    model = cf.Model([rod], [cf.Clamp(rod, "start", to=arm)], [cf.PointLoad(rod, "end", force=(0, -10, 0))])
    history = cf.solve_quasistatic(model, [0.0, 1.0, 2.0])
    tip = history.positions(rod)[:, -1]
    np.testing.assert_allclose(history.hinge_torque(arm), 10 * tip[:, 0], rtol=1e-8)
    np.testing.assert_allclose(history.hinge_angle("arm"), np.radians([0, 30, 60]))


def test_empty_history():
    section = cf.Section.round(0.02, youngs_modulus=200e9)
    rod = cf.Rod("bar", section, [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(ValueError, match="holds no state"):
        _ = cf.History(cf.Model([rod])).final
