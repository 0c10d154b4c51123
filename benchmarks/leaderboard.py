"""The leaderboard: our methods and others on the scenes of ``fringeworks score``, as a page.

``python -m benchmarks.leaderboard --page docs/leaderboard.md``, in an environment that has the
peers of ``requirements/bench.txt``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import fringeworks as fw
from benchmarks.harness import PeerMissing, peer_module
from benchmarks.peers import fourier_scipy_rows
from fringeworks.evaluate import BenchmarkScene, Score, benchmark_scene, benchmark_scenes, score
from fringeworks.evaluate.scored_scenes import FRINGES, STEPS
from fringeworks.files.atomic import write_text
from fringeworks.patterns import GrayCode, PhaseSteps
from fringeworks.simulate import Body, Optics, Plane, look, photograph
from fringeworks.types.numbers import percent


class NotForScene(Exception):
    """A method cannot take part in a scene, with the reason."""


@dataclass(frozen=True)
class Row:
    """What a method reached on a scene: a score, or why there is none."""

    scene: str
    method: str
    score: Score | None
    why: str = ""


Method = Callable[[BenchmarkScene], Any]
METHODS: dict[str, Method] = {}


def entry(name: str) -> Callable[[Method], Method]:
    """Register a method under the name that the page shows."""

    def registered(function: Method) -> Method:
        METHODS[name] = function
        return function

    return registered


def frames_of(scene: BenchmarkScene) -> np.ndarray:
    """Frames (n, h, w) of a stack."""
    if not isinstance(scene.capture, fw.Stack):
        raise NotForScene("two frames")
    return np.array(list(scene.capture.frames), np.float64)


def sets_of(scene: BenchmarkScene) -> list[tuple[Any, np.ndarray]]:
    """The plan's blocks, each with its frames."""
    frames, found, place = frames_of(scene), [], 0
    for block in scene.capture.plan.blocks:
        count = len(block.shifts_rad) if isinstance(block, PhaseSteps) else 2 * bits_of(block)
        found.append((block, frames[place : place + count]))
        place += count
    assert place == len(frames)
    return found


def bits_of(code: GrayCode) -> int:
    """Bits that number the cells of a Gray code."""
    cells = int(np.ceil((code.length_px - code.offset_px) / code.step_px))
    return max(1, int(np.ceil(np.log2(cells))))


@entry("fringeworks: decode")
def ours(scene: BenchmarkScene) -> fw.Decoded:
    """Our decoding with its defaults."""
    if scene.is_pair:
        raise NotForScene("two frames")
    return fw.decode(scene.capture)


def two_frames(method: str) -> Method:
    """One of our methods for two frames."""

    def run(scene: BenchmarkScene) -> Any:
        if not isinstance(scene.capture, fw.Pair):
            raise NotForScene("a stack")
        return fw.reconstruct(scene.capture, method)

    return run


for _name in ("windowed", "fourier", "wavelet", "gsifa"):
    METHODS[f"fringeworks: {_name}"] = two_frames(_name)


@entry("fringes")
def peer_fringes(scene: BenchmarkScene) -> tuple[np.ndarray, str]:
    """The package ``fringes`` with its defaults."""
    frames = frames_of(scene)
    if len(scene.capture.plan.blocks) != len(FRINGES):
        raise NotForScene("it has no Gray code")
    peer = peer_module("fringes").Fringes()
    plan = scene.capture.plan
    peer.X, peer.Y, peer.D, peer.K = plan.width_px, plan.height_px, 1, len(FRINGES)
    peer.v, peer.N = list(FRINGES), [STEPS] * len(FRINGES)
    found = peer.decode(frames.astype(np.uint8)[..., None]).x
    return np.asarray(found, np.float64).reshape(frames.shape[1:]), "coordinate"


@entry("OpenCV: GrayCodePattern")
def peer_opencv(scene: BenchmarkScene) -> tuple[np.ndarray, str]:
    """OpenCV's Gray code, pixel by pixel as its samples do; its cells are whole pixels."""
    frames = frames_of(scene).astype(np.uint8)
    if not all(isinstance(block, GrayCode) and block.step_px == 1.0 for block in plan_of(scene)):
        raise NotForScene("it has no absolute phase shifting")
    light = getattr(peer_module("cv2"), "structured_light", None)
    if light is None:
        raise PeerMissing("cv2: built without structured_light")
    plan = scene.capture.plan
    pattern = light.GrayCodePattern.create(plan.width_px, plan.height_px)
    stack = [np.ascontiguousarray(frame) for frame in frames]
    if pattern.getNumberOfPatternImages() != len(stack):
        raise NotForScene("another number of pictures")
    found = np.full(frames.shape[1:], np.nan)
    for y, x in np.ndindex(*found.shape):
        error, place = pattern.getProjPixel(stack, x, y)
        if not error:
            found[y, x] = place[0]
    return found, "coordinate"


def plan_of(scene: BenchmarkScene) -> tuple[Any, ...]:
    """Blocks of a stack's plan."""
    return scene.capture.plan.blocks


@entry("formulas of SLStudio (own writing)")
def peer_formulas(scene: BenchmarkScene) -> tuple[np.ndarray, str]:
    """Phases by the discrete Fourier transform, fringe orders from each coarser coordinate.

    This is the usual chain: φ = atan2(Σ I sin δ, Σ I cos δ), k = round((x − p φ / 2π) / p). Neither
    its threshold on shading nor any filter is applied.
    """
    coarse: np.ndarray | None = None
    for block, frames in sorted(sets_of(scene), key=lambda one: isinstance(one[0], PhaseSteps)):
        if isinstance(block, GrayCode):
            coarse = gray_middles(block, frames) if block.axis == "x" else coarse
            continue
        shifts = np.array(block.shifts_rad)[:, None, None]
        phase = np.arctan2((frames * np.sin(shifts)).sum(0), (frames * np.cos(shifts)).sum(0))
        fine = block.period_px * ((phase / (2 * np.pi)) % 1.0)
        order = 0.0 if coarse is None else np.round((coarse - fine) / block.period_px)
        coarse = fine + order * block.period_px
    assert coarse is not None
    return coarse, "coordinate"


def gray_middles(code: GrayCode, frames: np.ndarray) -> np.ndarray:
    """Middle of the cell that each pixel sees: every bit against its inverse.

    Cells begin at the projector's edge, half a pixel before the middle of column 0.
    """
    number = np.zeros(frames.shape[1:], int)
    bit = np.zeros_like(number)
    for positive, negative in zip(frames[::2], frames[1::2], strict=True):
        bit = bit ^ (positive > negative)
        number = 2 * number + bit
    return (number + 0.5) * code.step_px + code.offset_px - 0.5


@entry("Fourier transform by rows (SciPy, own writing)")
def peer_fourier(scene: BenchmarkScene) -> tuple[np.ndarray, str]:
    """Takeda's method as most scripts write it, unwrapped along rows from the left edge."""
    if not isinstance(scene.capture, fw.Pair):
        raise NotForScene("a stack")
    pair = scene.capture
    product = fourier_scipy_rows(
        pair.reference.astype(float), pair.object.astype(float), scene.period_px
    )
    phase = np.unwrap(np.angle(product), axis=1)
    phase -= 2 * np.pi * np.round(phase[:, :5].mean(axis=1, keepdims=True) / (2 * np.pi))
    moved = phase * scene.period_px / (2 * np.pi)
    assert pair.geometry is not None
    return fw.pair.height_from_displacement(moved, pair.geometry), "height"


def reached(scene: BenchmarkScene, name: str, method: Method) -> Row | None:
    """The row of a method on a scene; None where it is not for it."""
    try:
        found = method(scene)
    except NotForScene:
        return None
    except PeerMissing as error:
        print(f"    skipped: {error}")
        return None
    except fw.InputError as error:
        return Row(scene.name, name, None, f"refused: {str(error).split(';')[0]}")
    if isinstance(found, tuple):
        return Row(scene.name, name, score(found[0], scene, quantity=found[1]))
    return Row(scene.name, name, score(found, scene))


def all_rows() -> list[Row]:
    """Every method on every scene that it is for."""
    rows = []
    for scene_name in benchmark_scenes():
        scene = benchmark_scene(scene_name)
        for name, method in METHODS.items():
            row = reached(scene, name, method)
            if row is not None:
                print(line(row), flush=True)
                rows.append(row)
    return rows


def cell(value: float | None) -> str:
    return "–" if value is None or np.isnan(value) else f"{value:.3g}"


def line(row: Row) -> str:
    """A row of the table."""
    found = row.score
    if found is None:
        return f"| {row.scene} | {row.method} | {row.why} | | | | | | | |"
    cells = [
        percent(found.measured),
        percent(found.unfounded) if np.isfinite(found.unfounded) else "–",
        f"{cell(found.mean)} {found.unit}",
        *(cell(v) for v in (found.rms, found.rms_right_order, found.p95)),
        "–" if np.isnan(found.wrong_orders_ppm) else f"{found.wrong_orders_ppm:.0f}",
        "–" if found.within_1_sigma is None else percent(found.within_1_sigma),
    ]
    return "| " + " | ".join((row.scene, row.method, *cells)) + " |"


# FPP-ML-Bench's layout and geometry.


def far_rows() -> list[str]:
    """Ways to measure the scene of FPP-ML-Bench's geometry; the stack through its layout."""
    scene = benchmark_scene("far")
    points = fw.measure(scene.capture, scene.rig).points
    bodies = through_layout(np.asarray(points.xyz_mm[..., 2]), scene)
    wall = look(scene.rig, [Body(Plane(), placed(2080.0), 0.5)])
    plain = next(photograph(wall, scene.capture.plan, Optics(seed=50)))
    pair = fw.Pair(plain, np.asarray(next(iter(scene.capture.frames))), axis="x")
    plane = (0.0, 0.0, 1.0, 2080.0)
    two = fw.measure(pair, scene.rig, plane=plane, period_px=scene.period_px)
    return [
        far_line(
            "18 steps and Gray code, `measure`; the bodies alone", bodies, score(points, scene)
        ),
        far_line(
            "two frames, of the wall and of the scene, `measure` with the wall's plane; all pixels",
            score(two, scene),
            score(two, scene),
        ),
    ]


def far_line(name: str, found: Score, covered: Score) -> str:
    """A row of the second table: errors of one score, and the coverage of another."""
    cells = [percent(found.measured), *(cell(v) for v in (found.mean_abs, found.rms, found.p95))]
    return "| " + " | ".join((name, *cells, percent(covered.within_1_sigma or 0.0))) + " |"


def placed(z: float) -> np.ndarray:
    """A pose before the camera, mm."""
    T = np.eye(4)
    T[2, 3] = z
    return T


def through_layout(depth: np.ndarray, scene: BenchmarkScene) -> Score:
    """Write a truth and a result in the layout of FPP-ML-Bench, and score one by the other.

    The truth's background, which is the wall, is 0, as there.
    """
    from scipy.io import savemat

    true = np.where(scene.measurable, np.nan_to_num(scene.truth["depth"]), 0.0)
    true[true > 2050.0] = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name, values in (("test", true), ("mine", np.nan_to_num(depth))):
            place = Path(folder) / name / "depth"
            place.mkdir(parents=True)
            savemat(place / "bodies_A0.mat", {"depthMap": values}, do_compression=True)
        return fw.evaluate.score_depths(Path(folder) / "mine", Path(folder) / "test")[0]


TITLES = "scene,method,measured,unfounded,mean,rms,rms of the right order,95 %,wrong ppm,in 1 σ"
"""Columns of the table, by commas."""
HEAD = """# Leaderboard

Methods on the ten scenes of `fringeworks score`, each with its defaults. `python -m
benchmarks.leaderboard` measures the table and writes this page; [Scores](score.md) says what the
columns mean, and how to enter.

Measured on {day} with fringeworks {own}, fringes {fringes} and OpenCV {opencv}. All scenes are
simulated, so they test what the simulation has in it and nothing else. They were chosen before
any method was run on them, and none was tuned to them. A refusal is a result too: the method says
that it cannot measure, and gives no points.

"""
FAR = """

*SLStudio's formulas* are the phase and the temporal unwrapping of that program in our own
writing, without its threshold on shading: every pixel has a value, and shadows are guesses.
Programs with a threshold lose some pixels of both kinds. OpenCV takes part in Gray code only,
because its sinusoidal patterns have no absolute phase. `fringes` has no Gray code. Its share of
wrong orders is as large with its own patterns: 13 % of them at a third of the contrast and a
noise of 2 counts.

## FPP-ML-Bench

The networks of [FPP-ML-Bench](datasets.md#fpp-ml-bench) estimate depth from a single fringe
image, 1.5 to 2.1 m away. The best of them has a mean absolute error of 14.54 mm and an rms error
of 17.88 mm over the object (Lakshman S, Haroon & Li, [arXiv
2601.08900](https://arxiv.org/abs/2601.08900)). The data of that benchmark could not be reached
from here, so the rows below are **not** measured on its frames. They are measured on the scene
`far`, which we made after the geometry that is published: 960 × 960 px, a projector 125 mm to the
right and 100 mm above, 1.5 to 2.1 m, 18 steps and Gray code. Focal length, fringes and bodies are
ours. The row of the stack went through the layout of that benchmark and back, by `score_depths`.
The fringes of two frames do not tell steps of whole periods, and the bodies stand up to half a
metre before the wall: the width of their shadows tells most of the orders, and pixels that it
leaves open are not measured.

| way | measured | mean \\|e\\|, mm | rms, mm | 95 %, mm | in 1 σ |
|---|---|---|---|---|---|
"""


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, required=True, help="page to write")
    page = parser.parse_args().page
    rows = all_rows()
    far = far_rows()
    text = HEAD.format(
        day=date.today().isoformat(),
        own=fw.__version__,
        fringes=version("fringes"),
        opencv=peer_module("cv2").__version__,
    )
    titles = TITLES.split(",")
    text += f"| {' | '.join(titles)} |\n|{'---|' * len(titles)}\n"
    text += "".join(f"{line(row)}\n" for row in rows) + FAR + "".join(f"{one}\n" for one in far)
    write_text(page, text)


if __name__ == "__main__":
    main()
