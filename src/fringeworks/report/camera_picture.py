"""The picture of points that several cameras saw: depth, σ and disagreement of every camera."""

from __future__ import annotations

import numpy as np

from fringeworks.pipeline.cameras import MultiMeasurement
from fringeworks.report.drawing import Figure
from fringeworks.report.maps import Panel, percent, sheet
from fringeworks.types import Reason


def cameras_picture(title: str, found: MultiMeasurement) -> Figure:
    """Draw a row of panels for every camera."""
    panels, facts = [], []
    for number, seen in enumerate(found.cameras, 1):
        cloud = seen.points
        sigmas = seen.difference_sigmas
        apart = sigmas[np.isfinite(sigmas)]
        confirmed = float(np.mean(seen.matched[cloud.reason == Reason.OK]))
        usual = f"{np.sqrt(np.mean(apart**2)):.2g} σ rms" if apart.size else "none"
        facts.append(
            f"camera {number}: {percent(1.0 - cloud.failed_fraction)} measured   ·   "
            f"{percent(confirmed)} of them confirmed by another camera   ·   difference {usual}"
        )
        panels += [
            Panel(f"camera {number}: depth z", cloud.xyz_mm[..., 2], "depth", "mm"),
            Panel(f"camera {number}: σ along the ray", cloud.sigma_mm, "sigma", "mm"),
            Panel(f"camera {number}: cameras less projector", seen.difference_mm, "values", "mm"),
            Panel(f"camera {number}: the same over its σ", sigmas, "values", "σ"),
        ]
    return sheet(title, "\n".join(facts), panels, columns=4, findings=found.findings)
