"""Live points from a projector and a camera; here both are virtual."""

from itertools import islice

import fringeworks as fw
from fringeworks.simulate import fringe_plan

rig = fw.devices.virtual_rig()  # or fw.files.read_rig("rig.toml")
plan = fringe_plan(rig, both=False)  # or fw.files.read_plan("plan.toml")


def devices():
    """Open the devices; again, where one of them was unplugged."""
    return fw.open_devices("virtual", "virtual:bust")  # or "screen", "webcam:0"


projector, camera = devices()
with projector, camera:
    clouds = fw.live(projector, camera, plan, rig, reopen=devices, progress=print)
    for cloud in islice(clouds, 5):
        print(cloud)

figure = cloud.points.profile(((60, 150), (330, 150))).plot("last cloud")
fw.save_figure(figure, "live.png")
