"""The bench: its problems are solved to what their references say, and its command writes what was measured."""

import json

import numpy as np
import pytest

from cosserat_fem.bench import models, problems
from cosserat_fem.bench.command import read_rows
from cosserat_fem.bench.measure import Row, fastest, front, measure
from cosserat_fem.bench.models import SOLVERS, Case
from cosserat_fem.bench.problems import PROBLEMS
from cosserat_fem.bench.scaling import exponent, one, run_scaling
from cosserat_fem.cli import main
from cosserat_fem.motion.steps import FixedStep

# one cheap case of each problem, and the error that it must not exceed
CASES = [
    ("S1", Case(4, 4), 1e-7),
    ("S2", Case(4, 3), 1e-5),
    ("S3", Case(12, 3), 3e-5),
    ("S4", Case(4, 4), 1e-6),
    ("D1", Case(4, 3, FixedStep(0.1, richardson=True)), 1e-3),
    ("D2", Case(6, 3, FixedStep(0.005)), 2e-3),
    ("D3", Case(6, 3), 1e-4),
    ("B03", Case(16, 3), 1e-4),
    ("C1", Case(24, 4), 3e-4),
]


@pytest.mark.parametrize(("name", "case", "allowed"), CASES, ids=[name for name, _, _ in CASES])
def test_problem(name, case, allowed):
    """The references share no code with us; the errors are those of the resolution."""
    row = measure(name, case, repeats=1)
    assert row.error < allowed
    assert row.cpu > 0 and row.iterations > 0


def test_every_problem_is_measured_at_orders_1_to_4():
    assert list(PROBLEMS) == list(SOLVERS) == [name for name, _, _ in CASES]
    for name, solver in SOLVERS.items():
        planes = models.PLANES if PROBLEMS[name].planar else (None,)
        assert {case.plane for case in solver.cases} == set(planes)
        for plane in planes:
            assert {case.order for case in solver.cases if case.plane == plane} == {1, 2, 3, 4}


def test_errors_are_zero_at_the_references():
    told = problems.references()
    s = np.linspace(0, 1, 7)
    curve = problems.BarycentricInterpolator(told["S3"]["s"], np.array(told["S3"]["r"]))(s)
    exact = {
        "S1": (0, 0, 0),
        "S2": told["S2"]["tip"],
        "S3": (s, curve),
        "S4": told["S4"]["tip"],
        "D1": told["D1"]["ends"],
        "D2": told["D2"]["tip"],
        "D3": told["D3"]["reaction"],
        "B03": told["B03"]["loads"],
        "C1": problems.capstan_exponent(0.3, 0.002, 0.1),
    }
    assert list(exact) == list(PROBLEMS)
    for name, observed in exact.items():
        assert PROBLEMS[name].error(observed) < 1e-15


def test_guess_has_the_length_of_the_cable():
    """Drawn through 2001 places; it starts and ends level at the clamps."""
    r, angle = problems.slack_guess(np.linspace(0, 1, 2001))
    assert np.linalg.norm(np.diff(r, axis=0), axis=1).sum() == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(r[[0, -1]], [(0, 0), (0.6, 0)], atol=1e-12)
    np.testing.assert_allclose(angle[[0, 1000, -1]], 0, atol=1e-6)


def row(error, cpu, tool="cosserat_fem", failed=""):
    return Row("S1", tool, "order 3 in space", "n=4", error, cpu, cpu, 3, 78, 4, failed=failed)


def test_fastest_and_front():
    rows = [row(1e-2, 1.0), row(1e-4, 3.0), row(1e-3, 4.0), row(None, 0.0, failed="lost"), row(1e-6, 9.0)]
    assert fastest(rows, "S1", 1e-3) is rows[1]
    assert fastest(rows, "S1", 1e-7) is None
    assert fastest(rows, "S2", 1.0) is None
    assert front(rows) == [rows[0], rows[1], rows[4]]


def test_command(tmp_path, capsys):
    """Table, JSON and pictures; the peers' rows are drawn and compared."""
    peers = tmp_path / "peers.json"
    theirs = row(1e-3, 1e3, tool="other")
    peers.write_text(json.dumps({"rows": [theirs.__dict__]}))
    out = tmp_path / "out"
    command = ["bench", "--problem", "S1", "--repeats", "1", "--plot", "--peers", str(peers), "-o", str(out)]
    assert main(command) == 0
    told = capsys.readouterr().out
    assert "order 4 in space" in told
    assert "other order 3 in space, n=4 (1.0e-03)" in told
    data = json.loads((out / "bench.json").read_text())
    assert data["machine"]["versions"]["numpy"] == np.__version__
    assert {r["problem"] for r in data["rows"]} == {"S1"}
    assert len(read_rows(out / "bench.json")) == len(SOLVERS["S1"].cases)
    assert (out / "work_precision.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--problem", "S11"], "problem 'S11' does not exist. Did you mean 'S1'?"),
        (["--problem", "S1", "--repeats", "0"], "repeats must be 1 or more (got 0)."),
        (["--problem", "S1", "--peers", "missing.json"], "missing.json: cannot be read: No such file or directory."),
    ],
)
def test_wrong_arguments(arguments, said, tmp_path, capsys):
    assert main(["bench", *arguments, "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_of_others_stay(tmp_path, capsys):
    (tmp_path / "bench.json").write_text("[1, 2]")
    assert main(["bench", "--problem", "S1", "-o", str(tmp_path)]) == 2
    assert "holds 'bench.json' and is not an earlier bench" in capsys.readouterr().err
    (tmp_path / "rows.json").write_text('{"rows": [3]}')
    assert main(["bench", "--problem", "S1", "--peers", str(tmp_path / "rows.json"), "-o", str(tmp_path / "b")]) == 2
    assert "is not a result of the bench" in capsys.readouterr().err


def test_scaling():
    """Sizes are what was asked for, in this process and in their own; the fitted exponent is the slope."""
    assert one("many rods", 3)["elements"] == 30
    study = run_scaling({"one rod": (20,)})["one rod"]
    assert study["rows"][0]["unknowns"] == 6 * 61
    assert study["time_exponent"] is None
    assert exponent([10, 100, 1000], [3, 30, 300]) == pytest.approx(1)
