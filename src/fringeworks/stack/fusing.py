"""One result from several exposures of a scene, each decoded by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.stack.kernel_settings import LOST_SHARE
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.statistics.common_error import common_variance, differences
from fringeworks.types import (
    Axis,
    BoolMap,
    ByteMap,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    InputError,
    Reason,
    sealed,
)

LEAST_OWN_SHARE = 0.05
"""Smallest share of a variance that counts as an exposure's own, so that weights stay finite where
nearly all of σ is common to the exposures. It limits one weight to 20 times that of σ alone."""
MANY_DISAGREE = 0.01
"""Share of the compared pixels from which on their disagreement gets causes and advice. Wrong
orders that pass all tests of one exposure are below a tenth of it. Empirical."""
PREFERRED = (
    Reason.ORDER_AMBIGUOUS,
    Reason.ISOLATED,
    Reason.SATURATED,
    Reason.LOW_MODULATION,
    Reason.SHADOW,
)
"""Order of preference for the reason of a pixel that no exposure measures: reasons that show the
projector's light come before those that do not."""


def fuse(decoded: Sequence[Decoded]) -> Decoded:
    """Fuse the results of several exposures of one scene into one.

    Parameters
    ----------
    decoded : sequence of Decoded
        Of the same plan and the same camera position, each decoded by itself. One result is
        returned as it is.

    Returns
    -------
    Decoded. Its coordinates are weighted means. A pixel is NaN with ``ORDER_AMBIGUOUS`` where its
    coordinates differ by more than their σ explains, for example because one has a wrong fringe
    order. A pixel that no exposure measures keeps one of their reasons. Modulation and background
    are in counts of the first exposure, converted by the ratio of the modulations; they are NaN
    for an exposure that has no pixel in common with the others. Noise is that of the first.

    Raises
    ------
    InputError for no result, or results of other sizes, axes, periods or repeat distances.

    Notes
    -----
    A part of σ is the same in every exposure: the projector's quantisation, a response that is not
    linear, light that the lens mixes at edges. This variance c does not shrink. It is measured from
    the differences of the coordinates, whose variance is σ₁² + σ₂² − 2 c. With the exposure's own
    variances v_k = σ_k² − c, the weights are 1/v_k and σ² = c + 1/Σ(1/v_k): generalised least
    squares for errors with one common part (Aitken, Proc. R. Soc. Edinburgh 55, 1935).

    The test of agreement is χ² = Σ (x_k − x̄)²/σ_k² at the quantile that loses one good pixel in
    10⁷. It leaves c in σ_k², which only makes it more tolerant.
    """
    if not decoded:
        raise InputError("exposures: expected at least one result, got none")
    if len(decoded) == 1:
        return decoded[0]
    _check_alike(decoded)
    ratios = _ratios(decoded)
    fused: dict[Axis, _Fused] = {
        axis: _fused([d.maps[axis] for d in decoded], ratios) for axis in decoded[0].maps
    }
    findings = [
        replace(finding, seen=f"exposure {k} of {len(decoded)}: {finding.seen}")
        for k, one in enumerate(decoded, 1)
        for finding in one.findings
        # That no single exposure measures all is expected.
        if finding.kind not in ("unmeasured", "saturated")
    ]
    findings += [_finding(axis, [d.maps[axis] for d in decoded], f) for axis, f in fused.items()]
    maps = {axis: found.map for axis, found in fused.items()}
    return Decoded(
        x=maps.get("x"),
        y=maps.get("y"),
        noise=decoded[0].noise,
        findings=tuple(findings),
        details=_details(decoded, fused),
    )


@dataclass(frozen=True)
class _Fused:
    """The fused map of an axis, and the figures of its fusion."""

    map: CoordinateMap
    disagree: int
    compared: int
    common_px: float


def _check_alike(decoded: Sequence[Decoded]) -> None:
    """``InputError`` for results that do not belong together."""
    first = decoded[0]
    for number, other in enumerate(decoded[1:], 2):
        if set(other.maps) != set(first.maps):
            raise InputError(
                f"exposure {number}: expected results along {', '.join(first.maps)}, got "
                f"{', '.join(other.maps)}"
            )
        for axis, wanted in first.maps.items():
            got = other.maps[axis]
            for name, a, b in (
                ("shape", wanted.coordinate_px.shape, got.coordinate_px.shape),
                ("periods in px", wanted.periods_px, got.periods_px),
                ("repeat distance in px", wanted.repeats_px, got.repeats_px),
            ):
                if a != b:
                    raise InputError(f"exposure {number}: expected the {name} {a}, got {b}")


def _ratios(decoded: Sequence[Decoded]) -> list[float]:
    """Modulation of the first exposure over that of each; NaN where no pixel is in common."""
    maps = [next(iter(d.maps.values())) for d in decoded]
    measured = [m.reason == Reason.OK for m in maps]
    ratios = [1.0] + [np.nan] * (len(maps) - 1)
    while True:
        # The next exposure is the one with the most pixels in common with those that are known.
        pairs = [
            (np.count_nonzero(measured[known] & measured[new]), known, new)
            for known in range(len(maps))
            for new in range(len(maps))
            if np.isfinite(ratios[known]) and np.isnan(ratios[new])
        ]
        shared, known, new = max(pairs, default=(0, 0, 0))
        if not shared:
            return ratios
        both = measured[known] & measured[new]
        quotient = np.median(maps[known].modulation[both] / maps[new].modulation[both])
        ratios[new] = ratios[known] * float(quotient)


def _fused(maps: list[CoordinateMap], ratios: list[float]) -> _Fused:
    """The fused map of one axis."""
    measured = np.stack([m.reason == Reason.OK for m in maps])
    x, variance = _aligned(maps, measured)
    common = common_variance(x, variance)
    own = np.maximum(variance - common, LEAST_OWN_SHARE * variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(measured, 1.0 / own, 0.0)
        total = weight.sum(axis=0)
        mean = np.sum(weight * np.where(measured, x, 0.0), axis=0) / total
        # A single exposure keeps its σ, whatever share of it is common.
        sigma = np.where(measured.sum(axis=0) == 1, _single(variance), common + 1.0 / total) ** 0.5
        chi = np.where(measured, (x - mean) ** 2 / variance, 0.0).sum(axis=0)
    disagree = chi > _largest_chi(measured)
    reason = np.where(disagree, np.uint8(Reason.ORDER_AMBIGUOUS), _reasons(maps))
    ok = reason == Reason.OK
    best = np.argmax(weight, axis=0)
    best = np.where(measured.any(axis=0), best, _exposure_of(maps, reason))
    repeats = maps[0].repeats_px
    if repeats is not None:
        mean = (mean + 0.5) % repeats - 0.5
    found = CoordinateMap(
        coordinate_px=_sealed(np.where(ok, mean, np.nan)),
        sigma_px=_sealed(np.where(ok, sigma, np.nan)),
        modulation=_sealed(_picked([m.modulation for m in maps], best, ratios)),
        background=_sealed(_picked([m.background for m in maps], best, ratios)),
        reason=sealed(reason.astype(np.uint8)),
        axis=maps[0].axis,
        periods_px=maps[0].periods_px,
        repeats_px=repeats,
        **_phases(maps, best, ratios),
    )
    several = measured.sum(axis=0) > 1
    typical = float(np.sqrt(np.median(common[several]))) if several.any() else 0.0
    return _Fused(found, int(disagree.sum()), int(several.sum()), typical)


def _sealed(values: FloatMap) -> FloatMap:
    return sealed(values.astype(np.float32))


def _aligned(maps: list[CoordinateMap], measured: BoolMap) -> tuple[FloatMap, FloatMap]:
    """Coordinates and variances of all exposures, (n, h, w); NaN where one does not measure.

    Relative coordinates are moved by repeat distances, to be next to those of the first.
    """
    x = np.stack([m.coordinate_px for m in maps]).astype(np.float64)
    variance = np.stack([m.sigma_px for m in maps]).astype(np.float64) ** 2
    x[~measured], variance[~measured] = np.nan, np.nan
    repeats = maps[0].repeats_px
    if repeats is not None:
        start = np.take_along_axis(x, np.argmax(measured, axis=0)[None], axis=0)
        x -= repeats * np.rint(differences(x, start) / repeats)
    return x, variance


def _single(variance: FloatMap) -> FloatMap:
    return np.asarray(np.nansum(variance, axis=0))


def _largest_chi(measured: BoolMap) -> FloatMap:
    """Largest χ² of a pixel by the number of exposures that measure it; ∞ for one or none."""
    limits = [np.inf, np.inf]
    limits += [chi_square_quantile(1.0 - LOST_SHARE, n) for n in range(1, len(measured))]
    return np.asarray(np.array(limits)[measured.sum(axis=0)])


def _reasons(maps: list[CoordinateMap]) -> ByteMap:
    """OK where any exposure measures; otherwise the reason that comes first in ``PREFERRED``."""
    reason = maps[0].reason.copy()
    for wanted in (*reversed(PREFERRED), Reason.OK):
        for one in maps:
            reason[one.reason == wanted] = wanted
    return reason


def _exposure_of(maps: list[CoordinateMap], reason: ByteMap) -> FloatMap:
    """Number of the first exposure that gives a pixel its reason."""
    return np.asarray(np.argmax(np.stack([m.reason == reason for m in maps]), axis=0))


def _picked(values: Sequence[FloatMap], best: FloatMap, ratios: list[float]) -> FloatMap:
    """The values of the best exposure of every pixel, times the exposure's ratio."""
    found = np.full(values[0].shape, np.nan)
    for k, (one, ratio) in enumerate(zip(values, ratios, strict=True)):
        found = np.where(best == k, one * ratio, found)
    return found


def _phases(
    maps: list[CoordinateMap], best: FloatMap, ratios: list[float]
) -> dict[str, FloatMap | None]:
    """Wrapped phases and modulations of the best exposure, where all have them."""
    phases = [m.phase_rad for m in maps if m.phase_rad is not None]
    modulations = [m.modulations for m in maps if m.modulations is not None]
    if len(phases) < len(maps) or len(modulations) < len(maps):
        return {}
    return {
        "phase_rad": _sealed(_picked(phases, best, [1.0] * len(maps))),
        "modulations": _sealed(_picked(modulations, best, ratios)),
    }


def _finding(axis: Axis, maps: list[CoordinateMap], fused: _Fused) -> Finding:
    """What the fusion gained, and how many pixels disagree."""
    alone = [1.0 - m.failed_fraction for m in maps]
    together = 1.0 - fused.map.failed_fraction
    share = fused.disagree / max(fused.compared, 1)
    seen = (
        f"{len(maps)} exposures measure {', '.join(f'{a:.0%}' for a in alone)} of the pixels along "
        f"{axis}, {together:.0%} together; {fused.disagree} pixels disagree and are left out"
    )
    many = share > MANY_DISAGREE
    return Finding(
        "exposures",
        seen,
        ("something moved between the exposures", "wrong fringe orders") if many else (),
        "fix the scene and the devices, or use a plan with more margin" if many else "",
        axis,
        figures={"measured": together, "disagreeing": share, "common_px": fused.common_px},
        severity="warning" if many else "note",
    )


def _details(decoded: Sequence[Decoded], fused: dict[Axis, _Fused]) -> dict[str, object]:
    """Per axis: the largest disagreement of the sets in an exposure, and the shifts of the one that
    measures the most pixels."""
    details: dict[str, object] = {}
    for axis in fused:
        known = [d for d in decoded if axis in d.details]
        if known:
            best = min(known, key=lambda d: d.maps[axis].failed_fraction)
            largest = max(d.details[axis]["disagreement"] for d in known)
            details[axis] = {**best.details[axis], "disagreement": largest}
    return details
