"""A rod with clamped ends is twisted until it buckles; another with some slack until it coils up round itself.

The straight rod, one end free to move along its axis, buckles at Greenhill's torque, M L / EI = 2.8606 pi. The other one's
ends come nearer by half of its length, then one turns, in a medium that damps all motion: the arch becomes a loop, at 2.4
turns its legs meet, from 3.4 turns on they wind round each other along a fifth of the rod.
"""

import numpy as np

import cosserat_fem as cf

LENGTH, RADIUS = 1.0, 0.02
SECTION = cf.Section(
    force_stiffness=(4e4, 4e4, 4e4), moment_stiffness=(1.0, 1.0, 0.75), mass_per_length=0.05,
    rotary_inertia=(1e-5, 1e-5, 2e-5), radius=RADIUS,
)  # fmt: skip


def buckle(turns):
    """Torque M L / EI of the first rod, and how far it has bent [m]."""
    rod = cf.Rod("rod", SECTION, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=20)
    chuck = cf.Part("chuck", motion=cf.Hinge((0, 0, 0), (1, 0, 0), 2 * np.pi))
    turned = cf.Clamp(rod, "start", to=chuck)
    history = cf.solve_quasistatic(cf.Model([rod], [turned, cf.Clamp(rod, "end", free="x")]), turns)
    return history.reaction(turned)[:, 3] * LENGTH, np.abs(history.positions(rod)[:, :, 1:]).max(axis=(1, 2))


def coil(turns=4, pace=1.0, dt=0.01):
    """History of the slack rod, the turned clamp, and the turns at each state; pace [s] of a turn."""
    s = np.linspace(0, LENGTH, 21)
    points = np.stack([s, 0 * s, 2e-3 * np.sin(np.pi * s / LENGTH) ** 2], axis=1)
    rod = cf.Rod("rod", SECTION, points, start_tangent=(1, 0, 0), end_tangent=(1, 0, 0), rest="as_drawn")
    times = [0, 1, 1 + pace * turns]
    chuck = cf.Part("chuck", motion=cf.Hinge((0, 0, 0), (1, 0, 0), (times, [0, 0, 2 * np.pi * turns]), smooth=True))
    carriage = cf.Part("carriage", motion=cf.Slider((-1, 0, 0), (times, [0, LENGTH / 2, LENGTH / 2]), smooth=True))
    turned = cf.Clamp(rod, "start", to=chuck)
    touching = cf.RodContact([rod], stand_off=0.1 * RADIUS, pressure=2e4)
    model = cf.Model([rod], [turned, cf.Clamp(rod, "end", to=carriage)], [touching, cf.Damping(mass=2000)])
    kept = np.linspace(1, times[-1], 4 * turns + 1)
    history = cf.solve_dynamic(model, times[-1], start="drawn", step=cf.FixedStep(dt), rho_inf=0.0, times=kept)
    return history, turned, [chuck.motion.angle_at(t) / (2 * np.pi) for t in kept]


def main():
    """Torque M L / EI in parts of pi up to which the first rod is straight."""
    torque, bent = buckle(np.linspace(1.88, 1.91, 7))
    straight = torque[bent < 1e-6] / np.pi
    print(f"straight up to M L / EI = {straight[-1]:.4f} pi, bent by {bent[-1]:.3f} m a little later")
    history, turned, turns = coil()
    print("turns  M L / EI / pi  push N  touching, m of the rod  places  largest N/m")
    for k, told in enumerate(history.pressed("rod-rod")):
        force = history.reaction(turned)[k]
        text = f"{turns[k]:5.2f}  {force[3] * LENGTH / np.pi:13.3f}  {force[0]:6.1f}"
        print(f"{text}  {np.diff(told.spans).sum():22.3f}  {len(told.spans):6d}  {told.peak:11.0f}")
    print(history.message)
    return straight[-1]


if __name__ == "__main__":
    main()
