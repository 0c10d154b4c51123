"""What the reasons of pixels without a value mean, what to change, and their colours."""

from __future__ import annotations

from typing import NamedTuple

from fringeworks.types import Reason


class ReasonWords(NamedTuple):
    """A reason in words."""

    label: str
    """Its name, as figures and tables show it."""
    meaning: str
    """Why the pixel has no value."""
    advice: str
    """What to change so that it gets one; empty where nothing is to be done."""


REASON_WORDS: dict[Reason, ReasonWords] = {
    Reason.OK: ReasonWords("measured", "the pixel has a value", ""),
    Reason.MASKED: ReasonWords(
        "masked",
        "the pixel was excluded, or its input is no number",
        "change the mask if the pixel is wanted",
    ),
    Reason.OUTSIDE: ReasonWords(
        "outside",
        "the matching point lies outside the projected or reference picture",
        "move the object into the projector's field, or widen that field",
    ),
    Reason.LOW_MODULATION: ReasonWords(
        "low modulation",
        "the fringes are too weak against the noise",
        "expose longer, focus the projector, darken the room, or spray dark surfaces",
    ),
    Reason.SATURATED: ReasonWords(
        "saturated",
        "the sensor is at its limit",
        "shorten the exposure, take several exposures, or spray glossy surfaces",
    ),
    Reason.ORDER_AMBIGUOUS: ReasonWords(
        "order ambiguous",
        "the fringe order cannot be decided",
        "expose longer, or use a plan with more margin (more steps, closer periods, Gray code)",
    ),
    Reason.OUT_OF_RANGE: ReasonWords(
        "out of range",
        "the intensity lies outside the matching part of the reference",
        "light the object and the reference alike, or use a method that fits the modulation",
    ),
    Reason.UNDETERMINED: ReasonWords(
        "undetermined",
        "no window around the pixel determines its displacement",
        "use finer fringes or more frames where the surface changes quickly",
    ),
    Reason.BEYOND_GEOMETRY: ReasonWords(
        "beyond geometry",
        "no point in front of both devices has this coordinate",
        "check that the rig or geometry belongs to this capture",
    ),
    Reason.SHADOW: ReasonWords(
        "shadow",
        "the projector does not light the pixel",
        "turn the object, or scan it again from another side",
    ),
    Reason.RAYS_APART: ReasonWords(
        "rays apart",
        "the rays of camera and projector do not meet",
        "calibrate again if a device was moved; avoid light between shiny surfaces",
    ),
    Reason.ISOLATED: ReasonWords(
        "isolated",
        "the value fits no surface through the neighbouring pixels",
        "use a plan with more margin, or keep such pixels with remove_isolated = False",
    ),
    Reason.OUTSIDE_DEPTH: ReasonWords(
        "outside depth range",
        "no depth in the given range has this coordinate",
        "widen the depth range if the surface is wanted",
    ),
}
"""The words for every reason."""
REASON_COLOURS: dict[Reason, str] = {
    Reason.OK: "#eef2ee",
    Reason.MASKED: "#bbbbbb",
    Reason.OUTSIDE: "#555555",
    Reason.LOW_MODULATION: "#e69f00",
    Reason.SATURATED: "#d55e00",
    Reason.ORDER_AMBIGUOUS: "#cc79a7",
    Reason.OUT_OF_RANGE: "#f0e442",
    Reason.UNDETERMINED: "#56b4e9",
    Reason.BEYOND_GEOMETRY: "#009e73",
    Reason.SHADOW: "#222255",
    Reason.RAYS_APART: "#882255",
    Reason.ISOLATED: "#0072b2",
    Reason.OUTSIDE_DEPTH: "#999933",
}
"""One colour for every reason, the same in all pictures: the colours of Okabe and Ito, which colour
blindness leaves distinct, and dark or grey ones for the rest."""
