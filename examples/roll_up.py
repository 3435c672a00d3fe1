"""A cantilever under an end moment of 2 pi EI / L: it rolls up to a circle, in one load step. Accuracy against cost.

The exact solution is an arc of curvature M / EI: the tip comes back to the clamp.
"""

import time

import numpy as np

import cosserat_fem as cf

EI, LENGTH = 1.0, 1.0


def solve(order, n_elements, turns=1):
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(EI, EI, EI))
    rod = cf.Rod("strip", section, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=n_elements, order=order)
    moment = cf.PointLoad(rod, "end", moment=(0, 0, turns * 2 * np.pi * EI / LENGTH))
    return cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [moment]))


def main():
    """Distance of the tip from the clamp, in parts of the length, on ten elements of order 4."""
    solve(1, 2)  # compiles
    print("order  elements  tip error / L  iterations  CPU ms with set-up")
    for order in (1, 2, 3, 4):
        for n in (5, 10, 20):
            start = time.process_time()
            history = solve(order, n)
            spent = time.process_time() - start
            error = np.linalg.norm(history.positions("strip")[0, -1]) / LENGTH
            print(f"{order:5d}  {n:8d}  {error:13.1e}  {history.counters.iterations:10d}  {1e3 * spent:18.1f}")
    return np.linalg.norm(solve(4, 10).positions("strip")[0, -1]) / LENGTH


if __name__ == "__main__":
    main()
