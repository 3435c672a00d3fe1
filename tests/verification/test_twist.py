"""Twisted clamped rod: it buckles at Greenhill's torque, and goes on to a plectoneme that never passes through itself."""

import judge
import numpy as np
import pytest
from verification import contact_references as cr

import cosserat_fem as cf
from helpers import centreline

EI, GJ, LENGTH, THICK = 1e-3, 0.8e-3, 1.0, 0.004


def twisted(turns, *, tension, skew=0.0, n_elements=20):
    """A rod clamped at both ends, one turned in time (turns(t) [rad]) and free to slide along, under a tension."""
    section = cf.Section(
        force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(EI, EI, GJ), mass_per_length=0.01,
        rotary_inertia=(1e-7, 1e-7, 2e-7), radius=THICK,
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=n_elements, order=3)
    key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (1, 0, 0), turns))
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key, free=("x",))]
    terms = [cf.PointLoad(rod, "end", (tension * EI / LENGTH**2, 0, 0)), cf.LineLoad(rod, (0, 0, skew))]
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


def turns(t):
    """Angle [rad] of the key: six turns in four seconds, then rest."""
    x = min(t / 4.0, 1.0)
    return 12 * np.pi * x**2 * (3 - 2 * x)


@pytest.fixture(scope="module")
def plectoneme():
    """Six turns, then rest: history, frames of the centreline after each step, and whether it touched.

    The barrier is a tenth of a radius deep, which lets legs that wind round each other slide on in long steps.
    """
    model = twisted(turns, tension=60.0, skew=0.02, n_elements=30)
    rod = model.rods[0]
    contact = cf.RodContact([rod], stand_off=0.05 * THICK)
    model = cf.Model(model.rods, model.supports, [*model.terms, contact, cf.Damping(mass=20.0, time=2e-3)])
    frames, touched = [], []

    def look(run):
        frames.append(centreline(model, rod, run.state, 10))
        touched.append(any(told.peak > 0 for told in run.pressed))
        return len(touched) >= 3000

    history = cf.solve_dynamic(
        model, 14.0, step=cf.FixedStep(1e-2), rho_inf=0.5, callback=look, times=np.linspace(0.5, 14.0, 28)
    )
    return history, np.array(frames), np.array(touched)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_loop_touches_and_never_passes(plectoneme, say):
    """Far beyond the torque it throws a loop that closes on itself; no place of it passes another.

    Its twist and writhe make the turns of the key, at all times: they would miss two after a pass.
    """
    history, frames, touched = plectoneme
    assert history.status == "converged"
    assert touched.any()
    assert judge.crossings_self(frames, skip=12) == 0
    rod = history.model.rods[0]
    view, beyond = history.model.space[rod], np.array([[1e3 * LENGTH, 0, 0]])
    length = history.model.space.groups[view.group].dx[view.elements].ravel()  # of each Gauss point
    twists = history.strains(rod)[..., 5] @ length / (2 * np.pi)
    missed = []
    for k, t in enumerate(history.t):
        curve = centreline(history.model, rod, history.records[k].state, 10)
        writhe = judge.writhe(np.concatenate([curve[:1] - beyond, curve, curve[-1:] + beyond]))
        missed.append(twists[k] + writhe - turns(t) / (2 * np.pi))
    say(
        f"first touched in step {touched.argmax()} of {len(touched)}, {history.counters.iterations} iterations, end at "
        f"{frames[-1, -1, 0]:.3f} m; twist {twists[-1]:.3f} and writhe {writhe:.3f} turns, linking number off by at most "
        f"{np.abs(missed).max():.1e}"
    )
    assert np.abs(missed).max() < 0.02


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_plectoneme(plectoneme):
    """It winds up: several places touch, and it comes to rest."""
    history, frames, touched = plectoneme
    told = history.pressed("rod-rod")[-1]
    assert touched[-1]
    assert len(told.spans) > 4
    assert frames[-1, -1, 0] < 0.2 * LENGTH
    assert np.abs(frames[-1] - frames[-2]).max() < 1e-4 * LENGTH
