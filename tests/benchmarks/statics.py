"""Error against CPU time of static problems, and the cost of an iteration against the number of elements.

    python tests/benchmarks/statics.py [--repeats 100] [--large]

Each time is that of the solve call alone, on one thread, after a warm-up: the least of the repeats, and their median in
brackets (a busy machine only adds). Errors are against references that share no code with this package: the tip of the
45 degree bend by shooting, the slack cable's r(L/4), r(L/2) and end force by shooting, the circle, the elastica's tip by
shooting, the deployment by collocation (tests/verification/references.json).
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import json
import logging
import pathlib
import resource
import statistics
import subprocess
import sys
import time

import numpy as np

import cosserat_fem as cf

REFERENCES = pathlib.Path(__file__).parents[1] / "verification" / "references.json"
BEND_TIP = np.array([15.55792437, 46.89218880, 53.60723235])  # J = 0.1406, k = 1, P = 600, in our axes
CABLE = {"quarter": (0.13652423, 0, -0.18959280), "half": (0.3, 0, -0.35457193), "force": (0.217135148, 0, 1.0)}
ELASTICA_TIP = np.array([4.4500440, -8.1060912, 0])


def bend(n_elements, order):
    """Bathe and Bolourchi: an arc of 45 degrees, radius 100, dead force out of its plane."""
    section = cf.Section(force_stiffness=(5e6, 5e6, 1e7), moment_stiffness=(1e7 / 12, 1e7 / 12, 5e6 * 0.1406))
    a = np.linspace(0, np.pi / 4, 100)
    points = 100 * np.stack([1 - np.cos(a), np.sin(a), 0 * a], axis=-1)
    rod = cf.Rod(
        "bend", section, points, n_elements=n_elements, order=order, rest=(0, 0.01, 0), length=25 * np.pi,
        start_tangent=(0, 1, 0), end_tangent=(1, 1, 0), normal=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, 0, 600))])
    tip = np.array(json.loads(REFERENCES.read_text())["A03_bend45"]["values"]["J=0.1406,k=1,P=600"]["tip"])
    return model, cf.solve_static, lambda h: np.linalg.norm(h.positions("bend")[0, -1] - tip) / (25 * np.pi)


def slack_cable(n_elements, order):
    """Naturally straight, both clamps level, length 1 over a span of 0.6, from a guessed sag."""
    section = cf.Section(
        force_stiffness=(4e4, 4e4, 1e5), moment_stiffness=(1e-2, 1e-2, 0.8e-2), mass_per_length=2 / 9.81
    )
    s = np.linspace(0, 1, 21)
    points = np.stack([0.6 * s, 0 * s, -0.33 * np.sin(np.pi * s) ** 2], axis=-1)
    rod = cf.Rod(
        "cable", section, points, n_elements=n_elements, order=order, length=1.0,
        start_tangent=(1, 0, 0), end_tangent=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -9.81))])

    def error(history):
        r, s = history.positions("cable")[0], history.nodes("cable")
        found = [r[np.argmin(abs(s - place))] for place in (0.25, 0.5)]
        force = abs(history.reaction("cable.start@ground")[0, :3])
        return max(
            *(np.linalg.norm(f - CABLE[k]) for f, k in zip(found, ("quarter", "half"), strict=True)),
            np.linalg.norm(force - CABLE["force"]),
        )

    return model, cf.solve_static, error


def roll_up(n_elements, order):
    """End moment 2 pi EI / L in one load step: the tip comes back to the clamp."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(1, 1, 1))
    rod = cf.Rod("strip", section, [(0, 0, 0), (1, 0, 0)], n_elements=n_elements, order=order)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", moment=(0, 0, 2 * np.pi))])
    return model, cf.solve_static, lambda h: np.linalg.norm(h.positions("strip")[0, -1])


def elastica(n_elements, order):
    """Slender cantilever (L/d ~ 1e4), dead tip force P L^2 / EI = 10."""
    section = cf.Section(force_stiffness=(1e8, 1e8, 1e8), moment_stiffness=(100, 100, 100))
    rod = cf.Rod("rod", section, [(0, 0, 0), (10, 0, 0)], n_elements=n_elements, order=order)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, -10, 0))])
    return model, cf.solve_static, lambda h: np.linalg.norm(h.positions("rod")[0, -1] - ELASTICA_TIP) / 10


def deployment(n_elements, order):
    """The shipped scene: 91 stations; worst of Fx, Fy, |F|, M_A, M_B at any station, in parts of its peak."""
    model = cf.load_scene(None).model
    (drawn,) = model.rods
    rod = cf.Rod(
        "cable", drawn.section, drawn.points, n_elements=n_elements, order=order, length=drawn.length,
        layer=drawn.layer, start_tangent=drawn.start_tangent, end_tangent=drawn.end_tangent,
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, s.at, s.to, name=s.name) for s in model.supports])
    reference = np.array(json.loads(REFERENCES.read_text())["B03_deployment"]["history"])[:, 1:]

    def error(history):
        a, b = history.reaction("fixed end"), history.reaction("moving end")
        found = np.stack([a[:, 0], a[:, 1], np.linalg.norm(a[:, :3], axis=1), a[:, 5], b[:, 5]], axis=1)
        return (np.abs(found - reference).max(axis=0) / np.abs(reference).max(axis=0)).max()

    return model, lambda m: cf.solve_quasistatic(m, np.arange(91.0)), error


def in_plane(problem, plane):
    """The same problem with three unknowns a node."""

    def made(n_elements, order):
        model, solve, error = problem(n_elements, order)
        return cf.Model(model.rods, model.supports, model.terms, plane=plane), solve, error

    made.__name__ = f"{problem.__name__} {plane}"
    return made


# problem, (elements, order), error wanted, CPU ms wanted
ROWS = [
    (bend, (4, 3), 1e-5, 2.0),
    (bend, (12, 3), 1e-8, 4.0),
    (slack_cable, (12, 3), 1e-4, 2.0),
    (roll_up, (4, 4), 1e-6, 1.5),
    (elastica, (4, 3), 1e-4, 4.0),
    (deployment, (16, 2), None, None),
    (deployment, (16, 3), 1e-3, 250.0),
    (deployment, (24, 4), None, None),
    (in_plane(slack_cable, "xz"), (8, 3), 1e-3, None),
    (in_plane(slack_cable, "xz"), (12, 3), 1e-4, None),
    (in_plane(roll_up, "xy"), (4, 4), 1e-6, None),
    (in_plane(elastica, "xy"), (3, 3), 1e-3, None),
    (in_plane(elastica, "xy"), (4, 3), 1e-4, None),
    (in_plane(elastica, "xy"), (6, 4), 1e-6, None),
]


def measure(problem, mesh, repeats):
    """Error, iterations, least and median CPU milliseconds of the solve call."""
    model, solve, error = problem(*mesh)
    history = solve(model)
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        solve(model)
        spent.append(1e3 * (time.process_time() - start))
    return error(history), history.counters.iterations, min(spent), statistics.median(spent)


def iteration(n_elements):
    """CPU microseconds an element and iteration of a whole solve at order 3, and the peak memory of the process in MB."""
    model, solve, _ = slack_cable(n_elements, 3)
    spent = []
    for _ in range(30 if n_elements <= 1000 else 2):
        start = time.process_time()
        history = solve(model)
        spent.append(time.process_time() - start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return 1e6 * min(spent) / n_elements / history.counters.iterations, history.counters.iterations, memory


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=100)
    parser.add_argument("--large", action="store_true", help="also 100 000 elements")
    parser.add_argument("--iteration", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    logging.getLogger("cosserat_fem").setLevel(logging.ERROR)
    if options.iteration:
        print(json.dumps(iteration(options.iteration)))
        return
    print(
        f"{'problem':14s} {'mesh':>9s} {'error':>9s} {'wanted':>8s} {'it':>4s} {'CPU ms (median)':>18s} {'wanted':>7s}"
    )
    for problem, mesh, accuracy, limit in ROWS:
        error, count, least, median = measure(problem, mesh, options.repeats)
        wanted = ("" if accuracy is None else f"{accuracy:.0e}", "" if limit is None else f"{limit:.1f}")
        size = f"{mesh[0]} x p{mesh[1]}"
        print(f"{problem.__name__:14s} {size:>9s} {error:9.1e} {wanted[0]:>8s} {count:4d} ", end="")
        print(f"{least:9.2f} ({median:6.2f}) {wanted[1]:>7s}")
    print(f"\n{'elements':>9s} {'us an element and iteration':>28s} {'iterations':>11s} {'peak MB':>8s}")
    for n in (100, 1000, 10_000, *((100_000,) if options.large else ())):
        # each in its own process, for its memory
        answer = subprocess.run([sys.executable, __file__, "--iteration", str(n)], capture_output=True, check=True)
        cost, count, memory = json.loads(answer.stdout)
        print(f"{n:9d} {cost:28.2f} {count:11d} {memory:8.0f}")


if __name__ == "__main__":
    main()
