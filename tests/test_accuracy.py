"""Estimates, other elements, an accuracy asked for: what they promise and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.accuracy.drift import gyroscopic
from cosserat_fem.accuracy.estimate import InTime, Richer, raised
from cosserat_fem.accuracy.transfer import Transfer, at_places, lagrange
from cosserat_fem.iteration.newton import Newton


def hanging(n_elements=4, order=2, **options):
    section = cf.Section(force_stiffness=(4e3, 4e3, 1e4), moment_stiffness=(1e-2,) * 3, mass_per_length=0.2)
    s = np.linspace(0, 1, 9)
    points = np.stack([0.7 * s, 0.1 * s**2, -0.3 * np.sin(np.pi * s)], axis=-1)
    rod = cf.Rod("cable", section, points, n_elements=n_elements, order=order)
    return cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -9.81))], **options)


def pendulum(n_elements=6, order=3):
    section = cf.Section.round(0.01, youngs_modulus=5e6, shear_modulus=5e6 / 3, density=1100.0, shear_factor=1.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=n_elements, order=order)
    return cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, -9.81, 0))])


def test_interpolation_is_exact_for_polynomials(rng):
    points, x = np.sort(rng.random(5)), np.append(rng.random(7), 0.3)
    points[2] = 0.3  # at a point too
    for power in range(5):
        np.testing.assert_allclose(lagrange(points, x) @ points**power, x**power, atol=1e-12)


@pytest.mark.parametrize("rotation", ["quaternion", "kardan"])
def test_a_state_on_richer_elements_is_the_same_curve(rotation):
    """Places are the same to round-off, stresses are the polynomials through the old ones."""
    history = cf.solve_static(hanging(rotation=rotation))
    model, fine = history.model, raised(history.model, 2)
    rod, s = model.rods[0], np.linspace(0, model.rods[0].length, 50)
    moved = Transfer(model, fine).state(history.final)
    np.testing.assert_allclose(
        at_places(moved.r, fine.space, rod, s), at_places(history.final.r, model.space, rod, s), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.norm(moved.q, axis=1), 1.0, atol=1e-14)
    assert [a.shape for a in moved.stress] == [a.shape for a in fine.initial_state().stress]


def test_other_elements_keep_everything_else():
    """Rods, supports and terms are the same objects, answers go by the same names, marks must be met."""
    model = hanging()
    rod = model.rods[0]
    ends = rod.length * np.array([0, 0.05, 0.2, 0.6, 0.9, 1.0])
    other = model.with_elements({rod: cf.Elements(4, ends)})
    history = cf.solve_static(other)
    assert other.rods == model.rods and other.supports == model.supports and other.warnings is model.warnings
    np.testing.assert_allclose(history.nodes("cable")[::4], ends)
    assert history.reaction(model.supports[0]).shape == (1, 6)
    for wrong, told in (
        ([0, 0.5], "must run from 0"),
        ([0, 0.5, 0.4, rod.length], "increasing"),
    ):
        with pytest.raises(ValueError, match=told):
            model.with_elements({rod: cf.Elements(2, wrong)})
    load = cf.PointLoad(rod, 0.3, force=(0, 0, -1))
    loaded = cf.Model([rod], model.supports, [load])
    with pytest.raises(ValueError, match="none ends at s = 0.3 m"):
        loaded.with_elements({rod: cf.Elements(2, ends)})


def test_richer_states_cost_little_and_failures_are_told():
    history = cf.solve_static(hanging(8, 3))
    richer = Richer(history)
    assert richer.station(0) is not None and richer.newton.counters.iterations <= 4
    lost = replace(history, records=[replace(history.records[0])])
    bad = replace(lost.records[0].state, r=np.full_like(lost.records[0].state.r, np.nan))
    lost.records[0] = replace(lost.records[0], state=bad)
    nothing = Richer(lost)
    assert nothing.station(0) is None and "finite" in nothing.failed[0]


def test_gyroscopic_matrix(rng):
    """Derivative of J (a - w x u) + w x J w along an error u of the velocity."""
    J, w, u = rng.random((4, 3)), rng.normal(size=(4, 3)), rng.normal(size=(4, 3))

    def moment(eps):
        v = w + eps * u
        return -J * np.cross(w, eps * u) + np.cross(v, J * v)

    change = (moment(1e-6) - moment(-1e-6)) / 2e-6
    np.testing.assert_allclose(np.einsum("nij,nj->ni", gyroscopic(J, w), u), change, atol=1e-8)


def distance(history, other):
    return np.linalg.norm(history.positions("rod")[:, -1] - other.positions("rod")[:, -1], axis=1)


def test_errors_in_time_of_a_pendulum():
    """Elements and steps told apart: each within 0.3 and 10 of what runs that differ in just that one show."""
    times = np.linspace(0, 0.5, 101)

    def run(n, order, step):
        return cf.solve_dynamic(pendulum(n, order), 0.5, start="drawn", step=step, times=times)

    history = run(10, 1, cf.FixedStep(0.005))
    moving = InTime(history, range(20, 101))
    finest = run(12, 4, cf.FixedStep(0.005))
    short = run(10, 1, cf.FixedStep(0.001, richardson=True))
    for of, true in (("spatial", distance(history, finest)), ("temporal", distance(history, short))):
        found = getattr(moving, of)
        model = moving.model if of == "spatial" else history.model
        states = cf.History(model, [found[k] for k in range(20, 101)])
        estimated = np.sqrt((distance(cf.History(history.model, history.records[20:]), states) ** 2).mean())
        true = np.sqrt((true[20:] ** 2).mean())
        assert 0.3 < estimated / true < 10, (of, estimated, true)


def test_rigid_turning_in_space_has_no_error_of_elements():
    """A free rod that spins about its axis and flies has nothing left over on richer elements, however it turns."""
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(500,) * 3, mass_per_length=1.0, rotary_inertia=(1, 1, 2)
    )
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=3, order=2)
    model = cf.Model([rod])
    history = cf.solve_dynamic(
        model, 1.0, start="drawn", velocity=cf.RigidVelocity(v=(1, 2, 0), omega=(8, 0, 0)), step=cf.FixedStep(0.02),
        times=np.linspace(0, 1, 11),
    )  # fmt: skip
    moving = InTime(history, [10])
    assert distance(moving.without_elements(10), cf.History(model, history.records[10:])).max() < 1e-9
    assert distance(moving.without_steps(10), cf.History(model, history.records[10:])).max() < 1e-3


def test_every_peak_of_a_motion_has_an_error():
    """Also of a held motion whose error would grow: what is not finite is told as None."""
    from cosserat_fem.accuracy.estimate import add_errors
    from cosserat_fem.summary import describe

    history = cf.solve_dynamic(
        pendulum(3, 2), 0.1, start="drawn", step=cf.FixedStep(0.01), times=np.linspace(0, 0.1, 11)
    )
    said = describe(history)
    told = add_errors(said, history, describe)
    force = said["reactions"]["rod.start@ground"]["largest_force"]
    assert force["error"] == force["error_elements"] + force["error_steps"] > 0
    assert told["carried_along"] == 11
    history.records[5] = replace(
        history.records[5], rates=replace(history.records[5].rates, a=np.full_like(history.records[5].rates.a, np.nan))
    )
    said = describe(history)
    add_errors(said, history, describe)
    force = said["reactions"]["rod.start@ground"]["largest_force"]
    assert force["t"] > 0.05 and force["error_elements"] is None


def test_accuracy_of_several_rods_in_a_frame():
    """Welded rods get elements of their own; supports answer by name."""
    section = cf.Section.rectangle(0.02, 0.01, youngs_modulus=1e8, poisson_ratio=0.3)
    feet = [(0, 0, 0), (1, 0.2, 0), (0.3, 1, 0.1)]
    rods = [
        cf.Rod(name, section, [foot, (0.4, 0.3, 0.8)], n_elements=n, order=1, normal=(0.3, 0.1, -0.9))
        for name, foot, n in zip("abc", feet, (1, 2, 3), strict=True)
    ]
    supports = [*(cf.Clamp(rod, "start") for rod in rods), *(cf.Weld(rods[0], "end", rod, "end") for rod in rods[1:])]
    model = cf.Model(rods, supports, [cf.PointLoad(rods[0], "end", force=(3, 2, -4))])
    loose, tight = (cf.solve_static(model, accuracy=a) for a in (1e-2, 1e-7))
    for rod in rods:
        a, b = (h.reaction(f"{rod.name}.start@ground")[0] for h in (loose, tight))
        assert np.abs(a - b)[:3].max() < 1e-2 * np.abs(b[:3]).max()
        assert np.abs(a - b)[3:].max() < 1e-2 * np.abs(b[3:]).max()
    assert set(tight.chosen.elements) == {"a", "b", "c"}
    assert "1e-07 asked" in tight.message


def test_accuracy_with_contact_travels_every_mesh():
    """A cable pressed on a peg: the force is that of a far finer mesh."""
    section = cf.Section.round(0.004, youngs_modulus=2e7, poisson_ratio=0.4)
    rod = cf.Rod("cable", section, [(-0.1, 0, 0), (0.1, 0, 0)], n_elements=12, order=3)
    peg = cf.Part("peg", shape=cf.Cylinder((0, -0.1, -0.0121), (0, 0.1, -0.0121), 0.01))
    ends = cf.Part("ends", motion=cf.Slider((0, 0, -1), ([0, 1], [0, 0.01])))
    supports = [cf.Clamp(rod, place, to=ends) for place in ("start", "end")]
    model = cf.Model([rod], supports, [cf.PartContact(rod, peg)])
    history = cf.solve_quasistatic(model, [0.0, 0.5, 1.0], accuracy=1e-3)
    fine = model.with_elements({rod: cf.Elements(3, np.linspace(0, rod.length, 81))})
    reference = cf.solve_quasistatic(fine, [0.0, 0.5, 1.0])
    found, wanted = (h.reaction("cable.start@ends")[-1] for h in (history, reference))
    assert np.abs(found - wanted)[:3].max() < 5e-3 * np.abs(wanted[:3]).max()


def test_what_cannot_be_asked():
    model = hanging()
    for accuracy in (0.0, -1.0, 1.0, 1e-12, np.nan):
        with pytest.raises(ValueError, match="accuracy"):
            cf.solve_static(model, accuracy=accuracy)
    with pytest.raises(ValueError, match="accuracy chooses the steps"):
        cf.solve_dynamic(pendulum(), 1.0, accuracy=1e-2, step=cf.FixedStep(0.1))
    rod = pendulum().rods[0]
    floor = cf.Part("floor", shape=cf.Plane((0, -2, 0), (0, 1, 0)))
    touching = cf.Model([rod], [cf.Pin(rod, "start")], [cf.PartContact(rod, floor)])
    with pytest.raises(cf.SceneError, match="with contact cannot be asked"):
        cf.solve_dynamic(touching, 1.0, start="drawn", accuracy=1e-2)


def test_an_accuracy_that_is_not_reached_is_told(monkeypatch):
    from cosserat_fem.accuracy import refine

    monkeypatch.setattr(refine, "ROUNDS", 1)
    monkeypatch.setattr(refine, "FASTEST", 1.1)
    model = hanging()
    history = cf.solve_static(model, accuracy=1e-8)
    assert history.chosen.estimate > 1e-8
    assert any("was not reached" in warning for warning in model.warnings)


def test_cpu_time_of_terms():
    model = hanging()
    Newton(model, compiled=False).plain(model.initial_state())
    assert set(model.spent) == {"gravity", "internal force", "linear systems"}
    assert all(seconds >= 0 for seconds in model.spent.values())
    moving = pendulum()
    cf.solve_dynamic(moving, 0.05, start="drawn", step=cf.FixedStep(0.01))
    assert moving.spent["compiled solves"] > 0
