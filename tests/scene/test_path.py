"""Scenes that follow a path, ask for vibrations, or are allowed past limit points."""

import csv
import json
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main

EXAMPLE = (pathlib.Path(__file__).parents[2] / "examples" / "lee_frame.toml").read_text()
COLUMN = """
section = [{ name = "s", kind = "rectangle", width = "10 mm", height = "30 mm", youngs_modulus = "70 GPa", density = 2700 }]
rod = [{ name = "column", section = "s", points = [[0, 0, 0], [0, 0, 1]], n_elements = 8 }]
support = [{ kind = "clamp", rod = "column", at = "start" }]
load = [{ kind = "point", rod = "column", at = "end", force = [0, 0, -1.0] }]

[solve]
kind = "path"
until = "critical"
modes = 4
"""
EULER = np.pi**2 / 4 * 70e9 * 0.03 * 0.01**3 / 12


def run(tmp_path, text):
    """Summary and folder of a scene, run from the command line."""
    (tmp_path / "scene.toml").write_text(text)
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(out), "--no-pictures", "--force"]) == 0
    return json.loads((out / "summary.json").read_text()), out


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_path_of_loads(tmp_path, capsys):
    """Lee's frame from the command line: both limit points, rows in order of the path, one file for ParaView."""
    summary, out = run(tmp_path, EXAMPLE)
    limits = [event["value"] for event in summary["path"]["critical"]]
    np.testing.assert_allclose(limits, [1.854500, -0.939336], rtol=1e-4)
    assert "limit point at factor 1.8545" in capsys.readouterr().out
    rows = table(out / "path.csv")
    factors = np.array([float(row["factor"]) for row in rows])
    assert factors[0] == 0
    assert factors[-1] == 3
    assert (np.diff(factors) < 0).any()
    assert [int(float(row["negative"])) for row in rows][-1] == 0
    assert "unstable at stations" in summary["stable"]
    reactions = table(out / "reactions.csv")
    stations = [float(row["station"]) for row in reactions[::2]]
    assert stations == list(range(len(rows)))
    for k in (3, len(rows) - 1):  # supports carry the load
        total = sum(float(row["Fy"]) for row in reactions[2 * k : 2 * k + 2])
        assert total == pytest.approx(factors[k], rel=1e-6)
    again = cf.load_scene(out / "scene.toml")  # the resolved scene means the same
    assert again.tables.solve == cf.load_scene(tmp_path / "scene.toml").tables.solve


def test_critical_load_and_vibrations(tmp_path, capsys):
    """A column: Euler's load, and frequencies of the state before it."""
    summary, out = run(tmp_path, COLUMN)
    [event] = summary["path"]["critical"]
    assert event["kind"] == "bifurcation"
    assert event["value"] == pytest.approx(EULER, rel=1e-3)
    assert f"bifurcation point at factor {event['value']:.7g}" in capsys.readouterr().out
    rows = table(out / "modes.csv")
    assert [float(row["frequency"]) for row in rows] == summary["vibrations"]["frequency_Hz"]
    assert len(rows) == 4
    assert (out / "modes.vtkhdf").is_file()
    assert summary["vibrations"]["stable"]
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(out), "--no-pictures", "-q"]) == 0  # its own files


def test_constant_load(tmp_path):
    """A load with constant = true stays: a pull of 100 N adds 100 N to what the column bears."""
    pull = '\n[[load]]\nkind = "point"\nrod = "column"\nat = "end"\nforce = [0, 0, 100]\nconstant = true\n'
    text = COLUMN.split("load = ")[0] + '\n[[load]]\nkind = "point"\nrod = "column"\nat = "end"\nforce = [0, 0, -1]\n'
    text += pull + COLUMN[COLUMN.index("[solve]") - 1 :].replace("modes = 4\n", "")
    summary, _ = run(tmp_path, text)
    assert summary["path"]["critical"][0]["value"] == pytest.approx(EULER + 100, rel=1e-3)


def test_static_vibrations(tmp_path):
    """A static scene with vibrations: the first frequency of a cantilever of this strip, with its weight."""
    text = COLUMN.replace('kind = "path"', 'kind = "static"').replace('until = "critical"\n', "")
    summary, _ = run(tmp_path, text)
    omega = 3.516 * np.sqrt(70e9 * 0.01**2 / 12 / 2700)
    assert summary["vibrations"]["frequency_Hz"][0] == pytest.approx(omega / (2 * np.pi), rel=2e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("until = 3.0", 'until = "2 s"', 'until must be a factor or "critical"'),
        ("until = 3.0", "longest = -1", "longest must be greater than 0"),
        ("until = 3.0", "branch = -1", "branch must be a seed"),
        ("until = 3.0", 'along = "time"\nuntil = 0', "until must be a time after t"),
        ("until = 3.0", "duration = 1", 'duration is for kind = "quasistatic"'),
        ("until = 3.0", "past_limits = true", 'past_limits is for kind = "quasistatic"'),
        ("until = 3.0", "modes = 0", "modes must be at least 1"),
        ("force = [0, -1, 0]", "force = [0, -1, 0]\nconstant = true", "has no [[load]] to multiply"),
        ('kind = "path"', 'kind = "static"', 'until is for kind = "path"'),
        ("pictures = false", "every = 1", "a path chooses its states itself"),
    ],
)
def test_faults(tmp_path, old, new, message):
    text = EXAMPLE.replace(old, new)
    assert text != EXAMPLE
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(cf.SceneError) as caught:
        cf.load_scene(tmp_path / "scene.toml")
    assert message in str(caught.value)


@pytest.mark.parametrize("kind", ["path", "static"])
def test_kardan_angles(tmp_path, kind):
    """Neither paths nor vibrations take Kardan angles."""
    text = COLUMN.replace('"path"\nuntil = "critical"', f'"{kind}"\nrotation = "kardan"')
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(cf.SceneError, match='rotation = "quaternion"'):
        cf.load_scene(tmp_path / "scene.toml")


def test_constant_is_for_paths(tmp_path):
    text = EXAMPLE.replace('kind = "path"\nuntil = 3.0', 'kind = "static"')
    (tmp_path / "scene.toml").write_text(text.replace("force = [0, -1, 0]", "force = [0, -1, 0]\nconstant = true"))
    with pytest.raises(cf.SceneError, match="constant is for kind"):
        cf.load_scene(tmp_path / "scene.toml")
