//! Fringe orders of pixels that noise leaves ambiguous, with the help of their neighbours.
//!
//! One pixel's phases determine its fringe order only where their noise is small against the margin of
//! the plan. On a smooth surface neighbours have the same order, up to the turns of the finest phase that
//! lie between them, and these are known: the finest phase changes by less than half a turn from pixel
//! to pixel. So the phases of a window, less the share that the finest phase explains, are samples of the
//! same constants, and their means have the noise of one phase over the square root of their number.
//!
//! 1. The mean of the window around every pixel votes for an order: the posterior over all orders in the
//!    range (`orders`). A vote counts if all other orders together are improbable, if the means fit the
//!    order within their errors, and if the pixel itself does not contradict it.
//! 2. A window across a depth step fits no order. Its pixel gets the order of the votes next to it that
//!    its finest phase continues (`spread`); where these differ, its next neighbours decide.
//!
//! With a Gray code it is the cells of the window that decide (`cells`).
//!
//! The finest phase does not show a step of a whole period. The other phases do: such a window fits no
//! order, so no order crosses the step unseen.

mod ballot;
mod band;
mod cells;
mod field;
mod orders;
mod spread;
mod window;

use crate::decode::DecodeSettings;
use crate::{Error, Image, ImageMut, Reason, check_length, check_shape, check_value};
use ballot::{Needs, Worker};
use band::LANES;
pub use cells::{CellRules, Cells, vote_cells};
use field::Field;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::ops::Range;

/// Rows between those that systematic errors are estimated from.
const SAMPLED_ROWS: usize = 4;

/// Rows that are prepared together: few enough for the second cache of a processor, and a multiple of
/// those between two sampled ones.
const BAND_ROWS: usize = 16;

/// Most pixels of a row, from the edges of a window to its middle.
const MAX_RADIUS: usize = 7;

/// The two quantiles that systematic errors are estimated at: the middle and the tail.
const SHARES: [f32; 2] = [0.5, 0.9];

/// Largest usual scatter in a window over that of noise: more is no surface.
const MOST_SCATTER: f32 = 2.0;

/// Order of a pixel that is not decided.
const UNDECIDED: i32 = i32::MIN;

/// When a vote counts.
pub struct Rules {
    /// Pixels from the middle of a window to its edges, 1 to 7.
    pub radius: usize,
    /// Largest posterior probability of all other orders together.
    pub error_rate: f32,
    /// The same for the vote of next neighbours, of which a decided pixel has the same order.
    pub near_error_rate: f32,
    /// Largest χ² of the means of a window about its order.
    pub largest_misfit: f32,
    /// By how much the χ² of the voted order may exceed that of the pixel's own best order.
    pub own_doubt: f32,
    /// Quantiles 0.5 and 0.9 of the χ² of a window whose errors are noise.
    pub usual_misfit: [f32; 2],
}

impl Rules {
    /// Pixels from the middle of the window of next neighbours to its edges.
    fn near_radius(&self) -> usize {
        (self.radius / 2).max(1)
    }

    fn check(&self) -> Result<(), Error> {
        let inside = (1..=MAX_RADIUS).contains(&self.radius);
        check_value("radius", inside, "1 to 7", self.radius)?;
        let share = self.error_rate > 0.0 && self.error_rate < 1.0;
        check_value("error_rate", share, "between 0 and 1", self.error_rate)?;
        let share = self.near_error_rate > 0.0 && self.near_error_rate < 1.0;
        check_value(
            "near_error_rate",
            share,
            "between 0 and 1",
            self.near_error_rate,
        )
    }
}

/// The maps that votes change.
pub struct Measured<'a> {
    /// Projector coordinate, px; NaN where not measured.
    pub coordinate: ImageMut<'a, f32>,
    /// Its standard deviation, px.
    pub sigma: ImageMut<'a, f32>,
    /// Codes of [`crate::Reason`].
    pub reason: ImageMut<'a, u8>,
}

/// Let neighbours vote on the fringe orders of ambiguous pixels, and return the number of changed pixels.
///
/// `phases` and `variances` are those of every set of the settings, rad and rad², as
/// [`crate::decode::decode_frames`] writes them; variances by noise alone. Pixels that were measured stay
/// as they are, unless a vote that counts contradicts them: they become ambiguous.
///
/// ```
/// use fringeworks::decode::{Chain, DecodeSettings, Limits, Noise, PhaseSet};
/// use fringeworks::vote::{Measured, Rules, vote_orders};
/// use fringeworks::{Image, ImageMut, Reason};
/// use std::f64::consts::TAU;
///
/// // A plane under fringes of 10 px and a single one of 100 px, with noise of 0.1 rad.
/// let (height, width) = (20, 30);
/// let noise = |i: usize| 0.1 * (((i * 7919) % 101) as f64 / 50.0 - 1.0);
/// let phase = |i: usize, period: f64| {
///     let turns = (20.0 + 2.0 * (i % 30) as f64) / period + noise(i + period as usize) / TAU;
///     (TAU * (turns - turns.round())) as f32
/// };
/// let maps = [10.0, 100.0].map(|p| (0..600).map(|i| phase(i, p)).collect::<Vec<f32>>());
/// let thirds = [0.0, TAU / 3.0, 2.0 * TAU / 3.0];
/// let set = |k: usize, p: f64| PhaseSet::new(vec![k, k + 1, k + 2], &thirds, vec![], p);
/// let settings = DecodeSettings {
///     sets: vec![set(0, 10.0)?, set(3, 100.0)?],
///     gray_code: None,
///     // The range of coordinates is that of the chain.
///     chain: Chain { combinations: vec![0.0, 1.0], ..Chain::hierarchy(&[100.0])? },
///     noise: Noise { read_variance: 1.0, gain: 0.0 },
///     limits: Limits::default(),
/// };
/// let variance = vec![0.01; 600];
/// let (mut coordinate, mut sigma) = (vec![f32::NAN; 600], vec![f32::NAN; 600]);
/// let mut reason = vec![u8::from(Reason::OrderAmbiguous); 600];
/// let image = |map| Image::new(map, height, width);
/// let changed = vote_orders(
///     &settings,
///     &[image(&maps[0])?, image(&maps[1])?],
///     &[image(&variance)?, image(&variance)?],
///     &Rules {
///         radius: 2,
///         error_rate: 1e-5,
///         near_error_rate: 1e-3,
///         largest_misfit: 28.0,
///         own_doubt: 4.0,
///         usual_misfit: [0.45, 2.7],
///     },
///     Measured {
///         coordinate: ImageMut::new(&mut coordinate, height, width)?,
///         sigma: ImageMut::new(&mut sigma, height, width)?,
///         reason: ImageMut::new(&mut reason, height, width)?,
///     },
/// )?;
/// assert!(changed > 550);
/// assert!((coordinate[315] - 50.0).abs() < 0.5);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn vote_orders(
    settings: &DecodeSettings,
    phases: &[Image<f32>],
    variances: &[Image<f32>],
    rules: &Rules,
    mut out: Measured,
) -> Result<usize, Error> {
    check(settings, phases, variances, rules, &out)?;
    let mut field = Field::new(settings, phases, variances, &out.reason);
    let (floor, scatter) = usual_errors(&field, rules);
    field.add_floor(floor);
    field.usual_scatter = scatter.clamp(1.0, MOST_SCATTER);
    // What a vote does not decide, or what it contradicts, is that of the pixel itself.
    let mut orders = known_orders(&field, &out);
    let contradicted = window_orders(&field, rules, &mut orders);
    let spread = spread::orders(&field, &orders, rules);
    Ok(write(&field, &spread, &contradicted, &mut out))
}

fn check(
    settings: &DecodeSettings,
    phases: &[Image<f32>],
    variances: &[Image<f32>],
    rules: &Rules,
    out: &Measured,
) -> Result<(), Error> {
    let (sets, shape) = (settings.sets.len(), out.coordinate.shape());
    check_value("sets", sets > 1, "two or more", sets)?;
    check_length("phases", phases.len(), sets)?;
    check_length("variances", variances.len(), sets)?;
    for map in phases.iter().chain(variances) {
        check_shape("phases", map.shape(), shape)?;
    }
    check_shape("sigma", out.sigma.shape(), shape)?;
    check_shape("reason", out.reason.shape(), shape)?;
    check_value(
        "range",
        settings.chain.half > 0.0,
        "> 0",
        settings.chain.half,
    )?;
    rules.check()
}

/// Orders of the measured pixels.
fn known_orders(field: &Field, out: &Measured) -> Vec<i32> {
    (0..field.len())
        .into_par_iter()
        .map(|i| {
            let turns = out.coordinate[i] * field.finest_frequency() - field.finest_turns(i);
            let measured = out.reason[i] == u8::from(Reason::Ok);
            if measured {
                field.in_range(i, turns.round() as i32)
            } else {
                UNDECIDED
            }
        })
        .collect()
}

/// Variance of the phases that windows do not average out, rad², by what their means miss their orders
/// beyond noise; and the usual scatter in a window.
fn usual_errors(field: &Field, rules: &Rules) -> (f32, f32) {
    let found: Vec<Vec<[f32; 3]>> = bands(field)
        .map_init(Worker::default, |worker, rows| {
            worker.band.fill(field, rows.clone(), rules.radius);
            let mut found = vec![];
            for y in rows.filter(|y| y % SAMPLED_ROWS == 0) {
                sample_row(field, worker, y, rules.radius, &mut found);
            }
            found
        })
        .collect();
    let of = |k: usize| -> Vec<f32> { found.iter().flatten().map(|v| v[k]).collect() };
    let quantile = |values: &mut [f32], share: f32| {
        let place = (share * (values.len() - 1) as f32) as usize;
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    };
    if found.iter().all(Vec::is_empty) {
        return (0.0, 1.0);
    }
    let (squares, (noise, scatter)) = rayon::join(
        || {
            let mut squares = of(0);
            SHARES.map(|share| quantile(&mut squares, share))
        },
        || {
            (
                quantile(&mut of(1), SHARES[0]),
                quantile(&mut of(2), SHARES[0]),
            )
        },
    );
    let pairs = squares.iter().zip(&rules.usual_misfit);
    let floor = pairs.fold(0.0, |most: f32, (square, usual)| {
        (square / usual - noise).max(most)
    });
    (floor, scatter)
}

/// The numbers of the rows of every band of an image.
fn bands(field: &Field) -> impl IndexedParallelIterator<Item = Range<usize>> {
    let height = field.height();
    let bands = (0..height.div_ceil(BAND_ROWS)).into_par_iter();
    bands.map(move |k| k * BAND_ROWS..height.min((k + 1) * BAND_ROWS))
}

/// Squared errors of the means of windows in rad², their variances and their scatter, of a row.
fn sample_row(
    field: &Field,
    worker: &mut Worker,
    y: usize,
    radius: usize,
    found: &mut Vec<[f32; 3]>,
) {
    let Worker {
        band,
        means,
        ballot,
    } = worker;
    let unknown = [f32::NAN; LANES];
    for first in (0..field.width()).step_by(LANES) {
        let columns = first..field.width().min(first + LANES);
        let start = y * field.width();
        if !columns.clone().any(|x| field.is_lit(start + x)) {
            continue;
        }
        means.fill(field, band, band.place(y, first), radius);
        let pixels: Vec<usize> = columns.map(|x| start + x).collect();
        ballot.phases.of_means(field, means, &pixels);
        let misfit = ballot.phases.best(field, &unknown);
        for (lane, _) in pixels.iter().enumerate().filter(|&(_, &i)| field.is_lit(i)) {
            let variance = means.coarse_variance(field.others(), lane);
            let square = misfit[lane] * variance;
            found.push([square, variance, means.scatter[lane]]);
        }
    }
}

/// Have the window around every lit pixel vote for its order. `orders` are those of the pixels
/// themselves; those of undecided ones are set. Returns the pixels whose order a vote contradicts.
fn window_orders(field: &Field, rules: &Rules, orders: &mut [i32]) -> Vec<bool> {
    let mut contradicted = vec![false; field.len()];
    let length = (BAND_ROWS * field.width()).max(1);
    let maps = (orders.par_chunks_mut(length)).zip(contradicted.par_chunks_mut(length));
    let bands = bands(field).zip(maps);
    bands.for_each_init(Worker::default, |worker, (rows, (orders, contradicted))| {
        let start = rows.start * field.width();
        let asked = worker.ballot.asked(field, start, orders, rules.own_doubt);
        if !asked.contains(&true) {
            return;
        }
        let on = |i: usize, order: i32| {
            let own = &mut orders[i - start];
            if *own == UNDECIDED {
                *own = order;
            } else {
                contradicted[i - start] |= *own != order;
            }
        };
        let needs = Needs {
            error_rate: rules.error_rate,
            misfit: rules.largest_misfit,
            doubt: rules.own_doubt,
        };
        worker.band.fill(field, rows.clone(), rules.radius);
        worker.poll(field, rows, rules.radius, &asked, &needs, on);
    });
    contradicted
}

/// Write coordinates of decided orders, and mark contradicted pixels; returns the number of changes.
fn write(field: &Field, orders: &[i32], contradicted: &[bool], out: &mut Measured) -> usize {
    let ambiguous = u8::from(Reason::OrderAmbiguous);
    let pixels = out.coordinate.par_iter_mut().zip(out.sigma.par_iter_mut());
    let pixels = pixels.zip(out.reason.par_iter_mut()).enumerate();
    let changes = pixels.map(|(i, ((coordinate, sigma), reason))| {
        if contradicted[i] {
            (*coordinate, *sigma, *reason) = (f32::NAN, f32::NAN, ambiguous);
            return 1;
        }
        if *reason != ambiguous || orders[i] == UNDECIDED {
            return 0;
        }
        let Some((x, spread)) = field.coordinate(i, orders[i]) else {
            return 0;
        };
        (*coordinate, *sigma, *reason) = (x, spread, u8::from(Reason::Ok));
        1
    });
    changes.sum()
}

/// v less the nearest whole number.
#[inline(always)]
fn wrap(v: f32) -> f32 {
    v - v.round_ties_even()
}

/// Turns over rad.
const PER_TURN: f32 = 1.0 / TAU;

/// Variance in turns² over that in rad².
const PER_RAD2: f32 = 1.0 / (TAU * TAU);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{Chain, Limits, Noise, PhaseSet};
    use std::f64::consts::TAU as TURN;

    const SHAPE: (usize, usize) = (30, 60);

    fn settings() -> DecodeSettings {
        let shifts = [0.0, TURN / 3.0, 2.0 * TURN / 3.0];
        let set =
            |k: usize, p: f64| PhaseSet::new(vec![k, k + 1, k + 2], &shifts, vec![], p).unwrap();
        DecodeSettings {
            sets: vec![set(0, 20.0), set(3, 200.0)],
            gray_code: None,
            chain: Chain::hierarchy(&[200.0, 20.0]).unwrap(),
            noise: Noise {
                read_variance: 1.0,
                gain: 0.0,
            },
            limits: Limits::default(),
        }
    }

    fn images(maps: &[Vec<f32>; 2]) -> Vec<Image<'_, f32>> {
        let image = |map| Image::new(map, SHAPE.0, SHAPE.1).unwrap();
        maps.iter().map(|map| image(map.as_slice())).collect()
    }

    /// Coordinates after a vote on phases of a map with errors of up to 0.35 rad of the single period.
    fn voted(truth: impl Fn(usize, usize) -> f64) -> Vec<f32> {
        let (height, width) = SHAPE;
        let error = |i: usize| 0.35 * (((i * 7919) % 1009) as f64 / 504.5 - 1.0);
        let phases = [20.0, 200.0].map(|period| -> Vec<f32> {
            let phase = |i: usize| {
                let share = if period > 100.0 { error(i) } else { 0.0 };
                let turns = truth(i / width, i % width) / period + share / TURN;
                (TURN * (turns - turns.round())) as f32
            };
            (0..height * width).map(phase).collect()
        });
        let variances = [vec![1e-4; height * width], vec![0.04; height * width]];
        let (mut coordinate, mut sigma) =
            (vec![f32::NAN; height * width], vec![0.0; height * width]);
        let mut reason = vec![u8::from(Reason::OrderAmbiguous); height * width];
        let rules = Rules {
            radius: 3,
            error_rate: 1e-5,
            near_error_rate: 1e-3,
            largest_misfit: 10.8,
            own_doubt: 2.0,
            usual_misfit: [0.45, 2.7],
        };
        let out = Measured {
            coordinate: ImageMut::new(&mut coordinate, height, width).unwrap(),
            sigma: ImageMut::new(&mut sigma, height, width).unwrap(),
            reason: ImageMut::new(&mut reason, height, width).unwrap(),
        };
        vote_orders(
            &settings(),
            &images(&phases),
            &images(&variances),
            &rules,
            out,
        )
        .unwrap();
        coordinate
    }

    #[test]
    fn a_step_of_a_whole_period_is_not_bridged() {
        let truth = |_: usize, x: usize| 40.0 + x as f64 + if x < 30 { 0.0 } else { 20.0 };
        let found = voted(truth);
        let known = found.iter().filter(|x| x.is_finite()).count();
        assert!(known > 1500, "{known}");
        let wrong = found
            .iter()
            .enumerate()
            .filter(|(i, x)| (f64::from(**x) - truth(i / 60, i % 60)).abs() > 10.0);
        assert_eq!(wrong.count(), 0);
    }
}
