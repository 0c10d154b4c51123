"""What a click does: each action runs in a worker, and is written as a command and as Python.

An action runs the library with the same arguments as its Python does. Names are those of files in
the studio's folder.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from fringeworks.evaluate.inspect import inspect
from fringeworks.files.findings import findings_as_dicts
from fringeworks.files.points import write_merged_points
from fringeworks.files.read_write import write
from fringeworks.files.rig import read_rig, write_rig
from fringeworks.files.setup import write_setup
from fringeworks.pipeline.boards import calibrate_stacks
from fringeworks.pipeline.merging import merge
from fringeworks.pipeline.stacks import measure
from fringeworks.report.boards import write_board
from fringeworks.report.page.report import SUFFIXES as REPORTS
from fringeworks.report.page.report import write_report
from fringeworks.report.page.surfaces import surface_of
from fringeworks.report.summary import summarise
from fringeworks.scan.bench import Take, open_bench, take
from fringeworks.scan.setup import SetupStopped, set_up
from fringeworks.serving.worker import Link
from fringeworks.showcase.dissertation import write_paper
from fringeworks.studio.plots import DARK_FOLDER, draw
from fringeworks.studio.tasks import Source, compute, judged, known, poses_of
from fringeworks.studio.trash import Trash
from fringeworks.studio.workspace import Workspace
from fringeworks.types import TriangleMesh


class Command(NamedTuple):
    """Something that was done, as commands and as Python."""

    shell: str
    """Lines of a shell; empty where no command does it."""
    python: str
    """Lines after ``import fringeworks as fw``."""


class Action(Protocol):
    """What a click does."""

    def run(self, link: Link, space: Workspace) -> Any:
        """Do it; what the page shows of the result."""

    def command(self, result: Any) -> Command:
        """What does the same, once there is a result."""


def perform(link: Link, action: Action, space: Workspace) -> Any:
    """Run an action in a worker's process."""
    return action.run(link, space)


@dataclass(frozen=True)
class SetUp:
    """Find out what devices can do together."""

    projector: str
    camera: str
    frames: int

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Do a set-up; its picture is written even where it stops."""
        link.progress("opening the devices")
        picture = space.setup.with_suffix(".png")
        with open_bench(projector=self.projector, camera=self.camera) as bench:
            try:
                found = set_up(
                    bench.projector,
                    bench.camera,
                    frames=self.frames,
                    axes=("x", "y"),
                    progress=link.progress,
                )
            except SetupStopped as stopped:
                draw(stopped.tests, picture)
                raise
        kept = (space.setup.name, "setup.plan.toml", picture.name, f"{DARK_FOLDER}/{picture.name}")
        if space.setup.exists():
            Trash(space).before(kept, "set up again")
        draw(found, picture)
        write_setup(space.setup, found, projector=self.projector, camera=self.camera)
        return summarise(found)

    def command(self, _: Any) -> Command:
        """What does the same."""
        words = _arguments(projector=self.projector, camera=self.camera)
        return Command(
            f"fringeworks setup --projector {quoted(self.projector)} "
            f"--camera {quoted(self.camera)} --frames {self.frames} --axes x,y --out setup.toml",
            f"with fw.scan.open_bench({words}) as bench:\n"
            "    found = fw.set_up(\n"
            f"        bench.projector, bench.camera, frames={self.frames}, axes=('x', 'y')\n"
            "    )\n"
            "fw.save_figure(fw.report.setup_sheet(found), 'setup.png')\n"
            f"fw.files.write_setup('setup.toml', found, {words})",
        )


@dataclass(frozen=True)
class Scan:
    """Take the frames of an object."""

    name: str
    how: Take
    devices: dict[str, Any]
    """Words of the devices that are not those of the set-up, by "projector" and "camera"."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Take the frames into a folder of their own."""
        link.progress("opening the devices")
        with open_bench(space.setup, **self.devices) as bench:
            take(bench, space.root / self.name, self.how, progress=link.progress)
        return {"capture": self.name}

    def command(self, _: Any) -> Command:
        """What does the same."""
        options = _options(self.devices | self.how.changed)
        words = f", {_arguments(**self.devices)}" if self.devices else ""
        how = f", fw.scan.{self.how!r}" if self.how.changed else ""
        return Command(
            f"fringeworks capture --setup setup.toml {options}--out {quoted(self.name)}",
            f"with fw.scan.open_bench('setup.toml'{words}) as bench:\n"
            f"    fw.scan.take(bench, {self.name!r}{how})",
        )


@dataclass(frozen=True)
class TakePose:
    """Take a pose of a board, and judge all poses."""

    board: str
    devices: dict[str, Any]
    """As for ``Scan``."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Take the next pose."""
        poses = poses_of(space, self.board)
        link.progress("opening the devices")
        with open_bench(space.setup, **self.devices) as bench:
            taken = poses.take(bench, progress=link.progress)
        found = {"name": taken.name, "corners": taken.corners, "problem": taken.problem}
        return found | {"few": "; ".join(taken.few)} | judged(poses)

    def command(self, result: Any) -> Command:
        """What does the same: its frames are those of any other capture."""
        return Scan(f"board/{result['name']}", Take(), self.devices).command(None)


@dataclass(frozen=True)
class DrawBoard:
    """Draw a board to print."""

    board: str

    def run(self, link: Link, space: Workspace) -> str:
        """Write the board; the name of its file."""
        link.progress("drawing")
        write_board(space.root / "board.pdf", self.board)
        return "board.pdf"

    def command(self, _: Any) -> Command:
        """What does the same."""
        return Command(
            f"fringeworks board {quoted(self.board)} --out board.pdf",
            f"fw.report.write_board('board.pdf', {self.board!r})",
        )


@dataclass(frozen=True)
class Calibrate:
    """Calibrate a rig with the poses of a board."""

    board: str

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Write the rig and its picture."""
        found = calibrate_stacks(space.poses, self.board, progress=link.progress)
        if space.rig.exists():
            kept = (space.rig.name, "rig.png", f"{DARK_FOLDER}/rig.png")
            Trash(space).before(kept, "calibrate again")
        write_rig(space.rig, found.rig)
        draw(found, space.rig.with_suffix(".png"), "board")
        return summarise(found)

    def command(self, _: Any) -> Command:
        """What does the same."""
        return Command(
            f"fringeworks calibrate board/ --board {quoted(self.board)} --out rig.toml "
            "--figure rig.png",
            f"found = fw.calibrate('board', {self.board!r})\n"
            "fw.files.write_rig('rig.toml', found.rig)\n"
            "fw.save_figure(found.plot('board'), 'rig.png')",
        )


@dataclass(frozen=True)
class MergeViews:
    """Measure and merge the views of a part on a turntable."""

    captures: tuple[str, ...]
    board: str
    """Empty where poses come from the shape."""
    step_deg: float
    name: str
    beside: bool = False
    """Whether the board moves with the part in any way, and no table turns both by equal steps."""

    @property
    def poses(self) -> dict[str, Any]:
        """Where the poses come from, as ``merge`` takes it."""
        if self.board and self.beside:
            return {"poses": "board", "board": self.board}
        if not self.board:
            return {"poses": "shape"}
        return {"poses": "turntable", "board": self.board, "step_deg": self.step_deg}

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Write the points of all views."""
        rig, views = read_rig(space.rig), []
        for name in self.captures:
            link.progress(f"measuring {name}")
            views.append(measure(space.root / name, rig).points)
        removed: dict[str, Any] = {"rig": rig} if self.board else {}
        found = merge(views, **self.poses, **removed, progress=link.progress)
        write_merged_points(
            space.root / f"{self.name}.ply", found.points, provenance=found.provenance
        )
        return {
            "file": f"{self.name}.ply",
            "views": len(views),
            "points": len(found.points.xyz_mm),
            "findings": findings_as_dicts(found.findings),
        }

    def command(self, _: Any) -> Command:
        """What does the same."""
        rig = {"rig": "rig.toml"} if self.board else {}
        clouds = [f"{quoted(name)}.npz" for name in self.captures]
        measured = [
            f"fringeworks measure {quoted(name)} --rig rig.toml --out {cloud}"
            for name, cloud in zip(self.captures, clouds, strict=True)
        ]
        merged = f"fringeworks merge {' '.join(clouds)} {_options(self.poses | rig)}"
        return Command(
            "\n".join([*measured, f"{merged}--out {quoted(self.name)}.ply"]),
            f"views = [fw.measure(name, 'rig.toml').points for name in {list(self.captures)!r}]\n"
            f"found = fw.merge(views, {_arguments(**self.poses, **rig)})\n"
            f"fw.files.write_merged_points({f'{self.name}.ply'!r}, found.points, "
            "provenance=found.provenance)",
        )


@dataclass(frozen=True)
class Inspect:
    """Judge a part by the recipe in the folder."""

    source: Source

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Measure the part, and judge its tolerances."""
        link.progress("measuring the part")
        found = inspect(known(self.source), space.recipe)
        return summarise(found) | {"source": self.source.path.name}

    def command(self, _: Any) -> Command:
        """What does the same."""
        name = quoted(self.source.name)
        return Command(
            f"fringeworks inspect {name} --recipe recipe.toml" if self.source.is_capture else "",
            f"print({self.source.inspected}.verdict)",
        )


@dataclass(frozen=True)
class Export:
    """Write a result, or a report of it."""

    source: Source
    name: str
    """Of the file; its suffix says the format."""
    kind: str
    """Content of a ``.ply`` file."""

    @property
    def _is_report(self) -> bool:
        return self.name.endswith(tuple(REPORTS))

    @property
    def _kind(self) -> dict[str, Any]:
        return {"kind": "mesh"} if self.kind == "mesh" else {}

    def run(self, link: Link, space: Workspace) -> str:
        """Write the file; its name."""
        result = compute(link, self.source)
        link.progress("writing")
        target = space.root / self.name
        if self._is_report:
            write_report(target, {self.source.path.name: result}, rig=self.source.rig)
        else:
            part = result if isinstance(result, TriangleMesh) else surface_of(result)
            write(target, part, **self._kind)
        return self.name

    def command(self, _: Any) -> Command:
        """What does the same."""
        if self._is_report:
            rig = "" if self.source.rig is None else ", rig='rig.toml'"
            shown = f"{{{self.source.path.name!r}: {self.source.python[0]}}}"
            return Command(
                self.source.shell("--report", quoted(self.name)),
                f"fw.write_report({self.name!r}, {shown}{rig})",
            )
        mesh = " --ply mesh" if self._kind else ""
        more = f", {_arguments(**self._kind)}" if self._kind else ""
        return Command(
            self.source.shell("--out", f"{quoted(self.name)}{mesh}"),
            f"fw.write({self.name!r}, {''.join(self.source.python)}{more})",
        )


@dataclass(frozen=True)
class DrawFigures:
    """Make the figures of the dissertation's chapter 4."""

    size: int

    def run(self, link: Link, space: Workspace) -> list[str]:
        """Write the figures; the names of their files."""
        written = write_paper(space.figures_folder, size=self.size, progress=link.progress)
        return [path.name for path in written]

    def command(self, _: Any) -> Command:
        """What does the same."""
        return Command(
            f"fringeworks paper --size {self.size} --out dissertation",
            f"fw.write_paper('dissertation', size={self.size})",
        )


def _arguments(**values: Any) -> str:
    """Arguments of a call in Python."""
    return ", ".join(f"{name}={value!r}" for name, value in values.items())


def _options(values: dict[str, Any]) -> str:
    """Options of a command, a space after each; they have the names of the library's arguments."""
    return "".join(
        f"--{name.replace('_', '-')} " + ("" if value is True else f"{quoted(str(value))} ")
        for name, value in values.items()
    )


def quoted(text: str) -> str:
    """A word for a shell."""
    return shlex.quote(text)
