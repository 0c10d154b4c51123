"""The errors of the package. All of them are an ``InputError``."""

from __future__ import annotations


class InputError(ValueError):
    """The call cannot be done. The message says what was expected and what came."""


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
