"""The public verbs whose argument says which chain runs: arrays, captures, or several cameras."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Literal, Unpack, overload

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.capture import read_capture
from fringeworks.files.exposures import is_exposures
from fringeworks.files.limits import existing_file, parsing, read_content
from fringeworks.files.multi_rig import read_multi_rig
from fringeworks.files.rig import read_rig
from fringeworks.files.stack import read_stack
from fringeworks.pair.registry import MethodOption
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.boards import calibrate_stacks, observe_stack
from fringeworks.pipeline.cameras import MultiMeasurement, calibrate_camera_stacks, measure_cameras
from fringeworks.pipeline.inputs import stack_of
from fringeworks.pipeline.pair_points import measure_pair
from fringeworks.pipeline.photographs import calibrate_photographs, holds_photographs
from fringeworks.pipeline.stacks import (
    Measurement,
    decode_stack,
    light_from_stack,
    phase_from_stack,
)
from fringeworks.pipeline.stacks import measure as measure_stack
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.calibrate import Calibration, Observation
from fringeworks.rig.calibration.calibrate import calibrate as calibrate_observations
from fringeworks.rig.calibration.calibrate import observe as observe_image
from fringeworks.rig.calibration.cameras import MultiCalibration, calibrate_cameras
from fringeworks.rig.depth_range import DepthRange
from fringeworks.rig.triangulate import Triangulator
from fringeworks.signal.denoise import Denoiser
from fringeworks.signal.response import Response
from fringeworks.stack.decode import decode as decode_frames
from fringeworks.stack.frames import Stack
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.stack.light_separation import separate_light as separate_frames
from fringeworks.stack.options import DecodeOptions
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.stack.wrapped import wrapped_phase as phase_of_frames
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    InputError,
    MultiRig,
    Pair,
    Rig,
)

Frames = NDArray[Any] | Sequence[NDArray[Any]]
"""Frames of a stack as arrays: (n, h, w), or n times (h, w)."""


def is_path(source: object) -> bool:
    """Whether a source is the path of a file or folder."""
    return isinstance(source, (str, os.PathLike))


def decode(
    frames: Frames | Stack | Sequence[Stack] | StrPath,
    plan: PatternPlan | None = None,
    **options: Unpack[DecodeOptions],
) -> Decoded:
    """Decode the projector coordinate of every camera pixel, with its standard deviation.

    Parameters
    ----------
    frames : (n, h, w) array, sequence of (h, w) arrays, Stack, sequence of Stack, or path
        Frames in the order of the plan, counts; a stack, which knows its plan; or a capture to
        read. Several exposures of one scene, from ``fringeworks.files.read_exposures`` or a folder
        that ``fringeworks.scan.capture_hdr`` has written, are decoded each by itself and fused.
    plan : PatternPlan, optional
        What was projected. Needed for arrays, and for files that have no plan beside them.
    **options
        ``noise``, ``saturation``, ``min_modulation`` and the others of
        ``fringeworks.stack.DecodeOptions``. A stack's own saturation and count step hold where none
        is given.

    Returns
    -------
    Decoded, with what reading the files has found first.

    Raises
    ------
    InputError
        For frames that do not fit the plan, a plan beside a stack, no plan for arrays, a response
        of other devices than the stack's, and options out of their range.
    FramesContradictPlan
        Where frames are missing, swapped, or of another plan.

    Notes
    -----
    Phase shifting and Gray code, theory §5 and §6. ``fringeworks.stack.Decoder`` decodes many
    stacks of one scene, and ``fringeworks.stack.StreamingDecoder`` takes frames one by one.

    Examples
    --------
    >>> import fringeworks as fw
    >>> steps = fw.patterns.PhaseSteps("x", 64.0, fw.patterns.equal_steps(4))
    >>> plan = fw.PatternPlan(64, 40, (steps,))
    >>> decoded = fw.decode(list(fw.encode(plan)), plan)  # the pictures, in place of frames
    >>> round(float(decoded.x.coordinate_px[10, 20]), 1)
    20.0
    """
    if is_path(frames) and plan is not None:
        frames, plan = read_stack(frames, plan), None  # type: ignore[arg-type]
    if _is_capture(frames, plan):
        return decode_stack(frames, **options)  # type: ignore[arg-type]
    return decode_frames(frames, plan, **options)  # type: ignore[arg-type]


# A path may hold either kind of capture, and a string is a sequence of strings.
@overload
def measure(
    capture: Stack | Sequence[Stack] | StrPath,
    rig: Rig | Triangulator | StrPath,
    *,
    axis: Axis | None = None,
    epipolar_px: float | None = None,
    depth_mm: DepthRange | Sequence[float] | None = None,
    blur_px: float | None = None,
    white_balance: Sequence[float] | None = None,
    **options: Unpack[DecodeOptions],
) -> Measurement: ...


@overload
def measure(
    capture: Pair | StrPath,
    rig: Rig | Triangulator | StrPath,
    *,
    reference: Decoded | CoordinateMap | StrPath | None = None,
    plane: Sequence[float] | None = None,
    plane_sigma_mm: float | None = None,
    period_px: float | None = None,
    bright_px: float | None = None,
    depth_mm: DepthRange | Sequence[float] | None = None,
    method: str = "windowed",
    response: Response | None = None,
    denoise: Denoiser | None = None,
    zero: Literal["rim", "reference"] = "rim",
    **options: MethodOption,
) -> Measurement: ...


@overload
def measure(
    capture: Sequence[Stack | Sequence[Stack] | StrPath],
    rig: MultiRig,
    *,
    axis: Axis | None = None,
    **options: Unpack[DecodeOptions],
) -> MultiMeasurement: ...


def measure(capture: Any, rig: Any, **options: Any) -> Measurement | MultiMeasurement:
    """Measure the points of a capture with a calibrated rig.

    Parameters
    ----------
    capture : Stack, sequence of Stack, Pair, path, or one of these per camera
        Frames and their plan; several exposures of one scene; a pair of frames; or a capture to
        read. With a ``MultiRig``, one entry per camera.
    rig : Rig, MultiRig, Triangulator or path
        A ``Triangulator`` saves its preparation when many captures are measured.
    axis : "x" or "y", optional
        Use this axis of the projector only. For stacks.
    epipolar_px : float >= 0, optional
        Standard deviation of the epipolar error that the rig causes, px; see ``triangulate``. For
        stacks of one camera, like ``depth_mm`` and ``blur_px``.
    depth_mm : (near, far) or DepthRange, optional
        Smallest and largest z of the points in camera coordinates, mm. It resolves the fringe
        orders of plans that repeat, such as one set of three or four steps; points outside are
        NaN. A ``DepthRange`` saves its preparation when many stacks are measured.
    blur_px : float, optional
        Standard deviation of the camera's blur, px, whose error on curved and unevenly lit surfaces
        is removed (``fringeworks.views.remove_blur``); by default that of the rig, where
        ``calibrate`` measured it. 0 keeps the error.
    white_balance : (red, green, blue), optional
        Gains of the points' colour, as ``fringeworks.stack.white_balance`` measures them; by
        default those of the capture.
    reference : Decoded, CoordinateMap or path, optional
        For a pair: projector coordinates of the plane that the reference frame shows.
    plane : (a, b, c, d), optional
        For a pair, instead: where the plane is, a x + b y + c z = d in camera coordinates, mm.
    plane_sigma_mm, period_px, bright_px : float, optional
        For a pair and a plane: its standard deviation, 1 mm by default; the fringes' period in the
        projector and the coordinate of a bright one, px, which let the reference frame correct it.
        ``depth_mm`` corrects a pair's fringe orders.
    method, response, denoise, zero
        For a pair, as for ``reconstruct``.
    **options
        For stacks those of ``decode``, for a pair those of the method.

    Returns
    -------
    Measurement
        Points, coordinates and findings; or a MultiMeasurement for several cameras. The points
        carry the scene's brightness where the plan shows it; for several exposures, the background
        of the first, counts.

    Raises
    ------
    RigMismatch
        Where rig and capture do not belong together.
    InputError
        As ``decode`` and ``reconstruct``, and for a depth range that holds no point.

    Examples
    --------
    >>> import fringeworks as fw
    >>> from fringeworks.simulate import bust, fringe_plan, look, photograph, standard_rig
    >>> rig = standard_rig(scale=0.2)
    >>> plan = fringe_plan(rig, both=False)
    >>> stack = fw.Stack(list(photograph(look(rig, bust()), plan)), plan)
    >>> fw.measure(stack, rig).points.xyz_mm.shape
    (205, 256, 3)
    """
    if is_path(rig):
        # Captures are refused first: a wrong type is a mistake in the call, a missing file is not.
        if not is_path(capture) and not isinstance(capture, (Pair, Stack, Sequence)):
            stack_of(capture)
        rig = _rig_from(rig)
    if isinstance(rig, MultiRig):
        return measure_cameras(capture, rig, **options)
    if is_path(capture) and not is_exposures(capture):
        capture = read_capture(capture)
    if isinstance(capture, Pair):
        return measure_pair(capture, rig, **options)
    return measure_stack(capture, rig, **options)


Poses = Iterable[tuple[str, Stack]]
"""Names and stacks of a board's poses."""


@overload
def calibrate(  # type: ignore[overload-overlap]
    poses: Sequence[Observation] | Poses | StrPath,
    board: Board | str,
    *,
    plan: PatternPlan | StrPath | None = None,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> Calibration: ...


@overload
def calibrate(
    poses: Sequence[Sequence[Observation]] | Sequence[Poses | StrPath],
    board: Board | str,
    *,
    plan: PatternPlan | StrPath | None = None,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> MultiCalibration: ...


def calibrate(
    poses: Any,
    board: Board | str,
    *,
    plan: PatternPlan | StrPath | None = None,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> Calibration | MultiCalibration:
    """Calibrate a projector and one camera or several with a board in several poses.

    Parameters
    ----------
    poses : path, iterable of (name, Stack), sequence of Observation, or a sequence of these
        A folder with a stack per pose; the stacks themselves, each with both axes of the projector;
        or what ``fringeworks.rig.observe`` found in them. A pose in which the board is not found,
        or that cannot be decoded, is skipped; the result says why. A sequence of folders or of
        sequences has one entry per camera: stacks with one name are of one pose of the board.
        Two folders of single photographs calibrate two cameras without a projector, which then only
        codes.
        Ten poses are usual, tilted against each other; three are the least.
    board : Board or str
        A board, or its short form, as for ``fringeworks.rig.parse_board``.
    plan : PatternPlan or path, optional
        Plan of a folder's stacks, where none lies there.
    skipped : dict, optional
        For observations: names of poses that could not be observed, with the reason.
    distortion : 0, 2, 4 or 5, optional
        Number of distortion coefficients for each device. 2: k₁ and k₂; 4: p₁ and p₂ as well; 5: k₃
        as well. By default those that the poses determine.
    progress : callable
        Called with the name of each pose.
    **options
        Of ``decode``, for stacks.

    Returns
    -------
    Calibration
        Or a MultiCalibration for several cameras, in coordinates of the first.

    Raises
    ------
    InputError
        That names the cause: too few poses, poses that are the same or parallel, rows and columns
        of the projector swapped, frame sizes that differ; and as ``decode``.
    MissingPackage
        Without OpenCV (the extra ``calibration``).

    Notes
    -----
    The projector coordinates at the board's corners make the projector an inverse camera (Zhang
    and Huang, Optical Engineering 45, 2006, doi:10.1117/1.2336196); bundle adjustment over all
    poses gives the rig and its covariance.
    """
    board = parse_board(board) if isinstance(board, str) else board
    if is_path(poses):
        return calibrate_stacks(
            poses, board, plan=plan, distortion=distortion, progress=progress, **options
        )
    paths = isinstance(poses, Sequence) and len(poses) > 0 and all(is_path(p) for p in poses)
    if paths and all(holds_photographs(p) for p in poses):
        return calibrate_photographs(poses, board, distortion=distortion, progress=progress)
    # Stacks may come one by one, so that one pose at a time is in memory.
    entries = iter(poses)
    first = next(entries, None)
    poses = poses if isinstance(poses, Sequence) else chain([first], entries)
    if isinstance(first, Observation):
        return calibrate_observations(poses, board, skipped=skipped, distortion=distortion)
    if isinstance(first, Sequence) and first and isinstance(first[0], Observation):
        return calibrate_cameras(poses, board, skipped=skipped, distortion=distortion)
    by: Any = calibrate_stacks if _is_pose(first) else calibrate_camera_stacks
    found: Calibration | MultiCalibration = by(
        poses, board, plan=plan, distortion=distortion, progress=progress, **options
    )
    return found


def _is_pose(entry: object) -> bool:
    """Whether an entry is a pose of one camera: its name and its stack. So is none at all."""
    return entry is None or (
        isinstance(entry, tuple) and len(entry) == 2 and isinstance(entry[1], Stack)
    )


def observe(
    view: NDArray[Any] | Stack,
    board: Board | str,
    *,
    decoded: Decoded | None = None,
    projector_size: tuple[int, int] | None = None,
    name: str = "pose",
    **options: Unpack[DecodeOptions],
) -> Observation:
    """Find a board in one pose, and read the projector coordinates of its corners.

    Parameters
    ----------
    view : Stack, or (h, w) array
        Frames of the pose with both axes of the projector; or a grey photograph of the board under
        even light, counts.
    board : Board or str
    decoded : Decoded, optional
        For a photograph: projector coordinates along both axes, maps (h, w).
    projector_size : (columns, rows), optional
        For a photograph.
    name : str
        Name of the pose in errors and reports.
    **options
        Of ``decode``, for a stack.

    Returns
    -------
    Observation

    Raises
    ------
    BoardNotFound
        Where the board is not found, or the projector does not light it.
    InputError
        As ``decode``, and for a photograph without coordinates and the projector's size.
    MissingPackage
        Without OpenCV (the extra ``calibration``).
    """
    board = parse_board(board) if isinstance(board, str) else board
    if isinstance(view, Stack):
        return observe_stack(view, board, name=name, **options)
    if decoded is None or projector_size is None:
        raise InputError("view: a photograph needs decoded and projector_size, a Stack does not")
    return observe_image(view, decoded, board, projector_size=projector_size, name=name)


def separate_light(
    frames: Frames | Stack | StrPath,
    plan: PatternPlan | None = None,
    *,
    contrast: float = 1.0,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    response: Response | None = None,
) -> LightSeparation:
    """Separate direct from indirect light by the fringes of the shortest period.

    Parameters
    ----------
    frames : (n, h, w) array, sequence of (h, w) arrays, Stack, or path
        All frames of the plan in its order, counts; a stack; or a capture to read.
    plan : PatternPlan, optional
        With at least one set of phase steps. A black frame removes the light of the room. Needed
        for arrays, and for nothing else.
    contrast : float in (0, 1]
        Contrast of those fringes on a surface without indirect light. Blur of projector and camera
        lowers it; what it lowers counts as indirect light otherwise. A flat, matte sheet shows it.
    noise, saturation, response
        As for ``decode``. A stack's own saturation holds where none is given. Without a response, γ
        bends both results.

    Returns
    -------
    LightSeparation
        From a capture with the notes of reading first, and with its provenance.

    Raises
    ------
    InputError
        For a plan without phase steps, a contrast out of its range, and as ``decode``.

    Notes
    -----
    Fringes A + B cos φ light half of every surface that is larger than a period, so that indirect
    light hardly varies with φ: D = 2 B / c, and G = 2 (A − black) − D (Nayar, Krishnan, Grossberg
    & Raskar, ACM TOG 25(3), 2006, doi:10.1145/1141911.1141977). Light that comes from less than a
    period away, as within translucent material, counts as direct.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> steps = fw.patterns.PhaseSteps("x", 16.0, fw.patterns.equal_steps(4))
    >>> plan = fw.PatternPlan(320, 200, (steps,))
    >>> phase = np.tile(2 * np.pi * np.arange(320) / 16.0, (40, 1))
    >>> frames = [30.0 + 60.0 + 60.0 * np.cos(phase - shift) for shift in steps.shifts_rad]
    >>> found = fw.stack.separate_light(frames, plan)
    >>> round(float(found.direct[20, 100])), round(float(found.indirect[20, 100]))
    (120, 60)
    """
    given: Any = {
        "contrast": contrast,
        "noise": noise,
        "saturation": saturation,
        "response": response,
    }
    if _is_capture(frames, plan):
        return light_from_stack(frames, **given)  # type: ignore[arg-type]
    return separate_frames(frames, plan, **given)  # type: ignore[arg-type]


def wrapped_phase(
    frames: Frames | StrPath,
    shifts_rad: Sequence[float],
    *,
    camera: str | None = None,
    projector: str | None = None,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    min_modulation: float = 0.0,
    response: Response | None = None,
    estimate_steps: bool = True,
) -> WrappedPhase:
    """Compute the wrapped phase of shifted fringes, without a plan and without a projector.

    Parameters
    ----------
    frames : (n, h, w) array, sequence of (h, w) arrays, or path
        One frame per shift, counts; or a folder of images, or a TIFF, ``.npy`` or ``.npz`` stack,
        in the order of the shifts.
    shifts_rad : (n,) floats
        Shifts δ_n of I_n = A + B cos(φ − δ_n), rad; 3 to 64.
        ``fringeworks.patterns.equal_steps`` gives equal ones.
    camera, projector : str, optional
        For a path: names of the devices, which a response is checked with; the capture's where left
        out.
    noise, saturation, min_modulation, response, estimate_steps
        As for ``decode``; a capture's own saturation holds where none is given.

    Returns
    -------
    WrappedPhase
        Its maps of shape (h, w). ``unwrap`` unwraps its phase in space.

    Raises
    ------
    InputError
        As for ``decode``.

    Notes
    -----
    The phase and its standard deviation come from the same fit as those of ``decode`` (theory §5,
    §9).

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> shifts = fw.patterns.equal_steps(4)
    >>> phase = np.tile(np.linspace(-3.0, 3.0, 200), (40, 1))
    >>> frames = [100.0 + 50.0 * np.cos(phase - shift) for shift in shifts]
    >>> found = fw.stack.wrapped_phase(frames, shifts)
    >>> bool(np.allclose(found.phase_rad, phase, atol=1e-3))
    True
    """
    given: Any = {
        "noise": noise,
        "saturation": saturation,
        "min_modulation": min_modulation,
        "response": response,
        "estimate_steps": estimate_steps,
    }
    if is_path(frames):
        return phase_from_stack(frames, shifts_rad, camera=camera, projector=projector, **given)  # type: ignore[arg-type]
    if camera is not None or projector is not None:
        raise InputError("camera, projector: expected with the path of a capture, got arrays")
    return phase_of_frames(frames, shifts_rad, **given)  # type: ignore[arg-type]


def _rig_from(path: StrPath) -> Rig | MultiRig:
    """The rig of a file: of one camera, or of several."""
    if Path(path).suffix.lower() == ".toml":
        with parsing(Path(path), "a rig file"):
            content = read_content(existing_file(path, "a rig file"), "a rig file")
            if tomllib.loads(content.decode()).get("kind") == "multi-rig":
                return read_multi_rig(path)
    return read_rig(path)


def _is_capture(frames: object, plan: PatternPlan | None) -> bool:
    """Whether frames are a stack or a capture, which have a plan; arrays need one beside them."""
    arrays = isinstance(frames, np.ndarray) or (
        isinstance(frames, Sequence)
        and not isinstance(frames, str)
        and any(isinstance(frame, np.ndarray) for frame in frames)
    )
    if arrays and plan is None:
        raise InputError("plan: expected the plan that the frames follow, got none")
    if not arrays and plan is not None:
        got = f"the path {frames}" if is_path(frames) else f"a {type(frames).__name__}"
        raise InputError(
            f"plan: expected none with a stack or a capture, which has its own; got {got}"
        )
    return not arrays
