//! Marked pixels, widened by a distance along both axes.

use crate::{Error, Image, check_columns};
use multiversion::multiversion;
use rayon::prelude::*;

/// Least number of rows that a task computes.
const BAND: usize = 128;

/// Mark what is within `reach` of a marked pixel along rows, columns and diagonals; pixels beyond the
/// border are not marked.
///
/// ```
/// use fringeworks::{Image, filters::widen};
///
/// let marks = Image::new(&[false, false, false, false, true], 1, 5)?;
/// assert_eq!(widen(marks, 2)?, [false, false, true, true, true]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn widen(marks: Image<bool>, reach: usize) -> Result<Vec<bool>, Error> {
    check_columns(marks)?;
    let (height, width) = marks.shape();
    let reach = reach.min(height.max(width));
    let mut out = vec![false; marks.len()];
    // Bands share the rows of their halos with their neighbours: tall ones compute few rows twice.
    let band = BAND.max(4 * reach);
    out.par_chunks_mut(band * width).enumerate().for_each_init(
        Marks::default,
        |near, (k, rows)| {
            let top = k * band;
            let known = top.saturating_sub(reach)..(top + band + reach).min(height);
            // Beyond the border, nothing is marked.
            let above = (reach - (top - known.start)) * width;
            let count = (rows.len() / width + 2 * reach) * width;
            near.fill(above, &marks[known.start * width..known.end * width], count);
            near.join(width, 2 * reach + 1);
            let mut along = Marks::default();
            for (row, near) in rows
                .chunks_exact_mut(width)
                .zip(near.now.chunks_exact(width))
            {
                along.fill(reach, near, width + 2 * reach);
                along.join(1, 2 * reach + 1);
                row.copy_from_slice(&along.now[..width]);
            }
        },
    );
    Ok(out)
}

/// Marks, in memory that is used again.
#[derive(Default)]
struct Marks {
    now: Vec<bool>,
    next: Vec<bool>,
}

impl Marks {
    /// Take `count` marks: some that are not set, given ones, and others that are not set.
    fn fill(&mut self, before: usize, marks: &[bool], count: usize) {
        self.now.clear();
        self.now.resize(before, false);
        self.now.extend_from_slice(marks);
        self.now.resize(count, false);
        self.next.resize(count, false);
    }

    /// Whether one of `side` marks is set that lie `stride` apart, from each mark on. Each pass
    /// doubles the number of marks that are looked at.
    fn join(&mut self, stride: usize, side: usize) {
        let mut seen = 1;
        while seen < side {
            let further = seen.min(side - seen);
            let n = self.now.len() - further * stride;
            either(
                &mut self.next[..n],
                &self.now[..n],
                &self.now[further * stride..],
            );
            self.now.truncate(n);
            self.next.truncate(n);
            std::mem::swap(&mut self.now, &mut self.next);
            seen += further;
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn either(out: &mut [bool], a: &[bool], b: &[bool]) {
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = *a | *b;
    }
}

#[cfg(test)]
mod tests {
    use super::widen;
    use crate::Image;

    #[test]
    fn marks_reach_as_far_as_asked() {
        let (h, w) = (300, 60);
        let places = [(0, 0), (150, 30), (131, 59), (299, 2)];
        let mut marks = vec![false; h * w];
        places.iter().for_each(|(y, x)| marks[y * w + x] = true);
        for reach in [0, 1, 2, 3, 8, 40, 1000] {
            let found = widen(Image::new(&marks, h, w).unwrap(), reach).unwrap();
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                let near = |p: &(usize, usize)| p.0.abs_diff(y).max(p.1.abs_diff(x)) <= reach;
                assert_eq!(found[y * w + x], places.iter().any(near), "{reach} {y} {x}");
            }
        }
        assert!(widen(Image::new(&[], 1, 0).unwrap(), 1).is_err());
    }
}
