"""`[checks]` of a scene: what it means, every fault with its line, and what a run of it says."""

import csv
import json
import re

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main
from cosserat_fem.export import read_history
from cosserat_fem.plots import plot_run
from cosserat_fem.scene import tables

SCENE = """
title = "a rod on an arm"

[[section]]
name = "stiff"
kind = "round"
diameter = "10 mm"
youngs_modulus = 1e13
density = 1000

[[rod]]
name = "a"
section = "stiff"
points = [[0.1, 0, 0], [0.6, 0, 0]]
n_elements = 4

[[rod]]
name = "b"
section = "stiff"
points = [[-0.1, 0, 0], [-0.6, 0, 0]]
n_elements = 4

[[part]]
name = "arm"
motion = { kind = "hinge", axis = [0, 1, 0], angle = [[0, "6 s"], ["60 deg", "-30 deg"]] }

[[part]]
name = "floor"
shape = { kind = "plane", point = [0, 0, "-540 mm"], normal = [0, 0, 1] }

[[support]]
kind = "clamp"
name = "hub"
rod = "a"
at = "start"
to = "arm"

[[support]]
kind = "clamp"
name = "wall"
rod = "b"
at = "start"

[gravity]
acceleration = [0, 0, "-9.81 m/s^2"]

CHECKS
[solve]
kind = "quasistatic"
duration = "6 s"

[output]
every = "1 s"
"""
GOOD = """[checks]
bend_radius = "30 mm"
tension = "50 N"
reaction_force = [{ support = "hub", limit = "10 N" }, { limit = 5, name = "pull" }]
reaction_moment = "1 N m"
hinge_torque = { limit = "0.1 N m", part = "arm" }
clearance = "30 mm"
"""


def scene_file(tmp_path, checks=GOOD, old="", new=""):
    text = SCENE.replace("CHECKS", checks)
    assert old in text
    file = tmp_path / "scene.toml"
    file.write_text(text.replace(old, new, 1))
    return file


def test_limits_are_on_all_they_can_be_on(tmp_path):
    """Rods, supports, hinges, and pairs of rods and surfaces; names tell what."""
    checks = cf.load_scene(scene_file(tmp_path)).checks
    assert [check.name for check in checks] == [
        "bend radius of a", "bend radius of b", "tension of a", "tension of b", "reaction force at hub",
        "pull at hub", "pull at wall", "reaction moment at hub", "reaction moment at wall", "hinge torque of arm",
        "clearance of a from floor", "clearance of a from b", "clearance of b from floor",
    ]  # fmt: skip
    assert checks[4].limit.value == 10.0
    assert checks[0].on == {"rod": "a"}
    assert checks[-1].on == {"rod": "b", "part": "floor"}


def test_resolved_scene_has_the_same_checks(tmp_path):
    scene = cf.load_scene(scene_file(tmp_path))
    (tmp_path / "resolved.toml").write_text(scene.resolved())
    again = cf.load_scene(tmp_path / "resolved.toml")
    assert again.resolved() == scene.resolved()
    assert [c.name for c in again.checks] == [c.name for c in scene.checks]
    assert cf.load_scene(scene_file(tmp_path, "")).checks == ()


@pytest.mark.parametrize(
    ("checks", "message"),
    [
        ('bend_radios = "30 mm"', "checks: unknown key 'bend_radios'. Did you mean 'bend_radius'?"),
        ("bend_radius = true", "checks: bend_radius must be a number or a string with a unit"),
        ('bend_radius = "3 N"', 'checks: bend_radius is not a length; write for example "4 mm" (got "3 N").'),
        ("bend_radius = 0", "checks: bend_radius: must be greater than 0 (got 0)."),
        ('bend_radius = { limit = "-3 mm" }', 'checks: bend_radius.limit: must be greater than 0 (got "-3 mm").'),
        ("bend_radius = {}", "checks: bend_radius: needs one of 'limit', 'diameters' and 'rule'."),
        (
            "bend_radius = { diameters = 6, limit = 1 }",
            "checks: bend_radius: needs one of 'limit', 'diameters' and 'rule'.",
        ),
        ("bend_radius = { diameters = -6 }", "checks: bend_radius.diameters: must be greater than 0 (got -6)."),
        ('bend_radius = { diameters = 6, measured = "mid" }', "measured must be one of 'inside' or 'centreline'"),
        ('bend_radius = { rule = "NASA coax" }', "checks: bend_radius.rule: no bend rule is called 'NASA coax'."),
        ('bend_radius = { rule = "AS50881 unsuported" }', "Did you mean 'AS50881 unsupported'?"),
        ('bend_radius = { rule = "ESCC 3901" }', "checks: bend_radius.rule: ESCC 3901 gives no least bend radius"),
        ('bend_radius = { rule = "AS50881 supported" }', "give wire_diameter"),
        ('bend_radius = { limit = 1, wire_diameter = "1 mm" }', "bend_radius.wire_diameter: goes with a rule"),
        ('bend_radius = { limit = 1, rod = "c" }', 'checks: bend_radius.rod: rod "c" does not exist.'),
        ('tension = { rod = "a" }', "checks: tension needs the key 'limit'."),
        ('tension = { limit = 1, rodd = "a" }', "checks: unknown key 'rodd'. Did you mean 'rod'?"),
        ('tension = [{ limit = 1, rod = "a" }, { limit = "1 m" }]', "checks: tension[1].limit is not a force"),
        ('compression = { limit = "0 N" }', 'checks: compression.limit: must be greater than 0 (got "0 N").'),
        ("strain = -0.1", "checks: strain: must be greater than 0 (got -0.1)."),
        ('twist = "180 deg"', "checks: twist is not a curvature"),
        ('reaction_force = { limit = 1, support = "hubb" }', "support \"hubb\" does not exist. Did you mean 'hub'?"),
        ("reaction_moment = [1]", "checks: reaction_moment[0] must be a table"),
        ('hinge_torque = { limit = 1, part = "floor" }', 'checks: hinge_torque.part: part "floor" has no hinge.'),
        ('hinge_torque = { limit = 1, part = "arn" }', "part \"arn\" does not exist. Did you mean 'arm'?"),
        ('clearance = { limit = 1, part = "arm" }', 'part "arm" has neither a shape nor a mesh.'),
        (
            'clearance = { limit = 1, part = "floor", other = "b" }',
            "clearance.other: give a part or another rod, not both.",
        ),
        ('clearance = { limit = 1, leave_out = [["2 m", "1 m"]] }', "from a smaller to a larger s"),
        ('clearance = { limit = "-1 mm" }', 'checks: clearance.limit: must be at least 0 (got "-1 mm").'),
        ('clearance = { limit = 1, rod = "a", other = "a" }', "checks: clearance: there is nothing to check"),
        (
            'tension = [{ limit = 1 }, { limit = 2, rod = "b" }]',
            "two checks are called 'tension of b'. Give one of them a name.",
        ),
    ],
)
def test_fault_has_its_line(tmp_path, checks, message):
    text = scene_file(tmp_path, f"[checks]\n{checks}\n")
    line = text.read_text().splitlines().index(checks) + 1
    with pytest.raises(cf.SceneError) as caught:
        cf.load_scene(text)
    [fault] = caught.value.faults
    assert fault.startswith(f"{text}:{line}: ")
    assert message in fault


def test_all_faults_at_once(tmp_path):
    """Also those of the rest of the scene; a check that names what is faulty is passed over."""
    checks = '[checks]\ntension = { limit = -1 }\nreaction_force = { limit = 1, support = "x" }\n'
    file = scene_file(tmp_path, checks, 'at = "start"\nto = "arm"', 'at = "start"\nto = "arn"')
    with pytest.raises(cf.SceneError) as caught:
        cf.load_scene(file)
    assert [re.sub(r".*?:\d+: ", "", fault) for fault in caught.value.faults] == [
        'support "hub": part "arn" does not exist. Did you mean \'arm\'?',
        "checks: tension.limit: must be greater than 0 (got -1).",
    ]


def test_schema_knows_all_three_ways():
    schema = tables.SceneTables.model_json_schema()
    ways = schema["$defs"]["ChecksTable"]["properties"]["tension"]["anyOf"]
    assert ways[0] == {"type": ["number", "string"]}
    assert ways[1] == {"$ref": "#/$defs/RodForceTable"}
    assert ways[2] == {"type": "array", "items": ways[1]}


def test_stopped_run_is_unknown(tmp_path, capsys):
    """What was found is not violated, but the rest of the way is not known."""
    scene = cf.load_scene(scene_file(tmp_path, '[checks]\nreaction_force = "10 N"\n'))
    outcome = cf.run_scene(scene, tmp_path / "out", progress=lambda done, total: done == 3)
    assert [verdict.status for verdict in outcome.checks] == ["UNKNOWN", "UNKNOWN"]
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (said["status"], said["verdict"]) == ("stopped", "UNKNOWN")
    assert said["checks"]["reaction force at hub"]["reason"] == "the run stopped early, after t = 2 s"


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("checked")
    file = scene_file(folder)
    code = main(["run", str(file), "-o", str(folder / "out"), "--no-pictures"])
    return code, folder / "out"


def test_run_says_what_is_violated(checked):
    """Weight times lever at 0 deg, when the arm is horizontal; distance of the tip from the floor at 60 deg, its lowest."""
    code, out = checked
    assert code == 3
    said = json.loads((out / "summary.json").read_text())
    assert said["verdict"] == "UNSAFE"
    checks = said["checks"]
    weight = 1000 * np.pi / 4 * 0.01**2 * 0.5 * 9.81
    torque = checks["hinge torque of arm"]
    assert torque["status"] == "UNSAFE"
    assert torque["worst"]["value"] == pytest.approx(0.35 * weight, rel=1e-3)
    assert torque["worst"]["angle_deg"] == pytest.approx(0.0, abs=0.02)
    assert torque["worst"]["error"] < 1e-3 * weight
    assert torque["margin"]["value"] == pytest.approx(1 - 0.35 * weight / 0.1, rel=1e-3)
    near = checks["clearance of a from floor"]
    assert near["status"] == "UNSAFE"
    assert near["worst"]["value"] == pytest.approx(0.54 - 0.6 * np.sin(np.radians(60)) - 0.005, abs=1e-4)
    assert (near["worst"]["s"], near["worst"]["t"], near["worst"]["angle_deg"]) == pytest.approx((0.5, 0.0, 60.0))
    assert checks["clearance of b from floor"]["status"] == "SAFE"
    assert checks["bend radius of a"]["status"] == "SAFE"
    assert checks["tension of a"]["margin"]["error"] is not None


def test_margins_are_kept(checked):
    """Files from which every margin can be drawn again, and the smallest one as a field of the history."""
    _, out = checked
    said = json.loads((out / "summary.json").read_text())["checks"]
    kept = np.load(out / "margins.npz")
    assert kept["names"].tolist() == list(said)
    for k, told in enumerate(said.values()):
        assert np.nanmin(kept[f"margin_{k}"]) == pytest.approx(told["margin"]["value"])
    k = list(said).index("clearance of a from floor")
    assert kept[f"map_{k}"].shape == (len(kept["t"]), len(kept[f"s_{k}"]))
    with open(out / "checks.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(kept["t"]) * len(said)
    assert float(rows[0]["angle_deg"]) == pytest.approx(60.0)
    stored = read_history(out / "history.vtkhdf")
    margin, of = stored.fields.point_data["margin"], stored.fields.point_data["margin_of"]
    assert stored.about["checks"] == list(said)
    tip = len(kept[f"s_{k}"]) - 1
    assert of[0, tip] == k
    assert margin[0, tip] == pytest.approx(said["clearance of a from floor"]["margin"]["value"], rel=1e-5)


def test_parts_that_the_run_knows_nothing_of_are_warned_of(tmp_path, capsys):
    """Without a contact a rod runs through what is in its way, or nearly touches it: a checked scene says so."""
    for place, message in (
        ("-500 mm", "t = 0 s: a runs through floor, as there is no [[contact]] between them"),
        ("-526 mm", "t = 0 s: a comes within 1.38 mm of floor, and there is no [[contact]] between them."),
    ):
        file = scene_file(tmp_path, '[checks]\ntension = "10 N"\n', '"-540 mm"', f'"{place}"')
        assert main(["run", str(file), "-o", str(tmp_path / "out"), "--no-pictures", "-q"]) == 0
        warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
        assert [w for w in warnings if w.startswith(message)]
        assert message in capsys.readouterr().err


def test_verdict_is_told(checked, tmp_path, capsys):
    """All safe: exit code 0. The margins can be drawn from the folder alone."""
    file = scene_file(tmp_path, '[checks]\nreaction_force = "10 N"\ntension = { limit = "1 N", rod = "a" }\n')
    assert main(["run", str(file), "-o", str(tmp_path / "out"), "--no-pictures"]) == 0
    text = capsys.readouterr().out
    assert re.search(
        r"  SAFE    reaction force at hub: 0\.\d+ N, at most 10 N; margin \+0\.9\d+ at t = \d s, -?\d+\.\d+ deg", text
    )
    assert "Verdict: SAFE (3 checks, 0 violated, 0 unknown)" in text
    assert main(["check", str(file)]) == 0
    assert "3 check(s)" in capsys.readouterr().out
    names = {path.name for path in plot_run(tmp_path / "out", tmp_path)}
    assert {"margins.svg", "margins.png", "margin_map.svg", "margin_map.png"} <= names


def test_rules_are_listed_with_their_status(capsys):
    assert main(["rules"]) == 0
    text = capsys.readouterr().out
    assert "NASA-STD-8739.4 coax minimum: 6 cable diameters, inside the bend" in text
    assert text.count("status: ") >= 20
    assert "ESCC 3901: no number" in text
