//! Events: now and then the model misses something for some samples, far beyond its noise, and then nothing. A link that drops out, a gust, a wheel
//! that meets a stone.
//!
//! Noise with heavy tails has values far out as well, but none of them knows of the next. Coloured, it falls back from each; whitened, a value that was
//! read wrongly shows twice. So a sample counts as far out only if both what is left there and its innovation are, beyond [`ASTRAY`] robust deviations.
//! Where an effect that was found hangs on moments, it may be a little early or late: what is missed by no more than it changes at once beside that is none.
//! Of n such samples among N, n²/N follow another one by chance, and how many do is distributed as Poisson's law has it.

use statrs::distribution::{DiscreteCDF, Poisson};

use crate::comparison::Comparison;
use crate::noise::{ASTRAY, far};

use super::bursts::FALSE_ALARM;

/// Events that are more than one mishap.
const SEVERAL: usize = 3;
/// Samples by which what hangs on moments may be early or late.
const BESIDE: usize = 2;

/// Times far out that last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Events {
    /// Which output.
    pub output: usize,
    /// How many there are.
    pub count: usize,
    /// How long one is in the mean \[s\].
    pub lasts: f64,
    /// When the first begins \[s\].
    pub first: f64,
    /// Their energy, in squared standard deviations of the innovations.
    pub excess: f64,
}

/// Those of the output in which they have most energy.
pub(super) fn find(comparison: &Comparison<'_>) -> Option<Events> {
    let found = (0..comparison.outputs()).filter_map(|output| of(comparison, output));
    found.max_by(|a, b| a.excess.total_cmp(&b.excess))
}

fn of(comparison: &Comparison<'_>, output: usize) -> Option<Events> {
    let stretches = &comparison.data.stretches;
    let left: Vec<Vec<f64>> = (0..stretches.len()).map(|s| comparison.left(s, output).collect()).collect();
    // What rounding moves to the next step is not far out, however seldom it does.
    let most = far(left.iter().map(Vec::as_slice), 0.0, ASTRAY, comparison.rounded[output])?;
    let white = comparison.white.iter().map(|white| white[output].as_slice());
    let most_new = far(white, 0.0, ASTRAY, comparison.ordinary(output))?;
    let (mut astray, mut following, mut events, mut excess, mut first) = (0_usize, 0_usize, 0_usize, 0.0, f64::INFINITY);
    for (s, ((stretch, white), left)) in stretches.iter().zip(comparison.white).zip(&left).enumerate() {
        let (mut run, sudden) = (0_usize, sudden(comparison, s, output));
        for (k, (x, e)) in left.iter().zip(&white[output]).enumerate() {
            if x.abs() <= most + sudden[k] || e.abs() <= most_new {
                run = 0;
                continue;
            }
            run += 1;
            astray += 1;
            following += usize::from(run > 1);
            excess += e * e;
            if run == 2 {
                events += 1;
                first = f64::min(first, stretch.time[k - 1]);
            }
        }
    }
    let chance = (astray * astray) as f64 / comparison.data.samples() as f64;
    let more = Poisson::new(chance).ok()?.sf(following.checked_sub(1)? as u64);
    let several = events >= SEVERAL && more < FALSE_ALARM / comparison.outputs() as f64;
    let lasts = (following + events) as f64 / events.max(1) as f64 * comparison.scene.scales.period;
    several.then_some(Events { output, count: events, lasts, first, excess })
}

/// The most by which the effects change an output from one sample to the next, about each sample of a stretch; nothing where none of them hangs on moments.
fn sudden(comparison: &Comparison<'_>, stretch: usize, output: usize) -> Vec<f64> {
    let [model, without] = [comparison.model, comparison.without].map(|runs| &runs[stretch][output]);
    if !comparison.moments {
        return vec![0.0; model.len()];
    }
    let done: Vec<f64> = model.iter().zip(without).map(|(y, without)| y - without).collect();
    let steps: Vec<f64> = done.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let about = |k: usize| &steps[k.saturating_sub(BESIDE).min(steps.len())..(k + BESIDE).min(steps.len())];
    (0..done.len()).map(|k| about(k).iter().copied().fold(0.0, f64::max)).collect()
}
