"""What the camera does to its frames before they arrive: averaging over time, and compression."""

from __future__ import annotations

from fringeworks.scan.frame_noise import FrameNoise
from fringeworks.types import Finding

MAX_UNEVEN = 5.0
"""Variance of the noise where it is largest, over the usual one, up to which frames are not
compressed. Rounding alone makes up to 2.5 of it, JPEG of quality 95 3 to 7, and 85 more than 8."""


def check_frames(noise: FrameNoise) -> tuple[Finding, ...]:
    """Return findings where frames hold parts of earlier ones, or are compressed.

    Parameters
    ----------
    noise : FrameNoise
        From ``Agreement``.
    """
    found = []
    if noise.waited_frames:
        found.append(
            Finding(
                "averaged",
                f"every frame keeps {noise.kept:.0%} of the one before, so that scans wait for "
                f"{noise.waited_frames} more frames of each picture",
                ("noise reduction over time in the camera", "a projector that is slow to change"),
                "switch off noise reduction and low-light modes of the camera",
                figures={"kept_share": noise.kept, "waited_frames": float(noise.waited_frames)},
            )
        )
    if noise.uneven > MAX_UNEVEN:
        found.append(
            Finding(
                "compressed",
                f"the variance of the noise beside edges is {noise.uneven:.0f} times that "
                "elsewhere",
                ("frames that the camera compresses (MJPEG)", "sharpening or noise reduction"),
                "choose a pixel format without compression, with a smaller frame or a lower frame "
                "rate if need be, and switch off sharpening",
                figures={"uneven": noise.uneven},
            )
        )
    return tuple(found)
