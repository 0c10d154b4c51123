"""The ways in which robots write their poses: rotations, units, and which way the pose maps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, get_args

import numpy as np

from fringeworks.rig.pinhole import rotation
from fringeworks.types import FloatMap, Frozen, InputError, unmasked

RotationKind = Literal[
    "vector", "fixed-xyz", "zyx", "xyz", "zyz", "wxyz", "xyzw", "rows", "columns"
]
"""Forms of a rotation. "vector": axis times angle. "fixed-xyz": angles about fixed x, y, z, in this
order, R = Rz Ry Rx. "zyx", "xyz", "zyz": angles about axes that turn along, R = Rz Ry Rx of (z, y,
x), Rx Ry Rz of (x, y, z), Rz Ry Rz. "wxyz", "xyzw": quaternions. "rows", "columns": the numbers of
a matrix, row by row or column by column."""
Length = Literal["mm", "m"]
"""Units of length."""
Angle = Literal["deg", "rad", ""]
"""Units of angles; empty where a rotation has none."""
MM_PER_M = 1000.0
"""mm in a metre."""
NORM_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1, and of a matrix from a rotation. Panels show
four digits."""
LARGEST = 1e9
"""Largest number of a pose: 1000 km in mm."""
FULL_TURN_RAD = 2.0 * np.pi
"""Largest angle in rad that a robot states. Larger numbers are degrees."""
ROUNDING_RAD = 1e-3
"""By how much a full turn may be rounded up, rad."""
ANGLED: tuple[RotationKind, ...] = ("vector", "fixed-xyz", "zyx", "xyz", "zyz")
"""Rotations of three angles."""
SHAPES: dict[int, tuple[RotationKind, ...]] = {
    6: ANGLED,
    7: ("wxyz", "xyzw"),
    12: ("rows", "columns"),
    16: ("rows", "columns"),
}
"""Rotations by the number of values of a pose."""
EULER: dict[str, tuple[str, bool]] = {
    "fixed-xyz": ("xyz", False),
    "zyx": ("zyx", True),
    "xyz": ("xyz", True),
    "zyz": ("zyz", True),
}
"""Axes of Euler angles in their order, and whether they turn along."""


@dataclass(frozen=True)
class Reading:
    """One way to read the numbers of a pose: x, y, z, then the rotation; or a matrix."""

    rotation: RotationKind
    length: Length = "mm"
    angle: Angle = ""
    inverse: bool = False
    """False: the pose maps flange coordinates to those of the base, as robots state it. True: it
    maps those of the base to the flange's."""

    @property
    def spec(self) -> str:
        """The reading as an option takes it, such as "zyx:deg:mm"."""
        words = (self.rotation, self.angle, self.length, "inverse" if self.inverse else "")
        return ":".join(word for word in words if word)

    @property
    def text(self) -> str:
        """The reading with the robots that use it."""
        brands = [
            name
            for name, known in CONVENTIONS.items()
            if (known.rotation, known.length, known.angle)
            == (self.rotation, self.length, self.angle)
        ]
        return f"{self.spec} (as {', '.join(brands)})" if brands and not self.inverse else self.spec

    def transforms(self, values: FloatMap) -> FloatMap | None:
        """T_base_flange of all poses, (n, 4, 4), mm; None where the numbers are no such poses."""
        found = _matrices(values, self) if self.rotation in ("rows", "columns") else None
        if found is None:
            if self.rotation in ("rows", "columns"):
                return None
            turns = _turns(values[:, 3:], self)
            if turns is None:
                return None
            found = np.tile(np.eye(4), (len(values), 1, 1))
            found[:, :3, :3], found[:, :3, 3] = turns, values[:, :3]
        found[:, :3, 3] *= MM_PER_M if self.length == "m" else 1.0
        return inverses(found) if self.inverse else found


CONVENTIONS: dict[str, Reading] = {
    "ur": Reading("vector", "m", "rad"),
    "kuka": Reading("zyx", "mm", "deg"),
    "abb": Reading("wxyz", "mm"),
    "fanuc": Reading("fixed-xyz", "mm", "deg"),
    "yaskawa": Reading("fixed-xyz", "mm", "deg"),
    "mitsubishi": Reading("fixed-xyz", "mm", "deg"),
    "denso": Reading("fixed-xyz", "mm", "deg"),
    "techman": Reading("fixed-xyz", "mm", "deg"),
    "staubli": Reading("xyz", "mm", "deg"),
    "epson": Reading("zyx", "mm", "deg"),
    "nachi": Reading("zyx", "mm", "deg"),
    "kawasaki": Reading("zyz", "mm", "deg"),
    "comau": Reading("zyz", "mm", "deg"),
    "doosan": Reading("zyz", "mm", "deg"),
    "ros": Reading("xyzw", "m"),
    "ros-rpy": Reading("fixed-xyz", "m", "rad"),
    "franka": Reading("columns", "m"),
    "matrix": Reading("rows", "mm"),
}
"""Readings by the makers of robots, from their manuals as listed by the documentation of Mech-Mind
("Euler angles: definition and convention") and the converters of RoboDK. Those of ROS are from its
messages and REP 103."""
WORDS = (
    *CONVENTIONS,
    *get_args(RotationKind),
    *get_args(Length),
    "deg",
    "rad",
    "direct",
    "inverse",
)
"""Words that say how poses are written."""


def readings_of(poses_as: str, kinds: Sequence[RotationKind]) -> tuple[Reading, ...]:
    """All readings that some words leave open.

    Parameters
    ----------
    poses_as : str
        Words separated by ":", such as "kuka", "zyx:deg:mm", "xyzw", "m" or "ur:inverse"; empty for
        nothing known.
    kinds : sequence of str
        Rotations that the numbers may have.

    Returns
    -------
    Readings, those that map from flange to base first.

    Raises
    ------
    InputError for an unknown word, and words that contradict each other or the numbers.
    """
    words = [word for word in poses_as.lower().split(":") if word]
    unknown = [word for word in words if word not in WORDS]
    if unknown:
        raise InputError(
            f"poses as: expected words out of {', '.join(WORDS)}, separated by ':', got "
            f"{unknown[0]!r}"
        )
    made = [CONVENTIONS[word] for word in words if word in CONVENTIONS]
    directions = [word == "inverse" for word in words if word in ("direct", "inverse")]
    found = []
    for kind, length, inverse in product(kinds, get_args(Length), directions or (False, True)):
        angles: tuple[Angle, ...] = ("deg", "rad") if kind in ANGLED else ("",)
        for angle in angles:
            reading = Reading(kind, length, angle, inverse)
            if _agrees(reading, made, words):
                found.append(reading)
    if not found or len(set(directions)) > 1:
        raise InputError(
            f"poses as: expected words that one pose of {' or '.join(kinds)} can follow, got "
            f"{poses_as!r}"
        )
    return tuple(sorted(found, key=lambda reading: reading.inverse))


def _agrees(reading: Reading, made: Sequence[Reading], words: Sequence[str]) -> bool:
    """Whether a reading follows all words."""
    for known in made:
        if (known.rotation, known.length, known.angle) != (
            reading.rotation,
            reading.length,
            reading.angle,
        ):
            return False
    for value, every in (
        (reading.rotation, get_args(RotationKind)),
        (reading.length, get_args(Length)),
        (reading.angle, ("deg", "rad")),
    ):
        said = [word for word in words if word in every]
        if said and value and any(word != value for word in said):
            return False
    return True


@dataclass(frozen=True, eq=False, repr=False)
class RobotPoses(Frozen):
    """Poses of a robot as they were written, with all ways in which they can be read.

    Raises
    ------
    InputError for numbers of another shape, that are not finite, and that no reading fits.
    """

    values: FloatMap
    """(n, 6), (n, 7), (n, 12) or (n, 16): x, y, z and a rotation, or a matrix; in the robot's
    units."""
    names: tuple[str, ...]
    """A name for every pose; empty where they are numbered."""
    readings: tuple[Reading, ...]
    """Readings that the numbers allow; more than one where the file does not say enough."""

    def __post_init__(self) -> None:
        values = unmasked(self.values, "robot poses")
        real = values.dtype.kind in "fiu" and np.isfinite(values).all()
        if values.ndim != 2 or values.shape[1] not in SHAPES or not len(values) or not real:
            raise InputError(
                "robot poses: expected finite numbers, 6, 7, 12 or 16 for each pose, got shape "
                f"{values.shape}"
            )
        values = values.astype(np.float64)
        if np.abs(values).max() > LARGEST:
            raise InputError(f"robot poses: expected numbers up to {LARGEST:g}, got larger ones")
        if self.names and len(self.names) != len(values):
            raise InputError(f"robot poses: expected {len(values)} names, got {len(self.names)}")
        object.__setattr__(self, "values", values)
        fitting = tuple(r for r in self.readings if r.transforms(values) is not None)
        if not fitting:
            tried = ", ".join(r.spec for r in self.readings if not r.inverse)
            raise InputError(
                "robot poses: expected rotations (quaternions of length 1, matrices of right "
                f"angles, angles up to a turn), but the numbers are none as {tried}"
            )
        object.__setattr__(self, "readings", fitting)
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.values)

    @property
    def transforms(self) -> FloatMap:
        """T_base_flange of all poses, (n, 4, 4), mm, where they can be read in one way only.

        Raises
        ------
        InputError that names the readings where there are several.
        """
        different = distinct(self)
        if len(different) > 1:
            raise InputError(
                f"robot poses: they can be read as {' or '.join(r.text for r, _ in different)}; "
                "say how they are written (poses_as)"
            )
        return different[0][1]

    def at(self, index: Sequence[int]) -> RobotPoses:
        """Some of the poses."""
        chosen = list(index)
        names = tuple(self.names[k] for k in chosen) if self.names else ()
        return RobotPoses(self.values[chosen], names, self.readings)


def robot_poses(values: Any, poses_as: str = "", *, names: Iterable[str] = ()) -> RobotPoses:
    """Poses of a robot from numbers, and how they are written as far as it is known.

    Parameters
    ----------
    values : (n, 6), (n, 7), (n, 12), (n, 16) or (n, 4, 4) array
        x, y, z, then three angles or a quaternion; or matrices.
    poses_as : str
        How they are written: the maker ("ur", "kuka", "abb", "fanuc", "yaskawa", "staubli", "ros",
        …), or words such as "zyx:deg:mm", "xyzw:m", "direct" or "inverse". What is left out is
        found by ``hand_eye``, or refused where several readings fit.
    names : strings, optional
        One for each pose.

    Returns
    -------
    RobotPoses

    Raises
    ------
    InputError for other shapes, unknown words, and numbers that are no such poses.

    Examples
    --------
    >>> robot_poses([[600, 0, 400, 90, 0, 180]], "kuka:direct").transforms[0, :3, 3].tolist()
    [600.0, 0.0, 400.0]
    """
    try:
        numbers = unmasked(values, "robot poses")
        if numbers.dtype.kind not in "fiu":
            raise TypeError
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"robot poses: expected numbers, got {type(values).__name__}") from error
    if numbers.ndim == 3 and numbers.shape[1:] == (4, 4):
        numbers = numbers.reshape(-1, 16)
    if numbers.ndim != 2 or numbers.shape[1] not in SHAPES or not len(numbers):
        raise InputError(
            f"robot poses: expected 6, 7, 12 or 16 numbers for each pose, got shape {numbers.shape}"
        )
    return RobotPoses(numbers, tuple(names), readings_of(poses_as, SHAPES[numbers.shape[1]]))


SAME_MM = 1e-6
"""Largest difference of transforms that are the same but for rounding, mm and 1."""


def distinct(poses: RobotPoses) -> list[tuple[Reading, FloatMap]]:
    """Readings whose transforms differ, with these transforms, (n, 4, 4), mm."""
    found: list[tuple[Reading, FloatMap]] = []
    for reading in poses.readings:
        T = reading.transforms(poses.values)
        if T is not None and not any(np.abs(T - other).max() < SAME_MM for _, other in found):
            found.append((reading, T))
    return found


def inverses(T: FloatMap) -> FloatMap:
    """Invert rigid transforms (n, 4, 4)."""
    found = np.tile(np.eye(4), (len(T), 1, 1))
    found[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    found[:, :3, 3] = -np.einsum("nji,nj->ni", T[:, :3, :3], T[:, :3, 3])
    return found


def _turns(numbers: FloatMap, reading: Reading) -> FloatMap | None:
    """Rotations (n, 3, 3); None where the numbers are none."""
    kind = reading.rotation
    if kind in ("wxyz", "xyzw"):
        length = np.linalg.norm(numbers, axis=1, keepdims=True)
        if numbers.shape[1] != 4 or (np.abs(length - 1.0) > NORM_TOLERANCE).any():
            return None
        return _quaternions(np.roll(numbers / length, 0 if kind == "wxyz" else 1, axis=1))
    if numbers.shape[1] != 3:
        return None
    if reading.angle == "rad" and np.abs(numbers).max() > FULL_TURN_RAD + ROUNDING_RAD:
        return None
    angles = np.radians(numbers) if reading.angle == "deg" else numbers
    if kind == "vector":
        return rotation(angles)
    axes, along = EULER[kind]
    turns = [rotation(angles[:, k, None] * np.eye(3)["xyz".index(a)]) for k, a in enumerate(axes)]
    first, second, third = turns if along else turns[::-1]
    return np.asarray(first @ second @ third)


def _quaternions(q: FloatMap) -> FloatMap:
    """Rotations (n, 3, 3) of unit quaternions w, x, y, z."""
    w, v = q[:, 0, None, None], q[:, 1:]
    cross = np.zeros((len(q), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, i, j], cross[:, j, i] = -v[:, k], v[:, k]
    return np.asarray(np.eye(3) + 2.0 * (w * cross + cross @ cross))


def _matrices(values: FloatMap, reading: Reading) -> FloatMap | None:
    """Transforms (n, 4, 4) of the numbers of matrices; None where they are none."""
    n, size = values.shape
    if size not in (12, 16):
        return None
    if reading.rotation == "rows":
        found = values.reshape(n, size // 4, 4)
    else:
        found = np.swapaxes(values.reshape(n, 4, size // 4), 1, 2)
    turn = found[:, :3, :3]
    off = np.abs(turn @ np.swapaxes(turn, 1, 2) - np.eye(3)).max()
    last = size == 12 or not np.abs(found[:, 3] - (0.0, 0.0, 0.0, 1.0)).max() > NORM_TOLERANCE
    if off > NORM_TOLERANCE or not last or (np.linalg.det(turn) < 0).any():
        return None
    u, _, vt = np.linalg.svd(turn)
    whole = np.tile(np.eye(4), (n, 1, 1))
    whole[:, :3, :3], whole[:, :3, 3] = u @ vt, found[:, :3, 3]
    return whole
