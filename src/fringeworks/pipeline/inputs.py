"""The inputs of a chain: captures are read where a path is given, and recorded."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.capture import read_capture
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


def stack_of(stack: Stack | StrPath) -> Stack:
    """The stack itself, or the one that is read from a path."""
    if isinstance(stack, (str, os.PathLike)):
        return read_stack(stack)
    if not isinstance(stack, Stack):
        raise InputError(f"stack: expected a Stack or a path, got {type(stack).__name__}")
    return stack


def inputs_of(stack: Stack) -> tuple[Source, ...]:
    """The files of a stack as inputs; its arrays where it was not read."""
    return stack.sources or sources_of(**dict(zip(stack.plan.labels(), stack.frames, strict=False)))


def sources_of(**arrays: Any) -> tuple[Source, ...]:
    """Arrays as inputs, by the hash of their values."""
    known: Mapping[str, Any] = {n: a for n, a in arrays.items() if a is not None}
    return tuple(Source(name, fingerprint(np.asarray(array))) for name, array in known.items())
