"""The distributions that a default install brings, with their licences."""

from __future__ import annotations

import importlib.metadata as metadata
import re
from dataclasses import dataclass

try:
    from packaging.requirements import Requirement
except ModuleNotFoundError:  # an environment of the default install has pip's own copy only
    from pip._vendor.packaging.requirements import Requirement

PERMISSIVE = (
    "MIT",
    "BSD",
    "APACHE",
    "ISC",
    "PSF",
    "PYTHON",
    "HPND",
    "0BSD",
    "ZLIB",
    "UNLICENSE",
    "CC0",
    "BSL-1.0",
)
"""Words that name a permissive licence, in capitals."""


@dataclass(frozen=True)
class Installed:
    """One installed distribution."""

    name: str
    version: str
    licence: str

    @property
    def permissive(self) -> bool:
        """Whether every licence that it names is permissive. Alternatives need one that is."""
        alternatives = re.split(r"\bOR\b", self.licence.upper())
        return any(
            all(any(word in part for word in PERMISSIVE) for part in re.split(r"\bAND\b|,", choice))
            for choice in alternatives
        )


def of_default_install(name: str = "fringeworks") -> list[Installed]:
    """What a name requires without extras on this machine, itself first, others in order."""
    found: dict[str, Installed] = {}
    waiting = [name]
    while waiting:
        key = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        if key in found:
            continue
        distribution = metadata.distribution(key)
        found[key] = Installed(
            distribution.metadata["Name"], distribution.version, licence_of(distribution)
        )
        for text in distribution.requires or ():
            required = Requirement(text)
            if required.marker is None or required.marker.evaluate({"extra": ""}):
                waiting.append(required.name)
    first, *others = found.values()
    return [first, *sorted(others, key=lambda d: d.name.lower())]


def licence_of(distribution: metadata.Distribution) -> str:
    """Licence as the distribution states it: an expression, its classifiers, or the first line."""
    data = distribution.metadata
    if expression := data.get("License-Expression"):
        return str(expression)
    classes = [c for c in data.get_all("Classifier", []) if c.startswith("License ::")]
    named = [c.rsplit("::", 1)[1].strip() for c in classes if c.count("::") > 1]
    if named:
        return ", ".join(named)
    return str(data.get("License") or "").strip().split("\n")[0] or "not stated"
