"""A run in time that is stopped, killed or out of disk goes on from its last checkpoint, bit for bit."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from cosserat_fem.cli import main
from cosserat_fem.errors import SceneError
from cosserat_fem.export import read_history
from cosserat_fem.frames import CHECKPOINT, FRAMES, FrameFile, read_checkpoint, read_frames
from cosserat_fem.run import rebuild, resume_scene, run_scene
from cosserat_fem.scene import load_scene

SCENE = """
[[section]]
name = "hose"
kind = "round"
diameter = "10 mm"
youngs_modulus = "5 MPa"
density = "1100 kg/m^3"

[[rod]]
name = "hose"
section = "hose"
points = [[0, 0, 0], [0.5, 0, 0]]
n_elements = 6

[[support]]
kind = "pin"
name = "hook"
rod = "hose"
at = "start"

[gravity]
acceleration = [0, 0, -9.81]

[[damping]]
time = "1 ms"
mass = 0.1

[solve]
kind = "dynamic"
duration = "0.5 s"
start = "drawn"
{step}

[output]
every = "10 ms"
"""
STEPS = {"fixed": "dt = 1e-3", "adaptive": "rtol = 1e-2"}


@pytest.fixture(params=STEPS)
def scene(request, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.replace("{step}", STEPS[request.param]))
    return file


def content(folder):
    """Everything that a run finds, as it was written."""
    with_time = (folder / "history.vtkhdf").read_bytes()
    return {name: (folder / name).read_bytes() for name in ("reactions.csv", "ledger.csv", "steps.csv")} | {
        "history": with_time
    }


def stop_after(n):
    return lambda done, total: done >= n


def test_stopped_run_goes_on_bit_for_bit(scene, tmp_path):
    whole = run_scene(load_scene(scene), tmp_path / "whole")
    assert whole.reason == ""
    assert not (tmp_path / "whole" / FRAMES).exists()
    for n in (1, 20, 45):
        out = tmp_path / f"part{n}"
        part = run_scene(load_scene(scene), out, progress=stop_after(n))
        assert "`cosserat-fem resume" in part.reason
        assert len(part.history) == n
        outcome = resume_scene(out, progress=stop_after(47))
        assert outcome.reason
        rest = resume_scene(out)
        assert rest.reason == ""
        assert content(out) == content(tmp_path / "whole")
        summaries = [json.loads((f / "summary.json").read_text()) for f in (out, tmp_path / "whole")]
        assert summaries[0]["in_time"] == summaries[1]["in_time"]
        assert summaries[0]["counters"]["iterations"] == summaries[1]["counters"]["iterations"]


def test_changed_scene_is_not_resumed(scene, tmp_path, capsys):
    out = tmp_path / "out"
    run_scene(load_scene(scene), out, progress=stop_after(5))
    file = out / "scene.toml"
    file.write_text(file.read_text().replace("0.01", "0.011", 1))
    assert main(["resume", str(out)]) == 2
    assert "was changed since the run began" in capsys.readouterr().err


@pytest.mark.parametrize("scene", ["fixed"], indirect=True)
def test_nothing_to_resume(scene, tmp_path, capsys):
    assert main(["resume", str(tmp_path / "nowhere")]) == 2
    assert "is not the folder of a run" in capsys.readouterr().err
    run_scene(load_scene(scene), tmp_path / "done")
    assert main(["resume", str(tmp_path / "done")]) == 2
    assert "has no checkpoint to go on from" in capsys.readouterr().err


@pytest.mark.parametrize("scene", ["fixed"], indirect=True)
def test_damaged_files_are_told(scene, tmp_path):
    out = tmp_path / "out"
    run_scene(load_scene(scene), out, progress=stop_after(5))
    kept = len(read_frames(out / FRAMES)[1])
    data = (out / FRAMES).read_bytes()
    (out / FRAMES).write_bytes(data[:-10])
    assert len(read_frames(out / FRAMES)[1]) == kept - 1
    with pytest.raises(SceneError, match=r"holds 4 states, but the checkpoint counts on 5"):
        FrameFile(out / FRAMES, "", 5)
    damaged = bytearray(data)
    damaged[-20] ^= 1
    (out / FRAMES).write_bytes(damaged)
    assert len(read_frames(out / FRAMES)[1]) == kept - 1
    saved = (out / CHECKPOINT).read_bytes()
    (out / CHECKPOINT).write_bytes(saved[:-1])
    with pytest.raises(SceneError, match="is not a whole checkpoint"):
        read_checkpoint(out / CHECKPOINT)


RUN = """
import sys
import cosserat_fem.solving
from cosserat_fem.cli import main
cosserat_fem.solving.SAVE_EVERY = 0.02
sys.exit(main(sys.argv[1:]))
"""


def start(*arguments, limit=None):
    def limits():
        if limit is not None:
            import resource

            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.Popen(
        [sys.executable, "-c", RUN, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=limits,
    )  # fmt: skip


def kill_and_resume(scene, whole, out, rng):
    """Kill the run, and its resumptions, at random instants; the end must be that of the whole run."""
    arguments = ["run", scene, "-o", out, "--no-pictures", "-q"]
    kills = 0
    while True:
        process = start(*arguments)
        limit = time.monotonic() + 60
        while not (out / CHECKPOINT).exists() and process.poll() is None and time.monotonic() < limit:
            time.sleep(0.005)
        time.sleep(rng.uniform(0, 0.5))
        if kills < 3 and process.poll() is None:
            process.kill()
            process.communicate()
            kills += 1
            assert read_checkpoint(out / CHECKPOINT)  # always whole
            read_frames(out / FRAMES)
        else:
            output = process.communicate(timeout=120)
            assert process.returncode == 0, output
            assert content(out) == whole
            return kills
        arguments = ["resume", out, "--no-pictures", "-q"]


@pytest.fixture(scope="module")
def slow_scene(tmp_path_factory):
    """A scene that takes seconds, and what a whole run of it finds."""
    folder = tmp_path_factory.mktemp("slow")
    file = folder / "scene.toml"
    file.write_text(SCENE.replace("{step}", "dt = 2e-4").replace('"0.5 s"', '"0.6 s"'))
    out = folder / "whole"
    assert main(["run", str(file), "-o", str(out), "--no-pictures", "-q"]) == 0
    return file, content(out)


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_killed_run_goes_on(slow_scene, tmp_path):
    file, whole = slow_scene
    assert kill_and_resume(file, whole, tmp_path / "out", np.random.default_rng(0)) > 0


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_fifty_kills(slow_scene, tmp_path):
    file, whole = slow_scene
    rng, kills, k = np.random.default_rng(1), 0, 0
    while kills < 50:
        kills += kill_and_resume(file, whole, tmp_path / f"out{k}", rng)
        k += 1


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_killed_run_can_be_exported(slow_scene, tmp_path):
    file, _ = slow_scene
    out = tmp_path / "out"
    process = start("run", file, "-o", out, "--no-pictures", "-q")
    while not (out / CHECKPOINT).exists() and process.poll() is None:
        time.sleep(0.005)
    time.sleep(0.2)
    process.kill()
    process.communicate()
    if (out / FRAMES).exists():
        kept = len(rebuild(out))
        assert len(read_history(out / "history.vtkhdf").t) == kept > 0
        assert main(["export", str(out)]) == 0


@pytest.mark.skipif(os.name != "posix", reason="needs file size limits")
@pytest.mark.parametrize("limit", [20_000, pytest.param(60_000, marks=pytest.mark.slow)])
def test_full_disk_stops_with_one_line(slow_scene, tmp_path, limit):
    """A disk that takes no file beyond a size: the run stops, says so, and what is there can be read and resumed."""
    file, whole = slow_scene
    out = tmp_path / "out"
    process = start("run", file, "-o", out, "--no-pictures", limit=limit)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1, errors
    assert "Traceback" not in errors
    assert "could not be" in errors
    assert json.loads((out / "summary.json").read_text())["status"] == "stopped"
    if (out / CHECKPOINT).exists():
        read_checkpoint(out / CHECKPOINT)
        assert main(["resume", str(out), "--no-pictures", "-q"]) == 0
        assert content(out) == whole


def test_interrupt_leaves_a_resumable_run(slow_scene, tmp_path):
    file, whole = slow_scene
    out = tmp_path / "out"
    process = start("run", file, "-o", out, "--no-pictures")
    while not (out / CHECKPOINT).exists() and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    if process.returncode == 1:  # else it was faster
        assert "goes on" in errors
        assert main(["resume", str(out), "--no-pictures", "-q"]) == 0
    assert content(out) == whole


def test_tiny_full_file_system(slow_scene, tmp_path):
    """A real file system of 120 kB: one line, exit 1; with more room the run goes on to the same end."""
    file, whole = slow_scene
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=120k", "tmpfs", str(disk)]
    if os.name != "posix" or os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("cannot mount a file system here")
    try:
        process = start("run", file, "-o", disk / "out", "--no-pictures")
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 1, errors
        assert "Traceback" not in errors
        assert "No space left on device" in errors
        read_checkpoint(disk / "out" / CHECKPOINT)
        read_frames(disk / "out" / FRAMES)
        subprocess.run(["mount", "-o", "remount,size=20m", str(disk)], check=True)
        assert main(["resume", str(disk / "out"), "--no-pictures", "-q"]) == 0
        assert content(disk / "out") == whole
    finally:
        subprocess.run(["umount", str(disk)], check=False)


def same(a, b):
    """Two values of what contact says or remembers are equal, bit for bit."""
    for name, value in vars(a).items():
        if isinstance(value, np.ndarray):
            other = getattr(b, name)
            assert value.shape == other.shape and value.dtype == other.dtype
            np.testing.assert_array_equal(value, other)
        else:
            assert value == getattr(b, name), name


def test_records_with_contact_come_back(tmp_path):
    """What contact terms do at a state survives the file of frames, empty arrays and infinite gaps too."""
    from dataclasses import replace

    import cosserat_fem as cf
    from cosserat_fem.record import Record
    from cosserat_fem.terms.inertial import Rates

    section = cf.Section.round(0.004, youngs_modulus=50e6)
    rod = cf.Rod("bar", section, [(0, 0, 0), (0.2, 0, 0)], n_elements=4)
    post = cf.Part(
        "post", shape=cf.Cylinder((0.1, 0.012, -1), (0.1, 0.012, 1), 0.008), motion=cf.Slider((0, -1, 0), 0.01)
    )
    far = cf.Part("far", shape=cf.Sphere((9, 0, 0), 1))
    model = cf.Model(
        [rod], [cf.Clamp(rod, "start"), cf.Clamp(rod, "end")], [cf.PartContact(rod, part, 0.1) for part in (post, far)]
    )
    history = cf.solve_quasistatic(model, [0.0, 1.0])
    rates = Rates(*np.zeros((3, model.space.n_nodes, 6)))
    records = [replace(record, rates=rates, work={"a": 1.0}) for record in history.records]
    file = FrameFile(tmp_path / FRAMES, "x")
    for record in records:
        file.append(record)
    file.append(Record(history.final, records[0].reactions, 1, 0.0, -1, rates, {}))
    file.close()
    _, back = read_frames(tmp_path / FRAMES)
    assert back[2].contact == ()
    assert len(records[1].contact[0].spans) == 1
    for record, again in zip(records, back, strict=False):
        for told, told_again in zip(record.contact, again.contact, strict=True):
            same(told, told_again)


def test_memory_of_contact_is_in_the_checkpoint(tmp_path):
    """Slips, scales and works by term, in the order of the model."""
    import cosserat_fem as cf
    from cosserat_fem.frames import with_terms, write_checkpoint
    from cosserat_fem.motion.integrator import Checkpoint
    from cosserat_fem.space import Contact, Touch
    from cosserat_fem.terms.inertial import Rates

    section = cf.Section.round(0.004, youngs_modulus=50e6)
    rod = cf.Rod("bar", section, [(0, 0, 0), (0.2, 0, 0)], n_elements=4)
    parts = [cf.Part(name, shape=cf.Sphere((0.1, 1, 0), 0.1)) for name in "ab"]
    model = cf.Model([rod], [], [cf.PartContact(rod, part) for part in parts])
    state = model.initial_state(0.5)
    n = model.space.n_nodes
    touch = {
        model.contacts[0]: Touch(np.array([3, 7]), np.arange(6.0).reshape(2, 3), np.array([4.0, 5.0]), 0.1, 2.5),
        model.contacts[1]: Touch.of_nothing(7.0),
    }
    state = cf.State(0.5, state.r, state.q, state.stress, contact=Contact(0.4, 0.3, state.r + 1, state.q, touch))
    rates = Rates(*np.zeros((3, n, 6)))
    saved = Checkpoint(state, rates, 0.1, 0.2, {}, [], np.zeros((n, 6)), (), (), 0.0, 3)
    write_checkpoint(tmp_path / CHECKPOINT, "x", saved, {})
    back = with_terms(read_checkpoint(tmp_path / CHECKPOINT)[1], model).state.contact
    assert (back.time, back.base_time) == (0.4, 0.3)
    np.testing.assert_array_equal(back.base_r, state.r + 1)
    np.testing.assert_array_equal(back.base_q, state.q)
    assert list(back.touch) == list(model.contacts)
    for term in model.contacts:
        same(touch[term], back.touch[term])


def test_checkpoint_of_another_version(tmp_path):
    """One that has not all that is remembered now is refused in words."""
    import zlib

    import cosserat_fem as cf
    from cosserat_fem.frames import HEAD, pack

    data = pack({"lists": {"stress": 1}}, {"r": np.zeros((2, 3))})
    (tmp_path / CHECKPOINT).write_bytes(HEAD.pack(len(data), zlib.crc32(data)) + data)
    with pytest.raises(cf.SceneError, match="another version of cosserat_fem .it has no 'stress_0'.; start again"):
        read_checkpoint(tmp_path / CHECKPOINT)
