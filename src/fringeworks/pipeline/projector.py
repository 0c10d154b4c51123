"""Scenes that calibrated cameras saw under a projector that only codes → the projector as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Unpack

from fringeworks.files.atomic import StrPath
from fringeworks.files.multi_rig import read_multi_rig
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.cameras import measure_cameras
from fringeworks.pipeline.inputs import inputs_of, stacks_of
from fringeworks.rig.calibration.from_points import LitPoints, calibrated_projector, lit_points
from fringeworks.stack.frames import Stack
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import InputError, MultiRig, Source, made_by

COEFFICIENTS = (0, 2, 4, 5)
"""Numbers of coefficients of distortion that a calibration estimates."""


def calibrate_projector(
    scenes: Sequence[Sequence[Stack | Sequence[Stack] | StrPath]],
    rig: MultiRig | StrPath,
    *,
    distortion: int = 5,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> MultiRig:
    """Calibrate a projector from scenes that calibrated cameras measured by its codes.

    Parameters
    ----------
    scenes : sequence of scenes, each a sequence with the stack of every camera
        Any surfaces at rest, under codes along both axes, that fill the frame and its depth. A
        plane at several distances and tilts will do. No board is needed.
    rig : MultiRig or path
        The cameras; its projector only codes.
    distortion : 0, 2, 4 or 5
        Number of the projector's coefficients of distortion: as for ``calibrate``.
    progress : callable
        Called with what is done.
    **options
        Of ``decode``.

    Returns
    -------
    MultiRig with the projector. The cameras stay as they are; the covariance holds how their errors
    move the projector.

    Raises
    ------
    InputError for a rig whose projector is calibrated, codes along one axis, and points that do not
    determine a projector, such as those of one plane; and as ``measure``.

    Notes
    -----
    The points of the cameras and the coordinates that light them make the projector an inverse
    camera: it is resected from them, with its lens. Its figures hold for the volume of the points.
    """
    if not isinstance(rig, MultiRig):
        rig = read_multi_rig(rig)
    if rig.projector is not None:
        raise InputError("rig: expected cameras whose projector only codes, got a calibrated one")
    if distortion not in COEFFICIENTS:
        raise InputError(f"distortion: expected 0, 2, 4 or 5 coefficients, got {distortion}")
    if not scenes:
        raise InputError("scenes: expected one scene or more, got none")
    parts: list[LitPoints] = []
    plans: list[PatternPlan] = []
    inputs: list[Source] = []
    for number, scene in enumerate(scenes, 1):
        progress(f"scene {number} …")
        try:
            shots = [stacks_of(stack) for stack in scene]
            found = measure_cameras(shots, rig, **options)
            parts.append(lit_points(rig, found.cameras[0], found.decoded[0]))
        except InputError as error:
            raise error.at(f"scene {number}") from error
        plans.append(shots[0][0].plan)
        sources = [source for stacks in shots for source in inputs_of(*stacks)]
        inputs += [replace(one, name=f"scene {number}: {one.name}") for one in sources]
    sizes = {(plan.width_px, plan.height_px) for plan in plans}
    if len(sizes) > 1:
        raise InputError("scenes: expected plans for one size of the projector, got several")
    progress("adjusting …")
    origin = made_by(
        "calibrate_projector",
        options={"distortion": distortion, **options},
        inputs=tuple(inputs),
        plan=plans[0] if len(set(plans)) == 1 else tuple(plans),
        rig=rig,
    )
    return replace(calibrated_projector(rig, parts, sizes.pop(), distortion), provenance=origin)
