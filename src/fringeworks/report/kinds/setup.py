"""What is shown of a set-up, of the tests that were reached, and of one from a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.files.setup import StoredSetup
from fringeworks.report.display import plot
from fringeworks.report.kind import Kind, Rows, describe
from fringeworks.report.page.blocks import Chapter, Picture
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.parts import facts, findings_block
from fringeworks.scan.exposure_proof import ExposureProof
from fringeworks.scan.setup import Setup, SetupTests
from fringeworks.types import Delay
from fringeworks.types.numbers import number, sigma_text

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure


def figures(tests: SetupTests) -> dict[str, Any]:
    """The figures of a set-up or of the tests that were reached; None for what is not known."""
    found: dict[str, Any] = {
        "projector": tests.projector,
        "camera": tests.camera,
        "size_px": list(tests.size_px),
        "video_mode": None
        if tests.mode is None
        else asdict(tests.mode) | {"text": f"{tests.mode}"},
        "exposure": _exposure_figures(tests),
        "noise": None
        if tests.noise is None
        else {"read_counts": tests.noise.read_counts, "gain": tests.noise.gain},
        "light_in_time": _rhythm(tests),
        "flicker": _flicker(tests),
        "response": _response(tests),
        "mirrored": None if tests.orientation is None else tests.orientation.mirrored,
        "stripes": {
            stripes.axis: {
                "period_px": stripes.period_px.tolist(),
                "contrast": stripes.contrast.tolist(),
                "min_period_px": stripes.min_period_px,
                "camera_pixel_px": stripes.camera_pixel_px,
                "blur_px": stripes.blur_px,
            }
            for stripes in tests.stripes
        },
        "vignetting": _vignetting(tests),
        "pixel_grid": _pixel_grid(tests),
        "delay": None if tests.delay is None else _delay(tests.delay),
        "findings": findings_as_dicts(tests.findings),
    }
    if isinstance(tests, Setup):
        proposal = tests.proposal
        found["plan"] = {
            "kind": proposal.kind,
            "summary": proposal.summary,
            "predicted_sigma_px": proposal.sigma_px,
        }
        found["finest_cell_px"] = tests.finest_cell_px
    return found


def _flicker(tests: SetupTests) -> dict[str, Any] | None:
    if tests.flicker is None:
        return None
    return {"in_black": tests.flicker.in_black, "in_white": tests.flicker.in_white}


def _rhythm(tests: SetupTests) -> dict[str, Any] | None:
    """How the light changes from frame to frame, at each exposure that was tried."""
    rhythm = tests.rhythm
    if rhythm is None:
        return None
    tried = rhythm.tried or (rhythm.ripple,)
    return {
        "exposure_ms": [one.exposure_ms for one in tried],
        "depth_share": [one.depth if isfinite(one.depth) else None for one in tried],
        "grey": [one.grey for one in tried],
        "period_ms": rhythm.period_ms,
    }


def _exposure_figures(tests: SetupTests) -> dict[str, Any] | None:
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


def _pixel_grid(tests: SetupTests) -> dict[str, Any] | None:
    found = tests.pixel_grid
    if found is None:
        return None
    return {
        "text": f"{found}",
        "seen": found.seen,
        "order": list(found.order),
        "amplitude": found.amplitude,
        "error": found.error,
        "noise": found.noise,
        "period_px": found.period_px,
        "direction_deg": found.direction_deg,
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


def words(_: SetupTests, figures: dict[str, Any]) -> Iterator[str | Rows]:
    """What a projector and a camera can do together, and a table of the findings."""
    mode, exposure, response = (figures[name] for name in ("video_mode", "exposure", "response"))
    yield (
        f"projector {figures['projector']}: {mode['text'] if mode else _size(figures['size_px'])}"
    )
    if exposure is not None:
        yield f"camera {figures['camera']}: {_exposure_words(exposure)}"
    if figures["noise"] is not None:
        noise = figures["noise"]
        yield f"noise: {number(noise['read_counts'])} counts, gain {number(noise['gain'])}"
    if response is not None:
        yield (
            f"response: light ≈ level^{number(response['gamma'])}, white "
            f"{number(response['contrast'])} times as bright as black"
        )
    for axis, stripes in figures["stripes"].items():
        yield (
            f"stripes along {axis}: best period {stripes['min_period_px']:g} px; a camera pixel "
            f"spans {number(stripes['camera_pixel_px'])} projector px, blur "
            f"{number(stripes['blur_px'])} camera px"
        )
    for name in ("vignetting", "pixel_grid", "delay"):
        if figures[name] is not None:
            yield f"{name.replace('_', ' ')}: {figures[name]['text']}"
    if "plan" in figures:
        plan = figures["plan"]
        if figures["finest_cell_px"] is not None:
            yield f"finest Gray-code cell that the camera resolves: {figures['finest_cell_px']} px"
        predicted = sigma_text(plan["predicted_sigma_px"], "px")
        yield f"proposed plan: {plan['summary']}; predicted σ {predicted}"
    found = figures["findings"]
    if not found:
        if "plan" in figures:
            yield "nothing was found that makes measurements worse"
        return
    rows = [[f["seen"], "; or ".join(f["causes"]), f["advice"]] for f in found]
    yield Rows(("finding", "likely causes", "what to do"), rows, ruled=True)


def _size(size_px: list[int]) -> str:
    return f"{size_px[0]} × {size_px[1]} px"


def _exposure_words(exposure: dict[str, Any]) -> str:
    """Exposure and gain, and where they come from."""
    parts = []
    if exposure["exposure_ms"] is not None:
        parts.append(f"exposure {number(exposure['exposure_ms'])} ms")
    if exposure["gain_db"] is not None:
        parts.append(f"gain {number(exposure['gain_db'])} dB")
    chosen = ", chosen for fringes" if exposure["chosen"] else ""
    return (", ".join(parts) or "exposure unknown") + chosen


def picture(tests: SetupTests, _: str | None) -> Figure:
    """A picture of each test; the sheet names the devices by itself."""
    from fringeworks.report.setup_figures import setup_sheet  # which needs Matplotlib

    return setup_sheet(tests)


def stored_chapter(stored: StoredSetup, context: Context) -> Chapter:
    """The devices, their settings, and the proposed plan."""
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
        ("projector px across a camera pixel", stored.camera_pixel_px),
        ("blur / camera px", stored.blur_px if stored.camera_pixel_px else None),
        ("modulation at the darkest tenth / counts", stored.modulation),
        ("noise there / counts", stored.noise_counts),
        ("response: light ≈ level to the power of", stored.gamma),
        ("delay", None if stored.delay is None else f"{stored.delay}"),
        ("plan", f"{stored.plan.frames} frames"),
    ]
    blocks = (
        facts(rows),
        *judged_block(values, context),
        *findings_block(findings_as_dicts(stored.findings)),
    )
    return Chapter(context.name, (*blocks, Picture(plot(stored.plan), "The proposed plan.")))


describe(SetupTests, Kind(figures, words, picture))
describe(StoredSetup, Kind(chapter=stored_chapter))
