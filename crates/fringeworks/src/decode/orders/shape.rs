//! What a plan knows before any pixel, laid out for the loop that resolves blocks.

use super::Block;
use super::resolve::{RAISED, SHOT, START, dot, resolve};
use crate::decode::Plan;
use crate::{Error, check_value};
use std::f32::consts::TAU;

/// Largest number of sets along an axis. More periods do not help a fringe order.
pub const MAX_SETS: usize = 16;

/// Largest number of combinations of a chain: some two for each set.
pub const MAX_COMBINATIONS: usize = 32;

/// A rounding that is judged by its remainder.
#[derive(Clone, Copy)]
pub struct Rounding<const K: usize> {
    /// Squared amplification of the phase errors times the squared confidence, turns²/rad².
    amplification: [f32; K],
    /// Squared margin, turns².
    margin: f32,
    /// Distance to the remainder of the nearest other coordinate in the range, turns.
    alternative: f32,
}

impl<const K: usize> Rounding<K> {
    /// Noise never spoils it.
    const ALWAYS_SAFE: Self = Self {
        amplification: [0.0; K],
        margin: f32::INFINITY,
        alternative: f32::INFINITY,
    };

    /// Whether the error, as many standard deviations as decisions must be safe by, stays within the
    /// margin, and within the distance between the remainder and that of the nearest other coordinate
    /// in the range. `variance`: of the phases, rad².
    ///
    /// The second test uses what the pixel shows: the closer a remainder is to half a turn, or the
    /// first estimate to the place where it wraps, the smaller its error must be.
    #[inline(always)]
    pub fn is_safe(&self, variance: &[f32; K], remainder: f32) -> bool {
        let error = dot(&self.amplification, variance);
        let away = self.alternative - remainder.abs();
        (error <= self.margin) & (error <= away * away)
    }
}

/// The range that coordinates lie in.
#[derive(Clone, Copy)]
pub struct Range {
    /// Its middle, and half its length, px.
    pub middle: f32,
    pub half: f32,
    /// Repeat distance, px, and its inverse; both 0 where coordinates are not brought into a range.
    pub repeats: f32,
    pub per_repeat: f32,
    /// Distance of the place where coordinates repeat from the middle, px.
    pub seam: f32,
    /// Whether its ends are the same place.
    pub circular: bool,
}

impl Range {
    fn new(plan: &Plan) -> Self {
        let chain = &plan.chain;
        let periodic = chain.repeats.is_finite() && plan.gray_code.is_none();
        let unless_open = |value: f32, open: f32| if periodic { value } else { open };
        Self {
            middle: chain.middle,
            half: chain.half,
            repeats: unless_open(chain.repeats, 0.0),
            per_repeat: unless_open(1.0 / chain.repeats, 0.0),
            seam: unless_open(0.5 * chain.repeats, f32::INFINITY),
            circular: chain.circular,
        }
    }
}

/// A plan of up to `K` sets and `R` combinations. Sets and combinations that it does not have change
/// nothing.
#[derive(Clone, Copy)]
pub struct Shape<const K: usize, const R: usize> {
    /// Whether the plan has a set.
    pub real: [bool; K],
    /// 1 / period, turns per px.
    pub frequency: [f32; K],
    /// Share of a set in the background.
    pub share: [f32; K],
    /// Variance that does not shrink with the modulation, rad².
    pub floor: [f32; K],
    /// Weights of a precision in 1/rad² in the mean coordinate and in its shift, rad²/px² and rad²/px.
    pub weights: [[f32; 2]; K],
    pub combinations: [[f32; K]; R],
    /// Of the combinations, turns per px, and their inverses.
    pub frequencies: [f32; R],
    pub px: [f32; R],
    /// Judged by the remainders of the combinations, and by those of the sets.
    pub roundings: [Rounding<K>; R],
    pub set_roundings: [Rounding<K>; K],
    pub order_variance: [f32; 2],
    /// Counts², its inverse, and counts.
    pub read_variance: f32,
    pub per_read_noise: f32,
    pub gain: f32,
    /// Least precision of a fringe, 1/rad²; none for sets that the plan does not have.
    pub min_precision: [f32; K],
    pub min_modulation: f32,
    pub max_disagreement: f32,
    pub usual_inflation: f32,
    pub confidence: f32,
    pub order_confidence: f32,
    pub range: Range,
}

impl<const K: usize, const R: usize> Shape<K, R> {
    fn new(plan: &Plan) -> Self {
        let (chain, limits, sets) = (&plan.chain, &plan.limits, plan.sets.len());
        let total: usize = plan.sets.iter().map(|set| set.steps()).sum();
        let of_sets = |other: f32, f: &dyn Fn(usize) -> f32| {
            std::array::from_fn(|k| if k < sets { f(k) } else { other })
        };
        let frequency: [f32; K] = of_sets(0.0, &|k| plan.sets[k].frequency);
        let known = |r: usize| chain.frequencies.get(r);
        let (roundings, set_roundings) = roundings(plan);
        Self {
            real: std::array::from_fn(|k| k < sets),
            frequency,
            share: of_sets(0.0, &|k| plan.sets[k].steps() as f32 / total as f32),
            floor: of_sets(0.0, &|k| plan.sets[k].floor),
            weights: frequency.map(|f| [f * f * (TAU * TAU), f * (TAU * TAU)]),
            combinations: std::array::from_fn(|r| row(&chain.combinations, r, sets)),
            // A combination that the plan does not have moves no coordinate.
            frequencies: std::array::from_fn(|r| *known(r).unwrap_or(&1.0)),
            px: std::array::from_fn(|r| known(r).map_or(0.0, |g| 1.0 / g)),
            roundings,
            set_roundings,
            order_variance: chain.order_variance,
            read_variance: plan.noise.read_variance,
            per_read_noise: 1.0 / plan.noise.read_variance,
            gain: plan.noise.gain,
            min_precision: of_sets(f32::NEG_INFINITY, &|_| limits.min_snr * limits.min_snr),
            min_modulation: limits.min_modulation,
            max_disagreement: limits.max_disagreement,
            usual_inflation: limits.usual_inflation,
            confidence: limits.confidence,
            order_confidence: limits.order_confidence,
            range: Range::new(plan),
        }
    }
}

/// A row of a matrix over the sets; zeros beyond its end.
fn row<const K: usize>(matrix: &[f32], r: usize, sets: usize) -> [f32; K] {
    std::array::from_fn(|k| {
        let inside = k < sets;
        matrix
            .get(r * sets + k)
            .copied()
            .filter(|_| inside)
            .unwrap_or(0.0)
    })
}

/// The roundings of a plan at the remainders that judge them.
fn roundings<const K: usize, const R: usize>(plan: &Plan) -> ([Rounding<K>; R], [Rounding<K>; K]) {
    let (chain, sets) = (&plan.chain, plan.sets.len());
    // Both tests compare squares of as many standard deviations as decisions must be safe by.
    let squared = plan.limits.order_confidence * plan.limits.order_confidence;
    let mut of_chain = [Rounding::ALWAYS_SAFE; R];
    let mut of_sets = [Rounding::ALWAYS_SAFE; K];
    for (k, &remainder) in chain.remainder.iter().enumerate() {
        let row: [f32; K] = row(&chain.amplification, k, sets);
        let rounding = Rounding {
            amplification: row.map(|v| v * (squared / (TAU * TAU))),
            margin: chain.margin[k] * squared,
            alternative: chain.alternative[k],
        };
        match remainder.checked_sub(chain.frequencies.len()) {
            None => of_chain[remainder] = rounding,
            Some(set) => of_sets[set] = rounding,
        }
    }
    (of_chain, of_sets)
}

/// Bits of the remainders that judge a rounding, in a shape of `R` combinations.
fn checked(plan: &Plan, combinations: usize) -> u64 {
    let known = plan.chain.frequencies.len();
    let place = |&k: &usize| {
        if k < known {
            k
        } else {
            k - known + combinations
        }
    };
    plan.chain.remainder.iter().map(|k| 1 << place(k)).sum()
}

/// What a plan needs beyond phases and roundings; `factors` says whether pixels have some.
fn needs(plan: &Plan, factors: bool) -> u8 {
    let open = plan.chain.circular && plan.chain.repeats.is_infinite();
    let raised = factors || plan.sets.iter().any(|set| set.floor > 0.0);
    let bit = |wanted: bool, bit: u8| if wanted { bit } else { 0 };
    bit(plan.noise.gain > 0.0, SHOT)
        | bit(plan.gray_code.is_some() || open, START)
        | bit(raised, RAISED)
}

/// Refuse what no shape can hold.
pub fn check(plan: &Plan) -> Result<(), Error> {
    let (sets, n) = (plan.sets.len(), plan.chain.frequencies.len());
    check_value("sets", sets <= MAX_SETS, "16 or fewer", sets)?;
    check_value("combinations", n <= MAX_COMBINATIONS, "32 or fewer", n)?;
    let mut remainders = plan.chain.remainder.clone();
    remainders.sort_unstable();
    remainders.dedup();
    let once = remainders.len() == plan.chain.remainder.len();
    check_value(
        "remainder",
        once,
        "one for each rounding",
        &plan.chain.remainder,
    )
}

/// Whether a plan has exactly `k` sets, and `r` combinations that are each the phase of one set.
fn is_single(plan: &Plan, k: usize, r: usize) -> bool {
    let unit = |(i, &c): (usize, &f32)| c == if i / k == i % k { 1.0 } else { 0.0 };
    plan.sets.len() == k
        && plan.chain.frequencies.len() == r
        && plan.chain.combinations.iter().enumerate().all(unit)
}

/// All remainders.
const EVERY: u64 = u64::MAX;

macro_rules! shapes {
    ($($name:ident($k:literal, $r:literal, $single:literal, $checked:expr): [$($needs:literal),+];)+) => {
        /// The loop that a plan is resolved by.
        pub enum Resolver {
            $($name(Box<Shape<$k, $r>>, u8),)+
        }

        impl Resolver {
            /// The first loop that does all that a plan needs; `None` for too many sets.
            fn of(plan: &Plan, needed: u8) -> Option<Self> {
                let (sets, n) = (plan.sets.len(), plan.chain.frequencies.len());
                $(
                    let done = [$($needs),+].into_iter().find(|done| needed & !done == 0);
                    let holds = sets <= $k && n <= $r && checked(plan, $r) | $checked == $checked;
                    if holds && (!$single || is_single(plan, $k, $r)) {
                        if let Some(done) = done {
                            return Some(Self::$name(Box::new(Shape::new(plan)), done));
                        }
                    }
                )+
                None
            }

            /// Whether blocks are resolved with `START`.
            pub fn shows_all(&self) -> bool {
                match self {
                    $(Self::$name(_, needs) => needs & START > 0,)+
                }
            }

            /// Resolve a block whose sets are fitted.
            pub fn resolve(&self, block: &mut Block) {
                match self {
                    $($(
                        Self::$name(shape, $needs) => {
                            resolve::<$k, $r, $single, { $checked }, $needs>(shape, block);
                        }
                    )+)+
                    _ => {}
                }
            }
        }
    };
}

// What a plan needs is SHOT + START + RAISED. Hierarchies of three and four periods, and a chain of
// three similar ones, are judged by some of the remainders.
shapes! {
    One(1, 1, true, EVERY): [0, 1, 2, 3, 4, 5, 6, 7];
    Two(2, 1, false, EVERY): [0, 1, 2, 3, 4, 5, 6, 7];
    Three(3, 2, true, 0b1_0010): [0, 1, 2, 3, 4, 5, 6, 7];
    Similar(3, 4, false, 0b111_0010): [0, 1, 2, 3, 4, 5, 6, 7];
    Four(4, 3, true, 0b100_1110): [0, 1, 2, 3, 4, 5, 6, 7];
    TwoOfAny(2, 2, false, EVERY): [7];
    ThreeOfAny(3, 5, false, EVERY): [7];
    FourOfAny(4, 6, false, EVERY): [7];
    EightOfAny(8, 12, false, EVERY): [7];
    Any(16, 32, false, EVERY): [7];
}

impl Resolver {
    /// For a checked plan; `factors` says whether pixels have factors on their variances.
    pub fn new(plan: &Plan, factors: bool) -> Self {
        Self::of(plan, needs(plan, factors)).expect("a checked plan")
    }
}
