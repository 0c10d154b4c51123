"""What is shown of a calibration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.display import plot
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.kinds.rig import parameter_row
from fringeworks.report.page.blocks import Chapter, Picture
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.parts import (
    dict_table,
    facts,
    findings_block,
    provenance_block,
    with_unit,
)
from fringeworks.report.sheets import titled
from fringeworks.report.summary import finding_words, origin
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.rig.calibration.verdict import verdict
from fringeworks.types import RIG_PARAMETERS
from fringeworks.types.numbers import estimate, number, percent

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure


def figures(calibration: Calibration) -> dict[str, Any]:
    """Parameters, poses, findings and verdict."""
    rig = calibration.rig
    assert rig.covariance is not None
    assert rig.residual_px is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    offset = rig.T_projector_camera[:3, 3]
    values = [*rig.camera.parameters, *rig.projector.parameters]
    gradient = np.concatenate((np.zeros(21), offset / rig.baseline_mm))
    camera, projector = coverage(calibration)
    judged = verdict(calibration)
    return {
        "parameters": {
            name: {"value": float(value), "sigma": float(s)}
            for name, value, s in zip(RIG_PARAMETERS, values, sigma, strict=False)
        },
        "baseline_mm": rig.baseline_mm,
        "baseline_sigma_mm": float(np.sqrt(gradient @ rig.covariance @ gradient)),
        "camera_rms_px": rig.residual_px[0],
        "projector_rms_px": rig.residual_px[1],
        "camera_coverage": camera,
        "projector_coverage": projector,
        "poses": pose_figures(calibration),
        "findings": findings_as_dicts(diagnose(calibration)),
        "print_error_mm": calibration.adjusted.prior.print_mm,
        "camera_blur_px": None if rig.blur is None else rig.blur.middle_px,
        "sigma_inflation": calibration.inflation,
        "converged": calibration.adjusted.converged,
        "verdict": {
            "sigma_mm": judged.sigma_mm,
            "distance_mm": judged.distance_mm,
            "text": judged.text,
        },
        **origin(rig.provenance),
    }


def words(_: Calibration, figures: dict[str, Any]) -> Iterator[Word]:
    """Parameters, poses and findings of a calibration."""
    for name, entry in figures["parameters"].items():
        yield f"{name:14s} {estimate(entry['value'], entry['sigma'])}"
    baseline = estimate(figures["baseline_mm"], figures["baseline_sigma_mm"], "mm")
    yield f"{'baseline':14s} {baseline}"
    yield "pose            corners   camera  projector  predicted by the others (rms, px)"
    for row in figures["poses"]:
        predicted = row["predicted_rms_px"]
        yield (
            f"{row['pose']:14s} {row['corners']:4d}/{row['corners_found']:<4d} "
            f"{number(row['camera_rms_px']):>7s} {number(row['projector_rms_px']):>8s}   "
            + number(predicted)
        )
    yield (
        f"reprojection: camera {number(figures['camera_rms_px'])} px, "
        f"projector {number(figures['projector_rms_px'])} px"
    )
    if figures["camera_blur_px"] is not None:
        yield f"camera's blur: {number(figures['camera_blur_px'])} px, removed by `measure`"
    yield from finding_words(figures)
    yield f"verdict: {figures['verdict']['text']} (one standard deviation, calibration alone)"


def picture(calibration: Calibration, name: str | None) -> Figure:
    """Where corners were seen, residuals, and the share of every pose."""
    from fringeworks.report.calibration_picture import calibration_picture  # needs Matplotlib

    return calibration_picture(titled(name, "Calibration of camera and projector"), calibration)


def chapter(result: Calibration, context: Context) -> Chapter:
    """Verdict, findings, poses and parameters."""
    values = figures(result)
    rows = pose_figures(result)
    parameters = [
        parameter_row(name, entry["value"], entry["sigma"])
        for name, entry in values["parameters"].items()
    ]
    return Chapter(
        context.name,
        (
            facts(
                [
                    ("verdict", f"{values['verdict']['text']} (one standard deviation)"),
                    ("reprojection, camera", with_unit(values["camera_rms_px"], "px")),
                    ("reprojection, projector", with_unit(values["projector_rms_px"], "px")),
                    ("camera's blur", with_unit(values["camera_blur_px"], "px")),
                    ("camera's frame covered", percent(values["camera_coverage"])),
                    ("projector's frame covered", percent(values["projector_coverage"])),
                    (
                        "baseline",
                        with_unit(values["baseline_mm"], "mm", values["baseline_sigma_mm"]),
                    ),
                    ("converged", values["converged"]),
                ]
            ),
            *judged_block(values, context),
            *findings_block(values["findings"]),
            Picture(plot(result), "Where corners were seen, and the residuals of every pose."),
            dict_table(rows, "Poses"),
            dict_table(parameters, "Parameters and their standard deviations"),
            *provenance_block(result.rig.provenance),
        ),
    )


describe(Calibration, Kind(figures, words, picture, chapter))
