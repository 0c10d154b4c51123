"""Nominal faces: what a drawing says a face of a part is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from fringeworks.types.checks import finite
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen

FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "free-form"]
Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class NominalFace(Frozen):
    """A face of a drawing, with its nominal form.

    Raises
    ------
    InputError for an unknown kind, and for numbers that are not finite.

    Examples
    --------
    >>> import fringeworks as fw
    >>> bore = fw.evaluate.NominalFace(11, "cylinder", "bore", radius_mm=6.0)
    >>> bore.title, bore.radius_mm
    ('bore', 6.0)
    """

    number: int
    """Its number in the drawing, from 1."""
    kind: FaceKind
    """Nominal form."""
    name: str = ""
    """Its name in the drawing; empty where it has none."""
    origin_mm: Vector = (0.0, 0.0, 0.0)
    """A point of a plane or of the axis of a cylinder, the apex of a cone, the centre of a sphere
    or a torus, mm."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Normal of a plane, or axis, of length 1; of a cone from the apex into it."""
    radius_mm: float | None = None
    """Radius of a cylinder or sphere, or that of the centre line of a torus, mm."""
    tube_mm: float | None = None
    """Radius of the tube of a torus, mm."""
    half_angle_deg: float | None = None
    """Angle between axis and surface of a cone, degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kind not in get_args(FaceKind):
            known = ", ".join(get_args(FaceKind))
            raise InputError(f"face: expected a kind of {known}, got {self.kind!r}")
        numbers = (self.radius_mm, self.tube_mm, self.half_angle_deg)
        given = [value for value in numbers if value is not None]
        if not finite(*self.origin_mm, *self.axis, *given):
            raise InputError(f"face {self.number}: expected finite numbers, got others")

    @property
    def title(self) -> str:
        """Name or number, for tables and messages."""
        return self.name or f"face {self.number}"


def face_named(faces: tuple[NominalFace, ...], wanted: str | int) -> NominalFace:
    """Return the face of a drawing with this name or number.

    Raises
    ------
    InputError where no face has it, or several have.
    """
    text = str(wanted)
    found = [face for face in faces if face.name == text]
    if not found and text.isascii() and text.isdigit():
        found = [face for face in faces if face.number == int(text)]
    if len(found) == 1:
        return found[0]
    if found:
        numbers = ", ".join(str(face.number) for face in found)
        raise InputError(
            f"face {text!r}: expected one face of this name, got the faces {numbers}; give a number"
        )
    if not faces:
        raise InputError(
            f"face {text!r}: expected a model with faces (.step, .stp, .igs, .iges), got triangles"
        )
    names = ", ".join(face.title for face in faces[:MOST_LISTED])
    more = f" and {len(faces) - MOST_LISTED} more" if len(faces) > MOST_LISTED else ""
    raise InputError(f"face {text!r}: expected one of the model's, got none; it has {names}{more}")


MOST_LISTED = 12
"""Faces that a message lists."""
