//! Decoded coordinates to points: a plane that a calibrated rig of camera and projector sees.
//!
//! `cargo run --example triangulate`

use fringeworks::Error;
use fringeworks::triangulate::{Axis, Lens, Limits, Points, Rig, Spread, Triangulation};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const PROJECTOR: (usize, usize) = (1024, 768);

/// Depth of the plane on the optical axis, mm.
const DEPTH: f64 = 500.0;

/// Angle between the optical axes, rad: 13°.
const TURN: f64 = 0.2269;

/// The projector stands 120 mm to the right of the camera and is turned towards the plane by 13°.
fn rig() -> Rig {
    let (s, c) = TURN.sin_cos();
    let lens = |focal: f64, principal: [f64; 2]| Lens {
        focal: [focal; 2],
        principal,
        distortion: [0.0; 5],
    };
    Rig {
        camera: lens(900.0, [319.5, 239.5]),
        projector: lens(1300.0, [511.5, 383.5]),
        rotation: [c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c],
        translation: [-120.0 * c, 0.0, 120.0 * s],
    }
}

/// Projector column of the plane at a pixel, as a decoder would find it.
fn column(i: usize) -> f32 {
    let (s, c) = TURN.sin_cos();
    let x = DEPTH * ((i % WIDTH) as f64 - 319.5) / 900.0 - 120.0;
    (1300.0 * (c * x + s * DEPTH) / (c * DEPTH - s * x) + 511.5) as f32
}

fn main() -> Result<(), Error> {
    let pixels = WIDTH * HEIGHT;
    let coordinate: Vec<f32> = (0..pixels).map(column).collect();
    let x = Axis {
        coordinate: &coordinate,
        sigma: &vec![0.05; pixels],
        reason: &vec![0; pixels],
    };
    let (mut xyz, mut reason) = (vec![0.0; 3 * pixels], vec![0; pixels]);
    let (mut sigma, mut noise) = (vec![0.0; pixels], vec![0.0; pixels]);
    let out = Points {
        xyz: &mut xyz,
        sigma: &mut sigma,
        noise: &mut noise,
        residual: &mut [],
        reason: &mut reason,
    };
    let limits = Limits {
        residual_sigmas: 5.0,
        residual_px: 0.1,
    };
    let spread = Spread::none(true, PROJECTOR.0 as f32);
    let rig = Triangulation::new(&rig(), &spread, (HEIGHT, WIDTH), PROJECTOR)?;
    rig.triangulate(Some(x), None, &limits, out)?;

    let points = reason.iter().filter(|&&code| code == 0).count();
    let off = |point: &[f32]| (f64::from(point[2]) - DEPTH).abs();
    let largest = xyz.chunks(3).map(off).fold(0.0, f64::max);
    let middle = noise[pixels / 2 + WIDTH / 2];
    println!("{points} of {pixels} pixels are points");
    println!("largest error of a depth: {largest:.4} mm");
    println!("σ from 0.05 px of noise, in the middle: {middle:.3} mm");
    Ok(())
}
