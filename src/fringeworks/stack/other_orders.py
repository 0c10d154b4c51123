"""Orders in which other programs show the frames of a plan: of blocks, of bits, and of inverses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

from fringeworks.patterns.plan import Block, GrayCode, PatternPlan, PhaseSteps, Uniform

LISTED = "; list the frames in the plan's order as frames = [...] in capture.toml"
"""What helps where a plan cannot say the order."""
IN_PLAN = "; write the sequence of plan.toml in this order"
"""What helps where it can."""
INVERTED = "; a plan says so by inverted = true"
"""What helps where light and dark are exchanged."""

IN_TURN = 2
"""Number of conventions that bits of two axes in turn count for: few programs show them so."""

Places = tuple[int, ...]
"""Frame of the stack that shows each pattern of the plan."""


@dataclass(frozen=True)
class OtherOrder:
    """One order, and how far it is from the plan's."""

    places: Places
    inverted: frozenset[int]
    """Patterns that are shown with light and dark exchanged."""
    changes: int
    """Number of conventions that differ from the plan's."""
    words: str
    advice: str
    exchanged: bool
    """Whether the rows come before the columns where the plan has them after, or vice versa."""


@dataclass(frozen=True)
class _Group:
    """Blocks that stay together: the light, or one block of fringes or Gray code."""

    kind: str
    axis: str
    frames: tuple[int, ...]
    together: int = 1
    """Number of frames that follow each other: 2 for a bit and its inverse."""

    @property
    def words(self) -> str:
        if self.kind == "light":
            return "white and black"
        return f"{self.kind} along {self.axis}" if len(self.axis) == 1 else self.kind


def orders_of_other_programs(plan: PatternPlan) -> Iterator[OtherOrder]:
    """Orders by the conventions of other programs, each at most once; not the plan's own.

    One change of the Gray code along a single axis is not among them.
    """
    parts = [(first, block) for first, block in plan.placed if block.frames]
    codes = [(first, block) for first, block in parts if isinstance(block, GrayCode)]
    separable = any(block.inverse for _, block in codes)
    seen: set[tuple[Places, frozenset[int]]] = {(tuple(range(plan.frames)), frozenset())}
    least = 1 if len(codes) > 1 else 2
    every = product((False, True), repeat=3) if codes else [(False, False, False)]
    for last, apart, dark in every:
        if apart and not separable:
            continue
        inner = last + apart + dark
        inverted = frozenset(k for f, b in codes for k in range(f, f + b.frames) if dark)
        bits = {first: _bits(first, block, last, apart) for first, block in codes}
        arranged = next(_arrangements(parts, bits))[0]
        for groups, moved in _arrangements(parts, bits):
            shown = [k for group in groups for k in group.frames]
            if moved and shown == [k for group in arranged for k in group.frames]:
                continue
            places = tuple(sorted(range(plan.frames), key=shown.__getitem__))
            exchanged = _axes_of(groups) != _axes_of(arranged)
            # Rows in place of columns alone: lines do not tell that from a wrong size.
            alone = exchanged and not inner and _kinds_of(groups) == _kinds_of(arranged)
            usual = not moved and not apart and inner < least
            if alone or usual or (places, inverted) in seen:
                continue
            seen.add((places, inverted))
            words = _words(groups if moved else [], last, apart, dark, len(codes))
            advice = LISTED if last or apart or moved == IN_TURN else IN_PLAN if moved else ""
            yield OtherOrder(
                places,
                inverted,
                inner + moved,
                words,
                advice + (INVERTED if dark else ""),
                exchanged,
            )


def _bits(first: int, block: GrayCode, last: bool, apart: bool) -> tuple[int, ...]:
    """Frames of a Gray code, from the most or the least significant bit on, and with the inverses
    beside the bits or after all of them."""
    size = 2 if block.inverse else 1
    starts = list(range(first, first + block.frames, size))[:: -1 if last else 1]
    if apart and size > 1:
        return (*starts, *(k + 1 for k in starts))
    return tuple(k + j for k in starts for j in range(size))


def _arrangements(
    parts: list[tuple[int, Block]], bits: dict[int, tuple[int, ...]]
) -> Iterator[tuple[list[_Group], int]]:
    """Orders of the blocks, and how unusual each is; 0 for the plan's."""
    groups: list[_Group] = []
    light: list[int] = []
    for first, block in parts:
        frames = bits.get(first, tuple(range(first, first + block.frames)))
        if isinstance(block, Uniform):
            light += frames
            if len(light) == len(frames):
                groups.append(_Group("light", "", ()))
        else:
            kind = "fringes" if isinstance(block, PhaseSteps) else "Gray code"
            pair = isinstance(block, GrayCode) and block.inverse and frames[1] == frames[0] + 1
            groups.append(_Group(kind, block.axis, frames, 2 if pair else 1))
    groups = [_Group(g.kind, g.axis, tuple(light)) if g.kind == "light" else g for g in groups]
    yield groups, 0
    for kinds in permutations(("fringes", "Gray code", "light")):
        for axes, by_axis in product(("xy", "yx"), (False, True)):
            order = sorted(groups, key=lambda g: _key(g, kinds, axes, by_axis))
            yield order, 1
    codes = [g for g in groups if g.kind == "Gray code"]
    if len(codes) == 2:
        for a, b in (codes, codes[::-1]):
            both = _Group("bits of both axes in turn", a.axis + b.axis, _in_turn(a, b))
            rest = [g for g in groups if g.kind != "Gray code"]
            for at in range(len(rest) + 1):
                yield [*rest[:at], both, *rest[at:]], IN_TURN


def _key(group: _Group, kinds: tuple[str, ...], axes: str, by_axis: bool) -> tuple[int, int, int]:
    """Place of a group: by axis and then by kind, or the other way round; the light at an end."""
    kind, axis = kinds.index(group.kind), "xy".find(group.axis) * (1 if axes == "xy" else -1)
    if group.kind == "light":
        return (-1 if kind == 0 else 9, 0, 0)
    return (axis, kind, 0) if by_axis else (kind, axis, 0)


def _kinds_of(groups: list[_Group]) -> list[str]:
    """Kinds of the blocks in their order."""
    return [group.kind for group in groups]


def _axes_of(groups: list[_Group]) -> str:
    """Axes in the order in which they occur first."""
    return "".join(dict.fromkeys(letter for g in groups for letter in g.axis if letter in "xy"))


def _in_turn(a: _Group, b: _Group) -> tuple[int, ...]:
    """Frames of two codes in turn."""
    out: list[int] = []
    for k in range(max(len(a.frames), len(b.frames))):
        for group in (a, b):
            out += group.frames[k * group.together : (k + 1) * group.together]
    return tuple(out)


def _words(groups: list[_Group], last: bool, apart: bool, dark: bool, codes: int) -> str:
    """The order in words."""
    every = "the Gray codes" if codes > 1 else "the Gray code"
    said = []
    # White and black at the end may have been computed from the frames.
    groups = groups[:-1] if groups and groups[-1].kind == "light" else groups
    if groups:
        said.append(f"the frames show {', '.join(group.words for group in groups)}, in this order")
    if last:
        said.append(f"{every} begin{'' if codes > 1 else 's'} with the least significant bit")
    if dark:
        said.append(f"{every} {'are' if codes > 1 else 'is'} inverted, light for dark")
    if apart:
        said.append(f"the inverses of {every} come after all bits")
    return " and ".join(said)
