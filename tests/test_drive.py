"""What the cable asks of the drive: balance, loop, margin, reduced model."""

import json
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main
from cosserat_fem.drive import (
    Drive,
    Line,
    describe_drive,
    describe_torque,
    joint_model,
    margins,
    rod_torque,
    strokes,
    write_drives,
)
from cosserat_fem.plots import plot_run

EXAMPLE = pathlib.Path(__file__).parents[1] / "examples" / "hinge_with_bracket.toml"
DEGREE = np.radians(1.0)
GJ = 0.5


@pytest.fixture(scope="module")
def hinge():
    """The satellite hinge with its bracket and friction, out and back, as the shipped example runs it."""
    scene = cf.load_scene(EXAMPLE)
    return cf.solve_quasistatic(scene.model, scene.times[::5], travel="both", resolution=scene.resolution())


def twisted(angle=DEGREE, terms=(), density=0.0, **hinge):
    """A straight bar of 1 m along x that a hinge about x twists: torque = GJ * angle."""
    section = cf.Section(
        force_stiffness=(1e4, 1e4, 1e4),
        moment_stiffness=(10, 10, GJ),
        mass_per_length=density,
        rotary_inertia=(1e-9,) * 3,
    )
    rod = cf.Rod("bar", section, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    chuck = cf.Part("chuck", motion=cf.Hinge((0, 0, 0), (1, 0, 0), angle, **hinge))
    return cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=chuck)], terms)


def test_balance_about_the_hinge(hinge):
    """Torque of the drive against all else on the cable, from nodal results: the fixed end and the forces and moments of the
    bracket, friction included, on every node. Closes to 1e-8 of the moments about the hinge."""
    touched = hinge.contact_force("cable")
    r = hinge.positions("cable")
    moments = (np.cross(r, touched[..., :3]) + touched[..., 3:]).sum(axis=1)[:, 2]
    held = np.array([hinge.model.residual(record.state).g[0] for record in hinge.records])  # what holds the first node
    held[:, 3:] = np.einsum(
        "tij,tj->ti", hinge.directors("cable")[:, 0], held[:, 3:]
    )  # it counts in the section's axes
    moments += (np.cross(r[:, 0], held[:, :3]) + held[:, 3:])[:, 2]
    scale = (np.linalg.norm(r[:, -1], axis=1) * np.linalg.norm(hinge.reaction("moving end")[:, :3], axis=1)).max()
    assert np.abs(touched).max() > 10.0  # the bracket is touched, and counts
    np.testing.assert_allclose(hinge.hinge_torque("panel"), -moments, atol=1e-8 * scale)
    np.testing.assert_allclose(rod_torque(hinge, "panel", "cable"), hinge.hinge_torque("panel"), atol=1e-12 * scale)


def test_loop_of_the_hinge(hinge):
    """Peaks both ways lie between asked stations; the loop is open where the bracket is touched; its work is friction."""
    said = describe_torque(hinge, "panel")
    for way, t in (("out", 48.364), ("back", 81.636)):
        peak = said["peaks"][way]["largest"]
        assert peak["value"] == pytest.approx(33.6616, abs=5e-4)
        assert peak["angle_deg"] == pytest.approx(48.364, abs=5e-3)
        assert peak["t"] == pytest.approx(t, abs=5e-3)
    assert 58.5 < said["band"]["largest"]["angle_deg"] < 65
    assert said["band"]["largest"]["value"] == pytest.approx(0.186, abs=0.01)  # with stations at every degree
    assert said["work"]["friction"] == pytest.approx(0.0105, rel=0.03)
    assert said["work"]["cycle"] == pytest.approx(said["work"]["friction"], rel=0.03)
    assert said["work"]["out"] == pytest.approx(24.19, abs=0.02)  # its table at every degree, by the trapezoidal rule


def test_work_of_a_spring_and_its_model():
    """A bar that is twisted out and back: an exact spring, no loop."""
    history = cf.solve_quasistatic(twisted(), np.arange(0, 31, 5.0), travel="both")
    top = np.radians(30)
    said = describe_torque(history, "chuck")
    assert said["work"]["out"] == pytest.approx(0.5 * GJ * top**2, rel=1e-9)
    assert said["work"]["cycle"] == pytest.approx(0.0, abs=1e-12)
    assert said["band"]["largest"]["value"] == pytest.approx(0.0, abs=1e-12)
    model = joint_model(history, "chuck")
    assert model["recommended"] == "linear"
    assert model["linear"]["stiffness"] == pytest.approx(GJ, rel=1e-9)
    for key in ("preload", "coulomb"):
        assert model["linear"][key] == pytest.approx(0.0, abs=1e-10)
    assert model["linear"]["residual"]["relative"] < 1e-9
    assert "viscous" not in model["linear"]
    assert model["table"]["angle"][-1] == pytest.approx(top)
    np.testing.assert_allclose(model["table"]["mean"], GJ * np.array(model["table"]["angle"]), atol=1e-9)


def test_viscous_part_of_a_run_in_time():
    """Internal damping adds a torque of GJ * retardation time * rate; the hinge starts and stops smoothly."""
    angle = (np.array([0.0, 1.0]), np.radians([0.0, 60.0]))
    model = twisted(angle, [cf.Damping(time=0.05)], density=1e-3, smooth=True)
    history = cf.solve_dynamic(model, 1.0, step=cf.FixedStep(0.02), times=np.linspace(0, 1, 26))
    found = joint_model(history, "chuck")["linear"]
    assert found["viscous"] == pytest.approx(0.05 * GJ, rel=1e-2)  # inertia and steps
    assert found["stiffness"] == pytest.approx(GJ, rel=1e-3)
    assert "coulomb" not in found  # it turns one way only


class Told:
    """A history that says what torque there is."""

    dynamic = False
    status = "converged"

    def __init__(self, angle, torque):
        self.angle, self.torque, self.t = angle, torque, np.arange(float(len(angle)))

    def __len__(self):
        return len(self.angle)

    def hinge_angle(self, part):
        return self.angle

    def hinge_torque(self, part):
        return self.torque

    def hinge_sense(self, part):
        return cf.History.hinge_sense(self, part)

    @property
    def records(self):
        return self.t

    model = type("Model", (), {"contacts": ()})


def test_coulomb_friction_is_found():
    """Spring, preload and friction put together: three numbers back, the band twice the friction, its area the work."""
    angle = np.radians([*range(41), 40 - 1e-9, *range(39, -1, -1)])  # it turns over within a hair
    sense = np.repeat([1, -1], 41)
    told = Told(angle, 4.0 * angle + 0.3 + 0.2 * sense)
    found = joint_model(told, "any")["linear"]
    for key, value in (("stiffness", 4.0), ("preload", 0.3), ("coulomb", 0.2)):
        assert found[key] == pytest.approx(value, rel=1e-6)
    said = describe_torque(told, "any")
    assert said["band"]["largest"]["value"] == pytest.approx(0.4, rel=1e-6)
    assert said["work"]["cycle"] == pytest.approx(0.4 * np.radians(40), rel=1e-2)
    assert [way.sense for way in strokes(told, "any")] == [1, -1]


def test_a_crooked_curve_is_recommended_as_a_table(hinge):
    model = joint_model(hinge, "panel")
    assert model["recommended"] == "table"
    assert model["linear"]["residual"]["relative"] > 0.05
    assert model["table"]["residual"]["relative"] < 0.01
    assert max(model["table"]["half_band"]) == pytest.approx(0.09, abs=0.02)


def test_margin_of_a_spring(tmp_path):
    """Out the bar resists with GJ * angle, back it helps and counts for nothing; bearings resist both ways."""
    history = cf.solve_quasistatic(twisted(), np.arange(0, 31, 5.0), travel="both")
    chuck = history.part("chuck")
    drive = Drive(chuck, 2.0, lines=[Line("bar", uncertainty=1.5), Line("bearings", 0.05)])
    found = margins(history, drive)
    resists = 1.5 * GJ * np.radians([0, 5, 10, 15, 20, 25, 30]) + 3.0 * 0.05
    np.testing.assert_allclose(found.required[:7], 2.0 * resists, rtol=1e-9)
    np.testing.assert_allclose(found.required[7:], 2.0 * 3.0 * 0.05, rtol=1e-9)
    said = describe_drive(history, drive)
    assert said["verdict"] == "SAFE"
    assert said["margin"]["value"] == pytest.approx(2.0 / (2.0 * resists[-1]) - 1.0)
    assert said["margin"] | {"value": 0} == {"value": 0, "angle_deg": pytest.approx(30), "t": 30.0, "way": "out"}
    assert said["lines"]["bar"]["largest"] == pytest.approx(GJ * np.radians(30))
    weak = Drive(chuck, ([0.0, 1.0], [0.9, 0.1]), uncertainty=1.0, motorisation=1.0)
    said = describe_drive(history, weak)
    assert said["verdict"] == "SAFE"
    assert said["margin"]["value"] == pytest.approx((0.9 - 0.8 * np.radians(30)) / (GJ * np.radians(30)) - 1.0)
    short = Drive(chuck, ([0.0, 0.3], [0.9, 0.1]))
    assert describe_drive(history, short)["verdict"] == "UNKNOWN"
    write_drives(history, tmp_path / "drive.csv", [short])
    rows = [line.split(",") for line in (tmp_path / "drive.csv").read_text().splitlines()[1:]]
    beyond = [abs(float(row[2])) > np.degrees(0.3) for row in rows]
    assert [row[-2:] == ["", ""] for row in rows] == beyond
    assert sum(beyond) == 6
    history.status = "stopped"
    assert describe_drive(history, drive)["verdict"] == "UNKNOWN"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: Drive(cf.GROUND, 1.0), "part 'ground' has no hinge"),
        (lambda p: Drive(p, -1.0), "torque: must be greater than 0"),
        (lambda p: Drive(p, ([0.0, 0.0], [1.0, 1.0])), "at least two angles that increase"),
        (lambda p: Drive(p, ([0.0, 1.0], [1.0, 0.0])), "torque must be greater than 0"),
        (lambda p: Drive(p, (1.0, 2.0, 3.0)), "must be a number or"),
        (lambda p: Drive(p, 1.0, uncertainty=0.5), "uncertainty must be at least 1"),
        (lambda p: Drive(p, 1.0, lines=[Line("a", 1.0), Line("a", 2.0)]), "a name is used twice"),
        (lambda p: Line("a", -1.0), "torque: must be at least 0"),
        (lambda p: Line("a", 1.0, 0.9), "uncertainty must be at least 1"),
    ],
)
def test_wrong_drives(make, message):
    with pytest.raises(ValueError, match=message):
        make(twisted().parts[1])


SCENE = """
[[section]]
name = "bar"
kind = "general"
force_stiffness = ["10 kN", "10 kN", "10 kN"]
moment_stiffness = [10, 10, 0.5]

[[rod]]
name = "bar"
section = "bar"
points = [[0, 0, 0], [1, 0, 0]]
n_elements = 4

[[part]]
name = "chuck"
motion = { kind = "hinge", axis = [1, 0, 0], angle = "1 deg/s" }

[[part]]
name = "idle"
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

[[drive]]
part = "chuck"
torque = "1 N m"
lines = [{ name = "bar", uncertainty = 2 }]

[solve]
kind = "quasistatic"
duration = "30 s"
travel = "both"

[output]
every = "10 s"
"""


def run(tmp_path, text, capsys):
    (tmp_path / "s.toml").write_text(text)
    code = main(["run", str(tmp_path / "s.toml"), "-o", str(tmp_path / "out"), "--no-pictures"])
    return code, capsys.readouterr()


def test_drive_of_a_scene(tmp_path, capsys):
    """Verdict on the screen, in the summary and in the exit code; joint model and drive among the results."""
    code, said = run(tmp_path, SCENE, capsys)
    assert code == 3
    assert "drive of chuck: UNSAFE, margin -0.04507 at 30 deg on the way out (needs 1.047 N m, has 1 N m)" in said.out
    assert "out: 0 N m at 0 deg to 0.261799 N m at 30 deg" in said.out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    drive = summary["hinges"]["chuck"]["drive"]
    assert drive["margin"]["value"] == pytest.approx(1 / (4 * GJ * np.radians(30)) - 1)
    assert "check the standard" in drive["factors"]
    model = json.loads((tmp_path / "out" / "joint_model.json").read_text())["joints"]["chuck"]
    assert model["linear"]["stiffness"] == pytest.approx(GJ)
    table = np.genfromtxt(tmp_path / "out" / "drive.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["required"].max() == pytest.approx(4 * GJ * np.radians(30))
    assert np.isnan(table["margin"]).any()  # nothing resists on the way back
    (tmp_path / "made").mkdir()
    assert {"drive.svg", "hinge_torque.svg"} <= {path.name for path in plot_run(tmp_path / "out", tmp_path / "made")}
    code, said = run(tmp_path, SCENE.replace('"1 N m"', '[["0 deg", "30 deg"], ["1 N m", "1.1 N m"]]'), capsys)
    assert code == 0
    assert "SAFE, margin 0.05042" in said.out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('torque = "1 N m"', 'torque = "1 N"', 'torque is not a moment; write for example "0.2 N m" (got "1 N")'),
        ('torque = "1 N m"', 'torque = "-1 N m"', 'torque: must be greater than 0 (got "-1 N m")'),
        ('torque = "1 N m"', 'torque = [["0 deg"], [1, 2]]', "torque has 1 angles but 2 moments"),
        ('part = "chuck"', 'part = "chuk"', "part \"chuk\" does not exist. Did you mean 'chuck'?"),
        ('part = "chuck"', 'part = "ground"', "'ground' does not turn"),
        ('part = "chuck"', 'part = "idle"', "holds and touches no rod"),
        ('"bar", uncertainty', '"bear", uncertainty', 'lines[0]: rod "bear" does not exist, and no torque is given'),
        ("uncertainty = 2 }", "torque = 1 }", 'lines[0]: "bar" is a rod'),
        ("uncertainty = 2 }", "uncertainty = 0.2 }", "lines[0].uncertainty must be at least 1"),
        ("lines = [", "motorisation = 0.5\nlines = [", "motorisation must be at least 1"),
        ("[solve]", '[[drive]]\npart = "chuck"\ntorque = 1\n\n[solve]', "has a drive already, in line 33"),
    ],
)
def test_faults_of_drives(tmp_path, old, new, message):
    assert old in SCENE
    (tmp_path / "s.toml").write_text(SCENE.replace(old, new, 1))
    with pytest.raises(cf.SceneError) as caught:
        cf.load_scene(tmp_path / "s.toml")
    assert any((message in fault and "drive 1" in fault) or "drive 2" in fault for fault in caught.value.faults), (
        caught.value
    )


def test_a_drive_needs_a_travel(tmp_path):
    text = SCENE.replace('kind = "quasistatic"\nduration = "30 s"\ntravel = "both"', 'kind = "static"')
    (tmp_path / "s.toml").write_text(text.replace('every = "10 s"', ""))
    with pytest.raises(cf.SceneError, match='a drive turns its hinge: kind = "quasistatic" or "dynamic"'):
        cf.load_scene(tmp_path / "s.toml")
