"""The names of Matplotlib that pictures are made of, and the refusal where it is not installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from fringeworks.types import MissingPackage

__all__ = [
    "Affine2D",
    "Axes",
    "AxesImage",
    "BoundaryNorm",
    "Figure",
    "FontProperties",
    "Line2D",
    "ListedColormap",
    "Outline",
    "Patch",
    "PathPatch",
    "Rectangle",
    "TextPath",
    "need_plots",
    "plots_installed",
    "rc_context",
    "to_rgba",
]


def need_plots(what: str) -> None:
    """Refuse what draws where Matplotlib is not installed.

    Parameters
    ----------
    what : str
        What draws, for the message.

    Raises
    ------
    MissingPackage where the package ``matplotlib`` (the extra "plots") is not installed.
    """
    if not plots_installed():
        raise MissingPackage(
            f"{what}: expected the package matplotlib, got none; pip install 'fringeworks[plots]'"
        )


def plots_installed() -> bool:
    """Whether Matplotlib is installed."""
    try:
        import_module("matplotlib")
    except ModuleNotFoundError:
        return False
    return True


class _Missing(type):
    """Kind of the stand-ins: every use of one is refused."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        need_plots("a picture")

    def __call__(cls, *_: Any, **__: Any) -> Any:
        need_plots("a picture")


try:
    from matplotlib import rc_context
    from matplotlib.axes import Axes
    from matplotlib.colors import BoundaryNorm, ListedColormap, to_rgba
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, PathPatch, Rectangle
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath
    from matplotlib.transforms import Affine2D
except ModuleNotFoundError:
    # Modules of pictures load without it, because results name the types of pictures.
    for _name in set(__all__) - {"need_plots", "plots_installed"}:
        globals()[_name] = _Missing(_name, (), {})
