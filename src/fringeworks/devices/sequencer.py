"""Projectors that play a sequence of pictures at their own pace and send a pulse for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, Protocol, runtime_checkable

from numpy.typing import NDArray

from fringeworks.devices.protocols import Closing, Projector
from fringeworks.types import DeviceProblem, InputError, check_fields, finite, whole

LONGEST_US = 2**24 - 1
"""Longest exposure and period, µs: three bytes hold it in the commands of the DLPC900."""
Edge = Literal["rising", "falling"]
"""Edge of a pulse."""
LEDS = ("off", "red", "green", "yellow", "blue", "magenta", "cyan", "white")
"""Colours by the controllers' number: bit 0 is red, bit 1 green, bit 2 blue."""


@dataclass(frozen=True)
class SequenceSettings:
    """How a projector plays a sequence.

    Raises
    ------
    InputError for a value out of its range.
    """

    exposure_us: int = 20_000
    """Time for which a picture is shown, µs; the projector has a shortest one for each depth."""
    period_us: int | None = None
    """Time from one picture to the next, µs; as long as the exposure by default. It is dark
    between them."""
    bits: Literal[1, 8] = 8
    """Depth of the pictures."""
    colour: str = "white"
    """Which light sources are on: one of ``LEDS``."""
    trigger_in: Edge | None = None
    """Edge on the trigger input that shows the next picture; None for the projector's own pace."""
    trigger_in_delay_us: float = 105.0
    """Time from that edge until the picture appears, µs."""
    trigger_out: Literal["high", "low"] = "high"
    """Level of the trigger output while a picture is shown."""
    trigger_out_delay_us: float = 0.0
    """Time by which the pulse begins after the picture, µs; negative before it."""
    trigger_out_end_delay_us: float = 0.0
    """Time by which the pulse ends after the picture, µs."""

    def __post_init__(self) -> None:
        period = self.exposure_us if self.period_us is None else self.period_us
        delays = self.trigger_out_delay_us, self.trigger_out_end_delay_us
        check_fields(
            self,
            exposure_us=(whole(self.exposure_us, 1, LONGEST_US), f"1 to {LONGEST_US} µs"),
            period_us=(
                whole(period, 1, LONGEST_US) and period >= self.exposure_us,
                "the exposure or more",
            ),
            bits=(self.bits in (1, 8), "1 or 8"),
            colour=(self.colour in LEDS, f"one of {', '.join(LEDS)}"),
            trigger_in=(self.trigger_in in (None, "rising", "falling"), "rising or falling"),
            trigger_in_delay_us=(
                finite(self.trigger_in_delay_us) and self.trigger_in_delay_us >= 0,
                ">= 0",
            ),
            trigger_out=(self.trigger_out in ("high", "low"), "high or low"),
            trigger_out_delay_us=(finite(*delays), "a finite value"),
        )

    @property
    def period_s(self) -> float:
        """Time from one picture to the next, s."""
        return 1e-6 * (self.exposure_us if self.period_us is None else self.period_us)

    @property
    def lit_s(self) -> tuple[float, float]:
        """Times after the pulse at which its picture begins and ends, s."""
        begins_us = -self.trigger_out_delay_us
        return 1e-6 * begins_us, 1e-6 * (begins_us + self.exposure_us)

    @property
    def dark_us(self) -> int:
        """Time without light after a picture, µs."""
        return 0 if self.period_us is None else self.period_us - self.exposure_us


def settings_of(words: str, kind: str) -> tuple[str, SequenceSettings]:
    """Read the words after a projector's colon: which one, and ``name=value`` after commas.

    Parameters
    ----------
    words : str
        Such as ``5,exposure_us=8000,trigger_out=low``.
    kind : str
        Name of the kind, for messages.

    Returns
    -------
    The part without ``=``, empty where there is none, and the settings.

    Raises
    ------
    DeviceProblem for a name that is no field of ``SequenceSettings``, or a value that does not fit.

    Examples
    --------
    >>> settings_of("exposure_us=8000,bits=1", "dlpc900")[1].exposure_us
    8000
    """
    which, settings = "", SequenceSettings()
    names = {field.name: field.type for field in fields(SequenceSettings)}
    changed: dict[str, Any] = {}
    for part in words.split(",") if words else []:
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals and not which and not changed:
            which = name
            continue
        if not equals or name not in names:
            raise DeviceProblem(
                f"{kind}: expected name=value with one of {', '.join(names)} after a comma, got "
                f"{part!r}"
            )
        try:
            number = "int" in str(names[name]) or name == "bits"
            delay = "float" in str(names[name])
            changed[name] = int(value) if number else float(value) if delay else value
        except ValueError as error:
            raise DeviceProblem(f"{kind}: {name}: expected a number, got {value!r}") from error
    try:
        return which, replace(settings, **changed)
    except InputError as error:
        raise DeviceProblem(f"{kind}: {error}") from error


class Timed(Closing):
    """Mix-in of projectors that play as their ``settings`` say."""

    settings: SequenceSettings

    @property
    def bits(self) -> int:
        """Depth of the pictures."""
        return self.settings.bits

    @property
    def refresh_s(self) -> float:
        """Time from one picture to the next, s."""
        return self.settings.period_s

    @property
    def period_s(self) -> float:
        """Time from one picture to the next, s."""
        return self.settings.period_s

    @property
    def lit_s(self) -> tuple[float, float]:
        """Times after the pulse at which its picture begins and ends, s."""
        return self.settings.lit_s


@runtime_checkable
class SequenceProjector(Projector, Protocol):
    """A projector that plays pictures at its own pace, with a pulse on its output for each.

    The output is connected to the trigger input of the camera, which exposes a frame for every
    pulse.
    """

    @property
    def period_s(self) -> float:
        """Time from one picture to the next, s."""

    @property
    def lit_s(self) -> tuple[float, float]:
        """Times after the pulse at which its picture begins and ends, s."""

    def portions(self, numbers: Sequence[int]) -> list[list[int]]:
        """Numbers of pictures in the portions that its memory holds at a time."""

    def load(self, pictures: Sequence[NDArray[Any]], numbers: Sequence[int]) -> None:
        """Take pictures into its memory, to be played once in their order.

        Parameters
        ----------
        pictures : sequence of (rows, columns) arrays of counts
        numbers : sequence of int
            Their numbers in the plan, from 0.

        Raises
        ------
        InputError for other pictures than it can show; DeviceProblem where the projector refuses
        or is gone.
        """

    def start(self) -> None:
        """Play the loaded pictures once, from the first one on."""

    def stop(self) -> None:
        """Show nothing."""


def least_exposure(
    name: str, settings: SequenceSettings, least_us: dict[int, int], spare_us: int = 0
) -> None:
    """Refuse an exposure that is shorter than the light engine needs for the depth.

    Parameters
    ----------
    name : str
    settings : SequenceSettings
    least_us : dict
        Shortest exposures by the depth, µs.
    spare_us : int
        Shortest dark time where there is any, µs.

    Raises
    ------
    InputError with the shortest exposure.
    """
    least = least_us[settings.bits]
    if settings.exposure_us < least:
        more = "" if settings.bits == 1 else f"; pictures of 1 bit take {least_us[1]} µs"
        raise InputError(
            f"{name}: exposure_us: expected {least} µs or more, the shortest exposure of pictures "
            f"of {settings.bits} bit, got {settings.exposure_us} µs{more}"
        )
    if 0 < settings.dark_us < spare_us:
        raise InputError(
            f"{name}: period_us: expected the exposure, or {spare_us} µs more than it, got "
            f"{settings.dark_us} µs more"
        )
