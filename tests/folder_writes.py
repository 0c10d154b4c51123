"""What is written over a folder again and again, and whether what lies there is one thing."""

from __future__ import annotations

import numpy as np

import fringeworks as fw
from tests.stacks import multi

PLANS = (multi((1, 8), 4, (300, 40)), multi((1, 5, 25), 3, (240, 30)))


def content(k):
    """The k-th thing that is written over the last: stacks, pairs and pictures in turn."""
    plan = PLANS[k % 2]
    if k % 3 == 0:
        shape = (plan.height_px, plan.width_px)
        frames = [
            np.full(shape, k % 251, np.uint8) + np.arange(shape[1], dtype=np.uint8) % 4
        ] * plan.frames
        return lambda folder: fw.files.write_stack(folder, frames, plan, force=True)
    if k % 3 == 1:
        frame = np.full((40, 50), k % 251, np.uint8)
        pair = fw.Pair(frame, frame + 1, mask=frame > 0)
        return lambda folder: fw.files.write_pair(folder, pair, force=True)
    return lambda folder: fw.files.write_patterns(folder, plan, force=True)


def check(folder):
    """Whatever can be read is one thing, as one call wrote it; true where there is something."""
    try:
        found = fw.files.read_capture(folder)
    except fw.FileProblem:
        return False
    if isinstance(found, fw.Pair):
        assert len({*np.unique(found.reference), *(np.unique(found.object) - 1)}) == 1
        return True
    assert found.plan in PLANS
    assert len(found.frames) == found.plan.frames
    written = np.stack(found.frames)
    pictures = np.stack(list(fw.encode(found.plan)))
    if not np.array_equal(written, pictures):
        assert len(np.unique(written[:, :, 0])) == 1
    return True
