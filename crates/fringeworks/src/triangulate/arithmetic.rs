//! Arithmetic of the inner loops, compiled into the kernels of each instruction set.
//!
//! All functions are `inline(always)`: a function of its own would be compiled for the baseline
//! instruction set only.

/// A cubic polynomial, coefficients from the constant on.
pub type Cubic = [f32; 4];

/// Polynomial of degree 4 for 2^v on −½ … ½, coefficients from the highest power down.
///
/// Rounded Taylor coefficients: the relative error stays below 3e-4 (tested). The variance that is
/// computed with it needs no more.
const POWER_OF_TWO: [f32; 5] = [0.009_6, 0.055_5, 0.240_22, std::f32::consts::LN_2, 1.0];

/// Largest magnitude of the exponent of [`power_of_two`]: the range of normal f32 values.
const MAX_EXPONENT: f32 = 126.0;

/// a b + c, rounded once where the instruction set has a fused operation.
#[inline(always)]
pub fn fused<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Value of a cubic at `u`.
#[inline(always)]
pub fn cubic<const FMA: bool>(c: &Cubic, u: f32) -> f32 {
    let upper = fused::<FMA>(u, c[3], c[2]);
    fused::<FMA>(u, fused::<FMA>(u, upper, c[1]), c[0])
}

/// 2^x with a relative error below 3e-4; x is limited to ±126.
#[inline(always)]
pub fn power_of_two<const FMA: bool>(x: f32) -> f32 {
    // Adding 1.5 · 2²³ rounds x to a whole number, which then lies in the lowest bits of the sum;
    // 127 is the bias of an f32 exponent.
    const TO_EXPONENT: f32 = 12_582_912.0 + 127.0;
    let x = x.clamp(-MAX_EXPONENT, MAX_EXPONENT);
    let shifted = x + TO_EXPONENT;
    let fraction = x - (shifted - TO_EXPONENT);
    let [highest, others @ ..] = POWER_OF_TWO;
    let small = others
        .into_iter()
        .fold(highest, |sum, c| fused::<FMA>(sum, fraction, c));
    small * f32::from_bits(shifted.to_bits() << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_of_two_keeps_its_error_bound() {
        for k in -1260..=1260 {
            let x = 0.1 * k as f32;
            let ratio = f64::from(power_of_two::<false>(x)) / f64::from(x).exp2();
            assert!((ratio - 1.0).abs() < 3e-4, "{x}: {ratio}");
        }
    }
}
