"""What a large share of lit pixels without a coordinate says about a capture."""

from __future__ import annotations

from fringeworks.types import Decoded, Finding, Pixels, Reason, reason_counts, region_of

LARGE_SHARE = 0.1
"""Share of the lit pixels from which on a reason is reported. Edges of shadows, dark paint and
highlights take a few per cent of an ordinary scene. Empirical."""
BEYOND_PROJECTOR = "beyond the projector"
"""Kind of the finding that explains ambiguous orders by a projector that is too small."""
UNLIT = (Reason.MASKED, Reason.OUTSIDE, Reason.SHADOW)
"""Reasons of pixels that show no light of the projector: they do not count."""
WORDS: dict[Reason, tuple[str, tuple[str, ...], str]] = {
    Reason.SATURATED: (
        "samples at the sensor's limit (saturated)",
        ("the exposure is too long", "highlights on a glossy surface"),
        "shorten the exposure, dim the projector, or spray the surface",
    ),
    Reason.ORDER_AMBIGUOUS: (
        "a fringe order that cannot be decided (order ambiguous)",
        (
            "too much noise for the plan's periods",
            "motion between the frames",
            "light between surfaces",
            "a response that is not linear",
        ),
        "expose longer, or use a plan with more margin (more steps, closer periods or a Gray code)",
    ),
    Reason.LOW_MODULATION: (
        "fringes that are too weak in some sets (low modulation)",
        ("a projector out of focus", "dark or translucent surfaces", "light in the room"),
        "focus the projector, expose longer, or use wider fringes",
    ),
    Reason.ISOLATED: (
        "a coordinate that fits no surface through their neighbours (isolated)",
        ("wrong fringe orders", "motion between the frames", "a surface finer than the pixels"),
        "use a plan with more margin, or keep these pixels with remove_isolated = False",
    ),
}
"""For every reason that decoding gives: what was seen, likely causes, what to do."""


def unmeasured(decoded: Decoded) -> tuple[Finding, ...]:
    """Return a finding for every reason that takes a large share of the lit pixels."""
    findings = []
    explained = {
        (f.axis, Reason.ORDER_AMBIGUOUS) for f in decoded.findings if f.kind == BEYOND_PROJECTOR
    }
    for axis, found in decoded.maps.items():
        counts = reason_counts(found.reason)
        lit = int(counts.sum() - sum(counts[reason] for reason in UNLIT))
        for reason, (what, causes, advice) in WORDS.items():
            share = float(counts[reason] / max(lit, 1))
            if share > LARGE_SHARE and (axis, reason) not in explained:
                seen = f"{share:.0%} of the lit pixels along {axis} have {what}"
                figures = {"share": share}
                at = Pixels(int(counts[reason]), lit, region_of(found.reason == reason))
                findings.append(
                    Finding("unmeasured", seen, causes, advice, axis, (), figures, pixels=at)
                )
    return tuple(findings)
