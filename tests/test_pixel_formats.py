"""Bytes of a camera become counts: against packers written bit by bit."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.devices.pixel_formats import full_scale, to_grey, unpacked


def bits_of(values, bits):
    """Samples one after the other, the lowest bit first (PFNC 'p')."""
    stream = [(int(v) >> k) & 1 for v in values for k in range(bits)]
    stream += [0] * (-len(stream) % 8)
    return np.array(
        [sum(b << k for k, b in enumerate(stream[i : i + 8])) for i in range(0, len(stream), 8)],
        np.uint8,
    )


def triples(values, bits):
    """GigE Vision's packed pairs."""
    values = [*map(int, values)] + [0] * (len(values) % 2)
    out = []
    for a, b in zip(values[::2], values[1::2], strict=True):
        low = bits - 8
        out += [a >> low, (a & (2**low - 1)) | ((b & (2**low - 1)) << 4), b >> low]
    return np.array(out, np.uint8)


@pytest.mark.parametrize("shape", [(3, 4), (5, 7), (1, 1), (2, 3)])
@pytest.mark.parametrize(
    "name",
    [
        "Mono8",
        "Mono10",
        "Mono12",
        "Mono14",
        "Mono16",
        "Mono10p",
        "Mono12p",
        "Mono10Packed",
        "Mono12Packed",
        "BayerRG12p",
    ],
)
def test_round_trip(name, shape):
    top = full_scale(name)
    bits = int(np.log2(top + 1))
    values = np.random.default_rng(1).integers(0, top + 1, shape)
    if name.endswith("Packed"):
        content = triples(values.ravel(), bits)
    elif name.endswith("p"):
        content = bits_of(values.ravel(), bits)
    else:
        content = values.astype("u1" if bits == 8 else "<u2").view(np.uint8).ravel()
    found = unpacked(np.append(content, np.uint8(7)), shape, name)
    assert found.dtype == (np.uint8 if bits == 8 else np.uint16)
    np.testing.assert_array_equal(found, values)
    with pytest.raises(InputError, match="bytes for"):
        unpacked(content[:-1], shape, name)


@pytest.mark.parametrize("pattern", ["RG", "GR", "GB", "BG"])
@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (12, np.uint16)])
def test_colours_are_taken_from_their_filters(pattern, bits, kind):
    colours = {"R": 100, "G": 60, "B": 20}
    tile = np.array([[colours[pattern[0]], colours[pattern[1]]], [0, 0]])
    other = {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[pattern]
    tile[1] = [colours[other[0]], colours[other[1]]]
    raw = np.tile(tile, (6, 8)).astype(kind)
    inside = (slice(2, -2), slice(2, -2))
    for channel, value in (
        ("red", 100),
        ("green", 60),
        ("blue", 20),
        ("luminance", 0.299 * 100 + 0.587 * 60 + 0.114 * 20),
    ):
        found = to_grey(raw, f"Bayer{pattern}{bits}", channel)[inside]
        assert np.abs(found.astype(float) - value).max() <= 1


def test_other_formats_are_refused():
    assert full_scale("RGB8") == 255  # of frames with colours
    for name in ("RGB9", "RGBa8", "Mono9", "Mono8p", "mono8", "BayerXX8"):
        with pytest.raises(InputError, match="pixel format"):
            full_scale(name)
    with pytest.raises(InputError, match="channel"):
        to_grey(np.zeros((4, 4), np.uint8), "BayerRG8", "grey")
