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

impl Field<'_> {
    /// The order with the largest likelihood of all in the range, with equal prior probabilities.
    pub fn vote_at(&self, mean: &Mean, i: usize) -> Vote {
        let weights = self.weights(mean);
        let mut best = Vote {
            order: super::UNDECIDED,
            misfit: f32::INFINITY,
            others: 1.0,
        };
        // Probabilities over that of the best order so far.
        let mut total = 0.0;
        for order in self.orders(self.finest_turns(i), self.slack(i)) {
            let misfit = self.misfit(mean, &weights, order);
            if misfit < best.misfit {
                total = total * (0.5 * (misfit - best.misfit)).exp() + 1.0;
                (best.order, best.misfit) = (order, misfit);
            } else {
                total += (0.5 * (best.misfit - misfit)).exp();
            }
        }
        best.order = self.in_range(i, best.order);
        best.others = if total > 0.0 {
            (total - 1.0) / total
        } else {
            1.0
        };
        best
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

    /// χ² of phases about an order, at the best coordinate.
    #[inline(always)]
    pub fn misfit(&self, mean: &Mean, weights: &Weights, order: i32) -> f32 {
        let (mut square, mut pull) = (0.0, 0.0);
        for k in 0..self.sets {
            let off = wrap(mean.turns[k] - self.ratio[k] * order as f32);
            let weighted = weights.of_sets[k] * off;
            square += weighted * off;
            pull += self.ratio[k] * weighted;
        }
        (TAU * TAU) * (square - pull * pull / weights.total)
    }

    /// Whether a pixel's own phases allow an order: its χ² is hardly larger than that of any other.
    pub fn allows(&self, i: usize, order: i32, doubt: f32) -> bool {
        let own = self.alone(i);
        let best = self.vote_at(&own, i);
        self.misfit(&own, &self.weights(&own), order) <= best.misfit + doubt
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
