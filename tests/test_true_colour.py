"""Colour of the scene from the frames of a colour camera, through points, meshes and files."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from PIL import Image

import fringeworks as fw
from fringeworks.files.images import read_frames
from fringeworks.simulate.bodies import Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.even_light import texture_weights
from tests import rigs
from tests.commands import run
from tests.shared import shared

LIGHT = np.array([1.0, 0.8, 0.6])
"""What the camera's channels show of white paper."""


def paint(shape):
    """Albedo of a painted body in red, green and blue, (h, w, 3)."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.stack(
        (
            0.55 + 0.3 * np.sin(x / 40),
            0.6 + 0.25 * np.cos(y / 35),
            0.55 + 0.3 * np.sin((x + y) / 50),
        ),
        axis=-1,
    )


@shared
def photographs():
    """Plan, and frames (h, w, 3) of a painted ball."""
    rig = rigs.rig()
    plan = fw.simulate.fringe_plan(rig, both=False)
    view = look(rig, [rigs.ahead(Sphere(50.0), 5, 3, albedo=0.9)])
    grey = list(photograph(view, plan, Optics(seed=1, noise=0.0)))
    rng = np.random.default_rng(0)
    colours = paint(grey[0].shape) * LIGHT
    frames = [
        np.clip(np.rint(g[..., None] * colours + 0.7 * rng.standard_normal(colours.shape)), 0, 255)
        for g in grey
    ]
    return plan, [f.astype(np.uint8) for f in frames]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    plan, frames = photographs()
    place = tmp_path_factory.mktemp("painted")
    fw.files.write_plan(place / "plan.toml", plan)
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(place / f"{k:02d}.png", compress_level=1)
    return place


@pytest.mark.parametrize("channels", [None, "g"])
def test_points_have_the_colour_of_the_paint(folder, channels):
    stack = fw.files.read_stack(folder, channels=channels)
    cloud = fw.measure(stack, rigs.rig()).points
    ok = cloud.reason == 0
    assert ok.mean() > 0.2
    assert cloud.colour.shape == (*cloud.shape, 3)
    # In linear light, but for the shading that all channels have in common.
    seen = cloud.colour[ok] / LIGHT
    true = paint(cloud.shape)[ok]
    seen, true = (c / c.sum(axis=1, keepdims=True) for c in (seen, true))
    assert np.sqrt(np.mean((seen / true - 1.0) ** 2)) < 0.02
    assert np.abs(np.mean(seen / true - 1.0, axis=0)).max() < 0.002


def test_a_channel_has_a_letter_and_a_name(folder):
    by_name, by_letter = (fw.files.read_stack(folder, channels=c) for c in ("blue", "b"))
    assert np.array_equal(by_name.frames[3], by_letter.frames[3])
    assert np.array_equal(by_name.frames[3], photographs()[1][3][..., 2])


def test_the_geometry_is_that_of_the_luminance(folder):
    stack = fw.files.read_stack(folder)
    with_colour, without = (
        fw.measure(s, rigs.rig()).points for s in (stack, replace(stack, colour=None))
    )
    assert without.colour.ndim == 2
    assert np.array_equal(with_colour.xyz_mm, without.xyz_mm, equal_nan=True)
    assert np.array_equal(with_colour.sigma_mm, without.sigma_mm, equal_nan=True)


def test_files_keep_the_colour(folder, tmp_path):
    cloud = fw.measure(folder, rigs.rig()).points
    ok = cloud.reason == 0
    chroma = np.ptp(cloud.colour[ok], axis=1).mean() / cloud.colour[ok].mean()
    assert chroma > 0.2
    for name in ("a.npz", "a.ply", "a.pcd"):
        fw.write(tmp_path / name, cloud)
        found = fw.read(tmp_path / name).colour
        found = found[ok] if found.ndim == 3 else found
        assert found.shape == (ok.sum(), 3)
        assert abs(np.ptp(found, axis=1).mean() / found.mean() / chroma - 1.0) < 0.05
    mesh = fw.surface.cloud_mesh(cloud)
    assert mesh.colour.shape == (len(mesh.vertices_mm), 3)
    pytest.importorskip("trimesh")
    import trimesh

    fw.write(tmp_path / "a.glb", mesh)
    seen = trimesh.load(tmp_path / "a.glb", force="mesh").visual
    picture = np.asarray(seen.material.baseColorTexture.convert("RGB")) / 255.0
    picture = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    height, width = picture.shape[:2]
    column, row = np.rint(seen.uv * (width, -height) - (0.5, 0.5 - height)).astype(int).T
    shown = picture[row, column]
    assert abs(np.ptp(shown, axis=1).mean() / shown.mean() / chroma - 1.0) < 0.05


def test_grey_images_stay_grey(tmp_path):
    plan, frames = photographs()
    paths = []
    for k, frame in enumerate(frames):
        paths.append(tmp_path / f"{k:02d}.png")
        Image.fromarray(np.repeat(frame[..., 1:2], 3, axis=2)).save(paths[-1])
    assert read_frames(paths, stack=True, weights=texture_weights(plan)).colour is None


def test_the_colour_does_not_depend_on_who_reads_first(folder):
    """Steps that are not equal: weights whose sums would round differently in another order."""
    plan = fw.PatternPlan(64, 48, (fw.patterns.PhaseSteps("x", 20.0, (0.0, 0.7, 1.9, 3.5)),))
    weights = texture_weights(plan)
    assert len(set(weights.values())) > 1
    paths = sorted(folder.glob("*.png"))[:4]
    found = [read_frames(paths, stack=True, weights=weights).colour for _ in range(3)]
    assert all(np.array_equal(found[0], other) for other in found)
    assert found[0].shape == (*photographs()[1][0].shape[:2], 3)


def gains(tmp_path):
    """Gains of a grey card under the light of the scene, photographed by the same camera."""
    plan, _ = photographs()
    rng = np.random.default_rng(3)
    card = tmp_path / "card"
    card.mkdir()
    fw.files.write_plan(card / "plan.toml", plan)
    for k in range(plan.frames):
        even = (60 + 20 * np.cos(2 * np.pi * k / plan.frames)) * LIGHT + 0.7 * rng.standard_normal(
            (40, 50, 3)
        )
        Image.fromarray(np.clip(np.rint(even), 0, 255).astype(np.uint8)).save(card / f"{k:02d}.png")
    return card, fw.stack.white_balance(fw.files.read_stack(card), box=(5, 5, 45, 35))


def test_a_grey_card_makes_the_colours_those_of_the_paint(folder, tmp_path):
    _, found = gains(tmp_path)
    np.testing.assert_allclose(found, LIGHT[1] / LIGHT, rtol=0.01)
    plain = fw.measure(folder, rigs.rig()).points
    cloud = fw.measure(folder, rigs.rig(), white_balance=found).points
    ok = cloud.reason == 0
    seen, true = cloud.colour[ok], paint(cloud.shape)[ok]
    seen, true = (c / c.sum(axis=1, keepdims=True) for c in (seen, true))
    assert np.sqrt(np.mean((seen / true - 1.0) ** 2)) < 0.02
    assert np.array_equal(cloud.xyz_mm, plain.xyz_mm, equal_nan=True)
    np.testing.assert_allclose(cloud.provenance.options["white_balance"], found)
    # The capture keeps them.
    stack = replace(fw.files.read_stack(folder), white_balance=found)
    assert np.array_equal(fw.measure(stack, rigs.rig()).points.colour, cloud.colour, equal_nan=True)
    words = (folder / "plan.toml").read_bytes()
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "plan.toml").write_bytes(words)
    for path in folder.glob("*.png"):
        (kept / path.name).write_bytes(path.read_bytes())
    (kept / "capture.toml").write_text(f'kind = "stack"\nwhite_balance = {list(found)}\n')
    again = fw.measure(kept, rigs.rig()).points
    assert np.array_equal(again.colour, cloud.colour, equal_nan=True)


def test_a_written_capture_keeps_its_gains(tmp_path):
    plan, frames = photographs()
    grey = tuple(frame[..., 1].copy() for frame in frames)
    fw.write(tmp_path / "w", fw.Stack(grey, plan, white_balance=(1.9, 1.0, 1.4)))
    assert fw.read(tmp_path / "w").white_balance == (1.9, 1.0, 1.4)


def test_the_command_takes_gains_or_a_card(folder, tmp_path):
    card, _ = gains(tmp_path)
    rig = fw.files.write_rig(tmp_path / "rig.toml", rigs.rig()) or tmp_path / "rig.toml"
    base = fw.measure(folder, rigs.rig()).points.colour
    for words in ("1.25,1,2", str(card)):
        run("measure", folder, "--rig", rig, "--white-balance", words, "--out", tmp_path / "a.npz")
        found = fw.files.read_cloud(tmp_path / "a.npz").colour
        expected = (1.25, 1, 2) if words != str(card) else LIGHT[1] / LIGHT
        ratio = found[base.min(axis=2) > 5].mean(axis=0) / base[base.min(axis=2) > 5].mean(axis=0)
        np.testing.assert_allclose(ratio, expected, rtol=1e-4 if words != str(card) else 0.01)
    done = run("measure", folder, "--rig", rig, "--white-balance", "1,2", code=2)
    assert "--white-balance: expected three gains" in done.stderr


@pytest.mark.parametrize(
    ("given", "box", "words"),
    [
        (np.ones((4, 5)), None, "expected colour"),
        (np.ones((4, 5, 3)), (0, 0, 6, 2), "expected a box within 5 × 4 px"),
        (np.ones((4, 5, 3)), (0, 2, 3, 2), "expected a box"),
        (np.ones((4, 5, 3)) * (1, 0, 1), None, "got none in green"),
        (np.full((4, 5, 3), np.nan), None, "got none in red"),
    ],
)
def test_white_balance_of_what_shows_no_white(given, box, words):
    with pytest.raises(fw.InputError, match=words):
        fw.stack.white_balance(given, box=box)


def test_a_saturated_card_has_no_gains(folder):
    stack = replace(fw.files.read_stack(folder), saturation=30.0)
    with pytest.raises(fw.InputError, match="below the saturation 30"):
        fw.stack.white_balance(stack)
    with pytest.raises(fw.InputError, match="grey frames"):
        fw.stack.white_balance(replace(stack, colour=None))
    for bad in ((1.0, 2.0), (1.0, -1.0, 1.0), (1.0, np.nan, 1.0)):
        with pytest.raises(fw.InputError, match="expected three gains"):
            fw.measure(stack, rigs.rig(), white_balance=bad)


def coloured(seed, albedo, noise):
    """Frames of a ball of one or two paints by a colour camera with noise of its own per channel."""
    rig = rigs.rig()
    plan = fw.simulate.fringe_plan(rig, both=False)
    view = look(rig, [rigs.ahead(Sphere(30.0), 5, 3, albedo=0.9)])
    grey = list(photograph(view, plan, Optics(seed=1, noise=0.0)))
    rng = np.random.default_rng(seed)
    left = np.arange(grey[0].shape[1])[:, None] < grey[0].shape[1] / 2
    paints = np.where(left, *map(np.asarray, albedo))
    scale = np.asarray(noise) * np.ones(3)
    return (
        plan,
        view,
        [
            np.clip(
                np.rint(g[..., None] * paints + scale * rng.standard_normal((*g.shape, 3))), 0, 255
            ).astype(np.uint8)
            for g in grey
        ],
    )


SCENES = {
    "red": (((0.9, 0.2, 0.1), (0.9, 0.2, 0.1)), 1.2),
    "white": (((0.8, 0.8, 0.8), (0.8, 0.8, 0.81)), 1.5),
    "blue and red": (((0.2, 0.3, 0.9), (0.9, 0.3, 0.2)), 1.2),
    "a noisy channel": (((0.5, 0.8, 0.6), (0.5, 0.8, 0.6)), (0.8, 4.0, 1.0)),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", [71, 72])
def test_the_best_combination_is_no_worse_than_any_channel(tmp_path, name, seed):
    plan, view, frames = coloured(seed, *SCENES[name])
    fw.files.write_plan(tmp_path / "plan.toml", plan)
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{k:02d}.png", compress_level=1)
    lit = view.lit & np.isfinite(view.projector_px[..., 0])
    # The rim of the ball mixes two surfaces in a pixel, whichever channel sees it.
    inside = scipy.ndimage.binary_erosion(lit, iterations=4)
    off, ok, covered = {}, {}, {}
    for channels in ("r", "g", "b", "best", None):
        stack = fw.files.read_stack(tmp_path, channels=channels)
        found = fw.decode(stack).x
        off[channels] = np.abs(found.coordinate_px - view.projector_px[..., 0])
        ok[channels] = (found.reason == 0) & (off[channels] < 2) & lit
        seen = ok[channels] & inside
        covered[channels] = np.mean(off[channels][seen] < 2 * found.sigma_px[seen])
        assert channels != "best" or "least noise" in stack.notes[0]
    error = {c: np.median(off[c][ok[c] & ok["best"]]) for c in off}
    assert error["best"] < 1.1 * min(error[c] for c in "rgb"), error
    assert error["best"] < 1.02 * error[None], error
    assert covered["best"] > 0.93, covered
    # The channel with the least noise measures 90 % of the red ball, too.
    assert ok["best"].sum() > 0.9 * lit.sum()


def test_the_best_combination_needs_colour(tmp_path):
    plan, frames = photographs()
    np.save(tmp_path / "f.npy", np.stack(frames))
    with pytest.raises(fw.FileProblem, match="folder of colour images for their best combination"):
        fw.files.read_stack(tmp_path / "f.npy", plan, channels="best")
    with pytest.raises(fw.InputError, match="as g or rgb, or red, green or blue, or best, got 'x'"):
        fw.files.read_stack(tmp_path / "f.npy", plan, channels="x")
