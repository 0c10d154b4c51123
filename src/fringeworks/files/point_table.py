"""Points as tables, from which the files of points are written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.files.findings import findings_as_dicts
from fringeworks.files.white import WHITE, as_numbers, white_of
from fringeworks.surface.cloud import normals
from fringeworks.types import (
    BoolMap,
    FloatMap,
    Placement,
    PointCloud,
    Points,
    Provenance,
    Reason,
)

Kind = Literal["points", "normals", "mesh", "frame"]
"""What a file holds: points, points with normals, triangles, or all pixels of the frame."""
COLOURS = ("red", "green", "blue")
"""Fields of a colour."""
NORMAL_AXES = ("nx", "ny", "nz")
"""Fields of a normal."""
LENGTHS = ("x", "y", "z", "sigma", "noise", "blur")
"""Fields in mm."""
PIXEL = ("row", "column", "reason")
"""Fields of a pixel of the frame."""
BAND_ROWS = 16
"""Rows of a frame whose pixels are put together for a file at a time."""
CAMERA = "camera coordinates, x right, y down, z forward"
"""Coordinates of a cloud."""
PART = "coordinates of the part"
"""Coordinates of points without a frame."""


@dataclass(frozen=True)
class PointTable:
    """Points as rows with named fields, lengths in mm."""

    thing: PointCloud | Points
    kind: Kind = "points"
    organised: bool = False
    """Whether a cloud has a row for every pixel, in their order; NaN where nothing was measured."""

    @property
    def provenance(self) -> Provenance | None:
        """How the points were made."""
        return self.thing.provenance

    @property
    def findings(self) -> list[dict[str, Any]]:
        """What was found about the points, as JSON values."""
        return findings_as_dicts(self.thing.findings)

    @property
    def coordinates(self) -> str:
        """In which coordinates they are."""
        if not isinstance(self.thing, PointCloud):
            return PART
        return CAMERA if self.thing.placement is None else f"coordinates of {self.frame}"

    @property
    def frame(self) -> str:
        """Name of the coordinates."""
        return self.thing.frame if isinstance(self.thing, PointCloud) else "part"

    @property
    def placement(self) -> Placement | None:
        """How points came from camera coordinates to others."""
        return self.thing.placement if isinstance(self.thing, PointCloud) else None

    @property
    def shape(self) -> tuple[int, int] | None:
        """Rows and columns of the frame; None where the table is not a whole frame."""
        whole = (self.kind == "frame" or self.organised) and isinstance(self.thing, PointCloud)
        return self.thing.shape if whole and isinstance(self.thing, PointCloud) else None

    @property
    def count(self) -> int:
        """Number of rows."""
        if isinstance(self.thing, Points):
            return len(self.thing.xyz_mm)
        return int(np.count_nonzero(self._wanted))

    @property
    def _wanted(self) -> BoolMap:
        if not isinstance(self.thing, PointCloud):
            raise TypeError("points without a frame have no pixels")
        every = self.kind == "frame" or self.organised
        return np.ones(self.thing.shape, bool) if every else self.thing.reason == Reason.OK

    @property
    def _white(self) -> float | None:
        colour = self.thing.colour
        if colour is None:
            return None
        seen = np.asarray(colour)
        return white_of(seen[self._measured] if isinstance(self.thing, PointCloud) else seen)

    @property
    def _measured(self) -> BoolMap:
        assert isinstance(self.thing, PointCloud)
        return np.asarray(self.thing.reason == Reason.OK)

    def parts(self, colour: str = "u1", *, exact: bool = False) -> Iterator[NDArray[Any]]:
        """The rows as structured arrays, some at a time.

        Parameters
        ----------
        colour : "u1", "u2" or "f4"
            Type of colours: of 8 or 16 bits, where the brightest points are white, or counts. A
            brightness in counts is one field ``brightness``.
        exact : bool
            Whether x, y and z keep their precision; else they are single.

        Yields
        ------
        Arrays with the fields x, y, z, nx, ny, nz, sigma, noise, residual, blur, red, green, blue,
        row, column and reason, as far as the points have them.
        """
        white = self._white if colour != "f4" else None
        place = np.result_type(self.thing.xyz_mm, np.float32) if exact else np.dtype("<f4")
        types = dict.fromkeys("xyz", place.str) | dict.fromkeys(COLOURS, colour)
        if isinstance(self.thing, Points):
            yield _rows(_columns_of_points(self.thing), self.thing.colour, white, types)
            return
        cloud, wanted = self.thing, self._wanted
        turned = normals(cloud) if self.kind == "normals" else None
        plain = colour == "u1" and not exact and self.kind in ("points", "mesh")
        plain = plain and not self.organised
        if plain and all(m is None or m.dtype == np.float32 for m in _maps(cloud, white)):
            yield from _packed(cloud, white)
            return
        for top in range(0, len(wanted), BAND_ROWS):
            band = slice(top, top + BAND_ROWS)
            here = wanted[band]
            columns = _columns_of_band(cloud, turned, band, here, whole=self.kind == "frame")
            seen = None if cloud.colour is None else np.asarray(cloud.colour)[band][here]
            rows = _rows(columns, seen, white, types)
            if self.organised:
                for name in ("x", "y", "z"):
                    rows[name][cloud.reason[band][here] != Reason.OK] = np.nan
            yield rows


def _maps(cloud: PointCloud, white: float | None) -> tuple[FloatMap | None, ...]:
    """The maps that a row holds."""
    return (cloud.xyz_mm, cloud.sigma_mm, cloud.noise_mm, None if white is None else cloud.colour)


def _packed(cloud: PointCloud, white: float | None) -> Iterator[NDArray[Any]]:
    """Rows without normals, of maps in single precision, by a kernel."""
    fields: list[tuple[str, str]] = [(n, "<f4") for n in ("x", "y", "z", "sigma", "noise")]
    fields += [] if white is None else [(name, "u1") for name in COLOURS]
    scale = 1.0 if white is None else WHITE / white
    for top in range(0, len(cloud.reason), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        shade = None if white is None else _flat(np.asarray(cloud.colour)[band])
        maps = (cloud.xyz_mm, cloud.sigma_mm, cloud.noise_mm, cloud.reason)
        xyz, sigma, noise, reason = (_flat(m[band]) for m in maps)
        packed = _core.pack_vertices(xyz, sigma, noise, reason, shade, scale=scale)
        yield packed.view(np.dtype(fields))


def _flat(band: NDArray[Any]) -> NDArray[Any]:
    """Rows of a map as kernels take them: all values of a row in one."""
    return np.ascontiguousarray(band.reshape(len(band), -1))


def _columns_of_points(points: Points) -> dict[str, NDArray[Any]]:
    columns = dict(zip("xyz", points.xyz_mm.T, strict=True))
    if points.normals is not None:
        columns |= dict(zip(NORMAL_AXES, points.normals.T, strict=True))
    known = {"sigma": points.sigma_mm, "noise": points.noise_mm}
    return columns | {name: values for name, values in known.items() if values is not None}


def _columns_of_band(
    cloud: PointCloud, turned: FloatMap | None, band: slice, here: BoolMap, *, whole: bool
) -> dict[str, NDArray[Any]]:
    columns = dict(zip("xyz", cloud.xyz_mm[band][here].T, strict=True))
    if turned is not None:
        # Readers expect numbers: a point with too few neighbours for a normal gets 0, 0, 0.
        columns |= dict(zip(NORMAL_AXES, np.nan_to_num(turned[band][here]).T, strict=True))
    columns |= {"sigma": cloud.sigma_mm[band][here], "noise": cloud.noise_mm[band][here]}
    if whole:
        more = {"residual": cloud.residual_px, "blur": cloud.blur_mm}
        columns |= {name: part[band][here] for name, part in more.items() if part is not None}
        rows, across = np.nonzero(here)
        columns |= {"row": rows + band.start, "column": across}
        columns["reason"] = cloud.reason[band][here]
    return columns


def _rows(
    columns: dict[str, NDArray[Any]],
    seen: FloatMap | None,
    white: float | None,
    types: dict[str, str],
) -> NDArray[Any]:
    """The columns, and the colour that was seen, as one structured array."""
    colour = np.dtype(types["red"])
    if seen is not None and colour.kind == "f":
        many = COLOURS if seen.ndim == 2 else ("brightness",)
        columns = columns | dict(zip(many, np.atleast_2d(seen.T), strict=True))
    elif seen is not None and white is not None:
        shown = as_numbers(seen, white, 8 * colour.itemsize)
        columns = columns | dict(zip(COLOURS, shown.T, strict=True))
    types = types | {"row": "<u4", "column": "<u4", "reason": "u1"}
    names = sorted(columns, key=lambda name: name in PIXEL)  # pixels come last
    table = np.empty(len(columns["x"]), [(name, types.get(name, "<f4")) for name in names])
    for name in names:
        table[name] = columns[name]
    return table


def fields_of(table: NDArray[Any]) -> Sequence[str]:
    """Names of the fields of a table."""
    return table.dtype.names or ()
