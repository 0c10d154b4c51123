"""The light of every grey level: response, black level, and what is cut off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.saturation import largest_count
from fringeworks.scan.uniform import uniform_picture
from fringeworks.types import BoolMap, CameraSettings, DeviceProblem, Finding, FloatMap, Frozen

LEVELS = (0.5, 0.03, 0.6, 0.06, 0.7, 0.1, 0.8, 0.15, 0.87, 0.2, 0.92, 0.3, 0.96, 0.4, 1.0, 0.0)
"""Grey levels in the order of showing, share of full scale. They are denser at both ends, where
video of limited range is cut off: at 0.063 and 0.92. Each differs much from the one before, so that
the camera sees it change."""
LIT_SIGMAS = 8.0
"""Difference of white and black from which on a pixel counts as lit, standard deviations: noise
alone never reaches it, and fringes with less do not decode."""
MIN_LIT_SHARE = 0.02
"""Smallest share of lit pixels with which a camera sees enough of the projector's picture."""
MIN_CONTRAST = 2.0
"""Light of white over that of black under which the room is too bright: its light then takes half
of the camera's range, and its noise exceeds that of the projector's light."""
MAX_SATURATED_SHARE = 0.05
"""Share of lit pixels at the camera's limit from which on the exposure is too long."""
MAX_SATURATED = 0.5
"""Share of lit pixels at the camera's limit from which on nothing can be measured: the noise of
bright pixels is hidden, so that frames are not known to agree."""
CLIPPED_SHARE = 0.25
"""Rise of the light over the brightest levels, relative to the slope below, under which they count
as cut off. A response of any usual exponent keeps rising."""
TOP = 0.92
"""Level from which on video of limited range is cut off, share of full scale."""


@dataclass(frozen=True, eq=False, repr=False)
class Levels(Frozen):
    """What the camera sees of grey levels."""

    level: FloatMap
    """Shown levels, (n,), share of full scale."""
    light: FloatMap
    """Mean light over the lit pixels, (n,), relative to white, black taken away."""
    lit: BoolMap
    """Pixels that the projector lights and that are not at the camera's limit, (h, w)."""
    white: NDArray[np.float32]
    """White less black, (h, w), counts."""
    gamma: float
    """Exponent of the response: light ≈ level^γ."""
    contrast: float
    """Light of white over that of black, with the light of the room, at the median lit pixel."""
    saturated_share: float
    """Share of the lit pixels that are at the camera's limit under white."""
    brightness: FloatMap
    """Mean brightness of the lit pixels at each level, (n,), counts."""
    noise: FloatMap
    """Standard deviation of these pixels between two frames of each level, (n,), counts."""
    findings: tuple[Finding, ...]


def check_levels(
    projector: Projector, camera: Camera, agreement: Agreement, settings: CameraSettings
) -> Levels:
    """Show grey levels from black to white and measure their light.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    agreement : Agreement
        Of both.
    settings : CameraSettings
        As the camera reported them; for its limit.

    Returns
    -------
    Levels

    Raises
    ------
    DeviceProblem where the camera sees hardly anything of the projector's picture, or white is
    saturated.
    """
    shown = agreement.start()
    black, white = (grab.pixels.astype(np.float32) for grab in shown)
    full = largest_count(settings, shown[0].pixels.dtype)
    lit, saturated = _lit(camera, agreement, full, black, white)
    light, scatter = {}, {}
    for level in LEVELS:
        pixels = agreement.take(uniform_picture(projector, level), f"level {level:g}").pixels
        light[level] = float(np.mean((pixels.astype(np.float32) - black)[lit]))
        scatter[level] = _scatter(agreement, lit)
    levels = np.array(sorted(light))
    relative = np.array([light[level] for level in levels]) / light[1.0]
    noise = np.array([scatter[level] for level in levels])
    contrast = float(np.median(white[lit])) / max(float(np.median(black[lit])), 0.5)
    return Levels(
        levels,
        relative,
        lit,
        white - black,
        _exponent(levels, relative),
        contrast,
        saturated,
        light[1.0] * relative + float(np.mean(black[lit])),
        noise,
        tuple(_findings(levels, relative, saturated, contrast)),
    )


def _lit(
    camera: Camera,
    agreement: Agreement,
    full: float,
    black: NDArray[np.float32],
    white: NDArray[np.float32],
) -> tuple[BoolMap, float]:
    """Pixels that the projector lights below the limit, and the share of lit pixels that are at it.

    ``DeviceProblem`` where there are too few of them.
    """
    noise = np.sqrt(agreement.noise.usual.variance(black) + agreement.noise.usual.variance(white))
    seen = white - black > LIT_SIGMAS * noise
    if seen.mean() < MIN_LIT_SHARE:
        raise DeviceProblem(
            f"{camera.name}: expected white to light {MIN_LIT_SHARE:.0%} of the frame or more, got "
            f"{seen.mean():.1%}: point the camera at the projected picture, and use a longer "
            "exposure or less light in the room"
        )
    saturated = float(np.mean(white[seen] >= full))
    if saturated > MAX_SATURATED:
        raise DeviceProblem(
            f"{camera.name}: expected white below the camera's limit, got {saturated:.0%} of the "
            "lit pixels at it: use a shorter exposure, close the aperture, or darken the room"
        )
    return np.asarray(seen & (white < full)), saturated


def _scatter(agreement: Agreement, lit: BoolMap) -> float:
    """Standard deviation of the lit pixels in the frames that agreed last, counts."""
    one, other = agreement.pair
    stride = -(-lit.shape[0] // one.shape[0])
    difference = (one - other)[lit[::stride, ::stride]]
    return float(np.std(difference) / np.sqrt(2.0)) if difference.size else 0.0


def _exponent(level: FloatMap, light: FloatMap) -> float:
    """Exponent of the response that fits best, from 0.2 to 5."""
    found = scipy.optimize.minimize_scalar(
        lambda gamma: float(np.sum((level**gamma - light) ** 2)),
        bounds=(0.2, 5.0),
        method="bounded",
    )
    return float(found.x)


def _findings(level: FloatMap, light: FloatMap, saturated: float, contrast: float) -> list[Finding]:
    found = []
    top = level >= TOP
    below = (level >= 0.6) & (level <= TOP)
    slope = np.polyfit(level[below], light[below], 1)[0]
    rise = (light[top][-1] - light[top][0]) / (level[top][-1] - level[top][0])
    if rise < CLIPPED_SHARE * slope:
        found.append(_limited(float(rise / slope)))
    if saturated > MAX_SATURATED_SHARE:
        found.append(_saturated(saturated))
    if contrast < MIN_CONTRAST:
        found.append(_bright_room(contrast))
    return found


def _limited(rise_share: float) -> Finding:
    return Finding(
        "range",
        f"levels above {TOP:.0%} are no brighter than {TOP:.0%}",
        (
            "a video output or projector set to limited range (16 to 235)",
            "a picture mode of the projector that clips white",
        ),
        "set the output of the graphics card to full range (0 to 255) and the projector's "
        "picture mode to one for films or computers, with brightness and contrast in the "
        "middle",
        figures={"rise_share": rise_share},
    )


def _saturated(share: float) -> Finding:
    return Finding(
        "saturated",
        f"{share:.0%} of the lit pixels are at the camera's limit under white",
        ("an exposure or gain that is too high", "a shiny object"),
        "let the exposure be chosen automatically, or take several exposures",
        figures={"saturated_share": share},
    )


def _bright_room(contrast: float) -> Finding:
    return Finding(
        "room",
        f"white is only {contrast:.2g} times as bright as black",
        ("lamps or daylight in the room", "a projector that is too dim for it"),
        "darken the room, shade the object, or use a brighter projector",
        figures={"contrast": contrast},
    )
