"""The headless scanner: scans over HTTP, one at a time, with results that survive restarts."""
