"""The options of decoding, as a type that functions which pass them on can name."""

from __future__ import annotations

from typing import TypedDict

from fringeworks.signal.response import Response
from fringeworks.types import CameraNoise


class DecodeOptions(TypedDict, total=False):
    """Keyword options of ``decode``; each is explained there."""

    noise: CameraNoise | None
    saturation: float | None
    count_step: float | None
    min_modulation: float
    absolute: bool
    response: Response | None
    estimate_steps: bool
    estimate_response: bool
    keep_phases: bool
    remove_isolated: bool
    keep_blur: bool
