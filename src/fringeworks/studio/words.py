"""How far work is, in words that everybody reads."""

from __future__ import annotations

import re

from fringeworks.serving.worker import Job

PICTURE = re.compile(r"(x|y)-|white|black|colours-")
"""Beginnings of the labels of a plan's pictures, such as ``y-phase-6.03px-0``, which name files."""


def step_words(job: Job) -> str:
    """What a running job does now; the frame's number in place of its file's name."""
    if not PICTURE.match(job.label):
        return job.label
    return f"frame {job.steps} of {job.total}" if job.total else "taking frames"
