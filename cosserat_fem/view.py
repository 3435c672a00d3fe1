"""How does it look? Pictures and films of a run folder through pyvista.

Rule: reads the run folder only; run it as its own process (`python -m cosserat_fem.view FOLDER`), because rendering
without a usable OpenGL library ends the process. Rods are drawn as swept sections of true size, with a line along d1 so
that twist shows; parts as their meshes and shapes.
"""

from __future__ import annotations

import argparse
import pathlib
import sys
from typing import Any

import numpy as np
import pyvista as pv
from PIL import Image

from .errors import CosseratError, nearest, out_of_memory
from .export import Stored, read_history, replace_file
from .plots import plot_run

SIZE = (1280, 800)
PART_COLOURS = ("#9aa5b1", "#5b7083", "#c9b79c", "#7d8f69")
ROD_COLOURS = ("#d1495b", "#edae49", "#00798c", "#7a5195", "#0b6e99")
SIDES = 24
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def outline(about: dict[str, Any], radius: float) -> np.ndarray:
    """Section contour (K, 2) along d1 and d2, closed: a circle, or a rectangle."""
    if about.get("outline"):
        w, h = (x / 2 for x in about["outline"])
        return np.array([(w, h), (-w, h), (-w, -h), (w, -h), (w, h)])
    angle = np.linspace(0.0, 2 * np.pi, SIDES + 1)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def sweep(stored: Stored, rod: int, step: int) -> pv.StructuredGrid:
    """Surface of one rod at one state, with all node fields."""
    data = stored.fields
    pick = data.point_data["rod"][step] == rod
    about = stored.about["rods"][rod]
    r, d1, d2 = (a[step, pick] for a in (data.points, data.point_data["d1"], data.point_data["d2"]))
    radius = data.point_data["radius"][step, pick]
    shape = np.stack([outline(about, float(x)) for x in radius])  # (N, K, 2)
    points = r[:, None] + shape[..., :1] * d1[:, None] + shape[..., 1:] * d2[:, None]
    grid = pv.StructuredGrid(*np.moveaxis(points[:, :, None], -1, 0))
    n_around = shape.shape[1]
    for name, values in data.point_data.items():
        # StructuredGrid numbers its points with the first index fastest
        tiled = np.tile(values[step, pick], (n_around, *[1] * (values.ndim - 2)))
        grid.point_data[name] = tiled
    return grid


def stripe(stored: Stored, rod: int, step: int) -> pv.PolyData:
    """A line on the surface along d1."""
    data = stored.fields
    pick = data.point_data["rod"][step] == rod
    about = stored.about["rods"][rod]
    radius = data.point_data["radius"][step, pick]
    reach = np.full_like(radius, about["outline"][0] / 2) if about.get("outline") else radius
    points = data.points[step, pick] + 1.01 * reach[:, None] * data.point_data["d1"][step, pick]
    return pv.lines_from_points(points).strip().tube(radius=0.08 * float(radius.mean()))


class Picture:
    """A plotter with the parts and rods of a run."""

    def __init__(self, stored: Stored, parts: Stored | None, field: str | None) -> None:
        self.stored, self.parts, self.field = stored, parts, field
        if field is not None and field not in stored.fields.point_data:
            raise CosseratError(f"field {field!r} is unknown. {nearest(field, stored.fields.point_data)}")
        self.limits = self._limits()
        pv.global_theme.multi_samples = 0
        plotter: Any = pv.Plotter(off_screen=True, window_size=list(SIZE))
        plotter.set_background("white")
        self.plotter = plotter

    def _limits(self) -> tuple[float, float] | None:
        if self.field is None:
            return None
        values = self.stored.fields.point_data[self.field]
        size = np.linalg.norm(values, axis=-1) if values.ndim == 3 else values
        if self.field == "margin":  # the limit in the middle
            extent = min(float(np.nanmax(np.abs(size), initial=1e-3)), 1.0)
            return -extent, extent
        return float(size.min()), float(size.max())

    def add(self, step: int, *, opacity: float = 1.0, parts: bool = True) -> None:
        """Draw one state."""
        if self.parts is not None and parts:
            data = self.parts.fields
            faces = np.column_stack([np.full(len(data.lines), 3), data.lines]).ravel()
            index = data.cell_data["part"][step]
            for k in range(len(self.parts.about["parts"])):
                surface = pv.PolyData(data.points[step], faces).extract_cells(index == k)
                colour = PART_COLOURS[k % len(PART_COLOURS)]
                self.plotter.add_mesh(surface, color=colour, opacity=opacity, smooth_shading=False)
        for rod in range(len(self.stored.about["rods"])):
            surface = sweep(self.stored, rod, step)
            if self.field is None:
                colour = ROD_COLOURS[rod % len(ROD_COLOURS)]
                self.plotter.add_mesh(surface, color=colour, opacity=opacity, smooth_shading=True)
            else:
                values = surface.point_data[self.field]
                surface.point_data["shown"] = np.linalg.norm(values, axis=-1) if values.ndim == 2 else values
                unit = {"force": "N", "moment": "N m", "curvature": "1/m", "displacement": "m"}.get(self.field, "")
                self.plotter.add_mesh(
                    surface,
                    scalars="shown",
                    cmap="RdBu" if self.field == "margin" else "viridis",
                    clim=self.limits,
                    opacity=opacity,
                    smooth_shading=True,
                    scalar_bar_args={"title": f"{self.field} [{unit}]" if unit else self.field, "color": "black"},
                )
            self.plotter.add_mesh(stripe(self.stored, rod, step), color="black", opacity=opacity)

    def aim(self) -> None:
        """Look along the least extent of the whole scene, slightly from above."""
        low, high = np.array(self.plotter.bounds).reshape(3, 2).T
        flat = int(np.argmin(high - low))
        # a flat scene is seen from its thin side, anything else from a corner
        x, y, z = np.eye(3)
        if (high - low)[flat] < 0.35 * (high - low).max():  # z upwards, except when looking along it
            toward, right, up = ((x, y, z), (-y, x, z), (z, x, y))[flat]
            direction = toward + 0.35 * right + (-0.45 if flat == 2 else 0.3) * up
        else:
            direction, up = np.array([1.0, -1.6, 0.9]), np.array([0.0, 0.0, 1.0])
        direction = direction / np.linalg.norm(direction)
        center = (low + high) / 2
        # distance at which every corner of the bounds is inside the view with a margin
        right = np.cross(up, direction) / np.linalg.norm(np.cross(up, direction))
        upward = np.cross(direction, right)
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T - center
        half = np.tan(np.radians(self.plotter.camera.view_angle) / 2)
        across, along = np.abs(corners @ right) * SIZE[1] / SIZE[0], np.abs(corners @ upward)
        distance = float((1.08 * np.maximum(across, along) / half + corners @ direction).max())
        self.plotter.camera_position = [tuple(center + distance * direction), tuple(center), tuple(upward)]
        self.plotter.reset_camera_clipping_range()

    def save(self, path: pathlib.Path) -> None:
        self.plotter.add_axes(color="black")
        image = Image.fromarray(self.plotter.screenshot(return_img=True))
        self.plotter.close()
        replace_file(path, image.save)


def stages(stored: Stored, n: int = 4) -> list[int]:
    """Steps spread over a run, first and last included."""
    return sorted({round(x) for x in np.linspace(0, len(stored.t) - 1, min(n, len(stored.t)))})


def draw_run(folder: pathlib.Path) -> list[pathlib.Path]:
    """Plots, a picture of the run in stages and one of the last state coloured by the bending moment."""
    out = folder / "pictures"
    out.mkdir(exist_ok=True)
    made = plot_run(folder, out)
    stored, parts = _read(folder)
    steps = stages(stored)
    picture = Picture(stored, parts, None)
    for step in steps:
        last = step == steps[-1]
        picture.add(step, opacity=1.0 if last else 0.25 + 0.3 * steps.index(step) / len(steps))
    picture.aim()
    picture.save(out / "stages.png")
    picture = Picture(stored, parts, "moment")
    picture.add(len(stored.t) - 1)
    picture.aim()
    picture.save(out / "moment.png")
    return [*made, out / "stages.png", out / "moment.png"]


def draw_step(folder: pathlib.Path, step: int, field: str | None, out: pathlib.Path) -> pathlib.Path:
    """One state, plain or coloured by a node field."""
    stored, parts = _read(folder)
    if not -len(stored.t) <= step < len(stored.t):
        raise CosseratError(f"step {step}: the run has {len(stored.t)} states, 0 to {len(stored.t) - 1}.")
    picture = Picture(stored, parts, field)
    picture.add(range(len(stored.t))[step])
    picture.aim()
    picture.save(out)
    return out


def film(folder: pathlib.Path, field: str | None, out: pathlib.Path) -> pathlib.Path:
    """All states as a film: MP4 if imageio with ffmpeg is installed (extra `movie`), else, or if asked, animated WebP."""
    stored, parts = _read(folder)
    frames = []
    view = Picture(stored, parts, field)
    for step in stages(stored):
        view.add(step)
    view.aim()
    camera = view.plotter.camera_position
    view.plotter.close()
    for step in range(len(stored.t)):
        picture = Picture(stored, parts, field)
        picture.add(step)
        picture.plotter.camera_position = camera
        frames.append(picture.plotter.screenshot(return_img=True))
        picture.plotter.close()
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError:
        imageio = None
    if imageio is None or out.suffix.lower() == ".webp":
        out = out.with_suffix(".webp")
        images = [Image.fromarray(frame) for frame in frames]
        replace_file(
            out, lambda path: images[0].save(path, save_all=True, append_images=images[1:], duration=40, loop=0)
        )
        return out
    out = out.with_suffix(".mp4")
    replace_file(out, lambda path: imageio.mimwrite(path, frames, fps=25, macro_block_size=16))
    return out


def _read(folder: pathlib.Path) -> tuple[Stored, Stored | None]:
    parts = folder / "parts.vtkhdf"
    return read_history(folder / "history.vtkhdf"), read_history(parts) if parts.is_file() else None


def main(arguments: list[str] | None = None) -> int:
    """Entry of the drawing process; prints the paths it made. Exit code 2 if an argument is wrong, 1 if it stopped."""
    parser = argparse.ArgumentParser(prog="cosserat_fem.view")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--step", type=int)
    parser.add_argument("--field")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--film", action="store_true")
    given = parser.parse_args(arguments)
    try:
        made = _draw(given)
    except CosseratError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except OSError as error:
        sys.stderr.write(f"{error.filename or given.folder}: cannot be written: {error.strerror or error}.\n")
        return 1
    except MemoryError as error:
        sys.stderr.write(f"{out_of_memory(error)}\n")
        return 1
    sys.stdout.write("".join(f"{path}\n" for path in made))
    return 0


def _draw(given: argparse.Namespace) -> list[pathlib.Path]:
    """What the arguments ask for."""
    if given.out is not None:
        _check_out(given.out, given.film)
    elif given.film or given.step is not None or given.field is not None:
        (given.folder / "pictures").mkdir(exist_ok=True)
    if given.film:
        return [film(given.folder, given.field, given.out or given.folder / "pictures" / "film")]
    if given.step is None and given.field is None and given.out is None:
        return draw_run(given.folder)
    name = f"{given.field or 'shape'}_{given.step if given.step is not None else 'last'}.png"
    out = given.out or given.folder / "pictures" / name
    return [draw_step(given.folder, -1 if given.step is None else given.step, given.field, out)]


def _check_out(out: pathlib.Path, film: bool) -> None:
    """CosseratError if nothing can be written there. A film takes the suffix of what it is."""
    if out.is_dir():
        raise CosseratError(f"--out {out}: is a folder; name a file in it.")
    if not out.parent.is_dir():
        raise CosseratError(f"--out {out}: there is no folder {str(out.parent)!r}. Make it first.")
    if not film and out.suffix.lower() not in SUFFIXES:
        raise CosseratError(
            f"--out {out}: a picture is written as {', '.join(SUFFIXES)} (got {out.suffix or 'no suffix'})."
        )


if __name__ == "__main__":
    sys.exit(main())
