"""Compiled kernels: plain functions on arrays, components written out, nothing else.

Rule: only this folder imports numba; a kernel knows no object of the package and allocates nothing inside its loops.
Every kernel has a readable form (`forms.py`, or NumPy in its test) and one test that holds the two equal.

Compiled code is kept on disk. numba renews it when the file of the function changes, but not when a function that was
inlined from another file does: after an update of one file a stale kernel would go on with the old memory layout of
another. So the stamp of every kernel is the content of all of them.
"""

from __future__ import annotations

import hashlib
import logging
import pathlib
import time
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba import njit, types
from numba.core.event import Listener, register, unregister
from numba.experimental import structref

log = logging.getLogger(__name__)


def _stamp() -> str:
    digest = hashlib.sha256()
    for path in sorted(pathlib.Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


STAMP = _stamp()


def _can_keep() -> bool:
    """False if there is no folder to keep compiled code in; then every start compiles, which is said once."""
    try:
        njit(cache=True)(_stamp)
    except RuntimeError:  # numba: no locator available
        log.warning(
            "no writable folder for compiled code: every start compiles again (about 20 s). Set NUMBA_CACHE_DIR to a "
            "folder that can be written."
        )
        return False
    return True


# Loops over the lanes of a pack are to be vectorised. Short ones would be unrolled whole before that, and then stay scalar:
# without this the assembly takes twice as long. Loops over the components of a vector are shorter and are unrolled.
llvm.set_option("", "--unroll-full-max-count=12")

OPTIONS: dict[str, Any] = {"cache": _can_keep(), "error_model": "numpy", "fastmath": {"contract"}}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, once per machine and content of this folder.

    `contract` lets a multiply and an add become one instruction; no other reordering is allowed, so results do not
    depend on how a loop was vectorised.
    """
    return _stamped(njit(**OPTIONS)(function))


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: without the wrappers for Python, which cost half the compile time."""
    return _stamped(njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS)(function))


def merged(function: Callable[..., Any]) -> Any:
    """As `inner`, and merged into its callers: for small functions with many arrays, which cost more to pass than to use."""
    return _stamped(njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True, **OPTIONS)(function))


def lean(function: Callable[..., Any]) -> Any:
    """As `inner`, for functions that allocate nothing: it is not counted who holds an array.

    numba counts, atomically, on every way out of a function that branches: ten times the cost of a short one.
    """
    return _stamped(njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False, **OPTIONS)(function))


def fused(function: Callable[..., Any]) -> Any:
    """As `lean`, and merged into its callers."""
    bare: dict[str, Any] = {"forceinline": True, "_nrt": False, **OPTIONS}
    return _stamped(njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **bare)(function))


def _stamped(compiled: Any) -> Any:
    if OPTIONS["cache"]:
        compiled._cache._cache_file._source_stamp = STAMP  # held by tests/kernels/test_cache.py
    return compiled


@structref.register
class KeptType(types.StructRef):
    """Type of `Kept`, by the types of its fields."""

    def preprocess_fields(self, fields: Any) -> Any:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


class Kept(structref.StructRefProxy):
    """Arrays that go to a kernel again and again, handed over as one object; fields as of `rest.settle`.

    Made by a kernel (`rest.keep`): this constructor alone would be compiled at every start.
    """


structref.define_proxy(Kept, KeptType, ["beam", "linear", "rows", "followers", "frame", "scratch"])


class CompileClock(Listener):
    """Seconds spent compiling since it was installed; calls `first` when compilation starts for the first time."""

    def __init__(self, first: Callable[[], None] | None = None) -> None:
        self.seconds, self._depth, self._start, self._first = 0.0, 0, 0.0, first

    def __enter__(self) -> CompileClock:
        register("numba:compile", self)
        return self

    def __exit__(self, *_: object) -> None:
        unregister("numba:compile", self)

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._start = time.perf_counter()
            if self._first is not None:
                self._first()
                self._first = None
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._start
