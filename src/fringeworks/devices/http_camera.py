"""Cameras with an address: a stream of JPEG images, or one image for each request."""

from __future__ import annotations

import http.client
import io
import socket
import string
import time
import urllib.parse
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fringeworks.devices.frame_reader import FrameReader, FromReader
from fringeworks.devices.http_password import Password
from fringeworks.devices.pixel_formats import Channel
from fringeworks.devices.protocols import Grab
from fringeworks.files.limits import told
from fringeworks.types import CameraSettings, DeviceProblem, InputError, Region

FIRST_FRAME_S = 10.0
"""Longest wait for the first frame, s: phones start their camera when somebody looks."""
SILENT_S = 0.8
"""Time without a byte after which a camera counts as gone, s, so that this is said within a second.
Cameras with fewer frames per second get three of their periods."""
SLOW_PERIODS = 3.0
"""Periods without a byte after which a slow camera counts as gone."""
MOST_BYTES = 2**26
"""Largest image, bytes: JPEG of 100 megapixels has 50 million."""
READ_BYTES = 2**16
"""Bytes that are read at a time."""
LONGEST_LINE = 2**16
"""Longest line of a header, bytes, as in ``http.client``."""
MOST_LINES = 100
"""Largest number of lines of a part's header, as in ``http.client``."""
LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue (ITU-R BT.601)."""
IMAGES = (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n")
"""First bytes of JPEG and PNG."""
UNTOLD = ("application/octet-stream", "text/plain")
"""Types of answers that may hold an image: bytes, and what ``http.client`` takes where no type is
given."""
MULTIPART = "multipart/"
"""Beginning of the types of streams. Cameras send x-mixed-replace, and some mixed."""
GONE = (
    "expected a frame, got none: the camera was unplugged or switched off, or the network is down; "
    "connect it and resume"
)
"""What is said of a camera that sends nothing."""


class HttpSource:
    """Reads images from an address, in the manner of ``cv2.VideoCapture``.

    Parameters
    ----------
    address : str
        ``http://`` or ``https://``; with ``user:password@`` for cameras that ask for them.

    Raises
    ------
    DeviceProblem where nobody answers there, or something else than images is sent.
    """

    def __init__(self, address: str) -> None:
        parts = urllib.parse.urlsplit(address)
        path = urllib.parse.urlunsplit(("", "", parts.path or "/", parts.query, ""))
        self._path = urllib.parse.quote(path, safe=string.punctuation)
        """As it is sent: letters beyond ASCII and spaces as %XX."""
        self._headers = {"Accept": "image/jpeg, multipart/x-mixed-replace, image/*"}
        self._password = Password(parts) if parts.username else None
        secure = parts.scheme == "https"
        made = http.client.HTTPSConnection if secure else http.client.HTTPConnection
        self._connection = made(parts.hostname or "", parts.port, timeout=FIRST_FRAME_S)
        self._stream: http.client.HTTPResponse | None = None
        self._socket: socket.socket | None = None
        self._mark = b""
        self._data = b""
        self._last_s: float | None = None
        try:
            self._data = self._opened()
        except DeviceProblem:
            self.release()
            raise
        except (OSError, http.client.HTTPException) as error:
            self.release()
            raise DeviceProblem(f"expected a camera that answers, got none ({error})") from error

    def grab(self) -> bool:
        """Fetch the next image."""
        if self._last_s is None:
            # The first image came with the answer.
            self._last_s = time.monotonic()
            return True
        try:
            self._data = self._asked() if self._stream is None else self._part(self._stream)
        except (OSError, http.client.HTTPException) as error:
            raise DeviceProblem(GONE) from error
        arrived_s = time.monotonic()
        self._wait_for(max(SILENT_S, SLOW_PERIODS * (arrived_s - self._last_s)))
        self._last_s = arrived_s
        return True

    def retrieve(self) -> tuple[bool, NDArray[Any] | None]:
        """Decode the image that was fetched last; False where it is damaged."""
        try:
            with Image.open(io.BytesIO(self._data), formats=("JPEG", "PNG")) as image:
                return True, np.asarray(image.convert("L" if image.mode == "L" else "RGB"))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            return False, None

    def release(self) -> None:
        """Close the connection."""
        if self._stream is not None:
            self._stream.close()
        self._connection.close()

    def _wait_for(self, silent_s: float) -> None:
        self._connection.timeout = silent_s
        # A camera that ends each connection has closed its socket.
        if self._socket is not None and self._socket.fileno() >= 0:
            self._socket.settimeout(silent_s)

    def _opened(self) -> bytes:
        """The first image; keeps the stream where the address sends one."""
        answer = self._request()
        kind = answer.headers.get_content_type()
        if kind.startswith(MULTIPART):
            mark = answer.headers.get_param("boundary")
            self._stream = answer
            self._mark = b"--" + mark.strip("-").encode() if isinstance(mark, str) else b""
            return self._part(answer)
        if kind.startswith("image/") or kind in UNTOLD:
            data = self._read(answer)
            if kind not in UNTOLD or data.startswith(IMAGES):
                return data
        raise DeviceProblem(
            f"expected an image or a stream of images (multipart/x-mixed-replace), got {kind}"
        )

    def _request(self) -> http.client.HTTPResponse:
        answer = self._sent()
        if answer.status == http.client.UNAUTHORIZED and self._password is not None:
            self._password.asked(answer.headers.get_all("WWW-Authenticate") or [])
            answer.read(LONGEST_LINE)
            self._connection.close()
            answer = self._sent()
        if answer.status != http.client.OK:
            raise DeviceProblem(
                f"expected an image, got the answer {answer.status} {answer.reason}"
                f"{self._why(answer)}"
            )
        return answer

    def _sent(self) -> http.client.HTTPResponse:
        """The answer to a request."""
        known = {} if self._password is None else self._password.headers("GET", self._path)
        self._connection.request("GET", self._path, headers=self._headers | known)
        # The connection forgets the socket of an answer that has no end.
        self._socket = self._connection.sock
        return self._connection.getresponse()

    def _why(self, answer: http.client.HTTPResponse) -> str:
        """What to do about an answer without an image, as the end of a sentence."""
        if answer.status == http.client.UNAUTHORIZED:
            if self._password is None:
                return "; give user:password@ before the host"
            return "; the user or the password is not right"
        if answer.status in range(300, 400) and (there := answer.headers.get("Location")):
            return f"; its images are at {told(there)} now: give this address"
        return ""

    def _asked(self) -> bytes:
        """The image that a request gets; on a new connection where the camera ends each."""
        try:
            return self._read(self._request())
        except (http.client.RemoteDisconnected, http.client.CannotSendRequest, BrokenPipeError):
            self._connection.close()
            return self._read(self._request())

    def _read(self, answer: http.client.HTTPResponse, length: int = MOST_BYTES + 1) -> bytes:
        """Bytes of an answer, up to its end."""
        end_s, data = time.monotonic() + FIRST_FRAME_S, bytearray()
        while len(data) < length and (some := answer.read1(min(length - len(data), READ_BYTES))):
            data += some
            if time.monotonic() > end_s:
                raise DeviceProblem(f"expected an image within {FIRST_FRAME_S:g} s, got a part")
        if len(data) > MOST_BYTES:
            raise DeviceProblem(f"expected images of {MOST_BYTES} bytes or fewer, got more")
        if answer is not self._stream:
            # The connection takes the next request only after this.
            answer.close()
        return bytes(data)

    def _part(self, stream: http.client.HTTPResponse) -> bytes:
        """The next image of a stream."""
        length = None
        passed = 0
        while not self._begins(line := self._line(stream)):
            passed += len(line)
            if passed > MOST_BYTES:
                raise DeviceProblem("expected the next image of the stream, got bytes without end")
        for _ in range(MOST_LINES):
            line = self._line(stream).strip()
            if not line:
                break
            name, _, value = line.partition(b":")
            if name.strip().lower() == b"content-length" and value.strip().isdigit():
                length = int(value)
        if length is None:
            return self._unsized(stream)
        if length > MOST_BYTES:
            raise DeviceProblem(f"expected images of {MOST_BYTES} bytes or fewer, got {length}")
        data = self._read(stream, length)
        if len(data) < length:
            raise DeviceProblem(GONE)
        return data

    def _begins(self, line: bytes) -> bool:
        """Whether a part begins after a line. Some cameras state another boundary than they send,
        or none: the first line with two dashes is theirs."""
        line = line.strip()
        if self._mark and line.lstrip(b"-") == self._mark.lstrip(b"-"):
            return True
        first = self._last_s is None and line.startswith(b"--")
        if first:
            self._mark = line
        return first

    def _unsized(self, stream: http.client.HTTPResponse) -> bytes:
        """An image without its length, up to the end that JPEG has."""
        data = bytearray()
        while not data.rstrip(b"\r\n").endswith(b"\xff\xd9"):
            data += self._line(stream)
            if len(data) > MOST_BYTES:
                raise DeviceProblem(f"expected images of {MOST_BYTES} bytes or fewer, got more")
        return bytes(data)

    def _line(self, stream: http.client.HTTPResponse) -> bytes:
        line = stream.readline(LONGEST_LINE)
        if not line:
            raise DeviceProblem(GONE)
        return line


class HttpCamera(FromReader):
    """A camera with an address on the network, such as an IP camera or an app on a phone.

    Parameters
    ----------
    address : str
        That of a stream of JPEG images (MJPEG), or of one image for each request.
    channel : str
        What is made of frames in colour: luminance (BT.601), red, green or blue.

    Raises
    ------
    DeviceProblem where nobody answers there, or something else than images is sent.

    Notes
    -----
    Settings are those of the camera's own page or app: switch automatic exposure, white balance and
    focus off there. Colour becomes luminance (BT.601), with 255 where any colour is 255.
    """

    def __init__(self, address: str, *, channel: Channel = "luminance") -> None:
        self._channel = channel
        try:
            parts = urllib.parse.urlsplit(address)
            port = f":{parts.port}" if parts.port else ""
        except ValueError as error:
            raise InputError(f"address: expected http://HOST:PORT/PATH, got {error}") from error
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InputError(f"address: expected http://HOST/PATH, got {address!r}")
        # No password: the name is stored with captures.
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        self._name = f"{parts.scheme}://{host}{port}{parts.path}"
        self._reader = FrameReader(lambda: self._source(address), self._name)
        try:
            image = self._reader.first(FIRST_FRAME_S).image
            if image is None:
                raise DeviceProblem(f"{self._name}: expected images as JPEG or PNG, got others")
        except BaseException:
            self._reader.close()
            raise
        self._size_px = image.shape[1], image.shape[0]

    def _source(self, address: str) -> HttpSource:
        try:
            return HttpSource(address)
        except DeviceProblem as error:
            raise DeviceProblem(f"{self._name}: {error}") from error

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Return the frame size as the region; nothing can be set.

        Raises
        ------
        InputError for any setting other than ``triggered=False`` and the pixel format.
        """
        wanted = set(settings.given())
        if settings.triggered is False:
            wanted.discard("triggered")
        if settings.pixel_format == self._format:
            wanted.discard("pixel_format")
        if settings.region == Region(0, 0, *self._size_px):
            wanted.discard("region")
        if wanted:
            raise InputError(
                f"{self.name}: {', '.join(sorted(wanted))}: expected no setting; set it on the "
                "camera's own page or in its app"
            )
        self._reader.discard()
        return CameraSettings(None, None, Region(0, 0, *self._size_px), self._format, False)

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        read = self._reader.take(timeout_s)
        shape = self._size_px[::-1]
        whole = read.image is not None and read.image.shape[:2] == shape
        grey = np.zeros(shape, np.uint8)
        if read.image is not None and whole:
            image = read.image
            grey = colours_of(image) if self._colours else grey_of(image, self._channel)
        return Grab(grey, read.host_s, None, read.number, whole)


def colours_of(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return an image in red, green and blue as a frame in colour.

    Raises
    ------
    DeviceProblem for an image in grey.
    """
    if image.shape[2:] != (len(LUMINANCE),):
        raise DeviceProblem(
            f"frame: expected one in colour, (h, w, 3), got a grey one of shape {image.shape}"
        )
    return np.ascontiguousarray(image, np.uint8)


def grey_of(image: NDArray[Any], channel: Channel = "luminance") -> NDArray[np.uint8]:
    """Return an image in grey, or in red, green and blue, as counts of luminance or of a channel.

    Examples
    --------
    >>> grey_of(np.array([[[255, 0, 0], [10, 10, 10]]], np.uint8)).tolist()
    [[255, 10]]
    """
    if image.ndim == 2:
        return np.asarray(image, np.uint8)
    if channel != "luminance":
        return np.ascontiguousarray(image[..., ("red", "green", "blue").index(channel)], np.uint8)
    grey = np.asarray(np.rint(image @ np.array(LUMINANCE, np.float32)), np.uint8)
    grey[image.max(axis=2) == 255] = 255
    return grey
