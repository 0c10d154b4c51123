"""Shifted frames and Gray code: from a stack of frames to projector coordinates."""
