//! A wrapped phase with two regions and noise, unwrapped by reliability.
//!
//! `cargo run --example unwrap`

use fringeworks::unwrap::{count_residues, unwrap_reliability};
use fringeworks::{Error, Image};
use std::f32::consts::TAU;

const WIDTH: usize = 320;
const HEIGHT: usize = 200;

/// A hill of 12 turns.
fn hill(i: usize) -> f32 {
    let (dx, dy) = ((i % WIDTH) as f32 - 130.0, (i / WIDTH) as f32 - 100.0);
    12.0 * TAU * (-(dx * dx + dy * dy) / 4000.0).exp()
}

fn main() -> Result<(), Error> {
    let noise = |i: usize| 0.3 * (((i * 7919) % 101) as f32 / 50.0 - 1.0);
    let truth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| hill(i) + noise(i)).collect();
    let wrapped: Vec<f32> = truth.iter().map(|t| t - TAU * (t / TAU).round()).collect();
    // A column without data cuts the map in two.
    let valid: Vec<u8> = (0..WIDTH * HEIGHT)
        .map(|i| u8::from(i % WIDTH != 250))
        .collect();

    let phase = Image::new(&wrapped, HEIGHT, WIDTH)?;
    let mask = Image::new(&valid, HEIGHT, WIDTH)?;
    println!("{} residues", count_residues(phase, mask)?);
    let found = unwrap_reliability(phase, mask, None)?;
    for region in 1..=found.region.iter().copied().max().unwrap_or(0) {
        let inside = (0..truth.len()).filter(|&i| found.region[i] == region);
        let turns: Vec<f32> = inside
            .map(|i| ((truth[i] - found.phase[i]) / TAU).round())
            .collect();
        let wrong = turns.iter().filter(|&&turn| turn != turns[0]).count();
        println!(
            "region {region}: {} px, {wrong} of them in a wrong order",
            turns.len()
        );
    }
    Ok(())
}
