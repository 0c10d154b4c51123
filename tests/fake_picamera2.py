"""The library picamera2 as far as cameras need it: settings arrive some frames later."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import numpy as np

LAG = 5
"""Frames until a control has arrived."""


def library(frame, shape=(96, 128), period_s=0.01):
    """A module whose one camera sees ``frame(exposure_us, gain)``, counts (h, w)."""

    # Blue, green and red of the light: the format RGB888 has blue first in memory.
    state = SimpleNamespace(
        tint=(1.0, 1.0, 1.0), gone=threading.Event(), obeys=True, opened=[], cameras=[]
    )

    class Request:
        def __init__(self, exposure, gain):
            light = frame(exposure, gain)[..., None] * np.array(state.tint)
            self._image = np.clip(light, 0, 255).astype(np.uint8)
            self._metadata = {"ExposureTime": exposure, "AnalogueGain": gain, "SensorTimestamp": 1}
            self.released = False

        def make_array(self, name):
            assert name == "main"
            return self._image

        def get_metadata(self):
            return self._metadata

        def release(self):
            self.released = True

    class Picamera2:
        sensor_resolution = shape[::-1]
        camera_controls = {"ExposureTime": (60, 700_000, 20_000), "AnalogueGain": (1.0, 16.0, 1.0)}  # noqa: RUF012

        def __init__(self, number):
            state.opened.append(number)
            state.cameras.append(self)
            self.started, self.configured = False, None
            self._queue = [(20_000, 1.0)] * LAG

        @staticmethod
        def global_camera_info():
            return [{"Model": "imx477", "Num": 0}]

        def create_video_configuration(self, **options):
            return options

        def configure(self, configured):
            assert configured["main"]["format"] == "RGB888"
            self.configured = configured

        def start(self):
            self.started = True

        def set_controls(self, asked):
            exposure, gain = self._queue[-1]
            if state.obeys:
                new = asked.get("ExposureTime", exposure), asked.get("AnalogueGain", gain)
                # Sensors count lines.
                self._queue[-1] = (round(new[0] / 20) * 20, new[1])

        def capture_request(self, wait=True):
            assert self.started
            assert not wait
            return object()

        def wait(self, job, timeout):
            del job
            if state.gone.is_set():
                time.sleep(timeout)
                raise TimeoutError
            time.sleep(period_s)
            used = self._queue[0]
            self._queue = [*self._queue[1:], self._queue[-1]]
            return Request(*used)

        def stop(self):
            self.started = False

        def close(self):
            state.closed = True

    return SimpleNamespace(Picamera2=Picamera2), state
