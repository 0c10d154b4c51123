"""Sample data of the release: a small simulated capture for each way to measure, fetched once."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
