"""Exudyn: geometrically exact beams, planar with two or three nodes, in space with two (Euler parameters).

Planar problems run on the planar elements, which are the faster; problems in space on ObjectBeamGeometricallyExact.
Statics in as few load steps as converge, S3 from the guess that all tools share; small systems with the dense solver, D3
with the static solver in load steps that are its stations, and in time. Time: generalized alpha, modified Newton, which
is faster at the same error.
"""

import warnings
from itertools import pairwise

import numpy as np

from cosserat_fem.bench import problems as p
from run import Case, Clock, Failed, Run

warnings.filterwarnings("ignore", category=DeprecationWarning)
import exudyn as exu
import exudyn.itemInterface as item

NODES = {"linear": 2, "quadratic": 3}


class Planar:
    """A chain of planar elements along x; `start` gives places and angles of its nodes to begin from."""

    def __init__(self, beam, n, kind, *, start=None, gravity=0.0, damping=0.0):
        self.container = exu.SystemContainer()
        self.system = mbs = self.container.AddSystem()
        self.per = NODES[kind] - 1
        self.s = np.linspace(0, beam.length, n * self.per + 1)
        r, angle = (np.stack([self.s, 0 * self.s], axis=1), 0 * self.s) if start is None else start(self.s)
        self.nodes = [
            mbs.AddNode(item.NodeRigidBody2D(
                referenceCoordinates=[s, 0, 0], initialCoordinates=[x - s, y, a],
                initialVelocities=[0, 0, 0],
            ))
            for s, (x, y), a in zip(self.s, r, angle, strict=True)
        ]  # fmt: skip
        for k in range(n):
            element = mbs.AddObject(item.ObjectBeamGeometricallyExact2D(
                nodeNumbers=self.nodes[self.per * k : self.per * (k + 1) + 1], length=beam.length / n,
                massPerLength=beam.mass or 1.0, crossSectionInertia=beam.inertia[1] or 1e-3,
                bendingStiffness=beam.EI, axialStiffness=beam.EA, shearStiffness=beam.GA,
                bendingDamping=damping * beam.EI, axialDamping=damping * beam.EA, shearDamping=damping * beam.GA,
            ))  # fmt: skip
            if gravity:
                marker = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=element))
                mbs.AddLoad(item.LoadMassProportional(markerNumber=marker, loadVector=[0, -gravity, 0]))
        ground = mbs.AddNode(item.NodePointGround())
        self.ground = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        self.dofs = 3 * len(self.nodes)

    def hold(self, node, coordinates, offsets=(None, None, None), rates=(None, None, None)):
        """Hold coordinates of a node at zero, or at offset(t) from the drawing; return the constraints."""
        made = []
        for coordinate, offset, rate in zip(coordinates, offsets, rates, strict=False):
            marker = self.system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
            constraint = item.ObjectConnectorCoordinate(markerNumbers=[self.ground, marker])
            if isinstance(offset, float):
                constraint.offset = offset
            elif offset is not None:
                constraint.offsetUserFunction = lambda mbs, t, k, o, f=offset: f(t)
                constraint.offsetUserFunction_t = lambda mbs, t, k, o, f=rate: f(t)
            made.append(self.system.AddObject(constraint))
        return made

    def place(self, node):
        return np.array(self.system.GetNodeOutput(node, exu.OutputVariableType.Position))


def in_space(beam, places, angles):
    """A chain in space of nodes with Euler parameters, turned by angles about z."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    section = exu.BeamSection()
    section.stiffnessMatrix = np.diag([beam.EA, beam.GA, beam.GA, beam.GJ, beam.EI, beam.EI])
    section.inertia = np.diag([beam.inertia[0] or 1.0, beam.inertia[1] or 1.0, beam.inertia[1] or 1.0])
    section.massPerLength = beam.mass or 1.0
    nodes = [
        mbs.AddNode(item.NodeRigidBodyEP(referenceCoordinates=[*x, np.cos(a / 2), 0, 0, np.sin(a / 2)]))
        for x, a in zip(places, angles, strict=True)
    ]
    for a, b in pairwise(nodes):
        mbs.AddObject(
            item.ObjectBeamGeometricallyExact(
                nodeNumbers=[a, b], length=beam.length / (len(nodes) - 1), sectionData=section
            )
        )
    return container, mbs, nodes


def settings(*, dense=False, tolerance=1e-8):
    chosen = exu.SimulationSettings()
    chosen.solutionSettings.writeSolutionToFile = False
    chosen.solutionSettings.solutionInformation = ""
    chosen.linearSolverType = exu.LinearSolverType.EXUdense if dense else exu.LinearSolverType.EigenSparse
    chosen.parallel.numberOfThreads = 1
    for solver in (chosen.staticSolver, chosen.timeIntegration):
        solver.verboseMode = 0
        solver.newton.relativeTolerance = tolerance
        solver.newton.absoluteTolerance = 1e-10
    return chosen


def static(mbs, chosen, steps, modified=False):
    """CPU seconds and iterations of the static solver."""
    mbs.Assemble()
    chosen.staticSolver.numberOfLoadSteps = steps
    chosen.staticSolver.newton.useModifiedNewton = modified
    clock = Clock()
    with clock():
        found = mbs.SolveStatic(chosen)
    if not found:
        raise Failed("the static solver stopped")
    return clock.cpu, mbs.sys["staticSolver"].it.newtonStepsCount


def in_time(mbs, chosen, duration, dt, every, *, rho_inf=0.9, modified=False):
    """CPU seconds, iterations and steps of the implicit time integration."""
    mbs.Assemble()
    scheme = chosen.timeIntegration
    scheme.endTime, scheme.numberOfSteps = duration, round(duration / dt)
    scheme.generalizedAlpha.spectralRadius = rho_inf
    scheme.newton.useModifiedNewton = modified
    chosen.solutionSettings.sensorsWritePeriod = every
    clock = Clock()
    with clock():
        found = mbs.SolveDynamic(chosen)
    if not found:
        raise Failed("the time integration stopped")
    return clock.cpu, mbs.sys["dynamicSolver"].it.newtonStepsCount, int(scheme.numberOfSteps)


def sensed(mbs, sensor, times):
    data = np.array(mbs.GetSensorStoredData(sensor))
    nearest = np.abs(data[:, :1] - times).argmin(axis=0)
    if np.abs(data[nearest, 0] - times).max() > 1e-6:
        raise Failed("it cut its step and missed output times")
    return data[nearest, 1:]


def planar_cantilever(beam, n, kind, steps, *, force=None, couple=None, dense=False, modified=False, tolerance=1e-8):
    chain = Planar(beam, n, kind)
    mbs = chain.system
    chain.hold(chain.nodes[0], (0, 1, 2))
    tip = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=chain.nodes[-1]))
    if force is not None:
        mbs.AddLoad(item.LoadForceVector(markerNumber=tip, loadVector=list(force)))
    if couple is not None:
        mbs.AddLoad(item.LoadTorqueVector(markerNumber=tip, loadVector=[0, 0, couple]))
    cpu, iterations = static(mbs, settings(dense=dense, tolerance=tolerance), steps, modified)
    return Run(chain.place(chain.nodes[-1]), cpu, chain.dofs, iterations)


def slack(n, kind, steps, *, dense=False, modified=False):
    chain = Planar(p.SLACK, n, kind, start=p.slack_guess, gravity=p.SLACK_GRAVITY)
    chain.hold(chain.nodes[0], (0, 1, 2))
    chain.hold(chain.nodes[-1], (0, 1, 2), offsets=(p.SLACK_SPAN - p.SLACK.length, None, None))
    chosen = settings(dense=dense)
    chosen.staticSolver.loadStepStart = 0
    cpu, iterations = static(chain.system, chosen, steps, modified)
    return Run((chain.s, np.array([chain.place(node) for node in chain.nodes])), cpu, chain.dofs, iterations)


def bend(n, steps, *, dense=False, modified=False, tolerance=1e-8):
    places, angles = p.bend_arc(np.linspace(0, p.BEND.length, n + 1))
    _, mbs, nodes = in_space(p.BEND, places, angles)
    ground = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=mbs.AddNode(item.NodePointGround())))
    clamp = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[0]))
    mbs.AddObject(item.ObjectJointGeneric(markerNumbers=[ground, clamp]))
    tip = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[-1]))
    mbs.AddLoad(item.LoadForceVector(markerNumber=tip, loadVector=list(p.BEND_FORCE)))
    cpu, iterations = static(mbs, settings(dense=dense, tolerance=tolerance), steps, modified)
    place = np.array(mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Position))
    return Run(place, cpu, 7 * len(nodes), iterations)


def spaghetti(n, dt, *, dense=False, modified=False):
    start, end = p.SPAGHETTI_ENDS
    along = end - start
    places = start + np.linspace(0, 1, n + 1)[:, None] * along
    _, mbs, nodes = in_space(p.SPAGHETTI, places, np.full(n + 1, np.arctan2(along[1], along[0])))
    loaded = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[0]))
    times, values = p.SPAGHETTI_KNOTS
    for kind, direction in (
        (item.LoadForceVector, p.SPAGHETTI_FORCE), (item.LoadTorqueVector, p.SPAGHETTI_COUPLE)
    ):  # fmt: skip
        mbs.AddLoad(kind(
            markerNumber=loaded, loadVector=list(direction),
            loadVectorUserFunction=lambda mbs, t, v: list(float(np.interp(t, times, values)) * np.array(v)),
        ))  # fmt: skip
    sensors = [
        mbs.AddSensor(item.SensorNode(
            nodeNumber=node, storeInternal=True, outputVariableType=exu.OutputVariableType.Position
        ))
        for node in (nodes[0], nodes[-1])
    ]  # fmt: skip
    output = p.PROBLEMS["D1"].times
    told = in_time(mbs, settings(dense=dense), output[-1], dt, output[1], modified=modified)
    ends = np.stack([sensed(mbs, sensor, output) for sensor in sensors], axis=1)
    return Run(ends, told[0], 7 * len(nodes), *told[1:])


def pendulum(n, kind, dt, *, dense=False, modified=False, rho_inf=0.9):
    chain = Planar(p.PENDULUM, n, kind, gravity=p.PENDULUM_GRAVITY)
    chain.hold(chain.nodes[0], (0, 1))
    sensor = chain.system.AddSensor(item.SensorNode(
        nodeNumber=chain.nodes[-1], storeInternal=True, outputVariableType=exu.OutputVariableType.Position
    ))  # fmt: skip
    output = p.PROBLEMS["D2"].times
    told = in_time(
        chain.system, settings(dense=dense), output[-1], dt, output[1], modified=modified, rho_inf=rho_inf
    )  # fmt: skip
    return Run(sensed(chain.system, sensor, output), told[0], chain.dofs, *told[1:])


def followed(n, kind, damping):
    """Chain whose end follows the arm, and sensors of the force and couple that hold it."""
    chain = Planar(p.FOLLOW, n, kind, damping=damping)
    chain.hold(chain.nodes[0], (0, 1, 2))
    rate, arm, from_end = p.FOLLOW_RATE, p.FOLLOW_ARM, p.FOLLOW_PIVOT - p.FOLLOW.length
    held = chain.hold(
        chain.nodes[-1], (0, 1, 2),
        (lambda t: from_end + arm * np.cos(rate * t), lambda t: arm * np.sin(rate * t), lambda t: rate * t),
        (lambda t: -arm * rate * np.sin(rate * t), lambda t: arm * rate * np.cos(rate * t), lambda t: rate),
    )  # fmt: skip
    sensors = [
        chain.system.AddSensor(item.SensorObject(
            objectNumber=k, storeInternal=True, outputVariableType=exu.OutputVariableType.Force
        ))
        for k in held
    ]  # fmt: skip
    return chain, sensors


def follow_in_time(n, kind, dt, *, damping=1e-2, rho_inf=0.6):
    chain, sensors = followed(n, kind, damping)
    output = p.PROBLEMS["D3"].times
    told = in_time(chain.system, settings(), output[-1], dt, output[1], rho_inf=rho_inf)
    reaction = np.concatenate([sensed(chain.system, sensor, output)[:, :1] for sensor in sensors], axis=1)
    return Run(-reaction, told[0], chain.dofs, *told[1:])


def follow(n, kind, *, modified):
    """The static solver in load steps of one second; it starts after the first station, where nothing is strained."""
    chain, sensors = followed(n, kind, 0.0)
    output = p.PROBLEMS["D3"].times
    chosen = settings()
    chosen.staticSolver.loadStepDuration = output[-1]
    chosen.solutionSettings.sensorsWritePeriod = output[1]
    cpu, iterations = static(chain.system, chosen, len(output) - 1, modified)
    reaction = np.zeros((len(output), 3))
    for k, sensor in enumerate(sensors):
        reaction[1:, k] = sensed(chain.system, sensor, output[1:])[:, 0]
    return Run(reaction, cpu, chain.dofs, iterations)  # its multipliers change their sign between statics and time


def cases(name):
    """Every case of a problem."""

    def of(method, resolution, solve, *args, **options):
        found.append(Case(method, resolution, lambda: solve(*args, **options)))

    found = []
    if name == "S1":
        for kind, n in (("linear", 4), ("linear", 8), ("linear", 16), ("quadratic", 4)):
            for steps, dense in ((1, True), (1, False), (3, False)):
                of(
                    f"planar, {kind}", f"n={n}, {steps} load steps{', dense' * dense}", planar_cantilever, p.ROLL_UP, n,
                    kind, steps, couple=p.ROLL_UP_COUPLE, dense=dense,
                )  # fmt: skip
    elif name == "S4":
        meshes = {"linear": (4, 8, 16, 32), "quadratic": (2, 3, 4, 6, 8, 10, 12, 16, 20, 32)}
        for kind, n in ((kind, n) for kind, ns in meshes.items() for n in ns):
            for steps, tolerance in ((2, 1e-8), (2, 1e-10), (3, 1e-10), (5, 1e-10)):
                for dense in (True, False) if n < 10 else (False,):
                    of(
                        f"planar, {kind}", f"n={n}, {steps} load steps, tol {tolerance:g}{', dense' * dense}",
                        planar_cantilever, p.ELASTICA, n, kind, steps, force=p.ELASTICA_FORCE, dense=dense,
                        tolerance=tolerance,
                    )  # fmt: skip
    elif name == "S2":
        for n in (4, 8, 12, 16, 40, 64, 120, 256):
            for steps in (2, 3, 5):
                of("in space", f"n={n}, {steps} load steps", bend, n, steps, tolerance=1e-6)
    elif name == "S3":
        meshes = {"linear": (8, 16, 24, 32, 64), "quadratic": (4, 6, 8, 12, 14, 16, 24, 32, 48, 64)}
        for kind, n in ((kind, n) for kind, ns in meshes.items() for n in ns):
            for steps in (1, 3):
                of(f"planar, {kind}", f"n={n}, {steps} load steps", slack, n, kind, steps)
    elif name == "D1":
        for n, dt in ((8, 0.05), (10, 0.05), (16, 0.02), (24, 0.0125), (32, 0.01), (64, 0.005), (72, 0.004)):
            of("in space, modified Newton", f"n={n}, dt={dt:g}", spaghetti, n, dt, modified=True)
        for n, dt in ((8, 0.05), (16, 0.02)):
            of("in space, full Newton", f"n={n}, dt={dt:g}", spaghetti, n, dt)
    elif name == "D2":
        for kind, n, dt in (
            ("linear", 8, 0.01), ("linear", 16, 0.005), ("quadratic", 4, 0.01), ("quadratic", 6, 0.01),
            ("quadratic", 6, 0.005), ("quadratic", 6, 1 / 300), ("quadratic", 8, 0.005), ("quadratic", 8, 0.0025),
            ("quadratic", 12, 0.0025), ("quadratic", 14, 1 / 600), ("quadratic", 18, 1 / 600), ("quadratic", 18, 0.00125),
            ("quadratic", 24, 0.001), ("quadratic", 24, 5e-4), ("quadratic", 32, 5e-4), ("quadratic", 48, 2.5e-4),
        ):  # fmt: skip
            of(f"planar, {kind}, modified Newton", f"n={n}, dt={dt:g}", pendulum, n, kind, dt, modified=True)
        of("planar, quadratic, full Newton", "n=8, dt=0.005", pendulum, 8, "quadratic", 0.005)
    elif name == "D3":
        meshes = {"linear": (8, 16, 32, 64), "quadratic": (4, 6, 8, 12, 16, 32)}
        for kind, n in ((kind, n) for kind, ns in meshes.items() for n in ns):
            for modified in (True, False):
                newton = "modified" if modified else "full"
                of(f"planar, {kind}, static, {newton} Newton", f"n={n}", follow, n, kind, modified=modified)
        for n in (8, 16):
            of("planar, quadratic, in time", f"n={n}, dt=1", follow_in_time, n, "quadratic", 1.0)
    return found
