//! The law of the noise: per output an autoregression of its past, across outputs a covariance, per row a weight.
//!
//! Whitening with it turns residuals into uncorrelated numbers of unit variance, so that sums of squares are log-likelihoods.

/// A whitening for all outputs and rows of one data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// By output: coefficients of the autoregression.
    pub coefficients: Vec<Vec<f64>>,
    /// By output: standard deviation of the innovations.
    pub innovation: Vec<f64>,
    /// By output: standard deviation of the noise itself.
    pub deviation: Vec<f64>,
    /// Inverse Cholesky factor of the innovations' correlation, row-major, lower triangular.
    pub mix: Vec<f64>,
    /// By stretch, output, row: weight of the innovation, 1 where nothing is special.
    pub weights: Vec<Vec<Vec<f64>>>,
}

impl Noise {
    /// Whitens the values of one stretch (by output, then row) in place.
    pub fn whiten(&self, stretch: usize, values: &mut [Vec<f64>]) {
        for (output, series) in values.iter_mut().enumerate() {
            let a = &self.coefficients[output];
            for k in (0..series.len()).rev() {
                let foreseen: f64 = a.iter().zip(series[..k].iter().rev()).map(|(a, e)| a * e).sum();
                series[k] = (series[k] - foreseen) / self.innovation[output];
            }
        }
        let n = values.len();
        for i in (0..n).rev() {
            let (above, rest) = values.split_at_mut(i);
            for (k, x) in rest[0].iter_mut().enumerate() {
                *x = self.mix[i * n + i] * *x + above.iter().enumerate().map(|(j, o)| self.mix[i * n + j] * o[k]).sum::<f64>();
            }
        }
        for (series, weights) in values.iter_mut().zip(&self.weights[stretch]) {
            series.iter_mut().zip(weights).for_each(|(x, w)| *x *= w);
        }
    }
}
