"""Sample data: fetched once, checked by their hash, and a sentence where that cannot be."""

from __future__ import annotations

import hashlib
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files import sample_sets

ROOT = Path(__file__).parent.parent


@pytest.fixture
def archive(tmp_path, monkeypatch):
    """A tiny archive that stands for the release's."""
    from release import sample_data as builder

    made = tmp_path / "made"
    for name in sample_sets.SAMPLES:
        (made / name).mkdir(parents=True)
        (made / name / "about.txt").write_text(name)
    builder.make_pair(made / "pair", 0.05)
    where = tmp_path / "given"
    where.mkdir()
    digest = builder.pack(made, where / sample_sets.ARCHIVE)
    assert digest == builder.pack(made, tmp_path / "again.zip")
    monkeypatch.setattr(sample_sets, "SHA256", digest)
    monkeypatch.delenv(sample_sets.VARIABLE, raising=False)
    return where / sample_sets.ARCHIVE


def test_an_archive_without_a_network(archive, monkeypatch):
    monkeypatch.setenv(sample_sets.VARIABLE, str(archive.parent))
    monkeypatch.setitem(sys.modules, "pooch", None)
    assert isinstance(fw.read(fw.data.ball()), fw.Pair)
    archive.unlink()  # the unpacked folder is enough
    folders = [fw.data.bust(), fw.data.board(), fw.data.views(), fw.data.parts()]
    assert [folder.name for folder in folders] == ["stack", "board", "views", "batch"]
    assert all((folder / "about.txt").is_file() for folder in folders)


class Pooch(types.ModuleType):
    """Stands for pooch: fetches nothing, or what a test gives it."""

    def __init__(self, cache, answer):
        super().__init__("pooch")
        self.cache, self.answer, self.asked = cache, answer, []

    def os_cache(self, name):
        return self.cache / name

    def retrieve(self, address, known_hash, fname, path):
        self.asked.append((address, known_hash))
        if isinstance(self.answer, Exception):
            raise self.answer
        path.mkdir(parents=True)
        (path / fname).write_bytes(self.answer)
        return str(path / fname)


def test_the_archive_is_fetched_once(archive, tmp_path, monkeypatch):
    stand_in = Pooch(tmp_path / "cache", archive.read_bytes())
    monkeypatch.setitem(sys.modules, "pooch", stand_in)
    assert fw.data.bust() == fw.data.bust()
    ((address, known),) = stand_in.asked
    assert address.endswith(sample_sets.ARCHIVE)
    assert known == f"sha256:{sample_sets.SHA256}"


@pytest.mark.usefixtures("archive")
@pytest.mark.parametrize("answer", [OSError("no network"), ValueError("hash")])
def test_what_cannot_be_fetched_is_told_in_a_sentence(tmp_path, monkeypatch, answer):
    monkeypatch.setitem(sys.modules, "pooch", Pooch(tmp_path / "cache", answer))
    with pytest.raises(fw.FileProblem, match="could not be fetched .* FRINGEWORKS_SAMPLES") as told:
        fw.data.ball()
    assert "\n" not in str(told.value)


def test_other_faults(archive, tmp_path, monkeypatch):
    with pytest.raises(fw.InputError, match="expected one of pair, stack"):
        sample_sets.sample_data("bust")
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(fw.MissingPackage, match=r"fringeworks\[data\]"):
        fw.data.ball()
    monkeypatch.setenv(sample_sets.VARIABLE, str(tmp_path))
    with pytest.raises(fw.FileProblem, match="got no such file"):
        fw.data.ball()
    archive.write_bytes(archive.read_bytes() + b"0")
    monkeypatch.setenv(sample_sets.VARIABLE, str(archive.parent))
    with pytest.raises(fw.FileProblem, match="expected the archive of this version"):
        fw.data.ball()


def test_the_package_knows_the_archive_of_its_release():
    assert len(sample_sets.SHA256) == 64
    assert f"/v{fw.__version__}/" in sample_sets.ADDRESS


def test_a_release_has_the_archive_that_the_package_knows(tmp_path, monkeypatch, capsys):
    """The rest of the builder is that of the fixture."""
    from release import sample_data as builder

    monkeypatch.setattr(builder, "build", lambda folder: (folder / "a.txt").write_text("a"))
    monkeypatch.setattr("sys.argv", ["sample_data", "--out", str(tmp_path), "--check"])
    assert builder.main() == 1
    assert "publish the archive that the package knows" in capsys.readouterr().out
    digest = hashlib.sha256((tmp_path / sample_sets.ARCHIVE).read_bytes()).hexdigest()
    monkeypatch.setattr(sample_sets, "SHA256", digest)
    assert builder.main() == 0
    workflow = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    assert "make samples" in workflow
    assert "find dist bill samples SHA256SUMS" in workflow


def test_the_archive_that_the_package_knows_can_be_made(tmp_path):
    """Simulators had changed since its hash was stored, so that no release could have had it."""
    from release import sample_data as builder

    builder.build(tmp_path / "sets")
    found = builder.pack(tmp_path / "sets", tmp_path / sample_sets.ARCHIVE)
    assert found == sample_sets.SHA256, "python -m release.sample_data --out samples --write-hash"


@pytest.mark.usefixtures("_samples")
def test_the_views_merge_as_the_page_says():
    """Its lower half is a block of 70 × 50 × 30 mm about the axis."""
    text = (ROOT / "docs" / "python" / "fw-data.md").read_text(encoding="utf-8")
    code = next(b for b in re.findall(r"^```python\n(.*?)^```", text, re.M | re.S) if "four_" in b)
    names = {"fw": fw, "np": np}
    exec(code, names)
    merged = names["four_sides"]()
    assert len(merged.poses) == 4
    assert not [f for f in merged.findings if f.severity == "warning"]
    place = merged.fused.points.xyz_mm - np.array([0.0, 0.0, 510.0])
    beyond = np.abs(place[place[:, 1] > -15.0]) - np.array([35.0, 25.0, 15.0])
    distance = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    assert len(distance) > 15_000
    assert np.quantile(np.abs(distance), 0.99) < 0.08
