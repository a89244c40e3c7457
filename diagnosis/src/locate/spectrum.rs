//! At which frequencies: bands in which the misfit exceeds its share.

use crate::comparison::Comparison;

use super::Excess;

/// Edges of the bands \[Hz\]: wander, manoeuvres, a drive's time constants, its fast dynamics, and beyond.
const EDGES: [f64; 6] = [0.0, 0.05, 0.2, 1.0, 3.0, f64::INFINITY];
/// Frequencies a band is sampled at.
const SAMPLES: usize = 24;
/// A band is told if it holds this share of the energy.
const NOTABLE: f64 = 0.3;

/// Bands that hold most of the misfit, each between two edges, up to half the sampling rate.
pub(super) fn bands(comparison: &Comparison<'_>, excess: &Excess) -> Vec<(f64, f64)> {
    let Some((s, stretch)) = comparison.data.stretches.iter().enumerate().max_by_key(|(_, s)| s.len()) else { return Vec::new() };
    let nyquist = 0.5 / comparison.scene.scales.period;
    let duration = stretch.time[stretch.len() - 1] - stretch.time[0];
    let mut energies = Vec::new();
    for edge in EDGES.windows(2) {
        let (from, to) = (edge[0].max(0.25 / duration), edge[1].min(nyquist));
        if to > from {
            energies.push(((edge[0], to), energy(comparison, excess, s, from, to)));
        }
    }
    let total: f64 = energies.iter().map(|(_, e)| e).sum();
    let mut told: Vec<(f64, f64)> = Vec::new();
    for (band, _) in energies.iter().filter(|(_, e)| *e > NOTABLE * total && total > 0.0) {
        match told.last_mut() {
            Some(last) if last.1 == band.0 => last.1 = band.1,
            _ => told.push(*band),
        }
    }
    told
}

/// Energy of the misfit between two frequencies, above that of white noise, over all outputs.
fn energy(comparison: &Comparison<'_>, excess: &Excess, s: usize, from: f64, to: f64) -> f64 {
    let stretch = &comparison.data.stretches[s];
    let n = stretch.len() as f64;
    let mut sum = 0.0;
    for i in 0..comparison.outputs() {
        let series: Vec<f64> = excess.off[s][i].iter().map(|x| x / comparison.noise[i]).collect();
        let step = (to - from) / SAMPLES as f64;
        for j in 0..SAMPLES {
            let angular = std::f64::consts::TAU * (from + (j as f64 + 0.5) * step);
            let (sine, cosine) = series.iter().zip(&stretch.time).fold((0.0, 0.0), |(a, b), (x, t)| {
                let (s, c) = (angular * t).sin_cos();
                (a + x * s, b + x * c)
            });
            let noise = if excess.exact { 0.0 } else { n };
            sum += ((sine * sine + cosine * cosine) - noise) * step;
        }
    }
    sum.max(0.0)
}
