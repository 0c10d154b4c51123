"""Readable twin of the joint albedo: Chambolle and Pock's method on whole arrays."""

from __future__ import annotations

import numpy as np

STEP = 0.35


def gradient(v):
    along, down = np.zeros_like(v), np.zeros_like(v)
    along[:, :-1] = np.diff(v, axis=1)
    down[:-1] = np.diff(v, axis=0)
    return along, down


def divergence(along, down):
    """Minus the adjoint of the gradient."""
    total = along + down
    total[:, 1:] -= along[:, :-1]
    total[1:] -= down[:-1]
    return total


def descend(beta, delta, dual, products, weight, cliff, stiffness, huber, iterations):
    ff, fq, qq, fd, qd = products
    m0, m1, m2 = 1 + STEP * ff, STEP * fq, 1 + STEP * qq
    bar = beta, delta
    for _ in range(iterations):
        along, down = gradient(bar[0])
        soft = 1 / (1 + STEP * huber / weight)
        along, down = (dual[0] + STEP * along) * soft, (dual[1] + STEP * down) * soft
        size = np.maximum(np.hypot(along, down) / weight, 1)
        dual[0], dual[1] = along / size, down / size
        along, down = gradient(bar[1])
        tied = np.where(cliff > 0, 0, 1 / (1 + STEP / stiffness))
        dual[2], dual[3] = tied * (dual[2] + STEP * along), tied * (dual[3] + STEP * down)
        b0 = beta + STEP * (divergence(dual[0], dual[1]) + fd)
        b1 = delta + STEP * (divergence(dual[2], dual[3]) + qd)
        determinant = m0 * m2 - m1 * m1
        new = (m2 * b0 - m1 * b1) / determinant, (m0 * b1 - m1 * b0) / determinant
        bar = 2 * new[0] - beta, 2 * new[1] - delta
        beta, delta = new
    return beta, delta


def pooled(v, reduce):
    v = np.pad(v, ((0, v.shape[0] % 2), (0, v.shape[1] % 2)), mode="edge")
    return reduce(np.stack([v[::2, ::2], v[::2, 1::2], v[1::2, ::2], v[1::2, 1::2]]), axis=0)


def doubled(v, shape):
    return np.repeat(np.repeat(v, 2, 0), 2, 1)[: shape[0], : shape[1]].copy()


def solve(f, q, d, weight, cliff, stiffness, huber, iterations):
    """Albedo and correction; see ``joint_albedo``."""
    levels = [([f * f, -f * q, q * q, f * d, -q * d], weight, cliff)]
    for _ in iterations[1:]:
        products, price, free = levels[-1]
        products = [pooled(p, np.mean) for p in products]
        levels.append((products, 0.5 * pooled(price, np.min), pooled(free, np.max)))
    state = None
    for k, n in zip(range(len(levels) - 1, -1, -1), iterations, strict=True):
        products, price, free = levels[k]
        shape = price.shape
        if state is None:
            beta = np.full(shape, products[3].sum() / products[0].sum())
            delta, dual = np.zeros(shape), [np.zeros(shape) for _ in range(4)]
        else:
            beta, delta = (doubled(v, shape) for v in state)
            dual = [2 * doubled(v, shape) for v in dual]
            for j in (0, 2):
                dual[j][:, -1] = 0
                dual[j + 1][-1] = 0
        state = descend(beta, delta, dual, products, price, free, stiffness / 4**k, huber * 2**k, n)
    return state
