"""What was built and what ran on each platform, as the page docs/platforms.md.

Looks at every wheel in a folder, installs those of this machine into an empty environment of each
Python, runs ``fringeworks selftest --quick`` there, and does the same under an emulator for other
machines. What cannot run here is said. Results are kept in release/platforms.json, by the name of a
wheel and its hash, so that another machine adds its own.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

ROOT = Path(__file__).parent.parent
KEPT = ROOT / "release" / "platforms.json"
PAGE = ROOT / "docs" / "platforms.md"
PLATFORMS = {
    "Linux x86-64, glibc": ("manylinux", "x86_64"),
    "Linux ARM, glibc": ("manylinux", "aarch64"),
    "Linux x86-64, musl 1.2": ("musllinux", "x86_64"),
    "Linux ARM, musl 1.2": ("musllinux", "aarch64"),
    "macOS, Apple processors": ("macosx", "arm64"),
    "macOS, Intel": ("macosx", "x86_64"),
    "Windows x86-64": ("win", "amd64"),
    "Windows ARM": ("win", "arm64"),
}
"""Platforms of a release: words of the names of their wheels."""
NOT_RUN = {
    "musllinux": "not run: no Python for musl on this machine at hand",
    "macosx": "not run: no macOS at hand",
    "win": "not run: no Windows at hand",
}
"""Why a wheel was not run here, by the system of its name; the release's workflow runs it."""
LIMIT_S = 1800.0
"""Longest time for one program, s: an emulator is some thirty times slower."""
NOTEBOOK = str(ROOT / "release" / "notebook.py")
"""Program that runs the notebook of the documentation."""
SELFTEST = ("-m", "fringeworks", "selftest", "--quick")
SMALL = (
    "-c",
    "import fringeworks as fw; from fringeworks import simulate\n"
    "pair = simulate.standard_scene('parabola', size=96, fringes=8, noise=2, bits=8, seed=1)\n"
    "for name in ('fourier', 'windowed'):\n"
    "    found = fw.evaluate.errors(fw.reconstruct(pair, name).surface, pair.truth_mm)\n"
    "    assert found.within_2_sigma > 0.9, found\n"
    "    print(f'{found.mean_abs_error_mm:.5f} mm', end=' ')\n",
)
"""A pair of frames by two methods: what an emulator does in seconds, before the self-test."""
HEAD = """# Platforms

What was built, and what ran, for each platform. `make platforms` looks at the wheels, runs what
this machine can run, and writes this page; `.github/workflows/release.yml` builds and runs the
wheels on machines of all these platforms.

One wheel serves every Python from 3.11 (abi3). *Looked at* means: the kernels are made for the
machine of the wheel's name, load no library but those that every such system has, export the
start of the module, and call Python by its stable interface only. *Ran* means: installed from
that very wheel into an empty environment, imported, and `fringeworks selftest --quick` passed;
*notebook*: so did the cells of `docs/first_look.ipynb`, with Matplotlib installed beside it.
Under an emulator, a small pair of frames is measured first. Python for musl was compiled from
Debian's source of 3.11 by `musl-gcc`, and ran with musl 1.2.5: NumPy's wheels crash under 1.2.3.

Wheels of other platforms than that of the machine that built them were linked by zig. Those of a
release are built on machines of their own, the ones for Windows by the compiler of Microsoft.

"""


@dataclass(frozen=True)
class Run:
    """One self-test of an installed wheel."""

    where: str
    ok: bool
    said: str


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def call(command: list[str], env: dict[str, str] | None = None) -> tuple[bool, str]:
    """Whether a program ended well, and the last line that it printed."""
    try:
        done = subprocess.run(
            command, env=env, capture_output=True, text=True, timeout=LIMIT_S, check=False, cwd="/"
        )
    except subprocess.TimeoutExpired:
        return False, f"no answer in {LIMIT_S:.0f} s"
    except OSError as error:
        return False, str(error.strerror)
    lines = (done.stdout.strip() or done.stderr.strip()).splitlines()
    return done.returncode == 0, lines[-1] if lines else ""


def alone() -> dict[str, str]:
    """Variables of a process that sees neither the sources nor other packages."""
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}


def run_here(wheel: Path, python: list[str]) -> list[Run]:
    """Install a wheel into an empty environment of a Python of this machine, and test it: by the
    self-test, and with Matplotlib by the notebook of the documentation."""
    *before, name = python
    _, version = call([*python, "-c", "import platform; print(platform.python_version())"])
    where = f"Python {version}, {platform.system()} {platform.machine()}"
    constrained = alone() | {"PIP_CONSTRAINT": str(ROOT / "constraints.txt")}
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        inner = [*before, str(Path(folder) / "bin" / "python")]
        pip = [*inner, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
        plans = {
            where: [
                [*before, name, "-m", "venv", folder],
                [*pip, str(wheel)],
                [*inner, "-I", *SELFTEST],
            ],
            f"{where}, notebook": [[*pip, f"{wheel}[plots]"], [*inner, "-I", NOTEBOOK]],
        }
        for title, steps in plans.items():
            ok, said = True, ""
            for step in steps:
                if ok:
                    ok, said = call(step, constrained)
            runs.append(Run(title, ok, said))
    return runs


def accepted(machine: str) -> list[str]:
    """Platforms of wheels that a Python of a machine takes."""
    if machine.startswith("musl-"):
        plain = machine.removeprefix("musl-")
        return [f"musllinux_1_{minor}_{plain}" for minor in (2, 1)]
    return [
        *(f"manylinux_2_{minor}_{machine}" for minor in (28, 27, 17)),
        f"manylinux2014_{machine}",
    ]


def run_emulated(wheel: Path, machine: str, emulator: list[str]) -> list[Run]:
    """Unpack a wheel and what it needs for another machine, and test it under an emulator; that of
    the system musl needs none, and runs the notebook as well."""
    _, version = call([*emulator, "-c", "import platform; print(platform.python_version())"])
    musl = machine.startswith("musl-")
    below = "with musl" if musl else f"under {Path(emulator[0]).name}"
    where = f"Python {version}, Linux {machine.removeprefix('musl-')} {below}"
    plain = ".".join(version.split(".")[:2])
    with tempfile.TemporaryDirectory() as folder:
        asked = [word for tag in accepted(machine) for word in ("--platform", tag)]
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
        target = ["--target", folder, "--python-version", plain, "--implementation", "cp"]
        constrained = alone() | {"PIP_CONSTRAINT": str(ROOT / "constraints.txt")}
        what = f"{wheel}[plots]" if musl else str(wheel)
        ok, said = call([*pip, *target, *asked, what], constrained)
        if not ok:
            return [Run(where, False, said)]
        env = alone() | {"PYTHONPATH": folder, "OPENBLAS_NUM_THREADS": "1"}
        steps = {f"{where}, a small pair": SMALL, f"{where}, self-test": SELFTEST}
        if musl:
            steps[f"{where}, notebook"] = (NOTEBOOK,)
        return [Run(name, *call([*emulator, *words], env)) for name, words in steps.items()]


def of(name: str) -> str | None:
    """Platform of a wheel, by its name."""
    last = name.removesuffix(".whl").rpartition("-")[2]
    for title, (system, machine) in PLATFORMS.items():
        if last.startswith(system) and last.endswith(machine):
            return title
    return None


def runs_here(wheel: Path) -> bool:
    system = {"Linux": "manylinux", "Darwin": "macosx", "Windows": "win"}[platform.system()]
    last = wheel.stem.rpartition("-")[2]
    return last.startswith(system) and last.endswith(platform.machine().lower())


def measure(
    wheel: Path, pythons: list[list[str]], emulators: dict[str, list[str]]
) -> dict[str, Any]:
    """Look at a wheel and run it where this machine can."""
    from binaries import look  # the page can be written without its package

    found = look(wheel)
    here = pythons if runs_here(wheel) else []
    runs = [run for python in here for run in run_here(wheel, python)]
    for machine, emulator in emulators.items():
        system = "musllinux" if machine.startswith("musl-") else "manylinux"
        if wheel.stem.endswith(f"_{machine.removeprefix('musl-')}") and system in wheel.stem:
            runs += run_emulated(wheel, machine, emulator)
    for run in runs:
        print(f"{wheel.name}: {run.where}: {'passed' if run.ok else 'FAILED'}: {run.said}")
    return {
        "sha256": digest(wheel),
        "size": wheel.stat().st_size,
        "loads": list(found.libraries),
        "glibc": found.glibc,
        "faults": list(found.faults),
        "runs": [vars(run) for run in runs],
    }


def with_earlier_runs(found: dict[str, Any], earlier: dict[str, Any] | None) -> dict[str, Any]:
    """What was measured of a wheel, with the runs of the same bytes in other places."""
    if earlier is None or earlier["sha256"] != found["sha256"]:
        return found
    now = {run["where"] for run in found["runs"]}
    return found | {
        "runs": [*(r for r in earlier["runs"] if r["where"] not in now), *found["runs"]]
    }


def page(kept: dict[str, Any]) -> str:
    """The page of what is known."""
    lines = ["| platform | wheel | looked at | ran |", "|---|---|---|---|"]
    for title in PLATFORMS:
        names = [name for name in kept if of(name) == title]
        if not names:
            lines.append(f"| {title} | not built yet | – | not run |")
        for name in names:
            one = kept[name]
            looked = "; ".join(one["faults"]) or "no fault"
            runs = "<br>".join(
                f"{r['where']}: {'passed' if r['ok'] else r['said']}" for r in one["runs"]
            )
            size = f"{one['size'] / 2**20:.1f} MB"
            runs = runs or NOT_RUN.get(PLATFORMS[title][0], "not run")
            lines.append(f"| {title} | `{name}`, {size} | {looked} | {runs} |")
    loads = [
        "",
        "What the kernels load:",
        "",
        "| wheel | libraries | newest glibc asked for |",
        "|---|---|---|",
    ]
    for name, one in sorted(kept.items()):
        loads.append(f"| `{name}` | {', '.join(one['loads']) or 'none'} | {one['glibc'] or '–'} |")
    return HEAD + "\n".join([*lines, *loads]) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheels", type=Path, default=ROOT / "dist")
    parser.add_argument(
        "--pythons", nargs="+", default=[sys.executable], help="'chroot FOLDER PYTHON' serves too"
    )
    parser.add_argument(
        "--emulate", action="append", default=[], help="MACHINE=COMMAND, or musl-MACHINE=PYTHON"
    )
    given = parser.parse_args()
    emulators = {
        machine: shlex.split(command)
        for machine, _, command in (one.partition("=") for one in given.emulate)
    }
    pythons = [shlex.split(python) for python in given.pythons]
    wheels = sorted(given.wheels.glob("*.whl"))
    measured = {one.name: measure(one.resolve(), pythons, emulators) for one in wheels}
    # Read at the end: runs under an emulator take long, and others may have been added.
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    for name, found in measured.items():
        kept[name] = with_earlier_runs(found, kept.get(name))
    KEPT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")
    print(f"wrote {PAGE.relative_to(ROOT)}")
    failed = [
        name
        for name, one in kept.items()
        if one["faults"] or not all(run["ok"] for run in one["runs"])
    ]
    print("\n".join(f"FAILED: {name}" for name in failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
