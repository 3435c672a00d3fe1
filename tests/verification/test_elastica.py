"""A02. Cantilever under a dead tip force, P L^2 / EI = 1 to 10: elliptic integrals, and with shear and stretch."""

import numpy as np
import pytest

import cosserat_fem as cf


def solve(cantilever, stiffness, P, *, n_elements=10, order=4):
    model = cantilever(stiffness, 1.0, n_elements=n_elements, order=order, force=(0, P, 0), normal=(0, 0, 1))
    history = cf.solve_static(model)
    tip, frame = history.positions("rod")[0, -1], history.directors("rod")[0, -1]
    angle = np.arctan2(frame[1, 2], frame[0, 2])
    return np.array([1 - tip[0], tip[1], angle, history.energy[0]]), history


@pytest.mark.parametrize("P", range(1, 11))
def test_inextensible(cantilever, references, validation, P):
    """EA = GA = 1e8 EI / L^2 stands for a constraint; its remainder is of order P / EA = 1e-7."""
    found, _ = solve(cantilever, (1e8, 1e8, 1e8, 1, 1, 1), float(P))
    ref = references["A02a_elastica_tip_force"]["values"][str(P)]
    wanted = [ref["u_over_L"], ref["w_over_L"], ref["tip_angle"]]
    source = "elliptic integrals; Mattiasson (1981)"
    validation.row(
        "elastica under a tip force", source, wanted, found[:3], 5e-7, scale=1.0, variant=f"P L^2 / EI = {P}"
    )


@pytest.mark.parametrize("case", ["slender10", "slender100"])
@pytest.mark.parametrize("P", range(1, 11))
def test_with_shear_and_stretch(cantilever, references, validation, case, P):
    """All ten loads of two thick rods: place, director angle and energy of the tip."""
    data = references[f"A02b_elastica_{case}"]
    found, _ = solve(cantilever, data["data"]["stiffness"], float(P))
    ref = data["values"][str(P)]
    ratio = found / [ref["u"], ref["w"], ref["director_angle"], ref["energy"]]
    source = "boundary value problem by collocation"
    validation.row(
        "cantilever with shear and stretch", source, 1.0, ratio, 1e-8, unit="ratio", variant=f"{case}, P = {P}"
    )


@pytest.mark.parametrize(("order", "counts"), [(1, (16, 32, 64)), (2, (8, 16, 32)), (3, (4, 8, 16)), (4, (3, 6, 12))])
def test_order(cantilever, references, validation, order_of, order, counts):
    data = references["A02b_elastica_slender100"]
    ref = data["values"]["10"]
    errors = [
        abs(solve(cantilever, data["data"]["stiffness"], 10.0, n_elements=n, order=order)[0][1] - ref["w"])
        for n in counts
    ]
    found = order_of(counts, errors)
    validation.error(
        "cantilever with shear and stretch", "boundary value problem by collocation", errors[-1], 1e-3, unit="L",
        variant=f"{counts[-1]} x p{order}", order=found, least_order=2 * order - 0.5,
    )  # fmt: skip
