"""Small problems that break elements: locking, many turns, extreme stiffness, loops, curved rest shapes, following loads."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import cosserat_fem as cf


def section(EA=1e4, GA=None, EI=(1.0, 1.0), GJ=1.0, **options):
    GA = EA if GA is None else GA
    return cf.Section(force_stiffness=(GA, GA, EA), moment_stiffness=(*EI, GJ), **options)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_locking(validation, order_of, order):
    """A quarter circle under a small end load, slenderness 10 to 1e5: Castigliano's deflection, at one error."""
    P = 5e-3
    a = np.linspace(0, np.pi / 2, 400)
    points = np.stack([np.sin(a), 1 - np.cos(a), 0 * a], axis=-1)
    counts = {1: (16, 32, 64), 2: (4, 8, 16), 3: (1, 2, 4), 4: (1, 2, 3)}[order]
    worst, observed = [], []
    for ratio in (1e1, 1e3, 1e5):
        EA = 12 * ratio**2
        wanted = 3 * np.pi / 4 - 2 + np.pi / 4 * (1 / EA + 2 / EA)  # bending, stretch, shear with GA = EA / 2
        errors = []
        for n in counts:
            rod = cf.Rod(
                "r", section(EA, EA / 2), points, n_elements=n, order=order, rest="as_drawn", normal=(0, 0, 1),
                start_tangent=(1, 0, 0), end_tangent=(0, 1, 0),
            )  # fmt: skip
            ends = {}
            for k in (-2, -1, 1, 2):
                load = cf.PointLoad(rod, "end", force=(0, k * P, 0))
                ends[k] = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load])).positions("r")[0, -1, 1]
            slope = (8 * (ends[1] - ends[-1]) - (ends[2] - ends[-2])) / (12 * P)  # free of P^2 and P^4
            errors.append(abs(slope / wanted - 1))
        worst.append(errors[-1])
        if ratio <= 1e3:  # beyond, round-off of the stretch shows before the order does
            observed.append(order_of(counts, errors))
    validation.error(
        "locking: curved cantilever", "Castigliano, closed form", max(worst), 3e-4,
        variant=f"{counts[-1]} x p{order}, L / d = 10 to 1e5", order=min(observed), least_order=2 * order - 0.6,
    )  # fmt: skip


@pytest.mark.parametrize("turns", [0.5, 1.0, 10.0])
def test_driven_twist(validation, turns):
    """An end turned about the rod: the torque of all turns, at once and in steps; none is lost."""
    for times in ([0.0, 1.0], np.linspace(0, 1, 41)):
        rod = cf.Rod("bar", section(EI=(50.0, 50.0), GJ=0.7), [(0, 0, 0), (1, 0, 0)], n_elements=40, order=4)
        key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (1, 0, 0), ([0, 1], [0, 2 * np.pi * turns])))
        model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key)])
        found = cf.solve_quasistatic(model, times).reaction("bar.end@key")[-1, 3]
        variant = f"{turns:g} turns, {len(times) - 1} stations"
        validation.row("end twisted by turns", "closed form", 0.7 * 2 * np.pi * turns, found, 1e-7, variant=variant)


@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_driven_bend(validation, turns):
    """An end turned sideways, free to move: an arc, up to a circle, of one moment.

    Two turns are none for a rod that may leave its plane: beyond the circle it does.
    """
    rod = cf.Rod("strip", section(), [(0, 0, 0), (1, 0, 0)], n_elements=8, order=4)
    key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (0, 0, 1), ([0, 1], [0, 2 * np.pi * turns])))
    model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key, free=("x", "y", "z"))])
    found = cf.solve_quasistatic(model, np.linspace(0, 1, 9)).reaction("strip.end@key")[-1, 5]
    validation.row("end turned sideways", "closed form", 2 * np.pi * turns, found, 1e-6, variant=f"{turns:g} turns")


EXTREMES = [("EA", 1e6), ("EA", 1e-6), ("GJ", 1e6), ("GJ", 1e-6), ("all", 1e6), ("all", 1e-6)]


@pytest.mark.parametrize(("which", "factor"), EXTREMES)
def test_extreme_stiffness(validation, which, factor):
    """Stretch, bend and twist of a cantilever under small loads, stiffnesses a million times larger and smaller."""
    EA, GJ = 1e4, 0.8
    EA = EA * factor if which in ("EA", "all") else EA
    GJ = GJ * factor if which in ("GJ", "all") else GJ
    small = 1e-7 * min(EA, GJ, 1.0)
    rod = cf.Rod("r", section(EA, GJ=GJ), [(0, 0, 0), (1, 0, 0)], n_elements=4, order=3)
    load = cf.PointLoad(rod, "end", force=(small, small, 0), moment=(small, 0, 0))
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))
    tip, frame = history.positions("r")[0, -1], history.directors("r")[0, -1]
    start = history.directors("r")[0, 0]
    twist = np.arcsin(start[:, 1] @ frame[:, 0])
    found = [(tip[0] - 1) / small, tip[1] / small, twist / small]
    wanted = np.array([1 / EA, 1 / 3 + 1 / EA, 1 / GJ])
    variant = f"{which} times {factor:g}"
    for name, a, b in zip(("stretch", "bend", "twist"), wanted, found, strict=True):
        if a * small > 1e-11:  # else it is below the last digit of a place
            accepted = 1e-5 if name == "stretch" and a < 1e-2 else 1e-6
            validation.row(
                "extreme stiffness", "linear beam, closed form", a, b, accepted, variant=f"{name}, {variant}"
            )


@pytest.mark.parametrize("EA", [1e6, 1e12])
def test_stiff_and_soft_in_one_chain(validation, EA):
    """A cantilever whose outer half is a million times stiffer: the deflection of the soft half, and its slope beyond."""
    soft, stiff, P = section(1e6), section(EA, EI=(1e6, 1e6), GJ=1e6), 1e-4
    parts = [(0.0, soft), (0.5, soft), (0.5, stiff), (1.0, stiff)]
    rod = cf.Rod("r", parts, [(0, 0, 0), (1, 0, 0)], n_elements=8, order=3)
    ends = []
    for k in (1, -1):
        load = cf.PointLoad(rod, "end", force=(0, k * P, 0))
        ends.append(cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load])).positions("r")[0, -1, 1])

    def bent(k, a, b):
        return ((1 - a) ** 3 - (1 - b) ** 3) / (3 * k)

    wanted = bent(1.0, 0.0, 0.5) + bent(1e6, 0.5, 1.0) + 0.5 / 1e6 + 0.5 / EA
    found, variant = (ends[0] - ends[1]) / (2 * P), f"EA {EA:g}"
    validation.row("stiff and soft in one chain", "linear beam, closed form", wanted, found, 1e-8, variant=variant)


@pytest.mark.parametrize("ratio", [1e-3, 1e-6])
def test_uneven_elements(validation, ratio):
    """An element a million times shorter than its neighbours does no harm."""
    rod = cf.Rod("r", section(1e6), [(0, 0, 0), (1, 0, 0)], n_elements=6, order=3)
    marks = [cf.PointLoad(rod, 0.4 + ratio / 6), cf.PointLoad(rod, 0.4)]
    load = cf.PointLoad(rod, "end", moment=(0, 0, 2.0))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [load, *marks])
    smallest = model.scales["smallest"]
    assert smallest < 2 * ratio / 6
    tip = cf.solve_static(model).positions("r")[0, -1, :2]
    wanted = [np.sin(2.0) / 2, (1 - np.cos(2.0)) / 2]
    validation.row("elements of uneven length", "closed form", wanted, tip, 1e-5, variant=f"1 to {ratio:g}")


def test_curved_rest_stays(validation):
    """A helix that is free of stress as drawn does not move."""
    a = np.linspace(0, 6 * np.pi, 400)
    points = np.stack([np.cos(a), np.sin(a), 0.1 * a], axis=-1)
    rod = cf.Rod("helix", section(), points, n_elements=30, order=3, rest="as_drawn")
    model = cf.Model([rod], [cf.Clamp(rod, "start")])
    history = cf.solve_static(model)
    moved = np.abs(history.final.r - model.initial_state().r).max() / rod.length
    validation.error("curved rest shape stays", "exact", moved, 1e-12, unit="L")


@pytest.mark.parametrize(("bend", "twist"), [(2.0, 0.0), (3.0, 4.0), (0.5, 20.0)])
def test_rest_curvature_makes_a_helix(validation, bend, twist):
    """Drawn straight, stress-free with bend and twist: released it is the helix of these numbers."""
    rod = cf.Rod(
        "r", section(), [(0, 0, 0), (0, 0, 1)], n_elements=16, order=4, rest=(bend, 0.0, twist), normal=(1, 0, 0)
    )
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")]))
    # frame and place: R' = R hat(k), r' = R e3, as one linear equation
    k = np.array([bend, 0.0, twist])
    hat = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    A = np.zeros((4, 4))
    A[:3, :3], A[:3, 3] = hat, (0, 0, 1)
    R0 = history.directors("r")[0, 0]
    wanted = R0 @ expm(A)[:3, 3]
    error = np.linalg.norm(history.positions("r")[0, -1] - wanted)
    variant = f"bend {bend:g}, twist {twist:g}"
    validation.error("rest curvature makes a helix", "matrix exponential", error, 1e-6, unit="L", variant=variant)


def test_straightened(validation):
    """A rod that is at rest as an arc, straightened by the moment EI / R."""
    rod = cf.Rod("r", section(), [(0, 0, 0), (1, 0, 0)], n_elements=8, order=4, rest=(1.5, 0, 0), normal=(0, 0, 1))
    moment = 1.5 * rod.frames(np.array([0.0]))[0, :, 0]
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", moment=-moment)])
    tip = cf.solve_static(model).positions("r")[0, -1]
    validation.row("arc straightened by its moment", "closed form", (1, 0, 0), tip, 1e-9)


def halves(n_elements):
    """A ring of radius 1 in two halves, joined at both ends."""
    rods = []
    for k in (0, 1):
        a = np.linspace(0, np.pi, 101) + k * np.pi - np.pi / 2
        points = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
        ends = [(-np.sin(x), np.cos(x), 0) for x in (a[0], a[-1])]
        rod = cf.Rod(
            f"half {k}", section(1e7), points, n_elements=n_elements, order=3, rest="as_drawn", normal=(0, 0, 1),
            start_tangent=ends[0], end_tangent=ends[1],
        )  # fmt: skip
        rods.append(rod)
    one, two = rods
    return rods, [cf.Weld(one, "end", two, "start"), cf.Weld(two, "end", one, "start")]


def test_closed_loop(validation, order_of):
    """A ring pulled across: its diameter grows by (pi / 4 - 2 / pi) P R^3 / EI."""
    P, wanted, counts, errors = 1e-5, np.pi / 4 - 2 / np.pi, (2, 4, 8), []
    for n in counts:
        rods, welds = halves(n)
        load = cf.PointLoad(rods[0], "end", force=(0, P, 0))
        model = cf.Model(rods, [cf.Clamp(rods[0], "start"), *welds], [load])
        found = (cf.solve_static(model).positions("half 0")[0, -1, 1] - 1.0) / P
        errors.append(abs(found / wanted - 1))
    source = "inextensible ring, closed form"
    order = order_of(counts, errors)
    validation.row("closed loop pulled across", source, wanted, found, 2e-5, order=order, least_order=4.0)


def test_grillage(validation):
    """Four beams that meet in one joint, clamped outside: stiffness of two clamped beams, 2 x 192 EI / (2 L)^3."""
    outer = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    rods = [cf.Rod(f"arm {k}", section(1e9), [x, (0, 0, 0)], n_elements=3, order=3) for k, x in enumerate(outer)]
    welds = [cf.Weld(rods[0], "end", rod, "end") for rod in rods[1:]]
    clamps = [cf.Clamp(rod, "start") for rod in rods]
    model = cf.Model(rods, [*clamps, *welds], [cf.PointLoad(rods[0], "end", force=(0, 0, 1e-6))])
    found = 1e-6 / cf.solve_static(model).positions("arm 0")[0, -1, 2]
    validation.row("joint of four beams", "closed form", 2 * 192 / 8, found, 1e-6)


def test_twist_that_stretches(validation):
    """A rope-like section, twist and stretch coupled: strains of a pull and a torque are C^-1 times them."""
    C = np.diag([1e3, 1e3, 50.0, 1e2, 1e2, 3.0])
    C[2, 5] = C[5, 2] = 8.0
    rod = cf.Rod("rope", cf.Section(coupled=C), [(0, 0, 0), (1, 0, 0)], n_elements=3, order=2)
    load = cf.PointLoad(rod, "end", force=(4.0, 0, 0), moment=(0.6, 0, 0))
    history = cf.solve_static(cf.Model([rod], [cf.Clamp(rod, "start")], [load]))
    wanted = np.linalg.solve(C, [0, 0, 4.0, 0, 0, 0.6])
    validation.row("twist coupled to stretch", "exact", wanted, history.strains("rope")[0, 0], 1e-9)


@pytest.mark.parametrize("load", [1.0, 5.0, 20.0, 60.0])
def test_following_end_load(validation, order_of, load):
    """A cantilever under an end load that stays normal to it: integrated from the free end, where all is known."""

    def slope(s, u):  # x, y, angle, moment in the frame of the free end, from it inward; inextensible
        return [-np.cos(u[2]), -np.sin(u[2]), -u[3], -load * np.cos(u[2])]

    x, y, angle, _ = solve_ivp(slope, (0, 1), [0, 0, 0, 0], rtol=1e-11, atol=1e-12).y[:, -1]
    c, d = np.cos(angle), np.sin(angle)
    wanted = np.array([-c * x - d * y, c * y - d * x])

    def tip(order, n):
        rod = cf.Rod("r", section(1e8), [(0, 0, 0), (1, 0, 0)], n_elements=n, order=order, normal=(0, 1, 0))
        push = cf.PointLoad(rod, "end", force=lambda t: (load * t, 0, 0), follower=True)
        model = cf.Model([rod], [cf.Clamp(rod, "start")], [push])
        return cf.solve_quasistatic(model, np.linspace(0, 1, 11)).positions("r")[-1, -1, :2]

    counts = (4, 8, 16) if load < 10 else (16, 32, 64)
    order = order_of(counts, [np.linalg.norm(tip(2, n) - wanted) for n in counts])
    validation.row(
        "following end load", "initial value problem from the free end; Argyris and Symeonidis (1981)", wanted,
        tip(4, 16), 1e-6, scale=1.0, unit="L", variant=f"P L^2 / EI = {load:g}", order=order, least_order=3.3,
    )  # fmt: skip


def test_charged_rods(validation):
    """Two straight rods with charges, side by side: their force in closed form."""
    charge, distance, length = 2e-7, 0.3, 1.0
    rods = [
        cf.Rod(f"r{k}", section(), [(0, k * distance, 0), (length, k * distance, 0)], n_elements=24) for k in (0, 1)
    ]
    stiff = [cf.Clamp(rod, at) for rod in rods for at in ("start", "end")]
    model = cf.Model(rods, stiff, [cf.Electrostatic(*rods, charge, charge)])
    history = cf.solve_static(model)
    found = -sum(history.reaction(h)[0, 1] for h in model.supports[2:])
    wanted = charge**2 / (2 * np.pi * 8.8541878188e-12 * distance) * (np.hypot(length, distance) - distance)
    validation.row("force between charged rods", "Coulomb, closed form", wanted, found, 1e-4)
