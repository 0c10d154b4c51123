"""Where the camera sees the projector's pixels, and whether the picture is mirrored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.plan import Block, GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.frames import pictures_of
from fringeworks.stack.decode import decode
from fringeworks.types import Axis, DeviceProblem, Finding, FloatMap, Frozen, InputError

PERIOD_PX = 32.0
"""Period of the fringes, projector px: coarse, so that optics out of focus still show them."""
STEPS = 4
"""Phase steps."""
MIN_SEEN_SHARE = 0.005
"""Smallest share of the frame with coordinates along both axes from which the orientation is
known."""


@dataclass(frozen=True, eq=False, repr=False)
class Orientation(Frozen):
    """Projector coordinates of the camera's pixels, measured coarsely."""

    x_px: FloatMap
    """Projector column, (h, w), px; NaN where it is unknown."""
    y_px: FloatMap
    """Projector row, (h, w), px; NaN where it is unknown."""
    mirrored: bool
    """Whether the camera sees the picture mirrored."""
    findings: tuple[Finding, ...]


def check_orientation(
    projector: Projector, camera: Camera, agreement: Agreement, *, gamma: float = 1.0
) -> Orientation:
    """Measure projector coordinates along both axes with coarse fringes and Gray code.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    agreement : Agreement
        Of both.
    gamma : float
        Exponent of the response, which the pictures make up for: four steps alone would take the
        harmonics of a strong one for another plan.

    Returns
    -------
    Orientation

    Raises
    ------
    DeviceProblem where too few pixels have coordinates.

    Notes
    -----
    Camera and projector look at the same side of the surface. Columns and rows of the projector
    then form a system of the same orientation as those of the camera, unless one of the pictures
    is mirrored: the determinant of ∂(x_p, y_p)/∂(x_c, y_c) is positive.
    """
    columns, rows = projector.size_px
    blocks: list[Block] = [Uniform("white"), Uniform("black")]
    axes: tuple[tuple[Axis, int], ...] = (("x", columns), ("y", rows))
    for axis, length in axes:
        blocks.append(PhaseSteps(axis, PERIOD_PX, equal_steps(STEPS)))
        blocks.append(GrayCode(axis, 0.5 * PERIOD_PX, length))
    plan = PatternPlan(columns, rows, tuple(blocks), bits=projector.bits, gamma=gamma)
    frames = [grab.pixels for _, (grab,) in agreement.frames(pictures_of(projector, plan))]
    try:
        decoded = decode(frames, plan, estimate_steps=False)
    except InputError as error:
        raise DeviceProblem(
            f"{camera.name}: expected coarse fringes that can be decoded, got: {error}",
            findings=error.findings,
        ) from error
    assert decoded.x is not None
    assert decoded.y is not None
    x, y = (np.asarray(m.coordinate_px, np.float64) for m in (decoded.x, decoded.y))
    determinant = np.gradient(x, axis=1) * np.gradient(y, axis=0)
    determinant = determinant - np.gradient(x, axis=0) * np.gradient(y, axis=1)
    known = np.isfinite(determinant)
    if known.mean() < MIN_SEEN_SHARE:
        raise DeviceProblem(
            f"{camera.name}: expected coarse fringes on {MIN_SEEN_SHARE:.1%} of the frame or more, "
            f"got them on {known.mean():.2%}: focus both devices on the object, and use more light"
        )
    mirrored = bool(np.median(determinant[known]) < 0)
    return Orientation(
        x.astype(np.float32), y.astype(np.float32), mirrored, (_mirrored(),) if mirrored else ()
    )


def _mirrored() -> Finding:
    return Finding(
        "mirrored",
        "the camera sees the projector's picture mirrored",
        (
            "a projector set to projection from behind or from the ceiling",
            "a camera or driver that mirrors its frames",
            "a mirror between the two",
        ),
        "set the projector to projection from the front, and switch off mirroring in the camera's "
        "settings; for a projector that must show columns from right to left, write "
        'mirrored = ["x"] in the plan',
        severity="error",
    )
