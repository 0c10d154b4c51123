"""The kernel's maps for a sample of a stack's pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.stack.kernel_settings import Decoding, Limits, empty_maps
from fringeworks.types import CameraNoise


def decode_sample(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> dict[str, Any]:
    """The kernel's maps for a sample, with phases, modulations and disagreement; the planes are in
    the decoding's order."""
    maps = empty_maps(planes[0].shape, sets=len(decoding.sets), disagreement=True)
    _core.decode_frames(planes, decoding.kernel(noise, limits), maps)
    return maps


def decode_by_gray_code(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> dict[str, Any]:
    """The same by the Gray code alone, from the same planes."""
    alone = replace(decoding, sets=(), chain=None)
    frames = [planes[decoding.frames.index(k)] for k in alone.frames]
    return decode_sample(alone, frames, noise, limits)
