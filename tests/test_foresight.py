"""What a scan will see, predicted from a model, against scans by the second simulator.

The scans are photographs of ``tests/ray_caster.py``, whose rays, lenses and shadows are its own, and
are measured by ``fw.measure``; the prediction knows the scene only as a mesh.
"""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.foresight import CAUSES
from fringeworks.rig.pinhole import rotation
from fringeworks.simulate.standard import fringe_plan, standard_rig
from tests import commands
from tests.ray_caster import Ball, Photographs, Sheet

SCENES = range(480, 490)
ALBEDO = 0.6


@cache
def rig(scale=0.3):
    return standard_rig(scale=scale)


def pose_of(turns_rad, place_mm):
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.array(turns_rad, float))
    pose[:3, 3] = place_mm
    return pose


def ball_mesh(centre, radius, n=120):
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij"
    )
    ring = np.sin(polar)
    out = np.stack((ring * np.cos(azimuth), ring * np.sin(azimuth), np.cos(polar)), axis=-1)
    k = np.arange(2 * n * n).reshape(n, 2 * n)
    a, b, c, d = (k[i : n - 1 + i, j : 2 * n - 1 + j].ravel() for i in (0, 1) for j in (0, 1))
    faces = np.concatenate((np.stack((a, c, b), 1), np.stack((b, c, d), 1)))
    return out.reshape(-1, 3) * radius + np.array(centre), faces


def scene(seed):
    """Bodies of the second simulator, and the same as a mesh with two faces."""
    rng = np.random.default_rng(seed)
    centre = tuple(rng.uniform((-40, -30, 485), (40, 30, 515)))
    radius = rng.uniform(12, 35)
    wall = pose_of((*rng.uniform(-0.4, 0.4, 2), 0.0), (0.0, 0.0, 545.0 + radius))
    vertices, faces = ball_mesh(centre, radius)
    corners = np.array([[-2e3, -2e3, 0], [2e3, -2e3, 0], [2e3, 2e3, 0], [-2e3, 2e3, 0]])
    corners = corners @ wall[:3, :3].T + wall[:3, 3]
    square = np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices)
    mesh = fw.TriangleMesh(
        np.concatenate((vertices, corners)), np.concatenate((faces, square)).astype(np.uint32)
    )
    groups = {"ball": np.arange(len(faces)), "wall": len(faces) + np.arange(2)}
    bodies = [Ball(centre, radius, ALBEDO), Sheet(wall, ALBEDO)]
    return bodies, mesh, groups, rng.uniform(0.6, 2.5)


def compared(seed):
    """Share of σ within 0.8 to 1.25 of what is found, and of equal visibility."""
    bodies, mesh, groups, noise = scene(seed)
    plan = fringe_plan(rig())
    stack = Photographs(rig(), bodies).stack(plan, blur_px=0.5, noise=noise, seed=seed)
    found = fw.measure(stack, rig()).points
    optics = fw.simulate.Optics(exposure=190 / 255, ambient=3 / 190, noise=noise, seed=seed + 1000)
    seen = fw.evaluate.foresee(
        mesh, rig(), plan, np.eye(4), albedo=ALBEDO, optics=optics, faces=groups
    )
    here, there = np.isfinite(seen.points.sigma_mm), np.isfinite(found.sigma_mm)
    both = here & there
    ratio = seen.points.sigma_mm[both] / found.sigma_mm[both]
    return np.mean((ratio > 0.8) & (ratio < 1.25)), np.mean(here == there)


@pytest.mark.statistical
def test_predicted_sigma_and_visibility_are_those_of_ten_scans():
    """Issue: ratio 0.8 to 1.25 on 90 % of the pixels that both see, visibility right on 97 %."""
    found = np.array([compared(seed) for seed in SCENES])
    print(found.round(4).tolist())
    assert (found[:, 0] >= 0.90).all(), found[:, 0]
    assert (found[:, 1] >= 0.97).all(), found[:, 1]


def box(size=(50.0, 40.0, 30.0)):
    """A box around the origin, every triangle with corners of its own as in STL."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.5
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    vertices = (corners * size)[np.array(faces).ravel()]
    return fw.TriangleMesh(vertices, np.arange(36, dtype=np.uint32).reshape(12, 3))


def test_a_box_has_six_faces_and_a_ball_one():
    faces = fw.evaluate.smooth_faces(box())
    assert [len(found) for found in faces.values()] == [2] * 6
    assert len(faces) == 6
    vertices, triangles = ball_mesh((0, 0, 0), 20.0, 40)
    area = np.linalg.norm(
        np.cross(*(vertices[triangles[:, k]] - vertices[triangles[:, 0]] for k in (1, 2))), axis=1
    )
    ball = fw.TriangleMesh(vertices, triangles[area > 1e-9].astype(np.uint32))
    assert len(fw.evaluate.smooth_faces(ball)) == 1


def test_a_turntable_reaches_the_sides_of_a_box_and_names_what_it_cannot_see():
    small = rig(0.15)
    # The axis leans towards the camera, so that the top and a side or two are seen from each pose.
    lean = pose_of((-0.9, 0.0, 0.0), (0.0, 0.0, 510.0))
    poses = fw.evaluate.turned_poses(lean, lean[:3, 3], lean[:3, 2], 6)
    groups = fw.evaluate.smooth_faces(box())
    found = fw.evaluate.plan_views(box(), small, fringe_plan(small), poses, tolerance_mm=5.0)
    assert found.chosen
    assert len(set(found.chosen)) == len(found.chosen) == len(found.views)
    normal = {
        name: int(
            np.argmax(np.ptp(box().vertices_mm[box().faces[t]].reshape(-1, 3), axis=0) < 1e-9)
        )
        for name, t in groups.items()
    }
    # One of the two faces across the axis is turned away from the camera in all poses.
    (lost,) = found.unreached
    assert normal[lost.name] == 2
    assert lost.share < 0.05
    assert lost.cause == "hidden from the camera"
    assert all(face.share > 0.8 for face in found.faces if face is not lost)


def test_causes_are_told_apart():
    small = rig(0.15)
    plan = fringe_plan(small)
    plate = box((60.0, 60.0, 1.0))

    def cause(pose, name="face 1", **options):
        found = fw.evaluate.plan_views(plate, small, plan, [pose], tolerance_mm=9.0, **options)
        return {face.name: face.cause for face in found.faces}[name]

    ahead = pose_of((0, 0, 0), (0.0, 0.0, 510.0))
    face = [cause(ahead), cause(ahead, "face 2")]
    assert sorted(face) == ["", "hidden from the camera"]
    near = "face 1" if face[0] == "" else "face 2"
    bright = fw.simulate.Optics(exposure=9.0)
    assert cause(ahead, near, optics=bright) == "saturated"
    dark = fw.simulate.Optics(noise=20.0)
    assert cause(ahead, near, albedo=0.02, optics=dark) == CAUSES[7]
    few = {"tolerance_mm": 1e-3}
    found = fw.evaluate.plan_views(plate, small, plan, [ahead], **few)
    assert {f.name: f.cause for f in found.faces}[near] == "σ above a tenth of the tolerance"
    behind = pose_of((0, 0, 0), (0.0, 0.0, -510.0))
    assert cause(behind, near) == "outside the camera's frame"
    aside = pose_of((0, 0, 0), (150.0, 0.0, 510.0))
    assert cause(aside, near) == "outside the camera's frame"


def test_wrong_calls_are_refused():
    small, plan = rig(0.15), fringe_plan(rig(0.15))
    ahead = pose_of((0, 0, 0), (0.0, 0.0, 510.0))
    for options in ({"albedo": 0.0}, {"albedo": np.nan}, {"faces": {}}, {"faces": {"a": [99]}}):
        with pytest.raises(fw.InputError):
            fw.evaluate.foresee(box(), small, plan, ahead, **options)
    for wrong in (
        np.eye(3),
        2 * np.eye(4),
        np.full((4, 4), np.nan),
    ):
        with pytest.raises(fw.InputError, match="pose"):
            fw.evaluate.foresee(box(), small, plan, wrong)
    for tolerance in (0.0, np.nan, "a", {"face 9": 1.0}):
        with pytest.raises(fw.InputError, match="tolerance"):
            fw.evaluate.plan_views(box(), small, plan, [ahead], tolerance_mm=tolerance)
    with pytest.raises(fw.InputError, match="poses"):
        fw.evaluate.plan_views(box(), small, plan, [], tolerance_mm=1.0)
    for axis, count in (((0, 0, 0), 3), ((0, 0, "a"), 3), ((0, 1), 3), ((0, 1, 0), 0)):
        with pytest.raises(fw.InputError):
            fw.evaluate.turned_poses(ahead, (0, 0, 500), axis, count)


@pytest.mark.system
def test_the_command_names_faces_out_of_reach(tmp_path):
    small = rig(0.15)
    fw.files.write_rig(tmp_path / "rig.toml", small)
    fw.files.write_plan(tmp_path / "plan.toml", fringe_plan(small))
    fw.files.write_mesh(tmp_path / "box.stl", box())
    out = tmp_path / "seen.json"
    given = (
        "foresee",
        tmp_path / "box.stl",
        tmp_path / "plan.toml",
        "--rig",
        tmp_path / "rig.toml",
    )
    done = commands.run(*given, "--pose", "0:0:510:0:0:0", "--json", out)
    assert "poses to scan from: 1 of 1" in done.stdout
    done = commands.run(
        *given, "--pose", "0:0:510:0:0:0", "--tolerance-mm", "5", "--json", out, code=3
    )
    assert "out of reach" in done.stdout
    told = json.loads(out.read_text(encoding="utf-8"))
    assert told["poses"] == [1]
    assert sum(face["reached"] for face in told["faces"]) == 1
    commands.run(*given, "--pose", "0:0:510", code=2)
    commands.run(*given, "--pose", "0:0:510:0:0:0", "--spin", "0:0:510:0:1:0:1.5", code=2)
