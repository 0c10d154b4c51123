//! Cliffs: a window that straddles two surfaces fits neither.
//!
//! Pixels that are badly explained are offered the planes of well explained surfaces around them, and
//! take the one that explains a small patch much better.

use super::walls::distance_to;
use super::warp::Pair;
use crate::{Error, Image, check_shape};
use rayon::prelude::*;

/// Half-width of the patch that a surface has to explain, px: 7 × 7 px average the noise and still fit
/// beside a cliff.
const PATCH: usize = 3;

/// Half-width of the patch that a pixel on a wall is compared over, px.
const WALL_PATCH: usize = 2;

/// Half-width of the squares around a pixel on a wall in which surfaces are searched, px.
const WALL_REACH: usize = 3;

/// Increase of the cost of a surface with its squared distance, per px², that lets near ones win ties.
const DISTANCE_PRICE: f32 = 0.02;

/// Number of directions in which surfaces are searched.
const DIRECTIONS: usize = 16;

/// A model of the object frame, one value per pixel: what it shows is `offset + gain · s(x − u)`.
pub struct Surfaces<'a> {
    /// u, px.
    pub displacement: Image<'a, f32>,
    /// Level of the object above that of the model.
    pub offset: Image<'a, f32>,
    /// Modulation of the object over that of the model.
    pub gain: Image<'a, f32>,
}

/// Where surfaces are searched, and how far.
pub struct Search<'a> {
    /// 1 where the model explains the object, and its plane may be offered.
    pub clean: Image<'a, u8>,
    /// Mean squared residual of the patch around every pixel; a plane must stay below it. 0 where
    /// the pixel is not to be changed.
    pub present: Image<'a, f32>,
    /// Largest distance of a surface, px.
    pub reach: usize,
    /// Distance behind the first clean pixel at which a plane is taken, px.
    pub margin: usize,
    /// Base of the finite differences that give its slope, px.
    pub base: usize,
    /// Largest change of a displacement, px.
    pub max_change: f32,
    /// Difference below which a plane is taken for the best one so far, px.
    pub same: f32,
}

/// Displacement, offset and gain of every pixel.
pub type Maps = (Vec<f32>, Vec<f32>, Vec<f32>);

/// A plane through a pixel: displacement there, slope along x and y, offset and gain.
#[derive(Clone, Copy)]
struct Plane {
    u: f32,
    slope: [f32; 2],
    offset: f32,
    gain: f32,
}

/// Position in the frame.
type Pixel = (usize, usize);

impl Surfaces<'_> {
    fn check(&self, pair: &Pair) -> Result<(), Error> {
        pair.check()?;
        let shape = pair.object.shape();
        check_shape("displacement", self.displacement.shape(), shape)?;
        check_shape("offset", self.offset.shape(), shape)?;
        check_shape("gain", self.gain.shape(), shape)
    }

    fn plane(&self, pair: &Pair, search: &Search, (x, y): Pixel) -> Plane {
        let i = y * pair.width() + x;
        let u = self.displacement;
        // One-sided where the other side is not clean.
        let along = |position: usize, side: usize, step: usize| {
            let base = search.base;
            let before = position >= base && search.clean[i - base * step] > 0;
            let after = position + base < side && search.clean[i + base * step] > 0;
            match (before, after) {
                (true, true) => (u[i + base * step] - u[i - base * step]) / (2 * base) as f32,
                (true, false) => (u[i] - u[i - base * step]) / base as f32,
                (false, true) => (u[i + base * step] - u[i]) / base as f32,
                (false, false) => 0.0,
            }
        };
        Plane {
            u: u[i],
            slope: [
                along(x, pair.width(), 1),
                along(y, pair.height(), pair.width()),
            ],
            offset: self.offset[i],
            gain: self.gain[i],
        }
    }
}

impl Plane {
    /// The same plane, given at another pixel.
    fn moved(self, from: Pixel, to: Pixel) -> Self {
        let away = |a: usize, b: usize| b as f32 - a as f32;
        let [sx, sy] = self.slope;
        let u = self.u + sx * away(from.0, to.0) + sy * away(from.1, to.1);
        Self { u, ..self }
    }

    /// Mean squared residual of the patch around a pixel; `None` where it exceeds `most`, or fewer than
    /// half of the pixels have data.
    fn cost(&self, pair: &Pair, (x, y): Pixel, most: f32) -> Option<f32> {
        let side = 2 * PATCH + 1;
        let limit = most * (side * side) as f32;
        let (mut sum, mut count) = (0.0f32, 0usize);
        for py in y.saturating_sub(PATCH)..=(y + PATCH).min(pair.height() - 1) {
            let row = self.u + self.slope[1] * (py as f32 - y as f32);
            for px in x.saturating_sub(PATCH)..=(x + PATCH).min(pair.width() - 1) {
                let u = row + self.slope[0] * (px as f32 - x as f32);
                if let Some((value, _)) = pair.reference_at(px, py, u) {
                    let r = pair.object[py * pair.width() + px] - self.offset - self.gain * value;
                    sum += r * r;
                    count += 1;
                }
            }
            if sum > limit {
                return None;
            }
        }
        let mean = sum / count.max(1) as f32;
        (2 * count >= side * side && mean < most).then_some(mean)
    }
}

/// Unit vectors (x, y) of all directions.
fn directions() -> [(f32, f32); DIRECTIONS] {
    std::array::from_fn(|k| {
        let (y, x) = (k as f32 * std::f32::consts::TAU / DIRECTIONS as f32).sin_cos();
        (x, y)
    })
}

/// The clean pixel whose plane is offered along a direction.
fn found(
    pair: &Pair,
    search: &Search,
    distance: &[u16],
    (x, y): Pixel,
    (dx, dy): (f32, f32),
) -> Option<Pixel> {
    let at = |t: usize| {
        let qx = (x as f32 + t as f32 * dx).round();
        let qy = (y as f32 + t as f32 * dy).round();
        let inside =
            qx >= 0.0 && qy >= 0.0 && qx < pair.width() as f32 && qy < pair.height() as f32;
        inside.then_some((qx as usize, qy as usize))
    };
    let clean = |(x, y): Pixel| search.clean[y * pair.width() + x] > 0;
    let mut t = 1;
    while t < search.reach {
        let (qx, qy) = at(t)?;
        let away = distance[qy * pair.width() + qx] as usize;
        if away == 0 {
            return at(t + search.margin).filter(|q| clean(*q));
        }
        t += away;
    }
    None
}

/// Give every pixel whose present residual is above 0 the plane that leaves least of its patch.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::windowed::{Pair, Search, Surfaces, relocate_surfaces};
///
/// // Fringes of 20 px, displaced by 1.5 px; see `invert_windowed`.
/// # let wave = |x: f32| (std::f32::consts::TAU * x / 20.0).cos();
/// # let factor = 3.0 / (2.0 + wave(1.0));
/// # let (h, w) = (40, 60);
/// # let spline: Vec<f32> = (0..h * (w + 3)).map(|i| factor * wave((i % (w + 3)) as f32 - 1.0)).collect();
/// # let object: Vec<f32> = (0..h * w).map(|i| wave((i % w) as f32 - 1.5)).collect();
/// # let ok = vec![1; h * w];
/// # let pair = Pair {
/// #     spline: Image::new(&spline, h, w + 3)?,
/// #     object: Image::new(&object, h, w)?,
/// #     reference_ok: Image::new(&ok, h, w)?,
/// #     object_ok: Image::new(&ok, h, w)?,
/// #     albedo: None,
/// # };
/// // One pixel has a wrong displacement, and takes that of its neighbours.
/// let (mut u, mut clean, mut present) = (vec![1.5; h * w], vec![1; h * w], vec![0.0; h * w]);
/// let at = 20 * w + 30;
/// (u[at], clean[at], present[at]) = (4.0, 0, 0.5);
/// let surfaces = Surfaces {
///     displacement: Image::new(&u, h, w)?,
///     offset: Image::new(&[0.0; 2400], h, w)?,
///     gain: Image::new(&[1.0; 2400], h, w)?,
/// };
/// let search = Search {
///     clean: Image::new(&clean, h, w)?,
///     present: Image::new(&present, h, w)?,
///     reach: 10,
///     margin: 2,
///     base: 3,
///     max_change: 10.0,
///     same: 0.05,
/// };
/// let (displacement, _, _) = relocate_surfaces(&pair, &surfaces, &search)?;
/// assert!((displacement[at] - 1.5).abs() < 1e-3);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn relocate_surfaces(pair: &Pair, surfaces: &Surfaces, search: &Search) -> Result<Maps, Error> {
    surfaces.check(pair)?;
    check_shape("clean", search.clean.shape(), pair.object.shape())?;
    check_shape("present", search.present.shape(), pair.object.shape())?;
    let mut maps = (
        surfaces.displacement.to_vec(),
        surfaces.offset.to_vec(),
        surfaces.gain.to_vec(),
    );
    let ways = directions();
    let distance = distance_to(search.clean);
    let width = pair.width();
    (maps.0.par_chunks_mut(width))
        .zip(maps.1.par_chunks_mut(width))
        .zip(maps.2.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, ((u, offset), gain))| {
            for x in 0..width {
                let mut best = search.present[y * width + x];
                if best <= 0.0 {
                    continue;
                }
                let own = surfaces.displacement[y * width + x];
                let mut taken = f32::NAN;
                for way in ways {
                    let Some(from) = found(pair, search, &distance, (x, y), way) else {
                        continue;
                    };
                    let plane = surfaces.plane(pair, search, from).moved(from, (x, y));
                    let too_far = (plane.u - own).abs() > search.max_change;
                    if too_far || (plane.u - taken).abs() < search.same {
                        continue;
                    }
                    if let Some(cost) = plane.cost(pair, (x, y), best) {
                        (best, taken) = (cost, plane.u);
                        (u[x], offset[x], gain[x]) = (plane.u, plane.offset, plane.gain);
                    }
                }
            }
        });
    Ok(maps)
}

/// Index of the pixel beside the wall whose surface explains each pixel on a wall best; −1 for other
/// pixels, and where there is none.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::windowed::{Pair, Surfaces, wall_sides};
///
/// // Fringes of 20 px, displaced by 1.5 px; see `invert_windowed`.
/// # let wave = |x: f32| (std::f32::consts::TAU * x / 20.0).cos();
/// # let factor = 3.0 / (2.0 + wave(1.0));
/// # let (h, w) = (40, 60);
/// # let spline: Vec<f32> = (0..h * (w + 3)).map(|i| factor * wave((i % (w + 3)) as f32 - 1.0)).collect();
/// # let object: Vec<f32> = (0..h * w).map(|i| wave((i % w) as f32 - 1.5)).collect();
/// # let ok = vec![1; h * w];
/// # let pair = Pair {
/// #     spline: Image::new(&spline, h, w + 3)?,
/// #     object: Image::new(&object, h, w)?,
/// #     reference_ok: Image::new(&ok, h, w)?,
/// #     object_ok: Image::new(&ok, h, w)?,
/// #     albedo: None,
/// # };
/// // Left of a wall the displacement is right, and wrong on its other side.
/// let u: Vec<f32> = (0..h * w).map(|i| if i % w < 31 { 1.5 } else { 6.0 }).collect();
/// let walls: Vec<u8> = (0..h * w).map(|i| u8::from(i % w == 31)).collect();
/// let surfaces = Surfaces {
///     displacement: Image::new(&u, h, w)?,
///     offset: Image::new(&[0.0; 2400], h, w)?,
///     gain: Image::new(&[1.0; 2400], h, w)?,
/// };
/// let sides = wall_sides(&pair, &surfaces, Image::new(&walls, h, w)?)?;
/// assert_eq!(sides[20 * w], -1);
/// assert!(sides[20 * w + 31] % (w as i64) < 31);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn wall_sides(pair: &Pair, surfaces: &Surfaces, walls: Image<u8>) -> Result<Vec<i64>, Error> {
    surfaces.check(pair)?;
    check_shape("walls", walls.shape(), pair.object.shape())?;
    let mut out = vec![-1; walls.len()];
    let width = pair.width();
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (x, out) in out.iter_mut().enumerate() {
            if walls[y * width + x] > 0 {
                *out = best_side(pair, surfaces, &walls, (x, y)).map_or(-1, |i| i as i64);
            }
        }
    });
    Ok(out)
}

/// Pixels of the square around one, row after row.
fn square(pair: &Pair, (x, y): Pixel, half: usize) -> impl Iterator<Item = Pixel> {
    let columns = x.saturating_sub(half)..(x + half + 1).min(pair.width());
    (y.saturating_sub(half)..(y + half + 1).min(pair.height()))
        .flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

fn best_side(pair: &Pair, surfaces: &Surfaces, walls: &[u8], at: Pixel) -> Option<usize> {
    let index = |(x, y): Pixel| y * pair.width() + x;
    let mut best = (f32::INFINITY, None);
    for from in square(pair, at, WALL_REACH) {
        let i = index(from);
        let (u, offset, gain) = (
            surfaces.displacement[i],
            surfaces.offset[i],
            surfaces.gain[i],
        );
        if walls[i] > 0 || !(u + offset + gain).is_finite() {
            continue;
        }
        let (mut sum, mut count) = (0.0f32, 0u32);
        for (x, y) in square(pair, at, WALL_PATCH).filter(|p| walls[index(*p)] > 0) {
            if let Some((value, _)) = pair.reference_at(x, y, u) {
                sum += (pair.object[index((x, y))] - offset - gain * value).powi(2);
                count += 1;
            }
        }
        let away = from.0.abs_diff(at.0).pow(2) + from.1.abs_diff(at.1).pow(2);
        let cost = sum / count as f32 * (1.0 + DISTANCE_PRICE * away as f32);
        if count > 0 && cost < best.0 {
            best = (cost, Some(i));
        }
    }
    best.1
}
