"""A03. The 45 degree bend of Bathe and Bolourchi (1979), doi 10.1002/nme.1620140703: out-of-plane tip force."""

import numpy as np
import pytest

import cosserat_fem as cf

R, ANGLE = 100.0, np.pi / 4
TORSION = {"0.1406": 0.1406, "1/6": 1 / 6, "0.140577": 0.140577}
CASES = [f"J={J},k={k},P={P}" for J in TORSION for k in ("1", "5/6") for P in (300, 450, 600)]


def bend(case, *, n_elements, order):
    """Arc in the x-y plane from the origin along +y, centre (R, 0, 0); force along +z at the tip."""
    given = dict(item.split("=") for item in case.split(","))
    k = 1.0 if given["k"] == "1" else 5 / 6
    stiffness = (k * 5e6, k * 5e6, 1e7, 1e7 / 12, 1e7 / 12, 5e6 * TORSION[given["J"]])
    section = cf.Section(force_stiffness=stiffness[:3], moment_stiffness=stiffness[3:])
    a = np.linspace(0, ANGLE, 200)
    points = R * np.stack([1 - np.cos(a), np.sin(a), 0 * a], axis=-1)
    rod = cf.Rod(
        "bend", section, points, n_elements=n_elements, order=order, rest=(0, 1 / R, 0), length=R * ANGLE,
        start_tangent=(0, 1, 0), end_tangent=(1, 1, 0), normal=(1, 0, 0),
    )  # fmt: skip
    force = (0, 0, float(given["P"]))
    return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=force)])


@pytest.mark.parametrize("case", CASES)
def test_all_loads_and_sections(references, validation, case):
    """Tip, clamp moment and strain energy against shooting, from the load-free arc in one step."""
    ref = references["A03_bend45"]["values"][case]
    history = cf.solve_static(bend(case, n_elements=12, order=4))
    tip = history.positions("bend")[0, -1]
    error = np.linalg.norm(tip - ref["tip"]) / (R * ANGLE)
    moment = history.reaction("bend.start@ground")[0, 3:] - ref["support_moment_n(0)xyz"]
    source = "shooting; problem of Bathe and Bolourchi (1979)"
    validation.error("bend of 45 degrees", source, error, 1e-8, unit="L", variant=case)
    assert abs(moment).max() < 1e-7 * 3e4
    assert history.energy[0] == pytest.approx(ref["energy"], rel=1e-7)
    assert history.counters.load_steps == 0


@pytest.mark.parametrize(("order", "counts"), [(1, (16, 32, 64)), (2, (8, 16, 32)), (3, (4, 8, 16)), (4, (2, 4, 8))])
def test_order(references, validation, order_of, order, counts):
    case = "J=0.1406,k=1,P=600"
    ref = references["A03_bend45"]["values"][case]["tip"]
    errors = []
    for n in counts:
        tip = cf.solve_static(bend(case, n_elements=n, order=order)).positions("bend")[0, -1]
        errors.append(np.linalg.norm(tip - ref) / (R * ANGLE))
    found = order_of(counts, errors)
    source = "shooting; problem of Bathe and Bolourchi (1979)"
    validation.error(
        "bend of 45 degrees", source, errors[-1], 1e-3, unit="L", variant=f"{counts[-1]} x p{order}",
        order=found, least_order=2 * order - 0.5,
    )  # fmt: skip
