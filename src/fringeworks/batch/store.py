"""Results of a batch on disk: a Zarr group or an archive for each scan, and the summary."""

from __future__ import annotations

import csv
import json
import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, replacing, write_text
from fringeworks.files.limits import is_file, is_folder
from fringeworks.files.read_write import read, write
from fringeworks.files.zarr_array import INSTALL, ZARR_FILE
from fringeworks.types import FileProblem, FloatMap, HeightMap, MissingPackage, PointCloud

SCANS = "scans"
"""Folder of the results, each under its address."""
BEGUN = ".begun"
"""Folder of marks of scans that were begun in this run."""
ROW = "row.json"
"""Figures of a scan beside its archive; a Zarr group holds them as its attributes."""
JUDGEMENT = "judgement"
"""What the report of a part needs beside the figures: an attribute of a Zarr group, or a file."""
ABOUT = "batch.json"
"""What all scans have in common, beside archives; the attributes of a Zarr group else."""
ARCHIVE = "result.npz"
"""The result of a scan where it is no Zarr group."""
CHUNK_PX = 256
"""Side of a chunk, px; a scan is one shard."""
UNITS = {"xyz_mm": "mm", "sigma_mm": "mm", "noise_mm": "mm", "reason": ""}
"""Units of the arrays of points."""
BYTE_ORDER_MARK = "\ufeff"
"""First letter of a text by which Excel knows that it is UTF-8; it takes σ and µ for two letters
each without it."""
Row = dict[str, Any]
"""Figures of a scan, ready for JSON."""


class Store:
    """The folder of a batch's results.

    One scan is written by one worker, into a folder that gets its name when it is complete.

    Parameters
    ----------
    folder : path
        A name that ends with ``.zarr`` holds Zarr groups (format 3), any other one archives.
    excel : bool
        Whether the summary begins with the mark by which Excel knows UTF-8.
    """

    def __init__(self, folder: StrPath, *, excel: bool = False) -> None:
        self.folder = Path(folder)
        self.excel = excel
        self.zarr = self.folder.suffix == ".zarr"
        # Nothing but Zarr's own files lies in its folder: readers complain about others.
        self.summary = self.folder.with_suffix(".csv") if self.zarr else self.folder / "summary.csv"
        """A row for each scan of the batch, as CSV."""

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the folders, and write once what all scans have in common.

        Raises
        ------
        FileProblem where that is not possible; MissingPackage for Zarr without the extra.
        """
        try:
            (self.folder / SCANS).mkdir(parents=True, exist_ok=True)
            self.end()
            (self.folder / BEGUN).mkdir()
            if not self.zarr and not is_file(self.folder / ABOUT):
                write_text(self.folder / ABOUT, json.dumps(about, indent=1) + "\n")
        except OSError as error:
            raise FileProblem(f"{self.folder}: could not be written: {error.strerror}") from error
        if self.zarr:
            group = open_group(self.folder, "a")
            group.require_group(SCANS)
            if not group.attrs:
                group.attrs.update(about)

    def has(self, address: str) -> bool:
        """Whether the result of an address is complete."""
        return is_folder(self.folder / SCANS / address)

    def row(self, address: str) -> Row:
        """Return the figures of a complete result."""
        place = self.folder / SCANS / address
        described = json.loads((place / (ZARR_FILE if self.zarr else ROW)).read_text("utf-8"))
        figures = dict(described["attributes"] if self.zarr else described)
        return {name: value for name, value in figures.items() if name != JUDGEMENT}

    def judgement(self, address: str) -> dict[str, Any]:
        """Return what the report of a part needs; nothing for results of old versions."""
        place = self.folder / SCANS / address
        path = place / (ZARR_FILE if self.zarr else f"{JUDGEMENT}.json")
        if not is_file(path):
            return {}
        described = json.loads(path.read_text("utf-8"))
        return dict(described["attributes"].get(JUDGEMENT, {}) if self.zarr else described)

    def surface(self, address: str) -> HeightMap | PointCloud:
        """Return the surface of a complete result.

        Raises
        ------
        FileProblem for files that were changed.
        """
        place = self.folder / SCANS / address
        if self.zarr:
            return _read_group(place)
        found = read(place / ARCHIVE)
        if not isinstance(found, HeightMap | PointCloud):
            raise FileProblem(f"{place}: expected points or heights, got {type(found).__name__}")
        return found

    def count_begun(self, address: str) -> int:
        """Return how often a scan was begun in this run and has not ended."""
        return len(list((self.folder / BEGUN).glob(f"{address}-*")))

    def mark_begun(self, address: str) -> Path:
        """Mark that a scan is begun; return the mark, which the end of the scan deletes.

        It holds the process's id.
        """
        mark = self.folder / BEGUN / f"{address}-{secrets.token_hex(6)}"
        mark.write_text(str(os.getpid()))
        return mark

    def write(
        self,
        address: str,
        surface: HeightMap | PointCloud,
        row: Row,
        judgement: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Write the result of a scan, whole or not at all.

        Where it is there already, written by another worker, that one stays: it is the same.
        """
        place = self.folder / SCANS / f".{address}-{secrets.token_hex(6)}"
        try:
            place.mkdir()
            if self.zarr:
                _write_group(place, surface, {**row, JUDGEMENT: dict(judgement)})
            else:
                write(place / ARCHIVE, surface)
                write_text(place / ROW, json.dumps(row, indent=1) + "\n")
                write_text(place / f"{JUDGEMENT}.json", json.dumps(dict(judgement)) + "\n")
            os.rename(place, self.folder / SCANS / address)
        except OSError as error:
            shutil.rmtree(place, ignore_errors=True)
            if self.has(address):
                return
            raise FileProblem(f"{self.folder}: could not be written: {error.strerror}") from error
        except BaseException:
            shutil.rmtree(place, ignore_errors=True)
            raise

    def end(self) -> None:
        """Delete the marks of a run that has ended, and what workers left that died."""
        for left in (self.folder / SCANS).glob(".*"):
            shutil.rmtree(left, ignore_errors=True)
        shutil.rmtree(self.folder / BEGUN, ignore_errors=True)

    def write_summary(self, rows: Sequence[Row]) -> None:
        """Write the summary: a row for each scan, as CSV, and as Parquet where that is possible."""
        columns = list(dict.fromkeys(key for row in rows for key in row))
        text = StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_text(self.summary, (BYTE_ORDER_MARK if self.excel else "") + text.getvalue())
        try:
            import pyarrow
            from pyarrow import parquet
        except ModuleNotFoundError:
            return
        table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
        with replacing(self.summary.with_suffix(".parquet")) as temporary:
            parquet.write_table(table, temporary)


def _zarr() -> Any:
    try:
        import zarr
    except ModuleNotFoundError as error:
        raise MissingPackage(
            f"results: expected zarr for a folder that ends with .zarr, got none: {INSTALL}"
        ) from error
    return zarr


def open_group(folder: Path, mode: str) -> Any:
    """Open a Zarr group, format 3.

    Raises
    ------
    MissingPackage without the extra.
    """
    return _zarr().open_group(folder, mode=mode, zarr_format=3)


def check_store(folder: StrPath) -> None:
    """Refuse results that cannot be written, before anything is measured."""
    if Path(folder).suffix == ".zarr":
        _zarr()


def _write_group(place: Path, surface: HeightMap | PointCloud, row: Row) -> None:
    """Write a surface as a Zarr group that xarray reads."""
    group = open_group(place, "w")
    names: tuple[str, ...] = ("xyz_mm", "sigma_mm", "noise_mm", "reason")
    units: Mapping[str, str] = UNITS
    if isinstance(surface, HeightMap):
        names = ("values", "sigma", "reason")
        units = {"values": surface.unit, "sigma": surface.unit, "reason": ""}
        group.attrs.update({"quantity": surface.quantity, "pitch": surface.pitch})
    group.attrs.update(row)
    for name in names:
        values = np.asarray(getattr(surface, name))
        attributes = {"units": units[name]} if units[name] else {}
        create_maps(group, name, values, attributes)[...] = values


def _read_group(place: Path) -> HeightMap | PointCloud:
    """The surface in a Zarr group that ``_write_group`` wrote."""
    group = open_group(place, "r")
    reason = np.asarray(group["reason"][...])
    if "xyz_mm" in group:
        xyz, sigma, noise = (np.asarray(group[n][...]) for n in ("xyz_mm", "sigma_mm", "noise_mm"))
        return PointCloud(xyz, sigma, noise, reason)
    values, sigma = (np.asarray(group[name][...]) for name in ("values", "sigma"))
    about = group.attrs
    unit: Any = group["values"].attrs["units"]
    return HeightMap(values, sigma, reason, about["quantity"], unit, about["pitch"])


def create_maps(
    group: Any,
    name: str,
    like: FloatMap,
    attributes: Mapping[str, str],
    *,
    along_time: bool = False,
) -> Any:
    """Create an array of maps in a Zarr group: one shard for each map.

    Parameters
    ----------
    group : zarr.Group
    name : str
    like : (h, w, …) array
        Its shape and type are those of a map.
    attributes : mapping
    along_time : bool
        Whether maps of many moments follow each other; the array then has none yet.
    """
    from zarr.codecs import BloscCodec

    sides = [-(-n // CHUNK_PX) * CHUNK_PX for n in like.shape[:2]]
    one: tuple[int, ...] = (1,) if along_time else ()
    return group.create_array(
        name,
        shape=((0,) if along_time else ()) + like.shape,
        dtype=like.dtype,
        chunks=(*one, CHUNK_PX, CHUNK_PX, *like.shape[2:]),
        shards=(*one, *sides, *like.shape[2:]),
        compressors=BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"),
        dimension_names=(*(("time",) if along_time else ()), "y", "x", "coordinate")[
            : like.ndim + along_time
        ],
        fill_value=0 if like.dtype.kind == "u" else np.nan,
        attributes=dict(attributes),
    )
