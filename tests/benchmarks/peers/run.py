"""One solve of one case by another tool, and how it is timed."""

import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


class Failed(Exception):
    """The tool found no solution."""


@dataclass
class Run:
    """What was observed (as `Problem.error` takes it), CPU seconds of the solve call, unknowns, iterations, time steps."""

    observed: Any
    cpu: float
    dofs: int
    iterations: int = 0
    steps: int = 0


@dataclass
class Case:
    """A method at a resolution; `solve` builds the model anew and times only the solve call."""

    method: str
    resolution: str
    solve: Callable[[], Run]


class Clock:
    """CPU seconds of what runs inside `with clock:`."""

    cpu = 0.0

    @contextmanager
    def __call__(self):
        begin = time.process_time()
        yield
        self.cpu += time.process_time() - begin
