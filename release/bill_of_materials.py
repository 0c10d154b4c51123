"""Writes what a default install and the kernels consist of, as a CycloneDX bill of materials.

``--kernels`` writes the bill of the crates alone, which every wheel holds. It has neither a date
nor a folder in it, so that the same source gives the same wheel.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

ROOT = Path(__file__).parent.parent
KERNELS = ROOT / "crates" / "bindings" / "kernels.cdx.json"
"""The bill of the crates, which pyproject.toml puts into the wheel."""


def component(kind: str, name: str, version: str, licence: str) -> dict[str, Any]:
    return {
        "type": "library",
        "name": name,
        "version": version,
        "purl": f"pkg:{kind}/{name}@{version}",
        "licenses": [{"license": {"name": licence}}],
    }


def crates() -> list[dict[str, Any]]:
    """Crates that are compiled into the kernels, without those of this project."""
    done = subprocess.run(
        ["cargo", "metadata", "--format-version", "1", "--locked", "--offline"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    packages = json.loads(done.stdout)["packages"]
    return [
        component("cargo", p["name"], p["version"], p["license"] or "not stated")
        for p in packages
        if p["source"] is not None
    ]


def bill(ours: dict[str, Any], components: list[dict[str, Any]]) -> str:
    """A bill of materials as text."""
    whole = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": ours},
        "components": components,
    }
    return json.dumps(whole, indent=1) + "\n"


def whole_bill() -> tuple[str, int, int]:
    """The bill of a default install; how many distributions and crates it holds."""
    from distributions import of_default_install

    ours, *others = of_default_install()
    python = [component("pypi", d.name.lower(), d.version, d.licence) for d in others]
    rust = crates()
    main = component("pypi", ours.name, ours.version, ours.licence)
    return bill(main, [*python, *rust]), len(python), len(rust)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="the bill of a default install")
    parser.add_argument("--kernels", action="store_true", help="the bill of the crates alone")
    given = parser.parse_args()
    if given.kernels:
        # Without its version, which the name of the wheel states.
        ours = {"type": "library", "name": "fringeworks-bindings"}
        KERNELS.write_text(bill(ours, crates()), encoding="utf-8")
        print(f"wrote {KERNELS.relative_to(ROOT)}")
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        text, python, rust = whole_bill()
        given.out.write_text(text, encoding="utf-8")
        print(f"wrote {given.out}: {python} distributions, {rust} crates")
    return 0


if __name__ == "__main__":
    sys.exit(main())
