"""The chains from a capture to a result, each one readable function.

Every result carries its provenance. Where a capture or a rig is wanted, a path is read.
"""
