"""Scans: showing patterns and grabbing frames, with the right timing and exposure."""
