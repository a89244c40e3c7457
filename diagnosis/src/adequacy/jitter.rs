//! Jitter of stamps: noise that grows with acceleration.
//!
//! A stamp that is wrong by ε moves a sample along the curve, y(t + ε) = y(t) + ẏ ε, so the residual's variance is s0² + σt² ẏ².
//! Motion that the model misses grows with acceleration too, but goes on from one sample to the next, which stamps that are
//! off by chance do not: products of neighbours are held against products of their slopes, and where they grow half as much as the squares
//! it is no jitter. And one stamp moves all outputs of its row, each by its own slope: products of two outputs of a row grow with those of their slopes as
//! squares do with squares, where it is the stamp that is off, and not where each output has a misfit of its own (play, a wheel that is missed). Rounding is loud as well where an output goes from step to step, and silent where it stays within one: behind little other noise only
//! rows count in which it goes by a step and more. Nor can stamps that stand in order be off, for sure, by more than their distance.

use crate::comparison::Comparison;

use super::bursts::FALSE_ALARM;

/// Share of what squares tell that products of outputs have to tell as well, and those of neighbours may not, and the standard errors by which the first are
/// surely below all of it.
const SHARED: f64 = 0.5;
const BELOW: f64 = 2.0;

/// Squared innovations are cut here, so that single outliers decide nothing.
const CUT: f64 = 9.0;

/// Share of the noise's variance, on the average over the scatter that jitter makes, below which other noise covers it.
const COVERED: f64 = 0.1;

/// Share of the noise's variance that rounding to a step makes, q²/12, from which on it hangs on the motion how loud it is.
const ROUNDED: f64 = 0.5;

/// Standard errors by which noise must grow: their square is the evidence that a parameter must have to be searched for (ln N + 2 ln 50).
pub(super) const SURE: f64 = 4.0;

/// What is off by a time of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scatter {
    /// Each sample's stamp.
    Stamps,
    /// Each message's arrival, and so all samples until the next one.
    Messages,
}

/// Times that scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jitter {
    /// Of what.
    pub of: Scatter,
    /// Their standard deviation \[s\].
    pub deviation: f64,
    /// Standard error of it \[s\].
    pub error: f64,
    /// Correlation of squared innovations with jitter's share of the variance, in standard errors.
    pub z: f64,
    /// Share of the noise's variance that is there where nothing changes.
    pub still: f64,
}

pub(super) fn find(comparison: &Comparison<'_>) -> Option<Jitter> {
    let found = found_where(comparison, &|_, _| true)?;
    let coarse = |output: usize| {
        let step = comparison.rounded[output];
        if step * step / 12.0 > ROUNDED * comparison.noise[output].powi(2) { step } else { 0.0 }
    };
    let steps: Vec<f64> = (0..comparison.outputs()).map(coarse).collect();
    if steps.iter().all(|step| *step == 0.0) {
        return Some(found);
    }
    // From one sample to the next it goes by every place of a step.
    let passes = |output: usize, slope: f64| slope.abs() * comparison.scene.scales.period >= steps[output];
    found_where(comparison, &passes)
}

/// The jitter that shows in the rows of an output, at a slope, that are looked at.
fn found_where(comparison: &Comparison<'_>, looked_at: &dyn Fn(usize, f64) -> bool) -> Option<Jitter> {
    let seen_by = |output: usize| -> Seen {
        let (slopes, residual) = (slopes_of(comparison, output, 0.0), left_of(comparison, output));
        let noise = comparison.noise[output];
        let rows = (0..slopes.len()).filter(|k| looked_at(output, slopes[*k])).collect();
        Seen { rows, residual, slopes: slopes.iter().map(|s| s / noise).collect() }
    };
    let seen: Vec<Seen> = (0..comparison.outputs()).map(seen_by).collect();
    // All outputs speak of the same stamps: in units of their own noise they are one series.
    let (mut squares, mut slopes) = (Vec::new(), Vec::new());
    for of in &seen {
        squares.extend(of.rows.iter().map(|k| of.residual[*k].powi(2)));
        slopes.extend(of.rows.iter().map(|k| of.slopes[*k].powi(2)));
    }
    let grown = growth(&squares, &slopes)?;
    let (Growth { still, .. }, neighbours) = (grown, Products::of_neighbours(comparison, &seen).growth(grown.variance));
    let Growth { variance, error, .. } = grown.with(Products::of_outputs(&seen).growth(grown.variance))?;
    // Where the variance is jitter's. The few samples at which an output jumps say no more of that than others at which it is.
    let mut shares = slopes.iter().map(|x| variance * x / (still + variance * x));
    let correlated = |(output, seen): (usize, &Seen)| {
        let innovations = comparison.innovations(output);
        let white: Vec<f64> = seen.rows.iter().map(|k| innovations[*k].powi(2).min(CUT)).collect();
        let shares: Vec<f64> = shares.by_ref().take(seen.rows.len()).collect();
        correlation(&white, &shares) * (seen.rows.len() as f64).sqrt()
    };
    let z: Vec<f64> = seen.iter().enumerate().filter(|(_, seen)| !seen.rows.is_empty()).map(correlated).collect();
    let combined = z.iter().sum::<f64>() / (z.len() as f64).sqrt();
    let limit = statrs::distribution::ContinuousCDF::inverse_cdf(&statrs::distribution::Normal::standard(), 1.0 - FALSE_ALARM);
    if combined < limit || z.iter().any(|z| *z < 0.0) {
        return None;
    }
    let chance = neighbours.is_none_or(|n| n.variance < SHARED * variance);
    let orderly = variance - SURE * error < comparison.scene.scales.period.powi(2);
    // Jitter is at home where an output changes fast, which may be seldom: what it makes counts where it makes it.
    let seen = variance * slopes.iter().map(|s| s * s).sum::<f64>() > COVERED * slopes.iter().sum::<f64>();
    (variance > SURE * error && chance && orderly && seen).then(|| Jitter {
        of: Scatter::Stamps,
        deviation: variance.sqrt(),
        error: error / (2.0 * variance.sqrt()),
        z: combined,
        still,
    })
}

/// Rows of an output that are looked at, and what is left of it and its slopes, both in units of its noise.
struct Seen {
    rows: Vec<usize>,
    residual: Vec<f64>,
    slopes: Vec<f64>,
}

/// A variance a + b x of residuals.
#[derive(Debug, Clone, Copy)]
pub(super) struct Growth {
    /// a.
    pub(super) still: f64,
    /// b.
    pub(super) variance: f64,
    /// Standard error of b.
    pub(super) error: f64,
}

/// Weighted regression of squares on slopes: variance a + b x has errors proportional to itself.
pub(super) fn growth(squares: &[f64], slopes: &[f64]) -> Option<Growth> {
    // As if half of the variance were jitter's: under equal weights the few samples at which an output jumps decide.
    let (mut a, mut b, mut error) = (1.0, slopes.len() as f64 / slopes.iter().sum::<f64>().max(f64::MIN_POSITIVE), f64::INFINITY);
    for _ in 0..20 {
        let (mut s, mut sx, mut sxx, mut sy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (y, x) in squares.iter().zip(slopes) {
            let variance: f64 = a + b * x;
            let w = 1.0 / (2.0 * variance * variance);
            let y = y.min(CUT * variance);
            s += w;
            sx += w * x;
            sxx += w * x * x;
            sy += w * y;
            sxy += w * x * y;
        }
        let determinant = s * sxx - sx * sx;
        if determinant <= 0.0 {
            return None;
        }
        a = ((sxx * sy - sx * sxy) / determinant).max(1e-3);
        b = ((s * sxy - sx * sy) / determinant).max(0.0);
        error = (s / determinant).sqrt();
    }
    // Squares of noise with heavy tails scatter more than those of a normal one, whose variance is two.
    let scatter = |(y, x): (&f64, &f64)| ((y / (a + b * x)).min(CUT) - 1.0).powi(2);
    let heavier = squares.iter().zip(slopes).map(scatter).sum::<f64>() / (2.0 * squares.len() as f64);
    Some(Growth { still: a, variance: b, error: error * heavier.sqrt().max(1.0) })
}

impl Growth {
    /// The same by what products of outputs tell besides, if that does not contradict it.
    fn with(self, products: Option<Shared>) -> Option<Self> {
        let Some(products) = products else { return Some(self) };
        if products.variance < SHARED * self.variance && products.variance + BELOW * products.error < self.variance {
            return None;
        }
        let (own, other) = (self.error.powi(-2), products.error.powi(-2));
        let variance = (own * self.variance + other * products.variance) / (own + other);
        Some(Self { variance, error: (own + other).sqrt().recip(), ..self })
    }
}

/// By how much products of residuals grow with products of their slopes, and the standard error of that.
struct Shared {
    variance: f64,
    error: f64,
}

/// Products of two residuals, and those of their slopes.
#[derive(Default)]
struct Products {
    of_residuals: Vec<f64>,
    of_slopes: Vec<f64>,
}

impl Products {
    fn push(&mut self, (a, k): (&Seen, usize), (b, l): (&Seen, usize)) {
        self.of_residuals.push(a.residual[k] * b.residual[l]);
        self.of_slopes.push(a.slopes[k] * b.slopes[l]);
    }

    /// Those of neighbouring samples of an output.
    fn of_neighbours(comparison: &Comparison<'_>, seen: &[Seen]) -> Self {
        let mut all = Self::default();
        for of in seen {
            for range in comparison.ranges() {
                let neighbours = of.rows.windows(2).filter(|w| w[1] == w[0] + 1 && w.iter().all(|k| range.contains(k)));
                neighbours.for_each(|w| all.push((of, w[0]), (of, w[1])));
            }
        }
        all
    }

    /// Those of two outputs in one row.
    fn of_outputs(seen: &[Seen]) -> Self {
        let mut all = Self::default();
        for (i, a) in seen.iter().enumerate() {
            for b in &seen[i + 1..] {
                let both = a.rows.iter().filter(|k| b.rows.binary_search(k).is_ok());
                both.for_each(|k| all.push((a, *k), (b, *k)));
            }
        }
        all
    }

    /// Regression of the ones on the others, each in units of its own variance where that grows by so much. None where slopes do not tell.
    fn growth(&self, variance: f64) -> Option<Shared> {
        let weighted = || {
            let pairs = self.of_residuals.iter().zip(&self.of_slopes);
            pairs.map(|(y, x)| {
                let w = 1.0 / (1.0 + variance * x.abs());
                ((y * w).clamp(-CUT, CUT), x * w, w)
            })
        };
        let (mut ww, mut wx, mut xx, mut wy, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (y, x, w) in weighted() {
            ww += w * w;
            wx += w * x;
            xx += x * x;
            wy += w * y;
            xy += x * y;
        }
        let determinant = ww * xx - wx * wx;
        if determinant <= 0.0 {
            return None;
        }
        let (still, growth) = ((xx * wy - wx * xy) / determinant, (ww * xy - wx * wy) / determinant);
        let left: f64 = weighted().map(|(y, x, w)| (y - still * w - growth * x).powi(2)).sum();
        let error = (left / self.of_residuals.len() as f64 * ww / determinant).sqrt();
        (error > 0.0).then_some(Shared { variance: growth, error })
    }
}

impl Jitter {
    /// Deviation of a value that changes at a rate, in units of the noise of this deviation.
    pub(crate) fn scatter(&self, slope: f64, noise: f64) -> f64 {
        (self.still + self.share(slope, noise)).sqrt()
    }

    /// Slope of a series as far as times are off: what an arrival that is off by more than a sample moves is the way to there.
    pub(crate) fn slope(&self, time: &[f64], series: &[f64]) -> Vec<f64> {
        super::slope_within(time, series, self.reach())
    }

    fn reach(&self) -> f64 {
        if self.of == Scatter::Messages { self.deviation } else { 0.0 }
    }

    /// Variance that jitter makes of a value that changes at a rate, as a share of the noise's.
    fn share(&self, slope: f64, noise: f64) -> f64 {
        (self.deviation / noise).powi(2) * slope * slope
    }

    /// By output, the factor of each row that brings its innovation back to the size it has without jitter.
    pub(crate) fn factors(&self, comparison: &Comparison<'_>) -> Vec<Vec<f64>> {
        (0..comparison.outputs()).map(|output| self.weights(comparison, output)).collect()
    }

    /// Factor of each row of an output that brings its innovation back to the size it has without jitter.
    pub(super) fn weights(&self, comparison: &Comparison<'_>, output: usize) -> Vec<f64> {
        let noise = comparison.noise[output];
        slopes_of(comparison, output, self.reach()).iter().map(|d| 1.0 / (1.0 + self.share(*d, noise)).sqrt()).collect()
    }
}

/// What is left of an output, in units of its noise.
pub(super) fn left_of(comparison: &Comparison<'_>, output: usize) -> Vec<f64> {
    let stretches = 0..comparison.data.stretches.len();
    stretches.flat_map(|s| comparison.left(s, output).map(|left| left / comparison.noise[output])).collect()
}

/// Slope of the simulated output within stretches, as far to either side as times may be off.
pub(super) fn slopes_of(comparison: &Comparison<'_>, output: usize, reach: f64) -> Vec<f64> {
    let stretches = comparison.data.stretches.iter().zip(comparison.model);
    stretches.flat_map(|(stretch, run)| super::slope_within(&stretch.time, &run[output], reach)).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        ab += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}
