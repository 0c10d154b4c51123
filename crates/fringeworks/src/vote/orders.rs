//! The posterior over the fringe orders of the finest set.

use super::field::{Field, Mean};
use super::wrap;
use std::f32::consts::TAU;
use std::ops::RangeInclusive;

/// What phases say about an order.
pub struct Vote {
    /// The most probable order of the finest phase.
    pub order: i32,
    /// χ² of the phases about it.
    pub misfit: f32,
    /// Posterior probability of all other orders.
    pub others: f32,
}

/// Orders that are tried at once.
const LANES: usize = 16;

/// Half the difference of χ² from which on the probability of an order, over that of the best one, is
/// below the rounding errors of the sum of both.
const NEGLIGIBLE: f32 = 17.0;

impl Field<'_> {
    /// The order with the largest likelihood of all in the range, with equal prior probabilities.
    pub fn vote_at(&self, mean: &Mean, i: usize) -> Vote {
        let orders = self.orders(self.finest_turns(i), self.slack(i));
        let mut vote = most_probable(self, mean, &self.weights(mean), orders);
        vote.order = self.in_range(i, vote.order);
        vote
    }

    /// Orders whose coordinates lie in the range.
    fn orders(&self, finest_turns: f32, slack: f32) -> RangeInclusive<i32> {
        let chain = &self.settings.chain;
        let slack = if chain.circular { 0.0 } else { slack };
        let at = |px: f32| px * self.finest_frequency() - finest_turns;
        let low = at(chain.middle - chain.half - slack).ceil() as i32;
        let high = at(chain.middle + chain.half + slack).floor() as i32;
        low..=high
    }

    /// An order, for coordinates that repeat that of the range.
    #[inline(always)]
    pub fn in_range(&self, i: usize, order: i32) -> i32 {
        let chain = &self.settings.chain;
        if !chain.circular || chain.repeats.is_infinite() {
            return order;
        }
        let f = self.finest_frequency();
        let x = (self.finest_turns(i) + order as f32) / f;
        let repeats = ((x - chain.middle) / chain.repeats).round_ties_even();
        order - (repeats * chain.repeats * f).round_ties_even() as i32
    }

    /// Inverse variances of the phases, 1/rad².
    pub fn weights(&self, mean: &Mean) -> Weights {
        let mut weights = Weights::default();
        for k in 0..self.sets {
            let weight = 1.0 / (mean.variance[k] + self.floor[k]);
            weights.of_sets[k] = weight;
            weights.total += self.ratio[k] * self.ratio[k] * weight;
        }
        weights
    }

    /// χ² of phases about an order and those after it, at the best coordinate of each.
    #[inline(always)]
    fn misfits<const N: usize>(&self, mean: &Mean, weights: &Weights, order: i32) -> [f32; N] {
        let (mut square, mut pull) = ([0.0; N], [0.0; N]);
        for k in 0..self.sets {
            for n in 0..N {
                let off = wrap(mean.turns[k] - self.ratio[k] * (order + n as i32) as f32);
                let weighted = weights.of_sets[k] * off;
                square[n] += weighted * off;
                pull[n] += self.ratio[k] * weighted;
            }
        }
        std::array::from_fn(|n| (TAU * TAU) * (square[n] - pull[n] * pull[n] / weights.total))
    }

    /// Whether a pixel's own phases allow an order: its χ² is hardly larger than that of any other.
    pub fn allows(&self, i: usize, order: i32, doubt: f32) -> bool {
        let own = self.alone(i);
        let best = self.vote_at(&own, i);
        let [misfit] = self.misfits(&own, &self.weights(&own), order);
        misfit <= best.misfit + doubt
    }

    /// Coordinate of a pixel of known order, px, and its σ; none where its sets disagree or where it lies
    /// outside the range.
    pub fn coordinate(&self, i: usize, order: i32) -> Option<(f32, f32)> {
        let own = self.alone(i);
        let (mut square, mut pull, mut total) = (0.0, 0.0, 0.0);
        for k in 0..self.sets {
            let weight = 1.0 / (own.variance[k] + self.sigma_floor[k]);
            let off = wrap(own.turns[k] - self.ratio[k] * order as f32);
            let f = self.frequency[k];
            square += weight * off * off;
            pull += f * weight * off;
            total += f * f * weight;
        }
        let (limits, chain) = (&self.settings.limits, &self.settings.chain);
        let misfit = (TAU * TAU) * (square - pull * pull / total);
        let sigma = 1.0 / (TAU * total.sqrt());
        let mut x = (self.finest_turns(i) + order as f32) / self.finest_frequency() + pull / total;
        if chain.circular && chain.repeats.is_finite() {
            x -= chain.repeats * ((x - chain.middle) / chain.repeats).round_ties_even();
        }
        let outside = (x - chain.middle).abs() > chain.half + limits.confidence * sigma;
        let fits = misfit <= limits.max_disagreement && (chain.circular || !outside);
        fits.then_some((x, sigma))
    }
}

/// Inverse variances of phases.
#[derive(Default)]
pub struct Weights {
    of_sets: [f32; 16],
    /// Sum of those of the sets, times their squared frequency over that of the finest.
    total: f32,
}

/// The order with the smallest χ² of a range, and the probability of all others.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn most_probable(
    field: &Field,
    mean: &Mean,
    weights: &Weights,
    orders: RangeInclusive<i32>,
) -> Vote {
    let mut best = Vote {
        order: super::UNDECIDED,
        misfit: f32::INFINITY,
        others: 1.0,
    };
    // Probabilities over that of the best order so far.
    let mut total = 0.0;
    for first in orders.clone().step_by(LANES) {
        let misfits: [f32; LANES] = field.misfits(mean, weights, first);
        let tried = &misfits[..LANES.min((orders.end() - first) as usize + 1)];
        for (n, &misfit) in tried.iter().enumerate() {
            let worse = 0.5 * (misfit - best.misfit);
            if worse < 0.0 {
                total = total * worse.exp() + 1.0;
                (best.order, best.misfit) = (first + n as i32, misfit);
            } else if worse < NEGLIGIBLE {
                total += (-worse).exp();
            }
        }
    }
    if total > 0.0 {
        best.others = (total - 1.0) / total;
    }
    best
}
