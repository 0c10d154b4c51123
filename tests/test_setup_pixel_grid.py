"""The set-up names moiré of the pixel grids with its period, and no moiré where there is none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fringeworks.scan.checks.pixel_grid import check_pixel_grid
from fringeworks.scan.setup import set_up
from tests.pixel_gaps import PixelGaps, flat_view
from tests.virtual_devices import bench

SHAPE = (150, 200)
NOISE = 0.015
"""Noise of a pixel, relative to white."""
SLOW = {"magnification": 1.05}
SKEW = {"magnification": 1.4, "turned_deg": 6.0}
SOFT = {"magnification": 2.2, "tilt": 0.04, "curved_px": 2.0}
GRIDS = {
    "slow beat": (SLOW, {"fill": 0.85, "open_side": 0.8}, 21.0, 0.12),
    "turned": (SKEW, {"fill": 0.9}, 1.0 / np.hypot(0.29, 0.075), 0.08),
    "resolved": (SOFT, {"fill": 0.95, "defocus_px": 0.2}, 2.2, 0.04),
}


def flat_picture(view, optics, seed=0, paint=0.0):
    """What the checks of levels and orientation would have measured."""
    x, y = flat_view(SHAPE, **view)
    size = int(x.max()) + 6, int(y.max()) + 6
    seen = PixelGaps(x, y, size, **optics)
    rng = np.random.default_rng(seed)
    light = 200.0 * seen.projected(np.ones(size[::-1])) / seen.white
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    light *= 1.0 - 0.3 * (u / SHAPE[1]) ** 2
    light *= 1.0 - paint * ((u // 9 + v // 7) % 2)
    light += 200.0 * NOISE * rng.standard_normal(SHAPE)
    places = [(c + 0.04 * rng.standard_normal(SHAPE)).astype(np.float32) for c in (x, y)]
    return (
        SimpleNamespace(white=light.astype(np.float32), lit=np.ones(SHAPE, bool)),
        SimpleNamespace(x_px=places[0], y_px=places[1]),
    )


@pytest.mark.parametrize("name", GRIDS)
def test_period_direction_and_amplitude_are_measured(name):
    view, optics, period, amplitude = GRIDS[name]
    found = check_pixel_grid(*flat_picture(view, optics))
    assert found.period_px == pytest.approx(period, rel=0.05)
    assert found.amplitude == pytest.approx(amplitude, rel=0.3)
    turned = view.get("turned_deg", 0.0)
    across = min(abs((found.direction_deg - d + 90.0) % 180.0 - 90.0) for d in (0, 90))
    # The beat of grids that are turned against each other is turned by more than they are.
    assert (across > 5.0) == bool(turned)
    (finding,) = found.findings
    assert finding.kind == "pixel grid"
    assert "defocus the projector" in finding.advice
    assert finding.figures["period_px"] == found.period_px


@pytest.mark.parametrize("paint", [0.0, 0.5])
@pytest.mark.parametrize("name", GRIDS)
def test_pixels_without_gaps_are_not_named(name, paint):
    view = GRIDS[name][0]
    found = check_pixel_grid(*flat_picture(view, {"fill": 1.0}, 1, paint))
    assert found.findings == ()
    # A print that repeats has a spectrum of its own, but it is no more than that of the paint.
    assert paint or not found.seen


def test_a_frame_that_is_hardly_lit_is_not_judged():
    levels, orientation = flat_picture(SLOW, {})
    levels.lit[:, 8:] = False
    assert check_pixel_grid(levels, orientation) is None


def test_a_setup_names_the_grid():
    x, y = flat_view((72, 96), 1.9, turned_deg=4.0)
    scene = PixelGaps(x, y, (64, 56), fill=0.9, open_side=0.8)
    b = bench({"width_px": 64, "height_px": 56}, scene=scene)
    found = set_up(b.projector, b.camera)
    assert [f.kind for f in found.findings] == ["pixel grid"]
    assert found.pixel_grid.seen


def test_camera_pixels_that_mix_projector_pixels_are_no_resized_picture():
    """The contrast of fine stripes beats with the pixel grids without any gaps."""
    x, y = flat_view((96, 128), 1.3, tilt=0.02)
    scene = PixelGaps(x, y, (108, 80), fill=1.0, defocus_px=0.6)
    b = bench({"width_px": 108, "height_px": 80}, scene=scene, seed=1)
    assert set_up(b.projector, b.camera).findings == ()
