"""What a studio knows: its folder, its workers, who holds the devices, and what was done."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from fringeworks.files.atomic import StrPath
from fringeworks.scan.setup_file import read_setup
from fringeworks.studio import tasks
from fringeworks.studio.script import (
    Command,
    board_command,
    calibrate_command,
    capture_command,
    export_command,
    set_up_command,
)
from fringeworks.studio.worker import Job, Worker
from fringeworks.studio.workspace import Workspace, open_workspace
from fringeworks.types import FileProblem, InputError

StepState = Literal["to do", "running", "good", "look here"]
VIRTUAL = "virtual"
"""The devices that need no hardware."""
USUAL_BOARD = "chessboard:11x8:12"
"""The board that is offered first."""
USUAL_FRAMES = 24
"""Frames of the plan that a set-up proposes: both axes, as a calibration needs them."""
SETUP_STEPS = 8
"""Steps that a set-up tells of."""
MOST_SURFACES = 40
"""Packed surfaces that are kept for the page; the oldest one is deleted for a new one."""


@dataclass
class Shown:
    """A surface on the page, and how it was made."""

    source: str
    """Name in the folder."""
    method: str
    options: dict[str, Any]
    number: int
    """Of the packed surface."""
    result: dict[str, Any] = field(default_factory=dict)
    """Figures and title, when the work is done."""

    @property
    def work(self) -> str:
        """Name of the work that computes it."""
        return f"measuring {self.source}"


@dataclass
class Session:
    """What one visitor looks at; all tabs of a browser are one visitor."""

    name: str
    step: str = "set up"
    shown: Shown | None = None
    kept: Shown | None = None
    """The result before, for comparison."""
    pending: Shown | None = None
    """What is being computed, and takes the place of ``shown`` when it is there."""
    tried: int | None = None
    """Number of the surface of the last trial."""

    def arrived(self, name: str, result: dict[str, Any]) -> None:
        """Take over a result that was computed; the one before is kept for comparison."""
        if self.pending is not None and name == self.pending.work:
            self.kept, self.shown = self.shown, replace(self.pending, result=result)
            self.pending = None


class Studio:
    """The state that all pages of a studio share.

    Parameters
    ----------
    folder : path
        Made where it is missing. Nothing outside of it is read or written, except a temporary
        folder for packed surfaces, which ``close`` deletes.
    """

    def __init__(self, folder: StrPath) -> None:
        self.workspace: Workspace = open_workspace(folder)
        self.devices = Worker()
        self.compute = Worker()
        self.projector = self.camera = VIRTUAL
        self.scene = "bust"
        """What the virtual camera looks at."""
        self.found: tuple[list[str], list[str]] = ([], [])
        """Words of the projectors and cameras that were found."""
        self.board = USUAL_BOARD
        self.done: list[Command] = []
        self.poses: dict[str, Any] = {}
        """What the last pose, or the judgement of all, said."""
        self._sessions: dict[str, Session] = {}
        self._told: tuple[int, list[str]] = (-1, [])
        """Findings of the set-up, and the time of its file: pages ask twice a second."""
        self._holder: str | None = None
        self._computing: str | None = None
        """The visitor whose computation is the present or last one."""
        self._numbers = itertools.count(1)
        self._packed = Path(tempfile.mkdtemp(prefix="fringeworks-studio-"))
        if self.workspace.setup.is_file():
            self._take_devices_of_setup()

    def _take_devices_of_setup(self) -> None:
        try:
            stored = read_setup(self.workspace.setup)
        except InputError:
            return
        self.projector, self.camera = stored.projector, stored.camera
        if stored.camera.startswith(f"{VIRTUAL}:"):
            self.camera, _, self.scene = stored.camera.partition(":")

    @property
    def words(self) -> tuple[str, str]:
        """Words that open projector and camera."""
        virtual = self.camera == VIRTUAL
        return self.projector, f"{VIRTUAL}:{self.scene}" if virtual else self.camera

    def session(self, name: str) -> Session:
        """The session of a visitor, which is begun with the first visit."""
        return self._sessions.setdefault(name, Session(name))

    def hold(self, session: Session) -> None:
        """Let a visitor use the devices.

        Raises
        ------
        InputError while another visitor uses them.
        """
        if self._holder not in (None, session.name) and self.devices.busy:
            raise InputError("devices: expected free ones, but another visitor is using them")
        self._holder = session.name

    def holds(self, session: Session) -> bool:
        """Whether the devices' work is this visitor's to cancel."""
        return self._holder in (None, session.name)

    def surface(self, number: int) -> Path:
        """The file of a packed surface."""
        return self._packed / f"{number}.bin"

    def step_states(self) -> dict[str, StepState]:
        """How far each step is."""
        space = self.workspace
        running = self.devices.job.name if self.devices.busy and self.devices.job else ""
        files = {
            "set up": space.setup.is_file(),
            "calibrate": space.rig.is_file(),
            "scan": space.has_captures(),
        }
        states: dict[str, StepState] = {
            step: "running" if running == step else "good" if there else "to do"
            for step, there in files.items()
        }
        last = self.devices.job
        if last is not None and last.state == "failed" and last.name in states:
            states[last.name] = "look here"
        elif states["set up"] == "good" and self.findings():
            states["set up"] = "look here"
        return states

    def findings(self) -> list[str]:
        """Findings of the set-up that lies in the folder."""
        path = self.workspace.setup
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        if self._told[0] != stamp:
            try:
                self._told = stamp, list(read_setup(path).findings)
            except InputError as problem:
                self._told = stamp, [str(problem)]
        return self._told[1]

    # What the buttons do. Each starts work, and notes the command that does the same.

    def look_for_devices(self, session: Session) -> Job:
        """Find the devices that are there."""
        self.hold(session)
        return self.devices.start("looking for devices", tasks.find_devices)

    def start_live(self, session: Session, level: float, exposure_ms: float | None) -> Job:
        """Show what the camera sees, until it is stopped."""
        self.hold(session)
        words = self.words
        return self.devices.start("live picture", tasks.live_picture, *words, level, exposure_ms)

    def run_setup(self, session: Session) -> Job:
        """Do a set-up."""
        self.hold(session)
        target = str(self.workspace.setup)
        words = self.words
        job = self.devices.start(
            "set up", tasks.run_setup, target, *words, USUAL_FRAMES, total=SETUP_STEPS
        )
        self._note(set_up_command(words, USUAL_FRAMES))
        return job

    def take_pose(self, session: Session) -> Job:
        """Take a pose of the board."""
        self._needs(self.workspace.setup, "a set-up; do the first step")
        self.hold(session)
        space, words = self.workspace, self.words
        frames = read_setup(space.setup).plan.frames
        job = self.devices.start(
            "calibrate",
            tasks.take_pose,
            str(space.setup),
            str(space.poses),
            self.board,
            words,
            total=frames + 1,
        )
        taken = space.taken_poses()
        names = (f"board/pose-{k:02d}" for k in range(1, len(taken) + 2))
        name = next(n for n in names if Path(n).name not in taken)
        self._note(capture_command(words, name))
        return job

    def print_board(self) -> Job:
        """Draw the board to print."""
        self._note(board_command(self.board))
        target = str(self.workspace.new("board", ".pdf"))
        return self.compute.start("drawing the board", tasks.draw_board, self.board, target)

    def judge_poses(self) -> Job:
        """Judge the poses that lie in the folder."""
        return self.devices.start(
            "judging the poses", tasks.judge, str(self.workspace.poses), self.board
        )

    def undo_pose(self, name: str) -> None:
        """Delete a pose.

        Raises
        ------
        InputError for a pose that is not there.
        """
        if name not in self.workspace.taken_poses():
            raise InputError(f"pose: expected one of those taken, got {name!r}")
        shutil.rmtree(self.workspace.inside(f"{self.workspace.poses.name}/{name}"))

    def calibrate(self) -> Job:
        """Calibrate with the poses in the folder."""
        poses = self.workspace.taken_poses()
        if not poses:
            raise InputError("calibration: expected poses of the board, got none")
        job = self.compute.start(
            "calibrating",
            tasks.run_calibration,
            str(self.workspace.poses),
            self.board,
            str(self.workspace.rig),
            total=len(poses) + 1,
        )
        self._note(calibrate_command(self.board))
        return job

    def scan(self, session: Session, name: str, *, exposures: int = 1, average: int = 1) -> Job:
        """Take the frames of an object into a folder of its own."""
        self._needs(self.workspace.setup, "a set-up; do the first step")
        target = self.workspace.new(name)
        self.hold(session)
        words = self.words
        frames = exposures * read_setup(self.workspace.setup).plan.frames
        job = self.devices.start(
            "scan",
            tasks.scan,
            str(self.workspace.setup),
            words,
            str(target),
            exposures,
            average,
            total=frames + 1,
        )
        self._note(capture_command(words, name, exposures=exposures, average=average))
        return job

    def look(self, session: Session, source: str, method: str, options: dict[str, Any]) -> Job:
        """Compute a surface, and show it; the one before is kept for comparison."""
        self._replace(session)
        pending = Shown(source, method, options, next(self._numbers))
        job = self.compute.start(
            pending.work,
            tasks.show,
            self._source(pending),
            str(self.surface(pending.number)),
            total=2,
        )
        session.pending = pending
        self.surface(pending.number - MOST_SURFACES).unlink(missing_ok=True)
        return job

    def learn(
        self, session: Session, body: str, method: str, settings: dict[str, Any]
    ) -> tuple[Job, int]:
        """Measure a simulated body, and show it with its true error."""
        self._replace(session)
        number = next(self._numbers)
        target = str(self.surface(number))
        job = self.compute.start(
            f"trying {method}", tasks.learn, body, method, settings, target, total=2
        )
        session.tried = number
        return job, number

    def export(self, shown: Shown, suffix: str, kind: str) -> Job:
        """Write what is shown into the folder."""
        name = f"{Path(shown.source).name}{suffix}"
        target = self.workspace.new(Path(shown.source).name, suffix)
        source = self._source(shown)
        job = self.compute.start(
            f"writing {name}", tasks.export, source, str(target), kind, total=2
        )
        made = shown.source, shown.method, shown.options
        self._note(export_command(*made, name, kind, pair=source.rig is None))
        return job

    def _source(self, shown: Shown) -> tasks.Source:
        """What a surface is computed from."""
        path = self.workspace.inside(shown.source)
        if not path.exists():
            raise FileProblem(
                f"{shown.source}: expected a capture or result in the folder, got none"
            )
        stack = path.is_dir() and tasks.is_stack(path)
        rig = self.workspace.rig if stack and self.workspace.rig.is_file() else None
        return tasks.Source(path, rig, shown.method, shown.options)

    def _replace(self, session: Session) -> None:
        """End a visitor's own computation, which a new one takes the place of."""
        if self.compute.busy and self._computing == session.name:
            self.compute.cancel()
        if not self.compute.busy:
            self._computing = session.name

    def close(self) -> None:
        """End the workers, and delete the packed surfaces."""
        self.devices.close()
        self.compute.close()
        shutil.rmtree(self._packed, ignore_errors=True)

    def _needs(self, path: Path, what: str) -> None:
        if not path.is_file():
            raise InputError(f"{path.name}: expected {what}")

    def _note(self, command: Command) -> None:
        if command not in self.done[-1:]:
            self.done.append(command)
