"""Every example runs as a user would run it, and ends in the right number."""

import csv
import json
import pathlib
import re
import runpy

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"


def run_scene(name, folder):
    """Rows of reactions.csv of a TOML example, by support."""
    out = folder / "out"
    assert main(["run", str(EXAMPLES / name), "-o", str(out), "--no-pictures"]) == 0
    rows = {}
    with open(out / "reactions.csv", newline="") as file:
        for row in csv.DictReader(file):
            support = row.pop("support")
            rows.setdefault(support, []).append([float(v) for v in row.values()])
    return {name: np.array(values) for name, values in rows.items()}


def run_script(name):
    """What main() of a Python example returns."""
    return runpy.run_path(str(EXAMPLES / name))["main"]()


@pytest.mark.parametrize("name", ["satellite_hinge.toml", "satellite_hinge_kardan.toml"])
def test_hinge(tmp_path, name):
    """The paper's resultant force at 90 deg, by collocation 1318.891 N."""
    force = np.linalg.norm(run_scene(name, tmp_path)["fixed end"][-1, 1:4])
    assert force == pytest.approx(1318.891, abs=0.03)


def test_longer_cable(capsys):
    """Its studies are valid; what the design finds is held against a scan in test_design.py."""
    assert main(["check", str(EXAMPLES / "longer_cable.toml")]) == 0
    assert "Sweep: 60 case(s). Design: 1 value(s)." in capsys.readouterr().out


def test_wire_over_hinge(tmp_path):
    """A wire that hardly stretches asks for torque in proportion to its EI, so both ends of the band are told by one."""
    run_scene("wire_over_hinge.toml", tmp_path)
    band = json.loads((tmp_path / "out" / "summary.json").read_text())["band"]
    torque, (slip, stick) = band["hinges"]["panel"]["largest_torque"], cf.cable_named("M22759/16-22").bending_stiffness
    assert torque["stick"] / torque["slip"] == pytest.approx(stick / slip, rel=0.02)
    assert torque["slip"] == pytest.approx(0.0232674, rel=1e-4)
    radius = band["rods"]["wire"]["smallest_bend_radius"]
    assert radius["stick"] == pytest.approx(radius["slip"], rel=0.02)


def test_hanging_cable(tmp_path):
    """Half the weight on each wall; the pull between a chain of the same span and a stiff strip."""
    rows = run_scene("hanging_cable.toml", tmp_path)
    assert rows["cable.start@ground"][0, 3] == pytest.approx(0.5 * 0.2 * 9.81, rel=1e-8)
    a = 0.6 / 2 / 1.838593  # chain: sinh(u) / u = length / span, pull = weight per length * span / (2 u)
    assert np.sinh(1.838593) / 1.838593 == pytest.approx(1 / 0.6, rel=1e-5)
    pull = rows["cable.start@ground"][0, 1]
    assert pull < 0.2 * 9.81 * a
    assert pull == pytest.approx(0.222356, rel=1e-5)


def test_lee_frame(tmp_path):
    """Past both limit points: 1.855 up and 0.940 down by published solutions, which fix the thin frame's shear stiffness."""
    run_scene("lee_frame.toml", tmp_path)
    with open(tmp_path / "out" / "path.csv", newline="") as file:
        factors = np.array([float(row["factor"]) for row in csv.DictReader(file)])
    turns = np.flatnonzero(np.diff(np.sign(np.diff(factors)))) + 1
    assert factors[turns] == pytest.approx([1.855, -0.940], abs=0.02)
    assert factors[-1] == 3.0


def test_cable_through_ring(tmp_path):
    """The ring carries what wall and slider do not, and holds the cable back; the pull grows."""
    rows = run_scene("cable_through_ring.toml", tmp_path)
    with open(tmp_path / "out" / "contact_loads.csv", newline="") as file:
        loads = list(csv.DictReader(file))
    ring = np.array([[float(row[c]) for c in ("Fx", "Fy", "Fz")] for row in loads])
    np.testing.assert_allclose(rows["wall"][:, 1:4] + rows["pull"][:, 1:4], ring, atol=1e-6)
    with open(tmp_path / "out" / "contacts.csv", newline="") as file:
        [event] = list(csv.DictReader(file))
    assert float(event["s0"]) < float(event["s1"]) - 0.018  # it was pulled through by that much
    assert float(event["friction_work"]) > 1e-3
    assert np.linalg.norm(rows["pull"][-1, 1:4]) > 2 * np.linalg.norm(rows["pull"][10, 1:4])


def test_hinge_with_bracket(tmp_path):
    """Out and back the drive does the work of friction; away from the bracket it is the hinge without one."""
    rows = run_scene("hinge_with_bracket.toml", tmp_path)
    assert 131 < len(rows["fixed end"]) < 150
    with open(tmp_path / "out" / "hinge_torque.csv", newline="") as file:
        torque = np.array([[float(row["angle_deg"]), float(row["torque"])] for row in csv.DictReader(file)])
    turn = int(np.argmax(torque[:, 0]))
    assert torque[turn, 0] == pytest.approx(65, rel=1e-12)
    out, back = (np.interp(np.arange(66.0), *way.T) for way in (torque[: turn + 1], torque[turn:][::-1]))
    asked = np.isin(np.round(np.arange(66.0), 9), np.round(torque[:, 0], 9))
    assert asked.all()
    np.testing.assert_allclose(out[:55], back[:55], rtol=1e-6)
    assert out[48] == pytest.approx(33.6577, abs=2e-3)  # by collocation, without a bracket
    assert (out[60:65] > back[60:65] + 0.03).all()
    assert torque[:, 1].max() == pytest.approx(33.6616, abs=2e-3)  # at 48.36 deg, between the stations asked for
    loop = (0.5 * (torque[1:, 1] + torque[:-1, 1]) * np.diff(np.radians(torque[:, 0]))).sum()
    with open(tmp_path / "out" / "contact_loads.csv", newline="") as file:
        lost = float(list(csv.DictReader(file))[-1]["friction_work"])
    assert loop == pytest.approx(lost, rel=0.05)


def test_checked_door(tmp_path):
    """Long-term bend radius and clearance are violated, exit code 3; by symmetry in the middle and alike on both sides."""
    assert main(["run", str(EXAMPLES / "checked_door.toml"), "-o", str(tmp_path / "out"), "--no-pictures"]) == 3
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    unsafe = [name for name, check in said["checks"].items() if check["status"] != "SAFE"]
    assert unsafe == ["long-term bend radius", "clearance of loom from frame", "clearance of loom from door"]
    assert said["checks"]["least bend radius"]["worst"]["s"] == pytest.approx(0.125, abs=0.25 / 18)
    near = [said["checks"][name]["worst"]["value"] for name in unsafe[1:]]
    assert near[0] == pytest.approx(near[1], abs=1e-6)
    assert said["verdict"] == "UNSAFE"


def test_helix():
    assert run_script("helix_from_moment.py") < 1e-6


def test_roll_up():
    assert run_script("roll_up.py") < 1e-9


def test_princeton_beam():
    """Collocation at 45 deg: 8.88740 mm, 109.03588 mm, 1.664822 deg."""
    rows = run_script("princeton_beam.py")
    np.testing.assert_allclose(rows[3], [8.887396e-3, 109.035877e-3, 1.664822], rtol=1e-6)


def test_fast_hinge(tmp_path):
    """The cable is light: in 1 s the forces are those of the slow deployment within 1 %, and a ripple is left."""
    rows = run_scene("satellite_hinge_fast.toml", tmp_path)
    force = np.linalg.norm(rows["fixed end"][:, 1:4], axis=1)
    assert force[-1] == pytest.approx(1318.891, rel=1e-3)
    assert np.abs(np.diff(force[-15:])).max() > 0


def test_panel_closing(tmp_path):
    """The panel's cable ends hanging from above, still swinging; the other never moved: its tie carries its weight."""
    rows = run_scene("panel_closing.toml", tmp_path)
    weight = 2500 * np.pi / 4 * 0.005**2 * 9.81
    np.testing.assert_allclose(rows["wall tie"][:, 3], 0.4 * weight, rtol=1e-3)
    assert rows["panel tie"][:, 3].mean() == pytest.approx(0.3 * weight, rel=0.1)


def test_moving_lens_stage(tmp_path):
    """Before and after the travel the cable pushes the stage as its equilibria do."""
    rows = run_scene("moving_lens_stage.toml", tmp_path)
    end = rows["stage end"][-20:, 1].mean()
    assert rows["housing"][-20:, 1].mean() == pytest.approx(-end, rel=0.02)
    scene = cf.load_scene(EXAMPLES / "moving_lens_stage.toml")
    assert end == pytest.approx(cf.solve_static(scene.model, t=0.6).reaction("stage end")[0, 0], rel=0.02)


def test_flexible_pendulum():
    assert run_script("flexible_pendulum.py") < 5e-5


def test_flying_spaghetti():
    assert run_script("flying_spaghetti.py") < 5e-5


def test_spin_up():
    """By spectral elements -0.571312 m at 7 s; the largest is a little earlier."""
    assert run_script("spin_up.py") == pytest.approx(0.576, abs=0.002)


def test_capstan():
    """The ratio of the forces is that of a rope of finite radius."""
    assert run_script("capstan.py") < 1e-3


def test_crossing_cables():
    """Coulomb's coefficient as the slip begins."""
    assert run_script("crossing_cables.py") == pytest.approx(0.3, rel=2e-3)


@pytest.mark.slow
def test_twist_to_plectoneme():
    """Greenhill's torque; steps of the turn are 0.0075 pi apart."""
    assert run_script("twist_to_plectoneme.py") == pytest.approx(2.8606, abs=0.0075)


@pytest.mark.slow
def test_rope_on_floor(tmp_path):
    """It comes to rest on the floor and on itself: the floor carries its weight, and nothing else."""
    run_scene("rope_on_floor.toml", tmp_path)
    out = tmp_path / "out"
    with open(out / "contacts.csv", newline="") as file:
        crossing = [row for row in csv.DictReader(file) if row["rod"] == row["other"] == "rope"]
    assert float(crossing[0]["time_in"]) < 0.12
    assert float(crossing[-1]["time_out"]) == 0.5
    assert float(crossing[-1]["gap"]) > -1e-3 * 0.004  # of the radius
    with open(out / "contact_loads.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["part"] == "floor"]
    load = [float(rows[-1][c]) for c in ("Fx", "Fy", "Fz")]
    mass = cf.load_scene(EXAMPLES / "rope_on_floor.toml").model.space.node_mass.sum()
    np.testing.assert_allclose(load, [0, 0, -9.81 * mass], atol=0.01 * 9.81 * mass)
    with open(out / "ledger.csv", newline="") as file:
        kinetic = float(list(csv.DictReader(file))[-1]["kinetic"])
    assert kinetic < 0.5 * mass * 0.002**2


def test_readme():
    """The README's Python example runs as printed."""
    text = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(code, names)
    torque = names["history"].hinge_torque("arm")
    assert len(torque) == 91
    assert np.isfinite(torque).all()


def test_every_example_is_tested():
    """This file names each example."""
    text = pathlib.Path(__file__).read_text()
    assert [p.name for p in sorted(EXAMPLES.glob("*.*")) if p.name not in text] == []
