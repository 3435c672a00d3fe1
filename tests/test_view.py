"""Pictures and plots from a run folder; skipped where there is no software OpenGL."""

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
        image = np.asarray(file.convert("RGB"))
    return len(np.unique(image.reshape(-1, 3), axis=0)), float((image != 255).any(-1).mean())


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
    assert main(["render", str(run), "--step", "2", "--field", "curvature", "-o", str(run / "pictures" / "c.png")]) == 0
    assert colours(run / "pictures" / "c.png")[0] > 50
    assert main(["render", str(run), "--field", "colour"]) == 2
    assert main(["render", str(run), "--step", "99"]) == 2


@pytest.mark.render
@pytest.mark.usefixtures("opengl")
def test_film(run):
    from PIL import Image

    assert main(["render", str(run), "--film"]) == 0
    [film] = [p for p in (run / "pictures").iterdir() if p.stem == "film"]
    if film.suffix == ".webp":
        with Image.open(film) as image:
            assert image.n_frames == 5
    assert film.stat().st_size > 1000


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
