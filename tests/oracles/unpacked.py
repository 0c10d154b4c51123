"""Readable reader of packed surfaces, pixel by pixel: what the viewer's unpack.js does."""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np


@dataclass
class Unpacked:
    header: dict
    reason: np.ndarray
    sigma: np.ndarray
    low_sigma: np.ndarray
    points: np.ndarray
    layers: dict[str, np.ndarray]


def unpacked(data: bytes) -> Unpacked:
    assert data[:8] == b"FWSURF2\n"
    (size,) = struct.unpack("<I", data[8:12])
    header, body = json.loads(data[12 : 12 + size]), data[12 + size :]
    columns, rows = header["size"]
    reason = np.frombuffer(block(body, header["reason"]), np.uint8).reshape(rows, columns)
    low = logarithm(body, header["sigma"], header, None)
    points = placed(body, header, reason == 0, low)
    layers = {}
    for layer in header["layers"]:
        if "ratio" in layer:
            found = logarithm(body, layer, header, low) * math.sqrt(layer["ratio"])
        elif layer["name"] == "deviation":
            found = channel(body, layer, 0, header, low)
        else:
            count = len(layer["blocks"])
            found = np.stack([channel(body, layer, k, header, low) for k in range(count)], axis=-1)
        layers[layer["name"]] = found
    middle = low * math.sqrt(header["sigma"]["ratio"])
    return Unpacked(header, reason, middle, low, points, layers)


def block(body, place):
    offset, packed, size = place
    content = zlib.decompress(body[offset : offset + packed])
    assert len(content) == size
    return content


def numbers(body, planes):
    """Unsigned numbers whose bytes lie in planes, the lowest first."""
    return sum(
        np.frombuffer(block(body, place), np.uint8).astype(np.int64) << (8 * k)
        for k, place in enumerate(planes)
    )


def logarithm(body, code, header, low):
    codes = channel(body, code, 0, header, low)
    known = np.isfinite(codes)
    powers = [code["first"]]
    for _ in range(int(codes[known].max(initial=0.0))):
        powers.append(powers[-1] * code["ratio"])
    values = np.full(codes.shape, np.nan)
    values[known] = np.array(powers)[codes[known].astype(int)]
    return values


def channel(body, code, k, header, low):
    columns, rows = header["size"]
    values = np.full((rows, columns), np.nan)
    step = np.full(values.shape, code["factor"])
    if code.get("of_sigma"):
        step *= np.where(np.isnan(low), header["sigma"]["first"], low)
    symbols = numbers(body, code["blocks"][k]).reshape(rows, columns)
    origin = code["origins"][k] if "origins" in code else 0.0

    def at(y, x):
        return values[y, x] if y >= 0 and 0 <= x < columns else math.nan

    for y, x in np.argwhere(symbols):
        folded = int(symbols[y, x]) - 1
        change = -(folded + 1) // 2 if folded % 2 else folded // 2
        left, upper = at(y, x - 1), at(y - 1, x)
        guess = left + (at(y - 1, x + 1) - at(y - 1, x - 1)) / 2.0
        for other in (left, upper, origin):
            if math.isnan(guess):
                guess = other
        values[y, x] = (change + math.floor(guess / step[y, x] + 0.5)) * step[y, x]
    return values


def placed(body, header, measured, low):
    code, place = header["points"], header["place"]
    points = np.full((*measured.shape, 3), np.nan)
    if code["coding"].startswith("float"):
        kind = np.dtype(code["coding"])
        for k in range(3):
            planes = [np.frombuffer(block(body, p), np.uint8) for p in code["blocks"][k]]
            planes += [np.zeros_like(planes[0])] * (kind.itemsize - len(planes))
            points[..., k] = np.stack(planes, axis=-1).copy().view(kind).reshape(measured.shape)
        return points
    if code["coding"] == "xyz":
        return np.stack([channel(body, code, k, header, low) for k in range(3)], axis=-1)
    z = channel(body, code, 0, header, low)
    row, column = np.indices(measured.shape)
    u, v = 2.0 * column / measured.shape[1] - 1.0, 2.0 * row / measured.shape[0] - 1.0
    for k in range(2):
        slope, offset = (
            np.polynomial.polynomial.polyval2d(u, v, place[name][k])
            for name in ("directions", "offsets")
        )
        points[..., k] = offset + slope * z
    points[..., 2] = z
    points[~measured] = np.nan
    return points
