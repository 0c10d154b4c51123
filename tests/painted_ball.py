"""A painted ball before a camera, and what its pictures show."""

from __future__ import annotations

import numpy as np

import fringeworks as fw
from fringeworks.simulate.bodies import Sphere
from fringeworks.simulate.virtual_rig import look
from tests import rigs


def linear(counts):
    """Light of sRGB counts, by the inverse of the standard's formula."""
    v = np.asarray(counts, float) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def paint(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.stack(
        (0.5 + 0.4 * np.sin(x / 9), 0.5 + 0.4 * np.cos(y / 7), 0.5 + 0.4 * np.sin((x + y) / 11)), -1
    )


def cloud(colour=True):
    """The true points of a ball before a camera, with paint that varies within a few pixels."""
    view = look(rigs.rig(), [rigs.ahead(Sphere(20.0), 5, 3)])
    xyz = np.asarray(view.points_mm, np.float32)
    reason = np.where(np.isfinite(xyz[..., 2]), 0, fw.Reason.SHADOW).astype(np.uint8)
    sigma = np.where(reason == 0, 0.01, np.nan)
    shown = 200 * paint(reason.shape) if colour else None
    return fw.PointCloud(xyz, sigma, sigma, reason, colour=shown)
