"""The Princeton beam (Dowell and Traybar 1975): a flat strip, its weight at the tip turned about the strip's axis.

At 0 deg the load bends the strip edgewise, at 90 deg flatwise; between them it also twists, which a linear beam misses.
"""

import numpy as np

import cosserat_fem as cf

LENGTH, HEIGHT, THICKNESS = 0.508, 0.0123777, 0.0032024  # m
LOAD = 8.896  # N


def solve(angle):
    """Equilibrium with the load at `angle` [deg] from the strip's height."""
    section = cf.Section.rectangle(HEIGHT, THICKNESS, youngs_modulus=71.7e9, poisson_ratio=0.31)
    rod = cf.Rod("strip", section, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=4, order=4, normal=(0, 1, 0))
    a = np.radians(angle)
    load = cf.PointLoad(rod, "end", force=LOAD * np.array([0, -np.cos(a), np.sin(a)]))
    return cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))


def main():
    """Tip deflections [m] and twist [deg] at seven angles, shape (7, 3)."""
    rows = []
    print("angle  edgewise mm  flatwise mm  twist deg")
    for angle in range(0, 91, 15):
        history = solve(angle)
        _, y, z = history.positions("strip")[0, -1]
        d1 = history.directors("strip")[0, -1, :, 0]
        rows.append((-y, z, np.degrees(np.arctan2(d1[2], d1[1]))))
        print(f"{angle:5d}  {-1e3 * y:11.3f}  {1e3 * z:11.3f}  {rows[-1][2]:9.3f}")
    return np.array(rows)


if __name__ == "__main__":
    main()
