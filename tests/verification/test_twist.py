"""Twisted clamped rod: it buckles at Greenhill's torque, and goes on to a plectoneme that never passes through itself."""

import judge
import numpy as np
import pytest
from verification import contact_references as cr

import cosserat_fem as cf
from helpers import centreline

EI, GJ, LENGTH, THICK = 1e-3, 0.8e-3, 1.0, 0.004


def twisted(turns, *, tension, contact=False, closer=None, skew=0.0, n_elements=20):
    """A rod clamped at both ends, one turned in time (turns(t) [rad]) and free to slide along, under a tension."""
    section = cf.Section(
        force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(EI, EI, GJ), mass_per_length=0.01,
        rotary_inertia=(1e-7, 1e-7, 2e-7), radius=THICK,
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=n_elements, order=3)
    key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (1, 0, 0), turns))
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key, free=("x",))]
    terms = [cf.PointLoad(rod, "end", (tension * EI / LENGTH**2, 0, 0)), cf.LineLoad(rod, (0, 0, skew))]
    if contact:
        terms.append(cf.RodContact([rod]))
    return cf.Model([rod], supports, terms)


@pytest.mark.parametrize("tension", [0.0, 10.0])
def test_greenhill(tension, say):
    """Turned in small steps, straight: the first negative pivot is at the critical torque, within 0.1 %."""
    critical = cr.greenhill(tension) * EI / LENGTH  # torque
    angle = critical * LENGTH / GJ

    def turned(part):
        model = twisted(lambda t: part * angle * min(t, 1.0), tension=tension)
        history = cf.solve_quasistatic(model, np.linspace(0, 1, 9))
        return any("first equilibrium found is unstable" in text for text in model.warnings), history

    below, history = turned(0.999)
    torque = -history.reaction("rod.start@ground")[-1, 3]
    assert abs(torque) == pytest.approx(0.999 * critical, rel=1e-6)
    assert abs(history.positions("rod")[-1, :, 1:]).max() < 1e-9
    above, _ = turned(1.001)
    say(f"T = {tension}: {'un' * below}stable at 0.999, {'un' * above}stable at 1.001 of {critical:.4g} N m")
    assert not below
    assert above


@pytest.fixture(scope="module")
def plectoneme():
    """Six turns in four seconds, then rest: frames of the centreline, whether it touched, what stopped it."""

    def turns(t):
        x = min(t / 4.0, 1.0)
        return 12 * np.pi * x**2 * (3 - 2 * x)

    model = twisted(turns, tension=60.0, contact=True, skew=0.02, n_elements=30)
    rod = model.rods[0]
    model = cf.Model(model.rods, model.supports, [*model.terms, cf.Damping(mass=20.0, time=2e-3)])
    frames, touched = [], []

    def look(run):
        frames.append(centreline(model, rod, run.state, 10))
        touched.append(any(told.peak > 0 for told in run.pressed))
        return len(touched) >= 1500

    message = ""
    try:
        history = cf.solve_dynamic(model, 5.0, step=cf.FixedStep(1e-2), rho_inf=0.5, callback=look, times=[5.0])
        message = history.message if history.status == "stopped" else ""
    except cf.ConvergenceError as error:
        message = str(error)
    return np.array(frames), np.array(touched), message


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_loop_touches_and_never_passes(plectoneme, say):
    """Far beyond the torque it throws a loop that closes on itself; no place of it passes another."""
    frames, touched, message = plectoneme
    say(f"first touched in step {touched.argmax()} of {len(touched)}, end at {frames[-1, -1, 0]:.3f} m. {message}")
    assert touched.any() or "and itself" in message
    assert frames[-1, -1, 0] < 0.8 * LENGTH
    assert judge.crossings_self(frames, skip=12) == 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_plectoneme(plectoneme):
    """It winds up: several places touch, and it comes to rest."""
    frames, touched, message = plectoneme
    assert message == ""
    assert touched[-1]
    assert frames[-1, -1, 0] < 0.6 * LENGTH
    assert np.abs(frames[-1] - frames[-2]).max() < 1e-4
