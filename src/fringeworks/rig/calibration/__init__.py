"""Calibration: from photographs of a board in several poses to a rig with its covariance."""
