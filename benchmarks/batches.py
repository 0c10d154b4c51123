"""Cost of a batch per scan: one worker, two workers, overhead, memory, bytes.

Run it as ``python -m benchmarks.batches --work FOLDER --count 200``.
"""

from __future__ import annotations

import argparse
import os
import shutil
import threading
import time
from pathlib import Path

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Box, Plane
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look

DISTINCT = 8
"""Captures that are simulated; the others are the same frames under another description."""
SAMPLE_S = 0.2
"""Interval at which the memory of the workers is read, s."""


def captures(folder: Path, count: int) -> None:
    """Write captures of 12 frames of 1280 × 1024 px, and a recipe beside them."""
    rig = standard_rig()
    plan = fringe_plan(rig, both=False)
    place = [pose(np.eye(3), np.array([0.0, 0.0, z])) for z in (520.0, 515.0)]
    view = look(rig, [Body(Plane(), place[0], 0.7), Body(Box((40.0, 40.0, 10.0)), place[1], 0.8)])
    for k in range(min(DISTINCT, count)):
        frames = list(photograph(view, plan, Optics(seed=k)))
        fw.files.write_stack(folder / "in" / f"{k:04d}", frames, plan)
    for k in range(DISTINCT, count):
        source, target = folder / "in" / f"{k % DISTINCT:04d}", folder / "in" / f"{k:04d}"
        shutil.copytree(source, target, copy_function=os.link)
        description = target / "capture.toml"
        text = description.read_text()
        description.unlink()
        description.write_text(f"{text}\n# {k}\n")
    fw.files.write_rig(folder / "rig.toml", rig)
    areas = {
        "top": fw.evaluate.Area(box=(560, 440, 740, 580)),
        "base": fw.evaluate.Area(box=(60, 60, 360, 960)),
    }
    step = fw.evaluate.PartTolerance("step", "step_height", ("top", "base"), 9.9, 10.1)
    recipe = fw.Recipe(rig=folder / "rig.toml", areas=areas, tolerances=(step,))
    fw.files.write_recipe(folder / "recipe.toml", recipe)


def resident_mb(pid: int) -> float:
    """Memory of a process, MB; 0 where it has ended."""
    try:
        text = Path(f"/proc/{pid}/statm").read_text()
    except OSError:
        return 0.0
    return int(text.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Memory(threading.Thread):
    """Reads the memory of workers while they work."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.pids: set[int] = set()
        self.seen: dict[int, list[float]] = {}
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.wait(SAMPLE_S):
            for pid in list(self.pids):
                self.seen.setdefault(pid, []).append(resident_mb(pid))


def measured(folder: Path, workers: int, scheduler: str | None) -> float:
    """Run the batch, print its figures, and return its time, s."""
    out = folder / f"out-{workers}-{scheduler}.zarr"
    shutil.rmtree(out, ignore_errors=True)
    memory = Memory()
    memory.start()
    begun = time.perf_counter()
    first: list[float] = []

    def told(row: dict[str, object], _: int) -> None:
        first.append(time.perf_counter())
        memory.pids.add(int(str(row["worker"])))

    found = fw.batch.run_batch(
        folder / "in",
        folder / "recipe.toml",
        out,
        workers=workers,
        scheduler=scheduler,
        progress=told,
    )
    took = time.perf_counter() - begun
    memory.over.set()
    memory.join()
    count = len(found.rows)
    steady = (first[-1] - first[workers]) / (count - 1 - workers)
    seconds = float(np.mean([row["seconds"] for row in found.rows]))
    written = sum(p.stat().st_size for p in out.rglob("*") if p.is_file()) / count
    quarters = [np.array_split(v, 4) for v in memory.seen.values() if len(v) >= 8]
    growth = [float(np.median(q[-1]) - np.median(q[0])) for q in quarters]
    peak = max((max(v) for v in memory.seen.values() if v), default=0.0)
    print(
        f"{workers} workers, {scheduler or 'processes'}: {took:.1f} s for {count} scans, start "
        f"{first[0] - begun:.1f} s; steady {1e3 * steady:.1f} ms per scan, a scan takes "
        f"{1e3 * seconds:.1f} ms, overhead {1e3 * (steady * workers - seconds):.1f} ms; "
        f"{written / 1e6:.2f} MB written per scan; memory at most {peak:.0f} MB per worker, "
        f"growth from the first to the last quarter {max(growth, default=0.0):.0f} MB; "
        f"{found.failed} not measured"
    )
    return steady


def main() -> None:
    """Make the captures where they are missing, and run all ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    given = parser.parse_args()
    if not (given.work / "recipe.toml").is_file():
        captures(given.work, given.count)
    read = sum(p.stat().st_size for p in (given.work / "in" / "0000").iterdir())
    print(f"{read / 1e6:.1f} MB read per scan")
    for scheduler in (None, "local"):
        one, two = (measured(given.work, workers, scheduler) for workers in (1, 2))
        print(f"two workers are {one / two:.2f} times as fast as one")


if __name__ == "__main__":
    main()
