"""Violations planted between the stations of a travel, each 1 deg wide, are found where and when they were planted.

An arm turns by 90 deg in 90 s; stations are asked every 5 deg. All rods are stiff or free of weight, so that statics of
rigid bodies and M = EI / R say what each peak is. Loads and parts have pulses that last from half a degree before their peak
to half a degree after; a pin stands in the way, where the arm passes through it, so that nothing but the look finds it.
"""

import json

import numpy as np
import pytest

import cosserat_fem as cf

D, THIN, E_THIN = 0.01, 0.004, 1e9
WEIGHT = 1000 * np.pi / 4 * D**2 * 0.5 * 9.81
EI = E_THIN * np.pi / 64 * THIN**4
MOMENT, PULL, BALL, BEND, CROSS, PIN = 31.37, 52.91, 43.27, 22.41, 67.73, 77.77  # where the peaks are [deg] or [s]


def along(angle):
    """Direction of the arm."""
    return np.array([np.cos(np.radians(angle)), 0.0, -np.sin(np.radians(angle))])


def pulse(t, value, rest=0.0):
    """A table that is at rest but for a pulse of one degree."""
    rows = [np.broadcast_to(x, np.shape(value)).tolist() for x in (rest, rest, value, rest, rest)]
    return f"[[0, {t - 0.5}, {t}, {t + 0.5}, 90], {rows}]"


def scene(tmp_path, resolution):
    ball, c = 0.45 * along(BALL), 0.3 * along(CROSS)
    text = f"""
[[section]]
name = "stiff"
kind = "round"
diameter = {D}
youngs_modulus = 1e14
density = 1000

[[section]]
name = "thin"
kind = "round"
diameter = {THIN}
youngs_modulus = {E_THIN}

[[rod]]
name = "a"
section = "stiff"
points = [[0.1, 0, 0], [0.6, 0, 0]]
n_elements = 5

[[rod]]
name = "b"
section = "thin"
points = [[0.1, 0.4, 0], [0.5, 0.4, 0]]
n_elements = 8

[[rod]]
name = "c"
section = "stiff"
points = [{(c + [0, 0.05, 0]).tolist()}, {(c + [0, 0.25, 0]).tolist()}]
n_elements = 4

[[part]]
name = "arm"
motion = {{ kind = "hinge", axis = [0, 1, 0], angle = [[0, 90], [0, "90 deg"]] }}

[[part]]
name = "ball"
shape = {{ kind = "sphere", center = {ball.tolist()}, radius = 0.02 }}
motion = {{ kind = "slider", axis = [0, -1, 0], travel = {pulse(BALL, -0.03, -0.3)} }}

[[part]]
name = "pin"
shape = {{ kind = "sphere", center = {(0.58 * along(PIN)).tolist()}, radius = 0.001 }}

[[part]]
name = "cam"
motion = {{ kind = "slider", axis = [0, -1, 0], travel = {pulse(CROSS, 0.03)} }}

[[support]]
kind = "clamp"
name = "hub"
rod = "a"
at = "start"
to = "arm"

[[support]]
kind = "clamp"
name = "clip"
rod = "b"
at = "start"
to = "arm"

[[support]]
kind = "clamp"
name = "cam"
rod = "c"
at = "end"
to = "cam"

[gravity]
acceleration = [0, 0, -9.81]

[[load]]
kind = "point"
rod = "a"
at = "end"
moment = {pulse(MOMENT, [0.0, 1.0, 0.0])}
force = {pulse(PULL, (10 * along(PULL)).tolist())}

[[load]]
kind = "point"
rod = "b"
at = "end"
moment = {pulse(BEND, [0.0, EI / 0.2, 0.0])}

[checks]
bend_radius = {{ rod = "b", limit = 0.25 }}
tension = {{ rod = "a", limit = 9 }}
reaction_moment = {{ support = "hub", limit = 0.9 }}
hinge_torque = 0.9
clearance = [
    {{ rod = "a", part = "ball", limit = 0.007 }},
    {{ rod = "a", other = "c", limit = 0.012 }},
    {{ rod = "a", part = "pin", limit = 0 }},
]

[solve]
kind = "quasistatic"
duration = 90
{resolution}

[output]
every = 5
"""
    (tmp_path / "scene.toml").write_text(text)
    return cf.load_scene(tmp_path / "scene.toml")


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planted")
    outcome = cf.run_scene(scene(folder, ""), folder / "out")
    return {v.name: v for v in outcome.checks}, json.loads((folder / "out" / "summary.json").read_text())


PLANTED = {
    "bend radius of b": (BEND, 0.2 - THIN / 2, None),  # the same all along
    "tension of a": (PULL, 10 + WEIGHT * np.sin(np.radians(PULL)), 0.0),
    "reaction moment at hub": (MOMENT, 1 + 0.25 * WEIGHT * np.cos(np.radians(MOMENT)), None),
    "hinge torque of arm": (MOMENT, 1 + 0.35 * WEIGHT * np.cos(np.radians(MOMENT)), None),
    "clearance of a from ball": (BALL, 0.03 - 0.02 - D / 2, 0.35),
    "clearance of a from c": (CROSS, 0.02 - D, 0.2),
    "clearance of a from pin": (PIN, -0.001 - D / 2, 0.48),
}


@pytest.mark.parametrize("name", PLANTED)
def test_violation_is_found(found, name):
    """At the angle within a fiftieth of its width, at the place within an element, as large as it is."""
    (angle, value, s), verdict = PLANTED[name], found[0][name]
    assert verdict.status == "UNSAFE"
    assert verdict.angle == pytest.approx(angle, abs=0.02)
    assert verdict.value == pytest.approx(value, rel=2e-3)
    if s is not None:
        assert verdict.s == pytest.approx(s, abs=0.1)  # of an element
    assert found[1]["checks"][name]["worst"]["angle_deg"] == verdict.angle
    assert found[1]["verdict"] == "UNSAFE"


def test_asked_stations_alone_do_not_see_them(tmp_path):
    """The peaks lie between the asked stations: without a look there, none is found."""
    outcome = cf.run_scene(scene(tmp_path, "resolution = false"), tmp_path / "out")
    assert len(outcome.history) == 19
    assert [verdict.name for verdict in outcome.checks] == list(PLANTED)
    assert all(verdict.status == "SAFE" for verdict in outcome.checks)
