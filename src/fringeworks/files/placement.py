"""The coordinates of points, as files name them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from fringeworks.files.provenance import LINE_LETTERS
from fringeworks.types import FileProblem, Placement

PLACEMENT = "placement"
"""Name of the entry that holds them, in NPZ, details and comments."""


def placement_as_dict(placement: Placement | None) -> dict[str, Any] | None:
    """A placement as JSON values; None for camera coordinates."""
    if placement is None:
        return None
    found: dict[str, Any] = {
        "frame": placement.frame,
        "T_frame_camera": placement.T_frame_camera.tolist(),
    }
    if placement.covariance is not None:
        found["covariance"] = placement.covariance.tolist()
    return found


def placement_from(content: object) -> Placement | None:
    """What ``placement_as_dict`` made; None for None.

    Raises
    ------
    FileProblem for anything else, and InputError for wrong values.
    """
    if content is None:
        return None
    if not isinstance(content, Mapping) or not {"frame", "T_frame_camera"} <= set(content):
        raise FileProblem("placement: expected a frame and T_frame_camera, got something else")
    try:
        return Placement(content["frame"], content["T_frame_camera"], content.get("covariance"))
    except (TypeError, ValueError) as error:
        if isinstance(error, FileProblem):
            raise
        raise FileProblem(f"placement: {error}") from error


def placement_json(placement: Placement | None) -> str | None:
    """A placement as one line of JSON; None for camera coordinates."""
    return None if placement is None else json.dumps(placement_as_dict(placement))


def placement_from_json(text: str | None) -> Placement | None:
    """What ``placement_json`` wrote; None for None."""
    return placement_from(json.loads(text)) if text else None


def placement_lines(placement: Placement | None) -> list[str]:
    """A placement as lines of a header of comments."""
    text = placement_json(placement) or ""
    pieces = [text[k : k + LINE_LETTERS] for k in range(0, len(text), LINE_LETTERS)]
    return [f"{PLACEMENT} {piece}" for piece in pieces]


def placement_of_comments(lines: Iterable[str]) -> Placement | None:
    """What ``placement_lines`` wrote, among other comments."""
    start = f"{PLACEMENT} "
    return placement_from_json(
        "".join(line[len(start) :] for line in lines if line.startswith(start))
    )
