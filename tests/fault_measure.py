"""What a decoder makes of a shot: its verdict, wrong fringe orders, and coverage of its σ."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

import fringeworks as fw
from fringeworks import InputError, PatternPlan, Reason
from tests.fault_stage import Shot, Stage
from tests.faults import FAULTS, dark_frame, lost, swapped
from tests.faults_rare import RARE

EVERY = FAULTS | RARE
"""All faults by name; the table goes through ``FAULTS`` unless told otherwise."""


BANDS = {"all": (0.0, np.inf), "< 5": (0.0, 5.0), "5-10": (5.0, 10.0), "> 10": (10.0, np.inf)}
"""Ranges of the modulation that the figures are split by, counts.

The modulation is that of the scene without a fault. Unlit pixels belong to the lowest range.
"""


@dataclass
class Tally:
    """Numbers of pixels in a range of the modulation; tallies of several shots can be added."""

    lit: int = 0
    ok: int = 0
    """Pixels with a coordinate."""
    wrong: int = 0
    """Of them, those off by more than half the shortest period, or that no light falls on."""
    within: list[int] = field(default_factory=lambda: [0, 0, 0])
    """Of them, those within 1, 2 and 5 σ of the truth."""

    def __add__(self, other: Tally) -> Tally:
        within = [a + b for a, b in zip(self.within, other.within, strict=True)]
        return Tally(self.lit + other.lit, self.ok + other.ok, self.wrong + other.wrong, within)

    @property
    def ok_share(self) -> float:
        """Pixels with a coordinate per lit pixel."""
        return self.ok / max(1, self.lit)

    @property
    def wrong_per_million(self) -> float:
        """Wrong pixels per million with a coordinate."""
        return 1e6 * self.wrong / max(1, self.ok)

    @property
    def beyond_per_million(self) -> float:
        """Pixels beyond 5 σ per million with a coordinate."""
        return 1e6 * (self.ok - self.within[2]) / max(1, self.ok)

    @property
    def coverage(self) -> list[float]:
        """Shares of the pixels within 1, 2 and 5 σ."""
        return [n / max(1, self.ok) for n in self.within]


@dataclass
class Outcome:
    """What a decoder made of a shot."""

    refused: str = ""
    """The error's message; empty where the shot was decoded."""
    crashed: str = ""
    """Any other exception, which is a defect of the decoder."""
    notes: tuple[str, ...] = ()
    """Notes of the result, without the one that tells the noise."""
    noise: float = 0.0
    """Read noise that was found, counts."""
    bands: dict[str, Tally] = field(default_factory=lambda: {name: Tally() for name in BANDS})

    @property
    def verdict(self) -> str:
        """refused, crashed, noted or silent, with the text."""
        if self.crashed:
            return f"crashed: {self.crashed}"
        if self.refused:
            return f"refused: {self.refused}"
        return f"noted: {'; '.join(self.notes)}" if self.notes else "silent"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        bands = {
            name: asdict(t)
            | {
                "ok_share": t.ok_share,
                "wrong_per_million": t.wrong_per_million,
                "beyond_5_sigma_per_million": t.beyond_per_million,
                "coverage": t.coverage,
            }
            for name, t in self.bands.items()
        }
        return {
            "verdict": self.verdict.split(":")[0],
            "refused": self.refused,
            "crashed": self.crashed,
            "notes": list(self.notes),
            "noise": self.noise,
            "bands": bands,
        }


def capture(condition: str, stage: Stage, seed: int) -> Shot:
    """A shot under a fault, the same for the same seed.

    ``lost:3``, ``dark-frame:3`` and ``swapped:3-5`` name the frames instead of drawing them.
    """
    name, _, frames = condition.partition(":")
    rng = np.random.default_rng([seed, *name.encode()])
    if not frames:
        return EVERY[name](stage, rng)
    if name == "swapped":
        first, second = frames.split("-")
        return swapped(stage, rng, (int(first), int(second)))
    return {"lost": lost, "dark-frame": dark_frame}[name](stage, rng, int(frames))


def expand(condition: str, plan: PatternPlan) -> list[str]:
    """``lost:*``, ``dark-frame:*`` and ``swapped:*`` for every frame or pair of a plan."""
    name, _, frames = condition.partition(":")
    if frames != "*":
        return [condition]
    n = plan.frames
    if name == "swapped":
        return [f"{name}:{a}-{b}" for a in range(n) for b in range(a + 1, n)]
    return [f"{name}:{i}" for i in range(n)]


def errors(coordinate_px: np.ndarray, shot: Shot, offset: float) -> np.ndarray:
    """Distance of every coordinate from the nearest right one, px; infinite where none is right."""
    error = np.abs(coordinate_px - offset - shot.truth)
    error = np.where(np.isfinite(error), error, np.inf).min(axis=0)
    return np.maximum(error - shot.slack, 0.0)


def measure(shot: Shot, stage: Stage, **options: Any) -> Outcome:
    """Decode a shot and compare the result with the truth."""
    try:
        decoded = fw.decode(shot.frames, stage.plan, **options)
    except InputError as error:
        return Outcome(refused=str(error))
    except Exception as error:  # the table goes on and shows the defect
        return Outcome(crashed=f"{type(error).__name__}: {error}")
    found = decoded.x
    assert found is not None
    notes = tuple(note for note in decoded.notes if not note.startswith("noise of"))
    ok = found.reason == Reason.OK
    error = errors(found.coordinate_px, shot, 0.0)
    wrong = ok & (error > 0.5 * stage.finest_px)
    if shot.any_offset and np.any(ok & ~wrong):
        offset = float(np.median((found.coordinate_px - shot.truth[0])[ok & ~wrong]))
        error = errors(found.coordinate_px, shot, offset)
    within = [ok & (error <= k * found.sigma_px) for k in (1, 2, 5)]
    bands = {}
    for name, (low, high) in BANDS.items():
        here = (stage.modulation >= low) & (stage.modulation < high)
        bands[name] = Tally(
            int(np.sum(here & stage.seen.lit)),
            int(np.sum(here & ok)),
            int(np.sum(here & wrong)),
            [int(np.sum(here & w)) for w in within],
        )
    return Outcome(notes=notes, noise=float(decoded.noise.read_counts), bands=bands)


def run(condition: str, plan: PatternPlan, scene: str = "bust", seed: int = 0) -> Outcome:
    """One cell of the table."""
    stage = Stage(scene, plan)
    return measure(capture(condition, stage, seed), stage)
