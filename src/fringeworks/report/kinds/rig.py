"""What is shown of a rig."""

from __future__ import annotations

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.page.blocks import Chapter
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.parts import dict_table, facts, provenance_block
from fringeworks.types import RIG_PARAMETERS, Pinhole, Rig
from fringeworks.types.numbers import number, sigma_text

DIGITS = 6
"""Significant digits of a parameter whose σ is not known: a focal length of 2000 px to 0.01 px."""


def parameter_row(name: str, value: float, sigma: float | None) -> dict[str, object]:
    """A row of the table of parameters."""
    return {"parameter": name, "value": number(value, sigma, digits=DIGITS), "σ": sigma_text(sigma)}


def chapter(rig: Rig, context: Context) -> Chapter:
    """Parameters with their standard deviations."""
    sigma = None if rig.covariance is None else np.sqrt(np.diag(rig.covariance))
    values = [*rig.camera.parameters, *rig.projector.parameters]
    rows = [
        parameter_row(name, float(value), None if sigma is None else float(sigma[k]))
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
                    *(
                        (f"largest correction by the {name}'s field / px", _largest(device))
                        for name, device in (("camera", rig.camera), ("projector", rig.projector))
                        if device.field is not None
                    ),
                ]
            ),
            *judged_block(known, context),
            dict_table(rows, "Parameters and their standard deviations"),
            *provenance_block(rig.provenance),
        ),
    )


def _largest(device: Pinhole) -> float:
    """Largest control point of a device's field, px."""
    assert device.field is not None
    return float(np.abs(device.field.control_px).max())


describe(Rig, Kind(chapter=chapter))
