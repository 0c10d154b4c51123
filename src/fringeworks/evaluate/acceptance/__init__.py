"""Acceptance tests of scanners after VDI/VDE 2634: positions, quality parameters, certificate."""
