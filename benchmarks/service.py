"""The service under load: many scans, clients that vanish, garbage, and a worker that is killed.

``python -m benchmarks.service --scans 1000 --kills 20`` prints what became of every scan, the
memory of server and worker over time, and how much later than its points a cloud was at the client
who waited for it. Under other load, ``chrt -r 1`` before the command gives it the processors that a
scanner has for itself.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.service_running import TOKEN, Running

SEEN = 10
"""Lines of memory that are printed."""
GARBAGE = 10_000_000
"""Bytes of a body that is refused."""


def memory_mb(pid: int | None) -> float:
    """Memory of a process, MB; NaN where there is none."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 1e6
    except OSError:
        return float("nan")


def vanish(service: Running, body: bytes = b"") -> None:
    """Begin a download and an order, and go."""
    asks = f"Host: 127.0.0.1:{service.port}\r\nAuthorization: Bearer {TOKEN}\r\n".encode()
    service.raw(b"GET /v1/jobs/last/cloud HTTP/1.1\r\n" + asks + b"\r\n", read=False)
    service.raw(
        b"POST /v1/scans HTTP/1.1\r\n" + asks + b"Content-Length: 1000000\r\n\r\n" + body,
        read=False,
    )


def main() -> None:
    """Run it."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--scans", type=int, default=100)
    options.add_argument("--kills", type=int, default=5)
    options.add_argument("--format", default="npz", choices=("npz", "ply", "depth"))
    given = options.parse_args()
    chance = random.Random(1)
    killed_at = set(chance.sample(range(2, given.scans), given.kills))
    late_ms, plain_ms, memory, ended = [], [], [], Counter()
    with tempfile.TemporaryDirectory() as folder:
        service = Running(folder, "--keep", "50")
        try:
            service.ended(service.scan())
            started = time.monotonic()
            for k in range(given.scans):
                job = service.scan(formats=[given.format])
                if k in killed_at:
                    time.sleep(chance.random() * 0.2)
                    service.kill_worker()
                elif k % 20 == 7:
                    vanish(service, b"x" * 100_000)
                elif k % 100 == 50:
                    assert service.web.post("/v1/scans", content=bytes(GARBAGE)).status_code == 413
                asked = time.monotonic()
                place = f"/v1/jobs/{job['number']}/cloud"
                how = {"wait_s": 60, "format": given.format}
                cloud = service.web.get(place, params=how)
                there = time.monotonic()
                found = service.ended(job)
                ended[found["state"], found["attempts"]] += 1
                asked_plainly = time.monotonic()
                service.web.get("/health")
                plain_ms.append(1e3 * (time.monotonic() - asked_plainly))
                if found["attempts"] == 1 and cloud.status_code == 200:
                    times = found["result"]["timing"]
                    late_ms.append(1e3 * (there - asked - times["taking_s"] - times["computing_s"]))
                if k % max(1, given.scans // SEEN) == 0:
                    memory.append((memory_mb(service.process.pid), memory_mb(service.worker())))
            seconds = time.monotonic() - started
            print(f"{given.scans} scans in {seconds:.0f} s; (state, attempts): {dict(ended)}")
            print(f"later than frames and points: {np.percentile(late_ms, [50, 95, 99])} ms")
            print(f"GET /health meanwhile: {np.percentile(plain_ms, [50, 95, 99])} ms")
            print("load of the machine:", os.getloadavg(), "on", os.cpu_count(), "cores")
            print("server and worker, MB:", [f"{a:.0f} {b:.0f}" for a, b in memory])
            print("restarts:", service.web.get("/v1/status").json()["worker_restarts"])
            print("results kept:", len(list((Path(folder) / "srv" / "results").iterdir())))
            print("said:", service.errors() or "nothing")
        finally:
            service.close()


if __name__ == "__main__":
    main()
