"""What contact costs: one evaluation with its tangent, and error against CPU time of the capstan and the bracket.

    python tests/benchmarks/contact.py [--repeats 30]

One thread, after a warm-up; the least of the repeats. Evaluations are of a rod of 200 elements of order 3 that lies on a
sphere with its whole length: found anew at a state that moved a little, forces and element matrices. Errors of the capstan
are those of the exponent between 0.1 and 0.9 of the wrap, against the rope of finite radius (tests/verification).
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import logging
import pathlib
import sys
import tempfile
import time

import numpy as np

import cosserat_fem as cf
from cosserat_fem.iteration.barrier import Approach

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from verification import contact_references

from helpers import round_a_drum

RADIUS, ROD = 0.1, 0.001  # m, of the sphere and of the rod on it


def sphere_mesh(folder):
    """A geodesic sphere of 81 920 triangles, as a file."""
    import pyvista

    path = pathlib.Path(folder) / "sphere.ply"
    pyvista.Icosphere(radius=RADIUS, nsub=6).save(path)
    return path


def evaluations(part, repeats):
    """CPU milliseconds of an evaluation with tangent, without and with friction."""
    angle = np.linspace(-0.9 * np.pi, 0.9 * np.pi, 800)
    r = RADIUS + ROD + 2e-6
    section = cf.Section.round(2 * ROD, youngs_modulus=1e8, poisson_ratio=0.3, density=1200)
    points = np.stack([r * np.sin(angle), 0 * angle, r * np.cos(angle)], axis=1)
    rod = cf.Rod("rod", section, points, n_elements=200)
    found = []
    for friction in (0.0, 0.3):
        term = cf.PartContact(rod, part, friction=friction, stand_off=2e-5)
        model = cf.Model([rod], [], [term])
        state = Approach(model).begin(model.initial_state())
        times = []
        for _ in range(repeats):
            moved = model.space.update(state, np.full((model.space.n_nodes, 6), 1e-9))
            start = time.process_time()
            blocks = term(moved, model.space)
            times.append(time.process_time() - start)
        found.append(1e3 * min(times))
    return found, len(blocks.nodes)


def capstan(friction, turn, per_half_turn, R=0.1, a=0.002, T1=10.0):
    """Rope pulled over a drum: model, times, exponent of the tension along the wrap."""
    EI = T1 * (0.01 * R) ** 2
    section = cf.Section(force_stiffness=3 * (1e5,), moment_stiffness=3 * (EI,), mass_per_length=0.01, radius=a)
    r, free = R + a + 2e-5, 0.05
    h = np.pi * r / per_half_turn
    points, out = round_a_drum(r, turn, h, free)
    rod = cf.Rod("rope", section, points, n_elements=round((turn * r + 2 * free) / h))
    drum = cf.Part("drum", shape=cf.Cylinder((0, 0, -0.05), (0, 0, 0.05), R))
    puller = cf.Part("puller", motion=cf.Slider(tuple(out), 1.0))
    terms = [cf.PartContact(rod, drum, friction=friction, pressure=T1 / R), cf.PointLoad(rod, "start", (0, -T1, 0))]
    model = cf.Model([rod], [cf.Pin(rod, "end", to=puller)], terms)
    start = time.process_time()
    history = cf.solve_quasistatic(model, a * np.arange(6) / 2)
    cpu = time.process_time() - start
    s, tension = history.stations(rod), history.section_forces(rod)[-1, :, 2]
    place = np.stack([np.interp(s, history.nodes(rod), x) for x in history.positions(rod)[-1].T], axis=1)
    at = np.unwrap(np.arctan2(place[:, 1], -place[:, 0]))
    inside = (at > 0.1 * turn) & (at < 0.9 * turn)
    exponent = np.polyfit(at[inside], np.log(tension[inside]), 1)[0]
    error = np.expm1((exponent - contact_references.capstan_exponent(friction, a, R)) * turn)
    return error, cpu, [record.iterations for record in history.records]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30)
    repeats = parser.parse_args().repeats
    logging.getLogger("cosserat_fem").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        parts = {
            "sphere": cf.Part("sphere", shape=cf.Sphere((0, 0, 0), RADIUS)),
            "82 000 triangles": cf.Part("mesh", mesh=sphere_mesh(folder)),
        }
        print("one evaluation with tangent, 200 elements   ms frictionless   ms friction   elements touching")
        for name, part in parts.items():
            (plain, rubbing), n = evaluations(part, repeats)
            print(f"{name:<43} {plain:15.2f} {rubbing:13.2f} {n:18d}")
    print("\ncapstan: friction, turn / pi, elements per pi   error T2/T1   CPU s   iterations a station")
    for friction, turn in ((0.1, 1.0), (0.3, 1.0), (0.6, 1.0), (0.3, 1.9), (0.6, 1.9)):
        for n in (20, 40):
            try:
                capstan(friction, turn * np.pi, n)
            except cf.ConvergenceError as fault:
                print(f"{friction:8.1f} {turn:8.1f} {n:8d}   {str(fault).split(',')[0]}")
                continue
            error, cpu, iterations = capstan(friction, turn * np.pi, n)
            print(f"{friction:8.1f} {turn:8.1f} {n:8d} {error:34.1e} {cpu:8.2f} {np.median(iterations):12.0f}")
    scene = cf.load_scene(ROOT / "examples" / "hinge_with_bracket.toml")
    cf.solve_quasistatic(scene.model, scene.times)
    start = time.process_time()
    history = cf.solve_quasistatic(scene.model, scene.times)
    iterations = [record.iterations for record in history.records]
    print(
        f"\nhinge with bracket: {len(history)} stations, {time.process_time() - start:.2f} CPU s, iterations a station: "
        f"median {np.median(iterations):.0f}, most {max(iterations)}"
    )


if __name__ == "__main__":
    main()
