"""A calibrated camera and projector: the pinhole model, calibration, triangulation."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
