"""Calls of the public names with spoiled arguments: what is called, and how arguments are spoiled."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

import fringeworks as fw
from fringeworks.types import Frozen
from tests.conftest import scene
from tests.public import by_last
from tests.stacks import multi, take
from tests.surfaces import height_map, random_cloud

NUMBERS = (0, -1, 1, 2, 3, 7, 10**6, 2**31, 2**63, 10**30, 0.0, -0.0, 0.5, -1.5, 1e-320, 1e-30, 1e30, 1e308,
           float("nan"), float("inf"), -float("inf"), np.float32(0.3), np.int8(5), np.uint16(9), True)  # fmt: skip
"""Numbers in place of numbers."""
WORDS = (
    "",
    "x",
    "y",
    "z",
    "nothing",
    "a" * 300,
    "\x00",
    "π\u202e",
    "../x",
    "<b>",
    "plane",
    "sphere",
    "auto",
)
"""Words in place of words."""
DTYPES = (
    "?",
    "u1",
    "i1",
    ">u2",
    "<u2",
    ">i4",
    "u8",
    "f2",
    "<f4",
    ">f4",
    "f8",
    ">f8",
    "g",
    "c8",
    "O",
    "U3",
    "S2",
    "M8[s]",
)
"""Types of arrays in place of arrays, with either byte order."""
SPECIAL = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e300, -1e300, 1e-310, 255.0, 65535.0)
"""Values in place of some of an array's."""


class Call(NamedTuple):
    """A public name, what is called, and good arguments by name."""

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    slow: bool = False
    """Whether it takes more than some milliseconds."""


GAUGED = np.random.default_rng(48).normal(0.0, 0.1, 24)
"""Values of a gauge study."""
COLOURS = fw.PatternPlan(
    64,
    16,
    tuple(fw.patterns.PhaseSteps("x", p, fw.patterns.equal_steps(3)) for p in (64.0, 16.0)),
    colours=True,
)
"""A plan whose pictures show three steps each."""
ROBOT_RIG = fw.simulate.standard_rig()
"""The rig of a camera on a robot."""


def _hand_eye() -> dict[str, Any]:
    """Poses of a robot and the corners that its camera sees, (n, 4, 4) and (n, 88, 2)."""
    from fringeworks.rig.pinhole import inverse, pose, project, rotation, transform

    board = fw.rig.parse_board("chessboard:11x8:12")
    places = fw.simulate.board_poses(board, 5, seed=4)
    X = pose(rotation(np.array([0.2, -0.4, 1.0])), np.array([40.0, -30.0, 90.0]))
    Y = pose(rotation(np.array([-1.2, 0.3, 0.5])), np.array([500.0, 200.0, -50.0]))
    poses = [Y @ inverse(T) @ inverse(X) for T in places]
    pixels = [project(ROBOT_RIG.camera, transform(T, board.points_mm)) for T in places]
    noise = np.random.default_rng(3).normal(0.0, 0.02, (5, 88, 2))
    return {"T": np.array(poses), "pixels": np.array(pixels) + noise}


def spoil_array(array: np.ndarray, rng: random.Random) -> Any:
    """An array of another shape, layout or type, or with other values."""
    values = np.random.default_rng(rng.getrandbits(32))
    with np.errstate(all="ignore"):
        match rng.randrange(12):
            case 0:  # another layout, same values
                return np.asfortranarray(array)
            case 1:
                wide = np.repeat(array, 2, axis=-1) if array.ndim else array
                return wide[..., ::2] if array.ndim else wide
            case 2:
                return array[::-1][::-1] if array.ndim else array
            case 3:  # another type
                return _as_type(array, rng.choice(DTYPES))
            case 4:  # another shape
                return array[tuple(slice(0, rng.choice((0, 1, 2, None))) for _ in array.shape)]
            case 5:
                return rng.choice(
                    (array[None], array.ravel(), array[..., None], array.T, array[:0])
                )
            case 6:
                shape = tuple(rng.choice((0, 1, 2, 3, 5, 17)) for _ in range(rng.randint(0, 4)))
                return values.normal(size=shape)
            case 7:  # constant
                return np.full_like(
                    array, rng.choice((0, 1, 100 if array.dtype.kind != "b" else 1))
                )
            case 8 if array.dtype.kind == "f":
                return array * rng.choice((1e30, 1e-30, -1.0, 1e300))
            case 9 if array.dtype.kind in "ui":
                info = np.iinfo(array.dtype)
                return values.integers(info.min, info.max, array.shape, array.dtype, endpoint=True)
            case _:
                return _with_special(array, rng, values)


def _as_type(array: np.ndarray, kind: str) -> np.ndarray:
    try:
        return array.astype(kind)
    except (TypeError, ValueError):
        return np.zeros(array.shape, kind)


def _with_special(array: np.ndarray, rng: random.Random, values: np.random.Generator) -> np.ndarray:
    out = np.array(array, dtype=None if array.dtype.kind != "b" else bool)
    share = rng.choice((0.01, 0.2, 0.9, 1.0))
    where = values.random(out.shape) < share
    if out.dtype.kind == "f":
        out[where] = np.asarray(rng.choice(SPECIAL)).astype(out.dtype)
    elif out.dtype.kind in "uib":
        out[where] = rng.choice((0, 1)) if out.dtype.kind == "b" else np.iinfo(out.dtype).max
    return out


def spoil(value: Any, rng: random.Random) -> Any:
    """A spoiled value of the same kind: numbers for numbers, arrays for arrays."""
    if isinstance(value, np.ndarray):
        return spoil_array(value, rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float | np.number):
        return rng.choice(NUMBERS)
    if isinstance(value, str):
        return rng.choice(WORDS)
    if type(value) in (tuple, list):
        items = list(value)
        match rng.randrange(5):
            case 0:
                items = items[: rng.randrange(len(items) + 1)]
            case 1:
                items = items + items[-1:]
            case _ if items:
                at = rng.randrange(len(items))
                items[at] = spoil(items[at], rng)
        return type(value)(items)
    if isinstance(value, dict) and value:
        key = rng.choice(list(value))
        return value | {key: spoil(value[key], rng)}
    if dataclasses.is_dataclass(value) and isinstance(value, Frozen):
        field = rng.choice([f for f in dataclasses.fields(value) if f.init])
        old = getattr(value, field.name)
        return value if old is None else dataclasses.replace(value, **{field.name: spoil(old, rng)})
    return value


def arrays_in(value: Any) -> list[np.ndarray]:
    """All arrays in a value."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [a for item in value.values() for a in arrays_in(item)]
    if isinstance(value, tuple | list):
        return [a for item in value for a in arrays_in(item)]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [a for f in dataclasses.fields(value) for a in arrays_in(getattr(value, f.name))]
    return []


PLAN = multi((1, 8), 4, (96, 24))
"""A plan with a repeat distance of its whole width."""
SMALL = multi((1, 4), 3, (48, 16))


@cache
def _parts() -> dict[str, Any]:
    """What the calls are made of; computed once."""
    from fringeworks.simulate.standard import standard_rig

    rig = standard_rig(scale=0.1)
    frames = take(PLAN)
    decoded = fw.decode(frames, PLAN)
    pair = scene("parabola", size=64, fringes=6, noise=1, seed=1)
    displacement = fw.analyse(pair)
    cloud = random_cloud(0)
    y, x = np.mgrid[:12, :15].astype(float)
    points = np.stack(
        (x, y, 500.0 + 0.1 * x + np.random.default_rng(0).normal(0, 0.01, x.shape)), -1
    )
    T = np.eye(4)
    T[0, 3] = 100.0
    return {
        "rig": rig, "frames": frames, "decoded": decoded, "pair": pair, "displacement": displacement, "cloud": cloud,
        "points": points.reshape(-1, 3), "grid": points, "T": T, "map": height_map(), "noise": fw.signal.CameraNoise(2.0, 0.05),
        "geometry": fw.pair.ReferencePlaneGeometry(500.0, 200.0, 0.5), "mesh": fw.surface.cloud_mesh(cloud),
        "board": fw.rig.parse_board("chessboard:5x4:12"),
    }  # fmt: skip


def _consume(function: Callable[..., Any], **arguments: Any) -> Any:
    return list(function(**arguments))


def calls() -> list[Call]:
    """Every public name that computes, with small good arguments."""
    p = _parts()
    frame = p["pair"].object.astype(float)
    phase = np.angle(np.exp(1j * np.add.outer(np.arange(20), np.arange(30)) / 4))
    sphere = np.random.default_rng(2).normal(size=(200, 3))
    sphere = [0, 0, 500] + 20 * sphere / np.linalg.norm(sphere, axis=1)[:, None]
    turn, along = np.random.default_rng(3).uniform(0, 3, (2, 200))
    bodies = {
        "plane": np.column_stack((turn, along, 500 + 0.1 * turn)),
        "sphere": sphere,
    }
    zeros = np.zeros((24, 96), np.float32)
    u, h = p["displacement"].displacement_px, p["map"].values
    recipe = fw.Recipe(
        areas={"a": fw.evaluate.Area(box=(2, 2, 9, 9))},
        tolerances=(fw.evaluate.PartTolerance("n", "flatness", ("a",), high=1.0),),
    )
    levels = [
        np.full((12, 15), v) + np.random.default_rng(k).normal(0, 0.01, (12, 15))
        for k, v in enumerate((1.0, 2.0, 3.0))
    ]
    pupil = {"T_part_camera": p["T"], "noise": np.eye(6), "common": np.eye(6)}
    wrapped = fw.stack.wrapped_phase(p["frames"][4:], fw.patterns.equal_steps(4))

    def call(name: str, /, **arguments: Any) -> Call:
        return Call(name, by_last(name), arguments)

    def slow(name: str, /, **arguments: Any) -> Call:
        return Call(name, by_last(name), arguments, True)

    def each(name: str, /, **arguments: Any) -> Call:
        return Call(name, partial(_consume, by_last(name)), arguments)

    found = [
        # Types that people make.
        call("Area", box=(1, 2, 9, 10)),
        call("Area", polygon=((0.0, 0.0), (9.0, 0.0), (5.0, 8.0))),
        call("Area", mask=np.ones((5, 6), bool)),
        call("Board", kind="chessboard", columns=5, rows=4, pitch_mm=12.0),
        call("CameraNoise", read_counts=2.0, gain=0.1),
        call("CameraSettings", exposure_ms=10.0, gain_db=1.0, region=fw.devices.Region(0, 0, 8, 8)),
        call("GrayCode", axis="x", step_px=16.0, length_px=96, inverse=True, offset_px=-1.0, levels=2),
        call("Pair", reference=frame, object=frame, black=1.0, white=frame + 300, mask=frame > 0, axis="x", geometry=p["geometry"]),
        call("Datum", areas=("a", "b"), body="median", association="least-squares"),
        call("ToleranceZone", body="sphere", datums=("A", "B"), association="minimum-zone", at_mm=(1.0, 2.0, 3.0), direction=(0.0, 0.0, 1.0), angle_deg=30.0, located=False),
        call("PartTolerance", name="n", quantity="flatness", areas=("a",), low=0.0, high=1.0),
        call("PatternPlan", width_px=96, height_px=24, blocks=PLAN.blocks, bits=8, gamma=1.0, dither=False),
        call("PhaseSteps", axis="x", period_px=12.0, shifts_rad=fw.patterns.equal_steps(3)),
        call("Pinhole", width_px=64, height_px=48, focal_px=(90.0, 90.0), principal_px=(32.0, 24.0), distortion=(0.01, 0.0, 0.0, 0.0, 0.0)),
        call("ReferencePlaneGeometry", distance_mm=500.0, baseline_mm=200.0, pitch_mm_per_px=0.5, sign=1, principal_px=(1.0, 2.0)),
        call("Recipe", method="windowed", options={"degree": 3}, areas={"a": fw.evaluate.Area(box=(1, 2, 9, 10))}, within="a", tolerances=recipe.tolerances, risk=0.05),
        call("Region", x_px=0, y_px=0, width_px=8, height_px=8),
        call("Rig", camera=p["rig"].camera, projector=p["rig"].projector, T_projector_camera=p["T"], covariance=np.eye(24), residual_px=(0.1, 0.1)),
        call("Stack", frames=tuple(p["frames"]), plan=PLAN, saturation=255.0),
        call("Uniform", kind="white"),
        call("Mesh", vertices_mm=sphere[:4], faces=np.array([[0, 1, 2], [1, 2, 3]])),
        call("Provenance", call="decode", options={"a": 1}),
        call("DepthRange", rig=p["rig"], depth_mm=(400.0, 600.0)),
        call("ViewPose", **pupil),
        call("Placement", frame="base", T_frame_camera=p["T"], covariance=np.eye(6)),
        call("RobotNoise", translation_mm=0.05, rotation_deg=0.01),
        call("RobotFrame", mount="base", T_mount_camera=p["T"], covariance=np.eye(6), noise=fw.rig.RobotNoise(0.05, 0.01), poses_as="kuka"),
        call("Reading", rotation="zyx", length="mm", angle="deg", inverse=False),
        call("RobotPoses", values=np.tile([600.0, 0, 400, 10, 20, 30], (3, 1)), names=("a", "b", "c"), readings=fw.rig.robot_poses([[0.0] * 6]).readings),
        call("robot_poses", values=np.tile([600.0, 0, 400, 10, 20, 30], (3, 1)), poses_as="kuka", names=("a", "b", "c")),
        call("parse_robot_pose", text="600,0,400,10,20,30", poses_as="kuka"),
        call("in_base", cloud=p["cloud"], rig=dataclasses.replace(p["rig"], robot=fw.rig.RobotFrame("hand", p["T"], np.eye(6))), robot_pose=np.eye(4)),
        Call("hand_eye", lambda T, pixels: fw.rig.hand_eye(T, [fw.rig.BoardView(np.arange(88), one) for one in pixels], "chessboard:11x8:12", ROBOT_RIG, mount="hand"), _hand_eye(), True),
        call("equal_steps", n=4),
        # Types and provenance.
        # Patterns.
        each("encode", plan=SMALL),
        slow("propose", width_px=96, height_px=24, frames=9, noise=2.0, modulation=100.0, min_period_px=16.0, max_period_px=90.0, robust=False),
        slow("propose_for_depth", rig=p["rig"], depth_mm=(400.0, 600.0), frames=9, noise=2.0, modulation=100.0),
        # Signal.
        call("decompose_frame", frame=frame[:24, :30], max_imfs=3),
        call("decompose_rows", frame=frame[:8], max_imfs=4, max_sifts=20, flat=0.2, patience=10),
        slow("denoise", frame=frame, method="emd", noise=1.0),
        # Pair.
        slow("analyse", pair=p["pair"], method="windowed"),
        *[slow("analyse", pair=p["pair"], method=name) for name in fw.methods() if name != "windowed"],
        slow("prepare", pair=p["pair"]),
        slow("bound_px", pair=p["pair"], displacement_px=u, window_px=9.0),
        call("get_method", name="exact"),
        call("unwrap", phase_rad=phase, mask=phase > -3, quality=np.abs(phase), algorithm="reliability"),
        call("unwrap", phase_rad=phase.astype(np.float32), mask=phase > -3, algorithm="guided"),
        call("wavelet_frequencies", frequency=0.1, scales=8, span=2.0),
        call("wavelet_ridge", frame=frame[:8], frequencies=fw.pair.wavelet_frequencies(0.1, 6), omega=6.0, smooth_path=True),
        slow("windowed_fourier_filter", field=np.exp(1j * phase), sigma_px=3.0, limit=0.5, step=0.2, threshold=1.0, centre=(0.0, 0.0)),
        slow("windowed_fourier_ridge", field=np.exp(1j * phase), sigma_px=3.0, limit=0.5, step=0.2, centre=(0.0, 0.0)),
        call("displacement_from_height", height_mm=h, geometry=p["geometry"]),
        call("height_from_displacement", displacement_px=u, geometry=p["geometry"]),
        call("to_surface", displacement=p["displacement"], geometry=p["geometry"]),
        call("calibrate_plane", planes=levels, heights_mm=(0.0, 1.0, 2.0), pitch_mm_per_px=0.5, by_pixel=True),
        call("calibrate_plane", planes=levels, heights_mm=(10.0, 20.0, 30.0), pitch_mm_per_px=0.5),
        call("height_by_pixel", displacement=p["displacement"], calibration=fw.pair.PixelCalibration(np.ones_like(u), np.zeros_like(u), (0.0, 9.0))),
        slow("reconstruct", pair=p["pair"], method="windowed", geometry=p["geometry"]),
        # Stack.
        call("decode", frames=p["frames"], plan=PLAN, noise=p["noise"], saturation=255.0, count_step=1.0, min_modulation=2.0),
        call("decode", frames=list(p["frames"]), plan=PLAN, keep_phases=True),
        call("decode", frames=fw.Stack(tuple(p["frames"]), PLAN)),
        each("decode_sequence", frames=list(np.concatenate([p["frames"]] * 2)), plan=PLAN, noise=p["noise"], saturation=255.0, min_modulation=1.0, every=2),
        Call("SequenceDecoder", fw.stack.SequenceDecoder, {"plan": PLAN, "noise": p["noise"], "saturation": 255.0, "min_modulation": 1.0, "every": 2}),
        Call("StreamingDecoder", _stream, {"plan": PLAN, "frames": p["frames"]}),
        Call("Decoder", _decoder, {"plan": PLAN, "frames": p["frames"], "shape": (24, 96)}),
        call("fuse", decoded=[p["decoded"], p["decoded"]]),
        call("estimate_shifts", samples=p["frames"][4:].reshape(4, -1).astype(float), shifts_rad=fw.patterns.equal_steps(4)),
        call("separate_light", frames=p["frames"], plan=PLAN, contrast=1.0, noise=p["noise"], saturation=255.0),
        call("wrapped_phase", frames=p["frames"][4:], shifts_rad=fw.patterns.equal_steps(4), noise=p["noise"], saturation=255.0, min_modulation=1.0),
        call("texture", frames=p["frames"], plan=PLAN),
        call("unmix", pictures=np.stack(list(fw.encode(COLOURS))), plan=COLOURS, saturation=256.0),
        call("white_balance", capture=np.ones((6, 7, 3)), box=(1, 1, 5, 5)),
        call("Motion", velocity_px={"x": zeros}, flow_px=np.stack([zeros] * 2, -1)),
        # Rig.
        call("parse_board", text="chessboard:5x4:12"),
        call("find_board", image=frame, board=p["board"]),
        call("triangulate", decoded=_seen(p["rig"]), rig=p["rig"], residual_sigmas=5.0, epipolar_px=1.0),
        Call("Triangulator", lambda rig, decoded: fw.rig.Triangulator(rig).triangulate(decoded), {"rig": p["rig"], "decoded": _seen(p["rig"])}),
        slow("measure", capture=_stack_of(p["rig"]), rig=p["rig"], epipolar_px=1.0),
        # Surfaces.
        call("clean_cloud", cloud=p["cloud"], min_island_px=5, max_sigma_mm=0.5),
        call("crop_cloud", cloud=p["cloud"], box_mm=np.array([[-500.0, -500, 300], [500, 500, 700]])),
        call("crop_cloud", cloud=p["cloud"], plane=(np.array([0.0, 0, 450]), np.array([0.0, 0, 1]))),
        call("crop_cloud", cloud=p["cloud"], mask=np.ones((23, 31), bool)),
        call("height_over_plane", cloud=p["cloud"], point_mm=np.array([0.0, 0, 500]), normal=np.array([0.0, 0, 1]), pitch_mm=2.0, right=np.array([1.0, 0, 0])),
        call("normals", cloud=p["cloud"], window=5),
        call("cloud_mesh", cloud=p["cloud"], fill_px=10),
        call("solid_relief", cloud=p["cloud"], plate_mm=2.0, fill_px=10),
        call("height_map_mesh", surface=p["map"], texture=np.ones(p["map"].shape)),
        call("decimate", mesh=p["mesh"], faces=20),
        *[slow("fit_form", points_mm=points, body=body, sigma_mm=np.full(200, 0.1), common_mm=0.01, seed=1) for body, points in bodies.items()],
        slow("fit_region", points_mm=p["grid"], body="plane", common_mm=0.01),
        slow("find_spheres", points_mm=sphere, count=1, sigma_mm=np.full(200, 0.1), common_mm=0.01, seed=1),
        slow("fit", points=sphere, body="sphere", diameter_mm=40.0, count=1, within=(-100.0, -100.0, 100.0, 100.0)),
        call("difference", one=p["cloud"], other=p["cloud"]),
        call("difference", one=p["map"], other=p["map"]),
        Call("Profile", lambda surface, start, end: surface.profile((start, end)), {"surface": p["map"], "start": (1.0, 2.0), "end": (20.0, 15.0)}),
        # Views.
        call("turntable_axis", poses=_turned(), angles_deg=(0.0, 30.0, 60.0, 90.0)),
        call("board_pose", cloud=p["cloud"], board=p["board"]),
        # Evaluation.
        call("errors", surface=p["map"], truth_mm=np.nan_to_num(h)),
        call("judge_part", surface=p["map"], recipe=recipe),
        call("inspect", capture=p["map"], recipe=recipe),
        call("Displacement", time_s=np.arange(64.0), distance_mm=np.sin(np.arange(64.0)), sigma_mm=np.full(64, 0.1)),
        call("vibration", moved=fw.evaluate.Displacement(np.arange(64.0), np.sin(np.arange(64.0)), np.full(64, 0.1))),
        call("gauge_study", values=GAUGED, parts=[k % 4 for k in range(24)], operators=[k // 8 for k in range(24)], tolerance=2.0, spread=6.0),
        Call("gauge_study", lambda values, parts: fw.evaluate.gauge_study(values, parts).component("gauge"), {"values": GAUGED, "parts": np.arange(24) % 6}),
        call("control_series", values=GAUGED, mean=0.1, sigma=0.5),
        call("gauge_type1", values=GAUGED, reference=0.1, tolerance=2.0, share=0.2, spread=6.0, reference_sigma=0.01),
        call("gauge_linearity", values=GAUGED, references=np.arange(24.0) % 6),
        call("AreaTracker", areas={"a": fw.evaluate.Area(box=(2, 2, 9, 9))}),
        # Reports.
        call("summarise", result=p["cloud"]),
        call("cite", result=p["map"]),
        call("summarise", result=p["map"]),
        call("summarise", result=wrapped),
        call("format_table", rows=[{"a": 1.0, "b": "x"}], style="text"),
        call("to_json", content={"a": [1.0, None, "b"], "c": np.arange(3)}),
        call("pack_surface", result=p["cloud"], modulation=np.ones((23, 31)), title="t", every=2),
        call("pack_surface", result=p["map"], deviation=h),
        call("parse_tolerance", text="height<0.1"),
        # Simulation.
        slow("standard_scene", name="parabola", size=64, height_mm=10.0, fringes=6, noise=1.0, seed=1),
    ]  # fmt: skip
    return found


def _stream(plan: Any, frames: Any) -> Any:
    decoder = fw.stack.StreamingDecoder(plan)
    for frame in np.atleast_1d(frames):
        decoder.add(frame)
    return decoder.result()


def _decoder(plan: Any, frames: Any, shape: Any) -> Any:
    return fw.stack.Decoder(plan, shape).decode(frames)


@cache
def _stack_of(rig: fw.Rig) -> fw.Stack:
    from fringeworks.simulate.exposure import photograph
    from fringeworks.simulate.optics import Optics
    from fringeworks.simulate.standard import bust
    from fringeworks.simulate.virtual_rig import look

    plan = multi((1, 5), 4, (rig.projector.width_px, rig.projector.height_px))
    return fw.Stack(tuple(photograph(look(rig, bust()), plan, Optics(seed=1))), plan)


@cache
def _seen(rig: fw.Rig) -> fw.Decoded:
    return fw.decode(_stack_of(rig))


def _turned() -> list[np.ndarray]:
    found = []
    for angle in np.radians((0.0, 30.0, 60.0, 90.0)):
        T = np.eye(4)
        T[0, 0] = T[2, 2] = np.cos(angle)
        T[0, 2], T[2, 0] = np.sin(angle), -np.sin(angle)
        found.append(T)
    return found


def unexplained(result: Any) -> str | None:
    """Where a result has a pixel without a value that has no reason; None where it has none."""
    if isinstance(result, tuple | list):
        return next((found for item in result if (found := unexplained(item))), None)
    if not dataclasses.is_dataclass(result) or isinstance(result, type):
        return None
    reason = getattr(result, "reason", None)
    if isinstance(reason, np.ndarray):
        for name in ("values", "displacement_px", "coordinate_px", "xyz_mm", "phase_rad", "direct"):
            values = getattr(result, name, None)
            if isinstance(values, np.ndarray) and values.shape[:2] == reason.shape:
                missing = ~np.isfinite(values)
                missing = missing.any(axis=-1) if missing.ndim > reason.ndim else missing
                if (missing & (reason == 0)).any():
                    return f"{type(result).__name__}.{name}"
    inner = (getattr(result, f.name) for f in dataclasses.fields(result))
    return next((found for item in inner if (found := unexplained(item))), None)


def spoiled(call: Call, rng: random.Random) -> dict[str, Any] | None:
    """Arguments of a call with one or two of them spoiled; None where no such value can be made."""
    arguments = dict(call.arguments)
    try:
        for _ in range(rng.choice((1, 1, 1, 2))):
            name = rng.choice(list(arguments))
            arguments[name] = spoil(arguments[name], rng)
    except fw.InputError:
        return None  # a type has refused the value: that is an answer, too
    return arguments


def fault_of(call: Call, arguments: dict[str, Any]) -> str | None:
    """What is wrong with a call's answer: another error, a changed argument, a NaN without reason."""
    arrays = arrays_in(arguments)
    before = [array.tobytes() for array in arrays]
    try:
        result = call.function(**arguments)
    except fw.InputError as error:
        return None if "\n" not in str(error) and len(str(error)) < 1500 else "a long message"
    except BaseException as error:  # panics of kernels are no Exception
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"{type(error).__name__}: {error}"
    if any(a.tobytes() != b for a, b in zip(arrays, before, strict=True)):
        return "an argument was changed"
    given = unexplained(list(arguments.values()))
    if given is None and (where := unexplained(result)) is not None:
        return f"not finite without a reason: {where}"
    return None
