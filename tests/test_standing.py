"""Meshes stand on their plate: z up, z = 0 at the lowest point, whatever they were measured in."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import rotation

HEIGHT_MM = 12.0


def cone(turn=None, foot_seen=False):
    """A cone of 12 mm on a foot of 10 mm radius, which no view has seen; turned and moved."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    rim = np.column_stack((10.0 * np.cos(angle), 10.0 * np.sin(angle), 0.0 * angle))
    vertices = np.concatenate((rim, 0.98 * rim, [[0.0, 0.0, HEIGHT_MM], [0.0, 0.0, 0.0]]))
    k = np.arange(60)
    after = (k + 1) % 60
    sides = np.column_stack((k, after, np.full(60, 120)))
    ring = np.concatenate(
        (np.column_stack((k, k + 60, after)), np.column_stack((after, k + 60, after + 60)))
    )
    foot = np.column_stack((after + 60, k + 60, np.full(60, 121)))
    filled = np.zeros(122, bool)
    filled[60:120] = filled[121] = not foot_seen
    turn = np.eye(3) if turn is None else turn
    return fw.TriangleMesh(
        vertices @ turn.T + [3.0, -70.0, 400.0],
        np.concatenate((sides, ring, foot)).astype(np.uint32),
        filled=filled,
    )


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (180.0, 0.0, 0.0), (100.0, -35.0, 60.0)])
def test_a_part_stands_on_the_side_that_no_view_saw(angles):
    stood = fw.views.stand_mesh(cone(rotation(np.radians(angles))))
    z = stood.vertices_mm[:, 2]
    assert z.min() == pytest.approx(0.0, abs=1e-4)
    assert z.max() == pytest.approx(HEIGHT_MM, abs=1e-3)
    assert int(np.argmax(z)) == 120
    assert np.abs(stood.vertices_mm[120, :2]).max() < 1e-3


def test_a_board_is_below_and_axes_have_names():
    upside_down = cone(np.diag([1.0, -1.0, -1.0]))
    for up in ("board", "-z"):
        stood = fw.views.stand_mesh(upside_down, up)
        assert stood.vertices_mm[120, 2] == pytest.approx(HEIGHT_MM, abs=1e-3)
    sideways = fw.views.stand_mesh(cone(), "x")
    assert np.ptp(sideways.vertices_mm[:, 2]) == pytest.approx(20.0, abs=1e-3)
    kept = fw.views.stand_mesh(cone(), "z", origin="part")
    np.testing.assert_allclose(kept.vertices_mm, cone().vertices_mm, atol=1e-4)


def test_turns_keep_shapes_and_their_sides():
    one, stood = cone(rotation(np.array([0.4, 1.0, -2.0]))), None
    stood = fw.views.stand_mesh(one, "y")

    def volume(mesh):
        a, b, c = (np.asarray(mesh.vertices_mm, float)[mesh.faces[:, k]] for k in range(3))
        middle = mesh.vertices_mm.mean(axis=0)
        return float(np.sum(np.cross(a - middle, b - middle) * (c - middle)) / 6.0)

    assert volume(stood) == pytest.approx(volume(one), rel=1e-3)


def test_words_and_meshes_that_are_refused():
    with pytest.raises(fw.InputError, match="expected board, unseen or one of x, -x"):
        fw.views.stand_mesh(cone(), "w")
    with pytest.raises(fw.InputError, match="expected plate or part, got 'floor'"):
        fw.views.stand_mesh(cone(), origin="floor")
    with pytest.raises(fw.InputError, match="a side that no view has seen"):
        fw.views.stand_mesh(cone(foot_seen=True))
