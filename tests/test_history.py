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


@pytest.fixture(scope="module")
def pressed():
    """A bar held at both ends; an arm on a hinge carries a post into it and away again, with friction."""
    section = cf.Section.round(0.004, youngs_modulus=50e6, poisson_ratio=0.4)
    rod = cf.Rod("bar", section, [(0, 0, 0), (0.2, 0, 0)], n_elements=12)
    angle = ([0, 4, 8], np.radians([0.0, -7.0, 0.0]))
    post = cf.Cylinder((0.1, 0.012, -0.05), (0.1, 0.012, 0.05), 0.008)
    arm = cf.Part("arm", motion=cf.Hinge((0.03, 0.08, 0), (0, 0, 2), angle), shape=post)
    idle = cf.Part("idle", shape=cf.Sphere((0.1, -0.3, 0), 0.01))
    terms = [cf.PartContact(rod, arm, friction=0.3), cf.PartContact(rod, idle)]
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", free=["x"])], terms)
    return cf.solve_quasistatic(model, np.arange(9.0))


def test_contact_is_in_balance(pressed):
    """Nodes, supports and part: forces and moments about the origin add up to nothing; nothing touches the idle part."""
    nodal = pressed.contact_force("bar")
    r = pressed.positions("bar")
    force = nodal[..., :3].sum(1)
    moment = (np.cross(r, nodal[..., :3]) + nodal[..., 3:]).sum(1)
    load = pressed.contact_load("arm")
    assert np.abs(force).max() > 0.05
    np.testing.assert_allclose(force, -load[:, :3], atol=1e-12)
    origin = np.array([pressed.part("arm").pose(t)[1] for t in pressed.t])
    np.testing.assert_allclose(moment, -(load[:, 3:] + np.cross(origin, load[:, :3])), atol=1e-13)
    for support in pressed.model.supports:
        held = pressed.reaction(support)
        force = force + held[:, :3]
        moment = moment + np.cross(pressed.support_place(support), held[:, :3]) + held[:, 3:]
    np.testing.assert_allclose(force, 0, atol=1e-7)
    np.testing.assert_allclose(moment, 0, atol=1e-8)
    assert not pressed.contact_load("idle").any()
    share = pressed.model.space.share(pressed.rod("bar"))
    np.testing.assert_allclose(pressed.line_force("bar") * share[:, None], nodal[..., :3], atol=1e-15)


def test_drive_of_a_hinge_pays_for_contact(pressed):
    """The drive's torque is the moment of what the part does to the rod about the axis, in the sense of a reaction; out and
    back it does the work that friction takes, and what the bar stores between."""
    nodal, r = pressed.contact_force("bar"), pressed.positions("bar")
    arm = r - np.array((0.03, 0.08, 0))
    expected = (np.cross(arm, nodal[..., :3]) + nodal[..., 3:]).sum(1)[:, 2]
    torque = pressed.contact_torque("arm")
    np.testing.assert_allclose(torque, expected, atol=1e-13)
    np.testing.assert_array_equal(pressed.hinge_torque("arm"), torque)
    np.testing.assert_array_equal(pressed.contact_torque("arm", "bar-arm"), torque)
    assert torque.min() < -1e-4  # it must push the post into the bar, against the sense of the axis
    with pytest.raises(ValueError, match="contact_torque: part 'idle' has no hinge"):
        pressed.contact_torque("idle")


def test_drive_works_for_friction_and_strain(pressed):
    """Torque over the angle is energy of the bar and work of friction, with stations close enough."""
    fine = cf.solve_quasistatic(pressed.model, np.linspace(0, 8, 161))
    torque, angle = fine.hinge_torque("arm"), fine.hinge_angle("arm")
    work = np.concatenate([[0], np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle))])
    given = fine.energy + fine.friction_work("bar-arm")
    np.testing.assert_allclose(work, given, atol=0.03 * given.max())
    assert fine.friction_work("bar-arm")[-1] > 0.02 * given.max()
    assert (np.diff(fine.friction_work("bar-arm")) >= 0).all()


def test_events(pressed):
    """One stretch of time in which the post touches, with its peak; none of the idle part."""
    [event] = pressed.contacts()
    told = pressed.pressed("bar-arm")
    touching = np.flatnonzero([len(p.spans) > 0 for p in told])
    assert (event.name, event.rod, event.other) == ("bar-arm", "bar", "arm")
    assert (event.begin, event.end) == (pressed.t[touching[0]], pressed.t[touching[-1]])
    assert touching[0] > 0 and touching[-1] < 8 and len(touching) == touching[-1] - touching[0] + 1
    assert event.peak == max(p.peak for p in told)
    assert event.peak_t == pressed.t[np.argmax([p.peak for p in told])]
    assert event.s0 <= event.peak_s <= event.s1
    assert event.lost == pytest.approx(pressed.friction_work("bar-arm")[-1])
    assert abs(event.gap) < 1e-3 * 0.002
    with pytest.raises(ValueError, match="no contact named 'bar-am'. Did you mean 'bar-arm'"):
        pressed.friction_work("bar-am")


def test_clearance_agrees_with_contact(pressed):
    """Where the post touches, the surfaces are apart by no more than the stand-off; away from it they agree too."""
    distance = cf.clearance(pressed, "bar", "arm")
    told = pressed.pressed("bar-arm")
    for d, p in zip(distance, told, strict=True):
        if np.isfinite(p.gap):
            assert d == pytest.approx(p.gap, abs=1e-3 * 0.002)
    assert distance.min() > -1e-3 * 0.002


def test_history_without_contact(bent):
    assert bent.contacts() == []
    assert not bent.contact_force("bar").any()
    assert not bent.contact_load("ground").any()
