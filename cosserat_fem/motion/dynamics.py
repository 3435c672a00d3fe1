"""How does it move? A run in time from what the user asks: start, duration, step control, extrapolation.

Rule: here it is decided what is run and from where; how a step is made is `integrator`'s. What cannot run in time (no mass,
Kardan angles, tables that end too early) is refused before anything is solved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..accuracy.refine import check_accuracy
from ..accuracy.transfer import Transfer
from ..equilibrium.statics import solve_static
from ..errors import SceneError, check_number, check_positive, check_shape
from ..history import History
from ..kernels.rotation import matrix_from_quaternion, multiply, quaternion_from_vector, relative_rotation
from ..model import Model
from ..space import State
from ..terms.inertial import Rates
from .integrator import Checkpoint, Run
from .stepping import motion_to_accuracy
from .steps import AdaptiveStep, FixedStep

KEPT = 101  # states of a run with an accuracy, if nothing is said


@dataclass(frozen=True, eq=False)
class RigidVelocity:
    """Start velocity of a rigid motion: v [m/s] of the point [m], turning with omega [rad/s], in space."""

    v: Any = (0.0, 0.0, 0.0)
    omega: Any = (0.0, 0.0, 0.0)
    point: Any = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("v", "omega", "point"):
            object.__setattr__(self, name, check_shape(f"start velocity: {name}", getattr(self, name), (3,)))

    def at(self, state: State) -> np.ndarray:
        """Velocity (N, 6) of every node."""
        out = np.empty((len(state.r), 6))
        out[:, :3] = self.v + np.cross(self.omega, state.r - self.point)
        out[:, 3:] = np.einsum("nki,k->ni", matrix_from_quaternion(state.q), self.omega)
        return out


def solve_dynamic(
    model: Model,
    duration: float,
    *,
    start: Literal["equilibrium", "drawn"] | State = "equilibrium",
    velocity: RigidVelocity | np.ndarray | None = None,
    rho_inf: float = 0.8,
    step: AdaptiveStep | FixedStep | None = None,
    times: Sequence[float] | np.ndarray | None = None,
    start_time: float = 0.0,
    callback: Callable[[Run], bool | None] | None = None,
    resume: Checkpoint | None = None,
    accuracy: float | None = None,
) -> History:
    """Follow the motion in time.

    Parameters
    ----------
    duration : [s]
    start : "equilibrium", "drawn" or State
        Start from the static equilibrium at the start time, from the drawn shape, or from a state of this model.
    velocity : RigidVelocity or (N, 6), optional
        Start velocity of every node: displacement in space [m/s], rotation in the section's axes [rad/s]; default rest.
        Held places start with the velocity of their part.
    rho_inf : from 0 to 1
        Spectral radius at infinity: 1 keeps all energy, 0 damps what steps cannot resolve at once.
    step : AdaptiveStep or FixedStep, default AdaptiveStep()
    times : (T,) [s], optional
        When to keep a state, within start_time .. start_time + duration; default after every step.
    callback : function (Run) -> bool, optional
        Called after each accepted step, or after several that were made in one compiled call, at the latest where a state is
        kept; return True to stop there.
    resume : Checkpoint, optional
        Go on from `Run.checkpoint()` of an earlier run of the same model with the same arguments. The history then
        holds the states from there on.
    accuracy : optional
        Choose elements and steps so that the estimated error of the nodes' places (root mean square over the kept times, in
        parts of the rod's length) is at most this; see `stepping`. Without `times` a hundred and one are kept. Not with
        `step`, `resume` or contact.

    Returns
    -------
    History with velocities, an energy ledger and the log of steps. With `accuracy`, its model is the one with the elements
    chosen (`history.model`; rods, supports and terms are the same objects), and `history.chosen` says which they are.

    Raises
    ------
    SceneError
        A rod has no mass, the start is not where the parts are, Kardan angles.
    ConvergenceError
        The step became too short; the error carries the history so far.
    """
    if accuracy is not None and (step is not None or resume is not None):
        raise ValueError("solve_dynamic: accuracy chooses the steps; leave out step and resume.")
    step = step or AdaptiveStep()
    check_positive("solve_dynamic: duration", duration)
    rho = check_number("solve_dynamic: rho_inf", rho_inf)
    if not 0.0 <= rho <= 1.0:
        raise ValueError(f"solve_dynamic: rho_inf must be from 0 to 1 (got {rho:g}).")
    end = start_time + duration
    kept = None if times is None else _check_times(times, start_time, end)
    check_dynamic(model, (start_time, end))
    if accuracy is not None:
        wanted = check_accuracy("solve_dynamic", accuracy)
        if model.contacts:
            raise SceneError("model: accuracy of a run in time with contact cannot be asked for; give a step.")
        kept = np.linspace(start_time, end, KEPT) if kept is None else kept

        def on(mesh: Model, dt: float) -> History:
            one = Run(mesh, start_time, end, rho, FixedStep(dt), kept, callback)
            _begin(one, *_on_elements(model, mesh, start, velocity))
            return one.go()

        return motion_to_accuracy(model, wanted, duration, on, _extrapolated)
    if isinstance(step, FixedStep) and step.richardson:
        if resume is not None:
            raise ValueError("solve_dynamic: an extrapolated run cannot be resumed; run it with one step length.")
        if kept is None:
            n = max(1, int(np.ceil(duration / step.dt - 1e-9)))
            kept = np.linspace(start_time, end, n + 1)
        both = []
        for dt in (step.dt, step.dt / 2):
            run = Run(model, start_time, end, rho, FixedStep(dt), kept, callback)
            _begin(run, start, velocity)
            both.append(run.go())
            if both[-1].status == "stopped":
                return both[-1]
        return _extrapolated(*both)
    run = Run(model, start_time, end, rho, step, kept, callback)
    if resume is not None:
        run.restore(resume)
    else:
        _begin(run, start, velocity)
    return run.go()


def _on_elements(model: Model, mesh: Model, start: Any, velocity: Any) -> tuple[Any, Any]:
    """Start and velocity that were given for one model, on the elements of another."""
    transfer = Transfer(model, mesh)
    if isinstance(start, State):
        model.check_state(replace(start, stress=model.initial_state().stress))
        start = transfer.state(start)
    if velocity is not None and not isinstance(velocity, RigidVelocity):
        velocity = transfer.nodal(check_shape("solve_dynamic: velocity", velocity, (model.space.n_nodes, 6)))
    return start, velocity


def _begin(run: Run, start: Any, velocity: Any) -> None:
    """Start a run from what the user gave."""
    model, t = run.model, run.begin_time
    if isinstance(start, State):
        model.check_state(replace(start, stress=model.initial_state().stress))
        state = start.at_time(t)
    elif start == "drawn":
        state = model.initial_state(t)
    elif start == "equilibrium":
        state = solve_static(model, t=t).final
    else:
        raise ValueError(f"solve_dynamic: start must be 'equilibrium', 'drawn' or a State (got {start!r}).")
    v = np.zeros((model.space.n_nodes, 6))
    if isinstance(velocity, RigidVelocity):
        v = velocity.at(state)
    elif velocity is not None:
        v = check_shape("solve_dynamic: velocity", velocity, v.shape).copy()
    run.begin(state, v, told=velocity is not None)


def _check_times(times: Any, start: float, end: float) -> np.ndarray:
    times = check_shape("solve_dynamic: times", times, (-1,))
    slack = 1e-9 * (end - start)
    if len(times) == 0 or (np.diff(times) <= 0).any() or times[0] < start - slack or times[-1] > end + slack:
        raise ValueError(
            f"solve_dynamic: times must increase and lie within the run, {start:g} s to {end:g} s; end time before start?"
        )
    return np.clip(times, start, end)


def check_dynamic(model: Model, times: Sequence[float]) -> None:
    """SceneError for what a run in time cannot take."""
    if model.rotation != "quaternion":
        raise SceneError("model: a run in time needs rotation = 'quaternion'.")
    faults = []
    for rod in model.rods:
        s = model.space[rod].s_gauss
        if (rod.mass_at(s) <= 0).any():
            k = int(np.argmin(rod.mass_at(s)))
            faults.append(
                f"rod {rod.name!r}: has no mass at s = {s[k]:.4g} m, and a run in time needs it. Give its section a density "
                "or mass_per_length."
            )
    if not faults:
        for name, values in (("mass", model.space.node_mass), ("rotary inertia", model.space.node_inertia.min(axis=1))):
            k = int(np.argmin(values))
            if values[k] <= 1e-12 * values.max():
                rod = model.rods[model.space.node_rod[k]]
                faults.append(
                    f"rod {rod.name!r}: has no {name} at s = {model.space.node_s[k]:.4g} m, and a run in time needs it."
                )
    if faults:
        raise SceneError(faults)
    for t in times:  # tables that end too early are told before the run
        try:
            model.constraints.driven(t)
            for term in model.terms:
                if term not in model.contacts:
                    term(model.initial_state(t), model.space, tangent=False)
        except ValueError as error:
            raise SceneError(str(error)) from None


def _extrapolated(coarse: History, fine: History) -> History:
    """Richardson: (4 fine - coarse) / 3 at every kept time; rotations along the shorter arc."""
    apart = 0.0
    length = fine.model.scales["length"]
    records = []
    for a, b in zip(coarse.records, fine.records, strict=False):
        turn = relative_rotation(a.state.q, b.state.q)
        apart = max(apart, float(np.abs(b.state.r - a.state.r).max()) / length, float(np.abs(turn).max()))
        q = multiply(b.state.q, quaternion_from_vector(turn / 3))
        state = replace(b.state, r=(4 * b.state.r - a.state.r) / 3, q=q)
        rates = Rates(*((4 * getattr(b.rates, n) - getattr(a.rates, n)) / 3 for n in ("v", "a", "b")))
        work = {name: (4 * done - (a.work or {})[name]) / 3 for name, done in (b.work or {}).items()}
        records.append(replace(b, state=state, reactions=(4 * b.reactions - a.reactions) / 3, rates=rates, work=work))
    fine.records[:] = records
    fine.extrapolated = apart / 3
    fine.message += f"; extrapolated from two step lengths, the finer one was {apart / 3:.1e} off"
    for name in ("iterations", "residuals"):
        setattr(fine.counters, name, getattr(fine.counters, name) + getattr(coarse.counters, name))
    return fine
