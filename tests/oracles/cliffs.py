"""Readable twins of the kernels that search cliffs: one pixel, one window, one ray after the other."""

from __future__ import annotations

import numpy as np

from tests.oracles import windowed

PATCH, WALL_PATCH, WALL_REACH, DISTANCE_PRICE = 3, 2, 3, 0.02
REACH_WIDTHS, MIN_VISIBLE, BLOCK_CELLS = 2.5, 0.02, 4


def value_at(spline, y, x, u):
    """Reference at x − u in row y; NaN outside."""
    last = spline.shape[1] - 4
    at = x - float(np.float32(u))
    if not windowed.MARGIN <= at <= last - windowed.MARGIN:
        return np.nan
    k = int(at)
    return windowed.cubic(spline[y, k : k + 4], at - k)


def square(shape, y, x, half):
    rows = range(max(0, y - half), min(shape[0], y + half + 1))
    columns = range(max(0, x - half), min(shape[1], x + half + 1))
    return [(r, c) for r in rows for c in columns]


def slope(u, clean, y, x, base, axis):
    """Along an axis, from one side where the other one is not clean."""
    step = np.array([base, 0] if axis == 0 else [0, base])
    ends = []
    for sign in (-1, 1):
        r, c = np.array([y, x]) + sign * step
        inside = 0 <= r < u.shape[0] and 0 <= c < u.shape[1]
        ends.append(u[r, c] if inside and clean[r, c] else None)
    before, after = ends
    if before is not None and after is not None:
        return (after - before) / (2 * base)
    if before is not None:
        return (u[y, x] - before) / base
    return 0.0 if after is None else (after - u[y, x]) / base


def offered(clean, y, x, way, reach, margin):
    """The clean pixel behind the first one along a direction, or None."""

    def at(t):
        r, c = (np.floor(p + t * d + 0.5) for p, d in ((y, way[0]), (x, way[1])))
        inside = 0 <= r < clean.shape[0] and 0 <= c < clean.shape[1]
        return (int(r), int(c)) if inside else None

    for t in range(1, reach):
        q = at(t)
        if q is None:
            return None
        if clean[q]:
            q = at(t + margin)
            return q if q is not None and clean[q] else None
    return None


def relocate(spline, d, u, a, b, clean, present, *, reach, margin, base, max_change, same):
    out = [u.copy(), a.copy(), b.copy()]
    ways = [(np.sin(t), np.cos(t)) for t in np.arange(16) * np.pi / 8]
    for y, x in zip(*np.nonzero(present > 0), strict=True):
        best, taken = present[y, x], np.nan
        for way in ways:
            q = offered(clean, y, x, way, reach, margin)
            if q is None:
                continue
            sy, sx = (slope(u, clean, *q, base, axis) for axis in (0, 1))
            here = u[q] + sx * (x - q[1]) + sy * (y - q[0])
            if abs(here - u[y, x]) > max_change or abs(here - taken) < same:
                continue
            left = [
                d[r, c] - a[q] - b[q] * value_at(spline, r, c, here + sx * (c - x) + sy * (r - y))
                for r, c in square(d.shape, y, x, PATCH)
            ]
            left = np.array(left)[np.isfinite(left)]
            if 2 * left.size >= (2 * PATCH + 1) ** 2 and np.mean(left**2) < best:
                best, taken = np.mean(left**2), here
                out[0][y, x], out[1][y, x], out[2][y, x] = here, a[q], b[q]
    return out


def sides(spline, d, u, a, b, walls):
    out = np.full(d.shape, -1)
    for y, x in zip(*np.nonzero(walls), strict=True):
        best = np.inf
        near = [p for p in square(d.shape, y, x, WALL_PATCH) if walls[p]]
        for q in square(d.shape, y, x, WALL_REACH):
            if walls[q] or not np.isfinite(u[q] + a[q] + b[q]):
                continue
            left = np.array([d[p] - a[q] - b[q] * value_at(spline, *p, u[q]) for p in near])
            left = left[np.isfinite(left)]
            if left.size:
                away = (q[0] - y) ** 2 + (q[1] - x) ** 2
                cost = np.mean(left**2) * (1 + DISTANCE_PRICE * away)
                if cost < best:
                    best, out[y, x] = cost, q[0] * d.shape[1] + q[1]
    return out


def smooth_within(values, walls, sigma, rounds=4):
    """Implicit diffusion along rows and columns, as dense systems."""
    tau = 0.5 * sigma**2 / rounds

    def along(lines, blocked):
        out = np.empty_like(lines)
        for i, (line, wall) in enumerate(zip(lines, blocked, strict=True)):
            n = line.size
            system = np.eye(n)
            for k in range(n - 1):
                if not wall[k] and not wall[k + 1]:
                    system[[k, k + 1], [k, k + 1]] += tau
                    system[[k, k + 1], [k + 1, k]] -= tau
            out[i] = np.linalg.solve(system, line)
        return out

    for _ in range(rounds):
        values = along(values, walls)
        values = along(values.T, walls.T).T
    return values


def visibility(walls, y, x, radius):
    """How much of each cell around a centre is seen: passed on along the rays, ring by ring. A cell
    with a wall is seen, but nothing behind it."""
    side = 2 * radius + 1
    seen, through = np.zeros((side, side)), np.zeros((side, side))
    seen[radius, radius] = through[radius, radius] = 1.0
    for ring in range(1, radius + 1):
        for dy in range(-ring, ring + 1):
            for dx in range(-ring, ring + 1):
                if max(abs(dy), abs(dx)) != ring:
                    continue
                r, c = y + dy, x + dx
                if not (0 <= r < walls.shape[0] and 0 <= c < walls.shape[1]):
                    continue
                # The ray crosses the ring before between two cells, or at one.
                py, px = (p * (ring - 1) / ring for p in (dy, dx))
                if abs(dy) == ring:
                    py, k, t = dy - np.sign(dy), int(np.floor(px)), px - np.floor(px)
                    two = [(py, k), (py, k + (t > 0))]
                else:
                    px, k, t = dx - np.sign(dx), int(np.floor(py)), py - np.floor(py)
                    two = [(k, px), (k + (t > 0), px)]
                first, second = (through[radius + i, radius + j] for i, j in two)
                seen[radius + dy, radius + dx] = (1 - t) * first + t * second
                if not walls[r, c]:
                    through[radius + dy, radius + dx] = seen[radius + dy, radius + dx]
    return seen


def seen_weights(walls, y, x, window):
    """Weight of every pixel of the frame in a window that stops at walls."""
    size, sigma = max(1, window.block // BLOCK_CELLS), window.sigma
    h, w = walls.shape
    padded = np.pad(walls, ((0, -h % size), (0, -w % size)))
    cells = padded.reshape(-(-h // size), size, -(-w // size), size).any(axis=(1, 3))
    y, x = y // size, x // size
    out = np.zeros(cells.shape)
    if cells[y, x]:
        return np.zeros(walls.shape)
    radius = int(REACH_WIDTHS * sigma + 0.5) // size
    seen = visibility(cells, y, x, radius)
    for r, c in square(cells.shape, y, x, radius):
        share = seen[radius + r - y, radius + c - x]
        if share >= MIN_VISIBLE:
            gauss = np.exp(-0.5 * ((r - y) ** 2 + (c - x) ** 2) * (size / sigma) ** 2)
            out[r, c] = share * gauss / (2 * np.pi * sigma**2)
    return out.repeat(size, axis=0).repeat(size, axis=1)[:h, :w]


def open_between(walls, one, other):
    """Whether no pixel of the straight line between two pixels is a wall."""
    (y0, x0), (y1, x1) = one, other
    n = max(abs(y1 - y0), abs(x1 - x0))
    at = [(y0 + (y1 - y0) * t / max(n, 1), x0 + (x1 - x0) * t / max(n, 1)) for t in range(n + 1)]
    return not any(walls[int(np.floor(y + 0.5)), int(np.floor(x + 0.5))] for y, x in at)
