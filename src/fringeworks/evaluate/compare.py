"""Methods side by side on standard scenes, or on one's own pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import product
from typing import Any, TypedDict, Unpack

import numpy as np

from fringeworks.evaluate.captures import Captures, Row, compare_captures, rows_of_captures
from fringeworks.evaluate.truth_errors import errors
from fringeworks.pair.analyse import get_method
from fringeworks.pair.analyse import methods as all_methods
from fringeworks.pipeline.pairs import Reconstruction, reconstruct
from fringeworks.signal.denoise import Denoiser
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import InputError, Pair


class SceneOptions(TypedDict, total=False):
    """The artificial scenes of ``compare``: values to combine, and what all scenes share."""

    gammas: float | Sequence[float]
    """Exponents of the response; 1 by default. One may be given as ``gamma``."""
    gamma: float | Sequence[float]
    """The same as ``gammas``."""
    noises: float | Sequence[float]
    """Standard deviations of the noise, counts of 8 bit; 0 by default. One may be given as
    ``noise``."""
    noise: float | Sequence[float]
    """The same as ``noises``."""
    bits: int | Sequence[int]
    """Quantisation, 0 for none, which is the default."""
    fringes: float | Sequence[float]
    """Periods across the frame; 10 by default."""
    height_mm: float
    """Largest height, mm; 100 by default."""
    size: int
    """Side of the frames, px; 1000 by default."""
    seed: int
    """Seed of the noise; 0 by default."""


class CompareOptions(SceneOptions, total=False):
    """Keyword options of ``compare``; each is explained there."""

    objects: Sequence[str]
    denoise: Denoiser | None
    timing: bool
    on_result: Callable[[Row, Reconstruction], None] | None


STANDARD: SceneOptions = {
    "gammas": (1.0,),
    "noises": (0.0,),
    "bits": (0,),
    "fringes": (10.0,),
    "height_mm": 100.0,
    "size": 1000,
    "seed": 0,
}
"""Options of scenes that are not given: the undisturbed standard scene of theory §3."""
SINGULAR = {"gamma": "gammas", "noise": "noises"}
"""Second names of options, as ``standard_scene`` has them."""
COMBINED = ("gammas", "noises", "bits", "fringes")
"""Options of which every combination is run."""


def compare(
    objects: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    *,
    captures: Captures | None = None,
    against: str | None = None,
    denoise: Denoiser | None = None,
    timing: bool = False,
    on_result: Callable[[Row, Reconstruction], None] | None = None,
    **scenes: Unpack[SceneOptions],
) -> list[Row]:
    """Run methods on artificial scenes, every combination once, or on one's own pairs of frames.

    Parameters
    ----------
    objects : names of artificial objects, optional
        The parabola where left out.
    methods : names of methods, optional
        All where left out.
    captures : sequence of Pair or path, or dictionary of them by name, optional
        One's own pairs instead of artificial scenes; ``compare_captures`` gives their maps, too.
    against : str, optional
        With captures: the method that the others are compared with; by default, each is compared
        with the median of the others. Agreement is not accuracy.
    denoise : "emd", "emd2d" or "bemd", optional
        Applied to both frames before every method.
    timing : bool
        Add the column ``seconds``, in which equal runs differ.
    on_result : callable, optional
        Called with each row and its reconstruction, for progress and figures.
    **scenes
        ``SceneOptions``: gammas, noises, bits and fringes, numbers or sequences of which every
        combination is run, and height_mm, size and seed.

    Returns
    -------
    List of rows. For scenes: object, method, gamma, noise, bits, fringes and the fields of
    ``Errors``. For captures: those of ``CaptureComparison.rows``; where some captures have a truth,
    the errors of the others are NaN.

    Raises
    ------
    InputError for an unknown object, method or option, for captures together with scenes, and as
    ``compare_captures``.

    Examples
    --------
    >>> scene = standard_scene("parabola", size=100, fringes=8)
    >>> rows = compare(captures=[scene], methods=["fourier", "windowed"], against="windowed")
    >>> [f"{row['method']}: {row['median_abs_difference'] < 2}" for row in rows]
    ['fourier: True', 'windowed: False']
    >>> compare(methods=["fourier"], noise=2, bits=8, size=100)[0]["noise"]
    2
    """
    if objects is not None and _is_capture(objects):
        raise InputError("objects: expected names of artificial objects; pairs belong to captures")
    if captures is None:
        if against is not None:
            raise InputError("against: expected together with captures; scenes have their truth")
        chosen = _chosen(scenes)
        return _on_scenes(objects or ("parabola",), methods, chosen, denoise, timing, on_result)
    given = [*(["objects"] if objects else []), *scenes]
    if given:
        raise InputError(f"captures cannot be combined with {given[0]}, an option of scenes")
    found = compare_captures(captures, methods, against=against, denoise=denoise)
    rows = rows_of_captures(found, timing=timing)
    if on_result:
        for row, result in zip(
            rows, [r for one in found for r in one.results.values()], strict=True
        ):
            on_result(row, result)
    return rows


def _is_capture(objects: object) -> bool:
    """Whether a pair, or several, were given in place of names."""
    one = next(iter(objects), None) if isinstance(objects, list | tuple) else objects
    return isinstance(one, Pair)


def _chosen(scenes: SceneOptions) -> dict[str, Any]:
    """Options of scenes by their first names, with sequences where they are combined."""
    chosen: dict[str, Any] = dict(STANDARD)
    for name, value in scenes.items():
        first = SINGULAR.get(name, name)
        if first not in STANDARD:
            known = ", ".join([*STANDARD, *SINGULAR])
            raise InputError(f"{name}: expected an option of scenes ({known})")
        if name in SINGULAR and first in scenes:
            raise InputError(f"{name}: expected either {name} or {first}, got both")
        chosen[first] = value
    for name in COMBINED:
        if np.ndim(chosen[name]) == 0:
            chosen[name] = (chosen[name],)
    return chosen


def _on_scenes(
    objects: Sequence[str],
    methods: Sequence[str] | None,
    scenes: dict[str, Any],
    denoise: Denoiser | None,
    timing: bool,
    on_result: Callable[[Row, Reconstruction], None] | None,
) -> list[Row]:
    """Rows of every method on every combination."""
    chosen = list(all_methods()) if methods is None else list(methods)
    for name in chosen:
        get_method(name)
    common = {name: scenes[name] for name in ("size", "height_mm", "seed")}
    combined = product(
        objects, scenes["gammas"], scenes["noises"], scenes["bits"], scenes["fringes"]
    )
    rows: list[Row] = []
    for name, gamma, noise, depth, count in combined:
        settings = {"gamma": gamma, "noise": noise, "bits": depth, "fringes": count}
        scene = standard_scene(name, **common, **settings)
        assert scene.truth_mm is not None
        for method in chosen:
            result = reconstruct(scene, method, denoise=denoise)
            found = asdict(errors(result.surface, scene.truth_mm))
            row: Row = {"object": name, "method": method, **settings, **found}
            rows.append(row | ({"seconds": result.seconds} if timing else {}))
            if on_result:
                on_result(rows[-1], result)
    return rows


SWEEP: CompareOptions = {
    "objects": ("parabola", "sphere", "cylinder", "cube"),
    "gammas": (1.0, 2.2),
    "noises": (0.0, 1.0, 4.0),
    "bits": (0, 8),
    "fringes": (5.0, 10.0, 20.0),
    "height_mm": 30.0,
    "size": 500,
}
"""Scenes of ``compare_everywhere``. The fringes have periods of 100, 50 and 25 px, as 10, 20 and 40
have on the standard scene. The height keeps every cliff below half a period, beyond which two
frames cannot distinguish steps that differ by a whole period."""


def compare_everywhere(
    methods: Sequence[str] | None = None, **options: Unpack[CompareOptions]
) -> list[Row]:
    """Run methods on a sweep of objects, responses, noise, quantisation and fringes.

    Parameters
    ----------
    methods : names of methods, optional
        All where left out.
    **options
        Of ``compare``; each takes the place of the sweep's own, ``SWEEP``.

    Returns
    -------
    Rows as those of ``compare``; ``best_methods`` finds the winners.
    """
    chosen: CompareOptions = {**SWEEP, **options}
    return compare(methods=methods, **chosen)
