"""Imports run one way, files stay small, and the binary keeps its promises."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import fringeworks
from fringeworks import Reason, _core

SOURCE = Path(fringeworks.__file__).parent
ROOT = SOURCE.parent.parent
MODULES = sorted(SOURCE.rglob("*.py"))

# Rooms in the order of the light: a room imports from rooms above it in this list only.
ROOMS = [
    ["_core", "types"],
    ["patterns", "surface", "rig"],
    ["signal"],
    ["pair", "stack"],
    ["simulate"],
    ["files"],
    ["pipeline"],
    ["evaluate"],
    ["report"],
    ["showcase"],
    ["cli"],
]
# Rooms that compute: no disk, no screen.
PURE = {"types", "patterns", "surface", "rig", "signal", "pair", "stack", "simulate"}
OUTER = {"PIL", "tifffile", "h5py", "matplotlib", "rich", "typer", "pydantic", "tomli_w", "pathlib"}


def layer_of(module: str) -> int:
    return next(k for k, names in enumerate(ROOMS) if module in names)


def imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            if node.module == "fringeworks":
                found += [f"fringeworks.{alias.name}" for alias in node.names]
            else:
                found.append(node.module)
    return found


def room(path: Path) -> str:
    return path.relative_to(SOURCE).with_suffix("").parts[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_imports_run_one_way(path):
    here = room(path)
    if here in ("__init__", "__main__"):
        return
    for name in imports(path):
        if name.startswith("fringeworks."):
            other = name.split(".")[1]
            same = other == here
            assert same or layer_of(other) < layer_of(here), f"{path.name} imports {name}"
            assert same or "._" not in name.replace("._core", ""), (
                f"{path.name} reaches into {name}"
            )
        elif here in PURE:
            assert name.split(".")[0] not in OUTER, f"{path.name} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_files_stay_readable(path):
    assert len(path.read_text().splitlines()) <= 430


def test_kernels_know_nothing_of_python():
    manifest = (ROOT / "crates/fringeworks/Cargo.toml").read_text()
    assert "pyo3" not in manifest
    for path in (ROOT / "crates/fringeworks/src").rglob("*.rs"):
        assert "unsafe" not in path.read_text(), path


def test_reasons_are_the_same_on_both_sides():
    text = (ROOT / "crates/fringeworks/src/reason.rs").read_text()
    found = {name: int(code) for name, code in re.findall(r"const (\w+): u8 = (\d+);", text)}
    assert found == {name: Reason[name].value for name in found}
    assert len(found) >= 7


def test_build_is_optimised():
    assert _core.optimised


def test_kernels_refuse_what_does_not_fit():
    import numpy as np

    with pytest.raises(ValueError, match="mask: expected 20 values, got 12"):
        _core.unwrap_reliability(np.zeros((4, 5), np.float32), np.zeros((4, 3), np.uint8))
    with pytest.raises(ValueError, match="contiguous by rows"):
        _core.unwrap_reliability(np.zeros((5, 4), np.float32).T, np.ones((4, 5), np.uint8))
