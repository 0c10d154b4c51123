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

/// What the camera sees in frame `k`, with uniform noise of −2 to 2 counts.
fn frame(k: usize) -> Vec<u8> {
    let (period, shift) = (PERIODS[k / STEPS], shift(k % STEPS));
    let count = |i: usize| {
        let noise = (mixed((i * 12 + k) as u64) % 5) as f64 - 2.0;
        let light = |column: f64| 1.0 + (TAU * column / period - shift).cos();
        let fringe = column(i % WIDTH, i / WIDTH).map_or(0.0, light);
        (20.0 + 90.0 * fringe + noise).round() as u8
    };
    (0..WIDTH * HEIGHT).map(count).collect()
}

/// A number that looks random (Steele, Lea and Flood's SplitMix64).
fn mixed(k: u64) -> u64 {
    let z = k.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Shift of a step, rad.
fn shift(step: usize) -> f64 {
    TAU * step as f64 / STEPS as f64
}

/// How the frames are decoded: which ones belong to a period, and what the camera's noise is.
fn settings() -> Result<DecodeSettings, Error> {
    let shifts: Vec<f64> = (0..STEPS).map(shift).collect();
    let set = |(k, &period): (usize, &f64)| {
        PhaseSet::new(
            (STEPS * k..STEPS * (k + 1)).collect(),
            &shifts,
            vec![],
            period,
        )
    };
    Ok(DecodeSettings {
        sets: PERIODS
            .iter()
            .enumerate()
            .map(set)
            .collect::<Result<_, _>>()?,
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
    })
}

fn main() -> Result<(), Error> {
    let frames: Vec<Vec<u8>> = (0..PERIODS.len() * STEPS).map(frame).collect();
    let planes: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
    let found = decode(&planes, &settings()?)?;

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
