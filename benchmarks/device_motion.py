"""Scenes that move × plans: what sequences measure, name, refuse or get wrong.

``python -m benchmarks.device_motion --out motion.json [--seeds 0,1] [--cases A;B]``, from the root
of the source tree. Surfaces are formulas of time: nothing is shared with the package's scenes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.outcomes import fill_table, plans
from fringeworks import PatternPlan
from fringeworks.stack import decode_sequence
from fringeworks.types import InputError

Floats = NDArray[np.float64]

HEIGHT, WIDTH = 90, 130
"""Size of the camera, px."""
COLUMNS, ROWS = 512, 320
"""Size of the projector, px."""
OPEN = 0.85
"""Share of the time of a frame over which it is exposed."""
PARTS = 11
"""Moments of an exposure whose light is added."""
CYCLES = 5
"""Cycles of the plan in a sequence."""
MOST_GROSS = 200.0
"""Gross errors per million measured pixels that a case may have."""
LEAST_WITHIN = 0.9
"""Share within 2 σ that a case must have."""
GROSS_PX = 2.0
"""Errors beyond are gross, if they are beyond 5 σ as well."""

PLANS = plans(COLUMNS, ROWS, (512.0, 96.0))


class View(NamedTuple):
    """What the camera sees at a moment."""

    x_px: Floats
    """Projector columns."""
    albedo: Floats
    layer: Floats
    """Number of the surface: where it changes within a frame, nothing is compared."""


Scene = Callable[[Floats, Floats, float, int], View]
"""(u, v, time in frames, frames of the plan) to a view."""


def form(u: Floats, v: Floats) -> Floats:
    """A bent surface, projector px."""
    return np.asarray(
        120.0 + 1.4 * u + 0.2 * v + 5.0 * np.sin(u / 21.0) * np.cos(v / 26.0) + 2.0 * np.sin(v / 13)
    )


def paint(u: Floats, v: Floats) -> Floats:
    """Soft tones."""
    return np.asarray(0.65 + 0.2 * np.sin(u / 5.0 + 0.4) * np.cos(v / 7.0))


def tiles(u: Floats, v: Floats) -> Floats:
    """Tiles of tones with edges a pixel wide."""
    tones = np.random.default_rng(11).uniform(0.3, 0.95, (40, 40))
    p, q = u / 9.0 + 12.0, v / 9.0 + 12.0

    def at(i: Floats, j: Floats) -> Floats:
        return np.asarray(tones[i.astype(int) % 40, j.astype(int) % 40])

    i, j = np.floor(p), np.floor(q)
    a = np.clip((p - i - 0.944) / 0.056 * 0.5, 0.0, 0.5) * 2.0
    b = np.clip((q - j - 0.944) / 0.056 * 0.5, 0.0, 0.5) * 2.0
    low = at(i, j) * (1 - a) + at(i + 1, j) * a
    high = at(i, j + 1) * (1 - a) + at(i + 1, j + 1) * a
    return np.asarray(low * (1 - b) + high * b)


def slide(du: float, dv: float = 0.0, tones: Any = paint) -> Scene:
    """Moves across the image, px per frame; lines of sight are parallel."""

    def scene(u: Floats, v: Floats, t: float, n: int) -> View:
        p, q = u - du * (t - 2 * n), v - dv * (t - 2 * n)
        x = form(p, q) + 1.4 * (u - p) + 0.2 * (v - q)
        return View(x, tones(p, q), np.zeros_like(u))

    return scene


def away(path: Callable[[float, int], float], tones: Any = paint) -> Scene:
    """Approaches and recedes: projector px over time."""

    def scene(u: Floats, v: Floats, t: float, n: int) -> View:
        return View(form(u, v) + path(t, n), tones(u, v), np.zeros_like(u))

    return scene


def at_speed(speed: float) -> Callable[[float, int], float]:
    """Straight on, projector px per frame."""
    return lambda t, _: speed * t


def shake(size: float, cycles: float) -> Scene:
    """Vibrates: amplitude, projector px, and cycles in a plan."""
    return away(lambda t, n: size * float(np.sin(2 * np.pi * cycles * t / n + 0.7)))


def turn(speed: float) -> Scene:
    """Turns about a vertical axis: one side approaches while the other recedes."""

    def scene(u: Floats, v: Floats, t: float, n: int) -> View:
        lever = (u - 0.5 * WIDTH) / (0.5 * WIDTH)
        return View(form(u, v) + speed * (t - 2 * n) * lever, paint(u, v), np.zeros_like(u))

    return scene


def grow(rate: float) -> Scene:
    """Swells about the middle of the image."""

    def scene(u: Floats, v: Floats, t: float, n: int) -> View:
        scale = 1.0 + rate * (t - 2 * n)
        p = 0.5 * WIDTH + (u - 0.5 * WIDTH) / scale
        q = 0.5 * HEIGHT + (v - 0.5 * HEIGHT) / scale
        x = form(p, q) + 1.4 * (u - p) + 0.2 * (v - q) + 40.0 * (scale - 1.0)
        return View(x, paint(p, q), np.zeros_like(u))

    return scene


def passing(speed: float, jump: float) -> Scene:
    """A disc passes before a wall."""

    def scene(u: Floats, v: Floats, t: float, n: int) -> View:
        middle = 0.5 * WIDTH + speed * (t - 2.5 * n)
        away2 = (u - middle) ** 2 + (v - 0.5 * HEIGHT) ** 2
        front = away2 < 28.0**2
        bulge = np.sqrt(np.maximum(34.0**2 - away2, 0.0))
        near = 120.0 + 1.4 * u + 0.2 * v + jump + 0.5 * bulge
        x = np.where(front, near, 120.0 + 1.4 * u + 0.2 * v)
        tone = np.where(front, tiles(u - middle, v), 0.4)
        return View(x, tone, front.astype(float))

    return scene


def start_stop(t: float, n: int) -> float:
    """Stands, moves by 0.7 px a frame for a plan and a half, and stands again."""
    return 0.7 * float(np.clip(t - 1.6 * n, 0.0, 1.5 * n))


SCENES: dict[str, Scene] = {
    "still": away(at_speed(0.0), tiles),
    "slide 0.3": slide(0.3),
    "slide 1": slide(1.0),
    "slide 2": slide(2.0),
    "painted slide 0.5": slide(0.5, 0.0, tiles),
    "painted slide 0.4, 0.5": slide(0.4, 0.5, tiles),
    "turn 0.5": turn(0.5),
    "recede 0.4": away(at_speed(0.4)),
    "approach 1": away(at_speed(-1.0), tiles),
    "grow": grow(0.004),
    "shake 0.5": shake(3.0, 0.5),
    "shake 1": shake(1.5, 1.03),
    "shake 2": shake(1.0, 2.1),
    "shake 3": shake(1.0, 2.9),
    "shake, aliased": shake(0.7, 6.7),
    "shake, fast": shake(0.5, 10.3),
    "passing": passing(0.5, 45.0),
    "start and stop": away(start_stop),
}
"""The first one stands still."""


@dataclass
class Outcome:
    """What came of a sequence."""

    scene: str
    seed: int
    plan: str
    refused: str = ""
    findings: list[str] = field(default_factory=list)
    measured: float = 0.0
    beyond_per_million: float = 0.0
    gross_per_million: float = 0.0
    within: tuple[float, float] = (0.0, 0.0)
    """Shares within 1 and 2 σ."""
    rms_px: float = 0.0
    sigma_px: float = 0.0
    """Median standard deviation."""
    real_s: float = 0.0

    @property
    def failing(self) -> str:
        """What the outcome does not reach."""
        found = []
        if self.refused:
            return "refused" if self.scene == "still" else ""
        if self.within[1] < LEAST_WITHIN:
            found.append("2 σ" if self.findings else "2 σ, silent")
        if self.gross_per_million > MOST_GROSS:
            found.append("gross")
        if self.measured < LEAST_WITHIN:
            found.append("missing")
        if self.scene == "still" and self.findings:
            found.append("false finding")
        return ", ".join(found)


def photographed(scene: Scene, plan: PatternPlan, count: int, seed: int) -> list[NDArray[np.uint8]]:
    """Frames of a scene, each the light over its exposure."""
    rng = np.random.default_rng([seed, 5])
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    patterns = [(block, k) for block in plan.blocks for k in range(block.frames)]
    frames = []
    for frame in range(count):
        block, k = patterns[frame % plan.frames]
        light = np.zeros((HEIGHT, WIDTH))
        for part in np.linspace(-0.5 * OPEN, 0.5 * OPEN, PARTS):
            view = scene(u, v, frame + float(part), plan.frames)
            light += view.albedo * block.values(view.x_px, k) / PARTS
        counts = 12.0 + 200.0 * light
        noise = np.sqrt(1.0 + 0.02 * counts) * rng.standard_normal(light.shape)
        frames.append(np.clip(np.rint(counts + noise), 0, 255).astype(np.uint8))
    return frames


def measured(name: str, plan_name: str, seed: int) -> Outcome:
    """Decode a sequence, and compare its moments with the truth."""
    start = time.perf_counter()
    plan, scene = PLANS[plan_name], SCENES[name]
    outcome = Outcome(name, seed, plan_name)
    n = plan.frames
    frames = photographed(scene, plan, CYCLES * n, seed)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    off, sigma, known = [], [], 0
    try:
        for moment in decode_sequence(frames, plan, every=max(1, n // 3)):
            if not n <= moment.first_frame <= (CYCLES - 2) * n:
                continue
            t, found = moment.time_frames, moment.decoded.x
            assert found is not None
            views = [scene(u, v, t + shift, n) for shift in (-0.5, 0.0, 0.5)]
            same = (views[0].layer == views[1].layer) & (views[1].layer == views[2].layer)
            good = same & np.isfinite(found.coordinate_px)
            # The place at a moment is the mean over an exposure: cameras see nothing shorter.
            parts = t + np.linspace(-0.5 * OPEN, 0.5 * OPEN, PARTS)
            truth = np.mean([scene(u, v, float(part), n).x_px for part in parts], axis=0)
            off.append((found.coordinate_px - truth)[good])
            sigma.append(found.sigma_px[good])
            known += int(same.sum())
            outcome.findings += [f.line for f in moment.decoded.findings if f.rank]
    except InputError as error:
        outcome.refused = str(error)
        return outcome
    outcome.findings = list({f.split(":")[0]: f for f in outcome.findings}.values())
    _fill(outcome, np.concatenate(off), np.concatenate(sigma), known)
    outcome.real_s = time.perf_counter() - start
    return outcome


def _fill(outcome: Outcome, off: Floats, sigma: Floats, known: int) -> None:
    """The figures of errors."""
    outcome.measured = off.size / max(known, 1)
    if not off.size:
        return
    normal = np.abs(off / sigma)
    gross = (np.abs(off) > GROSS_PX) & (normal > 5.0)
    outcome.beyond_per_million = 1e6 * float((normal > 5.0).mean())
    outcome.gross_per_million = 1e6 * float(gross.mean())
    outcome.within = float((normal < 1.0).mean()), float((normal < 2.0).mean())
    outcome.rms_px = float(np.sqrt(np.mean(off**2)))
    outcome.sigma_px = float(np.median(sigma))


def line(outcome: Outcome) -> str:
    """An outcome in a line."""
    head = f"{outcome.scene:24} {outcome.seed:4} {outcome.plan:12} "
    failing = f"  FAILS: {outcome.failing}" if outcome.failing else ""
    if outcome.refused:
        return f"{head}refused{failing} {outcome.refused}"
    one, two = outcome.within
    said = outcome.findings[0] if outcome.findings else ""
    return (
        f"{head}{outcome.measured:6.1%} {outcome.beyond_per_million:7.0f} "
        f"{outcome.gross_per_million:7.0f} {one:5.2f} {two:5.2f} {outcome.rms_px:6.3f} "
        f"{outcome.sigma_px:6.3f}{failing} {said}"
    )


def _with_plans(name: str, seed: int) -> Iterator[Outcome]:
    """Outcomes of a scene with every plan."""
    return (measured(name, plan, seed) for plan in PLANS)


def main() -> int:
    """Fill the table, print it and write it."""
    head = f"{'scene':24} {'seed':>4} {'plan':12} measured >5σ/M gross/M  1σ    2σ    rms  σ, px"
    return fill_table(__doc__, SCENES, head, _with_plans, line)


if __name__ == "__main__":
    raise SystemExit(main())
