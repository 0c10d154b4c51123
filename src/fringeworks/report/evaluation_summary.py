"""The numerical results of evaluations and inspections, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.form import FormEvaluation
from fringeworks.evaluate.inspect import Inspection
from fringeworks.report.summary import origin, summarise, summary, told


@summary.register
def _(evaluation: FormEvaluation) -> dict[str, Any]:
    return evaluation.figures | told(evaluation) | origin(evaluation.provenance)


@summary.register
def _(found: Deviation) -> dict[str, Any]:
    alignment = found.alignment
    sigma = np.sqrt(np.diag(alignment.covariance))
    return found.figures() | {
        "alignment": {
            "by": alignment.by,
            "T_model_part": alignment.T_model_part.tolist(),
            "covariance_rad_mm": alignment.covariance.tolist(),
            "sigma_rotation_deg": np.degrees(sigma[:3]).tolist(),
            "sigma_translation_mm": sigma[3:].tolist(),
            "rms_mm": alignment.rms_mm,
            "points": alignment.points,
            "share": alignment.share,
            "slides": alignment.slides,
            "converged": alignment.converged,
        },
        **told(found),
        **origin(found.provenance),
    }


@summary.register
def _(inspection: Inspection) -> dict[str, Any]:
    checks = [
        {
            "name": check.tolerance.name,
            "quantity": check.tolerance.quantity,
            "areas": list(check.tolerance.areas),
            "value": check.value if np.isfinite(check.value) else None,
            "sigma": check.sigma if np.isfinite(check.sigma) else None,
            "unit": check.unit,
            "smallest": check.tolerance.low,
            "largest": check.tolerance.high,
            "verdict": check.verdict,
            "why": check.why,
        }
        for check in inspection.checks
    ]
    figures = summarise(inspection.surface)
    return figures | {
        "verdict": inspection.verdict,
        "checks": checks,
        **told(inspection),
    }
