"""Stacks on disk: folders of images with their plan, and stacks in one file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.best_channels import BEST
from fringeworks.files.capture_writer import (
    StackFile,
    refuse_unfinished,
    settings_of,
    writing_capture,
)
from fringeworks.files.frame_order import by_name, in_plan_order
from fringeworks.files.images import (
    CHANNELS,
    IMAGE_SUFFIXES,
    TIFF_SUFFIXES,
    ReadFrames,
    checked_channels,
    read_frames,
)
from fringeworks.files.limits import existing_file, inside, is_file, is_folder, parsing, told
from fringeworks.files.mosaic import checked_mosaic, first_px, plane_of_image
from fringeworks.files.npz import read_npz
from fringeworks.files.pair import CAPTURE_FILE, missing_description
from fringeworks.files.photographs import PHOTOGRAPH_SUFFIXES
from fringeworks.files.plan import PLAN_FILE, read_plan
from fringeworks.files.provenance import source_of
from fringeworks.files.toml import kind_of, read_toml
from fringeworks.files.video import VIDEO_SUFFIXES, frames_of_plan, read_video
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.colour_steps import unmix
from fringeworks.stack.even_light import texture_weights
from fringeworks.stack.frames import Stack, step_of
from fringeworks.types import (
    NUMBERS,
    ColourPlane,
    FileProblem,
    FramesContradictPlan,
    Region,
    sealed,
)

STACK_SUFFIXES = (*TIFF_SUFFIXES, ".npy", ".npz", ".mat", *VIDEO_SUFFIXES)
"""Single files that hold a stack."""
MOST_LEVELS = 3
"""Folders below a folder that are looked into for captures: part, day and pose."""
MOST_NAMES = 8
"""Largest number of names that a message lists."""
OTHER_SUFFIXES = (".toml", ".txt", ".md", ".json", ".log", ".csv", ".npy", ".npz", *TIFF_SUFFIXES)
"""Files that lie beside frames, or hold stacks."""
LEAKING = (
    "each image holds several frames in its channels: light that leaks from one colour to another "
    "is not corrected, and its errors are not in σ; a plan with colours = true removes it"
)
"""Note of captures with channels that are a frame each."""
MAX_NOTES = 1
"""Notes about single frames that are kept in full; the others are counted."""


class _Channels(NamedTuple):
    """What is read of colour images and raw frames."""

    letters: str
    """Channels that are a frame each; empty for luminance."""
    mosaic: str
    """Filters of raw frames; empty for none."""
    named: bool
    """Whether the channels were named beside the plan, so that grey images are refused."""


def read_stack(
    path: StrPath,
    plan: StrPath | PatternPlan | None = None,
    *,
    channels: str | None = None,
    mosaic: str | None = None,
) -> Stack:
    """Read a stack of frames.

    Parameters
    ----------
    path : path
        A folder of images with ``plan.toml`` (or with ``capture.toml`` of the kind "stack"), a
        TIFF stack, ``.npy`` or ``.npz`` with (n, h, w), a MATLAB file of version 5 to 7 with the
        variable ``frames`` (h, w, n), or a video, which OpenCV decodes. A video
        has the plan's frames, or shows each pattern still for two frames or more.
    plan : path or PatternPlan, optional
        For folders and files that have no plan beside them.
    channels : str, optional
        Channels of colour images that are a frame each: "g" or "green" for green alone, "rgb" where
        every image holds three frames of the plan; "best" for the combination of all three with the
        least noise. By default those that ``capture.toml`` says, or the channel of the plan.
    mosaic : str, optional
        Filters of raw frames that nobody interpolated, as "rggb": those of the first two pixels of
        the first row and of the second; "file" for raw photographs, which say it. Of the one
        channel, only its own pixels are read: frames of half as many columns and rows. By default
        what ``capture.toml`` says.

    Returns
    -------
    Stack with frames as stored. Uncompressed TIFF and ``.npy`` stay on disk. If an image of a
    folder is coloured, all become luminance, float32, unless channels are named. Those of a mosaic
    have their place in the frame as ``region``, by which ``measure`` adapts a rig.

    Raises
    ------
    FileProblem for anything missing, unreadable or unknown, naming the file;
    FramesContradictPlan where the number of frames is not the plan's, images differ in depth, or a
    list of frames contradicts the labels in their names.

    Notes
    -----
    The images of a folder are placed by the labels in their names, as ``write_stack`` and
    ``write_patterns`` write them, where every name carries a label of the plan; otherwise by name.
    """
    path = Path(path)
    if is_folder(path):
        with parsing(path, "a stack of frames"):
            return _read_folder(path, plan, channels, mosaic)
    if not is_file(path):
        raise FileProblem(
            f"{told(path)}: expected a folder or a stack of frames, got nothing there"
        )
    if plan is None:
        plan = path.parent / PLAN_FILE
        if not is_file(plan):
            if path.suffix.lower() not in (*IMAGE_SUFFIXES, *PHOTOGRAPH_SUFFIXES):
                open_stack_file(path)  # says what a file is that holds no frames
            raise FileProblem(
                f"{path}: expected a plan, or a file {PLAN_FILE} beside it, got none; phase steps "
                "of known shifts need no plan: their result is the wrapped phase"
            )
    layout = _plan_of(plan)
    if layout.colours:
        read = _read_colours([path], layout, checked_channels(channels), None)
        return replace(read, sources=(source_of(path),))
    letters = checked_channels(channels or layout.channel)
    mosaic = checked_mosaic(mosaic, letters)
    frames, lossy, notes = _read_file(path, _Channels(letters, mosaic, bool(channels)), layout)
    shapes = {frame.shape for frame in frames}
    return Stack(
        frames,
        layout,
        region=_plane(None, shapes, first_px(mosaic, letters)) if mosaic else None,
        notes=notes,
        sources=(source_of(path),),
        count_step=step_of(frames[0].dtype) if frames else None,
        lossy=lossy,
    )


def read_poses(
    folder: StrPath,
    plan: StrPath | PatternPlan | None = None,
    *,
    channels: str | None = None,
    mosaic: str | None = None,
) -> Iterator[tuple[str, Stack]]:
    """Read the stacks of a calibration, one after the other.

    Parameters
    ----------
    folder : path
        Holds one stack (a folder or a file) for each pose of the board.
    plan : path or PatternPlan, optional
        Of all poses; a ``plan.toml`` in the folder serves as well.
    channels : str, optional
        As for ``read_stack``.

    Yields
    ------
    Name of the pose, and its Stack.

    Raises
    ------
    FileProblem where there is no such folder or no stack in it, and as ``read_stack``.
    """
    folder = Path(folder)
    paths = pose_paths(folder)
    if plan is None and is_file(folder / PLAN_FILE):
        plan = folder / PLAN_FILE
    for path in paths:
        yield path.name, read_stack(path, plan, channels=channels, mosaic=mosaic)


def pose_paths(folder: StrPath) -> list[Path]:
    """The stacks in a folder of poses, by name."""
    folder = Path(folder)
    if not is_folder(folder):
        raise FileProblem(f"{folder}: expected a folder with a stack per pose, got none")
    found = sorted(
        path
        for path in folder.iterdir()
        if not path.name.startswith(".")
        and (is_folder(path) or path.suffix.lower() in STACK_SUFFIXES)
    )
    if not found:
        raise FileProblem(f"{folder}: expected a stack per pose, got none")
    return found


def write_stack(
    folder: StrPath,
    frames: Iterable[NDArray[Any]],
    plan: PatternPlan,
    *,
    camera: str | None = None,
    projector: str | None = None,
    saturation: float | None = None,
    white_balance: Sequence[float] | None = None,
    truth: Mapping[str, NDArray[Any]] | None = None,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write frames as a folder of images with their plan.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    frames : iterable of (h, w) arrays
        In the order of the plan: whole counts become PNG, floats TIFF. Photographs (h, w, 3) for a
        plan with ``colours``.
    plan : PatternPlan
    camera, projector : str, optional
        Names of the devices.
    saturation : float, optional
        Counts from which on a sample is not trusted.
    white_balance : (red, green, blue), optional
        Gains of the colour of points, as ``fringeworks.stack.white_balance`` measures them.
    truth : mapping of arrays, optional
        Of a simulation, written as ``truth.npz`` beside the frames.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.
    progress : callable
        Called with the label of each frame.

    Returns
    -------
    The folder. ``capture.toml`` is written last.

    Raises
    ------
    FramesContradictPlan where the number of frames is not the plan's; FileProblem where the folder
    holds other things or cannot be written to.
    """
    labels = plan.picture_labels()
    with writing_capture(
        folder,
        plan,
        camera=camera,
        projector=projector,
        saturation=saturation,
        white_balance=white_balance,
        force=force,
    ) as writer:
        for number, frame in enumerate(frames):
            progress(labels[min(number, len(labels) - 1)])
            writer.add(number, frame)
        if truth is not None and not writer.missing:
            writer.add_truth(truth)
    return Path(folder)


def _plan_of(plan: StrPath | PatternPlan) -> PatternPlan:
    return plan if isinstance(plan, PatternPlan) else read_plan(plan)


def _read_colours(
    paths: Sequence[Path], plan: PatternPlan, channels: str, saturation: float | None
) -> Stack:
    """The frames in the colours of photographs, or of one file of them, without crosstalk."""
    if channels:
        raise FileProblem(
            f"{paths[0].parent}: expected no channels for a plan with colours, which takes all "
            f"three, got {channels}"
        )
    if len(paths) == 1:
        array, lossy = open_stack_file(paths[0])
        pictures = list(array)
    else:
        read = read_frames(paths, stack=True, channels=CHANNELS)
        lossy, count = read.lossy, len(CHANNELS)
        threes = (read.frames[k : k + count] for k in range(0, len(read.frames), count))
        pictures = [np.stack(three, axis=-1) for three in threes]
    return replace(unmix(pictures, plan, saturation=saturation), lossy=lossy)


def _read_folder(
    folder: Path,
    plan: StrPath | PatternPlan | None,
    channels: str | None,
    mosaic: str | None,
) -> Stack:
    content = _described(folder)
    named = channels or content.channels or content.channel
    if content.channels and content.channel:
        raise FileProblem(f"{folder}: expected channels or channel in {CAPTURE_FILE}, got both")
    listed = content.frames if content.frames is not None else video_in(folder)
    if plan is None:
        plan = inside(folder, content.plan)
        if not is_file(plan):
            raise missing_description(folder, told(content.plan), captures_in(folder))
    layout, saturation = _plan_of(plan), content.saturation
    letters = checked_channels(named or layout.channel)
    taken = _Channels(letters, checked_mosaic(mosaic or content.mosaic, letters), bool(named))
    tomls = [folder / CAPTURE_FILE] if is_file(folder / CAPTURE_FILE) else []
    tomls += [] if isinstance(plan, PatternPlan) else [Path(plan)]
    if layout.colours:
        return _colour_capture(folder, layout, content, letters, tomls)
    paths, notes, read = _frames_of(folder, listed, layout, taken)
    return Stack(
        read.frames,
        layout,
        saturation or read.saturation,
        content.devices.camera,
        content.devices.projector,
        tuple(notes),
        tuple(source_of(path) for path in (*paths, *tomls)),
        read.count_step,
        read.lossy,
        _region_of(content, read),
        read.colour,
        content.white_balance,
        colour_noise=read.colour_noise,
    )


def _frames_of(
    folder: Path, listed: Sequence[str] | str | None, layout: PatternPlan, taken: _Channels
) -> tuple[list[Path], list[str], ReadFrames]:
    """The files of a folder's frames, what was done to them, and the frames."""
    channels, mosaic = taken.letters, taken.mosaic
    if isinstance(listed, str):
        path = existing_file(inside(folder, listed), "a stack of frames")
        frames, lossy, said = _read_file(path, taken, layout)
        first = first_px(mosaic, channels) if mosaic else None
        step = step_of(frames[0].dtype) if frames else None
        return [path], list(said), ReadFrames(tuple(frames), (), step, lossy, first_px=first)
    paths, notes = _images_in_order(folder, listed, channels, layout)
    # Where an image holds several frames, each channel has a pattern of its own.
    single = channels == BEST or len(channels) <= 1
    shown = texture_weights(layout) if single and not mosaic else {}
    read = read_frames(
        paths, stack=True, channels=channels, weights=shown, mosaic=mosaic, grey=not taken.named
    )
    return paths, notes + (_first_of(read.notes) if single else [LEAKING]), read


def _colour_capture(
    folder: Path, plan: PatternPlan, content: StackFile, channels: str, tomls: list[Path]
) -> Stack:
    """The capture of a plan with colours."""
    notes: list[str] = []
    if isinstance(content.frames, str):
        paths = [existing_file(inside(folder, content.frames), "a stack of frames")]
    else:
        paths, notes = _images_in_order(folder, content.frames, "", plan)
    read = _read_colours(paths, plan, channels, content.saturation)
    return replace(
        read,
        camera=content.devices.camera,
        projector=content.devices.projector,
        notes=(*notes, *read.notes),
        sources=tuple(source_of(path) for path in (*paths, *tomls)),
        region=_region_of(content, read),
        white_balance=content.white_balance,
    )


def _images_in_order(
    folder: Path, names: Sequence[str] | None, channels: str, layout: PatternPlan
) -> tuple[list[Path], list[str]]:
    """The images of a folder in the order of a plan, and notes about their names."""
    given = [inside(folder, n) for n in names or ()] if names is not None else images_of(folder)
    if len(channels) > 1 and channels != BEST:
        _check_number(given, channels, layout, folder)
        return given, []
    return in_plan_order(given, layout, folder, listed=names is not None)


def _region_of(content: StackFile, read: ReadFrames | Stack) -> Region | None:
    """The part of the sensor that frames show, unless their size is another by now."""
    region = settings_of(content.settings).region
    shapes = {frame.shape for frame in read.frames}
    if isinstance(read, ReadFrames) and read.first_px is not None:
        return _plane(region, shapes, read.first_px)
    fits = region is not None and shapes == {region.shape}
    return region if fits else None


def _plane(
    region: Region | None, shapes: set[tuple[int, ...]], first: tuple[float, float]
) -> ColourPlane | None:
    """The pixels of one colour that frames show, in a part of a sensor or the whole of it."""
    if len(shapes) != 1:
        return None
    rows, columns = next(iter(shapes))
    whole = region or Region(0, 0, 2 * columns, 2 * rows)
    found = ColourPlane(whole.x_px, whole.y_px, whole.width_px, whole.height_px, first)
    return found if found.shape == (rows, columns) else None


def _first_of(notes: Sequence[str]) -> list[str]:
    """Notes about single frames, of which most are only counted."""
    more = len(notes) - MAX_NOTES
    counted = [f"the same holds for {more} other frame{'s' if more > 1 else ''}"]
    return [*notes[:MAX_NOTES], *(counted if more > 0 else [])]


def _check_number(paths: list[Path], channels: str, plan: PatternPlan, folder: Path) -> None:
    """Refuse another number of images with several frames each than the plan's."""
    if len(paths) * len(channels) != plan.frames:
        raise FramesContradictPlan(
            f"{folder}: the plan has {plan.frames} frames, got {len(paths)} images with "
            f"{len(channels)} channels each"
        )


def _described(folder: Path) -> StackFile:
    """The description of a folder that holds a complete stack; an empty one where it has none."""
    refuse_unfinished(folder)
    description = folder / CAPTURE_FILE
    if not is_file(description):
        return StackFile(kind="stack")
    kind = kind_of(description)
    if kind == "pair":
        raise FileProblem(f"{folder}: expected a stack of frames, got a pair: reconstruct it")
    if kind == "exposures":
        raise FileProblem(
            f"{folder}: expected a stack of frames, got several exposures of a scene: decode or "
            "measure the folder, which fuses them, or read one of its folders 0, 1, …"
        )
    return read_toml(description, StackFile)


def captures_in(folder: Path) -> str:
    """Which captures a folder holds in place of one, as the end of a message."""
    names = sorted(path.relative_to(folder).as_posix() for path in _below(folder, MOST_LEVELS))
    more = f" and {len(names) - MOST_NAMES} others" if len(names) > MOST_NAMES else ""
    shown = ", ".join(names[:MOST_NAMES])
    return f"; it holds captures: {shown}{more}; give one of them" if names else ""


def _below(folder: Path, levels: int) -> Iterator[Path]:
    """The captures in a folder and in its folders, down to a number of levels."""
    for path in folder.iterdir():
        if not is_folder(path) or path.is_symlink():
            continue
        if any(is_file(path / name) for name in (CAPTURE_FILE, PLAN_FILE)):
            yield path
        elif levels > 1:
            yield from _below(path, levels - 1)


def _part_of_capture(path: Path) -> str:
    """What to give in place of a file that belongs to a capture, as the end of a message."""
    inside = any(is_file(path.parent / name) for name in (CAPTURE_FILE, PLAN_FILE))
    return f"; it belongs to a capture: give its folder, {path.parent}" if inside else ""


def images_of(folder: Path) -> list[Path]:
    """Images of a folder by name, numbers by their value."""
    suffixes = IMAGE_SUFFIXES + TIFF_SUFFIXES
    # Names that begin with a dot are unfinished files, and thumbnails of other programs.
    files = [p for p in folder.iterdir() if is_file(p) and not p.name.startswith(".")]
    # Cameras write a JPEG beside each raw file.
    found = [p for p in files if p.suffix.lower() in suffixes] or [
        p for p in files if p.suffix.lower() in PHOTOGRAPH_SUFFIXES
    ]
    if not found:
        kinds = Counter(p.suffix.lower() for p in folder.iterdir() if is_file(p) and p.suffix)
        others = [(kind, n) for kind, n in kinds.most_common() if kind not in OTHER_SUFFIXES]
        if others:
            told_kinds = ", ".join(f"{n} {kind} files" for kind, n in others[:MOST_NAMES])
            raise FileProblem(
                f"{folder}: expected images ({', '.join(suffixes)}), got {told_kinds}"
                f"{_instead({kind for kind, _ in others})}"
            )
        arrays = [kind for kind in (".npy", ".npz") if kinds[kind]]
        if arrays:
            raise FileProblem(
                f"{folder}: expected images ({', '.join(suffixes)}), got {kinds[arrays[0]]} "
                f"{arrays[0]} files; give one file that holds all frames, (n, h, w), as the capture"
            )
    if len(found) == 1 and found[0].suffix.lower() in TIFF_SUFFIXES:
        raise FileProblem(
            f"{folder}: expected one image per frame, got one TIFF; name it as the capture itself"
        )
    return by_name(found)


def _instead(kinds: set[str]) -> str:
    """What to do with files of these kinds in place of images, as the end of a message."""
    if kinds <= set(VIDEO_SUFFIXES):
        return "; a capture is one video: give one of them"
    return ", which are not read; convert them first"


def video_in(folder: Path) -> str | None:
    """Name of the only video in a folder without images; None for others."""
    names = [p.name for p in folder.iterdir() if is_file(p) and not p.name.startswith(".")]
    videos = [name for name in names if Path(name).suffix.lower() in VIDEO_SUFFIXES]
    images = (*IMAGE_SUFFIXES, *TIFF_SUFFIXES, *PHOTOGRAPH_SUFFIXES)
    alone = not any(Path(name).suffix.lower() in images for name in names)
    return videos[0] if alone and len(videos) == 1 else None


def _read_file(
    path: Path, taken: _Channels, plan: PatternPlan
) -> tuple[Sequence[NDArray[Any]], bool, tuple[str, ...]]:
    """The frames of a file, whether they are lossily compressed, and what was done to them."""
    stack, lossy = open_stack_file(path)
    channels, mosaic, named = taken
    if channels == BEST:
        raise FileProblem(f"{path}: expected a folder of colour images for their best combination")
    if path.suffix.lower() in VIDEO_SUFFIXES:
        if named or mosaic:
            raise FileProblem(f"{path}: expected images for their channels, got a video")
        stack, notes = frames_of_plan(path, stack, plan.frames)
        return list(sealed(stack)), lossy, notes
    if mosaic:
        return [sealed(plane_of_image(page, mosaic, channels)[0]) for page in stack], lossy, ()
    if channels and (named or stack.ndim == 4):
        if stack.ndim != 4 or stack.shape[3] < len(CHANNELS):
            raise FileProblem(
                f"{path}: expected colour frames of shape (n, h, w, 3) for their channels "
                f"{channels}, got {stack.shape}"
            )
        places = [CHANNELS.index(letter) for letter in channels]
        return [sealed(page[..., k]) for page in stack for k in places], lossy, ()
    if stack.ndim != 3 or stack.size == 0:
        raise FileProblem(f"{path}: expected frames of shape (n, h, w), got {stack.shape}")
    return list(sealed(stack)), lossy, ()


def open_stack_file(path: Path) -> tuple[NDArray[Any], bool]:
    """The array of a file, which stays on disk where it can, and whether it is lossily compressed.

    Raises
    ------
    FileProblem for a file that cannot be read, and another suffix.
    """
    suffix, lossy = path.suffix.lower(), False
    if suffix in TIFF_SUFFIXES:
        from fringeworks.files.tiff import read_tiff  # 15 ms, for those only who read TIFF

        stack, lossy = read_tiff(path, on_disk=True)
    elif suffix == ".npy":
        with parsing(path, "a readable stack"):
            stack = np.load(path, mmap_mode="r", allow_pickle=False)
    elif suffix == ".npz":
        stack = read_npz(path, "a stack of frames", {"frames": f"{NUMBERS} nhw"})["frames"]
    elif suffix == ".mat":
        from fringeworks.files.mat import read_mat_frames  # for those only who read MATLAB's files

        stack = read_mat_frames(path)
    elif suffix in VIDEO_SUFFIXES:
        stack, lossy = read_video(path), True
    else:
        raise FileProblem(
            f"{path}: expected one of {', '.join(STACK_SUFFIXES)}, got {suffix or path.name}"
            f"{_part_of_capture(path)}"
        )
    return stack, lossy
