//! Cliffs: where a window straddles two surfaces it fits neither. Each badly explained pixel is
//! offered the surfaces found further away on either side, and takes the one that explains it.

use super::warp::Pair;
use rayon::prelude::*;

/// Half-width of the patch over which a surface has to explain the frame, px.
const PATCH: usize = 3;
/// A pixel is badly explained where its patch's residual exceeds this many noise variances …
const BAD: f32 = 6.0;
/// … and this share of the squared modulation: a displacement wrong by about a thirtieth of a
/// period. Less is bias of a large window, which the smaller ones mend better.
const BAD_SHARE: f32 = 0.03;
/// Another surface must bring the residual below this share of its own.
const IMPROVEMENT: f32 = 0.5;
/// Half the base of the finite differences that carry a surface's slope along, px.
const SLOPE_BASE: isize = 4;

/// A surface model per pixel: displacement, offset and gain.
pub struct Model {
    pub displacement: Vec<f32>,
    pub offset: Vec<f32>,
    pub gain: Vec<f32>,
}

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

/// Residual of one pixel under a displacement, offset and gain; `None` without data.
fn residual(pair: &Pair, x: usize, y: usize, u: f32, offset: f32, gain: f32) -> Option<f32> {
    let (value, _) = pair.reference_at(x, y, u)?;
    Some(pair.object[y * pair.width + x] - offset - gain * value)
}

/// Mean squared residual over the patch around a pixel, under one affine surface.
fn patch_cost(
    pair: &Pair,
    (x, y): (usize, usize),
    surface: impl Fn(isize, isize) -> (f32, f32, f32),
) -> f32 {
    let (mut sum, mut count) = (0.0f32, 0u32);
    for py in y.saturating_sub(PATCH)..=(y + PATCH).min(pair.height - 1) {
        for px in x.saturating_sub(PATCH)..=(x + PATCH).min(pair.width - 1) {
            let (u, offset, gain) = surface(px as isize - x as isize, py as isize - y as isize);
            if let Some(r) = residual(pair, px, py, u, offset, gain) {
                sum += r * r;
                count += 1;
            }
        }
    }
    mean_if_enough(sum, count)
}

/// Residual of every pixel under its own model; NaN without data.
pub fn residuals(pair: &Pair, model: &Model) -> Vec<f32> {
    let mut out = vec![f32::NAN; pair.object.len()];
    out.par_chunks_mut(pair.width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let i = y * pair.width + x;
                let (u, offset, gain) = (model.displacement[i], model.offset[i], model.gain[i]);
                if let Some(r) = residual(pair, x, y, u, offset, gain) {
                    *value = r;
                }
            }
        });
    out
}

/// Mean square of the finite values in the patch around a pixel; infinite where most are missing.
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

/// The mean, or infinity where fewer than half of a patch's pixels count.
fn mean_if_enough(sum: f32, count: u32) -> f32 {
    const ENOUGH: u32 = ((2 * PATCH + 1) * (2 * PATCH + 1)) as u32 / 2;
    if count < ENOUGH {
        f32::INFINITY
    } else {
        sum / count as f32
    }
}

/// Replace the displacement of badly explained pixels by the best of the surfaces at the given
/// distances (px) in eight directions. A change beyond `max_change` (half a period) would be a
/// change of the fringe order, on which a patch has no say. `residuals` are those of the model as it stands. Returns
/// whether any pixel changed.
pub fn relocate(
    pair: &Pair,
    model: &mut Model,
    residuals: &[f32],
    distances: &[usize],
    max_change: f32,
    noise: f32,
) -> bool {
    let (h, w) = (pair.height as isize, pair.width as isize);
    let bad = (BAD * noise).max(BAD_SHARE);
    let at = |x: isize, y: isize| -> Option<usize> {
        (x >= 0 && y >= 0 && x < w && y < h).then(|| (y * w + x) as usize)
    };
    let slope = |x: isize, y: isize| -> (f32, f32) {
        let along = |dx: isize, dy: isize| match (at(x + dx, y + dy), at(x - dx, y - dy)) {
            (Some(a), Some(b)) => {
                (model.displacement[a] - model.displacement[b]) / (2 * SLOPE_BASE) as f32
            }
            _ => 0.0,
        };
        (along(SLOPE_BASE, 0), along(0, SLOPE_BASE))
    };
    let best_for = |x: usize, y: usize| -> Option<f32> {
        let own = patch_mean_square(pair, residuals, x, y);
        if !own.is_finite() || own <= bad {
            return None;
        }
        let mut best = (IMPROVEMENT * own, None);
        for distance in distances {
            for (ux, uy) in DIRECTIONS {
                let (ox, oy) = (ux * *distance as isize, uy * *distance as isize);
                let (cx, cy) = (x as isize + ox, y as isize + oy);
                let Some(i) = at(cx, cy) else { continue };
                let (sx, sy) = slope(cx, cy);
                let here = model.displacement[i] - sx * ox as f32 - sy * oy as f32;
                if (here - model.displacement[y * pair.width + x]).abs() > max_change {
                    continue;
                }
                let cost = patch_cost(pair, (x, y), |dx, dy| {
                    (
                        here + sx * dx as f32 + sy * dy as f32,
                        model.offset[i],
                        model.gain[i],
                    )
                });
                if cost < best.0 {
                    best = (cost, Some(here));
                }
            }
        }
        best.1
    };
    let found: Vec<Vec<(usize, f32)>> = (0..pair.height)
        .into_par_iter()
        .map(|y| {
            (0..pair.width)
                .filter_map(|x| best_for(x, y).map(|u| (y * pair.width + x, u)))
                .collect()
        })
        .collect();
    let mut changed = false;
    for (i, u) in found.into_iter().flatten() {
        model.displacement[i] = u;
        changed = true;
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// B-spline coefficients of a cosine are the cosine, scaled: no filter needed.
    fn spline_of_cosine(height: usize, width: usize, period: f64) -> Vec<f32> {
        let k = std::f64::consts::TAU / period;
        let scale = 3.0 / (2.0 + k.cos());
        let row = (0..width + 3).map(|i| (scale * (k * (i as f64 - 1.0)).cos()) as f32);
        std::iter::repeat_n(row, height).flatten().collect()
    }

    #[test]
    fn a_smeared_cliff_is_put_back() {
        let (height, width, period, edge) = (40usize, 160usize, 20.0, 85usize);
        let truth = |x: usize| if x < edge { 0.0f32 } else { 6.0 };
        let k = std::f64::consts::TAU / period;
        let object: Vec<f32> = (0..height * width)
            .map(|i| (k * ((i % width) as f64 - truth(i % width) as f64)).cos() as f32)
            .collect();
        let spline = spline_of_cosine(height, width, period);
        let ok = vec![1u8; height * width];
        let pair = Pair {
            height,
            width,
            spline: &spline,
            object: &object,
            reference_ok: &ok,
            object_ok: &ok,
        };
        // What a window of ±8 px makes of the cliff: a ramp.
        let smeared = |x: usize| (6.0 * (x as f32 - 77.0) / 16.0).clamp(0.0, 6.0);
        let mut model = Model {
            displacement: (0..height * width).map(|i| smeared(i % width)).collect(),
            offset: vec![0.0; height * width],
            gain: vec![1.0; height * width],
        };
        let wrong = |model: &Model| {
            (0..height * width)
                .filter(|i| (model.displacement[*i] - truth(i % width)).abs() > 0.5)
                .count()
        };
        let before = wrong(&model);
        let left = residuals(&pair, &model);
        assert!(relocate(&pair, &mut model, &left, &[12, 24], 10.0, 1e-5));
        let after = wrong(&model);
        assert!(after * 2 < before, "{before} wrong pixels, then {after}");
        // A change beyond the limit would be a change of order: none may happen.
        let mut held = Model {
            displacement: (0..height * width).map(|i| smeared(i % width)).collect(),
            offset: vec![0.0; height * width],
            gain: vec![1.0; height * width],
        };
        assert!(!relocate(&pair, &mut held, &left, &[12, 24], 0.0, 1e-5));
        assert_eq!(wrong(&held), before);
    }
}
