"""Stiffness of layers, against closed forms that share no code with it."""

import math

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.cables.buildup import awg_diameter, most_around, packed

COPPER = cf.Material(117e9, 44e9, 8960)
SOFT = cf.Material(0.8e9, 0.3e9, 1730)


def rods_in_plane(places, d, E):
    """EI about one axis of parallel welded wires with centres at `places` (n, 2): sum of I + A y^2."""
    I, A = math.pi * d**4 / 64, math.pi * d**2 / 4
    return E * sum(I + A * y**2 for _, y in places)


def test_seven_wires():
    """One around which six lie: free wires, one solid, and the sum of areas; any axis gives the same."""
    d = 0.2e-3
    cable = cf.build_up([cf.Strands(7, d, COPPER)])
    places = [(0, 0), *((d * math.cos(a), d * math.sin(a)) for a in np.arange(6) * math.pi / 3)]
    assert cable.bending_stiffness[0] == pytest.approx(7 * 117e9 * math.pi * d**4 / 64, rel=1e-12)
    assert cable.bending_stiffness[1] == pytest.approx(rods_in_plane(places, d, 117e9), rel=1e-12)
    assert cable.stretch_stiffness == pytest.approx(7 * 117e9 * math.pi * d**2 / 4)
    assert cable.mass_per_length == pytest.approx(7 * 8960 * math.pi * d**2 / 4)
    assert cable.diameter == pytest.approx(3 * d)
    twist = 44e9 * sum(math.pi * d**4 / 32 + math.pi * d**2 / 4 * (x**2 + y**2) for x, y in places)
    assert cable.twist_stiffness == pytest.approx((7 * 44e9 * math.pi * d**4 / 32, twist))


@pytest.mark.parametrize(("n", "total"), [(1, 0), (2, 0.5), (3, 1), (4, 2), (7, 6), (12, 19), (19, 48), (37, 186)])
def test_packing(n, total):
    """Sum of squares of the radii, counted by hand on the triangular lattice."""
    assert (packed(n) ** 2).sum() == pytest.approx(total)


def test_ring_holds_as_many_as_touch():
    """Six equal circles fit around one, twelve around seven; nine of half the size around one."""
    assert (most_around(1, 1), most_around(3, 1), most_around(2, 1)) == (6, 12, 9)


def test_lay():
    """One helical wire on a ring: EA cos^3, mass / cos, bending as Foti's sums."""
    core, d, lay = cf.Strands(1, 1e-3, COPPER), 1e-3, 20e-3
    c = math.cos(math.atan(2 * math.pi * 1e-3 / lay))
    straight = cf.build_up([core])
    laid = cf.build_up([core, cf.Strands(6, d, COPPER, lay=lay)])
    EA, EI = 117e9 * math.pi * d**2 / 4, 117e9 * math.pi * d**4 / 64
    assert laid.stretch_stiffness - straight.stretch_stiffness == pytest.approx(6 * EA * c**3)
    assert laid.mass_per_length / straight.mass_per_length - 1 == pytest.approx(6 / c)
    slip, stick = np.subtract(laid.bending_stiffness, straight.bending_stiffness)
    assert slip == pytest.approx(6 * c * EI)
    assert stick == pytest.approx(6 * c * EI + 3 * c**3 * EA * d**2)


def test_tubes_are_the_same_at_both_ends():
    """A solid rod in two tubes: the sum of hollow cylinders; one material through and through is a solid rod."""
    layers = [cf.Strands(1, 2e-3, SOFT), cf.Tube(SOFT, diameter=3e-3), cf.Tube(SOFT, thickness=0.5e-3)]
    cable = cf.build_up(layers)
    solid = cf.Section.round(4e-3, youngs_modulus=0.8e9, shear_modulus=0.3e9, density=1730)
    assert not cable.banded
    section = cable.section("slip")
    np.testing.assert_allclose(section.matrix, solid.matrix, rtol=1e-12)
    assert section.mass_per_length == pytest.approx(solid.mass_per_length)
    np.testing.assert_allclose(section.rotary_inertia, solid.rotary_inertia)
    assert section.radius == pytest.approx(2e-3)


def test_braid_and_tape():
    """Fine wires bend for nothing when they slide and like a tube of their area when they stick; sliding tape is no tube."""
    inside = cf.build_up([cf.Tube(SOFT, diameter=2e-3)])
    braid = cf.build_up([cf.Tube(SOFT, diameter=2e-3), cf.Braid(48, 0.1e-3, math.radians(30), COPPER)])
    c, EA = math.cos(math.radians(30)), 117e9 * math.pi * 0.1e-3**2 / 4
    gain = np.subtract(braid.bending_stiffness, inside.bending_stiffness)
    assert gain[0] == pytest.approx(48 * c * 117e9 * math.pi * 0.1e-3**4 / 64)
    assert gain[1] - gain[0] == pytest.approx(24 * c**3 * EA * 1.1e-3**2)
    assert braid.diameter == pytest.approx(2.4e-3)
    tape = cf.build_up([cf.Tube(SOFT, diameter=2e-3), cf.Tape(0.05e-3, COPPER, overlap=0.5)])
    assert tape.diameter == pytest.approx(2.2e-3)
    assert tape.bending_stiffness[0] == pytest.approx(inside.bending_stiffness[0])
    assert tape.bending_stiffness[1] - inside.bending_stiffness[1] == pytest.approx(
        117e9 * math.pi / 64 * (2.2e-3**4 - 2e-3**4)
    )


def test_bundle_of_cables():
    """Cables slip in themselves and on each other."""
    wire = cf.build_up([cf.Strands(7, 0.2e-3, COPPER), cf.Tube(SOFT, diameter=1e-3)])
    bundle = cf.build_up([cf.Cables(7, wire)])
    assert bundle.bending_stiffness[0] == pytest.approx(7 * wire.bending_stiffness[0])
    stick = 7 * wire.bending_stiffness[1] + 3 * wire.stretch_stiffness * 1e-3**2
    assert bundle.bending_stiffness[1] == pytest.approx(stick)


def test_measured_values_replace_derived_ones():
    cable = cf.build_up(
        [cf.Strands(7, 0.2e-3, COPPER)], diameter=1e-3, mass_per_length=5e-3, bending_stiffness=(1e-5, 2e-5)
    )
    assert (cable.diameter, cable.mass_per_length, cable.bending_stiffness) == (1e-3, 5e-3, (1e-5, 2e-5))


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([], "needs at least one"),
        ([cf.Strands(0, 1e-3, COPPER)], "layer 1: strands: count: must be an integer of at least 1 (got 0)"),
        ([cf.Strands(1, 1e-3, COPPER), cf.Strands(7, 1e-3, COPPER)], "layer 2: strands: count: at most 6 of 1 mm fit"),
        ([cf.Strands(1, 1e-3, COPPER), cf.Tube(SOFT, diameter=1e-3)], "layer 2: tube: diameter must be larger"),
        ([cf.Tube(SOFT)], "layer 1: tube: needs either"),
        ([cf.Braid(8, 1e-4, 2.0, COPPER)], "layer 1: braid: angle must be from 0 to below 89 deg"),
        ([cf.Tape(1e-4, SOFT, overlap=1.0)], "layer 1: tape: overlap must be"),
        ([cf.Tape(1e-4, SOFT)], "only tape"),
    ],
)
def test_faults(layers, message):
    import re

    with pytest.raises(ValueError, match=re.escape(message)):
        cf.build_up(layers)


def test_gauge():
    """Diameters of ASTM B258, as tables round them."""
    for gauge, mm in ((40, 0.0799), (36, 0.127), (34, 0.160), (30, 0.255), (22, 0.644), (16, 1.291)):
        assert awg_diameter(gauge) == pytest.approx(mm * 1e-3, rel=2e-3)
