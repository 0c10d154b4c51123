"""A projector that plays pictures from its own memory, advanced by a trigger."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Closing, checked_picture
from fringeworks.files.plan import PLAN_FILE, read_plan
from fringeworks.patterns.encode import grey_pictures
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import DeviceProblem


class MemoryProjector(Closing):
    """A projector that holds the pictures of a plan in its memory and plays them in their order.

    Parameters
    ----------
    plan : PatternPlan or path
        The plan, or the folder into which ``write_patterns`` has exported its pictures.
    advance : callable, optional
        Makes the projector show the next picture, such as a pulse on its trigger input, or a
        question to the operator. None where the camera does that: its trigger output is connected
        to the projector's trigger input, and the projector shows the next picture for every frame.
    refresh_s : float, optional
        Time for which the projector shows a picture, s, if it is known.

    Raises
    ------
    FileProblem where the folder holds no plan.

    Notes
    -----
    For an evaluation board with a micromirror device:

    1. Export: ``write_patterns("patterns", plan)``.
    2. Load the pictures into the board's memory with its maker's program, in the order of their
       names, at the plan's bit depth, and without scaling. Let a trigger input advance the pictures
       (often called "external" or "hardware" trigger), and let the sequence start again after the
       last.
    3. Connect the camera's trigger output (exposure active) to that input. Set the time of a
       picture to the exposure or shorter, so that the exposure ends after the picture.
    4. Start the sequence, so that the next trigger shows the first picture.
    5. ``capture(MemoryProjector("patterns"), camera, read_plan("patterns/plan.toml"), "capture")``.

    The computer cannot see what the projector shows. ``show`` checks that the picture that is asked
    for is the next one of the sequence; a lost trigger is only found in the frames, by the check of
    order that ``decode`` makes.
    """

    def __init__(
        self,
        plan: PatternPlan | str | os.PathLike[str],
        *,
        advance: Callable[[], object] | None = None,
        refresh_s: float | None = None,
    ) -> None:
        self.plan = plan if isinstance(plan, PatternPlan) else read_plan(Path(plan) / PLAN_FILE)
        """The plan whose pictures the projector holds."""
        self.pictures: tuple[NDArray[Any], ...] = tuple(grey_pictures(self.plan))
        """Its pictures, drawn once."""
        self._advance = advance
        self._refresh_s = refresh_s
        self._open = True
        self.restart()

    @property
    def name(self) -> str:
        """``memory``."""
        return "memory"

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of the plan."""
        return self.plan.width_px, self.plan.height_px

    @property
    def bits(self) -> int:
        """Depth of the plan's pictures."""
        return self.plan.bits

    @property
    def refresh_s(self) -> float | None:
        """Time for which a picture is shown, s; None where it is unknown."""
        return self._refresh_s

    @property
    def position(self) -> int:
        """Number of the picture that comes next, from 0."""
        return self._position

    def restart(self) -> None:
        """Begin with the first picture again, after the projector's sequence was started again."""
        self._position = 0

    def show(self, picture: NDArray[Any]) -> float:
        """Advance to the next picture of the sequence, which must be this one.

        Raises
        ------
        InputError for a picture of another size or depth; DeviceProblem for another picture than
        the next one.
        """
        if not self._open:
            raise DeviceProblem("memory projector: expected an open projector, got a closed one")
        picture = checked_picture(picture, self.size_px, self.bits)
        coming = self.pictures[self._position]
        if picture is not coming and not np.array_equal(picture, coming):
            raise DeviceProblem(
                f"memory projector: expected picture {self._position + 1} of {self.plan.frames} "
                f"({self.plan.labels()[self._position]}), got another one: the projector plays its "
                "sequence in order and shows no test pictures, so its exposure is set by hand"
            )
        if self._advance is not None:
            self._advance()
        shown_s = time.monotonic()
        self._position = (self._position + 1) % self.plan.frames
        return shown_s

    def close(self) -> None:
        """Show nothing more; again without effect."""
        self._open = False
