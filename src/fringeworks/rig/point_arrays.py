"""The arrays that the kernel of triangulation reads and writes."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.types import CoordinateMap, InputError, PointCloud, check_reusable, unsealed

FIELDS = {
    "xyz": "xyz_mm",
    "sigma": "sigma_mm",
    "noise": "noise_mm",
    "reason": "reason",
    "residual": "residual_px",
}
"""Names of the kernel's arrays and the fields of a ``PointCloud`` that hold them."""


def input_arrays(found: CoordinateMap | None) -> _core._AxisMaps | None:
    """The maps of one axis as the kernel reads them."""
    if found is None:
        return None
    return {
        "coordinate": np.ascontiguousarray(found.coordinate_px, np.float32),
        "sigma": np.ascontiguousarray(found.sigma_px, np.float32),
        "reason": np.ascontiguousarray(found.reason, np.uint8),
    }


def empty_arrays(shape: tuple[int, int], both: bool) -> dict[str, Any]:
    """New arrays for the kernel to write to."""
    return {
        "xyz": np.empty((*shape, 3), np.float32),
        "sigma": np.empty(shape, np.float32),
        "noise": np.empty(shape, np.float32),
        "reason": np.empty(shape, np.uint8),
        "residual": np.empty(shape, np.float32) if both else None,
    }


def reused_arrays(out: PointCloud, shape: tuple[int, int], both: bool) -> dict[str, Any]:
    """The arrays of an earlier result, writable again."""
    if out.shape != shape or (out.residual_px is not None) != both:
        raise InputError(f"out: expected a point cloud of {shape} from as many axes, got another")
    arrays = {name: getattr(out, field) for name, field in FIELDS.items()}
    kept = {name: array for name, array in arrays.items() if array is not None}
    expected = {
        name: (
            (*shape, 3) if name == "xyz" else shape,
            np.uint8 if name == "reason" else np.float32,
        )
        for name in kept
    }
    check_reusable(kept, expected)
    return {name: None if array is None else unsealed(array) for name, array in arrays.items()}
