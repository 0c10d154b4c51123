"""A calibrated camera and projector: projection and triangulation."""
