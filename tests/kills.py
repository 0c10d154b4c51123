"""Programs killed at random while they write: ``python -m tests.kills``.

A child writes two versions of a result in turn, for ever; it is killed, and what is there is read.
It must be one of the two versions, whole. Nothing else may be there but unfinished files, whose names
begin with a dot.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import fringeworks as fw
from fringeworks.batch.sequence_store import SequenceStore
from fringeworks.batch.store import Store
from fringeworks.files.atomic import TEMPORARY, write_text
from tests.folder_writes import check as check_capture
from tests.folder_writes import content as capture_content
from tests.hostile import _cloud, _surface

FOREIGN = [s for s, package in ((".e57", "pye57"), (".las", "laspy")) if find_spec(package)]
"""Files of points that packages write."""
WRITER_S = 60.0
"""Time for the kills of one writer, s; slow ones get fewer."""
MAT_HEADER = 128
"""Bytes at the beginning of a MATLAB file, which hold the time at which it was written."""


class Writer(NamedTuple):
    """Something that is written again and again, and how it is checked."""

    name: str
    write: Callable[[Path, int], Any]
    """Write version k into a folder."""
    whole: Callable[[Path], bool] | None = None
    """Raise for anything half; whether there is something. By default, files are compared."""


def _content(folder: Path) -> dict[str, bytes]:
    """The files of a folder, by name, without unfinished ones."""
    files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(TEMPORARY)]
    return {p.name: p.read_bytes()[MAT_HEADER if p.suffix == ".mat" else 0 :] for p in files}


def _files(name: str, write: Callable[[Path, int], Any]) -> Writer:
    return Writer(name, lambda folder, k: write(folder / name, k % 2))


def _mask(k: int) -> np.ndarray:
    return np.arange(600).reshape(20, 30) % 7 > 2 + k


def _plan(k: int) -> fw.PatternPlan:
    return fw.PatternPlan(
        64 + 2 * k, 48, (fw.patterns.PhaseSteps("x", 16.0, fw.patterns.equal_steps(3)),)
    )


def _write_recipe(path: Path, k: int) -> None:
    area = fw.evaluate.Area(mask=_mask(k))
    fw.files.write_recipe(path, fw.Recipe(method=f"m{k}", plan=_plan(k), areas={f"a{k}": area}))


def _whole_recipe(folder: Path) -> bool:
    path = folder / "recipe.toml"
    if not path.exists():
        return False
    found = fw.files.read_recipe(path)
    k = int(found.method[1:])
    assert found.plan == _plan(k)
    assert np.array_equal(found.areas[f"a{k}"].mask, _mask(k))
    return True


def _write_setup(path: Path, k: int) -> None:
    """Write what a set-up of the studio holds."""
    setup = fw.scan.StoredSetup(
        projector=f"window:{k}",
        camera="webcam:0",
        projector_name="p",
        camera_name="c",
        settings=fw.devices.CameraSettings(),
        noise=fw.signal.CameraNoise(1.0),
        plan=_plan(k),
        predicted_sigma_px=0.05 + k,
        size_px=(64, 48),
        min_period_px=4.0,
        modulation=45.0,
        gamma=2.2,
        contrast=0.9,
        black_counts=0.0,
    )
    fw.files.write_setup(path, setup)


def _whole_setup(folder: Path) -> bool:
    if not (folder / "setup.toml").exists():
        return False
    found = fw.files.read_setup(folder / "setup.toml")
    assert found.plan == _plan(int(found.projector[-1]))
    return True


def _write_batch(folder: Path, k: int) -> None:
    store = Store(folder / f"batch{'.zarr' if k % 2 else ''}")
    store.begin({"recipe": 1})
    store.write(f"scan-{k % 40}", _surface(), {"value": k % 40})
    store.write_summary([{"name": f"scan-{n}", "value": n} for n in range(k % 40)])
    if k % 40 > 37:
        # A kill while the folder is deleted would leave half of it, which no writer has written.
        gone = store.folder.with_name(f".gone-{os.getpid()}-{k}")
        store.folder.rename(gone)
        shutil.rmtree(gone)


def _whole_batch(folder: Path) -> bool:
    found = False
    for name in ("batch", "batch.zarr"):
        store = Store(folder / name)
        if not (store.folder / "scans").is_dir():
            continue
        for place in list((store.folder / "scans").iterdir()):
            if place.name.startswith(".") or not place.is_dir() or not store.has(place.name):
                continue
            if store.zarr:
                import zarr

                values = zarr.open(place, mode="r")["values"][...]
                assert np.array_equal(values, _surface().values), place
            else:
                assert fw.files.read_surface(place / "result.npz") == _surface()
            assert store.row(place.name)["value"] == int(place.name[5:])
            found = True
        if store.summary.exists():
            assert store.summary.read_text().endswith("\n")
    return found


def _write_sequence(folder: Path, k: int) -> None:
    place = folder / f"sequence-{os.getpid()}-{k}.zarr"
    store = SequenceStore(place, {"k": k})
    for n in range(8):
        store.add(float(n), _cloud())
    store.end()


def _whole_sequence(folder: Path) -> bool:
    import zarr

    found = False
    for place in folder.glob("sequence-*"):
        group = place / "zarr.json"
        if group.exists():
            about = zarr.open(place, mode="r")
            for n in range(int(about.attrs.get("moments", 0))):
                assert about["time"][n] == n
                assert np.array_equal(about["xyz_mm"][n], _cloud().xyz_mm)
                found = True
        shutil.rmtree(place)
    return found


def _whole_capture(folder: Path) -> bool:
    return (folder / "capture").is_dir() and bool(check_capture(folder / "capture"))


def writers() -> list[Writer]:
    """Every writer of the package that writes in less than a second."""
    surfaces = [_surface(), replace(_surface(), values=_surface().values + 1)]
    clouds = [_cloud(), replace(_cloud(), xyz_mm=_cloud().xyz_mm + 1)]
    meshes = [fw.surface.cloud_mesh(cloud) for cloud in clouds]
    pinholes = [fw.rig.Pinhole(640 + k, 480, (900.0, 900.0), (320.0, 240.0)) for k in (0, 1)]
    T = np.eye(4)
    T[0, 3] = 100.0
    rigs = [fw.Rig(pinhole, pinholes[0], T, np.eye(24), (0.1, 0.2)) for pinhole in pinholes]
    plans = [_plan(k) for k in (0, 1)]
    flat = np.zeros((40, 50), np.float32)
    phases = [
        fw.stack.WrappedPhase(
            flat + k,
            flat,
            flat,
            flat,
            flat.astype(np.uint8),
            (0.0, 1.0, 2.0),
            fw.signal.CameraNoise(1.0),
        )
        for k in (0, 1)
    ]
    codes = [
        fw.Decoded(fw.stack.CoordinateMap(flat + k, flat, flat, flat, flat.astype(np.uint8), "x", (16.0,)), None, fw.signal.CameraNoise(1.0))
        for k in (0, 1)
    ]  # fmt: skip
    frames = [np.full((60, 80), 7 + k, np.uint8) for k in (0, 1)]
    planes = [fw.pair.ReferencePlaneGeometry(500.0 + k, 200.0) for k in (0, 1)]
    laws = [fw.pair.PixelCalibration(flat + 1 + k, flat, (1.0, 9.0)) for k in (0, 1)]
    responses = [
        fw.Response("c", "p", 2.2, 3, 1.0, np.zeros((2, 256)) + k, (10.0, 200.0), 0.01)
        for k in (0, 1)
    ]
    points = [fw.surface.Points(cloud.xyz_mm.reshape(-1, 3), None) for cloud in clouds]
    found = [
        *[_files(f"map{s}", lambda p, k: fw.files.write_surface(p, surfaces[k])) for s in (".npz", ".tif", ".x3p", ".gsf", ".ply", ".csv")],
        *[_files(f"cloud{s}", lambda p, k: fw.files.write_points(p, clouds[k])) for s in (".ply", ".xyz", ".npz", ".pcd", ".mat", ".csv", *FOREIGN)],
        *[_files(f"mesh{s}", lambda p, k: fw.files.write_mesh(p, meshes[k])) for s in (".stl", ".obj", ".ply", ".glb", ".3mf")],
        *[_files(f"rig{s}", lambda p, k: fw.files.write_rig(p, rigs[k])) for s in (".toml", ".xml", ".yml")],
        _files("plan.toml", lambda p, k: fw.files.write_plan(p, plans[k])),
        _files("phase.npz", lambda p, k: fw.files.write_phase(p, phases[k])),
        _files("codes.npz", lambda p, k: fw.files.write_coordinates(p, codes[k])),
        _files("frame.png", lambda p, k: fw.files.write_frame(p, frames[k])),
        _files("frame.tif", lambda p, k: fw.files.write_frame(p, frames[k] * 1.5)),
        _files("plane.toml", lambda p, k: fw.files.write_reference_plane(p, planes[k])),
        _files("law.npz", lambda p, k: fw.files.write_reference_plane(p, laws[k])),
        _files("response.toml", lambda p, k: fw.files.write_response(p, responses[k])),
        _files("merged.ply", lambda p, k: fw.files.write_merged_points(p, points[k])),
        _files("result.tif", lambda p, k: fw.write(p, surfaces[k])),
        _files("text.json", lambda p, k: write_text(p, json.dumps([k] * 5000))),
        _files("board.svg", lambda p, k: fw.report.write_board(p, f"chessboard:{5 + k}x4:12")),
        _files("report.html", lambda p, k: fw.write_report(p, surfaces[k])),
        Writer("recipe", lambda folder, k: _write_recipe(folder / "recipe.toml", k % 2), _whole_recipe),
        Writer("setup", lambda folder, k: _write_setup(folder / "setup.toml", k % 2), _whole_setup),
        Writer("capture", lambda folder, k: capture_content(k)(folder / "capture"), _whole_capture),
        Writer("batch", _write_batch, _whole_batch),
        Writer("sequence", _write_sequence, _whole_sequence),
    ]  # fmt: skip
    return found


def kill(writer: Writer, folder: Path, most: int, rng: random.Random) -> tuple[int, int, float]:
    """Kill a writer: how often, how often something whole was there then, and the seconds of a write.

    Raises
    ------
    AssertionError for anything that is neither version.
    """
    folder.mkdir()
    versions = []
    for k in (0, 1):
        started = time.perf_counter()
        writer.write(folder, k)
        seconds = time.perf_counter() - started
        versions.append(_content(folder))
    complete = 0
    count = min(most, int(WRITER_S / seconds) + 1)
    for number in range(count):
        child = os.fork()
        if child == 0:
            try:
                for k in range(number, number + 10**6):
                    writer.write(folder, k)
            finally:
                os._exit(3)
        time.sleep(rng.uniform(0.0, 2.0 * seconds + 0.004))
        os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
        assert os.WIFSIGNALED(status), f"{writer.name}: the child ended by itself"
        if writer.whole is not None:
            complete += writer.whole(folder)
        else:
            there = _content(folder)
            assert there in versions, (
                f"{writer.name}: half a file, or another one, after kill {number}"
            )
            complete += 1
        for left in folder.glob(f"{TEMPORARY}*"):
            left.unlink()
    return count, complete, seconds


def main() -> int:
    """Kill every writer; print a table, and return 1 if anything was half or mixed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10_000, help="in all, over every writer")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*")
    given = parser.parse_args()
    chosen = [w for w in writers() if not given.only or w.name in given.only]
    rng = random.Random(given.seed)
    failed = total = 0
    with tempfile.TemporaryDirectory(prefix="fringeworks-kills-") as place:
        for writer in chosen:
            most = -(-given.kills // len(chosen))
            try:
                count, complete, seconds = kill(writer, Path(place) / writer.name, most, rng)
            except Exception as error:
                print(f"{writer.name:15} {type(error).__name__}: {error}", flush=True)
                failed += 1
                continue
            total += count
            print(
                f"{writer.name:15} {count:5} kills, {complete:5} whole, {1e3 * seconds:6.1f} ms",
                flush=True,
            )
    print(f"{total} kills, {failed} writers failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
