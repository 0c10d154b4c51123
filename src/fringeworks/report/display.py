"""What results show of themselves, called by ``types/displayed.py``: pictures, pages, profiles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fringeworks.report.kind import kind_of
from fringeworks.report.sheets import Sheet
from fringeworks.types import InputError, Line, Profile

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure


def plot(result: object, name: str | None = None, *, panel: str = "", title: bool = True) -> Figure:
    """Draw a result as one picture.

    Parameters
    ----------
    result : HeightMap, PointCloud, DisplacementMap, CoordinateMap, Decoded, WrappedPhase,
        LightSeparation, Profile, PatternPlan, Calibration, CaptureComparison, Deviation,
        Reconstruction, Measurement, MultiMeasurement or SetupTests
    name : str, optional
        Name of the object or capture, put before the title.
    panel : str
        Draw this map alone; all by default.
    title : bool
        Whether titles and findings are drawn.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    InputError for anything else, and a panel that there is not; MissingPackage without the extra
    ``plots``.
    """
    from fringeworks.report.drawing import need_plots  # Matplotlib, for those only who draw

    need_plots("a picture")
    picture = kind_of(result).picture
    if picture is None:
        what = f"{name}: " if name else ""
        raise InputError(f"{what}expected a result of fringeworks, got {type(result).__name__}")
    drawn = picture(result, name)
    if not isinstance(drawn, Sheet):
        if panel or not title:
            kind = type(result).__name__
            raise InputError(f"panel: expected a result that is shown as maps, got {kind}")
        return drawn
    from fringeworks.report.maps import draw_sheet

    if panel:
        drawn = replace(drawn, panels=[drawn.panel(panel)], columns=1)
    return draw_sheet(drawn if title else drawn.untitled())


def maps_of(result: Any) -> Figure:
    """Draw a result for a report: cropped to what was measured, without what the report says."""
    picture = kind_of(result).picture
    drawn = None if picture is None else picture(result, None)
    if not isinstance(drawn, Sheet):
        return plot(result)
    from fringeworks.report.maps import draw_sheet
    from fringeworks.report.windows import window_of

    reason: Any = getattr(result, "reason", None)
    window = window_of(reason) if getattr(reason, "ndim", 0) == 2 else None
    return draw_sheet(replace(drawn, title="", facts="", findings=(), window=window))


def show(result: object, *, every: int = 1) -> Path:
    """Open the report of a result in the browser; see ``Plotted.show``."""
    from fringeworks.report.interactive import show

    return show(result, every=every)


def html_of(result: object) -> str | None:
    """A surface to turn, for notebooks; None for other results."""
    from fringeworks.report.interactive import repr_html

    return repr_html(result)


def png_of(result: object) -> bytes | None:
    """The picture of a result, for notebooks; None without the extra ``plots``."""
    from fringeworks.report.drawing import plots_installed

    if not plots_installed():
        return None
    picture: bytes = plot(result)._repr_png_()  # type: ignore[attr-defined]
    return picture


def profile(result: Any, line: Line, *, level: bool = False) -> Profile:
    """Sample a map along a line; see ``Sectioned.profile``."""
    from fringeworks.surface.section import profile

    return profile(result, line, level=level)
