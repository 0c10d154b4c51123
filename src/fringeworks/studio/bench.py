"""The devices of a studio: who uses them, and what is done with them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import StrPath
from fringeworks.files.setup import StoredSetup, read_setup
from fringeworks.scan.aiming import Shown as Light
from fringeworks.scan.bench import Take
from fringeworks.studio import live, tasks
from fringeworks.studio.actions import Action, CommandLog, Scan, SetUp, TakePose, perform
from fringeworks.studio.series import Series
from fringeworks.studio.session import Session
from fringeworks.studio.worker import Job, Task, Worker
from fringeworks.studio.workspace import Words, Workspace, checked_words, open_workspace
from fringeworks.types import Finding, InputError

VIRTUAL = "virtual"
"""The devices that need no hardware."""
USUAL_BOARD = "chessboard:11x8:12"
"""The board that is offered first."""
USUAL_FRAMES = 24
"""Frames of the plan that a set-up proposes: both axes, as a calibration needs them."""
SETUP_STEPS = 8
"""Steps that a set-up tells of."""
LIVE_PICTURE, LIVE_POINTS = "live picture", "live points"
"""Names of endless work."""


class Bench:
    """The devices that all visitors of a studio share; one of them uses them at a time."""

    projector = Words()
    camera = Words()
    scene = Words()
    """What the virtual camera looks at."""
    board = Words()

    def __init__(self, folder: StrPath) -> None:
        self.workspace: Workspace = open_workspace(folder)
        self.log = CommandLog(self.workspace)
        self.devices = Worker()
        self.projector = self.camera = VIRTUAL
        self.scene = "bust"
        self.found: tuple[list[str], list[str]] = ([], [])
        """Words of the projectors and cameras that were found."""
        self.board = USUAL_BOARD
        self.series: Series | None = None
        """The series of scans that runs, or the last one."""
        self.poses: dict[str, Any] = {}
        """What the last pose, or the judgement of all, said."""
        self._told: tuple[int, tuple[Finding, ...]] = (-1, ())
        """Findings of the set-up with the time of its file, because pages poll twice a second."""
        self._holder: str | None = None
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

    def findings(self) -> tuple[Finding, ...]:
        """Findings of the set-up that lies in the folder."""
        path = self.workspace.setup
        if path.is_symlink():
            return (
                Finding("set-up", f"{path.name}: expected a file, got a link", severity="error"),
            )
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        if self._told[0] != stamp:
            try:
                self._told = stamp, read_setup(path).findings
            except InputError as problem:
                self._told = stamp, (Finding("set-up", str(problem), severity="error"),)
        return self._told[1]

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
        poses = (self.workspace, self.board) if board else None
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
        return self._act(session, "set up", SetUp(*self.words, USUAL_FRAMES), SETUP_STEPS)

    def take_pose(self, session: Session) -> Job:
        """Take a pose of the board."""
        stored = self._setup()
        action = TakePose(self.board, self._others(stored))
        return self._act(session, "calibrate", action, stored.plan.frames + 1)

    def judge_poses(self, session: Session) -> Job:
        """Judge the poses that lie in the folder."""
        given = self.workspace, self.board
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

    def scan(self, session: Session, name: str, how: Take | None = None) -> Job:
        """Take the frames of an object into a folder of its own."""
        how = how or Take()
        self._free(name, how)
        stored = self._setup()
        action = Scan(name, how, self._others(stored))
        return self._act(session, "scan", action, how.hdr * stored.plan.frames + 1)

    def start_series(
        self, session: Session, names: list[str], pause_s: float, how: Take | None = None
    ) -> Series:
        """Take scans one after the other, with a pause before each."""
        if self.series is not None and self.series.running:
            raise InputError("A scan is running or waiting already: wait, or stop it.")
        for name in names:
            self._free(name, how or Take())
        self.hold(session)
        self.series = Series(names, pause_s, lambda name: self.scan(session, name, how))
        self.series.start()
        return self.series

    def stop_series(self, session: Session) -> None:
        """Take no further scan of a series, and end the one that runs."""
        self.hold(session)
        if self.series is not None and self.series.running:
            self.series.stop()
            if self.devices.job is not None and self.devices.job.name == "scan":
                self.devices.cancel()

    def _act(self, session: Session, name: str, action: Action, total: int) -> Job:
        """Begin an action that uses the devices."""
        job = self._use_devices(session, name, perform, action, self.workspace, total=total)
        return self.log.note(job, action)

    def _use_devices(
        self, session: Session, name: str, task: Task, *given: Any, total: int = 0
    ) -> Job:
        """Begin work with the devices; a visitor's own live picture ends for it."""
        self.hold(session)
        self.workspace.check()
        lively = self._is_live()
        self._end_live()
        return self.devices.start(name, task, *given, total=total, wait=lively)

    def _free(self, name: str, how: Take) -> None:
        """Refuse a scan whose name the folder has, unless an interrupted one is resumed."""
        if self.workspace.new(name).exists() and not how.resume:
            raise InputError(f"The folder has {name!r} already: choose another name.")

    def _setup(self) -> StoredSetup:
        """The set-up in the folder."""
        self._needs(self.workspace.setup, "do Set up first")
        return read_setup(self.workspace.setup)

    def _others(self, stored: StoredSetup) -> dict[str, Any]:
        """Words of the chosen devices that are not those of the set-up."""
        projector, camera = self.words
        known = {"projector": stored.projector, "camera": stored.camera}
        chosen = {"projector": projector, "camera": camera}
        return {role: words for role, words in chosen.items() if words != known[role]}

    def _needs(self, path: Path, what: str) -> None:
        if not path.is_file():
            raise InputError(f"There is no {path.name}: {what}.")
