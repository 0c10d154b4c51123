"""Builds the wheel so that the same source and compiler give the same bytes in any folder.

``--against WHEEL`` builds in a copy of the tree, in another folder, and compares the bytes.
``--target TRIPLE`` builds for another platform, with zig as its linker; the standard library of
that platform comes from ``rustup target add TRIPLE``.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
EPOCH = "315532800"
"""Time of the files in a wheel where git knows none: 1980-01-01, the first that a zip holds."""
COPIED = ("Cargo.toml", "Cargo.lock", "pyproject.toml", "README.md", "LICENSE", "crates", "src")
"""What a wheel is built from."""
NAMED = """#!/bin/sh
# maturin 1.16 lists the start of the module as PyInit_PACKAGE._core, which no symbol is called.
for word in "$@"; do
  case "$word" in
    link-arg=*.def) sed -i 's/PyInit_[a-z]*\\._core/PyInit__core/' "${word#link-arg=}" ;;
  esac
done
exec "$@"
"""
"""Wrapper of rustc for targets of Windows that are linked as by GNU."""
LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.pyc", "_core*.so", "_core*.pyd", "target")


def said(*command: str, cwd: Path = ROOT) -> str:
    """What a program prints; nothing where it is missing or fails."""
    if shutil.which(command[0]) is None:
        return ""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def renamed(source: Path) -> list[str]:
    """Flags for rustc that take the folders of this machine out of what it compiles."""
    home = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo"))
    indexes = sorted((home / "registry" / "src").glob("*"))
    pairs = [(source, "/fringeworks"), *((index, "/crates") for index in indexes)]
    if sysroot := said("rustc", "--print", "sysroot"):
        pairs.append((Path(sysroot), "/rust"))
    return [f"--remap-path-prefix={folder}={name}" for folder, name in pairs]


def environment(source: Path, compiled: Path | None = None) -> dict[str, str]:
    """Variables of a build: a fixed time, and no folders of this machine."""
    found = dict(os.environ)
    given = found.pop("RUSTFLAGS", "").split()
    found["CARGO_ENCODED_RUSTFLAGS"] = "\x1f".join([*given, *renamed(source)])
    if compiled is not None:
        found["CARGO_TARGET_DIR"] = str(compiled)
    time = said("git", "log", "-1", "--format=%ct") or EPOCH
    found.setdefault("SOURCE_DATE_EPOCH", time)
    return found


def build(source: Path, out: Path, *words: str, compiled: Path | None = None) -> Path:
    """Build a wheel; its path."""
    subprocess.run(["cargo", "fetch", "--locked", "--quiet"], cwd=source, check=True)
    before = set(out.glob("*.whl"))
    with tempfile.TemporaryDirectory() as folder:
        env = environment(source, compiled)
        if any("-windows-gnu" in word for word in words):
            wrapper = Path(folder) / "rustc_named"
            wrapper.write_text(NAMED, encoding="utf-8")
            wrapper.chmod(0o755)
            env["RUSTC_WRAPPER"] = str(wrapper)
        subprocess.run(
            ["maturin", "build", "--release", "--locked", "--quiet", "--out", str(out), *words],
            cwd=source,
            env=env,
            check=True,
        )
    new = sorted(set(out.glob("*.whl")) - before) or sorted(out.glob("*.whl"), key=os.path.getmtime)
    return new[-1]


def copy(folder: Path) -> Path:
    """What a wheel is built from, in another folder."""
    place = folder / "elsewhere" / "fringeworks"
    place.mkdir(parents=True)
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, place / name, ignore=LEFT_OUT)
        else:
            shutil.copy2(ROOT / name, place / name)
    return place


def differences(one: Path, other: Path) -> list[str]:
    """Members of two wheels that differ, and what else does."""
    if one.read_bytes() == other.read_bytes():
        return []
    with zipfile.ZipFile(one) as a, zipfile.ZipFile(other) as b:
        names = sorted({*a.namelist(), *b.namelist()})
        both = set(a.namelist()) & set(b.namelist())
        found = [n for n in names if n not in both or a.read(n) != b.read(n)]
    return found or ["order, times or modes of the members"]


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--target", help="another platform, as rustc names it")
    parser.add_argument("--sdist", action="store_true", help="the source distribution as well")
    parser.add_argument("--against", type=Path, help="a wheel whose bytes are compared")
    given = parser.parse_args()
    words = ["--sdist"] if given.sdist else []
    if given.target is not None:
        words += ["--target", given.target, "--zig"]
        words += ["--compatibility", "musllinux_1_2"] if "-musl" in given.target else []
        words += ["--compatibility", "manylinux_2_28"] if "-linux-gnu" in given.target else []
    if given.against is None:
        print(build(ROOT, given.out.resolve(), *words))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        place = copy(Path(folder))
        wheel = build(place, Path(folder), *words, compiled=Path(folder) / "compiled")
        found = differences(given.against, wheel)
        print(f"{given.against.name}: {digest(given.against)}\nbuilt again: {digest(wheel)}")
    print(f"differ in {', '.join(found)}" if found else "equal bytes")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
