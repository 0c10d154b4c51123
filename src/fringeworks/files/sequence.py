"""Sequences of frames on disk, read one by one: folders of images, stacks in one file, Zarr."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.images import IMAGE_SUFFIXES, TIFF_SUFFIXES, read_frame
from fringeworks.files.limits import existing_file, is_file, is_folder
from fringeworks.files.stack import captures_in, images_of, open_stack_file, video_in
from fringeworks.files.zarr_array import ZARR_FILE, holds_counts, open_zarr_array, read_entry
from fringeworks.types import FileProblem

FRAME_AXES = 3
"""Dimensions of a sequence in one array: frame, row, column."""


@dataclass(frozen=True)
class FrameSequence:
    """Frames on disk, in the order of time. Each is read when it is asked for."""

    source: Path
    frames: Any
    """Paths of images, or an array (frame, row, column) that stays on disk."""

    def __len__(self) -> int:
        # Arrays of Zarr have no len().
        return len(self.frames) if isinstance(self.frames, list) else int(self.frames.shape[0])

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Read one frame after another.

        Raises
        ------
        FileProblem for a frame that cannot be read.
        """
        for number in range(len(self)):
            if isinstance(self.frames, list):
                yield read_frame(self.frames[number])[0]
            else:
                yield read_entry(str(self.source), self.frames, number)


def read_sequence(path: StrPath) -> FrameSequence:
    """Open a sequence of frames.

    Parameters
    ----------
    path : path
        A folder of images, in the order of their names with numbers by value; a TIFF stack,
        ``.npy`` or ``.npz`` with (frame, row, column); a video, which is read whole; or a Zarr
        array of these dimensions (extra ``batch``).

    Returns
    -------
    FrameSequence

    Raises
    ------
    FileProblem for anything missing, of another kind or of other dimensions; MissingPackage for a
    Zarr array without the extra.
    """
    place = Path(path)
    if is_folder(place) and is_file(place / ZARR_FILE):
        return FrameSequence(place, _checked(place, open_zarr_array(str(place))))
    if is_folder(place) and video_in(place) is None:
        images = images_of(place)
        if not images:
            kinds = ", ".join((*IMAGE_SUFFIXES, *TIFF_SUFFIXES))
            raise FileProblem(f"{place}: expected images, got none of {kinds}{captures_in(place)}")
        return FrameSequence(place, images)
    if is_folder(place) and (video := video_in(place)) is not None:
        place = place / video
    existing_file(place, "a folder of images or a stack in one file")
    return FrameSequence(place, _checked(place, open_stack_file(place)[0]))


def _checked(place: Path, array: Any) -> Any:
    if not holds_counts(array, FRAME_AXES):
        got = " ".join(str(getattr(array, name, "")) for name in ("dtype", "shape")).strip()
        raise FileProblem(f"{place}: expected counts (frame, row, column), got {got or 'no array'}")
    return array
