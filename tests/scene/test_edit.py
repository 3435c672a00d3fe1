"""Values by dotted path: what they name, and a scene with other values is the scene that says them."""

import pytest

import cosserat_fem as cf
from cosserat_fem.scene.edit import changed, find
from cosserat_fem.scene.load import parse, read

TEXT = """
[[section]]
name = "loom"
kind = "round"
diameter = "8 mm"
youngs_modulus = "8 MPa"

[[rod]]
name = "cable"
section = "loom"
points = [[0, 0, 0], [0.08, -0.05, -0.06], [0.2, 0, 0]]
n_elements = 4

[[part]]
name = "door v1.2"
motion = { kind = "hinge", point = [0.1, 0, 0], axis = [0, 0, 1], angle = [["0 s", "2 s"], ["0 deg", "110 deg"]] }

[[support]]
kind = "clamp"
rod = "cable"
at = "start"

[[support]]
kind = "clamp"
name = "far end"
rod = "cable"
at = "end"
to = "door v1.2"

[[load]]
kind = "point"
rod = "cable"
at = 0.1
force = [0, 0, "-1 N"]

[solve]
kind = "quasistatic"
times = [0, 1]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(TEXT)
    return path


@pytest.mark.parametrize(
    ("dotted", "path"),
    [
        ("rod.cable.n_elements", ("rod", 0, "n_elements")),
        ("rod.cable.length", ("rod", 0, "length")),  # not written, but may be
        ("rod.0.points.2.1", ("rod", 0, "points", 2, 1)),
        ("support.far end.at", ("support", 1, "at")),
        ("support.0.at", ("support", 0, "at")),
        ("part.door v1.2.motion.axis", ("part", 0, "motion", "axis")),  # a name with a dot
        ("part.door v1.2.motion.angle.1.1", ("part", 0, "motion", "angle", 1, 1)),
        ("load.0.force.2", ("load", 0, "force", 2)),
        ("gravity.acceleration", ("gravity", "acceleration")),
        ("solve.rotation", ("solve", "rotation")),
    ],
)
def test_a_dotted_path_names_a_value(file, dotted, path):
    assert find(read(file), dotted) == path


@pytest.mark.parametrize(
    ("dotted", "message"),
    [
        ("rood.cable.length", "'rood.cable.length': there is no 'rood'. Did you mean 'rod'?"),
        ("rod.cabel.length", "'rod.cabel.length': there is no 'cabel'. Did you mean 'cable'?"),
        ("rod.cable.lenght", "'rod.cable.lenght': there is no 'lenght' in rod.0. Did you mean 'length'?"),
        ("rod.cable.length.0", "'rod.cable.length.0': the scene says nothing of rod.0.length; write it there first."),
        ("load.1.force", "'load.1.force': there is no '1'. Known: '0'."),
        ("rod.cable.points.3", "'rod.cable.points.3': there is no '3'. Known: '0', '1', '2'."),
        ("rod.cable.n_elements.x", "'rod.cable.n_elements.x': rod.0.n_elements is one value and has nothing inside."),
        ("contact.0.friction", "'contact.0.friction': the scene says nothing of contact; write it there first."),
        ("", "'': there is no ''."),
    ],
)
def test_a_wrong_path_is_told_with_the_nearest(file, dotted, message):
    with pytest.raises(ValueError) as caught:
        find(read(file), dotted)
    assert str(caught.value).startswith(message)


def test_a_changed_scene_is_the_scene_that_says_so(file, tmp_path):
    """Values with units, in lists, in tables that were not there: equal to the scene written with them."""
    values = {
        "rod.cable.length": "250 mm",
        "section.loom.youngs_modulus": 9e6,
        "part.door v1.2.motion.angle.1.1": "90 deg",
        "load.0.force.2": -2,
        "gravity.acceleration": [0, 0, -9.81],
    }
    made = cf.load_scene(file).changed(values)
    text = TEXT.replace("n_elements = 4", 'n_elements = 4\nlength = "250 mm"').replace("8 MPa", "9 MPa")
    text = text.replace("110 deg", "90 deg").replace("-1 N", "-2 N") + "\n[gravity]\nacceleration = [0, 0, -9.81]\n"
    written = cf.scene.build_scene(parse(file, text))
    assert made.resolved() == written.resolved()
    assert made.identity == written.identity != cf.load_scene(file).identity
    assert made.model.rods[0].length == 0.25
    assert cf.load_scene(file).model.rods[0].length != 0.25  # the scene itself stays


def test_a_changed_scene_passes_the_same_checks(file):
    scene = cf.load_scene(file)
    with pytest.raises(cf.SceneError) as caught:
        scene.changed({"section.loom.diameter": "-4 mm", "rod.cable.section": "lom"})
    assert caught.value.faults == [
        f'{file}:5: section "loom": diameter: must be greater than 0 (got "-4 mm"). '
        'Changed: section.loom.diameter = "-4 mm", rod.cable.section = "lom".',
        f'{file}:10: rod "cable": section "lom" does not exist. Did you mean \'loom\'? '
        'Changed: section.loom.diameter = "-4 mm", rod.cable.section = "lom".',
    ]
    with pytest.raises(cf.SceneError, match="number with a unit"):
        scene.changed({"rod.cable.length": "long"})
    with pytest.raises(cf.SceneError, match=r"scene.toml: 'rod.cabel.length': there is no 'cabel'"):
        scene.changed({"rod.cabel.length": 1})


def test_identity_is_that_of_what_is_solved(file, tmp_path):
    """Title, pictures, folders and studies change nothing; where a file lies neither, what is in it does."""
    scene = cf.load_scene(file)
    title = changed(scene.source, {"title": "other", "output.folder": "there", "output.pictures": False})
    assert cf.scene.build_scene(title).identity == scene.identity
    again = tmp_path / "again.toml"
    again.write_text(scene.resolved())
    assert cf.load_scene(again).identity == scene.identity
    rows = "0,0,0\n0.08,-0.05,-0.06\n0.2,0,0\n"
    found = []
    for folder, text in (("a", rows), ("b", rows), ("c", rows.replace("0.2", "0.21"))):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "curve.csv").write_text(text)
        place = tmp_path / folder / "scene.toml"
        place.write_text(TEXT.replace("points = [[0, 0, 0], [0.08, -0.05, -0.06], [0.2, 0, 0]]", 'file = "curve.csv"'))
        found.append(cf.load_scene(place).identity)
    assert found[0] == found[1] != found[2]
