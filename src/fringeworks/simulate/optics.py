"""How the devices of the virtual rig form light and images: their options."""

from __future__ import annotations

from dataclasses import dataclass

from fringeworks.simulate.bayer import FILTERS, Bayer, are_shares
from fringeworks.simulate.lens import ThinLens
from fringeworks.simulate.response_curve import ResponseCurve
from fringeworks.types import InputError, check_fields

DEPTHS = (8, 10, 12, 16)
"""Depths of frames, bits: those of common cameras."""


@dataclass(frozen=True)
class Optics:
    """How the virtual devices form light and images.

    Raises
    ------
    InputError for a value out of its range, both ``gamma`` and ``response``, and JPEG of frames
    that do not have 8 bit.
    """

    gamma: float = 1.0
    """Exponent of the projector's response; > 0."""
    response: ResponseCurve | None = None
    """Response of the projector where it is no power; ``gamma`` then stays 1."""
    fill: float = 1.0
    """Lit side of the projector's pixels over their pitch, 0…1; below 1 dark gaps make a grid. The
    mean light stays the same. The camera must resolve the grid: it samples points, and where its
    pixels are larger than half the projector's, the gaps alias. For patterns along one axis."""
    defocus_px: float = 0.6
    """Standard deviation of the projector's blur in focus, projector px; ≥ 0."""
    projector_lens: ThinLens | None = None
    """Blur of the projector by depth, which adds to ``defocus_px``; None for the same everywhere.
    Variances are added."""
    blur_px: float = 0.5
    """Standard deviation of the camera's blur in focus, camera px; ≥ 0."""
    pixel_px: float = 0.0
    """Side of the camera's pixels over which they collect the projector's light, px, 0…1; 0 for
    light at their centres. Reflectances are always means over whole pixels. Real pixels collect
    over nearly 1."""
    camera_lens: ThinLens | None = None
    """Blur of the camera by depth, which adds to ``blur_px``; None for the same everywhere."""
    exposure: float = 1.0
    """Brightness of a white surface under full light, as a share of the camera's range; > 0. The
    surface is at the median distance of what is lit, and faces the projector."""
    ambient: float = 0.02
    """Light that does not come from the projector, relative to its full light; ≥ 0."""
    black: float = 0.01
    """Light of the projector's black, relative to its full light; 0…1."""
    noise: float = 2.0
    """Standard deviation of the read noise, counts of 8 bit; ≥ 0."""
    gain: float = 0.0
    """Shot noise: variance per count, counts of 8 bit; ≥ 0."""
    bits: int = 8
    """Depth of the frames: 8, 10, 12 or 16."""
    bayer: Bayer | None = None
    """Colour filters before the sensor; None for a grey camera. Noise and rounding are those of the
    raw frame."""
    jpeg: int = 0
    """Quality of JPEG compression, 1…100, of frames of 8 bit; 0 for none."""
    seed: int = 0
    """Seed of the noise; equal seeds give equal frames."""
    filters: tuple[tuple[float, float, float], ...] = FILTERS
    """Shares of the projector's red, green and blue that the camera's red, green and blue see under
    a plan with ``colours``: three rows of three, each with the sum 1."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            gamma=(self.gamma > 0, "> 0"),
            fill=(0 < self.fill <= 1, "above 0, up to 1"),
            defocus_px=(self.defocus_px >= 0, ">= 0"),
            blur_px=(self.blur_px >= 0, ">= 0"),
            pixel_px=(0 <= self.pixel_px <= 1, "0 to 1"),
            exposure=(self.exposure > 0, "> 0"),
            ambient=(self.ambient >= 0, ">= 0"),
            black=(0 <= self.black < 1, "0 to 1"),
            noise=(self.noise >= 0, ">= 0"),
            gain=(self.gain >= 0, ">= 0"),
            bits=(self.bits in DEPTHS, f"one of {DEPTHS}"),
            jpeg=(0 <= self.jpeg <= 100, "0 to 100"),
            filters=(are_shares(self.filters), "three rows of three shares with the sum 1"),
        )
        if self.response is not None and self.gamma != 1.0:
            raise InputError(f"response: cannot be combined with gamma = {self.gamma}")
        if self.jpeg and self.bits != 8:
            raise InputError(f"jpeg: expected frames of 8 bit, got bits = {self.bits}")
