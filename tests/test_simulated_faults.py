"""Measurements under simulated optics: refused, noted, or right within their standard deviations."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import ndimage

from fringeworks import (
    BoardNotFound,
    InputError,
    Pair,
    PatternPlan,
    Reason,
    Rig,
    analyse,
    decode,
    reconstruct,
)
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.rig.calibration.calibrate import calibrate, observe
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.pinhole import pose, project, rotation, transform
from fringeworks.simulate.bayer import Bayer
from fringeworks.simulate.boards import BoardErrors, real_board_body, real_points
from fringeworks.simulate.bodies import Body, Plane, height_field
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.interreflection import interreflection
from fringeworks.simulate.lens import ThinLens
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.response_curve import DLP_BRIGHT, LCD
from fringeworks.simulate.rig_pair import pair_displacement, photograph_pair
from fringeworks.simulate.standard import (
    board_body,
    bust,
    cropped_field,
    fringe_plan,
    standard_rig,
    widened_frame,
)
from fringeworks.simulate.subsurface import subsurface
from fringeworks.simulate.virtual_rig import View, look
from fringeworks.stack import CoordinateMap
from fringeworks.stack.even_light import texture
from tests.fault_measure import errors
from tests.fault_stage import at_edges
from tests.grids import quick, thinned
from tests.rigs import ahead, board, groove, poses, rig, rig_errors

pytestmark = pytest.mark.statistical

MARGIN = 16
"""Pixels around the frame that the simulated blurs take light from."""
BEYOND_5 = 100e-6
"""Largest share of measured pixels beyond five standard deviations."""


SCENES = {
    "bust": bust(),
    "plane": [ahead(Plane(150, 120), turn=(0.2, 0.35, 0))],
    "groove": groove(),
}


@lru_cache
def view(scene: str):
    """A scene in the frame, and with a margin around it."""
    bodies = SCENES[scene]
    return look(rig(), bodies), look(widened_frame(rig(), MARGIN), bodies)


def plans() -> dict[str, PatternPlan]:
    """Three sets of long beats, and short fringes with Gray code."""
    w, h = rig().projector.width_px, rig().projector.height_px
    gray = (PhaseSteps("x", 16.0, equal_steps(4)), GrayCode("x", 8.0, w))
    return {
        "sets": fringe_plan(rig(), both=False),
        "gray": PatternPlan(w, h, (*gray, Uniform("white"), Uniform("black"))),
    }


def decoded(scene: str, plan: PatternPlan, optics: Optics, transport=()):
    """What is decoded of a scene, with the margin cut off."""
    inner = slice(MARGIN, -MARGIN)
    frames = photograph(view(scene)[1], plan, replace(optics, seed=7), transport=transport)
    return decode([f[inner, inner] for f in frames], plan)


def beyond_5(found: CoordinateMap, seen: View) -> float:
    """Share of the measured pixels that are beyond five standard deviations from the truth.

    Pixels that mix light at depth steps and borders of shadow may have the coordinate of any side.
    """
    truth = np.where(seen.lit, seen.projector_px[..., 0], np.nan)
    ok = found.reason == Reason.OK
    off = errors(found.coordinate_px, at_edges(np.empty(0), truth), 0.0)
    return float(np.mean(off[ok] > 5.0 * found.sigma_px[ok]))


def right_or_refused(scene: str, name: str, optics: Optics, transport=()) -> None:
    """Nothing is decoded, or what is decoded is right."""
    try:
        found = decoded(scene, plans()[name], optics, transport).x
    except InputError:
        return
    assert np.mean(found.reason[view(scene)[0].lit] == Reason.OK) > 0.15
    assert beyond_5(found, view(scene)[0]) <= BEYOND_5


OPTICS = {
    "nothing": Optics(),
    "liquid crystals": Optics(response=LCD),
    "bright mode": Optics(response=DLP_BRIGHT),
    "colour filters": Optics(bayer=Bayer()),
    "unbalanced filters": Optics(bayer=Bayer(balanced=False)),
    "raw mosaic": Optics(bayer=Bayer(output="raw")),
    "clipped channels": Optics(bayer=Bayer(), exposure=1.5),
    "compressed colour": Optics(bayer=Bayer(), jpeg=80),
    "projector out of focus": Optics(projector_lens=ThinLens(450.0, 12.0)),
    "camera out of focus": Optics(camera_lens=ThinLens(450.0, 4.0)),
}


@thinned(strength=1, fault=list(OPTICS), name=["sets", "gray"])
def test_coordinates_under_real_optics_are_right_or_refused(fault, name):
    right_or_refused("bust", name, OPTICS[fault])


@pytest.mark.parametrize("defocus", [0.15, 0.25, 0.4])
def test_a_visible_pixel_grid_does_no_harm(defocus):
    """A projector of 192 × 120 px, each pixel of which is five camera pixels wide."""
    coarse = Rig(rig().camera, standard_rig(scale=0.1).projector, rig().T_projector_camera)
    seen = look(coarse, SCENES["plane"])
    w, h = coarse.projector.width_px, coarse.projector.height_px
    plan = PatternPlan(w, h, tuple(PhaseSteps("x", w / n, equal_steps(4)) for n in (1, 4, 16)))
    found = decode(
        list(photograph(seen, plan, Optics(fill=0.85, defocus_px=defocus, exposure=0.8))), plan
    ).x
    assert np.mean(found.reason[seen.lit] == Reason.OK) > 0.9
    assert beyond_5(found, seen) <= BEYOND_5


@pytest.mark.parametrize("response", [LCD, DLP_BRIGHT], ids=["liquid crystals", "bright mode"])
def test_a_response_that_is_no_power_is_named(response):
    found = decoded("plane", plans()["gray"], Optics(response=response))
    assert any(f.kind == "response" and "γ" in f.causes[0] for f in found.findings)


@lru_cache
def within(scene: str, spread_mm: float):
    """Light that spreads in the material of a scene."""
    return subsurface(view(scene)[1], spread_mm=spread_mm, share=0.7)


@lru_cache
def bounce(scene: str):
    """One diffuse bounce in a scene; the groove's crease needs small patches."""
    return interreflection(view(scene)[1], SCENES[scene], patch_px=8 if scene == "groove" else 16)


@pytest.mark.long
@pytest.mark.parametrize("scene", ["groove", "bust"])
@pytest.mark.parametrize("name", ["sets", "gray"])
def test_one_bounce_does_no_harm(scene, name):
    right_or_refused(scene, name, Optics(), (bounce(scene),))


@thinned(strength=1, spread=[0.3, 1.0], name=["sets", "gray"])
def test_light_within_a_plane_does_no_harm(name, spread):
    right_or_refused("plane", name, Optics(), (within("plane", spread),))


@pytest.mark.parametrize("axis", ["columns", "rows"])
def test_the_edge_of_the_field_on_a_sheet_is_no_measurement(axis):
    """Half of the sheet is lit by the room only: shadow, and right up to the edge."""
    smaller = cropped_field(rig(), **{axis: (0, 500 if axis == "columns" else 290)})
    seen = look(smaller, SCENES["plane"])
    plan = fringe_plan(smaller, both=False)
    frames = list(photograph(seen, plan, Optics(ambient=0.25, exposure=0.8)))
    found = decode(frames, plan).x
    dark = (seen.body == 0) & ~ndimage.binary_dilation(seen.lit, iterations=3)
    assert dark.sum() > 20_000
    assert not (found.reason[dark] == Reason.OK).any()
    assert np.mean(found.reason[seen.lit] == Reason.OK) > 0.8
    assert beyond_5(found, seen) <= BEYOND_5


@pytest.mark.xfail(
    strict=True,
    reason="Light that spreads by σ in a material shifts coordinates by σ² times the slope of ln E, "
    "in all periods alike: 9,600 (sets) and 580 (gray) pixels per million are beyond 5 σ.",
)
@pytest.mark.parametrize("name", quick(["sets", "gray"], "sets"))
def test_light_within_a_round_body_does_no_harm(name):
    right_or_refused("bust", name, Optics(), (within("bust", 1.0),))


@pytest.mark.xfail(
    strict=False,
    reason="176 per million beyond 5 σ since the scatter of neighbours leaves out pixels at steps.",
)
def test_light_within_a_round_body_shifts_what_gray_code_reads_to_its_own_mean():
    """The coordinates are those of the light that leaves, as far as the decoder can know."""
    seen, wide = view("bust")
    spread = within("bust", 1.0)
    column = np.nan_to_num(wide.projector_px[..., 0])
    mean = spread(wide.shading * column) / np.maximum(spread(wide.shading), 1e-9)
    found = decoded("bust", plans()["gray"], Optics(), (spread,)).x
    near_edges = ndimage.binary_dilation(
        ndimage.morphological_gradient(np.where(seen.lit, seen.body, -1), 3) > 0, iterations=4
    )
    ok = (found.reason == Reason.OK) & seen.lit & ~near_edges
    off = np.abs(found.coordinate_px - mean[MARGIN:-MARGIN, MARGIN:-MARGIN])[ok]
    assert np.mean(off > 5.0 * found.sigma_px[ok]) <= BEYOND_5


# Two frames.

SMALL = standard_rig(scale=0.35)
PERIOD = 24.0
"""Period of the fringes, projector px; nearly the same in camera px."""
PAIR_OPTICS = {name: optics for name, optics in OPTICS.items() if name != "raw mosaic"} | {
    "compressed": Optics(jpeg=50),
    "both out of focus": Optics(
        projector_lens=ThinLens(500.0, 12.0), camera_lens=ThinLens(500.0, 8.0)
    ),
}
GOOD = ("fourier", "windowed_fourier", "windowed")
"""Methods whose σ covers a curved surface under a projector that is near."""


def bump(height_mm: float) -> list[Body]:
    """A smooth bump on a plane, towards the camera; or a hollow, for a negative height."""
    x = np.linspace(-120, 120, 241)
    height = height_mm * np.exp(-(x[:, None] ** 2 + x**2) / (2 * 22.0**2))
    towards_camera = rotation(np.array([np.pi, 0.0, 0.0]))
    return [Body(height_field(height, 1.0), pose(towards_camera, np.array([0, 0, 500.0])), 0.8)]


@lru_cache
def pair_views(height_mm: float, margin: int):
    """Views of the reference plane and of a bump, and their bodies."""
    wide = widened_frame(SMALL, margin)
    bodies = [ahead(Plane())], bump(height_mm)
    return tuple(look(wide, b) for b in bodies), bodies


def pair_under(optics: Optics, transport=None, height_mm: float = 10.0):
    """A pair and its true displacement, px; ``transport`` is made for a view and its bodies."""
    views, bodies = pair_views(height_mm, MARGIN)
    steps = [()] * 2
    if transport is not None:
        steps = [(transport(v, b),) for v, b in zip(views, bodies, strict=True)]
    wide = photograph_pair(*views, PERIOD, replace(optics, seed=5), transport=tuple(steps))
    inner = slice(MARGIN, -MARGIN)
    pair = Pair(wide.reference[inner, inner], wide.object[inner, inner], axis="x")
    return pair, pair_displacement(*pair_views(height_mm, 0)[0])


@lru_cache
def pair_of(fault: str):
    """A pair of the bump under the optics of this name, and its true displacement."""
    return pair_under(PAIR_OPTICS[fault])


def pair_beyond_5(pair: Pair, truth: np.ndarray, method: str) -> float:
    """Share of a method's pixels beyond five standard deviations, a period from the border."""
    found = analyse(pair, method)
    inner = np.isfinite(truth)
    inner[:24], inner[-24:], inner[:, :24], inner[:, -24:] = False, False, False, False
    inner = ndimage.binary_erosion(inner, iterations=12)
    ok = inner & (found.reason == Reason.OK)
    assert ok.sum() > 0.95 * inner.sum()
    return float(np.mean(np.abs(found.displacement_px - truth)[ok] > 5.0 * found.sigma_px[ok]))


@thinned(strength=1, fault=list(PAIR_OPTICS), method=GOOD)
def test_pairs_under_real_optics_are_right(fault, method):
    pair, truth = pair_of(fault)
    assert pair_beyond_5(pair, truth, method) <= BEYOND_5


@pytest.mark.long
def test_pairs_of_a_hollow_that_lights_itself_are_right():
    pair, truth = pair_under(Optics(), interreflection, height_mm=-15.0)
    for method in GOOD:
        assert pair_beyond_5(pair, truth, method) <= BEYOND_5, method


def test_pairs_of_a_material_that_light_enters_are_right():
    def spread(seen: View, _: list[Body]):
        return subsurface(seen, spread_mm=1.0, share=0.7)

    pair, truth = pair_under(Optics(), spread)
    for method in GOOD:
        assert pair_beyond_5(pair, truth, method) <= BEYOND_5, method


def test_the_wavelet_is_right_on_a_bump():
    pair, truth = pair_of("nothing")
    assert pair_beyond_5(pair, truth, "wavelet") <= BEYOND_5


def test_a_pair_of_raw_frames_is_named():
    pair, _ = pair_under(OPTICS["raw mosaic"])
    assert any(
        "raw frame of a colour camera" in note for note in reconstruct(pair, "fourier").notes
    )
    for fault in ("nothing", "compressed colour", "unbalanced filters"):
        notes = reconstruct(pair_of(fault)[0], "fourier").notes
        assert not any("colour camera" in note for note in notes), fault


# Boards.


def board_plan(of: Rig) -> PatternPlan:
    """Three sets of four steps along either axis, with periods of 16 px and more."""
    w, h = of.projector.width_px, of.projector.height_px
    along_x = [PhaseSteps("x", w / n, equal_steps(4)) for n in (14, 15, 17)]
    along_y = [PhaseSteps("y", h / n, equal_steps(4)) for n in (21, 22, 24)]
    return PatternPlan(w, h, (*along_x, *along_y))


def calibration_scores(of: Rig, optics: Optics, count: int, transport=None) -> np.ndarray:
    """Errors of a calibrated rig's parameters over their standard deviations."""
    plan, seen = board_plan(of), []
    for k, T in enumerate(poses(8)[:count]):
        of_board = look(of, [board_body(board(), T)])
        steps = () if transport is None else (transport(of_board),)
        frames = list(photograph(of_board, plan, replace(optics, seed=k), transport=steps))
        size, image = (plan.width_px, plan.height_px), texture(frames, plan)
        with contextlib.suppress(BoardNotFound):
            found = decode(frames, plan)
            seen.append(observe(image, found, board(), projector_size=size, name=f"pose{k}"))
    found = calibrate(seen, board()).rig
    free = np.diag(found.covariance) > 0
    return rig_errors(found, of)[free] / np.sqrt(np.diag(found.covariance)[free])


@pytest.mark.long
def test_a_calibration_under_real_optics_is_right_within_its_deviations():
    """Colour filters, liquid crystals, two lenses out of focus and paper that light enters."""
    optics = Optics(
        bayer=Bayer(),
        response=LCD,
        projector_lens=ThinLens(500.0, 6.0),
        camera_lens=ThinLens(500.0, 4.0),
    )
    score = calibration_scores(
        SMALL, optics, 3, lambda seen: subsurface(seen, spread_mm=0.2, share=0.7)
    )
    assert np.sqrt(np.mean(score**2)) < 1.5
    assert np.abs(score).max() < 5.0


@pytest.mark.long
def test_a_calibration_with_the_field_s_edge_on_the_board_is_right():
    """The projector lights a part of the board; the room lights all of it."""
    smaller = cropped_field(SMALL, columns=(210, 490))
    score = calibration_scores(smaller, Optics(ambient=0.25, exposure=0.8), 5)
    assert np.sqrt(np.mean(score**2)) < 1.5
    assert np.abs(score).max() < 5.0


def test_a_photographed_board_has_its_errors_of_print_and_bow():
    """What is found in the photograph are the corners of the real board."""
    wrong = BoardErrors(print_mm=0.1, bow_mm=1.0, direction_deg=30.0, seed=3)
    T = poses(4)[1]
    plan = replace(board_plan(SMALL), blocks=(Uniform("white"), *board_plan(SMALL).blocks))
    off = []
    for body in (board_body(board(), T), real_board_body(board(), wrong, T)):
        frame = next(photograph(look(SMALL, [body]), plan, Optics(noise=1.0)))
        seen = find_board(frame, board())
        real = project(SMALL.camera, transform(T, real_points(board(), wrong)))
        off.append(np.sqrt(np.mean((seen.pixels - real[seen.index]) ** 2)))
    assert off[0] > 0.1
    # Edges that lead to displaced neighbours are bent, which moves a fitted corner a little.
    assert off[1] < 0.04
