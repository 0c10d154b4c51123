"""Sample data of the release: a small simulated capture for each way to measure, fetched once."""

from .sets import (
    ball as ball,
    bust as bust,
    board as board,
    views as views,
    parts as parts,
)
