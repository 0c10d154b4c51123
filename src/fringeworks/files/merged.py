"""Points without a frame as PLY files: a part that was merged from several views."""

from __future__ import annotations

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.ply import write_ply
from fringeworks.files.provenance import comment_lines
from fringeworks.files.white import eight_bits, white_of
from fringeworks.types import InputError, Points, Provenance


def write_merged_points(
    path: StrPath, points: Points, *, provenance: Provenance | None = None
) -> None:
    """Write points with σ, noise, normals and brightness, as far as they have them, as ``.ply``.

    Parameters
    ----------
    path : path
    points : Points
    provenance : Provenance, optional
        Written into the header.

    Raises
    ------
    FileProblem for another suffix and a folder that cannot be written to; InputError for no
    points.
    """
    check_target(path, (".ply",))
    count = len(points.xyz_mm)
    if not count:
        raise InputError(f"{path}: expected points to write, got none")
    columns = dict(zip("xyz", points.xyz_mm.T, strict=True))
    if points.normals is not None:
        columns |= dict(zip(("nx", "ny", "nz"), points.normals.T, strict=True))
    known = {"sigma": points.sigma_mm, "noise": points.noise_mm}
    columns |= {name: values for name, values in known.items() if values is not None}
    fields = [(name, "<f4") for name in columns]
    white = None if points.colour is None else white_of(points.colour)
    if white is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
    table = np.empty(count, dtype=fields)
    for name, values in columns.items():
        table[name] = values
    if points.colour is not None and white is not None:
        table["red"], table["green"], table["blue"] = eight_bits(points.colour, white).T
    comments = ["fringeworks; coordinates of the part; unit mm", *comment_lines(provenance)]
    with replacing(path) as temporary:
        write_ply(temporary, [table], count, None, comments)
