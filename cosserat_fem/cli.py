"""Which command did the user type? Arguments and exit codes.

Rule: work is done below, and what is said of it in `telling`. Nothing heavy is imported until a command needs it, so that
`--help` answers at once.

Exit codes: 0 fine; 1 stopped early (partial results are written, the reason is in summary.json); 2 the scene, a file or
an argument is wrong; 3 a check or the margin of a drive is violated, or not known; no design keeps its limits.
"""

from __future__ import annotations

import json
import logging
import pathlib
import shutil
import time
from collections.abc import Callable
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from .telling import (
    Progress,
    report_warnings,
    say,
    say_wrong,
    tell_apart,
    tell_checks,
    tell_drives,
    tell_faults,
    tell_results,
)

app = App(
    name="cosserat-fem",
    help="Cables that follow mechanisms: geometrically exact rods by finite elements.",
    version_flags=["--version"],
    result_action="return_value",
)

OK, STOPPED, WRONG, VIOLATED = 0, 1, 2, 3
Out = Annotated[pathlib.Path | None, Parameter(name=["--out", "-o"])]


def main(arguments: list[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    report_warnings()
    try:
        result = app(arguments, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        say_wrong(f"{error}\nSee `cosserat-fem --help`.")
        return WRONG
    except KeyboardInterrupt:
        say_wrong("interrupted")
        return STOPPED
    except BrokenPipeError:  # the reader of our output went away
        return OK
    except MemoryError as error:
        from .errors import out_of_memory

        say_wrong(out_of_memory(error))
        return STOPPED
    except OSError as error:
        say_wrong(f"{error.filename or 'input or output'}: {error.strerror or error}.")
        return STOPPED
    return result if isinstance(result, int) else OK


def _load(scene: pathlib.Path | None) -> Any:
    """A checked scene, or None after its faults were told."""
    from .errors import SceneError
    from .scene import load_scene

    try:
        return load_scene(scene)
    except SceneError as error:
        tell_faults(error.faults)
        return None


@app.command
def run(
    scene: pathlib.Path | None = None,
    *,
    out: Out = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    pictures: bool = True,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Run a scene and write its results; without a scene, the satellite hinge deployment that comes along.

    Parameters
    ----------
    scene
        Scene file (TOML). `cosserat-fem init` copies one to start from.
    out
        Folder for the results; default is the scene's own, or out/<name of the scene>.
    force
        Write into a folder that holds other files too; they are left alone. Files of an earlier run are replaced.
    pictures
        Make plots and pictures when the results are safe.
    quiet
        Print nothing but faults.
    """
    from .errors import SceneError
    from .folder import RunFolder
    from .results import Phases
    from .run import run_scene

    tell = (lambda text="": None) if quiet else say
    phases = Phases()
    with phases.measure("load"):
        loaded = _load(scene)
    if loaded is None:
        return WRONG
    tell(loaded.title)
    try:
        with RunFolder(loaded.folder if out is None else out, loaded.inputs, force=force) as folder:
            with Progress(loaded.stations, quiet) as progress:
                outcome = run_scene(loaded, folder, progress=progress, announce=tell, phases=phases)
            return _finish(
                outcome, tell, pictures=pictures and loaded.tables.output.pictures, skip=progress.interrupted
            )
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG


@app.command
def resume(
    folder: pathlib.Path,
    *,
    pictures: bool = True,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Go on with a run in time that was stopped or killed, from its last checkpoint.

    Parameters
    ----------
    folder
        Folder of the run.
    pictures
        Make plots and pictures when the results are safe.
    quiet
        Print nothing but faults.
    """
    from .errors import SceneError
    from .run import resume_scene

    tell = (lambda text="": None) if quiet else say
    try:
        with Progress(0, quiet) as progress:
            outcome = resume_scene(folder, progress=progress, announce=tell)
        return _finish(outcome, tell, pictures=pictures, skip=progress.interrupted)
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG


def _finish(outcome: Any, tell: Callable[[str], None], *, pictures: bool, skip: bool) -> int:
    """Say what a run found and where it is; then the pictures. Exit code."""
    both = outcome.sticking is not None
    for which, run in (("slipping", outcome), ("sticking", outcome.sticking)) if both else (("", outcome),):
        if run is not None and run.history is not None:
            if which:
                tell(f"  with {which} strands:")
            tell_results(run.history, tell)
            tell_drives(run.verdicts, tell)
            tell_checks(run.checks, run.verdict, tell)
    good = STOPPED if outcome.reason else VIOLATED if outcome.violated else OK
    if outcome.complete:
        tell(f"Results in {outcome.folder}")
    elif outcome.written:
        tell(f"Incomplete results in {outcome.folder}: {', '.join(outcome.written)}")
    if outcome.reason:
        say_wrong(f"stopped: {outcome.reason}")
    if pictures and outcome.complete:
        return _draw(outcome.folder, tell, skip=skip) or good
    return good


def _draw(folder: pathlib.Path, tell: Callable[[str], None], *, skip: bool) -> int:
    """Pictures of a finished run; exit code 1 if Ctrl-C ended them."""
    from .drawing import draw

    try:
        if skip:
            raise KeyboardInterrupt
        problem = draw(folder).problem
    except KeyboardInterrupt:
        say_wrong(f"no pictures: interrupted. All results are written; `cosserat-fem render {folder}` draws them.")
        return STOPPED
    tell(f"Pictures in {folder / 'pictures'}" if not problem else f"No pictures: {problem}")
    from .report import write_report

    tell(f"Report in {write_report(folder)}")
    return OK


@app.command
def check(scene: pathlib.Path) -> int:
    """Check a scene without solving it: every fault with its line.

    Parameters
    ----------
    scene
        Scene file (TOML).
    """
    loaded = _load(scene)
    if loaded is None:
        return WRONG
    loaded.model.check_spans(loaded.times)
    model = loaded.model
    say(
        f"{scene}: fine. {len(model.rods)} rod(s), {6 * model.space.n_nodes} unknowns, {loaded.stations} station(s), "
        + (f"{len(loaded.checks)} check(s), " if loaded.checks else "")
        + f"terms: {', '.join([model.internal.name, *(term.name for term in model.terms)])}."
        + (f" Sweep: {len(loaded.cases)} case(s)." if loaded.cases else "")
        + (f" Design: {len(loaded.tables.design.vary)} value(s)." if loaded.tables.design is not None else "")
    )
    return OK


@app.command
def cables(name: str | None = None) -> int:
    """List wires and cables of the catalogue with size, mass and stiffness; of one, its layers and sources too.

    Parameters
    ----------
    name
        Name of a cable, or a part of the names of several.
    """
    from .cables.catalogue import entries, listing
    from .errors import nearest

    found = listing(name)
    if not found:
        say_wrong(f"no cable {name!r} in the catalogue. {nearest(str(name), entries())}")
        return WRONG
    say(found)
    return OK


@app.command
def compare(scene: pathlib.Path | None = None, *, tolerance: float = 0.01) -> int:
    """Run a scene as Cosserat rods, Kirchhoff rods and strings, and say which is enough. Nothing is written.

    Parameters
    ----------
    scene
        Scene file (TOML); without one, the satellite hinge deployment that comes along.
    tolerance
        Largest difference from the Cosserat rods, in parts of each peak.
    """
    from .errors import CosseratError
    from .solving import compare_scene

    loaded = _load(scene)
    if loaded is None:
        return WRONG
    if not tolerance > 0:
        say_wrong(f"tolerance must be greater than 0 (got {tolerance:g}).")
        return WRONG
    try:
        say(f"{loaded.title}\n{compare_scene(loaded, tolerance)}")
    except CosseratError as error:
        say_wrong(str(error))
        return STOPPED
    return OK


@app.command
def pair(
    scene: pathlib.Path | None = None,
    *,
    out: Out = None,
    gravity: Annotated[tuple[float, float, float] | None, Parameter(name="--gravity", negative="")] = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Run a scene with gravity and without, and compare both.

    Parameters
    ----------
    scene
        Scene file (TOML); without one, the satellite hinge deployment that comes along.
    out
        Folder for both runs and their overlay; default is out/<name of the scene>_pair.
    gravity
        Acceleration x y z [m/s^2], instead of that of the scene.
    force
        Write into folders that hold other files too; they are left alone.
    quiet
        Print nothing but faults.
    """
    from .errors import CosseratError, SceneError
    from .pair import run_pair

    tell = (lambda text="": None) if quiet else say
    loaded = _load(scene)
    if loaded is None:
        return WRONG
    tell(loaded.title)
    try:
        with Progress(loaded.stations, quiet) as progress:
            made = run_pair(loaded, out, gravity=gravity, force=force, progress=progress)
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG
    except CosseratError as error:
        say_wrong(str(error))
        return STOPPED
    for name, outcome in made.outcomes.items():
        tell(f"{name}: {outcome.folder}")
        if outcome.reason:
            say_wrong(f"{name}: stopped: {outcome.reason}")
    tell_apart(made.apart, *made.outcomes, tell=tell)
    return STOPPED if any(outcome.reason for outcome in made.outcomes.values()) else OK


@app.command
def overlay(a: pathlib.Path, b: pathlib.Path, *, out: Out = None) -> int:
    """Compare two runs, or a run with a measurement: a table, and their curves in one figure.

    Parameters
    ----------
    a
        Folder of a run.
    b
        Folder of another run, or a CSV file with a header: time or angle_deg, and curves such as torque, "torque of PART",
        "force of SUPPORT", "Fx of SUPPORT".
    out
        Folder for overlay.csv, overlay.json and the figure; default out/overlay.
    """
    from .errors import CosseratError
    from .overlay import measured_curves, read_measured, run_curves, write_overlay

    out = out or pathlib.Path("out/overlay")
    try:
        one = run_curves(a)
        two = measured_curves(read_measured(b), one) if b.is_file() else run_curves(b)
        apart = write_overlay(one, two, out)
    except CosseratError as error:
        say_wrong(str(error))
        return WRONG
    tell_apart(apart, str(a), str(b), tell=say)
    say(f"Overlay in {out}")
    return OK


@app.command
def fit(
    scene: pathlib.Path,
    measured: pathlib.Path,
    *,
    free: Annotated[list[str] | None, Parameter(name="--free", consume_multiple=True, negative="")] = None,
    out: Out = None,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Fit stiffnesses and the stress-free curvature of a scene's cables to a measurement.

    Parameters
    ----------
    scene
        Scene file (TOML), static or quasi-static.
    measured
        CSV file with a header: time or angle_deg, and what was measured: torque, "torque of PART", "force of SUPPORT", "Fx
        of SUPPORT", ..., or points x, y, z [m] of the cable; all in SI.
    free
        What to fit: EI GJ EA "bend 1" "bend 2" twist; default EI.
    out
        Folder for fit.json, the fitted scene and the overlay; default out/<name of the scene>_fit.
    quiet
        Print nothing but faults.
    """
    from .errors import ConvergenceError, CosseratError
    from .fit import fit as fitted
    from .fit import fitted_curves, write_fit
    from .overlay import measured_curves, read_measured, write_overlay

    tell = (lambda text="": None) if quiet else say
    loaded = _load(scene)
    if loaded is None:
        return WRONG
    out = out or pathlib.Path("out") / f"{scene.stem}_fit"
    last = time.monotonic()

    def told(values: dict[str, float], left: float) -> None:
        nonlocal last
        if time.monotonic() - last > 5:
            last = time.monotonic()
            said = ", ".join(f"{name} = {value:.5g}" for name, value in values.items())
            tell(f"  {said}: {left:.3g} of the largest values left (rms)")

    try:
        found = fitted(loaded, read_measured(measured), tuple(free or ("EI",)), told=told)
        write_fit(found, out)
        if found.curves:
            run = fitted_curves(found)
            write_overlay(run, measured_curves(found.measured_values, run), out)
    except ConvergenceError as error:
        say_wrong(str(error))
        return STOPPED
    except CosseratError as error:
        say_wrong(str(error))
        return WRONG
    for number in found.numbers:
        ends = "not fixed by this measurement"
        if number.low is not None:
            ends = f"{number.low:.5g} to {number.high:.5g} with 95 % confidence"
        tell(f"  {number.name}: {number.value:.6g} {number.unit} ({ends}; the scene had {number.before:.6g})")
    for name, value in found.rms.items():
        tell(f"  {name}: {value:.4g} left (rms), {found.before[name]:.4g} before")
    tell(f"Fit in {out}: {found.runs} runs; fitted.toml is the scene with these numbers")
    return OK


@app.command
def init(folder: pathlib.Path = pathlib.Path()) -> int:
    """Copy the satellite hinge scene and its meshes out, to start from.

    Parameters
    ----------
    folder
        Where to; nothing that exists is overwritten.
    """
    from .scene import shipped_scene

    source = shipped_scene()
    files = [source, *sorted(source.parent.glob("*.stl"))]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = [file.name for file in files if (folder / file.name).exists()]
        if taken:
            say_wrong(f"{folder}: {', '.join(taken)} exists already. Choose another folder.")
            return WRONG
        for file in files:
            shutil.copy(file, folder / file.name)
    except OSError as error:
        say_wrong(f"{folder}: cannot be written: {error.strerror}.")
        return WRONG
    say(f"{folder / source.name}: run it with `cosserat-fem run {folder / source.name}`.")
    return OK


@app.command
def export(folder: pathlib.Path, *, format: str = "pvd") -> int:
    """Write a run's history for older ParaViews: a PVD collection of VTU files.

    Parameters
    ----------
    folder
        Folder of a run.
    format
        Only "pvd".
    """
    from .errors import CosseratError, nearest
    from .export import export_pvd

    if format != "pvd":
        say_wrong(f"format {format!r} is unknown. {nearest(format, ['pvd'])}")
        return WRONG
    try:
        if (folder / "frames.bin").is_file() and not (folder / "history.vtkhdf").is_file():
            from .run import rebuild

            say(f"{len(rebuild(folder))} states rebuilt from frames")
        if not _is_run(folder):
            return WRONG
        say(str(export_pvd(folder)))
    except CosseratError as error:
        say_wrong(str(error))
        return WRONG
    except OSError as error:
        say_wrong(f"{folder}: cannot be written: {error.strerror}.")
        return STOPPED
    return OK


def _is_run(folder: pathlib.Path) -> bool:
    """True if there is a history to read, else say so."""
    if (folder / "history.vtkhdf").is_file():
        return True
    missing = "there is no such folder" if not folder.exists() else "is not the folder of a run (no history.vtkhdf)"
    say_wrong(f"{folder}: {missing}.")
    return False


@app.command
def render(
    folder: pathlib.Path,
    *,
    step: int | None = None,
    field: str | None = None,
    film: Annotated[bool, Parameter(negative="")] = False,
    out: Out = None,
) -> int:
    """Draw a run: its plots and pictures again, one state, or a film; of a sweep or a design its plots.

    Parameters
    ----------
    folder
        Folder of a run, a sweep or a design.
    step
        Number of the state to draw (negative counts from the end).
    field
        Colour by a field of the history: force, moment, curvature, displacement, margin (of checks), ...
    film
        All states as a film (MP4 with the extra `movie`, else WebP).
    out
        File to write (.png, .jpg, ...; alone: the last state); default is in the run's folder pictures.
    """
    if (folder / "sweep.json").is_file() or (folder / "design.json").is_file():
        return _render_study(folder, step is not None or field is not None or film or out is not None)
    from .drawing import draw

    if not _is_run(folder):
        return WRONG
    arguments = []
    for name, value in (("--step", step), ("--field", field), ("--out", out)):
        if value is not None:
            arguments.append(f"{name}={value}")
    if film:
        arguments.append("--film")
    made = draw(folder, *arguments)
    if made.problem:
        say_wrong(made.problem)
        return WRONG if made.wrong else STOPPED
    if arguments:
        for path in made.paths:
            say(f"{'Film' if film else 'Picture'} in {path}")
    else:
        say(f"Pictures in {folder / 'pictures'}")
    return OK


def _render_study(folder: pathlib.Path, more: bool) -> int:
    """Plots of a sweep or a design again."""
    if more:
        say_wrong(
            f"{folder}: is not the folder of a run; of a sweep or a design there are plots only, without options."
        )
        return WRONG
    if (folder / "sweep.json").is_file():
        from .sweep.plots import plot_sweep as plot
    else:
        from .design.plots import plot_design as plot
    plot(folder)
    say(f"Plots in {folder / 'pictures'}")
    return OK


@app.command
def report(folder: pathlib.Path, *, film: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Write one HTML page of a run, to hand over: report.html in its folder.

    Parameters
    ----------
    folder
        Folder of a run.
    film
        With a film of all states; it is made if there is none yet.
    """
    from .drawing import draw
    from .errors import SceneError
    from .report import write_report

    if film and not any((folder / "pictures" / f"film.{kind}").is_file() for kind in ("mp4", "webp")):
        if not _is_run(folder):
            return WRONG
        made = draw(folder, "--film")
        if made.problem:
            say_wrong(f"no film: {made.problem}")
    try:
        say(f"Report in {write_report(folder, with_film=film)}")
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG
    return OK


@app.command
def bench(
    *,
    problem: Annotated[list[str] | None, Parameter(name="--problem", consume_multiple=True, negative="")] = None,
    out: Out = None,
    plot: Annotated[bool, Parameter(negative="")] = False,
    peers: pathlib.Path | None = None,
    scaling: Annotated[bool, Parameter(negative="")] = False,
    repeats: int = 30,
) -> int:
    """Measure error against CPU time on published problems, with one thread: a table, and bench.json.

    Parameters
    ----------
    problem
        Names out of S1 S2 S3 S4 D1 D2 D3 B03 C1; default all.
    out
        Folder for the results; default out/bench.
    plot
        Also draw work-precision diagrams.
    peers
        What `python tests/benchmarks/peers` wrote of other tools, to draw beside.
    scaling
        Only measure how time and memory grow, up to 100 000 elements and 1000 rods.
    repeats
        Time each case this often at most.
    """
    from .bench import one_thread

    one_thread()
    from .bench.command import bench as measured
    from .errors import SceneError

    try:
        with Progress(2, quiet=False, what="cases") as progress:
            report = measured(
                problem, out or pathlib.Path("out/bench"), plot=plot, peers=peers, scaling=scaling, repeats=repeats,
                progress=progress,
            )  # fmt: skip
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG
    if progress.interrupted:
        say_wrong("interrupted; what was measured is written.")
    say(report)
    return STOPPED if progress.interrupted else OK


@app.command
def sweep(
    scene: pathlib.Path,
    *,
    out: Out = None,
    workers: int | None = None,
    scheduler: str | None = None,
    pictures: bool = True,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Run a scene many times with other values, as its [sweep] says; only cases that are not there yet are run.

    Parameters
    ----------
    scene
        Scene file (TOML) with a table [sweep].
    out
        Folder for the results; default is the sweep's own, or out/<name of the scene>_sweep.
    workers
        Run cases in so many processes (a local Dask cluster); default is this one.
    scheduler
        Address of a Dask scheduler to run them on.
    pictures
        Make plots when the results are safe.
    quiet
        Print nothing but faults.
    """
    from .bench import one_thread

    one_thread()
    from .errors import SceneError

    if workers is not None and (workers < 1 or scheduler is not None):
        wrong = (
            "go with --workers, or with --scheduler, not both" if scheduler else f"must be at least 1 (got {workers})"
        )
        say_wrong(f"--workers: {wrong}.")
        return WRONG
    loaded = _load(scene)
    if loaded is None:
        return WRONG
    from .sweep.command import run_sweep

    tell = (lambda text="": None) if quiet else say
    tell(loaded.title)
    try:
        with Progress(len(loaded.cases), quiet, what="cases") as progress:
            found = run_sweep(loaded, out, workers=workers, scheduler=scheduler, progress=progress)
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG
    except KeyboardInterrupt:
        say_wrong("interrupted; finished cases are kept, the same command goes on.")
        return STOPPED
    tell(f"  {len(found.rows)} cases, {found.run} run now, {found.count('converged')} converged")
    for note in found.notes:
        tell(f"  {note}")
    tell(f"Results in {found.folder}")
    if pictures and not (found.same and (found.folder / "pictures").is_dir()):
        from .sweep.plots import plot_sweep

        plot_sweep(found.folder)
        tell(f"Plots in {found.folder / 'pictures'}")
    return STOPPED if found.count("lost") or found.count("missing") else OK


@app.command
def design(
    scene: pathlib.Path,
    *,
    out: Out = None,
    pictures: bool = True,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Find the values that make a result least while others keep their limits, as the scene's [design] says.

    Parameters
    ----------
    scene
        Scene file (TOML) with a table [design].
    out
        Folder for the results; default is the design's own, or out/<name of the scene>_design.
    pictures
        Make plots when the results are safe.
    quiet
        Print nothing but faults.
    """
    from .errors import SceneError

    loaded = _load(scene)
    if loaded is None:
        return WRONG
    from .design.command import run_design

    tell = (lambda text="": None) if quiet else say
    tell(loaded.title)
    logging.getLogger("cosserat_fem").setLevel(logging.ERROR)  # warnings of trials are in their tables
    runs = loaded.tables.design.runs if loaded.tables.design is not None else 0
    try:
        with Progress(runs, quiet, what="designs at most") as progress:
            found = run_design(loaded, out, progress=progress)
    except SceneError as error:
        tell_faults(error.faults)
        return WRONG
    tell(f"  {len(found.trials)} designs run")
    for line in found.lines:
        tell(f"  {line}")
    tell(f"Results in {found.folder}")
    if pictures:
        from .design.plots import plot_design

        plot_design(found.folder)
        tell(f"Plots in {found.folder / 'pictures'}")
    if not found.complete:
        return STOPPED
    return OK if found.best is not None and found.safe else VIOLATED


@app.command
def rules() -> int:
    """List the bend-radius rules that checks know by name, with clause, status and source."""
    from .limits.rules import bend_rules

    for rule in bend_rules().values():
        of = {"cable": "cable diameters", "wire": "diameters of the largest insulated wire"}[rule.diameter]
        say(f"{rule.name}: {'no number' if rule.factor is None else f'{rule.factor:g} {of}, inside the bend'}")
        say(f"    for {rule.applies}\n    clause: {rule.clause}; status: {rule.status}; source: {rule.source}")
    say(
        "data sheet: read in a publication of the body that makes the rule; recalled: quoted by others, check the standard."
    )
    return OK


@app.command
def schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    from .scene.tables import SceneTables

    say(json.dumps(SceneTables.model_json_schema(), indent=2))
    return OK


@app.command
def info() -> int:
    """Print versions and where compiled kernels are kept."""
    import platform
    from importlib import metadata

    from .folder import PROGRAM
    from .results import PACKAGES

    say(f"{PROGRAM} {metadata.version(PROGRAM)}")
    say(f"python {platform.python_version()} on {platform.platform()}")
    for package in PACKAGES:
        say(f"{package} {metadata.version(package)}")
    from .kernels.condense import assemble

    kept = getattr(assemble._cache, "cache_path", None)
    say(f"compiled kernels in {kept}" if kept else "compiled kernels are not kept: no folder for them can be written")
    return OK
