"""Boxes whose edges jump by parts of a period and more, with and without their shadows."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

import fringeworks as fw

SHAPE = (150, 220)
PERIOD = 12.0
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


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


def photographed(u, *, lit=True, gamma=1.0, seed=0, drift=0.0):
    """Fringes displaced by u px along x, blurred, with noise, 8 bit."""
    wave = (0.5 + 0.5 * np.cos(2 * np.pi * ((X - u) / PERIOD + drift))) ** gamma
    light = ndimage.gaussian_filter(10.0 + 180.0 * wave * lit, 0.7)
    noise = np.random.default_rng(seed).standard_normal(SHAPE)
    return np.clip(np.round(light + noise), 0, 255).astype(np.uint8)


def box(periods):
    """A turned box of so many periods, lit from the left: its displacement, and what is lit."""
    step = periods * PERIOD

    def on(x):
        along, across = 0.9 * (x - 90) + 0.436 * (Y - 75), 0.9 * (Y - 75) - 0.436 * (x - 90)
        return (np.abs(along) < 35) & (np.abs(across) < 32)

    shade = np.any([on(X - t) for t in np.arange(0.0, step, 0.5)], axis=0) & ~on(X)
    return np.where(on(X), -step, 0.0), ~shade


def boxed(periods):
    u, lit = box(periods)
    return fw.Pair(photographed(0.0), photographed(u, lit=lit, seed=1), axis="x"), u, lit
