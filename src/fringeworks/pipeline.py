"""The chain from a capture to a surface, in one readable function."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringeworks.analysis import analyse, prepare
from fringeworks.denoise import Denoiser
from fringeworks.denoise import denoise as denoise_frame
from fringeworks.geometry import to_surface
from fringeworks.types import Capture, Decoded, HeightMap, PhaseMap, Reason, count_reasons


@dataclass(frozen=True)
class Reconstruction:
    """What came of a capture."""

    surface: HeightMap
    phase: PhaseMap
    seconds: float
    notes: tuple[str, ...] = ()


def reconstruct(
    capture: Capture,
    method: str = "windowed",
    *,
    denoise: Denoiser | None = None,
    **options: Any,
) -> Reconstruction:
    """Measure the surface of a capture.

    Parameters
    ----------
    capture : Capture
        Reference and object frame, with the geometry where it is known.
    method : str
        A name from ``fringeworks.methods()``.
    denoise : "emd", "emd2d" or "bemd", optional
        Take the modes that are no stronger than noise off both frames first.
    **options
        Keyword options of the method.

    Returns
    -------
    Reconstruction with heights in mm, or, without a geometry, displacements in px.

    Raises
    ------
    InputError for frames, methods or options that cannot be used.

    Examples
    --------
    >>> from fringeworks.simulate import standard_scene
    >>> scene = standard_scene("parabola", size=200, fringes=8, bits=8, noise=1, seed=1)
    >>> result = reconstruct(scene)
    >>> bool(abs(np.nanmax(result.surface.values) - 100) < 3)
    True
    """
    started = time.perf_counter()
    pair = prepare(capture)
    if denoise is not None:
        pair = replace(
            pair,
            # A reference made up from the background has no noise.
            reference=pair.reference
            if capture.reference is None
            else denoise_frame(pair.reference, denoise),
            object=denoise_frame(pair.object, denoise),
        )
    phase = analyse(pair, method, **options)
    surface = to_surface(phase, capture.geometry)
    return Reconstruction(surface, phase, time.perf_counter() - started, _notes(capture, phase))


def _notes(capture: Capture, phase: PhaseMap) -> tuple[str, ...]:
    notes = list(capture.notes)
    if capture.axis is None:
        notes.append(
            f"fringes found along {phase.axis} with a period of {phase.period_px:.2f} px, "
            f"tilted by {phase.tilt_deg:.2f}°"
        )
    if capture.reference is None:
        notes.append("no reference frame: measured against the plain fringe of the background")
    if "unwrapping" in phase.details:
        notes.append(
            "phase unwrapped by {unwrapping}: {residues} residues, {regions} connected regions, "
            "{pixels_moved_by_counting} pixels moved by counting".format(**phase.details)
        )
    if capture.geometry is None:
        notes.append("geometry unknown: the result is a displacement in px, not a height")
    return tuple(notes)


def summary(result: Reconstruction) -> dict[str, Any]:
    """Figures of a reconstruction that need no truth, ready for JSON."""
    surface = result.surface
    finite = np.isfinite(surface.values)
    values, sigma = surface.values[finite], surface.sigma[finite]
    return {
        "method": surface.method,
        "quantity": surface.quantity,
        "unit": surface.unit,
        "shape": list(surface.shape),
        "axis": result.phase.axis,
        "period_px": result.phase.period_px,
        "tilt_deg": result.phase.tilt_deg,
        "failed_fraction": surface.failed_fraction,
        "reasons": count_reasons(surface.reason),
        "minimum": float(values.min()) if values.size else None,
        "maximum": float(values.max()) if values.size else None,
        "median": float(np.median(values)) if values.size else None,
        "median_sigma": float(np.median(sigma)) if sigma.size else None,
        "seconds": result.seconds,
        "notes": list(result.notes),
    }


def decoded_summary(decoded: Decoded, notes: tuple[str, ...] = ()) -> dict[str, Any]:
    """Figures of decoded coordinates, ready for JSON."""
    axes = {}
    for axis, found in decoded.maps.items():
        ok = found.reason == Reason.OK
        values, sigma = found.coordinate_px[ok], found.sigma_px[ok]
        axes[axis] = {
            "periods_px": list(found.periods_px),
            "repeats_px": found.repeats_px,
            "failed_fraction": found.failed_fraction,
            "reasons": count_reasons(found.reason),
            "minimum_px": float(values.min()) if values.size else None,
            "maximum_px": float(values.max()) if values.size else None,
            "median_sigma_px": float(np.median(sigma)) if sigma.size else None,
            "median_modulation": float(np.median(found.modulation[ok])) if ok.any() else None,
            **decoded.details.get(axis, {}),
        }
    some = next(iter(decoded.maps.values()))
    return {
        "shape": list(some.coordinate_px.shape),
        "noise": {"read_counts": decoded.noise.read_counts, "gain": decoded.noise.gain},
        "axes": axes,
        "notes": [*notes, *decoded.notes],
    }
