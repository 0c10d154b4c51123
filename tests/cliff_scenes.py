"""Boxes on a tilted plane, whose edges jump by parts of a period."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

import fringeworks as fw


def boxes(seed, period, *, quality=None, painted=False, side=400):
    """Boxes on a tilted plane, seen by a lens that blurs; their edges jump by up to 0.45 periods."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side].astype(float)
    plane = 0.01 * (x - side / 2) + 0.004 * (y - side / 2)
    u, cliff = plane.copy(), np.zeros((side, side), bool)
    for _ in range(3):
        (cx, cy), (w, h) = rng.uniform(0.2, 0.8, 2) * side, rng.uniform(30, 90, 2)
        t = rng.uniform(0, np.pi)
        along = (x - cx) * np.cos(t) + (y - cy) * np.sin(t)
        across = (y - cy) * np.cos(t) - (x - cx) * np.sin(t)
        inside = (np.abs(along) < w) & (np.abs(across) < h)
        u = np.where(inside, plane + rng.uniform(0.2, 0.45) * period * rng.choice([-1, 1]), u)
    cliff = ndimage.maximum_filter(u, 3) - ndimage.minimum_filter(u, 3) > 0.1 * period
    albedo = np.ones_like(x)
    if painted:
        albedo[np.abs(x - y + 40) < 25] = 0.6

    def frame(shift, albedo):
        light = 128 + 90 * np.cos(2 * np.pi * (x - shift) / period)
        light = ndimage.gaussian_filter(albedo * light, 0.8) + rng.normal(0, 1.5, x.shape)
        image = np.clip(np.rint(light), 0, 255).astype(np.uint8)
        if quality is not None:
            image = cv2.imdecode(
                cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0
            )
        return image

    near = ndimage.distance_transform_cdt(~cliff, "chessboard")
    return fw.Pair(frame(0 * u, 1.0), frame(u, albedo), axis="x"), u, near
