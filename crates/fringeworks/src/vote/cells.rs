//! Fringe orders of pixels whose Gray code leaves a choice, with the help of their neighbours.
//!
//! Where cells are nearly as long as the fringes, noise leaves two orders to a pixel next to the end of its
//! cell: one at either end. So it does where noise leaves a bit in doubt. The cells of its neighbours tell:
//! on one surface the finest phase counts the turns between them, and only the right order lies in the
//! cells of all.

use super::band::Band;
use super::field::Field;
use super::{BAND_ROWS, Measured, UNDECIDED, bands};
use crate::decode::DecodeSettings;
use crate::{Error, Image, Reason, check_shape, check_value};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Most orders that the own cell of a pixel may leave: the two ends of its cell, and one beyond either.
const MOST_ORDERS: usize = 4;

/// Standard deviations by which the coordinate of a neighbour may miss its cell. The same pixels of a
/// surface one period away miss it by a few px as well where it is next to the end of the cell: a wider
/// limit would let them agree.
const NOISE_SIGMAS: f32 = 2.0;

/// Where the Gray code alone says that pixels lie.
pub struct Cells<'a> {
    /// Middle of the range that the bits of a pixel leave, px; NaN where they leave several.
    pub middle: Image<'a, f32>,
    /// Half the width of that range, px.
    pub half_width: Image<'a, f32>,
}

/// When the cells of neighbours decide.
pub struct CellRules {
    /// Pixels from the middle of a window to its edges, 1 to 7.
    pub radius: usize,
    /// By how many more pixels the order must be allowed than any other.
    pub ahead: usize,
    /// Share of the pixels of a window whose cells may contradict the order, by noise.
    pub others: f32,
    /// Share of the lit pixels of a window that must continue the phase of its middle: fewer do beside
    /// the edge of another surface, whose cells say nothing.
    pub continued: f32,
}

/// Decide ambiguous fringe orders by the cells of neighbours, and return how many were.
///
/// `phase` and `variance` are those of the only set of the settings, rad and rad², as
/// [`crate::decode::decode_frames`] writes them. Pixels that were measured stay as they are.
///
/// # Errors
///
/// If the settings have no Gray code or several sets, maps differ in shape, or a rule is out of range.
///
/// ```
/// use fringeworks::decode::{Against, Chain, DecodeSettings, GrayCode, Limits, Noise, PhaseSet};
/// use fringeworks::vote::{CellRules, Cells, Measured, vote_cells};
/// use fringeworks::{Image, ImageMut, Reason};
/// use std::f64::consts::TAU;
///
/// // A plane under fringes and cells of 20 px. Next to the ends of the cells, pixels are ambiguous.
/// let (height, width) = (20, 60);
/// let x = |i: usize| 1.5 * (i % 60) as f32;
/// let at_end = |i: usize| (x(i) % 20.0 - 10.0).abs() > 8.0;
/// let turns = |i: usize| x(i) / 20.0 - (x(i) / 20.0).round();
/// let map = |value: &dyn Fn(usize) -> f32| (0..1200).map(value).collect::<Vec<f32>>();
/// let phase = map(&|i| turns(i) * TAU as f32);
/// let variance = map(&|_| 0.01);
/// let middle = map(&|i| 20.0 * (x(i) / 20.0).floor() + 10.0);
/// let half_width = map(&|_| 10.0);
/// let mut coordinate = map(&|i| if at_end(i) { f32::NAN } else { x(i) });
/// let mut sigma = map(&|i| if at_end(i) { f32::NAN } else { 0.3 });
/// let reason = |i| if at_end(i) { Reason::OrderAmbiguous } else { Reason::Ok };
/// let mut reason: Vec<u8> = (0..1200).map(|i| u8::from(reason(i))).collect();
/// let settings = DecodeSettings {
///     sets: vec![PhaseSet::new(vec![0, 1, 2], &[0.0, TAU / 3.0, 2.0 * TAU / 3.0], vec![], 20.0)?],
///     gray_code: Some(GrayCode {
///         bits: vec![3, 4, 5],
///         against: Against::Mean,
///         levels: 2,
///         inverted: 0,
///         step: 20.0,
///         offset: 0.0,
///         cells: 5,
///         doubt_share: 0.5,
///         alien_share: 3.0,
///         widest: 40.0,
///         blurred: 1.0,
///         slack: 2.0,
///         guard: 0.4,
///         confidence: 5.0,
///     }),
///     // The range of coordinates is that of the chain.
///     chain: Chain { middle: 49.5, half: 50.0, ..Chain::hierarchy(&[20.0])? },
///     noise: Noise { read_variance: 1.0, gain: 0.0 },
///     limits: Limits::default(),
/// };
/// let image = |map| Image::new(map, height, width);
/// let changed = vote_cells(
///     &settings,
///     (image(&phase)?, image(&variance)?),
///     &Cells { middle: image(&middle)?, half_width: image(&half_width)? },
///     &CellRules { radius: 7, ahead: 8, others: 0.1, continued: 0.7 },
///     Measured {
///         coordinate: ImageMut::new(&mut coordinate, height, width)?,
///         sigma: ImageMut::new(&mut sigma, height, width)?,
///         reason: ImageMut::new(&mut reason, height, width)?,
///     },
/// )?;
/// assert!(changed > 150);
/// assert!((coordinate[614] - 21.0).abs() < 0.1);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn vote_cells(
    settings: &DecodeSettings,
    (phase, variance): (Image<f32>, Image<f32>),
    cells: &Cells,
    rules: &CellRules,
    mut out: Measured,
) -> Result<usize, Error> {
    check_value("sets", settings.sets.len() == 1, "one", settings.sets.len())?;
    let Some(code) = &settings.gray_code else {
        return check_value("Gray code", false, "one", "none").map(|()| 0);
    };
    let inside = (1..=super::MAX_RADIUS).contains(&rules.radius);
    check_value("radius", inside, "1 to 7", rules.radius)?;
    let shape = out.coordinate.shape();
    let read = [&phase, &variance, &cells.middle, &cells.half_width].map(|map| map.shape());
    for other in read
        .into_iter()
        .chain([out.sigma.shape(), out.reason.shape()])
    {
        check_shape("maps", other, shape)?;
    }
    let (phases, variances) = ([phase], [variance]);
    let field = Field::new(settings, &phases, &variances, &out.reason);
    let known = super::known_orders(&field, &out);
    let allowed: Vec<Option<RangeInclusive<i32>>> = (0..field.len())
        .into_par_iter()
        .map(|i| match known[i] {
            UNDECIDED => orders_of(&field, cells, i, NOISE_SIGMAS * field.sigma(i)),
            order => Some(order..=order),
        })
        .collect();
    let slack = |i: usize| code.slack + field.slack(i);
    let own = |i: usize| {
        let asked = out.reason[i] == u8::from(Reason::OrderAmbiguous);
        asked
            .then(|| orders_of(&field, cells, i, slack(i)))
            .flatten()
    };
    let orders = common_orders(&field, &allowed, own, rules);
    let none = vec![false; field.len()];
    Ok(super::write(&field, &orders, &none, &mut out))
}

/// The orders that the cells of windows have in common, of the pixels that ask for it with theirs.
fn common_orders(
    field: &Field,
    allowed: &[Option<RangeInclusive<i32>>],
    own: impl Fn(usize) -> Option<RangeInclusive<i32>> + Sync,
    rules: &CellRules,
) -> Vec<i32> {
    let mut orders = vec![UNDECIDED; field.len()];
    let length = (BAND_ROWS * field.width()).max(1);
    let bands = bands(field).zip(orders.par_chunks_mut(length));
    bands.for_each_init(Band::default, |band, (rows, orders)| {
        let start = rows.start * field.width();
        let asked = (start..)
            .zip(orders)
            .filter_map(|(i, order)| Some((i, own(i)?, order)));
        for (k, (i, own, order)) in asked.enumerate() {
            if k == 0 {
                band.fill(field, rows.clone(), 0);
            }
            *order = common(field, band, allowed, &own, i, rules).unwrap_or(UNDECIDED);
        }
    });
    orders
}

/// Orders of a pixel whose coordinates lie in its cell, or beside it by up to `slack` (px); none where
/// they are too many or no cell is known.
fn orders_of(field: &Field, cells: &Cells, i: usize, slack: f32) -> Option<RangeInclusive<i32>> {
    let middle = cells.middle[i];
    if !(field.is_lit(i) && middle.is_finite()) {
        return None;
    }
    let half = cells.half_width[i] + slack;
    let at = |px: f32| px * field.finest_frequency() - field.finest_turns(i);
    let (low, high) = (
        at(middle - half).ceil() as i32,
        at(middle + half).floor() as i32,
    );
    (low <= high && ((high - low) as usize) < MOST_ORDERS).then_some(low..=high)
}

/// The order of a pixel that the cells of the window around it have in common.
fn common(
    field: &Field,
    band: &Band,
    allowed: &[Option<RangeInclusive<i32>>],
    own: &RangeInclusive<i32>,
    i: usize,
    rules: &CellRules,
) -> Option<i32> {
    let (y, x) = (i / field.width(), i % field.width());
    if field.is_borrowed(y, x) {
        return None;
    }
    let (mut votes, mut all, mut continued) = ([0usize; MOST_ORDERS], 0, 0);
    field.for_window((y, x), band.slope_at(y, x), rules.radius, |there, turns| {
        continued += 1;
        if there != i
            && let Some(orders) = &allowed[there]
        {
            all += 1;
            for (vote, order) in votes.iter_mut().zip(own.clone()) {
                *vote += usize::from(orders.contains(&(order + turns)));
            }
        }
    });
    let lit = field.lit_in_window(y, x, rules.radius);
    if (continued as f32) < rules.continued * lit as f32 {
        return None;
    }
    let best = (0..MOST_ORDERS).max_by_key(|&k| votes[k])?;
    let second = (0..MOST_ORDERS).filter(|&k| k != best).map(|k| votes[k]);
    let ahead = votes[best] - second.max().unwrap_or(0);
    let common = (all - votes[best]) as f32 <= rules.others * all as f32;
    (common && ahead >= rules.ahead).then_some(own.start() + best as i32)
}
