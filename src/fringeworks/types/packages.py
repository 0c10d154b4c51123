"""OpenCV, which not every install has: what needs it says so before it works."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fringeworks.types.errors import MissingPackage

if TYPE_CHECKING:
    import cv2
else:

    class _OpenCV:
        """The module ``cv2``, loaded when its first name is used."""

        def __getattr__(self, name: str) -> Any:
            if name.startswith("__"):
                raise AttributeError(name)
            need_opencv("this step")
            return getattr(import_module("cv2"), name)

    cv2 = _OpenCV()

__all__ = ["cv2", "need_opencv"]


def need_opencv(what: str) -> None:
    """Refuse what needs OpenCV where it is not installed.

    Parameters
    ----------
    what : str
        What needs it, for the message.

    Raises
    ------
    MissingPackage where the package ``opencv-python-headless`` (the extra "calibration") is not
    installed.
    """
    try:
        import_module("cv2")
    except ModuleNotFoundError as error:
        raise MissingPackage(
            f"{what}: expected the package opencv-python-headless, got none; "
            "pip install 'fringeworks[calibration]'"
        ) from error
