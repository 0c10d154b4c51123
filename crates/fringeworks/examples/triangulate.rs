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

fn main() -> Result<(), Error> {
    // The projector stands 120 mm to the right and is turned towards the plane by 13°.
    let (s, c) = 13.0_f64.to_radians().sin_cos();
    let rig = Rig {
        camera: Lens {
            focal: [900.0, 900.0],
            principal: [319.5, 239.5],
            distortion: [0.0; 5],
        },
        projector: Lens {
            focal: [1300.0, 1300.0],
            principal: [511.5, 383.5],
            distortion: [0.0; 5],
        },
        rotation: [c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c],
        translation: [-120.0 * c, 0.0, 120.0 * s],
    };
    // Projector column of the plane at every pixel, as a decoder would find it.
    let column = |i: usize| {
        let x = DEPTH * ((i % WIDTH) as f64 - 319.5) / 900.0;
        let [a, _, b] = [x - 120.0, 0.0, DEPTH];
        (1300.0 * (c * a + s * b) / (c * b - s * a) + 511.5) as f32
    };
    let pixels = WIDTH * HEIGHT;
    let coordinate: Vec<f32> = (0..pixels).map(column).collect();
    let (decoded_sigma, decoded_reason) = (vec![0.05; pixels], vec![0; pixels]);

    let spread = Spread::none(true, PROJECTOR.0 as f32);
    let rig = Triangulation::new(&rig, &spread, (HEIGHT, WIDTH), PROJECTOR)?;
    let x = Axis {
        coordinate: &coordinate,
        sigma: &decoded_sigma,
        reason: &decoded_reason,
    };
    let mut xyz = vec![0.0; 3 * pixels];
    let (mut sigma, mut noise, mut reason) =
        (vec![0.0; pixels], vec![0.0; pixels], vec![0; pixels]);
    let limits = Limits {
        residual_sigmas: 5.0,
        residual_px: 0.1,
    };
    let out = Points {
        xyz: &mut xyz,
        sigma: &mut sigma,
        noise: &mut noise,
        residual: &mut [],
        reason: &mut reason,
    };
    rig.triangulate(Some(x), None, &limits, out)?;

    let points = reason.iter().filter(|&&code| code == 0).count();
    let off = |z: &[f32]| (f64::from(z[2]) - DEPTH).abs();
    let largest = xyz.chunks(3).map(off).fold(0.0, f64::max);
    println!("{points} of {pixels} pixels are points");
    println!("largest error of a depth: {largest:.4} mm");
    println!(
        "σ from 0.05 px of noise, in the middle: {:.3} mm",
        noise[pixels / 2 + WIDTH / 2]
    );
    Ok(())
}
