"""Devices that Brown's model cannot express: their fields, and what is measured with them.

The errors are made by functions of the pixel that are no splines. Points are measured as rays and
columns meet, without noise, so that what is off is the calibration alone.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.coefficients import free_parameters
from fringeworks.rig.calibration.device_fields import with_fields
from fringeworks.rig.calibration.diagnosis import diagnose
from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.rig.point_errors import point_errors
from fringeworks.rig.ray_depth import inverse_depth
from fringeworks.simulate.standard import board_poses
from tests.rigs import board, calibrated, rig, sighting

pytestmark = pytest.mark.statistical

PRINT_MM = 0.02
CORNER_PX, PHASE_PX = 0.015, 0.008
RADIUS_MM = 28.0
PLACES_MM = ((0.0, 0.0, 510.0), (30.0, -20.0, 520.0), (-25.0, 15.0, 500.0))


def straight(pixels):
    return pixels


def sine(size_px, periods, phase):
    """A projector that is off along its columns by a sine."""

    def device(pixels):
        turns = periods * pixels[..., 0] / rig().projector.width_px
        off = size_px * np.sin(2 * np.pi * turns + phase)
        return pixels + np.stack((off, np.zeros_like(off)), axis=-1)

    return device


def smooth(seed, size_px):
    """A camera that is off by waves in all directions, with up to three periods over its width."""
    rng = np.random.default_rng(seed)
    wave, phase = rng.uniform(-3, 3, (14, 2)), rng.uniform(0, 2 * np.pi, (14, 2))
    strength = rng.normal(0, 1, (14, 2))
    strength *= size_px * np.sqrt(2) / np.linalg.norm(strength, axis=0)

    def device(pixels):
        at = 2 * np.pi * (pixels / rig().camera.width_px) @ wave.T
        off = [np.sin(at + phase[:, k]) @ strength[:, k] for k in range(2)]
        return pixels + np.stack(off, axis=-1)

    return device


def sightings(seed, camera=straight, projector=straight, poses=12):
    """Poses of a printed board, and what such devices see of it."""
    rng = np.random.default_rng(seed)
    real = board().points_mm + rng.normal(0, PRINT_MM, board().points_mm.shape)
    places = board_poses(board(), poses, seed=seed)
    seen = [
        sighting(rig(), board(), T, rng, corner=CORNER_PX, phase=PHASE_PX, real_mm=real)
        for T in places
    ]
    bent = [
        replace(s, camera_px=camera(s.camera_px), projector_px=projector(s.projector_px))
        for s in seen
    ]
    return bent, places


def found(seed, camera=straight, projector=straight):
    """The rig without fields and the rig with them, and what the fields add."""
    seen, places = sightings(seed, camera, projector)
    free = free_parameters(None)
    plain = adjust(seen, rig(), places, free=free)
    adjusted, fields = with_fields(seen, plain, free=free)
    corners = sum(len(s.index) for s in seen)
    return plain.rig, fields.inflated(adjusted.rig, fields.scatter_factor(corners)), fields


def cap(centre, radius_mm, half_mm, count):
    """Points of a sphere that faces the camera."""
    x, y = np.meshgrid(*2 * (np.linspace(-half_mm, half_mm, count),))
    inside = np.hypot(x, y) < half_mm
    x, y = x[inside], y[inside]
    return np.array(centre) + np.column_stack((x, y, -np.sqrt(radius_mm**2 - x**2 - y**2)))


def measured(with_rig, points, camera, projector):
    """The same points as such devices and this rig measure them."""
    pixels = camera(project(rig().camera, points))
    lit = projector(project(rig().projector, transform(rig().T_projector_camera, points)))
    return rays(with_rig.camera, pixels) / inverse_depth(with_rig, pixels, lit[:, 0], "x")[:, None]


def fitted(points, radius_mm):
    """Centre and radius by least squares, and their derivative by the points, (4, n, 3)."""
    centre, radius = points.mean(axis=0) + np.array([0.0, 0.0, 0.8 * radius_mm]), radius_mm
    for _ in range(20):
        out = points - centre
        length = np.linalg.norm(out, axis=1)
        normal = out / length[:, None]
        gain = np.linalg.pinv(np.column_stack((normal, np.ones(len(points)))))
        step = gain @ (length - radius)
        centre, radius = centre + step[:3], radius + step[3]
    return centre, radius, gain[:, :, None] * normal


def scores(with_rig, camera=straight, projector=straight):
    """Errors of three spheres' radii and of a spacing of 60 mm, mm, and over their σ, (2, 4)."""
    errors, sigmas = [], []
    plain = SimpleNamespace(residual_px=None)
    for place in PLACES_MM:
        points = measured(with_rig, cap(place, RADIUS_MM, 20.0, 60), camera, projector)
        _, radius, by = fitted(points, RADIUS_MM)
        parts = np.einsum("ni,nik->k", by[3], point_errors(with_rig, points, plain))
        errors.append(radius - RADIUS_MM)
        sigmas.append(np.linalg.norm(parts))
    ends = [cap((x, 0.0, 510.0), 15.0, 10.0, 20) for x in (-30.0, 30.0)]
    ends = [measured(with_rig, end, camera, projector) for end in ends]
    (one, _, by_one), (two, _, by_two) = (fitted(end, 15.0) for end in ends)
    along = (two - one) / np.linalg.norm(two - one)
    by = np.concatenate((-np.tensordot(along, by_one[:3], 1), np.tensordot(along, by_two[:3], 1)))
    parts = np.einsum("ni,nik->k", by, point_errors(with_rig, np.concatenate(ends), plain))
    errors.append(np.linalg.norm(two - one) - 60.0)
    sigmas.append(np.linalg.norm(parts))
    return np.array([errors, np.array(errors) / sigmas])


BENT = {
    "projector, 0.15 px, 4 periods": lambda k: (straight, sine(0.15, 4, k)),
    "projector, 0.05 px, 4 periods": lambda k: (straight, sine(0.05, 4, k)),
    "camera, 0.1 px, smooth": lambda k: (smooth(k, 0.1), straight),
    "both": lambda k: (smooth(k, 0.05), sine(0.05, 5, k)),
}
"""Devices by what is wrong with them."""


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("what", BENT)
@pytest.mark.parametrize(
    ("first", "seeds"), [(700, 1), pytest.param(720, 8, marks=pytest.mark.long)]
)
def test_what_such_devices_measure_is_right(what, first, seeds):
    before, after = [], []
    for seed in range(first, first + seeds):
        devices = BENT[what](seed)
        plain, corrected, fields = found(seed, *devices)
        for device, size, scatter in zip(
            devices, fields.size_px, (CORNER_PX, PHASE_PX), strict=True
        ):
            # A device that follows the model may get a field as small as noise.
            assert size < 0.25 * scatter if device is straight else size > scatter
        before.append(scores(plain, *devices))
        after.append(scores(corrected, *devices))
    before, after = np.array(before), np.array(after)
    # Without fields, spheres or spacings are off by more than four σ.
    assert np.abs(before[:, 1]).max() > 4.0
    errors = [np.sqrt(np.mean(one[:, 0] ** 2)) for one in (before, after)]
    assert errors[1] < 0.25 * errors[0]
    z = after[:, 1]
    assert np.abs(z).max() < 3.5
    # The four scores of a rig are correlated: of few rigs they say no more.
    if seeds > 4:
        usual = [scores(found(seed)[1])[1] for seed in range(first, first + seeds)]
        assert np.sqrt(np.mean(z**2)) < 1.25 * max(1.0, np.sqrt(np.mean(np.square(usual))))
        assert np.mean(np.abs(z) < 2.0) > 0.85


@pytest.mark.parametrize("seeds", [3, pytest.param(40, marks=pytest.mark.long)])
def test_devices_that_follow_the_model_have_no_field(seeds):
    wrong = 0
    for seed in range(800, 800 + seeds):
        plain, corrected, fields = found(seed)
        if fields.any:
            # A field that noise makes is as small as noise, and changes hardly anything.
            wrong += 1
            assert max(fields.size_px) < 0.25 * PHASE_PX
            change = scores(corrected) - scores(plain)
            assert np.abs(change[1]).max() < 1.0
        else:
            assert corrected.camera == plain.camera
            np.testing.assert_array_equal(corrected.covariance, plain.covariance)
    assert wrong <= 0.05 * seeds + 1


def test_calibrations_from_photographs_say_what_they_found():
    good = calibrated()
    assert good.field_px == (0.0, 0.0)
    assert good.rig.projector.field is None
    bent = replace(good, field_px=(0.0, 0.04), field_sigma_px=(0.0, 0.002))
    (finding,) = (f for f in diagnose(bent) if f.kind == "field")
    assert "the projector deviates from the model of its lens by 0.040 px" in finding.text
    assert finding.figures == {"field_px": 0.04, "field_sigma_px": 0.002}


def brown(values, points):
    """Pixels of points by a pinhole with Brown's distortion, written out once more."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = values
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return np.stack((fx * u + cx, fy * v + cy), axis=-1)


class Oracle:
    """A dense fit of all parameters with SciPy, the projector's field by other splines.

    The field acts before the projector's pixel, not after it, and is as smooth as its second
    differences are small.
    """

    knots = np.linspace(-1.0, 1.0, 13)
    weight = 0.05

    def __init__(self, seen, start, places):
        self.seen, self.points = seen, board().points_mm
        vectors = [
            np.r_[scipy.spatial.transform.Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3]]
            for T in (start.T_projector_camera, *places)
        ]
        lenses = np.r_[start.camera.parameters, start.projector.parameters]
        self.size = len(self.knots) + 2
        self.start = np.r_[lenses, np.ravel(vectors), np.zeros(2 * self.size**2)]

    def field(self, values, pixels):
        at = np.clip((pixels - (480.0, 300.0)) / 490.0, -1.0, 1.0 - 1e-9)
        knots = np.r_[[-1.0] * 3, self.knots, [1.0] * 3]
        across, down = (
            scipy.interpolate.BSpline.design_matrix(at[:, k], knots, 3).toarray() for k in range(2)
        )
        control = values.reshape(2, self.size, self.size)
        return np.einsum("nj,cji,ni->nc", down, control, across)

    def pixels(self, values, points):
        """Pixels of points, in coordinates of the camera, in both devices."""
        turn = scipy.spatial.transform.Rotation.from_rotvec(values[18:21])
        lit = brown(values[9:18], turn.apply(points) + values[21:24])
        return brown(values[:9], points), lit + self.field(values[-2 * self.size**2 :], lit)

    def residuals(self, values):
        parts = []
        poses = values[24 : -2 * self.size**2].reshape(-1, 6)
        for s, pose in zip(self.seen, poses, strict=True):
            turn = scipy.spatial.transform.Rotation.from_rotvec(pose[:3])
            pixel, lit = self.pixels(values, turn.apply(self.points) + pose[3:])
            off = s.camera_px - pixel
            read = s.projector_px - lit - np.einsum("nij,nj->ni", s.by_pixel, off)
            parts += [off.ravel() / CORNER_PX, read.ravel() / PHASE_PX]
        control = values[-2 * self.size**2 :].reshape(2, self.size, self.size)
        bends = [np.diff(control, 2, axis=axis).ravel() for axis in (1, 2)]
        return np.concatenate((*parts, *(self.weight * b / PHASE_PX for b in bends)))

    def fit(self):
        return scipy.optimize.least_squares(
            self.residuals, self.start, x_scale="jac", ftol=1e-6, max_nfev=12
        ).x

    def measured(self, values, points, projector):
        """Depths at which pixels of the truth and this model's columns meet."""
        pixel = project(rig().camera, points)
        lit = projector(project(rig().projector, transform(rig().T_projector_camera, points)))

        def miss(unknown):
            at = unknown.reshape(-1, 3)
            seen, column = self.pixels(values, at)
            return np.column_stack((seen - pixel, column[:, 0] - lit[:, 0])).ravel()

        n = len(points)
        pattern = scipy.sparse.block_diag([np.ones((3, 3))] * n)
        found = scipy.optimize.least_squares(miss, points.ravel(), jac_sparsity=pattern, xtol=1e-12)
        return found.x.reshape(-1, 3)


def test_a_dense_fit_with_other_splines_measures_the_same():
    projector = sine(0.1, 3, 1.0)
    rng = np.random.default_rng(900)
    places = board_poses(board(), 8, seed=900)
    seen = [sighting(rig(), board(), T, rng, corner=CORNER_PX, phase=PHASE_PX) for T in places]
    seen = [replace(s, projector_px=projector(s.projector_px)) for s in seen]
    free = free_parameters(None)
    plain = adjust(seen, rig(), places, free=free)
    adjusted, _ = with_fields(seen, plain, free=free)
    oracle = Oracle(seen, plain.rig, plain.poses)
    values = oracle.fit()
    errors = []
    for place in PLACES_MM:
        points = cap(place, RADIUS_MM, 20.0, 12)
        found_by = (
            measured(adjusted.rig, points, straight, projector),
            oracle.measured(values, points, projector),
            measured(plain.rig, points, straight, projector),
        )
        errors.append([fitted(one, RADIUS_MM)[1] - RADIUS_MM for one in found_by])
    ours, theirs, without = np.array(errors).T
    size = np.sqrt(np.mean(without**2))
    assert np.sqrt(np.mean(ours**2)) < 0.25 * size
    assert np.sqrt(np.mean(theirs**2)) < 0.25 * size
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.25 * size
