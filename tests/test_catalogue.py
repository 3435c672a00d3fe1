"""Cables of the catalogue: found by name, with sources, on the command line too."""

import pytest

import cosserat_fem as cf
from cosserat_fem.cables.catalogue import _data, entries, listing
from cosserat_fem.cli import main

STATUS = {"measured", "data sheet", "derived", "recalled", "assumed"}


def test_every_number_has_source_and_status():
    tables = [*_data()["material"].values(), *_data()["family"], *_data()["cable"]]
    for table in tables:
        assert table["status"] in STATUS
        assert table["source"]
    for table in _data()["cable"]:
        assert table["layers_status"] in STATUS
        assert table["layers_source"]


def test_sections_of_every_cable():
    """Each can be used at both ends; sticking is stiffer in bending and twist, nothing else changes."""
    for name, entry in entries().items():
        slip, stick = (cf.catalogue_section(name, end) for end in ("slip", "stick"))
        assert slip.radius == stick.radius == entry.cable.diameter / 2
        assert slip.force_stiffness == stick.force_stiffness
        assert slip.mass_per_length == stick.mass_per_length > 0
        assert all(a < b for a, b in zip(slip.moment_stiffness, stick.moment_stiffness, strict=True))


def test_data_sheet_values_are_kept():
    cable = cf.cable_named("M22759/16-22")
    assert (cable.diameter, cable.mass_per_length) == pytest.approx((1.32e-3, 5.5e-3))


def test_unknown_names():
    with pytest.raises(ValueError, match="Did you mean 'M22759/16-22'"):
        cf.cable_named("M22759/16_22")
    with pytest.raises(ValueError, match="material 'coper' is unknown. Did you mean 'copper'"):
        cf.material("coper")
    with pytest.raises(ValueError, match="strands: must be 'slip' or 'stick' \\(got 'band'\\)"):
        cf.catalogue_section("RG-178", "band")


def test_listing(capsys):
    """All; some; one with layers, sources and status of each number; none, with the nearest name."""
    assert main(["cables"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(entries()) + 1
    assert main(["cables", "m22759/33"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert main(["cables", "silicone AWG 30"]) == 0
    said = capsys.readouterr().out
    for text in ("9.0e-06 to 4.0e-05 N m^2", "2.8e-06 to 4.2e-05 N m^2", "measured", "(recalled)", "count 8"):
        assert text in said
    assert main(["cables", "RG-187"]) == 2
    assert "Did you mean 'RG-178'" in capsys.readouterr().err
    assert listing("nothing like it") == ""
