"""Scans of a calibrated rig → whether it has moved, without a board."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Unpack

from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.files.watch_log import append_watch_log, opened_watch_log
from fringeworks.pipeline.decoding import decoded_exposures
from fringeworks.pipeline.inputs import inputs_of, stacks_of
from fringeworks.pipeline.stacks import check_projector
from fringeworks.rig.drift_watch import BASELINE, FALSE_ALARMS, RigWatch, judge_scans
from fringeworks.rig.scan_evidence import EpipolarEvidence, epipolar_evidence
from fringeworks.rig.sensor_region import rig_for_region
from fringeworks.stack.frames import Stack
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import Finding, InputError, Rig, fingerprint, made_by
from fringeworks.types.provenance import today


def watch_rig(
    rig: Rig | StrPath,
    scans: Iterable[tuple[str, Stack | StrPath]],
    *,
    log: StrPath | None = None,
    baseline: int = BASELINE,
    false_alarms: float = FALSE_ALARMS,
    **options: Unpack[DecodeOptions],
) -> RigWatch:
    """Watch by the scans of parts whether a rig has moved, without a board.

    Parameters
    ----------
    rig : Rig or path
    scans : iterable of (str, Stack or path)
        Names and scans, with both axes of the projector, in the order in which they were taken.
    log : path, optional
        Log (``.jsonl``) of earlier scans, to which these are added. It is made where it is missing.
        Scans that it holds already are not added again.
    baseline : int
        Number of first scans that the rig is learnt from.
    false_alarms : float
        Largest expected number of alarms in 1,000 scans of a rig that holds.
    **options
        Of ``decode``.

    Returns
    -------
    RigWatch: a verdict after each scan, and what the scans of this rig cannot show. A scan that
    says nothing, such as one with a single axis, is left out, and a finding says so.

    Raises
    ------
    FileProblem for a log of another rig; InputError as ``judge_scans``.
    """
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    known = () if log is None else opened_watch_log(log, fingerprint(rig)).evidence
    seen = {one.sha256 for one in known}
    found: list[EpipolarEvidence] = []
    left_out: list[Finding] = []
    for name, scan in scans:
        try:
            one = _evidence(rig, name, scan, seen, options)
            if one is not None:
                found.append(one)
                seen.add(one.sha256)
        except InputError as error:
            left_out.append(
                Finding("scan left out", f"{name}: it says nothing about the rig: {error}")
            )
    kept = tuple(found)
    if log is not None:
        kept = append_watch_log(log, fingerprint(rig), found).evidence
    judged = judge_scans(rig, kept, baseline=baseline, false_alarms=false_alarms)
    origin = made_by(
        "watch_rig",
        options={"baseline": baseline, "false_alarms": false_alarms, **options},
        rig=rig,
    )
    return replace(judged, findings=(*judged.findings, *left_out), provenance=origin)


def _evidence(
    rig: Rig, name: str, scan: Stack | StrPath, seen: set[str], options: DecodeOptions
) -> EpipolarEvidence | None:
    """What one scan says; None for one that was seen before."""
    stacks = stacks_of(scan)
    check_projector(rig, stacks[0])
    fitting = rig_for_region(rig, stacks[0].region)
    frames = fingerprint(tuple(source.sha256 for source in inputs_of(*stacks)))
    if frames in seen:
        return None
    decoded = decoded_exposures(stacks, options)
    return replace(epipolar_evidence(decoded, fitting, name=name, date=today()), sha256=frames)
