"""A rubber rod, pinned at one end, falls from the horizontal: accuracy against cost of the step control."""

import time

import numpy as np

import cosserat_fem as cf

LENGTH, DIAMETER, YOUNG, DENSITY = 1.0, 0.01, 5e6, 1100.0
TIP = (-0.940095, -0.099102)  # after 1 s, by spectral elements in space and an eighth-order method in time


def solve(step, n_elements=16):
    section = cf.Section.round(
        DIAMETER, youngs_modulus=YOUNG, shear_modulus=YOUNG / 3, density=DENSITY, shear_factor=1.0
    )
    rod = cf.Rod("rod", section, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=n_elements)
    model = cf.Model([rod], [cf.Pin(rod, "start")], [cf.Gravity((0, -9.81, 0))])
    return cf.solve_dynamic(model, 1.0, start="drawn", step=step, times=np.linspace(0, 1, 101))


def main():
    """Distance of the tip from the reference after 1 s, in parts of the length, with extrapolated steps of 2 ms."""
    solve(cf.FixedStep(0.05))  # compiles
    print("step                      steps  tip error / L  energy open  CPU ms")
    for step in (cf.AdaptiveStep(1e-1), cf.AdaptiveStep(1e-2), cf.FixedStep(0.002), cf.FixedStep(0.002, True)):
        start = time.process_time()
        history = solve(step)
        spent = time.process_time() - start
        error = np.linalg.norm(history.positions("rod")[-1, -1, :2] - TIP)
        name = f"rtol {step.rtol:g}" if isinstance(step, cf.AdaptiveStep) else f"{1e3 * step.dt:g} ms"
        name += ", extrapolated" if getattr(step, "richardson", False) else ""
        print(f"{name:24s} {len(history.steps):6d}  {error:13.1e}  {history.ledger_gap:11.1e}  {1e3 * spent:6.0f}")
    return error


if __name__ == "__main__":
    main()
