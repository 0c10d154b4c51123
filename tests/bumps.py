"""A painted bump, and frames of any plan on it."""

from __future__ import annotations

import numpy as np

SIZE = (400, 300)
ROWS, COLUMNS = np.mgrid[:150, :200]
COLUMN = COLUMNS * 1.6 + 20.0 + 8.0 * np.exp(-((COLUMNS - 100) ** 2 + (ROWS - 75) ** 2) / 900)
ROW = ROWS * 1.6 + 20.0


def seen(plan, seed=0):
    """Frames of a painted bump in noise."""
    rng = np.random.default_rng(seed)
    paint = 0.6 + 0.4 * np.sin(COLUMNS / 17) * np.cos(ROWS / 13)
    frames = []
    for block in plan.blocks:
        at = ROW if getattr(block, "axis", "x") == "y" else COLUMN
        for k in range(block.frames):
            light = 15 + paint * (20 + 160 * block.values(at, k))
            noisy = light + 1.5 * rng.standard_normal(light.shape)
            frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return frames
