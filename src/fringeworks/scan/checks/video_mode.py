"""What the system tells of the screen that the projector is."""

from __future__ import annotations

from fringeworks.devices.protocols import VideoMode
from fringeworks.types import Finding


def check_video_mode(mode: VideoMode | None) -> tuple[Finding, ...]:
    """Return a finding where the system changes the pictures before they leave the computer.

    A mode that is smaller than the largest one is no finding: some projectors offer modes beyond
    their own resolution. Whether pictures are resized is seen by the stripes.
    """
    if mode is None or mode.straight is not False:
        return ()
    return (
        Finding(
            "ramp",
            "the gamma ramp of the graphics card is not a straight line, which changes all levels",
            ("a colour profile", "a night light or a program that warms colours"),
            "switch off colour profiles and night light for the projector's screen",
        ),
    )
