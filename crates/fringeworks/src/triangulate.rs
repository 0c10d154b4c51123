//! From projector coordinates to points: each camera pixel's ray meets what the projector lights.
//!
//! The unknown of a pixel is w = 1/z along its ray. A point in the projector's coordinates, divided
//! by its depth z, is R r + w t: linear in w, so that without distortion one axis gives w in closed
//! form, and two give it by linear least squares. With distortion, Newton's method goes on from
//! there. Rays are cubics along short stretches of a row through four pixels whose distortion is
//! inverted in double precision.
//!
//! Where the processor fuses multiplication and addition, polynomials do; instruction sets agree to
//! rounding.

use crate::{check_length, check_value, reason, Error};
use rayon::prelude::*;

/// Pixels that are worked on together.
const LANES: usize = 32;
type Lanes = [f32; LANES];
/// Where on a stretch its rays are computed exactly.
const NODES: [f64; 4] = [1.0, 10.0, 21.0, 30.0];
/// Most corrections for a projector's distortion.
const NEWTON: usize = 5;
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

/// A cubic in (i − 15.5) / 16 along a stretch.
type Cubic = [f32; 4];

/// What is known of a stretch before anything is decoded.
struct Stretch {
    /// r_x, r_y, (R r)_x, (R r)_y, (R r)_z and |r|.
    rays: [Cubic; 6],
    /// Coefficients of the variance's logarithm at the first pixel, and their slopes per pixel.
    variance: [f32; POWERS],
    slope: [f32; POWERS],
}

/// A rig made ready for a camera's frame.
pub struct Triangulation {
    /// Rows and columns.
    shape: (usize, usize),
    /// Row by row, [`LANES`] pixels each.
    stretches: Vec<Stretch>,
    constants: Constants,
}

/// What all pixels share, in single precision.
struct Constants {
    focal: [f32; 2],
    principal: [f32; 2],
    distortion: [f32; 5],
    translation: [f32; 3],
    /// Newton's steps that the projector's distortion takes; 0 where there is none.
    steps: usize,
    /// Whether the spread goes along x, and its variable: offset and factor of the coordinate.
    along: (bool, f32, f32),
}

impl Triangulation {
    /// Make a rig ready: the camera's `shape` is rows and columns, the projector's `size` columns
    /// and rows.
    pub fn new(
        rig: &Rig,
        spread: &Spread,
        shape: (usize, usize),
        size: (usize, usize),
    ) -> Result<Self, Error> {
        let nodes = spread.columns * spread.rows;
        check_length("spread", spread.coefficients.len(), nodes * POWERS)?;
        let enough = spread.columns >= 2 && spread.rows >= 2;
        check_value("spread", enough, "2 × 2 nodes or more", nodes)?;
        let single = |v: f64| v as f32;
        let constants = Constants {
            focal: rig.projector.focal.map(single),
            principal: rig.projector.principal.map(single),
            distortion: rig.projector.distortion.map(single),
            translation: rig.translation.map(single),
            steps: steps(&rig.projector, size),
            along: (
                spread.along_x,
                1.0 / spread.length - 1.0,
                2.0 / spread.length,
            ),
        };
        let across = shape.1.div_ceil(LANES);
        let stretches = (0..shape.0 * across)
            .into_par_iter()
            .map(|k| {
                let (row, column) = (k / across, k % across * LANES);
                let (variance, slope) = along(spread, shape, column, row);
                Stretch {
                    rays: cubics(rig, column, row),
                    variance,
                    slope,
                }
            })
            .collect();
        Ok(Self {
            shape,
            stretches,
            constants,
        })
    }

    pub fn shape(&self) -> (usize, usize) {
        self.shape
    }
}

/// Newton's steps until distortion is inverted to single precision: each squares the error, which
/// is the distortion itself at first.
fn steps(lens: &Lens, size: (usize, usize)) -> usize {
    if lens.distortion.iter().all(|&k| k == 0.0) {
        return 0;
    }
    let mut largest = 0.0f64;
    for k in 0..=8 {
        for (u, v) in [(k, 0), (k, 8), (0, k), (8, k)] {
            let at = |n: usize, pixels: usize, axis: usize| {
                (n as f64 / 8.0 * pixels as f64 - lens.principal[axis]) / lens.focal[axis]
            };
            let (x, y) = (at(u, size.0, 0), at(v, size.1, 1));
            let (xd, yd) = lens.distort(x, y);
            largest = largest.max((xd - x).hypot(yd - y));
        }
    }
    // A point's depth and place change together: leave some room.
    let mut error = (4.0 * largest).min(0.9);
    let mut n = 0;
    while error > 1e-7 && n < NEWTON {
        error *= error;
        n += 1;
    }
    n.max(1)
}

fn cubics(rig: &Rig, column: usize, row: usize) -> [Cubic; 6] {
    let mut values = [[0.0; 4]; 6];
    for (k, node) in NODES.iter().enumerate() {
        let (x, y) = rig.camera.ray(column as f64 + node, row as f64);
        let r = &rig.rotation;
        let rotated = |k: usize| r[3 * k] * x + r[3 * k + 1] * y + r[3 * k + 2];
        let length = (x * x + y * y + 1.0).sqrt();
        for (line, value) in
            values
                .iter_mut()
                .zip([x, y, rotated(0), rotated(1), rotated(2), length])
        {
            line[k] = value;
        }
    }
    values.map(interpolate)
}

/// The cubic through four values at the nodes: Newton's divided differences, multiplied out.
fn interpolate(values: [f64; 4]) -> Cubic {
    let at = NODES.map(|n| (n - 15.5) / 16.0);
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
struct Task<'a> {
    plan: &'a Triangulation,
    limits: &'a Limits,
    row: usize,
    x: Option<Axis<'a>>,
    y: Option<Axis<'a>>,
    out: Points<'a>,
}

/// Coordinates and standard deviations of a stretch; NaN where there is none.
struct Seen {
    coordinate: Lanes,
    sigma: Lanes,
    reason: [u8; LANES],
}

impl Seen {
    const fn new() -> Self {
        Self {
            coordinate: [f32::NAN; LANES],
            sigma: [1.0; LANES],
            reason: [reason::OK; LANES],
        }
    }

    #[inline(always)]
    fn load(&mut self, axis: Axis<'_>, start: usize, n: usize) {
        let range = start..start + n;
        if n < LANES {
            *self = Self::new();
        }
        self.sigma[..n].copy_from_slice(&axis.sigma[range.clone()]);
        self.reason[..n].copy_from_slice(&axis.reason[range.clone()]);
        self.coordinate[..n].copy_from_slice(&axis.coordinate[range]);
        for i in 0..LANES {
            if self.reason[i] != reason::OK {
                self.coordinate[i] = f32::NAN;
            }
        }
    }
}

/// What a stretch comes to; NaN where the rays do not meet, or not in front of both devices.
struct Met {
    x: Lanes,
    y: Lanes,
    z: Lanes,
    sigma: Lanes,
    noise: Lanes,
    residual: Lanes,
    /// A reason per pixel.
    code: [u32; LANES],
}

impl Met {
    const fn new() -> Self {
        let line = [0.0; LANES];
        Self {
            x: line,
            y: line,
            z: line,
            sigma: line,
            noise: line,
            residual: line,
            code: [0; LANES],
        }
    }
}

/// a b + c, rounded once where the instruction set has that.
#[inline(always)]
fn fused<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA {
        a.mul_add(b, c)
    } else {
        a * b + c
    }
}

/// 2^x to 3e-4 for |x| ≤ 126, and the value at the end beyond.
#[inline(always)]
fn power_of_two<const FMA: bool>(x: f32) -> f32 {
    // Added to this, x is rounded, and its whole part lies in the lowest bits, biased as an
    // exponent is.
    const WHOLE: f32 = 12_582_912.0 + 127.0;
    let x = x.clamp(-126.0, 126.0);
    let shifted = x + WHOLE;
    let part = x - (shifted - WHOLE);
    let small = [0.055_5, 0.240_22, std::f32::consts::LN_2, 1.0]
        .into_iter()
        .fold(0.009_6, |sum, c| fused::<FMA>(sum, part, c));
    small * f32::from_bits(shifted.to_bits() << 23)
}

#[inline(always)]
fn cubic<const FMA: bool>(c: &Cubic, u: f32) -> f32 {
    let upper = fused::<FMA>(u, c[3], c[2]);
    fused::<FMA>(u, fused::<FMA>(u, upper, c[1]), c[0])
}

/// What the passes over a stretch hand on to each other. (One pass for everything would have a loop
/// of corrections inside the loop over pixels, which compilers do not turn into vectors.)
struct Work {
    rx: Lanes,
    ry: Lanes,
    length: Lanes,
    qx: Lanes,
    qy: Lanes,
    qz: Lanes,
    /// Directions on the projector's side.
    goal_x: Lanes,
    goal_y: Lanes,
    /// Standard deviations of the same, squared.
    variance_x: Lanes,
    variance_y: Lanes,
    w: Lanes,
    depth: Lanes,
    /// Derivatives of the direction by w, and what is left of the goal.
    gx: Lanes,
    gy: Lanes,
    ex: Lanes,
    ey: Lanes,
}

impl Work {
    const fn new() -> Self {
        let line = [0.0; LANES];
        Self {
            rx: line,
            ry: line,
            length: line,
            qx: line,
            qy: line,
            qz: line,
            goal_x: line,
            goal_y: line,
            variance_x: line,
            variance_y: line,
            w: line,
            depth: line,
            gx: line,
            gy: line,
            ex: line,
            ey: line,
        }
    }
}

/// Rays, goals, and w as it would be without distortion.
#[inline(always)]
fn begin<const X: bool, const Y: bool, const FMA: bool>(
    stretch: &Stretch,
    c: &Constants,
    along_x: &Seen,
    along_y: &Seen,
    k: &mut Work,
) {
    let rays = stretch.rays;
    let [t0, t1, t2] = c.translation;
    let (scale_x, scale_y) = (1.0 / c.focal[0], 1.0 / c.focal[1]);
    let [principal_x, principal_y] = c.principal;
    for i in 0..LANES {
        let u = (i as f32 - 15.5) * (1.0 / 16.0);
        k.rx[i] = cubic::<FMA>(&rays[0], u);
        k.ry[i] = cubic::<FMA>(&rays[1], u);
        let (qx, qy, qz) = (
            cubic::<FMA>(&rays[2], u),
            cubic::<FMA>(&rays[3], u),
            cubic::<FMA>(&rays[4], u),
        );
        k.length[i] = cubic::<FMA>(&rays[5], u);
        let (mut nx, mut dx, mut ny, mut dy) = (0.0, 0.0, 0.0, 0.0);
        if X {
            let goal = (along_x.coordinate[i] - principal_x) * scale_x;
            let sigma = along_x.sigma[i] * scale_x;
            (nx, dx) = (fused::<FMA>(goal, qz, -qx), fused::<FMA>(-goal, t2, t0));
            (k.goal_x[i], k.variance_x[i]) = (goal, sigma * sigma);
        }
        if Y {
            let goal = (along_y.coordinate[i] - principal_y) * scale_y;
            let sigma = along_y.sigma[i] * scale_y;
            (ny, dy) = (fused::<FMA>(goal, qz, -qy), fused::<FMA>(-goal, t2, t1));
            (k.goal_y[i], k.variance_y[i]) = (goal, sigma * sigma);
        }
        // n = w d for each axis; the weights have a factor in common that saves divisions.
        k.w[i] = if X && Y {
            let (weight_x, weight_y) = (k.variance_y[i], k.variance_x[i]);
            let (ax, ay) = (weight_x * dx, weight_y * dy);
            fused::<FMA>(ax, nx, ay * ny) / fused::<FMA>(ax, dx, ay * dy)
        } else if X {
            nx / dx
        } else {
            ny / dy
        };
        (k.qx[i], k.qy[i], k.qz[i]) = (qx, qy, qz);
    }
}

/// Derivatives at w, and, where the lens distorts, a step of Newton's.
#[inline(always)]
fn correct<const X: bool, const Y: bool, const FMA: bool, const CURVED: bool>(
    c: &Constants,
    k: &mut Work,
) {
    let [k1, k2, p1, p2, k3] = c.distortion;
    let [t0, t1, t2] = c.translation;
    for i in 0..LANES {
        let w = k.w[i];
        let depth = fused::<FMA>(w, t2, k.qz[i]);
        let inverse = 1.0 / depth;
        let x = fused::<FMA>(w, t0, k.qx[i]) * inverse;
        let y = fused::<FMA>(w, t1, k.qy[i]) * inverse;
        let by_x = fused::<FMA>(-x, t2, t0) * inverse;
        let by_y = fused::<FMA>(-y, t2, t1) * inverse;
        k.depth[i] = depth;
        if !CURVED {
            (k.gx[i], k.gy[i]) = (by_x, by_y);
            (k.ex[i], k.ey[i]) = (k.goal_x[i] - x, k.goal_y[i] - y);
            continue;
        }
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let r2 = xx + yy;
        let inner = fused::<FMA>(r2, k3, k2);
        let radial = fused::<FMA>(r2, fused::<FMA>(r2, inner, k1), 1.0);
        // 2 (k₁ + 2 k₂ r² + 3 k₃ r⁴)
        let outer = fused::<FMA>(3.0 * k3, r2, 2.0 * k2);
        let steep = 2.0 * fused::<FMA>(r2, outer, k1);
        let tangential = fused::<FMA>(2.0 * p1, x, 2.0 * p2 * y);
        let across = fused::<FMA>(xy, steep, tangential);
        let (mut gx, mut gy, mut ex, mut ey) = (0.0, 0.0, 0.0, 0.0);
        if X {
            let by = fused::<FMA>(xx, steep, radial);
            let by = fused::<FMA>(2.0 * p1, y, fused::<FMA>(6.0 * p2, x, by));
            gx = fused::<FMA>(by, by_x, across * by_y);
            let moved = fused::<FMA>(2.0 * p1, xy, p2 * fused::<FMA>(2.0, xx, r2));
            ex = k.goal_x[i] - fused::<FMA>(x, radial, moved);
        }
        if Y {
            let by = fused::<FMA>(yy, steep, radial);
            let by = fused::<FMA>(6.0 * p1, y, fused::<FMA>(2.0 * p2, x, by));
            gy = fused::<FMA>(across, by_x, by * by_y);
            let moved = fused::<FMA>(2.0 * p2, xy, p1 * fused::<FMA>(2.0, yy, r2));
            ey = k.goal_y[i] - fused::<FMA>(y, radial, moved);
        }
        let step = if X && Y {
            let (weight_x, weight_y) = (k.variance_y[i], k.variance_x[i]);
            let (ax, ay) = (weight_x * gx, weight_y * gy);
            fused::<FMA>(ax, ex, ay * ey) / fused::<FMA>(ax, gx, ay * gy)
        } else if X {
            ex / gx
        } else {
            ey / gy
        };
        k.w[i] = w + step;
        (k.gx[i], k.gy[i]) = (gx, gy);
        (k.ex[i], k.ey[i]) = (ex - gx * step, ey - gy * step);
    }
}

/// Points, their standard deviations, and reasons where there are none.
#[inline(always)]
fn finish<const X: bool, const Y: bool, const FMA: bool>(
    stretch: &Stretch,
    c: &Constants,
    limits: &Limits,
    place: &Seen,
    k: &Work,
    met: &mut Met,
) {
    let (base, slope) = (stretch.variance, stretch.slope);
    let (_, offset, factor) = c.along;
    let [focal_x, focal_y] = c.focal;
    let sigmas = limits.residual_sigmas * limits.residual_sigmas;
    let known = limits.residual_px * limits.residual_px;
    for i in 0..LANES {
        let z = 1.0 / k.w[i];
        let (gx, gy) = (k.gx[i], k.gy[i]);
        let (variance_x, variance_y) = (k.variance_x[i], k.variance_y[i]);
        let noise = if X && Y {
            variance_x * variance_y / (variance_y * gx * gx + variance_x * gy * gy)
        } else if X {
            variance_x / (gx * gx)
        } else {
            variance_y / (gy * gy)
        };
        let s = offset + factor * place.coordinate[i];
        let mut logarithm = 0.0;
        for n in (0..POWERS).rev() {
            let here = fused::<FMA>(i as f32, slope[n], base[n]);
            logarithm = fused::<FMA>(logarithm, s, here);
        }
        let to_mm = k.length[i] * z * z;
        let sigma = to_mm * (noise + power_of_two::<FMA>(logarithm)).sqrt();
        let front = (k.w[i] > 0.0) & (k.depth[i] > 0.0) & (sigma < f32::INFINITY);
        let mut near = true;
        if X && Y {
            // Across the epipolar line, in px.
            let (ux, uy) = (focal_x * gx, focal_y * gy);
            let (rx, ry) = (focal_x * k.ex[i], focal_y * k.ey[i]);
            let size = ux * ux + uy * uy;
            let off = rx * uy - ry * ux;
            let (sx, sy) = (focal_x * uy, focal_y * ux);
            let variance = variance_x * sx * sx + variance_y * sy * sy + known * size;
            near = off * off <= sigmas * variance;
            let residual = off / size.sqrt();
            met.residual[i] = if front { residual } else { f32::NAN };
        }
        let good = front & near;
        met.x[i] = if good { k.rx[i] * z } else { f32::NAN };
        met.y[i] = if good { k.ry[i] * z } else { f32::NAN };
        met.z[i] = if good { z } else { f32::NAN };
        met.noise[i] = if good { to_mm * noise.sqrt() } else { f32::NAN };
        met.sigma[i] = if good { sigma } else { f32::NAN };
        let apart = if near { OK } else { RAYS_APART };
        met.code[i] = if front { apart } else { BEYOND };
    }
}

const OK: u32 = reason::OK as u32;
const RAYS_APART: u32 = reason::RAYS_APART as u32;
const BEYOND: u32 = reason::BEYOND_GEOMETRY as u32;

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+fma",
    "x86_64+avx2+fma"
))]
fn row(task: Task<'_>) {
    if multiversion::target::target_cfg_f!(target_feature = "fma") {
        axes::<true>(task);
    } else {
        axes::<false>(task);
    }
}

#[inline(always)]
fn axes<const FMA: bool>(task: Task<'_>) {
    match (task.x.is_some(), task.y.is_some()) {
        (true, true) => stretches::<true, true, FMA>(task),
        (true, false) => stretches::<true, false, FMA>(task),
        _ => stretches::<false, true, FMA>(task),
    }
}

#[inline(always)]
fn stretches<const X: bool, const Y: bool, const FMA: bool>(task: Task<'_>) {
    let width = task.plan.shape.1;
    let across = width.div_ceil(LANES);
    let constants = &task.plan.constants;
    let (mut met, mut work) = (Met::new(), Work::new());
    let (mut along_x, mut along_y) = (Seen::new(), Seen::new());
    for k in 0..across {
        let start = k * LANES;
        let n = LANES.min(width - start);
        if let (true, Some(axis)) = (X, task.x) {
            along_x.load(axis, start, n);
        }
        if let (true, Some(axis)) = (Y, task.y) {
            along_y.load(axis, start, n);
        }
        let stretch = &task.plan.stretches[task.row * across + k];
        begin::<X, Y, FMA>(stretch, constants, &along_x, &along_y, &mut work);
        for _ in 0..constants.steps {
            correct::<X, Y, FMA, true>(constants, &mut work);
        }
        if constants.steps == 0 {
            correct::<X, Y, FMA, false>(constants, &mut work);
        }
        let place = if constants.along.0 {
            &along_x
        } else {
            &along_y
        };
        finish::<X, Y, FMA>(stretch, constants, task.limits, place, &work, &mut met);
        let mut codes = [0u8; LANES];
        for i in 0..LANES {
            // What decoding says comes first, and the columns before the rows.
            let columns = if X { along_x.reason[i] } else { reason::OK };
            let rows = if Y { along_y.reason[i] } else { reason::OK };
            let before = if columns != reason::OK { columns } else { rows };
            let here = met.code[i] as u8;
            codes[i] = if before != reason::OK { before } else { here };
        }
        let range = start..start + n;
        task.out.reason[range.clone()].copy_from_slice(&codes[..n]);
        task.out.sigma[range.clone()].copy_from_slice(&met.sigma[..n]);
        task.out.noise[range.clone()].copy_from_slice(&met.noise[..n]);
        if X && Y {
            task.out.residual[range].copy_from_slice(&met.residual[..n]);
        }
        let mut points = [0.0f32; 3 * LANES];
        for i in 0..LANES {
            points[3 * i] = met.x[i];
            points[3 * i + 1] = met.y[i];
            points[3 * i + 2] = met.z[i];
        }
        task.out.xyz[3 * start..3 * (start + n)].copy_from_slice(&points[..3 * n]);
    }
}

/// Triangulate a frame from one axis or both.
pub fn triangulate(
    plan: &Triangulation,
    limits: &Limits,
    x: Option<Axis<'_>>,
    y: Option<Axis<'_>>,
    out: Points<'_>,
) -> Result<(), Error> {
    let (rows, width) = plan.shape;
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
    let known = if plan.constants.along.0 { x } else { y };
    check_value(
        "spread",
        known.is_some(),
        "an axis that is given",
        "the other",
    )?;
    if pixels == 0 {
        return Ok(());
    }
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
                plan,
                limits,
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
            let u = ((node - 15.5) / 16.0) as f32;
            assert!((f64::from(cubic::<false>(&c, u)) - value).abs() < 1e-6);
        }
    }

    #[test]
    fn powers_of_two_are_near() {
        for k in -1260..=1260 {
            let x = 0.1 * k as f32;
            let ratio = f64::from(power_of_two::<false>(x)) / f64::from(x).exp2();
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
