"""Readable twin of the kernel that fits a linear model to values of which a part may be wrong."""

from __future__ import annotations

import numpy as np

from fringeworks.statistics.quantiles import robust_sigma


def robust_fit(design, q, inverse_sigma, reweightings=12, biweight=4.7, min_absolute=0.1):
    """Coefficients, standard deviation of the first, and which pixels count."""
    weight, scale = inverse_sigma, 0.0
    for step in range(reweightings):
        weighted = design * (weight * weight)[:, None]
        normal = design.T @ weighted
        coefficients = np.linalg.solve(normal, q @ weighted)
        deviation = np.abs(q - design @ coefficients) * inverse_sigma
        scale = max(robust_sigma(deviation), 1e-9)
        if step < reweightings // 2:
            # Least absolute deviations first: outliers of any size lose their influence.
            weight = inverse_sigma / np.sqrt(np.maximum(deviation, min_absolute * scale))
        elif step < reweightings - 1:
            tukey = np.maximum(0.0, 1.0 - (deviation / (biweight * scale)) ** 2)
            weight = inverse_sigma * tukey
    return coefficients, scale * float(np.sqrt(np.linalg.inv(normal)[0, 0])), weight > 0
