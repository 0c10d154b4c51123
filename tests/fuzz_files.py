"""Damaged files for every reader, as many as there is time for: ``python -m tests.fuzz_files``.

Workers in processes of their own read the files, so that a reader that crashes or hangs is found too.
The file that was being read is still there then. Every file follows from the name of its reader, a
round and a number.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fringeworks import InputError
from tests import hostile

ROUND = 200
"""Files of a reader before the next one has its turn."""
HANG_SECONDS = 60
"""Time after which reading a file of a few kilobytes counts as hanging."""
MEMORY_BYTES = 8 << 30
"""Addresses that a worker may take; the limit of files is 2 GB."""


def place(folder: Path, target: hostile.Target, content: bytes) -> Path:
    """A damaged file, and the good ones beside it."""
    path = folder / target.name.replace("/", "-") / target.name
    if not path.parent.is_dir():
        for name, data in target.beside.items():
            beside = folder / target.name.replace("/", "-") / name
            beside.parent.mkdir(parents=True, exist_ok=True)
            beside.write_bytes(data)
        path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def work(folder: Path, seed: int, seconds: float) -> dict[str, list[int]]:
    """Read damaged files until the time is over: how many, and how many were refused, by reader.

    A file that raises anything but an ``InputError`` is kept as ``found-…``, with the error.
    """
    if sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    counts: dict[str, list[int]] = collections.defaultdict(lambda: [0, 0])
    (folder / "good").mkdir()
    targets = hostile.targets(folder / "good")
    for target in targets:
        target.read(place(folder / "read", target, target.content))
    end, number = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        for target in targets:
            count = counts[target.name]
            many = int(ROUND * target.share)
            for content in hostile.mutations(target, many, seed=seed + number):
                path = place(folder / "read", target, content)
                count[0] += 1
                faulthandler.dump_traceback_later(HANG_SECONDS, exit=True)
                try:
                    target.read(path)
                except InputError as error:
                    count[1] += 1
                    if "\n" in str(error) or len(str(error)) > 1500:
                        _keep(folder, target, content, error)
                except Exception as error:
                    _keep(folder, target, content, error)
                faulthandler.cancel_dump_traceback_later()
            if time.monotonic() > end:
                break
        number += 1000
    return counts


def _keep(folder: Path, target: hostile.Target, content: bytes, error: Exception) -> None:
    kept = folder / f"found-{len(list(folder.glob('found-*')))}-{target.name.replace('/', '-')}"
    kept.write_bytes(content)
    print(f"{kept}: {type(error).__name__}: {str(error)[:300]}", file=sys.stderr, flush=True)


def main() -> int:
    """Fuzz in several processes; print a table, and return 1 if anything was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder of the files that were found")
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker is not None:
        counts = work(given.keep, given.seed + given.worker, given.minutes * 60)
        print(json.dumps(counts))
        return 0
    folder = given.keep or Path(tempfile.mkdtemp(prefix="fringeworks-fuzz-"))
    workers = []
    for number in range(given.workers):
        own = folder / str(number)
        own.mkdir(parents=True, exist_ok=True)
        words = [
            "--minutes",
            given.minutes,
            "--seed",
            given.seed,
            "--keep",
            own,
            "--worker",
            number,
        ]
        call = [sys.executable, "-m", "tests.fuzz_files", *map(str, words)]
        workers.append(subprocess.Popen(call, stdout=subprocess.PIPE, text=True))
    total: dict[str, list[int]] = collections.defaultdict(lambda: [0, 0])
    failed = 0
    for number, worker in enumerate(workers):
        out = worker.communicate()[0]
        if worker.returncode:
            print(f"worker {number} ended with {worker.returncode}; its files are in {folder}")
            failed += 1
            continue
        for name, (read, refused) in json.loads(out).items():
            total[name] = [total[name][0] + read, total[name][1] + refused]
    for name, (read, refused) in total.items():
        print(f"{name:20} {read:9} files {refused:9} refused")
    found = len(list(folder.glob("*/found-*")))
    print(f"{sum(read for read, _ in total.values())} files, {found} kept in {folder}")
    return int(bool(failed or found))


if __name__ == "__main__":
    sys.exit(main())
