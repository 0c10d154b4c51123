//! Cliffs: a window that straddles two surfaces fits neither.
//!
//! Each pixel with a large residual is offered the surfaces at some distance in eight directions, and
//! takes the one that explains a small patch around the pixel much better.

use super::warp::Pair;
use rayon::prelude::*;

/// Half-width of the patch that a surface has to explain, px: 7 × 7 px average the noise and still fit
/// beside a cliff.
const PATCH: usize = 3;

/// Number of pixels with data, half of a patch, below which its residual is not computed.
const MIN_PATCH_PIXELS: u32 = ((2 * PATCH + 1) * (2 * PATCH + 1)) as u32 / 2;

/// Mean squared residual of a patch above which its pixel is badly explained, in noise variances.
///
/// The mean of 49 squares scatters by a fifth, so noise alone does not reach it.
const MIN_NOISE_VARIANCES: f32 = 6.0;

/// The same threshold as a share of the squared modulation: a displacement that is wrong by about a
/// thirtieth of a period. A smaller error is the bias of a large window, which smaller windows correct
/// better.
const MIN_SHARE: f32 = 0.03;

/// Share of the pixel's present residual that another surface must stay below. An empirical choice:
/// nearer to 1, noise would move pixels.
const IMPROVEMENT: f32 = 0.5;

/// Half the base of the finite differences that give a surface's slope, px.
const SLOPE_BASE: isize = 4;

/// A surface model per pixel.
pub struct Model {
    /// Displacement, px.
    pub displacement: Vec<f32>,
    pub offset: Vec<f32>,
    pub modulation_ratio: Vec<f32>,
}

/// The eight directions in which surfaces are searched.
const DIRECTIONS: [(isize, isize); 8] = [
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, 1),
    (1, -1),
    (-1, 1),
    (-1, -1),
];

/// Displacement, offset and modulation ratio at a pixel.
type Surface = (f32, f32, f32);

/// Residual of one pixel under a displacement, offset and modulation ratio; `None` without data.
fn residual(pair: &Pair, x: usize, y: usize, (u, offset, ratio): Surface) -> Option<f32> {
    let (value, _) = pair.reference_at(x, y, u)?;
    let i = y * pair.width + x;
    Some(pair.object[i] - pair.albedo_at(i) * (offset + ratio * value))
}

/// Mean squared residual over the patch around a pixel, under one surface.
fn patch_cost(
    pair: &Pair,
    (x, y): (usize, usize),
    surface: impl Fn(isize, isize) -> Surface,
) -> f32 {
    let (mut sum, mut count) = (0.0f32, 0u32);
    for py in y.saturating_sub(PATCH)..=(y + PATCH).min(pair.height - 1) {
        for px in x.saturating_sub(PATCH)..=(x + PATCH).min(pair.width - 1) {
            let here = surface(px as isize - x as isize, py as isize - y as isize);
            if let Some(r) = residual(pair, px, py, here) {
                sum += r * r;
                count += 1;
            }
        }
    }
    mean_if_enough(sum, count)
}

/// Residual of every pixel under the model; NaN without data.
pub fn residuals(pair: &Pair, model: &Model) -> Vec<f32> {
    let mut out = vec![f32::NAN; pair.object.len()];
    out.par_chunks_mut(pair.width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let i = y * pair.width + x;
                if let Some(r) = residual(pair, x, y, model.surface(i)) {
                    *value = r;
                }
            }
        });
    out
}

/// Mean square of the finite values in the patch around a pixel; infinite where fewer than half are.
fn patch_mean_square(pair: &Pair, values: &[f32], x: usize, y: usize) -> f32 {
    let (mut sum, mut count) = (0.0f32, 0u32);
    for py in y.saturating_sub(PATCH)..=(y + PATCH).min(pair.height - 1) {
        let row = &values[py * pair.width..(py + 1) * pair.width];
        for value in &row[x.saturating_sub(PATCH)..=(x + PATCH).min(pair.width - 1)] {
            if value.is_finite() {
                sum += value * value;
                count += 1;
            }
        }
    }
    mean_if_enough(sum, count)
}

/// The mean, or infinity where fewer than half of a patch's pixels have data.
fn mean_if_enough(sum: f32, count: u32) -> f32 {
    if count < MIN_PATCH_PIXELS {
        f32::INFINITY
    } else {
        sum / count as f32
    }
}

impl Model {
    fn surface(&self, i: usize) -> Surface {
        (
            self.displacement[i],
            self.offset[i],
            self.modulation_ratio[i],
        )
    }
}

/// The search for better surfaces.
struct Search<'a> {
    pair: &'a Pair<'a>,
    model: &'a Model,
    residuals: &'a [f32],
    /// Distances of the surfaces that are offered, px.
    distances: &'a [usize],
    /// Largest change of a displacement, px.
    max_change: f32,
    /// Mean squared residual above which a pixel is badly explained.
    min_residual: f32,
}

impl Search<'_> {
    /// Index of a pixel; `None` outside the frame.
    fn index(&self, x: isize, y: isize) -> Option<usize> {
        let (h, w) = (self.pair.height as isize, self.pair.width as isize);
        (x >= 0 && y >= 0 && x < w && y < h).then(|| (y * w + x) as usize)
    }

    /// Slope of the displacement along x and y, px/px; 0 near the frame's border.
    fn slope(&self, x: isize, y: isize) -> (f32, f32) {
        let u = &self.model.displacement;
        let along =
            |dx: isize, dy: isize| match (self.index(x + dx, y + dy), self.index(x - dx, y - dy)) {
                (Some(a), Some(b)) => (u[a] - u[b]) / (2 * SLOPE_BASE) as f32,
                _ => 0.0,
            };
        (along(SLOPE_BASE, 0), along(0, SLOPE_BASE))
    }

    /// Displacement of the best surface for a badly explained pixel; `None` where it keeps its own.
    fn best_for(&self, x: usize, y: usize) -> Option<f32> {
        let present = patch_mean_square(self.pair, self.residuals, x, y);
        if !present.is_finite() || present <= self.min_residual {
            return None;
        }
        let mut best = (IMPROVEMENT * present, None);
        for distance in self.distances {
            for (ux, uy) in DIRECTIONS {
                let offset = (ux * *distance as isize, uy * *distance as isize);
                if let Some((cost, u)) = self.offer(x, y, offset) {
                    if cost < best.0 {
                        best = (cost, Some(u));
                    }
                }
            }
        }
        best.1
    }

    /// Extrapolate the surface at an offset from the pixel. Returns its mean squared residual over the
    /// pixel's patch and its displacement at the pixel; `None` where the change is too large.
    #[inline(always)]
    fn offer(&self, x: usize, y: usize, (ox, oy): (isize, isize)) -> Option<(f32, f32)> {
        let (cx, cy) = (x as isize + ox, y as isize + oy);
        let i = self.index(cx, cy)?;
        let (sx, sy) = self.slope(cx, cy);
        let (u, offset, ratio) = self.model.surface(i);
        let here = u - sx * ox as f32 - sy * oy as f32;
        let change = here - self.model.displacement[y * self.pair.width + x];
        if change.abs() > self.max_change {
            return None;
        }
        let cost = patch_cost(self.pair, (x, y), |dx, dy| {
            (here + sx * dx as f32 + sy * dy as f32, offset, ratio)
        });
        Some((cost, here))
    }
}

/// Replace the displacement of badly explained pixels by the best of the surfaces at the given
/// distances (px) in eight directions. Returns whether any pixel changed.
///
/// `residuals` are those of `model`. `max_change` (px) is half a period: a larger change would be one
/// of the fringe order, which a patch does not determine. `noise` is the variance of the object's
/// noise.
pub fn relocate(
    pair: &Pair,
    model: &mut Model,
    residuals: &[f32],
    distances: &[usize],
    max_change: f32,
    noise: f32,
) -> bool {
    let search = Search {
        pair,
        model,
        residuals,
        distances,
        max_change,
        min_residual: (MIN_NOISE_VARIANCES * noise).max(MIN_SHARE),
    };
    let changes: Vec<Vec<(usize, f32)>> = (0..pair.height)
        .into_par_iter()
        .map(|y| {
            (0..pair.width)
                .filter_map(|x| search.best_for(x, y).map(|u| (y * pair.width + x, u)))
                .collect()
        })
        .collect();
    let mut changed = false;
    for (i, u) in changes.into_iter().flatten() {
        model.displacement[i] = u;
        changed = true;
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// B-spline coefficients of a cosine are the scaled cosine, so no filter is needed.
    fn spline_of_cosine(height: usize, width: usize, period: f64) -> Vec<f32> {
        let k = std::f64::consts::TAU / period;
        let scale = 3.0 / (2.0 + k.cos());
        let row = (0..width + 3).map(|i| (scale * (k * (i as f64 - 1.0)).cos()) as f32);
        std::iter::repeat_n(row, height).flatten().collect()
    }

    const HEIGHT: usize = 40;
    const WIDTH: usize = 160;
    const PERIOD: f64 = 20.0;

    /// Displacement of a cliff of 6 px.
    fn truth(x: usize) -> f32 {
        if x < 85 {
            0.0
        } else {
            6.0
        }
    }

    /// The cliff as a window of ±8 px smears it: a ramp.
    fn smeared() -> Model {
        let ramp = |x: usize| (6.0 * (x as f32 - 77.0) / 16.0).clamp(0.0, 6.0);
        Model {
            displacement: (0..HEIGHT * WIDTH).map(|i| ramp(i % WIDTH)).collect(),
            offset: vec![0.0; HEIGHT * WIDTH],
            modulation_ratio: vec![1.0; HEIGHT * WIDTH],
        }
    }

    fn wrong_pixels(model: &Model) -> usize {
        (0..HEIGHT * WIDTH)
            .filter(|i| (model.displacement[*i] - truth(i % WIDTH)).abs() > 0.5)
            .count()
    }

    #[test]
    fn a_smeared_cliff_is_restored() {
        let k = std::f64::consts::TAU / PERIOD;
        let object: Vec<f32> = (0..HEIGHT * WIDTH)
            .map(|i| (k * ((i % WIDTH) as f64 - truth(i % WIDTH) as f64)).cos() as f32)
            .collect();
        let spline = spline_of_cosine(HEIGHT, WIDTH, PERIOD);
        let ok = vec![1u8; HEIGHT * WIDTH];
        let pair = Pair {
            height: HEIGHT,
            width: WIDTH,
            spline: &spline,
            object: &object,
            reference_ok: &ok,
            object_ok: &ok,
            albedo: None,
        };
        let mut model = smeared();
        let before = wrong_pixels(&model);
        let left = residuals(&pair, &model);
        assert!(relocate(&pair, &mut model, &left, &[12, 24], 10.0, 1e-5));
        let after = wrong_pixels(&model);
        assert!(after * 2 < before, "{before} wrong pixels, then {after}");
        // No change beyond the limit, which would be a change of the fringe order.
        let mut held = smeared();
        assert!(!relocate(&pair, &mut held, &left, &[12, 24], 0.0, 1e-5));
        assert_eq!(wrong_pixels(&held), before);
    }
}
