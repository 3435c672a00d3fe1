"""No locking, objectivity, path independence: what must not matter does not matter."""

import numpy as np
import pytest

import cosserat_fem as cf


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_no_locking(say, order):
    """Bend of the same flexibility at slenderness 10 to 1e5: the error does not grow, and stays that of the order."""
    R, ratios = 1.0, (1e1, 1e2, 1e3, 1e4, 1e5)
    a = np.linspace(0, np.pi / 4, 100)
    points = R * np.stack([np.sin(a), 1 - np.cos(a), 0 * a], axis=-1)
    errors = []
    for ratio in ratios:
        EA = 12 * ratio**2  # EI = 1: EA L^2 / EI of a square section of that slenderness
        section = cf.Section(force_stiffness=(EA / 2, EA / 2, EA), moment_stiffness=(1.0, 1.0, 0.84))
        tips = []
        for n, p in ((16, order), (24, 6)):
            rod = cf.Rod(
                "b", section, points, n_elements=n, order=p, rest=(-1 / R, 0, 0), length=R * np.pi / 4, normal=(0, 0, 1),
                start_tangent=(1, 0, 0), end_tangent=(1, 1, 0),
            )  # fmt: skip
            load = cf.PointLoad(rod, "end", force=(0, 0, 7.2))
            tips.append(cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load])).positions(rod)[0, -1])
        errors.append(np.linalg.norm(tips[0] - tips[1]) / R)
    say(f"p{order}, L/d = 1e1 .. 1e5: {', '.join(f'{e:.1e}' for e in errors)}")
    assert max(errors) < 3e-3 / 20 ** (order - 1)
    assert max(errors[1:]) < max(1.5 * min(errors[1:]), 1e-11)  # the floor is round-off


def prestrained(angle):
    """A cable between two clamps of one part that turns about a skew axis: a strained body moving rigidly."""
    section = cf.Section.rectangle(0.012, 0.004, youngs_modulus=1e8)
    points = [(0.1, 0, 0), (0.2, 0.1, 0.05), (0.35, 0.05, -0.05), (0.4, 0.1, 0.1)]
    part = cf.Part("part", motion=cf.Hinge((0.05, -0.1, 0.02), (1, 2, -0.5), angle))
    rod = cf.Rod("cable", section, points, n_elements=8, order=3)
    return cf.Model([rod], [cf.Clamp(rod, "start", to=part), cf.Clamp(rod, "end", to=part)])


def test_objectivity(validation):
    """Ten random rigid turns, then one of 179 deg: strains and energy unchanged to 1e-12."""
    rng = np.random.default_rng(4)
    angles = np.concatenate([[0.0], rng.uniform(-1.4, 1.4, 10).cumsum()])
    angles = np.append(angles, angles[-1] + np.radians(179))
    times = np.arange(len(angles), dtype=float)
    model = prestrained((times, angles))
    history = cf.solve_quasistatic(model, times)
    strain, energy = history.total_strains("cable"), history.energy
    defect, change = abs(strain - strain[0]).max() / abs(strain).max(), abs(energy / energy[0] - 1).max()
    for name, off in (("strains", defect), ("energy", change)):
        validation.error("objectivity: rigid turns of a strained cable", "exact", off, 1e-12, variant=name)


def test_objective_interpolation(validation):
    """The strains of a bent state that is turned bodily, without solving: equal to round-off."""
    from scipy.spatial.transform import Rotation

    from cosserat_fem.kernels.rotation import multiply

    model = prestrained(0.0)
    state = cf.solve_static(model).final
    before, _ = model.space.strain_and_frame(state, 0)
    defects = []
    for k in range(50):
        q = Rotation.random(random_state=k).as_quat(scalar_first=True)
        R = Rotation.from_quat(q, scalar_first=True).as_matrix()
        moved = cf.State(0.0, state.r @ R.T, multiply(q, state.q), state.stress)
        defects.append(abs(model.space.strain_and_frame(moved, 0)[0] - before).max() / abs(before).max())
    validation.error("objectivity: turned interpolation", "exact", max(defects), 1e-12, variant="50 random turns")


def test_path_independence(validation):
    """Load A then B, B then A, both in one step, in a hundred steps, and a loop back to nothing: the same states."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(1.0, 1.4, 0.9))
    A, B = np.array((0, 2.0, 1.0)), np.array((0.5, -3.0, 2.0))

    def end(path):
        rod = cf.Rod("r", section, [(0, 0, 0), (1, 0, 0)], n_elements=8, order=3)
        times = np.arange(len(path), dtype=float)
        load = cf.PointLoad(rod, "end", force=(times, [a * A + b * B for a, b in path]))
        return cf.solve_quasistatic(cf.Model([rod], [cf.Clamp(rod, "start")], [load]), times).final

    o, both = (0.0, 0.0), (1.0, 1.0)
    ramp = [(x, x) for x in np.linspace(0, 1, 101)]
    ends = [end([o, (1.0, 0.0), both]), end([o, (0.0, 1.0), both]), end([o, both]), end(ramp)]
    spread = max(abs(e.r - ends[0].r).max() for e in ends)
    back = end([o, (1.0, 0.0), both, (0.0, 1.0), o])
    drift = abs(back.r - end([o, (1e-9, 0.0)]).r).max()
    validation.error("path independence", "exact", spread, 1e-9, unit="L", variant="four ways to the same loads")
    validation.error("path independence", "exact", drift, 1e-8, unit="L", variant="a loop of loads back to nothing")


def test_turned_model_gives_turned_answer():
    """The whole deployment of a cable, turned in space: reactions turn with it."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_euler("XYZ", (0.4, 1.1, -0.8)).as_matrix()
    results = []
    for turn in (np.eye(3), R):
        section = cf.Section.round(0.004, youngs_modulus=5e8)
        points = np.array([(0, -0.1, 0), (0.05, -0.02, 0.02), (0.13, 0, 0)]) @ turn.T
        rod = cf.Rod("c", section, points, n_elements=8, normal=turn @ (0, 0, 1))
        arm = cf.Part("arm", motion=cf.Hinge((0, 0, 0), turn @ (0, 0, 1), np.radians(10)))
        history = cf.solve_quasistatic(
            cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)]), [0, 1, 2, 3]
        )
        load = history.reaction("c.end@arm")
        results.append((load[:, :3] @ turn, load[:, 3:] @ turn, history.hinge_torque(arm)))
    for a, b in zip(*results, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9 * abs(results[0][0]).max())
