"""Who runs cases when one process is not enough? Workers of a Dask cluster: a local one, or one that is there already.

Rule: a worker gets a job and writes a folder; only a word about it comes back. A worker that dies takes no case with it: the
scheduler gives the case to another one, and after that we do, `TRIES` times in all. Every worker is one process with one
thread, and no library in it starts more. A local cluster listens on 127.0.0.1 only and has no dashboard.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from multiprocessing import forkserver
from typing import Any

from ..errors import SceneError, one_line
from ..folder import PROGRAM
from .case import Job, run_case

TRIES = 3  # rounds of a case; in each the scheduler tries a few workers
CONNECT, APPEAR = 15, 60  # s to reach a scheduler; s until a worker is there
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
QUIET = {  # of a local cluster: no limits that stop long compiled solves, nothing that costs and is not looked at
    "distributed.scheduler.worker-ttl": None,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.multiprocessing-method": METHOD,
    "distributed.admin.tick.interval": "1 s",
    "distributed.admin.system-monitor.interval": "10 s",
    "distributed.admin.system-monitor.gil.enabled": False,
}


def run_on_workers(jobs: Sequence[Job], n_workers: int) -> Iterator[tuple[Job, str]]:
    """Run jobs on a local cluster of so many processes; each job as it ends, with what kept it from its folder if any."""
    dask, distributed = _libraries()
    if METHOD == "forkserver":  # imports once what every worker needs, those that replace dead ones too
        forkserver.set_forkserver_preload(["distributed", run_case.__module__])
        forkserver.ensure_running()
    with (
        dask.config.set(QUIET),
        distributed.LocalCluster(
            n_workers=n_workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None,
            memory_limit=0, silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):  # fmt: skip
        client.run(_ignore_interrupts)
        yield from _run(client, jobs)


def run_on_scheduler(jobs: Sequence[Job], address: str) -> Iterator[tuple[Job, str]]:
    """Run jobs on a cluster that is there. SceneError if it cannot be used."""
    with _connected(address) as client:
        yield from _run(client, jobs)


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    _, distributed = _libraries()
    where = f"scheduler {address!r}"
    try:
        client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SceneError(f"{where}: cannot be reached: {one_line(error)}. Start one with `dask scheduler`.") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=APPEAR)
        except TimeoutError:
            raise SceneError(
                f"{where}: has no workers. Start some with `dask worker {address} --nthreads 1`."
            ) from None
        ours = metadata.version(PROGRAM)
        for worker, theirs in client.run(_version).items():
            if theirs != ours:
                got = f"version {theirs}" if theirs else "none"
                raise SceneError(f"{where}: worker {worker} needs {PROGRAM} {ours} (got {got}).")
        yield client


def _libraries() -> tuple[Any, Any]:
    """dask and distributed, or a SceneError that says how to get them."""
    try:
        import dask
        import distributed
    except ImportError:
        raise SceneError(
            f"workers need the extra `cluster`: pip install '{PROGRAM}[cluster]'. Without --workers and --scheduler a "
            "sweep runs in one process."
        ) from None
    return dask, distributed


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; only the first answers


def _version() -> str:
    try:
        return metadata.version(PROGRAM)
    except metadata.PackageNotFoundError:
        return ""


def _run(client: Any, jobs: Sequence[Job]) -> Iterator[tuple[Job, str]]:
    """The first job alone, so that kernels are compiled once; then all others."""
    yield from _collect(client, jobs[:1])
    yield from _collect(client, jobs[1:])


def _collect(client: Any, jobs: Sequence[Job]) -> Iterator[tuple[Job, str]]:
    """Jobs as they end; those whose worker died are given out again."""
    from distributed import as_completed

    def submit(job: Job, tries: int) -> Any:
        future = client.submit(run_case, job, pure=False, key=f"case-{job.key}-{tries}")
        waiting[future.key] = job, tries
        return future

    waiting: dict[str, tuple[Job, int]] = {}
    ends = as_completed([submit(job, 1) for job in jobs], loop=client.loop)
    for future in ends:
        job, tries = waiting.pop(future.key)
        if future.status == "finished":
            yield job, str(future.result())
        elif tries < TRIES and _worker_died(future):
            ends.add(submit(job, tries + 1))
        else:
            said = future.exception() if future.status == "error" else future.status
            yield job, f"no worker could finish it: {one_line(RuntimeError(said))}"


def _worker_died(future: Any) -> bool:
    from distributed import KilledWorker

    return future.status != "error" or isinstance(future.exception(), KilledWorker)
