//! The posterior over the fringe orders of the finest set, for many pixels at once.

use super::band::LANES;
use super::field::{Field, MAX_OTHERS};
use super::window::{Lane, Means};
use super::{PER_TURN, UNDECIDED, wrap};
use crate::triangulate::arithmetic::power_of_two;
use std::f32::consts::{LOG2_E, TAU};

/// Half the difference of χ² from which on the probability of an order, over that of the best one, is
/// below the rounding errors of the sum of both.
const NEGLIGIBLE: f32 = 17.0;

/// What phases say about orders.
pub struct Vote {
    /// The most probable order of the finest phase, as a number; NaN where there is none in the range.
    order: Lane,
    /// χ² of the phases about it.
    pub misfit: Lane,
    /// Posterior probability of all other orders.
    pub others: Lane,
}

impl Default for Vote {
    fn default() -> Self {
        Self {
            order: [f32::NAN; LANES],
            misfit: [f32::INFINITY; LANES],
            others: [1.0; LANES],
        }
    }
}

impl Vote {
    /// The most probable order of a pixel, within the range that coordinates repeat in.
    pub fn order(&self, field: &Field, lane: usize, i: usize) -> i32 {
        if self.order[lane].is_nan() {
            return UNDECIDED;
        }
        field.in_range(i, self.order[lane] as i32)
    }
}

/// Phases of several pixels, of the sets but the finest less the share that the finest one explains.
pub struct Phases {
    turns: [Lane; MAX_OTHERS],
    /// Inverse variances, 1/turns².
    weight: [Lane; MAX_OTHERS],
    /// Inverse of their sum with the squared frequencies over that of the finest, and with the finest.
    per_total: Lane,
    /// First and last order whose coordinates lie in the range.
    low: Lane,
    high: Lane,
}

impl Default for Phases {
    fn default() -> Self {
        Self {
            turns: [[0.0; LANES]; MAX_OTHERS],
            weight: [[0.0; LANES]; MAX_OTHERS],
            per_total: [1.0; LANES],
            low: [0.0; LANES],
            high: [-1.0; LANES],
        }
    }
}

impl Phases {
    /// Those of windows around pixels.
    pub fn of_means(&mut self, field: &Field, means: &Means, pixels: &[usize]) {
        let others = field.others();
        self.turns[..others].copy_from_slice(&means.turns[..others]);
        self.weigh(field, &means.variance, &means.finest_variance, pixels);
    }

    /// Those of single pixels, up to as many as there are lanes.
    pub fn of_pixels(&mut self, field: &Field, pixels: &[usize]) {
        let mut variance = [[1.0; LANES]; MAX_OTHERS];
        let gather = |map: &[f32], out: &mut Lane| {
            for (value, &i) in out.iter_mut().zip(pixels) {
                *value = map[i];
            }
        };
        let (mut fine, mut fine_variance) = ([0.0; LANES], [1.0; LANES]);
        gather(&field.phases[field.finest], &mut fine);
        gather(&field.variances[field.finest], &mut fine_variance);
        for j in 0..field.others() {
            let k = field.other_sets[j];
            gather(&field.phases[k], &mut self.turns[j]);
            gather(&field.variances[k], &mut variance[j]);
            let ratio = field.other_ratio[j];
            take_finest(&mut self.turns[j], &fine, ratio);
        }
        self.weigh(field, &variance, &fine_variance, pixels);
    }

    /// Set the weights and the range of orders. Lanes without a lit pixel have none.
    fn weigh(
        &mut self,
        field: &Field,
        variance: &[Lane; MAX_OTHERS],
        finest: &Lane,
        pixels: &[usize],
    ) {
        weigh(self, field, variance, finest);
        let chain = &field.settings.chain;
        let mut reach = [f32::NAN; LANES];
        let mut fine = [0.0; LANES];
        for (lane, &i) in pixels.iter().enumerate().filter(|&(_, &i)| field.is_lit(i)) {
            let slack = if chain.circular {
                0.0
            } else {
                field.slack(i).min(chain.half)
            };
            (reach[lane], fine[lane]) = (chain.half + slack, field.finest_turns(i));
        }
        limit(
            self,
            (chain.middle, field.finest_frequency()),
            &reach,
            &fine,
        );
    }

    /// First and last order of all ranges.
    fn ends(&self) -> (i32, i32) {
        let some = (self.low.iter().zip(&self.high)).filter(|(low, high)| low <= high);
        let ends = some.fold(
            (f32::INFINITY, f32::NEG_INFINITY),
            |(a, b), (&low, &high)| (a.min(low), b.max(high)),
        );
        if ends.0 <= ends.1 {
            (ends.0 as i32, ends.1 as i32)
        } else {
            (0, -1)
        }
    }

    /// Whether an order of a pixel lies in the range.
    pub fn contains(&self, lane: usize, order: f32) -> bool {
        (self.low[lane]..=self.high[lane]).contains(&order)
    }

    /// χ² about the best order of each pixel but a given one, if any.
    pub fn best(&self, field: &Field, except: &Lane) -> Lane {
        match field.others() {
            1 => best::<1>(self, field, except),
            2 => best::<2>(self, field, except),
            3 => best::<3>(self, field, except),
            4..=6 => best::<6>(self, field, except),
            _ => best::<MAX_OTHERS>(self, field, except),
        }
    }

    /// The best orders, their χ², and the posterior probability of all others; `misfits` is memory.
    pub fn vote(&self, field: &Field, misfits: &mut Vec<Lane>, out: &mut Vote) {
        match field.others() {
            1 => vote::<1>(self, field, misfits, out),
            2 => vote::<2>(self, field, misfits, out),
            3 => vote::<3>(self, field, misfits, out),
            4..=6 => vote::<6>(self, field, misfits, out),
            _ => vote::<MAX_OTHERS>(self, field, misfits, out),
        }
    }

    /// χ² about an order of each pixel, at its best coordinate.
    pub fn misfit(&self, field: &Field, lane: usize, order: f32) -> f32 {
        let (mut square, mut pull) = (0.0, 0.0);
        for j in 0..field.others() {
            let ratio = field.other_ratio[j];
            let off = wrap(self.turns[j][lane] - ratio * order);
            let weighted = self.weight[j][lane] * off;
            square += weighted * off;
            pull += ratio * weighted;
        }
        square - pull * pull * self.per_total[lane]
    }
}

/// Turn phases of a set (rad) into turns less the share that the finest phases explain.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn take_finest(own: &mut Lane, finest: &Lane, ratio: f32) {
    for i in 0..LANES {
        own[i] = wrap(own[i] * PER_TURN - ratio * (finest[i] * PER_TURN));
    }
}

/// Set the weights of phases by their variances, rad².
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn weigh(phases: &mut Phases, field: &Field, variance: &[Lane; MAX_OTHERS], finest: &Lane) {
    let mut total = [0.0; LANES];
    for i in 0..LANES {
        total[i] = (TAU * TAU) / (finest[i] + field.floor[field.finest]);
    }
    for j in 0..field.others() {
        let (floor, ratio) = (field.floor[field.other_sets[j]], field.other_ratio[j]);
        let (weights, variance) = (&mut phases.weight[j], &variance[j]);
        for i in 0..LANES {
            let weight = (TAU * TAU) / (variance[i] + floor);
            weights[i] = weight;
            total[i] += ratio * ratio * weight;
        }
    }
    for i in 0..LANES {
        phases.per_total[i] = 1.0 / total[i];
    }
}

/// Set the range of orders of coordinates up to a `reach` from the middle of the range, px; NaN: none.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn limit(phases: &mut Phases, (middle, frequency): (f32, f32), reach: &Lane, fine: &Lane) {
    for i in 0..LANES {
        let some = !reach[i].is_nan();
        let low = ((middle - reach[i]) * frequency - fine[i]).ceil();
        let high = ((middle + reach[i]) * frequency - fine[i]).floor();
        phases.low[i] = if some { low } else { 0.0 };
        phases.high[i] = if some { high } else { -1.0 };
    }
}

/// χ² about one order at the best coordinate of every pixel; infinite outside of the range.
#[inline(always)]
fn misfits<const M: usize>(phases: &Phases, ratio: &[f32; MAX_OTHERS], order: f32, out: &mut Lane) {
    let explained: [f32; M] = std::array::from_fn(|j| ratio[j] * order);
    for i in 0..LANES {
        let (mut square, mut pull) = (0.0, 0.0);
        for j in 0..M {
            let off = wrap(phases.turns[j][i] - explained[j]);
            let weighted = phases.weight[j][i] * off;
            square += weighted * off;
            pull += ratio[j] * weighted;
        }
        let misfit = square - pull * pull * phases.per_total[i];
        let inside = (order >= phases.low[i]) & (order <= phases.high[i]);
        out[i] = if inside { misfit } else { f32::INFINITY };
    }
}

/// For `M` or fewer sets beside the finest: those that there are not have no weight.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn best<const M: usize>(phases: &Phases, field: &Field, except: &Lane) -> Lane {
    let (first, last) = phases.ends();
    let (mut misfit, mut least) = ([0.0; LANES], [f32::INFINITY; LANES]);
    for order in first..=last {
        let order = order as f32;
        misfits::<M>(phases, &field.other_ratio, order, &mut misfit);
        for i in 0..LANES {
            let better = (misfit[i] < least[i]) & (order != except[i]);
            least[i] = if better { misfit[i] } else { least[i] };
        }
    }
    least
}

/// For `M` or fewer sets beside the finest.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn vote<const M: usize>(phases: &Phases, field: &Field, memory: &mut Vec<Lane>, out: &mut Vote) {
    *out = Vote::default();
    let (first, last) = phases.ends();
    let count = (last - first + 1).max(0) as usize;
    if memory.len() < count {
        memory.resize(count, [0.0; LANES]);
    }
    let memory = &mut memory[..count];
    for (order, misfit) in (first..).zip(memory.iter_mut()) {
        let order = order as f32;
        misfits::<M>(phases, &field.other_ratio, order, misfit);
        for i in 0..LANES {
            let better = misfit[i] < out.misfit[i];
            out.misfit[i] = if better { misfit[i] } else { out.misfit[i] };
            out.order[i] = if better { order } else { out.order[i] };
        }
    }
    weigh_others(first, memory, out);
}

/// Set the posterior probabilities of all orders but the best, from the misfits of the orders on.
#[inline(always)]
fn weigh_others(first: i32, misfits: &[Lane], out: &mut Vote) {
    // Probabilities of the others over that of the best order.
    let mut total = [0.0; LANES];
    for (order, misfit) in (first..).zip(misfits) {
        let order = order as f32;
        let mut some = false;
        for i in 0..LANES {
            some |= (misfit[i] - out.misfit[i] < 2.0 * NEGLIGIBLE) & (order != out.order[i]);
        }
        if !some {
            continue;
        }
        for i in 0..LANES {
            let worse = 0.5 * (misfit[i] - out.misfit[i]);
            let counts = (worse < NEGLIGIBLE) & (order != out.order[i]);
            total[i] += if counts {
                power_of_two::<false>(-LOG2_E * worse)
            } else {
                0.0
            };
        }
    }
    for i in 0..LANES {
        let known = out.misfit[i] < f32::INFINITY;
        out.others[i] = if known {
            total[i] / (1.0 + total[i])
        } else {
            1.0
        };
    }
}

impl Field<'_> {
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

    /// Coordinate of a pixel of known order, px, and its σ; none where its sets disagree or where it lies
    /// outside the range.
    pub fn coordinate(&self, i: usize, order: i32) -> Option<(f32, f32)> {
        let (mut square, mut pull, mut total) = (0.0, 0.0, 0.0);
        for k in 0..self.sets {
            let weight = 1.0 / (self.variances[k][i] + self.sigma_floor[k]);
            let (f, ratio) = (
                self.frequency[k],
                self.frequency[k] / self.finest_frequency(),
            );
            let own = wrap(self.phases[k][i] / TAU - ratio * self.finest_turns(i));
            let off = wrap(own - ratio * order as f32);
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
