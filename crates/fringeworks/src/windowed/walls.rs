//! Walls: pixels at a jump of the displacement, and maps that end there.

use super::moments::Window;
use crate::{Error, Image, check_columns, check_shape};
use rayon::prelude::*;

/// Half-width of a window that is summed cell by cell, in σ: beyond it, weights are below 0.05.
const REACH: f64 = 2.5;

/// Chessboard distance of every pixel from the nearest one that is not 0, px; very large without any.
pub fn distance_to(mask: Image<u8>) -> Vec<u16> {
    let (height, width) = mask.shape();
    let mut distance: Vec<u16> = mask
        .iter()
        .map(|w| if *w > 0 { 0 } else { u16::MAX - 1 })
        .collect();
    let step = |distance: &mut [u16], y: usize, x: usize, dy: isize| {
        let mut least = distance[y * width + x];
        let row = y as isize + dy;
        if row >= 0 && row < height as isize {
            for q in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                least = least.min(distance[row as usize * width + q] + 1);
            }
        }
        let side = x as isize + dy;
        if side >= 0 && side < width as isize {
            least = least.min(distance[y * width + side as usize] + 1);
        }
        distance[y * width + x] = least.min(u16::MAX - 1);
    };
    for y in 0..height {
        for x in 0..width {
            step(&mut distance, y, x, -1);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            step(&mut distance, y, x, 1);
        }
    }
    distance
}

/// Distance of every pixel from the nearest wall, in px along rows, columns and diagonals.
pub struct Walls<'a> {
    pub(super) mask: Image<'a, u8>,
    distance: Vec<u16>,
    /// Of the nearest pixel of every row.
    row_distance: Vec<u16>,
}

impl<'a> Walls<'a> {
    pub fn new(mask: Image<'a, u8>) -> Self {
        let distance = distance_to(mask);
        let least = |row: &[u16]| row.iter().copied().min().unwrap_or(u16::MAX);
        let row_distance = distance.chunks(mask.width()).map(least).collect();
        Self {
            mask,
            distance,
            row_distance,
        }
    }

    pub fn is_wall(&self, x: usize, y: usize) -> bool {
        self.mask.row(y)[x] > 0
    }

    /// A mask without the pixels of walls.
    pub fn without(&self, mask: &[u8]) -> Vec<u8> {
        let keep = |(value, wall): (&u8, &u8)| if *wall > 0 { 0 } else { *value };
        mask.iter().zip(self.mask.values()).map(keep).collect()
    }

    /// Whether a wall is within `reach` px.
    pub fn within(&self, x: usize, y: usize, reach: usize) -> bool {
        (self.distance[y * self.mask.width() + x] as usize) <= reach
    }

    /// Whether a wall is within `reach` px of any pixel of row `y`.
    pub fn row_within(&self, y: usize, reach: usize) -> bool {
        (self.row_distance[y] as usize) <= reach
    }

    /// Pixels that a node's window reaches, px.
    pub fn reach(window: &Window) -> usize {
        (REACH * window.sigma + 0.5) as usize
    }

    /// Pixel at the centre of a block, inside the frame.
    pub fn pixel_of(&self, block: usize, row: usize, column: usize) -> (usize, usize) {
        let middle = |i: usize| i * block + (block - 1) / 2;
        (
            middle(column).min(self.mask.width() - 1),
            middle(row).min(self.mask.height() - 1),
        )
    }

    /// Whether the straight line between two pixels meets no wall.
    pub fn open_between(&self, (x0, y0): (usize, usize), (x1, y1): (usize, usize)) -> bool {
        let (dx, dy) = (x1 as f32 - x0 as f32, y1 as f32 - y0 as f32);
        let length = dx.abs().max(dy.abs());
        let mut t = 0.0;
        while t < length {
            let (x, y) = (
                // Rounded: the coordinates are not negative.
                (x0 as f32 + dx * t / length + 0.5) as usize,
                (y0 as f32 + dy * t / length + 0.5) as usize,
            );
            let away = self.distance[y * self.mask.width() + x];
            if away == 0 {
                return false;
            }
            // No wall is nearer.
            t += away as f32;
        }
        !self.is_wall(x1, y1)
    }
}

/// Smooth a map like a Gaussian of σ `sigma` px that no wall lets through: implicit diffusion along
/// rows and columns in turn.
///
/// ```
/// use fringeworks::{Image, windowed::smooth_within_walls};
///
/// // A step of 10 beside a wall in the fourth column.
/// let row = Image::new(&[1.0, 3.0, 1.0, 0.0, 11.0, 13.0, 11.0], 1, 7)?;
/// let walls = Image::new(&[0, 0, 0, 1, 0, 0, 0], 1, 7)?;
/// let smooth = smooth_within_walls(row, walls, 5.0)?;
/// assert!(smooth[2] < 2.5 && smooth[4] > 10.5);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn smooth_within_walls(
    values: Image<f32>,
    walls: Image<u8>,
    sigma: f64,
) -> Result<Vec<f32>, Error> {
    check_columns(values)?;
    check_shape("walls", walls.shape(), values.shape())?;
    let (height, width) = values.shape();
    const ROUNDS: usize = 4;
    let tau = (0.5 * sigma * sigma / ROUNDS as f64) as f32;
    let walls_down = transposed(&walls, width);
    let mut map = values.to_vec();
    for _ in 0..ROUNDS {
        diffuse_rows(&mut map, &walls, width, tau);
        let mut down = transposed(&map, width);
        diffuse_rows(&mut down, &walls_down, height, tau);
        map = transposed(&down, height);
    }
    Ok(map)
}

fn transposed<T: Copy + Send + Sync>(values: &[T], width: usize) -> Vec<T> {
    let height = values.len() / width;
    (0..values.len())
        .into_par_iter()
        .with_min_len(height)
        .map(|i| values[i % height * width + i / height])
        .collect()
}

/// One implicit step of diffusion along every row (Thomas' algorithm).
fn diffuse_rows(map: &mut [f32], walls: &[u8], width: usize, tau: f32) {
    map.par_chunks_mut(width)
        .zip(walls.par_chunks(width))
        .for_each_init(
            || vec![0.0f32; width],
            |upper, (row, walls)| {
                let mut left = 0.0;
                for x in 0..width {
                    let open = x + 1 < width && walls[x] == 0 && walls[x + 1] == 0;
                    let right = if open { tau } else { 0.0 };
                    let (before, value) = match x {
                        0 => (0.0, 0.0),
                        _ => (upper[x - 1], row[x - 1]),
                    };
                    let pivot = 1.0 + left + right - left * before;
                    upper[x] = right / pivot;
                    row[x] = (row[x] + left * value) / pivot;
                    left = right;
                }
                for x in (0..width - 1).rev() {
                    row[x] += upper[x] * row[x + 1];
                }
            },
        );
}
