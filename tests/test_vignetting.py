"""Vignetting: what the fall-off of the projected light is told apart from, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks.scan.checks.levels import Levels
from fringeworks.scan.checks.orientation import Orientation
from fringeworks.scan.checks.vignetting import check_vignetting
from fringeworks.types import CameraNoise

pytestmark = pytest.mark.statistical

SIZE = (640, 400)
NOISE = CameraNoise(2.0, 0.01)
EMPTY = np.empty(0)


def seen(albedo=1.0, bend_px=0.0, cover=1.0, corner=1.0, across=0.0, noise=0.0):
    """A camera that sees a share of the projector's picture; ``corner`` is the light there."""
    h, w = 240, 320
    v, u = np.mgrid[:h, :w]
    a, b = cover * (u / (w - 1) - 0.5), cover * (v / (h - 1) - 0.5)
    # A camera from the side sees a plane by a projective map.
    x = (0.5 + a / (1 + 0.2 * a)) * SIZE[0] + bend_px * (2 * a) ** 2
    y = (0.5 + b / (1 + 0.2 * a)) * SIZE[1]
    half = 0.5 * np.hypot(*SIZE)
    r2 = ((x - 0.5 * SIZE[0]) ** 2 + (y - 0.5 * SIZE[1]) ** 2) / half**2
    light = 180.0 * albedo * corner**r2 * np.exp(across * (x / SIZE[0] - 0.5))
    light = light + noise * np.random.default_rng(0).standard_normal(light.shape)
    levels = Levels(
        EMPTY, EMPTY, light > 1, light.astype(np.float32), 1.0, 50.0, 0.0, EMPTY, EMPTY, ()
    )
    return levels, Orientation(x.astype(np.float32), y.astype(np.float32), False, ())


def check(**scene):
    return check_vignetting(SIZE, *seen(**scene), NOISE)


@pytest.mark.parametrize("corner", [1.0, 0.7, 0.3])
@pytest.mark.parametrize("across", [0.0, 0.8])
def test_the_fall_off_is_that_of_the_devices(corner, across):
    """Light from the side and tilt change the linear part only."""
    found = check(corner=corner, across=across, noise=3.0)
    assert found.judged == "fall-off"
    assert found.corner_share == pytest.approx(corner**found.reach**2, rel=0.02)
    assert found.covered_share > 0.9
    light = 180.0 * np.array([found.corner_share, 1.0])
    sigma = np.sqrt(NOISE.variance(0.5 * light)) / light
    assert found.sigma_ratio == pytest.approx(sigma[0] / sigma[1], rel=0.02)
    assert [f.kind for f in found.findings] == (["vignetting"] if corner == 0.3 else [])


def test_patches_of_another_albedo_are_left_out():
    albedo = np.ones((240, 320))
    albedo[30:80, 40:110] = albedo[150:190, 200:260] = 0.92
    found = check(corner=0.4, albedo=albedo)
    assert found.corner_share == pytest.approx(0.4**found.reach**2, rel=0.03)


@pytest.mark.parametrize(
    ("scene", "judged"),
    [
        ({"cover": 0.5}, "covers little"),
        ({"bend_px": 60.0}, "not flat"),
        ({"albedo": np.kron([[1, 0.3] * 4, [0.3, 1] * 4] * 3, np.ones((40, 40)))}, "uneven"),
        ({"albedo": np.kron(np.eye(2), np.ones((120, 160))) * 1e-3}, "covers little"),
    ],
    ids=["small", "curved", "checkered", "dark"],
)
def test_what_cannot_be_told_is_not_judged(scene, judged):
    found = check(corner=0.2, **scene)
    assert found.judged == judged
    assert found.findings == ()
    assert np.isnan(found.corner_share)
    assert "cannot be judged" in f"{found}"
