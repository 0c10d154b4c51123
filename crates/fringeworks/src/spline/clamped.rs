//! Clamped cubic splines through knots at any distances, several of them side by side.
//!
//! Elimination is a chain of divisions, each of which waits for the one before. Splines do not wait for
//! one another: [`LANES`] of them are solved in the lanes of vectors. A spline's values do not depend on
//! its neighbours in these lanes.

use super::hermite;
use multiversion::multiversion;

/// Splines that are solved together: the lanes of a vector of 512 bits.
const LANES: usize = 8;

/// Steps from knot to knot before an interval is searched by halving. Neighbouring pixels are rarely
/// further apart.
const MAX_WALK: usize = 16;

/// Knots of a spline y(x): at least two, at strictly rising `x`.
pub struct Knots {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    /// Slopes at the first and the last knot.
    pub ends: [f64; 2],
}

/// An interpolating cubic spline with clamped end slopes.
pub struct Spline {
    knots: Knots,
    slopes: Vec<f64>,
}

/// Where the last value was looked up. Values that follow one another are mostly as far apart as those
/// before.
#[derive(Clone, Copy, Default)]
pub struct Place {
    interval: usize,
    moved: isize,
}

/// One value per spline of a group.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Lanes([f64; LANES]);

const ZERO: Lanes = Lanes([0.0; LANES]);

/// Arrays of a group, used again from group to group.
#[derive(Default)]
struct Group {
    x: Vec<Lanes>,
    y: Vec<Lanes>,
    slopes: Vec<Lanes>,
    factor: Vec<Lanes>,
}

impl Spline {
    /// The splines through all of these knots.
    pub fn clamped(all: Vec<Knots>) -> Vec<Self> {
        let mut group = Group::default();
        let mut slopes = Vec::with_capacity(all.len());
        for some in all.chunks(LANES) {
            group.load(some);
            group.solve(some);
            slopes.extend(some.iter().enumerate().map(|(lane, knots)| {
                let solved = &group.slopes[..knots.x.len()];
                solved.iter().map(|lanes| lanes.0[lane]).collect()
            }));
        }
        let both = all.into_iter().zip(slopes);
        both.map(|(knots, slopes)| Self { knots, slopes }).collect()
    }

    /// Value at `x`; beyond the knots the value of the nearest end.
    pub fn at(&self, x: f64, place: &mut Place) -> f64 {
        let Knots { x: knots, y, .. } = &self.knots;
        let x = x.clamp(knots[0], knots[knots.len() - 1]);
        let k = self.interval(x, place);
        hermite(
            x - knots[k],
            knots[k + 1] - knots[k],
            y[k],
            y[k + 1],
            self.slopes[k],
            self.slopes[k + 1],
        )
        .0
    }

    /// The interval that contains `x`, which lies between the first and the last knot.
    fn interval(&self, x: f64, place: &mut Place) -> usize {
        let knots = &self.knots.x[..];
        let last = knots.len() - 2;
        let guess = place.interval.saturating_add_signed(place.moved);
        let mut k = guess.min(last);
        let mut steps = 0;
        while k < last && knots[k + 1] <= x && steps < MAX_WALK {
            k += 1;
            steps += 1;
        }
        while k > 0 && knots[k] > x && steps < MAX_WALK {
            k -= 1;
            steps += 1;
        }
        if steps == MAX_WALK {
            k = knots.partition_point(|knot| *knot <= x).clamp(1, last + 1) - 1;
        }
        place.moved = k as isize - place.interval as isize;
        place.interval = k;
        k
    }
}

impl Group {
    /// Arrange the knots of up to [`LANES`] splines side by side, padded to the longest.
    fn load(&mut self, some: &[Knots]) {
        let longest = some.iter().map(|knots| knots.x.len()).max().unwrap_or(0);
        // Lanes without a spline have knots, too: nothing is divided by zero.
        let ramp = (0..longest).map(|k| Lanes([k as f64; LANES]));
        self.x.clear();
        self.x.extend(ramp);
        self.y.clear();
        self.y.resize(longest, ZERO);
        self.slopes.clear();
        self.slopes.resize(longest, ZERO);
        self.factor.clear();
        self.factor.resize(longest, ZERO);
        for (lane, knots) in some.iter().enumerate() {
            for (k, (x, y)) in knots.x.iter().zip(&knots.y).enumerate() {
                self.x[k].0[lane] = *x;
                self.y[k].0[lane] = *y;
            }
            let n = knots.x.len();
            for k in n..longest {
                self.x[k].0[lane] = knots.x[n - 1] + (k + 1 - n) as f64;
            }
            self.slopes[0].0[lane] = knots.ends[0];
            self.slopes[longest - 1].0[lane] = knots.ends[1];
        }
    }

    /// Slopes of the splines that were loaded.
    fn solve(&mut self, some: &[Knots]) {
        let (mut last, mut end) = (ZERO, ZERO);
        for (lane, knots) in some.iter().enumerate() {
            last.0[lane] = (knots.x.len() - 1) as f64;
            end.0[lane] = knots.ends[1];
        }
        solve(
            &self.x,
            &self.y,
            &last,
            &end,
            &mut self.slopes,
            &mut self.factor,
        );
    }
}

/// Slopes of clamped splines by elimination.
///
/// Each knot has the equation m[i−1]/h0 + 2 (1/h0 + 1/h1) m[i] + m[i+1]/h1 = 3 (Δ0/h0 + Δ1/h1), here
/// times h0 h1, with the steps h and the secants Δ before and behind it. From the knot `last` of a
/// spline on, its slopes are `end`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn solve(
    x: &[Lanes],
    y: &[Lanes],
    last: &Lanes,
    end: &Lanes,
    slopes: &mut [Lanes],
    factor: &mut [Lanes],
) {
    let n = x.len();
    let (y, slopes, factor) = (&y[..n], &mut slopes[..n], &mut factor[..n]);
    let (mut h0, mut s0, mut f, mut m) = (ZERO, ZERO, ZERO, slopes[0]);
    for l in 0..LANES {
        h0.0[l] = x[1].0[l] - x[0].0[l];
        s0.0[l] = (y[1].0[l] - y[0].0[l]) / h0.0[l];
    }
    for i in 1..n - 1 {
        let at = i as f64;
        for l in 0..LANES {
            let h1 = x[i + 1].0[l] - x[i].0[l];
            let s1 = (y[i + 1].0[l] - y[i].0[l]) / h1;
            let pivot = 1.0 / (2.0 * (h0.0[l] + h1) - h1 * f.0[l]);
            let slope = (3.0 * (s0.0[l] * h1 + s1 * h0.0[l]) - h1 * m.0[l]) * pivot;
            let inside = at < last.0[l];
            f.0[l] = if inside { h0.0[l] * pivot } else { 0.0 };
            m.0[l] = if inside { slope } else { end.0[l] };
            h0.0[l] = h1;
            s0.0[l] = s1;
        }
        factor[i] = f;
        slopes[i] = m;
    }
    let mut m = slopes[n - 1];
    for i in (1..n - 1).rev() {
        for l in 0..LANES {
            m.0[l] = slopes[i].0[l] - factor[i].0[l] * m.0[l];
        }
        slopes[i] = m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(x: f64) -> f64 {
        1.0 - 2.0 * x + 0.3 * x * x - 0.01 * x * x * x
    }

    fn knots_at(x: &[f64]) -> Knots {
        let slope = |x: f64| -2.0 + 0.6 * x - 0.03 * x * x;
        Knots {
            x: x.to_vec(),
            y: x.iter().map(|v| cubic(*v)).collect(),
            ends: [slope(x[0]), slope(x[x.len() - 1])],
        }
    }

    /// Knots of many lengths, more of them than lanes.
    fn many() -> Vec<Vec<f64>> {
        let mut all: Vec<Vec<f64>> = (2..14)
            .map(|n| {
                (0..n)
                    .map(|k| 5.0 * (k as f64 / (n - 1) as f64).powi(2))
                    .collect()
            })
            .collect();
        all.push(vec![0.0, 0.1, 0.7, 2.0, 2.1, 3.0, 4.9, 5.0]);
        all
    }

    #[test]
    fn reproduces_a_cubic_in_every_lane() {
        let splines = Spline::clamped(many().iter().map(|x| knots_at(x)).collect());
        assert_eq!(splines.len(), many().len());
        for spline in &splines {
            let mut place = Place::default();
            for v in [0.0f64, 0.1, 2.05, 4.9, 5.0, 0.02, 4.0, -1.0, 6.0] {
                let expected = cubic(v.clamp(0.0, 5.0));
                assert!((spline.at(v, &mut place) - expected).abs() < 1e-10, "{v}");
            }
        }
    }

    #[test]
    fn a_spline_does_not_depend_on_its_neighbours() {
        let together = Spline::clamped(many().iter().map(|x| knots_at(x)).collect());
        for (x, beside) in many().iter().zip(&together) {
            let alone = &Spline::clamped(vec![knots_at(x)])[0];
            assert_eq!(alone.slopes, beside.slopes);
        }
    }

    #[test]
    fn intervals_are_found_from_any_place() {
        let x: Vec<f64> = (0..200).map(|k| (k as f64).powf(1.3)).collect();
        let spline = &Spline::clamped(vec![knots_at(&x)])[0];
        for from in [0, 3, 57, 198, 500] {
            for moved in [-40, 0, 7, 300] {
                for k in [0, 1, 60, 198] {
                    let mut place = Place {
                        interval: from,
                        moved,
                    };
                    assert_eq!(spline.interval(0.5 * (x[k] + x[k + 1]), &mut place), k);
                    assert_eq!(spline.interval(x[k], &mut place), k);
                }
                let mut place = Place {
                    interval: from,
                    moved,
                };
                assert_eq!(spline.interval(x[199], &mut place), 198);
            }
        }
    }
}
