"""Which stiffness does a cable have that was measured? A scene whose numbers are fitted to a measurement.

Rule: nonlinear least squares (scipy, trust region) over whole runs of the scene, each started from the first state of the
one before. Free are bending, torsion and axial stiffness as factors on those of the scene, and the stress-free curvature.
Residuals are measured in parts of the largest value of their column; points on the cable are residuals by their distance
from its centreline, in parts of its length. The interval of a number is where it lies with 95 % confidence if the residuals
are independent noise of the same size and the model is right: Student's t times the standard error from the Jacobian (Bates
and Watts, Nonlinear Regression Analysis, 1988, sec. 2.3), stiffnesses by their logarithm. What a measurement does not fix is
said to be so: such a number has no interval.
"""

from __future__ import annotations

import copy
import logging
import os
import pathlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .equilibrium.statics import solve_quasistatic, solve_static
from .errors import ConvergenceError, CosseratError, nearest
from .export import hinged_parts, replace_file, write_json
from .folder import PROGRAM
from .history import History
from .overlay import COMPONENTS, Curve, Curves, Measured, claim
from .rod import Rod
from .scene import Scene, build_scene
from .section import Section
from .space import State

FREE = {
    "EI": ("N m^2", "bending stiffness (about d1; about d2 in proportion)"),
    "GJ": ("N m^2", "torsional stiffness"),
    "EA": ("N", "axial stiffness"),
    "bend 1": ("1/m", "stress-free curvature about d1"),
    "bend 2": ("1/m", "stress-free curvature about d2"),
    "twist": ("1/m", "stress-free twist"),
}
REST = ("bend 1", "bend 2", "twist")
FACTOR, TURN = 100.0, 4 * np.pi  # stiffnesses change by so much at most; a rod at rest turns by so many radians at most
STEP, ROUGH = 1e-4, 1e-3  # of an unknown, for the Jacobian; with contact
FIXED = 1e-6  # smallest singular value of the Jacobian over the largest: below it some numbers are not fixed
CONFIDENCE = 0.95
SHAPE = ("x", "y", "z")
MANY = 300  # times that are all made stations; of more the stations of the scene are taken
Told = Callable[[dict[str, float], float], None]


@dataclass(frozen=True)
class Number:
    """A fitted number: value, ends of its interval (None if it is not fixed), and what the scene said, in its unit."""

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None
    before: float


@dataclass(frozen=True, eq=False)
class Fit:
    """What a fit found.

    numbers; correlation (P, P) or None; rms : {column: root mean square of what is left, in its unit}; before: the same with
    the numbers of the scene; runs; scene: with the fitted numbers; history: of it; points: how many numbers were measured
    """

    numbers: list[Number]
    correlation: np.ndarray | None
    rms: dict[str, float]
    before: dict[str, float]
    runs: int
    points: int
    scene: Scene
    history: History
    measured: Measured

    @property
    def measured_values(self) -> Measured:
        """The measurement without points on the cable."""
        keep = {k: v for k, v in self.measured.columns.items() if k not in SHAPE or not self.shaped}
        return Measured(self.measured.path, keep)

    @property
    def shaped(self) -> bool:
        """True if points on the cable were measured."""
        return set(SHAPE) <= set(self.measured.columns)

    @property
    def curves(self) -> bool:
        """True if there are curves to lay over the measured ones."""
        return bool(self.measured_values.values) and len(self.history) > 1


def fit(scene: Scene, measured: Measured, free: Sequence[str] = ("EI",), *, told: Told | None = None) -> Fit:
    """Fit numbers of a scene to a measurement.

    Parameters
    ----------
    free : names out of "EI", "GJ", "EA", "bend 1", "bend 2", "twist"
        Of all rods of the scene together.
    told : function (numbers by name, root mean square of all residuals), optional
        Called after each run.

    Raises
    ------
    SceneError, CosseratError
        The scene or the measurement cannot be fitted; says why.
    ConvergenceError
        A run found no equilibrium; the message has its numbers.
    """
    from scipy.optimize import least_squares
    from scipy.stats import t as student

    _check(scene, free)
    problem = _Problem(scene, measured, tuple(free), told)
    first = problem.residuals(np.ones(len(free)))
    if problem.count <= len(free):
        raise CosseratError(
            f"{measured.where}: {problem.count} number(s) cannot fix {len(free)}; measure more, or free fewer numbers."
        )
    before = problem.rms(first)
    reach = np.array([TURN if name in REST else np.log(FACTOR) for name in free])
    steps = len(free) * [ROUGH if scene.model.contacts else STEP]
    found = least_squares(
        problem.residuals,
        np.ones(len(free)),
        bounds=(1.0 - reach, 1.0 + reach),
        diff_step=steps,
        xtol=1e-8,
        ftol=1e-10,
    )
    left = problem.residuals(found.x)
    U, s, V = np.linalg.svd(np.asarray(found.jac), full_matrices=False)
    error, correlation = np.full(len(free), np.nan), None
    if s[-1] > FIXED * s[0]:
        covariance = (V.T / s**2) @ V * (left @ left) / (problem.count - len(free))
        error = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(error, error) if (error > 0).all() else np.eye(len(free))
    wide = float(student.ppf(0.5 + 0.5 * CONFIDENCE, problem.count - len(free))) * error
    numbers = []
    for k, name in enumerate(free):
        value, low, high = (problem.number(name, x) for x in (found.x[k], found.x[k] - wide[k], found.x[k] + wide[k]))
        ends = (float(low), float(high)) if np.isfinite(wide[k]) else (None, None)
        before_it = float(problem.number(name, 1.0))
        numbers.append(Number(name, FREE[name][0], float(value), ends[0], ends[1], before_it))
    with _hushed(True):
        at = problem.changed(found.x)
    return Fit(
        numbers, correlation, problem.rms(left), before, problem.runs, problem.count, at, problem.history, measured
    )


def _check(scene: Scene, free: Sequence[str]) -> None:
    """What cannot be fitted."""
    if scene.tables.solve.kind not in ("static", "quasistatic"):
        raise CosseratError(f'fit: needs kind = "static" or "quasistatic" (got "{scene.tables.solve.kind}").')
    if not free:
        raise CosseratError(f"fit: nothing is free. {nearest('', FREE)}")
    for name in free:
        if name not in FREE:
            raise CosseratError(f"fit: {name!r} cannot be fitted. {nearest(name, FREE)}")
    if len(set(free)) < len(free):
        raise CosseratError("fit: a number is free twice.")
    for rod in scene.model.rods:
        if any(section.coupled is not None for _, section in rod.sections):
            raise CosseratError(f"fit: rod {rod.name!r} has a coupled section; give it six stiffnesses.")
    for table in scene.tables.rod:
        if set(free) & set(REST) and (table.rest == "as_drawn" or (table.rest != "straight" and _several(table.rest))):
            raise CosseratError(
                f'fit: rod {table.name!r} has a stress-free shape of its own; fit its curvature with rest = "straight" or '
                "three numbers."
            )


def _several(rest: Any) -> bool:
    return isinstance(rest[0], list | tuple)


class _Problem:
    """Residuals of one fit, and its runs."""

    def __init__(self, scene: Scene, measured: Measured, free: tuple[str, ...], told: Told | None) -> None:
        self.scene, self.measured, self.free, self.told = scene, measured, free, told
        self.start: State | None = None
        self.runs = 0
        self.history: History
        self.sections = self._sections()
        shaped = set(SHAPE) <= set(measured.columns)
        values = [name for name in measured.values if name not in SHAPE] if shaped else measured.values
        self.shaped = shaped
        self.travel = scene.tables.solve.travel
        self.t = self._times()
        self.columns = Measured(
            measured.path, {name: measured.columns[name] for name in values}
        ).matched(_curve_names(scene)) if values else {}  # fmt: skip
        if shaped and len(scene.model.rods) > 1:
            raise CosseratError(f"{measured.where}: points x, y, z need a scene with one rod.")
        self.sizes = {name: max(float(np.abs(measured.columns[name]).max()), 1e-300) for name in self.columns}
        self.stations = self._stations()
        self.count = len(self.t) * (len(self.columns) + (2 if shaped else 0))  # along the cable a point says nothing

    def _sections(self) -> dict[str, Section]:
        """Sections that rods have, by the names that rods call them: of the scene or of the catalogue."""
        found: dict[str, Section] = {}
        for table, rod in zip(self.scene.tables.rod, self.scene.model.rods, strict=True):
            names = [table.section] if isinstance(table.section, str) else [name for _, name in table.section]
            found |= dict(zip(names, [section for _, section in rod.sections], strict=True))
        return found

    def _times(self) -> np.ndarray:
        """Time of each row, going on where the travel goes back."""
        if self.scene.tables.solve.kind == "static":
            n = len(next(iter(self.measured.columns.values())))
            return np.full(n, float(self.scene.times[0]))
        t = self.measured.times(_motion(self.scene))
        last = float(self.scene.times[-1])
        end = 2.0 * last - self.scene.times[0] if self.travel == "both" else last
        wrong = np.flatnonzero((t < self.scene.times[0] - 1e-9) | (t > end + 1e-9))
        if len(wrong):
            span = f"{self.scene.times[0]:g} s to {end:g} s"
            raise CosseratError(f"{self.measured.where}: the time {t[wrong[0]]:g} s is not in the run, {span}.")
        return t

    def _stations(self) -> np.ndarray:
        """Stations of the way out: those of the scene, and the measured times if they are few."""
        last = float(self.scene.times[-1])
        out = np.unique(np.where(self.t > last, 2.0 * last - self.t, self.t))
        if len(out) > MANY and not self.shaped:
            return self.scene.times
        merged = np.unique(np.concatenate([self.scene.times, out]))
        return merged[np.append(True, np.diff(merged) > 1e-9 * max(last, 1e-300))]

    def number(self, name: str, x: float) -> float:
        """What an unknown stands for: of the first section or rod."""
        if name in REST:
            rest = self.scene.tables.rod[0].rest
            before = 0.0 if rest == "straight" else float(rest[REST.index(name)])
            return before + (x - 1.0) / self.scene.model.rods[0].length
        section = next(iter(self.sections.values()))
        matrix = np.diag(section.matrix)
        return float(matrix[{"EI": 3, "GJ": 5, "EA": 2}[name]] * np.exp(x - 1.0))

    def changed(self, x: np.ndarray) -> Scene:
        """The scene with other numbers: sections become general ones."""
        factor = {name: float(np.exp(v - 1.0)) for name, v in zip(self.free, x, strict=True) if name not in REST}
        data = copy.deepcopy(self.scene.source.data)
        declared = [table["name"] for table in data.setdefault("section", [])]
        new = {name: name if name in declared else f"{name.replace('/', ' ')} fitted" for name in self.sections}
        for name, section in self.sections.items():
            table = _general(new[name], section, factor)
            if name in declared:
                data["section"][declared.index(name)] = table
            else:
                data["section"].append(table)
        for rod in data["rod"]:
            one = isinstance(rod["section"], str)
            rod["section"] = new[rod["section"]] if one else [[s, new[name]] for s, name in rod["section"]]
        if set(self.free) & set(REST):
            for k, rod in enumerate(self.scene.model.rods):
                rest = self.scene.tables.rod[k].rest
                base = [0.0, 0.0, 0.0] if rest == "straight" else list(rest)
                for name, v in zip(self.free, x, strict=True):
                    if name in REST:
                        base[REST.index(name)] += float(v - 1.0) / rod.length
                data["rod"][k]["rest"] = base
        return build_scene(replace(self.scene.source, data=data))

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """What is left (n,), each in parts of its column's size."""
        try:
            with _hushed(self.runs > 0):
                self.history = self._run(self.changed(x))
        except ConvergenceError as error:
            said = ", ".join(f"{name} = {self.number(name, v):.4g}" for name, v in zip(self.free, x, strict=True))
            raise ConvergenceError(f"fit: with {said}: {error}", error.history, error.state) from None
        self.runs += 1
        curves = _curves(self.history)
        left = [
            (curves[name].at(self.t) - self.measured.columns[column]) / self.sizes[column]
            for column, name in self.columns.items()
        ]
        if self.shaped:
            left.append(self._distances() / self.scene.model.rods[0].length)
        whole = np.concatenate(left)
        if self.told is not None:
            values = {name: self.number(name, v) for name, v in zip(self.free, x, strict=True)}
            self.told(values, float(np.sqrt(np.mean(whole**2))))
        return whole

    def _run(self, scene: Scene) -> History:
        start = None if self.start is None else replace(self.start, contact=None)
        if scene.tables.solve.kind == "static":
            history = solve_static(scene.model, t=float(scene.times[0]), start=start)
        else:
            history = solve_quasistatic(scene.model, self.stations, start=start, travel=self.travel)
        self.start = history.records[0].state
        return history

    def _distances(self) -> np.ndarray:
        """Vectors (3 n,) [m] from the centreline to each measured point, at its time."""
        rod = self.history.model.rods[0]
        points = np.stack([self.measured.columns[c] for c in SHAPE], axis=1)
        rows = np.abs(self.history.t[None, :] - self.t[:, None]).argmin(axis=1)
        out = np.empty((len(points), 3))
        for row in np.unique(rows):
            here = rows == row
            out[here] = _from_curve(self.history, rod, int(row), points[here])
        return out.ravel()

    def rms(self, left: np.ndarray) -> dict[str, float]:
        """Root mean square of the residuals of each column, in its unit; of points their distance."""
        said, n = {}, len(self.t)
        for k, column in enumerate(self.columns):
            said[column] = float(np.sqrt(np.mean(left[k * n : (k + 1) * n] ** 2)) * self.sizes[column])
        if self.shaped:
            vectors = left[len(self.columns) * n :].reshape(-1, 3)
            length = float(self.scene.model.rods[0].length)
            said["points"] = float(np.sqrt((vectors**2).sum(axis=1).mean()) * length)
        return said


@contextmanager
def _hushed(so: bool) -> Iterator[None]:
    """Warnings that the first run gave are not given again by each other one."""
    log = logging.getLogger("cosserat_fem")
    level = log.level
    if so:
        log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _from_curve(history: History, rod: Rod, row: int, points: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) [m] to points from the nearest places of a centreline, on the polynomials of its elements."""
    view = history.model.space[rod]
    group = history.model.space.groups[view.group]
    xi = group.basis.elem.doflocs[:, 0] - 0.5
    r = history.records[row].state.r[group.conn[view.elements]]
    C = np.einsum("ja,eai->eji", np.linalg.inv(xi[:, None] ** np.arange(len(xi))), r)
    fine = np.linspace(-0.5, 0.5, 41)
    powers = fine[:, None] ** np.arange(len(xi))
    places = np.einsum("fj,eji->efi", powers, C).reshape(-1, 3)
    first = ((points[:, None, :] - places[None]) ** 2).sum(axis=2).argmin(axis=1)
    best = np.full((len(points), 3), np.inf)
    for beside in (-1, 0, 1):  # where two elements meet the nearest place may be in either
        element = np.clip(first // len(fine) + beside, 0, len(C) - 1)
        at = fine[first % len(fine)] if beside == 0 else np.full(len(points), -0.5 * beside)
        away = _from_element(C[element], at, points)
        nearer = (away**2).sum(axis=1) < (best**2).sum(axis=1)
        best[nearer] = away[nearer]
    return best


def _from_element(C: np.ndarray, at: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) to points (n, 3) from the nearest places of polynomials C (n, J, 3) near xi = at (n,)."""
    j = np.arange(C.shape[1])
    for _ in range(8):  # Newton's method for the foot of the perpendicular
        p = at[:, None] ** j
        d = np.where(j > 0, j * at[:, None] ** np.maximum(j - 1, 0), 0.0)
        dd = np.where(j > 1, j * (j - 1) * at[:, None] ** np.maximum(j - 2, 0), 0.0)
        x, dx, ddx = (np.einsum("nj,nji->ni", basis, C) for basis in (p, d, dd))
        slope = ((x - points) * dx).sum(axis=1)
        curve = np.maximum((dx * dx + (x - points) * ddx).sum(axis=1), 0.1 * (dx * dx).sum(axis=1))
        at = np.clip(at - slope / curve, -0.5, 0.5)
    return points - np.einsum("nj,nji->ni", at[:, None] ** j, C)


def _general(name: str, section: Section, factor: dict[str, float]) -> dict[str, Any]:
    """Table of a section with its stiffnesses multiplied."""
    force, moment = list(section.force_stiffness or ()), list(section.moment_stiffness or ())
    force[2] *= factor.get("EA", 1.0)
    moment = [m * factor.get("EI", 1.0) for m in moment[:2]] + [moment[2] * factor.get("GJ", 1.0)]
    table: dict[str, Any] = {
        "kind": "general",
        "name": name,
        "force_stiffness": force,
        "moment_stiffness": moment,
        "mass_per_length": section.mass_per_length,
        "rotary_inertia": list(section.rotary_inertia),
    }
    for key in ("radius", "outline"):
        if (value := getattr(section, key)) is not None:
            table[key] = list(value) if key == "outline" else value
    return table


def _motion(scene: Scene) -> Curve | None:
    """Angle [deg] of the one hinge that turns, over the time of the whole travel."""
    out = scene.times
    times = np.append(out, 2.0 * out[-1] - out[-2::-1]) if scene.tables.solve.travel == "both" else out
    stroke = np.where(times > out[-1], 2.0 * out[-1] - times, times)
    angles = [
        np.degrees([part.motion.angle_at(float(t)) for t in stroke])
        for part in hinged_parts(History(scene.model))
    ]  # fmt: skip
    turning = [angle for angle in angles if np.ptp(angle) > 0]
    return Curve(times, turning[0], "deg") if len(turning) == 1 else None


def _curve_names(scene: Scene) -> list[str]:
    names = [f"torque of {part.name}" for part in hinged_parts(History(scene.model))]
    for support in scene.model.supports:
        names += [f"{what} of {support.name}" for what in ("force", "moment", *COMPONENTS)]
    return names


def _curves(history: History) -> dict[str, Curve]:
    """Curves of a history by the names that run folders have too."""
    found = {f"torque of {p.name}": Curve(history.t, history.hinge_torque(p), "N m") for p in hinged_parts(history)}
    for support in history.model.supports:
        load = history.reaction(support)
        for what, unit, part in (("force", "N", load[:, :3]), ("moment", "N m", load[:, 3:])):
            found[f"{what} of {support.name}"] = Curve(history.t, np.linalg.norm(part, axis=1), unit)
        for k, c in enumerate(COMPONENTS):
            found[f"{c} of {support.name}"] = Curve(history.t, load[:, k], "N" if k < 3 else "N m")
    return found


def fitted_curves(found: Fit) -> Curves:
    """Curves of the fitted run, to lay over the measurement."""
    return Curves("fitted", _curves(found.history), _motion(found.scene))


def write_fit(found: Fit, folder: str | os.PathLike[str]) -> None:
    """Write `fit.json` and the fitted scene, `fitted.toml`."""
    folder = pathlib.Path(folder)
    claim(folder, "fit.json", ("fitted.toml",))
    said = {
        "program": PROGRAM,
        "measured": str(found.measured.path.resolve()),
        "numbers": {number.name: vars(number) for number in found.numbers},
        "confidence": CONFIDENCE,
        "correlation": None if found.correlation is None else found.correlation.tolist(),
        "rms": found.rms,
        "rms_before": found.before,
        "points": found.points,
        "runs": found.runs,
    }
    write_json(said, folder / "fit.json")
    text = found.scene.resolved()
    replace_file(folder / "fitted.toml", lambda temporary: temporary.write_text(text, encoding="utf-8"))
