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

/// Smallest determinant of the covariance of the places that a slope is fitted to, px⁴; that of 5 × 5
/// places is 4. Places along one line determine no slope across it.
const MIN_DETERMINANT: f32 = 0.05;

/// Rows that one task examines.
const BAND_ROWS: usize = 16;

/// Largest distance from a depth step at which pixels are told apart, px: three standard deviations of
/// the strongest usual blur.
pub const RINGS: usize = 4;

/// Places of the pixels that a coordinate is extrapolated from, px away from the step.
const BEYOND: (usize, usize) = (2, 3);

/// What the coordinates of neighbours are judged by.
#[derive(Clone, Copy)]
pub struct Steps {
    /// Difference from which on two coordinates belong to different surfaces, px.
    pub most: f32,
    /// Distance after which coordinates repeat, px, or infinity.
    pub repeats: f32,
}

/// Shift of every coordinate by blur of one px², ∇ln B · ∇u, and the squared slope |∇u|².
///
/// The slope is that of a plane through the neighbours of the same surface, by their variances. Both
/// results are 0 where no slope is known. `light` is ln B, NaN where unknown.
///
/// ```
/// use fringeworks::edges::{Steps, blur_shift};
/// use fringeworks::{Image, ImageMut};
///
/// let ramp: Vec<f32> = (0..400).map(|i| 1.5 * (i % 20) as f32).collect();
/// let light: Vec<f32> = (0..400).map(|i| 0.1 * (i % 20) as f32).collect();
/// let (mut shift, mut slope) = (vec![0.0; 400], vec![0.0; 400]);
/// blur_shift(
///     Image::new(&ramp, 20, 20)?,
///     Image::new(&[0.01; 400], 20, 20)?,
///     Image::new(&light, 20, 20)?,
///     Steps { most: 8.0, repeats: f32::INFINITY },
///     ImageMut::new(&mut shift, 20, 20)?,
///     ImageMut::new(&mut slope, 20, 20)?,
/// )?;
/// assert!((shift[210] - 0.15).abs() < 1e-4);
/// assert!((slope[210] - 2.25).abs() < 1e-4);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn blur_shift(
    coordinate: Image<f32>,
    sigma: Image<f32>,
    light: Image<f32>,
    steps: Steps,
    mut shift: ImageMut<f32>,
    mut slope: ImageMut<f32>,
) -> Result<(), Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    check_shape("light", light.shape(), coordinate.shape())?;
    check_shape("shift", shift.shape(), coordinate.shape())?;
    check_shape("slope", slope.shape(), coordinate.shape())?;
    check_value("most", steps.most > 0.0, "above 0 px", steps.most)?;
    if coordinate.is_empty() {
        return Ok(());
    }
    let (height, width) = coordinate.shape();
    let maps = Maps {
        coordinate: coordinate.values(),
        sigma: sigma.values(),
        light: light.values(),
        width,
        height,
    };
    let (circle, most) = (Circle::new(steps.repeats), steps.most);
    shift
        .par_chunks_mut(width)
        .zip(slope.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (shift, slope))| {
            for x in (0..width).step_by(BLOCK) {
                let n = BLOCK.min(width - x);
                let found = fit_block(&maps.window(x, y), circle, most);
                shift[x..x + n].copy_from_slice(&found.0[..n]);
                slope[x..x + n].copy_from_slice(&found.1[..n]);
            }
        });
    Ok(())
}

/// The maps of a frame.
struct Maps<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    light: &'a [f32],
    width: usize,
    height: usize,
}

/// Columns of a window: a block and what lies around it.
const COLUMNS: usize = BLOCK + 2 * REACH;

/// A block of pixels with its surroundings; NaN outside the frame.
struct Window {
    coordinate: [[f32; COLUMNS]; 2 * REACH + 1],
    sigma: [[f32; COLUMNS]; 2 * REACH + 1],
    light: [[f32; COLUMNS]; 2 * REACH + 1],
}

impl Maps<'_> {
    fn window(&self, x: usize, y: usize) -> Window {
        let nothing = [[f32::NAN; COLUMNS]; 2 * REACH + 1];
        let mut window = Window {
            coordinate: nothing,
            sigma: nothing,
            light: nothing,
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
                copy(&mut window.sigma[k], self.sigma);
                copy(&mut window.light[k], self.light);
            }
        }
        window
    }
}

/// Shifts and squared slopes of a block.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn fit_block(window: &Window, circle: Circle, most: f32) -> ([f32; BLOCK], [f32; BLOCK]) {
    let zero = [0.0f32; BLOCK];
    let [mut w, mut wx, mut wy, mut wxx, mut wxy] = [zero; 5];
    let [mut wyy, mut wu, mut wxu, mut wyu] = [zero; 4];
    let here: &[f32; BLOCK] = window.coordinate[REACH][REACH..][..BLOCK]
        .try_into()
        .unwrap_or(&zero);
    for k in 0..2 * REACH + 1 {
        let dy = k as f32 - REACH as f32;
        for j in 0..2 * REACH + 1 {
            let dx = j as f32 - REACH as f32;
            let there = &window.coordinate[k][j..][..BLOCK];
            let sigma = &window.sigma[k][j..][..BLOCK];
            for i in 0..BLOCK {
                let step = circle.difference(there[i], here[i]);
                // False where a coordinate is NaN.
                let same = step.abs() < most;
                let weight = if same {
                    1.0 / (sigma[i] * sigma[i])
                } else {
                    0.0
                };
                let u = if same { step } else { 0.0 };
                w[i] += weight;
                wx[i] += weight * dx;
                wy[i] += weight * dy;
                wxx[i] += weight * dx * dx;
                wxy[i] += weight * dx * dy;
                wyy[i] += weight * dy * dy;
                wu[i] += weight * u;
                wxu[i] += weight * u * dx;
                wyu[i] += weight * u * dy;
            }
        }
    }
    let (mut shift, mut slope) = (zero, zero);
    let right = &window.light[REACH][REACH + 1..][..BLOCK];
    let left = &window.light[REACH][REACH - 1..][..BLOCK];
    let middle = &window.light[REACH][REACH..][..BLOCK];
    let below = &window.light[REACH + 1][REACH..][..BLOCK];
    let above = &window.light[REACH - 1][REACH..][..BLOCK];
    for i in 0..BLOCK {
        let [x, y, u] = [wx[i] / w[i], wy[i] / w[i], wu[i] / w[i]];
        let [xx, xy, yy] = [
            wxx[i] / w[i] - x * x,
            wxy[i] / w[i] - x * y,
            wyy[i] / w[i] - y * y,
        ];
        let [xu, yu] = [wxu[i] / w[i] - x * u, wyu[i] / w[i] - y * u];
        let determinant = xx * yy - xy * xy;
        let along_x = (yy * xu - xy * yu) / determinant;
        let along_y = (xx * yu - xy * xu) / determinant;
        let found = along_x * change(left[i], middle[i], right[i])
            + along_y * change(above[i], middle[i], below[i]);
        // False for NaN.
        let known = (determinant > MIN_DETERMINANT) & (found.abs() < f32::INFINITY);
        shift[i] = if known { found } else { 0.0 };
        slope[i] = if known {
            along_x * along_x + along_y * along_y
        } else {
            0.0
        };
    }
    (shift, slope)
}

/// Slope of three values at distances of 1, of which one outer one may be NaN.
#[inline(always)]
fn change(before: f32, here: f32, after: f32) -> f32 {
    let (first, second) = (here - before, after - here);
    match (first.is_nan(), second.is_nan()) {
        (false, false) => 0.5 * (first + second),
        (true, _) => second,
        (false, true) => first,
    }
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
/// A step is where a coordinate differs by `most` or more from what the two pixels on the other side
/// extrapolate to. The error of a pixel shows in what the pixels 2 and 3 px behind it extrapolate to.
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
                nearest_step(here, at(-2), far, (self.circle, self.most), &mut nearest);
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
            inside.then_some(y as usize * self.width + x as usize)
        };
        let (Some(i), Some(near), Some(far)) = (at(0), at(BEYOND.0), at(BEYOND.1)) else {
            return;
        };
        let step = |k: usize| {
            self.circle
                .difference(self.coordinate[k], self.coordinate[i])
        };
        let error = 3.0 * step(near) - 2.0 * step(far);
        let square = |k: usize| self.sigma[k] * self.sigma[k];
        let noise = square(i) + 9.0 * square(near) + 4.0 * square(far);
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
/// `behind` is the row of the pixels 2 px behind, `far` are those 1 to 4 px ahead.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn nearest_step(
    here: &[f32],
    behind: &[f32],
    far: [&[f32]; RINGS],
    (circle, most): (Circle, f32),
    nearest: &mut [u8],
) {
    let n = nearest.len();
    let (here, behind) = (&here[..n], &behind[..n]);
    nearest.fill(0);
    for k in (0..RINGS).rev() {
        let (ahead, distance) = (&far[k][..n], (k + 1) as f32);
        for i in 0..n {
            let slope = 0.5 * circle.difference(here[i], behind[i]);
            let off = circle.difference(ahead[i], here[i]) - distance * slope;
            // False for NaN.
            nearest[i] = if off.abs() >= most {
                k as u8 + 1
            } else {
                nearest[i]
            };
        }
    }
}
