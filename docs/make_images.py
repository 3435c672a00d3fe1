"""Make the pictures of the README: the shipped scene's stages, its curves beside the paper's numbers, a map of margins.

Run it from the project's root:  python docs/make_images.py
"""

import json
import pathlib
import shutil
import tempfile

import numpy as np
from matplotlib.figure import Figure

import cosserat_fem as cf
from cosserat_fem.drawing import draw

ROOT = pathlib.Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
REFERENCES = ROOT / "tests" / "verification" / "references.json"


def curves(history):
    """Force and moments against angle: this package, collocation, and the numbers that the paper reports."""
    reference = np.array(json.loads(REFERENCES.read_text())["B03_deployment"]["history"])[::6]
    a, b = history.reaction("fixed end"), history.reaction("moving end")
    panels = [
        ("resultant force [N]", np.linalg.norm(a[:, :3], axis=1), reference[:, 3], (90, 1319)),
        ("fixed-end moment [N m]", abs(a[:, 5]), abs(reference[:, 4]), (78, 5.25)),
        ("moving-end moment [N m]", abs(b[:, 5]), abs(reference[:, 5]), (35, 0.69)),
        ("hinge torque [N m]", history.hinge_torque("panel"), None, None),
    ]
    figure = Figure(figsize=(12, 3.1), layout="constrained")
    for ax, (title, found, independent, paper) in zip(figure.subplots(1, 4), panels, strict=True):
        ax.plot(history.t, found, color="#0b6e99", label="cosserat_fem, 16 elements")
        if independent is not None:
            ax.plot(reference[:, 0], independent, "o", ms=3.5, mfc="none", color="black", label="collocation")
            ax.plot(*paper, "*", ms=12, color="#d1495b", label=f"paper: {paper[1]} at {paper[0]} deg")
            ax.legend(fontsize=7)
        ax.set_title(title, fontsize=10)
        ax.set_xlabel("hinge angle [deg]")
        ax.grid(alpha=0.3)
    return figure


def main():
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "out"
        cf.run_scene(cf.load_scene(None), out)
        draw(out)
        shutil.copy(out / "pictures" / "stages.png", IMAGES / "deployment.png")
        checked = pathlib.Path(folder) / "checked"
        cf.run_scene(cf.load_scene(ROOT / "examples" / "checked_door.toml"), checked)
        draw(checked)
        shutil.copy(checked / "pictures" / "margin_map.png", IMAGES / "margin_map.png")
    scene = cf.load_scene(None)
    history = cf.solve_quasistatic(scene.model, scene.times)
    curves(history).savefig(IMAGES / "curves.png", dpi=110)


if __name__ == "__main__":
    main()
