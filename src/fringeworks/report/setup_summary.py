"""The numerical results of a set-up, ready for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from fringeworks.report.summary import summary
from fringeworks.scan.exposure_proof import ExposureProof
from fringeworks.scan.setup import Setup, SetupTests
from fringeworks.types import Delay


@summary.register
def _(tests: SetupTests) -> dict[str, Any]:
    """The figures of a set-up or of the tests that were reached; None for what is not known."""
    figures: dict[str, Any] = {
        "projector": tests.projector,
        "camera": tests.camera,
        "size_px": list(tests.size_px),
        "video_mode": None
        if tests.mode is None
        else asdict(tests.mode) | {"text": f"{tests.mode}"},
        "exposure": _exposure(tests),
        "noise": None
        if tests.noise is None
        else {"read_counts": tests.noise.read_counts, "gain": tests.noise.gain},
        "flicker": None
        if tests.flicker is None
        else {"in_black": tests.flicker.in_black, "in_white": tests.flicker.in_white},
        "response": _response(tests),
        "mirrored": None if tests.orientation is None else tests.orientation.mirrored,
        "stripes": {
            stripes.axis: {
                "period_px": stripes.period_px.tolist(),
                "contrast": stripes.contrast.tolist(),
                "min_period_px": stripes.min_period_px,
            }
            for stripes in tests.stripes
        },
        "vignetting": _vignetting(tests),
        "delay": None if tests.delay is None else _delay(tests.delay),
        "findings": [asdict(finding) for finding in tests.findings],
    }
    if isinstance(tests, Setup):
        proposal = tests.proposal
        figures["plan"] = {
            "kind": proposal.kind,
            "summary": proposal.summary,
            "predicted_sigma_px": proposal.sigma_px,
        }
    return figures


def _exposure(tests: SetupTests) -> dict[str, Any] | None:
    if tests.exposing is None:
        return None
    settings, proof = tests.exposing.settings, tests.exposing.proof
    return {
        "exposure_ms": settings.exposure_ms,
        "gain_db": settings.gain_db,
        "chosen": tests.exposing.chosen,
        "proof": None if proof is None else _proof(proof),
        "unproved": tests.exposing.unproved or None,
    }


def _proof(proof: ExposureProof) -> dict[str, Any]:
    names = ("expected_ratio", "ratio", "ratio_sigma", "drift")
    values = {name: float(getattr(proof, name)) for name in names}
    return {"verdict": proof.verdict, "asked_ms": list(proof.asked_ms), **values}


def _response(tests: SetupTests) -> dict[str, Any] | None:
    levels = tests.levels
    if levels is None:
        return None
    return {
        "gamma": levels.gamma,
        "contrast": levels.contrast,
        "level": levels.level.tolist(),
        "light": levels.light.tolist(),
        "lit_share": float(np.mean(levels.lit)),
        "saturated_share": levels.saturated_share,
    }


def _vignetting(tests: SetupTests) -> dict[str, Any] | None:
    found = tests.vignetting
    if found is None:
        return None
    return {
        "judged": found.judged,
        "text": f"{found}",
        "covered_share": found.covered_share,
        "reach": found.reach,
        "corner_share": found.corner_share,
        "sigma_ratio": found.sigma_ratio,
    }


def _delay(delay: Delay) -> dict[str, Any]:
    return {
        "text": f"{delay}",
        "appears_s": float(delay.appears_s.min()),
        "complete_s": float(delay.left_s.max()),
        "first_s": delay.first_s,
        "last_s": delay.last_s,
        "refresh_s": delay.refresh_s,
        "frame_s": delay.frame_s,
    }
