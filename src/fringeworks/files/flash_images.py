"""Pictures of a plan as images of 24 bit for the flash of a projector."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from fringeworks.files.atomic import StrPath, replacing
from fringeworks.files.folder import replacing_folder
from fringeworks.files.plan import PLAN_FILE, write_plan
from fringeworks.patterns.binary import PLANES, packed
from fringeworks.patterns.encode import grey_pictures
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import InputError

COLOURS = (8, 0, 16)
"""First plane of red, green and blue: planes count from the lowest bit of green, then red, blue
(DLPU010, Pattern Number Mapping)."""


def write_flash_images(
    folder: StrPath,
    plan: PatternPlan,
    *,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Write the pictures of a plan as images of 24 bit, with the plan beside them.

    For the flash of a LightCrafter 4500: its maker's program makes a firmware of the images, in the
    order of their names. An image holds 24 pictures of 1 bit or three of 8 bit.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    plan : PatternPlan
        With 1 or 8 bit.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.
    progress : callable
        Called with the name of each image.

    Returns
    -------
    Paths of the images, BMP. ``plan.toml`` is written last.

    Raises
    ------
    InputError for a plan of another depth; FileProblem where the folder holds other things or
    cannot be written to.
    """
    if plan.bits not in (1, 8):
        raise InputError(f"plan: expected pictures of 1 or 8 bit, got {plan.bits} bit")
    each = PLANES // plan.bits
    pictures = list(grey_pictures(plan))
    written = []
    with replacing_folder(folder, "patterns", index=(PLAN_FILE,), force=force) as writer:
        for k in range(0, len(pictures), each):
            name = f"image-{k // each:02d}.bmp"
            progress(name)
            words = packed(pictures[k : k + each], plan.bits)
            colours = np.stack([(words >> first & 0xFF).astype(np.uint8) for first in COLOURS], -1)
            written.append(writer.file(name))
            with replacing(written[-1]) as temporary:
                Image.fromarray(colours).save(temporary, format="BMP")
        write_plan(writer.file(PLAN_FILE), plan)
    return written
