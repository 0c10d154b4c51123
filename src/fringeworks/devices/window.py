"""A projector that is a screen: a full-screen window that shows every pixel exactly."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Closing, VideoMode, checked_picture
from fringeworks.patterns.plan import COLOURS
from fringeworks.types import DeviceProblem, MissingPackage

VERTICES = """#version 330
void main() {
    vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}"""
"""One triangle that covers the screen."""
PIXELS = """#version 330
uniform usampler2D picture;
out vec4 colour;
void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    int rows = textureSize(picture, 0).y;
    vec3 value = vec3(texelFetch(picture, ivec2(place.x, rows - 1 - place.y), 0).rgb) / 255.0;
    colour = vec4(value, 1.0);
}"""
"""Reads the texel of every pixel as a whole number: nothing is interpolated or corrected."""
LINEAR_RAMP = 0.004
"""Largest deviation of a screen's gamma ramp from a straight line that counts as none, share of
full scale: one count of 8 bit."""


@dataclass(frozen=True)
class Monitor:
    """A screen that is connected to this computer."""

    index: int
    """Number of the screen, from 0."""
    name: str
    """Name that the system gives it."""
    width_px: int
    """Columns of its present video mode."""
    height_px: int
    """Rows of its present video mode."""
    refresh_hz: float | None
    """Pictures per second; None where the system does not tell."""
    scale: float
    """Factor by which the system enlarges windows; 1 for none."""
    primary: bool
    """Whether it is the main screen."""

    def __str__(self) -> str:
        hertz = "" if self.refresh_hz is None else f", {self.refresh_hz:g} Hz"
        scale = "" if self.scale == 1.0 else f", scaled by {self.scale:g}"
        main = ", main screen" if self.primary else ""
        size = f"{self.width_px} × {self.height_px} px"
        return f"{self.index}: {self.name}, {size}{hertz}{scale}{main}"


def monitors() -> list[Monitor]:
    """Return the screens that are connected.

    Raises
    ------
    MissingPackage without the packages of the extra ``capture``; DeviceProblem where there is no
    display server.
    """
    glfw = _library()
    primary = glfw.get_monitor_name(glfw.get_primary_monitor())
    return [
        _described(glfw, index, monitor, glfw.get_monitor_name(monitor) == primary)
        for index, monitor in enumerate(glfw.get_monitors())
    ]


class WindowProjector(Closing):
    """Shows pictures on a screen, full screen, without interpolation or colour correction.

    Parameters
    ----------
    monitor : str or int, optional
        Name or number of the screen. By default the screen that is not the main one, if there is
        exactly one such screen, and otherwise the only screen.

    Raises
    ------
    MissingPackage without the packages of the extra ``capture``; DeviceProblem for an unknown
    screen, for one whose pictures the system would resize, and where there is no display server.

    Notes
    -----
    Must be made and used in the main thread. The screen saver is held off while the window is open.
    The screen's gamma ramp is read (``straight``), never changed.
    """

    def __init__(self, monitor: str | int | None = None) -> None:
        self._glfw = glfw = _library()
        self.monitor = chosen_monitor(monitors(), monitor)
        handle = glfw.get_monitors()[self.monitor.index]
        self.straight = _straight_ramp(glfw, handle)
        """Whether the screen's gamma ramp is a straight line; None where it cannot be read."""
        self._largest_px = _largest_mode(glfw, handle)
        size = self.monitor.width_px, self.monitor.height_px
        for hint, value in (
            (glfw.CONTEXT_VERSION_MAJOR, 3),
            (glfw.CONTEXT_VERSION_MINOR, 3),
            (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE),
            (glfw.OPENGL_FORWARD_COMPAT, True),
            (glfw.DECORATED, False),
            (glfw.AUTO_ICONIFY, False),
            (glfw.SRGB_CAPABLE, False),
        ):
            glfw.window_hint(hint, value)
        if self.monitor.refresh_hz is not None:
            glfw.window_hint(glfw.REFRESH_RATE, int(self.monitor.refresh_hz))
        self._window = glfw.create_window(*size, "fringeworks", handle, None)
        if not self._window:
            raise DeviceProblem(
                f"screen {self.monitor.name}: expected a window with OpenGL 3.3, got none: "
                f"{_last_error()}"
            )
        try:
            self._prepare(size)
        except BaseException:
            self.close()
            raise

    def _prepare(self, size: tuple[int, int]) -> None:
        import moderngl

        glfw = self._glfw
        glfw.make_context_current(self._window)
        glfw.swap_interval(1)
        glfw.set_input_mode(self._window, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        shown = tuple(glfw.get_framebuffer_size(self._window))
        scale = glfw.get_window_content_scale(self._window)[0]
        if shown != size or scale != 1.0:
            raise DeviceProblem(
                f"screen {self.monitor.name}: expected a picture of {size[0]} × {size[1]} px shown "
                f"one to one, got {shown[0]} × {shown[1]} px at a scale of {scale:g}: set the "
                "scale of this screen to 100 % in the settings of the display, and its resolution "
                "to the projector's own"
            )
        self._context = moderngl.create_context()
        program = self._context.program(vertex_shader=VERTICES, fragment_shader=PIXELS)
        self._screen = self._context.vertex_array(program, [])
        self._textures = {
            channels: self._context.texture(size, channels, dtype="u1", alignment=1)
            for channels in (1, COLOURS)
        }
        # Grey lies in the texture's red alone, and is shown in all three colours.
        self._textures[1].swizzle = "RRR1"
        self.show(np.zeros(size[::-1], np.uint8))

    @property
    def name(self) -> str:
        """Name of the screen."""
        return self.monitor.name

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of the screen."""
        return self.monitor.width_px, self.monitor.height_px

    @property
    def mode(self) -> VideoMode:
        """Video mode and gamma ramp of the screen."""
        m = self.monitor
        return VideoMode(self.size_px, m.refresh_hz, m.scale, self._largest_px, self.straight)

    @property
    def bits(self) -> int:
        """8."""
        return 8

    @property
    def refresh_s(self) -> float | None:
        """Time from one picture to the next, s; None where the system does not tell."""
        return None if self.monitor.refresh_hz is None else 1.0 / self.monitor.refresh_hz

    @property
    def shows_colours(self) -> bool:
        """True."""
        return True

    def show(self, picture: NDArray[Any]) -> float:
        """Show a picture; see ``Projector.show``. Waits for the screen's refresh."""
        if self._window is None:
            raise DeviceProblem("window: expected an open window, got a closed one")
        picture = checked_picture(picture, self.size_px, self.bits, colours=True)
        glfw = self._glfw
        glfw.poll_events()
        if glfw.window_should_close(self._window):
            raise DeviceProblem(f"screen {self.name}: the window was closed")
        glfw.make_context_current(self._window)
        texture = self._textures[1 if picture.ndim == 2 else COLOURS]
        texture.write(picture)
        texture.use(0)
        self._screen.render(mode=self._context.TRIANGLES, vertices=3)
        glfw.swap_buffers(self._window)
        # Without this, the driver may queue pictures and return before they are on the screen.
        self._context.finish()
        return time.monotonic()

    def close(self) -> None:
        """Close the window; again without effect."""
        if self._window is not None:
            self._glfw.destroy_window(self._window)
            self._glfw.poll_events()
            self._window = None


def chosen_monitor(found: list[Monitor], wanted: str | int | None) -> Monitor:
    """Return the screen with a name or number; by default the one that is not the main screen.

    Raises
    ------
    DeviceProblem for an unknown one, and where the default is not clear.
    """
    listed = "; ".join(str(monitor) for monitor in found) or "none"
    if wanted is None:
        others = [monitor for monitor in found if not monitor.primary]
        if len(found) == 1 or len(others) == 1:
            return others[0] if others else found[0]
        raise DeviceProblem(f"projector: expected the name or number of a screen, of: {listed}")
    text = str(wanted)
    by_name = [monitor for monitor in found if monitor.name.casefold() == text.casefold()]
    by_number = [monitor for monitor in found if str(monitor.index) == text]
    matching = by_name or by_number
    if len(matching) != 1:
        what = "several screens of that name" if matching else "no such screen"
        raise DeviceProblem(f"projector {text!r}: expected one of {listed}; got {what}")
    return matching[0]


_errors: list[str] = []
"""Messages of the window library, the last one last. The library reports errors to a function."""


def _last_error() -> str:
    return _errors[-1] if _errors else "no reason given"


def _note_error(code: int, message: str | bytes) -> None:
    del code
    _errors.append(message.decode(errors="replace") if isinstance(message, bytes) else message)
    del _errors[:-1]


def _library() -> ModuleType:
    """The window library, ready."""
    try:
        import glfw
        import moderngl  # noqa: F401, needed later
    except ImportError as error:
        raise MissingPackage(
            "a window on the projector needs glfw and moderngl: pip install 'fringeworks[capture]'"
        ) from error
    glfw.set_error_callback(_note_error)
    if sys.platform.startswith("linux"):
        # Wayland may scale windows by fractions, which resizes every pixel.
        glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_X11)
    if not glfw.init():
        raise DeviceProblem(
            f"screen: expected a display, got none ({_last_error()}): log in to a graphical "
            "session, or set DISPLAY to an X server such as Xvfb"
        )
    return glfw


def _described(glfw: ModuleType, index: int, monitor: Any, primary: bool) -> Monitor:
    mode = glfw.get_video_mode(monitor)
    name = glfw.get_monitor_name(monitor)
    return Monitor(
        index,
        name.decode(errors="replace") if isinstance(name, bytes) else str(name),
        int(mode.size.width),
        int(mode.size.height),
        float(mode.refresh_rate) or None,
        float(glfw.get_monitor_content_scale(monitor)[0]),
        primary,
    )


def _largest_mode(glfw: ModuleType, monitor: Any) -> tuple[int, int] | None:
    """Columns and rows of the video mode with most pixels that a screen offers."""
    sizes = [(int(m.size.width), int(m.size.height)) for m in glfw.get_video_modes(monitor) or []]
    return max(sizes, key=lambda size: size[0] * size[1], default=None)


def _straight_ramp(glfw: ModuleType, monitor: Any) -> bool | None:
    """Whether the gamma ramp of a screen is a straight line."""
    _errors.clear()
    ramp = glfw.get_gamma_ramp(monitor)
    if _errors or ramp is None or len(ramp.red) < 2:
        return None
    line = np.linspace(0.0, 1.0, len(ramp.red))
    off = max(float(np.abs(np.array(c) - line).max()) for c in (ramp.red, ramp.green, ramp.blue))
    return off <= LINEAR_RAMP
