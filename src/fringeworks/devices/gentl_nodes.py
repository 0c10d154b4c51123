"""The settings of a GenTL camera by their names, from the description that it brings."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from fringeworks.devices.gentl_system import gentl
from fringeworks.types import DeviceProblem


class Nodes:
    """Named settings of a camera.

    Parameters
    ----------
    port : the remote port of an open device of ``genicam.gentl``

    Raises
    ------
    DeviceProblem for a camera whose description cannot be read.
    """

    def __init__(self, port: Any) -> None:
        _, genapi = gentl()
        self._map = genapi.NodeMap()
        self._map.load_xml_from_string(_description(port))
        self._port = _port_class(genapi)(port)
        self._map.connect(self._port, port.name)
        modes = genapi.EAccessMode
        self._readable, self._writable = {modes.RO, modes.RW}, {modes.WO, modes.RW}

    def get(self, *names: str, fresh: bool = False) -> Any:
        """Return the first of several settings that the camera has; None for none.

        ``fresh`` asks the camera, even where the value cannot have changed.
        """
        node = self._first(names, self._readable)
        if node is None:
            return None
        # The library accepts this call only where it asks for something beyond the plain value.
        return node.get_value(ignore_cache=True) if fresh else node.value

    def has(self, *names: str) -> bool:
        """Whether the camera has one of several settings or commands, which may be changed."""
        return self._first(names, self._writable) is not None

    def write(self, value: Any, *names: str, needed: bool = True) -> None:
        """Change the first of several settings that the camera has.

        Raises
        ------
        DeviceProblem where it has none of them, or a needed one may not be changed.
        """
        node = self._first(names, self._writable)
        if node is not None:
            node.value = value
        elif needed:
            raise DeviceProblem(f"expected a camera with the setting {names[0]}, got none")

    def choose(self, name: str, word: str, *, needed: bool = True) -> None:
        """Set a choice, where the camera has it; it raises where it is needed and missing."""
        if needed or word in self.choices(name):
            self.write(word, name, needed=needed)

    def choices(self, name: str) -> tuple[str, ...]:
        """Return the words that a setting can have; none for a setting that the camera lacks."""
        node = self._first((name,), self._readable | self._writable)
        return () if node is None else tuple(node.symbolics)

    def bounds(self, *names: str) -> tuple[float, float] | None:
        """Return the least and the greatest value of the first setting that the camera has."""
        node = self._first(names, self._readable)
        return None if node is None else (float(node.min), float(node.max))

    def do(self, name: str) -> None:
        """Give a command.

        Raises
        ------
        DeviceProblem for one that the camera lacks.
        """
        node = self._first((name,), self._writable)
        if node is None:
            raise DeviceProblem(f"expected a camera with the command {name}, got none")
        node.execute()

    def _first(self, names: tuple[str, ...], modes: set[Any]) -> Any:
        for name in names:
            if self._map.has_node(name):
                node = self._map.get_node(name)
                if node.get_access_mode() in modes:
                    return node
        return None


def _port_class(genapi: Any) -> Any:
    """A port of GenApi that reads and writes through one of GenTL."""

    class Port(genapi.AbstractPort):  # type: ignore[misc]
        def __init__(self, port: Any) -> None:
            super().__init__()
            self._through = port

        def read(self, address: int, length: int) -> bytes:
            return bytes(self._through.read(address, length)[1])

        def write(self, address: int, value: bytes) -> None:
            self._through.write(address, value)

        def get_access_mode(self) -> Any:
            return genapi.EAccessMode.RW

    return Port


def _description(port: Any) -> str:
    """The camera's description, from its own memory or a file of the producer.

    Addresses are ``Local:NAME;ADDRESS;SIZE`` and ``File:///PATH`` (GenTL standard, Port URL). A
    description on the Internet is not fetched.
    """
    urls = [info.url for info in port.url_info_list]
    for url in urls:
        scheme, _, rest = url.partition(":")
        if scheme.lower() == "local":
            _, address, size = rest.partition("?")[0].split(";")
            return _text(bytes(port.read(int(address, 16), int(size, 16))[1]))
        if scheme.lower() == "file":
            return _text(Path(url2pathname(urlsplit(url).path)).read_bytes())
    raise DeviceProblem(
        f"expected a camera that brings its description, got {', '.join(urls) or 'none'}"
    )


def _text(content: bytes) -> str:
    """A description in plain XML, from XML or a ZIP file with one."""
    if content.startswith(b"PK"):
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            content = packed.read(packed.namelist()[0])
    return content.rstrip(b"\0").decode("utf-8-sig")
