//! Phase, modulation and background of one set of steps, by least squares at every pixel.

use super::{Lanes, Line, Plan, Sample, Source, Task, BLOCK, LANES};
use crate::{check_length, check_value, Error};
use std::ops::Range;

/// Entries of a table of phase errors.
pub const TABLE: usize = 256;
/// Least determinant of a fit from fewer samples than were taken, over that of equal steps.
const MIN_DETERMINANT: f64 = 0.02;
/// Precision of a phase that too few unsaturated samples are left for.
pub const UNDETERMINED: f32 = -1.0;

/// Frames I_n = A + B cos(φ − δ_n) of one period.
pub struct PhaseSet {
    /// Index of each frame.
    pub frames: Vec<usize>,
    /// 1 / period, turns per projector px.
    pub frequency: f32,
    /// Phase errors to take off.
    pub table: Table,
    cos: Vec<f32>,
    sin: Vec<f32>,
    full: Solver,
}

/// Phase errors of a response, turns, at the middles of equal bins from −½ on: one row of
/// [`TABLE`] for each level of brightness A + B (rising, counts); or empty.
#[derive(Clone, Default)]
pub struct Table {
    pub turns: Vec<f32>,
    pub brightness: Vec<f32>,
}

/// The inverse of the normal equations, and what it makes of noise.
#[derive(Clone)]
struct Solver {
    inverse: [[f32; 3]; 3],
    /// Off-diagonal terms vanish: equal steps over whole turns.
    balanced: bool,
    /// How the brightness that a phase's noise comes from differs from the mean: coefficients of
    /// c³, c²s, cs², s³ over B²; only three equal steps and unequal ones have any.
    skew: Option<[f32; 4]>,
}

impl PhaseSet {
    /// A set of steps δ_n in rad.
    pub fn new(frames: Vec<usize>, shifts: &[f64], period: f64) -> Result<Self, Error> {
        check_length("shifts", shifts.len(), frames.len())?;
        check_value(
            "steps",
            (3..=64).contains(&frames.len()),
            "3 to 64",
            frames.len(),
        )?;
        check_value("period", period > 0.0 && period.is_finite(), "> 0", period)?;
        let mask = u64::MAX >> (64 - frames.len());
        let full = Solver::full(shifts, mask).ok_or(Error::Value {
            name: "shifts",
            expected: "three or more that differ",
            got: format!("{shifts:?}"),
        })?;
        Ok(Self {
            frames,
            frequency: (1.0 / period) as f32,
            table: Table::default(),
            cos: shifts.iter().map(|d| d.cos() as f32).collect(),
            sin: shifts.iter().map(|d| d.sin() as f32).collect(),
            full,
        })
    }

    pub(super) fn check(&self, frames: usize) -> Result<(), Error> {
        let inside = self.frames.iter().all(|&k| k < frames);
        check_value("frames of a set", inside, "frames that exist", &self.frames)?;
        let levels = self.table.brightness.len();
        check_length("table", self.table.turns.len(), levels * TABLE)
    }

    pub fn steps(&self) -> usize {
        self.frames.len()
    }

    pub(super) fn phasor(&self, n: usize) -> (f32, f32) {
        (self.cos[n], self.sin[n])
    }
}

/// Inverse of the symmetric matrix Σ (1, cos, sin)ᵀ(1, cos, sin) over the kept frames.
fn inverse(kept: u64, cos: impl Fn(usize) -> f64, sin: impl Fn(usize) -> f64) -> Option<Inverse> {
    let mut g = [[0.0f64; 3]; 3];
    for n in (0..64).filter(|n| kept >> n & 1 == 1) {
        let row = [1.0, cos(n), sin(n)];
        for i in 0..3 {
            for j in 0..3 {
                g[i][j] += row[i] * row[j];
            }
        }
    }
    let minor = |i: usize, j: usize| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        g[a][c] * g[b][d] - g[a][d] * g[b][c]
    };
    let determinant = (0..3).map(|j| g[0][j] * minor(0, j)).sum::<f64>();
    // Equal steps have N · N/2 · N/2.
    let equal = g[0][0].powi(3) / 4.0;
    if determinant <= MIN_DETERMINANT * equal {
        return None;
    }
    let mut out = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = minor(j, i) / determinant;
        }
    }
    Some(out)
}
type Inverse = [[f64; 3]; 3];

impl Solver {
    fn full(shifts: &[f64], mask: u64) -> Option<Self> {
        let inverse = inverse(mask, |n| shifts[n].cos(), |n| shifts[n].sin())?;
        let largest = inverse[0][1]
            .abs()
            .max(inverse[0][2].abs())
            .max(inverse[1][2].abs());
        let balanced = largest < 1e-9 && (inverse[1][1] - inverse[2][2]).abs() < 1e-9;
        // Weights that give c and s from the samples, and the fitted samples from c and s: the
        // variance that a count's worth of brightness puts on the phase is cubic in c and s.
        let (mut skew, mut level) = ([0.0f64; 4], [0.0f64; 3]);
        for shift in shifts {
            let (k, q) = (shift.cos(), shift.sin());
            let wc = inverse[1][0] + inverse[1][1] * k + inverse[1][2] * q;
            let ws = inverse[2][0] + inverse[2][1] * k + inverse[2][2] * q;
            let square = [ws * ws, -2.0 * ws * wc, wc * wc];
            for i in 0..3 {
                level[i] += square[i];
                skew[i] += square[i] * k;
                skew[i + 1] += square[i] * q;
            }
        }
        let scale = 0.5 * (level[0] + level[2]);
        let skew = skew.map(|v| (v / scale) as f32);
        Some(Self {
            inverse: inverse.map(|row| row.map(|v| v as f32)),
            balanced,
            skew: skew.iter().any(|v| v.abs() > 1e-6).then_some(skew),
        })
    }
}

/// Σ I, Σ I cos δ, Σ I sin δ of a few pixels.
#[derive(Clone, Copy)]
pub struct Sums {
    pub plain: Lanes,
    pub cos: Lanes,
    pub sin: Lanes,
}

impl Sums {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            plain: [0.0; LANES],
            cos: [0.0; LANES],
            sin: [0.0; LANES],
        }
    }
}

/// Samples of a few pixels at the sensor's limit: how many, Σ cos δ and Σ sin δ over them.
#[derive(Clone, Copy)]
pub struct LeftOut {
    pub count: Lanes,
    pub cos: Lanes,
    pub sin: Lanes,
}

impl LeftOut {
    #[inline(always)]
    pub fn nothing() -> Self {
        Self {
            count: [0.0; LANES],
            cos: [0.0; LANES],
            sin: [0.0; LANES],
        }
    }
}

/// What one set says about the pixels of a block.
pub struct Fitted {
    /// Wrapped phase, turns, −½ … ½; NaN where the samples do not determine it.
    pub turns: Line,
    /// Inverse variance of the phase, 1/rad², for noise of one count².
    pub precision: Line,
    /// Brightness at which the noise is to be taken, counts.
    pub level: Line,
    /// A, counts.
    pub background: Line,
    /// B², counts².
    pub power: Line,
}

impl Fitted {
    pub fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            turns: zero,
            precision: zero,
            level: zero,
            background: zero,
            power: zero,
        }
    }
}

pub struct Frames<'a, T> {
    pub planes: &'a [&'a [T]],
}

impl<T: Sample> Source for Frames<'_, T> {
    type Sample = T;

    fn run(task: Task<'_, Self>) {
        T::frames(task);
    }

    #[inline(always)]
    fn sums(&self, _: usize, set: &PhaseSet, at: usize, limit: f32) -> (Sums, bool) {
        let mut out = Sums::zero();
        let mut brightest = [T::default(); LANES];
        for (k, &frame) in set.frames.iter().enumerate() {
            let (c, s) = set.phasor(k);
            let counts = lanes(self.planes[frame], at);
            for i in 0..LANES {
                let v = counts[i].value();
                out.plain[i] += v;
                out.cos[i] += v * c;
                out.sin[i] += v * s;
            }
            for i in 0..LANES {
                brightest[i] = brightest[i].larger(counts[i]);
            }
        }
        let mut above = 0;
        for v in brightest {
            above |= u32::from(v.value() >= limit);
        }
        (out, above > 0)
    }

    #[inline(always)]
    fn sums_below(&self, _: usize, set: &PhaseSet, at: usize, limit: f32) -> (Sums, LeftOut) {
        let (mut out, mut left_out) = (Sums::zero(), LeftOut::nothing());
        for (k, &frame) in set.frames.iter().enumerate() {
            let (c, s) = set.phasor(k);
            let counts = lanes(self.planes[frame], at);
            let (mut below, mut above) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                // NaN is kept: it shall show.
                let v = counts[i].value();
                above[i] = if v >= limit { 1.0 } else { 0.0 };
                below[i] = if v >= limit { 0.0 } else { v };
            }
            // Sums apart from choices: the compiler would make them conditional stores.
            for i in 0..LANES {
                out.plain[i] += below[i];
                out.cos[i] += below[i] * c;
                out.sin[i] += below[i] * s;
                left_out.count[i] += above[i];
                left_out.cos[i] += above[i] * c;
                left_out.sin[i] += above[i] * s;
            }
        }
        (out, left_out)
    }

    fn kept(&self, _: usize, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]) {
        let (mut kept, mut sums) = (0, [0.0f32; 3]);
        for (k, &frame) in set.frames.iter().enumerate() {
            let value = self.planes[frame][pixel].value();
            // NaN is kept: it shall show.
            let above = value >= limit;
            if !above {
                let (c, s) = set.phasor(k);
                kept |= 1 << k;
                sums = [sums[0] + value, sums[1] + value * c, sums[2] + value * s];
            }
        }
        (kept, sums)
    }

    fn plane(&self, frame: usize) -> &[T] {
        self.planes[frame]
    }
}

/// A few pixels of a plane; zeros beyond its end.
#[inline(always)]
pub fn lanes<T: Copy + Default>(plane: &[T], at: usize) -> [T; LANES] {
    match plane[at..].first_chunk::<LANES>() {
        Some(whole) => *whole,
        None => {
            let mut out = [T::default(); LANES];
            out[..plane.len() - at].copy_from_slice(&plane[at..]);
            out
        }
    }
}

/// From sums to phase and its precision; samples at the sensor's limit are left out of the fit.
#[inline(always)]
pub fn fit<S: Source>(source: &S, plan: &Plan, index: usize, at: Range<usize>, out: &mut Fitted) {
    let (set, limit) = (&plan.sets[index], plan.limits.saturation);
    // Where one few pixels hold a sample at the limit, the next are likely to as well.
    let (mut several, mut expected) = (false, false);
    for (k, start) in at.clone().step_by(LANES).enumerate() {
        let plain = if expected {
            None
        } else {
            Some(source.sums(index, set, start, limit))
        };
        if let Some((sums, false)) = plain {
            let amplitudes = solve(set, &sums);
            let precision = precision(set, &amplitudes);
            store(set, &amplitudes, &precision, k * LANES, out);
        } else {
            let (sums, left_out) = source.sums_below(index, set, start, limit);
            let (some, more) = fit_without(set, sums, &left_out, k * LANES, out);
            (expected, several) = (some, several || more);
        }
    }
    if several {
        refit(source, plan, index, at, out);
    }
    if !set.table.brightness.is_empty() {
        correct(&set.table, out);
    }
}

/// Background, c and s of I = A + c cos δ + s sin δ.
#[inline(always)]
fn solve(set: &PhaseSet, sums: &Sums) -> Sums {
    let m = &set.full.inverse;
    let mut out = *sums;
    if set.full.balanced {
        for i in 0..LANES {
            out.plain[i] *= m[0][0];
            out.cos[i] *= m[1][1];
            out.sin[i] *= m[1][1];
        }
    } else {
        for i in 0..LANES {
            let (p, q, r) = (sums.plain[i], sums.cos[i], sums.sin[i]);
            let row = |row: &[f32; 3]| row[0] * p + row[1] * q + row[2] * r;
            (out.plain[i], out.cos[i], out.sin[i]) = (row(&m[0]), row(&m[1]), row(&m[2]));
        }
    }
    out
}

/// Inverse variance of the phase where all samples count.
#[inline(always)]
fn precision(set: &PhaseSet, Sums { cos, sin, .. }: &Sums) -> Lanes {
    let m = &set.full.inverse;
    let mut out = [0.0; LANES];
    if set.full.balanced {
        for i in 0..LANES {
            out[i] = (cos[i] * cos[i] + sin[i] * sin[i]) * (1.0 / m[1][1]);
        }
    } else {
        for i in 0..LANES {
            let (c, s) = (cos[i], sin[i]);
            let (cc, ss, power) = (c * c, s * s, c * c + s * s);
            let spread = m[2][2] * cc + m[1][1] * ss - 2.0 * m[1][2] * (c * s);
            out[i] = power * power / spread;
        }
    }
    out
}

/// The fit without the sample at the limit, where there is one at most. Says whether there were any,
/// and whether some pixel has to be fitted by itself.
///
/// Equal steps have the leverage 3/N each, so that leaving one out of N is a short update: its
/// residual r shifts the amplitudes by r / (N − 3) times (1, 2 cos δ, 2 sin δ).
#[inline(always)]
fn fit_without(
    set: &PhaseSet,
    sums: Sums,
    left_out: &LeftOut,
    start: usize,
    out: &mut Fitted,
) -> (bool, bool) {
    let mut fitted = solve(set, &sums);
    let mut precision = precision(set, &fitted);
    let n = set.steps() as f32;
    let simple = set.full.balanced && set.steps() > 3;
    if simple {
        let (leverage, share) = (1.0 / (n - 3.0), 4.0 / (n * (n - 3.0)));
        for i in 0..LANES {
            let (k, q) = (left_out.cos[i], left_out.sin[i]);
            let (a, c, s) = (fitted.plain[i], fitted.cos[i], fitted.sin[i]);
            // The sample stands in the sums as zero.
            let shift = left_out.count[i] * leverage * (a + c * k + s * q);
            let (a, c, s) = (a + shift, c + 2.0 * k * shift, s + 2.0 * q * shift);
            (fitted.plain[i], fitted.cos[i], fitted.sin[i]) = (a, c, s);
            let power = c * c + s * s;
            let across = c * q - s * k;
            precision[i] = power * power / (2.0 / n * power + share * (across * across));
        }
    }
    store(set, &fitted, &precision, start, out);
    let alone = if simple { 1.0 } else { 0.0 };
    let (mut some, mut more) = (0, 0);
    for i in 0..LANES {
        some |= u32::from(left_out.count[i] > 0.0);
        more |= u32::from(left_out.count[i] > alone);
    }
    (some > 0, more > 0)
}

/// What the amplitudes say, into the arrays of the block.
#[inline(always)]
fn store(set: &PhaseSet, fitted: &Sums, precision: &Lanes, start: usize, out: &mut Fitted) {
    let (cos, sin) = (&fitted.cos, &fitted.sin);
    let (mut power, mut turns, mut level) = ([0.0; LANES], [0.0; LANES], fitted.plain);
    for i in 0..LANES {
        power[i] = cos[i] * cos[i] + sin[i] * sin[i];
        turns[i] = angle(sin[i], cos[i]);
    }
    if let Some(skew) = &set.full.skew {
        for i in 0..LANES {
            let (c, s) = (cos[i], sin[i]);
            let cubic = c * c * (skew[0] * c + skew[1] * s) + s * s * (skew[2] * c + skew[3] * s);
            level[i] += cubic / power[i];
        }
    }
    let place = start..start + LANES;
    out.turns[place.clone()].copy_from_slice(&turns);
    out.precision[place.clone()].copy_from_slice(precision);
    out.power[place.clone()].copy_from_slice(&power);
    out.background[place.clone()].copy_from_slice(&fitted.plain);
    out.level[place].copy_from_slice(&level);
}

/// Pixels of a block with samples at the sensor's limit, one by one.
#[cold]
fn refit<S: Source>(source: &S, plan: &Plan, index: usize, at: Range<usize>, out: &mut Fitted) {
    let (set, limit) = (&plan.sets[index], plan.limits.saturation);
    let all = u64::MAX >> (64 - set.steps());
    for (i, pixel) in at.enumerate() {
        let (kept, sums) = source.kept(index, set, pixel, limit);
        let few = set.full.balanced && set.steps() > 3 && (all ^ kept).count_ones() <= 1;
        if kept == all || few {
            continue;
        }
        let (cos, sin) = (|n: usize| set.cos[n].into(), |n: usize| set.sin[n].into());
        let found = if kept.count_ones() >= 3 {
            inverse(kept, cos, sin)
        } else {
            None
        };
        let Some(m) = found else {
            out.precision[i] = UNDETERMINED;
            (out.turns[i], out.power[i]) = (f32::NAN, f32::NAN);
            (out.background[i], out.level[i]) = (f32::NAN, f32::NAN);
            continue;
        };
        let solve = |row: &[f64; 3]| (0..3).map(|j| row[j] * f64::from(sums[j])).sum::<f64>();
        let (a, c, s) = (solve(&m[0]), solve(&m[1]), solve(&m[2]));
        let power = c * c + s * s;
        let spread = m[2][2] * c * c + m[1][1] * s * s - 2.0 * m[1][2] * c * s;
        out.turns[i] = angle(s as f32, c as f32);
        out.precision[i] = (power * power / spread) as f32;
        out.power[i] = power as f32;
        (out.background[i], out.level[i]) = (a as f32, a as f32);
    }
}

/// Take the table's error off, by linear interpolation in phase and brightness.
#[inline(always)]
fn correct(table: &Table, out: &mut Fitted) {
    let levels = &table.brightness;
    for i in 0..BLOCK {
        let t = out.turns[i];
        if t.is_nan() {
            continue;
        }
        let brightness = out.background[i] + out.power[i].sqrt();
        let above = levels
            .iter()
            .take_while(|&&level| level < brightness)
            .count();
        let (low, high) = (above.saturating_sub(1), above.min(levels.len() - 1));
        let width = levels[high] - levels[low];
        let part = if width > 0.0 {
            (brightness - levels[low]) / width
        } else {
            0.0
        };
        let at = (t + 0.5) * TABLE as f32 - 0.5;
        let left = at.floor();
        let share = at - left;
        let k = (left as i32).rem_euclid(TABLE as i32) as usize;
        let row = |level: usize| {
            let row = &table.turns[level * TABLE..(level + 1) * TABLE];
            row[k] + share * (row[(k + 1) % TABLE] - row[k])
        };
        let (a, b) = (row(low), row(high));
        out.turns[i] = t - (a + part * (b - a));
    }
}

/// atan2(s, c) in turns, −½ … ½, to 1e-7 turns (6e-7 rad); 0 for s = c = 0.
///
/// An odd polynomial of degree 13 for atan on 0 … 1, fitted to the least largest error.
#[inline(always)]
pub fn angle(s: f32, c: f32) -> f32 {
    const ATAN: [f32; 7] = [
        0.159_154_32,
        -0.053_026_237,
        0.031_525_116,
        -0.021_061_512,
        0.012_672_49,
        -0.005_348_268_3,
        0.001_084_127_7,
    ];
    let (x, y) = (c.abs(), s.abs());
    let (large, small) = (x.max(y), x.min(y));
    let z = small / large.max(f32::MIN_POSITIVE);
    let q = z * z;
    let mut r = ATAN[6];
    for k in (0..6).rev() {
        r = r * q + ATAN[k];
    }
    r *= z;
    r = if y > x { 0.25 - r } else { r };
    r = if c < 0.0 { 0.5 - r } else { r };
    if s < 0.0 {
        -r
    } else {
        r
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn angle_is_exact_to_a_millionth() {
        let mut worst = 0.0f64;
        for k in -200_000..=200_000 {
            let phi = f64::from(k) * (TAU / 400_000.0);
            let (s, c) = ((37.5 * phi.sin()) as f32, (37.5 * phi.cos()) as f32);
            let exact = f64::from(s).atan2(f64::from(c));
            let off = f64::from(angle(s, c)) * TAU - exact;
            worst = worst.max((off - TAU * (off / TAU).round()).abs());
        }
        assert!(worst < 1e-6, "{worst}");
        assert_eq!(angle(0.0, 0.0), 0.0);
        assert!(angle(f32::NAN, 1.0).is_nan() || angle(f32::NAN, f32::NAN).is_nan());
    }

    #[test]
    fn three_equal_shifts_are_refused() {
        assert!(PhaseSet::new(vec![0, 1, 2], &[0.0, TAU, 2.0 * TAU], 10.0).is_err());
        assert!(PhaseSet::new(vec![0, 1], &[0.0, 1.0], 10.0).is_err());
    }
}
