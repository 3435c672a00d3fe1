"""A05. Heavy cable between two clamps (collocation) and its limit EI -> 0, the elastic catenary (Irvine, closed form)."""

import numpy as np
import pytest

import cosserat_fem as cf

CLAMPED = [
    "span=0.9,rise=0,EI/(wL^3)=0.01", "span=0.9,rise=0,EI/(wL^3)=1e-06", "span=0.6,rise=0,EI/(wL^3)=0.0001",
    "span=0.98,rise=0,EI/(wL^3)=0.01", "span=0.98,rise=0,EI/(wL^3)=1e-06", "span=0.7,rise=0.3,EI/(wL^3)=0.0001",
]  # fmt: skip
SPANS = ((0.9, 0), (0.6, 0), (0.98, 0), (0.7, 0.3))
CATENARIES = [f"span={span},rise={rise},EA/(wL)={k}" for span, rise in SPANS for k in ("inf", 1000, 100, 10)]


def cable(case, EA, EI, *, n_elements, order, clamped):
    """Cable of length 1 and weight 1 per metre, drawn as a sagging curve; weight along -z."""
    span, rise = (float(item.split("=")[1]) for item in case.split(",")[:2])
    s = np.linspace(0, 1, 31)
    sag = 0.6 * np.sqrt(max(1 - span**2 - rise**2, 0))
    points = np.stack([span * s, 0 * s, rise * s - sag * np.sin(np.pi * s) ** (2 if clamped else 1)], axis=-1)
    section = cf.Section(force_stiffness=(EA, EA, EA), moment_stiffness=(EI, EI, EI), mass_per_length=1.0)
    along = (1, 0, 0) if clamped else None
    rod = cf.Rod(
        "c", section, points, n_elements=n_elements, order=order, length=1.0,
        layer=np.sqrt(EI) if clamped else None, start_tangent=along, end_tangent=along,
    )  # fmt: skip
    hold = cf.Clamp if clamped else cf.Pin
    return cf.Model([rod], [hold(rod, "start"), hold(rod, "end")], [cf.Gravity((0, 0, -1))])


@pytest.mark.parametrize("case", CLAMPED)
def test_clamped(references, validation, case):
    """End force, both end moments and the middle; EA = 1e8 w L stands for inextensible."""
    ref = references["A05a_heavy_cable_clamped"]["values"][case]
    EI = float(case.split("EI/(wL^3)=")[1])
    history = cf.solve_static(cable(case, 1e8, EI, n_elements=24, order=4, clamped=True))
    start, end = history.reaction("c.start@ground")[0], history.reaction("c.end@ground")[0]
    scale = abs(ref["m_y(0)"])
    errors = [
        abs(-start[:3] - ref["n(0)"]).max(),
        abs(-start[4] - ref["m_y(0)"]) / scale,
        abs(end[4] - ref["m_y(L)"]) / scale,
        abs(history.positions("c")[0, len(history.nodes("c")) // 2] - ref["r(L/2)"]).max(),
    ]
    source = "boundary value problem by collocation"
    for name, error, accepted in (
        ("force", errors[0], 2e-5), ("moments", max(errors[1:3]), 1e-4), ("middle", errors[3], 1e-5),
    ):  # fmt: skip
        validation.error("heavy cable between clamps", source, error, accepted, variant=f"{name}, {case}")
    assert history.stable == [True]


@pytest.mark.parametrize("case", CATENARIES)
def test_catenary_limit(references, validation, case):
    """Pinned ends, EI = 1e-6, 1e-7, 1e-8 w L^3: the error falls with EI and tends to the closed form.

    EA = 1e6 w L stands for inextensible; its stretch T / EA leaves about H T / (2 EA (1 - chord)) of the force."""
    ref = references["A05b_extensible_catenary"]["values"][case]
    stiff = case.split("EA/(wL)=")[1]
    EA = 1e6 if stiff == "inf" else float(stiff)
    errors = []
    for EI in (1e-6, 1e-7, 1e-8):
        history = cf.solve_static(cable(case, EA, EI, n_elements=60, order=3, clamped=False))
        H = history.reaction("c.end@ground")[0]
        middle = history.positions("c")[0, len(history.nodes("c")) // 2]
        errors.append(max(abs(H[0] - ref["H"]), abs(H[2] - (ref["n_z(0)"] + 1)), abs(middle - ref["r(L/2)"]).max()))
    chord = np.hypot(*(float(item.split("=")[1]) for item in case.split(",")[:2]))
    remainder = (1 + ref["H"]) ** 2 / (EA * (1 - chord)) if stiff == "inf" else 0.0
    validation.error("elastic catenary", "Irvine (1981), closed form", errors[2], 2e-6 + remainder, variant=case)
    assert errors[2] < 0.2 * errors[0] + remainder
