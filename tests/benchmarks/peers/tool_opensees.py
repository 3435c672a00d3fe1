"""OpenSees: corotational elasticBeamColumn elements (shear-rigid, with axial stretch), in a plane and in space.

The profile solver, and a Newton tolerance of 1e-6 of the length in displacement, are the fastest at equal error here.
Mass is lumped, rotary inertia is given to the nodes; time by HHT 0.9. In a plane its transformation fails where a chord
turns by more than half a turn (S1, D2), so these run in space.
"""

import contextlib
import ctypes
import os
import pathlib
from importlib import util

import numpy as np

from cosserat_fem.bench import problems as p
from run import Case, Clock, Failed, Run

for spec in filter(None, [util.find_spec("openseespylinux")]):  # its wheel does not find the BLAS that it brings along
    for library in (pathlib.Path(spec.origin).parent / "lib").glob("lib*blas.so*"):
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
import openseespy.opensees as ops


@contextlib.contextmanager
def silent():
    """Without what the library writes to the process's own standard error."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def chain(beam, places):
    """Nodes 0..n and elements 1..n; planar if places are."""
    dimension = places.shape[1]
    ops.wipe()
    ops.model("basic", "-ndm", dimension, "-ndf", 3 if dimension == 2 else 6)
    ops.geomTransf("Corotational", 1, *(() if dimension == 2 else (0.0, 0.0, 1.0)))
    for k, place in enumerate(places):
        ops.node(k, *map(float, place))
    second = beam.EI / beam.EA
    torsion = () if dimension == 2 else (1.0, beam.GJ, second)
    for k in range(len(places) - 1):
        ops.element(
            "elasticBeamColumn", k + 1, k, k + 1, 1.0, beam.EA, *torsion, second, 1, "-mass", beam.mass
        )  # fmt: skip


def solver(tolerance, *, handler="Plain", iterations=50):
    ops.wipeAnalysis()
    ops.constraints(handler)
    ops.numberer("RCM")
    ops.system("ProfileSPD")
    ops.test("NormDispIncr", tolerance, iterations, 0)
    ops.algorithm("Newton")


def load_steps(steps, clock):
    """Iterations of `steps` equal load steps."""
    ops.integrator("LoadControl", 1.0 / steps)
    ops.analysis("Static")
    count = 0
    with clock():
        for k in range(steps):
            if ops.analyze(1):
                raise Failed(f"load step {k + 1} of {steps} failed")
            count += ops.testIter()
    return count


def cantilever(beam, n, steps, *, places, load):
    dimension = places.shape[1]
    chain(beam, places)
    ops.fix(0, *([1] * (3 if dimension == 2 else 6)))
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(n, *map(float, load))
    solver(1e-6 * beam.length)
    clock = Clock()
    count = load_steps(steps, clock)
    tip = np.zeros(3)
    tip[:dimension] = places[-1] + ops.nodeDisp(n)[:dimension]
    return Run(tip, clock.cpu, (3 if dimension == 2 else 6) * n, count)


def slack(n, steps):
    """Weight on the straight cable first, then the clamp moves in."""
    s = np.linspace(0, p.SLACK.length, n + 1)
    places = np.stack([s, 0 * s], axis=1)
    chain(p.SLACK, places)
    ops.fix(0, 1, 1, 1)
    ops.fix(n, 0, 1, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    weight = -p.SLACK.mass * p.SLACK_GRAVITY * p.SLACK.length / n
    for k in range(n + 1):
        ops.load(k, 0.0, weight * (0.5 if k in (0, n) else 1.0), 0.0)
    solver(1e-9)
    clock = Clock()
    count = load_steps(4, clock)
    ops.loadConst("-time", 0.0)
    ops.timeSeries("Linear", 2)
    ops.pattern("Plain", 2, 2)
    ops.sp(n, 1, p.SLACK_SPAN - p.SLACK.length)
    solver(1e-9, handler="Transformation", iterations=60)
    count += load_steps(steps, clock)
    moved = np.array([ops.nodeDisp(k)[:2] for k in range(n + 1)])
    return Run((s, places + moved), clock.cpu, 3 * n, count)


def march(duration, dt, times, observe):
    """Observed at output times, CPU seconds, iterations and steps of a run in time."""
    solver(1e-8, iterations=30)
    ops.integrator("HHT", 0.9)
    ops.analysis("Transient")
    every, steps, count = round(times[1] / dt), round(duration / dt), 0
    found, clock = [observe()], Clock()
    with clock():
        for k in range(1, steps + 1):
            if ops.analyze(1, dt):
                raise Failed(f"time step {k} of {steps} failed")
            count += ops.testIter()
            if k % every == 0:
                found.append(observe())
    return np.array(found), clock.cpu, count, steps


def lumped(beam, n):
    """Shares of the length at the nodes, and rotary inertia put there."""
    share = np.full(n + 1, beam.length / n)
    share[[0, -1]] /= 2
    about, across = beam.inertia
    for k in range(n + 1):
        ops.mass(k, 0.0, 0.0, 0.0, about * share[k], across * share[k], across * share[k])
    return share


def spaghetti(n, dt):
    start, end = p.SPAGHETTI_ENDS
    chain(p.SPAGHETTI, start + np.linspace(0, 1, n + 1)[:, None] * (end - start))
    lumped(p.SPAGHETTI, n)
    times, values = p.SPAGHETTI_KNOTS
    ops.timeSeries("Path", 1, "-time", *times, "-values", *values)
    ops.pattern("Plain", 1, 1)
    ops.load(0, *p.SPAGHETTI_FORCE, *p.SPAGHETTI_COUPLE)
    output = p.PROBLEMS["D1"].times
    moved, *told = march(output[-1], dt, output, lambda: [ops.nodeDisp(0)[:3], ops.nodeDisp(n)[:3]])
    return Run(moved + p.SPAGHETTI_ENDS, told[0], 6 * (n + 1), *told[1:])


def pendulum(n, dt):
    beam = p.PENDULUM
    s = np.linspace(0, beam.length, n + 1)
    chain(beam, np.stack([s, 0 * s, 0 * s], axis=1))
    ops.fix(0, 1, 1, 1, 1, 0, 0)
    share = lumped(beam, n)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for k in range(n + 1):
        ops.load(k, 0.0, -beam.mass * p.PENDULUM_GRAVITY * share[k], 0.0, 0.0, 0.0, 0.0)
    output = p.PROBLEMS["D2"].times
    moved, *told = march(output[-1], dt, output, lambda: ops.nodeDisp(n)[:2])
    return Run(moved + [beam.length, 0.0], told[0], 6 * n + 2, *told[1:])


def cases(name):
    """Every case of a problem; D3 is not solved (no support that follows a path in large rotations)."""

    def of(method, resolution, solve, *args, **options):
        def run():
            with silent():
                return solve(*args, **options)

        found.append(Case(method, resolution, run))

    found = []
    if name in ("S1", "S4"):
        beam = p.ROLL_UP if name == "S1" else p.ELASTICA
        for n in (8, 11, 16, 32, 34, 64) if name == "S4" else (16, 32):
            s = np.linspace(0, beam.length, n + 1)
            in_space = np.stack([s, 0 * s, 0 * s], axis=1)
            if name == "S4":
                force = p.ELASTICA_FORCE
                for steps in (2, 3, 5):
                    of("planar", f"n={n}, {steps} load steps", cantilever, beam, n, steps, places=in_space[:, :2],
                       load=(*force[:2], 0.0))  # fmt: skip
            else:
                for steps in (10, 20):
                    of("in space", f"n={n}, {steps} load steps", cantilever, beam, n, steps, places=in_space,
                       load=(0, 0, 0, 0, 0, p.ROLL_UP_COUPLE))  # fmt: skip
    elif name == "S2":
        for n in (3, 4, 8, 12, 16, 22, 24, 32, 40):
            places, _ = p.bend_arc(np.linspace(0, p.BEND.length, n + 1))
            for steps in (2, 3, 5):
                of("in space", f"n={n}, {steps} load steps", cantilever, p.BEND, n, steps, places=places,
                   load=(*p.BEND_FORCE, 0, 0, 0))  # fmt: skip
    elif name == "S3":
        for n in (8, 16, 32, 64):
            for steps in (20, 100):
                of("planar", f"n={n}, {steps} steps", slack, n, steps)
    elif name == "D1":
        for n, dt in ((8, 0.05), (16, 0.02), (32, 0.01)):
            of("in space, HHT", f"n={n}, dt={dt:g}", spaghetti, n, dt)
    elif name == "D2":
        for n, dt in ((8, 5e-3), (16, 2e-3), (32, 1e-3)):
            of("in space, HHT", f"n={n}, dt={dt:g}", pendulum, n, dt)
    return found
