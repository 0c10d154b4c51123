"""Readable twin of the analysis of variance: sums of squares by dense least squares.

No formula of balanced designs is in it: the squares of a source are what its columns take off the
residual of the model without it.
"""

from __future__ import annotations

import numpy as np


def dummies(labels):
    """A column of ones and zeros for each label."""
    return (np.asarray(labels)[:, None] == np.unique(labels)[None, :]).astype(float)


def residual(y, *blocks):
    """Sum of squares that a model leaves, and its number of parameters."""
    columns = np.hstack([np.ones((len(y), 1)), *blocks])
    fitted, _, rank, _ = np.linalg.lstsq(columns, y, rcond=None)
    return float(np.sum((y - columns @ fitted) ** 2)), int(rank)


def anova(y, parts, operators):
    """Sum of squares and degrees of freedom by source."""
    by_part, by_operator = dummies(parts), dummies(operators)
    crossed = (by_part[:, :, None] * by_operator[:, None, :]).reshape(len(y), -1)
    models = [
        residual(y),
        residual(y, by_operator),
        residual(y, by_operator, by_part),
        residual(y, by_operator, by_part, crossed),
    ]
    found = {
        name: (a[0] - b[0], b[1] - a[1])
        for name, a, b in zip(
            ("operators", "parts", "interaction"), models[:-1], models[1:], strict=True
        )
    }
    found["repeatability"] = (models[-1][0], len(y) - models[-1][1])
    found["total"] = (models[0][0], len(y) - 1)
    return found
