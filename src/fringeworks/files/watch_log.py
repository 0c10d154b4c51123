"""The log of a watched rig: what each scan says about it, a line of JSON each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.limits import existing_file, is_file, parsing, read_content, text_of
from fringeworks.rig.scan_evidence import EpipolarEvidence
from fringeworks.types import FileProblem, FloatMap, Frozen

KIND = "fringeworks watch log"
"""What the first line says that the file is."""
VERSION = 1
"""Version of the file's layout."""
SIZE = 24
"""Parameters of a rig."""


@dataclass(frozen=True, eq=False, repr=False)
class WatchLog(Frozen):
    """The scans of a watched rig."""

    rig_sha256: str
    """Fingerprint of the rig that all scans were compared with."""
    evidence: tuple[EpipolarEvidence, ...]
    """In the order in which they were added."""


def append_watch_log(
    path: StrPath, rig_sha256: str, evidence: Sequence[EpipolarEvidence]
) -> WatchLog:
    """Add scans to the log of a watched rig; the file is made where it is missing.

    Parameters
    ----------
    path : path
        ``.jsonl``.
    rig_sha256 : str
        Fingerprint of the rig that the scans were compared with.
    evidence : sequence of EpipolarEvidence
        Scans whose fingerprint is in the log already are not added again.

    Returns
    -------
    WatchLog with all scans.

    Raises
    ------
    FileProblem for another suffix, a folder that is missing, a file that is no log, and the log of
    another rig; it is then left as it is.
    """
    target = Path(path)
    known = opened_watch_log(target, rig_sha256)
    seen = {one.sha256 for one in known.evidence if one.sha256}
    added = [one for one in evidence if not one.sha256 or one.sha256 not in seen]
    found = WatchLog(rig_sha256, (*known.evidence, *added))
    head = {"kind": KIND, "version": VERSION, "rig_sha256": rig_sha256}
    lines = [json.dumps(head), *(json.dumps(_line(one)) for one in found.evidence)]
    write_text(target, "\n".join(lines) + "\n")
    return found


def opened_watch_log(path: StrPath, rig_sha256: str) -> WatchLog:
    """Read the log of a rig to which scans are added; an empty one where there is no file.

    Raises
    ------
    FileProblem for another suffix, a folder that is missing, a file that is no log, and the log of
    another rig.
    """
    target = Path(path)
    check_target(target, (".jsonl",))
    known = read_watch_log(target) if is_file(target) else WatchLog(rig_sha256, ())
    if known.rig_sha256 != rig_sha256:
        raise FileProblem(
            f"{target}: it is the log of another rig; begin a new log for a rig that was "
            "calibrated again"
        )
    return known


def read_watch_log(path: StrPath) -> WatchLog:
    """Read the log of a watched rig.

    Raises
    ------
    FileProblem for a file that is no such log.
    """
    place = existing_file(path, "the log of a watched rig (JSON lines)")
    content = read_content(place, "the log of a watched rig")
    with parsing(place, "the log of a watched rig (JSON lines)"):
        lines = [line for line in text_of(content).splitlines() if line.strip()]
        head = json.loads(lines[0]) if lines else {}
        if not isinstance(head, dict) or head.get("kind") != KIND:
            raise FileProblem(f"expected {KIND!r} in the first line, got something else")
        if head.get("version") != VERSION:
            raise FileProblem(f"expected version {VERSION}, got {head.get('version')!r}")
        evidence = tuple(_evidence(json.loads(line)) for line in lines[1:])
        return WatchLog(str(head["rig_sha256"]), evidence)


LOWER = np.tril_indices(SIZE)
"""Places of the numbers of a symmetric matrix that are written."""


def _line(one: EpipolarEvidence) -> dict[str, Any]:
    """A scan as JSON values."""
    return {
        "name": one.name,
        "date": one.date,
        "sha256": one.sha256,
        "cells": one.cells,
        "pixels": one.pixels,
        "noise_px": one.noise_px,
        "scatter_px": one.scatter_px,
        "score": one.score.tolist(),
        "information": one.information[LOWER].tolist(),
    }


def _evidence(item: dict[str, Any]) -> EpipolarEvidence:
    """A scan from its JSON values."""
    information: FloatMap = np.zeros((SIZE, SIZE))
    information[LOWER] = np.asarray(item["information"], np.float64)
    information += np.tril(information, -1).T
    return EpipolarEvidence(
        information=information,
        score=np.asarray(item["score"], np.float64),
        cells=int(item["cells"]),
        pixels=int(item["pixels"]),
        noise_px=float(item["noise_px"]),
        scatter_px=float(item["scatter_px"]),
        name=str(item["name"]),
        date=str(item["date"]),
        sha256=str(item["sha256"]),
    )
