"""What a studio knows: its folder, its workers, who holds the devices, and what was done."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from collections import deque
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from fringeworks.files.atomic import StrPath
from fringeworks.scan.aiming import Shown as Light
from fringeworks.scan.setup_file import read_setup
from fringeworks.studio import learning, live, tasks
from fringeworks.studio.command_log import CommandLog
from fringeworks.studio.device_words import Words, checked_words
from fringeworks.studio.recipes import RecipeKeeper, as_shown
from fringeworks.studio.script import (
    Command,
    Measured,
    board_command,
    calibrate_command,
    capture_command,
    export_command,
    inspect_command,
    paper_command,
    set_up_command,
)
from fringeworks.studio.series import Series
from fringeworks.studio.worker import Job, Task, Worker
from fringeworks.studio.workspace import Workspace, open_workspace
from fringeworks.types import FileProblem, InputError

StepState = Literal["to do", "running", "good", "look here"]
VIRTUAL = "virtual"
"""The devices that need no hardware."""
USUAL_BOARD = "chessboard:11x8:12"
"""The board that is offered first."""
USUAL_FRAMES = 24
"""Frames of the plan that a set-up proposes: both axes, as a calibration needs them."""
FIGURES = 40
"""Files that the dissertation's chapter has."""
SETUP_STEPS = 8
"""Steps that a set-up tells of."""
LIVE_PICTURE, LIVE_POINTS = "live picture", "live points"
"""Names of endless work."""
MOST_OPEN = 4
"""Computations of one visitor that may wait or run."""
KEPT_JOBS = 8
"""Computations of a visitor whose state is kept."""
MOST_SESSIONS = 200
"""Visitors without an open page whose state is kept."""
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
    trial: dict[str, Any] | None = None
    """Figures of the last trial."""
    verdict: dict[str, Any] | None = None
    """The last verdict on a part, and which part it was."""
    picture: int = 0
    """Number of the picture that areas are drawn on."""
    tabs: int = 0
    """Number of pages that are open."""
    tried: int | None = None
    """Number of the surface of the last trial."""
    jobs: deque[Job] = field(default_factory=lambda: deque(maxlen=KEPT_JOBS))
    """Their last computations."""

    def job(self, names: tuple[str, ...]) -> Job | None:
        """The last computation whose name begins with one of these."""
        return next((job for job in reversed(self.jobs) if job.name.startswith(names)), None)

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

    projector = Words()
    camera = Words()
    scene = Words()
    """What the virtual camera looks at."""
    board = Words()

    def __init__(self, folder: StrPath) -> None:
        self.workspace: Workspace = open_workspace(folder)
        self.devices = Worker()
        self.compute = Worker()
        self.projector = self.camera = VIRTUAL
        self.scene = "bust"
        self.found: tuple[list[str], list[str]] = ([], [])
        """Words of the projectors and cameras that were found."""
        self.board = USUAL_BOARD
        self.series: Series | None = None
        """The series of scans that runs, or the last one."""
        self.recipes = RecipeKeeper(self.workspace)
        self.log = CommandLog(self.workspace)
        self.verdict: dict[str, Any] = {}
        """What the last calibration said."""
        self.poses: dict[str, Any] = {}
        """What the last pose, or the judgement of all, said."""
        self._sessions: dict[str, Session] = {}
        self._told: tuple[int, list[str]] = (-1, [])
        """Findings of the set-up with the time of its file, because pages poll twice a second."""
        self._holder: str | None = None
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
        """Words that open projector and camera.

        Raises
        ------
        InputError for devices that would read outside of the folder.
        """
        camera = f"{VIRTUAL}:{self.scene}" if self.camera == VIRTUAL else self.camera
        return checked_words(self.projector, self.workspace), checked_words(camera, self.workspace)

    def session(self, name: str) -> Session:
        """The session of a visitor, which is begun with the first visit."""
        if name not in self._sessions:
            gone = [key for key, one in self._sessions.items() if not one.tabs]
            for key in gone[: max(0, len(self._sessions) - MOST_SESSIONS)]:
                del self._sessions[key]
        return self._sessions.setdefault(name, Session(name))

    def left(self, session: Session) -> None:
        """A tab was closed; with the last one, the visitor's live picture ends."""
        session.tabs -= 1
        if session.tabs <= 0 and self._holder == session.name:
            self._end_live()
            self._holder = None

    def hold(self, session: Session) -> None:
        """Let a visitor use the devices.

        Raises
        ------
        InputError while another visitor uses them.
        """
        waits = self.series is not None and self.series.running
        if self._holder not in (None, session.name) and (self.devices.busy or waits):
            raise InputError("The devices are in use: another visitor is using them.")
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
        if path.is_symlink():
            return [f"{path.name}: expected a file, got a link"]
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
        return self._use_devices(session, "looking for devices", tasks.find_devices)

    def start_live(
        self,
        session: Session,
        shown: Light,
        level: float,
        exposure_ms: float | None,
        *,
        board: bool = False,
    ) -> Job:
        """Show what the camera sees until it is stopped; where asked for, find the board in it."""
        poses = (str(self.workspace.poses), self.board) if board else None
        given = self.words, shown, level, exposure_ms, poses
        return self._use_devices(session, LIVE_PICTURE, live.live_picture, *given)

    def find_exposure(self, session: Session) -> Job:
        """Find the exposure that suits the scene."""
        return self._use_devices(
            session, "looking for the exposure", live.find_exposure, self.words
        )

    def start_points(self, session: Session) -> Job:
        """Measure points again and again until it is stopped."""
        self._needs(self.workspace.setup, "do Set up first")
        self._needs(self.workspace.rig, "calibrate first")
        files = str(self.workspace.setup), str(self.workspace.rig)
        return self._use_devices(session, LIVE_POINTS, live.live_points, self.words, *files)

    def stop_live(self, session: Session) -> None:
        """End the live picture or the live points.

        Raises
        ------
        InputError while another visitor uses the devices.
        """
        self.hold(session)
        self._end_live()

    def _end_live(self) -> None:
        if self._is_live():
            self.devices.stop()

    def _is_live(self) -> bool:
        job = self.devices.job
        return job is not None and job.open and job.name in (LIVE_PICTURE, LIVE_POINTS)

    def run_setup(self, session: Session) -> Job:
        """Do a set-up."""
        target = str(self.workspace.setup)
        words = self.words
        job = self._use_devices(
            session, "set up", tasks.run_setup, target, *words, USUAL_FRAMES, total=SETUP_STEPS
        )
        return self.log.note(job, lambda _: set_up_command(words, USUAL_FRAMES))

    def take_pose(self, session: Session) -> Job:
        """Take a pose of the board."""
        self._needs(self.workspace.setup, "do Set up first")
        space, words = self.workspace, self.words
        frames = read_setup(space.setup).plan.frames
        job = self._use_devices(
            session,
            "calibrate",
            tasks.take_pose,
            str(space.setup),
            str(space.poses),
            self.board,
            words,
            total=frames + 1,
        )
        folder = space.poses.name

        def command(job: Job) -> Command:
            name = f"{folder}/{job.result['name']}"
            return replace(capture_command(words, name), replaces=name)

        return self.log.note(job, command)

    def print_board(self, session: Session) -> Job:
        """Draw the board to print."""
        board, target = self.board, str(self.workspace.new("board", ".pdf"))
        job = self._compute(session, "drawing the board", tasks.draw_board, board, target)
        return self.log.note(job, lambda _: board_command(board))

    def judge_poses(self, session: Session) -> Job:
        """Judge the poses that lie in the folder."""
        given = str(self.workspace.poses), self.board
        return self._use_devices(session, "judging the poses", tasks.judge, *given)

    def undo_pose(self, name: str) -> None:
        """Delete a pose.

        Raises
        ------
        InputError for a pose that is not there.
        """
        self.workspace.check()
        if name not in self.workspace.taken_poses():
            raise InputError(f"pose: expected one of those taken, got {name!r}")
        shutil.rmtree(self.workspace.poses / name)

    def calibrate(self, session: Session) -> Job:
        """Calibrate with the poses in the folder."""
        poses = self.workspace.taken_poses()
        if not poses:
            raise InputError("No pose of the board was taken: take poses first.")
        job = self._compute(
            session,
            "calibrating",
            tasks.run_calibration,
            str(self.workspace.poses),
            self.board,
            str(self.workspace.rig),
            total=len(poses) + 1,
        )
        board = self.board
        return self.log.note(job, lambda _: calibrate_command(board))

    def scan(self, session: Session, name: str, *, exposures: int = 1, average: int = 1) -> Job:
        """Take the frames of an object into a folder of its own."""
        self._needs(self.workspace.setup, "do Set up first")
        target = self.workspace.new(name)
        if target.exists():
            raise InputError(f"The folder has {name!r} already: choose another name.")
        words = self.words
        frames = exposures * read_setup(self.workspace.setup).plan.frames
        job = self._use_devices(
            session,
            "scan",
            tasks.scan,
            str(self.workspace.setup),
            words,
            str(target),
            exposures,
            average,
            total=frames + 1,
        )
        made = capture_command(words, name, exposures=exposures, average=average)
        return self.log.note(job, lambda _: made)

    def start_series(
        self,
        session: Session,
        names: list[str],
        pause_s: float,
        *,
        exposures: int = 1,
        average: int = 1,
    ) -> Series:
        """Take scans one after the other, with a pause before each."""
        if self.series is not None and self.series.running:
            raise InputError("A scan is running or waiting already: wait, or stop it.")
        for name in names:
            if self.workspace.new(name).exists():
                raise InputError(f"The folder has {name!r} already: choose another name.")
        self.hold(session)

        def begin(name: str) -> Job:
            return self.scan(session, name, exposures=exposures, average=average)

        self.series = Series(names, pause_s, begin)
        self.series.start()
        return self.series

    def stop_series(self, session: Session) -> None:
        """Take no further scan of a series, and end the one that runs."""
        self.hold(session)
        if self.series is not None and self.series.running:
            self.series.stop()
            if self.devices.job is not None and self.devices.job.name == "scan":
                self.devices.cancel()

    def look(self, session: Session, source: str, method: str, options: dict[str, Any]) -> Job:
        """Compute a surface, and show it; the one before is kept for comparison."""
        self._replace(session)
        pending = Shown(source, method, options, next(self._numbers))
        job = self._compute(
            session,
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
        self,
        session: Session,
        experiment: learning.Experiment,
        body: str,
        method: str,
        settings: dict[str, Any],
    ) -> tuple[Job, int]:
        """Measure a simulated body, and show it with its true error."""
        self._replace(session)
        number = next(self._numbers)
        target = str(self.surface(number))
        given = experiment, body, method, settings, target
        job = self._compute(session, f"trying {method}", learning.learn, *given, total=2)
        session.tried = number
        return job, number

    def draw_figures(self, session: Session, size: int) -> Job:
        """Make the figures of the dissertation's chapter 4 in the folder."""
        target = str(self.workspace.figures_folder)
        name = "the dissertation's figures"
        job = self._compute(session, name, learning.draw_figures, target, size, total=FIGURES)
        return self.log.note(job, lambda _: paper_command(size))

    def figure_address(self, name: str) -> str:
        """Where the page finds a figure; it changes with its file."""
        path = self.workspace.figures_folder / name
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        return f"/file/{self.workspace.figures_folder.name}/{name}?{stamp}"

    # Parts are judged by the recipe in the folder.

    def inspect(self, session: Session, name: str) -> Job:
        """Judge a part by the tolerances."""
        shown = session.shown
        if shown is None or shown.source != name:
            shown = Shown(name, "windowed", {}, 0)
        source = self._source(shown)
        recipe = self.recipes.read()
        if not recipe.tolerances:
            raise InputError("No tolerance is set: add one, then judge the part.")
        self.recipes.keep(as_shown(recipe, source))
        job = self._compute(
            session, f"judging {name}", tasks.judge_part, source, str(self.workspace.recipe)
        )
        return self.log.note(job, lambda _: inspect_command(name)) if source.path.is_dir() else job

    def draw_picture(self, session: Session, name: str) -> Job:
        """Draw the picture of a capture or result, to draw areas on."""
        session.picture = next(self._numbers)
        source = self._source(Shown(name, "windowed", {}, 0))
        target = str(self.surface(session.picture))
        return self._compute(session, "drawing the picture", tasks.draw_picture, source, target)

    def picture_number(self, session: Session) -> int:
        """Number of the picture that was drawn last."""
        return session.picture

    def export(self, session: Session, shown: Shown, suffix: str, kind: str) -> Job:
        """Write what is shown into the folder."""
        name = f"{Path(shown.source).name}{suffix}"
        target = self.workspace.new(Path(shown.source).name, suffix)
        source = self._source(shown)
        job = self._compute(
            session, f"writing {name}", tasks.export, source, str(target), kind, total=2
        )
        made = shown.source, shown.method, shown.options
        how: Measured = "pair" if source.rig is None else "stack"
        if not source.path.is_dir():
            how = "result"
        elif source.recipe is not None:
            how = "recipe"
        command = export_command(*made, name, kind, how=how)
        return self.log.note(job, lambda _: command)

    def _source(self, shown: Shown) -> tasks.Source:
        """What a surface is computed from."""
        path = self.workspace.inside(shown.source)
        if not path.exists():
            raise FileProblem(
                f"{shown.source}: expected a capture or result in the folder, got none"
            )
        stack = path.is_dir() and tasks.is_stack(path)
        rig = self.workspace.rig if stack and self.workspace.rig.is_file() else None
        source = tasks.Source(path, rig, shown.method, shown.options)
        recipe = self.recipes.shown
        if recipe.within is None:
            return source
        self.recipes.keep(as_shown(recipe, source))
        return replace(source, recipe=self.workspace.recipe)

    def _use_devices(
        self, session: Session, name: str, task: Task, *given: Any, total: int = 0
    ) -> Job:
        """Begin work with the devices; a visitor's own live picture ends for it."""
        self.hold(session)
        self.workspace.check()
        lively = self._is_live()
        self._end_live()
        return self.devices.start(name, task, *given, total=total, wait=lively)

    def _compute(self, session: Session, name: str, task: Task, *given: Any, total: int = 0) -> Job:
        """Begin a computation, after those of others."""
        self.workspace.check()
        if len([job for job in session.jobs if job.open]) >= MOST_OPEN:
            raise InputError("expected fewer computations at a time: wait for the ones that run")
        job = self.compute.start(name, task, *given, total=total, wait=True)
        session.jobs.append(job)
        return job

    def _replace(self, session: Session) -> None:
        """End a visitor's own look or trial, which a new one takes the place of."""
        for job in session.jobs:
            if job.name.startswith(("measuring", "trying")):
                self.compute.cancel(job)

    def close(self) -> None:
        """End the workers, and delete the packed surfaces."""
        if self.series is not None:
            self.series.stop()
        self.devices.close()
        self.compute.close()
        shutil.rmtree(self._packed, ignore_errors=True)

    def _needs(self, path: Path, what: str) -> None:
        if not path.is_file():
            raise InputError(f"There is no {path.name}: {what}.")
