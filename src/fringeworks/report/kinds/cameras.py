"""What is shown of the calibration and the points of several cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.pipeline.cameras import MultiMeasurement
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.sheets import Panel, Sheet, titled
from fringeworks.report.summary import finding_words, origin, told
from fringeworks.rig.calibration.cameras import MultiCalibration
from fringeworks.rig.calibration.diagnosis import few_corners, skipped_poses
from fringeworks.rig.camera_findings import difference_histogram
from fringeworks.rig.camera_points import CameraPoints
from fringeworks.types import FloatMap, Reason, count_reasons, multi_rig_parameters
from fringeworks.types.numbers import number, percent, sigma_text

PLACE_DIGITS = 5
"""Significant digits of places of cameras, mm: a metre to a tenth of a millimetre."""


def calibration_figures(calibration: MultiCalibration) -> dict[str, Any]:
    """The places of the cameras, their residuals and standard deviations."""
    rig, adjusted = calibration.rig, calibration.adjusted
    assert rig.covariance is not None
    assert rig.residual_px is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    alone = rig.projector is None
    names = multi_rig_parameters(len(rig.cameras), projector=not alone)
    named = zip(names, sigma, strict=True)
    predicted = dict(zip(calibration.poses, calibration.predicted_px, strict=False))
    return {
        "cameras": [
            {
                "number": number,
                "poses": [o.name for o in seen],
                "rms_px": rig.residual_px[number - 1],
                "place_mm": (-T[:3, :3].T @ T[:3, 3]).tolist(),
            }
            for number, (seen, T) in enumerate(
                zip(calibration.observations, rig.T_camera_first, strict=True), 1
            )
        ],
        "projector_rms_px": None if alone else rig.residual_px[-1],
        "sigma": {name: float(value) for name, value in named},
        "predicted_rms_px": predicted,
        "skipped": calibration.skipped,
        "findings": findings_as_dicts(
            [
                *(
                    replace(found, seen=f"camera {number}, {found.seen}")
                    for number, seen in enumerate(calibration.observations, 1)
                    for found in few_corners(seen)
                ),
                *skipped_poses(calibration.skipped),
            ]
        ),
        "print_error_mm": adjusted.prior.print_mm,
        "sigma_inflation": calibration.inflation,
        "converged": adjusted.converged,
        **origin(rig.provenance),
    }


def calibration_words(_: MultiCalibration, figures: dict[str, Any]) -> Iterator[Word]:
    """The cameras, and how well poses predict each other."""
    for camera in figures["cameras"]:
        place = ", ".join(number(v, digits=PLACE_DIGITS) for v in camera["place_mm"])
        yield (
            f"camera {camera['number']}: {len(camera['poses'])} poses, reprojection "
            f"{number(camera['rms_px'])} px, at ({place}) mm"
        )
    if figures["projector_rms_px"] is not None:
        yield f"projector: reprojection {number(figures['projector_rms_px'])} px"
    for name, value in figures["predicted_rms_px"].items():
        yield f"{name}: predicted by the others to {number(value)} px rms"
    yield from finding_words(figures)
    if figures["sigma_inflation"] > 1.0:
        yield (
            f"standard deviations are raised by {number(figures['sigma_inflation'])}, because "
            "poses disagree by more than their corners explain"
        )


def point_figures(found: MultiMeasurement) -> dict[str, Any]:
    """Points of all cameras and of each."""
    points = found.points
    return {
        "points": len(points.xyz_mm),
        "median_sigma_mm": _median(points.sigma_mm),
        "median_noise_mm": _median(points.noise_mm),
        "cameras": [_of_camera(number, seen) for number, seen in enumerate(found.cameras, 1)],
        **told(found),
        **origin(points.provenance),
    }


def _of_camera(number: int, seen: CameraPoints) -> dict[str, Any]:
    """Points, pairs and disagreement of one camera."""
    ok = seen.points.reason == Reason.OK
    names = [
        "projector" if isinstance(device, str) else f"camera {device + 1}"
        for device in seen.devices
    ]
    return {
        "number": number,
        "points": int(ok.sum()),
        "confirmed_by_cameras": int(seen.matched.sum()),
        "misfit_px": seen.misfit_px,
        "reasons": count_reasons(seen.points.reason),
        "median_sigma_mm": _median(seen.points.sigma_mm[ok]),
        "pairs": {
            name: {
                "points": int((pair.reason == Reason.OK).sum()),
                "median_sigma_mm": _median(pair.sigma_mm[pair.reason == Reason.OK]),
                "mean_weight": _mean(seen.weights[..., i][ok]),
            }
            for i, (name, pair) in enumerate(zip(names, seen.pairs, strict=True))
        },
        "median_difference_mm": _median(seen.difference_mm[np.isfinite(seen.difference_mm)]),
        "difference_histogram": difference_histogram(seen),
    }


def _median(values: FloatMap | None) -> float | None:
    return None if values is None or not values.size else float(np.median(values))


def _mean(values: FloatMap) -> float | None:
    return float(values.mean()) if values.size else None


def point_words(_: MultiMeasurement, figures: dict[str, Any]) -> Iterator[Word]:
    """Points of each camera and of its pairs."""
    yield from finding_words(figures)
    for camera in figures["cameras"]:
        line = f"camera {camera['number']}: {camera['points']} points"
        if len(camera["pairs"]) > 1:
            line += f", {camera['confirmed_by_cameras']} confirmed by another camera"
        yield line
        for name, pair in camera["pairs"].items():
            if pair["points"]:
                yield (
                    f"   with {name}: {pair['points']} points, median σ "
                    f"{sigma_text(pair['median_sigma_mm'])} mm, mean weight "
                    f"{number(pair['mean_weight'])}"
                )
    if figures["points"]:
        yield f"{figures['points']} points, median σ {sigma_text(figures['median_sigma_mm'])} mm"


def picture(found: MultiMeasurement, name: str | None) -> Sheet:
    """A row of maps for every camera: depth, σ and disagreement."""
    panels, facts = [], []
    for k, seen in enumerate(found.cameras, 1):
        cloud = seen.points
        sigmas = seen.difference_sigmas
        apart = sigmas[np.isfinite(sigmas)]
        fact = f"camera {k}: {percent(1.0 - cloud.failed_fraction)} measured"
        if len(seen.devices) > 1:
            confirmed = float(np.mean(seen.matched[cloud.reason == Reason.OK]))
            usual = f"{number(float(np.sqrt(np.mean(apart**2))))} σ rms" if apart.size else "none"
            fact += f"   ·   {percent(confirmed)} of them confirmed by another camera"
            fact += f"   ·   difference {usual}"
        facts.append(fact)
        panels += [
            Panel(f"camera {k}: depth z", cloud.xyz_mm[..., 2], "depth", "mm"),
            Panel(f"camera {k}: σ along the ray", cloud.sigma_mm, "sigma", "mm"),
        ]
        if "projector" in seen.devices:
            panels += [
                Panel(f"camera {k}: cameras less projector", seen.difference_mm, "values", "mm"),
                Panel(f"camera {k}: the same over its σ", sigmas, "values", "σ"),
            ]
        elif seen.across_sigmas is not None and cloud.residual_px is not None:
            off = cloud.residual_px
            panels += [
                Panel(f"camera {k}: distance from the epipolar line", off, "values", "px"),
                Panel(f"camera {k}: the same over its σ", seen.across_sigmas, "values", "σ"),
            ]
    title = titled(name, "Points of several cameras")
    columns = len(panels) // len(found.cameras)
    return Sheet(title, "\n".join(facts), panels, columns=columns, findings=found.findings)


describe(MultiCalibration, Kind(calibration_figures, calibration_words))
describe(MultiMeasurement, Kind(point_figures, point_words, picture))
