"""Make the meshes of this folder: the two parts of the deployment hinge, a bracket and a drawn cable route.

Run it from the project's root:  python meshes/make_meshes.py
"""

import pathlib
import shutil

import meshio
import numpy as np
import pyvista as pv

HERE = pathlib.Path(__file__).parent
SCENES = HERE.parent / "cosserat_fem" / "scenes"

# the cable's route in mm, see examples/satellite_hinge.toml
ROUTE = [
    (0.0, -105.7005261328), (-10, -105), (-13, -94), (-7, -85), (0, -76), (9, -68), (19, -62), (28, -55), (38, -49),
    (48, -43), (58, -36), (68, -30), (78, -24), (88, -18), (98, -12), (108, -7), (119, -2), (130.0150780196, 0.0),
]  # fmt: skip


def cylinder(x, y, bottom, top, radius):
    return pv.Cylinder(
        center=(x, y, (bottom + top) / 2), direction=(0, 0, 1), radius=radius, height=top - bottom, resolution=24
    )


def bracket(x, y, radius, depth, facets=40):
    """A post with a half-round nose about the axis (x, y), on a foot 3 mm wider: one closed surface, coordinates in mm."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, facets + 1)

    def ring(wider, z):
        r = radius + wider
        nose = np.stack([x + r * np.cos(angle), y + r * np.sin(angle)], axis=1)
        back = [(x - depth - wider, y + r), (x - depth - wider, y - r)]
        return np.column_stack([[*nose, *back], np.full(facets + 3, z)])

    rings = [ring(3, -9), ring(3, -6), ring(0, -6), ring(0, 6)]
    n = facets + 3
    near = np.arange(n)
    points = np.concatenate([*rings, [(x, y, -9), (x, y, 6)]])
    triangles = [
        np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        for k in range(3)
        for a, b, c, d in [(k * n + near, k * n + np.roll(near, -1), k * n + n + np.roll(near, -1), k * n + n + near)]
    ]
    triangles += [
        np.stack([np.full(n, 4 * n), np.roll(near, -1), near], axis=1),
        np.stack([np.full(n, 4 * n + 1), 3 * n + near, 3 * n + np.roll(near, -1)], axis=1),
    ]
    triangles = np.concatenate(triangles)
    return pv.PolyData(points.astype(float), np.column_stack([np.full(len(triangles), 3), triangles]).ravel())


def main():
    fixed = [
        pv.Box((-24, 24, -126, 14, -16, -9)),
        cylinder(0, 0, -16, -2, 5),
        cylinder(4.29, -101.5, -16, 5, 6),
    ]
    moving = [
        pv.Box((-10, 146, -9, 9, -8.5, -5)),
        cylinder(136, 0, -8.5, 5, 6),
    ]
    for name, shells in (("hinge_fixed", fixed), ("hinge_moving", moving)):
        surface = pv.merge([s.extract_surface(algorithm="dataset_surface").triangulate() for s in shells])
        surface = surface.extract_surface(algorithm="dataset_surface")
        surface.save(HERE / f"{name}.stl")
        shutil.copy(HERE / f"{name}.stl", SCENES / f"{name}.stl")
        surface.points = surface.points[:, [2, 0, 1]]  # the same hinge with its axis along x
        surface.save(HERE / f"{name}_x.stl")
    bracket(5.5, -46, 7, 10).save(HERE / "bracket.stl")
    points = np.array([(x, y, 0.0) for x, y in ROUTE])
    edges = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
    meshio.Mesh(points, [("line", edges)]).write(HERE / "hinge_route.vtu", binary=False)


if __name__ == "__main__":
    main()
