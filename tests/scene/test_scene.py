"""Scene files: what they mean, and every fault with its line."""

import json
import pathlib
import re
import shutil

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.scene import shipped_scene

GOOD = """
title = "a scene"

[[section]]
name = "loom"
kind = "round"
diameter = "8 mm"
youngs_modulus = "8 MPa"
density = 1500

[[rod]]
name = "cable"
section = "loom"
points = [[0, 0, 0], [80, -50, -60], [200, 0, 0]]
unit = "mm"
n_elements = 10

[[part]]
name = "door"
motion = { kind = "hinge", point = ["100 mm", 0, 0], axis = [0, 0, 1], angle = [["0 s", "2 s"], ["0 deg", "110 deg"]] }

[[support]]
kind = "clamp"
rod = "cable"
at = "start"

[[support]]
kind = "clamp"
rod = "cable"
at = "end"
to = "door"

[gravity]
acceleration = [0, 0, "-9.81 m/s^2"]

[solve]
kind = "quasistatic"
duration = "2 s"

[output]
every = "0.5 s"
"""


def write(tmp_path, text, name="scene.toml"):
    file = tmp_path / name
    file.write_text(text)
    return file


def change(old, new):
    assert old in GOOD, old
    return GOOD.replace(old, new, 1)


def faults(tmp_path, text):
    with pytest.raises(cf.SceneError) as caught:
        cf.load_scene(write(tmp_path, text))
    return caught.value.faults


def test_scene_becomes_a_model(tmp_path):
    scene = cf.load_scene(write(tmp_path, GOOD))
    model = scene.model
    assert scene.title == "a scene"
    np.testing.assert_allclose(scene.times, [0, 0.5, 1, 1.5, 2])
    assert [rod.name for rod in model.rods] == ["cable"]
    assert [str(h.name) for h in model.supports] == ["cable.start@ground", "cable.end@door"]
    assert [term.name for term in model.terms] == ["gravity"]
    assert model.rods[0].section.moment_stiffness[0] == pytest.approx(8e6 * np.pi * 0.008**4 / 64)
    np.testing.assert_allclose(model.rods[0].points[1], (0.08, -0.05, -0.06))
    assert model.parts[1].motion.angle_at(1.0) == pytest.approx(np.radians(55))
    assert scene.folder == pathlib.Path("out/scene")


def test_absent_table_is_absent_physics(tmp_path):
    text = change('[gravity]\nacceleration = [0, 0, "-9.81 m/s^2"]\n', "")
    assert cf.load_scene(write(tmp_path, text)).model.terms == ()


def test_resolved_scene_means_the_same(tmp_path):
    """What a run writes down can be run again and gives the same numbers."""
    for file in (write(tmp_path, GOOD), shipped_scene()):
        scene = cf.load_scene(file)
        again = cf.load_scene(write(tmp_path, scene.resolved(), "resolved.toml"))
        assert again.resolved() == scene.resolved()
        np.testing.assert_array_equal(again.times, scene.times)
        a, b = scene.model.initial_state(), again.model.initial_state()
        np.testing.assert_array_equal(a.r, b.r)
        np.testing.assert_array_equal(a.q, b.q)


ALL_TABLES = """
[[section]]
name = "flat"
kind = "rectangle"
width = "10 mm"
height = "2 mm"
youngs_modulus = "3 GPa"
shear_modulus = "1 GPa"

[[section]]
name = "general"
kind = "general"
force_stiffness = ["10 kN", "10 kN", "30 kN"]
moment_stiffness = ["0.1 N m^2", 0.2, 0.05]
mass_per_length = "100 g/m"
rotary_inertia = [1e-7, 1e-7, "2e-7 kg m"]
radius = "3 mm"

[[section]]
name = "coupled"
kind = "general"
coupled = [[1e4, 0, 0, 0, 0, 0], [0, 1e4, 0, 0, 0, 0], [0, 0, 3e4, 0, 0, 5], [0, 0, 0, 0.1, 0, 0], [0, 0, 0, 0, 0.2, 0], [0, 0, 5, 0, 0, 0.05]]

[[rod]]
name = "a"
section = [["0 mm", "flat"], ["100 mm", "flat"], ["100 mm", "general"], [0.2, "general"]]
points = [[0, 0, 0], [0.2, 0, 0]]
rest = [[0, 0, 0], ["1 1/m", 0, 0]]
normal = [0, 0, 1]
end_normal = [0, 1, 1]
layer = "5 mm"
order = 4

[[rod]]
name = "b"
section = "coupled"
file = "route.csv"
unit = "mm"
rest = "as_drawn"

[[part]]
name = "stage"
motion = { kind = "slider", axis = [1, 0, 0], travel = "1 mm/s" }

[[part]]
name = "ship"
motion = { kind = "path", file = "motion.csv" }

[[support]]
kind = "clamp"
rod = "a"
at = "start"
to = "stage"
free = ["ry"]
frame = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
name = "fork"

[[support]]
kind = "pin"
rod = "a"
at = "150 mm"
to = "ship"

[[support]]
kind = "clamp"
rod = "a"
at = "end"
free = "x"

[[support]]
kind = "weld"
rod = "a"
at = "end"
other = "b"
other_at = "start"

[[load]]
kind = "point"
rod = "b"
at = "end"
force = [[0, "10 s"], [[0, 0, 0], [0, 0, "-1 N"]]]
moment = [0, "1 N mm", 0]
follower = true

[[load]]
kind = "line"
rod = "a"
force = [0, 0, "-2 N/m"]
components = "normal"
profile = [[0, "200 mm"], [1, 2]]

[solve]
kind = "static"
t = "2 s"
"""


def test_every_table(tmp_path):
    """One scene with every kind of table: built, checked, solved, written back."""
    (tmp_path / "route.csv").write_text("x,y,z\n200,0,0\n250,20,0\n300,0,10\n")
    (tmp_path / "motion.csv").write_text("0,0,0,0,1,0,0,0\n5,0.002,0,0,1,0,0,0\n")
    text = ALL_TABLES.replace('free = "x"', 'free = ["x"]')
    scene = cf.load_scene(write(tmp_path, text))
    history = cf.solve_static(scene.model, t=float(scene.times[0]))
    assert history.records[0].residual < 1e-8
    total = sum(history.reaction(h)[0, :3] for h in scene.model.supports)
    assert np.isfinite(total).all()
    again = cf.load_scene(write(tmp_path, scene.resolved(), "resolved.toml"))
    np.testing.assert_array_equal(again.model.initial_state().q, scene.model.initial_state().q)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ('diameter = "8 mm"', 'diameter = "-8 mm"', 7, 'section "loom": diameter: must be greater than 0 (got "-8 mm").'),
        ('diameter = "8 mm"', 'diameter = "8 kg"', 7, 'section "loom": diameter is not a length; write for example "4 mm"'),
        ('diameter = "8 mm"', "diameter = nan", 7, 'section "loom": diameter must be finite (got nan).'),
        ('diameter = "8 mm"', "diameter = inf", 7, "must be finite"),
        ('diameter = "8 mm"', 'diametre = "8 mm"', 7, "unknown key 'diametre'. Did you mean 'diameter'?"),
        ('diameter = "8 mm"\n', "", 4, 'section "loom": needs the key \'diameter\'.'),
        ('kind = "round"', 'kind = "rond"', 6, "kind 'rond' is unknown. Did you mean 'round'?"),
        ('kind = "round"\n', "", 4, "needs the key 'kind', one of 'round', 'rectangle', 'general', 'built'."),
        ("density = 1500", "density = -1500", 9, "density: must be at least 0 (got -1500.0)."),
        ("density = 1500", "poisson_ratio = 0.7", 9, "poisson_ratio must be above -1 and at most 0.5 (got 0.7)."),
        ('name = "loom"', 'name = ""', 5, "name must not be empty"),
        ('name = "loom"', "name = 3", 5, "name must be a string (got 3)."),
        ('section = "loom"', 'section = "lom"', 13, 'rod "cable": section "lom" does not exist. Did you mean \'loom\'?'),
        ("[200, 0, 0]]", "[200, 0, nan]]", 14, 'rod "cable": points[2][2] must be finite (got nan).'),
        ("[200, 0, 0]]", "[200, 0]]", 14, 'rod "cable": points[2] has too few values (got [200, 0]).'),
        ("[200, 0, 0]]", "[200, 0, 0, 0]]", 14, "points[2] must have 3 entries (got 4)."),
        ("points = [[0, 0, 0], [80, -50, -60], [200, 0, 0]]", "points = []", 14, "points: must have shape (any, 3)"),
        ("points = [[0, 0, 0], [80, -50, -60], [200, 0, 0]]", "points = [[0, 0, 0]]", 14, "points: must be at least two (got 1)."),
        ("[80, -50, -60]", "[0, 0, 0]", 14, "points: 0 and 1 coincide at (0, 0, 0)."),
        ("points = [[0, 0, 0], [80, -50, -60], [200, 0, 0]]\n", "", 11, "needs either 'points' or 'file'."),
        ("n_elements = 10", "n_elements = 0", 16, "n_elements: must be an integer from 1 to 2000000 (got 0)."),
        ("n_elements = 10", "n_elements = 2000001", 16, "n_elements: must be an integer from 1 to 2000000 (got 2000001)."),
        ('unit = "mm"', 'unit = "0 mm"', 15, 'rod "cable": unit must be greater than 0 (got "0 mm").'),
        ('unit = "mm"', "unit = -1e-3", 15, 'rod "cable": unit must be greater than 0 (got -0.001).'),
        ('name = "door"', 'name = "door"\nmesh_unit = "-1 mm"', 20, 'part "door": mesh_unit must be greater than 0 (got "-1 mm").'),
        ("n_elements = 10", "n_elements = 2.5", 16, "n_elements must be an integer (got 2.5)."),
        ("n_elements = 10", 'n_elements = "10"', 16, "n_elements must be an integer"),
        ("n_elements = 10", "order = 9", 16, "order: must be an integer from 1 to 6 (got 9)."),
        ("n_elements = 10", 'length = "0 mm"', 16, 'length: must be greater than 0 (got "0 mm").'),
        ("n_elements = 10", 'rest = "curled"', 16, "rest must be 'straight', 'as_drawn' or numbers"),
        ("n_elements = 10", "normal = [0, 0, 0]", 16, "has zero length"),
        ("axis = [0, 0, 1]", "axis = [0, 0, 0]", 20, 'part "door": motion.axis: has zero length; give a direction.'),
        ("axis = [0, 0, 1], ", "", 20, "motion needs the key 'axis'."),
        ('"0 deg", "110 deg"', '"0 deg", "110 mm"', 20, "motion.angle is not an angle"),
        ('["0 s", "2 s"]', '["2 s", "0 s"]', 20, "motion.angle: times must increase (got 2 s followed by 0 s)."),
        ('["0 s", "2 s"]', '["0 s", "2 s", "3 s"]', 20, "motion.angle has 3 times but 2 values"),
        ('["0 s", "2 s"]', '["0 s", "1 s"]', 20, 'part "door": motion.angle: the table runs from 0 s to 1 s, but the run asks for 2 s.'),
        ('to = "door"', 'to = "dor"', 31, 'support 2: part "dor" does not exist. Did you mean \'door\'?'),
        ('at = "end"', 'at = "300 mm"', 30, "support 2: at = 0.3 m is not on rod 'cable'"),
        ('at = "end"', 'at = "middle"', 30, "at must be 'start', 'end' or an arc length"),
        ('at = "end"', 'at = "start"', 27, "both hold x, y, z, rx, ry, rz. Use one support"),
        ('at = "end"', 'at = "end"\nfree = ["q"]', 31, "free component 'q' is unknown"),
        ('"-9.81 m/s^2"', '"-9.81 m/s"', 34, "gravity: acceleration[2] is not an acceleration"),
        ('kind = "quasistatic"', 'kind = "dynamik"', 37, "kind must be one of 'static', 'quasistatic', 'path' or 'dynamic'"),
        ('duration = "2 s"', 'duration = "0 s"', 38, "duration must be greater than 0"),
        ('duration = "2 s"', "times = [0, 1, 1]", 38, "times must increase (got 1 s after 1 s)."),
        ('duration = "2 s"', "times = []", 38, "times is empty"),
        ('duration = "2 s"\n', "", 36, "needs either 'duration' (with output.every) or 'times'."),
        ('duration = "2 s"', 'duration = "2 s"\nt = 1', 39, 't is for kind = "static".'),
        ('every = "0.5 s"', 'every = "-0.5 s"', 41, "every must be greater than 0"),
        ('every = "0.5 s"', 'every = "1e-9 s"', 41, "output: every gives 2e+09 stations; choose at most a million."),
        ('every = "0.5 s"', "every = 1e-300", 41, "output: every gives 2e+300 stations; choose at most a million."),
        ('every = "0.5 s"', "every = 5e-324", 41, "output: every gives inf stations; choose at most a million."),
        ('every = "0.5 s"', 'every = "3 s"', 41, "output: every must be at most solve.duration, 2 s (got 3 s)."),
        ('duration = "2 s"', "times = [0, 1]", 41, "output: every goes with solve.duration; solve.times names each station already."),
        ('kind = "quasistatic"\nduration = "2 s"', 'kind = "static"\n', 41, 'output: every is for kind = "quasistatic"'),
        ('title = "a scene"', 'title = "a \\u0000 scene"', 2, 'title holds a control character (got "a \\x00 scene").'),
        ('name = "loom"', 'name = "\\u001b[31mloom"', 5, 'section "\\x1b[31mloom": name holds a control character'),
        ('name = "door"', 'name = "door"\nmesh = """a\nb"""', 20, 'part "door": mesh holds a control character (got "a\\nb").'),
        ('name = "door"', 'name = "door"\n"a\\u007f" = 1', 20, "part \"door\": the key 'a\\x7f' holds a control character."),
        ("[gravity]", "[gravty]", 33, "unknown table or key 'gravty'. Did you mean 'gravity'?"),
        ("[gravity]", "[[gravity]]", 33, "gravity must be a table"),
        ("[[part]]", "[part]", 18, "part must be a list"),
        ("[solve]", "[solve", 36, "is not TOML"),
        ('rod = "cable"\nat = "start"', 'rod = "cabel"\nat = "start"', 24, 'support 1: rod "cabel" does not exist. Did you mean \'cable\'?'),
    ],
)  # fmt: skip
def test_fault_with_its_line(tmp_path, old, new, line, message):
    """One changed value: one fault, at its line, with what was given and what is right."""
    found = faults(tmp_path, change(old, new))
    assert any(message in f for f in found), found
    [fault] = [f for f in found if message in f]
    assert fault.startswith(f"{tmp_path / 'scene.toml'}:{line}: "), fault


def test_all_faults_at_once(tmp_path):
    text = (
        change('section = "loom"', 'section = "lom"')
        .replace('to = "door"', 'to = "dor"')
        .replace("axis = [0, 0, 1]", "axis = [0, 0, 0]")
    )
    found = faults(tmp_path, text)
    assert len(found) == 3
    assert found == sorted(found, key=lambda f: int(f.split(":")[1]))


def test_too_few_supports(tmp_path):
    text = change(
        'kind = "clamp"\nrod = "cable"\nat = "start"', 'kind = "clamp"\nrod = "cable"\nat = "start"\nfree = ["y"]'
    )
    text = text.replace(
        'kind = "clamp"\nrod = "cable"\nat = "end"\nto = "door"',
        'kind = "pin"\nrod = "cable"\nat = "end"\nto = "door"\nfree = ["y", "z"]',
    )
    [fault] = faults(tmp_path, text)
    assert "too few supports: rod 'cable' can still move along y" in fault


RODS = """
[[section]]
name = "s"
kind = "round"
diameter = "8 mm"
youngs_modulus = "8 MPa"
[[rod]]
name = "a"
section = "s"
points = [[0, 0, 0], [0.2, 0, 0]]
[[rod]]
name = "b"
section = "s"
points = [[0.2, 0, 0], [0.2, 0.2, 0]]
[[support]]
kind = "clamp"
rod = "a"
at = "start"
[[support]]
kind = "weld"
rod = "a"
at = "end"
other = "b"
other_at = "start"
[solve]
kind = "quasistatic"
duration = 2
"""
# what is added to RODS begins in line 28


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("", '[[load]]\nkind = "line"\nrod = "a"\nforce = [[0, 1], [[0, 0, 0], [0, 0, 1]]]', 31, 'load 1: force: the table runs from 0 s to 1 s, but the run asks for 2 s.'),
        ("", '[[load]]\nkind = "point"\nrod = "a"\nat = "end"\nmoment = [[0, 1], [[0, 0, 0], [0, 0, 1]]]', 32, 'load 1: moment: the table runs from 0 s to 1 s'),
        ("", '[[part]]\nname = "idle"\nmotion = { kind = "slider", axis = [1, 0, 0], travel = [[0, 1], [0, 1]] }', 30, 'part "idle": motion.travel: the table runs from 0 s to 1 s'),
        ("", 'rotation = "kardan"', 28, 'solve: welds need rotation = "quaternion"'),
        ("", "LINE\nprofile = [[], []]", 31, 'load 1: profile needs at least two places, the rod\'s start and end (got 0)'),
        ("", "LINE\nprofile = [[0], [1]]", 31, "load 1: profile needs at least two places"),
        ("", "LINE\nprofile = [1, 2]", 31, "load 1: profile must be [[places], [factors]]"),
        ("", "LINE\nprofile = [[0, 0.1], [1, 1]]", 31, "load 1: profile: says nothing of rod 'a' from 0.1 to 0.2 m. Add factors of 0 there"),
        ("", "LINE\nprofile = [[0.05, 0.1], [1, 1]]", 31, "load 1: profile: says nothing of rod 'a' from 0 to 0.05 m and from 0.1 to 0.2 m."),
        ("", "LINE\nprofile = [[0, 0.3], [1, 1]]", 31, "load 1: profile: 0.3 m is not on rod 'a', which runs from 0 to 0.2 m."),
        ("", "LINE\nprofile = [[-1, 'end'], [1, 1]]", 31, "load 1: profile: -1 m is not on rod 'a', which runs from 0 to 0.2 m."),
        ("[solve]", '[[support]]\nkind = "weld"\nrod = "b"\nat = "0 mm"\nother = "a"\nother_at = "200 mm"\n[solve]', 25, "support 3: welds what support 2 in line 19 welds already. Remove one of them."),
        ("[solve]", '[[support]]\nkind = "pin"\nrod = "a"\nat = "200 mm"\n[[support]]\nkind = "pin"\nrod = "a"\nat = "end"\n[solve]', 29, "is at the same place of rod 'a'"),
    ],
)  # fmt: skip
def test_fault_of_several_rods(tmp_path, old, new, line, message):
    """Faults that show when things are put together or asked for values: each at its line."""
    new = new.replace("LINE", '[[load]]\nkind = "line"\nrod = "a"')
    found = faults(tmp_path, RODS.replace(old, new, 1) if old else RODS + new + "\n")
    [fault] = found
    assert message in fault
    assert fault.startswith(f"{tmp_path / 'scene.toml'}:{line}: "), fault


def test_no_rod(tmp_path):
    [fault] = faults(tmp_path, 'section = []\nrod = []\n[solve]\nkind = "static"\n')
    assert fault == f"{tmp_path / 'scene.toml'}:2: rod must have at least 1 entry (got 0)."


def test_faults_print_the_path_as_it_was_given(tmp_path, monkeypatch):
    """A terminal opens it where the user stands."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    file = pathlib.Path("deep") / "scene.toml"
    for text, line in ((change('diameter = "8 mm"', "diameter = 0"), 7), ("[solve", 1)):
        file.write_text(text)
        with pytest.raises(cf.SceneError, match=rf"^deep/scene\.toml:{line}: "):
            cf.load_scene(file)
    file.write_bytes(b"\xff")
    with pytest.raises(cf.SceneError, match=r"^deep/scene\.toml: is not a text file"):
        cf.load_scene(file)


def test_profile_ends_may_be_typed_or_named(tmp_path):
    """The length of a curve is known to as many digits as were typed; names of the ends need no digits."""
    base = GOOD.replace(
        "[solve]", '[[load]]\nkind = "line"\nrod = "cable"\nforce = [0, 0, 1]\nprofile = PROFILE\n\n[solve]'
    )
    length = cf.load_scene(write(tmp_path, GOOD)).model.rods[0].length
    models = [
        cf.load_scene(write(tmp_path, base.replace("PROFILE", profile))).model
        for profile in ('[["start", "50 mm", "end"], [0, 0, 1]]', f"[[0, 0.05, {length:.7g}], [0, 0, 1]]")
    ]
    a, b = (model.terms[1].weights(model.space) for model in models)
    np.testing.assert_allclose(a, b, atol=1e-9)
    assert models[0].terms[1].profile[0][-1] == length


def test_motion_file_faults_stand_at_its_key(tmp_path):
    """Whole sentences, in the line of the file's key, also for a part with a mesh."""
    shutil.copy(shipped_scene().parent / "hinge_fixed.stl", tmp_path / "m.stl")
    text = GOOD.replace(
        GOOD[GOOD.index("motion = {") : GOOD.index("[[support]]")],
        'mesh = "m.stl"\nmotion.kind = "path"\nmotion.file = "p.csv"\n\n',
    )
    name = re.escape(str(tmp_path / "p.csv"))
    for table, message in (
        (None, "does not exist"),
        ("0,0,0\n", ", row 1: has 3 cells, not the 8 columns time, x, y, z, qw, qx, qy, qz"),
        ("0,0,0,0,1,0,0,0\n1,0,0,0,2,0,0,0\n", ": quaternion 1 has length 2; it must be 1"),
        ("0,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,a\n", r", row 2: cell 8 \(qz\) must be a finite number \(got 'a'\)"),
    ):
        if table is not None:
            (tmp_path / "p.csv").write_text(table)
        [fault] = faults(tmp_path, text)
        assert re.fullmatch(
            rf'{re.escape(str(tmp_path))}/scene\.toml:21: part "door": motion file \'{name}\' ?{message}\.', fault
        ), fault


def test_parts_that_hold_nothing_belong_to_the_scene(tmp_path):
    scene = cf.load_scene(write(tmp_path, GOOD.replace("[[part]]", '[[part]]\nname = "wall"\n\n[[part]]', 1)))
    assert [part.name for part in scene.parts] == ["wall", "door"]
    assert [part.name for part in scene.model.parts] == ["ground", "door"]


def test_name_used_twice(tmp_path):
    text = change("[[part]]", '[[rod]]\nname = "cable"\nsection = "loom"\npoints = [[0, 0, 0], [1, 0, 0]]\n\n[[part]]')
    assert any("the name is used twice, first in line 11." in f for f in faults(tmp_path, text))


def test_bad_files(tmp_path):
    """Meshes and curves that are missing or no meshes, in the line that names them."""
    (tmp_path / "text.stl").write_text("no mesh")
    for name, message in (("none.stl", "does not exist"), ("text.stl", "holds no surface|cannot be read")):
        [fault] = faults(tmp_path, change('name = "door"', f'name = "door"\nmesh = "{name}"'))
        assert re.search(f'scene.toml:20: part "door": mesh file .*({message})', fault)
    both = change('name = "door"', 'name = "door"\nmesh = "none.stl"').replace("axis = [0, 0, 1]", "axis = [0, 0, 0]")
    assert len(faults(tmp_path, both)) == 2
    text = change("points = [[0, 0, 0], [80, -50, -60], [200, 0, 0]]", 'file = "route.xyz"')
    (tmp_path / "route.xyz").write_text("1 2 3")
    [fault] = faults(tmp_path, text)
    assert re.search(r'scene\.toml:14: rod "cable": curve file .* cannot be read', fault)
    [fault] = faults(tmp_path, change("angle = [", 'file = "x.csv", angle = ['))
    assert "unknown key 'file'" in fault


def test_repaired_meshes_are_warned_of(tmp_path):
    """An open mesh is used as it is; the model's warnings and so the run's summary say so."""
    corners = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (0, 1, 0), (1, 1, 0)]], dtype=float)
    lines = [
        f"facet normal 0 0 1 outer loop {' '.join('vertex {} {} {}'.format(*x) for x in c)} endloop endfacet"
        for c in corners
    ]
    (tmp_path / "sheet.stl").write_text("\n".join(["solid sheet", *lines, "endsolid sheet"]))
    (tmp_path / "scene.toml").write_text(change('name = "door"', 'name = "door"\nmesh = "sheet.stl"'))
    warnings = cf.load_scene(tmp_path / "scene.toml").model.warnings
    assert [re.sub(r"'/.*/", "'", w) for w in warnings] == [
        "part 'door': mesh file 'sheet.stl': 1 flipped triangle turned.",
        "part 'door': mesh file 'sheet.stl': not watertight (4 open edges of 2 triangles): "
        "a sheet that is touched from both sides.",
    ]


def test_unreadable(tmp_path):
    with pytest.raises(cf.SceneError, match="there is no such scene file"):
        cf.load_scene(tmp_path / "none.toml")
    with pytest.raises(cf.SceneError, match="cannot be read"):
        cf.load_scene(tmp_path)
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(cf.SceneError, match="not a text file"):
        cf.load_scene(tmp_path / "x.toml")
    assert len(faults(tmp_path, "")) == 2  # a rod and what to solve
    assert len(faults(tmp_path, "[" * 5000)) == 1


def test_kardan_on_the_shipped_scene_names_the_place(tmp_path):
    """Clamp B points along x at 0 deg, where Kardan angles are singular: refused, quaternions advised."""
    folder = shipped_scene().parent
    for file in folder.iterdir():
        shutil.copy(file, tmp_path)
    file = tmp_path / "satellite_hinge.toml"
    file.write_text(file.read_text().replace('kind = "quasistatic"', 'kind = "quasistatic"\nrotation = "kardan"'))
    with pytest.raises(
        cf.SceneError,
        match=r"toml:\d+: solve: .*rod 'cable' at its end: theta = 90.00 deg.*Use rotation = \"quaternion\"",
    ):
        cf.load_scene(file)


def test_example_and_shipped_scene_are_one():
    """The example uses the line mesh and the meshes folder; what is solved is the same."""
    root = pathlib.Path(__file__).parents[2]
    a, b = cf.load_scene(root / "examples" / "satellite_hinge.toml"), cf.load_scene()
    np.testing.assert_allclose(a.model.initial_state().r, b.model.initial_state().r, atol=1e-15)
    for name in ("hinge_fixed.stl", "hinge_moving.stl"):
        assert (root / "meshes" / name).read_bytes() == (shipped_scene().parent / name).read_bytes()


TOUCHING = (
    RODS.replace(
        '[solve]\nkind = "quasistatic"',
        """[[part]]
name = "post"
shape = { kind = "cylinder", start = ["50 mm", "20 mm", "-1 cm"], end = [0.05, 0.02, 0.01], radius = "5 mm" }
[[part]]
name = "bare"
[[contact]]
kind = "part"
rods = ["a", "b"]
part = "post"
friction = 0.2
[[contact]]
kind = "rods"
rods = ["a", "b"]
friction = 0.1
[solve]
kind = "quasistatic\"""",
    )
)  # fmt: skip
# the first part begins in line 25, the contacts in 30 and 35


def test_shapes_and_contacts(tmp_path):
    """One term for each rod with a part, one for all rods; every shape; written back and read again."""
    more = """[[part]]
name = "all"
shape = [
    { kind = "plane", point = [0, 0, "-1 m"], normal = [0, 0, 2] },
    { kind = "sphere", center = [1, 0, 0], radius = "2 cm" },
    { kind = "cylinder", start = [0, 0, 1], end = [0, 0, 2], radius = 0.1 },
    { kind = "capsule", start = [0, 0, 1], end = [0, 0, 2], radius = 0.1 },
    { kind = "box", center = [2, 0, 0], edges = ["1 cm", "2 cm", "3 cm"], axes = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] },
    { kind = "torus", center = [3, 0, 0], axis = [1, 0, 0], radius = "2 cm", tube = "5 mm" },
]
[[contact]]
kind = "part"
rod = "a"
part = "all"
radius = "3 mm"
stand_off = "1 um"
elastic_slip = "20 um"
pressure = "10 N/m"
layer = ["1e6 N/m^2", "0.5 mm"]
[solve]
"""
    scene = cf.load_scene(write(tmp_path, TOUCHING.replace("[solve]\n", more)))
    contacts = scene.model.contacts
    assert [type(term).__name__ for term in contacts] == ["PartContact", "PartContact", "RodContact", "PartContact"]
    assert [term.name for term in contacts[:2]] == ["a-post", "b-post"]
    assert [contacts[0].friction, contacts[2].friction, contacts[3].friction] == [0.2, 0.1, 0.0]
    assert contacts[0].radius == pytest.approx(0.004)
    last = contacts[3]
    assert (last.radius, last.stand_off, last.elastic_slip, last.pressure) == pytest.approx((3e-3, 1e-6, 2e-5, 10.0))
    assert last.layer == pytest.approx((1e6, 5e-4))
    assert [shape.kind for shape in last.part.shapes] == [0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(last.part.shapes[4].frame[:, 0], (0, 1, 0))  # a row of the file is an axis
    assert len(scene.parts[0].shapes) == 1 and scene.parts[1].shapes == ()
    again = cf.load_scene(write(tmp_path, scene.resolved(), "resolved.toml"))
    assert again.resolved() == scene.resolved()
    for a, b in zip(again.model.contacts, contacts, strict=True):
        assert a.name == b.name


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ('kind = "cylinder"', 'kind = "cylindre"', 27, "part \"post\": kind 'cylindre' is unknown. Did you mean 'cylinder'?"),
        ('kind = "cylinder", ', "", 27, "needs the key 'kind', one of 'plane', 'sphere', 'cylinder', 'capsule', 'box', 'torus'."),
        ('radius = "5 mm"', 'radius = "0 mm"', 27, 'part "post": shape.radius: must be greater than 0 (got "0 mm").'),
        ('radius = "5 mm"', 'radius = "5 s"', 27, "shape.radius is not a length"),
        ('radius = "5 mm"', 'radios = "5 mm"', 27, "unknown key 'radios'. Did you mean 'radius'?"),
        (', radius = "5 mm"', "", 27, "part \"post\": shape needs the key 'radius'."),
        ("end = [0.05, 0.02, 0.01]", 'end = [0.05, 0.02, "-10 mm"]', 27, 'part "post": shape: start and end are the same point'),
        ('name = "post"\n', 'name = "post"\nshape = 3\n#', 27, 'part "post": shape must be a list (got 3).'),
        ('name = "bare"', 'name = "bare"\nshape = [{ kind = "sphere", center = [0, 0, 9], radius = 1 },\n{ kind = "sphere", center = [0, 0, 9], radius = -1 }]', 31, 'part "bare": shape[1].radius: must be greater than 0'),
        ('name = "bare"', 'name = "bare"\nshape = { kind = "torus", center = [0, 0, 9], axis = [1, 0, 0], radius = 1, tube = 2 }', 30, 'part "bare": shape.tube: must be smaller than the radius 1 m (got 2 m).'),
        ('name = "bare"', 'name = "bare"\nshape = { kind = "plane", point = [0, 0, 9], normal = [0, 0, 0] }', 30, 'part "bare": shape.normal: has zero length; give a direction.'),
        ('name = "bare"', 'name = "bare"\nshape = { kind = "box", center = [0, 0, 9], edges = [1, "-1 mm", 1] }', 30, 'part "bare": shape.edges 1: must be greater than 0 (got "-1 mm").'),
        ('kind = "part"', 'kind = "parts"', 31, "contact 1: kind 'parts' is unknown. Did you mean 'part'?"),
        ('kind = "part"\n', "", 30, "contact 1: needs the key 'kind', one of 'part', 'rods'."),
        ('part = "post"', 'part = "pots"', 33, "contact 1: part \"pots\" does not exist. Did you mean 'post'?"),
        ('part = "post"', 'part = "bare"', 33, 'contact 1: part "bare" has neither a shape nor a mesh. Give it one to touch.'),
        ('part = "post"', 'part = "ground"', 33, 'contact 1: part "ground" has no surface. Declare a [[part]] without motion, give it a shape'),
        ('part = "post"\n', "", 30, "contact 1: needs the key 'part'."),
        ('rods = ["a", "b"]\npart', 'rods = ["a", "c"]\npart', 32, "contact 1: rod \"c\" does not exist. Known: 'a', 'b'."),
        ('rods = ["a", "b"]\npart', 'rods = ["a", "a"]\npart', 32, 'contact 1: rods: rod "a" stands there twice.'),
        ('rods = ["a", "b"]\npart', "rods = []\npart", 32, "contact 1: rods must have at least 1 entry (got 0)."),
        ('rods = ["a", "b"]\npart', "part", 30, "contact 1: needs either 'rod' or 'rods'."),
        ('rods = ["a", "b"]\npart', 'rod = "a"\nrods = ["b"]\npart', 30, "contact 1: needs either 'rod' or 'rods'."),
        ("friction = 0.2", "friction = -0.2", 34, "contact 1: friction must be 0 or greater (got -0.2)."),
        ("friction = 0.2", "fricton = 0.2", 34, "contact 1: unknown key 'fricton'. Did you mean 'friction'?"),
        ("friction = 0.2", 'radius = "0 mm"', 34, 'contact 1: radius: must be greater than 0 (got "0 mm").'),
        ("friction = 0.2", 'stand_off = "-1 mm"', 34, 'contact 1: stand_off: must be greater than 0 (got "-1 mm").'),
        ("friction = 0.2", 'pressure = "1 N"', 34, "contact 1: pressure is not a force per length"),
        ("friction = 0.2", 'layer = ["1 N/m", "1 mm"]', 34, 'contact 1: layer[0] is not a line stiffness; write for example "1e6 N/m^2"'),
        ("friction = 0.2", "layer = [1e6]", 34, "contact 1: layer has too few values"),
        ("friction = 0.2", "layer = [1e6, 0]", 34, "contact 1: layer depth: must be greater than 0"),
        ("friction = 0.2", 'layer = [1e6, "5 mm"]', 34, "contact 1: the layer must be thinner than the radius, 0.004 m (got 0.005 m)."),
        ("friction = 0.1", "friction = -0.1", 38, "contact 2: friction must be 0 or greater (got -0.1)."),
        ("friction = 0.1", 'friction = 0.1\n[[contact]]\nkind = "rods"\nrods = ["b"]', 41, 'contact 3: rod "b" touches other rods in contact 2 in line 35 already. Name all rods in one of them.'),
        ("friction = 0.1", 'friction = 0.1\n[[contact]]\nkind = "part"\nrod = "b"\npart = "post"', 41, 'contact 3: rod "b" touches part "post" in contact 1 in line 30 already. Remove one of them.'),
        ('name = "b"\nsection = "s"', 'name = "b"\nsection = "s"\norder = 2', 38, "contact 2: all must be of one order (got [2, 3])."),
        ('duration = 2', 'duration = 2\nrotation = "kardan"', 42, 'solve: contact needs rotation = "quaternion".'),
    ],
)  # fmt: skip
def test_fault_of_contact(tmp_path, old, new, line, message):
    """Each at its line, with what was given and what is right."""
    assert old in TOUCHING
    found = [f for f in faults(tmp_path, TOUCHING.replace(old, new, 1)) if message in f]
    assert found, faults(tmp_path, TOUCHING.replace(old, new, 1))
    [fault] = found
    assert fault.startswith(f"{tmp_path / 'scene.toml'}:{line}: "), fault


def test_contact_needs_a_radius(tmp_path):
    """A section of stiffnesses has none: said at the contact, which may give one."""
    general = 'kind = "general"\nforce_stiffness = [1e3, 1e3, 1e3]\nmoment_stiffness = [1, 1, 1]'
    text = TOUCHING.replace('kind = "round"\ndiameter = "8 mm"\nyoungs_modulus = "8 MPa"', general)
    found = faults(tmp_path, text)
    assert [re.sub(r"^.*toml:", "", fault) for fault in found] == [
        "32: contact 1: rod 'a': its section has no radius; give the contact a radius.",
        "37: contact 2: rod 'a': its section has no radius; give the contact a radius.",
    ]
    text = text.replace("friction = 0.2", 'radius = "4 mm"').replace("friction = 0.1", 'radius = "4 mm"')
    assert len(cf.load_scene(write(tmp_path, text)).model.contacts) == 3
    [fault, *_] = faults(tmp_path, text.replace('radius = "4 mm"', "radius = 4e-9", 1))
    assert "toml:34: contact 1: radius: 4e-09 m cuts rod 'a', 0.2 m long, into more than 2000000 pieces." in fault


def test_overlap_is_told_at_the_contact(tmp_path):
    """A run refuses a rod that is drawn inside a part, or inside a rod, and names the line of the contact."""
    from cosserat_fem.run import run_scene

    text = TOUCHING.replace('start = ["50 mm", "20 mm"', 'start = ["50 mm", "2 mm"').replace(
        "end = [0.05, 0.02", "end = [0.05, 0.002"
    )
    with pytest.raises(cf.SceneError) as caught:
        run_scene(cf.load_scene(write(tmp_path, text)), tmp_path / "out")
    assert any(
        re.search(r"scene.toml:30: contact 1: rod 'a': at s = 0.0\d+ m it is .* inside part 'post'", f)
        for f in caught.value.faults
    )


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("accuracy = 2", "accuracy must be from 1e-9 to below 1"),
        ("accuracy = -1", "accuracy: must be greater than 0"),
        ('theory = "euler"', "theory"),
    ],
)
def test_accuracy_and_theory_are_checked(tmp_path, keys, told):
    text = (pathlib.Path(__file__).parents[2] / "examples" / "hanging_cable.toml").read_text()
    file = tmp_path / "s.toml"
    file.write_text(text.replace('kind = "static"', f'kind = "static"\n{keys}'))
    with pytest.raises(cf.SceneError, match=told):
        cf.load_scene(file)


def test_what_a_string_cannot_carry_is_told_at_the_theory(tmp_path):
    text = (pathlib.Path(__file__).parents[2] / "examples" / "hanging_cable.toml").read_text()
    file = tmp_path / "s.toml"
    text = text.replace('kind = "static"', 'kind = "static"\ntheory = "string"')
    file.write_text(text + '\n[[load]]\nkind = "point"\nrod = "cable"\nat = 0.5\nmoment = [0, 1, 0]\n')
    line = 1 + file.read_text().splitlines().index('theory = "string"')
    with pytest.raises(cf.SceneError, match=f"s.toml:{line}: .*cannot act on a string"):
        cf.load_scene(file)


def test_theory_and_accuracy_of_a_scene(tmp_path):
    """Both keys reach the run; the resolved scene says them again."""
    text = (pathlib.Path(__file__).parents[2] / "examples" / "hanging_cable.toml").read_text()
    file = tmp_path / "s.toml"
    file.write_text(text.replace('kind = "static"', 'kind = "static"\naccuracy = 1e-6\ntheory = "string"'))
    scene = cf.load_scene(file)
    assert scene.model.theory == "string"
    outcome = cf.run_scene(scene, tmp_path / "out")
    summary = json.loads((outcome.folder / "summary.json").read_text())
    assert summary["physics"]["theory"] == "string"
    assert summary["physics"]["chosen"]["asked"] == 1e-6
    assert summary["physics"]["chosen"]["estimate"] <= 1e-6
    assert cf.load_scene(outcome.folder / "scene.toml").tables.solve.accuracy == 1e-6


def test_there_and_back(tmp_path):
    """A travel both ways has its stations twice and looks between them, unless it is told not to."""
    both = change('duration = "2 s"', 'duration = "2 s"\ntravel = "both"')
    scene = cf.load_scene(write(tmp_path, both))
    assert scene.stations == 9
    assert scene.resolution().turn == pytest.approx(np.radians(0.5))
    for text, wanted in (("false", None), ('"2 deg"', np.radians(2))):
        scene = cf.load_scene(write(tmp_path, both.replace("[output]", f"resolution = {text}\n\n[output]")))
        found = scene.resolution()
        assert (found and found.turn) == (wanted and pytest.approx(wanted))
        again = cf.load_scene(write(tmp_path, scene.resolved(), "again.toml"))
        assert again.resolved() == scene.resolved()
    assert cf.load_scene(write(tmp_path, GOOD)).resolution() is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('travel = "back"', "travel must be one of 'out' or 'both' (got \"back\")."),
        ("resolution = 0", "resolution must be false or greater than 0 (got 0 rad)."),
        ('resolution = "-1 deg"', "resolution must be false or greater than 0"),
        ('resolution = "1 mm"', "resolution"),
        ("resolution = true", "resolution"),
    ],
)
def test_faults_of_a_travel(tmp_path, text, message):
    [fault] = faults(tmp_path, change('duration = "2 s"', f'duration = "2 s"\n{text}'))
    assert message in fault
    assert f":{GOOD[: GOOD.index('duration =')].count(chr(10)) + 2}: " in fault
