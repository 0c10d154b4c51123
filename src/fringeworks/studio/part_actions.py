"""What a click does with measured parts: meshes, drawings, many at once; and checks of a rig.

As in ``actions``, every action runs the library with the same arguments as its Python does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fringeworks.evaluate.deviation import deviation
from fringeworks.evaluate.inspect import inspect
from fringeworks.files.check_history import append_check
from fringeworks.files.mesh_writer import write_mesh
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.rig_check import check_rig
from fringeworks.report.page.surfaces import surface_of
from fringeworks.report.summary import summarise
from fringeworks.report.viewer.pack import pack_surface
from fringeworks.scan.bench import Take, open_bench, take
from fringeworks.serving.worker import Link
from fringeworks.studio.actions import Command, Scan, quoted
from fringeworks.studio.tasks import Source, compute, thinning_of
from fringeworks.studio.workspace import CHECKS, Workspace
from fringeworks.surface.clean import clean_cloud
from fringeworks.surface.mesh import cloud_mesh
from fringeworks.surface.relief import solid_relief
from fringeworks.types import InputError, PointCloud

TO_PRINT = (".stl", ".3mf")
"""Formats of slicers: their meshes are solids on a plate."""
PLATE_MM = 2.0
"""Thickness of the plate, mm: several layers of a usual printer, so that it does not bend."""
HOLE_PX = 500
"""Largest hole that is filled in a solid, px: the spots and glints that docs/meshes.md fills."""


def cloud_of(link: Link, source: Source) -> PointCloud:
    """The points of a source in the order of a frame's pixels.

    Raises
    ------
    InputError for heights over a plane, and for points without a frame.
    """
    found = surface_of(compute(link, source))
    if not isinstance(found, PointCloud):
        raise InputError(
            f"{source.name}: expected points in the order of a frame's pixels, got another result: "
            "calibrate a rig, and measure a stack with it"
        )
    return found


def _cloud_file(source: Source, name: str) -> tuple[str, str]:
    """The file of a source's points, and the command that writes it; empty for none."""
    if source.how == "read":
        return source.name, ""
    file = f"{name}.npz"
    return file, source.shell("--out", quoted(file))


def _lines(*commands: str) -> str:
    return "\n".join(filter(None, commands))


def _points_in_python(source: Source) -> str:
    """Python that gives the points of a source."""
    made, part = source.python
    return f"{made}{part}"


@dataclass(frozen=True)
class WriteMesh:
    """Connect the points of a part by triangles, for printers and CAD."""

    source: Source
    name: str
    """Of the file; its suffix says the format."""

    def run(self, link: Link, space: Workspace) -> str:
        """Write the mesh; the name of its file."""
        cloud = cloud_of(link, self.source)
        link.progress("connecting the points")
        clean = clean_cloud(cloud)
        mesh = (
            solid_relief(clean, plate_mm=PLATE_MM, fill_px=HOLE_PX)
            if self._to_print
            else cloud_mesh(clean)
        )
        write_mesh(space.root / self.name, mesh)
        return self.name

    @property
    def _to_print(self) -> bool:
        """Whether the file is for a slicer."""
        return Path(self.name).suffix in TO_PRINT

    def command(self, _: Any) -> Command:
        """What does the same."""
        cloud, measured = _cloud_file(self.source, Path(self.name).stem)
        options, made = "", "mesh = fw.surface.cloud_mesh(fw.surface.clean_cloud(cloud))\n"
        if self._to_print:
            options = f"--plate {PLATE_MM:g} --fill {HOLE_PX} "
            made = (
                "mesh = fw.surface.solid_relief(\n"
                f"    fw.surface.clean_cloud(cloud), plate_mm={PLATE_MM}, fill_px={HOLE_PX}\n)\n"
            )
        return Command(
            _lines(
                measured, f"fringeworks mesh {quoted(cloud)} {options}--out {quoted(self.name)}"
            ),
            f"cloud = {_points_in_python(self.source)}\n"
            f"{made}"
            f"fw.files.write_mesh({self.name!r}, mesh)",
        )


@dataclass(frozen=True)
class Deviate:
    """Compare a part with its drawing."""

    source: Source
    model: str
    """Name of the drawing's file in the folder."""
    tolerance_mm: float | None
    target: str
    """Where the surface for the page is written."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Align the part and measure its deviation; the figures."""
        cloud = cloud_of(link, self.source)
        rig = None if self.source.rig is None else read_rig(self.source.rig)
        link.progress("aligning the part with the drawing")
        found = deviation(cloud, space.inside(self.model), rig=rig, progress=link.progress)
        every = thinning_of(cloud)
        title = f"{self.source.name} − {self.model}"
        packed = pack_surface(
            cloud, deviation=found.distance_mm, camera=rig, every=every, title=title
        )
        Path(self.target).write_bytes(packed.data)
        figures = summarise(found) | found.figures(self.tolerance_mm)
        return {"figures": figures, "every": every, "title": title}

    def command(self, _: Any) -> Command:
        """What does the same."""
        cloud, measured = _cloud_file(self.source, self.source.path.name)
        rig = self.source.rig is not None
        words = f"fringeworks deviation {quoted(cloud)} --model {quoted(self.model)}"
        words += " --rig rig.toml" if rig else ""
        given = ", rig='rig.toml'" if rig else ""
        within = "" if self.tolerance_mm is None else f" --tolerance-mm {self.tolerance_mm:g}"
        return Command(
            _lines(measured, words + within),
            f"cloud = {_points_in_python(self.source)}\n"
            f"found = fw.deviation(cloud, {self.model!r}{given})\n"
            f"print(found.figures({self.tolerance_mm!r}))",
        )


@dataclass(frozen=True)
class InspectAll:
    """Judge many parts by the recipe in the folder."""

    names: tuple[str, ...]

    def run(self, link: Link, space: Workspace) -> dict[str, str]:
        """Judge part after part; the verdicts, or why there is none, by name."""
        found: dict[str, str] = {}
        for name in self.names:
            link.progress(f"judging {name}")
            try:
                found[name] = str(inspect(space.inside(name), space.recipe).verdict)
            except InputError as problem:
                found[name] = "; ".join(problem.lines)
        return found

    def command(self, _: Any) -> Command:
        """What does the same."""
        return Command(
            "\n".join(
                f"fringeworks inspect {quoted(name)} --recipe recipe.toml" for name in self.names
            ),
            f"for name in {list(self.names)!r}:\n"
            "    print(name, fw.inspect(name, 'recipe.toml').verdict)",
        )


@dataclass(frozen=True)
class CheckRig:
    """Check whether the rig still holds, by one pose of a board."""

    name: str
    """Of the capture that is taken for it."""
    board: str
    devices: dict[str, Any]
    """As for ``Scan``."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Take a pose and check the rig by it."""
        link.progress("opening the devices")
        with open_bench(space.setup, **self.devices) as bench:
            take(bench, space.root / self.name, progress=link.progress)
        link.progress("checking")
        found = check_rig(space.rig, space.root / self.name, self.board)
        append_check(space.root / CHECKS, found)
        return summarise(found)

    def command(self, _: Any) -> Command:
        """What does the same."""
        taken = Scan(self.name, Take(), self.devices).command(None)
        return Command(
            f"{taken.shell}\nfringeworks rig check {quoted(self.name)} --rig rig.toml "
            f"--board {quoted(self.board)} --history {CHECKS}",
            f"{taken.python}\nfound = fw.rig.check_rig('rig.toml', {self.name!r}, {self.board!r})\n"
            f"fw.files.append_check({CHECKS!r}, found)\nprint(found)",
        )


PART_ACTIONS: Sequence[type] = (WriteMesh, Deviate, InspectAll, CheckRig)
"""All of them."""
