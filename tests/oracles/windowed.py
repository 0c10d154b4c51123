"""Readable twin of the windowed inversion: dense NumPy, one window after the other."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve1d, map_coordinates

from tests.oracles import cliffs

RADIUS = 6
"""Reach of a window, blocks; as in the kernel."""
MARGIN = 2.0
"""Distance from the row's ends within which the reference is not evaluated, px; as in the kernel."""


class Window:
    """Block width and block weights of one scale."""

    def __init__(self, sigma: float) -> None:
        self.sigma = sigma
        self.block = max(1, int(np.floor(sigma / 2.0 + 0.5)))
        k = np.arange(-RADIUS, RADIUS + 1)
        w = np.exp(-0.5 * (k / (sigma / self.block)) ** 2)
        self.weight = w / (w.sum() * self.block)
        self.effective_pixels = 1.0 / (np.sum(self.weight**2) * self.block) ** 2

    def nodes(self, n: int) -> int:
        return -(-n // self.block)

    def pixel(self, r: int, c: int, shape) -> tuple[int, int]:
        """The pixel at the centre of a node's block, inside the frame."""
        middle = (self.block - 1) // 2
        return tuple(
            min(i * self.block + middle, n - 1) for i, n in zip((r, c), shape, strict=True)
        )

    def pixel_weights(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Weight of every pixel for every node along one axis, and its offset from the node."""
        node = np.arange(self.nodes(n))[:, None]
        pixel = np.arange(n)[None, :]
        step = pixel // self.block - node
        inside = np.abs(step) <= RADIUS
        w = np.where(inside, self.weight[np.clip(step + RADIUS, 0, 2 * RADIUS)], 0.0)
        return w, pixel - ((node + 0.5) * self.block - 0.5)


def cubic(c, t):
    """A cubic B-spline with four coefficients around t."""
    return (
        c[0] * (1 - t) ** 3
        + c[1] * (3 * t**3 - 6 * t**2 + 4)
        + c[2] * (-3 * t**3 + 3 * t**2 + 3 * t + 1)
        + c[3] * t**3
    ) / 6


def warp(spline, u):
    """Value and slope of the reference at x − u, and 1 where that point is inside the row."""
    h, w = u.shape
    position = np.arange(w)[None, :] - u.astype(np.float32).astype(np.float64)
    inside = (position >= MARGIN) & (position <= w - 1 - MARGIN)
    at = np.clip(position, MARGIN, w - 1 - MARGIN)
    rows = np.broadcast_to(np.arange(h)[:, None], at.shape)
    k = np.floor(at).astype(int)
    t = at - k
    c = [spline[rows, k + i] for i in range(4)]
    value = cubic(c, t)
    slope = (
        -c[0] * (1 - t) ** 2
        + c[1] * (3 * t**2 - 4 * t)
        + c[2] * (1 + 2 * t - 3 * t**2)
        + c[3] * t**2
    ) / 2
    return np.where(inside, value, 0), np.where(inside, slope, 0), inside.astype(float)


def solve_node(weights, dx, dy, s, g, m, d, window, prior, limits):
    """Least squares of one window over (a, b, b δ, b δ_x, b δ_y) with a prior on a and b, or None.

    a is the offset, b the modulation ratio, δ the correction of the displacement with its slopes.
    """
    w = weights * m
    count = window.effective_pixels / limits["noise_correlation"] * w.sum()
    if count < 10:
        return None
    columns = np.stack([np.ones_like(s), s, -g, -g * dx, -g * dy])
    normal = np.einsum("iyx,jyx,yx->ij", columns, columns, w)
    right = np.einsum("iyx,yx,yx->i", columns, d, w)
    independent = window.effective_pixels / limits["noise_correlation"]

    def fit(assumed):
        pull = np.zeros((5, 5))
        pull[0, 0] = assumed / independent / prior["offset_variance"]
        pull[1, 1] = assumed / independent / prior["ratio_variance"]
        full = normal + pull
        rhs = right + pull @ np.array([prior["offset"], prior["modulation_ratio"], 0, 0, 0])
        scale = np.sqrt(np.diag(full))
        inverse = np.linalg.inv(full / np.outer(scale, scale) + 1e-9 * np.eye(5))
        x = inverse @ (rhs / scale) / scale
        misfit = d - np.einsum("i,iyx->yx", x, columns)
        spread = max(1 - 5 / count, 0.2)
        residual = max((w * misfit**2).sum() / w.sum() / spread, limits["object_noise"])
        return x, residual, np.diag(inverse) / scale**2

    assumed = prior["residual"]
    x, residual, variance = fit(assumed)
    for _ in range(3):
        if residual <= 1.5 * assumed:
            break
        assumed = residual
        x, residual, variance = fit(assumed)
    factor = x[1] ** 2
    noise = max(residual - factor * limits["reference_left"], limits["object_noise"])
    noise += factor * limits["reference_noise"]
    var = noise * variance / independent
    sigma = np.sqrt(var[2]) / max(abs(x[1]), 1e-6)
    determined = (
        sigma < limits["max_sigma"]
        and x[1] > 3 * np.sqrt(var[1])
        and residual < (1 - limits["min_explained"]) * 0.5 * x[1] ** 2 + limits["object_noise"]
    )
    if not determined:
        return None
    excess = max(residual - 1.2 * limits["object_noise"], 0) + limits["drift"] ** 2
    return {
        "delta": x[2] / x[1],
        "slope_x": x[3] / x[1],
        "slope_y": x[4] / x[1],
        "sigma": sigma,
        "prior": {
            "offset": x[0],
            "modulation_ratio": x[1],
            "offset_variance": excess + var[0],
            "ratio_variance": excess + var[1],
            "residual": residual,
        },
    }


LOOSE = {
    "offset": 0.0,
    "modulation_ratio": 1.0,
    "offset_variance": 1.0,
    "ratio_variance": 1.0,
    "residual": 0.01,
}
"""Prior of the coarsest scale, as in the kernel; intensities in units of the modulation."""


def corners(x, y, block, rows, columns):
    """The four nodes around a pixel and their bilinear weights."""
    px = np.clip((x + 0.5) / block - 0.5, 0, columns - 1)
    py = np.clip((y + 0.5) / block - 0.5, 0, rows - 1)
    c, r = int(px), int(py)
    tx, ty = px - c, py - r
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    return [
        (r, c, (1 - tx) * (1 - ty)),
        (r, c1, tx * (1 - ty)),
        (r1, c, (1 - tx) * ty),
        (r1, c1, tx * ty),
    ]


def blend(grid, window, x, y, rows, columns):
    """Weighted mean of the determined nodes' affine solutions at a pixel, or None."""
    total, out = 0.0, np.zeros(4)
    for r, c, weight in corners(x, y, window.block, rows, columns):
        node = grid[r][c]
        if not node["determined"] or weight <= 0:
            continue
        dx = x - ((c + 0.5) * window.block - 0.5)
        dy = y - ((r + 0.5) * window.block - 0.5)
        delta = node["delta"] + node["slope_x"] * dx + node["slope_y"] * dy
        ratio, offset = node["prior"]["modulation_ratio"], node["prior"]["offset"]
        out += weight * np.array([delta, node["sigma"], ratio, offset])
        total += weight
    return out / total if total > 0 else None


def blend_seen(grid, window, x, y, walls):
    """The same near a wall: of the nearest determined nodes that the pixel sees, or None."""
    if walls[y, x]:
        return None
    block = window.block
    for reach in (1, 2, 4):
        total, out, scale = 0.0, np.zeros(4), (reach + 0.5) * block
        for r in range(max(0, y // block - reach), min(len(grid), y // block + reach + 1)):
            columns = range(max(0, x // block - reach), min(len(grid[0]), x // block + reach + 1))
            for c in columns:
                node = grid[r][c]
                dx, dy = (p - ((i + 0.5) * block - 0.5) for p, i in ((x, c), (y, r)))
                near = max(0, 1 - abs(dx) / scale) * max(0, 1 - abs(dy) / scale)
                seen = cliffs.open_between(walls, (y, x), window.pixel(r, c, walls.shape))
                if not node["determined"] or near <= 0 or not seen:
                    continue
                weight = near / node["sigma"] ** 2
                sigma = node["sigma"] * np.sqrt(1 + 0.5 * (dx * dx + dy * dy) / (2 * block) ** 2)
                delta = node["delta"] + node["slope_x"] * dx + node["slope_y"] * dy
                ratio, offset = node["prior"]["modulation_ratio"], node["prior"]["offset"]
                out += weight * np.array([delta, sigma, ratio, offset])
                total += weight
        if total > 0:
            return out / total
    return None


def solve_grid(spline, d, u, window, coarser, limits, walls=None):
    """Solve all windows of one scale, with the model linearised at the field ``u``."""
    h, w = d.shape
    s, g, m = warp(spline, u)
    if walls is not None:
        m = m * ~walls
    wx, dx = window.pixel_weights(w)
    wy, dy = window.pixel_weights(h)
    grid = []
    for r in range(window.nodes(h)):
        line = []
        for c in range(window.nodes(w)):
            prior = LOOSE
            if coarser is not None:
                old, old_window = coarser
                x, y = (c + 0.5) * window.block - 0.5, (r + 0.5) * window.block - 0.5
                around = corners(x, y, old_window.block, len(old), len(old[0]))
                prior = {
                    key: sum(t * old[i][j]["prior"][key] for i, j, t in around) for key in LOOSE
                }
            weights = wy[r][:, None] * wx[c][None, :]
            if walls is not None:
                centre = window.pixel(r, c, d.shape)
                if near_wall(walls, *centre, int(cliffs.REACH_WIDTHS * window.sigma + 0.5)):
                    hidden = walls[centre]
                    weights = 0 * weights if hidden else cliffs.seen_weights(walls, *centre, window)
            node = solve_node(
                weights, dx[c][None, :], dy[r][:, None], s, g, m, d, window, prior, limits
            )
            if node is None:
                line.append({"determined": False, "prior": prior})
            else:
                line.append({"determined": True, **node})
        grid.append(line)
    return grid


def near_wall(walls, y, x, reach):
    """Whether a wall is within a distance along rows, columns and diagonals."""
    return walls[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1].any()


def at_pixels(grid, window, shape, walls=None):
    """δ, σ, modulation ratio and offset of every pixel; NaN, ∞, NaN, 0 without a determined node."""
    out = np.empty((4, *shape))
    for y in range(shape[0]):
        for x in range(shape[1]):
            if walls is not None and window.block > 1 and near_wall(walls, y, x, 2 * window.block):
                blended = blend_seen(grid, window, x, y, walls)
            else:
                blended = blend(grid, window, x, y, len(grid), len(grid[0]))
            out[:, y, x] = (np.nan, np.inf, np.nan, 0.0) if blended is None else blended
    return out


def noise_correlation(residual, limits):
    """25 (median |block mean| / median |residual|)² of differences of blocks that are two blocks
    apart along y, over what smoothing of the reference's white noise gives; 1 … 25."""
    h, w = residual.shape
    tiles = residual[: h // 5 * 5, : w // 5 * 5].reshape(h // 5, 5, w // 5, 5).swapaxes(1, 2)
    apart = tiles[:-2] - tiles[2:]
    complete = np.isfinite(apart).all(axis=(2, 3))
    means = np.sort(np.abs(apart[complete].mean(axis=(1, 2))))
    singles = np.sort(np.abs(apart[complete][:, 2, 2]))
    ratio = means[means.size // 2] / singles[singles.size // 2]
    single, mean = (
        limits["object_noise"] + limits[name] for name in ("reference_left", "reference_noise")
    )
    return max(np.clip(25 * ratio**2, 1, 25) * single / mean, 1.0)


def block_means(values, window):
    """Mean of the finite values of each block; 0 in blocks without any."""
    h, w = values.shape
    rows, columns = window.nodes(h), window.nodes(w)
    out = np.zeros((rows, columns))
    b = window.block
    for r in range(rows):
        for c in range(columns):
            tile = values[r * b : (r + 1) * b, c * b : (c + 1) * b]
            tile = tile[np.isfinite(tile)]
            out[r, c] = tile.mean() if tile.size else 0.0
    return out


def spread(values, window):
    """Mean square over blocks and their neighbours, weights 1 4 6 4 1 on each axis."""
    h, w = values.shape
    rows, columns, b = window.nodes(h), window.nodes(w), window.block
    moments = np.zeros((2, rows, columns))
    for r in range(rows):
        for c in range(columns):
            tile = values[r * b : (r + 1) * b, c * b : (c + 1) * b]
            tile = tile[np.isfinite(tile)]
            moments[:, r, c] = [np.sum(tile**power) for power in (0, 2)]
    for axis in (1, 2):
        moments = convolve1d(moments, [1, 4, 6, 4, 1], axis, mode="constant")
    count, square = moments
    mean = np.where(count > 0, square / np.maximum(count, 1), 0.0)
    return upsample(mean, window, values.shape)


def upsample(means, window, shape):
    """Bilinear interpolation of block means at pixels."""
    y = np.clip((np.arange(shape[0]) + 0.5) / window.block - 0.5, 0, means.shape[0] - 1)
    x = np.clip((np.arange(shape[1]) + 0.5) / window.block - 0.5, 0, means.shape[1] - 1)
    return map_coordinates(means, np.meshgrid(y, x, indexing="ij"), order=1)


def invert(spline, d, start, scales, iterations, period, confidence, limits, walls=None):
    """Displacement, σ, modulation ratio, mean squared difference from finer windows, and scale per
    pixel; the noise correlation."""
    limits = {**limits, "noise_correlation": 1.0}
    c = [-((-1) ** j) * _binomial(iterations, j) for j in range(1, iterations + 1)]
    pairs = [(j, k) for j in range(iterations) for k in range(iterations)]
    factor = np.sqrt(sum(c[j] * c[k] * 2 / (j + k + 2) for j, k in pairs))
    u, coarser = start.copy(), None
    values, sigmas, ratios, windows = [], [], [], []
    for scale in scales:
        window = Window(scale)
        for _ in range(iterations):
            grid = solve_grid(spline, d, u, window, coarser, limits, walls)
            delta, sigma, ratio, offset = at_pixels(grid, window, d.shape, walls)
            u = u + np.nan_to_num(np.clip(delta, -period / 4, period / 4))
        widening = 1.0
        if coarser is None:
            s, _, m = warp(spline, u)
            residual = d - offset - np.nan_to_num(ratio, nan=1.0) * s
            residual = np.where(m > 0, residual, np.nan)
            limits["noise_correlation"] = noise_correlation(residual, limits)
            widening = np.sqrt(limits["noise_correlation"])
        coarser = (grid, window)
        values.append(u.copy())
        sigmas.append(sigma * factor * widening)
        ratios.append(ratio)
        windows.append(window)
    return (*select(values, sigmas, ratios, windows, confidence), limits["noise_correlation"])


def _binomial(n, k):
    return 1 if k in (0, n) else _binomial(n - 1, k - 1) + _binomial(n - 1, k)


def select(values, sigmas, ratios, windows, confidence):
    """Estimate and σ of the largest window that agrees with all smaller ones."""
    shape = values[0].shape
    steps, squares = [np.zeros(shape)], []
    for k in range(len(values) - 1):
        both = np.isfinite(sigmas[k]) & np.isfinite(sigmas[k + 1])
        difference = np.where(both, values[k + 1] - values[k], np.nan)
        steps.append(upsample(block_means(difference, windows[k]), windows[k], shape))
        seen = np.isfinite(sigmas[k + 1])
        squares.append(np.where(seen, spread(difference, windows[k]), 0.0))
    squares.append(np.zeros(shape))
    chosen = np.full(shape, 255)
    out = [np.full(shape, np.nan) for _ in range(3)] + [np.zeros(shape)]
    for k in range(len(values)):
        agrees = np.isfinite(sigmas[k]) & (chosen == 255)
        total = np.zeros(shape)
        for j in range(k + 1, len(values)):
            total = total + steps[j]
            agrees &= np.abs(total) <= confidence * sigmas[j]
        chosen[agrees] = k
        sources = (values[k], sigmas[k], ratios[k], squares[k])
        for target, source in zip(out, sources, strict=True):
            target[agrees] = source[agrees]
    return (*out, chosen)


LIMITS = {
    "object_noise": 2.5e-4,
    "reference_noise": 2.5e-4,
    "reference_left": 2e-4,
    "drift": 0.01,
    "max_sigma": 0.8,
    "min_explained": 0.3,
}


def pair_of(spline, d):
    """The kernels' pair of frames without gaps."""
    ok = np.ones(d.shape, np.uint8)
    return {
        "spline": spline,
        "object": d,
        "reference_ok": ok,
        "object_ok": ok,
        "albedo": None,
    }


def options_of(scales, iterations):
    return {
        "scales": list(scales),
        "iterations": iterations,
        "period": 20.0,
        "confidence": 2.5,
        "limits": LIMITS,
    }
