"""Chapters of results that are no surfaces: calibrations, forms, rigs, set-ups, tables, figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fringeworks.evaluate.form import FormEvaluation
from fringeworks.files.setup import StoredSetup
from fringeworks.report.display import plot
from fringeworks.report.page.blocks import Chapter, Picture
from fringeworks.report.page.chapter import Context, chapter_of, figure_blocks, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import (
    dict_table,
    estimate,
    facts,
    figure_tables,
    findings_block,
    limited_table,
    provenance_block,
    with_unit,
)
from fringeworks.report.summary import summarise
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import pose_figures
from fringeworks.types import RIG_PARAMETERS, InputError, Rig, provenance_from


def _parameter(name: str, value: float, sigma: float | None) -> dict[str, object]:
    """A row of the table of parameters."""
    return {"parameter": name, "value": estimate(value, sigma), "σ": sigma}


@chapter_of.register
def _(rig: Rig, context: Context) -> Chapter:
    sigma = None if rig.covariance is None else np.sqrt(np.diag(rig.covariance))
    values = [*rig.camera.parameters, *rig.projector.parameters]
    rows = [
        _parameter(name, float(value), None if sigma is None else float(sigma[k]))
        for k, (name, value) in enumerate(zip(RIG_PARAMETERS, values, strict=False))
    ]
    camera, projector = rig.residual_px or (None, None)
    known = {"baseline_mm": rig.baseline_mm, "camera_rms_px": camera, "projector_rms_px": projector}
    return Chapter(
        context.name,
        (
            facts(
                [
                    ("baseline / mm", rig.baseline_mm),
                    ("reprojection, camera / px", camera),
                    ("reprojection, projector / px", projector),
                    ("camera / px", f"{rig.camera.width_px} × {rig.camera.height_px}"),
                    ("projector / px", f"{rig.projector.width_px} × {rig.projector.height_px}"),
                ]
            ),
            *judged_block(known, context),
            dict_table(rows, "Parameters and their standard deviations"),
            *provenance_block(rig.provenance),
        ),
    )


@chapter_of.register
def _(result: Calibration, context: Context) -> Chapter:
    values = summarise(result)
    rows = pose_figures(result)
    parameters = [
        _parameter(name, entry["value"], entry["sigma"])
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
                    ("camera's frame covered", f"{values['camera_coverage']:.0%}"),
                    ("projector's frame covered", f"{values['projector_coverage']:.0%}"),
                    ("baseline", with_unit(values["baseline_mm"], "mm")),
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


@chapter_of.register
def _(result: FormEvaluation, context: Context) -> Chapter:
    values = summarise(result)
    rows = [(name, value) for body in values["bodies"] for name, value in body.items()]
    charts = [
        Picture(
            histogram(
                1e3 * form.distance_mm[form.region], "distance from the body / µm", what="points"
            ),
            f"Distances of the points from the {form.body}.",
        )
        for form in result.forms
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            *findings_block((), values["notes"]),
            *charts,
            *provenance_block(result.provenance),
        ),
    )


@chapter_of.register
def _(stored: StoredSetup, context: Context) -> Chapter:
    values = {
        "predicted_min_period_px": stored.min_period_px,
        "modulation": stored.modulation,
        "noise_counts": stored.noise_counts,
        "gamma": stored.gamma,
    }
    settings = stored.settings
    rows = [
        ("projector", f"{stored.projector}, {stored.size_px[0]} × {stored.size_px[1]} px"),
        ("camera", stored.camera),
        ("exposure / ms", settings.exposure_ms),
        ("gain / dB", settings.gain_db),
        ("shortest period / projector px", stored.min_period_px),
        ("modulation at the darkest tenth / counts", stored.modulation),
        ("noise there / counts", stored.noise_counts),
        ("response: light ≈ level to the power of", stored.gamma),
        ("delay", None if stored.delay is None else f"{stored.delay}"),
        ("plan", f"{stored.plan.frames} frames"),
    ]
    blocks = (facts(rows), *judged_block(values, context), *findings_block((), stored.findings))
    return Chapter(context.name, (*blocks, Picture(plot(stored.plan), "The proposed plan.")))


@chapter_of.register
def _(rows: list, context: Context) -> Chapter:  # type: ignore[type-arg]
    if not all(isinstance(row, dict) for row in rows) or not rows:
        raise InputError("report: expected the rows of a table, got a list of something else")
    return Chapter(context.name, limited_table(rows, "Comparison"))


@chapter_of.register
def _(figures: dict, context: Context) -> Chapter:  # type: ignore[type-arg]
    origin = figures.get("provenance")
    known = provenance_from(origin) if isinstance(origin, Mapping) else None
    return Chapter(
        context.name,
        (
            *figure_blocks(figures, context),
            *figure_tables(figures),
            *provenance_block(known),
        ),
    )
