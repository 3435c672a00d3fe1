"""Curves laid over each other, and stiffnesses that measurements give back."""

import json
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem import overlay
from cosserat_fem.cli import main
from cosserat_fem.fit import fit

SCENE = """
title = "Cable across a door"

[[section]]
name = "loom"
kind = "round"
diameter = "8 mm"
youngs_modulus = "8 MPa"
density = 1500

[[rod]]
name = "cable"
section = "loom"
points = [[0, 0, 0], [100, 60, 0], [200, 0, 0]]
unit = "mm"
n_elements = 3

[[part]]
name = "door"
motion = { kind = "hinge", point = ["100 mm", 0, 0], axis = [0, 0, 1], angle = "1 deg/s" }

[[support]]
kind = "clamp"
name = "wall"
rod = "cable"
at = "start"

[[support]]
kind = "clamp"
name = "leaf"
rod = "cable"
at = "end"
to = "door"

[gravity]
acceleration = [0, "-9.81 m/s^2", 0]

[solve]
kind = "quasistatic"
duration = "40 s"
plane = "xy"

[output]
every = "8 s"
"""
ROUND = SCENE.split("[[section]]")[1].split("[[rod]]")[0]
E, AREA, SECOND = 8e6, np.pi * 0.008**2 / 4, np.pi * 0.008**4 / 64
EI = E * SECOND


def stiffer(text, factor):
    """The scene with another bending stiffness, and all else of the section as it is."""
    shear = 0.9 * E / 2.6 * AREA
    return text.replace(
        ROUND,
        f"""
name = "loom"
kind = "general"
force_stiffness = [{shear}, {shear}, {E * AREA}]
moment_stiffness = [{factor * EI}, {factor * EI}, {EI / 1.3}]
mass_per_length = {1500 * AREA}
radius = 0.004

""",
    )


TWISTED = """
[[section]]
name = "bar"
kind = "general"
force_stiffness = ["10 kN", "10 kN", "10 kN"]
moment_stiffness = [10, 10, 0.5]

[[rod]]
name = "bar"
section = "bar"
points = [[0, 0, 0], [1, 0, 0]]
n_elements = 2

[[part]]
name = "chuck"
motion = { kind = "hinge", axis = [1, 0, 0], angle = "1 deg/s" }

[[support]]
kind = "clamp"
rod = "bar"
at = "start"

[[support]]
kind = "clamp"
rod = "bar"
at = "end"
to = "chuck"

[solve]
kind = "quasistatic"
duration = "30 s"
travel = "both"

[output]
every = "10 s"
"""


def load(folder, text, name="scene.toml"):
    (folder / name).write_text(text)
    return cf.load_scene(folder / name)


def measured(**columns):
    return overlay.Measured(pathlib.Path("measured.csv"), {k: np.asarray(v, dtype=float) for k, v in columns.items()})


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Runs of a cable that is a quarter stiffer in bending than the scene says."""
    folder = tmp_path_factory.mktemp("truth")
    stiff = load(folder, stiffer(SCENE, 1.25))
    history = cf.solve_quasistatic(stiff.model, stiff.times)
    return load(folder, SCENE), history


def test_stiffness_comes_back_from_clean_data(truth):
    """Without noise the fit is the truth; what is left is the round-off of runs."""
    scene, history = truth
    found = fit(scene, measured(time=history.t, torque=history.hinge_torque("door")), ("EI",))
    [number] = found.numbers
    assert number.value == pytest.approx(1.25 * EI, rel=1e-6)
    assert number.before == pytest.approx(EI)
    assert found.rms["torque"] < 1e-6 * found.before["torque"]
    again = cf.solve_quasistatic(found.scene.model, found.scene.times)
    np.testing.assert_allclose(again.hinge_torque("door"), found.history.hinge_torque("door"), rtol=1e-6)


def test_intervals_cover_the_truth(truth):
    """Noise of 3 % of the peak, twelve times: 95 % intervals hold the truth at least nine times (fewer: 1 in 450)."""
    scene, history = truth
    torque = history.hinge_torque("door")
    inside, width = 0, []
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(0.0, 0.03 * abs(torque).max(), len(torque))
        [number] = fit(scene, measured(time=history.t, torque=torque + noise), ("EI",)).numbers
        inside += number.low < 1.25 * EI < number.high
        width.append((number.high - number.low) / EI)
    assert inside >= 9
    assert 0.01 < np.median(width) < 0.3  # an interval that holds everything says nothing


def test_torsion_and_twist_of_a_bar(tmp_path):
    """torque = GJ (angle - rest twist * length), out and back: both numbers and their interval by linear regression."""
    scene = load(tmp_path, TWISTED)
    angle = np.array([0, 10, 20, 30, 20, 10, 0.0])
    rng = np.random.default_rng(7)
    torque = 0.7 * (np.radians(angle) - 0.1) + rng.normal(0, 0.01, len(angle))
    found = fit(scene, measured(angle_deg=angle, torque=torque), ("GJ", "twist"))
    slope, offset = np.polyfit(np.radians(angle), torque, 1)
    assert found.numbers[0].value == pytest.approx(slope, rel=1e-5)
    assert found.numbers[1].value == pytest.approx(-offset / slope, rel=1e-4)
    _, covariance = np.polyfit(np.radians(angle), torque, 1, cov=True)
    half = 2.5706 * np.sqrt(covariance[0, 0])  # Student's t of 5 degrees of freedom
    assert found.numbers[0].high - found.numbers[0].low == pytest.approx(2 * half, rel=0.01)
    assert found.numbers[0].low < 0.7 < found.numbers[0].high
    assert abs(found.correlation[0, 1]) < 1.0


def test_points_on_a_hanging_cable(tmp_path):
    """A cantilever under its weight, nine points of its shape with noise of 0.2 mm: its bending stiffness."""
    text = SCENE.split("[[part]]")[0] + '[[support]]\nkind = "clamp"\nrod = "cable"\nat = "start"\n\n'
    text += '[gravity]\nacceleration = [0, "-9.81 m/s^2", 0]\n\n[solve]\nkind = "static"\n'
    text = text.replace("[[0, 0, 0], [100, 60, 0], [200, 0, 0]]", "[[0, 0, 0], [300, 0, 0]]")
    history = cf.solve_static(load(tmp_path, stiffer(text, 1.4)).model)
    points = history.positions("cable")[0][1:] + np.random.default_rng(3).normal(0, 2e-4, (9, 3))
    found = fit(load(tmp_path, text), measured(x=points[:, 0], y=points[:, 1], z=points[:, 2]), ("EI",))
    [number] = found.numbers
    assert number.low < 1.4 * EI < number.high
    assert number.high - number.low < 0.05 * EI
    assert 1e-4 < found.rms["points"] < 5e-4 < found.before["points"]


def test_a_cable_of_the_catalogue(tmp_path):
    """Its section becomes one of the scene, with the torsional stiffness that was measured and all else as it was."""
    text = "[[rod]]" + TWISTED.split("[[rod]]")[1].replace('section = "bar"', 'section = "M22759/16-22"')
    scene = load(tmp_path, text.replace("travel", "resolution = false\ntravel"))
    before = scene.model.rods[0].section.moment_stiffness
    angle = np.array([0, 10, 20, 30])
    found = fit(scene, measured(angle_deg=angle, torque=3e-4 * np.radians(angle)), ("GJ",))
    EI1, EI2, GJ = found.scene.model.rods[0].section.moment_stiffness
    assert pytest.approx(3e-4, rel=1e-6) == GJ == found.numbers[0].value
    assert found.numbers[0].before == before[2]
    assert pytest.approx(before[:2]) == (EI1, EI2)


def test_what_is_not_fixed_is_told(tmp_path):
    """The torque of a twisted bar says nothing of its bending stiffness."""
    scene = load(tmp_path, TWISTED)
    found = fit(scene, measured(angle_deg=[0, 10, 20, 30], torque=[0, 0.1, 0.2, 0.31]), ("GJ", "EI"))
    assert found.correlation is None
    assert all(number.low is None and number.high is None for number in found.numbers)


@pytest.mark.parametrize(
    ("columns", "free", "message"),
    [
        ({"time": [0, 1], "torque": [0, 1]}, ("EJ",), "'EJ' cannot be fitted. Known: 'EI', 'GJ'"),
        ({"time": [0, 1], "torque": [0, 1]}, ("EI", "EI"), "free twice"),
        ({"time": [0, 1], "torque": [0, 1]}, ("EI", "GJ"), "2 number"),
        ({"time": [0, 1], "torqe": [0, 1]}, ("EI",), "there is no curve 'torqe'. Did you mean 'torque'"),
        ({"torque": [0, 1]}, ("EI",), "needs a column 'time'"),
        ({"time": [0, 99], "torque": [0, 1]}, ("EI",), "the time 99 s is not in the run, 0 s to 60 s"),
        ({"angle_deg": [0, 31], "torque": [0, 1]}, ("EI",), "the angle 31 deg is not on the way out"),
    ],
)
def test_what_cannot_be_fitted(tmp_path, columns, free, message):
    with pytest.raises(cf.CosseratError, match=message):
        fit(load(tmp_path, TWISTED), measured(**columns), free)


def test_angles_out_and_back():
    """An angle is a time on the way out up to the farthest one, and on the way back after it."""
    motion = overlay.Curve(np.arange(0, 61, 10.0), np.array([0, 10, 20, 30, 20, 10, 0.0]), "deg")
    np.testing.assert_allclose(overlay.times_of(np.array([5, 25, 30, 15, 1.0]), motion, "m"), [5, 25, 30, 45, 59])


def test_overlay_of_known_curves(tmp_path):
    """Two lines a constant apart but for one place; figure and tables are written."""
    t = np.arange(11.0)
    one = overlay.Curves("one", {"force of a": overlay.Curve(t, t, "N")})
    other = overlay.Curve(np.array([0.0, 4.5, 10.0]), np.array([0.5, 6.0, 10.5]), "N")
    [row] = overlay.write_overlay(one, overlay.Curves("two", {"force of a": other}), tmp_path / "made")
    assert (row.largest, row.t) == (1.5, 4.5)
    assert (row.peak_a, row.peak_b) == (10.0, 10.5)
    assert {p.name for p in (tmp_path / "made").iterdir()} == {f"overlay.{s}" for s in ("csv", "json", "png", "svg")}
    overlay.write_overlay(one, overlay.Curves("two", {"force of a": other}), tmp_path / "made")  # over its own files
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "overlay.csv").write_text("mine")
    with pytest.raises(cf.CosseratError, match="'overlay.csv', which this program did not make"):
        overlay.write_overlay(one, overlay.Curves("two", {"force of a": other}), tmp_path / "theirs")
    with pytest.raises(cf.CosseratError, match="no time in common"):
        overlay.compare(one, overlay.Curves("late", {"force of a": overlay.Curve(t + 20, t, "N")}))
    with pytest.raises(cf.CosseratError, match="no curve in common"):
        overlay.compare(one, overlay.Curves("other", {"force of b": overlay.Curve(t, t, "N")}))


def test_pair_overlay_and_fit_as_commands(tmp_path, capsys, monkeypatch):
    """With weight and without; a measurement laid over a run; a fit, from the command line."""
    monkeypatch.chdir(tmp_path)
    load(tmp_path, SCENE, "s.toml")
    assert main(["pair", "s.toml", "-o", "both"]) == 0
    said = capsys.readouterr().out
    assert "force of wall" in said and "without_gravity" in said
    weight = json.loads((tmp_path / "both" / "overlay" / "overlay.json").read_text())["curves"]["Fy of wall"]
    assert abs(weight["largest"]) > 0.1  # half of 0.15 N of cable
    light = json.loads((tmp_path / "both" / "without_gravity" / "summary.json").read_text())
    assert "gravity" not in light["physics"]["terms"]
    run = overlay.run_curves("both/with_gravity")
    rows = [f"{a:.6f},{m:.9f}" for a, m in zip(run.angle.y, 1.1 * run.curves["torque of door"].y, strict=True)]
    (tmp_path / "m.csv").write_text("angle_deg,torque [N m]\n" + "\n".join(rows) + "\n")
    assert main(["overlay", "both/with_gravity", "m.csv", "-o", "laid"]) == 0
    assert "torque of door" in capsys.readouterr().out
    assert main(["fit", "s.toml", "m.csv", "-o", "found"]) == 0
    said = capsys.readouterr().out
    assert "EI: " in said and "with 95 % confidence" in said
    found = json.loads((tmp_path / "found" / "fit.json").read_text())
    assert found["numbers"]["EI"]["low"] < found["numbers"]["EI"]["value"] < found["numbers"]["EI"]["high"]
    assert cf.load_scene(tmp_path / "found" / "fitted.toml").model.rods[0].section.moment_stiffness[0] == pytest.approx(
        found["numbers"]["EI"]["value"]
    )
    assert (tmp_path / "found" / "overlay.svg").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["overlay", "nothing", "nothing"], "is not the folder of a finished run"),
        (["fit", "s.toml", "none.csv"], "does not exist"),
        (["fit", "s.toml", "bare.csv"], "the first row must name the columns"),
        (["pair", "s.toml"], "has no [gravity]; give one: --gravity 0 0 -9.81"),
    ],
)
def test_wrong_commands(tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    load(tmp_path, TWISTED, "s.toml")
    (tmp_path / "bare.csv").write_text("0,1\n1,2\n")
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
