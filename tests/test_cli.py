"""The command line and the run folder, as a user meets them."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from cosserat_fem.cli import main

SCENE = """
[[section]]
name = "s"
kind = "round"
diameter = "4 mm"
youngs_modulus = "50 MPa"

[[rod]]
name = "cable"
section = "s"
points = [[0, 0, 0], [0.05, 0.03, 0], [0.1, 0, 0]]
n_elements = 6

[[part]]
name = "arm"
motion = { kind = "hinge", axis = [0, 0, 1], angle = "10 deg/s" }

[[support]]
kind = "clamp"
rod = "cable"
at = "start"

[[support]]
kind = "clamp"
rod = "cable"
at = "end"
to = "arm"

[solve]
kind = "quasistatic"
duration = "2 s"

[output]
every = "0.5 s"
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(SCENE)
    return tmp_path / "s.toml"


def test_run_leaves_a_complete_folder(scene, tmp_path, capsys):
    assert main(["run", "s.toml", "--no-pictures"]) == 0
    out = tmp_path / "out" / "s"
    assert sorted(p.name for p in out.iterdir()) == [
        "hinge_torque.csv", "history.vtkhdf", "reactions.csv", "scene.toml", "summary.json",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "converged"
    assert summary["stations"] == {"kept": 5, "first": 0.0, "last": 2.0}
    assert summary["worst_residual"] < 1e-9
    assert summary["physics"]["terms"] == ["internal force"]
    assert summary["stable"] == "stable at every station"
    assert set(summary["seconds"]["wall"]) == {"load", "solve", "compile", "write"}
    rod = summary["rods"]["cable"]
    assert rod["length"]["free"] == pytest.approx(rod["length"]["drawn"])
    assert rod["smallest_bend_radius"]["value"] > 0
    assert rod["from_drawn_route"]["first station"]["value"] > 1e-4
    assert summary["hinges"]["arm"]["largest_torque"]["angle_deg"] in (0.0, 5.0, 10.0, 15.0, 20.0)
    said = capsys.readouterr().out
    assert "cable.end@arm: force up to" in said
    assert "hinge of arm: torque up to" in said
    assert f"Results in {pathlib.Path('out/s')}" in said


def test_earlier_run_is_replaced_only_after_the_scene_was_found_valid(scene, tmp_path, capsys):
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0
    summary = tmp_path / "out" / "s" / "summary.json"
    before = summary.read_text()
    scene.write_text(SCENE.replace("4 mm", "-4 mm"))
    assert main(["run", "s.toml", "--no-pictures"]) == 2
    assert summary.read_text() == before
    assert 's.toml:5: section "s": diameter: must be greater than 0 (got "-4 mm").' in capsys.readouterr().err
    scene.write_text(SCENE.replace("2 s", "1 s"))
    (tmp_path / "out" / "s" / ".history-x1y2.vtkhdf").write_text("left by a killed run")
    assert main(["run", "s.toml", "--no-pictures"]) == 0
    assert json.loads(summary.read_text())["stations"]["kept"] == 3
    assert not list((tmp_path / "out" / "s").glob(".*"))


def test_foreign_folder_is_refused(scene, tmp_path, capsys):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    assert main(["run", "s.toml", "-o", "mine"]) == 2
    assert "holds 'thesis.tex' and is not an earlier run of this program" in capsys.readouterr().err
    assert [p.name for p in folder.iterdir()] == ["thesis.tex"]
    assert main(["run", "s.toml", "-o", "mine", "--force", "--no-pictures", "-q"]) == 0
    assert (folder / "thesis.tex").read_text() == "years of work"
    assert (folder / "summary.json").is_file()
    assert main(["run", "s.toml", "-o", "mine", "--no-pictures", "-q"]) == 2
    assert "holds 'thesis.tex' beside an earlier run" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["run", "s.toml", "-o", "file"]) == 2
    assert "is a file" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="permissions do not bind this user")
def test_unwritable_folder(scene, tmp_path, capsys):
    (tmp_path / "locked").mkdir(mode=0o500)
    assert main(["run", "s.toml", "-o", "locked/out"]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_folder_below_a_file_cannot_be_written(scene, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["run", "s.toml", "-o", "file/out"]) == 2
    assert "output folder 'file/out'" in capsys.readouterr().err


def test_stopped_run_keeps_what_it_found(scene, tmp_path, capsys, monkeypatch):
    """No convergence at the third station: exit 1, partial results written, the reason in summary.json."""
    from dataclasses import replace

    from cosserat_fem.newton import Newton

    for name in ("plain", "guarded"):
        method = getattr(Newton, name)

        def lost(self, state, method=method, **options):
            solved = method(self, state, **options)
            return replace(solved, reason="no convergence") if state.t > 0.6 else solved

        monkeypatch.setattr(Newton, name, lost)
    assert main(["run", "s.toml", "--no-pictures"]) == 1
    out = tmp_path / "out" / "s"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "stopped"
    assert "no equilibrium (no convergence)" in summary["reason"]
    assert summary["stations"]["kept"] == 2
    assert (out / "history.vtkhdf").is_file()
    assert "stopped: static run at t = " in capsys.readouterr().err


def test_interrupt_keeps_what_it_found(scene, tmp_path, monkeypatch):
    """The first Ctrl-C stops after the station under way."""
    import signal

    from cosserat_fem import statics

    inner = statics._travel
    calls = []

    def travel(*arguments):
        calls.append(1)
        if len(calls) == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return inner(*arguments)

    monkeypatch.setattr(statics, "_travel", travel)
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 1
    summary = json.loads((tmp_path / "out" / "s" / "summary.json").read_text())
    assert summary["status"] == "stopped"
    assert summary["stations"]["kept"] == 3


def test_full_disk_is_told(scene, tmp_path, monkeypatch, capsys):
    """A history that cannot be written: exit 1, the reason is told, nothing that looks complete is left."""
    from cosserat_fem import export

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export, "_put", full)
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 1
    out = tmp_path / "out" / "s"
    assert "No space left on device" in capsys.readouterr().err
    assert json.loads((out / "summary.json").read_text())["status"] == "stopped"
    assert not (out / "history.vtkhdf").exists()
    assert not list(out.glob(".*"))


def test_static_scene(scene, tmp_path):
    scene.write_text(
        SCENE.replace('kind = "quasistatic"\nduration = "2 s"', 'kind = "static"\nt = "1 s"').replace(
            '[output]\nevery = "0.5 s"\n', ""
        )
    )
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0
    assert json.loads((tmp_path / "out" / "s" / "summary.json").read_text())["stations"]["first"] == 1.0


def test_check(scene, capsys):
    assert main(["check", "s.toml"]) == 0
    assert "s.toml: fine. 1 rod(s), 114 unknowns, 5 station(s), terms: internal force." in capsys.readouterr().out
    assert main(["check", "none.toml"]) == 2


def test_init_copies_a_scene_that_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "mine"]) == 0
    assert sorted(p.name for p in (tmp_path / "mine").iterdir()) == [
        "hinge_fixed.stl", "hinge_moving.stl", "satellite_hinge.toml",
    ]  # fmt: skip
    assert main(["check", "mine/satellite_hinge.toml"]) == 0
    assert main(["init", "mine"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_export_and_render_need_a_run(scene, tmp_path, capsys):
    assert main(["export", str(tmp_path)]) == 2
    assert "is not a history file" in capsys.readouterr().err
    assert main(["render", str(tmp_path)]) == 2
    assert "is not the folder of a run" in capsys.readouterr().err
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0
    assert main(["export", "out/s", "--format", "pdv"]) == 2
    assert "Did you mean 'pvd'" in capsys.readouterr().err
    assert main(["export", "out/s", "--format", "pvd"]) == 0
    assert (tmp_path / "out" / "s" / "history.pvd").is_file()
    assert len(list((tmp_path / "out" / "s" / "pvd").glob("rods_*.vtu"))) == 5
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0  # our own files do not hinder the next run
    assert not (tmp_path / "out" / "s" / "pvd").exists()


def test_schema_is_json(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert set(schema["properties"]) >= {"section", "rod", "part", "support", "gravity", "load", "solve", "output"}
    assert schema["additionalProperties"] is False


def test_info(capsys):
    assert main(["info"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("cosserat_fem ")
    assert "numba" in said
    assert "compiled kernels in" in said


@pytest.mark.parametrize("arguments", [["runn"], ["run", "--nope"], ["check"], ["render", "x", "--step", "one"]])
def test_wrong_arguments(arguments, capsys):
    assert main(arguments) == 2
    assert "--help" in capsys.readouterr().err


def test_help_is_light():
    """`--help` loads no numerics at all."""
    heavy = ("numpy", "numba", "scipy", "skfem", "pydantic", "pyvista", "meshio", "matplotlib", "h5py")
    code = (
        "import sys; from cosserat_fem.cli import main; main(['--help']); "
        f"print([m for m in {heavy} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "render" in done.stdout


def test_module_runs():
    done = subprocess.run(
        [sys.executable, "-m", "cosserat_fem", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip()


def test_results_do_not_depend_on_pictures(scene, tmp_path, monkeypatch, capsys):
    """If drawing fails the run is fine: exit 0, results complete, the reason told."""
    from cosserat_fem import run

    monkeypatch.setattr(run.sys, "executable", "/bin/false")
    assert main(["run", "s.toml"]) == 0
    assert "No pictures:" in capsys.readouterr().out
    assert np.loadtxt(tmp_path / "out" / "s" / "hinge_torque.csv", delimiter=",", skiprows=1, usecols=3).shape == (5,)


def test_missing_opengl_is_explained(monkeypatch, tmp_path):
    """A drawing process that dies of a signal means no software OpenGL: say which package to install."""
    from cosserat_fem import run

    class Died:
        returncode, stdout, stderr = -11, "", ""

    monkeypatch.setattr(run.subprocess, "run", lambda *a, **k: Died)
    assert "apt-get install libegl1" in run.draw(tmp_path)
