"""The errors of the package. All of them are an ``InputError``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Self, TypeVar

if TYPE_CHECKING:
    from fringeworks.types.finding import Finding


class InputError(ValueError):
    """The call cannot be done. The message says what was expected and what came.

    Parameters
    ----------
    message : str
    findings : Finding
        What was found until then. Tracebacks show it below the message.
    """

    def __init__(self, message: str = "", *, findings: Iterable[Finding] = ()) -> None:
        super().__init__(message)
        self.findings: tuple[Finding, ...] = ()
        """What was found before the call could not go on, in the order of the chain."""
        self._keep(findings)

    @property
    def lines(self) -> tuple[str, ...]:
        """What to read, a line each: the findings, the most severe first, then the message."""
        worst = sorted(self.findings, key=lambda finding: -finding.rank)
        return (*(finding.line for finding in worst), str(self))

    def at(self, place: str) -> Self:
        """Return the same error, said of a place such as "camera 2", and so its findings."""
        error = type(self).__new__(type(self), f"{place}: {self}")
        error.__dict__.update(self.__dict__)
        error._keep(replace(f, seen=f"{place}: {f.seen}") for f in self.findings)
        return error

    def _keep(self, findings: Iterable[Finding]) -> None:
        self.findings = tuple(dict.fromkeys(findings))
        self.__notes__ = [finding.text for finding in self.findings]


Refusal = TypeVar("Refusal", bound=InputError)


def explained(error: Refusal, findings: Iterable[Finding]) -> Refusal:
    """Add what was found earlier to an error, and return it."""
    error._keep((*findings, *error.findings))
    return error


@contextmanager
def found_before(findings: Iterable[Finding]) -> Iterator[None]:
    """Add findings to the errors of the block: what a chain has found until then."""
    try:
        yield
    except InputError as error:
        explained(error, findings)
        raise


class FileProblem(InputError):
    """A file or folder is missing, damaged, of an unknown kind, or cannot be written."""


class FramesContradictPlan(InputError):
    """The frames of a stack do not follow their plan: missing, swapped, or of another plan."""


class BoardNotFound(InputError):
    """The calibration board is not in the image, or the projector does not light it."""


class RigMismatch(InputError):
    """A rig does not belong to the frames: other sizes, or rays that do not meet."""


class DeviceProblem(InputError):
    """A projector or camera is missing, in use, gone, or does not do what it was told."""


class UnknownMethod(InputError):
    """No method of that name is registered, or it does not have that option."""


class MissingPackage(InputError):
    """An optional package is not installed. The message says what to install."""


def check_fields(settings: object, **expectations: tuple[bool, str]) -> None:
    """Refuse settings with a wrong field.

    Parameters
    ----------
    settings : object
        Its attributes are checked.
    **expectations : (bool, str)
        For each attribute: whether it is right, and what was expected.

    Raises
    ------
    InputError for the first attribute that is not right.
    """
    for name, (ok, expected) in expectations.items():
        if not ok:
            raise InputError(f"{name}: expected {expected}, got {getattr(settings, name)}")
