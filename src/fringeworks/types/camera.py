"""A camera: its settings, and the model of its noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import MOST_PX, finite, positive, whole
from fringeworks.types.errors import InputError, check_fields
from fringeworks.types.frozen import Frozen


@dataclass(frozen=True, eq=False, repr=False)
class CameraNoise(Frozen):
    """Variance of a camera count, σ²(I) = read² + gain · I (theory §9)."""

    read_counts: float
    """Standard deviation in the dark, quantisation included; ≥ 0, counts."""
    gain: float = 0.0
    """Shot noise: variance per count; ≥ 0, counts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("read_counts", "gain"):
            value = getattr(self, name)
            if not (finite(value) and value >= 0):
                raise InputError(f"noise: expected {name} >= 0, got {value}")

    def variance(self, brightness: FloatMap | float) -> FloatMap:
        """Variance of a count at some brightness (counts), counts²; below zero that of the dark."""
        return np.asarray(self.read_counts**2 + self.gain * np.maximum(brightness, 0.0))


@dataclass(frozen=True)
class Region:
    """A part of a camera's sensor.

    Raises
    ------
    InputError for an empty region or one that begins before the sensor.
    """

    x_px: int
    """First column; ≥ 0."""
    y_px: int
    """First row; ≥ 0."""
    width_px: int
    """Number of columns; ≥ 1."""
    height_px: int
    """Number of rows; ≥ 1."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            x_px=(whole(self.x_px, 0, MOST_PX), ">= 0"),
            y_px=(whole(self.y_px, 0, MOST_PX), ">= 0"),
            width_px=(whole(self.width_px, 1, MOST_PX), ">= 1"),
            height_px=(whole(self.height_px, 1, MOST_PX), ">= 1"),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frames."""
        return self.height_px, self.width_px


@dataclass(frozen=True)
class ColourPlane(Region):
    """The pixels of one colour in a part of a sensor behind a mosaic of 2 × 2 filters.

    They are every second column and row.
    """

    first_px: tuple[float, float] = (0.0, 0.0)
    """Column and row of the first of them in the part; ½ for the mean of the two greens, which lies
    between them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        inside = all(at in (0.0, 0.5, 1.0) for at in self.first_px)
        check_fields(self, first_px=(inside, "two of 0, 0.5 and 1"))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frames."""
        return self.height_px // 2, self.width_px // 2


@dataclass(frozen=True)
class CameraSettings:
    """Settings of a camera.

    In a request, None leaves a setting as it is. In what a camera reports, None means that the
    camera does not tell.

    Raises
    ------
    InputError for a value out of its range.
    """

    exposure_ms: float | None = None
    """Time over which a frame collects light, ms; > 0."""
    gain_db: float | None = None
    """Amplification of the signal, dB."""
    region: Region | None = None
    """Part of the sensor that is read out."""
    pixel_format: str | None = None
    """Name of the pixel format in the terms of GenICam, such as Mono8, Mono12p or BayerRG8."""
    triggered: bool | None = None
    """True: a frame is exposed for every ``trigger``; False: frames come by themselves."""

    def __post_init__(self) -> None:
        exposure, gain = self.exposure_ms, self.gain_db
        check_fields(
            self,
            exposure_ms=(exposure is None or positive(exposure), "> 0"),
            gain_db=(gain is None or finite(gain), "a finite value"),
        )

    def given(self) -> dict[str, Any]:
        """Return the settings that are not left to the camera, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def over(self, base: CameraSettings) -> CameraSettings:
        """Return these settings, with the open ones taken from others.

        Parameters
        ----------
        base : CameraSettings
            Where both have a value, that of ``base`` is left out.
        """
        return replace(base, **self.given())
