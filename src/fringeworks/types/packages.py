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

__all__ = ["cv2", "need_opencv", "opencv_conflict"]

OPENCV_PACKAGES = (
    "opencv-python-headless",
    "opencv-contrib-python-headless",
    "opencv-python",
    "opencv-contrib-python",
)
"""Packages that install OpenCV as the module ``cv2``, into the same folder. Any one of them serves.
The first is what the extra "calibration" installs."""
NEEDED = "calibrateCamera"
"""A function of OpenCV's module ``calib3d``. It is missing where ``cv2`` is what an uninstalled
package left behind, and Python takes the remaining folder for a module without content."""


def need_opencv(what: str) -> None:
    """Refuse what needs OpenCV where it is not installed, or where packages damaged each other.

    Parameters
    ----------
    what : str
        What needs it, for the message.

    Raises
    ------
    MissingPackage where no package brings the module ``cv2`` (the extra "calibration" installs
    one), or where that module cannot be used.
    """
    try:
        module = import_module("cv2")
    except ModuleNotFoundError as error:
        if conflict := opencv_conflict():
            raise MissingPackage(f"{what}: {conflict}") from error
        raise MissingPackage(
            f"{what}: expected the package opencv-python-headless, got none; "
            "pip install 'fringeworks[calibration]'"
        ) from error
    except ImportError as error:
        reason = opencv_conflict() or f"OpenCV is installed but cannot be loaded: {error}"
        raise MissingPackage(f"{what}: {reason}") from error
    if not hasattr(module, NEEDED):
        raise MissingPackage(f"{what}: {opencv_conflict() or _remains()}")


def opencv_conflict() -> str | None:
    """Name packages of OpenCV that overwrite each other's files.

    Returns
    -------
    str or None
        A sentence where two or more are installed; None otherwise.
    """
    found = {name: version for name in OPENCV_PACKAGES if (version := _version(name))}
    if len(found) < 2:
        return None
    kept = list(found)[-1]
    listed = " and ".join(f"{name} {version}" for name, version in found.items())
    return (
        f"{listed} are installed and overwrite each other's module cv2; keep one: "
        f"pip uninstall {' '.join(found)}, then pip install {kept}"
    )


def _version(name: str) -> str | None:
    """Version of an installed distribution."""
    # Asked where something is wrong: the module takes longer to load than all of this package.
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _remains() -> str:
    """What to do where ``cv2`` is a folder without OpenCV in it."""
    installed = next((name for name in OPENCV_PACKAGES if _version(name)), OPENCV_PACKAGES[0])
    return (
        "the module cv2 has no content, as after a second package of OpenCV was uninstalled; "
        f"pip install --force-reinstall --no-deps {installed}"
    )
