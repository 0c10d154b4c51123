"""The address that a server listens on, and the names that it answers to."""

from __future__ import annotations

import socket

from fringeworks.types import DeviceProblem

LOOPBACK = ("127.0.0.1", "localhost")
"""Names of this machine for itself."""
EVERYWHERE = ("0.0.0.0", "::")
"""Addresses that stand for all of this machine's."""
USUAL_PORT = 80
"""Port that addresses leave out."""


def own_names(port: int) -> frozenset[str]:
    """Names of this machine with a port; browsers leave out the usual one."""
    with_port = {f"{name}:{port}" for name in LOOPBACK}
    return frozenset(with_port | (set(LOOPBACK) if port == USUAL_PORT else set()))


def named(host: str | None) -> str:
    """The name in the address that is printed."""
    if host in EVERYWHERE:
        return socket.gethostname()
    return "127.0.0.1" if host is None else f"[{host}]" if ":" in host else host


def listening(host: str, port: int | None, *, usual: int, who: str) -> socket.socket:
    """A socket at an address.

    Parameters
    ----------
    host : str
    port : int, optional
        By default ``usual``, or a free one where that is in use.
    usual : int
    who : str
        What listens, for messages, such as "studio".

    Raises
    ------
    DeviceProblem where the address cannot be used.
    """
    for tried in (usual, 0) if port is None else (port,):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        found = socket.socket(family, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((host, tried))
        except OSError as error:
            found.close()
            if tried and port is None:
                continue
            raise DeviceProblem(
                f"{who}: expected a free address, got {host}:{tried}: {error.strerror}; choose "
                "another --host or --port"
            ) from error
        return found
    raise AssertionError
