"""A calibrated camera and projector: the pinhole model, calibration, triangulation."""
