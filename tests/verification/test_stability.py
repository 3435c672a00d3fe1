"""Critical loads of columns, strips, arches, frames and rings; branches and limit points.

References: stability_references.py. Rods have force stiffnesses of STIFF EI / L^2; with equal ones of
shear and stretch Euler loads are those of a rod without either.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk
from verification import stability_references as ref

import cosserat_fem as cf

STIFF = 1e7


def rod_of(points, *, bending=(1.0, 1.0, 1.0), stiff=STIFF, n_elements=8, order=3, mass=0.0, **options):
    section = cf.Section(force_stiffness=(stiff,) * 3, moment_stiffness=bending, mass_per_length=mass)
    return cf.Rod("rod", section, points, n_elements=n_elements, order=order, **options)


STRAIGHT = [(0, 0, 0), (1, 0, 0)]
ENDS = {  # what the two supports of a column along x leave free; twist is held
    "clamped-free": ((), None),
    "pinned-pinned": (("ry", "rz"), ("x", "ry", "rz")),
    "clamped-pinned": ((), ("x", "ry", "rz")),
    "clamped-clamped": ((), ("x",)),
}


def column(ends, **options):
    """A column of length 1 and EI = 1 under a unit push, weaker in one plane."""
    rod = rod_of(STRAIGHT, bending=(1.0, 1.7, 1.0), normal=(0, 0, 1), **options)
    first, second = ENDS[ends]
    supports = [cf.Clamp(rod, "start", free=first)]
    if second is not None:
        supports.append(cf.Clamp(rod, "end", free=second))
    return cf.Model([rod], supports, [cf.PointLoad(rod, "end", force=(-1, 0, 0))])


@pytest.mark.parametrize("ends", ENDS)
def test_euler(validation, order_of, ends):
    """Euler's four columns: critical load and its order of convergence."""
    wanted = ref.EULER[ends]
    found = cf.critical_load(column(ends, n_elements=12))
    assert found.kind == "bifurcation"
    counts = (4, 8, 16)
    errors = [abs(cf.critical_load(column(ends, order=1, n_elements=n)).value / wanted - 1) for n in counts]
    validation.row(
        "Euler column", "Euler (1744), closed form", wanted, found.value, 1e-6, variant=ends,
        order=order_of(counts, errors), least_order=1.7,
    )  # fmt: skip


@pytest.mark.parametrize("factor", [1.05, 1.5, 3.0])
def test_elastica_branch(validation, order_of, factor):
    """The buckled column: deflection and drop of its end on the branch, by elliptic integrals."""
    load = factor * np.pi**2 / 4
    history = cf.trace_path(column("clamped-free"), until=load, branch=1)
    assert history.stable[-1]
    k = brentq(lambda k: ellipk(k * k) - np.sqrt(load), 1e-3, 0.999)
    wanted, end = 2 * k / np.sqrt(load), history.positions("rod")[-1, -1]
    order, counts = None, (4, 8, 16)
    if factor == 1.5:
        ends = [
            cf.trace_path(column("clamped-free", order=1, n_elements=n), until=load, branch=1).final for n in counts
        ]
        order = order_of(counts, [abs(np.abs(state.r[:, 1]).max() / wanted - 1) for state in ends])
    source, least = "Euler's elastica, elliptic integral", None if order is None else 1.7
    validation.row(
        "Euler column, buckled",
        source,
        wanted,
        abs(end[1]),
        1e-5,
        variant=f"{factor} P",
        order=order,
        least_order=least,
    )


def test_self_weight(validation, order_of):
    """Greenhill's column: how tall it may stand."""
    errors, counts = [], (4, 8, 16)
    for order, n in [(1, 4), (1, 8), (1, 16), (3, 12)]:
        rod = rod_of(STRAIGHT, bending=(1.0, 1.7, 1.0), n_elements=n, order=order)
        model = cf.Model([rod], [cf.Clamp(rod, "start")], [cf.LineLoad(rod, force=(-1, 0, 0))])
        found = cf.critical_load(model).value
        errors.append(abs(found / ref.self_weight() - 1))
    source = "Greenhill (1881), zero of a Bessel function"
    order = order_of(counts, errors[:3])
    validation.row("column under its own weight", source, ref.self_weight(), found, 1e-6, order=order, least_order=1.7)


def strip(load, **options):
    """A strip along x, EI = 1 sideways, GJ = 0.25, very stiff in the plane of its load."""
    rod = rod_of(STRAIGHT, bending=(1e6, 1.0, 0.25), normal=(0, 1, 0), stiff=1e8, **options)
    return cf.Model([rod], [cf.Clamp(rod, "start")], [load(rod)])


def test_lateral_buckling(validation, order_of):
    """A narrow strip under an end load turns over."""
    wanted = ref.lateral_tip() * np.sqrt(0.25)
    counts, errors = (4, 8, 16), []
    for order, n in [(1, 4), (1, 8), (1, 16), (3, 12)]:
        model = strip(lambda rod: cf.PointLoad(rod, "end", force=(0, 0, -1)), order=order, n_elements=n)
        found = cf.critical_load(model).value
        errors.append(abs(found / wanted - 1))
    source = "Michell, Prandtl (1899), zero of a Bessel function"
    order = order_of(counts, errors[:3])
    validation.row("lateral buckling, end load", source, wanted, found, 2e-5, order=order, least_order=1.7)


def test_lateral_buckling_in_pure_bending(validation):
    """A strip on two forks, its ends turned against each other: pi sqrt(EI GJ) / L at the ends."""
    bending = 1e4
    rod = rod_of(STRAIGHT, bending=(bending, 1.0, 0.25), normal=(0, 1, 0), stiff=1e9, n_elements=12)
    moment = np.pi * np.sqrt(0.25)
    angle = 2 * moment / (2 * bending)  # twice what is needed
    parts = [cf.Part(f"fork {k}", motion=cf.Hinge((k, 0, 0), (0, 1, 0), (1 - 2 * k) * angle)) for k in (0, 1)]
    supports = [
        cf.Clamp(rod, "start", to=parts[0], free=("rz",)), cf.Clamp(rod, "end", to=parts[1], free=("x", "rz")),
    ]  # fmt: skip
    history = cf.trace_path(cf.Model([rod], supports), along="time", until=1.0)
    event = next(event for event in history.critical if event.kind == "bifurcation")
    found = bending * 2 * angle * event.t
    source = "Michell, Prandtl (1899), closed form"
    validation.row("lateral buckling, pure bending", source, moment, found, 2e-3)


def test_beck(validation, order_of):
    """A column under a push that follows its end: flutter, with the unsymmetric tangent; static tests see nothing."""

    def critical(order, n):
        rod = rod_of(STRAIGHT, mass=1.0, n_elements=n, order=order, stiff=1e7)
        push = cf.PointLoad(rod, "end", force=(0, 0, -1), follower=True)
        return cf.critical_load(cf.Model([rod], [cf.Clamp(rod, "start")], [push]))

    found = critical(4, 10)
    assert found.kind == "flutter"
    counts = (6, 12, 24)
    errors = [abs(critical(1, n).value / ref.beck() - 1) for n in counts]
    source = "Beck (1952), characteristic equation"
    order = order_of(counts, errors)
    validation.row("Beck's column, flutter", source, ref.beck(), found.value, 1e-4, order=order, least_order=1.7)


def test_leipholz(validation, order_of):
    """The same under a push spread over its length."""

    def critical(order, n):
        rod = rod_of(STRAIGHT, mass=1.0, n_elements=n, order=order)
        push = cf.LineLoad(rod, force=(0, 0, -1), follower=True)
        return cf.critical_load(cf.Model([rod], [cf.Clamp(rod, "start")], [push]))

    found, wanted, counts = critical(4, 10), ref.leipholz(), (6, 12, 24)
    assert found.kind == "flutter"
    order = order_of(counts, [abs(critical(1, n).value / wanted - 1) for n in counts])
    source = "Galerkin with polynomials"
    validation.row("Leipholz's column, flutter", source, wanted, found.value, 1e-4, order=order, least_order=1.7)


def test_von_mises_truss(validation):
    """Half a von Mises truss: a bar that snaps through; its limit load in closed form."""
    EA, rise = 1.0, 0.3
    section = cf.Section(force_stiffness=(EA, EA, EA), moment_stiffness=(1e3, 1e3, 1e3))
    rod = cf.Rod("rod", section, [(0, 0, 0), (1.0, rise, 0)], n_elements=2)
    supports = [cf.Pin(rod, "start"), cf.Clamp(rod, "end", free=("y", "rz"))]
    model = cf.Model([rod], supports, [cf.PointLoad(rod, "end", force=(0, -1e-3, 0))])
    history = cf.trace_path(model, until=20.0)
    found = [event.value * 1e-3 for event in history.critical if event.kind == "limit"]
    wanted = ref.von_mises(rise, 1.0)
    validation.row("von Mises truss, both limit points", "closed form", [wanted, -wanted], found[:2], 1e-6)


def frame(*, n_elements=10, order=3, follower=False):
    """Lee's frame: E = 720, 2 x 3, L = 120, G = E / 2; stiff out of its plane."""
    L, EA, EI = 120.0, 4320.0, 1440.0
    section = cf.Section(force_stiffness=(EA / 2, EA / 2, EA), moment_stiffness=(EI, 1e6, 1e6))
    options = {"n_elements": n_elements, "order": order, "normal": (0, 0, 1)}
    a = cf.Rod("column", section, [(0, 0, 0), (0, L, 0)], **options)
    b = cf.Rod("beam", section, [(0, L, 0), (L, L, 0)], **options)
    supports = [cf.Clamp(a, "start", free=("rz",)), cf.Clamp(b, "end", free=("rz",)), cf.Weld(a, "end", b, "start")]
    force = (0, 1, 0) if follower else (0, -1, 0)  # d2 of the beam points down
    return cf.Model([a, b], supports, [cf.PointLoad(b, L / 5, force=force, follower=follower)])


def test_lee_frame(validation, references, order_of):
    """Both limit points of Lee's frame, where load and deflection turn back."""
    wanted = references["stability"]["lee_frame"]
    counts = (5, 10, 20)
    values = [[e.value for e in cf.trace_path(frame(n_elements=n, order=2), until=2.5).critical] for n in counts]
    errors = [abs(v[0] - wanted[0]) for v in values]
    found = [event.value for event in cf.trace_path(frame(order=4), until=2.5).critical]
    source = "plane Reissner rods, shooting and continuation; Lee, Manuel, Rossow (1968): 1.85"
    order = order_of(counts, errors)
    validation.row("Lee's frame, limit points", source, wanted, found, 1e-6, order=order, least_order=3.5)


def test_lee_frame_follower(validation, references):
    """The same with a load that stays normal to the beam: the limit is where the load turns back."""
    wanted = references["stability"]["lee_frame_follower"]
    found = cf.trace_path(frame(order=4, follower=True), until=5.0, steps=80).critical[0]
    source = "plane Reissner rods, shooting and continuation; Argyris and Symeonidis (1981): 3.5 to 3.6"
    validation.row("Lee's frame, following load", source, wanted, found.value, 1e-6)


def arch(*, n_elements=24, order=3):
    """An arch of 215 deg and R = 1, clamped at its right end, hinged at its left, stress-free as drawn."""
    half = np.radians(215) / 2
    angles = np.linspace(-half, half, 201)
    points = np.stack([np.sin(angles), np.cos(angles), 0 * angles], axis=-1)
    tangent = [(np.cos(a), -np.sin(a), 0) for a in (-half, half)]
    section = cf.Section(force_stiffness=(1e6,) * 3, moment_stiffness=(1.0, 1e3, 1e3))
    rod = cf.Rod(
        "arch", section, points, n_elements=n_elements, order=order, length=2 * half, rest="as_drawn", normal=(0, 0, 1),
        start_tangent=tangent[0], end_tangent=tangent[1],
    )  # fmt: skip
    supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", free=("rz",))]
    return cf.Model([rod], supports, [cf.PointLoad(rod, half, force=(0, -1, 0))])


def test_deep_arch(validation, references, order_of):
    """DaDeppo and Schmidt's arch."""
    wanted = references["stability"]["deep_arch"]
    counts = (12, 24, 48)
    errors = [abs(cf.critical_load(arch(n_elements=n, order=2)).value - wanted) for n in counts]
    found = cf.critical_load(arch(n_elements=32, order=4))
    assert found.kind == "limit"
    source = "plane Reissner rods, shooting and continuation; DaDeppo and Schmidt (1975): 8.97"
    order = order_of(counts, errors)
    validation.row("deep arch, limit point", source, wanted, found.value, 1e-5, order=order, least_order=3.0)


@pytest.mark.parametrize("ratio", [0.7, 0.8, 1.0, 1.25])
def test_michell_ring(validation, order_of, ratio):
    """A straight rod bent to a ring and twisted: it leaves its plane at 2 pi sqrt(3) EI / GJ.

    The pin takes away a motion without stiffness: the ring may turn about its clamp while it spins about its own line.
    """
    angles = np.linspace(0, 2 * np.pi, 201)
    points = np.stack([np.sin(angles), 1 - np.cos(angles), 0 * angles], axis=-1)
    wanted = 2 * np.pi * np.sqrt(3) / ratio

    def critical(order, n):
        rod = rod_of(
            points, bending=(1.0, 1.0, ratio), n_elements=n, order=order, length=2 * np.pi, start_tangent=(1, 0, 0),
            end_tangent=(1, 0, 0), normal=(0, 0, 1), stiff=1e6,
        )  # fmt: skip
        key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (1, 0, 0), 1.3 * wanted))
        pin = cf.Pin(rod, np.pi, free=("x", "y"))
        model = cf.Model([rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key), pin])
        history = cf.trace_path(model, along="time", until=1.0)
        event = next(event for event in history.critical if event.kind == "bifurcation")
        return 1.3 * wanted * event.t

    order, counts = None, (12, 24, 48)
    if ratio == 0.8:
        order = order_of(counts, [abs(critical(2, n) / wanted - 1) for n in counts])
    source, least = "Michell (1889), Zajac (1962), closed form", None if order is None else 3.3
    variant = f"GJ / EI = {ratio}"
    validation.row(
        "Michell's ring", source, wanted, critical(4, 24), 1e-4, variant=variant, order=order, least_order=least
    )


@pytest.mark.parametrize("direction", [1, -1])
def test_right_angle_frame(validation, references, order_of, direction):
    """A right-angle frame of a thin strip under a load in its plane leaves it."""
    case = references["A09_right_angle_frame"]
    data, L = case["data"], case["data"]["L"]
    E, b, h = data["E"], data["b"], data["h"]
    G = E / (2 * (1 + data["nu"]))
    section = cf.Section(
        force_stiffness=(5 / 6 * G * b * h, 5 / 6 * G * b * h, E * b * h),
        moment_stiffness=(E * data["I_weak"], E * data["I_inplane"], G * data["J_SaintVenant"]),
    )

    def critical(order, n):
        options = {"n_elements": n, "order": order}
        one = cf.Rod("one", section, [(0, 0, 0), (L, 0, 0)], normal=(0, 1, 0), **options)
        two = cf.Rod("two", section, [(L, 0, 0), (L, L, 0)], normal=(1, 0, 0), **options)
        load = cf.PointLoad(two, "end", force=(direction, 0, 0))
        model = cf.Model([one, two], [cf.Clamp(one, "start"), cf.Weld(one, "end", two, "start")], [load])
        return cf.critical_load(model).value

    sign = "+" if direction > 0 else "-"
    (key,) = [k for k in case["values"] if k.startswith("J=SaintVenant,full") and f"{sign}x" in k]
    wanted, counts = case["values"][key]["Pcr"], (4, 8, 16)
    order = order_of(counts, [abs(critical(1, n) / wanted - 1) for n in counts])
    source = "boundary value problem by collocation; Argyris et al. (1979): 1.088"
    validation.row(
        "right-angle frame, lateral buckling", source, wanted, critical(4, 8), 1e-5, variant=f"load along {sign}x",
        order=order, least_order=1.7,
    )  # fmt: skip


@pytest.mark.parametrize("tension", [0.0, 10.0])
def test_greenhill(validation, order_of, tension):
    """A rod clamped at both ends and twisted, under tension: the torque at which it leaves the line."""
    from verification.contact_references import greenhill

    wanted, GJ = greenhill(tension), 0.8

    def critical(order, n):
        rod = rod_of(STRAIGHT, bending=(1.0, 1.0, GJ), n_elements=n, order=order)
        key = cf.Part("key", motion=cf.Hinge((0, 0, 0), (1, 0, 0), 1.4 * wanted / GJ))
        supports = [cf.Clamp(rod, "start"), cf.Clamp(rod, "end", to=key, free=("x",))]
        pull = cf.PointLoad(rod, "end", force=(tension, 0, 0))
        history = cf.trace_path(cf.Model([rod], supports, [pull]), along="time", until=1.0)
        event = next(event for event in history.critical if event.kind == "bifurcation")
        return 1.4 * wanted * event.t

    counts, variant = (6, 12, 24), f"T = {tension:g} EI / L^2"
    order = order_of(counts, [abs(critical(2, n) / wanted - 1) for n in counts])
    source = "Greenhill (1883), determinant of the clamped ends"
    validation.row(
        "Greenhill's shaft", source, wanted, critical(4, 10), 1e-5, variant=variant, order=order, least_order=3.3
    )


@pytest.mark.slow
def test_references(references):
    """The stored numbers are what the shooting finds."""
    stored = references["stability"]
    np.testing.assert_allclose(ref.lee_frame(2160.0, 4320.0, 1440.0), stored["lee_frame"], rtol=1e-7)
    follower = ref.lee_frame(2160.0, 4320.0, 1440.0, follower=True, count=1)[0]
    np.testing.assert_allclose(follower, stored["lee_frame_follower"], rtol=1e-7)
    np.testing.assert_allclose(ref.deep_arch(1e6, 1e6, 1.0), stored["deep_arch"], rtol=1e-7)
