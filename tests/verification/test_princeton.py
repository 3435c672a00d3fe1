"""A07. The Princeton beam (Dowell and Traybar): unequal bending, three tip loads at seven angles; collocation and ANSYS."""

import numpy as np
import pytest

import cosserat_fem as cf

LENGTH, HEIGHT, THICKNESS = 0.508, 0.0123777, 0.0032024
E, NU = 71.7e9, 0.31
SETS = {"k=5/6,J=SaintVenant": None, "k=1,J=0.198(Iyy+Izz)": 0.198}


def beam(name, P, beta):
    """Along x, height along y; load P (0, -cos beta, sin beta)."""
    plain = cf.Section.rectangle(HEIGHT, THICKNESS, youngs_modulus=E, poisson_ratio=NU)
    if SETS[name] is not None:
        G = E / (2 * (1 + NU))
        EI1, EI2, _ = plain.moment_stiffness
        area = HEIGHT * THICKNESS
        plain = cf.Section(
            force_stiffness=(G * area, G * area, E * area),
            moment_stiffness=(EI1, EI2, G * SETS[name] * (EI1 + EI2) / E),
        )
    rod = cf.Rod("beam", plain, [(0, 0, 0), (LENGTH, 0, 0)], n_elements=6, order=4, normal=(0, 1, 0))
    b = np.radians(beta)
    return cf.Model(
        [rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=(0, -P * np.cos(b), P * np.sin(b)))]
    )


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("P", [4.448, 8.896, 13.345])
def test_all_angles(references, validation, name, P):
    values = references["A07_princeton"]["values"]
    errors, twists = [], []
    for beta in (0, 15, 30, 45, 60, 75, 90):
        ref = values[f"{name};P={P};beta={beta}"]
        history = cf.solve_static(beam(name, P, beta))
        errors.append(np.linalg.norm(history.positions("beam")[0, -1] - (LENGTH, 0, 0) - ref["u_xyz"]) / LENGTH)
        d1 = history.directors("beam")[0, -1, :, 0]
        twists.append(abs(np.degrees(np.arctan2(d1[2], d1[1])) - ref["twist_deg_atan2(d1_z,d1_y)"]))
    source = "boundary value problem by collocation; problem of Dowell and Traybar (1975)"
    validation.error("Princeton beam", source, max(errors), 1e-9, unit="L", variant=f"{name}, P = {P} N")
    assert max(twists) < 1e-6


def test_ansys(validation):
    """Within 0.2 mm of the ANSYS beam188 values quoted by Obrezkov et al. (2022), whose mesh is 40 elements."""
    ansys = {
        8.896: ([0.0107141763, 0.01061328706, 0.0101116963, 0.008837226265, 0.006604665004, 0.003538889001, 0],
                [0, 0.04208232124, 0.07939482948, 0.108987937, 0.129887616, 0.14219437, 0.146245978]),
        13.345: ([0.01606423724, 0.01645825752, 0.01665873206, 0.0151861844, 0.011578375, 0.006248967384, 0],
                 [0, 0.06435812858, 0.117735994, 0.156467239, 0.181861627, 0.196097131, 0.200677707]),
    }  # fmt: skip
    for P, (down, side) in ansys.items():
        for beta, y, z in zip((0, 15, 30, 45, 60, 75, 90), down, side, strict=True):
            tip = cf.solve_static(beam("k=5/6,J=SaintVenant", P, beta)).positions("beam")[0, -1]
            variant = f"P = {P} N, {beta} deg"
            source = "ANSYS beam188, in Obrezkov et al. (2022)"
            validation.row(
                "Princeton beam, another program",
                source,
                (y, z),
                (-tip[1], tip[2]),
                2e-4,
                scale=1,
                unit="m",
                variant=variant,
            )
