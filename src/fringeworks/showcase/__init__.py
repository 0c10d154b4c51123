"""The demonstration, and the dissertation's chapter 4."""
