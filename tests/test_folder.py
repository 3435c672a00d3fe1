"""The folder of a run: whose files are whose, and one run at a time."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

import cosserat_fem as cf
from cosserat_fem.cli import main
from cosserat_fem.folder import LOCK, RunFolder, contents
from test_cli import SCENE

RUN = ["run", "s.toml", "--no-pictures", "-q"]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(SCENE)
    return tmp_path / "s.toml"


def fill(folder, *names):
    for name in names:
        file = pathlib.Path(folder) / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"my {name}")


def held(folder, *names):
    return [(pathlib.Path(folder) / name).read_text() for name in names] == [f"my {name}" for name in names]


def is_run(folder):
    return json.loads((pathlib.Path(folder) / "summary.json").read_text())["status"] == "converged"


def test_force_leaves_what_is_not_ours(scene):
    """A foreign folder: files beside ours stay, also in folders that have the names of ours."""
    names = ("thesis.tex", "pictures/holiday.jpg", "pvd/notes.txt", ".history-notes.vtkhdf")
    fill("mine", *names)
    assert main(RUN + ["-o", "mine"]) == 2
    assert main(RUN + ["-o", "mine", "--force"]) == 0
    assert is_run("mine")
    assert held("mine", *names)


@pytest.mark.parametrize(
    "name",
    [
        "scene.toml",
        "history.vtkhdf",
        "summary.json",
        "reactions.csv",
        "history.pvd",
        "pictures/stages.png",
        "pictures/moment_12.png",
        "pvd/rods_00001.vtu",
        "pvd/rods_00001.vtu/inner",
        "history.vtkhdf/inner",
        "pictures",
        LOCK,
    ],
)
def test_force_refuses_to_replace_what_is_not_ours(scene, capsys, name):
    fill("mine", name)
    for options in ([], ["--force"]):
        assert main(RUN + ["-o", "mine", *options]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith(f"output folder 'mine': holds '{name.removesuffix('/inner')}' and is not an earlier run")
        assert "--force" not in line
    assert held("mine", name)
    assert len([p for p in pathlib.Path("mine").rglob("*") if p.is_file()]) == 1


@pytest.mark.parametrize(
    "name", ["pictures/holiday.jpg", "pictures/holiday_3.png", "pvd/mine.vtu", "pictures/old/a.png"]
)
def test_rerun_leaves_what_is_not_ours(scene, capsys, name):
    """In a run of ours: refused without --force, kept with it; our own files there go."""
    assert main(RUN) == 0
    fill("out/s", "pictures/stages.png", "pictures/shape_-1.png", "pictures/film.webp", "pvd/rods_00012.vtu", name)
    assert main(RUN) == 2
    stranger = "pictures/old" if "old" in name else name
    assert f"output folder 'out/s': holds '{stranger}' beside an earlier run" in capsys.readouterr().err
    assert held("out/s", "pictures/stages.png", name)
    assert main(RUN + ["--force"]) == 0
    assert held("out/s", name)
    assert [str(p) for p in contents(pathlib.Path("out/s")).others] == [f"out/s/{stranger}"]
    assert not pathlib.Path("out/s/pictures/stages.png").exists()


def test_our_own_names_are_known(scene, tmp_path):
    """Everything that a run, an export and the pictures make."""
    assert main(RUN) == 0
    assert main(["export", "out/s"]) == 0
    from cosserat_fem.plots import plot_run

    pictures = tmp_path / "out" / "s" / "pictures"
    pictures.mkdir()
    plot_run(tmp_path / "out" / "s", pictures)
    names = ("moment.png", "film.mp4", "shape_last.png", "force_material_3.png", ".stages-ab_de3gh.png")
    fill(pictures, *names)
    assert contents(tmp_path / "out" / "s").others == []
    assert main(RUN) == 0
    assert not pictures.exists()
    assert not (tmp_path / "out" / "s" / "pvd").exists()


@pytest.mark.skipif(os.name != "posix", reason="needs symbolic links")
def test_links_are_not_ours(scene, tmp_path):
    """What a link leads to is never written through or deleted."""
    assert main(RUN) == 0
    fill("elsewhere", "stages.png")
    (tmp_path / "out" / "s" / "pictures").symlink_to(tmp_path / "elsewhere")
    for options in ([], ["--force"]):
        assert main(RUN + options) == 2
    assert held("elsewhere", "stages.png")


@pytest.mark.parametrize("options", [[], ["--force"]])
def test_inputs_are_never_replaced(scene, capsys, options):
    """The scene file or a file it reads among those that would be replaced, in a folder of ours and in any other."""
    text = SCENE.replace("points = [[0, 0, 0], [0.05, 0.03, 0], [0.1, 0, 0]]", 'file = "reactions.csv"')
    curve = "x,y,z\n0,0,0\n0.05,0.03,0\n0.1,0,0\n"
    for folder in (pathlib.Path("own"), pathlib.Path("other")):
        folder.mkdir()
        if folder.name == "own":
            assert main(RUN + ["-o", "own"]) == 0
        (folder / "scene.toml").write_text(SCENE)
        assert main(["run", f"{folder}/scene.toml", "-o", str(folder), "-q", *options]) == 2
        assert f"output folder '{folder}': the run reads 'scene.toml' there and would" in capsys.readouterr().err
        assert (folder / "scene.toml").read_text() == SCENE
        (folder / "scene.toml").unlink()
        (folder / "reactions.csv").write_text(curve)
        (folder / "input.toml").write_text(text)
        assert main(["run", f"{folder}/input.toml", "-o", str(folder), "-q", *options]) == 2
        assert "the run reads 'reactions.csv' there and would replace it" in capsys.readouterr().err
        assert (folder / "reactions.csv").read_text() == curve


def test_inputs_of_a_scene(scene, tmp_path):
    """All files that a scene names."""
    (tmp_path / "route.csv").write_text("0,0,0\n0.05,0.03,0\n0.1,0,0\n")
    (tmp_path / "motion.csv").write_text("0,0,0,0,1,0,0,0\n5,0.002,0,0,1,0,0,0\n")
    text = SCENE.replace("points = [[0, 0, 0], [0.05, 0.03, 0], [0.1, 0, 0]]", 'file = "route.csv"')
    text = text.replace('kind = "hinge", axis = [0, 0, 1], angle = "10 deg/s"', 'kind = "path", file = "motion.csv"')
    scene.write_text(text)
    assert [file.name for file in cf.load_scene(scene).inputs] == ["s.toml", "motion.csv", "route.csv"]


def test_second_run_is_refused(scene, capsys):
    """While a living process holds the folder; without a word a process that is gone does not."""
    with RunFolder("out/s"):
        assert pathlib.Path("out/s", LOCK).read_text() == f"{os.getpid()}\n"
        before = sorted(pathlib.Path("out/s").iterdir())
        code = "import sys; from cosserat_fem.cli import main; sys.exit(main(sys.argv[1:]))"
        for options in ([], ["--force"]):
            done = subprocess.run([sys.executable, "-c", code, *RUN, *options], capture_output=True, text=True)
            assert done.returncode == 2
            assert done.stderr == (
                f"output folder 'out/s': another run (process {os.getpid()}) is writing into it. Wait for it, or choose "
                "another with -o. If there is no such run, delete its file .running.\n"
            )
        with pytest.raises(cf.SceneError, match="another run"), RunFolder("out/s"):
            pass
        assert sorted(pathlib.Path("out/s").iterdir()) == before
    assert not list(pathlib.Path("out/s").iterdir())


def test_lock_of_a_killed_run_is_taken_over(scene):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    assert main(RUN) == 0
    pathlib.Path("out/s", LOCK).write_text(f"{dead.pid}\n")
    assert main(RUN) == 0
    assert is_run("out/s")
    assert not list(pathlib.Path("out/s").glob(".*"))


def test_lock_is_removed_after_a_failure(scene, monkeypatch):
    from cosserat_fem import solving

    def fail(*arguments, **options):
        raise ZeroDivisionError

    monkeypatch.setattr(solving, "solve_quasistatic", fail)
    with pytest.raises(ZeroDivisionError):
        main(RUN)
    assert not pathlib.Path("out/s", LOCK).exists()
    monkeypatch.undo()
    os.chdir(scene.parent)
    fill("out/s", "notes.txt")
    assert main(RUN) == 2
    assert not pathlib.Path("out/s", LOCK).exists()


def test_idle_parts_are_drawn(scene, tmp_path):
    """A part with a mesh is in the results though it holds no rod."""
    from cosserat_fem.export import read_history
    from cosserat_fem.scene import shipped_scene

    mesh = shipped_scene().parent / "hinge_fixed.stl"
    scene.write_text(
        SCENE.replace("[[part]]", f'[[part]]\nname = "wall"\nmesh = "{mesh}"\nmesh_unit = "mm"\n\n[[part]]', 1)
    )
    assert main(RUN) == 0
    assert read_history(tmp_path / "out" / "s" / "parts.vtkhdf").about["parts"] == ["wall"]
