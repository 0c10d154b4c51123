"""Looks for known weaknesses of the pinned packages and crates; says what it could not look at.

``--strict`` fails where it could not look: a machine with a network has no excuse.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
NO_NETWORK = (
    "ConnectionError",
    "Could not resolve",
    "Max retries",
    "Name or service not known",
    "ServiceError",
    "Temporary failure",
    "couldn't fetch",
    "error sending request",
    "timed out",
)
"""Words by which the programs tell that they did not reach their data bases."""
NOT_AUDITED = "could not be audited"
"""Words of pip-audit for a package that its data base does not hold; its exit status is 0 then."""
LIMIT_S = 300.0
"""Longest time for one program, s."""


def looked_at(name: str, command: list[str], skipped: bool = True) -> bool:
    """Run a program; False where it found something, ``skipped`` where it could not run, which is
    told."""
    if shutil.which(command[0]) is None:
        print(f"{name}: SKIPPED, {command[0]} is not installed")
        return skipped
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        print(f"{name}: SKIPPED, no answer in {LIMIT_S:.0f} s")
        return skipped
    said = done.stdout + done.stderr
    if done.returncode != 0 and any(words in said for words in NO_NETWORK):
        print(f"{name}: SKIPPED, its data base cannot be reached from here")
        return skipped
    unknown = said.count(NOT_AUDITED)
    print(f"{name}: {'nothing known' if done.returncode == 0 else 'FOUND'}")
    if unknown:
        print(f"{name}: SKIPPED {unknown} of them, which the data base does not hold")
    if done.returncode != 0:
        print(said)
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pip-audit", required=True)
    parser.add_argument("--strict", action="store_true", help="what cannot be audited is an error")
    given = parser.parse_args()
    pins = ["--no-deps", "--disable-pip", "-r", "constraints.txt"]
    results = [
        looked_at("Python packages", [given.pip_audit, *pins], not given.strict),
        looked_at("crates", ["cargo-audit", "audit"], not given.strict),
    ]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
