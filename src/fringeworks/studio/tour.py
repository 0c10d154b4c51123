"""A first minute: a virtual part is measured from set-up to surface, with words at each step."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fringeworks.files.setup import read_setup
from fringeworks.serving.worker import Job
from fringeworks.studio.bench import BY_ITSELF, VIRTUAL
from fringeworks.studio.session import Session
from fringeworks.studio.words import step_words
from fringeworks.types import InputError
from fringeworks.types.numbers import sigma_text

if TYPE_CHECKING:
    from fringeworks.studio.state import Studio

POSES = 10
"""Poses of the board that are taken: a calibration with fewer has a finding of few poses."""
PART = "virtual-part"
"""Name of the capture."""
ROUND_S = 0.05
"""Interval at which the work that runs is polled, s."""


@dataclass
class Stage:
    """A part of the tour."""

    title: str
    words: str
    """What happens, and why."""
    state: str = "to do"
    """``to do``, ``running``, ``good`` or ``look here``."""
    said: str = ""
    """What came of it."""


def _stages() -> dict[str, Stage]:
    return {
        "set up": Stage(
            "Set up",
            "The projector shows test pictures and the camera looks at them. The studio measures "
            "noise, brightness, sharpness and delay, and plans the fringes that suit both.",
        ),
        "board": Stage(
            "Show a board",
            f"A board whose corners are known is shown in {POSES} poses. You would hold it; this "
            "one moves by itself.",
        ),
        "calibrate": Stage(
            "Calibrate",
            "The corners tell where camera and projector are and how their lenses draw. From then "
            "on fringes are millimetres.",
        ),
        "scan": Stage(
            "Scan", "The fringes are projected on a part, and the camera takes a frame of each."
        ),
        "look": Stage(
            "Look",
            "Every pixel becomes a point with a standard deviation, or says why it has none.",
        ),
    }


@dataclass
class Tour:
    """Measures a virtual part from the set-up to the surface; it goes on whatever page is open."""

    studio: Studio
    session: Session
    stages: dict[str, Stage] = field(default_factory=_stages)
    problem: str = ""
    """Why it ended early; empty where it did not."""
    running: bool = True
    finished: bool = False
    began_s: float = field(default_factory=time.monotonic)
    took_s: float = 0.0

    def __post_init__(self) -> None:
        self._stopped = threading.Event()
        self._job: Job | None = None

    @property
    def now(self) -> str:
        """What is being done, and for how long the tour has run, in words."""
        job = self._job
        label = f"{step_words(job)}, " if job is not None and job.open and job.label else ""
        return f"{label}{time.monotonic() - self.began_s:.0f} s so far"

    def start(self) -> None:
        """Begin, in a thread of its own."""
        threading.Thread(target=self._run, daemon=True).start()

    def stop(self) -> None:
        """End it; what was made so far stays, and the next tour goes on from there."""
        self._stopped.set()
        for worker in (self.studio.devices, self.studio.compute):
            if self._job is not None and worker.job is self._job:
                worker.cancel(self._job)

    def _run(self) -> None:
        stage = self.stages["set up"]
        try:
            for name, begin, tell in self._work():
                stage = self.stages[name]
                stage.state = "running"
                self._wait(begin())
                stage.said = tell()
            for stage in self.stages.values():
                stage.state = "good"
            self.finished = True
        except InputError as problem:
            stage.state = "look here"
            self.problem = "\n".join(problem.lines)
        except Exception as problem:
            stage.state = "look here"
            self.problem = f"internal error, please report it: {problem!r}"
        finally:
            self.took_s = time.monotonic() - self.began_s
            self.running = False

    def _wait(self, job: Job) -> None:
        self._job = job
        while job.open:
            time.sleep(ROUND_S)
        if self._stopped.is_set():
            raise InputError("The trial was stopped.")
        if job.state != "done":
            raise InputError(job.problem or "The trial was cancelled.")

    def _work(self) -> Iterator[tuple[str, Callable[[], Job], Callable[[], str]]]:
        """What is left to do: the stage, what begins it, and what is said when it has ended."""
        studio, session, space = self.studio, self.session, self.studio.workspace
        if not space.setup.is_file():
            yield "set up", lambda: studio.run_setup(session), self._of_setup
        self.stages["set up"].state = "good"
        while not space.rig.is_file() and len(space.taken_poses()) < POSES:
            yield "board", lambda: studio.take_pose(session), self._of_poses
        self.stages["board"].state = "good"
        if not space.rig.is_file():
            yield "calibrate", lambda: studio.calibrate(session), self._of_rig
        self.stages["calibrate"].state = "good"
        if PART not in space.captures():
            yield "scan", lambda: studio.scan(session, PART), lambda: f"{PART} was taken."
        self.stages["scan"].state = "good"
        yield "look", lambda: studio.look(session, PART, "windowed", {}), self._of_part

    def _result(self) -> dict[str, object]:
        return dict(self._job.result) if self._job is not None else {}

    def _of_setup(self) -> str:
        return f"{read_setup(self.studio.workspace.setup).plan.frames} frames were planned."

    def _of_poses(self) -> str:
        result = self._result()
        self.studio.poses = result
        return f"{len(self.studio.workspace.taken_poses())} of {POSES} poses were taken."

    def _of_rig(self) -> str:
        self.studio.verdict = verdict = self._result()
        found = verdict.get("verdict")
        return str(found["text"]) if isinstance(found, dict) else ""

    def _of_part(self) -> str:
        figures = self._result()["figures"]
        assert isinstance(figures, dict)
        sigma = sigma_text(figures["median_sigma_mm"], "mm")
        return f"{figures['points']:,} points, median σ {sigma}."


def begin_tour(studio: Studio, session: Session) -> Tour:
    """Begin a tour in a folder without a set-up of other devices.

    Raises
    ------
    InputError where the folder has one, and while the devices are in use.
    """
    path = studio.workspace.setup
    if path.is_file() and not read_setup(path).camera.startswith(VIRTUAL):
        raise InputError(
            "This folder has a set-up of your devices: open the studio in an empty folder to try "
            "a virtual part."
        )
    studio.projector = studio.camera = VIRTUAL
    studio.scene = BY_ITSELF
    tour = Tour(studio, session)
    tour.start()
    return tour
