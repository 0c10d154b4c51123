"""One scan of a batch: what a worker does, whatever engine runs it."""

from __future__ import annotations

import hashlib
import json
import os
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.batch.judgement import as_values
from fringeworks.batch.scans import Scan, content_hash, local, stack_of_array, taken
from fringeworks.batch.store import Row, Store
from fringeworks.evaluate.inspect import Inspection, inspect, recipe_hash
from fringeworks.types import HeightMap, InputError, Recipe, fingerprint

MOST_DEATHS = 2
"""Workers that may die on a scan before it is given up."""
ADDRESS_LETTERS = 32
"""Letters of an address: 128 bits of a hash."""


@dataclass(frozen=True)
class Job:
    """What all scans of a batch have in common."""

    recipe: Recipe
    """With its rig, not the rig's file: workers may not see that."""
    settings: str
    """Hash of the recipe and of the version."""
    store: str
    """Folder of the results."""
    alone: bool = False
    """Whether the scan runs alone, after workers have died on it: it is then tried once more."""


def job_of(recipe: Recipe, store: str) -> Job:
    """Return what workers need to know of a recipe."""
    return Job(recipe, settings_hash(recipe), store)


def settings_hash(recipe: Recipe) -> str:
    """Return the hash of everything beside the frames that results depend on."""
    described = {
        "version": _core.version,
        "method": recipe.method,
        "options": dict(recipe.options),
        "rig": None if recipe.rig is None else fingerprint(recipe.rig),
        "plan": None if recipe.plan is None else fingerprint(recipe.plan),
        "within": recipe.within,
        "areas": {name: fingerprint(area) for name, area in recipe.areas.items()},
        "tolerances": [repr(one) for one in recipe.tolerances],
        "risk": recipe.risk,
        "model": None if recipe.model is None else recipe_hash(recipe),
    }
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def measure_scan(scan: Scan, job: Job) -> Row:
    """Measure a scan, and write its result; or say why that was not possible.

    Returns
    -------
    The scan's row of the summary. Problems are told in its ``error``, never raised.
    """
    started = time.perf_counter()
    store = Store(job.store)
    try:
        row = _measured(scan, job, store)
    except InputError as problem:
        row = {"error": "; ".join(problem.lines)}
    except MemoryError:
        row = {"error": "expected enough memory for the scan, got too little"}
    except Exception as problem:
        row = {"error": f"internal error, please report it: {problem!r}"}
    seconds = round(time.perf_counter() - started, 4)
    return {
        "scan": scan.name,
        "taken": taken(scan),
        **row,
        "seconds": seconds,
        "worker": os.getpid(),
    }


def _measured(scan: Scan, job: Job, store: Store) -> Row:
    with local(scan) as lent:
        text = content_hash(lent) + job.settings
        address = hashlib.sha256(text.encode()).hexdigest()[:ADDRESS_LETTERS]
        if store.has(address):
            return store.row(address)
        deaths = store.count_begun(address)
        if deaths >= MOST_DEATHS + job.alone:
            raise InputError(f"{deaths} workers died while they measured this scan")
        mark = store.mark_begun(address)
        try:
            source: Any = lent
            if scan.index is not None:
                source = stack_of_array(lent, job.recipe)
            found = inspect(source, job.recipe)
            row = {"address": address, **figures(found)}
            store.write(address, replace(found.surface, provenance=None), row, as_values(found))
        finally:
            mark.unlink(missing_ok=True)
    return row


def figures(found: Inspection) -> Row:
    """Return the figures of a scan, which are the same whoever measures it."""
    surface = found.surface
    sigma = surface.sigma if isinstance(surface, HeightMap) else surface.sigma_mm
    measured = sigma[np.isfinite(sigma)]
    row: Row = {
        "verdict": found.verdict,
        "valid_share": round(1.0 - surface.failed_fraction, 6),
        "median_sigma": float(np.median(measured)) if measured.size else None,
        "error": "",
    }
    for check in found.checks:
        name = check.tolerance.name
        row[name] = check.value if np.isfinite(check.value) else None
        row[f"{name} σ"] = check.sigma if np.isfinite(check.sigma) else None
        row[f"{name} verdict"] = check.verdict
        row[f"{name} why"] = check.why
    return row
