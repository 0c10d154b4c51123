//! What a plan knows before any pixel, laid out for the loop that resolves blocks.

use super::Block;
use super::resolve::{dot, resolve};
use crate::decode::{DecodeSettings, PhaseSet};
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
    /// Largest squared error, turns².
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
    /// distance between the remainder and that of the nearest other coordinate in the range, and within
    /// the margin of roundings that are not judged. `variance`: of the phases, rad².
    ///
    /// The first test uses what the pixel shows: the closer a remainder is to half a turn, or the
    /// first estimate to the place where it wraps, the smaller its error must be.
    #[inline(always)]
    pub fn is_safe(&self, variance: &[f32; K], remainder: f32) -> bool {
        let error = dot(&self.amplification, variance);
        let away = (self.alternative - remainder.abs()).max(0.0);
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
    fn new(plan: &DecodeSettings) -> Self {
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
    fn new(plan: &DecodeSettings) -> Self {
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
fn roundings<const K: usize, const R: usize>(
    plan: &DecodeSettings,
) -> ([Rounding<K>; R], [Rounding<K>; K]) {
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

/// The remainder of combination `k`, as a bit of the remainders that roundings are judged by.
const fn combination(k: usize) -> u64 {
    1 << k
}

/// The remainder of set `k`, as a bit behind those of so many combinations.
const fn set(k: usize, combinations: usize) -> u64 {
    1 << (combinations + k)
}

/// All remainders.
const EVERY: u64 = u64::MAX;

/// A hierarchy of three periods: the second rounding of its chain, and the set that is not in it.
const HIERARCHY_OF_THREE: u64 = combination(1) | set(2, 2);

/// A hierarchy of four periods: the roundings of its chain after the first, the coarsest set and the one
/// that is not in the chain.
const HIERARCHY_OF_FOUR: u64 = combination(1) | combination(2) | set(0, 3) | set(3, 3);

/// A chain of three similar periods: its second rounding, and those of all sets.
const SIMILAR: u64 = combination(1) | set(0, 4) | set(1, 4) | set(2, 4);

/// The remainders that judge the roundings of a plan, in a shape of so many combinations.
fn judged(plan: &DecodeSettings, combinations: usize) -> u64 {
    let known = plan.chain.frequencies.len();
    let bit = |&k: &usize| match k.checked_sub(known) {
        None => combination(k),
        Some(k) => set(k, combinations),
    };
    plan.chain.remainder.iter().map(bit).sum()
}

/// What a plan needs beyond phases and roundings.
#[derive(Clone, Copy)]
pub struct Needs {
    /// Shot noise.
    shot: bool,
    /// A start for every pixel, or open ends: what [`super::ends`] judges afterwards.
    start: bool,
    /// Variances beyond noise: floors and tables of the sets, or factors of the pixels.
    raised: bool,
}

impl Needs {
    const ALL: Self = Self {
        shot: true,
        start: true,
        raised: true,
    };

    /// `factors` says whether pixels have factors on their variances.
    fn of(plan: &DecodeSettings, factors: bool) -> Self {
        let open = plan.chain.circular && plan.chain.repeats.is_infinite();
        let beyond = |set: &PhaseSet| set.floor > 0.0 || !set.table.brightness.is_empty();
        Self {
            shot: plan.noise.gain > 0.0,
            start: plan.gray_code.is_some() || open,
            raised: factors || plan.sets.iter().any(beyond),
        }
    }
}

/// Refuse what no shape can hold.
pub fn check(plan: &DecodeSettings) -> Result<(), Error> {
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
fn is_single(plan: &DecodeSettings, k: usize, r: usize) -> bool {
    let unit = |(i, &c): (usize, &f32)| c == if i / k == i % k { 1.0 } else { 0.0 };
    plan.sets.len() == k
        && plan.chain.frequencies.len() == r
        && plan.chain.combinations.iter().enumerate().all(unit)
}

/// Resolve a block by a loop that does no more than a plan needs: there are eight.
fn for_each_need<const K: usize, const R: usize, const SINGLE: bool, const JUDGED: u64>(
    shape: &Shape<K, R>,
    needs: Needs,
    block: &mut Block,
) {
    match (needs.shot, needs.start, needs.raised) {
        (false, false, false) => resolve::<K, R, SINGLE, JUDGED, false, false, false>(shape, block),
        (false, false, true) => resolve::<K, R, SINGLE, JUDGED, false, false, true>(shape, block),
        (false, true, false) => resolve::<K, R, SINGLE, JUDGED, false, true, false>(shape, block),
        (false, true, true) => resolve::<K, R, SINGLE, JUDGED, false, true, true>(shape, block),
        (true, false, false) => resolve::<K, R, SINGLE, JUDGED, true, false, false>(shape, block),
        (true, false, true) => resolve::<K, R, SINGLE, JUDGED, true, false, true>(shape, block),
        (true, true, false) => resolve::<K, R, SINGLE, JUDGED, true, true, false>(shape, block),
        (true, true, true) => resolve::<K, R, SINGLE, JUDGED, true, true, true>(shape, block),
    }
}

/// Resolve a block by the loop for all needs, the only one of a rare shape.
fn for_all_needs<const K: usize, const R: usize, const SINGLE: bool, const JUDGED: u64>(
    shape: &Shape<K, R>,
    _: Needs,
    block: &mut Block,
) {
    resolve::<K, R, SINGLE, JUDGED, true, true, true>(shape, block);
}

/// The needs that the loop of a shape serves.
macro_rules! served {
    (for_each_need, $needs:ident) => {
        $needs
    };
    (for_all_needs, $needs:ident) => {
        Needs::ALL
    };
}

macro_rules! shapes {
    ($($name:ident {
        sets: $k:literal, combinations: $r:literal, single: $single:literal, judged: $judged:expr,
        compiled: $compiled:ident
    })+) => {
        /// A plan in one of the shapes that loops are compiled for.
        enum AnyShape {
            $($name(Box<Shape<$k, $r>>),)+
        }

        /// The loop that a plan is resolved by.
        pub struct Resolver {
            shape: AnyShape,
            needs: Needs,
        }

        impl Resolver {
            /// The first shape that holds a plan; `None` for too many sets.
            fn of(plan: &DecodeSettings, needs: Needs) -> Option<Self> {
                let (sets, n) = (plan.sets.len(), plan.chain.frequencies.len());
                $(
                    let holds = sets <= $k && n <= $r && judged(plan, $r) | $judged == $judged;
                    if holds && (!$single || is_single(plan, $k, $r)) {
                        let served = served!($compiled, needs);
                        let shape = AnyShape::$name(Box::new(Shape::new(plan)));
                        return Some(Self { shape, needs: served });
                    }
                )+
                None
            }

            /// Resolve a block whose sets are fitted.
            pub fn resolve(&self, block: &mut Block) {
                match &self.shape {
                    $(AnyShape::$name(shape) => {
                        $compiled::<$k, $r, $single, { $judged }>(shape, self.needs, block);
                    })+
                }
            }
        }
    };
}

shapes! {
    One { sets: 1, combinations: 1, single: true, judged: EVERY, compiled: for_each_need }
    Two { sets: 2, combinations: 1, single: false, judged: EVERY, compiled: for_each_need }
    Three {
        sets: 3, combinations: 2, single: true, judged: HIERARCHY_OF_THREE, compiled: for_each_need
    }
    Similar { sets: 3, combinations: 4, single: false, judged: SIMILAR, compiled: for_each_need }
    Four {
        sets: 4, combinations: 3, single: true, judged: HIERARCHY_OF_FOUR, compiled: for_each_need
    }
    TwoOfAny { sets: 2, combinations: 2, single: false, judged: EVERY, compiled: for_all_needs }
    ThreeOfAny { sets: 3, combinations: 5, single: false, judged: EVERY, compiled: for_all_needs }
    FourOfAny { sets: 4, combinations: 6, single: false, judged: EVERY, compiled: for_all_needs }
    EightOfAny { sets: 8, combinations: 12, single: false, judged: EVERY, compiled: for_all_needs }
    Any { sets: 16, combinations: 32, single: false, judged: EVERY, compiled: for_all_needs }
}

impl Resolver {
    /// For a checked plan; `factors` says whether pixels have factors on their variances.
    pub fn new(plan: &DecodeSettings, factors: bool) -> Self {
        Self::of(plan, Needs::of(plan, factors)).expect("a checked plan")
    }

    /// Whether blocks are resolved with a start for every pixel, and show all coordinates.
    pub fn shows_all(&self) -> bool {
        self.needs.start
    }
}
