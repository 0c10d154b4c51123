"""Poses of robots from tables, JSON and programs of robots, as they are written there."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.csv_table import COMMENTS, CSV, SEPARATORS
from fringeworks.files.limits import (
    MAX_DESCRIPTION_BYTES,
    existing_file,
    parsing,
    read_content,
    text_of,
    told,
)
from fringeworks.rig.robot.readings import (
    SHAPES,
    RobotPoses,
    RotationKind,
    readings_of,
)
from fringeworks.types import FileProblem

JSON = ".json"
"""Suffix of JSON."""
SUFFIXES = (CSV, ".txt", JSON, ".yaml", ".yml", ".src", ".dat", ".ls", ".script", ".mod", ".jbi")
"""Suffixes that are read: tables, JSON, messages of ROS as ``ros2 topic echo`` prints them, and
programs of KUKA, FANUC, UR, ABB and Yaskawa."""
REMARKS = (*COMMENTS, ";", "!", "//")
"""Beginnings of lines that say nothing: of tables, KUKA, ABB and FANUC, and others."""
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
"""A number as text."""
PAIR = re.compile(
    rf"(?<![\w.])([A-Za-z]{{1,5}})(?:\s*[=:]\s*|\s+)({NUMBER})\s*(mm|m|deg|rad)?(?![\w.])"
)
"""A letter with its value, as KUKA and FANUC write poses, perhaps with a unit. Something stands
between them: x1 is the name of a column."""
THREE, FOUR, SIX = (rf"({NUMBER}(?:\s*,\s*{NUMBER}){{{n - 1}}})" for n in (3, 4, 6))
"""Numbers with commas between them."""
PROGRAMS = {
    "ur": re.compile(rf"\bp\[\s*{SIX}\s*\]"),
    "abb": re.compile(rf"\[\s*\[\s*{THREE}\s*\]\s*,\s*\[\s*{FOUR}\s*\]"),
    "doosan": re.compile(rf"\bposx\(\s*\[?\s*{SIX}\s*[\])]"),
    "yaskawa": re.compile(rf"^[BCP]\d+=\s*{SIX}(?=\s|,|$)", re.MULTILINE),
    "ros": re.compile(rf"Translation: \[{THREE}\]\s*-?\s*Rotation: in Quaternion[^\[]*\[{FOUR}\]"),
}
"""Poses as programs have them, by the words that say how they are written: p[x, y, z, rx, ry, rz]
of URScript, the beginning [[x, y, z], [q1, q2, q3, q4] of a robtarget of ABB, posx(…) of Doosan,
C00001=… of Yaskawa, and what ``tf2_echo`` of ROS prints."""
PULSES = "///PULSE"
"""Mark of positions in a job of Yaskawa that are pulses of the motors."""
PLACE = ("x", "y", "z")
"""Names of a position."""
MATRIX_SIZES = (12, 16)
"""Numbers of a matrix of three or four rows."""
EULER_KINDS: tuple[RotationKind, ...] = ("fixed-xyz", "zyx", "xyz", "zyz")
"""Rotations by Euler angles."""
TURNS: dict[tuple[str, ...], tuple[RotationKind, ...]] = {
    ("qw", "qx", "qy", "qz"): ("wxyz",),
    ("q1", "q2", "q3", "q4"): ("wxyz", "xyzw"),
    ("q0", "q1", "q2", "q3"): ("wxyz", "xyzw"),
    ("rx", "ry", "rz"): ("vector", "fixed-xyz", "xyz"),
    ("a", "b", "c"): EULER_KINDS,
    ("w", "p", "r"): ("fixed-xyz",),
    ("u", "v", "w"): ("zyx",),
    ("o", "a", "t"): ("zyz",),
    ("e1", "e2", "e3"): ("zyz",),
    ("roll", "pitch", "yaw"): ("fixed-xyz", "xyz"),
    ("alpha", "beta", "gamma"): EULER_KINDS,
}
"""Names of rotations in the order in which they are kept, and what they may mean."""
QUATERNIONS = [sorted(names) for names in (*TURNS, ("x", "y", "z", "w")) if len(names) == 4]
"""Letters of quaternions in pairs of letters and values."""
NAMES = ("name", "pose", "view", "capture", "file", "folder", "id", "index", "number", "frame")
"""Columns with the names of poses."""
OTHER = "-"
"""Name of columns that hold nothing of a pose."""
POSE_KEYS = {*PLACE, *(key for names in TURNS for key in names)}
"""Names of columns that hold a part of a pose."""
SHIFTS = ("position", "translation", "pos", "xyz", "t", "p")
"""Names of a group with a position."""
GROUPS = ("orientation", "rotation", "quaternion", "rot", "q", "r", "euler", "rpy")
"""Names of a group with a rotation."""
DIRECTIONS = {"t_base_flange": "direct", "t_flange_base": "inverse", "o_t_ee": "franka"}
"""Names that say which way a pose maps, or how it is written: libfranka's end effector."""
WRAPPERS = ("pose", "transform", "matrix", "value", "values", *DIRECTIONS)
"""Names around a whole pose."""
SPELLINGS = {"tx": "x", "ty": "y", "tz": "z", "px": "x", "py": "y", "pz": "z"}
"""Other names of a position."""
UNIT = re.compile(r"[\s_]*[\[(]?(mm|m|deg|degrees|rad|°)[\])]?$")
"""A unit at the end of a name."""
TCP_POSE = re.compile(r"(?:actual|target)_tcp_pose_[0-5]")
"""Columns of the pose in a recording of UR's interface RTDE: metres and a rotation vector."""
AXES = re.compile(r"(?:q|j|joint_?|a|axis_?)[1-9]")
"""Columns with angles of a robot's axes."""
LEAST_AXES = 5
"""Number of such columns from which on they are axes, and no quaternion q1 to q4."""
ORDER = re.compile(r"(?:quat|quaternion|orientation|rotation)_(wxyz|xyzw)")
"""Names of a quaternion that say in which order it stands."""
UNIT_WORDS = {"degrees": "deg", "°": "deg"}
"""Units in the words of a reading."""
MOST_POSES = 100_000
"""Largest number of poses of a file."""


@dataclass
class Written:
    """One pose as it was written: named numbers, or numbers alone."""

    numbers: list[float] = field(default_factory=list)
    keys: tuple[str, ...] = ()
    name: str = ""
    words: tuple[str, ...] = ()
    """What the file says of how it is written."""
    kinds: tuple[RotationKind, ...] | None = None
    """Rotations that it may have; None for what the keys or the count say."""


def read_robot_poses(path: StrPath, poses_as: str = "") -> RobotPoses:
    """Read the poses of a robot, with every reading that the file leaves open.

    Parameters
    ----------
    path : path
        ``.csv`` or ``.txt``: a pose per line, perhaps with a header, in which names tell what they
        can; ``.json``: a list of poses, or names with poses, as lists, matrices, or with
        ``position`` and ``orientation`` as ROS has them; ``.yaml``: such messages as ROS prints
        them; programs or parts of them with poses of KUKA ({X …, A …}), FANUC (X = … mm), UR
        (p[…]), ABB ([[…],[…]]), Doosan (posx(…)) and Yaskawa (C00001=…), and what ``tf2_echo``
        prints.
    poses_as : str
        How they are written, as far as the file does not say; see ``robot_poses``.

    Returns
    -------
    RobotPoses

    Raises
    ------
    FileProblem for a missing or damaged file; InputError for words that contradict the file.
    """
    path = existing_file(path, "poses of a robot")
    if path.suffix.lower() not in SUFFIXES:
        raise FileProblem(
            f"{told(path)}: expected one of {', '.join(SUFFIXES)}, got "
            f"{told(path.suffix) or 'no suffix'}"
        )
    content = read_content(path, "poses of a robot", MAX_DESCRIPTION_BYTES)
    with parsing(path, "poses of a robot"):
        text = text_of(content)
        poses = _from_json(text) if path.suffix.lower() == JSON else _from_text(text)
        return _together(poses, poses_as)


def parse_robot_pose(text: str, poses_as: str = "") -> RobotPoses:
    """Read one pose from its text, such as "600,0,400,90,0,180" or "p[0.6, 0, 0.4, 0, 3.14, 0]".

    Raises
    ------
    FileProblem for a text that is no pose, and InputError for words that contradict it.
    """
    with parsing(Path("robot pose"), "the pose of a robot"):
        found = _together(_from_text(text), poses_as)
        if len(found) != 1:
            raise FileProblem(f"expected one pose, got {len(found)}")
        return found


def _together(poses: Sequence[Written], poses_as: str) -> RobotPoses:
    if not 0 < len(poses) <= MOST_POSES:
        raise FileProblem(f"expected 1 to {MOST_POSES} poses, got {len(poses)}")
    first = poses[0]
    for number, pose in enumerate(poses, 1):
        if (pose.keys, len(pose.numbers)) != (first.keys, len(first.numbers)):
            raise FileProblem(
                f"expected all poses written alike, but pose {number} has "
                f"{told(', '.join(pose.keys) or f'{len(pose.numbers)} numbers')}, the first "
                f"{told(', '.join(first.keys) or f'{len(first.numbers)} numbers')}"
            )
    order, kinds = _arrangement(first)
    values = np.array([[pose.numbers[k] for k in order] for pose in poses], np.float64)
    said = dict.fromkeys(word for pose in poses for word in pose.words)
    words = ":".join([*said, *(word for word in [poses_as] if word)])
    names = tuple(pose.name for pose in poses) if all(pose.name for pose in poses) else ()
    return RobotPoses(values, names, readings_of(words, kinds))


def _arrangement(pose: Written) -> tuple[list[int], tuple[RotationKind, ...]]:
    """Order of the numbers as RobotPoses has them, and what the rotation may be."""
    count = len(pose.numbers)
    if not pose.keys:
        if count not in SHAPES:
            raise FileProblem(f"expected 6, 7, 12 or 16 numbers for a pose, got {count}")
        return list(range(count)), pose.kinds or SHAPES[count]
    place = {key: k for k, key in enumerate(pose.keys)}
    if not set(PLACE) <= set(place):
        raise FileProblem(f"expected x, y and z of a pose, got {told(', '.join(pose.keys))}")
    for names, kinds in TURNS.items():
        if set(names) <= set(place):
            return [place[key] for key in (*PLACE, *names)], pose.kinds or kinds
    expected = "; ".join(", ".join(names) for names in TURNS)
    raise FileProblem(f"expected a rotation ({expected}), got {told(', '.join(pose.keys))}")


def _from_text(text: str) -> list[Written]:
    """Poses of a program or of a table."""
    if PULSES in text:
        raise FileProblem(
            f"expected positions in mm and degrees, got pulses of the motors ({PULSES}); convert "
            "the job to rectangular coordinates"
        )
    lines = [line.strip() for line in text.splitlines()]
    body = "\n".join(line for line in lines if line and not line.startswith(REMARKS))
    for word, pattern in PROGRAMS.items():
        found = [
            Written([float(n) for part in one.groups() for n in part.split(",")], words=(word,))
            for one in pattern.finditer(body)
        ]
        if found:
            return found
    return _from_pairs(body) or _from_table(body.splitlines())


def _from_pairs(text: str) -> list[Written]:
    """Poses of letters with values: x, y and z, then a quaternion or the three letters that
    follow."""
    pairs = [(key.lower(), float(number), unit) for key, number, unit in PAIR.findall(text)]
    keys = [key for key, _, _ in pairs]
    starts = [k for k, key in enumerate(keys) if key == "x"]
    found: list[Written] = []
    used = 0
    for at, following in zip(starts, [*starts[1:], len(keys)], strict=False):
        four = tuple(keys[at + 3 : at + 7])
        count = 7 if sorted(four) in QUATERNIONS else 6
        # Six letters end before the next x; a quaternion of ROS has an x of its own.
        if at < used or (count == 6 and following - at < count):
            continue
        used = at + count
        turn = four if count == 7 else four[:3]
        names = tuple(f"q{key}" if count == 7 and len(key) == 1 else key for key in turn)
        units = dict.fromkeys(unit for _, _, unit in pairs[at:used] if unit)
        numbers = [number for _, number, _ in pairs[at:used]]
        found.append(Written(numbers, (*keys[at : at + 3], *names), words=tuple(units)))
    return found


def _from_table(lines: Sequence[str]) -> list[Written]:
    """Poses of a table with or without a header."""
    if not lines:
        return []
    separator = next((s for s in SEPARATORS if s in lines[0]), None)
    rows = [_cells(line, separator) for line in lines]
    header = None
    if not any(_is_number(cell) for cell in rows[0]):
        header, rows = rows[0], rows[1:]
    if header is None:
        return [_unnamed(row) for row in rows]
    keys, words = _columns(header)
    if rows and not any(_is_number(cell) for cell in rows[0]):
        # A second line with the units of the columns.
        units = _columns([f"{key}_{cell}" for key, cell in zip(keys, rows[0], strict=False)])[1]
        words, rows = tuple(dict.fromkeys(words + units)), rows[1:]
    keys, words = _chosen(keys, words)
    found = []
    for number, row in enumerate(rows, len(lines) - len(rows) + 1):
        if len(row) != len(header):
            raise FileProblem(f"line {number}: expected {len(header)} cells, got {len(row)}")
        known = (*NAMES, OTHER)
        chosen = [(key, cell) for key, cell in zip(keys, row, strict=True) if key not in known]
        name = next((cell for key, cell in zip(keys, row, strict=True) if key in NAMES), "")
        numbers = [(key, float(cell)) for key, cell in chosen if _is_number(cell)]
        found.append(_of_columns(numbers, name, words))
    return found


def _chosen(keys: list[str], words: tuple[str, ...]) -> tuple[list[str], tuple[str, ...]]:
    """Names of the columns of a pose; others, such as angles of axes, become "name"."""
    pose = [key for key in keys if TCP_POSE.fullmatch(key)]
    stems = {key.rpartition("_")[0] for key in pose}
    if pose and not set(PLACE) <= set(keys):
        # Measured poses, where those that were wanted are there as well.
        stem = min(stems)
        place = {f"{stem}_{k}": key for k, key in enumerate((*PLACE, "rx", "ry", "rz"))}
        return [place.get(key, OTHER) for key in keys], (*words, "ur")
    axes = [key for key in keys if AXES.fullmatch(key)]
    if len(axes) >= LEAST_AXES:
        keys = [OTHER if key in axes else key for key in keys]
    twice = [key for key in keys if key in POSE_KEYS and keys.count(key) > 1]
    if twice:
        raise FileProblem(f"expected each column once, got {told(twice[0])} twice")
    return keys, words


def _cells(line: str, separator: str | None) -> list[str]:
    cells = [cell.strip().strip("\"'[](){}").strip() for cell in line.split(separator)]
    # A comma is the decimal point where semicolons or tabs separate.
    return [c.replace(",", ".") for c in cells] if separator in (";", "\t") else cells


def _is_number(cell: str) -> bool:
    return re.fullmatch(NUMBER, cell) is not None


def _unnamed(row: Sequence[str]) -> Written:
    """A row without a header: a name, perhaps, and the numbers."""
    name = "" if _is_number(row[0]) else row[0]
    cells = list(row[1:] if name else row)
    wrong = [cell for cell in cells if not _is_number(cell)]
    if wrong:
        raise FileProblem(f"expected numbers, got {told(wrong[0]) or 'an empty cell'}")
    return Written([float(cell) for cell in cells], name=name)


def _columns(header: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Names of columns without their units, and these units."""
    keys, words = [], []
    for cell in header:
        name = cell.lower().strip()
        unit = UNIT.search(name)
        if unit is not None and name[: unit.start()]:
            words.append(UNIT_WORDS.get(unit[1], unit[1]))
            name = name[: unit.start()]
        name = re.split(r"[./]", name)[-1] if not _grouped(name) else _grouped(name)
        keys.append(SPELLINGS.get(name, name))
    return keys, tuple(dict.fromkeys(words))


def _grouped(name: str) -> str:
    """Name of a part of a group, such as qx for orientation.x; empty for others."""
    parts = re.split(r"[./]", name)
    if len(parts) > 1 and parts[-2] in GROUPS and parts[-1] in (*PLACE, "w"):
        return f"q{parts[-1]}"
    return ""


def _of_columns(numbers: Sequence[tuple[str, float]], name: str, words: tuple[str, ...]) -> Written:
    """A pose of named columns; the names of matrices are left to their order."""
    keys = tuple(key for key, _ in numbers)
    values = [value for _, value in numbers]
    if not set(PLACE) <= set(keys) and len(values) in MATRIX_SIZES:
        return Written(values, (), name, words)
    return Written(values, keys, name, words)


def _from_json(text: str) -> list[Written]:
    content = json.loads(text)
    words: tuple[str, ...] = ()
    if isinstance(content, Mapping):
        said = content.get("poses_as", content.get("convention", ""))
        if not isinstance(said, str):
            raise FileProblem(f"expected words in poses_as, got {told(said)}")
        words = tuple(word for word in said.lower().split(":") if word)
        content = content.get("poses", content)
    if isinstance(content, Mapping):
        rest = {k: v for k, v in content.items() if k not in ("poses_as", "convention")}
        return [_with(_of_json(value), words, str(key)) for key, value in rest.items()]
    if not isinstance(content, list):
        raise FileProblem(f"expected a list of poses, got {told(content)}")
    return [_with(_of_json(one), words) for one in content]


def _with(pose: Written, words: tuple[str, ...], name: str = "") -> Written:
    pose.words = (*words, *pose.words)
    pose.name = pose.name or name
    return pose


def _of_json(value: Any) -> Written:
    """A pose as JSON has it: numbers, a matrix, or named parts."""
    if isinstance(value, list):
        return Written(_flat(value))
    if not isinstance(value, Mapping):
        raise FileProblem(f"expected a pose, got {told(value)}")
    parts, units = _without_units(value)
    name = next((str(parts[k]) for k in NAMES if isinstance(parts.get(k), str | int)), "")
    shift = next((parts[k] for k in SHIFTS if isinstance(parts.get(k), list | dict)), None)
    turn = next((parts[k] for k in GROUPS if isinstance(parts.get(k), list | dict)), None)
    if shift is not None and turn is not None:
        return _with(_of_parts(shift, turn), units, name)
    for key, part in parts.items():
        order = ORDER.fullmatch(key)
        if order is not None and shift is not None and isinstance(part, list):
            return _with(_of_parts(shift, part), (order[1], *units), name)
    for key in WRAPPERS:
        if isinstance(parts.get(key), list | dict):
            said = (DIRECTIONS[key],) if key in DIRECTIONS else ()
            return _with(_of_json(parts[key]), said, name)
    numbers = [(k, v) for k, v in parts.items() if _plain(v)]
    if not numbers:
        raise FileProblem(f"expected the numbers of a pose, got {told(', '.join(parts))}")
    keys, words = _columns([key for key, _ in numbers])
    chosen = [(k, float(v)) for k, (_, v) in zip(keys, numbers, strict=True) if k not in NAMES]
    return _of_columns(chosen, name, words)


def _without_units(value: Mapping[Any, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Parts of a pose by their names in small letters, and the units in names of whole groups."""
    parts: dict[str, Any] = {}
    units = []
    for key, part in value.items():
        name = str(key).lower()
        unit = UNIT.search(name) if isinstance(part, list | dict) else None
        # Something stands before the unit: "transform" does not end with metres.
        if unit is not None and name[: unit.start()] and unit[0] != unit[1]:
            units.append(UNIT_WORDS.get(unit[1], unit[1]))
            name = name[: unit.start()]
        parts[name] = part
    return parts, tuple(units)


def _plain(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _of_parts(shift: Any, turn: Any) -> Written:
    """A pose of a position and a rotation, each a list or with names."""
    place = _flat([shift[k] for k in PLACE] if isinstance(shift, Mapping) else shift)
    if len(place) != 3:
        raise FileProblem(f"expected three numbers of a position, got {len(place)}")
    if isinstance(turn, Mapping):
        parts = {str(key).lower(): value for key, value in turn.items()}
        if set(parts) >= {*PLACE, "w"}:
            parts = {f"q{key}": parts[key] for key in ("w", *PLACE)}
        keys, words = _columns(list(parts))
        return Written([*place, *_flat(list(parts.values()))], (*PLACE, *keys), words=words)
    numbers = _flat(turn)
    if len(numbers) == 9:
        rows = [[*numbers[3 * k : 3 * k + 3], place[k]] for k in range(3)]
        return Written(_flat(rows), kinds=("rows",) if _nested(turn) else None)
    return Written([*place, *numbers])


def _nested(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def _flat(value: Iterable[Any]) -> list[float]:
    """All numbers of nested lists."""
    found: list[float] = []
    for one in value:
        if isinstance(one, list):
            found += _flat(one)
        elif _plain(one):
            found.append(float(one))
        else:
            raise FileProblem(f"expected numbers, got {told(one)}")
    return found
