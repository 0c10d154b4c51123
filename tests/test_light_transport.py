"""Optics and light transport of the virtual rig against theory: transfer, form factors, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan
from fringeworks.patterns import PhaseSteps, Uniform, equal_steps
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bayer import (
    LUMINANCE_SHARES,
    OF_GREEN,
    OF_RED_AND_BLUE,
    Bayer,
    demosaiced,
    mosaic,
)
from fringeworks.simulate.bodies import Body, Box, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.interreflection import interreflection
from fringeworks.simulate.lens import ThinLens, blurred_by_map
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.projected_light import blurred_profile
from fringeworks.simulate.response_curve import DLP_BRIGHT, LCD, SCurve, TabulatedResponse
from fringeworks.simulate.rig_pair import pair_displacement, photograph_pair
from fringeworks.simulate.standard import cropped_field, standard_rig
from fringeworks.simulate.subsurface import subsurface
from fringeworks.simulate.virtual_rig import look
from tests.rigs import ahead, head_on

pytestmark = pytest.mark.statistical

RIG = standard_rig(scale=0.25)
QUIET = Optics(defocus_px=0.5, blur_px=0, ambient=0, black=0, noise=0, bits=16)


def amplitude(values, phase):
    """Amplitude of the wave of a known phase in values, which have an offset and a slope as well."""
    x = np.linspace(-1, 1, phase.size)
    design = np.stack([np.cos(phase), np.sin(phase), np.ones(phase.size), x], axis=-1)
    c, s, *_ = np.linalg.lstsq(design, values, rcond=None)[0]
    return float(np.hypot(c, s))


# Defocus by depth.


def test_blur_of_a_lens_is_that_of_the_disc():
    lens = ThinLens(focus_mm=500.0, aperture_mm=20.0)
    # The cone of 20 mm at the lens is 2 mm wide 50 mm before the focus, seen from 450 mm.
    disc = 3000.0 * 2.0 / 450.0
    assert lens.blur_px(np.array(450.0), 3000.0) == pytest.approx(0.25 * disc)
    assert lens.blur_px(np.array(500.0), 3000.0) == 0.0
    with pytest.raises(InputError, match="focus_mm: expected > 0"):
        ThinLens(0.0, 1.0)


@pytest.mark.parametrize("period", [6.0, 12.0, 40.0])
def test_a_varying_blur_transfers_as_a_gaussian_does(period):
    x = np.arange(400.0)
    sigma = np.linspace(0.0, 5.0, 60)[:, None] * np.ones(400)
    wave = np.exp(2j * np.pi * x / period) * np.ones((60, 1))
    seen = blurred_by_map(wave.real, sigma) + 1j * blurred_by_map(wave.imag, sigma)
    transfer = np.abs(seen[:, 200])
    expected = np.exp(-2 * (np.pi * sigma[:, 200] / period) ** 2)
    inner = slice(8, -8)  # rows near the ends mix with the border's
    np.testing.assert_allclose(transfer[inner], expected[inner], atol=0.012)
    # A uniform image stays what it is.
    np.testing.assert_allclose(blurred_by_map(np.ones((60, 400)), sigma), 1.0)


def test_fringes_on_a_tilted_plane_fade_with_the_distance_from_the_focus():
    period = 12.0
    plan = PatternPlan(64, 64, (PhaseSteps("x", period, equal_steps(4)),), bits=16)
    lens = ThinLens(focus_mm=470.0, aperture_mm=25.0)
    place = pose(rotation(np.array([1.2, 0.0, 0.0])), np.array([0.0, 0, 500]))
    view = look(head_on(), [Body(Plane(), place, 0.5)])
    optics = replace(QUIET, projector_lens=lens)
    frames = np.stack(list(photograph(view, plan, optics))).astype(float)[:, 4:-4, 16:48]
    wave = frames[0] - frames[2] + 1j * (frames[1] - frames[3])
    contrast = np.abs(wave).mean(axis=1) / frames.mean(axis=(0, 2)) / 2
    depth = view.projector_depth_mm[4:-4, 32]
    sigma = np.hypot(0.5, lens.blur_px(depth, 1000.0))
    assert np.ptp(sigma) > 0.5
    k = np.pi / period
    np.testing.assert_allclose(
        contrast, np.sin(k) / k * np.exp(-2 * (k * sigma) ** 2), rtol=0, atol=0.012
    )


def test_the_camera_s_lens_blurs_what_is_near():
    lens = ThinLens(focus_mm=500.0, aperture_mm=30.0)

    def edge(z):
        place = pose(np.eye(3), np.array([0.0, 0, z]))
        return look(head_on(), [Body(Plane(), place, lambda x, _: 0.1 + 0.8 * (x > 0))])

    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)), Uniform("white")), bits=16)
    widths = []
    for z in (500.0, 450.0):
        frame = list(photograph(edge(z), plan, replace(QUIET, camera_lens=lens)))[-1]
        slope = np.diff(frame[32, 16:48].astype(float))
        slope -= slope[[0, -1]].mean()  # the shading of the plane
        x = np.arange(slope.size)
        mean = np.sum(x * slope) / np.sum(slope)
        widths.append(np.sum((x - mean) ** 2 * slope) / np.sum(slope))
    # Variances add: that of the lens, to that of a sharp edge.
    expected = lens.blur_px(np.array(450.0), 1000.0) ** 2
    assert widths[1] - widths[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("fill", "defocus"), [(0.8, 0.0), (0.8, 0.2), (0.5, 0.3)])
def test_the_pixel_grid_has_the_contrast_of_its_squares(fill, defocus):
    profile = blurred_profile(np.ones(40), defocus, fill)[16 * 10 : 16 * 30]
    assert profile.mean() == pytest.approx(1.0, abs=0.05 if defocus == 0 else 1e-6)
    wave = np.exp(2j * np.pi * np.arange(profile.size) / 16)
    contrast = 2 * np.abs(np.mean(profile * wave))
    expected = 2 * np.sinc(fill) * np.exp(-2 * (np.pi * defocus) ** 2)
    # Without blur the edges of squares fall between the samples.
    assert contrast == pytest.approx(expected, abs=0.1 if defocus == 0 else 1e-6)


def test_a_pixel_grid_is_dark_along_both_axes():
    coarse = standard_rig(scale=0.04)
    seen_by = replace(RIG, projector=coarse.projector)
    plan = PatternPlan(77, 48, (PhaseSteps("x", 12.0, equal_steps(4)), Uniform("white")), bits=16)
    view = look(seen_by, [ahead(Plane())])
    optics = replace(QUIET, fill=0.7, defocus_px=0.05, exposure=0.4)
    white = list(photograph(view, plan, optics))[-1].astype(float)
    plain = list(photograph(view, plan, replace(optics, fill=1.0)))[-1].astype(float)
    off = np.abs(view.projector_px - np.rint(view.projector_px))
    inner = view.lit & (view.projector_px > 3).all(-1) & (view.projector_px < [73, 44]).all(-1)
    for k in (0, 1):
        gap = inner & (off[..., k] > 0.48)
        assert (white[gap] / plain[gap]).max() < 0.15
    in_square = inner & (off < 0.15).all(-1)
    np.testing.assert_allclose(white[in_square] / plain[in_square], 1 / 0.7**2, rtol=0.06)
    assert white[inner].mean() == pytest.approx(plain[inner].mean(), rel=0.03)
    with pytest.raises(InputError, match="fill: expected 1 for pictures"):
        next(photograph(view, replace(plan, dither=True, bits=8), optics))


# The response.


def test_curves_are_no_power_and_rise():
    v = np.linspace(0, 1, 201)
    for curve in (LCD, DLP_BRIGHT):
        light = curve(v)
        assert light[0] == 0.0
        assert light[-1] == pytest.approx(1.0)
        assert (np.diff(light) > 0).all()
        # γ = d log I / d log v is not the same everywhere.
        gamma = np.diff(np.log(light[20:])) / np.diff(np.log(v[20:]))
        assert gamma.max() > 2.0 * gamma.min()
    assert np.interp(0.5, LCD(v), v) == pytest.approx(0.54, abs=0.01)


def test_a_response_bends_the_fringes():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 64.0, equal_steps(8)), Uniform("white")), bits=16)
    view = look(head_on(), [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)])
    frames = [f.astype(float) for f in photograph(view, plan, replace(QUIET, response=LCD))]
    x = np.arange(20, 44)
    sent = 0.5 + 0.5 * np.cos(2 * np.pi * x / 64)
    np.testing.assert_allclose(frames[0][30, 20:44] / frames[-1][30, 20:44], LCD(sent), atol=2e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: TabulatedResponse((0.0, 1.0), (0.0, 1.0)), "sent: expected 3 values"),
        (lambda: TabulatedResponse((0, 0.5, 1.0), (0.0, 0.9, 0.8)), "light: expected 3 values"),
        (lambda: TabulatedResponse((0, 0.5, 1.0), (0, 0.1, 0.5, 1)), "expected 3 values, as many"),
        (lambda: SCurve(alpha=1.0, beta=2.0), "alpha >= beta"),
        (lambda: Optics(gamma=2.0, response=LCD), "cannot be combined with gamma"),
        (lambda: Optics(jpeg=50, bits=12), "frames of 8 bit"),
        (lambda: Bayer(filters=(0.0, 1.0, 1.0)), "filters: expected three shares"),
        (lambda: Bayer(output="grey"), "output: expected one of"),
    ],
)
def test_invalid_options_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


# Colour filters.


@pytest.mark.parametrize("output", ["luminance", "green"])
def test_bilinear_demosaicing_keeps_a_ramp(output):
    camera = Bayer(output=output)
    v, u = np.mgrid[:20, :30].astype(float)
    light = 20_000 + 300 * u + 500 * v
    raw = np.rint(light * mosaic(light.shape, camera)).astype(np.uint16)
    seen = demosaiced(raw, camera, 65_535)
    assert seen.dtype == np.uint16
    np.testing.assert_allclose(seen[1:-1, 1:-1], light[1:-1, 1:-1], atol=2.0)


def test_demosaicing_spreads_noise_as_its_weights_say():
    """Luminance is a weighted sum of 9 raw pixels; the weights differ between filters."""
    camera = Bayer(filters=(0.5, 1.0, 0.25))
    rng = np.random.default_rng(0)
    white = 30_000 * mosaic((400, 400), camera)
    raw = np.rint(white + 100.0 * rng.standard_normal(white.shape)).astype(np.uint16)
    seen = demosaiced(raw, camera, 65_535).astype(float)
    scale = np.array(LUMINANCE_SHARES) / camera.filters
    weights = np.zeros((3, 3))
    # Around a red pixel: green beside it, blue at its corners.
    weights[1, 1] = scale[0] * OF_RED_AND_BLUE[1, 1]
    for place in ((0, 1), (1, 0), (1, 2), (2, 1)):
        weights[place] = scale[1] * OF_GREEN[0, 1]
    for place in ((0, 0), (0, 2), (2, 0), (2, 2)):
        weights[place] = scale[2] * OF_RED_AND_BLUE[0, 0]
    assert seen[2:-2:2, 2:-2:2].std() == pytest.approx(
        100.0 * np.sqrt(np.sum(weights**2)), rel=0.02
    )
    assert seen[2:-2, 2:-2].mean() == pytest.approx(30_000, rel=1e-3)


def test_a_colour_camera_s_raw_frame_has_the_pattern_of_its_filters():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)), Uniform("white")), bits=16)
    view = look(head_on(), [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)])
    camera = Bayer(filters=(0.5, 1.0, 0.25), output="raw")
    white = list(photograph(view, plan, replace(QUIET, bayer=camera)))[-1].astype(float)
    assert white[30, 30] / white[30, 31] == pytest.approx(0.5, rel=2e-3)
    assert white[31, 31] / white[31, 30] == pytest.approx(0.25, rel=2e-3)


# One diffuse bounce.


def groove(side=80.0, z=500.0):
    """Two square plates at a right angle that open towards the camera, with a vertical edge."""
    half = 0.5 * side
    bodies = []
    for sign in (-1, 1):
        # From the edge at x = 0, each plate goes to its side and towards the camera.
        turn = rotation(np.array([0.0, sign * np.pi / 4, 0.0]))
        middle = np.array([0.0, 0.0, z]) + turn @ np.array([sign * half, 0.0, 0.0])
        bodies.append(Body(Plane(side, side), pose(turn, middle), 0.6))
    return bodies


def element_to_plate(distance, along, side):
    """Form factor from an element to a perpendicular square plate, ``along`` its edge.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-4: an element before the
    corner of a plate; a plate is two of them side by side.
    """
    total = 0.0
    for width in (along, side - along):
        x, y = side / width, distance / width
        root = np.sqrt(x * x + y * y)
        total += (np.arctan(1 / y) - y / root * np.arctan(1 / root)) / (2 * np.pi)
    return total


def test_light_between_perpendicular_plates_is_that_of_the_form_factor():
    bodies, side = groove(), 80.0
    view = look(RIG, bodies)
    bounce = interreflection(view, bodies, patch_px=8)
    lit = (view.body == 1).astype(float)
    seen = bounce(lit)
    np.testing.assert_allclose(seen[view.body == 1], 1.0)
    for u in (100, 120, 140, 150):
        at = (view.body.shape[0] // 2, u)
        assert view.body[at] == 0
        local = bodies[0].local(view.points_mm[at][None])[0]
        expected = 0.6 * element_to_plate(0.5 * side - local[0], local[1] + 0.5 * side, side)
        assert seen[at] == pytest.approx(expected, rel=0.03), u


def test_a_bounce_conserves_light():
    bodies, side = groove(), 80.0
    view = look(RIG, bodies)
    bounce = interreflection(view, bodies, patch_px=8)
    seen = bounce((view.body == 1).astype(float))
    received = np.sum((seen * view.area_mm2)[view.body == 0])
    assert np.sum(view.area_mm2[view.body == 0]) == pytest.approx(side**2, rel=0.02)
    # Two squares with a common edge at a right angle (Hottel): F = 0.2000.
    assert received == pytest.approx(0.2000 * 0.6 * side**2, rel=0.02)
    # The groove is symmetric, and so is the light, up to a pixel's width of the plates.
    other = bounce((view.body == 0).astype(float))
    back = np.sum((other * view.area_mm2)[view.body == 1])
    assert back == pytest.approx(received, rel=0.03)


def test_what_is_between_surfaces_shades_the_bounce():
    bodies = groove()
    screen = Body(Box((1.0, 100.0, 60.0)), pose(np.eye(3), np.array([0.0, 0.0, 465.0])), 0.0)
    view = look(RIG, [*bodies, screen])
    seen = interreflection(view, [*bodies, screen])((view.body == 1).astype(float))
    far = (view.body == 0) & (view.points_mm[..., 2] < 475.0)
    assert far.sum() > 500
    open_ = interreflection(view, bodies)((view.body == 1).astype(float))
    assert open_[far].min() > 0.02
    assert seen[far].max() < 0.003  # what passes over the screen


def test_a_plane_and_a_ball_throw_no_light_on_themselves():
    for body in (ahead(Plane(120, 100), turn=(0.4, 0.2, 0)), ahead(Sphere(40.0))):
        view = look(RIG, [body])
        direct = np.where(view.body == 0, 1.0, 0.0)
        np.testing.assert_allclose(interreflection(view, [body])(direct), direct, atol=1e-9)


# Light within the material.


@pytest.mark.parametrize("tilt", [0.0, 0.9])
@pytest.mark.parametrize("share", [1.0, 0.6])
def test_subsurface_light_transfers_as_a_gaussian_on_the_surface(tilt, share):
    spread, period = 1.2, 8.0
    body = ahead(Plane(140, 140), turn=(0.0, tilt, 0.0))
    view = look(RIG, [body])
    at = view.body == 0
    place = np.zeros(view.body.shape)
    place[at] = body.local(view.points_mm[at])[:, 0]
    phase = 2 * np.pi * place / period
    direct = np.where(at, 1.0 + np.cos(phase), 0.0)
    seen = subsurface(view, spread_mm=spread, share=share)(direct)
    inner = at & (np.abs(place) < 50)
    inner[:40], inner[-40:] = False, False
    expected = 1 - share + share * np.exp(-2 * (np.pi * spread / period) ** 2)
    assert amplitude(seen[inner], phase[inner]) == pytest.approx(expected, rel=0.02)


def test_subsurface_light_is_conserved_and_stays_in_its_body():
    bodies = [ahead(Sphere(30.0), -10, 0, 470), ahead(Plane(150, 120), z=500)]
    view = look(RIG, bodies)
    rng = np.random.default_rng(0)
    direct = np.where(view.body >= 0, rng.random(view.body.shape), 0.0)
    on_ball = np.where(view.body == 0, direct, 0.0)
    seen = subsurface(view, spread_mm=2.0)(on_ball)
    assert np.sum(seen * view.area_mm2) == pytest.approx(np.sum(on_ball * view.area_mm2), rel=1e-9)
    assert np.abs(seen[view.body != 0]).max() == 0.0
    uniform = (view.body >= 0).astype(float)
    np.testing.assert_allclose(subsurface(view, spread_mm=2.0)(uniform), uniform, atol=1e-9)
    with pytest.raises(InputError, match="share: expected 0 to 1"):
        subsurface(view, spread_mm=1.0, share=1.5)


# The field's edge, and pairs.


def test_a_cropped_field_leaves_the_light_where_it_was():
    wall = [ahead(Plane())]
    whole, part = look(RIG, wall), look(cropped_field(RIG, columns=(200, 320), rows=(0, 250)), wall)
    assert 0 < part.lit.sum() < 0.7 * whole.lit.sum()
    np.testing.assert_allclose(part.projector_px, whole.projector_px - [200, 0], atol=1e-9)
    column, row = np.moveaxis(whole.projector_px, -1, 0)
    expected = (column > 199.5) & (column < 319.5) & (row < 249.5) & whole.lit
    np.testing.assert_array_equal(part.lit, expected)
    with pytest.raises(InputError, match="columns: expected"):
        cropped_field(RIG, columns=(0, 5000))


def test_the_displacement_of_a_pair_brings_its_frames_together():
    reference = look(RIG, [ahead(Plane())])
    object_ = look(RIG, [ahead(Plane(), z=495.0, turn=(0.05, 0.1, 0))])
    frames = photograph_pair(reference, object_, 32.0, replace(QUIET, bits=16))
    u = pair_displacement(reference, object_)
    columns = np.arange(u.shape[1])
    row = u.shape[0] // 2
    s = np.interp(columns - u[row], columns, frames.reference[row].astype(float))
    shade = object_.shading[row] / np.interp(columns - u[row], columns, reference.shading[row])
    inner = np.isfinite(u[row]) & (columns > 60) & (columns < 260)
    off = frames.object[row] - s * shade
    assert np.abs(off[inner]).max() < 0.01 * np.ptp(frames.object[row])
    assert np.nanmax(np.abs(u)) > 2.0
    with pytest.raises(InputError, match="views: expected those of one rig"):
        photograph_pair(reference, look(cropped_field(RIG, (0, 200)), [ahead(Plane())]), 32.0)
