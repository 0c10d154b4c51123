//! Votes of windows on the orders of the pixels that ask for them.

use super::UNDECIDED;
use super::band::{Band, LANES};
use super::field::Field;
use super::orders::{Phases, Vote};
use super::window::{Lane, Means};
use std::ops::Range;

/// When a vote counts.
pub struct Needs {
    /// Largest posterior probability of all other orders together.
    pub error_rate: f32,
    /// Largest χ² of the means of a window about its order.
    pub misfit: f32,
    /// By how much the χ² of the voted order may exceed that of the pixel's own best order.
    pub doubt: f32,
}

/// Memory for the votes of one thread.
#[derive(Default)]
pub struct Worker {
    pub band: Band,
    pub means: Box<Means>,
    pub ballot: Box<Ballot>,
}

/// Pixels that are voted on together.
#[derive(Default)]
pub struct Ballot {
    pub phases: Phases,
    /// The pixels that ask, and the means of the windows around them.
    pixels: Vec<usize>,
    means: Means,
    /// Orders that windows vote for, with their pixels.
    voted: (Vec<usize>, Vec<i32>),
    vote: Vote,
    misfits: Vec<Lane>,
}

impl Worker {
    /// Have windows vote on the orders of the pixels of some rows that ask for it, and call a function
    /// with those for which a vote counts and their order.
    pub fn poll(
        &mut self,
        field: &Field,
        rows: Range<usize>,
        radius: usize,
        asked: &[bool],
        needs: &Needs,
        mut on: impl FnMut(usize, i32),
    ) {
        let Self {
            band,
            means,
            ballot,
        } = self;
        let width = field.width();
        for (y, asked) in rows.zip(asked.chunks(width)) {
            for (k, asked) in asked.chunks(LANES).enumerate() {
                if !asked.contains(&true) {
                    continue;
                }
                let first = k * LANES;
                means.fill(field, band, band.place(y, first), radius);
                for lane in (0..asked.len()).filter(|&lane| asked[lane]) {
                    let to = ballot.pixels.len();
                    ballot.means.copy(to, means, lane, field.others());
                    ballot.pixels.push(y * width + first + lane);
                    if ballot.pixels.len() == LANES {
                        ballot.settle(field, needs, &mut on);
                    }
                }
            }
        }
        ballot.settle(field, needs, &mut on);
    }
}

impl Ballot {
    /// Pixels of some rows, the first of which is `start`, for which windows are asked: those without
    /// an order, and those whose own phases allow another one as well.
    pub fn asked(&mut self, field: &Field, start: usize, own: &[i32], doubt: f32) -> Vec<bool> {
        let lit = |i: usize| field.is_lit(start + i);
        let mut asked: Vec<bool> = own.iter().map(|&order| order == UNDECIDED).collect();
        let mut pixels = Vec::with_capacity(LANES);
        for i in 0..own.len() {
            if !lit(i) {
                asked[i] = false;
            } else if own[i] != UNDECIDED {
                pixels.push(start + i);
            }
            let last = i + 1 == own.len();
            if pixels.len() == LANES || (last && !pixels.is_empty()) {
                let order = |i: usize| own[i - start] as f32;
                self.doubt(field, &pixels, order, doubt, |i| asked[i - start] = true);
                pixels.clear();
            }
        }
        asked
    }

    /// Call a function with the pixels whose own phases allow another order beside the known one.
    fn doubt(
        &mut self,
        field: &Field,
        pixels: &[usize],
        order: impl Fn(usize) -> f32,
        doubt: f32,
        mut on: impl FnMut(usize),
    ) {
        let mut known = [f32::NAN; LANES];
        for (known, &i) in known.iter_mut().zip(pixels) {
            *known = order(i);
        }
        self.phases.of_pixels(field, pixels);
        let second = self.phases.best(field, &known);
        for (lane, &i) in pixels.iter().enumerate() {
            let own = self.phases.misfit(field, lane, known[lane]);
            let certain = second[lane] > own + doubt && self.phases.contains(lane, known[lane]);
            if !certain {
                on(i);
            }
        }
    }

    /// Count the votes for the pixels that asked, and have none ask any more.
    fn settle(&mut self, field: &Field, needs: &Needs, on: &mut impl FnMut(usize, i32)) {
        if self.pixels.is_empty() {
            return;
        }
        self.phases.of_means(field, &self.means, &self.pixels);
        self.phases.vote(field, &mut self.misfits, &mut self.vote);
        let (pixels, orders) = &mut self.voted;
        pixels.clear();
        orders.clear();
        for (lane, &i) in self.pixels.iter().enumerate() {
            let vote = &self.vote;
            let certain =
                vote.others[lane] <= needs.error_rate && vote.misfit[lane] <= needs.misfit;
            let own_light = || !field.is_borrowed(i / field.width(), i % field.width());
            if certain && self.means.is_even(field, lane) && own_light() {
                pixels.push(i);
                orders.push(vote.order(field, lane, i));
            }
        }
        self.pixels.clear();
        if pixels.is_empty() {
            return;
        }
        // Where a pixel's own phases contradict the vote, it does not count.
        self.phases.of_pixels(field, pixels);
        let best = self.phases.best(field, &[f32::NAN; LANES]);
        for (lane, (&i, &order)) in pixels.iter().zip(&*orders).enumerate() {
            if self.phases.misfit(field, lane, order as f32) <= best[lane] + needs.doubt {
                on(i, order);
            }
        }
    }
}
