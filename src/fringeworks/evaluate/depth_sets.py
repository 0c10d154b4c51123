"""Scores of folders of depth maps, in the layout of FPP-ML-Bench."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from fringeworks.evaluate.scoring import Score, errors_of
from fringeworks.files.atomic import StrPath
from fringeworks.files.foreign_maps import depth_files, read_map
from fringeworks.types import FileProblem, InputError

ALL = "all"
"""Name of the row that has the means over all samples."""


def score_depths(results: StrPath, truth: StrPath, *, scale: float = 1.0) -> tuple[Score, ...]:
    """Score a folder of depth maps against a folder of true ones.

    Parameters
    ----------
    results, truth : path
        Folders of maps with equal names, or folders with a folder ``depth`` in them: the layout of
        FPP-ML-Bench's ``train``, ``val`` and ``test``. A truth of 0 marks the background, as
        there, and so does 0 or NaN in a result.
    scale : float > 0
        Millimetres per unit of both; 1000 for metres.

    Returns
    -------
    tuple of Score
        One for each true map, by name, and one named "all" with the means over them. Mean absolute
        and rms errors are over the object's pixels: the "object MAE" and "object RMSE" of that
        benchmark. Fringe orders are unknown, and so are σ.

    Raises
    ------
    FileProblem where folders or maps are missing or damaged; InputError for maps of different
    shapes, and for a truth without an object.

    Notes
    -----
    The layout is that of the loader of FPP-ML-Bench (Lakshman S, Haroon & Li, arXiv 2601.08900).
    Its maps "normalised individually" have no unit, so their scores have none either.
    """
    true, found = depth_files(truth), depth_files(results)
    missing = [name for name in true if name not in found]
    if missing:
        raise FileProblem(
            f"{results}: expected {len(true)} maps with the names of the truth; "
            f"{len(missing)} are missing, the first is {missing[0]}"
        )
    rows = [_scored(name, found[name], true[name], scale) for name in true]
    return (*rows, _mean(rows))


def _scored(name: str, result: StrPath, truth: StrPath, scale: float) -> Score:
    """The score of one map."""
    values, known = read_map(result, scale=scale), read_map(truth, scale=scale)
    if values.shape != known.shape:
        raise InputError(f"{result}: expected shape {known.shape}, got {values.shape}")
    with np.errstate(invalid="ignore"):
        part = np.isfinite(known) & (known > 0.0)
        there = np.isfinite(values) & (values > 0.0)
    if not part.any():
        raise InputError(f"{truth}: expected depths above 0 on an object, got none")
    judged = there & part
    beside = ~part
    shares = {
        "measured": float(there[part].mean()),
        "unfounded": float(there[beside].mean()) if beside.any() else float("nan"),
    }
    if not judged.any():
        nothing = dict.fromkeys(_figures(), float("nan"))
        return Score(scene=name, quantity="depth", unit="mm", **shares, **nothing)
    condensed = errors_of(values, known, judged, None, None)
    figures = {key: getattr(condensed, key) for key in _figures()}
    return Score(scene=name, quantity="depth", unit="mm", **shares, **figures)


def _figures() -> list[str]:
    """Names of the errors of a score."""
    numbers = [one.name for one in fields(Score) if one.type == "float"]
    return [name for name in numbers if name not in ("measured", "unfounded")]


def _mean(rows: list[Score]) -> Score:
    """Means over the samples, each sample counting alike; those without a value are left out."""
    means: dict[str, Any] = {}
    for name in ("measured", "unfounded", *_figures()):
        values = np.array([getattr(row, name) for row in rows])
        known = values[np.isfinite(values)]
        means[name] = float(known.mean()) if known.size else float("nan")
    return replace(rows[0], scene=ALL, **means)
