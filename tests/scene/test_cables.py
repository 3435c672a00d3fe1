"""Cables in scenes: of the catalogue, built of layers, at both ends of their stiffness; faults with their lines."""

import json
import re

import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main

SCENE = """
[[section]]
name = "harness"
kind = "built"
layers = [
    { kind = "cables", count = 3, cable = "M22759/33-22", lay = "60 mm" },
    { kind = "tape", thickness = "0.05 mm", overlap = 0.5, material = "PTFE" },
    { kind = "braid", wires = 64, diameter = "0.1 mm", angle = "30 deg", material = "copper" },
    { kind = "tube", thickness = "0.3 mm", youngs_modulus = "0.8 GPa" },
]

[[rod]]
name = "a"
section = "harness"
points = [[0, 0, 0], [0.2, 0, 0]]
n_elements = 4

[[rod]]
name = "b"
section = "M22759/16-22"
strands = "stick"
points = [[0, 0.1, 0], [0.2, 0.1, 0]]
n_elements = 4

[[support]]
rod = "a"
at = "start"
kind = "clamp"

[[support]]
rod = "b"
at = "start"
kind = "clamp"

[gravity]
acceleration = [0, 0, -9.81]

[solve]
kind = "static"

[output]
pictures = false
"""


def write(tmp_path, text=SCENE):
    file = tmp_path / "scene.toml"
    file.write_text(text)
    return file


def faults(tmp_path, text):
    with pytest.raises(cf.SceneError) as error:
        cf.load_scene(write(tmp_path, text))
    return [re.sub(r"^.*scene\.toml:", "", fault) for fault in error.value.faults]


def test_both_ends_of_a_scene(tmp_path):
    """The model slips, `sticking` sticks; a rod that says which is the same in both; what is written back means the same."""
    scene = cf.load_scene(write(tmp_path))
    stuck = scene.sticking()
    assert (scene.banded, stuck.banded) == (("a",), ())
    assert scene.catalogue == ("M22759/33-22", "M22759/16-22")
    wire = cf.cable_named("M22759/33-22")
    layers = [
        cf.Cables(3, wire, lay=0.06),
        cf.Tape(0.05e-3, cf.material("PTFE"), overlap=0.5),
        cf.Braid(64, 0.1e-3, 0.5235987755982988, cf.material("copper")),
        cf.Tube(cf.Material(0.8e9, 0.8e9 / 2.6), thickness=0.3e-3),
    ]
    cable = cf.build_up(layers)
    for end, found in (("slip", scene), ("stick", stuck)):
        a, b = (rod.sections[0][1] for rod in found.model.rods)
        assert a.moment_stiffness == pytest.approx(cable.section(end).moment_stiffness)
        assert b == cf.catalogue_section("M22759/16-22", "stick") or b.moment_stiffness == pytest.approx(
            cf.catalogue_section("M22759/16-22", "stick").moment_stiffness
        )
    again = cf.load_scene(write(tmp_path, scene.resolved()))
    assert again.banded == ("a",)
    assert cf.load_scene(write(tmp_path, stuck.resolved())).banded == ()
    assert again.identity == scene.identity != stuck.identity
    assert scene.model.warnings == []


def test_own_section_comes_first(tmp_path):
    """A scene's section with the name of a catalogue cable is what its rods get; it has no band."""
    own = '[[section]]\nname = "M22759/16-22"\nkind = "round"\ndiameter = "2 mm"\nyoungs_modulus = "1 GPa"\n'
    scene = cf.load_scene(write(tmp_path, own + SCENE.replace('strands = "stick"\n', "")))
    assert scene.model.rods[1].sections[0][1].radius == 1e-3


def test_catalogue_needs_no_section_table(tmp_path):
    text = SCENE[SCENE.index("[[rod]]") :].replace(
        '"harness"', '[[0, "RG-316"], [0.1, "RG-316"], [0.1, "RG-178"], [0.2, "RG-178"]]'
    )
    scene = cf.load_scene(write(tmp_path, text))
    assert scene.banded == ("a",)
    sections = scene.model.rods[0].sections
    assert [s.radius for _, s in sections] == pytest.approx([1.25e-3, 1.25e-3, 0.9e-3, 0.9e-3])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"M22759/16-22"', '"M22759-16-22"', '20: rod "b": section "M22759-16-22" does not exist. Did you mean \'M22759/16-22\'?'),
        ('section = "harness"', 'section = "harnes"', "14: rod \"a\": section \"harnes\" does not exist. Did you mean 'harness'?"),
        ('"M22759/16-22"', '"xyz"', '20: rod "b": section "xyz" does not exist. This scene has \'harness\'; `cosserat-fem cables` lists'),
        ('"M22759/33-22"', '"harness"', '6: section "harness": layers[0] cable "harness" is no section of kind "built" above this one'),
        ("count = 3", "count = 0", '6: section "harness": layers[0] count: must be an integer of at least 1 (got 0).'),
        ("overlap = 0.5", "overlap = 1", '7: section "harness": layers[1] overlap must be from 0 to below 1 (got 1).'),
        ('"30 deg"', '"90 deg"', '8: section "harness": layers[2] angle must be from 0 to below 89 deg (got "90 deg").'),
        ('material = "copper"', 'material = "coper"', "8: section \"harness\": layers[2] material 'coper' is unknown. Did you mean 'copper'?"),
        ('thickness = "0.3 mm", ', "", '9: section "harness": layers[3] needs either \'diameter\' or \'thickness\'.'),
        ('thickness = "0.3 mm", ', 'diameter = "1 mm", ', '9: section "harness": layers[3] diameter must be larger than what is inside'),
        (', youngs_modulus = "0.8 GPa"', "", '9: section "harness": layers[3] needs \'material\' or \'youngs_modulus\'.'),
        ('"0.8 GPa"', '"-0.8 GPa"', '9: section "harness": layers[3] youngs_modulus: must be greater than 0 (got "-0.8 GPa").'),
        ('kind = "tape"', 'kind = "tap"', "7: section \"harness\": kind 'tap' is unknown. Did you mean 'tape'?"),
        ('kind = "tape", ', "", "7: section \"harness\": needs the key 'kind', one of 'strands', 'cables', 'tube', 'braid', 'tape'."),
        ("overlap = 0.5", "overlp = 0.5", "7: section \"harness\": unknown key 'overlp'. Did you mean 'overlap'?"),
        ('strands = "stick"', 'strands = "glued"', "21: rod \"b\": strands must be one of 'slip', 'stick' or 'band' (got \"glued\")."),
        ("kind = \"built\"\n", 'kind = "built"\nbending_stiffness = [2.0, 1.0]\n', '5: section "harness": bending_stiffness: must be [slip, stick]'),
    ],
)  # fmt: skip
def test_fault_with_its_line(tmp_path, old, new, said):
    assert old in SCENE
    found = faults(tmp_path, SCENE.replace(old, new, 1))
    assert any(said in fault for fault in found), found


def test_strands_without_a_band(tmp_path):
    solid = '[[section]]\nname = "M22759/16-22"\nkind = "round"\ndiameter = "2 mm"\nyoungs_modulus = "1 GPa"\n'
    [fault] = faults(tmp_path, solid + SCENE)
    assert fault.startswith('26: rod "b": strands goes with a section that has strands')


@pytest.mark.parametrize(
    ("modulus", "said"),
    [("300 GPa", "2.6 times as stiff in bending as a solid copper rod"), ("0.5 MPa", "softer in bending")],
)
def test_implausible_stiffness(tmp_path, modulus, said):
    """Far above solid copper or below rubber: a warning at the rod's line; solid steel is none."""
    solid = f'[[section]]\nname = "RG-178"\nkind = "round"\ndiameter = "2 mm"\nyoungs_modulus = "{modulus}"\ndensity = 2000\n'
    text = solid + SCENE.replace('"M22759/16-22"\nstrands = "stick"', '"RG-178"')
    [warning] = cf.load_scene(write(tmp_path, text)).model.warnings
    assert 'scene.toml:26: rod "b": section "RG-178"' in warning
    assert said in warning
    assert cf.load_scene(write(tmp_path, text.replace(modulus, "207 GPa"))).model.warnings == []


def test_run_with_a_band(tmp_path, capsys):
    """Two runs, peaks of both in the summary; the softer bends more; a second run replaces all; one end runs alone."""
    out, file = tmp_path / "out", write(tmp_path)
    assert main(["run", str(file), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "with slipping strands:" in said
    assert "with sticking strands:" in said
    summary, stick = (json.loads((f / "summary.json").read_text()) for f in (out, out / "stick"))
    band = summary["band"]
    assert (band["of"], band["folder_of_stick"], summary["status"]) == (["a"], "stick", "converged")
    peak = band["rods"]["a"]["smallest_bend_radius"]
    assert peak["slip"] == summary["rods"]["a"]["smallest_bend_radius"]["value"]
    assert peak["stick"] == stick["rods"]["a"]["smallest_bend_radius"]["value"]
    assert peak["stick"] > 5 * peak["slip"]
    same = band["rods"]["b"]["smallest_bend_radius"]
    assert same["slip"] == pytest.approx(same["stick"])
    assert "band" not in stick
    assert "(data sheet)" in summary["catalogue"]["M22759/16-22"]["source"]
    assert cf.load_scene(out / "stick" / "scene.toml").banded == ()
    file.write_text(SCENE.replace('section = "harness"', 'section = "harness"\nstrands = "slip"'))
    assert main(["run", str(file), "-o", str(out), "-q"]) == 0
    assert not (out / "stick").exists()
    assert "band" not in json.loads((out / "summary.json").read_text())


def test_checks_at_both_ends(tmp_path, capsys):
    """A limit that only sticking strands violate: exit code 3, and the verdict of the whole says so."""
    text = SCENE + '\n[checks]\nreaction_moment = { support = "a.start@ground", limit = "VALUE" }\n'
    moments = {}
    for limit, code in ((1.0, 0), (None, 3)):
        value = limit if limit is not None else (moments["slip"] + moments["stick"]) / 2
        out = tmp_path / f"out{code}"
        assert main(["run", str(write(tmp_path, text.replace("VALUE", f"{value!r} N m"))), "-o", str(out)]) == code
        summary = json.loads((out / "summary.json").read_text())
        moments = summary["band"]["reactions"]["a.start@ground"]["largest_moment"]
    assert moments["slip"] < value < moments["stick"]
    [name] = summary["checks"]
    assert summary["checks"][name]["status"] == "SAFE"
    assert summary["band"]["verdicts"] == {"stick": {name: "UNSAFE"}}
    assert summary["band"]["checks"][name]["margin"]["stick"] < 0 < summary["band"]["checks"][name]["margin"]["slip"]
    assert summary["verdict"] == "UNSAFE"


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), MemoryError("no room"), OSError(28, "No space left on device")])
def test_fault_of_the_machine_ends_both_runs(tmp_path, monkeypatch, fault):
    """What the user or the machine stopped is not followed by the run with sticking strands; a lost equilibrium is."""
    from cosserat_fem import solving

    scene, calls = cf.load_scene(write(tmp_path, SCENE)), []

    def solve(*arguments, **options):
        calls.append(options)
        raise fault if len(calls) == 1 else cf.ConvergenceError("lost")

    monkeypatch.setattr(solving, "solve_static", solve)
    outcome = cf.run_scene(scene, tmp_path / "out")
    assert (len(calls), outcome.by_chance, outcome.sticking) == (1, True, None)
    outcome = cf.run_scene(scene, tmp_path / "out")
    assert (len(calls), outcome.by_chance) == (3, False)
    assert outcome.reason == "lost; with sticking strands: lost"


def test_resume_at_both_ends(tmp_path):
    """A run in time stopped while its strands stuck goes on there, from either folder, and has its band in the end."""
    dynamic = 'kind = "dynamic"\nduration = "20 ms"\ndt = "2 ms"\nstart = "drawn"'
    text = SCENE.replace('kind = "static"', dynamic).replace("[output]", '[output]\nevery = "4 ms"')
    text += '[checks]\nreaction_force = { support = "a.start@ground", limit = "1e-3 N" }\n'
    scene = cf.load_scene(write(tmp_path, text))
    from cosserat_fem.run import resume_scene

    seen = []

    def stop(done, total):
        seen.append((done, total))
        return done >= 8  # of 6 + 6 states

    outcome = cf.run_scene(scene, tmp_path / "out", progress=stop)
    assert outcome.sticking is not None and "with sticking strands: asked to stop" in outcome.reason
    assert {total for _, total in seen} == {12}
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "stopped"
    outcome = resume_scene(tmp_path / "out" / "stick")
    assert outcome.complete and not outcome.reason
    assert (outcome.checks, outcome.verdict) == ((), "UNSAFE")  # slipping strands were judged before
    whole = cf.run_scene(scene, tmp_path / "whole")
    assert whole.sticking.history.records[-1].state.r == pytest.approx(
        outcome.sticking.history.records[-1].state.r, abs=0
    )
    bands = [json.loads((tmp_path / name / "summary.json").read_text()) for name in ("out", "whole")]
    assert [b["status"] for b in bands] == ["converged"] * 2
    assert bands[0]["band"] == bands[1]["band"]
