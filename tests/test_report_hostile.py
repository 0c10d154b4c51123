"""Reports of files that no command wrote like that."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

import fringeworks as fw


def pages_of(tmp_path, content, **options):
    """The page and the size of the PDF of a JSON file with this content."""
    path = tmp_path / "figures.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    out = tmp_path / "r.html"
    fw.write_report(out, path, pdf=tmp_path / "r.pdf", **options)
    return out.read_text()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"notes": 5}, "5"),
        ({"notes": [1, None, {"a": 2}]}, "Note"),
        ({"findings": 3}, "figures.json"),
        ({"findings": [{"kind": None, "causes": 5}]}, "Likely cause: 5"),
        ({"findings": [{"kind": "dust"}], "notes": ["clean the lens"]}, "clean the lens"),
        ({"rows": [{}]}, "figures.json"),
    ],
)
def test_figures_of_other_kinds_than_expected(tmp_path, content, said):
    assert said.lower() in pages_of(tmp_path, content).lower()


def test_half_a_surrogate_pair_in_a_file_and_in_a_name(tmp_path):
    with pytest.raises(fw.FileProblem, match="surrogates not allowed"):
        pages_of(tmp_path, '{"a": "\\ud800"}')
    name = os.fsdecode(b"part\xff.json")
    page = tmp_path / "r.html"
    fw.write_report(page, {name: {"a": 1}}, pdf=tmp_path / "r.pdf")
    assert "<h1>part?.json</h1>" in page.read_text()


def test_long_values_are_cut_and_counted(tmp_path):
    content = {"l": list(range(300_000)), "t": "x" * 300_000}
    content |= {f"k{k}": k for k in range(3000)}
    page = pages_of(tmp_path, content)
    assert "… (300,000 values)" in page
    assert "… (300,000 letters)" in page
    assert "2,502 more values" in page
    assert len(page) < 100_000


def test_numbers_of_any_size_are_judged(tmp_path):
    page = pages_of(tmp_path, '{"a": ' + "9" * 400 + "}", tolerances=["a<=5"])
    assert "FAIL" in page


def test_a_refused_tolerance_names_the_result(tmp_path):
    results = {"part": {"points": 5}, "rig": {"baseline_mm": 3.0}}
    with pytest.raises(fw.InputError, match="rig: tolerance: expected one of baseline_mm"):
        fw.write_report(tmp_path / "r.html", results, tolerances=["points>=1"])


def cloud(**changes):
    """Twenty points that lie in the order of pixels."""
    v, u = np.mgrid[:4, :5].astype(float)
    arrays = {
        "xyz_mm": np.stack((u, v, 500.0 + u), axis=-1),
        "sigma_mm": np.full((4, 5), 0.01),
        "noise_mm": np.full((4, 5), 0.01),
        "reason": np.zeros((4, 5), np.uint8),
    }
    return arrays | changes


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"reason": np.full((4, 5), 77, np.uint8)}, "reason of 0 to 12, got 77"),
        ({"sigma_mm": np.full((4, 5), -0.5)}, "sigma_mm of 0 or more, got -0.5"),
    ],
)
def test_values_that_there_are_not(tmp_path, changes, said):
    path = tmp_path / "part.npz"
    np.savez(path, **cloud(**changes))
    with pytest.raises(fw.FileProblem, match=said):
        fw.write_report(tmp_path / "r.html", path)


def test_points_that_lie_behind_each_other_have_no_profile(tmp_path):
    arrays = cloud()
    u = arrays["xyz_mm"][..., 0]
    arrays["xyz_mm"] = np.stack((0.0 * u, 0.0 * u, 500.0 + u), axis=-1)
    fw.write_report(tmp_path / "r.html", fw.PointCloud(**arrays))
    assert "There is no profile along the middle row" in (tmp_path / "r.html").read_text()


def test_a_description_of_another_kind_is_no_result(tmp_path):
    path = tmp_path / "capture.toml"
    path.write_text('kind = "password"\n')
    with pytest.raises(
        fw.FileProblem, match="expected a file of the kind plan, rig, .*got 'password'"
    ):
        fw.write_report(tmp_path / "r.html", path)


def test_parameters_have_the_digits_of_their_standard_deviation():
    from fringeworks.report.kinds.rig import parameter_row

    def value(number, sigma):
        return parameter_row("fx", number, sigma)["value"]

    assert value(1230.04567, 0.056783) == "1230.046"
    assert value(-0.00031962, 1.5434e-05) == "−0.000320"
    assert value(1230.04567, None) == value(1230.04567, 0.0) == "1230.05"
    assert value(1230.04567, 12.0) == "1230"
