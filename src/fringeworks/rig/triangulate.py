"""Triangulation: projector coordinates and a calibrated rig to points in mm (theory §8, §9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.rig.epipolar import calibration_share, states_errors, unstated_error
from fringeworks.rig.point_findings import misfit_findings
from fringeworks.rig.ray_depth import axis_length, calibration_spread, main_axis
from fringeworks.types import (
    Axis,
    ByteMap,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    InputError,
    LensField,
    PointCloud,
    Reason,
    Rig,
    RigMismatch,
    check_reusable,
    sealed,
    unsealed,
)
from fringeworks.types.finding import LEFT_OUT

FIELDS = {
    "xyz": "xyz_mm",
    "sigma": "sigma_mm",
    "noise": "noise_mm",
    "reason": "reason",
    "residual": "residual_px",
}
"""Names of the kernel's arrays and the fields of a ``PointCloud`` that hold them."""
RESIDUAL_SIGMAS = 5.0
"""Largest epipolar error that is accepted, in its standard deviations. Normal errors exceed five
in one of two million pixels."""
CHECKED_ROWS = 16
"""Rows of a frame, about, that are looked at to see whether a rig belongs to it."""
MAX_BEYOND = 0.01
"""Share of coordinates beyond the projector's frame from which on the rig is taken for another
projector's. Noise at the border puts fewer there."""
MAX_BEHIND = 0.5
"""Share of points behind camera or projector from which on the rig is refused."""
MAX_APART = 0.9
"""Share of pixels with too large an epipolar error from which on the rig is refused."""
MAX_LOST = 0.3
"""Share of pixels that are lost for either reason from which on the rig is refused, where the
epipolar error is large as well. Light between surfaces loses pixels, but leaves the others right.
Empirical."""
MISFIT_PX = 2.0
"""Median epipolar error that is large, projector px. Calibrations by other programs leave 0.3 to
0.9 px; mirrored frames and those of another sensor make 5 to 20 px."""


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


class Triangulator:
    """Triangulates with one rig, again and again.

    The tables that depend on the rig alone are computed once for each choice of axes and kept.

    Parameters
    ----------
    rig : Rig

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> Triangulator(standard_rig(scale=0.1)).rig.camera.shape
    (102, 128)
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._kernels: dict[Axis | None, _core.Triangulation] = {}

    @property
    def rig(self) -> Rig:
        """The rig that points are computed with."""
        return self._rig

    def triangulate(
        self,
        decoded: Decoded,
        *,
        axis: Axis | None = None,
        residual_sigmas: float = RESIDUAL_SIGMAS,
        epipolar_px: float | None = None,
        colour: FloatMap | None = None,
        out: PointCloud | None = None,
    ) -> PointCloud:
        """Points of a surface from projector coordinates; see ``triangulate``."""
        rig = self._rig
        maps = _chosen(decoded, rig, axis)
        if not residual_sigmas > 0:
            raise InputError(f"residual_sigmas: expected > 0, got {residual_sigmas}")
        if epipolar_px is not None and not 0 <= epipolar_px < np.inf:
            raise InputError(f"epipolar_px: expected >= 0 px, got {epipolar_px}")
        shape = rig.camera.shape
        if colour is not None and np.shape(colour)[:2] != shape:
            raise InputError(f"colour: expected shape {shape}, got {np.shape(colour)}")
        both, stated_px = len(maps) == 2, epipolar_px
        if epipolar_px is None:
            epipolar_px = calibration_share(rig, maps) if both else 0.0
            stated_px = epipolar_px if states_errors(rig) else 0.0
        results = empty_arrays(shape, both) if out is None else reused_arrays(out, shape, both)
        self._kernel(None if both else next(iter(maps))).triangulate(
            input_arrays(maps.get("x")),
            input_arrays(maps.get("y")),
            results,
            limits={"residual_sigmas": residual_sigmas, "residual_px": epipolar_px},
        )
        misfit_px, rms_px = _refuse_nothing(results)
        more = unstated_error(misfit_px, rms_px, rig, maps, stated_px or 0.0) if both else 0.0
        if more:
            _add_misfit(results, maps[main_axis(rig)].sigma_px, more)
        found = misfit_findings(misfit_px, more)
        return _cloud(results, colour, (*decoded.findings, *found))

    def _kernel(self, axis: Axis | None) -> _core.Triangulation:
        """The kernel for one axis, or for both (None)."""
        if axis not in self._kernels:
            rig = self._rig
            along = main_axis(rig) if axis is None else axis
            self._kernels[axis] = _core.Triangulation(
                {
                    "camera": [float(v) for v in rig.camera.parameters],
                    "projector": [float(v) for v in rig.projector.parameters],
                    "rotation": [float(v) for v in rig.T_projector_camera[:3, :3].ravel()],
                    "translation": [float(v) for v in rig.T_projector_camera[:3, 3]],
                    "camera_field": _field_items(rig.camera.field),
                    "projector_field": _field_items(rig.projector.field),
                },
                {
                    "coefficients": calibration_spread(rig, axis, along),
                    "along_x": along == "x",
                    "length": float(axis_length(rig, along)),
                },
                camera_shape=rig.camera.shape,
                projector_size=(rig.projector.width_px, rig.projector.height_px),
            )
        return self._kernels[axis]


def _field_items(field: LensField | None) -> _core._Field | None:
    """A device's field as the kernel reads it."""
    if field is None:
        return None
    return {
        "first": [float(v) for v in field.first_px],
        "step": [float(v) for v in field.step_px],
        "columns": field.control_px.shape[1],
        "control": [float(v) for v in field.control_px.ravel()],
    }


def measured_points(
    triangulator: Triangulator,
    stacks: Mapping[Axis, tuple[Sequence[NDArray[Any]], _core.DecodeSettings]],
    *,
    typical_px: Mapping[Axis, float] | None,
    epipolar_px: float,
    findings: tuple[Finding, ...],
    out: PointCloud | None,
    factors: FloatMap | None = None,
) -> PointCloud:
    """Points from frames in one pass, without maps of coordinates.

    Parameters
    ----------
    stacks : frames and settings of the decoding kernel, for one axis or both
    typical_px : typical difference of neighbouring coordinates of each axis, px, by which isolated
        pixels are found; None keeps them
    epipolar_px, out : as for ``triangulate``
    findings : kept with the points
    factors : (h, w) float32 array, optional
        By how much the noise of every pixel is larger than that of the frames.
    """
    both, shape = len(stacks) == 2, triangulator.rig.camera.shape
    results = empty_arrays(shape, both) if out is None else reused_arrays(out, shape, both)
    steps = None
    if typical_px is not None:
        steps = typical_px.get("x", 0.0), typical_px.get("y", 0.0)
    _core.measure_points(
        stacks.get("x"),
        stacks.get("y"),
        triangulator._kernel(None if both else next(iter(stacks))),
        results,
        typical=steps,
        limits={"residual_sigmas": RESIDUAL_SIGMAS, "residual_px": epipolar_px},
    )
    _refuse_nothing(results)
    if factors is not None:
        _raise_noise(results, factors)
    return _cloud(results, None, findings)


def _raise_noise(results: dict[str, Any], factors: FloatMap) -> None:
    """Raise the noise of points, and σ by as much, in place."""
    noise, sigma = results["noise"], results["sigma"]
    np.multiply(sigma, sigma, out=sigma)
    sigma += noise**2 * (factors**2 - np.float32(1.0))
    np.sqrt(sigma, out=sigma)
    noise *= factors
    np.maximum(sigma, noise, out=sigma)


def triangulate(
    decoded: Decoded,
    rig: Rig,
    *,
    axis: Axis | None = None,
    residual_sigmas: float = RESIDUAL_SIGMAS,
    epipolar_px: float | None = None,
    colour: FloatMap | None = None,
    out: PointCloud | None = None,
) -> PointCloud:
    """Points of a surface from projector coordinates. ``Triangulator`` does it again and again.

    Parameters
    ----------
    decoded : Decoded
        Absolute coordinates along one axis or both, from the rig's camera.
    rig : Rig
    axis : "x" or "y", optional
        Use this axis only; both where both were decoded.
    residual_sigmas : float > 0
        With both axes: epipolar error, in standard deviations of pixel noise and calibration,
        beyond which a pixel is NaN (``RAYS_APART``).
    epipolar_px : float >= 0, optional
        With both axes: standard deviation of the epipolar error that the rig causes, px. By
        default it comes from the rig's residuals and covariance. Where the rig states neither, as
        rigs of other programs, it is the scatter of the epipolar error in these coordinates, at
        most 1 px.
    colour : (h, w) or (h, w, 3) array, optional
        Kept with the points.
    out : PointCloud, optional
        An earlier result of the same kind. Its arrays are written to again; it is not valid
        afterwards.

    Returns
    -------
    PointCloud in camera coordinates.

    Raises
    ------
    RigMismatch for maps of another size than the rig's camera, coordinates beyond the rig's
    projector, and where the rays hardly meet in front of both devices. InputError for relative
    coordinates, for an axis that was not decoded, and for ``out`` with arrays of other shapes,
    types or strides than those of a result.

    Notes
    -----
    The camera's pixel is exact: the point lies on its ray, at the distance 1/w. With one axis, the
    ray meets the surface that a column or row of the projector lights. With both, w minimises the
    distance to the decoded point weighted by its variances. The equations hold the lens distortion
    of both devices. σ² = noise + calibration: the derivative of the distance by the coordinates,
    and by the rig's 24 parameters with their covariance (theory §8, §9).

    Examples
    --------
    >>> import fringeworks as fw
    >>> from fringeworks.simulate import bust, fringe_plan, look, photograph, standard_rig
    >>> rig = standard_rig(scale=0.1)
    >>> plan = fringe_plan(rig, both=False)
    >>> decoded = fw.decode(list(photograph(look(rig, bust()), plan)), plan)
    >>> triangulate(decoded, rig).xyz_mm.shape
    (102, 128, 3)
    """
    return Triangulator(rig).triangulate(
        decoded,
        axis=axis,
        residual_sigmas=residual_sigmas,
        epipolar_px=epipolar_px,
        colour=colour,
        out=out,
    )


def _chosen(decoded: Decoded, rig: Rig, axis: Axis | None) -> dict[Axis, CoordinateMap]:
    if not isinstance(decoded, Decoded):
        raise InputError(
            f"decoded: expected Decoded, as decode returns, got {type(decoded).__name__}"
        )
    maps = decoded.maps
    if axis is not None:
        if axis not in maps:
            raise InputError(f"axis: expected one of {', '.join(maps)}, got {axis}")
        maps = {axis: maps[axis]}
    if not maps:
        raise InputError("decoded: expected coordinates along an axis or both, got none")
    camera, projector = rig.camera, rig.projector
    for name, found in maps.items():
        h, w = found.coordinate_px.shape
        if (h, w) != camera.shape:
            raise RigMismatch(
                f"rig: it is for a camera of {camera.width_px} × {camera.height_px} px, got "
                f"frames of {w} × {h}; for_frames and rig convert --crop, --bin, --scale make one "
                "for other frames of the same camera"
            )
        if found.repeats_px is not None:
            raise InputError(
                f"{name}: expected absolute coordinates, got some that repeat every "
                f"{found.repeats_px:g} px"
            )
        length = projector.width_px if name == "x" else projector.height_px
        rows = found.coordinate_px[:: max(1, h // CHECKED_ROWS)]
        with np.errstate(invalid="ignore"):
            beyond = float(np.mean(rows > length + 1))
        if beyond > MAX_BEYOND:
            raise RigMismatch(
                f"rig: it is for a projector of {projector.width_px} × {projector.height_px} px, "
                f"got coordinates up to {np.nanmax(rows):.0f} along {name}"
            )
    # An axis of which nothing is measured must not take the points of the other.
    left_out = {f.axis for f in decoded.findings if f.kind == LEFT_OUT}
    return {name: found for name, found in maps.items() if name not in left_out} or maps


def _cloud(
    results: dict[str, Any], colour: FloatMap | None, findings: tuple[Finding, ...]
) -> PointCloud:
    """The kernel's results as a point cloud."""
    residual = results["residual"]
    return PointCloud(
        xyz_mm=sealed(results["xyz"]),
        sigma_mm=sealed(results["sigma"]),
        noise_mm=sealed(results["noise"]),
        reason=sealed(results["reason"]),
        residual_px=None if residual is None else sealed(residual),
        colour=colour,
        findings=findings,
    )


def _add_misfit(results: dict[str, Any], sigma_px: FloatMap, misfit_px: float) -> None:
    """Add an epipolar error, as a standard deviation, to σ, in place: what a rig is off across the
    epipolar lines, it is likely off along them, where nothing shows it."""
    sigma = results["sigma"]
    with np.errstate(invalid="ignore", divide="ignore"):
        mm_per_px = results["noise"] / sigma_px
        np.sqrt(sigma**2 + (np.float32(misfit_px) * mm_per_px) ** 2, out=sigma)


def _refuse_nothing(results: dict[str, Any]) -> tuple[float, float]:
    """Refuse a rig whose rays hardly ever meet: it does not belong to the capture.

    Returns
    -------
    Median and root mean square of the epipolar errors of the others, projector px; 0 with a single
    axis.
    """
    all_reasons: ByteMap = results["reason"]
    rows = slice(None, None, max(1, all_reasons.shape[0] // CHECKED_ROWS))
    reason = all_reasons[rows]
    apart = int(np.sum(reason == Reason.RAYS_APART))
    behind = int(np.sum(reason == Reason.BEYOND_GEOMETRY))
    decoded = int(np.sum(reason == Reason.OK)) + apart + behind
    if decoded and behind > MAX_BEHIND * decoded:
        raise RigMismatch(
            f"rig: {behind / decoded:.0%} of the points lie behind the camera or the projector: "
            "it does not belong to this capture, or columns and rows are swapped"
        )
    if decoded and apart > MAX_APART * decoded:
        raise RigMismatch(
            f"rig: rays of camera and projector pass each other in {apart / decoded:.0%} of the "
            "pixels: it does not belong to this capture, the plan says other patterns than were "
            "shown, or a device was moved since"
        )
    if results["residual"] is None or not decoded:
        return 0.0, 0.0
    error = np.abs(results["residual"][rows])
    error = error[np.isfinite(error)]
    usual = float(np.median(error)) if error.size else 0.0
    lost = (apart + behind) / decoded
    if lost > MAX_LOST and usual > MISFIT_PX:
        raise RigMismatch(
            f"rig: {lost:.0%} of the decoded pixels give no point, and the epipolar error is "
            f"{usual:.2g} px (median): it does not belong to this capture, the frames are mirrored "
            "or of another sensor, the plan says other patterns than were shown, or a device was "
            "moved since"
        )
    return usual, float(np.sqrt(np.mean(error**2))) if error.size else 0.0
