"""Estimated discretisation errors against true ones: their ratio, the effectivity, on problems with a reference.

References share no code with the package (closed form, shooting, collocation: references.json), or are far finer runs of
another order where the case says so.
"""

from itertools import pairwise

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.accuracy.estimate import Richer
from cosserat_fem.model import Model
from cosserat_fem.rod import Elements

SLACK = {"force": (0.217135148, 0, 1.0)}  # end force of the slack cable by shooting
ELASTICA = (4.4500440, -8.1060912, 0)  # tip by shooting


def bend(references, n, order):
    """45 degree bend (Bathe and Bolourchi): tip."""
    section = cf.Section(force_stiffness=(5e6, 5e6, 1e7), moment_stiffness=(1e7 / 12, 1e7 / 12, 5e6 * 0.1406))
    a = np.linspace(0, np.pi / 4, 100)
    rod = cf.Rod(
        "rod", section, 100 * np.stack([1 - np.cos(a), np.sin(a), 0 * a], axis=-1), n_elements=n, order=order,
        rest=(0, 0.01, 0), length=25 * np.pi, start_tangent=(0, 1, 0), end_tangent=(1, 1, 0), normal=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, 0, 600))])
    return model, tip, references["A03_bend45"]["values"]["J=0.1406,k=1,P=600"]["tip"]


def slack_cable(references, n, order):
    """Cable of length 1 clamped level over a span of 0.6: force at its end."""
    section = cf.Section(
        force_stiffness=(4e4, 4e4, 1e5), moment_stiffness=(1e-2, 1e-2, 0.8e-2), mass_per_length=2 / 9.81
    )
    s = np.linspace(0, 1, 21)
    rod = cf.Rod(
        "rod", section, np.stack([0.6 * s, 0 * s, -0.33 * np.sin(np.pi * s) ** 2], axis=-1), n_elements=n, order=order,
        length=1.0, start_tangent=(1, 0, 0), end_tangent=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -9.81))])
    return model, lambda h: abs(h.reaction("rod.end@ground")[0, :3]), SLACK["force"]


def roll_up(references, n, order):
    """Cantilever rolled up to a circle: tip, in closed form."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(1, 1, 1))
    rod = cf.Rod("rod", section, [(0, 0, 0), (1, 0, 0)], n_elements=n, order=order)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", moment=(0, 0, 2 * np.pi))])
    return model, tip, (0, 0, 0)


def elastica(references, n, order):
    """Slender cantilever, P L^2 / EI = 10: tip."""
    section = cf.Section(force_stiffness=(1e8, 1e8, 1e8), moment_stiffness=(100, 100, 100))
    rod = cf.Rod("rod", section, [(0, 0, 0), (10, 0, 0)], n_elements=n, order=order)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, -10, 0))])
    return model, tip, ELASTICA


def princeton(references, n, order):
    """Princeton beam at 45 degrees: tip."""
    E = 71.7e9
    section = cf.Section.rectangle(0.0123777, 0.0032024, youngs_modulus=E, poisson_ratio=0.31)
    rod = cf.Rod("rod", section, [(0, 0, 0), (0.508, 0, 0)], n_elements=n, order=order, normal=(0, 1, 0))
    force = 13.345 * np.array([0, -np.sqrt(0.5), np.sqrt(0.5)])
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=force)])
    values = references["A07_princeton"]["values"]["k=5/6,J=SaintVenant;P=13.345;beta=45"]
    return model, tip, np.array(values["u_xyz"]) + (0.508, 0, 0)


def heavy_cable(references, n, order):
    """Heavy cable with bending layers at its clamps, graded elements: moments at both clamps."""
    s = np.linspace(0, 1, 31)
    sag = 0.6 * np.sqrt(1 - 0.7**2 - 0.3**2)
    points = np.stack([0.7 * s, 0 * s, 0.3 * s - sag * np.sin(np.pi * s) ** 2], axis=-1)
    section = cf.Section(force_stiffness=(1e8,) * 3, moment_stiffness=(1e-4,) * 3, mass_per_length=1.0)
    rod = cf.Rod(
        "rod", section, points, n_elements=n, order=order, length=1.0, layer=0.01, start_tangent=(1, 0, 0),
        end_tangent=(1, 0, 0),
    )  # fmt: skip
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.Gravity((0, 0, -1))])
    ref = references["A05a_heavy_cable_clamped"]["values"]["span=0.7,rise=0.3,EI/(wL^3)=0.0001"]

    def moments(h):
        return np.array([-h.reaction("rod.start@ground")[0, 4], h.reaction("rod.end@ground")[0, 4]])

    return model, moments, (ref["m_y(0)"], ref["m_y(L)"])


def coil(references, n, order):
    """Cantilever bent to one coil of a helix: tip."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(100, 100, 100))
    rod = cf.Rod("rod", section, [(0, 0, 0), (10, 0, 0)], n_elements=n, order=order)
    load = cf.PointLoad(rod, "end", force=lambda t: (0, 0, 50 * t), moment=lambda t: (0, 0, 200 * np.pi * t))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [load])
    return model, tip, references["A04_helix"]["values"]["0.1"]["tip"]


def tip(history):
    return history.positions("rod")[-1, -1]


def solve(problem, model):
    return cf.solve_quasistatic(model, np.linspace(0, 0.1, 21)) if problem is coil else cf.solve_static(model)


CASES = [
    (bend, 16, 1), (bend, 4, 2), (bend, 4, 3), (bend, 4, 4), (slack_cable, 8, 1), (slack_cable, 8, 2), (slack_cable, 4, 3),
    (slack_cable, 6, 4), (roll_up, 6, 1), (roll_up, 4, 3), (elastica, 8, 2), (elastica, 4, 3), (princeton, 4, 2),
    (princeton, 3, 3), (heavy_cable, 12, 2), (heavy_cable, 8, 3), (heavy_cable, 6, 4), (coil, 8, 2), (coil, 6, 3),
]  # fmt: skip


@pytest.mark.parametrize(("problem", "n", "order"), CASES, ids=lambda v: getattr(v, "__name__", str(v)))
def test_equilibrium(references, say, problem, n, order):
    """The estimate for tips, end forces and clamp moments is within 0.3 and 10 of the true error."""
    model, quantity, reference = problem(references, n, order)
    history = solve(problem, model)
    richer = Richer(history)
    finer = richer.station(len(history) - 1)
    true = np.linalg.norm(quantity(history) - reference)
    estimated = np.linalg.norm(quantity(history) - quantity(finer))
    counts = history.counters.iterations, richer.newton.counters.iterations
    say(f"true {true:.1e}, estimated {estimated:.1e}: {estimated / true:.2f}; {counts[0]} + {counts[1]} iterations")
    assert 0.3 < estimated / true < 10


@pytest.mark.parametrize(("n", "order"), [(16, 3), (24, 2), (12, 4)])
def test_deployment(references, say, n, order):
    """The satellite hinge: peak force, both peak moments and the peak torque, each at its station."""
    drawn = cf.load_scene(None).model
    (rod,) = drawn.rods
    other = cf.Rod(
        rod.name, rod.section, rod.points, n_elements=n, order=order, length=rod.length, layer=rod.layer,
        start_tangent=rod.start_tangent, end_tangent=rod.end_tangent,
    )  # fmt: skip
    model = cf.Model([other], [cf.Clamp(other, h.at, h.to, name=h.name) for h in drawn.supports])
    history = cf.solve_quasistatic(model, np.arange(0, 91.0, 1.0))
    case = references["B03_deployment"]
    deg, fx, fy, f, ma, mb = np.array(case["history"]).T
    x, y = case["data"]["R"] * np.array([np.cos(np.radians(deg)), np.sin(np.radians(deg))])
    wanted = {"force": f, "M_A": abs(ma), "M_B": abs(mb), "torque": x * -fy - y * -fx + mb}

    def found(h):
        a, b = h.reaction("fixed end"), h.reaction("moving end")
        force = np.linalg.norm(a[:, :3], axis=1)
        return {"force": force, "M_A": abs(a[:, 5]), "M_B": abs(b[:, 5]), "torque": h.hinge_torque("panel")}

    richer, values = Richer(history), found(history)
    for name, reference in wanted.items():
        k = int(np.argmax(reference))
        true = abs(values[name][k] - reference[k])
        estimated = abs(values[name][k] - found(richer.station(k))[name][0])
        say(f"{name} at {k} deg: true {true:.1e}, estimated {estimated:.1e}: {estimated / true:.2f}")
        assert 0.3 < estimated / true < 10


@pytest.mark.parametrize(("n", "order"), [(6, 3), (8, 2)])
def test_following_cable(references, say, n, order):
    """A cable that follows an arm by 90 deg: force and couple at the arm."""
    section = cf.Section(force_stiffness=(400, 400, 1000), moment_stiffness=(1e-3, 1e-3, 8e-4))
    rod = cf.Rod("cable", section, [(0, 0, 0), (0.5, 0, 0)], n_elements=n, order=order)
    arm = cf.Part("arm", motion=cf.Hinge((0.2, 0, 0), (0, 0, 1), np.radians(1)))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=arm)])
    history = cf.solve_quasistatic(model, np.arange(0, 91.0, 3))
    reference, richer = np.array(references["D3_reaction"]), Richer(history)
    for k in (10, 20, 30):
        load = history.reaction("cable.end@arm")[k, [0, 1, 5]]
        finer = richer.station(k).reaction("cable.end@arm")[0, [0, 1, 5]]
        true, estimated = abs(load - reference[3 * k]), abs(load - finer)
        say(f"{3 * k} deg: " + ", ".join(f"{e:.1e} for {t:.1e}" for t, e in zip(true, estimated, strict=True)))
        assert (estimated > 0.3 * true).all()
        assert (estimated < 10 * true).all()


def finest(model: Model, n: int, order: int) -> Model:
    """The same model on elements of another order, each cut into n."""
    cut = {}
    for rod, view in model.space.views.items():
        ends = view.mesh.ends
        parts = [np.linspace(a, b, n, endpoint=False) for a, b in pairwise(ends)]
        cut[rod] = Elements(order, np.append(np.concatenate(parts), ends[-1]))
    return model.with_elements(cut)


def test_frame(say):
    """Three rods of different order welded in a joint and loaded there, against elements eight times smaller of order 5."""
    section = cf.Section.rectangle(0.02, 0.01, youngs_modulus=1e8, poisson_ratio=0.3)
    feet = [(0, 0, 0), (1, 0.2, 0), (0.3, 1, 0.1)]
    rods = [
        cf.Rod(name, section, [foot, (0.4, 0.3, 0.8)], n_elements=3, order=order, normal=(0.3, 0.1, -0.9))
        for name, foot, order in zip("abc", feet, (2, 3, 2), strict=True)
    ]
    joints = [cf.Weld(rods[0], "end", rod, "end") for rod in rods[1:]]
    load = cf.PointLoad(rods[0], "end", force=(3, 2, -4))
    model = cf.Model(rods, [*(cf.Clamp(rod, "start") for rod in rods), *joints], [load])
    history, reference = cf.solve_static(model), cf.solve_static(finest(model, 8, 5))
    finer = Richer(history).station(0)
    for rod in rods:
        support = f"{rod.name}.start@ground"
        a, b, c = (h.reaction(support)[0] for h in (history, finer, reference))
        for part in (slice(0, 3), slice(3, 6)):
            true, estimated = np.linalg.norm((a - c)[part]), np.linalg.norm((a - b)[part])
            say(f"{support}: true {true:.1e}, estimated {estimated:.1e}")
            assert 0.3 < estimated / true < 10
