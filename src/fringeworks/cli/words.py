"""Results in words: what the commands print."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import fringeworks as fw
from fringeworks.cli.output import Output
from fringeworks.files.findings import finding_from_dict


def failures(reasons: dict[str, int]) -> str:
    """How many pixels failed for which reason."""
    failed = (f"{name.replace('_', ' ')} {n}" for name, n in reasons.items() if name != "ok")
    return ", ".join(failed) or "none"


def say_findings(words: Output, found: Iterable[fw.Finding]) -> None:
    """Findings in a line each."""
    for finding in found:
        words.say(finding.line)


def say_found(words: Output, figures: dict[str, Any]) -> None:
    """The findings among a result's figures."""
    say_findings(words, map(finding_from_dict, figures["findings"]))


def say_surface(words: Output, figures: dict[str, Any]) -> None:
    """A height map, and its errors where the truth is known."""
    say_found(words, figures)
    unit = figures["unit"]
    if figures["median"] is None:
        words.say(f"{figures['quantity']}: no pixel could be measured")
    else:
        words.say(
            f"{figures['quantity']}: {figures['minimum']:.4g} … {figures['maximum']:.4g} {unit}, "
            f"median σ {figures['median_sigma']:.2g} {unit}"
        )
    words.say(f"failed: {figures['failed_fraction']:.2%} ({failures(figures['reasons'])})")
    if "errors" in figures:
        e = figures["errors"]
        words.say(
            f"against the truth: mean |error| {e['mean_abs_error_mm']:.4g} mm, "
            f"s.d. {e['std_error_mm']:.4g} mm"
        )


def say_coordinates(words: Output, figures: dict[str, Any]) -> None:
    """Projector coordinates along each axis."""
    say_found(words, figures)
    for axis, found in figures["axes"].items():
        failed = failures(found["reasons"])
        if found["median_sigma_px"] is None:
            words.say(f"{axis}: no pixel could be measured ({failed})")
            continue
        words.say(
            f"{axis}: {found['minimum_px']:.1f} … {found['maximum_px']:.1f} px, "
            f"median σ {found['median_sigma_px']:.3g} px"
        )
        words.say(f"   failed: {found['failed_fraction']:.2%} ({failed})")


def say_phase(words: Output, figures: dict[str, Any]) -> None:
    """A wrapped phase."""
    say_found(words, figures)
    failed = failures(figures["reasons"])
    if figures["median_sigma_rad"] is None:
        words.say(f"phase: no pixel could be measured ({failed})")
        return
    words.say(
        f"phase: median σ {figures['median_sigma_rad']:.3g} rad, "
        f"median modulation {figures['median_modulation']:.3g} counts"
    )
    words.say(f"   failed: {figures['failed_fraction']:.2%} ({failed})")


def say_light(words: Output, figures: dict[str, Any]) -> None:
    """Direct and indirect light."""
    say_found(words, figures)
    failed = failures(figures["reasons"])
    if figures["indirect_share"] is None:
        words.say(f"light: no pixel could be measured ({failed})")
        return
    words.say(
        f"indirect light: {figures['indirect_share']:.1%} of all light; median "
        f"{figures['median_indirect']:.3g} counts, σ {figures['median_indirect_sigma']:.2g}; "
        f"direct {figures['median_direct']:.3g} counts"
    )
    if not figures["has_black"]:
        words.say(
            "note: the plan has no black frame, so indirect light contains twice the light of "
            "the room and the black level"
        )
    words.say(f"   failed: {figures['failed_fraction']:.2%} ({failed})")


def say_points(words: Output, figures: dict[str, Any]) -> None:
    """A point cloud."""
    say_found(words, figures)
    if figures["points"]:
        low, high = figures["minimum_mm"], figures["maximum_mm"]
        span = ", ".join(
            f"{name} {a:.2f} … {b:.2f}" for name, a, b in zip("xyz", low, high, strict=True)
        )
        words.say(f"{figures['points']} points: {span} mm")
        words.say(
            f"median σ {figures['median_sigma_mm']:.4f} mm, of which noise "
            f"{figures['median_noise_mm']:.4f} mm"
        )
    words.say(f"failed: {figures['failed_fraction']:.2%} ({failures(figures['reasons'])})")


def say_calibration(words: Output, figures: dict[str, Any]) -> None:
    """Parameters, poses and findings of a calibration."""
    for name, entry in figures["parameters"].items():
        words.say(f"{name:14s} {entry['value']:12.5f} ± {entry['sigma']:.5f}")
    words.say(
        f"baseline       {figures['baseline_mm']:12.5f} ± {figures['baseline_sigma_mm']:.5f} mm"
    )
    words.say("pose            corners   camera  projector  predicted by the others (rms, px)")
    for row in figures["poses"]:
        predicted = row["predicted_rms_px"]
        words.say(
            f"{row['pose']:14s} {row['corners']:4d}/{row['corners_found']:<4d} "
            f"{row['camera_rms_px']:7.3f} {row['projector_rms_px']:8.3f}   "
            + ("–" if predicted is None else f"{predicted:.3f}")
        )
    words.say(
        f"reprojection: camera {figures['camera_rms_px']:.3f} px, "
        f"projector {figures['projector_rms_px']:.3f} px"
    )
    say_found(words, figures)
    words.say(f"verdict: {figures['verdict']['text']} (one standard deviation, calibration alone)")


def say_forms(words: Output, figures: dict[str, Any]) -> None:
    """Fitted bodies and their errors."""
    say_found(words, figures)
    for body in figures["bodies"]:
        for name, value in body.items():
            if isinstance(value, list):
                shown = ", ".join(f"{v:.5f}" for v in value)
            elif isinstance(value, float):
                shown = f"{value:.5f}"
            else:
                shown = str(value)
            words.say(f"{name:28s} {shown}")
    for name in ("sphere_spacing_mm", "sphere_spacing_error_SD_mm"):
        if name in figures:
            words.say(f"{name:28s} {figures[name]:.5f}")


def say_setup(words: Output, figures: dict[str, Any]) -> None:
    """What a projector and a camera can do together, and a table of the findings."""
    mode, exposure, response = (figures[name] for name in ("video_mode", "exposure", "response"))
    words.say(
        f"projector {figures['projector']}: {mode['text'] if mode else _size(figures['size_px'])}"
    )
    if exposure is not None:
        words.say(f"camera {figures['camera']}: {_exposure(exposure)}")
    if figures["noise"] is not None:
        noise = figures["noise"]
        words.say(f"noise: {noise['read_counts']:.2g} counts, gain {noise['gain']:.2g}")
    if response is not None:
        words.say(
            f"response: light ≈ level^{response['gamma']:.2f}, white {response['contrast']:.3g} "
            "times as bright as black"
        )
    for axis, stripes in figures["stripes"].items():
        words.say(f"stripes along {axis}: best period {stripes['min_period_px']:g} px")
    for name in ("vignetting", "delay"):
        if figures[name] is not None:
            words.say(f"{name}: {figures[name]['text']}")
    if "plan" in figures:
        plan = figures["plan"]
        words.say(
            f"proposed plan: {plan['summary']}; predicted σ {plan['predicted_sigma_px']:.2g} px"
        )
    found = figures["findings"]
    if not found:
        if "plan" in figures:
            words.say("nothing was found that makes measurements worse")
        return
    rows = [[f["seen"], "; or ".join(f["causes"]), f["advice"]] for f in found]
    words.table(["finding", "likely causes", "what to do"], rows, lines=True)


def _size(size_px: list[int]) -> str:
    return f"{size_px[0]} × {size_px[1]} px"


def _exposure(exposure: dict[str, Any]) -> str:
    """Exposure and gain, and where they come from."""
    parts = []
    if exposure["exposure_ms"] is not None:
        parts.append(f"exposure {exposure['exposure_ms']:.3g} ms")
    if exposure["gain_db"] is not None:
        parts.append(f"gain {exposure['gain_db']:.1f} dB")
    chosen = ", chosen for fringes" if exposure["chosen"] else ""
    return (", ".join(parts) or "exposure unknown") + chosen
