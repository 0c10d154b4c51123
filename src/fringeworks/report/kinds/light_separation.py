"""What is shown of direct and indirect light."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.sheets import REASONS, Panel, Sheet, map_facts, titled
from fringeworks.report.summary import failures, finding_words, origin, told
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.types import Reason, count_reasons
from fringeworks.types.numbers import number, percent, sigma_text


def figures(light: LightSeparation) -> dict[str, Any]:
    """How the light was separated, and medians."""
    ok = light.reason == Reason.OK
    maps = ("direct", "direct_sigma", "indirect", "indirect_sigma")
    medians = {
        f"median_{name}": float(np.median(getattr(light, name)[ok])) if ok.any() else None
        for name in maps
    }
    return {
        "shape": list(light.reason.shape),
        "period_px": light.period_px,
        "contrast": light.contrast,
        "has_black": light.has_black,
        "indirect_share": light.indirect_share if ok.any() else None,
        **medians,
        "failed_fraction": light.failed_fraction,
        "reasons": count_reasons(light.reason),
        **told(light),
        **origin(light.provenance),
    }


def words(_: LightSeparation, figures: dict[str, Any]) -> Iterator[Word]:
    """The share of indirect light, and medians."""
    yield from finding_words(figures)
    failed = failures(figures["reasons"])
    if figures["indirect_share"] is None:
        yield f"light: no pixel could be measured ({failed})"
        return
    yield (
        f"indirect light: {percent(figures['indirect_share'])} of all light; median "
        f"{number(figures['median_indirect'])} counts, "
        f"σ {sigma_text(figures['median_indirect_sigma'])}; "
        f"direct {number(figures['median_direct'])} counts"
    )
    yield f"   failed: {percent(figures['failed_fraction'])} ({failed})"


def picture(light: LightSeparation, name: str | None) -> Sheet:
    """Direct light, indirect light, its share and σ, and reasons."""
    total = light.direct + np.maximum(light.indirect, 0.0)
    share = np.full(total.shape, np.nan)
    np.divide(light.indirect, total, out=share, where=total > 0.0)
    return Sheet(
        titled(name, "Light straight from the projector, and by way of other surfaces"),
        map_facts(
            1.0 - light.failed_fraction,
            light.indirect_sigma,
            "counts",
            f"indirect share of all light {percent(light.indirect_share)}",
            f"fringe period {number(light.period_px, digits=4)} projector px",
        ),
        [
            Panel("direct light", light.direct, "grey", "counts"),
            Panel("indirect light", light.indirect, "grey", "counts"),
            Panel("indirect over all light", share, "values", "1"),
            Panel(
                "standard deviation σ of the indirect light",
                light.indirect_sigma,
                "sigma",
                "counts",
            ),
            Panel(REASONS, light.reason, "reasons"),
        ],
        columns=3,
    )


describe(LightSeparation, Kind(figures, words, picture))
