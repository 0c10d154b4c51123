"""Readable reader of packed surfaces, pixel by pixel: what the viewer's unpack.js does."""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.pinhole import rays
from fringeworks.types import Pinhole


@dataclass
class Unpacked:
    header: dict
    reason: np.ndarray
    sigma: np.ndarray
    low_sigma: np.ndarray
    points: np.ndarray
    layers: dict[str, np.ndarray]


def unpacked(data: bytes) -> Unpacked:
    assert data[:8] == b"FWSURF1\n"
    (size,) = struct.unpack("<I", data[8:12])
    header, body = json.loads(data[12 : 12 + size]), data[12 + size :]
    columns, rows = header["size"]
    reason = np.frombuffer(block(body, header["reason"]), np.uint8).reshape(rows, columns)
    measured = reason == 0
    low = logarithm(body, header["sigma"], measured)
    points = placed(body, header, measured, low)
    layers = {}
    for layer in header["layers"]:
        used = measured if layer["name"] == "deviation" else np.ones_like(measured)
        if layer["coding"] == "logarithm":
            layers[layer["name"]] = logarithm(body, layer, used) * math.sqrt(layer["ratio"])
        elif layer["coding"] == "steps":
            layers[layer["name"]] = channel(body, layer, 0, used, steps(layer, header, low))
        else:
            one = np.ones(used.shape)
            found = [channel(body, layer, k, used, one) for k in range(len(layer["blocks"]))]
            layers[layer["name"]] = layer["first"] + layer["step"] * np.stack(found, axis=-1)
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


def logarithm(body, code, used):
    codes = channel(body, code, 0, used, np.ones(used.shape))
    values = np.full(codes.shape, np.nan)
    for place in np.argwhere(np.isfinite(codes)):
        value = code["first"]
        for _ in range(int(codes[tuple(place)])):
            value *= code["ratio"]
        values[tuple(place)] = value
    return values


def steps(code, header, low):
    if "fixed" in code:
        return np.full(low.shape, code["fixed"])
    return code["factor"] * np.where(np.isnan(low), header["sigma"]["first"], low)


def channel(body, code, k, used, step):
    symbols = iter(numbers(body, code["blocks"][k]))
    origin = code["origins"][k] if "origins" in code else 0.0
    values = np.full(used.shape, np.nan)

    def at(y, x):
        return values[y, x] if y >= 0 and 0 <= x < used.shape[1] else math.nan

    for y, x in np.argwhere(used):
        symbol = int(next(symbols))
        if symbol == 0:
            continue
        folded = symbol - 1
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
            points[measured, k] = np.stack(planes, axis=-1).copy().view(kind).ravel()
        return points
    step = steps(code, header, low)
    if code["coding"] == "xyz":
        return np.stack([channel(body, code, k, measured, step) for k in range(3)], axis=-1)
    z = channel(body, code, 0, measured, step)
    row, column = (index.astype(float) for index in np.indices(measured.shape))
    if place["kind"] == "camera":
        fx, fy, cx, cy, *distortion = place["camera"]
        camera = Pinhole(2, 2, (fx, fy), (cx, cy), tuple(distortion))
        return rays(camera, place["every"] * np.stack((column, row), axis=-1)) * z[..., None]
    if place["pupil"] is not None:
        x0, y0, distance = place["pupil"]
        column, row = column - (column - x0) * z / distance, row - (row - y0) * z / distance
    return np.stack((column * place["pitch"], -row * place["pitch"], z), axis=-1)
