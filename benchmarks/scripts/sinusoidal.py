"""Three fringe images to their wrapped phase by OpenCV's structured_light: folder, target."""

import sys
from pathlib import Path

import cv2
import numpy as np

folder, target = map(Path, sys.argv[1:])
images = [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(folder.glob("*.png"))]
light = cv2.structured_light
settings = light.SinusoidalPattern.Params()
settings.width, settings.height, settings.nbrOfPeriods = 1920, 1200, 64
settings.setMarkers, settings.horizontal = False, False
settings.methodId, settings.shiftValue = light.PSP, 2 * np.pi / 3
phase, _ = light.SinusoidalPattern.create(settings).computePhaseMap(images)
np.savez(target, phase=phase)
