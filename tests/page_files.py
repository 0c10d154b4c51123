"""The files that commands of the documentation take: captures, photographs, results, small ones."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

import fringeworks as fw
from fringeworks.patterns.plan import Uniform
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Plane, Sphere, height_field
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.rig_pair import photograph_pair
from fringeworks.simulate.standard import (
    board_body,
    board_poses,
    bust,
    fringe_plan,
    standard_rig,
)
from fringeworks.simulate.virtual_rig import look
from tests import parts
from tests.inspected import scene, step

BOARD = fw.rig.parse_board("chessboard:11x8:12")
PHOTOGRAPHS = ("a.jpg", "b.jpg", "plane.jpg", "part.jpg", "cup.jpg")
HEIGHTS = (0, 4, 8, 12)


@cache
def rig() -> fw.Rig:
    return standard_rig(scale=0.3)


@cache
def plan() -> fw.PatternPlan:
    return fringe_plan(rig())


def at(x: float, y: float, z: float):
    return pose(np.eye(3), np.array([x, y, z]))


def bodies(name: str) -> list[Body]:
    if name == "plane":
        return [Body(Plane(), at(0.0, 0.0, 560.0), 0.8)]
    if name == "cap":
        return [Body(Sphere(60.0), at(0.0, 0.0, 600.0), 0.75), *bodies("plane")]
    if name == "ball":
        return [Body(Sphere(25.0), at(5.0, 3.0, 500.0), 0.8), *bodies("plane")]
    return bust()


def stack(name: str, path: Path, plan: fw.PatternPlan, seed: int = 0, **optics) -> None:
    seen = look(rig(), bodies(name))
    light = Optics(seed=seed, **{"noise": 1.0, "exposure": 1.5, **optics})
    fw.files.write_stack(path, list(photograph(seen, plan, light)), plan)


def pair(path: Path, seed: int) -> None:
    scene = fw.simulate.standard_scene("parabola", size=200, fringes=10, noise=1, bits=8, seed=seed)
    fw.files.write_pair(path, scene)


def photographs(folder: Path) -> None:
    scene = fw.simulate.standard_scene("parabola", size=200, fringes=10, noise=1, bits=8)
    for name in PHOTOGRAPHS:
        frame = scene.reference if name in ("a.jpg", "plane.jpg") else scene.object
        Image.fromarray(frame).save(folder / name, quality=95)


def planes(folder: Path) -> None:
    """Photographs of a plane at known heights, and of a part."""
    truth = fw.pair.ReferencePlaneGeometry(800.0, 100.0, 0.2)
    settings = PairSettings(fringes=12, noise=1.0, bits=8, seed=1)
    v, u = np.mgrid[:200, :240]
    part = 6.0 * np.exp(-((v - 100.0) ** 2 + (u - 120.0) ** 2) / 2000.0)
    shapes = {f"{h}mm.png": np.full((200, 240), float(h)) for h in HEIGHTS}
    for name, height in {**shapes, "object.png": part}.items():
        fw.files.write_frame(folder / name, capture_pair(height, truth, settings).object)


def poses(folder: Path, count: int) -> None:
    """Photographs of a board in several poses."""
    for k, T in enumerate(board_poses(BOARD, count, seed=1)):
        view = look(rig(), [board_body(BOARD, T)])
        frames = list(photograph(view, plan(), Optics(seed=k)))
        fw.files.write_stack(folder / f"pose_{k}", frames, plan())


def cloud(path: Path) -> None:
    frames = np.stack(list(photograph(look(rig(), bust()), plan(), Optics(exposure=1.5))))
    fw.files.write_points(path, fw.measure(fw.Stack(frames, plan()), rig()).points)


def inspected(*names: str) -> Callable[[Path], None]:
    """Captures of a block on a plane, and a recipe for its height."""

    def build(folder: Path) -> None:
        rig, plan, view = scene()
        fw.files.write_rig(folder / "rig.toml", rig)
        fw.files.write_recipe(
            folder / "recipe.toml", replace(step(9.9, 10.1), rig=folder / "rig.toml")
        )
        for k, name in enumerate(names):
            fw.files.write_stack(folder / name, list(photograph(view, plan, Optics(seed=k))), plan)

    return build


def followed(folder: Path) -> None:
    """A plane that is photographed over and over again, and the recipe that follows it."""
    repeated = fringe_plan(rig(), both=False)
    seen = look(rig(), bodies("plane"))
    (folder / "frames").mkdir()
    for k in range(3):
        for n, frame in enumerate(photograph(seen, repeated, Optics(seed=k, noise=1.0))):
            fw.files.write_frame(folder / f"frames/{100 * k + n:04d}.png", frame)
    fw.files.write_rig(folder / "rig.toml", rig())
    areas = {"wing": fw.evaluate.Area(box=(150, 130, 180, 160))}
    known = fw.Recipe(rig=folder / "rig.toml", plan=repeated, areas=areas)
    fw.files.write_recipe(folder / "recipe.toml", known)


def models(folder: Path) -> None:
    """A measured part, and its closed model."""
    fw.files.write_points(folder / "part.npz", parts.measured(rig(), scale=0.3, noise=1.0)[0])
    fw.files.write_mesh(folder / "part.stl", parts.model())


def drawing(folder: Path) -> None:
    """A drawing with tolerances."""
    shutil.copy(Path(__file__).parent / "drawings" / "tolerances.step", folder / "part.step")


def few_frames(folder: Path) -> None:
    """Four frames of a known range of depths, as the page plans them; many short steps beside them."""
    few = fw.patterns.propose_for_depth(rig(), (450.0, 560.0), 4)[0].plan
    stack("bust", folder / "shots", few)
    short = fw.patterns.PhaseSteps("x", 24.0, fw.patterns.equal_steps(6))
    lit = fw.PatternPlan(
        rig().projector.width_px, rig().projector.height_px, (short, Uniform("black"))
    )
    stack("bust", folder / "part", lit)
    width, height = rig().projector.width_px, rig().projector.height_px
    coloured = fw.propose(width, height, frames=10, axes=("x", "y"), colours=True)
    stack("bust", folder / "photographs", coloured[0].plan)


def four_steps(folder: Path) -> None:
    """Four steps of one period, which are not known to belong to a plan."""
    steps = fw.patterns.PhaseSteps("x", 30.0, fw.patterns.equal_steps(4))
    few = fw.PatternPlan(rig().projector.width_px, rig().projector.height_px, (steps,))
    (folder / "four").mkdir()
    for k, frame in enumerate(photograph(look(rig(), bust()), few, Optics())):
        fw.files.write_frame(folder / f"four/{k}.png", frame)


def response(folder: Path) -> None:
    """A plane in light that is not linear, in many steps, with a Gray code."""
    width, height = rig().projector.width_px, rig().projector.height_px
    steps = fw.patterns.PhaseSteps("x", 30.0, fw.patterns.equal_steps(16))
    code = fw.patterns.GrayCode("x", 15.0, width)
    many = fw.PatternPlan(width, height, (code, Uniform("white"), Uniform("black"), steps))
    stack("plane", folder / "plane", many, gamma=2.2)


def plugin(folder: Path) -> None:
    """The plug-in that the page shows."""
    page = (Path(__file__).parent.parent / "docs" / "methods.md").read_text(encoding="utf-8")
    (folder / "mine.py").write_text(page.split("```python\n")[1].split("```")[0])


def pairs(*names: str) -> Callable[[Path], None]:
    def build(folder: Path) -> None:
        for k, name in enumerate(names):
            pair(folder / name, seed=k)

    return build


def bust_in(*names: str) -> Callable[[Path], None]:
    return lambda folder: [stack("bust", folder / name, plan()) for name in names]


def board_in(name: str, count: int = 6) -> Callable[[Path], None]:
    return lambda folder: poses(folder / name, count)


def one_pose(folder: Path) -> None:
    poses(folder / "poses", 1)
    shutil.move(folder / "poses" / "pose_0", folder / "pose")


def pair_on_rig(folder: Path) -> None:
    """Two photographs by the rig: of the plane, and of a sphere before it."""
    seen = [look(rig(), bodies(name)) for name in ("plane", "cap")]
    fw.files.write_pair(folder / "pair", photograph_pair(seen[0], seen[1], 10.0, Optics(seed=3)))


def ball(folder: Path) -> None:
    frames = np.stack(list(photograph(look(rig(), bodies("ball")), plan(), Optics(exposure=1.5))))
    found = fw.measure(fw.Stack(frames, plan()), rig()).points
    fw.files.write_points(folder / "ball.ply", found)


def on_robot(folder: Path) -> None:
    """Photographs of a board by a camera in a robot's hand, the poses as KUKA writes them, a part."""
    from scipy.spatial.transform import Rotation

    white = fw.PatternPlan(
        rig().projector.width_px,
        rig().projector.height_px,
        (Uniform("white"), fw.patterns.PhaseSteps("x", 24.0, fw.patterns.equal_steps(3))),
    )
    (folder / "board").mkdir()
    on_flange = pose(
        Rotation.from_euler("ZYX", (20.0, -15.0, 5.0), degrees=True).as_matrix(),
        np.array([40.0, -30.0, 90.0]),
    )
    board_at = pose(
        Rotation.from_euler("ZYX", (80.0, 10.0, 170.0), degrees=True).as_matrix(),
        np.array([600.0, 50.0, 20.0]),
    )
    rows = ["name,X,Y,Z,A,B,C"]
    for k, T in enumerate(board_poses(BOARD, 7, seed=3)):
        frame = next(iter(photograph(look(rig(), [board_body(BOARD, T)]), white, Optics(seed=k))))
        fw.files.write_frame(folder / f"board/view_{k}.png", frame)
        flange = board_at @ np.linalg.inv(on_flange @ T)
        angles = Rotation.from_matrix(flange[:3, :3]).as_euler("ZYX", degrees=True)
        numbers = ",".join(f"{v:.4f}" for v in (*flange[:3, 3], *angles))
        rows.append(f"view_{k},{numbers}")
    (folder / "poses.csv").write_text("\n".join(rows))


def roof(folder: Path) -> None:
    """The drawing of a roof of two planes, around the origin."""
    x = np.abs(np.arange(41.0) - 20.0)
    field = height_field(np.tile(8.0 - 0.4 * x, (41, 1)), 1.0)
    vertices = field.vertices_mm - [20.0, 20.0, 0.0]
    mesh = fw.TriangleMesh(vertices * [1.0, 1.0, -1.0], field.faces.astype(np.uint32))
    fw.files.write_mesh(folder / "roof.stl", mesh)


def trials(folder: Path) -> None:
    """A table of ten parts, three operators and two trials; captures of two parts by two people."""
    rng = np.random.default_rng(48)
    rows = ["part,operator,length"]
    for k, length in enumerate(rng.normal(20.0, 0.05, 10)):
        rows += [f"P{k},{who},{v:.4f}" for who in "ABC" for v in rng.normal(length, 0.003, 2)]
    (folder / "trials.csv").write_text("\n".join(rows))
    inspected(*(f"trials/{p}_{o}_{t}" for p in ("P0", "P1") for o in "AB" for t in (1, 2)))(folder)


def depth_maps(folder: Path) -> None:
    """A truth and predictions in the layout of FPP-ML-Bench."""
    ball = np.zeros((40, 50))
    ball[10:30, 10:40] = 1800.0
    for name, off in (("test", 0.0), ("predictions", 14.0)):
        (folder / name / "depth").mkdir(parents=True)
        np.save(folder / name / "depth" / "banana_A0.npy", np.where(ball > 0, ball + off, 0.0))


FILES: dict[str, tuple[Callable[[Path], None], ...]] = {
    "README.md": (models, inspected("part"), board_in("board")),
    "batch.md": (inspected("line/part-0", "line/part-1"),),
    "datasets.md": (depth_maps,),
    "deviation.md": (models,),
    "few-frames.md": (few_frames,),
    "foresight.md": (roof,),
    "files.md": (photographs, response, pairs("scene"), bust_in("part")),
    "inspect.md": (inspected("part"),),
    "meshes.md": (lambda folder: cloud(folder / "part.npz"),),
    "methods.md": (photographs, plugin, pairs("scene", "part", "cup")),
    "reference.md": (bust_in("part"),),
    "report.md": (
        lambda folder: cloud(folder / "part.npz"),
        inspected("part"),
        board_in("board"),
    ),
    "rig.md": (
        planes,
        ball,
        one_pose,
        pair_on_rig,
        bust_in("part"),
        board_in("shots"),
        lambda folder: stack("plane", folder / "plane", plan()),
    ),
    "hour-robot.md": (on_robot, bust_in("part")),
    "tolerances.md": (drawing,),
    "robot.md": (on_robot, bust_in("part")),
    "score.md": (depth_maps,),
    "sequences.md": (followed,),
    "stacks.md": (bust_in("shots"), four_steps),
    "study.md": (trials,),
}
"""What a page's commands take; pages of methods take a pair."""


def build(page: Path, folder: Path) -> None:
    """The files of a page in a folder, with the rig that they were made with."""
    fw.files.write_rig(folder / "rig.toml", rig())
    for one in FILES.get(page.name, (pairs("scene"),)):
        one(folder)
