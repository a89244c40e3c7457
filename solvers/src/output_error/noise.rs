//! What the simulation error is besides a fault of the parameters: per output an autoregression, across outputs a
//! covariance of its innovations.
//!
//! e_k = Σ a_i e_{k−i} + η_k. Dividing it out makes the errors white, which weights the fit as maximum likelihood does
//! and makes its standard errors right for coloured noise. The first rows of a stretch are predicted with the lower
//! orders that the Levinson recursion gives on its way, so none is lost.

use nalgebra::DMatrix;

/// Values by output, then row.
pub(crate) type Channels = Vec<Vec<f64>>;

/// A whitening filter for all outputs.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    filters: Vec<Autoregression>,
    /// Inverse of the Cholesky factor of the innovations' covariance.
    mix: DMatrix<f64>,
}

#[derive(Debug, Clone, Default)]
struct Autoregression {
    /// Coefficients of the predictors of order 0 up to the order of the noise.
    coefficients: Vec<Vec<f64>>,
    /// Ratio of the innovation's standard deviation to that of each predictor's error.
    gain: Vec<f64>,
}

/// Longest autoregression tried: 10 log10 of the rows, as is usual.
fn longest(rows: usize) -> usize {
    ((10.0 * (rows as f64).log10()) as usize).min(rows / 10)
}

impl Noise {
    /// White, independent noise of these standard deviations.
    pub(crate) fn white(deviations: &[f64]) -> Self {
        let filters = deviations.iter().map(|_| Autoregression::white()).collect();
        let mix = DMatrix::from_diagonal(&nalgebra::DVector::from_iterator(deviations.len(), deviations.iter().map(|d| 1.0 / d)));
        Self { filters, mix }
    }

    /// Estimated from the errors of each stretch; no deviation is taken for less than its `floor`. Orders are chosen by
    /// BIC, or given, or zero for `Some(&[0, ..])`.
    pub(crate) fn estimate(errors: &[Channels], floor: &[f64], orders: Option<&[usize]>) -> Self {
        let outputs = floor.len();
        let filters = (0..outputs).map(|c| {
            let series: Vec<&[f64]> = errors.iter().map(|e| e[c].as_slice()).collect();
            Autoregression::estimate(&series, floor[c], orders.map(|o| o[c]))
        });
        let mut noise = Self { filters: filters.collect(), mix: DMatrix::identity(outputs, outputs) };
        let mut covariance = DMatrix::zeros(outputs, outputs);
        let mut rows = 0;
        for stretch in errors {
            let mut innovations = stretch.clone();
            noise.whiten(&mut innovations);
            rows += innovations[0].len();
            for i in 0..outputs {
                for j in 0..outputs {
                    covariance[(i, j)] += innovations[i].iter().zip(&innovations[j]).map(|(a, b)| a * b).sum::<f64>();
                }
            }
        }
        covariance /= rows as f64;
        (0..outputs).for_each(|i| covariance[(i, i)] = covariance[(i, i)].max(floor[i] * floor[i]));
        let diagonal = DMatrix::from_diagonal(&covariance.diagonal());
        let factor = covariance.cholesky().or_else(|| diagonal.cholesky()).map(|c| c.l());
        let inverse = factor.and_then(|l| l.solve_lower_triangular(&DMatrix::identity(outputs, outputs)));
        if let Some(inverse) = inverse {
            noise.mix = inverse;
        }
        noise
    }

    /// Order of each output's autoregression.
    pub(crate) fn orders(&self) -> Vec<usize> {
        self.filters.iter().map(|f| f.gain.len() - 1).collect()
    }

    /// Turns the values of one stretch into uncorrelated ones of unit variance, in place.
    pub(crate) fn whiten(&self, values: &mut Channels) {
        for (filter, series) in self.filters.iter().zip(values.iter_mut()) {
            filter.apply(series);
        }
        // From the last output up: the factor is lower triangular, so those above are not needed again.
        for i in (0..values.len()).rev() {
            let (above, rest) = values.split_at_mut(i);
            let own = self.mix[(i, i)];
            rest[0].iter_mut().for_each(|x| *x *= own);
            for (j, other) in above.iter().enumerate() {
                let factor = self.mix[(i, j)];
                rest[0].iter_mut().zip(other).for_each(|(x, y)| *x += factor * y);
            }
        }
    }

    /// The transposed inverse of [`whiten`](Self::whiten), in place: xᵀ e = (this x)ᵀ (e whitened).
    pub(super) fn unwhiten_transposed(&self, values: &mut Channels) {
        for (filter, series) in self.filters.iter().zip(values.iter_mut()) {
            filter.unapply_transposed(series);
        }
        // The transposed factor is upper triangular: substitution from the last output up.
        for i in (0..values.len()).rev() {
            let (above, below) = values.split_at_mut(i + 1);
            for (j, other) in below.iter().enumerate() {
                let factor = self.mix[(i + 1 + j, i)];
                above[i].iter_mut().zip(other).for_each(|(x, y)| *x -= factor * y);
            }
            above[i].iter_mut().for_each(|x| *x /= self.mix[(i, i)]);
        }
    }
}

impl Autoregression {
    fn white() -> Self {
        Self { coefficients: vec![Vec::new()], gain: vec![1.0] }
    }

    /// Yule-Walker over all stretches, by the Levinson recursion.
    fn estimate(series: &[&[f64]], floor: f64, order: Option<usize>) -> Self {
        let rows: usize = series.iter().map(|s| s.len()).sum();
        let most = order.unwrap_or_else(|| longest(rows));
        let covariance: Vec<f64> = (0..=most)
            .map(|lag| series.iter().map(|s| s.iter().zip(s.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum::<f64>() / rows as f64)
            .collect();
        if covariance[0] <= floor * floor {
            return Self::white();
        }
        let (mut coefficients, mut variances) = (vec![Vec::new()], vec![covariance[0]]);
        for p in 1..=most {
            let last: &Vec<f64> = &coefficients[p - 1];
            let left = covariance[p] - last.iter().enumerate().map(|(i, a)| a * covariance[p - 1 - i]).sum::<f64>();
            let reflection = left / variances[p - 1];
            let mut next: Vec<f64> = (0..p - 1).map(|i| last[i] - reflection * last[p - 2 - i]).collect();
            next.push(reflection);
            coefficients.push(next);
            variances.push(variances[p - 1] * (1.0 - reflection * reflection));
        }
        let bic = |p: usize| rows as f64 * variances[p].ln() + p as f64 * (rows as f64).ln();
        let order = order.unwrap_or_else(|| (0..=most).fold(0, |best, p| if bic(p) < bic(best) { p } else { best }));
        coefficients.truncate(order + 1);
        let gain = variances[..=order].iter().map(|v| (variances[order] / v).sqrt()).collect();
        Self { coefficients, gain }
    }

    fn apply(&self, series: &mut [f64]) {
        let order = self.gain.len() - 1;
        if order == 0 {
            return;
        }
        for k in (0..series.len()).rev() {
            let p = k.min(order);
            let (past, now) = series.split_at_mut(k);
            let predicted: f64 = self.coefficients[p].iter().zip(past.iter().rev()).map(|(a, e)| a * e).sum();
            now[0] = (now[0] - predicted) * self.gain[p];
        }
    }

    fn unapply_transposed(&self, series: &mut [f64]) {
        let order = self.gain.len() - 1;
        for k in (0..series.len()).rev() {
            let p = k.min(order);
            series[k] /= self.gain[p];
            let now = series[k] * self.gain[p];
            series[..k].iter_mut().rev().zip(&self.coefficients[p]).for_each(|(x, a)| *x += a * now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn autoregressive(coefficient: f64, rows: usize) -> Vec<f64> {
        // A fixed full-period linear congruence: noise enough for a variance.
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut last = 0.0;
        (0..rows)
            .map(|_| {
                last = coefficient * last + 12.0_f64.sqrt() * uniform();
                last
            })
            .collect()
    }

    #[test]
    fn an_autoregression_is_found_and_divided_out() {
        let errors = vec![vec![autoregressive(0.8, 20_000)]];
        let noise = Noise::estimate(&errors, &[1e-9], None);
        assert_eq!(noise.orders(), [1]);
        assert!((noise.filters[0].coefficients[1][0] - 0.8).abs() < 0.02);
        let mut white = errors[0].clone();
        noise.whiten(&mut white);
        let variance = white[0].iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        assert!((variance - 1.0).abs() < 1e-3, "{variance}");
    }

    #[test]
    fn the_transposed_inverse_keeps_products() {
        let (a, b) = (autoregressive(0.9, 400), autoregressive(0.5, 400));
        let mixed = a.iter().zip(&b).map(|(a, b)| 0.1 * (a + 0.3 * b)).collect();
        let mut errors = vec![a, mixed];
        let noise = Noise::estimate(&[errors.clone()], &[1e-9; 2], Some(&[3, 1]));
        let mut column: Channels = (0..2).map(|c| (0..400).map(|k| (0.1 * k as f64 + c as f64).sin()).collect()).collect();
        let product = |x: &Channels, y: &Channels| x.iter().flatten().zip(y.iter().flatten()).map(|(a, b)| a * b).sum::<f64>();
        let before = product(&column, &errors);
        noise.unwhiten_transposed(&mut column);
        noise.whiten(&mut errors);
        assert!((product(&column, &errors) - before).abs() < 1e-11 * before.abs(), "{} for {before}", product(&column, &errors));
    }

    /// The likelihood of a Gaussian autoregression is that of its covariance matrix: ‖whitened‖² = eᵀ C⁻¹ e.
    #[test]
    fn the_first_rows_are_whitened_exactly() {
        let filter = Autoregression::estimate(&[&autoregressive(0.8, 20_000)], 1e-9, Some(2));
        let noise = Noise { filters: vec![filter.clone()], mix: DMatrix::identity(1, 1) };
        // Columns of the identity, whitened, make the inverse Cholesky factor up to the innovation's variance.
        let n = 8;
        let mut whitening = DMatrix::zeros(n, n);
        for j in 0..n {
            let mut unit = vec![(0..n).map(|i| f64::from(u8::from(i == j))).collect::<Vec<f64>>()];
            noise.whiten(&mut unit);
            whitening.column_mut(j).copy_from_slice(&unit[0]);
        }
        let covariance = (whitening.transpose() * &whitening).try_inverse().unwrap();
        let toeplitz = (0..n - 1).flat_map(|i| (0..n - 1).map(move |j| (i, j)));
        for (i, j) in toeplitz {
            assert!((covariance[(i, j)] - covariance[(i + 1, j + 1)]).abs() < 1e-12 * covariance[(0, 0)], "not stationary at {i}, {j}");
        }
        let [a, b] = [filter.coefficients[2][0], filter.coefficients[2][1]];
        assert!((covariance[(0, 1)] / covariance[(0, 0)] - a / (1.0 - b)).abs() < 1e-12, "Yule-Walker");
    }

    #[test]
    fn correlated_outputs_become_uncorrelated() {
        let (a, b) = (autoregressive(0.0, 5000), autoregressive(0.5, 5000));
        let mixed = a.iter().zip(&b).map(|(a, b)| 0.01 * (a + 0.3 * b)).collect();
        let errors = vec![vec![a, mixed]];
        let noise = Noise::estimate(&errors, &[1e-9; 2], Some(&[0, 0]));
        let mut white = errors[0].clone();
        noise.whiten(&mut white);
        let moment = |i: usize, j: usize| white[i].iter().zip(&white[j]).map(|(a, b)| a * b).sum::<f64>() / 5000.0;
        for (i, j, expected) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, 0.0)] {
            assert!((moment(i, j) - expected).abs() < 1e-12, "{} at {i}, {j}", moment(i, j));
        }
    }
}
