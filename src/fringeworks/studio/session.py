"""What one visitor looks at."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

from fringeworks.serving.worker import Job

KEPT_JOBS = 8
"""Computations of a visitor whose state is kept."""


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
    proofs: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)
    """What the last certificate, study and watch said, by the names of their work."""
    jobs: deque[Job] = field(default_factory=lambda: deque(maxlen=KEPT_JOBS))
    """Their last computations."""

    def recall(self, source: str, method: str, options: dict[str, Any]) -> bool:
        """Whether a result is there or on its way; one that is kept is shown again."""
        wanted = source, method, options
        made = [
            None if one is None else (one.source, one.method, one.options)
            for one in (self.pending, self.shown, self.kept)
        ]
        if wanted == made[2] and wanted not in made[:2]:
            self.shown, self.kept = self.kept, self.shown
        return wanted in made

    def job(self, names: tuple[str, ...]) -> Job | None:
        """The last computation whose name begins with one of these."""
        return next((job for job in reversed(self.jobs) if job.name.startswith(names)), None)

    def catch_up(self) -> None:
        """Take over a result that was computed while another step was shown."""
        job = None if self.pending is None else self.job((self.pending.work,))
        if job is not None and job.state == "done":
            self.arrived(job.name, job.result)

    def arrived(self, name: str, result: dict[str, Any]) -> None:
        """Take over a result that was computed; the one before is kept for comparison."""
        if self.pending is not None and name == self.pending.work:
            self.kept, self.shown = self.shown, replace(self.pending, result=result)
            self.pending = None
