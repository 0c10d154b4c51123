"""What is shown of a measured response."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fringeworks.report.kind import Kind, describe
from fringeworks.report.summary import origin
from fringeworks.signal.response import Response
from fringeworks.types.numbers import number


def figures(response: Response) -> dict[str, Any]:
    """The devices, γ and what the correction leaves."""
    return {
        "camera": response.camera,
        "projector": response.projector,
        "gamma": response.gamma,
        "steps": response.steps,
        "residual_rad": response.residual_rad,
        **origin(response.provenance),
    }


def words(response: Response, _: dict[str, Any]) -> Iterator[str]:
    """γ and what the correction leaves."""
    yield (
        f"γ = {number(response.gamma)}; residual phase error after correction "
        f"{number(response.residual_rad)} rad rms"
    )


describe(Response, Kind(figures, words))
