"""Geometrical tolerances of ISO 1101: bodies, datum systems, zones and their uncertainty."""
