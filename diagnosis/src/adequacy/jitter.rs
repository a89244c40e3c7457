//! Jitter of stamps: noise that grows with acceleration.
//!
//! A stamp that is wrong by ε moves a sample along the curve, y(t + ε) = y(t) + ẏ ε, so the residual's variance is s0² + σt² ẏ².
//! Motion that the model misses grows with acceleration too, but goes on from one sample to the next, which stamps that are
//! off by chance do not: products of neighbours are held against products of their slopes, and where they grow half as much as the squares
//! it is no jitter. Rounding is loud as well where an output goes from step to step, and silent where it stays within one: behind little other noise only
//! rows count in which it goes by a step and more. Nor can stamps that stand in order be off, for sure, by more than their distance.

use crate::comparison::Comparison;

use super::bursts::FALSE_ALARM;

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
    let (mut squares, mut slopes, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    let (mut products, mut pairs) = (Vec::new(), Vec::new());
    for output in 0..comparison.outputs() {
        let plain = slopes_of(comparison, output, 0.0);
        let noise = comparison.noise[output];
        let residual = left_of(comparison, output);
        let seen: Vec<usize> = (0..plain.len()).filter(|k| looked_at(output, plain[*k])).collect();
        // Both outputs speak of the same stamps: in units of their own noise they are one series.
        squares.extend(seen.iter().map(|k| residual[*k] * residual[*k]));
        slopes.extend(seen.iter().map(|k| (plain[*k] / noise).powi(2)));
        for range in comparison.ranges() {
            let neighbours = seen.windows(2).filter(|w| w[1] == w[0] + 1 && w.iter().all(|k| range.contains(k)));
            for w in neighbours {
                products.push(residual[w[0]] * residual[w[1]]);
                pairs.push(plain[w[0]] * plain[w[1]] / (noise * noise));
            }
        }
        rows.push(seen);
    }
    let Growth { still, variance, error } = growth(&squares, &slopes)?;
    // Where the variance is jitter's. The few samples at which an output jumps say no more of that than others at which it is.
    let mut shares = slopes.iter().map(|x| variance * x / (still + variance * x));
    let grown = |(output, seen): (usize, &Vec<usize>)| {
        let innovations = comparison.innovations(output);
        let white: Vec<f64> = seen.iter().map(|k| innovations[*k].powi(2).min(CUT)).collect();
        let shares: Vec<f64> = shares.by_ref().take(seen.len()).collect();
        correlation(&white, &shares) * (seen.len() as f64).sqrt()
    };
    let z: Vec<f64> = rows.iter().enumerate().filter(|(_, seen)| !seen.is_empty()).map(grown).collect();
    let combined = z.iter().sum::<f64>() / (z.len() as f64).sqrt();
    let limit = statrs::distribution::ContinuousCDF::inverse_cdf(&statrs::distribution::Normal::standard(), 1.0 - FALSE_ALARM);
    if combined < limit || z.iter().any(|z| *z < 0.0) {
        return None;
    }
    let chance = growth_of_neighbours(&products, &pairs, variance) < 0.5 * variance;
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

/// A variance a + b x of residuals.
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

/// Regression of products of neighbouring residuals on products of their slopes, each in units of its own variance under `growth`.
fn growth_of_neighbours(products: &[f64], slopes: &[f64], growth: f64) -> f64 {
    let (mut ww, mut wx, mut xx, mut wy, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (y, x) in products.iter().zip(slopes) {
        let w = 1.0 / (1.0 + growth * x.abs());
        let (y, x) = ((y * w).clamp(-CUT, CUT), x * w);
        ww += w * w;
        wx += w * x;
        xx += x * x;
        wy += w * y;
        xy += x * y;
    }
    let determinant = ww * xx - wx * wx;
    if determinant > 0.0 { (ww * xy - wx * wy) / determinant } else { 0.0 }
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
