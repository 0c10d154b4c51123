"""A camera with its maker's own library, as a kind of camera that every command can open.

Try it, without the camera and without a projector:

    python examples/vendor_camera.py capture

Or let the command line open it: ``fringeworks --plugin examples/vendor_camera.py …``, with
``acme:SN1`` as the camera. For a camera of your own, replace ``AcmeLibrary`` by ``import`` of its
maker's library, and the calls in ``AcmeCamera`` by those that it has.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from fringeworks import DeviceProblem, PatternPlan, capture
from fringeworks.devices import (
    CameraLimits,
    CameraSettings,
    Grab,
    ListedDevice,
    Region,
    camera_kind,
    open_camera,
)
from fringeworks.devices.protocols import Closing
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.simulate import bust, look, standard_rig


class AcmeCamera(Closing):
    """A camera of the maker Acme."""

    def __init__(self, serial: str) -> None:
        self.name = f"Acme {serial}"
        self._device = AcmeLibrary.connect(serial)
        if self._device is None:
            raise DeviceProblem(f"{self.name}: expected a camera that is connected, got none")

    def limits(self) -> CameraLimits:
        """What the camera can be set to."""
        return CameraLimits(*self._device.sensor_size(), exposure_ms=(0.02, 1000.0))

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings, and return what the camera has."""
        if settings.exposure_ms is not None:
            self._device.set_exposure_us(1e3 * settings.exposure_ms)
        # What is not listed here cannot be set. Report what the camera says, not what was asked.
        return CameraSettings(
            exposure_ms=1e-3 * self._device.exposure_us(),
            region=Region(0, 0, *self._device.sensor_size()),
            pixel_format="Mono8",
            triggered=False,
        )

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet, or wait for one."""
        frame = self._device.next_frame(timeout_ms=1e3 * timeout_s)
        if frame is None:
            raise DeviceProblem(f"{self.name}: expected a frame, got none in {timeout_s:g} s")
        pixels, counter, broken = frame
        return Grab(pixels, time.monotonic(), number=counter, complete=not broken)

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""
        return self._device.queued()

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        self._device.flush()

    def close(self) -> None:
        """Release the camera; again without effect."""
        self._device.disconnect()


def find_acme() -> list[ListedDevice]:
    """The cameras that ``list_devices`` shows."""
    return [ListedDevice(f"acme:{serial}", f"Acme {serial}") for serial in AcmeLibrary.serials]


@camera_kind("acme", find=find_acme)
def open_acme(serial: str) -> AcmeCamera:
    """``acme:SERIAL``: a camera of the maker Acme."""
    return AcmeCamera(serial)


# From here on: what stands for the maker's library, the projector and the object.

PROJECTOR = VirtualProjector(ProjectorModel(width_px=192, height_px=120))
"""The projector that the camera looks at."""


class AcmeLibrary:
    """A made-up library. Behind it is a virtual camera that looks at the virtual rig."""

    serials = ("SN1",)

    @classmethod
    def connect(cls, serial: str) -> AcmeLibrary | None:
        """Return a camera, or None where there is none of this serial number."""
        return cls() if serial in cls.serials else None

    def __init__(self) -> None:
        self._camera = VirtualCamera(RigScene(look(standard_rig(scale=0.1), bust())), PROJECTOR)

    def sensor_size(self) -> tuple[int, int]:
        """Columns and rows."""
        limits = self._camera.limits()
        return limits.width_px, limits.height_px

    def set_exposure_us(self, value: float) -> None:
        """Set the exposure."""
        self._camera.configure(CameraSettings(exposure_ms=1e-3 * value))

    def exposure_us(self) -> float:
        """The exposure that the camera has."""
        return 1e3 * (self._camera.configure(CameraSettings()).exposure_ms or 0.0)

    def next_frame(self, timeout_ms: float) -> tuple[np.ndarray, int, bool] | None:
        """Pixels, number, and whether a part is missing."""
        try:
            grab = self._camera.grab(1e-3 * timeout_ms)
        except DeviceProblem:
            return None
        return grab.pixels, grab.number or 0, not grab.complete

    def queued(self) -> int:
        """Number of frames in the library's queue."""
        return self._camera.waiting()

    def flush(self) -> None:
        """Empty the queue."""
        self._camera.discard()

    def disconnect(self) -> None:
        """Let go of the camera."""
        self._camera.close()


def main(folder: str) -> None:
    """Capture a plan with the vendor's camera."""
    plan = PatternPlan(
        192, 120, tuple(PhaseSteps("x", period, equal_steps(4)) for period in (16.0, 18.0, 20.0))
    )
    with open_camera("acme:SN1") as camera:
        capture(
            PROJECTOR,
            camera,
            plan,
            folder,
            settings=CameraSettings(exposure_ms=16.667),
            progress=print,
        )


if __name__ == "__main__":
    main(sys.argv[1])
