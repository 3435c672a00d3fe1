"""A straight rod under a tip moment that follows the tip: every section carries the same moment, the rod is a helix.

With the moment (0, M2, M3) in the tip's own axes the rod bends by M2 / EI and twists by M3 / GJ everywhere. If EI = GJ,
curvature and twist together make a helix of radius k / (k^2 + t^2), k = M2 / EI, t = M3 / GJ.
"""

import numpy as np

import cosserat_fem as cf

EI, LENGTH = 1.0, 10.0
CURVATURE, TWIST = 3.0, 1.0


def solve():
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(EI, EI, EI))
    rod = cf.Rod("rod", section, [(0, 0, 0), (0, 0, LENGTH)], n_elements=40, order=4)
    moment = cf.PointLoad(rod, "end", moment=(0, EI * CURVATURE, EI * TWIST), follower=True)
    return cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [moment]))


def main():
    """Largest distance of the rod's points from the cylinder of the helix, in parts of its radius."""
    history = solve()
    r = history.positions("rod")[0]
    darboux = np.array([0, CURVATURE, TWIST])  # about d1, d2, d3; fixed in space, the helix winds about it
    centre = np.cross(darboux, (0, 0, 1)) / (darboux @ darboux)  # of curvature, seen from the clamp
    radius = np.linalg.norm(centre)
    from_axis = np.linalg.norm(np.cross(r - centre, darboux / np.linalg.norm(darboux)), axis=1)
    error = np.abs(from_axis - radius).max() / radius
    print(f"helix of radius {radius:.3f} m, {np.linalg.norm(darboux) * LENGTH / (2 * np.pi):.2f} turns")
    print(f"points off the cylinder by at most {error:.1e} radii, {history.counters.iterations} iterations")
    return error


if __name__ == "__main__":
    main()
