"""Public names with spoiled arguments: a result, or one sentence that says what was expected."""

from __future__ import annotations

import inspect
import os
import random
import time
import warnings

import numpy as np
import pytest

import fringeworks as fw
from tests import hostile_calls as hostile
from tests.public import public, public_names

CALLS = int(os.environ.get("FRINGEWORKS_CALLS", "3"))
"""Calls of every quick case, and three of every slow one; ``make fuzz`` makes more."""
SECONDS = 20.0
"""Longest time of a call with small arguments; a usual one takes milliseconds."""
ELSEWHERE = {
    "test_hostile_files": ("read_", "read", "find_scans", "file_limits", "FrameSequence"),
    "test_sample_data": ("ball", "board", "views", "parts"),
    "test_progress": ("progress",),
    "test_kills and test_read_write": ("write_", "write", "save_figure"),
    "devices, in their own tests": (
        "open_", "list_devices", "ListedDevice", "virtual_bench", "virtual_rig", "WindowProjector", "MemoryProjector",
        "WebcamCamera", "GenicamCamera", "GentlCamera", "FolderCamera", "Camera", "CameraLimits", "Projector", "TriggeredCamera", "Clock",
        "VideoMode", "Grab", "LineCamera", "ColourCamera", "ColourProjector", "SequenceProjector", "SequenceSettings", "Dlpc900", "Dlpc350", "DlpStatus", "TriggerBox", "GrblTable",
        "camera_kind", "projector_kind", "scanner_kind", "measure_delay", "Delay", "take",
        "take_frames", "capture", "capture_hdr", "capture_together", "CameraGroup", "PtpCamera", "live", "LiveCloud", "TakenPose", "calibrate_live", "PoseTaker",
        "take_poses", "auto_exposure", "exposure_series", "Setup", "SetupStopped", "SetupTests", "StoredSetup", "set_up",
        "setup_sheet",
    ),
    "minutes, in their own tests": (
        "calibrate", "observe", "adjust_rig", "check_rig", "diagnose", "verdict", "judge_poses", "measure_response",
        "measure_sequence", "merge", "compare", "compare_captures", "compare_everywhere", "best_methods", "best_map",
        "run_batch", "run_sequence", "run_studio", "run_service", "board_sheet", "scan_turntable", "closed_mesh", "stand_mesh", "deviation",
        "benchmark_scene", "benchmark_scenes", "score", "score_depths", "find_spots", "remove_blur", "camera_pair", "calibrate_projector", "for_frames", "selftest", "promise_table", "apply_response",
    ),
    "simulation, in its own tests": (
        "board_body", "board_poses", "bust", "cropped_field", "fringe_plan", "height_field", "look", "pair_displacement",
        "photograph", "photograph_moving", "photograph_pair", "standard_cameras", "standard_rig", "truth_distance",
        "widened_frame",
    ),
    "test_nelson": ("append_check",),
    "test_photograph_colours": ("colour_by_photograph",),
    "test_scan_until": ("scan_until", "next_step", "capture_series"),
    "test_rig_watch": ("watch_rig", "epipolar_evidence", "judge_scans", "append_watch_log"),
    "test_certificate": ("certify", "plan_positions", "check_positions"),
    "test_foresight": ("foresee", "plan_views", "smooth_faces", "turned_poses"),
    "registries": ("method", "methods", "load_plugin", "Method"),
    "errors": (
        "InputError", "FileProblem", "FolderInUse", "BoardNotFound", "DeviceProblem", "FramesContradictPlan",
        "MissingPackage", "RigMismatch", "UnknownMethod",
    ),
}  # fmt: skip
"""Public functions that are tried elsewhere, by their names or their beginnings."""


@pytest.fixture(scope="module")
def calls():
    return hostile.calls()


def test_every_public_function_is_tried_somewhere(calls):
    here = {call.name for call in calls}
    named = [name for names in ELSEWHERE.values() for name in names]
    functions = {n.rpartition(".")[2] for n in public_names() if inspect.isfunction(public(n))}
    prefixes = tuple(name for name in named if name.endswith("_"))
    missing = {n for n in functions - here - set(named) if not n.startswith(prefixes)}
    assert not missing
    assert not here & set(named)


def test_good_arguments_are_accepted(calls):
    for call in calls:
        assert hostile.fault_of(call, call.arguments) is None, call.name


def test_spoiled_arguments_give_a_result_or_an_input_error(calls):
    tried = refused = 0
    for call in calls:
        for number in range(max(3, CALLS // 10) if call.slow else CALLS):
            rng = random.Random(f"{call.name} {number}")
            arguments = hostile.spoiled(call, rng)
            tried += 1
            if arguments is None:
                refused += 1
                continue
            started = time.perf_counter()
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                fault = hostile.fault_of(call, arguments)
            assert fault is None, f"{call.name}, {number}: {fault}"
            assert time.perf_counter() - started < SECONDS, f"{call.name}, {number}"
    assert tried > 4 * CALLS
    assert refused > 0


def masked(value, place):
    """A value whose array at a place of its lists and mappings masks every seventh number."""
    if not place:
        mask = np.zeros(value.shape, bool)
        mask.reshape(-1)[::7] = True
        return np.ma.array(value, mask=mask)
    if isinstance(value, dict):
        return {**value, place[0]: masked(value[place[0]], place[1:])}
    parts = list(value)
    parts[place[0]] = masked(parts[place[0]], place[1:])
    return type(value)(parts)


def arrays_at(value, place=()):
    """Places of all arrays of more than three numbers in lists and mappings."""
    if isinstance(value, np.ndarray):
        if value.ndim and value.size > 3 and value.dtype.kind in "fiucb":
            yield place
    elif type(value) in (list, tuple, dict):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from arrays_at(one, (*place, key))


def test_masks_of_numpy_count_or_are_refused_everywhere(calls):
    """Each array of each public function, one after the other."""
    tried = 0
    for call in calls:
        for place in arrays_at(call.arguments):
            tried += 1
            try:
                found = call.function(**masked(call.arguments, place))
            except fw.InputError:
                continue
            # What takes a mask leaves out what it masks.
            assert call.name in ("unwrap",), f"{call.name}, {place}: the mask was dropped"
            assert np.isnan(found.phase.reshape(-1)[::7]).all()
    assert tried > 100


@pytest.mark.parametrize(
    "value", [10**30, float("nan"), float("inf"), -float("inf"), 1e308, "a", None, 1j]
)
def test_types_refuse_numbers_that_describe_nothing(value):
    for make in (
        lambda: fw.signal.CameraNoise(value),
        lambda: fw.pair.ReferencePlaneGeometry(value, 200.0),
        lambda: fw.rig.Pinhole(64, 48, (value, 90.0), (32.0, 24.0)),
        lambda: fw.devices.CameraSettings(exposure_ms=value if value is not None else "a"),
        lambda: fw.devices.Region(0, 0, value, 8),
        lambda: fw.PatternPlan(
            value, 48, (fw.patterns.PhaseSteps("x", 16.0, fw.patterns.equal_steps(3)),)
        ),
        lambda: fw.patterns.GrayCode("x", 16.0, value),
    ):
        with pytest.raises(fw.InputError, match="expected"):
            make()


def test_maps_of_one_result_have_one_shape():
    cloud = hostile.random_cloud(0)
    good = {
        "xyz_mm": cloud.xyz_mm,
        "sigma_mm": cloud.sigma_mm,
        "noise_mm": cloud.noise_mm,
        "reason": cloud.reason,
    }
    for name, bad in (
        ("xyz_mm", cloud.xyz_mm[..., :2]),
        ("sigma_mm", cloud.sigma_mm[1:]),
        ("noise_mm", cloud.noise_mm.astype(complex)),
        ("reason", cloud.reason + 200),
        ("reason", cloud.reason.astype(float)),
    ):
        with pytest.raises(fw.InputError, match=rf"^{name}: expected"):
            fw.PointCloud(**good | {name: bad})


def test_few_frequencies_of_wavelets():
    """Fewer than nine used to panic in the kernel."""
    row = 3.0 * np.cos(2 * np.pi * np.arange(200) / 12.5)[None]
    for count in range(3, 12):
        phasor, _ = fw.pair.wavelet_ridge(
            row, frequencies=fw.pair.wavelet_frequencies(1 / 12.5, count, 1.5)
        )
        assert abs(np.angle(phasor[0, 100])) < 0.02
