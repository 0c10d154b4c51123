"""Descriptions of what a file holds: tables with typed fields and limits.

Content that has the stated types is accepted here. Everything else is left to pydantic, which
converts what it can and names the fault: it takes 80 ms to load, and most files need none of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from fringeworks.files.limits import told


class DescriptionFault(ValueError):
    """Content that does not fit its description; the message names the first fault."""


class _Unfit(Exception):
    """A value that is not of the stated type, or beyond a limit."""


@dataclass(frozen=True)
class Limits:
    """Limits and default of a field; see ``Field``."""

    given: tuple[tuple[str, Any], ...]
    """Names and values of the limits, as pydantic's ``Field`` takes them."""
    default: Any = ...
    """The value where the field is left out; ``...`` where it is needed."""
    default_factory: Callable[[], Any] | None = None

    def check(self, value: Any) -> None:
        """Refuse a value beyond the limits. None, for a field that may be left out, has none."""
        if value is None:
            return
        for name, limit in self.given:
            if name in CHECKS and not CHECKS[name](value, limit):
                raise _Unfit


@dataclass(frozen=True)
class Tag:
    """A table's value of what tells the tables of a union apart; as pydantic's ``Tag``."""

    tag: str


@dataclass(frozen=True)
class Tagged:
    """How the tables of a union are told apart, for faults."""

    tag_of: Callable[[Any], Any]
    message: str
    """What is said where no table has the tag."""


CHECKS: dict[str, Callable[[Any, Any], bool]] = {
    "gt": lambda value, limit: value > limit,
    "ge": lambda value, limit: value >= limit,
    "le": lambda value, limit: value <= limit,
    "min_length": lambda value, limit: len(value) >= limit,
    "max_length": lambda value, limit: len(value) <= limit,
}
"""What each limit asks for. Types are always strict here, and unions are tried in their order."""


def Field(  # noqa: N802, named as in pydantic
    default: Any = ..., *, default_factory: Callable[[], Any] | None = None, **limits: Any
) -> Any:
    """Limits and default of a field: ``gt``, ``ge``, ``le``, ``min_length``, ``max_length``,
    ``strict`` and ``discriminator`` as pydantic's ``Field`` knows them."""
    return Limits(tuple(limits.items()), default, default_factory)


@dataclass_transform(eq_default=False, kw_only_default=True, field_specifiers=(Field,))
class Section:
    """A table of a file; unknown keys and numbers that are not finite are refused."""

    _given: ClassVar[tuple[str, ...]] = ()
    """Names of the fields that were given; set for each instance."""

    def __init__(self, **given: Any) -> None:
        for name, (_, limits) in _fields(type(self)).items():
            value = given[name] if name in given else _default(limits)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_given", tuple(given))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen: {name} cannot be set")

    @classmethod
    def checked(cls, content: object) -> Self:
        """The table with this content.

        Raises
        ------
        DescriptionFault that names the first fault.
        """
        try:
            return _table(cls, content)
        except (_Unfit, OverflowError):
            return _judged(cls, content)

    def as_dict(self, *, given_only: bool = False) -> dict[str, Any]:
        """The fields by name, tables within as well; only those that were given, without None."""
        names = self._given if given_only else _fields(type(self))
        found = {name: _as_dicts(getattr(self, name), given_only) for name in names}
        return {n: v for n, v in found.items() if not (given_only and v is None)}


def _as_dicts(value: Any, given_only: bool) -> Any:
    if isinstance(value, Section):
        return value.as_dict(given_only=given_only)
    if isinstance(value, (list, tuple)):
        return type(value)(_as_dicts(one, given_only) for one in value)
    if isinstance(value, dict):
        return {name: _as_dicts(one, given_only) for name, one in value.items()}
    return value


Kind = TypeVar("Kind", bound=Section)


def _default(limits: Limits) -> Any:
    if limits.default_factory is not None:
        return limits.default_factory()
    if limits.default is ...:
        raise TypeError("a field without default is missing")
    return limits.default


FIELDS: dict[type[Section], dict[str, tuple[Any, Limits]]] = {}
"""Type and limits of the fields of each description that was used."""
MODELS: dict[type[Section], Any] = {}
"""The same for pydantic, of those that had to be judged."""


def _fields(kind: type[Section]) -> dict[str, tuple[Any, Limits]]:
    """Type and limits of every field of a description."""
    if kind in FIELDS:
        return FIELDS[kind]
    hints = get_type_hints(kind, include_extras=True)
    found = {}
    for name, hint in hints.items():
        if name.startswith("_"):
            continue
        value = getattr(kind, name, ...)
        found[name] = (hint, value if isinstance(value, Limits) else Limits((), value))
    FIELDS[kind] = found
    return found


def _table(kind: type[Kind], content: object) -> Kind:
    if type(content) is kind:
        return content
    if not isinstance(content, dict):
        raise _Unfit
    fields = _fields(kind)
    given = {}
    for name, value in content.items():
        if name not in fields:
            raise _Unfit
        hint, limits = fields[name]
        given[name] = _accepted(hint, value)
        limits.check(given[name])
    if any(name not in given and _needed(limits) for name, (_, limits) in fields.items()):
        raise _Unfit
    return kind(**given)


def _needed(limits: Limits) -> bool:
    return limits.default is ... and limits.default_factory is None


def _accepted(hint: Any, value: Any) -> Any:
    """A value that has the stated type; whole numbers become floats where these are stated."""
    origin = get_origin(hint)
    if origin is not None:
        return COMPOSED[origin](get_args(hint), value)
    if hint is Any:
        return value
    if hint is float:
        if type(value) not in (int, float) or not math.isfinite(value):
            raise _Unfit
        return float(value)
    if isinstance(hint, type) and issubclass(hint, Section):
        return _table(hint, value)
    if type(value) is not hint:
        raise _Unfit
    return value


def _of_annotated(arguments: tuple[Any, ...], value: Any) -> Any:
    found = _accepted(arguments[0], value)
    for note in arguments[1:]:
        if isinstance(note, Limits):
            note.check(found)
    return found


def _of_union(arguments: tuple[Any, ...], value: Any) -> Any:
    """The first type that fits. Tables in unions differ by a literal, so no two of them fit."""
    for one in arguments:
        try:
            return _accepted(one, value)
        except _Unfit:
            continue
    raise _Unfit


def _of_literal(arguments: tuple[Any, ...], value: Any) -> Any:
    if not any(type(value) is type(one) and value == one for one in arguments):
        raise _Unfit
    return value


def _of_list(arguments: tuple[Any, ...], value: Any) -> Any:
    if not isinstance(value, (list, tuple)):
        raise _Unfit
    return [_accepted(arguments[0], one) for one in value]


def _of_tuple(arguments: tuple[Any, ...], value: Any) -> Any:
    if not isinstance(value, (list, tuple)):
        raise _Unfit
    if len(arguments) == 2 and arguments[1] is ...:
        return tuple(_accepted(arguments[0], one) for one in value)
    if len(value) != len(arguments):
        raise _Unfit
    return tuple(map(_accepted, arguments, value))


def _of_dict(arguments: tuple[Any, ...], value: Any) -> Any:
    if not isinstance(value, dict):
        raise _Unfit
    return {_accepted(arguments[0], k): _accepted(arguments[1], v) for k, v in value.items()}


COMPOSED: Mapping[Any, Callable[[tuple[Any, ...], Any], Any]] = {
    Annotated: _of_annotated,
    Union: _of_union,
    UnionType: _of_union,
    Literal: _of_literal,
    list: _of_list,
    tuple: _of_tuple,
    dict: _of_dict,
}
"""How values of each composed type are accepted."""


def _judged(kind: type[Kind], content: object) -> Kind:
    """What pydantic makes of content that is not of the stated types."""
    from pydantic import ValidationError

    try:
        found = _model(kind).model_validate(content)
    except ValidationError as error:
        raise DescriptionFault(_first_fault(error)) from error
    return _table(kind, _content(found))


def _content(found: Any) -> Any:
    """What pydantic's tables hold, where it was given, as Python's."""
    if isinstance(found, (list, tuple)):
        return type(found)(map(_content, found))
    if isinstance(found, dict):
        return {name: _content(value) for name, value in found.items()}
    if hasattr(found, "model_fields_set"):
        return {name: _content(getattr(found, name)) for name in found.model_fields_set}
    return found


def _first_fault(error: Any) -> str:
    fault = error.errors()[0]
    where = told(".".join(str(part) for part in fault["loc"]))
    if fault["type"] == "extra_forbidden":
        return f"unknown key {where}"
    if fault["type"] == "missing":
        return f"missing key {where}"
    return f"{where}: {fault['msg']}, got {told(repr(fault['input']))}"


def _model(kind: type[Section]) -> Any:
    """The same description for pydantic."""
    import pydantic

    if kind in MODELS:
        return MODELS[kind]
    config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    fields: dict[str, Any] = {
        name: (_translated(hint), _for_pydantic(limits))
        for name, (hint, limits) in _fields(kind).items()
    }
    MODELS[kind] = pydantic.create_model(kind.__name__, __config__=config, **fields)
    return MODELS[kind]


def _for_pydantic(limits: Limits | Tag | Tagged) -> Any:
    import pydantic

    if isinstance(limits, Tag):
        return pydantic.Tag(limits.tag)
    if isinstance(limits, Tagged):
        return pydantic.Discriminator(
            limits.tag_of, custom_error_type="tag", custom_error_message=limits.message
        )
    given = dict(limits.given)
    if limits.default_factory is not None:
        return pydantic.Field(default_factory=limits.default_factory, **given)
    default = limits.default
    if isinstance(default, Section):
        default = _model(type(default)).model_validate(default.as_dict())
    return pydantic.Field(**given) if default is ... else pydantic.Field(default, **given)


def _translated(hint: Any) -> Any:
    """A type with pydantic's models and fields in the place of ours."""
    origin, arguments = get_origin(hint), get_args(hint)
    if isinstance(hint, type) and origin is None and issubclass(hint, Section):
        return _model(hint)
    if isinstance(hint, (Limits, Tag, Tagged)):
        return _for_pydantic(hint)
    if origin is None or origin is Literal:
        return hint
    parts = tuple(one if one in (..., NoneType) else _translated(one) for one in arguments)
    return (Union if origin is UnionType else origin)[parts]
