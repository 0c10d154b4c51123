"""Scripts in processes of their own, and one that calls every kernel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TIMEOUT = 120
"""Seconds after which a process counts as one that hangs; it takes about five."""


def run(script: str, **environment: str) -> str:
    """Output of a script; a process of its own, so that one that hangs can be ended."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", script],
        cwd=Path(__file__).parents[1],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


EVERY_KERNEL = """
import dataclasses
import io
import os
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
import fringeworks as fw
from fringeworks.types import fingerprint
from fringeworks import _core

called = set()

def counted(name, kernel):
    def call(*arguments, **options):
        called.add(name)
        return kernel(*arguments, **options)
    return call

kernels = {n for n in _core.__all__ if callable(getattr(_core, n))}
for name in kernels:
    setattr(_core, name, counted(name, getattr(_core, name)))

from fringeworks.simulate.bodies import height_field
from fringeworks.surface.form import fit_form
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.pair.methods.inverse_function import find_extrema
from tests.stacks import multi, take
from tests.cliff_scenes import boxes
from tests.sequences import captured, plan_of, rig_of

plan = multi((1, 8), 4, (300, 40))
frames = take(plan)
scene = standard_scene("parabola", size=64, fringes=6, noise=1, seed=1)
painted = standard_scene("parabola", size=120, fringes=6, noise=1, seed=1, painted=True)
cliffs, _, _ = boxes(4, 16.0, side=160)
rig = standard_rig(scale=0.2)
phase = np.angle(np.exp(1j * np.add.outer(np.arange(40), np.arange(50)) / 4))

def results():
    found = [fw.decode(frames, plan)]
    # Dark counts and bright ones at the sensor's limits are judged by a kernel of their own.
    found.append(fw.decode([np.clip(1.4 * f - 20.0, 0, 255).astype(np.uint8) for f in frames], plan))
    # Noise takes the margin of two sets: neighbours vote.
    two = multi((1, 16), 3, (300, 40))
    found.append(fw.decode(take(two, a=60.0, b=30.0, noise=3.0), two))
    # Gray-code cells of a whole period: neighbours tell the orders at their ends.
    steps = fw.patterns.PhaseSteps("x", 30.0, fw.patterns.equal_steps(4))
    blocks = (steps, fw.patterns.GrayCode("x", 30.0, 300, inverse=True))
    coded = fw.PatternPlan(300, 40, blocks)
    found.append(fw.decode(take(coded, a=60.0, b=30.0, noise=4.0), coded))
    # Blur beside paint shifts coordinates; a step of depth mixes them.
    column = np.add.outer(np.zeros(90), 1.3 * np.arange(120)) + 40.0 * (np.arange(90)[:, None] > 60)
    paint = np.where((np.arange(120) // 9) % 2, 0.3, 1.0) * np.ones((90, 1))
    mixed = [
        np.rint(4 + 200 * gaussian_filter(paint * np.interp(column, np.arange(300), p[0] / 255.0), 0.8))
        for p in fw.encode(multi((1, 18), 4, (300, 40)))
    ]
    found.append(fw.decode([m.astype(np.uint8) for m in mixed], multi((1, 18), 4, (300, 40))))
    moments = fw.stack.decode_sequence([*frames, *take(plan, seed=1)], plan, every=4)
    found += [moment.decoded for moment in moments]
    stream = fw.stack.StreamingDecoder(plan)
    for frame in frames:
        stream.add(frame)
    found.append(stream.result())
    view = look(rig, bust())
    layout = fringe_plan(rig)
    decoded = fw.decode(list(photograph(view, layout, Optics())), layout)
    wave = 0.1 * np.sin(np.arange(180.0)).reshape(9, 10, 2)
    field = fw.rig.LensField((-60.0, -60.0), (60.0, 60.0), wave, np.zeros((9, 10, 2)))
    devices = {name: dataclasses.replace(getattr(rig, name), field=field) for name in ("camera", "projector")}
    for one in (rig, dataclasses.replace(rig, **devices)):
        found.append(fw.rig.Triangulator(one).triangulate(decoded))
    cloud = found[-2]
    flat = cloud.xyz_mm.reshape(len(cloud.reason), -1)
    found.append(_core.pack_vertices(flat, cloud.sigma_mm, cloud.noise_mm, cloud.reason))
    ball = np.random.default_rng(1).normal(size=(300, 3))
    ball *= 20.0 / np.linalg.norm(ball, axis=1, keepdims=True)
    found.append(fit_form(ball, "sphere").distance_mm)
    drift = np.full((*frames[0].shape, 2), 0.3, np.float32)
    found.append(_core.warp_by_flow(frames[0].astype(np.float32), drift, 2.0))
    powers = np.vander(np.linspace(-1, 1, 200), 3).T.copy()
    found.append(_core.robust_fit(
        powers, np.sin(7 * powers[1]), np.ones(200), {"fits": 12, "least": 0.1, "most": 4.7})[0])
    places = np.random.default_rng(2).normal(size=(300, 3))
    errors = (places, *np.ones((3, 300)), np.arange(300) % 4)
    found.append(_core.error_sums(errors, np.ones(300), places[:1].copy(), 4)[2])
    live = fw.stack.Decoder(plan_of(), rig_of().camera.shape, rig=rig_of())
    for seed in range(2):
        found.append(live.points(captured(plan_of(), rig_of(), seed=seed)).reason.copy())
    found += [fw.analyse(scene, name) for name in fw.methods()]
    found += [fw.analyse(painted), fw.analyse(cliffs)]
    found += [fw.unwrap(phase, algorithm=name).phase for name in ("reliability", "guided")]
    found += [fw.signal.decompose_rows(scene.object), fw.signal.decompose_frame(scene.object)]
    found.append(find_extrema(scene.object[30], 10.0).position_px)
    picture = io.BytesIO()
    Image.fromarray(frames[0]).save(picture, "PNG")
    found.append(_core.read_grey_png(picture.getvalue()))
    hill = height_field(np.hypot(*np.mgrid[-5:6, -5:6]), 1.0)
    found.append(hill.hit(np.array([0.1, 0.2, 50.0]), np.array([[0.0, 0.0, -1.0]])))
    return [fingerprint(result) for result in found]

first = results()
assert called == kernels, kernels - called
child = os.fork()
if child == 0:
    ok = results() == first
    grandchild = os.fork()
    if grandchild == 0:
        os._exit(0 if fingerprint(fw.decode(frames, plan)) == first[0] else 3)
    ok = ok and os.waitstatus_to_exitcode(os.waitpid(grandchild, 0)[1]) == 0
    os._exit(0 if ok else 3)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
print("equal")
"""


def spawned(seed):
    """Decode in a process that was spawned."""
    import fringeworks as fw
    from fringeworks.types import fingerprint
    from tests.stacks import multi, take

    plan = multi((1, 8), 4, (300, 40))
    return fingerprint(fw.decode(take(plan, seed=seed), plan))
