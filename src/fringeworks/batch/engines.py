"""What runs the scans of a batch: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from fringeworks.batch.measure import Job, measure_scan
from fringeworks.batch.scans import Scan
from fringeworks.batch.store import Row
from fringeworks.files.zarr_array import INSTALL
from fringeworks.types import DeviceProblem, InputError, MissingPackage

CONNECT_S = 8
"""Longest wait for a scheduler, s."""
WAITING = 2
"""Scans that are handed to each worker at a time: one that it measures, one that waits."""
THREADS = (
    "RAYON_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""Variables of the environment that bound the threads of a worker."""
MALLOC = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 1 << 30,
    "MALLOC_MMAP_THRESHOLD_": 1 << 30,
}
"""Variables of the C library on Linux. Dask runs a task in a thread. Its memory would otherwise be
given back after every array, and a scan would take two thirds longer."""


class Engine(Protocol):
    """What runs scans."""

    def run(self, scans: Iterable[Scan], job: Job) -> Iterator[Row]:
        """Yield a row for each scan as it ends; scans whose workers die are run again."""
        ...

    @property
    def dashboard(self) -> str:
        """Address of a page that shows the workers; empty where there is none."""
        ...


class Here:
    """This process: one scan after the other, with all threads of the kernels."""

    dashboard = ""

    def run(self, scans: Iterable[Scan], job: Job) -> Iterator[Row]:
        """Yield a row for each scan as it ends; see ``Engine``."""
        return (measure_scan(scan, job) for scan in scans)


class Processes:
    """Workers on this machine, each a process of its own with one thread."""

    dashboard = ""

    def __init__(self, workers: int, memory_gb: float) -> None:
        self._workers, self._memory_gb = workers, memory_gb

    def run(self, scans: Iterable[Scan], job: Job) -> Iterator[Row]:
        """Yield a row for each scan as it ends; see ``Engine``."""
        left = iter(scans)
        again: list[Scan] = []
        while True:
            flying: dict[Future[Row], Scan] = {}
            with self._pool() as pool:
                try:
                    yield from self._fly(pool, left, again, flying, job)
                    return
                except BrokenProcessPool:
                    # Every scan in flight is told to have failed; which one was at fault is in
                    # the marks that workers leave.
                    again.extend(flying.values())

    def _fly(
        self,
        pool: ProcessPoolExecutor,
        left: Iterator[Scan],
        again: list[Scan],
        flying: dict[Future[Row], Scan],
        job: Job,
    ) -> Iterator[Row]:
        while True:
            # After a death, the scans that were in flight run one at a time: whoever kills a
            # worker again is then known.
            suspects = bool(again)
            while len(flying) < (1 if suspects else WAITING * self._workers):
                scan = again.pop() if again else None if suspects else next(left, None)
                if scan is None:
                    break
                try:
                    flying[pool.submit(measure_scan, scan, job)] = scan
                except BrokenProcessPool:
                    again.append(scan)
                    raise
            if not flying:
                return
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                row = future.result()
                del flying[future]
                yield row

    @contextmanager
    def _pool(self) -> Iterator[ProcessPoolExecutor]:
        with one_thread():
            pool = ProcessPoolExecutor(
                self._workers,
                multiprocessing.get_context("spawn"),
                initializer=begin_worker,
                initargs=(self._memory_gb,),
            )
            try:
                yield pool
            finally:
                pool.shutdown(wait=True, cancel_futures=True)


class Cluster:
    """Workers of a Dask scheduler: one that runs somewhere, or one of this machine's cores."""

    def __init__(self, address: str | None, workers: int, memory_gb: float) -> None:
        try:
            distributed: Any = importlib.import_module("distributed")
        except ModuleNotFoundError as error:
            raise MissingPackage(f"scheduler: expected Dask, got none: {INSTALL}") from error
        self._distributed = distributed
        self._own: Any = None
        try:
            if address is None:
                with one_thread(), _own_memory():
                    self._own = distributed.LocalCluster(
                        n_workers=workers,
                        threads_per_worker=1,
                        memory_limit=f"{memory_gb} GB",
                        host="127.0.0.1",
                        dashboard_address="127.0.0.1:0",
                    )
            self._client = distributed.Client(self._own or address, timeout=CONNECT_S)
        except (OSError, ValueError, TimeoutError) as error:
            raise DeviceProblem(
                f"scheduler: expected one at {address} within {CONNECT_S} s, got none: {error}"
            ) from error

    @property
    def dashboard(self) -> str:
        """Address of a page that shows the workers."""
        return str(self._client.dashboard_link)

    def run(self, scans: Iterable[Scan], job: Job) -> Iterator[Row]:
        """Yield a row for each scan as it ends; see ``Engine``."""
        client, left = self._client, iter(scans)
        flying: dict[Any, Scan] = {}
        ended = self._distributed.as_completed()

        def fill() -> None:
            most = WAITING * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
            while len(flying) < most and (scan := next(left, None)) is not None:
                submit(scan)

        def submit(scan: Scan) -> None:
            future = client.submit(measure_scan, scan, job, pure=False, retries=0)
            flying[future] = scan
            ended.add(future)

        fill()
        while flying:
            future = next(ended)
            scan = flying.pop(future)
            try:
                yield future.result()
            except (self._distributed.KilledWorker, CancelledError):
                # Dask blames every scan that was handed to a worker that died, and loses results
                # that such a worker held. Marks in the store tell who was at fault.
                submit(scan)
            fill()

    def close(self) -> None:
        """Leave the scheduler; end it where it is this machine's own."""
        with suppress(Exception):
            self._client.close()
        if self._own is not None:
            self._own.close()


@contextmanager
def _own_memory() -> Iterator[None]:
    """Let Dask's workers that are started meanwhile keep the memory that they have used."""
    import dask

    with dask.config.set({"distributed.nanny.pre-spawn-environ": MALLOC}):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that are started meanwhile use one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def begin_worker(memory_gb: float) -> None:
    """Make ready a worker's process: it ends with its parent, and has bounded memory."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()
    bound_memory(memory_gb)


def _end_after(parent: BaseProcess) -> None:
    """End this process when its parent has ended: nobody would read what it does."""
    parent.join()
    os._exit(1)


def bound_memory(gb: float) -> None:
    """Bound the memory of this process, where the system can: what needs more fails alone."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return
    most = int(gb * 1e9)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


@contextmanager
def engine(scheduler: str | None, workers: int, memory_gb: float) -> Iterator[Engine]:
    """Lend what runs scans: ``local`` or an address for Dask, by default processes.

    Raises
    ------
    DeviceProblem where a scheduler cannot be reached; InputError for numbers out of range.
    """
    if workers < 0 or not memory_gb > 0:
        raise InputError(f"workers: expected 0 or more with memory, got {workers}, {memory_gb} GB")
    if workers == 0:
        if scheduler is not None:
            raise InputError("workers: expected 1 or more with a scheduler, got 0")
        yield Here()
        return
    if scheduler is None:
        yield Processes(workers, memory_gb)
        return
    cluster = Cluster(None if scheduler == "local" else scheduler, workers, memory_gb)
    try:
        yield cluster
    finally:
        cluster.close()
