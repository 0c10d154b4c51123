"""The package's own kinds of devices, by the words that open them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from fringeworks.devices.pixel_formats import with_channel, with_channel_or_raw
from fringeworks.devices.protocols import Camera, CameraLimits, Projector
from fringeworks.devices.registry import (
    BOTH_KINDS,
    CAMERA_KINDS,
    PROJECTOR_KINDS,
    Both,
    ListedDevice,
    registering,
)
from fringeworks.types import DeviceProblem


def _screens() -> Iterator[ListedDevice]:
    from fringeworks.devices.window import monitors

    found = monitors()
    names = [monitor.name for monitor in found]
    for monitor in found:
        which = monitor.name if names.count(monitor.name) == 1 else str(monitor.index)
        yield ListedDevice(f"screen:{which}", str(monitor))


@registering(PROJECTOR_KINDS, "projector", "screen", _screens)
def open_screen(which: str) -> Projector:
    """``screen``, ``screen:NAME`` or ``screen:NUMBER``: a screen of this computer."""
    from fringeworks.devices.window import WindowProjector

    return WindowProjector(which or None)


@registering(PROJECTOR_KINDS, "projector", "memory", None)
def open_memory(folder: str) -> Projector:
    """``memory:FOLDER``: a projector that holds the pictures exported to a folder."""
    from fringeworks.devices.memory_projector import MemoryProjector

    return MemoryProjector(_needed("memory", "FOLDER", folder))


def _dlpc900s() -> Iterator[ListedDevice]:
    from fringeworks.devices.dlpc900 import IDS
    from fringeworks.devices.hid_link import hid_serials

    for serial in hid_serials(IDS):
        yield ListedDevice(f"dlpc900:{serial}", "a projector with the controller DLPC900")


@registering(PROJECTOR_KINDS, "projector", "dlpc900", _dlpc900s)
def open_dlpc900(words: str) -> Projector:
    """``dlpc900`` or ``dlpc900:SERIAL,exposure_us=8000``: a LightCrafter 6500 or 9000 over USB."""
    from fringeworks.devices.dlpc900 import Dlpc900
    from fringeworks.devices.sequencer import settings_of

    return Dlpc900(*settings_of(words, "dlpc900"))


def _dlpc350s() -> Iterator[ListedDevice]:
    from fringeworks.devices.dlpc350 import IDS
    from fringeworks.devices.hid_link import hid_serials

    for serial in hid_serials(IDS):
        said = f"a projector with the controller DLPC350, serial number {serial}"
        yield ListedDevice("dlpc350", said)


@registering(PROJECTOR_KINDS, "projector", "dlpc350", _dlpc350s)
def open_dlpc350(words: str) -> Projector:
    """``dlpc350:FOLDER,exposure_us=9000``: a LightCrafter 4500 over USB, pictures in its flash."""
    from fringeworks.devices.dlpc350 import Dlpc350
    from fringeworks.devices.sequencer import settings_of

    folder, settings = settings_of(words, "dlpc350")
    return Dlpc350(_needed("dlpc350", "FOLDER", folder), settings)


def _webcams() -> Iterator[ListedDevice]:
    from fringeworks.devices.webcam import webcams

    for found in webcams():
        if isinstance(found, DeviceProblem):
            yield ListedDevice("webcam", str(found), usable=False)
        else:
            model = f"{found.model}, " if found.model else ""
            yield ListedDevice(f"webcam:{found.number}", model + described(found.limits))


@registering(CAMERA_KINDS, "camera", "webcam", _webcams)
def open_webcam(which: str) -> Camera:
    """``webcam``, ``webcam:NUMBER`` or ``webcam:PATH``: a webcam, by default number 0."""
    from fringeworks.devices.webcam import WebcamCamera

    which, channel = with_channel(which)
    source = int(which or "0") if not which or which.isdecimal() else which
    return WebcamCamera(source, channel=channel)


def _named(
    kind: str, identifiers: Iterable[str], opened: Callable[[str], Camera]
) -> Iterator[ListedDevice]:
    """Cameras of a library, each with what it can do, or with why it cannot be opened."""
    for identifier in identifiers:
        words = f"{kind}:{identifier}"
        try:
            with opened(identifier) as camera:
                yield ListedDevice(words, f"{camera.name}, {described(camera.limits())}")
        except DeviceProblem as problem:
            yield ListedDevice(words, str(problem), usable=False)


def _genicams() -> Iterator[ListedDevice]:
    from fringeworks.devices.genicam import GenicamCamera, genicam_cameras

    yield from _named("genicam", (c.identifier for c in genicam_cameras()), GenicamCamera)


@registering(CAMERA_KINDS, "camera", "genicam", _genicams)
def open_genicam(identifier: str) -> Camera:
    """``genicam`` or ``genicam:IDENTIFIER``: a camera with GigE Vision or USB3 Vision."""
    from fringeworks.devices.genicam import GenicamCamera

    identifier, channel = with_channel_or_raw(identifier)
    return GenicamCamera(identifier or None, channel=channel)


def _gentls() -> Iterator[ListedDevice]:
    from fringeworks.devices.gentl import GentlCamera
    from fringeworks.devices.gentl_system import gentl_cameras

    yield from _named("gentl", (c.identifier for c in gentl_cameras()), GentlCamera)


@registering(CAMERA_KINDS, "camera", "gentl", _gentls)
def open_gentl(identifier: str) -> Camera:
    """``gentl`` or ``gentl:IDENTIFIER``: a camera through its maker's driver, a GenTL producer."""
    from fringeworks.devices.gentl import GentlCamera

    identifier, channel = with_channel_or_raw(identifier)
    return GentlCamera(identifier or None, channel=channel)


def _picameras() -> Iterator[ListedDevice]:
    from fringeworks.devices.raspberry_camera import pi_cameras

    for number, model in enumerate(pi_cameras()):
        yield ListedDevice(f"picamera:{number}", model)


@registering(CAMERA_KINDS, "camera", "picamera", _picameras)
def open_picamera(which: str) -> Camera:
    """``picamera`` or ``picamera:NUMBER``: a camera of a Raspberry Pi."""
    from fringeworks.devices.raspberry_camera import RaspberryCamera

    which, channel = with_channel(which)
    if which and not which.isdecimal():
        raise DeviceProblem(f"picamera: expected picamera:NUMBER, got picamera:{which}")
    return RaspberryCamera(int(which or "0"), channel=channel)


def _photo_cameras() -> Iterator[ListedDevice]:
    from fringeworks.devices.photo_camera import photo_cameras

    # A camera is not opened: that would take a photograph.
    for port, model in photo_cameras().items():
        yield ListedDevice(f"gphoto2:{port}", model)


@registering(CAMERA_KINDS, "camera", "gphoto2", _photo_cameras)
def open_gphoto2(port: str) -> Camera:
    """``gphoto2`` or ``gphoto2:PORT``: a photo camera on USB, through the program gphoto2."""
    from fringeworks.devices.photo_camera import PhotoCamera

    port, channel = with_channel(port)
    return PhotoCamera(port, channel=channel)


@registering(CAMERA_KINDS, "camera", "phone", None)
def open_phone(folder: str) -> Camera:
    """``phone:FOLDER``: a phone that shows the page ``/phone`` of the studio in a folder."""
    from fringeworks.devices.phone_camera import PhoneCamera

    return PhoneCamera(_needed("phone", "FOLDER", folder))


@registering(CAMERA_KINDS, "camera", "http", None)
def open_http(address: str) -> Camera:
    """``http://HOST/PATH``: a camera on the network that sends JPEG images."""
    from fringeworks.devices.http_camera import HttpCamera

    address, channel = with_channel(address)
    return HttpCamera(f"http:{address}", channel=channel)


@registering(CAMERA_KINDS, "camera", "https", None)
def open_https(address: str) -> Camera:
    """``https://HOST/PATH``: the same on a secure connection."""
    from fringeworks.devices.http_camera import HttpCamera

    address, channel = with_channel(address)
    return HttpCamera(f"https:{address}", channel=channel)


@registering(CAMERA_KINDS, "camera", "folder", None)
def open_folder(folder: str) -> Camera:
    """``folder:PATH``: any camera whose program writes images into a folder."""
    from fringeworks.devices.folder_camera import FolderCamera

    folder, channel = with_channel(folder)
    return FolderCamera(_needed("folder", "PATH", folder), channel=channel)


@registering(BOTH_KINDS, "scanner", "virtual", None)
def open_virtual(scene: str) -> Both:
    """``virtual`` or ``virtual:SCENE``: devices in memory, on a clock that nobody waits for."""
    from fringeworks.devices.bench import virtual_bench
    from fringeworks.devices.clock import SimulatedClock

    return virtual_bench(scene, clock=SimulatedClock())


def described(limits: CameraLimits) -> str:
    """Return the limits of a camera in one line."""
    words = [f"{limits.width_px} × {limits.height_px} px"]
    if limits.exposure_ms is not None:
        words.append("exposure {:g} to {:g} ms".format(*limits.exposure_ms))
    if limits.gain_db is not None:
        words.append("gain {:g} to {:g} dB".format(*limits.gain_db))
    words += limits.pixel_formats
    if limits.frame_s:
        words.append(f"{1 / limits.frame_s:.3g} frames per second")
    return ", ".join(words)


def _needed(kind: str, what: str, given: str) -> str:
    if not given:
        raise DeviceProblem(f"{kind}: expected {kind}:{what}, got {kind} alone")
    return given
