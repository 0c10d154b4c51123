"""Trials on virtual scenes, whose truth is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fringeworks.evaluate.truth_errors import error_map
from fringeworks.pair.analyse import analyse, methods
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.pipeline.stacks import measure
from fringeworks.report.kinds.pair import as_heights
from fringeworks.report.viewer.pack import pack_surface
from fringeworks.rig.pinhole import pose
from fringeworks.serving.worker import Link
from fringeworks.simulate.bodies import Body, Box, Cylinder, Plane, Shape, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.objects import OBJECTS
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.rig_pair import pair_displacement, photograph_pair
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import (
    WALL_ALBEDO,
    bust,
    fringe_plan,
    standard_rig,
    truth_distance,
)
from fringeworks.simulate.virtual_rig import View, look
from fringeworks.stack.frames import Stack
from fringeworks.types import FloatMap, InputError

SIZE_PX = 400
"""Side of simulated frames of the dissertation's scene, px: a trial then takes a second."""
RIG_SCALE = 0.3
"""Frame sizes over those of the standard rig, for the same reason."""
DISTANCE_MM, WALL_MM = 500.0, 515.0
"""Distances of the middle of a body, and of the wall behind it, mm."""
PAIR_BASELINE_MM = 60.0
"""Baseline for two frames: displacements then stay within a few fringes, which two
frames can tell apart."""
NOISE_SEED = 1
"""Of all trials: equal settings give equal results."""

Experiment = Literal["two frames, ideal", "two frames, rig", "phase shifting, rig"]
SHAPES: dict[str, Callable[[], Shape]] = {
    "sphere": lambda: Sphere(40.0),
    "plane": lambda: Plane(120.0, 90.0),
    "box": lambda: Box((60.0, 60.0, 15.0)),
    "cylinder": lambda: Cylinder(30.0, 100.0),
}
"""Bodies before the virtual rig, beside the bust."""
BODIES: dict[Experiment, tuple[str, ...]] = {
    "two frames, ideal": tuple(OBJECTS),
    # The bust comes last: it has steps of more than a fringe, which two frames cannot tell apart.
    "two frames, rig": (*SHAPES, "bust"),
    "phase shifting, rig": ("bust", *SHAPES),
}
"""Bodies of each experiment."""


@dataclass(frozen=True)
class Slider:
    """A setting of experiments."""

    name: str
    low: float
    high: float
    step: float
    first: float
    experiments: tuple[Experiment, ...]
    """Those that it belongs to."""


IDEAL: tuple[Experiment, ...] = ("two frames, ideal",)
RIG: tuple[Experiment, ...] = ("two frames, rig", "phase shifting, rig")
PAIRS: tuple[Experiment, ...] = ("two frames, ideal", "two frames, rig")
SLIDERS: dict[str, Slider] = {
    "gamma": Slider("γ of the projector", 1.0, 3.0, 0.1, 1.0, (*IDEAL, *RIG)),
    "noise": Slider("Noise, counts", 0.0, 10.0, 0.5, 1.0, (*IDEAL, *RIG)),
    "fringes": Slider("Fringes", 4, 60, 1, 20, PAIRS),
    "steps": Slider("Steps of each of three periods", 3, 12, 1, 4, ("phase shifting, rig",)),
    "height_mm": Slider("Height, mm", 5.0, 100.0, 5.0, 50.0, IDEAL),
    "blur_px": Slider("Blur of the projector, px", 0.0, 12.0, 0.5, 0.5, RIG),
    "albedo": Slider("Albedo", 0.05, 1.0, 0.05, 0.7, RIG),
    "angle_deg": Slider("Angle, degrees", -60.0, 60.0, 5.0, 0.0, RIG),
}
"""Settings of the experiments, by key."""


def straightens(method: str) -> bool:
    """Whether a method straightens the response of ideal frames unless it is told not to."""
    return bool(methods()[method].options.get("straighten"))


def learn(
    link: Link,
    experiment: Experiment,
    body: str,
    method: str,
    settings: Mapping[str, Any],
    target: str,
) -> dict[str, Any]:
    """Measure a simulated body, and pack it with its true error."""
    link.progress(f"simulating {body}")
    trial = _ideal if experiment in IDEAL else _pair if experiment in PAIRS else _stack
    surface, error, unit, method = trial(link, body, method, dict(settings))
    packed = pack_surface(surface, deviation=error, title=f"{body}, {method}")
    Path(target).write_bytes(packed.data)
    finite = np.abs(error[np.isfinite(error)])
    if not finite.size:
        raise InputError(f"{method}: expected measured pixels, got none with these settings")
    return {
        "method": method,
        "unit": unit,
        "mean": float(finite.mean()),
        "largest": float(finite.max()),
        "failed": float(surface.failed_fraction),
    }


Trial = tuple[Any, FloatMap, str, str]
"""Surface, its true error, unit, and what measured it."""


def _ideal(link: Link, body: str, method: str, settings: dict[str, Any]) -> Trial:
    """The dissertation's scene: distant, parallel fringes."""
    options = _options(settings)
    bits = 8 if settings["noise"] else 0  # without noise, the dissertation's frames are not rounded
    scene = standard_scene(body, size=SIZE_PX, bits=bits, seed=NOISE_SEED, **settings)
    assert scene.truth_mm is not None
    link.progress(f"measuring by {method}")
    surface = reconstruct(scene, method, **options).surface
    return surface, error_map(surface, scene.truth_mm), "mm", method


def _pair(link: Link, body: str, method: str, settings: dict[str, Any]) -> Trial:
    """Two frames of the virtual rig, whose displacement is compared."""
    rig = standard_rig(scale=RIG_SCALE, baseline_mm=PAIR_BASELINE_MM)
    bodies = _bodies(body, settings)
    views = [look(rig, seen) for seen in (bodies[-1:], bodies)]
    period_px = rig.projector.width_px / settings["fringes"]
    pair = photograph_pair(views[0], views[1], period_px, _optics(settings))
    link.progress(f"measuring by {method}")
    found = analyse(pair, method)
    return (
        as_heights(found),
        found.displacement_px - pair_displacement(views[0], views[1]),
        "px",
        method,
    )


def _stack(link: Link, body: str, _: str, settings: dict[str, Any]) -> Trial:
    """Phase shifting on the virtual rig, whose points are compared."""
    rig = standard_rig(scale=RIG_SCALE)
    view: View = look(rig, _bodies(body, settings))
    plan = fringe_plan(rig, both=False, steps=settings["steps"])
    frames = list(photograph(view, plan, _optics(settings)))
    link.progress(f"measuring {len(frames)} frames")
    points = measure(Stack(frames, plan), rig).points
    error = truth_distance(view.points_mm, points.xyz_mm)
    return points, error, "mm", f"{len(frames)} frames"


def _options(settings: dict[str, Any]) -> dict[str, Any]:
    """The options of the method, which are taken out of the settings."""
    return {"straighten": settings.pop("straighten")} if "straighten" in settings else {}


def _optics(settings: Mapping[str, Any]) -> Optics:
    return Optics(
        gamma=settings["gamma"],
        noise=settings["noise"],
        defocus_px=settings["blur_px"],
        seed=NOISE_SEED,
    )


def _bodies(name: str, settings: Mapping[str, Any]) -> list[Body]:
    """The bodies of a scene; the last one is the wall behind them."""
    angle = np.radians(settings["angle_deg"])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    place = pose(turn, np.array([0.0, 0.0, DISTANCE_MM]))
    if name == "bust":
        return bust(place, albedo=settings["albedo"])
    wall = pose(np.eye(3), np.array([0.0, 0.0, WALL_MM]))
    return [Body(SHAPES[name](), place, settings["albedo"]), Body(Plane(), wall, WALL_ALBEDO)]
