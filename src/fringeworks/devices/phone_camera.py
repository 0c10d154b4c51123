"""A phone as a camera: its browser shows a page of the studio, which takes a picture when asked."""

from __future__ import annotations

import io
import json
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fringeworks.devices.http_camera import grey_of
from fringeworks.devices.protocols import CameraLimits, Grab, TakenWhenAsked
from fringeworks.types import CameraSettings, DeviceProblem, InputError, Region

RENDEZVOUS = "phone.json"
"""File in the studio's folder with the address and the key of the studio's side. Only its owner may
read it, and it is there while a studio runs that a phone has joined."""
FORMAT = "Mono8"
"""Pixel format of all frames: JPEG has 8 bits per colour."""
ANSWER_S = 5.0
"""Longest wait for the studio beyond the time that it gives the phone, s."""
TAKE_S = 20.0
"""Longest time for a picture, s: phones take about one second for a full-resolution still, and up
to ten to send it over a weak network."""
OPEN_PAGE = "open the studio's page /phone on it"
"""What to do where no phone is there."""


class PhoneCamera(TakenWhenAsked):
    """A phone whose browser shows the page ``/phone`` of a studio.

    Parameters
    ----------
    folder : str
        The studio's folder.

    Raises
    ------
    DeviceProblem where no studio runs there, or no phone shows its page.

    Notes
    -----
    Every frame is exposed after it was asked for. Exposure, focus and white balance are locked as
    far as the phone's browser allows.
    """

    def __init__(self, folder: str) -> None:
        self._name = "phone"
        self._link: Connection | None = None
        self._link = _connected(folder)
        try:
            told = self._asked({"what": "state"})[0]
        except BaseException:
            self.close()
            raise
        self._name = f"phone {told['name']}".strip()
        self._exposures_ms: list[float] | None = told.get("exposures_ms")

    @property
    def name(self) -> str:
        """Name of the phone's camera."""
        return self._name

    def limits(self) -> CameraLimits:
        """Frame size and exposures. Takes a picture the first time, for the next ``grab``."""
        self._sized()
        assert self._size_px is not None
        exposures = None if self._exposures_ms is None else tuple(self._exposures_ms)
        return CameraLimits(*self._size_px, exposure_ms=exposures, pixel_formats=(FORMAT,))  # type: ignore[arg-type]

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change the exposure, where the phone's browser allows that; see ``Camera.configure``.

        Raises
        ------
        InputError for other settings; DeviceProblem where the phone is gone.
        """
        wanted = set(settings.given()) - {"exposure_ms"}
        if settings.triggered is False:
            wanted.discard("triggered")
        if settings.pixel_format == FORMAT:
            wanted.discard("pixel_format")
        if self._size_px is not None and settings.region == Region(0, 0, *self._size_px):
            wanted.discard("region")
        if settings.exposure_ms is not None and self._exposures_ms is None:
            wanted.add("exposure_ms")
        if wanted:
            raise InputError(
                f"{self.name}: {', '.join(sorted(wanted))}: expected no such setting; this phone's "
                "browser does not offer it"
            )
        order = {"what": "settings", "exposure_ms": settings.exposure_ms}
        used = self._asked(order)[0].get("exposure_ms")
        region = None if self._size_px is None else Region(0, 0, *self._size_px)
        return CameraSettings(used, None, region, FORMAT, False)

    def _taken(self, timeout_s: float) -> Grab:
        order = {"what": "take", "timeout_s": max(timeout_s, TAKE_S)}
        _, content = self._asked(order)
        image = _decoded(content)
        if image is None or (self._size_px and image.shape != self._size_px[::-1]):
            # A phone that is turned sends pictures of another shape.
            shape = self._size_px[::-1] if self._size_px else (1, 1)
            return self._grabbed(np.zeros(shape, np.uint8), False)
        self._size_px = image.shape[1], image.shape[0]
        return self._grabbed(image)

    def close(self) -> None:
        """Leave the phone to others; again without effect."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _asked(self, order: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """The studio's answer, and the picture that comes with it."""
        if self._link is None:
            raise DeviceProblem(f"{self._name}: expected an open camera, got a closed one")
        wait_s = ANSWER_S + order.get("timeout_s", TAKE_S)
        try:
            self._link.send_bytes(json.dumps(order).encode())
            if not self._link.poll(wait_s):
                raise DeviceProblem(f"{self._name}: expected an answer of the studio, got none")
            answer = json.loads(self._link.recv_bytes())
            content = self._link.recv_bytes() if answer.get("bytes") else b""
        except (OSError, EOFError) as error:
            raise DeviceProblem(
                f"{self._name}: expected a studio that runs, got none; start it and resume"
            ) from error
        if "problem" in answer:
            raise DeviceProblem(f"{self._name}: {answer['problem']}")
        return answer, content


def _connected(folder: str) -> Connection:
    """The connection to the studio of a folder."""
    try:
        found = json.loads((Path(folder) / RENDEZVOUS).read_text(encoding="utf-8"))
        return Client(found["address"], found["family"], bytes.fromhex(found["key"]))
    except (OSError, EOFError, ValueError, KeyError, TypeError, AuthenticationError) as error:
        raise DeviceProblem(
            f"phone: expected a studio that runs in {folder} and a phone that has joined it, got "
            f"none; start fringeworks studio {folder} and {OPEN_PAGE}"
        ) from error


def _decoded(content: bytes) -> NDArray[np.uint8] | None:
    """A picture in grey, as the sensor saw it; None for what is no picture."""
    try:
        with Image.open(io.BytesIO(content), formats=("JPEG", "PNG")) as image:
            return grey_of(np.asarray(image.convert("RGB")))
    except (OSError, ValueError, SyntaxError):
        return None
