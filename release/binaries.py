"""What the compiled kernels of a wheel need: libraries, and functions of Python.

A wheel for a platform that is not at hand can be looked at: its kernels must be made for the
platform of its name, export the start of the module, load no library but those that the system
always has, and call Python by its stable interface only.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import lief

SYSTEM = {
    "ELF": r"(ld-linux|ld-musl|libc|libm|libdl|libpthread|librt|libgcc_s)[-.\w]*",
    "PE": r"python3\.dll|(kernel32|ntdll|ws2_32|advapi32|userenv|bcrypt|bcryptprimitives|msvcrt"
    r"|api-ms-win-[-\w]+|vcruntime\d+|ucrtbase)\.dll",
    "MACHO": r"/usr/lib/lib(System\.B|iconv\.2|charset\.1)\.dylib",
}
"""Libraries that every system of a kind has, or Python itself brings."""
MACHINES = {
    "x86_64": {"X86_64"},
    "amd64": {"AMD64"},
    "aarch64": {"AARCH64"},
    "arm64": {"ARM64"},
    "universal2": {"X86_64", "ARM64"},
}
"""Last word of a wheel's platform, and the machines that its kernels are made for."""
START = "PyInit__core"
"""The function by which Python starts the module."""
GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)")


@dataclass(frozen=True)
class Looked:
    """What was found in the kernels of a wheel."""

    wheel: str
    kind: str
    machines: tuple[str, ...]
    libraries: tuple[str, ...]
    glibc: str
    faults: tuple[str, ...]


def parts(path: Path) -> list[lief.Binary]:
    """The binaries in a file; those of macOS may hold two."""
    if lief.is_macho(str(path)):
        found = lief.MachO.parse(str(path))
        # The binaries of a file end with it: each is taken out by its machine.
        machines = [] if found is None else [one.header.cpu_type for one in found]
        return [found.take(machine) for machine in machines]
    one = lief.parse(str(path))
    return [] if one is None else [one]


def kind_of(binary: lief.Binary) -> str:
    return binary.format.name


def machine_of(binary: lief.Binary) -> str:
    header = binary.header
    for name in ("machine_type", "machine", "cpu_type"):
        if hasattr(header, name):
            return str(getattr(header, name)).rpartition(".")[2]
    return "unknown"


def newest_glibc(path: Path) -> str:
    """Newest version of glibc whose functions are asked for."""
    found = GLIBC.findall(path.read_bytes().decode("latin-1"))
    return "{}.{}".format(*max((int(a), int(b)) for a, b in found)) if found else ""


def faults_of(wheel: str, binaries: list[lief.Binary], glibc: str) -> list[str]:
    """What is wrong with the kernels of a wheel."""
    said = []
    last = wheel.removesuffix(".whl").rpartition("-")[2]
    platform = next((name for name in MACHINES if last.endswith(name)), "")
    machines = {machine_of(one) for one in binaries}
    if machines != MACHINES.get(platform):
        said.append(f"made for {', '.join(sorted(machines))}, expected those of {last}")
    for one in binaries:
        allowed = re.compile(SYSTEM[kind_of(one)], re.IGNORECASE)
        said += [f"loads {name}" for name in libraries_of(one) if not allowed.fullmatch(name)]
        if START not in exported(one):
            said.append(f"does not export {START}")
    promised = re.search(r"manylinux_(\d+)_(\d+)_", last)
    if (
        promised
        and glibc
        and tuple(map(int, glibc.split("."))) > tuple(map(int, promised.groups()))
    ):
        said.append(f"asks for glibc {glibc}, and its name says {promised[1]}.{promised[2]}")
    return said


def libraries_of(binary: lief.Binary) -> list[str]:
    if kind_of(binary) == "MACHO":
        # The first command of a library names itself.
        own = {c.name for c in binary.commands if "ID_DYLIB" in str(c.command)}
        return [one.name for one in binary.libraries if one.name not in own]
    return [str(getattr(one, "name", one)) for one in binary.libraries]


def exported(binary: lief.Binary) -> set[str]:
    """Names of functions; those of macOS begin with a line."""
    names = {str(function.name) for function in binary.exported_functions}
    return {n.removeprefix("_") for n in names} if kind_of(binary) == "MACHO" else names


def stable(wheel: Path) -> list[str]:
    """What abi3audit says of functions outside of the stable interface."""
    done = subprocess.run(
        [sys.executable, "-m", "abi3audit", "--strict", str(wheel)],
        capture_output=True,
        text=True,
        check=False,
    )
    return [] if done.returncode == 0 else [(done.stdout + done.stderr).strip()]


def look(wheel: Path) -> Looked:
    """Look at the kernels of one wheel."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(wheel) as archive:
        (member,) = (n for n in archive.namelist() if re.search(r"/_core[^/]*\.(so|pyd)$", n))
        path = Path(archive.extract(member, folder))
        binaries = parts(path)
        glibc = newest_glibc(path) if binaries and kind_of(binaries[0]) == "ELF" else ""
        found = faults_of(wheel.name, binaries, glibc) + stable(wheel)
        return Looked(
            wheel.name,
            kind_of(binaries[0]) if binaries else "unknown",
            tuple(sorted(machine_of(one) for one in binaries)),
            tuple(sorted({name for one in binaries for name in libraries_of(one)})),
            glibc,
            tuple(found),
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheels", type=Path, nargs="+")
    bad = 0
    for wheel in parser.parse_args().wheels:
        found = look(wheel)
        glibc = f", glibc {found.glibc}" if found.glibc else ""
        print(f"{found.wheel}: {found.kind} {', '.join(found.machines)}{glibc}")
        print(f"  loads {', '.join(found.libraries) or 'nothing'}")
        for fault in found.faults:
            print(f"  FAULT: {fault}")
        bad += bool(found.faults)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
