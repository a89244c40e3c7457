//! The colour of an error that arrives sample by sample: a short autoregression from running autocovariances.

/// Longest autoregression.
pub(super) const ORDER: usize = 6;

/// Running autocovariances of one error, and the autoregression made of them when it was last asked.
#[derive(Debug, Clone, Default)]
pub(super) struct Colour {
    covariance: [f64; ORDER + 1],
    weight: f64,
    past: [f64; ORDER],
    known: usize,
    /// Coefficients of the past values, the newest first; zero beyond the order.
    pub(super) coefficients: [f64; ORDER],
    /// Number of coefficients in use.
    pub(super) order: usize,
    /// Standard deviation of what the past does not foretell; zero until [`update`](Self::update) saw an error.
    pub(super) deviation: f64,
    /// Standard deviation of the error itself.
    pub(super) spread: f64,
    /// Share of its variance that the past foretells.
    pub(super) foretold: f64,
}

impl Colour {
    /// Forgets the past values, at a break.
    pub(super) fn interrupt(&mut self) {
        self.known = 0;
    }

    /// Forgets what was seen, not the autoregression made of it.
    pub(super) fn clear(&mut self) {
        (self.covariance, self.weight, self.known) = ([0.0; ORDER + 1], 0.0, 0);
    }

    /// Lets what was seen count less.
    pub(super) fn fade(&mut self, factor: f64) {
        self.covariance.iter_mut().for_each(|c| *c *= factor);
        self.weight *= factor;
    }

    /// Sees the next error.
    pub(super) fn see(&mut self, error: f64) {
        self.weight += 1.0;
        self.covariance[0] += error * error;
        for (c, past) in self.covariance[1..].iter_mut().zip(&self.past[..self.known]) {
            *c += error * past;
        }
        self.past.rotate_right(1);
        self.past[0] = error;
        self.known = (self.known + 1).min(ORDER);
    }

    /// Correlation of neighbouring errors, with the number of them that it was found from.
    pub(super) fn neighbours(&self) -> (f64, f64) {
        (self.covariance[1] / self.covariance[0], self.weight)
    }

    /// Makes the autoregression anew: Yule-Walker by Levinson's recursion, its order by BIC.
    pub(super) fn update(&mut self) {
        let n = self.weight;
        if n <= ORDER as f64 || self.covariance[0] <= 0.0 {
            return;
        }
        let r = self.covariance.map(|c| c / n);
        let (mut a, mut innovation) = ([0.0; ORDER], r[0]);
        (self.coefficients, self.order, self.foretold) = (a, 0, 0.0);
        (self.deviation, self.spread) = (innovation.sqrt(), innovation.sqrt());
        let mut least = n * innovation.ln();
        for p in 1..=ORDER {
            let known: f64 = (0..p - 1).map(|j| a[j] * r[p - 1 - j]).sum();
            let reflection = (r[p] - known) / innovation;
            let before = a;
            (0..p - 1).for_each(|j| a[j] -= reflection * before[p - 2 - j]);
            a[p - 1] = reflection;
            innovation *= 1.0 - reflection * reflection;
            // An error without noise, or a sum that rounding left without a variance.
            if innovation.is_nan() || innovation <= 1e-12 * r[0] {
                return;
            }
            let criterion = n * innovation.ln() + p as f64 * n.ln();
            if criterion < least {
                (least, self.coefficients, self.order, self.deviation) = (criterion, a, p, innovation.sqrt());
                self.foretold = 1.0 - innovation / r[0];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_autoregression_is_found_again() {
        // A linear congruential generator and the sum of twelve: near enough to normal.
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let mut colour = Colour::default();
        let mut x = [0.0; 2];
        for k in 0..20_000 {
            let next = 0.3 * normal() + 1.2 * x[0] - 0.5 * x[1];
            x = [next, x[0]];
            if k % 5_000 == 0 {
                colour.interrupt();
            }
            colour.see(next);
        }
        colour.update();
        assert_eq!(colour.order, 2);
        let [a, b, ..] = colour.coefficients;
        assert!((a - 1.2).abs() < 0.02 && (b + 0.5).abs() < 0.02 && (colour.deviation - 0.3).abs() < 0.01, "{colour:?}");
    }

    #[test]
    fn no_error_has_no_colour() {
        let mut colour = Colour::default();
        (0..100).for_each(|_| colour.see(0.0));
        colour.update();
        assert_eq!((colour.order, colour.deviation), (0, 0.0));
    }
}
