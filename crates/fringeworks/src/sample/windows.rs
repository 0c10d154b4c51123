//! Windows without edges along lines across the fringes.

use super::quantile::median;
use crate::{Error, Image, check_columns, check_shape};
use std::f64::consts::TAU;

/// Phases along lines of equal length.
#[derive(Clone, Copy)]
pub struct Lines<'a> {
    /// Wrapped phase, turns.
    pub turns: Image<'a, f32>,
    /// Whether a pixel can be used.
    pub usable: Image<'a, bool>,
}

/// What windows are looked for.
#[derive(Clone, Copy)]
pub struct Wanted {
    /// Length of a window, fringes.
    pub fringes: f64,
    /// Smallest number of pixels that a window spans.
    pub least: usize,
    /// Largest number of pixels that it takes.
    pub most: usize,
    /// Smallest and largest number of windows.
    pub windows: (usize, usize),
    /// Change of the slope from pixel to pixel that is an edge, turns.
    pub jump: f32,
}

/// Windows of equal length.
pub struct Windows {
    /// Unwrapped phase of every window, rad.
    pub phase: Vec<f64>,
    /// Index of every pixel of every window.
    pub pixels: Vec<i64>,
    /// Pixels of a window.
    pub length: usize,
}

/// How windows lie along a line.
struct Layout {
    span: usize,
    stride: usize,
    count: usize,
    /// Distance of the starts of neighbouring windows.
    hop: usize,
}

/// Windows without edges; none where the lines hold too few whole fringes.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::sample::{Lines, Wanted, smooth_windows};
///
/// let turns: Vec<f32> = (0..400).map(|i| (0.11 * (i % 200) as f32).fract() - 0.5).collect();
/// let lines = Lines {
///     turns: Image::new(&turns, 2, 200)?,
///     usable: Image::new(&[true; 400], 2, 200)?,
/// };
/// let wanted = Wanted { fringes: 3.0, least: 16, most: 64, windows: (2, 5), jump: 0.2 };
/// let found = smooth_windows(lines, wanted)?.expect("there are some 20 fringes in a line");
/// assert_eq!(found.phase.len(), 5 * found.length);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn smooth_windows(lines: Lines, wanted: Wanted) -> Result<Option<Windows>, Error> {
    check_columns(lines.turns)?;
    check_shape("usable", lines.usable.shape(), lines.turns.shape())?;
    let slope = slopes(lines);
    let Some(layout) = layout(lines, &slope, wanted) else {
        return Ok(None);
    };
    let starts = whole_windows(lines, &slope, &layout, wanted.jump);
    if starts.len() < wanted.windows.0 {
        return Ok(None);
    }
    let mut found = Windows {
        phase: Vec::new(),
        pixels: Vec::new(),
        length: layout.count,
    };
    let total = starts.len().min(wanted.windows.1);
    // Evenly spread over all windows.
    let step = (starts.len() - 1) as f64 / (total.max(2) - 1) as f64;
    for k in 0..total {
        let last = total > 1 && k + 1 == total;
        let place = if last {
            starts.len() - 1
        } else {
            (k as f64 * step) as usize
        };
        let at = starts[place];
        found.add(lines, &slope, &layout, at);
    }
    Ok(Some(found))
}

/// Changes of the phase from every pixel to the next one of its line, less whole turns; 0 at the end.
fn slopes(lines: Lines) -> Vec<f32> {
    let mut out = vec![0.0; lines.turns.len()];
    let length = lines.turns.width();
    for (row, line) in out
        .chunks_exact_mut(length)
        .zip(lines.turns.chunks_exact(length))
    {
        differences(line, row);
    }
    out
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn differences(line: &[f32], out: &mut [f32]) {
    let n = line.len().max(1) - 1;
    let (here, next) = (&line[..n], &line[line.len() - n..]);
    for (i, slope) in out[..n].iter_mut().enumerate() {
        let change = next[i] - here[i];
        *slope = change - change.round_ties_even();
    }
}

fn layout(lines: Lines, slope: &[f32], wanted: Wanted) -> Option<Layout> {
    let length = lines.turns.width();
    let mut good = Vec::with_capacity(slope.len());
    for (row, usable) in slope
        .chunks_exact(length)
        .zip(lines.usable.chunks_exact(length))
    {
        let pairs = row.iter().zip(usable).zip(&usable[1..]);
        good.extend(pairs.filter_map(|((slope, a), b)| (*a && *b).then_some(*slope)));
    }
    if good.len() < wanted.least * wanted.windows.0 {
        return None;
    }
    // Signed: noise would make up for a slope that is hardly there.
    let per_pixel = median(&good).abs();
    if per_pixel.is_nan() || per_pixel * (length as f64) < wanted.fringes {
        return None;
    }
    let span = ((wanted.fringes / per_pixel).ceil() as usize).max(wanted.least);
    let stride = span.div_ceil(wanted.most);
    (span <= length).then(|| Layout {
        span,
        stride,
        count: span.div_ceil(stride),
        hop: (span / 2).max(1),
    })
}

/// Indices of the first pixels of windows without edges.
fn whole_windows(lines: Lines, slope: &[f32], layout: &Layout, jump: f32) -> Vec<usize> {
    let length = lines.turns.width();
    let mut starts = Vec::new();
    // Faults of a line before every pixel.
    let mut before = vec![0_u32; length + 1];
    for first in (0..lines.turns.len()).step_by(length) {
        let (usable, slope) = (&lines.usable[first..][..length], &slope[first..][..length]);
        for i in 0..length {
            let edge = i > 0 && i + 1 < length && (slope[i] - slope[i - 1]).abs() > jump;
            before[i + 1] = before[i] + u32::from(edge || !usable[i]);
        }
        let places = (0..=length - layout.span).step_by(layout.hop);
        let whole = places.filter(|at| before[at + layout.span] == before[*at]);
        starts.extend(whole.map(|at| first + at));
    }
    starts
}

impl Windows {
    /// Add the window that starts at a pixel.
    fn add(&mut self, lines: Lines, slope: &[f32], layout: &Layout, start: usize) {
        let end = (start / lines.turns.width() + 1) * lines.turns.width() - 1;
        let (mut at, mut turns) = (start, f64::from(lines.turns[start]));
        for k in 0..layout.count {
            let place = (start + k * layout.stride).min(end);
            while at < place {
                turns += f64::from(slope[at]);
                at += 1;
            }
            self.phase.push(TAU * turns);
            self.pixels.push(place as i64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WANTED: Wanted = Wanted {
        fringes: 3.0,
        least: 16,
        most: 64,
        windows: (2, 5),
        jump: 0.2,
    };

    #[test]
    fn windows_stay_clear_of_edges_and_unusable_pixels() {
        let length = 200;
        let turns: Vec<f32> = (0..2 * length)
            .map(|i| {
                let x = 0.11 * (i % length) as f32 + if i == 30 { 0.3 } else { 0.0 };
                x - x.round()
            })
            .collect();
        let mut usable = vec![true; turns.len()];
        usable[length..].fill(false);
        let lines = Lines {
            turns: Image::new(&turns, 2, length).unwrap(),
            usable: Image::new(&usable, 2, length).unwrap(),
        };
        let found = smooth_windows(lines, WANTED).unwrap().unwrap();
        assert_eq!(found.length, 28);
        assert_eq!(found.pixels.len(), 5 * 28);
        let clear = |i: &i64| *i < 200 && !(29..=31).contains(i);
        assert!(found.pixels.iter().all(clear));
        let rise = (found.phase[27] - found.phase[0]) / TAU;
        assert!((rise - 2.97).abs() < 1e-5);
    }

    #[test]
    fn too_few_fringes_have_no_windows() {
        let turns = vec![0.01; 400];
        let usable = vec![true; 400];
        let lines = Lines {
            turns: Image::new(&turns, 2, 200).unwrap(),
            usable: Image::new(&usable, 2, 200).unwrap(),
        };
        assert!(smooth_windows(lines, WANTED).unwrap().is_none());
    }
}
