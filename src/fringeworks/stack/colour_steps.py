"""Fringes in the colours of a picture: crosstalk is measured in solid pictures, and removed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import SOLID, PatternPlan, PhaseSteps
from fringeworks.signal.bands import row_bands
from fringeworks.stack.frames import FRAME_TYPES, Stack, saturation_of
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import (
    BoolMap,
    CameraNoise,
    FloatMap,
    FramesContradictPlan,
    InputError,
    sealed,
    unmasked,
)

SAMPLED_PX = 40_000
"""Number of pixels from which noise and light of the pictures are measured, to 1 %."""
BLOCK_PX = 8
"""Side of the blocks over which errors are averaged, px: the noise of a mean is an eighth of that
of a pixel."""
LIT_RATIO = 6.0
"""Largest noise of a pixel's light over that of the clearest pixels, for pixels that are judged."""
CLEAREST = 0.1
"""Share of the pixels that count as the clearest."""
BRIGHTNESS_GROUPS = 12
"""Number of groups of pixels of similar brightness, by which shot noise is separated from read
noise."""
PRECISION = 5e-5
"""Least standard deviation of counts that are floats, relative to the largest count: that of the
decoder's arithmetic."""
OUTLIER_SIGMAS = 4.0
"""Standard deviations at which the error of a sum of steps is cut: 6 in 100 000 of Gaussian noise
lie beyond."""
ROUNDING = 1.0 / 12.0
"""Variance of rounding to whole counts, counts²: the least that counts have."""
LIGHT_CHANGE = 0.02
"""Change of a colour's light between pictures that is expected before it is measured. Empirical."""
MOST_LIGHT_CHANGE = 0.1
"""Largest change of a colour's light between pictures. Lamps and exposures keep to 1 %; a colour
wheel that is not a whole number of turns per exposure makes tens of per cent."""
MOST_ERROR = 0.04
"""Largest rms error of the sum of a set's three steps that neighbours share, as a share of white.

Bands of a colour wheel of 5 % make 0.03 in simulations, and σ covers them. Bands of 10 % make
0.056, and only 58 % of the errors are within σ.
"""
BASE = 16.0
"""Counts of the dark in unmixed frames, whose noise is 1: it does not reach 0."""
ABOVE = 1.5
"""Count that stands for saturation, over the brightest light: no noise reaches it."""
MOST_CROSSTALK = 50.0
"""Largest noise of a colour's light, relative to that of the camera, up to which colours count as
told apart. Filters of cameras make 2 to 5. Empirical."""
LIGHTS = 3
"""Colours of the projector, red, green and blue, and channels of the camera."""
SAME_LIGHT = (
    "likely a colour wheel and an exposure that is no whole number of its turns, automatic "
    "exposure or white balance, gamma of camera or projector, a scene that moved, or pictures in "
    "another order; fix the camera's settings, expose for whole turns of the wheel, and switch off "
    "the projector's white segment and colour enhancement"
)
"""What makes the light of a colour differ between pictures, and what helps."""


APART = "expected pixels whose channels tell red, green and blue light apart"
"""What the camera must see."""
GREY = "likely a grey camera, light of one colour, or too little of it; give such pictures in grey"
"""Why a camera does not see it, and what helps."""


@dataclass(frozen=True)
class _Solid:
    """The solid pictures at some pixels: the light of each colour in each channel."""

    inverse: FloatMap
    """(…, colour, channel): counts above black to shares of the colours' light; 0 where unknown."""
    light: FloatMap
    """(…, channel, colour): counts that each colour adds."""
    black: FloatMap
    """(…, channel), counts."""

    @classmethod
    def of(cls, solid: FloatMap) -> _Solid:
        """From red, green, blue and black, (4, …, channel)."""
        black = solid[3]
        light = np.moveaxis(solid[:3] - black, 0, -1)
        with np.errstate(all="ignore"):
            a, b, c = (light[..., k, :] for k in range(LIGHTS))
            rows = np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)), axis=-1)
            inverse = rows / np.sum(a * rows[..., 0], axis=-1)[..., None, None]
        known = np.isfinite(inverse).all(axis=(-2, -1))
        return cls(np.where(known[..., None, None], inverse, 0.0), light, black)

    def shares(self, picture: FloatMap) -> FloatMap:
        """Light of each colour in a picture, (…, colour), as a share of its solid picture."""
        return np.asarray(np.einsum("...dc,...c->...d", self.inverse, picture - self.black))

    def variance(self, noise: CameraNoise, squares: FloatMap, counts: FloatMap) -> FloatMap:
        """Variance of the error of each channel, (…, channel), counts².

        ``squares`` are the squared shares of the colours, (…, colour), whose sum of shares is 3/2,
        and ``counts`` those of the picture. Noise of the solid pictures counts as well.
        """
        solid = noise.variance(self.light + self.black[..., None])
        own = noise.variance(counts) + 0.25 * noise.variance(self.black)
        return np.asarray(own + np.einsum("...cd,...d->...c", solid, squares))

    def spread(self, noise: CameraNoise, error: float = 0.0) -> FloatMap:
        """Standard deviation of a step that makes the noise of the phase, mean over all phases.

        Notes
        -----
        With equal steps δ_d, σ_φ² = (2/3) s² / B² and s² = ⅓ Σ C_de cos(δ_d − δ_e), where C is the
        covariance of the three shares: one third of its trace less its covariances.
        """
        mean = self.black + 0.5 * self.light.sum(axis=-1)
        squares = np.full((*self.black.shape[:-1], LIGHTS), 0.375)
        channel = self.variance(noise, squares, mean)
        own = np.einsum("...dc,...c->...", self.inverse**2, channel)
        together = np.einsum("...c,...c->...", self.inverse.sum(axis=-2) ** 2, channel)
        s2 = (own - 0.5 * (together - own)) / LIGHTS
        with np.errstate(all="ignore"):
            s = np.sqrt(s2 + error**2 / LIGHTS)
        return np.asarray(np.where(own > 0.0, s, np.inf))


def unmix(
    pictures: NDArray[Any] | Sequence[NDArray[Any]],
    plan: PatternPlan,
    *,
    saturation: float | None = None,
) -> Stack:
    """Turn photographs of the colour pictures of a plan into its frames, without crosstalk.

    Parameters
    ----------
    pictures : (n, h, w, 3) array or sequence of (h, w, 3) arrays, counts
        In the order of ``encode``: three frames of the plan in red, green and blue of each, then
        solid red, green, blue and black. In proportion to the light, without gamma.
    plan : PatternPlan
        With ``colours``.
    saturation : float > 0, optional
        Counts from which on a channel is not trusted; the type's largest value for integers.

    Returns
    -------
    Stack
        Grey frames whose noise is 1 count everywhere, the colour of the scene, and what was found.

    Raises
    ------
    InputError
        For a plan without colours, other shapes, and channels that do not tell the colours apart.
    FramesContradictPlan
        For another number of pictures, and where the light of a colour differs between pictures.

    Notes
    -----
    A pixel's channels see I = K + A v, with the light v of the three colours, black K and a matrix
    A that has the object's colour, the filters of the camera and the crosstalk in it. Its columns
    are the solid pictures less black, so v = A⁻¹ (I − K) at every pixel, whatever its colour. The
    noise of all pictures is propagated to the phase. Its size is that of the sum of three steps,
    which is 3/2 in every pixel.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> sets = tuple(PhaseSteps("x", p, equal_steps(3)) for p in (64.0, 16.0))
    >>> plan = PatternPlan(64, 40, sets, colours=True)
    >>> photographs = [picture // 2 + 20 for picture in encode(plan)]
    >>> unmix(photographs, plan).frames[0].shape
    (40, 64)
    """
    planes = _checked(pictures, plan)
    count = len(planes) - len(SOLID)
    shown, solid = planes[:count], planes[count:]
    limit = saturation_of(planes[0].dtype, saturation)
    sets = [first // LIGHTS for first, block in plan.placed if isinstance(block, PhaseSteps)]
    floor = _floor(planes)
    noise, light = _judged(shown, solid, sets, limit, floor)
    error = _smooth_error(shown, solid, sets, light, noise, limit)
    frames, colour = _frames(shown, solid, light, limit, noise, error)
    return Stack(
        tuple(sealed(frame) for frame in frames[0]),
        plan,
        saturation=frames[1],
        notes=_notes(noise, error, light, colour[1]),
        colour=sealed(colour[0]),
        noise=CameraNoise(1.0),
    )


def _checked(
    pictures: NDArray[Any] | Sequence[NDArray[Any]], plan: PatternPlan
) -> list[NDArray[Any]]:
    """The pictures as arrays of one shape and type."""
    if not plan.colours:
        raise InputError("plan: expected one with colours = true, got one of grey pictures")
    planes = [unmasked(picture, "pictures") for picture in pictures]
    expected = plan.pictures
    if len(planes) != expected:
        raise FramesContradictPlan(
            f"pictures: the plan has {expected}, the last four solid red, green, blue and black, "
            f"got {len(planes)}"
        )
    for label, picture in zip(plan.picture_labels(), planes, strict=True):
        if picture.ndim != 3 or picture.shape[2] != LIGHTS or picture.size == 0:
            raise InputError(
                f"picture {label}: expected colours, (h, w, 3), got shape {picture.shape}"
            )
        if picture.shape != planes[0].shape or picture.dtype != planes[0].dtype:
            raise FramesContradictPlan(
                f"picture {label}: expected {planes[0].dtype} {planes[0].shape} as the first, got "
                f"{picture.dtype} {picture.shape}"
            )
        if picture.dtype.name not in FRAME_TYPES:
            raise InputError(
                f"picture {label}: expected {', '.join(FRAME_TYPES)}, got {picture.dtype}"
            )
    red = planes[-len(SOLID)]
    if np.array_equal(red[..., 0], red[..., 1]) and np.array_equal(red[..., 0], red[..., 2]):
        raise InputError("pictures: expected a camera that sees colours, got three equal channels")
    return planes


def _judged(
    shown: Sequence[NDArray[Any]],
    solid: Sequence[NDArray[Any]],
    sets: Sequence[int],
    limit: float,
    floor: float,
) -> tuple[CameraNoise, FloatMap]:
    """Noise of the camera, and the light of each colour in each picture, (pictures, colours), as a
    share of that in its solid picture."""
    step = max(1, int(np.sqrt(shown[0][..., 0].size / SAMPLED_PX)))
    every = [np.asarray(p[::step, ::step], np.float64).reshape(-1, LIGHTS) for p in shown]
    still = np.stack([np.asarray(p[::step, ::step], np.float64).reshape(-1, 3) for p in solid])
    clear = np.logical_and.reduce([(p < limit).all(axis=1) for p in (*every, *still)])
    known = _Solid.of(still)
    spread = known.spread(CameraNoise(1.0))
    clear &= np.isfinite(spread)
    if np.count_nonzero(clear) < BRIGHTNESS_GROUPS:
        raise InputError(f"pictures: {APART}, none of them saturated, got none; {GREY}")
    lit = clear & (spread < LIT_RATIO * np.quantile(spread[clear], CLEAREST))
    relative = spread[lit] * np.linalg.norm(known.light[lit], axis=(-2, -1))
    if np.median(relative) > MOST_CROSSTALK:
        raise InputError(f"pictures: {APART}, got channels that see the same; {GREY}")
    part = _Solid(known.inverse[lit], known.light[lit], known.black[lit])
    light = np.ones((len(shown), LIGHTS))
    noise = CameraNoise(1.0)
    for _ in range(2):
        shares = {k: part.shares(every[k][lit]) / light[k] for k in sets}
        noise = _noise(part, [every[k][lit] for k in sets], list(shares.values()), floor)
        for k in sets:
            light[k] *= _light(part, every[k][lit], shares[k], noise)
    worst = np.unravel_index(np.argmax(np.abs(np.log(np.maximum(light, 1e-3)))), light.shape)
    if abs(light[worst] - 1.0) > MOST_LIGHT_CHANGE:
        raise FramesContradictPlan(
            f"picture {worst[0]}: its {SOLID[worst[1]]} light is {100 * light[worst]:.0f} % of that"
            f" in the solid picture; expected the same light; {SAME_LIGHT}"
        )
    return noise, light


def _floor(planes: Sequence[NDArray[Any]]) -> float:
    """Least variance of a count: that of rounding, or of floats in single precision."""
    if planes[0].dtype.kind == "u":
        return ROUNDING
    return (PRECISION * max(float(np.nanmax(np.abs(p))) for p in planes)) ** 2


def _noise(
    part: _Solid, pictures: list[FloatMap], shares: list[FloatMap], floor: float
) -> CameraNoise:
    """Noise of the camera from the sums of three steps, by groups of brightness."""
    squares, counts = [], []
    for picture, v in zip(pictures, shares, strict=True):
        weight = part.inverse.sum(axis=-2) ** 2
        read = np.sum(weight * part.variance(CameraNoise(1.0), v**2, picture), axis=-1)
        shot = np.sum(weight * part.variance(CameraNoise(0.0, 1.0), v**2, picture), axis=-1)
        squares.append((v.sum(axis=-1) - 1.5) ** 2 / read)
        counts.append(shot / read)
    square, count = np.concatenate(squares), np.concatenate(counts)
    order = np.argsort(count, kind="stable")
    groups = np.array_split(order, BRIGHTNESS_GROUPS)
    variance = np.array([_without_outliers(square[g]) for g in groups])
    variance = np.maximum(variance, max(floor, 1e-30))
    brightness = np.array([count[g].mean() for g in groups])
    design = np.stack((np.ones_like(brightness), brightness), axis=1) / variance[:, None]
    read, gain = np.linalg.lstsq(design, np.ones_like(variance), rcond=None)[0]
    if gain <= 0.0:
        return CameraNoise(float(np.sqrt(np.median(variance))))
    if read < floor:
        read, gain = floor, np.median((variance - floor) / np.maximum(brightness, 1e-12))
    return CameraNoise(float(np.sqrt(max(read, 1e-30))), float(max(gain, 0.0)))


def _without_outliers(squares: FloatMap) -> float:
    """Mean of squares, where those of outliers count as much as the largest of the noise: errors of
    demosaicing are not Gaussian, and edges are no noise."""
    usual = float(np.median(squares)) / NORMAL_MEDIAN**2
    return float(np.mean(np.minimum(squares, OUTLIER_SIGMAS**2 * usual)))


def _light(part: _Solid, picture: FloatMap, v: FloatMap, noise: CameraNoise) -> FloatMap:
    """Light of each colour in a picture, from the sum of three steps, which is 3/2 under the light
    of the solid pictures."""
    channel = part.variance(noise, v**2, picture)
    noisy = np.einsum("ndc,nc,nec->de", part.inverse, channel, part.inverse)
    misfit = 1.5 - v.sum(axis=-1)
    prior = np.mean(misfit**2) / LIGHT_CHANGE**2 * np.eye(LIGHTS)
    normal = v.T @ v - noisy
    change = np.linalg.solve(normal + prior, v.T @ misfit + noisy.sum(axis=1))
    return np.asarray(1.0 / np.maximum(1.0 + change, 0.1))


def _bands(
    shown: Sequence[NDArray[Any]], solid: Sequence[NDArray[Any]]
) -> Iterator[tuple[slice, _Solid]]:
    """The rows of the pictures in bands, whole blocks high, and the solid pictures there."""
    for band in row_bands(shown[0].shape[:2], 40 * np.dtype(np.float64).itemsize):
        rows = band.rows
        yield rows, _Solid.of(np.stack([np.asarray(p[rows], np.float64) for p in solid]))


def _smooth_error(
    shown: Sequence[NDArray[Any]],
    solid: Sequence[NDArray[Any]],
    sets: Sequence[int],
    light: FloatMap,
    noise: CameraNoise,
    limit: float,
) -> float:
    """Error of the sum of three steps that neighbours share, rms, as a share of white light."""
    squares: list[FloatMap] = []
    for rows, known in _bands(shown, solid):
        spread = known.spread(noise)
        clear = np.isfinite(spread) & ~_saturated(solid, rows, limit)
        if not clear.any():
            continue
        lit = clear & (spread < LIT_RATIO * np.quantile(spread[clear], CLEAREST))
        for k in sets:
            picture = np.asarray(shown[k][rows], np.float64)
            v = known.shares(picture) / light[k]
            weight = known.inverse.sum(axis=-2) ** 2
            variance = np.sum(weight * known.variance(noise, v**2, picture), axis=-1)
            used = lit & ~_saturated(shown[k : k + 1], rows, limit)
            squares.append(_of_blocks(v.sum(axis=-1) - 1.5, variance, used))
    found = np.concatenate(squares) if squares else np.empty(0)
    error = float(np.sqrt(max(np.mean(found), 0.0))) if found.size else 0.0
    if error > MOST_ERROR:
        raise FramesContradictPlan(
            f"pictures: expected the three steps of a set to add up to 150 % of white, got sums "
            f"that are off by {100 * error:.0f} % of white in whole regions; {SAME_LIGHT}"
        )
    return error


def _saturated(planes: Sequence[NDArray[Any]], rows: slice, limit: float) -> BoolMap:
    """Where a channel of a picture is saturated, or unknown."""
    return np.asarray(np.logical_or.reduce([~(p[rows] < limit).all(axis=-1) for p in planes]))


def _of_blocks(error: FloatMap, variance: FloatMap, lit: BoolMap) -> FloatMap:
    """Squared mean error of blocks that are lit all over, less what noise makes of it."""
    rows, columns = (n // BLOCK_PX for n in error.shape)
    if not (rows and columns):
        return np.empty(0)

    def blocks(values: FloatMap) -> FloatMap:
        part = values[: rows * BLOCK_PX, : columns * BLOCK_PX]
        return np.asarray(
            part.reshape(rows, BLOCK_PX, columns, BLOCK_PX).mean(axis=(1, 3), dtype=np.float64)
        )

    whole = blocks(lit.astype(np.float64)) == 1.0
    with np.errstate(all="ignore"):
        found = blocks(error) ** 2 - blocks(variance) / BLOCK_PX**2
    return np.asarray(found[whole & np.isfinite(found)])


def _frames(
    shown: Sequence[NDArray[Any]],
    solid: Sequence[NDArray[Any]],
    light: FloatMap,
    limit: float,
    noise: CameraNoise,
    error: float,
) -> tuple[tuple[list[NDArray[np.float32]], float], tuple[FloatMap, FloatMap]]:
    """The frames with their saturation; the colour of the scene, and the median crosstalk."""
    shape = shown[0].shape[:2]
    frames = [np.empty(shape, np.float32) for _ in range(LIGHTS * len(shown))]
    colour = np.empty((*shape, LIGHTS), np.float32)
    scale, mixed = np.zeros(shape, np.float32), []
    saturated = np.zeros((len(shown), *shape), bool)
    for rows, known in _bands(shown, solid):
        scale[rows] = part = 1.0 / known.spread(noise, error)
        still = _saturated(solid, rows, limit)
        colour[rows] = np.maximum(known.light.sum(axis=-1), 0.0)
        own = np.maximum(np.einsum("...cc->...c", known.light), 1e-9)
        mixed.append((known.light / own[..., None])[part > 0.5 * np.quantile(part, 0.9)][::16])
        for k, picture in enumerate(shown):
            v = known.shares(np.asarray(picture[rows], np.float64)) / light[k]
            saturated[k][rows] = still | _saturated([picture], rows, limit)
            for d in range(LIGHTS):
                frames[LIGHTS * k + d][rows] = BASE + part * v[..., d]
    top = BASE + ABOVE * float(scale.max())
    for k, mask in enumerate(saturated):
        for d in range(LIGHTS):
            frames[LIGHTS * k + d][mask] = top
    return (frames, top), (colour, np.median(np.concatenate(mixed), axis=0))


def _notes(
    noise: CameraNoise, error: float, light: FloatMap, crosstalk: FloatMap
) -> tuple[str, ...]:
    """What was found, in sentences."""
    from fringeworks.types.numbers import number

    names = SOLID[:LIGHTS]
    told = ", ".join(
        f"{100 * crosstalk[c, d]:.0f} % of {names[d]} in {names[c]}"
        for c in range(LIGHTS)
        for d in range(LIGHTS)
        if c != d
    )
    change = 100.0 * float(np.abs(light - 1.0).max())
    return (
        f"crosstalk of the colours was measured and removed: {told}",
        f"noise of a channel is {number(float(noise.variance(100.0) ** 0.5), digits=2)} counts at "
        f"100 counts; the light of a colour changes by up to {number(change, digits=2)} % between "
        f"pictures, which is removed; further errors of {number(100 * error, digits=2)} % are in σ",
    )
