//! How far wheels have come, from what was recorded and what a model foresees.
//!
//! The integral of a noisy speed walks away from the distance, and that of a simulated speed leaves it where the model is wrong. What the
//! record differs by from the model is taken for a misfit that wanders and a noise that does not: a local level (Durbin and Koopman, Time
//! Series Analysis by State Space Methods, section 2.1). The smoothed level is the misfit, and counts as motion; the noise does not. Means
//! over pieces of the record are taken first: what returns with every turn of a wheel is neither, and takes it nowhere. How much of them is
//! noise the quick changes of the record say: a misfit that jumps from piece to piece is no less motion for that.

use crate::dataset::Stretch;

/// Variances of the wander from mean to mean that are tried, as shares of that of their noise: from a level that stays to one that is the
/// record itself.
const WANDERS: [f64; 8] = [0.0, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3, 1e4];

/// Pieces of which means are taken.
const PIECES: usize = 32;

/// What has been covered at a rate, by trapezoids, in each stretch. From zero, or, behind a gap in a segment, from where the one before it ended and
/// as far on as both its edges tell.
pub(super) fn covered(stretches: &[Stretch], rates: impl Iterator<Item = Vec<f64>>) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = Vec::with_capacity(stretches.len());
    let mut last: Option<(&Stretch, f64)> = None;
    for (stretch, rate) in stretches.iter().zip(rates) {
        let gap = |(before, rate_there): (&Stretch, f64)| {
            let from = all.last().and_then(|covered| covered.last())?;
            let step = stretch.time.first()? - before.time.last()?;
            stretch.continues(before).then_some(from + 0.5 * (rate_there + rate.first()?) * step)
        };
        let from = last.and_then(gap).unwrap_or(0.0);
        let covered = stretch.integral(&rate).into_iter().map(|way| from + way).collect();
        last = rate.last().map(|rate| (stretch, *rate));
        all.push(covered);
    }
    all
}

/// The likeliest level of a series: that of means over pieces, and evenly from the middle of one to that of the next, so that each piece has its
/// mean.
pub(super) fn level(series: &[f64]) -> Vec<f64> {
    let piece = series.len().div_ceil(PIECES).max(1);
    let mean = |c: &[f64]| c.iter().sum::<f64>() / c.len() as f64;
    let means: Vec<f64> = series.chunks(piece).map(mean).collect();
    let changes: Vec<f64> = series.windows(2).map(|w| 0.5 * (w[1] - w[0]).powi(2)).collect();
    let noise = changes.iter().sum::<f64>() / (changes.len() * piece).max(1) as f64;
    let fits = WANDERS.iter().map(|wander| Filtered::of(&means, *wander, noise));
    let levels = fits.reduce(|a, b| if b.likelihood > a.likelihood { b } else { a }).map_or(Vec::new(), |f| f.smoothed());
    let at = |k: usize| {
        let place = ((k as f64 + 0.5) / piece as f64 - 0.5).clamp(0.0, levels.len() as f64 - 1.0);
        let (before, share) = (place as usize, place.fract());
        levels[before] + share * (levels[(before + 1).min(levels.len() - 1)] - levels[before])
    };
    let mut whole: Vec<f64> = (0..series.len()).map(at).collect();
    for (piece, level) in whole.chunks_mut(piece).zip(&levels) {
        let off = level - mean(piece);
        piece.iter_mut().for_each(|x| *x += off);
    }
    whole
}

/// A pass of the Kalman filter, with variances as shares of the noise's.
struct Filtered {
    wander: f64,
    /// The level at each sample as the samples up to it tell it, and its variance.
    level: Vec<(f64, f64)>,
    /// Twice its logarithm.
    likelihood: f64,
}

impl Filtered {
    /// From the first sample, of which nothing was known before.
    fn of(series: &[f64], wander: f64, noise: f64) -> Self {
        let mut level = Vec::with_capacity(series.len());
        let (mut squares, mut logs) = (0.0, 0.0);
        for y in series {
            let Some((mean, variance)) = level.last().copied() else {
                level.push((*y, 1.0));
                continue;
            };
            let (before, total) = (variance + wander, variance + wander + 1.0);
            let innovation: f64 = y - mean;
            squares += innovation * innovation / total;
            logs += f64::ln(total);
            level.push((mean + before / total * innovation, before / total));
        }
        Self { wander, level, likelihood: -squares / noise.max(f64::MIN_POSITIVE) - logs }
    }

    /// The level as all samples tell it.
    fn smoothed(self) -> Vec<f64> {
        let mut after = self.level.last().map_or(0.0, |l| l.0);
        let mut smoothed: Vec<f64> = self
            .level
            .iter()
            .rev()
            .map(|(mean, variance)| {
                after = mean + variance / (variance + self.wander) * (after - mean);
                after
            })
            .collect();
        smoothed.reverse();
        smoothed
    }
}

#[cfg(test)]
mod tests {
    use super::{Stretch, covered, level};

    /// Numbers of zero mean that look like noise.
    fn noise(n: usize) -> Vec<f64> {
        let mut x = 0.4_f64;
        (0..n)
            .map(|_| {
                x = 3.99 * x * (1.0 - x);
                x - 0.5
            })
            .collect()
    }

    #[test]
    fn a_course_goes_on_behind_a_gap_and_begins_anew_in_another_segment() {
        let stretch = |label: &str, from: f64| Stretch {
            label: label.to_owned(),
            time: (0..3).map(|k| from + f64::from(k)).collect(),
            inputs: Vec::new(),
            outputs: Vec::new(),
        };
        let stretches = [stretch("a", 0.0), stretch("a+1", 4.0), stretch("b", 8.0)];
        let course = covered(&stretches, [vec![1.0, 1.0, 2.0], vec![2.0; 3], vec![1.0; 3]].into_iter());
        assert_eq!(course, [[0.0, 1.0, 2.5], [6.5, 8.5, 10.5], [0.0, 1.0, 2.0]]);
        assert!(!stretches[0].continues(&stretches[1]) && !stretches[2].continues(&stretches[1]));
    }

    #[test]
    fn noise_has_one_level_and_a_slow_wave_is_followed() {
        let noise = noise(2000);
        let flat = level(&noise);
        let mean = noise.iter().sum::<f64>() / noise.len() as f64;
        assert!(flat.iter().all(|l| (l - mean).abs() < 0.05), "{:?}", &flat[..5]);
        let wave = |k: usize| 2.0 * (k as f64 / 400.0).sin();
        let turns = |k: usize| (k as f64 / 3.0).sin();
        let series: Vec<f64> = noise.iter().enumerate().map(|(k, n)| n + wave(k) + turns(k)).collect();
        let worst = level(&series).iter().enumerate().skip(63).map(|(k, l)| (l - mean - wave(k)).abs()).fold(0.0, f64::max);
        assert!(worst < 0.25, "{worst}");
        assert!(level(&[]).is_empty() && level(&[3.0]) == [3.0]);
    }

    #[test]
    fn a_misfit_that_jumps_is_no_noise() {
        let (quick, jumps) = (noise(2000), noise(40));
        let series: Vec<f64> = quick.iter().enumerate().map(|(k, n)| 0.1 * n + jumps[k / 50]).collect();
        let (mut way, mut worst) = (0.0, 0.0_f64);
        for (told, there) in level(&series).iter().zip(&series) {
            way += told - there;
            worst = worst.max(f64::abs(way));
        }
        // The way is that of the record but for what goes on within a piece of it.
        assert!(worst < 15.0, "{worst}");
    }
}
