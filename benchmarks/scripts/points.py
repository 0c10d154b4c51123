"""Fringe images to a PLY with OpenCV and NumPy, as many people write it: folder, rig, target."""

import sys
from pathlib import Path

import cv2
import numpy as np

folder, rig, target = map(Path, sys.argv[1:])
counts, steps, width = (1, 8, 64), 4, 1920
images = [
    cv2.imread(str(p), cv2.IMREAD_GRAYSCALE).astype(float) for p in sorted(folder.glob("*.png"))
]

phases = []
for k in range(len(counts)):
    shifted = images[k * steps : (k + 1) * steps]
    sine = sum(i * np.sin(2 * np.pi * n / steps) for n, i in enumerate(shifted))
    cosine = sum(i * np.cos(2 * np.pi * n / steps) for n, i in enumerate(shifted))
    phases.append(np.mod(np.arctan2(sine, cosine), 2 * np.pi))
absolute = phases[0]
for k in range(1, len(counts)):
    ratio = counts[k] / counts[k - 1]
    orders = np.round((absolute * ratio - phases[k]) / (2 * np.pi))
    absolute = phases[k] + 2 * np.pi * orders
column = absolute * width / (2 * np.pi * counts[-1])

known = np.load(rig)
camera = np.hstack((known["camera"], np.zeros((3, 1))))
projector = known["projector"] @ known["pose"][:3]
v, u = np.mgrid[: column.shape[0], : column.shape[1]]
left = np.stack(
    (
        camera[0] - u.reshape(-1, 1) * camera[2],
        camera[1] - v.reshape(-1, 1) * camera[2],
        projector[0] - column.reshape(-1, 1) * projector[2],
    ),
    axis=1,
)
points = np.linalg.solve(left[:, :, :3], -left[:, :, 3:])[:, :, 0]

with open(target, "wb") as file:
    file.write(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n".encode()
    )
    file.write(points.astype("<f4").tobytes())
