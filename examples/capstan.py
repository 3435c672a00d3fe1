"""A rope is pulled over a drum with friction: how much more pulls than holds?

A thread needs exp(mu theta) times the force that holds it. A rope of radius a on a drum of radius R rubs at its surface,
which turns its sections; balance of moments then gives exp(lambda theta), lambda (1 + mu eps lambda) = mu (1 - eps),
eps = a / (R + a). The ratio of the end forces meets that within 5e-4, for thin ropes and for thick ones.
"""

import numpy as np

import cosserat_fem as cf

DRUM, HELD = 0.1, 10.0  # radius [m], force on the end that gives way [N]
BENDING = HELD * (0.03 * DRUM) ** 2  # stiffness [N m^2], of little influence
SPAN, PULL = 0.05, 0.003  # of rope on either side, way of the pulled end [m]


def solve(friction, radius, n_elements=32):
    """Force of the pulling end in parts of the holding one, and iterations."""
    r = DRUM + 1.01 * radius
    angle = np.linspace(0, np.pi, 4 * n_elements + 1)[:, None]
    wrap = r * (np.cos(angle) * [-1, 0, 0] + np.sin(angle) * [0, 0, 1])
    down = np.linspace(SPAN, 0, 12, endpoint=False)[:, None] * [0, 0, -1]
    points = np.concatenate([wrap[0] + down, wrap, wrap[-1] + down[::-1]])
    section = cf.Section(force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=3 * (BENDING,), radius=radius)
    rope = cf.Rod("rope", section, points, n_elements=n_elements + 2 * round(SPAN * n_elements / (np.pi * r)))
    drum = cf.Part("drum", shape=cf.Cylinder((0, -0.05, 0), (0, 0.05, 0), DRUM))
    hand = cf.Part("hand", motion=cf.Slider((0, 0, -1), 1.0))
    pulled = cf.Pin(rope, "end", to=hand)
    terms = [cf.PartContact(rope, drum, friction=friction), cf.PointLoad(rope, "start", force=(0, 0, -HELD))]
    history = cf.solve_quasistatic(cf.Model([rope], [pulled], terms), [0, PULL / 2, PULL])
    return -history.reaction(pulled)[-1, 2] / HELD, history.counters.iterations


def main():
    """Largest deviation of the ratio from that of the finite radius, in parts."""
    print("friction  a / R  T2 / T1  finite radius  exp(mu theta)  iterations")
    off = []
    for mu, a in ((0.1, 0.002), (0.3, 0.002), (0.5, 0.002), (0.3, 0.01)):
        ratio, iterations = solve(mu, a)
        eps = a / (DRUM + a)
        exponent = 2 * (1 - eps) * mu / (1 + np.sqrt(1 + 4 * mu**2 * eps * (1 - eps)))
        expected = np.exp(exponent * np.pi)
        off.append(abs(ratio / expected - 1))
        text = f"{mu:8.1f}  {a / DRUM:5.2f}  {ratio:7.4f}  {expected:13.4f}"
        print(f"{text}  {np.exp(mu * np.pi):13.4f}  {iterations:10d}")
    return max(off)


if __name__ == "__main__":
    main()
