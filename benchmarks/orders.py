"""``python -m benchmarks.orders [--pixels N] [--seed S]``: wrong fringe orders under white noise.

Random plans and proposed plans are decoded by the kernel at the noise limit, where about half of
the pixels are refused. A pixel is wrong if its reason is OK and its coordinate is off by more than
half the shortest period. The command fails if there is any.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np

from fringeworks import (
    CameraNoise,
    GrayCode,
    InputError,
    PatternPlan,
    PhaseSteps,
    Reason,
    _core,
    equal_steps,
    propose,
)
from fringeworks.stack.kernel_settings import Limits, decoding_of, empty_maps

PIXELS_PER_PLAN = 100_000
"""Pixels of one plan: the share of a plan with many wrong orders stays small."""

TRIAL_PIXELS = 500
"""Pixels of a trial that finds the noise limit of a plan; enough for its share within 5 %."""

SIGNAL_TO_NOISE = np.geomspace(3.0, 1000.0, 31)
"""Modulations over noise that are tried for the noise limit."""


def random_plans(rng: np.random.Generator) -> Iterator[tuple[str, PatternPlan]]:
    """Plans of random periods and steps whose periods determine the coordinate."""
    while True:
        length = int(rng.integers(200, 2049))
        sets = int(rng.integers(2, 5))
        kind = str(rng.choice(["decimal", "whole", "with a long period", "beats", "hierarchy"]))
        if kind == "whole":
            periods = rng.integers(8, 60, sets).astype(float)
        elif kind == "beats":
            counts = rng.integers(5, max(7, length // 10), sets)
            periods = (length + rng.choice([0.0, 2.0, rng.uniform(0, 100)])) / counts
        else:
            periods = np.round(np.exp(rng.uniform(np.log(8), np.log(60), sets)), 2)
        if kind == "with a long period":
            periods[-1] = length * rng.choice([1.0, rng.uniform(1.0, 1.1), rng.uniform(1.0, 3.0)])
        if kind == "hierarchy":
            longest = length * rng.choice([1.0, rng.uniform(1.0, 1.1), rng.uniform(1.0, 3.0)])
            periods = longest / rng.uniform(3.0, 12.0) ** np.arange(sets)
        steps = [int(n) for n in rng.choice([3, 3, 4, 5, 6, 8], sets)]
        try:
            plan = PatternPlan(
                length,
                2,
                tuple(
                    PhaseSteps("x", float(p), equal_steps(n))
                    for p, n in zip(periods, steps, strict=True)
                ),
            )
            plan.chain("x")
        except InputError:
            continue
        yield f"random, {kind}", plan


def proposed_plans(rng: np.random.Generator) -> Iterator[tuple[str, PatternPlan]]:
    """Plans that ``propose`` makes for random projectors, cameras and surfaces."""
    while True:
        try:
            found = propose(
                int(rng.integers(200, 2049)),
                2,
                int(rng.integers(6, 19)),
                noise=float(rng.uniform(0.5, 6.0)),
                modulation=float(np.exp(rng.uniform(np.log(10.0), np.log(120.0)))),
                min_period_px=float(rng.uniform(8.0, 24.0)),
            )
        except InputError:
            continue
        for proposal in found:
            yield f"proposed, {proposal.kind}", proposal.plan


class Decoder:
    """One plan with noise of one count, decoded by the kernel."""

    def __init__(self, plan: PatternPlan, rng: np.random.Generator) -> None:
        self.plan, self.rng = plan, rng
        decoding = decoding_of(plan, "x", absolute=True, response=None)
        self.kernel = decoding.kernel(CameraNoise(1.0), Limits(float("inf")))
        sets = [b for b in plan.blocks if isinstance(b, PhaseSteps)]
        self.gross_px = 0.5 * min(b.period_px for b in sets)

    def count(self, modulation: np.ndarray) -> tuple[int, int]:
        """Number of ok pixels, and of wrong ones among them, at random coordinates."""
        n = modulation.size
        x = self.rng.uniform(-0.5, self.plan.width_px - 0.5, n)
        frames = []
        for block in self.plan.blocks:
            assert isinstance(block, PhaseSteps | GrayCode)
            for k in range(block.frames):
                frame = self.rng.standard_normal(n, np.float32)
                frame += (modulation * (2.0 * block.values(x, k) - 1.0)).astype(np.float32)
                frames.append(frame[None])
        maps = empty_maps((1, n))
        _core.decode_frames(frames, self.kernel, maps)
        ok = maps["reason"][0] == Reason.OK
        off = np.abs(maps["coordinate"][0] - x)
        return int(ok.sum()), int((ok & ~(off <= self.gross_px)).sum())

    def limit(self) -> float:
        """Modulation over noise at which about half of the pixels are ok that ever can be."""
        shares = [self.count(np.full(TRIAL_PIXELS, b))[0] / TRIAL_PIXELS for b in SIGNAL_TO_NOISE]
        half = 0.5 * max(shares)
        return float(next(b for b, s in zip(SIGNAL_TO_NOISE, shares, strict=True) if s >= half))


def main() -> int:
    """Decode plans of both origins in turn until there are enough ok pixels."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=float, default=1e8, help="ok pixels to decode")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.Generator(np.random.SFC64(arguments.seed))
    sources = [random_plans(rng), proposed_plans(rng)]
    plans, good, bad = Counter[str](), Counter[str](), Counter[str]()
    while good.total() < arguments.pixels:
        name, plan = next(sources[plans.total() % 2])
        decoder = Decoder(plan, rng)
        modulation = decoder.limit() * rng.uniform(0.8, 1.4, PIXELS_PER_PLAN)
        ok, wrong = decoder.count(modulation)
        plans[name] += 1
        good[name] += ok
        bad[name] += wrong
        if wrong:
            sets = [
                (round(b.period_px, 3), b.frames) for b in plan.blocks if isinstance(b, PhaseSteps)
            ]
            print(
                f"{wrong} of {ok} wrong: {name}, {plan.width_px} px, {sets}, "
                f"modulation {modulation.mean():.1f} × noise",
                flush=True,
            )
    for name in sorted(plans):
        print(f"{name:32} {plans[name]:6} plans {good[name]:12,} ok px {bad[name]:8} wrong")
    print(f"{bad.total()} wrong of {good.total():,} ok px in {plans.total()} plans")
    return 1 if bad.total() else 0


if __name__ == "__main__":
    sys.exit(main())
