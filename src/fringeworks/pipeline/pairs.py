"""Pair → heights, and the calibration of the two-frame path."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.pair.analyse import analyse
from fringeworks.pair.prepared import prepare
from fringeworks.pair.reference_plane import to_surface
from fringeworks.pair.registry import MethodOption
from fringeworks.pair.rim import Rim, measure_rim, with_unknown_zero, without_movement
from fringeworks.pair.shadow_orders import by_shadows
from fringeworks.pair.tears import without_tears
from fringeworks.pipeline.inputs import pair_of, sources_of
from fringeworks.pipeline.pair_findings import (
    frame_findings,
    free_findings,
    pair_findings,
    rim_findings,
    shadow_findings,
    tear_findings,
)
from fringeworks.rig.calibration.planes import (
    PixelCalibration,
    PlaneCalibration,
    calibrate_pixels,
    calibrate_reference_plane,
    height_by_pixel,
)
from fringeworks.signal.denoise import Denoiser
from fringeworks.signal.denoise import denoise as denoise_frame
from fringeworks.signal.response import Response, response_note
from fringeworks.surface.height_map import lateral_findings
from fringeworks.types import (
    DisplacementMap,
    Finding,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Noted,
    Pair,
    Plotted,
    ReferencePlaneGeometry,
    Source,
    as_notes,
    explained,
    made_by,
    unmasked,
)

Zero = Literal["rim", "reference"]
"""What tells where the displacement is 0."""


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(Noted, Plotted, Frozen):
    """The surface of a pair of frames."""

    surface: HeightMap
    """Heights in mm or, without a geometry, displacements in px; with their provenance."""
    displacement: DisplacementMap
    """Displacement of the fringes that the surface comes from."""
    seconds: float
    """Time that the analysis took."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found in the frames, and what was decided because of it."""
        return self.surface.findings

    @property
    def converged(self) -> bool:
        """Whether all iterations of the analysis converged."""
        return self.displacement.converged


def reconstruct(
    pair: Pair | StrPath,
    method: str = "windowed",
    *,
    geometry: ReferencePlaneGeometry | PixelCalibration | None = None,
    response: Response | None = None,
    denoise: Denoiser | None = None,
    zero: Zero = "rim",
    **options: MethodOption,
) -> Reconstruction:
    """Measure the surface of a pair of frames.

    Parameters
    ----------
    pair : Pair or path
        Reference and object frame, with the geometry where it is known; or a capture to read.
    method : str
        A name from ``fringeworks.methods()``.
    geometry : ReferencePlaneGeometry or PixelCalibration, optional
        Takes the place of the pair's own.
    response : Response, optional
        Both frames are linearised by it, after their saturated pixels were marked.
    denoise : "emd", "emd2d" or "bemd", optional
        Remove the modes of both frames that are no stronger than noise.
    zero : "rim" or "reference"
        "rim": where the rim of the frame shows the background, displaced, as by a camera that moved
        or a pattern that drifted, that displacement is removed everywhere, with a finding
        (``pair.background`` takes the place of the rim). "reference": the frames are compared as
        they are. A pair with a mask, and a single frame, are measured so as well.
    **options
        Keyword options of the method.

    Returns
    -------
    Reconstruction with heights in mm or, without a geometry, displacements in px.

    Raises
    ------
    InputError for frames, methods or options that cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> from fringeworks.simulate import standard_scene
    >>> scene = standard_scene("parabola", size=200, fringes=8, bits=8, noise=1, seed=1)
    >>> result = reconstruct(scene)
    >>> bool(abs(np.nanmax(result.surface.values) - 100) < 3)
    True
    """
    return reconstructed(
        pair, method, Asked(geometry, response, denoise, zero, shadows=True), options
    )


@dataclass(frozen=True)
class Asked:
    """What is asked for beside the method."""

    geometry: ReferencePlaneGeometry | PixelCalibration | None
    response: Response | None
    denoise: Denoiser | None
    zero: Zero
    shadows: bool
    """Whether shadows correct fringe orders; a range of depths knows more."""


def reconstructed(
    pair: Pair | StrPath, method: str, asked: Asked, options: Mapping[str, MethodOption]
) -> Reconstruction:
    """As ``reconstruct``."""
    geometry, response, denoise, zero = asked.geometry, asked.response, asked.denoise, asked.zero
    pair = pair_of(pair)
    if zero not in get_args(Zero):
        raise InputError(f"zero: expected rim or reference, got {zero!r}")
    if isinstance(geometry, ReferencePlaneGeometry):
        pair = replace(pair, geometry=geometry)
    sources = pair.sources or sources_of(
        reference=pair.reference, object=pair.object, black=pair.black, white=pair.white
    )
    started = time.perf_counter()
    try:
        displacement, rim, orders = _displacement(pair, method, asked, options)
    except InputError as error:
        explained(error, (*as_notes(pair.notes), *frame_findings(pair)))
        raise
    if response is not None:
        pair = replace(pair, notes=(*pair.notes, response_note(response)))
    if isinstance(geometry, PixelCalibration):
        surface = height_by_pixel(displacement, geometry)
        if surface.pitch is None and pair.geometry is not None:
            surface = replace(surface, pitch=pair.geometry.pitch_mm_per_px)
    else:
        surface = _on_rays(to_surface(displacement, pair.geometry), pair.geometry)
    seconds = time.perf_counter() - started
    said: dict[str, Any] = {
        "method": method,
        "geometry": geometry or pair.geometry,
        "axis": pair.axis,
    }
    said |= {"response": response, "denoise": denoise, "zero": zero, **options}
    origin = made_by("reconstruct", options=said, inputs=sources)
    found = (*_findings(pair, displacement, surface), *orders, *rim_findings(rim, displacement))
    surface = replace(surface, provenance=origin, findings=found)
    return Reconstruction(surface, displacement, seconds)


def _displacement(
    pair: Pair, method: str, asked: Asked, options: Mapping[str, MethodOption]
) -> tuple[DisplacementMap, Rim | None, tuple[Finding, ...]]:
    """The displacement of a pair's fringes, after the corrections that were asked for, what the rim
    tells of its zero, and findings about fringe orders."""
    denoise = asked.denoise
    prepared = prepare(pair, response=asked.response)
    if denoise is not None:
        plain = pair.reference is None  # a computed reference has no noise
        reference = prepared.reference if plain else denoise_frame(prepared.reference, denoise)
        prepared = replace(
            prepared, reference=reference, object=denoise_frame(prepared.object, denoise)
        )
    found, torn = without_tears(prepared, analyse(prepared, method, **options))
    told = tear_findings(torn / found.displacement_px.size)
    if asked.shadows:
        corrected, shadows = by_shadows(prepared, found)
        photographed = pair.reference is not None  # only that tells paint from shadow
        found = corrected if photographed else found
        told += shadow_findings(shadows, applied=photographed)
        told += free_findings(shadows, applied=photographed)
    if asked.zero == "reference" or pair.reference is None or pair.mask is not None:
        return found, None, told
    rim = measure_rim(prepared, found, pair.background)
    return with_unknown_zero(without_movement(found, rim), rim), rim, told


def _on_rays(surface: HeightMap, geometry: ReferencePlaneGeometry | None) -> HeightMap:
    """The surface with the camera's pupil above the geometry's principal point."""
    if geometry is None or geometry.principal_px is None:
        return surface
    return replace(surface, pupil=(*geometry.principal_px, geometry.distance_mm))


def calibrate_plane(
    planes: Sequence[Pair | StrPath | FloatMap],
    heights_mm: Sequence[float],
    *,
    pitch_mm_per_px: float | None = None,
    by_pixel: bool | None = None,
    method: str = "windowed",
) -> PlaneCalibration | PixelCalibration:
    """Calibrate the two-frame path from a plane at known heights.

    Parameters
    ----------
    planes : sequence of Pair, path, or (h, w) array
        The same reference frame, and the plane at each height as object frame; or the displacement
        of the fringes at each height, px.
    heights_mm : sequence of float
        Height of each plane above the reference plane, towards the camera, mm; not 0.
    pitch_mm_per_px : float > 0, optional
        Size of a camera pixel on the reference plane.
    by_pixel : bool, optional
        Whether to find a law for every pixel, from three heights or more, or a geometry, from two
        or more, which needs the pitch. By default a geometry where the pitch is given. A law keeps
        the pitch for the distances between pixels; without it they stay unknown.
    method : str
        A name from ``fringeworks.methods()``, for pairs.

    Returns
    -------
    PlaneCalibration or PixelCalibration, with its provenance.

    Raises
    ------
    InputError for too few heights, frames that do not fit, and displacements that no geometry
    explains.
    """
    maps: list[FloatMap] = []
    sources: dict[str, Source] = {}
    for number, plane in enumerate(planes, 1):
        if isinstance(plane, np.ndarray):
            maps.append(unmasked(plane, f"displacement {number}"))
            sources |= {s.sha256: s for s in sources_of(**{f"displacement {number}": plane})}
        else:
            pair = pair_of(plane)
            maps.append(reconstruct(pair, method, zero="reference").displacement.displacement_px)
            sources |= {s.sha256: s for s in pair.sources}
    origin = made_by(
        "calibrate_plane",
        options={
            "heights_mm": [float(h) for h in heights_mm],
            "pitch_mm_per_px": pitch_mm_per_px,
            "method": method,
        },
        inputs=tuple(sources.values()),
    )
    by_pixel = pitch_mm_per_px is None if by_pixel is None else by_pixel
    if by_pixel:
        law = calibrate_pixels(maps, heights_mm, pitch_mm_per_px=pitch_mm_per_px)
        return replace(law, provenance=origin)
    if pitch_mm_per_px is None:
        raise InputError("pitch_mm_per_px: expected for a geometry, got none")
    found = calibrate_reference_plane(maps, heights_mm, pitch_mm_per_px=pitch_mm_per_px)
    return replace(found, provenance=origin)


def _findings(pair: Pair, found: DisplacementMap, surface: HeightMap) -> tuple[Finding, ...]:
    told = list(pair.notes)
    if pair.axis is None:
        told.append(
            f"fringes found along {found.axis} with a period of {found.period_px:.2f} px, "
            f"tilted by {found.tilt_deg:.2f}°"
        )
    if pair.reference is None:
        told.append("no reference frame: measured against the plain fringe of the background")
    if "unwrapping" in found.details:
        told.append(
            "phase unwrapped by {unwrapping}: {residues} residues, {regions} connected regions, "
            "{pixels_moved_by_counting} pixels moved by counting".format(**found.details)
        )
    unknown = "geometry unknown: the result is a displacement in px, not a height"
    return (
        *as_notes(told),
        *pair_findings(pair, found),
        *as_notes([unknown] if surface.unit == "px" else [], "geometry"),
        *lateral_findings(surface),
    )
