//! Twelve frames of shifted fringes to projector coordinates: three periods of four steps each.
//!
//! `cargo run --example decode`

use fringeworks::decode::{Chain, DecodeSettings, Limits, Noise, PhaseSet, decode};
use fringeworks::{Error, Reason};
use std::f64::consts::TAU;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const STEPS: usize = 4;

/// Fringes across a projector of 1024 columns: 1, 8 and 64 of them.
const PERIODS: [f64; 3] = [1024.0, 128.0, 16.0];

/// Projector column that a camera pixel sees; none in the shadow of the object.
fn column(x: usize, y: usize) -> Option<f64> {
    let (dx, dy) = (x as f64 - 320.0, y as f64 - 240.0);
    let height = (1.0 - (dx * dx + dy * dy) / 4e4).max(0.0);
    let shadow = (480..520).contains(&x) && (200..280).contains(&y);
    (!shadow).then_some(100.0 + 1.2 * x as f64 + 40.0 * height)
}

/// What the camera sees of a step of a period, with some counts of noise.
fn frame(period: f64, step: usize) -> Vec<u8> {
    let shift = TAU * step as f64 / STEPS as f64;
    let count = |i: usize| {
        let noise = ((i * 7919 + step * 104_729) % 5) as f64 - 2.0;
        let fringe =
            column(i % WIDTH, i / WIDTH).map_or(0.0, |c| 1.0 + (TAU * c / period - shift).cos());
        (20.0 + 90.0 * fringe + noise).round() as u8
    };
    (0..WIDTH * HEIGHT).map(count).collect()
}

fn main() -> Result<(), Error> {
    let shifts: Vec<f64> = (0..STEPS).map(|n| TAU * n as f64 / STEPS as f64).collect();
    let mut frames = Vec::new();
    let mut sets = Vec::new();
    for period in PERIODS {
        let first = frames.len();
        frames.extend((0..STEPS).map(|step| frame(period, step)));
        sets.push(PhaseSet::new(
            (first..frames.len()).collect(),
            &shifts,
            vec![],
            period,
        )?);
    }
    let settings = DecodeSettings {
        sets,
        gray_code: None,
        chain: Chain::hierarchy(&PERIODS)?,
        noise: Noise {
            read_variance: 2.0,
            gain: 0.0,
        },
        limits: Limits {
            saturation: 255.0,
            ..Limits::default()
        },
    };
    let planes: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
    let found = decode(&planes, &settings)?;

    println!("{} frames of {WIDTH} × {HEIGHT} px", planes.len());
    for reason in Reason::ALL {
        let count = found.reason.iter().filter(|&&r| r == reason).count();
        if count > 0 {
            println!("{count:7} px: {reason}");
        }
    }
    let errors: Vec<f64> = (0..WIDTH * HEIGHT)
        .filter_map(|i| Some(f64::from(found.coordinate[i]) - column(i % WIDTH, i / WIDTH)?))
        .filter(|error| error.is_finite())
        .collect();
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    println!(
        "root mean square error {rms:.3} px, stated σ {:.3} px",
        found.sigma[0]
    );
    Ok(())
}
