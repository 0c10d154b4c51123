"""Which wheel was tested: records of its bytes, and the check that nothing else is published.

``record`` writes the hash of a wheel with what ran on it, after the tests have passed. ``verify``
fails where a file that is to be published has no record with the same hash, or another version
than the tag.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from version import of_tag


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def record(files: list[Path], ran: str, out: Path) -> None:
    """Write what was run on these files, here."""
    here = {
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "ran": ran,
    }
    found = [{"file": path.name, "sha256": digest(path), **here} for path in files]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def verify(files: list[Path], records: list[Path], tag: str, wheels: int) -> list[str]:
    """What must not be published, in one sentence each."""
    known = [one for path in records for one in json.loads(path.read_text(encoding="utf-8"))]
    said = []
    version = of_tag(tag)[0]
    for path in files:
        if not path.name.startswith(f"fringeworks-{version}-") and path.name != (
            f"fringeworks-{version}.tar.gz"
        ):
            said.append(f"{path.name}: expected version {version} of the tag {tag}")
        tested = {one["sha256"] for one in known if one["file"] == path.name}
        if not tested:
            said.append(f"{path.name}: expected a record of its tests, got none")
        elif tested != {digest(path)}:
            said.append(f"{path.name}: expected the bytes that were tested, got others")
    found = sum(path.suffix == ".whl" for path in files)
    if found != wheels:
        said.append(f"expected {wheels} wheels, got {found}")
    return said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["record", "verify"])
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--ran", help="what was run, in words")
    parser.add_argument("--out", type=Path, help="the record that is written")
    parser.add_argument("--records", type=Path, help="folder of the records")
    parser.add_argument("--tag")
    parser.add_argument("--wheels", type=int, help="how many wheels there are")
    given = parser.parse_args()
    if given.what == "record":
        record(given.files, given.ran, given.out)
        return 0
    records = sorted(given.records.rglob("*.json"))
    said = verify(given.files, records, given.tag, given.wheels)
    print("\n".join(said) or f"{len(given.files)} files are those that were tested")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
