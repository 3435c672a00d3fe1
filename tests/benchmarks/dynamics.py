"""Error against CPU time of motions in time.

    python tests/benchmarks/dynamics.py [--repeats 3]

D1: flying spaghetti in space, 10 s; root mean square of both ends at whole seconds, in lengths. D2: rubber pendulum, 1 s;
root mean square of the tip at 21 times. D3: a cable follows an arm by 90 deg, quasi-static; worst component of force and
moment at the arm, root mean square over 90 stations, in parts of its peak. References: tests/verification/references.json.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import json
import logging
import pathlib
import time

import numpy as np

import cosserat_fem as cf

REFERENCES = json.loads((pathlib.Path(__file__).parents[1] / "verification" / "references.json").read_text())


def spaghetti(n_elements, order):
    section = cf.Section(
        force_stiffness=(1e4,) * 3, moment_stiffness=(500,) * 3, mass_per_length=1.0, rotary_inertia=(10, 10, 10)
    )
    rod = cf.Rod("rod", section, [(6, 0, 0), (0, 8, 0)], n_elements=n_elements, order=order, normal=(0, 0, 1))

    def triangle(direction):
        peak = 200 * np.array(direction, dtype=float)
        return [0, 2.5, 5, 11], [0 * peak, peak, 0 * peak, 0 * peak]

    load = cf.PointLoad(rod, "start", force=triangle((0.1, 0, 0)), moment=triangle((0, -0.5, -1)))
    model, reference = cf.Model([rod], [], [load]), np.array(REFERENCES["D1_ends"])

    def solve(step):
        return cf.solve_dynamic(model, 10.0, start="drawn", step=step, times=np.arange(11.0))

    def error(history):
        apart = history.positions("rod")[:, [0, -1]] - reference
        return np.sqrt((apart**2).sum(-1).mean()) / 10

    return solve, error


def pendulum(n_elements, order, plane=None):
    section = cf.Section.round(0.01, youngs_modulus=5e6, shear_modulus=5e6 / 3, density=1100.0, shear_factor=1.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=n_elements, order=order)
    model = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, -9.81, 0))], plane=plane)
    reference = np.array(REFERENCES["D2_tip"])

    def solve(step):
        return cf.solve_dynamic(model, 1.0, start="drawn", step=step, times=np.linspace(0, 1, 21))

    def error(history):
        return np.sqrt(((history.positions("rod")[:, -1, :2] - reference) ** 2).sum(-1).mean())

    return solve, error


def follow(n_elements, order, plane=None):
    section = cf.Section(force_stiffness=(400, 400, 1000), moment_stiffness=(1e-3, 1e-3, 8e-4))
    rod = cf.Rod("cable", section, [(0, 0, 0), (0.5, 0, 0)], n_elements=n_elements, order=order)
    arm = cf.Part("arm", motion=cf.Hinge((0.2, 0, 0), (0, 0, 1), np.radians(1)))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)], plane=plane)
    reference = np.array(REFERENCES["D3_reaction"])

    def solve(_):
        return cf.solve_quasistatic(model, np.arange(91.0))

    def error(history):
        apart = history.reaction("cable.end@arm")[:, [0, 1, 5]] - reference
        return (np.sqrt((apart[1:] ** 2).mean(0)) / np.abs(reference).max(0)).max()

    return solve, error


def extrapolated(dt):
    return cf.FixedStep(dt, richardson=True)


# problem, (elements, order), step, error wanted, CPU s wanted
ROWS = [
    (spaghetti, (4, 3), extrapolated(0.1), 1e-3, 0.2),
    (spaghetti, (4, 3), extrapolated(0.05), 1e-4, 0.4),
    (spaghetti, (8, 3), extrapolated(1 / 65), 1e-5, 0.6),
    (spaghetti, (6, 3), cf.AdaptiveStep(1e-2), None, None),
    (pendulum, (6, 3), cf.FixedStep(0.0045), 1e-3, 0.1),
    (pendulum, (8, 3), extrapolated(0.004), 1e-4, 0.3),
    (pendulum, (12, 3), cf.AdaptiveStep(1e-2), None, None),
    (pendulum, (5, 3, "xy"), cf.FixedStep(0.0045), 1e-3, 0.015),
    (pendulum, (8, 3, "xy"), extrapolated(0.004), 1e-4, 0.08),
    (follow, (6, 3), None, 1e-3, 0.1),
    (follow, (6, 3, "xy"), None, 1e-3, 0.03),
]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    logging.getLogger("cosserat_fem").setLevel(logging.ERROR)
    print(
        f"{'problem':10s} {'mesh':>7s}  {'step':28s} {'steps':>6s} {'error':>9s} {'wanted':>7s} {'CPU s':>7s} {'wanted':>7s}"
    )
    for problem, mesh, step, accuracy, limit in ROWS:
        solve, error = problem(*mesh)
        history, spent = solve(step), []
        for _ in range(options.repeats):
            begin = time.process_time()
            solve(step)
            spent.append(time.process_time() - begin)
        if isinstance(step, cf.AdaptiveStep):
            name = f"rtol {step.rtol:g}"
        else:
            name = "quasi-static" if step is None else f"{1e3 * step.dt:.4g} ms"
            name += ", extrapolated" if step is not None and step.richardson else ""
        wanted = ("", "") if accuracy is None else (f"{accuracy:.0e}", f"{limit:.2f}")
        name = " ".join([*mesh[2:], name])
        print(f"{problem.__name__:10s} {mesh[0]:3d} x p{mesh[1]}  {name:28s} {len(history.steps):6d} ", end="")
        print(f"{error(history):9.1e} {wanted[0]:>7s} {min(spent):7.3f} {wanted[1]:>7s}")


if __name__ == "__main__":
    main()
