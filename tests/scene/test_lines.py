"""Lines of values in a TOML text."""

import pathlib

import pytest

from cosserat_fem.scene.lines import Lines

TEXT = '''# comment [[not.a.table]]
title = "a # b [c]"   # comment

[[rod]]
name = 'x'
points = [
    [0, 0, 0],   # first
    [1, 2,
     3],
]
motion = { kind = "hinge", axis = [0,
  0, 1], "odd key" = """long
string ]""", empty = "" }

[[rod]]
a.b = 1
"quoted\\u002Ekey" = [ {x = 1}, {x = 2} ]

[solve]
kind = "static"
text = \'\'\'it's\'\'\'
[[rod.sub]]
deep = true
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("title",), 2),
        (("rod", 0), 4),
        (("rod", 0, "name"), 5),
        (("rod", 0, "points", 1, 2), 9),
        (("rod", 0, "points", 0, 1), 7),
        (("rod", 0, "motion", "axis", 1), 12),
        (("rod", 0, "motion", "odd key"), 12),
        (("rod", 0, "motion", "empty"), 13),
        (("rod", 1), 15),
        (("rod", 1, "a", "b"), 16),
        (("rod", 1, "quoted.key", 1, "x"), 17),
        (("solve", "text"), 21),
        (("rod", 1, "sub", 0, "deep"), 23),
        (("rod", 1, "nothing", "here"), 15),
        (("none",), 1),
    ],
)
def test_lines(path, line):
    assert Lines(TEXT).line_of(path) == line


def test_every_value_of_the_shipped_scenes_has_a_line():
    """The scanner walks real files to their end and finds every key."""
    import sys

    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib

    root = pathlib.Path(__file__).parents[2]
    for file in [*root.glob("examples/*.toml"), *root.glob("cosserat_fem/scenes/*.toml")]:
        text = file.read_text()
        lines = Lines(text)

        def walk(value, path, text=text, lines=lines):
            assert path in lines.lines, path
            key = next((k for k in reversed(path) if isinstance(k, str)), None)
            if isinstance(path[-1], str):
                assert key in text.splitlines()[lines.lines[path] - 1]
            for k, v in (
                value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
            ):
                walk(v, (*path, k))

        for key, value in tomllib.loads(text).items():
            walk(value, (key,))
