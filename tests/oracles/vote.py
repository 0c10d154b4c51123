"""Readable twin of the votes of neighbours on fringe orders (crate ``fringeworks::vote``)."""

from __future__ import annotations

import numpy as np

SLOPE_REACH = 2
SMOOTH_SIGMAS = 4.0
SMOOTH_CHANGE = 0.25
LARGEST_MISS = 0.25
OWN_LIGHT = 0.25
SCATTER_SIGMAS = 4.0
MOST_SCATTER = 2.0
LEAST_PIXELS = 4
CELL_SIGMAS = 2.0
MOST_ORDERS = 4
SAMPLED_ROWS = 4
UNDECIDED = -(2**31)
TURN = 2.0 * np.pi
DARK = 1e12
"""Variance of pixels that show no fringes, rad²."""


def wrap(turns):
    return turns - np.rint(turns)


def moved(values, down, right, outside):
    """The value some pixels down and to the right of each pixel; ``outside`` beyond the frame."""
    reach = max(abs(down), abs(right))
    wide = np.pad(values, reach, constant_values=outside)
    height, width = values.shape
    return wide[reach + down :, reach + right :][:height, :width]


def around(radius):
    return [(v, u) for v in range(-radius, radius + 1) for u in range(-radius, radius + 1)]


class Votes:
    """Phases and variances of M sets, (M, h, w), rad and rad², of lit pixels on a plain range."""

    def __init__(self, phases, variances, lit, periods, span):
        frequency = 1.0 / np.asarray(periods)
        self.finest = int(np.argmax(frequency))
        self.ratio = frequency / frequency[self.finest]
        self.turns, self.variances = phases / TURN, np.where(lit, variances, DARK)
        self.lit, self.period, self.span = lit, 1.0 / frequency[self.finest], span
        self.fine = self.turns[self.finest]
        self.floor, self.usual_scatter = np.zeros(len(periods)), 1.0
        self.slope = self.slopes()

    def slopes(self):
        """Change of the finest phase to the right and down, turns, in boxes around the pixels."""
        z = np.where(self.lit, np.exp(2j * np.pi * self.fine), 0.0)
        found = []
        for down, right in ((0, 1), (1, 0)):
            step = moved(z, down, right, 0.0) * z.conj()
            total = sum(
                moved(step, v, u, 0.0)
                for v, u in around(SLOPE_REACH)
                if (v < SLOPE_REACH or not down) and (u < SLOPE_REACH or not right)
            )
            found.append(np.angle(total) / TURN)
        return found

    def turns_to(self, down, right):
        """Whole turns to the pixel some steps away, and whether it continues the finest phase."""
        across, along = self.slope
        there = moved(self.fine, down, right, 0.0)
        lit = moved(self.lit.astype(float), down, right, 0.0) > 0
        variance = self.variances[self.finest]
        both = (variance + moved(variance, down, right, DARK)) / TURN**2
        bent = SMOOTH_CHANGE * (abs(right * across) + abs(down * along))
        most = np.minimum(SMOOTH_SIGMAS * np.sqrt(both) + bent, LARGEST_MISS)
        off = there - self.fine - right * across - down * along
        continues = self.lit & lit & (np.abs(wrap(off)) <= most)
        return -np.rint(off), continues

    def mean(self, radius):
        """Mean phases of windows without the share of the finest, their variances, and whether
        the members scatter as those of one surface."""
        total = np.zeros(self.turns.shape, complex)
        weight, pixels = np.zeros(self.turns.shape), np.zeros(self.lit.shape)
        expected = np.zeros(self.lit.shape)
        for down, right in around(radius):
            turns, continues = self.turns_to(down, right)
            pixels += continues
            fine = moved(self.fine, down, right, 0.0) + turns
            fine_variance = moved(self.variances[self.finest], down, right, DARK)
            for k, ratio in enumerate(self.ratio):
                variance = moved(self.variances[k], down, right, DARK)
                w = continues / variance
                phase = moved(self.turns[k], down, right, 0.0)
                total[k] += w * np.exp(2j * np.pi * (phase - ratio * fine))
                weight[k] += w
                if k != self.finest:
                    v = np.where(continues, variance + ratio**2 * fine_variance, 0.0)
                    expected += w * v * (1.0 - v * (0.25 - v / 28.0))
        others = [k for k in range(len(self.turns)) if k != self.finest]
        square = 2.0 * (weight - np.abs(total))[others].sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.scatter = np.where(pixels > 1, square / (expected * (pixels - 1) / pixels), 0.0)
            freedom = np.maximum(pixels - 1, 1) * len(others)
            most = 1.0 + SCATTER_SIGMAS * np.sqrt(2.0 / freedom)
            even = (pixels >= LEAST_PIXELS) & (self.scatter <= self.usual_scatter * most)
            return np.angle(total) / TURN, 1.0 / np.maximum(weight, 1.0 / DARK), even

    def alone(self):
        """The phases of single pixels in the same form."""
        return wrap(self.turns - self.ratio[:, None, None] * self.fine), self.variances

    def misfit(self, turns, variances, order):
        """χ² of phases about an order at the best coordinate."""
        weight = 1.0 / (variances + self.floor[:, None, None])
        ratio = self.ratio[:, None, None]
        off = wrap(turns - ratio * order)
        pull = np.sum(ratio * weight * off, axis=0)
        square = np.sum(weight * off**2, axis=0)
        return TURN**2 * (square - pull**2 / np.sum(ratio**2 * weight, axis=0))

    def vote(self, turns, variances):
        """Best order, its χ², and the posterior of all others."""
        low, high = self.span
        orders = np.arange(np.floor(low / self.period) - 2, np.ceil(high / self.period) + 3)
        chi = np.stack([self.misfit(turns, variances, k) for k in orders])
        x = (self.fine + orders[:, None, None]) * self.period
        slack = 3.0 * np.sqrt(self.variances[self.finest]) / TURN * self.period
        chi[(x < low - slack) | (x > high + slack)] = np.inf
        best = chi.min(axis=0)
        with np.errstate(invalid="ignore"):
            total = np.exp(0.5 * (best - chi)).sum(axis=0)
        return orders[chi.argmin(axis=0)], best, 1.0 - 1.0 / total

    def allows(self, order, doubt):
        own = self.alone()
        return self.misfit(*own, order) <= self.vote(*own)[1] + doubt

    def borrowed(self):
        """Pixels beside a shadow whose light is that of neighbours."""
        dark = (~self.lit).astype(float)
        variance = self.variances[self.finest]
        beside = sum(moved(dark, v, u, 0.0) for v, u in around(1)) > 0
        least = np.min([moved(variance, v, u, DARK) for v, u in around(1)], axis=0)
        return beside & (least < OWN_LIGHT * variance)

    def orders(self, known, rules):
        """Orders of all pixels, ``UNDECIDED`` where there is none; ``known`` are those of measured
        pixels. The second map marks pixels whose known order a vote contradicts."""
        turns, variances, _ = self.mean(rules["radius"])
        self.add_floor(turns, variances, rules)
        turns, variances, even = self.mean(rules["radius"])
        order, misfit, others = self.vote(turns, variances)
        counts = (others <= rules["error_rate"]) & (misfit <= rules["largest_misfit"]) & even
        counts &= self.lit & ~self.borrowed() & self.allows(order, rules["own_doubt"])
        has = known != UNDECIDED
        contradicted = has & counts & (order != known)
        decided = np.where(has, known, np.where(counts, order, UNDECIDED))
        return self.spread(decided, rules), contradicted

    def add_floor(self, turns, variances, rules):
        rows = np.arange(len(self.lit)) % SAMPLED_ROWS == 0
        sampled = self.lit & rows[:, None]
        others = [k for k in range(len(turns)) if k != self.finest]
        noise = variances[others].mean(axis=0)[sampled]
        square = self.vote(turns, variances)[1][sampled] * noise
        at = {share: int(np.float32(share) * (noise.size - 1)) for share in (0.5, 0.9)}
        extra = max(
            np.sort(square)[at[share]] / usual - np.sort(noise)[at[0.5]]
            for share, usual in zip((0.5, 0.9), rules["usual_misfit"], strict=True)
        )
        self.floor[others] += max(extra, 0.0)
        middle = np.sort(self.scatter[sampled])[at[0.5]]
        self.usual_scatter = min(max(float(middle), 1.0), MOST_SCATTER)

    def spread(self, decided, rules):
        """Orders of undecided pixels: those of next neighbours that a decided pixel continues."""
        turns, variances, even = self.mean(max(rules["radius"] // 2, 1))
        order, _, others = self.vote(turns, variances)
        offered = np.zeros(self.lit.shape, bool)
        for down, right in around(rules["radius"]):
            whole, continues = self.turns_to(down, right)
            there = moved(decided, down, right, UNDECIDED)
            offered |= continues & (there != UNDECIDED) & (there - whole == order)
        takes = (decided == UNDECIDED) & self.lit & ~self.borrowed() & even & offered
        takes &= (others <= rules["near_error_rate"]) & self.allows(order, rules["own_doubt"])
        return np.where(takes, order, decided)

    def cell_orders(self, cells, known, asked, slack, rules):
        """Orders of the ``asked`` pixels that the Gray-code cells of their windows have in common;
        ``cells`` are the middles and half widths of all, px, and ``known`` the orders of measured
        pixels. ``slack`` is how far from its cell a coordinate may lie besides noise, px."""
        sigma = np.sqrt(self.variances[self.finest]) / TURN * self.period
        low, high = self.orders_in(cells, CELL_SIGMAS * sigma)
        has = known != UNDECIDED
        low, high = np.where(has, known, low), np.where(has, known, high)
        own_low, own_high = self.orders_in(cells, slack + 3.0 * sigma)
        own = own_low[..., None] + np.arange(MOST_ORDERS)
        votes, total, going, lit = 0, 0, 0, 0
        for down, right in around(rules["radius"]):
            whole, continues = self.turns_to(down, right)
            going = going + continues
            lit = lit + moved(self.lit.astype(int), down, right, 0)
            if down or right:
                first, last = (moved(v, down, right, np.nan) - whole for v in (low, high))
                counts = continues & np.isfinite(first)
                total = total + counts
                agree = (own >= first[..., None]) & (own <= last[..., None])
                votes = votes + (counts[..., None] & agree)
        votes = np.where(own <= own_high[..., None], votes, 0)
        best, second = np.sort(votes, axis=-1)[..., :-3:-1].transpose(2, 0, 1)
        takes = asked & self.lit & np.isfinite(own_low) & ~self.borrowed()
        takes &= total - best <= rules["others"] * total
        takes &= (best - second >= rules["ahead"]) & (going >= rules["continued"] * lit)
        return np.where(takes, own_low + votes.argmax(axis=-1), UNDECIDED)

    def orders_in(self, cells, slack):
        """First and last order whose coordinate lies in the cell; NaN where there are too many."""
        middle, half = cells
        low = np.ceil((middle - half - slack) / self.period - self.fine)
        high = np.floor((middle + half + slack) / self.period - self.fine)
        some = self.lit & np.isfinite(middle) & (low <= high) & (high - low < MOST_ORDERS)
        return np.where(some, low, np.nan), np.where(some, high, np.nan)
