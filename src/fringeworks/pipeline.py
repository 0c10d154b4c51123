"""The chain from a capture to a surface, in one readable function."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from fringeworks.pair.analyse import analyse
from fringeworks.pair.plane_calibration import PixelCalibration, height_by_pixel
from fringeworks.pair.prepared import prepare
from fringeworks.pair.reference_plane import to_surface
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.calibrate import Calibration, Observation, calibrate, observe
from fringeworks.rig.triangulate import triangulate
from fringeworks.signal.denoise import Denoiser
from fringeworks.signal.denoise import denoise as denoise_frame
from fringeworks.stack.decode import decode
from fringeworks.stack.even_light import texture
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    Axis,
    Decoded,
    DisplacementMap,
    HeightMap,
    InputError,
    Pair,
    PointCloud,
    Rig,
)


@dataclass(frozen=True)
class Reconstruction:
    """What came of a capture."""

    surface: HeightMap
    displacement: DisplacementMap
    seconds: float
    notes: tuple[str, ...] = ()


def reconstruct(
    capture: Pair,
    method: str = "windowed",
    *,
    denoise: Denoiser | None = None,
    pixels: PixelCalibration | None = None,
    **options: Any,
) -> Reconstruction:
    """Measure the surface of a capture.

    Parameters
    ----------
    capture : Pair
        Reference and object frame, with the geometry where it is known.
    method : str
        A name from ``fringeworks.methods()``.
    denoise : "emd", "emd2d" or "bemd", optional
        Take the modes that are no stronger than noise off both frames first.
    pixels : PixelCalibration, optional
        Heights by a calibration of every pixel, instead of the capture's geometry.
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
    if pixels is None:
        surface = to_surface(phase, capture.geometry)
    else:
        surface = height_by_pixel(phase, pixels)
        if capture.geometry is not None:
            surface = replace(surface, pitch=capture.geometry.pitch_mm_per_px)
    notes = _notes(capture, phase, surface.unit)
    return Reconstruction(surface, phase, time.perf_counter() - started, notes)


def _notes(capture: Pair, phase: DisplacementMap, unit: str) -> tuple[str, ...]:
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
    if unit == "px":
        notes.append("geometry unknown: the result is a displacement in px, not a height")
    return tuple(notes)


def calibrate_stacks(
    stacks: Iterable[tuple[str, Stack]],
    board: Board,
    *,
    distortion: int = 5,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Calibration:
    """Calibrate a rig from stacks of a board in several poses.

    Parameters
    ----------
    stacks : iterable of (name, Stack)
        Both axes of the projector in each; a pose in which the board is not found is skipped, with
        the reason in the result.
    board : Board
    distortion : 0, 2, 4 or 5
        Coefficients per lens.
    progress : callable
        Called with what is being done.
    **options
        Of ``decode``.

    Raises
    ------
    InputError where too few poses are left, and as ``geometry.calibrate``.
    """
    observations: list[Observation] = []
    skipped: dict[str, str] = {}
    for name, stack in stacks:
        progress(f"{name} …")
        plan = stack.plan
        try:
            found = decode(stack.frames, plan, **_with_saturation(stack, options))
            observations.append(
                observe(
                    texture(stack.frames, plan),
                    found,
                    board,
                    projector_size=(plan.width_px, plan.height_px),
                    name=name,
                )
            )
        except InputError as error:
            skipped[name] = str(error) if name in str(error) else f"{name}: {error}"
    progress("adjusting …")
    return calibrate(observations, board, skipped=skipped, distortion=distortion)


def reconstruct_points(
    stack: Stack, rig: Rig, *, axis: Axis | None = None, **options: Any
) -> tuple[PointCloud, Decoded]:
    """Measure points from a stack of frames with a calibrated rig.

    Parameters
    ----------
    stack : Stack
    rig : Rig
    axis : "x" or "y", optional
        Use this axis of the projector only.
    **options
        Of ``decode``.

    Returns
    -------
    The points, with the scene's brightness where the plan shows it, and what was decoded.

    Raises
    ------
    InputError where rig and stack do not belong together, and as ``decode``.
    """
    check_projector(rig, stack)
    decoded = decode(stack.frames, stack.plan, **_with_saturation(stack, options))
    try:
        colour = texture(stack.frames, stack.plan)
    except InputError:
        colour = None
    return triangulate(decoded, rig, axis=axis, colour=colour), decoded


def check_projector(rig: Rig, stack: Stack) -> None:
    """Refuse a stack whose plan is for another projector than the rig's."""
    plan, projector = stack.plan, rig.projector
    if (plan.width_px, plan.height_px) != (projector.width_px, projector.height_px):
        raise InputError(
            f"rig: it is for a projector of {projector.width_px} × {projector.height_px} px, got "
            f"a plan for {plan.width_px} × {plan.height_px}"
        )


def _with_saturation(stack: Stack, options: dict[str, Any]) -> dict[str, Any]:
    return {"saturation": stack.saturation} | options
