"""Rigs in OpenCV's XML and YAML: ours, and those of other programs by the names that they use."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.files.limits import MAX_LENGTH_PX, text_of, told
from fringeworks.files.provenance import KEY, comment_lines, from_comments
from fringeworks.types import FloatMap, InputError, Pinhole, Rig
from fringeworks.types.packages import cv2, need_opencv

MAX_VALUES = 64
"""Largest number of values of a matrix. A rig's matrices have 2 to 14."""
SAME = 1e-6
"""Largest deviation of the zeros and the one of a camera matrix, as a share of the focal length:
above the rounding of single precision."""
ROTATION_ROUNDING = 1e-3
"""Largest deviation of a rotation matrix from the nearest rotation. Files hold four digits or more;
a matrix that is off by more was not meant as a rotation."""
SQUARE = 9
"""Number of values of a matrix of 3 × 3."""
VALUES = {"matrix": SQUARE, "rotation": SQUARE, "translation": 3}
"""Number of values by the last word of a matrix's name."""
NUMBER_TYPE = re.compile(r"(\d{0,3})[ucwsifdh]")
"""Types of elements that OpenCV writes: the number of channels, and the letter of a number."""


DEVICES = ("camera_matrix", "camera_distortion", "projector_matrix", "projector_distortion")
"""Our names of what belongs to one device."""


@dataclass(frozen=True)
class Names:
    """The names that one program gives to the parts of a rig."""

    program: str
    matrices: dict[str, str]
    """Name in the file by ours."""
    sizes: dict[str, tuple[str, ...]]
    """Of the camera and the projector: one name of columns and rows, or two names."""
    residuals: tuple[str, str, str] = ("", "", "")
    """Residuals of the camera, of the projector, and of both together, px."""
    rows_first: bool = False
    """Whether a size is given as rows and columns."""


def _names(
    program: str, matrices: str, camera: str = "", projector: str = "", **more: Any
) -> Names:
    """Names of a program: matrix and distortion of both devices, rotation, translation, sizes."""
    pairs = zip((*DEVICES, "rotation", "translation"), matrices.split(), strict=True)
    sizes = {"camera": tuple(camera.split()), "projector": tuple(projector.split())}
    return Names(program, dict(pairs), sizes, **more)


ERRORS = ("cam_error", "proj_error", "stereo_error")
"""Residuals of SLStudio and of scan3d-capture."""
PROGRAMS = (
    _names(
        "fringeworks",
        f"{' '.join(DEVICES)} rotation translation",
        "camera_size",
        "projector_size",
    ),
    _names(
        "SLStudio",
        "Kc kc Kp kp Rp Tp",
        "frameWidth frameHeight",
        "screenResX screenResY",
        residuals=ERRORS,
    ),
    _names("SLMaster", "M1 D1 M4 D4 Rlp Tlp", "S"),
    _names(
        "sltk",
        "cam_K cam_kc pro_K pro_kc R T",
        "cam_size",
        "pro_size",
        residuals=("cam_rms", "pro_rms", "stereo_rms"),
    ),
    _names("scan3d-capture", "cam_K cam_kc proj_K proj_kc R T", residuals=ERRORS),
    *(
        _names(
            "procam-calibration",
            f"cam_int cam_dist proj_int proj_dist {rotation} translation",
            "img_shape",
            rows_first=True,
        )
        for rotation in ("rotation", "roration")
    ),
    *(
        _names("OpenCV's samples", f"{names} {pose}")
        for names in (
            "M1 D1 M2 D2",
            "K1 D1 K2 D2",
            "cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2",
        )
        for pose in ("R T", "rotation translation")
    ),
)
"""Programs whose files are read, ours first. All names of one program must be there: the same name
means different things in different programs."""


def format_opencv(rig: Rig, suffix: str) -> str:
    """A rig as OpenCV's XML (suffix ``.xml``) or YAML."""
    need_opencv("a rig file of OpenCV")
    for name, device in (("camera", rig.camera), ("projector", rig.projector)):
        if device.field is not None:
            raise InputError(
                f"rig: its {name} has a field, which a file of OpenCV cannot hold, and points "
                "would be wrong without it; write a .toml file"
            )
    if rig.robot is not None:
        raise InputError(
            "rig: it says where the camera is on a robot, which a file of OpenCV cannot hold; "
            "write a .toml file"
        )
    kind = cv2.FILE_STORAGE_FORMAT_XML if suffix == ".xml" else cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage("", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    for name, device in (("camera", rig.camera), ("projector", rig.projector)):
        storage.write(f"{name}_size", np.array([[device.width_px, device.height_px]], np.int32))
        storage.write(f"{name}_matrix", _matrix(device))
        storage.write(f"{name}_distortion", np.array([device.distortion]))
    storage.write("rotation", rig.T_projector_camera[:3, :3].copy())
    storage.write("translation", rig.T_projector_camera[:3, 3:].copy())
    # OpenCV limits the length of a string.
    storage.startWriteStruct(KEY, cv2.FileNode_SEQ)
    for line in comment_lines(rig.provenance):
        storage.write("", line)
    storage.endWriteStruct()
    return str(storage.releaseAndGetString())


def _matrix(device: Pinhole) -> FloatMap:
    K = np.eye(3)
    K[[0, 1], [0, 1]] = device.focal_px
    K[:2, 2] = device.principal_px
    return K


def parse_opencv(
    content: bytes,
    *,
    camera_size: tuple[int, int] | None = None,
    projector_size: tuple[int, int] | None = None,
) -> Rig:
    """A rig from the content of an XML or YAML file.

    Parameters
    ----------
    content : bytes
    camera_size, projector_size : (columns, rows), optional
        For files that do not say them.

    Raises
    ------
    InputError for another kind of file, missing or damaged matrices, and unknown sizes.
    """
    need_opencv("a rig file of OpenCV")
    try:
        storage = cv2.FileStorage(text_of(content), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        present = set(root.keys()) if root.isMap() else set()
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        raise InputError("expected XML or YAML of OpenCV's FileStorage, got none") from error
    names = _program(present)
    found = {ours: _values(storage, theirs, ours) for ours, theirs in names.matrices.items()}
    devices = []
    for device, given in (("camera", camera_size), ("projector", projector_size)):
        size = _size(storage, names, device, present) or given
        if size is None:
            raise InputError(
                f"missing {device}_size: columns and rows of the {device}; read_rig(…, "
                f"{device}_size=…) or rig convert --{device}-size 1280x1024 state it"
            )
        K = found[f"{device}_matrix"].reshape(3, 3)
        devices.append(pinhole_from(device, K, found[f"{device}_distortion"], size))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_of(found["rotation"].reshape(3, 3)), found["translation"]
    residual = _residuals(storage, names, present)
    known: dict[str, Any] = {} if residual is None else {"residual_px": residual}
    node = storage.getNode(KEY)
    lines = [node.at(k).string() for k in range(node.size())] if node.isSeq() else []
    return Rig(devices[0], devices[1], T, provenance=from_comments(lines), **known)


def _program(present: set[str]) -> Names:
    """The program whose names a file has."""
    for names in PROGRAMS:
        if present.issuperset(names.matrices.values()):
            return names
    closest = max(PROGRAMS, key=lambda n: len(present.intersection(n.matrices.values())))
    ours, theirs = next((o, t) for o, t in closest.matrices.items() if t not in present)
    known = ", ".join(dict.fromkeys(n.program for n in PROGRAMS))
    named = "" if ours == theirs else f" ({theirs} of {closest.program})"
    raise InputError(f"missing matrix {ours}{named}; names of these programs are known: {known}")


def _numbers(node: Any) -> Iterator[float]:
    """The numbers of a node, which is a list or a single number; few are taken."""
    items = (
        [node.at(k) for k in range(min(node.size(), MAX_VALUES + 1))] if node.isSeq() else [node]
    )
    for item in items:
        if not (item.isInt() or item.isReal()):
            raise InputError("expected numbers")
        yield float(item.real())


def _declared(node: Any, name: str) -> tuple[int, ...]:
    """Rows, columns and channels that a matrix declares.

    Raises
    ------
    InputError for another type than numbers, missing sizes, and sizes that are not whole.
    """
    kind = node.getNode("dt")
    number = NUMBER_TYPE.fullmatch(kind.string()) if kind.isString() else None
    if number is None:
        got = told(kind.string()) if kind.isString() else "none"
        raise InputError(f"{name}: expected a type of numbers as dt, such as d, got {got}")
    sizes = [node.getNode(key) for key in ("rows", "cols")]
    if not all(size.isInt() for size in sizes):
        raise InputError(f"{name}: expected rows and cols as whole numbers")
    return (*(int(size.real()) for size in sizes), int(number[1] or 1))


def _values(storage: Any, name: str, ours: str) -> FloatMap:
    """The values of a matrix, (n,), finite; as many as it declares."""
    node = storage.getNode(name)
    shape: tuple[int, ...] = ()
    if node.isMap():
        shape, node = _declared(node, name), node.getNode("data")
    try:
        values = np.array(list(_numbers(node)), np.float64)
    except (cv2.error, SystemError, InputError) as error:
        raise InputError(f"{name}: expected a matrix of numbers, got something else") from error
    if shape and (min(shape) < 1 or math.prod(shape) != values.size):
        raise InputError(
            f"{name}: expected rows × cols numbers ({' × '.join(map(str, shape[:2]))}), got "
            f"{values.size if values.size <= MAX_VALUES else f'more than {MAX_VALUES}'}"
        )
    expected = VALUES.get(ours.rpartition("_")[2])
    if expected is not None and values.size != expected:
        raise InputError(f"{name}: expected {expected} values, got {values.size}")
    if shape and expected == SQUARE and shape != (3, 3, 1):
        raise InputError(f"{name}: expected 3 rows and 3 cols, got {shape[0]} and {shape[1]}")
    if values.size > MAX_VALUES or not np.isfinite(values).all():
        raise InputError(f"{name}: expected finite values, got {told(values)}")
    return values


def rotation_of(given: FloatMap) -> FloatMap:
    """The nearest rotation: files hold a few digits only."""
    u, _, v = np.linalg.svd(given)
    nearest = np.asarray(u @ v)
    if np.abs(nearest - given).max() > ROTATION_ROUNDING:
        raise InputError(f"rotation: expected a rotation matrix, got {told(given.tolist())}")
    return nearest


def pinhole_from(device: str, K: FloatMap, d: FloatMap, size: tuple[int, int]) -> Pinhole:
    """A device from its camera matrix (3, 3) and its distortion coefficients (n,)."""
    off = np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1.0]).max()
    if off > SAME * max(abs(K[0, 0]), 1.0):
        raise InputError(
            f"{device}_matrix: expected (fx 0 cx, 0 fy cy, 0 0 1), got {told(K.tolist())}"
        )
    if d.size > 5 and np.any(d[5:]):
        raise InputError(f"{device}_distortion: expected five coefficients or fewer, got {d.size}")
    k = np.zeros(5)
    k[: min(5, d.size)] = d[:5]
    return Pinhole(
        *size,
        (float(K[0, 0]), float(K[1, 1])),
        (float(K[0, 2]), float(K[1, 2])),
        (float(k[0]), float(k[1]), float(k[2]), float(k[3]), float(k[4])),
    )


def _size(storage: Any, names: Names, device: str, present: set[str]) -> tuple[int, int] | None:
    """Columns and rows of a device; None where the file does not say them."""
    given = names.sizes[device]
    if not given or not present.issuperset(given):
        return None
    values = [v for name in given for v in _values(storage, name, f"{device}_size")]
    if not all(v == int(v) and 2 <= v <= MAX_LENGTH_PX for v in values) or len(values) < 2:
        raise InputError(
            f"{' '.join(given)}: expected columns and rows from 2 to {MAX_LENGTH_PX}, got "
            f"{told(values)}"
        )
    first, second = int(values[0]), int(values[1])
    return (second, first) if names.rows_first else (first, second)


def _residuals(storage: Any, names: Names, present: set[str]) -> tuple[float, float] | None:
    """Residuals of camera and projector, px; None where the file does not say them.

    That of both together goes first: those of a single device come from poses of their own, and are
    smaller than what the rig leaves.
    """

    def residual(name: str) -> float | None:
        if name not in present:
            return None
        value = _values(storage, name, "residual")
        # Some programs write −1 for an unknown one.
        return float(value[0]) if value.size == 1 and value[0] >= 0 else None

    camera, projector, both = (residual(name) for name in names.residuals)
    if both is not None:
        return both, both
    return None if camera is None or projector is None else (camera, projector)
