"""Designs: the best of a box under limits is found, proved by a run of its own, and every trial is written."""

import csv
import json
import logging
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.accuracy.transfer import Transfer
from cosserat_fem.cli import main
from cosserat_fem.design.command import run_design
from cosserat_fem.design.search import best, front, search
from cosserat_fem.design.trial import Trial, Trials
from cosserat_fem.equilibrium import statics
from cosserat_fem.scene import build_scene, shipped_scene
from cosserat_fem.scene.load import parse

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"

CANTILEVER = """
section = [{ name = "s", kind = "general", force_stiffness = [1e6, 1e6, 1e6], moment_stiffness = [1, 1, 1] }]
rod = [{ name = "beam", section = "s", points = [[0, 0, 0], [1, 0, 0]], n_elements = 2, normal = [0, 0, 1] }]
support = [{ kind = "clamp", name = "wall", rod = "beam", at = "start" }]
load = [{ kind = "point", rod = "beam", at = "end", force = [0, 0, "-0.01 N"] }]
solve = { kind = "static" }
"""


def design(text, tmp_path, limits="", **keys):
    """A scene with a design of its load."""
    vary = keys.pop("vary", '{ path = "load.0.force.2", range = [-0.05, -0.001] }')
    extra = "".join(f"{key} = {value}\n" for key, value in keys.items())
    table = f'\n[design]\nminimise = "load.0.force.2"\nvary = [{vary}]\nlimits = [{limits}]\n{extra}'
    return build_scene(parse(tmp_path / "beam.toml", text + table))


BEAM = "points = [[0, 0, 0], [0.1, 0, 0]]"
MOMENT = '{ result = "reactions.wall.largest_moment.value", most = "20 N mm" }'
FORCE = '{ result = "reactions.wall.largest_force.value", most = "10 mN" }'


@pytest.mark.parametrize(
    ("limits", "load", "active"), [(MOMENT, 0.02, "moment"), (f"{MOMENT}, {FORCE}", 0.01, "force")]
)
def test_the_largest_load_is_where_a_limit_says(tmp_path, limits, load, active):
    """A cantilever of 1 m under an end load F: moment F l at its root, up to its shortening. F = 20 N mm / 1 m, or 10 mN."""
    scene = design(CANTILEVER, tmp_path, limits)
    found = run_design(scene, tmp_path / "out")
    assert found.complete
    assert -found.best.changes["load.0.force.2"] == pytest.approx(load, rel=1e-3)
    assert found.best.feasible
    about = json.loads((tmp_path / "out" / "design.json").read_text())
    assert [active in text for text in about["best"]["active"]] == [True]
    # both equilibria are met to the round-off of places, 4 eps EA L / h = 9e-10 N
    assert about["check"]["largest_difference"] < 2 * 9e-10 / load
    assert cf.load_scene(tmp_path / "out" / "best.toml").tables.load[0].force[2] == found.best.changes["load.0.force.2"]
    with open(tmp_path / "out" / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.trials) < 40
    largest = max(-float(row["load.0.force.2"]) for row in rows if row["keeps"] == "true")
    assert largest == -found.best.changes["load.0.force.2"]
    assert min(-float(row["load.0.force.2"]) for row in rows if row["keeps"] == "false") <= load * 1.001


def test_checks_of_the_scene_are_kept_with_the_margin_asked_for(tmp_path):
    """The moment at the root may be 20 N mm; with 5 % of it left the load is 19 mN. A limit that is missed is told."""
    scene = design(CANTILEVER + 'checks = { reaction_moment = "20 N mm" }', tmp_path, margin=0.05)
    found = run_design(scene, tmp_path / "out")
    assert -found.best.changes["load.0.force.2"] == pytest.approx(0.019, rel=1e-3)
    assert found.safe
    about = json.loads((tmp_path / "out" / "design.json").read_text())
    assert about["check"]["verdict"] == "SAFE"
    assert about["best"]["limits"][0]["margin"] == pytest.approx(0.05, abs=1e-3)
    assert about["best"]["active"][0].startswith("check ")


def test_both_ends_of_a_stiffness_band_count(tmp_path):
    """Tip load that bends a wire of the catalogue to a radius of 500 mm: with slipping strands it is less.

    Curvature at the root F l / EI, so the least EI of the band tells: F = EI / (l R), short of shortening.
    """
    text = CANTILEVER.replace('section = "s"', 'section = "M22759/16-22"').replace(
        "points = [[0, 0, 0], [1, 0, 0]]", BEAM
    )
    text = "\n".join(line for line in text.splitlines() if not line.startswith("section"))
    limit = '{ result = "rods.beam.smallest_bend_radius.value", least = "500 mm" }'
    vary = '{ path = "load.0.force.2", range = [-0.05, -0.0001] }'
    found = run_design(design(text, tmp_path, limit, vary=vary), tmp_path / "out")
    low, high = cf.cable_named("M22759/16-22").bending_stiffness
    assert high > 1.5 * low
    assert -found.best.changes["load.0.force.2"] == pytest.approx(low / (0.1 * 0.5), rel=0.01)


def test_two_limits_meet_in_a_corner(tmp_path):
    """Least -(Fy + Fz) ... as Fz alone with Fy fixed by its limit: the load turns in the box, the force stays 10 mN.

    Variables: the load's y and z; the limit |F| <= 10 mN is a circle, so the least Fz is on the axis: Fy = 0, Fz = -10 mN.
    """
    vary = '{ path = "load.0.force.2", range = [-0.05, -0.001] }, { path = "load.0.force.1", range = [-0.02, 0.03] }'
    trials = Trials(design(CANTILEVER, tmp_path, FORCE, vary=vary))
    assert search(trials)
    x = trials.x(best(trials).u)
    np.testing.assert_allclose(x, [-0.01, 0.0], atol=1e-4)
    assert np.hypot(*x) <= 0.01 * (1 + 1e-9)


def test_no_design_keeps_the_limits(tmp_path, capsys):
    """The one that breaks them least is shown, and the exit code says so."""
    file = tmp_path / "beam.toml"
    limit = '{ result = "reactions.wall.largest_force.value", most = "0.1 mN" }'
    file.write_text(design(CANTILEVER, tmp_path, limit).source.text)
    assert main(["design", str(file), "-o", str(tmp_path / "out"), "--no-pictures"]) == 3
    said = capsys.readouterr().out
    assert "no design keeps all limits; the one that breaks them least:" in said
    assert "load.0.force.2 = -0.001" in said


def test_designs_that_cannot_be_are_trials_too(tmp_path):
    """A load beyond the end of the rod is refused, with its reason; the least place that needs 8 N mm is at 0.8 m."""
    vary = '{ path = "load.0.at", range = [0.5, 1.5] }'
    limit = '{ result = "reactions.wall.largest_moment.value", least = "8 N mm" }'
    text = CANTILEVER.replace('at = "end"', "at = 1.0")
    scene = design(text, tmp_path, limit, vary=vary)
    scene = build_scene(
        parse(scene.source.path, scene.source.text.replace('"load.0.force.2"\nvary', '"load.0.at"\nvary'))
    )
    found = run_design(scene, tmp_path / "out")
    assert found.best.changes["load.0.at"] == pytest.approx(0.8, rel=1e-3)
    with open(tmp_path / "out" / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert all(("is not on rod 'beam'" in row["reason"]) == (float(row["load.0.at"]) > 1) for row in rows)


def test_runs_end(tmp_path):
    """No more designs are run than allowed; the best of them is kept, and that it is not the last word is told."""
    found = run_design(design(CANTILEVER, tmp_path, MOMENT, runs=5), tmp_path / "out")
    assert (len(found.trials), found.complete) == (5, False)
    assert found.lines[0] == "stopped after 5 designs; [design] runs allows 5."


def test_an_interrupted_design_keeps_what_it_has(tmp_path, monkeypatch, capsys):
    """Ctrl-C in the middle of a stroke: that design is none, those before are written, the exit code is 1."""
    text = shipped_scene().read_text().replace("1 s", "30 s")
    for old, new in BARE.values():
        text = text.replace(old, new)
    file = tmp_path / "hinge.toml"
    file.write_text(f"{text}\n[design]{LOOP}")
    travel, calls = statics._travel, []

    def press(*arguments):
        calls.append(1)
        if len(calls) == 8:  # third design of three steps each
            raise KeyboardInterrupt
        return travel(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(statics, "_travel", press)
        assert main(["design", str(file), "-o", str(tmp_path / "out"), "--no-pictures"]) == 1
    assert "2 designs run" in capsys.readouterr().out
    assert len((tmp_path / "out" / "trials.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"load.0.force.2", range',
            '"load.0.forse.2", range',
            "10: design: vary[0].path 'load.0.forse.2': there is no 'for",
        ),
        ("[-0.05, -0.001]", '["1 m", "2 m"]', "10: design: vary[0].range[0]: load 1: force is not a force; write for"),
        ("[-0.05, -0.001]", "[2, 1]", "10: design: vary[0].range must go up (got 2 to 1)."),
        (
            "[-0.05, -0.001] }",
            '[0, "1 deg"], axis = [0, 1, 0] }',
            "10: design: vary[0].path: what an axis turns is a dir",
        ),
        (', most = "20 N mm"', "", "11: design: limits[0] needs 'least' or 'most'."),
        ("limits = ", "tolerance = 2\nlimits = ", "11: design: tolerance must be above 0 and below 0.5 (got 2)."),
        ("limits = ", "runs = 0\nlimits = ", "11: design: runs must be at least 1 (got 0)."),
        ("limits = ", "limit = ", "11: design: unknown key 'limit'. Did you mean 'limits'?"),
        (
            'kind = "static"',
            'kind = "dynamic", duration = 1',
            '8: design: needs solve.kind = "static" or "quasistatic"',
        ),
    ],
)
def test_faults_stand_at_their_lines(tmp_path, old, new, message):
    text = design(CANTILEVER, tmp_path, MOMENT).source.text
    assert old in text
    with pytest.raises(cf.SceneError) as caught:
        build_scene(parse(tmp_path / "beam.toml", text.replace(old, new)))
    assert any(fault.startswith(f"{tmp_path / 'beam.toml'}:{message}") for fault in caught.value.faults), caught.value


def test_a_result_that_is_not_there_is_told(tmp_path, capsys):
    """Names of results are known after the first run: then they are faults of the scene, with their lines."""
    file = tmp_path / "beam.toml"
    file.write_text(design(CANTILEVER, tmp_path, MOMENT.replace("wall", "wal")).source.text)
    assert main(["design", str(file), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert f"{file}:11: design: no result is called 'reactions.wal.largest_moment.value'. Did you mean" in said


def test_the_front_has_no_design_that_another_beats():
    rng = np.random.default_rng(3)

    class Some:
        done = tuple(
            Trial(k, np.zeros(1), {}, results={"a": float(a), "b": float(b)})
            for k, (a, b) in enumerate(rng.random((200, 2)))
        )

    points = np.array([[t.results["a"], t.results["b"]] for t in Some.done])
    beaten = np.array([((points <= p).all(axis=1) & (points < p).any(axis=1)).any() for p in points])
    assert {t.number for t in front(Some, "a", "b")} == set(np.flatnonzero(~beaten).tolist())
    assert (np.diff([t.results["a"] for t in front(Some, "a", "b")]) > 0).all()


def satellite_hinge(folder, design, **changes):
    """The shipped scene with a design, and text of it changed."""
    text = shipped_scene().read_text()
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    return build_scene(parse(folder / "hinge.toml", text + "[design]\n" + design))


LOOP = """
minimise = "hinges.panel.largest_torque.value"
vary = [{ path = "rod.cable.length", range = ["280 mm", "320 mm"] },
        { path = "rod.cable.start_tangent", axis = [0, 0, 1], range = ["-30 deg", "30 deg"] }]
limits = [{ result = "rods.cable.smallest_bend_radius.value", least = "34 mm" },
          { result = "reactions.fixed end.largest_force.value", most = "2 N" }]
tolerance = 5e-3
tradeoff = ["hinges.panel.largest_torque.value", "rod.cable.length"]
"""
BARE = {mesh: (f'mesh = "{mesh}.stl"\nmesh_unit = "mm"\n', "") for mesh in ("hinge_fixed", "hinge_moving")}
FEW = BARE | {"every": ('every = "1 s"', 'every = "6 s"'), "elements": ("n_elements = 16", "n_elements = 8")}


@pytest.fixture(scope="module")
def hinge(tmp_path_factory):
    return satellite_hinge(tmp_path_factory.mktemp("hinge"), LOOP, **FEW)


def test_length_and_exit_angle_that_need_least_torque(hinge, tmp_path):
    """No design of an independent grid, each run by itself from its own drawing, keeps the limits with less torque."""
    logging.getLogger("cosserat_fem").setLevel(logging.ERROR)
    found = run_design(hinge, tmp_path / "out")
    tangent = hinge.model.rods[0].frames(np.array([0.0]))[0, :, 2]
    least = np.inf
    for length in (0.28, 0.3, 0.32):
        for turn in np.radians([-30, -18, -10, 0, 30]):
            c, s = np.cos(turn), np.sin(turn)
            turned = [c * tangent[0] - s * tangent[1], s * tangent[0] + c * tangent[1], 0.0]
            other = hinge.changed({"rod.cable.length": length, "rod.cable.start_tangent": turned})
            history = cf.solve_quasistatic(other.model, other.times)
            tight = cf.bend_radius(history, "cable", at="nodes").min() < 0.034
            force = np.linalg.norm(history.reaction(other.model.supports[0])[:, :3], axis=1).max()
            if not tight and force <= 2:
                least = min(least, np.abs(history.hinge_torque(other.parts[1])).max())
    assert found.best.objective <= least < np.inf
    assert "says the same" in found.lines[-1]
    with open(tmp_path / "out" / "tradeoff.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    torque = [float(row["hinges.panel.largest_torque.value"]) for row in rows]
    assert torque == sorted(torque)
    assert len(rows) > 2


def test_a_state_goes_to_a_rod_of_another_length(hinge):
    """Stretched evenly: the shape is the same at the same part of the length, and Newton goes on from there."""
    long = hinge.changed({"rod.cable.length": 0.3})
    short = hinge.changed({"rod.cable.length": 0.28, "rod.cable.layer": 0.01})  # other elements, too
    state = cf.solve_static(short.model).final
    moved = Transfer(short.model, long.model).state(state)
    ends = [view.nodes[[0, -1]] for model in (short.model, long.model) for view in model.space.views.values()]
    np.testing.assert_allclose(moved.r[ends[1]], state.r[ends[0]], atol=1e-15)
    found = cf.solve_static(long.model, start=moved)
    np.testing.assert_allclose(found.final.r, cf.solve_static(long.model).final.r, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("force", "length", "active"), [("50 N", 0.2963, "bend"), ("2 N", 0.3079, "force")])
def test_how_long_the_cable_of_the_satellite_hinge_must_be(tmp_path, force, length, active):
    """Shortest cable with at most this force and a centreline of at least six diameters over the stroke.

    Held against an independent scan of lengths every 0.1 mm, each run by itself from the drawn route.
    """
    example = EXAMPLES / "longer_cable.toml"
    scene = build_scene(parse(example, example.read_text().replace('most = "2 N"', f'most = "{force}"')))
    found = run_design(scene, tmp_path / "out")
    chosen = found.best.changes["rod.cable.length"]
    assert chosen == pytest.approx(length, abs=2e-4)
    about = json.loads((tmp_path / "out" / "design.json").read_text())
    assert all(active in text for text in about["best"]["active"])

    def keeps(value):
        other = scene.changed({"rod.cable.length": value})
        history = cf.solve_quasistatic(other.model, other.times)
        forces = [np.linalg.norm(history.reaction(h)[:, :3], axis=1).max() for h in other.model.supports]
        radius = cf.bend_radius(history, "cable", at="nodes").min()
        return max(forces) <= float(force.split()[0]) and radius >= 0.023649

    lengths = np.concatenate([np.arange(0.2, length - 0.002, 0.002), np.arange(length - 0.002, length + 0.002, 1e-4)])
    first = next(value for value in lengths if keeps(float(value)))
    assert first - 1.1e-4 <= chosen <= first + 2e-5
