"""The functions of libaravis 0.8 that cameras need, called through ctypes."""

from __future__ import annotations

import ctypes as c
import ctypes.util
from functools import lru_cache
from typing import Any

from fringeworks.types import DeviceProblem, MissingPackage

LIBRARY = "libaravis-0.8.so.0"
"""Name of the library on Linux; elsewhere it is searched for."""
HANDLE = c.c_void_p
"""A camera, a stream, a buffer."""


DEVICE_ERRORS = b"arv-device-error-quark"
"""Domain of the library's errors of devices."""
TIMEOUT = 5
"""Code in that domain for a camera that does not answer (ArvDeviceError)."""


class Unanswered(DeviceProblem):
    """A camera does not answer."""


class _Error(c.Structure):
    """GLib's GError."""

    _fields_ = [("domain", c.c_uint32), ("code", c.c_int), ("message", c.c_char_p)]


class Aravis:
    """The library, with errors of GLib as ``DeviceProblem``."""

    def __init__(self, library: Any, objects: Any) -> None:
        self._library = library
        self._objects = objects

    def plain(self, name: str, result: Any, *arguments: tuple[Any, Any]) -> Any:
        """Call a function; every argument is a C type and a value."""
        function = getattr(self._library, name)
        function.restype = result
        function.argtypes = [kind for kind, _ in arguments]
        return function(*(value for _, value in arguments))

    def checked(self, name: str, result: Any, *arguments: tuple[Any, Any]) -> Any:
        """Call a function that takes a GError as its last argument.

        Raises
        ------
        Unanswered where the camera does not answer; DeviceProblem for all else that the library
        reports, with its message.
        """
        error = c.POINTER(_Error)()
        pointer = (c.POINTER(c.POINTER(_Error)), c.byref(error))
        value = self.plain(name, result, *arguments, pointer)
        if error:
            message = error.contents.message.decode(errors="replace")
            self._objects.g_quark_to_string.restype = c.c_char_p
            domain = self._objects.g_quark_to_string(c.c_uint32(error.contents.domain))
            silent = domain == DEVICE_ERRORS and error.contents.code == TIMEOUT
            self._objects.g_error_free(error)
            raise (Unanswered if silent else DeviceProblem)(message)
        return value

    def release(self, handle: Any) -> None:
        """Give up an object."""
        self._objects.g_object_unref.argtypes = [HANDLE]
        self._objects.g_object_unref(handle)

    def words(self, name: str, handle: Any) -> tuple[str, ...]:
        """Call a function that returns a list of words and their number."""
        count = c.c_uint()
        pointer = (c.POINTER(c.c_uint), c.byref(count))
        found = self.checked(name, c.POINTER(c.c_char_p), (HANDLE, handle), pointer)
        words = tuple(found[n].decode() for n in range(count.value)) if found else ()
        self._objects.g_free.argtypes = [c.c_void_p]
        self._objects.g_free(found)
        return words


@lru_cache
def aravis() -> Aravis:
    """Load the library.

    Raises
    ------
    MissingPackage where it is not installed.
    """
    try:
        name = ctypes.util.find_library("aravis-0.8") or LIBRARY
        # The library brings GObject along, which holds the reference counts.
        library = c.CDLL(name)
        objects = c.CDLL(ctypes.util.find_library("gobject-2.0") or "libgobject-2.0.so.0")
    except OSError as error:
        raise MissingPackage(
            "GenICam cameras need the library Aravis 0.8: apt install libaravis-0.8-0 (Debian, "
            "Ubuntu), brew install aravis (macOS)"
        ) from error
    return Aravis(library, objects)
