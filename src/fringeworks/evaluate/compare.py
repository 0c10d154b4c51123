"""Methods side by side on standard scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import product
from typing import Any, TypedDict, Unpack

from fringeworks.evaluate.errors import errors
from fringeworks.pair.analyse import get_method
from fringeworks.pair.analyse import methods as all_methods
from fringeworks.pipeline.pairs import Reconstruction, reconstruct
from fringeworks.signal.denoise import Denoiser
from fringeworks.simulate.scene import standard_scene

Row = dict[str, Any]
"""A line of a table, by column."""


def compare(
    objects: Sequence[str] = ("parabola",),
    methods: Sequence[str] | None = None,
    *,
    gammas: Sequence[float] = (1.0,),
    noises: Sequence[float] = (0.0,),
    bits: Sequence[int] = (0,),
    fringes: Sequence[float] = (10.0,),
    height_mm: float = 100.0,
    size: int = 1000,
    seed: int = 0,
    denoise: Denoiser | None = None,
    timing: bool = False,
    on_result: Callable[[Row, Reconstruction], None] | None = None,
) -> list[Row]:
    """Run methods on standard scenes, every combination once.

    Parameters
    ----------
    objects : names of artificial objects
    methods : names of methods, optional
        All where left out.
    gammas, noises, bits, fringes : values to combine
        Exponents of the response; noise in counts of 8 bit; quantisation, 0 for none; periods
        across the frame.
    height_mm, size, seed : of the standard scene
    denoise : "emd", "emd2d" or "bemd", optional
        Applied to both frames before every method.
    timing : bool
        Add the column ``seconds``, in which equal runs differ.
    on_result : callable, optional
        Called with each row and its reconstruction, for progress and figures.

    Returns
    -------
    List of rows with the keys object, method, gamma, noise, bits, fringes and the fields of
    ``Errors``.

    Raises
    ------
    InputError for an unknown object or method.
    """
    chosen = list(all_methods()) if methods is None else list(methods)
    for name in chosen:
        get_method(name)
    rows: list[Row] = []
    for name, gamma, noise, depth, count in product(objects, gammas, noises, bits, fringes):
        settings = {"gamma": gamma, "noise": noise, "bits": depth, "fringes": count}
        scene = standard_scene(name, size=size, height_mm=height_mm, seed=seed, **settings)  # type: ignore[arg-type]
        assert scene.truth_mm is not None
        for method in chosen:
            result = reconstruct(scene, method, denoise=denoise)
            found = asdict(errors(result.surface, scene.truth_mm))
            row: Row = {"object": name, "method": method, **settings, **found}
            rows.append(row | ({"seconds": result.seconds} if timing else {}))
            if on_result:
                on_result(rows[-1], result)
    return rows


class CompareOptions(TypedDict, total=False):
    """Keyword options of ``compare``; each is explained there."""

    objects: Sequence[str]
    gammas: Sequence[float]
    noises: Sequence[float]
    bits: Sequence[int]
    fringes: Sequence[float]
    height_mm: float
    size: int
    seed: int
    denoise: Denoiser | None
    timing: bool
    on_result: Callable[[Row, Reconstruction], None] | None


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
