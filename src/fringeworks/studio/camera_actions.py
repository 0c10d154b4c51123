"""What a click does with several cameras: their calibration, and parts that all of them saw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fringeworks.files.multi_rig import write_multi_rig
from fringeworks.files.points import write_merged_points
from fringeworks.pipeline.cameras import measure_cameras
from fringeworks.pipeline.verbs import calibrate
from fringeworks.report.summary import summarise
from fringeworks.serving.worker import Link
from fringeworks.studio.actions import Command, quoted
from fringeworks.studio.trash import Trash
from fringeworks.studio.workspace import Workspace


@dataclass(frozen=True)
class CalibrateCameras:
    """Calibrate several cameras by the poses of a board that all of them saw."""

    folders: tuple[str, ...]
    """A folder of poses for each camera; poses with one name are the same."""
    board: str

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Write the rig of the cameras."""
        folders = [space.inside(name) for name in self.folders]
        found = calibrate(folders, self.board, progress=link.progress)
        if space.cameras.exists():
            Trash(space).before((space.cameras.name,), "calibrate the cameras again")
        write_multi_rig(space.cameras, found.rig)
        return summarise(found)

    def command(self, _: Any) -> Command:
        """What does the same."""
        folders = " ".join(map(quoted, self.folders))
        return Command(
            f"fringeworks calibrate {folders} --board {quoted(self.board)} --out cameras.toml",
            f"found = fw.calibrate({list(self.folders)!r}, {self.board!r})\n"
            "fw.files.write_multi_rig('cameras.toml', found.rig)",
        )


@dataclass(frozen=True)
class MeasureCameras:
    """Measure a part that several cameras saw under the same patterns."""

    captures: tuple[str, ...]
    """One for each camera, in the order of the rig."""
    name: str

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Write the points of all cameras."""
        link.progress("decoding and measuring")
        found = measure_cameras([space.inside(name) for name in self.captures], space.cameras)
        file = f"{self.name}.ply"
        link.progress("writing")
        write_merged_points(space.root / file, found.points, provenance=found.points.provenance)
        return summarise(found) | {"file": file}

    def command(self, _: Any) -> Command:
        """What does the same."""
        captures = " ".join(map(quoted, self.captures))
        file = f"{self.name}.ply"
        return Command(
            f"fringeworks measure {captures} --rig cameras.toml --out {quoted(file)}",
            f"found = fw.measure({list(self.captures)!r}, 'cameras.toml')\n"
            f"fw.files.write_merged_points({file!r}, found.points, "
            "provenance=found.points.provenance)",
        )
