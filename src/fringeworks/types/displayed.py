"""What results show of themselves: pictures and profiles, by rooms that are loaded on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from fringeworks.types.profile import Line, Profile

DISPLAY = "fringeworks.report.display"
"""Module that shows results. It is loaded by name when a result is shown, because a type may not
import the rooms behind its own."""


class Display(Protocol):
    """What that module has."""

    def plot(
        self, result: object, name: str | None = None, *, panel: str = "", title: bool = True
    ) -> Figure:
        """Draw a result as one picture."""

    def show(self, result: object, *, every: int = 1) -> Path:
        """Open the report of a result in the browser."""

    def html_of(self, result: object) -> str | None:
        """A surface to turn, for notebooks."""

    def png_of(self, result: object) -> bytes | None:
        """The picture of a result, for notebooks."""

    def profile(self, result: object, line: Line, *, level: bool = False) -> Profile:
        """Sample a map along a line."""


def _display() -> Display:
    return cast("Display", import_module(DISPLAY))


class Plotted:
    """A result that draws itself."""

    def plot(self, name: str | None = None, *, panel: str = "", title: bool = True) -> Figure:
        """Draw the result as one picture, with units, standard deviations and reasons.

        Parameters
        ----------
        name : str, optional
            Name of the object or capture, put before the title, which says what is shown.
        panel : str
            Draw this map alone, such as "height", "depth", "sigma" or "reasons"; all by default.
        title : bool
            False: without titles and findings, for papers; scales then name their quantities.

        Returns
        -------
        matplotlib Figure. Notebooks show it; ``figure.savefig`` or ``fringeworks.save_figure``
        write it to a file.

        Raises
        ------
        InputError for a panel that the picture does not have; MissingPackage where the package
        ``matplotlib`` (the extra "plots") is not installed.

        Examples
        --------
        >>> import fringeworks as fw
        >>> scene = fw.simulate.standard_scene("parabola", size=100, fringes=8)
        >>> figure = fw.reconstruct(scene, "fourier").surface.plot()
        >>> [axes.get_title() for axes in figure.axes if axes.get_title()]
        ['height', 'standard deviation σ', 'measured, or why not']
        """
        return _display().plot(self, name, panel=panel, title=title)

    def show(self, *, every: int = 1) -> Path:
        """Open the report of the result in the browser: surfaces to turn, maps, figures, findings.

        Parameters
        ----------
        every : int
            Show every k-th column and row only, for frames of more than 8 million pixels.

        Returns
        -------
        The temporary file; ``fringeworks.write_report`` writes one to keep.

        Raises
        ------
        MissingPackage where the package ``matplotlib`` (the extra "plots") is not installed.
        """
        return _display().show(self, every=every)

    def _repr_html_(self) -> str | None:
        """Notebooks show surfaces to turn, in a frame."""
        return _display().html_of(self)

    def _repr_png_(self) -> bytes | None:
        """Notebooks that show no frames, and results that are no surfaces, get the picture. Without
        the extra ``plots``, they show text."""
        return _display().png_of(self)


class Sectioned(Plotted):
    """A map that draws itself and can be sampled along a line."""

    def profile(self, line: Line, *, level: bool = False) -> Profile:
        """Sample the map along a straight line of its pixels.

        Parameters
        ----------
        line : ((x0, y0), (x1, y1))
            Column and row of the first and the last pixel, whole numbers.
        level : bool
            Count heights over the straight line in space from the first to the last measured
            sample, and distances along it, as a ruler laid on the surface does. For points, and for
            heights with a known pitch.

        Returns
        -------
        Profile with one sample per column or row, whichever are more. A sample is the pixel nearest
        to the line: nothing is interpolated, so a sample never mixes the two sides of a cliff, and
        its σ and reason are those of the pixel.

        Raises
        ------
        InputError for pixels outside the map, one pixel twice, and a line that cannot be levelled.

        Examples
        --------
        >>> import fringeworks as fw
        >>> scene = fw.simulate.standard_scene("parabola", size=100, fringes=8)
        >>> found = fw.reconstruct(scene, "fourier").surface.profile(((10, 50), (90, 50)))
        >>> found.values.shape, round(float(found.along_mm[-1]))
        ((81,), 800)
        """
        return _display().profile(self, line, level=level)
