"""The simulated faults of the fault table do what they say."""

import numpy as np
import pytest

from tests.fault_measure import EVERY, capture, expand, run
from tests.fault_scenes import MARGIN, pixels, plans, see, see_fine
from tests.fault_stage import Stage

pytestmark = pytest.mark.statistical

STAGE = Stage("steps", plans()["gray-3"])


CLEAN = capture("quantised", STAGE, 1).frames


@pytest.mark.parametrize("condition", [name for name in EVERY if name != "quantised"])
def test_a_fault_changes_the_frames_and_keeps_the_truth(condition):
    shot = capture(condition, STAGE, 1)
    assert shot.frames.shape == CLEAN.shape
    assert np.mean(np.isfinite(shot.truth[0])) > 0.8
    assert not np.array_equal(shot.frames, CLEAN)


@pytest.mark.parametrize("condition", ["lost", "late+2", "vibration"])
def test_a_seed_gives_the_same_frames_again(condition):
    first, again, other = (capture(condition, STAGE, seed).frames for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_named_frames_are_the_ones_exchanged():
    swapped = capture("swapped:2-5", STAGE, 0).frames
    for i, shown in ((2, 5), (5, 2), (3, 3)):
        assert np.abs(swapped[i] - CLEAN[shown].astype(float)).mean() < 1.0
    assert len(expand("swapped:*", STAGE.plan)) == 45


def test_pixels_of_a_displaced_camera_are_those_of_the_displaced_scene():
    fine = see_fine("bust", 1024).x
    for shift in ((0.0, 0.0), (1.0, -1.0), (0.37, 0.81)):
        moved = pixels(fine, shift)
        error = moved - see("bust", 1024, shift).x
        assert np.median(np.abs(error[MARGIN:-MARGIN, MARGIN:-MARGIN])) < 0.01


def test_a_clean_shot_is_measured_right_and_its_sigma_covers():
    tally = run("noise-2", plans()["hierarchical-4"]).bands["all"]
    assert tally.wrong_per_million < 10
    assert 0.65 < tally.coverage[0] < 0.72
    assert tally.ok_share > 0.8
