"""A cable is pressed down on another across it, then dragged along it: it sticks, then slips with Coulomb's friction.

Both are clamped at their ends. While it sticks, for about 0.9 mm, the upper cable bends; then friction is mu = 0.3 times the
force between them (0.1348 N after 5 mm). On the way out the slope of the pressed cable adds a little: 0.306 after 20 mm.
"""

import numpy as np

import cosserat_fem as cf

LENGTH, DIAMETER, FRICTION = 0.3, 0.004, 0.3
DOWN, DRAG = 0.005, 0.02  # travel of the ends of the upper cable [m]


def solve(n_elements=10):
    section = cf.Section.round(DIAMETER, youngs_modulus=5e8, poisson_ratio=0.3)
    half, top = LENGTH / 2, 1.1 * DIAMETER
    lower = cf.Rod("lower", section, [(-half, 0, 0), (half, 0, 0)], n_elements=n_elements)
    upper = cf.Rod("upper", section, [(0, -half, top), (0, half, top)], n_elements=n_elements)
    way = [(0, 0, 0), (0, 0, -DOWN), (DRAG, 0, -DOWN)]
    frame = cf.Part("frame", motion=cf.Path(([0, 1, 2], way, [(1, 0, 0, 0)] * 3)))
    held = [cf.Clamp(lower, "start"), cf.Clamp(lower, "end")]
    led = [cf.Clamp(upper, "start", to=frame), cf.Clamp(upper, "end", to=frame)]
    model = cf.Model([lower, upper], held + led, [cf.RodContact([lower, upper], friction=FRICTION)])
    return cf.solve_quasistatic(model, np.concatenate([np.linspace(0, 1, 6), np.linspace(1.02, 2, 50)])), led


def main():
    """Friction over normal force as the slip begins."""
    history, led = solve()
    force = sum(history.reaction(support)[:, :3] for support in led)  # on the upper cable, of its clamps
    normal, friction = -force[:, 2], force[:, 0]
    r = history.positions("upper")
    lift = r[:, len(r[0]) // 2, 2] - r[:, 0, 2]
    lost = history.friction_work("lower-upper")
    print("down mm  along mm  lift mm  normal N  friction N  friction / normal  lost mJ")
    for k in [*range(10), *range(15, 56, 8)]:
        down, along = 1.1e3 * DIAMETER - 1e3 * r[k, 0, 2], 1e3 * r[k, 0, 0]
        ratio = friction[k] / normal[k] if normal[k] > 0 else 0
        text = f"{down:7.1f}  {along:8.1f}  {1e3 * lift[k]:7.3f}  {normal[k]:8.4f}  {friction[k]:10.4f}"
        print(f"{text}  {ratio:17.4f}  {1e3 * lost[k]:7.3f}")
    print(history.message)
    return friction[8] / normal[8]


if __name__ == "__main__":
    main()
