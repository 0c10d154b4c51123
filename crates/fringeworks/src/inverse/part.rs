//! The inverse function x(I) of one monotone part of the reference row.

use super::extrema::Extremum;
use super::polynomial::Polynomial;
use super::{Method, Options};
use crate::spline::{Knots, Place, RowSpline, Spline};

/// Distance from a turning point, px, below which a sample is not used.
///
/// It repeats the turning point: it adds no information, and an inverse spline through both would be
/// nearly vertical between them. An empirical choice.
const MIN_SPACING: f64 = 0.02;

/// Least number of samples for a polynomial: a parabola, or a line with one residual.
const MIN_POLYNOMIAL_POINTS: usize = 3;

/// Largest number of steps of the root search. Bisection alone halves the bracket of about one pixel
/// to below [`ROOT_TOLERANCE`] in 40.
const MAX_ROOT_STEPS: usize = 60;

/// Change of the position at which the root search ends, px: far below any other error.
const ROOT_TOLERANCE: f64 = 1e-11;

/// A monotone part of the reference row, from one turning point (or end of the row) to the next.
#[derive(Clone, Copy)]
pub struct Span {
    pub from: f64,
    pub to: f64,
    pub value_from: f64,
    pub value_to: f64,
}

impl Span {
    pub fn rising(&self) -> bool {
        self.value_to > self.value_from
    }
}

/// The parts of a row: its ends and extrema are the boundaries.
pub fn spans(row: &RowSpline, extrema: &[Extremum]) -> Vec<Span> {
    let end = (row.y.len() - 1) as f64;
    let mut bounds = vec![(0.0, row.y[0])];
    bounds.extend(extrema.iter().map(|e| (e.position, e.value)));
    bounds.push((end, row.y[row.y.len() - 1]));
    bounds
        .windows(2)
        .map(|w| Span {
            from: w[0].0,
            to: w[1].0,
            value_from: w[0].1,
            value_to: w[1].1,
        })
        .collect()
}

/// The inverse function x(I) of one part.
// A row has a handful of these, so the size of the largest variant does not matter.
#[allow(clippy::large_enum_variant)]
pub enum Inverse {
    Polynomial(Polynomial),
    Spline(Spline),
    /// Roots of the row's global spline between these samples (position, intensity).
    Exact(Vec<(f64, f64)>),
    /// Straight lines between pooled samples, where noise broke their order.
    Pooled(Vec<(f64, f64)>),
}

/// An inverse, or the knots of the spline that it will be.
enum Draft {
    Ready(Inverse),
    Through(Knots),
}

impl Inverse {
    /// The inverses of the spans that are `wanted`; `None` for the others, and where a part is too short
    /// to be inverted.
    pub fn build_all(
        row: &RowSpline,
        spans: &[Span],
        wanted: &[bool],
        options: &Options,
    ) -> Vec<Option<Self>> {
        let mut inverses: Vec<Option<Self>> = Vec::with_capacity(spans.len());
        let (mut places, mut through) = (Vec::new(), Vec::new());
        for (k, (span, wanted)) in spans.iter().zip(wanted).enumerate() {
            let draft = wanted.then(|| draft(row, span, options)).flatten();
            inverses.push(match draft {
                Some(Draft::Ready(inverse)) => Some(inverse),
                Some(Draft::Through(knots)) => {
                    places.push(k);
                    through.push(knots);
                    None
                }
                None => None,
            });
        }
        for (k, spline) in places.into_iter().zip(Spline::clamped(through)) {
            inverses[k] = Some(Inverse::Spline(spline));
        }
        inverses
    }

    /// Position on the reference row where it has `intensity`; the intensity lies within the part.
    ///
    /// `place` is that of the pixel before.
    pub fn at(&self, row: &RowSpline, intensity: f64, place: &mut Place) -> f64 {
        match self {
            Inverse::Polynomial(p) => p.at(intensity),
            Inverse::Spline(s) => s.at(intensity, place),
            Inverse::Exact(points) => {
                let (low, high) = bracket(points, intensity);
                root(row, low.0, high.0, intensity)
            }
            Inverse::Pooled(points) => {
                let (low, high) = bracket(points, intensity);
                let share = (intensity - low.1) / (high.1 - low.1);
                low.0 + share.clamp(0.0, 1.0) * (high.0 - low.0)
            }
        }
    }
}

fn draft(row: &RowSpline, span: &Span, options: &Options) -> Option<Draft> {
    match options.method {
        Method::Ifa => {
            let points = samples(row, span, false);
            (points.len() >= MIN_POLYNOMIAL_POINTS)
                .then(|| Polynomial::fit(&points, options.degree))
                .map(|fitted| Draft::Ready(Inverse::Polynomial(fitted)))
        }
        Method::Sifa => unless_pooled(samples(row, span, true), span.rising(), through),
        Method::Gsifa => {
            let (intensity, x) = resampled(row, span, options.n_resample);
            // Without leaving early, so that the loop becomes one over vectors.
            let pairs = intensity.iter().zip(&intensity[1..]);
            if pairs.fold(true, |rises, (a, b)| rises & (a < b)) {
                return Some(Draft::Through(knots(intensity, x)));
            }
            unless_pooled(x.into_iter().zip(intensity).collect(), true, through)
        }
        Method::Exact => unless_pooled(samples(row, span, true), span.rising(), |points| {
            Draft::Ready(Inverse::Exact(points))
        }),
    }
}

/// `build` of the points, or straight lines where noise broke their order: a curve through pooled
/// samples would follow the noise.
fn unless_pooled(
    points: Vec<(f64, f64)>,
    rising: bool,
    build: fn(Vec<(f64, f64)>) -> Draft,
) -> Option<Draft> {
    let (points, pooled) = monotone(points, rising);
    (points.len() >= 2).then(|| {
        if pooled {
            Draft::Ready(Inverse::Pooled(points))
        } else {
            build(points)
        }
    })
}

fn through(points: Vec<(f64, f64)>) -> Draft {
    let (x, intensity) = points.into_iter().unzip();
    Draft::Through(knots(intensity, x))
}

/// Knots of the position as a function of the intensity. Its end slopes are clamped to zero.
fn knots(intensity: Vec<f64>, x: Vec<f64>) -> Knots {
    Knots {
        x: intensity,
        y: x,
        ends: [0.0; 2],
    }
}

/// The samples inside a part (position, intensity), with its two ends where `ends` is set.
fn samples(row: &RowSpline, span: &Span, ends: bool) -> Vec<(f64, f64)> {
    let first = (span.from + MIN_SPACING).floor() as usize + 1;
    let last = (span.to - MIN_SPACING).ceil().max(0.0) as usize;
    let mut points = Vec::with_capacity(last.saturating_sub(first) + 2);
    if ends {
        points.push((span.from, span.value_from));
    }
    points.extend((first..last).map(|k| (k as f64, row.y[k])));
    if ends {
        points.push((span.to, span.value_to));
    }
    points
}

/// The row's spline, sampled evenly over a part: rising intensities, and their positions.
fn resampled(row: &RowSpline, span: &Span, per_sample: usize) -> (Vec<f64>, Vec<f64>) {
    let count = ((span.to - span.from) * per_sample as f64).ceil().max(3.0) as usize;
    let pitch = (span.to - span.from) / count as f64;
    let (mut intensity, mut x) = (vec![0.0; count + 1], vec![0.0; count + 1]);
    let rising = span.rising();
    let mut set = |k: usize, position: f64, value: f64| {
        let k = if rising { k } else { count - k };
        x[k] = position;
        intensity[k] = value;
    };
    let (mut k, mut position) = (0, span.from);
    while k < count {
        let cubic = row.cubic(position);
        loop {
            set(k, position, cubic.at(position));
            k += 1;
            position = span.from + k as f64 * pitch;
            if k == count || position >= cubic.to {
                break;
            }
        }
    }
    set(count, span.to, span.value_to);
    (intensity, x)
}

/// Points in order of strictly rising intensity, and whether any were pooled.
///
/// Neighbours that break the order (noise, quantisation) are pooled into their mean, which is the
/// least-squares monotone fit (pool-adjacent-violators).
fn monotone(mut points: Vec<(f64, f64)>, rising: bool) -> (Vec<(f64, f64)>, bool) {
    if !rising {
        points.reverse();
    }
    if points.windows(2).all(|w| w[0].1 < w[1].1) {
        return (points, false);
    }
    let mut pools: Vec<(f64, f64, f64)> = Vec::with_capacity(points.len());
    for (x, value) in points {
        let mut pool = (x, value, 1.0);
        while let Some(last) = pools.last() {
            if last.1 / last.2 < pool.1 / pool.2 {
                break;
            }
            pool = (pool.0 + last.0, pool.1 + last.1, pool.2 + last.2);
            pools.pop();
        }
        pools.push(pool);
    }
    let pooled = pools.into_iter().map(|(x, v, n)| (x / n, v / n)).collect();
    (pooled, true)
}

/// The two neighbouring points whose intensities enclose `intensity`.
fn bracket(points: &[(f64, f64)], intensity: f64) -> ((f64, f64), (f64, f64)) {
    let k = points
        .partition_point(|p| p.1 <= intensity)
        .clamp(1, points.len() - 1);
    (points[k - 1], points[k])
}

/// Solve spline(x) = intensity between `a` and `b` by Newton steps kept inside a shrinking bracket.
fn root(row: &RowSpline, a: f64, b: f64, intensity: f64) -> f64 {
    let below = |x: f64| row.at(x).0 - intensity;
    let (f_a, f_b) = (below(a), below(b));
    if f_a >= 0.0 {
        return a;
    }
    if f_b <= 0.0 {
        return b;
    }
    let (mut low, mut high) = (a, b);
    let mut x = a + (b - a) * (f_a / (f_a - f_b));
    for _ in 0..MAX_ROOT_STEPS {
        let (value, slope) = row.at(x);
        let excess = value - intensity;
        if excess < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let newton = x - excess / slope;
        let inside = (newton - low) * (newton - high) < 0.0;
        let next = if inside { newton } else { 0.5 * (low + high) };
        if (next - x).abs() < ROOT_TOLERANCE {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pooling_keeps_order() {
        let (points, pooled) =
            monotone(vec![(0., 0.), (1., 2.), (2., 1.), (3., 3.), (4., 3.)], true);
        assert!(pooled);
        assert_eq!(points, [(0., 0.), (1.5, 1.5), (3.5, 3.)]);
    }
}
