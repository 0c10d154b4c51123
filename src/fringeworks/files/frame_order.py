"""The order of a folder's images: by the labels in their names, or else by name."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from filecmp import cmp
from itertools import pairwise
from pathlib import Path

from fringeworks.patterns.other_cells import cells_for_count
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import FramesContradictPlan

BINARY_COUNTERS = (2**8 - 1, 2**12 - 1, 2**16 - 1)
"""Largest values of counters in whole bytes, or of 12 bits, from which cameras begin again at 0."""


FEWEST_DIGITS = 4
"""Digits of the counter in names by the standard DCF (JEITA CP-3461): four letters or digits in
front do not count."""
MOST_COPIES = 3
"""At most this many copies are named."""
EXIF_SUFFIXES = (".jpg", ".jpeg")
"""Images whose EXIF Pillow reads."""
EXIF_PART, ORIGINAL, SUBSECOND = 0x8769, 0x9003, 0x9291
"""Tags of the EXIF part, DateTimeOriginal and SubSecTimeOriginal (CIPA DC-008)."""


def by_name(paths: Sequence[Path]) -> list[Path]:
    """Sort paths by name, numbers in the names by their value."""
    return sorted(
        paths,
        key=lambda p: [
            (0, int(part), "") if part.isdigit() else (1, 0, part) for part in _parts(p.name)
        ],
    )


def in_plan_order(
    paths: Sequence[Path], plan: PatternPlan, folder: Path, *, listed: bool
) -> tuple[list[Path], list[str]]:
    """Put images into the order of their plan.

    Parameters
    ----------
    paths : images in the order of their names, or in the order of a list
    plan : PatternPlan
    folder : path
        For messages.
    listed : bool
        Whether the user gave the order. It is kept; labels that contradict it are an error.

    Returns
    -------
    paths : images in the order of the plan
        By the labels in their names where every name carries one; otherwise in the given order, or
        by the times in EXIF where names tell none.
    notes : one sentence if labels, wraps or times changed the order

    Raises
    ------
    FramesContradictPlan
        If the number of images is not the plan's. The message names the missing frames as far as
        labels or numbers in the names tell them.
    """
    labels = plan.picture_labels()
    carried = _labels_of(paths, labels)
    if len(paths) != len(labels):
        few = len(paths) < len(labels)
        kind = "pictures" if plan.colours else "frames"
        why = _missing(paths, labels, carried) if few else _extra(paths, labels) or _equal(paths)
        whole = carried is None and not plan.colours and _count_on(paths, why)
        fit = cells_for_count(plan, len(paths)) if whole else ""
        raise FramesContradictPlan(
            f"{folder}: the plan has {len(labels)} {kind}, got {len(paths)} images{why}{fit}"
        )
    if carried == labels:
        return list(paths), []
    if carried is None:
        return (list(paths), []) if listed else _as_taken(paths)
    if listed:
        k = next(k for k, label in enumerate(labels) if carried[k] != label)
        raise FramesContradictPlan(
            f"{folder}: expected {labels[k]} as frame {k} of the list, got {paths[k].name}, whose "
            f"name carries the label {carried[k]}"
        )
    waiting: dict[str, list[Path]] = {}
    for path, label in zip(paths, carried, strict=True):
        waiting.setdefault(label, []).append(path)
    note = "frames put into the order of the plan by the labels in their names"
    return [waiting[label].pop(0) for label in labels], [note]


def _parts(name: str) -> list[str]:
    """A name in parts: text, number, text, …"""
    return re.split(r"(\d+)", name)


def _labels_of(paths: Sequence[Path], labels: list[str]) -> list[str] | None:
    """The label in the name of every image; None unless the names tell which frame each one is.

    Names tell that if each carries a label, and no label occurs more often than in the plan.
    """
    # The longest label first: "x-gray-1-inverse" also contains "x-gray-1".
    known = sorted(set(labels), key=lambda label: (-len(label), label))
    # A label ends where its number ends. An inverse bit does not stand for the bit itself.
    patterns = {
        label: re.compile(rf"(?<![0-9A-Za-z.]){re.escape(label)}(?![0-9A-Za-z.]|-inverse)")
        for label in known
    }
    found = []
    for path in paths:
        carried = next((name for name in known if patterns[name].search(path.stem)), None)
        if carried is None:
            return None
        found.append(carried)
    return None if Counter(found) - Counter(labels) else found


def _as_taken(paths: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Images by their running number, from where it wraps on, by the largest value or by the times
    in EXIF, and a note that says so."""
    numbered = _running_number(paths)
    first = 0 if numbered is None else _after_wrap(numbered[0], numbered[3])
    taken = [*paths[first:], *paths[:first]]
    by_time = _by_time(taken)
    if by_time != taken:
        return _timed(taken, by_time, numbered is not None)
    wrapped = (
        f"the numbers in the names wrap: frames taken from {taken[0].name} to {taken[-1].name}"
    )
    return taken, [wrapped] if first else []


def _by_time(paths: Sequence[Path]) -> list[Path]:
    """Images in the order in which they were taken; unchanged where they do not tell it."""
    times = _times_of(paths)
    if times is None:
        return list(paths)
    return [paths[k] for k in sorted(range(len(paths)), key=lambda k: times[k])]


def _times_of(paths: Sequence[Path]) -> list[tuple[str, float]] | None:
    """Date and time with its fraction of a second of every image, in a form that sorts; None where
    one has none, or two have the same."""
    from PIL import Image

    if any(path.suffix.lower() not in EXIF_SUFFIXES for path in paths):
        return None
    found = []
    for path in paths:
        try:
            with Image.open(path) as image:
                part = image.getexif().get_ifd(EXIF_PART)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            return None  # reading the image says what is wrong with it
        when = str(part.get(ORIGINAL, "")).strip("\0 ")
        digits = str(part.get(SUBSECOND, "")).strip("\0 ")
        if not when[:4].isdigit():
            return None
        found.append((when, float(f"0.{digits}") if digits.isdecimal() else 0.0))
    return found if len(set(found)) == len(found) else None


def _timed(named: list[Path], by_time: list[Path], numbered: bool) -> tuple[list[Path], list[str]]:
    """The order of images whose time stamps contradict their names, and a note."""
    ends = f"{by_time[0].name} to {by_time[-1].name}"
    first = named.index(by_time[0])
    if [*named[first:], *named[:first]] == by_time:
        return by_time, [f"the names wrap, by the times in EXIF: frames taken from {ends}"]
    if not numbered:
        return by_time, [f"frames in the order of their times in EXIF, from {ends}"]
    return named, [
        "the times in EXIF contradict the numbers in the names, whose order was taken; list the "
        "frames in capture.toml where it is wrong"
    ]


def _after_wrap(numbers: Sequence[int], digits: int) -> int:
    """Place of the first image in names that wrap, sorted by their numbers; 0 where none wrap.

    Digits in front that all names have in common do not count: P1019999 is followed by P1010001.
    """
    gaps = [k + 1 for k, (a, b) in enumerate(pairwise(numbers)) if b - a > 1]
    if len(gaps) != 1:
        return 0
    for counting in range(min(FEWEST_DIGITS, digits), digits + 1):
        before, least = divmod(numbers[0], 10**counting)
        largest = numbers[-1] - before * 10**counting
        if least <= 1 and largest in (10**counting - 1, *(() if before else BINARY_COUNTERS)):
            return gaps[0]
    return 0


def _extra(paths: Sequence[Path], labels: list[str]) -> str:
    """Which images are too many, as the end of a message; empty where the names do not tell it."""
    kinds: dict[tuple[str, ...], list[Path]] = {}
    for path in paths:
        labelled = _labels_of([path], labels) is not None
        parts = [part for part in _parts(path.name) if not part.isdigit()]
        kinds.setdefault((path.suffix,) if labelled else tuple(parts), []).append(path)
    if any(len(kind) == len(labels) for kind in kinds.values()):
        others = [p.name for kind in kinds.values() if len(kind) != len(labels) for p in kind]
        return f"; not named like the others: {', '.join(others)}"
    return ""


def _equal(paths: Sequence[Path]) -> str:
    """End of a message: which images are copies of others; if none is, how to choose images."""
    seen: dict[int, list[Path]] = {}
    for path in paths:
        seen.setdefault(path.stat().st_size, []).append(path)
    copies = [
        f"{b.name} is a copy of {a.name}"
        for alike in seen.values()
        for k, b in enumerate(alike)
        for a in alike[:k]
        if cmp(a, b, shallow=False)
    ]
    if copies:
        return f"; {', '.join(copies[:MOST_COPIES])}"
    return (
        "; remove the images that do not belong to the capture, or list the frames as "
        "frames = [...] in capture.toml"
    )


def _count_on(paths: Sequence[Path], why: str) -> bool:
    """Whether names count on without a gap, and no image is said to be another's copy or to have
    another name: the folder may be whole."""
    numbered = _running_number(paths)
    if numbered is None or "not named like" in why or "is a copy of" in why:
        return False
    steps = {b - a for a, b in pairwise(numbered[0])}
    return len(steps) == 1


def _missing(paths: Sequence[Path], labels: list[str], carried: list[str] | None) -> str:
    """Which frames are missing, as the end of a message; empty where the names do not tell it."""
    if carried is not None:
        left = Counter(labels) - Counter(carried)
        return f"; missing: {', '.join(label for label in dict.fromkeys(labels) if left[label])}"
    numbered = _running_number(paths)
    if numbered is None:
        return ""
    numbers, before, after, digits = numbered
    step = math.gcd(*(b - a for a, b in pairwise(numbers))) or 1
    places = range(numbers[0], numbers[-1] + 1, step)
    gaps = [k for k, number in enumerate(places) if number not in set(numbers)]
    if len(places) > len(labels):
        return ""  # the numbers skip more than the plan has: they do not count its frames
    names = [f"{before}{places[k]:0{digits}d}{after}" for k in gaps]
    ends = len(labels) - len(places)
    if not ends:
        told = (f"{labels[k]} ({name})" for k, name in zip(gaps, names, strict=True))
        return f"; missing: {', '.join(told)}"
    few = f"{ends} frame{'s' if ends > 1 else ''} at the beginning or the end"
    if gaps:
        return f"; missing: {', '.join(names)}, and {few}"
    if numbers[0] == 0:
        return f"; missing: {', '.join(labels[-ends:])}"
    return f"; missing: {few}, as the numbers in the names have no gap"


def _running_number(paths: Sequence[Path]) -> tuple[list[int], str, str, int] | None:
    """The number that runs through the names, ascending; what stands before and after it; and its
    smallest number of digits.

    None unless the names differ in one number only.
    """
    names = [_parts(path.name) for path in paths]
    if len(names) < 2 or len({len(parts) for parts in names}) > 1:
        return None
    columns = list(zip(*names, strict=True))
    values = [tuple(int(p) for p in c) if c[0].isdigit() else c for c in columns]
    differing = [k for k, column in enumerate(values) if len(set(column)) > 1]
    if len(differing) != 1 or not columns[differing[0]][0].isdigit():
        return None
    k = differing[0]
    numbers = sorted(int(part) for part in columns[k])
    digits = min(len(part) for part in columns[k])
    if len(set(numbers)) < len(numbers):
        return None
    return numbers, "".join(names[0][:k]), "".join(names[0][k + 1 :]), digits
