"""Pictures and plots from a run folder; skipped where there is no software OpenGL."""

import re
import subprocess
import sys

import numpy as np
import pytest

from cosserat_fem.cli import main
from test_cli import SCENE


@pytest.fixture(scope="session")
def opengl(tmp_path_factory):
    """Skip unless another process can render a sphere."""
    code = (
        "import pyvista as pv; p = pv.Plotter(off_screen=True, window_size=(64, 64)); p.add_mesh(pv.Sphere()); p.show()"
    )
    if subprocess.run([sys.executable, "-c", code], capture_output=True).returncode != 0:
        pytest.skip("no software OpenGL")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    (folder / "s.toml").write_text(SCENE)
    assert main(["run", str(folder / "s.toml"), "-o", str(folder / "out"), "--no-pictures", "-q"]) == 0
    return folder / "out"


def colours(path):
    """Number of colours and share of pixels that are not background."""
    from PIL import Image

    with Image.open(path) as file:
        image = np.asarray(file.convert("RGB")) @ np.array([1 << 16, 1 << 8, 1])
    return len(np.unique(image)), float((image != 0xFFFFFF).mean())


def test_plots(run, tmp_path):
    """Plots need no OpenGL and only the CSV files."""
    from cosserat_fem.plots import plot_run

    made = plot_run(run, tmp_path)
    assert sorted(p.name for p in made) == ["hinge_torque.png", "hinge_torque.svg", "reactions.png", "reactions.svg"]
    assert "<svg" in (tmp_path / "reactions.svg").read_text()
    assert colours(tmp_path / "reactions.png")[0] > 10


@pytest.mark.render
@pytest.mark.usefixtures("opengl")
def test_render(run):
    """The whole set, one state by field, and an error for a field that does not exist."""
    assert main(["render", str(run)]) == 0
    for name in ("stages.png", "moment.png"):
        n, share = colours(run / "pictures" / name)
        assert n > 50
        assert 0.01 < share < 0.9
    assert main(["render", str(run), "--step", "2", "--field", "curvature", "-o", str(run / "pictures" / "C.JPG")]) == 0
    assert colours(run / "pictures" / "C.JPG")[0] > 50
    assert main(["render", str(run), "--field", "colour"]) == 2


def test_a_state_that_is_not_there(run, capsys):
    from cosserat_fem import view

    assert view.main([str(run), "--step=99"]) == 2
    assert "99" in capsys.readouterr().err


@pytest.mark.render
@pytest.mark.usefixtures("opengl")
def test_film(run, tmp_path, capsys):
    from PIL import Image

    assert main(["render", str(run), "--film"]) == 0
    [film] = [p for p in (run / "pictures").iterdir() if p.stem == "film"]
    assert capsys.readouterr().out == f"Film in {film}\n"
    if film.suffix == ".webp":
        with Image.open(film) as image:
            assert image.n_frames == 5
    assert film.stat().st_size > 1000
    # the name that is told is the one that was written
    assert main(["render", str(run), "--film", "--out", str(tmp_path / "x.xyz")]) == 0
    [film] = tmp_path.iterdir()
    assert film.suffix in (".webp", ".mp4")
    assert capsys.readouterr().out == f"Film in {film}\n"


@pytest.mark.render
@pytest.mark.usefixtures("opengl")
def test_out_alone_draws_the_last_state(run, tmp_path, capsys):
    assert main(["render", str(run), "--out", str(tmp_path / "one.png")]) == 0
    assert capsys.readouterr().out == f"Picture in {tmp_path / 'one.png'}\n"
    assert colours(tmp_path / "one.png")[0] > 10
    assert main(["render", str(run), "--step", "-1", "--out", str(tmp_path / "last.png")]) == 0
    assert (tmp_path / "last.png").read_bytes() == (tmp_path / "one.png").read_bytes()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("one.xyz", r"a picture is written as .png, .*\(got .xyz\)"),
        ("one", r"a picture is written as .png, .*\(got no suffix\)"),
        ("none/one.png", "there is no folder '.*none'. Make it first"),
        ("", "is a folder; name a file in it"),
    ],
)
def test_out_that_cannot_be_written(run, tmp_path, capsys, name, message):
    """Seen before anything is drawn, here in this process."""
    from cosserat_fem import view

    assert view.main([str(run), f"--out={tmp_path / name}"]) == 2
    assert re.fullmatch(f"--out {re.escape(str(tmp_path / name))}: {message}.\n", capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_swept_section_has_its_size_and_twist(run):
    """Surface points lie at the radius from the centreline, the first one along d1."""
    pytest.importorskip("pyvista")
    from cosserat_fem.export import read_history
    from cosserat_fem.view import sweep

    stored = read_history(run / "history.vtkhdf")
    grid = sweep(stored, 0, 3)
    points = grid.points.reshape(-1, stored.fields.points.shape[1], 3)
    centre, d1 = stored.fields.points[3], stored.fields.point_data["d1"][3]
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=-1), 0.002, rtol=1e-5)
    np.testing.assert_allclose(points[0], centre + 0.002 * d1, atol=1e-7)
