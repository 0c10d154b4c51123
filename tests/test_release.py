"""What is handed on: licences of all that is installed, and files that repeat each other agree."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
import tomllib
from fnmatch import fnmatch
from importlib import metadata
from pathlib import Path

import pytest
import yaml

import fringeworks
from tests.page_code import blocks
from tests.walk import PAGES, commands, examples

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
    assert len(found) > 15
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
    # CI must not pass because a program could not be installed.
    sys.argv.append("--strict")
    assert audit.main() == 1
    checks = (ROOT / ".github" / "workflows" / "checks.yml").read_text(encoding="utf-8")
    assert "make audit STRICT=1\n" in checks


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


# Versions, tags and tested files.


@pytest.fixture
def tree(tmp_path):
    """Copies of the files that state the version, with a dated heading of changes."""
    version = script("version")
    for name in version.PLACES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changes\n\n## 0.7.0 (2031-02-03)\n\nNew.\n\n## 0.1.0 (2030-01-01)\n\nOld.\n"
    )
    return tmp_path


def test_every_file_states_one_version():
    version = script("version")
    stated = version.stated()
    assert set().union(*stated.values()) == {fringeworks.__version__}


def test_the_tag_decides_on_the_version(tree):
    version = script("version")
    said = version.disagreements("v0.7.0", tree)
    assert {one.partition(":")[0] for one in said} == set(version.PLACES)
    version.write("v0.7.0", tree)
    assert version.disagreements("v0.7.0", tree) == []
    assert version.disagreements("v0.7.1", tree)[-1].startswith("CHANGELOG.md: expected first")
    cargo = tomllib.loads((tree / "Cargo.toml").read_text())
    assert cargo["workspace"]["package"]["version"] == "0.7.0"
    locked = tomllib.loads((tree / "Cargo.lock").read_text())["package"]
    ours = {p["name"]: p["version"] for p in locked if p["name"].startswith("fringeworks")}
    assert set(ours.values()) == {"0.7.0"}
    assert len(ours) == 2
    before = {
        p["name"]: p["version"] for p in tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    }
    assert {p["name"]: p["version"] for p in locked if p["name"] not in ours} == {
        name: v for name, v in before.items() if name not in ours
    }


def test_a_candidate_has_the_words_of_both_languages(tree):
    version = script("version")
    assert version.of_tag("v0.7.0rc2") == ("0.7.0rc2", "0.7.0-rc.2")
    version.write("v0.7.0rc2", tree)
    assert version.stated(tree)["CITATION.cff"] == {"0.7.0rc2"}
    assert version.stated(tree)["Cargo.lock"] == {"0.7.0-rc.2"}


@pytest.mark.parametrize("tag", ["0.7.0", "v0.7", "v0.7.0.dev1", "release", "v0.7.0-rc1"])
def test_other_tags_are_refused(tag):
    with pytest.raises(ValueError, match="expected a tag such as"):
        script("version").of_tag(tag)


def test_the_text_of_a_release_is_one_screen(tree):
    version = script("version")
    assert version.screen(tree) == "New.\n"
    assert len(version.screen().splitlines()) <= 40


@pytest.fixture
def records(tmp_path):
    """Two files of a release, and records of their tests."""
    tested = script("tested")
    files = [tmp_path / "fringeworks-0.7.0-cp311-abi3-a.whl", tmp_path / "fringeworks-0.7.0.tar.gz"]
    for file in files:
        file.write_bytes(file.name.encode())
    tested.record(files, "import", tmp_path / "records" / "one.json")
    return tested, files, tmp_path / "records"


def test_files_that_were_tested_are_published(records):
    tested, files, folder = records
    assert tested.verify(files, list(folder.glob("*.json")), "v0.7.0", 1) == []


def test_other_bytes_than_the_tested_ones_are_not_published(records):
    tested, files, folder = records
    found = list(folder.glob("*.json"))
    (says,) = tested.verify(files, found, "v0.7.0", 2)
    assert says == "expected 2 wheels, got 1"
    assert len(tested.verify(files, found, "v0.7.1", 1)) == 2
    assert "expected a record of its tests" in tested.verify(files, [], "v0.7.0", 1)[0]
    files[0].write_bytes(b"built again")
    (says,) = tested.verify(files, found, "v0.7.0", 1)
    assert says.endswith("expected the bytes that were tested, got others")
    # Tested twice, with different bytes: one of the two is not this one.
    tested.record(files, "selftest", folder / "two.json")
    (says,) = tested.verify(files, list(folder.glob("*.json")), "v0.7.0", 1)
    assert says.endswith("expected the bytes that were tested, got others")


def test_wheels_that_differ_are_told_by_their_members(tmp_path):
    import zipfile

    build = script("build")
    for name, content in (("a.whl", "1"), ("b.whl", "2"), ("c.whl", "1")):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr(zipfile.ZipInfo("kernel.so"), content)
            archive.writestr(zipfile.ZipInfo("module.py"), "same")
    assert build.differences(tmp_path / "a.whl", tmp_path / "c.whl") == []
    assert build.differences(tmp_path / "a.whl", tmp_path / "b.whl") == ["kernel.so"]


def test_the_recipe_of_conda_needs_what_the_package_needs():
    recipe = (ROOT / "release" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    run = recipe.partition("\n  run:\n")[2].partition("\n  run_constraints:")[0]
    found = {line.removeprefix("    - ").replace(" ", "") for line in run.splitlines()}
    assert found == {*project["dependencies"], f"python{project['requires-python']}"}
    (name, place) = next(iter(project["scripts"].items()))
    assert f"- {name} = {place}\n" in recipe


@pytest.mark.parametrize("name", ["service", "all", "release"])
def test_hashed_pins_are_those_of_the_constraints(name):
    def plain(word):
        return re.sub(r"[-_.]+", "-", word).lower()

    pins = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines()[1:] if line
    )
    pins = {plain(package): version for package, version in pins.items()}
    text = (ROOT / "requirements" / f"hashed-{name}.txt").read_text(encoding="utf-8")
    assert "://" not in text
    entries = re.findall(r"^([\w.-]+)==([^\s;]+)(.*?)(?=^\S|\Z)", text, re.M | re.S)
    assert len(entries) > 20
    for package, version, rest in entries:
        assert pins.get(plain(package), version) == version, package
        assert "--hash=sha256:" in rest, package


def test_workflows_take_actions_by_their_hash():
    """And publish only what was verified, with no secret of a registry."""
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        text = path.read_text(encoding="utf-8")
        used = re.findall(r"uses: (\S+)(.*)", text)
        assert used
        for action, comment in used:
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", action), action
            assert re.match(r" # v\d", comment), action
        assert "secrets." not in text
    release = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    publish = release.partition("\n  publish:\n")[2]
    assert publish.index("tested.py verify") < publish.index("gh-action-pypi-publish")
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["cibuildwheel"]["build"]
    assert f"--wheels {len(built)}\n" in publish


def test_every_wheel_is_tested_where_it_is_built_and_elsewhere():
    """Records of wheels for Windows on ARM said that they had been tested, which was left out."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["cibuildwheel"]
    assert "test-skip" not in settings
    release = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    matrix = yaml.safe_load(release)["jobs"]["test"]["strategy"]["matrix"]
    patterns = [one["wheel"] for one in matrix["platform"]]
    # The containers of musl are those that built and tested the wheel.
    for name in (name for name in settings["build"] if "musllinux" not in name):
        system, _, machine = name.removeprefix("cp311-").partition("_")
        tag = {"manylinux": "manylinux_2_28_", "macosx": "macosx_11_0_", "win": "win_"}[system]
        file = f"fringeworks-1.0.0-cp311-abi3-{tag}{machine}.whl"
        assert sum(fnmatch(file, pattern) for pattern in patterns) == 1, name


def test_steps_of_workflows_name_what_exists():
    made = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
        for name, job in jobs.items():
            said = "\n".join(step.get("run", "") for step in job["steps"])
            for target in re.findall(r"\bmake ([\w-]+)", said):
                assert target in made, (path.name, name, target)
            for file in re.findall(r"\b(?:release|requirements|tests)/[\w-]+\.(?:py|txt)\b", said):
                assert (ROOT / file).exists(), (path.name, name, file)


def test_the_page_of_platforms_is_what_was_measured():
    platforms = script("platforms")
    kept = json.loads((ROOT / "release" / "platforms.json").read_text(encoding="utf-8"))
    assert platforms.PAGE.read_text(encoding="utf-8") == platforms.page(kept)
    assert all(platforms.of(name) for name in kept)


def test_a_platform_without_a_wheel_and_a_failed_run_are_said():
    platforms = script("platforms")
    run = {"where": "Python 3.11.2, Linux x86_64", "ok": False, "said": "broken promise"}
    one = {"size": 2**20, "faults": ["loads libfoo.so"], "loads": [], "glibc": "", "runs": [run]}
    page = platforms.page({"fringeworks-0.7.0-cp311-abi3-manylinux_2_28_x86_64.whl": one})
    assert "| loads libfoo.so | Python 3.11.2, Linux x86_64: broken promise |" in page
    assert page.count("not built yet") == len(platforms.PLATFORMS) - 1


def test_runs_of_the_same_bytes_in_other_places_are_kept():
    platforms = script("platforms")
    here, there = ({"where": w, "ok": True, "said": "passed"} for w in ("here", "there"))
    again = {"where": "here", "ok": False, "said": "no answer in 1800 s"}
    earlier = {"sha256": "a", "runs": [here, there]}
    assert platforms.with_earlier_runs({"sha256": "a", "runs": [again]}, earlier)["runs"] == [
        there,
        again,
    ]
    assert platforms.with_earlier_runs({"sha256": "b", "runs": []}, earlier)["runs"] == []
    assert platforms.with_earlier_runs({"sha256": "b", "runs": [here]}, None)["runs"] == [here]
    one = {"size": 2**20, "faults": [], "loads": [], "glibc": "", "runs": []}
    page = platforms.page({"fringeworks-0.7.0-cp311-abi3-win_amd64.whl": one})
    assert "| no fault | not run: no Windows at hand |" in page


def test_the_bill_in_the_wheel_is_that_of_the_lock_file():
    bills = script("bill_of_materials")
    bill = json.loads(bills.KERNELS.read_text(encoding="utf-8"))
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    expected = {(p["name"], p["version"]) for p in locked if "source" in p}
    found = {(c["name"], c["version"]) for c in bill["components"]}
    assert found <= expected
    assert {"pyo3", "rayon"} <= {name for name, _ in found}
    assert all(c["licenses"][0]["license"]["name"] != "not stated" for c in bill["components"])
    maturin = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["maturin"]["sbom"]
    assert maturin == {"rust": False, "include": [str(bills.KERNELS.relative_to(ROOT))]}


def test_jobs_that_run_the_tests_leave_what_tests_read():
    """The job that tests wheels once removed the sources, which tests of the sources need."""
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
        for name, job in jobs.items():
            lines = [step.get("run", "") for step in job["steps"]]
            if any("pytest" in line for line in lines):
                assert not any(re.search(r"\brm\b.*(src|crates)", line) for line in lines), name


def test_pages_say_what_they_were_last_tried_with():
    found = tomllib.loads((ROOT / "docs" / "tried.toml").read_text(encoding="utf-8"))
    assert found["version"] == fringeworks.__version__
    pages = [page for one in found["tried"] for page in one["pages"]]
    assert len(pages) == len(set(pages))
    for one in found["tried"]:
        assert all((ROOT / "docs" / page).exists() for page in one["pages"]), one["pages"]
        assert all((ROOT / "tests" / name).exists() for name in one["tests"]), one["tests"]
        assert one["tests"]
    assert {page.name for page in (ROOT / "docs").glob("hour-*.md")} <= set(pages)
    shown = [
        page
        for page in PAGES
        if ROOT / "docs" in page.parents
        if blocks(page) or examples(text := page.read_text("utf-8")) or commands(text)
    ]
    assert {page.relative_to(ROOT / "docs").as_posix() for page in shown} <= set(pages)


def test_the_page_of_the_crate_names_every_module():
    crate = ROOT / "crates" / "fringeworks"
    modules = set(re.findall(r"^pub mod (\w+);", (crate / "src/lib.rs").read_text(), re.M))
    page = (crate / "README.md").read_text(encoding="utf-8")
    text, links = page.split("\n[`Error`]: ")
    assert modules <= set(re.findall(r"\[`(\w+)`\]", text))
    assert modules <= set(re.findall(r"^\[`(\w+)`\]: https", links, re.M))
