"""Errors against a known truth, and comparison of methods."""
