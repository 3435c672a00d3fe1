"""Every example runs as a user would run it, and ends in the right number."""

import csv
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


def test_hanging_cable(tmp_path):
    """Half the weight on each wall; the pull between a chain of the same span and a stiff strip."""
    rows = run_scene("hanging_cable.toml", tmp_path)
    assert rows["cable.start@ground"][0, 3] == pytest.approx(0.5 * 0.2 * 9.81, rel=1e-8)
    a = 0.6 / 2 / 1.838593  # chain: sinh(u) / u = length / span, pull = weight per length * span / (2 u)
    assert np.sinh(1.838593) / 1.838593 == pytest.approx(1 / 0.6, rel=1e-5)
    pull = rows["cable.start@ground"][0, 1]
    assert pull < 0.2 * 9.81 * a
    assert pull == pytest.approx(0.222356, rel=1e-5)


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
