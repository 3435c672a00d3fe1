"""A04. Cantilever bent to a helix of ten coils (Ibrahimbegovic 1997, doi 10.1016/S0045-7825(97)00059-5)."""

import numpy as np

import cosserat_fem as cf


def follow(step, n_elements, order):
    """End moment 200 pi l about z and force 50 l along z, both dead, l from 0 to 1 in steps."""
    section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(100, 100, 100))
    rod = cf.Rod("rod", section, [(0, 0, 0), (10, 0, 0)], n_elements=n_elements, order=order)
    load = cf.PointLoad(rod, "end", force=lambda t: (0, 0, 50 * t), moment=lambda t: (0, 0, 200 * np.pi * t))
    model = cf.Model([rod], [cf.Clamp(rod, "start")], [load])
    return cf.solve_quasistatic(model, np.linspace(0, 1, round(1 / step) + 1))


def test_ten_coils(references, validation):
    """All ten loads along the path, tip and energy against shooting; the tip's largest excursion on the way."""
    data = references["A04_helix"]
    history = follow(0.0025, 60, 4)
    tip, energy, t = history.positions("rod")[:, -1], history.energy, history.t
    errors = []
    for load, ref in data["values"].items():
        k = int(np.argmin(abs(t - float(load))))
        errors.append(max(np.linalg.norm(tip[k] - ref["tip"]) / 10, abs(energy[k] / ref["energy"] - 1)))
    source = "shooting; problem of Ibrahimbegovic (1997)"
    validation.error("cantilever bent to a helix of ten coils", source, max(errors), 1e-5, unit="L", variant="60 x p4")
    for load, x, y, z in data["path_lambda_x_y_z"]:
        k = int(np.argmin(abs(t - load)))
        if abs(t[k] - load) < 1e-9:
            np.testing.assert_allclose(tip[k], (x, y, z), atol=1e-4)
    balance = history.reaction("rod.start@ground")[-1]
    np.testing.assert_allclose(balance[:3], (0, 0, -50), atol=1e-6)
    np.testing.assert_allclose(balance[3:], -np.cross(tip[-1], (0, 0, 50)) - (0, 0, 200 * np.pi), atol=1e-5)


def test_order(references, validation, order_of):
    """Convergence at a tenth of the load, one coil."""
    ref = references["A04_helix"]["values"]["0.1"]["tip"]
    counts, errors = (8, 16, 32), []
    for n in counts:
        section = cf.Section(force_stiffness=(1e4, 1e4, 1e4), moment_stiffness=(100, 100, 100))
        rod = cf.Rod("rod", section, [(0, 0, 0), (10, 0, 0)], n_elements=n, order=3)
        load = cf.PointLoad(rod, "end", force=lambda t: (0, 0, 50 * t), moment=lambda t: (0, 0, 200 * np.pi * t))
        history = cf.solve_quasistatic(cf.Model([rod], [cf.Clamp(rod, "start")], [load]), np.linspace(0, 0.1, 41))
        errors.append(np.linalg.norm(history.positions("rod")[-1, -1] - ref) / 10)
    found = order_of(counts, errors)
    source = "shooting; problem of Ibrahimbegovic (1997)"
    validation.error(
        "cantilever bent to a helix of ten coils", source, errors[-1], 1e-5, unit="L", variant="one coil, 32 x p3",
        order=found, least_order=5.3,
    )  # fmt: skip
