"""Checks of numbers and arrays that types and functions share."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.arrays import Reason
from fringeworks.types.errors import InputError

LARGEST = 1e15
"""Largest magnitude of a single number that describes a device, a length or a brightness. No real
one comes near it, and its square fits single precision."""
MOST_PX = 1 << 16
"""Largest number of rows or columns of a frame, a camera or a projector: about that of JPEG. No
device has more, and tables with one entry per column stay small."""
MOST_SEED = 2**63 - 1
"""Largest seed of random choices: that of 64-bit whole numbers."""
NUMBERS = "fiu"
"""Kinds of arrays that hold real numbers: NumPy's letters."""


def finite(*values: object) -> bool:
    """Whether all values are real numbers of at most ``LARGEST``; False for what is no number."""
    if any(isinstance(value, str | bytes) for value in values):
        return False
    try:
        return all(abs(float(value)) <= LARGEST for value in values)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return False


def positive(*values: object) -> bool:
    """Whether all values are real numbers from 1/``LARGEST`` to ``LARGEST``."""
    return finite(*values) and all(float(value) >= 1 / LARGEST for value in values)  # type: ignore[arg-type]


def whole(value: object, low: float, high: float) -> bool:
    """Whether a value is a whole number of an integer type, from ``low`` to ``high``."""
    known = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return known and low <= value <= high  # type: ignore[operator]


def masks_exist() -> bool:
    """Whether this process can have masked arrays: NumPy loads their type, 10 ms, when it is
    named."""
    return "numpy.ma" in sys.modules


def unmasked(values: Any, name: str) -> NDArray[Any]:
    """Return the array of values, or of a sequence of arrays; a masked array of NumPy is refused
    where it masks something: its values there would count as measured.

    Raises
    ------
    InputError
    """
    if not masks_exist():
        return np.asarray(values)
    arrays = values if isinstance(values, list | tuple) else (values,)
    count = sum(np.count_nonzero(np.ma.getmaskarray(a)) for a in arrays if np.ma.is_masked(a))
    if count:
        raise InputError(
            f"{name}: expected an array without a mask of NumPy, got one with {count} masked "
            "values; fill them with NaN, or give mask"
        )
    return np.asarray(values)


def check_layout(values: Mapping[str, Any], layout: Mapping[str, str]) -> None:
    """Refuse arrays whose type or shape differs from their layout, and reasons that do not exist.

    Parameters
    ----------
    values : arrays by name
    layout : mapping of names to layouts
        The kinds of the array's type (NumPy's letters) and, after a space, its axes: a letter for a
        length, the same letter for the same length in all arrays, a digit for a fixed length.
        ``"f hw"`` is a map of floats, ``"f hw|hw3"`` either of two. With a question mark before it,
        the array may be None.

    Raises
    ------
    InputError for the first array that does not follow its layout.
    """
    lengths: dict[str, int] = {}
    for name, form in layout.items():
        array = values[name]
        if array is None and form.startswith("?"):
            continue
        kinds, _, axes = form.lstrip("?").partition(" ")
        if not isinstance(array, np.ndarray) or array.dtype.kind not in kinds:
            got = getattr(array, "dtype", type(array).__name__)
            raise InputError(f"{name}: expected {layout_words(kinds, axes)}, got {got}")
        if not any(fits_axes(array.shape, option, lengths) for option in axes.split("|")):
            known = ", ".join(f"{axis} = {length}" for axis, length in lengths.items())
            said = f" with {known}" if known else ""
            raise InputError(
                f"{name}: expected {layout_words(kinds, axes)}{said}, got shape {array.shape}"
            )
        if name == "reason" and array.size and not 0 <= array.min() <= array.max() < len(Reason):
            got = f"{array.min()} to {array.max()}"
            raise InputError(f"reason: expected values of 0 to {len(Reason) - 1}, got {got}")


def fits_axes(shape: tuple[int, ...], axes: str, lengths: dict[str, int]) -> bool:
    """Whether a shape follows the axes of a layout; the lengths of their letters are then known."""
    if len(shape) != len(axes):
        return False
    found = dict(lengths)
    for length, axis in zip(shape, axes, strict=True):
        if length != (int(axis) if axis.isdigit() else found.setdefault(axis, length)):
            return False
    lengths |= found
    return True


def layout_words(kinds: str, axes: str) -> str:
    """A layout in words."""
    words = {"f": "floats", "u": "unsigned integers", "b": "true or false", "US": "text"}
    options = " or ".join(f"({', '.join(option)})" for option in axes.split("|"))
    return f"{words.get(kinds, 'numbers')} of shape {options}"
