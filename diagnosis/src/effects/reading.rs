//! What sensors make of the outputs' past.

/// Pieces of an interval on which Simpson's rule is applied: the simulation is a parabola in each sub-step.
const PIECES: usize = 4;

/// The mean of the true outputs over a span from `start`, left in `outputs`; `sum` is room for as many numbers.
pub(super) fn mean(start: f64, span: f64, past: &dyn Fn(f64, &mut [f64]), sum: &mut [f64], outputs: &mut [f64]) {
    sum.fill(0.0);
    for i in 0..=2 * PIECES {
        past(start + span * i as f64 / (2 * PIECES) as f64, outputs);
        let weight = if i == 0 || i == 2 * PIECES { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
        sum.iter_mut().zip(outputs.iter()).for_each(|(s, x)| *s += weight / (6 * PIECES) as f64 * x);
    }
    outputs.copy_from_slice(sum);
}
