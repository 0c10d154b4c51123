"""Imports run one way, files and functions stay short, and the two languages agree."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks import _core
from fringeworks.types import Frozen
from tests.public import public, public_names, submodules

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "fringeworks"
MODULES = sorted(SOURCE.rglob("*.py"))
RUST = sorted((ROOT / "crates").glob("*/src/**/*.rs"))

# The rooms in the order of the light. A room imports from the lines above its own only.
ROOMS = [
    ["_core"],
    ["types"],
    ["statistics"],
    ["patterns"],
    ["rig"],
    ["surface"],
    ["signal", "views"],
    ["pair", "stack"],
    ["simulate"],
    ["files"],
    ["devices", "data"],
    ["pipeline"],
    ["evaluate", "scan"],
    ["report"],
    ["showcase", "serving", "batch"],
    ["studio", "service", "napari", "xarray"],
    ["cli"],
]
PLACE = {room: line for line, rooms in enumerate(ROOMS) for room in rooms}
# What every public room loads its names with.
LAZY = "fringeworks._lazy"
# Rooms that compute: they know neither disk nor screen.
PURE = {
    "types",
    "statistics",
    "patterns",
    "surface",
    "rig",
    "signal",
    "stack",
    "simulate",
    "pair",
    "views",
}
OUTER = {"PIL", "tifffile", "h5py", "matplotlib", "rich", "typer", "pydantic", "tomli_w", "pathlib"}

MAX_FILE = 600
MAX_FUNCTION = 40
# Functions that are longer, with the reason.
LONG: dict[str, str] = {}


def short(path: Path) -> str:
    return str(path.relative_to(ROOT))


def room(path: Path) -> str:
    return path.relative_to(SOURCE).with_suffix("").parts[0]


@cache
def tree(path: Path) -> ast.Module:
    """A file as Python reads it; nobody changes it."""
    return ast.parse(path.read_text())


def without_annotations(whole: ast.Module) -> ast.Module:
    """A file without what it imports for its annotations only, which never runs."""
    body = [
        node
        for node in whole.body
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    ]
    return ast.Module(body, whole.type_ignores)


def statements(whole: ast.AST) -> Iterator[ast.stmt]:
    """All statements of a file: a tenth of what ``ast.walk`` goes through."""
    for field in ("body", "handlers", "orelse", "finalbody", "cases"):
        for node in getattr(whole, field, ()):
            if isinstance(node, ast.stmt):
                yield node
            yield from statements(node)


def imports(path: Path, *, running: bool = False) -> list[tuple[str, str]]:
    """Modules and names that a file imports from the package, and other modules."""
    found = []
    whole = tree(path)
    for node in statements(without_annotations(whole) if running else whole):
        if isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module == "fringeworks":
            found += [(f"fringeworks.{alias.name}", "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [(node.module, alias.name) for alias in node.names]
    return found


def wrong_imports(path: Path) -> list[str]:
    """Imports of a file that do not run one way, with the reason."""
    here = room(path)
    wrong = []
    for module, name in imports(path):
        if not module.startswith("fringeworks.") or module.split(".")[1] == here:
            continue
        if module != LAZY and PLACE[module.split(".")[1]] >= PLACE[here]:
            wrong.append(f"{short(path)} imports {module}")
        if name.startswith("_"):
            wrong.append(f"{short(path)} imports {name} of {module}")
    if here in PURE:
        outer = [module for module, _ in imports(path, running=True)]
        wrong += [f"{short(path)} imports {m}" for m in outer if m.split(".")[0] in OUTER]
    return wrong


def test_imports_run_one_way():
    rooms = [path for path in MODULES if room(path) not in ("__init__", "__main__", "_lazy")]
    assert len(rooms) > 300
    assert not [wrong for path in rooms for wrong in wrong_imports(path)]


def test_files_of_tests_import_from_helpers_only():
    # What a file of tests imports from another one runs, marks and breaks with that one.
    wrong = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        found = re.findall(r"(?:from|import) tests(?:\.| import )(test_\w+)", path.read_text())
        wrong += [f"{short(path)} imports {name}" for name in found]
    assert not wrong


def test_thorough_tests_exist():
    """A line that names no test would leave the test of another name in the quick layers."""
    files = list(Path(__file__).parent.glob("test_*.py"))
    defined = {path.name for path in files} | {
        f"{path.name}::{node.name}"
        for path in files
        for node in statements(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    listed = (ROOT / "tests" / "thorough.txt").read_text(encoding="utf-8").split("\n")[:-1]
    assert listed == sorted(set(listed))
    assert [line for line in listed if line.partition("[")[0] not in defined] == []


def test_tests_that_start_processes_are_marked():
    # The unit layer stays quick, and runs where there is no browser, camera or window.
    starts = ("subprocess", "playwright", "chromium", "studio_page", "tests.kernels", "FakeCamera")
    bare = []
    for path in sorted((ROOT / "tests").glob("test_*.py")):
        text = path.read_text()
        if path != Path(__file__) and any(word in text for word in starts):
            bare += [] if "pytest.mark.system" in text else [short(path)]
    assert not bare


def test_parts_of_scipy_load_when_they_are_called():
    # "import scipy" takes no time; scipy.interpolate alone takes 0.2 s of every command.
    early = []
    for path in MODULES:
        for node in tree(path).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy"):
                early.append(f"{short(path)}: {node.module}")
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
                early += [f"{short(path)}: {n}" for n in names if n.startswith("scipy.")]
    assert not early


def test_commands_load_the_library_when_they_run():
    # "--help" and the parsing of arguments need none of it.
    early = []
    for path in MODULES:
        for node in tree(path).body if room(path) == "cli" else []:
            module = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
            if module.startswith("fringeworks.") and not module.startswith("fringeworks.cli"):
                early.append(f"{short(path)}: {module}")
    assert not early


def test_the_top_level_holds_rooms():
    assert {p.name for p in SOURCE.glob("*.py")} == {"__init__.py", "__main__.py", "_lazy.py"}
    assert {p.name for p in SOURCE.iterdir() if (p / "__init__.py").is_file()} == PLACE.keys() - {
        "_core"
    }


def test_files_are_short():
    lengths = {short(p): len(p.read_text().splitlines()) for p in [*MODULES, *RUST]}
    assert len(lengths) > 400
    assert not {name: length for name, length in lengths.items() if length > MAX_FILE}


def python_functions(path: Path):
    """Names and lengths of functions, docstrings not counted."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            if body:
                yield node.name, (node.end_lineno or 0) - body[0].lineno + 1


def rust_functions(path: Path):
    """Names of functions, and the lines between their braces; rustfmt has laid them out."""
    lines = path.read_text().splitlines()
    for k, line in enumerate(lines):
        head = re.match(r"( *)(?:pub(?:\([a-z]+\))? )?(?:const )?fn (\w+)", line)
        if head is None:
            continue
        start = next(n for n in range(k, len(lines)) if lines[n].rstrip().endswith(("{", "}", ";")))
        if lines[start].rstrip().endswith("{"):
            end = next(n for n in range(start, len(lines)) if lines[n] == head[1] + "}")
            yield head[2], end - start - 1


def test_functions_read_in_one_look():
    long = {}
    for path in [*MODULES, *RUST]:
        functions = python_functions(path) if path.suffix == ".py" else rust_functions(path)
        for name, length in functions:
            key = f"{short(path)}:{name}"
            if length > MAX_FUNCTION and key not in LONG:
                long[key] = length
    assert not long


def test_every_chosen_number_has_a_docstring():
    bare = []
    for path in MODULES:
        body = tree(path).body
        for node, following in zip(body, [*body[1:], None], strict=True):
            if not isinstance(node, ast.Assign) or not isinstance(node.targets[0], ast.Name):
                continue
            numbers = [n for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
            chosen = any(isinstance(n.value, int | float) for n in numbers)
            said = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            if node.targets[0].id.isupper() and chosen and not said:
                bare.append(f"{short(path)}: {node.targets[0].id}")
    assert not bare


def test_kernels_know_nothing_of_python():
    assert "pyo3" not in (ROOT / "crates/fringeworks/Cargo.toml").read_text()


def test_kernels_have_one_name_in_both_languages():
    text = "".join(path.read_text() for path in (ROOT / "crates/fringeworks/src").rglob("*.rs"))
    public = set(re.findall(r"pub (?:fn|struct) (\w+)", text)) | {"optimised", "version"}
    assert set(_core.__all__) - public == {"read_grey_png"}  # the crate png's


def test_reasons_are_the_same_on_both_sides():
    text = (ROOT / "crates/fringeworks/src/reason.rs").read_text()
    found = {
        re.sub(r"(?<!^)(?=[A-Z])", "_", name).upper(): int(code)
        for name, code in re.findall(r"^    (\w+) = (\d+),$", text, re.MULTILINE)
    }
    assert found == {reason.name: reason.value for reason in fw.Reason}


def test_build_is_optimised():
    assert _core.optimised


def test_kernels_refuse_what_does_not_fit():
    with pytest.raises(ValueError, match=r"mask: expected shape \(4, 5\), got \(4, 3\)"):
        _core.unwrap_reliability(np.zeros((4, 5), np.float32), np.zeros((4, 3), np.uint8))
    with pytest.raises(ValueError, match="contiguous by rows"):
        _core.unwrap_reliability(np.zeros((5, 4), np.float32).T, np.ones((4, 5), np.uint8))


MOST_NAMES = 60
"""Largest number of public names of the top: what a first week needs."""


def test_the_top_is_learned_in_an_afternoon():
    assert len([name for name in public_names() if "." not in name]) <= MOST_NAMES


def test_no_public_name_is_that_of_a_file_beside_it():
    # Python would hand out the module in place of the function, once anybody has imported it.
    for name, module in submodules().items():
        files = {path.stem for path in (SOURCE / name).iterdir() if not path.name.startswith("_")}
        assert not files & set(module.__all__), name


ALIKE = {"data.bust"}
"""The capture of a body that ``simulate`` calls by the same name."""


def test_public_names_end_differently():
    ends = [name.rpartition(".")[2] for name in public_names() if name not in ALIKE]
    assert len(ends) == len(set(ends))


def own_types(annotation: object) -> set[type]:
    """Classes of the package in an annotation."""
    found = {annotation} if inspect.isclass(annotation) else set()
    for part in typing.get_args(annotation):
        found |= own_types(part)
    return {t for t in found if getattr(t, "__module__", "").startswith("fringeworks")}


def signatures():
    """Public functions and methods, by name."""
    for name in public_names():
        value = public(name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value):
            for attribute, member in vars(value).items():
                function = member.fget if isinstance(member, property) else member
                if inspect.isfunction(function) and not attribute.startswith("__"):
                    yield f"{name}.{attribute}", function


PASSED_ON = {"Cell", "CaseResult"}
"""Types that users only pass on from one function to the next; they read and make none."""


def test_every_type_in_a_public_signature_is_public():
    known = {public(name) for name in public_names() if inspect.isclass(public(name))}
    hidden = {}
    for name, function in signatures():
        if name.rpartition(".")[2].startswith("_"):
            continue
        module = importlib.import_module(function.__module__)
        hints = typing.get_type_hints(function, vars(module))
        for kind in set().union(*(own_types(hint) for hint in hints.values())) - known:
            hidden.setdefault(kind.__qualname__, []).append(name)
    assert not hidden.keys() - PASSED_ON


def test_every_public_name_has_a_docstring():
    for name in public_names():
        value = public(name)
        if inspect.isfunction(value) or inspect.isclass(value):
            text = inspect.getdoc(value) or ""
            assert text.split("\n")[0].rstrip().endswith((".", "…")), name


def test_public_types_that_hold_arrays_own_them():
    kinds = [public(name) for name in public_names()]
    for kind in kinds:
        if inspect.isclass(kind) and dataclasses.is_dataclass(kind):
            hints = " ".join(str(field.type) for field in dataclasses.fields(kind))
            assert issubclass(kind, Frozen) or not re.search(r"Map\b|NDArray", hints), kind
