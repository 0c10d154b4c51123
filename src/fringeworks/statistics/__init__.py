"""Statistics: scatter of maps against the standard deviations that they state."""
