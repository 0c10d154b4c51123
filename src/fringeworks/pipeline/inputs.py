"""The inputs of a chain: captures are read where a path is given, and recorded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.capture import read_capture
from fringeworks.files.exposures import is_exposures, read_exposures
from fringeworks.files.stack import read_stack
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    InputError,
    Pair,
    Source,
    fingerprint,
)


def pair_of(pair: Pair | StrPath) -> Pair:
    """The pair itself, or the one that is read from a path."""
    if isinstance(pair, (str, os.PathLike)):
        found = read_capture(pair)
        if isinstance(found, Stack):
            raise InputError(f"{pair}: expected a pair of frames, got a stack: measure it instead")
        return found
    if not isinstance(pair, Pair):
        raise InputError(f"pair: expected a Pair or a path, got {type(pair).__name__}")
    return pair


def capture_of(path: StrPath) -> Pair | tuple[Stack, ...]:
    """A capture, whatever it holds: a pair, or the stacks of all exposures of a scene."""
    if is_exposures(path):
        return read_exposures(path)
    found = read_capture(path)
    return found if isinstance(found, Pair) else (found,)


def stack_of(stack: Stack | StrPath) -> Stack:
    """The stack itself, or the one that is read from a path."""
    if isinstance(stack, (str, os.PathLike)):
        return read_stack(stack)
    if not isinstance(stack, Stack):
        raise InputError(f"stack: expected a Stack or a path, got {type(stack).__name__}")
    return stack


def stacks_of(source: Stack | Sequence[Stack] | StrPath) -> tuple[Stack, ...]:
    """The stacks of all exposures of a scene; a single one where there is one exposure.

    Raises
    ------
    InputError for no stacks, something else, and stacks of different plans.
    """
    if isinstance(source, (str, os.PathLike)):
        return read_exposures(source) if is_exposures(source) else (read_stack(source),)
    if not isinstance(source, Sequence):
        return (stack_of(source),)
    stacks = tuple(stack_of(one) for one in source)
    if not stacks:
        raise InputError("stack: expected at least one, got none")
    for number, stack in enumerate(stacks[1:], 2):
        if stack.plan != stacks[0].plan:
            raise InputError(f"exposure {number}: expected the plan of the first, got another")
    return stacks


def inputs_of(*stacks: Stack) -> tuple[Source, ...]:
    """The files of stacks as inputs; their arrays where they were not read."""
    found: list[Source] = []
    for number, stack in enumerate(stacks, 1):
        before = f"exposure {number}: " if len(stacks) > 1 else ""
        named = zip(stack.plan.labels(), stack.frames, strict=False)
        arrays = {before + label: frame for label, frame in named} if not stack.sources else {}
        found += [*stack.sources, *sources_of(**arrays)]
    return tuple(found)


def sources_of(**arrays: Any) -> tuple[Source, ...]:
    """Arrays as inputs, by the hash of their values."""
    known: Mapping[str, Any] = {n: a for n, a in arrays.items() if a is not None}
    return tuple(Source(name, fingerprint(np.asarray(array))) for name, array in known.items())
