//! Inputs that come later.

use std::borrow::Cow;

use crate::dataset::Stretch;

/// The rows of a column, or all of them.
pub(super) fn pick(column: Vec<f64>, rows: Option<&[usize]>) -> Vec<f64> {
    match rows {
        Some(rows) => rows.iter().map(|&k| column[k]).collect(),
        None => column,
    }
}

/// A stretch whose inputs come later by their delays (earlier, if negative), and the rows of it that are the original's; before
/// its first value an input is held. Every change of an input starts a row of its own, so that the hold stays exact. The outputs
/// are the original's, for their size only.
pub(super) fn delayed<'s>(stretch: &'s Stretch, axes: &[Option<usize>], delays: &[f64]) -> (Cow<'s, Stretch>, Option<Vec<usize>>) {
    let of = |input: usize| axes.get(input).copied().flatten().and_then(|axis| delays.get(axis)).copied().unwrap_or(0.0);
    let shifts: Vec<f64> = (0..stretch.inputs.len()).map(of).collect();
    if shifts.iter().all(|d| *d == 0.0) {
        return (Cow::Borrowed(stretch), None);
    }
    let time = &stretch.time;
    let (first, last) = (time[0], time[time.len() - 1]);
    let mut distinct: Vec<f64> = shifts.iter().copied().filter(|d| *d != 0.0).collect();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    // A row closer to another than this is the same.
    let same = 1e-9 * (last - first) / time.len() as f64;
    let mut merged: Vec<(f64, bool)> = time.iter().map(|t| (*t, true)).collect();
    for shift in distinct {
        merged.extend(time.iter().map(|t| (t + shift, false)).filter(|(t, _)| *t > first && *t < last));
    }
    merged.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let mut kept: Vec<(f64, bool)> = Vec::with_capacity(merged.len());
    for (t, original) in merged {
        match kept.last_mut() {
            Some((before, was_original)) if t - *before <= same && !(original && *was_original) => {
                if original {
                    (*before, *was_original) = (t, true);
                }
            }
            _ => kept.push((t, original)),
        }
    }
    let held = |(column, shift): (&Vec<f64>, &f64)| -> Vec<f64> {
        let mut k = 0;
        let mut at = |t: f64| {
            while k + 1 < time.len() && time[k + 1] + shift <= t + same {
                k += 1;
            }
            column[k]
        };
        kept.iter().map(|(t, _)| at(*t)).collect()
    };
    let inputs = stretch.inputs.iter().zip(&shifts).map(held).collect();
    let rows = kept.iter().enumerate().filter(|(_, (_, original))| *original).map(|(k, _)| k).collect();
    let time = kept.iter().map(|(t, _)| *t).collect();
    (Cow::Owned(Stretch { label: stretch.label.clone(), time, inputs, outputs: stretch.outputs.clone() }), Some(rows))
}
