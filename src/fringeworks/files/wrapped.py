"""Wrapped phases on disk: one ``.npz`` with the maps and, where asked for, the unwrapped phase."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target
from fringeworks.files.findings import findings_as_json, findings_from_json
from fringeworks.files.limits import parsing
from fringeworks.files.npz import TEXT, read_npz, write_npz
from fringeworks.files.provenance import KEY, from_json, json_line
from fringeworks.pair.unwrap import Unwrapped
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.types import CameraNoise, sealed

MAPS = ("phase_rad", "sigma_rad", "modulation", "background", "reason")
"""Maps of a wrapped phase."""
LAYOUT = dict.fromkeys(MAPS, "f hw") | {
    "reason": "u hw",
    "shifts_rad": "f n",
    "noise": "f 2",
    "findings": TEXT,
    KEY: f"?{TEXT}",
}
"""Layout of a file."""


def write_phase(path: StrPath, wrapped: WrappedPhase, unwrapped: Unwrapped | None = None) -> Path:
    """Write a wrapped phase as ``.npz``, whole or not at all.

    Arrays ``phase_rad``, ``sigma_rad``, ``modulation``, ``background``, ``reason``, ``shifts_rad``,
    ``noise`` (read, gain) and ``findings`` (JSON); with an unwrapped phase also ``unwrapped_rad``,
    ``region`` and ``converged``.
    """
    check_target(path, (".npz",))
    noise = wrapped.noise
    arrays: dict[str, Any] = {name: getattr(wrapped, name) for name in MAPS}
    arrays |= {
        "shifts_rad": np.array(wrapped.shifts_rad),
        "noise": np.array([noise.read_counts, noise.gain]),
        "findings": np.array(findings_as_json(wrapped.findings)),
    }
    if unwrapped is not None:
        arrays |= {
            "unwrapped_rad": unwrapped.phase,
            "region": unwrapped.region,
            "converged": np.array(unwrapped.converged),
        }
    origin = json_line(wrapped.provenance)
    if origin is not None:
        arrays[KEY] = origin
    write_npz(path, arrays, compressed=False)
    return Path(path)


def read_phase(path: StrPath) -> WrappedPhase:
    """Read a wrapped phase.

    Raises
    ------
    FileProblem where there is no such file, or it holds no wrapped phase.
    """
    path = Path(path)
    arrays = read_npz(path, "a wrapped phase", LAYOUT)
    with parsing(path, "a wrapped phase"):
        read_counts, gain = (float(v) for v in arrays["noise"])
        return WrappedPhase(
            **{name: sealed(arrays[name]) for name in MAPS},
            shifts_rad=tuple(float(v) for v in arrays["shifts_rad"]),
            noise=CameraNoise(read_counts, gain),
            findings=findings_from_json(str(arrays["findings"])),
            provenance=from_json(str(arrays[KEY])) if KEY in arrays else None,
        )
