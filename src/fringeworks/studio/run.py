"""Starts the studio, where its packages are installed."""

from __future__ import annotations

from importlib import import_module

from fringeworks.files.atomic import StrPath
from fringeworks.types import MissingPackage


def run_studio(
    folder: StrPath = ".", *, host: str | None = None, port: int | None = None, show: bool = True
) -> None:
    """Serve the studio of a folder until it is interrupted.

    Parameters
    ----------
    folder : path
        Made where it is missing. Only this folder is read and written.
    host : str, optional
        Address to serve other machines on. A token is then made, and the printed address holds it.
        By default only this machine is served.
    port : int, optional
        8137 by default, or a free one where that is in use.
    show : bool
        Open the page in the browser.

    Raises
    ------
    MissingPackage where the extra ``studio`` is not installed; FileProblem where the folder cannot
    be used; DeviceProblem where the address cannot.
    """
    try:
        for needed in ("cv2", "matplotlib"):
            import_module(needed)
        from fringeworks.studio.server import serve
    except ModuleNotFoundError as error:
        name = error.name or "nicegui"
        raise MissingPackage(
            f"studio: expected the package {PACKAGES.get(name, name)}, got none: {INSTALL}"
        ) from error
    serve(folder, host=host, port=port, show=show)


PACKAGES = {"cv2": "opencv-python-headless"}
"""Names of packages whose modules are called otherwise."""
INSTALL = "pip install 'fringeworks[studio]'"
"""How the packages of the studio are installed."""
