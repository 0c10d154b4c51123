"""What a studio knows: its devices, its computations, its visitors, and what was done."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

from fringeworks.evaluate.inspect import Verdict
from fringeworks.files.atomic import StrPath
from fringeworks.serving.worker import Job, Task, Worker
from fringeworks.studio import learning, tasks
from fringeworks.studio.actions import (
    Action,
    Calibrate,
    DrawBoard,
    DrawFigures,
    Export,
    Inspect,
    MergeViews,
    perform,
)
from fringeworks.studio.bench import Bench
from fringeworks.studio.camera_actions import CalibrateCameras, MeasureCameras
from fringeworks.studio.part_actions import Deviate, InspectAll, WriteMesh
from fringeworks.studio.recipes import RecipeKeeper, as_shown
from fringeworks.studio.series_actions import (
    Certify,
    ChartChecks,
    RunBatch,
    StudyGauge,
    WatchRig,
    listed_positions,
)
from fringeworks.studio.session import Session, Shown
from fringeworks.studio.tour import PART, Tour, begin_tour
from fringeworks.studio.trash import Entry
from fringeworks.studio.workspace import CHECKS
from fringeworks.types import FileProblem, InputError

StepState = Literal["to do", "running", "good", "look here"]
FIGURES = 40
"""Files that the dissertation's chapter has."""
MOST_OPEN = 4
"""Computations of one visitor that may wait or run."""
MOST_SESSIONS = 200
"""Visitors without an open page whose state is kept."""
MOST_SURFACES = 40
"""Packed surfaces that are kept for the page; the oldest one is deleted for a new one."""


class Studio(Bench):
    """The state that all pages of a studio share.

    Parameters
    ----------
    folder : path
        Made where it is missing. Nothing outside of it is read or written, except a temporary
        folder for packed surfaces, which ``close`` deletes.
    """

    def __init__(self, folder: StrPath) -> None:
        super().__init__(folder)
        self.compute = Worker()
        self.recipes = RecipeKeeper(self.workspace, self.trash)
        self.tour: Tour | None = None
        """The virtual part that is measured, or was measured last."""
        self.verdict: dict[str, Any] = {}
        """What the last calibration said."""
        self.batch: dict[str, Any] = {}
        """What the last batch said."""
        self._sessions: dict[str, Session] = {}
        self._numbers = itertools.count(1)
        self._packed = Path(tempfile.mkdtemp(prefix="fringeworks-studio-"))

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
        elif states["set up"] == "good" and any(finding.rank for finding in self.findings()):
            states["set up"] = "look here"
        return states

    def start_tour(self, session: Session) -> Tour:
        """Measure a virtual part from the first step to the last.

        Raises
        ------
        InputError where the folder has a set-up of other devices, and while the devices are used.
        """
        self._idle(session)
        if self.tour is not None and self.tour.running:
            raise InputError("The virtual part is being measured already.")
        self.tour = begin_tour(self, session)
        return self.tour

    def end_tour(self, session: Session) -> None:
        """Move what the virtual part has left in the folder to the trash: own devices come next."""
        self._idle(session)
        self.workspace.check()
        space, tour = self.workspace, self.tour
        files = (space.setup, space.root / "setup.plan.toml", space.setup.with_suffix(".png"))
        rigs = (space.rig, space.rig.with_suffix(".png"), space.poses, space.root / PART)
        self.trash.clear([path.name for path in (*files, *rigs)], "put the virtual part away")
        self.notes.forget(PART)
        self.poses, self.verdict, self.tour = {}, {}, None
        if tour is not None:
            tour.session.shown = tour.session.kept = None

    def print_board(self, session: Session) -> Job:
        """Draw the board to print."""
        return self._calculate(session, "drawing the board", DrawBoard(self.board))

    def calibrate(self, session: Session) -> Job:
        """Calibrate with the poses in the folder."""
        poses = self.workspace.taken_poses()
        if not poses:
            raise InputError("No pose of the board was taken: take poses first.")
        return self._calculate(session, "calibrating", Calibrate(self.board), len(poses) + 1)

    def merge_views(
        self,
        session: Session,
        captures: list[str],
        board: str,
        step_deg: float,
        name: str,
        *,
        beside: bool = False,
    ) -> Job:
        """Measure and merge the views of a part; ``board`` may be empty, ``beside`` as there."""
        if not self.workspace.rig.is_file():
            raise InputError("There is no rig: calibrate first.")
        if len(captures) < 2:
            raise InputError("Expected two views or more: take a series of scans first.")
        if beside and not board:
            raise InputError("Board: expected its short form, such as chessboard:11x8:12, got none")
        if board and not step_deg and not beside:
            raise InputError("Turntable step: expected degrees, got 0.")
        for capture in captures:
            self.workspace.inside(capture)
        name = self.workspace.free(name, ".ply")
        action = MergeViews(tuple(captures), board, step_deg, name, beside)
        return self._calculate(session, "merging", action, 2 * len(captures))

    def calibrate_cameras(self, session: Session, folders: list[str], board: str) -> Job:
        """Calibrate two cameras or more by poses of a board, a folder of them for each camera."""
        known = self.workspace.folders_of_captures()
        if len(folders) < 2 or not set(folders) <= set(known):
            raise InputError("Poses: expected a folder of captures for each of two cameras or more")
        action = CalibrateCameras(tuple(folders), board)
        return self._calculate(session, "calibrating the cameras", action)

    def measure_cameras(self, session: Session, captures: list[str], name: str) -> Job:
        """Measure a part that several cameras saw, a capture for each in the order of the rig."""
        self._needs(self.workspace.cameras, "calibrate the cameras first")
        if len(captures) < 2 or not set(captures) <= set(self.workspace.captures()):
            raise InputError("Captures: expected one for each camera, in the order of the rig")
        action = MeasureCameras(tuple(captures), self.workspace.free(name, ".ply"))
        return self._calculate(session, "measuring with the cameras", action)

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
        job.when_done(lambda: self.notes.measured(source, job.result["figures"]))
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
        return self._calculate(session, "the dissertation's figures", DrawFigures(size), FIGURES)

    def figure_address(self, name: str) -> str:
        """Where the page finds a figure; it changes with its file."""
        path = self.workspace.figures_folder / name
        stamp = path.stat().st_mtime_ns if path.is_file() else 0
        return f"/file/{self.workspace.figures_folder.name}/{name}?{stamp}"

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
        job = self._calculate(session, f"judging {name}", Inspect(source))
        job.when_done(lambda: self.notes.judged(name, job.result))
        return job

    def draw_picture(self, session: Session, name: str) -> Job:
        """Draw the picture of a capture or result, to draw areas on."""
        session.picture = next(self._numbers)
        source = self._source(Shown(name, "windowed", {}, 0))
        target = str(self.surface(session.picture))
        return self._compute(session, "drawing the picture", tasks.draw_picture, source, target)

    def export(self, session: Session, shown: Shown, suffix: str, kind: str) -> Job:
        """Write what is shown into the folder."""
        name = self.workspace.free(Path(shown.source).name, suffix)
        action = Export(self._source(shown), f"{name}{suffix}", kind)
        return self._calculate(session, f"writing {action.name}", action, 2)

    def write_mesh(self, session: Session, shown: Shown, suffix: str) -> Job:
        """Write what is shown as a mesh for printers and CAD."""
        name = self.workspace.free(Path(shown.source).name, suffix)
        action = WriteMesh(self._source(shown), f"{name}{suffix}")
        return self._calculate(session, f"writing {action.name}", action, 3)

    def deviate(self, session: Session, name: str, model: str, tolerance_mm: float | None) -> Job:
        """Compare a part with a drawing in the folder, and show the deviation.

        Raises
        ------
        InputError where the folder has no such drawing.
        """
        if model not in self.workspace.drawings():
            raise InputError(f"drawing: expected one in the folder, got {model!r}")
        self._replace(session)
        pending = Shown(name, "deviation", {"model": model}, next(self._numbers))
        source = self._source(Shown(name, "windowed", {}, 0))
        action = Deviate(source, model, tolerance_mm, str(self.surface(pending.number)))
        job = self._calculate(session, pending.work, action, 4)
        session.pending = pending
        return job

    def inspect_all(self, session: Session, names: list[str]) -> Job:
        """Judge many captures by the tolerances."""
        if not self.recipes.read().tolerances:
            raise InputError("No tolerance is set: add one in Look, then judge the parts.")
        if not names:
            raise InputError("There is no capture to judge.")
        rig = self.workspace.rig if self.workspace.rig.is_file() else None
        self.recipes.keep(replace(self.recipes.read(), rig=rig))
        job = self._calculate(session, "judging all", InspectAll(tuple(names)), len(names))
        job.when_done(lambda: self._note_verdicts(job.result))
        return job

    def run_batch(
        self, session: Session, folder: str, recipe: str, name: str, *, resume: bool
    ) -> Job:
        """Measure and judge all captures of a folder by a recipe.

        Raises
        ------
        InputError for a folder without captures, a recipe that is not there, and a name that is
        taken by a batch that is not resumed.
        """
        space = self.workspace
        if folder not in space.folders_of_captures():
            raise InputError("There is no capture in this folder: scan parts first.")
        if recipe not in space.of_kind("recipe"):
            raise InputError(
                "There is no recipe: draw areas and add tolerances in Look, which writes one."
            )
        if space.new(name).exists() and not resume:
            raise InputError(f"The folder has {name!r} already: choose another name, or resume it.")
        action = RunBatch(folder, recipe, name, resume)
        parts = sum(one.rpartition("/")[0] == folder.strip(".") for one in space.captures())
        job = self._calculate(session, f"batch {name}", action, 2 * parts + 1)
        job.when_done(lambda: self._note_batch(job.result))
        return job

    def _note_batch(self, result: dict[str, Any]) -> None:
        self.batch = result
        inside = "" if result["folder"] == "." else f"{result['folder']}/"
        self._note_verdicts({inside + row["part"]: row["verdict"] for row in result["rows"]})

    def list_positions(self, session: Session, test: str) -> Job:
        """List where the artefacts of an acceptance test are to be scanned."""
        self._there(test, self.workspace.of_kind("acceptance-test"), "an acceptance test")
        given = self.workspace, test
        return self._compute(session, "positions of the test", listed_positions, *given)

    def certify(self, session: Session, test: str, suffix: str = ".html") -> Job:
        """Test the scanner by scans of artefacts, and write the certificate."""
        self._there(test, self.workspace.of_kind("acceptance-test"), "an acceptance test")
        return self._prove(session, "certificate", "certificate", Certify, test, suffix=suffix)

    def study(
        self, session: Session, table: str, quantity: str, width: float | None, reference: str
    ) -> Job:
        """Judge the gauge by a table of trials."""
        self._there(table, self.workspace.tables(), "a table (CSV)")
        if not quantity:
            raise InputError("Column of the values: expected a name, got none")
        given = table, quantity, width, reference
        return self._prove(session, "gauge study", "study", StudyGauge, *given)

    def watch_rig(self, session: Session, captures: list[str]) -> Job:
        """Watch by scans of parts whether the rig has moved."""
        self._needs(self.workspace.rig, "calibrate first")
        stacks = [name for name in captures if tasks.is_stack(self.workspace.inside(name))]
        if not stacks:
            raise InputError("There is no scan with the frames of a plan: scan parts first.")
        return self._prove(session, "watching the rig", "rig-watch", WatchRig, tuple(stacks))

    def chart_checks(self, session: Session) -> Job:
        """Chart all checks of the rig."""
        self._needs(self.workspace.root / CHECKS, "check the rig in Calibrate first")
        return self._prove(session, "charting the checks", "rig-history", ChartChecks)

    def _prove(
        self, session: Session, work: str, name: str, kind: Any, *given: Any, suffix: str = ".html"
    ) -> Job:
        """Begin what writes a report of a free name."""
        report = f"{self.workspace.free(name, suffix)}{suffix}"
        return self._calculate(session, work, kind(*given, report))

    def _there(self, name: str, names: list[str], what: str) -> None:
        if name not in names:
            raise InputError(f"{name or 'file'}: expected {what} in the folder, got none")

    def _note_verdicts(self, found: dict[str, str]) -> None:
        for name, verdict in found.items():
            if verdict in get_args(Verdict):
                self.notes.judged(name, {"verdict": verdict})

    def _source(self, shown: Shown) -> tasks.Source:
        """What a surface is computed from."""
        path = self.workspace.inside(shown.source)
        if not path.exists():
            raise FileProblem(
                f"{shown.source}: expected a capture or result in the folder, got none"
            )
        stack = path.is_dir() and tasks.is_stack(path)
        rig = self.workspace.rig if stack and self.workspace.rig.is_file() else None
        source = tasks.Source(shown.source, path, rig, shown.method, shown.options)
        recipe = self.recipes.shown
        if recipe.within is None:
            return source
        self.recipes.keep(as_shown(recipe, source))
        return replace(source, recipe=self.workspace.recipe)

    def _calculate(self, session: Session, name: str, action: Action, total: int = 0) -> Job:
        """Begin an action that needs no devices."""
        self.workspace.check_writable()
        job = self._compute(session, name, perform, action, self.workspace, total=total)
        return self.log.note(job, action)

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

    def undo(self, session: Session, entry: Entry | None = None) -> str:
        """Undo what a click did, by default the last; what it was, in words.

        Raises
        ------
        InputError where there is nothing to undo, its place is taken, or another visitor uses the
        devices.
        """
        self.hold(session)
        self.workspace.check()
        said = self.trash.undo(entry)
        self.poses = {}
        return said

    def delete(self, session: Session, name: str) -> None:
        """Move a capture or a result to the trash.

        Raises
        ------
        InputError for anything else, and while devices or computations are at work.
        """
        self._idle(session)
        self._listed(name)
        self.trash.delete(name, f"delete {name}")

    def rename(self, session: Session, name: str, new: str) -> str:
        """Give a capture or a result another name; files keep their suffix. The new name.

        Raises
        ------
        As ``delete``; InputError for a name that is taken or not allowed.
        """
        self._idle(session)
        self._listed(name)
        old = Path(name)
        suffix = "" if self.workspace.inside(name).is_dir() else old.suffix
        self.workspace.new(new.removesuffix(suffix), suffix)
        target = (old.parent / f"{new.removesuffix(suffix)}{suffix}").as_posix()
        self.trash.rename(name, target)
        self.notes.renamed(name, target)
        return target

    def _listed(self, name: str) -> None:
        """Refuse names of anything but captures and results."""
        self.workspace.check()
        if name not in (*self.workspace.captures(), *self.workspace.results()):
            raise InputError(f"{name}: expected a capture or result in the folder, got none")

    def _idle(self, session: Session) -> None:
        """Refuse to move files that somebody may be reading or writing."""
        self.hold(session)
        self.workspace.check_writable()
        series = self.series is not None and self.series.running
        if series or (self.devices.busy and not self._is_live()) or self.compute.busy:
            raise InputError("Something is being measured: wait, or cancel it.")

    def close(self) -> None:
        """End the workers, and delete the packed surfaces."""
        if self.series is not None:
            self.series.stop()
        if self.tour is not None and self.tour.running:
            self.tour.stop()
        self.devices.close()
        self.compute.close()
        self.phone.close()
        shutil.rmtree(self._packed, ignore_errors=True)
