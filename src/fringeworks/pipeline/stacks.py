"""Stack → projector coordinates or phase, stack + rig → points, white plane → response."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.files.stack import read_stack
from fringeworks.patterns.encode import refuse_colours
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, repeats
from fringeworks.pipeline.decoding import decoded_exposures, given_options, of_files
from fringeworks.pipeline.inputs import inputs_of, stack_of, stacks_of
from fringeworks.pipeline.scene_colour import colour_findings, scene_brightness
from fringeworks.rig.depth_range import DepthRange, depth_range_of
from fringeworks.rig.lit_side import refuse_wrong_side
from fringeworks.rig.point_findings import point_findings
from fringeworks.rig.range_evidence import range_findings
from fringeworks.rig.sensor_region import rig_for_region
from fringeworks.rig.triangulate import Triangulator
from fringeworks.signal.response import Response, check_devices
from fringeworks.signal.response import measure_response as response_of_frames
from fringeworks.signal.smooth_coordinate import smooth_coordinate
from fringeworks.stack.decode import decode
from fringeworks.stack.frames import Stack
from fringeworks.stack.grey_card import check_gains
from fringeworks.stack.light_separation import LightSeparation, separate_light
from fringeworks.stack.options import DecodeOptions
from fringeworks.stack.wrapped import WrappedPhase, steps_plan, wrapped_phase
from fringeworks.surface.camera_blur import remove_blur
from fringeworks.types import (
    Axis,
    Decoded,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    Noted,
    Plotted,
    PointCloud,
    Rig,
    RigMismatch,
    found_before,
    made_by,
)


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Noted, Plotted, Frozen):
    """The points of a stack of frames."""

    points: PointCloud
    """Points in camera coordinates, with their provenance."""
    decoded: Decoded
    """Projector coordinates that the points come from."""
    seconds: float
    """Time that decoding and triangulation took."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found in the frames and in the points."""
        return self.points.findings


def decode_stack(
    stack: Stack | Sequence[Stack] | StrPath, **options: Unpack[DecodeOptions]
) -> Decoded:
    """Decode a stack of frames to projector coordinates; see ``verbs.decode``."""
    stacks = stacks_of(stack)
    found = decoded_exposures(stacks, options)
    origin = made_by(
        "decode",
        options=given_options(stacks[0], options),
        inputs=inputs_of(*stacks),
        plan=stacks[0].plan,
    )
    return replace(found, provenance=origin)


def measure(
    stack: Stack | Sequence[Stack] | StrPath,
    rig: Rig | Triangulator | StrPath,
    *,
    axis: Axis | None = None,
    epipolar_px: float | None = None,
    depth_mm: DepthRange | Sequence[float] | None = None,
    blur_px: float | None = None,
    white_balance: Sequence[float] | None = None,
    **options: Unpack[DecodeOptions],
) -> Measurement:
    """Measure the points of a stack of frames with a calibrated rig; see ``verbs.measure``."""
    stacks = stacks_of(stack)
    if white_balance is not None:
        stacks = tuple(replace(one, white_balance=check_gains(white_balance)) for one in stacks)
    plan = stacks[0].plan
    rig = _for_stack(rig, stacks[0])
    check_projector(rig.rig, stacks[0])
    depth = depth_range_of(depth_mm, rig.rig)
    started = time.perf_counter()
    if depth is not None:
        options.setdefault("absolute", not repeats(plan))
    found = decoded_exposures(stacks, {"keep_blur": _sharpened(rig.rig, blur_px), **options})
    with found_before(found.findings):
        repeating, found = found, found if depth is None else depth.resolve(found)
        points = rig.triangulate(
            found, axis=axis, epipolar_px=epipolar_px, colour=scene_brightness(stacks, found)
        )
        points = _without_blur(points, rig.rig, blur_px, found, axis)
        refuse_wrong_side(points, rig.rig)
    seconds = time.perf_counter() - started
    origin = made_by(
        "measure",
        options={
            "axis": axis,
            "epipolar_px": epipolar_px,
            "blur_px": blur_px,
            "white_balance": stacks[0].white_balance,
            "removed_blur_px": removed_blur(found, axis),
            "depth_mm": None if depth is None else list(depth.depth_mm),
            **given_options(stacks[0], options),
        },
        inputs=inputs_of(*stacks),
        plan=plan,
        rig=rig.rig,
    )
    found = replace(found, provenance=origin)
    more = (*point_findings(points, rig.rig, plan.height_px), *colour_findings(stacks, points))
    more += range_findings(points, found, repeating, depth)
    points = replace(points, provenance=origin, findings=(*points.findings, *more))
    return Measurement(points, found, seconds)


def _for_stack(rig: Rig | Triangulator | StrPath, stack: Stack) -> Triangulator:
    """The rig for the part of the sensor that the frames show."""
    if isinstance(rig, Triangulator):
        fitting = rig_for_region(rig.rig, stack.region)
        return rig if fitting is rig.rig else Triangulator(fitting)
    known = rig if isinstance(rig, Rig) else read_rig(rig)
    return Triangulator(rig_for_region(known, stack.region))


def _sharpened(rig: Rig, blur_px: float | None) -> bool:
    """Whether a known blur is removed from the points, so that decoding leaves it to them."""
    return rig.blur is not None if blur_px is None else blur_px > 0.0


def _without_blur(
    points: PointCloud, rig: Rig, blur_px: float | None, found: Decoded, axis: Axis | None
) -> PointCloud:
    """The points without the error of a known blur, by the axes that they come from."""
    if blur_px is None and rig.blur is None:
        return points
    used = {a: m for a, m in found.maps.items() if axis is None or a == axis}
    return remove_blur(
        points,
        rig,
        blur_px,
        axis=next(iter(used)) if len(used) == 1 else None,
        period_px={a: m.periods_px for a, m in used.items() if m.periods_px},
        # Without blur, points stay where decoding has put them.
        removed_px={
            a: found.details.get(a, {}).get("removed_blur_px", 0.0) if blur_px != 0.0 else 0.0
            for a in used
        },
        modulation={a: m.modulation for a, m in used.items()},
    )


def removed_blur(found: Decoded, axis: Axis | None) -> float:
    """Blur whose shift at edges of brightness was removed from the coordinates, camera px: the rms
    over the axes."""
    used = [a for a in found.maps if axis is None or a == axis]
    removed = [float(found.details.get(a, {}).get("removed_blur_px", 0.0)) for a in used]
    return float(np.sqrt(np.mean(np.square(removed))))


def measure_response(
    stack: Stack | StrPath,
    *,
    camera: str | None = None,
    projector: str | None = None,
    number: int = 1,
    **options: Unpack[DecodeOptions],
) -> Response:
    """Measure the response of a camera and projector from a stack of a white plane.

    Parameters
    ----------
    stack : Stack or path
        Fringes with equal steps, and along the same axis a Gray code with inverse bits, or with a
        white and a black frame.
    camera, projector : str, optional
        Names of the devices; the stack's where left out.
    number : int
        Which set of steps of the plan, from 1.
    **options
        Of ``decode``, for the Gray code. Pixels with a sample at the saturation, where one is
        given, are not used; nor are those below ``min_modulation``.

    Returns
    -------
    Response

    Raises
    ------
    InputError without names, without Gray code, or for a set that the plan does not have.
    """
    stack = stack_of(stack)
    refuse_colours(stack.plan)
    names = {"camera": camera or stack.camera, "projector": projector or stack.projector}
    for device, name in names.items():
        if not name:
            raise InputError(f"{device}: expected its name, got none here nor in the capture")
    sets = [(k, b) for k, b in stack.plan.placed if isinstance(b, PhaseSteps)]
    if not 1 <= number <= len(sets):
        raise InputError(f"number: expected 1 to {len(sets)} sets of steps, got {number}")
    first, steps = sets[number - 1]
    if steps.line_px is not None:
        raise InputError(f"number: expected a set with a cosine, got lines in set {number}")
    given = given_options(stack, options)
    coordinate = _gray_coordinate(stack, steps.axis, given)
    frames = np.stack(stack.frames[first : first + steps.frames])
    limit = given["saturation"]
    if limit is not None:
        coordinate[(frames >= limit).any(axis=0)] = np.nan
    phase = 2.0 * np.pi / steps.period_px * smooth_coordinate(coordinate, np.isfinite(coordinate))
    found = response_of_frames(
        frames,
        phase,
        camera=names["camera"] or "",
        projector=names["projector"] or "",
        shifts_rad=steps.shifts_rad,
        pattern_exponent=1.0 / stack.plan.gamma,
    )
    origin = made_by(
        "measure_response",
        options={**names, "number": number, **given},
        inputs=inputs_of(stack),
        plan=stack.plan,
    )
    return replace(found, provenance=origin)


def phase_from_stack(
    path: StrPath,
    shifts_rad: Sequence[float],
    *,
    camera: str | None,
    projector: str | None,
    **options: Any,
) -> WrappedPhase:
    """Read phase steps without a plan, and compute their phase; see ``verbs.wrapped_phase``, which
    gives all its options."""
    stack = read_stack(path, steps_plan(shifts_rad))
    if options["response"] is not None:
        check_devices(options["response"], camera or stack.camera, projector or stack.projector)
    if options["saturation"] is None:
        options["saturation"] = stack.saturation
    found = wrapped_phase(stack.frames, shifts_rad, **options)
    origin = made_by(
        "wrapped_phase",
        options={"shifts_rad": list(found.shifts_rad), **options},
        inputs=inputs_of(stack),
    )
    return replace(found, findings=(*of_files(stack), *found.findings), provenance=origin)


def light_from_stack(
    stack: Stack | StrPath,
    **options: Any,
) -> LightSeparation:
    """Separate direct from indirect light of a stack; see ``verbs.separate_light``, which gives all
    its options."""
    stack = stack_of(stack)
    refuse_colours(stack.plan)
    if options["response"] is not None:
        check_devices(options["response"], stack.camera, stack.projector)
    if options["saturation"] is None:
        options["saturation"] = stack.saturation
    found = separate_light(stack.frames, stack.plan, **options)
    origin = made_by("separate_light", options=options, inputs=inputs_of(stack), plan=stack.plan)
    return replace(found, findings=(*of_files(stack), *found.findings), provenance=origin)


def check_projector(rig: Rig, stack: Stack) -> None:
    """Refuse a stack whose plan is for another projector than the rig's.

    A plan may light fewer rows of the same columns, such as 1280 × 720 of a chip of 1280 × 800 px.
    """
    plan, projector = stack.plan, rig.projector
    if plan.width_px != projector.width_px or plan.height_px > projector.height_px:
        raise RigMismatch(
            f"rig: it is for a projector of {projector.width_px} × {projector.height_px} px, got "
            f"a plan for {plan.width_px} × {plan.height_px}"
        )


def _gray_coordinate(stack: Stack, axis: Axis, options: DecodeOptions) -> FloatMap:
    """The coordinate by Gray code alone: it does not depend on the response."""
    plan = stack.plan
    code = plan.gray_code(axis)
    if code is None:
        raise InputError(f"plan: expected a Gray code along {axis}, got none")
    light = plan.uniform("white") is not None and plan.uniform("black") is not None
    if not (code[1].inverse or light):
        raise InputError(
            f"plan: expected inverse bits of the Gray code along {axis}, or a white and a black "
            'frame, as {kind = "white"} and {kind = "black"} at the end of its sequence, got '
            "neither: what the fringes show depends on the response"
        )
    kept = [
        (first, block)
        for first, block in plan.placed
        if isinstance(block, Uniform) or (isinstance(block, GrayCode) and block.axis == axis)
    ]
    frames = [stack.frames[plan.places[k + n]] for k, block in kept for n in range(block.frames)]
    alone = PatternPlan(plan.width_px, plan.height_px, tuple(block for _, block in kept))
    return decode(frames, alone, **options).maps[axis].coordinate_px.astype(np.float64)
