"""Checks an installed wheel: it is no source tree, its licences are permissive, and it is small."""

from __future__ import annotations

import argparse
import shutil
import sys
import sysconfig
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from distributions import of_default_install

NOT_OURS = ("pip", "setuptools", "_distutils_hack", "pkg_resources", "__pycache__")
"""What a new environment holds before anything is installed, by the beginning of its name."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most-mb", type=float, required=True)
    most_mb = parser.parse_args().most_mb
    import fringeworks

    site = Path(sysconfig.get_path("purelib"))
    if site not in Path(fringeworks.__file__).parents:
        print(f"fringeworks comes from {fringeworks.__file__}, expected {site}")
        return 1
    beside = Path(sys.executable).with_name("cargo")
    if beside.exists():
        print(f"expected an environment without cargo, got {beside}")
        return 1
    size_mb = (
        sum(
            file.stat().st_size
            for entry in site.iterdir()
            if not entry.name.startswith(NOT_OURS)
            for file in (entry.rglob("*") if entry.is_dir() else (entry,))
            if file.is_file()
        )
        / 2**20
    )
    found = of_default_install()
    for each in found:
        print(f"{each.name} {each.version}: {each.licence}")
    print(f"{len(found)} distributions, {size_mb:.0f} MB; cargo: {shutil.which('cargo') or 'none'}")
    others = [each.name for each in found if not each.permissive]
    if others:
        print(f"expected permissive licences only, got others in {', '.join(others)}")
        return 1
    if size_mb > most_mb:
        print(f"expected up to {most_mb:g} MB, got {size_mb:.0f} MB")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
