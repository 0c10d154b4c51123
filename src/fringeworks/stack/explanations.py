"""Which explanations of a stack's frames count, and how they are named."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fringeworks.stack.hypothesis import Hypothesis
from fringeworks.stack.other_patterns import FAR_BETTER
from fringeworks.types import Axis, FloatMap

Explanation = tuple[float, Hypothesis]
"""What a hypothesis gains over the plan, and the hypothesis with the share that it explains."""

FITS = 0.6
"""Largest mean cost of an order that explains the frames; unrelated frames have 1 or more."""

EXPLAINED = 0.5
"""Smallest share that a fault explains of the cost of the votes that it changes. True ones explain
0.65 to 1 in simulations; what right captures leave to chance, such as another number of bits, a
third."""

COUNT_EXPLAINED = 0.75
"""The same for another number of steps. A scene that moves from frame to frame looks like one, by
0.57 at one speed."""

LEAST_EXPLAINED = 0.15
"""Smallest share of all that contradicts the plan, for faults that concern all votes, and for what
is named as the nearest fault of frames that the plan does not fit. Signs of all sets that a right
capture leaves open change it by 0.01 to 0.03, at the ends of the range."""

OF_ALL = ("set", "sets")
"""Kinds of faults that concern all votes: other signs and starts of steps."""

MOVES = "moving"
"""Kind of a camera or a scene that moves all the time."""

IN_MOTION = ("moved", MOVES)
"""Kinds of a camera or a scene that moves, once or all the time."""

CONSISTENT = (*OF_ALL, "empty")
"""Kinds of causes that motion from frame to frame does not look like: other signs and starts, and
frames without a pattern."""

EQUALLY_GOOD = 0.05
"""Share of the gain up to which two orders count as equally good. Blur and noise make less."""

MAX_NAMED = 3
"""At most this many orders of one kind are named."""

OWN_AXES = 0.5
"""An order that exchanges the axes is not named where one that keeps them has more than this share
of its gain. Where the axes are kept, that share is 0.6 or more in simulations."""

PREFERRED = ("period", "steps", "", "sets", "set", "moved", MOVES, "start")
"""Kinds of explanations in the order in which equally good ones are named; "" stands for others."""


def near(found: Explanation, planned: Mapping[Axis, FloatMap]) -> bool:
    """Whether an explanation may be the cause: it explains most of what contradicts the plan where
    it says anything else, or some of all where the plan does not fit. Rows of strong indirect
    light, as at the crease of wall and floor, are rough under every order, and so is noise."""
    gain, h = found
    cost = float(sum(np.sum(part) for part in planned.values()))
    some = gain > LEAST_EXPLAINED * cost
    if gain > 0.0 and h.explained > (COUNT_EXPLAINED if h.kind == "count" else EXPLAINED):
        return some or h.kind not in OF_ALL
    # Distances and speeds are looked for, so that some of what dim light leaves fits one.
    free = h.kind in ("count", *IN_MOTION)
    return some and not h.band and not free and unfit(planned)


def unfit(planned: Mapping[Axis, FloatMap]) -> bool:
    """Whether the plan does not fit the frames at all."""
    return float(np.mean(np.concatenate(list(planned.values())))) > FITS


def with_one_start(found: list[Explanation]) -> list[Explanation]:
    """The explanations without those by the start of a set of which several fit as well, if there
    are others: such a set rather has other fringes than another start."""
    gains: dict[str, list[float]] = {}
    for gain, h in best_first(found):
        gains.setdefault(h.words.split("(")[0], []).append(gain)

    def vague(h: Hypothesis) -> bool:
        first, *others = gains[h.words.split("(")[0]]
        return h.kind == "set" and max(others, default=0.0) > (1.0 - EQUALLY_GOOD) * first

    return [(gain, h) for gain, h in found if not vague(h)] or found


def with_own_axes(found: list[Explanation]) -> list[Explanation]:
    """The explanations without those that exchange columns and rows, where others fit: what
    changes across the lines of an axis is smooth along them, and would cost nothing."""
    own = [(gain, h) for gain, h in found if not h.exchanged]
    best = [max((gain for gain, _ in which), default=0.0) for which in (own, found)]
    return own if best[0] > OWN_AXES * best[1] else found


def in_words(found: list[Explanation], *, vague: bool = False) -> str:
    """The explanations that are equally good, as a message; ``vague`` where the best explains only
    some of what contradicts the plan."""
    found = best_first(found)
    best = found[0][0]
    good = [h for gain, h in found if gain > best - max(FAR_BETTER, EQUALLY_GOOD * best)]
    good = _simplest(good)
    good.sort(key=lambda h: PREFERRED.index(h.kind if h.kind in PREFERRED else ""))
    # Motion comes first where it explains the frames better than other steps: of what contradicts
    # the plan, and of the votes that it changes.
    _, likeliest = max(found, key=lambda one: one[0] * one[1].explained)
    good.sort(key=lambda h: likeliest.kind not in IN_MOTION or h.kind != likeliest.kind)
    named: dict[str, list[str]] = {}
    for h in good:
        named.setdefault(h.kind, []).append(h.words)
    causes = [" or ".join(list(dict.fromkeys(words))[:MAX_NAMED]) for words in named.values()]
    first, also = causes[0], "".join(f", or {cause}" for cause in causes[1:])
    if vague:
        first = (
            "the camera, the projector or the scene seems to have moved from frame to frame "
            "(vibration), or the plan is another: no single fault explains most of what contradicts"
            f" the plan. Nearest is that {first}"
        )
    return (
        f"frames: {first}{also}, judging by how all frames agree; expected the frames of the plan "
        "in its order, of one scene at rest" + "".join(dict.fromkeys(h.advice for h in good))
    )


def best_first(found: list[Explanation]) -> list[Explanation]:
    """Explanations by what they gain, the best first."""
    return sorted(found, key=lambda one: -one[0])


def _simplest(good: list[Hypothesis]) -> list[Hypothesis]:
    """Without orders of other programs that differ more from the plan's than others that fit as
    well: codes of two axes may be exchanged and read from the other end."""
    least = min((h.changes for h in good if h.changes), default=0)
    if not least:
        return good
    return [h for h in good if h.changes in (0, least) and h.kind != "reversed"]
