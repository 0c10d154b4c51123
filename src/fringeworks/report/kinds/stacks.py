"""What is shown of the points of a stack of frames."""

from __future__ import annotations

from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.kind import Kind, describe
from fringeworks.report.kinds.surface import (
    cloud_chapter,
    cloud_figures,
    cloud_sheet,
    cloud_words,
)
from fringeworks.types import PointCloud


def points(result: Measurement) -> PointCloud:
    """The points, as which a measurement is shown."""
    return result.points


describe(
    Measurement,
    Kind(
        lambda result: cloud_figures(points(result)),
        cloud_words,
        lambda result, name: cloud_sheet(points(result), name),
        lambda result, context: cloud_chapter(points(result), result, context),
        points,
    ),
)
