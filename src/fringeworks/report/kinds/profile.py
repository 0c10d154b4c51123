"""What is shown of a profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fringeworks.report.kind import Kind, describe
from fringeworks.report.sheets import titled
from fringeworks.types import Profile

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure


def picture(profile: Profile, name: str | None) -> Figure:
    """Values along the line, with their error band."""
    from fringeworks.report.profile_picture import profile_picture  # which needs Matplotlib

    (x0, y0), (x1, y1) = profile.pixels[0], profile.pixels[-1]
    title = f"{profile.quantity} from pixel ({x0}, {y0}) to pixel ({x1}, {y1})"
    return profile_picture(titled(name, title[0].upper() + title[1:]), profile)


describe(Profile, Kind(picture=picture))
