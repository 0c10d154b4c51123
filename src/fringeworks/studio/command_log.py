"""Commands that do the same as what was clicked."""

from __future__ import annotations

from collections.abc import Callable

from fringeworks.studio.script import Command
from fringeworks.studio.worker import Job
from fringeworks.studio.workspace import Workspace


class CommandLog:
    """Work that was begun, and the commands that do it."""

    def __init__(self, space: Workspace) -> None:
        self._space = space
        self._log: list[tuple[Job, Callable[[Job], Command]]] = []

    @property
    def done(self) -> list[Command]:
        """Commands that do what was done, in its order; work that failed is left out.

        Poses that were deleted or taken again are left out as well.
        """
        found: list[Command] = []
        for job, command in self._log:
            if job.state == "done":
                made = command(job)
                found = [one for one in found if one.shell != made.shell]
                if made.replaces is not None:
                    found = [one for one in found if one.replaces != made.replaces]
                found.append(made)
        poses = {f"{self._space.poses.name}/{name}" for name in self._space.taken_poses()}
        return [one for one in found if one.replaces is None or one.replaces in poses]

    def note(self, job: Job, command: Callable[[Job], Command]) -> Job:
        """Note the command that does the same as a piece of work."""
        self._log.append((job, command))
        return job
