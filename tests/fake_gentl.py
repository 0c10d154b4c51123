"""A GenTL producer built for the tests, ``gentl/producer.c``: cameras that see a projector's light.

The producer runs in this process. The test maps the same file as the producer does: the picture of
the projector, the scene, and the faults that come next.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from functools import cache
from pathlib import Path

import numpy as np

from fringeworks.devices.protocols import Closing
from tests.fake_gige import counts

SIZE = 128
"""Rows and columns of the sensor (SIDE in producer.c)."""
FAULTS = np.dtype(
    [
        ("unplugged", "u4", 2),
        ("generation", "u4", 2),
        ("lost", "u4"),
        ("incomplete", "u4"),
        ("plugged", "u4"),
        ("ptp_offset_ns", "u4"),
        ("spare", "u4", 1016),
        ("white", "f8", (SIZE, SIZE)),
        ("black", "f8", (SIZE, SIZE)),
        ("picture", "u1", (SIZE, SIZE)),
    ]
)
"""What test and producer share (Control in producer.c)."""


def _integer(name, address, mode="RW", limits="<Min>0</Min><Max>4294967295</Max>"):
    register = _register("IntReg", f"{name}Reg", address, 4, mode, "<Sign>Unsigned</Sign>")
    return f'<Integer Name="{name}"><pValue>{name}Reg</pValue>{limits}</Integer>{register}'


def _register(kind, name, address, length, mode, more=""):
    endian = "" if kind == "StringReg" else "<Endianess>LittleEndian</Endianess>"
    return (
        f'<{kind} Name="{name}"><Address>{address}</Address><Length>{length}</Length>'
        f"<AccessMode>{mode}</AccessMode><pPort>Device</pPort>"
        f"<Cachable>NoCache</Cachable>{more}{endian}</{kind}>"
    )


def _float(name, address, low, high):
    register = _register("FloatReg", f"{name}Reg", address, 8, "RW")
    limits = f"<Min>{low}</Min><Max>{high}</Max>"
    return f'<Float Name="{name}"><pValue>{name}Reg</pValue>{limits}</Float>{register}'


def _choice(name, address, mode="RW", **values):
    entries = "".join(
        f'<EnumEntry Name="{word}"><Value>{value}</Value></EnumEntry>'
        for word, value in values.items()
    )
    register = _register("IntReg", f"{name}Reg", address, 4, mode, "<Sign>Unsigned</Sign>")
    return f'<Enumeration Name="{name}">{entries}<pValue>{name}Reg</pValue></Enumeration>{register}'


def _command(name, address):
    register = _register("IntReg", f"{name}Reg", address, 4, "RW", "<Sign>Unsigned</Sign>")
    value = "<CommandValue>1</CommandValue>"
    return f'<Command Name="{name}"><pValue>{name}Reg</pValue>{value}</Command>{register}'


def _long(name, address):
    return _register("IntReg", name, address, 8, "RO", "<Sign>Signed</Sign>")


def description():
    """The camera's registers in the words of GenApi; addresses are those of producer.c."""
    side = f"<Min>8</Min><Max>{SIZE}</Max>"
    nodes = [
        _integer("Width", 0x00, limits=side),
        _integer("Height", 0x04, limits=side),
        _integer("OffsetX", 0x08),
        _integer("OffsetY", 0x0C),
        _choice("PixelFormat", 0x10, Mono8=0x01080001, Mono12=0x01100005),
        _integer("SensorWidth", 0x14, "RO"),
        _integer("SensorHeight", 0x18, "RO"),
        _integer("PayloadSize", 0x1C, "RO"),
        _float("ExposureTime", 0x20, 10, 10_000_000),
        _float("Gain", 0x28, 0, 24),
        _choice("TriggerMode", 0x30, Off=0, On=1),
        _choice("TriggerSource", 0x34, Software=0, Line0=1, Line1=2),
        _choice("TriggerSelector", 0x38, FrameStart=0),
        _command("TriggerSoftware", 0x3C),
        _command("AcquisitionStart", 0x40),
        _command("AcquisitionStop", 0x44),
        _choice("ExposureAuto", 0x48, Off=0, Continuous=1),
        _choice("GainAuto", 0x4C, Off=0, Continuous=1),
        '<Boolean Name="PtpEnable"><pValue>PtpEnableReg</pValue></Boolean>'
        + _register("IntReg", "PtpEnableReg", 0x50, 4, "RW", "<Sign>Unsigned</Sign>"),
        _choice("PtpStatus", 0x54, "RO", Disabled=0, Master=4, Slave=8),
        _command("TimestampLatch", 0x58),
        _choice("AcquisitionMode", 0x5C, Continuous=0),
        _long("TimestampLatchValue", 0x60),
        _float("AcquisitionFrameRate", 0x68, 1, 1000),
        _long("PtpOffsetFromMaster", 0x70),
    ]
    for n, name in enumerate(("DeviceVendorName", "DeviceModelName", "DeviceSerialNumber")):
        nodes.append(_register("StringReg", name, 0x78 + 32 * n, 32, "RO"))
    return (
        '<?xml version="1.0" encoding="utf-8"?><RegisterDescription ModelName="Fake" '
        'VendorName="Fringeworks" StandardNameSpace="None" SchemaMajorVersion="1" '
        'SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" '
        'SubMinorVersion="0" ToolTip="" ProductGuid="0" VersionGuid="0" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_1">'
        + "".join(nodes)
        + '<Port Name="Device"></Port></RegisterDescription>'
    )


def compiler():
    """The C compiler, or None."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@cache
def producer():
    """Build the producer once in a process; the memory that it shares with the tests."""
    import tempfile

    folder = Path(tempfile.mkdtemp(prefix="fringeworks-gentl-"))
    source = Path(__file__).parent / "gentl" / "producer.c"
    library = folder / "fringeworks.cti"
    words = ["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run(
        [compiler(), *words, "-o", str(library), str(source), "-lm", "-lpthread"], check=True
    )
    (folder / "camera.xml").write_text(description())
    control = np.memmap(folder / "control.bin", FAULTS, "w+", shape=(1,))
    control["plugged"] = 1
    control.flush()
    os.environ["FRINGEWORKS_PRODUCER"] = str(folder)
    os.environ["GENICAM_GENTL64_PATH"] = str(folder)
    return control


class MappedProjector(Closing):
    """A projector whose picture the producer reads."""

    name, bits, refresh_s, size_px = "shared", 8, 1 / 60, (SIZE, SIZE)

    def __init__(self, control):
        self._control = control

    def show(self, picture):
        self._control["picture"][0] = picture
        return time.monotonic()


class GentlPeer:
    """The producer with a scene before its cameras, like the peer on GigE Vision."""

    def __init__(self, scene, lost=0):
        self.scene, self._control = scene, producer()
        self._control["white"][0], self._control["black"][0] = scene
        self._control["plugged"], self._control["ptp_offset_ns"] = 1, 0
        self._control["unplugged"] = 0
        self.lose(lost // 25)
        self.projector = MappedProjector(self._control)
        self.identifier = "FWCAM0"

    def expected(self, picture, exposure_ms=10.0, gain_db=0.0):
        return counts(self.scene, picture, 1e3 * exposure_ms, gain_db)

    def lose(self, frames=0, incomplete=0):
        """Lose the next frames, and deliver only half of those after."""
        self._control["lost"], self._control["incomplete"] = frames, incomplete

    def kill(self):
        """Unplug the first camera: its handles are void for good."""
        self._control["generation"][0, 0] += 1
        self._control["unplugged"][0, 0] = 1

    def start(self):
        """Plug it in again."""
        self._control["unplugged"][0, 0] = 0

    def both(self, ptp_offset_ns=0):
        """Plug in a second camera, whose clock PTP holds to within an offset."""
        self._control["plugged"], self._control["ptp_offset_ns"] = 2, ptp_offset_ns

    def stop(self):
        self.start()
        self._control["plugged"] = 1
