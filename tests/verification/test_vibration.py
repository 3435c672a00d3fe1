"""Vibrations about straight, stretched, compressed, hanging and curved states: closed forms and characteristic equations."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jn_zeros

import cosserat_fem as cf
from cosserat_fem.iteration.newton import Newton

FREE = {"clamped": (), "pinned": ("ry", "rz")}
PLAIN = ["slender r/L=0.01", "stocky r/L=0.05"]
PRESTRESSED = ["prestress N=10, EA=1e5", "prestress N=100, EA=1e5", "prestress N=1000, EA=1e5"]


def beam(data, ends, *, n_elements=16, order=4):
    """A beam of unstressed length 1 along x, stretched between its ends if it is prestressed."""
    section = cf.Section(
        force_stiffness=(data["GA"], data["GA"], data["EA"]), moment_stiffness=(data["EI"],) * 3,
        mass_per_length=data["rhoA"], rotary_inertia=(data["rhoI"], data["rhoI"], 2 * data["rhoI"]),
    )  # fmt: skip
    tip = (data.get("stretch", 1.0), 0, 0)
    rod = cf.Rod("beam", section, [(0, 0, 0), tip], n_elements=n_elements, order=order, length=1.0, normal=(0, 0, 1))
    first, second = ends.split("-")
    supports = [cf.Clamp(rod, "start", free=FREE[first])]
    if second != "free":
        supports.append(cf.Clamp(rod, "end", free=FREE[second]))
    return cf.Model([rod], supports)


def nearest(found, wanted):
    """For each wanted frequency the nearest found one; others (the other plane, twist, stretch) lie between them."""
    return np.array([found[np.argmin(np.abs(found - w))] for w in wanted])


def vibrations(model, n=14):
    return cf.modes(model, cf.solve_static(model).final, n)


@pytest.mark.parametrize("ends", ["clamped-free", "clamped-clamped", "pinned-pinned"])
@pytest.mark.parametrize("name", [*PLAIN, *PRESTRESSED])
def test_beam(validation, references, order_of, name, ends):
    """C04: three frequencies of Timoshenko beams with rotary inertia, also under tension; order of the first."""
    values = references["C04_linear_frequencies"]["values"]
    if f"{name}, {ends}" not in values:
        pytest.skip("no reference")
    data = values[f"{name}, {ends}"]
    wanted = np.array(data["omega_1..6"][:3])
    found = nearest(vibrations(beam(data, ends)).omega, wanted)
    counts = (32, 64, 128) if ends == "clamped-clamped" and "N=" in name else (4, 8, 16)  # layers of sqrt(EI / N)
    errors = [
        abs(nearest(vibrations(beam(data, ends, n_elements=n, order=2)).omega, wanted)[0] - wanted[0]) for n in counts
    ]
    kind = f"vibration of a beam{' under tension' if 'N=' in name else ''}"
    source = "Timoshenko, characteristic equation"
    order = order_of(counts, errors)
    validation.row(kind, source, wanted, found, 1e-6, variant=f"{name}, {ends}", order=order, least_order=3.3)


def test_stretch_and_twist(validation):
    """Along itself and about itself: (2 k - 1) pi / 2 times the speeds of sound."""
    section = cf.Section(
        force_stiffness=(1e4, 1e4, 4e4), moment_stiffness=(100.0, 100.0, 30.0), mass_per_length=2.0,
        rotary_inertia=(1e-2, 1e-2, 3e-3),
    )  # fmt: skip
    rod = cf.Rod("rod", section, [(0, 0, 0), (2, 0, 0)], n_elements=10, order=4)
    found = cf.modes(cf.Model([rod], [cf.Clamp(rod, "start")]), n=40).omega
    k = np.array([1, 3, 5])
    for name, speed in (("stretch", np.sqrt(4e4 / 2.0)), ("twist", np.sqrt(30.0 / 3e-3))):
        wanted = k * np.pi / 2 * speed / 2.0
        validation.row(
            "vibration along and about a rod", "closed form", wanted, nearest(found, wanted), 1e-6, variant=name
        )


def test_string(validation):
    """A taut string: n pi sqrt(T / m) / L; its bending stiffness adds sqrt(EI / T) at each end."""
    section = cf.Section(force_stiffness=(1e4,) * 3, moment_stiffness=(1e-6,) * 3, mass_per_length=0.5)
    tension = 100.0
    rod = cf.Rod("string", section, [(0, 0, 0), (1 + tension / 1e4, 0, 0)], length=1.0, n_elements=20, order=4)
    pins = [cf.Clamp(rod, at, free=("ry", "rz")) for at in ("start", "end")]
    found = vibrations(cf.Model([rod], pins), 12).omega
    # mass per unstressed length: waves run the unstressed length at sqrt(T / (m stretch))
    wanted = np.arange(1, 4) * np.pi * np.sqrt(tension / (0.5 * (1 + tension / 1e4)))
    validation.row("vibration of a string", "d'Alembert (1747), closed form", wanted, nearest(found, wanted), 1e-5)


def test_hanging_chain(validation):
    """A chain that hangs by one end: half the zeros of J0 times sqrt(g / L)."""
    section = cf.Section(force_stiffness=(1e5,) * 3, moment_stiffness=(1e-7,) * 3, mass_per_length=1.0)
    rod = cf.Rod("chain", section, [(0, 0, 0), (0, 0, -1)], n_elements=40, order=4)
    pin = cf.Clamp(rod, "start", free=("rx", "ry"))
    found = vibrations(cf.Model([rod], [pin], [cf.Gravity((0, 0, -9.81))]), 10).omega
    wanted = jn_zeros(0, 3) / 2 * np.sqrt(9.81)
    validation.row(
        "vibration of a hanging chain", "D. Bernoulli (1733), Bessel function", wanted, nearest(found, wanted), 2e-4
    )


@pytest.mark.parametrize("part", [0.5, 0.99, -3.0])
def test_loaded_column(validation, part):
    """A pinned column under a push P, and a pull: omega^2 = (pi / L)^4 EI / m (1 - P / P_cr)."""
    section = cf.Section(force_stiffness=(1e7,) * 3, moment_stiffness=(1.0, 2.0, 1.0), mass_per_length=1.0)
    rod = cf.Rod("column", section, [(0, 0, 0), (1, 0, 0)], n_elements=10, order=4, normal=(0, 0, 1))
    supports = [cf.Clamp(rod, "start", free=("ry", "rz")), cf.Clamp(rod, "end", free=("x", "ry", "rz"))]
    model = cf.Model([rod], supports, [cf.PointLoad(rod, "end", force=(-part * np.pi**2, 0, 0))])
    found = vibrations(model, 4).squared[0]
    wanted = np.pi**4 * (1 - part)
    source = "closed form"
    validation.row(
        "vibration of a loaded column",
        source,
        wanted,
        found,
        1e-5,
        scale=np.pi**4 * (1 + abs(part)),
        variant=f"P = {part} P_cr",
    )


def test_growth_beyond_the_critical_load(validation):
    """Pushed with 2 P_cr the straight column leaves its line at the rate pi^2 sqrt(EI / m) / L^2."""
    section = cf.Section(force_stiffness=(1e7,) * 3, moment_stiffness=(1.0, 8.0, 1.0), mass_per_length=1.0)
    rod = cf.Rod("column", section, [(0, 0, 0), (1, 0, 0)], n_elements=10, order=4, normal=(0, 0, 1))
    supports = [cf.Clamp(rod, "start", free=("ry", "rz")), cf.Clamp(rod, "end", free=("x", "ry", "rz"))]
    model = cf.Model([rod], supports, [cf.PointLoad(rod, "end", force=(-2 * np.pi**2, 0, 0))])
    found = cf.modes(model, Newton(model).plain(model.initial_state()).state, 4)
    validation.row("growth beyond the critical load", "closed form", np.pi**2, found.growth.max(), 1e-5)


def test_below_flutter(validation):
    """Both frequencies of Beck's column on the way to flutter, from its characteristic equation."""
    P = 15.0

    def equation(w):
        half = np.sqrt(P * P / 4 + w * w)
        a, b = np.sqrt(half - P / 2), np.sqrt(half + P / 2)
        return P * P + 2 * w * w * (1 + np.cosh(a) * np.cos(b)) + P * w * np.sinh(a) * np.sin(b)

    wanted = [brentq(equation, 1.0, 10.0), brentq(equation, 11.0, 25.0)]
    section = cf.Section(force_stiffness=(1e7,) * 3, moment_stiffness=(1.0,) * 3, mass_per_length=1.0)
    rod = cf.Rod("column", section, [(0, 0, 0), (1, 0, 0)], n_elements=10, order=4)
    push = cf.PointLoad(rod, "end", force=(0, 0, -P), follower=True)
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [push])
    found = cf.modes(model, Newton(model).plain(model.initial_state()).state, 6).omega
    validation.row(
        "vibration below flutter", "Beck (1952), characteristic equation", wanted, nearest(found, wanted), 1e-5
    )


@pytest.mark.parametrize("plane", ["in", "out of"])
def test_ring(validation, plane):
    """A free closed ring, two halves joined at both ends: vibrations in and out of its plane, six rigid motions."""
    EI, GJ, m = 1.0, 0.7, 1.0
    section = cf.Section(force_stiffness=(1e6,) * 3, moment_stiffness=(EI, EI, GJ), mass_per_length=m)
    halves = []
    for k in (0, 1):
        a = np.linspace(0, np.pi, 101) + k * np.pi
        points = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
        tangents = [(-np.sin(x), np.cos(x), 0) for x in (a[0], a[-1])]
        halves.append(
            cf.Rod(
                f"half {k}", section, points, n_elements=12, order=4, rest="as_drawn", normal=(0, 0, 1),
                start_tangent=tangents[0], end_tangent=tangents[1],
            )
        )  # fmt: skip
    one, two = halves
    model = cf.Model(halves, [cf.Weld(one, "end", two, "start"), cf.Weld(two, "end", one, "start")])
    found = cf.modes(model, n=20).omega
    assert (found < 1e-2).sum() == 6
    n = np.array([2.0, 3.0, 4.0])
    below = n**2 + (1 if plane == "in" else EI / GJ)
    wanted = np.sqrt(EI / m * n**2 * (n**2 - 1) ** 2 / below)
    source = "Love (1892), closed form of the inextensible ring"
    validation.row(
        "vibration of a closed ring", source, wanted, nearest(found, wanted), 2e-5, variant=f"{plane} its plane"
    )
