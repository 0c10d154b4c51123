"""The devices of a studio: who uses them, and what is done with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from fringeworks.devices.bench import POSES
from fringeworks.files.atomic import StrPath
from fringeworks.files.setup import StoredSetup, read_setup
from fringeworks.scan.aiming import Shown as Light
from fringeworks.scan.bench import Take
from fringeworks.serving.worker import Job, Task, Worker
from fringeworks.studio import live, tasks
from fringeworks.studio.actions import Action, Scan, SetUp, TakePose, perform
from fringeworks.studio.log import CommandLog
from fringeworks.studio.notes import Notes
from fringeworks.studio.part_actions import CheckRig
from fringeworks.studio.phone import PhoneHub
from fringeworks.studio.series import Series
from fringeworks.studio.session import Session
from fringeworks.studio.trash import Trash
from fringeworks.studio.workspace import Words, Workspace, checked_words, open_workspace
from fringeworks.types import Finding, InputError

VIRTUAL = "virtual"
"""The devices that need no hardware."""
BY_ITSELF = "by itself"
"""Virtual scene that moves by itself: a plane to set up, a board in a new pose each time to
calibrate, a bust to scan, on a turntable where one turns."""
Purpose = Literal["set up", "calibrate", "scan"]
"""What the devices are used for, which decides what a virtual scene that moves by itself shows."""
USUAL_BOARD = "chessboard:11x8:12"
"""The board that is offered first."""
USUAL_FRAMES = 24
"""Frames of the plan that a set-up proposes: both axes, as a calibration needs them."""
CHECK = "rig-check"
"""Name of the captures by which a rig is checked."""
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
        self.trash = Trash(self.workspace)
        self.trash.purge()
        self.log = CommandLog(self.workspace)
        self.notes = Notes(self.workspace)
        self.devices = Worker()
        self.phone = PhoneHub(self.workspace.root)
        self.projector = self.camera = VIRTUAL
        self.scene = BY_ITSELF
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
            self.camera = VIRTUAL

    @property
    def words(self) -> tuple[str, str]:
        """Words that open projector and camera for a scan; see ``words_for``."""
        return self.words_for()

    def words_for(
        self, purpose: Purpose = "scan", turned_deg: float | None = None
    ) -> tuple[str, str]:
        """Words that open projector and camera.

        Parameters
        ----------
        purpose : "set up", "calibrate" or "scan"
            What a virtual scene that moves by itself shows.
        turned_deg : float, optional
            Angle of its turntable, degrees; None for none.

        Raises
        ------
        InputError for devices that would read outside of the folder.
        """
        camera = self.camera
        if camera == VIRTUAL:
            by_itself = self.scene == BY_ITSELF
            scene = self._moved(purpose, turned_deg) if by_itself else self.scene
            camera = f"{VIRTUAL}:{scene}"
        return checked_words(self.projector, self.workspace), checked_words(camera, self.workspace)

    def _moved(self, purpose: Purpose, turned_deg: float | None) -> str:
        """What a virtual scene that moves by itself shows."""
        if purpose == "calibrate":
            taken = self.workspace.taken_poses()
            free = next(k for k in range(len(taken) + 1) if f"pose-{k + 1:02d}" not in taken)
            return f"board-{free % POSES}"
        if purpose == "set up":
            return "plane"
        return "bust" if turned_deg is None else f"turntable-{turned_deg:g}"

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
        words = self.words_for("calibrate" if board else "set up")
        given = words, shown, level, exposure_ms, poses
        return self._use_devices(session, LIVE_PICTURE, live.live_picture, *given)

    def find_exposure(self, session: Session) -> Job:
        """Find the exposure that suits the scene."""
        return self._use_devices(
            session, "looking for the exposure", live.find_exposure, self.words_for("set up")
        )

    def start_points(self, session: Session) -> Job:
        """Measure points again and again until it is stopped."""
        self._needs(self.workspace.setup, "do Set up first")
        self._needs(self.workspace.rig, "calibrate first")
        files = str(self.workspace.setup), str(self.workspace.rig)
        return self._use_devices(session, LIVE_POINTS, live.live_points, self.words_for(), *files)

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
        action = SetUp(*self.words_for("set up"), USUAL_FRAMES)
        return self._act(session, "set up", action, SETUP_STEPS)

    def take_pose(self, session: Session) -> Job:
        """Take a pose of the board."""
        stored = self._setup()
        action = TakePose(self.board, self._others(stored, self.words_for("calibrate")))
        return self._act(session, "calibrate", action, stored.plan.pictures + 1)

    def judge_poses(self, session: Session) -> Job:
        """Judge the poses that lie in the folder."""
        given = self.workspace, self.board
        return self._use_devices(session, "judging the poses", tasks.judge, *given)

    def check_rig(self, session: Session) -> Job:
        """Take a pose of the board, and check by it whether the rig still holds."""
        stored = self._setup()
        self._needs(self.workspace.rig, "calibrate first")
        name = self.workspace.free(CHECK, "")
        action = CheckRig(name, self.board, self._others(stored, self.words_for("calibrate")))
        return self._act(session, "checking the rig", action, stored.plan.pictures + 2)

    def calibrated_with_all(self) -> bool:
        """Whether the rig is younger than every pose: no further ones are asked for then."""
        rig, poses = self.workspace.rig, self.workspace.taken_poses()
        if not rig.is_file() or not poses:
            return False
        stamps = [(self.workspace.poses / name).stat().st_mtime_ns for name in poses]
        return rig.stat().st_mtime_ns > max(stamps)

    def undo_pose(self, name: str) -> None:
        """Move a pose to the trash.

        Raises
        ------
        InputError for a pose that is not there.
        """
        self.workspace.check()
        if name not in self.workspace.taken_poses():
            raise InputError(f"pose: expected one of those taken, got {name!r}")
        self.trash.delete(f"{self.workspace.poses.name}/{name}", f"delete {name}")

    def scan(
        self,
        session: Session,
        name: str,
        how: Take | None = None,
        turned_deg: float | None = None,
    ) -> Job:
        """Take the frames of an object into a folder of its own.

        A virtual turntable that moves by itself stands at ``turned_deg``.
        """
        how = how or Take()
        self._free(name, how)
        stored = self._setup()
        action = Scan(name, how, self._others(stored, self.words_for("scan", turned_deg)))
        self.notes.forget(name)
        return self._act(session, "scan", action, how.hdr * stored.plan.pictures + 1)

    def start_series(
        self,
        session: Session,
        names: list[str],
        pause_s: float,
        how: Take | None = None,
        turn_deg: float = 0.0,
    ) -> Series:
        """Take scans one after the other, with a pause before each.

        A virtual turntable that moves by itself turns by ``turn_deg`` before each but the first.
        """
        if self.series is not None and self.series.running:
            raise InputError("A scan is running or waiting already: wait, or stop it.")
        for name in names:
            self._free(name, how or Take())
        self.hold(session)
        angles = {name: k * turn_deg if turn_deg else None for k, name in enumerate(names)}
        begin = lambda name: self.scan(session, name, how, angles[name])  # noqa: E731
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

    def _act(self, session: Session, name: str, action: Action, total: int) -> Job:
        """Begin an action that uses the devices."""
        self.workspace.check_writable()
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

    def _others(self, stored: StoredSetup, words: tuple[str, str]) -> dict[str, Any]:
        """Words of the chosen devices that are not those of the set-up."""
        projector, camera = words
        known = {"projector": stored.projector, "camera": stored.camera}
        chosen = {"projector": projector, "camera": camera}
        return {role: words for role, words in chosen.items() if words != known[role]}

    def _needs(self, path: Path, what: str) -> None:
        if not path.is_file():
            raise InputError(f"There is no {path.name}: {what}.")
