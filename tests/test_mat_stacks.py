"""Stacks that MATLAB has saved, and coordinates that it reads."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import fringeworks as fw

PLAN = fw.PatternPlan(
    96, 60, tuple(fw.patterns.PhaseSteps("x", p, fw.patterns.equal_steps(4)) for p in (96.0, 12.0))
)


def frames():
    """The pictures, in place of photographs."""
    return np.stack([np.asarray(p) for p in fw.encode(PLAN)])


@pytest.mark.parametrize("compressed", [True, False])
def test_a_stack_of_matlab_is_read_as_it_was_saved(tmp_path, compressed):
    shown = frames()
    path = tmp_path / "stack.mat"
    content = {"note": "of 3 May", "frames": np.moveaxis(shown, 0, -1)}
    scipy.io.savemat(path, content, do_compression=compressed)
    read = fw.files.read_stack(path, PLAN)
    assert np.array_equal(np.stack(read.frames), shown)
    assert read.frames[0].dtype == shown.dtype
    assert np.array_equal(
        fw.decode(path, PLAN).x.coordinate_px, fw.decode(shown, PLAN).x.coordinate_px
    )
    fw.files.write_plan(tmp_path / "plan.toml", PLAN)
    assert fw.decode(path).x.coordinate_px.shape == shown.shape[1:]


def test_what_is_no_stack_of_matlab_is_refused(tmp_path):
    path = tmp_path / "stack.mat"
    scipy.io.savemat(path, {"frames": frames()[0]})
    with pytest.raises(fw.FileProblem, match=r"expected frames as a real \(h, w, n\) array"):
        fw.files.read_stack(path, PLAN)
    scipy.io.savemat(path, {"images": frames()})
    with pytest.raises(fw.FileProblem, match="expected a variable frames, got images"):
        fw.files.read_stack(path, PLAN)
    scipy.io.savemat(path, {"frames": np.moveaxis(frames(), 0, -1)})
    whole = path.read_bytes()
    for length in range(130, len(whole), 997):
        path.write_bytes(whole[:length])
        with pytest.raises(fw.FileProblem):
            fw.files.read_stack(path, PLAN)


def test_matlab_reads_decoded_coordinates(tmp_path):
    decoded = fw.decode(frames(), PLAN)
    fw.write(tmp_path / "decoded.mat", decoded)
    read = scipy.io.loadmat(tmp_path / "decoded.mat")
    for name in ("coordinate_px", "sigma_px", "modulation", "background", "reason"):
        assert np.array_equal(read[f"x_{name}"], getattr(decoded.x, name), equal_nan=True)
    names = [str(row[0][0]) for row in read["reasons"]]
    assert names[0] == "ok"
    assert len(names) == len(fw.Reason)
