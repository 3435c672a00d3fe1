"""Random faults in scenes and meshes: refused with a reason or solved right, never a traceback, a hang or a silent lie."""

import functools
import time

import fuzz
import numpy as np
import pytest

import mutations
from cosserat_fem import cli, scene
from cosserat_fem.history import History
from cosserat_fem.scene import build, load, tables
from cosserat_fem.section import Section
from cosserat_fem.surface import Surface
from cosserat_fem.terms import Gravity

NAMES = list(mutations.SCENES)
BASES = {**mutations.SCENES, "mesh": mutations.MESH_SCENE}
SCENES, MESHES = 1500, 600  # of the long run


@pytest.fixture(scope="module")
def fuzz_folder(tmp_path_factory):
    """Folder with the base scenes, which were run once, so that kernels are compiled."""
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "table.stl").write_bytes(mutations.stl_bytes(mutations.TABLE))
    for name, text in BASES.items():
        (folder / f"{name}.toml").write_text(text)
        assert fuzz.run(folder / f"{name}.toml", folder / f"first_{name}", limit=900, stop=900).code == 0
    return folder


def complaints(folder, scenes, meshes, seed):
    """Complaints by case, of so many mutated scenes and meshes."""
    bases, found = {}, {}
    mesh = folder / "table.stl"
    mesh.write_bytes(mutations.stl_bytes(mutations.TABLE))
    for name, text in BASES.items():
        path = folder / f"{name}.toml"
        path.write_text(text)
        bases[name] = fuzz.Base(path)
        said = fuzz.judge(path, folder / "out", bases[name])
        assert said == [], f"{name} itself: {said}"
    for k in range(scenes):
        name = NAMES[k % len(NAMES)]
        path = folder / f"{name}.toml"
        path.write_bytes(mutations.mutate(mutations.SCENES[name], np.random.default_rng([seed, k])))
        said = fuzz.judge(path, folder / "out", bases[name])
        if said:
            found[f"scene {name} {k}"] = said
    for k in range(meshes):
        data = mutations.mutate_stl(np.random.default_rng([seed, 10_000 + k]))
        mesh.write_bytes(data)
        said = fuzz.judge(folder / "mesh.toml", folder / "out", bases["mesh"], mesh=data)
        if said:
            found[f"mesh {k}"] = said
    return found


def report(found):
    return "\n".join(f"{case}: {said}" for case, said in found.items())


def test_some(fuzz_folder):
    found = complaints(fuzz_folder, scenes=40, meshes=12, seed=1)
    assert not found, report(found)


@pytest.mark.slow
def test_many(fuzz_folder):
    found = complaints(fuzz_folder, SCENES, MESHES, seed=2)
    assert not found, report(found)


# planted faults: (fault in the program, base scene, change in its text that brings it out, what the judge must say)


def without(name, **fixed):
    """The class `build` knows by this name, with some keywords taken away or fixed whatever the scene says."""

    def plant(patch):
        make = getattr(build, name)

        def lossy(*args, **options):
            return make(*args, **{k: v for k, v in options.items() if k not in fixed} | drop_none(fixed))

        patch.setattr(build, name, lossy)

    return plant


def drop_none(options):
    return {k: v for k, v in options.items() if v is not None}


def replaced(owner, name, value):
    return lambda patch: patch.setattr(owner, name, value)


def unknown_keys_pass(patch):
    """Keys that no table has are dropped before the check."""
    check = load.SceneTables.model_validate

    def lenient(data):
        known = {key for t in vars(tables).values() if hasattr(t, "model_fields") for key in t.model_fields}
        return check({k: [{a: b for a, b in e.items() if a in known} for e in v] if isinstance(v, list) else v
                      for k, v in data.items()})  # fmt: skip

    patch.setattr(load, "SceneTables", type("Lenient", (), {"model_validate": staticmethod(lenient)}))


def no_weight(patch):
    patch.setattr(build, "Gravity", lambda acceleration: Gravity((0, 0, -9.81)))


def half_weight(patch):
    loads = Gravity._loads

    def half(self, space):
        found = loads(self, space)
        return type(found)(found.nodes, 0.5 * found.force, found.moment, found.kinds)

    patch.setattr(Gravity, "_loads", half)


def light_section(patch):
    make = Section.round.__func__
    fixed = classmethod(lambda cls, *args, **options: make(cls, *args, **{**options, "density": 1200.0}))
    patch.setattr(Section, "round", fixed)


def clamp_holds_all(patch):
    patch.setattr(
        build, "Clamp", lambda rod, at, part, free, frame, name, make=build.Clamp: make(rod, at, part, (), frame, name)
    )


def slow_hinge(patch):
    make = build.Hinge
    patch.setattr(build, "Hinge", lambda point, axis, angle, smooth: make(point, axis, 0.17, smooth))


def half_reactions(patch):
    told = History.reaction
    patch.setattr(History, "reaction", lambda self, support: 0.5 * told(self, support))


def no_reactions(patch):
    told = History.reaction
    patch.setattr(History, "reaction", lambda self, support: np.nan * told(self, support))


def same_times(patch):
    patch.setattr(scene, "_times", lambda source, tables: np.array([0.0, 1.0]))


def same_damping(patch):
    make = build.Damping
    patch.setattr(build, "Damping", lambda *args: make((0.0,) * 6, 2e-3, 0.3, None))


def same_box(patch):
    make = build.SHAPES["box"]
    patch.setitem(build.SHAPES, "box", lambda center, edges, **rest: make(center, (0.2, 0.2, 0.04), **rest))


def same_surface(patch):
    """Every mesh is taken for the first one that was read."""
    kept, read = [], build.Part.surface

    def first(self):
        if self.mesh is None:
            return read(self)
        kept[:] = kept or [read(self)]
        return kept[0]

    patch.setattr(build.Part, "surface", first)
    patch.setattr(Surface, "__eq__", object.__eq__)


def crash(*_):
    raise KeyError("rod")


def hang(*_):
    while time.process_time() < np.inf:
        pass


def stops_well(patch):
    finish = cli._finish
    patch.setattr(cli, "_finish", lambda *args, **options: finish(*args, **options) * 0)


def open_ledger(patch):
    patch.setattr(History, "ledger_gap", property(lambda self: 0.4))
    patch.setattr(History, "check_ledger", lambda self: None)


SAME = "changed nothing that is built"
FAULTS = {
    "unknown keys pass": (unknown_keys_pass, "hinge", ("density =", "densty ="), "densty is taken and ignored"),
    "weight of another planet": (no_weight, "hinge", ("-9.81", "-1.62"), SAME),
    "half the weight": (half_weight, "hinge", ("2 s", "3 s"), "supports and contact leave"),
    "density is fixed": (light_section, "hinge", ("1200 kg", "2400 kg"), SAME),
    "force of a point load is lost": (without("PointLoad", force=None), "static", ('"-0.3 N"', '"-0.4 N"'), SAME),
    "moment of a point load is lost": (without("PointLoad", moment=None), "static", ("0.02", "0.03"), SAME),
    "profile of a line load is lost": (without("LineLoad", profile=None), "static", ("0, 1, 0.5", "0, 1, 0.7"), SAME),
    "rest shape is lost": (without("Rod", rest=None), "static", ("0.2, -0.1", "0.3, -0.1"), SAME),
    "normal is lost": (without("Rod", normal=None), "static", ("normal = [0, 0, 1]", "normal = [0, 1, 1]"), SAME),
    "length is lost": (without("Rod", length=None), "hinge", ("230 mm", "240 mm"), SAME),
    "elements are fixed": (without("Rod", n_elements=4), "hinge", ("n_elements = 4", "n_elements = 5"), SAME),
    "released components are held": (clamp_holds_all, "hinge", ('"ry", "rz"', '"rz"'), SAME),
    "hinge has its own rate": (slow_hinge, "hinge", ("10 deg/s", "11 deg/s"), SAME),
    "stations are fixed": (same_times, "hinge", ('duration = "2 s"', 'duration = "1 s"'), SAME),
    "drag is half lost": (without("Drag", normal_quadratic=None), "swing", ("0.1\n", "0.2\n"), SAME),
    "charges are fixed": (without("Electrostatic", charge=1e-7), "swing", ("= 1e-7", "= 3e-7"), SAME),
    "damping is fixed": (same_damping, "swing", ("mass = 0.3", "mass = 0.4"), SAME),
    "friction is lost": (without("PartContact", friction=None), "contact", ("friction = 0.2", "friction = 0.3"), SAME),
    "box has its own size": (same_box, "contact", ("0.2, 0.2, 0.04", "0.2, 0.3, 0.04"), SAME),
    "another mesh is taken": (same_surface, "mesh", None, "another mesh makes the same surface"),
    "reactions are halved": (half_reactions, "hinge", ("2 s", "3 s"), "supports and contact leave"),
    "reactions are no numbers": (no_reactions, "hinge", ("2 s", "3 s"), "is nan"),
    "ledger is open and nobody says so": (open_ledger, "swing", ("20 ms", "30 ms"), "the ledger is open"),
    "a stop is told as success": (stops_well, "static", ('"-0.3 N"', '"-3e6 N"'), "exit code 0, but status stopped"),
    "a crash": (replaced(build.Builder, "_drag", crash), "swing", ("20 ms", "30 ms"), "KeyError"),
    "a hang": (replaced(build.Builder, "_load", hang), "static", ("0.02", "0.03"), "still running"),
    "a refusal without a place": (
        replaced(load.Source, "fault", lambda *_: "wrong"), "static", ("0.02", '"0.02 kg"'), "without file and reason",
    ),
}  # fmt: skip
LOUD = ("a crash", "a hang")


def judged(folder, name, original=None, limit=60.0):
    """What the judge says of the changed scene; `original` is made by the program as it is now, unless given."""
    _, base, change, complaint = FAULTS[name]
    text, path, mesh, other = BASES[base], folder / f"{base}.toml", folder / "table.stl", None
    path.write_text(text)
    mesh.write_bytes(mutations.stl_bytes(mutations.TABLE))
    original = original or fuzz.Base(path)
    if change is None:
        other = mutations.stl_bytes(mutations.TABLE * [1, 1.1, 1])
        mesh.write_bytes(other)
    else:
        assert change[0] in text
        path.write_text(text.replace(change[0], change[1], 1))
    if complaint == SAME:
        return original.unchanged(path)  # this part of the judge needs no run
    return fuzz.judge(path, folder / "out", original, limit=limit, mesh=other)


@pytest.fixture(scope="module")
def sound(fuzz_folder):
    """What the judge says without a fault; faults that come out by the same change share one run."""
    return functools.cache(lambda base, change, same: judged(fuzz_folder, NAMED[base, change, same]))


NAMED = {(base, change, complaint == SAME): name for name, (_, base, change, complaint) in FAULTS.items()}


@pytest.mark.parametrize("name", FAULTS)
def test_planted_fault_is_caught(name, fuzz_folder, sound, monkeypatch):
    """The judge has nothing against a changed scene, and complains about it once the program has a fault."""
    plant, base, change, complaint = FAULTS[name]
    assert sound(base, change, complaint == SAME) == []
    original = None  # a program with this fault builds it
    if name in LOUD:
        (fuzz_folder / "original.toml").write_text(BASES[base])
        original = fuzz.Base(fuzz_folder / "original.toml")
    plant(monkeypatch)
    said = judged(fuzz_folder, name, original, limit=0.5 if name == "a hang" else 60.0)
    assert said
    assert complaint in said[0]
