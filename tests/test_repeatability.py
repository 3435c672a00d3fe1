"""A run is the same to the last bit each time, on one thread and on two, and holds no more memory the longer it takes."""

import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

import cosserat_fem as cf

# Digests of what the bench's problems give, by (name, elements, order, step)
PROGRAM = """
import hashlib, sys
import numpy as np
from cosserat_fem.bench.models import SOLVERS, Case
from cosserat_fem.motion.steps import AdaptiveStep, FixedStep
for text in sys.argv[1:]:
    name, n, order, step = text.split(",")
    solver, case = SOLVERS[name], Case(int(n), int(order), eval(step))
    model = solver.build(case)
    history = solver.solve(model, case)
    digest = hashlib.sha256()
    for record in history.records:
        for array in (record.state.r, record.state.q, record.reactions, *record.state.stress):
            digest.update(np.ascontiguousarray(array).tobytes())
    print(name, digest.hexdigest())
"""
QUICK = ["S2,6,3,None", "S4,200,2,None", "D3,4,3,None", "D2,3,2,FixedStep(0.01)"]
LONG = [*QUICK, "B03,16,3,None", "C1,54,3,None", "D1,6,3,AdaptiveStep(1e-2)", "S2,3000,3,None"]


def digests(cases, threads):
    """What a fresh process prints, with its own order of sets and its own number of threads."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    environment.pop("PYTHONHASHSEED", None)
    command = [sys.executable, "-c", PROGRAM, *cases]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.mark.parametrize("cases", [QUICK, pytest.param(LONG, marks=pytest.mark.slow)], ids=["quick", "long"])
def test_same_bits(cases):
    first = digests(cases, 1)
    assert [line.split()[0] for line in first] == [case.split(",")[0] for case in cases]
    assert digests(cases, 2) == first
    if cases is LONG:
        assert digests(cases, 1) == first
        assert digests(cases, 2) == first


REMEMBERED = 250_000  # bytes: places of supports at the last thousand times, and what belongs to them


@pytest.mark.parametrize("steps", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_memory_is_flat(steps):
    """A pendulum over many steps of which few states are kept: only the log of steps grows."""
    section = cf.Section.round(0.01, youngs_modulus=5e8, poisson_ratio=0.3, density=1100.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=2, order=1)
    terms = [cf.Gravity((0, 0, -9.81)), cf.Damping(mass=1.0)]
    model = cf.Model([rod], [cf.Pin(rod, "start")], terms)
    held = {}

    def look(run):
        done = len(run.history.steps)
        if done in (steps * 3 // 5, steps):
            held[done] = tracemalloc.get_traced_memory()[0]

    def solve(n, **options):
        times = np.linspace(0, 1e-3 * n, 11)
        return cf.solve_dynamic(model, 1e-3 * n, start="drawn", step=cf.FixedStep(1e-3), times=times, **options)

    solve(10)  # kernels are loaded
    tracemalloc.start()
    try:
        history = solve(steps, callback=look)
    finally:
        tracemalloc.stop()
    assert len(history) == 11
    assert len(history.steps) == steps
    row = history.steps[-1]
    logged = (sys.getsizeof(row) + 3 * sys.getsizeof(row[0]) + 9) * 0.4 * steps  # 9: of the list, with what it reserves
    assert held[steps] - held[steps * 3 // 5] < logged + REMEMBERED
