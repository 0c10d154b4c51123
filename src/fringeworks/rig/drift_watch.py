"""Whether a rig has moved, by the epipolar errors of its scans: a control chart of drift modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from fringeworks._lazy import scipy
from fringeworks.rig.drift_learning import WITHIN, Learnt, Said, effect, learn, together
from fringeworks.rig.drift_words import (
    blind_finding,
    learning_finding,
    likely_causes,
    moved_finding,
    suspect_finding,
    unusual_findings,
)
from fringeworks.rig.scan_evidence import MODES, EpipolarEvidence, drift_units
from fringeworks.types import Finding, FloatMap, Frozen, InputError, Noted, Provenance, Rig

ScanVerdict = Literal["learning", "holds", "suspect", "has moved"]
"""What a scan says: it is one of those that the rig is learnt from; the rig holds; this scan
differs and the next ones decide; the rig has moved."""

BASELINE = 20
"""Scans from which the rig's usual errors are learnt, by default. The limits shrink by a quarter
from 20 to 40 scans, and more than double from 20 to 12."""
FEWEST_BASELINE = 12
"""Smallest number of scans to learn from: five more than the modes, so that limits are finite."""
FALSE_ALARMS = 1.0
"""Expected alarms in 1,000 scans of a rig that holds, at most, by default."""
WINDOWS = (2, 3, 5, 10, 20)
"""Numbers of last scans that are judged together. Two and three find a knock soon, many a small
one (window-limited likelihood ratios: T. L. Lai, J. R. Stat. Soc. B 57, 1995,
doi:10.1111/j.2517-6161.1995.tb02052.x)."""
MOST_LEFT_OUT = 2
"""Largest number of first scans that are left out of the learning because they differ from the
others. More of them are what is usual for this rig."""
POWER = 0.9
"""Probability with which the smallest noticeable knock is found."""
UNSEEN = 1e-6
"""Square of a change by 1° or 1 mm over its covariance below which it counts as not seen: one has
to be a thousand times as large to be one standard deviation."""


@dataclass(frozen=True, eq=False, repr=False)
class WatchedScan(Frozen):
    """What is known of a rig after one of its scans."""

    name: str
    date: str
    verdict: ScanVerdict
    excess: float
    """Largest statistic of the windows that end here, over its limit; above 1 the rig has moved.
    NaN while the rig is learnt."""
    own_excess: float
    """The same for this scan alone; above 1 it is suspect. NaN while the rig is learnt."""
    modes: FloatMap
    """(k,) Change of the watched modes since the rig was learnt, by this scan alone."""
    covariance: FloatMap
    """(k, k) Its covariance, with that of what was learnt and of what differs from scan to scan."""
    since: int = 0
    """Number of scans, this one included, in which the change is seen; 0 for none."""


@dataclass(frozen=True, eq=False, repr=False)
class RigWatch(Noted, Frozen):
    """What the scans of a rig say about it, in the order in which they were taken."""

    scans: tuple[WatchedScan, ...]
    baseline: int
    """Number of scans from which the rig is learnt."""
    false_alarms: float
    """Largest expected number of alarms in 1,000 scans of a rig that holds."""
    modes: FloatMap
    """(7, k) The watched modes, in units of the changes of ``MODES``; k = 0 while learning."""
    scatter: FloatMap
    """(k, k) Covariance of the modes from scan to scan, in these units."""
    noticeable: dict[str, float]
    """Smallest change by which the rig is found to have moved within three scans with a probability
    of 90 %, by name: degrees, mm, or a share of the focal length. ∞ for what is not seen."""
    findings: tuple[Finding, ...] = ()
    provenance: Provenance | None = None
    """How it was made; None where the caller collected the evidence."""

    @property
    def verdict(self) -> ScanVerdict:
        """What the last scan says."""
        return self.scans[-1].verdict if self.scans else "learning"


def judge_scans(
    rig: Rig,
    evidence: Sequence[EpipolarEvidence],
    *,
    baseline: int = BASELINE,
    false_alarms: float = FALSE_ALARMS,
) -> RigWatch:
    """Judge whether a rig has moved since its first scans, without a board.

    Parameters
    ----------
    rig : Rig
        With which all of the evidence was collected.
    evidence : sequence of EpipolarEvidence
        A scan each, in the order in which they were taken.
    baseline : int ≥ 12
        Number of first scans from which the rig's usual errors, and what differs from scan to
        scan, are learnt. They should show what later scans do: parts at several places and depths.
    false_alarms : float, 0…100
        Largest expected number of alarms in 1,000 scans of a rig that holds.

    Returns
    -------
    RigWatch

    Raises
    ------
    InputError for other numbers.

    Notes
    -----
    Every scan says J δ for the deviation δ of the 24 parameters; what differs from scan to scan is
    a random change of the modes. The first scans, without up to two that differ, give the mean of
    δ, with the rig's covariance as its prior, and the covariance of the random changes
    (docs/control.md). The last m scans are combined by their information. The square of the common
    change over its covariance is compared with the quantile of Hotelling's distribution (H.
    Hotelling, Annals of Mathematical Statistics 2, 1931, doi:10.1214/aoms/1177732979) whose
    probabilities for all windows sum to the stated rate. A rig has moved where this holds without
    any one of these scans: a part that moved during one scan is no drift.
    """
    if not (isinstance(baseline, int) and baseline >= FEWEST_BASELINE):
        raise InputError(f"baseline: expected at least {FEWEST_BASELINE} scans, got {baseline}")
    if not 0.0 < false_alarms <= 100.0:
        raise InputError(f"false_alarms: expected 0 to 100 in 1,000 scans, got {false_alarms}")
    scans = [_learning(one) for one in evidence[:baseline]]
    if len(evidence) < baseline:
        none = np.zeros((0, 0))
        note = (learning_finding(len(evidence), baseline),)
        modes = np.zeros((len(MODES), 0))
        return RigWatch(tuple(scans), baseline, false_alarms, modes, none, {}, note)
    risk = 1e-3 * false_alarms / len(WINDOWS)
    learnt, left_out = _learn_usual(rig, evidence[:baseline], risk)
    limit = _hotelling(learnt.modes.shape[1], learnt.freedom, risk)
    said = [learnt.said(one) for one in evidence]
    for number in range(baseline, len(evidence)):
        scans.append(_judge(evidence[number], said[baseline : number + 1], learnt, limit))
    noticeable = _noticeable(rig, said[:baseline], learnt, limit)
    told = (
        *_last_findings(rig, scans[-1], said, learnt),
        *unusual_findings(left_out),
        blind_finding(noticeable),
    )
    return RigWatch(
        tuple(scans), baseline, false_alarms, learnt.modes, learnt.scatter, noticeable, told
    )


def _learn_usual(
    rig: Rig, evidence: Sequence[EpipolarEvidence], risk: float
) -> tuple[Learnt, tuple[str, ...]]:
    """Learn a rig without scans during which something moved; and the names of these scans."""
    kept = list(evidence)
    left_out: list[str] = []
    while True:
        learnt = learn(rig, kept)
        if len(left_out) == MOST_LEFT_OUT or not learnt.modes.size:
            return learnt, tuple(left_out)
        squares = [effect([learnt.said(one)], learnt).square for one in kept]
        farthest = int(np.argmax(squares))
        others = kept[:farthest] + kept[farthest + 1 :]
        without = learn(rig, others)
        square = effect([without.said(kept[farthest])], without).square
        if square <= _hotelling(without.modes.shape[1], without.freedom, risk / len(kept)):
            return learnt, tuple(left_out)
        left_out.append(kept[farthest].name)
        kept = others


def _last_findings(
    rig: Rig, last: WatchedScan, parts: Sequence[Said], learnt: Learnt
) -> tuple[Finding, ...]:
    """What the last scan says."""
    if last.verdict == "suspect":
        return (suspect_finding(last.name, last.own_excess),)
    if last.verdict != "has moved":
        return ()
    seen = effect(parts[-last.since :], learnt)
    causes = likely_causes(learnt.of(drift_units(rig)), seen.said)
    return (moved_finding(last.name, last.since, last.excess, causes),)


def _learning(one: EpipolarEvidence) -> WatchedScan:
    nan = float("nan")
    none = np.zeros(0)
    return WatchedScan(one.name, one.date, "learning", nan, nan, none, none.reshape(0, 0))


def _judge(
    one: EpipolarEvidence,
    parts: Sequence[Said],
    learnt: Learnt,
    limit: float,
) -> WatchedScan:
    """Judge a rig after its last scan."""
    alone = effect(parts[-1:], learnt)
    own = alone.square / limit
    excess, since = 0.0, 0
    for m in WINDOWS:
        if m > len(parts):
            break
        last = parts[-m:]
        least = min(effect([*last[:k], *last[k + 1 :]], learnt).square for k in range(m))
        if least / limit > excess:
            excess, since = least / limit, m
    verdict: ScanVerdict = "holds" if own <= 1.0 else "suspect"
    if excess > 1.0:
        verdict = "has moved"
    return WatchedScan(
        one.name,
        one.date,
        verdict,
        excess,
        own,
        alone.change,
        np.linalg.inv(alone.precision),
        since if excess > 1.0 else 0,
    )


@lru_cache
def _hotelling(count: int, freedom: int, risk: float) -> float:
    """Quantile of Hotelling's T² of some modes, whose covariance has degrees of freedom."""
    if count == 0:
        return float("inf")
    left = freedom - count + 1
    return float(count * freedom / left * scipy.stats.f.isf(risk, count, left))


def _noticeable(rig: Rig, parts: Sequence[Said], learnt: Learnt, limit: float) -> dict[str, float]:
    """Smallest change of each kind that is found within three average scans."""
    names = {
        **{f"rotation {axis}, degrees": (18 + k, np.radians(1.0)) for k, axis in enumerate("xyz")},
        **{f"translation {axis}, mm": (21 + k, 1.0) for k, axis in enumerate("xyz")},
    }
    changes = {name: unit * np.eye(24)[place] for name, (place, unit) in names.items()}
    along = np.zeros(24)
    along[21:] = rig.T_projector_camera[:3, 3] / rig.baseline_mm
    changes["translation along the baseline, mm"] = along
    for name, first, device in (("camera", 0, rig.camera), ("projector", 9, rig.projector)):
        focus = np.zeros(24)
        focus[first : first + 2] = device.focal_px
        changes[f"{name} focus, share"] = focus
    if not learnt.modes.size:
        return dict.fromkeys(changes, float("inf"))
    # One of the three scans may be left out.
    usual = together(parts)
    mean = Said(usual.information * (WITHIN - 1) / len(parts), usual.score)
    seen = effect([mean], learnt)
    to_modes = learnt.units.T @ seen.said.information
    needed = _needed(limit, learnt.modes.shape[1])
    found = {}
    for name, change in changes.items():
        push = to_modes @ learnt.of(change)
        square = float(push @ np.linalg.solve(seen.precision, push))
        found[name] = float(np.sqrt(needed / square)) if square > UNSEEN else float("inf")
    return found


@lru_cache
def _needed(limit: float, count: int) -> float:
    """Non-centrality at which a squared change exceeds a limit with ``POWER``."""
    most = 4.0 * limit + 100.0
    return float(
        scipy.optimize.brentq(
            lambda size: scipy.stats.ncx2.sf(limit, count, size) - POWER, 1e-6, most
        )
    )
