"""A part whose model is mirrored or in another unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.surface.closest import MeshDistance, sampled

SIGMA_MM = 0.02


def wedge(hand=1.0, scale=1.0) -> fw.TriangleMesh:
    """A tetrahedron with edges of different lengths: it has a hand."""
    corners = np.array([[0, 0, 0], [70, 0, 0], [15, 45, 0], [10, 8, 30]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.uint32)
    turned = faces if hand > 0 else faces[:, ::-1]
    return fw.TriangleMesh(scale * corners * (1, 1, hand), turned)


def part(seed) -> fw.surface.Points:
    rng = np.random.default_rng(seed)
    points, normals = sampled(MeshDistance(wedge()), 3000, rng)
    points = points + rng.normal(0, SIGMA_MM, (3000, 1)) * normals
    return fw.surface.Points(
        points + np.array([5, -3, 400]), np.full(3000, SIGMA_MM), normals=normals
    )


def named(model, seed):
    try:
        findings = fw.deviation(part(seed), model).findings
    except fw.InputError as problem:
        findings = problem.findings
    return [one for one in findings if one.severity == "error" and one.kind == "model"]


@pytest.mark.parametrize("seed", [71, 72])
def test_a_mirrored_model_is_named(seed):
    (found,) = named(wedge(hand=-1.0), seed)
    assert found.causes == ("the model is mirrored",)


@pytest.mark.parametrize(
    ("scale", "unit"),
    [
        (1 / 25.4, "the inch"),
        (0.1, "the centimetre"),
        (0.001, "the metre"),
        (25.4, "mm, read as inches"),
    ],
)
def test_a_model_in_another_unit_is_named(scale, unit):
    (found,) = named(wedge(scale=scale), 73)
    assert found.causes == (f"the unit of the model is {unit}",)


def test_the_right_model_is_not_doubted():
    assert named(wedge(), 74) == []
    # A part that is 2 % larger deviates by far more than σ; its model is the right one.
    assert named(wedge(scale=1.02), 75) == []
    # A part that was bent.
    corners = np.array(wedge().vertices_mm)
    corners[1, 2] += 2.0
    bent = replace(wedge(), vertices_mm=corners)
    assert named(bent, 76) == []
