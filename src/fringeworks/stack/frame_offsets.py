"""Light that differs from frame to frame by the same counts at all pixels, from sets of steps.

A lens that scatters light of the room, or a camera whose black level drifts, adds o_n to frame n. A
set of steps takes a part of it for fringes: m = (2/N) Σ o_n e^{iδ_n}. This part turns the phase by
Im(m e^{−iφ}) / B, and changes the modulation by Re(m e^{−iφ}): the less light a pixel has, the more
it matters. Exposures and lamps that differ do the same with μ A in place of m, in proportion to the
background A, and light between surfaces with κ B. A scene of light and dark paint tells them apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.fits import fit_matrices, gram, times
from fringeworks.stack.frames import STRETCH
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames, lit_pixels
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.ripple import MIN_PLACES, STEP_RIPPLE_RAD, usual_rad
from fringeworks.stack.set_residuals import MIN_MODULATION, Known, set_residuals
from fringeworks.stack.set_ripples import OUTLIER_SIGMAS, SET_RIPPLE_PIXELS
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.statistics.phase_errors import OFFSET_SHARE, two_parts
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, median, quantile
from fringeworks.types import FloatMap

CHANCE = 1e-6
"""Share of stacks without any offset in which noise makes one that counts."""

MOST_OF_FRINGES = 0.5
"""Largest m, as a share of the usual modulation. What it does was derived for small ones, and a
frame that is dark, or of another pattern, looks like a larger one."""

PASSES = 3
"""Estimates after one another: pixels that an offset had turned too far take part in the next."""

FITS = 3
"""Fits of an estimate, each without what the one before left out, and with the errors it found."""

IN_VIEW = (0.05, 0.95)
"""Quantiles of the coordinates between which the view lies, so that single pixels do not count."""

TERMS = 6
"""Unknowns of a set: m, μ and κ, real and imaginary."""

Causes = tuple[int, ...]
"""Places of the unknowns of a set that are not zero."""

OFFSETS: Causes = (0, 1)
"""Those of m."""
GAINS: Causes = (2, 3)
"""Those of μ."""
SURFACES: Causes = (4, 5)
"""Those of κ."""

CAUSES: tuple[Causes, ...] = tuple(
    tuple(k for cause in some for k in cause)
    for number in (1, 2, 3)
    for some in combinations((OFFSETS, GAINS, SURFACES), number)
)
"""What may have changed the waves: one cause, or several."""

OF_FRAMES: tuple[Causes, ...] = (OFFSETS, OFFSETS + GAINS)
"""Causes that are those of frames with offsets. Light between surfaces makes none: its waves differ
from place to place, and together with offsets it may explain any of them."""


@dataclass(frozen=True)
class _Pixels:
    """Pixels of a sample: their waves, and the light beside them."""

    phase_rad: FloatMap
    """(M, n): wrapped phases."""
    modulation: FloatMap
    """(M, n): modulations, counts."""
    background: FloatMap
    """(n,): counts."""
    group: NDArray[np.intp]
    """(n,): number of the stretch of neighbouring pixels, rising."""

    @classmethod
    def of(cls, maps: dict[str, Any], used: NDArray[np.intp]) -> _Pixels:
        phases, modulations = (
            np.stack([m.ravel()[used] for m in maps[k]]) for k in ("phases", "modulations")
        )
        background = maps["background"].ravel()[used].astype(np.float64)
        return cls(phases, modulations, background, used // STRETCH)

    def terms(self, k: int) -> NDArray[np.complex128]:
        """(3, n): what m, μ and κ of a set add to its wave, turned to the wave's direction."""
        turned = np.exp(-1j * self.phase_rad[k].astype(np.float64))
        return np.stack((turned, self.background * turned, self.modulation[k] * turned))

    def parts(self, k: int) -> FloatMap:
        """(6, n): what m, μ and κ of a set add to its modulation, real and imaginary parts."""
        terms = self.terms(k)
        return np.stack((terms.real, -terms.imag), axis=1).reshape(TERMS, -1)

    @property
    def fringe(self) -> FloatMap:
        """(6 M,): m, μ and κ that add as much as the usual fringes of each set."""
        of_sets = [
            (counts, counts / median(self.background), 1.0)
            for counts in map(median, self.modulation)
        ]
        return np.repeat(np.array(of_sets).ravel(), 2)

    @property
    def usual(self) -> FloatMap:
        """(6 M,): standard deviations of m, μ and κ before anything was seen: each of them adds the
        usual share of the background."""
        background = median(self.background)
        ratios = [background / counts for counts in map(median, self.modulation)]
        return STEP_RIPPLE_RAD * np.repeat(ratios, TERMS) * self.fringe

    def ripple(self, k: int, steps: int) -> FloatMap:
        """(4, n): what steps that are off and a response that is not linear make of a phase."""
        phase = self.phase_rad[k].astype(np.float64)
        return np.stack([f(n * phase) for n in (2, steps) for f in (np.cos, np.sin)])


@dataclass(frozen=True)
class _Line:
    """Values that are sums of what the unknowns add and of other terms, with their noise."""

    own: FloatMap
    """(TERMS · M, n): what every unknown adds."""
    other: FloatMap
    """(p, n): other terms, which are not wanted."""
    usual: FloatMap
    """(p,): standard deviations of their coefficients; infinite for unknown ones."""
    seen: FloatMap
    """(n,): values."""
    variance: FloatMap
    """(n,): of their noise."""
    relative: FloatMap
    """(n,): the same over the squared size of what errors are in proportion to."""
    group: NDArray[np.intp]
    """(n,)"""
    fringe: FloatMap
    """(TERMS · M,): unknowns that add as much as usual fringes."""


def with_offsets(decoding: Decoding, planes: list[NDArray[Any]], known: Known) -> Decoding:
    """The decoding with the offsets of its frames, where light differs from frame to frame.

    Parameters
    ----------
    decoding : Decoding
    planes : (1, n) arrays in the decoding's order, counts
    known : Known

    Returns
    -------
    Decoding; the same where nothing significant is seen, or where more is left when it is taken
    out. A set whose offsets leave more than those of the others alone has none.

    Notes
    -----
    Two kinds of values are used, which do not depend on the surface. The coordinate cancels in the
    differences of phases that are weighted by their periods. And what the surface reflects cancels
    in the modulation beside that of the Gray code, or of a long set, where a set has several
    fringes in view. All causes are fitted, alone and together: offsets are taken out where no other
    explanation is as likely.
    """
    every = list(range(len(decoding.sets)))
    found = _tried(decoding, planes, known, every)
    if found is decoding:
        return decoding
    # Of a single set, the decoding without any offset is all that is left to compare.
    fewer = [[j for j in every if j != k] for k in every if len(every) > 1]
    tried = [decoding, found, *(_tried(decoding, planes, known, sets) for sets in fewer)]
    return min(tried, key=lambda one: _misfit(one, planes, known))


def _tried(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known, sets: list[int]
) -> Decoding:
    """The decoding with the offsets that some ``sets`` seem to have."""
    for _ in range(PASSES):
        waves = _waves(decoding, planes, known, sets)
        if not waves.any():
            break
        pairs = zip(decoding.sets, waves, strict=True)
        decoding = replace(decoding, sets=tuple(_without(s, wave) for s, wave in pairs))
    return decoding


def _misfit(decoding: Decoding, planes: list[NDArray[Any]], known: Known) -> float:
    """Mean logarithm of what the values leave over their noise without offsets or other causes."""
    _, lines = _lines(decoding, planes, known)
    left = []
    for line in lines:
        terms = line.other / np.sqrt(line.variance)
        seen = line.seen / np.sqrt(line.variance)
        products = gram(np.concatenate((terms, seen[None])))
        shares = np.linalg.lstsq(products[:-1, :-1], products[:-1, -1], rcond=None)[0]
        left.append(np.log(np.mean(np.abs(seen - times(shares[None], terms)[0]))))
    return float(np.mean(left)) if left else float("inf")


def _without(phases: PhaseFrames, wave: complex) -> PhaseFrames:
    """The set whose frames show a wave besides that is the same at all pixels."""
    if wave == 0:
        return phases
    design, _ = fit_matrices(phases.rows)
    light = design @ (0.0, wave.real, wave.imag) + np.array(phases.offsets or 0.0)
    return replace(phases, offsets=tuple(map(float, light)))


def _waves(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known, sets: list[int]
) -> NDArray[np.complex128]:
    """What the fits of some ``sets`` take for fringes, (M,) counts; 0 for those that show nothing
    significant."""
    waves = np.zeros(len(decoding.sets), np.complex128)
    pixels, lines = _lines(decoding, planes, known)
    if not lines:
        return waves
    normal, pull = (np.sum(part, axis=0) for part in zip(*map(_equations, lines), strict=True))
    found = {causes: _posterior(normal, pull, pixels.usual, causes, sets) for causes in CAUSES}
    evidence = {causes: told.evidence for causes, told in found.items()}
    likeliest = max(OF_FRAMES, key=lambda causes: evidence[causes])
    others = [value for causes, value in evidence.items() if not set(OFFSETS) <= set(causes)]
    if evidence[likeliest] < max(0.0, *others):
        return waves
    told = found[likeliest]
    while sets:
        chance = [k for k in sets if not _counts(*told.offset(k), decoding.sets[k], known)]
        if not chance:
            waves[sets] = [complex(*told.offset(k)[0]) for k in sets]
            small = np.abs(waves) <= MOST_OF_FRINGES * np.median(pixels.modulation, axis=1)
            return np.where(small, waves, 0.0)
        sets = [k for k in sets if k not in chance]
        told = _posterior(normal, pull, pixels.usual, likeliest, sets)
    return waves


@dataclass(frozen=True)
class _Posterior:
    """Unknowns of the sets by some causes."""

    mean: FloatMap
    """(TERMS · M,); 0 for those that are not among the causes."""
    covariance: FloatMap
    """(TERMS · M, TERMS · M)"""
    evidence: float
    """Logarithm of the likelihood of the causes, up to a constant."""

    def offset(self, k: int) -> tuple[FloatMap, FloatMap]:
        """The real and imaginary part of m of a set, counts, and their covariance."""
        at = slice(TERMS * k, TERMS * k + 2)
        return self.mean[at], self.covariance[at, at]


def _posterior(
    normal: FloatMap, pull: FloatMap, usual: FloatMap, causes: Causes, sets: list[int]
) -> _Posterior:
    """The unknowns by some causes, of which only some ``sets`` have offsets."""
    kept = np.zeros((usual.size // TERMS, TERMS), bool)
    kept[:, causes] = True
    kept[np.setdiff1d(np.arange(len(kept)), sets)[:, None], OFFSETS] = False
    at = np.flatnonzero(kept.ravel())
    square = np.ix_(at, at)
    mean, covariance = np.zeros(usual.size), np.zeros(normal.shape)
    covariance[square] = np.linalg.inv(normal[square] + np.diag(usual[at] ** -2.0))
    mean[at] = covariance[square] @ pull[at]
    # Unknowns that may have many values make any of them less likely.
    breadth = np.linalg.slogdet(np.eye(at.size) + normal[square] * usual[at] ** 2)[1]
    return _Posterior(mean, covariance, float(0.5 * pull @ mean - 0.5 * breadth))


def _counts(wave: FloatMap, covariance: FloatMap, phases: PhaseFrames, known: Known) -> bool:
    """Whether a wave is more than chance, and more than a small share of a pixel's noise."""
    chi = float(wave @ np.linalg.solve(covariance, wave))
    noise = 2.0 / len(phases.frames) * known.noise.variance(0.0)
    matters = bool(wave @ wave > OFFSET_SHARE**2 * noise)
    return matters and chi > chi_square_quantile(1.0 - CHANCE, 2)


def _lines(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known
) -> tuple[_Pixels, list[_Line]]:
    """Lit pixels of a sample, and what tells the offsets."""
    if len(decoding.sets) > 1:
        residuals, variances, maps = set_residuals(decoding, planes, known)
        lit = np.flatnonzero(maps["used"])
    else:
        maps = decode_sample(decoding.nearest, planes, known.noise, known.limits.open)
        lit = np.flatnonzero(lit_pixels(maps) & np.isfinite(maps["coordinate"]))
    few = slice(None, None, max(1, -(-lit.size // SET_RIPPLE_PIXELS)))
    pixels = _Pixels.of(maps, lit[few])
    if lit.size < MIN_JUDGED_PIXELS:
        return pixels, []
    found: list[_Line] = []
    if len(decoding.sets) > 1:
        found += _of_phases(decoding, pixels, residuals[:, few], variances[:, few])
    coordinate = maps["coordinate"].ravel()[lit[few]]
    view_px = quantile(coordinate, IN_VIEW[1]) - quantile(coordinate, IN_VIEW[0])
    shown = _of_gray_code(decoding, planes, lit[few])
    for k, phases in enumerate(decoding.sets):
        # Of few fringes, what changes over the view looks like fringes.
        if view_px > MIN_PLACES * phases.period_px:
            found += _of_light(decoding, k, pixels, shown, known)
    return pixels, found


def _of_phases(
    decoding: Decoding, pixels: _Pixels, residuals: FloatMap, variances: FloatMap
) -> Iterator[_Line]:
    """Combinations of the phases, weighted so that the coordinate cancels, rad."""
    frequency = np.array([1.0 / phases.period_px for phases in decoding.sets])
    sets = range(len(decoding.sets))
    terms = [pixels.terms(k) / pixels.modulation[k] for k in sets]
    turns = [np.stack((t.imag, t.real), axis=1).reshape(TERMS, -1) for t in terms]
    ripples = [pixels.ripple(k, len(decoding.sets[k].frames)) for k in sets]
    usual = [
        np.repeat([usual_rad(n, len(s.frames)) for n in (2, len(s.frames))], 2)
        for s in decoding.sets
    ]
    for weights in np.linalg.svd(frequency[None])[2][1:]:
        own = np.concatenate([w * t for w, t in zip(weights, turns, strict=True)])
        other = [w * r for w, r in zip(weights, ripples, strict=True)]
        variance = TURN**2 * (weights**2 @ variances)
        yield _Line(
            own,
            np.concatenate((*other, np.ones((1, variance.size)))),
            np.concatenate((*usual, [np.inf])),
            TURN * (weights @ residuals),
            variance,
            variance,
            pixels.group,
            pixels.fringe,
        )


def _of_gray_code(
    decoding: Decoding, planes: list[NDArray[Any]], pixels: NDArray[np.intp]
) -> FloatMap | None:
    """Modulation that the frames of a Gray code show, (n,) counts; None where there are none."""
    if decoding.gray is None:
        return None
    # One frame for the light and one for the dark level: their offsets are the same everywhere.
    wanted = decoding.gray.white_black or decoding.gray_frames
    frames = [planes[decoding.frames.index(k)].ravel()[pixels] for k in wanted]
    return np.asarray(0.5 * np.ptp(np.stack(frames).astype(np.float64), axis=0))


def _of_light(
    decoding: Decoding, k: int, pixels: _Pixels, shown: FloatMap | None, known: Known
) -> list[_Line]:
    """The modulation of a set, beside that of the Gray code or of the set with the longest period,
    counts."""
    steps = [len(phases.frames) for phases in decoding.sets]
    longest = max(range(len(steps)), key=lambda j: decoding.sets[j].period_px)
    if shown is None and longest == k:
        return []
    own = np.zeros((len(steps), TERMS, pixels.background.size))
    own[k] = pixels.parts(k)
    seen = pixels.modulation[k].astype(np.float64)
    other = [pixels.ripple(k, steps[k])]
    usual = [*np.repeat([usual_rad(n, steps[k]) for n in (2, steps[k])], 2)]
    variance = 2.0 / steps[k] * known.noise.variance(pixels.background) * np.ones_like(seen)
    if shown is None:
        shown = pixels.modulation[longest].astype(np.float64)
        ratio = median(seen / shown)
        own[longest] = -ratio * pixels.parts(longest)
        variance += ratio**2 * 2.0 / steps[longest] * known.noise.variance(pixels.background)
        # What the ratio changes over the view by looks like waves of a long period.
        phase = pixels.phase_rad[longest].astype(np.float64)
        other += [np.stack((np.cos(phase), np.sin(phase))), pixels.ripple(longest, steps[longest])]
        usual += [np.inf] * 6
    level = np.stack((shown, np.ones_like(shown)))
    return [
        _Line(
            own.reshape(-1, seen.size),
            np.concatenate((*(part * shown for part in other), level)),
            np.array([*usual, np.inf, np.inf]),
            seen,
            variance,
            variance / np.maximum(shown, MIN_MODULATION) ** 2,
            pixels.group,
            pixels.fringe,
        )
    ]


def _equations(line: _Line) -> tuple[FloatMap, FloatMap]:
    """Normal equations of the unknowns alone, in units of their errors."""
    terms = np.concatenate((line.own, line.other))
    count, kept, variance = len(line.own), np.ones(line.seen.size, bool), line.variance
    known = np.diag(np.concatenate((np.zeros(count), line.usual**-2.0)))
    for left in reversed(range(FITS)):
        products = gram(np.concatenate((terms, line.seen[None])) * np.sqrt(kept / variance))
        normal, pull = products[:-1, :-1], products[:-1, -1]
        found = np.linalg.lstsq(normal + known, pull, rcond=None)[0]
        off = line.seen - times(found[None], terms)[0]
        if left:
            chi = off**2 / line.variance
            kept = np.abs(off) < OUTLIER_SIGMAS * MAD_TO_SIGMA * np.sqrt(variance) * median(
                np.abs(off) / np.sqrt(variance)
            )
            errors = two_parts(chi, line.relative, 1)
            variance = line.variance * (errors.noise_factor + errors.floor_rad**2 / line.relative)
    starts = np.flatnonzero(np.diff(line.group, prepend=-1))
    scores = np.add.reduceat(terms * (off * kept / variance), starts, axis=1)
    inverse = np.linalg.pinv(normal + known, hermitian=True)
    unit = max(1.0, float(np.sum(inverse * gram(scores))) / len(terms))
    a, b, c = normal[:count, :count], normal[:count, count:], (normal + known)[count:, count:]
    share = b @ np.linalg.pinv(c, hermitian=True)
    normal, pull = (a - share @ b.T) / unit, (pull[:count] - share @ pull[count:]) / unit
    # Half of the square of a ripple, in shares of a modulation, falls on other orders.
    bent = 0.5 * float(np.sum(found[count:][np.isfinite(line.usual)] ** 2))
    less = np.linalg.inv(np.eye(count) + normal * (bent * line.fringe) ** 2)
    return less @ normal, less @ pull
