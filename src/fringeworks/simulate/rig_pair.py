"""Pairs of frames from the virtual rig: two frames with everything that its optics can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.simulate.exposure import Transport, photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, InputError, Pair


def photograph_pair(
    reference: View,
    object_: View,
    period_px: float,
    optics: Optics | None = None,
    *,
    transport: tuple[Sequence[Transport], Sequence[Transport]] = ((), ()),
) -> Pair:
    """Take the two frames of a reference and an object under the same fringes along x.

    Parameters
    ----------
    reference, object_ : View
        From ``look``, of the same rig.
    period_px : float ≥ 2
        Period of the fringes, projector px.
    optics : Optics, optional
        The noise of the object's frame has the next seed.
    transport : (sequence of Transport, sequence of Transport)
        What light does in the scenes of the reference and of the object.

    Returns
    -------
    Pair without a geometry; ``pair_displacement`` is its truth.

    Raises
    ------
    InputError for views of two rigs.
    """
    if reference.rig != object_.rig:
        raise InputError("views: expected those of one rig, got two")
    optics = optics or Optics()
    size = (reference.rig.projector.width_px, reference.rig.projector.height_px)
    plan = PatternPlan(*size, (PhaseSteps("x", period_px, equal_steps(3)),))
    frames: list[NDArray[Any]] = []
    for k, view in enumerate((reference, object_)):
        seeded = replace(optics, seed=optics.seed + k)
        frames.append(next(photograph(view, plan, seeded, transport=transport[k])))
    return Pair(reference=frames[0], object=frames[1], axis="x")


def pair_displacement(reference: View, object_: View) -> FloatMap:
    """Return the displacement between two views exactly.

    Parameters
    ----------
    reference, object_ : View

    Returns
    -------
    (h, w) array, px: u with d(x) = s(x − u). NaN where one of the two places is not lit.

    Notes
    -----
    The object's pixel x and the reference's pixel x − u get light of the same projector column.
    """
    h, w = reference.body.shape
    columns = np.arange(w, dtype=np.float64)
    u = np.full((h, w), np.nan)
    for row in range(h):
        lit = reference.lit[row]
        if lit.sum() < 2:
            continue
        sent = reference.projector_px[row, lit, 0]
        order = np.argsort(sent)
        found = np.interp(
            object_.projector_px[row, :, 0],
            sent[order],
            columns[lit][order],
            left=np.nan,
            right=np.nan,
        )
        u[row] = columns - found
    return np.where(object_.lit, u, np.nan)
