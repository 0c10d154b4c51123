"""Checks an installed wheel: it is no source tree, its licences are permissive, and it is small.

Compiled Python does not count: it is made on the machine, by pip or at the first import.
"""

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
    size_mb, compiled_mb = sizes_mb(site)
    found = of_default_install()
    for each in found:
        print(f"{each.name} {each.version}: {each.licence}")
    print(
        f"{len(found)} distributions, {size_mb:.0f} MB, and {compiled_mb:.0f} MB of compiled "
        f"Python; cargo: {shutil.which('cargo') or 'none'}"
    )
    others = [each.name for each in found if not each.permissive]
    if others:
        print(f"expected permissive licences only, got others in {', '.join(others)}")
        return 1
    if size_mb > most_mb:
        print(f"expected up to {most_mb:g} MB, got {size_mb:.0f} MB")
        return 1
    return 0


def sizes_mb(site: Path) -> tuple[float, float]:
    """What distributions bring, and what Python has compiled of it on this machine, 2²⁰ bytes."""
    brought = compiled = 0
    for entry in site.iterdir():
        if entry.name.startswith(NOT_OURS):
            continue
        for file in entry.rglob("*") if entry.is_dir() else (entry,):
            if file.is_file():
                size = file.stat().st_size
                brought += size * (file.suffix != ".pyc")
                compiled += size * (file.suffix == ".pyc")
    return brought / 2**20, compiled / 2**20


if __name__ == "__main__":
    sys.exit(main())
