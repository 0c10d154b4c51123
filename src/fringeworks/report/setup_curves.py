"""The curves of a set-up: response, noise, contrast, exposure, flicker and delay."""

from __future__ import annotations

import textwrap

import numpy as np

from fringeworks.report.drawing import Axes
from fringeworks.scan.setup import SetupTests
from fringeworks.types import FloatMap
from fringeworks.types.numbers import estimate, number, percent

BLUE, FAULT, GREEN, AMBER = "#0072b2", "#d55e00", "#009e73", "#e69f00"
"""Colours that people with every kind of colour vision tell apart (Okabe and Ito)."""
RIM_PX = 3
"""Projector coordinates at each end of a profile that are not drawn: camera pixels there see the
edge of the lit area as well."""
BINS = 40
"""Bars of a histogram of moments."""
UNPROVED_LETTERS = 40
"""Letters of a line of text in a panel."""
QUIET_SHARE = 0.005
"""Smallest range of the axis of brightness under one picture, share of the light of white, so that
noise does not look like flicker."""


def response(axes: Axes, tests: SetupTests) -> str:
    """Light over level, with the fitted power and the light of black."""
    assert tests.levels is not None
    found = tests.levels
    level = np.linspace(0.0, 1.0, 101)
    axes.plot(level, level**found.gamma, color=AMBER, label=f"level^{number(found.gamma)}")
    axes.plot(found.level, found.light, "o", color=BLUE, markersize=5, label="measured")
    black = 1.0 / found.contrast
    axes.axhline(black, color="grey", linestyle="--", linewidth=1, label="black with room light")
    axes.set_xlabel("shown level / share of full scale")
    axes.set_ylabel("light / share of white")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    white = contrast_words(found.contrast)
    return f"response: light ≈ level^{number(found.gamma)}, white {white} × black"


def contrast_words(contrast: float) -> str:
    """A contrast with two digits or more."""
    return number(contrast)


def noise(axes: Axes, tests: SetupTests) -> str:
    """Standard deviation of a pixel over brightness."""
    assert tests.levels is not None
    assert tests.noise is not None
    found, model = tests.levels, tests.noise
    brightness = np.linspace(0.0, 1.05 * float(found.brightness.max()), 100)
    axes.plot(brightness, np.sqrt(model.variance(brightness)), color=AMBER, label="model")
    axes.axhline(model.read_counts, color="grey", linestyle="--", linewidth=1, label="read noise")
    axes.plot(found.brightness, found.noise, "o", color=BLUE, markersize=5, label="grey levels")
    axes.set_xlabel("mean brightness of the lit pixels / counts")
    axes.set_ylabel("σ of a pixel / counts")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    return f"noise: read {number(model.read_counts)} counts, gain {number(model.gain)}"


def contrast(axes: Axes, tests: SetupTests) -> str:
    """Contrast of stripes over their period, along both axes."""
    words = []
    for stripes, colour, mark in zip(tests.stripes, (BLUE, AMBER), "os", strict=False):
        label = f"along {stripes.axis}"
        axes.plot(
            stripes.period_px, stripes.contrast, f"{mark}-", color=colour, label=label, markersize=5
        )
        k = int(np.argmin(np.abs(stripes.period_px - stripes.min_period_px)))
        axes.plot(
            stripes.period_px[k], stripes.contrast[k], "o", markersize=13, fillstyle="none",
            color=colour, markeredgewidth=2,
        )  # fmt: skip
        words.append(f"{stripes.min_period_px:g} px along {stripes.axis}")
    axes.set_xscale("log", base=2)
    periods = tests.stripes[0].period_px
    axes.set_xticks(periods, [f"{period:g}" for period in periods])
    axes.minorticks_off()
    axes.set_ylim(0.0, 1.1 * max(1.0, *(float(s.contrast.max()) for s in tests.stripes)))
    axes.set_xlabel("period / projector px")
    axes.set_ylabel("contrast / share of the coarsest")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right", title="ring: best period")
    return f"stripes: best period {' and '.join(words)}"


def profile(axes: Axes, tests: SetupTests) -> str:
    """Contrast of fine stripes over the projector's picture; resized pictures make it beat."""
    for stripes, colour in zip(tests.stripes, (BLUE, AMBER), strict=False):
        label = f"{stripes.profile_period_px:g} px along {stripes.axis}"
        inner = slice(RIM_PX, -RIM_PX)
        axes.plot(
            stripes.place_px[inner], stripes.profile[inner], color=colour, label=label, linewidth=1
        )
    axes.set_ylim(0.0, 2.0)
    axes.set_xlabel("projector column or row / px")
    axes.set_ylabel("contrast / share of its mean")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    scaled = any(
        finding.kind == "scale" for stripes in tests.stripes for finding in stripes.findings
    )
    return "scaling: " + (
        "the contrast beats, the picture is resized" if scaled else "no beat, pixels are one to one"
    )


def exposure(axes: Axes, tests: SetupTests) -> str:
    """Brightness of every frame at two exposures, under black and white."""
    assert tests.exposing is not None
    proof = tests.exposing.proof
    if proof is None:
        axes.set_axis_off()
        reason = "\n".join(textwrap.wrap(tests.exposing.unproved, UNPROVED_LETTERS))
        axes.text(0.5, 0.5, reason, ha="center", va="center", transform=axes.transAxes)
        return "exposure: cannot be proved"
    short, long = proof.asked_ms
    start = 0
    names = iter(("black", "white or grey"))
    for k, means in enumerate(proof.series):
        exposed, colour = (short, long, short)[k // 2], (BLUE, AMBER)[k % 2]
        frame = start + np.arange(len(means))
        axes.plot(
            frame, means, ".-", color=colour, markersize=3, linewidth=0.8, label=next(names, None)
        )
        if k % 2 == 0:
            axes.axvline(start, color="grey", linewidth=0.7)
            place = axes.get_xaxis_transform()
            axes.text(
                start + 1, 0.99, f"{number(exposed)} ms", fontsize=8, va="top", transform=place
            )
        start += len(means)
    axes.set_xlabel("number of the frame")
    axes.set_ylabel("mean brightness / counts")
    low, high = axes.get_ylim()
    # Room for the exposures and the legend.
    axes.set_ylim(low, high + 0.25 * (high - low))
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.94), ncols=2)
    if proof.verdict == "automatic":
        return f"exposure: automatic, {percent(proof.drift)} of a change are taken back"
    return (
        f"exposure {'obeys' if proof.obeyed else 'does not obey'}: asked for a ratio of "
        f"{number(proof.expected_ratio)}, got {estimate(proof.ratio, proof.ratio_sigma)}"
    )


def _series(tests: SetupTests) -> tuple[tuple[str, str, FloatMap], ...]:
    """Name, colour and brightness of the band that changes most, under black and white."""
    assert tests.flicker is not None
    found = tests.flicker
    series = []
    for name, colour, bands in (("black", BLUE, found.black), ("white", AMBER, found.white)):
        band = bands[:, int(np.argmax(bands.std(axis=0)))]
        series.append((name, colour, np.asarray(band - band.mean())))
    return tuple(series)


def flicker(axes: Axes, tests: SetupTests) -> str:
    """Brightness over time under one picture, in the band of rows that changes most."""
    assert tests.flicker is not None
    found = tests.flicker
    for name, colour, change in _series(tests):
        time_s = np.arange(len(change)) * found.frame_s
        axes.plot(time_s, 100 * change, ".-", color=colour, label=f"under {name}", linewidth=0.9)
    least = 100 * QUIET_SHARE
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -least), max(high, least))
    axes.set_xlabel("time / s")
    axes.set_ylabel("change of brightness / % of white")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper right")
    black, white = percent(found.in_black), percent(found.in_white)
    return f"flicker: {black} of white under black, {white} under white"


def spectrum(axes: Axes, tests: SetupTests) -> str:
    """Amplitude of the changes over frequency, as the frame rate shows it."""
    assert tests.flicker is not None
    found, peak = tests.flicker, (0.0, 0.0)
    for name, colour, change in _series(tests):
        window = np.hanning(len(change) + 2)[1:-1]
        # A Hann window halves the amplitude; both halves of the spectrum belong to a wave.
        amplitude = 100 * 2.0 * np.abs(np.fft.rfft(change * window)) / window.sum()
        hertz = np.fft.rfftfreq(len(change), found.frame_s)
        axes.plot(hertz, amplitude, color=colour, label=f"under {name}")
        k = int(np.argmax(amplitude))
        peak = max(peak, (float(amplitude[k]), float(hertz[k])))
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 100 * QUIET_SHARE))
    axes.set_xlabel("apparent frequency / Hz")
    axes.set_ylabel("amplitude / % of white")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper right")
    rate = 1.0 / found.frame_s
    if not found.findings:
        return f"flicker: no line at {number(rate)} frames per second"
    return f"flicker: seen at {number(peak[1])} Hz with {number(rate)} frames per second"


def delay(axes: Axes, tests: SetupTests) -> str:
    """Moments at which frames show a picture alone, and the limits for the fast way."""
    assert tests.delay is not None
    found = tests.delay
    early = found.absent_s[np.isfinite(found.absent_s)]
    low = 1e3 * min(float(found.appears_s.min()), 0.0) - 20
    high = 1e3 * float(found.alone_from_s) + 60
    edges = np.linspace(low, high, BINS + 1).tolist()
    axes.hist(1e3 * early, edges, color=AMBER, alpha=0.8, label="not yet visible")
    axes.hist(1e3 * found.appears_s, edges, color=BLUE, alpha=0.6, label="newest visible")
    axes.hist(
        1e3 * found.left_s, edges, color=GREEN, alpha=0.6, label="the one before still visible"
    )
    complete = 1e3 * float(found.left_s.max())
    margin = 1e3 * found.margin_s
    axes.axvspan(complete, complete + margin, color="grey", alpha=0.4, label="margin")
    axes.axvline(1e3 * found.first_s, color=FAULT, linewidth=1.5, label="frames count from here")
    axes.set_xlabel("arrival of the frame after the showing / ms")
    axes.set_ylabel("frames")
    axes.set_ylim(top=1.6 * axes.get_ylim()[1])
    axes.legend(fontsize=7, loc="upper right")
    return f"delay: {found}"
