"""Starts the service, where its packages are installed."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.types import InputError, MissingPackage

INSTALL = "pip install 'fringeworks[service]'"
"""How the packages of the service are installed."""


def run_service(
    folder: StrPath,
    rig: StrPath,
    *,
    setup: StrPath | None = None,
    projector: str | None = None,
    camera: str | None = None,
    plan: StrPath | None = None,
    host: str | None = None,
    port: int | None = None,
    queue: int = 8,
    keep: int = 1000,
) -> None:
    """Serve scans over HTTP until it is interrupted.

    Parameters
    ----------
    folder : path
        Made where it is missing. Holds the queue, the results, the recipes and the token.
    rig : path
        Rig file of ``calibrate``, or of ``hand_eye`` for points in the robot's base.
    setup : path, optional
        Set-up file: devices, settings, delay and plan.
    projector, camera : str, optional
        Words as for ``open_devices``, in place of the set-up's.
    plan : path, optional
        Plan to show; by default that of the projector's memory or of the set-up.
    host : str, optional
        Address to serve other machines on. By default only this machine is served.
    port : int, optional
        8138 by default, or a free one where that is in use.
    queue : int
        Largest number of scans that wait; further ones are refused.
    keep : int
        Number of results that are kept; older ones are deleted.

    Raises
    ------
    MissingPackage where the extra ``service`` is not installed; FileProblem for a folder that
    cannot be used, and for a rig, set-up or plan that cannot be read; InputError where no devices
    are named; DeviceProblem where the address cannot be used.
    """
    if setup is None and (projector is None or camera is None):
        raise InputError("devices: expected a projector and a camera, or a set-up; got neither")
    try:
        for needed in ("fastapi", "uvicorn", "websockets", "cv2"):
            import_module(needed)
        from fringeworks.service.server import serve
    except ModuleNotFoundError as error:
        name = error.name or "fastapi"
        raise MissingPackage(
            f"service: expected the package {PACKAGES.get(name, name)}, got none: {INSTALL}"
        ) from error
    from fringeworks.pair.plugins import loaded_plugins
    from fringeworks.service.scanner import Scanner

    paths = [None if one is None else Path(os.path.abspath(one)) for one in (rig, setup, plan)]
    assert paths[0] is not None
    scanner = Scanner(paths[0], paths[1], projector, camera, paths[2], tuple(loaded_plugins()))
    serve(folder, scanner, host=host, port=port, queue=queue, keep=keep)


PACKAGES = {"cv2": "opencv-python-headless"}
"""Names of packages whose modules are called otherwise."""
