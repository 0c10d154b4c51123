"""The named scenes of the benchmark: their frames, what a method may use, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from fringeworks.patterns.gray_code import GrayCode
from fringeworks.patterns.plan import PatternPlan, PhaseSteps
from fringeworks.rig.pinhole import look_at, pose, rotation
from fringeworks.simulate.bodies import Body, Box, Cylinder, Plane, Sphere
from fringeworks.simulate.exposure import Transport, photograph
from fringeworks.simulate.interreflection import interreflection
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, standard_rig
from fringeworks.simulate.virtual_rig import View, look
from fringeworks.stack.frames import Stack
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, Pair, Pinhole, Rig

SCALE = 0.5
"""Size of the frames of stacks, as a share of 1280 × 1024 px: a scene takes seconds, and has
300 000 pixels, so that 10 wrong orders in a million are 3 pixels."""
FRINGES = (1, 8, 64)
"""Fringes across the projector, each set eight times as many as the one before: every method of
temporal unwrapping can take part, because one fringe is absolute by itself."""
STEPS = 4
"""Phase steps of each set, a usual number; three are fewer than some methods need."""
SEED = 49
"""Seed of the noise of all scenes; results of different dates can be compared."""
CHECK_MM = 9.0
"""Side of the painted squares, mm: about four fringes."""
PAINT = (0.85, 0.12)
"""Albedos of the painted squares, 0…1: white and dark grey paint."""
GRAY_CELLS = 4.0
"""Period of the Gray-code scene, projector px: a coordinate that is off by more than half of it,
two cells, is a wrong code and not a neighbour across a blurred edge."""
PAIR_SIZE_PX = 500
"""Side of the frames of pairs, px."""
PAIR_FRINGES = 25
"""Fringes across the frames of pairs: 20 px each, a usual period."""
FAR_SIZE_PX = 960
"""Side of the frames of FPP-ML-Bench, px (Lakshman S, Haroon & Li, arXiv 2601.08900)."""
FAR_PUPIL_MM = (125.0, -100.0, 0.0)
"""Place of that rig's projector, mm: 125 mm to the camera's right and 100 mm above it (same
source)."""
FAR_MM = 1800.0
"""Middle of its range of 1.5 to 2.1 m, mm."""
FAR_FOCAL_PX = 1600.0
"""Focal length of camera and projector, px. The source states none that can be used, so this is
our choice: an object of 0.3 m then fills a quarter of the frame's width."""
FAR_STEPS = 18
"""Phase steps that its truth comes from (same source)."""
FAR_FRINGES = 32
"""Fringes across its projector, 30 px each: our choice, as we found no number in the source."""


@dataclass(frozen=True, eq=False, repr=False)
class BenchmarkScene(Frozen):
    """A named scene: frames that anyone may measure, and the truth that results are scored by."""

    name: str
    about: str
    """What the scene tests, one sentence."""
    capture: Stack | Pair
    """The frames, and the plan or the geometry."""
    rig: Rig | None
    """Camera and projector, exactly; None for pairs over a reference plane."""
    period_px: float
    """Shortest period: projector px of a stack, camera px of a pair. An error of more than half of
    it is a wrong fringe order."""
    truth: Mapping[str, FloatMap]
    """The true maps (h, w) by quantity: ``coordinate`` (projector column, px) and ``depth`` (z in
    camera coordinates, mm) of a stack; ``displacement`` (px) and ``height`` (mm) of a pair."""
    measurable: BoolMap
    """True where the projector's light arrives, (h, w): only there a method can measure."""

    @property
    def is_pair(self) -> bool:
        """Whether the scene is a pair of frames."""
        return isinstance(self.capture, Pair)


@dataclass(frozen=True)
class _Recipe:
    """How a scene is made."""

    about: str
    make: Callable[..., BenchmarkScene]
    options: Mapping[str, Any] = field(default_factory=dict)


def _at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0, 0, 0)) -> FloatMap:
    return pose(rotation(np.array(turn, float)), np.array([x, y, z]))


def _fringes(rig: Rig) -> PatternPlan:
    """The plan of most scenes. Shifts start at half a turn, as those of the package ``fringes``."""
    width, height = rig.projector.width_px, rig.projector.height_px
    shifts = tuple(np.pi + 2.0 * np.pi * n / STEPS for n in range(STEPS))
    return PatternPlan(width, height, tuple(PhaseSteps("x", width / n, shifts) for n in FRINGES))


def _gray(rig: Rig) -> PatternPlan:
    """Gray code of both axes with cells of one pixel and inverse pictures, as OpenCV has them."""
    width, height = rig.projector.width_px, rig.projector.height_px
    codes = (GrayCode("x", 1.0, width, inverse=True), GrayCode("y", 1.0, height, inverse=True))
    return PatternPlan(width, height, codes)


def _far(rig: Rig) -> PatternPlan:
    """18 steps and Gray code along x."""
    width, height = rig.projector.width_px, rig.projector.height_px
    period = width / FAR_FRINGES
    shifts = tuple(2.0 * np.pi * n / FAR_STEPS for n in range(FAR_STEPS))
    code = GrayCode("x", period / 2.0, width, inverse=True)
    return PatternPlan(width, height, (PhaseSteps("x", period, shifts), code))


def _bust(painted: bool = False) -> list[Body]:
    if not painted:
        return bust()
    wall = Body(Plane(), _at(0.0, 0.0, 540.0), _squares)
    return [Body(Sphere(45.0), _at(-20.0, 5.0, 520.0), _squares), wall]


def _squares(x: FloatMap, y: FloatMap) -> FloatMap:
    """Albedo of painted squares."""
    dark = (np.floor(x / CHECK_MM) + np.floor(y / CHECK_MM)) % 2
    return np.where(dark > 0, PAINT[1], PAINT[0])


def _corner() -> list[Body]:
    """Two white walls that meet in an edge and light each other."""
    lean = np.pi / 4.0
    sides = (-1.0, 1.0)
    half = 60.0 * np.sin(lean)
    return [
        Body(Plane(120.0, 160.0), _at(s * half, 0.0, 545.0 - half, (0.0, s * lean, 0.0)), 0.9)
        for s in sides
    ]


def _far_bodies() -> list[Body]:
    """A can, a ball and a box on a table's scale, 1.5 to 2.1 m away, before a wall."""
    return [
        Body(Cylinder(70.0, 220.0), _at(-150.0, 0.0, 1640.0), 0.7),
        Body(Sphere(110.0), _at(90.0, 60.0, 1800.0), 0.8),
        Body(Box((180.0, 120.0, 100.0)), _at(60.0, -150.0, 1750.0, (0.3, 0.5, 0.0)), 0.6),
        Body(Plane(), _at(0.0, 0.0, 2080.0), 0.5),
    ]


def _far_rig() -> Rig:
    """The rig of FPP-ML-Bench as far as its geometry is published."""
    middle = 0.5 * (FAR_SIZE_PX - 1)
    device = Pinhole(FAR_SIZE_PX, FAR_SIZE_PX, (FAR_FOCAL_PX, FAR_FOCAL_PX), (middle, middle))
    return Rig(device, device, look_at(np.array(FAR_PUPIL_MM), np.array([0.0, 0.0, FAR_MM])))


def _stack_scene(
    name: str,
    about: str,
    *,
    bodies: Callable[[], list[Body]] = _bust,
    rig: Callable[[], Rig] = lambda: standard_rig(scale=SCALE),
    plan: Callable[[Rig], PatternPlan] = _fringes,
    period_px: float | None = None,
    lit_twice: bool = False,
    **optics: Any,
) -> BenchmarkScene:
    devices, things = rig(), bodies()
    view = look(devices, things)
    layout = plan(devices)
    transport: list[Transport] = [interreflection(view, things)] if lit_twice else []
    frames = list(photograph(view, layout, Optics(seed=SEED, **optics), transport=transport))
    periods = [s.period_px for s in layout.blocks if isinstance(s, PhaseSteps)]
    return BenchmarkScene(
        name=name,
        about=about,
        capture=Stack(frames, layout),
        rig=devices,
        period_px=period_px or min(periods),
        truth=_truth(view),
        measurable=view.lit,
    )


def _truth(view: View) -> dict[str, FloatMap]:
    return {"coordinate": view.projector_px[..., 0], "depth": view.points_mm[..., 2]}


def _pair_scene(name: str, about: str, *, body: str, **settings: Any) -> BenchmarkScene:
    from fringeworks.pair.reference_plane import displacement_from_height

    made = standard_scene(
        body, size=PAIR_SIZE_PX, fringes=PAIR_FRINGES, bits=8, noise=2.0, seed=SEED, **settings
    )
    assert made.truth_mm is not None
    assert made.geometry is not None
    moved = displacement_from_height(made.truth_mm, made.geometry)
    return BenchmarkScene(
        name=name,
        about=about,
        capture=Pair(made.reference, made.object, axis=made.axis, geometry=made.geometry),
        rig=None,
        period_px=PAIR_SIZE_PX / PAIR_FRINGES,
        truth={"height": made.truth_mm, "displacement": moved},
        measurable=np.ones(moved.shape, bool),
    )


_RECIPES: dict[str, _Recipe] = {
    "bust": _Recipe("A bust before a wall, with the usual noise of 2 counts.", _stack_scene),
    "bust-dim": _Recipe(
        "The same with a sixth of the light and as much ambient light: phases are noisy.",
        _stack_scene,
        {"exposure": 0.17, "ambient": 1.0, "gain": 0.05},
    ),
    "bust-gamma": _Recipe(
        "The same with a projector of γ = 2.2: fringes are no sinusoids.",
        _stack_scene,
        {"gamma": 2.2},
    ),
    "bust-saturated": _Recipe(
        "The same, exposed so long that bright places are saturated.",
        _stack_scene,
        {"exposure": 1.7},
    ),
    "painted": _Recipe(
        "A ball and a wall in painted squares, seen by a blurred camera: edges shift phases.",
        _stack_scene,
        {"bodies": lambda: _bust(painted=True), "blur_px": 0.9},
    ),
    "corner": _Recipe(
        "Two white walls that light each other: indirect light shifts phases.",
        _stack_scene,
        {"bodies": _corner, "lit_twice": True},
    ),
    "gray-code": _Recipe(
        "The bust under Gray code alone, with cells of one pixel.",
        _stack_scene,
        {"plan": _gray, "period_px": GRAY_CELLS},
    ),
    "far": _Recipe(
        "Bodies 1.5 to 2.1 m away by 18 steps and Gray code, after FPP-ML-Bench's geometry.",
        _stack_scene,
        {"bodies": _far_bodies, "rig": _far_rig, "plan": _far},
    ),
    "pair-smooth": _Recipe(
        "A paraboloid of 100 mm over its reference plane, by two frames.",
        _pair_scene,
        {"body": "parabola"},
    ),
    "pair-painted": _Recipe(
        "A painted ball by two frames of a projector with γ = 2.2.",
        _pair_scene,
        {"body": "sphere", "painted": True, "gamma": 2.2},
    ),
}
"""How each scene is made; the order is that of the leaderboard."""


def benchmark_scenes() -> dict[str, str]:
    """Return the names of the benchmark's scenes, and what each of them tests.

    Examples
    --------
    >>> list(benchmark_scenes())[:3]
    ['bust', 'bust-dim', 'bust-gamma']
    """
    return {name: recipe.about for name, recipe in _RECIPES.items()}


@lru_cache(maxsize=2)
def benchmark_scene(name: str) -> BenchmarkScene:
    """Simulate a scene of the benchmark: its frames and its truth.

    Parameters
    ----------
    name : str
        One of ``benchmark_scenes``.

    Returns
    -------
    BenchmarkScene. The same version of NumPy and of this package makes the same frames.

    Raises
    ------
    InputError for another name.

    Examples
    --------
    >>> scene = benchmark_scene("pair-smooth")
    >>> scene.capture.object.shape, scene.period_px
    ((500, 500), 20.0)
    """
    if name not in _RECIPES:
        raise InputError(f"scene: expected one of {', '.join(_RECIPES)}, got {name!r}")
    recipe = _RECIPES[name]
    return recipe.make(name, recipe.about, **recipe.options)
