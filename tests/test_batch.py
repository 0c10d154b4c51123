"""Batches: equal to single measurements, on every engine, whatever dies meanwhile."""

from __future__ import annotations

import contextlib
import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate.capability import control_limits
from fringeworks.evaluate.inspect import recipe_hash
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.types import fingerprint
from fringeworks.types.numbers import number
from tests.grids import quick
from tests.inspected import scene, step

# Both packages take a second to import, which every worker would pay that only collects these tests.
MISSING = [name for name in ("zarr", "distributed") if find_spec(name) is None]
pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(bool(MISSING), reason=f"{' and '.join(MISSING)} is not installed"),
]

COUNT = 4
# Dask and its web server complain about themselves.
quiet = pytest.mark.filterwarnings(
    "ignore:::distributed", "ignore:::tornado", "ignore::ResourceWarning"
)


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    """A folder of captures, with the recipe beside it."""
    made = tmp_path_factory.mktemp("line")
    rig, plan, view = scene()
    for seed in range(COUNT):
        frames = list(photograph(view, plan, Optics(seed=seed)))
        fw.files.write_stack(made / "in" / f"part-{seed}", frames, plan)
    fw.files.write_rig(made / "rig.toml", rig)
    fw.files.write_recipe(made / "recipe.toml", replace(step(9.9, 10.1), rig=made / "rig.toml"))
    return made


def contents(folder):
    """All files of a folder by name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def table(result):
    """The summary by scan; every scan is there once."""
    with result.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = {row["scan"]: row for row in rows}
    assert len(found) == len(rows)
    return found


def check_whole(folder, names):
    """Every scan has one complete result, or an error; nothing half is left."""
    import zarr

    rows = table(folder.with_suffix(".csv"))
    assert set(rows) == set(names)
    places = {path.name for path in (folder / "scans").iterdir() if path.is_dir()}
    assert places == {row["address"] for row in rows.values() if not row["error"]}
    assert not (folder / ".begun").exists()
    for row in rows.values():
        if not row["error"]:
            group = zarr.open(folder / "scans" / row["address"], mode="r")
            assert np.isfinite(group["sigma_mm"][...]).sum() > 50_000
    return rows


@quiet
@pytest.mark.parametrize("scheduler", quick([None, "local"], None))
def test_batches_are_equal_to_single_measurements(line, tmp_path, scheduler):
    import zarr

    out = tmp_path / "out.zarr"
    told = []
    found = fw.batch.run_batch(
        line / "in",
        line / "recipe.toml",
        out,
        workers=2,
        scheduler=scheduler,
        progress=lambda row, count: told.append((row["scan"], count)),
    )
    names = [f"part-{k}" for k in range(COUNT)]
    assert sorted(told) == [(name, COUNT) for name in names]
    assert [row["scan"] for row in found.rows] == names
    assert (found.count("pass"), found.failed) == (COUNT, 0)
    rows = check_whole(out, names)
    for name in names[:1]:
        single = fw.inspect(line / "in" / name, line / "recipe.toml")
        group = zarr.open(out / "scans" / rows[name]["address"], mode="r")
        for part in ("xyz_mm", "sigma_mm", "noise_mm", "reason"):
            np.testing.assert_array_equal(group[part][...], getattr(single.surface, part))
        assert float(rows[name]["step"]) == single.checks[0].value
    assert len(list(zarr.open(out)["scans"].members())) == COUNT
    if scheduler is None:
        xarray = pytest.importorskip("xarray")
        group = xarray.open_zarr(out / "scans" / rows[names[0]]["address"], consolidated=False)
        assert group.xyz_mm.dims == ("y", "x", "coordinate")
        assert group.sigma_mm.units == "mm"
        # Nothing is measured twice.
        before = [p.stat().st_mtime_ns for p in sorted((out / "scans").iterdir())]
        fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=2, resume=True)
        assert before == [p.stat().st_mtime_ns for p in sorted((out / "scans").iterdir())]
        with pytest.raises(fw.InputError, match="resume"):
            fw.batch.run_batch(line / "in", line / "recipe.toml", out)


@pytest.mark.long
def test_equal_batches_write_equal_bytes(line, tmp_path):
    places = [tmp_path / "one.zarr", tmp_path / "two.zarr"]
    for out in places:
        fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=2)
    one, two = (contents(out / "scans") for out in places)
    assert one == two


def test_problems_are_tabled(line, tmp_path, capsys):
    """Captures that cannot be read, or are missing frames, do not stop the others."""
    mixed = tmp_path / "mixed"
    shutil.copytree(line / "in", mixed)
    (mixed / "part-1" / "capture.toml").write_text("kind = ")
    frame = next(path for path in sorted((mixed / "part-2").glob("*.png")))
    frame.write_bytes(frame.read_bytes()[:1000])
    next(path for path in sorted((mixed / "part-3").glob("*.png"))).unlink()
    out = tmp_path / "out.zarr"
    words = ["batch", str(mixed), "--recipe", str(line / "recipe.toml"), "--workers", "2"]
    assert run([*words, "--out", str(out)]) == 5
    assert f"{COUNT - 3} pass, 0 fail, 0 undecided, 3 not measured" in capsys.readouterr().out
    rows = check_whole(out, [f"part-{k}" for k in range(COUNT)])
    assert [bool(rows[f"part-{k}"]["error"]) for k in range(4)] == [False, True, True, True]
    assert all("internal" not in row["error"] for row in rows.values())
    # What was mended is measured when the batch is resumed.
    shutil.rmtree(mixed / "part-2")
    shutil.copytree(line / "in" / "part-2", mixed / "part-2")
    assert run([*words, "--out", str(out), "--resume"]) == 5
    assert not check_whole(out, [f"part-{k}" for k in range(COUNT)])["part-2"]["error"]


@pytest.fixture
def gaps(line, tmp_path):
    """A line of one part, one that was not taken, one that was interrupted, and what is no part."""
    source = tmp_path / "gaps"
    shutil.copytree(line / "in" / "part-0", source / "part-0")
    (source / "part-1").mkdir()
    shutil.copytree(line / "in" / "part-2", source / "part-2")
    (source / "part-2" / "capture.toml").rename(source / "part-2" / "unfinished.toml")
    (source / "part-2" / "unfinished.toml").write_text("")
    shutil.copytree(line / "in" / "part-3", source / "part-3")
    (source / "part-3" / "capture.toml").unlink()  # images and a plan are a capture
    (source / "notes").mkdir()
    (source / "notes" / "shift.txt").write_text("night")
    (source / ".cache").mkdir()
    return source


def test_folders_without_frames_are_counted_and_named(line, gaps, tmp_path, capsys):
    assert [s.name for s in fw.batch.find_scans(gaps)] == ["part-0", "part-1", "part-2", "part-3"]
    recipe = line / "recipe.toml"
    code = run(
        [
            "batch",
            str(gaps),
            "--recipe",
            str(recipe),
            "--out",
            str(tmp_path / "o"),
            "--workers",
            "1",
        ]
    )
    assert code == 5
    said = capsys.readouterr().out
    assert "4 scans: 2 pass, 0 fail, 0 undecided, 2 not measured" in said
    assert "1 folder holds no capture: notes" in said
    assert "part-1: " in said
    assert "part-2: " in said
    rows = table(tmp_path / "o" / "summary.csv")
    assert {name for name, row in rows.items() if row["error"]} == {"part-1", "part-2"}


def test_a_watched_folder_tells_at_its_end_what_stayed_empty(line, gaps, tmp_path):
    turns = iter([True, False])

    def watch():
        if not (gaps / "part-1" / "plan.toml").exists():  # the frames come while it is watched
            shutil.copytree(line / "in" / "part-1", gaps / "part-1", dirs_exist_ok=True)
        return next(turns)

    found = fw.batch.run_batch(gaps, line / "recipe.toml", tmp_path / "w", workers=1, watch=watch)
    assert [bool(row["error"]) for row in found.rows] == [False, False, True, False]
    assert found.passed_over == ("notes",)


@pytest.mark.long
def test_a_watched_folder(line, tmp_path):
    """Captures that come while the batch runs are measured as well."""
    filled = tmp_path / "filled"
    filled.mkdir()
    rounds = []

    def watch():
        if len(rounds) < 2:
            shutil.copytree(line / "in" / f"part-{len(rounds)}", filled / f"part-{len(rounds)}")
        rounds.append(True)
        return len(rounds) < 3

    out = tmp_path / "out"
    found = fw.batch.run_batch(filled, line / "recipe.toml", out, workers=1, watch=watch)
    assert [row["scan"] for row in found.rows] == ["part-0", "part-1"]
    assert set(table(found.summary)) == {"part-0", "part-1"}


def test_archives_without_zarr_and_control_charts(line, tmp_path):
    report = tmp_path / "batch.html"
    words = ["batch", str(line / "in"), "--recipe", str(line / "recipe.toml"), "--workers", "2"]
    shown = ["--report", str(report), "--head", "order=118"]
    assert run([*words, "--out", str(tmp_path / "o"), *shown]) == 0
    rows = table(tmp_path / "o" / "summary.csv")
    assert len(rows) == COUNT
    for row in rows.values():
        cloud = fw.read(tmp_path / "o" / "scans" / row["address"] / "result.npz")
        assert (cloud.reason == 0).sum() > 50_000
    text = report.read_text("utf-8")
    assert text.count("<img") + text.count("<svg") >= 2
    assert "Control limits" in text
    # The table of parts names and links each of them; every link is there and shows its verdict.
    assert ">PASS: 4 of 4 parts pass.</p>" in text
    recipe = fw.files.read_recipe(line / "recipe.toml")
    for digest in (recipe_hash(recipe), fingerprint(scene()[0])):
        assert f"sha256 {digest}" in text
    links = dict(re.findall(r'<a href="(batch-parts/[^"]*)">([^<]*)</a>', text))
    assert sorted(links.values()) == [f"part-{k}" for k in range(COUNT)]
    for place, name in links.items():
        page = (tmp_path / place).read_text("utf-8")
        assert f"<h1>{name}</h1>" in page
        assert f"<dt>serial number</dt><dd>{name}</dd>" in page
        assert "<dt>order</dt><dd>118</dd>" in page
        assert ">PASS: the tolerance is kept.</p>" in page
        # The report says as much as that of the part alone: budget, hashes and origin.
        assert "Uncertainty budget: step" in page
        assert f"<dt>rig</dt><dd>sha256 {fingerprint(scene()[0])}</dd>" in page
        assert "unknown: the result carries no provenance" not in page
        assert "00-x-phase" in page
        assert number(float(rows[name]["step"]), float(rows[name]["step σ"]), "mm") in page
    values = np.array([10.0, 10.1, 9.9, np.nan, 10.0, 10.2])
    mean, low, high = control_limits(values)
    assert mean == pytest.approx(10.04)
    assert high - mean == pytest.approx(3 * np.mean([0.1, 0.2, 0.1, 0.2]) / 1.128)
    assert low < mean < high
    # A drift leaves the limits, which random values of the same spread do not.
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.1, 200)
    for values, beyond in ((noise, False), (noise + 0.01 * np.arange(200), True)):
        _, low, high = control_limits(values)
        assert bool(np.mean((values < low) | (values > high)) > 0.05) == beyond


@pytest.mark.long
def test_exit_codes_are_those_of_parts(line, tmp_path):
    for limits, code in (((9.9, 10.1), 0), ((10.5, 11.0), 3)):
        recipe = replace(step(*limits), rig=line / "rig.toml")
        fw.files.write_recipe(line / "other.toml", recipe)
        words = ["batch", str(line / "in"), "--recipe", str(line / "other.toml"), "--workers", "2"]
        assert run([*words, "--out", str(tmp_path / f"{code}.zarr")]) == code


@pytest.mark.long
def test_arrays_and_addresses(line, tmp_path):
    import zarr

    frames = [fw.files.read_stack(line / "in" / f"part-{k}").frames for k in range(2)]
    stack = np.array([list(one) for one in frames])
    made = zarr.create_array(tmp_path / "frames.zarr", data=stack, chunks=(1, 1, *stack.shape[2:]))
    assert made.shape[0] == 2
    recipe = replace(fw.files.read_recipe(line / "recipe.toml"), plan=scene()[1])
    fw.files.write_recipe(line / "arrays.toml", recipe)
    assert fw.files.read_recipe(line / "arrays.toml").plan == recipe.plan
    found = fw.batch.run_batch(
        tmp_path / "frames.zarr", line / "arrays.toml", tmp_path / "a", workers=1
    )
    at = fw.batch.run_batch(
        (line / "in").as_uri(), line / "recipe.toml", tmp_path / "b.zarr", workers=1
    )
    single = fw.inspect(line / "in" / "part-1", line / "recipe.toml").checks[0].value
    assert found.rows[1]["step"] == pytest.approx(single, abs=1e-9)
    assert at.rows[1]["step"] == single
    with pytest.raises(fw.InputError, match="plan"):
        rows = fw.batch.run_batch(
            tmp_path / "frames.zarr", line / "recipe.toml", tmp_path / "c", workers=1
        ).rows
        raise fw.InputError(rows[0]["error"])


@pytest.mark.parametrize("source", ["missing", "empty", "nowhere://x/y"])
def test_sources_that_are_none(line, tmp_path, source):
    (tmp_path / "empty").mkdir()
    place = source if "://" in source else tmp_path / source
    with pytest.raises(fw.InputError, match="expected|opened"):
        fw.batch.run_batch(place, line / "recipe.toml", tmp_path / "out.zarr")


@quiet
def test_a_scheduler_that_is_not_there(line, tmp_path):
    begun = time.monotonic()
    with pytest.raises(fw.DeviceProblem, match="scheduler"):
        fw.batch.run_batch(
            line / "in",
            line / "recipe.toml",
            tmp_path / "out.zarr",
            scheduler="tcp://127.0.0.1:9",
        )
    assert time.monotonic() - begun < 10


def test_one_batch_at_a_time(line, tmp_path):
    out = tmp_path / "out.zarr"
    refused = []

    def second(*_):
        if not refused:
            with pytest.raises(fw.InputError, match="nothing else writes"):
                fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=1, resume=True)
            refused.append(True)

    fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=1, progress=second)
    assert refused


class Killer(threading.Thread):
    """Kills workers by their id, as marks of scans that were begun tell it."""

    def __init__(self, folder, *, every_s, address=""):
        super().__init__(daemon=True)
        self.folder, self.every_s, self.address = folder, every_s, address
        self.over, self.killed = threading.Event(), 0
        self.rng = np.random.default_rng(1)

    def run(self):
        while not self.over.wait(self.every_s):
            marks = sorted((self.folder / ".begun").glob(f"{self.address}*"))
            if not marks:
                continue
            with contextlib.suppress(OSError, ValueError):
                os.kill(int(self.rng.choice(marks).read_text()), signal.SIGKILL)
                self.killed += 1

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.join()


@quiet
@pytest.mark.long
@pytest.mark.parametrize("scheduler", [None, "local"])
def test_a_scan_that_kills_its_workers_is_set_aside(line, tmp_path, scheduler):
    clean = fw.batch.run_batch(
        line / "in", line / "recipe.toml", tmp_path / "clean.zarr", workers=2
    )
    poison = clean.rows[2]["address"]
    out = tmp_path / "out.zarr"
    with Killer(out, every_s=0.002, address=poison) as killer:
        found = fw.batch.run_batch(
            line / "in", line / "recipe.toml", out, workers=2, scheduler=scheduler
        )
    assert killer.killed >= 2
    rows = check_whole(out, [f"part-{k}" for k in range(COUNT)])
    assert "workers died" in rows["part-2"]["error"]
    assert found.failed == 1
    assert run(
        ["batch", str(line / "in"), "--recipe", str(line / "recipe.toml"), "--out", str(out), "--resume"]
    ) == 0  # fmt: skip
    assert contents(out / "scans") == contents(tmp_path / "clean.zarr" / "scans")


@quiet
@pytest.mark.long
@pytest.mark.parametrize("scheduler", [None, "local"])
@pytest.mark.parametrize("seed", range(20))
def test_workers_that_die_lose_nothing(line, tmp_path, scheduler, seed):
    out = tmp_path / "out.zarr"
    with Killer(out, every_s=2.0) as killer:
        killer.rng = np.random.default_rng(seed)
        fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=2, scheduler=scheduler)
    rows = check_whole(out, [f"part-{k}" for k in range(COUNT)])
    assert not any(row["error"] for row in rows.values())


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 20))]
)
def test_a_client_that_dies_is_resumed(line, tmp_path, seed):
    out = tmp_path / "out.zarr"
    words = ["batch", str(line / "in"), "--recipe", str(line / "recipe.toml"), "--out", str(out)]
    words = [sys.executable, "-m", "fringeworks", *words, "--workers", "2", "--resume"]
    rng = np.random.default_rng(seed)
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    while not list((out / "scans").glob("*")) and process.poll() is None:
        time.sleep(0.01)
    time.sleep(rng.uniform(0.0, 0.5))
    pids = [int(m.read_text() or 0) for m in (out / ".begun").glob("*")]
    process.kill()
    process.wait()
    process.stdout.close()
    # Workers do not outlive it.
    end = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in pids if pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not [pid for pid in pids if pid and Path(f"/proc/{pid}").exists()]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    check_whole(out, [f"part-{k}" for k in range(COUNT)])


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1.5 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1500k", "tmpfs", str(place)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("file systems cannot be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.long
def test_a_full_disk_leaves_nothing_half(line, small_disk):
    import zarr

    out = small_disk / "out.zarr"
    with contextlib.suppress(fw.InputError):
        found = fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=2)
        assert found.failed
        assert all("could not be written" in row["error"] for row in found.rows if row["error"])
    for place in (out / "scans").iterdir():
        if place.is_dir():
            assert not place.name.startswith(".")
            zarr.open(place, mode="r")["xyz_mm"][...]
    subprocess.run(["mount", "-o", "remount,size=100m", str(small_disk)], check=True)
    fw.batch.run_batch(line / "in", line / "recipe.toml", out, workers=2, resume=True)
    check_whole(out, [f"part-{k}" for k in range(COUNT)])
