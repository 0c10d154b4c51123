"""What is said about a hand–eye calibration."""

from __future__ import annotations

import numpy as np

from fringeworks.rig.robot.choose import LARGE_DEG, LARGE_MM, UNLIKELY, Chosen
from fringeworks.rig.robot.fit import Fit
from fringeworks.types import Finding, Rig


def findings_of(found: Chosen, names: tuple[str, ...], rig: Rig) -> tuple[Finding, ...]:
    """Findings of a hand–eye calibration, by what they concern."""
    fit = found.fit
    findings = [*_outliers(fit, names), *_turned(fit, names), *_scale(fit), *_noise(fit)]
    findings += _reading(found)
    if rig.covariance is None:
        findings.append(
            Finding(
                "uncertainty",
                "the rig states no uncertainty, so that σ of the camera's place does not hold the "
                "errors of the camera's calibration",
                advice="calibrate it with fringeworks",
            )
        )
    if not fit.solution.converged:
        findings.append(
            Finding(
                "iterations", "the adjustment has not converged", advice="use more, different poses"
            )
        )
    return tuple(findings)


def _outliers(fit: Fit, names: tuple[str, ...]) -> list[Finding]:
    found = []
    for k in np.flatnonzero(~fit.used):
        off, sigma = float(fit.others.distance_mm[k]), float(fit.others.sigma_mm[k])
        found.append(
            Finding(
                "outlying pose",
                f"{names[k]} puts the board {off:.3g} mm from where the other poses do, with an "
                f"expected error of {sigma:.2g} mm; it was left out",
                (
                    "the robot or the board moved while the view was taken",
                    "pose and view are of different moments",
                ),
                frames=(names[k],),
                figures={"distance_mm": off, "sigma_mm": sigma},
            )
        )
    return found


def _turned(fit: Fit, names: tuple[str, ...]) -> list[Finding]:
    which = [names[k] for k in np.flatnonzero(fit.turned)]
    if not which:
        return []
    what = (
        f"the board looks the same after half a turn; in {', '.join(which)} it was recognised "
        "turned, which was corrected"
    )
    advice = "take a board with one odd and one even count"
    return [Finding("half a turn", what, advice=advice, frames=tuple(which), severity="note")]


def _scale(fit: Fit) -> list[Finding]:
    if not fit.rescaled:
        return []
    size, sigma = 100.0 * fit.scale.value, 100.0 * fit.scale.sigma
    return [
        Finding(
            "scale",
            f"by the robot's translations, the board has {size:.4g} ± {sigma:.2g} % of its stated "
            "size; σ holds the difference",
            ("the print has another size", "the robot's arm is not well calibrated"),
            "measure the board",
            figures={"scale": fit.scale.value, "sigma": fit.scale.sigma},
        )
    ]


def _noise(fit: Fit) -> list[Finding]:
    noise, stated = fit.noise, fit.stated
    figures = {"translation_mm": noise.translation_mm, "rotation_deg": noise.rotation_deg}
    large = noise.translation_mm > LARGE_MM or noise.rotation_deg > LARGE_DEG
    causes = (
        "the robot's arm is not well calibrated",
        "its poses are written in another way",
        "the board is not flat or has another size",
    )
    if fit.contradicted:
        return [
            Finding(
                "robot noise",
                f"the residuals contradict the stated noise of {stated}: they show {noise}, which "
                "is used instead",
                causes,
                figures=figures,
            )
        ]
    if stated is None:
        return [
            Finding(
                "robot noise",
                f"the robot's noise was not stated; its poses deviate by {noise}",
                causes if large else (),
                figures=figures,
                severity="warning" if large else "note",
            )
        ]
    return []


def _reading(found: Chosen) -> list[Finding]:
    if found.reading is None or found.tried < 2:
        return []
    what = f"the robot's poses are read as {found.reading.text}"
    if found.next_best is None:
        what += f"; none of the {found.tried - 1} other readings fits the board views"
    else:
        what += (
            f"; {found.next_best.text} fits worse (Δχ² {found.next_chi2:.0f}, "
            f"{-2 * np.log(UNLIKELY):.0f} excludes it)"
        )
    return [Finding("reading", what, severity="note")]
