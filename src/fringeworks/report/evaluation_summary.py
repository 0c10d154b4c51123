"""The numerical results of evaluations and inspections, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.evaluate.form import FormEvaluation
from fringeworks.evaluate.inspect import Inspection
from fringeworks.report.summary import origin, summarise, summary


@summary.register
def _(evaluation: FormEvaluation) -> dict[str, Any]:
    return evaluation.figures | origin(evaluation.provenance)


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
        "notes": list(inspection.notes),
    }
