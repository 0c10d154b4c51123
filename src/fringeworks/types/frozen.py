"""The base of all frozen types: they own read-only arrays, compare by value and print shortly."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import combinations
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.checks import check_layout, masks_exist, unmasked
from fringeworks.types.errors import InputError

SHOWN_ITEMS = 6
"""Items of a tuple or dictionary that ``repr`` shows; a few fit on one line."""
SHOWN_LETTERS = 200
"""Letters of one field that ``repr`` shows, so that no field fills the screen."""

Array = TypeVar("Array", bound=NDArray[Any])


@dataclass(frozen=True, eq=False, repr=False)
class Frozen:
    """Base of the frozen types.

    Arrays are copied and made read-only when an object is made, so that nobody can change it from
    outside. Arrays that are read-only already, all the way down to the memory they view, are kept.
    Two objects are equal if their types and all fields are, with NaN equal to NaN.

    Raises
    ------
    InputError for arrays that do not follow the layout of the type.
    """

    layout: ClassVar[Mapping[str, str]] = {}
    """Types and shapes of the arrays by name; see ``check_layout``."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if masks_exist():
                value = _unmasked(value, field.name)
            object.__setattr__(self, field.name, _owned(value))
        check_layout(vars(self), self.layout)

    def __repr__(self) -> str:
        shown = [f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if f.repr]
        name = type(self).__name__
        line = f"{name}({', '.join(shown)})"
        return line if len(line) <= 100 else f"{name}(\n  " + ",\n  ".join(shown) + "\n)"

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        names = [f.name for f in fields(self) if f.compare]
        return all(_equal(getattr(self, n), getattr(other, n)) for n in names)

    def __hash__(self) -> int:
        values = (_hashable(getattr(self, f.name)) for f in fields(self) if f.compare)
        return hash((type(self).__name__, *values))

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Unpickled arrays are new and writable.
        for name, value in state.items():
            object.__setattr__(self, name, _owned(value))


def _unmasked(value: Any, name: str) -> Any:
    """A field without a masked array, also in mappings and sequences; refused where it masks."""
    if isinstance(value, np.ma.MaskedArray):
        return unmasked(value, name)
    inner = value.values() if type(value) is dict else value if type(value) in (list, tuple) else ()
    for one in inner:
        _unmasked(one, name)
    return value


def sealed(array: Array) -> Array:
    """Make an array, and the arrays whose memory it views, read-only; return it.

    For arrays that the package has just made: a frozen type keeps them without a copy.
    """
    part: Any = array
    while isinstance(part, np.ndarray):
        part.setflags(write=False)
        part = part.base
    return array


def unsealed(array: Array) -> Array:
    """Make an array of a frozen type writable again; return it.

    For ``out`` arguments only: the object that held the array is not valid afterwards.

    Raises
    ------
    InputError where the memory cannot be written to, such as a file that is mapped for reading.
    """
    chain: list[NDArray[Any]] = []
    part: Any = array
    while isinstance(part, np.ndarray):
        chain.append(part)
        part = part.base
    try:
        for view in reversed(chain):
            view.setflags(write=True)
    except ValueError as error:
        raise InputError("out: expected memory that can be written to, got read-only") from error
    return array


def check_reusable(
    arrays: Mapping[str, NDArray[Any]], expected: Mapping[str, tuple[tuple[int, ...], type]]
) -> None:
    """Refuse arrays of an earlier result that a kernel cannot write to.

    Parameters
    ----------
    arrays : arrays by name
    expected : shape and type of each, by the same names

    Raises
    ------
    InputError for another shape, type or byte order, strides, and arrays that share memory.
    """
    for name, (shape, kind) in expected.items():
        array = arrays[name]
        if array.shape != shape or array.dtype != kind:
            raise InputError(
                f"out: expected {name} as {np.dtype(kind)} {shape}, got {array.dtype} {array.shape}"
            )
        if not (array.flags.c_contiguous and array.flags.aligned):
            raise InputError(f"out: expected {name} contiguous by rows, got a strided array")
    for one, other in combinations(arrays, 2):
        if np.may_share_memory(arrays[one], arrays[other]):
            raise InputError(f"out: expected {one} and {other} in memory of their own, got shared")


def fingerprint(value: Any) -> str:
    """SHA-256 of a value: a frozen type, an array, or a tuple of them, as hexadecimal digits.

    Equal values have equal fingerprints on every machine. The field ``provenance`` does not count.
    """
    state = hashlib.sha256()
    _feed(state, value)
    return state.hexdigest()


def _feed(state: Any, value: Any) -> None:
    if hasattr(value, "__dataclass_fields__"):
        state.update(type(value).__name__.encode())
        for field in fields(value):
            if field.name != "provenance":
                state.update(field.name.encode())
                _feed(state, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        state.update(f"{value.dtype.newbyteorder('<').str}{value.shape}".encode())
        little = value.astype(value.dtype.newbyteorder("<"), copy=False)
        state.update(np.ascontiguousarray(little).data)
    elif isinstance(value, (tuple, list)):
        state.update(f"({len(value)}".encode())
        for item in value:
            _feed(state, item)
    elif isinstance(value, dict):
        _feed(state, tuple(sorted(value.items())))
    else:
        state.update(f"{type(value).__name__}:{value!r};".encode())


def _is_sealed(array: NDArray[Any]) -> bool:
    part: Any = array
    while isinstance(part, np.ndarray):
        if part.flags.writeable:
            return False
        part = part.base
    return True


def _owned(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value if _is_sealed(value) else sealed(np.array(value, order="C"))
    if isinstance(value, dict):
        return {name: _owned(item) for name, item in value.items()}
    # A tuple or list of arrays; named tuples are left alone.
    if type(value) in (tuple, list) and any(isinstance(item, np.ndarray) for item in value):
        return tuple(_owned(item) for item in value)
    return value


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _short_array(value)
    if isinstance(value, Frozen):
        text = repr(value)
        return text if "\n" not in text else f"{type(value).__name__}(…)"
    if type(value) in (tuple, list):
        shown = [_short(item) for item in value[:SHOWN_ITEMS]]
        if len(value) > SHOWN_ITEMS:
            shown.append(f"… {len(value)} in all")
        inside = ", ".join(shown) + ("," if len(value) == 1 else "")
        text = f"({inside})" if type(value) is tuple else f"[{inside}]"
    elif isinstance(value, dict):
        names = list(value)[:SHOWN_ITEMS]
        more = ", …" if len(value) > SHOWN_ITEMS else ""
        text = "{" + ", ".join(f"{name!r}: {_short(value[name])}" for name in names) + more + "}"
    else:
        text = repr(value)
    return text if len(text) <= SHOWN_LETTERS else text[: SHOWN_LETTERS - 1] + "…"


def _short_array(array: NDArray[Any]) -> str:
    text = f"{array.dtype} {array.shape}"
    if array.dtype.kind not in "fiu" or array.size == 0:
        return f"<{text}>"
    finite = array[np.isfinite(array)] if array.dtype.kind == "f" else array
    if finite.size == 0:
        return f"<{text}, no finite value>"
    text += f", {finite.min():.5g} … {finite.max():.5g}"
    missing = array.size - finite.size
    return f"<{text}, {missing / array.size:.2%} not finite>" if missing else f"<{text}>"


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)):
            return False
        if one.dtype != other.dtype or one.shape != other.shape:
            return False
        return bool(np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
    if type(one) in (tuple, list) and type(one) is type(other):
        return len(one) == len(other) and all(map(_equal, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_equal(one[k], other[k]) for k in one)
    if isinstance(one, float) and isinstance(other, float) and one != one and other != other:
        return True
    return bool(one == other)


def _hashable(value: Any) -> Any:
    """Something that is equal for equal values; arrays count by shape and type only."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str
    if type(value) in (tuple, list):
        return tuple(_hashable(item) for item in value)
    if isinstance(value, dict):
        return tuple(sorted(str(name) for name in value))
    return 0.0 if isinstance(value, float) and value != value else value
