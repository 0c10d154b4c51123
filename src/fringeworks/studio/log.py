"""What was done in a studio's folder, also before the studio was started anew."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fringeworks.serving.worker import Job
from fringeworks.studio.actions import (
    Action,
    Calibrate,
    Command,
    DrawBoard,
    DrawFigures,
    Export,
    Inspect,
    MergeViews,
    Scan,
    SetUp,
    TakePose,
)
from fringeworks.studio.camera_actions import CalibrateCameras, MeasureCameras
from fringeworks.studio.part_actions import PART_ACTIONS, Deviate, WriteMesh
from fringeworks.studio.series_actions import SERIES_ACTIONS
from fringeworks.studio.tasks import Source
from fringeworks.studio.workspace import Workspace
from fringeworks.types import InputError

ACTIONS: dict[str, type[Action]] = {
    kind.__name__: kind
    for kind in (
        SetUp,
        Scan,
        TakePose,
        DrawBoard,
        Calibrate,
        MergeViews,
        Inspect,
        Export,
        DrawFigures,
        *PART_ACTIONS,
        *SERIES_ACTIONS,
        CalibrateCameras,
        MeasureCameras,
    )
}
"""What can be done, by the names that the file of what was done has."""
OF_SOURCES = (Inspect, Export, WriteMesh, Deviate)
"""Actions that know what they were computed from."""
MOST_LINES = 5000
"""Lines of the file of what was done that are read, from its end."""
MOST_BYTES = 5_000_000
"""Longest file of what was done that is read, bytes: about a kilobyte for each line."""


@dataclass(frozen=True)
class Done:
    """An action that has ended well."""

    action: Action
    when: datetime
    pose: str | None = None
    """Name of the pose that it took, if any."""

    @property
    def command(self) -> Command:
        """What does the same."""
        return self.action.command({"name": self.pose})


class CommandLog:
    """Actions that have ended well, and the commands that do the same.

    They are kept in a file as data, and the commands are made from them: nothing that a folder
    holds is shown as a command.
    """

    def __init__(self, space: Workspace) -> None:
        self._space = space
        self._lock = threading.Lock()
        self._log = list(self._read())

    def note(self, job: Job, action: Action) -> Job:
        """Note the action of a piece of work when it has ended well."""
        job.when_done(lambda: self._keep(job, action))
        return job

    @property
    def everything(self) -> list[Done]:
        """Every action that has ended well, in their order."""
        return list(self._log)

    @property
    def done(self) -> list[Command]:
        """Commands that do what was done, in its order.

        Of what was done twice, such as a pose that was taken again, the last time counts. Poses
        that were deleted are left out as well.
        """
        found: dict[Any, Command] = {}
        there = self._space.taken_poses()
        for one in self.everything:
            if one.pose is None or one.pose in there:
                made = one.command
                found.pop(one.pose or made, None)
                found[one.pose or made] = made
        return list(found.values())

    def _keep(self, job: Job, action: Action) -> None:
        pose = job.result["name"] if isinstance(action, TakePose) else None
        if isinstance(action, OF_SOURCES):
            action = replace(action, source=action.source.settled())
        one = Done(action, datetime.now(UTC), pose)
        kind = type(action)
        line = {
            "when": one.when.isoformat(timespec="seconds"),
            "action": kind.__name__,
            "pose": pose,
            "given": TypeAdapter(kind).dump_python(action, mode="json"),
        }
        with self._lock:
            self._log.append(one)
            try:
                with self._space.history.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
            except OSError:
                pass  # the folder cannot be written to: the log then ends with the studio

    def _read(self) -> list[Done]:
        path = self._space.history
        try:
            if path.is_symlink() or path.stat().st_size > MOST_BYTES:
                return []
            lines = path.read_text("utf-8").splitlines()[-MOST_LINES:]
        except (OSError, ValueError):
            return []
        found = (self._one(line) for line in lines)
        return [one for one in found if one is not None]

    def _one(self, line: str) -> Done | None:
        """An action of the file; None for a line that is none."""
        try:
            given = json.loads(line)
            kind = ACTIONS[given["action"]]
            action = TypeAdapter(kind).validate_python(given["given"])
            when, pose = datetime.fromisoformat(given["when"]), given["pose"]
            if isinstance(action, OF_SOURCES):
                action = replace(action, source=self._own(action.source))
            one = Done(action, when, None if pose is None else str(pose))
            return one if one.command else None
        except (InputError, ValidationError, ValueError, KeyError, TypeError):
            return None

    def _own(self, source: Source) -> Source:
        """A source with the path that its name has in this folder."""
        rig = None if source.rig is None else self._space.rig
        recipe = None if source.recipe is None else self._space.recipe
        return replace(source, path=self._space.inside(source.name), rig=rig, recipe=recipe)
