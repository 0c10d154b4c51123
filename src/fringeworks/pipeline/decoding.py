"""Decoding of stacks with what their files tell, and of several exposures of one scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from fringeworks.signal.response import check_devices
from fringeworks.stack.decode import decode
from fringeworks.stack.frames import Stack
from fringeworks.stack.fusing import fuse
from fringeworks.stack.options import DecodeOptions
from fringeworks.stack.unmeasured import unmeasured
from fringeworks.types import (
    Decoded,
    Finding,
    InputError,
    as_notes,
    explained,
    found_before,
)


def decoded(stack: Stack, options: DecodeOptions) -> Decoded:
    """Decode the frames of a stack; a response must be that of its devices."""
    response = options.get("response")
    if response is not None:
        check_devices(response, stack.camera, stack.projector)
    told = of_files(stack)
    with found_before(told):
        found = decode(stack.frames, stack.plan, **given_options(stack, options))
    return replace(found, findings=(*told, *found.findings, *unmeasured(found)))


def of_files(stack: Stack) -> tuple[Finding, ...]:
    """What reading the files found."""
    findings = [*as_notes(stack.notes, "files")]
    if stack.lossy:
        findings.append(
            Finding(
                "files",
                "the frames were compressed with loss (JPEG)",
                advice="store them without loss: the compression makes errors that no average "
                "removes",
            )
        )
    return tuple(findings)


def given_options(stack: Stack, options: DecodeOptions) -> DecodeOptions:
    """The options that are not None; without them, the stack's own saturation and count step."""
    known: Any = {name: value for name, value in options.items() if value is not None}
    merged: DecodeOptions = {"saturation": stack.saturation, "count_step": stack.count_step}
    if stack.noise is not None:
        merged["noise"] = stack.noise
    merged.update(known)
    return merged


def decoded_exposures(stacks: Sequence[Stack], options: DecodeOptions) -> Decoded:
    """Decode every exposure of a scene by itself, and fuse the results.

    Parameters
    ----------
    stacks : sequence of Stack
        One or several.
    options : DecodeOptions

    Returns
    -------
    Decoded, with a finding for every exposure that cannot be decoded and is left out.

    Raises
    ------
    InputError as ``decode`` where no exposure can be decoded, and for ``out`` with several of them.
    """
    if len(stacks) == 1:
        return decoded(stacks[0], options)
    if options.get("out") is not None:
        raise InputError(
            f"out: expected None for several exposures, got a result to reuse for {len(stacks)}"
        )
    results: list[Decoded] = []
    problems: list[tuple[int, InputError]] = []
    for number, stack in enumerate(stacks, 1):
        try:
            results.append(decoded(stack, options))
        except InputError as error:
            problems.append((number, error))
    unused = [
        Finding("exposures", f"exposure {number} of {len(stacks)} is not used: {error}")
        for number, error in problems
    ]
    if not results:
        raise explained(problems[0][1], unused[1:])
    found = fuse(results)
    return replace(found, findings=(*unused, *found.findings, *unmeasured(found)))
