"""The zero of two frames: a moved camera or pattern is found at the rim, and removed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import InputError, Pair, reconstruct
from fringeworks.pair.analyse import analyse
from fringeworks.pair.prepared import prepare
from fringeworks.pair.rim import UNKNOWN_PERIODS, measure_rim, of_pixels
from tests.grids import quick
from tests.shared import shared
from tests.two_frames import Bench, cap, dome

pytestmark = pytest.mark.statistical

SMALL = {"shape": (130, 180), "period": 10.0}
BODY = dome(32.0, 5.0)
MOVES = {
    "still": {},
    "half a pixel": {"move": (0.5, 0.0)},
    "two pixels": {"move": (2.0, 1.0)},
    "turned": {"camera_turn": 0.2},
    "drifted": {"drift": 0.15},
    "tilted fringes": {"roll": 30.0, "move": (0.5, 0.5), "camera_turn": 0.2},
    "uneven periods": {"beside": 500.0, "projector_height": 350.0, "camera_turn": 0.2},
}


@shared
def taken(name):
    bench = Bench(**SMALL, **MOVES[name])
    return bench.pair(BODY)


def plate(x, y):
    """A plane above that of the reference."""
    return np.full(np.broadcast(x, y).shape, 1.5)


def kinds(result):
    return [f.kind for f in result.warnings]


@pytest.mark.parametrize("method", quick(["windowed", "fourier"], "windowed"))
@pytest.mark.parametrize("name", MOVES)
def test_a_movement_is_removed_and_told(name, method):
    reference, object_, u, lit = taken(name)
    result = reconstruct(Pair(reference, object_, axis="x"), method)
    found = result.displacement
    inner = lit.copy()
    inner[:6] = inner[-6:] = inner[:, :6] = inner[:, -6:] = False
    z = np.abs(found.displacement_px - u)[inner] / found.sigma_px[inner]
    assert np.isfinite(z).mean() > 0.97
    z = z[np.isfinite(z)]
    assert np.mean(z < 2) >= 0.9
    assert np.mean(z > 5) <= 0.001
    assert kinds(result) == ([] if name == "still" else ["moved frame"])
    figures = {} if name == "still" else result.warnings[0].figures
    if name == "turned":
        assert figures["turn_deg"] == pytest.approx(0.2, abs=0.02)
    if name in ("half a pixel", "two pixels"):
        assert figures["shift_px"] == pytest.approx(MOVES[name]["move"][0], abs=0.02)


def test_without_a_rim_of_background_the_zero_is_unknown():
    """A body that fills the frame looks the same in every order, and this is said."""
    reference, object_, u, _ = Bench(**SMALL).pair(cap(220.0, 26.0))
    result = reconstruct(Pair(reference, object_, axis="x"))
    assert kinds(result) == ["no background"]
    error = (result.displacement.displacement_px - u)[8:-8, 8:-8]
    whole = np.nanmedian(error) / result.displacement.period_px
    assert abs(whole) > 0.5  # what the finding warns of: off by a period


FILLING = {
    "cap": cap(220.0, 26.0),
    "low cap": cap(250.0, 9.0),
    "waves": lambda x, y: 21.0 + 3.0 * np.sin(x / 9.0) * np.cos(y / 11.0),
    "ramp": lambda x, y: 24.0 + 0.15 * x + 0.05 * y,
    "plate": lambda x, y: np.full(np.broadcast(x, y).shape, 25.0),
}


@pytest.mark.parametrize("method", ["windowed", "fourier", "exact"])
@pytest.mark.parametrize("body", FILLING)
def test_an_object_that_fills_the_frame_may_be_off_by_whole_periods(body, method):
    """This is said, it is in σ, and the parts of the surface fit to one another."""
    reference, object_, u, _ = Bench(**SMALL, seed=5).pair(FILLING[body])
    result = reconstruct(Pair(reference, object_, axis="x"), method)
    found = result.displacement
    assert set(kinds(result)) & {"no background", "moved frame"}
    inner = np.s_[10:-10, 10:-10]
    error = (found.displacement_px - u)[inner]
    assert np.isfinite(error).mean() > 0.9
    assert np.nanmax(np.abs(error) / found.sigma_px[inner]) < 2
    alone, zero = of_pixels(found)
    assert zero == pytest.approx(UNKNOWN_PERIODS * found.period_px)
    assert np.nanmedian(alone.sigma_px) < 0.02 * found.period_px
    # Off by whole periods of the local fringes, the error changes slowly.
    assert np.nanmax(np.abs(np.diff(error, axis=0))) < 0.4 * found.period_px


@pytest.mark.parametrize("method", ["windowed", "fourier"])
def test_the_skirt_of_an_object_is_no_movement(method):
    def hill(x, y):
        return 9.0 * np.exp(-(x**2 + y**2) / 2 / 22.0**2)

    reference, object_, u, lit = Bench(**SMALL, seed=6).pair(hill)
    result = reconstruct(Pair(reference, object_, axis="x"), method)
    assert kinds(result) == []
    lit[:6] = lit[-6:] = lit[:, :6] = lit[:, -6:] = False
    z = np.abs(result.displacement.displacement_px - u)[lit] / result.displacement.sigma_px[lit]
    assert np.nanmean(z < 2) > 0.9
    assert np.nanmean(z > 5) < 0.001


def test_a_rim_that_is_off_by_a_period_does_not_tell_the_zero():
    reference, object_, _, _ = taken("still")
    prepared = prepare(Pair(reference, object_, axis="x"))
    found = analyse(prepared, "fourier")
    assert measure_rim(prepared, found).is_background
    off = replace(found, displacement_px=found.displacement_px + np.float32(prepared.period))
    assert not measure_rim(prepared, off).is_background


def test_a_plane_that_fills_the_frame_keeps_its_displacement():
    bench = Bench(**SMALL)
    reference, object_, u, _ = bench.pair(plate)
    result = reconstruct(Pair(reference, object_, axis="x"))
    assert kinds(result) == ["moved frame"]
    assert "kept" in result.warnings[0].seen
    assert np.nanmedian(result.displacement.displacement_px - u) == pytest.approx(0, abs=0.02)


def test_the_zero_may_be_that_of_the_reference_or_of_a_marked_background():
    reference, object_, u, _ = taken("two pixels")
    kept = reconstruct(Pair(reference, object_, axis="x"), "fourier", zero="reference")
    assert kinds(kept) == []
    assert np.nanmedian(kept.displacement.displacement_px - u) == pytest.approx(2.0, abs=0.05)
    marked = np.zeros(u.shape, bool)
    marked[:30] = True
    pair = Pair(reference, object_, axis="x", background=marked)
    assert np.nanmedian(reconstruct(pair).displacement.displacement_px - u) == pytest.approx(
        0, abs=0.05
    )
    with pytest.raises(InputError, match="background: expected shape"):
        reconstruct(Pair(reference, object_, axis="x", background=marked[:5]))
    with pytest.raises(InputError, match="zero: expected rim or reference"):
        reconstruct(Pair(reference, object_, axis="x"), zero="middle")


def test_real_pairs_show_their_background(real_data):
    """Both photographs were taken by hand: their fringes at the rim are off by 0.2 and 0.4 px."""
    for name, shift in (("pair_cone", -0.18), ("pair_pyramid", 0.38)):
        result = reconstruct(
            Pair(*(_grey(real_data / name / f"{part}.jpg") for part in ("reference", "object")))
        )
        assert kinds(result) == ["moved frame"]
        assert result.warnings[0].figures["shift_px"] == pytest.approx(shift, abs=0.1)


def _grey(path):
    from PIL import Image

    return np.asarray(Image.open(path).convert("L"))
