"""Random faults in scenes and meshes: refused with a reason or solved right, never a traceback, a hang or a silent lie."""

import shutil

import fuzz
import numpy as np
import pytest

NAMES = list(fuzz.SCENES)
SCENES, MESHES = 1500, 600  # of the long run


def complaints(folder, scenes, meshes, seed):
    """Complaints by case, of so many mutated scenes and meshes."""
    bases, found = {}, {}
    for name, text in [*fuzz.SCENES.items(), ("mesh", fuzz.MESH_SCENE)]:
        (folder / "table.stl").write_bytes(fuzz.stl_bytes(fuzz.TABLE))
        path = folder / f"{name}.toml"
        path.write_text(text)
        bases[name] = fuzz.Base(path)
        shutil.rmtree(folder / "first", ignore_errors=True)
        fuzz.run(path, folder / "first", limit=600, stop=600)  # kernels are compiled
        said = fuzz.judge(path, folder / "out", bases[name])
        assert said == [], f"{name} itself: {said}"
    for k in range(scenes):
        rng = np.random.default_rng([seed, k])
        name = NAMES[k % len(NAMES)]
        path = folder / f"{name}.toml"
        path.write_bytes(fuzz.mutate(fuzz.SCENES[name], rng))
        said = fuzz.judge(path, folder / "out", bases[name])
        if said:
            found[f"scene {name} {k}"] = said, path.read_bytes()
    path = folder / "mesh.toml"
    for k in range(meshes):
        rng = np.random.default_rng([seed, 10_000 + k])
        data = fuzz.mutate_stl(rng)
        (folder / "table.stl").write_bytes(data)
        said = fuzz.judge(path, folder / "out", bases["mesh"])
        if said:
            found[f"mesh {k}"] = said, data
    return found


def report(found):
    return "\n".join(f"{case}: {said}" for case, (said, _) in found.items())


def test_some(tmp_path):
    found = complaints(tmp_path, scenes=40, meshes=12, seed=1)
    assert not found, report(found)


@pytest.mark.slow
def test_many(tmp_path):
    found = complaints(tmp_path, SCENES, MESHES, seed=2)
    assert not found, report(found)
