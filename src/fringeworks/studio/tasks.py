"""What the studio's workers do: each task calls the library as a command of ``fringeworks`` does.

They run in a worker's process, with a ``Link`` to the page first. What they return is small: files
hold the rest.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fringeworks.devices.opening import list_devices
from fringeworks.evaluate.inspect import inspect
from fringeworks.files.exposures import is_exposures
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.files.read_write import read
from fringeworks.files.rig import read_rig
from fringeworks.files.toml import kind_of
from fringeworks.pipeline.inputs import capture_of
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.pipeline.stacks import decode_stack, measure
from fringeworks.report.page.surfaces import is_surface, packed, surface_of
from fringeworks.report.summary import summarise
from fringeworks.scan.live_calibration import PoseTaker
from fringeworks.serving.worker import Link
from fringeworks.studio.workspace import Workspace
from fringeworks.types import Decoded, HeightMap, InputError, Pair, PointCloud, Points

PICTURE_PX = 960
"""Longer side of a picture to draw areas on, px."""
PIXELS = 2_000_000
"""Pixels of a surface that the page shows; larger ones are thinned, and the page says so."""

_POSES: dict[tuple[Path, str], PoseTaker] = {}
"""The judged poses by folder and board: earlier ones are not judged again for every new one."""


def find_devices(link: Link) -> tuple[list[str], list[str]]:
    """Words of the projectors and cameras that are there."""
    link.progress("looking for devices")
    return tuple([d.words for d in found if d.usable] for found in list_devices())  # type: ignore[return-value]


def judge(link: Link, space: Workspace, board: str) -> dict[str, Any]:
    """Judge the poses that lie in a folder, after one was deleted or the studio was opened."""
    link.progress("finding the board in the poses")
    _POSES.pop((space.poses, board), None)
    return judged(poses_of(space, board))


def poses_of(space: Workspace, board: str) -> PoseTaker:
    """The poses of a board in a studio's folder."""
    key = space.poses, board
    if key not in _POSES:
        _POSES[key] = PoseTaker(*key)
    return _POSES[key]


def judged(poses: PoseTaker) -> dict[str, Any]:
    """What the page shows of a judgement."""
    return {"judgement": str(poses.judgement), "enough": poses.judgement.enough}


How = Literal["inspect", "read", "reconstruct", "decode", "measure"]


@dataclass(frozen=True)
class Source:
    """What a result is computed from, and how; also as a command and as Python."""

    name: str
    """Of the capture or file, in the studio's folder."""
    path: Path
    """A capture, or a file that holds a result."""
    rig: Path | None
    """Rig file, for stacks; None gives their coordinates."""
    method: str
    """For pairs, as the options."""
    options: dict[str, Any]
    recipe: Path | None = None
    """A recipe that says within which area is measured."""
    settled_how: How | None = None
    """How it was made, once that is settled; otherwise its files tell."""
    settled_capture: bool | None = None
    """Whether it was a capture, once that is settled."""

    @property
    def is_capture(self) -> bool:
        """Whether it is a capture, and no file."""
        return self.path.is_dir() if self.settled_capture is None else self.settled_capture

    def settled(self) -> Source:
        """The same source, which says how it is made also when its files are gone."""
        return replace(self, settled_how=self.how, settled_capture=self.is_capture)

    @property
    def how(self) -> How:
        """What makes a result of it."""
        if self.settled_how is not None:
            return self.settled_how
        if self.recipe is not None:
            return "inspect"
        if not self.is_capture:
            return "read"
        if not is_stack(self.path):
            return "reconstruct"
        return "decode" if self.rig is None else "measure"

    @property
    def inspected(self) -> str:
        """Python that inspects it."""
        seen = repr(self.name) if self.is_capture else f"fw.read({self.name!r})"
        return f"fw.inspect({seen}, 'recipe.toml')"

    @property
    def python(self) -> tuple[str, str]:
        """Python that makes the result, and what takes the surface out of it."""
        options = "".join(f", {name}={value!r}" for name, value in self.options.items())
        return {
            "inspect": (f"{self.inspected}.surface", ""),
            "read": (f"fw.read({self.name!r})", ""),
            "reconstruct": (f"fw.reconstruct({self.name!r}, {self.method!r}{options})", ".surface"),
            "decode": (f"fw.decode({self.name!r})", ""),
            "measure": (f"fw.measure({self.name!r}, 'rig.toml')", ".points"),
        }[self.how]

    def shell(self, option: str, target: str) -> str:
        """The command that writes its result or report; empty where there is none."""
        name, how = shlex.quote(self.name), self.how
        if how == "read":
            report = option == "--report"
            return f"fringeworks {f'report {name} --out' if report else f'convert {name}'} {target}"
        if how == "inspect" and not self.is_capture:
            return ""
        words = {
            "inspect": "--recipe recipe.toml",
            "reconstruct": f"--method {self.method}{''.join(map(_option, self.options.items()))}",
            "decode": "",
            "measure": "--rig rig.toml",
        }[how]
        return " ".join(filter(None, ["fringeworks", how, name, words, option, target]))


def _option(given: tuple[str, Any]) -> str:
    """An option of a method, as the command line takes it."""
    name, value = given
    text = value if isinstance(value, str) else json.dumps(value)
    return f" --option {shlex.quote(f'{name}={text}')}"


def show(link: Link, source: Source, target: str) -> dict[str, Any]:
    """Compute or read a result, and pack it for the viewer."""
    result = compute(link, source)
    shown = next(iter(result.maps.values())) if isinstance(result, Decoded) else result
    if not is_surface(shown):
        raise InputError(f"{source.path.name}: expected a surface, got another result")
    link.progress("packing the surface")
    known = None if source.rig is None else read_rig(source.rig)
    every = thinning_of(shown)
    surface = packed(shown, title=source.path.name, camera=known, every=every)
    Path(target).write_bytes(surface.data)
    return {"figures": summarise(result), "every": every}


def is_stack(folder: Path) -> bool:
    """Whether a capture has the frames of a plan, and is no pair."""
    return is_exposures(folder) or kind_of(folder / CAPTURE_FILE) == "stack"


def compute(link: Link, source: Source) -> Any:
    """The result of a capture, or the one in a file."""
    how = source.how
    link.progress(DOES[how].format(method=source.method))
    if how == "inspect":
        assert source.recipe is not None
        return inspect(known(source), source.recipe).surface
    if how == "read":
        return read(source.path)
    if how == "reconstruct":
        return reconstruct(source.path, source.method, **source.options)
    if source.rig is None:
        return decode_stack(source.path)
    return measure(source.path, source.rig)


DOES: dict[How, str] = {
    "inspect": "measuring within the area",
    "read": "reading",
    "reconstruct": "measuring by {method}",
    "decode": "decoding and measuring",
    "measure": "decoding and measuring",
}
"""What is done, in words."""


def known(source: Source) -> Any:
    """What is inspected: a capture by its path, or the surface in a file."""
    if source.is_capture:
        return source.path
    result = read(source.path)
    if not isinstance(result, HeightMap | PointCloud):
        raise InputError(
            f"{source.path.name}: expected heights or points in the order of a frame's pixels, "
            "which areas need; .npz holds them"
        )
    return result


def draw_picture(link: Link, source: Source, target: str) -> dict[str, Any]:
    """Draw what the camera saw of a capture, or the depths of a result, as JPEG."""
    link.progress("drawing")
    values = picture_of(known(source))
    step = max(1, -(-max(values.shape) // PICTURE_PX))
    part = values[::step, ::step].astype(np.float64)
    low, high = np.nanpercentile(part, (1, 99)) if np.isfinite(part).any() else (0.0, 1.0)
    grey = 255.0 * np.clip((part - low) / max(high - low, 1e-12), 0.0, 1.0)
    image = Image.fromarray(np.nan_to_num(grey).astype(np.uint8))
    image.save(target, "JPEG", quality=90)
    return {"step": step, "size": [values.shape[1], values.shape[0]]}


def picture_of(known: Path | HeightMap | PointCloud) -> NDArray[Any]:
    """The brightness of a capture, or the heights or depths of a result, (h, w)."""
    if isinstance(known, HeightMap):
        return known.values
    if isinstance(known, PointCloud):
        return np.asarray(known.xyz_mm[..., 2])
    found = capture_of(known)
    if isinstance(found, Pair):
        return found.object
    mean = np.mean([np.asarray(frame, np.float32) for frame in found[0].frames], axis=0)
    return np.asarray(mean)


def thinning_of(result: Any) -> int:
    """Return every how many columns and rows of a result are shown."""
    inner = surface_of(result)
    pixels = len(inner.xyz_mm) if isinstance(inner, Points) else inner.reason.size
    return thinning(pixels, PIXELS)


def thinning(pixels: int, most: int) -> int:
    """Return every how many columns and rows are used so that at most so many pixels are."""
    return max(1, int(np.ceil(np.sqrt(pixels / most))))
