"""Capstan: tension along a rope that slips over a drum, friction acting at its surface; a rope hung over a drum in time."""

import numpy as np
import pytest
from verification import contact_references as cr

import cosserat_fem as cf

RADIUS, THICK, TENSION = 0.1, 0.002, 10.0
FREE = 0.05  # length of the straight spans


def wrapped(mu, theta, per_half_turn, order=2):
    """Quasi-static pull over a drum: the rope slips by half its radius in each of five stations."""
    EI = TENSION * (0.01 * RADIUS) ** 2  # sqrt(EI / T) = 0.01 R
    r = RADIUS + THICK + 1e-5 * THICK
    section = cf.Section(
        force_stiffness=(1e5, 1e5, 1e5), moment_stiffness=(EI, EI, EI), mass_per_length=0.01, radius=THICK
    )
    h = np.pi * r / per_half_turn
    phi = np.linspace(0, theta, 4 * int(theta / h * r))
    arc = r * np.stack([-np.cos(phi), np.sin(phi)], axis=1)
    start, end = np.array([0, 1.0]), np.array([np.sin(theta), np.cos(theta)])
    k = np.linspace(-FREE, -h / 4, 12)[:, None]
    points = np.concatenate([arc[0] + k * start, arc, arc[-1] - k[::-1] * end])
    rope = cf.Rod(
        "rope", section, np.column_stack([points, 0 * points[:, 0]]), n_elements=round((theta * r + 2 * FREE) / h),
        order=order,
    )  # fmt: skip
    drum = cf.Part("drum", shape=cf.Cylinder((0, 0, -0.05), (0, 0, 0.05), RADIUS))
    puller = cf.Part("puller", motion=cf.Slider((*end, 0), 1.0))
    term = cf.PartContact(rope, drum, friction=mu, pressure=TENSION / RADIUS)
    load = cf.PointLoad(rope, "start", (0, -TENSION, 0))
    model = cf.Model([rope], [cf.Pin(rope, "end", to=puller)], [term, load])
    return cf.solve_quasistatic(model, 0.5 * THICK * np.arange(6.0))


def ratio_error(history, mu, theta):
    """Relative error of T2/T1 over the wrap, from a line through log T inside it."""
    s, (x, y) = history.stations("rope"), history.positions("rope")[-1, :, :2].T
    nodes, length = history.nodes("rope"), history.rod("rope").length
    angle = np.unwrap(np.arctan2(np.interp(s, nodes, y), -np.interp(s, nodes, x)))
    inside = (angle > 0.1 * theta) & (angle < 0.9 * theta) & (s > FREE) & (s < length - FREE)
    slope = np.polyfit(angle[inside], np.log(history.section_forces("rope")[-1, inside, 2]), 1)[0]
    return np.exp(slope * theta) / cr.capstan_ratio(mu, theta, THICK, RADIUS) - 1


CASES = [(mu, turns) for turns in (1.0, 1.9) for mu in (0.1, 0.3, 0.6)]


@pytest.mark.parametrize(
    ("mu", "turns"), [case if case == (0.3, 1.0) else pytest.param(*case, marks=pytest.mark.slow) for case in CASES]
)
@pytest.mark.parametrize(
    ("elements", "allowed"), [(20, 3e-3), pytest.param(40, 5e-4, marks=pytest.mark.slow)], ids=["20", "40"]
)
def test_ratio(mu, turns, elements, allowed, validation):
    """T2/T1 = exp(lambda theta) of a rope of finite radius."""
    theta = turns * np.pi
    history = wrapped(mu, theta, elements)
    error = ratio_error(history, mu, theta)
    variant = f"mu {mu}, {turns} pi, {elements} elements to half a turn"
    validation.error("capstan", "thick rope on a drum, closed form", abs(error), allowed, variant=variant)
    assert (np.diff(history.friction_work("rope-drum")) > 0).all()
    assert np.median([record.iterations for record in history.records]) <= 20
    # what the ends pull, the drum takes
    load = history.contact_load("drum")[-1, :3]
    ends = history.reaction("rope.end@puller")[-1, :3] + (0, -TENSION, 0)
    np.testing.assert_allclose(load, ends, atol=1e-8 * TENSION)


# in time


def hung(ratio, mu=0.3, *, duration, step, n_elements=24):
    """A rope over a drum, let go with weights of ratio to 1 at its ends; way of the heavy end in time."""
    section = cf.Section(
        force_stiffness=(2e4, 2e4, 2e4), moment_stiffness=(1e-3, 1e-3, 1e-3), mass_per_length=0.05, radius=THICK
    )
    r, span = RADIUS + THICK - 2e-6, 0.1
    phi = np.linspace(0, np.pi, 60)
    arc = r * np.stack([-np.cos(phi), np.sin(phi)], axis=1)
    k = np.linspace(-span, -0.004, 20)[:, None] * [0, 1.0]
    points = np.concatenate([arc[0] + k, arc, arc[-1] + k[::-1]])
    rope = cf.Rod("rope", section, np.column_stack([points, 0 * points[:, 0]]), n_elements=n_elements, order=2)
    drum = cf.Part("drum", shape=cf.Cylinder((0, 0, -0.05), (0, 0, 0.05), RADIUS))
    ramp = ([0.0, 0.5, 100.0], np.outer([1.0, ratio, ratio], [0, -1.0, 0]))
    loads = [cf.PointLoad(rope, "start", (0, -1.0, 0)), cf.PointLoad(rope, "end", ramp)]
    terms = [cf.PartContact(rope, drum, friction=mu), *loads, cf.Damping(mass=20.0)]
    history = cf.solve_dynamic(
        cf.Model([rope], [], terms), duration, step=cf.FixedStep(step), rho_inf=0.5,
        times=np.linspace(0, duration, 11),
    )  # fmt: skip
    return history.positions("rope")[:, -1, 1], history


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:energy ledger")
def test_hung_rope_holds(validation):
    """3 % below the limit load ratio: creeps by less than 1e-4 m in ten seconds."""
    y, history = hung(0.97 * cr.capstan_ratio(0.3, np.pi, THICK, RADIUS), duration=10.5, step=0.02)
    case = "rope hung over a drum, 3 % below its limit"
    validation.error(case, "it holds", abs(y[-1] - y[1]), 1e-4, unit="m", variant="creep in ten seconds")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:energy ledger")
def test_hung_rope_slides(say):
    """3 % above it: slides off, faster and faster up to what damping allows."""
    y, history = hung(1.03 * cr.capstan_ratio(0.3, np.pi, THICK, RADIUS), duration=2.0, step=0.01)
    say(f"fell {y[0] - y[-1]:.3f} m, {history.message}")
    assert y[0] - y[-1] > 1e-2
