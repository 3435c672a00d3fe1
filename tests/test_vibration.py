"""Vibrations about states: dense and iterative, held and free, joined and tilted; what grows."""

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.equilibrium import vibration
from cosserat_fem.iteration.newton import Newton

SECTION = cf.Section(
    force_stiffness=(2e4, 2e4, 5e4), moment_stiffness=(1.0, 1.4, 0.8), mass_per_length=2.0, rotary_inertia=(1e-3, 1e-3, 2e-3)
)  # fmt: skip


def bent(**options):
    """A cantilever bent by a dead load."""
    rod = cf.Rod("rod", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=6)
    return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, 2.0, -1.0), **options)])


@pytest.mark.parametrize("follower", [False, True])
def test_dense_and_iterative_agree(monkeypatch, follower):
    """ARPACK and LAPACK find the same frequencies about a bent state; nothing grows."""
    model = bent(follower=follower)
    state = cf.solve_static(model).final
    found = []
    for limit in (10_000, 10):
        monkeypatch.setattr(vibration, "DENSE", limit)
        found.append(cf.modes(model, state, 6))
    np.testing.assert_allclose(found[0].omega, found[1].omega, rtol=1e-7)
    assert found[0].stable
    assert (np.diff(found[0].omega) > 0).all()
    assert found[0].shapes.shape == (6, model.space.n_nodes, 6)


def test_modes_are_those_of_a_motion_in_time():
    """Pushed along its second mode, a bent rod swings at that mode's frequency."""
    model = bent()
    state = cf.solve_static(model).final
    found = cf.modes(model, state, 2)
    velocity = 1e-5 * found.omega[1] * found.shapes[1]
    period = 1 / found.frequency[1]
    t = np.linspace(0, 4 * period, 801)
    step = cf.FixedStep(t[1], richardson=True)
    history = cf.solve_dynamic(model, t[-1], start=state, velocity=velocity, step=step, times=t)
    moved = history.positions("rod") - history.positions("rod")[0]
    k = int(np.argmax(np.abs(found.shapes[1][model.space[model.rods[0]].nodes, :3]).max(1)))
    u = moved[:, k] @ found.shapes[1][model.space[model.rods[0]].nodes[k], :3]
    up = np.flatnonzero((u[:-1] < 0) & (u[1:] >= 0))
    crossing = [t[i] - u[i] * (t[i + 1] - t[i]) / (u[i + 1] - u[i]) for i in up]
    assert (crossing[-1] - crossing[0]) / (len(crossing) - 1) == pytest.approx(period, rel=2e-4)


def test_free_rod_has_six_motions_without_stiffness():
    rod = cf.Rod("rod", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=4)
    found = cf.modes(cf.Model([rod]), n=8)
    assert (found.omega[:6] < 1e-3 * found.omega[6]).all()
    assert found.omega[6] == pytest.approx(22.37 * np.sqrt(1.0 / 2.0), rel=0.02)  # free-free beam of EI / m = 1 / 2


def test_welds_and_tilted_supports():
    """Two halves welded at a joint, and a hinge in a turned frame: the same frequencies as one rod and a plain hinge."""
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    whole = cf.Rod("rod", SECTION, [(0, 0, 0), (1, 0, 0)], n_elements=8, normal=(0, 0, 1))
    one = cf.Model([whole], [cf.Clamp(whole, "start"), cf.Clamp(whole, "end", free=("rz", "x"))])
    a = cf.Rod("a", SECTION, [(0, 0, 0), (0.5, 0, 0)], n_elements=4, normal=(0, 0, 1))
    b = cf.Rod("b", SECTION, [(0.5, 0, 0), (1, 0, 0)], n_elements=4, normal=(0, 0, 1))
    supports = [cf.Clamp(a, "start"), cf.Clamp(b, "end", free=("rz", "y"), frame=turned), cf.Weld(a, "end", b, "start")]
    two = cf.Model([a, b], supports)
    np.testing.assert_allclose(cf.modes(two, n=6).omega, cf.modes(one, n=6).omega, rtol=1e-9)


def test_unstable_state_grows():
    """A column under twice its critical load: one motion grows, at the rate of its negative square."""
    section = cf.Section(force_stiffness=(1e6,) * 3, moment_stiffness=(1.0, 4.0, 1.0), mass_per_length=1.0)
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=6)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(-(np.pi**2) / 2, 0, 0))])
    found = cf.modes(model, Newton(model).plain(model.initial_state()).state, 4)
    assert not found.stable
    assert (found.growth > 0).sum() == 1
    assert found.growth.max() == pytest.approx(np.sqrt(-found.squared.min()))
    assert "unstable" in repr(found)


def test_faults():
    rod = cf.Rod("light", cf.Section(force_stiffness=(1, 1, 1), moment_stiffness=(1, 1, 1)), [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(cf.SceneError, match="'light' has no mass"):
        cf.modes(cf.Model([rod], [cf.Clamp(rod, "start")]))
    with pytest.raises(ValueError, match="n: must be an integer"):
        cf.modes(bent(), n=0)
    with pytest.raises(ValueError, match="no equilibrium"):
        cf.modes(bent())
    with pytest.raises(ValueError, match="State of this model"):
        cf.modes(bent(), 3)
