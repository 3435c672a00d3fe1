"""The reference of scene files holds every key, with its default, and its examples run."""

import pathlib
import re

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.scene import tables

TEXT = (pathlib.Path(__file__).parents[2] / "docs" / "scenes.md").read_text(encoding="utf-8")
CHAPTERS = {
    "Top level": tables.SceneTables,
    'Section `kind = "round"`': tables.RoundSection,
    'Section `kind = "rectangle"`': tables.RectangleSection,
    'Section `kind = "general"`': tables.GeneralSection,
    'Section `kind = "built"`': tables.BuiltSection,
    'Layer `kind = "strands"`': tables.StrandsTable,
    'Layer `kind = "cables"`': tables.CablesTable,
    'Layer `kind = "tube"`': tables.TubeTable,
    'Layer `kind = "braid"`': tables.BraidTable,
    'Layer `kind = "tape"`': tables.TapeTable,
    "Rod": tables.RodTable,
    "Part": tables.PartTable,
    'Shape `kind = "plane"`': tables.PlaneTable,
    'Shape `kind = "sphere"`': tables.SphereTable,
    'Shape `kind = "cylinder"`': tables.CylinderTable,
    'Shape `kind = "capsule"`': tables.CapsuleTable,
    'Shape `kind = "box"`': tables.BoxTable,
    'Shape `kind = "torus"`': tables.TorusTable,
    'Motion `kind = "hinge"`': tables.HingeTable,
    'Motion `kind = "slider"`': tables.SliderTable,
    'Motion `kind = "path"`': tables.PathTable,
    'Support `kind = "clamp"`': tables.ClampTable,
    'Support `kind = "pin"`': tables.PinTable,
    'Support `kind = "weld"`': tables.WeldTable,
    "Gravity": tables.GravityTable,
    'Load `kind = "point"`': tables.PointLoadTable,
    'Load `kind = "line"`': tables.LineLoadTable,
    "Damping": tables.DampingTable,
    "Drag": tables.DragTable,
    "Electrostatic": tables.ElectrostaticTable,
    'Contact `kind = "part"`': tables.PartContactTable,
    'Contact `kind = "rods"`': tables.RodContactTable,
    "Checks": tables.ChecksTable,
    "Check `bend_radius`": tables.BendRadiusTable,
    "Check `tension` or `compression`": tables.RodForceTable,
    "Check `strain`": tables.StrainTable,
    "Check `twist`": tables.TwistTable,
    "Check `reaction_force`": tables.ReactionForceTable,
    "Check `reaction_moment`": tables.ReactionMomentTable,
    "Check `hinge_torque`": tables.HingeTorqueTable,
    "Check `clearance`": tables.ClearanceTable,
    "Start velocity": tables.VelocityTable,
    "Drive": tables.DriveTable,
    "Line of a drive": tables.DriveLineTable,
    "Solve": tables.SolveTable,
    "Output": tables.OutputTable,
    "Sweep": tables.SweepTable,
    "Varied values": tables.VaryTable,
    "Design": tables.DesignTable,
    "Chosen values": tables.VariableTable,
    "Limits": tables.LimitTable,
}


def chapter(title):
    """Rows of the table below a heading: key -> cells."""
    text = re.split(r"^#+ ", TEXT.split(f"# {title}\n", 1)[1], maxsplit=1, flags=re.M)[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| `")
    ]
    return {row[0].strip("`"): row for row in rows}


def test_every_table_has_a_chapter():
    every = {t for t in vars(tables).values() if isinstance(t, type) and issubclass(t, tables.Table)}
    assert set(CHAPTERS.values()) == every - {tables.Table}


@pytest.mark.parametrize("title", CHAPTERS)
def test_every_key_is_explained(title):
    """The keys of a table, no more and no less; a dash where the key must be given; numbers and flags as they are."""
    fields, rows = CHAPTERS[title].model_fields, chapter(title)
    assert list(rows) == list(fields)
    for key, field in fields.items():
        default = rows[key][1] if title == "Top level" else rows[key][2]
        assert (default == "-") == field.is_required(), key
        if isinstance(field.default, bool):
            assert default == str(field.default).lower()
        elif isinstance(field.default, int | float) and "unit" not in key:
            assert float(np.divide(*map(float, (default + "/1").split("/")[:2]))) == pytest.approx(field.default)
        elif isinstance(field.default, str) and field.default:
            assert default == f'`"{field.default}"`'


def test_examples_are_one_scene_that_runs(tmp_path):
    (tmp_path / "motion.csv").write_text("qx,qy,qz,qw,time,x,y,z\n0,0,0,1,0,0,0,0\n0,0,0,1,2,0,0,0.001\n")
    text = "\n".join(re.findall(r"^```toml\n(.*?)^```", TEXT, re.M | re.S))
    (tmp_path / "scene.toml").write_text(text)
    scene = cf.load_scene(tmp_path / "scene.toml")
    history = cf.solve_quasistatic(scene.model, scene.times)
    assert history.status == "converged"
    assert max(record.residual for record in history.records) < 1e-8
    for table in ("section", "rod", "part", "support", "gravity", "load", "contact", "checks", "solve", "output"):
        assert scene.source.data[table]
    [guide] = [h for h in scene.model.supports if h.name == "guide"]
    np.testing.assert_allclose(guide.frame[:, 0], np.sqrt([0.5, 0.5, 0]))  # a row of the file is an axis
