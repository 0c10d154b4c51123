"""What is handed on: licences of all that is installed, and files that repeat each other agree."""

from __future__ import annotations

import importlib.util
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import fringeworks

ROOT = Path(__file__).parent.parent


def script(name):
    """A program of ``release/`` as a module."""
    specification = importlib.util.spec_from_file_location(name, ROOT / "release" / f"{name}.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # its data classes look themselves up
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def distributions():
    return script("distributions")


def test_all_that_a_default_install_brings_is_permissive(distributions):
    found = distributions.of_default_install()
    assert found[0].name == "fringeworks"
    assert len(found) > 20
    assert {each.name: each.licence for each in found if not each.permissive} == {}


@pytest.mark.parametrize(
    ("licence", "permissive"),
    [
        ("MIT", True),
        ("BSD-3-Clause AND MIT", True),
        ("GPL-3.0-or-later OR MIT", True),
        ("BSD-3-Clause AND GPL-3.0-or-later", False),
        ("GNU Lesser General Public License v3 (LGPLv3)", False),
        ("Mozilla Public License 2.0 (MPL 2.0)", False),
        ("not stated", False),
    ],
)
def test_licences_are_told_apart(distributions, licence, permissive):
    assert distributions.Installed("some", "1", licence).permissive == permissive


def test_versions_agree():
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {workspace['version']}\n" in citation
    assert metadata.version("fringeworks") == workspace["version"] == fringeworks.__version__
    workflow = (ROOT / ".github" / "workflows" / "checks.yml").read_text(encoding="utf-8")
    assert f"cargo +{workspace['rust-version']} test" in workflow
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f"Rust {workspace['rust-version']} or later" in makefile


def test_every_pin_is_a_version_and_no_address():
    pins = [
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][A-Za-z0-9.+!]*", pin) for pin in pins)


def test_an_audit_without_its_programs_says_so(capsys, monkeypatch):
    audit = script("audit")
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setattr("sys.argv", ["audit", "--pip-audit", "pip-audit"])
    assert audit.main() == 0
    said = capsys.readouterr().out
    assert said.count("SKIPPED") == 2


def test_an_audit_that_finds_something_fails(capsys):
    audit = script("audit")
    assert not audit.looked_at("it", [sys.executable, "-c", "print('CVE-1'); raise SystemExit(1)"])
    assert "CVE-1" in capsys.readouterr().out
    partly = "print('a could not be audited'); print('b could not be audited')"
    assert audit.looked_at("it", [sys.executable, "-c", partly])
    assert "SKIPPED 2 of them" in capsys.readouterr().out
    offline = "raise SystemExit('Temporary failure in name resolution')"
    assert audit.looked_at("it", [sys.executable, "-c", offline])
    assert "SKIPPED" in capsys.readouterr().out
