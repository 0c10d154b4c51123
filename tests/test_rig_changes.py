"""What poses of a board say about changes of a rig: corrected rigs cover, named figures hold."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from fringeworks.rig.calibration.board_points import by_rig, corner_points
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.changes import fit_changes, possible_changes
from fringeworks.rig.calibration.drift import likely_causes
from fringeworks.rig.calibration.parameters import moved_rig, parameter_change
from fringeworks.rig.calibration.poses import fit_pose
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.calibration.start import first_pose
from fringeworks.rig.pinhole import pose, project, rotation, transform
from fringeworks.simulate.standard import board_poses, standard_rig
from fringeworks.types import RIG_PARAMETERS
from tests.rigs import board, sighting

pytestmark = pytest.mark.statistical

PRINT_MM = 0.02
NOISE = {"corner": 0.02, "phase": 0.01}
CHANGES = {
    "rotation": {"rotation_x": 3e-4, "rotation_y": -5e-4},
    "translation": {"translation_x": 0.3, "translation_y": -0.2, "translation_z": 0.4},
    "slide": {"translation_z": 0.2},
    "pose": {"rotation_y": 2e-3, "translation_x": 0.5, "translation_z": -0.3},
    "camera focus": {"camera_f": 0.01},
    "projector focus": {"projector_f": -0.003},
    "warm lenses": {"camera_f": 5e-4, "projector_f": 5e-4},
    "knock and refocus": {"rotation_y": 2e-3, "camera_f": 3e-3},
    "all": {"rotation_x": 1e-3, "translation_y": 0.4, "camera_f": 4e-3, "projector_f": -2e-3},
}
"""Changes by name; focal lengths (f) are relative."""


@lru_cache
def truth(seed):
    """A rig whose angle differs from seed to seed."""
    baseline_mm = np.random.default_rng(seed).uniform(120, 450)
    return standard_rig(scale=0.5, baseline_mm=baseline_mm)


def printed(rng):
    """Where the points of a board really are."""
    return board().points_mm + rng.normal(0, PRINT_MM, board().points_mm.shape)


@lru_cache
def calibration(seed):
    rng = np.random.default_rng([seed, 1])
    real = printed(rng)
    places = board_poses(board(), 12, seed=seed)
    seen = [sighting(truth(seed), board(), T, rng, real_mm=real, **NOISE) for T in places]
    return adjust(seen, truth(seed), places).rig, real


def step(seed, steps):
    """A change of the 24 parameters."""
    change, rig = np.zeros(24), truth(seed)
    for name, value in steps.items():
        if name.endswith("_f"):
            device, first = (rig.camera, 0) if name == "camera_f" else (rig.projector, 9)
            change[first : first + 2] = value * np.array(device.focal_px)
        else:
            change[RIG_PARAMETERS.index(name.replace("_", " "))] = value
    return change


def checked(seed, steps, poses=1):
    """The true rig after a change, and what poses of the board say about it."""
    rig, real = calibration(seed)
    now = moved_rig(truth(seed), step(seed, steps))
    rng = np.random.default_rng([seed, 2])
    places = board_poses(board(), 12, seed=50 + seed)[:poses]
    seen = [sighting(now, board(), T, rng, real_mm=real, **NOISE) for T in places]
    starts = [fit_pose(s, rig, first_pose(s, rig.camera)) for s in seen]
    return now, fit_changes(rig, seen, starts)


def plane_errors(found, now):
    """Mean deviation of planes in z, and its standard deviation, mm; (3, 2)."""
    x, y = np.meshgrid(np.linspace(-70, 70, 7), np.linspace(-50, 50, 5))
    flat = np.stack((x, y, 0 * x), axis=-1).reshape(-1, 3)
    errors = []
    for turn, z in (((0.0, 0.0, 0.0), 480.0), ((0.3, -0.2, 0.0), 500.0), ((-0.2, 0.3, 0.0), 540.0)):
        points = transform(pose(rotation(np.array(turn)), np.array([0.0, 0.0, z])), flat)
        in_projector = project(now.projector, transform(now.T_projector_camera, points))
        none, index = np.zeros((len(points), 2, 2)), np.arange(len(points))
        seen = Sighting(points, project(now.camera, points), in_projector, none, index)

        def mean_z(of, seen=seen):
            return np.atleast_1d(corner_points(of, seen)[:, 2].mean())

        variance = np.sum(by_rig(found, found.covariance, mean_z) ** 2)
        errors.append((mean_z(found)[0] - points[:, 2].mean(), np.sqrt(variance)))
    return np.array(errors).T


@pytest.mark.parametrize("change", list(CHANGES))
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 20))]
)
def test_a_corrected_rig_covers(change, seed):
    now, fits = checked(seed, CHANGES[change], poses=1 + seed % 2)
    error, sigma = plane_errors(fits.adjusted(), now)
    assert (np.abs(error) < 3 * sigma).all()


@pytest.mark.long
def test_standard_deviations_of_corrected_rigs_are_the_errors():
    errors = [
        np.divide(*plane_errors(fits.adjusted(), now))
        for seed in range(100, 110)
        for now, fits in (checked(seed, steps) for steps in CHANGES.values())
    ]
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.2


@pytest.mark.parametrize(
    ("change", "name", "causes_of"),
    [
        ("rotation", "rotation", {"rotation"}),
        ("translation", "translation", {"translation"}),
        ("slide", "translation", {"translation"}),
        ("pose", "pose", {"rotation", "translation"}),
        ("camera focus", "camera focus", {"camera focus"}),
        ("projector focus", "projector focus", {"projector focus"}),
        ("knock and refocus", "rotation with camera focus", {"rotation", "camera focus"}),
    ],
)
def test_figures_that_are_named_hold(change, name, causes_of):
    for seed in range(2):
        _, fits = checked(seed, CHANGES[change], poses=2)
        assert name in {cause.name for cause in likely_causes(fits.rig, fits)}
        causes = frozenset(causes_of)
        found = fits.mean(causes)
        moved = np.any([np.any(possible_changes(fits.rig)[k], axis=1) for k in causes], axis=0)
        sigma = np.sqrt(np.diag(found.covariance)[moved])
        off = (found.change - step(seed, CHANGES[change]))[moved]
        assert (np.abs(off) < 3 * sigma).all()


def test_causes_that_a_pose_cannot_tell_apart_are_named_together():
    """A projector that slides along its axis looks like one with another focal length."""
    _, fits = checked(0, CHANGES["slide"])
    assert {cause.name for cause in likely_causes(fits.rig, fits)} >= {
        "translation",
        "projector focus",
    }
    _, fits = checked(0, CHANGES["warm lenses"])
    assert {cause.name for cause in likely_causes(fits.rig, fits)} == {
        "baseline",
        "camera focus with projector focus",
    }


def test_a_board_does_not_confirm_the_calibration_that_it_made():
    rig, _ = calibration(0)
    now, fits = checked(0, {}, poses=3)
    sigma, before = plane_errors(fits.adjusted(), now)[1], plane_errors(rig, now)[1]
    assert (sigma > 0.97 * before).all()


@pytest.mark.parametrize("angle", [1e-5, 0.01, 0.5, 3.0])
def test_the_change_of_a_pose_is_its_rotation_vector(angle):
    turn = angle * np.array([0.6, 0.0, -0.8])
    change = np.zeros(24)
    change[18:21] = turn
    found = parameter_change(moved_rig(truth(0), change), truth(0))
    np.testing.assert_allclose(found[18:21], turn, atol=1e-12)
