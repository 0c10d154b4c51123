"""What is in a frame before analysis: noise, the response of projector and camera, denoising."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
