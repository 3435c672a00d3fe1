"""An accuracy that is asked for is kept: the seed, the slack cable, the bend and the pendulum against their references.

The references share no code with the package; what each run chose is told.
"""

import numpy as np
import pytest

import cosserat_fem as cf

BEND = {"force_stiffness": (5e6, 5e6, 1e7), "moment_stiffness": (1e7 / 12, 1e7 / 12, 5e6 * 0.1406)}
CABLE = {"quarter": (0.13652423, 0, -0.18959280), "half": (0.3, 0, -0.35457193), "force": (0.217135148, 0, 1.0)}
ASKED = [1e-3, 1e-5]


def on_places(history, name, places):
    """Places of a rod at arc lengths, by its shape functions."""
    from cosserat_fem.accuracy.transfer import at_places

    model = history.model
    (rod,) = [r for r in model.rods if r.name == name]
    return at_places(history.final.r, model.space, rod, np.array(places))


@pytest.mark.parametrize("asked", ASKED)
def test_bend(references, say, asked):
    """The 45 degree bend: tip in parts of the length, clamp moment in parts of itself."""
    a = np.linspace(0, np.pi / 4, 100)
    rod = cf.Rod(
        "bend", cf.Section(**BEND), 100 * np.stack([1 - np.cos(a), np.sin(a), 0 * a], axis=-1), rest=(0, 0.01, 0),
        length=25 * np.pi, start_tangent=(0, 1, 0), end_tangent=(1, 1, 0), normal=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, 0, 600))])
    history = cf.solve_static(model, accuracy=asked)
    ref = references["A03_bend45"]["values"]["J=0.1406,k=1,P=600"]
    tip = np.linalg.norm(history.positions("bend")[0, -1] - ref["tip"]) / (25 * np.pi)
    wanted = np.array(ref["support_moment_n(0)xyz"])
    moment = np.abs(history.reaction("bend.start@ground")[0, 3:] - wanted).max() / np.abs(wanted).max()
    say(f"tip {tip:.1e}, moment {moment:.1e}; {history.chosen}")
    assert max(tip, moment) < asked
    assert history.chosen.estimate <= asked


@pytest.mark.parametrize("asked", ASKED)
def test_slack_cable(say, asked):
    """The slack cable: a quarter and the middle in parts of the length, the end force in parts of each component."""
    section = cf.Section(
        force_stiffness=(4e4, 4e4, 1e5), moment_stiffness=(1e-2, 1e-2, 0.8e-2), mass_per_length=2 / 9.81
    )
    s = np.linspace(0, 1, 21)
    rod = cf.Rod(
        "cable", section, np.stack([0.6 * s, 0 * s, -0.33 * np.sin(np.pi * s) ** 2], axis=-1), length=1.0,
        start_tangent=(1, 0, 0), end_tangent=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -9.81))])
    history = cf.solve_static(model, accuracy=asked)
    apart = on_places(history, "cable", [0.25, 0.5]) - np.array([CABLE["quarter"], CABLE["half"]])
    force = np.abs(history.reaction("cable.start@ground")[0, :3])
    errors = np.linalg.norm(apart, axis=1).max(), np.abs(force - CABLE["force"])[[0, 2]].max() / 0.217
    say(f"places {errors[0]:.1e}, force {errors[1]:.1e}; {history.chosen}")
    assert max(errors) < asked


@pytest.mark.parametrize("asked", ASKED)
def test_deployment(references, say, asked):
    """The seed: every component at every degree in parts of its peak; the elements of the scene play no part."""
    scene = cf.load_scene(None)
    history = cf.solve_quasistatic(scene.model, scene.times, accuracy=asked)
    reference = np.array(references["B03_deployment"]["history"])[:, 1:]
    a, b = history.reaction("fixed end"), history.reaction("moving end")
    found = np.stack([a[:, 0], a[:, 1], np.linalg.norm(a[:, :3], axis=1), a[:, 5], b[:, 5]], axis=1)
    errors = np.abs(found - reference).max(axis=0) / np.abs(reference).max(axis=0)
    say(f"{errors.max():.1e}; {history.chosen}, {history.chosen.iterations} iterations in all")
    assert errors.max() < asked
    assert history.model is not scene.model
    assert history.model.rods == scene.model.rods
    ends = history.model.space[history.model.rods[0]].mesh.ends
    assert np.diff(ends).max() > 5 * np.diff(ends).min()  # finer in the layers at the clamps


@pytest.mark.parametrize("asked", [1e-3, pytest.param(1e-5, marks=pytest.mark.slow)])
def test_pendulum(references, say, asked):
    """The rubber pendulum: root mean square of the tip over 1 s, in parts of the length."""
    section = cf.Section.round(0.01, youngs_modulus=5e6, shear_modulus=5e6 / 3, density=1100.0, shear_factor=1.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)])
    model = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, -9.81, 0))])
    history = cf.solve_dynamic(model, 1.0, start="drawn", times=np.linspace(0, 1, 21), accuracy=asked)
    apart = history.positions("rod")[:, -1, :2] - np.array(references["D2_tip"])
    error = np.sqrt((apart**2).sum(-1).mean())
    say(f"{error:.1e}; {history.chosen}, {history.chosen.travels} runs")
    assert error < asked
