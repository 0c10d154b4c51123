"""A camera that exists only in memory and looks at a virtual projector's light."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.protocols import (
    CameraLimits,
    Closing,
    Grab,
)
from fringeworks.devices.virtual_projector import Shown, VirtualProjector
from fringeworks.patterns.plan import COLOURS
from fringeworks.simulate.bayer import FILTERS, LUMINANCE_SHARES, are_shares
from fringeworks.simulate.jpeg import jpeg_compressed
from fringeworks.types import (
    CameraSettings,
    DeviceProblem,
    FloatMap,
    InputError,
    Region,
    check_fields,
)

AUTO_TARGET = 0.45
"""Mean brightness that an automatic exposure aims at, share of full scale: between the 0.4 and 0.5
that webcams keep."""
AUTO_STEP = 0.3
"""Share of the remaining correction that an automatic exposure makes from frame to frame."""
EXPOSURES_MS = (0.02, 10_000.0)
"""Shortest and longest exposure of the virtual camera, ms: those of usual industrial cameras."""
KEPT_FRAMES = 4
"""Frames that wait to be grabbed; when another arrives, the oldest is lost."""
GAINS_DB = (0.0, 24.0)
"""Lowest and highest gain of the virtual camera, dB."""


class Scene(Protocol):
    """What a virtual camera looks at."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the camera."""

    def projected(self, light: FloatMap) -> FloatMap:
        """Light at the camera's pixels (h, w) when the projector sends ``light`` (rows, columns).

        In shares of the camera's full scale, at the reference exposure and gain 0 dB. For light in
        colours, (rows, columns, 3), and for painted scenes (h, w, 3): the light of each colour.
        """

    @property
    def ambient(self) -> FloatMap:
        """Light that does not come from the projector, (h, w), in the same shares."""


@dataclass(frozen=True)
class CameraModel:
    """How a virtual camera takes frames.

    Raises
    ------
    InputError for a value out of its range.
    """

    fps: float = 30.0
    """Frames per second without a trigger; > 0."""
    shutter: Literal["global", "rolling"] = "global"
    """Whether all rows are exposed at once, or one after the other."""
    readout_s: float = 0.010
    """Time to read a frame out, s; with a rolling shutter the delay of the last row; ≥ 0."""
    delay_s: float = 0.0
    """Time from the end of readout until the frame arrives, s; ≥ 0."""
    jitter_frames: int = 0
    """Largest number of frame periods by which a frame arrives later at random; ≥ 0."""
    reference_ms: float = 16.667
    """Exposure at which the scene's light is meant, ms; > 0."""
    noise: float = 1.0
    """Standard deviation of the read noise, counts of 8 bit; ≥ 0."""
    shot_gain: float = 0.02
    """Shot noise at 0 dB: variance per count, counts of 8 bit; ≥ 0."""
    bits: Literal[8, 10, 12, 16] = 8
    """Depth of the frames."""
    flicker: float = 0.0
    """Depth of the ambient light's flicker, relative to its mean; 0…1."""
    flicker_hz: float = 100.0
    """Frequency of the flicker, Hz: twice that of the mains."""
    obeys_exposure: bool = True
    """False for a camera that reports every exposure as set and keeps its own."""
    auto_exposure: bool = False
    """Whether the brightness is held at a mean of 0.45 by the camera, whatever it is told."""
    loss: float = 0.0
    """Share of frames that never arrive; 0…1."""
    smoothing_px: float = 0.0
    """Width σ over which the camera smooths its noisy frames, px; ≥ 0."""
    jpeg: int = 0
    """Quality 1…100 at which frames of 8 bit are compressed; 0 for none."""
    lag: float = 0.0
    """Share of the frame before in every frame, as noise reduction over time leaves it; 0…1."""
    frozen: float = 0.0
    """Share of frames that repeat the pixels of the one before; 0…1."""
    torn: float = 0.0
    """Share of frames that arrive incomplete; 0…1."""
    filters: tuple[tuple[float, float, float], ...] = FILTERS
    """Shares of the projector's red, green and blue that each channel sees when the camera delivers
    colours: three rows of three, each with the sum 1, so that white is white."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            fps=(self.fps > 0, "> 0"),
            shutter=(self.shutter in ("global", "rolling"), "global or rolling"),
            readout_s=(self.readout_s >= 0, ">= 0"),
            delay_s=(self.delay_s >= 0, ">= 0"),
            jitter_frames=(self.jitter_frames >= 0, ">= 0"),
            reference_ms=(self.reference_ms > 0, "> 0"),
            noise=(self.noise >= 0, ">= 0"),
            shot_gain=(self.shot_gain >= 0, ">= 0"),
            bits=(self.bits in (8, 10, 12, 16), "8, 10, 12 or 16"),
            smoothing_px=(self.smoothing_px >= 0, ">= 0"),
            jpeg=(0 <= self.jpeg <= (100 if self.bits == 8 else 0), "0 to 100, 0 beyond 8 bit"),
            flicker=(0 <= self.flicker <= 1, "0 to 1"),
            filters=(are_shares(self.filters), "three rows of three shares with the sum 1"),
            flicker_hz=(self.flicker_hz > 0, "> 0"),
            **{k: (0 <= getattr(self, k) < 1, "0 to 1") for k in ("lag", "loss", "frozen", "torn")},
        )


class _Coming(NamedTuple):
    """A frame that was or is being exposed, and has not been grabbed."""

    number: int
    start_s: float
    arrival_s: float


class VirtualCamera(Closing):
    """A camera that sees a scene in the light of a virtual projector.

    Parameters
    ----------
    scene : Scene
    projector : VirtualProjector
        Its clock is the camera's as well.
    model : CameraModel, optional
    seed : int
        Seed of noise, jitter and losses.
    """

    def __init__(
        self,
        scene: Scene,
        projector: VirtualProjector,
        model: CameraModel | None = None,
        *,
        seed: int = 0,
    ) -> None:
        self.scene = scene
        self.model = model or CameraModel()
        self.pictures: tuple[int, ...] = ()
        """Numbers of the projector's pictures that the last frame shows; one where it is clean."""
        self._projector = projector
        self._clock = projector.clock
        self._rng = np.random.default_rng(seed)
        self._coming: deque[_Coming] = deque()
        self._number = 0
        self._arrived_s = -np.inf
        self._auto = 1.0
        self._last: NDArray[Any] | None = None
        self._held: FloatMap | None = None
        self._seen: dict[int, FloatMap] = {}
        self._colours = False
        self._open = True
        rows, columns = scene.shape
        self._settings = CameraSettings(
            self.model.reference_ms, 0.0, Region(0, 0, columns, rows), self._format, False
        )
        self._restart()

    @property
    def name(self) -> str:
        """``virtual``."""
        return "virtual"

    @property
    def _format(self) -> str:
        return f"{'RGB' if self._colours else 'Mono'}{self.model.bits}"

    def limits(self) -> CameraLimits:
        """What the camera can be set to."""
        rows, columns = self.scene.shape
        return CameraLimits(columns, rows, EXPOSURES_MS, GAINS_DB, (self._format,), self._period_s)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings; see ``Camera.configure``."""
        for name, limits in (("exposure_ms", EXPOSURES_MS), ("gain_db", GAINS_DB)):
            value = getattr(settings, name)
            if value is not None and not limits[0] <= value <= limits[1]:
                raise InputError(
                    f"virtual camera: {name}: expected {limits[0]:g} to {limits[1]:g}, "
                    f"got {value:g}"
                )
        if settings.pixel_format not in (None, self._format):
            raise InputError(
                f"virtual camera: expected the pixel format {self._format}, "
                f"got {settings.pixel_format}"
            )
        rows, columns = self.scene.shape
        region = settings.region
        if region is not None and (
            region.x_px + region.width_px > columns or region.y_px + region.height_px > rows
        ):
            raise InputError(
                f"virtual camera: expected a region within {columns} × {rows} px, got {region}"
            )
        self._settings = settings.over(self._settings)
        self._restart()
        return self._settings

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        self._colours = wanted
        self._last = self._held = None
        self._settings = replace(self._settings, pixel_format=self._format)
        self._restart()

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        deadline_s = self._clock.now_s() + timeout_s
        self._advance()
        if not self._coming or self._coming[0].arrival_s > deadline_s:
            self._clock.wait_until(deadline_s)
            raise DeviceProblem(f"virtual camera: no frame arrived within {timeout_s:g} s")
        coming = self._coming.popleft()
        self._clock.wait_until(coming.arrival_s)
        return self._taken(coming)

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""
        self._advance()
        now_s = self._clock.now_s()
        return sum(coming.arrival_s <= now_s for coming in self._coming)

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        for _ in range(self.waiting()):
            self._drop()

    def trigger(self) -> float:
        """Expose a frame now; see ``TriggeredCamera.trigger``."""
        self._advance()
        if not self._settings.triggered:
            raise DeviceProblem("virtual camera: expected a camera that waits for triggers")
        now_s = self._clock.now_s()
        self._expect(now_s)
        return now_s

    def close(self) -> None:
        """Take no more frames."""
        self._open = False

    @property
    def _exposure_s(self) -> float:
        exposure_ms = self._settings.exposure_ms if self.model.obeys_exposure else None
        return 1e-3 * (exposure_ms or self.model.reference_ms)

    @property
    def _period_s(self) -> float:
        return max(1.0 / self.model.fps, self._exposure_s)

    def _restart(self) -> None:
        """Begin a new series of frames, at the settings of now."""
        self._coming.clear()
        self._start_s = self._clock.now_s()
        self._started = self._number

    def _advance(self) -> None:
        """Bring the list of coming frames up to the present: one that has not arrived is last."""
        if not self._open:
            raise DeviceProblem("virtual camera: expected an open camera, got a closed one")
        now_s = self._clock.now_s()
        if not self._settings.triggered:
            late_s = self._exposure_s + self.model.readout_s + self.model.delay_s
            periods = (now_s - late_s - self._start_s) / self._period_s - KEPT_FRAMES
            # Frames that were thrown away long ago are not even made.
            skip = int(periods) - self.model.jitter_frames - 1
            self._number = max(self._number, self._started + skip)
            while not self._coming or self._coming[-1].arrival_s <= now_s:
                elapsed = (self._number - self._started) * self._period_s
                self._expect(self._start_s + elapsed)
        while sum(coming.arrival_s <= now_s for coming in self._coming) > KEPT_FRAMES:
            self._drop()

    def _drop(self) -> None:
        """Lose the oldest frame. Its light stays where frames keep a share of the one before."""
        coming = self._coming.popleft()
        if self.model.lag:
            self._pixels(coming.start_s)

    def _expect(self, start_s: float) -> None:
        """Add a frame whose exposure starts then."""
        number, self._number = self._number, self._number + 1
        if self._rng.random() < self.model.loss:
            return
        late = int(self._rng.integers(0, self.model.jitter_frames + 1)) * self._period_s
        arrival_s = start_s + self._exposure_s + self.model.readout_s + self.model.delay_s + late
        # Frames arrive in their order.
        self._arrived_s = max(arrival_s, self._arrived_s)
        self._coming.append(_Coming(number, start_s, self._arrived_s))

    def _taken(self, coming: _Coming) -> Grab:
        pixels = self._pixels(coming.start_s)
        if self._last is not None and self._rng.random() < self.model.frozen:
            pixels = self._last
        self._last = pixels
        complete = not self._rng.random() < self.model.torn
        if not complete:
            pixels = pixels.copy()
            pixels[len(pixels) // 2 :] = 0
        return Grab(pixels, coming.arrival_s, coming.start_s, coming.number, complete)

    def _pixels(self, start_s: float) -> NDArray[Any]:
        rows = self.scene.shape[0]
        lines = rows if self.model.shutter == "rolling" else 1
        from_s = start_s + self.model.readout_s * np.arange(lines) / lines
        until_s = from_s + self._exposure_s
        reference_s = 1e-3 * self.model.reference_ms
        lines_shape = (lines, 1, 1) if self._colours else (lines, 1)
        ambient = self._delivered(self.scene.ambient)
        light = self._ambient_s(from_s, until_s).reshape(lines_shape) * ambient
        seen = self._projector.seen(from_s, until_s)
        for shown, time_s in seen:
            light = light + time_s.reshape(lines_shape) * self._delivered(self._projected(shown))
        self.pictures = tuple(shown.number for shown, _ in seen)
        full = 2**self.model.bits - 1
        gain = 10.0 ** ((self._settings.gain_db or 0.0) / 20.0)
        share = light / reference_s * gain * self._auto
        if self.model.auto_exposure:
            wanted = AUTO_TARGET / max(float(np.mean(np.minimum(share, 1.0))), 1e-3)
            self._auto *= 1.0 + AUTO_STEP * (wanted - 1.0)
        return self._read_out(full * share, full, gain)

    def _read_out(self, counts: FloatMap, full: int, gain: float) -> NDArray[Any]:
        """Noise and its reduction, the region, clipping, rounding and compression."""
        per_count = full / 255.0
        shot = self.model.shot_gain * per_count * gain * counts
        variance = (self.model.noise * per_count * gain) ** 2 + shot
        noise = self._rng.standard_normal(counts.shape, np.float32)
        counts = counts + np.sqrt(variance) * noise
        if self.model.smoothing_px:
            width = self.model.smoothing_px
            counts = scipy.ndimage.gaussian_filter(counts, width, mode="nearest", axes=(0, 1))
        if self.model.lag:
            before = counts if self._held is None else self._held
            self._held = counts = self.model.lag * before + (1.0 - self.model.lag) * counts
        region = self._settings.region
        assert region is not None
        part = np.clip(np.rint(counts), 0, full)[
            region.y_px : region.y_px + region.height_px,
            region.x_px : region.x_px + region.width_px,
        ]
        if self.model.jpeg:
            planes = np.atleast_3d(part).astype(np.uint8)
            stored = [jpeg_compressed(p, self.model.jpeg) for p in np.moveaxis(planes, 2, 0)]
            return np.stack(stored, axis=-1).reshape(part.shape)
        return part.astype(np.uint8 if self.model.bits == 8 else np.uint16)

    def _ambient_s(self, from_s: FloatMap, until_s: FloatMap) -> FloatMap:
        """Time of ambient light in an exposure, weighted with its flicker, s."""
        turns = 2.0 * np.pi * self.model.flicker_hz
        flicker = self.model.flicker * (np.sin(turns * until_s) - np.sin(turns * from_s)) / turns
        return np.asarray(until_s - from_s + flicker)

    def _delivered(self, light: FloatMap) -> FloatMap:
        """Light in the channels of the frames that are delivered, from grey light or from that of
        each colour of the projector."""
        if light.ndim == len(self.scene.shape):
            return light[..., None] * np.ones(COLOURS) if self._colours else light
        channels = light @ np.asarray(self.model.filters).T
        return channels if self._colours else np.asarray(channels @ np.array(LUMINANCE_SHARES))

    def _projected(self, shown: Shown) -> FloatMap:
        """Light of a shown picture at the pixels, computed once."""
        if shown.number not in self._seen:
            kept = {s.number for s in self._projector.shown}
            self._seen = {n: light for n, light in self._seen.items() if n in kept}
            self._seen[shown.number] = self.scene.projected(shown.light)
        return self._seen[shown.number]
