"""Pictures of rows, frames, surfaces and errors, each a matplotlib ``Figure``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.provenance import json_line
from fringeworks.pair.methods.inverse_function import Extrema
from fringeworks.report.drawing import (
    Axes,
    BoundaryNorm,
    Figure,
    ListedColormap,
    need_plots,
    rc_context,
)
from fringeworks.report.maps import DPI, draw_map, draw_sheet, limits_of
from fringeworks.report.sheets import Panel, PanelKind, Sheet
from fringeworks.types import FloatMap, InputError, Provenance
from fringeworks.types.numbers import number

MAX_SURFACE_POINTS = 160
"""Mesh lines per side in perspective views; more is slow and looks no better."""
FORMATS = (".png", ".pdf", ".svg")
"""Suffixes of pictures."""
SETTINGS: Any = {"svg.hashsalt": "fringeworks", "pdf.fonttype": 42, "pdf.use14corefonts": False}
"""Settings of files: no random names in SVG, and TrueType fonts embedded in PDF (Type 42), as
publishers ask for."""


def check_figure_target(path: StrPath) -> None:
    """Refuse a picture that ``save_figure`` cannot write, before anything is computed for it."""
    need_plots("a picture")
    check_target(path, FORMATS)


def save_figure(figure: Figure, path: StrPath, *, provenance: Provenance | None = None) -> Path:
    """Write a figure in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    figure : matplotlib Figure
    path : path
        ``.png``, ``.pdf`` or ``.svg``.
    provenance : Provenance, optional
        Written into the file's metadata.

    Returns
    -------
    The path.

    Raises
    ------
    FileProblem for another suffix, and where the folder cannot be written to.

    Examples
    --------
    >>> import tempfile
    >>> import fringeworks as fw
    >>> plan = fw.propose(640, 400, 4, axes=("x",), range_px={"x": 80.0})[0].plan
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_figure(plan.plot(), f"{folder}/plan.png").name
    'plan.png'
    """
    path = Path(path)
    check_figure_target(path)
    if not hasattr(figure, "savefig"):
        raise InputError(
            f"figure: expected a figure, as .plot() returns, got {type(figure).__name__}"
        )
    kind = path.suffix.lower()[1:]
    origin = json_line(provenance)
    # Dates and random identifiers would make every file differ from the last.
    metadata: dict[str, Any] = {
        "png": {"provenance": origin},
        "pdf": {"Subject": origin, "CreationDate": None},
        "svg": {"Description": origin, "Date": None},
    }[kind]
    shown = {k: v for k, v in metadata.items() if v is not None or k in ("CreationDate", "Date")}
    with replacing(path) as temporary, rc_context(SETTINGS):
        figure.savefig(temporary, dpi=DPI, format=kind, metadata=shown)
    return path


def _axes(title: str, size: tuple[float, float] = (7.0, 4.2)) -> tuple[Figure, Axes]:
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title)
    return figure, axes


def rows(
    title: str, curves: Mapping[str, FloatMap], *, y_label: str = "intensity / counts"
) -> Figure:
    """One or more rows over the sample number."""
    figure, axes = _axes(title)
    for label, values in curves.items():
        axes.plot(np.arange(len(values)), values, label=label, linewidth=1.2)
    axes.set_xlabel("x / px")
    axes.set_ylabel(y_label)
    if len(curves) > 1:
        axes.legend(loc="upper right")
    return figure


def rows_with_extrema(title: str, curves: Mapping[str, tuple[FloatMap, Extrema]]) -> Figure:
    """Rows with their turning points marked."""
    figure, axes = _axes(title, (9.0, 4.2))
    for label, (values, extrema) in curves.items():
        (line,) = axes.plot(np.arange(len(values)), values, label=label, linewidth=1.0)
        axes.plot(extrema.position_px, extrema.value, "o", color=line.get_color(), markersize=5)
    axes.set_xlabel("x / px")
    axes.set_ylabel("intensity / counts")
    axes.legend(loc="upper right")
    return figure


def monotone_part(title: str, parts: Mapping[str, tuple[FloatMap, FloatMap]]) -> Figure:
    """Position over intensity of one monotone part: the inverse functions."""
    figure, axes = _axes(title, (6.0, 4.6))
    for label, (intensity, position) in parts.items():
        axes.plot(intensity, position, ".-", label=label, linewidth=1.0)
    axes.set_xlabel("intensity / counts")
    axes.set_ylabel("x / px")
    axes.legend()
    return figure


def frame(title: str, values: FloatMap) -> Figure:
    """A fringe frame in grey."""
    figure, axes = _axes(title, (5.6, 5.0))
    picture = axes.imshow(values, cmap="gray", interpolation="nearest")
    axes.set_xlabel("x / px")
    axes.set_ylabel("y / px")
    figure.colorbar(picture, ax=axes, label="counts", shrink=0.85)
    return figure


def _perspective(axes: Any, values: FloatMap, pitch: float, unit: str) -> None:
    step = max(1, int(np.ceil(max(values.shape) / MAX_SURFACE_POINTS)))
    z = values[::step, ::step]
    rows_, columns = z.shape
    x, y = np.meshgrid(np.arange(columns) * step * pitch, np.arange(rows_) * step * pitch)
    finite = z[np.isfinite(z)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    surface = axes.plot_surface(x, y, z, cmap="viridis", rcount=len(z), ccount=len(z), linewidth=0)
    # Tens of thousands of facets would make vector files of many megabytes.
    surface.set_rasterized(True)
    axes.set_zlim(min(low, 0.0), max(high, 1e-6))
    axes.invert_yaxis()
    axes.set_xlabel(f"x / {unit}")
    axes.set_ylabel(f"y / {unit}")
    axes.set_zlabel(unit)
    axes.view_init(elev=35, azim=-60)


def perspective(title: str, values: FloatMap, *, pitch: float = 1.0, unit: str = "mm") -> Figure:
    """A surface in perspective."""
    need_plots("a picture")
    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    axes.set_title(title)
    _perspective(axes, values, pitch, unit)
    return figure


def error_maps(title: str, maps: Mapping[str, FloatMap], *, absolute: bool = False) -> Figure:
    """Error maps side by side, each with a scale of its own."""
    panels = [
        Panel(
            label, np.abs(values) if absolute else values, "sigma" if absolute else "signed", "mm"
        )
        for label, values in maps.items()
    ]
    return draw_sheet(Sheet(title, "", panels, columns=3))


def overview(title: str, cells: Sequence[Sequence[tuple[str, FloatMap, str]]]) -> Figure:
    """A sheet of maps, line by line; each cell is (title, values, kind).

    Kinds: "frame" in grey counts, "height" in mm, "error" in mm about zero. Heights of a line have
    one scale, and errors have another one.
    """
    need_plots("a picture")
    columns = max(len(line) for line in cells)
    figure = Figure(figsize=(3.6 * columns, 3.2 * len(cells) + 0.4), layout="constrained")
    figure.suptitle(title)
    kinds: dict[str, PanelKind] = {"height": "values", "error": "signed"}
    for r, line in enumerate(cells):
        limits = {
            kind: limits_of(drawn, [values for _, values, k in line if k == kind])
            for kind, drawn in kinds.items()
        }
        for c, (label, values, kind) in enumerate(line):
            axes = figure.add_subplot(len(cells), columns, r * columns + c + 1)
            axes.set_title(label, fontsize=10)
            axes.set_xticks([])
            axes.set_yticks([])
            if kind == "frame":
                axes.imshow(values, cmap="gray")
            else:
                draw_map(axes, values, kinds[kind], limits[kind], "mm")
    return figure


def bars(title: str, labels: Sequence[str], series: Mapping[str, Sequence[float]]) -> Figure:
    """Grouped bars on a logarithmic scale: errors of several methods."""
    figure, axes = _axes(title)
    width = 0.8 / len(series)
    for k, (name, values) in enumerate(series.items()):
        position = np.arange(len(labels)) + (k - (len(series) - 1) / 2) * width
        drawn = axes.bar(position, values, width, label=name)
        axes.bar_label(drawn, labels=[number(v, digits=2) for v in values], fontsize=8)
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(labels)), labels)
    axes.set_ylabel("mm")
    axes.legend()
    return figure


def best_map(title: str, cells: Sequence[Any]) -> Figure:
    """Scenes in rows, fringes in columns, coloured by the method with the lowest mean error.

    ``cells`` are those of ``best_methods``; the number in each is that error, mm.
    """
    need_plots("a picture")
    columns = sorted({cell.scene["fringes"] for cell in cells})
    lines = list(
        dict.fromkeys(tuple(v for k, v in cell.scene.items() if k != "fringes") for cell in cells)
    )
    names = sorted({cell.best for cell in cells}, key=lambda n: (n != "windowed", n))
    index = np.full((len(lines), len(columns)), np.nan)
    figure = Figure(
        figsize=(4.5 + 1.2 * len(columns), 1.2 + 0.27 * len(lines)), layout="constrained"
    )
    axes = figure.add_subplot()
    axes.set_title(title)
    for cell in cells:
        r = lines.index(tuple(v for k, v in cell.scene.items() if k != "fringes"))
        c = columns.index(cell.scene["fringes"])
        index[r, c] = names.index(cell.best)
        axes.text(c, r, number(cell.error_mm, digits=2), ha="center", va="center", fontsize=7)
    palette = ListedColormap(["#bfe3c6", *(f"C{k}" for k in range(len(names) - 1))])
    norm = BoundaryNorm(np.arange(len(names) + 1) - 0.5, max(len(names), 1))
    picture = axes.imshow(index, cmap=palette, norm=norm, aspect="auto", alpha=0.75)
    axes.set_xticks(range(len(columns)), [f"{f:g}" for f in columns])
    axes.set_xlabel("fringes")
    labels = [f"{name}, γ {g:g}, noise {n:g}, {b or 'no'} bit" for name, g, n, b in lines]
    axes.set_yticks(range(len(lines)), labels, fontsize=7)
    bar = figure.colorbar(picture, ax=axes, ticks=range(len(names)))
    bar.ax.set_yticklabels(names)
    return figure
