"""PyElastica: explicit position Verlet on staggered rods; statics by dynamic relaxation.

Stiffness, mass and inertia are overwritten by the problem's. Relaxation: mass scaling (rotary inertia as large as the
time step of stretch allows), near-critical damping of the first mode, load over the first fifth of the time. Its clamp
holds the first element's directors, half an element away from the end: first order on S2.
"""

import contextlib
import io

import elastica as ea
import numpy as np

from cosserat_fem.bench import problems as p
from run import Case, Clock, Run


class Assembly(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping, ea.CallBacks):
    """What can be done to a rod."""


class EndLoad(ea.NoForces):
    """Force and spatial couple over time at one end."""

    def __init__(self, end, force=None, couple=None):
        super().__init__()
        self.end, self.force, self.couple = end, force, couple

    def apply_forces(self, system, time=0.0):
        if self.force is not None:
            system.external_forces[:, self.end] += self.force(time)

    def apply_torques(self, system, time=0.0):
        if self.couple is not None:
            system.external_torques[:, self.end] += system.director_collection[..., self.end] @ self.couple(time)


class Record(ea.CallBackBaseClass):
    """Places of some nodes every so many steps."""

    def __init__(self, every, nodes, kept):
        super().__init__()
        self.every, self.nodes, self.kept = every, nodes, kept

    def make_callback(self, system, time, current_step):
        if current_step % self.every == 0:
            self.kept[round(current_step / self.every)] = system.position_collection[:, self.nodes].T.copy()


def make(beam, places, *, mass=None, inertia=None, normal=(0.0, 0.0, 1.0), tangents=None):
    """Rod through places (n + 1, 3) whose rest lengths are its chords; d1 = normal."""
    n = len(places) - 1
    chords = np.diff(places, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    tangents = chords / lengths[:, None] if tangents is None else tangents
    rod = ea.CosseratRod.straight_rod(
        n, places[0], np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), beam.length, 0.01 * beam.length, 1000.0,
        youngs_modulus=1e6, shear_modulus=5e5,
    )  # fmt: skip
    rod.position_collection[:] = places.T
    first = np.tile(normal, (n, 1))
    rod.director_collection[:] = np.stack([first, np.cross(tangents, first), tangents]).transpose(0, 2, 1)
    rod.shear_matrix[:] = np.diag([beam.GA, beam.GA, beam.EA])[:, :, None]
    rod.bend_matrix[:] = np.diag([beam.EI, beam.EI, beam.GJ])[:, :, None]
    rod.rest_lengths[:] = lengths
    rod.rest_voronoi_lengths[:] = 0.5 * (lengths[1:] + lengths[:-1])
    step = beam.length / n
    about, across = (inertia, inertia) if inertia is not None else beam.inertia
    rod.mass[:] = (beam.mass if mass is None else mass) * step
    rod.mass[[0, -1]] /= 2
    second = np.diag([across, across, about]) * step
    rod.mass_second_moment_of_inertia[:] = second[:, :, None]
    rod.inv_mass_second_moment_of_inertia[:] = np.linalg.inv(second)[:, :, None]
    return rod


def integrate(assembly, duration, steps):
    """CPU seconds."""
    assembly.finalize()
    clock = Clock()
    with contextlib.redirect_stdout(io.StringIO()), clock():
        ea.integrate(ea.PositionVerlet(), assembly, duration, steps, progress_bar=False)
    return clock.cpu


def relax(rod, beam, n, assembly, frequency, times, inertia):
    """Relax for `times` periods / 2 pi of the first mode; CPU seconds and steps."""
    duration, step = times / frequency, beam.length / n
    fastest = max(
        2 * np.sqrt(beam.EA) / step,
        1.5 * np.sqrt(beam.GA / inertia + 4 * max(beam.EI, beam.GJ) / inertia / step**2),
    )
    steps = int(np.ceil(duration * fastest))
    assembly.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=2 * frequency, time_step=duration / steps
    )
    return integrate(assembly, duration, steps), steps


def cantilever(name, n, times=14.0):
    beam = p.PROBLEMS[name].beam
    step = beam.length / n
    s = np.linspace(0, beam.length, n + 1)
    places, tangents = np.stack([s, 0 * s, 0 * s], axis=1), None
    if name == "S2":
        places, _ = p.bend_arc(s)
        _, angle = p.bend_arc(s[:-1] + step / 2)
        tangents = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    inertia = max(step**2 / 4, beam.EI / beam.EA)
    rod = make(beam, places, mass=1.0, inertia=inertia, tangents=tangents)
    if name == "S2":
        rod.rest_kappa[:] = np.array([1 / p.BEND_RADIUS, 0, 0])[:, None]
    assembly = Assembly()
    assembly.append(rod)
    assembly.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    frequency = 3.516 * np.sqrt(beam.EI) / beam.length**2

    def grow(t):
        return min(1.0, t / (0.2 * times / frequency))

    force = np.array(p.BEND_FORCE) if name == "S2" else None
    couple = np.array([0, 0, p.ROLL_UP_COUPLE]) if name == "S1" else None
    assembly.add_forcing_to(rod).using(
        EndLoad, end=-1, force=None if force is None else lambda t: grow(t) * force,
        couple=None if couple is None else lambda t: grow(t) * couple,
    )  # fmt: skip
    cpu, steps = relax(rod, beam, n, assembly, frequency, times, inertia)
    return Run(rod.position_collection[:, -1].copy(), cpu, 6 * n + 3, steps=steps)


def recorded(assembly, rod, nodes, times, dt):
    """Run to the last of the times and return places at each, CPU seconds and steps."""
    kept = {}
    every, steps = round(times[1] / dt), round(times[-1] / dt)
    assembly.collect_diagnostics(rod).using(Record, every=every, nodes=nodes, kept=kept)
    cpu = integrate(assembly, times[-1], steps)
    return np.array([kept[k] for k in range(len(times))]), cpu, steps


def spaghetti(n, dt):
    start, end = p.SPAGHETTI_ENDS
    rod = make(p.SPAGHETTI, start + np.linspace(0, 1, n + 1)[:, None] * (end - start))
    assembly = Assembly()
    assembly.append(rod)
    times, values = p.SPAGHETTI_KNOTS
    assembly.add_forcing_to(rod).using(
        EndLoad, end=0,
        force=lambda t: np.interp(t, times, values) * np.array(p.SPAGHETTI_FORCE),
        couple=lambda t: np.interp(t, times, values) * np.array(p.SPAGHETTI_COUPLE),
    )  # fmt: skip
    ends, cpu, steps = recorded(assembly, rod, [0, -1], p.PROBLEMS["D1"].times, dt)
    return Run(ends, cpu, 6 * n + 3, steps=steps)


def pendulum(n, dt):
    s = np.linspace(0, p.PENDULUM.length, n + 1)
    rod = make(p.PENDULUM, np.stack([s, 0 * s, 0 * s], axis=1))
    assembly = Assembly()
    assembly.append(rod)
    assembly.constrain(rod).using(
        ea.GeneralConstraint, constrained_position_idx=(0,), constrained_director_idx=(0,),
        translational_constraint_selector=np.array([True] * 3), rotational_constraint_selector=np.array([False] * 3),
    )  # fmt: skip
    assembly.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0, -p.PENDULUM_GRAVITY, 0]))
    tip, cpu, steps = recorded(assembly, rod, [-1], p.PROBLEMS["D2"].times, dt)
    return Run(tip[:, 0], cpu, 6 * n + 3, steps=steps)


def cases(name):
    """Every case of a problem. S3 and S4 are left out: relaxation takes ten to sixty seconds for an error of a percent or
    more; D3 has no clamp that follows a path here."""

    def of(method, resolution, solve, *args):
        found.append(Case(method, resolution, lambda: solve(*args)))

    found = []
    if name in ("S1", "S2"):
        for n in (10, 20):
            of("relaxation", f"n={n}", cantilever, name, n)
    elif name == "D1":
        for n, dt in ((10, 5e-3), (20, 2e-3), (20, 1e-3), (20, 5e-4), (40, 2.5e-4)):
            of("Verlet", f"n={n}, dt={dt:g}", spaghetti, n, dt)
    elif name == "D2":
        for n, dt in ((16, 1e-4), (32, 1e-4), (64, 1e-4), (128, 5e-5)):
            of("Verlet", f"n={n}, dt={dt:g}", pendulum, n, dt)
    return found
