"""Moiré: the beat of the projector's pixels with those of the camera, in a flat picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fringeworks.patterns.order_chain import TURN
from fringeworks.scan.checks.levels import Levels
from fringeworks.scan.checks.orientation import Orientation
from fringeworks.stack.refine import NOTABLE_RATIO
from fringeworks.stack.ripple import MIN_WINDOWS, SIGNIFICANT_AMPLITUDE, TINY, pooled
from fringeworks.types import Finding, FloatMap, Frozen

ORDERS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0), (0, 2))
"""Periods per projector pixel along x and y of the patterns that are looked for. Square pixels with
gaps have the first ones strongest; second ones beat slowly where the camera sees a projector pixel
as two."""
SMALL_BLOCK_PX = 16
"""Side of small blocks, camera px: curved surfaces are smooth over them."""
SIDE_SHARES = (6, 3)
"""Larger blocks are these fractions of the frame's shorter side: beats of up to that period are
seen, and the twelve blocks or more still tell how sure an amplitude is."""
MOST_BLOCKS = 200
"""Blocks of one size that are used, spread over the frame; more only take time."""
MOST_SAMPLES = 24
"""Samples along the side of a block that are used; more only take time."""
DEGREE = 3
"""Degree of the polynomials that shading, and the coordinates of the surface, follow over a block:
as along the lines of a stack."""
MIN_FULL = 0.5
"""Smallest share of the samples of a block that must be lit and measured. Fewer hardly determine a
polynomial of third degree at the other side of the block."""
USUAL_AMPLITUDE = 0.1
"""Amplitude that a sharp grid usually has, relative to the light: that of gaps of 5 % of a pixel.
It holds patterns near zero that the blocks hardly show."""


@dataclass(frozen=True, eq=False, repr=False)
class PixelGrid(Frozen):
    """The strongest pattern of the projector's pixel grid in a flat picture."""

    order: tuple[int, int]
    """Its periods per projector pixel along x and y."""
    amplitude: float
    """Its amplitude as far as it changes over a block, relative to the light."""
    error: float
    """Standard error of the amplitude."""
    noise: float
    """Standard deviation of the flat picture about shading and patterns, relative to the light."""
    period_px: float
    """Its usual period in the frame, camera px."""
    direction_deg: float
    """Direction across its stripes, from the camera's x towards its y, 0…180°."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The pattern as a finding, where it is seen and adds to the noise of a pixel."""
        matters = 0.5 * self.amplitude**2 > (NOTABLE_RATIO - 1.0) * self.noise**2
        return (_finding(self),) if self.seen and matters else ()

    @property
    def seen(self) -> bool:
        """Whether the amplitude is more than chance makes of it."""
        return self.amplitude > SIGNIFICANT_AMPLITUDE * self.error

    @property
    def rank(self) -> tuple[float, float]:
        """Larger for patterns that are seen and strong, then for those that are surer."""
        return self.seen * self.amplitude, self.amplitude / max(self.error, TINY)

    def __str__(self) -> str:
        if not self.seen:
            return "not seen in a flat picture"
        return f"changes the brightness of a flat picture by ±{self.amplitude:.1%}"


def check_pixel_grid(levels: Levels, orientation: Orientation) -> PixelGrid | None:
    """Look for the grid of the projector's pixels in the light of white.

    Parameters
    ----------
    levels : Levels
        Light of white.
    orientation : Orientation
        Projector coordinates.

    Returns
    -------
    PixelGrid; None where too little of the frame is lit.

    Notes
    -----
    The coordinates tell the frequency of the pattern everywhere, as the camera's pixels alias it:
    its amplitude is the spectrum of the picture there. It is a cosine of the coordinates, because
    pixels are symmetric about their middles. What the surface's own texture adds differs from block
    to block, and is part of the error.
    """
    shorter = min(levels.white.shape)
    sides = {SMALL_BLOCK_PX, *(shorter // share for share in SIDE_SHARES)}
    found = [_of_blocks(list(_blocks(levels, orientation, side))) for side in sides]
    shown = [grid for grid in found if grid is not None]
    return max(shown, key=lambda grid: grid.rank, default=None)


@dataclass(frozen=True)
class _Block:
    """Patterns and light of a block, both without their smooth part."""

    waves: FloatMap
    """(n, orders)."""
    light: FloatMap
    """(n,), relative."""
    slopes: FloatMap
    """(2, 2): ∂(x, y)/∂(u, v) of the projector's coordinates over the camera's."""


def _blocks(levels: Levels, orientation: Orientation, side: int) -> Iterator[_Block]:
    """Blocks of a frame that are lit and smooth enough."""
    height, width = (size // max(side, 1) for size in levels.white.shape)
    if side < DEGREE + 2:
        return
    step = -(-side // MOST_SAMPLES)
    v, u = (m.ravel() for m in np.mgrid[:side:step, :side:step] * (2.0 / side) - 1.0)
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    shapes = np.stack([u**i * v**j for i, j in powers], axis=1)
    for block in range(0, height * width, -(-height * width // MOST_BLOCKS)):
        top, left = (side * k for k in divmod(block, width))
        part = np.s_[top : top + side : step, left : left + side : step]
        light = levels.white[part].ravel().astype(np.float64)
        places = np.stack([m[part].ravel() for m in (orientation.x_px, orientation.y_px)], axis=1)
        used = levels.lit[part].ravel() & np.isfinite(places).all(axis=1)
        if used.sum() < max(MIN_FULL * used.size, 2 * len(powers)):
            continue
        basis, _ = np.linalg.qr(shapes[used])
        smooth = basis @ (basis.T @ places[used].astype(np.float64))
        waves = np.cos(TURN * smooth @ np.array(ORDERS).T)
        relative = light[used] / light[used].mean()
        plane = np.stack([np.ones(used.sum()), u[used], v[used]], axis=1)
        slopes = np.linalg.lstsq(plane, smooth, rcond=None)[0][1:].T * (2.0 / side)
        yield _Block(
            waves - basis @ (basis.T @ waves), relative - basis @ (basis.T @ relative), slopes
        )


def _of_blocks(blocks: list[_Block]) -> PixelGrid | None:
    """The strongest pattern by least squares over all blocks, each weighted with its scatter."""
    if len(blocks) < MIN_WINDOWS:
        return None
    scatter = np.array([np.mean(block.light**2) for block in blocks])
    usual = float(np.median(scatter))
    weight = usual / np.maximum(scatter, max(usual, TINY))
    normal = np.stack([w * b.waves.T @ b.waves for w, b in zip(weight, blocks, strict=True)])
    projected = np.stack([w * b.waves.T @ b.light for w, b in zip(weight, blocks, strict=True)])
    known = np.full(len(ORDERS), max(usual, TINY) / USUAL_AMPLITUDE**2)
    amplitudes, covariance = pooled(normal, projected, known, np.arange(len(blocks)))
    errors = np.sqrt(np.diag(covariance))
    left = [np.mean((block.light - block.waves @ amplitudes) ** 2) for block in blocks]
    noise = float(np.sqrt(np.median(left)))
    slopes = np.stack([block.slopes for block in blocks])
    # A pattern that hardly changes over a block shows there only as far as it does.
    waves = np.concatenate([block.waves for block in blocks])
    shown = np.sqrt(2.0 * np.mean(waves**2, axis=0))
    # Camera pixels that are wider than a period see the gaps bright.
    grids = [
        PixelGrid(order, float(abs(amplitude)), float(error), noise, *_beat(order, slopes))
        for order, amplitude, error in zip(ORDERS, shown * amplitudes, shown * errors, strict=True)
    ]
    return max(grids, key=lambda grid: grid.rank)


def _beat(order: tuple[int, int], slopes: FloatMap) -> tuple[float, float]:
    """Usual period, camera px, and direction, degrees, of a pattern as the camera's pixels alias
    it; ``slopes`` are those of the blocks, (n, 2, 2)."""
    frequency = np.einsum("k,nkc->nc", np.array(order, float), slopes)
    frequency -= np.rint(frequency)
    length = np.maximum(np.hypot(*frequency.T), TINY)
    # Directions that differ by half a turn are the same.
    double = np.sum((frequency[:, 0] + 1j * frequency[:, 1]) ** 2 / length**2)
    return float(1.0 / np.median(length)), float(np.rad2deg(0.5 * np.angle(double)) % 180.0)


def _finding(grid: PixelGrid) -> Finding:
    return Finding(
        "pixel grid",
        f"a flat picture shows the projector's pixels, as stripes {grid.period_px:.3g} camera px "
        f"apart whose normal is at {grid.direction_deg:.0f}° to the camera's rows, and whose "
        f"brightness changes by ±{grid.amplitude:.1%} (noise of a pixel: {grid.noise:.1%})",
        (
            "moiré of the projector's pixels, which have dark gaps, and those of the camera",
            "a camera that resolves the projector's pixels",
        ),
        "defocus the projector by about half of its pixels, or change the distance or the "
        "camera's magnification, until the stripes vanish; then run the set-up again, which cannot "
        "tell before whether pictures are resized",
        figures={
            "amplitude_share": grid.amplitude,
            "noise_share": grid.noise,
            "period_px": grid.period_px,
            "direction_deg": grid.direction_deg,
        },
    )
