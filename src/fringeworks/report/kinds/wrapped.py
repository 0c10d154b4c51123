"""What is shown of a wrapped phase."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.sheets import REASONS, SIGMA, Panel, Sheet, map_facts, titled
from fringeworks.report.summary import failures, finding_words, origin, told
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.types import Reason, count_reasons
from fringeworks.types.numbers import number, percent, sigma_text


def figures(wrapped: WrappedPhase) -> dict[str, Any]:
    """Shifts, noise and medians."""
    ok = wrapped.reason == Reason.OK
    return {
        "shape": list(wrapped.phase_rad.shape),
        "shifts_deg": np.degrees(wrapped.shifts_rad).round(9).tolist(),
        "noise": {"read_counts": wrapped.noise.read_counts, "gain": wrapped.noise.gain},
        "failed_fraction": wrapped.failed_fraction,
        "reasons": count_reasons(wrapped.reason),
        "median_sigma_rad": float(np.median(wrapped.sigma_rad[ok])) if ok.any() else None,
        "median_modulation": float(np.median(wrapped.modulation[ok])) if ok.any() else None,
        **told(wrapped),
        **origin(wrapped.provenance),
    }


def words(_: WrappedPhase, figures: dict[str, Any]) -> Iterator[Word]:
    """Usual σ and modulation."""
    yield from finding_words(figures)
    failed = failures(figures["reasons"])
    if figures["median_sigma_rad"] is None:
        yield f"phase: no pixel could be measured ({failed})"
        return
    yield (
        f"phase: median σ {sigma_text(figures['median_sigma_rad'])} rad, "
        f"median modulation {number(figures['median_modulation'])} counts"
    )
    yield f"   failed: {percent(figures['failed_fraction'])} ({failed})"


def picture(wrapped: WrappedPhase, name: str | None) -> Sheet:
    """Phase, σ, modulation and reasons."""
    return Sheet(
        titled(name, "Phase of the fringes, wrapped to −π … π"),
        map_facts(1.0 - wrapped.failed_fraction, wrapped.sigma_rad, "rad"),
        [
            Panel("wrapped phase", wrapped.phase_rad, "phase", "rad"),
            Panel(SIGMA, wrapped.sigma_rad, "sigma", "rad"),
            Panel("modulation", wrapped.modulation, "grey", "counts"),
            Panel(REASONS, wrapped.reason, "reasons"),
        ],
        columns=2,
    )


describe(WrappedPhase, Kind(figures, words, picture))
