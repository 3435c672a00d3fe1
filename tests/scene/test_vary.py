"""Cases of a sweep: which they are, and every fault at its line."""

import numpy as np
import pytest
from scipy.stats import norm

import cosserat_fem as cf
from cosserat_fem.scene.load import parse

TEXT = """
section = [{ name = "loom", kind = "round", diameter = "8 mm", youngs_modulus = "8 MPa" }]
rod = [{ name = "cable", section = "loom", points = [[0, 0, 0], [0.2, 0, 0]], n_elements = 4, normal = [0, 0, 1] }]
support = [{ kind = "clamp", rod = "cable", at = "start" }]
solve = { kind = "static" }
[sweep]
"""


def scene(tmp_path, sweep):
    return cf.scene.build_scene(parse(tmp_path / "scene.toml", TEXT + sweep))


def test_a_grid_takes_all_combinations_the_last_fastest(tmp_path):
    made = scene(
        tmp_path,
        """vary = [{ path = "rod.cable.length", range = ["200 mm", "220 mm"], points = 3 },
                   { path = "section.loom.youngs_modulus", values = ["7 MPa", 9e6] }]""",
    )
    assert made.cases == [
        {"rod.cable.length": length, "section.loom.youngs_modulus": modulus}
        for length in (0.2, 0.21, 0.22)
        for modulus in ("7 MPa", 9e6)
    ]


def test_a_list_takes_values_side_by_side(tmp_path):
    made = scene(
        tmp_path,
        """kind = "list"
        vary = [{ path = "rod.cable.length", values = ["0.2 m", "0.3 m"] },
                { path = "rod.cable.normal", values = [[0, 1, 0], [0, 0, 1]] }]""",
    )
    assert made.cases == [
        {"rod.cable.length": "0.2 m", "rod.cable.normal": [0, 1, 0]},
        {"rod.cable.length": "0.3 m", "rod.cable.normal": [0, 0, 1]},
    ]


HYPERCUBE = """kind = "latin_hypercube"
cases = 40
seed = 5
vary = [{ path = "rod.cable.length", range = ["200 mm", "220 mm"] },
        { path = "section.loom.youngs_modulus", normal = ["8 MPa", "0.5 MPa"] },
        { path = "rod.cable.n_elements", values = [4, 5] }]"""


def test_a_hypercube_has_one_case_in_each_part_of_each_range(tmp_path):
    """The property that makes it one; and its numbers are those of its seed, whichever library version drew them."""
    cases = scene(tmp_path, HYPERCUBE).cases
    length = np.array([case["rod.cable.length"] for case in cases])
    assert sorted(np.floor((length - 0.2) / 0.02 * 40).astype(int)) == list(range(40))
    share = norm.cdf([case["section.loom.youngs_modulus"] for case in cases], 8e6, 0.5e6)
    assert sorted(np.floor(share * 40).astype(int)) == list(range(40))
    assert [case["rod.cable.n_elements"] for case in cases].count(4) == 20
    assert cases == scene(tmp_path, HYPERCUBE).cases != scene(tmp_path, HYPERCUBE.replace("seed = 5", "seed = 6")).cases
    assert cases[:2] == FIRST


FIRST = [
    {"rod.cable.length": 0.202798440762, "section.loom.youngs_modulus": 7710300.82035, "rod.cable.n_elements": 5},
    {"rod.cable.length": 0.208989624325, "section.loom.youngs_modulus": 7162248.49328, "rod.cable.n_elements": 5},
]


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        (
            'vary = [{ path = "rod.cabel.length", values = [1] }]',
            "7: sweep: vary[0].path 'rod.cabel.length': there is no",
        ),
        ('vary = [{ path = "rod.cable.length" }]', "7: sweep: vary[0] needs either 'values' or 'range'."),
        (
            'vary = [{ path = "rod.cable.length", values = ["1 N"] }]',
            '7: sweep: vary[0].values[0]: rod "cable": length',
        ),
        (
            'vary = [{ path = "rod.cable.length", range = ["1 N", "2 N"], points = 2 }]',
            '7: sweep: vary[0].range[0]: rod "cable": length is not a length',
        ),
        (
            'vary = [{ path = "rod.cable.n_elements", range = [4, 8], points = 3 }]',
            '7: sweep: vary[0].range[0]: rod "cable": n_elements must be an integer (got 6.0).',
        ),
        (
            'vary = [{ path = "rod.cable.length", range = ["1 m", "2 N"], points = 2 }]',
            "7: sweep: vary[0].range: both must have the same kind of unit (got '1 m', '2 N').",
        ),
        (
            'vary = [{ path = "rod.cable.length", range = ["2 m", "1 m"], points = 2 }]',
            "7: sweep: vary[0].range must go up (got '2 m' to '1 m').",
        ),
        ('vary = [{ path = "rod.cable.length", range = [1, 2] }]', "7: sweep: vary[0].range needs 'points', how many"),
        (
            'vary = [{ path = "rod.cable.length", normal = [1, 2] }]',
            '7: sweep: vary[0].normal is for kind = "latin_hypercube".',
        ),
        (
            'cases = 3\nvary = [{ path = "rod.cable.length", values = [1] }]',
            '7: sweep: cases is for kind = "latin_hyper',
        ),
        (
            'kind = "latin_hypercube"\nvary = [{ path = "rod.cable.length", values = [1] }]',
            "6: sweep: needs the key 'cases': how many to draw.",
        ),
        (
            'kind = "list"\nvary = [{ path = "rod.cable.length", values = [1] }, { path = "solve.t", values = [1, 2] }]',
            "8: sweep: a list needs as many values of each path (got rod.cable.length: 1, solve.t: 2).",
        ),
        (
            'vary = [\n{ path = "rod.cable.length", values = [1] },\n{ path = "rod.0.length", values = [1] }]',
            "9: sweep: vary[1].path: rod.0.length is varied by vary[0] already.",
        ),
        ('vary = [{ path = "output.folder", values = ["a"] }]', "7: sweep: vary[0].path: output cannot be varied."),
        (
            'vary = [{ path = "rod.cable.length", range = [1, 2], points = 1000 }, '
            '{ path = "solve.t", range = [0, 1], points = 1000 }]',
            "7: sweep: gives 1e+06 cases; choose at most 100000.",
        ),
        ("vary = []", "7: sweep: vary must have at least 1 entry (got 0)."),
        (
            'kind = "list"\nvarry = []\nvary = [{ path = "solve.t", values = [1] }]',
            "8: sweep: unknown key 'varry'. Did you mean 'vary'?",
        ),
        ('varry = [{ path = "a", values = [1] }]', "7: sweep: unknown key 'varry'. Did you mean 'vary'?"),
        (
            'vary = [{ path = "rod.cable.length", valus = [1] }]',
            "7: sweep: unknown key 'valus'. Did you mean 'values'?",
        ),
    ],
)
def test_faults_stand_at_their_lines(tmp_path, sweep, message):
    with pytest.raises(cf.SceneError) as caught:
        scene(tmp_path, sweep)
    assert any(fault.startswith(f"{tmp_path / 'scene.toml'}:{message}") for fault in caught.value.faults), caught.value
