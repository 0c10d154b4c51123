"""Pair + rig → points."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fringeworks.files.archives import read_coordinates
from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.pair.object_coordinates import object_coordinates
from fringeworks.pair.registry import MethodOption
from fringeworks.pipeline.inputs import pair_of
from fringeworks.pipeline.pairs import Reconstruction, Zero, reconstruct
from fringeworks.pipeline.stacks import Measurement
from fringeworks.rig.plane_coordinates import plane_coordinates
from fringeworks.rig.point_findings import point_findings
from fringeworks.rig.triangulate import Triangulator
from fringeworks.signal.denoise import Denoiser
from fringeworks.signal.filters import smooth
from fringeworks.signal.response import Response
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    InputError,
    Pair,
    Rig,
    found_before,
    made_by,
    sealed,
)


def measure_pair(
    pair: Pair | StrPath,
    rig: Rig | Triangulator | StrPath,
    *,
    reference: Decoded | CoordinateMap | StrPath | None = None,
    plane: Sequence[float] | None = None,
    method: str = "windowed",
    response: Response | None = None,
    denoise: Denoiser | None = None,
    zero: Zero = "rim",
    **options: MethodOption,
) -> Measurement:
    """Measure the points of a pair of frames with a calibrated rig.

    Parameters
    ----------
    pair : Pair or path
        Reference and object frame, or the object frame alone before its plane; or a capture to
        read. A geometry is not used.
    rig : Rig, Triangulator or path
    reference : Decoded, CoordinateMap or path, optional
        Projector coordinates of the plane that the reference frame shows, decoded once.
    plane : (a, b, c, d), optional
        Instead: where the plane is, a x + b y + c z = d in camera coordinates, mm.
    method : str
        A name from ``fringeworks.methods()``.
    response, denoise, zero, **options
        As for ``reconstruct``.

    Returns
    -------
    Measurement: points with σ, lens distortion and calibration included, and the projector
    coordinates that they come from.

    Raises
    ------
    InputError for neither or both of ``reference`` and ``plane``, coordinates of another axis or
    shape, and as ``reconstruct``.

    Notes
    -----
    The displacement tells which point of the plane gets the same light, and the plane's projector
    coordinate there is that of the object (``object_coordinates``). Orders of fringes are those of
    the plane, which the frame's rim has to show.
    """
    pair = pair_of(pair)
    if not isinstance(rig, Triangulator):
        rig = Triangulator(rig if isinstance(rig, Rig) else read_rig(rig))
    given = _given(reference, plane, pair)
    started = time.perf_counter()
    found = reconstruct(
        replace(pair, geometry=None),
        method,
        geometry=None,
        response=response,
        denoise=denoise,
        zero=zero,
        **options,
    )
    with found_before(found.findings):
        known = _reference(given, plane, rig.rig, found.displacement.axis)
        decoded = _decoded(pair, found, known)
        points = rig.triangulate(
            decoded, axis=known.axis, colour=sealed(np.asarray(pair.object, np.float64))
        )
    seconds = time.perf_counter() - started
    origin = made_by(
        "measure",
        options={
            "method": method,
            "plane": None if plane is None else [float(v) for v in plane],
            "response": response,
            "denoise": denoise,
            "zero": zero,
            **options,
        },
        inputs=found.surface.provenance.inputs if found.surface.provenance else (),
        rig=rig.rig,
    )
    told = (*points.findings, *point_findings(points, rig.rig, rig.rig.projector.height_px))
    points = replace(points, provenance=origin, findings=told)
    return Measurement(points, replace(decoded, provenance=origin), seconds)


def _decoded(pair: Pair, found: Reconstruction, known: CoordinateMap) -> Decoded:
    """Projector coordinates of the object."""
    moved = found.displacement
    frame = np.nan_to_num(np.asarray(pair.object, np.float64))
    base = frame if pair.reference is None else np.nan_to_num(pair.reference)
    coordinates = object_coordinates(
        moved,
        known,
        modulation=float(np.sqrt(2.0) * base.std()),
        level=smooth(frame, (moved.period_px, moved.period_px)),
    )
    return Decoded(
        x=coordinates if known.axis == "x" else None,
        y=coordinates if known.axis == "y" else None,
        noise=CameraNoise(float(moved.details.get("noise_counts", 0.0))),
        findings=found.warnings,
    )


def _given(
    reference: Decoded | CoordinateMap | StrPath | None,
    plane: Sequence[float] | None,
    pair: Pair,
) -> Decoded | CoordinateMap | None:
    """The coordinates of the reference plane, checked before anything is computed."""
    if (reference is None) == (plane is None):
        got = "none" if plane is None else "both"
        raise InputError(f"expected coordinates of the reference plane or a plane, got {got}")
    if reference is None or isinstance(reference, Decoded | CoordinateMap):
        given = reference
    else:
        given = read_coordinates(reference)
    maps = tuple(given.maps.values()) if isinstance(given, Decoded) else (given,)
    for known in maps:
        if known is not None and known.coordinate_px.shape != pair.object.shape:
            raise InputError(
                f"reference coordinates: expected shape {pair.object.shape} of the frames, "
                f"got {known.coordinate_px.shape}"
            )
    return given


def _reference(
    given: Decoded | CoordinateMap | None,
    plane: Sequence[float] | None,
    rig: Rig,
    axis: Axis,
) -> CoordinateMap:
    """The plane's coordinates along the projector's axis that the fringes change along."""
    if given is None:
        assert plane is not None
        return plane_coordinates(rig, plane, axis)
    known = given.maps.get(axis) if isinstance(given, Decoded) else given
    if known is None or known.axis != axis:
        raise InputError(
            f"reference coordinates: expected those along {axis}, as the fringes, got others"
        )
    return known
