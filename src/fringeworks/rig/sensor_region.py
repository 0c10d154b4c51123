"""A rig whose camera shows another part of its sensor, or pixels of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks.types import (
    RIG_PARAMETERS,
    CameraBlur,
    ColourPlane,
    FloatMap,
    InputError,
    LensField,
    Pinhole,
    Region,
    Rig,
    RigMismatch,
)
from fringeworks.types.checks import MOST_PX, positive, whole

PIXEL_PX2 = 1.0 / 12.0
"""Variance that collecting light over a whole pixel adds to the blur, px²."""
GREENS_PX2 = 0.25
"""Variance that the mean of the two greens of a mosaic adds to the blur: each lies half a pixel
from their middle, px²."""
LEAST_SIDE_PX = 16
"""Smallest side of frames that a rig is converted for, px: smaller ones measure nothing."""


def for_frames(
    rig: Rig, *, region: Region | None = None, binning: int = 1, scale: float = 1.0
) -> Rig:
    """Return the rig for other frames of the same camera: cropped, binned or resampled.

    Parameters
    ----------
    rig : Rig
    region : Region, optional
        Part of the frames that the rig is for, in their pixels. All of them by default.
    binning : int ≥ 1
        Number of pixels along columns and rows that are then one.
    scale : float > 0
        Size of frames that were resampled instead, over that before.

    Returns
    -------
    Rig with its covariance, field, blur and residuals in the new pixels.

    Raises
    ------
    InputError for a region that is not inside the frames, and for numbers out of range.

    Notes
    -----
    A pixel at x becomes s (x − x₀ + ½) − ½ with s = 1/n or the scale: f' = s f, and c' likewise.
    The variance of the blur becomes s² (v − 1/12) + 1/12, because the larger pixels collect light
    over their own area; pixels that are made smaller keep s² v.
    """
    camera = rig.camera
    whole_frame = Region(0, 0, camera.width_px, camera.height_px)
    region = whole_frame if region is None else region
    if not _holds(whole_frame, region):
        raise InputError(
            f"region: expected one inside {camera.width_px} × {camera.height_px} px, got "
            f"{region.width_px} × {region.height_px} px from column {region.x_px}, row "
            f"{region.y_px} on"
        )
    size, made = [region.width_px, region.height_px], _made_size(region, binning, scale)
    if region == whole_frame and made == size:
        return rig
    # Resampled frames have whole sizes, so that each axis has a scale of its own.
    s = np.array([1.0 / binning if binning > 1 else a / b for a, b in zip(made, size, strict=True)])
    shown = _on_sensor(rig.region, region) if (s == 1.0).all() else None
    return _converted(rig, region, np.zeros(2), s, made, shown)


def _converted(
    rig: Rig,
    region: Region,
    moved_px: FloatMap,
    s: FloatMap,
    made: list[int],
    shown: Region | None,
    area_px2: float | None = None,
) -> Rig:
    """The rig for pixels of another size in a region that begins ``moved_px`` further on.

    ``area_px2`` is the variance that the new pixels' area adds to the blur, in the old pixels; by
    default that of larger pixels.
    """
    camera = rig.camera
    first = np.array([region.x_px, region.y_px], np.float64) + moved_px
    principal = s * (np.array(camera.principal_px) - first + 0.5) - 0.5
    focal = s * np.array(camera.focal_px)
    covariance = None
    if rig.covariance is not None:
        by = np.ones(len(RIG_PARAMETERS))
        by[:4] = np.tile(s, 2)
        covariance = rig.covariance * np.outer(by, by)
    residual = rig.residual_px
    return replace(
        rig,
        camera=Pinhole(
            made[0],
            made[1],
            (focal[0], focal[1]),
            (principal[0], principal[1]),
            camera.distortion,
            None if camera.field is None else _field(camera.field, first, s),
        ),
        covariance=covariance,
        residual_px=None if residual is None else (float(s.mean()) * residual[0], residual[1]),
        blur=None if rig.blur is None else _blur(rig.blur, camera.shape, region, s, area_px2),
        region=shown,
    )


def _for_plane(rig: Rig, plane: ColourPlane) -> Rig:
    """The rig for every second column and row of its frames, or of a part of them.

    A pixel at x becomes ½ (x − x₀), with the first pixel at x₀. Its area stays that of the sensor's
    pixel, so that the variance of the blur becomes ¼ v. The mean of two greens adds ¼ px² to v,
    because they lie half a pixel from their middle along both axes.
    """
    rows, columns = plane.shape
    if rig.region is not None:
        whole = Region(plane.x_px, plane.y_px, plane.width_px, plane.height_px)
        rig = rig_for_region(rig, whole)
    elif tuple(n // 2 for n in rig.camera.shape) != plane.shape:
        return rig  # already for such frames, or for others, which is told where they are compared
    return _converted(
        rig,
        Region(0, 0, *rig.camera.shape[::-1]),
        np.array(plane.first_px) - 0.5,
        np.array([0.5, 0.5]),
        [columns, rows],
        plane,
        float(np.mean(np.array(plane.first_px) == 0.5)) * GREENS_PX2,
    )


def _made_size(region: Region, binning: int, scale: float) -> list[int]:
    """Columns and rows of the new frames."""
    if not whole(binning, 1, MOST_PX) or not positive(scale):
        raise InputError(f"expected binning >= 1 and a scale > 0, got {binning} and {scale}")
    if binning > 1 and scale != 1.0:
        raise InputError(f"expected binning or a scale, got {binning} and {scale}")
    made = [
        n // binning if binning > 1 else round(n * scale)
        for n in (region.width_px, region.height_px)
    ]
    if min(made) < LEAST_SIDE_PX or max(made) > MOST_PX:
        raise InputError(
            f"expected frames of {LEAST_SIDE_PX} to {MOST_PX} px, got {made[0]} × {made[1]}"
        )
    return made


def rig_for_region(rig: Rig, region: Region | None) -> Rig:
    """Return the rig for frames of a part of the sensor, where both say which they show.

    Raises
    ------
    RigMismatch for frames that show what the rig was not calibrated for.
    """
    known = rig.region
    if isinstance(region, ColourPlane) and not isinstance(known, ColourPlane):
        return _for_plane(rig, region)
    if region is None or known is None or region == known:
        return rig
    if isinstance(known, ColourPlane):
        raise RigMismatch(
            f"rig: it is for the pixels of one colour, every second one from {_first(known)} on, "
            f"got frames of {_first(region)}"
        )
    if not _holds(known, region):
        raise RigMismatch(
            f"rig: it is for {_told(known)} of the sensor, got frames of {_told(region)}"
        )
    inside = replace(region, x_px=region.x_px - known.x_px, y_px=region.y_px - known.y_px)
    return for_frames(rig, region=inside)


def _first(region: Region) -> str:
    """Which pixels of a mosaic frames have."""
    if not isinstance(region, ColourPlane):
        return "all pixels"
    return "column {:g}, row {:g}".format(*region.first_px)


def _told(region: Region) -> str:
    return (
        f"columns {region.x_px} to {region.x_px + region.width_px - 1} and rows {region.y_px} to "
        f"{region.y_px + region.height_px - 1}"
    )


def _holds(outer: Region, inner: Region) -> bool:
    """Whether one region lies inside another."""
    return (
        outer.x_px <= inner.x_px
        and outer.y_px <= inner.y_px
        and inner.x_px + inner.width_px <= outer.x_px + outer.width_px
        and inner.y_px + inner.height_px <= outer.y_px + outer.height_px
    )


def _on_sensor(known: Region | None, region: Region) -> Region | None:
    """A region of the frames, in pixels of the sensor."""
    if known is None:
        return None
    return replace(region, x_px=known.x_px + region.x_px, y_px=known.y_px + region.y_px)


def _field(field: LensField, first: FloatMap, s: FloatMap) -> LensField:
    """The field by the place in the new frame, in its pixels."""
    x, y = s * (np.array(field.first_px) - first + 0.5) - 0.5
    step_x, step_y = s * np.array(field.step_px)
    return LensField(
        (float(x), float(y)),
        (float(step_x), float(step_y)),
        field.control_px * s,
        field.sigma_px * s,
    )


def _blur(
    blur: CameraBlur,
    shape: tuple[int, int],
    region: Region,
    s: FloatMap,
    area_px2: float | None = None,
) -> CameraBlur:
    """The blur by the place in the new frame, in its pixels.

    The old place is x = a x' + b, in halves of the widths from the middles of the frames.
    """
    half = 0.5 * shape[1]
    a = region.width_px / shape[1]
    bx = (region.x_px + 0.5 * (region.width_px - shape[1])) / half
    by = (region.y_px + 0.5 * (region.height_px - shape[0])) / half
    c0, c1, c2, c3, c4, c5 = blur.factors_px2
    moved = np.array(
        [
            c0 + c1 * bx + c2 * by + c3 * (bx * bx + by * by),
            a * (c1 + 2.0 * c3 * bx),
            a * (c2 + 2.0 * c3 * by),
            a * a * c3,
            c4,
            c5,
        ]
    )
    square = float(np.mean(s * s))
    own = min(PIXEL_PX2, abs(float(moved[0])))
    moved *= square
    if area_px2 is not None:
        moved[0] += square * area_px2
    elif square < 1.0:
        moved[0] += own * (1.0 - square)
    return replace(blur, factors_px2=tuple(float(v) for v in moved))
