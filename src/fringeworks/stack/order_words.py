"""Messages about the order of Gray-code frames, in the words of a plan."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from fringeworks.patterns.plan import GrayCode, PatternPlan
from fringeworks.stack.other_orders import LISTED
from fringeworks.types import InputError

PHRASES = {
    "least_first": "with the least significant bit",
    "inverses_last": "come after all bits",
    "bits_in_turn": "bits of both axes in turn",
}
"""What a message about another order says, by the word of the plan that states it."""
OPPOSITES = {
    "least_first": "with the most significant bit",
    "inverses_last": "follow each after its bit",
}
"""What it has to say where the plan has the word already."""


@contextmanager
def in_words_of(plan: PatternPlan) -> Iterator[None]:
    """Let messages about the order of frames name what the plan has to say instead.

    Frames are judged in the order of the bits, whatever the plan says of theirs. An order that is
    found there is the opposite of what the plan says.
    """
    try:
        yield
    except InputError as error:
        text = str(error)
        now = _said(plan)
        found = {key: not now[key] for key, phrase in PHRASES.items() if phrase in text}
        if found and LISTED in text:
            where = "at the top" if "bits_in_turn" in found else "in the entries of the Gray codes"
            text = text.replace(LISTED, f"; write {_listed(found)} in plan.toml, {where}")
        for key, opposite in OPPOSITES.items():
            text = text.replace(PHRASES[key], opposite) if now[key] else text
        text = _of_one_axis(text, plan)
        if any(now.values()):
            text += f"; this plan says {_listed({key: True for key in now if now[key]})}"
        if text == str(error):
            raise
        raise type(error)(text) from error


def _of_one_axis(text: str, plan: PatternPlan) -> str:
    """A message about a Gray code whose bits come from the other end, with what its plan says."""
    for code in plan.blocks:
        of_code = f"the Gray code along {getattr(code, 'axis', '')} begins with its"
        if isinstance(code, GrayCode) and f"{of_code} least" in text:
            if code.least_first:
                text = text.replace(f"{of_code} least", f"{of_code} most")
            first = "false" if code.least_first else "true"
            text += f"; write least_first = {first} in the Gray code along {code.axis} of plan.toml"
    return text


def _said(plan: PatternPlan) -> dict[str, bool]:
    """What a plan says about the order of bits."""
    codes = [block for block in plan.blocks if isinstance(block, GrayCode)]
    return {
        "least_first": any(code.least_first for code in codes),
        "inverses_last": any(code.inverses_last for code in codes),
        "bits_in_turn": plan.bits_in_turn,
    }


def _listed(values: dict[str, bool]) -> str:
    """Words of a plan with their values."""
    return " and ".join(f"{key} = {'true' if value else 'false'}" for key, value in values.items())
