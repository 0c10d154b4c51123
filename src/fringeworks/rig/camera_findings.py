"""What the disagreement of several cameras says about a rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.camera_points import CameraPoints
from fringeworks.types import Finding, MultiRig, Reason
from fringeworks.types.numbers import number as number_text

MAX_DISAGREEMENT = 2.0
"""Root mean square difference of pairs of devices, over what σ says, from which on it is a finding.
Errors of the calibration are common to all pixels, so one calibration in twenty reaches 2."""
MIN_COMPARED = 100
"""Smallest number of pixels that are compared; with fewer, chance decides."""
MAX_MISFIT_PX = 0.5
"""Distance from the epipolar lines, beyond what noise and the rig explain, from which on it is a
finding, px. Calibrations of two cameras usually leave 0.1 to 0.3 px."""
HISTOGRAM_SIGMAS = 5.0
"""Range of the histogram of differences, to both sides, in standard deviations."""
HISTOGRAM_BINS = 20
"""Number of its bins: half a standard deviation each."""


def camera_findings(cameras: Sequence[CameraPoints]) -> tuple[Finding, ...]:
    """Return a finding for every camera whose pairs of devices disagree beyond their σ.

    Examples
    --------
    >>> camera_findings([])
    ()
    """
    findings = []
    for number, found in enumerate(cameras, 1):
        sigmas = found.difference_sigmas[np.isfinite(found.difference_sigmas)]
        if "projector" not in found.devices:
            findings += _coded_findings(number, found)
        if len(found.devices) == 1:
            continue
        if sigmas.size < MIN_COMPARED:
            findings.append(_unmatched(number))
            continue
        usual = float(np.sqrt(np.mean(np.clip(sigmas.astype(np.float64), -50.0, 50.0) ** 2)))
        if usual <= MAX_DISAGREEMENT:
            continue
        mm = found.difference_mm[np.isfinite(found.difference_mm)]
        median = float(np.median(mm))
        findings.append(
            Finding(
                "cameras",
                f"camera {number}: points with the projector and with another camera differ by "
                f"{usual:.1f} times their standard deviation, by {median:.3g} mm in the median",
                (
                    "a device that moved since the calibration",
                    "light that reached one camera by a reflection",
                ),
                "calibrate again; the map of differences shows where they disagree",
                figures={"disagreement_sigmas": usual, "median_difference_mm": median},
            )
        )
    return tuple(findings)


def _coded_findings(number: int, found: CameraPoints) -> list[Finding]:
    """What matches by codes alone say about the rig."""
    count = int((found.points.reason == Reason.OK).sum())
    if count < MIN_COMPARED:
        return [
            Finding(
                "cameras",
                f"camera {number}: the codes of {count} pixels lead to a point with another camera",
                (
                    "captures in another order than the rig's cameras",
                    "a rig file whose rotation or translation has another direction",
                    "frames of different scenes",
                ),
                "check the order of the captures and the rig",
                figures={"points": float(count)},
                severity="error",
            )
        ]
    if found.misfit_px <= MAX_MISFIT_PX:
        return []
    return [
        Finding(
            "cameras",
            f"camera {number}: matches are {number_text(found.misfit_px)} px from the epipolar "
            "lines, more than noise and the rig explain; standard deviations contain it",
            (
                "a camera that moved since the calibration",
                "a rig of other frames, such as rectified, cropped or resampled ones",
            ),
            "calibrate the cameras again",
            figures={"misfit_px": found.misfit_px},
        )
    ]


def uncertainty_findings(rig: MultiRig) -> tuple[Finding, ...]:
    """Return a note for cameras whose rig states no uncertainty.

    Examples
    --------
    >>> from fringeworks.simulate import standard_cameras
    >>> uncertainty_findings(standard_cameras(scale=0.1))
    ()
    """
    if rig.projector is not None or rig.covariance is not None:
        return ()
    return (
        Finding(
            "uncertainty",
            "the rig states no uncertainty: standard deviations hold the noise and what the "
            "epipolar lines show, not the errors of its scale and its angles",
            advice="calibrate the cameras with this package to have them",
            severity="note",
        ),
    )


def _unmatched(number: int) -> Finding:
    return Finding(
        "cameras",
        f"camera {number}: almost no point is seen by another camera as well, so its points come "
        "from the projector alone",
        ("cameras that look at different parts", "frames of different scenes"),
        "check that all cameras see the part",
    )


def difference_histogram(found: CameraPoints) -> dict[str, list[float]]:
    """Return the histogram of normalised differences between pairs of devices.

    Returns
    -------
    ``edges_sigmas``, 21 values, and ``share``, 20 values that add up to 1; those beyond the ends
    are in the outermost bins.
    """
    sigmas = found.difference_sigmas[np.isfinite(found.difference_sigmas)]
    edges = np.linspace(-HISTOGRAM_SIGMAS, HISTOGRAM_SIGMAS, HISTOGRAM_BINS + 1)
    inside = np.clip(sigmas, edges[0], np.nextafter(edges[-1], 0.0))
    counts = np.histogram(inside, edges)[0]
    return {
        "edges_sigmas": [float(edge) for edge in edges],
        "share": [float(count) / max(int(counts.sum()), 1) for count in counts],
    }
