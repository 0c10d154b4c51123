//! Polynomial inverse function x = P(I), least squares in orthogonal polynomials (IFA).

/// Mean square of an orthogonal polynomial on the samples below which it counts as zero.
///
/// The samples then have no more different intensities than the degree; the rest is rounding.
const ZERO_MEAN_SQUARE: f64 = 1e-12;

/// x as a polynomial of the intensity, in orthogonal polynomials on the samples (Forsythe 1957).
pub struct Polynomial {
    centre: f64,
    half_range: f64,
    /// Coefficients of the recurrence p[k+1] = (z − α) p[k] − β p[k−1].
    alpha: Vec<f64>,
    beta: Vec<f64>,
    coefficients: Vec<f64>,
}

impl Polynomial {
    /// Least-squares fit to points (x, intensity). The degree is the one up to `max_degree` with the
    /// smallest generalised cross-validation score RSS / (n − degree − 1)².
    pub fn fit(points: &[(f64, f64)], max_degree: usize) -> Self {
        let n = points.len();
        let mut fit = Self::scaled_to(points);
        let z: Vec<f64> = points.iter().map(|p| fit.scaled(p.1)).collect();
        let mut residual: Vec<f64> = points.iter().map(|p| p.0).collect();
        let (mut previous, mut current) = (vec![0.0; n], vec![1.0; n]);
        let mut previous_norm = 1.0;
        let mut best = (f64::INFINITY, 1);
        for degree in 0..=max_degree.min(n - 2) {
            let norm: f64 = current.iter().map(|c| c * c).sum();
            if norm < ZERO_MEAN_SQUARE * n as f64 {
                break;
            }
            let coefficient = dot(&current, &residual) / norm;
            for (r, c) in residual.iter_mut().zip(&current) {
                *r -= coefficient * c;
            }
            let alpha = current.iter().zip(&z).map(|(c, z)| c * c * z).sum::<f64>() / norm;
            let beta = if degree == 0 {
                0.0
            } else {
                norm / previous_norm
            };
            fit.coefficients.push(coefficient);
            fit.alpha.push(alpha);
            fit.beta.push(beta);
            let rss: f64 = residual.iter().map(|r| r * r).sum();
            let score = rss / ((n - degree - 1) as f64).powi(2);
            if score < best.0 {
                best = (score, degree + 1);
            }
            for k in 0..n {
                let next = (z[k] - alpha) * current[k] - beta * previous[k];
                previous[k] = current[k];
                current[k] = next;
            }
            previous_norm = norm;
        }
        fit.coefficients.truncate(best.1);
        fit
    }

    /// A polynomial without coefficients whose variable is −1…1 over the points' intensities.
    fn scaled_to(points: &[(f64, f64)]) -> Self {
        let low = points.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
        Self {
            centre: 0.5 * (low + high),
            half_range: (0.5 * (high - low)).max(f64::MIN_POSITIVE),
            alpha: vec![],
            beta: vec![],
            coefficients: vec![],
        }
    }

    fn scaled(&self, intensity: f64) -> f64 {
        (intensity - self.centre) / self.half_range
    }

    pub fn at(&self, intensity: f64) -> f64 {
        let z = self.scaled(intensity);
        let (mut previous, mut current, mut sum) = (0.0, 1.0, 0.0);
        for (k, c) in self.coefficients.iter().enumerate() {
            sum += c * current;
            let next = (z - self.alpha[k]) * current - self.beta[k] * previous;
            previous = current;
            current = next;
        }
        sum
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomial_is_exact_for_a_polynomial() {
        let points: Vec<(f64, f64)> = (0..20)
            .map(|k| {
                let v = k as f64 * 0.5;
                (3.0 + v - 0.2 * v * v + 0.01 * v.powi(3), v)
            })
            .collect();
        let p = Polynomial::fit(&points, 9);
        for (x, v) in &points {
            assert!((p.at(*v) - x).abs() < 1e-9);
        }
    }
}
