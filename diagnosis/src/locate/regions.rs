//! Regions of state that hold more of the misfit than of the time.
//!
//! Of each output, the sixteenths of its range in which the misfit is at least twice as loud as on average and louder than the noise;
//! neighbours are one region. Along every other quantity the samples are sorted into bins of equal count, and the run of bins is sought
//! whose share p of the excess stands out most from its share e of the samples: the largest p ln(p/e) + (1 − p) ln((1 − p)/(1 − e)), a
//! scan statistic. Of these the best is told, if it says clearly more than every region of an output does.

use crate::comparison::{Comparison, wrapped};
use crate::finding::Region;

use super::Excess;

/// Bins along a quantity.
const BINS: usize = 16;
/// A region of an output is so many times as loud as the average.
const LOUD: f64 = 2.0;
/// Samples of an output's bin that make a mean.
const FEWEST: usize = 8;
/// A region of another quantity is told if it holds this many times its share of the samples...
const ENRICHED: f64 = 1.5;
/// ... and this share of the excess.
pub(super) const NOTABLE: f64 = 0.25;
/// So many times as distinct as an output's region must another quantity's be: commands and outputs go together.
const CLEARLY: f64 = 2.0;
/// Most regions told.
const MOST: usize = 5;

/// A quantity: its name, its value at every sample, and how to say that something lies between two of its values.
struct Quantity {
    name: String,
    unit: String,
    values: Vec<f64>,
}

pub(super) fn find(comparison: &Comparison<'_>, excess: &Excess) -> Vec<Region> {
    let weights: Vec<f64> = comparison
        .data
        .stretches
        .iter()
        .enumerate()
        .flat_map(|(s, stretch)| (0..stretch.len()).map(move |k| (s, k)))
        .map(|(s, k)| excess.at(s, k))
        .collect();
    let total: f64 = weights.iter().sum();
    if total <= 0.0 || weights.len() < 4 * BINS {
        return Vec::new();
    }
    let quantities = quantities(comparison);
    let is_output = |q: &&Quantity| comparison.data.outputs.iter().any(|c| c.name == q.name);
    let mut found: Vec<(f64, Region)> = quantities.iter().filter(is_output).flat_map(|q| loud(q, &weights, total, excess.exact)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MOST - 1);
    let others = quantities.iter().filter(|q| !is_output(q)).filter_map(|q| scan(q, &weights, total, excess.exact));
    let other = others.max_by(|a, b| a.0.total_cmp(&b.0));
    let most = found.first().map_or(0.0, |f| f.0);
    other.filter(|o| o.0 > CLEARLY * most).into_iter().chain(found).map(|(_, region)| region).collect()
}

/// Parts of an output's range in which the misfit is loud, with their distinctness.
fn loud(quantity: &Quantity, weights: &[f64], total: f64, exact: bool) -> Vec<(f64, Region)> {
    let n = weights.len();
    let (low, high) = quantity.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let width = (high - low) / BINS as f64;
    if width.is_nan() || width <= 0.0 {
        return Vec::new();
    }
    let mut bins = [(0.0, 0_usize); BINS];
    for (value, weight) in quantity.values.iter().zip(weights) {
        let bin = &mut bins[(((value - low) / width) as usize).min(BINS - 1)];
        bin.0 += weight;
        bin.1 += 1;
    }
    let mean = total / n as f64;
    let told = |(sum, count): &(f64, usize)| {
        let own = sum / *count as f64;
        *count >= FEWEST && own >= LOUD * mean && own > 1.0 && told(*sum, *count, exact)
    };
    let mut regions = Vec::new();
    let mut from = 0;
    while from < BINS {
        let run = bins[from..].iter().take_while(|b| told(b)).count();
        if run == 0 {
            from += 1;
            continue;
        }
        let (sum, count) = bins[from..from + run].iter().fold((0.0, 0), |(s, c), b| (s + b.0, c + b.1));
        let (p, e) = ((sum / total).clamp(0.0, 1.0), count as f64 / n as f64);
        let (start, end) = (low + width * from as f64, low + width * (from + run) as f64);
        let words = words(quantity, start, end, (from == 0, from + run == BINS));
        regions.push((divergence(p, e), Region { of: quantity.name.clone(), from: start, to: end, share: p, expected: e, words }));
        from += run;
    }
    regions
}

/// What a misfit may depend on: commands, simulated outputs and their slopes, wheels, heading.
fn quantities(comparison: &Comparison<'_>) -> Vec<Quantity> {
    let all = |f: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        comparison
            .data
            .stretches
            .iter()
            .enumerate()
            .flat_map(|(s, stretch)| (0..stretch.len()).map(move |k| (s, k)))
            .map(|(s, k)| f(s, k))
            .collect()
    };
    let mut list = Vec::new();
    for (i, channel) in comparison.data.outputs.iter().enumerate() {
        let (name, unit) = (channel.name.to_string(), channel.unit.to_string());
        list.push(Quantity { name: name.clone(), unit: unit.clone(), values: all(&|s, k| comparison.model[s][i][k]) });
        let slopes: Vec<Vec<f64>> = comparison
            .data
            .stretches
            .iter()
            .zip(comparison.model)
            .map(|(stretch, run)| crate::adequacy::slope(&stretch.time, &run[i]))
            .collect();
        list.push(Quantity { name: format!("{name}_dot"), unit: format!("{unit}/s"), values: all(&|s, k| slopes[s][k]) });
    }
    for (i, channel) in comparison.data.inputs.iter().enumerate() {
        let values = all(&|s, k| comparison.data.stretches[s].inputs[i][k]);
        list.push(Quantity { name: channel.name.to_string(), unit: channel.unit.to_string(), values });
    }
    if matches!(comparison.scene.frame, wheelwright_core::effect::Frame::Body { .. }) {
        for (side, name) in ["wheel_speed_left", "wheel_speed_right"].into_iter().enumerate() {
            let values = all(&|s, k| comparison.scene.frame.wheels(&[comparison.model[s][0][k], comparison.model[s][1][k]])[side]);
            list.push(Quantity { name: name.to_owned(), unit: "m/s".to_owned(), values });
        }
    }
    if comparison.scene.tracks.iter().all(|t| !t.heading.is_empty()) {
        let values = all(&|s, k| wrapped(comparison.scene.tracks[s].heading[k]));
        list.push(Quantity { name: "phi".to_owned(), unit: "rad".to_owned(), values });
    }
    list
}

/// The run of bins along a quantity in which the excess stands out most, with its distinctness.
fn scan(quantity: &Quantity, weights: &[f64], total: f64, exact: bool) -> Option<(f64, Region)> {
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|a, b| quantity.values[*a].total_cmp(&quantity.values[*b]).then(a.cmp(b)));
    let n = order.len();
    // A bin ends only between two different values: rows at rest stay together.
    let mut edges = vec![0];
    for bin in 1..=BINS {
        let mut end = bin * n / BINS;
        while end < n && end > 0 && quantity.values[order[end]] == quantity.values[order[end - 1]] {
            end += 1;
        }
        if end > edges[edges.len() - 1] {
            edges.push(end);
        }
    }
    let sums: Vec<f64> = edges.windows(2).map(|e| order[e[0]..e[1]].iter().map(|k| weights[*k]).sum::<f64>()).collect();
    let mut best: Option<(f64, usize, usize)> = None;
    for from in 0..sums.len() {
        let mut sum = 0.0;
        for to in from..sums.len() {
            sum += sums[to];
            let (p, e) = ((sum / total).clamp(0.0, 1.0), (edges[to + 1] - edges[from]) as f64 / n as f64);
            if p < NOTABLE || p < ENRICHED * e || !told(sum, edges[to + 1] - edges[from], exact) {
                continue;
            }
            let distinct = divergence(p, e);
            if best.is_none_or(|(d, ..)| distinct > d) {
                best = Some((distinct, from, to));
            }
        }
    }
    let (distinct, from, to) = best?;
    let (low, high) = (quantity.values[order[edges[from]]], quantity.values[order[edges[to + 1] - 1]]);
    let share = (sums[from..=to].iter().sum::<f64>() / total).clamp(0.0, 1.0);
    let expected = (edges[to + 1] - edges[from]) as f64 / n as f64;
    let reach = (from == 0, to + 1 == sums.len());
    let words = words(quantity, low, high, reach);
    Some((distinct, Region { of: quantity.name.clone(), from: low, to: high, share, expected, words }))
}

/// With noise taken off as a variance, a sum of squares must exceed what the noise's own scatter gives: three standard deviations.
fn told(sum: f64, samples: usize, exact: bool) -> bool {
    exact || sum > 3.0 * (2.0 * samples as f64).sqrt()
}

/// p ln(p/e) + (1 − p) ln((1 − p)/(1 − e)).
fn divergence(p: f64, e: f64) -> f64 {
    let part = |p: f64, e: f64| if p > 0.0 && e > 0.0 { p * (p / e).ln() } else { 0.0 };
    part(p, e) + part(1.0 - p, 1.0 - e)
}

/// The region in words.
fn words(quantity: &Quantity, low: f64, high: f64, (lowest, highest): (bool, bool)) -> String {
    let reach = quantity.values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let Quantity { name, unit, .. } = quantity;
    let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
    let (low_text, high_text) = (crate::effects::digits(low), crate::effects::digits(high));
    let range = match (lowest, highest) {
        (true, false) => format!("{name} below {high_text}{unit}"),
        (false, true) => format!("{name} above {low_text}{unit}"),
        _ => format!("{name} between {low_text} and {high_text}{unit}"),
    };
    let kind = if name.ends_with("_dot") {
        if low.min(-high) > 0.0 || low > 0.0 {
            "speeding up"
        } else if high < 0.0 {
            "slowing down"
        } else {
            "steady motion"
        }
    } else if low.abs().max(high.abs()) < 0.2 * reach {
        "near standstill"
    } else if low > 0.5 * reach {
        "at the fastest forwards or leftwards"
    } else if high < -0.5 * reach {
        "at the fastest backwards or rightwards"
    } else if low >= 0.0 {
        "forwards or leftwards"
    } else if high <= 0.0 {
        "backwards or rightwards"
    } else {
        return range;
    };
    let kind = match (name.as_str(), kind) {
        ("v" | "v_ref" | "wheel_speed_left" | "wheel_speed_right" | "vel_left" | "vel_right" | "u_left" | "u_right", k) => {
            k.replace(" or leftwards", "").replace(" or rightwards", "")
        }
        ("omega" | "omega_ref", k) => k
            .replace("forwards or leftwards", "turning left")
            .replace("backwards or rightwards", "turning right")
            .replace("at the fastest turning", "turning fastest"),
        (name, k) if name.ends_with("_dot") => k.to_owned(),
        (_, k) => k
            .replace("at the fastest forwards or leftwards", "at its largest")
            .replace("at the fastest backwards or rightwards", "at its most negative")
            .replace("forwards or leftwards", "positive")
            .replace("backwards or rightwards", "negative"),
    };
    if name == "phi" { range } else { format!("{kind} ({range})") }
}
