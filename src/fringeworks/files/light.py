"""Direct and indirect light on disk: one ``.npz`` with the maps and how they were separated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target
from fringeworks.files.findings import findings_as_json, findings_from_json
from fringeworks.files.limits import parsing
from fringeworks.files.npz import TEXT, read_npz, write_npz
from fringeworks.files.provenance import KEY, from_json, json_line
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.types import sealed

MAPS = ("direct", "direct_sigma", "indirect", "indirect_sigma", "reason")
"""Maps of a separation."""
NUMBERS = ("period_px", "contrast", "has_black")
"""How the light was separated, in this order in the array ``separation``."""
LAYOUT = dict.fromkeys(MAPS, "f hw") | {
    "reason": "u hw",
    "separation": "f 3",
    "findings": TEXT,
    KEY: f"?{TEXT}",
}
"""Layout of a file."""


def check_light_target(path: StrPath) -> None:
    """Refuse a file that ``write_light`` cannot write, before anything is computed."""
    check_target(path, (".npz",))


def write_light(path: StrPath, light: LightSeparation) -> Path:
    """Write direct and indirect light as ``.npz``, whole or not at all.

    Arrays ``direct``, ``direct_sigma``, ``indirect``, ``indirect_sigma`` (counts), ``reason``,
    ``separation`` (period in projector px, contrast, 1 with a black frame) and ``findings`` (JSON).
    """
    check_light_target(path)
    arrays: dict[str, Any] = {name: getattr(light, name) for name in MAPS}
    arrays["separation"] = np.array([float(getattr(light, name)) for name in NUMBERS])
    arrays["findings"] = np.array(findings_as_json(light.findings))
    origin = json_line(light.provenance)
    if origin is not None:
        arrays[KEY] = origin
    write_npz(path, arrays, compressed=False)
    return Path(path)


def read_light(path: StrPath) -> LightSeparation:
    """Read direct and indirect light.

    Raises
    ------
    FileProblem where there is no such file, or it holds no separated light.
    """
    path = Path(path)
    arrays = read_npz(path, "separated light", LAYOUT)
    with parsing(path, "separated light"):
        period_px, contrast, has_black = (float(v) for v in arrays["separation"])
        return LightSeparation(
            **{name: sealed(arrays[name]) for name in MAPS},
            period_px=period_px,
            has_black=bool(has_black),
            contrast=contrast,
            findings=findings_from_json(str(arrays["findings"])),
            provenance=from_json(str(arrays[KEY])) if KEY in arrays else None,
        )
