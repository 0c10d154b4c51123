//! Coordinate of a block of pixels: variance of every phase, the chain of roundings, the mean of the
//! sets, and whether it can be trusted.
//!
//! One loop does it all: it loads the phases, and stores results only. Its numbers of sets and
//! roundings are constants of the compilation, without which the compiler does not use vectors.

use super::shape::Shape;
use super::{Block, nearest};
use crate::Reason;
use crate::decode::BLOCK_PIXELS;
use std::f32::consts::TAU;

/// Phases of a pixel, and what is known of them.
struct Phases<const K: usize> {
    turns: [f32; K],
    /// 1/rad².
    precision: [f32; K],
    /// Without the floor, rad².
    variance: [f32; K],
    /// Whether all fringes are strong enough, and whether one of them is.
    strong: (bool, bool),
    background: f32,
}

/// Resolve a block whose sets are fitted.
///
/// `SINGLE`: combination k is the phase of set k alone, as in a hierarchy of periods. `CHECKED`: the
/// remainders that a rounding is judged by, one bit each: those of the combinations, then those of
/// the sets. `SHOT`, `START` and `RAISED`: what the plan needs, see [`super::shape::Needs`].
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2+fma"
))]
pub fn resolve<
    const K: usize,
    const R: usize,
    const SINGLE: bool,
    const CHECKED: u64,
    const SHOT: bool,
    const START: bool,
    const RAISED: bool,
>(
    shape: &Shape<K, R>,
    block: &mut Block,
) {
    // A copy: what might change in memory between two pixels keeps a loop from using vectors.
    let p = &{ *shape };
    for i in 0..BLOCK_PIXELS {
        let phases = phases::<K, R, SHOT, RAISED>(p, block, i);
        let start = if START {
            block.start[i]
        } else {
            p.range.middle
        };
        let (x, chained) = follow_chain::<K, R, SINGLE, CHECKED>(p, &phases, start);
        let (shift, inverse, disagreement, agreed) = average_sets::<K, R, CHECKED>(p, &phases, x);
        let (x, sigma, inside) = into_range(p, x + shift, inverse);
        let ok = chained & agreed & inside & (disagreement <= p.max_disagreement);
        if START {
            block.coarsest[i] = coarsest_variance(p, &phases);
        }
        let modulation = block.power[i].sqrt();
        let reason = reason_of(p, &phases, modulation, ok);
        block.reason[i] = reason;
        // The coordinate of every pixel is needed where its start is judged afterwards.
        let shown = (reason == Reason::Ok.lane()) | START;
        block.coordinate[i] = if shown { x } else { f32::NAN };
        block.sigma[i] = if shown { sigma } else { f32::NAN };
        block.background[i] = phases.background;
        block.modulation[i] = modulation;
        block.disagreement[i] = disagreement;
    }
}

#[inline(always)]
fn phases<const K: usize, const R: usize, const SHOT: bool, const RAISED: bool>(
    p: &Shape<K, R>,
    block: &Block,
    i: usize,
) -> Phases<K> {
    let zero = [0.0; K];
    let (mut turns, mut precision, mut variance) = (zero, zero, zero);
    let (mut all, mut any, mut background) = (true, false, 0.0);
    for k in 0..K {
        let set = &block.sets[k];
        let mut unit = set.precision[i];
        if RAISED {
            // Above what is usual, a factor counts for the roundings, too.
            let factor = (block.inflation[i] / p.usual_inflation).max(1.0);
            unit /= if unit > 0.0 { factor } else { 1.0 };
        }
        let per_noise = if SHOT {
            1.0 / (p.read_variance + p.gain * set.brightness[i].max(0.0))
        } else {
            p.per_read_noise
        };
        let fringes = unit * per_noise;
        // A table stretches the phase and its noise, but not the fringes.
        let q = fringes / if RAISED { set.stretch[i] } else { 1.0 };
        (precision[k], variance[k]) = precision_and_variance(q, p.order_variance);
        if RAISED {
            let usual = block.inflation[i].min(p.usual_inflation);
            precision[k] = raised(precision[k], p.floor[k], usual);
        }
        let strong = fringes >= p.min_precision[k];
        (all, any) = (all & strong, any | (strong & p.real[k]));
        turns[k] = set.turns[i];
        let share = p.share[k] * set.background[i];
        background = if k == 0 { share } else { background + share };
    }
    Phases {
        turns,
        precision,
        variance,
        strong: (all, any),
        background,
    }
}

/// Precision of a phase, 1/rad², and its variance, rad², from the precision that the measured
/// modulation gives.
///
/// 1/q underestimates the variance by about 1/q²: half because B comes from the same noisy samples,
/// half because the phase of a weak fringe is not Gaussian. Fringe orders are judged by a larger
/// variance, see `Chain::order_variance`.
#[inline(always)]
fn precision_and_variance(q: f32, [second, third]: [f32; 2]) -> (f32, f32) {
    let u = 1.0 / q;
    ((q - 1.0) + u, u * (1.0 + u * (second + third * u)))
}

/// Variance of a phase by noise, rad², from the precision that the measured modulation gives; infinite
/// where it is undetermined.
#[inline(always)]
pub fn variance(q: f32) -> f32 {
    let precision = (q - 1.0) + 1.0 / q;
    if q > 0.0 {
        1.0 / precision
    } else {
        f32::INFINITY
    }
}

/// Precision with a floor of the variance, rad², and a factor on it.
///
/// The roundings use neither. The floor is no noise: the caller lowers their margins by the errors
/// that the sets show, and by the factor that is usual in the scene.
#[inline(always)]
fn raised(precision: f32, floor: f32, usual: f32) -> f32 {
    let floored = precision / (1.0 + floor * precision);
    floored / if floored > 0.0 { usual } else { 1.0 }
}

/// v less the nearest whole number.
#[inline(always)]
fn wrap(v: f32) -> f32 {
    v - nearest(v)
}

/// Refine the coordinate by the chain, from coarse combinations to fine ones:
/// x ← x + wrap(c·t − g x) / g, with the combination c of the phases t and its frequency g.
#[inline(always)]
fn follow_chain<const K: usize, const R: usize, const SINGLE: bool, const CHECKED: u64>(
    p: &Shape<K, R>,
    phases: &Phases<K>,
    start: f32,
) -> (f32, bool) {
    let (mut x, mut safe) = (start, true);
    for r in 0..R {
        let phase = if SINGLE {
            phases.turns[r]
        } else {
            dot(&p.combinations[r], &phases.turns)
        };
        let off = wrap(phase - p.frequencies[r] * x);
        x += off * p.px[r];
        if CHECKED >> r & 1 > 0 {
            safe &= p.roundings[r].is_safe(&phases.variance, off);
        }
    }
    (x, safe)
}

/// The mean over all sets, weighted by inverse variance: its distance from the coordinate, its
/// variance, its χ², and whether the roundings are safe that the sets' remainders show.
#[inline(always)]
fn average_sets<const K: usize, const R: usize, const CHECKED: u64>(
    p: &Shape<K, R>,
    phases: &Phases<K>,
    x: f32,
) -> (f32, f32, f32, bool) {
    let (mut weight, mut pull, mut square, mut safe) = (0.0, 0.0, 0.0, true);
    for k in 0..K {
        let precision = phases.precision[k];
        let off = wrap(phases.turns[k] - p.frequency[k] * x);
        let weighted = precision * off;
        let [w, f] = p.weights[k];
        let terms = (w * precision, f * weighted, weighted * off);
        // Without adding the first terms to zeros.
        (weight, pull, square) = if k == 0 {
            terms
        } else {
            (weight + terms.0, pull + terms.1, square + terms.2)
        };
        if CHECKED >> (R + k) & 1 > 0 {
            safe &= p.set_roundings[k].is_safe(&phases.variance, off);
        }
    }
    let inverse = 1.0 / weight;
    let shift = pull * inverse;
    (shift, inverse, (TAU * TAU) * square - shift * pull, safe)
}

/// Σ a b, without adding the first term to a zero.
#[inline(always)]
pub fn dot<const K: usize>(a: &[f32; K], b: &[f32; K]) -> f32 {
    let mut sum = a[0] * b[0];
    for k in 1..K {
        sum += a[k] * b[k];
    }
    sum
}

/// The coordinate modulo the repeat distance, its σ, and whether it lies in the range.
#[inline(always)]
fn into_range<const K: usize, const R: usize>(
    p: &Shape<K, R>,
    x: f32,
    variance: f32,
) -> (f32, f32, bool) {
    let x = x - p.range.repeats * nearest((x - p.range.middle) * p.range.per_repeat);
    let sigma = variance.sqrt();
    let margin =
        (p.range.half + p.confidence * sigma).min(p.range.seam - p.order_confidence * sigma);
    let inside = ((x - p.range.middle).abs() <= margin) | p.range.circular;
    (x, sigma, inside)
}

/// Variance of the first combination of the chain, turns².
#[inline(always)]
fn coarsest_variance<const K: usize, const R: usize>(p: &Shape<K, R>, phases: &Phases<K>) -> f32 {
    let squares = p.combinations[0].map(|c| c * c);
    dot(&squares, &phases.variance) * (1.0 / (TAU * TAU))
}

#[inline(always)]
fn reason_of<const K: usize, const R: usize>(
    p: &Shape<K, R>,
    phases: &Phases<K>,
    modulation: f32,
    ok: bool,
) -> u32 {
    let choose = |yes: bool, a: Reason, b: Reason| if yes { a.lane() } else { b.lane() };
    let (all, any) = phases.strong;
    let faint = (modulation < p.min_modulation) | !all;
    let dark = choose(any, Reason::LowModulation, Reason::Shadow);
    let clear = choose(ok, Reason::Ok, Reason::OrderAmbiguous);
    let lit = if faint { dark } else { clear };
    if phases.background.is_finite() {
        lit
    } else {
        Reason::Masked.lane()
    }
}
