//! Errors of coordinates beside edges: where a blurred pixel mixes the light of unlike surfaces.
//!
//! Blur of a Gaussian variance v mixes the fringes of neighbouring pixels by their modulation B. To the
//! first order it shifts the coordinate u by v ∇ln B · ∇u, towards the brighter side. Beside a depth
//! step it mixes two coordinates, and the shift depends on both.

use crate::isolated::Circle;
use crate::{Error, Image, ImageMut, check_shape, check_value};
use rayon::prelude::*;

/// Pixels around one that its slope is fitted to, to each side: 5 × 5 px hold a slope to 0.14 of a
/// pixel's noise.
const REACH: usize = 2;

/// Pixels of a row that are fitted together, as one block for the vector unit.
const BLOCK: usize = 64;

/// Pixels whose sums are kept in registers at once.
const LANES: usize = 16;

/// Smallest determinant of the covariance of the places that a slope is fitted to, px⁴; that of 5 × 5
/// places is 4. Places along one line determine no slope across it.
const MIN_DETERMINANT: f32 = 0.05;

/// Rows that one task examines.
const BAND_ROWS: usize = 16;

/// Largest distance from a depth step at which pixels are told apart, px: three standard deviations of
/// the strongest usual blur.
pub const RINGS: usize = 4;

/// Places of the pixels that a coordinate is extrapolated from, px away from the step, and the weights
/// of the parabola that fits them best: the rims of round bodies are curved. It passes on 3.1 times the
/// noise of a pixel; that through three of them, 10 times.
const BEYOND: [(usize, f32); 6] = [
    (2, 33.0 / 14.0),
    (3, 17.0 / 70.0),
    (4, -33.0 / 35.0),
    (5, -6.0 / 5.0),
    (6, -37.0 / 70.0),
    (7, 15.0 / 14.0),
];

/// What the coordinates of neighbours are judged by.
#[derive(Clone, Copy)]
pub struct Steps {
    /// Difference from which on two coordinates belong to different surfaces, px.
    pub most: f32,
    /// Distance after which coordinates repeat, px, or infinity.
    pub repeats: f32,
}

/// Light of a surface, and the shift that its blur makes.
pub struct Light<'a> {
    /// Logarithm of the light, NaN where unknown.
    pub light: Image<'a, f32>,
    /// Shift of every coordinate by blur of one px².
    pub shift: ImageMut<'a, f32>,
}

/// Shift of every coordinate by blur of one px², ∇ln B · ∇u, for two kinds of light, and the squared
/// slope |∇u|².
///
/// The slope is that of a plane through the neighbours of the same surface, by their variances. All
/// results are 0 where no slope is known, and in places where neither light changes by `faint` or more
/// from pixel to pixel.
///
/// ```
/// use fringeworks::edges::{Light, Steps, blur_shift};
/// use fringeworks::{Image, ImageMut};
///
/// let ramp: Vec<f32> = (0..400).map(|i| 1.5 * (i % 20) as f32).collect();
/// let light: Vec<f32> = (0..400).map(|i| 0.1 * (i % 20) as f32).collect();
/// let [mut shift, mut other, mut slope] = [vec![0.0; 400], vec![0.0; 400], vec![0.0; 400]];
/// let of = |shift| -> Result<_, fringeworks::Error> {
///     Ok(Light { light: Image::new(&light, 20, 20)?, shift: ImageMut::new(shift, 20, 20)? })
/// };
/// blur_shift(
///     Image::new(&ramp, 20, 20)?,
///     Image::new(&[0.01; 400], 20, 20)?,
///     [of(&mut shift)?, of(&mut other)?],
///     (Steps { most: 8.0, repeats: f32::INFINITY }, 0.0),
///     ImageMut::new(&mut slope, 20, 20)?,
/// )?;
/// assert!((shift[210] - 0.15).abs() < 1e-4);
/// assert!((slope[210] - 2.25).abs() < 1e-4);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn blur_shift(
    coordinate: Image<f32>,
    sigma: Image<f32>,
    lights: [Light; 2],
    (steps, faint): (Steps, f32),
    mut slope: ImageMut<f32>,
) -> Result<(), Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    let [mut first, mut second] = lights;
    for light in [&first, &second] {
        check_shape("light", light.light.shape(), coordinate.shape())?;
        check_shape("shift", light.shift.shape(), coordinate.shape())?;
    }
    check_shape("slope", slope.shape(), coordinate.shape())?;
    check_value("most", steps.most > 0.0, "above 0 px", steps.most)?;
    check_value("faint", faint >= 0.0, "0 or more", faint)?;
    if coordinate.is_empty() {
        return Ok(());
    }
    let (height, width) = coordinate.shape();
    let maps = Maps {
        coordinate: coordinate.values(),
        sigma: sigma.values(),
        lights: [first.light.values(), second.light.values()],
        width,
        height,
    };
    let limits = (Circle::new(steps.repeats), steps.most, faint);
    let shifts = first
        .shift
        .par_chunks_mut(width)
        .zip(second.shift.par_chunks_mut(width));
    shifts
        .zip(slope.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, ((first, second), slope))| maps.fit_row(y, limits, [first, second, slope]));
    Ok(())
}

/// The maps of a frame.
struct Maps<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    lights: [&'a [f32]; 2],
    width: usize,
    height: usize,
}

/// Columns of a window: a block and what lies around it.
const COLUMNS: usize = BLOCK + 2 * REACH;

/// A block of pixels with its surroundings; NaN outside the frame.
struct Window {
    coordinate: [[f32; COLUMNS]; 2 * REACH + 1],
    /// Inverse variance.
    weight: [[f32; COLUMNS]; 2 * REACH + 1],
    lights: [[[f32; COLUMNS]; 2 * REACH + 1]; 2],
}

impl Maps<'_> {
    /// Both shifts and the squared slope of a row, in blocks.
    fn fit_row(&self, y: usize, (circle, most, faint): (Circle, f32, f32), out: [&mut [f32]; 3]) {
        let [first, second, slope] = out;
        for x in (0..self.width).step_by(BLOCK) {
            let n = BLOCK.min(self.width - x);
            let found = fit_block(&self.window(x, y), circle, (most, faint));
            first[x..x + n].copy_from_slice(&found[0][..n]);
            second[x..x + n].copy_from_slice(&found[1][..n]);
            slope[x..x + n].copy_from_slice(&found[2][..n]);
        }
    }

    fn window(&self, x: usize, y: usize) -> Window {
        let nothing = [[f32::NAN; COLUMNS]; 2 * REACH + 1];
        let mut window = Window {
            coordinate: nothing,
            weight: nothing,
            lights: [nothing; 2],
        };
        let (left, right) = (x.saturating_sub(REACH), (x + BLOCK + REACH).min(self.width));
        let (start, n) = (left + REACH - x, right - left);
        for k in 0..2 * REACH + 1 {
            if y + k >= REACH && y + k < self.height + REACH {
                let from = (y + k - REACH) * self.width + left;
                let copy = |row: &mut [f32; COLUMNS], map: &[f32]| {
                    row[start..start + n].copy_from_slice(&map[from..from + n]);
                };
                copy(&mut window.coordinate[k], self.coordinate);
                copy(&mut window.weight[k], self.sigma);
                for (row, light) in window.lights.iter_mut().zip(self.lights) {
                    copy(&mut row[k], light);
                }
            }
        }
        for weight in window.weight.as_flattened_mut() {
            *weight = 1.0 / (*weight * *weight);
        }
        window
    }
}

/// Both shifts and the squared slopes of a block.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn fit_block(window: &Window, circle: Circle, (most, faint): (f32, f32)) -> [[f32; BLOCK]; 3] {
    let mut found = [[0.0; BLOCK]; 3];
    let rises = [0, 1].map(|kind| {
        let light = |k: usize, j: usize| &window.lights[kind][k][j..][..BLOCK];
        let middle = light(REACH, REACH);
        let along_x = changes(light(REACH, REACH - 1), middle, light(REACH, REACH + 1));
        let along_y = changes(light(REACH - 1, REACH), middle, light(REACH + 1, REACH));
        [along_x, along_y]
    });
    for first in (0..BLOCK).step_by(LANES) {
        // False for NaN.
        let clear = |values: &[f32; BLOCK]| {
            values[first..][..LANES]
                .iter()
                .fold(false, |some, v| some | (v.abs() >= faint))
        };
        let here = &window.coordinate[REACH][REACH + first..][..LANES];
        if here.iter().all(|u| u.is_nan()) || !rises.as_flattened().iter().any(clear) {
            continue;
        }
        let moments = moments_of(window, first, circle, most);
        for lane in 0..LANES {
            let i = first + lane;
            let (x, y, determinant) = plane_of(&moments, lane);
            let known = determinant > MIN_DETERMINANT;
            for (shift, [along_x, along_y]) in found.iter_mut().zip(&rises) {
                let moved = x * along_x[i] + y * along_y[i];
                // False for NaN.
                let seen = known & (moved.abs() < f32::INFINITY);
                shift[i] = if seen { moved } else { 0.0 };
            }
            let seen = known & (found[0][i] != 0.0);
            found[2][i] = if seen { x * x + y * y } else { 0.0 };
        }
    }
    found
}

/// Slopes of values at distances of 1, of which one outer one may be NaN.
#[inline(always)]
fn changes(before: &[f32], here: &[f32], after: &[f32]) -> [f32; BLOCK] {
    let mut slopes = [0.0; BLOCK];
    for (i, slope) in slopes.iter_mut().enumerate() {
        let (first, second) = (here[i] - before[i], after[i] - here[i]);
        let left = if first.is_nan() { second } else { first };
        let right = if second.is_nan() { first } else { second };
        *slope = 0.5 * (left + right);
    }
    slopes
}

/// Weighted sums over the neighbours of the same surface, for some pixels of a block: 1, x, y, x², xy,
/// y², u, xu and yu, where u is the difference of the coordinate.
#[inline(always)]
fn moments_of(window: &Window, first: usize, circle: Circle, most: f32) -> [[f32; LANES]; 9] {
    let [mut w, mut wx, mut wy, mut wxx, mut wxy] = [[0.0; LANES]; 5];
    let [mut wyy, mut wu, mut wxu, mut wyu] = [[0.0; LANES]; 4];
    let here = lanes(&window.coordinate[REACH], REACH + first);
    for k in 0..2 * REACH + 1 {
        for j in 0..2 * REACH + 1 {
            let (x, y) = (j as f32 - REACH as f32, k as f32 - REACH as f32);
            let there = lanes(&window.coordinate[k], j + first);
            let weights = lanes(&window.weight[k], j + first);
            for i in 0..LANES {
                let step = circle.difference(there[i], here[i]);
                // False where a coordinate is NaN.
                let same = step.abs() < most;
                let weight = if same { weights[i] } else { 0.0 };
                let rise = weight * if same { step } else { 0.0 };
                w[i] += weight;
                wx[i] += x * weight;
                wy[i] += y * weight;
                wxx[i] += x * x * weight;
                wxy[i] += x * y * weight;
                wyy[i] += y * y * weight;
                wu[i] += rise;
                wxu[i] += x * rise;
                wyu[i] += y * rise;
            }
        }
    }
    [w, wx, wy, wxx, wxy, wyy, wu, wxu, wyu]
}

/// Some values of a row.
#[inline(always)]
fn lanes(row: &[f32; COLUMNS], first: usize) -> [f32; LANES] {
    let mut values = [0.0; LANES];
    values.copy_from_slice(&row[first..][..LANES]);
    values
}

/// Slopes of the plane with the moments of a lane, and the determinant of the covariance of the places.
#[inline(always)]
fn plane_of(moments: &[[f32; LANES]; 9], lane: usize) -> (f32, f32, f32) {
    let scale = 1.0 / moments[0][lane];
    let mean = |sum: usize| scale * moments[sum][lane];
    let (x, y, u) = (mean(1), mean(2), mean(6));
    let (xx, xy, yy) = (mean(3) - x * x, mean(4) - x * y, mean(5) - y * y);
    let (xu, yu) = (mean(7) - x * u, mean(8) - y * u);
    let determinant = xx * yy - xy * xy;
    let inverse = 1.0 / determinant;
    let along_x = inverse * (yy * xu - xy * yu);
    let along_y = inverse * (xx * yu - xy * xu);
    (along_x, along_y, determinant)
}

/// Squared errors of the pixels at one distance from depth steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ring {
    /// Number of extrapolated pixels.
    pub count: f64,
    /// Sum of their squared distances from what the pixels behind them extrapolate to, less what noise
    /// makes of it, px².
    pub sum: f64,
    /// Sum of the squares of these, px⁴.
    pub squares: f64,
}

/// Distance of every pixel from the next depth step along its row and its column, px: 1 to [`RINGS`], or
/// 0 beyond; and the errors of the pixels at every distance.
///
/// A step is where a coordinate differs by `most` or more from what two smooth pixels on the other side
/// extrapolate to; where these are not smooth, by twice as much from the pixel itself. The error of a
/// pixel shows in what the pixels 2 to 7 px behind it extrapolate to.
///
/// ```
/// use fringeworks::edges::{Steps, edge_rings};
/// use fringeworks::{Image, ImageMut};
///
/// let wall: Vec<f32> = (0..400)
///     .map(|i| if i % 20 < 10 { 0.0 } else { 30.0 } + (i % 20) as f32)
///     .collect();
/// let mut rings = vec![0; 400];
/// edge_rings(
///     Image::new(&wall, 20, 20)?,
///     Image::new(&[0.01; 400], 20, 20)?,
///     Steps { most: 4.0, repeats: f32::INFINITY },
///     ImageMut::new(&mut rings, 20, 20)?,
/// )?;
/// assert_eq!(rings[205..215], [0, 4, 3, 2, 1, 1, 2, 3, 4, 0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn edge_rings(
    coordinate: Image<f32>,
    sigma: Image<f32>,
    steps: Steps,
    mut rings: ImageMut<u8>,
) -> Result<[Ring; RINGS], Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    check_shape("rings", rings.shape(), coordinate.shape())?;
    check_value("most", steps.most > 0.0, "above 0 px", steps.most)?;
    let mut total = [Ring::default(); RINGS];
    if coordinate.is_empty() {
        return Ok(total);
    }
    let (height, width) = coordinate.shape();
    let map = Surface {
        coordinate: coordinate.values(),
        sigma: sigma.values(),
        width,
        height,
        circle: Circle::new(steps.repeats),
        most: steps.most,
    };
    let found: Vec<[Ring; RINGS]> = rings
        .par_chunks_mut(BAND_ROWS * width)
        .enumerate()
        .map(|(band, out)| map.rings_of(band * BAND_ROWS, out))
        .collect();
    for part in found {
        for (ring, add) in total.iter_mut().zip(part) {
            ring.count += add.count;
            ring.sum += add.sum;
            ring.squares += add.squares;
        }
    }
    Ok(total)
}

/// A map of coordinates.
struct Surface<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    width: usize,
    height: usize,
    circle: Circle,
    most: f32,
}

impl Surface<'_> {
    /// Rings of some rows, and their sums.
    fn rings_of(&self, top: usize, out: &mut [u8]) -> [Ring; RINGS] {
        let mut sums = [Ring::default(); RINGS];
        let nothing = vec![f32::NAN; self.width];
        let mut padded = vec![f32::NAN; self.width + 2 * RINGS];
        let mut nearest = vec![0; self.width];
        for (y, rings) in (top..).zip(out.chunks_mut(self.width)) {
            let row = |y: isize| match usize::try_from(y) {
                Ok(y) if y < self.height => &self.coordinate[y * self.width..][..self.width],
                _ => &nothing,
            };
            let here = row(y as isize);
            padded[RINGS..RINGS + self.width].copy_from_slice(here);
            rings.fill(0);
            for (dy, dx) in [(0isize, 1isize), (0, -1), (1, 0), (-1, 0)] {
                let at = |k: isize| {
                    if dy == 0 {
                        &padded[RINGS.wrapping_add_signed(k * dx)..][..self.width]
                    } else {
                        row(y as isize + k * dy)
                    }
                };
                let far = [1, 2, 3, 4].map(&at);
                nearest_step(
                    here,
                    [at(-1), at(-2)],
                    far,
                    (self.circle, self.most),
                    &mut nearest,
                );
                for x in 0..self.width {
                    if nearest[x] > 0 {
                        let k = nearest[x];
                        rings[x] = if rings[x] == 0 { k } else { rings[x].min(k) };
                        self.add_error((y, x), (dy, dx), &mut sums[k as usize - 1]);
                    }
                }
            }
        }
        sums
    }

    /// Add the error of a pixel with a step in a direction.
    fn add_error(&self, (y, x): (usize, usize), (dy, dx): (isize, isize), ring: &mut Ring) {
        let at = |k: usize| {
            let (y, x) = (y as isize - k as isize * dy, x as isize - k as isize * dx);
            let inside =
                (0..self.height as isize).contains(&y) && (0..self.width as isize).contains(&x);
            inside.then(|| y as usize * self.width + x as usize)
        };
        let Some(i) = at(0) else { return };
        let square = |k: usize| self.sigma[k] * self.sigma[k];
        let (mut error, mut noise) = (0.0, square(i));
        for (distance, weight) in BEYOND {
            let Some(k) = at(distance) else { return };
            error += weight
                * self
                    .circle
                    .difference(self.coordinate[k], self.coordinate[i]);
            noise += weight * weight * square(k);
        }
        // False for NaN.
        if error.abs() < self.most {
            let excess = f64::from(error * error - noise);
            ring.count += 1.0;
            ring.sum += excess;
            ring.squares += excess * excess;
        }
    }
}

/// Distance of the nearest step in one direction, for every pixel of a row; 0 for none within reach.
/// `behind` are the rows of the pixels 1 and 2 px behind, from which a smooth surface is extrapolated;
/// `far` are those 1 to 4 px ahead.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn nearest_step(
    here: &[f32],
    behind: [&[f32]; 2],
    far: [&[f32]; RINGS],
    (circle, most): (Circle, f32),
    nearest: &mut [u8],
) {
    let n = nearest.len();
    let (here, next, behind) = (&here[..n], &behind[0][..n], &behind[1][..n]);
    nearest.fill(0);
    for k in (0..RINGS).rev() {
        let (ahead, distance) = (&far[k][..n], (k + 1) as f32);
        for i in 0..n {
            let slope = 0.5 * circle.difference(here[i], behind[i]);
            let rise = circle.difference(ahead[i], here[i]);
            let bend = circle.difference(here[i], next[i]) - slope;
            // False for NaN.
            let smooth = bend.abs() < 0.5 * most;
            let step = if smooth {
                (rise - distance * slope).abs() >= most
            } else {
                rise.abs() >= 2.0 * most
            };
            nearest[i] = if step { k as u8 + 1 } else { nearest[i] };
        }
    }
}
