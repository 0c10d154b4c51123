"""Places without fringes grown to their rim, with local means by Gaussians."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.pair.presence import REACH_PERIODS


def grown_to_rim(frame, core, period_px):
    """The places (h, w) with the pixels that belong to them by their brightness."""
    near = scipy.ndimage.distance_transform_edt(~core) <= REACH_PERIODS * period_px

    def local_mean(values, where):
        share = scipy.ndimage.gaussian_filter(where.astype(float), period_px)
        total = scipy.ndimage.gaussian_filter(np.where(where, values, 0.0), period_px)
        return total / np.maximum(share, 1e-6)

    inside, surface = local_mean(frame, core), local_mean(frame, ~near)
    amplitude = np.sqrt(2.0 * local_mean((frame - surface) ** 2, ~near))
    dark, bright = surface - amplitude, surface + amplitude
    alike = (inside < dark) & (frame < 0.5 * (inside + dark))
    alike |= (inside > bright) & (frame > 0.5 * (inside + bright))
    return scipy.ndimage.binary_propagation(core, mask=core | (near & alike))
