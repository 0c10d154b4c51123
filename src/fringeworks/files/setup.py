"""Set-ups on disk: which devices, their settings, and what was measured of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.beside import drop_earlier, name_beside
from fringeworks.files.capture_writer import SettingsSection, settings_of, settings_table
from fringeworks.files.description import Field, Section
from fringeworks.files.findings import finding_from_dict, findings_as_dicts
from fringeworks.files.limits import inside, parsing
from fringeworks.files.plan import holds_plan, read_plan, write_plan
from fringeworks.files.toml import Size, read_toml
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import (
    CameraNoise,
    CameraSettings,
    Delay,
    Finding,
    Frozen,
    InputError,
    fingerprint,
)

PLAN_SUFFIX = ".plan.toml"
"""Suffix of the plan's file beside the set-up's."""


class _Device(Section):
    """``[projector]`` and ``[camera]``: what opens the device, and its name."""

    open: str
    name: str


class _Projector(_Device):
    size_px: Size
    gamma: float = Field(gt=0)
    contrast: float = Field(gt=0)
    min_period_px: float = Field(gt=0)


class _Camera(_Device):
    pixel_px: float | None = Field(default=None, gt=0)
    """Projector px that a camera pixel spans."""
    blur_px: float = Field(default=0.0, ge=0)
    """Of camera and projector, camera px."""
    modulation: float = Field(gt=0)
    """Of the darkest tenth of the lit pixels, counts."""
    black_counts: float | None = None
    """Mean brightness of the lit pixels under black."""


class _Noise(Section):
    read_counts: float = Field(ge=0)
    gain: float = Field(ge=0)


class _Delay(Section):
    """``[delay]``: as ``Delay``, reduced to the figures that decide."""

    appears_s: float
    absent_s: float
    alone_s: float
    left_s: float
    refresh_s: float = Field(gt=0)
    frame_s: float = Field(gt=0)
    transit_s: tuple[float, float] | None = None


class SetupFile(Section):
    """The whole of a set-up file; unknown keys are refused."""

    projector: _Projector
    camera: _Camera
    settings: SettingsSection = SettingsSection()
    noise: _Noise
    delay: _Delay | None = None
    plan: str
    """File of the proposed plan, relative to this one."""
    predicted_sigma_px: float = Field(gt=0)
    findings: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StoredSetup(Frozen):
    """A set-up as a file holds it."""

    projector: str
    """Words that open the projector."""
    camera: str
    """Words that open the camera."""
    projector_name: str
    """Name of the projector."""
    camera_name: str
    """Name of the camera."""
    settings: CameraSettings
    noise: CameraNoise
    delay: Delay | None = None
    plan: PatternPlan
    predicted_sigma_px: float
    """Predicted standard deviation of coordinates that the plan measures, projector px."""
    findings: tuple[Finding, ...] = ()
    """What makes measurements worse, the most important first."""
    size_px: tuple[int, int]
    """Columns and rows of the projector."""
    min_period_px: float
    """Shortest period that the devices resolve, projector px."""
    camera_pixel_px: float | None = None
    """Projector px that a camera pixel spans. None in files of earlier versions."""
    blur_px: float = 0.0
    """Standard deviation of the blur of camera and projector, camera px."""
    modulation: float
    """Modulation of fringes at the darkest tenth of the lit pixels, counts."""
    gamma: float
    """Exponent of the response: light is proportional to the level to this power."""
    contrast: float
    """Light of white over that of black."""
    black_counts: float | None = None
    """Mean brightness of the lit pixels under black, counts: the camera's black level and the light
    of the room. None in files of earlier versions."""

    @property
    def noise_counts(self) -> float:
        """Standard deviation of the noise at these pixels, counts."""
        return float(np.sqrt(self.noise.variance(self.modulation)))


def check_setup_target(path: StrPath) -> None:
    """Refuse a set-up file that cannot be written, before anything is measured for it.

    Parameters
    ----------
    path : path

    Raises
    ------
    FileProblem for another suffix than ``.toml``, and where the folder is missing.
    """
    check_target(path, (".toml",))


def write_setup(
    path: StrPath,
    setup: Any,
    *,
    projector: str | None = None,
    camera: str | None = None,
) -> list[Path]:
    """Write a set-up as TOML, and its plan beside it.

    Parameters
    ----------
    path : path
    setup : Setup or StoredSetup
        A Setup tells what of it is stored, see ``Setup.stored``.
    projector, camera : str
        Words that open the devices of a Setup; see ``open_devices``. A StoredSetup has its own.

    Returns
    -------
    Both files.

    Raises
    ------
    InputError for a Setup without the words that open its devices.
    """
    if not isinstance(setup, StoredSetup):
        if projector is None or camera is None:
            raise InputError("set-up: expected the words that open projector and camera, got none")
        setup = setup.stored(projector, camera)
    stored: StoredSetup = setup
    path = Path(path)
    usual, proposed = path.stem + PLAN_SUFFIX, stored.plan
    plan = name_beside(path, usual, fingerprint(proposed), lambda p: holds_plan(p, proposed))
    write_plan(plan, proposed)
    write_text(path, tomli_w.dumps(_content(stored, plan.name)))
    drop_earlier(path, [usual], [plan.name])
    return [path, plan]


def _content(setup: StoredSetup, plan: str) -> dict[str, Any]:
    """The content of a set-up file."""
    content: dict[str, Any] = {
        "plan": plan,
        "predicted_sigma_px": setup.predicted_sigma_px,
        "findings": [
            {name: value for name, value in one.items() if value is not None}
            for one in findings_as_dicts(setup.findings)
        ],
        "projector": {
            "open": setup.projector,
            "name": setup.projector_name,
            "size_px": list(setup.size_px),
            "gamma": setup.gamma,
            "contrast": setup.contrast,
            "min_period_px": setup.min_period_px,
        },
        "camera": {
            "open": setup.camera,
            "name": setup.camera_name,
            "modulation": setup.modulation,
        },
        "settings": settings_table(setup.settings),
        "noise": {"read_counts": setup.noise.read_counts, "gain": setup.noise.gain},
    }
    if setup.camera_pixel_px is not None:
        content["camera"] |= {"pixel_px": setup.camera_pixel_px, "blur_px": setup.blur_px}
    if setup.black_counts is not None:
        content["camera"]["black_counts"] = setup.black_counts
    if setup.delay is not None:
        content["delay"] = _delay_table(setup.delay)
    return content


def read_setup(path: StrPath) -> StoredSetup:
    """Read a set-up and its plan.

    Raises
    ------
    FileProblem for anything missing or unknown, naming the file.
    """
    path = Path(path)
    content = read_toml(path, SetupFile)
    with parsing(path, "findings"):
        findings = tuple(map(finding_from_dict, content.findings))
    projector, camera = content.projector, content.camera
    delay = None
    if content.delay is not None:
        d = content.delay
        delay = Delay(
            np.array([d.appears_s]),
            np.array([d.absent_s]),
            np.array([d.alone_s]),
            np.array([d.left_s]),
            d.refresh_s,
            d.frame_s,
            d.transit_s,
        )
    return StoredSetup(
        projector=projector.open,
        camera=camera.open,
        projector_name=projector.name,
        camera_name=camera.name,
        settings=settings_of(content.settings),
        noise=CameraNoise(content.noise.read_counts, content.noise.gain),
        delay=delay,
        plan=read_plan(inside(path.parent, content.plan)),
        predicted_sigma_px=content.predicted_sigma_px,
        findings=findings,
        size_px=projector.size_px,
        min_period_px=projector.min_period_px,
        camera_pixel_px=camera.pixel_px,
        blur_px=camera.blur_px,
        modulation=camera.modulation,
        gamma=projector.gamma,
        contrast=projector.contrast,
        black_counts=camera.black_counts,
    )


def _delay_table(delay: Delay) -> dict[str, Any]:
    """The moments of a delay that decide when frames count."""
    table: dict[str, Any] = {
        "appears_s": float(delay.appears_s.min()),
        "absent_s": delay.absent_until_s,
        "alone_s": delay.alone_from_s,
        "left_s": float(delay.left_s.max()),
        "refresh_s": delay.refresh_s,
        "frame_s": delay.frame_s,
    }
    return table if delay.transit_s is None else table | {"transit_s": list(delay.transit_s)}
