"""Gray code of projector cells: what it is, and how it is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.patterns.chain_search import ROUNDING
from fringeworks.types import MOST_PX, Axis, FloatMap, Frozen, InputError, finite, whole

MAX_GRAY_BITS = 24
"""Largest number of bits of a Gray code.

The decoding kernel computes in single precision, which holds whole numbers exactly up to 2²⁴.
"""

MAX_GRAY_LEVELS = 16
"""Largest number of brightness levels of a Gray code.

With a modulation of 100 counts, 16 levels are 13 counts apart, which noise of 1 to 2 counts just
keeps apart. An empirical choice.
"""


NARROW_CONTRAST = 0.35
"""Share of its full contrast below which a bit of narrow cells, or without fringes, is in doubt.

It protects against wrong thresholds.

Light in the room that changes between the fringes and the code shifts the threshold. A bit that
passes by less than a third of its contrast may be wrong then. An empirical choice.
"""

DOUBT_SIGMAS = 4.0
"""Distance of a bit from its threshold below which it is in doubt, standard deviations: that of the
kernel, ``DOUBT_SIGMAS`` of ``decode/gray_code``."""

FRAME_MINUS_MEAN = 1.5
"""Variance of a bit less the mean of white and black, in variances of one frame."""

RESOLVED_SHARE = 0.5
"""Share of the lit pixels at which a bit must be firm to count as resolved. Borders of a bit that
is resolved take up to a third of its stripes."""

CELL_MARGIN = 1.1
"""Width of a cell that is proposed over the finest that is resolved, as blur is known to some per
cent. Between 1 and 1.4 the error of the coordinates is the same in simulations."""

WIDEST_CELL_PX = 1024
"""Widest cell that is tried, projector px: with blur beyond, a Gray code is of no use."""


def finest_cell(camera_pixel_px: float, blur_px: float, noise_ratio: float) -> int | None:
    """Width of the finest cells that a camera resolves, whole projector px; None for none.

    Parameters
    ----------
    camera_pixel_px : float > 0
        Projector px that a camera pixel spans.
    blur_px : float ≥ 0
        Standard deviation of the blur of camera and projector, camera px.
    noise_ratio : float > 0
        Standard deviation of a count over the modulation of the code.

    Notes
    -----
    Stripes of the finest bit are two cells wide, a square wave with a period of four cells. Blur
    and the area of a pixel take a share of each of its odd harmonics. The bit is resolved as for
    the decoder: it is firm, beyond the limits of doubt, at ``RESOLVED_SHARE`` of the pixels, those
    that are farthest from its borders.
    """
    limit = max(NARROW_CONTRAST, DOUBT_SIGMAS * FRAME_MINUS_MEAN**0.5 * noise_ratio)
    order = np.arange(1.0, 200.0, 2.0)
    for cell in range(1, WIDEST_CELL_PX + 1):
        wave = order * (0.5 * np.pi * CELL_MARGIN / cell)
        kept = np.exp(-0.5 * (wave * blur_px * camera_pixel_px) ** 2)
        kept *= np.sinc(wave * camera_pixel_px / (2.0 * np.pi))
        at = np.sin(order * (0.5 * np.pi * (1.0 - RESOLVED_SHARE)))
        if np.sum(4.0 / (np.pi * order) * kept * at) > limit:
            return cell
    return None


def check_axis(axis: str) -> None:
    """Refuse anything but x and y."""
    if axis not in ("x", "y"):
        raise InputError(f"axis: expected x or y, got {axis!r}")


@dataclass(frozen=True, eq=False, repr=False)
class GrayCode(Frozen):
    """Gray code that numbers cells along one axis.

    With more levels of brightness it is a reflected code of that base: digits instead of bits.
    """

    axis: Axis
    step_px: float
    """Width of a cell, projector px; ≥ 1. With fringes at most a period; half a period is best."""
    length_px: int
    """Length of the projector along the axis, px."""
    inverse: bool = False
    """Whether the inverse picture follows every bit; with two levels only."""
    offset_px: float = 0.0
    """Start of cell 0, projector px from the projector's edge; ≤ 0, such as −½ ``step_px``."""
    levels: int = 2
    """Number of levels of brightness, 2 to 16."""
    inverted: bool | tuple[int, ...] = False
    """Bits that are projected light for dark, 0 being the most significant one; True for all."""
    unused: int = 0
    """Number of finest bits that are projected but not decoded."""
    least_first: bool = False
    """Whether the least significant bit is projected first."""
    inverses_last: bool = False
    """Whether the inverse pictures follow after all bits, instead of each after its bit."""

    def __post_init__(self) -> None:
        check_axis(self.axis)
        if not whole(self.length_px, 2, MOST_PX):
            raise InputError(
                f"Gray code: expected a length of 2 to {MOST_PX} px, got {self.length_px}"
            )
        if not (finite(self.step_px) and self.step_px >= 1.0):
            raise InputError(f"Gray code: expected cells of 1 px or more, got {self.step_px:g} px")
        if not (finite(self.offset_px) and self.offset_px <= 0.0):
            raise InputError(
                "Gray code: expected cell 0 to begin at the projector's edge or before it, at an "
                f"offset of 0 px or less, got {self.offset_px:g} px"
            )
        most = 2 if self.inverse else MAX_GRAY_LEVELS
        if not 2 <= self.levels <= most:
            what = "2 levels with inverse pictures" if self.inverse else f"2 to {most} levels"
            raise InputError(f"Gray code: expected {what}, got {self.levels}")
        if self.cells < 2:
            raise InputError(
                f"Gray code: expected cells of less than the projector's {self.length_px} px, "
                f"got {self.step_px:g} px"
            )
        if self.cells > 2**MAX_GRAY_BITS:
            raise InputError(
                f"Gray code: expected 2^{MAX_GRAY_BITS} cells or fewer, got {self.cells}"
            )
        if not all(whole(bit, 0, self.bits - 1) for bit in self.inverted_bits):
            raise InputError(
                f"Gray code: expected inverted bits from 0 to {self.bits - 1}, got {self.inverted}"
            )
        if not whole(self.unused, 0, self.bits - 1):
            raise InputError(
                f"Gray code: expected 0 to {self.bits - 1} unused bits of {self.bits}, got "
                f"{self.unused}"
            )
        if self.inverses_last and not self.inverse:
            raise InputError(
                "Gray code: expected inverse pictures that come last, got a code without them"
            )

    @property
    def cells(self) -> int:
        """Number of cells; rounding adds none where the length is a whole number of them."""
        return math.ceil((self.length_px - self.offset_px) / self.step_px - ROUNDING)

    @property
    def bits(self) -> int:
        """Number of bits; of digits with more than two levels."""
        return next(n for n in range(1, MAX_GRAY_BITS + 1) if self.levels**n >= self.cells)

    @property
    def inverted_bits(self) -> frozenset[int]:
        """Bits that are projected light for dark."""
        if isinstance(self.inverted, bool):
            return frozenset(range(self.bits) if self.inverted else ())
        return frozenset(self.inverted)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.bits * (2 if self.inverse else 1)

    @property
    def together(self) -> int:
        """Number of pictures that follow each other for a bit: 2 with its inverse beside it."""
        return 2 if self.inverse and not self.inverses_last else 1

    @property
    def shown(self) -> tuple[int, ...]:
        """Number of the picture that is projected at each place.

        Pictures are numbered from the most significant bit on, with the inverse of a bit after it,
        as for ``values`` and ``labels``.
        """
        size = 2 if self.inverse else 1
        firsts = range(0, self.frames, size)[:: -1 if self.least_first else 1]
        if self.inverses_last:
            return (*firsts, *(k + 1 for k in firsts))
        return tuple(k + n for k in firsts for n in range(size))

    @property
    def used(self) -> GrayCode:
        """The code that is decoded, without the unused bits: its frames are the first of all."""
        if not self.unused:
            return self
        kept = self.bits - self.unused
        return replace(
            self,
            step_px=self.step_px * self.levels**self.unused,
            inverted=tuple(sorted(bit for bit in self.inverted_bits if bit < kept)),
            unused=0,
        )

    @property
    def mirrored(self) -> GrayCode:
        """The code that a mirror makes of this one.

        Numbered from the other end, a reflected code differs in its first digit alone, which is
        inverted. With an odd number of levels all digits are.
        """
        every = range(self.bits)
        changed = {0} if self.levels % 2 == 0 else set(every)
        words = self.levels**self.bits
        code = replace(
            self,
            # Words that no cell has come before the projector's edge then.
            offset_px=min(self.length_px - self.offset_px - words * self.step_px, 0.0),
            inverted=tuple(bit for bit in every if (bit in self.inverted_bits) != (bit in changed)),
        )
        if code.bits != self.bits:
            raise InputError(
                "Gray code: expected cell 0 to begin in the first half of the code to mirror it, "
                f"got an offset of {self.offset_px:g} px"
            )
        return code

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light that one frame sends to projector positions, 0…1.

        Parameters
        ----------
        position : float array of any shape, projector px
        frame : int, 0 … ``frames`` − 1
            From the most significant bit on, each followed by its inverse.
        """
        bit = frame // 2 if self.inverse else frame
        top = self.levels - 1
        cell = np.floor((position + 0.5 - self.offset_px) / self.step_px).astype(np.int64)
        before, digit = np.divmod(cell // self.levels ** (self.bits - 1 - bit), self.levels)
        # A digit falls where the digits before it form an odd number: the code is reflected.
        lit = np.where(before % 2, top - digit, digit) / top
        inverted = (bit in self.inverted_bits) != (self.inverse and frame % 2 == 1)
        return np.asarray(1.0 - lit if inverted else lit)

    def labels(self) -> list[str]:
        """One name per frame."""
        if not self.inverse:
            return [f"{self.axis}-gray-{b}" for b in range(self.bits)]
        return [f"{self.axis}-gray-{b}{i}" for b in range(self.bits) for i in ("", "-inverse")]
