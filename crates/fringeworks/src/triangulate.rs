//! From projector coordinates to points: each camera pixel's ray meets what the projector lights.
//!
//! The unknown of a pixel is w = 1/z along its ray. A point in the projector's coordinates, divided
//! by its depth z, is R r + w t: linear in w, so that without distortion one axis gives w in closed
//! form, and two give it by linear least squares. With distortion, Newton's method goes on from
//! there. Rays are cubics along short stretches of a row through four pixels whose distortion is
//! inverted in double precision.
//!
//! As in [`crate::decode`], multiplications and additions are kept apart, so that all instruction
//! sets give the same numbers.

use crate::{check_length, check_value, reason, Error};
use rayon::prelude::*;

/// Pixels that are worked on together.
const LANES: usize = 64;
type Lanes = [f32; LANES];
/// Where on a stretch its rays are computed exactly.
const NODES: [f64; 4] = [2.0, 21.0, 42.0, 61.0];
/// Corrections for a projector's distortion; each squares the error, of about a tenth at first.
const NEWTON: usize = 3;
/// Coefficients of the variance of 1/z along a ray.
pub const POWERS: usize = 5;

/// A pinhole with Brown's distortion k₁, k₂, p₁, p₂, k₃.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    pub focal: [f64; 2],
    pub principal: [f64; 2],
    pub distortion: [f64; 5],
}

/// Camera, projector, and the pose that maps camera coordinates to the projector's.
pub struct Rig {
    pub camera: Lens,
    pub projector: Lens,
    /// Row by row.
    pub rotation: [f64; 9],
    pub translation: [f64; 3],
}

/// Variance of 1/z by calibration: polynomials along rays, at nodes that cover the frame.
pub struct Spread {
    pub columns: usize,
    pub rows: usize,
    /// Of the variance's binary logarithm: coefficients from the constant on, [`POWERS`] per
    /// node, node after node of each row, in the projector coordinate along one axis, −1…1 over
    /// its length.
    pub coefficients: Vec<f32>,
    pub along_x: bool,
    pub length: f32,
}

/// Decoded coordinates along one axis.
#[derive(Clone, Copy)]
pub struct Axis<'a> {
    pub coordinate: &'a [f32],
    pub sigma: &'a [f32],
    pub reason: &'a [u8],
}

/// What a point must keep.
pub struct Limits {
    /// Largest distance from the epipolar line, in standard deviations.
    pub residual_sigmas: f32,
    /// What calibration adds to that standard deviation, px.
    pub residual_px: f32,
}

/// Where results go; maps of as many pixels as the frame has, `xyz` of three times as many.
pub struct Points<'a> {
    pub xyz: &'a mut [f32],
    pub sigma: &'a mut [f32],
    pub noise: &'a mut [f32],
    /// Distance from the epipolar line, px; empty for one axis.
    pub residual: &'a mut [f32],
    pub reason: &'a mut [u8],
}

impl Lens {
    fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Normalised direction of a pixel; NaN where the distortion has no inverse.
    fn ray(&self, column: f64, row: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let goal = (
            (column - self.principal[0]) / self.focal[0],
            (row - self.principal[1]) / self.focal[1],
        );
        let (mut x, mut y) = goal;
        for _ in 0..20 {
            let (xd, yd) = self.distort(x, y);
            let (ex, ey) = (xd - goal.0, yd - goal.1);
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));
            let a = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
            let b = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
            let c = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
            if ex.abs().max(ey.abs()) < 1e-12 {
                let upright = a > 0.0 && a * c > b * b;
                return if upright {
                    (x, y)
                } else {
                    (f64::NAN, f64::NAN)
                };
            }
            let determinant = a * c - b * b;
            x -= (c * ex - b * ey) / determinant;
            y -= (a * ey - b * ex) / determinant;
        }
        (f64::NAN, f64::NAN)
    }
}

/// Everything a stretch of pixels needs, in single precision.
struct Constants {
    focal: [f32; 2],
    principal: [f32; 2],
    distortion: [f32; 5],
    translation: [f32; 3],
    limits: [f32; 2],
    /// Whether the spread goes along x, and its variable: offset and factor of the coordinate.
    along: (bool, f32, f32),
}

/// A cubic in (i − 31.5) / 32 for each of: r_x, r_y, (R r)_x, (R r)_y, (R r)_z.
type Cubics = [[f32; 4]; 5];

fn cubics(rig: &Rig, column: usize, row: usize) -> Cubics {
    let mut values = [[0.0; 4]; 5];
    for (k, node) in NODES.iter().enumerate() {
        let (x, y) = rig.camera.ray(column as f64 + node, row as f64);
        let r = &rig.rotation;
        let rotated = |k: usize| r[3 * k] * x + r[3 * k + 1] * y + r[3 * k + 2];
        for (line, value) in values
            .iter_mut()
            .zip([x, y, rotated(0), rotated(1), rotated(2)])
        {
            line[k] = value;
        }
    }
    values.map(interpolate)
}

/// The cubic through four values at the nodes: Newton's divided differences, multiplied out.
fn interpolate(values: [f64; 4]) -> [f32; 4] {
    let at = NODES.map(|n| (n - 31.5) / 32.0);
    let mut d = values;
    for order in 1..4 {
        for k in (order..4).rev() {
            d[k] = (d[k] - d[k - 1]) / (at[k] - at[k - order]);
        }
    }
    let mut c = [d[3], 0.0, 0.0, 0.0];
    for k in (0..3).rev() {
        c = [
            d[k] - at[k] * c[0],
            c[0] - at[k] * c[1],
            c[1] - at[k] * c[2],
            c[2] - at[k] * c[3],
        ];
    }
    c.map(|v| v as f32)
}

/// The variance's coefficients along a stretch: values at its first pixel, and slopes per pixel.
fn along(
    spread: &Spread,
    shape: (usize, usize),
    column: usize,
    row: usize,
) -> ([f32; POWERS], [f32; POWERS]) {
    let scale = |nodes: usize, pixels: usize| (nodes - 1) as f32 / (pixels - 1).max(1) as f32;
    let down = row as f32 * scale(spread.rows, shape.0);
    let j = (down as usize).min(spread.rows - 2);
    let v = down - j as f32;
    let at = |position: f32| -> [f32; POWERS] {
        let across = position * scale(spread.columns, shape.1);
        let i = (across as usize).min(spread.columns - 2);
        let u = across - i as f32;
        let mut found = [0.0; POWERS];
        for (k, value) in found.iter_mut().enumerate() {
            let node =
                |j: usize, i: usize| spread.coefficients[(j * spread.columns + i) * POWERS + k];
            let upper = node(j, i) + u * (node(j, i + 1) - node(j, i));
            let lower = node(j + 1, i) + u * (node(j + 1, i + 1) - node(j + 1, i));
            *value = upper + v * (lower - upper);
        }
        found
    };
    let first = at(column as f32);
    let last = at((column + LANES) as f32);
    let mut slope = [0.0; POWERS];
    for k in 0..POWERS {
        slope[k] = (last[k] - first[k]) / LANES as f32;
    }
    (first, slope)
}

/// A row of the frame.
#[doc(hidden)]
pub struct Task<'a> {
    rig: &'a Rig,
    constants: &'a Constants,
    spread: &'a Spread,
    shape: (usize, usize),
    row: usize,
    x: Option<Axis<'a>>,
    y: Option<Axis<'a>>,
    out: Points<'a>,
}

struct Stretch<'a> {
    cubics: Cubics,
    variance: ([f32; POWERS], [f32; POWERS]),
    constants: &'a Constants,
}

/// Coordinates and standard deviations of a stretch, padded with NaN.
struct Seen {
    coordinate: Lanes,
    sigma: Lanes,
}

impl Seen {
    #[inline(always)]
    fn load(axis: Option<Axis<'_>>, range: std::ops::Range<usize>) -> Self {
        let mut seen = Self {
            coordinate: [f32::NAN; LANES],
            sigma: [1.0; LANES],
        };
        if let Some(axis) = axis {
            let n = range.len();
            seen.coordinate[..n].copy_from_slice(&axis.coordinate[range.clone()]);
            seen.sigma[..n].copy_from_slice(&axis.sigma[range]);
        }
        seen
    }
}

/// What a stretch comes to; w ≤ 0 where the rays do not meet in front of both devices.
struct Met {
    x: Lanes,
    y: Lanes,
    z: Lanes,
    sigma: Lanes,
    noise: Lanes,
    residual: Lanes,
    /// Positive where the point is in front of both devices.
    front: Lanes,
    /// Largest residual that is let through.
    allowed: Lanes,
}

impl Met {
    fn new() -> Self {
        let line = [0.0; LANES];
        Self {
            x: line,
            y: line,
            z: line,
            sigma: line,
            noise: line,
            residual: line,
            front: line,
            allowed: line,
        }
    }
}

/// 2^x to 3e-4 for |x| ≤ 126, and the value at the end beyond.
#[inline(always)]
fn power_of_two(x: f32) -> f32 {
    // Added to this, x is rounded, and its whole part lies in the lowest bits, biased as an
    // exponent is.
    const WHOLE: f32 = 12_582_912.0 + 127.0;
    let x = x.clamp(-126.0, 126.0);
    let shifted = x + WHOLE;
    let part = x - (shifted - WHOLE);
    let small = 1.0 + part * (0.693_147 + part * (0.240_22 + part * (0.055_5 + part * 0.009_6)));
    small * f32::from_bits(shifted.to_bits() << 23)
}

#[inline(always)]
fn cubic(c: &[f32; 4], u: f32) -> f32 {
    c[0] + u * (c[1] + u * (c[2] + u * c[3]))
}

/// The points of a stretch. `X` and `Y` say which axes there are, `CURVED` whether the projector's
/// lens distorts.
#[inline(always)]
fn meet<const X: bool, const Y: bool, const CURVED: bool>(
    stretch: &Stretch<'_>,
    along_x: &Seen,
    along_y: &Seen,
    met: &mut Met,
) {
    let c = stretch.constants;
    let [k1, k2, p1, p2, k3] = c.distortion;
    let [t0, t1, t2] = c.translation;
    let (base, slope) = &stretch.variance;
    for i in 0..LANES {
        let u = (i as f32 - 31.5) * (1.0 / 32.0);
        let [rx, ry, qx, qy, qz] = [0, 1, 2, 3, 4].map(|k| cubic(&stretch.cubics[k], u));
        // Directions on the projector's side, and how firm they are.
        let goal_x = (along_x.coordinate[i] - c.principal[0]) / c.focal[0];
        let goal_y = (along_y.coordinate[i] - c.principal[1]) / c.focal[1];
        let weight = |focal: f32, sigma: f32| {
            let f = focal / sigma;
            f * f
        };
        let weight_x = if X {
            weight(c.focal[0], along_x.sigma[i])
        } else {
            0.0
        };
        let weight_y = if Y {
            weight(c.focal[1], along_y.sigma[i])
        } else {
            0.0
        };
        // Without distortion: n = w d for each axis.
        let (nx, dx) = (goal_x * qz - qx, t0 - goal_x * t2);
        let (ny, dy) = (goal_y * qz - qy, t1 - goal_y * t2);
        let mut w = match (X, Y) {
            (true, true) => {
                (weight_x * nx * dx + weight_y * ny * dy)
                    / (weight_x * dx * dx + weight_y * dy * dy)
            }
            (true, false) => nx / dx,
            _ => ny / dy,
        };
        let (mut gx, mut gy, mut ex, mut ey, mut depth) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for _ in 0..if CURVED { NEWTON } else { 1 } {
            depth = qz + w * t2;
            let inverse = 1.0 / depth;
            let (x, y) = ((qx + w * t0) * inverse, (qy + w * t1) * inverse);
            let (by_x, by_y) = ((t0 - x * t2) * inverse, (t1 - y * t2) * inverse);
            if CURVED {
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let steep = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));
                let across = x * y * steep + 2.0 * p1 * x + 2.0 * p2 * y;
                if X {
                    let by = radial + x * x * steep + 2.0 * p1 * y + 6.0 * p2 * x;
                    gx = by * by_x + across * by_y;
                    ex = goal_x - (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x));
                }
                if Y {
                    let by = radial + y * y * steep + 6.0 * p1 * y + 2.0 * p2 * x;
                    gy = across * by_x + by * by_y;
                    ey = goal_y - (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
                }
            } else {
                (gx, gy) = (by_x, by_y);
                (ex, ey) = (goal_x - x, goal_y - y);
            }
            let step = match (X, Y) {
                (true, true) => {
                    (weight_x * gx * ex + weight_y * gy * ey)
                        / (weight_x * gx * gx + weight_y * gy * gy)
                }
                (true, false) => ex / gx,
                _ => ey / gy,
            };
            w += step;
            ex -= gx * step;
            ey -= gy * step;
        }
        let z = 1.0 / w;
        let noise = match (X, Y) {
            (true, true) => 1.0 / (weight_x * gx * gx + weight_y * gy * gy),
            (true, false) => 1.0 / (weight_x * gx * gx),
            _ => 1.0 / (weight_y * gy * gy),
        };
        let place = if c.along.0 {
            along_x.coordinate[i]
        } else {
            along_y.coordinate[i]
        };
        let s = c.along.1 + c.along.2 * place;
        let mut calibration = 0.0;
        for k in (0..POWERS).rev() {
            calibration = calibration * s + (base[k] + i as f32 * slope[k]);
        }
        let calibration = power_of_two(calibration);
        let length = (rx * rx + ry * ry + 1.0).sqrt() * z * z;
        met.x[i] = rx * z;
        met.y[i] = ry * z;
        met.z[i] = z;
        met.noise[i] = length * noise.sqrt();
        met.sigma[i] = length * (noise + calibration).sqrt();
        met.front[i] = w.min(depth);
        if X && Y {
            // Across the epipolar line, in px.
            let (ux, uy) = (c.focal[0] * gx, c.focal[1] * gy);
            let (rx, ry) = (c.focal[0] * ex, c.focal[1] * ey);
            let scale = 1.0 / (ux * ux + uy * uy);
            let (sx, sy) = (along_x.sigma[i] * uy, along_y.sigma[i] * ux);
            let variance = (sx * sx + sy * sy) * scale + c.limits[1] * c.limits[1];
            met.residual[i] = (rx * uy - ry * ux) * scale.sqrt();
            met.allowed[i] = c.limits[0] * variance.sqrt();
        }
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2+fma"
))]
fn row(task: Task<'_>) {
    let curved = task.constants.distortion.iter().any(|&k| k != 0.0);
    match (task.x.is_some(), task.y.is_some(), curved) {
        (true, true, true) => stretches::<true, true, true>(task),
        (true, true, false) => stretches::<true, true, false>(task),
        (true, false, true) => stretches::<true, false, true>(task),
        (true, false, false) => stretches::<true, false, false>(task),
        (false, _, true) => stretches::<false, true, true>(task),
        (false, _, false) => stretches::<false, true, false>(task),
    }
}

#[inline(always)]
fn stretches<const X: bool, const Y: bool, const CURVED: bool>(task: Task<'_>) {
    let width = task.shape.1;
    let mut met = Met::new();
    let mut start = 0;
    while start < width {
        let range = start..(start + LANES).min(width);
        let stretch = Stretch {
            cubics: cubics(task.rig, start, task.row),
            variance: along(task.spread, task.shape, start, task.row),
            constants: task.constants,
        };
        let along_x = Seen::load(task.x, range.clone());
        let along_y = Seen::load(task.y, range.clone());
        meet::<X, Y, CURVED>(&stretch, &along_x, &along_y, &mut met);
        for (i, k) in range.clone().enumerate() {
            let before = match (task.x, task.y) {
                (Some(x), Some(y)) if x.reason[k] == reason::OK => y.reason[k],
                (Some(x), _) => x.reason[k],
                (None, Some(y)) => y.reason[k],
                (None, None) => reason::UNDETERMINED,
            };
            let apart = X && Y && !(met.residual[i].abs() <= met.allowed[i]);
            let finite = met.sigma[i] < f32::INFINITY;
            task.out.reason[k] = if before != reason::OK {
                before
            } else if !(met.front[i] > 0.0 && finite) {
                reason::BEYOND_GEOMETRY
            } else if apart {
                reason::RAYS_APART
            } else {
                reason::OK
            };
        }
        let n = range.len();
        let reasons = &task.out.reason[range.clone()];
        let keep = |i: usize, value: f32| {
            if reasons[i] == reason::OK {
                value
            } else {
                f32::NAN
            }
        };
        for i in 0..n {
            let k = 3 * (range.start + i);
            task.out.xyz[k] = keep(i, met.x[i]);
            task.out.xyz[k + 1] = keep(i, met.y[i]);
            task.out.xyz[k + 2] = keep(i, met.z[i]);
        }
        for i in 0..n {
            task.out.sigma[range.start + i] = keep(i, met.sigma[i]);
            task.out.noise[range.start + i] = keep(i, met.noise[i]);
        }
        if X && Y {
            // Also where the rays are apart: by how much is what one wants to see.
            for i in 0..n {
                let met_at_all = reasons[i] == reason::OK || reasons[i] == reason::RAYS_APART;
                task.out.residual[range.start + i] = if met_at_all {
                    met.residual[i]
                } else {
                    f32::NAN
                };
            }
        }
        start += LANES;
    }
}

/// Triangulate a frame of `shape` rows and columns from one axis or both.
pub fn triangulate(
    rig: &Rig,
    spread: &Spread,
    limits: &Limits,
    shape: (usize, usize),
    x: Option<Axis<'_>>,
    y: Option<Axis<'_>>,
    out: Points<'_>,
) -> Result<(), Error> {
    let (rows, width) = shape;
    let pixels = rows * width;
    check_value("axes", x.is_some() || y.is_some(), "one or two", "none")?;
    for axis in [x, y].into_iter().flatten() {
        check_length("coordinate", axis.coordinate.len(), pixels)?;
        check_length("sigma", axis.sigma.len(), pixels)?;
        check_length("reason", axis.reason.len(), pixels)?;
    }
    let both = x.is_some() && y.is_some();
    check_length("points", out.xyz.len(), 3 * pixels)?;
    check_length("sigma", out.sigma.len(), pixels)?;
    check_length("noise", out.noise.len(), pixels)?;
    check_length("reason", out.reason.len(), pixels)?;
    check_length(
        "residual",
        out.residual.len(),
        if both { pixels } else { 0 },
    )?;
    let nodes = spread.columns * spread.rows;
    check_length("spread", spread.coefficients.len(), nodes * POWERS)?;
    let enough = spread.columns >= 2 && spread.rows >= 2;
    check_value("spread", enough, "2 × 2 nodes or more", nodes)?;
    let known = if spread.along_x { x } else { y };
    check_value(
        "spread",
        known.is_some(),
        "an axis that is given",
        "the other",
    )?;
    if pixels == 0 {
        return Ok(());
    }
    let single = |v: f64| v as f32;
    let constants = Constants {
        focal: rig.projector.focal.map(single),
        principal: rig.projector.principal.map(single),
        distortion: rig.projector.distortion.map(single),
        translation: rig.translation.map(single),
        limits: [limits.residual_sigmas, limits.residual_px],
        along: (
            spread.along_x,
            1.0 / spread.length - 1.0,
            2.0 / spread.length,
        ),
    };
    let residual: Vec<&mut [f32]> = if both {
        out.residual.chunks_mut(width).collect()
    } else {
        (0..rows).map(|_| <&mut [f32]>::default()).collect()
    };
    fn part<'a>(axis: Option<Axis<'a>>, start: usize, width: usize) -> Option<Axis<'a>> {
        axis.map(|a| Axis {
            coordinate: &a.coordinate[start..start + width],
            sigma: &a.sigma[start..start + width],
            reason: &a.reason[start..start + width],
        })
    }
    out.xyz
        .par_chunks_mut(3 * width)
        .zip(out.sigma.par_chunks_mut(width))
        .zip(out.noise.par_chunks_mut(width))
        .zip(out.reason.par_chunks_mut(width))
        .zip(residual.into_par_iter())
        .enumerate()
        .for_each(|(k, ((((xyz, sigma), noise), reason), residual))| {
            row(Task {
                rig,
                constants: &constants,
                spread,
                shape,
                row: k,
                x: part(x, k * width, width),
                y: part(y, k * width, width),
                out: Points {
                    xyz,
                    sigma,
                    noise,
                    residual,
                    reason,
                },
            });
        });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_goes_through_its_values() {
        let values = [0.3, -0.1, 0.25, 0.7];
        let c = interpolate(values);
        for (node, value) in NODES.iter().zip(values) {
            let u = ((node - 31.5) / 32.0) as f32;
            assert!((f64::from(cubic(&c, u)) - value).abs() < 1e-6);
        }
    }

    #[test]
    fn powers_of_two_are_near() {
        for k in -1260..=1260 {
            let x = 0.1 * k as f32;
            let ratio = f64::from(power_of_two(x)) / f64::from(x).exp2();
            assert!((ratio - 1.0).abs() < 3e-4, "{x}: {ratio}");
        }
    }

    #[test]
    fn ray_inverts_the_distortion() {
        let lens = Lens {
            focal: [2000.0, 2010.0],
            principal: [640.0, 500.0],
            distortion: [-0.2, 0.1, 1e-3, -2e-3, 0.05],
        };
        let (x, y) = lens.ray(12.0, 900.0);
        let (xd, yd) = lens.distort(x, y);
        assert!((xd * 2000.0 + 640.0 - 12.0).abs() < 1e-8);
        assert!((yd * 2010.0 + 500.0 - 900.0).abs() < 1e-8);
    }
}
