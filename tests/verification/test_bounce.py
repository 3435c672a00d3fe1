"""Bounce without friction: contact adds no energy and takes little."""

import numpy as np
import pytest

import cosserat_fem as cf

G = 9.81


def drop(step, *, tilt=0.0, duration=0.3, youngs=1e8, rho=0.9):
    """A rod let fall on a floor: time, energy with that in the barrier (T,), height of its middle (T,), history."""
    section = cf.Section.round(0.01, youngs_modulus=youngs, poisson_ratio=0.3, density=1200)
    rod = cf.Rod("rod", section, [(0, 0, 0.02), (0.3, 0, 0.02 + 0.3 * np.tan(tilt))], n_elements=6)
    term = cf.PartContact(rod, cf.Part("floor", shape=cf.Plane((0, 0, 0), (0, 0, 1))))
    model = cf.Model([rod], [], [term, cf.Gravity((0, 0, -G))])
    history = cf.solve_dynamic(model, duration, start="drawn", step=step, rho_inf=rho)
    mass = model.space.node_mass
    height = np.array([mass @ record.state.r[:, 2] for record in history.records])
    stored = np.array([term.potential(record.state, model.space) for record in history.records])
    energy = history.kinetic_energy + history.energy + G * height + stored
    floor = G * mass.sum() * 0.005  # of rest
    return history.t, energy - floor, height / mass.sum(), history


STEPS = {"fixed": cf.FixedStep(1e-3), "adaptive": cf.AdaptiveStep(1e-3)}


@pytest.mark.filterwarnings("ignore:energy ledger")
@pytest.mark.parametrize(
    ("name", "duration"), [("fixed", 0.3), pytest.param("adaptive", 0.12, marks=pytest.mark.slow)], ids=STEPS
)
def test_flat_bounce(name, duration, say):
    """Falls flat from three radii: at most 2 % lost in each bounce, nothing gained."""
    _, energy, height, history = drop(STEPS[name], duration=duration)
    top = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:]) & (height[1:-1] > 0.01)) + 1
    peaks = np.concatenate([[energy[0]], energy[top]])
    say(
        f"energy at the tops {(peaks / energy[0]).round(5)}, at most {energy.max() / energy[0] - 1:.1e} more, "
        f"{history.message}"
    )
    assert len(top) >= (2 if duration > 0.2 else 1)
    assert (np.diff(peaks) <= 1e-4 * energy[0]).all()
    assert (peaks[1:] >= 0.98 * peaks[:-1]).all()


@pytest.mark.filterwarnings("ignore:energy ledger")
def test_energy_never_grows():
    """Not above the start at any step, on the way to the first top."""
    _, energy, _, _ = drop(STEPS["fixed"], duration=0.11)
    assert energy.max() <= (1 + 1e-4) * energy[0]


@pytest.mark.filterwarnings("ignore:energy ledger")
def test_energy_stands_in_flight():
    """Between two bounces nothing adds or takes energy."""
    _, energy, height, _ = drop(STEPS["fixed"], duration=0.11)
    last = np.flatnonzero(height < 0.0051)[-1] + 1  # free from here on
    assert np.ptp(energy[last:]) <= 1e-4 * energy[0]


@pytest.mark.filterwarnings("ignore:energy ledger")
def test_contact_that_lasts_is_booked_to_second_order():
    """A rod pressed on a drum by a load that comes and goes: what contact adds or takes is an error of the steps alone."""

    def added(step):
        section = cf.Section.round(0.01, youngs_modulus=1e8, poisson_ratio=0.3, density=1200)
        rod = cf.Rod("rod", section, [(-0.2, 0, 0), (0.2, 0, 0)], n_elements=8)
        drum = cf.Part("drum", shape=cf.Cylinder((0, -1, -0.05501), (0, 1, -0.05501), 0.05))
        load = cf.LineLoad(rod, lambda t: (0, 0, -5 - 10 * np.sin(8 * t) ** 2))
        terms = [cf.PartContact(rod, drum), load, cf.Damping(mass=30.0)]
        model, parts = cf.Model([rod], [cf.Clamp(rod, "start")], terms), []

        def look(run):
            parts.append(run.ledger.added / run.ledger.largest)
            return False

        cf.solve_dynamic(model, 0.3, step=cf.FixedStep(step), rho_inf=0.8, callback=look)
        return abs(parts[-1])

    coarse, fine = added(4e-3), added(2e-3)
    assert coarse < 1e-4
    assert fine < coarse / 3.5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:energy ledger")
@pytest.mark.parametrize(
    ("step", "duration"), [(STEPS["fixed"], 0.3), (cf.AdaptiveStep(1e-2), 0.1)], ids=["fixed", "adaptive"]
)
def test_tilted_bounce(step, duration, say):
    """Meets the floor with one end, then with the other: energy never grows. Adaptive steps follow every wave in it."""
    _, energy, _, history = drop(step, tilt=0.1, duration=duration)
    touched = np.array([bool(record.contact[0].spans.size) for record in history.records])
    where = [record.contact[0].spans.mean() for record in history.records if record.contact[0].spans.size]
    assert touched.any() and min(where) < 0.1 < 0.2 < max(where)
    say(
        f"left {energy[-1] / energy[0]:.4f}, at most {energy.max() / energy[0] - 1:.1e} more than at the start, "
        f"{history.message}"
    )
    assert energy.max() <= (1 + 1e-4) * energy[0]


@pytest.mark.filterwarnings("ignore:energy ledger")
@pytest.mark.slow
def test_friction_takes_energy_in_every_step(say):
    """Thrown along the floor: the work of friction on the rod and the floor is a loss in each step."""
    section = cf.Section.round(0.01, youngs_modulus=1e8, poisson_ratio=0.3, density=1200)
    rod = cf.Rod("rod", section, [(0, 0, 0.006), (0.3, 0, 0.006)], n_elements=5)
    term = cf.PartContact(rod, cf.Part("floor", shape=cf.Plane((0, 0, 0), (0, 0, 1))), friction=0.3)
    model = cf.Model([rod], [], [term, cf.Gravity((0, 0, -G))])
    velocity = cf.RigidVelocity(v=(0.3, 0.1, 0))
    history = cf.solve_dynamic(model, 0.1, start="drawn", velocity=velocity, step=cf.FixedStep(1e-3), rho_inf=0.9)
    lost = history.friction_work(term.name)
    say(f"lost {lost[-1]:.3e} of {history.kinetic_energy[0]:.3e} J, {history.message}")
    assert (np.diff(lost) >= -1e-15).all()
    assert lost[-1] > 0.1 * history.kinetic_energy[0]
