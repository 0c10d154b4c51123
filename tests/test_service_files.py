"""Files of the service: results as a whole, frames in memory, and what a damaged queue becomes."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.clock import SimulatedClock
from fringeworks.scan.bench import Bench, Take, take, take_in_memory
from fringeworks.service.models import JobInfo, ScanRequest
from fringeworks.service.scanner import check_recipe
from fringeworks.service.store import Store
from fringeworks.types import FileProblem


def job(number, state="waiting"):
    request = ScanRequest()
    return JobInfo(
        number=number,
        kind="scan",
        name=None,
        key=None,
        state=state,
        place=None,
        accepted="",
        ended=None,
        attempts=0,
        step=0,
        steps=0,
        problem=None,
        request=request,
        result=None,
    )


def test_results_are_there_as_a_whole_and_old_ones_go(tmp_path):
    store = Store(tmp_path, keep=2)
    for number in (1, 2, 3):
        store.put(job(number))
        (store.half(number)).mkdir()
        (store.half(number) / "cloud.npz").write_bytes(b"x")
        store.capture(number).mkdir()
        assert [n for n, _ in store.open_jobs()] == [number]
        store.end(job(number, "done"))
        assert store.open_jobs() == []
    assert [one.number for one in store.ended()] == [1, 2, 3]
    assert store.purge() == [1]
    assert [one.number for one in store.ended()] == [2, 3]
    assert not store.capture(1).exists()
    assert store.capture(2).is_dir()
    # Ended just before the power went: the entry of the queue is dropped.
    store.put(job(3))
    assert store.open_jobs() == []
    with pytest.raises(FileProblem, match="another service"):
        Store(tmp_path, keep=2)
    store.close()
    Store(tmp_path, keep=2).close()


def test_frames_in_memory_are_those_of_a_capture(tmp_path):
    """The same bits come from memory and from the written capture."""
    rig = fw.devices.virtual_rig()
    plan = fw.simulate.fringe_plan(rig, both=False)
    clouds = []
    for average in (1, 2):
        for on_disk in (True, False):
            projector, camera = fw.devices.virtual_bench("sphere", clock=SimulatedClock(), seed=7)
            bench = Bench(projector, camera, chosen_plan=plan)
            how = Take(average=average)
            found = (
                take(bench, tmp_path / f"c{average}", how)
                if on_disk
                else take_in_memory(bench, how)
            )
            clouds.append(fw.measure(found, rig).points)
    for disk, memory in (clouds[:2], clouds[2:]):
        assert np.array_equal(disk.xyz_mm, memory.xyz_mm, equal_nan=True)
        assert np.array_equal(disk.sigma_mm, memory.sigma_mm, equal_nan=True)
        assert [one.text for one in disk.findings] == [one.text for one in memory.findings]
    with pytest.raises(fw.InputError, match="need a folder"):
        take_in_memory(bench, Take(hdr=2))


def test_a_recipe_whose_rig_is_elsewhere_is_refused_before_the_scan(tmp_path):
    path = tmp_path / "part.toml"
    path.write_text('kind = "recipe"\nrig = "rig.toml"\n', "utf-8")
    with pytest.raises(fw.FileProblem, match=r"part.toml: .* rig.toml, .* delete the line"):
        check_recipe(path)
    path.write_text('kind = "recipe"\n', "utf-8")
    check_recipe(path)
