"""The self-test: what the documentation promises, measured on this machine."""
