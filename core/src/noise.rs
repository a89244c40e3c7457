//! Coloured noise: what a residual's own past says of it, and what that does to estimates.
//!
//! A residual e is described as autoregressive, e_k = a1 e_k−1 + … + ap e_k−p + w_k with white w. Its covariance matrix is then
//! R = σw² H Hᵀ with H the filter 1/A, so that for any columns C the matrix Cᵀ R C is the Gram matrix of Hᵀ C: the columns run
//! backwards through the filter. That gives the covariance of least-squares estimates under coloured noise without ever
//! forming R.

use nalgebra::DMatrix;

/// Orders tried.
const MAX_ORDER: usize = 12;

/// An autoregressive description of a residual that is observed in stretches.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Autoregression {
    /// a1..ap.
    pub(crate) coefficients: Vec<f64>,
    /// Variance of w.
    pub(crate) innovation: f64,
    /// Variance of e.
    pub(crate) variance: f64,
}

impl Autoregression {
    /// Solves the Yule-Walker equations by Levinson's recursion for every order and keeps the one with the least BIC.
    ///
    /// Autocovariances are pooled over the stretches, no product spans two of them, and all are divided by the number of
    /// samples, which keeps the filter stable whatever the data.
    pub(crate) fn fit(stretches: &[&[f64]]) -> Self {
        let samples: usize = stretches.iter().map(|s| s.len()).sum();
        // A few short stragglers say little and must not forbid what the rest shows.
        let mean = samples / stretches.len().max(1);
        let order = MAX_ORDER.min(mean / 4).min(samples / 20);
        let covariance = |lag: usize| {
            stretches.iter().map(|s| s.iter().zip(s.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum::<f64>() / samples.max(1) as f64
        };
        let r: Vec<f64> = (0..=order).map(covariance).collect();
        let mut best = Self { coefficients: Vec::new(), innovation: r[0], variance: r[0] };
        if r[0] <= 0.0 {
            return best;
        }
        let n = samples as f64;
        let mut least = n * r[0].ln();
        let (mut a, mut innovation) = (Vec::<f64>::new(), r[0]);
        for p in 1..=order {
            let known: f64 = a.iter().enumerate().map(|(j, a)| a * r[p - 1 - j]).sum();
            let reflection = (r[p] - known) / innovation;
            let turned: Vec<f64> = a.iter().rev().map(|b| reflection * b).collect();
            a.iter_mut().zip(turned).for_each(|(a, b)| *a -= b);
            a.push(reflection);
            innovation *= 1.0 - reflection * reflection;
            if innovation <= 1e-12 * r[0] {
                break;
            }
            let criterion = n * innovation.ln() + p as f64 * n.ln();
            if criterion < least {
                least = criterion;
                best = Self { coefficients: a.clone(), innovation, variance: r[0] };
            }
        }
        best
    }

    /// Hᵀ times a column over one stretch, in place.
    pub(crate) fn adjoint(&self, column: &mut [f64]) {
        for k in (0..column.len()).rev() {
            let later: f64 = self.coefficients.iter().zip(&column[k + 1..]).map(|(a, x)| a * x).sum();
            column[k] += later;
        }
    }

    /// Hᵀ times every column of a block whose rows are one stretch.
    pub(crate) fn adjoint_all(&self, block: &mut DMatrix<f64>) {
        let rows = block.nrows();
        if rows > 0 {
            block.as_mut_slice().chunks_exact_mut(rows).for_each(|column| self.adjoint(column));
        }
    }

    /// 1/H times every column of a block whose rows are one stretch; the first rows, as many as coefficients, lack their past.
    pub(crate) fn whiten_all(&self, block: &mut DMatrix<f64>) {
        let rows = block.nrows();
        if rows == 0 {
            return;
        }
        for column in block.as_mut_slice().chunks_exact_mut(rows) {
            for k in (0..rows).rev() {
                let past = column[..k].iter().rev();
                let foreseen: f64 = self.coefficients.iter().zip(past).map(|(a, x)| a * x).sum();
                column[k] -= foreseen;
            }
        }
    }

    /// Autocorrelation of e at lags 0, 1, … until it has died away, at most `lags` of them: the filter's own, free of the
    /// sampling noise of measured autocorrelations.
    pub(crate) fn autocorrelation(&self, lags: usize) -> Vec<f64> {
        // Impulse response of 1/A, then its correlation with itself.
        let p = self.coefficients.len();
        let mut h = vec![1.0];
        while h.len() < 4 * lags.max(1) {
            let k = h.len();
            let next: f64 = (0..p.min(k)).map(|j| self.coefficients[j] * h[k - 1 - j]).sum();
            h.push(next);
            if h[k.saturating_sub(p)..].iter().all(|x| x.abs() < 1e-9) {
                break;
            }
        }
        let energy: f64 = h.iter().map(|x| x * x).sum();
        let at = |lag: usize| h.iter().zip(h.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>() / energy;
        (0..lags.min(h.len())).map(at).collect()
    }

    /// Number of independent samples that would determine a mean as well as `samples` of these do.
    pub(crate) fn effective_samples(&self, samples: usize) -> f64 {
        let rho = self.autocorrelation(samples);
        samples as f64 / (1.0 + 2.0 * rho[1.min(rho.len())..].iter().sum::<f64>()).max(f64::MIN_POSITIVE)
    }

    /// Number of independent samples that would determine a variance as well (Bartlett: squared correlations count).
    pub(crate) fn effective_samples_of_variance(&self, samples: usize) -> f64 {
        let rho = self.autocorrelation(samples);
        samples as f64 / (1.0 + 2.0 * rho[1.min(rho.len())..].iter().map(|r| r * r).sum::<f64>())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Standard normal numbers: a linear congruential generator and the Box-Muller transform, so that core needs no generator.
    pub(crate) struct Normal(u64);

    impl Normal {
        pub(crate) fn new(seed: u64) -> Self {
            let mut made = Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x0123_4567_89AB_CDEF);
            for _ in 0..8 {
                made.uniform();
            }
            made
        }

        pub(crate) fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let mixed = (self.0 ^ (self.0 >> 33)).wrapping_mul(0xFF51_AFD7_ED55_8CCD);
            ((mixed >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        }

        pub(crate) fn next(&mut self) -> f64 {
            (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
        }

        /// First-order autoregressive noise of standard deviation `sigma`.
        pub(crate) fn coloured(&mut self, n: usize, sigma: f64, rho: f64) -> Vec<f64> {
            let mut e = sigma * self.next();
            let step = |_| {
                let now = e;
                e = rho * e + sigma * (1.0 - rho * rho).sqrt() * self.next();
                now
            };
            (0..n).map(step).collect()
        }
    }

    #[test]
    fn first_order_noise_is_recognised_over_stretches() {
        let mut normal = Normal::new(1);
        let stretches: Vec<Vec<f64>> = (0..40).map(|_| normal.coloured(200, 2.0, 0.8)).collect();
        let ar = Autoregression::fit(&stretches.iter().map(Vec::as_slice).collect::<Vec<_>>());
        assert!((ar.coefficients[0] - 0.8).abs() < 0.05, "{ar:?}");
        assert!((ar.variance - 4.0).abs() < 0.4, "{ar:?}");
        assert!((ar.innovation - 4.0 * 0.36).abs() < 0.1, "{ar:?}");
        // (1 + 0.8)/(1 − 0.8) = 9 samples of such noise are worth one.
        assert!((ar.effective_samples(8000) / 8000.0 * 9.0 - 1.0).abs() < 0.2, "{}", ar.effective_samples(8000));
    }

    #[test]
    fn white_noise_has_no_colour() {
        let mut normal = Normal::new(2);
        let e: Vec<f64> = (0..2000).map(|_| normal.next()).collect();
        let ar = Autoregression::fit(&[&e]);
        assert!(ar.coefficients.is_empty(), "{ar:?}");
        assert_eq!(ar.effective_samples(2000), 2000.0);
    }

    #[test]
    fn a_mean_under_coloured_noise_has_the_variance_that_the_adjoint_filter_says() {
        // Sum of 500 samples: 1ᵀ R 1 against its closed form σ² Σ (n − |k|) ρ^|k|.
        let (n, rho) = (500, 0.7_f64);
        let ar = Autoregression { coefficients: vec![rho], innovation: 1.0 - rho * rho, variance: 1.0 };
        let mut ones = vec![1.0; n];
        ar.adjoint(&mut ones);
        let found: f64 = ar.innovation * ones.iter().map(|x| x * x).sum::<f64>();
        let wanted: f64 = n as f64 + 2.0 * (1..n).map(|k| (n - k) as f64 * rho.powi(k as i32)).sum::<f64>();
        // The filter starts at rest, the noise does not: a correction of a few samples in 500.
        assert!((found / wanted - 1.0).abs() < 0.01, "{found} {wanted}");
    }
}
