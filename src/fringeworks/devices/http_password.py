"""Passwords of cameras with an address, as RFC 7617 (Basic) and RFC 7616 (Digest) send them."""

from __future__ import annotations

import base64
import hashlib
import secrets
import urllib.parse
from collections.abc import Sequence
from urllib.request import parse_http_list, parse_keqv_list

from fringeworks.types import DeviceProblem

HASHES = {"md5": hashlib.md5, "sha-256": hashlib.sha256}
"""Hash functions of Digest by their names; cameras ask for MD5, and for SHA-256 since 2015."""


class Password:
    """A user and a password, sent as the camera asks for them: plainly until it asks for a digest.

    Parameters
    ----------
    parts : SplitResult
        An address with ``user:password@``.
    """

    def __init__(self, parts: urllib.parse.SplitResult) -> None:
        self._user, self._secret = (
            urllib.parse.unquote(word or "") for word in (parts.username, parts.password)
        )
        self._asked: dict[str, str] | None = None
        self._count = 0

    def asked(self, challenges: Sequence[str]) -> None:
        """Take what a camera asks for.

        Raises
        ------
        DeviceProblem for a way of asking that is not known.
        """
        known: list[dict[str, str] | None] = []
        for challenge in challenges:
            kind, _, words = challenge.partition(" ")
            if kind.lower() == "basic":
                known.append(None)
            if kind.lower() == "digest":
                asked = parse_keqv_list(parse_http_list(words))
                ways = asked.get("qop", "auth").replace(" ", "").split(",")
                if asked.get("algorithm", "MD5").lower() in HASHES and "auth" in ways:
                    known.append({"realm": "", "nonce": ""} | asked)
        if not known:
            raise DeviceProblem(
                "expected a camera that asks for a password by Basic, or by Digest with MD5 or "
                f"SHA-256, got {', '.join(one[:60] for one in challenges) or 'another way'}"
            )
        self._asked = next((one for one in known if one is not None), None)
        self._count = 0

    def headers(self, method: str, path: str) -> dict[str, str]:
        """Header of a request."""
        if self._asked is None:
            words = base64.b64encode(f"{self._user}:{self._secret}".encode()).decode()
            return {"Authorization": f"Basic {words}"}
        return {"Authorization": f"Digest {self._digest(method, path)}"}

    def _digest(self, method: str, path: str) -> str:
        """The words of RFC 7616, section 3.4."""
        assert self._asked is not None
        asked = self._asked
        self._count += 1
        counted, own = f"{self._count:08x}", secrets.token_hex(8)
        made = HASHES[asked.get("algorithm", "MD5").lower()]

        def hashed(*words: str) -> str:
            return made(":".join(words).encode()).hexdigest()

        who = hashed(self._user, asked["realm"], self._secret)
        what = hashed(method, path)
        quoted = {"username": self._user, "realm": asked["realm"], "nonce": asked["nonce"]}
        quoted["uri"] = path
        plain = {name: asked[name] for name in ("algorithm",) if name in asked}
        if "qop" in asked:
            plain |= {"qop": "auth", "nc": counted}
            quoted |= {"cnonce": own}
            quoted["response"] = hashed(who, asked["nonce"], counted, own, "auth", what)
        else:
            quoted["response"] = hashed(who, asked["nonce"], what)
        if "opaque" in asked:
            quoted["opaque"] = asked["opaque"]
        words = [f'{name}="{value}"' for name, value in quoted.items()]
        return ", ".join([*words, *(f"{name}={value}" for name, value in plain.items())])
