"""Work in a process of its own: its progress, its end, and its death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import fringeworks as fw
from fringeworks.serving.worker import Worker
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.studio import tasks
from fringeworks.studio.actions import Export, perform
from fringeworks.studio.workspace import open_workspace
from fringeworks.types import InputError

pytestmark = pytest.mark.system


def counted(link, count):
    for k in range(count):
        link.progress(f"step {k}")
    link.show("kind", count)
    return {"count": count}


def refused(_):
    raise InputError("expected a surface, got none")


def broken(_):
    raise ZeroDivisionError("oops")


def dies(_):
    os._exit(3)


def unsendable(_):
    return threading.Lock()


def endless(link):
    link.progress("begun")
    while not link.stopped():
        time.sleep(0.01)
    return "stopped"


def slow(_, seconds):
    time.sleep(seconds)


@pytest.fixture(scope="module")
def process():
    """One process for all tests: it takes seconds to start, and what kills it is tested too."""
    made = Worker()
    yield made
    made.close()


@pytest.fixture
def worker(process):
    yield process
    process.cancel()


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A stack without a rig."""
    rig = standard_rig(scale=0.25)
    plan = fringe_plan(rig, both=False)
    frames = list(photograph(look(rig, bust()), plan, Optics(seed=1)))
    folder = tmp_path_factory.mktemp("stack") / "c"
    fw.files.write_stack(folder, frames, plan)
    return folder


def ended(job, timeout_s=60):
    start = time.monotonic()
    while job.open:
        assert time.monotonic() - start < timeout_s
        time.sleep(0.01)
    return job


def begun(job):
    start = time.monotonic()
    while not job.steps:
        assert time.monotonic() - start < 60
        time.sleep(0.01)
    return job


def test_work_tells_how_far_it_is(worker):
    job = ended(worker.start("counting", counted, 5, total=5))
    assert (job.state, job.result, job.steps, job.label) == ("done", {"count": 5}, 5, "step 4")
    assert job.latest == {"kind": 5}
    assert job.share == 1.0
    # The same process does the next work.
    one = worker.process_id
    ended(worker.start("counting", counted, 1))
    assert worker.process_id == one


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (refused, "expected a surface, got none"),
        (broken, "internal error, please report it: ZeroDivisionError"),
        (unsendable, "internal error, please report it: TypeError"),
        (dies, "the process ended; start again"),
    ],
)
def test_failures_are_a_sentence_and_the_next_work_is_done(worker, task, said):
    job = ended(worker.start("working", task))
    assert job.state == "failed"
    assert said in job.problem
    assert ended(worker.start("counting", counted, 2)).result == {"count": 2}


def test_work_is_stopped_cancelled_and_killed(worker):
    job = begun(worker.start("endless", endless))
    with pytest.raises(InputError, match="busy with 'endless'"):
        worker.start("counting", counted, 1)
    worker.stop()
    assert ended(job).result == "stopped"
    job = begun(worker.start("endless", endless))
    worker.cancel()
    assert job.state == "cancelled"
    job = begun(worker.start("endless", endless))
    os.kill(worker.process_id, signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM)
    assert "the process ended" in ended(job).problem
    assert ended(worker.start("counting", counted, 2)).state == "done"


def test_an_idle_process_that_dies_is_replaced(worker):
    ended(worker.start("counting", counted, 1))
    os.kill(worker.process_id, signal.SIGTERM)
    time.sleep(0.5)
    assert ended(worker.start("counting", counted, 3)).result == {"count": 3}


def test_a_missing_package_is_named(tmp_path):
    script = "import sys; sys.modules['nicegui'] = None; import fringeworks as fw; "
    command = [sys.executable, "-c", f"{script}fw.run_studio({str(tmp_path)!r})"]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert "MissingPackage: studio: expected the package nicegui" in said
    assert "pip install 'fringeworks[studio]'" in said


@pytest.mark.parametrize("suffix", [".ply", ".npz", ".html"])
def test_coordinates_without_a_rig(worker, capture, tmp_path, suffix):
    """A stack without a rig has coordinates, which are written as they can be."""
    target = tmp_path / f"c{suffix}"
    source = tasks.Source(capture.name, capture, None, "windowed", {})
    action, space = Export(source, target.name, ""), open_workspace(tmp_path)
    job = ended(worker.start("writing", perform, action, space))
    if suffix == ".ply":
        assert "coordinates are written as .npz" in job.problem
    else:
        assert job.result == target.name, job.problem
        assert target.is_file()


def test_work_waits_for_the_work_before(worker):
    first = worker.start("first", slow, 0.5)
    second = worker.start("second", slow, 0.0, wait=True)
    third = worker.start("third", slow, 0.0, wait=True)
    assert (second.state, third.state) == ("waiting", "waiting")
    with pytest.raises(InputError, match="busy with 'first'"):
        worker.start("fourth", slow, 0.0)
    worker.cancel(third)
    ended(second)
    assert (first.state, second.state, third.state) == ("done", "done", "cancelled")


@pytest.mark.long
def test_work_that_waits_begins_whatever_ends_the_work_before(worker):
    for end in (worker.cancel, lambda: os.kill(worker.process_id, signal.SIGKILL)):
        first = worker.start("first", slow, 60.0)
        second = worker.start("second", slow, 0.0, wait=True)
        time.sleep(0.5)
        end()
        assert ended(second).state == "done"
        assert first.state in ("cancelled", "failed")
