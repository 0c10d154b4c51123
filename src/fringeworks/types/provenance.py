"""Where a result comes from: version, call, inputs with their hashes, date."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from typing import Any

from fringeworks import _core
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen, fingerprint

SHORT_HASH = 16
"""Hexadecimal digits by which options name a calibration: 64 bits tell any two apart."""


@dataclass(frozen=True, eq=False, repr=False)
class Source(Frozen):
    """One input of a result."""

    name: str
    """Name of the file, with the folder it lies in; or what the array was."""
    sha256: str
    """Of the file's bytes, or of the array's values; hexadecimal."""


@dataclass(frozen=True, eq=False, repr=False)
class Provenance(Frozen):
    """How a result was made. Two equal runs differ in ``date`` only."""

    call: str
    """The function of the library that made the result."""
    options: dict[str, Any] = field(default_factory=dict)
    """Its options, as JSON values; calibrations by their fingerprint."""
    inputs: tuple[Source, ...] = ()
    """Files or arrays that it was made from."""
    plan_sha256: str | None = None
    """Fingerprint of the plan, where there was one."""
    rig_sha256: str | None = None
    """Fingerprint of the rig, where there was one."""
    date: str = ""
    """Date and time in UTC, ISO 8601; from ``SOURCE_DATE_EPOCH`` where that is set."""
    version: str = _core.version
    """Version of fringeworks."""

    def as_dict(self) -> dict[str, Any]:
        """The provenance as JSON values."""
        return asdict(self) | {"inputs": [asdict(source) for source in self.inputs]}


def provenance_from(content: Mapping[str, Any]) -> Provenance:
    """The provenance that ``Provenance.as_dict`` made; ``InputError`` if it is none."""
    try:
        sources = tuple(Source(**item) for item in content["inputs"])
        return Provenance(**{**content, "inputs": sources})
    except (KeyError, TypeError) as error:
        raise InputError(f"provenance: expected its fields, got {error}") from error


def made_by(
    call: str,
    *,
    options: Mapping[str, Any],
    inputs: tuple[Source, ...] = (),
    plan: Any = None,
    rig: Any = None,
) -> Provenance:
    """The provenance of a result that is made now.

    Parameters
    ----------
    call : str
        Name of the function.
    options : mapping
        Its options; None is left out, frozen types become fingerprints.
    inputs : tuple of Source
    plan, rig : frozen types, optional
        Recorded by their fingerprints.

    Raises
    ------
    InputError where ``SOURCE_DATE_EPOCH`` is set and is no whole number of seconds.
    """
    known = {name: _plain(value) for name, value in options.items() if value is not None}
    return Provenance(
        call=call,
        options=known,
        inputs=inputs,
        plan_sha256=None if plan is None else fingerprint(plan),
        rig_sha256=None if rig is None else fingerprint(rig),
        date=today(),
    )


def today() -> str:
    """Date and time in UTC, ISO 8601, to the second; ``SOURCE_DATE_EPOCH`` pins it."""
    pinned = os.environ.get("SOURCE_DATE_EPOCH")
    if not pinned:
        return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    try:
        return datetime.fromtimestamp(int(pinned), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    except (ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"SOURCE_DATE_EPOCH: expected a whole number of seconds, got {pinned!r}"
        ) from error


def day(date: str) -> str:
    """A date of a provenance as people read it.

    Examples
    --------
    >>> day("2026-11-26T14:24:27Z")
    '2026-11-26 14:24 UTC'
    """
    return f"{date[:10]} {date[11:16]} UTC" if date.endswith("Z") else date


def _plain(value: Any) -> Any:
    if hasattr(value, "__dataclass_fields__"):
        values = {f.name: getattr(value, f.name) for f in fields(value)}
        if all(isinstance(item, (str, int, float, bool)) for item in values.values()):
            return {"type": type(value).__name__, **values}
        return f"{type(value).__name__} {fingerprint(value)[:SHORT_HASH]}"
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    return value if isinstance(value, (str, int, float, bool)) else str(value)
