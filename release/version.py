"""The version of the project: that of the tag, in every file that states it.

``python release/version.py`` prints it. ``--tag v0.2.0`` names every file that states another one;
with ``--write`` it puts the tag's version into them. A clone without tags builds what its
files say.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
TAG = re.compile(r"v(\d+\.\d+\.\d+)(?:(a|b|rc)(\d+))?")
"""Tags of releases, such as ``v0.2.0`` and ``v0.2.0rc1``."""
CARGO = {"a": "alpha", "b": "beta", "rc": "rc"}
"""Cargo's words for what PEP 440 writes as letters."""
PLACES = {
    "Cargo.toml": r'(\[workspace\.package\]\nversion = ")([^"]+)(")',
    "Cargo.lock": r'(name = "fringeworks(?:-bindings)?"\nversion = ")([^"]+)(")',
    "CITATION.cff": r"(\nversion: )(\S+)(\n)",
    "release/conda/recipe.yaml": r'(\n  version: ")([^"]+)(")',
}
"""Files that state the version, and where."""


def of_tag(tag: str) -> tuple[str, str]:
    """Version of a tag as Python writes it and as Cargo does."""
    found = TAG.fullmatch(tag)
    if found is None:
        raise ValueError(f"expected a tag such as v0.2.0 or v0.2.0rc1, got {tag}")
    plain, kind, number = found.groups()
    if kind is None:
        return plain, plain
    return f"{plain}{kind}{number}", f"{plain}-{CARGO[kind]}.{number}"


def stated(root: Path = ROOT) -> dict[str, set[str]]:
    """Versions that each file states."""
    return {
        name: {m[2] for m in re.finditer(where, (root / name).read_text(encoding="utf-8"))}
        for name, where in PLACES.items()
    }


def wanted(name: str, tag: str) -> str:
    """The version that a file must state."""
    python, cargo = of_tag(tag)
    return cargo if name.startswith("Cargo.") else python


def write(tag: str, root: Path = ROOT) -> None:
    """Put the version of a tag into every file."""
    for name, where in PLACES.items():
        path = root / name
        text = path.read_text(encoding="utf-8")
        version = wanted(name, tag)
        path.write_text(re.sub(where, rf"\g<1>{version}\g<3>", text), encoding="utf-8")


def disagreements(tag: str, root: Path = ROOT) -> list[str]:
    """What does not agree with a tag, in one sentence each."""
    said = []
    for name, versions in stated(root).items():
        if versions != {wanted(name, tag)}:
            got = ", ".join(sorted(versions)) or "none"
            said.append(f"{name}: expected version {wanted(name, tag)}, got {got}")
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = re.search(r"^## (.*)$", changes, re.MULTILINE)
    if heading is None or not re.fullmatch(
        rf"{re.escape(of_tag(tag)[0])} \(\d{{4}}-\d\d-\d\d\)", heading[1]
    ):
        got = heading[1] if heading else "none"
        said.append(f"CHANGELOG.md: expected first a heading with version and date, got {got}")
    return said


def screen(root: Path = ROOT) -> str:
    """The newest version's changes: the text of a release."""
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    return re.split(r"^## .*\n", changes, flags=re.MULTILINE)[1].strip() + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tag", help="a tag, such as v0.2.0")
    parser.add_argument("--write", action="store_true", help="put its version into the files")
    parser.add_argument("--changes", action="store_true", help="print the text of the release")
    given = parser.parse_args()
    if given.changes:
        print(screen(), end="")
        return 0
    if given.tag is None:
        print(*sorted(stated()["Cargo.toml"]))
        return 0
    if given.write:
        write(given.tag)
    said = disagreements(given.tag)
    print("\n".join(said) or f"everything states {of_tag(given.tag)[0]}")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
