"""Controllers of DLP projectors that speak the reports of USB HID, for tests.

Written from Texas Instruments' programmer's guides DLPU018 (DLPC900) and DLPU010 (DLPC350), not
from the drivers: they take reports, put packets together, keep state and answer.
"""

from __future__ import annotations

import struct

import numpy as np

from tests import fake_erle


class Controller:
    """What both controllers have in common: packets, replies, and faults on demand."""

    def __init__(self):
        self.commands = []
        """Number and data of every command that arrived whole."""
        self.replies = []
        self._packet = bytearray()
        self.silent = set()
        """Commands that get no reply."""
        self.refused = {}
        """Error codes by command: the reply to it has the error flag."""
        self.quiet_errors = {}
        """Error codes by command whose reply has no error flag."""
        self.empty = set()
        """Commands whose value is not in the answer."""
        self.unplugged = False
        self.stale = []
        """Reports that are answered before the next reply."""
        self.played = []
        """Pictures of every start, in the order in which they are shown."""
        self.on_play = None
        self.closed = False

    def write(self, report):
        if self.unplugged:
            return -1
        assert len(report) == 65
        assert report[0] == 0
        self._packet += report[1:]
        (length,) = struct.unpack_from("<H", self._packet, 2)
        if len(self._packet) >= length + 4:
            packet, self._packet = bytes(self._packet), bytearray()
            self._take(packet[0], packet[1], packet[4 : 4 + length])
        return len(report)

    def read(self, length, timeout_ms):
        assert length == 64
        assert timeout_ms > 0
        if self.unplugged:
            raise OSError("read error")
        if self.stale:
            return list(self.stale.pop(0))
        return list(self.replies.pop(0)) if self.replies else []

    def close(self):
        self.closed = True

    def _take(self, flags, sequence, content):
        (command,) = struct.unpack_from("<H", content)
        data = content[2:]
        self.commands.append((command, data))
        if command in self.silent:
            return
        reads = bool(flags & 0x80)
        failed, answer = self._run(command, data, reads)
        if flags & 0x40:
            head = struct.pack(
                "<BBH", flags & 0xDF | (0x20 if failed else 0), sequence, len(answer)
            )
            whole = head + answer
            for start in range(0, len(whole), 64):
                self.replies.append(whole[start : start + 64].ljust(64, b"\0"))

    def _run(self, command, data, reads):
        """Whether the command fails, and the bytes of the answer."""
        if command in self.refused and not reads:
            self.error = self.refused[command]
            return True, b""
        if command in self.quiet_errors and not reads:
            self.error = self.quiet_errors[command]
            return False, b""
        if command in self.empty and reads:
            return False, b""
        found = self.answer(command) if reads else self.obey(command, data)
        if found is None:
            self.error = 3
            return True, b""
        if isinstance(found, int):
            self.error = found
            return bool(found), b""
        return False, found


SIZES = {1: (1920, 1080), 2: (2560, 1600), 5: (1024, 768)}


class Dlpc900(Controller):
    """A DLPC900 with a micromirror device: hardware number 1 for the DLP6500, 2 for the DLP9000."""

    def __init__(self, hardware=1, planes=400):
        super().__init__()
        self.hardware, self.planes = hardware, planes
        self.dual = hardware == 2
        self.mode, self.running, self.error = 1, False, 0
        self.lut, self.entries, self.count = {}, 0, 0
        self.images = [{}, {}]
        """Decoded images of both controllers by index: (rows, columns) values of 24 bit."""
        self._coming = [None, None]
        self.trigger_out, self.trigger_in = (0, 0, 0), (105, 0)
        self.hardware_status = 1 | (0x10 if self.dual else 0)
        self.parked = False

    def answer(self, command):
        if command == 0x0100:
            code, self.error = self.error, 0
            return bytes((code,))
        return {
            0x0206: bytes((self.hardware,)) + b"emulated".ljust(31, b"\0"),
            0x1A0A: bytes((self.hardware_status,)),
            0x1A0C: bytes((self.parked | self.running << 1,)),
        }.get(command)

    def obey(self, command, data):
        names = {
            0x1A1B: self._mode, 0x1A24: self._start, 0x1A34: self._define, 0x1A31: self._configure,
            0x1A1D: self._out, 0x1A35: self._in,
            0x1A2A: lambda d: self._begin(0, d), 0x1A2B: lambda d: self._data(0, d),
            0x1A2C: lambda d: self._begin(1, d), 0x1A2D: lambda d: self._data(1, d),
        }  # fmt: skip
        return None if command not in names else names[command](data) or 0

    def _mode(self, data):
        self.mode = data[0] & 3
        self.lut, self.entries = {}, 0
        return 0

    def _define(self, data):
        if self.mode not in (1, 2, 3) or self.running:
            return 5
        index, exposure, options, dark, extra, place = struct.unpack("<H3sB3sBH", data)
        depth = (options >> 1 & 7) + 1
        exposure, dark = (int.from_bytes(t, "little") for t in (exposure, dark))
        if exposure < {1: 105, 8: 4046}.get(depth, 105):
            return 14
        if index >= self.planes:
            return 15
        image, bit = place & 0x7FF, place >> 11
        if bit + depth > 24:
            return 10
        self.lut[index] = {
            "exposure": exposure, "dark": dark, "depth": depth, "leds": options >> 4 & 7,
            "waits": options >> 7, "clears": options & 1, "image": image, "bit": bit, "extra": extra,
        }  # fmt: skip
        return 0

    def _configure(self, data):
        self.entries, self.count = struct.unpack("<HI", data)
        if not 1 <= self.entries <= self.planes or set(range(self.entries)) - self.lut.keys():
            return 15
        return 8 if sum(self.lut[k]["depth"] for k in range(self.entries)) > self.planes else 0

    def _begin(self, which, data):
        index, size = struct.unpack("<HI", data)
        if self.mode != 3:
            return 5
        if which and not self.dual:
            return 4
        if index > 17:
            return 6
        self._coming[which] = (index, size, bytearray())
        self.images[which].pop(index, None)
        return 0

    def _data(self, which, data):
        (length,) = struct.unpack_from("<H", data)
        if length != len(data) - 2 or length > 504 or self._coming[which] is None:
            return 6
        index, size, have = self._coming[which]
        have += data[2:]
        if len(have) > size:
            return 8
        if len(have) == size:
            columns, rows = SIZES[self.hardware]
            image = fake_erle.image(bytes(have))
            if image is None:
                return 9
            if image.shape != (rows, columns // (2 if self.dual else 1)):
                return 16
            self.images[which][index] = image
            self._coming[which] = None
        return 0

    def _out(self, data):
        self.trigger_out = struct.unpack("<Bhh", data)
        return 0 if all(-20 <= t <= 20_000 for t in self.trigger_out[1:]) else 13

    def _in(self, data):
        self.trigger_in = struct.unpack("<HB", data)
        return 0 if self.trigger_in[0] >= 105 else 13

    def _start(self, data):
        self.running = data[0] == 2
        if self.running:
            pictures = [self.picture(k) for k in range(self.entries)]
            if any(picture is None for picture in pictures):
                self.running = False
                return 11
            self.played.append(pictures)
            if self.on_play is not None:
                self.on_play(pictures, [self.lut[k] for k in range(self.entries)], self.count)
                self.running = self.count == 0
        return 0

    def picture(self, k):
        """What entry k of the table shows, from the bytes that arrived."""
        entry = self.lut[k]
        halves = [i.get(entry["image"]) for i in self.images[: 2 if self.dual else 1]]
        if any(half is None for half in halves):
            return None
        words = np.hstack(halves)
        return (words >> entry["bit"] & 2 ** entry["depth"] - 1).astype(np.uint8)


class Dlpc350(Controller):
    """A DLPC350 with images in its flash: (1140, 912, 3) arrays of red, green and blue."""

    def __init__(self, flash):
        super().__init__()
        self.flash = flash
        self.mode, self.source, self.trigger_mode, self.error = 0, 0, 0, 0
        self.running, self.box, self.offset = 0, 0, 0
        self.tables = {1: b"", 2: b""}
        self.shape, self.times = (0, 0, 0, 0), (0, 0)
        self.trigger_out, self.trigger_in = (0, 0, 0), 0
        self.busy_for, self.extra_faults = 2, 0
        self._asked = 0
        self.checked = None
        self.hardware_status, self.memory_ok, self.parked = 1, 1, False

    def answer(self, command):
        if command == 0x1A1A:
            self._asked += 1
            if self._asked <= self.busy_for:
                return bytes((0x80,))
            self.checked = self._faults() | self.extra_faults
            return bytes((self.checked,))
        return {
            0x1A42: bytes((len(self.flash),)),
            0x1A0A: bytes((self.hardware_status,)),
            0x1A0B: bytes((self.memory_ok,)),
            0x1A0C: bytes((self.parked | (self.running == 2) << 1,)),
            0x1A24: bytes((self.running,)),
        }.get(command)

    def obey(self, command, data):
        if command in (0x1A31, 0x1A29, 0x1A34, 0x1A1D, 0x1A35) and self.running:
            return 5
        return {
            0x1A1B: lambda: self._set("mode", data[0]),
            0x1A22: lambda: self._set("source", data[0]),
            0x1A23: lambda: self._set("trigger_mode", data[0]),
            0x1A31: lambda: self._set("shape", tuple(data)),
            0x1A29: lambda: self._set("times", struct.unpack("<II", data)),
            0x1A33: lambda: self._set("box", data[0]),
            0x1A32: lambda: self._set("offset", data[0]),
            0x1A34: lambda: self._mail(data),
            0x1A1A: lambda: self._set("_asked", 0),
            0x1A1D: lambda: self._set("trigger_out", tuple(data)),
            0x1A35: lambda: self._set("trigger_in", struct.unpack("<I", data)[0]),
            0x1A24: lambda: self._start(data[0]),
        }.get(command, lambda: None)()

    def _set(self, name, value):
        if name not in ("_asked", "box", "offset"):
            self.checked = None
        setattr(self, name, value)
        return 0

    def _mail(self, data):
        if self.box not in self.tables:
            return 6
        assert self.offset == 0
        self.tables[self.box] = data
        return 0

    def entries(self):
        """The table of patterns, decoded by the guide's table of its bits."""
        data = self.tables[2]
        found, image = [], -1
        for k in range(0, len(data), 3):
            word = int.from_bytes(data[k : k + 3], "little")
            image += word >> 18 & 1
            found.append({
                "trigger": word & 3, "number": word >> 2 & 0x3F, "depth": word >> 8 & 0xF,
                "leds": word >> 12 & 7, "inverts": word >> 16 & 1, "black": word >> 17 & 1,
                "image": image, "exposure": self.times[0], "dark": self.times[1] - self.times[0],
            })  # fmt: skip
        return found

    def _faults(self):
        exposure, period = self.times
        entries = self.entries()
        least = {1: 235, 8: 8333}
        faults = 0
        if any(exposure < least[e["depth"]] for e in entries) or period < exposure:
            faults |= 1
        if any((e["number"] + 1) * e["depth"] > 24 or e["image"] < 0 for e in entries):
            faults |= 2
        if len(entries) != self.shape[0] + 1 or len(self.tables[1]) != self.shape[3] + 1:
            faults |= 2
        if 0 < period - exposure < 230:
            faults |= 16
        return faults

    def _start(self, action):
        if action == 2:
            if self.checked != 0 or (self.mode, self.source, self.trigger_mode) != (1, 3, 1):
                return 5
            entries, images = self.entries(), list(self.tables[1])
            if len(images) == 2:
                images.reverse()
            pictures = [self._picture(e, self.flash[images[e["image"]]]) for e in entries]
            self.played.append(pictures)
            self.running = 2
            if self.on_play is not None:
                self.on_play(pictures, entries, 0 if self.shape[1] else len(entries))
                self.running = 2 if self.shape[1] else 0
        else:
            self.running = action
        return 0

    @staticmethod
    def _picture(entry, image):
        """Planes 0 to 7 are those of green, 8 to 15 of red, 16 to 23 of blue."""
        first = entry["number"] * entry["depth"]
        colour = image[..., (1, 0, 2)[first // 8]]
        return (colour >> first % 8 & 2 ** entry["depth"] - 1).astype(np.uint8)
