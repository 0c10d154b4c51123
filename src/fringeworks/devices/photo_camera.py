"""Photo cameras on USB, through the program gphoto2."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np

from fringeworks.devices.folder_camera import whole_counts
from fringeworks.devices.pixel_formats import Channel
from fringeworks.devices.protocols import CameraLimits, Grab, TakenWhenAsked
from fringeworks.files.images import IMAGE_SUFFIXES
from fringeworks.types import CameraSettings, DeviceProblem, InputError, MissingPackage, Region

PROGRAM = "gphoto2"
"""Name of the program; it runs as a process of its own."""
DETECT = "--auto-detect"
"""What lists the cameras that are connected."""
ANSWER_S = 20.0
"""Longest wait for the program, s, beyond the exposure: a photograph of 50 megapixels takes 10 s
over USB 2."""
FARTHEST = 0.4
"""Largest distance of an exposure from the nearest one that the camera has, relative to it:
cameras have thirds of stops, 26 % apart."""
SHUTTER = "shutterspeed"
"""Name of the exposure among the program's settings."""


class PhotoCamera(TakenWhenAsked):
    """A photo camera that takes a picture when a frame is asked for.

    Parameters
    ----------
    port : str, optional
        The program's port, such as ``usb:001,004``; the first camera by default.
    channel : str
        What is made of frames in colour: luminance (BT.601), red, green or blue.

    Raises
    ------
    MissingPackage without the program; DeviceProblem where there is no camera.

    Notes
    -----
    Set the camera to manual exposure and focus, and to raw images: of raw and JPEG, the raw one is
    read. Every frame is exposed after it was asked for.
    """

    def __init__(self, port: str = "", *, channel: Channel = "luminance") -> None:
        self._channel = channel
        self._name = f"gphoto2 {port}".strip()
        _need_program()
        self._port = ["--port", port] if port else []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._exposure_ms: float | None = None
        self._colours = False
        self._name = self._model() or self._name
        self._folder = tempfile.TemporaryDirectory(prefix="fringeworks-photo-")
        self._exposure_ms = _milliseconds(self._setting(SHUTTER)[0])

    @property
    def name(self) -> str:
        """Model of the camera."""
        return self._name

    def limits(self) -> CameraLimits:
        """Frame size and exposures. Takes a photograph the first time, for the next ``grab``."""
        self._sized()
        assert self._size_px is not None
        times = [t for _, t in self._exposures()]
        exposures = (min(times), max(times)) if times else None
        return CameraLimits(*self._size_px, exposure_ms=exposures)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change the exposure to the nearest one that the camera has; see ``Camera.configure``.

        Raises
        ------
        InputError for other settings, and exposures far from all that the camera has; DeviceProblem
        where it is gone.
        """
        others = [
            name
            for name in settings.given()
            if name != "exposure_ms" and not (name == "triggered" and settings.triggered is False)
        ]
        if self._size_px is not None and settings.region == Region(0, 0, *self._size_px):
            others.remove("region")
        if others:
            raise InputError(
                f"{self.name}: {', '.join(others)}: expected no such setting; set it on the camera"
            )
        if settings.exposure_ms is not None:
            self._expose(settings.exposure_ms)
        region = None if self._size_px is None else Region(0, 0, *self._size_px)
        return CameraSettings(self._exposure_ms, None, region, None, False)

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        self._colours, self._ahead = wanted, None

    def _taken(self, timeout_s: float) -> Grab:
        del timeout_s  # The program has its own, which is longer.
        if self._folder is None:
            raise DeviceProblem(f"{self.name}: expected an open camera, got a closed one")
        place = Path(self._folder.name)
        pattern = str(place / f"{self._count:06d}.%C")
        self._run("--capture-image-and-download", "--force-overwrite", "--filename", pattern)
        taken = sorted(place.iterdir(), key=lambda path: path.suffix.lower() in IMAGE_SUFFIXES)
        if not taken:
            raise DeviceProblem(
                f"{self.name}: expected a photograph, got none: its card or its buffer may be full"
            )
        try:
            frame = whole_counts(taken[0], colours=self._colours, channel=self._channel)
        finally:
            for path in taken:
                path.unlink()
        self._size_px = frame.shape[1], frame.shape[0]
        return self._grabbed(np.ascontiguousarray(frame))

    def close(self) -> None:
        """Delete temporary files; again without effect."""
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _model(self) -> str:
        """Model by the program's list: a line of it and its port for each camera."""
        found = _ports(_answer(self._name, [DETECT], ANSWER_S))
        wanted = self._port[1] if self._port else None
        for port, model in found.items():
            if wanted is None or port == wanted:
                return model
        there = ", ".join(found) or "none"
        raise DeviceProblem(
            f"{self._name}: expected a camera that is connected, switched on and not mounted as a "
            f"disk, got none; ports of cameras found: {there}"
        )

    def _setting(self, name: str) -> tuple[str, list[str]]:
        """Present value of a setting, and its choices."""
        text = self._run("--get-config", name)
        present = re.search(r"^Current: (.*)$", text, re.M)
        return present[1].strip() if present else "", re.findall(r"^Choice: \d+ (.*)$", text, re.M)

    def _exposures(self) -> list[tuple[str, float]]:
        """The camera's words for exposures, and their times, ms."""
        times = [(word, _milliseconds(word)) for word in self._setting(SHUTTER)[1]]
        return [(word, time_ms) for word, time_ms in times if time_ms is not None]

    def _expose(self, exposure_ms: float) -> None:
        choices = self._exposures()
        word, nearest = min(choices, key=lambda c: abs(c[1] - exposure_ms), default=("", 0.0))
        if abs(nearest - exposure_ms) > FARTHEST * exposure_ms:
            low, high = (f(t for _, t in choices) if choices else 0.0 for f in (min, max))
            raise InputError(
                f"{self.name}: exposure_ms: expected about one of the camera's own, {low:g} to "
                f"{high:g}, got {exposure_ms:g}; set the camera to manual exposure (M)"
            )
        self._run("--set-config", f"{SHUTTER}={word}")
        self._exposure_ms = _milliseconds(self._setting(SHUTTER)[0])

    def _run(self, *words: str) -> str:
        """Output of the program."""
        wait_s = ANSWER_S + 1e-3 * (self._exposure_ms or 0.0)
        return _answer(self._name, [*self._port, "--quiet", *words], wait_s)


def photo_cameras() -> dict[str, str]:
    """Return the models of the cameras that are connected, by the program's ports.

    Raises
    ------
    MissingPackage without the program; DeviceProblem where it does not answer.
    """
    _need_program()
    return _ports(_answer(PROGRAM, [DETECT], ANSWER_S))


def _need_program() -> None:
    if shutil.which(PROGRAM) is None:
        raise MissingPackage(
            "a photo camera: expected the program gphoto2, got none; apt install gphoto2 "
            "(Debian, Ubuntu), brew install gphoto2 (macOS)"
        )


def _ports(text: str) -> dict[str, str]:
    """Models by their ports, from the program's list: a head of two lines, then a line each."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()[2:] if line.strip()]
    return {parts[-1]: parts[0] for parts in lines}


def _answer(name: str, words: list[str], wait_s: float) -> str:
    """Output of the program for a camera."""
    try:
        # With another language, other words would be printed.
        done = subprocess.run(
            [PROGRAM, *words], capture_output=True, text=True, timeout=wait_s, check=False,
            env={**os.environ, "LC_ALL": "C"}, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise DeviceProblem(
            f"{name}: expected an answer of gphoto2 within {wait_s:g} s, got none: switch the "
            "camera off and on"
        ) from error
    if done.returncode:
        lines = [line.strip("* ") for line in done.stderr.splitlines() if line.strip("* ")]
        lines = [line for line in lines if "rror" in line] or [*lines, "nothing"]
        raise DeviceProblem(
            f"{name}: expected a camera that is connected and switched on, got: {lines[0]}; "
            "connect it and resume"
        )
    return done.stdout


def _milliseconds(word: str) -> float | None:
    """An exposure as cameras write it, such as 1/60, 0.5, 1.3s or 30; None for words as bulb."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?(?:/\d+(?:\.\d+)?)?)\s*s?", word.strip())
    if match is None:
        return None
    top, _, bottom = match[1].partition("/")
    if bottom and not float(bottom):
        return None
    return 1e3 * float(Fraction(top) / Fraction(bottom or "1")) or None
