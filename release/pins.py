"""Writes the pins with the hash of every file that may be installed, from constraints.txt.

``pip install --require-hashes -r requirements/hashed-service.txt`` then refuses a file that
somebody has replaced. The files hold no address: which registry serves them is the user's choice.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
FILES = {
    "service": ("pyproject.toml", "--extra", "service"),
    "all": ("pyproject.toml", "--extra", "all"),
    "release": ("requirements/release.txt",),
}
"""Names of the hashed files, and what their packages follow from: what the container image
installs, what a laboratory installs, and what a release is made with."""
HEAD = (
    "# Made by `make pins` from constraints.txt: pins for Linux, macOS and Windows, with hashes.\n"
)
OPTIONS = (
    *("--quiet", "--universal", "--python-version", "3.11", "--generate-hashes"),
    *("--no-emit-index-url", "--no-header", "--no-annotate", "--constraint", "constraints.txt"),
)


def hashed(source: tuple[str, ...]) -> str:
    """Pins with hashes of everything that follows from a source."""
    command = [sys.executable, "-m", "uv", "pip", "compile", *OPTIONS, *source]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    return HEAD + done.stdout


def main() -> int:
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, source in FILES.items():
        path = ROOT / "requirements" / f"hashed-{name}.txt"
        path.write_text(hashed(source), encoding="utf-8")
        print(f"wrote {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
