"""A batch from its scans to its summary: what is missing is measured, everything is told once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fringeworks.batch.engines import Engine, engine
from fringeworks.batch.measure import Job, job_of
from fringeworks.batch.scans import Scan, find_scans, is_ready, passed_over
from fringeworks.batch.store import Row, Store, check_store
from fringeworks.evaluate.inspect import rig_of
from fringeworks.files.atomic import StrPath, refuse_overwrite
from fringeworks.files.folder import locked
from fringeworks.files.limits import is_folder
from fringeworks.files.recipe import read_recipe
from fringeworks.types import FileProblem, Frozen, InputError, PartTolerance, Recipe, made_by

USUAL_MEMORY_GB = 2.0
"""Memory of a worker, GB: enough for twelve frames of 12 megapixels."""
DIED = "workers died"
"""Part of what is said of a scan that was given up because of that."""


@dataclass(frozen=True, eq=False, repr=False)
class BatchResult(Frozen):
    """What came of a batch."""

    folder: Path
    """Folder of the results."""
    summary: Path
    """Summary as CSV."""
    tolerances: tuple[PartTolerance, ...]
    """Those of the recipe."""
    rows: tuple[dict[str, Any], ...]
    """A row for each scan, in their order: figures, verdicts, seconds, worker, error. Folders that
    are empty, and those of interrupted captures, have an error."""
    passed_over: tuple[str, ...] = ()
    """Names of folders beside the captures that hold something else."""
    source: str = ""
    """Folder, array or address of the captures."""
    recipe: Recipe = field(default_factory=Recipe)
    """The recipe, with its rig."""

    @property
    def failed(self) -> int:
        """Number of scans that could not be measured."""
        return sum(bool(row.get("error")) for row in self.rows)

    def count(self, verdict: str) -> int:
        """Number of parts with a verdict."""
        return sum(row.get("verdict") == verdict for row in self.rows)


def run_batch(
    source: StrPath,
    recipe: Recipe | StrPath,
    out: StrPath,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    memory_gb: float = USUAL_MEMORY_GB,
    resume: bool = False,
    excel: bool = False,
    watch: Callable[[], bool] | None = None,
    progress: Callable[[Row, int], None] = lambda *_: None,
    started: Callable[[Engine], None] = lambda _: None,
) -> BatchResult:
    """Measure and judge many captures by one recipe.

    Parameters
    ----------
    source : path or address
        A folder of captures, a Zarr array (scan, frame, row, column), or the address of either that
        fsspec opens.
    recipe : Recipe or path
    out : path
        Folder of the results. A name that ends with ``.zarr`` holds a Zarr group (format 3) for
        each scan, any other one an archive. All workers must see it.
    workers : int, optional
        Processes of this machine; as many as it has cores by default. 0 measures in this process,
        for programs that may not start others; its memory is not bounded then.
    scheduler : str, optional
        Address of a Dask scheduler, such as ``tcp://10.0.0.5:8786``; ``local`` starts one here.
    memory_gb : float
        Memory that a worker of this machine may use, GB. A scan that needs more is told to have
        failed.
    resume : bool
        Go on with results that are there: only what is missing is measured.
    excel : bool
        Begin the summary with the mark (UTF-8 BOM) by which Excel reads σ and µ rightly.
    watch : callable, optional
        Called when all captures are measured; while it returns true, captures that have come
        meanwhile are measured as well. For folders that a line fills.
    progress : callable
        Called with each row as it comes, and the number of all scans.
    started : callable
        Called with the engine, whose dashboard shows the workers.

    Returns
    -------
    BatchResult. ``summary.csv`` in the folder, or ``NAME.csv`` beside ``NAME.zarr``, has its rows;
    with the extra, Parquet beside it as well.

    Raises
    ------
    InputError for a source or a recipe that cannot be used, results that are there without
    ``resume``, and a folder that another batch is writing; DeviceProblem where the scheduler does
    not answer within 8 s.

    Notes
    -----
    The address of a result is a hash of the scan's frames, the recipe and the version. Equal inputs
    give equal bytes. A scan during which a worker dies is measured again. If workers die on it
    twice it is set aside, and tried once more, alone, when all others are done.
    """
    refuse_overwrite(out, source, recipe)
    scans = _found(source, ready=watch is not None)
    known = _complete(recipe if isinstance(recipe, Recipe) else read_recipe(recipe))
    folder = Path(out)
    check_store(folder)
    store = Store(folder, excel=excel)
    if is_folder(folder / "scans") and not resume:
        raise InputError(
            f"{folder}: expected a new folder, or to resume the batch there, got results"
        )
    count = (os.cpu_count() or 1) if workers is None else workers
    about = made_by("run_batch", options={"source": str(source), "method": known.method})
    with engine(scheduler, count, memory_gb) as runner, _own(folder):
        store.begin(about.as_dict())
        started(runner)
        job = job_of(known, str(folder.resolve()))
        rows: dict[str, Row] = {}
        while True:
            for row in _measured(runner, [s for s in scans if s.name not in rows], job):
                rows[row["scan"]] = row
                progress(row, len(scans))
            ordered = [rows[name] for name in sorted(rows)]
            store.write_summary(ordered)
            if watch is None:
                break
            if watch():
                scans = _found(source, ready=True)
            else:
                # Nothing more comes: folders without their frames are told.
                watch, scans = None, _found(source, ready=False)
        store.end()
    left = passed_over(source)
    return BatchResult(
        folder, store.summary, known.tolerances, tuple(ordered), left, str(source), known
    )


def _found(source: StrPath, *, ready: bool) -> list[Scan]:
    """The scans that are there; of a folder that a line fills, those that are complete: it may be
    empty at first."""
    try:
        scans = find_scans(source)
    except FileProblem:
        if not ready or not is_folder(Path(source)):
            raise
        return []
    return [s for s in scans if not ready or s.index is not None or is_ready(s.place)]


def _measured(runner: Engine, scans: list[Scan], job: Job) -> Iterator[Row]:
    """Rows of scans; those that were given up are tried once more, one at a time.

    Workers that died for other reasons do no harm then.
    """
    given_up = []
    for row in runner.run(scans, job):
        if DIED in row.get("error", ""):
            given_up.append(row["scan"])
        else:
            yield row
    for scan in scans:
        if scan.name in given_up:
            yield from runner.run([scan], replace(job, alone=True))


def _complete(recipe: Recipe) -> Recipe:
    """A recipe that holds its rig: workers on other machines do not see the file."""
    return recipe if recipe.rig is None else replace(recipe, rig=rig_of(recipe))


@contextmanager
def _own(folder: Path) -> Any:
    """Keep other batches out of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        yield
