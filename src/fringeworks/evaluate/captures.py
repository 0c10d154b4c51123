"""Methods side by side on one's own pairs of frames, with a truth or without one."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.evaluate.truth_errors import Errors, errors
from fringeworks.files.atomic import StrPath
from fringeworks.pair.analyse import get_method
from fringeworks.pair.analyse import methods as all_methods
from fringeworks.pair.bound import bound_px
from fringeworks.pipeline.inputs import pair_of
from fringeworks.pipeline.pairs import Reconstruction, reconstruct
from fringeworks.rig.calibration.planes import PixelCalibration
from fringeworks.signal.denoise import Denoiser
from fringeworks.types import (
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Pair,
    Plotted,
    Reason,
    ReferencePlaneGeometry,
    sealed,
)

Row = dict[str, Any]
"""A line of a table, by column."""

Captures = Sequence[Pair | StrPath] | Mapping[str, Pair | StrPath]
"""Pairs of frames, or captures to read; also by name."""

OTHERS = "the median of the others"
"""What a method is compared with where no reference method is chosen."""
MIN_OTHERS = 0.5
"""Share of the other methods that must have a value at a pixel for their median to count there: a
median of few is no consensus."""


@dataclass(frozen=True, eq=False, repr=False)
class CaptureComparison(Plotted, Frozen):
    """What several methods measured on one pair, and how far they agree.

    Agreement is not accuracy. Methods see the same photographs: what is wrong with these, such as
    an uncorrected response, misleads all of them alike. Methods of one family share their errors,
    too. A difference shows that at least one method is wrong; only a truth shows which.
    """

    name: str
    """Name of the capture."""
    results: dict[str, Reconstruction]
    """What every method measured."""
    against: str
    """The reference method; or that each method is compared with the median of the others."""
    difference: dict[str, FloatMap]
    """Every method's value minus the reference, (h, w), in the surfaces' unit; NaN where one of
    them is missing."""
    difference_sigma: dict[str, FloatMap]
    """Combined standard deviation √(σ² + σ²) of method and reference, (h, w). It takes their errors
    as independent, but noise is common to both, so it is rather too large."""
    bound: FloatMap
    """Cramér–Rao bound of windows of a quarter of a period, (h, w), in the surfaces' unit: no
    unbiased method that resolves as much errs less; NaN where the first method found nothing."""
    truth_mm: FloatMap | None = None
    """True height, (h, w), mm; None where it is unknown, or the surfaces are in px."""

    @property
    def surfaces(self) -> dict[str, HeightMap]:
        """The surface of every method."""
        return {name: result.surface for name, result in self.results.items()}

    def rows(self, *, timing: bool = False) -> list[Row]:
        """Return the table of this capture, a row for each method.

        Parameters
        ----------
        timing : bool
            Add the column ``seconds``, in which equal runs differ.

        Returns
        -------
        List of rows with these keys; shares 0…1 of the pixels that are not masked, or compared:

        - ``capture``, ``method``, ``unit`` (of all lengths), ``against``
        - ``measured_fraction``, ``median_sigma``
        - ``compared_fraction``: share of pixels with a value in the method and in the reference
        - ``median_bound``: of ``bound``, the same for all methods
        - ``median_abs_difference``, ``agree_within_1_sigma``, ``agree_within_2_sigma``: over these
        - with a truth, the fields of ``Errors``
        """
        return [self._row(name, result, timing) for name, result in self.results.items()]

    def _row(self, method: str, result: Reconstruction, timing: bool) -> Row:
        surface = result.surface
        difference, sigma = self.difference[method], self.difference_sigma[method]
        compared = np.isfinite(difference)
        size = np.abs(difference[compared])
        wanted = max(int(np.count_nonzero(surface.reason != Reason.MASKED)), 1)
        row: Row = {
            "capture": self.name,
            "method": method,
            "unit": surface.unit,
            "against": self.against,
            "measured_fraction": 1.0 - surface.failed_fraction,
            "median_sigma": _median(surface.sigma[np.isfinite(surface.sigma)]),
            "median_bound": _median(self.bound[np.isfinite(self.bound)]),
            "compared_fraction": float(np.count_nonzero(compared) / wanted),
            "median_abs_difference": _median(size),
        }
        for k in (1, 2):
            within = size <= k * sigma[compared]
            row[f"agree_within_{k}_sigma"] = float(np.mean(within)) if size.size else float("nan")
        if self.truth_mm is not None:
            row |= _errors(surface, self.truth_mm)
        return row | ({"seconds": result.seconds} if timing else {})


def compare_captures(
    captures: Captures,
    methods: Sequence[str] | None = None,
    *,
    against: str | None = None,
    geometry: ReferencePlaneGeometry | PixelCalibration | None = None,
    denoise: Denoiser | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[CaptureComparison]:
    """Run methods on one's own pairs of frames, and see how far they agree.

    Parameters
    ----------
    captures : sequence of Pair or path, or dictionary of them by name
        Pairs, or captures to read. Their true heights, where they have some, give errors.
    methods : names of methods, optional
        All where left out.
    against : str, optional
        The method that the others are compared with; by default, each method is compared with the
        median of the others, so that it does not vote on itself.
    geometry : ReferencePlaneGeometry or PixelCalibration, optional
        Takes the place of the pairs' own.
    denoise : "emd", "emd2d" or "bemd", optional
        Applied to both frames before every method.
    progress : callable
        Called with the name of each step.

    Returns
    -------
    A CaptureComparison per capture.

    Raises
    ------
    InputError for no captures, something else than pairs, and unknown methods; the message names
    the capture.

    Examples
    --------
    >>> from fringeworks.simulate import standard_scene
    >>> scene = standard_scene("parabola", size=100, fringes=8)
    >>> (found,) = compare_captures([scene], ["fourier", "windowed"])
    >>> found.against, [row["method"] for row in found.rows()]
    ('the median of the others', ['fourier', 'windowed'])
    """
    chosen = list(dict.fromkeys(all_methods() if methods is None else methods))
    if against is not None and against not in chosen:
        chosen.append(against)
    for method in chosen:
        get_method(method)
    found = []
    for name, capture in _named(captures).items():
        results = {}
        try:
            pair = pair_of(capture)
            for method in chosen:
                progress(f"{name}: {method}")
                results[method] = reconstruct(pair, method, geometry=geometry, denoise=denoise)
            bound = _bound(pair, next(iter(results.values())))
        except InputError as error:
            text = str(error)
            raise type(error)(text if name in text else f"{name}: {text}") from error
        found.append(_compared(name, results, against, bound, pair.truth_mm))
    return found


def rows_of_captures(found: Sequence[CaptureComparison], *, timing: bool = False) -> list[Row]:
    """Return the rows of all captures as one table; a column that a capture lacks is NaN there."""
    rows = [row for one in found for row in one.rows(timing=timing)]
    widest = max(rows, key=len, default={})
    return [{column: row.get(column, float("nan")) for column in widest} for row in rows]


def _named(captures: Captures) -> dict[str, Pair | StrPath]:
    """Captures by a short name."""
    if isinstance(captures, (str, os.PathLike, Pair)) or not captures:
        got = f"a {type(captures).__name__}" if captures else "none"
        raise InputError(f"captures: expected one or more pairs in a list, got {got}")
    if isinstance(captures, Mapping):
        return dict(captures)
    names = short_names([c for c in captures if not isinstance(c, Pair)])
    numbered = enumerate(captures, 1)
    return {f"pair {k}" if isinstance(c, Pair) else names.pop(0): c for k, c in numbered}


def short_names(paths: Sequence[StrPath]) -> list[str]:
    """Names of paths: the last part without its suffix, and as many before as tell them apart.

    Raises
    ------
    InputError where a path is there twice.

    Examples
    --------
    >>> short_names(["scans/cup/object.png", "scans/ball/object.png"])
    ['cup/object', 'ball/object']
    """
    whole = [Path(path).resolve() for path in paths]
    parts = [(*path.parent.parts[1:], path.stem or str(path)) for path in whole]
    for depth in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    if not paths:
        return []
    twice = next(path for path in paths if whole.count(Path(path).resolve()) > 1)
    raise InputError(f"captures: expected every capture once, got {twice} twice")


def _compared(
    name: str,
    results: dict[str, Reconstruction],
    against: str | None,
    bound: FloatMap,
    truth_mm: FloatMap | None,
) -> CaptureComparison:
    """The differences of all methods on one capture."""
    values = {m: r.surface.values.astype(np.float64) for m, r in results.items()}
    sigmas = {m: r.surface.sigma.astype(np.float64) for m, r in results.items()}
    difference: dict[str, FloatMap] = {}
    combined: dict[str, FloatMap] = {}
    for method in results:
        if against is None:
            middle, sigma = _median_of_others(method, values, sigmas)
        else:
            middle, sigma = values[against], sigmas[against]
        if method == against:
            # Compared with itself, a method would seem to agree.
            middle = np.full_like(middle, np.nan)
        difference[method] = sealed(values[method] - middle)
        combined[method] = sealed(np.hypot(sigmas[method], sigma))
    in_mm = all(result.surface.unit == "mm" for result in results.values())
    truth = truth_mm if in_mm else None
    return CaptureComparison(name, results, against or OTHERS, difference, combined, bound, truth)


def _bound(pair: Pair, result: Reconstruction) -> FloatMap:
    """The bound of a pair at a method's displacement, in the unit of its surface."""
    found = result.displacement
    per_px = result.surface.sigma / found.sigma_px
    return sealed(bound_px(pair, found.displacement_px) * per_px)


def _median_of_others(
    method: str, values: Mapping[str, FloatMap], sigmas: Mapping[str, FloatMap]
) -> tuple[FloatMap, FloatMap]:
    """Median value and median σ of all methods but one; NaN where most of them have none."""
    others = [name for name in values if name != method]
    nothing = np.full(values[method].shape, np.nan)
    if not others:
        return nothing, nothing
    stack = np.stack([values[name] for name in others])
    enough = np.isfinite(stack).sum(axis=0) >= max(1.0, MIN_OTHERS * len(others))
    middle, sigma = nothing, nothing.copy()
    middle[enough] = np.nanmedian(stack[:, enough], axis=0)
    # σ of a median of methods that see the same noise: averaging methods does not reduce it.
    sigma[enough] = np.nanmedian(np.stack([sigmas[name] for name in others])[:, enough], axis=0)
    return middle, sigma


def _median(values: FloatMap) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _errors(surface: HeightMap, truth_mm: FloatMap) -> Row:
    """The errors against the truth; NaN where no pixel was measured."""
    if np.isfinite(surface.values - truth_mm).any():
        return asdict(errors(surface, truth_mm))
    nothing = {field.name: float("nan") for field in fields(Errors)}
    return nothing | {"failed_fraction": surface.failed_fraction}
