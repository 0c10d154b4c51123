"""Damage that keeps a file's structure: chunks with right checksums, tags, members, tables, tokens.

Damage to single bytes seldom gets past a checksum or a parser. What is here reaches the code behind.
"""

from __future__ import annotations

import io
import json
import random
import struct
import tomllib
import warnings
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import tomli_w

NUMBERS = (0, 1, 2, 3, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1)
"""Edges of the integers that headers hold."""
VALUES: tuple[Any, ...] = (
    0, -1, 1, 2**31, 2**63 - 1, -(2**63), 1e-320, 1e308, -1e308, float("nan"), float("inf"), -0.0, True, "",
    "a", "x", "..", "../a.png", "/dev/zero", "\x00", "\ud7ff", "a" * 300, "10", [], [0], [[]], {}, {"a": 1},
)  # fmt: skip
"""Values in place of those of a description."""
TOKENS = (
    b"nan", b"-nan", b"inf", b"1e999", b"-1", b"0", b"4294967296", b"1" * 25, b"0x10", b"1_0", b"1.5", b"", b"a",
    b"element", b"property", b"list", b"double", b"uchar", b"end_header", b"f", b"v", b"#", b"\xc3\x28", b"--",
)  # fmt: skip
"""Words in place of those of a text."""
DTYPES = (
    "|O",
    "<f2",
    ">f8",
    "<i8",
    "|b1",
    "<c16",
    "<U5",
    "<M8[s]",
    "|V7",
    "|S3",
    ">u2",
    "<f16",
    "[('a','<f4')]",
)
"""Types in place of those of an array."""


def damaged(content: bytes, name: str, rng: random.Random) -> bytes | None:
    """A damaged version of a good file, by its structure; None for a kind without one."""
    change = STRUCTURES.get(name.rpartition(".")[2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that occur twice
        return None if change is None else change(content, rng)


def _bytes(data: bytes, rng: random.Random) -> bytes:
    """Some bytes of a piece are others, or it is shorter or longer."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(out) + 1)
        match rng.randrange(4):
            case 0:
                out[at : at + 1] = bytes([rng.randrange(256)])
            case 1:
                size = rng.choice((1, 2, 4))
                number = rng.choice(NUMBERS) % (1 << 8 * size)
                out[at : at + size] = number.to_bytes(size, rng.choice(("little", "big")))
            case 2:
                del out[at : at + rng.randint(1, 20)]
            case 3:
                out[at:at] = out[at : at + rng.randint(1, 20)]
    return bytes(out)


def _pieces(parts: list[Any], rng: random.Random, change: Callable[[Any], Any]) -> list[Any]:
    """A list of pieces with one changed, missing, twice or elsewhere."""
    parts = list(parts)
    at, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    match rng.randrange(6):
        case 0:
            del parts[at]
        case 1:
            parts.insert(other, parts[at])
        case 2:
            parts[at], parts[other] = parts[other], parts[at]
        case _:
            parts[at] = change(parts[at])
    return parts


def _png(content: bytes, rng: random.Random) -> bytes:
    place, chunks = 8, []
    while place + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, place)
        chunks.append((content[place + 4 : place + 8], content[place + 8 : place + 8 + size]))
        place += size + 12

    def change(chunk: tuple[bytes, bytes]) -> tuple[bytes, bytes]:
        kind, data = chunk
        if kind == b"IHDR" and rng.random() < 0.5:
            head = list(struct.unpack(">IIBBBBB", data))
            head[rng.randrange(7)] = rng.choice(NUMBERS)
            return kind, struct.pack(">IIBBBBB", head[0], head[1], *(v % 256 for v in head[2:]))
        if kind == b"IDAT" and rng.random() < 0.7:
            return kind, zlib.compress(_bytes(zlib.decompress(data), rng))
        if rng.random() < 0.2:
            return rng.choice((b"PLTE", b"tRNS", b"iTXt", b"zTXt", b"acTL", b"iCCP", b"gAMA")), data
        return kind, _bytes(data, rng)

    out = content[:8]
    for kind, data in _pieces(chunks, rng, change):
        out += (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )
    return out


def _jpeg(content: bytes, rng: random.Random) -> bytes:
    place, segments = 2, []
    while place + 4 <= len(content) and content[place + 1] != 0xDA:
        (size,) = struct.unpack_from(">H", content, place + 2)
        segments.append(content[place : place + 2 + size])
        place += 2 + size
    segments.append(content[place:])

    def change(segment: bytes) -> bytes:
        if segment[1] in (0xC0, 0xC2) and rng.random() < 0.6:
            at, size = rng.choice(((4, 1), (5, 2), (7, 2), (9, 1), (1, 1)))
            return (
                segment[:at]
                + (rng.choice(NUMBERS) % 256**size).to_bytes(size, "big")
                + segment[at + size :]
            )
        body = _bytes(segment[4:], rng)
        return segment[:2] + struct.pack(">H", (len(body) + 2) % 65536) + body

    return content[:2] + b"".join(_pieces(segments, rng, change))


def _tiff(content: bytes, rng: random.Random) -> bytes:
    order = "<" if content[:2] == b"II" else ">"
    (place,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, place)
    out = bytearray(content)
    for _ in range(rng.randint(1, 2)):
        at = place + 2 + 12 * rng.randrange(count)
        match rng.randrange(6):
            case 0:  # another tag
                struct.pack_into(
                    f"{order}H",
                    out,
                    at,
                    rng.choice(
                        (
                            256,
                            257,
                            258,
                            259,
                            262,
                            273,
                            277,
                            279,
                            320,
                            322,
                            324,
                            325,
                            339,
                            34665,
                            50838,
                            330,
                        )
                    ),
                )
            case 1:  # another type
                struct.pack_into(f"{order}H", out, at + 2, rng.randrange(20))
            case 2:  # another count
                struct.pack_into(f"{order}I", out, at + 4, rng.choice(NUMBERS))
            case 3:  # the link to the next page
                struct.pack_into(f"{order}I", out, place + 2 + 12 * count, rng.randrange(len(out)))
            case _:  # another value
                value = rng.choice(
                    (*NUMBERS, rng.randrange(len(out)), 5, 7, 8, 16, 32, 34712, 50000)
                )
                struct.pack_into(f"{order}I", out, at + 8, value)
    return bytes(out)


def _npy_of(data: bytes, rng: random.Random) -> bytes:
    """An array with another header, or other numbers."""
    if not data.startswith(b"\x93NUMPY"):
        return _bytes(data, rng)
    end = 10 + struct.unpack_from("<H", data, 8)[0]
    head, body = data[10:end].decode("latin-1"), data[end:]
    match rng.randrange(6):
        case 0:
            start = head.index("'descr': ") + 9
            kind = rng.choice(DTYPES)
            kind = kind if kind.startswith("[") else f"'{kind}'"
            head = head[:start] + kind + head[head.index(", 'fortran") :]
        case 1:
            shape = tuple(
                rng.choice((0, 1, 2, 3, 9, 10**6, 2**40, -1)) for _ in range(rng.randint(0, 4))
            )
            head = head[: head.index("(")] + repr(shape) + ", }"
        case 2:
            head = head.replace("False", "True")
        case 3:
            special = struct.pack(
                "<d", rng.choice((float("nan"), float("inf"), -float("inf"), 1e308))
            )
            at = rng.randrange(len(body) // 8 + 1) * 8
            body = body[:at] + special + body[at + 8 :]
        case 4:
            body = bytes(len(body)) if rng.random() < 0.5 else b"\xff" * len(body)
        case 5:
            return _bytes(data, rng)
    packed = head.encode("latin-1")
    return data[:8] + struct.pack("<H", len(packed) % 65536) + packed + body


def _zip(content: bytes, rng: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]

    def change(member: tuple[str, bytes]) -> tuple[str, bytes]:
        name, data = member
        if rng.random() < 0.1:
            return rng.choice(
                ("../a.npy", "a.npy", " ", "/etc/a", name.upper(), name + "/", "\u202e" + name)
            ), data
        if name.endswith(".xml"):
            return name, _text(data, rng)
        return name, _npy_of(data, rng)

    out = io.BytesIO()
    with zipfile.ZipFile(
        out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    ) as new:
        for name, data in _pieces(members, rng, change):
            new.writestr(name, data)
    return out.getvalue()


def _mat(content: bytes, rng: random.Random) -> bytes:
    place, elements = 128, []
    while place + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, place)
        body = content[place + 8 : place + 8 + size]
        elements.append((kind, body))
        place += 8 + size + (0 if kind == 15 else -size % 8)

    def change(element: tuple[int, bytes]) -> tuple[int, bytes]:
        kind, body = element
        if kind == 15 and rng.random() < 0.8:
            return kind, zlib.compress(
                _bytes(zlib.decompress(body)[:200], rng) + zlib.decompress(body)[200:]
            )
        return rng.choice((kind, kind, 14, 15, rng.randrange(20))), _bytes(body, rng)

    out = content[:128]
    for kind, body in _pieces(elements, rng, change):
        out += (
            struct.pack("<II", kind, len(body))
            + body
            + (b"" if kind == 15 else bytes(-len(body) % 8))
        )
    return out


def _tree(value: Any, rng: random.Random) -> Any:
    """A description with one of its values changed, missing, or under another name."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        out = dict(value)
        match rng.randrange(8):
            case 0:
                del out[key]
            case 1:
                out[rng.choice(("a", "", "kind", "x" * 100, key + "_px"))] = out[key]
            case _:
                out[key] = _tree(out[key], rng)
        return out
    if isinstance(value, list) and value and rng.random() < 0.8:
        return _pieces(value, rng, lambda one: _tree(one, rng))
    if isinstance(value, int | float) and rng.random() < 0.3:
        return rng.choice((-value, value * 1e6, value + 1, value / 1e6, float(value), str(value)))
    return rng.choice(VALUES)


def _toml(content: bytes, rng: random.Random) -> bytes:
    changed = _tree(tomllib.loads(content.decode()), rng)
    whole = changed if isinstance(changed, dict) else {"kind": changed}
    return tomli_w.dumps(whole).encode("utf-8", "replace")


def _json(content: bytes, rng: random.Random) -> bytes:
    return json.dumps(_tree(json.loads(content), rng)).encode("utf-8", "replace")


def _text(content: bytes, rng: random.Random) -> bytes:
    """Lines and words of a text are others, missing, twice or elsewhere."""
    head, separator, rest = content.partition(b"end_header\n")
    lines = (head + separator).split(b"\n")

    def change(line: bytes) -> bytes:
        words = line.split(b" ")
        return b" ".join(_pieces(words, rng, lambda _: rng.choice(TOKENS)))

    for _ in range(rng.randint(1, 2)):
        lines = _pieces(lines, rng, change) or [b""]
    return b"\n".join(lines) + (_bytes(rest, rng) if rest and rng.random() < 0.3 else rest)


def _gsf(content: bytes, rng: random.Random) -> bytes:
    head, zero, rest = content.partition(b"\0")
    return _text(head, rng) + zero + rest


STRUCTURES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "png": _png, "jpg": _jpeg, "tif": _tiff, "npz": _zip, "x3p": _zip, "npy": _npy_of, "mat": _mat, "toml": _toml,
    "json": _json, "ply": _text, "xyz": _text, "obj": _text, "off": _text, "xml": _text, "yml": _text, "gsf": _gsf,
    "pcd": _text,
}  # fmt: skip
"""How files are damaged by their structure, by suffix. HDF5 begins otherwise and is left to bytes."""
