//! The law of the noise: per output an autoregression of its past, across outputs a correlation, per row a weight.
//!
//! Whitening with it turns residuals into uncorrelated numbers of unit variance, so that sums of squares are log-likelihoods.
//! Rows whose innovation is far out for a normal distribution weigh less (Huber): heavy tails are no physics.

use nalgebra::DMatrix;

use crate::fit::layout::Layout;

/// Longest autoregression tried.
const LONGEST: usize = 8;
/// Robust standard deviations beyond which errors and innovations count by their size and not by its square: a few values far out are not motion. 2 keeps
/// 99 % of the efficiency at the normal distribution.
pub(crate) const HUBER: f64 = 2.0;
/// Robust standard deviations beyond which a value tells nothing of how noise goes on: a normal distribution goes there once in two million times. A
/// robot that is stopped for a moment would otherwise make slow noise of all that is left.
pub(crate) const ASTRAY: f64 = 5.0;
/// Standard deviation over median magnitude of a normal distribution.
const MEDIAN_TO_DEVIATION: f64 = 1.482_602_2;

/// A whitening for all outputs and rows of one data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    filters: Vec<Filter>,
    /// By output: standard deviation of the innovations.
    pub innovation: Vec<f64>,
    /// By output: standard deviation of the noise itself.
    pub deviation: Vec<f64>,
    /// By output: size up to which no value is far out, the step in which it is recorded. Errors of rounding are one-sided where the motion stays, and cut
    /// off they would have a mean.
    ordinary: Vec<f64>,
    /// Inverse Cholesky factor of the innovations' correlation, row-major, lower triangular.
    mix: Vec<f64>,
    /// By stretch, output, row: weight of the innovation, 1 where nothing is special.
    pub weights: Vec<Vec<Vec<f64>>>,
}

/// Predictors of every order up to that of the noise, for the first rows of a stretch, and what each leaves.
#[derive(Debug, Clone, PartialEq)]
struct Filter {
    coefficients: Vec<Vec<f64>>,
    gains: Vec<f64>,
}

impl Noise {
    /// White, independent noise of these standard deviations.
    pub(crate) fn white(deviation: &[f64], layout: &Layout) -> Self {
        let n = deviation.len();
        let unsettled = |s: usize, k: usize| if k < layout.unsettled(s) { 0.0 } else { 1.0 };
        let weights = (0..layout.stretches()).map(|s| vec![(0..layout.length(s)).map(|k| unsettled(s, k)).collect(); n]).collect();
        Self {
            filters: vec![Filter { coefficients: vec![Vec::new()], gains: vec![1.0] }; n],
            innovation: deviation.to_vec(),
            deviation: deviation.to_vec(),
            ordinary: vec![0.0; n],
            mix: (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect(),
            weights,
        }
    }

    /// The share of an output's values that its own past does not foretell.
    pub(crate) fn independent(&self, c: usize) -> f64 {
        (self.innovation[c] / self.deviation[c]).powi(2)
    }

    /// The standard deviation of the mean square of so many values of an output, as a share of it. Noise that forgets exponentially, by ρ a sample, says
    /// as much as (1 − ρ²)/(1 + ρ²) of them that are independent.
    pub(crate) fn scatter(&self, c: usize, rows: usize) -> f64 {
        let independent = self.independent(c).min(1.0);
        (2.0 * (2.0 - independent) / (independent * rows.max(1) as f64)).sqrt()
    }

    /// What so many values of each output cost twice a log-likelihood by the size of their innovations, on which whitened residuals are silent.
    pub(crate) fn scale(&self, rows: usize) -> f64 {
        self.innovation.iter().map(|s| 2.0 * rows as f64 * s.ln()).sum()
    }

    /// Estimates the law from residuals in which `taken` degrees of freedom were fitted. No deviation is taken for less than `floor`, and nothing
    /// for far out that is less than the `step` in which an output is recorded.
    pub(crate) fn estimate(residual: &[f64], layout: &Layout, taken: f64, floor: &[f64], step: &[f64]) -> Self {
        let n = layout.outputs();
        let left = (layout.counted() as f64 - taken / n as f64).max(1.0);
        let mut noise = Self::white(&vec![1.0; n], layout);
        noise.ordinary = step.to_vec();
        for c in 0..n {
            let parts: Vec<&[f64]> = (0..layout.stretches()).map(|s| &residual[layout.settled(c, s)]).collect();
            let (filter, variance, innovation) = Filter::estimate(&parts, layout.counted(), [floor[c], step[c]], |_| 0.0);
            let correction = layout.counted() as f64 / left;
            noise.filters[c] = filter;
            noise.deviation[c] = (variance * correction).sqrt().max(floor[c]);
            noise.innovation[c] = (innovation * correction).sqrt().max(floor[c]);
        }
        let mut white = residual.to_vec();
        noise.whiten_flat(layout, &mut white);
        noise.weigh(&white, layout);
        noise.correlate(&white, layout);
        noise
    }

    /// The same law where the noise of each row is louder than usual: by output, flat over the rows, the factor that makes it usual.
    pub(crate) fn evened(&self, residual: &[f64], layout: &Layout, factors: &[Vec<f64>]) -> Self {
        let mut noise = Self { weights: Self::white(&self.deviation, layout).weights, ..self.clone() };
        let mut white = residual.to_vec();
        noise.whiten_flat(layout, &mut white);
        for (c, factors) in factors.iter().enumerate() {
            white[layout.output(c)].iter_mut().zip(factors).for_each(|(x, f)| *x *= f);
        }
        noise.weigh(&white, layout);
        for (c, factors) in factors.iter().enumerate() {
            for s in 0..layout.stretches() {
                let start = layout.part(c, s).start - layout.output(c).start;
                noise.weights[s][c].iter_mut().zip(&factors[start..]).for_each(|(w, f)| *w *= f);
            }
        }
        noise
    }

    /// Weights by the size of each innovation, and the innovations' deviation as the bulk shows it.
    fn weigh(&mut self, white: &[f64], layout: &Layout) {
        for c in 0..layout.outputs() {
            let settled = (0..layout.stretches()).map(|s| &white[layout.settled(c, s)]);
            let Some(far) = far(settled, 1.0, HUBER, self.ordinary[c] / self.innovation[c]) else { continue };
            for s in 0..layout.stretches() {
                let counted = self.weights[s][c].iter_mut().skip(layout.unsettled(s));
                for (w, x) in counted.zip(&white[layout.settled(c, s)]) {
                    *w = (far / x.abs().max(f64::MIN_POSITIVE)).min(1.0).sqrt();
                }
            }
        }
    }

    /// Correlation of the innovations across outputs, by weighted rows.
    fn correlate(&mut self, white: &[f64], layout: &Layout) {
        let n = layout.outputs();
        let mut moments = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let mut sum = 0.0;
                for s in 0..layout.stretches() {
                    let (a, b) = (&white[layout.part(i, s)], &white[layout.part(j, s)]);
                    let (wa, wb) = (&self.weights[s][i], &self.weights[s][j]);
                    sum += a.iter().zip(wa).zip(b.iter().zip(wb)).map(|((a, wa), (b, wb))| a * wa * wa * b * wb * wb).sum::<f64>();
                }
                moments[(i, j)] = sum;
                moments[(j, i)] = sum;
            }
        }
        let correlation = DMatrix::from_fn(n, n, |i, j| {
            if i == j { 1.0 } else { moments[(i, j)] / (moments[(i, i)] * moments[(j, j)]).sqrt().max(f64::MIN_POSITIVE) }
        });
        // Correlations that chance makes are left out.
        let chance = 3.0 / (layout.rows() as f64).sqrt();
        let correlation = correlation.map(|x| if x.abs() < chance { 0.0 } else { x });
        let factor = correlation.cholesky().map(|c| c.l());
        let inverse = factor.and_then(|l| l.solve_lower_triangular(&DMatrix::identity(n, n)));
        if let Some(inverse) = inverse.filter(|m| m.iter().all(|x| x.is_finite() && x.abs() < 1e3)) {
            self.mix = (0..n * n).map(|k| inverse[(k / n, k % n)]).collect();
        }
    }

    /// Order of each output's autoregression.
    pub fn orders(&self) -> Vec<usize> {
        self.filters.iter().map(|f| f.gains.len() - 1).collect()
    }

    /// Whitens values of one output over one stretch by their own past alone, in place; no row is weighted.
    pub fn whiten_output(&self, output: usize, series: &mut [f64]) {
        self.filters[output].apply(series, self.innovation[output]);
    }

    /// Whitens the values of one stretch (by output, then row) in place.
    pub fn whiten(&self, stretch: usize, values: &mut [Vec<f64>]) {
        for (c, series) in values.iter_mut().enumerate() {
            self.filters[c].apply(series, self.innovation[c]);
        }
        let n = values.len();
        for i in (0..n).rev() {
            let (above, rest) = values.split_at_mut(i);
            let row = &self.mix[i * n..(i + 1) * n];
            mix(row, above.iter().map(Vec::as_slice), &mut rest[0]);
        }
        for (series, weights) in values.iter_mut().zip(&self.weights[stretch]) {
            series.iter_mut().zip(weights).for_each(|(x, w)| *x *= w);
        }
    }

    /// The same for all values of a data set at once.
    pub(crate) fn whiten_flat(&self, layout: &Layout, values: &mut [f64]) {
        let n = layout.outputs();
        for c in 0..n {
            for s in 0..layout.stretches() {
                self.filters[c].apply(&mut values[layout.part(c, s)], self.innovation[c]);
            }
        }
        let rows = layout.rows();
        for i in (1..n).rev() {
            let row = &self.mix[i * n..(i + 1) * n];
            if row[..i].iter().any(|x| *x != 0.0) {
                let (above, rest) = values.split_at_mut(i * rows);
                mix(row, above.chunks_exact(rows), &mut rest[..rows]);
            }
        }
        for c in 0..n {
            for s in 0..layout.stretches() {
                values[layout.part(c, s)].iter_mut().zip(&self.weights[s][c]).for_each(|(x, w)| *x *= w);
            }
        }
    }
}

/// A whitening of one output's series by their own past, as the rest of a regression of innovations on orthonormal columns has it, stretch by
/// stretch. What the columns take they take at all lags: of innovations that were white already their own products, to which those of the
/// rest are short. Nothing below an `ordinary` size is astray.
pub(crate) fn whitener(rest: &[Vec<f64>], columns: &[Vec<Vec<f64>>], ordinary: f64) -> impl Fn(&mut [f64]) + use<> {
    let rest: Vec<&[f64]> = rest.iter().map(Vec::as_slice).collect();
    let rows: usize = rest.iter().map(|part| part.len()).sum();
    let taken: Vec<f64> = (0..=LONGEST).map(|lag| columns.iter().map(|column| products(column, lag)).sum()).collect();
    let left = (rows as f64 - taken[0]).max(1.0);
    let short = squares(&rest) / left;
    let (filter, _, innovation) = Filter::estimate(&rest, rows, [0.0, ordinary], |lag| short * taken[lag]);
    let deviation = (innovation * rows as f64 / left).sqrt();
    move |series| filter.apply(series, deviation)
}

/// Draws in what is far out of innovations of unit variance, beyond an `ordinary` size: heavy tails are no physics.
pub(crate) fn draw_in(innovations: &mut [f64], ordinary: f64) {
    if let Some(far) = far(std::iter::once(&*innovations), 1.0, HUBER, ordinary) {
        innovations.iter_mut().for_each(|x| *x = x.clamp(-far, far));
    }
}

/// Sum of squares.
fn squares(parts: &[&[f64]]) -> f64 {
    products(parts, 0)
}

/// Sum of products of values a lag apart.
pub(crate) fn products(parts: &[impl AsRef<[f64]>], lag: usize) -> f64 {
    parts.iter().map(AsRef::as_ref).map(|part| part.iter().zip(part.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum()
}

/// What is far out of values whose root mean square is about `size`: so many robust standard deviations, and never below an `ordinary` size. `None` as for
/// [`spread`].
pub(crate) fn far<'v>(parts: impl Iterator<Item = &'v [f64]>, size: f64, deviations: f64, ordinary: f64) -> Option<f64> {
    spread(parts, size).map(|spread| (deviations * spread).max(ordinary))
}

/// Robust standard deviation of values whose root mean square is about `size`. `None` where more than half of them are exactly alike (a coarse
/// lattice): the bulk has no spread to go by.
fn spread<'v>(parts: impl Iterator<Item = &'v [f64]>, size: f64) -> Option<f64> {
    let mut sizes: Vec<f64> = parts.flatten().map(|x| x.abs()).collect();
    if sizes.is_empty() {
        return None;
    }
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    Some(MEDIAN_TO_DEVIATION * median).filter(|spread| *spread >= 0.1 * size)
}

/// One row of the mixing of outputs, the last of `row` that is not zero its own.
fn mix<'v>(row: &[f64], above: impl Iterator<Item = &'v [f64]>, own: &mut [f64]) {
    let above: Vec<&[f64]> = above.collect();
    let factor = row[above.len()];
    own.iter_mut().for_each(|x| *x *= factor);
    for (other, factor) in above.iter().zip(row).filter(|(_, f)| **f != 0.0) {
        own.iter_mut().zip(*other).for_each(|(x, y)| *x += factor * y);
    }
}

impl Filter {
    /// Yule-Walker over all stretches, by the Levinson recursion, values astray left out; the order by BIC with a doubled penalty. Returns the
    /// filter and the variances of noise and innovation. Nothing below an `ordinary` size is astray; `short` is what sums of products a lag apart are short of.
    fn estimate(parts: &[&[f64]], rows: usize, [floor, ordinary]: [f64; 2], short: impl Fn(usize) -> f64) -> (Self, f64, f64) {
        let longest = LONGEST.min(rows / (10 * parts.len().max(1))).min(rows / 20);
        let white = Self { coefficients: vec![Vec::new()], gains: vec![1.0] };
        let variance = squares(parts) / rows as f64;
        if variance.is_nan() || variance <= floor * floor {
            return (white, variance.max(0.0), variance.max(0.0));
        }
        let most = far(parts.iter().copied(), variance.sqrt(), ASTRAY, ordinary).unwrap_or(f64::INFINITY);
        let bulk: Vec<Vec<f64>> = parts.iter().map(|part| part.iter().map(|x| if x.abs() > most { 0.0 } else { *x }).collect()).collect();
        let covariance: Vec<f64> = (0..=longest).map(|lag| (products(&bulk, lag) + short(lag)) / rows as f64).collect();
        let (mut coefficients, mut variances) = (vec![Vec::new()], vec![covariance[0]]);
        for p in 1..=longest {
            let last: &Vec<f64> = &coefficients[p - 1];
            let foreseen: f64 = last.iter().enumerate().map(|(i, a)| a * covariance[p - 1 - i]).sum();
            let reflection = (covariance[p] - foreseen) / variances[p - 1];
            let mut next: Vec<f64> = (0..p - 1).map(|i| last[i] - reflection * last[p - 2 - i]).collect();
            next.push(reflection);
            let variance = variances[p - 1] * (1.0 - reflection * reflection);
            if variance.is_nan() || variance <= 1e-12 * covariance[0] {
                break;
            }
            coefficients.push(next);
            variances.push(variance);
        }
        let n = rows as f64;
        let criterion = |p: usize| n * variances[p].ln() + 2.0 * p as f64 * n.ln();
        let order = (0..variances.len()).fold(0, |best, p| if criterion(p) < criterion(best) { p } else { best });
        coefficients.truncate(order + 1);
        let gains = variances[..=order].iter().map(|v| (variances[order] / v).sqrt()).collect();
        let filter = Self { coefficients, gains };
        let mut innovations: Vec<Vec<f64>> = parts.iter().map(|part| part.to_vec()).collect();
        innovations.iter_mut().for_each(|part| filter.apply(part, 1.0));
        let new: Vec<&[f64]> = innovations.iter().map(Vec::as_slice).collect();
        (filter, variance, squares(&new) / rows as f64)
    }

    /// Turns noise into innovations in units of their standard deviation, in place.
    fn apply(&self, series: &mut [f64], innovation: f64) {
        let order = self.gains.len() - 1;
        let unit = 1.0 / innovation;
        let a = &self.coefficients[order];
        for k in (order..series.len()).rev() {
            let foreseen: f64 = a.iter().enumerate().map(|(i, a)| a * series[k - 1 - i]).sum();
            series[k] = (series[k] - foreseen) * unit;
        }
        for k in (0..order.min(series.len())).rev() {
            let foreseen: f64 = self.coefficients[k].iter().enumerate().map(|(i, a)| a * series[k - 1 - i]).sum();
            series[k] = (series[k] - foreseen) * self.gains[k] * unit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Case, normal};
    use rand::SeedableRng;
    use rand::rngs::StdRng;

    fn series(seed: u64, coefficient: f64, layout: &Layout) -> Vec<f64> {
        let mut random = StdRng::seed_from_u64(seed);
        let mut last = 0.0;
        (0..layout.len())
            .map(|_| {
                last = coefficient * last + normal(&mut random);
                last
            })
            .collect()
    }

    fn moments(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let variance = values.iter().map(|x| x * x).sum::<f64>() / n;
        (variance, values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n / variance)
    }

    #[test]
    fn coloured_noise_becomes_white_with_unit_variance() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        let residual = series(2, 0.8, &layout);
        let noise = Noise::estimate(&residual, &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
        assert_eq!(noise.orders(), [1, 1]);
        let mut white = residual.clone();
        noise.whiten_flat(&layout, &mut white);
        let (variance, neighbour) = moments(&white);
        // Weights take a little of the tails of a normal distribution.
        assert!((0.9..1.02).contains(&variance) && neighbour.abs() < 0.05, "{variance} {neighbour}");
        assert!((noise.deviation[0] / noise.innovation[0] - 1.0 / 0.6).abs() < 0.15, "{noise:?}", noise = noise.deviation);
    }

    #[test]
    fn the_mean_square_of_slow_noise_scatters_more() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        for coefficient in [0.0, 0.6, 0.9] {
            let all: Vec<f64> = (0..60).map(|seed| moments(&series(seed, coefficient, &layout)).0).collect();
            let mean = all.iter().sum::<f64>() / 60.0;
            let scatter = (all.iter().map(|x| (x / mean - 1.0).powi(2)).sum::<f64>() / 59.0).sqrt();
            let noise = Noise::estimate(&series(99, coefficient, &layout), &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
            let told = noise.scatter(0, layout.len());
            assert!((scatter / told - 1.0).abs() < 0.25, "{coefficient}: {scatter} {told}");
        }
    }

    #[test]
    fn a_robot_that_is_stopped_for_moments_makes_no_slow_noise() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        let mut residual = series(6, 0.0, &layout);
        for start in (100..layout.rows() - 20).step_by(400) {
            residual[start..start + 12].iter_mut().for_each(|x| *x -= 30.0);
        }
        let noise = Noise::estimate(&residual, &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
        let (before, after) = (residual[105], {
            noise.whiten_output(0, &mut residual[..layout.rows()]);
            residual[105] * noise.innovation[0]
        });
        assert!(after < 0.9 * before, "{after} of {before}: the filter takes a stop for noise that goes on");
    }

    #[test]
    fn whole_and_by_stretches_it_is_the_same_filter() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        let residual = series(3, 0.5, &layout);
        let noise = Noise::estimate(&residual, &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
        let mut whole = residual.clone();
        noise.whiten_flat(&layout, &mut whole);
        let mut parts = layout.series(&residual);
        parts.iter_mut().enumerate().for_each(|(s, part)| noise.whiten(s, part));
        let whole = layout.series(&whole);
        let worst = whole.iter().flatten().flatten().zip(parts.iter().flatten().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-12, "{worst}");
    }

    #[test]
    fn far_out_values_weigh_less_and_correlated_outputs_are_untangled() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        let mut residual = series(4, 0.0, &layout);
        residual[100] = 30.0;
        for k in 0..layout.rows() {
            residual[layout.rows() + k] = 0.6 * residual[layout.rows() + k] + 0.8 * if k == 100 { 0.0 } else { residual[k] };
        }
        let noise = Noise::estimate(&residual, &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
        assert!(noise.weights[0][0][100] < 0.3 && noise.weights[0][0][99] > 0.5);
        let mut white = residual;
        noise.whiten_flat(&layout, &mut white);
        let (a, b) = white.split_at(layout.rows());
        let product: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / layout.rows() as f64;
        // It was 0.8; what is left is the difference between weights before and after the untangling.
        assert!(product.abs() < 0.1, "{product}");
    }

    #[test]
    fn rows_known_to_be_louder_are_evened_out() {
        let case = Case::clean(1);
        let layout = Layout::of(&case.data, &case.scene);
        // Every other row of both outputs is three times as loud.
        let factor = |k: usize| if k.is_multiple_of(2) { 1.0 } else { 1.0 / 3.0 };
        let residual: Vec<f64> = series(5, 0.0, &layout).iter().enumerate().map(|(k, x)| x / factor(k % layout.rows())).collect();
        let factors = vec![(0..layout.rows()).map(factor).collect::<Vec<f64>>(); 2];
        let plain = Noise::estimate(&residual, &layout, 0.0, &[1e-9; 2], &[0.0; 2]);
        let ratio = |noise: &Noise| {
            let mut white = residual.clone();
            noise.whiten_flat(&layout, &mut white);
            let power = |odd: usize| (odd..layout.rows()).step_by(2).map(|k| white[k] * white[k]).sum::<f64>();
            power(1) / power(0)
        };
        assert!(ratio(&plain) > 2.5, "{}", ratio(&plain));
        let evened = ratio(&plain.evened(&residual, &layout, &factors));
        assert!((0.85..1.15).contains(&evened), "{evened}");
    }
}
