"""Poses of robots as their makers write them: what a file says is used, the rest stays open."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import fringeworks as fw
from fringeworks.rig.robot.readings import CONVENTIONS, SHAPES, readings_of
from tests.robots import written

POSES = np.tile(np.eye(4), (2, 1, 1))
POSES[:, :3, :3] = Rotation.from_rotvec([[0.3, -0.5, 1.2], [-0.8, 0.4, 0.6]]).as_matrix()
POSES[:, :3, 3] = [[612.5, -40.25, 388.0], [580.0, 120.5, 402.75]]


def numbers(maker):
    return written(POSES, CONVENTIONS[maker])


def lines(maker, form):
    return "\n".join(form.format(*row) for row in numbers(maker))


KRL = (
    "DECL E6POS XP{0:.0f}={{X {0:.6f},Y {1:.6f},Z {2:.6f},A {3:.6f},B {4:.6f},C {5:.6f},S 2,T 35}}"
)
LS = """P[1]{{
   GP1:
  UF : 0, UT : 1,  CONFIG : 'N U T, 0, 0, 0',
  X = {0:.6f} mm, Y = {1:.6f} mm, Z = {2:.6f} mm,
  W = {3:.6f} deg, P = {4:.6f} deg, R = {5:.6f} deg
}};"""
ABB = (
    "CONST robtarget p:=[[{:.6f},{:.6f},{:.6f}],[{:.8f},{:.8f},{:.8f},{:.8f}],[0,0,0,0],[9E9,9E9]];"
)
SIX = ",".join(["{:.8f}"] * 6)
SEVEN = ",".join(["{:.8f}"] * 7)


def ros_json(maker):
    found = []
    for x, y, z, a, b, c, d in numbers(maker):
        turn = {"x": a, "y": b, "z": c, "w": d}
        found.append({"header": {"stamp": 1}, "pose": {"position": {"x": x, "y": y, "z": z},
                                                        "orientation": turn}})  # fmt: skip
    return json.dumps(found)


def stamped_json(maker):
    found = []
    for x, y, z, a, b, c, d in numbers(maker):
        turn = {"w": d, "x": a, "y": b, "z": c}
        found.append({"transform": {"rotation": turn, "translation": {"x": x, "y": y, "z": z}}})
    return json.dumps({"poses": found})


FILES = {
    "ur script": ("ur", "a.script", lines("ur", f"movel(p[{SIX}], a=1.2)")),
    "kuka program": ("kuka", "a.dat", lines("kuka", KRL)),
    "fanuc program": ("fanuc", "a.ls", lines("fanuc", LS)),
    "abb program": ("abb", "a.mod", lines("abb", ABB)),
    "ur table": ("ur", "a.csv", "x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\n" + lines("ur", SIX)),
    "kuka table": ("kuka", "a.csv", "X;Y;Z;A;B;C\n" + lines("kuka", SIX).replace(",", ";")),
    "comma": ("kuka", "a.csv", "X;Y;Z;A;B;C\n" + lines("kuka", SIX).replace(",", ";").replace(".", ",")),
    "fanuc table": ("fanuc", "a.csv", "X,Y,Z,W,P,R\n" + lines("fanuc", SIX)),
    "yaskawa table": ("yaskawa", "a.txt", lines("yaskawa", SIX).replace(",", " ")),
    "staubli table": ("staubli", "a.csv", "x,y,z,rx,ry,rz\n" + lines("staubli", SIX)),
    "epson table": ("epson", "a.csv", "X,Y,Z,U,V,W\n" + lines("epson", SIX)),
    "kawasaki table": ("kawasaki", "a.csv", "X,Y,Z,O,A,T\n" + lines("kawasaki", SIX)),
    "mitsubishi table": ("mitsubishi", "a.csv", "X,Y,Z,A,B,C\n" + lines("mitsubishi", SIX)),
    "comau table": ("comau", "a.csv", "x,y,z,e1,e2,e3\n" + lines("comau", SIX)),
    "abb table": ("abb", "a.csv", "x,y,z,q1,q2,q3,q4\n" + lines("abb", SEVEN)),
    "ros table": ("ros", "a.csv", "x,y,z,qx,qy,qz,qw\n" + lines("ros", SEVEN)),
    "ros message": ("ros", "a.json", ros_json("ros")),
    "ros transform": ("ros", "a.json", stamped_json("ros")),
    "ros angles": ("ros-rpy", "a.csv", "x,y,z,roll,pitch,yaw\n" + lines("ros-rpy", SIX)),
    "yaskawa job": ("yaskawa", "a.jbi", "/JOB\n//POS\n///RECTAN\n" + lines("yaskawa", "C00001=" + SIX)),
    "doosan program": ("doosan", "a.txt", lines("doosan", f"movel(posx({SIX}), v=50)")),
    "tf2_echo": ("ros", "a.txt", lines("ros", "At time 17.5\n- Translation: [{}, {}, {}]\n- Rotation: "
                 "in Quaternion (xyzw) [{}, {}, {}, {}]\n- Rotation: in RPY (radian) [1, 2, 3]")),
    "libfranka": ("franka", "a.json", json.dumps([{"O_T_EE": row.tolist()} for row in numbers("franka")])),
    "units of groups": ("abb", "a.json", json.dumps(
        [{"position_mm": r[:3].tolist(), "quaternion_wxyz": r[3:].tolist()} for r in numbers("abb")])),
    "rows": ("matrix", "a.json", json.dumps(numbers("matrix").reshape(-1, 4, 4).tolist())),
    "columns": ("franka", "a.json", json.dumps({"convention": "franka", "poses": numbers("franka").tolist()})),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_every_way_of_writing_has_its_reading(tmp_path, kind):
    maker, name, text = FILES[kind]
    (tmp_path / name).write_text(text)
    poses = fw.files.read_robot_poses(tmp_path / name)
    right = CONVENTIONS[maker]
    specs = {reading.spec: reading for reading in poses.readings}
    equal = [r for r in poses.readings if np.abs(r.transforms(poses.values) - POSES).max() < 1e-3]
    assert equal, specs
    known = fw.files.read_robot_poses(tmp_path / name, f"{equal[0].spec}:direct")
    np.testing.assert_allclose(known.transforms, POSES, atol=1e-3)
    assert (equal[0].length, equal[0].angle) == (right.length, right.angle)


def echoed(maker):
    """As ``ros2 topic echo`` prints PoseStamped."""
    form = "header:\n  stamp:\n    sec: 17\n    nanosec: 5\npose:\n  position:\n    x: {}\n    y: {}\n    z: {}\n"
    form += "  orientation:\n    x: {}\n    y: {}\n    z: {}\n    w: {}\n---\n"
    return "".join(form.format(*row) for row in numbers(maker))


AXES = "q1,q2,q3,q4,q5,q6"
RTDE = [f"target_TCP_pose_{k}" for k in range(6)] + [f"actual_TCP_pose_{k}" for k in range(6)]
STRANGE = {
    "ros2 topic echo": ("ros", "a.yaml", echoed("ros")),
    "axes beside the pose": ("ur", "a.csv", f"{AXES},x,y,z,rx,ry,rz\n" + "\n".join(
        "0.1,0.2,0.3,-0.4,0.5,0.6," + row for row in lines("ur", SIX).split("\n"))),
    "RTDE": ("ur", "a.csv", " ".join(["timestamp", *RTDE]) + "\n" + "\n".join(
        "7.5 0 0 0 0 0 0 " + row.replace(",", " ") for row in lines("ur", SIX).split("\n"))),
    "units in a line": ("kuka", "a.csv", "X;Y;Z;A;B;C\nmm;mm;mm;deg;deg;deg\n"
                        + lines("kuka", SIX).replace(",", ";")),
    "remarks": ("abb", "a.txt", "! of the cell\n// x y\n; z\n" + lines("abb", SEVEN)),
    "letters of a quaternion": ("abb", "a.txt", lines(
        "abb", "X={} Y={} Z={} QW={} QX={} QY={} QZ={}")),
    "brackets": ("kuka", "a.txt", "[" + lines("kuka", SIX).replace("\n", "]\n[") + "]"),
    "order in the name": ("ros", "a.json", json.dumps(
        [{"translation": r[:3].tolist(), "quaternion_xyzw": r[3:].tolist()} for r in numbers("ros")])),
}  # fmt: skip


@pytest.mark.parametrize("kind", STRANGE)
def test_other_ways_of_writing(tmp_path, kind):
    """What other programs write: the right reading is there, and no unit is made up."""
    maker, name, text = STRANGE[kind]
    (tmp_path / name).write_text(text)
    poses = fw.files.read_robot_poses(tmp_path / name)
    near = [r for r in poses.readings if np.abs(r.transforms(poses.values) - POSES).max() < 1e-3]
    right = CONVENTIONS[maker]
    assert (right.length, right.angle) in {(r.length, r.angle) for r in near}


def test_a_column_that_is_there_twice_is_named(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,rx,ry,rz,x,y,z\n1,2,3,0.1,0.2,0.3,4,5,6")
    with pytest.raises(fw.InputError, match="expected each column once, got x twice"):
        fw.files.read_robot_poses(tmp_path / "a.csv")


def test_a_program_leaves_only_the_direction_open(tmp_path):
    programs = ("ur script", "abb program", "fanuc program", "yaskawa job", "doosan program")
    for kind in (*programs, "tf2_echo", "libfranka", "units of groups"):
        maker, name, text = FILES[kind]
        (tmp_path / name).write_text(text)
        poses = fw.files.read_robot_poses(tmp_path / name)
        assert [r.spec for r in poses.readings if not r.inverse] == [CONVENTIONS[maker].spec], kind


def test_several_readings_are_named(tmp_path):
    (tmp_path / "a.csv").write_text("X,Y,Z,A,B,C\n" + lines("kuka", SIX))
    poses = fw.files.read_robot_poses(tmp_path / "a.csv", "mm:deg:direct")
    with pytest.raises(fw.InputError, match=r"zyx:deg:mm \(as kuka, epson, nachi\).*poses_as"):
        _ = poses.transforms
    for said in ("abb", "kuka:m", "rad:deg", "direct:inverse", "zyx:xyz"):
        with pytest.raises(fw.InputError, match="expected words that one pose"):
            fw.files.read_robot_poses(tmp_path / "a.csv", said)
    with pytest.raises(fw.InputError, match="got 'ukra'"):
        fw.files.read_robot_poses(tmp_path / "a.csv", "ukra")


def test_names_are_kept(tmp_path):
    rows = lines("kuka", SIX).split("\n")
    (tmp_path / "a.csv").write_text("capture,x,y,z,a,b,c\nfirst," + rows[0] + "\nnext," + rows[1])
    assert fw.files.read_robot_poses(tmp_path / "a.csv").names == ("first", "next")
    table = {"one": numbers("kuka")[0].tolist(), "two": numbers("kuka")[1].tolist()}
    (tmp_path / "a.json").write_text(json.dumps(table))
    poses = fw.files.read_robot_poses(tmp_path / "a.json", "kuka")
    assert poses.names == ("one", "two")
    assert poses.at([1]).names == ("two",)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "", "expected 1 to"),
        ("a.csv", "1,2,3,4,5", "expected 6, 7, 12 or 16 numbers"),
        ("a.csv", "x,y,z,foo,bar,baz\n1,2,3,4,5,6", "expected a rotation"),
        ("a.csv", "1,2,3,4,5,six", "expected numbers, got six"),
        ("a.csv", "1,2,3,4,5,6\n1,2,3,1,0,0,0", "written alike"),
        ("a.csv", "x,y,z,qw,qx,qy,qz\n1,2,3,1,1,0,0", "quaternions of length 1"),
        ("a.json", "[1, 2", "expected poses of a robot"),
        ("a.json", '[{"x": 1}]', "expected x, y and z"),
        ("a.json", "7", "expected a list of poses"),
        ("a.json", '[{"position": [1, 2], "orientation": [1, 0, 0, 0]}]', "three numbers"),
        ("a.json", '[{"O_T_XX": [1, 2], "q": 1}]', "expected x, y and z of a pose, got q"),
        ("a.json", '[{"O_T_XX": [1, 2]}]', "expected the numbers of a pose, got o_t_xx"),
        ("a.csv", "X1,Y1,Z1,A1,B1,C1\n600,0,400,90,0,180", "expected x, y and z of a pose, got x1"),
        ("a.jbi", "///PULSE\nC00001=1,2,3,4,5,6", "got pulses of the motors"),
        ("a.xlsx", "", "expected one of .csv"),
    ],
)
def test_what_is_no_pose_is_refused_in_words(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(fw.InputError, match=words):
        fw.files.read_robot_poses(tmp_path / name)
    with pytest.raises(fw.FileProblem, match="no such file"):
        fw.files.read_robot_poses(tmp_path / "none.csv")


def test_readings_are_words_and_back():
    for kinds in SHAPES.values():
        for reading in readings_of("", kinds):
            direction = "" if reading.inverse else ":direct"
            assert readings_of(reading.spec + direction, kinds) == (reading,)


def test_one_pose_is_read_from_its_text():
    found = fw.files.parse_robot_pose("600, 0, 400, 90, 0, 180", "kuka:direct")
    np.testing.assert_allclose(found.transforms[0, :3, 3], [600, 0, 400])
    script = fw.files.parse_robot_pose("p[0.6, 0, 0.4, 0, 3.1416, 0]", "direct")
    np.testing.assert_allclose(script.transforms[0, :3, 3], [600, 0, 400])
    with pytest.raises(fw.InputError, match="robot pose: expected"):
        fw.files.parse_robot_pose("1,2")
