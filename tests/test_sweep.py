"""Sweeps: rows equal single runs, nothing is done twice, a killed worker loses nothing, a failing case is a row."""

import csv
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main
from cosserat_fem.equilibrium import statics
from cosserat_fem.scene import shipped_scene
from cosserat_fem.summary import flat
from cosserat_fem.sweep.command import run_sweep
from cosserat_fem.sweep.rows import Row
from cosserat_fem.sweep.statistics import correlations, envelopes

SCENE = """
title = "many doors"
section = [{ name = "loom", kind = "round", diameter = "8 mm", youngs_modulus = "8 MPa", shear_modulus = "3 MPa" }]
rod = [{ name = "cable", section = "loom", points = [[0, 0, 0], [0.1, 0.05, 0], [0.2, 0, 0]], n_elements = 4 }]
support = [{ kind = "clamp", rod = "cable", at = "start" }, { kind = "clamp", rod = "cable", at = "end", to = "door" }]
solve = { kind = "quasistatic", duration = "1 s" }
output = { every = "0.25 s" }

[[part]]
name = "door"
motion = { kind = "hinge", point = [0.1, 0, 0], axis = [0, 0, 1], angle = "20 deg/s" }

[sweep]
report = ["hinges.door.largest_torque.value", "reactions.cable.start@ground.largest_force.value", "stable"]
vary = [
    { path = "section.loom.youngs_modulus", range = ["8 MPa", "10 MPa"], points = 3 },
    { path = "rod.cable.length", values = ["0.23 m", "-0.2 m"] },
]
"""


def scene_in(folder, text=SCENE):
    folder.mkdir(exist_ok=True)
    file = folder / "doors.toml"
    file.write_text(text)
    return file


def table(folder, name="results.csv"):
    with open(folder / name, newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep in this process: its scene file, its folder."""
    folder = tmp_path_factory.mktemp("swept")
    file = scene_in(folder)
    assert main(["sweep", str(file), "-o", str(folder / "out"), "-q"]) == 0
    return file, folder / "out"


def test_each_case_is_a_row_and_a_failing_one_has_its_reason(swept, tmp_path):
    """Numbers of a row are those of a run of the changed scene; a bad value is refused with its line."""
    file, out = swept
    rows = table(out)
    assert [row["status"] for row in rows] == ["converged", "refused"] * 3
    assert f'{file}:4: rod "cable": length' in rows[1]["reason"]
    assert 'Changed: section.loom.youngs_modulus = 8000000.0, rod.cable.length = "-0.2 m"' in rows[1]["reason"]
    assert rows[1]["hinges.door.largest_torque.value"] == ""
    changes = {"section.loom.youngs_modulus": 9e6, "rod.cable.length": 0.23}
    cf.run_scene(cf.load_scene(file).changed(changes), tmp_path / "run")
    summary = flat(json.loads((tmp_path / "run" / "summary.json").read_text()))
    assert float(rows[2]["section.loom.youngs_modulus"]) == 9e6
    for name in ("hinges.door.largest_torque.value", "reactions.cable.start@ground.largest_force.value"):
        assert float(rows[2][name]) == summary[name] > 0
    assert rows[2]["stable"] == "stable at every station"
    place = out / "cases" / rows[2]["key"]
    assert sorted(p.name for p in place.iterdir()) == [
        "case.json", "hinge_torque.csv", "reactions.csv", "scene.toml", "summary.json",
    ]  # fmt: skip
    assert cf.load_scene(place / "scene.toml").identity.startswith(rows[2]["key"])
    assert (out / "pictures" / "results.svg").is_file()


def test_nothing_is_done_twice(swept, capsys):
    """A second call runs nothing and leaves every file of every case as it is; a missing case alone is made again."""
    file, out = swept
    before = {path: path.stat().st_mtime_ns for path in (out / "cases").rglob("*")}
    assert main(["sweep", str(file), "-o", str(out)]) == 0
    assert "6 cases, 0 run now, 3 converged" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in (out / "cases").rglob("*")} == before
    results = (out / "results.csv").read_text()
    gone = out / "cases" / table(out)[0]["key"]
    for path in gone.iterdir():
        path.unlink()
    gone.rmdir()
    assert main(["sweep", str(file), "-o", str(out)]) == 0
    assert "6 cases, 1 run now" in capsys.readouterr().out
    assert (out / "results.csv").read_text() == results


def test_a_stopped_sweep_keeps_what_it_has_and_goes_on(swept, tmp_path):
    file, out = swept
    scene = cf.load_scene(file)
    found = run_sweep(scene, tmp_path / "out", progress=lambda done, total: done == 2)
    assert (found.run, found.count("missing"), found.notes[-1][:9]) == (2, 4, "4 not run")
    assert [row["status"] for row in table(tmp_path / "out")] == ["converged", "refused"] + ["missing"] * 4
    found = run_sweep(scene, tmp_path / "out")
    assert (found.run, found.count("missing")) == (4, 0)
    for name in ("results.csv", "torque_envelope.csv", "correlations.csv"):
        assert (tmp_path / "out" / name).read_text() == (out / name).read_text()


def test_an_interrupted_case_is_no_row(swept, tmp_path, monkeypatch, capsys):
    """Ctrl-C in the middle of a stroke: the case is not there, what was done before is, and the next call goes on."""
    travel, calls = statics._travel, []

    def press(*arguments):
        calls.append(1)
        if len(calls) == 6:  # second station of the second case
            raise KeyboardInterrupt
        return travel(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(statics, "_travel", press)
        assert main(["sweep", str(swept[0]), "-o", str(tmp_path / "out"), "--no-pictures"]) == 1
    assert "interrupted" in capsys.readouterr().err
    assert [row["status"] for row in table(tmp_path / "out")] == ["converged", "refused"] + ["missing"] * 4
    assert not list((tmp_path / "out" / "cases").glob(".*"))
    assert main(["sweep", str(swept[0]), "-o", str(tmp_path / "out"), "--no-pictures"]) == 0
    assert (tmp_path / "out" / "results.csv").read_text() == (swept[1] / "results.csv").read_text()


def kill_first_worker(folder, killed):
    """Kill the process that writes the first case which another process than this one has begun."""
    for _ in range(60_000):
        for place in (folder / "cases").glob(".*-*-*"):
            pid = int(place.name.split("-")[1])
            if pid != os.getpid():
                os.kill(pid, signal.SIGKILL)
                killed.append((pid, place.name))
                return
        time.sleep(0.001)


def test_a_killed_worker_loses_nothing(swept, tmp_path):
    """The process of a case is killed in the middle of it; all rows are there, and equal to those made in one process."""
    pytest.importorskip("distributed", reason="workers need the extra `cluster`")
    file, out = swept
    killed = []
    killer = threading.Thread(target=kill_first_worker, args=(tmp_path / "out", killed))
    killer.start()
    found = run_sweep(cf.load_scene(file), tmp_path / "out", workers=1)
    killer.join()
    assert len(killed) == 1
    assert (found.run, found.count("lost"), found.notes[0][:9]) == (6, 0, "3 refused")
    assert (tmp_path / "out" / "results.csv").read_text() == (out / "results.csv").read_text()
    assert not list((tmp_path / "out" / "cases").glob(".*"))


def test_a_scheduler_that_is_there_runs_cases(swept, tmp_path, monkeypatch, capsys):
    """Rows from a cluster of somebody else's equal those of one process; an address where nobody answers is told."""
    distributed = pytest.importorskip("distributed", reason="workers need the extra `cluster`")
    file, out = swept
    options = {
        "n_workers": 1,
        "threads_per_worker": 1,
        "processes": False,
        "protocol": "tcp",
        "dashboard_address": None,
    }
    with distributed.LocalCluster(host="127.0.0.1", silence_logs=50, **options) as cluster:
        address = cluster.scheduler_address
        assert main(["sweep", str(file), "-o", str(tmp_path / "out"), "--scheduler", address, "--no-pictures"]) == 0
    assert "6 cases, 6 run now, 3 converged" in capsys.readouterr().out
    assert (tmp_path / "out" / "results.csv").read_text() == (out / "results.csv").read_text()
    monkeypatch.setattr("cosserat_fem.sweep.cluster.CONNECT", 0.2)
    assert main(["sweep", str(file), "-o", str(tmp_path / "other"), "--scheduler", address]) == 2
    assert f"scheduler '{address}': cannot be reached" in capsys.readouterr().err


def test_workers_without_the_extra_are_refused(swept, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["sweep", str(swept[0]), "-o", str(tmp_path / "out"), "--workers", "2"]) == 2
    assert "pip install 'cosserat_fem[cluster]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--workers", "0"], "--workers: must be at least 1 (got 0)."),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "--workers: go with --workers, or with --scheduler"),
    ],
)
def test_wrong_arguments(swept, arguments, message, capsys):
    assert main(["sweep", str(swept[0]), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_scene_without_a_sweep_and_a_foreign_folder_are_refused(swept, tmp_path, capsys):
    file = scene_in(tmp_path / "a", SCENE.split("[sweep]")[0])
    assert main(["sweep", str(file), "-o", str(tmp_path / "out")]) == 2
    assert "has no [sweep] that says what to vary" in capsys.readouterr().err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    assert main(["sweep", str(swept[0]), "-o", str(tmp_path / "full")]) == 2
    assert "holds 'notes.txt' and is not that of an earlier such study" in capsys.readouterr().err
    assert main(["check", str(swept[0])]) == 0
    assert "Sweep: 6 case(s)." in capsys.readouterr().out


def test_plots_are_drawn_again_from_the_folder_alone(swept, tmp_path, capsys):
    shutil.copytree(swept[1], tmp_path / "out", ignore=shutil.ignore_patterns("pictures", "cases"))
    assert main(["render", str(tmp_path / "out")]) == 0
    drawn = sorted(path.name for path in (tmp_path / "out" / "pictures").iterdir())
    assert drawn == sorted(path.name for path in (swept[1] / "pictures").iterdir())
    assert {"results.png", "torque_envelope.svg"} <= set(drawn)
    assert main(["render", str(tmp_path / "out"), "--film"]) == 2
    assert "is not the folder of a run" in capsys.readouterr().err


def test_cases_of_a_scene_with_checks_have_a_verdict(tmp_path):
    """SAFE is said only of what is known, so discretisation errors are estimated though the sweep does not ask for them."""
    text = SCENE.replace(
        "[sweep]",
        '[checks]\nreaction_force = [{ limit = "0.6 N", support = "cable.start@ground", name = "pull" }]\n\n[sweep]',
    )
    text = text.replace("report = [", 'report = ["verdict", "checks.pull.margin.error", ').replace(', "-0.2 m"', "")
    assert main(["sweep", str(scene_in(tmp_path, text)), "-o", str(tmp_path / "out"), "-q", "--no-pictures"]) == 0
    for case in table(tmp_path / "out"):
        force = float(case["reactions.cable.start@ground.largest_force.value"])
        assert 0 < float(case["checks.pull.margin.error"]) < 0.02
        assert case["verdict"] == ("SAFE" if force < 0.6 else "UNSAFE")
    assert {case["verdict"] for case in table(tmp_path / "out")} == {"SAFE", "UNSAFE"}


def test_what_nobody_reports_is_told(swept, tmp_path):
    file = scene_in(tmp_path, SCENE.replace("hinges.door.", "hinges.dor."))
    shutil.copytree(swept[1], tmp_path / "out")
    found = run_sweep(cf.load_scene(file), tmp_path / "out")  # same cases, so nothing is run
    assert found.run == 0
    assert (
        "no case reports 'hinges.dor.largest_torque.value'. Did you mean 'hinges.door.largest_torque.value'?"
        in found.notes
    )


def test_a_case_that_the_machine_ended_is_tried_again(swept, tmp_path, monkeypatch, capsys):
    """Out of memory is no result: the row says so, the exit code too, and the next call runs the case."""
    file, out = swept

    def full(*arguments, **options):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr("cosserat_fem.solving.solve_quasistatic", full)
        assert main(["sweep", str(file), "-o", str(tmp_path / "out"), "-q", "--no-pictures"]) == 1
    assert [row["status"] for row in table(tmp_path / "out")] == ["lost", "refused"] * 3
    assert "out of memory" in table(tmp_path / "out")[0]["reason"]
    assert main(["sweep", str(file), "-o", str(tmp_path / "out"), "--no-pictures"]) == 0
    assert "6 cases, 3 run now" in capsys.readouterr().out
    assert (tmp_path / "out" / "results.csv").read_text() == (out / "results.csv").read_text()


def row(k, changes, values, status="converged"):
    return Row(k, f"key{k}", changes, status, "", values)


def test_rank_correlation_finds_what_matters():
    """A result that grows with the cube of one value and not with another: 1 and little; stopped cases do not count."""
    rng = np.random.default_rng(1)
    rows = [row(k, {"a": x, "b": y}, {"r": x**3}) for k, (x, y) in enumerate(rng.normal(size=(50, 2)))]
    rows += [row(99, {"a": 1e3, "b": 1e3}, {"r": -1e9}, "stopped")]
    first, second = correlations(rows, ["r"])
    assert (first.varied, first.rho, first.count) == ("a", pytest.approx(1.0), 50)
    assert (second.varied, abs(second.rho) < 0.3) == ("b", True)
    assert first.p_value < 1e-10 < 0.05 < second.p_value
    turned = [row(k, {"a": float(k)}, {"hinges.h.largest_torque.value": (-1) ** k * k}) for k in range(9)]
    assert correlations(turned, ["hinges.h.largest_torque.value"])[0].rho == pytest.approx(1.0)  # whichever way it acts


def test_envelope_is_that_of_the_cases_on_each_way(tmp_path):
    """Torque k * angle out and k * angle + 1 back, k = 0 ... 20, stations of their own: percentiles of k, way by way."""
    rows = []
    for k in range(21):
        out = np.linspace(0, 90, 11 + k)
        angle = np.concatenate([out, out[-2::-1]])
        torque = k * angle + (np.arange(len(angle)) >= len(out) - 0.5)
        torque[len(out) - 1] = k * 90  # it turns here
        place = tmp_path / "cases" / f"key{k}"
        place.mkdir(parents=True)
        lines = [f"{t},door,{a},{m}" for t, (a, m) in enumerate(zip(angle, torque, strict=True))]
        (place / "hinge_torque.csv").write_text("\n".join(["time,part,angle_deg,torque", *lines]) + "\n")
        rows.append(row(k, {}, {}))
    out, back = envelopes(tmp_path, rows)
    assert (out.way, back.way, out.count, len(out.angle)) == (0, 1, 21, 31)
    np.testing.assert_allclose(out.bands, np.outer([0, 1, 10, 19, 20], out.angle), atol=1e-9)
    assert (back.angle[0], back.angle[-1]) == (90, 0)
    inside = back.angle < 80
    np.testing.assert_allclose(back.bands[:, inside], np.outer([0, 1, 10, 19, 20], back.angle[inside]) + 1, atol=1e-9)


def test_result_folder_cannot_be_written(swept, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["sweep", str(swept[0]), "-o", str(tmp_path / "file")]) == 2
    assert "is a file" in capsys.readouterr().err
    assert pathlib.Path(tmp_path / "file").read_text() == ""


def cpu_ticks(session):
    """CPU ticks of each living process of a session."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(stat[3]) == session:
                found[int(entry.name)] = int(stat[11]) + int(stat[12])
    return found


def watched(arguments, kill_at=None):
    """CPU seconds of all processes of a sweep; the process of a case is killed when so many cases are there."""
    command = [sys.executable, "-m", "cosserat_fem", "sweep", *map(str, arguments), "--no-pictures"]
    sweep = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )
    cases, seen = arguments[2] / "cases", {}
    while sweep.poll() is None:
        seen |= cpu_ticks(sweep.pid)
        if kill_at is not None and len(list(cases.glob("[0-9a-f]*"))) >= kill_at:
            for place in list(cases.glob(".*-*-*"))[:1]:
                os.kill(int(place.name.split("-")[1]), signal.SIGKILL)
                kill_at = None
        time.sleep(0.02)
    assert kill_at is None
    said = sweep.stdout.read()
    sweep.stdout.close()
    return sum(seen.values()) / os.sysconf("SC_CLK_TCK"), said


@pytest.mark.slow
@pytest.mark.skipif(not pathlib.Path("/proc/self/stat").exists(), reason="CPU time of all processes is read from /proc")
def test_two_workers_cost_little_more_than_one_process(tmp_path):
    """200 cases of the satellite hinge: at most 1.3 times the CPU time, a worker killed on the way, none lost."""
    pytest.importorskip("distributed", reason="workers need the extra `cluster`")
    text = shipped_scene().read_text()
    for mesh in ("hinge_fixed.stl", "hinge_moving.stl"):
        text = text.replace(mesh, str(shipped_scene().parent / mesh))
    text += """
[sweep]
kind = "latin_hypercube"
cases = 200
seed = 3
report = ["hinges.panel.largest_torque.value", "rods.cable.smallest_bend_radius.value"]
vary = [
    { path = "rod.cable.length", range = ["195 mm", "210 mm"] },
    { path = "section.cable.youngs_modulus", normal = ["527 MPa", "30 MPa"] },
    { path = "part.panel.motion.point.0", normal = [0, "1 mm"] },
]
"""
    file = scene_in(tmp_path, text)
    one, said = watched([file, "-o", tmp_path / "one"])
    assert "200 cases, 200 run now, 200 converged" in said
    two, said = watched([file, "-o", tmp_path / "two", "--workers", "2"], kill_at=100)
    assert "200 cases, 200 run now, 200 converged" in said
    assert (tmp_path / "two" / "results.csv").read_text() == (tmp_path / "one" / "results.csv").read_text()
    assert two <= 1.3 * one
    assert "200 cases, 0 run now" in watched([file, "-o", tmp_path / "two", "--workers", "2"])[1]
