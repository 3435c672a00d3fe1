"""The command line and the run folder, as a user meets them."""

import json
import os
import pathlib
import signal
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
    assert set(summary["seconds"]["wall"]) == {"load", "solve", "compile", "write", "estimate"}
    peak = summary["reactions"]["cable.start@ground"]["largest_force"]
    assert 0 < peak["error"] < 1e-3 * peak["value"]
    assert summary["discretisation"]["iterations"] < summary["counters"]["iterations"] * 3
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
    (tmp_path / "out" / "s" / ".history-x1y2z3_4.vtkhdf").write_text("left by a killed run")
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

    from cosserat_fem.iteration.newton import Newton

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


def press_ctrl_c(monkeypatch, at, times=1):
    """Ctrl-C while the given station is sought, as often as told."""
    from cosserat_fem.equilibrium import statics

    inner, calls = statics._travel, []

    def travel(*arguments):
        calls.append(1)
        for _ in range(times if len(calls) == at else 0):
            os.kill(os.getpid(), signal.SIGINT)
        return inner(*arguments)

    monkeypatch.setattr(statics, "_travel", travel)


@pytest.mark.parametrize(("times", "kept"), [(1, 3), (2, 2)])
def test_interrupt_keeps_what_it_found(scene, tmp_path, monkeypatch, capsys, times, kept):
    """The first Ctrl-C stops after the station under way, the second at once; no pictures are begun."""
    press_ctrl_c(monkeypatch, 2, times)
    assert main(["run", "s.toml"]) == 1
    out = tmp_path / "out" / "s"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "stopped"
    assert summary["stations"]["kept"] == kept
    assert sorted(p.name for p in out.iterdir()) == [
        "hinge_torque.csv", "history.vtkhdf", "reactions.csv", "scene.toml", "summary.json",
    ]  # fmt: skip
    said = capsys.readouterr()
    assert "Results in out/s" in said.out
    assert "`cosserat-fem render out/s` draws them" in said.err


def test_interrupt_in_python_keeps_what_it_found(scene, tmp_path, monkeypatch):
    import cosserat_fem as cf

    press_ctrl_c(monkeypatch, 2)
    outcome = cf.run_scene(cf.load_scene("s.toml"))
    assert len(outcome.history) == 2
    assert outcome.complete
    assert "interrupted" in outcome.reason
    assert (tmp_path / "out" / "s" / "history.vtkhdf").is_file()
    assert not list((tmp_path / "out" / "s").glob(".*"))


STATIC = SCENE.replace('kind = "quasistatic"\nduration = "2 s"', 'kind = "static"\nt = "1 s"').replace(
    '[output]\nevery = "0.5 s"\n', ""
)


def test_interrupt_stops_a_static_run_at_once(scene, tmp_path, monkeypatch, capsys):
    from cosserat_fem.equilibrium import statics

    inner = statics._equilibrium

    def equilibrium(*arguments, **options):
        os.kill(os.getpid(), signal.SIGINT)
        return inner(*arguments, **options)

    monkeypatch.setattr(statics, "_equilibrium", equilibrium)
    scene.write_text(STATIC)
    assert main(["run", "s.toml"]) == 1
    said = capsys.readouterr()
    assert (said.out, said.err) == ("s\n", "stopped: interrupted\n")
    assert json.loads((tmp_path / "out" / "s" / "summary.json").read_text())["reason"] == "interrupted"


def test_interrupt_of_the_pictures_is_one_line(scene, monkeypatch, capsys):
    from cosserat_fem import drawing

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawing.subprocess, "run", interrupted)
    assert main(["run", "s.toml", "-q"]) == 1
    assert capsys.readouterr().err == (
        "no pictures: interrupted. All results are written; `cosserat-fem render out/s` draws them.\n"
    )


def test_full_disk_is_told(scene, tmp_path, monkeypatch, capsys):
    """A history that cannot be written: exit 1, the reason is told, nothing that looks complete is left."""
    from cosserat_fem import export

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export, "_put", full)
    assert main(["run", "s.toml", "--no-pictures"]) == 1
    out = tmp_path / "out" / "s"
    said = capsys.readouterr()
    assert said.err == "stopped: history.vtkhdf could not be written: No space left on device\n"
    assert "Results in" not in said.out
    assert "Incomplete results in out/s: reactions.csv, hinge_torque.csv" in said.out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "stopped"
    assert summary["reason"] == "history.vtkhdf could not be written: No space left on device"
    assert not (out / "history.vtkhdf").exists()
    assert not list(out.glob(".*"))


@pytest.mark.skipif(os.name != "posix", reason="limits of a process are POSIX")
def test_full_disk_is_survived(scene, tmp_path):
    """A real one, from the system: HDF5 would print its stack and crash."""
    import resource

    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0  # kernels are on the disk
    code = "import sys; from cosserat_fem.cli import main; sys.exit(main(['run', 's.toml', '--no-pictures', '-q']))"
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # noqa: E731
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, preexec_fn=limit)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "stopped: history.vtkhdf could not be written: File too large\n"
    out = tmp_path / "out" / "s"
    assert sorted(p.name for p in out.iterdir()) == ["hinge_torque.csv", "reactions.csv", "scene.toml", "summary.json"]
    assert "File too large" in json.loads((out / "summary.json").read_text())["reason"]


def test_summary_that_cannot_be_written_is_told(scene, tmp_path, monkeypatch, capsys):
    from cosserat_fem.results import ResultWriter

    inner = ResultWriter.summary

    def full(self, status, *arguments):
        if status != "running":
            raise OSError(28, "No space left on device")
        inner(self, status, *arguments)

    monkeypatch.setattr(ResultWriter, "summary", full)
    assert main(["run", "s.toml", "--no-pictures"]) == 1
    said = capsys.readouterr()
    assert said.err == "stopped: summary.json could not be written: No space left on device\n"
    assert "Results in" in said.out


def test_out_of_memory_is_one_line(scene, tmp_path, monkeypatch, capsys):
    """While solving, while writing, and anywhere else."""
    from cosserat_fem import export, solving
    from cosserat_fem import scene as rooms

    def full(*arguments, **options):
        raise MemoryError("Unable to allocate 7.0 TiB")

    line = "out of memory (Unable to allocate 7.0 TiB). Use fewer elements or stations.\n"
    with monkeypatch.context() as patch:
        patch.setattr(solving, "solve_quasistatic", full)
        assert main(["run", "s.toml", "--no-pictures", "-q"]) == 1
    assert capsys.readouterr().err == f"stopped: {line}"
    with monkeypatch.context() as patch:
        patch.setattr(export, "_put", full)
        assert main(["run", "s.toml", "--no-pictures", "-q"]) == 1
    assert capsys.readouterr().err == f"stopped: history.vtkhdf could not be written: {line}"
    assert json.loads((tmp_path / "out" / "s" / "summary.json").read_text())["status"] == "stopped"
    monkeypatch.setattr(rooms, "load_scene", full)
    assert main(["check", "s.toml"]) == 1
    assert capsys.readouterr().err == line


def test_fault_of_the_system_is_one_line(scene, monkeypatch, capsys):
    from cosserat_fem import scene as rooms

    def full(*arguments):
        raise OSError(5, "Input/output error", "disk")

    monkeypatch.setattr(rooms, "load_scene", full)
    assert main(["check", "s.toml"]) == 1
    assert capsys.readouterr().err == "disk: Input/output error.\n"


def test_results_are_claimed_only_if_there_are_any(scene, tmp_path, monkeypatch, capsys):
    """Interrupted or lost before the first station: no folder of results is named."""
    import cosserat_fem as cf
    from cosserat_fem import solving

    for error, said in ((KeyboardInterrupt(), "interrupted"), (cf.ConvergenceError("lost"), "lost")):

        def stop(*arguments, error=error, **options):
            raise error

        monkeypatch.setattr(solving, "solve_quasistatic", stop)
        assert main(["run", "s.toml"]) == 1
        told = capsys.readouterr()
        assert told.out == "s\n"
        assert told.err == f"stopped: {said}\n"
        assert json.loads((tmp_path / "out" / "s" / "summary.json").read_text())["reason"] == said


def test_static_scene(scene, tmp_path):
    scene.write_text(STATIC)
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
    for command in ("export", "render"):
        assert main([command, str(tmp_path)]) == 2
        assert "is not the folder of a run" in capsys.readouterr().err
        assert main([command, "none"]) == 2
        assert capsys.readouterr().err == "none: there is no such folder.\n"
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


def test_info_without_a_folder_for_kernels(monkeypatch, capsys):
    from cosserat_fem.kernels import condense

    class Compiled:
        _cache = None

    monkeypatch.setattr(condense, "assemble", Compiled)
    assert main(["info"]) == 0
    assert capsys.readouterr().out.endswith("compiled kernels are not kept: no folder for them can be written\n")


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
    from cosserat_fem import drawing

    monkeypatch.setattr(drawing.sys, "executable", "/bin/false")
    assert main(["run", "s.toml"]) == 0
    assert "No pictures:" in capsys.readouterr().out
    assert (tmp_path / "out" / "s" / "report.html").stat().st_size > 10_000
    assert np.loadtxt(tmp_path / "out" / "s" / "hinge_torque.csv", delimiter=",", skiprows=1, usecols=3).shape == (5,)


def test_missing_opengl_is_explained(monkeypatch, tmp_path):
    """A drawing process that dies of a signal means no software OpenGL: say which package to install."""
    from cosserat_fem import drawing

    class Died:
        returncode, stdout, stderr = -11, "", ""

    monkeypatch.setattr(drawing.subprocess, "run", lambda *a, **k: Died)
    assert "apt-get install libegl1" in drawing.draw(tmp_path).problem
    Died.returncode = -9
    assert "killed" in drawing.draw(tmp_path).problem
    Died.returncode = -2
    assert "interrupted" in drawing.draw(tmp_path).problem


CONTACT = """
[[section]]
name = "s"
kind = "round"
diameter = "4 mm"
youngs_modulus = "50 MPa"

[[rod]]
name = "cable"
section = "s"
points = [[0, 0, 0], [0.2, 0, 0]]
n_elements = 12

[[part]]
name = "post"
shape = { kind = "cylinder", start = [0.1, 0.012, -0.05], end = [0.1, 0.012, 0.05], radius = "8 mm" }
motion = { kind = "slider", axis = [0, -1, 0], travel = "5 mm/s" }

[[part]]
name = "wall"
shape = { kind = "box", center = [0, 0, 0], edges = ["20 mm", "20 mm", "20 mm"] }

[[support]]
kind = "clamp"
rod = "cable"
at = "start"
to = "wall"

[[support]]
kind = "clamp"
rod = "cable"
at = "end"

[[contact]]
kind = "part"
rod = "cable"
part = "post"
friction = 0.3

[solve]
kind = "quasistatic"
duration = "5 s"

[output]
every = "1 s"
"""


def test_contact_scene(tmp_path, monkeypatch, capsys):
    """A post is pushed into a cable: tables of contact beside the others, peaks and clearances in the summary."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(CONTACT)
    assert main(["run", "s.toml", "--no-pictures"]) == 0
    said = capsys.readouterr().out
    assert "contact cable-post: line force up to" in said
    out = tmp_path / "out" / "s"
    assert sorted(p.name for p in out.iterdir()) == [
        "contact_loads.csv", "contacts.csv", "hinge_torque.csv", "history.vtkhdf", "parts.vtkhdf", "reactions.csv",
        "scene.toml", "summary.json",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    contact = summary["contacts"]["cable-post"]
    assert contact["between"] == ["cable", "post"]
    assert contact["touches"] == [[1.0, 5.0]]
    assert contact["largest_force"]["t"] == 5.0
    assert contact["largest_line_force"]["value"] > 10
    assert contact["smallest_gap"]["value"] == pytest.approx(0, abs=1e-3 * 0.002)
    clear = summary["clearances"]["cable"]
    assert list(clear) == ["wall"]  # what may be touched has its gap
    assert clear["wall"]["value"] == pytest.approx(-0.004 - 0.002, abs=1e-4)  # 6 mm from the clamp it is inside still
    assert clear["wall"]["left_out"] == [[0.0, pytest.approx(0.006)]]
    assert main(["export", "out/s", "--format", "pvd"]) == 0
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0  # our own files do not hinder the next run
    (tmp_path / "s.toml").write_text(CONTACT.replace("[0.1, 0.012,", "[0.1, 0.002,"))
    assert main(["run", "s.toml", "--no-pictures"]) == 2
    assert "s.toml:34: contact 1: rod 'cable': at s = 0.1 m it is" in capsys.readouterr().err
    assert json.loads((out / "summary.json").read_text())["status"] == "refused"


def test_summary_of_a_scene_without_contact_does_not_speak_of_it(scene, tmp_path):
    assert main(["run", "s.toml", "--no-pictures", "-q"]) == 0
    summary = json.loads((tmp_path / "out" / "s" / "summary.json").read_text())
    assert not {"contacts", "clearances"} & set(summary)


def test_compare_names_the_theory_that_suffices(scene, capsys):
    assert main(["compare", "s.toml", "--tolerance", "0.1"]) == 0
    told = capsys.readouterr().out
    assert all(theory in told for theory in ("cosserat", "kirchhoff", "string"))
    assert "Cheapest within 0.1 of the Cosserat rods: force:" in told
    assert main(["compare", "s.toml", "--tolerance", "-1"]) == 2
    assert main(["compare", "nothing.toml"]) == 2
