"""Decoding of a stack of frames into projector coordinates, at once or frame by frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.plan import PatternPlan
from fringeworks.signal.response import Response
from fringeworks.stack.edge_errors import edge_variance
from fringeworks.stack.edges import (
    Light,
    cover_blur_shift,
    fringes_of,
    remove_blur_shift,
)
from fringeworks.stack.examine import Judgement, examine
from fringeworks.stack.frames import (
    Planes,
    check_content,
    check_frames,
    in_bands,
    saturation_of,
)
from fringeworks.stack.gray_light import plan_with_light, with_light
from fringeworks.stack.kernel_settings import (
    RESULTS,
    Decoding,
    Limits,
    check_reusable_result,
    decoding_of,
    empty_maps,
    reused_maps,
)
from fringeworks.stack.local_errors import inflation
from fringeworks.stack.neighbours import (
    UNKNOWN_TURNS,
    leave_in_doubt,
    lines_in_doubt,
    maps_of_votes,
    vote,
    worth_voting,
)
from fringeworks.stack.options import DecodeOptions
from fringeworks.stack.order_words import in_words_of
from fringeworks.stack.refine import MOST_SPREAD_TURNS, Refined
from fringeworks.stack.refusal import causes_first, without_lacking_axes
from fringeworks.stack.region_orders import Regions, decide_by_regions, regions_of
from fringeworks.stack.room_light import evened
from fringeworks.stack.sample import take_sample
from fringeworks.statistics.surface_scatter import cover_scatter
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    FloatMap,
    InputError,
    found_before,
    positive,
    sealed,
)


def decode(
    frames: NDArray[Any] | Sequence[NDArray[Any]],
    plan: PatternPlan,
    *,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    count_step: float | None = None,
    min_modulation: float = 0.0,
    absolute: bool = True,
    response: Response | None = None,
    estimate_steps: bool = True,
    estimate_response: bool = False,
    keep_phases: bool = False,
    remove_isolated: bool = True,
    keep_blur: bool = False,
    out: Decoded | None = None,
) -> Decoded:
    """Decode the projector coordinate of every camera pixel, with its standard deviation.

    Parameters
    ----------
    frames : (n, h, w) array or sequence of (h, w) arrays, counts
        uint8, uint16, float32 or float64 in the order of the plan, with any byte order and
        strides, also memory-mapped. They are not changed.
    plan : PatternPlan
        The patterns that were projected.
    noise : CameraNoise, optional
        Noise of the camera; measured from the frames where not given.
    saturation : float > 0, optional
        Counts from which on a sample is left out of the fit. The default for integers is the type's
        largest value, unless samples only touch it, as with patterns that exactly fill the range.
        The default for floats is no limit. A 12-bit camera in 16-bit files has 4095.
    count_step : float > 0, optional
        Smallest difference between two counts of the camera; rounding to it is the smallest noise.
        The default is 1 for integers and for floats that are whole numbers, otherwise unknown.
    min_modulation : float ≥ 0
        Modulation below which a pixel is not used, counts.
    absolute : bool
        False for coordinates modulo the distance after which the phases repeat, for plans whose
        unambiguous range is shorter than the projector.
    response : Response, optional
        Response that the wrapped phases are corrected for. The plan must have equal steps, as many
        as the response.
    estimate_steps : bool
        Whether to estimate what the frames show beyond the plan: real phase steps and gains, and
        the ripple that a response which is not linear makes. Both are taken out where the frames
        determine them; not with a ``response``, which contains the errors that steps make.
    estimate_response : bool
        Whether the frames must show the response: lines across the image that cross several fringes
        of a smooth surface, several sets, or a Gray code with cells far narrower than the fringes.
    keep_phases : bool
        Whether to return wrapped phase and modulation of every set.
    remove_isolated : bool
        Whether to set pixels to NaN, with ``ISOLATED``, whose coordinate fits no surface through
        their neighbours. Most of them see two depths, at an edge.
    keep_blur : bool
        Whether to keep the shift that the camera's blur makes at edges of brightness, for
        ``surface.remove_blur``, which knows the blur better: from the rig.
    out : Decoded, optional
        An earlier result of the same size. Its maps are overwritten and returned, which saves the
        time for new memory in live measurement.

    Returns
    -------
    Decoded
        Maps of shape (h, w) for each axis of the plan, and the noise.

    Raises
    ------
    InputError
        If frames are missing, differ in size or type, are constant or contradict the plan, for
        example because two are swapped; or if the plan does not determine the fringe orders.

    Notes
    -----
    Every pixel is a least-squares fit of I_n = A + B cos(φ − δ_n) (Bruning et al., Applied Optics
    13, 1974; Greivenkamp, Optical Engineering 23, 1984). The plan's chain of roundings resolves the
    fringe orders (``patterns.order_chain``). The coordinate is the inverse-variance mean of all
    sets. Its σ follows from the camera's noise and the modulation, σ_φ² = (2/N) σ²/B² for equal
    steps (theory §5, §9). Errors that are no noise, such as ripple and disagreement of the sets,
    are measured in a sample of the pixels and added.

    Where a pixel lies within six standard deviations of another coordinate, or, without a Gray
    code, a rounding has a margin of less than five, neighbours vote on the order. A pixel is NaN
    with ``ORDER_AMBIGUOUS`` where they do not decide, or where its sets disagree. It is NaN with
    ``ISOLATED`` where fewer than three of its eight neighbours share its surface, as in pixels that
    see two depths.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, equal_steps(4)),))
    >>> decoded = decode(list(encode(plan)), plan)
    >>> round(float(decoded.x.coordinate_px[10, 20]), 1)
    20.0
    """
    if estimate_response and response is not None:
        raise InputError("estimate_response: expected no response beside it, got one")
    said = plan
    planes, plan = with_light(check_frames(frames, plan), plan)
    if out is not None:
        check_reusable_result(out, plan.axes, planes[0].shape, keep_phases)
    planes, uneven = evened(planes, plan)
    with in_words_of(said):
        with found_before(uneven):
            findings = judge(
                planes,
                plan,
                decodings_of(plan, absolute, response),
                limits_of(planes[0].dtype, saturation, min_modulation),
                noise=noise,
                count_step=count_step,
                estimate_steps=estimate_steps,
                estimate_response=estimate_response,
            )
        findings = replace(findings, findings=(*uneven, *findings.findings))
        decoded = measured(
            planes,
            findings,
            kernels_of(findings),
            {},
            keep_phases=keep_phases,
            remove_isolated=remove_isolated,
            keep_blur=keep_blur,
            out=out,
        )
        with causes_first(findings.findings):
            return without_lacking_axes(decoded, findings.axes)


def judge(
    planes: Planes,
    plan: PatternPlan,
    decodings: dict[Axis, Decoding],
    limits: Limits,
    *,
    noise: CameraNoise | None,
    count_step: float | None,
    estimate_steps: bool,
    estimate_response: bool,
) -> Judgement:
    """Judge checked frames by a sample of their pixels; see ``examine``."""
    sample = take_sample(planes, plan)
    check_content(planes, plan, sample.points)
    return examine(
        plan,
        sample,
        decodings,
        limits,
        noise=noise,
        count_step=checked_count_step(count_step),
        estimate_steps=estimate_steps,
        estimate_response=estimate_response,
    )


def kernels_of(findings: Judgement) -> dict[Axis, _core.DecodeSettings]:
    """Settings of the decoding kernel for every axis."""
    return {
        axis: found.decoding.kernel(findings.noise, findings.limits)
        for axis, found in findings.axes.items()
    }


def measured(
    planes: Planes,
    findings: Judgement,
    kernels: Mapping[Axis, _core.DecodeSettings],
    typical_px: dict[Axis, float],
    *,
    keep_phases: bool,
    remove_isolated: bool,
    out: Decoded | None,
    keep_blur: bool = False,
    raised: dict[Axis, FloatMap] | None = None,
    windows: dict[Axis, bool] | None = None,
) -> Decoded:
    """Decode judged frames along all axes.

    ``kernels`` are those of the findings. ``typical_px`` is the typical difference of neighbours;
    axes that it lacks are added from these frames. ``raised`` is by how much neighbours raised σ of
    each pixel before, which is taken again for the axes that it has, and kept for the others.
    ``windows`` is whether windows of pixels vote on fringe orders, likewise.
    """
    maps = {}
    windows = {} if windows is None else windows
    details: dict[str, Any] = {}
    for axis, found in findings.axes.items():
        sets = len(found.decoding.sets) if keep_phases else 0
        results = empty_maps(planes[0].shape, sets=sets) if out is None else reused_maps(out, axis)
        axis_planes = [planes[k] for k in found.decoding.frames]
        windows[axis] = measure_axis(
            axis_planes, found, findings, results, kernels[axis], windows.get(axis)
        )
        if remove_isolated and axis not in typical_px:
            typical_px[axis] = typical_step(found, results)
        typical = typical_px.get(axis)
        given = None if raised is None else raised.get(axis)
        if given is None:
            plain = results["sigma"].copy() if raised is not None else None
            blur_px = compare_neighbours(found, results, typical_px=typical, keep_blur=keep_blur)
            if raised is not None and plain is not None and not found.blurred:
                raised[axis] = _raised(results["sigma"], plain)
        else:
            # Without the steps that only raise σ, coordinates and reasons are the same.
            steady = replace(found, scatters=False, edges=False, pull_px=0.0, most_blur_px2=0.0)
            blur_px = compare_neighbours(steady, results, typical_px=typical, keep_blur=keep_blur)
            results["sigma"] *= given
        details[axis] = findings.details[axis] | {"removed_blur_px": blur_px}
        maps[axis] = coordinate_map(found.decoding, results, keep_phases)
    return Decoded(
        x=maps.get("x"),
        y=maps.get("y"),
        noise=findings.noise,
        findings=findings.findings,
        details=details,
    )


def _raised(sigma: FloatMap, plain: FloatMap) -> FloatMap:
    """By how much σ of every pixel is raised, (h, w), at least 1; for pixels that were not measured
    as much as for the others in the mean square."""
    with np.errstate(invalid="ignore", divide="ignore"):
        factors = np.maximum(sigma / plain, np.float32(1.0))
    known = np.isfinite(factors)
    mean = np.mean(factors[known].astype(np.float64) ** 2) if known.any() else 1.0
    factors[~known] = np.sqrt(mean)
    return factors


def measure_axis(
    planes: Planes,
    found: Refined,
    findings: Judgement,
    results: dict[str, Any],
    kernel: _core.DecodeSettings | None = None,
    windows: bool | None = None,
) -> bool:
    """Run the kernel, once more where errors differ over the scene, and let neighbours vote on
    fringe orders where many are ambiguous.

    ``kernel`` is that of ``found``, where it is there already. ``windows`` is whether windows of
    pixels may vote, if that is known. Returns it.
    """
    decoding, noise, limits = found.decoding, findings.noise, findings.limits
    if found.uneven:
        results["disagreement"] = np.empty(planes[0].shape, np.float32)
    if found.votes:
        needed = maps_of_votes(decoding, planes[0].shape)
        results.update(needed | {"phases": results["phases"] or needed["phases"]})
    kernel = kernel or decoding.kernel(noise, limits)
    in_bands(planes, results, partial(_run, kernel))
    if found.uneven:
        results["inflation"], usual = inflation(planes, decoding, results, noise, limits)
        if any(phases.table_turns for phases in decoding.sets):
            # What a table leaves of a response differs from place to place, but is bounded: the
            # margins of the roundings contain it already.
            usual = float("inf")
        kernel = decoding.kernel(noise, limits, usual)
        in_bands(planes, results, partial(_run, kernel))
    if not found.votes:
        return False
    return _ask_neighbours(decoding, planes, results, kernel, (noise, limits), windows)


def _ask_neighbours(
    decoding: Decoding,
    planes: Planes,
    results: dict[str, Any],
    kernel: _core.DecodeSettings,
    known: tuple[CameraNoise, Limits],
    windows: bool | None,
) -> bool:
    """Let neighbours decide ambiguous fringe orders; see ``measure_axis``."""
    find = partial(regions_of, decoding, planes, results, known)
    lines, regions = lines_in_doubt(decoding, results), None
    if windows is None:
        # Regions take longer than all other steps together: they are looked up once for a scene.
        regions = find() if decoding.gray is None else None
        windows = _may_vote(decoding, regions)
    if windows:
        vote(decoding, kernel, results)
    if decoding.gray is None and worth_voting(decoding, results):
        regions = regions or find()
        if regions is not None:
            decide_by_regions(regions, results)
    leave_in_doubt(results, lines)
    return windows


def _may_vote(decoding: Decoding, regions: Regions | None) -> bool:
    """Whether errors that windows do not average out are small enough for the votes of windows."""
    if max(decoding.order_errors, default=0.0) >= UNKNOWN_TURNS:
        return False
    return regions is None or bool((regions.spread < MOST_SPREAD_TURNS).all())


def typical_step(found: Refined, results: dict[str, Any]) -> float:
    """Typical difference of neighbouring coordinates, projector px."""
    return _core.typical_step(results["coordinate"], repeats=found.decoding.repeats_px)


def compare_neighbours(
    found: Refined,
    results: dict[str, Any],
    *,
    typical_px: float | None,
    keep_blur: bool = False,
) -> float:
    """Remove the shift by blur and isolated pixels, and let σ cover the scatter of the others.

    ``typical_px`` is the typical difference of neighbours; None keeps isolated pixels, as
    ``keep_blur`` keeps the shift. Returns the
    blur whose shift was removed, camera px.
    """
    decoding = found.decoding
    coordinate, sigma = results["coordinate"], results["sigma"]
    fringes, blur_px, removed = fringes_of(decoding), 0.0, None
    if not keep_blur and (found.blurred or found.most_blur_px2 > 0.0):
        light = Light.of(results)
        if found.blurred:
            before = coordinate.copy()
            blur_px = remove_blur_shift(coordinate, sigma, light, **fringes)
            removed = before - coordinate
        if blur_px == 0.0 and found.most_blur_px2 > 0.0:
            cover_blur_shift(coordinate, sigma, light, found.most_blur_px2, **fringes)
    if typical_px is not None:
        maps = (coordinate, sigma, results["reason"])
        _core.mark_isolated(*maps, typical=typical_px, repeats=decoding.repeats_px)
    if found.pull_px:
        np.hypot(sigma, np.float32(found.pull_px), out=sigma)
    scattered = None
    if found.scatters:
        # Scatter beside edges, and the errors there, are the same: the larger σ counts.
        scattered = sigma.copy()
        cover_scatter(coordinate, scattered, results["background"], decoding.most_scatter_px)
    if found.edges:
        modulation = None if keep_blur or not decoding.sets else results["modulation"]
        added = edge_variance(coordinate, sigma, modulation, removed, **fringes)
        if added is not None:
            np.sqrt(sigma**2 + added, out=sigma)
    if scattered is not None:
        np.maximum(sigma, scattered, out=sigma)
    elif found.blurred:
        cover_scatter(coordinate, sigma, results["background"], decoding.most_scatter_px)
    return blur_px


def _run(kernel: _core.DecodeSettings, planes: Planes, maps: dict[str, Any]) -> None:
    """Call the kernel with the arguments in the order that ``in_bands`` needs."""
    _core.decode_frames(planes, kernel, maps)


def check_options(plan: PatternPlan, options: DecodeOptions) -> None:
    """Refuse options that ``decode`` would refuse, before there are frames."""
    plan = plan_with_light(plan)
    decodings_of(plan, options.get("absolute", True), options.get("response"))
    checked_count_step(options.get("count_step"))
    _not_negative(options.get("min_modulation", 0.0))


def decodings_of(
    plan: PatternPlan, absolute: bool, response: Response | None
) -> dict[Axis, Decoding]:
    """The nominal decoding of each axis of a plan."""
    return {
        axis: decoding_of(plan, axis, absolute=absolute, response=response) for axis in plan.axes
    }


def limits_of(dtype: np.dtype[Any], saturation: float | None, min_modulation: float) -> Limits:
    counts = saturation_of(dtype, saturation)
    return Limits(
        counts,
        _not_negative(min_modulation),
        given=saturation is not None,
        darkest=0.0 if np.isfinite(counts) else -np.inf,
    )


def _not_negative(min_modulation: float) -> float:
    if not min_modulation >= 0:
        raise InputError(f"min_modulation: expected >= 0 counts, got {min_modulation}")
    return float(min_modulation)


def checked_count_step(count_step: float | None) -> float | None:
    if count_step is not None and not positive(count_step):
        raise InputError(f"count_step: expected > 0 counts, got {count_step}")
    return count_step


def coordinate_map(decoding: Decoding, results: dict[str, Any], keep_phases: bool) -> CoordinateMap:
    """The kernel's results for one axis as a ``CoordinateMap``."""

    def stacked(name: str) -> FloatMap | None:
        if not (keep_phases and decoding.sets):
            return None
        return sealed(np.asarray(results[name][0].base))

    return CoordinateMap(
        **{field: sealed(results[name]) for name, field in RESULTS.items()},
        axis=decoding.axis,
        periods_px=tuple(phases.period_px for phases in decoding.sets),
        phase_rad=stacked("phases"),
        modulations=stacked("modulations"),
        repeats_px=None if decoding.absolute else decoding.length_px,
    )
