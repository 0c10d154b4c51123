"""Writes what a default install and the kernels consist of, as a CycloneDX bill of materials."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from distributions import of_default_install

ROOT = Path(__file__).parent.parent


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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    ours, *others = of_default_install()
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": component("pypi", ours.name, ours.version, ours.licence)},
        "components": [
            *(component("pypi", d.name.lower(), d.version, d.licence) for d in others),
            *crates(),
        ],
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(bill, indent=1) + "\n")
    count = len(bill["components"]) - len(others)
    print(f"wrote {out}: {len(others)} distributions, {count} crates")
    return 0


if __name__ == "__main__":
    sys.exit(main())
