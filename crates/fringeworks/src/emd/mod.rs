//! Empirical mode decomposition of rows (Huang et al., Proc. R. Soc. A 454, 1998; theory §7).
//!
//! A row is the sum of its intrinsic mode functions (IMF), from fast to slow, and a residue. Sifting
//! finds an IMF: it subtracts the mean of the envelopes through maxima and minima until
//!
//! * (I) the numbers of extrema and of zero crossings differ by at most one, and
//! * (II) the root mean square of the envelopes' mean is below `flat` times that of the mode (Huang's
//!   standard deviation criterion).
//!
//! Sifting also ends when criterion II has held for `patience` sifts without criterion I, or after
//! `max_sifts`. The reason for `patience`: riding waves that never cross zero take tens of sifts,
//! which level the amplitude of the mode (Huang et al., Proc. R. Soc. A 459, 2003). The residue has at
//! most two extrema, or is the rest after `max_imfs` modes.

mod envelope;
mod line;

use crate::{Error, Image, check_columns, check_value};
use envelope::Envelopes;
use rayon::prelude::*;

/// How rows are sifted.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Largest number of modes per row.
    pub max_imfs: usize,
    /// Largest number of sifts per mode.
    pub max_sifts: usize,
    /// Threshold of criterion II, a ratio of root mean squares.
    pub flat: f64,
    /// Sifts after which criterion II alone suffices.
    pub patience: usize,
}

/// Modes and residues of all rows.
pub struct Decomposition {
    /// `imfs[(row · count + k) · width + x]`; rows with fewer modes are filled with zeros.
    pub imfs: Vec<f64>,
    /// Modes per row in `imfs`.
    pub count: usize,
    /// What the modes leave of every row.
    pub residue: Vec<f64>,
    /// Modes that each row has.
    pub counts: Vec<u32>,
    /// Rows with a mode that reached a limit before both criteria held.
    pub unfinished: usize,
}

/// Modes of a row that memory is reserved for: rows of a thousand samples have about this many.
const USUAL_IMFS: usize = 8;

/// Largest number of sifts that may be asked for; more only hides that sifting does not converge.
const MAX_SIFTS: usize = 10_000;

/// Largest number of modes that may be asked for; each mode halves the frequency about, so no row of
/// a frame has as many.
const MAX_IMFS: usize = 64;

/// Range of a residue, as a share of the row's largest value, below which it is rounding error.
const ROUNDING: f64 = 1e-13;

struct Row {
    imfs: Vec<f64>,
    residue: Vec<f64>,
    unfinished: bool,
}

fn check(rows: Image<f64>, options: &Options) -> Result<(), Error> {
    check_columns(rows)?;
    check_value(
        "rows",
        rows.iter().all(|v| v.is_finite()),
        "finite values",
        "NaN or infinity",
    )?;
    check_value(
        "max_sifts",
        (1..=MAX_SIFTS).contains(&options.max_sifts),
        "1 to 10000",
        options.max_sifts,
    )?;
    check_value(
        "max_imfs",
        (1..=MAX_IMFS).contains(&options.max_imfs),
        "1 to 64",
        options.max_imfs,
    )
}

/// Decompose every row of `rows`.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::emd::{Options, decompose_rows};
///
/// let options = Options { max_imfs: 8, max_sifts: 100, flat: 0.05, patience: 20 };
/// let row: Vec<f64> = (0..200).map(|x| (0.6 * x as f64).cos() + 3.0 * (0.07 * x as f64).cos()).collect();
/// let found = decompose_rows(Image::new(&row, 1, 200)?, &options)?;
/// assert!(found.count >= 2);
/// // The modes and the residue add up to the row.
/// let sum: f64 = (0..found.count).map(|k| found.imfs[k * 200 + 50]).sum();
/// assert!((sum + found.residue[50] - row[50]).abs() < 1e-12);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn decompose_rows(rows: Image<f64>, options: &Options) -> Result<Decomposition, Error> {
    check(rows, options)?;
    let width = rows.width();
    let sifted: Vec<Row> = rows
        .par_chunks(width)
        .map_init(
            || Envelopes::new(width),
            |envelopes, row| sift_row(row, envelopes, options),
        )
        .collect();
    let counts: Vec<u32> = sifted
        .iter()
        .map(|r| (r.imfs.len() / width) as u32)
        .collect();
    let count = counts.iter().max().map_or(0, |c| *c as usize);
    let mut imfs = vec![0.0; sifted.len() * count * width];
    let mut residue = Vec::with_capacity(rows.len());
    if count > 0 {
        imfs.par_chunks_mut(count * width)
            .zip(&sifted)
            .for_each(|(out, row)| out[..row.imfs.len()].copy_from_slice(&row.imfs));
    }
    for row in &sifted {
        residue.extend_from_slice(&row.residue);
    }
    Ok(Decomposition {
        imfs,
        count,
        residue,
        counts,
        unfinished: sifted.iter().filter(|r| r.unfinished).count(),
    })
}

/// Decompose one row.
fn sift_row(row: &[f64], envelopes: &mut Envelopes, options: &Options) -> Row {
    let mut residue = row.to_vec();
    let mut imfs = Vec::with_capacity(USUAL_IMFS * row.len());
    let mut unfinished = false;
    let largest = row.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let mut mode = vec![0.0; row.len()];
    for _ in 0..options.max_imfs {
        if !envelopes.find(&residue) || range(&residue) <= ROUNDING * largest {
            break;
        }
        mode.copy_from_slice(&residue);
        let (mut done, mut flat_for) = (false, 0);
        for _ in 0..options.max_sifts {
            envelopes.draw();
            if envelopes.is_flat(&mode, options.flat) {
                done = envelopes.is_even(&mode);
                if done || flat_for == options.patience {
                    break;
                }
                flat_for += 1;
            }
            envelopes.subtract_mean(&mut mode);
            if !envelopes.find(&mode) {
                // Without extrema there is nothing to sift.
                done = true;
                break;
            }
        }
        unfinished |= !done;
        for (r, m) in residue.iter_mut().zip(&mode) {
            *r -= m;
        }
        imfs.extend_from_slice(&mode);
    }
    Row {
        imfs,
        residue,
        unfinished,
    }
}

/// Largest minus smallest value.
fn range(row: &[f64]) -> f64 {
    let (low, high) = row
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    high - low
}

/// Upper and lower envelope of every row; both are NaN where a row has at most two extrema.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::emd::row_envelopes;
///
/// let row: Vec<f64> = (0..200).map(|x| 5.0 + 2.0 * (0.6 * x as f64).cos()).collect();
/// let (upper, lower) = row_envelopes(Image::new(&row, 1, 200)?)?;
/// assert!((upper[100] - 7.0).abs() < 0.2 && (lower[100] - 3.0).abs() < 0.2);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn row_envelopes(rows: Image<f64>) -> Result<(Vec<f64>, Vec<f64>), Error> {
    check_columns(rows)?;
    let width = rows.width();
    let mut upper = vec![f64::NAN; rows.len()];
    let mut lower = vec![f64::NAN; rows.len()];
    upper
        .par_chunks_mut(width)
        .zip(lower.par_chunks_mut(width))
        .zip(rows.par_chunks(width))
        .for_each_init(
            || Envelopes::new(width),
            |envelopes, ((upper, lower), row)| {
                if envelopes.find(row) {
                    envelopes.draw();
                    upper.copy_from_slice(envelopes.upper());
                    lower.copy_from_slice(envelopes.lower());
                }
            },
        );
    Ok((upper, lower))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: Options = Options {
        max_imfs: 20,
        max_sifts: 200,
        flat: 0.05,
        patience: 200,
    };

    #[test]
    fn two_tones_and_a_trend_come_apart() {
        let n = 800;
        let fast = |x: f64| (x * 0.5).cos();
        let slow = |x: f64| 3.0 * (x * 0.06 + 0.4).cos();
        let trend = |x: f64| 0.01 * x;
        let row: Vec<f64> = (0..n)
            .map(|x| fast(x as f64) + slow(x as f64) + trend(x as f64))
            .collect();
        let found = decompose_rows(Image::new(&row, 1, n).unwrap(), &OPTIONS).unwrap();
        for x in 100..n - 100 {
            let at = |k: usize| found.imfs[k * n + x];
            assert!((at(0) - fast(x as f64)).abs() < 0.1, "{x}: {}", at(0));
            assert!((at(1) - slow(x as f64)).abs() < 0.3, "{x}: {}", at(1));
        }
        for x in 0..n {
            let sum: f64 = (0..found.count).map(|k| found.imfs[k * n + x]).sum();
            assert!((sum + found.residue[x] - row[x]).abs() < 1e-12);
        }
    }

    #[test]
    fn rows_without_modes_are_their_own_residue() {
        for row in [
            vec![3.0; 40],
            (0..40).map(|x| x as f64).collect(),
            vec![1.0],
        ] {
            let found = decompose_rows(Image::new(&row, 1, row.len()).unwrap(), &OPTIONS).unwrap();
            assert_eq!(found.count, 0);
            assert_eq!(found.residue, row);
        }
        assert!(decompose_rows(Image::new(&[f64::NAN; 8], 1, 8).unwrap(), &OPTIONS).is_err());
    }
}
