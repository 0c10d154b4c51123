"""The DLPC900's images decoded from their bytes (DLPU018, Tables 2-109 and 2-115)."""

from __future__ import annotations

import struct

import numpy as np


def image(data: bytes):
    """(rows, columns) values of 24 bit; None for another signature or compression."""
    signature, columns, rows, size = struct.unpack_from("<4sHHI", data)
    if signature != b"Spld" or data[12:20] != b"\xff" * 8 or data[25] != 2 or data[26] != 1:
        return None
    body = data[48:]
    assert size == len(body)
    assert len(data) % 4 == 0
    out = np.zeros((rows, columns), np.uint32)
    row = column = place = 0

    def count():
        nonlocal place
        n = body[place]
        place += 1
        if n & 0x80:
            n = (n & 0x7F) | body[place] << 7
            place += 1
        return n

    def pixels(n):
        nonlocal place
        raw = np.frombuffer(body, np.uint8, 3 * n, place).reshape(n, 3).astype(np.uint32)
        place += 3 * n
        return raw[:, 0] << 16 | raw[:, 1] << 8 | raw[:, 2]

    while True:
        n = count()
        if n:
            out[row, column : column + n] = pixels(1)[0]
        else:
            n = count()
            if n == 0:
                assert column == columns
                row, column = row + 1, 0
                continue
            if n == 1:
                n = count()
                if n == 0:
                    break
                out[row, column : column + n] = out[row - 1, column : column + n]
            else:
                out[row, column : column + n] = pixels(n)
        column += n
        assert column <= columns
    assert row == rows
    assert not any(body[place:])
    return out
